"""Split from its neighbours; see there."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ldbb_bayes.fleet.control_limits import LIMITS
from ldbb_bayes.fleet.trend import Trend
from ldbb_bayes.report.figures.style import ACCENT, LIGHT, PALETTE, axis_label, band, panels, styled
from ldbb_bayes.report.wording import probability_words
from ldbb_bayes.units import (
    display_name,
    display_unit,
    round_uncertainty,
)

__all__ = ["control_chart"]


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
