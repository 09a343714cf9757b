"""The control chart of one machine, with the times of a change."""

from __future__ import annotations

import matplotlib.dates as mdates
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ldbb_bayes.fleet.trend import LIMITS, Trend
from ldbb_bayes.report.figures.style import ACCENT, PALETTE, axis_label, panels, styled
from ldbb_bayes.report.wording import probability_words
from ldbb_bayes.result import Array
from ldbb_bayes.units import display_name, display_unit, round_uncertainty

__all__ = ["control_chart"]

_VISIBLE = 0.05


@styled
def control_chart(trend: Trend) -> Figure:
    """A panel for each parameter: every campaign by itself, the limits from those before it, and when it may have changed.

    Parameters
    ----------
    trend : Trend
    """
    columns, places = min(len(trend.parameters), 2), _places(trend)
    figure, every = panels(len(trend.parameters), columns, 5.4 * columns if columns > 1 else 8.0, 2.9, 0.9, sharex=True)
    for k, (axes, name) in enumerate(zip(every, trend.parameters, strict=True)):
        _panel(axes, trend, name, trend.estimates[trend.estimates["parameter"] == name], places)
        if k + columns >= len(every):
            _label_time(axes, trend)
    found = {label: handle for axes in every for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)}
    figure.legend(list(found.values()), list(found), loc="outside lower center", ncols=4)
    whose = trend.machine or "One machine"
    figure.suptitle(
        f"{whose}: probability of a change {probability_words(trend.probability)}"
        f"{'' if trend.reference_force_N <= 0.0 else f', compliances at {trend.reference_force_N:.0f} N'}",
        fontsize=10.5,
    )
    return figure


def _places(trend: Trend) -> Array:
    """Where campaigns stand on the axis, those of one moment side by side."""
    if trend.campaigns[0].date is None:
        return np.arange(1.0, len(trend.campaigns) + 1.0)
    when = np.array([float(mdates.date2num(date)) for date in (own.date for own in trend.campaigns)])  # type: ignore[no-untyped-call]
    gap = 0.008 * (float(np.ptp(when)) or 1.0)
    for t in range(1, len(when)):
        when[t] = max(when[t], when[t - 1] + gap)
    return when


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
    for when, here in zip(0.5 * (places[1:] + places[:-1]), own["change_here"].to_numpy()[1:], strict=True):
        if here > _VISIBLE:
            axes.axvline(
                when, color="black", linestyle="--", alpha=min(float(here), 1.0), label="a change here, as dark as probable"
            )


def _label_time(axes: Axes, trend: Trend) -> None:
    axes.tick_params(labelbottom=True)
    if trend.campaigns[0].date is None:
        axes.set_xlabel("campaign (in the order given)")
        axes.xaxis.set_major_locator(MaxNLocator(8, integer=True))
        return
    locator = mdates.AutoDateLocator(minticks=3, maxticks=6)  # type: ignore[no-untyped-call]
    axes.xaxis.set_major_locator(locator)
    axes.xaxis.set_major_formatter(mdates.ConciseDateFormatter(locator))  # type: ignore[no-untyped-call]
    axes.set_xlabel("date of the campaign")
