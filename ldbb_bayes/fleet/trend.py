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
from typing import Annotated, Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from pydantic import Field, PlainSerializer
from scipy.special import erf, logsumexp, ndtri

from ldbb_bayes.analysis.conformity import (
    Conformity,
    Tolerance,
    normal_conformity,
    quantities,
    tolerances_in,
)
from ldbb_bayes.errors import InputError, check_known, require
from ldbb_bayes.fleet.dataset import Caveat, CaveatKind, check_rows, choose, labels
from ldbb_bayes.fleet.statistics import (
    FleetStatistics,
    Summary,
    alone,
    deviating,
    fleet_statistics,
    keyed,
    mixture_covariance,
)
from ldbb_bayes.inference.summary import check_probability
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.mixtures import mixture_moments, mixture_quantiles
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.report.figures.style import ACCENT, LIGHT, PALETTE, axis_label, band, panels, styled
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

__all__ = ["LIMITS", "ParameterChange", "Trend", "Visit", "control_chart", "trend"]

LIMITS = 0.997
_LEAST = 0.03
_MOST = 8.0
_STEP = 0.12
_NEGLIGIBLE = 1e-7

# ---- the model


def scatter_rule(repeatability: float) -> tuple[Array, Array]:
    """Nodes of r and their weights, shape (r,): trapezoids in ln r; what lies below the lowest
    counts there."""
    count = int(np.ceil(np.log(_MOST / _LEAST) / _STEP)) + 1
    log_ratio = np.linspace(np.log(_LEAST), np.log(_MOST), count)
    ratio = np.exp(log_ratio)
    weight = ratio * np.sqrt(2.0 / np.pi) * np.exp(-0.5 * ratio**2) * (log_ratio[1] - log_ratio[0])
    weight[[0, -1]] *= 0.5
    weight[0] += erf(_LEAST / np.sqrt(2.0))
    return repeatability * ratio, weight / weight.sum()


def hypotheses(carried: Gaussian, parameters: int, change_scale: float) -> Gaussian:
    """(c, b, Δ) under every hypothesis, shape (r, n, p, q + 1); ``log_integral`` is their log
    evidence, up to what all share. Place k, counted from 0, is a step just before campaign k + 2;
    the last, of whatever parameter, is no step at all. ``carried`` are the campaigns in order of
    time, (r, n, q), their w_t integrated: `deviating`."""
    precision, shift = (
        np.cumsum(own[:, ::-1], axis=1)[:, ::-1] for own in (carried.precision, carried.shift)
    )
    (r, n, q), p = shift.shape, parameters
    late = np.swapaxes(precision[:, 1:, :, :p], -1, -2)
    whole = np.zeros((r, n, p, q + 1, q + 1))
    pull = np.zeros((r, n, p, q + 1))
    whole[..., :q, :q] = np.eye(q) + precision[:, None, :1]
    whole[..., q, q] = change_scale**-2.0
    whole[:, :-1, :, q, q] += np.einsum("rkjj->rkj", late[..., :p])
    whole[:, :-1, :, :q, q] = whole[:, :-1, :, q, :q] = late
    pull[..., :q], pull[:, :-1, :, q] = shift[:, None, :1], shift[:, 1:, :p]
    return Gaussian(whole, pull, carried.log_constant.sum(axis=1)[:, None, None])


def weigh(log_evidence: Array, scatter_weight: Array, probability: float) -> Array:
    """Posterior probability of every hypothesis, (r, n, p), from their log evidence, weights of r
    and the prior of a change."""
    _, times, parameters = log_evidence.shape
    prior = np.full((times, parameters), probability / max((times - 1) * parameters, 1))
    prior[-1] = (1.0 - probability) / parameters
    log_weight = log_evidence + np.log(prior) + np.log(scatter_weight)[:, None, None]
    return np.asarray(np.exp(log_weight - logsumexp(log_weight)))


def instrument_moments(found: Gaussian, weights: Array) -> tuple[Array, Array]:
    """Posterior mean and covariance of the instrument's errors, averaged over hypotheses; shapes
    (s,), (s, s)."""
    p = weights.shape[2]
    q = found.mean.shape[-1] - 1
    spread = found.spread(np.eye(q + 1)[p:q])
    covariance = (spread @ np.swapaxes(spread, -1, -2)).reshape(weights.size, q - p, q - p)
    return mixture_covariance(
        weights.ravel(), found.mean[..., p:q].reshape(weights.size, q - p), covariance
    )


class Chart(NamedTuple):
    """What is drawn of every campaign, in order of time, the instrument's errors at their posterior
    mean. ``own`` and ``own_sd`` (n, p) are of each campaign alone, ``limits`` (2, n, p) NaN at the
    first; ``common_sd`` (p,) what the instrument's errors add to the level of all campaigns
    together."""

    own: Array
    own_sd: Array
    limits: Array
    common_sd: Array


def chart_of(
    series: Gaussian,
    carried: Gaussian,
    scatter: Array,
    scatter_weight: Array,
    instrument: tuple[Array, Array],
    *,
    limits: float = LIMITS,
) -> Chart:
    """Points with their uncertainty, and limits of this probability from the campaigns before each.
    ``series`` (n, q) and ``carried`` (r, n, q) are the campaigns in order of time, scatter and its
    weights (r,) the prior of r, ``instrument`` posterior mean and covariance of the instrument's
    errors."""
    known, spread = instrument
    q = series.shift.shape[-1]
    p = q - len(known)
    shrink, seen, estimate = alone(series, p)
    own = estimate - seen[..., p:] @ known
    whole = series.precision[:, :p].sum(axis=0)
    pulled = np.linalg.solve(np.eye(p) + whole[:, :p], whole[:, p:])
    common = np.sqrt(np.einsum("as,su,au->a", pulled, spread, pulled))

    sums = [
        np.cumsum(part[:, :-1], axis=1)
        for part in (carried.precision, carried.shift, carried.log_constant)
    ]
    before = Gaussian(np.eye(q) + sums[0], *sums[1:])
    log_weight = np.log(scatter_weight)[:, None] + before.log_integral
    weight = np.exp(log_weight - logsumexp(log_weight, axis=0))
    take = seen[1:]
    expected = np.einsum("tab,rtb->rta", take, before.mean) - take[..., p:] @ known
    deviation = scatter[:, None, None] ** 2 * (take[..., :p] ** 2).sum(axis=-1)
    noise = np.einsum("tab,tab->ta", take[..., :p], shrink[1:])
    sd = np.sqrt((before.spread(take) ** 2).sum(axis=-1) + deviation + noise)
    tail = 0.5 - 0.5 * limits
    ends = mixture_quantiles(
        weight[:, :, None], expected, np.maximum(sd, 1e-300), (tail, 1.0 - tail)
    )
    nothing = np.full((2, 1, p), np.nan)
    return Chart(
        own, np.sqrt(np.einsum("taa->ta", shrink)), np.concatenate([nothing, ends], axis=1), common
    )


def levels_of(
    found: Gaussian, weights: Array, *, ci_prob: float = 0.95
) -> tuple[Array, Array, Array]:
    """Mean and sd (p,) and interval (2, p) of c, with the step where there was one, averaged over
    hypotheses."""
    _, n, p = weights.shape
    level = np.eye(p, found.mean.shape[-1]) + np.zeros((n, p, p, 1))
    level[: n - 1, range(p), range(p), -1] = 1.0
    mean = np.einsum("kjab,rkjb->rkja", level, found.mean).reshape(-1, p)
    sd = np.sqrt((found.spread(level) ** 2).sum(axis=-1)).reshape(-1, p)
    counts = weights.ravel() > _NEGLIGIBLE * weights.max()
    weight = weights.ravel()[counts] / weights.ravel()[counts].sum()
    tail = 0.5 - 0.5 * ci_prob
    ends = mixture_quantiles(weight, mean[counts], sd[counts], (tail, 1.0 - tail))
    return (*mixture_moments(weight, mean[counts], sd[counts]), ends)


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

_VISIBLE = 0.05
_MOST_NAMED = 6


@styled
def control_chart(trend: Trend) -> Figure:
    """Return the chart of a ``trend``, a panel for each parameter: campaigns in order of time, each
    by itself, the limits from those before it, and where it may have changed."""
    columns = min(len(trend.parameters), 2)
    figure, every = panels(len(trend.parameters), columns, 2.0, 0.9, sharex=True)
    for k, (axes, name) in enumerate(zip(every, trend.parameters, strict=True)):
        _panel(axes, trend, name, trend.estimates[trend.estimates["parameter"] == name])
        if k + columns >= len(every):
            _name_campaigns(axes, trend)
    found = {
        label: handle
        for axes in every
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    figure.legend(list(found.values()), list(found), loc="outside lower center", ncols=2)
    whose = trend.machine or "One machine"
    figure.suptitle(
        f"{whose}: probability of a change {probability_words(trend.probability)}"
        f"{'' if trend.reference_force_N <= 0.0 else f', compliances at {trend.reference_force_N:.0f} N'}"
    )
    return figure


def _panel(axes: Axes, trend: Trend, name: str, own: pd.DataFrame) -> None:
    factor, label = axis_label(name, str(own["unit"].iloc[0]))
    value = {
        column: own[column].to_numpy() * factor
        for column in own.columns
        if own[column].dtype == float
    }
    limits = (value["limit_low"], value["limit_high"])
    low = float(value["ci_low"].min())
    high = float(value["ci_high"].max())
    places = np.arange(1.0, len(own) + 1.0)
    # Each campaign's limits as wide as its place; the first has none.
    edges = np.append(places - 0.5, places[-1] + 0.5)
    said = f"limits from those before, {100 * LIMITS:g} %"
    steps = [np.append(limit, limit[-1]) for limit in limits]
    band(axes, edges, steps, LIGHT, 0.6, step="post", label=said)
    out = own["outside"].to_numpy()
    alone = f"campaign by itself, {100 * trend.assumptions['ci']:g} %"
    for chosen, colour, mark, meant in (
        (~out, ACCENT, "o", alone),
        (out, PALETTE[1], "D", "outside its limits"),
    ):
        if chosen.any():
            ends = np.abs(np.array([value["ci_low"], value["ci_high"]]) - value["estimate"])[
                :, chosen
            ]
            axes.errorbar(
                places[chosen],
                value["estimate"][chosen],
                ends,
                fmt=mark,
                color=colour,
                markersize=3.0,
                label=meant,
            )
    # Limits as far as they are of the points' size.
    room = 0.5 * (high - low)
    margin = 0.05 * (high - low)
    least = float(np.nanmin(limits[0]))
    most = float(np.nanmax(limits[1]))
    axes.set_ylim(
        max(min(least, low), low - room) - margin, min(max(most, high), high + room) + margin
    )
    axes.set(ylabel=label, xlim=(0.5, len(own) + 0.5))
    common = trend.parameters[name].common_sd * factor
    shared = (
        f"\nu common to all {round_uncertainty(common)[0]}"
        f" {display_unit(trend.parameters[name].unit)[1]}"
        if common
        else ""
    )
    changed = probability_words(trend.parameters[name].probability)
    axes.set_title(f"{display_name(name)}: probability of a change {changed}{shared}", fontsize=8)
    for when, here in zip(edges[1:-1], own["change_here"].to_numpy()[1:], strict=True):
        if here > _VISIBLE:
            axes.axvline(
                when,
                color="black",
                linestyle="--",
                alpha=min(float(here), 1.0),
                label="a change here, as dark as probable",
            )


def _name_campaigns(axes: Axes, trend: Trend) -> None:
    axes.tick_params(labelbottom=True)
    count = len(trend.campaigns)
    if trend.campaigns[0].date is None:
        axes.set_xlabel("campaign (in the order given)")
        axes.xaxis.set_major_locator(MaxNLocator(8, integer=True))
        return
    shown = np.unique(np.linspace(0, count - 1, min(count, _MOST_NAMED)).round().astype(int))
    axes.set_xticks(
        shown + 1,
        [f"{trend.campaigns[k].date:%Y-%m-%d}" for k in shown],
        rotation=30,
        ha="right",
        rotation_mode="anchor",
    )
    axes.set_xlabel("campaign (by date, evenly spaced)")
