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
from ldbb_bayes.model.orthant import Orthant

__all__ = ["HyperIntegral", "HyperPosterior", "TruncationProbability", "log_prob_truncation"]

Array = NDArray[Any]

_STEP = 0.05
_TAIL = 5.0
_WIDEN = 1.2
_PROPOSALS = 8


class HyperPosterior:
    """p(φ | y), with or without the truncation, and a Student-t proposal about its mode in ln φ.

    Parameters
    ----------
    bound : BoundModel
    truncated : bool
        Include P(T | y, φ).
    seed : int
        Of the quasi-random points.

    Attributes
    ----------
    mode : ndarray, shape (h,)
        Of the density in ln φ.
    spread : ndarray, shape (h, h)
        Root of the inverse curvature.
    """

    def __init__(self, bound: BoundModel, *, truncated: bool, seed: int = 0) -> None:
        self._bound, self._truncated, self._seed = bound, truncated and bound.truncation.active, seed
        self.mode, self.spread = self._locate()

    def log_density(self, log_phi: Array, *, exact: bool = False) -> Array:
        """ln p(y, ln φ), shape (w,). P(T | y, φ) by its bound, which is smooth, or (``exact``) by its estimate."""
        prior = self._bound.hyper_prior.log_density_of_log(log_phi)
        total = np.full(len(log_phi), -np.inf)
        inside = np.isfinite(prior)
        if not inside.any():
            return total
        phi = np.exp(log_phi[inside])
        if not self._truncated:
            total[inside] = prior[inside] + self._bound.log_evidence_given(phi)[0]
            return total
        log_evidence, mean, spread = self._bound.log_evidence_given(phi)
        orthant = self._bound.truncation.orthants(mean, spread)
        log_truncation = orthant.log_probability(256, seed=self._seed)[0] if exact else orthant.log_bound
        total[inside] = prior[inside] + log_evidence + log_truncation
        return total

    def draw(self, size: int, rng: np.random.Generator, *, temperature: float = 1.0) -> Array:
        """Draws of ln φ, shape (size, h), by weighted resampling without repeats from the proposal.

        Approximate (exact in the limit of many proposals); ``temperature`` > 1 spreads them wider than the posterior.
        """
        standard = rng.standard_t(_TAIL, (_PROPOSALS * size, len(self.mode)))
        log_phi = self.mode + np.sqrt(temperature) * standard @ self.spread.T
        log_proposal = scipy.stats.t.logpdf(standard, _TAIL).sum(axis=1)
        log_weight = self.log_density(log_phi) / temperature - log_proposal
        keys = log_weight + rng.gumbel(size=len(log_weight))
        return log_phi[np.argsort(-keys)[:size]]

    def integrate(self, size: int = 1024) -> HyperIntegral:
        """ln ∫ p(y, φ) dφ by importance sampling at scrambled Sobol points, two independent halves giving the error."""
        estimates = []
        for half in range(2):
            points = scipy.stats.qmc.Sobol(len(self.mode), rng=np.random.default_rng([self._seed, half])).random(size // 2)
            standard = scipy.stats.t.ppf(points, _TAIL) * _WIDEN
            log_proposal = (scipy.stats.t.logpdf(standard / _WIDEN, _TAIL) - np.log(_WIDEN)).sum(axis=1)
            log_proposal -= np.linalg.slogdet(self.spread)[1]
            log_weight = self.log_density(self.mode + standard @ self.spread.T, exact=True) - log_proposal
            top = log_weight.max()
            estimates.append(top + np.log(np.mean(np.exp(log_weight - top))))
        mean = float(np.logaddexp(*estimates) - np.log(2.0))
        return HyperIntegral(mean, float(abs(estimates[0] - estimates[1]) / 2.0))

    def _locate(self) -> tuple[Array, Array]:
        """Mode by damped Newton steps on central differences, all points of a stencil in one call."""
        prior = self._bound.hyper_prior
        rng = scipy.stats.qmc.Sobol(len(prior.names), rng=np.random.default_rng(self._seed))
        spread = np.exp(-_far_grid(rng.random(256)))
        start = np.log(np.maximum(prior.scale_mm * spread * 2.0, prior.lower_mm * 1.05))
        values = self.log_density(start)
        point = start[int(np.argmax(values))]
        radius = 1.0
        for _ in range(60):
            value, gradient, hessian = self._stencil(point)
            curvature, vectors = np.linalg.eigh(-hessian)
            step = vectors @ ((vectors.T @ gradient) / np.maximum(np.abs(curvature), 0.3))
            step *= min(1.0, radius / max(float(np.linalg.norm(step)), 1e-12))
            sizes = np.array([1.0, 0.5, 0.25, 0.1, 0.03])
            trials = self.log_density(point + sizes[:, None] * step)
            best = int(np.argmax(trials))
            if not trials[best] > value + 1e-6:
                break
            point = point + sizes[best] * step
        _, _, hessian = self._stencil(point)
        curvature, vectors = np.linalg.eigh(-hessian)
        return point, vectors / np.sqrt(np.maximum(curvature, 0.3))

    def _stencil(self, point: Array) -> tuple[float, Array, Array]:
        """Value, gradient and Hessian by central differences, stepping inwards where the prior's support ends."""
        h = len(point)
        lower = self._bound.hyper_prior.lower_mm
        with np.errstate(divide="ignore"):
            inside = np.log(lower) + 1.01 * _STEP
        centre = np.maximum(point, inside)
        unit = np.eye(h) * _STEP
        pairs = [(i, j) for i in range(h) for j in range(i)]
        offsets = [np.zeros(h), *unit, *-unit]
        offsets += [a * unit[i] + b * unit[j] for i, j in pairs for a, b in ((1, 1), (1, -1), (-1, 1), (-1, -1))]
        values = self.log_density(centre + np.array(offsets))
        plus, minus = values[1 : h + 1], values[h + 1 : 2 * h + 1]
        gradient = (plus - minus) / (2 * _STEP)
        hessian = np.diag((plus + minus - 2 * values[0]) / _STEP**2)
        for k, (i, j) in enumerate(pairs):
            a, b, c, d = values[2 * h + 1 + 4 * k : 2 * h + 5 + 4 * k]
            hessian[i, j] = hessian[j, i] = (a - b - c + d) / (4 * _STEP**2)
        return float(self.log_density(point[None])[0]), gradient, hessian


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


def conditional_draws(bound: BoundModel, log_phi: Array, rng: np.random.Generator) -> tuple[Array, NDArray[np.bool_]]:
    """One draw of β for each ln φ from its exact conditional Gaussian inside the truncation.

    Returns
    -------
    beta : ndarray, shape (w, p)
    exact : ndarray of bool, shape (w,)
        False where the rejection sampler gave up; β is then inside the truncation but not an exact draw.
    """
    _, mean, spread = bound.log_evidence_given(np.exp(log_phi))
    if not bound.truncation.active:
        white = rng.standard_normal((len(log_phi), spread.shape[2]))
        return mean + np.einsum("wpq,wq->wp", spread, white), np.ones(len(log_phi), dtype=bool)
    orthant: Orthant = bound.truncation.orthants(mean, spread)
    white, exact = orthant.draw_spread(rng)
    return mean + np.einsum("wpq,wq->wp", spread, white), exact


def _far_grid(uniform: Array) -> Array:
    """Spread starting points over several e-foldings below the prior scale."""
    return 5.0 * uniform
