"""The figure of study 03: intervals by model, and what the plans would have known."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.axes import Axes
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
    for column, (name, entry) in enumerate(parameters.items()):
        top = panels[0, column]
        _intervals_by_model(top, entry)
        if name == "C_CCY":
            _intervals_by_completion(top, completions)
        top.set_xlim(-0.6, len(top.get_xticks()) - 0.4)
        top.set_title(f"{name.replace('C0YX', 'C(0Y)X')}\n({entry['unit']})")
        bottom = panels[1, column]
        _uncertainty_by_plan(bottom, name, plans)
        bottom.set_xlabel(f"u ({entry['unit']})")
    places = range(len(plans))[::-1]
    panels[1, 0].set_yticks(places, list(plans), fontsize=7)
    for axes in panels.flat:
        axes.tick_params(labelsize=7)
    figure.suptitle(
        "Truncation off. Top: 95 % intervals by model; squares: with form, cos 4θ at the lowest"
        " force changed by one u; line: published\nBottom: predicted u of the same six circles by"
        " plan; orange: confounded, green: identified",
        fontsize=9,
    )
    return figure


def _intervals_by_model(axes: Axes, entry: Mapping[str, Any]) -> None:
    """Of one parameter, and a line at the published value."""
    for x, (label, colour) in enumerate(FITS.items()):
        _interval(axes, x, entry[label], colour, "o")
    axes.axhline(entry["published"], color=lb.figures.PALETTE[1], linewidth=1.0)
    axes.set_xticks(range(len(FITS)), ["white\nnoise", "no\nform", "with\nform"])


def _intervals_by_completion(axes: Axes, completions: Mapping[str, Any]) -> None:
    """Of C_CCY with form, right of those by model, and a line at zero."""
    labels = [label.get_text() for label in axes.get_xticklabels()]
    for x, label in enumerate(OTHERWISE, start=len(FITS)):
        _interval(axes, x, completions[label]["off"], FITS["with form"], "s")
        labels.append(f"4θ:\n{label.replace(' ', '', 1)}")
    axes.axhline(0.0, color="#8C8C8C", linewidth=0.6)
    axes.set_xticks(range(len(labels)), labels)


def _uncertainty_by_plan(axes: Axes, name: str, plans: Mapping[str, Any]) -> None:
    """Of one parameter, coloured by its verdict; the first plan on top."""
    places = range(len(plans))[::-1]
    colours = [VERDICTS[plan[name]["verdict"]] for plan in plans.values()]
    axes.barh(places, [plan[name]["sd"] for plan in plans.values()], color=colours)
    axes.set_yticks(places, [""] * len(plans), fontsize=7)


def _interval(axes: Axes, x: float, fit: Mapping[str, float], colour: str, marker: str) -> None:
    """95 % interval around the mean."""
    half_width = 1.96 * fit["sd"]
    axes.errorbar(x, fit["mean"], half_width, fmt=marker, color=colour, capsize=3, markersize=4)
