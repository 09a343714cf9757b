"""p(s | y) ∝ p(y | s) Π_j HalfNormal(s_j; τ), in t = ln s: mode by Newton's method, draws by importance sampling.

The Jacobian Π s_j makes the density of t vanish for s → 0, so that its mode exists even where the machines show no spread.
Gradient by Fisher's identity, curvature by central differences of the gradient: the mode is the density's, not a tolerance's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv, ndtri
from scipy.stats import qmc

from ldbb_bayes.fleet.pooling import Pooling
from ldbb_bayes.inference.posterior import pareto_smooth

__all__ = ["SpreadDensity", "Spreads", "draw_spreads"]

Array = NDArray[Any]
_FREEDOM = 5.0
_STEP, _NEWTON, _HALVINGS, _LAST = 1e-4, 200, 40, 1e-6
_DOWN, _UP = 80.0, 25.0
_GOOD_SHARE = 0.2
_LEAST_VARIANCE = 0.05


@dataclass(frozen=True, eq=False)
class SpreadDensity:
    """ln p(t | y) of t = ln s, up to a constant.

    Attributes
    ----------
    pooling : Pooling
    scale : float
        τ, in units of the prior sd.
    """

    pooling: Pooling
    scale: float

    def log(self, t: Array) -> Array:
        """ln p(t | y), shape (k,), of t of shape (k, c)."""
        return self.pooling.common(np.exp(t)).log_density + self._log_prior(t)

    def _log_prior(self, t: Array) -> Array:
        return (t - 0.5 * np.exp(2.0 * (t - np.log(self.scale)))).sum(axis=-1)

    def gradient(self, t: Array) -> Array:
        """∂ ln p(t | y) / ∂ t, shape (k, c)."""
        return self.pooling.excess(np.exp(t)) + 1.0 - np.exp(2.0 * (t - np.log(self.scale)))

    def curvature(self, t: Array) -> Array:
        """−∂² ln p / ∂t², shape (c, c), at one t."""
        c = len(t)
        moved = np.concatenate([t + _STEP * np.eye(c), t - _STEP * np.eye(c)])
        slope = self.gradient(moved)
        found = -(slope[:c] - slope[c:]) / (2.0 * _STEP)
        return 0.5 * (found + found.T)

    def mode(self, start: Array | None = None) -> tuple[Array, Array]:
        """Where the density is highest, shape (c,), and the curvature there, made positive definite.

        Damped Newton from s = τ: directions of wrong curvature turned round, at most e-fold steps, halved until the density
        does not fall. A last step so small squares to less than rounding.
        """
        t = np.full(self.pooling.parameters, np.log(self.scale)) if start is None else np.array(start, dtype=float)
        level = self.log(t[None])[0]
        for _ in range(_NEWTON):
            step = np.linalg.solve(_upright(self.curvature(t)), self.gradient(t[None])[0])
            step /= max(1.0, float(np.abs(step).max()))
            if np.abs(step).max() < _LAST:
                t = t + step
                break
            for _ in range(_HALVINGS):
                other = self.log((t + step)[None])[0]
                if other >= level - 1e-12 * abs(level):
                    break
                step *= 0.5
            t, level = t + step, other
        return t, _upright(self.curvature(t))


@dataclass(frozen=True, eq=False)
class Spreads:
    """Weighted draws of s.

    Attributes
    ----------
    spread : ndarray, shape (k, c)
        In units of the prior sd.
    log_weight : ndarray, shape (k,)
        ln of target over proposal, as it came.
    weight : ndarray, shape (k,)
        Pareto-smoothed; they sum to one.
    pareto_k, good_k : float
        Above ``good_k`` the draws cannot be trusted.
    mode : ndarray, shape (c,)
        Of ln s.
    """

    spread: Array
    log_weight: Array
    weight: Array
    pareto_k: float
    good_k: float
    mode: Array

    @property
    def trusted(self) -> bool:
        """Whether Pareto's k̂ is low enough."""
        return self.pareto_k <= self.good_k

    @property
    def effective(self) -> float:
        """Effective number of draws, 1 / Σ w²."""
        return 1.0 / float(np.sum(self.weight**2))

    def first(self, size: int) -> Spreads:
        """The first draws alone: they are spread as evenly as all of them."""
        if size >= len(self.weight):
            return self
        weight, k, good = pareto_smooth(self.log_weight[:size])
        return Spreads(self.spread[:size], self.log_weight[:size], weight, k, good, self.mode)


def draw_spreads(density: SpreadDensity, *, seed: int, size: int = 2048, start: Array | None = None) -> Spreads:
    """Draws from a Student t about the mode, weighted; once more about their own moments where these fit better.

    Parameters
    ----------
    seed : int
        Of the scrambled Sobol points.
    size : int
        Draws, a power of two.
    start : ndarray, shape (c,), optional
        Of the search for the mode.
    """
    mode, curvature = density.mode(start)
    root = np.linalg.cholesky(np.linalg.inv(curvature))
    found = _weighed(density, mode, mode, root, seed=seed, size=size)
    if found.trusted and found.effective > _GOOD_SHARE * size:
        return found
    t = np.log(found.spread)
    middle = found.weight @ t
    apart = t - middle
    covariance = np.einsum("k,ki,kj->ij", found.weight, apart, apart) + _LEAST_VARIANCE * np.linalg.inv(curvature)
    other = _weighed(density, mode, middle, np.linalg.cholesky(covariance), seed=seed + 1, size=size)
    return min(found, other, key=lambda own: (not own.trusted, own.pareto_k if not own.trusted else -own.effective))


def _weighed(density: SpreadDensity, mode: Array, middle: Array, root: Array, *, seed: int, size: int) -> Spreads:
    c = len(middle)
    points = qmc.Sobol(c + 1, rng=np.random.default_rng(seed)).random(size)
    points = np.clip(points, 1e-12, 1.0 - 1e-12)
    chi = 2.0 * gammaincinv(0.5 * _FREEDOM, points[:, 0])
    white = ndtri(points[:, 1:]) * np.sqrt(_FREEDOM / chi)[:, None]
    limits = np.log(density.scale) - _DOWN, max(np.log(density.scale), float(mode.max())) + _UP
    t = np.clip(middle + white @ root.T, *limits)
    log_weight = density.log(t) + 0.5 * (_FREEDOM + c) * np.log1p((white**2).sum(axis=1) / _FREEDOM)
    weight, k, good = pareto_smooth(log_weight)
    return Spreads(np.exp(t), log_weight, weight, k, good, mode)


def _upright(curvature: Array) -> Array:
    """The same with every eigenvalue's size, and none near zero."""
    values, vectors = np.linalg.eigh(curvature)
    return np.asarray((vectors * np.maximum(np.abs(values), 1e-3)) @ vectors.T)
