"""Campaigns judged on possible machines: on how many of them the goals for uncertainties are met.

Possible machines are random draws of a machine's parameters and hyper-parameters. The full forecast
of a campaign simulates its analysis on every possible machine (`simulated_analyses`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ldbb_bayes.analysis.design.campaign_family import CampaignFamily
from ldbb_bayes.analysis.design.costs import Costs
from ldbb_bayes.analysis.design.goals import Goal
from ldbb_bayes.analysis.design.simulated_analyses import (
    SimulatedAnalyses,
    StatedByMachines,
    simulate_analyses,
    stated_by_machines,
)
from ldbb_bayes.campaign.campaign import Campaign, CircularTest
from ldbb_bayes.results import Array

__all__ = [
    "JudgedCampaign",
    "are_enough",
    "judge_plan",
    "judged_on_fresh_machines",
    "log_ratios_to_goals",
    "machines_needed",
    "shares_of_machines",
]

# Seed of the fresh machines on which a campaign that reaches the goals is judged once more.
_SEED_OF_FRESH_MACHINES = 2


@dataclass(frozen=True, eq=False)
class JudgedCampaign:
    """A campaign with the analyses that were simulated on the possible machines."""

    #: family to which the campaign belongs: campaigns with the same angles of the balls in their
    #: sockets, radii and certificates
    family: CampaignFamily
    #: tests of the campaign, each repeated as often as it is run
    tests: tuple[CircularTest, ...]
    #: the campaign as a plan: its tests in the order in which to run them, and the instrument with
    #: its certificates
    plan: Campaign
    #: analyses of the campaign, simulated on the possible machines
    analyses: SimulatedAnalyses
    #: standard uncertainties to expect for the parameters on every possible machine, including the
    #: fresh machines if the campaign was judged on these too
    stated: StatedByMachines

    def price(self, costs: Costs) -> float:
        """Return the price of the campaign: its machine time plus its certificates.

        ``costs`` holds the price of an hour and the time that each circle, set-up and turn of the
        balls takes.
        """
        return self.family.price(costs, self.tests)


def judge_plan(
    family: CampaignFamily, tests: Sequence[CircularTest], machines: int | None = None
) -> JudgedCampaign:
    """Return a campaign of the given tests, with the forecast of its uncertainties.

    ``family`` is the family of campaigns to which the tests belong. ``machines`` is the number of
    possible machines over which the forecast averages. The default, None, gives a full forecast
    with 64 machines.
    """
    plan = family.plan_of(tests)
    analyses = simulate_analyses(family.space.model, plan, machines=machines)
    return JudgedCampaign(family, tuple(tests), plan, analyses, stated_by_machines(analyses))


def judged_on_fresh_machines(campaign: JudgedCampaign) -> JudgedCampaign:
    """Return a campaign with the uncertainties to expect on as many machines again.

    A search judges one campaign after the other on the same possible machines, and takes the first
    that reaches the goals on enough of them. This campaign is more often lucky than the others, but
    not on fresh machines.
    """
    model = campaign.family.space.model
    analyses = simulate_analyses(model, campaign.plan, seed=_SEED_OF_FRESH_MACHINES)
    fresh = stated_by_machines(analyses)
    stated = StatedByMachines(
        fresh.names,
        np.concatenate([campaign.stated.beta, fresh.beta]),
        np.concatenate([campaign.stated.u, fresh.u]),
    )
    return replace(campaign, stated=stated)


def log_ratios_to_goals(stated: StatedByMachines, goals: Mapping[str, Goal]) -> Array:
    """Return ln(u/u*) of every goal on every possible machine, shape (machines, goals).

    u is the standard uncertainty of the goal's parameter, and u* the largest standard uncertainty
    that the goal permits.
    """
    columns = []
    for name, goal in goals.items():
        k = stated.names.index(name)
        columns.append(np.log(stated.u[:, k] / goal.limit_u(stated.beta[:, k])))
    return np.stack(columns, axis=1)


def shares_of_machines(stated: StatedByMachines, goals: Mapping[str, Goal]) -> dict[str, float]:
    """Return the share of the possible machines on which each goal is met.

    ``stated`` holds the uncertainties to expect on every possible machine. The result is a dict;
    its keys are the names of the goals' parameters. An additional entry with an empty string as its
    key is the share of the machines on which all goals are met together.
    """
    is_met = log_ratios_to_goals(stated, goals) <= 0.0
    shares = {name: float(is_met[:, k].mean()) for k, name in enumerate(goals)}
    shares[""] = float(is_met.all(axis=1).mean())
    return shares


def are_enough(share: float, machines: int, probability: float) -> bool:
    """Return whether so many possible machines reach a goal that one more will probably reach it.

    One more machine is like the n possible machines, which are random draws of the parameters and
    hyper-parameters. All n + 1 machines are equally likely to be the one with the largest
    uncertainties. If k of the n machines reach the goal, the probability that one more does is
    therefore k / (n + 1) or more.

    Parameters
    ----------
    share
        Share of the possible machines that reach the goal, k / n.
    machines
        Number n of possible machines.
    probability
        Required probability that one more machine reaches the goal.
    """
    return bool(round(share * machines) >= machines_needed(machines, probability))


def machines_needed(machines: int, probability: float) -> int:
    """Return how many of the possible machines must reach a goal; see `are_enough`."""
    return min(int(np.ceil(probability * (machines + 1))), machines)
