"""Results and campaigns as tables and sentences for a terminal."""

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
from ldbb_bayes.analysis.describe import DescribedMachine, Seen
from ldbb_bayes.analysis.design.design import Design
from ldbb_bayes.analysis.identifiability import Identifiability, ParameterIdentifiability
from ldbb_bayes.campaign.importing import Imported
from ldbb_bayes.campaign.preview import CampaignPreview
from ldbb_bayes.inference.least_squares import LeastSquares
from ldbb_bayes.inference.posterior import ConcernKind, Fit
from ldbb_bayes.model.hybrid import HybridModel, Simulation
from ldbb_bayes.report.wording import (
    comparison_sentences,
    concern_sentences,
    design_sentences,
    fit_sentences,
    fit_verdict,
    identifiability_sentences,
    machine_sentences,
    nuisance_words,
    preview_sentences,
    subset_words,
    sum_in_words,
    unit_words,
    validation_verdict,
    verdict_words,
)
from ldbb_bayes.result import Result
from ldbb_bayes.table import Table
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


# ---- results: one block for every room


# ---- model


@parts_of.register
def _(model: HybridModel) -> tuple[Table]:
    compliance = ("constant", "linear in force", "quadratic in force")[model.degree]
    prior = "flat" if model.prior.flat else "proper, truncated to physical compliances" if model.prior.truncated else "proper"
    settings = [
        (term, (f"{k} = {v if isinstance(v, str) else f'{v:g}'}" for k, v in vars(term).items())) for term in model.nuisances
    ]
    rows = [(type(term).__name__, ", ".join(own)) for term, own in settings] or [("none", "")]
    return (
        Table.of(
            f"HybridModel: compliance {compliance}; priors {prior}; nuisances", ("term", "settings"), rows, text=("settings",)
        ),
    )


@parts_of.register
def _(made: Simulation) -> tuple[Table]:
    rows = [*made.parameters.items(), *((f"{name}_um", value) for name, value in made.hyper_um.items())]
    caption = f"Simulation of {made.campaign.name}, {len(made.campaign.tests)} tests"
    return (Table.of(caption, ("true parameter", "value (mm, N, rad; hyper-parameters µm)"), rows),)


# ---- campaign


@parts_of.register
def _imported(result: Imported) -> tuple[Table, ...]:
    rows = [(f"{own.what}: {own.value}", own.because, own.option, own.place or "the campaign") for own in result.assumptions]
    heads = ("assumed", "because", "option", "where")
    campaign = result.campaign
    caption = f"{campaign.name}: {len(campaign.tests)} tests, {campaign.readings} readings; assumed"
    return (Table.of(caption, heads, rows, text=heads),)


@parts_of.register
def _(seen: CampaignPreview) -> tuple[Any, ...]:
    return (preview_table(seen), *preview_sentences(seen))


@parts_of.register
def _(machine: DescribedMachine) -> tuple[Any, ...]:
    lines = machine_sentences(machine)
    return (lines[0], *machine_tables(machine), *lines[1:])


@parts_of.register
def _(result: Identifiability) -> tuple[Any, ...]:
    return (identifiability_table(result), *identifiability_sentences(result))


@parts_of.register
def _(validation: Validation) -> tuple[Any, ...]:
    return (coverage_table(validation), validation_verdict(validation))


# ---- fit


@parts_of.register
def _(fit: Fit) -> tuple[str, ...]:
    others = tuple(concern for concern in fit.concerns if concern.kind != ConcernKind.NOT_CONVERGED)
    return (fit_verdict(fit), *concern_sentences(others, {}))


@parts_of.register
def _(result: LeastSquares) -> tuple[Table, ...]:
    frame = result.table.reset_index(names="parameter")
    return (Table.of_frame(f"Least squares (Eq. 31), RMSE {result.quality.rmse_um:.3g} µm", frame, text=("unit",)),)


def parts_of_fit(result: Mapping[str, Any]) -> tuple[Any, ...]:
    """Return the JSON of a fit as tables and sentences."""
    asked = {name: entry for name, entry in result["nuisances"].items() if entry["term"] in ("Hysteresis", "Drift")}
    clear = clear_of_zero(asked)
    caption = f"Hysteresis and drift beyond 2 u; {len(asked) - len(clear)} of {len(asked)} coefficients are not told from zero"
    nuisances = nuisance_table(caption, clear, ("nuisance", "mean", "u (1 sd)", "prior sd", "unit"))
    return (parameter_table(result), *([nuisances] if asked else []), *fit_sentences(result))


# ---- comparison


@parts_of.register
def _comparison(result: Comparison) -> tuple[Table | str, ...]:
    tables = (models_table(result), assumption_table(result), slopes_table(result), left_out_table(result))
    return (*(table for table in tables if table.rows), *comparison_sentences(result))


def models_table(comparison: Comparison) -> Table:
    """Return a row per model: ln B over the first, probability, leave-one-force-out, RMSE."""
    first = comparison.pair[0]
    heads = (
        "model",
        f"ln B over {first} (nat)",
        "probability",
        f"elpd over {first} (nat)",
        "RMSE with nuisances (µm)",
        "least squares (µm)",
    )
    rows = []
    for name, model in comparison.models.items():
        ratio = f"{name}/{first}"
        gain, squares = comparison.elpd_difference.get(ratio), model.least_squares.rmse_um
        factor = "0"
        if name != first:
            factor = f"{comparison.log_bayes_factor[ratio]:+.3f} ± {max(comparison.log_bayes_factor_error[ratio], 1e-3):.1g}"
        rows.append(
            (
                name,
                factor,
                f"{model.posterior_probability:.3g}",
                "0" if name == first else "–" if gain is None else f"{gain.value:+.1f} ± {gain.se:.1f}",
                f"{model.rmse_um:.2f}",
                "–" if np.isnan(squares) else f"{squares:.2f}",
            )
        )
    return Table.of("", heads, rows)


def assumption_table(comparison: Comparison) -> Table:
    """Return ln B under every assumption, and the evidence of the assumption itself against the models' own."""
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
    moves, flag = "moves most when left out (u: of all tests)", "flag"
    ratio = f"ln p({comparison.sensitivity_of}) (nat)"
    first, second = comparison.pair
    rows = []
    for name, test in comparison.tests.items():
        worst = max(test.psis_loo[first], test.psis_loo[second], key=lambda own: own.pareto_k)
        parameter, change = ranked(test.without_it[second].items(), lambda pair: abs(pair[1].shift))[0]
        rows.append(
            (
                name,
                f"{test.force_N:.4g}",
                _p(test.lofo_p_value),
                _p(test.lofo_family_wise_p_value),
                "FLAG" if test.flag else "",
                f"{test.lofo_log_density[second] - test.lofo_log_density[first]:+.2f}",
                f"{worst.pareto_k:.2f}{'' if worst.trustworthy else ' (too large)'}",
                f"{display_name(parameter)} by {change.shift:+.1f} u",
            )
        )
    return Table.of("", ("test", "force (N)", "p", "p, all tests", flag, ratio, "Pareto k", moves), rows, text=(flag, moves))


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
            "unit": comparison.models[model].parameters[parameter].unit,
            "mean": comparison.models[model].parameters[parameter].mean,
            "sd": comparison.models[model].parameters[parameter].sd,
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

_PLACE_HEADS = {
    "force_N": "force (N)",
    "work_ball_deg": "work ball (°)",
    "tool_ball_deg": "tool ball (°)",
    "radius_mm": "radius (mm)",
    "setup": "set-up",
    "centre_x_mm": "centre X (mm)",
    "centre_y_mm": "centre Y (mm)",
    "centre_z_mm": "centre Z (mm)",
}


def tests_table(design: Design) -> Table:
    """Return the different tests and how often to run each."""
    heads = [_PLACE_HEADS.get(name, name) for name in ("force_N", *design.columns)]
    rows = [
        [value if isinstance(value, str) else f"{value:.4g}" for value in row]
        for row in design.table.to_numpy(dtype=object).tolist()
    ]
    return Table.of("", [*heads, "circles"], rows)


def expected_table(design: Design) -> Table:
    """Return the expected standard uncertainty of every parameter beside prior, baseline, others and floor."""
    rows = []
    for name, entry in design.expected.items():
        factor, unit = display_unit(entry.unit)
        sizes = [entry.sd, *(own.expected[name].sd for own in design.compared), entry.floor_sd, entry.prior_sd]
        mark = "" if name in design.parameters else " (nuisance)"
        cells = [round_uncertainty(sd * factor)[0] if np.isfinite(sd) else "–" for sd in sizes]
        rows.append([f"{display_name(name)}{mark}", *cells, unit])
    heads = ["expected u", "recommended", *(own.name for own in design.compared), "no less than", "prior", "unit"]
    return Table.of("", heads, rows, text=("unit",))


def robustness_table(design: Design) -> Table:
    """Return the worst efficiency of every design over the assumptions, and under which."""
    rows = []
    for name, row in design.robustness.iterrows():
        under = row.drop(["tests", "worst"]).astype(float)
        where = ranked(under.index, lambda label, under=under: -under[label])[0]  # type: ignore[misc]
        rows.append([str(name), str(row["tests"]), f"{row['worst']:.2f}", str(where)])
    return Table.of("", ("design", "forces (N)", "worst efficiency", "where"), rows, text=("forces (N)", "where"))


@parts_of.register
def _design(design: Design) -> tuple[Table | str, ...]:
    tables = (tests_table(design), expected_table(design), robustness_table(design))
    return (*(table for table in tables if table.rows), *design_sentences(design))


# ---- tables for commands


def machine_tables(found: DescribedMachine) -> tuple[Table, Table]:
    """Return compliances and geometric errors: name, unit, pattern in every plane, what it is, what it stands for."""
    patterns = ["pattern"] if len(found.planes) == 1 else [f"pattern in {plane}" for plane in found.planes]

    def table(title: str, entries: tuple[Seen, ...], *last: str) -> Table:
        heads = (title, "unit", *patterns, "what it is", *last)
        rows = [
            [
                display_name(entry.name),
                display_unit(entry.unit)[1],
                *(entry.pattern.get(plane, "·") for plane in found.planes),
                entry.meaning,
                *[sum_in_words(entry)] * len(last),
            ]
            for entry in entries
        ]
        return Table.of("", heads, rows, text=heads)

    return table("compliance", found.compliances, "stands for"), table("geometric error", found.geometric_errors)


def _p(value: float) -> str:
    return f"{value:.2f}" if value >= 0.01 else f"{value:.1g}"


def parameter_table(result: Mapping[str, Any]) -> Table:
    """Return posterior mean ± sd, credible interval and prior sd (where priors have means, mean ± sd), in units for reading.

    Parameters
    ----------
    result : mapping
        The JSON of a fit.
    """
    entries = {**result["parameters"], **result["hyper"]}
    key = next(key for key in next(iter(entries.values())) if key.startswith("ci"))
    means = any(entry.get("prior_mean") for entry in entries.values())
    rows = []
    for name, entry in entries.items():
        factor, unit = display_unit(entry["unit"])
        spread, decimals = round_uncertainty(entry["sd"] * factor)
        low, high = (round_like(bound * factor, decimals) for bound in entry[key])
        prior = "flat" if entry["prior_sd"] is None else _three_digits(entry["prior_sd"] * factor)
        if means:
            middle = entry.get("prior_mean")
            both = ("", prior) if middle is None else value_and_uncertainty(middle * factor, entry["prior_sd"] * factor)
            prior = " ± ".join(both).strip()
        shown = display_name(name.removesuffix("_um"))
        rows.append((shown, round_like(entry["mean"] * factor, decimals), spread, f"[{low}, {high}]", prior, unit))
    heads = ("parameter", "mean", "u (1 sd)", f"{key[2:]} % interval", "prior" if means else "prior sd", "unit")
    return Table.of("", heads, rows, text=("unit",))


def nuisance_table(caption: str, entries: Mapping[str, Mapping[str, Any]], heads: Sequence[str]) -> Table:
    """Return mean, standard uncertainty, prior sd and unit of nuisance coefficients; ``heads`` name these five columns."""
    rows = []
    for name, entry in entries.items():
        one, unit = unit_words(name)
        spread, decimals = round_uncertainty(entry["sd"] / one)
        mean, prior = round_like(entry["mean"] / one, decimals), round_uncertainty(entry["prior_sd"] / one)[0]
        rows.append((nuisance_words(name), mean, spread, prior, unit))
    return Table.of(caption, heads, rows, text=("unit",))


def clear_of_zero(entries: Mapping[str, Mapping[str, Any]]) -> dict[str, Mapping[str, Any]]:
    """Return the entries whose mean lies more than 2 sd off zero."""
    return {name: entry for name, entry in entries.items() if abs(entry["mean"]) > 2.0 * entry["sd"]}


def coverage_table(validation: Validation) -> Table:
    """Return the share of truths inside their intervals, with its standard error, and whether the ranks stay inside the band."""
    coverage = validation.coverage()
    claimed = [name for name in coverage.columns if not name.startswith("u")]
    rows = []
    for name in validation.names:
        row = coverage.loc[name]
        shares = [f"{100 * row[p]:.1f} ± {100 * row['u' + p]:.1f} %" for p in claimed]
        shown = "ln likelihood" if name == LOG_LIKELIHOOD else display_name(name)
        rows.append((shown, *shares, "outside the band" if name in validation.outside else "inside"))
    heads = ("quantity", *(f"in {interval} % interval" for interval in claimed), "ranks")
    return Table.of("", heads, rows, text=("ranks",))


def identifiability_table(result: Identifiability) -> Table:
    """Return prior and posterior sd, contraction, information and verdict of every parameter."""
    rows = []
    for name, entry in result.parameters.items():
        factor, unit = display_unit(entry.unit)
        proper = entry.prior_sd < float("inf")
        prior = _three_digits(entry.prior_sd * factor) if proper else "flat"
        gains = (f"{entry.contraction:.4f}", f"{entry.information_gain:.1f}") if proper else ("", "")
        rows.append((display_name(name), prior, round_uncertainty(entry.sd * factor)[0], unit, *gains, verdict_words(entry)))
    heads = ("parameter", "prior sd", "sd", "unit", "contraction", "gain (nat)", "verdict")
    return Table.of("", heads, rows, text=("unit", "verdict"))


def parameters_frame(result: Identifiability) -> pd.DataFrame:
    """Return a row per parameter in units for reading, for CSV."""
    rows = []
    for name, entry in result.parameters.items():
        factor, unit = display_unit(entry.unit)
        rows.append(
            {
                "parameter": display_name(name),
                "prior sd": entry.prior_sd * factor,
                "sd": entry.sd * factor,
                "unit": unit,
                "contraction": entry.contraction,
                "gain (nat)": entry.information_gain,
                "overlap": entry.overlap,
                "verdict": verdict_words(entry),
            }
        )
    return pd.DataFrame(rows)


def _three_digits(value: float) -> str:
    return f"{value:.3g}" if value < 1000.0 else f"{value:.0f}"


def results_table(result: Mapping[str, Any], verdicts: Mapping[str, ParameterIdentifiability]) -> Table:
    """Return value, u, U, interval, unit, stiffness of the direct compliances, and verdict of every parameter."""
    key = next(key for key in next(iter(result["parameters"].values())) if key.startswith("ci"))
    rows = []
    for name, entry in result["parameters"].items():
        own = state(entry["mean"], entry["sd"], tuple(entry[key]), entry["unit"])
        stiff = stiffness(entry["median"], tuple(entry[key])) if is_direct(name) else ""
        cells = (own.value, own.u, own.expanded, own.interval, own.unit, stiff, verdict_words(verdicts[name]))
        rows.append((display_name(name), *cells))
    heads = ("parameter", "value", "u", "U (k = 2)", f"{key[2:]} % interval", "unit", "stiffness (N/µm)", "identified?")
    return Table.of("Compliances, their slopes, geometric errors", heads, rows, text=("unit", "identified?"))


def preview_table(seen: CampaignPreview) -> Table:
    """Return a row per test of a campaign; plane, set-up, radius and centre where tests differ in them."""
    different = [field for field in _PLACES if len({getattr(test, field) for test in seen.tests}) > 1]
    rows = []
    for test in seen.tests:
        sizes = (test.noise_um, test.start_end_um, test.peak_to_peak_um)
        rows.append(
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
                *("–" if value is None else f"{value:.3g}" for value in sizes),
            )
        )
    first = ("test", "force (N)", "pressure (bar)", "readings", "arc (°)", "gap (°)", "direction")
    heads = (*first, *(_PLACES[field][0] for field in different), "balls (°)", "step (µm)", "spikes", "noise (µm)")
    return Table.of("", (*heads, "end − start (µm)", "peak to peak (µm)"), rows, text=("direction", "plane", "centre (mm)"))


_PLACES = {
    "plane": ("plane", "{}"),
    "setup": ("set-up", "{}"),
    "radius_mm": ("R (mm)", "{:g}"),
    "centre_mm": ("centre (mm)", "({0[0]:g}, {0[1]:g}, {0[2]:g})"),
}
