"""Polar plot of the compliance along the bar in every direction of a plane (stiffness rose)."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

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
# Height of a figure with one polar panel, and a panel of curves beside it [inch].
_HEIGHT = 3.0
# Width and height of a compact figure of the compliance by direction in one plane [inch]. A sheet
# of the test certificate shows this figure beside another figure.
_COMPACT_SIZE = (3.4, 3.7)
# Relative widths of two panels that show the compliance by direction: the polar plot, and to the
# right of it the same curves against the angle.
_WIDTHS = (1.0, 1.7)
# Distances around the circles of the polar panels of several planes [inch]: at the left edge of the
# figure, between two circles in a row, at the right edge, above and below each row, above all rows
# for the title, and below them for the legend.
_LEFT_MARGIN = 0.38
_GAP = 0.74
_RIGHT_MARGIN = 0.4
_ABOVE_ROW = 0.26
_BELOW_ROW = 0.24
_TITLE_HEIGHT = 0.24
_LEGEND_LINE = 0.16
# Largest number of characters in a line of the legend: beside a panel of curves, below one narrow
# panel, in the empty place of three panels, and below several panels.
_CHARACTERS_IN_COLUMN = 26
_CHARACTERS_BELOW_ONE = 40
_CHARACTERS_IN_PLACE = 30
_CHARACTERS_BELOW_SEVERAL = 62
_RINGS = 4  # largest number of grid circles in a polar panel
_TICKS_DEG = np.arange(0, 361, 45)
# Font sizes of the labels of directions, and of the labels of grid circles (rings), in a polar
# panel [points].
_DIRECTION_SIZE = 8
_RING_SIZE = 7
# Dashes of a curve that may lie on another one: lengths of dash and gap, in line widths.
_Dashes = tuple[float, tuple[float, float]]
_DASHES: _Dashes = (0.0, (3.5, 2.0))


class _RoseGrid(NamedTuple):
    """Arrangement of the polar panels of several planes in a figure.

    ``columns`` is the number of panels in a row, and ``diameter`` that of their circles [inch].
    """

    columns: int
    diameter: float

    @property
    def step(self) -> float:
        """Distance between the left edges of two circles in a row [inch]."""
        return self.diameter + _GAP

    @property
    def row_height(self) -> float:
        """Height of a row of panels [inch]."""
        return _ABOVE_ROW + self.diameter + _BELOW_ROW

    @property
    def width(self) -> float:
        """Width of the figure [inch]."""
        return _LEFT_MARGIN + self.columns * self.step - _GAP + _RIGHT_MARGIN


# Arrangement of the panels of two or three planes: in a figure of its own, and in a compact figure,
# which stands beside another one on a sheet of the test certificate.
_GRIDS = {2: _RoseGrid(2, 2.36), 3: _RoseGrid(3, 1.34)}
_COMPACT_GRIDS = {2: _RoseGrid(2, 1.6), 3: _RoseGrid(2, 1.6)}


@styled
def stiffness_rose(
    posterior: xr.DataTree, words: Mapping[str, str] = WORDS, *, compact: bool = False
) -> Figure:
    """Draw the compliance along the bar in every direction of each plane, as a polar curve.

    There is one curve for the smallest and one for the largest force tested, each with a 95 % band.
    The legend states how far a band goes that is cut off at the rim of a panel. The curve
    of the largest force is dashed, so that the other one is seen below it where both coincide. A
    direction is soft where a curve is far from the centre. A dotted line shows the softest
    direction at the largest force, if the readings determine this direction. If only one plane was
    tested, a second panel shows the same curves against the angle, with the softest direction ± U.

    Parameters
    ----------
    posterior : DataTree
        Posterior from `sample`, `load` or `average`.
    words : mapping of str to str
        Texts of the figure; the keys are the names of the texts. Default: English texts.
    compact : bool
        Whether the figure is narrow and has only polar panels. Those of three planes are then in
        two rows.

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
    roses_by_plane = {
        plane: [rose for rose in result.planes if rose.plane == plane] for plane in planes
    }
    grids = _COMPACT_GRIDS if compact else _GRIDS
    return _roses_of_planes(roses_by_plane, grids[len(planes)], words, title)


def _roses_of_planes(
    roses_by_plane: Mapping[str, Sequence[PlaneStiffness]],
    grid: _RoseGrid,
    words: Mapping[str, str],
    title: str,
) -> Figure:
    """Return a figure with a polar panel of the compliance by direction for each of several planes.

    ``roses_by_plane`` holds the stiffness by direction in each plane at each force; the largest
    force is last. The legend is below the panels, or in the place that they leave empty.
    """
    count = len(roses_by_plane)
    rows = -(-count // grid.columns)
    has_empty_place = count < rows * grid.columns
    characters = _CHARACTERS_IN_PLACE if has_empty_place else _CHARACTERS_BELOW_SEVERAL
    labels = _labels(list(roses_by_plane.values()), words, characters)
    legend_height = 0.0
    if not has_empty_place:
        lines = sum(label.count("\n") + 1 for label in labels)
        legend_height = 0.1 + _LEGEND_LINE * lines
    height = _TITLE_HEIGHT + rows * grid.row_height + legend_height
    figure = Figure(figsize=(grid.width, height))
    for k, (plane, roses) in enumerate(roses_by_plane.items()):
        row, column = divmod(k, grid.columns)
        left = _LEFT_MARGIN + column * grid.step
        top = _TITLE_HEIGHT + row * grid.row_height + _ABOVE_ROW
        place = (
            left / grid.width,
            1.0 - (top + grid.diameter) / height,
            grid.diameter / grid.width,
            grid.diameter / height,
        )
        axes: Any = figure.add_axes(place, projection="polar")
        _draw_rose(axes, roses, labels)
        axes.set_title(f"{words['plane']} {plane}", fontsize=9, loc="left", x=-0.1, y=1.0, pad=4)
    handle_by_label: dict[str, Any] = {}
    for axes in figure.axes:
        handles, drawn = axes.get_legend_handles_labels()
        handle_by_label |= dict(zip(drawn, handles, strict=True))
    handles = [handle_by_label[label] for label in labels]
    if has_empty_place:
        left = _LEFT_MARGIN + (count % grid.columns) * grid.step - 0.5 * _GAP
        place_of_legend = (left / grid.width, 0.5 * grid.row_height / height)
        figure.legend(handles, labels, loc="center left", bbox_to_anchor=place_of_legend)
    else:
        figure.legend(handles, labels, loc="lower center", ncols=1, borderaxespad=0.0)
    figure.suptitle(title, fontsize=8, y=1.0 - 0.05 / height, va="top")
    return figure


def _labels(
    roses_by_plane: Sequence[Sequence[PlaneStiffness]], words: Mapping[str, str], characters: int
) -> list[str]:
    """Return the texts of the legend: one for each force, and one for the softest direction.

    Where the 95 % band at a force goes beyond the rim of a panel, the text states how far it goes
    in any plane. The texts are broken into lines of at most ``characters``. The one for the softest
    direction is left out if the readings determine this direction in none of the planes.
    """
    factor, unit = display_unit("mm/N")
    labels = []
    for k, rose in enumerate(roses_by_plane[0]):
        label = words["rose_line"].format(force=f"{rose.force_N:.4g}")
        beyond = []
        for roses in roses_by_plane:
            largest = roses[k].compliance_high.max()
            if largest > _farthest_ring(roses):
                beyond.append(largest * factor)
        if beyond:
            label = words["rose_line_cut"].format(
                force=f"{rose.force_N:.4g}", largest=f"{max(beyond):.0f}", unit=unit
            )
        labels.append(label)
    if any(roses[-1].softest.is_determined for roses in roses_by_plane):
        largest_force = f"{roses_by_plane[0][-1].force_N:.4g}"
        labels.append(words["softest"].format(force=largest_force))
    return [textwrap.fill(label, characters) for label in labels]


def _rose_alone(roses: Sequence[PlaneStiffness], words: Mapping[str, str], title: str) -> Figure:
    """Return a narrow figure, with one polar panel, of the compliance by direction in a plane.

    ``roses`` holds the stiffness by direction in the plane at each force; the largest force is
    last. ``words`` holds the texts of the figure. ``title`` is broken into several lines.
    """
    figure = new_figure(*_COMPACT_SIZE)
    axes = figure.add_subplot(projection="polar")
    _draw_rose(axes, roses, _labels([roses], words, _CHARACTERS_BELOW_ONE))
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
    _draw_rose(rose_axes, roses, _labels([roses], words, _CHARACTERS_IN_COLUMN))
    _draw_curves(curve_axes, roses, words)
    style.legend_below(figure, rose_axes, columns=3)
    return figure


def _draw_rose(axes: Any, roses: Sequence[PlaneStiffness], labels: Sequence[str]) -> None:
    """Draw the compliance along the bar in one plane as polar curves, one curve for each force.

    ``roses`` holds the stiffness by direction in the plane at each force; the largest force is
    last. ``labels`` holds the texts of the legend: one for each force, and then one for the softest
    direction if the readings determine it.
    """
    last = roses[-1]
    factor, _ = display_unit("mm/N")
    limit = _farthest_ring(roses) * factor
    for (rose, colour, dashes), label in zip(_styled_curves(roses), labels, strict=False):
        angle_rad = np.deg2rad(_closed(rose.angle_deg, 360.0))
        low = np.maximum(_closed(rose.compliance_low) * factor, 0.0)
        high = np.minimum(_closed(rose.compliance_high) * factor, limit)
        band(axes, angle_rad, (low, high), colour)
        compliance = _closed(rose.compliance) * factor
        axes.plot(angle_rad, compliance, color=colour, linestyle=dashes, label=label)
    if last.softest.is_determined:
        direction_rad = np.deg2rad([last.softest.angle_deg, last.softest.angle_deg + 180.0])
        axes.plot(direction_rad, [limit, limit], ":", color=GREY, linewidth=1.2, label=labels[-1])
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
    for rose, colour, dashes in _styled_curves(roses):
        angle_deg = _closed(rose.angle_deg, 360.0)
        low = np.maximum(_closed(rose.compliance_low) * factor, 0.0)
        high = np.minimum(_closed(rose.compliance_high) * factor, limit)
        band(axes, angle_deg, (low, high), colour)
        compliance = _closed(rose.compliance) * factor
        axes.plot(angle_deg, compliance, color=colour, linestyle=dashes)
    if last.softest.is_determined:
        for turn_deg in (-180.0, 0.0, 180.0, 360.0):
            angle = last.softest.angle_deg + turn_deg
            axes.axvline(angle, color=GREY, linestyle=":", linewidth=1.2)
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


def _styled_curves(
    roses: Sequence[PlaneStiffness],
) -> Iterator[tuple[PlaneStiffness, str, str | _Dashes]]:
    """Yield, for every force, the stiffness by direction, and colour and dashes of its curve.

    The curve of the first force is solid. Those drawn over it are dashed, so that it is seen
    through their gaps where the curves coincide.
    """
    colours = reversed(PALETTE[: len(roses)])
    for k, (rose, colour) in enumerate(zip(roses, colours, strict=True)):
        yield rose, colour, "-" if k == 0 else _DASHES


def _closed(values: Array, turn: float = 0.0) -> Array:
    """Return values around a circle, with the first value repeated at the end.

    A curve through the returned values is closed. The returned array has the shape (n + 1,) for n
    values. ``turn`` is added to the repeated value; for angles in degrees, it is 360.
    """
    return np.append(values, values[0] + turn)
