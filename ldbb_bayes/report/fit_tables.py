"""Results of a fit as tables and sentences, with remarks on the readings.

Nuisance coefficients are effects that are modelled but not of interest.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ldbb_bayes import units
from ldbb_bayes.analysis.conformity import assess_conformity
from ldbb_bayes.analysis.verdicts import ParameterIdentifiability, judge_posterior, not_modelled
from ldbb_bayes.campaign.preview import CampaignPreview, RemarkKind, check_campaign
from ldbb_bayes.inference.posterior import bound_of, campaign_of, fit_of, record_of
from ldbb_bayes.inference.summary import result_json, summarize_nuisances
from ldbb_bayes.model.terms import Term
from ldbb_bayes.report import wording
from ldbb_bayes.results import Passage, Shown, Table
from ldbb_bayes.units import (
    display_name,
    display_unit,
    round_like,
    round_uncertainty,
    three_digits,
    value_and_uncertainty,
)

if TYPE_CHECKING:
    import xarray as xr

__all__ = [
    "FitWords",
    "conformity_table",
    "describe_fit",
    "full_result",
    "further_remarks",
    "nuisance_table",
    "parameter_table",
    "parts_of_fit",
    "results_table",
]

# λ of a circle is the factor by which its random shift and its unexplained deviations are larger
# than those of the other circles. The table of a fit's parameters shows λ of a circle only if its
# posterior median is at least this.
_ODD_CIRCLE = 2.5
# Kinds of remarks on a campaign that are left out after a fit, because the sentences on the fit say
# the same.
_REMARKS_OF_FITS = (RemarkKind.ONE_LEVEL, RemarkKind.TWO_LEVELS, RemarkKind.ONE_WAY)


# ---- JSON record of a fit


def full_result(posterior: xr.DataTree, prob: float) -> dict[str, Any]:
    """Return all results of a fit, with nuisance coefficients, warnings and conformity decisions.

    Parameters
    ----------
    posterior
        Posterior of the fit.
    prob
        Probability of the credible intervals.

    Returns
    -------
    dict
        The record that ``fit --json`` prints.
    """
    result = result_json(posterior, prob=prob)
    result["nuisances"] = summarize_nuisances(posterior).to_dict(orient="index")
    result["fit"] |= describe_fit(posterior)
    if campaign_of(posterior).tolerances:
        decisions = assess_conformity(posterior)
        result["conformity"] = {name: decision.as_dict() for name, decision in decisions.items()}
    return result


class FitWords(Shown, dict[str, Any]):
    """State, verdict, misfits and warnings of a fit in words; printed as sentences."""

    def __repr__(self) -> str:
        return f"<fit in words: {self['state']}, {len(self['warnings'])} warnings>"


def describe_fit(posterior: xr.DataTree) -> FitWords:
    """Return the state of a fit, its verdict, misfits and warnings in words.

    Parameters
    ----------
    posterior : DataTree
        Posterior from `sample`, `load` or `average`.

    Returns
    -------
    FitWords
        A dictionary with ``state``, ``kinds``, ``verdict``, ``misfits`` and ``warnings``; it prints
        as sentences.

    Examples
    --------
    >>> words = lb.report.describe_fit(posterior)
    >>> words["state"]
    'usable'
    >>> [warning for warning in words["warnings"] if warning.startswith("Confounded")]
    []
    """
    fit = fit_of(posterior)
    bound = bound_of(posterior)
    campaign_preview = check_campaign(bound.campaign)
    warnings = [
        *wording.concern_sentences(fit.concerns, record_of(posterior)["sampler"]),
        *wording.check_notes(fit),
        *wording.confounded_sentences(judge_posterior(posterior)),
        *wording.not_modelled_sentences(not_modelled(bound)),
    ]
    warnings += wording.look_sentences(campaign_preview)
    warnings += further_remarks(campaign_preview)
    return FitWords(
        state=str(fit.state),
        kinds=list(fit.kinds),
        verdict=wording.fit_verdict(fit),
        misfits=[wording.check_words(check) for check in fit.misfits],
        warnings=warnings,
    )


def further_remarks(campaign_preview: CampaignPreview) -> list[str]:
    """Return the remarks on a campaign that the sentences on its fit do not already contain.

    The remarks come from ``campaign_preview``, which states what the readings show without a fit.
    """
    return [
        wording.remark_words(remark)
        for remark in campaign_preview.remarks
        if remark.kind not in _REMARKS_OF_FITS
    ]


# ---- tables of a fit


def parts_of_fit(result: Mapping[str, Any]) -> tuple[Passage, ...]:
    """Return the results of a fit as tables and sentences.

    Nuisance effects of the instrument (bar, balls, mount, force device) are left out.

    Parameters
    ----------
    result
        Results of the fit, see `full_result`.

    Returns
    -------
    tuple
        Tables and sentences, in their order.
    """
    campaign = result["campaign"]
    quality = result["fit"]
    passages: list[Passage] = [
        f"Verdict: {quality['verdict']}",
        f"{campaign['name']}: {campaign['tests']} tests, {campaign['readings']} readings.",
        parameter_table(result),
    ]
    effects = {}
    for name, entry in result["nuisances"].items():
        if not Term.kinds.get(entry["term"], Term).instrument:
            effects[name] = entry
    if effects:
        passages.append(nuisance_table(effects))
    if result.get("conformity"):
        passages.append(conformity_table(result["conformity"]))
    passages.append(wording.quality_words(quality))
    passages.append(wording.sampler_words(result["sampler"]))
    passages += [f"Note: {warning}" for warning in quality["warnings"]]
    passages.append(wording.model_words(result["model"]))
    if result.get("prior_from"):
        passages.append(wording.PAGE["prior_from"].format(**result["prior_from"]))
    return tuple(passages)


def conformity_table(decisions: Mapping[str, Mapping[str, Any]]) -> Table:
    """Return a table of decisions on conformity, one row for each quantity with a tolerance.

    Its columns include the tolerance, the probability of conformance and the guard band.

    Parameters
    ----------
    decisions
        Decisions by quantity, each as a dictionary; see `assess_conformity`.

    Returns
    -------
    Table
    """
    rows = []
    for name, decision in decisions.items():
        factor, label = display_unit(decision["unit"])
        rows.append(
            (
                display_name(name),
                wording.limit_words(decision["lower"], decision["upper"], factor),
                wording.probability_words(decision["probability"]),
                round_uncertainty(decision["guard_band"] * factor)[0],
                label,
                decision["decision"],
            )
        )
    heads = ("quantity", "tolerance", "P(conforms)", "guard band", "unit", "decision")
    caption = "Conformity (ISO 14253-1, JCGM 106)"
    forces_N = {decision["force_N"] for decision in decisions.values()} - {None}
    for force in sorted(forces_N):
        caption += f", at {force:g} N"
    return Table.of(caption, heads, rows, text=("unit", "decision"))


def parameter_table(result: Mapping[str, Any]) -> Table:
    """Return a table of each parameter's posterior (mean, sd, interval) and prior (mean, sd).

    The prior means are left out if all are zero. λ of a circle is the factor by which its random
    shift and its unexplained deviations are larger than those of the other circles. It is shown
    only if its posterior median is at least 2.5.

    Parameters
    ----------
    result
        Results of a fit, see `full_result`.

    Returns
    -------
    Table
    """
    entries = {**result["parameters"], **result["hyper"]}
    has_prior_means = any(entry.get("prior_mean") for entry in entries.values())
    rows = []
    for name, entry in entries.items():
        if name.startswith("lambda_") and entry["median"] < _ODD_CIRCLE:
            continue
        factor, unit = display_unit(entry["unit"])
        spread, decimals = round_uncertainty(entry["sd"] * factor)
        low, high = wording.interval_of(entry)
        cells = [
            display_name(name.removesuffix("_um")),
            round_like(entry["mean"] * factor, decimals),
            spread,
            f"[{round_like(low * factor, decimals)}, {round_like(high * factor, decimals)}]",
        ]
        if has_prior_means:
            cells.append(_prior_mean_cell(entry, factor))
        if entry["prior_sd"] is None:
            cells.append("flat")
        else:
            cells.append(three_digits(entry["prior_sd"] * factor))
        rows.append((*cells, unit))
    heads = ["parameter", "mean", "u (1 sd)", f"{wording.percent_of(result)} interval"]
    if has_prior_means:
        heads.append("prior mean")
    heads += ["prior sd", "unit"]
    return Table.of("", tuple(heads), rows, text=("unit",))


def _prior_mean_cell(entry: Mapping[str, Any], factor: float) -> str:
    prior_mean = entry.get("prior_mean")
    if prior_mean is None:
        return "–"
    return value_and_uncertainty(prior_mean * factor, entry["prior_sd"] * factor)[0]


def results_table(
    result: Mapping[str, Any],
    verdicts: Mapping[str, ParameterIdentifiability],
    *,
    shares: bool = True,
) -> Table:
    """Return a table of the results: value, u, U, interval, stiffness and verdict by parameter.

    Parameters
    ----------
    result
        Results of a fit, see `full_result`.
    verdicts
        Verdicts on the parameters of the fit: how far the readings determine each of them.
    shares
        Whether the verdict on a confounded parameter states the share of the variance due to each
        effect that it is confounded with. False is useful if an uncertainty budget is shown, too.

    Returns
    -------
    Table
    """
    rows = []
    for name, entry in result["parameters"].items():
        interval = wording.interval_of(entry)
        statement = units.state(entry["mean"], entry["sd"], interval, entry["unit"])
        stiffness = ""
        if units.is_direct(name):
            stiffness = units.stiffness(entry["median"], interval)
        rows.append(
            (
                display_name(name),
                statement.value,
                statement.u,
                statement.expanded,
                statement.interval,
                statement.unit,
                stiffness,
                wording.verdict_words(verdicts[name], shares=shares),
            )
        )
    heads = (
        "parameter",
        "value",
        "u",
        "U (k = 2)",
        f"{wording.percent_of(result)} interval",
        "unit",
        "stiffness (N/µm)",
        "verdict",
    )
    caption = "Compliances, their slopes, geometric errors"
    return Table.of(caption, heads, rows, text=("unit", "verdict"))


def nuisance_table(entries: Mapping[str, Mapping[str, Any]]) -> Table | str:
    """Return a table of the nuisance coefficients that differ from zero by more than 2 u.

    Nuisance coefficients are effects that are modelled but not of interest; u is the standard
    uncertainty.

    Parameters
    ----------
    entries
        Mean, sd and prior sd by coefficient, from the results of a fit.

    Returns
    -------
    Table or str
        Table of mean, u, prior sd and unit. If no coefficient differs from zero by more than 2 u, a
        sentence that states this.
    """
    rows = []
    for name, entry in entries.items():
        if abs(entry["mean"]) <= 2.0 * entry["sd"]:
            continue
        one, unit = wording.unit_words(name)
        mean, spread = value_and_uncertainty(entry["mean"] / one, entry["sd"] / one)
        prior_sd, _ = round_uncertainty(entry["prior_sd"] / one)
        rows.append((wording.nuisance_words(name), mean, spread, prior_sd, unit))
    if not rows:
        return f"None of the {len(entries)} other effects differs from zero by more than 2 u."
    caption = (
        f"Other effects that differ from zero by more than 2 u; {len(entries) - len(rows)} of"
        f" {len(entries)} do not"
    )
    heads = ("effect", "mean", "u (1 sd)", "prior sd", "unit")
    return Table.of(caption, heads, rows, text=("unit",))
