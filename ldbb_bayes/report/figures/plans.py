"""What a design found: where tests tell most, how good numbers of tests are, and the intervals to expect."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ldbb_bayes.analysis.design.design import Design
from ldbb_bayes.report.figures.style import (
    ACCENT,
    GREY,
    PALETTE,
    axis_label,
    legend_below,
    named_rows,
    new_figure,
    nothing,
    panels,
    styled,
)
from ldbb_bayes.report.wording import place_words
from ldbb_bayes.units import ranked

__all__ = ["efficiency", "expected_widths", "information", "trade_off"]

_SHOWN = 8
_ALIKE = 0.02
_LONG = 60
_CURVES = 6
_NOT_ASKED = "no trade-off was asked for"


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
    legend_below(figure, axes, 2 if max(map(len, axes.get_legend_handles_labels()[1])) < _LONG else 1)
    _stems(below, design)
    return figure


def _different(design: Design) -> dict[Any, tuple[pd.DataFrame, int]]:
    """Sensitivities against force at every clocking and radius, the highest first; those much alike counted, not shown."""
    by_place = design.sensitivity.groupby(list(design.columns), sort=False)
    groups = [(place, own.sort_values("force_N")) for place, own in by_place]
    found: dict[Any, tuple[pd.DataFrame, int]] = {}
    for place, own in ranked(groups, lambda group: float(group[1]["sensitivity"].max())):
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
    rows = [("recommended", design.table.groupby("force_N")["count"].sum(), ACCENT)]
    for k, own in enumerate(design.compared):
        rows.append((own.name, own.tests["force_N"].value_counts().sort_index(), PALETTE[1 + (k - 1) % 5] if k else GREY))
    for row, (_, counts, colour) in enumerate(rows):
        force, count = counts.index.to_numpy(dtype=float), counts.to_numpy()
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
    balls = f"balls {own.pop('work_ball_deg'):g}°/{own.pop('tool_ball_deg'):g}°, R {own.pop('radius_mm'):g} mm"
    return ", ".join([*filter(None, [place_words(own)]), balls])


@styled
def efficiency(design: Design) -> Figure:
    """Efficiency against the number of tests: the best whole tests, and equal steps."""
    figure = new_figure(5.6, 3.8)
    axes = figure.subplots()
    table = design.trade_off
    if table.empty:
        nothing(axes, _NOT_ASKED)
        return figure
    axes.plot(table["tests"], table["efficiency"], "o-", color=ACCENT, label="best whole tests")
    axes.plot(table["tests"], table["efficiency_equal_steps"], "s--", color=PALETTE[1], label="equal steps of force")
    for k, other in enumerate(design.compared[1:]):
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
    expected, table = design.expected, design.trade_off
    # Those that more tests would narrow most.
    names = ranked(design.parameters, lambda name: -expected[name].floor_sd / expected[name].sd)[:_CURVES]
    columns = min(3, len(names))
    figure, every = panels(len(names), columns, 3.3 * columns + 0.3, 2.5, 0.5)
    for axes, name in zip(every, names, strict=True):
        if table.empty:
            nothing(axes, _NOT_ASKED)
            continue
        factor, label = axis_label(name, expected[name].unit)
        axes.plot(table["tests"], table[f"sd_{name}"] * factor, "o-", color=ACCENT)
        axes.plot(design.table["count"].sum(), expected[name].sd * factor, "o", color="black", markersize=7, fillstyle="none")
        axes.axhline(expected[name].floor_sd * factor, color=GREY, linestyle="--", linewidth=0.9)
        axes.set_ylim(0.0, 1.15 * factor * max(table[f"sd_{name}"].max(), expected[name].sd))
        axes.set_xlabel("number of circles (1)")
        axes.set_ylabel(f"u of {label}")
    figure.suptitle("Expected standard uncertainty; ringed: recommended;\ndashed: what more such circles cannot go below")
    return figure


@styled
def expected_widths(design: Design) -> Figure:
    """Expected standard uncertainty of every parameter as a share of its prior sd: recommended, baseline, others, floor."""
    expected = design.expected
    proper = bool(np.isfinite(next(iter(expected.values())).prior_sd))
    scale = expected if proper else design.baseline

    def shares(forecast: Any, size: str = "sd") -> list[float]:
        return [getattr(forecast[n], size) / (scale[n].prior_sd if proper else scale[n].sd) for n in expected]

    figure, axes, rows = named_rows(list(expected), 7.6, 1.2)
    axes.barh(rows, shares(expected), height=0.62, color=ACCENT, label="recommended")
    axes.plot(shares(expected, "floor_sd"), rows, "|", color="white", markersize=9, markeredgewidth=1.6)
    for k, judged in enumerate(design.compared):
        style: dict[str, Any] = {"marker": "D", "color": PALETTE[k % 6]} if k else {"marker": "o", "color": "black"}
        axes.plot(shares(judged.expected), rows, linestyle="", markersize=4, label=judged.name, **style)
    labels = [text.get_text() for text in axes.get_yticklabels()]
    axes.set_yticks(
        rows, [f"{label}{'' if n in design.parameters else ' (nuisance)'}" for n, label in zip(expected, labels, strict=True)]
    )
    axes.set_xscale("log")
    axes.grid(axis="y", visible=False)
    against = "prior sd" if proper else f"that of {design.compared[0].name}"
    axes.set_xlabel(f"expected u / {against} (1); white: more of the recommended circles would not go below")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=4)
    return figure
