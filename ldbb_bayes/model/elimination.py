"""Cholesky elimination of grouped columns, for many values of φ at once."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.model.triangular import eliminate
from ldbb_bayes.results import Array

# The most and the fewest φ of one pass; numbers that the cache holds; what BLAS rounds alike the
# multiples of: results do not depend on the stack.
_MOST = 512


FEWEST_PHI = 128


_CACHED = 1 << 19


BLAS_MULTIPLE = 8


# Multiplications in the time that a column takes besides; columns whose Gram entries are computed
# together.
_OVERHEAD = 60.0


_TOGETHER = 4


class Front(NamedTuple):
    """g groups of s columns (g, s) that meet k kinds of rows (g, k), and for each kind their Gram
    entries, (g, s, s + m + 1, k), with one another, with the m columns that border them and with
    the values."""

    columns: NDArray[np.intp]
    kinds: NDArray[np.intp]
    gram: Array
    sign: Array | None  # of the pivots (g, s), where not all are positive

    def eliminated(
        self, factor: Array, links: Array | None = None, linked: Array | None = None
    ) -> Array:
        """L of its entries in place, and ½ |L⁻¹ Aᵀ D⁻¹ r|² − Σ ln L_jj of every group, shape (g,
        w)."""
        eliminate(factor, links, signs=self.sign, link_signs=linked)
        white = factor[:, :, -1]
        span = np.arange(factor.shape[1])
        left = white if self.sign is None else self.sign[:, :, None] * white
        found = 0.5 * np.einsum("gsw,gsw->gw", left, white) - np.log(factor[:, span, span]).sum(
            axis=1
        )
        if not np.isfinite(found).all():
            raise np.linalg.LinAlgError("readings and priors must determine every coefficient")
        return found

    def entries(self, weight: Array, shift: Array | None, out: Array | None = None) -> Array:
        """P and Aᵀ D⁻¹ r + ``shift`` (columns, w) from the diagonal on, (g, s, s + m + 1, w), at
        weights 1/D (kinds, w)."""
        own = weight[self.kinds][:, None]
        out = np.zeros((*self.gram.shape[:3], weight.shape[1])) if out is None else out
        for j in range(0, self.gram.shape[1], _TOGETHER):
            np.matmul(self.gram[:, j : j + _TOGETHER, j:], own, out=out[:, j : j + _TOGETHER, j:])
        if shift is not None:
            out[:, :, -1] += shift[self.columns]
        return out


class Elimination(NamedTuple):
    """Fronts of columns that meet no others, leaves, which the root borders, and the root."""

    alone: list[Front]
    leaves: list[Front]
    root: Front

    @property
    def linked(self) -> Array | None:
        """Signs of the leaves' pivots, where not all are positive."""
        signs = [
            np.ones(front.columns.shape) if front.sign is None else front.sign
            for front in self.leaves
        ]
        return (
            None
            if all(front.sign is None for front in self.leaves)
            else np.concatenate([own.ravel() for own in signs])
        )

    @property
    def most(self) -> int:
        """How many φ to take at a time."""
        entries = sum(
            int(np.prod(front.gram.shape[:3])) for front in (*self.alone, *self.leaves, self.root)
        )
        return max(
            FEWEST_PHI, min(_MOST, _CACHED // max(entries, 1) // BLAS_MULTIPLE * BLAS_MULTIPLE)
        )

    def factor(self, weight: Array, shift: Array | None) -> tuple[list[Array], Array]:
        """L and L⁻¹ Aᵀ D⁻¹ r of every front, (g, s, s + m + 1, w), and ½ |L⁻¹ Aᵀ D⁻¹ r|² − Σ ln
        L_jj, shape (w,)."""
        factors = [front.entries(weight, shift) for front in self.alone]
        # Leaves lie in one array, aligned at their border.
        most = max((front.gram.shape[1] for front in self.leaves), default=0)
        begun = 0
        links = np.empty(
            (
                sum(front.columns.size for front in self.leaves),
                most + self.root.gram.shape[2],
                weight.shape[1],
            )
        )
        for front in self.leaves:
            g, s, n, _ = front.gram.shape
            own = links[begun : begun + g * s, most - s :].reshape(g, s, n, weight.shape[1])
            factors.append(front.entries(weight, shift, own))
            begun += g * s
        gained = [
            front.eliminated(own).sum(axis=0)
            for front, own in zip((*self.alone, *self.leaves), factors, strict=True)
        ]
        factors.append(self.root.entries(weight, shift))
        gained.append(self.root.eliminated(factors[-1], links[:, most:], self.linked)[0])
        return factors, np.sum(gained, axis=0)


class EliminationPlan(NamedTuple):
    """Columns of the groups that meet no others, of the leaves, and of the root."""

    alone: list[NDArray[np.intp]]
    leaves: list[NDArray[np.intp]]
    root: NDArray[np.intp]

    @property
    def fronts(self) -> tuple[list[list[NDArray[np.intp]]], list[list[NDArray[np.intp]]]]:
        """Groups alone and leaves, those of one size together."""
        alone, leaves = (
            [[own for own in part if len(own) == s] for s in sorted({*map(len, part)})]
            for part in self[:2]
        )
        return alone, leaves

    @property
    def cost(self) -> float:
        """Multiplications for each φ."""
        alone, leaves = self.fronts
        total = 0.0
        m = len(self.root)
        for groups, border in [
            *((part, 0) for part in alone),
            *((part, m) for part in leaves),
            ([self.root], 0),
        ]:
            n = len(groups[0]) + border + 1 - np.arange(len(groups[0]))
            total += float((_OVERHEAD + len(groups) * n * (n + 1) / 2).sum())
        return total
