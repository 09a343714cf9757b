"""Atlases: figures with the patterns of all compliances or geometric errors of a machine.

The pattern of a compliance or geometric error shows how it changes the reading of a circular test
at each angle on the circle.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ldbb_bayes.machine.chain import Circle, Machine
from ldbb_bayes.machine.linear import geometric_jacobian, kept_compliances, wrench_jacobian
from ldbb_bayes.machine.parameters import geometric_names, wrench_names
from ldbb_bayes.report.figures.style import ACCENT, DASHED, GREY, PALETTE, panels, styled
from ldbb_bayes.results import Array
from ldbb_bayes.units import display_name

__all__ = ["compliance_atlas", "geometric_atlas"]

_ANGLE = np.linspace(0.0, 2 * np.pi, 361)
# The curve of a parameter's pattern (its effect on the reading) is drawn around a circle. This
# value is the largest distance between curve and circle, as a fraction of the circle's radius.
_SWING = 0.45


@styled
def compliance_atlas(machine: Machine, circle: Circle | None = None) -> Figure:
    """Draw the patterns of all joint compliances, that is, their effects on the readings.

    Compliances whose patterns are proportional to each other have the same colour. The model keeps
    only one of the compliances with the same colour. The pattern of this compliance is drawn bold.

    Parameters
    ----------
    machine : Machine
        The machine. Only patterns in the plane of the circle are drawn.
    circle : Circle, optional
        Circle of the test. Default: a circle about the origin, in the machine's first plane.

    Returns
    -------
    Figure
        A Matplotlib figure with a polar panel for each joint compliance.

    Raises
    ------
    InputError
        The machine lacks an axis of the circle's plane.

    Examples
    --------
    >>> figure = lb.figures.compliance_atlas(lb.Machine())
    >>> len(figure.axes)  # 9 for each of the joints X and Y
    18
    """
    circle = circle or Circle(plane=machine.planes[0])
    machine = Machine(machine.topology, circle.plane, machine.frames_mm)
    names = [name.label for name in wrench_names(machine)]
    kept = kept_compliances(machine, circle)
    colours = {}
    for k, members in enumerate(kept.sets):
        for name in members:
            colours[name] = PALETTE[k % len(PALETTE)]
    patterns = dict(zip(names, wrench_jacobian(machine, circle, _ANGLE).T, strict=True))
    title = (
        f"{machine.topology}, plane {machine.plane}: patterns of the {len(names)} joint"
        " compliances\nOne colour: proportional, only their sum can be identified. Bold: kept"
    )
    return _atlas(patterns, colours, {name.label for name in kept.names}, kept.null, title)


@styled
def geometric_atlas(machine: Machine, circle: Circle | None = None) -> Figure:
    """Draw the patterns of all geometric errors, that is, their effects on the readings.

    Parameters
    ----------
    machine : Machine
        The machine. Only patterns in the plane of the circle are drawn.
    circle : Circle, optional
        Circle of the test. Default: a circle about the origin, in the machine's first plane.

    Returns
    -------
    Figure
        A Matplotlib figure with a polar panel for each geometric error.

    Raises
    ------
    InputError
        The machine lacks an axis of the circle's plane.

    Examples
    --------
    >>> circle = lb.machine.Circle(radius_mm=150.0, plane="ZX")
    >>> figure = lb.figures.geometric_atlas(lb.Machine(), circle)
    >>> figure.get_suptitle()
    'wCAFYXZSt, plane ZX: patterns of the geometric errors'
    """
    circle = circle or Circle(plane=machine.planes[0])
    machine = Machine(machine.topology, circle.plane, machine.frames_mm)
    names = [name.label for name in geometric_names(machine)]
    patterns = dict(zip(names, geometric_jacobian(machine, circle, _ANGLE).T, strict=True))
    title = f"{machine.topology}, plane {machine.plane}: patterns of the geometric errors"
    return _atlas(patterns, dict.fromkeys(names, ACCENT), names, (), title)


def _atlas(
    patterns: Mapping[str, Array],
    colours: Mapping[str, str],
    bold: Collection[str],
    without_effect: Collection[str],
    title: str,
) -> Figure:
    """Draw the effect of every parameter on the readings of a circle, each in a polar panel.

    ``patterns`` holds the change of the readings around the circle per unit of each parameter. All
    patterns are scaled to the same height. ``colours`` holds the colours of the parameters' lines;
    a line without an entry is grey. The keys of both mappings are the names of the parameters.
    ``bold`` names the parameters that are drawn with thicker lines. ``without_effect`` names the
    parameters that have no effect on the readings; their patterns are drawn as circles. ``title``
    is the title of the figure.
    """
    figure, all_axes = panels(len(patterns), 4, 1.7, 0.7, subplot_kw={"projection": "polar"})
    axes: Any
    for axes, (name, pattern) in zip(all_axes, patterns.items(), strict=True):
        peak = float(np.abs(pattern).max())
        swing = np.zeros_like(pattern)
        if name not in without_effect and peak > 0.0:
            swing = pattern / peak
        radius = 1.0 + _SWING * swing
        width = 2.0 if name in bold else 1.1
        axes.plot(_ANGLE, np.ones_like(_ANGLE), color=GREY, linewidth=0.8, linestyle=DASHED)
        axes.plot(_ANGLE, radius, color=colours.get(name, GREY), linewidth=width)
        axes.set_rlim(0.0, 1.0 + 1.1 * _SWING)
        axes.set_rticks([])
        axes.spines["polar"].set_visible(False)
        axes.set_xticks(np.deg2rad([0, 90, 180, 270]), ["", "", "", ""])
        label = display_name(name)
        if name in without_effect:
            label += " (no effect)"
        axes.set_title(label, fontweight="bold" if name in bold else "normal", pad=4)
    figure.suptitle(title)
    return figure
