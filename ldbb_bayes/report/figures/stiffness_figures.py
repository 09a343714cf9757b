"""Figure of stiffness by direction: the compliance along the bar as a rose."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ldbb_bayes.analysis.directional_stiffness import PlaneStiffness, stiffness
from ldbb_bayes.inference.posterior import bound_of
from ldbb_bayes.report.figures import style
from ldbb_bayes.report.figures.parameter_figures import WORDS
from ldbb_bayes.report.figures.style import GREY, PALETTE, band, new_figure, panels, styled
from ldbb_bayes.results import Array
from ldbb_bayes.units import display_unit

__all__ = ["stiffness_rose"]

# The rings end at this multiple of the largest compliance that is drawn without its band, so that a
# band of hardly determined compliances does not hide the rest.
_FARTHEST = 1.6
# Place of the rings' labels [°]: between the axes, where lines are seldom crowded.
_LABEL_ANGLE_DEG = 67.5
_HEIGHT = 3.2  # height of a rose [inch]
# Width and height of a compact figure of one plane, which a sheet shows beside another one [inch].
_COMPACT_SIZE = (3.4, 3.7)
_RINGS = 4  # largest number of rings
# Sizes of the labels of directions and of rings [pt].
_DIRECTION_SIZE = 8
_RING_SIZE = 7


@styled
def stiffness_rose(
    posterior: xr.DataTree, words: Mapping[str, str] = WORDS, *, compact: bool = False
) -> Figure:
    """Draw the compliance along the bar by direction, at the smallest and the largest force.

    A line far from the centre means a soft direction. Each force has its 95 % band. A dashed line
    shows the softest direction at the largest force, if the readings determine it.

    Parameters
    ----------
    posterior : DataTree
        Posterior from `sample`, `load` or `average`.
    words : mapping of str to str
        Labels of the figure by name. Default: English.
    compact : bool
        Whether the figure of one plane is only as wide as its rose.

    Returns
    -------
    Figure
        A Matplotlib figure with a polar panel for each plane.

    Examples
    --------
    >>> figure = lb.figures.stiffness_rose(posterior)
    >>> [axes.name for axes in figure.axes]
    ['polar']
    """
    bound = bound_of(posterior)
    tested_N = bound.setting.force_N
    forces_N = sorted({float(tested_N.min()), float(tested_N.max())})
    result = stiffness(posterior, forces_N)
    planes = bound.setting.planes
    factor, unit = display_unit("mm/N")
    title = words["rose"].format(unit=unit)
    polar = {"projection": "polar"}
    is_narrow = compact and len(planes) == 1
    if is_narrow:
        figure = new_figure(*_COMPACT_SIZE)
        all_axes = [figure.subplots(subplot_kw=polar)]
    else:
        figure, all_axes = panels(len(planes), 3, _HEIGHT, 0.3, subplot_kw=polar)
    for axes, plane in zip(all_axes, planes, strict=True):
        roses = [rose for rose in result.planes if rose.plane == plane]
        _draw_rose(axes, roses, words, factor)
        axes.tick_params(axis="x", labelsize=_DIRECTION_SIZE, pad=0)
        axes.tick_params(axis="y", labelsize=_RING_SIZE)
        if len(planes) > 1:
            axes.set_title(f"{words['plane']} {plane}", fontsize=9)
    style.legend_below(figure, all_axes[0], columns=1 if is_narrow else 2)
    if is_narrow:
        figure.suptitle(title.replace("; ", "\n"))
    else:
        figure.suptitle(title)
    return figure


def _draw_rose(
    axes: Any, roses: list[PlaneStiffness], words: Mapping[str, str], factor: float
) -> None:
    """Draw the compliance along the bar in one plane, for every force.

    ``roses`` are the stiffnesses of the plane, with the largest force last. ``factor`` converts
    compliances in mm/N to the unit of the rings.
    """
    last = roses[-1]
    largest = max(rose.compliance.max() for rose in roses) * factor
    reach = max(largest, last.compliance_high.max() * factor)
    limit = min(_FARTHEST * largest, 1.05 * reach)
    limit = max(limit, 1.05 * largest)
    for rose, colour in zip(roses, reversed(PALETTE[: len(roses)]), strict=True):
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
    axes.set_rlabel_position(_LABEL_ANGLE_DEG)
    rings = MaxNLocator(_RINGS).tick_values(0.0, limit)
    axes.set_yticks([ring for ring in rings if 0.0 < ring < limit])


def _closed(values: Array, turn: float = 0.0) -> Array:
    """Return values around a circle with the first one repeated at the end, plus ``turn``."""
    return np.append(values, values[0] + turn)
