"""Cholesky elimination of columns with few rows in common, for many values of φ at once.

Of observation equations r = A x + N(0, D(φ)) it computes

    P = Aᵀ D⁻¹ A = L Lᵀ   and   L⁻¹ Aᵀ D⁻¹ r.

Rows are of few kinds, those of one kind having one variance, so that P and Aᵀ D⁻¹ r are sums of
known matrices, one for each kind, times 1/D. Arrays have their w values of φ last and contiguous:
factors are computed entry by entry, for all φ at once.

Columns fall into isolated groups, which have no row in common with other columns; leaves, groups
that have rows in common with the root alone; and the root. Leaves are eliminated first, then the
root. Which columns make the root is worked out once: those that leave the fewest operations.
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

# The most and the fewest φ of one pass.
_MOST_PHI = 512
FEWEST_PHI = 128
# Numbers that the processor's cache holds.
_CACHE_SIZE = 1 << 19
# BLAS rounds stacks of a multiple of eight alike: results do not depend on the size of a stack.
BLAS_MULTIPLE = 8
# Multiplications that take as long as the calls for one column.
_CALL_COST = 60.0
# Columns whose Gram entries are computed in one product.
_GRAM_COLUMNS = 4


class Front(NamedTuple):
    """Groups of as many columns each, which are eliminated together."""

    #: Numbers of the columns, shape (groups, s).
    columns: NDArray[np.intp]
    #: Kinds of the rows in which a group is not zero, shape (groups, k).
    kinds: NDArray[np.intp]
    #: Gram entries of every kind, with the s columns themselves, with the m columns of the border
    #: and with the values, shape (groups, s, s + m + 1, k).
    gram: Array
    #: Signs of the pivots, shape (groups, s); None where all are positive.
    signs: Array | None

    @property
    def entries(self) -> int:
        """Number of entries for each φ."""
        return int(np.prod(self.gram.shape[:3]))

    def assemble(
        self,
        weight: Array,
        shift: Array | None,
        out: Array | None = None,
    ) -> Array:
        """Return P and Aᵀ D⁻¹ r, from the diagonal on, shape (groups, s, s + m + 1, w).

        Parameters
        ----------
        weight
            1/D of every kind, shape (kinds, w).
        shift
            What is added to Aᵀ D⁻¹ r, shape (columns, w).
        out
            Array that takes the result.
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
        """Factorise assembled entries in place, and return what they add to ln p(z | φ).

        Parameters
        ----------
        matrix
            What `assemble` returns; on return L and L⁻¹ Aᵀ D⁻¹ r.
        links, link_signs
            Columns eliminated earlier; see `eliminate`.

        Returns
        -------
        ½ |L⁻¹ Aᵀ D⁻¹ r|² − Σ ln L_jj of every group, shape (groups, w).
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
    """Fronts in the order of their elimination."""

    isolated: list[Front]
    leaves: list[Front]
    root: Front

    @property
    def fronts(self) -> list[Front]:
        """All fronts, in the order of `factorize`."""
        return [*self.isolated, *self.leaves, self.root]

    @property
    def chunk_size(self) -> int:
        """How many φ to take at a time, so that the factors stay in the processor's cache."""
        entries = max(sum(front.entries for front in self.fronts), 1)
        fitting = _CACHE_SIZE // entries // BLAS_MULTIPLE * BLAS_MULTIPLE
        return max(FEWEST_PHI, min(_MOST_PHI, fitting))

    def factorize(
        self,
        weight: Array,
        shift: Array | None,
    ) -> tuple[list[Array], Array]:
        """Factorise P at weights 1/D (kinds, w), with ``shift`` (columns, w) added to Aᵀ D⁻¹ r.

        Returns
        -------
        factors
            L and L⁻¹ Aᵀ D⁻¹ r of every front, (groups, s, s + m + 1, w).
        gain
            ½ |L⁻¹ Aᵀ D⁻¹ r|² − Σ ln L_jj, shape (w,).
        """
        factors = [front.assemble(weight, shift) for front in self.isolated]
        # Leaves lie in one array, aligned at their border.
        widest = max((front.gram.shape[1] for front in self.leaves), default=0)
        leaf_columns = sum(front.columns.size for front in self.leaves)
        border = self.root.gram.shape[2]
        links = np.empty((leaf_columns, widest + border, weight.shape[1]))
        first = 0
        for front in self.leaves:
            groups, columns, entries, _ = front.gram.shape
            last = first + groups * columns
            space = links[first:last, widest - columns :]
            factor = space.reshape(groups, columns, entries, weight.shape[1])
            factors.append(front.assemble(weight, shift, factor))
            first = last
        gains = []
        for front, factor in zip((*self.isolated, *self.leaves), factors, strict=True):
            gains.append(front.factorize(factor).sum(axis=0))
        root_factor = self.root.assemble(weight, shift)
        root_gain = self.root.factorize(root_factor, links[:, widest:], self._link_signs())
        factors.append(root_factor)
        gains.append(root_gain[0])
        return factors, np.sum(gains, axis=0)

    def _link_signs(self) -> Array | None:
        """Return the signs of the leaves' pivots; None where all are positive."""
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
    """Columns of the isolated groups, of the leaves, and of the root."""

    isolated: list[NDArray[np.intp]]
    leaves: list[NDArray[np.intp]]
    root: NDArray[np.intp]

    @property
    def cost(self) -> float:
        """Multiplications for each φ."""
        total = 0.0
        for groups in _group_by_size(self.isolated):
            total += _elimination_cost(groups, border=0)
        for groups in _group_by_size(self.leaves):
            total += _elimination_cost(groups, border=len(self.root))
        return total + _elimination_cost([self.root], border=0)


class DesignRows:
    """Rows of A, of few kinds, and the elimination of their columns.

    Parameters
    ----------
    columns
        A, shape (rows, columns).
    values
        r as far as it does not depend on β, shape (rows,).
    kinds
        Number of each row's kind, shape (rows,).
    signs
        Signs of the columns' pivots, ±1, shape (columns,).
    shared
        Number of columns that tests share; they come first.
    private
        Columns of every test alone.
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
        """Return the front of groups of as many columns each, and of the columns of their border.

        Parameters
        ----------
        groups
            Columns of every group, each of shape (s,).
        border
            Columns eliminated later that have rows in common with them, shape (m,).
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
        # Groups of fewer kinds are padded with Gram entries of zero.
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
        """Return the elimination with the fewest operations.

        Parameters
        ----------
        last
            How many of the shared columns must come at the end; None keeps all shared columns in
            the order given, after the private ones.
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
        """Return the groups that columns fall into where those with a row in common are joined."""
        nonzero = (self._columns[:, columns] != 0.0).astype(float)
        count, label = connected_components(nonzero.T @ nonzero > 0.0, directed=False)
        return [columns[label == k] for k in range(count)]

    @cached_property
    def _private_first(self) -> _Plan:
        """Private columns first, test by test, then the shared ones in the order given."""
        isolated = []
        root = [np.zeros(0, dtype=np.intp)]
        for group in self._connected_groups(np.arange(self._columns.shape[1])):
            if group[-1] < self._shared:
                isolated.append(group)
            else:
                root.append(group[group < self._shared])
        return _Plan(isolated, self._private, np.sort(np.concatenate(root)))

    def _plans_by_row_count(self, last: int) -> list[_Plan]:
        """Return plans whose root is the private columns, the last ones, and those of many rows.

        Every number of rows is tried as the limit.
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
    """Return groups by their number of columns, the smallest first."""
    by_size: dict[int, list[NDArray[np.intp]]] = {}
    for group in groups:
        by_size.setdefault(len(group), []).append(group)
    return [by_size[size] for size in sorted(by_size)]


def _elimination_cost(
    groups: list[NDArray[np.intp]],
    *,
    border: int,
) -> float:
    """Return the multiplications for groups of as many columns each and their border."""
    columns = len(groups[0])
    remaining = columns + border + 1 - np.arange(columns)
    multiplications = len(groups) * remaining * (remaining + 1) / 2
    return float((_CALL_COST + multiplications).sum())
