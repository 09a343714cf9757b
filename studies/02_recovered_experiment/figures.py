"""Figs. 11 and 12, which the package has no figure of its own for: predictions from neighbouring pairs of forces."""

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


def part_um(estimate: Mapping[str, float], force_N: float, *, start: str) -> np.ndarray:
    """Reading at 0° … 360° from the parameters whose names start so, tool offsets left out, shape (361,) [µm]."""
    jacobian = lb.hybrid_jacobian(lb.Machine(), lb.Circle(), np.deg2rad(ANGLE_DEG), force_N)
    names = [name for name in jacobian.columns if name.startswith(start) and name not in OFFSETS]
    return 1e3 * (jacobian[names] @ pd.Series(estimate)[names]).to_numpy()


def upper_pair(pairs: Mapping[Pair, lb.LeastSquares], test: str) -> Pair:
    """The pair in which a test is the upper force; of the lowest force, its only pair."""
    return next((pair for pair in pairs if pair[1] == test), next(iter(pairs)))


@lb.figures.styled
def local_traces(campaign: lb.Campaign, pairs: Mapping[Pair, lb.LeastSquares]) -> Figure:
    """Fig. 11 (b): readings and what each pair of neighbouring forces predicts for its two circles."""
    figure = lb.figures.new_figure(9.6, 5.0)
    panels: Any = figure.subplots(2, 3, sharex=True)
    for axes, test, colour in zip(panels.flat, campaign.tests, lb.figures.force_colours(campaign.forces_N.tolist()), strict=True):
        order = np.argsort(test.angle_deg)
        axes.plot(test.angle_deg[order], test.reading_um[order], color=colour, linewidth=2.4, alpha=0.45, label="readings")
        for pair, found in pairs.items():
            if test.name in pair:
                style = "--" if test.name == pair[0] else "-"
                label = f"from {' and '.join(name.lstrip('f0') for name in pair)} N"
                axes.plot(test.angle_deg[order], found.predicted_um[test.name][order], style, color="black", lw=0.9, label=label)
        axes.set_title(f"{test.force_N:g} N")
        axes.legend(fontsize=7)
        _angles(axes)
    for axes in panels[:, 0]:
        axes.set_ylabel("reading (µm)")
    for axes in panels[1]:
        axes.set_xlabel("angle of the bar (°)")
    return figure


@lb.figures.styled
def local_contributions(campaign: lb.Campaign, pairs: Mapping[Pair, lb.LeastSquares]) -> Figure:
    """Fig. 12: both parts, compliance and geometry at every force, from the pair in which it is the upper one."""
    figure = lb.figures.new_figure(9.6, 3.6)
    panels: Any = figure.subplots(1, 3)
    for test, colour in zip(campaign.tests, lb.figures.force_colours(campaign.forces_N.tolist()), strict=True):
        estimate = pairs[upper_pair(pairs, test.name)].estimate
        elastic, geometric = (part_um(estimate, float(test.force_N or 0.0), start=start) for start in ("C_", "E_"))
        for axes, values in zip(panels, (elastic + geometric, elastic, geometric), strict=True):
            axes.plot(ANGLE_DEG, values, color=colour, label=f"{test.force_N:g} N")
    for axes, title in zip(panels, ("Both", "Compliance", "Geometry"), strict=True):
        axes.set_title(title)
        axes.set_xlabel("angle of the bar (°)")
        _angles(axes)
    panels[0].set_ylabel("contribution (µm)")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=6)
    return figure


@lb.figures.styled
def harmonics(mean: np.ndarray, sd: np.ndarray, zero: np.ndarray, forces_N: np.ndarray, names: tuple[str, ...]) -> Figure:
    """The recovered harmonics against force, with ± 2 u, and the completion that sets the open directions to zero."""
    figure = lb.figures.new_figure(9.6, 4.4)
    panels: Any = figure.subplots(2, 4, sharex=True)
    for k, (axes, name) in enumerate(zip(panels.flat, names, strict=True)):
        axes.errorbar(
            forces_N, mean[:, k], 2.0 * sd[:, k], fmt="o", capsize=3, color=lb.figures.PALETTE[0], label="recovered, ± 2 u"
        )
        axes.plot(forces_N, zero[:, k], "x", color=lb.figures.PALETTE[1], label="open directions set to zero")
        middle, half = mean[:, k].mean(), max(1.0, 1.2 * np.abs(mean[:, k] - mean[:, k].mean()).max(), 2.3 * sd[:, k].max())
        axes.set_ylim(middle - half, middle + half)
        axes.set_title(name)
    for axes in panels[:, 0]:
        axes.set_ylabel("coefficient (µm)")
    for axes in panels[1]:
        axes.set_xlabel("force (N)")
    figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


def _angles(axes: Axes) -> None:
    axes.set_xlim(0.0, 360.0)
    axes.set_xticks(range(0, 361, 90))
