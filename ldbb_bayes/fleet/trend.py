"""Trend of one machine: its parameters over time, and whether one of them has changed.

`trend_estimation` computes the trend from the campaigns of the machine.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Annotated, Any

import pandas as pd
from pydantic import Field, PlainSerializer

from ldbb_bayes.analysis.decision_rule import Conformity
from ldbb_bayes.fleet.control_limits import LIMITS
from ldbb_bayes.fleet.interval_summary import Summary, name_intervals
from ldbb_bayes.fleet.selection import Caveat
from ldbb_bayes.fleet.stiffness_series import StiffnessOfVisit
from ldbb_bayes.results import Result

__all__ = ["ParameterChange", "Trend", "Visit", "iso_date"]


@dataclass(frozen=True)
class ParameterChange(Result):
    """Possible step change of one parameter of a machine over time.

    Attributes of type ``Summary`` hold a mean, a standard deviation and a credible interval. Levels
    and changes are in internal units (mm, N, rad).
    """

    #: unit of one parameter of the machine, a product of powers of mm, N and rad, such as mm/N
    unit: str
    #: posterior probability that this parameter of the machine has changed over time; the model
    #: allows a change of one parameter only
    probability: float
    #: index of the campaign just before which the parameter most probably changed, if it changed at
    #: all; campaigns are counted from 0 in order of time
    place: int
    #: size of the step change of the parameter over time (later level minus earlier level) under
    #: the assumption that this parameter changed, averaged over the possible times of the change
    change: Summary
    #: step change of the parameter in per cent of its level before the change; None if the standard
    #: uncertainty of that level is 20 % of the level or more
    percent: float | None
    #: posterior mean of the parameter's level before its step change, under the assumption that
    #: this parameter changed
    level_before: float
    #: level (value) of the parameter at the last campaign, averaged over all possibilities: that no
    #: parameter has changed, or that one parameter changed just before one of the campaigns. The
    #: possibilities are weighted by their probabilities. The uncertainty of the level includes the
    #: part that is due to the errors of the instrument and to the changes with force.
    level_now: Summary
    #: standard uncertainty of the parameter due to the errors of the instrument and to the
    #: machine's changes of compliance with force, which are the same in all campaigns. The control
    #: chart does not contain this uncertainty.
    common_sd: float


def iso_date(date: datetime | None) -> str | None:
    """Return a date as a string in ISO 8601; None if there is no date."""
    return None if date is None else date.isoformat()


@dataclass(frozen=True)
class Visit(Result):
    """One campaign of a trend, and the probability that the machine changed just before it."""

    #: label of the campaign: its name, or its file path if the name is missing or not unique
    campaign: str
    #: date of the campaign; None if the campaign states no date
    date: Annotated[datetime | None, PlainSerializer(iso_date)]
    #: probability that at least one parameter of the machine changed between the previous campaign
    #: and this campaign
    change_just_before: float


@dataclass(frozen=True, eq=False)
class Trend(Result):
    """Parameters of one machine over time, and whether one of them has changed.

    The table ``estimates`` has one row per campaign and parameter, in internal units (mm, N, rad).
    It has the following columns:

    - campaign, date, parameter and unit;
    - estimate, sd, ci_low and ci_high: the result from this campaign, with the errors and effects
      that all campaigns have in common as the readings of all campaigns tell them;
    - limit_low and limit_high: the 99.7 % control limits that follow from the earlier campaigns if
      nothing changes (NaN for the first campaign);
    - outside: whether the estimate is outside these limits;
    - change_here: the probability that the parameter changed just before this campaign;
    - change_by_here: the probability that the parameter changed just before this campaign or
      earlier.

    The estimates and limits in the table are computed with these errors and effects fixed at their
    posterior means. The JSON record does not contain the table.

    Examples
    --------
    >>> trend = lb.fleet.find_trend(rows)
    >>> trend.changed, trend.most_probable, len(trend.campaigns)
    (True, 'C_XXX', 2)
    >>> len(trend.estimates)  # 2 campaigns, 6 parameters
    12
    """

    machine: str | None  #: machine_id of the machine; None if its campaigns state no machine_id
    reference_force_N: float  #: force for which the compliances are given [N]
    #: values of the options of `find_trend`. The keys are ``change_scale``, ``repeatability``,
    #: ``probability``, ``threshold``, ``one_instrument`` and ``ci``. The value of ``ci`` is the
    #: option ``prob``, the probability of the credible intervals.
    assumptions: Mapping[str, Any]
    #: posterior probability that a parameter of the machine has changed
    probability: Annotated[float, Field(alias="probability_of_change")]
    #: whether the posterior probability of a change is above the threshold, so that it is reported
    changed: bool
    #: upper bound on the probability that a change of the machine is reported if none has occurred
    false_alarm: float
    campaigns: tuple[Visit, ...]  #: campaigns of the machine in order of time
    #: for each parameter of the machine, the sudden change (step) that may have occurred, and the
    #: value (level) at the last campaign; the keys are the names of the parameters
    parameters: Mapping[str, ParameterChange]
    #: name of the parameter that most probably changed, whether or not a change is reported
    most_probable: str
    caveats: tuple[Caveat, ...]  #: limitations of the trend and of its campaigns
    #: table of the estimates from each campaign alone, one row per campaign and parameter
    estimates: Annotated[pd.DataFrame, Field(exclude=True)]
    #: decisions on conformity with tolerances, a dictionary of dictionaries. The outer keys are the
    #: names of the quantities that have a tolerance, and the inner keys are the names of the
    #: campaigns. A decision follows from one campaign and from what the others say of the errors
    #: and effects that all have in common. It may differ from that of a fit of this campaign. A
    #: normal distribution of the parameter is assumed.
    conformity: Mapping[str, Mapping[str, Conformity]]
    #: stiffness by direction from each campaign alone, in the order of time; the keys are names
    #: such as ``k_min``. The mapping is empty if the batches have no stiffness by direction.
    stiffness: Mapping[str, tuple[StiffnessOfVisit, ...]]
    #: probability that the estimate from one campaign lies within its control limits if the machine
    #: has not changed
    limits_probability: float = LIMITS

    def as_dict(self) -> dict[str, Any]:
        """Return the trend of the machine as a dictionary for JSON, in mm, N and rad.

        The keys of credible intervals state the probability: ``ci95``, for example, is an interval
        of 95 % probability. That of a stiffness by direction is the probability of its batch. The
        table ``estimates`` is left out.
        """
        numbers = super().as_dict()
        for name, visits in numbers["stiffness"].items():
            named_visits = [name_intervals(visit, visit["prob"]) for visit in visits]
            numbers["stiffness"][name] = named_visits
        record: dict[str, Any] = name_intervals(numbers, self.assumptions["ci"])
        return record
