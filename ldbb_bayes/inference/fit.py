"""Measures of how well a model fits the readings, and warnings about the results of the fit.

The warnings should be considered before the results are used. A warning states, for example, that
the readings contradict the condition that no compliance is negative.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property

import numpy as np

from ldbb_bayes.campaign.unlikely_spans import unlikely_spans
from ldbb_bayes.inference.centre_shift import SHIFTED, centre_shift
from ldbb_bayes.inference.checks import (
    Check,
    CheckKind,
    TestChecks,
    all_checks,
    average_checks,
    check_predictions,
    failing_checks,
)
from ldbb_bayes.inference.coefficients import (
    ModelDraws,
    mean_shared_coefficients,
    pool_draws,
)
from ldbb_bayes.inference.contradicted_certificates import (
    LEAST_RATIO_OF_STATED_BALLS,
    log_ratio_of_stated_balls,
)
from ldbb_bayes.inference.diagnostics import power_sensitivity
from ldbb_bayes.inference.distant_zero import distant_zeros
from ldbb_bayes.inference.effects_of_failures import effects_of_failures
from ldbb_bayes.inference.residuals import FitQuality, quality_of
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.results import Array, Finite, Result
from ldbb_bayes.units import ranked

__all__ = [
    "Concern",
    "ConcernKind",
    "Fit",
    "State",
    "assess_fit",
    "contradicted_priors",
    "limits_of_compliances_near_zero",
]

# Power-scaling sensitivity above which the posterior of a parameter counts as sensitive to the
# prior. The sensitivity states how much the posterior moves if the prior density is raised to a
# power near one (Kallioinen et al. 2023).
_SENSITIVE = 0.05
# If a test fails the posterior predictive check of a Fourier order, this matters only if any
# parameter changes by more than this number of standard uncertainties when the test is left out.
_LARGEST_SHIFT = 0.5
# If a test fails the posterior predictive check of its noise, this matters only if the noise found
# in the readings would widen any parameter's credible interval by more than this fraction.
_LARGEST_WIDENING = 0.1
# Number of posterior draws from which two measures of how well the model fits each test are
# computed: the root-mean-square residual, and the fitness (100 % minus this residual in per cent of
# the range of the readings); see `FitQuality`.
_QUALITY_DRAWS = 1000
# Number of posterior draws from which the posterior predictive checks are computed.
_CHECKED_DRAWS = 500
# About the number of posterior draws from which it is checked whether the readings contradict the
# stated form of the balls.
_VALUES_FOR_BALLS = 128
# If the log posterior probability that no compliance is negative is below this limit, the readings
# contradict the condition that no compliance is negative.
_IMPROBABLE = float(np.log(1e-3))
# A warning is given if the posterior median of a hyper-parameter (scale of the noise or of another
# effect) is above the quantile of its prior at this probability.
_EXPECTED_HYPER = 0.999
# A fit warns if the distance between the posterior mean of a parameter and the prior mean that the
# user stated exceeds this limit. The unit of the limit is the standard deviation that the distance
# has if the prior is right.
_LARGEST_PRIOR_DISTANCE = 3.0
# A compliance that cannot be negative may be zero if its posterior mean is at most ``_EXPANSION``
# standard deviations (the expanded uncertainty U, k = 2). The fit then states the value below which
# the compliance lies with the probability ``_PROBABILITY_OF_UPPER``.
_EXPANSION = 2.0
_PROBABILITY_OF_UPPER = 0.95
# The distance between the prior mean and the posterior mean of a parameter is divided by the
# standard deviation that this distance has if the prior is right. To avoid a division by zero, the
# variance of the distance is taken to be at least this fraction of the prior variance.
_SMALLEST_VARIANCE_SHARE = 0.05


class State(StrEnum):
    """Whether the results of a fit can be used; `Fit.state` explains how this is decided."""

    USABLE = "usable"
    DOUBTFUL = "doubtful"
    UNUSABLE = "unusable"


class ConcernKind(StrEnum):
    """Kind of a warning that a fit gives in addition to its results.

    `Concern` states what each kind warns of.
    """

    NOT_CONVERGED = "not-converged"
    TRUNCATION = "truncation"
    FORCES = "forces"
    HYPER = "hyper"
    CENTRE = "centre"
    PRIOR = "prior"
    ZERO = "zero"
    UNIT = "unit"
    BALLS = "balls"
    NEAR_ZERO = "near-zero"


# Kinds of warnings that make the results of a fit doubtful.
_DOUBTFUL_KINDS = frozenset({ConcernKind.TRUNCATION, ConcernKind.UNIT, ConcernKind.BALLS})


@dataclass(frozen=True)
class Concern(Result):
    """Warning that a fit gives, with two numbers, ``value`` and ``limit``, that state the reason.

    The meaning of the two numbers depends on ``kind``:

    - NOT_CONVERGED: ``value`` is the number of steps after which the sampler gave up, ``limit`` the
      effective sample size that was asked for.
    - TRUNCATION: ``value`` is the log posterior probability that no compliance is negative,
      ``limit`` the smallest log probability expected.
    - FORCES: ``value`` is the number of different forces of the campaign, ``limit`` the number
      needed to check the degree of the compliances as polynomials in the force.
    - HYPER: ``value`` is the posterior median of the hyper-parameter ``name`` [mm], ``limit`` the
      quantile of its prior at 99.9 %.
    - CENTRE: ``value`` is the p-value of the hypothesis that the circles' centre does not shift
      along the machine axis ``name`` with force. There is one such p-value for each axis of each
      plane. The warning is given if ``value``, multiplied by the number of these p-values, is below
      ``limit``.
    - PRIOR: ``value`` is the distance of the posterior mean of the parameter ``name`` from the
      prior mean that the user stated, ``limit`` the largest distance expected. Both are in units of
      the standard deviation that this distance has if the prior is right.
    - ZERO: ``value`` is the constant by which the readings of all circles of one radius lie away
      from what is expected [mm]: the error of the bar's length if nothing were known of it
      beforehand, minus the error that is stated. ``limit`` is the largest size of this constant to
      be expected of the bar and of the machine [mm], and ``name`` the coefficient of the bar's
      length.
    - UNIT: ``value`` is the range of the readings of the test ``name`` [mm], ``limit`` the smallest
      or largest range that a ball bar shows [mm]. The readings probably are in another unit than
      stated.
    - BALLS: ``value`` is the log evidence with the stated form of the balls minus that without it,
      ``limit`` the smallest difference expected [nat]. The warning is given only if the readings
      are more probable with balls that are less round than stated.
    - NEAR_ZERO: ``value`` is the posterior mean of the compliance ``name``, which cannot be
      negative and is not larger than two standard deviations. ``limit`` is the value below which it
      lies with a probability of 95 %. Both are in the internal unit ``unit``, such as mm/N.
    """

    kind: ConcernKind
    value: float
    limit: float
    name: str = ""
    unit: str = ""


@dataclass(frozen=True)
class Fit(Result):
    """How well a model fits the readings, and the warnings that the fit gives."""

    #: root-mean-square residual over all readings [µm] (Eq. 34 of the article on the model)
    rmse_um: float
    #: fitness of each test [%] (Eq. 35 of the article on the model): 100 % minus the
    #: root-mean-square residual in per cent of the range of the readings, or NaN if all readings
    #: are equal. The keys are the names of the tests.
    fitness_percent: dict[str, float]
    #: logarithm of the probability that no compliance is negative, computed with the posterior of
    #: the same model without truncation
    log_prob_truncation: float
    #: error of ``log_prob_truncation``, the log probability that no compliance is negative [nat]
    log_prob_truncation_error: Finite
    #: logarithm of the constant that normalises the truncated prior: the probability, under the
    #: prior before truncation, that no compliance is negative. It is zero if the prior is not
    #: truncated.
    log_prob_truncation_prior: float
    #: largest difference between the readings that the linearised model predicts and the readings
    #: that the exact geometry predicts, both at the posterior mean of the parameters [µm]
    linearisation_error_um: float
    concerns: tuple[Concern, ...]  #: warnings of the fit, each with a value and a limit
    #: posterior predictive checks of each test; the keys are the names of the tests
    predictive_checks: dict[str, TestChecks]
    #: sensitivity of the posterior of each parameter and hyper-parameter: how much this posterior
    #: moves if a prior density or the likelihood is raised to a power near one (power-scaling). The
    #: first key is the name of the parameter or hyper-parameter; the second key is ``prior``,
    #: ``hyper_prior`` or ``likelihood``.
    sensitivity: dict[str, dict[str, float]]
    #: dict of the effects of tests that fail the posterior predictive check of a Fourier order. The
    #: keys are the names of these tests. The value is the largest change of any parameter when the
    #: test is left out, in units of the parameter's standard uncertainty. The dict is empty if no
    #: test fails this check, if the prior is flat, or if the campaign has one test only.
    shift: dict[str, float]
    #: largest relative increase in the width of a parameter's credible interval due to noise that
    #: is stronger than modelled. The noise of tests that fail a check of noise or autocorrelation
    #: is estimated from their readings at the Fourier orders 13 to 16. Zero if no test fails these
    #: checks.
    widening: float

    @cached_property
    def checks(self) -> list[Check]:
        """Return the posterior predictive checks of all tests, the smallest p-value first."""
        return all_checks(self.predictive_checks)

    @cached_property
    def unexpected(self) -> tuple[Check, ...]:
        """Return the posterior predictive checks that fail, the smallest p-value first.

        A check fails if its p-value, multiplied by the number of all checks (Bonferroni), is below
        1 %.
        """
        return failing_checks(self.checks)

    @cached_property
    def misfits(self) -> tuple[Check, ...]:
        """Return the failing posterior predictive checks that matter for the credible intervals.

        A failing check of a Fourier order matters if leaving out the test changes some parameter by
        more than half of the parameter's standard uncertainty. The check also matters if this
        change is not known, because the prior is flat or the campaign has only one test. A failing
        check of noise or of its autocorrelation matters if the noise that the readings show would
        make some credible interval more than 10 % wider.
        """
        return tuple(check for check in self.unexpected if self._moves_intervals(check))

    def _moves_intervals(self, check: Check) -> bool:
        """Return whether a failing check of a test's readings matters for the credible intervals.

        `misfits` explains which failing checks matter.
        """
        if check.kind == CheckKind.ORDER:
            return self.shift.get(check.test, np.inf) > _LARGEST_SHIFT
        return self.widening > _LARGEST_WIDENING

    @property
    def contradicts_model(self) -> bool:
        """Whether the readings contradict the model, so that its results cannot be used."""
        kinds = {concern.kind for concern in self.concerns}
        forbidding = {ConcernKind.TRUNCATION, ConcernKind.BALLS}
        return bool(self.misfits) or bool(kinds & forbidding)

    @property
    def is_usable(self) -> bool:
        """Whether the results can be used at all, with reservations or without.

        They cannot if the draws have not converged, if the unit of the readings is in doubt, or if
        the readings contradict the model.
        """
        unit_is_doubted = bool(self.names_of_concerns(ConcernKind.UNIT))
        return not (self.state == State.UNUSABLE or unit_is_doubted or self.contradicts_model)

    def names_of_concerns(self, kind: ConcernKind) -> tuple[str, ...]:
        """Return the names in all warnings of one kind that the fit gives.

        Parameters
        ----------
        kind : ConcernKind
            Kind of the warnings. `Concern` explains what their names are: of kind PRIOR those of
            parameters, of kind UNIT those of tests.

        Returns
        -------
        tuple of str
        """
        return tuple(concern.name for concern in self.concerns if concern.kind == kind)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Return the kinds of the fit's warnings and of its failing checks that matter (`misfits`).

        Each kind is listed once. A kind is the text of a ``ConcernKind`` or ``CheckKind``, such as
        "truncation" or "noise".
        """
        concerns = [str(concern.kind) for concern in self.concerns]
        misfits = [str(check.kind) for check in self.misfits]
        return tuple(dict.fromkeys(concerns + misfits))

    @property
    def state(self) -> State:
        """Return whether the results of the fit can be used.

        The results are unusable if the sampler did not converge. Otherwise, they are doubtful if
        the fitted model does not describe the readings well enough (see `misfits`), if the readings
        contradict the condition that no compliance is negative or the stated form of the balls, or
        if the unit of the readings of a test is in doubt. In all other cases the results are
        usable.
        """
        kinds = {concern.kind for concern in self.concerns}
        if ConcernKind.NOT_CONVERGED in kinds:
            return State.UNUSABLE
        if self.misfits or kinds & _DOUBTFUL_KINDS:
            return State.DOUBTFUL
        return State.USABLE

    @property
    def sensitive(self) -> tuple[str, ...]:
        """Return the names of the parameters whose posterior is sensitive to the prior.

        The most sensitive parameter is first. A parameter is listed if its power-scaling
        sensitivity (how much its posterior moves if the prior is raised to a power near one) is
        above 0.05.
        """
        names = [name for name in self.parameters if self._prior_sensitivity(name) > _SENSITIVE]
        return tuple(ranked(names, self._prior_sensitivity))

    def _prior_sensitivity(self, name: str) -> float:
        """Return the sensitivity of a parameter's posterior to the prior of the parameters.

        ``name`` is the name of the parameter. The sensitivity states how much its posterior moves
        if the prior density is raised to a power near one (power-scaling).
        """
        return self.sensitivity[name]["prior"]

    @property
    def parameters(self) -> tuple[str, ...]:
        """Return the names of the parameters of the fitted model.

        The parameters are compliances, their changes with force, and geometric errors.
        Hyper-parameters (such as the standard deviation of the noise) are not among them.
        """
        return tuple(name for name in self.sensitivity if name.startswith(("C_", "E_")))


def assess_fit(
    bound: BoundModel,
    draws_by_model: Sequence[ModelDraws],
    groups: Mapping[str, Mapping[str, Array]],
    truncation: tuple[float, float],
    concerns: Sequence[Concern],
    rng: np.random.Generator,
    prior_level: Array | float = 0.0,
) -> Fit:
    """Return how well one model, or an average of several models, fits.

    Parameters
    ----------
    bound : BoundModel
        Model of the campaign with the parameters of all averaged models.
    draws_by_model : sequence of ModelDraws
        The posterior draws in ``groups``, separately for each model.
    groups : mapping
        Groups ``posterior``, ``log_prior`` and ``sample_stats`` of the posterior, with arrays of
        shape (chains, draws). The first key is the name of the group, the second key the name of
        the array.
    truncation : pair
        Log posterior probability that no compliance is negative, and the error of this logarithm
        [nat].
    concerns : sequence of Concern
        Warnings from the sampler.
    rng : Generator
        Generator of the random draws of new circles.
    prior_level : float or array
        Expected value, under the prior, of the log prior density of the parameters. It is
        subtracted from the log prior density. Otherwise, different expected values of the models in
        an average would be mistaken for sensitivity to the prior. For an average, give an array,
        shape (chains, draws), with the expected value for the model of each draw. For a single
        model, any number may be given, because a constant does not change the sensitivity.

    Returns
    -------
    Fit
        Quality of the fit, checks and warnings.
    """
    sizes = np.array([len(draws.phi) for draws in draws_by_model])
    shares = sizes / sizes.sum()
    quality = _average_quality(bound, draws_by_model, shares)
    checks = _average_checks(draws_by_model, shares, rng)
    posterior = groups["posterior"]
    beta, phi = pool_draws(
        _stack(posterior, bound.names), _stack(posterior, bound.hyper_prior.names)
    )
    log_prob_truncation, log_prob_truncation_error = truncation
    linearisation_error_mm = bound.largest_linearisation_error_mm(beta.mean(axis=0))
    posterior_concerns = _check_posterior(bound, phi, beta, log_prob_truncation)
    shift, widening = effects_of_failures(bound, phi.mean(axis=0), checks)
    return Fit(
        rmse_um=quality.rmse_um,
        fitness_percent=quality.fitness_percent,
        log_prob_truncation=log_prob_truncation,
        log_prob_truncation_error=log_prob_truncation_error,
        log_prob_truncation_prior=bound.log_prob_truncation_prior,
        linearisation_error_um=linearisation_error_mm * 1e3,
        concerns=(*concerns, *posterior_concerns),
        predictive_checks=checks,
        sensitivity=power_sensitivity(posterior, _log_densities(bound, groups, prior_level)),
        shift=shift,
        widening=widening,
    )


def _average_quality(
    bound: BoundModel, draws_by_model: Sequence[ModelDraws], shares: Array
) -> FitQuality:
    """Return how well a prediction that is averaged over several models agrees with the readings.

    The result holds the root-mean-square residual and the fitness of the averaged prediction.

    ``draws_by_model`` holds the posterior draws of each model. The readings that these draws
    predict are averaged over the draws of each model, then over the models, with the weights
    ``shares``, which sum to one. ``bound`` is the model that has the parameters of all models.
    """
    predictions = []
    for share, draws in zip(shares, draws_by_model, strict=True):
        thinned = draws.thinned(int(np.ceil(share * _QUALITY_DRAWS)))
        predictions.append(mean_shared_coefficients(thinned.bound, thinned.phi, thinned.beta))
    return quality_of(bound, np.tensordot(shares, predictions, axes=1))


def _average_checks(
    draws_by_model: Sequence[ModelDraws], shares: Array, rng: np.random.Generator
) -> dict[str, TestChecks]:
    """Return the posterior predictive p-values of each test, averaged over several models.

    ``draws_by_model`` holds the posterior draws of each model, from which its p-values are
    computed. In the average, the models have the weights ``shares``, which sum to one. The keys of
    the result are the names of the tests. ``rng`` generates the random draws of new circles.
    """
    checks = []
    for share, draws in zip(shares, draws_by_model, strict=True):
        thinned = draws.thinned(int(np.ceil(share * _CHECKED_DRAWS)))
        checks.append(check_predictions(thinned.bound, thinned.phi, thinned.beta, rng))
    return average_checks(shares, checks)


def _stack(group: Mapping[str, Array], names: Sequence[str]) -> Array:
    """Return draws of the named variables in one array, shape (chains, draws, variables).

    ``group`` is a dict with the names of the variables as keys and the draws of each variable,
    shape (chains, draws), as values.
    """
    return np.stack([group[str(name)] for name in names], axis=-1)


def _log_densities(
    bound: BoundModel, groups: Mapping[str, Mapping[str, Array]], prior_level: Array | float
) -> dict[str, Array]:
    """Return the log densities of priors and likelihood at every posterior draw.

    The log densities are used to examine how sensitive the posterior is to the priors and to the
    readings. The result is a dict of three arrays of shape (chains, draws):

    - ``prior``: the log prior density of the parameters minus ``prior_level``; see `assess_fit`;
    - ``hyper_prior``: the log prior density of the hyper-parameters (such as the standard deviation
      of the noise);
    - ``likelihood``: the log density of the readings given parameters and hyper-parameters.

    ``groups`` holds the arrays of the posterior; see `assess_fit`. ``bound`` is the model of the
    campaign.
    """
    phi = _stack(groups["posterior"], bound.hyper_prior.names)
    log_prior = groups["log_prior"]["parameters"]
    log_hyper_prior = groups["log_prior"]["hyper"]
    free = bound.hyper_prior.free(phi)
    log_jacobian = bound.hyper_prior.log_density_of_free(free) - log_hyper_prior
    log_posterior = groups["sample_stats"]["lp"]
    return {
        "prior": log_prior - prior_level,
        "hyper_prior": log_hyper_prior,
        "likelihood": log_posterior - log_prior - log_hyper_prior - log_jacobian,
    }


def _check_posterior(
    bound: BoundModel, phi: Array, beta: Array, log_prob_truncation: float
) -> Iterator[Concern]:
    """Check a posterior against the assumptions of its model, and yield warnings.

    There is a warning for each assumption that the posterior contradicts, and a warning if there
    are too few different forces to check an assumption. `Concern` describes the kinds of warnings:
    TRUNCATION, FORCES, HYPER, PRIOR, ZERO, UNIT, BALLS, CENTRE and NEAR_ZERO.

    Parameters
    ----------
    bound
        Model applied to the campaign.
    phi
        The n posterior draws of the h hyper-parameters, shape (n, h); those that are lengths are in
        mm.
    beta
        The n posterior draws of the p parameters, shape (n, p), in internal units (mm, N, rad).
    log_prob_truncation
        Log posterior probability that no compliance is negative.
    """
    if log_prob_truncation < _IMPROBABLE:
        yield Concern(ConcernKind.TRUNCATION, log_prob_truncation, _IMPROBABLE)
    levels = bound.campaign.force_levels
    needed = bound.model.degree + 2
    if levels < needed:
        yield Concern(ConcernKind.FORCES, levels, needed)
    yield from contradicted_priors(bound, phi, beta)
    for axis, p in centre_shift(bound, beta.mean(axis=0)).items():
        yield Concern(ConcernKind.CENTRE, p, SHIFTED, axis)
    yield from _compliances_near_zero(bound, beta)


def contradicted_priors(bound: BoundModel, phi: Array, beta: Array) -> Iterator[Concern]:
    """Yield a warning for everything known beforehand that the readings contradict.

    `Concern` describes the kinds of these warnings: HYPER, PRIOR, ZERO, UNIT and BALLS.

    Parameters
    ----------
    bound : BoundModel
        Model applied to the campaign.
    phi : array
        The n posterior draws of the h hyper-parameters, shape (n, h); those that are lengths are in
        mm.
    beta : array
        The n posterior draws of the p parameters, shape (n, p), in internal units (mm, N, rad).

    Yields
    ------
    Concern
    """
    yield from _large_hyper_parameters(bound, phi)
    yield from _distant_means(bound, beta)
    for zero in distant_zeros(bound, phi, beta):
        yield Concern(ConcernKind.ZERO, zero.distance_mm, zero.expected_mm, zero.name)
    for span in unlikely_spans(bound.campaign):
        yield Concern(ConcernKind.UNIT, span.span_um * 1e-3, span.limit_um * 1e-3, span.test)
    some = phi[:: max(1, len(phi) // _VALUES_FOR_BALLS)]
    log_ratio = log_ratio_of_stated_balls(bound, np.ones(len(some)), some)
    if log_ratio < LEAST_RATIO_OF_STATED_BALLS:
        yield Concern(ConcernKind.BALLS, log_ratio, LEAST_RATIO_OF_STATED_BALLS)


def _large_hyper_parameters(bound: BoundModel, phi: Array) -> Iterator[Concern]:
    """Yield a warning for each hyper-parameter with a median above the 99.9 % prior quantile.

    Only hyper-parameters (such as the standard deviation of the noise) that are lengths are
    examined. ``phi``, shape (n, h), holds n posterior draws of all h hyper-parameters; those that
    are lengths are in mm. ``bound`` is the model of the campaign.
    """
    prior = bound.hyper_prior
    limits = prior.quantile(np.full(phi.shape[1], _EXPECTED_HYPER))
    medians = np.median(phi, axis=0)
    for name, median, limit, is_length in zip(
        prior.names, medians, limits, prior.in_mm, strict=True
    ):
        if is_length and median > limit:
            yield Concern(ConcernKind.HYPER, float(median), float(limit), str(name))


def _distant_means(bound: BoundModel, beta: Array) -> Iterator[Concern]:
    """Yield a warning for each parameter whose posterior mean is too far from its prior mean.

    Only parameters for which the user stated a prior are examined. ``beta``, shape (n, p), holds n
    posterior draws of the p parameters in internal units (mm, N, rad). ``bound`` is the model
    of the campaign.
    """
    stated = {*bound.model.prior.overrides, *bound.model.prior.means}
    prior_variance = bound.prior_sd**2
    # If the prior of a parameter is right, the distance of its posterior mean from its prior mean
    # is a random draw from a normal distribution about zero. The variance of this distribution is
    # the prior variance minus the posterior variance.
    expected_variance = np.maximum(
        prior_variance - beta.var(axis=0), _SMALLEST_VARIANCE_SHARE * prior_variance
    )
    distance = np.abs(beta.mean(axis=0) - bound.prior_mean) / np.sqrt(expected_variance)
    for name, z in zip(bound.names, distance, strict=True):
        if z > _LARGEST_PRIOR_DISTANCE and name in stated:
            yield Concern(ConcernKind.PRIOR, float(z), _LARGEST_PRIOR_DISTANCE, name)


def _compliances_near_zero(bound: BoundModel, beta: Array) -> Iterator[Concern]:
    """Yield a warning for each compliance that cannot be negative and may be zero.

    The warning states the value below which the compliance lies with a probability of 95 %, see
    `limits_of_compliances_near_zero`.
    """
    for name, upper in limits_of_compliances_near_zero(bound, beta).items():
        j = bound.names.index(name)
        unit = bound.parameters[j].unit
        yield Concern(ConcernKind.NEAR_ZERO, float(beta[:, j].mean()), upper, name, unit)


def limits_of_compliances_near_zero(bound: BoundModel, beta: Array) -> dict[str, float]:
    """Return upper limits of the compliances that cannot be negative and may be zero.

    Credible intervals have equal tails. The interval of such a compliance leaves out the values
    next to zero, where the compliance may well lie. The value below which it lies with a
    probability of 95 % is then to be stated instead. A compliance may be zero if its posterior mean
    is at most two standard deviations.

    Parameters
    ----------
    bound : BoundModel
        Model of the campaign.
    beta : array
        The n posterior draws of the p parameters, shape (n, p), in internal units (mm, N, rad).

    Returns
    -------
    dict
        The limits in internal units; the keys are the names of the compliances.
    """
    is_restricted = (bound.truncation.rows != 0.0).any(axis=0)
    is_near_zero = beta.mean(axis=0) <= _EXPANSION * beta.std(axis=0)
    limits = {}
    for j in np.flatnonzero(is_restricted & is_near_zero):
        parameter = bound.parameters[j]
        if parameter.group == "compliance":
            limits[parameter.name] = float(np.quantile(beta[:, j], _PROBABILITY_OF_UPPER))
    return limits
