"""c_t = c + Δ e_j 1[t ≥ k] + w_t over one machine's campaigns: estimates in time, probability of a change, how soon it is found.

See `change` for the model. Truncation is left aside. Parameters not chosen are integrated out anew in each campaign, as ball form
and bar length are, though one machine and one bar keep theirs: that is conservative for changes, above all of geometric errors,
but not for levels, which one bar shifts alike in all campaigns.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from ldbb_bayes.errors import InputError
from ldbb_bayes.fleet.change import Series, carry, scatter_rule, steps_of, weigh
from ldbb_bayes.fleet.choosing import Wanted, labels
from ldbb_bayes.fleet.control import chart_of, instrument_moments, levels_of
from ldbb_bayes.fleet.detection import detection
from ldbb_bayes.fleet.series import doubts_of, order_of, rows_of
from ldbb_bayes.fleet.statistics import fleet_statistics
from ldbb_bayes.fleet.trend_rows import changes_of, estimates_of, most_probable
from ldbb_bayes.fleet.trend_words import verdict_of
from ldbb_bayes.fleet.trended import LIMITS, Trend
from ldbb_bayes.inference.summary import check_probability
from ldbb_bayes.threads import one_blas_thread

__all__ = ["trend"]

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
        Keep campaigns whose readings the model does not expect, see `Wanted`.
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
    chosen, notes = rows_of(rows, machine)
    choice = Wanted(exclude, since, include_misfits).choose(chosen, rows)
    statistics = fleet_statistics(
        choice.rows, parameters=parameters, reference_force_N=reference_force_N, one_instrument=one_instrument
    )
    if len(statistics) < 2:
        raise InputError(
            f"a trend must have at least 2 campaigns of one machine to rely on, got {len(statistics)}. "
            + " ".join(("Measure again.", *notes, *choice.notes))
        )
    order = order_of(statistics)
    series = Series.of(statistics, order)
    names = tuple(labels(choice.rows.iloc[order]))

    scatter, prior = scatter_rule(repeatability)
    carried = carry(series, scatter)
    steps = steps_of(carried, change_scale)
    weights = weigh(steps, prior, probability)
    moments = instrument_moments(steps, weights, series.parameters)
    chart = chart_of(series, carried, scatter, prior, moments, limits=LIMITS)
    levels = levels_of(series, scatter, weights, moments[0], change_scale, ci_prob=ci_prob)
    found = changes_of(statistics, steps, weights, chart, levels, ci_prob)
    total = 1.0 - float(weights.none.sum())
    n = len(series)
    by_time = np.concatenate([[0.0], weights.change.sum(axis=(0, 2))])
    likely = most_probable(statistics, steps, weights, chart, levels, ci_prob)
    seen = n - likely.place if total > threshold else n

    mean, sd = statistics.prior_mean, statistics.prior_sd
    now = mean + sd * levels.mean[-1]
    known = np.abs(now) > _TOLD * sd * np.hypot(levels.sd[-1], chart.common_sd)
    soon = detection(
        series.information.mean(axis=0),
        series.parameters,
        np.concatenate([levels.mean[-1], moments[0]]),
        np.where(known, detect * now / sd, np.nan),
        before=seen,
        scatter=(scatter, weights.scatter),
        change_scale=change_scale,
        repeatability=repeatability,
        probability=probability,
        threshold=threshold,
        seed=seed,
        progress=progress,
    )
    spread = weights.scatter / weights.scatter.sum()
    low, high = (
        float(scatter[min(int(np.searchsorted(np.cumsum(spread), end)), len(scatter) - 1)])
        for end in (0.5 - 0.5 * ci_prob, 0.5 + 0.5 * ci_prob)
    )
    result = Trend(
        machine=machine or _only(chosen),
        campaigns=names,
        dates=tuple(statistics.dates[i] for i in order),
        reference_force_N=statistics.reference_force_N,
        assumptions={
            "change_scale": change_scale,
            "repeatability": repeatability,
            "probability": probability,
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
        scatter=(float(spread @ scatter), low, high),
        estimates=estimates_of(statistics, names, order, chart, levels, weights, ci_prob),
        sensitivity=_sensitivity(series, change_scale, repeatability, probability),
        detection=soon,
        doubts=(*notes, *doubts_of(choice, statistics, one_bar=one_instrument)),
        verdict=(),
    )
    return replace(result, verdict=verdict_of(result))


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
