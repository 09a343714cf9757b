"""Figs. 8 to 14 of least-squares estimates, and the least-squares lines of Figs. 15 and 16 on the
package's own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from make_campaign import Recovered
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
    for low, high in pairs:
        if high == test:
            return low, high
    return next(iter(pairs))


@lb.figures.styled
def local_traces(campaign: lb.Campaign, pairs: Mapping[Pair, lb.inference.LeastSquares]) -> Figure:
    """Fig. 11 (b): readings and what each pair of neighbouring forces predicts for its two
    circles."""
    figure = lb.figures.new_figure(9.6, 5.0)
    panels: Any = figure.subplots(2, 3, sharex=True)
    colours = lb.figures.force_colours(campaign.forces_N.tolist())
    for axes, test, colour in zip(panels.flat, campaign.tests, colours, strict=True):
        order = np.argsort(test.angle_deg)
        axes.plot(
            test.angle_deg[order],
            test.reading_um[order],
            color=colour,
            linewidth=2.4,
            alpha=0.45,
            label="readings",
        )
        for pair, fit in pairs.items():
            if test.name in pair:
                forces = " and ".join(name.lstrip("f0") for name in pair)
                axes.plot(
                    test.angle_deg[order],
                    fit.predicted_um[test.name][order],
                    "--" if test.name == pair[0] else "-",
                    color="black",
                    lw=0.9,
                    label=f"from {forces} N",
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
    both_axes, compliance_axes, geometry_axes = figure.subplots(1, 3)
    different_estimates = {tuple(estimate.values()) for estimate in estimates.values()}
    geometry_is_the_same = len(different_estimates) == 1
    colours = lb.figures.force_colours(campaign.forces_N.tolist())
    for test, colour in zip(campaign.tests, colours, strict=True):
        force_N = float(test.force_N or 0.0)
        compliance_um = part_um(estimates[test.name], force_N, start="C_")
        geometry_um = part_um(estimates[test.name], force_N, start="E_")
        label = f"{test.force_N:g} N"
        both_axes.plot(ANGLE_DEG, compliance_um + geometry_um, color=colour, label=label)
        compliance_axes.plot(ANGLE_DEG, compliance_um, color=colour, label=label)
        if not geometry_is_the_same:
            geometry_axes.plot(ANGLE_DEG, geometry_um, color=colour)
    if geometry_is_the_same:
        geometry_axes.plot(ANGLE_DEG, geometry_um, color="black")
    both_axes.set_title("Both")
    compliance_axes.set_title("Compliance")
    geometry_axes.set_title("Geometry, at any force" if geometry_is_the_same else "Geometry")
    for axes in (both_axes, compliance_axes, geometry_axes):
        axes.set_xlabel("angle of the bar (°)")
        _angles(axes)
    both_axes.set_ylabel("contribution (µm)")
    figure.legend(*both_axes.get_legend_handles_labels(), loc="outside lower center", ncols=6)
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
    titles = {"C_": f"Compliances at {force_N:g} N", "E_": "Geometric errors"}
    for row, (start, title) in zip(panels, titles.items(), strict=True):
        names = [name for name in table.index if name.startswith(start)]
        lines = contribution_lines(table.loc[names], jacobian)
        largest_um = max(line.peak_to_peak_um for line in lines)
        for line, colour in zip(lines, lb.figures.PALETTE, strict=False):
            is_large = line.peak_to_peak_um >= largest_um / 3.0
            _line_with_band(row[0] if is_large else row[1], line, colour)
        row[0].set_title(f"{title}: the largest")
        row[1].set_title(f"{title}: the others")
    for axes in panels.flat:
        axes.set_xlabel("angle of the bar (°)")
        axes.set_ylabel("contribution (µm)")
        _angles(axes)
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2)
    return figure


@dataclass(frozen=True, eq=False)
class ContributionLine:
    """What one parameter adds to the reading at 0° … 360°, shape (361,), and its u [µm]."""

    name: str
    value_um: np.ndarray
    u_um: np.ndarray
    peak_to_peak_um: float


def contribution_lines(table: pd.DataFrame, jacobian: pd.DataFrame) -> list[ContributionLine]:
    """Of every parameter in a table of estimates."""
    lines = []
    for name in table.index:
        pattern_um = 1e3 * jacobian[name].to_numpy()
        estimate = table.loc[name, "estimate"]
        peak_to_peak_um = 1e3 * abs(estimate) * np.ptp(jacobian[name])
        u_um = pattern_um * table.loc[name, "u"]
        lines.append(ContributionLine(name, pattern_um * estimate, u_um, peak_to_peak_um))
    return lines


def _line_with_band(axes: Axes, line: ContributionLine, colour: str) -> None:
    """A contribution with its 95 % band."""
    half_width_um = BAND_U * line.u_um
    axes.fill_between(
        ANGLE_DEG,
        line.value_um - half_width_um,
        line.value_um + half_width_um,
        color=colour,
        alpha=0.25,
        linewidth=0,
    )
    label = f"{on_page(line.name)}: {line.peak_to_peak_um:#.3g} µm p-p"
    axes.plot(ANGLE_DEG, line.value_um, color=colour, label=label)


def on_page(name: str) -> str:
    """E_C0YX → E_C(0Y)X."""
    return name.replace("C0YX", "C(0Y)X")


@lb.figures.styled
def with_least_squares(
    figure: Figure, fits: Mapping[str, lb.inference.LeastSquares], forces_N: np.ndarray
) -> Figure:
    """Figs. 15 and 16: the paper's own global lines, of constant and of linear compliance (Eq. 33),
    added to the package's."""
    line_forces_N = np.linspace(forces_N.min(), forces_N.max(), 51)
    middle_N = 0.5 * (forces_N.min() + forces_N.max())
    panels = [axes for axes in figure.axes if axes.get_visible()]
    for axes in panels:
        name_on_page, unit = axes.get_ylabel().removesuffix(")").split(" (", 1)
        name = name_on_page.replace("(", "").replace(")", "")
        for label, fit in fits.items():
            colour, dashes = GLOBAL[label]
            slope = fit.estimate.get(f"{name}_1", 0.0)
            values = fit.estimate[name] + slope * (line_forces_N - middle_N)
            axes.plot(
                line_forces_N,
                SHOWN[unit] * values,
                color=colour,
                linestyle=dashes,
                linewidth=1.6,
                label=f"all forces, least squares, {label}",
            )
    handles, labels = panels[0].get_legend_handles_labels()
    labels = [label.replace(", mean", ", posterior mean") for label in labels]
    labels = [label.replace("constant, ±", "constant, posterior ±") for label in labels]
    figure.legends[0].remove()
    figure.set_figheight(figure.get_figheight() + 0.5)
    figure.set_layout_engine("constrained")
    figure.legend(handles, labels, loc="outside lower center", ncols=2)
    return figure


@lb.figures.styled
def harmonics(
    recovered: Recovered, completed_um: np.ndarray, forces_N: np.ndarray, names: tuple[str, ...]
) -> Figure:
    """The recovered harmonics against force, with ± 2 u, and the completion that sets the open
    directions to zero."""
    shape = (len(forces_N), len(names))
    mean_um = recovered.mean.reshape(shape)
    u_um = recovered.sd.reshape(shape)
    completed_um = completed_um.reshape(shape)
    figure = lb.figures.new_figure(9.6, 4.4)
    panels: Any = figure.subplots(2, 4, sharex=True)
    for axes, name, mean, u, completed in zip(
        panels.flat, names, mean_um.T, u_um.T, completed_um.T, strict=True
    ):
        axes.errorbar(
            forces_N,
            mean,
            2.0 * u,
            fmt="o",
            capsize=3,
            color=lb.figures.PALETTE[0],
            label="recovered, ± 2 u",
        )
        axes.plot(
            forces_N,
            completed,
            "x",
            color=lb.figures.PALETTE[1],
            label="open directions set to zero",
        )
        middle = mean.mean()
        half_height = max(1.0, 1.1 * (np.abs(mean - middle) + 2.0 * u).max())
        axes.set_ylim(middle - half_height, middle + half_height)
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
