"""Figures of what analyses found: what can be told apart, budgets, differences, comparisons, designs, calibration."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ldbb_bayes.analysis.budget import Budget
from ldbb_bayes.analysis.calibration import LOG_LIKELIHOOD, Validation
from ldbb_bayes.analysis.comparison import Comparison
from ldbb_bayes.analysis.design.design import Design
from ldbb_bayes.analysis.identifiability import Identifiability
from ldbb_bayes.analysis.outliers import FALSE_ALARMS
from ldbb_bayes.model.likelihood import NOISE, OWN
from ldbb_bayes.report.figures.style import (
    ACCENT,
    GREY,
    PALETTE,
    axis_label,
    band,
    heat_map,
    legend_below,
    mean_and_sd,
    named_rows,
    new_figure,
    nothing,
    panels,
    right_labels,
    stacked,
    styled,
)
from ldbb_bayes.report.wording import place_words, source_words, term_words
from ldbb_bayes.units import display_name, display_unit, ranked, round_uncertainty

__all__ = [
    "alias_map",
    "budget_bars",
    "compliance_with_local_fits",
    "correlation_map",
    "difference_forest",
    "efficiency",
    "evidence",
    "expected_widths",
    "geometry_with_local_fits",
    "information",
    "nuisance_costs",
    "predictive_p_values",
    "prior_and_posterior",
    "rank_ecdf",
    "trade_off",
]

Array = NDArray[Any]


# ---- what can be told apart, and what it costs

_SEEN = 0.05
_VERDICT_COLOURS = {"identified": PALETTE[2], "prior-limited": PALETTE[4], "confounded": PALETTE[1]}


@styled
def correlation_map(identifiability: Identifiability) -> Figure:
    """Posterior correlations of parameters and shared nuisances, in blocks; nuisances without any are left out."""
    table, own = identifiability.correlation, list(identifiability.parameters)
    names = [*own, *(name for name in table.index if name not in own and table.loc[name, own].abs().max() > _SEEN)]
    figure = new_figure(1.9 + 0.24 * len(names), 1.2 + 0.24 * len(names))
    axes = figure.subplots()
    labels = [display_name(name) if name in own else name.replace("_", " ") for name in names]
    values = table.loc[names, names].to_numpy()
    image = heat_map(axes, values, labels, labels, cmap="RdBu_r", vmin=-1.0, vmax=1.0, aspect="equal")
    axes.tick_params(axis="x", rotation=90)
    kinds = [("slope" if name[0] == "C" and name.count("_") == 2 else name[0]) if name in own else "nuisance" for name in names]
    for edge in (i - 0.5 for i in range(1, len(kinds)) if kinds[i] != kinds[i - 1]):
        axes.axhline(edge, color="black", linewidth=0.8)
        axes.axvline(edge, color="black", linewidth=0.8)
    figure.colorbar(image, ax=axes, shrink=0.6, label="posterior correlation (1)")
    axes.set_title("Compliances, slopes, geometric errors; nuisances last")
    return figure


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
def alias_map(identifiability: Identifiability) -> Figure:
    """How far one prior sd of a nuisance moves each estimate when it is left out, in posterior sd of the parameter."""
    table = identifiability.alias
    moved = table.to_numpy() / np.array([entry.sd for entry in identifiability.parameters.values()])[:, None]
    shown = [j for j in range(moved.shape[1]) if np.abs(moved[:, j]).max() > _SEEN]
    figure = new_figure(2.4 + 0.46 * max(len(shown), 4), 1.4 + 0.27 * len(table))
    axes = figure.subplots()
    if not shown:
        nothing(axes, "no nuisance moves any estimate")
        return figure
    across = [str(table.columns[j]).replace("_", " ") for j in shown]
    down = [display_name(str(name)) for name in table.index]
    image = heat_map(axes, moved[:, shown], across, down, cmap="RdBu_r", vmin=-2.0, vmax=2.0)
    axes.tick_params(axis="x", rotation=90)
    for (i, j), value in np.ndenumerate(moved[:, shown]):
        if abs(value) >= _SEEN:
            axes.text(j, i, f"{value:.1f}", ha="center", va="center", fontsize=7, color="white" if abs(value) > 1.3 else "black")
    figure.colorbar(image, ax=axes, shrink=0.6, extend="both", label="change of the estimate (posterior sd)")
    axes.set_title("Least squares without nuisances: what one prior sd of each does")
    return figure


@styled
def nuisance_costs(identifiability: Identifiability) -> Figure:
    """Fair (Shapley) shares of every parameter's variance by nuisance term; the rest is reading noise and its own prior."""
    entries = identifiability.parameters
    figure, axes, rows = named_rows(list(entries), 8.6, 1.4)
    shapley = [entry.shapley for entry in entries.values()]
    # What no nuisance takes is noise and prior together: it has the colour of a prior.
    shares = {OWN if source == NOISE else source: np.array([own[source] for own in shapley]) for source in shapley[0]}
    stacked(axes, rows, shares, lambda term: "reading noise and own prior" if term == OWN else term_words(term))
    axes.set(xlabel="share of the posterior variance (1)", title="What each nuisance costs; right: posterior sd and verdict")
    right_labels(axes, rows, [f"{_size(entry.sd, entry.unit)}, {entry.verdict}" for entry in entries.values()])
    figure.legend(loc="outside lower center", ncols=4)
    return figure


@styled
def budget_bars(budgets: Mapping[str, Budget]) -> Figure:
    """Share of every source in the variance of every parameter; right: its standard uncertainty."""
    figure, axes, rows = named_rows(list(budgets), 8.6, 1.5)
    terms = dict.fromkeys(line.term for budget in budgets.values() for line in budget.contributions)
    stacked(axes, rows, {term: np.array([own.share(term) for own in budgets.values()]) for term in terms}, source_words)
    axes.set(xlabel="share of the variance (1)", title="Uncertainty budgets; right: standard uncertainty u")
    right_labels(axes, rows, [_size(budget.u, budget.unit) for budget in budgets.values()])
    figure.legend(loc="outside lower center", ncols=4)
    return figure


def _size(u: float, unit: str) -> str:
    factor, label = display_unit(unit)
    return f"{round_uncertainty(u * factor)[0]} {label}"


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
    for k, (campaign, table) in enumerate(differences.items()):
        own, colour = table.reindex(names), PALETTE[k % 7]
        shifted = rows + 0.28 * (0.5 * (len(differences) - 1) - k)
        axes.hlines(shifted, own["ci_low"] / own["sd"], own["ci_high"] / own["sd"], color=colour, linewidth=1.6, label=campaign)
        axes.plot(own["difference"] / own["sd"], shifted, "o", color=colour, markersize=3.6)
    axes.axvline(0.0, color=GREY, linewidth=0.9)
    axes.set_xlabel("difference / its standard uncertainty (1)")
    first = next(iter(differences.values()))
    texts = {str(name): mean_and_sd(own["difference"], own["sd"], own["unit"]) for name, own in first.iterrows()}
    right_labels(axes, rows, [texts.get(name, "") for name in names])
    if len(differences) > 1:
        figure.legend(loc="outside lower center", ncols=3)
    whose = " of the second" if len(differences) > 1 else ""
    axes.set_title(f"Difference to the first campaign, {100 * ci_prob:g} % interval; right: difference ± u{whose}")
    return figure


# ---- comparison

_STRENGTHS = {5.0: "#F4F4F4", 3.0: "#EAEAEA", 1.0: "#DEDEDE"}
_TICKS = (-1000, -100, -10, -2, 0, 2, 10, 100, 1000, 10000)
_DASHES = ("-", "--", ":")
_LEAST_P = 5e-5


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
    colours = [ACCENT if comparison.allowed(assumed) else "#C9C9C9" for assumed in bars]
    axes.barh(rows, [assumed.log_bayes_factor for assumed in bars], color=colours, height=0.7)
    axes.set_xscale("symlog", linthresh=5.0)
    low, high = axes.get_xlim()
    low = min(low, -20.0)
    axes.set(xlim=(low, high), xticks=[tick for tick in _TICKS if low <= tick <= high])
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}".replace("-", "−"))
    axes.axvline(0.0, color="black", linewidth=0.9)
    axes.set_yticks(rows, [assumed.assumption.replace(" with one scale", "") for assumed in bars])
    axes.grid(axis="y", visible=False)
    axes.set_xlabel(f"ln B({comparison.sensitivity_of}) (nat, linear within ±5)")
    gains = [comparison.gain(assumed) for assumed in bars]
    right_labels(axes, rows, [f"{gain:+.{int(abs(gain) < 100.0)}f}".replace("-", "−") for gain in gains])
    axes.set_title("Under other assumptions; right: their evidence (nat), grey below −5", loc="right")
    return figure


def _scale_curve(axes: Axes, comparison: Comparison) -> None:
    for limit, shade in _STRENGTHS.items():
        axes.axhspan(-limit, limit, color=shade, zorder=0)
    axes.axhline(0.0, color="black", linewidth=0.9)
    scaled = [(own.slope_scale, own.log_bayes_factor) for own in comparison.prior_sensitivity]
    values = [1.1 * value for _, value in scaled]
    if scaled:
        axes.plot(*zip(*scaled, strict=True), "o-", color=ACCENT, markersize=3.5)
        own = comparison.log_bayes_factor[comparison.sensitivity_of]
        axes.axhline(own, color=ACCENT, linewidth=0.7, linestyle=":")
        where = {"xytext": (0, 2), "textcoords": "offset points"}
        axes.annotate("as in the models", (scaled[0][0], own), fontsize=7, color=ACCENT, **where)  # type: ignore[arg-type]
        axes.set_xscale("log")
        axes.set_xticks([0.03, 0.1, 0.3, 1.0, 3.0], ["0.03", "0.1", "0.3", "1", "3"])
        axes.minorticks_off()
        for crossing in comparison.prior_sensitivity_crossings:
            axes.axvline(crossing, color=PALETTE[1], linewidth=0.9, linestyle="--")
    axes.set_ylim(min([-6.0, *values]), max([6.0, *values]))
    axes.set(xlabel="slope scale (1): sd(slope) (F_max − F_min) / sd(C)", ylabel=f"ln B({comparison.sensitivity_of}) (nat)")


def _evidence_bars(axes: Axes, comparison: Comparison) -> None:
    """ln Z of every model against the first, and its probability."""
    names = list(comparison.models)
    rows = np.arange(len(names))[::-1]
    values = [0.0, *(comparison.log_bayes_factor[f"{name}/{names[0]}"] for name in names[1:])]
    axes.barh(rows, values, color=[PALETTE[k % len(PALETTE)] for k in range(len(names))], height=0.6)
    axes.axvline(0.0, color="black", linewidth=0.9)
    axes.set_yticks(rows, [f"{name}: {model.posterior_probability:.3g}" for name, model in comparison.models.items()])
    axes.set(ylim=(-0.6, len(names) - 0.4), xlabel=f"ln Z − ln Z({names[0]}) (nat)")
    axes.grid(axis="y", visible=False)
    axes.set_title("Models: probability at equal prior odds", loc="left")


@styled
def compliance_with_local_fits(comparison: Comparison) -> Figure:
    """C(F): band averaged over slope subsets, mean of every model, and local fits (the paper's Fig. 15).

    A local fit, its geometry free, estimates the tangent d(F C)/dF; that of the averaged C(F) is drawn for it.
    """
    curves = comparison.compliance_against_force or next(iter(comparison.models.values())).compliance_against_force
    figure, every = panels(len(curves), 3, 9.6, 2.5)
    for axes, (name, curve) in zip(every, curves.items(), strict=True):
        factor, label = axis_label(name, curve.unit)
        words = f"{100 * curve.ci_prob:g} %, averaged over slope subsets"
        band(axes, curve.force_N, curve.low * factor, curve.high * factor, ACCENT, label=words)
        for k, (model, of_model) in enumerate(comparison.models.items()):
            own = of_model.compliance_against_force[name]
            axes.plot(own.force_N, own.mean * factor, color=PALETTE[k], linestyle=_DASHES[k % 3], label=f"{model}, mean")
        tangent = np.gradient(curve.force_N * curve.mean, curve.force_N)
        axes.plot(curve.force_N, tangent * factor, color="black", linewidth=0.9, linestyle=":", label="d(F·C)/dF: for local fits")
        _local(axes, comparison.local_fits, name, factor)
        axes.axhline(0.0, color=GREY, linewidth=0.6)
        axes.set(xlabel="force (N)", ylabel=label)
        if name in comparison.slopes:
            axes.set_title(f"varies with probability {comparison.slopes[name].inclusion_probability:.2f}")
    legend_below(figure, every[0], 5)
    figure.suptitle("Compliance against force, with local fits of neighbouring force levels")
    return figure


@styled
def geometry_with_local_fits(comparison: Comparison) -> Figure:
    """Geometric errors of every model and of local fits against force (the paper's Fig. 16)."""
    first = next(iter(comparison.models.values()))
    names = [name for name in first.parameters if name.startswith("E_")]
    figure, every = panels(len(names), 4, 11.0, 2.4)
    likeliest = ranked(comparison.models.values(), lambda model: model.posterior_probability)[0]
    forces = [test.force_N for test in comparison.tests.values()] or [0.0, 1.0]
    span = [min(forces), max(forces)]
    for axes, name in zip(every, names, strict=True):
        factor, label = axis_label(name, first.parameters[name].unit)
        for k, (model, own) in enumerate(comparison.models.items()):
            mean, sd = own.parameters[name].mean * factor, own.parameters[name].sd * factor
            if own is likeliest:
                band(axes, span, mean - 2.0 * sd, mean + 2.0 * sd, PALETTE[k], 0.13, label=f"{model}, ± 2 u")
            axes.plot(span, [mean, mean], color=PALETTE[k], linestyle=_DASHES[k % 3], label=f"{model}, mean")
        _local(axes, comparison.local_fits, name, factor)
        axes.set(xlabel="force (N)", ylabel=label)
    legend_below(figure, every[0], 5)
    figure.suptitle("Geometric errors: the model has them constant; local fits of neighbouring force levels")
    return figure


def _local(axes: Axes, local: pd.DataFrame, name: str, factor: float) -> None:
    if local.empty:
        return
    rows = local[local["parameter"] == name]
    force, middle = rows["force_N"], rows["mean"] * factor
    reach = np.abs([middle - rows["ci_low"] * factor, rows["ci_high"] * factor - middle])
    axes.errorbar(force, middle, yerr=reach, fmt="o", color="black", markersize=3.5, linewidth=1.0, label="local, posterior")
    axes.plot(force, rows["least_squares"] * factor, "x", color=PALETTE[1], markersize=5, label="local, least squares")


@styled
def predictive_p_values(comparison: Comparison) -> Figure:
    """Leave-one-force-out predictive p-value of every test, as a whole and by Fourier order."""
    tests = comparison.tests
    figure = new_figure(8.6, 1.5 + 0.34 * max(len(tests), 3))
    axes = figure.subplots()
    if not tests:
        nothing(axes, "one test: nothing to leave out")
        return figure
    orders = len(next(iter(tests.values())).lofo_p_value_by_order)
    values = np.array([[*t.lofo_p_value_by_order.values(), t.lofo_p_value, t.lofo_family_wise_p_value] for t in tests.values()])
    across = [*map(str, range(orders)), "all", "Holm"]
    down = [f"{display_name(name)}{'  FLAGGED' if test.flag else ''}" for name, test in tests.items()]
    shades = {"cmap": "magma", "vmin": np.log10(_LEAST_P), "vmax": 0.0}
    image = heat_map(axes, np.log10(np.maximum(values, _LEAST_P)), across, down, **shades)
    for (i, j), value in np.ndenumerate(values):
        text = f"{value:.2f}" if value >= 0.01 else f"{value:.0e}".replace("e-0", "e−")
        axes.text(j, i, text, ha="center", va="center", fontsize=6.5, color="white" if value < 0.02 else "black")
    axes.axvline(orders - 0.5, color="white", linewidth=4)
    axes.set_xlabel("Fourier order (1); all orders together; the same allowing for the number of tests")
    figure.colorbar(image, ax=axes, shrink=0.8, label="log10 p (1)")
    axes.set_title(f"Would the other tests expect this circle? Predictive p, flagged where Holm's is below {FALSE_ALARMS:g}")
    return figure


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
        f"Ranks of the truth among posterior draws, minus uniform: {validation.replicates} simulated campaigns, "
        f"{validation.sampler}; band: {100 * validation.prob:g} % for all quantities together"
    )
    return figure


# ---- design

_MOST_PLACES, _MOST_CURVES = 8, 6
_ALIKE = 0.02
_LONG = 60
_NOT_ASKED = "no trade-off was asked for"


@styled
def information(design: Design) -> Figure:
    """Sensitivity of the criterion to one more test, against force, and the tests chosen."""
    figure = new_figure(8.0, 4.6)
    axes, below = figure.subplots(2, 1, sharex=True, height_ratios=[2.6, 1.0])
    curves = _different(design)
    for k, (place, (own, alike)) in enumerate(curves.items()):
        others = f" ({alike} more alike)" if alike else ""
        label = f"{_place(place, design.columns)}{others}" if len(curves) > 1 or alike else None
        marker = "" if len(own) > 2 else "o"
        axes.plot(own["force_N"], own["sensitivity"], color=PALETTE[k % len(PALETTE)], marker=marker, label=label)
    axes.axhline(design.certificate.bound, color="black", linewidth=0.9, linestyle="--", label="bound: no candidate above it")
    axes.set_ylim(0.0, 1.12 * max(design.certificate.bound, design.certificate.max_sensitivity))
    axes.set_ylabel("sensitivity (1)" if design.criterion in ("eig", "d") else "sensitivity (units of the criterion)")
    axes.set_title("How much the criterion gains per share of circles at a force, and the circles chosen")
    legend_below(figure, axes, 2 if max(map(len, axes.get_legend_handles_labels()[1])) < _LONG else 1)
    _numbers_of_circles(below, design)
    return figure


def _different(design: Design) -> dict[Any, tuple[pd.DataFrame, int]]:
    """Sensitivities against force at every clocking and radius, the highest first; those much alike counted, not shown."""
    by_place = design.sensitivity.groupby(list(design.columns), sort=False)
    groups = [(place, own.sort_values("force_N")) for place, own in by_place]
    shown: dict[Any, tuple[pd.DataFrame, int]] = {}

    def alike(one: pd.DataFrame, other: pd.DataFrame) -> bool:
        a, b = one["sensitivity"].to_numpy(), other["sensitivity"].to_numpy()
        return len(a) == len(b) and bool(np.abs(a - b).max() < _ALIKE * design.certificate.bound)

    for place, own in ranked(groups, lambda group: float(group[1]["sensitivity"].max())):
        like = next((p for p, (other, _) in shown.items() if alike(other, own)), None)
        if like is not None:
            shown[like] = (shown[like][0], shown[like][1] + 1)
        elif len(shown) < _MOST_PLACES:
            shown[place] = (own, 0)
    return shown


def _place(place: Any, columns: tuple[str, ...]) -> str:
    own = dict(zip(columns, place, strict=True))
    balls = f"balls {own.pop('work_ball_deg'):g}°/{own.pop('tool_ball_deg'):g}°, R {own.pop('radius_mm'):g} mm"
    return ", ".join([*filter(None, [place_words(own)]), balls])


def _numbers_of_circles(axes: Axes, design: Design) -> None:
    """Per force: recommended above, equal steps and others below one another."""
    rows = [("recommended", design.table.groupby("force_N")["count"].sum(), ACCENT)]
    for k, own in enumerate(design.compared):
        rows.append((own.name, own.tests["force_N"].value_counts().sort_index(), PALETTE[1 + (k - 1) % 5] if k else GREY))
    for row, (_, counts, colour) in enumerate(rows):
        axes.plot(counts.index.to_numpy(dtype=float), np.full(len(counts), -row), "o", color=colour, markersize=6)
        for x, n in counts[counts > 1].items():
            axes.annotate(f"{n}×", (x, -row), xytext=(0, 5), textcoords="offset points", ha="center", fontsize=7)
    axes.set_yticks([-row for row in range(len(rows))], [name for name, *_ in rows])
    axes.set(ylim=(-len(rows) + 0.5, 0.8), xlabel="force (N)")
    axes.grid(axis="y", visible=False)


@styled
def efficiency(design: Design) -> Figure:
    """Efficiency against the number of tests: the best whole tests, and equal steps."""
    figure = new_figure(5.6, 3.8)
    axes = figure.subplots()
    table = design.trade_off
    if table.empty:
        nothing(axes, _NOT_ASKED)
        return figure
    axes.plot(table["tests"], table["efficiency"], "o-", color=ACCENT, label="best whole tests")
    axes.plot(table["tests"], table["efficiency_equal_steps"], "s--", color=PALETTE[1], label="equal steps of force")
    for k, other in enumerate(design.compared[1:]):
        axes.plot(len(other.tests), other.efficiency, "D", color=PALETTE[2 + k % 4], label=other.name)
    axes.set(ylim=(0.0, 1.05), xlabel="number of circles (1)", ylabel=f"efficiency by criterion {design.criterion} (1)")
    axes.set_title("1: the best shares of as many circles")
    axes.legend(loc="lower right")
    return figure


@styled
def trade_off(design: Design) -> Figure:
    """Expected sd of the parameters of interest against the number of tests, and what no number falls below."""
    expected, table = design.expected, design.trade_off
    # Those that more tests would narrow most.
    names = ranked(design.parameters, lambda name: -expected[name].floor_sd / expected[name].sd)[:_MOST_CURVES]
    columns = min(3, len(names))
    figure, every = panels(len(names), columns, 3.3 * columns + 0.3, 2.5, 0.5)
    for axes, name in zip(every, names, strict=True):
        if table.empty:
            nothing(axes, _NOT_ASKED)
            continue
        factor, label = axis_label(name, expected[name].unit)
        axes.plot(table["tests"], table[f"sd_{name}"] * factor, "o-", color=ACCENT)
        axes.plot(design.table["count"].sum(), expected[name].sd * factor, "o", color="black", markersize=7, fillstyle="none")
        axes.axhline(expected[name].floor_sd * factor, color=GREY, linestyle="--", linewidth=0.9)
        axes.set_ylim(0.0, 1.15 * factor * max(table[f"sd_{name}"].max(), expected[name].sd))
        axes.set(xlabel="number of circles (1)", ylabel=f"u of {label}")
    figure.suptitle("Expected standard uncertainty; ringed: recommended;\ndashed: what more such circles cannot go below")
    return figure


@styled
def expected_widths(design: Design) -> Figure:
    """Expected standard uncertainty of every parameter as a share of its prior sd: recommended, baseline, others, floor."""
    expected = design.expected
    proper = bool(np.isfinite(next(iter(expected.values())).prior_sd))
    scale = {name: expected[name].prior_sd if proper else design.baseline[name].sd for name in expected}

    def shares(forecast: Any, size: str = "sd") -> list[float]:
        return [getattr(forecast[name], size) / scale[name] for name in expected]

    figure, axes, rows = named_rows(list(expected), 7.6, 1.2)
    axes.barh(rows, shares(expected), height=0.62, color=ACCENT, label="recommended")
    axes.plot(shares(expected, "floor_sd"), rows, "|", color="white", markersize=9, markeredgewidth=1.6)
    for k, judged in enumerate(design.compared):
        style: dict[str, Any] = {"marker": "D", "color": PALETTE[k % 6]} if k else {"marker": "o", "color": "black"}
        axes.plot(shares(judged.expected), rows, linestyle="", markersize=4, label=judged.name, **style)
    axes.set_yticks(rows, [display_name(name) + ("" if name in design.parameters else " (nuisance)") for name in expected])
    axes.set_xscale("log")
    axes.grid(axis="y", visible=False)
    against = "prior sd" if proper else f"that of {design.compared[0].name}"
    axes.set_xlabel(f"expected u / {against} (1); white: more of the recommended circles would not go below")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=4)
    return figure
