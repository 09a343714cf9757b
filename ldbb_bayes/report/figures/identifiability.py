"""What the data can tell apart: correlations, prior against posterior, aliases, and what each nuisance costs."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ldbb_bayes.analysis.identified import Identifiability
from ldbb_bayes.model.information import NOISE
from ldbb_bayes.model.wording import term_words
from ldbb_bayes.report.figures.style import GREY, PALETTE, TERM_COLOURS, new_figure, styled
from ldbb_bayes.report.rounding import round_uncertainty
from ldbb_bayes.units import display_name, display_unit

__all__ = ["alias_map", "correlation_map", "nuisance_costs", "prior_and_posterior"]

Array = NDArray[Any]
_COLUMNS = 5
_VISIBLE = 0.005
_VERDICT_COLOURS = {"identified": PALETTE[2], "prior-limited": PALETTE[4], "aliased": PALETTE[1]}


@styled
def correlation_map(identifiability: Identifiability) -> Figure:
    """Posterior correlations of parameters and shared nuisances, in blocks; nuisances without any are left out."""
    table = identifiability.correlation
    own = list(identifiability.parameters)
    others = [name for name in table.index if name not in own and table.loc[name, own].abs().max() > 0.05]
    names = [*own, *others]
    figure = new_figure(1.9 + 0.24 * len(names), 1.2 + 0.24 * len(names))
    axes = figure.subplots()
    image = axes.imshow(table.loc[names, names].to_numpy(), cmap="RdBu_r", vmin=-1.0, vmax=1.0)
    labels = [display_name(name) if name in own else name.replace("_", " ") for name in names]
    axes.set_xticks(range(len(names)), labels, rotation=90)
    axes.set_yticks(range(len(names)), labels)
    axes.grid(visible=False)
    for edge in _edges(names, own):
        axes.axhline(edge - 0.5, color="black", linewidth=0.8)
        axes.axvline(edge - 0.5, color="black", linewidth=0.8)
    figure.colorbar(image, ax=axes, shrink=0.6, label="posterior correlation (1)")
    axes.set_title("Compliances, slopes, geometric errors; nuisances last")
    return figure


@styled
def prior_and_posterior(identifiability: Identifiability) -> Figure:
    """Density of every parameter before and after the readings, in its unit; the colour is the verdict's."""
    entries = list(identifiability.parameters.values())
    rows = -(-len(entries) // _COLUMNS)
    figure = new_figure(9.6, 0.7 + 1.6 * rows)
    panels = figure.subplots(rows, _COLUMNS, squeeze=False)
    for axes, entry in zip(panels.flat, entries, strict=False):
        factor, unit = display_unit(entry.unit)
        reach = 3.2 * (entry.prior_sd if np.isfinite(entry.prior_sd) else entry.sd) * factor
        centre = (entry.prior_mean if np.isfinite(entry.prior_sd) else entry.mean) * factor
        fine = np.linspace(-4.0, 4.0, 161) * entry.sd * factor + entry.mean * factor
        value = np.sort(np.concatenate([np.linspace(centre - reach, centre + reach, 201), fine]))
        colour = _VERDICT_COLOURS[entry.verdict.word]
        if np.isfinite(entry.prior_sd):
            before = _bell(value, centre, entry.prior_sd * factor)
            axes.fill_between(value, before / before.max(), color=GREY, alpha=0.35, linewidth=0)
        after = _bell(value, entry.mean * factor, entry.sd * factor)
        axes.plot(value, after / after.max(), color=colour)
        axes.set_yticks([])
        axes.spines["left"].set_visible(False)
        spread, _ = round_uncertainty(entry.sd * factor)
        axes.set_title(f"{display_name(entry.name)}: {entry.verdict.word}", color=colour)
        axes.set_xlabel(f"{unit}; sd {spread}")
    for axes in panels.flat[len(entries) :]:
        axes.set_visible(False)
    figure.suptitle("Prior (grey) and posterior, each scaled to its peak; truncation set aside", fontsize=9.5)
    return figure


@styled
def alias_map(identifiability: Identifiability) -> Figure:
    """How far one prior sd of a nuisance moves each estimate when it is left out, in posterior sd of the parameter."""
    table = identifiability.alias
    sd = np.array([entry.sd for entry in identifiability.parameters.values()])
    moved = table.to_numpy() / sd[:, None]
    shown = [j for j in range(moved.shape[1]) if np.abs(moved[:, j]).max() > 0.05]
    figure = new_figure(2.4 + 0.46 * max(len(shown), 4), 1.4 + 0.27 * len(table))
    axes = figure.subplots()
    if not shown:
        axes.text(0.5, 0.5, "no nuisance moves any estimate", ha="center", va="center", transform=axes.transAxes)
        axes.set_axis_off()
        return figure
    values = moved[:, shown]
    limit = 2.0
    image = axes.imshow(values, cmap="RdBu_r", vmin=-limit, vmax=limit, aspect="auto")
    for (i, j), value in np.ndenumerate(values):
        if abs(value) >= 0.05:
            axes.text(j, i, f"{value:.1f}", ha="center", va="center", fontsize=7, color="white" if abs(value) > 1.3 else "black")
    axes.set_xticks(range(len(shown)), [table.columns[j].replace("_", " ") for j in shown], rotation=90)
    axes.set_yticks(range(len(table)), [display_name(str(name)) for name in table.index])
    axes.grid(visible=False)
    figure.colorbar(image, ax=axes, shrink=0.6, extend="both", label="change of the estimate (posterior sd)")
    axes.set_title("Least squares without nuisances: what one prior sd of each does")
    return figure


@styled
def nuisance_costs(identifiability: Identifiability) -> Figure:
    """Fair (Shapley) shares of every parameter's variance by nuisance term; the rest is reading noise and its own prior."""
    entries = list(identifiability.parameters.values())
    sources = list(entries[0].shapley)
    figure = new_figure(8.6, 1.4 + 0.27 * len(entries))
    axes = figure.subplots()
    rows = np.arange(len(entries))[::-1]
    start = np.zeros(len(entries))
    for source in sources:
        share = np.array([entry.shapley[source] for entry in entries])
        if share.max() < _VISIBLE:
            continue
        label = "reading noise and own prior" if source == NOISE else term_words(source)
        axes.barh(rows, share, left=start, color="#D9D9D9" if source == NOISE else TERM_COLOURS[source], height=0.72, label=label)
        start = start + share
    axes.set_yticks(rows, [display_name(entry.name) for entry in entries])
    axes.set_xlim(0.0, 1.0)
    axes.set_xlabel("share of the posterior variance (1)")
    axes.grid(axis="y", visible=False)
    _sd_labels(axes, rows, identifiability)
    figure.legend(loc="outside lower center", ncols=4)
    axes.set_title("What each nuisance costs; right: posterior sd and verdict")
    return figure


def _sd_labels(axes: Axes, rows: Array, identifiability: Identifiability) -> None:
    texts = []
    for entry in identifiability.parameters.values():
        factor, unit = display_unit(entry.unit)
        texts.append(f"{round_uncertainty(entry.sd * factor)[0]} {unit}, {entry.verdict.word}")
    right = axes.secondary_yaxis("right")
    right.set_yticks(rows, texts)
    right.tick_params(length=0)
    right.spines["right"].set_visible(False)


def _edges(names: list[str], own: list[str]) -> list[int]:
    """Where one block of parameters ends and the next begins."""
    kinds = [("slope" if name[0] == "C" and name.count("_") == 2 else name[0]) if name in own else "nuisance" for name in names]
    return [i for i in range(1, len(kinds)) if kinds[i] != kinds[i - 1]]


def _bell(value: Array, mean: float, sd: float) -> Array:
    return np.exp(-0.5 * ((value - mean) / sd) ** 2)
