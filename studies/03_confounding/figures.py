"""The figure of study 03: intervals by model, and what the plans would have known."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.figure import Figure

import ldbb_bayes as lb

FITS = {"least squares": "#000000", "without form": "#8C8C8C", "with form": lb.figures.PALETTE[0]}
VERDICTS = {
    "confounded": lb.figures.PALETTE[1],
    "prior-limited": lb.figures.PALETTE[4],
    "identified": lb.figures.PALETTE[2],
}
OTHERWISE = ("− 1 u", "+ 1 u")


@lb.figures.styled
def confounding(
    parameters: Mapping[str, Any], plans: Mapping[str, Any], completions: Mapping[str, Any]
) -> Figure:
    """Top: 95 % intervals by model, of C_CCY with other completions too; bottom: predicted standard
    uncertainties by plan."""
    figure = lb.figures.new_figure(11.0, 5.6)
    panels: Any = figure.subplots(2, 6, width_ratios=[1.0] * 5 + [1.5])
    for axes, (name, entry) in zip(panels[0], parameters.items(), strict=True):
        for x, (label, colour) in enumerate(FITS.items()):
            _interval(axes, x, entry[label], colour, "o")
        ticks = ["white\nnoise", "no\nform", "with\nform"]
        if name == "C_CCY":
            for x, label in enumerate(OTHERWISE, start=3):
                _interval(axes, x, completions[label]["off"], FITS["with form"], "s")
            ticks += [f"4θ:\n{label.replace(' ', '', 1)}" for label in OTHERWISE]
            axes.axhline(0.0, color="#8C8C8C", linewidth=0.6)
        axes.axhline(entry["published"], color=lb.figures.PALETTE[1], linewidth=1.0)
        axes.set_xticks(range(len(ticks)), ticks)
        axes.set_xlim(-0.6, len(ticks) - 0.4)
        axes.set_title(f"{_shown(name)}\n({entry['unit']})")
        axes.tick_params(labelsize=7)
    for axes, (name, entry) in zip(panels[1], parameters.items(), strict=True):
        rows = range(len(plans))[::-1]
        colours = [VERDICTS[plan[name]["verdict"]] for plan in plans.values()]
        axes.barh(rows, [plan[name]["sd"] for plan in plans.values()], color=colours)
        axes.set_yticks(
            rows, list(plans) if axes is panels[1, 0] else [""] * len(plans), fontsize=7
        )
        axes.set_xlabel(f"u ({entry['unit']})")
        axes.tick_params(labelsize=7)
    figure.suptitle(
        "Truncation off. Top: 95 % intervals by model; squares: with form, cos 4θ at the lowest"
        " force changed by one u; line: published\nBottom: predicted u of the same six circles by"
        " plan; orange: confounded, green: identified",
        fontsize=9,
    )
    return figure


def _interval(axes: Any, x: float, fit: Mapping[str, float], colour: str, marker: str) -> None:
    axes.errorbar(
        x, fit["mean"], 1.96 * fit["sd"], fmt=marker, color=colour, capsize=3, markersize=4
    )


def _shown(name: str) -> str:
    return name.replace("C0YX", "C(0Y)X")
