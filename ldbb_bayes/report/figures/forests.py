"""Parameters: forest with the prior beside, compliance against force, corner plot, chains, differences between campaigns."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import corner as corner_library
import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.stats import rankdata

from ldbb_bayes.errors import check_known
from ldbb_bayes.inference.posterior import bound_of, diagnose, draws_of, priors_of, record_of
from ldbb_bayes.model.prior import compliance_unit
from ldbb_bayes.report.figures.style import (
    ACCENT,
    GREY,
    LIGHT,
    PALETTE,
    axis_label,
    band,
    named_rows,
    new_figure,
    panels,
    right_labels,
    styled,
)
from ldbb_bayes.units import display_unit, ranked, value_and_uncertainty

__all__ = ["chains", "compliance_against_force", "corner", "difference_forest", "forest"]

Array = NDArray[Any]
# Direct compliances, rotations for moments, scale gains, squareness.
_CORNER = (r"C_([XYZ])\1.", r"C_([ABC])\1.", r"E_([XYZ])\1\d", r"E_[ABC]0..")
_MOST = 8
_BINS = 20


@styled
def forest(posterior: xr.DataTree) -> Figure:
    """Every parameter's 50 % and 95 % interval, from its prior mean in units of its prior sd (posterior sd when flat), the prior
    beside."""
    group, (prior_sd, prior_mean) = posterior["posterior"], priors_of(posterior)
    names = list(record_of(posterior)["model"]["groups"])
    figure, axes, rows = named_rows(names, 8.4, 1.1)
    texts = []
    for row, name in zip(rows, names, strict=True):
        draws, known, middle = group[name].to_numpy().ravel(), prior_sd[name], prior_mean.get(name, 0.0)
        scale = float(draws.std()) if known is None else known
        low, first, last, high = (np.quantile(draws, [0.025, 0.25, 0.75, 0.975]) - middle) / scale
        if known is not None:
            before = (np.quantile(posterior["prior"][name].to_numpy(), [0.025, 0.975]) - middle) / scale
            axes.plot(before, [row, row], color=LIGHT, linewidth=7, solid_capstyle="butt", zorder=1)
        axes.plot([low, high], [row, row], color=ACCENT, linewidth=1.4, zorder=2)
        axes.plot([first, last], [row, row], color=ACCENT, linewidth=3.6, solid_capstyle="butt", zorder=3)
        axes.plot((draws.mean() - middle) / scale, row, "o", color="white", markeredgecolor=ACCENT, markersize=3.6, zorder=4)
        texts.append(_value(float(draws.mean()), float(draws.std()), group[name].attrs["unit"]))
    flat = all(prior_sd[name] is None for name in names)
    value = "(value − prior mean)" if any(prior_mean.values()) else "value"
    axes.set_xlabel(f"{value} / {'posterior' if flat else 'prior'} sd")
    right_labels(axes, rows, texts)
    prior = "" if flat else "; grey: 95 % of the prior"
    axes.set_title(f"95 % and 50 % credible intervals{prior}; dot and right: mean, ± 1 sd")
    return figure


def _value(mean: float, sd: float, unit: str) -> str:
    factor, label = display_unit(unit)
    value, u = value_and_uncertainty(mean * factor, sd * factor)
    return f"{value} ± {u} {label}"


@styled
def compliance_against_force(posterior: xr.DataTree) -> Figure:
    """C(F) of every kept compliance with 50 % and 95 % bands over the tested forces."""
    bound = bound_of(posterior)
    beta, _ = draws_of(posterior, bound)
    forces = bound.setting.force_N
    force = np.linspace(forces.min(), forces.max(), 80) if np.ptp(forces) > 0 else forces[0] * np.array([0.95, 1.05])
    figure, every = panels(len(bound.compliances), min(3, len(bound.compliances)), 9.0, 2.6, 0.3)
    for j, (axes, kind) in enumerate(zip(every, bound.compliances, strict=True)):
        factor, text = axis_label(kind.label, compliance_unit(kind))
        value = beta @ np.stack([bound.compliance_at(f)[j] for f in force], axis=1) * factor
        for prob, alpha in ((0.95, 0.22), (0.5, 0.4)):
            low, high = np.quantile(value, [(1 - prob) / 2, (1 + prob) / 2], axis=0)
            band(axes, force, low, high, ACCENT, alpha, f"{100 * prob:g} %")
        axes.plot(force, value.mean(axis=0), color=ACCENT, label="mean")
        foot = axes.get_xaxis_transform()
        axes.plot(forces, np.zeros_like(forces), "^", color=PALETTE[1], markersize=5, clip_on=False, transform=foot)
        axes.axhline(0.0, color=GREY, linewidth=0.8)
        axes.set_ylabel(text)
        axes.set_xlabel("force (N)")
    every[0].legend(loc="best")
    figure.suptitle("Compliance against force (triangles: tested forces)")
    return figure


@styled
def corner(posterior: xr.DataTree, names: Sequence[str] | None = None) -> Figure:
    """Pairwise posterior of a few parameters.

    Parameters
    ----------
    names : sequence of str, optional
        Default: the direct compliances, C_CCY, and the geometric errors that share their patterns, where the model has them.

    Raises
    ------
    InputError
        For a parameter the posterior does not have.
    """
    group = posterior["posterior"]
    if names is None:
        fallback = list(record_of(posterior)["model"]["groups"])
        names = [name for kind in _CORNER for name in fallback if re.fullmatch(kind, name)][:_MOST] or fallback[:6]
    check_known("parameter", names, [str(name) for name in group.data_vars])
    columns = {}
    for name in names:
        factor, label = axis_label(name, group[name].attrs["unit"])
        draws = group[name].to_numpy().ravel() * factor
        if np.ptp(draws) > 0:
            columns[label.replace(" (", "\n(")] = draws
    size = 1.55 * len(columns) + 0.6
    figure = Figure(figsize=(size, size))
    corner_library.corner(
        np.column_stack(list(columns.values())),
        fig=figure,
        labels=list(columns),
        color=ACCENT,
        levels=(0.393, 0.865),
        smooth=1.0,
        bins=30,
        plot_datapoints=False,
        max_n_ticks=3,
        labelpad=0.14,
        label_kwargs={"fontsize": 8.5},
        hist_kwargs={"linewidth": 1.2},
    )
    for axes in figure.axes:
        axes.grid(visible=False)
        axes.tick_params(labelsize=7)
    figure.subplots_adjust(left=0.13, bottom=0.13, right=0.98, top=0.94, wspace=0.08, hspace=0.08)
    figure.suptitle("Joint posterior: contours hold 39 % and 86 % (1 and 2 sd)")
    return figure


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
        names = ranked(known, lambda name: -diagnose(group[name].to_numpy())[0])[:5]
    check_known("parameter", names, known)
    walkers = int(record_of(posterior)["sampler"]["walkers"])
    figure = new_figure(9.0, 0.6 + 1.45 * len(names))
    every = figure.subplots(len(names), 2, squeeze=False, width_ratios=(3, 2))
    for (left, right), name in zip(every, names, strict=True):
        factor, label = axis_label(name, group[name].attrs["unit"])
        _trace_and_ranks(left, right, group[name].to_numpy() * factor, walkers)
        left.set_ylabel(label.replace(" (", "\n("))
        right.set_ylabel("relative\nfrequency (1)")
    every[0, 0].set_title("Trace of the slowest parameters: median and 90 % of the walkers")
    every[0, 1].set_title("Ranks: level when ensembles agree")
    every[-1, 0].set_xlabel("stored step (1)")
    every[-1, 1].set_xlabel("rank among all draws (1)")
    every[0, 1].legend(loc="upper right", ncols=2)
    return figure


def _trace_and_ranks(left: Axes, right: Axes, draws: Array, walkers: int) -> None:
    by_walker = draws.reshape(len(draws), walkers, -1)
    ranks = rankdata(draws).reshape(draws.shape)
    edges = np.linspace(0.5, draws.size + 0.5, _BINS + 1)
    for k, colour in zip(range(len(draws)), PALETTE * 9, strict=False):
        low, median, high = np.quantile(by_walker[k], [0.05, 0.5, 0.95], axis=0)
        band(left, np.arange(len(median)), low, high, colour, 0.10)
        left.plot(median, color=colour, linewidth=1.0)
        counts = np.histogram(ranks[k], edges)[0]
        right.stairs(counts / counts.mean(), edges, baseline=None, color=colour, linewidth=1.0, label=f"ensemble {k + 1}")
    right.axhline(1.0, color="black", linewidth=0.6)
    right.set_ylim(0.0, 2.0)


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
    figure, axes, rows = named_rows(names, 8.6, 1.3, 0.27 * max(1.0, 0.6 * len(differences)))
    row_of = dict(zip(names, rows, strict=True))
    for k, (campaign, table) in enumerate(differences.items()):
        shift, colour = 0.28 * (0.5 * (len(differences) - 1) - k), PALETTE[k % 7]
        for name, own in table.iterrows():
            row, label = row_of[name] + shift, campaign if name == names[0] else None
            axes.plot(
                [own["ci_low"] / own["sd"], own["ci_high"] / own["sd"]], [row, row], color=colour, linewidth=1.6, label=label
            )
            axes.plot(own["difference"] / own["sd"], row, "o", color=colour, markersize=3.6)
    axes.axvline(0.0, color=GREY, linewidth=0.9)
    axes.set_xlabel("difference / its standard uncertainty (1)")
    first = next(iter(differences.values()))
    texts = {str(name): _value(own["difference"], own["sd"], own["unit"]) for name, own in first.iterrows()}
    right_labels(axes, rows, [texts.get(name, "") for name in names])
    if len(differences) > 1:
        figure.legend(loc="outside lower center", ncols=3)
    whose = " of the second" if len(differences) > 1 else ""
    axes.set_title(f"Difference to the first campaign, {100 * ci_prob:g} % interval; right: difference ± u{whose}")
    return figure
