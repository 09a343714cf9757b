"""ln p(y | s) of machines about their mean: sums over machines for many spreads s at once, and draws of s."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv, ndtri
from scipy.stats import qmc

from ldbb_bayes.fleet.statistics import FleetStatistics
from ldbb_bayes.inference.posterior import pareto_smooth

__all__ = [
    "Common",
    "OfMachines",
    "Pooling",
    "SpreadDensity",
    "Spreads",
    "back",
    "cholesky",
    "draw_spreads",
    "forward",
    "log_determinant",
    "pooling",
]

Array = NDArray[Any]


def cholesky(matrix: Array) -> Array:
    """Lower L with L Lᵀ = A, shapes (q, q, ...); only the lower triangle of A is read.

    Raises
    ------
    LinAlgError
        When a matrix is not positive definite.
    """
    lower = np.zeros_like(matrix)
    for j in range(len(matrix)):
        pivot = matrix[j, j] - np.einsum("k...,k...->...", lower[j, :j], lower[j, :j])
        if not np.all(pivot > 0.0):
            raise np.linalg.LinAlgError("a matrix of the stack is not positive definite")
        lower[j, j] = np.sqrt(pivot)
        for i in range(j + 1, len(matrix)):
            lower[i, j] = (matrix[i, j] - np.einsum("k...,k...->...", lower[i, :j], lower[j, :j])) / lower[j, j]
    return lower


def forward(lower: Array, right: Array) -> Array:
    """L⁻¹ X, shapes (q, q, ...) and (q, r, ...)."""
    solved = np.empty_like(right)
    for i in range(len(right)):
        rest = right[i].copy()
        for j in range(i):
            rest -= lower[i, j] * solved[j]
        solved[i] = rest / lower[i, i]
    return solved


def back(lower: Array, right: Array) -> Array:
    """L⁻ᵀ X, shapes (q, q, ...) and (q, r, ...)."""
    solved = np.empty_like(right)
    for i in reversed(range(len(right))):
        rest = right[i].copy()
        for j in range(i + 1, len(right)):
            rest -= lower[j, i] * solved[j]
        solved[i] = rest / lower[i, i]
    return solved


def log_determinant(lower: Array) -> Array:
    """ln |L Lᵀ|, shape (...)."""
    return 2.0 * np.log(np.einsum("ii...->i...", lower)).sum(axis=0)


_TOGETHER = 8192


@dataclass(frozen=True, eq=False)
class Common:
    """What is common to all machines, x = (μ, b), for k spreads.

    Attributes
    ----------
    log_density : ndarray, shape (k,)
        ln p(y | s), up to a constant.
    mean : ndarray, shape (k, q)
        E[x | y, s].
    precision, root : ndarray, shape (k, q, q)
        P of x | y, s, and the R with P⁻¹ = R Rᵀ.
    weighted : ndarray, shape (k, q)
        P · mean.
    constant : ndarray, shape (k,)
        Of the exponent: ln p(y | s) = constant + ½ weightedᵀ mean − ½ ln |P|.
    """

    log_density: Array
    mean: Array
    precision: Array
    root: Array
    weighted: Array
    constant: Array


@dataclass(frozen=True, eq=False)
class OfMachines:
    """Machines for the k spreads of a chunk; L Lᵀ = K, G = K⁻¹ diag(s) F, F = Λ's rows of c_m.

    Attributes
    ----------
    rows : slice
        Of the spreads.
    lower : ndarray, shape (c, c, k, n)
    solved : ndarray, shape (c, q + 1, k, n)
        L⁻¹ diag(s) (F, a), a being η's part of c_m.
    """

    rows: slice
    lower: Array
    solved: Array


@dataclass(frozen=True, eq=False)
class Pooling:
    """Sums over campaigns, in units of the prior sd about the prior mean: n machines, c parameters, q − c instrument errors.

    Attributes
    ----------
    machines : tuple of str, length n
    campaigns : ndarray of int, shape (n,)
        Of each machine.
    information : ndarray, shape (q, q, n)
        Λ, parameters first.
    weighted : ndarray, shape (q, n)
        η.
    parameters : int
        c.
    """

    machines: tuple[str, ...]
    campaigns: Array
    information: Array
    weighted: Array
    parameters: int

    def __len__(self) -> int:
        return len(self.machines)

    def without(self, machine: int) -> Pooling:
        """The others."""
        kept = np.arange(len(self)) != machine
        names = tuple(name for name, keep in zip(self.machines, kept, strict=True) if keep)
        return Pooling(names, self.campaigns[kept], self.information[..., kept], self.weighted[:, kept], self.parameters)

    def each(self, spread: Array) -> Iterator[OfMachines]:
        """Chunks of spreads, shape (k, c), small enough to stay near the processor."""
        c, n = self.parameters, len(self)
        size = max(1, _TOGETHER // n)
        right = np.concatenate([self.information[:c], self.weighted[:c, None]], axis=1)
        for start in range(0, len(spread), size):
            s = spread[start : start + size].T[:, :, None]
            matrix = s[:, None] * s[None] * self.information[:c, :c, None]
            matrix[range(c), range(c)] += 1.0
            lower = cholesky(matrix)
            yield OfMachines(slice(start, start + s.shape[1]), lower, forward(lower, s[:, None] * right[:, :, None]))

    def common(self, spread: Array) -> Common:
        """Everything but s integrated out, for spreads of shape (k, c)."""
        return _common([self._sums(part) for part in self.each(spread)])

    def _sums(self, part: OfMachines) -> tuple[Array, Array, Array]:
        """Precision and weighted mean of x, and the constant, summed over machines; the prior of x with them."""
        q = len(self.weighted)
        solved = part.solved.transpose(2, 0, 1, 3)
        square = (solved @ solved.swapaxes(-1, -2)).sum(axis=1)
        precision = np.eye(q) + self.information.sum(axis=-1) - square[:, :q, :q]
        weighted = self.weighted.sum(axis=-1) - square[:, :q, q]
        return precision, weighted, 0.5 * (square[:, q, q] - log_determinant(part.lower).sum(axis=-1))

    def excess(self, spread: Array) -> Array:
        """∂ ln p(y | s) / ∂ ln s_j = Σ_m (E[z_mj² | y, s] − 1) (Fisher's identity), shape (k, c)."""
        found = np.empty((len(spread), self.parameters))
        for part in self.each(spread):
            z, variance = self.deviations(part, _common([self._sums(part)]))
            found[part.rows] = (z**2 + variance - 1.0).sum(axis=-1).T
        return found

    def deviations(self, part: OfMachines, common: Common) -> tuple[Array, Array]:
        """Mean and variance of z_m = (c_m − μ) / s given y and s, shape (c, k, n); ``common`` is that of the chunk."""
        q = len(self.weighted)
        gain, own = back(part.lower, part.solved[:, :q]), remaining(part.lower)
        left = part.solved[:, q] - np.einsum("ilkm,kl->ikm", part.solved[:, :q], common.mean)
        z = back(part.lower, left[:, None])[:, 0]
        return z, own + _squares(gain, common.root)

    def estimates(self, part: OfMachines, common: Common, spread: Array) -> tuple[Array, Array, Array]:
        """Mean and sd of c_m given y and s, and the share of the machines' variance that is left, each (c, k, n)."""
        c, q = self.parameters, len(self.weighted)
        s = spread[part.rows].T[:, :, None]
        z, _ = self.deviations(part, common)
        share = remaining(part.lower)
        gain = -s[:, None] * back(part.lower, part.solved[:, :q])
        gain[range(c), range(c)] += 1.0
        return common.mean.T[:c, :, None] + s * z, np.sqrt(s**2 * share + _squares(gain, common.root)), share


def remaining(lower: Array) -> Array:
    """Diagonal of K⁻¹, shape (c, k, n): Var(c_mj | y, μ, b, s) / s_j²."""
    identity = np.zeros_like(lower)
    identity[range(len(lower)), range(len(lower))] = 1.0
    inverse = forward(lower, identity)
    return np.einsum("ijkm,ijkm->jkm", inverse, inverse)


def _squares(gain: Array, root: Array) -> Array:
    """Diagonal of G P⁻¹ Gᵀ for G of shape (c, q, k, n), P⁻¹ = R Rᵀ of (k, q, q)."""
    spread = root.swapaxes(-1, -2)[:, None] @ gain.transpose(2, 0, 1, 3)
    return np.einsum("kjrm,kjrm->jkm", spread, spread)


def _common(sums: list[tuple[Array, Array, Array]]) -> Common:
    precision, weighted, constant = (np.concatenate(parts) for parts in zip(*sums, strict=True))
    lower = np.linalg.cholesky(precision)
    root = np.swapaxes(np.linalg.inv(lower), -1, -2)
    white = np.einsum("kji,kj->ki", root, weighted)
    log_density = constant + 0.5 * (white**2).sum(axis=-1) - np.log(np.diagonal(lower, axis1=1, axis2=2)).sum(axis=-1)
    return Common(log_density, np.einsum("kij,kj->ki", root, white), precision, root, weighted, constant)


def pooling(statistics: FleetStatistics) -> Pooling:
    """The sums of a fleet; machines in the order in which they first appear."""
    names = tuple(dict.fromkeys(statistics.machines))
    place = {name: k for k, name in enumerate(names)}
    of = np.array([place[name] for name in statistics.machines])
    c = len(statistics.parameters)
    scale = np.concatenate([statistics.prior_sd, statistics.instrument_sd])
    centre = np.concatenate([statistics.prior_mean, np.zeros(len(scale) - c)])
    information = np.zeros((len(names), len(scale), len(scale)))
    weighted = np.zeros((len(names), len(scale)))
    np.add.at(information, of, statistics.information * scale[:, None] * scale)
    np.add.at(weighted, of, (statistics.weighted - statistics.information @ centre) * scale)
    information = 0.5 * (information + np.swapaxes(information, 1, 2))
    return Pooling(
        names,
        np.bincount(of, minlength=len(names)),
        np.ascontiguousarray(information.transpose(1, 2, 0)),
        np.ascontiguousarray(weighted.T),
        c,
    )


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
