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
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["PRODUCT_COLUMNS", "ColumnGroup", "elimination_groups", "heights"]

# Number of columns of a border whose products with the border one call computes.
PRODUCT_COLUMNS = 8
# All costs are times divided by the time of one multiplication for all hyper-parameters that are
# processed together (measured; results depend little on them).
# Function calls that a group needs once.
_GROUP_COST = 100.0
# Function calls that eliminate one column of a group.
_COLUMN_COST = 200.0
# Function calls for the products of `PRODUCT_COLUMNS` columns of a border.
_PRODUCT_CALL_COST = 250.0
# Subtraction of one product of two columns of a border from the entries of later columns.
_UPDATE_COST = 1.0


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
    """Columns that are eliminated together, by their places in the order of elimination."""

    columns: frozenset[int]
    border: frozenset[int]

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of columns of the node and of its border."""
        return len(self.columns), len(self.border)

    def into(self, parent: _Node) -> _Node:
        """Return the node that this one and its parent are when they are eliminated together."""
        border = (self.border | parent.border) - parent.columns
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
        places = np.array(sorted(node.columns), dtype=np.intp)
        border = np.array(sorted(node.border), dtype=np.intp)
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


def _minimum_degree(neighbours: NDArray[np.bool_], last: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return the columns that are not in ``last`` in an order that keeps neighbours few.

    The column with the fewest neighbours comes next; of several, the first one.
    ``neighbours`` (columns, columns) states which columns have a row in common.
    """
    linked = neighbours.copy()
    np.fill_diagonal(linked, False)
    size = len(linked)
    degree = linked.sum(axis=1)
    degree[last] = size
    remaining = size - len(last)
    is_last = np.zeros(size, dtype=bool)
    is_last[last] = True
    order = np.zeros(remaining, dtype=np.intp)
    for k in range(remaining):
        column = int(np.argmin(degree))
        order[k] = column
        border = np.flatnonzero(linked[column])
        linked[np.ix_(border, border)] = True
        linked[border, border] = False
        linked[border, column] = False
        free = border[~is_last[border]]
        degree[free] = linked[free].sum(axis=1)
        degree[column] = size + 1
    return order


def _single_nodes(neighbours: NDArray[np.bool_]) -> list[_Node]:
    """Return one node for each column, with its border.

    ``neighbours`` (columns, columns) states which columns have a row in common; rows and columns of
    this matrix are in the order of elimination.
    """
    linked = neighbours.copy()
    nodes = []
    for place in range(len(linked)):
        border = place + 1 + np.flatnonzero(linked[place, place + 1 :])
        linked[np.ix_(border, border)] = True
        nodes.append(_Node(frozenset([place]), frozenset(border.tolist())))
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
            above = node_of[min(node.border)]
            parent = nodes[above]
            union = node.into(parent)
            apart = _cost(node.shape, copies[k]) + _cost(parent.shape, copies[above])
            if _cost(union.shape, copies[above]) > apart:
                continue
            for column in node.columns:
                node_of[column] = above
            nodes[above] = union
            del nodes[k]
            merged = True
    return [nodes[k] for k in sorted(nodes)]


def _cost(shape: tuple[int, int], copies: int) -> float:
    """Return the time of eliminating a node, in units of one multiplication.

    ``shape`` are the numbers of columns of the node and of its border. As many nodes as ``copies``
    have this shape; they share the time of function calls and of subtracting their products from
    later columns.
    """
    columns = shape[0]
    border = shape[1]
    place = np.arange(columns)
    multiplications = (place * (columns + border + 1 - place)).sum()
    products = border * (border + 3) / 2
    shared = (
        _GROUP_COST
        + _COLUMN_COST * columns
        + _PRODUCT_CALL_COST * np.ceil(border / PRODUCT_COLUMNS)
        + _UPDATE_COST * products
    )
    return float(multiplications + products * columns + shared / copies)
