"""Cheapest campaign that reaches every goal: circles to run and certificates to buy.

A goal is the largest expanded uncertainty U (k = 2) that a parameter may have. The pilot is the
campaign or plan that a design starts from. Possible machines are random draws of a machine's
parameters and hyper-parameters from the posterior given the pilot's readings or, if there are none,
from the prior. The user states a share of these machines, such as 90 %. A campaign reaches its
goals if all goals would be met on at least this share of the possible machines.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from ldbb_bayes.analysis.design.analysis_model import analysis_model
from ldbb_bayes.analysis.design.averaged_forecast import averaged_uncertainties
from ldbb_bayes.analysis.design.campaign_family import CampaignFamily, families_of
from ldbb_bayes.analysis.design.candidates import Clocking
from ldbb_bayes.analysis.design.certificate_offers import (
    CertificateOffer,
    offers_in,
    require_missing,
    sets_of_offers,
)
from ldbb_bayes.analysis.design.cheapest_search import (
    find_cheapest,
    judge_largest,
    truncation_ratios,
)
from ldbb_bayes.analysis.design.costs import Costs
from ldbb_bayes.analysis.design.customary_plans import equal_steps, published_forces
from ldbb_bayes.analysis.design.forecast import forecast_plan
from ldbb_bayes.analysis.design.goal_design_result import (
    CustomaryPlan,
    GoalDesign,
    GoalForecast,
    GoalPlan,
    StatedGoal,
)
from ldbb_bayes.analysis.design.goals import COVERAGE_FACTOR, USUAL_PROBABILITY, Goal, goals_in
from ldbb_bayes.analysis.design.goals_in_reach import (
    nearest_campaign,
    u_in_reach,
    u_of_campaign,
)
from ldbb_bayes.analysis.design.judged_campaigns import (
    JudgedCampaign,
    are_enough,
    judge_plan,
    shares_of_machines,
)
from ldbb_bayes.analysis.design.obstacles import NearMiss, Obstacle, near_miss_of, obstacles_of
from ldbb_bayes.analysis.design.possible_certificates import require_possible
from ldbb_bayes.analysis.design.present_estimates import (
    EVIDENCE_TOLERANCE,
    PRESENT_DRAWS,
    present_estimates,
    sds_of_fit,
)
from ldbb_bayes.analysis.design.simulated_analyses import states_of
from ldbb_bayes.analysis.design.space import Space
from ldbb_bayes.campaign.campaign import Campaign, CircularTest, Direction
from ldbb_bayes.errors import check_probability, require
from ldbb_bayes.inference.evidences import Evidences
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.results import Array, EitherSpelling

__all__ = ["design_for_goals"]

# Default clockings (pairs of angles of the balls [°]) to choose from: the balls are not turned, or
# both balls are turned by 45°. A turn of 45° changes the phase of form errors with 2, 3 and 4 waves
# per turn by 90°, 135° and 180°.
_CLOCKINGS: tuple[Clocking, ...] = ((0.0, 0.0), (45.0, 45.0))
_DIRECTIONS: tuple[Direction, ...] = ("CW", "CCW")
# Default number of forces to choose from, in equal steps over the range of force of the campaign
# that the design starts from.
_FORCE_LEVELS = 5
# Largest number of campaigns in the result of a search for the cheapest campaign: the cheapest
# campaign, and the two next cheapest.
_SHOWN = 3
# Number of customary campaigns with which the cheapest campaign is compared: one in equal steps of
# force, and one with the forces of the published experiment.
_CUSTOMARY = 2


def design_for_goals(
    model: HybridModel,
    pilot: Campaign,
    stated: Mapping[str, Any],
    *,
    costs: Costs | None = None,
    certificates: Mapping[str, float] | None = None,
    probability: float = USUAL_PROBABILITY,
    forces_N: Sequence[float] | None = None,
    clockings_deg: Sequence[Clocking] | None = None,
    radii_mm: Sequence[float] = (),
    directions: Sequence[Direction] = (),
    augment: bool = False,
    seed: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> GoalDesign:
    """Return the cheapest campaigns that reach the user's goals for uncertainties.

    The arguments are the same as in `ldbb_bayes.design`; ``stated`` are the goals. Raise an
    `InputError` if the priors are flat, or if a goal, certificate or probability is not valid.
    """
    costs = costs or Costs()
    require(
        isinstance(costs, Costs),
        f"costs must be Costs, got {costs!r}. Write for example lb.analysis.Costs(hours=2.0).",
    )
    check_probability(probability, "probability")
    require(
        not model.prior.flat,
        "goals must be held against proper priors, got flat ones. Use the default preset.",
    )
    offers = offers_in(certificates or {})
    require_missing(offers, pilot.instrument)
    require_possible(offers, model, pilot)
    goals = goals_in(model.bind(pilot), stated)
    if forces_N is None:
        low = float(pilot.forces_N.min())
        high = float(pilot.forces_N.max())
        forces_N = tuple(np.unique(np.linspace(low, high, _FORCE_LEVELS)).tolist())
    space = Space(
        model=model,
        pilot=pilot,
        forces_N=forces_N,
        clockings_deg=clockings_deg or _CLOCKINGS,
        radii_mm=radii_mm,
        directions=directions or _directions_of(pilot),
        parameters=tuple(goals),
        augment=augment,
        seed=seed,
    )
    known = _stated_goals(space, goals, pilot, probability)
    needed = {name: goal for name, goal in goals.items() if not known[name].met_by_pilot}
    return _search_campaigns(space, known, needed, costs, offers, probability, _Steps(progress))


@dataclass
class _Steps:
    """Counter of the finished steps (searches and forecasts) of a design for uncertainty goals."""

    #: function that is called with the number of finished steps (searches and forecasts) and the
    #: number of all steps; None if the progress is not reported
    progress: Callable[[int, int], None] | None
    done: int = 0

    def finish_one(self) -> None:
        """Count one more step (search or forecast) as finished, and report the progress."""
        self.finish(self.done + 1)

    def finish(self, done: int) -> None:
        """Record how many steps (searches and forecasts) are finished, and report the progress.

        ``done`` is the number of finished steps.
        """
        self.done = done
        if self.progress is not None:
            self.progress(done, 2 * _SHOWN + _CUSTOMARY)


def _directions_of(pilot: Campaign) -> tuple[Direction, ...]:
    """Return CW and CCW, or an empty tuple if a test of the pilot states no direction of travel.

    The model can include hysteresis only if the directions of all tests are known.
    """
    if any(test.direction is None for test in pilot.tests):
        return ()
    return _DIRECTIONS


def _stated_goals(
    space: Space, goals: Mapping[str, Goal], pilot: Campaign, probability: float
) -> dict[str, StatedGoal]:
    """Return each goal with the estimate of its parameter and the uncertainty of the estimate.

    ``pilot`` is the campaign or plan that the design starts from, as the user gave it. ``space``
    holds it with tests that may be run later. If the pilot has readings, the estimate and its
    uncertainty are the posterior mean and standard deviation given these readings. The goal counts
    as met if the uncertainty that a fit states meets it on the fraction ``probability`` of the
    machines that these readings leave likely, as a campaign would have to. If the pilot is a plan
    without readings, both come from the prior, and the goal does not count as met. The estimate is
    then the median of the parameter's absolute value, because the mean may be zero. The result
    states the expanded uncertainty U (k = 2) and the largest U that the goal allows, both in the
    unit of the parameter. The result is a dict; its keys are the names of the goals' parameters.
    """
    bound = space.bound
    sds: dict[str, float] = {}
    averaged: dict[str, float] = {}
    draws: Array | None = None
    if pilot.is_plan:
        value = np.median(np.abs(states_of(space.model, space.pilot).beta), axis=0)
        sd = np.asarray(bound.prior_sd)
    else:
        nodes = Evidences(space.pilot, tolerance=EVIDENCE_TOLERANCE).nodes(space.model)[0]
        value, sd = present_estimates(nodes)
        draws, _ = nodes.draw(PRESENT_DRAWS, np.random.default_rng(space.seed))
        evidences_of_fit = Evidences(pilot, tolerance=EVIDENCE_TOLERANCE)
        sds, averaged = sds_of_fit(space.model, evidences_of_fit, nodes)
    stated = {}
    for name, goal in goals.items():
        k = bound.names.index(name)
        probability_met = None
        if draws is not None:
            sd_of_fit = sds.get(name, float(sd[k]))
            probability_met = goal.probability_met(draws[:, k], sd_of_fit)
        stated[name] = StatedGoal(
            goal,
            limit_U=float(goal.limit_U(value[k])),
            value=float(value[k]),
            U=COVERAGE_FACTOR * float(sd[k]),
            met_by_pilot=probability_met is not None and probability_met >= probability,
            U_of_fit=_expanded(sds.get(name)),
            averaged_U=_expanded(averaged.get(name)),
            probability=probability_met,
        )
    return stated


def _expanded(sd: float | None) -> float | None:
    """Return the expanded uncertainty U (k = 2) for a standard uncertainty; None for None."""
    return None if sd is None else COVERAGE_FACTOR * sd


def _search_campaigns(
    space: Space,
    known: dict[str, StatedGoal],
    needed: Mapping[str, Goal],
    costs: Costs,
    offers: Sequence[CertificateOffer],
    probability: float,
    steps: _Steps,
) -> GoalDesign:
    """Return the cheapest campaigns that would reach all uncertainty goals not met yet.

    The result also has customary campaigns for comparison, and the reasons why goals cannot be
    reached. Goals that cannot be reached with any certificates are left out of the search.

    ``needed`` are the goals that are not yet met. ``known`` are all goals, with the present
    estimates and uncertainties of their parameters. The keys of both dictionaries are the names of
    the parameters. ``space`` holds the circles to choose from, and ``offers`` are the certificates
    that could be bought. A campaign must reach all goals on at least the fraction ``probability``
    of the possible machines. ``costs`` are the times and prices of circles and set-ups, and the
    longest machine time allowed. ``steps`` reports the progress.
    """
    steps.finish(0)
    obstacles: dict[str, Obstacle] = {}
    unreachable: tuple[str, ...] = ()
    searched = _SearchResult()
    if needed:
        plan = space.plan_of(space.tests[:1], seed=space.seed)
        states = states_of(space.model, plan)
        sets = sets_of_offers(offers, space.pilot.instrument)
        widest = CampaignFamily(replace(space, parameters=tuple(needed)), (), needed, states)
        if widest.quick.floor().max() > 0.0:
            # A goal may be out of reach only because the quick forecast allows negative
            # compliances.
            largest = judge_largest(widest)
            widest = replace(widest, truncation=truncation_ratios(largest))
            limits = {name: known[name].limit_U for name in needed}
            obstacles = obstacles_of(widest, limits)
        reachable = _reachable(widest, sets)
        unreachable = tuple(name for name in needed if name not in reachable)
        if reachable:
            searched = _search_reachable(widest, sets, reachable, costs, probability, steps)
    design = GoalDesign(
        goals=EitherSpelling(known),
        probability=probability,
        costs=costs,
        plans=searched.plans,
        obstacles=obstacles,
        near_misses=dict(searched.near_misses),
        unreachable=unreachable,
        customary=searched.customary,
        without_limit=searched.without_limit,
        measured=not space.pilot.is_plan,
        pilot=space.pilot.name,
        adds_to_pilot=space.augment,
        unreached=_forecasts_of_unreached(searched, needed, costs),
    )
    if design.all_reached:
        return design
    families = tuple(families_of(widest.space, sets, needed, widest.states, widest.truncation))
    return _with_what_is_in_reach(design, families, needed, searched.cheapest)


def _with_what_is_in_reach(
    design: GoalDesign,
    families: Sequence[CampaignFamily],
    needed: Mapping[str, Goal],
    cheapest: JudgedCampaign | None,
) -> GoalDesign:
    """Return a design of which not all goals are reached, with what can be asked for instead.

    ``families`` are the families of campaigns to choose from, and ``needed`` are all goals that are
    not met yet; the keys are the names of the parameters. ``cheapest`` is the cheapest campaign for
    the goals that can be reached; None if there is none. These goals are kept as they are.
    """
    nearest = nearest_campaign(families, needed, design.costs)
    if nearest is None:
        shortest = [
            family.least_minutes(design.costs, family.fewest_circles) for family in families
        ]
        return replace(design, shortest_minutes=min(shortest))
    u = u_of_campaign(nearest, needed, design.probability)
    if cheapest is not None and any(name in u for name in cheapest.family.goals):
        # The search has judged this campaign on fresh machines already.
        nearest = cheapest
        u = u_in_reach(cheapest.stated, needed, design.probability)
    in_reach = {name: COVERAGE_FACTOR * size for name, size in u.items()}
    obstacles = {}
    for name, obstacle in design.obstacles.items():
        obstacles[name] = replace(obstacle, reachable_U=in_reach.get(name))
    near_misses = {}
    for name, near_miss in design.near_misses.items():
        near_misses[name] = replace(near_miss, reachable_U=in_reach.get(name))
    return replace(
        design,
        obstacles=obstacles,
        near_misses=near_misses,
        nearest=_plan_of(nearest, needed, design.costs),
        in_reach=in_reach,
    )


class _SearchResult(NamedTuple):
    """Result of the search for the cheapest campaigns; most fields are those of `GoalDesign`."""

    plans: tuple[GoalPlan, ...] = ()
    customary: tuple[CustomaryPlan, ...] = ()
    near_misses: Mapping[str, NearMiss] = MappingProxyType({})
    without_limit: GoalPlan | None = None
    #: the cheapest campaign as the search found it; None if ``plans`` is empty
    cheapest: JudgedCampaign | None = None


def _search_reachable(
    widest: CampaignFamily,
    sets: Sequence[tuple[CertificateOffer, ...]],
    goals: Mapping[str, Goal],
    costs: Costs,
    probability: float,
    steps: _Steps,
) -> _SearchResult:
    """Return the cheapest campaigns for goals that very many circles would reach.

    A goal that 40 circles do not reach is a near miss; the campaigns are then for the other goals.
    ``widest`` is the family of campaigns with all clockings and radii, and ``sets`` are the sets of
    certificates that could be bought. For the other arguments see `_search_campaigns`.
    """
    narrowed = replace(widest.space, parameters=tuple(goals))
    families = tuple(families_of(narrowed, sets, goals, widest.states, widest.truncation))
    search = find_cheapest(
        families, goals, costs, probability, _SHOWN, on_campaign=steps.finish_one
    )
    if search.campaigns:
        plans = _plans_of(search.campaigns, goals, costs, steps)
        cheapest = search.campaigns[0]
        customary = _customary_plans(cheapest, goals, costs, steps)
        return _SearchResult(plans, customary, cheapest=cheapest)
    if search.is_too_long:
        search = find_cheapest(
            families, goals, replace(costs, hours=None), probability, 1, on_campaign=lambda: None
        )
        if search.campaigns:
            return _SearchResult(without_limit=_plan_of(search.campaigns[0], goals, costs))
    if search.nearest is None:
        return _SearchResult()
    near_misses = _near_misses(search.nearest, search.nearest_by_goal, goals, probability)
    others = {name: goal for name, goal in goals.items() if name not in near_misses}
    if not others:
        return _SearchResult(near_misses=near_misses)
    searched = _search_reachable(widest, sets, others, costs, probability, steps)
    return searched._replace(near_misses={**near_misses, **searched.near_misses})


def _forecasts_of_unreached(
    searched: _SearchResult, needed: Mapping[str, Goal], costs: Costs
) -> dict[str, GoalForecast]:
    """Return forecasts of what the cheapest campaign leaves of the goals that it does not reach.

    ``searched`` is the result of the search, and ``needed`` are all goals that are not yet met. The
    keys of both dictionaries are the names of the goals' parameters. ``costs`` are the times and
    prices. The result is empty if the search found no campaign.
    """
    cheapest = searched.cheapest
    if cheapest is None:
        return {}
    reached = searched.plans[0].goals
    unreached = {name: goal for name, goal in needed.items() if name not in reached}
    if not unreached:
        return {}
    plan = _plan_of(cheapest, unreached, costs)
    return _with_averaged_uncertainties(plan, cheapest).goals


def _reachable(
    widest: CampaignFamily, sets: Sequence[tuple[CertificateOffer, ...]]
) -> dict[str, Goal]:
    """Return the goals that are reached after very many circles, with some set of certificates.

    ``widest`` is the family of campaigns with all clockings and radii, and ``sets`` are the sets of
    certificates that could be bought. The result is a dict; its keys are the names of the goals'
    parameters.
    """
    goals = widest.goals
    reachable: dict[str, Goal] = {}
    for offers in sets:
        floor = replace(widest, offers=offers).quick.floor()
        for name, distance in zip(goals, floor.tolist(), strict=True):
            if distance <= 0.0:
                reachable[name] = goals[name]
        if len(reachable) == len(goals):
            break
    return {name: goal for name, goal in goals.items() if name in reachable}


def _near_misses(
    nearest: JudgedCampaign,
    nearest_by_goal: Mapping[str, JudgedCampaign],
    goals: Mapping[str, Goal],
    probability: float,
) -> dict[str, NearMiss]:
    """Return the reasons why no campaign that was judged meets a goal on enough machines.

    Goals are upper limits of expanded uncertainties. Of all campaigns that were judged, ``nearest``
    meets all goals on the largest share of the possible machines, and ``nearest_by_goal[name]`` the
    goal ``name`` alone. The result is a dict; its keys are the names of the goals' parameters. Each
    value gives the reason: the source that would contribute most to the variance of the parameter
    if very many circles were run, and the certificate that would reduce the uncertainty most. It
    also states the number of circles of the campaign that comes nearest to the goal, the
    certificates that it buys, the expanded uncertainty that is not exceeded on 90 % of the possible
    machines, and the share of these machines on which the goal is met.

    A goal is included if no campaign meets it on enough of the possible machines to be met with the
    ``probability`` (`are_enough`). If each goal is met on enough machines by some campaign, but no
    campaign meets all of them, the goal is included that ``nearest`` meets on the fewest machines.
    """
    campaigns: dict[str, JudgedCampaign] = {}
    for name, campaign in nearest_by_goal.items():
        share = shares_of_machines(campaign.stated, goals)[name]
        if not are_enough(share, len(campaign.stated.u), probability):
            campaigns[name] = campaign
    if not campaigns:
        shares = shares_of_machines(nearest.stated, goals)
        campaigns[min(goals, key=lambda goal: shares[goal])] = nearest
    near_misses = {}
    for name, campaign in campaigns.items():
        near_misses[name] = near_miss_of(
            campaign.family,
            name,
            circles=len(campaign.tests),
            likely_U=COVERAGE_FACTOR * campaign.stated.likely_u(name),
            probability=shares_of_machines(campaign.stated, goals)[name],
        )
    return near_misses


def _plans_of(
    campaigns: Sequence[JudgedCampaign], goals: Mapping[str, Goal], costs: Costs, steps: _Steps
) -> tuple[GoalPlan, ...]:
    """Return a plan for every campaign, with its costs and its forecast for every uncertainty goal.

    The keys of ``goals`` are the names of the parameters, and ``costs`` are the times and prices.
    ``steps`` reports the progress: the steps of the search are counted as finished first, and one
    step is counted after each campaign.
    """
    steps.finish(_SHOWN)
    plans: list[GoalPlan] = []
    for campaign in campaigns:
        plan = _plan_of(campaign, goals, costs)
        if not plans:
            plan = _with_averaged_uncertainties(plan, campaign)
        plans.append(plan)
        steps.finish_one()
    return tuple(plans)


def _with_averaged_uncertainties(plan: GoalPlan, campaign: JudgedCampaign) -> GoalPlan:
    """Return a plan with uncertainties that are averaged over constant and linear compliance."""
    averaged = averaged_uncertainties(campaign.analyses)
    if not averaged:
        return plan
    goals = {}
    for name, goal in plan.goals.items():
        goals[name] = goal
        if name in averaged:
            goals[name] = replace(goal, averaged_U=COVERAGE_FACTOR * averaged[name].sd)
    return replace(plan, goals=goals)


def _plan_of(campaign: JudgedCampaign, goals: Mapping[str, Goal], costs: Costs) -> GoalPlan:
    """Return a campaign with its costs and with the forecast for every uncertainty goal.

    The keys of ``goals`` are the names of the parameters, and ``costs`` are the times and prices.
    """
    family = campaign.family
    shares = shares_of_machines(campaign.stated, goals)
    forecast = forecast_plan(family.space.model, campaign.plan, analyses=campaign.analyses)
    expected = forecast.expected
    forecasts = {}
    for name in goals:
        entry = expected[name]
        forecasts[name] = GoalForecast(
            unit=entry.unit,
            U=COVERAGE_FACTOR * entry.sd,
            likely_U=COVERAGE_FACTOR * entry.likely_sd,
            probability=shares[name],
        )
    frame = family.space.frame(campaign.tests)
    return GoalPlan(
        tests=frame.value_counts(sort=False).rename("count").reset_index(),
        circles=len(campaign.tests),
        certificates=tuple(offer.name for offer in family.offers),
        minutes=family.minutes(costs, campaign.tests),
        price=campaign.price(costs),
        probability=shares[""],
        goals=forecasts,
        expected=expected,
        planned=campaign.plan,
        model=analysis_model(family.space, campaign.tests),
    )


def _customary_plans(
    best: JudgedCampaign, goals: Mapping[str, Goal], costs: Costs, steps: _Steps
) -> tuple[CustomaryPlan, ...]:
    """Return campaigns as they are usually run, each with the best campaign of the same size.

    Campaigns of the same size have the same number of circles. The campaigns as they are usually
    run use no further certificates of the instrument, and only one radius: the first of the
    possible radii. They are run in every plane of ``best``, the cheapest campaign: circles in one
    plane show nothing of a parameter that only another plane shows. The best campaigns belong to
    the same family (same radii, certificates and angles of the balls) as ``best``. The keys of
    ``goals`` are the names of the parameters, and ``costs`` are the times and prices. ``steps``
    reports the progress: all earlier steps are counted as finished first, and one step is counted
    after each campaign.
    """
    steps.finish(2 * _SHOWN)
    family = best.family
    uncertified = CampaignFamily(family.space, (), goals, family.states)
    space = family.space
    planes = {test.plane for test in best.tests}
    radius_mm = float(space.radii_mm[0])
    templates = []
    for template in space.templates:
        if template.plane in planes:
            templates.append(replace(template, radius_mm=radius_mm))
    lowest_N = float(space.pilot.forces_N.min())
    highest_N = float(space.pilot.forces_N.max())
    tests_by_name: dict[str, tuple[CircularTest, ...]] = {
        "equal steps": equal_steps(templates, lowest_N, highest_N, len(best.tests)),
        "seven published forces": published_forces(templates, lowest_N, highest_N),
    }
    plans = []
    for name, tests in tests_by_name.items():
        customary = judge_plan(uncertified, tests)
        ours = best
        if len(tests) != len(best.tests):
            counts = family.best_counts(len(tests))
            ours = judge_plan(family, family.tests_of(counts))
        plans.append(
            CustomaryPlan(name, _plan_of(customary, goals, costs), _plan_of(ours, goals, costs))
        )
        steps.finish_one()
    return tuple(plans)
