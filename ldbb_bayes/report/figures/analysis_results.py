"""Figures of what analyses found: identifiability, budgets, comparisons, designs, calibration."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from ldbb_bayes.analysis.budgets import Budget
from ldbb_bayes.analysis.calibration import LOG_LIKELIHOOD, Validation
from ldbb_bayes.analysis.comparison import Comparison
from ldbb_bayes.analysis.design import Design
from ldbb_bayes.analysis.verdicts import Identifiability
from ldbb_bayes.report.figures import style
from ldbb_bayes.report.figures.style import ACCENT, GREY, LIGHT, PALETTE, band, panels, styled
from ldbb_bayes.report.wording import source_words
from ldbb_bayes.results import Array
from ldbb_bayes.units import display_name, display_unit, round_uncertainty

__all__ = [
    "budget_bars",
    "compliance_with_local_fits",
    "evidence",
    "expected_widths",
    "geometry_with_local_fits",
    "prior_and_posterior",
    "rank_ecdf",
]


# ---- identifiability and budgets

_VISIBLE = 0.5
_PER_LETTER = 1.75
_VERDICT_COLOURS = {"identified": PALETTE[2], "prior-limited": PALETTE[4], "confounded": PALETTE[1]}


@styled
def prior_and_posterior(identifiability: Identifiability) -> Figure:
    """Density of every parameter before and after the readings, in its unit; the colour is the
    verdict's.
    """
    entries = list(identifiability.parameters.values())
    figure, every = panels(len(entries), 4, 1.15, 0.5)
    for axes, entry in zip(every, entries, strict=True):
        factor, _ = display_unit(entry.unit)
        proper = bool(np.isfinite(entry.prior_sd))
        mean = entry.mean * factor
        sd = entry.sd * factor
        centre, reach = (
            (entry.prior_mean * factor, entry.prior_sd * factor) if proper else (mean, sd)
        )
        wide = np.linspace(centre - 3.2 * reach, centre + 3.2 * reach, 121)
        value = np.sort(np.concatenate([wide, np.linspace(-4.0, 4.0, 81) * sd + mean]))
        if proper:
            band(axes, value, (0.0, _bell(value, centre, reach)), GREY, 0.35)
        axes.plot(value, _bell(value, mean, sd), color=_VERDICT_COLOURS[entry.verdict])
        axes.locator_params(nbins=3)
        axes.set_yticks([])
        axes.spines["left"].set_visible(False)
        axes.set_title(f"{display_name(entry.name)}:\n{entry.verdict}", fontsize=8)
        axes.set_xlabel(f"u = {_size(entry.sd, entry.unit)}", fontsize=7)
    figure.suptitle(
        "Before the readings (grey) and after (line), each scaled to its peak; without the limit"
        " C ≥ 0"
    )
    return figure


def _bell(value: Array, mean: float, sd: float) -> Array:
    density = np.exp(-0.5 * ((value - mean) / sd) ** 2)
    return density / density.max()


@styled
def budget_bars(budgets: Mapping[str, Budget]) -> Figure:
    """Share of every source in the variance of every parameter; right: its standard uncertainty."""
    figure = style.new_figure(style.WIDTH, 1.3 + 0.2 * len(budgets))
    axes = figure.subplots()
    rows = style.name_rows(axes, list(budgets))
    start = np.zeros(len(rows))
    for term, colour in style.term_colours(
        line.term for budget in budgets.values() for line in budget.contributions
    ).items():
        share = np.array([100.0 * own.share(term) for own in budgets.values()])
        if share.max() >= _VISIBLE:
            words = source_words(term)
            axes.barh(
                rows,
                share,
                left=start,
                color=colour,
                edgecolor="white",
                linewidth=0.4,
                height=0.8,
                label=words,
            )
            ink = "white" if np.dot(to_rgb(colour), (0.2126, 0.7152, 0.0722)) < 0.45 else "black"
            for k in np.flatnonzero(share > _PER_LETTER * len(words)):  # for grey print
                axes.text(
                    start[k] + 0.5 * share[k],
                    rows[k],
                    words,
                    color=ink,
                    fontsize=6.5,
                    ha="center",
                    va="center",
                )
            start = start + share
    axes.set(
        xlim=(0.0, 100.0),
        xlabel="share of the variance (%)",
        title="What each uncertainty is made of; right: u",
    )
    style.right_labels(axes, rows, [_size(budget.u, budget.unit) for budget in budgets.values()])
    figure.legend(loc="outside lower center", ncols=4, fontsize=7)
    return figure


def _size(u: float, unit: str) -> str:
    factor, label = display_unit(unit)
    return f"{round_uncertainty(u * factor)[0]} {label}"


# ---- comparison

_DASHES = ("-", "--", ":")
_NEAR = 20.0
_BREAK = ((-0.6, -1.0), (0.6, 1.0))


@styled
def evidence(comparison: Comparison) -> Figure:
    """Ln B under every width of the slopes' prior and every assumption, dots with 95 % of the
    numerical error; right: how well the readings support the assumption. The scale is linear,
    broken where assumptions that the readings reject lie far out.
    """
    scales = [
        (f"slope scale {own.slope_scale:g}", own.log_bayes_factor, own.error, None)
        for own in comparison.prior_sensitivity
    ]
    every = [(own, comparison.gain(own)) for own in comparison.discrepancy_sensitivity]
    entries = scales + [
        (own.assumption, own.log_bayes_factor, own.log_bayes_factor_error, gain)
        for own, gain in every
    ]
    value = np.array([entry[1] for entry in entries])
    error = 1.96 * np.nan_to_num([float(entry[2]) for entry in entries], posinf=0.0)
    allowed = np.array([True] * len(scales) + [comparison.allowed(own) for own, _ in every])
    near = max(_NEAR, 1.2 * float(np.abs(value[allowed]).max(initial=0.0)))
    stretches = [value[value < -near], value[np.abs(value) <= near], value[value > near]]
    ends = [_stretch(own, k == 1) for k, own in enumerate(stretches) if len(own)]
    middle = len(stretches[0]) > 0
    figure = style.new_figure(style.WIDTH, 1.1 + 0.21 * len(entries))
    ratios = [2.2 if k == middle else 1.0 for k in range(len(ends))]
    parts = list(figure.subplots(1, len(ends), squeeze=False, sharey=True, width_ratios=ratios)[0])
    rows = np.arange(len(entries))[::-1]
    for k, (axes, limits) in enumerate(zip(parts, ends, strict=True)):
        for chosen, face in ((allowed, ACCENT), (~allowed, "white")):
            own = chosen & (value >= limits[0]) & (value <= limits[1])
            axes.errorbar(
                value[own],
                rows[own],
                xerr=error[own],
                fmt="o",
                color=ACCENT,
                markerfacecolor=face,
                markersize=4,
            )
        axes.set_xlim(limits)
        axes.locator_params(axis="x", nbins=6 if k == middle else 2)
        axes.xaxis.set_major_formatter(lambda place, _: f"{place:g}".replace("-", "−"))
        axes.grid(axis="y", visible=False)
        axes.tick_params(axis="y", length=0)
        axes.spines["left"].set_visible(k == 0)
        if limits[0] < 0.0 < limits[1]:
            axes.axvline(0.0, color="black", linewidth=0.8)
        for end in ([1.0] if k + 1 < len(ends) else []) + ([0.0] if k else []):  # the break
            axes.plot(
                end,
                0.0,
                marker=_BREAK,
                color="black",
                markersize=8,
                transform=axes.transAxes,
                clip_on=False,
            )
    parts[0].set_yticks(rows, [entry[0] for entry in entries], fontsize=7)
    parts[middle].set_xlabel(f"ln B({comparison.sensitivity_of}) (nat)")
    gains = [
        "" if gain is None else f"{gain:+.{int(abs(gain) < 100.0)}f}".replace("-", "−")
        for *_, gain in entries
    ]
    style.right_labels(parts[-1], rows, gains)
    figure.suptitle(
        "Slope scale: sd(slope) (largest − smallest force) / sd(C)\n"
        "Right: evidence for the assumption (nat); open dots: below −5, the readings reject it"
    )
    return figure


def _stretch(values: Array, zero: bool) -> tuple[float, float]:
    """Limits of a stretch of the scale that shows these values, and zero where it is asked for."""
    low, high = (float(end(initial=0.0) if zero else end()) for end in (values.min, values.max))
    room = 0.08 * (high - low) or 0.2 * abs(high) or 1.0
    return low - room, high + room


@styled
def compliance_with_local_fits(comparison: Comparison) -> Figure:
    """C(F): band averaged over slope subsets, mean of every model, and local fits (the paper's Fig.
    15). A local fit, its geometry free, estimates the tangent d(F C)/dF; that of the averaged C(F)
    is drawn for it.
    """
    first = next(iter(comparison.models.values()))
    curves = comparison.compliance_against_force or first.compliance_against_force

    def beneath(axes: Axes, name: str, factor: float) -> None:
        curve = curves[name]
        force = np.array(curve.force_N)
        words = f"{100 * curve.ci_prob:g} %, averaged over slope subsets"
        band(axes, force, (curve.low * factor, curve.high * factor), ACCENT, label=words)
        tangent = np.gradient(force * curve.mean, force) * factor
        axes.plot(
            force,
            tangent,
            color="black",
            linewidth=0.9,
            linestyle=":",
            label="d(F·C)/dF: for local fits",
        )

    return _against_force(comparison, list(curves), "Compliance", beneath)


@styled
def geometry_with_local_fits(comparison: Comparison) -> Figure:
    """Geometric errors of every model and of local fits against force (the paper's Fig. 16)."""
    first = next(iter(comparison.models.values()))
    names = [name for name in first.parameters if name.startswith("E_")]
    return _against_force(
        comparison, names, "Geometric errors: the model has them constant", lambda *_: None
    )


def _against_force(
    comparison: Comparison, names: list[str], what: str, beneath: Callable[..., None]
) -> Figure:
    """A panel for every parameter: what ``beneath`` draws, the mean of every model, local fits."""
    first = next(iter(comparison.models.values()))
    force = np.array(next(iter(first.compliance_against_force.values())).force_N)
    figure, every = panels(len(names), 3, 1.7, 0.9)
    for axes, name in zip(every, names, strict=True):
        factor, label = style.axis_label(name, first.parameters[name].unit)
        beneath(axes, name, factor)
        for k, (model, own) in enumerate(comparison.models.items()):
            curve = own.compliance_against_force.get(name)
            x, mean = (
                (force, own.parameters[name].mean + 0.0 * force)
                if curve is None
                else (curve.force_N, curve.mean)
            )
            axes.plot(
                x, mean * factor, color=PALETTE[k], linestyle=_DASHES[k % 3], label=f"{model}, mean"
            )
        _local(axes, comparison.local_fits, name, factor)
        axes.axhline(0.0, color=GREY, linewidth=0.6)
        axes.set(xlabel="force (N)", ylabel=label)
    style.legend_below(figure, every[0], 3)
    figure.suptitle(f"{what}; local fits of neighbouring forces (arrows: beyond the panel)")
    return figure


def _local(axes: Axes, local: pd.DataFrame, name: str, factor: float) -> None:
    """Draw local fits; least squares beyond what all else takes up stands at the edge, as an
    arrow.
    """
    if local.empty:
        return
    rows = local[local["parameter"] == name]
    force, middle, other = (
        rows[key].to_numpy(float) for key in ("force_N", "mean", "least_squares")
    )
    reach = np.abs([middle - rows["ci_low"], rows["ci_high"] - middle]) * factor
    axes.errorbar(
        force,
        middle * factor,
        yerr=reach,
        fmt="o",
        color="black",
        markersize=3,
        linewidth=1.0,
        label="local, posterior",
    )
    low, high = axes.get_ylim()
    axes.plot(
        force, other * factor, "x", color=PALETTE[1], markersize=4, label="local, least squares"
    )
    for beyond, end, marker in (
        (other * factor < low, 0.03, "v"),
        (other * factor > high, 0.97, "^"),
    ):
        foot = axes.get_xaxis_transform()
        axes.plot(
            force[beyond],
            np.full(beyond.sum(), end),
            marker,
            color=PALETTE[1],
            markersize=4,
            transform=foot,
        )
    axes.set_ylim(low, high)


# ---- calibration


@styled
def rank_ecdf(validation: Validation) -> Figure:
    """Empirical distribution of every quantity's ranks, minus the uniform one, and the band all of
    them share.
    """
    names = validation.names
    columns = 4
    figure, every = panels(len(names), columns, 1.15, 0.7, sharex=True, sharey=True)
    level = np.arange(1, validation.draws + 1) / (validation.draws + 1)
    lower, upper = validation.band
    for k, (axes, name) in enumerate(zip(every, names, strict=True)):
        outside = name in validation.outside
        band(axes, level, (lower - level, upper - level), GREY, 0.25, step="mid")
        axes.axhline(0.0, color=GREY, linewidth=0.6)
        axes.plot(
            level,
            validation.ecdf(name) - level,
            color=PALETTE[1] if outside else ACCENT,
            drawstyle="steps-mid",
        )
        shown = "ln likelihood" if name == LOG_LIKELIHOOD else display_name(name)
        axes.set_title(f"{shown}: outside" if outside else shown, fontsize=8)
        axes.set_xticks([0.0, 0.5, 1.0])
        if k % columns == 0:
            axes.set_ylabel("difference (1)")
        if k + columns >= len(names):
            axes.set_xlabel("rank share (1)")
            axes.tick_params(labelbottom=True)
    figure.suptitle(
        f"Ranks of the truth among draws, minus uniform: {validation.replicates} simulated"
        f" campaigns,\nsampler {validation.sampler}; band: {100 * validation.prob:g} % for all"
        " together"
    )
    return figure


# ---- design


_ACROSS = 3
_LONGEST = 0.72


@styled
def expected_widths(design: Design, today: Mapping[str, float] = MappingProxyType({})) -> Figure:
    """How narrow each interval gets with what: u of every parameter in its unit, ``today`` where it
    is given (inside units), with the recommended tests, with those compared, and with ever more of
    the recommended ones; bars to a scale of each parameter.
    """
    count = int(design.table["count"].sum())
    kinds = (
        {"today": ({name: today.get(name, np.nan) for name in design.expected}, GREY)}
        if today
        else {}
    )
    kinds[f"{count} more" if design.augment else f"{count} recommended"] = (
        _sizes(design.expected),
        ACCENT,
    )
    kinds |= {judged.name: (_sizes(judged.expected), LIGHT) for judged in design.compared}
    kinds["ever more of these"] = (
        {name: own.floor_sd for name, own in design.expected.items()},
        "white",
    )
    step = len(kinds) + 1.8
    rows = -(-len(design.expected) // _ACROSS)
    figure = style.new_figure(style.WIDTH, 0.4 + 0.15 * step * rows)
    axes = figure.subplots()
    left = np.arange(len(design.expected)) % _ACROSS
    top = -step * (np.arange(len(design.expected)) // _ACROSS)
    units = [display_unit(own.unit) for own in design.expected.values()]
    sizes = np.array([[own[name] for name in design.expected] for own, _ in kinds.values()]) * [
        factor for factor, _ in units
    ]
    lengths = np.where(np.isfinite(sizes), sizes, 0.0)
    lengths *= _LONGEST / np.maximum(lengths.max(axis=0), np.finfo(float).tiny)
    for k, (words, (_, colour)) in enumerate(kinds.items()):
        axes.barh(
            top - 1.0 - k,
            lengths[k],
            0.75,
            left,
            color=colour,
            edgecolor=GREY,
            linewidth=0.6,
            label=words,
        )
        for x, y, size in zip(left + lengths[k] + 0.02, top - 1.0 - k, sizes[k], strict=True):
            axes.text(
                x,
                y,
                round_uncertainty(size)[0] if np.isfinite(size) else "–",
                fontsize=7,
                va="center",
            )
        for y in np.unique(top):
            axes.text(-0.03, y - 1.0 - k, words, fontsize=7, ha="right", va="center")
    for x, y, name, (_, unit) in zip(
        left.tolist(), top.tolist(), design.expected, units, strict=True
    ):
        aim = "" if name in design.parameters else ", not aimed at"
        axes.text(x, y, f"{display_name(name)} ({unit}){aim}", fontsize=7.5, va="center")
    axes.set(xlim=(0.0, _ACROSS), ylim=(top[-1] - len(kinds) - 0.6, 0.7), xticks=[], yticks=[])
    axes.set_axis_off()
    figure.suptitle("How narrow each interval gets: expected standard uncertainty u")
    return figure


def _sizes(expected: Mapping[str, Any]) -> dict[str, float]:
    return {name: own.sd for name, own in expected.items()}
