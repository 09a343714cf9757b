"""Uncertainty budgets as bars."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from ldbb_bayes.analysis.budget import Budget
from ldbb_bayes.model.information import NOISE, OWN
from ldbb_bayes.model.wording import term_words
from ldbb_bayes.report.figures.style import TERM_COLOURS, new_figure, styled
from ldbb_bayes.report.rounding import round_uncertainty
from ldbb_bayes.units import display_name, display_unit

__all__ = ["budget_bars", "source_words"]

_VISIBLE = 0.005


@styled
def budget_bars(budgets: Mapping[str, Budget]) -> Figure:
    """Share of every source in the variance of every parameter; right: its standard uncertainty."""
    names = list(budgets)
    figure = new_figure(8.6, 1.5 + 0.27 * len(names))
    axes = figure.subplots()
    rows = np.arange(len(names))[::-1]
    start = np.zeros(len(names))
    for term in (term for term in TERM_COLOURS if any(budget.share(term) >= _VISIBLE for budget in budgets.values())):
        share = np.array([budgets[name].share(term) for name in names])
        axes.barh(rows, share, left=start, color=TERM_COLOURS[term], height=0.72, label=source_words(term))
        start = start + share
    axes.set_yticks(rows, [display_name(name) for name in names])
    axes.set_ylim(-0.6, len(names) - 0.4)
    axes.set_xlim(0.0, 1.0)
    axes.set_xlabel("share of the variance (1)")
    axes.grid(axis="y", visible=False)
    right = axes.secondary_yaxis("right")
    right.set_yticks(rows, [_told(budgets[name]) for name in names])
    right.tick_params(length=0)
    right.spines["right"].set_visible(False)
    figure.legend(loc="outside lower center", ncols=4)
    axes.set_title("Uncertainty budgets; right: standard uncertainty u")
    return figure


def source_words(term: str) -> str:
    """What a term of a budget is called."""
    return {NOISE: "reading noise", OWN: "prior of the parameters"}.get(term, term_words(term))


def _told(budget: Budget) -> str:
    factor, unit = display_unit(budget.unit)
    return f"{round_uncertainty(budget.u * factor)[0]} {unit}"
