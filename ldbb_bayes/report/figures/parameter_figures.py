"""Figures of the parameters of a posterior.

The figures show credible intervals, compliance against force, and pairs of parameters.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping, Sequence
from importlib.resources import files
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ldbb_bayes.errors import check_known
from ldbb_bayes.inference.force_curves import force_curves, prior_changes
from ldbb_bayes.inference.posterior import bound_of, curves_of, record_of
from ldbb_bayes.inference.summary import interval_numbers, priors_of
from ldbb_bayes.model.parameter_kinds import compliance_unit
from ldbb_bayes.report.figures import style
from ldbb_bayes.report.figures.style import ACCENT, FAINT, GREY, band, panels, styled
from ldbb_bayes.results import Array
from ldbb_bayes.units import (
    display_name,
    display_unit,
    inside_name,
    is_compliance_or_slope,
    is_slope,
    plus_minus,
)

__all__ = ["WORDS", "compliance_against_force", "corner", "forest"]

_CATALOGUE = files("ldbb_bayes.report") / "templates" / "words_en.toml"
#: English texts in the figures of the test certificate. The keys are the names of the texts.
WORDS: Mapping[str, str] = MappingProxyType(
    tomllib.loads(_CATALOGUE.read_text(encoding="utf-8"))["figures"]
)
# Regular expressions for the names of the parameters that a corner plot shows by default: direct
# compliances, rotations caused by moments, scale errors, and squareness errors. A corner plot shows
# pairs of parameters.
_CORNER_PARAMETERS = (r"C_([XYZ])\1.", r"C_([ABC])\1.", r"E_([XYZ])\1\d", r"E_[ABC]0..")
_MOST_IN_CORNER = 8
# Largest number of parameters in a corner plot if the posterior has none of the parameters that the
# plot shows by default.
_MOST_WITHOUT_PATTERN = 6
_CURVE_DRAWS = 1500
# Largest number of intervals between labels of the force on panels that stand four or five in a row
_FORCES_ON_A_NARROW_PANEL = 3
# Empty space between the 95 % band of a curve and the frame of its panel, as a fraction of the
# panel's height.
_ROOM_ABOVE = 0.1


# ---- figure of credible intervals


class _FigureRow(NamedTuple):
    """One row of the figure of credible intervals. A row shows one quantity.

    The quantity's random draws from the posterior and from the prior are in internal units (mm, N,
    rad).
    """

    label: str
    unit: str
    #: random draws from the posterior of the quantity that this row of the figure shows, shape
    #: (draws,)
    draws: Array
    #: random draws from the prior of the quantity that this row of the figure shows; None if the
    #: row shows no prior
    prior_draws: Array | None


@styled
def forest(posterior: xr.DataTree) -> Figure:
    """Draw the 95 % and 50 % credible intervals of every parameter, in one panel for each unit.

    Separate panels show the change of each compliance C(F) over the tested forces F; slopes, which
    are the coefficients of this change, are not drawn. Faint lines show the 95 % intervals of the
    priors. The texts at the right state the value ± U (k = 2), or the 95 % interval if the
    distribution is skewed.

    Parameters
    ----------
    posterior : DataTree
        Posterior from `sample`, `load` or `average`.

    Returns
    -------
    Figure
        A Matplotlib figure with a panel for each unit and a row for each parameter.

    Examples
    --------
    >>> figure = lb.figures.forest(posterior)
    >>> figure.axes[0].get_xlabel()
    'value (nm/N)'
    >>> [label.get_text() for label in figure.axes[0].get_yticklabels()]
    ['C_XXX', 'C_XYX', 'C_YYY']
    """
    rows_by_panel = _forest_panels(posterior)
    heights = [len(rows) + 0.2 for rows in rows_by_panel.values()]
    figure = style.new_figure(style.WIDTH, 0.35 + 0.19 * sum(heights) + 0.4 * len(heights))
    all_axes = figure.subplots(len(heights), 1, squeeze=False, height_ratios=heights)[:, 0]
    has_prior = False
    for axes, (label, rows) in zip(all_axes, rows_by_panel.items(), strict=True):
        _draw_intervals(axes, rows)
        axes.set_xlabel(label)
        has_prior = has_prior or any(row.prior_draws is not None for row in rows)
    title = "95 % and 50 % intervals; dot: mean; right: value ± U (k = 2) or 95 % interval"
    if has_prior:
        title += "\nFaint line: 95 % of the prior, as far as the panel goes"
    figure.suptitle(title)
    return figure


def _forest_panels(posterior: xr.DataTree) -> dict[str, list[_FigureRow]]:
    """Return a dict with the rows of each panel of the figure of credible intervals.

    The keys are the labels of the panels' axes, and each value is a list of rows. Panels with
    compliances come first, then panels with changes of compliances with force, then panels with
    geometric errors.
    """
    compliances: dict[str, list[_FigureRow]] = {}
    geometry: dict[str, list[_FigureRow]] = {}
    group = posterior["posterior"]
    prior_sd, _ = priors_of(posterior)
    for name in record_of(posterior)["model"]["groups"]:
        if is_slope(name):
            continue
        prior_draws = None
        if prior_sd[name] is not None:
            prior_draws = np.asarray(posterior["prior"][name]).ravel()
        unit = group[name].attrs["unit"]
        row = _FigureRow(display_name(name), unit, np.asarray(group[name]).ravel(), prior_draws)
        panels_of_kind = compliances if is_compliance_or_slope(name) else geometry
        label = f"value ({display_unit(unit)[1]})"
        panels_of_kind.setdefault(label, []).append(row)
    changes: dict[str, list[_FigureRow]] = {}
    curves = force_curves(posterior)
    drawn_priors = prior_changes(posterior)
    forces = f"{curves.smallest_force_N:.4g} N to {curves.largest_force_N:.4g} N"
    for name, curve in curves.compliances.items():
        label = f"change from {forces} ({display_unit(curve.unit)[1]})"
        row = _FigureRow(f"Δ{display_name(name)}", curve.unit, curve.change, drawn_priors.get(name))
        changes.setdefault(label, []).append(row)
    return compliances | changes | geometry


def _draw_intervals(axes: Axes, rows: Sequence[_FigureRow]) -> None:
    """Draw in one panel the credible intervals of quantities that have the same unit.

    ``axes`` is the panel. Each quantity has one row.
    """
    heights = style.name_rows(axes, [row.label for row in rows])
    texts = []
    for height, row in zip(heights, rows, strict=True):
        factor, _ = display_unit(row.unit)
        summary = interval_numbers(row.draws, 0.95)
        interval = (summary["ci_low"], summary["ci_high"])
        quartiles = np.quantile(row.draws, [0.25, 0.75]) * factor
        ends = [interval[0] * factor, interval[1] * factor]
        axes.plot(ends, [height, height], color=ACCENT, linewidth=1.4)
        axes.plot(quartiles, [height, height], color=ACCENT, linewidth=4.0, solid_capstyle="butt")
        mean = summary["mean"] * factor
        axes.plot(mean, height, "o", color="white", markeredgecolor=ACCENT, markersize=3.6)
        texts.append(plus_minus(summary["mean"], summary["sd"], interval, row.unit))
    axes.axvline(0.0, color=GREY, linewidth=0.8)
    # Fix the limits of the panel's horizontal scale before the credible intervals of the priors are
    # drawn, because these may be much wider than the credible intervals of the posterior.
    axes.set_xlim(axes.get_xlim())
    for height, row in zip(heights, rows, strict=True):
        if row.prior_draws is not None:
            prior_interval = (
                np.quantile(row.prior_draws, [0.025, 0.975]) * display_unit(row.unit)[0]
            )
            axes.plot(prior_interval, [height, height], color=FAINT, linewidth=0.8, zorder=1)
    style.right_labels(axes, heights, texts)


# ---- figure of compliance against force


@styled
def compliance_against_force(posterior: xr.DataTree, words: Mapping[str, str] = WORDS) -> Figure:
    """Draw every compliance C(F) against the force F, with a 95 % band.

    The curves extend from the smallest to the largest force tested.

    Parameters
    ----------
    posterior : DataTree
        Posterior from `sample`, `load` or `average`.
    words : mapping of str to str
        Texts of the figure; the keys are the names of the texts. Default: English texts.

    Returns
    -------
    Figure
        A Matplotlib figure with a panel for each compliance.

    Examples
    --------
    >>> figure = lb.figures.compliance_against_force(posterior)
    >>> [axes.get_ylabel() for axes in figure.axes]
    ['C_XXX (nm/N)', 'C_XYX (nm/N)', 'C_YYY (nm/N)',
     'C_CXY (nrad/N)', 'C_CYY (nrad/N)', 'C_CCY (µrad/(N m))']
    """
    bound = bound_of(posterior)
    tested_N = bound.setting.force_N
    force_N = _forces_to_draw(tested_N)
    curves = curves_of(posterior, force_N, _CURVE_DRAWS)
    is_roomy = len(bound.compliances) <= 6
    columns, height = _panel_grid(len(bound.compliances))
    figure, all_axes = panels(len(bound.compliances), columns, height, 0.3, sharex=True)
    for j, (axes, compliance) in enumerate(zip(all_axes, bound.compliances, strict=True)):
        factor, label = style.axis_label(compliance.label, compliance_unit(compliance))
        _draw_curve(axes, force_N, curves[:, :, j] * factor, words)
        axes.plot(
            tested_N,
            np.zeros_like(tested_N),
            "^",
            label=words["tested"],
            color="black",
            markersize=4,
            clip_on=False,
            transform=axes.get_xaxis_transform(),
        )
        axes.axhline(0.0, color=GREY, linewidth=0.8)
        axes.margins(y=_ROOM_ABOVE)
        if is_roomy:
            axes.set_ylabel(label, fontsize=9)
            axes.tick_params(labelsize=8)
        else:
            axes.set_title(label, fontsize=6.5)
            axes.tick_params(labelsize=7)
            # On a panel that is so narrow more labels would run into each other.
            axes.locator_params(axis="x", nbins=_FORCES_ON_A_NARROW_PANEL)
        if j + columns >= len(all_axes):
            axes.set_xlabel(words["force"], fontsize=9 if is_roomy else 7)
            axes.tick_params(labelbottom=True)
    style.legend_below(figure, all_axes[0])
    return figure


def _panel_grid(count: int) -> tuple[int, float]:
    """Return how many panels of compliances stand in a row, and the height of a row [inch].

    ``count`` is the number of all panels. Up to eight panels have no more than two rows.
    """
    if count <= 6:
        return 3, 1.7
    if count <= 8:
        return 4, 1.35
    return 5, 1.2


def _forces_to_draw(tested_N: Array) -> Array:
    """Return the forces [N] at which the curves of compliance against force are drawn.

    ``tested_N`` holds the force of each test. If all tests have the same force, the curves extend
    from 5 % below this force to 5 % above it.
    """
    if np.ptp(tested_N) > 0:
        return np.linspace(tested_N.min(), tested_N.max(), 31)
    return tested_N[0] * np.array([0.95, 1.05])


def _draw_curve(axes: Axes, force_N: Array, curves: Array, words: Mapping[str, str]) -> None:
    """Draw the mean and the 95 % band of a compliance as functions of force.

    ``curves``, shape (draws, forces), holds the compliance for each random draw from the posterior,
    at the forces ``force_N``. ``words`` holds the texts of the legend.
    """
    limits = np.quantile(curves, [0.025, 0.975], axis=0)
    band(axes, force_N, limits, ACCENT, 0.3, label=words["interval"])
    axes.plot(force_N, curves.mean(axis=0), color=ACCENT, label=words["mean"])


# ---- corner plot, which shows pairs of parameters


@styled
def corner(posterior: xr.DataTree, names: Sequence[str] | None = None) -> Figure:
    """Draw the joint posterior distribution of each pair of the chosen parameters (corner plot).

    Parameters
    ----------
    posterior : DataTree
        Posterior from `sample`, `load` or `average`.
    names : sequence of str, optional
        Names of the parameters. Default: up to eight direct compliances, rotations caused by
        moments (such as C_CCY), scale errors and squareness errors. If the posterior has none of
        these, the default is the first six parameters. Parameters that have the same value in all
        draws are left out.

    Returns
    -------
    Figure
        A Matplotlib figure with n × n panels for n parameters.

    Raises
    ------
    InputError
        The posterior lacks one of the parameters.

    Examples
    --------
    >>> figure = lb.figures.corner(posterior, ["C_XXX", "C_YYY"])
    >>> len(figure.axes)
    4
    >>> lb.figures.corner(posterior, ["C_XXY"])
    Traceback (most recent call last):
        ...
    ldbb_bayes.errors.InputError: ...
    """
    # Import the package corner only when it is needed, because it loads pyplot.
    from corner import corner as draw_corner

    group = posterior["posterior"]
    if names is None:
        names = _parameters_of_corner(list(record_of(posterior)["model"]["groups"]))
    names = [inside_name(name) for name in names]
    check_known("parameter", names, [str(name) for name in group.data_vars])
    draws_by_label = {}
    for name in names:
        factor, label = style.axis_label(name, group[name].attrs["unit"])
        draws = np.asarray(group[name]).ravel() * factor
        if np.ptp(draws) > 0:
            draws_by_label[label.replace(" (", "\n(")] = draws
    size = 1.55 * len(draws_by_label) + 0.6
    figure = Figure(figsize=(size, size))
    options: dict[str, Any] = {"color": ACCENT, "plot_datapoints": False, "max_n_ticks": 3}
    draw_corner(
        np.column_stack(list(draws_by_label.values())),
        fig=figure,
        labels=list(draws_by_label),
        # Probabilities inside the contour lines of the corner plot. For a bivariate normal
        # distribution, the contours lie 1 and 2 standard deviations from the mean.
        levels=(0.393, 0.865),
        smooth=1.0,
        bins=30,
        labelpad=0.14,
        **options,
    )
    for axes in figure.axes:
        axes.grid(visible=False)
        axes.tick_params(labelsize=7)
    figure.subplots_adjust(left=0.13, bottom=0.13, right=0.98, top=0.94, wspace=0.08, hspace=0.08)
    figure.suptitle("Joint posterior: contours hold 39 % and 86 % (1 and 2 sd)")
    return figure


def _parameters_of_corner(parameters: Sequence[str]) -> list[str]:
    """Return the names of the parameters that a corner plot shows by default.

    ``parameters`` are the names of all parameters of the posterior.
    """
    chosen: list[str] = []
    for pattern in _CORNER_PARAMETERS:
        chosen += [name for name in parameters if re.fullmatch(pattern, name)]
    if chosen:
        return chosen[:_MOST_IN_CORNER]
    return list(parameters[:_MOST_WITHOUT_PATTERN])
