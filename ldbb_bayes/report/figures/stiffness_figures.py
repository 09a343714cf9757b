"""Polar plot of the compliance along the bar in every direction of a plane (stiffness rose)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ldbb_bayes.analysis.directional_stiffness import PlaneStiffness, stiffness
from ldbb_bayes.inference.posterior import bound_of
from ldbb_bayes.report.figures import style
from ldbb_bayes.report.figures.parameter_figures import WORDS
from ldbb_bayes.report.figures.style import (
    GREY,
    PALETTE,
    WIDTH,
    band,
    new_figure,
    panels,
    styled,
)
from ldbb_bayes.results import Array
from ldbb_bayes.units import display_unit

__all__ = ["stiffness_rose"]

# The rim of a polar panel represents at most this value times the largest compliance on a curve. A
# band that extends beyond the rim is cut off. Otherwise, the wide band of a poorly determined
# compliance would make the curves too small.
_FARTHEST = 1.6
# Angle at which the labels of the grid circles (rings) of a polar panel are written [°]. Few lines
# cross at this angle.
_LABEL_ANGLE_DEG = 67.5
# Background of the label of a grid circle (ring) in a polar panel. It hides curves that would make
# the label hard to read.
_LABEL_GROUND = {"facecolor": "white", "alpha": 0.85, "edgecolor": "none", "pad": 0.6}
# ``_HEIGHT`` is the height of a figure with one polar panel [inch]. ``_ROW_HEIGHTS`` has the height
# of a row of two or three polar panels [inch]; the keys are the numbers of panels.
_HEIGHT = 3.0
_ROW_HEIGHTS = {2: 3.2, 3: 2.5}
# Width and height of a compact figure of the compliance by direction in one plane [inch]. A sheet
# of the test certificate shows this figure beside another figure.
_COMPACT_SIZE = (3.4, 3.7)
# Relative widths of two panels that show the compliance by direction: the polar plot, and to the
# right of it the same curves against the angle.
_WIDTHS = (1.0, 1.7)
_RINGS = 4  # largest number of grid circles in a polar panel
_TICKS_DEG = np.arange(0, 361, 45)
# Font sizes of the labels of directions, and of the labels of grid circles (rings), in a polar
# panel [points].
_DIRECTION_SIZE = 8
_RING_SIZE = 7


@styled
def stiffness_rose(
    posterior: xr.DataTree, words: Mapping[str, str] = WORDS, *, compact: bool = False
) -> Figure:
    """Draw the compliance along the bar in every direction of each plane, as a polar curve.

    There is one curve for the smallest and one for the largest force tested, each with a 95 % band.
    A direction is soft where a curve is far from the centre. A dashed line shows the softest
    direction at the largest force, if the readings determine this direction. If only one plane was
    tested, a second panel shows the same curves against the angle, with the softest direction ± U.

    Parameters
    ----------
    posterior : DataTree
        Posterior from `sample`, `load` or `average`.
    words : mapping of str to str
        Texts of the figure; the keys are the names of the texts. Default: English texts.
    compact : bool
        Whether the figure of a single plane is narrow and has only the polar panel.

    Returns
    -------
    Figure
        A Matplotlib figure with a polar panel for each plane, and for a single plane also with a
        panel of the curves against the angle.

    Examples
    --------
    >>> figure = lb.figures.stiffness_rose(posterior)
    >>> [axes.name for axes in figure.axes]
    ['polar', 'rectilinear']
    """
    bound = bound_of(posterior)
    tested_N = bound.setting.force_N
    forces_N = sorted({float(tested_N.min()), float(tested_N.max())})
    result = stiffness(posterior, forces_N)
    planes = bound.setting.tested_planes
    _, unit = display_unit("mm/N")
    title = words["rose"].format(unit=unit)
    if len(planes) == 1 and compact:
        return _rose_alone(result.planes, words, title)
    if len(planes) == 1:
        return _rose_with_curves(result.planes, words)
    height = _ROW_HEIGHTS[len(planes)]
    figure, all_axes = panels(len(planes), 3, height, 0.3, subplot_kw={"projection": "polar"})
    for axes, plane in zip(all_axes, planes, strict=True):
        roses = [rose for rose in result.planes if rose.plane == plane]
        _draw_rose(axes, roses, words)
        axes.set_title(f"{words['plane']} {plane}", fontsize=9)
    style.legend_below(figure, all_axes[0], columns=2)
    figure.suptitle(title)
    return figure


def _rose_alone(roses: Sequence[PlaneStiffness], words: Mapping[str, str], title: str) -> Figure:
    """Return a narrow figure, with one polar panel, of the compliance by direction in a plane.

    ``roses`` holds the stiffness by direction in the plane at each force; the largest force is
    last. ``words`` holds the texts of the figure. ``title`` is broken into several lines.
    """
    figure = new_figure(*_COMPACT_SIZE)
    axes = figure.add_subplot(projection="polar")
    _draw_rose(axes, roses, words)
    style.legend_below(figure, axes, columns=1)
    figure.suptitle(title.replace("; ", "\n"))
    return figure


def _rose_with_curves(roses: Sequence[PlaneStiffness], words: Mapping[str, str]) -> Figure:
    """Return a figure, with two panels, of the compliance by direction in one plane.

    The left panel shows the compliance along the bar as polar curves; the right panel shows the
    same curves against the angle. ``roses`` holds the stiffness by direction in the plane at each
    force; the largest force is last. ``words`` holds the texts of the figure.
    """
    figure = new_figure(WIDTH, _HEIGHT)
    grid = figure.add_gridspec(1, 2, width_ratios=_WIDTHS)
    rose_axes = figure.add_subplot(grid[0], projection="polar")
    curve_axes = figure.add_subplot(grid[1])
    _draw_rose(rose_axes, roses, words)
    _draw_curves(curve_axes, roses, words)
    style.legend_below(figure, rose_axes, columns=3)
    return figure


def _draw_rose(
    axes: Any,
    roses: Sequence[PlaneStiffness],
    words: Mapping[str, str],
) -> None:
    """Draw the compliance along the bar in one plane as polar curves, one curve for each force.

    ``roses`` holds the stiffness by direction in the plane at each force; the largest force is
    last.
    """
    last = roses[-1]
    factor, _ = display_unit("mm/N")
    limit = _farthest_ring(roses) * factor
    for rose, colour in _coloured(roses):
        angle_rad = np.deg2rad(_closed(rose.angle_deg, 360.0))
        low = np.maximum(_closed(rose.compliance_low) * factor, 0.0)
        high = np.minimum(_closed(rose.compliance_high) * factor, limit)
        band(axes, angle_rad, (low, high), colour)
        label = words["rose_line"].format(force=f"{rose.force_N:.4g}")
        axes.plot(angle_rad, _closed(rose.compliance) * factor, color=colour, label=label)
    if last.softest.is_determined:
        direction_rad = np.deg2rad([last.softest.angle_deg, last.softest.angle_deg + 180.0])
        label = words["softest"].format(force=f"{last.force_N:.4g}")
        axes.plot(direction_rad, [limit, limit], "--", color=GREY, linewidth=1.0, label=label)
    axes.set_ylim(0.0, limit)
    names = [f"{angle}°" for angle in range(0, 360, 45)]
    names[0] += f" {last.plane[0]}"
    names[2] += f" {last.plane[1]}"
    axes.set_xticks(np.deg2rad(np.arange(0, 360, 45)), names)
    axes.tick_params(axis="x", labelsize=_DIRECTION_SIZE, pad=0)
    _label_rings(axes, limit)


def _label_rings(axes: Any, limit: float) -> None:
    """Draw the rings of a polar panel, and write the value of each ring on top of the curves.

    ``limit`` is the compliance at the rim of the panel, in the unit that the figure shows.
    """
    rings = [ring for ring in MaxNLocator(_RINGS).tick_values(0.0, limit) if 0.0 < ring < limit]
    axes.set_yticks(rings, [""] * len(rings))
    for ring in rings:
        axes.text(
            np.deg2rad(_LABEL_ANGLE_DEG),
            ring,
            f"{ring:g}",
            fontsize=_RING_SIZE,
            ha="center",
            va="center",
            zorder=5,
            bbox=_LABEL_GROUND,
        )


def _draw_curves(
    axes: Any,
    roses: Sequence[PlaneStiffness],
    words: Mapping[str, str],
) -> None:
    """Draw the compliance along the bar against the angle, and the softest direction ± U.

    ``roses`` holds the stiffness by direction in the plane at each force; the largest force is
    last.
    """
    last = roses[-1]
    factor, unit = display_unit("mm/N")
    limit = _farthest_ring(roses) * factor
    for rose, colour in _coloured(roses):
        angle_deg = _closed(rose.angle_deg, 360.0)
        low = np.maximum(_closed(rose.compliance_low) * factor, 0.0)
        high = np.minimum(_closed(rose.compliance_high) * factor, limit)
        band(axes, angle_deg, (low, high), colour)
        axes.plot(angle_deg, _closed(rose.compliance) * factor, color=colour)
    if last.softest.is_determined:
        for turn_deg in (-180.0, 0.0, 180.0, 360.0):
            angle = last.softest.angle_deg + turn_deg
            axes.axvline(angle, color=GREY, linestyle="--", linewidth=1.0)
            axes.axvspan(
                angle - last.softest.U_deg, angle + last.softest.U_deg, color=GREY, alpha=0.15, lw=0
            )
    axes.set_xlim(0.0, 360.0)
    axes.set_ylim(0.0, limit)
    axes.set_xticks(_TICKS_DEG)
    axes.tick_params(labelsize=_DIRECTION_SIZE)
    axes.set_xlabel(words["rose_angle"].format(axis=last.plane[0]))
    axes.set_ylabel(words["rose_curve"].format(unit=unit))


def _farthest_ring(roses: Sequence[PlaneStiffness]) -> float:
    """Return the compliance that the rim of the polar panel represents [mm/N].

    ``roses`` holds the stiffness by direction in a plane at each force; the largest force is last.
    The rim lies beyond all curves. It also lies beyond the 95 % band at the largest force, unless
    the band extends to more than 1.6 times the largest compliance on a curve.
    """
    largest = max(rose.compliance.max() for rose in roses)
    reach = max(largest, roses[-1].compliance_high.max())
    limit = min(_FARTHEST * largest, 1.05 * reach)
    return float(max(limit, 1.05 * largest))


def _coloured(roses: Sequence[PlaneStiffness]) -> Iterator[tuple[PlaneStiffness, str]]:
    """Yield, for every force, the stiffness by direction and the colour of the force's curve."""
    yield from zip(roses, reversed(PALETTE[: len(roses)]), strict=True)


def _closed(values: Array, turn: float = 0.0) -> Array:
    """Return values around a circle, with the first value repeated at the end.

    A curve through the returned values is closed. The returned array has the shape (n + 1,) for n
    values. ``turn`` is added to the repeated value; for angles in degrees, it is 360.
    """
    return np.append(values, values[0] + turn)
