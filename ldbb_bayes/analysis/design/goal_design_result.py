"""Result of a search for the cheapest campaigns that reach given goals for uncertainties."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any

from pydantic import Field

from ldbb_bayes.analysis.design.costs import Costs
from ldbb_bayes.analysis.design.forecast import Expected
from ldbb_bayes.analysis.design.goals import Goal
from ldbb_bayes.analysis.design.obstacles import NearMiss, Obstacle
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.errors import InputError, require
from ldbb_bayes.results import ByParameter, Records, Result

__all__ = ["CustomaryPlan", "GoalDesign", "GoalForecast", "GoalPlan", "StatedGoal"]


@dataclass(frozen=True)
class StatedGoal(Result):
    """A goal for an uncertainty as the user stated it, and the present estimate of the parameter.

    The present estimate comes from the campaign or plan that the design starts from.
    """

    goal: Goal
    #: largest expanded uncertainty U (k = 2) that the goal allows if the goal's parameter equals
    #: ``value``, in the unit of the parameter
    limit_U: float
    #: estimate of the goal's parameter from the readings of the campaign that the design starts
    #: from; if there are no readings, the median of the parameter's absolute value under the prior
    value: float
    #: expanded uncertainty (k = 2) that the goal's parameter has before the tests of the design are
    #: run. It comes from the readings of the campaign that the design starts from, or from the
    #: prior if there are no readings.
    U: float
    #: whether the goal for the parameter's uncertainty is already met, with the probability that
    #: the user asks for, by a fit of the circles run so far
    met_by_pilot: bool
    #: expanded uncertainty (k = 2) that a fit of the circles run so far states. It differs from
    #: ``U`` if the model includes effects that only the planned circles can show, such as
    #: hysteresis if they run in both directions. None if there are no such effects, so that the fit
    #: states ``U``, and if there are no readings.
    U_of_fit: float | None = None
    #: expanded uncertainty (k = 2) that the goal's parameter has now, averaged over constant and
    #: linear compliance, as the sheets of a report state it. None if compliance is constant in the
    #: model, and if there are no readings.
    averaged_U: float | None = None
    #: probability that the expanded uncertainty which a fit of the circles run so far states
    #: already meets the goal. A goal in percent is of the parameter's true value, which is not
    #: known exactly. None if there are no readings.
    probability: float | None = None


@dataclass(frozen=True)
class GoalForecast(Result):
    """Forecast of the uncertainty that a campaign will give for the parameter of one goal."""

    unit: str
    #: median, over the possible machines, of the expanded uncertainty (k = 2) of the goal's
    #: parameter after the campaign
    U: float
    #: the expanded uncertainty (k = 2) of the goal's parameter after the campaign is at most this
    #: value on 90 % of the possible machines
    likely_U: float
    #: share of the possible machines on which the campaign meets the goal for the parameter's
    #: uncertainty
    probability: float
    #: median, over the possible machines, of the expanded uncertainty (k = 2) after the campaign,
    #: averaged over constant and linear compliance, as the sheets of a report state it. None if
    #: compliance is constant in the model, and for all campaigns but the cheapest.
    averaged_U: float | None = None


@dataclass(frozen=True, eq=False)
class GoalPlan(Result):
    """A campaign that reaches the uncertainty goals: its circles, certificates and costs."""

    #: table of the tests of the campaign, with one row for each different test. The columns are
    #: force_N, further settings, and count, which is the number of times to run the test.
    tests: Records
    circles: int
    #: names of the calibration certificates to buy. For example, "balls of grade G10" is a
    #: certificate that states the grade, and with it the largest form error, of both balls.
    certificates: tuple[str, ...]
    minutes: float  #: machine time of the campaign [min]
    #: price of the campaign's machine time and certificates, in the unit of money of `Costs`
    price: float
    #: share of the possible machines on which the campaign meets all goals for uncertainties
    probability: float
    #: forecasts for the goals that the campaign is to reach; the keys are the names of the goals'
    #: parameters
    goals: dict[str, GoalForecast]
    #: expected uncertainty of every parameter after the campaign, by name
    expected: dict[str, Expected]
    #: the tests of the campaign as a plan, in the order in which to run them; None if the design
    #: was read from a file
    planned: Annotated[Any, Field(exclude=True)] = None
    #: model for the analysis of the planned tests; None if the design was read from a file
    model: Annotated[Any, Field(exclude=True)] = None

    def plan(self) -> Campaign:
        """Return the tests of this campaign as a plan, in the order in which to run them.

        Returns
        -------
        Campaign
            The plan. Its instrument has the calibration certificates that are to be bought for this
            campaign (``certificates``).

        Raises
        ------
        InputError
            If the design was read from a file. Such a file does not contain the plan, which is
            saved as a separate file.
        """
        if not isinstance(self.planned, Campaign):
            raise InputError(
                "a plan must be at hand, got a design read from a file. Read the plan beside it."
            )
        return self.planned


@dataclass(frozen=True, eq=False)
class CustomaryPlan(Result):
    """A campaign as it is usually run, and the best campaign with the same number of circles."""

    name: str  #: kind of the customary campaign, such as "equal steps"
    #: the customary campaign (a campaign as it is usually run), with its costs and forecasts
    customary: GoalPlan
    #: the best campaign with the same number of circles as the customary campaign: the one that
    #: comes nearest to the goals for uncertainties
    ours: GoalPlan


@dataclass(frozen=True, eq=False)
class GoalDesign(Result):
    """The cheapest campaigns for uncertainty goals, and reasons why some goals are not reached.

    Examples
    --------
    >>> found = lb.design(
    ...     lb.HybridModel.first(0), campaign, goals={"C_XXX": "15 %"}, forces_N=(36.0, 742.0)
    ... )
    >>> found.goals["C_XXX"].met_by_pilot  # nothing is needed
    True
    >>> found.plans
    ()
    """

    #: goals for uncertainties; the keys are the names of the parameters
    goals: ByParameter[StatedGoal]
    #: minimum share of the possible machines on which all goals for uncertainties are to be met
    probability: float
    #: machine time needed for each circle, each set-up and each turn of the balls in their sockets,
    #: and the price of machine time
    costs: Costs
    #: campaigns that reach the goals for uncertainties, the cheapest first. Goals that are already
    #: met, and goals in ``unreachable`` and ``near_misses``, are left out. Empty if all goals are
    #: already met, or if no campaign reaches the goals, for example because the machine time is too
    #: short.
    plans: tuple[GoalPlan, ...]
    #: reasons why goals cannot be reached by any number of circles with the certificates that the
    #: instrument has; the keys are the names of the goals' parameters
    obstacles: dict[str, Obstacle]
    #: reasons why goals cannot be reached with 40 circles or fewer, although they could be reached
    #: with very many circles; the keys are the names of the goals' parameters. If each goal alone
    #: can be reached with 40 circles, but not all goals together, all goals are included.
    near_misses: dict[str, NearMiss]
    #: names of the parameters whose goals cannot be reached, even with the certificates that could
    #: be bought; the plans leave these goals out
    unreachable: tuple[str, ...]
    #: campaigns as they are usually run, for comparison; empty if ``plans`` (the cheapest campaigns
    #: that reach the goals) is empty
    customary: tuple[CustomaryPlan, ...]
    #: the cheapest campaign if no longest machine time were set; None unless ``plans`` is empty
    #: because the longest machine time (``costs.hours``) is too short
    without_limit: GoalPlan | None
    #: whether the design starts from a campaign with readings; false if it starts from a plan
    measured: bool
    pilot: str  #: name of the campaign or plan that the design starts from
    #: whether the circles of the campaigns are added to those of the pilot (option ``--augment``);
    #: if not, the campaigns reach the goals by themselves
    adds_to_pilot: bool = False
    #: forecasts of the uncertainties that the cheapest campaign leaves where a goal is not reached;
    #: the keys are the names of the goals' parameters. Empty if ``plans`` is empty.
    unreached: dict[str, GoalForecast] = field(default_factory=dict)
    #: campaign within the longest machine time, or of 40 circles if there is no limit, that comes
    #: nearest to all goals that are not met yet. None if all are reached, and if no campaign is as
    #: short as the longest machine time.
    nearest: GoalPlan | None = None
    #: expanded uncertainties (k = 2) that ``nearest`` does not exceed on as many machines as the
    #: goals are to be met on, all of them together; the keys are the names of the parameters of the
    #: goals that it does not reach as they are stated
    in_reach: dict[str, float] = field(default_factory=dict)
    #: machine time [min] that the shortest campaign takes; None unless it is longer than allowed
    shortest_minutes: float | None = None

    @property
    def all_met(self) -> bool:
        """Whether all uncertainty goals are met by the campaign that the design starts from."""
        return all(stated.met_by_pilot for stated in self.goals.values())

    @property
    def all_reached(self) -> bool:
        """Whether every uncertainty goal is met already, or will be by the cheapest campaign."""
        left_out = self.unreachable or self.near_misses
        return self.all_met or bool(self.plans and not left_out)

    @property
    def too_long(self) -> bool:
        """Whether a longer machine time might allow a campaign to reach the uncertainty goals."""
        is_reachable = len(self.unreachable) < len(self.goals)
        is_limited = self.costs.hours is not None
        return not self.plans and is_reachable and is_limited and not self.near_misses

    @property
    def best(self) -> GoalPlan:
        """The cheapest campaign that reaches the goals; raises an `InputError` if there is none."""
        require(
            self.plans,
            "a campaign must be found before it can be run, got none. See met_by_pilot, obstacles"
            " and costs.hours.",
        )
        return self.plans[0]

    def plan(self) -> Campaign:
        """Return the cheapest campaign as a plan, in the order in which to run it.

        Returns
        -------
        Campaign
            The plan. Its instrument has the calibration certificates that the cheapest campaign
            needs.

        Raises
        ------
        InputError
            If the search found no campaign, or the design was read from a file.
        """
        return self.best.plan()
