"""Detection of machines that do not belong to the population of the other machines.

Every machine is left out in turn, and its parameters are compared with the prediction from the
other machines. The prediction is averaged over random draws of the spreads s (standard deviations
of the machines about the population's mean); all other unknowns are integrated out exactly. The
module `outlying_tests` finds outlying tests within one campaign by another method.

In the shapes of arrays, n is the number of machines, c the number of parameters, q the number of
parameters and instrument errors, and k the number of random draws of s. μ is the mean of the
population, and b are the errors of the instrument. The precision of a Gaussian is its inverse
covariance; its shift is the precision times the mean. z is the difference between the estimate of a
parameter from one machine alone and its prediction from the other machines, divided by the standard
deviation of this difference.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr, ndtri

from ldbb_bayes.analysis.multiple_testing import holm
from ldbb_bayes.fleet.deviations import Estimates, estimate_separately, factorize_deviations
from ldbb_bayes.fleet.spread_density import (
    SpreadDensity,
    Spreads,
    draw_spreads,
    shared_quantities,
    spread_slices,
)
from ldbb_bayes.inference.diagnostics import pareto_smooth
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.triangular import eliminate
from ldbb_bayes.results import Array

__all__ = ["JudgedMachines", "judge_machines"]

# Number of random draws of the spreads (standard deviations of machines about the mean of their
# population) that are made without the data of one machine. Usually the draws made with the data of
# all machines are reweighted instead. New draws are made only if these weights are not reliable.
_DRAWS_WITHOUT = 512
# Largest number of machines for which new random draws of the spreads (standard deviations of
# machines about the mean of their population) are made. If more machines need new draws, those with
# the smallest p-values get them.
_MOST_REDRAWN = 200
# Smallest p-value of a machine's parameter that is used. A smaller p-value is replaced with this
# number, so that the corresponding quantile of the normal distribution is finite.
_SMALLEST_P = 1e-300


@dataclass(frozen=True, eq=False)
class JudgedMachines:
    """Comparison of the c parameters of each of n machines with those of the other machines.

    The comparison shows which machines do not belong to the population of the other machines.
    """

    #: p-value of each of n machines, corrected for the number of parameters (Bonferroni) and for
    #: the number of machines (Holm), shape (n,). If all machines belong to one population, the
    #: probability that any machine has a p-value of at most p is itself at most p.
    p_value: Array
    #: two-sided p-value of each of c parameters of n machines, not corrected for the number of
    #: comparisons, shape (n, c)
    parameter_p_value: Array
    #: deviation of each of c parameters of n machines from the value that the other machines
    #: predict, shape (n, c). A deviation is stated as the quantile of the standard normal
    #: distribution that has the same two-sided p-value; it is positive if the parameter is above
    #: the prediction.
    z: Array
    #: array that is true for those of n machines whose p-values cannot be trusted, shape (n,). The
    #: p-values are computed from weighted random draws of the spreads (standard deviations from
    #: machine to machine). They cannot be trusted if the Pareto shape k̂ of the weights is too
    #: high.
    doubtful: Array


def judge_machines(
    density: SpreadDensity,
    spreads: Spreads,
    shared: Gaussian,
    *,
    seed: int,
    progress: Callable[[int, int], None] | None = None,
) -> JudgedMachines:
    """Return a comparison of every machine with the prediction from the other machines.

    The spreads s are the standard deviations of the machines' parameters about the mean μ of the
    population. Random draws of s are made from the posterior of s given all machines. For each
    machine, these draws are weighted so that they represent the posterior given the other machines.
    If the weights cannot be trusted, new draws are made from the posterior given the other
    machines. New draws are made for at most 200 machines, those with the smallest p-values first.

    Parameters
    ----------
    density : posterior density of ln s given all machines.
    spreads : random draws of s from this density.
    shared : Gaussian distribution of the mean μ and of the errors b of the instrument, given each
        draw of s and all machines; see `shared_quantities`.
    seed : seed of new draws of s.
    progress : function that is called with two numbers: the number of machines for which new draws
        have been made so far, and the total number of machines for which new draws will be made.
    """
    likelihood = density.likelihood
    n = len(likelihood.shift)
    c = spreads.spread.shape[1]
    separate = estimate_separately(likelihood, c)
    comparison = _compare_each_with_others(likelihood, separate, spreads.spread, shared)
    weights = np.empty((n, len(spreads.spread)))
    doubtful = np.empty(n, dtype=bool)
    for m in range(n):
        # The spreads s are the standard deviations of the machines about the population's mean. The
        # posterior of s given the other machines is the posterior of s given all machines, divided
        # by the density of the readings of machine m given s and the other machines.
        log_weight = spreads.log_weight - comparison.log_density[:, m]
        weights[m], pareto_k, good_k = pareto_smooth(log_weight)
        doubtful[m] = pareto_k > good_k
    p_value, side = _two_sided_p_value(weights, comparison.z)
    redrawn = np.flatnonzero(doubtful)
    by_p_value = np.argsort(p_value.min(axis=1)[redrawn], kind="stable")
    redrawn = redrawn[by_p_value][:_MOST_REDRAWN]
    for count, m in enumerate(redrawn.tolist(), start=1):
        new_spreads = _draw_spreads_without(m, density, mode=spreads.mode, seed=seed)
        new_z = _compare_with_others(m, density.likelihood, separate, new_spreads.spread)
        new_p_value, new_side = _two_sided_p_value(new_spreads.weight[None], new_z)
        doubtful[m] = not new_spreads.trusted
        p_value[m] = new_p_value[0]
        side[m] = new_side[0]
        if progress is not None:
            progress(count, len(redrawn))
    overall = holm(np.minimum(1.0, c * p_value.min(axis=1)))
    return JudgedMachines(overall, p_value, -side * ndtri(0.5 * p_value), doubtful)


class _Comparison(NamedTuple):
    """Comparison of each of n machines with the other machines, for k random draws of the spreads.

    Spreads are the standard deviations of the machines about the mean of their population.
    """

    #: log density ln p(y_m | y_−m, s), up to a constant, shape (k, n). y_m are the readings of
    #: machine m, one of n machines, and y_−m are the readings of all other machines. s is one of k
    #: random draws of the spreads (standard deviations from machine to machine).
    log_density: Array
    #: differences between the estimates of c parameters from one machine alone and the predictions
    #: from the other machines, divided by the standard deviations of these differences, shape (c,
    #: k, n). There are n machines and k random draws of the spreads (standard deviations from
    #: machine to machine).
    z: Array


def _compare_each_with_others(
    likelihood: Gaussian, separate: Estimates, spread: Array, shared: Gaussian
) -> _Comparison:
    """Return a comparison of each machine with the other machines, for k draws of the spreads.

    ``likelihood`` holds the likelihood of each machine, from all its campaigns. ``separate`` holds
    the estimates from each machine alone. ``spread``, shape (k, c), holds the draws of the spreads,
    which are the standard deviations of the machines' c parameters about the mean of the
    population. ``shared`` is the posterior of the population's mean and the instrument's errors,
    given each draw of the spreads and all machines.

    To leave machine m out, its contribution is subtracted from the precision matrix of ``shared``,
    and from the product of precision matrix and mean. The result contains the log density
    ln p(y_m | y_−m, s) = ln p(y | s) − ln p(y_−m | s). Here y are all readings, y_m the readings of
    machine m, y_−m the readings of the other machines, and s the spreads.
    """
    k, c = spread.shape
    n, q = likelihood.shift.shape
    log_density = np.empty((k, n))
    z = np.empty((c, k, n))
    log_integral = shared.log_integral - shared.log_constant
    for rows in spread_slices(spread, likelihood):
        factors = factorize_deviations(likelihood, spread[rows])
        gram = np.einsum("iakn,ibkn->abkn", factors.solved, factors.solved)
        precision_of_others = (
            np.moveaxis(shared.precision[rows], 0, -1)[..., None]
            - likelihood.precision.T[:, :, None]
            + gram[:q, :q]
        )
        shift_of_others = (
            shared.shift[rows].T[..., None] - likelihood.shift.T[:, None] + gram[:q, q]
        )
        prediction = _predict_from_others(
            separate, precision_of_others, shift_of_others, spread[rows]
        )
        log_determinant = np.log(factors.diagonal).sum(axis=0)
        log_machine = 0.5 * gram[q, q] - log_determinant
        log_density[rows] = log_integral[rows, None] + log_machine - prediction.log_integral
        z[:, rows] = prediction.z
    return _Comparison(log_density, z)


def _without_machine(m: int, likelihood: Gaussian) -> Gaussian:
    """Return the likelihoods of all machines except the machine with the index m."""
    other_machines = np.arange(len(likelihood.shift)) != m
    return Gaussian(likelihood.precision[other_machines], likelihood.shift[other_machines])


def _draw_spreads_without(m: int, density: SpreadDensity, *, mode: Array, seed: int) -> Spreads:
    """Return random draws of the spreads s given all machines except the machine with the index m.

    The spreads are the standard deviations of the machines' c parameters about the mean of the
    population. ``density`` is the posterior density of ln s given all machines, and ``mode`` is the
    mode of this density, shape (c,). ``seed`` is the seed of the draws.
    """
    other_machines = _without_machine(m, density.likelihood)
    density_of_others = SpreadDensity(other_machines, density.scale)
    return draw_spreads(density_of_others, len(mode), seed=seed, size=_DRAWS_WITHOUT, start=mode)


def _compare_with_others(m: int, likelihood: Gaussian, separate: Estimates, spread: Array) -> Array:
    """Return the deviations z of the machine with the index m, shape (c, k, 1).

    The deviation z of a parameter is the difference between its estimate from machine m alone and
    the prediction of this estimate from the other machines, divided by the standard deviation of
    this difference. The prediction includes the errors of the instrument, which all machines share.
    There are c parameters. ``spread``, shape (k, c), holds k draws of the spreads (standard
    deviations of the machines about the mean of their population). ``likelihood`` holds the
    likelihoods of all machines, and ``separate`` the estimates from each machine alone.
    """
    # For each draw of the spreads, ``shared`` holds the Gaussian density of the mean of the
    # population and the errors of the instrument. All machines share these q quantities. ``shift``
    # is the product of the precision and the mean of a Gaussian.
    shared = shared_quantities(_without_machine(m, likelihood), spread)
    machine = Estimates(
        separate.covariance[m : m + 1],
        separate.response[m : m + 1],
        separate.value[m : m + 1],
    )
    precision_of_others = np.moveaxis(shared.precision, 0, -1)[..., None]
    shift_of_others = shared.shift.T[..., None]
    return _predict_from_others(machine, precision_of_others, shift_of_others, spread).z


class _Prediction(NamedTuple):
    """Prediction of each of n machines from the other machines, for k draws of the spreads.

    Spreads are the standard deviations of the machines about the mean of their population.
    """

    #: logarithms of the integrals ∫ exp(ηᵀ x − ½ xᵀ P x) dx, up to a constant, shape (k, n). Each
    #: of n machines is left out in turn. There is one integral for each machine left out and each
    #: of k random draws of the spreads (standard deviations from machine to machine). x are the
    #: population's mean and the instrument's errors. P is the precision matrix (inverse covariance)
    #: of x given the spreads and the readings of all other machines, and η is P times the mean
    #: of x.
    log_integral: Array
    #: differences between the estimates of c parameters from one machine alone and the predictions
    #: from the other machines, divided by the standard deviations of these differences, shape (c,
    #: k, n). There are n machines and k random draws of the spreads (standard deviations from
    #: machine to machine).
    z: Array


def _predict_from_others(
    separate: Estimates, precision: Array, shift: Array, spread: Array
) -> _Prediction:
    """Predict the parameters of each machine from the readings of the other machines.

    Each of the n machines is left out in turn. The spreads (standard deviations of the machines
    about the population's mean μ) are taken from k random draws. For each draw and each machine
    left out, the posterior density of μ and of the instrument's errors b given the readings of the
    other machines is a Gaussian. μ and b together have q elements.

    Parameters
    ----------
    separate
        Estimates of the parameters of each machine, computed from its own readings alone.
    precision
        Inverse covariance matrices of the Gaussians, shape (q, q, k, n).
    shift
        Products of inverse covariance matrix and mean of the Gaussians, shape (q, k, n).
    spread
        Random draws of the spreads of the c parameters, shape (k, c).
    """
    q = len(shift)
    c = spread.shape[1]
    parameter_response = separate.response[..., :c]
    response = np.broadcast_to(separate.response.T[:, :, None], (q, c, *shift.shape[1:]))
    system = np.concatenate([precision, shift[:, None], response], axis=1)
    eliminate(system.reshape(1, *system.shape[:2], -1))
    standardised = system[:, q]
    gain = system[:, q + 1 :]
    log_determinant = np.log(system[range(q), range(q)]).sum(axis=0)
    # The parameters of the machine left out are estimated from its own readings, and predicted from
    # the other machines. The difference between estimate and prediction has three sources of
    # variance: the noise of the readings, the spread of the machines, and the uncertainty of the
    # population's mean μ and of the instrument's errors b.
    noise_variance = (parameter_response * separate.covariance).sum(axis=-1).T[:, None]
    spread_variance = np.einsum("ka,nja->jkn", spread**2, parameter_response**2)
    shared_variance = (gain**2).sum(axis=0)
    variance = shared_variance + spread_variance + noise_variance
    difference = separate.value.T[:, None] - (gain * standardised[:, None]).sum(axis=0)
    z = np.divide(
        difference, np.sqrt(variance), out=np.zeros_like(difference), where=variance > 0.0
    )
    return _Prediction(0.5 * (standardised**2).sum(axis=0) - log_determinant, z)


def _two_sided_p_value(weights: Array, z: Array) -> tuple[Array, Array]:
    """Return two-sided p-values of c parameters of n machines, and the sides of the deviations.

    ``z``, shape (c, k, n), holds the deviations from the prediction, divided by their standard
    deviations. There is one prediction for each of k random draws of the spreads, which are the
    standard deviations of the machines about the mean of their population. The tail probabilities
    above and below z are averaged over the draws; ``weights``, shape (n, k), holds the weights of
    the draws for each machine. A p-value is twice the smaller of the two averages. The side is 1
    for a deviation above the prediction, and −1 for a deviation below the prediction. Both arrays
    returned have the shape (n, c).
    """
    above = np.einsum("mk,jkm->mj", weights, ndtr(-z))
    below = np.einsum("mk,jkm->mj", weights, ndtr(z))
    p_value = np.clip(2.0 * np.minimum(above, below), _SMALLEST_P, 1.0)
    return p_value, np.where(above < below, 1.0, -1.0)
