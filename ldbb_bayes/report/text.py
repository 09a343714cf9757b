"""Results as tables and sentences, for a terminal, a notebook and the page."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from dataclasses import fields
from functools import singledispatch
from itertools import zip_longest
from typing import Any

import numpy as np
import pandas as pd

from ldbb_bayes.analysis.calibration import LOG_LIKELIHOOD, Validation
from ldbb_bayes.analysis.comparison import Comparison
from ldbb_bayes.analysis.design.design import Design
from ldbb_bayes.analysis.identifiability import DescribedMachine, Identifiability, ParameterIdentifiability, Seen
from ldbb_bayes.campaign.importing import Imported
from ldbb_bayes.campaign.preview import CampaignPreview
from ldbb_bayes.inference.least_squares import LeastSquares
from ldbb_bayes.inference.posterior import ConcernKind, Fit
from ldbb_bayes.model.hybrid import HybridModel, Simulation
from ldbb_bayes.model.terms import Term
from ldbb_bayes.report.wording import (
    IN_FORCE,
    comparison_sentences,
    concern_sentences,
    design_sentences,
    fit_sentences,
    fit_verdict,
    identifiability_sentences,
    interval_of,
    joined,
    machine_sentences,
    nuisance_words,
    percent_of,
    preview_sentences,
    subset_words,
    sum_in_words,
    term_words,
    unit_words,
    validation_verdict,
    verdict_words,
)
from ldbb_bayes.result import Result, Table
from ldbb_bayes.units import (
    display_name,
    display_unit,
    is_direct,
    ranked,
    round_like,
    round_uncertainty,
    state,
    stiffness,
    value_and_uncertainty,
)

__all__ = [
    "clear_of_zero",
    "expected_table",
    "html_of",
    "left_out_frame",
    "left_out_table",
    "models_table",
    "nuisance_table",
    "parameter_table",
    "parameters_frame",
    "parts_of",
    "parts_of_fit",
    "preview_table",
    "results_table",
    "sensitivity_frame",
    "slopes_table",
    "subsets_frame",
    "text_of",
    "two_digits",
]


@singledispatch
def parts_of(result: Any) -> tuple[Table | str, ...]:
    """Return a result as tables and sentences, in the order they are read.

    Every room registers a function for each of its kinds of result (``@parts_of.register``), which takes its sentences from
    `ldbb_bayes.report.wording`.
    """
    rows = [(field.name, getattr(result, field.name)) for field in fields(result)]
    brief = [(name, value if isinstance(value, str | float | int | None) else f"{type(value).__name__}") for name, value in rows]
    return (Table.of(type(result).__name__, ("field", "value"), brief, text=("value",)),)


def text_of(result: Result, width: int = 120) -> str:
    """Return a result for a terminal or a log."""
    return "\n".join(part if isinstance(part, str) else part.text(width) + "\n" for part in parts_of(result))


def html_of(result: Result) -> str:
    """Return a result for a notebook; everything is escaped."""
    return "".join(f"<p>{html.escape(part)}</p>" if isinstance(part, str) else part.html() for part in parts_of(result))


def two_digits(value: float | None, factor: float = 1.0) -> str:
    """Return a number of either sign with two significant digits and no exponent; a dash for one that is missing or infinite."""
    if value is None or not np.isfinite(value):
        return "–"
    return f"{'−' if value < 0 else ''}{round_uncertainty(abs(value) * factor)[0]}"


def _three_digits(value: float) -> str:
    return f"{value:.3g}" if value < 1000.0 else f"{value:.0f}"


# ---- campaign and machine

_PLACES = {
    "plane": ("plane", "{}"),
    "setup": ("set-up", "{}"),
    "radius_mm": ("R (mm)", "{:g}"),
    "centre_mm": ("centre (mm)", "({0[0]:g}, {0[1]:g}, {0[2]:g})"),
}


@parts_of.register
def _(result: Imported) -> tuple[Table]:
    rows = [(f"{own.what}: {own.value}", own.because, own.option, own.place or "the campaign") for own in result.assumptions]
    heads = ("assumed", "because", "option", "where")
    campaign = result.campaign
    return (
        Table.of(f"{campaign.name}: {len(campaign.tests)} tests, {campaign.readings} readings; assumed", heads, rows, text=heads),
    )


@parts_of.register
def _(seen: CampaignPreview) -> tuple[Table | str, ...]:
    return (preview_table(seen), *preview_sentences(seen))


def preview_table(seen: CampaignPreview) -> Table:
    """Return a row per test of a campaign; plane, set-up, radius and centre where tests differ in them."""
    different = [field for field in _PLACES if len({getattr(test, field) for test in seen.tests}) > 1]
    rows = [
        (
            test.name,
            f"{test.force_N:.4g}",
            f"{test.pressure_bar:.3g}",
            str(test.readings),
            f"{test.arc_deg:.0f}",
            f"{test.largest_gap_deg:.2g}",
            test.direction or (f"({test.travel})" if test.travel else "–"),
            *(_PLACES[field][1].format(getattr(test, field)) for field in different),
            f"{test.work_ball_deg:g} / {test.tool_ball_deg:g}",
            "–" if test.resolution_um is None else f"{test.resolution_um:.2g}",
            str(test.spikes),
            *("–" if own is None else f"{own:.3g}" for own in (test.noise_um, test.start_end_um, test.peak_to_peak_um)),
        )
        for test in seen.tests
    ]
    first = ("test", "force (N)", "pressure (bar)", "readings", "arc (°)", "gap (°)", "direction")
    heads = (*first, *(_PLACES[field][0] for field in different), "balls (°)", "step (µm)", "spikes", "noise (µm)")
    return Table.of("", (*heads, "end − start (µm)", "peak to peak (µm)"), rows, text=("direction", "plane", "centre (mm)"))


@parts_of.register
def _(machine: DescribedMachine) -> tuple[Table | str, ...]:
    first, *others = machine_sentences(machine)
    patterns = ["pattern"] if len(machine.planes) == 1 else [f"pattern in {plane}" for plane in machine.planes]

    def table(title: str, entries: tuple[Seen, ...], *last: str) -> Table:
        heads = (title, "unit", *patterns, "what it is", *last)
        rows = []
        for entry in entries:
            shown = (entry.pattern.get(plane, "·") for plane in machine.planes)
            words = (entry.meaning, *[sum_in_words(entry)] * len(last))
            rows.append((display_name(entry.name), display_unit(entry.unit)[1], *shown, *words))
        return Table.of("", heads, rows, text=heads)

    compliances = table("compliance", machine.compliances, "stands for")
    return (first, compliances, table("geometric error", machine.geometric_errors), *others)


# ---- model and fit


@parts_of.register
def _(model: HybridModel) -> tuple[Table]:
    prior = "flat" if model.prior.flat else "proper, truncated to physical compliances" if model.prior.truncated else "proper"
    rows = [
        (type(term).__name__, ", ".join(f"{k} = {v if isinstance(v, str) else f'{v:g}'}" for k, v in vars(term).items()))
        for term in model.nuisances
    ]
    caption = f"HybridModel: compliance {IN_FORCE[model.degree]}; priors {prior}; nuisances"
    return (Table.of(caption, ("term", "settings"), rows or [("none", "")], text=("settings",)),)


@parts_of.register
def _(made: Simulation) -> tuple[Table]:
    rows = [*made.parameters.items(), *((f"{name}_um", value) for name, value in made.hyper_um.items())]
    caption = f"Simulation of {made.campaign.name}, {len(made.campaign.tests)} tests"
    return (Table.of(caption, ("true parameter", "value (mm, N, rad; hyper-parameters µm)"), rows),)


@parts_of.register
def _(fit: Fit) -> tuple[str, ...]:
    others = tuple(concern for concern in fit.concerns if concern.kind != ConcernKind.NOT_CONVERGED)
    return (fit_verdict(fit), *concern_sentences(others, {}))


@parts_of.register
def _(result: LeastSquares) -> tuple[Table]:
    frame = result.table.reset_index(names="parameter")
    return (Table.of_frame(f"Least squares (Eq. 31), RMSE {result.quality.rmse_um:.3g} µm", frame, text=("unit",)),)


def parts_of_fit(result: Mapping[str, Any]) -> tuple[Table | str, ...]:
    """Return the JSON of a fit as tables and sentences; nuisances are those that bar, balls, mount and force do not bring."""
    others = {name: own for name, own in result["nuisances"].items() if not Term.kinds.get(own["term"], Term).instrument}
    if not others:
        return (parameter_table(result), *fit_sentences(result))
    clear = clear_of_zero(others)
    terms = joined(list(dict.fromkeys(term_words(own["term"]) for own in others.values()))).capitalize()
    caption = f"{terms} beyond 2 u; {len(others) - len(clear)} of {len(others)} coefficients are not told from zero"
    nuisances = nuisance_table(caption, clear, ("nuisance", "mean", "u (1 sd)", "prior sd", "unit"))
    return (parameter_table(result), nuisances, *fit_sentences(result))


def parameter_table(result: Mapping[str, Any]) -> Table:
    """Return posterior mean ± sd, credible interval and prior sd (where priors have means, mean ± sd), in units for reading.

    Parameters
    ----------
    result : mapping
        The JSON of a fit.
    """
    entries = {**result["parameters"], **result["hyper"]}
    means = any(entry.get("prior_mean") for entry in entries.values())
    rows = []
    for name, entry in entries.items():
        factor, unit = display_unit(entry["unit"])
        spread, decimals = round_uncertainty(entry["sd"] * factor)
        low, high = (round_like(bound * factor, decimals) for bound in interval_of(entry))
        prior = "flat" if entry["prior_sd"] is None else _three_digits(entry["prior_sd"] * factor)
        if means and (middle := entry.get("prior_mean")) is not None:
            prior = " ± ".join(value_and_uncertainty(middle * factor, entry["prior_sd"] * factor))
        elif means:
            prior = f"± {prior}"
        shown = display_name(name.removesuffix("_um"))
        rows.append((shown, round_like(entry["mean"] * factor, decimals), spread, f"[{low}, {high}]", prior, unit))
    heads = ("parameter", "mean", "u (1 sd)", f"{percent_of(result)} interval", "prior" if means else "prior sd", "unit")
    return Table.of("", heads, rows, text=("unit",))


def results_table(result: Mapping[str, Any], verdicts: Mapping[str, ParameterIdentifiability]) -> Table:
    """Return value, u, U, interval, unit, stiffness of the direct compliances, and verdict of every parameter."""
    rows = []
    for name, entry in result["parameters"].items():
        own = state(entry["mean"], entry["sd"], interval_of(entry), entry["unit"])
        stiff = stiffness(entry["median"], interval_of(entry)) if is_direct(name) else ""
        cells = (own.value, own.u, own.expanded, own.interval, own.unit, stiff, verdict_words(verdicts[name]))
        rows.append((display_name(name), *cells))
    heads = ("parameter", "value", "u", "U (k = 2)", f"{percent_of(result)} interval", "unit", "stiffness (N/µm)", "identified?")
    return Table.of("Compliances, their slopes, geometric errors", heads, rows, text=("unit", "identified?"))


def nuisance_table(caption: str, entries: Mapping[str, Mapping[str, Any]], heads: Sequence[str]) -> Table:
    """Return mean, standard uncertainty, prior sd and unit of nuisance coefficients; ``heads`` name these five columns."""
    rows = []
    for name, entry in entries.items():
        one, unit = unit_words(name)
        mean, spread = value_and_uncertainty(entry["mean"] / one, entry["sd"] / one)
        rows.append((nuisance_words(name), mean, spread, round_uncertainty(entry["prior_sd"] / one)[0], unit))
    return Table.of(caption, heads, rows, text=("unit",))


def clear_of_zero(entries: Mapping[str, Mapping[str, Any]]) -> dict[str, Mapping[str, Any]]:
    """Return the entries whose mean lies more than 2 sd off zero."""
    return {name: entry for name, entry in entries.items() if abs(entry["mean"]) > 2.0 * entry["sd"]}


# ---- identifiability and calibration


@parts_of.register
def _(result: Identifiability) -> tuple[Table | str, ...]:
    """With prior and posterior sd, contraction, information and verdict of every parameter."""
    rows = []
    for name, entry in result.parameters.items():
        factor, unit = display_unit(entry.unit)
        proper = entry.prior_sd < float("inf")
        prior = _three_digits(entry.prior_sd * factor) if proper else "flat"
        gains = (f"{entry.contraction:.4f}", f"{entry.information_gain:.1f}") if proper else ("", "")
        rows.append((display_name(name), prior, round_uncertainty(entry.sd * factor)[0], unit, *gains, verdict_words(entry)))
    heads = ("parameter", "prior sd", "sd", "unit", "contraction", "gain (nat)", "verdict")
    return (Table.of("", heads, rows, text=("unit", "verdict")), *identifiability_sentences(result))


def parameters_frame(result: Identifiability) -> pd.DataFrame:
    """Return a row per parameter in units for reading, for CSV."""
    rows = []
    for name, entry in result.parameters.items():
        factor, unit = display_unit(entry.unit)
        gains = (entry.contraction, entry.information_gain, entry.overlap)
        rows.append((display_name(name), entry.prior_sd * factor, entry.sd * factor, unit, *gains, verdict_words(entry)))
    heads = ["parameter", "prior sd", "sd", "unit", "contraction", "gain (nat)", "overlap", "verdict"]
    return pd.DataFrame(rows, columns=heads)


@parts_of.register
def _(validation: Validation) -> tuple[Table | str, ...]:
    """With the share of truths inside their intervals, its standard error, and whether the ranks stay inside the band."""
    coverage = validation.coverage()
    claimed = [name for name in coverage.columns if not name.startswith("u")]
    rows = []
    for name, row in coverage.loc[list(validation.names)].iterrows():
        shares = [f"{100 * row[p]:.1f} ± {100 * row['u' + p]:.1f} %" for p in claimed]
        shown = "ln likelihood" if name == LOG_LIKELIHOOD else display_name(str(name))
        rows.append((shown, *shares, "outside the band" if name in validation.outside else "inside"))
    heads = ("quantity", *(f"in {interval} % interval" for interval in claimed), "ranks")
    return (Table.of("", heads, rows, text=("ranks",)), validation_verdict(validation))


# ---- comparison


@parts_of.register
def _(result: Comparison) -> tuple[Table | str, ...]:
    tables = (models_table(result), _assumption_table(result), slopes_table(result), left_out_table(result))
    return (*(table for table in tables if table.rows), *comparison_sentences(result))


def models_table(comparison: Comparison) -> Table:
    """Return a row per model: ln B over the first, probability, leave-one-force-out, RMSE."""
    first = comparison.pair[0]
    rows = []
    for name, model in comparison.models.items():
        ratio = f"{name}/{first}"
        gain, squares = comparison.elpd_difference.get(ratio), model.least_squares.rmse_um
        factor, elpd = "0", "0"
        if name != first:
            factor = f"{comparison.log_bayes_factor[ratio]:+.3f} ± {max(comparison.log_bayes_factor_error[ratio], 1e-3):.1g}"
            elpd = "–" if gain is None else f"{gain.value:+.1f} ± {gain.se:.1f}"
        fits = (f"{model.rmse_um:.2f}", "–" if np.isnan(squares) else f"{squares:.2f}")
        rows.append((name, factor, f"{model.posterior_probability:.3g}", elpd, *fits))
    over = [f"{what} over {first} (nat)" for what in ("ln B", "elpd")]
    heads = ("model", over[0], "probability", over[1], "RMSE with nuisances (µm)", "least squares (µm)")
    return Table.of("", heads, rows)


def _assumption_table(comparison: Comparison) -> Table:
    """ln B under every assumption, and the evidence of the assumption itself against the models' own."""
    scaled = [(f"slope scale {s.slope_scale:g}", f"{s.log_bayes_factor:+.2f}", "") for s in comparison.prior_sensitivity]
    every = comparison.assumptions.values()
    assumed = [(a.assumption, f"{a.log_bayes_factor:+.2f}", f"{comparison.gain(a):+.1f}") for a in every]
    return Table.of("", ("assumption", f"ln B({comparison.sensitivity_of}) (nat)", "its evidence (nat)"), [*scaled, *assumed])


def slopes_table(comparison: Comparison) -> Table:
    """Return the probability that each compliance varies with force, and the likeliest sets."""
    rows = []
    for (name, slope), subset in zip_longest(comparison.slopes.items(), comparison.slope_subsets[: len(comparison.slopes)]):
        quadratic = slope.quadratic_probability
        more = "" if quadratic is None else f" (quadratic {quadratic:.2f})"
        likeliest = ("", "") if subset is None else (", ".join(subset_words(subset)), f"{subset.probability:.3f}")
        rows.append((display_name(name), f"{slope.inclusion_probability:.2f}{more}", *likeliest))
    heads = ("compliance", "varies with probability", "likeliest sets", "probability")
    return Table.of("", heads, rows, text=("likeliest sets",))


def left_out_table(comparison: Comparison) -> Table:
    """Return every test left out: p-values, what tells the models apart, and the parameter that leaving it out moves most."""
    first, second = comparison.pair
    rows = []
    for name, test in comparison.tests.items():
        worst = max(test.psis_loo[first], test.psis_loo[second], key=lambda own: own.pareto_k)
        parameter, change = ranked(test.without_it[second].items(), lambda pair: abs(pair[1].shift))[0]
        p = [f"{p:.2f}" if p >= 0.01 else f"{p:.1g}" for p in (test.lofo_p_value, test.lofo_family_wise_p_value)]
        ratio = f"{test.lofo_log_density[second] - test.lofo_log_density[first]:+.2f}"
        smoothed = f"{worst.pareto_k:.2f}{'' if worst.trustworthy else ' (too large)'}"
        moves = f"{display_name(parameter)} by {change.shift:+.1f} u"
        rows.append((name, f"{test.force_N:.4g}", *p, "FLAG" if test.flag else "", ratio, smoothed, moves))
    heads = ["test", "force (N)", "p", "p, all tests", "flag", f"ln p({comparison.sensitivity_of}) (nat)", "Pareto k"]
    last = "moves most when left out (u: of all tests)"
    return Table.of("", (*heads, last), rows, text=("flag", last))


def left_out_frame(comparison: Comparison) -> pd.DataFrame:
    """Every test, model and parameter without the test; inside units."""
    rows = [
        {
            "test": name,
            "force_N": test.force_N,
            "flag": test.flag,
            "p_value": test.lofo_p_value,
            "family_wise_p_value": test.lofo_family_wise_p_value,
            "model": model,
            "lofo_log_density": test.lofo_log_density[model],
            "parameter": parameter,
            **{key: getattr(comparison.models[model].parameters[parameter], key) for key in ("unit", "mean", "sd")},
            "mean_without": change.mean,
            "sd_without": change.sd,
            "shift": change.shift,
        }
        for name, test in comparison.tests.items()
        for model, changes in test.without_it.items()
        for parameter, change in changes.items()
    ]
    return pd.DataFrame(rows)


def sensitivity_frame(comparison: Comparison) -> pd.DataFrame:
    """ln B under every slope scale and every assumption [nat]."""
    scaled = [
        {"assumption": "slope scale", "slope_scale": s.slope_scale, "log_bayes_factor": s.log_bayes_factor, "error": s.error}
        for s in comparison.prior_sensitivity
    ]
    assumed = [
        {
            "assumption": a.assumption,
            "log_bayes_factor": a.log_bayes_factor,
            "error": a.log_bayes_factor_error,
            **{f"log_evidence_{name}": value for name, value in a.log_evidence.items()},
        }
        for a in comparison.assumptions.values()
    ]
    return pd.DataFrame([*scaled, *assumed])


def subsets_frame(comparison: Comparison) -> pd.DataFrame:
    """Every slope subset: power of force of each compliance, log evidence, probability."""
    rows = [{**s.powers, "log_evidence": s.log_evidence, "probability": s.probability} for s in comparison.slope_subsets]
    return pd.DataFrame(rows, columns=None if rows else ["log_evidence", "probability"])


# ---- design

_HEADS = {
    "force_N": "force (N)",
    "work_ball_deg": "work ball (°)",
    "tool_ball_deg": "tool ball (°)",
    "radius_mm": "radius (mm)",
    "setup": "set-up",
    **{f"centre_{axis}_mm": f"centre {axis.upper()} (mm)" for axis in "xyz"},
}


@parts_of.register
def _(design: Design) -> tuple[Table | str, ...]:
    """With the different tests and how often to run each."""
    heads = [_HEADS.get(name, name) for name in ("force_N", *design.columns)]
    every = design.table.to_numpy(dtype=object).tolist()
    rows = [[value if isinstance(value, str) else f"{value:.4g}" for value in row] for row in every]
    tables = (Table.of("", [*heads, "circles"], rows), expected_table(design), _robustness_table(design))
    return (*(table for table in tables if table.rows), *design_sentences(design))


def expected_table(design: Design, now: Mapping[str, float] | None = None, caption: str = "") -> Table:
    """Return the expected standard uncertainty of every parameter beside that of ``now``, baseline, others, floor and prior."""
    rows = []
    for name, entry in design.expected.items():
        factor, unit = display_unit(entry.unit)
        before = [] if now is None else [now.get(name)]
        sizes = [*before, entry.sd, *(own.expected[name].sd for own in design.compared), entry.floor_sd, entry.prior_sd]
        mark = "" if name in design.parameters or now is not None else " (nuisance)"
        rows.append([f"{display_name(name)}{mark}", *(two_digits(size, factor) for size in sizes), unit])
    first = ("expected u", "recommended") if now is None else ("parameter", "u now", "expected u")
    heads = [*first, *(own.name for own in design.compared), "no less than", "prior", "unit"]
    return Table.of(caption, heads, rows, text=("unit",))


def _robustness_table(design: Design) -> Table:
    """The worst efficiency of every design over the assumptions, and under which."""
    rows = []
    for name, row in design.robustness.iterrows():
        under = row.drop(["tests", "worst"]).astype(float).to_dict()
        worst = ranked(under.items(), lambda pair: -pair[1])[0][0]
        rows.append([str(name), str(row["tests"]), f"{row['worst']:.2f}", str(worst)])
    return Table.of("", ("design", "forces (N)", "worst efficiency", "where"), rows, text=("forces (N)", "where"))
