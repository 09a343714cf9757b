"""c_t = c + Δ e_j 1[t ≥ k] + w_t, t = 1..n over one machine's campaigns: has a parameter changed,
which, when and by how much?

In units of the prior's sd: c ~ N(0, I), b ~ N(0, I) the instrument's errors, the same in all
campaigns, w_t ~ N(0, r² I) what the machine itself changes from campaign to campaign, r ~
HalfNormal(repeatability), Δ ~ N(0, change_scale²). With the probability given there is one step, j
uniform over parameters and k over 2..n. Given r, j, k everything is Gaussian: w_t is integrated in
each campaign, the rest needs sums over t ≥ k and one small system for each r, k, j. A campaign's Λ
may be singular.

The Bayes factor B of a change has expectation 1 where there is none, so that B > x has probability
1 / x at most (Markov): a change called above the threshold p* is a false alarm with probability (1
− p*) / p* · p / (1 − p) at most, p that before the readings.

Truncation is left aside. Parameters not chosen are integrated out anew in each campaign, as ball
form and bar length are, though one machine and one bar keep theirs: that is conservative for
changes, above all of geometric errors, but not for levels.
"""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Annotated, Any

import numpy as np
import pandas as pd
from pydantic import Field, PlainSerializer
from scipy.special import ndtri

from ldbb_bayes.analysis.conformity import (
    Conformity,
    Tolerance,
    normal_conformity,
    quantities,
    tolerances_in,
)
from ldbb_bayes.errors import InputError, check_known, require
from ldbb_bayes.fleet.change_point import (
    hypotheses,
    instrument_moments,
    levels_of,
    scatter_rule,
    weigh,
)
from ldbb_bayes.fleet.control_limits import LIMITS, Chart, chart_of
from ldbb_bayes.fleet.deviations import deviating
from ldbb_bayes.fleet.fleet_statistics import FleetStatistics, fleet_statistics
from ldbb_bayes.fleet.interval_summary import Summary, keyed
from ldbb_bayes.fleet.selection import Caveat, CaveatKind, check_rows, choose, labels
from ldbb_bayes.inference.summary import check_probability
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.mixtures import mixture_moments, mixture_quantiles
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.report.text import conformity_table, parts_of
from ldbb_bayes.report.wording import caveat_words, probability_words, trend_sentences, with_words
from ldbb_bayes.results import Array, Result, Table
from ldbb_bayes.units import (
    display_name,
    display_unit,
    is_direct,
    plus_minus,
    ranked,
    round_uncertainty,
)

__all__ = ["ParameterChange", "Trend", "Visit", "trend"]


# ---- the model


# ---- what is found


@dataclass(frozen=True)
class ParameterChange(Result):
    """The step of one parameter, inside units."""

    unit: str
    probability: float  #: that it is this parameter that changed
    place: int  #: campaign (from 0) just before which it most probably did, if it did
    change: Summary  #: given that it did, whenever
    percent: float | None  #: of the level before; None where that is not known to a fifth
    level_before: float
    #: at the last campaign, averaged over hypotheses; the errors of the instrument are in it
    level_now: Summary
    #: what these add to the level of all campaigns together; in no point and no limit
    common_sd: float


@dataclass(frozen=True)
class Visit(Result):
    """A campaign: what it is called, when it was, and the probability that a parameter changed just
    before it."""

    campaign: str
    date: Annotated[datetime | None, PlainSerializer(lambda date: date and date.isoformat())]
    change_just_before: float


@dataclass(frozen=True, eq=False)
class Trend(Result):
    """Parameters of one machine over time.

    ``estimates`` has a row per campaign and parameter, inside units: campaign, date, parameter,
    unit, estimate, sd, ci_low, ci_high (of this campaign alone), limit_low, limit_high (99.7 % from
    the campaigns before, no change), outside, change_here, change_by_here (probabilities). The
    instrument's errors are at their posterior mean throughout. Not in JSON.
    """

    machine: str | None  #: machine_id
    reference_force_N: float  #: at which compliances are meant
    #: change_scale, repeatability (in the prior's sd), probability, threshold, ci, one_instrument
    assumptions: Mapping[str, Any]
    #: that one parameter has changed once
    probability: Annotated[float, Field(alias="probability_of_change")]
    changed: bool  #: whether that is above the threshold
    false_alarm: float  #: at most the probability of calling a change where there was none
    campaigns: tuple[Visit, ...]  #: in order of time
    parameters: Mapping[str, ParameterChange]  #: the step of each
    most_probable: str  #: the parameter that most probably changed
    caveats: tuple[Caveat, ...]  #: what to mind
    estimates: Annotated[pd.DataFrame, Field(exclude=True)]
    #: by quantity with a tolerance and campaign, each alone, normal
    conformity: Mapping[str, Mapping[str, Conformity]]
    limits_probability: float = LIMITS  #: of the control limits

    def as_dict(self) -> dict[str, Any]:
        """The findings for JSON, in inside units; intervals are named by their probability."""
        found: dict[str, Any] = keyed(super().as_dict(), self.assumptions["ci"])
        return found


# Three decimals show no less.
_UNLIKELY = 5e-4


@parts_of.register
def _parts(trend: Trend) -> tuple[Table | str, ...]:
    rows = []
    for name, own in trend.parameters.items():
        factor, label = display_unit(own.unit)
        likely = own.probability >= _UNLIKELY
        now = own.level_now
        step = own.change
        rows.append(
            (
                display_name(name),
                plus_minus(now.mean, now.sd, now.interval, own.unit),
                (
                    f"{round_uncertainty(2.0 * own.common_sd * factor)[0]} {label}"
                    if own.common_sd > 0.0
                    else "–"
                ),
                probability_words(own.probability),
                plus_minus(step.mean, step.sd, step.interval, own.unit) if likely else "–",
                (
                    f"{own.percent:+.0f} %".replace("-", "−")
                    if likely and own.percent is not None
                    else "–"
                ),
            )
        )
    heads = ("parameter", "level now", "U, common", "P(changed)", "change, if it did", "of level")
    meant = "± U = 2u. U, common: what the bar adds to all campaigns alike."
    whose = f"{trend.machine}, " if trend.machine else ""
    table = Table.of(f"{whose}{len(trend.campaigns)} campaigns", heads, rows)
    newest = {
        name: own.as_dict()
        for name, every in trend.conformity.items()
        for own in list(every.values())[-1:]
    }
    limits: tuple[Table | str, ...] = ()
    if newest:
        limits = (
            conformity_table(newest),
            f"Of the newest campaign alone, {trend.campaigns[-1].campaign}.",
            "",
        )
    return (table, meant, "", *limits, *trend_sentences(trend), *map(caveat_words, trend.caveats))


@with_words.register
def _in_words(trend: Trend) -> dict[str, Any]:
    doubts = [caveat_words(caveat) for caveat in trend.caveats]
    return trend.as_dict() | {"doubts": doubts, "verdict": list(trend_sentences(trend))}


# Standard uncertainties that a level must be away from zero before a change is told in per cent of
# it: its own uncertainty, left aside there, is then at most a fifth.
_KNOWN = 5.0


def _parameter(
    statistics: FleetStatistics,
    j: int,
    found: Gaussian,
    share: Array,
    numbers: Sequence[float],
    ci_prob: float,
) -> ParameterChange:
    """Of parameter j: `hypotheses` under probabilities (r, n − 1) of r and when; ``numbers`` are
    its level now (mean, sd, ends) and what the instrument adds, in units of the prior's sd."""
    total = float(share.sum())
    scale = float(statistics.prior_sd[j])
    weight = (share / total if total > 0.0 else np.full_like(share, 1.0 / share.size)).ravel()
    (size, size_sd), (base, base_sd) = (
        [part[:, :-1, j, place].ravel() for part in (found.mean, found.sd)] for place in (-1, j)
    )
    mean, sd = (scale * float(one) for one in mixture_moments(weight, size, size_sd))
    before, doubt = (scale * float(one) for one in mixture_moments(weight, base, base_sd))
    seen = weight > 0.0
    tail = 0.5 - 0.5 * ci_prob
    low, high = (
        scale * mixture_quantiles(weight[seen], size[seen], size_sd[seen], (tail, 1.0 - tail))
    ).tolist()
    now, now_sd, now_low, now_high, common = (scale * float(own) for own in numbers)
    when = share.sum(axis=0)
    return ParameterChange(
        unit=statistics.units[j],
        probability=total,
        place=1 + ranked(range(len(when)), lambda k: float(when[k]))[0],
        change=Summary(mean, sd, (low, high)),
        percent=100.0 * mean / before if abs(before) > _KNOWN * doubt else None,
        level_before=before,
        level_now=Summary(now, now_sd, (now_low, now_high)),
        common_sd=common,
    )


_SIZED = ("estimate", "sd", "ci_low", "ci_high", "limit_low", "limit_high")


def _estimates(
    statistics: FleetStatistics,
    visits: Sequence[Visit],
    chart: Chart,
    change: Array,
    ci_prob: float,
) -> pd.DataFrame:
    """One row per campaign and parameter, as `Trend.estimates` has them."""
    reach = float(ndtri(0.5 + 0.5 * ci_prob)) * chart.own_sd
    n, p = chart.own.shape
    sized = np.stack(
        (chart.own, chart.own_sd, chart.own - reach, chart.own + reach, *chart.limits), axis=-1
    )
    here = np.concatenate([np.zeros((1, p)), change.sum(axis=0)])
    return pd.DataFrame(
        {
            "campaign": np.repeat([own.campaign for own in visits], p),
            "date": np.repeat(
                np.array([own.date and own.date.isoformat() for own in visits], dtype=object), p
            ),
            "parameter": np.tile(statistics.parameters, n),
            "unit": np.tile(statistics.units, n),
            **dict(
                zip(
                    _SIZED,
                    (sized * statistics.prior_sd[:p, None]).reshape(n * p, -1).T,
                    strict=True,
                )
            ),
            "outside": ((chart.own < chart.limits[0]) | (chart.own > chart.limits[1])).ravel(),
            "change_here": here.ravel(),
            "change_by_here": np.cumsum(here, axis=0).ravel(),
        }
    )


def _conformities(
    statistics: FleetStatistics,
    visits: Sequence[Visit],
    chart: Chart,
    given: Mapping[str, str | Tolerance] | None,
    stated: Any,
) -> dict[str, dict[str, Conformity]]:
    """Conformity in every campaign alone, what the instrument adds to all of them included, with
    the tolerances given, or those that the newest has ``stated`` (JSON) of what is followed."""
    known = quantities(dict(zip(statistics.parameters, statistics.units, strict=True)))
    found = dict[str, dict[str, Conformity]]()
    own = given or {
        name: text for name, text in json.loads(stated or "{}").items() if name in known
    }
    for name, tolerance in tolerances_in(known, own).items():
        stiff = name.startswith("stiffness_")
        j = [
            f"stiffness_{one[2]}" if stiff and is_direct(one) else one
            for one in statistics.parameters
        ].index(name)
        mean = chart.own[:, j] * statistics.prior_sd[j]
        sd = np.hypot(chart.own_sd[:, j], chart.common_sd[j]) * statistics.prior_sd[j]
        numbers = np.stack([1.0 / mean, sd / mean**2] if stiff else [mean, sd], axis=1).tolist()
        found[name] = {
            visit.campaign: normal_conformity(known[name].unit, middle, spread, tolerance)
            for visit, (middle, spread) in zip(visits, numbers, strict=True)
        }
    return found


def _of_one_machine(
    rows: pd.DataFrame, machine: str | None
) -> tuple[pd.DataFrame, str | None, list[Caveat]]:
    """A batch's rows of one machine, its name, and what is to be minded of the choice."""
    check_rows(rows)
    ids = rows["machine_id"]
    named = ids.map(lambda own: isinstance(own, str)).astype(bool)
    known = sorted(set(ids[named]))
    if machine is not None:
        check_known("machine", [machine], known)
    elif len(known) > 1:
        cure = f"Choose one: --machine {shlex.quote(known[0])} (machine={known[0]!r})."
        raise InputError(
            f"the campaigns must be of one machine, got those of {', '.join(known)}. {cure}"
        )
    if not known:
        return rows, None, [Caveat(CaveatKind.NO_MACHINES)]
    nameless = (
        [] if named.all() else [Caveat(CaveatKind.WITHOUT_MACHINE, tuple(labels(rows[~named])))]
    )
    return rows[ids == (machine or known[0])], machine or known[0], nameless


def _in_time(statistics: FleetStatistics) -> list[int]:
    """Campaigns in order of date, equal dates as given; as given where there are none."""
    missing = [
        name
        for name, date in zip(statistics.campaigns, statistics.dates, strict=True)
        if date is None
    ]
    if missing and len(missing) < len(statistics):
        cure = (
            "Write date = … into campaign.toml, or take all dates out and give the campaigns in"
            " order."
        )
        raise InputError(
            f"campaigns must have a date all or none, got none for {', '.join(missing[:5])}. {cure}"
        )
    return sorted(range(len(statistics)), key=lambda place: statistics.dates[place] or datetime.min)


def _caveats(statistics: FleetStatistics) -> list[Caveat]:
    """What the campaigns do not have in common."""
    found = statistics.caveats
    if all(date is None for date in statistics.dates):
        found.append(Caveat(CaveatKind.NO_DATES))
    return [*found, Caveat(CaveatKind.TWO_CAMPAIGNS)] if len(statistics) == 2 else found


@one_blas_thread
def trend(
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
    ci_prob: float = 0.95,
) -> Trend:
    """Parameters of one machine over time: has one of them changed, which, when and by how much?

    InputError for fewer than two campaigns, several machines and none chosen, dates of some
    campaigns only, options out of range.

    Parameters
    ----------
    rows : of `read_batch`; which of them count, and ``exclude``, ``since`` and ``include_misfits``:
        see `choose`.
    machine : needed where the rows are of several.
    parameters, reference_force_N, one_instrument
        See `fleet_statistics`; default: all constant compliances at the median of the campaigns'
        forces, one bar.
    tolerances : limits of parameters and stiffnesses, see `conformity`; default: those of the
        newest campaign.
    change_scale : standard deviation of a change, in units of the parameter's default prior sd:
        2e-5 mm/N of C_XXX.
    repeatability : scale of the half-normal density of r, what the machine changes from campaign to
        campaign, in the same units: 1e-6 mm/N of C_XXX, 2 % of a usual 5e-5 mm/N.
    probability : of a change, before the readings.
    threshold : probability above which a change counts as found.
    ci_prob : float
    """
    check_probability(ci_prob)
    believed = {
        "change_scale": change_scale,
        "repeatability": repeatability,
        "probability": probability,
        "threshold": threshold,
    }
    for (name, value), most in zip(believed.items(), (np.inf, np.inf, 1.0, 1.0), strict=True):
        if not 0.0 < value < most:
            raise InputError(
                f"{name} must be above 0{' and below 1' * (most == 1.0)}, got {value:g}."
                " Correct it."
            )
    chosen, machine, caveats = _of_one_machine(rows, machine)
    relied, more = choose(chosen, exclude, since, include_misfits, among=rows)
    caveats += more
    statistics = fleet_statistics(
        relied,
        parameters=parameters,
        reference_force_N=reference_force_N,
        one_instrument=one_instrument,
    )
    why = " ".join(("Measure again.", *map(caveat_words, caveats)))
    got = f"got {len(statistics)}. {why}"
    require(
        len(statistics) > 1,
        f"a trend must have at least 2 campaigns of one machine to rely on, {got}",
    )
    order = _in_time(statistics)
    p = len(statistics.parameters)
    series = Gaussian(statistics.likelihood.precision[order], statistics.likelihood.shift[order])
    scatter, prior = scatter_rule(repeatability)
    carried = deviating(series, np.outer(scatter, np.ones(p)))
    found = hypotheses(carried, p, change_scale)
    weights = weigh(found.log_integral, prior, probability)
    instrument = instrument_moments(found, weights)
    chart = chart_of(series, carried, scatter, prior, instrument)
    change = weights[:, :-1]
    when = zip(
        labels(relied.iloc[order]), order, [0.0, *change.sum(axis=(0, 2)).tolist()], strict=True
    )
    visits = tuple(Visit(name, statistics.dates[i], share) for name, i, share in when)
    level, level_sd, ends = levels_of(found, weights, ci_prob=ci_prob)
    numbers = np.stack([level, level_sd, *ends, chart.common_sd], axis=1)
    steps = [
        _parameter(statistics, j, found, change[:, :, j], numbers[j], ci_prob) for j in range(p)
    ]
    total = 1.0 - float(weights[:, -1].sum())
    return Trend(
        machine=machine,
        reference_force_N=statistics.reference_force_N,
        assumptions=believed | {"ci": ci_prob, "one_instrument": bool(statistics.instrument)},
        probability=total,
        changed=total > threshold,
        false_alarm=min(1.0, (1.0 - threshold) / threshold * probability / (1.0 - probability)),
        campaigns=visits,
        parameters=dict(zip(statistics.parameters, steps, strict=True)),
        most_probable=statistics.parameters[ranked(range(p), lambda j: steps[j].probability)[0]],
        caveats=(*caveats, *_caveats(statistics)),
        estimates=_estimates(statistics, visits, chart, change, ci_prob),
        conformity=_conformities(
            statistics, visits, chart, tolerances, relied["tolerances"].iloc[order[-1]]
        ),
    )


# ---- its chart
