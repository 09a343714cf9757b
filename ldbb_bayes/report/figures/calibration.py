"""Rank-ECDF plots of a simulation-based calibration."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ldbb_bayes.analysis.validation import LOG_LIKELIHOOD, Validation
from ldbb_bayes.report.figures.style import ACCENT, GREY, PALETTE, new_figure, styled
from ldbb_bayes.units import display_name

__all__ = ["rank_ecdf"]

_COLUMNS = 6


@styled
def rank_ecdf(validation: Validation) -> Figure:
    """Empirical distribution of every quantity's ranks, minus the uniform one, and the band all of them share."""
    rows = -(-len(validation.names) // _COLUMNS)
    figure = new_figure(9.5, 0.9 + 1.35 * rows)
    panels = figure.subplots(rows, _COLUMNS, squeeze=False, sharex=True, sharey=True)
    level = np.arange(1, validation.draws + 1) / (validation.draws + 1)
    lower, upper = validation.band
    for axes, name in zip(panels.flat, validation.names, strict=False):
        outside = name in validation.outside
        axes.fill_between(level, lower - level, upper - level, color=GREY, alpha=0.25, linewidth=0, step="mid")
        axes.axhline(0.0, color=GREY, linewidth=0.6)
        axes.plot(level, validation.ecdf(name) - level, color=PALETTE[1] if outside else ACCENT, drawstyle="steps-mid")
        shown = "ln likelihood" if name == LOG_LIKELIHOOD else display_name(name)
        axes.set_title(f"{shown}: outside" if outside else shown)
    for axes in panels.flat[len(validation.names) :]:
        axes.set_visible(False)
    for axes in panels[:, 0]:
        axes.set_ylabel("difference (1)")
    for column in panels.T:
        axes = [panel for panel in column if panel.get_visible()][-1]
        axes.set_xlabel("rank share (1)")
        axes.tick_params(labelbottom=True)
    figure.suptitle(
        f"Ranks of the truth among posterior draws, minus uniform: {validation.replicates} simulated campaigns, "
        f"{validation.sampler}; band: {100 * validation.prob:g} % for all quantities together",
        fontsize=9.5,
    )
    return figure
