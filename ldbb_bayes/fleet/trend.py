"""Trend of one machine: whether a parameter has changed, which parameter, when and by how much.

The model of a change is stated in `change_point`. A change is reported if its posterior probability
exceeds a threshold p*. If there is no change, the Bayes factor B of a change over no change has the
expectation 1. The probability that B exceeds a number x is therefore at most 1 / x (Markov's
inequality). It follows that the probability of a false alarm is at most
(1 − p*) / p* · p / (1 − p), where p is the prior probability of a change.

A trend does not use the fact that compliances cannot be negative (truncation). The machine's
changes of compliance with force are nearly the same in all campaigns (`machine_effects`). Three
kinds of unknowns are integrated out in each campaign separately: the form of the balls, the length
of the bar, and the geometric errors that are not analysed. They are treated as if their values in
different campaigns were independent. In fact, these values are the same in all campaigns with one
machine and one bar. This treatment overstates the uncertainty of changes, above all of changes of
geometric errors. It understates the uncertainty of levels, which are the values of a parameter
before and after a change.
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Annotated, Any, NamedTuple

import numpy as np
import pandas as pd
from pydantic import Field, PlainSerializer
from scipy.special import ndtri

from ldbb_bayes.analysis.conformity import Conformity
from ldbb_bayes.analysis.tolerances import Tolerance
from ldbb_bayes.deprecation import renamed_keyword
from ldbb_bayes.errors import InputError, check_known, check_probability
from ldbb_bayes.fleet.change_point import (
    Levels,
    common_moments,
    current_levels,
    hypotheses,
    hypothesis_probabilities,
    scatter_rule,
)
from ldbb_bayes.fleet.control_limits import LIMITS, ChartPoints, chart_points
from ldbb_bayes.fleet.deviations import deviating
from ldbb_bayes.fleet.fleet_statistics import FleetStatistics, fleet_statistics
from ldbb_bayes.fleet.interval_summary import Summary, name_intervals
from ldbb_bayes.fleet.selection import Caveat, CaveatKind, check_rows, choose, labels
from ldbb_bayes.fleet.stiffness_series import (
    StiffnessOfVisit,
    stiffness_series,
    stiffness_table,
)
from ldbb_bayes.fleet.trend_conformity import caveats_of_tolerances, conformities_of_campaigns
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.mixtures import mixture_moments, mixture_quantiles
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.report.conformity_tables import conformity_table
from ldbb_bayes.report.text import parts_of
from ldbb_bayes.report.wording import caveat_words, probability_words, trend_sentences, with_words
from ldbb_bayes.results import Array, Result, Table
from ldbb_bayes.units import (
    display_name,
    display_unit,
    plus_minus,
    ranked,
    round_uncertainty,
)

__all__ = ["ParameterChange", "Trend", "Visit", "find_trend"]

# The printed table of a trend states the size of a parameter's change only if the probability of
# the change is at least this value. Smaller probabilities would appear as zero, because the table
# shows probabilities with three decimals.
_UNLIKELY = 5e-4
# The change of a parameter is also stated in per cent of the level before the change. This is done
# only if that level divided by its standard uncertainty exceeds this value, that is, if the
# standard uncertainty is below 20 % of the level. The percentage does not take this uncertainty
# into account.
_KNOWN_LEVEL = 5.0
# Columns of the table `Trend.estimates` whose values are in the unit of the parameter.
_SIZED_COLUMNS = ("estimate", "sd", "ci_low", "ci_high", "limit_low", "limit_high")
# Text of empty cells in the printed table of a trend's parameters.
_NOTHING = "–"


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


def _isoformat(date: datetime | None) -> str | None:
    """Return a date as a string in ISO 8601; None if there is no date."""
    return None if date is None else date.isoformat()


@dataclass(frozen=True)
class Visit(Result):
    """One campaign of a trend, and the probability that the machine changed just before it."""

    #: label of the campaign: its name, or its file path if the name is missing or not unique
    campaign: str
    #: date of the campaign; None if the campaign states no date
    date: Annotated[datetime | None, PlainSerializer(_isoformat)]
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


@parts_of.register
def _trend_parts(trend: Trend) -> tuple[Table | str, ...]:
    """Return what ``print`` shows of a trend: tables of its quantities, then sentences.

    There is a table of parameters, a table of conformity and a table of stiffness by direction. The
    table of conformity holds the decisions from the newest campaign; it is left out if there are no
    tolerances. The table of stiffness is left out if the batches have no stiffness by direction.
    The sentences state the findings and the limitations.
    """
    heads = ("parameter", "level now", "U, common", "P(changed)", "change, if it did", "of level")
    rows = [_table_row(name, change) for name, change in trend.parameters.items()]
    machine = f"{trend.machine}, " if trend.machine else ""
    force = f"compliances at {trend.reference_force_N:g} N"
    table = Table.of(f"{machine}{len(trend.campaigns)} campaigns, {force}", heads, rows)
    percent = f"{100.0 * trend.assumptions['ci']:g} %"
    legend = (
        "Level now: from all campaigns together, at the newest of them."
        f" ± U = 2u; [low, high]: {percent} interval, where ± U does not describe it. U, common:"
        " what instrument and machine add to all campaigns alike."
    )
    passages: list[Table | str] = [table, legend, ""]
    newest_decisions = {}
    for name, decision_by_campaign in trend.conformity.items():
        if decision_by_campaign:
            *_, newest = decision_by_campaign.values()
            newest_decisions[name] = newest.as_dict()
    if newest_decisions:
        newest_campaign = trend.campaigns[-1].campaign
        passages.append(conformity_table(newest_decisions))
        passages.append(
            f"Value of the newest campaign alone, {newest_campaign}, with what the others say of"
            " the errors and effects that all have in common. The level now, of all campaigns, may"
            " differ from it."
        )
        passages.append("")
    if trend.stiffness:
        passages += [stiffness_table(trend.stiffness), ""]
    passages += trend_sentences(trend)
    passages += map(caveat_words, trend.caveats)
    return tuple(passages)


def _table_row(name: str, parameter: ParameterChange) -> list[str]:
    """Return the cells of one parameter's row in the printed table of a trend.

    The cells are

    - the name of the parameter;
    - its present level ± U, and the part of U that is common to all campaigns;
    - the probability that the parameter changed;
    - the size of this change ± U, also in per cent of the level before the change.

    U is the expanded uncertainty. The size is replaced by a dash if the probability of a change is
    negligible. The percentage is also replaced by a dash if the level before the change is too
    uncertain.
    """
    factor, unit = display_unit(parameter.unit)
    level = parameter.level_now
    common = _NOTHING
    if parameter.common_sd > 0.0:
        common = f"{round_uncertainty(2.0 * parameter.common_sd * factor)[0]} {unit}"
    size = _NOTHING
    percent = _NOTHING
    if parameter.probability >= _UNLIKELY:
        change = parameter.change
        size = plus_minus(change.mean, change.sd, change.interval, parameter.unit)
        if parameter.percent is not None:
            percent = f"{parameter.percent:+.0f} %".replace("-", "−")
    return [
        display_name(name),
        plus_minus(level.mean, level.sd, level.interval, parameter.unit),
        common,
        probability_words(parameter.probability),
        size,
        percent,
    ]


@with_words.register
def _trend_record(trend: Trend) -> dict[str, Any]:
    """Return the content of trend.json: the result, and sentences on findings and limitations."""
    doubts = [caveat_words(caveat) for caveat in trend.caveats]
    return trend.as_dict() | {"doubts": doubts, "verdict": list(trend_sentences(trend))}


@one_blas_thread
@renamed_keyword("ci_prob", "prob")
def find_trend(
    rows: pd.DataFrame,
    *,
    machine: str | None = None,
    parameters: Sequence[str] | None = None,
    exclude: Sequence[str] = (),
    since: str | None = None,
    include_misfits: bool = False,
    reference_force_N: float | None = None,
    one_instrument: bool = True,
    tolerances: Mapping[str, str | Tolerance] | None = None,
    change_scale: float = 0.2,
    repeatability: float = 0.01,
    probability: float = 0.5,
    threshold: float = 0.95,
    prob: float = 0.95,
) -> Trend:
    """Find whether a parameter of one machine has changed, which parameter, when and by how much.

    The model assumes at most one lasting step of one parameter. The prior of the size of this step
    is N(0, (change_scale · sd)²), where sd is the reference standard deviation of the parameter.
    This reference is the larger of two values: the standard deviation of the parameter's default
    prior, and the median of its prior standard deviations in the fits of the campaigns.

    Parameters
    ----------
    rows : DataFrame
        Table of a batch that `read_batch` returns, one row per campaign.
    machine : str, optional
        Name (machine_id) of the machine; required if the rows are of several machines.
    parameters : sequence of str, optional
        Names of the parameters to follow. Default: all compliances at the reference force.
    exclude : sequence of str
        Campaigns to leave out. A campaign is identified by its path as in the table, by the last
        part of this path or by its name.
    since : str, optional
        Date (ISO 8601); campaigns that are earlier or have no date are left out.
    include_misfits : bool
        Whether to keep campaigns whose readings do not fit the model.
    reference_force_N : float, optional
        Force for which the compliances are given [N]. Default: the median of the campaigns'
        reference forces.
    one_instrument : bool
        Whether all campaigns used the same bar. If so, the errors of the mount's deflection and of
        the force are the same in all campaigns and do not average out.
    tolerances : mapping of str to str or Tolerance, optional
        Tolerances of parameters and stiffnesses, see `assess_conformity`; the keys are the names of
        the quantities. They replace those that the newest campaign states of these quantities.
    change_scale : float
        Prior standard deviation of a change, in units of the parameter's reference standard
        deviation. For C_XXX, the default corresponds to 2e-5 mm/N.
    repeatability : float
        Scale of the half-normal prior of the machine's repeatability, in units of the parameter's
        reference standard deviation. The repeatability is the standard deviation of the machine's
        parameters from campaign to campaign, apart from a step. For C_XXX, the default corresponds
        to 1e-6 mm/N, which is 2 % of a typical compliance of 5e-5 mm/N.
    probability : float
        Prior probability of a change.
    threshold : float
        Posterior probability above which a change is reported.
    prob : float
        Probability of the credible intervals.

    Returns
    -------
    Trend
        Probability of a change, the possible step and the present level of each parameter, and the
        estimates from each campaign alone.

    Raises
    ------
    InputError
        If there are fewer than two campaigns, if the rows are of several machines and no machine is
        chosen, if some campaigns have dates and others do not, or if an option is out of range.

    Examples
    --------
    >>> trend = lb.fleet.find_trend(rows)
    >>> trend.changed, trend.most_probable
    (True, 'C_XXX')
    >>> trend.probability > 0.95
    True
    """
    check_probability(prob)
    _check_option("change_scale", change_scale)
    _check_option("repeatability", repeatability)
    _check_option("probability", probability, below_one=True)
    _check_option("threshold", threshold, below_one=True)
    campaigns = _campaigns_of_one_machine(rows, machine)
    used_rows, caveats = choose(campaigns.rows, exclude, since, include_misfits, among=rows)
    caveats = [*campaigns.caveats, *caveats]
    statistics = fleet_statistics(
        used_rows,
        parameters=parameters,
        reference_force_N=reference_force_N,
        one_instrument=one_instrument,
        one_machine=True,
    )
    if len(statistics) < 2:
        cure = "Measure again."
        if CaveatKind.GIVEN_AGAIN in {caveat.kind for caveat in caveats}:
            cure = "Name each campaign once."
        advice = " ".join((cure, *map(caveat_words, caveats)))
        raise InputError(
            "a trend must have at least 2 campaigns of one machine to rely on, got"
            f" {len(statistics)}. {advice}"
        )
    order = _order_in_time(statistics)
    p = len(statistics.parameters)
    series = Gaussian(statistics.likelihood.precision[order], statistics.likelihood.shift[order])
    scatter, scatter_weight = scatter_rule(repeatability)
    level_likelihoods = deviating(series, np.outer(scatter, np.ones(p)))
    posteriors = hypotheses(level_likelihoods, p, change_scale)
    probabilities = hypothesis_probabilities(posteriors.log_integral, scatter_weight, probability)
    common = common_moments(posteriors, probabilities)
    chart = chart_points(series, level_likelihoods, scatter, scatter_weight, common)
    step_probabilities = probabilities[:, :-1]
    names = labels(used_rows.iloc[order])
    dates = [statistics.dates[i] for i in order]
    visits = _visits(names, dates, step_probabilities)
    changes = _parameter_changes(statistics, posteriors, probabilities, chart, prob)
    change_probability = 1.0 - float(probabilities[:, -1].sum())
    false_alarm = (1.0 - threshold) / threshold * probability / (1.0 - probability)
    newest_tolerances = used_rows["tolerances"].iloc[order[-1]]
    caveats += _caveats_of_series(statistics)
    caveats += caveats_of_tolerances(statistics, newest_tolerances)
    return Trend(
        machine=campaigns.machine,
        reference_force_N=statistics.reference_force_N,
        assumptions={
            "change_scale": change_scale,
            "repeatability": repeatability,
            "probability": probability,
            "threshold": threshold,
            "ci": prob,
            "one_instrument": bool(statistics.instrument),
        },
        probability=change_probability,
        changed=change_probability > threshold,
        false_alarm=min(1.0, false_alarm),
        campaigns=visits,
        parameters=changes,
        most_probable=ranked(changes, lambda name: changes[name].probability)[0],
        caveats=tuple(caveats),
        estimates=_estimates_table(statistics, visits, chart, step_probabilities, prob),
        conformity=conformities_of_campaigns(
            statistics, names, series, chart, tolerances, newest_tolerances
        ),
        stiffness=stiffness_series(used_rows.iloc[order], names),
    )


def _check_option(name: str, value: float, *, below_one: bool = False) -> None:
    """Raise an `InputError` unless an option of `find_trend` is above zero and finite.

    ``name`` is the name of the option. If ``below_one`` is true, the value must also be below 1.
    """
    if below_one and not 0.0 < value < 1.0:
        raise InputError(f"{name} must be above 0 and below 1, got {value:g}. Correct it.")
    if not 0.0 < value < np.inf:
        raise InputError(f"{name} must be above 0, got {value:g}. Correct it.")


class _MachineCampaigns(NamedTuple):
    """Rows of a batch's table that belong to the campaigns of one machine.

    The object also holds the name of the machine, and caveats (limitations of the trend that is
    computed from these rows).
    """

    rows: pd.DataFrame  #: rows of one machine's campaigns in the table of a batch
    machine: str | None  #: machine_id of the machine; None if no campaign states a machine_id
    #: caveats (limitations of the trend), for example that campaigns without a machine_id are left
    #: out
    caveats: list[Caveat]


def _campaigns_of_one_machine(rows: pd.DataFrame, machine: str | None) -> _MachineCampaigns:
    """Return those rows of a batch's table that belong to the campaigns of one machine.

    The result also holds the machine_id of the machine and the caveats (limitations of the trend).
    ``machine`` is the machine_id that the user chose, or None. If some rows have a machine_id, rows
    without a machine_id are left out, and caveats name their campaigns. If no row has a
    machine_id, all rows are returned, with a caveat. Raise an `InputError` if ``machine`` is
    unknown, or is None although there are several machines.
    """
    check_rows(rows)
    ids = rows["machine_id"]
    has_id = pd.Series([isinstance(entry, str) for entry in ids], index=rows.index, dtype=bool)
    machines = sorted(set(ids[has_id]))
    if machine is not None:
        check_known("machine", [machine], machines)
    elif len(machines) > 1:
        first = machines[0]
        raise InputError(
            f"the campaigns must be of one machine, got those of {', '.join(machines)}. Choose one:"
            f" --machine {shlex.quote(first)} (machine={first!r})."
        )
    if not machines:
        return _MachineCampaigns(rows, None, [Caveat(CaveatKind.NO_MACHINES)])
    chosen = machine or machines[0]
    caveats = []
    is_fitted = rows["status"] == "done"
    for kind, is_left_out in (
        (CaveatKind.FAILED_MACHINE_UNKNOWN, ~has_id & ~is_fitted),
        (CaveatKind.WITHOUT_MACHINE, ~has_id & is_fitted),
    ):
        if is_left_out.any():
            caveats.append(Caveat(kind, tuple(labels(rows[is_left_out], rows))))
    return _MachineCampaigns(rows[ids == chosen], chosen, caveats)


def _order_in_time(statistics: FleetStatistics) -> list[int]:
    """Return the indices of the campaigns in order of their dates.

    If no campaign has a date, the given order is kept. Raise an `InputError` if only some campaigns
    have a date. ``statistics`` holds the likelihoods and the dates of the campaigns.
    """
    dates = zip(statistics.campaigns, statistics.dates, strict=True)
    undated = [name for name, date in dates if date is None]
    if undated and len(undated) < len(statistics):
        raise InputError(
            "campaigns must have a date all or none, got none for"
            f" {', '.join(undated[:5])}. Write date = … into campaign.toml, or take all dates out"
            " and give the campaigns in order."
        )
    return sorted(range(len(statistics)), key=lambda i: statistics.dates[i] or datetime.min)


def _caveats_of_series(statistics: FleetStatistics) -> list[Caveat]:
    """Return the caveats on the campaigns from which the trend of a machine is computed.

    A caveat is a limitation that reports describe to the user. There are caveats if the reference
    force is outside the tested forces, if no campaign has a date, and if there are only two
    campaigns. ``statistics`` holds the likelihoods and the dates of the campaigns.
    """
    caveats = list(statistics.caveats)
    if all(date is None for date in statistics.dates):
        caveats.append(Caveat(CaveatKind.NO_DATES))
    if len(statistics) == 2:
        caveats.append(Caveat(CaveatKind.TWO_CAMPAIGNS))
    return caveats


def _visits(
    names: Sequence[str], dates: Sequence[datetime | None], step_probabilities: Array
) -> tuple[Visit, ...]:
    """Return the campaigns of a trend, with the probability of a change just before each campaign.

    The probability of a change is zero for the first campaign. ``names`` and ``dates`` are the
    names and dates of the n campaigns. ``step_probabilities``, shape (r, n − 1, p), holds the
    posterior probabilities of hypotheses. Under each hypothesis, the machine's scatter from
    campaign to campaign has one of r values, and one of the p parameters changed just before one of
    the campaigns 2 to n.
    """
    change_before = [0.0, *step_probabilities.sum(axis=(0, 2)).tolist()]
    return tuple(map(Visit, names, dates, change_before))


def _parameter_changes(
    statistics: FleetStatistics,
    posteriors: Gaussian,
    probabilities: Array,
    chart: ChartPoints,
    prob: float,
) -> dict[str, ParameterChange]:
    """Return the estimated step of each parameter, and the parameter's value at the last campaign.

    The result is a dict; its keys are the names of the p parameters. A step is a sudden change of a
    parameter from one campaign to the next; a level is a value of a parameter. ``posteriors``
    holds, for each hypothesis (see `hypotheses`), the joint Gaussian distribution of the levels
    before the step, the errors and effects in common, and the size of the step. ``probabilities``
    are the posterior probabilities of the hypotheses, shape (r, n, p). Under each hypothesis, the
    machine's scatter from campaign to campaign has one of r values. In addition, either one of the
    p parameters changed just before one of the campaigns 2 to n, or no parameter changed. ``chart``
    holds the points and limits of the control chart. ``prob`` is the probability of the credible
    intervals.
    """
    levels = current_levels(posteriors, probabilities, prob=prob)
    changes = {}
    for j, name in enumerate(statistics.parameters):
        changes[name] = _parameter_change(
            statistics, j, posteriors, probabilities[:, :-1, j], levels, chart, prob
        )
    return changes


def _parameter_change(
    statistics: FleetStatistics,
    j: int,
    posteriors: Gaussian,
    step_probabilities: Array,
    levels: Levels,
    chart: ChartPoints,
    prob: float,
) -> ParameterChange:
    """Return the estimated step of the parameter with the index j, and its present value (level).

    A step is a sudden change of a parameter from one campaign to the next. It is estimated under
    the assumption that this parameter has changed; if the probability of this is zero, all
    hypotheses of a change have the same weight. The present value is the value at the last
    campaign. The result also holds the parameter's standard uncertainty due to the errors and
    effects that all campaigns have in common, as ``common_sd``. The result is in internal units
    (mm, N, rad), and its step in per cent is None unless the level before the step exceeds five of
    its standard uncertainties.

    Parameters
    ----------
    statistics
        Likelihoods of n campaigns, with units and prior sds of p parameters.
    j
        Index of the parameter.
    posteriors
        Joint Gaussian distribution, for each hypothesis (see `hypotheses`), of the levels before
        the step, the errors and effects in common, and the size of the step, in units of the prior
        sds.
    step_probabilities
        Posterior probabilities of hypotheses, shape (r, n − 1). Under each hypothesis, the
        parameter changed just before one of the campaigns 2 to n, and the machine's scatter from
        campaign to campaign has one of r values.
    levels
        Values of all parameters at the last campaign, in units of the prior sds.
    chart
        Points and limits of the control chart, in units of the prior sds, with the standard
        uncertainties due to the errors and effects that all campaigns have in common.
    prob
        Probability of the credible intervals.
    """
    scale = float(statistics.prior_sd[j])
    total = float(step_probabilities.sum())
    weight = np.full(step_probabilities.size, 1.0 / step_probabilities.size)
    if total > 0.0:
        weight = (step_probabilities / total).ravel()
    change = _step_summary(
        weight, posteriors.mean[:, :-1, j, -1], posteriors.sd[:, :-1, j, -1], prob
    )
    level, level_sd = mixture_moments(
        weight, posteriors.mean[:, :-1, j, j].ravel(), posteriors.sd[:, :-1, j, j].ravel()
    )
    change_size = scale * change.mean
    level_before = scale * float(level)
    percent = None
    if abs(level_before) > _KNOWN_LEVEL * (scale * float(level_sd)):
        percent = 100.0 * change_size / level_before
    probability_by_time = step_probabilities.sum(axis=0).tolist()
    # Element k of ``probability_by_time`` is the probability that the parameter changed just before
    # the campaign with the index k + 1.
    times = range(len(probability_by_time))
    return ParameterChange(
        unit=statistics.units[j],
        probability=total,
        place=1 + ranked(times, lambda k: float(probability_by_time[k]))[0],
        change=_scaled_summary(change, scale),
        percent=percent,
        level_before=level_before,
        level_now=_scaled_summary(_present_level(levels, j), scale),
        common_sd=scale * float(chart.common_sd[j]),
    )


def _step_summary(weight: Array, mean: Array, sd: Array, prob: float) -> Summary:
    """Return the mean, sd and credible interval of the size of a parameter's step.

    Mean, sd and interval describe a mixture of hypotheses. Each hypothesis assumes one campaign
    just before which the step occurred, and one value of the machine's scatter from campaign to
    campaign. ``weight`` holds the weights of the hypotheses, which sum to one. ``mean`` and ``sd``
    hold the mean and the standard deviation of the size under each hypothesis. All sizes are in
    units of the parameter's prior sd. ``prob`` is the probability of the interval.
    """
    mean = mean.ravel()
    sd = sd.ravel()
    counts = weight > 0.0
    tail = 0.5 - 0.5 * prob
    low, high = mixture_quantiles(weight[counts], mean[counts], sd[counts], (tail, 1.0 - tail))
    mixture_mean, mixture_sd = mixture_moments(weight, mean, sd)
    return Summary(float(mixture_mean), float(mixture_sd), (float(low), float(high)))


def _present_level(levels: Levels, j: int) -> Summary:
    """Return the mean, sd and credible interval of a parameter's level at the last campaign.

    ``levels`` holds mean, sd and interval of all parameters, and ``j`` is the index of the
    parameter. The result is in units of the parameter's prior sd.
    """
    low, high = levels.interval[:, j]
    return Summary(float(levels.mean[j]), float(levels.sd[j]), (float(low), float(high)))


def _scaled_summary(summary: Summary, scale: float) -> Summary:
    """Return the mean, sd and credible interval of a quantity, multiplied by ``scale``."""
    low, high = summary.interval
    return Summary(scale * summary.mean, scale * summary.sd, (scale * low, scale * high))


def _estimates_table(
    statistics: FleetStatistics,
    visits: Sequence[Visit],
    chart: ChartPoints,
    step_probabilities: Array,
    prob: float,
) -> pd.DataFrame:
    """Return the table `Trend.estimates`, with one row per campaign and parameter.

    Parameters
    ----------
    statistics
        Likelihoods of p parameters from n campaigns, with names and units of the parameters.
    visits
        Name and date of every campaign, in order of time.
    chart
        Points and limits of the control chart, in units of the parameters' prior sds.
    step_probabilities
        Posterior probabilities of hypotheses, shape (r, n − 1, p). Under each hypothesis, the
        machine's scatter from campaign to campaign has one of r values, and one of the p parameters
        changed just before one of the campaigns 2 to n.
    prob
        Probability of the credible intervals.
    """
    n, p = chart.estimate.shape
    half_width = float(ndtri(0.5 + 0.5 * prob)) * chart.sd
    ci_low = chart.estimate - half_width
    ci_high = chart.estimate + half_width
    low, high = chart.limits
    in_prior_sds = np.stack((chart.estimate, chart.sd, ci_low, ci_high, low, high))
    in_units = (in_prior_sds * statistics.prior_sd[:p]).reshape(len(_SIZED_COLUMNS), n * p)
    change_here = np.concatenate([np.zeros((1, p)), step_probabilities.sum(axis=0)])
    dates = np.array([_isoformat(visit.date) for visit in visits], dtype=object)
    return pd.DataFrame(
        {
            "campaign": np.repeat([visit.campaign for visit in visits], p),
            "date": np.repeat(dates, p),
            "parameter": np.tile(statistics.parameters, n),
            "unit": np.tile(statistics.units, n),
            **dict(zip(_SIZED_COLUMNS, in_units, strict=True)),
            "outside": ((chart.estimate < low) | (chart.estimate > high)).ravel(),
            "change_here": change_here.ravel(),
            "change_by_here": np.cumsum(change_here, axis=0).ravel(),
        }
    )
