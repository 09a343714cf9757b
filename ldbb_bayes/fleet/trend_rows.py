"""What a series says of each parameter's step and of every campaign, carried back from prior sds to inside units."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import ndtri

from ldbb_bayes.fleet.change import Steps, Weights, mixture_quantile
from ldbb_bayes.fleet.control import Chart, Levels
from ldbb_bayes.fleet.statistics import FleetStatistics
from ldbb_bayes.fleet.trended import MostProbable, ParameterChange

__all__ = ["changes_of", "estimates_of", "most_probable"]

Array = NDArray[Any]

# Standard uncertainties that a level must be away from zero before a change is told in per cent of it: its own uncertainty, left
# aside in them, is then at most a fifth.
_KNOWN = 5.0


def changes_of(
    statistics: FleetStatistics, steps: Steps, weights: Weights, chart: Chart, levels: Levels, ci_prob: float
) -> dict[str, ParameterChange]:
    """Size of each parameter's step, given that it is the one, whenever it was."""
    return {
        name: _change(statistics, steps, weights.change[:, :, j], j, chart, levels, ci_prob)
        for j, name in enumerate(statistics.parameters)
    }


def most_probable(
    statistics: FleetStatistics, steps: Steps, weights: Weights, chart: Chart, levels: Levels, ci_prob: float
) -> MostProbable:
    """The parameter that most probably changed, and when it most probably did, given that it is this one."""
    here = weights.change.sum(axis=0)
    j = int(np.argmax(here.sum(axis=0)))
    k = int(np.argmax(here[:, j]))
    share = np.zeros_like(weights.change[:, :, j])
    share[:, k] = weights.change[:, k, j]
    own = _change(statistics, steps, share, j, chart, levels, ci_prob)
    return MostProbable(statistics.parameters[j], k + 1, own)


def _change(
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
    low, high = (float(mixture_quantile(share[seen, None], size[seen, None], spread[seen, None], end)[0]) for end in ends)
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


def estimates_of(
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
