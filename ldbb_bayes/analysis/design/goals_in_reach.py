"""What can be asked for instead of goals that are not all reached: U of one campaign.

The campaign is the one that comes nearest to all goals within the machine time allowed, or with 40
circles if the time is not limited. What it leaves of all parameters together is in reach.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ldbb_bayes.analysis.design.campaign_family import CampaignFamily
from ldbb_bayes.analysis.design.cheapest_search import largest_counts
from ldbb_bayes.analysis.design.costs import Costs
from ldbb_bayes.analysis.design.goals import Goal
from ldbb_bayes.analysis.design.judged_campaigns import (
    JudgedCampaign,
    are_enough,
    judge_plan,
    judged_on_fresh_machines,
    log_ratios_to_goals,
    machines_needed,
)
from ldbb_bayes.analysis.design.simulated_analyses import StatedByMachines
from ldbb_bayes.results import Array

__all__ = ["nearest_campaign", "u_in_reach", "u_of_campaign"]

# Distances ln(u/u*) from the goals that agree to this number of decimals count as equal, so that
# the cheaper campaign is taken.
_DISTANCE_DIGITS = 2


def nearest_campaign(
    families: Sequence[CampaignFamily], goals: Mapping[str, Goal], costs: Costs
) -> JudgedCampaign | None:
    """Return the campaign within the machine time that comes nearest to all goals.

    A goal that is far out of reach would decide alone which campaign is the nearest. All goals are
    therefore compared with what a campaign of the largest choice leaves of them, where this is more
    than the goal permits.

    Parameters
    ----------
    families
        Families of campaigns to choose from. The last one has the largest choice of circles.
    goals
        Goals for uncertainties; the keys are the names of the parameters.
    costs
        Costs of circles, set-ups and turns of the balls, and the longest machine time allowed.

    Returns
    -------
    JudgedCampaign or None
        The campaign; None if no campaign is as short as the machine time allows.
    """
    limits = goals
    nearest = None
    least = (np.inf, np.inf)
    for family in reversed(families):
        counts = largest_counts(replace(family, goals=limits), costs)
        if counts is None:
            continue
        if limits is goals:
            limits = _relaxed(goals, family.quick.distances(counts))
            counts = largest_counts(replace(family, goals=limits), costs)
        if counts is None:
            continue
        distance = replace(family, goals=limits).quick.distance(counts)
        tests = family.tests_of(counts)
        rank = (round(distance, _DISTANCE_DIGITS), family.price(costs, tests))
        if rank < least:
            least = rank
            nearest = (family, tests)
    if nearest is None:
        return None
    return judge_plan(*nearest)


def _relaxed(goals: Mapping[str, Goal], distances: Array) -> dict[str, Goal]:
    """Return the goals, of which those that a campaign misses permit what it leaves.

    ``distances``, shape (goals,), are ln(u/u*) of every goal after this campaign, where u is the
    standard uncertainty and u* the largest that the goal permits.
    """
    relaxed = {}
    for (name, goal), distance in zip(goals.items(), distances.tolist(), strict=True):
        relaxed[name] = goal.times(float(np.exp(max(distance, 0.0))))
    return relaxed


def u_of_campaign(
    campaign: JudgedCampaign, goals: Mapping[str, Goal], probability: float
) -> dict[str, float]:
    """Return standard uncertainties that are in reach with a campaign, as `u_in_reach` states them.

    They are reached on the machines on which the campaign was judged, and on these and fresh
    machines together: the search for the cheapest campaign asks for both.
    """
    sizes: dict[str, float] = {}
    for stated in (campaign.stated, judged_on_fresh_machines(campaign).stated):
        for name, u in u_in_reach(stated, goals, probability).items():
            sizes[name] = max(u, sizes.get(name, 0.0))
    return {name: sizes[name] for name in goals if name in sizes}


def u_in_reach(
    stated: StatedByMachines, goals: Mapping[str, Goal], probability: float
) -> dict[str, float]:
    """Return standard uncertainties that enough possible machines reach, all of them together.

    Goals that enough machines reach as they are stated are left out, and have to be met on the same
    machines.

    Parameters
    ----------
    stated
        Uncertainties to expect on every possible machine after one campaign.
    goals
        Goals for uncertainties; the keys are the names of the parameters.
    probability
        Required probability that one more machine reaches the goals, as in `are_enough`.

    Returns
    -------
    dict of str to float
        Standard uncertainties in the units of the parameters; the keys are their names. Empty if
        the campaign reaches all goals as they are.
    """
    machines = len(stated.u)
    is_met = log_ratios_to_goals(stated, goals) <= 0.0
    if are_enough(float(is_met.all(axis=1).mean()), machines, probability):
        return {}
    shares = is_met.mean(axis=0)
    kept = np.array([are_enough(share, machines, probability) for share in shares])
    columns = [stated.names.index(name) for name in goals]
    u = stated.u[:, columns]
    sorted_u = np.sort(u, axis=0)
    while True:
        for rank in range(machines_needed(machines, probability), machines + 1):
            is_reached = np.where(kept, is_met, u <= sorted_u[rank - 1])
            if are_enough(float(is_reached.all(axis=1).mean()), machines, probability):
                reached = zip(goals, sorted_u[rank - 1].tolist(), kept, strict=True)
                return {name: size for name, size, is_kept in reached if not is_kept}
        # Goals that are each met on enough machines may not be met on the same machines. The one
        # that is met on the fewest is then replaced, too.
        kept[np.argmin(np.where(kept, shares, np.inf))] = False
