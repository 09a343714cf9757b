"""Polar atlases: what one unit of every compliance, or of every geometric error, does to the circle (Tables 2 and 3)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ldbb_bayes.machine.chain import Circle, Machine
from ldbb_bayes.machine.jacobian import geometric_jacobian, wrench_jacobian
from ldbb_bayes.machine.kept import kept_compliances
from ldbb_bayes.machine.names import geometric_names, wrench_names
from ldbb_bayes.report.figures.style import ACCENT, GREY, PALETTE, new_figure, styled
from ldbb_bayes.units import display_name

__all__ = ["compliance_atlas", "geometric_atlas"]

Array = NDArray[Any]
_ANGLE = np.linspace(0.0, 2 * np.pi, 361)
_SWING = 0.45


@styled
def compliance_atlas(machine: Machine, circle: Circle | None = None) -> Figure:
    """The patterns of all joint compliances, proportional sets in one colour, the kept representative in bold."""
    where = circle or Circle(plane=machine.planes[0])
    machine = _in_plane(machine, where)
    names = [name.label for name in wrench_names(machine)]
    kept = kept_compliances(machine, where)
    colour: dict[str, str] = {}
    for k, members in enumerate(kept.sets):
        colour |= dict.fromkeys(members, PALETTE[k % len(PALETTE)])
    bold = {name.label for name in kept.names}
    columns = dict(zip(names, wrench_jacobian(machine, where, _ANGLE).T, strict=True))
    notes = dict.fromkeys(kept.null, "no effect")
    figure = _atlas(columns, colour, bold, notes, 6)
    figure.suptitle(
        f"{machine.topology}, plane {machine.plane}: patterns of the {len(names)} joint compliances. One colour: proportional, "
        "only their sum can be known. Bold: kept",
        fontsize=9.5,
    )
    return figure


@styled
def geometric_atlas(machine: Machine, circle: Circle | None = None) -> Figure:
    """The patterns of the geometric errors."""
    where = circle or Circle(plane=machine.planes[0])
    machine = _in_plane(machine, where)
    names = [name.label for name in geometric_names(machine)]
    columns = dict(zip(names, geometric_jacobian(machine, where, _ANGLE).T, strict=True))
    figure = _atlas(columns, dict.fromkeys(names, ACCENT), set(names), {}, 4)
    figure.suptitle(f"{machine.topology}, plane {machine.plane}: patterns of the geometric errors", fontsize=9.5)
    return figure


def _in_plane(machine: Machine, circle: Circle) -> Machine:
    return Machine(machine.topology, circle.plane, machine.frames_mm)


def _atlas(
    columns: Mapping[str, Array], colour: Mapping[str, str], bold: set[str], notes: Mapping[str, str], width: int
) -> Figure:
    rows = -(-len(columns) // width)
    figure = new_figure(1.65 * width, 0.5 + 1.9 * rows)
    panels: list[Any] = list(figure.subplots(rows, width, squeeze=False, subplot_kw={"projection": "polar"}).flat)
    for axes, (name, values) in zip(panels, columns.items(), strict=False):
        peak = float(np.abs(values).max())
        swing = values / peak if name not in notes and peak > 0.0 else np.zeros_like(values)
        axes.plot(_ANGLE, np.ones_like(_ANGLE), color=GREY, linewidth=0.8, linestyle=(0, (4, 3)))
        axes.plot(_ANGLE, 1.0 + _SWING * swing, color=colour.get(name, GREY), linewidth=2.0 if name in bold else 1.1)
        axes.set_rlim(0.0, 1.0 + 1.1 * _SWING)
        axes.set_rticks([])
        axes.spines["polar"].set_visible(False)
        axes.set_xticks(np.deg2rad([0, 90, 180, 270]), ["", "", "", ""])
        note = f" ({notes[name]})" if name in notes else ""
        axes.set_title(display_name(name) + note, fontweight="bold" if name in bold else "normal", pad=4)
    for axes in panels[len(columns) :]:
        axes.set_visible(False)
    return figure
