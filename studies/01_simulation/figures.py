"""Figs. 1, 3, 4 and 5 of the paper in the package's style, and how far the linear model reaches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

import ldbb_bayes as lb

DEGREES = np.arange(361.0)
LINK = {"arrowstyle": "-", "color": "#6B7A8A"}
ARROW = {"arrowstyle": "-|>", "color": "#6B7A8A"}
BOX = {"boxstyle": "round,pad=0.45", "facecolor": "#F4F7FA", "edgecolor": "#6B7A8A"}


@lb.figures.styled
def chain() -> Figure:
    """Fig. 1: the kinematic chain, and which parameters of which joint a circle in XY shows."""
    figure = lb.figures.new_figure(9.6, 2.2)
    axes = figure.subplots()
    axes.set_axis_off()
    axes.set(xlim=(-0.6, 4.6), ylim=(-0.55, 0.75))
    joints = (
        ("work ball", "rigid with the foundation:\none set-up, its origin"),
        ("foundation", ""),
        ("Y axis", "E_YY1, E_XY2, E_C(0Y)X\nC_YYY, C_CXY, C_CYY, C_CCY"),
        ("X axis", "E_XX1, E_YX2\nC_XXX, C_XYX"),
        ("tool ball", "E_Xt0, E_Yt0"),
    )
    for x, (name, parameters) in enumerate(joints):
        axes.text(x, 0.25, name, ha="center", va="center", bbox=BOX, fontsize=10)
        axes.text(x, -0.05, parameters, ha="center", va="top", fontsize=8)
        if x > 0:
            axes.annotate("", (x - 0.33, 0.25), (x - 0.67, 0.25), arrowprops=LINK)
    axes.annotate(
        "",
        (4.0, 0.5),
        (0.0, 0.5),
        arrowprops={"arrowstyle": "<->", "color": lb.figures.PALETTE[1], "lw": 1.4},
    )
    axes.text(
        2.0,
        0.55,
        "bar: force F along θ, reading ρ = distance − R",
        ha="center",
        va="bottom",
        color=lb.figures.PALETTE[1],
    )
    return figure


@lb.figures.styled
def data_flow() -> Figure:
    """Fig. 3: how the simulation goes round."""
    figure = lb.figures.new_figure(9.6, 3.4)
    axes = figure.subplots()
    axes.set_axis_off()
    axes.set(xlim=(-0.2, 10.2), ylim=(0.2, 4.9))
    boxes = (
        (1.0, 3.6, "geometric errors\nE_G, simulated"),
        (1.0, 0.8, "compliances\nC, simulated"),
        (3.6, 3.6, "exact model\nEq. 1–14"),
        (3.6, 0.8, "wrench and joints\nEq. 20, force F"),
        (5.7, 2.2, "readings\nEq. 21"),
        (7.6, 2.2, "pseudoinverse of J_H\nEq. 31"),
        (9.5, 2.2, "estimates\nand errors"),
    )
    for x, y, text in boxes:
        axes.text(x, y, text, ha="center", va="center", bbox=BOX, fontsize=8.5)
    arrows = (
        ((1.85, 3.6), (2.75, 3.6)),
        ((1.85, 0.8), (2.55, 0.8)),
        ((4.4, 3.3), (5.4, 2.6)),
        ((4.4, 1.1), (5.4, 1.8)),
        ((6.15, 2.2), (6.6, 2.2)),
        ((8.6, 2.2), (8.95, 2.2)),
    )
    for start, end in arrows:
        axes.annotate("", end, start, arrowprops=ARROW)
    axes.plot([9.5, 9.5, 3.6], [2.75, 4.4, 4.4], color="#6B7A8A", linewidth=1.0)
    axes.annotate("", (3.6, 4.0), (3.6, 4.4), arrowprops=ARROW)
    axes.text(
        6.5, 4.45, "estimates used again: predicted readings", ha="center", va="bottom", fontsize=8
    )
    return figure


@lb.figures.styled
def scale_and_compliance(readings_um: Mapping[float, np.ndarray]) -> Figure:
    """Fig. 4: E_XX1 and C_XXX make the same oval, of which only one part grows with the force."""
    figure = lb.figures.new_figure(7.2, 4.6)
    axes: Any = figure.subplots(subplot_kw={"projection": "polar"})
    axes.set_xticks(np.deg2rad(range(0, 360, 90)), ["+X", "+Y", "180°", "270°"])
    axes.tick_params(labelsize=7)
    nominal_radius = 1.1 * max(np.abs(values).max() for values in readings_um.values())
    colours = lb.figures.force_colours(list(readings_um))
    for (force_N, values), colour in zip(readings_um.items(), colours, strict=True):
        axes.plot(
            np.deg2rad(DEGREES),
            nominal_radius + values,
            color=colour,
            label=f"{force_N:g} N: {np.ptp(values):.1f} µm",
        )
    axes.plot(
        np.deg2rad(DEGREES),
        np.full(361, nominal_radius),
        color="black",
        linewidth=0.8,
        linestyle="--",
        label="nominal circle",
    )
    ticks_um = 50.0 * np.arange(int(nominal_radius // 50) + 1)
    labels = [f"{tick:g} µm" for tick in ticks_um]
    axes.set_rgrids(nominal_radius + ticks_um, labels, fontsize=6.5)
    axes.legend(loc="center left", bbox_to_anchor=(1.1, 0.5), title="reading, peak to peak")
    return figure


class Readings(NamedTuple):
    """Readings at 0° … 360° from the simulated and from the estimated values [µm]."""

    simulated_um: np.ndarray
    predicted_um: np.ndarray


@lb.figures.styled
def simulated_and_predicted(contributions: Mapping[str, Mapping[float, Readings]]) -> Figure:
    """Fig. 5: simulated (wide) and predicted (dashed) readings of geometry, compliance and both, at
    every force."""
    figure = lb.figures.new_figure(9.6, 3.8)
    panels: Any = figure.subplots(1, 3)
    for axes, (title, by_force) in zip(panels, contributions.items(), strict=True):
        colours = lb.figures.force_colours(list(by_force))
        for (force_N, readings), colour in zip(by_force.items(), colours, strict=True):
            axes.plot(
                DEGREES,
                readings.simulated_um,
                color=colour,
                linewidth=3.0,
                alpha=0.45,
                label=f"{force_N:g} N",
            )
            axes.plot(DEGREES, readings.predicted_um, color="black", linewidth=0.8, linestyle="--")
        axes.set_title(title)
        axes.set_xlabel("angle of the bar (°)")
        axes.set_xlim(0.0, 360.0)
        axes.set_xticks(range(0, 361, 90))
    panels[0].set_ylabel("reading (µm): simulated (wide), predicted (dashed)")
    figure.legend(*panels[2].get_legend_handles_labels(), loc="outside lower center", ncols=8)
    return figure


@lb.figures.styled
def linearisation(
    sizes: Sequence[float],
    curves: Mapping[str, Sequence[float]],
    resolution_um: float,
    limit: float,
) -> Figure:
    """Largest linearisation error against the size of the errors, in prior standard deviations."""
    figure = lb.figures.new_figure(7.6, 3.9)
    axes = figure.subplots()
    colours = ("#000000", *lb.figures.PALETTE)
    widths = (2.2, *(1.2 for _ in lb.figures.PALETTE))
    for (label, values), colour, width in zip(curves.items(), colours, widths, strict=False):
        axes.loglog(sizes, values, color=colour, linewidth=width, label=label)
    axes.axhline(resolution_um, color="#8C8C8C", linestyle="--", linewidth=0.9)
    axes.text(
        sizes[0], resolution_um * 1.15, "resolution of the readout", fontsize=7.5, color="#555555"
    )
    axes.axvline(limit, color="#8C8C8C", linestyle=":", linewidth=1.2)
    axes.set_xlabel("size of the errors (prior standard deviations)")
    axes.set_ylabel("largest |exact − linear| reading (µm)")
    axes.set_ylim(1e-5, None)
    axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5))
    return figure
