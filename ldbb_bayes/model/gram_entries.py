"""Gram entries: scalar products of columns of the design matrix over rows with equal variance.

The precision matrix of coefficients is P = Aᵀ D⁻¹ A, with the design matrix A and the diagonal
noise covariance D. Only D depends on the hyper-parameters φ, the scales of noise and nuisances
(effects modelled but not of interest). Rows of A whose noise has the same variance are rows of one
kind. An entry of P is therefore

    P_ij = Σ_kinds G_ij,kind / D_kind,   G_ij,kind = Σ_rows of the kind A_row,i A_row,j,

and an entry of Aᵀ D⁻¹ r, with the readings r, has the same form. All entries together are the
product of a constant matrix G, shape (entries, kinds), and the reciprocal variances, shape (kinds,
w) for w values of φ. G is stored as a sparse matrix. Parts of G in which most entries are not zero
are stored as dense matrices instead; their products are computed with the library BLAS.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array, diags_array

from ldbb_bayes.results import Array

__all__ = ["EntryBlock", "GramEntries"]

# Gram entries (scalar products of columns of the design matrix) are computed in blocks. A block is
# stored as a dense matrix if at least this fraction of its entries is not zero. The reason is that,
# in measurements, each entry took a third as long in a dense product as in a sparse product.
_DENSE_SHARE = 0.35
# A block of Gram entries is stored as dense matrices, each for a few columns of every group, only
# if it has at least this number of nonzero entries for each of the matrices. With fewer entries, it
# is faster to multiply by one sparse matrix, because every multiplication by a dense matrix needs a
# function call of its own.
_FEWEST_DENSE = 500
# Number of columns of the precision matrix whose entries are computed together, by one product with
# a dense matrix. With fewer columns, more function calls would be needed. With more columns, more
# entries above the diagonal would be computed, although these entries are not needed.
_COLUMNS_AT_ONCE = 4


class EntryBlock(NamedTuple):
    """Block of stored entries of the matrix P = Aᵀ D⁻¹ A and of the vector Aᵀ D⁻¹ r.

    A is the design matrix, D the noise covariance, and r are the readings. A block holds the
    entries of several groups of columns of P. Each group consists of s columns, and n entries are
    stored for each column. The first s of these are the entries in the rows of the group itself.
    For all columns of the group, they form a square matrix with s rows, which lies on the diagonal
    of P; only its lower triangle is needed.
    """

    #: Slice that selects the entries of this block from the array of all stored entries.
    entries: slice
    #: Number of groups, number s of columns in a group, and number n of entries in a column.
    shape: tuple[int, int, int]


class _DenseGram(NamedTuple):
    """Gram entries for at most four columns of each group of a block, as a dense array.

    The array also holds the entries that are zero.
    """

    block: EntryBlock
    #: Index of the first column whose Gram entries are in ``products``, counted within its group.
    #: The products with columns of a smaller index lie above the diagonal; they are not needed and
    #: are left out.
    first: int
    #: Indices of the kinds of rows in which the columns of each group are not zero, shape (groups,
    #: k). If a group has fewer than k kinds, the last indices are 0 and their products are zero.
    kinds: NDArray[np.intp]
    #: Gram entries: scalar products of each column with itself, with later columns and with the
    #: readings, shape (groups, columns, products, k). The dimensions are the groups, at most four
    #: columns of each group, the products of a column, and the kinds of rows.
    products: Array

    def assemble(self, weight: Array, entries: Array) -> None:
        """Compute entries of P = Aᵀ D⁻¹ A and Aᵀ D⁻¹ r from the scalar products of columns of A.

        A is the design matrix, D the diagonal noise covariance, and r are the readings. Rows of A
        with the same variance are rows of one kind. ``weight``, shape (kinds, w), holds the
        reciprocal variance of each kind of row, for w values of the hyper-parameters. The results
        are written into the array ``entries``.
        """
        matrix = entries[self.block.entries].reshape(*self.block.shape, weight.shape[1])
        stop = self.first + self.products.shape[1]
        out = matrix[:, self.first : stop, self.first :]
        np.matmul(self.products, weight[self.kinds][:, None], out=out)


class GramEntries:
    """Scalar products of the columns of a design matrix with each other and with the readings.

    Parameters
    ----------
    blocks
        Blocks into which the list of all scalar products is divided. The products are called
        entries. After the last block, the list has one more entry, which is always zero.
    place
        Index, in the list of all scalar products, of the product of columns i and j, shape
        (columns, columns + 1). The last column is for products with the readings. The index is used
        only if column i is eliminated before column j, or if i = j.
    columns
        Design matrix A, shape (rows, columns).
    values
        Readings r, shape (rows,).
    kinds
        Index of the kind of each row, shape (rows,). Rows of one kind have noise of the same
        variance.
    """

    def __init__(
        self,
        blocks: list[EntryBlock],
        place: NDArray[np.intp],
        columns: Array,
        values: Array,
        kinds: NDArray[np.intp],
    ) -> None:
        """Compute the scalar products, separately over the rows of each kind."""
        size = 1 + sum(block.entries.stop - block.entries.start for block in blocks)
        gram = _sparse_gram(size, place, columns, values, kinds)
        self._dense: list[_DenseGram] = []
        is_sparse = np.ones(size)
        for block in blocks:
            dense = _dense_gram(block, gram)
            self._dense += dense
            if dense:
                is_sparse[block.entries] = 0.0
        self._sparse = (diags_array(is_sparse) @ gram).tocsr()
        self._sparse.eliminate_zeros()

    def assemble(self, weight: Array) -> Array:
        """Return all entries of P = Aᵀ D⁻¹ A and of Aᵀ D⁻¹ r, shape (entries, w).

        A is the design matrix, D the noise covariance, and r are the readings. ``weight``, shape
        (kinds, w), holds the reciprocal variance 1/D of every kind of rows (rows with the same
        variance), for w values of the hyper-parameters.
        """
        entries = np.asarray(self._sparse @ weight)
        for dense in self._dense:
            dense.assemble(weight, entries)
        return entries


def _sparse_gram(
    size: int,
    place: NDArray[np.intp],
    columns: Array,
    values: Array,
    kinds: NDArray[np.intp],
) -> csr_array:
    """Return all Gram entries of a design matrix and readings, shape (entries, kinds).

    Gram entries are scalar products of columns of the design matrix over rows of one kind (rows
    with the same variance). Each row contributes the products of all pairs of its nonzero elements.
    The readings are treated as a last column of the matrix. ``size`` is the number of entries;
    `GramEntries` explains ``place``, ``columns``, ``values`` and ``kinds``.
    """
    order = np.argsort(np.diagonal(place))
    table = np.column_stack([columns[:, order], values])
    place_in_order = place[np.ix_(order, np.append(order, len(order)))]
    row, column = np.nonzero(table)
    element = table[row, column]
    # ``table`` is the design matrix with the readings as last column. Its nonzero elements are
    # numbered row by row. Each element, unless it is a reading, is multiplied by itself and by all
    # later elements of its row. ``first`` and ``second`` hold the numbers of the first and of the
    # second factor of every product.
    end_of_row = np.cumsum(np.bincount(row, minlength=len(table)))
    number = np.arange(len(row))
    products = np.where(column < len(order), end_of_row[row] - number, 0)
    first = np.repeat(number, products)
    first_product = np.cumsum(products) - products
    second = first + np.arange(len(first)) - np.repeat(first_product, products)
    index = (place_in_order[column[first], column[second]], kinds[row[first]])
    shape = (size, kinds.max(initial=-1) + 1)
    # Products that belong to the same Gram entry, and to rows with the same variance, have the same
    # index. The conversion to the CSR format adds these products up.
    gram = coo_array((element[first] * element[second], index), shape=shape).tocsr()
    gram.eliminate_zeros()
    return gram


def _dense_gram(block: EntryBlock, gram: csr_array) -> list[_DenseGram]:
    """Return the Gram entries of one block as dense arrays, if dense arrays save time.

    Gram entries are scalar products of columns of the design matrix. A block holds the scalar
    products for several groups of columns. The result is a list of arrays: one for the first four
    columns of every group, one for the next four, and so on. The list is empty if the share of
    nonzero entries is small, or if their total number is small; a sparse matrix then saves more
    time. Rows of the design matrix with the same variance are of one kind. ``gram``, shape
    (entries, kinds), holds the Gram entries of all blocks: one column for each kind, with the
    scalar products over the rows of this kind alone.
    """
    groups = block.shape[0]
    columns = block.shape[1]
    length = block.shape[2]
    bounds = gram.indptr[block.entries.start : block.entries.stop + 1]
    products = gram.data[bounds[0] : bounds[-1]]
    kind = gram.indices[bounds[0] : bounds[-1]]
    entry = np.repeat(np.arange(len(bounds) - 1), np.diff(bounds))
    group = entry // (columns * length)
    has_kind = np.zeros((groups, gram.shape[1]), dtype=bool)
    has_kind[group, kind] = True
    most_kinds = int(has_kind.sum(axis=1).max())
    needed = groups * columns * (length - (columns - 1) / 2)
    calls = -(-columns // _COLUMNS_AT_ONCE)
    if len(products) < max(_DENSE_SHARE * needed * most_kinds, _FEWEST_DENSE * calls):
        return []
    # Rows of one kind have the same variance. The arrays ``group_kinds`` and ``rows`` have space
    # for ``most_kinds`` kinds of rows in each group of columns. If a group has fewer kinds, the
    # remaining elements are zero.
    group_kinds = np.zeros((groups, most_kinds), dtype=np.intp)
    rank = np.cumsum(has_kind, axis=1) - 1
    group_kinds[group, rank[group, kind]] = kind
    rows = np.zeros((groups * columns * length, most_kinds))
    rows[entry, rank[group, kind]] = products
    filled = rows.reshape(groups, columns, length, most_kinds)
    dense = []
    for first in range(0, columns, _COLUMNS_AT_ONCE):
        some_columns = filled[:, first : first + _COLUMNS_AT_ONCE, first:]
        dense.append(_DenseGram(block, first, group_kinds, some_columns.copy()))
    return dense
