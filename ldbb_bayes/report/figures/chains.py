"""How the sampler ran: traces of the ensembles and rank histograms."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.stats import rankdata

from ldbb_bayes.errors import check_known
from ldbb_bayes.inference.origin import record_of
from ldbb_bayes.inference.posterior import diagnose
from ldbb_bayes.report.figures.style import PALETTE, axis_label, new_figure, styled

__all__ = ["chains"]

Array = NDArray[Any]
_BINS = 20


@styled
def chains(posterior: xr.DataTree, names: Sequence[str] | None = None) -> Figure:
    """Trace (median and 90 % of the walkers of each ensemble at every stored step) and ranks, worst parameters first.

    Parameters
    ----------
    names : sequence of str, optional
        Default: the five parameters with the smallest bulk ESS.
    """
    group = posterior["posterior"]
    known = [str(name) for name in group.data_vars]
    if names is None:
        worst = {name: diagnose(group[name].to_numpy())[0] for name in known}
        names = sorted(known, key=worst.__getitem__)[:5]
    check_known("parameter", names, known)
    walkers = int(record_of(posterior)["sampler"]["walkers"])
    figure = new_figure(9.0, 0.6 + 1.45 * len(names))
    panels = figure.subplots(len(names), 2, squeeze=False, width_ratios=(3, 2))
    for (left, right), name in zip(panels, names, strict=True):
        factor, label = axis_label(name, group[name].attrs["unit"])
        draws = group[name].to_numpy() * factor
        by_walker = draws.reshape(len(draws), walkers, -1)
        ranks = rankdata(draws).reshape(draws.shape)
        edges = np.linspace(0.5, draws.size + 0.5, _BINS + 1)
        for k, colour in zip(range(len(draws)), PALETTE * 9, strict=False):
            low, median, high = np.quantile(by_walker[k], [0.05, 0.5, 0.95], axis=0)
            step = np.arange(len(median))
            left.fill_between(step, low, high, color=colour, alpha=0.10, linewidth=0)
            left.plot(step, median, color=colour, linewidth=1.0)
            counts = np.histogram(ranks[k], edges)[0]
            right.stairs(counts / counts.mean(), edges, baseline=None, color=colour, linewidth=1.0, label=f"ensemble {k + 1}")
        right.axhline(1.0, color="black", linewidth=0.6)
        right.set_ylim(0.0, 2.0)
        left.set_ylabel(label.replace(" (", "\n("))
        right.set_ylabel("relative\nfrequency (1)")
    panels[0, 0].set_title("Trace of the slowest parameters: median and 90 % of the walkers")
    panels[0, 1].set_title("Ranks: level when ensembles agree")
    panels[-1, 0].set_xlabel("stored step (1)")
    panels[-1, 1].set_xlabel("rank among all draws (1)")
    panels[0, 1].legend(loc="upper right", ncols=2)
    return figure
