"""Sparse Cholesky elimination for many values of the hyper-parameters φ at once.

The observation equations are r = A x + N(0, D(φ)). r are the readings, x the coefficients of
nuisances (effects modelled but not of interest), A (rows, columns) has one column for each
coefficient, D(φ) is the diagonal noise covariance, and the hyper-parameters φ are the scales of
noise and nuisances. The module computes the lower triangular factor L and the right-hand side
L⁻¹ Aᵀ D⁻¹ r of

    P = Aᵀ D⁻¹ A = L Lᵀ.

Rows with the same variance are of one kind, and there are few kinds. The scalar products of the
columns of A with each other and with r, summed over the rows of one kind, do not depend on φ; they
are called Gram entries. P and Aᵀ D⁻¹ r are the sums of the Gram entries of all kinds, each times
1/D of its kind. The last dimension of every array that depends on φ has the length w, the number of
values of φ, and is contiguous.

Prior variances may be negative (`Observations.signs`). Then P = L S Lᵀ, where the diagonal matrix S
holds the signs ±1 of the Cholesky pivots, and |L⁻¹ Aᵀ D⁻¹ r|² is a sum of squares with these signs.

Two columns have a row in common if both are non-zero in that row. The columns are divided into
groups of three types. Isolated groups have no row in common with other columns. Leaves have rows in
common with one further group only, the root. Leaves are eliminated before the root. The root is
chosen once, so that the fewest operations are needed.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from ldbb_bayes.model.triangular import eliminate
from ldbb_bayes.results import Array

__all__ = ["BLAS_MULTIPLE", "FEWEST_PHI", "DesignRows", "Elimination", "Front"]

# Largest number of values of the hyper-parameters for which matrices are factorised in one pass.
_MOST_PHI = 512
# Smallest number of values of the hyper-parameters for which matrices are factorised in one pass,
# even if the factors do not fit into the processor's cache.
FEWEST_PHI = 128
# Number of floating-point numbers that are assumed to fit into the processor's cache.
_CACHE_SIZE = 1 << 19
# Values of the hyper-parameters are processed in multiples of this number. The library of matrix
# products (BLAS) rounds such multiples identically, so that results do not depend on how many
# values are processed together.
BLAS_MULTIPLE = 8
# Time of the function calls that eliminate one column of a matrix, divided by the time of one
# multiplication.
_CALL_COST = 60.0
# Number of columns of a matrix P = Aᵀ D⁻¹ A that one matrix product computes. A smaller number
# wastes time in function calls; a larger one computes entries below the diagonal that are not
# needed.
_GRAM_COLUMNS = 4


class Front(NamedTuple):
    """Groups of columns of the design matrix A that are eliminated together.

    Each group has the same number s of columns. Two columns have a row in common if both are
    non-zero in that row; m columns that are eliminated later have rows in common with the groups.
    Rows of A with the same noise variance are of one kind.
    """

    #: Indices of the s columns of each group in the design matrix, shape (groups, s).
    columns: NDArray[np.intp]
    #: Indices of the kinds of rows in which each group's columns are not all zero, shape (groups,
    #: k). Rows of one kind have the same noise variance. A group with fewer than k kinds has the
    #: index 0 in the remaining places; the products in ``gram`` are zero there.
    kinds: NDArray[np.intp]
    #: Scalar products of the s columns of each group with each other, with the m columns eliminated
    #: later that have rows in common with the group, and with the readings. Each product is a sum
    #: over the rows of one of k kinds (rows with the same noise variance).
    #: Shape (groups, s, s + m + 1, k).
    gram: Array
    #: Signs ±1 of the Cholesky pivots of the s columns of each group, shape (groups, s); None if
    #: all are positive. A pivot is negative where a prior variance is negative
    #: (`Observations.signs`).
    signs: Array | None

    @property
    def entries(self) -> int:
        """Number of matrix entries of all groups that are computed for one value of φ.

        φ are the hyper-parameters. The entries are those of P = Aᵀ D⁻¹ A and Aᵀ D⁻¹ r, where A is
        the design matrix, D(φ) the diagonal noise covariance and r are the readings.
        """
        return int(np.prod(self.gram.shape[:3]))

    def assemble(
        self,
        weight: Array,
        shift: Array | None,
        out: Array | None = None,
    ) -> Array:
        """Return the parts of P = Aᵀ D⁻¹ A and of Aᵀ D⁻¹ r that belong to the groups' columns.

        A is the design matrix with one column for each coefficient, D the diagonal noise covariance
        and r the readings. The result is computed for w values of the hyper-parameters, on which D
        depends. Only the upper triangle of P is computed, in blocks.

        Parameters
        ----------
        weight
            Reciprocal variance 1/D of every kind of row (rows with the same variance), shape
            (kinds, w).
        shift
            Array to add to Aᵀ D⁻¹ r, shape (columns of A, w); None for zero.
        out
            Array to write the result into; by default a new array.

        Returns
        -------
        Array of shape (groups, s, s + m + 1, w), for groups of s columns that have rows in common
        with m columns eliminated later. The s + m + 1 entries are products with the s columns, with
        the m columns and, last, Aᵀ D⁻¹ r.
        """
        _, columns, entries, _ = self.gram.shape
        group_weight = weight[self.kinds][:, None]
        if out is None:
            out = np.zeros((*self.gram.shape[:3], weight.shape[1]))
        for j in range(0, columns, _GRAM_COLUMNS):
            block = (slice(None), slice(j, j + _GRAM_COLUMNS), slice(j, entries))
            np.matmul(self.gram[block], group_weight, out=out[block])
        if shift is not None:
            out[:, :, -1] += shift[self.columns]
        return out

    def factorize(
        self, matrix: Array, links: Array | None = None, link_signs: Array | None = None
    ) -> Array:
        """Factorise the groups' matrices in place, and return their contributions to ln p(r | φ).

        The Cholesky factor L, with P = Aᵀ D⁻¹ A = L Lᵀ, is computed for w values of the
        hyper-parameters φ. A is the design matrix, D the diagonal noise covariance and r are the
        readings. Each group has s columns of A, and m columns eliminated later have rows in common
        with it.

        Parameters
        ----------
        matrix
            Output of `assemble`, shape (groups, s, s + m + 1, w); overwritten by L and
            L⁻¹ Aᵀ D⁻¹ r.
        links, link_signs
            Parts of the factors of columns eliminated earlier, shape (earlier columns, s + m + 1,
            w), and the signs ±1 of the pivots of these columns, shape (earlier columns,), as
            `eliminate` takes them. ``links`` is None if no earlier column has a row in common with
            these groups, and ``link_signs`` is None if all signs are positive.

        Returns
        -------
        Contribution ½ |L⁻¹ Aᵀ D⁻¹ r|² − Σ ln L_jj of every group to the log density of the
        readings, ln p(r | φ), shape (groups, w).

        Raises
        ------
        LinAlgError
            If some coefficient is determined neither by readings nor by its prior.
        """
        eliminate(matrix, links, signs=self.signs, link_signs=link_signs)
        white_shift = matrix[:, :, -1]
        signed_shift = white_shift
        if self.signs is not None:
            signed_shift = self.signs[:, :, None] * white_shift
        diagonal = np.arange(matrix.shape[1])
        log_determinant = np.log(matrix[:, diagonal, diagonal]).sum(axis=1)
        gain = 0.5 * np.einsum("gsw,gsw->gw", signed_shift, white_shift) - log_determinant
        if not np.isfinite(gain).all():
            raise np.linalg.LinAlgError("readings and priors must determine every coefficient")
        return gain


class Elimination(NamedTuple):
    """Groups of columns of the design matrix, in the order of their elimination.

    Two columns have a row in common if both are non-zero in that row. Isolated groups have no row
    in common with other columns. Leaves have rows in common with one further group only, the root.
    The root is eliminated last.
    """

    isolated: list[Front]
    leaves: list[Front]
    root: Front

    @property
    def fronts(self) -> list[Front]:
        """All groups of columns, in the order in which `factorize` returns their factors.

        First come the isolated groups, which have no row in common with other columns, then the
        leaves, which have rows in common with the root only, and then the root.
        """
        return [*self.isolated, *self.leaves, self.root]

    @property
    def chunk_size(self) -> int:
        """Number of values of the hyper-parameters for which one pass computes the factors.

        It is the largest multiple of 8 for which the factors fit into the processor's cache, but at
        least 128 and at most 512.
        """
        entries = max(sum(front.entries for front in self.fronts), 1)
        fitting = _CACHE_SIZE // entries // BLAS_MULTIPLE * BLAS_MULTIPLE
        return max(FEWEST_PHI, min(_MOST_PHI, fitting))

    def factorize(
        self,
        weight: Array,
        shift: Array | None,
    ) -> tuple[list[Array], Array]:
        """Compute the Cholesky factor L of P = Aᵀ D⁻¹ A = L Lᵀ for w values of φ.

        A is the design matrix, D the diagonal noise covariance, r are the readings and φ the
        hyper-parameters, on which D depends. Isolated groups of columns and leaves are factorised
        first. The contribution of the leaves is then subtracted from the root's matrix, and the
        root is factorised last.

        Parameters
        ----------
        weight
            Reciprocal variance 1/D of every kind of row (rows with the same variance), shape
            (kinds, w).
        shift
            Array to add to Aᵀ D⁻¹ r, shape (columns of A, w); None for zero.

        Returns
        -------
        factors
            L and L⁻¹ Aᵀ D⁻¹ r of the groups of every `Front`, in the order of `fronts`. Each has
            the shape (groups, s, s + m + 1, w), for groups of s columns that have rows in common
            with m columns eliminated later.
        gain
            Contribution ½ |L⁻¹ Aᵀ D⁻¹ r|² − Σ ln L_jj of all columns to the log density of the
            readings, ln p(r | φ), shape (w,).
        """
        leaf_factors, links = self._assemble_leaves(weight, shift)
        factors = [front.assemble(weight, shift) for front in self.isolated]
        factors += leaf_factors
        gains = []
        for front, factor in zip((*self.isolated, *self.leaves), factors, strict=True):
            gains.append(front.factorize(factor).sum(axis=0))
        root_factor = self.root.assemble(weight, shift)
        root_gain = self.root.factorize(root_factor, links, self._link_signs())
        factors.append(root_factor)
        gains.append(root_gain[0])
        return factors, np.sum(gains, axis=0)

    def _assemble_leaves(self, weight: Array, shift: Array | None) -> tuple[list[Array], Array]:
        """Return the matrices of the leaves, and a view of the part of them that the root needs.

        Leaves are groups of columns that have rows in common with one further group only, the root.
        The matrices are those that `Front.assemble` returns; ``weight`` and ``shift`` are the
        arguments of `factorize`. The view holds the entries of these matrices for the columns of
        the root and the right-hand side, shape (columns of leaves, columns of the root + 1, w).
        When the leaves are factorised in place, it becomes the ``links`` with which the root is
        factorised.
        """
        widest = max((front.gram.shape[1] for front in self.leaves), default=0)
        leaf_columns = sum(front.columns.size for front in self.leaves)
        border = self.root.gram.shape[2]
        rows = np.empty((leaf_columns, widest + border, weight.shape[1]))
        assembled = []
        first = 0
        for front in self.leaves:
            groups, columns, entries, _ = front.gram.shape
            last = first + groups * columns
            front_rows = rows[first:last, widest - columns :]
            view = front_rows.reshape(groups, columns, entries, weight.shape[1])
            assembled.append(front.assemble(weight, shift, view))
            first = last
        return assembled, rows[:, widest:]

    def _link_signs(self) -> Array | None:
        """Return the signs ±1 of the Cholesky pivots of the leaves, shape (columns of leaves,).

        Return None if all pivots are positive.
        """
        if all(front.signs is None for front in self.leaves):
            return None
        signs = []
        for front in self.leaves:
            if front.signs is None:
                signs.append(np.ones(front.columns.size))
            else:
                signs.append(front.signs.ravel())
        return np.concatenate(signs)


class _Plan(NamedTuple):
    """Division of the columns of the design matrix into isolated groups, leaves and the root.

    Groups are arrays of column indices. Two columns have a row in common if both are non-zero in
    that row. Isolated groups have no row in common with other columns. Leaves have rows in common
    with the root only.
    """

    isolated: list[NDArray[np.intp]]
    leaves: list[NDArray[np.intp]]
    root: NDArray[np.intp]

    @property
    def cost(self) -> float:
        """Cost of eliminating all groups: number of multiplications for one value of φ.

        φ are the hyper-parameters. The time of function calls is included, converted to
        multiplications.
        """
        total = 0.0
        for groups in _group_by_size(self.isolated):
            total += _elimination_cost(groups, border=0)
        for groups in _group_by_size(self.leaves):
            total += _elimination_cost(groups, border=len(self.root))
        return total + _elimination_cost([self.root], border=0)


class DesignRows:
    """Observation equations r = A x + noise, and the elimination of their coefficients x.

    r are readings, and A is the design matrix with one column for each coefficient. Coefficients
    belong to nuisances, which are effects modelled but not of interest.

    Parameters
    ----------
    columns
        Design matrix A, shape (rows, columns).
    values
        Readings r, shape (rows,). Rows that depend on the parameters of interest hold zero, because
        the caller adds their part for each value of these parameters (``shift`` of
        `Elimination.factorize`).
    kinds
        Index of each row's kind (rows of one kind have the same variance), shape (rows,).
    signs
        Signs ±1 of the prior variances of the coefficients, shape (columns,). A negative variance
        removes noise (`Observations.signs`) and makes the Cholesky pivot of the column negative.
    shared
        Number of columns whose coefficients are the same in all tests; they are the first columns.
    private
        For every test, the indices of the columns whose coefficients belong to this test alone.
    """

    def __init__(
        self,
        columns: Array,
        values: Array,
        kinds: NDArray[np.intp],
        *,
        signs: Array,
        shared: int,
        private: list[NDArray[np.intp]],
    ) -> None:
        self._columns = columns
        self._values = values
        self._kinds = kinds
        self._signs = signs
        self._shared = shared
        self._private = private
        self._eliminations: dict[int | None, Elimination] = {}

    def front(
        self,
        groups: Sequence[NDArray[np.intp]],
        border: NDArray[np.intp] | None = None,
    ) -> Front:
        """Return the data needed to eliminate groups of columns of the design matrix together.

        All groups have the same number s of columns.

        Parameters
        ----------
        groups
            Indices of the columns of every group, each of shape (s,).
        border
            Indices of the m columns eliminated later that have rows in common with these groups,
            shape (m,); None if there are none.
        """
        grams = []
        group_kinds = []
        for columns in groups:
            index = np.flatnonzero((self._columns[:, columns] != 0.0).any(axis=1))
            index = index[np.argsort(self._kinds[index], kind="stable")]
            kinds, starts = np.unique(self._kinds[index], return_index=True)
            bordered = columns if border is None else np.concatenate([columns, border])
            entries = self._columns[np.ix_(index, bordered)]
            rows = np.column_stack([entries, self._values[index]])
            blocks = np.split(rows, starts[1:])
            size = len(columns)
            grams.append(np.stack([block[:, :size].T @ block for block in blocks]))
            group_kinds.append(kinds)
        # Rows of one kind have the same variance. Groups of columns that have fewer kinds of rows
        # than others get additional scalar products of zero.
        most_kinds = max(len(kinds) for kinds in group_kinds)
        gram = np.zeros((len(groups), *grams[0].shape[1:], most_kinds))
        padded_kinds = np.zeros((len(groups), most_kinds), dtype=np.intp)
        for group, kinds in enumerate(group_kinds):
            gram[group, ..., : len(kinds)] = np.moveaxis(grams[group], 0, -1)
            padded_kinds[group, : len(kinds)] = kinds
        group_columns = np.array(groups, dtype=np.intp)
        signs = self._signs[group_columns]
        if (signs < 0.0).any():
            return Front(group_columns, padded_kinds, gram, signs)
        return Front(group_columns, padded_kinds, gram, None)

    def elimination(self, last: int | None) -> Elimination:
        """Return the order of eliminating the columns that needs the fewest operations.

        Parameters
        ----------
        last
            Number of shared columns, counted from the end, that must be eliminated last. None if
            all shared columns must keep their order and follow the columns of single tests. The
            coefficients of shared columns are the same in all tests.
        """
        if last not in self._eliminations:
            plans = [self._private_first]
            if last is not None:
                plans += self._plans_by_row_count(last)
            costs = [plan.cost for plan in plans]
            cheapest = plans[int(np.argmin(costs))]
            self._eliminations[last] = self._build(cheapest)
        return self._eliminations[last]

    def _build(self, plan: _Plan) -> Elimination:
        isolated = [self.front(groups) for groups in _group_by_size(plan.isolated)]
        leaves = [self.front(groups, plan.root) for groups in _group_by_size(plan.leaves)]
        return Elimination(isolated, leaves, self.front([plan.root]))

    def _connected_groups(
        self,
        columns: NDArray[np.intp],
    ) -> list[NDArray[np.intp]]:
        """Return columns of the design matrix in groups that have no row in common.

        Columns that are non-zero in the same row are in one group. ``columns`` are the indices of
        the columns to divide; each group is an array of such indices.
        """
        nonzero = (self._columns[:, columns] != 0.0).astype(float)
        count, label = connected_components(nonzero.T @ nonzero > 0.0, directed=False)
        return [columns[label == k] for k in range(count)]

    @cached_property
    def _private_first(self) -> _Plan:
        """Order of elimination in which the columns of single tests precede the shared columns.

        The coefficients of shared columns are the same in all tests. Shared columns that have no
        row in common with columns of single tests form isolated groups.
        """
        isolated = []
        root = [np.zeros(0, dtype=np.intp)]
        for group in self._connected_groups(np.arange(self._columns.shape[1])):
            if group[-1] < self._shared:
                isolated.append(group)
            else:
                root.append(group[group < self._shared])
        return _Plan(isolated, self._private, np.sort(np.concatenate(root)))

    def _plans_by_row_count(self, last: int) -> list[_Plan]:
        """Return plans that first eliminate the shared columns with few non-zero elements.

        The coefficients of shared columns are the same in all tests. The other columns form the
        root, which is eliminated last: shared columns with more non-zero elements than a limit, the
        final ``last`` shared columns, and the columns of single tests. There is one plan for every
        limit that gives a different division.
        """
        nonzero = self._columns != 0.0
        first = self._shared - last
        row_count = nonzero[:, : self._shared].sum(axis=0)
        row_count[first:] = len(nonzero) + 1
        plans = []
        for limit in np.unique(row_count[:first]):
            many_rows = np.flatnonzero(row_count > limit)
            root = np.concatenate([*self._private, many_rows]).astype(np.intp)
            root_rows = nonzero[nonzero[:, root].any(axis=1)]
            isolated = []
            leaves = []
            for group in self._connected_groups(np.flatnonzero(row_count <= limit)):
                if root_rows[:, group].any():
                    leaves.append(group)
                else:
                    isolated.append(group)
            plans.append(_Plan(isolated, leaves, root))
        return plans


def _group_by_size(groups: list[NDArray[np.intp]]) -> list[list[NDArray[np.intp]]]:
    """Return groups of column indices as lists of groups with equal numbers of columns.

    The list of the smallest groups is first.
    """
    by_size: dict[int, list[NDArray[np.intp]]] = {}
    for group in groups:
        by_size.setdefault(len(group), []).append(group)
    return [by_size[size] for size in sorted(by_size)]


def _elimination_cost(
    groups: list[NDArray[np.intp]],
    *,
    border: int,
) -> float:
    """Return the number of multiplications that the elimination of groups of equal size needs.

    The time of function calls is included, converted to multiplications. ``groups`` are arrays of
    column indices, all of the same length. ``border`` is the number of columns that are eliminated
    later and have rows in common with a group.
    """
    columns = len(groups[0])
    remaining = columns + border + 1 - np.arange(columns)
    multiplications = len(groups) * remaining * (remaining + 1) / 2
    return float((_CALL_COST + multiplications).sum())
