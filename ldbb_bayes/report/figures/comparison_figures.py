"""Figures of a comparison of models: the evidence, and parameters plotted against force.

ln B is the log Bayes factor, which states how much the readings favour one model over another. The
plots against force also show local fits. A local fit uses only the tests at two neighbouring
forces.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ldbb_bayes.analysis.comparison import Comparison
from ldbb_bayes.report.figures import style
from ldbb_bayes.report.figures.style import ACCENT, GREY, PALETTE, band, panels, styled
from ldbb_bayes.results import Array

__all__ = ["compliance_with_local_fits", "evidence", "geometry_with_local_fits"]

_LINES = ("-", "--", ":")  # Matplotlib line styles of the compared models in a figure, used in turn
# The axis of log Bayes factors may be broken, so that extreme values do not compress the others. It
# is never broken between minus this value and plus this value [nat].
_MIDDLE_NAT = 20.0
# ends (x, y) of the stroke that marks a broken axis of a figure, in units of the marker's size
_BREAK_MARK = ((-0.6, -1.0), (0.6, 1.0))


# ---- figure of the log Bayes factor under several assumptions


class _Assumption(NamedTuple):
    """Log Bayes factor of two models under one assumption, and the evidence for this assumption.

    ``error`` is the numerical standard error of the log Bayes factor [nat]. ``is_allowed`` is false
    if the readings reject the assumption.
    """

    name: str
    log_bayes_factor: float
    error: float
    #: for an assumption about the differences between circles, the log evidence under this
    #: assumption minus the log evidence under the assumption that the compared models make [nat].
    #: None for an assumption about the prior of slopes (changes of compliance with force).
    gain: float | None
    is_allowed: bool


@styled
def evidence(comparison: Comparison) -> Figure:
    """Draw the log Bayes factor ln B of two models under several assumptions.

    ln B is positive if the readings favour the second model over the first. Each row is for one
    assumption. Some assumptions are about the width of the prior of the slopes (changes of
    compliance with force), others about the differences between circles. The bar through each dot
    is the 95 % interval of ln B that results from the numerical error. A number at the right of a
    row shows how well the readings support an assumption about circles. The number is the log
    evidence under this assumption minus the log evidence under the assumption that the compared
    models make. The scale is linear. It is broken if assumptions that the readings reject give
    values far from all other values.

    Parameters
    ----------
    comparison : Comparison
        Comparison of models, as `compare` returns it.

    Returns
    -------
    Figure
        A Matplotlib figure with a row for each assumption, ln B in nat.

    Examples
    --------
    >>> constant = lb.HybridModel.first(0)
    >>> models = {"constant": constant, "linear": constant.with_degree(1)}
    >>> comparison = lb.compare(models, campaign, evidence_only=True, tolerance=0.1)
    >>> figure = lb.figures.evidence(comparison)
    >>> figure.savefig("evidence.png")
    """
    assumptions = _assumptions(comparison)
    value = np.array([assumption.log_bayes_factor for assumption in assumptions])
    allowed = np.array([assumption.is_allowed for assumption in assumptions])
    sections = _axis_sections(value, allowed)
    is_outer = [section.is_outer for section in sections]
    middle = is_outer.index(False) if False in is_outer else 0
    figure = style.new_figure(style.WIDTH, 1.1 + 0.21 * len(assumptions))
    widths = [1.0 if section.is_outer else 2.2 for section in sections]
    grid = figure.subplots(1, len(sections), squeeze=False, sharey=True, width_ratios=widths)
    all_axes = list(grid[0])
    rows = np.arange(len(assumptions))[::-1]
    for k, (axes, section) in enumerate(zip(all_axes, sections, strict=True)):
        _draw_axis_section(axes, assumptions, section)
        axes.spines["left"].set_visible(k == 0)
        if k + 1 < len(sections):
            _mark_break(axes, 1.0)
        if k > 0:
            _mark_break(axes, 0.0)
    all_axes[0].set_yticks(rows, [assumption.name for assumption in assumptions], fontsize=7)
    all_axes[middle].set_xlabel(f"ln B({comparison.sensitivity_of}) (nat)")
    style.right_labels(
        all_axes[-1], rows, [_gain_words(assumption.gain) for assumption in assumptions]
    )
    figure.suptitle(_title_of_evidence(comparison))
    return figure


def _title_of_evidence(comparison: Comparison) -> str:
    """Return the title of the figure `evidence`, which explains its rows and its right labels."""
    size = "C"
    if not comparison.slopes_of_estimate:
        size = "prior sd of C"
    return (
        f"Slope scale: sd(slope) (largest − smallest force) / {size}\n"
        "Right: evidence for the assumption (nat); open dots: below −5, the readings reject it"
    )


def _assumptions(comparison: Comparison) -> list[_Assumption]:
    """Return the log Bayes factor of the compared models under each assumption.

    Assumptions about the prior of the slopes (changes of compliance with force) come first, and
    assumptions about the differences between circles follow.
    """
    assumptions = []
    for scaled in comparison.prior_sensitivity:
        name = f"slope scale {scaled.slope_scale:g}"
        assumptions.append(_Assumption(name, scaled.log_bayes_factor, scaled.error, None, True))
    for assumed in comparison.discrepancy_sensitivity:
        assumptions.append(
            _Assumption(
                assumed.assumption,
                assumed.log_bayes_factor,
                assumed.log_bayes_factor_error,
                comparison.gain(assumed),
                comparison.allowed(assumed),
            )
        )
    return assumptions


class _AxisSection(NamedTuple):
    """One section of a broken axis for log Bayes factors, from ``low`` to ``high`` [nat].

    A broken axis consists of up to three sections; the values between the sections are not drawn.
    The middle section contains zero. The sections to its left and to its right are called outer
    sections.
    """

    low: float
    high: float
    is_outer: bool


def _axis_sections(value: Array, allowed: Array) -> list[_AxisSection]:
    """Return the sections of the broken axis for log Bayes factors, from left to right.

    ``value``, shape (n,), holds the log Bayes factors under n assumptions [nat]. ``allowed``, shape
    (n,), is false for assumptions that the readings reject. The middle section contains all values
    under assumptions that the readings do not reject, and all values between −20 and 20 nat.
    Sections without a value are left out.
    """
    near = max(_MIDDLE_NAT, 1.2 * float(np.abs(value[allowed]).max(initial=0.0)))
    left = value[value < -near]
    middle = value[np.abs(value) <= near]
    right = value[value > near]
    sections = []
    if len(left):
        outer = _axis_section(left.min(), left.max(), is_outer=True)
        sections.append(outer._replace(high=min(outer.high, -near)))
    if len(middle):
        low = middle.min(initial=0.0)
        high = middle.max(initial=0.0)
        sections.append(_axis_section(low, high, is_outer=False))
    if len(right):
        outer = _axis_section(right.min(), right.max(), is_outer=True)
        sections.append(outer._replace(low=max(outer.low, near)))
    return sections


def _axis_section(low: float, high: float, *, is_outer: bool) -> _AxisSection:
    """Return one section of the axis for log Bayes factors, from ``low`` to ``high`` [nat].

    The axis may be broken into up to three sections. Both ends of a section have a margin.
    ``is_outer`` is true for a section to the left or right of the middle section, and false for the
    middle section itself.
    """
    room = 0.08 * (high - low) or 0.2 * abs(high) or 1.0
    return _AxisSection(float(low - room), float(high + room), is_outer)


def _draw_axis_section(
    axes: Axes, assumptions: Sequence[_Assumption], section: _AxisSection
) -> None:
    """Draw the log Bayes factors that lie in one section of a broken axis.

    Each row shows the log Bayes factor under one assumption. Assumptions are about the priors of
    the models, or about the random differences between circles. The mark in a row is filled if the
    readings do not reject the assumption. Error bars extend 1.96 numerical standard errors to each
    side.
    """
    rows = np.arange(len(assumptions))[::-1]
    value = np.array([assumption.log_bayes_factor for assumption in assumptions])
    errors = np.array([float(assumption.error) for assumption in assumptions])
    half_width = 1.96 * np.nan_to_num(errors, posinf=0.0)
    allowed = np.array([assumption.is_allowed for assumption in assumptions])
    inside = (value >= section.low) & (value <= section.high)
    for is_drawn, fill_colour in ((allowed & inside, ACCENT), (~allowed & inside, "white")):
        axes.errorbar(
            value[is_drawn],
            rows[is_drawn],
            xerr=half_width[is_drawn],
            fmt="o",
            color=ACCENT,
            markerfacecolor=fill_colour,
            markersize=4,
        )
    axes.set_xlim(section.low, section.high)
    axes.locator_params(axis="x", nbins=2 if section.is_outer else 6)
    axes.xaxis.set_major_formatter(_with_minus_sign)
    axes.grid(axis="y", visible=False)
    axes.tick_params(axis="y", length=0)
    if section.low < 0.0 < section.high:
        axes.axvline(0.0, color="black", linewidth=0.8)


def _with_minus_sign(value: float, position: float) -> str:
    """Return the label of a tick at ``value``, with a minus sign in place of a hyphen.

    Matplotlib calls this function; ``position`` is the number of the tick, and is not used.
    """
    return f"{value:g}".replace("-", "−")


def _mark_break(axes: Axes, end: float) -> None:
    """Draw the mark of a broken axis at one end of a panel's horizontal axis.

    ``end`` is 0 for the left end and 1 for the right end.
    """
    axes.plot(
        end,
        0.0,
        marker=_BREAK_MARK,
        color="black",
        markersize=8,
        transform=axes.transAxes,
        clip_on=False,
    )


def _gain_words(gain: float | None) -> str:
    """Return how much the readings favour an assumption, as a string with sign, such as "+3.1".

    ``gain`` is a difference of log evidences [nat]: the one under this assumption, minus the one
    under the usual assumption, which the compared models make. The string is empty if ``gain`` is
    None.
    """
    if gain is None:
        return ""
    decimals = 1 if abs(gain) < 100.0 else 0
    return f"{gain:+.{decimals}f}".replace("-", "−")


# ---- figures of parameters against force, with local fits at neighbouring forces


@styled
def compliance_with_local_fits(comparison: Comparison) -> Figure:
    """Draw every compliance C against the force F, in all models and in local fits.

    The figure corresponds to Fig. 15 of the article on which the model is based. It shows the
    posterior mean of C in every model. It also shows a band for the average over models that differ
    in which slopes (changes of compliance with force) are zero. If the comparison has no such
    average, the band is that of the first model.

    The figure also shows local fits. A local fit uses only the tests at two neighbouring forces,
    and estimates geometric errors of its own. It therefore estimates the derivative d(F C)/dF and
    not C. A dotted line shows the same derivative for comparison. It is computed from the mean of
    the distribution of C that the band shows.

    Parameters
    ----------
    comparison : Comparison
        Comparison of models, as `compare` returns it. If the comparison was made with
        ``evidence_only``, it has no local fits, and the figure shows none.

    Returns
    -------
    Figure
        A Matplotlib figure with a panel for each compliance.

    Examples
    --------
    >>> constant = lb.HybridModel.first(0)
    >>> models = {"constant": constant, "linear": constant.with_degree(1)}
    >>> comparison = lb.compare(models, campaign, evidence_only=True, tolerance=0.1)
    >>> figure = lb.figures.compliance_with_local_fits(comparison)
    >>> figure.axes[0].get_ylabel(), len(figure.axes)
    ('C_XXX (nm/N)', 6)
    """
    curves = comparison.compliance_against_force
    source = "averaged over slope subsets"
    if not curves:
        source, model = next(iter(comparison.models.items()))
        curves = model.compliance_against_force

    def draw_band(axes: Axes, name: str, factor: float) -> None:
        """Draw the credible intervals of a compliance C as a band, and d(F C)/dF as a dotted line.

        ``name`` is the name of the compliance. ``factor`` converts its internal unit, such as mm/N,
        to the unit shown, such as nm/N.
        """
        curve = curves[name]
        force_N = np.array(curve.force_N)
        words = f"{100 * curve.prob:g} %, {source}"
        band(axes, force_N, (curve.low * factor, curve.high * factor), ACCENT, label=words)
        tangent = np.gradient(force_N * curve.mean, force_N) * factor
        label = "d(F·C)/dF: for local fits"
        axes.plot(force_N, tangent, color="black", linewidth=0.9, linestyle=":", label=label)

    return _draw_against_force(comparison, list(curves), "Compliance", draw_band)


@styled
def geometry_with_local_fits(comparison: Comparison) -> Figure:
    """Draw every geometric error against the force, in all models and in local fits.

    A local fit uses only the tests at two neighbouring forces. The figure corresponds to Fig. 16 of
    the article on which the model is based.

    Parameters
    ----------
    comparison : Comparison
        Comparison of models, as `compare` returns it. If the comparison was made with
        ``evidence_only``, it has no local fits, and the figure shows none.

    Returns
    -------
    Figure
        A Matplotlib figure with a panel for each geometric error.

    Examples
    --------
    >>> constant = lb.HybridModel.first(0)
    >>> models = {"constant": constant, "linear": constant.with_degree(1)}
    >>> comparison = lb.compare(models, campaign, evidence_only=True, tolerance=0.1)
    >>> figure = lb.figures.geometry_with_local_fits(comparison)
    >>> figure.axes[0].get_ylabel(), len(figure.axes)
    ('E_XX1 (µm/m)', 7)
    """
    first = next(iter(comparison.models.values()))
    names = [name for name in first.parameters if name.startswith("E_")]
    title = "Geometric errors: the model has them constant"
    return _draw_against_force(comparison, names, title, _draw_nothing)


def _draw_nothing(axes: Axes, name: str, factor: float) -> None:
    """Draw nothing beneath the curves, because the figure of geometric errors has no bands.

    The arguments are those that `_draw_against_force` passes to ``draw_beneath``.
    """


def _draw_against_force(
    comparison: Comparison,
    names: Sequence[str],
    title: str,
    draw_beneath: Callable[[Axes, str, float], None],
) -> Figure:
    """Draw each parameter against force in a panel of its own, in all models and in local fits.

    A local fit uses only the tests at two neighbouring forces. ``names`` are the names of the
    parameters. ``title`` is the first part of the figure's title. ``draw_beneath`` is a function
    that is called for each panel before the curves are drawn. The arguments of this function are
    the panel, the name of the parameter, and the factor that converts the parameter's internal unit
    (mm, N, rad) to the unit shown.
    """
    first = next(iter(comparison.models.values()))
    figure, all_axes = panels(len(names), 3, 1.7, 0.9)
    for axes, name in zip(all_axes, names, strict=True):
        factor, label = style.axis_label(name, first.parameters[name].unit)
        draw_beneath(axes, name, factor)
        for k, (model_name, model) in enumerate(comparison.models.items()):
            force_N, mean = _mean_curve(model, name)
            look: dict[str, Any] = {"color": PALETTE[k], "linestyle": _LINES[k % len(_LINES)]}
            axes.plot(force_N, mean * factor, label=f"{model_name}, mean", **look)
        _draw_local_fits(axes, comparison.local_fits, name, factor)
        axes.axhline(0.0, color=GREY, linewidth=0.6)
        axes.set(xlabel="force (N)", ylabel=label)
    style.legend_below(figure, all_axes[0], 3)
    figure.suptitle(f"{title}\nLocal fits of neighbouring forces (arrows: beyond the panel)")
    return figure


def _mean_curve(model: Any, name: str) -> tuple[Array, Array]:
    """Return forces [N], and the posterior mean of a parameter at each of these forces.

    The mean is in the internal unit of the parameter (mm, N, rad). ``model`` is the model, and
    ``name`` the name of the parameter. Both arrays have the shape (forces,).
    """
    curves = model.compliance_against_force
    if name in curves:
        return np.asarray(curves[name].force_N), curves[name].mean
    force_N = np.array(next(iter(curves.values())).force_N)
    return force_N, np.full(len(force_N), model.parameters[name].mean)


def _draw_local_fits(axes: Axes, local_fits: pd.DataFrame, name: str, factor: float) -> None:
    """Draw the estimates of one parameter from local fits.

    A local fit uses only the tests at two neighbouring forces. ``name`` is the name of the
    parameter; ``factor`` converts the parameter's internal unit (mm, N, rad) to the unit shown. A
    least-squares estimate beyond the panel's range is drawn as an arrow at the edge of the panel.
    """
    if local_fits.empty:
        return
    rows = local_fits[local_fits["parameter"] == name]
    force_N = rows["force_N"].to_numpy(float)
    mean = rows["mean"].to_numpy(float) * factor
    least_squares = rows["least_squares"].to_numpy(float) * factor
    below = np.abs(mean - rows["ci_low"].to_numpy(float) * factor)
    above = np.abs(rows["ci_high"].to_numpy(float) * factor - mean)
    axes.errorbar(
        force_N,
        mean,
        yerr=np.array([below, above]),
        fmt="o",
        color="black",
        markersize=3,
        linewidth=1.0,
        label="local, posterior",
    )
    low, high = axes.get_ylim()
    look: dict[str, Any] = {"color": PALETTE[1], "markersize": 4}
    axes.plot(force_N, least_squares, "x", label="local, least squares", **look)
    foot = axes.get_xaxis_transform()
    too_low = force_N[least_squares < low]
    too_high = force_N[least_squares > high]
    axes.plot(too_low, np.full(len(too_low), 0.03), "v", transform=foot, **look)
    axes.plot(too_high, np.full(len(too_high), 0.97), "^", transform=foot, **look)
    axes.set_ylim(low, high)
