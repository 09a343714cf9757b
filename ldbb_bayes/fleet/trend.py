"""c_t = c + Δ e_j 1[t ≥ k] + w_t over one machine's campaigns: estimates in time, probability of a change, how soon it is found.

See `change` for the model. Truncation is left aside. Parameters not chosen are integrated out anew in each campaign, as ball form
and bar length are, though one machine and one bar keep theirs: that is conservative for changes, above all of geometric errors,
but not for levels, which one bar shifts alike in all campaigns.
"""

from __future__ import annotations

import math
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import ndtri

from ldbb_bayes.errors import InputError, check_known
from ldbb_bayes.fleet.change import (
    Chart,
    Detection,
    Levels,
    Series,
    Steps,
    Weights,
    carry,
    chart_of,
    detection,
    instrument_moments,
    levels_of,
    scatter_rule,
    steps_of,
    weigh,
)
from ldbb_bayes.fleet.statistics import Caveat, CaveatKind, FleetStatistics, choose, fleet_statistics, labels, narrow_forces
from ldbb_bayes.inference.posterior import check_probability
from ldbb_bayes.jobs import one_blas_thread
from ldbb_bayes.model.gaussian import mixture_quantiles
from ldbb_bayes.report.text import parts_of
from ldbb_bayes.report.wording import caveat_words, probability_words, trend_sentences, with_words
from ldbb_bayes.result import Result
from ldbb_bayes.table import Table
from ldbb_bayes.units import display_name, display_unit, plus_minus, ranked, round_uncertainty, units_for

__all__ = ["LIMITS", "MostProbable", "ParameterChange", "Trend", "trend"]

Array = NDArray[Any]
LIMITS = 0.997
# Below this P(changed) shows as 0.000.
_UNLIKELY = 5e-4


@dataclass(frozen=True)
class ParameterChange(Result):
    """A step of one parameter, inside units.

    Attributes
    ----------
    probability : float
        That this parameter is the one that changed.
    size, sd, interval
        Of the step, given that it is this parameter that changed.
    percent, percent_interval : float or None
        Of the level before, the interval of the change alone; None where the level is not known to a fifth.
    before : float
        Level before the step.
    level, level_sd : float
        Level at the last campaign, averaged over hypotheses.
    common_sd : float
        What the instrument's errors add to the level of all campaigns together; in no point, limit or level.
    """

    unit: str
    probability: float
    size: float
    sd: float
    interval: tuple[float, float]
    percent: float | None
    percent_interval: tuple[float, float] | None
    before: float
    level: float
    level_sd: float
    common_sd: float


@dataclass(frozen=True)
class MostProbable(Result):
    """The one step that is named where a change is found.

    Attributes
    ----------
    parameter : str
        The one that most probably changed.
    place : int
        Of the campaign just before which it most probably did, given that it is this one; 1 is the second.
    change : ParameterChange
        Of this parameter at that time; its probability is that of both.
    """

    parameter: str
    place: int
    change: ParameterChange


@dataclass(frozen=True, eq=False)
class Trend(Result):
    """Parameters of one machine over time.

    Attributes
    ----------
    machine : str or None
    campaigns : tuple of str, length n
        In order of time.
    dates : tuple of datetime or None, length n
    reference_force_N : float
    assumptions : mapping
        change_scale, repeatability (units of the prior's sd), probability, threshold, detect, ci, one_instrument, seed.
    probability : float
        That one parameter has changed once.
    by_time : ndarray, shape (n,)
        That it changed just before each campaign; the first is 0.
    parameters : mapping of name to ParameterChange
        Each whenever it was.
    most_probable : MostProbable
    scatter : tuple of float
        r, what the machine changes from campaign to campaign in units of the prior's sd: mean, ends of its interval.
    estimates : DataFrame
        One row per campaign and parameter, inside units: campaign, date, parameter, unit, estimate, sd, ci_low, ci_high (of this
        campaign alone), limit_low, limit_high (99.7 % from the campaigns before, no change), outside, level, level_low,
        level_high, change_here, change_by_here (probabilities). The instrument's errors are at their posterior mean throughout.
    sensitivity : mapping of assumption to probability of a change
    detection : Detection
    caveats : tuple of Caveat
        What to mind.
    """

    machine: str | None
    campaigns: tuple[str, ...]
    dates: tuple[datetime | None, ...]
    reference_force_N: float
    assumptions: Mapping[str, Any]
    probability: float
    by_time: Array
    parameters: Mapping[str, ParameterChange]
    most_probable: MostProbable
    scatter: tuple[float, float, float]
    estimates: pd.DataFrame
    sensitivity: Mapping[str, float]
    detection: Detection
    caveats: tuple[Caveat, ...]

    @property
    def changed(self) -> bool:
        """Whether the probability of a change is above the threshold."""
        return bool(self.probability > self.assumptions["threshold"])

    def sizes(self) -> dict[str, list[float]]:
        """Sizes of the estimates by inside unit, for `units_for`."""
        found: dict[str, list[float]] = {}
        for unit, value in zip(self.estimates["unit"], self.estimates["estimate"], strict=True):
            found.setdefault(unit, []).append(value)
        return found

    def as_dict(self) -> dict[str, Any]:
        """Plain numbers, inside units."""
        soon, ci = self.detection, f"ci{100 * self.assumptions['ci']:g}"
        return {
            "machine": self.machine,
            "reference_force_N": self.reference_force_N,
            "assumptions": dict(self.assumptions),
            "probability_of_change": self.probability,
            "changed": self.changed,
            "campaigns": [
                {"campaign": name, "date": None if date is None else date.isoformat(), "change_just_before": float(one)}
                for name, date, one in zip(self.campaigns, self.dates, self.by_time, strict=True)
            ],
            "parameters": {
                name: {
                    "unit": own.unit,
                    "probability": own.probability,
                    "change": {"mean": own.size, "sd": own.sd, ci: list(own.interval)},
                    "percent": own.percent,
                    f"percent_{ci}": None if own.percent_interval is None else list(own.percent_interval),
                    "level_before": own.before,
                    "level_now": own.level,
                    "level_now_sd": own.level_sd,
                    "common_sd": own.common_sd,
                    "detection": {
                        "found_within": [None if np.isnan(one) else float(one) for one in soon.found[k]],
                        "error": [None if np.isnan(one) else float(one) for one in soon.error(soon.found[k])],
                        "campaigns_for_90_percent": soon.campaigns(k),
                    },
                }
                for k, (name, own) in enumerate(self.parameters.items())
            },
            "most_probable": {
                "parameter": self.most_probable.parameter,
                "just_before": self.campaigns[self.most_probable.place],
                "probability": self.most_probable.change.probability,
                "change": {
                    "mean": self.most_probable.change.size,
                    "sd": self.most_probable.change.sd,
                    ci: list(self.most_probable.change.interval),
                },
            },
            "scatter": {"mean": self.scatter[0], ci: list(self.scatter[1:])},
            "sensitivity": dict(self.sensitivity),
            "false_alarm": {
                "within": [float(one) for one in soon.false_alarm],
                "error": [float(one) for one in soon.error(soon.false_alarm)],
                "campaigns_before": soon.before,
                "replicates": soon.replicates,
            },
            "limits_probability": LIMITS,
            "caveats": [caveat.as_dict() for caveat in self.caveats],
        }


@parts_of.register
def _parts(trend: Trend) -> tuple[Table | str, ...]:
    rows = []
    last = trend.estimates[trend.estimates["campaign"] == trend.campaigns[-1]].set_index("parameter")
    lows, highs = (last[name].to_dict() for name in ("level_low", "level_high"))
    asked = trend.assumptions["detect"]
    with units_for(trend.sizes()):
        for k, (name, own) in enumerate(trend.parameters.items()):
            ends = (float(lows[name]), float(highs[name]))
            factor, label = display_unit(own.unit)
            common = f"{round_uncertainty(own.common_sd * factor)[0]} {label}" if own.common_sd > 0.0 else "–"
            likely = own.probability >= _UNLIKELY
            needed = trend.detection.campaigns(k)
            none = f"over {len(trend.detection.false_alarm)}" if np.isfinite(trend.detection.changes[k]) else "–"
            rows.append(
                {
                    "parameter": display_name(name),
                    "level now": plus_minus(own.level, own.level_sd, ends, own.unit),
                    "u, common": common,
                    "P(changed)": probability_words(own.probability),
                    "change, if it did": plus_minus(own.size, own.sd, own.interval, own.unit) if likely else "–",
                    "of level": f"{own.percent:+.0f} %".replace("-", "−") if likely and own.percent is not None else "–",
                    f"{100 * asked:+.0f} % found within".replace("-", "−"): none if needed is None else str(needed),
                }
            )
    meant = "± U = 2u; of a probability ± u, of counting simulated series. u, common: what the bar adds to all campaigns alike."
    whose = f"{trend.machine}, " if trend.machine else ""
    table = Table.of(f"{whose}{len(trend.campaigns)} campaigns", list(rows[0]), [list(row.values()) for row in rows])
    return (table, meant, "", *trend_sentences(trend), *map(caveat_words, trend.caveats))


@with_words.register
def _in_words(trend: Trend) -> dict[str, Any]:
    doubts = [caveat_words(caveat) for caveat in trend.caveats]
    return trend.as_dict() | {"doubts": doubts, "verdict": list(trend_sentences(trend))}


# Standard uncertainties that a level must be away from zero before a change is told in per cent of it: its own uncertainty, left
# aside in them, is then at most a fifth.
_KNOWN = 5.0


def _changes(
    statistics: FleetStatistics, steps: Steps, weights: Weights, chart: Chart, levels: Levels, ci_prob: float
) -> dict[str, ParameterChange]:
    """Size of each parameter's step, given that it is the one, whenever it was."""
    return {
        name: _step(statistics, steps, weights.change[:, :, j], j, chart, levels, ci_prob)
        for j, name in enumerate(statistics.parameters)
    }


def _most_probable(
    statistics: FleetStatistics, steps: Steps, weights: Weights, chart: Chart, levels: Levels, ci_prob: float
) -> MostProbable:
    """The parameter that most probably changed, and when it most probably did, given that it is this one."""
    here = weights.change.sum(axis=0)
    j = ranked(range(here.shape[1]), lambda i: float(here[:, i].sum()))[0]
    k = ranked(range(len(here)), lambda t: float(here[t, j]))[0]
    share = np.zeros_like(weights.change[:, :, j])
    share[:, k] = weights.change[:, k, j]
    own = _step(statistics, steps, share, j, chart, levels, ci_prob)
    return MostProbable(statistics.parameters[j], k + 1, own)


def _step(
    statistics: FleetStatistics, steps: Steps, share: Array, j: int, chart: Chart, levels: Levels, ci_prob: float
) -> ParameterChange:
    """Of parameter j under the probabilities ``share``, shape (r, K)."""
    ends = (0.5 - 0.5 * ci_prob, 0.5 + 0.5 * ci_prob)
    unit_sd, offset = float(statistics.prior_sd[j]), float(statistics.prior_mean[j])
    total = float(share.sum())
    share = (share / total if total > 0.0 else np.full_like(share, 1.0 / share.size)).ravel()
    size, spread = steps.size[:, :, j].ravel(), np.sqrt(steps.variance[:, :, j]).ravel()
    mean = float(share @ size)
    sd = float(np.sqrt(share @ (spread**2 + (size - mean) ** 2)))
    seen = share > 0.0
    low, high = (float(end) for end in mixture_quantiles(share[seen], size[seen], spread[seen], ends))
    tilt = steps.tilt[:, :, j, j].ravel()
    base = np.repeat(steps.mean[:, j], steps.size.shape[1]) - tilt * size
    inside = np.repeat(steps.covariance[:, j, j], steps.size.shape[1]) + (tilt * spread) ** 2
    middle = float(share @ base)
    before, doubt = offset + unit_sd * middle, unit_sd * float(np.sqrt(share @ (inside + (base - middle) ** 2)))
    known = abs(before) > _KNOWN * doubt
    percent, *ends_of = (100.0 * unit_sd * one / before if known else np.nan for one in (mean, low, high))
    return ParameterChange(
        unit=statistics.units[j],
        probability=total,
        size=unit_sd * mean,
        sd=unit_sd * sd,
        interval=(unit_sd * low, unit_sd * high),
        percent=percent if known else None,
        percent_interval=(min(ends_of), max(ends_of)) if known else None,
        before=before,
        level=offset + unit_sd * float(levels.mean[-1, j]),
        level_sd=unit_sd * float(levels.sd[-1, j]),
        common_sd=unit_sd * float(chart.common_sd[j]),
    )


def _estimates(
    statistics: FleetStatistics,
    names: Sequence[str],
    order: Sequence[int],
    chart: Chart,
    levels: Levels,
    weights: Weights,
    ci_prob: float,
) -> pd.DataFrame:
    """One row per campaign and parameter, as `Trend.estimates` has them."""
    reach = float(ndtri(0.5 + 0.5 * ci_prob))
    here = np.concatenate([np.zeros((1, len(statistics.parameters))), weights.change.sum(axis=0)])
    changed = np.cumsum(here, axis=0)
    rows = []
    for t, name in enumerate(names):
        date = statistics.dates[order[t]]
        for j, parameter in enumerate(statistics.parameters):
            sd, offset = float(statistics.prior_sd[j]), float(statistics.prior_mean[j])
            own, spread = chart.own[t, j], chart.own_sd[t, j]
            low, high = chart.limits[:, t, j]
            values = (own, own - reach * spread, own + reach * spread, low, high, levels.mean[t, j], *levels.interval[:, t, j])
            estimate, ci_low, ci_high, limit_low, limit_high, level, level_low, level_high = (offset + sd * one for one in values)
            rows.append(
                {
                    "campaign": name,
                    "date": None if date is None else date.isoformat(),
                    "parameter": parameter,
                    "unit": statistics.units[j],
                    "estimate": estimate,
                    "sd": sd * spread,
                    "ci_low": ci_low,
                    "ci_high": ci_high,
                    "limit_low": limit_low,
                    "limit_high": limit_high,
                    "outside": bool(own < low or own > high),
                    "level": level,
                    "level_low": level_low,
                    "level_high": level_high,
                    "change_here": here[t, j],
                    "change_by_here": changed[t, j],
                }
            )
    return pd.DataFrame(rows)


def _of_one_machine(rows: pd.DataFrame, machine: str | None) -> tuple[pd.DataFrame, list[Caveat]]:
    """A batch's rows of one machine, and what is to be minded of the choice."""
    ids = rows["machine_id"] if "machine_id" in rows else pd.Series([None] * len(rows), index=rows.index, dtype=object)
    named = ids.map(lambda own: isinstance(own, str)).astype(bool)
    known = sorted(set(ids[named]))
    if machine is not None:
        check_known("machine", [machine], known)
    elif len(known) > 1:
        raise InputError(
            f"the campaigns must be of one machine, got those of {', '.join(known)}. Choose one: "
            f"--machine {shlex.quote(known[0])} (machine={known[0]!r})."
        )
    if not known:
        return rows, [Caveat(CaveatKind.NO_MACHINES)]
    failed = ~named & (rows["status"] != "done")
    nameless = {CaveatKind.FAILED_WITHOUT_MACHINE: failed, CaveatKind.WITHOUT_MACHINE: ~named & ~failed}
    caveats = [Caveat(kind, tuple(labels(rows[which]))) for kind, which in nameless.items() if which.any()]
    return rows[ids == (machine or known[0])], caveats


def _in_time(statistics: FleetStatistics) -> list[int]:
    """Campaigns in order of date, equal dates as given; as given where there are none."""
    missing = [name for name, date in zip(statistics.campaigns, statistics.dates, strict=True) if date is None]
    if missing and len(missing) < len(statistics):
        raise InputError(
            f"campaigns must have a date all or none, got none for {', '.join(missing[:5])}. Write date = … into campaign.toml, "
            "or take all dates out and give the campaigns in order."
        )
    seconds = [0.0 if date is None else date.timestamp() for date in statistics.dates]
    return [int(place) for place in np.argsort(seconds, kind="stable")]


def _caveats(rows: pd.DataFrame, statistics: FleetStatistics, one_bar: bool) -> list[Caveat]:
    """What the campaigns do not have in common."""
    low, high = statistics.forces_N
    found = []
    if low > high:
        found.append(Caveat(CaveatKind.NO_COMMON_FORCE))
    elif not low <= statistics.reference_force_N <= high:
        found.append(Caveat(CaveatKind.EXTRAPOLATED, values=(statistics.reference_force_N, low, high)))
    if one_bar:
        found += narrow_forces(rows, statistics.parameters)
    if all(date is None for date in statistics.dates):
        found.append(Caveat(CaveatKind.NO_DATES))
    elif len(set(statistics.dates)) < len(statistics):
        found.append(Caveat(CaveatKind.SAME_DATES))
    if len(statistics) == 2:
        found.append(Caveat(CaveatKind.TWO_CAMPAIGNS))
    return found


# Standard uncertainties that a level must be away from zero before a change is asked for in per cent of it.
_TOLD = 2.0


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
    change_scale: float = 0.2,
    repeatability: float = 0.01,
    probability: float = 0.5,
    threshold: float = 0.95,
    detect: float = 0.2,
    ci_prob: float = 0.95,
    seed: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Trend:
    """Parameters of one machine over time: has one of them changed, and how soon would a change be found?

    Parameters
    ----------
    rows : DataFrame
        Of `read_batch`; campaigns that failed, have no sufficient statistics or readings that the model does not expect are left
        out and named.
    machine : str, optional
        Needed where the rows are of several.
    parameters : sequence of str, optional
        Compliances or geometric errors; default: all constant compliances.
    exclude : sequence of str
        Campaigns (path as given, last part of it, or name) to leave out.
    since : str, optional
        ISO 8601 date; campaigns before it are left out.
    include_misfits : bool
        Keep campaigns whose readings the model does not expect, see `choose`.
    reference_force_N : float, optional
        Force at which compliances are meant; default: the median of the campaigns' own.
    one_instrument : bool
        Whether all campaigns share one bar's mount and force gain.
    change_scale : float
        Standard deviation of a change, in units of the parameter's default prior sd: 2e-5 mm/N of C_XXX.
    repeatability : float
        Scale of the half-normal density of r, what the machine changes from campaign to campaign, in the same units: 1e-6 mm/N
        of C_XXX, 2 % of a usual 5e-5 mm/N.
    probability : float
        Of a change, before the readings.
    threshold : float
        Probability above which a change counts as found.
    detect : float
        Relative change whose detection is predicted: 0.2 is +20 %.
    ci_prob : float
    seed : int
        Of the series simulated for the prediction.
    progress : callable, optional
        Called with the steps done and their number.

    Raises
    ------
    InputError
        For fewer than two campaigns, several machines and none chosen, dates of some campaigns only, options out of range.
    """
    check_probability(ci_prob)
    _check(change_scale, repeatability, probability, threshold, detect)
    chosen, caveats = _of_one_machine(rows, machine)
    relied, more = choose(chosen, exclude, since, include_misfits, among=rows)
    caveats += more
    statistics = fleet_statistics(
        relied, parameters=parameters, reference_force_N=reference_force_N, one_instrument=one_instrument
    )
    if len(statistics) < 2:
        raise InputError(
            f"a trend must have at least 2 campaigns of one machine to rely on, got {len(statistics)}. "
            + " ".join(("Measure again.", *map(caveat_words, caveats)))
        )
    order = _in_time(statistics)
    series = Series.of(statistics, order)
    names = tuple(labels(relied.iloc[order]))

    scatter, prior = scatter_rule(repeatability)
    carried = carry(series, scatter)
    steps = steps_of(carried, change_scale)
    weights = weigh(steps, prior, probability)
    moments = instrument_moments(steps, weights, series.parameters)
    chart = chart_of(series, carried, scatter, prior, moments, limits=LIMITS)
    levels = levels_of(series, scatter, weights, moments[0], change_scale, ci_prob=ci_prob)
    found = _changes(statistics, steps, weights, chart, levels, ci_prob)
    total = 1.0 - float(weights.none.sum())
    n = len(series)
    by_time = np.concatenate([[0.0], weights.change.sum(axis=(0, 2))])
    likely = _most_probable(statistics, steps, weights, chart, levels, ci_prob)
    seen = n - likely.place if total > threshold else n

    believed: dict[str, Any] = {"change_scale": change_scale, "repeatability": repeatability, "probability": probability}
    foresee = partial(detection, before=seen, threshold=threshold, seed=seed, progress=progress, **believed)
    soon = _foreseen(foresee, series, statistics, levels, chart, (scatter, weights.scatter), moments[0], detect)
    return Trend(
        machine=machine or _only(chosen),
        campaigns=names,
        dates=tuple(statistics.dates[i] for i in order),
        reference_force_N=statistics.reference_force_N,
        assumptions={
            **believed,
            "threshold": threshold,
            "detect": detect,
            "ci": ci_prob,
            "one_instrument": bool(statistics.instrument),
            "seed": seed,
        },
        probability=total,
        by_time=by_time,
        parameters=found,
        most_probable=likely,
        scatter=_scattered(scatter, weights.scatter, ci_prob),
        estimates=_estimates(statistics, names, order, chart, levels, weights, ci_prob),
        sensitivity=_sensitivity(series, change_scale, repeatability, probability),
        detection=soon,
        caveats=(*caveats, *_caveats(relied, statistics, one_instrument)),
    )


def _foreseen(
    foresee: Callable[..., Detection],
    series: Series,
    statistics: FleetStatistics,
    levels: Levels,
    chart: Chart,
    scatter: tuple[Array, Array],
    instrument: Array,
    detect: float,
) -> Detection:
    """How soon a relative change is found, of parameters measured well enough to speak of one."""
    mean, sd = statistics.prior_mean, statistics.prior_sd
    now = mean + sd * levels.mean[-1]
    measured = np.abs(now) > _TOLD * sd * np.hypot(levels.sd[-1], chart.common_sd)
    at = np.concatenate([levels.mean[-1], instrument])
    change = np.where(measured, detect * now / sd, np.nan)
    return foresee(series.information.mean(axis=0), series.parameters, at, change, scatter=scatter)


def _scattered(scatter: Array, weight: Array, ci_prob: float) -> tuple[float, float, float]:
    """Mean and interval of the scatter between campaigns."""
    spread = weight / weight.sum()
    ends = np.searchsorted(np.cumsum(spread), [0.5 - 0.5 * ci_prob, 0.5 + 0.5 * ci_prob])
    low, high = scatter[np.minimum(ends, len(scatter) - 1)].tolist()
    return float(spread @ scatter), low, high


def _check(change_scale: float, repeatability: float, probability: float, threshold: float, detect: float) -> None:
    for name, value in (("change_scale", change_scale), ("repeatability", repeatability)):
        if not (math.isfinite(value) and value > 0.0):
            raise InputError(f"{name} must be above zero, in units of the prior's sd, got {value:g}. Correct it.")
    for name, value in (("probability", probability), ("threshold", threshold)):
        if not 0.0 < value < 1.0:
            raise InputError(f"{name} must lie between 0 and 1, got {value:g}. Correct it.")
    if not math.isfinite(detect) or detect == 0.0 or detect < -1.0:
        raise InputError(
            f"detect must be a relative change other than 0 and not below -1 (-100 %), got {detect:g}. For +20 % give 0.2."
        )


def _only(rows: pd.DataFrame) -> str | None:
    names = [name for name in rows.get("machine_id", []) if isinstance(name, str)]
    return names[0] if names else None


def _sensitivity(series: Series, change_scale: float, repeatability: float, probability: float) -> dict[str, float]:
    """Probability of a change under other assumptions."""
    found = {}
    for label, size, scatter, prior in (
        ("half the change_scale", 0.5 * change_scale, repeatability, probability),
        ("twice the change_scale", 2.0 * change_scale, repeatability, probability),
        ("half the repeatability", change_scale, 0.5 * repeatability, probability),
        ("twice the repeatability", change_scale, 2.0 * repeatability, probability),
        ("a prior probability of 0.1", change_scale, repeatability, 0.1),
        ("a prior probability of 0.9", change_scale, repeatability, 0.9),
    ):
        nodes, weight = scatter_rule(scatter)
        found[label] = 1.0 - float(weigh(steps_of(carry(series, nodes), size), weight, prior).none.sum())
    return found
