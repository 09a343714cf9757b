"""Integrals over the hyper-parameters φ: mode, curvature, and importance quadrature about them.

ln Z = ln ∫ p(y | φ) p(φ) dφ with β integrated out exactly; with truncation the integrand carries P(T | y, φ). Each integral is
centred on its own mode, because P(T | y) may move the mode far.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.stats
from numpy.typing import NDArray

from ldbb_bayes.model.bound import BoundModel

__all__ = ["HyperIntegral", "HyperPosterior", "TruncationProbability", "log_prob_truncation"]

Array = NDArray[Any]

_STEP = 0.05
_TAIL = 5.0
_WIDEN = 1.2
_PROPOSALS = 5
_STARTS = 256
_BASINS = 3
_CHUNK = 1024
_TRIAL = 512
_TRIAL_STREAM = 100
_REFINEMENTS = 3


class HyperPosterior:
    """p(φ | y), with or without the truncation, and a Student-t proposal about its mode in free coordinates.

    Parameters
    ----------
    bound : BoundModel
    truncated : bool
        Include P(T | y, φ), the probability of physical compliances (whether or not the model imposes them).
    seed : int
        Of the quasi-random points.

    Attributes
    ----------
    bound : BoundModel
    truncated : bool
    mode : ndarray, shape (h,)
        Of the density in free coordinates.
    centre : ndarray, shape (h,)
    spread : ndarray, shape (h, h)
        Of the proposal: mode and root of the inverse curvature, or, where these fit badly (a long tail), mean and root of the
        covariance of a first set of nodes.
    """

    def __init__(self, bound: BoundModel, *, truncated: bool, seed: int = 0) -> None:
        self.bound, self.truncated, self._seed = bound, truncated, seed
        self.mode, self.spread = self._locate()
        self.centre = self.mode
        self._refine()

    def log_density(self, free: Array, *, exact: bool = False, seed: int | None = None) -> Array:
        """ln p(y, free coordinates), shape (w,). P(T | y, φ) by its bound, which is smooth, or (``exact``) by its estimate."""
        prior = self.bound.hyper_prior.log_density_of_free(free)
        total = np.full(len(free), -np.inf)
        inside = np.isfinite(prior)
        if not inside.any():
            return total
        phi = self.bound.hyper_prior.phi(free[inside])
        if not self.truncated:
            total[inside] = prior[inside] + self.bound.log_evidence(phi)
            return total
        log_evidence, given = self.bound.given(phi)
        log_truncation = (
            given.orthant.log_value(256, seed=self._seed if seed is None else seed) if exact else given.orthant.log_bound
        )
        total[inside] = prior[inside] + log_evidence + log_truncation
        return total

    def draw(self, size: int, rng: np.random.Generator, *, temperature: float = 1.0) -> Array:
        """Draws of free coordinates, shape (size, h), by weighted resampling without repeats from the proposal.

        Approximate (exact in the limit of many proposals); ``temperature`` > 1 spreads them wider than the posterior.
        """
        standard = rng.standard_t(_TAIL, (_PROPOSALS * size, len(self.mode)))
        free = self.centre + np.sqrt(temperature) * standard @ self.spread.T
        log_proposal = scipy.stats.t.logpdf(standard, _TAIL).sum(axis=1)
        log_weight = self.log_density(free) / temperature - log_proposal
        keys = log_weight + rng.gumbel(size=len(log_weight))
        return free[np.argsort(-keys)[:size]]

    def _refine(self) -> None:
        """Fit the proposal to weighted nodes while fewer than half of them count (Kish)."""
        for attempt in range(_REFINEMENTS):
            free, log_weight = self.nodes(_TRIAL, _TRIAL_STREAM + attempt, exact=False)
            weight = np.exp(log_weight - log_weight.max())
            weight /= weight.sum()
            effective = 1.0 / float((weight**2).sum())
            if effective > 0.5 * _TRIAL or effective < 10.0 * len(self.mode):
                return
            centre = weight @ free
            scatter = np.sqrt(weight)[:, None] * (free - centre)
            self.centre, self.spread = centre, np.linalg.cholesky(scatter.T @ scatter)

    def nodes(self, size: int, stream: int = 0, *, exact: bool = True) -> tuple[Array, Array]:
        """Scrambled Sobol points of the proposal and their log weights, shapes (size, h) and (size,)."""
        points = scipy.stats.qmc.Sobol(len(self.mode), rng=np.random.default_rng([self._seed, stream])).random(size)
        standard = scipy.stats.t.ppf(points, _TAIL) * _WIDEN
        log_proposal = (scipy.stats.t.logpdf(standard / _WIDEN, _TAIL) - np.log(_WIDEN)).sum(axis=1)
        log_proposal -= np.linalg.slogdet(self.spread)[1]
        free = self.centre + standard @ self.spread.T
        parts = [
            self.log_density(part, exact=exact, seed=2 * self._seed + stream) for part in np.array_split(free, -(-size // _CHUNK))
        ]
        return free, np.concatenate(parts) - log_proposal

    def integrate(self, size: int = 1024) -> HyperIntegral:
        """ln ∫ p(y, φ) dφ by importance sampling at scrambled Sobol points, two independent halves giving the error."""
        estimates = []
        for half in range(2):
            _, log_weight = self.nodes(size // 2, half)
            top = log_weight.max()
            estimates.append(top + np.log(np.mean(np.exp(log_weight - top))))
        mean = float(np.logaddexp(*estimates) - np.log(2.0))
        return HyperIntegral(mean, float(abs(estimates[0] - estimates[1]) / 2.0))

    def _locate(self) -> tuple[Array, Array]:
        """Mode and curvature: Newton from the best of many starting points, several basins tried."""
        prior = self.bound.hyper_prior
        points = scipy.stats.qmc.Sobol(len(prior.names), rng=np.random.default_rng(self._seed)).random(_STARTS)
        starts = np.log(2.0 * prior.scale_mm) - points * np.where(prior.lower_mm > 0, 12.0, 6.0)
        starts = starts[np.argsort(-self.log_density(starts))]
        basins: list[Array] = []
        for start in starts[: _STARTS // 4]:
            if all(np.linalg.norm(start - other) > 1.5 for other in basins):
                basins.append(start)
            if len(basins) == _BASINS:
                break
        modes = np.array([self._climb(start) for start in basins])
        mode = modes[int(np.argmax(self.log_density(modes)))]
        _, _, hessian = self._stencil(mode)
        curvature, vectors = np.linalg.eigh(-hessian)
        return mode, vectors / np.sqrt(np.maximum(curvature, 0.3))

    def _climb(self, point: Array) -> Array:
        """Damped Newton steps on central differences, all points of a stencil in one call."""
        sizes = np.array([1.0, 0.5, 0.25, 0.1, 0.03])
        for _ in range(60):
            value, gradient, hessian = self._stencil(point)
            curvature, vectors = np.linalg.eigh(-hessian)
            step = vectors @ ((vectors.T @ gradient) / np.maximum(np.abs(curvature), 0.3))
            step *= min(1.0, 1.5 / max(float(np.linalg.norm(step)), 1e-12))
            trials = self.log_density(point + sizes[:, None] * step)
            best = int(np.argmax(trials))
            if not trials[best] > value + 1e-6:
                break
            point = point + sizes[best] * step
        return point

    def _stencil(self, point: Array) -> tuple[float, Array, Array]:
        """Value, gradient and Hessian by central differences."""
        h = len(point)
        unit = np.eye(h) * _STEP
        pairs = [(i, j) for i in range(h) for j in range(i)]
        offsets = [np.zeros(h), *unit, *-unit]
        offsets += [a * unit[i] + b * unit[j] for i, j in pairs for a, b in ((1, 1), (1, -1), (-1, 1), (-1, -1))]
        values = self.log_density(point + np.array(offsets))
        plus, minus = values[1 : h + 1], values[h + 1 : 2 * h + 1]
        gradient = (plus - minus) / (2 * _STEP)
        hessian = np.diag((plus + minus - 2 * values[0]) / _STEP**2)
        for k, (i, j) in enumerate(pairs):
            a, b, c, d = values[2 * h + 1 + 4 * k : 2 * h + 5 + 4 * k]
            hessian[i, j] = hessian[j, i] = (a - b - c + d) / (4 * _STEP**2)
        return float(values[0]), gradient, hessian


@dataclass(frozen=True)
class HyperIntegral:
    """ln ∫ p(y, φ) dφ and its error [nat]."""

    log_value: float
    error: float


@dataclass(frozen=True)
class TruncationProbability:
    """ln P(T | y) of the untruncated posterior, with its error [nat]."""

    log_value: float
    error: float


def log_prob_truncation(plain: HyperPosterior, truncated: HyperPosterior, *, size: int = 1024) -> TruncationProbability:
    """ln P(T | y): the ratio of the integrals with and without the truncation."""
    inside, every = truncated.integrate(size), plain.integrate(size)
    error = float(np.hypot(inside.error, every.error))
    return TruncationProbability(min(inside.log_value - every.log_value, 0.0), error)


def conditional_draws(bound: BoundModel, free: Array, rng: np.random.Generator) -> tuple[Array, NDArray[np.bool_]]:
    """One draw of β for each free coordinates from its exact conditional Gaussian inside the truncation.

    Returns
    -------
    beta : ndarray, shape (w, p)
    exact : ndarray of bool, shape (w,)
        False where the rejection sampler gave up, or rounding left β outside.
    """
    _, given = bound.given(bound.hyper_prior.phi(free))
    if bound.truncation.active:
        return given.draw_inside(rng)
    return given.draw(rng), np.ones(len(free), dtype=bool)
