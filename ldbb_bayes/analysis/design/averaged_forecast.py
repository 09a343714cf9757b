"""Forecast of uncertainties that are averaged over constant and linear compliance.

The sheets of a report state the posterior that `average` gives: an average over models with
constant and with linear compliance, each with and without the other effects that look like a change
of compliance with force (rivals). Before tests are run, the uncertainties of this average depend on
which of the models will be probable. The forecast therefore draws possible machines from the
posterior of all models given the pilot's readings (or, without readings, from their priors):
machines with and without slopes, with and without each rival. For each machine, it simulates the
analysis of the planned tests under every model, and averages the results by the probabilities that
this analysis gives to the models (`nested_models`).

Apart from that, machines and analyses are those of `forecast`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import softmax

from ldbb_bayes.analysis.design.reference_estimates import draw_reference_estimates
from ldbb_bayes.analysis.design.simulated_analyses import (
    LIKELY,
    SimulatedAnalyses,
    precision_added_by_slope_priors,
)
from ldbb_bayes.analysis.design.states import extend_hyper_parameters
from ldbb_bayes.analysis.nested_models import Coefficients, NestedModels, averaged_variances
from ldbb_bayes.analysis.truncated_moments import symmetric_root
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array, Result

__all__ = ["AveragedUncertainty", "averaged_uncertainties"]


@dataclass(frozen=True)
class AveragedUncertainty(Result):
    """Uncertainty to expect for one parameter, averaged over constant and linear compliance."""

    unit: str  #: internal unit of the parameter, composed of mm, N and rad
    #: median, over the possible machines, of the standard uncertainty of the parameter
    sd: float
    #: the standard uncertainty of the parameter is at most this value on 90 % of the machines
    likely_sd: float


class _Machines(NamedTuple):
    """K possible machines, some with constant compliance and some without each of the rivals."""

    #: indices of the machines' hyper-parameters among the states of the simulated analyses, shape
    #: (K,)
    state: Array
    #: coefficients of the machines (parameters, then those of the rivals) minus prior means, in
    #: units of the prior standard deviations, shape (K, q)
    coefficients: Array


@one_blas_thread
def averaged_uncertainties(analyses: SimulatedAnalyses) -> dict[str, AveragedUncertainty]:
    """Return the uncertainties to expect from planned tests, averaged over constant and linear.

    They are those that the sheets of a report will state. The keys are the names of the compliances
    and geometric errors, without slopes. The result is empty if the model has no linear compliance
    or flat priors.

    Parameters
    ----------
    analyses
        Simulated analyses of the planned tests under the model with linear compliance.
    """
    models = NestedModels.of(analyses.bound)
    if models is None or analyses.believed_phi is None:
        return {}
    rng = np.random.default_rng(analyses.seed)
    known = _known_before(models, analyses)
    machines = _draw_machines(models, known, rng)
    believed_phi = analyses.believed_phi[machines.state]
    sd = np.sqrt(_stated_variances(models, analyses, known, machines, believed_phi))
    uncertainties = {}
    for k, name in models.stated.items():
        uncertainties[name] = AveragedUncertainty(
            unit=models.bound.parameters[k].unit,
            sd=float(np.median(sd[:, k])),
            likely_sd=float(np.quantile(sd[:, k], LIKELY, method="weibull")),
        )
    return uncertainties


def _known_before(models: NestedModels, analyses: SimulatedAnalyses) -> Coefficients:
    """Return what is known of the q coefficients before the planned tests, in each of K states.

    A state is a set of hyper-parameters. The result is the posterior given the pilot's readings or,
    without readings, the prior. The condition that no compliance is negative is left out.
    """
    bound = models.bound
    phi = analyses.states.phi
    q = len(models.prior_sd)
    pilot = bound.pilot or bound.campaign
    of_pilot = None
    if not pilot.is_plan:
        of_pilot = NestedModels.of(bound.model.bind(pilot))
    if of_pilot is None:
        return Coefficients(np.zeros((len(phi), q)), np.tile(np.eye(q), (len(phi), 1, 1)))
    aligned = _aligned(of_pilot, of_pilot.coefficients_given(phi), models)
    # A coefficient may have a narrower prior in the plan than in the pilot, because of a new
    # certificate. Its prior precision increases accordingly.
    ratio = aligned.prior_sd / models.prior_sd
    precision = np.linalg.inv(aligned.covariance * np.outer(ratio, ratio))
    shift = np.einsum("kij,kj->ki", precision, aligned.mean * ratio)
    precision += np.diag(1.0 - ratio**-2.0)
    known = np.linalg.inv(precision)
    return Coefficients(np.einsum("kij,kj->ki", known, shift), known)


class _AlignedCoefficients(NamedTuple):
    """What the pilot says of the q coefficients of a plan, in the order of the plan.

    Coefficients that the pilot does not have are as in the prior of the plan.
    """

    mean: Array  # means minus prior means, in prior standard deviations of the pilot, shape (K, q)
    covariance: Array  # covariances in the same units, shape (K, q, q)
    prior_sd: Array  # prior standard deviations in the pilot's model, shape (q,)


def _aligned(
    pilot: NestedModels, known: Coefficients, models: NestedModels
) -> _AlignedCoefficients:
    """Return the pilot's coefficients in the order of the plan's, without those of the pilot alone.

    A plan of fewer planes than the pilot lacks the joint load of the axes that do not move in it.
    ``known`` are the coefficients that the pilot leaves likely, in each of K states.
    """
    q = len(models.names)
    states = len(known.mean)
    common = [name for name in models.names if name in pilot.names]
    in_plan = [models.names.index(name) for name in common]
    in_pilot = [pilot.names.index(name) for name in common]
    prior_sd = models.prior_sd.copy()
    prior_sd[in_plan] = pilot.prior_sd[in_pilot]
    mean = np.zeros((states, q))
    covariance = np.tile(np.eye(q), (states, 1, 1))
    for state in range(states):
        mean[state, in_plan] = known.mean[state, in_pilot]
        of_pilot = known.covariance[state][np.ix_(in_pilot, in_pilot)]
        covariance[state][np.ix_(in_plan, in_plan)] = of_pilot
    return _AlignedCoefficients(mean, covariance, prior_sd)


def _draw_machines(
    models: NestedModels, known: Coefficients, rng: np.random.Generator
) -> _Machines:
    """Draw K possible machines from the average over all models, one for each of K states.

    ``known`` are the coefficients of the largest model in each state, before the planned tests. A
    machine has no negative compliance; machines for which none is found are left out.
    """
    states, q = known.mean.shape
    log_ratios = []
    restricted = []
    for model in range(len(models.zeros)):
        log_ratio, given_zeros = models.restrict(model, known, np.ones(q))
        log_ratios.append(log_ratio + models.log_inside(model, given_zeros))
        restricted.append(given_zeros)
    # The states are equally likely under the largest model, which is the first, if no compliance is
    # negative.
    log_ratios = [log_ratio - log_ratios[0] for log_ratio in log_ratios]
    # The pairs of a model and a state have the probabilities ``probability``. As many pairs as
    # there are states are drawn, with equal steps through the cumulative probabilities.
    probability = softmax(np.array(log_ratios)).ravel()
    steps = (np.arange(states) + rng.random()) / states
    pairs = np.searchsorted(np.cumsum(probability), steps)
    pairs = np.minimum(pairs, probability.size - 1)
    model_of, state_of = np.divmod(pairs, states)
    mean = np.array([entry.mean for entry in restricted])[model_of, state_of]
    covariance = np.array([entry.covariance for entry in restricted])[model_of, state_of]
    coefficients = np.empty((states, q))
    is_possible = np.ones(states, bool)
    root = symmetric_root(covariance)
    bound = models.bound
    p = len(bound.names)
    if not bound.truncation.active:
        standard = rng.standard_normal((states, q))
        return _Machines(state_of, mean + np.einsum("kij,kj->ki", root, standard))
    # All machines of one model have the same constraints on their coefficients.
    for model in np.unique(model_of):
        of_model = np.flatnonzero(model_of == model)
        parameters = bound.prior_mean + mean[of_model][:, :p] * bound.scale
        spread = root[of_model][:, :p] * bound.scale[:, None]
        orthants = bound.truncation.orthants(parameters, spread)
        standard, is_possible[of_model] = orthants.draw_standard(rng)
        coefficients[of_model] = mean[of_model] + np.einsum("kij,kj->ki", root[of_model], standard)
    return _Machines(state_of[is_possible], coefficients[is_possible])


def _stated_variances(
    models: NestedModels,
    analyses: SimulatedAnalyses,
    known: Coefficients,
    machines: _Machines,
    believed_phi: Array,
) -> Array:
    """Return the averaged variances that analyses of the planned tests state, shape (K, p).

    ``known`` are the coefficients in each state before the planned tests, and ``machines`` are the
    K possible machines. ``believed_phi``, shape (K, n, h), are n sets of the h hyper-parameters
    that the analysis of each machine finds likely. The variances are in internal units (products of
    powers of mm, N and rad).
    """
    bound = models.bound
    number, beliefs, h = believed_phi.shape
    q = len(models.prior_sd)
    of_beliefs = models.coefficients_given(believed_phi.reshape(-1, h))
    covariance = of_beliefs.covariance.reshape(number, beliefs, q, q)
    identity = np.eye(q)
    before = Coefficients(np.zeros((number, q)), np.tile(identity, (number, 1, 1)))
    if analyses.tests_run:
        before = Coefficients(known.mean[machines.state], known.covariance[machines.state])
    precision_before = np.linalg.inv(before.covariance)
    added = np.zeros((number, q))
    if bound.model.prior.slopes_of_estimate:
        added[:, : len(bound.names)] = _added_precision(
            models, analyses, before, machines, covariance
        )
    # The analysis of each machine sizes the priors of the slopes anew; their means are zero.
    shift = np.einsum("kij,kj->ki", precision_before, before.mean)
    precision_before = precision_before + identity * added[:, None]
    mean_before = np.linalg.solve(precision_before, shift[..., None])[..., 0]
    covariance = np.linalg.inv(np.linalg.inv(covariance) + (identity * added[:, None])[:, None])
    means = _posterior_means(
        Coefficients(mean_before, precision_before),
        machines.coefficients,
        covariance,
        np.random.default_rng(analyses.seed).standard_normal((number, q)),
    )
    posteriors = models.posteriors(Coefficients(means, covariance), 1.0 + added[:, None])
    return averaged_variances(posteriors, np.zeros(1))


def _added_precision(
    models: NestedModels,
    analyses: SimulatedAnalyses,
    before: Coefficients,
    machines: _Machines,
    covariance: Array,
) -> Array:
    """Return by how much the analyses change the prior precisions of the slopes, shape (K, p).

    See `precision_added_by_slope_priors`. If tests have already been run, the estimates by which
    the slopes are sized are taken to be posterior means. ``covariance``, shape (K, n, q, q), holds
    posterior covariances of the coefficients on each of the K machines.
    """
    bound = models.bound
    p = len(bound.names)
    if analyses.tests_run == 0:
        phi = extend_hyper_parameters(bound, analyses.states.phi, 0, scattering=True)
        beta = bound.prior_mean + machines.coefficients[:, :p] * bound.scale
        estimates = draw_reference_estimates(bound, phi[machines.state], beta, analyses.seed)
        return precision_added_by_slope_priors(bound, estimates)
    rng = np.random.default_rng(analyses.seed)
    means = _posterior_means(
        Coefficients(before.mean, np.linalg.inv(before.covariance)),
        machines.coefficients,
        covariance,
        rng.standard_normal(before.mean.shape),
    )
    estimates = bound.prior_mean + means.mean(axis=1)[:, :p] * bound.scale
    return precision_added_by_slope_priors(bound, estimates)


def _posterior_means(
    before: Coefficients, truth: Array, covariance: Array, standard: Array
) -> Array:
    """Draw posterior means of the q coefficients, shape (K, n, q).

    They are for K machines and n sets of hyper-parameters each. Let m₁ be the mean and P₁ the
    precision before the tests (here the second field of ``before``), C the covariance after them,
    and W = 1 − C P₁. On a machine with the coefficients β, the posterior mean has the mean m₁ + W
    (β − m₁) and the covariance W C. ``truth``, shape (K, q), are the machines' coefficients,
    ``covariance``, shape (K, n, q, q), is C, and ``standard``, shape (K, q), are standard normal
    numbers. They are the same for all n sets of hyper-parameters, because these belong to the same
    readings.
    """
    mean, precision = before
    weight = np.eye(truth.shape[1]) - covariance @ precision[:, None]
    root = symmetric_root(weight @ covariance)
    deviation = truth - mean
    return np.asarray(
        mean[:, None]
        + np.einsum("knij,kj->kni", weight, deviation)
        + np.einsum("knij,kj->kni", root, standard)
    )
