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
from datetime import datetime
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.special import ndtri

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
from ldbb_bayes.fleet.control_limits import ChartPoints, chart_points
from ldbb_bayes.fleet.deviations import deviating
from ldbb_bayes.fleet.fleet_statistics import FleetStatistics, fleet_statistics
from ldbb_bayes.fleet.interval_summary import Summary
from ldbb_bayes.fleet.selection import Caveat, CaveatKind, check_rows, choose, labels
from ldbb_bayes.fleet.stiffness_series import stiffness_series
from ldbb_bayes.fleet.trend import ParameterChange, Trend, Visit, iso_date
from ldbb_bayes.fleet.trend_conformity import caveats_of_tolerances, conformities_of_campaigns
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.mixtures import mixture_moments, mixture_quantiles
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.report.wording import caveat_words
from ldbb_bayes.results import Array
from ldbb_bayes.units import ranked

__all__ = ["find_trend"]

# The change of a parameter is also stated in per cent of the level before the change. This is done
# only if that level divided by its standard uncertainty exceeds this value, that is, if the
# standard uncertainty is below 20 % of the level. The percentage does not take this uncertainty
# into account.
_KNOWN_LEVEL = 5.0
# Columns of the table `Trend.estimates` whose values are in the unit of the parameter.
_SIZED_COLUMNS = ("estimate", "sd", "ci_low", "ci_high", "limit_low", "limit_high")


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
    dates = np.array([iso_date(visit.date) for visit in visits], dtype=object)
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
