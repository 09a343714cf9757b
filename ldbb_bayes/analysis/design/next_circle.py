"""Choice of the next circle of a campaign that is being run, and decision whether to stop.

A campaign need not be planned as a whole: after each circle, the next circle can be chosen. There
are three kinds of aims: a small enough expanded uncertainty U (k = 2) of a parameter, a decision
whether compliance is constant or linear in force, and a decision whether a quantity conforms with
its tolerance. The campaign may stop as soon as every aim is reached with the probability that the
user asks for. Model evidence and posterior do not depend on the reason why a campaign was stopped.

The best next circle is the circle with the smallest sum of expected distances from all aims
(`aims`). No readings of the possible circles need to be simulated or fitted for the choice. The
distances are computed from the information of every possible circle, at a few values of the
hyper-parameters φ (such as the standard deviation of the noise) that are likely given the readings.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Annotated, Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from pydantic import Field

from ldbb_bayes.analysis.averaging import average
from ldbb_bayes.analysis.design.aims import Aim, total_distance
from ldbb_bayes.analysis.design.aims_so_far import (
    GoalSoFar,
    GoalState,
    Known,
    ToleranceSoFar,
    ToleranceState,
    decided_from,
    goal_states,
    known_from,
    likely_hyper_parameters,
    tolerance_states,
)
from ldbb_bayes.analysis.design.bound_plans import bind_tests
from ldbb_bayes.analysis.design.campaign_objective import objective_of
from ldbb_bayes.analysis.design.candidate_covariances import (
    CandidateCovariances,
    covariances_with_scatter,
)
from ldbb_bayes.analysis.design.candidates import VERY_MANY_REPETITIONS, Clocking
from ldbb_bayes.analysis.design.circles_to_go import CirclesToGo, count_circles_to_go
from ldbb_bayes.analysis.design.criteria import Determinant
from ldbb_bayes.analysis.design.goals import COVERAGE_FACTOR, Goal, goals_in
from ldbb_bayes.analysis.design.model_odds import ModelOdds, ModelSoFar
from ldbb_bayes.analysis.design.objective import Objective
from ldbb_bayes.analysis.design.other_circles import (
    CircleKind,
    kinds_not_allowed,
    with_other_kinds,
)
from ldbb_bayes.analysis.design.present_estimates import (
    EVIDENCE_TOLERANCE,
    FittedSds,
    has_effects_of_fit,
    sds_of_fit,
)
from ldbb_bayes.analysis.design.shares import largest_positions
from ldbb_bayes.analysis.design.space import Space
from ldbb_bayes.analysis.tolerances import Tolerance
from ldbb_bayes.campaign.campaign import Campaign, CircularTest, Direction, require_campaign
from ldbb_bayes.errors import check_seed, require
from ldbb_bayes.inference.evidences import Evidences
from ldbb_bayes.inference.fit import Concern
from ldbb_bayes.inference.posterior_concerns import contradicted_priors
from ldbb_bayes.inference.sample import sample
from ldbb_bayes.model.hybrid import BoundModel, HybridModel, require_model
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array, ByParameter, EitherSpelling, Records, Result

__all__ = ["NextCircle", "next_circle"]

# Number of possible next circles that the result lists, the best first.
_LISTED = 5
# Default number of force levels to choose from, in equal steps over the range of the campaign.
_LEVELS = 9


class _Chosen(NamedTuple):
    """The best next circle, and the space of possible circles that it was chosen from."""

    space: Space  # the possible circles, the model, and the campaign that is being run
    test: CircularTest  # the best next circle, as a test without readings


@dataclass(frozen=True, eq=False)
class NextCircle(Result):
    """The best next circle of a campaign, and whether the campaign has reached its aims.

    An aim is a goal for an uncertainty, a decision on a tolerance, or a decision between models.

    Examples
    --------
    >>> step = lb.analysis.next_circle(lb.HybridModel.first(1), campaign)
    >>> step.circles
    6
    >>> bool(step.plan().tests[0].force_N == step.table["force_N"][0])
    True
    """

    circles: int  #: number of circles of the campaign that have been run so far
    #: minimum probability at which an aim of the campaign (such as a goal for an uncertainty)
    #: counts as reached
    confidence: float
    #: comparison of each goal with the uncertainty of the goal's parameter; the keys are the names
    #: of the parameters
    goals: ByParameter[GoalSoFar]
    #: probability that all goals for uncertainties are already met; 1 if there are none
    goals_probability: float
    #: state of the decision between constant and linear compliance; None if compliance is constant
    #: in the model
    model: ModelSoFar | None
    #: whether it is an aim of the campaign to decide between constant and linear compliance
    model_is_aim: bool
    #: decisions whether quantities conform with their tolerances; the keys are the names of the
    #: quantities
    tolerances: ByParameter[ToleranceSoFar]
    #: whether every aim of the campaign (such as a goal for an uncertainty) is reached; the
    #: campaign may then stop
    finished: bool
    #: number of further circles after which every aim of the campaign is expected to be reached;
    #: None if 40 circles are not enough
    more_circles: int | None
    #: kinds of circles that were not allowed, but could help: another force, both directions of
    #: travel, balls turned in their sockets, circles of another radius
    other_kinds: tuple[CircleKind, ...]
    #: what the readings so far contradict of what was known beforehand, such as a zero of the
    #: readings that was not set; nothing else should be decided before
    concerns: tuple[Concern, ...]
    #: direction of travel of the best next circle; None if the circles run so far state none
    direction: Direction | None
    #: table of the best next circles, the best first. The columns are force_N, the angles of the
    #: balls, the radius, other settings in which circles differ, and share. The share states how
    #: much nearer the circle is expected to bring the campaign to its aims, from 0 (no nearer) to 1
    #: (all aims reached).
    table: Annotated[Records, Field(alias="next")]
    #: the best next circle, and the possible circles that it was chosen from; None if the result
    #: was read from a file
    chosen: Annotated[Any, Field(exclude=True)] = None
    #: parameters whose goals 40 more circles are not expected to reach
    unreached_goals: tuple[str, ...] = ()
    #: quantities for which 40 more circles are not expected to decide on conformity
    unreached_tolerances: tuple[str, ...] = ()
    #: whether the choice between constant and linear compliance is an aim that 40 more circles are
    #: not expected to reach
    model_is_unreached: bool = False
    #: kinds of circles that were not allowed, and are not expected to reach every aim either, all
    #: of them together. Empty if 40 circles of the kinds allowed are enough.
    kinds_in_vain: tuple[CircleKind, ...] = ()

    def plan(self) -> Campaign:
        """Return the best next circle as a plan, to be run in addition to the circles so far.

        The circle has a name that no circle of the campaign has, so that its readings cannot
        replace those of another circle.
        """
        plan: Campaign = self.chosen.space.plan_of([self.chosen.test])
        return plan


@one_blas_thread
def next_circle(
    model: HybridModel,
    campaign: Campaign,
    *,
    goals: Mapping[str, str | Goal] = MappingProxyType({}),
    tolerances: Mapping[str, str | Tolerance] | None = None,
    decide_model: bool = False,
    forces_N: Sequence[float] = (),
    clockings_deg: Sequence[Clocking] = (),
    radii_mm: Sequence[float] = (),
    directions: Sequence[Direction] = (),
    confidence: float = 0.95,
    seed: int = 1,
) -> NextCircle:
    """Return the best next circle of a campaign, and whether the aims are already reached.

    An aim is a goal for an uncertainty, or a decision: whether a quantity conforms with its
    tolerance, or whether compliance is constant or linear in force.

    Parameters
    ----------
    model : HybridModel
        Model with which the campaign is analysed.
    campaign : Campaign
        Campaign with the readings of the circles run so far.
    goals : mapping of str to str
        Goals for expanded uncertainties U (k = 2); the keys are the names of the parameters, as in
        ``{"C_XXX": "5%"}``.
    tolerances : mapping of str to str or Tolerance, optional
        Tolerances to decide on, in the form that `assess_conformity` takes. Default: the tolerances
        that the campaign states.
    decide_model : bool
        Whether a decision between constant and linear compliance is an aim. If there are neither
        goals nor tolerances, the decision is always an aim.
    forces_N : sequence of float
        Force levels to choose from [N]. Default: nine levels in equal steps over the campaign's
        range.
    clockings_deg : sequence of pair of float
        Pairs of angles of work ball and tool ball to choose from [°]. Default: the pairs in the
        campaign.
    radii_mm : sequence of float
        Radii to choose from [mm]. Default: the radii in the campaign.
    directions : sequence of {"CW", "CCW"}
        Directions of travel to choose from. Default: the directions in the campaign.
    confidence : float
        Minimum probability at which an aim counts as reached, between 0.5 and 1.
    seed : int
        Seed of the random numbers.

    Returns
    -------
    NextCircle
        The best next circles, and the state of every aim: now, and as expected after the best next
        circle.

    Raises
    ------
    InputError
        If the campaign is a plan without readings, priors are flat, names are unknown, numbers are
        out of range, or there is no aim.

    Examples
    --------
    >>> step = lb.analysis.next_circle(
    ...     lb.HybridModel.first(1), campaign, goals={"C_XXX": "20%"}, forces_N=(36.0, 742.0)
    ... )
    >>> step.finished, step.goals["C_XXX"].probability > 0.95
    (True, True)
    """
    require_model(model)
    require_campaign(campaign)
    _check_arguments(model, campaign, confidence)
    check_seed(seed)
    space = Space(
        model=model,
        pilot=campaign,
        forces_N=forces_N or _default_forces(campaign),
        clockings_deg=clockings_deg or _clockings_of(campaign),
        radii_mm=radii_mm,
        directions=directions,
        augment=True,
        seed=seed,
    )
    # The aims are read and checked before the model evidences are computed, because these take a
    # long time. An invalid goal is thus refused at once.
    read_goals = _read_goals(goals, space)
    if tolerances is None:
        tolerances = campaign.tolerances
    has_goals = len(goals) + len(tolerances) > 0
    _check_aims(space, has_goals=has_goals, decide_model=decide_model)
    evidences = Evidences(space.pilot, tolerance=EVIDENCE_TOLERANCE)
    nodes = evidences.nodes(model)[0]
    known = known_from(nodes, seed)
    # The model is applied to the circles run so far, followed by all possible circles.
    bound = bind_tests(space.model, space.pilot, space.tests, keep_pilot_tests=True)
    objective = _objective(bound, space, known.bound.names, known.phi)
    candidates = CandidateCovariances(objective)
    of_goals = goal_states(read_goals, known, candidates.before, confidence)
    evidences_of_sheets = _evidences_of_sheets(evidences, model, campaign, known)
    if of_goals:
        stated = sds_of_fit(model, evidences_of_sheets, nodes)
        of_goals = _with_other_uncertainties(of_goals, stated, confidence)
    of_tolerances = _states_of_tolerances(
        tolerances, space, known, evidences, candidates.before, confidence
    )
    of_tolerances = _decided_on_sheets(
        of_tolerances, tolerances, space, known, evidences_of_sheets, confidence
    )
    odds = ModelOdds.of(model, known, evidences_of_sheets, confidence)
    model_is_aim = odds is not None and (decide_model or not has_goals)
    odds_to_decide = odds if model_is_aim else None
    aims = _aims_of(of_goals, of_tolerances, odds_to_decide)

    covariances = candidates.after()
    distances = total_distance(aims, covariances)
    order = largest_positions(-distances, len(distances))
    scattering = covariances_with_scatter(bound, len(space.pilot.tests), int(order[0]), known.phi)
    after_very_many = _covariances_after_very_many(objective)
    goals_probability = _joint_probability(of_goals, known)
    finished = all(aim.is_reached for aim in aims) and goals_probability >= confidence
    to_go = CirclesToGo(0, after_very_many)
    if not finished:
        to_go = count_circles_to_go(aims, objective, after_very_many)
    kinds = _kinds_not_allowed(space, aims, to_go)
    return NextCircle(
        circles=len(campaign.tests),
        confidence=confidence,
        goals=EitherSpelling(
            _goals_so_far(of_goals, covariances[:, order[0]], after_very_many, scattering)
        ),
        goals_probability=goals_probability,
        model=None if odds is None else odds.so_far(scattering, after_very_many),
        model_is_aim=model_is_aim,
        tolerances=EitherSpelling(
            _tolerances_so_far(of_tolerances, covariances[:, order[0]], after_very_many, scattering)
        ),
        finished=finished,
        more_circles=to_go.number,
        other_kinds=kinds.may_help,
        concerns=tuple(contradicted_priors(known.bound, known.phi_of_draws, known.draws)),
        direction=space.tests[order[0]].direction,
        table=_best_circles(
            space, order[:_LISTED], float(total_distance(aims, candidates.before)), distances
        ),
        chosen=_Chosen(space, space.tests[order[0]]),
        unreached_goals=to_go.unreached(of_goals),
        unreached_tolerances=to_go.unreached(of_tolerances),
        model_is_unreached=not to_go.decides(odds_to_decide),
        kinds_in_vain=kinds.in_vain,
    )


class _KindsNotAllowed(NamedTuple):
    """Kinds of circles that were not allowed, by whether they may help."""

    may_help: tuple[CircleKind, ...] = ()
    in_vain: tuple[CircleKind, ...] = ()


def _kinds_not_allowed(space: Space, aims: Sequence[Aim], to_go: CirclesToGo) -> _KindsNotAllowed:
    """Return the kinds of circles that ``space`` lacks, and whether they may help.

    They are in vain if circles of the kinds in ``space`` do not reach all aims, and very many
    circles of all kinds are not expected to either.
    """
    kinds = kinds_not_allowed(space)
    if kinds and to_go.number is None and not _may_reach(space, aims):
        return _KindsNotAllowed(in_vain=kinds)
    return _KindsNotAllowed(may_help=kinds)


def _may_reach(space: Space, aims: Sequence[Aim]) -> bool:
    """Return whether very many circles of all kinds that ``space`` lacks should reach every aim.

    The possible circles may show more than those in ``space``, such as hysteresis in both
    directions. The posterior given the circles run so far is therefore computed anew.
    """
    widened = with_other_kinds(space)
    nodes = Evidences(widened.pilot, tolerance=EVIDENCE_TOLERANCE).nodes(widened.model)[0]
    phi = likely_hyper_parameters(nodes, np.random.default_rng(space.seed))
    bound = bind_tests(widened.model, widened.pilot, widened.tests, keep_pilot_tests=True)
    covariances = _covariances_after_very_many(_objective(bound, widened, nodes.bound.names, phi))
    return all(aim.is_reached or aim.is_expected(covariances) for aim in aims)


def _aims_of(
    goals: Mapping[str, GoalState],
    tolerances: Mapping[str, ToleranceState],
    odds: ModelOdds | None,
) -> list[Aim]:
    """Return the aims of a campaign: its goals, its tolerances, and the choice between two models.

    ``odds`` are the odds of linear over constant compliance; None if the decision between linear
    and constant compliance is not an aim.
    """
    aims: list[Aim] = [state.aim for state in goals.values()]
    aims += [state.aim for state in tolerances.values()]
    if odds is not None:
        aims.append(odds.aim)
    return aims


def _read_goals(goals: Mapping[str, str | Goal], space: Space) -> dict[str, Goal]:
    """Read and check goals for uncertainties, and return them with the parameters as keys.

    Raise an `InputError` if a goal is invalid. The result is empty if there are no goals.
    """
    if not goals:
        return {}
    return goals_in(space.bound, goals)


def _states_of_tolerances(
    tolerances: Mapping[str, str | Tolerance],
    space: Space,
    known: Known,
    evidences: Evidences,
    before: Array,
    confidence: float,
) -> dict[str, ToleranceState]:
    """Return, for each tolerance, the present decision and the uncertainty needed to decide.

    The decision is whether a quantity conforms with its tolerance. It is made as on the sheets of a
    report (`_posterior_on_sheets`), but with all effects that the possible circles can show. The
    result is a dict; its keys are the names of the quantities with tolerances. ``space`` holds the
    model and the campaign, ``evidences`` computes evidences of the campaign, and ``known`` is the
    posterior given the circles run so far. ``before`` are the covariances of the parameters before
    the next circle. ``confidence`` is the minimum probability at which a decision is made. If there
    are no tolerances, no posterior draws are made, because they take time.
    """
    if not tolerances:
        return {}
    posterior = _posterior_on_sheets(space.model, space.pilot, evidences, space.seed)
    return tolerance_states(posterior, tolerances, known, before, confidence)


def _evidences_of_sheets(
    evidences: Evidences, model: HybridModel, campaign: Campaign, known: Known
) -> Evidences:
    """Return the evidences from which the sheets of a report decide.

    They are of the circles run so far, without effects that only further circles can show, such as
    hysteresis if these may run in both directions. ``campaign`` holds the circles run so far alone,
    and ``known`` is the posterior given these, with all effects. ``evidences``, which have all
    effects too, are returned if there are no such effects.
    """
    if has_effects_of_fit(model, campaign, known.bound):
        return evidences
    return Evidences(campaign, tolerance=EVIDENCE_TOLERANCE)


def _decided_on_sheets(
    states: dict[str, ToleranceState],
    tolerances: Mapping[str, str | Tolerance],
    space: Space,
    known: Known,
    evidences: Evidences,
    confidence: float,
) -> dict[str, ToleranceState]:
    """Return the states of all tolerances with the decisions that the sheets of a report state.

    ``evidences`` are those from which the sheets decide (`_evidences_of_sheets`). The other
    arguments are as in `_states_of_tolerances`, whose result ``states`` are.
    """
    campaign = evidences.campaign
    if not states or has_effects_of_fit(space.model, campaign, known.bound):
        return states
    posterior = _posterior_on_sheets(space.model, campaign, evidences, space.seed)
    return decided_from(posterior, tolerances, states, confidence)


def _posterior_on_sheets(
    model: HybridModel, campaign: Campaign, evidences: Evidences, seed: int
) -> xr.DataTree:
    """Return the posterior from which the sheets of a report decide on conformity.

    It is averaged over constant and linear compliance. If compliance is constant in ``model``,
    there is nothing to average. ``evidences`` computes evidences of ``campaign``.
    """
    if model.degree == 0:
        return sample(model, campaign, sampler="independent", seed=seed)
    models = {"constant": model.with_degree(0), "linear": model}
    return average(models, campaign, evidences=evidences, seed=seed)


def _with_other_uncertainties(
    goals: Mapping[str, GoalState], stated: FittedSds, confidence: float
) -> dict[str, GoalState]:
    """Return the goals, each with the U (k = 2) that analyses of the circles run so far state.

    The keys of ``goals`` are the names of the parameters. ``confidence`` is the minimum probability
    at which a goal counts as reached.
    """
    completed = {}
    for name, state in goals.items():
        completed[name] = state
        if name in stated.of_fit:
            of_fit = COVERAGE_FACTOR * stated.of_fit[name]
            completed[name] = state.with_fit(of_fit, confidence)
        if name in stated.averaged:
            averaged = COVERAGE_FACTOR * stated.averaged[name]
            completed[name] = replace(completed[name], averaged_U=averaged)
    return completed


def _goals_so_far(
    goals: Mapping[str, GoalState], after: Array, after_very_many: Array, scattering: Array
) -> dict[str, GoalSoFar]:
    """Return a comparison of each goal with the uncertainty of the goal's parameter.

    The keys of the result are the names of the parameters. ``after``, shape (K, p, p), are the
    covariances of the p parameters after the best next circle, at K values of the hyper-parameters.
    ``after_very_many``, of the same shape, are the covariances after very many circles.
    ``scattering``, shape (n, p, p), are n equally likely covariances after the best next circle,
    which may scatter more or less than other circles.
    """
    return {name: state.so_far(after, after_very_many, scattering) for name, state in goals.items()}


def _tolerances_so_far(
    tolerances: Mapping[str, ToleranceState],
    after: Array,
    after_very_many: Array,
    scattering: Array,
) -> dict[str, ToleranceSoFar]:
    """Return, for each tolerance, the present decision and what the best next circle may decide.

    The keys of the result are the names of the quantities with tolerances. The other arguments are
    those of `_goals_so_far`.
    """
    return {
        name: state.so_far(after, after_very_many, scattering) for name, state in tolerances.items()
    }


def _check_arguments(model: HybridModel, campaign: Campaign, confidence: float) -> None:
    """Check the arguments of the choice of the next circle.

    Raise an `InputError` if the campaign has no readings, if the priors of the model are flat, or
    if the confidence is not between 0.5 and 1.
    """
    require(
        not campaign.is_plan,
        "campaign must have readings, got a plan. Run its first circles, or use design.",
    )
    require(
        not model.prior.flat,
        "the model must have proper priors, got flat ones. Use the default preset.",
    )
    require(
        0.5 < confidence < 1.0,
        f"confidence must lie between 0.5 and 1, got {confidence}. For 95 % give 0.95.",
    )


def _check_aims(space: Space, *, has_goals: bool, decide_model: bool) -> None:
    """Raise an `InputError` if the campaign has no aim, or an aim that does not suit the model.

    ``has_goals`` states whether there are goals for uncertainties or tolerances, and
    ``decide_model`` whether a decision between constant and linear compliance is an aim. ``space``
    holds the model. If compliances are constant in the model, such a decision cannot be an aim.
    """
    has_slopes = any(parameter.group == "slope" for parameter in space.bound.parameters)
    require(
        has_slopes or not decide_model,
        "compliances must change with force in the model for a decision, got constant ones. Use a"
        " degree above 0.",
    )
    require(
        has_slopes or has_goals,
        "constant compliances must come with a goal or a tolerance, got neither. Give one, or use a"
        " degree above 0.",
    )


def _default_forces(campaign: Campaign) -> list[float]:
    """Return nine force levels [N] in equal steps over the range of a campaign's forces."""
    low = float(campaign.forces_N.min())
    high = float(campaign.forces_N.max())
    levels: list[float] = np.unique(np.linspace(low, high, _LEVELS).round(1)).tolist()
    return levels


def _clockings_of(campaign: Campaign) -> list[Clocking]:
    """Return the different pairs of angles of the balls in their sockets [°] in a campaign."""
    pairs = [(test.work_ball_deg, test.tool_ball_deg) for test in campaign.tests]
    return list(dict.fromkeys(pairs))


def _objective(bound: BoundModel, space: Space, names: Sequence[str], phi: Array) -> Objective:
    """Return the information from the circles run so far, and from each possible next circle.

    The result holds the information as matrices. It is an ``Objective``, the object that a search
    for a design maximises; here, only its matrices are used, not its criterion. All parameters are
    of interest; ``names`` are their names. ``space`` holds the possible circles, and ``bound`` is
    the model applied to the circles run so far and to the possible circles. ``phi``, shape (K, h),
    are K equally likely values of the h hyper-parameters.
    """
    tests_run = len(space.pilot.tests)
    return objective_of(bound, tests_run, phi, names, Determinant(len(names)))


def _joint_probability(states: Mapping[str, GoalState], known: Known) -> float:
    """Return the posterior probability that all uncertainty goals are already met."""
    all_are_met = np.ones(len(known.draws), bool)
    for state in states.values():
        all_are_met &= state.is_met()
    return float(all_are_met.mean())


def _covariances_after_very_many(objective: Objective) -> Array:
    """Return the covariances of the parameters if every candidate circle were run very many times.

    The candidate circles are the candidate tests of ``objective``. The result has the shape (K, p,
    p), for p parameters at K values of the hyper-parameters.
    """
    # One value of the hyper-parameters after the other, because the products need much memory.
    information = np.array(
        [(np.swapaxes(rows, -1, -2) @ rows).sum(axis=0) for rows in objective.rows]
    )
    return np.linalg.inv(objective.prior + VERY_MANY_REPETITIONS * information)[
        :, -objective.interest :, -objective.interest :
    ]


def _best_circles(
    space: Space, order: Array, distance_now: float, distances: Array
) -> pd.DataFrame:
    """Return a table of the best next circles, with the progress towards the aims after each.

    ``order`` are the indices of the best circles among the possible circles, the best first.
    ``distance_now`` is the campaign's present total distance from all aims (`total_distance`).
    ``distances`` holds, for each possible circle, the total distance expected after it.
    """
    table = space.frame([space.tests[k] for k in order])
    return table.assign(share=_progress_of_circles(distance_now, distances[order]))


def _progress_of_circles(distance_now: float, distances: Array) -> Array:
    """Return how much nearer each circle brings the campaign to its aims, as a fraction.

    The fraction is 0 if the circle does not help, and 1 if all aims are reached after it.
    ``distance_now`` is the campaign's present total distance from its aims (`total_distance`).
    ``distances`` holds, for each circle, the total distance expected after it.
    """
    if distance_now <= 0.0:
        return np.ones(len(distances))
    return np.clip((distance_now - distances) / distance_now, 0.0, 1.0)
