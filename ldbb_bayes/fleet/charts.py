"""The control chart of one machine, with the times of a change."""

from __future__ import annotations

from typing import Any

import matplotlib.dates as mdates
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from ldbb_bayes.fleet.trend import LIMITS, Trend
from ldbb_bayes.report.figures.style import ACCENT, GREY, PALETTE, axis_label, new_figure, styled
from ldbb_bayes.report.wording import probability_words
from ldbb_bayes.units import display_name, display_unit, round_uncertainty

__all__ = ["control_chart"]

Array = NDArray[Any]
_SHARES = (4.0, 1.0)


@styled
def control_chart(trend: Trend) -> Figure:
    """A panel for each parameter: every campaign by itself, the limits from those before it, the level, P(change) by time.

    Parameters
    ----------
    trend : Trend
    """
    names = list(trend.parameters)
    columns = 1 if len(names) == 1 else 2
    rows = -(-len(names) // columns)
    figure = new_figure(5.4 * columns if columns > 1 else 8.0, 0.9 + 2.9 * rows)
    grid = figure.subplots(2 * rows, columns, sharex=True, squeeze=False, height_ratios=_SHARES * rows)
    places, width = _places(trend)
    for k, name in enumerate(names):
        row, column = divmod(k, columns)
        own = trend.estimates[trend.estimates["parameter"] == name]
        _panel(grid[2 * row, column], trend, name, own, places)
        _strip(grid[2 * row + 1, column], own, places, width)
        last = k + columns >= len(names)
        grid[2 * row + 1, column].tick_params(labelbottom=last)
        if last:
            _label_time(grid[2 * row + 1, column], trend, places)
    for axes in grid.ravel():
        axes.set_visible(axes.has_data())
    found = {label: handle for axes in grid.ravel() for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)}
    figure.legend(list(found.values()), list(found), loc="outside lower center", ncols=4)
    whose = trend.machine or "One machine"
    figure.suptitle(
        f"{whose}: probability of a change {probability_words(trend.probability)}"
        f"{'' if trend.reference_force_N <= 0.0 else f', compliances at {trend.reference_force_N:.0f} N'}",
        fontsize=10.5,
    )
    return figure


def _places(trend: Trend) -> tuple[Array, float]:
    """Where campaigns stand on the axis, those of one moment side by side, and how wide a bar is."""
    if trend.campaigns[0].date is None:
        return np.arange(1.0, len(trend.campaigns) + 1.0), 0.7
    when = np.array([float(mdates.date2num(date)) for date in (own.date for own in trend.campaigns)])  # type: ignore[no-untyped-call]
    span = float(np.ptp(when)) or 1.0
    gap = 0.008 * span
    for t in range(1, len(when)):
        when[t] = max(when[t], when[t - 1] + gap)
    return when, 0.7 * float(np.median(np.diff(when)))


def _panel(axes: Axes, trend: Trend, name: str, own: pd.DataFrame, places: Array) -> None:
    factor, label = axis_label(name, str(own["unit"].iloc[0]))
    value = {column: own[column].to_numpy() * factor for column in own.columns if own[column].dtype == float}
    limits, low, high = (value["limit_low"], value["limit_high"]), float(value["ci_low"].min()), float(value["ci_high"].max())
    said = f"limits from the campaigns before ({100 * LIMITS:g} %)"
    axes.fill_between(places, *limits, step="mid", color="#E8E8E8", linewidth=0.0, label=said)
    out = own["outside"].to_numpy()
    alone = f"campaign by itself, {100 * trend.assumptions['ci']:g} %"
    for chosen, colour, meant in ((~out, ACCENT, alone), (out, PALETTE[1], "outside its limits")):
        if chosen.any():
            ends = np.abs(np.array([value["ci_low"], value["ci_high"]]) - value["estimate"])[:, chosen]
            axes.errorbar(places[chosen], value["estimate"][chosen], ends, fmt="o", color=colour, markersize=3.0, label=meant)
    # Limits as far as they are of the points' size.
    room, margin = 0.5 * (high - low), 0.05 * (high - low)
    least, most = float(np.nanmin(limits[0])), float(np.nanmax(limits[1]))
    axes.set_ylim(max(min(least, low), low - room) - margin, min(max(most, high), high + room) + margin)
    axes.set_ylabel(label)
    axes.yaxis.set_major_locator(MaxNLocator(5))
    common = trend.parameters[name].common_sd * factor
    shared = f"; u common to all {round_uncertainty(common)[0]} {display_unit(trend.parameters[name].unit)[1]}" if common else ""
    axes.set_title(f"{display_name(name)}: P(changed) {probability_words(trend.parameters[name].probability)}{shared}")
    axes.tick_params(labelbottom=False)


def _strip(axes: Axes, own: pd.DataFrame, places: Array, width: float) -> None:
    axes.bar(places, own["change_here"], width=width, color=GREY)
    axes.set_ylim(0.0, 1.05)
    axes.set_yticks([0.0, 1.0])
    axes.set_ylabel("P(change\nhere)", fontsize=7.5)
    axes.grid(visible=False, axis="x")


def _label_time(axes: Axes, trend: Trend, places: Array) -> None:
    if trend.campaigns[0].date is None:
        axes.set_xlabel("campaign (in the order given)")
        axes.xaxis.set_major_locator(MaxNLocator(8, integer=True))
        return
    locator = mdates.AutoDateLocator(minticks=3, maxticks=6)  # type: ignore[no-untyped-call]
    axes.xaxis.set_major_locator(locator)
    axes.xaxis.set_major_formatter(mdates.ConciseDateFormatter(locator))  # type: ignore[no-untyped-call]
    axes.set_xlabel("date of the campaign")
