"""What the data can tell apart: correlations, prior against posterior, aliases, and what each nuisance costs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ldbb_bayes.analysis.budget import Budget
from ldbb_bayes.analysis.identifiability import Identifiability
from ldbb_bayes.model.information import NOISE, OWN
from ldbb_bayes.report.figures.style import (
    GREY,
    PALETTE,
    band,
    heat_map,
    named_rows,
    new_figure,
    nothing,
    panels,
    right_labels,
    stacked,
    styled,
)
from ldbb_bayes.report.wording import source_words, term_words
from ldbb_bayes.units import display_name, display_unit, round_uncertainty

__all__ = ["alias_map", "budget_bars", "correlation_map", "nuisance_costs", "prior_and_posterior"]

Array = NDArray[Any]
_SEEN = 0.05
_VERDICT_COLOURS = {"identified": PALETTE[2], "prior-limited": PALETTE[4], "confounded": PALETTE[1]}


@styled
def correlation_map(identifiability: Identifiability) -> Figure:
    """Posterior correlations of parameters and shared nuisances, in blocks; nuisances without any are left out."""
    table, own = identifiability.correlation, list(identifiability.parameters)
    names = [*own, *(name for name in table.index if name not in own and table.loc[name, own].abs().max() > _SEEN)]
    figure = new_figure(1.9 + 0.24 * len(names), 1.2 + 0.24 * len(names))
    axes = figure.subplots()
    labels = [display_name(name) if name in own else name.replace("_", " ") for name in names]
    values = table.loc[names, names].to_numpy()
    image = heat_map(axes, values, labels, labels, cmap="RdBu_r", vmin=-1.0, vmax=1.0, aspect="equal")
    axes.tick_params(axis="x", rotation=90)
    kinds = [("slope" if name[0] == "C" and name.count("_") == 2 else name[0]) if name in own else "nuisance" for name in names]
    for edge in (i - 0.5 for i in range(1, len(kinds)) if kinds[i] != kinds[i - 1]):
        axes.axhline(edge, color="black", linewidth=0.8)
        axes.axvline(edge, color="black", linewidth=0.8)
    figure.colorbar(image, ax=axes, shrink=0.6, label="posterior correlation (1)")
    axes.set_title("Compliances, slopes, geometric errors; nuisances last")
    return figure


@styled
def prior_and_posterior(identifiability: Identifiability) -> Figure:
    """Density of every parameter before and after the readings, in its unit; the colour is the verdict's."""
    entries = list(identifiability.parameters.values())
    figure, every = panels(len(entries), 5, 9.6, 1.6, 0.7)
    for axes, entry in zip(every, entries, strict=True):
        factor, unit = display_unit(entry.unit)
        proper = bool(np.isfinite(entry.prior_sd))
        mean, sd = entry.mean * factor, entry.sd * factor
        centre, reach = (entry.prior_mean * factor, entry.prior_sd * factor) if proper else (mean, sd)
        wide = np.linspace(centre - 3.2 * reach, centre + 3.2 * reach, 201)
        value = np.sort(np.concatenate([wide, np.linspace(-4.0, 4.0, 161) * sd + mean]))
        if proper:
            band(axes, value, 0.0, _bell(value, centre, reach), GREY, 0.35)
        axes.plot(value, _bell(value, mean, sd), color=_VERDICT_COLOURS[entry.verdict])
        axes.set_yticks([])
        axes.spines["left"].set_visible(False)
        axes.set_title(f"{display_name(entry.name)}: {entry.verdict}", color=_VERDICT_COLOURS[entry.verdict])
        axes.set_xlabel(f"{unit}; sd {round_uncertainty(sd)[0]}")
    figure.suptitle("Prior (grey) and posterior, each scaled to its peak; without truncation")
    return figure


def _bell(value: Array, mean: float, sd: float) -> Array:
    density = np.exp(-0.5 * ((value - mean) / sd) ** 2)
    return density / density.max()


@styled
def alias_map(identifiability: Identifiability) -> Figure:
    """How far one prior sd of a nuisance moves each estimate when it is left out, in posterior sd of the parameter."""
    table = identifiability.alias
    moved = table.to_numpy() / np.array([entry.sd for entry in identifiability.parameters.values()])[:, None]
    shown = [j for j in range(moved.shape[1]) if np.abs(moved[:, j]).max() > _SEEN]
    figure = new_figure(2.4 + 0.46 * max(len(shown), 4), 1.4 + 0.27 * len(table))
    axes = figure.subplots()
    if not shown:
        nothing(axes, "no nuisance moves any estimate")
        return figure
    across = [str(table.columns[j]).replace("_", " ") for j in shown]
    down = [display_name(str(name)) for name in table.index]
    image = heat_map(axes, moved[:, shown], across, down, cmap="RdBu_r", vmin=-2.0, vmax=2.0)
    axes.tick_params(axis="x", rotation=90)
    for (i, j), value in np.ndenumerate(moved[:, shown]):
        if abs(value) >= _SEEN:
            axes.text(j, i, f"{value:.1f}", ha="center", va="center", fontsize=7, color="white" if abs(value) > 1.3 else "black")
    figure.colorbar(image, ax=axes, shrink=0.6, extend="both", label="change of the estimate (posterior sd)")
    axes.set_title("Least squares without nuisances: what one prior sd of each does")
    return figure


@styled
def nuisance_costs(identifiability: Identifiability) -> Figure:
    """Fair (Shapley) shares of every parameter's variance by nuisance term; the rest is reading noise and its own prior."""
    entries = identifiability.parameters
    figure, axes, rows = named_rows(list(entries), 8.6, 1.4)
    shapley = [entry.shapley for entry in entries.values()]
    # What no nuisance takes is noise and prior together: it has the colour of a prior.
    shares = {OWN if source == NOISE else source: np.array([own[source] for own in shapley]) for source in shapley[0]}
    stacked(axes, rows, shares, lambda term: "reading noise and own prior" if term == OWN else term_words(term))
    axes.set_xlabel("share of the posterior variance (1)")
    right_labels(axes, rows, [f"{_size(entry.sd, entry.unit)}, {entry.verdict}" for entry in entries.values()])
    figure.legend(loc="outside lower center", ncols=4)
    axes.set_title("What each nuisance costs; right: posterior sd and verdict")
    return figure


@styled
def budget_bars(budgets: Mapping[str, Budget]) -> Figure:
    """Share of every source in the variance of every parameter; right: its standard uncertainty."""
    figure, axes, rows = named_rows(list(budgets), 8.6, 1.5)
    terms = dict.fromkeys(line.term for budget in budgets.values() for line in budget.contributions)
    shares = {term: np.array([budget.share(term) for budget in budgets.values()]) for term in terms}
    stacked(axes, rows, shares, source_words)
    axes.set_xlabel("share of the variance (1)")
    right_labels(axes, rows, [_size(budget.u, budget.unit) for budget in budgets.values()])
    figure.legend(loc="outside lower center", ncols=4)
    axes.set_title("Uncertainty budgets; right: standard uncertainty u")
    return figure


def _size(u: float, unit: str) -> str:
    factor, label = display_unit(unit)
    return f"{round_uncertainty(u * factor)[0]} {label}"
