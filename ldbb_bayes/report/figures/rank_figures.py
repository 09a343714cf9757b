"""Figure of simulation-based calibration: ranks of true values among posterior draws.

Simulation-based calibration simulates many campaigns with known parameters and fits each of them.
The rank of a true value is the number of random draws from the posterior that are below the true
value. If the method is right, the ranks of many campaigns are uniformly distributed.
"""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ldbb_bayes.analysis.calibration import LOG_LIKELIHOOD, Validation
from ldbb_bayes.report.figures.style import ACCENT, GREY, PALETTE, band, panels, styled
from ldbb_bayes.units import display_name

__all__ = ["rank_ecdf"]

_COLUMNS = 4


@styled
def rank_ecdf(validation: Validation) -> Figure:
    """Draw how far the ranks of every quantity deviate from a uniform distribution.

    Each curve is the distribution function of one quantity's ranks, minus the distribution function
    of uniform ranks. A rank is the number of posterior draws that are below the true value in one
    simulated campaign. If the ranks of all quantities are uniformly distributed, the probability
    that all curves lie inside the grey bands is ``validation.prob``.

    Parameters
    ----------
    validation : Validation
        Ranks of simulated campaigns, as `calibrate` returns them.

    Returns
    -------
    Figure
        A Matplotlib figure with a panel for each quantity.

    Examples
    --------
    >>> fast = lb.HybridModel.first(0)
    >>> validation = lb.calibrate(fast, campaign, replicates=10, draws=19)
    >>> figure = lb.figures.rank_ecdf(validation)
    >>> len(figure.axes) == len(validation.names)
    True
    """
    names = validation.names
    figure, all_axes = panels(len(names), _COLUMNS, 1.15, 0.7, sharex=True, sharey=True)
    level = np.arange(1, validation.draws + 1) / (validation.draws + 1)
    lower, upper = validation.band
    for k, (axes, name) in enumerate(zip(all_axes, names, strict=True)):
        title = "ln likelihood" if name == LOG_LIKELIHOOD else display_name(name)
        colour = ACCENT
        if name in validation.outside:
            title += ": outside"
            colour = PALETTE[1]
        band(axes, level, (lower - level, upper - level), GREY, 0.25, step="mid")
        axes.axhline(0.0, color=GREY, linewidth=0.6)
        difference = validation.ecdf(name) - level
        axes.plot(level, difference, color=colour, drawstyle="steps-mid")
        axes.set_title(title, fontsize=8)
        axes.set_xticks([0.0, 0.5, 1.0])
        if k % _COLUMNS == 0:
            axes.set_ylabel("difference (1)")
        if k + _COLUMNS >= len(names):
            axes.set_xlabel("rank share (1)")
            axes.tick_params(labelbottom=True)
    figure.suptitle(
        f"Ranks of the truth among draws, minus uniform: {validation.replicates} simulated"
        f" campaigns,\nsampler {validation.sampler}; band: {100 * validation.prob:g} % for all"
        " together"
    )
    return figure
