"""Figs. 8 to 14 of least-squares estimates, and the least-squares lines of Figs. 15 and 16 on the
package's own."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import ldbb_bayes as lb

ANGLE_DEG = np.arange(361.0)
OFFSETS = ("E_Xt0", "E_Yt0")
Pair = tuple[str, str]
BAND_U = 1.96
# What an axis shows of one inside unit (mm, N, rad).
SHOWN = {
    "nm/N": 1e6,
    "nrad/N": 1e9,
    "µrad/(N m)": 1e9,
    "µm/m": 1e6,
    "µm/m²": 1e9,
    "µrad": 1e6,
    "µm": 1e3,
}
GLOBAL = {"constant": ("#009E73", (0, (6, 2))), "linear": ("#CC79A7", (0, (6, 2, 1, 2)))}


def part_um(estimate: Mapping[str, float], force_N: float, *, start: str) -> np.ndarray:
    """Reading at 0° … 360° from the parameters whose names start so, tool offsets left out, shape
    (361,) [µm]."""
    jacobian = lb.machine.hybrid_jacobian(
        lb.Machine(), lb.machine.Circle(), np.deg2rad(ANGLE_DEG), force_N
    )
    names = [name for name in jacobian.columns if name.startswith(start) and name not in OFFSETS]
    return 1e3 * (jacobian[names] @ pd.Series(estimate)[names]).to_numpy()


def upper_pair(pairs: Mapping[Pair, lb.inference.LeastSquares], test: str) -> Pair:
    """The pair in which a test is the upper force; of the lowest force, its only pair."""
    return next((pair for pair in pairs if pair[1] == test), next(iter(pairs)))


@lb.figures.styled
def local_traces(campaign: lb.Campaign, pairs: Mapping[Pair, lb.inference.LeastSquares]) -> Figure:
    """Fig. 11 (b): readings and what each pair of neighbouring forces predicts for its two
    circles."""
    figure = lb.figures.new_figure(9.6, 5.0)
    panels: Any = figure.subplots(2, 3, sharex=True)
    for axes, test, colour in zip(
        panels.flat,
        campaign.tests,
        lb.figures.force_colours(campaign.forces_N.tolist()),
        strict=True,
    ):
        order = np.argsort(test.angle_deg)
        axes.plot(
            test.angle_deg[order],
            test.reading_um[order],
            color=colour,
            linewidth=2.4,
            alpha=0.45,
            label="readings",
        )
        for pair, found in pairs.items():
            if test.name in pair:
                style = "--" if test.name == pair[0] else "-"
                label = f"from {' and '.join(name.lstrip('f0') for name in pair)} N"
                axes.plot(
                    test.angle_deg[order],
                    found.predicted_um[test.name][order],
                    style,
                    color="black",
                    lw=0.9,
                    label=label,
                )
        axes.set_title(f"{test.force_N:g} N")
        axes.legend(fontsize=7)
        _angles(axes)
    for axes in panels[:, 0]:
        axes.set_ylabel("reading (µm)")
    for axes in panels[1]:
        axes.set_xlabel("angle of the bar (°)")
    return figure


@lb.figures.styled
def contributions(campaign: lb.Campaign, estimates: Mapping[str, Mapping[str, float]]) -> Figure:
    """Figs. 8 and 12: both parts, compliance and geometry at every force, from the estimate for
    each test."""
    figure = lb.figures.new_figure(9.6, 3.6)
    panels: Any = figure.subplots(1, 3)
    one = len({tuple(estimate.values()) for estimate in estimates.values()}) == 1
    for test, colour in zip(
        campaign.tests, lb.figures.force_colours(campaign.forces_N.tolist()), strict=True
    ):
        estimate = estimates[test.name]
        elastic, geometric = (
            part_um(estimate, float(test.force_N or 0.0), start=start) for start in ("C_", "E_")
        )
        for axes, values in zip(panels[:2], (elastic + geometric, elastic), strict=True):
            axes.plot(ANGLE_DEG, values, color=colour, label=f"{test.force_N:g} N")
        if not one or test is campaign.tests[-1]:
            panels[2].plot(ANGLE_DEG, geometric, color="black" if one else colour)
    for axes, title in zip(
        panels, ("Both", "Compliance", "Geometry, at any force" if one else "Geometry"), strict=True
    ):
        axes.set_title(title)
        axes.set_xlabel("angle of the bar (°)")
        _angles(axes)
    panels[0].set_ylabel("contribution (µm)")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=6)
    return figure


@lb.figures.styled
def parameter_contributions(table: pd.DataFrame, force_N: float) -> Figure:
    """Figs. 9, 10 and 13, 14: every parameter's part of the reading by least squares, with its 95 %
    band by white noise."""
    jacobian = lb.machine.hybrid_jacobian(
        lb.Machine(), lb.machine.Circle(), np.deg2rad(ANGLE_DEG), force_N
    )
    figure = lb.figures.new_figure(10.4, 6.8)
    panels: Any = figure.subplots(2, 2)
    for row, start, words in zip(
        panels, ("C_", "E_"), (f"Compliances at {force_N:g} N", "Geometric errors"), strict=True
    ):
        names = [name for name in table.index if name.startswith(start)]
        size = {
            name: 1e3 * abs(table.loc[name, "estimate"]) * np.ptp(jacobian[name]) for name in names
        }
        large = {name: size[name] >= max(size.values()) / 3.0 for name in names}
        for axes, wanted, which in zip(
            row, (True, False), ("the largest", "the others"), strict=True
        ):
            for name, colour in zip(names, lb.figures.PALETTE, strict=False):
                if large[name] != wanted:
                    continue
                line, half = (
                    1e3 * jacobian[name].to_numpy() * table.loc[name, column]
                    for column in ("estimate", "u")
                )
                axes.fill_between(
                    ANGLE_DEG,
                    line - BAND_U * half,
                    line + BAND_U * half,
                    color=colour,
                    alpha=0.25,
                    linewidth=0,
                )
                axes.plot(
                    ANGLE_DEG,
                    line,
                    color=colour,
                    label=f"{on_page(name)}: {size[name]:#.3g} µm p-p",
                )
            axes.set_title(f"{words}: {which}")
            axes.set_xlabel("angle of the bar (°)")
            axes.set_ylabel("contribution (µm)")
            _angles(axes)
            axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2)
    return figure


def on_page(name: str) -> str:
    """E_C0YX → E_C(0Y)X."""
    return name.replace("C0YX", "C(0Y)X")


@lb.figures.styled
def with_least_squares(
    figure: Figure, fits: Mapping[str, lb.inference.LeastSquares], forces_N: np.ndarray
) -> Figure:
    """Figs. 15 and 16: the paper's own global lines, of constant and of linear compliance (Eq. 33),
    added to the package's."""
    force = np.linspace(forces_N.min(), forces_N.max(), 51)
    middle = 0.5 * (forces_N.min() + forces_N.max())
    panels = [axes for axes in figure.axes if axes.get_visible()]
    for axes in panels:
        shown, unit = axes.get_ylabel().removesuffix(")").split(" (", 1)
        name = shown.replace("(", "").replace(")", "")
        for label, found in fits.items():
            colour, dashes = GLOBAL[label]
            values = found.estimate[name] + found.estimate.get(f"{name}_1", 0.0) * (force - middle)
            text = f"all forces, least squares, {label}"
            axes.plot(
                force,
                SHOWN[unit] * values,
                color=colour,
                linestyle=dashes,
                linewidth=1.6,
                label=text,
            )
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legends[0].remove()
    figure.set_figheight(figure.get_figheight() + 0.5)
    figure.set_layout_engine("constrained")
    clear = [
        label.replace(", mean", ", posterior mean").replace("constant, ±", "constant, posterior ±")
        for label in labels
    ]
    figure.legend(handles, clear, loc="outside lower center", ncols=2)
    return figure


@lb.figures.styled
def harmonics(
    mean: np.ndarray, sd: np.ndarray, zero: np.ndarray, forces_N: np.ndarray, names: tuple[str, ...]
) -> Figure:
    """The recovered harmonics against force, with ± 2 u, and the completion that sets the open
    directions to zero."""
    figure = lb.figures.new_figure(9.6, 4.4)
    panels: Any = figure.subplots(2, 4, sharex=True)
    for k, (axes, name) in enumerate(zip(panels.flat, names, strict=True)):
        axes.errorbar(
            forces_N,
            mean[:, k],
            2.0 * sd[:, k],
            fmt="o",
            capsize=3,
            color=lb.figures.PALETTE[0],
            label="recovered, ± 2 u",
        )
        axes.plot(
            forces_N,
            zero[:, k],
            "x",
            color=lb.figures.PALETTE[1],
            label="open directions set to zero",
        )
        middle = mean[:, k].mean()
        half = max(1.0, 1.1 * (np.abs(mean[:, k] - middle) + 2.0 * sd[:, k]).max())
        axes.set_ylim(middle - half, middle + half)
        axes.set_title("mean" if name == "1" else name)
    for axes in panels[:, 0]:
        axes.set_ylabel("coefficient (µm)")
    for axes in panels[1]:
        axes.set_xlabel("force (N)")
    figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


def _angles(axes: Axes) -> None:
    axes.set_xlim(0.0, 360.0)
    axes.set_xticks(range(0, 361, 90))
