"""Figures of the machine's tool path.

The figures show circular-test quantities, and the contributions of compliances and geometric errors
to the tool path.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ldbb_bayes.analysis import circularity as path_analysis
from ldbb_bayes.analysis import path_contributions
from ldbb_bayes.analysis.circle_columns import first_circle
from ldbb_bayes.analysis.extremes import extremes_of
from ldbb_bayes.analysis.measured_paths import FULL_CIRCLE_DEG, measure_circularity
from ldbb_bayes.campaign.campaign import distinct_forces
from ldbb_bayes.inference.posterior import bound_of
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.report.figures import style
from ldbb_bayes.report.figures.style import ACCENT, PALETTE, band, panels, styled
from ldbb_bayes.report.stated_circle import tests_of_stated_circle
from ldbb_bayes.results import Array
from ldbb_bayes.units import display_name, is_compliance_or_slope, round_like, round_uncertainty

__all__ = ["circularity", "contributions", "parameter_contributions"]

_DRAWS = 500
# Number of points (forces) on a curve of a circular-test quantity against force.
_FORCES = 13
# Largest number of forces in the figure of contributions to the tool path. Each force has a panel.
_MOST_FORCES = 6
_EXPLANATION = "Line: mean, band: 95 %\nAbove: peak to peak {}, median and 95 % interval"


class _Panel(NamedTuple):
    """The quantities that one panel of a figure shows, and the label of its vertical axis."""

    quantities: tuple[str, ...]
    label: str


_PANELS = (
    _Panel(("G",), "G (µm)"),
    _Panel(("F_max", "F_min"), "F_max, F_min (µm)"),
    _Panel(("squareness",), "squareness (µm/m)"),
    _Panel(("scale_mismatch",), "scale mismatch (µm/m)"),
)


class _Look(NamedTuple):
    """Colour and Matplotlib line style of a curve that shows a contribution to the tool path."""

    colour: str
    linestyle: str


_SOURCES = {
    path_contributions.TOGETHER: _Look("black", "-"),
    path_contributions.COMPLIANCE: _Look(PALETTE[0], "--"),
    path_contributions.GEOMETRY: _Look(PALETTE[1], ":"),
}


@styled
def circularity(posterior: xr.DataTree) -> Figure:
    """Draw circular-test quantities of the machine's tool path against force, with 95 % bands.

    The quantities are the circular deviations G, F_max and F_min, squareness and scale mismatch.
    Crosses show values that are computed from the readings alone; these values include the effects
    of balls and bar.

    Parameters
    ----------
    posterior : DataTree
        Posterior from `sample` or `load`.

    Returns
    -------
    Figure
        A Matplotlib figure with four panels for each plane.

    Examples
    --------
    >>> figure = lb.figures.circularity(posterior)
    >>> [axes.get_ylabel() for axes in figure.axes]
    ['G (µm)', 'F_max, F_min (µm)', 'squareness (µm/m)', 'scale mismatch (µm/m)']
    """
    bound = bound_of(posterior)
    highest_N = float(bound.setting.force_N.max())
    forces_N = np.linspace(0.0, highest_N, _FORCES).tolist()
    table = path_analysis.predict_circularity(posterior, forces_N, draws=_DRAWS)
    measured, _ = measure_circularity(posterior)
    planes = bound.setting.tested_planes
    figure, all_axes = panels(len(_PANELS) * len(planes), 2, 1.8, 0.3)
    for k, axes in enumerate(all_axes):
        panel = _PANELS[k % len(_PANELS)]
        plane = planes[k // len(_PANELS)]
        rows = table[table["plane"] == plane]
        # Show only the readings of whole circles that are the circle for which the curves of
        # circular-test quantities are drawn: the tool path depends on radius and centre, and an arc
        # shows a part of the path alone.
        stated = measured.loc[tests_of_stated_circle(bound.campaign, plane)]
        readings = stated[stated["arc_deg"] >= FULL_CIRCLE_DEG]
        _draw_quantities(axes, panel.quantities, rows, readings)
        limits = (-0.02 * highest_N, 1.02 * highest_N)
        axes.set(xlabel="force (N)", ylabel=panel.label, xlim=limits)
        if len(planes) > 1:
            axes.set_title(f"Plane {plane}")
    figure.suptitle(
        "The machine's path: median and 95 % band; crosses: the readings, balls and bar included"
    )
    return figure


def _draw_quantities(
    axes: Axes, quantities: Sequence[str], table: pd.DataFrame, readings: pd.DataFrame
) -> None:
    """Draw one or two circular-test quantities against force in one panel.

    ``quantities`` are the names of the quantities. ``table`` holds the median and the 95 % interval
    of each quantity at each force. ``readings`` holds the values computed from the readings of each
    test, which are drawn as crosses.
    """
    for name, colour in zip(quantities, PALETTE, strict=False):
        rows = table[table["quantity"] == name]
        band(axes, rows["force_N"], (rows["ci_low"], rows["ci_high"]), colour)
        axes.plot(rows["force_N"], rows["median"], color=colour)
        measured = readings[name].astype(float)
        axes.plot(readings["force_N"], measured, "x", color=colour, markersize=4)


@styled
def contributions(posterior: xr.DataTree) -> Figure:
    """Draw the contributions of compliances and geometric errors to the tool path.

    The figure has panels for up to six forces. Each panel shows the contribution of all
    compliances, the contribution of all geometric errors, and the sum of both. Each curve has a 95
    % band, and the title of each panel states the peak-to-peak value of the sum. Offsets of the
    tool ball are left out. The figure corresponds to Fig. 8 of the article on which the model is
    based.

    Parameters
    ----------
    posterior : DataTree
        Posterior from `sample` or `load`.

    Returns
    -------
    Figure
        A Matplotlib figure with a panel for each plane and force.

    Examples
    --------
    >>> figure = lb.figures.contributions(posterior)
    >>> [axes.get_title().split(":")[0] for axes in figure.axes]
    ['36 N', '238 N', '364 N', '490 N', '616 N', '742 N']
    """
    bound = bound_of(posterior)
    forces_N = distinct_forces(bound.setting.force_N)
    chosen = np.unique(np.linspace(0, len(forces_N) - 1, _MOST_FORCES).round().astype(int))
    planes = bound.setting.tested_planes
    figure, all_axes = panels(len(planes) * len(chosen), 3, 1.5, 0.6, sharey=True)
    for k, axes in enumerate(all_axes):
        plane = planes[k // len(chosen)]
        force_N = float(forces_N[chosen[k % len(chosen)]])
        paths = _paths(posterior, bound, plane, force_N, list(_SOURCES))
        for source, look in _SOURCES.items():
            if source in paths:
                _draw_path(axes, paths[source], look.colour, linestyle=look.linestyle, label=source)
        title = f"{force_N:g} N: {_peak_to_peak_words(paths[path_contributions.TOGETHER])}"
        if len(planes) > 1:
            title = f"{plane}, {title}"
        axes.set_title(title, fontsize=8)
    _label_outer_axes(all_axes, 3)
    style.legend_below(figure, all_axes[0])
    figure.suptitle(_EXPLANATION.format("of both together"))
    return figure


@styled
def parameter_contributions(posterior: xr.DataTree) -> Figure:
    """Draw the contribution of every parameter to the tool path at the highest force.

    Each compliance (including its change with force) and each geometric error has a panel. The
    curve in a panel has a 95 % band, and the title states the peak-to-peak value. The figure
    corresponds to Figs. 9 and 10 of the article on which the model is based.

    Parameters
    ----------
    posterior : DataTree
        Posterior from `sample` or `load`.

    Returns
    -------
    Figure
        A Matplotlib figure with a panel for each plane and parameter.

    Examples
    --------
    >>> figure = lb.figures.parameter_contributions(posterior)
    >>> [axes.get_title().split()[0] for axes in figure.axes][:6]
    ['C_XXX', 'C_XYX', 'C_YYY', 'C_CXY', 'C_CYY', 'C_CCY']
    """
    bound = bound_of(posterior)
    force_N = float(bound.setting.force_N.max())
    planes = bound.setting.tested_planes
    paths_by_plane = {}
    for plane in planes:
        paths_by_plane[plane] = _paths(posterior, bound, plane, force_N, bound.names)
    number = sum(len(paths) for paths in paths_by_plane.values())
    figure, all_axes = panels(number, 4, 1.25, 0.5)
    panel = iter(all_axes)
    for plane, paths in paths_by_plane.items():
        for name, path in paths.items():
            axes = next(panel)
            _draw_path(axes, path, ACCENT if is_compliance_or_slope(name) else PALETTE[1])
            label = display_name(name)
            if len(planes) > 1:
                label += f", {plane}"
            axes.set_title(f"{label}\n{_peak_to_peak_words(path)}", fontsize=8)
    _label_outer_axes(all_axes, 4)
    figure.suptitle(f"At {force_N:g} N. {_EXPLANATION.format('of each alone')}")
    return figure


def _paths(
    posterior: xr.DataTree, bound: BoundModel, plane: str, force_N: float, sources: Sequence[str]
) -> Mapping[str, Array]:
    """Return a mapping with the contributions of several sources to a circular tool path [µm].

    The circle is the first circle in the plane ``plane``, run with the force ``force_N`` [N].
    ``sources`` are names of parameters or of groups of parameters; they are the keys of the
    mapping. Each value is an array of the shape (draws, 360). It has one row for each random draw
    from the posterior, and one column for each of the angles 0° … 359°. The random draws are those
    that `decompose_deviation` uses. ``bound`` is the model applied to the campaign.
    """
    circle = first_circle(bound, plane)
    return path_contributions.contribution_paths(posterior, circle, force_N, tuple(sources))


def _peak_to_peak_words(path: Array) -> str:
    """Return a string with the peak-to-peak value of tool paths, such as "17.2 [11.5, 39.8] µm".

    ``path``, shape (draws, angles), holds one tool path [µm] for each random draw from the
    posterior. The string states the median and the 95 % interval over the draws.
    """
    low, median, high = np.quantile(extremes_of(path).width, [0.025, 0.5, 0.975])
    _, decimals = round_uncertainty((high - low) / 4.0)
    interval = f"[{round_like(low, decimals)}, {round_like(high, decimals)}]"
    return f"{round_like(median, decimals)} {interval} µm"


def _draw_path(axes: Axes, path: Array, colour: Any, **look: Any) -> None:
    """Draw the mean and the 95 % band of a contribution to the tool path against the angle.

    ``path``, shape (draws, 360), holds the contribution [µm] for each random draw from the
    posterior, at the angles 0° … 359°. The band is computed from every fifth draw. ``look`` holds
    properties of the line, such as its label.
    """
    closed = np.append(path, path[:, :1], axis=1)
    limits = np.quantile(closed[::5, ::3], [0.025, 0.975], axis=0)
    band(axes, np.arange(0, 361, 3), limits, colour)
    axes.plot(np.arange(0, 361, 2), closed[:, ::2].mean(axis=0), color=colour, **look)


def _label_outer_axes(all_axes: Sequence[Axes], columns: int) -> None:
    """Label the horizontal axes of the lowest panels and the vertical axes of the leftmost panels.

    The horizontal axes show angles, and the vertical axes show readings. ``all_axes`` are the
    panels row by row; each row has ``columns`` panels.
    """
    last_row = (len(all_axes) - 1) // columns
    for k, axes in enumerate(all_axes):
        axes.set(xlim=(0.0, 360.0), xticks=(0, 180, 360))
        if k % columns == 0:
            axes.set_ylabel("reading (µm)")
        axes.tick_params(labelbottom=k + columns >= len(all_axes))
        if k // columns == last_row:
            axes.set_xlabel("angle (°)")
