"""TODO: say what this module is."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ldbb_bayes.analysis.design.criteria import Criterion
from ldbb_bayes.results import Array, Shown

__all__ = ["Objective"]


_NOTHING = 1e-6


_CHUNK = 1 << 22


@dataclass(frozen=True, eq=False)
class Objective(Shown):
    """Φ of designs, averaged over K values of the hyper-parameters; a design is its numbers of
    tests, counts (candidates,)."""

    #: G (K, candidates, m, p), in sd of the noise: one test of a candidate adds GᵀG to the
    #: precision
    rows: Array
    #: P (K, p, p): the precision matrix before these tests, of prior and tests already run; zeros
    #: where flat
    prior: Array
    #: s: the last s of the p parameters are of interest, all others are projected out
    interest: int
    criterion: Criterion  #: `Determinant`, `Variance` or `LogBayesFactor`

    @property
    def candidates(self) -> int:
        return int(self.rows.shape[1])

    def among(self, chosen: Array) -> Objective:
        """The same with only some of the candidates."""
        return replace(self, rows=self.rows[:, chosen])

    def efficiency(self, value: float, best: float) -> float:
        """Of a design with this value beside the best."""
        return self.criterion.efficiency(value, best) if np.isfinite(value) else 0.0

    def value(self, counts: Array) -> float:
        """Φ of a design; −inf where it leaves something undetermined."""
        return float(self._values(self._precision(counts)).mean())

    def after_adding(self, counts: Array, chosen: Array) -> Array:
        """Φ with one more test of each of some candidates in turn, shape (chosen,)."""
        total = np.zeros(len(chosen))
        base = self._precision(counts)
        size = max(1, _CHUNK // base.size)
        for start in range(0, len(chosen), size):
            rows = self.rows[:, chosen[start : start + size]]
            precision = base + np.swapaxes(np.swapaxes(rows, -1, -2) @ rows, 0, 1)
            values = self._values(precision.reshape(-1, *base.shape[1:]))
            total[start : start + size] = values.reshape(-1, len(base)).mean(axis=1)
        return total

    def sensitivity(self, counts: Array) -> tuple[float, Array]:
        """Φ and ∂Φ/∂n_i = mean over K of ‖G_ki D_k‖², shape (candidates,), with ∂Φ/∂M = D Dᵀ."""
        s = self.interest
        precision = self._precision(counts)
        nuisance = precision[..., :-s, :-s]
        cross = precision[..., :-s, -s:]
        back = -np.linalg.solve(nuisance, cross)
        root = np.linalg.cholesky(precision[..., -s:, -s:] + np.swapaxes(cross, -1, -2) @ back)
        own = self.criterion.directions(root)
        slope = np.zeros(self.candidates)
        for rows, direction in zip(
            self.rows, np.concatenate([back @ own, own], axis=-2), strict=True
        ):
            seen = (rows.reshape(-1, rows.shape[-1]) @ direction).reshape(len(slope), -1)
            slope += np.einsum("ij,ij->i", seen, seen)
        return float(self.criterion.value(root).mean()), slope / len(root)

    def _precision(self, counts: Array) -> Array:
        """M, shape (K, p, p)."""
        used = np.flatnonzero(counts)
        scaled = self.rows[:, used] * np.sqrt(counts[used])[:, None, None]
        stacked = scaled.reshape(len(scaled), -1, scaled.shape[-1])
        return np.asarray(self.prior + np.swapaxes(stacked, -1, -2) @ stacked)

    def _values(self, precision: Array) -> Array:
        """Φ of every matrix M, −inf where it is singular."""
        try:
            root = np.linalg.cholesky(precision)
        except np.linalg.LinAlgError:
            if len(precision) == 1:
                return np.array([-np.inf])
            return np.concatenate([self._values(matrix[None]) for matrix in precision])
        values = self.criterion.value(root[:, -self.interest :, -self.interest :])
        if self._open:
            # Where only rounding kept a factorisation alive: what is left of a column beside the
            # others is nothing.
            left = np.diagonal(root, axis1=-2, axis2=-1) / np.sqrt(
                np.diagonal(precision, axis1=-2, axis2=-1)
            )
            values = np.where(left.min(axis=-1) < _NOTHING, -np.inf, values)
        return values

    @cached_property
    def _open(self) -> bool:
        """Whether the tests must determine something that nothing determines before."""
        return bool(np.linalg.matrix_rank(self.prior).min() < self.prior.shape[-1])
