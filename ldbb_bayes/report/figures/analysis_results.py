"""Figures of what analyses found: what can be told apart, budgets, differences, comparisons, designs, calibration."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ldbb_bayes.analysis.budget import Budget
from ldbb_bayes.analysis.calibration import LOG_LIKELIHOOD, Validation
from ldbb_bayes.analysis.comparison import Comparison
from ldbb_bayes.analysis.design.design import Design
from ldbb_bayes.analysis.identifiability import Identifiability
from ldbb_bayes.report.figures import style
from ldbb_bayes.report.figures.style import ACCENT, GREY, LIGHT, PALETTE, band, panels, styled
from ldbb_bayes.report.wording import source_words
from ldbb_bayes.result import Array
from ldbb_bayes.units import display_name, display_unit, round_uncertainty

__all__ = [
    "budget_bars", "compliance_with_local_fits", "evidence", "expected_widths", "geometry_with_local_fits",
    "prior_and_posterior", "rank_ecdf",
]  # fmt: skip


# ---- what can be told apart, and what it costs

_VISIBLE = 0.005
_VERDICT_COLOURS = {"identified": PALETTE[2], "prior-limited": PALETTE[4], "confounded": PALETTE[1]}


@styled
def prior_and_posterior(identifiability: Identifiability) -> Figure:
    """Density of every parameter before and after the readings, in its unit; the colour is the verdict's."""
    entries = list(identifiability.parameters.values())
    figure, every = panels(len(entries), 5, 9.6, 1.6, 0.7)
    for axes, entry in zip(every, entries, strict=True):
        factor, unit = display_unit(entry.unit)
        proper = bool(np.isfinite(entry.prior_sd))
        mean, sd = entry.mean * factor, entry.sd * factor
        centre, reach = (entry.prior_mean * factor, entry.prior_sd * factor) if proper else (mean, sd)
        wide = np.linspace(centre - 3.2 * reach, centre + 3.2 * reach, 201)
        value = np.sort(np.concatenate([wide, np.linspace(-4.0, 4.0, 161) * sd + mean]))
        if proper:
            band(axes, value, 0.0, _bell(value, centre, reach), GREY, 0.35)
        axes.plot(value, _bell(value, mean, sd), color=_VERDICT_COLOURS[entry.verdict])
        axes.set_yticks([])
        axes.spines["left"].set_visible(False)
        axes.set_title(f"{display_name(entry.name)}: {entry.verdict}", color=_VERDICT_COLOURS[entry.verdict])
        axes.set_xlabel(f"{unit}; sd {round_uncertainty(sd)[0]}")
    figure.suptitle("Prior (grey) and posterior, each scaled to its peak; without truncation")
    return figure


def _bell(value: Array, mean: float, sd: float) -> Array:
    density = np.exp(-0.5 * ((value - mean) / sd) ** 2)
    return density / density.max()


@styled
def budget_bars(budgets: Mapping[str, Budget]) -> Figure:
    """Share of every source in the variance of every parameter; right: its standard uncertainty."""
    figure, axes, rows = style.named_rows(list(budgets), 8.6, 1.5)
    start = np.zeros(len(rows))
    for term, colour in style.term_colours(line.term for budget in budgets.values() for line in budget.contributions).items():
        share = np.array([own.share(term) for own in budgets.values()])
        if share.max() >= _VISIBLE:
            axes.barh(rows, share, left=start, color=colour, height=0.72, label=source_words(term))
            start = start + share
    axes.grid(axis="y", visible=False)
    axes.set(xlim=(0.0, 1.0), xlabel="share of the variance (1)", title="Uncertainty budgets; right: standard uncertainty u")
    style.right_labels(axes, rows, [_size(budget.u, budget.unit) for budget in budgets.values()])
    figure.legend(loc="outside lower center", ncols=4)
    return figure


def _size(u: float, unit: str) -> str:
    factor, label = display_unit(unit)
    return f"{round_uncertainty(u * factor)[0]} {label}"


# ---- comparison

_TICKS = (-1000, -100, -10, -2, 0, 2, 10, 100, 1000, 10000)
_DASHES = ("-", "--", ":")


@styled
def evidence(comparison: Comparison) -> Figure:
    """ln B under every scale of the slopes' prior and every assumption; beside: the evidence of the assumption."""
    scales = {f"slope scale {own.slope_scale:g}": (own.log_bayes_factor, None) for own in comparison.prior_sensitivity}
    every = comparison.discrepancy_sensitivity
    bars = scales | {own.assumption: (own.log_bayes_factor, comparison.gain(own)) for own in every}
    allowed = dict.fromkeys(scales, True) | {own.assumption: comparison.allowed(own) for own in every}
    figure = style.new_figure(9.0, 1.4 + 0.24 * max(len(bars), 10))
    axes, rows = figure.subplots(), np.arange(len(bars))[::-1]
    axes.barh(
        rows, [value for value, _ in bars.values()], color=[ACCENT if allowed[name] else LIGHT for name in bars], height=0.7
    )
    axes.set_xscale("symlog", linthresh=5.0)
    low, high = axes.get_xlim()
    low = min(low, -20.0)
    axes.set(xlim=(low, high), xticks=[tick for tick in _TICKS if low <= tick <= high])
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}".replace("-", "−"))
    axes.axvline(0.0, color="black", linewidth=0.9)
    axes.set_yticks(rows, [name.replace(" with one scale", "") for name in bars])
    axes.grid(axis="y", visible=False)
    axes.set_xlabel(f"ln B({comparison.sensitivity_of}) (nat, linear within ±5)")
    gains = ["" if nats is None else f"{nats:+.{int(abs(nats) < 100.0)}f}".replace("-", "−") for _, nats in bars.values()]
    style.right_labels(axes, rows, gains)
    axes.set_title("Slope scale: sd(slope) (F_max − F_min) / sd(C); right: evidence of the assumption (nat), grey below −5")
    return figure


@styled
def compliance_with_local_fits(comparison: Comparison) -> Figure:
    """C(F): band averaged over slope subsets, mean of every model, and local fits (the paper's Fig. 15).

    A local fit, its geometry free, estimates the tangent d(F C)/dF; that of the averaged C(F) is drawn for it.
    """
    first = next(iter(comparison.models.values()))
    curves = comparison.compliance_against_force or first.compliance_against_force

    def beneath(axes: Axes, name: str, factor: float) -> None:
        curve = curves[name]
        force = np.array(curve.force_N)
        words = f"{100 * curve.ci_prob:g} %, averaged over slope subsets"
        band(axes, force, curve.low * factor, curve.high * factor, ACCENT, label=words)
        tangent = np.gradient(force * curve.mean, force) * factor
        axes.plot(force, tangent, color="black", linewidth=0.9, linestyle=":", label="d(F·C)/dF: for local fits")

    return _against_force(comparison, list(curves), "Compliance", beneath)


@styled
def geometry_with_local_fits(comparison: Comparison) -> Figure:
    """Geometric errors of every model and of local fits against force (the paper's Fig. 16)."""
    first = next(iter(comparison.models.values()))
    names = [name for name in first.parameters if name.startswith("E_")]
    return _against_force(comparison, names, "Geometric errors: the model has them constant", lambda *_: None)


def _against_force(comparison: Comparison, names: list[str], what: str, beneath: Callable[..., None]) -> Figure:
    """A panel for every parameter: what ``beneath`` draws, the mean of every model, local fits."""
    first = next(iter(comparison.models.values()))
    force = np.array(next(iter(first.compliance_against_force.values())).force_N)
    figure, every = panels(len(names), min(len(names), 4), 11.0, 2.4)
    for axes, name in zip(every, names, strict=True):
        factor, label = style.axis_label(name, first.parameters[name].unit)
        beneath(axes, name, factor)
        for k, (model, own) in enumerate(comparison.models.items()):
            curve = own.compliance_against_force.get(name)
            x, mean = (force, own.parameters[name].mean + 0.0 * force) if curve is None else (curve.force_N, curve.mean)
            axes.plot(x, mean * factor, color=PALETTE[k], linestyle=_DASHES[k % 3], label=f"{model}, mean")
        _local(axes, comparison.local_fits, name, factor)
        axes.axhline(0.0, color=GREY, linewidth=0.6)
        axes.set(xlabel="force (N)", ylabel=label)
    style.legend_below(figure, every[0], 5)
    figure.suptitle(f"{what}; local fits of neighbouring force levels")
    return figure


def _local(axes: Axes, local: pd.DataFrame, name: str, factor: float) -> None:
    if local.empty:
        return
    rows = local[local["parameter"] == name]
    force, middle = rows["force_N"], rows["mean"] * factor
    reach = np.abs([middle - rows["ci_low"] * factor, rows["ci_high"] * factor - middle])
    axes.errorbar(force, middle, yerr=reach, fmt="o", color="black", markersize=3.5, linewidth=1.0, label="local, posterior")
    axes.plot(force, rows["least_squares"] * factor, "x", color=PALETTE[1], markersize=5, label="local, least squares")


# ---- calibration


@styled
def rank_ecdf(validation: Validation) -> Figure:
    """Empirical distribution of every quantity's ranks, minus the uniform one, and the band all of them share."""
    names, columns = validation.names, 6
    figure, every = panels(len(names), columns, 9.5, 1.35, 0.9, sharex=True, sharey=True)
    level = np.arange(1, validation.draws + 1) / (validation.draws + 1)
    lower, upper = validation.band
    for k, (axes, name) in enumerate(zip(every, names, strict=True)):
        outside = name in validation.outside
        band(axes, level, lower - level, upper - level, GREY, 0.25, step="mid")
        axes.axhline(0.0, color=GREY, linewidth=0.6)
        axes.plot(level, validation.ecdf(name) - level, color=PALETTE[1] if outside else ACCENT, drawstyle="steps-mid")
        shown = "ln likelihood" if name == LOG_LIKELIHOOD else display_name(name)
        axes.set_title(f"{shown}: outside" if outside else shown)
        if k % columns == 0:
            axes.set_ylabel("difference (1)")
        if k + columns >= len(names):
            axes.set_xlabel("rank share (1)")
            axes.tick_params(labelbottom=True)
    figure.suptitle(
        f"Ranks of the truth among draws, minus uniform: {validation.replicates} simulated campaigns, "
        f"sampler {validation.sampler}; band: {100 * validation.prob:g} % for all together"
    )
    return figure


# ---- design


@styled
def expected_widths(design: Design) -> Figure:
    """Expected standard uncertainty of every parameter as a share of its prior sd: recommended, baseline, others, floor."""
    expected = design.expected
    proper = bool(np.isfinite(next(iter(expected.values())).prior_sd))
    scale = {name: expected[name].prior_sd if proper else design.baseline[name].sd for name in expected}

    def shares(forecast: Any, size: str = "sd") -> list[float]:
        return [getattr(forecast[name], size) / scale[name] for name in expected]

    figure, axes, rows = style.named_rows(list(expected), 7.6, 1.2)
    axes.barh(rows, shares(expected), height=0.62, color=ACCENT, label="recommended")
    axes.plot(shares(expected, "floor_sd"), rows, "|", color="white", markersize=9, markeredgewidth=1.6)
    for k, judged in enumerate(design.compared):
        look: dict[str, Any] = {"marker": "D", "color": PALETTE[k % 6]} if k else {"marker": "o", "color": "black"}
        axes.plot(shares(judged.expected), rows, linestyle="", markersize=4, label=judged.name, **look)
    axes.set_yticks(rows, [display_name(name) + ("" if name in design.parameters else " (nuisance)") for name in expected])
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter("")
    axes.grid(axis="y", visible=False)
    against = "prior sd" if proper else f"that of {design.compared[0].name}"
    axes.set_xlabel(f"expected u / {against} (1); white: more of the recommended circles would not go below")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=4)
    return figure
