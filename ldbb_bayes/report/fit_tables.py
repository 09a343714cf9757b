"""Tables of the results of a fit: parameters with their verdicts, slopes, and nuisances.

Nuisance coefficients describe effects that are modelled but not of interest. Slopes are
coefficients of the change of compliances with force.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ldbb_bayes.analysis.verdicts import ParameterIdentifiability
from ldbb_bayes.inference.odd_circles import LARGE_NOISE_FACTOR
from ldbb_bayes.model.terms import Term
from ldbb_bayes.report import wording
from ldbb_bayes.report.change_tables import change_cells, statement_cells
from ldbb_bayes.report.conformity_tables import conformity_table
from ldbb_bayes.results import Passage, Table
from ldbb_bayes.units import (
    counted,
    display_name,
    display_unit,
    is_compliance_or_slope,
    is_direct,
    is_slope,
    round_like,
    round_uncertainty,
    state,
    stiffness,
    three_digits,
    value_and_uncertainty,
)

__all__ = [
    "coefficient_table",
    "explanation_of_U",
    "nuisance_table",
    "parameter_table",
    "parts_of_fit",
    "results_table",
]

# Heading of the column with the expanded uncertainty in a table of results.
_HEAD_OF_U = "U (k = 2)"
# Largest number of nuisance coefficients that a fit lists on the screen without --details.
_MOST_NUISANCES_ON_SCREEN = 12


def parts_of_fit(result: Mapping[str, Any], *, details: bool = False) -> tuple[Passage, ...]:
    """Return the results of a fit as tables and sentences.

    Nuisance coefficients of the instrument (bar, balls, mount, force device) are counted, but not
    listed. Others are listed if they are few: hysteresis alone has up to 50 in each plane.

    Parameters
    ----------
    result
        Results of the fit, see `full_result`.
    details
        Whether nuisance coefficients are listed however many they are.

    Returns
    -------
    tuple
        Tables and sentences, in the order in which they are shown.
    """
    campaign = result["campaign"]
    quality = result["fit"]
    passages: list[Passage] = [
        f"Verdict: {quality['verdict']}",
        f"{campaign['name']}: {counted(campaign['tests'], 'test')},"
        f" {campaign['readings']} readings.",
        parameter_table(result),
    ]
    if result["nuisances"]:
        most_rows = None if details else _MOST_NUISANCES_ON_SCREEN
        passages.append(
            nuisance_table(result["nuisances"], instrument_listed=False, most_rows=most_rows)
        )
    if result.get("conformity"):
        passages.append(conformity_table(result["conformity"]))
    passages.append(wording.quality_words(quality))
    passages.append(wording.sampler_words(result["sampler"]))
    passages += [f"Note: {warning}" for warning in quality["warnings"]]
    passages.append(wording.model_words(result["model"]))
    if result.get("prior_from"):
        passages.append(wording.PAGE["prior_from"].format(**result["prior_from"]))
    return tuple(passages)


def _parameters_by_kind(result: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return two dictionaries from a fit's results: the compliances, and the other parameters.

    The keys are names of parameters, and the values are the entries of the parameters in the
    results. Slopes, the coefficients of the change of a compliance with force, are counted among
    the other parameters. Slopes are left out if the results also contain the changes of compliances
    over the tested forces.
    """
    compliances = {}
    others = {}
    for name, entry in result["parameters"].items():
        if is_slope(name):
            if not result.get("change_with_force"):
                others[name] = entry
        elif is_compliance_or_slope(name):
            compliances[name] = entry
        else:
            others[name] = entry
    return compliances, others


def parameter_table(result: Mapping[str, Any], *, coefficients: bool = False) -> Table:
    """Return a table of the posterior and the prior of each parameter.

    The columns are the posterior mean, sd and credible interval, and the prior mean and sd. The
    column of prior means is left out if all prior means are zero. Instead of the slopes, which are
    the coefficients of compliances as functions of force, the table shows the change of each
    compliance over the tested forces. The factor λ of a circle multiplies the random shifts of the
    circle's zero and centre, and the deviations that the model does not explain. It is large for a
    circle that does not agree with the others. λ is shown only if its posterior median is at least
    2.5.

    Parameters
    ----------
    result
        Results of a fit, see `full_result`.
    coefficients
        Whether the table has rows for slopes instead of changes of compliances.

    Returns
    -------
    Table
    """
    has_prior_means = any(entry.get("prior_mean") for entry in result["parameters"].values())
    compliances, others = _parameters_by_kind(result)
    changes = result.get("change_with_force", {})
    if coefficients:
        compliances = result["parameters"]
        changes = {}
        others = {}
    rows = []
    for name, entry in compliances.items():
        rows.append(_parameter_row(name, entry, has_prior_means))
    for name, change in changes.items():
        rows.append(_change_row(name, change, has_prior_means))
    for name, entry in {**others, **result["hyper"]}.items():
        if not name.startswith("lambda_") or entry["median"] >= LARGE_NOISE_FACTOR:
            rows.append(_parameter_row(name, entry, has_prior_means))
    heads = ["parameter", "mean", "u (1 sd)", f"{wording.percent_of(result)} interval"]
    if has_prior_means:
        heads.append("prior mean")
    heads += ["prior sd", "unit"]
    return Table.of("", tuple(heads), rows, text=("unit",))


def _parameter_row(name: str, entry: Mapping[str, Any], has_prior_means: bool) -> tuple[str, ...]:
    """Return the row of a parameter or hyper-parameter in the table of posteriors and priors.

    ``entry`` is what the JSON record of the fit states about the parameter ``name``. The row has a
    cell for the prior mean only if ``has_prior_means`` is true.
    """
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
    return (*cells, unit)


def _change_row(name: str, change: Mapping[str, Any], has_prior_means: bool) -> tuple[str, ...]:
    """Return the row for the change of a compliance over the tested forces.

    ``change`` is what the JSON record of the fit states about the change of the compliance
    ``name``. The cells for the prior contain a dash. The row has a cell for the prior mean only if
    ``has_prior_means`` is true.
    """
    result_cells = change_cells(change)
    cells = [
        wording.changes_by_words(name, change),
        result_cells.value,
        result_cells.u,
        result_cells.interval,
    ]
    if has_prior_means:
        cells.append("–")
    return (*cells, "–", result_cells.unit)


def _prior_mean_cell(entry: Mapping[str, Any], factor: float) -> str:
    """Return the prior mean of a parameter as a string, or a dash if no prior mean is stated.

    ``entry`` is what the JSON record of the fit states about the parameter. ``factor`` converts the
    internal unit of the parameter (mm, N, rad) to the unit shown.
    """
    prior_mean = entry.get("prior_mean")
    if prior_mean is None:
        return "–"
    return value_and_uncertainty(prior_mean * factor, entry["prior_sd"] * factor)[0]


def results_table(
    result: Mapping[str, Any],
    verdicts: Mapping[str, ParameterIdentifiability],
    *,
    shares: bool = True,
    force_N: float | None = None,
    result_of_U: Mapping[str, Any] | None = None,
) -> Table:
    """Return a table of the results of a fit, one row for each parameter.

    The columns are the value, u, U (k = 2), the credible interval, the stiffness and the verdict.
    Instead of the slopes, which are the coefficients of compliances as functions of force, the
    table shows the change of each compliance over the tested forces. The caption then states the
    force of the compliances.

    Parameters
    ----------
    result
        Results of a fit, see `full_result`.
    verdicts
        Verdicts on how well the readings determine each parameter of the fit. The keys are names of
        parameters.
    shares
        Whether a verdict states a percentage for each effect that it names: the share of the
        parameter's variance that is due to the effect. False is useful if an uncertainty budget is
        shown, too.
    force_N
        Force of the compliances in ``result`` [N]. Default: the model's reference force.
    result_of_U
        The same results with intervals of 95 %, from which U is stated. Default: ``result``, whose
        intervals are then of 95 %.

    Returns
    -------
    Table
    """
    result_of_U = result if result_of_U is None else result_of_U
    compliances, others = _parameters_by_kind(result)
    changes = result.get("change_with_force", {})
    rows = []
    for name, entry in compliances.items():
        verdict = wording.verdict_words(verdicts[name], shares=shares)
        rows.append(_result_row(name, entry, verdict, result_of_U["parameters"][name]))
    for name, change in changes.items():
        label = wording.changes_by_words(name, change)
        cells = change_cells(result_of_U["change_with_force"][name])
        cells = cells._replace(interval=change_cells(change).interval)
        rows.append((label, *cells, "", wording.direction_words(change)))
    for name, entry in others.items():
        verdict = wording.verdict_words(verdicts[name], shares=shares)
        rows.append(_result_row(name, entry, verdict, result_of_U["parameters"][name]))
    caption = wording.PAGE["parameters"]
    if changes:
        if force_N is None:
            force_N = result["model"]["reference_force_N"]
        caption = wording.PAGE["parameters_and_changes"].format(force=force_N)
    return _results_table(caption, rows, result)


def coefficient_table(
    result: Mapping[str, Any],
    verdicts: Mapping[str, ParameterIdentifiability],
    *,
    result_of_U: Mapping[str, Any] | None = None,
) -> Table:
    """Return a table of the slopes: coefficients of the change of compliances with force.

    A slope does not describe the whole change of a compliance with force: the model term
    `JointLoad` describes a further part of this change. The table has no rows if compliance is
    constant.

    Parameters
    ----------
    result
        Results of a fit, see `full_result`.
    verdicts
        Verdicts on how well the readings determine each parameter of the fit. The keys are names of
        parameters.
    result_of_U
        The same results with intervals of 95 %, from which U is stated. Default: ``result``, whose
        intervals are then of 95 %.

    Returns
    -------
    Table
    """
    result_of_U = result if result_of_U is None else result_of_U
    rows = []
    for name, entry in result["parameters"].items():
        if is_slope(name):
            verdict = wording.verdict_words(verdicts[name], shares=False)
            rows.append(_result_row(name, entry, verdict, result_of_U["parameters"][name]))
    return _results_table(wording.PAGE["coefficients"], rows, result)


def _result_row(
    name: str, entry: Mapping[str, Any], verdict: str, entry_of_U: Mapping[str, Any]
) -> tuple[str, ...]:
    """Return the row of a parameter in a table of results, as texts.

    ``entry`` is what the JSON record of the fit states about the parameter ``name``. ``verdict`` is
    the text of the last cell. Only the row of a direct compliance states a stiffness. U is that of
    ``entry_of_U``, the same record with an interval of 95 %.
    """
    interval = wording.interval_of(entry)
    statement = state(entry["mean"], entry["sd"], interval, entry["unit"])
    interval_of_U = wording.interval_of(entry_of_U)
    statement_of_U = state(entry["mean"], entry["sd"], interval_of_U, entry["unit"])
    stiffness_text = ""
    if is_direct(name):
        stiffness_text = stiffness(entry["median"], interval)
    cells = statement_cells(statement)._replace(expanded=statement_of_U.expanded)
    return (display_name(name), *cells, stiffness_text, verdict)


def _results_table(caption: str, rows: list[tuple[str, ...]], result: Mapping[str, Any]) -> Table:
    """Return a table of the results of a fit, with a heading for each of its eight columns.

    ``rows`` holds the texts of the cells. ``result`` is the JSON record of the fit, which states
    the probability of the credible intervals.
    """
    heads = (
        "parameter",
        "value",
        "u",
        _HEAD_OF_U,
        f"{wording.percent_of(result)} interval",
        "unit",
        "stiffness (N/µm)",
        "verdict",
    )
    return Table.of(caption, heads, rows, text=("unit", "verdict"))


def explanation_of_U(table: Table) -> tuple[str, ...]:
    """Return a sentence on uncertainties of the form +a / −b, if a table of results has any.

    Parameters
    ----------
    table
        Table of results, see `results_table`.

    Returns
    -------
    tuple
        The sentence, or nothing.
    """
    column = table.heads.index(_HEAD_OF_U)
    if any("/" in row[column] for row in table.rows):
        return (wording.PAGE["unequal_U"],)
    return ()


def nuisance_table(
    entries: Mapping[str, Mapping[str, Any]],
    *,
    instrument_listed: bool = True,
    most_rows: int | None = None,
) -> Table | str:
    """Return a table of the nuisance coefficients that differ from zero by more than 2 u.

    Nuisance coefficients describe effects that are modelled but not of interest; u is the standard
    uncertainty.

    Parameters
    ----------
    entries
        Mapping from the names of the coefficients to dictionaries with results of a fit: the mean,
        the sd and the prior sd of the coefficient.
    instrument_listed
        Whether the table lists coefficients of the instrument (bar, balls, mount, force device),
        too. If not, it only states how many of them differ from zero.
    most_rows
        Largest number of rows of the table. Default: any number.

    Returns
    -------
    Table or str
        Table with mean, u, prior sd and unit. If no coefficient is to be listed, a sentence that
        says so; if the table would have more rows than ``most_rows``, a sentence that counts them.
    """
    rows = []
    unlisted = 0
    for name, entry in entries.items():
        if abs(entry["mean"]) <= 2.0 * entry["sd"]:
            continue
        if not instrument_listed and Term.kinds.get(entry["term"], Term).instrument:
            unlisted += 1
            continue
        unit_size, unit = wording.unit_words(name)
        mean, spread = value_and_uncertainty(entry["mean"] / unit_size, entry["sd"] / unit_size)
        prior_sd, _ = round_uncertainty(entry["prior_sd"] / unit_size)
        rows.append((wording.nuisance_words(name), mean, spread, prior_sd, unit))
    total = len(entries)
    if not rows and not unlisted:
        return f"None of the {total} other effects differs from zero by more than 2 u."
    if not rows:
        return (
            f"Other effects that differ from zero by more than 2 u: {unlisted} of {total}, all of"
            " the instrument (balls, bar, mount or force)."
        )
    if most_rows is not None and len(rows) > most_rows:
        counted = f"{len(rows) + unlisted} of {total}"
        if unlisted:
            counted += f", {unlisted} of them of the instrument (balls, bar, mount or force)"
        return (
            f"Other effects that differ from zero by more than 2 u: {counted}. --details lists"
            f" {len(rows)}, such as {rows[0][0]}."
        )
    caption = (
        "Other effects that differ from zero by more than 2 u;"
        f" {total - len(rows) - unlisted} of {total} do not"
    )
    if unlisted:
        caption += f"; of the instrument (balls, bar, mount or force), not listed: {unlisted}"
    heads = ("effect", "mean", "u (1 sd)", "prior sd", "unit")
    return Table.of(caption, heads, rows, text=("unit",))
