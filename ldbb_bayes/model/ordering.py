"""Order of elimination: which columns of a sparse least-squares problem are eliminated together.

The observation equations r = A x + noise have one column of A for each coefficient x. Two columns
are neighbours if some row has both non-zero. Eliminating a coefficient makes all its neighbours
neighbours of each other, and costs the square of their number. The order therefore matters:

1. The column with the fewest neighbours is always eliminated next (minimum degree). Columns whose
   Cholesky factor is wanted stay to the end, in the order in which they stand.
2. The neighbours that a column has when it is eliminated are its border. The first of them to be
   eliminated is its parent, which makes the columns a forest (the elimination tree).
3. Eliminating one column alone takes a fixed time for function calls. A column is therefore merged
   into its parent if the multiplications that are added to do so take less time than the calls that
   are saved. What results are groups of columns (supernodes) that are eliminated together.

Literature: J. W. H. Liu, The multifrontal method for sparse matrix solution: theory and practice,
SIAM Review 34 (1992) 82; T. A. Davis, Direct Methods for Sparse Linear Systems, SIAM (2006).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["PRODUCT_COLUMNS", "ColumnGroup", "elimination_groups", "heights"]

# Number of columns of a border whose products with the border one call computes.
PRODUCT_COLUMNS = 8
# The following costs are measured times, in units of the time of one multiplication for all values
# of the hyper-parameters that are processed together. Results depend little on them.
# Time of the function calls that a group needs once.
_GROUP_COST = 100.0
# Time of the function calls that eliminate one column of a group.
_COLUMN_COST = 200.0
# Time of the function calls for the products of `PRODUCT_COLUMNS` columns of a border.
_PRODUCT_CALL_COST = 250.0
# Time to subtract one product of two columns of a border from the entries of later columns.
_UPDATE_COST = 1.0
# Largest number of computed times that are kept in memory, because the same numbers of columns
# occur again and again.
_KEPT_COSTS = 4096


class ColumnGroup(NamedTuple):
    """Columns of the design matrix that are eliminated together.

    Both fields hold indices of columns, in the order of their elimination.
    """

    #: Columns of the group, shape (s,).
    columns: NDArray[np.intp]
    #: Columns eliminated later that are neighbours of the group, shape (m,): those that have a row
    #: in common with a column of the group, or become neighbours by earlier eliminations.
    border: NDArray[np.intp]


class _Node(NamedTuple):
    """Columns that are eliminated together, by their places in the order of elimination.

    Both fields are sets of places, as integers: bit k is set if place k belongs to the set.
    """

    columns: int
    border: int

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of columns of the node and of its border."""
        return self.columns.bit_count(), self.border.bit_count()

    def into(self, parent: _Node) -> _Node:
        """Return this node and its parent as one node, whose columns are eliminated together."""
        border = (self.border | parent.border) & ~parent.columns
        return _Node(self.columns | parent.columns, border)


def elimination_groups(pattern: NDArray[np.bool_], last: NDArray[np.intp]) -> list[ColumnGroup]:
    """Return groups of columns in the order of their elimination.

    Parameters
    ----------
    pattern
        Whether each element of the design matrix is not zero, shape (rows, columns).
    last
        Indices of the columns that are eliminated after all others, in this order. Those that are
        not neighbours may be in groups of their own.

    Returns
    -------
    list of ColumnGroup
        Every column is in one group. A group precedes those in which the columns of its border are.
    """
    columns = pattern.astype(np.float32)
    neighbours = (columns.T @ columns) > 0.0
    order = np.concatenate([_minimum_degree(neighbours, last), last]).astype(np.intp)
    nodes = _merge(_single_nodes(neighbours[np.ix_(order, order)]))
    groups = []
    for node in nodes:
        places = np.array(list(_members(node.columns)), dtype=np.intp)
        border = np.array(list(_members(node.border)), dtype=np.intp)
        groups.append(ColumnGroup(order[places], order[border]))
    return groups


def heights(groups: list[ColumnGroup]) -> list[int]:
    """Return the height of each group in the elimination tree: 0 for groups without children.

    A group is higher than every group in whose border it is, so that groups of one height can be
    eliminated at the same time. ``groups`` are in the order of elimination.
    """
    group_of = {}
    for k, group in enumerate(groups):
        for column in group.columns.tolist():
            group_of[column] = k
    result = [0] * len(groups)
    for k, group in enumerate(groups):
        if group.border.size:
            parent = group_of[int(group.border[0])]
            result[parent] = max(result[parent], result[k] + 1)
    return result


def _bit_sets(matrix: NDArray[np.bool_]) -> list[int]:
    """Return the columns at which each row of a matrix is true, as the bits of an integer.

    Sets of columns are integers because Python unites and counts the bits of long integers faster
    than NumPy does the elements of short arrays.
    """
    packed = np.packbits(matrix, axis=1, bitorder="little")
    return [int.from_bytes(row.tobytes(), "little") for row in packed]


def _members(bits: int) -> Iterator[int]:
    """Yield the places of the bits that are set in an integer, from the lowest on."""
    while bits:
        lowest = bits & -bits
        yield lowest.bit_length() - 1
        bits ^= lowest


def _minimum_degree(neighbours: NDArray[np.bool_], last: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return the columns that are not in ``last`` in an order that keeps neighbours few.

    The column with the fewest neighbours comes next; of several, the first one.
    ``neighbours`` (columns, columns) states which columns have a row in common.
    """
    others = neighbours.copy()
    np.fill_diagonal(others, False)
    linked = _bit_sets(others)
    degree = [bits.bit_count() for bits in linked]
    remaining = np.setdiff1d(np.arange(len(linked)), last).tolist()
    order = []
    while remaining:
        column = min(remaining, key=degree.__getitem__)
        remaining.remove(column)
        order.append(column)
        border = linked[column]
        for neighbour in _members(border):
            linked[neighbour] |= border
            linked[neighbour] &= ~(1 << neighbour | 1 << column)
            degree[neighbour] = linked[neighbour].bit_count()
    return np.array(order, dtype=np.intp)


def _single_nodes(neighbours: NDArray[np.bool_]) -> list[_Node]:
    """Return one node for each column, with its border.

    ``neighbours`` (columns, columns) states which columns have a row in common; rows and columns of
    this matrix are in the order of elimination. When a column is eliminated, all its neighbours
    become neighbours of each other. It is enough to add them to the border of the first of them,
    because that column adds them to the border of the next one in turn.
    """
    linked = _bit_sets(np.triu(neighbours, k=1))
    nodes = []
    for place, border in enumerate(linked):
        nodes.append(_Node(1 << place, border))
        if border:
            first = border & -border
            linked[first.bit_length() - 1] |= border ^ first
    return nodes


def _merge(single: list[_Node]) -> list[_Node]:
    """Return the nodes that remain when every node is merged into its parent where this is faster.

    The parent of a node contains the first column of its border. Nodes of equal shape are
    eliminated together and share the time of function calls. Merging is repeated until no node is
    merged any more.
    """
    nodes = dict(enumerate(single))
    node_of = list(range(len(single)))
    merged = True
    while merged:
        merged = False
        count = Counter(node.shape for node in nodes.values())
        # A parent has as many copies after a merge as before, because copies of the node are merged
        # into copies of the parent.
        copies = {k: count[node.shape] for k, node in nodes.items()}
        for k in sorted(nodes):
            node = nodes[k]
            if not node.border:
                continue
            above = node_of[next(_members(node.border))]
            parent = nodes[above]
            union = node.into(parent)
            apart = _cost(node.shape, copies[k]) + _cost(parent.shape, copies[above])
            if _cost(union.shape, copies[above]) > apart:
                continue
            for column in _members(node.columns):
                node_of[column] = above
            nodes[above] = union
            del nodes[k]
            merged = True
    return [nodes[k] for k in sorted(nodes)]


@lru_cache(maxsize=_KEPT_COSTS)
def _cost(shape: tuple[int, int], copies: int) -> float:
    """Return the time of eliminating a node, in units of one multiplication.

    ``shape`` are the numbers of columns of the node and of its border. As many nodes as ``copies``
    have this shape; they share the time of function calls and of subtracting their products from
    later columns.
    """
    columns = shape[0]
    border = shape[1]
    # Column k of s takes k products with each of the s + border + 1 − k entries from its diagonal
    # on; these are the sums of k and of k² over all columns.
    places = columns * (columns - 1) // 2
    squares = columns * (columns - 1) * (2 * columns - 1) // 6
    multiplications = places * (columns + border + 1) - squares
    products = border * (border + 3) / 2
    shared = (
        _GROUP_COST
        + _COLUMN_COST * columns
        + _PRODUCT_CALL_COST * -(-border // PRODUCT_COLUMNS)
        + _UPDATE_COST * products
    )
    return multiplications + products * columns + shared / copies
