"""What a design found: where tests tell most, how good numbers of tests are, and the intervals to expect."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ldbb_bayes.analysis.designed import Design
from ldbb_bayes.analysis.places import place_words
from ldbb_bayes.report.figures.style import ACCENT, GREY, PALETTE, axis_label, new_figure, styled
from ldbb_bayes.units import display_name

__all__ = ["efficiency", "expected_widths", "information", "trade_off"]

_SHOWN = 8
_ALIKE = 0.02
_LONG = 60
_CURVES = 6


@styled
def information(design: Design) -> Figure:
    """Sensitivity of the criterion to one more test, against force, and the tests chosen."""
    figure = new_figure(8.0, 4.6)
    axes, below = figure.subplots(2, 1, sharex=True, height_ratios=[2.6, 1.0])
    curves = _different(design)
    for k, (place, (own, alike)) in enumerate(curves.items()):
        others = f" ({alike} more alike)" if alike else ""
        label = f"{_place(place, design.columns)}{others}" if len(curves) > 1 or alike else None
        marker = "" if len(own) > 2 else "o"
        axes.plot(own["force_N"], own["sensitivity"], color=PALETTE[k % len(PALETTE)], marker=marker, label=label)
    axes.axhline(design.certificate.bound, color="black", linewidth=0.9, linestyle="--", label="bound: no candidate above it")
    axes.set_ylim(0.0, 1.12 * max(design.certificate.bound, design.certificate.max_sensitivity))
    axes.set_ylabel("sensitivity (1)" if design.criterion in ("eig", "d") else "sensitivity (units of the criterion)")
    axes.set_title("How much the criterion gains per share of circles at a force, and the circles chosen")
    lines, labels = axes.get_legend_handles_labels()
    figure.legend(lines, labels, loc="outside lower center", ncols=2 if max(map(len, labels)) < _LONG else 1)
    _stems(below, design)
    return figure


def _different(design: Design) -> dict[Any, tuple[pd.DataFrame, int]]:
    """Sensitivities against force at every clocking and radius, the highest first; those much alike counted, not shown."""
    by_place = design.sensitivity.groupby(list(design.columns), sort=False)
    groups = [(place, own.sort_values("force_N")) for place, own in by_place]
    found: dict[Any, tuple[pd.DataFrame, int]] = {}
    for place, own in sorted(groups, key=lambda group: -group[1]["sensitivity"].max()):
        values = own["sensitivity"].to_numpy()
        like = next((p for p, (shown, _) in found.items() if _close(shown["sensitivity"].to_numpy(), values, design)), None)
        if like is not None:
            found[like] = (found[like][0], found[like][1] + 1)
        elif len(found) < _SHOWN:
            found[place] = (own, 0)
    return found


def _close(one: Any, other: Any, design: Design) -> bool:
    return len(one) == len(other) and bool(np.abs(one - other).max() < _ALIKE * design.certificate.bound)


def _stems(axes: Axes, design: Design) -> None:
    """Numbers of circles per force: recommended above, equal steps and others below one another."""
    rows = [("recommended", design.tests, ACCENT), (design.baseline.name, design.baseline.tests, GREY)]
    rows += [(other.name, other.tests, PALETTE[1 + k % 5]) for k, other in enumerate(design.others)]
    for row, (_, tests, colour) in enumerate(rows):
        force, count = np.unique([test.force_N for test in tests], return_counts=True)
        axes.plot(force, np.full(len(force), -row), "o", color=colour, markersize=6)
        for x, n in zip(force, count, strict=True):
            if n > 1:
                axes.annotate(f"{n}×", (x, -row), xytext=(0, 5), textcoords="offset points", ha="center", fontsize=7)
    axes.set_yticks([-row for row in range(len(rows))], [name for name, *_ in rows])
    axes.set_ylim(-len(rows) + 0.5, 0.8)
    axes.grid(axis="y", visible=False)
    axes.set_xlabel("force (N)")


def _place(place: Any, columns: tuple[str, ...]) -> str:
    own = dict(zip(columns, place, strict=True))
    first = [part for part in place_words(own).split(", ") if not part.startswith(("work ball", "tool ball", "R "))]
    return ", ".join([*first, f"balls {own['work_ball_deg']:g}°/{own['tool_ball_deg']:g}°, R {own['radius_mm']:g} mm"])


@styled
def efficiency(design: Design) -> Figure:
    """Efficiency against the number of tests: the best whole tests, and equal steps."""
    figure = new_figure(5.6, 3.8)
    axes = figure.subplots()
    table = design.trade_off
    if _nothing(axes, table):
        return figure
    axes.plot(table["tests"], table["efficiency"], "o-", color=ACCENT, label="best whole tests")
    axes.plot(table["tests"], table["efficiency_equal_steps"], "s--", color=PALETTE[1], label="equal steps of force")
    for k, other in enumerate(design.others):
        axes.plot(len(other.tests), other.efficiency, "D", color=PALETTE[2 + k % 4], label=other.name)
    axes.set_ylim(0.0, 1.05)
    axes.set_xlabel("number of circles (1)")
    axes.set_ylabel(f"efficiency by criterion {design.criterion} (1)")
    axes.set_title("1: the best shares of as many circles")
    axes.legend(loc="lower right")
    return figure


@styled
def trade_off(design: Design) -> Figure:
    """Expected sd of the parameters of interest against the number of tests, and what no number falls below."""
    names = _widest_changes(design)
    columns = min(3, len(names))
    figure = new_figure(3.3 * columns + 0.3, 0.5 + 2.5 * -(-len(names) // columns))
    panels = figure.subplots(-(-len(names) // columns), columns, squeeze=False)
    table = design.trade_off
    for axes in list(panels.flat)[len(names) :]:
        axes.set_visible(False)
    for axes, name in zip(panels.flat, names, strict=False):
        if _nothing(axes, table):
            continue
        entry = design.forecast.expected[name]
        factor, label = axis_label(name, entry.unit)
        axes.plot(table["tests"], table[f"sd_{name}"] * factor, "o-", color=ACCENT)
        axes.plot(len(design.tests), entry.sd * factor, "o", color="black", markersize=7, fillstyle="none")
        axes.axhline(entry.floor_sd * factor, color=GREY, linestyle="--", linewidth=0.9)
        axes.set_ylim(0.0, 1.15 * factor * max(table[f"sd_{name}"].max(), entry.sd))
        axes.set_xlabel("number of circles (1)")
        axes.set_ylabel(f"u of {label}")
    figure.suptitle(
        "Expected standard uncertainty; ringed: recommended;\ndashed: what more such circles cannot go below", fontsize=9.5
    )
    return figure


def _widest_changes(design: Design) -> list[str]:
    """Parameters of interest that more tests would narrow most."""
    expected = design.forecast.expected
    return sorted(design.parameters, key=lambda name: expected[name].floor_sd / expected[name].sd)[:_CURVES]


@styled
def expected_widths(design: Design) -> Figure:
    """Expected standard uncertainty of every parameter as a share of its prior sd: recommended, baseline, others, floor."""
    expected = design.forecast.expected
    names = list(expected)
    figure = new_figure(7.6, 1.2 + 0.27 * len(names))
    axes = figure.subplots()
    rows = np.arange(len(names))[::-1]
    scale = np.array([_scale(design, name) for name in names])

    def shares(values: list[float]) -> Any:
        return np.array(values) / scale

    axes.barh(rows, shares([expected[n].sd for n in names]), height=0.62, color=ACCENT, label="recommended")
    axes.plot(shares([expected[n].floor_sd for n in names]), rows, "|", color="white", markersize=9, markeredgewidth=1.6)
    compared = [design.baseline, *design.others]
    for k, judged in enumerate(compared):
        values = shares([judged.forecast.expected[n].sd for n in names])
        axes.plot(
            values, rows, "o" if not k else "D", color="black" if not k else PALETTE[k % 6], markersize=4, label=judged.name
        )
    of_interest = set(design.parameters)
    axes.set_yticks(rows, [f"{display_name(n)}{'' if n in of_interest else ' (nuisance)'}" for n in names])
    axes.set_xscale("log")
    axes.grid(axis="y", visible=False)
    against = "prior sd" if np.isfinite(next(iter(expected.values())).prior_sd) else f"that of {design.baseline.name}"
    axes.set_xlabel(f"expected u / {against} (1); white: more of the recommended circles would not go below")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=4)
    return figure


def _scale(design: Design, name: str) -> float:
    entry = design.forecast.expected[name]
    return entry.prior_sd if np.isfinite(entry.prior_sd) else design.baseline.forecast.expected[name].sd


def _nothing(axes: Axes, table: pd.DataFrame) -> bool:
    if table.empty:
        axes.text(0.5, 0.5, "no trade-off was asked for", ha="center", va="center", transform=axes.transAxes)
        axes.set_axis_off()
    return bool(table.empty)
