"""Posterior density of the spreads of machines, and random draws from this density.

c_m ~ N(μ, diag(s²)), b ~ N(0, I), μ_j ~ N(0, 1), s_j ~ HalfNormal(τ)

All values are in units of the parameters' prior sds. c_m are the parameters of machine m, and μ is
the mean of the population. s are the spreads, that is, the standard deviations of the machines
about μ; the prior of the spreads has the scale τ. b are the instrument's errors; j is the index of
a parameter. Given s, all distributions are Gaussian, and c_m, μ and b are therefore integrated out
exactly. Values of ln s are drawn from a Student t distribution about the mode of the density of ln
s, and are weighted (importance sampling).

In the shapes of arrays, k is the number of values of s, n the number of machines, c the number of
parameters, and q the number of parameters and instrument errors.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import gammaincinv, ndtri
from scipy.stats import qmc

from ldbb_bayes.fleet.campaign_statistics import mixture_covariance
from ldbb_bayes.fleet.deviations import factorize_deviations
from ldbb_bayes.fleet.fleet_statistics import FleetStatistics
from ldbb_bayes.fleet.machine_effects import without_effects
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

# Random draws of the spreads (standard deviations between machines) are processed in groups. The
# number of draws in a group times the number of machines is at most this number, so that the arrays
# fit into the processor's cache.
_PAIRS_AT_ONCE = 4096
# Degrees of freedom of the Student t distribution from which ln s is drawn. s are the spreads
# (standard deviations between machines).
_DEGREES_OF_FREEDOM = 5.0
# Step of ln s in the central differences from which the Hessian of the log density of ln s is
# computed. s are the spreads (standard deviations between machines).
_DIFFERENCE_STEP = 1e-4
# The search for the mode of the density of ln s ends when a step increases the log density by less
# than this number [nat]. s are the spreads (standard deviations between machines).
_MODE_GAIN = 1e-10
# The spreads s are the standard deviations between machines, and τ is the scale of their prior.
# Random draws of ln s are limited to a range. It begins ``_RANGE_BELOW`` below ln τ, and ends
# ``_RANGE_ABOVE`` above the larger of two numbers: ln τ, and the largest element of the mode of
# ln s.
_RANGE_BELOW = 80.0
_RANGE_ABOVE = 25.0
# The random draws of the spreads (standard deviations between machines) have weights. A second set
# of draws is made if the effective sample size of the first set is below this fraction of the
# number of draws, or if the largest weights are too large to be trusted.
_EFFECTIVE_SHARE = 0.2
# If the machines' spreads (standard deviations about their mean) are drawn a second time, the
# covariance for these draws is that of the first draws plus a small addition. The addition is this
# fraction of the covariance that follows from the curvature of the density at its mode.
_ADDED_VARIANCE = 0.05
# Smallest eigenvalue of the curvature matrix at the mode of the density of ln s; smaller
# eigenvalues are replaced by this number. s are the spreads (standard deviations between machines).
_SMALLEST_CURVATURE = 1e-3
# Coordinates of quasi-random points are kept at least this far from 0 and from 1, because the
# quantiles of the normal distribution at 0 and 1 are infinite.
_POINT_MARGIN = 1e-12


def machine_likelihoods(statistics: FleetStatistics) -> tuple[tuple[str, ...], Gaussian]:
    """Return the names of n machines, and the likelihood of q quantities of each machine.

    The quantities are the parameters of the machine, then the errors of the instrument. The
    machines are in the order of their first campaigns. A machine's likelihood is the product of the
    likelihoods of its campaigns, in which the effects that the machine keeps are integrated out.
    The likelihoods have the shape (n, q).

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
    likelihood = Gaussian(precision, shift)
    return machines, without_effects(likelihood, len(statistics.machine))


def spread_slices(spread: Array, likelihood: Gaussian) -> Iterator[slice]:
    """Divide the k values of the spreads into slices, and yield the slices one after another.

    Spreads are standard deviations between machines. A slice is so small that the arrays for its
    values and for all machines fit into the processor's cache.

    Parameters
    ----------
    spread : k values of the spreads of c parameters, shape (k, c).
    likelihood : likelihoods of q parameters and instrument errors from n machines, shape (n, q).
    """
    size = max(1, _PAIRS_AT_ONCE // len(likelihood.shift))
    for start in range(0, len(spread), size):
        yield slice(start, start + size)


def shared_quantities(likelihood: Gaussian, spread: Array) -> Gaussian:
    """Return the distribution of the mean μ and the errors b for k values of the spreads s.

    μ is the mean of the population, b are the errors of the instrument, and s are the standard
    deviations of the machines about μ. For each value of s, the distribution is Gaussian. Its q
    quantities are the c elements of μ, then the elements of b. The distributions have the shape (k,
    q). The attribute ``log_integral`` is ln p(y | s), the log density of all readings y given the
    spreads, up to a constant. All values are in units of the prior sds.

    Parameters
    ----------
    likelihood : likelihoods of q parameters and instrument errors from n machines, shape (n, q).
    spread : k values of the spreads s of the c parameters, shape (k, c).
    """
    k = len(spread)
    q = likelihood.shift.shape[1]
    gram = np.empty((k, q + 1, q + 1))
    log_constant = np.empty(k)
    for rows in spread_slices(spread, likelihood):
        factors = factorize_deviations(likelihood, spread[rows])
        draws = factors.solved.shape[2]
        flat = factors.solved.transpose(2, 1, 0, 3).reshape(draws, q + 1, -1)
        gram[rows] = flat @ np.swapaxes(flat, 1, 2)
        log_constant[rows] = -np.log(factors.diagonal).sum(axis=(0, 2))
    return Gaussian(
        np.eye(q) + likelihood.precision.sum(axis=0) - gram[:, :q, :q],
        likelihood.shift.sum(axis=0) - gram[:, :q, q],
        log_constant + 0.5 * gram[:, q, q],
    )


class MachineEstimates(NamedTuple):
    """Estimates of the parameters of n machines, for each of k values of the spreads.

    The spreads s are the standard deviations of the parameters from machine to machine, and μ is
    the mean of the population. The vector c_m holds the parameters of machine m. The vector
    z_m = (c_m − μ) / s holds the distances of these parameters from μ in units of the spreads.
    """

    #: posterior means of the machines' parameters for each value of the spreads (standard
    #: deviations from machine to machine), in units of the parameters' prior sds, shape (k, n, c)
    mean: Array
    #: posterior standard deviations of the machines' parameters for each value of the spreads
    #: (standard deviations from machine to machine), in units of the parameters' prior sds, shape
    #: (k, n, c)
    sd: Array
    #: posterior means of the distances z_m = (c_m − μ) / s, shape (number of values of s, number of
    #: machines, number of parameters). The vector c_m holds the parameters of machine m, μ is the
    #: population's mean, and s are the spreads (standard deviations of the machines about μ).
    z_mean: Array
    #: posterior variances of the distances z_m = (c_m − μ) / s, shape (number of values of s,
    #: number of machines, number of parameters). The vector c_m holds the parameters of machine m,
    #: μ is the population's mean, and s are the spreads (standard deviations of the machines
    #: about μ).
    z_variance: Array


def machine_estimates(likelihood: Gaussian, spread: Array, shared: Gaussian) -> MachineEstimates:
    """Return estimates of every machine's parameters for k given values of the spreads.

    Spreads are the standard deviations of the machines about the mean of their population.

    Parameters
    ----------
    likelihood : likelihoods of q parameters and instrument errors from n machines, shape (n, q).
    spread : k values of the spreads of the c parameters, shape (k, c).
    shared : Gaussian distribution of the population's mean and the instrument's errors, for each
        value of the spreads, see `shared_quantities`.
    """
    c = spread.shape[1]
    q = likelihood.shift.shape[1]
    root = np.swapaxes(shared.spread(), 1, 2)
    shape = (len(spread), len(likelihood.shift), c)
    estimates = MachineEstimates(
        mean=np.empty(shape),
        sd=np.empty(shape),
        z_mean=np.empty(shape),
        z_variance=np.empty(shape),
    )
    for rows in spread_slices(spread, likelihood):
        factors = factorize_deviations(likelihood, spread[rows], inverse=True)
        s = spread[rows].T[..., None]
        gain = np.einsum("ijkn,irkn->jrkn", factors.inverse, factors.solved)
        # The parameters of a machine are c_m = μ + s z, with the population's mean μ. If μ and the
        # instrument's errors b are given, the posterior of z has the covariance
        # (I + s Λ_cc s)⁻¹ = L⁻ᵀ L⁻¹, where L is a Cholesky factor and Λ_cc is the precision matrix
        # of the parameters in the machine's likelihood. The mean of z is linear in the vector
        # (μ, b): it is the last column of ``gain`` minus the matrix ``z_response`` times (μ, b).
        z_response = gain[:, :q]
        z_mean = gain[:, q] - np.einsum("jrkn,kr->jkn", z_response, shared.mean[rows])
        c_response = np.eye(c, q)[..., None, None] - s[:, None] * z_response
        conditional_variance = (factors.inverse**2).sum(axis=0)
        z_variance = conditional_variance + _explained_variance(root[rows], z_response)
        c_variance = s**2 * conditional_variance + _explained_variance(root[rows], c_response)
        c_mean = shared.mean[rows, :c].T[..., None] + s * z_mean
        estimates.mean[rows] = np.moveaxis(c_mean, 0, -1)
        estimates.sd[rows] = np.moveaxis(np.sqrt(c_variance), 0, -1)
        estimates.z_mean[rows] = np.moveaxis(z_mean, 0, -1)
        estimates.z_variance[rows] = np.moveaxis(z_variance, 0, -1)
    return estimates


def _explained_variance(root: Array, response: Array) -> Array:
    """Return the variances that are due to the uncertainty of μ and b, shape (c, k, n).

    μ are the means of the c parameters over the population, and b are the instrument's errors.
    Together, μ and b have q elements. The variances are those of the parameters c_m of n machines,
    or those of z = (c_m − μ) / s. They are computed for k values of the spreads s (standard
    deviations of the machines about μ). ``root``, shape (k, q, q), is the transposed square root of
    the covariance of μ and b. ``response``, shape (c, q, k, n), holds the derivatives of the
    parameters, or of z, with respect to μ and b. The sign of the derivatives does not matter.
    """
    return np.asarray(((root @ response.transpose(0, 2, 1, 3)) ** 2).sum(axis=2))


@dataclass(frozen=True, eq=False)
class SpreadDensity:
    """Posterior density of t = ln s given the readings y, for the spreads s of machines.

    Spreads are the standard deviations of the machines about the mean of their population, one for
    each parameter.
    """

    #: Gaussian likelihood of q quantities from the readings on each of n machines, shape (n, q).
    #: The quantities are the parameters of the machine, then the errors of the instrument.
    likelihood: Gaussian
    #: scale τ of the half-normal prior of the spreads (standard deviations from machine to
    #: machine), in units of the parameters' prior sd
    scale: float

    def log(self, t: Array) -> Array:
        """Return ln p(t | y) up to a constant, shape (k,), for k values of t = ln s, shape (k, c).

        s are the spreads (standard deviations between machines) of the c parameters; y are the
        readings.
        """
        prior = (t - 0.5 * np.exp(2.0 * (t - np.log(self.scale)))).sum(axis=-1)
        shared = shared_quantities(self.likelihood, np.exp(t))
        return np.asarray(shared.log_integral + prior)

    def gradient(self, t: Array) -> Array:
        """Return the gradient ∂ ln p(t | y) / ∂ t for k values of t = ln s, shape (k, c).

        s are the spreads (standard deviations between machines) of the c parameters, and y are the
        readings. ``t`` and the result have the shape (k, c). By Fisher's identity, the gradient is
        Σ_m (E[z_m² | y, s] − 1) plus the gradient of the log prior. Here z_m = (c_m − μ) / s. The
        vector c_m holds the parameters of machine m, and μ the means of the parameters over the
        population.
        """
        s = np.exp(t)
        shared = shared_quantities(self.likelihood, s)
        estimates = machine_estimates(self.likelihood, s, shared)
        of_machines = (estimates.z_mean**2 + estimates.z_variance - 1.0).sum(axis=1)
        return np.asarray(of_machines + 1.0 - (s / self.scale) ** 2)

    def derivatives(self, t: Array) -> tuple[Array, Array]:
        """Return the gradient (c,) and the Hessian (c, c) of the log density of t = ln s at ``t``.

        ``t`` has the shape (c,). s are the spreads (standard deviations between machines) of the c
        parameters.
        """
        c = len(t)
        step = _DIFFERENCE_STEP * np.eye(c)
        gradient = self.gradient(np.concatenate([t[None], t + step, t - step]))
        hessian = (gradient[1 : c + 1] - gradient[c + 1 :]) / (2.0 * _DIFFERENCE_STEP)
        return gradient[0], 0.5 * (hessian + hessian.T)

    def mode(self, start: Array) -> tuple[Array, Array]:
        """Return the mode of the density of ln s, shape (c,), and the curvature there, (c, c).

        s are the spreads (standard deviations between machines) of the c parameters. ``start``,
        shape (c,), is the value of ln s at which the search begins. The curvature is the negative
        Hessian of the log density. Negative eigenvalues of the curvature are replaced by their
        absolute values, and eigenvalues near zero are increased.
        """
        t = newton(self.log, self.derivatives, start, gain=_MODE_GAIN)
        _, hessian = self.derivatives(t)
        values, vectors = np.linalg.eigh(-hessian)
        curvature = (vectors * np.maximum(np.abs(values), _SMALLEST_CURVATURE)) @ vectors.T
        return t, np.asarray(curvature)


@dataclass(frozen=True, eq=False)
class Spreads:
    """Weighted random draws of the machines' spreads s, in units of the parameters' prior sd.

    Spreads are the standard deviations of the machines about the mean of their population.
    """

    #: k random draws of the spreads (standard deviations from machine to machine) of c parameters,
    #: in units of the parameters' prior sd, shape (k, c)
    spread: Array
    #: log importance weights of k random draws of the spreads (standard deviations from machine to
    #: machine), shape (k,). The weight of a draw is the posterior density divided by the density
    #: from which it was drawn, up to a constant factor.
    log_weight: Array
    #: Pareto-smoothed importance weights of the k random draws of the spreads (standard deviations
    #: from machine to machine), shape (k,). They sum to one.
    weight: Array
    #: Pareto shape k̂ of the weights of the random draws of the spreads (standard deviations from
    #: machine to machine); the larger k̂ is, the less reliable are the weights
    pareto_k: float
    #: upper limit of ``pareto_k``; above it, the random draws of the spreads (standard deviations
    #: from machine to machine) cannot be trusted
    good_k: float
    #: mode of the posterior density of ln s, shape (c,); s are the spreads (standard deviations
    #: from machine to machine) of c parameters
    mode: Array

    @property
    def trusted(self) -> bool:
        """Whether ``pareto_k`` is low enough to trust the random draws of the spreads.

        Spreads are standard deviations between machines.
        """
        return self.pareto_k <= self.good_k

    @property
    def effective(self) -> float:
        """Effective sample size 1 / Σ w² of the draws of the spreads.

        The weights w of the draws sum to one.
        """
        return 1.0 / float(np.sum(self.weight**2))

    def first(self, size: int) -> Spreads:
        """Return the first ``size`` random draws of the spreads, with weights that sum to one.

        The draws are made from quasi-random points. The first draws alone therefore cover the range
        of all draws evenly. Their weights are computed anew.
        """
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
    """Return weighted random draws of the spreads s from their posterior density.

    Spreads are the standard deviations of the machines about the mean of their population, in units
    of the parameters' prior standard deviations. Values of ln s are drawn from a Student t
    distribution about the mode of the density of ln s. If the weights of these draws are unreliable
    or too unequal, a second set is drawn. It is drawn about the mean of the first set, with a
    slightly larger covariance. The better of the two sets is returned.

    Parameters
    ----------
    density : posterior density of ln s.
    parameters : number c of parameters, each of which has a spread.
    seed : seed of the scrambled Sobol points.
    size : number of draws, a power of two.
    start : value of ln s at which the search for the mode begins, shape (c,). Default: ln τ for
        every parameter, where τ is the scale of the prior of the spreads.
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
    """Return the better of two sets of weighted random draws of the machines' spreads.

    Spreads are standard deviations between machines. A set whose weights can be trusted is better
    than a set whose weights cannot be trusted. Of two trusted sets, the set with the larger
    effective sample size is better. Of two sets that cannot be trusted, the set whose weights have
    the smaller Pareto's k̂ is better.
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
    """Return weighted draws of the spreads s; ln s is drawn from a Student t distribution.

    Spreads are the standard deviations of the c parameters between machines. ``centre``, shape
    (c,), is the centre of the t distribution of ln s, and ``covariance``, shape (c, c), is its
    scale matrix. ``size`` is the number of draws, which are made from quasi-random points. ``seed``
    is the seed of these points. ``mode``, shape (c,), is the mode of the posterior density of ln s,
    given by ``density``. The mode is used only to limit the range of the draws.
    """
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
    """Return k draws of the spreads s with Pareto-smoothed weights.

    ``spread`` are the draws, shape (k, c), and ``log_weight`` the logarithms of their importance
    weights, shape (k,). ``mode`` is the mode of the density of ln s, shape (c,), for the c
    parameters of the machines.
    """
    weight, pareto_k, good_k = pareto_smooth(log_weight)
    return Spreads(spread, log_weight, weight, pareto_k, good_k, mode)
