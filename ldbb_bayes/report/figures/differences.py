"""Two campaigns side by side."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from ldbb_bayes.report.figures.style import GREY, PALETTE, new_figure, styled
from ldbb_bayes.report.rounding import value_and_uncertainty
from ldbb_bayes.units import display_name, display_unit

__all__ = ["difference_forest"]


@styled
def difference_forest(differences: Mapping[str, pd.DataFrame], *, ci_prob: float = 0.95) -> Figure:
    """Every parameter's difference to the first campaign in units of its standard uncertainty, with its interval.

    Parameters
    ----------
    differences : mapping of campaign to DataFrame
        From `differences`, each against the same first campaign.
    ci_prob : float
        Probability of their intervals.
    """
    names = list(dict.fromkeys(name for table in differences.values() for name in table.index))
    figure = new_figure(8.6, 1.3 + 0.27 * len(names) * max(1.0, 0.6 * len(differences)))
    axes = figure.subplots()
    rows = np.arange(len(names))[::-1]
    texts = [""] * len(names)
    for k, (campaign, table) in enumerate(differences.items()):
        shift = 0.28 * (0.5 * (len(differences) - 1) - k)
        for row, name in zip(rows, names, strict=True):
            if name not in table.index:
                continue
            own = table.loc[name]
            ends = [own["ci_low"] / own["sd"], own["ci_high"] / own["sd"]]
            axes.plot(ends, [row + shift] * 2, color=PALETTE[k % 7], linewidth=1.6, label=campaign if name == names[0] else None)
            axes.plot(own["difference"] / own["sd"], row + shift, "o", color=PALETTE[k % 7], markersize=3.6)
            if k == 0:
                factor, unit = display_unit(own["unit"])
                value, u = value_and_uncertainty(own["difference"] * factor, own["sd"] * factor)
                texts[names.index(name)] = f"{value} ± {u} {unit}"
    axes.axvline(0.0, color=GREY, linewidth=0.9)
    axes.set_yticks(rows, [display_name(name) for name in names])
    axes.set_ylim(-0.7, len(names) - 0.3)
    axes.set_xlabel("difference / its standard uncertainty (1)")
    right = axes.secondary_yaxis("right")
    right.set_yticks(rows, texts)
    right.tick_params(length=0)
    right.spines["right"].set_visible(False)
    if len(differences) > 1:
        figure.legend(loc="outside lower center", ncols=3)
    whose = " of the second" if len(differences) > 1 else ""
    axes.set_title(f"Difference to the first campaign, {100 * ci_prob:g} % interval; right: difference ± u{whose}")
    return figure
