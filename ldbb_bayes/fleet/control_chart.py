"""Control chart of one machine: a panel for each parameter, with the campaigns in order of time."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ldbb_bayes.fleet.control_limits import LIMITS
from ldbb_bayes.fleet.trend import Trend
from ldbb_bayes.report.figures.style import ACCENT, LIGHT, PALETTE, axis_label, band, panels, styled
from ldbb_bayes.report.wording import probability_words
from ldbb_bayes.results import Array
from ldbb_bayes.units import display_name, display_unit, round_uncertainty

__all__ = ["draw_control_chart"]

# The control chart shows a vertical line just before a campaign if the probability that the
# parameter changed there exceeds this value.
_VISIBLE_PROBABILITY = 0.05
# Largest number of campaigns whose dates label the horizontal axis of a control chart.
_LABELLED_CAMPAIGNS = 6
# Layout of a control chart. ``_COLUMNS`` is the largest number of panels side by side,
# ``_PANEL_HEIGHT`` is the height of a panel [inch], and ``_MARGIN`` is the height of the part of
# the figure without panels [inch].
_COLUMNS = 2
_PANEL_HEIGHT = 2.0
_MARGIN = 0.9


@styled
def draw_control_chart(trend: Trend) -> Figure:
    """Draw the control chart of a trend.

    The chart has a panel for each parameter. The panel shows the estimate of the parameter from
    each campaign alone, in order of time. It also shows the control limits of each estimate, which
    follow from the earlier campaigns. Vertical lines show between which campaigns the parameter may
    have changed.

    Parameters
    ----------
    trend : Trend
        Trend of one machine that `find_trend` returns.

    Returns
    -------
    Figure
        A Matplotlib figure with a panel for each parameter.

    Examples
    --------
    >>> figure = lb.fleet.draw_control_chart(lb.fleet.find_trend(rows))
    >>> len(figure.axes), figure.axes[0].get_ylabel()
    (6, 'C_XXX (nm/N)')
    """
    columns = min(len(trend.parameters), _COLUMNS)
    figure, all_axes = panels(len(trend.parameters), columns, _PANEL_HEIGHT, _MARGIN, sharex=True)
    # A panel without another beneath it has dates, and so has the one beside it.
    first_row_with_dates = (len(all_axes) - columns) // columns
    for k, (axes, name) in enumerate(zip(all_axes, trend.parameters, strict=True)):
        _draw_panel(axes, trend, name)
        if k // columns >= first_row_with_dates:
            _name_campaigns(axes, trend)
    handle_by_label: dict[str, Any] = {}
    for axes in all_axes:
        handles, labels = axes.get_legend_handles_labels()
        handle_by_label.update(zip(labels, handles, strict=True))
    figure.legend(
        list(handle_by_label.values()),
        list(handle_by_label),
        loc="outside lower center",
        ncols=2,
    )
    machine = trend.machine or "One machine"
    title = f"{machine}: probability of a change {probability_words(trend.probability)}"
    if trend.reference_force_N > 0.0:
        title += f", compliances at {trend.reference_force_N:.0f} N"
    figure.suptitle(title)
    return figure


class _PanelData(NamedTuple):
    """Values of one parameter for n campaigns, in the unit in which a control chart shows them."""

    place: Array  #: positions of n campaigns on the horizontal axis of a control chart, 1 to n
    #: estimate of a parameter from each of n campaigns alone, in the unit of the vertical axis of a
    #: control chart, shape (n,)
    estimate: Array
    #: lower and upper ends of the credible interval of a parameter from each of n campaigns alone,
    #: shape (2, n)
    interval: Array
    #: lower and upper control limits of the estimates of a parameter from n campaigns, shape (2,
    #: n); NaN at the first campaign
    limits: Array
    #: whether the estimate of a parameter from each of n campaigns is outside its control limits,
    #: shape (n,)
    is_outside: Array
    #: probability that a parameter of the machine changed just before each of n campaigns, shape
    #: (n,)
    change_probability: Array

    @property
    def edges(self) -> Array:
        """Positions on a diagram's horizontal axis that separate the n campaigns, shape (n + 1,).

        The diagram is a panel of a control chart, which shows the campaigns in order of time. The
        first and the last position are the ends of the axis. All other positions are midway between
        neighbouring campaigns.
        """
        return np.append(self.place - 0.5, self.place[-1] + 0.5)


def _panel_data(rows: pd.DataFrame, factor: float) -> _PanelData:
    """Return the values that one panel of a control chart shows for a parameter.

    ``rows`` are the rows of `Trend.estimates` for this parameter.

    ``factor`` converts values from the internal unit (mm, N, rad) to the unit of the panel's axis.
    """
    return _PanelData(
        place=np.arange(1.0, len(rows) + 1.0),
        estimate=rows["estimate"].to_numpy() * factor,
        interval=rows[["ci_low", "ci_high"]].to_numpy().T * factor,
        limits=rows[["limit_low", "limit_high"]].to_numpy().T * factor,
        is_outside=rows["outside"].to_numpy(),
        change_probability=rows["change_here"].to_numpy(),
    )


def _draw_panel(axes: Axes, trend: Trend, name: str) -> None:
    """Draw the panel of one parameter: its estimates, control limits and possible changes.

    ``axes`` is the panel of the control chart, ``trend`` the trend of the machine, and ``name`` the
    name of the parameter.
    """
    rows = trend.estimates[trend.estimates["parameter"] == name]
    factor, label = axis_label(name, str(rows["unit"].iloc[0]))
    data = _panel_data(rows, factor)
    _draw_limits(axes, data)
    inside_label = f"campaign by itself, {100 * trend.assumptions['ci']:g} %"
    _draw_points(axes, data, ~data.is_outside, ACCENT, "o", inside_label)
    _draw_points(axes, data, data.is_outside, PALETTE[1], "D", "outside its limits")
    axes.set_ylim(*_vertical_range(data))
    axes.set(ylabel=label, xlim=(0.5, len(rows) + 0.5))
    axes.set_title(_panel_title(trend, name, factor), fontsize=8)
    for edge, probability in zip(data.edges[1:-1], data.change_probability[1:], strict=True):
        if probability > _VISIBLE_PROBABILITY:
            axes.axvline(
                edge,
                color="black",
                linestyle="--",
                alpha=min(float(probability), 1.0),
                label="a change here, as dark as probable",
            )


def _draw_limits(axes: Axes, data: _PanelData) -> None:
    """Shade the range between the control limits in a panel of a control chart.

    The first campaign has no control limits, because the limits follow from earlier campaigns.
    ``axes`` is the panel, and ``data`` holds the values of its parameter.
    """
    steps = [np.append(limit, limit[-1]) for limit in data.limits]
    label = f"limits from those before, {100 * LIMITS:g} %"
    band(axes, data.edges, steps, LIGHT, 0.6, step="post", label=label)


def _draw_points(
    axes: Axes, data: _PanelData, chosen: Array, colour: str, marker: str, label: str
) -> None:
    """Draw a parameter's estimates from some campaigns, with their credible intervals as bars.

    The estimates are drawn into ``axes``, a panel of a control chart. ``chosen`` is a mask of the n
    campaigns, shape (n,), that is true for the estimates to draw. ``data`` holds the values of all
    campaigns. ``colour`` is the colour of the points, ``marker`` their shape, and ``label`` their
    text in the legend.
    """
    if chosen.any():
        error = np.abs(data.interval - data.estimate)
        axes.errorbar(
            data.place[chosen],
            data.estimate[chosen],
            error[:, chosen],
            fmt=marker,
            color=colour,
            markersize=3.0,
            label=label,
        )


def _vertical_range(data: _PanelData) -> tuple[float, float]:
    """Return the lower and upper end of the vertical axis in one panel of a control chart.

    The axis covers the range of all credible intervals of the panel, with a small margin. Control
    limits outside this range extend the axis on each side, by at most half of the range. The range
    is zero if all credible intervals consist of the same single value v. It is then replaced with
    |v|, or with 1 if v is zero.
    """
    low = float(data.interval[0].min())
    high = float(data.interval[1].max())
    interval_range = high - low
    if interval_range == 0.0:
        interval_range = abs(high) or 1.0
    lowest_limit = float(np.nanmin(data.limits[0]))
    highest_limit = float(np.nanmax(data.limits[1]))
    half_range = 0.5 * interval_range
    margin = 0.05 * interval_range
    bottom = max(min(lowest_limit, low), low - half_range) - margin
    top = min(max(highest_limit, high), high + half_range) + margin
    return bottom, top


def _panel_title(trend: Trend, name: str, factor: float) -> str:
    """Return the title of the panel of a control chart that shows one parameter.

    The title states the probability that the parameter ``name`` of the machine has changed.

    Errors of the instrument may shift the estimates from all campaigns together. In this case, a
    second line states the uncertainty due to these errors. ``factor`` converts values from the
    internal unit of the parameter to the unit shown.
    """
    parameter = trend.parameters[name]
    probability = probability_words(parameter.probability)
    title = f"{display_name(name)}: probability of a change {probability}"
    common_sd = parameter.common_sd * factor
    if common_sd:
        _, unit = display_unit(parameter.unit)
        title += f"\nu common to all {round_uncertainty(common_sd)[0]} {unit}"
    return title


def _name_campaigns(axes: Axes, trend: Trend) -> None:
    """Label the horizontal axis of a control chart with the dates of the campaigns.

    If the campaigns have no dates, they are numbered in the given order.
    """
    axes.tick_params(labelbottom=True)
    count = len(trend.campaigns)
    if trend.campaigns[0].date is None:
        axes.set_xlabel("campaign (in the order given)")
        axes.xaxis.set_major_locator(MaxNLocator(8, integer=True))
        return
    labelled = np.linspace(0, count - 1, min(count, _LABELLED_CAMPAIGNS))
    places = np.unique(labelled.round().astype(int))
    axes.set_xticks(
        places + 1,
        [f"{trend.campaigns[place].date:%Y-%m-%d}" for place in places],
        rotation=30,
        ha="right",
        rotation_mode="anchor",
    )
    axes.set_xlabel("campaign (by date, evenly spaced)")
