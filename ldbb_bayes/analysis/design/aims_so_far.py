"""Aims of a campaign that is being run: whether they are reached now, and after one more circle.

An aim is a goal for the expanded uncertainty U (k = 2) of a parameter, or a decision whether a
quantity conforms with its tolerance. The posterior given the circles run so far shows whether an
aim is reached now. The covariances of the parameters that are expected after one more circle show
whether it will be reached then.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import xarray as xr
from scipy.special import ndtr, ndtri

from ldbb_bayes.analysis.conformity import assess_conformity, quantity_draws
from ldbb_bayes.analysis.decision_rule import Conformity, Decision
from ldbb_bayes.analysis.design.aims import UncertaintyAim
from ldbb_bayes.analysis.design.goals import COVERAGE_FACTOR, Goal
from ldbb_bayes.analysis.design.present_estimates import PRESENT_DRAWS, present_estimates
from ldbb_bayes.analysis.tolerances import Tolerance
from ldbb_bayes.inference.coefficients import evenly_spaced
from ldbb_bayes.inference.nodes import Nodes
from ldbb_bayes.inference.posterior import draws_of
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.results import Array, Result

__all__ = [
    "GoalSoFar",
    "GoalState",
    "Known",
    "ToleranceSoFar",
    "ToleranceState",
    "decided_from",
    "goal_states",
    "known_from",
    "likely_hyper_parameters",
    "tolerance_states",
]

# Number of values of the hyper-parameters, such as the standard deviation of the noise, at which
# possible next circles are compared.
_NODES = 16
# Smallest distance of an estimate from a tolerance limit, in present standard uncertainties, that
# is used for the choice of the next circle. A smaller distance is replaced by this number.
# Otherwise, an estimate exactly at the limit would demand an uncertainty of zero, which no campaign
# can reach.
_LEAST_DISTANCE = 0.2
# Smallest target for a standard uncertainty, as a fraction of the present standard uncertainty. A
# smaller target is replaced by this fraction. Otherwise, a goal such as "5 % of the value" would
# demand an uncertainty near zero for a parameter whose value may be near zero.
_LEAST_TARGET = 1e-3


@dataclass(frozen=True)
class GoalSoFar(Result):
    """Uncertainty of a parameter with a goal, now and after the best next circle.

    The goal is an upper limit of the expanded uncertainty U (k = 2). The probabilities have no
    unit; all other values are in the unit ``unit``.
    """

    unit: str
    value: float  #: posterior mean of the parameter whose uncertainty the goal limits
    U: float  #: expanded uncertainty (k = 2) of the goal's parameter, given the circles run so far
    #: largest expanded uncertainty U that the goal permits for its parameter; a goal in percent is
    #: taken as a percentage of ``value``, the parameter's posterior mean
    limit: float
    #: probability that the goal is already met by the U of a fit of the circles run so far. It is 0
    #: or 1 for a goal with a fixed limit. For a
    #: goal in percent of the parameter, it may lie between 0 and 1, because the parameter, and
    #: therefore the limit, is not known exactly.
    probability: float
    U_next: float  #: expanded uncertainty U of the goal's parameter after the best next circle
    #: probability that the goal for the parameter's uncertainty is met after the best next circle,
    #: which may scatter more or less than other circles
    probability_next: float
    #: expanded uncertainty U of the goal's parameter that would remain if the best possible circles
    #: were repeated very many times. If it is above ``U_needed``, the goal is not expected to be
    #: reached with any number of circles.
    U_floor: float
    #: largest expanded uncertainty U with which the goal will count as reached if ``value`` stays
    #: as it is. For a goal in percent it is below ``limit``, because the true value may be below
    #: ``value``.
    U_needed: float
    #: the goal as a fraction of ``value``, the parameter's posterior mean; None if the goal was
    #: stated in the parameter's unit
    share: float | None = None
    #: expanded uncertainty that a fit of the circles run so far states. It differs from ``U`` if
    #: the model includes effects that only the possible circles can show, such as hysteresis if
    #: they run in both directions. None if there are no such effects: the fit then states ``U``.
    U_of_fit: float | None = None
    #: expanded uncertainty (k = 2) now, averaged over constant and linear compliance, as the sheets
    #: of a report state it. None if compliance is constant in the model.
    averaged_U: float | None = None


@dataclass(frozen=True)
class ToleranceSoFar(Result):
    """Whether a quantity is within its tolerance, and whether one more circle may decide this."""

    #: result of `assess_conformity` for the readings so far, as the sheets of a report state it:
    #: the decision whether the quantity conforms with its tolerance
    now: Conformity
    #: probability that, after the best next circle, it can be decided whether the quantity conforms
    #: with its tolerance
    decided_next: float
    #: largest expanded uncertainty U (k = 2) of the quantity with which a decision is possible if
    #: the estimate of the quantity stays the same
    U_needed: float
    #: expanded uncertainty U of the quantity that would remain if the best possible circles were
    #: repeated very many times. If it is above ``U_needed``, no number of circles is expected to
    #: allow a decision.
    U_floor: float

    @property
    def decided(self) -> bool:
        """Whether a decision on the conformity of the quantity with its tolerance has been made."""
        return self.now.decision is not Decision.NOT_DECIDED


class Known(NamedTuple):
    """Posterior of the p parameters given the readings so far, in units of mm, N and rad."""

    bound: BoundModel  # model applied to the circles run so far
    mean: Array  # posterior means of the p parameters, shape (p,)
    sd: Array  # posterior standard deviations of the model's p parameters, shape (p,)
    draws: Array  # n random draws from the posterior of the model's p parameters, shape (n, p)
    phi_of_draws: Array  # h hyper-parameters with each of the n draws of parameters, shape (n, h)
    # K equally likely values of the h hyper-parameters, such as the standard deviation of the
    # noise, shape (K, h); lengths are in mm
    phi: Array


def known_from(nodes: Nodes, seed: int) -> Known:
    """Return the posterior of the parameters and hyper-parameters given the circles run so far.

    ``nodes`` are weighted values of the hyper-parameters, from which the posterior is computed.
    ``seed`` is the seed of the random draws.
    """
    rng = np.random.default_rng(seed)
    estimates = present_estimates(nodes)
    draws, phi_of_draws = nodes.draw(PRESENT_DRAWS, rng)
    phi = likely_hyper_parameters(nodes, rng)
    return Known(nodes.bound, estimates.mean, estimates.sd, draws, phi_of_draws, phi)


def likely_hyper_parameters(nodes: Nodes, rng: np.random.Generator) -> Array:
    """Return K equally likely values of the h hyper-parameters, shape (K, h), lengths in mm.

    They are drawn with ``rng`` from ``nodes``, weighted values that represent the posterior.
    """
    return nodes.bound.hyper_prior.phi(nodes.integral.resample(_NODES, rng))


def _inflation(sd: float, weights: Array, covariance: Array) -> float:
    """Return the factor by which unknown hyper-parameters increase a standard uncertainty.

    The uncertain quantity is a combination of the p parameters with the weights ``weights``, shape
    (p,). ``sd`` is the standard uncertainty of this combination if the hyper-parameters are
    unknown. ``covariance``, shape (K, p, p), holds the covariances of the parameters as if the
    hyper-parameters were known to have one of K values. Each covariance gives one standard
    uncertainty of the combination. The result is ``sd`` divided by the root mean square of these K
    standard uncertainties.
    """
    return sd / float(np.sqrt((covariance @ weights @ weights).mean()))


@dataclass(frozen=True, eq=False)
class GoalState:
    """A goal for the uncertainty of a parameter, and the present estimate of the parameter.

    ``aim`` holds the standard uncertainty that is needed to meet the goal. The next circle is
    chosen with this aim.
    """

    goal: Goal
    unit: str  # unit of the goal's parameter, composed of mm, N and rad, such as mm/N
    mean: float  # posterior mean of the parameter whose uncertainty the goal limits
    sd: float  # posterior standard deviation of the parameter whose uncertainty the goal limits
    # n random draws from the posterior of the parameter whose uncertainty the goal limits, shape
    # (n,)
    draws: Array
    aim: UncertaintyAim
    # expanded uncertainty (k = 2) that a fit of the circles run so far states; None if the model
    # has no other effects than that of the fit
    U_of_fit: float | None = None
    # expanded uncertainty (k = 2) now, averaged over constant and linear compliance; None if
    # compliance is constant in the model
    averaged_U: float | None = None

    @property
    def sd_of_fit(self) -> float:
        """Standard uncertainty that a fit states if the campaign stops after the circles so far."""
        if self.U_of_fit is None:
            return self.sd
        return self.U_of_fit / COVERAGE_FACTOR

    def with_fit(self, expanded: float, confidence: float) -> GoalState:
        """Return the goal with the U that a fit states, by which the goal is reached or not.

        A campaign that stops is judged by its fit, which has no effects that only further circles
        could show. ``expanded`` is the expanded uncertainty (k = 2) that the fit states, and
        ``confidence`` the minimum probability at which a goal counts as reached.
        """
        stated = replace(self, U_of_fit=expanded)
        is_reached = self.goal.probability_met(self.draws, stated.sd_of_fit) >= confidence
        return replace(stated, aim=replace(self.aim, is_reached=is_reached))

    def is_met(self) -> Array:
        """Return whether the goal is met, for each of n posterior draws of the goal's parameter.

        A goal limits the expanded uncertainty U of a parameter. Each draw is taken as the true
        value of the parameter, and U is the present uncertainty. The result differs between draws
        only if the goal limits U to a percentage of the parameter's value.
        """
        return self.goal.is_met(self.draws, self.sd_of_fit)

    def probability(self, sd: Array) -> float:
        """Return the probability that the goal is met, for given uncertainties of the parameter.

        ``sd``, shape (K,), are K equally likely values of the parameter's standard uncertainty. The
        probability is a mean over these values and over the posterior draws of the parameter. The
        draws are needed if the goal limits U to a percentage of the parameter's value.
        """
        limits = self.goal.limit_U(self.draws)
        return float((COVERAGE_FACTOR * sd[:, None] <= limits).mean())

    def so_far(self, after: Array, after_very_many: Array, scattering: Array) -> GoalSoFar:
        """Return U and the probability that the goal is met: now, and after further circles.

        U is the expanded uncertainty (k = 2) of the goal's parameter. The result states U and the
        probability for two times: now, and after the best next circle. The result also states U
        after very many circles.

        ``after``, shape (K, p, p), are the covariances of the p parameters after the best next
        circle, in units of their prior standard deviations, at K values of the hyper-parameters.
        ``after_very_many``, of the same shape and in the same units, are the covariances after very
        many circles. ``scattering``, shape (n, p, p), are n equally likely covariances after the
        best next circle, which may scatter more or less than other circles.
        """
        sd_next = self.aim.sd(after)
        expected_sd = min(float(np.sqrt((sd_next**2).mean())), self.sd)
        # After the next circle the fit has the effects that this circle shows. Its uncertainty is
        # not larger than the present one under the same effects.
        probability_at_least = self.probability(np.array([self.sd]))
        return GoalSoFar(
            unit=self.unit,
            value=self.mean,
            U=COVERAGE_FACTOR * self.sd,
            limit=float(self.goal.limit_U(np.array(self.mean))),
            probability=self.probability(np.array([self.sd_of_fit])),
            U_next=COVERAGE_FACTOR * expected_sd,
            probability_next=max(self.probability(self.aim.sd(scattering)), probability_at_least),
            U_floor=COVERAGE_FACTOR
            * min(float(np.sqrt((self.aim.sd(after_very_many) ** 2).mean())), expected_sd),
            U_needed=COVERAGE_FACTOR * self.aim.target,
            share=self.goal.share,
            U_of_fit=self.U_of_fit,
            averaged_U=self.averaged_U,
        )


def goal_states(
    goals: Mapping[str, Goal], known: Known, covariance: Array, confidence: float
) -> dict[str, GoalState]:
    """Return a dict of all goals, each with the present estimate of the goal's parameter.

    The result also states, for each goal, the standard uncertainty that is needed to meet the goal.
    The keys are the names of the goals' parameters. ``known`` is the posterior given the circles
    run so far. ``covariance``, shape (K, p, p), are the present covariances of the p parameters at
    K values of the hyper-parameters. ``confidence`` is the minimum probability at which a goal
    counts as reached.
    """
    states = {}
    for name, goal in goals.items():
        column = known.bound.names.index(name)
        weights = np.zeros(len(known.bound.names))
        weights[column] = known.bound.scale[column]
        sd = float(known.sd[column])
        draws = known.draws[:, column]
        limits = goal.limit_U(draws)
        mean = float(known.mean[column])
        is_reached = bool((COVERAGE_FACTOR * sd <= limits).mean() >= confidence)
        if is_reached:
            target = float(np.quantile(limits, 1.0 - confidence)) / COVERAGE_FACTOR
        else:
            target = _sd_that_meets(goal, mean, confidence)
        aim = UncertaintyAim(
            weights=weights,
            target=max(target, _LEAST_TARGET * sd),
            inflation=_inflation(sd, weights, covariance),
            is_reached=is_reached,
        )
        unit = known.bound.parameters[column].unit
        states[name] = GoalState(goal, unit, mean, sd, draws, aim)
    return states


def _sd_that_meets(goal: Goal, value: float, confidence: float) -> float:
    """Return the largest standard uncertainty with which a goal will count as reached.

    A goal in percent is of the true value, which later circles narrow down as well. If the estimate
    v stays as it is and has the standard uncertainty u then, the true value is above v − z u with
    the probability ``confidence``, and the goal U = k u ≤ s (v − z u) is met with this probability
    if u ≤ s v / (k + s z). Here k is the coverage factor, s the goal as a fraction, and z the
    quantile of the normal distribution. ``value`` is v.
    """
    allowance = 0.0
    if goal.share is not None:
        allowance = goal.share * float(ndtri(confidence))
    return float(goal.limit_U(value)) / (COVERAGE_FACTOR + allowance)


@dataclass(frozen=True, eq=False)
class ToleranceState:
    """Decision whether a quantity meets its tolerance, and the uncertainty needed to decide.

    ``now`` holds the present decision. ``mean`` and ``sd`` are the posterior mean and standard
    deviation of the quantity, in its unit. ``aim`` holds the largest standard uncertainty with
    which a decision is possible, provided that the estimate of the quantity stays the same.
    """

    # from which forecasts start: with every effect that the possible circles can show
    now: Conformity
    mean: float
    sd: float
    aim: UncertaintyAim
    # as the sheets of a report state it; None if these have the same effects
    on_sheets: Conformity | None = None

    def with_sheets(self, stated: Conformity) -> ToleranceState:
        """Return the state with the decision of the sheets, by which the aim is reached or not.

        A campaign that stops is judged by its sheets, whose model has no effects that only further
        circles could show.
        """
        is_reached = stated.decision is not Decision.NOT_DECIDED
        return replace(self, on_sheets=stated, aim=replace(self.aim, is_reached=is_reached))

    def so_far(self, after: Array, after_very_many: Array, scattering: Array) -> ToleranceSoFar:
        """Return the present decision, and the probability that one more circle allows a decision.

        The decision is whether a quantity conforms with its tolerance. ``after``, shape (K, p, p),
        are the covariances of the p parameters after the best next circle, in units of their prior
        standard deviations, at K values of the hyper-parameters. ``after_very_many``, of the same
        shape and in the same units, are the covariances after very many circles. ``scattering``,
        shape (n, p, p), are n equally likely covariances after the best next circle, which may
        scatter more or less than other circles.
        """
        sd_next = min(float(np.sqrt((self.aim.sd(after) ** 2).mean())), self.sd)
        sd_floor = min(float(np.sqrt((self.aim.sd(after_very_many) ** 2).mean())), sd_next)
        return ToleranceSoFar(
            now=self.now if self.on_sheets is None else self.on_sheets,
            decided_next=float(self._probability_decided(self.aim.sd(scattering)).mean()),
            U_needed=COVERAGE_FACTOR * self.aim.target,
            U_floor=COVERAGE_FACTOR * sd_floor,
        )

    def _probability_decided(self, sd_next: Array) -> Array:
        """Return probabilities that the next circle allows a decision, shape (n,).

        The estimate after the next circle is not known yet. It is taken to be normally distributed
        about the present estimate. A decision is made if the new estimate is at least a guard band
        away from each limit. ``sd_next``, shape (n,), are possible standard uncertainties of the
        quantity after the next circle.
        """
        sd_next = np.minimum(sd_next, self.sd)
        shift_sd = np.maximum(np.sqrt(self.sd**2 - sd_next**2), _LEAST_TARGET * self.sd)
        guard_band = float(ndtri(self.now.confidence)) * sd_next
        low, high = self.now.limits
        edges = np.array([low - guard_band, low + guard_band, high - guard_band, high + guard_band])
        below_low, inside_low, inside_high, above_high = ndtr((edges - self.mean) / shift_sd)
        conforms = np.maximum(inside_high - inside_low, 0.0)
        return np.asarray(below_low + conforms + (1.0 - above_high))


def tolerance_states(
    posterior: xr.DataTree,
    tolerances: Mapping[str, str | Tolerance],
    known: Known,
    covariance: Array,
    confidence: float,
) -> dict[str, ToleranceState]:
    """Return, for every tolerance, the present decision and the uncertainty needed to decide.

    The decision is whether a quantity, such as a stiffness, conforms with its tolerance. The result
    is a dict; its keys are the names of the quantities. To find the uncertainty needed, each
    quantity is approximated by a linear function of the parameters. This function is fitted to the
    draws in ``posterior``. ``tolerances`` holds the tolerance of each quantity. ``known`` is the
    posterior given the circles run so far. ``covariance``, shape (K, p, p), are the covariances of
    the p parameters at K values of the hyper-parameters. ``confidence`` is the minimum probability
    at which a decision is made.
    """
    decisions = assess_conformity(posterior, tolerances, confidence=confidence)
    draws = quantity_draws(posterior, decisions)
    parameters = draws_of(posterior, known.bound)[0]
    states = {}
    for name, now in decisions.items():
        values = draws[name]
        mean = float(values.mean())
        sd = float(values.std(ddof=1))
        # The quantity that has the tolerance may have been computed for only some of the posterior
        # draws. Use the same draws of the parameters.
        scaled_parameters = (parameters - parameters.mean(axis=0)) / known.bound.scale
        same_draws = scaled_parameters[evenly_spaced(len(scaled_parameters), len(values))]
        weights = np.linalg.lstsq(same_draws, values - mean)[0]
        limits = [limit for limit in now.limits if np.isfinite(limit)]
        distance = min(abs(mean - limit) for limit in limits)
        target = max(distance, _LEAST_DISTANCE * sd) / float(ndtri(confidence))
        aim = UncertaintyAim(
            weights=weights,
            target=target,
            inflation=_inflation(sd, weights, covariance),
            is_reached=now.decision is not Decision.NOT_DECIDED,
        )
        states[name] = ToleranceState(now, mean, sd, aim)
    return states


def decided_from(
    posterior: xr.DataTree,
    tolerances: Mapping[str, str | Tolerance],
    states: Mapping[str, ToleranceState],
    confidence: float,
) -> dict[str, ToleranceState]:
    """Return the states of all tolerances, decided from the posterior of the sheets of a report.

    ``states`` hold decisions from which forecasts start. Their keys, and those of ``tolerances``
    and of the result, are the names of the quantities. ``confidence`` is the minimum probability at
    which a decision is made.
    """
    decisions = assess_conformity(posterior, tolerances, confidence=confidence)
    return {name: state.with_sheets(decisions[name]) for name, state in states.items()}
