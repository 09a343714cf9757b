"""Parameters: forest with the prior beside, compliance against force, and a corner plot that can be read."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import corner as corner_library
import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ldbb_bayes.errors import check_known
from ldbb_bayes.inference.origin import bound_of, draws_of, record_of
from ldbb_bayes.inference.summary import priors_of
from ldbb_bayes.model.prior import compliance_unit
from ldbb_bayes.report.figures.style import ACCENT, GREY, PALETTE, axis_label, new_figure, styled
from ldbb_bayes.report.rounding import value_and_uncertainty
from ldbb_bayes.units import display_name, display_unit

__all__ = ["compliance_against_force", "corner", "forest"]

Array = NDArray[Any]
# Direct compliances, rotations for moments, scale gains, squareness.
_CORNER = (r"C_([XYZ])\1.", r"C_([ABC])\1.", r"E_([XYZ])\1\d", r"E_[ABC]0..")
_MOST = 8


@styled
def forest(posterior: xr.DataTree) -> Figure:
    """Every parameter's 50 % and 95 % interval, from its prior mean in units of its prior sd (posterior sd when flat), the prior
    beside."""
    group, (prior_sd, prior_mean) = posterior["posterior"], priors_of(posterior)
    names = list(record_of(posterior)["model"]["groups"])
    figure = new_figure(8.4, 1.1 + 0.27 * len(names))
    axes = figure.subplots()
    rows = np.arange(len(names))[::-1]
    texts = []
    for row, name in zip(rows, names, strict=True):
        draws = group[name].to_numpy().ravel()
        known = prior_sd[name]
        scale, middle = float(draws.std()) if known is None else known, prior_mean.get(name, 0.0)
        low, first, last, high = (np.quantile(draws, [0.025, 0.25, 0.75, 0.975]) - middle) / scale
        if known is not None:
            before = (np.quantile(posterior["prior"][name].to_numpy(), [0.025, 0.975]) - middle) / scale
            axes.plot(before, [row, row], color="#D9D9D9", linewidth=7, solid_capstyle="butt", zorder=1)
        axes.plot([low, high], [row, row], color=ACCENT, linewidth=1.4, zorder=2)
        axes.plot([first, last], [row, row], color=ACCENT, linewidth=3.6, solid_capstyle="butt", zorder=3)
        axes.plot((draws.mean() - middle) / scale, row, "o", color="white", markeredgecolor=ACCENT, markersize=3.6, zorder=4)
        factor, unit = display_unit(group[name].attrs["unit"])
        value, spread = value_and_uncertainty(float(draws.mean()) * factor, float(draws.std()) * factor)
        texts.append(f"{value} ± {spread} {unit}")
    axes.set_yticks(rows, [display_name(name) for name in names])
    flat = all(prior_sd[name] is None for name in names)
    value = "(value − prior mean)" if any(prior_mean.values()) else "value"
    axes.set_xlabel(f"{value} / {'posterior' if flat else 'prior'} sd")
    right = axes.secondary_yaxis("right")
    right.set_yticks(rows, texts)
    right.tick_params(length=0)
    right.spines["right"].set_visible(False)
    axes.set_ylim(-0.7, len(names) - 0.3)
    title = "95 % and 50 % credible intervals" + ("" if flat else "; grey: 95 % of the prior") + "; dot and right: mean, ± 1 sd"
    axes.set_title(title)
    return figure


@styled
def compliance_against_force(posterior: xr.DataTree) -> Figure:
    """C(F) of every kept compliance with 50 % and 95 % bands over the tested forces."""
    bound = bound_of(posterior)
    beta, _ = draws_of(posterior, bound)
    forces = bound.setting.force_N
    force = np.linspace(forces.min(), forces.max(), 80) if np.ptp(forces) > 0 else forces[0] * np.array([0.95, 1.05])
    kinds = bound.compliances
    columns = min(3, len(kinds))
    height = int(np.ceil(len(kinds) / columns))
    figure = new_figure(9.0, 2.6 * height + 0.3)
    every = np.atleast_1d(figure.subplots(height, columns, squeeze=False)).ravel()
    for j, (axes, kind) in enumerate(zip(every, kinds, strict=False)):
        factor, text = axis_label(kind.label, compliance_unit(kind))
        value = beta @ np.stack([bound.compliance_at(f)[j] for f in force], axis=1) * factor
        for prob, alpha in ((0.95, 0.22), (0.5, 0.4)):
            low, high = np.quantile(value, [(1 - prob) / 2, (1 + prob) / 2], axis=0)
            axes.fill_between(force, low, high, color=ACCENT, alpha=alpha, linewidth=0, label=f"{100 * prob:g} %")
        axes.plot(force, value.mean(axis=0), color=ACCENT, label="mean")
        foot = axes.get_xaxis_transform()
        axes.plot(forces, np.zeros_like(forces), "^", color=PALETTE[1], markersize=5, clip_on=False, transform=foot)
        axes.axhline(0.0, color=GREY, linewidth=0.8)
        axes.set_ylabel(text)
        axes.set_xlabel("force (N)")
    for axes in every[len(kinds) :]:
        axes.set_visible(False)
    every[0].legend(loc="best")
    figure.suptitle("Compliance against force (triangles: tested forces)", fontsize=9.5)
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
    columns, labels = [], []
    for name in names:
        factor, label = axis_label(name, group[name].attrs["unit"])
        draws = group[name].to_numpy().ravel() * factor
        if np.ptp(draws) > 0:
            columns.append(draws)
            labels.append(label.replace(" (", "\n("))
    size = 1.55 * len(columns) + 0.6
    figure = Figure(figsize=(size, size))
    corner_library.corner(
        np.column_stack(columns),
        fig=figure,
        labels=labels,
        color=PALETTE[0],
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
    figure.suptitle("Joint posterior: contours hold 39 % and 86 % (1 and 2 sd)", fontsize=9.5)
    return figure
