"""Split from its neighbours; see there."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.special import gammaincinv, ndtri
from scipy.stats import qmc

from ldbb_bayes.fleet.campaign_statistics import mixture_covariance
from ldbb_bayes.fleet.deviations import whitened
from ldbb_bayes.fleet.fleet_statistics import FleetStatistics
from ldbb_bayes.inference.diagnostics import pareto_smooth
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.newton import newton
from ldbb_bayes.results import Array

# Pairs of a spread and a machine that are worked on at once.
_TOGETHER = 4096


def machines_of(statistics: FleetStatistics) -> tuple[tuple[str, ...], Gaussian]:
    """The machines in the order in which they first appear, and the product of each one's
    likelihoods, shape (n, q)."""
    place = {name: k for k, name in enumerate(dict.fromkeys(statistics.machines))}
    of = [place[name] for name in statistics.machines]
    sums = []
    for part in (statistics.likelihood.precision, statistics.likelihood.shift):
        sums.append(np.zeros((len(place), *part.shape[1:])))
        np.add.at(sums[-1], of, part)
    return tuple(place), Gaussian(*sums)


def chunks(spread: Array, likelihood: Gaussian) -> Iterator[slice]:
    """Slices of spreads, so many that what they take with all machines stays near the processor."""
    size = max(1, _TOGETHER // len(likelihood.shift))
    return (slice(start, start + size) for start in range(0, len(spread), size))


def common_of(likelihood: Gaussian, spread: Array) -> Gaussian:
    """x = (μ, b) for k spreads (k, c), shape (k, q); ``log_integral`` is ln p(y | s), up to a
    constant."""
    (k, c), q = spread.shape, likelihood.shift.shape[1]
    square = np.empty((k, q + 1, q + 1))
    constant = np.empty(k)
    for rows in chunks(spread, likelihood):
        whole = whitened(likelihood, spread[rows])
        flat = whole[:, c:].transpose(2, 1, 0, 3).reshape(whole.shape[2], q + 1, -1)
        square[rows] = flat @ np.swapaxes(flat, 1, 2)
        constant[rows] = -np.log(whole[range(c), range(c)]).sum(axis=(0, 2))
    precision = np.eye(q) + likelihood.precision.sum(axis=0) - square[:, :q, :q]
    return Gaussian(
        precision, likelihood.shift.sum(axis=0) - square[:, :q, q], constant + 0.5 * square[:, q, q]
    )


def estimates_of(likelihood: Gaussian, spread: Array, common: Gaussian) -> Array:
    """Mean and sd of c_m, mean and variance of z_m = (c_m − μ) / s, shape (4, k, n, c)."""
    c = spread.shape[1]
    q = likelihood.shift.shape[1]
    root = np.swapaxes(common.spread(), 1, 2)
    found = np.empty((4, len(spread), len(likelihood.shift), c))
    for rows in chunks(spread, likelihood):
        whole = whitened(likelihood, spread[rows], inverse=True)
        inverse = whole[:, c + q + 1 :]
        s = spread[rows].T[..., None]
        gain = np.einsum("ijkn,irkn->jrkn", inverse, whole[:, c : c + q + 1])
        z = gain[:, q] - np.einsum("jrkn,kr->jkn", gain[:, :q], common.mean[rows])
        own = np.eye(c, q)[..., None, None] - s[:, None] * gain[:, :q]
        of_z, of_c = (
            ((root[rows] @ part.transpose(0, 2, 1, 3)) ** 2).sum(axis=2)
            for part in (gain[:, :q], own)
        )
        share = (inverse**2).sum(axis=0)
        parts = (
            common.mean[rows, :c].T[..., None] + s * z,
            np.sqrt(s**2 * share + of_c),
            z,
            share + of_z,
        )
        found[:, rows] = np.moveaxis(np.stack(parts), 1, -1)
    return found


_FREEDOM = 5.0


_STEP = 1e-4


_DOWN = 80.0


_UP = 25.0


_GOOD_SHARE = 0.2


_LEAST_VARIANCE = 0.05


_FLATTEST = 1e-3


@dataclass(frozen=True, eq=False)
class SpreadDensity:
    """ln p(t | y) of t = ln s, up to a constant; τ = ``scale``, in units of the prior sd."""

    likelihood: Gaussian
    scale: float

    def log(self, t: Array) -> Array:
        """ln p(t | y), shape (k,), of t of shape (k, c)."""
        prior = (t - 0.5 * np.exp(2.0 * (t - np.log(self.scale)))).sum(axis=-1)
        return np.asarray(common_of(self.likelihood, np.exp(t)).log_integral + prior)

    def gradient(self, t: Array) -> Array:
        """∂ ln p(t | y) / ∂ t, shape (k, c): Σ_m (E[z_m² | y, s] − 1) (Fisher's identity) and the
        prior's."""
        s = np.exp(t)
        _, _, z, variance = estimates_of(self.likelihood, s, common_of(self.likelihood, s))
        return np.asarray((z**2 + variance - 1.0).sum(axis=1) + 1.0 - (s / self.scale) ** 2)

    def derivatives(self, t: Array) -> tuple[Array, Array]:
        """Gradient (c,) and Hessian (c, c) at one t."""
        step = _STEP * np.eye(len(t))
        slope = self.gradient(np.concatenate([t[None], t + step, t - step]))
        hessian = (slope[1 : len(t) + 1] - slope[len(t) + 1 :]) / (2.0 * _STEP)
        return slope[0], 0.5 * (hessian + hessian.T)

    def mode(self, start: Array) -> tuple[Array, Array]:
        """Where the density is highest, shape (c,), and the curvature there, every eigenvalue by
        its size and none near zero."""
        t = newton(self.log, self.derivatives, start, gain=1e-10)
        values, vectors = np.linalg.eigh(-self.derivatives(t)[1])
        return t, np.asarray((vectors * np.maximum(np.abs(values), _FLATTEST)) @ vectors.T)


@dataclass(frozen=True, eq=False)
class Spreads:
    """Weighted draws of s (k, c), in units of the prior sd. ``log_weight`` is ln of target over
    proposal, as it came, ``weight`` Pareto-smoothed, summing to one; above ``good_k`` the draws
    cannot be trusted. ``mode`` is that of ln s."""

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
        log_weight = self.log_weight[:size]
        return Spreads(self.spread[:size], log_weight, *pareto_smooth(log_weight), self.mode)


def draw_spreads(
    density: SpreadDensity,
    parameters: int,
    *,
    seed: int,
    size: int = 2048,
    start: Array | None = None,
) -> Spreads:
    """Draws from a Student t about the mode, weighted; once more about their own moments where
    these fit better. Points are scrambled Sobol ones, ``size`` a power of two; the search for the
    mode starts at ln τ, or ``start``."""
    mode, curvature = density.mode(
        np.full(parameters, np.log(density.scale)) if start is None else start
    )
    inverse = np.linalg.inv(curvature)
    found = _weighed(density, mode, mode, inverse, seed=seed, size=size)
    if found.trusted and found.effective > _GOOD_SHARE * size:
        return found
    middle, covariance = mixture_covariance(found.weight, np.log(found.spread))
    other = _weighed(
        density, mode, middle, covariance + _LEAST_VARIANCE * inverse, seed=seed + 1, size=size
    )
    return min(
        found,
        other,
        key=lambda own: (not own.trusted, own.pareto_k if not own.trusted else -own.effective),
    )


def _weighed(
    density: SpreadDensity, mode: Array, middle: Array, covariance: Array, *, seed: int, size: int
) -> Spreads:
    c = len(middle)
    points = np.clip(
        qmc.Sobol(c + 1, rng=np.random.default_rng(seed)).random(size), 1e-12, 1.0 - 1e-12
    )
    chi = 2.0 * gammaincinv(0.5 * _FREEDOM, points[:, 0])
    white = ndtri(points[:, 1:]) * np.sqrt(_FREEDOM / chi)[:, None]
    limits = np.log(density.scale) - _DOWN, max(np.log(density.scale), float(mode.max())) + _UP
    t = np.clip(middle + white @ np.linalg.cholesky(covariance).T, *limits)
    log_weight = density.log(t) + 0.5 * (_FREEDOM + c) * np.log1p((white**2).sum(axis=1) / _FREEDOM)
    return Spreads(np.exp(t), log_weight, *pareto_smooth(log_weight), mode)
