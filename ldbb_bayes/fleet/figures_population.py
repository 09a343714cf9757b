"""Figures of a population: its machines, alone and with what the others tell of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ldbb_bayes.fleet.pooled import PooledMachine, PooledParameter, Population
from ldbb_bayes.report.figures.style import ACCENT, GREY, PALETTE, axis_label, new_figure, styled
from ldbb_bayes.units import units_for

__all__ = ["machine_chart"]

_MOST, _NAMED, _COLUMNS = 60, 24, 3
_ALONE, _ODD, _BAND = "#9DB8CC", PALETTE[1], "#EDEDED"


@styled
def machine_chart(population: Population) -> Figure:
    """Every parameter's machines in order of their estimates, alone and pooled, before the population.

    Of more than 60 machines those that do not belong are drawn, and others evenly along the order.
    """
    parameters = list(population.parameters.values())
    columns = min(_COLUMNS, len(parameters))
    rows = -(-len(parameters) // columns)
    shown = min(len(population.machine), _MOST)
    height = max(2.2, 0.6 + 0.14 * min(shown, _NAMED) if shown <= _NAMED else 0.6 + 0.065 * shown)
    figure = new_figure(3.4 * columns + 0.4, height * rows + 0.9)
    every = figure.subplots(rows, columns, squeeze=False).ravel()
    with units_for(population.sizes()):
        for axes, parameter in zip(every, parameters, strict=False):
            _panel(axes, population, parameter)
    for axes in every[len(parameters) :]:
        axes.set_visible(False)
    percent = f"{100 * population.ci_prob:g} %"
    handles = [
        Line2D([], [], color=_ALONE, marker="o", markersize=3, linewidth=1.4, label=f"alone, {percent}"),
        Line2D([], [], color=ACCENT, marker="o", markersize=3, linewidth=1.4, label=f"pooled, {percent}"),
        *([Line2D([], [], color=_ODD, marker="o", markersize=3, label="does not belong")] if population.not_belonging else []),
        Line2D([], [], color=GREY, linewidth=1.0, label="mean of the population"),
        Patch(color=_BAND, label=f"{percent} of the next machine"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=min(len(handles), 2 * columns))
    drawn = "" if len(population.machine) <= _MOST else f", {_MOST} shown"
    comma = ",\n" if columns == 1 else ", "
    figure.suptitle(
        f"{len(population.machine)} machines at {population.reference_force_N:g} N{comma}in order of their estimates{drawn}",
        fontsize=9.5,
    )
    return figure


def _panel(axes: Axes, population: Population, parameter: PooledParameter) -> None:
    name = parameter.name
    chosen = _chosen(list(population.machine.values()), name)
    factor, label = axis_label(name, parameter.unit)
    axes.axvspan(*(factor * end for end in parameter.next.interval), color=_BAND, zorder=0)
    axes.axvline(factor * parameter.mean.mean, color=GREY, linewidth=1.0, zorder=1)
    width, size = (1.4, 3.0) if len(chosen) <= _NAMED else (0.9, 1.8)
    for row, own in enumerate(chosen):
        for shift, found, colour in (
            (0.2, own.alone[name], "#F0BE9C" if own.flag else _ALONE),
            (-0.2, own.estimate[name], _ODD if own.flag else ACCENT),
        ):
            axes.plot([factor * end for end in found.interval], [row + shift] * 2, color=colour, linewidth=width, zorder=2)
            axes.plot(factor * found.mean, row + shift, "o", color=colour, markersize=size, zorder=3)
    named = len(chosen) <= _NAMED
    axes.set_yticks(*_ticks(chosen, named))
    axes.tick_params(axis="y", labelsize=6.5, length=0)
    axes.grid(visible=False, axis="y")
    axes.set_ylim(-0.8, len(chosen) - 0.2)
    axes.locator_params(axis="x", nbins=5)
    axes.set_xlabel(label)


def _ticks(chosen: Sequence[PooledMachine], named: bool) -> tuple[list[int], list[str]]:
    """Names of all machines where there is room, else of those that do not belong, two rows apart."""
    places: list[int] = []
    for row, own in enumerate(chosen):
        if named or (own.flag and (not places or row - places[-1] > 1)):
            places.append(row)
    return places, [_short(chosen[row].name) for row in places]


def _short(name: str) -> str:
    return name if len(name) <= 16 else f"…{name[-15:]}"


def _chosen(every: list[PooledMachine], name: str) -> list[PooledMachine]:
    """In order of the estimate; too many are thinned evenly, those that do not belong kept as far as there is room."""
    ordered = sorted(every, key=lambda own: (own.estimate[name].mean, own.name))
    if len(ordered) <= _MOST:
        return ordered
    odd = sorted((k for k, own in enumerate(ordered) if own.flag), key=lambda k: ordered[k].p_value or 0.0)[: _MOST // 2]
    others = [k for k in range(len(ordered)) if k not in set(odd)]
    kept = {others[int(place)] for place in np.linspace(0, len(others) - 1, _MOST - len(odd)).round()}
    return [ordered[k] for k in sorted(kept | set(odd))]
