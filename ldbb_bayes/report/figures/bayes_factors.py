"""What a comparison found: evidence and what it hangs on, C(F) and geometry with local fits, tests that do not belong."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ldbb_bayes.analysis.calibration import LOG_LIKELIHOOD, Validation
from ldbb_bayes.analysis.comparison import Comparison
from ldbb_bayes.analysis.outliers import FALSE_ALARMS
from ldbb_bayes.report.figures.style import ACCENT, GREY, PALETTE, axis_label, new_figure, styled
from ldbb_bayes.units import display_name, ranked

__all__ = ["compliance_with_local_fits", "evidence", "geometry_with_local_fits", "predictive_p_values", "rank_ecdf"]

Array = NDArray[Any]
_STRENGTHS = (1.0, 3.0, 5.0)
_FLOOR = 5e-5


@styled
def evidence(comparison: Comparison) -> Figure:
    """Evidence of the models; ln B against the scale of the slopes' prior, and under every assumption (beside: its evidence)."""
    every = comparison.assumptions
    bars = list({round(a.log_bayes_factor, 6): a for a in reversed(every.values())}.values())[::-1]
    figure = new_figure(10.0, 1.8 + 0.28 * max(len(bars), 10))
    grid = figure.add_gridspec(2, 2, width_ratios=[1.0, 1.5], height_ratios=[0.35 + 0.14 * len(comparison.models), 2.0])
    _evidence_bars(figure.add_subplot(grid[0, 0]), comparison)
    _scale_curve(figure.add_subplot(grid[1, 0]), comparison)
    axes = figure.add_subplot(grid[:, 1])
    rows = np.arange(len(bars))[::-1]
    for row, assumed in zip(rows, bars, strict=True):
        believed = comparison.allowed(assumed)
        axes.barh(row, assumed.log_bayes_factor, color=ACCENT if believed else "#C9C9C9", height=0.7)
    axes.set_xscale("symlog", linthresh=5.0)
    low, high = axes.get_xlim()
    axes.set_xlim(min(low, -20.0), high)
    axes.set_xticks(
        [tick for tick in (-1000, -100, -10, -2, 0, 2, 10, 100, 1000, 10000) if axes.get_xlim()[0] <= tick <= axes.get_xlim()[1]]
    )
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}".replace("-", "−"))
    axes.axvline(0.0, color="black", linewidth=0.9)
    axes.set_yticks(rows, [assumed.assumption.replace(" with one scale", "") for assumed in bars])
    axes.grid(axis="y", visible=False)
    axes.set_xlabel(f"ln B({comparison.sensitivity_of}) (nat, linear within ±5)")
    right = axes.secondary_yaxis("right")
    right.set_yticks(rows, [_relative(comparison.gain(assumed)) for assumed in bars])
    right.tick_params(length=0)
    right.spines["right"].set_visible(False)
    axes.set_title("Under other assumptions; right: their evidence (nat), grey below −5", loc="right")
    return figure


def _scale_curve(axes: Axes, comparison: Comparison) -> None:
    for limit, shade in zip((*_STRENGTHS[::-1],), ("#F4F4F4", "#EAEAEA", "#DEDEDE"), strict=True):
        axes.axhspan(-limit, limit, color=shade, zorder=0)
    axes.axhline(0.0, color="black", linewidth=0.9)
    if comparison.prior_sensitivity:
        scale = np.array([scaled.slope_scale for scaled in comparison.prior_sensitivity])
        value = np.array([scaled.log_bayes_factor for scaled in comparison.prior_sensitivity])
        axes.plot(scale, value, "o-", color=ACCENT, markersize=3.5)
        own = comparison.log_bayes_factor[comparison.sensitivity_of]
        axes.axhline(own, color=ACCENT, linewidth=0.7, linestyle=":")
        axes.annotate("as in the models", (scale[0], own), xytext=(0, 2), textcoords="offset points", fontsize=7, color=ACCENT)
        axes.set_xscale("log")
        axes.set_xticks([0.03, 0.1, 0.3, 1.0, 3.0], ["0.03", "0.1", "0.3", "1", "3"])
        axes.minorticks_off()
        for crossing in comparison.prior_sensitivity_crossings:
            axes.axvline(crossing, color=PALETTE[1], linewidth=0.9, linestyle="--")
    every = [scaled.log_bayes_factor for scaled in comparison.prior_sensitivity]
    axes.set_ylim(min([-6.0, *(1.1 * value for value in every)]), max([6.0, *(1.1 * value for value in every)]))
    axes.set_xlabel("slope scale (1): sd(slope) (F_max − F_min) / sd(C)")
    axes.set_ylabel(f"ln B({comparison.sensitivity_of}) (nat)")


def _evidence_bars(axes: Axes, comparison: Comparison) -> None:
    """ln Z of every model against the first, and its probability."""
    names = list(comparison.models)
    rows = np.arange(len(names))[::-1]
    values = [0.0, *(comparison.log_bayes_factor[f"{name}/{names[0]}"] for name in names[1:])]
    axes.barh(rows, values, color=[PALETTE[k % len(PALETTE)] for k in range(len(names))], height=0.6)
    axes.axvline(0.0, color="black", linewidth=0.9)
    axes.set_yticks(rows, [f"{name}: {model.posterior_probability:.3g}" for name, model in comparison.models.items()])
    axes.set_ylim(-0.6, len(names) - 0.4)
    axes.set_xlabel(f"ln Z − ln Z({names[0]}) (nat)")
    axes.grid(axis="y", visible=False)
    axes.set_title("Models: probability at equal prior odds", loc="left")


def _relative(value: float) -> str:
    return (f"{value:+.1f}" if abs(value) < 100.0 else f"{value:+.0f}").replace("-", "−")


@styled
def compliance_with_local_fits(comparison: Comparison) -> Figure:
    """C(F): band averaged over slope subsets, mean of every model, and local fits (the paper's Fig. 15).

    A local fit, its geometry free, estimates the tangent d(F C)/dF; that of the averaged C(F) is drawn for it.
    """
    curves = comparison.compliance_against_force or next(iter(comparison.models.values())).compliance_against_force
    figure = new_figure(9.6, 0.6 + 2.5 * -(-len(curves) // 3))
    panels = figure.subplots(-(-len(curves) // 3), 3, squeeze=False)
    for axes, (name, curve) in zip(panels.flat, curves.items(), strict=False):
        factor, label = axis_label(name, curve.unit)
        band = f"{100 * curve.ci_prob:g} %, averaged over slope subsets"
        axes.fill_between(
            curve.force_N, curve.low * factor, curve.high * factor, color=ACCENT, alpha=0.2, linewidth=0, label=band
        )
        _lines(axes, comparison, name, factor)
        tangent = np.gradient(curve.force_N * curve.mean, curve.force_N)
        axes.plot(curve.force_N, tangent * factor, color="black", linewidth=0.9, linestyle=":", label="d(F·C)/dF: for local fits")
        _local(axes, comparison.local_fits, name, factor)
        axes.axhline(0.0, color=GREY, linewidth=0.6)
        axes.set_ylabel(label)
        axes.set_xlabel("force (N)")
        if name in comparison.slopes:
            axes.set_title(f"varies with probability {comparison.slopes[name].inclusion_probability:.2f}")
    _finish(figure, panels, len(curves), "Compliance against force, with local fits of neighbouring force levels")
    return figure


@styled
def geometry_with_local_fits(comparison: Comparison) -> Figure:
    """Geometric errors of every model and of local fits against force (the paper's Fig. 16)."""
    first = next(iter(comparison.models.values()))
    names = [name for name in first.parameters if name.startswith("E_")]
    figure = new_figure(11.0, 0.6 + 2.4 * -(-len(names) // 4))
    panels = figure.subplots(-(-len(names) // 4), 4, squeeze=False)
    likeliest = ranked(comparison.models.values(), lambda model: model.posterior_probability)[0]
    forces = np.array([test.force_N for test in comparison.tests.values()])
    span = np.array([forces.min(), forces.max()]) if forces.size else np.array([0.0, 1.0])
    for axes, name in zip(panels.flat, names, strict=False):
        factor, label = axis_label(name, first.parameters[name].unit)
        for k, (model, own) in enumerate(comparison.models.items()):
            mean, sd = own.parameters[name].mean, own.parameters[name].sd
            if own is likeliest:
                low, high = (mean - 2.0 * sd) * factor, (mean + 2.0 * sd) * factor
                axes.fill_between(span, low, high, color=PALETTE[k], alpha=0.13, linewidth=0, label=f"{model}, ± 2 u")
            axes.plot(span, [mean * factor] * 2, color=PALETTE[k], linestyle=_DASHES[k % 3], label=f"{model}, mean")
        _local(axes, comparison.local_fits, name, factor)
        axes.set_ylabel(label)
        axes.set_xlabel("force (N)")
    _finish(figure, panels, len(names), "Geometric errors: the model has them constant; local fits of neighbouring force levels")
    return figure


_DASHES = ("-", "--", ":")


def _lines(axes: Axes, comparison: Comparison, name: str, factor: float) -> None:
    for k, (model, own) in enumerate(comparison.models.items()):
        curve = own.compliance_against_force[name]
        axes.plot(curve.force_N, curve.mean * factor, color=PALETTE[k], linestyle=_DASHES[k % 3], label=f"{model}, mean")


def _local(axes: Axes, local: pd.DataFrame, name: str, factor: float) -> None:
    if local.empty:
        return
    rows = local[local["parameter"] == name]
    force, middle = rows["force_N"].to_numpy(), rows["mean"].to_numpy() * factor
    reach = [middle - rows["ci_low"].to_numpy() * factor, rows["ci_high"].to_numpy() * factor - middle]
    axes.errorbar(
        force, middle, yerr=np.abs(reach), fmt="o", color="black", markersize=3.5, linewidth=1.0, label="local, posterior"
    )
    axes.plot(force, rows["least_squares"].to_numpy() * factor, "x", color=PALETTE[1], markersize=5, label="local, least squares")


def _finish(figure: Figure, panels: Array, used: int, title: str) -> None:
    for axes in list(panels.flat)[used:]:
        axes.set_visible(False)
    handles, labels = panels.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 5))
    figure.suptitle(title, fontsize=9.5)


@styled
def predictive_p_values(comparison: Comparison) -> Figure:
    """Leave-one-force-out predictive p-value of every test, as a whole and by Fourier order."""
    tests = comparison.tests
    figure = new_figure(8.6, 1.5 + 0.34 * max(len(tests), 3))
    axes = figure.subplots()
    if not tests:
        axes.text(0.5, 0.5, "one test: nothing to leave out", ha="center", va="center", transform=axes.transAxes)
        axes.set_axis_off()
        return figure
    orders = len(next(iter(tests.values())).lofo_p_value_by_order)
    values = np.array([[*t.lofo_p_value_by_order.values(), t.lofo_p_value, t.lofo_family_wise_p_value] for t in tests.values()])
    image = axes.imshow(np.log10(np.maximum(values, _FLOOR)), cmap="magma", vmin=np.log10(_FLOOR), vmax=0.0, aspect="auto")
    for (i, j), value in np.ndenumerate(values):
        light = value < 0.02
        text = f"{value:.2f}" if value >= 0.01 else f"{value:.0e}".replace("e-0", "e−")
        axes.text(j, i, text, ha="center", va="center", fontsize=6.5, color="white" if light else "black")
    axes.axvline(orders - 0.5, color="white", linewidth=4)
    axes.set_xticks(range(orders + 2), [*(str(n) for n in range(orders)), "all", "Holm"])
    labels = [f"{display_name(name)}{'  FLAGGED' if test.flag else ''}" for name, test in tests.items()]
    axes.set_yticks(range(len(tests)), labels)
    axes.set_xlabel("Fourier order (1); all orders together; the same allowing for the number of tests")
    axes.grid(visible=False)
    figure.colorbar(image, ax=axes, shrink=0.8, label="log10 p (1)")
    axes.set_title(f"Would the other tests expect this circle? Predictive p, flagged where Holm's is below {FALSE_ALARMS:g}")
    return figure


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
