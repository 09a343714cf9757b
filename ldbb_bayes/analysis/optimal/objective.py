"""The worth of a design: a criterion averaged over what is not known before the tests are run.

A design gives every candidate a number of tests n_i (or a share). With the rows G_i of candidate i, whitened by its noise, the
precision of all coefficients is M = P + Σ n_i G_iᵀ G_i; the criterion sees S, the Schur complement of M in the parameters of
interest, and is averaged over values of the hyper-parameters and over models.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.analysis.optimal.criteria import Criterion

__all__ = ["Case", "Objective"]

Array = NDArray[Any]
_CHUNK = 1 << 22
_NOTHING = 1e-6


@dataclass(frozen=True, eq=False)
class Case:
    """One model at K values of its hyper-parameters.

    Attributes
    ----------
    rows : ndarray, shape (K, candidates, m, p)
        G: what one test of a candidate tells, whitened; the s parameters of interest are the last columns.
    prior : ndarray, shape (K, p, p)
        P: precision before the new tests; prior and tests already run.
    weight : ndarray, shape (K,)
        Share of each in the average.
    interest : int
        s.
    criterion : Criterion
    """

    rows: Array
    prior: Array
    weight: Array
    interest: int
    criterion: Criterion

    def gram(self, chosen: Array) -> Array:
        """G_iᵀ G_i of some candidates, shape (K, chosen, p, p)."""
        rows = self.rows[:, chosen]
        return np.asarray(np.swapaxes(rows, -1, -2) @ rows)

    def precision(self, counts: Array) -> Array:
        """M, shape (K, p, p)."""
        used = np.flatnonzero(counts)
        scaled = self.rows[:, used] * np.sqrt(counts[used])[:, None, None]
        stacked = scaled.reshape(len(scaled), -1, scaled.shape[-1])
        return np.asarray(self.prior + np.swapaxes(stacked, -1, -2) @ stacked)

    def value(self, precision: Array) -> Array:
        """Φ averaged over the K values, shape (...), of M with shape (..., K, p, p); −inf where M is singular."""
        try:
            root = np.linalg.cholesky(precision)
        except np.linalg.LinAlgError:
            return self._one_by_one(precision)
        values = self.criterion.value(root[..., -self.interest :, -self.interest :])
        return np.asarray(np.where(self._singular(precision, root), -np.inf, values) @ self.weight)

    @cached_property
    def _open(self) -> bool:
        """Whether the tests must determine something that is not known before."""
        return bool(np.linalg.matrix_rank(self.prior).min() < self.prior.shape[-1])

    def _singular(self, precision: Array, root: Array) -> Array:
        """Where only rounding kept a factorisation alive: what is left of a column beside the others is nothing, shape (...)."""
        if not self._open:
            return np.zeros(precision.shape[:-2], dtype=bool)
        diagonal = np.diagonal(precision, axis1=-2, axis2=-1)
        left = np.diagonal(root, axis1=-2, axis2=-1) / np.sqrt(diagonal)
        return np.asarray(left.min(axis=-1) < _NOTHING)

    def _one_by_one(self, precision: Array) -> Array:
        flat = precision.reshape(-1, *precision.shape[-2:])
        values = np.full(len(flat), -np.inf)
        for k, matrix in enumerate(flat):
            try:
                root = np.linalg.cholesky(matrix)
            except np.linalg.LinAlgError:
                continue
            if not self._singular(matrix, root):
                values[k] = self.criterion.value(root[-self.interest :, -self.interest :])
        return np.asarray(values.reshape(precision.shape[:-2]) @ self.weight)

    def direction(self, precision: Array) -> tuple[float, Array]:
        """Φ, and D with ∂Φ/∂M = D Dᵀ at every one of the K values (times its weight), shape (K, p, q)."""
        s = self.interest
        nuisance, cross = precision[..., :-s, :-s], precision[..., :-s, -s:]
        back = -np.linalg.solve(nuisance, cross)
        root = np.linalg.cholesky(precision[..., -s:, -s:] + np.swapaxes(cross, -1, -2) @ back)
        own = self.criterion.directions(root) * np.sqrt(self.weight)[:, None, None]
        return float(self.criterion.value(root) @ self.weight), np.concatenate([back @ own, own], axis=-2)

    def along(self, direction: Array, chosen: Array | slice = slice(None)) -> Array:
        """Σ_k ‖G_ki D_k‖², shape (candidates,): how fast Φ grows with each n_i."""
        rows = self.rows[:, chosen]
        total = np.zeros(rows.shape[1])
        for part, own in zip(rows, direction, strict=True):
            total += ((part.reshape(-1, part.shape[-1]) @ own) ** 2).sum(axis=1).reshape(len(total), -1).sum(axis=1)
        return total


@dataclass(frozen=True, eq=False)
class Objective:
    """The sum of cases, each with its share.

    Attributes
    ----------
    cases : sequence of Case
        All of the same candidates.
    share : ndarray, shape (cases,)
    """

    cases: Sequence[Case]
    share: Array

    @property
    def candidates(self) -> int:
        """Number of candidates."""
        return int(self.cases[0].rows.shape[1])

    @property
    def concave(self) -> bool:
        """Whether a local optimum over weights is the optimum."""
        return all(case.criterion.concave for case in self.cases)

    def value(self, counts: Array) -> float:
        """Φ of a design, counts (candidates,); −inf where it leaves something undetermined."""
        return float(sum(w * case.value(case.precision(counts)) for w, case in self._shared()))

    def sensitivity(self, counts: Array) -> tuple[float, Array]:
        """Φ and ∂Φ/∂n_i, shape (candidates,)."""
        value, slope = 0.0, np.zeros(self.candidates)
        for w, case in self._shared():
            own, direction = case.direction(case.precision(counts))
            value += w * own
            slope += w * case.along(direction)
        return value, slope

    def among(self, chosen: Array) -> Objective:
        """The same with only some of the candidates."""
        cases = [Case(c.rows[:, chosen], c.prior, c.weight, c.interest, c.criterion) for c in self.cases]
        return Objective(cases, self.share)

    def after_adding(self, counts: Array, chosen: Array) -> Array:
        """Φ with one more test of each of some candidates in turn, shape (chosen,)."""
        total = np.zeros(len(chosen))
        for w, case in self._shared():
            base = case.precision(counts)
            size = max(1, _CHUNK // base.size)
            for start in range(0, len(chosen), size):
                part = slice(start, start + size)
                total[part] += w * case.value(base + np.swapaxes(case.gram(chosen[part]), 0, 1))
        return total

    def efficiency(self, value: float, best: float) -> float:
        """Of a design with this value beside the best."""
        return self.cases[0].criterion.efficiency(value, best) if np.isfinite(value) else 0.0

    def _shared(self) -> zip[tuple[float, Case]]:
        return zip(self.share.tolist(), self.cases, strict=True)
