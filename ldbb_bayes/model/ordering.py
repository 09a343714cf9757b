"""Order of elimination: which columns of a sparse least-squares problem are eliminated together.

The observation equations r = A x + noise have one column of A for each coefficient x. Two columns
are neighbours if there is a row in which neither of them is zero. When a column is eliminated, all
its neighbours become neighbours of each other. The computing time is proportional to the square of
the number of neighbours. The order is therefore chosen as follows:

1. The column with the fewest neighbours is always eliminated next (minimum degree). The only
   exceptions are columns whose Cholesky factor is wanted: they are eliminated last, in their order
   in A.
2. The neighbours that a column has when it is eliminated are called its border. The neighbour that
   is eliminated first is the parent of the column. All columns and their parents form a forest (the
   elimination tree).
3. Eliminating one column alone takes a fixed time for function calls. A column is merged into its
   parent if this saves more time for function calls than it adds for multiplications. The results
   are groups of columns (supernodes) that are eliminated together.

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

# Number of later columns that one function call updates. When a group of columns of a sparse matrix
# is eliminated, several later columns change; they are updated in blocks of this size.
PRODUCT_COLUMNS = 8
# Fixed part of the time to eliminate a group of columns from a sparse matrix. It is spent on
# function calls and is the same for any number of columns in the group. All times in this module
# were measured. Their unit is the time of one multiplication for all values of the hyper-parameters
# that are processed together. The exact values matter little.
_GROUP_COST = 100.0
# When a group of columns is eliminated from a sparse matrix, part of the time for function calls is
# proportional to the number of columns in the group. This is that time for one column, in units of
# the time of one multiplication.
_COLUMN_COST = 200.0
# When a group of columns of a sparse matrix is eliminated, the later columns are updated in blocks
# of `PRODUCT_COLUMNS` columns. This is the time that calling the functions takes for one block,
# without the arithmetic, in units of the time of one multiplication.
_PRODUCT_CALL_COST = 250.0
# Time to subtract one product from one entry of the precision matrix P = Aᵀ D⁻¹ A (A is the design
# matrix, D the noise covariance), in units of the time of one multiplication.
_UPDATE_COST = 1.0
# Largest number of entries in the cache of the function ``_cost``, which returns the time to
# eliminate a group of columns. The cache saves time because many groups have the same numbers of
# columns.
_KEPT_COSTS = 4096


class ColumnGroup(NamedTuple):
    """Columns of the design matrix that are eliminated together.

    ``columns`` holds the indices of these columns, and ``border`` the indices of the later columns
    that change when the group is eliminated. The indices refer to the design matrix and are in the
    order of elimination.
    """

    #: Indices of the s columns of the design matrix that are eliminated together, as one group,
    #: shape (s,).
    columns: NDArray[np.intp]
    #: Indices of the m columns of the design matrix that change when a group of columns is
    #: eliminated, shape (m,). They are those neighbours of the group that are eliminated later. A
    #: column is a neighbour if, in some row, both this column and a column of the group are
    #: nonzero. Further columns become neighbours when earlier columns are eliminated.
    border: NDArray[np.intp]


class _Node(NamedTuple):
    """Columns that are eliminated together, and the later columns that their elimination changes.

    ``columns`` is the set of the columns that are eliminated, and ``border`` the set of the later
    columns. Each set is stored as an integer whose bit k is set if the column at place k in the
    order of elimination belongs to the set.
    """

    columns: int
    border: int

    @property
    def shape(self) -> tuple[int, int]:
        """Number of columns of the node, and number of later columns that they change.

        The columns of the node are eliminated together from a sparse matrix. This changes columns
        that are eliminated later.
        """
        return self.columns.bit_count(), self.border.bit_count()

    def merged_into(self, parent: _Node) -> _Node:
        """Return the node that results when this node is merged with its ``parent``.

        A node is a set of columns of a sparse matrix that are eliminated together. The parent of a
        node is the node of the first later column that changes when the node is eliminated.
        """
        border = (self.border | parent.border) & ~parent.columns
        return _Node(self.columns | parent.columns, border)


def elimination_groups(pattern: NDArray[np.bool_], last: NDArray[np.intp]) -> list[ColumnGroup]:
    """Return groups of columns of the design matrix in the order of their elimination.

    Parameters
    ----------
    pattern
        Whether each element of the design matrix is not zero, shape (rows, columns).
    last
        Indices of the columns that are eliminated after all other columns, in the order of their
        elimination. They may be in different groups.

    Returns
    -------
    list of ColumnGroup
        Every column is in one group. Each group comes before all groups whose columns change when
        it is eliminated.
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
    """Return the height of each column group; groups of equal height can be eliminated together.

    ``groups`` are in the order of elimination. Eliminating a group changes columns of later groups.
    The height of a group is 0 if no other group changes one of its columns. Otherwise the height is
    larger than the heights of all groups that change one of its columns. Groups of equal height
    therefore do not depend on each other.
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
    """Return one integer for each row of a matrix: bit k is set if the row is true in column k.

    Each integer stands for a set of columns. Python's operations on the bits of long integers are
    faster than NumPy's operations on short arrays.
    """
    packed = np.packbits(matrix, axis=1, bitorder="little")
    return [int.from_bytes(row.tobytes(), "little") for row in packed]


def _members(bits: int) -> Iterator[int]:
    """Yield the positions of the bits that are set in an integer, the lowest first."""
    while bits:
        lowest = bits & -bits
        yield lowest.bit_length() - 1
        bits ^= lowest


def _minimum_degree(neighbours: NDArray[np.bool_], last: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return all columns except those in ``last``, in an order of elimination that saves time.

    ``neighbours``, shape (columns, columns), states for all pairs of columns whether they are
    neighbours, that is, whether there is a row in which neither column is zero. The next column is
    always the column with the fewest neighbours that are not yet eliminated. If there are several
    such columns, the first of them is taken.
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
    """Return one node (set of columns that are eliminated together) for each column.

    ``neighbours``, shape (columns, columns), is true for neighbours: two columns that are both
    nonzero in the same row. Its rows and columns are in the order of elimination. The border
    of a column is the set of its neighbours that are eliminated later. When a column is eliminated,
    the columns of its border become neighbours of each other. To save time, the function makes them
    neighbours of the first column of the border only. When this first column is eliminated, its
    neighbours are passed on to the next column in the same way, and so on.
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
    """Merge nodes into their parents where this saves time, and return the nodes that remain.

    A node is a set of columns that are eliminated together; ``single`` holds one node for each
    column. The border of a node is the set of later columns that change when the node is
    eliminated. The parent of a node is the node that contains the first column of its border. Nodes
    with equal numbers of columns, and equal numbers of columns in their borders, are eliminated by
    the same function calls. The time of these calls is therefore counted only once. The nodes are
    examined repeatedly until no further node is merged.
    """
    nodes = dict(enumerate(single))
    node_of = list(range(len(single)))
    merged = True
    while merged:
        merged = False
        count = Counter(node.shape for node in nodes.values())
        # ``copies`` holds the number of copies of each node, including the node itself. A node is a
        # set of columns of a matrix that are eliminated together. Its parent is the node that
        # contains the first later column changed by this elimination. Two nodes are copies of each
        # other if they have equal numbers of columns and change equal numbers of later columns.
        # When a node is merged into its parent, each of its copies is assumed to be merged into a
        # copy of the parent. The merged node then has as many copies as the parent had.
        copies = {k: count[node.shape] for k, node in nodes.items()}
        for k in sorted(nodes):
            node = nodes[k]
            if not node.border:
                continue
            parent_index = node_of[next(_members(node.border))]
            parent = nodes[parent_index]
            union = node.merged_into(parent)
            cost_of_two = _cost(node.shape, copies[k]) + _cost(parent.shape, copies[parent_index])
            if _cost(union.shape, copies[parent_index]) > cost_of_two:
                continue
            for column in _members(node.columns):
                node_of[column] = parent_index
            nodes[parent_index] = union
            del nodes[k]
            merged = True
    return [nodes[k] for k in sorted(nodes)]


@lru_cache(maxsize=_KEPT_COSTS)
def _cost(shape: tuple[int, int], copies: int) -> float:
    """Return the time to eliminate a set of columns, in units of the time of one multiplication.

    The columns belong to a sparse matrix. ``shape`` holds the number of columns of the set, and the
    number of later columns that they change. ``copies`` is the number of sets with this shape,
    which are eliminated by the same function calls. The multiplications are done for each set. The
    function calls are made only once for all copies, and the later columns are updated only once.
    The time of the calls and of the updates is therefore divided by ``copies``.
    """
    columns = shape[0]
    border = shape[1]
    # A set of s columns, numbered k = 0 … s − 1, is eliminated, which changes ``border`` later
    # columns. Column k has s + border + 1 − k entries on and below the diagonal, and each of them
    # needs k multiplications. The number of multiplications is computed from ``places``, the sum of
    # all k, and ``squares``, the sum of all k².
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
