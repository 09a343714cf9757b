"""Results and campaigns as tables and sentences for a terminal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich.table import Table

from ldbb_bayes.analysis.identified import Identifiability, ParameterIdentifiability
from ldbb_bayes.analysis.preview import CampaignPreview
from ldbb_bayes.analysis.validation import LOG_LIKELIHOOD, Validation
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.wording import nuisance_words, unit_words
from ldbb_bayes.report.rounding import is_lopsided, round_like, round_uncertainty, stiffness, value_and_uncertainty
from ldbb_bayes.units import display_name, display_unit, is_direct

__all__ = [
    "coverage_table",
    "engineer_table",
    "identifiability_lines",
    "identifiability_table",
    "meaning",
    "parameter_table",
    "preview_lines",
    "preview_table",
    "verdict_lines",
]


TOLD = ("Hysteresis", "Drift")
DEFAULT_TERMS = HybridModel.default().terms


def parameter_table(result: Mapping[str, Any]) -> Table:
    """Posterior mean ± sd, credible interval and prior sd of every parameter, in display units; where a prior has a mean, prior
    mean ± sd.

    Parameters
    ----------
    result : mapping
        The JSON of a fit.
    """
    entries = {**result["parameters"], **result["hyper"]}
    key = next(key for key in next(iter(entries.values())) if key.startswith("ci"))
    table = Table(box=None, pad_edge=False)
    for name, justify in (("parameter", "left"), ("mean", "right"), ("u (1 sd)", "right"), (f"{key[2:]} % interval", "right")):
        table.add_column(name, justify=justify, no_wrap=True)  # type: ignore[arg-type]
    means = any(entry.get("prior_mean") for entry in entries.values())
    table.add_column("prior" if means else "prior sd", justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    for name, entry in entries.items():
        factor, unit = display_unit(entry["unit"])
        spread, decimals = round_uncertainty(entry["sd"] * factor)
        low, high = (round_like(bound * factor, decimals) for bound in entry[key])
        prior = "flat" if entry["prior_sd"] is None else _three_digits(entry["prior_sd"] * factor)
        if means:
            known = entry.get("prior_mean")
            both = value_and_uncertainty(known * factor, entry["prior_sd"] * factor) if known is not None else ("", prior)
            prior = " ± ".join(both).strip()
        shown = display_name(name.removesuffix("_um"))
        table.add_row(
            shown, round_like(entry["mean"] * factor, decimals), spread, f"[{low}, {high}]".replace("[", r"\["), prior, unit
        )
    return table


def nuisance_table(result: Mapping[str, Any]) -> Table:
    """Hysteresis and drift: mean, standard uncertainty and prior sd of every coefficient that is told from zero (k = 2)."""
    table = Table(box=None, pad_edge=False)
    for name, justify in (
        ("hysteresis and drift, beyond 2 u", "left"),
        ("mean", "right"),
        ("u (1 sd)", "right"),
        ("prior sd", "right"),
    ):
        table.add_column(name, justify=justify, no_wrap=True)  # type: ignore[arg-type]
    table.add_column("unit", no_wrap=True)
    told = {name: entry for name, entry in result["nuisances"].items() if entry["term"] in TOLD}
    clear = {name: entry for name, entry in told.items() if abs(entry["mean"]) > 2.0 * entry["sd"]}
    for name, entry in clear.items():
        one, unit = unit_words(name)
        spread, decimals = round_uncertainty(entry["sd"] / one)
        mean = round_like(entry["mean"] / one, decimals)
        table.add_row(nuisance_words(name), mean, spread, _three_digits(entry["prior_sd"] / one), unit)
    table.add_row(f"{len(told) - len(clear)} of {len(told)} not told from zero")
    return table


def verdict_lines(result: Mapping[str, Any]) -> list[str]:
    """What was fitted, how well it went, and every warning."""
    campaign, model, sampler, fit = result["campaign"], result["model"], result["sampler"], result["fit"]
    degree = ("constant", "linear in force", "quadratic in force")[model["degree"]]
    lines = [
        f"Verdict: {fit['verdict']}",
        f"{campaign['name']}: {campaign['tests']} tests, {campaign['readings']} readings.",
        f"Compliance {degree}, preset {model['preset']}{_changes(model)}, reference force {model['reference_force_N']:g} N.",
        f"RMSE {fit['rmse_um']:.2f} µm (machine and shared nuisances); linear for exact geometry costs at most "
        f"{fit['linearisation_error_um']:.4f} µm. ln P(T | y) = {fit['log_prob_truncation']:.2f}.",
        f"Sampler {sampler['kind']}: {'' if sampler['converged'] else 'NOT CONVERGED, '}ESS bulk {sampler['ess_bulk_min']:.0f}, "
        f"tail {sampler['ess_tail_min']:.0f}, R-hat {sampler['rhat_max']:.4f}, {sampler['seconds']:.1f} s.",
    ]
    return lines + [f"Note: {warning}" for warning in fit["warnings"]]


def coverage_table(validation: Validation) -> Table:
    """Share of truths inside their intervals, with its standard error, and whether the ranks stay inside the band."""
    table = Table(box=None, pad_edge=False)
    table.add_column("quantity", no_wrap=True)
    coverage = validation.coverage()
    claimed = [name for name in coverage.columns if not name.startswith("u")]
    for interval in claimed:
        table.add_column(f"in {interval} % interval", justify="right", no_wrap=True)
    table.add_column("ranks", no_wrap=True)
    for name in validation.names:
        row = coverage.loc[name]
        shown = "ln likelihood" if name == LOG_LIKELIHOOD else display_name(name)
        shares = [f"{100 * row[p]:.1f} ± {100 * row['u' + p]:.1f} %" for p in claimed]
        table.add_row(shown, *shares, "outside the band" if name in validation.outside else "inside")
    return table


def identifiability_table(result: Identifiability) -> Table:
    """Prior and posterior sd, contraction, information and verdict of every parameter."""
    table = Table(box=None, pad_edge=False)
    for name in ("parameter", "prior sd", "sd", "unit", "contraction", "gain (nat)"):
        right = name in ("prior sd", "sd", "contraction", "gain (nat)")
        table.add_column(name, justify="right" if right else "left", no_wrap=True)
    table.add_column("verdict")
    for name, entry in result.parameters.items():
        factor, unit = display_unit(entry.unit)
        spread, _ = round_uncertainty(entry.sd * factor)
        proper = entry.prior_sd < float("inf")
        table.add_row(
            display_name(name),
            _three_digits(entry.prior_sd * factor) if proper else "flat",
            spread,
            unit,
            f"{entry.contraction:.4f}" if proper else "",
            f"{entry.information_gain:.1f}" if proper else "",
            entry.text,
        )
    return table


def identifiability_lines(result: Identifiability) -> list[str]:
    """What the table rests on, the degeneracies with their cures, and the standing ones."""
    lines = [
        result.basis,
        f"Effective number of parameters {result.effective_parameters:.1f} of {len(result.parameters)} (what the readings narrow "
        "against the priors; an aliased parameter may be narrowed and still not known); condition number of their design "
        f"{result.condition_number:.2g} as it stands, {result.scaled_condition_number:.2g} in units of the prior sd.",
        "Contraction 1 − (sd / prior sd)²; a term's share is what knowing it would take from the variance.",
    ]
    if result.degeneracies:
        lines += ["", "No reading of this campaign can tell apart:"]
        for degeneracy, cure in zip(result.degeneracies, result.cures, strict=True):
            lines += [f"- {degeneracy.statement}", f"  What would: {cure}"]
    return [*lines, *(f"- {note}" for note in result.notes)]


def _three_digits(value: float) -> str:
    return f"{value:.3g}" if value < 1000.0 else f"{value:.0f}"


def _changes(model: Mapping[str, Any]) -> str:
    """How the model differs from its preset."""
    if model["preset"] == "paper":
        return " (least squares: the intervals cover white noise alone)"
    there = (*model["terms"], *model.get("idle_terms", ("Hysteresis",)))
    missing = [name for name in DEFAULT_TERMS if name not in there] + ([] if model["truncated"] else ["truncation"])
    said = [f"without {', '.join(missing)}"] if missing else []
    said += [f"with {', '.join(more)}"] if (more := [name for name in model["terms"] if name not in DEFAULT_TERMS]) else []
    said += ["with edited priors"] if model["priors"] == "edited" else []
    return f" {' and '.join(said)}" if said else ""


def engineer_table(result: Mapping[str, Any], verdicts: Mapping[str, ParameterIdentifiability]) -> Table:
    """Value ± expanded uncertainty U (k = 2), unit, stiffness for the direct compliances, and the verdict in words."""
    table = Table(box=None, pad_edge=False)
    for name, right in (
        ("parameter", False),
        ("value", True),
        ("± U (k = 2), or 95 %", True),
        ("unit", False),
        ("stiffness", False),
    ):
        table.add_column(name, justify="right" if right else "left", no_wrap=True)
    table.add_column("verdict")
    for name, entry in result["parameters"].items():
        factor, unit = display_unit(entry["unit"])
        value, expanded = value_and_uncertainty(entry["mean"] * factor, 2.0 * entry["sd"] * factor)
        if is_lopsided(entry["mean"], entry["ci95"]):
            _, decimals = round_uncertainty(2.0 * entry["sd"] * factor)
            low, high = (round_like(bound * factor, decimals) for bound in entry["ci95"])
            expanded = f"\\[{low}, {high}]"
        stiff = stiffness(entry["median"], entry["ci95"]) if is_direct(name) else ""
        stiff = f"{stiff} N/µm".replace("[", r"\[") if stiff else ""
        table.add_row(display_name(name), value, expanded, unit, stiff, verdicts[name].text)
    return table


def meaning(constant: Mapping[str, Any], linear: Mapping[str, Any]) -> list[str]:
    """What the two fits say, in three sentences."""
    direct = [name for name in constant["parameters"] if is_direct(name)]
    known = []
    for name in direct:
        entry = constant["parameters"][name]
        value, expanded = value_and_uncertainty(entry["mean"] * 1e3, 2e3 * entry["sd"])
        known.append(f"{name} = {value} ± {expanded} µm/N")
    slopes = [name for name in linear["parameters"] if name.endswith("_1")]
    away = [name for name in slopes if linear["parameters"][name]["ci95"][0] > 0 or linear["parameters"][name]["ci95"][1] < 0]
    says = (
        f"the 95 % interval of {', '.join(away)} excludes zero"
        if away
        else "the 95 % interval of every force slope contains zero"
    )
    gain = 100.0 * (1.0 - linear["fit"]["rmse_um"] / constant["fit"]["rmse_um"])
    rough = [
        display_name(name)
        for name, entry in constant["parameters"].items()
        if name.startswith("E_") and abs(entry["mean"]) < 2.0 * entry["sd"]
    ]
    return [
        f"With constant compliance {', '.join(known)}: these intervals include what the mount, the force and the balls may hide.",
        f"Linear compliance lowers the RMSE by {gain:.0f} %, but {says}: a lower RMSE alone does not show a slope.",
        f"Geometric errors not told from zero (k = 2): {', '.join(rough) or 'none'}; most of their uncertainty is "
        "the form of the balls and the length of the bar, which more readings do not reduce.",
    ]


def preview_table(seen: CampaignPreview) -> Table:
    """One line per test of a campaign; plane, set-up, radius and centre where tests differ in them."""
    table = Table(box=None, pad_edge=False)
    different = [field for field in _PLACES if len({getattr(test, field) for test in seen.tests}) > 1]
    for name in (
        "test",
        "force N",
        "bar",
        "readings",
        "arc °",
        "gap °",
        "direction",
        *(["circle"] if different else []),
        "balls °",
        "step µm",
        "spikes",
        "noise µm",
        "end − start µm",
        "p-p µm",
    ):
        table.add_column(name, justify="left" if name in ("test", "direction", "circle") else "right", no_wrap=True)
    for test in seen.tests:
        travel = test.direction or (f"({test.travel})" if test.travel else "–")
        table.add_row(
            test.name,
            f"{test.force_N:.4g}",
            f"{test.pressure_bar:.3g}",
            str(test.readings),
            f"{test.arc_deg:.0f}",
            f"{test.largest_gap_deg:.2g}",
            travel,
            *([" ".join(_PLACES[field].format(getattr(test, field)) for field in different)] if different else []),
            f"{test.work_ball_deg:g}/{test.tool_ball_deg:g}",
            "–" if test.resolution_um is None else f"{test.resolution_um:.2g}",
            str(test.spikes),
            *("–" if value is None else f"{value:.3g}" for value in (test.noise_um, test.start_end_um, test.peak_to_peak_um)),
        )
    return table


_PLACES = {"plane": "{}", "setup": "set-up {}", "radius_mm": "R {:g}", "centre_mm": "({0[0]:g}, {0[1]:g}, {0[2]:g})"}


def preview_lines(seen: CampaignPreview) -> list[str]:
    """Remarks on the tests, and what a fit will assume."""
    unstated = ["Directions in brackets are not stated: the angles run so."] * any(
        test.direction is None and test.travel is not None for test in seen.tests
    )
    lines = [f"Look at {test.name}: {remark}." for test in seen.tests for remark in test.remarks]
    lines += [f"Note: {remark}" for remark in seen.remarks]
    kind = "Plan" if seen.is_plan else "Campaign"
    return [
        "",
        f"{kind} {seen.name}, SHA-256 {seen.sha256[:16]}…",
        *unstated,
        *lines,
        "",
        "A fit will assume:",
        *(f"- {a}" for a in seen.assumptions),
    ]
