"""Posterior density of the spreads of machines, and random draws from it.

c_m ~ N(μ, diag(s²)), b ~ N(0, I), μ_j ~ N(0, 1), s_j ~ HalfNormal(τ)

Everything is in units of the parameters' prior sd. c_m are the parameters of machine m, μ the mean
of the population, s the spreads, that is, the standard deviations of the machines about μ; b are
the instrument's errors. Given s, everything is Gaussian, so that c_m, μ and b are integrated out
exactly. ln s is drawn from a Student t distribution about its mode, and the draws are weighted
(importance sampling).

In the shapes of arrays, k is the number of values of s, n that of machines, c that of parameters,
and q that of parameters and instrument errors.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

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

__all__ = [
    "MachineEstimates",
    "SpreadDensity",
    "Spreads",
    "draw_spreads",
    "machine_estimates",
    "machine_likelihoods",
    "shared_quantities",
    "spread_slices",
]

# Number of pairs of a spread and a machine in one block of a computation, so that the block fits
# into the processor's cache.
_PAIRS_AT_ONCE = 4096
# Degrees of freedom of the Student t from which ln s is drawn.
_DEGREES_OF_FREEDOM = 5.0
# Step in ln s of the central differences that give the Hessian.
_DIFFERENCE_STEP = 1e-4
# Increase of the log density in one step below which the search for the mode ends [nat].
_MODE_GAIN = 1e-10
# How far ln s may lie below ln τ, and above the larger of ln τ and the mode.
_RANGE_BELOW = 80.0
_RANGE_ABOVE = 25.0
# Ratio of the effective to the actual number of draws above which no second set is drawn.
_EFFECTIVE_SHARE = 0.2
# Share of the covariance at the mode that is added to the covariance of the first set of draws, for
# drawing the second set.
_ADDED_VARIANCE = 0.05
# Smallest curvature of the log density at the mode; smaller eigenvalues are replaced by it.
_SMALLEST_CURVATURE = 1e-3
# Smallest distance of the coordinates of quasi-random points from 0 and 1.
_POINT_MARGIN = 1e-12


def machine_likelihoods(statistics: FleetStatistics) -> tuple[tuple[str, ...], Gaussian]:
    """Return the names of the machines and the likelihood of each, shape (n, q).

    The machines are in the order of their first campaigns. A machine's likelihood is the product of
    the likelihoods of its campaigns.

    Parameters
    ----------
    statistics : likelihoods of the campaigns.
    """
    machines = tuple(dict.fromkeys(statistics.machines))
    place_by_name = {name: place for place, name in enumerate(machines)}
    places = [place_by_name[name] for name in statistics.machines]
    precision = np.zeros((len(machines), *statistics.likelihood.precision.shape[1:]))
    shift = np.zeros((len(machines), *statistics.likelihood.shift.shape[1:]))
    np.add.at(precision, places, statistics.likelihood.precision)
    np.add.at(shift, places, statistics.likelihood.shift)
    return machines, Gaussian(precision, shift)


def spread_slices(spread: Array, likelihood: Gaussian) -> Iterator[slice]:
    """Yield slices that divide the spreads into blocks for the processor's cache.

    A block is so small that computing it for all machines fits into the cache.

    Parameters
    ----------
    spread : spreads s, shape (k, c).
    likelihood : likelihoods of the machines, shape (n, q).
    """
    size = max(1, _PAIRS_AT_ONCE // len(likelihood.shift))
    for start in range(0, len(spread), size):
        yield slice(start, start + size)


def shared_quantities(likelihood: Gaussian, spread: Array) -> Gaussian:
    """Return the Gaussian of mean and instrument errors (μ, b) given the spreads, shape (k, q).

    The attribute ``log_integral`` is ln p(y | s), the log density of all readings y given the
    spreads, up to a constant.

    Parameters
    ----------
    likelihood : likelihoods of the machines, shape (n, q).
    spread : spreads s, shape (k, c).
    """
    k, c = spread.shape
    q = likelihood.shift.shape[1]
    gram = np.empty((k, q + 1, q + 1))
    log_constant = np.empty(k)
    for rows in spread_slices(spread, likelihood):
        system = whitened(likelihood, spread[rows])
        flat = system[:, c:].transpose(2, 1, 0, 3).reshape(system.shape[2], q + 1, -1)
        gram[rows] = flat @ np.swapaxes(flat, 1, 2)
        log_constant[rows] = -np.log(system[range(c), range(c)]).sum(axis=(0, 2))
    return Gaussian(
        np.eye(q) + likelihood.precision.sum(axis=0) - gram[:, :q, :q],
        likelihood.shift.sum(axis=0) - gram[:, :q, q],
        log_constant + 0.5 * gram[:, q, q],
    )


class MachineEstimates(NamedTuple):
    """Moments of machines' parameters c_m and of z_m = (c_m − μ) / s, given the spreads s.

    Each array has shape (k, n, c).
    """

    mean: Array  #: mean of c_m
    sd: Array  #: standard deviation of c_m
    z_mean: Array  #: mean of z_m
    z_variance: Array  #: variance of z_m


def machine_estimates(likelihood: Gaussian, spread: Array, shared: Gaussian) -> MachineEstimates:
    """Return the posterior moments of every machine's parameters given the spreads.

    Parameters
    ----------
    likelihood : likelihoods of the machines, shape (n, q).
    spread : spreads s, shape (k, c).
    shared : Gaussian of (μ, b) given the spreads, see `shared_quantities`.
    """
    c = spread.shape[1]
    q = likelihood.shift.shape[1]
    root = np.swapaxes(shared.spread(), 1, 2)
    shape = (len(spread), len(likelihood.shift), c)
    estimates = MachineEstimates(np.empty(shape), np.empty(shape), np.empty(shape), np.empty(shape))
    for rows in spread_slices(spread, likelihood):
        system = whitened(likelihood, spread[rows], inverse=True)
        inverse = system[:, c + q + 1 :]
        s = spread[rows].T[..., None]
        gain = np.einsum("ijkn,irkn->jrkn", inverse, system[:, c : c + q + 1])
        z_response = gain[:, :q]
        z_mean = gain[:, q] - np.einsum("jrkn,kr->jkn", z_response, shared.mean[rows])
        c_response = np.eye(c, q)[..., None, None] - s[:, None] * z_response
        conditional_variance = (inverse**2).sum(axis=0)
        z_variance = conditional_variance + _explained_variance(root[rows], z_response)
        c_variance = s**2 * conditional_variance + _explained_variance(root[rows], c_response)
        c_mean = shared.mean[rows, :c].T[..., None] + s * z_mean
        estimates.mean[rows] = np.moveaxis(c_mean, 0, -1)
        estimates.sd[rows] = np.moveaxis(np.sqrt(c_variance), 0, -1)
        estimates.z_mean[rows] = np.moveaxis(z_mean, 0, -1)
        estimates.z_variance[rows] = np.moveaxis(z_variance, 0, -1)
    return estimates


def _explained_variance(root: Array, response: Array) -> Array:
    """Return the variance due to the uncertainty of (μ, b), shape (c, k, n).

    ``root`` is a square root of the covariance of (μ, b); ``response`` the sensitivity to (μ, b).
    """
    return np.asarray(((root @ response.transpose(0, 2, 1, 3)) ** 2).sum(axis=2))


@dataclass(frozen=True, eq=False)
class SpreadDensity:
    """Log posterior density ln p(t | y) of t = ln s given the readings y, up to a constant."""

    likelihood: Gaussian  #: likelihoods of the machines, shape (n, q)
    scale: float  #: scale τ of the spreads' prior, in units of the parameters' prior sd

    def log(self, t: Array) -> Array:
        """Return ln p(t | y), shape (k,), of t of shape (k, c)."""
        prior = (t - 0.5 * np.exp(2.0 * (t - np.log(self.scale)))).sum(axis=-1)
        shared = shared_quantities(self.likelihood, np.exp(t))
        return np.asarray(shared.log_integral + prior)

    def gradient(self, t: Array) -> Array:
        """Return ∂ ln p(t | y) / ∂ t, shape (k, c).

        The gradient is Σ_m (E[z_m² | y, s] − 1) with z_m = (c_m − μ) / s (Fisher's identity), plus
        the gradient of the log prior.
        """
        s = np.exp(t)
        shared = shared_quantities(self.likelihood, s)
        estimates = machine_estimates(self.likelihood, s, shared)
        of_machines = (estimates.z_mean**2 + estimates.z_variance - 1.0).sum(axis=1)
        return np.asarray(of_machines + 1.0 - (s / self.scale) ** 2)

    def derivatives(self, t: Array) -> tuple[Array, Array]:
        """Return the gradient (c,) and the Hessian (c, c) of the log density at one t."""
        c = len(t)
        step = _DIFFERENCE_STEP * np.eye(c)
        gradient = self.gradient(np.concatenate([t[None], t + step, t - step]))
        hessian = (gradient[1 : c + 1] - gradient[c + 1 :]) / (2.0 * _DIFFERENCE_STEP)
        return gradient[0], 0.5 * (hessian + hessian.T)

    def mode(self, start: Array) -> tuple[Array, Array]:
        """Return the mode of the density (c,) and the curvature matrix there (c, c).

        The curvature is the negative Hessian, changed if need be so that no eigenvalue is negative
        or near zero.
        """
        t = newton(self.log, self.derivatives, start, gain=_MODE_GAIN)
        _, hessian = self.derivatives(t)
        values, vectors = np.linalg.eigh(-hessian)
        curvature = (vectors * np.maximum(np.abs(values), _SMALLEST_CURVATURE)) @ vectors.T
        return t, np.asarray(curvature)


@dataclass(frozen=True, eq=False)
class Spreads:
    """Weighted random draws of the spreads s, in units of the parameters' prior sd."""

    spread: Array  #: draws of s, shape (k, c)
    log_weight: Array  #: ln (posterior density / density drawn from), not smoothed, shape (k,)
    weight: Array  #: weights, Pareto-smoothed and of sum one, shape (k,)
    pareto_k: float  #: Pareto's k̂, which is the larger the less the weights can be trusted
    good_k: float  #: value of Pareto's k̂ above which the draws cannot be trusted
    mode: Array  #: mode of the posterior density of ln s, shape (c,)

    @property
    def trusted(self) -> bool:
        """Return whether Pareto's k̂ is low enough for the draws to be trusted."""
        return self.pareto_k <= self.good_k

    @property
    def effective(self) -> float:
        """Return the effective number of draws, 1 / Σ w², with the weights w."""
        return 1.0 / float(np.sum(self.weight**2))

    def first(self, size: int) -> Spreads:
        """Return the first draws; as quasi-random points they too cover the range evenly."""
        log_weight = self.log_weight[:size]
        return _weight_draws(self.spread[:size], log_weight, self.mode)


def draw_spreads(
    density: SpreadDensity,
    parameters: int,
    *,
    seed: int,
    size: int = 2048,
    start: Array | None = None,
) -> Spreads:
    """Draw spreads from a Student t distribution about the mode of ln s, and weight them.

    If the weights of these draws are poor, a second set is drawn with the mean and covariance of
    the first set. The better set is returned.

    Parameters
    ----------
    density : posterior density of ln s.
    parameters : number c of parameters.
    seed : seed of the scrambled Sobol points.
    size : number of draws, a power of two.
    start : ln s at which the search for the mode begins, shape (c,); default: ln τ.
    """
    if start is None:
        start = np.full(parameters, np.log(density.scale))
    mode, curvature = density.mode(start)
    covariance = np.linalg.inv(curvature)
    about_mode = _draw_about(density, mode, mode, covariance, seed=seed, size=size)
    if about_mode.trusted and about_mode.effective > _EFFECTIVE_SHARE * size:
        return about_mode
    centre, own_covariance = mixture_covariance(about_mode.weight, np.log(about_mode.spread))
    widened = own_covariance + _ADDED_VARIANCE * covariance
    about_mean = _draw_about(density, mode, centre, widened, seed=seed + 1, size=size)
    return _better(about_mode, about_mean)


def _better(first: Spreads, second: Spreads) -> Spreads:
    """Return the better of two sets of draws.

    A set that can be trusted is better than one that cannot. Of two trusted sets, the better has
    the larger effective number of draws; of two others, the smaller Pareto's k̂.
    """
    if first.trusted != second.trusted:
        second_is_better = second.trusted
    elif first.trusted:
        second_is_better = second.effective > first.effective
    else:
        second_is_better = second.pareto_k < first.pareto_k
    return second if second_is_better else first


def _draw_about(
    density: SpreadDensity, mode: Array, centre: Array, covariance: Array, *, seed: int, size: int
) -> Spreads:
    c = len(centre)
    points = qmc.Sobol(c + 1, rng=np.random.default_rng(seed)).random(size)
    points = np.clip(points, _POINT_MARGIN, 1.0 - _POINT_MARGIN)
    chi_square = 2.0 * gammaincinv(0.5 * _DEGREES_OF_FREEDOM, points[:, 0])
    student_t = ndtri(points[:, 1:]) * np.sqrt(_DEGREES_OF_FREEDOM / chi_square)[:, None]
    log_scale = np.log(density.scale)
    lowest = log_scale - _RANGE_BELOW
    highest = max(log_scale, float(mode.max())) + _RANGE_ABOVE
    t = np.clip(centre + student_t @ np.linalg.cholesky(covariance).T, lowest, highest)
    squared_distance = (student_t**2).sum(axis=1)
    log_weight = density.log(t) + 0.5 * (_DEGREES_OF_FREEDOM + c) * np.log1p(
        squared_distance / _DEGREES_OF_FREEDOM
    )
    return _weight_draws(np.exp(t), log_weight, mode)


def _weight_draws(spread: Array, log_weight: Array, mode: Array) -> Spreads:
    weight, pareto_k, good_k = pareto_smooth(log_weight)
    return Spreads(spread, log_weight, weight, pareto_k, good_k, mode)
