"""Simulated analyses of tests that have not been run: the uncertainties that they would state.

β are the parameters: compliances, their slopes (changes of compliances with force) and geometric
errors. φ are the hyper-parameters, such as the standard deviation of the noise. What is known of
them before the tests is the posterior given the readings of a pilot (the campaign that a design
starts from) or, if there are no readings, the prior.

A state is one possible machine: values of φ and β, drawn from this distribution. In every state,
the size of the noise differs from circle to circle. The analysis of the tests does not know φ; its
posterior of φ is represented by several draws (`believed_scales`). The variance that the analysis
states for a parameter is the mean of its variances given these draws, plus the variance of its
estimates over these draws. The stated variance accounts for the condition that no compliance is
negative.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ldbb_bayes.analysis.design.believed_scales import believed_scales
from ldbb_bayes.analysis.design.bound_plans import bind_plan
from ldbb_bayes.analysis.design.reference_estimates import draw_reference_estimates, prior_medians
from ldbb_bayes.analysis.design.slope_priors_of_pilot import with_slope_priors_of_pilot
from ldbb_bayes.analysis.design.states import States, extend_hyper_parameters, states_before
from ldbb_bayes.analysis.truncated_moments import symmetric_root, truncated_moments
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.errors import require
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.hybrid import BoundModel, HybridModel
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array

__all__ = [
    "LIKELY",
    "SEED",
    "SimulatedAnalyses",
    "StatedByMachines",
    "analyses_on_machines",
    "precision_added_by_slope_priors",
    "simulate_analyses",
    "stated_by_machines",
    "stated_variances",
    "states_of",
    "tests_already_run",
]

# Default number of possible machines.
_STATES = 64
# Number of posterior draws of the hyper-parameters for each possible machine. The posterior
# variance of a parameter is computed from these draws.
_BELIEFS = 4
# Number of posterior means of the parameters that are drawn at random for each possible machine, if
# the forecast assumes that the hyper-parameters are known. Several means are drawn because the
# posterior mean depends on the readings, which are not known yet.
_MEANS_PER_STATE = 4
# Probability that the standard uncertainty of a parameter is at most the forecast value
# `Expected.likely_sd`, on one more machine like the possible machines.
LIKELY = 0.9
# Default seed of the random numbers. It is the same for all forecasts, so that two forecasts of one
# plan agree to the last digit.
SEED = 1


@dataclass(frozen=True, eq=False)
class SimulatedAnalyses:
    """Analyses of planned tests that are simulated on K possible machines.

    A possible machine is a random draw of the parameters and hyper-parameters.
    """

    #: model applied to the tests that have already been run, followed by the planned tests
    bound: BoundModel
    tests_run: int  #: number of tests that have already been run
    #: the K possible machines before the planned tests, and what is known about them
    states: States
    #: the same K possible machines, with the prior that each analysis uses. The prior sd of a slope
    #: depends on the compliance that the analysis estimates.
    states_of_analyses: States
    #: covariances of the p parameters that the analysis of each machine finds for n random draws
    #: from the posterior of the hyper-parameters, shape (K, n, p, p), in units of the prior
    #: standard deviations of ``bound``. They are computed as if compliances could be negative.
    covariance: Array
    #: the n random draws of the h hyper-parameters for each of the K machines, shape (K, n, h),
    #: with lengths in mm; None if the analyses know the hyper-parameters
    believed_phi: Array | None = None
    seed: int = SEED  #: seed of the random numbers for the readings of the planned tests

    @property
    def prior_sd(self) -> Array:
        """Prior standard deviations of the p parameters in these analyses, shape (p,).

        They are in internal units. That of a slope is the median over the machines.
        """
        if self.states_of_analyses is self.states:
            return self.bound.prior_sd
        change = self.states_of_analyses.before.precision - self.states.before.precision
        added = np.diagonal(change, axis1=-2, axis2=-1)
        return np.asarray(np.median((self.bound.prior_sd**-2.0 + added) ** -0.5, axis=0))


@one_blas_thread
def simulate_analyses(
    model: HybridModel, plan: Campaign, *, machines: int | None = None, seed: int = SEED
) -> SimulatedAnalyses:
    """Simulate the analyses of the tests of a plan, whose readings are not known yet.

    Parameters
    ----------
    model
        Model for the analysis of the plan's tests. It must have proper priors.
    plan
        Plan. Before it is run, the machine is known only from the readings of the plan's pilot or,
        if there are none, from the prior.
    machines
        Number of possible machines, which are drawn from the posterior or prior. Default: 64.
    seed
        Seed of the random numbers: the machines, and the readings of their tests. All forecasts use
        the default, so that two forecasts of one plan agree; another seed gives other machines.
    """
    analysed_with = with_slope_priors_of_pilot(model, plan)
    bound = bind_plan(analysed_with, plan)
    _check_parameters(bound)
    states = states_of(analysed_with, plan, machines, seed)
    return analyses_on_machines(bound, states, tests_already_run(plan), seed)


def tests_already_run(plan: Campaign) -> int:
    """Return the number of tests of the pilot to which a plan adds its tests; 0 without a pilot."""
    if plan.pilot is None or not plan.adds_to_pilot:
        return 0
    return len(plan.pilot.tests)


def _check_parameters(bound: BoundModel) -> None:
    """Raise an `InputError` if a plan has other parameters than the pilot from which it starts."""
    pilot = bound.pilot or bound.campaign
    names = bound.model.bind(pilot).names
    require(
        tuple(names) == tuple(bound.names),
        f"plan must have the parameters of its pilot {pilot.name!r}, got other planes or set-ups."
        " Leave its pilot out, or design the plan from a pilot with the same planes.",
    )


def states_of(
    model: HybridModel, plan: Campaign, machines: int | None = None, seed: int = SEED
) -> States:
    """Return the possible states of the machine before a plan is run, for the plan's forecast.

    A state is one possible machine: values of the parameters and hyper-parameters of ``model``.
    ``machines`` is the number of states, by default 64. The states are random draws with the seed
    ``seed``. They follow the posterior given the campaign that ``plan`` starts from or, if there
    are no readings, the prior.
    """
    pilot = plan.pilot or plan
    number = machines or _STATES
    return states_before(model, pilot, number, seed, augment=plan.adds_to_pilot)


def analyses_on_machines(
    bound: BoundModel, states: States, tests_run: int, seed: int
) -> SimulatedAnalyses:
    """Simulate the analyses of planned tests on the possible machines ``states``.

    The prior sd of a slope is proportional to the estimated magnitude of its compliance. ``bound``,
    the model applied to the tests, takes this estimate from the campaign that the design starts
    from. An analysis of the tests estimates the compliances anew, from its own readings, so that
    its priors of the slopes differ. Covariances and states of the result have these new priors.
    ``tests_run`` is the number of tests of ``bound`` that have already been run; they come first.
    ``seed`` is the seed of the random numbers.
    """
    believed_phi = _believed_hyper_parameters(bound, states, tests_run, seed)
    covariance = _believed_covariance(bound, believed_phi)
    prior = bound.model.prior
    if prior.flat or not prior.slopes_of_estimate or bound.model.degree == 0:
        return SimulatedAnalyses(bound, tests_run, states, states, covariance, believed_phi, seed)
    estimates = _draw_estimates(bound, states, covariance, tests_run, seed)
    added = precision_added_by_slope_priors(bound, estimates)
    scale = bound.scale
    matrix = np.eye(len(scale)) * added[:, None]
    precision = matrix / np.outer(scale, scale)
    before = states.before + Gaussian(precision, precision @ bound.prior_mean)
    covariance = np.linalg.inv(np.linalg.inv(covariance) + matrix[:, None])
    of_analyses = replace(states, before=before)
    return SimulatedAnalyses(bound, tests_run, states, of_analyses, covariance, believed_phi, seed)


def _believed_hyper_parameters(
    bound: BoundModel, states: States, tests_run: int, seed: int
) -> Array:
    """Return random draws from the hyper-parameters' posterior for the machines ``states``.

    The hyper-parameters are quantities such as the standard deviation of the noise. The result has
    the shape (K, n, h), for K possible machines, n draws for each machine (see `believed_scales`),
    and h hyper-parameters. ``bound`` is the model applied to the tests; the first ``tests_run`` of
    these tests have already been run. ``seed`` is the seed of the random numbers.
    """
    phi = extend_hyper_parameters(bound, states.phi, tests_run, scattering=True)
    pilot = bound.pilot or bound.campaign
    run_with_readings = 0 if pilot.is_plan else tests_run
    return believed_scales(bound, phi, _BELIEFS, seed, tests_run=run_with_readings)


def _believed_covariance(bound: BoundModel, believed_phi: Array) -> Array:
    """Return the covariances of the p parameters at given hyper-parameters, shape (K, n, p, p).

    ``believed_phi``, shape (K, n, h), are n sets of the h hyper-parameters for each of K machines.
    The covariances are in units of the prior standard deviations of the parameters. The condition
    that no compliance is negative is ignored.
    """
    posterior = bound.given(believed_phi.reshape(-1, believed_phi.shape[-1])).parameters
    relative_spread = posterior.spread() / bound.scale[:, None]
    covariance = relative_spread @ np.swapaxes(relative_spread, -1, -2)
    p = len(bound.names)
    return np.asarray(covariance.reshape(*believed_phi.shape[:2], p, p))


def precision_added_by_slope_priors(bound: BoundModel, estimates: Array) -> Array:
    """Return by how much the analysis of planned tests changes the prior precision of each slope.

    The prior sd of a slope is proportional to the estimated magnitude of its compliance.
    ``estimates``, shape (K, p), are the estimates of the p parameters that K analyses find, in
    internal units (mm, N, rad). Let r be the ratio of the new prior sd of a slope to that in
    ``bound``. The prior precision of the slope, in units of the prior sd in ``bound``, increases by
    1/r² − 1. The result has the shape (K, p) and is zero for all parameters that are not slopes.
    """
    sd = _sd_of_estimates(bound)
    column_of = {name: j for j, name in enumerate(bound.names)}
    added = np.zeros_like(estimates)
    for k, estimate in enumerate(estimates):
        size = bound.setting.compliance_size_estimate.copy()
        for i, compliance in enumerate(bound.compliances):
            column = column_of.get(compliance.label)
            if column is not None:
                size[i] = np.hypot(estimate[column], sd[column])
        ratio = bound.prior_sd_for_sizes(size) / bound.prior_sd
        added[k] = ratio**-2.0 - 1.0
    return added


def _sd_of_estimates(bound: BoundModel) -> Array:
    """Return the standard uncertainties of the estimates from which slopes get their prior sds.

    An analysis computes these estimates with the hyper-parameters at the medians of their priors,
    as if compliances could be negative. The result has the shape (p,), in internal units (mm, N,
    rad).
    """
    posterior = bound.given(prior_medians(bound)).parameters
    return np.asarray(np.linalg.norm(posterior.spread()[0], axis=-1))


def _draw_estimates(
    bound: BoundModel, states: States, covariance: Array, tests_run: int, seed: int
) -> Array:
    """Draw the estimates from which the analyses of planned tests size the priors of the slopes.

    One estimate of the p parameters is drawn for each of the K states, shape (K, p), in internal
    units (mm, N, rad). If ``tests_run`` tests have already been run, a part of the readings is
    known, and the estimate is taken to be a posterior mean, which follows from ``covariance``,
    shape (K, n, p, p), in units of the prior sds in ``bound``. ``seed`` is the seed of the random
    numbers.
    """
    if tests_run == 0:
        phi = extend_hyper_parameters(bound, states.phi, tests_run, scattering=True)
        return draw_reference_estimates(bound, phi, states.beta, seed)
    scale = bound.scale
    every_state = np.ones(len(covariance), bool)
    posterior_means = _draw_posterior_means(
        states, every_state, covariance * np.outer(scale, scale), scale, repetitions=1, seed=seed
    )
    return np.asarray(posterior_means[0].mean(axis=1))


@dataclass(frozen=True, eq=False)
class StatedByMachines:
    """Standard uncertainties that an analysis of planned tests would give on n possible machines.

    A possible machine is a random draw of the parameters and hyper-parameters. For each machine,
    the analysis of its readings is simulated.
    """

    names: tuple[str, ...]  #: names of the p parameters of the model
    beta: Array  #: values of the p parameters on each machine, shape (n, p), in mm, N, rad
    #: standard uncertainties that the analysis would give for the p parameters of each of the n
    #: machines, shape (n, p), in units composed of mm, N and rad
    u: Array

    def likely_u(self, name: str) -> float:
        """Return the standard uncertainty of a parameter that nine in ten machines do not exceed.

        ``name`` is the name of the parameter. The probability is that of one more machine, as in
        ``Expected.likely_sd``.
        """
        return float(np.quantile(self.u[:, self.names.index(name)], LIKELY, method="weibull"))


@one_blas_thread
def stated_by_machines(analyses: SimulatedAnalyses) -> StatedByMachines:
    """Return the standard uncertainties that simulated analyses give on the possible machines.

    `forecast_plan` returns the medians of these uncertainties over the machines.
    """
    bound = analyses.bound
    states = analyses.states_of_analyses
    covariance = analyses.covariance * np.outer(bound.scale, bound.scale)
    variances = stated_variances(bound, states, covariance, seed=analyses.seed)
    beta = states.beta[_is_possible(bound, states)]
    repetitions = len(variances) // len(beta)
    return StatedByMachines(tuple(bound.names), np.tile(beta, (repetitions, 1)), np.sqrt(variances))


def stated_variances(
    bound: BoundModel,
    states: States,
    covariance: Array,
    *,
    truncated: bool = True,
    seed: int = SEED,
) -> Array:
    """Forecast the posterior variances that analyses of planned tests would give.

    A state is one possible machine. States in which a compliance is negative at a force of the new
    tests are left out, unless no state would remain. For every remaining state, one or several
    analyses are simulated: posterior means of the parameters are drawn at random. An analysis does
    not know the hyper-parameters; n sets of values represent their posterior. The variance that the
    analysis states for a parameter is the mean of its posterior variances given these sets, plus
    the variance of its posterior means given these sets.

    Parameters
    ----------
    bound
        Model applied to the tests.
    states
        K states of the machine before the tests.
    covariance
        Posterior covariances of the p parameters in each state, for n sets of hyper-parameters,
        shape (K, n, p, p), in internal units (mm, N, rad). They are computed as if compliances
        could be negative.
    truncated
        Whether the analyses use the condition that no compliance is negative, if the model has this
        condition.
    seed
        Seed of the random numbers.

    Returns
    -------
    Array
        Variances of the p parameters, shape (analyses, p), in internal units.
    """
    variance = np.einsum("knii->kni", covariance)
    if bound.model.prior.flat:
        return np.asarray(variance.mean(axis=1))
    is_possible = _is_possible(bound, states)
    values = covariance.shape[1]
    repetitions = max(1, _MEANS_PER_STATE // values)
    means = _draw_posterior_means(
        states, is_possible, covariance[is_possible], bound.scale, repetitions, seed
    )
    variances = np.broadcast_to(variance[is_possible], means.shape)
    if truncated:
        means, variances, _ = truncated_moments(bound, means, covariance[is_possible])
    stated = variances.mean(axis=2) + means.var(axis=2)
    return np.asarray(stated.reshape(-1, stated.shape[-1]))


def _is_possible(bound: BoundModel, states: States) -> Array:
    """Return, for each possible state of the machine, whether all compliances are at least zero.

    A state is a set of values of the machine's parameters. The result has the shape (states,). All
    values are true if the model allows negative compliances. They are also all true if every state
    has a negative compliance, because no state would otherwise be left for the forecast.
    """
    if not bound.truncation.active:
        return np.ones(len(states.beta), bool)
    is_possible = np.asarray(bound.truncation.holds(states.beta))
    if not is_possible.any():
        return np.ones(len(states.beta), bool)
    return is_possible


def _draw_posterior_means(
    states: States,
    is_possible: Array,
    covariance: Array,
    scale: Array,
    repetitions: int,
    seed: int,
) -> Array:
    """Draw posterior means that an analysis of the new tests may give, for each possible state.

    A state is one possible machine: values of its parameters β and hyper-parameters. The posterior
    mean is random because the readings are not known yet.

    Let m₁ be the mean and P₁ the precision of the p parameters β before the tests, C their
    covariance after the tests, and W = 1 − C P₁. Given the parameters β of a state, the posterior
    mean is normally distributed with the mean m₁ + W (β − m₁) and the covariance W C. C depends on
    the hyper-parameters, for which there are n values. The posterior means for all n values belong
    to the same readings. They are therefore drawn with the same random numbers.

    ``is_possible``, shape (K,), is true for those of the K states that are used. ``covariance``,
    shape (possible states, n, p, p), holds C for each of these states. ``scale``, shape (p,), are
    the prior standard deviations. ``seed`` is the seed of the random numbers. The result has the
    shape (repetitions, possible states, n, p).
    All quantities are in internal units (mm, N, rad).
    """
    covariance = covariance / np.outer(scale, scale)
    prior_mean = states.before.mean[is_possible]
    prior_precision = states.before.precision[is_possible] * np.outer(scale, scale)
    weight = np.eye(len(scale)) - covariance @ prior_precision[:, None]
    # Use symmetric square roots of the covariances, because they change little if the
    # hyper-parameters change little. The columns of other square roots, such as the Cholesky
    # factor, may change their signs. The same random numbers would then no longer stand for the
    # same readings at all values of the hyper-parameters.
    root = symmetric_root(weight @ covariance)
    deviation = (states.beta[is_possible] - prior_mean) / scale
    mean = (prior_mean / scale)[:, None] + np.einsum("knij,kj->kni", weight, deviation)
    shape = (repetitions, *deviation.shape)
    noise = np.random.default_rng(seed).standard_normal(shape)
    return np.asarray(scale * (mean + np.einsum("knij,rkj->rkni", root, noise)))
