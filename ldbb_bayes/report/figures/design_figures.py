"""Figure of a design: the expected uncertainty of every parameter after each plan of tests."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ldbb_bayes.analysis.design import Design
from ldbb_bayes.report.figures import style
from ldbb_bayes.report.figures.style import ACCENT, GREY, LIGHT, styled
from ldbb_bayes.results import Array
from ldbb_bayes.units import display_name, display_unit, is_slope, round_uncertainty, without_slopes

__all__ = ["expected_widths"]

_COLUMNS = 3  # number of parameters in one row of the figure of expected uncertainties
# Length of the longest bar in the chart of expected uncertainties. The unit is the width of one
# column of the chart.
_LONGEST_BAR = 0.72


class _PlanBars(NamedTuple):
    """Bars of one plan of tests in the figure of expected uncertainties.

    ``sd`` is a mapping from the names of the parameters to their expected standard deviations, in
    internal units (mm, N, rad).
    """

    name: str
    sd: Mapping[str, float]
    colour: str


@styled
def expected_widths(design: Design, today: Mapping[str, float] = MappingProxyType({})) -> Figure:
    """Draw bars that show the expected standard uncertainties after several plans of tests.

    The plans are the recommended tests, other tests that were compared with the recommended tests,
    and very many repetitions of the recommended tests. The scale of the bars differs from parameter
    to parameter. Slopes (coefficients of the change of compliance with force) are left out, unless
    the design was made for slopes alone.

    Parameters
    ----------
    design : Design
        Design, as the function `design` returns it.
    today : mapping of str to float
        Present standard uncertainties in internal units (mm, N, rad). The keys are the names of the
        parameters. Default: no present uncertainties are drawn.

    Returns
    -------
    Figure
        A Matplotlib figure with a group of bars for each parameter.

    Examples
    --------
    >>> recommended = lb.design(lb.HybridModel.first(0), campaign, tests=3)
    >>> figure = lb.figures.expected_widths(recommended)
    >>> sorted({text.get_text() for text in figure.axes[0].texts} & {"3 recommended", "today"})
    ['3 recommended']
    """
    expected_by_name = _expected_in_figure(design)
    plans = _plans(design, today)
    step = len(plans) + 1.8
    number = len(expected_by_name)
    lines = math.ceil(number / _COLUMNS)
    figure = style.new_figure(style.WIDTH, 0.4 + 0.15 * step * lines)
    axes = figure.subplots()
    left = np.arange(number) % _COLUMNS
    top = -step * (np.arange(number) // _COLUMNS)
    sizes = _sizes(expected_by_name, plans)
    lengths = np.where(np.isfinite(sizes), sizes, 0.0)
    lengths *= _LONGEST_BAR / np.maximum(lengths.max(axis=0), np.finfo(float).tiny)
    for k, plan in enumerate(plans):
        height = top - 1.0 - k
        axes.barh(
            height,
            lengths[k],
            0.75,
            left,
            color=plan.colour,
            edgecolor=GREY,
            linewidth=0.6,
            label=plan.name,
        )
        _write_sizes(axes, left + lengths[k] + 0.02, height, sizes[k])
        for y in np.unique(height):
            axes.text(-0.03, y, plan.name, fontsize=7, ha="right", va="center")
    for k, (name, expected) in enumerate(expected_by_name.items()):
        label = f"{display_name(name)} ({display_unit(expected.unit)[1]})"
        if name not in design.parameters:
            label += ", not aimed at"
        axes.text(float(left[k]), float(top[k]), label, fontsize=7.5, va="center")
    limits = (top[-1] - len(plans) - 0.6, 0.7)
    axes.set(xlim=(0.0, _COLUMNS), ylim=limits, xticks=[], yticks=[])
    axes.set_axis_off()
    figure.suptitle("How narrow each interval gets: expected standard uncertainty u")
    return figure


def _plans(design: Design, today: Mapping[str, float]) -> list[_PlanBars]:
    """Return the groups of bars in the bar chart, one group for each plan of tests.

    ``today`` is a mapping from the names of the parameters to their present standard deviations.
    The first group shows the present standard deviations, unless ``today`` is empty. The last group
    shows the standard deviations after very many repetitions of the recommended tests.
    """
    plans = []
    if today:
        sd_today = {name: today.get(name, np.nan) for name in design.expected}
        plans.append(_PlanBars("today", sd_today, GREY))
    number = int(design.table["count"].sum())
    title = f"{number} more" if design.augment else f"{number} recommended"
    plans.append(_PlanBars(title, _expected_sd(design.expected), ACCENT))
    for judged in design.compared:
        plans.append(_PlanBars(judged.name, _expected_sd(judged.expected), LIGHT))
    floor = {name: expected.floor_sd for name, expected in design.expected.items()}
    plans.append(_PlanBars("ever more of these", floor, "white"))
    return plans


def _expected_sd(expected: Mapping[str, Any]) -> dict[str, float]:
    """Return the standard deviation that is expected for each parameter after planned tests."""
    return {name: entry.sd for name, entry in expected.items()}


def _expected_in_figure(design: Design) -> dict[str, Any]:
    """Return a dict with the expected uncertainty of every parameter that the figure shows.

    The keys are the names of the parameters. Slopes (coefficients of the change of compliance with
    force) are left out, unless the design was made for slopes alone.
    """
    aims = without_slopes(design.parameters)
    drawn = {}
    for name, expected in design.expected.items():
        if name in aims or not is_slope(name):
            drawn[name] = expected
    return drawn


def _sizes(expected_by_name: Mapping[str, Any], plans: list[_PlanBars]) -> Array:
    """Return the standard uncertainties expected after each plan of tests.

    The returned array has the shape (plans, parameters). The uncertainties are in the units that
    the figure shows, such as nm/N. ``expected_by_name`` has an entry for each parameter that is
    drawn. The key is the name of the parameter; the value holds the expected uncertainty and the
    parameter's internal unit.
    """
    factors = [display_unit(expected.unit)[0] for expected in expected_by_name.values()]
    rows = []
    for plan in plans:
        rows.append([plan.sd[name] for name in expected_by_name])
    return np.array(rows) * factors


def _write_sizes(axes: Axes, left: Array, height: Array, sizes: Array) -> None:
    """Write each standard uncertainty to the right of its bar.

    A dash is written for an uncertainty that is not finite. ``left`` and ``height`` are the
    positions of the texts. ``sizes`` are the standard uncertainties, in the units that the figure
    shows. All three arrays have the shape (parameters,).
    """
    for x, y, size in zip(left, height, sizes, strict=True):
        text = round_uncertainty(size)[0] if np.isfinite(size) else "–"
        axes.text(x, y, text, fontsize=7, va="center")
