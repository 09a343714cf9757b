"""Tables and sentences on the results of a fit, with remarks on the readings.

Nuisance coefficients describe effects that are modelled but not of interest. Slopes are
coefficients of the change of compliances with force.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from ldbb_bayes import units
from ldbb_bayes.analysis.compliance_change import change_with_force
from ldbb_bayes.analysis.conformity import assess_conformity
from ldbb_bayes.analysis.posterior_verdicts import confounded_in
from ldbb_bayes.analysis.verdicts import ParameterIdentifiability, not_modelled
from ldbb_bayes.campaign.preview import CampaignPreview, RemarkKind, check_campaign
from ldbb_bayes.inference.fit import Fit
from ldbb_bayes.inference.force_curves import draws_at
from ldbb_bayes.inference.kept_results import kept
from ldbb_bayes.inference.posterior import bound_of, campaign_of, fit_of, record_of
from ldbb_bayes.inference.summary import json_entry, result_json, summarize_nuisances
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.terms import Term
from ldbb_bayes.report import wording
from ldbb_bayes.results import Passage, Shown, Table
from ldbb_bayes.units import (
    display_name,
    display_unit,
    needs_interval,
    round_like,
    round_uncertainty,
    state,
    three_digits,
    value_and_uncertainty,
)

if TYPE_CHECKING:
    import xarray as xr

__all__ = [
    "FitWords",
    "change_parts",
    "change_table",
    "coefficient_table",
    "conformity_table",
    "describe_fit",
    "explanation_of_U",
    "full_result",
    "further_remarks",
    "nuisance_table",
    "parameter_table",
    "parts_of_fit",
    "result_at_force",
    "results_table",
    "words_of_fit",
]

# The factor λ of a circle multiplies the circle's random shift and unexplained deviations; it is
# large for a circle that does not agree with the others. The table of a fit's parameters shows λ
# only if its posterior median is at least this value.
_ODD_CIRCLE = 2.5
# Heading of the column with the expanded uncertainty in a table of results.
_HEAD_OF_U = "U (k = 2)"
# Largest number of nuisance coefficients that a fit lists on the screen without --details.
_MOST_NUISANCES_ON_SCREEN = 12
# A decision on conformity is close if the probability is less than this number of its numerical
# standard errors away from the probability at which the decision changes.
_CLOSE_DECISION = 2.0
# A report on a fit leaves out the remarks on the campaign that have one of these kinds, because
# other sentences of the report state the same facts.
_REMARKS_OF_FITS = (RemarkKind.ONE_LEVEL, RemarkKind.TWO_LEVELS, RemarkKind.ONE_WAY)


# ---- JSON record of a fit


@kept
def full_result(posterior: xr.DataTree, prob: float) -> dict[str, Any]:
    """Return all results of a fit as a dictionary.

    The results include the changes of compliances with force, the coefficients of effects that are
    modelled but not of interest (nuisances), warnings, and decisions on conformity.

    Parameters
    ----------
    posterior
        Posterior of the fit.
    prob
        Probability of the credible intervals.

    Returns
    -------
    dict
        The record that the command ``fit --json`` prints.
    """
    result = result_json(posterior, prob=prob)
    changes = change_with_force(posterior, prob=prob)
    result["change_with_force"] = {name: change.as_dict() for name, change in changes.items()}
    result["nuisances"] = summarize_nuisances(posterior).to_dict(orient="index")
    result["fit"] |= describe_fit(posterior)
    if campaign_of(posterior).tolerances:
        decisions = assess_conformity(posterior)
        result["conformity"] = {name: decision.as_dict() for name, decision in decisions.items()}
    return result


def result_at_force(
    posterior: xr.DataTree, result: Mapping[str, Any], prob: float, force_N: float
) -> dict[str, Any]:
    """Return the results of a fit with the compliances C(F) at one force F.

    Parameters
    ----------
    posterior
        Posterior of the fit.
    result
        Results of the fit, see `full_result`. Their compliances are those at the model's reference
        force.
    prob
        Probability of the credible intervals.
    force_N
        Force F of the bar [N].

    Returns
    -------
    dict
        The same results; only the entries of the compliances in ``parameters`` differ.
    """
    draws_by_name = draws_at(posterior, force_N)
    parameters = dict(result["parameters"])
    for compliance in bound_of(posterior).compliances:
        name = compliance.label
        if name in parameters:
            entry = parameters[name]
            at_force = json_entry(draws_by_name[name], entry["unit"], entry["prior_sd"], prob)
            parameters[name] = entry | at_force
    return {**result, "parameters": parameters}


class FitWords(Shown, dict[str, Any]):
    """Dictionary that describes a fit in words: its state, verdict, misfits and warnings.

    The state and the verdict say whether the results of the fit can be used. A misfit is a feature
    of the readings that the fitted model does not predict. The function ``print`` shows the
    dictionary as sentences.
    """

    def __repr__(self) -> str:
        """Return a short text with the state of the fit and the number of its warnings."""
        return f"<fit in words: {self['state']}, {len(self['warnings'])} warnings>"


@kept
def describe_fit(posterior: xr.DataTree) -> FitWords:
    """Return a description of a fit in words: its state, verdict, misfits and warnings.

    The state and the verdict say whether the numbers of the fit can be used. A misfit is a feature
    of the readings that the fitted model does not predict.

    Parameters
    ----------
    posterior : DataTree
        Posterior from `sample`, `load` or `average`.

    Returns
    -------
    FitWords
        A dictionary, which the function ``print`` shows as sentences. It has five keys:

        - ``state``: ``usable``, ``doubtful`` or ``unusable``
        - ``kinds``: the kinds of all warnings and misfits
        - ``verdict``: a sentence on whether the numbers can be used
        - ``misfits``: strings that name the misfits
        - ``warnings``: sentences that warn the user

    Examples
    --------
    >>> words = lb.report.describe_fit(posterior)
    >>> words["state"]
    'usable'
    >>> [warning for warning in words["warnings"] if warning.startswith("Confounded")]
    ['Confounded: C_XYX ... with hysteresis; ...']
    """
    return words_of_fit(
        fit_of(posterior),
        record_of(posterior)["sampler"],
        bound_of(posterior),
        confounded_in(posterior),
    )


def words_of_fit(
    fit: Fit,
    sampler: Mapping[str, Any],
    bound: BoundModel,
    confounded: Mapping[str, Sequence[str]],
) -> FitWords:
    """Return a description of a fit in words: its state, verdict, misfits and warnings.

    The state and the verdict say whether the numbers of the fit can be used. A misfit is a feature
    of the readings that the fitted model does not predict.

    Parameters
    ----------
    fit
        Results of the fit: how well the model predicts the readings, and concerns about the fit.
    sampler
        Entry ``sampler`` of a posterior's record, which states how the sampler ran.
    bound
        The model applied to the campaign.
    confounded
        Mapping from the names of the confounded parameters and changes with force to the names of
        the effects with which each of them is confounded (`confounded_in`).

    Returns
    -------
    FitWords
        The same as `describe_fit` returns.
    """
    campaign_preview = check_campaign(bound.campaign)
    warnings = [
        *wording.concern_sentences(fit.concerns, sampler),
        *wording.check_notes(fit),
        *wording.confounded_sentences(confounded),
        *wording.not_modelled_sentences(not_modelled(bound)),
    ]
    warnings += wording.peculiarity_sentences(campaign_preview)
    warnings += further_remarks(campaign_preview)
    return FitWords(
        state=str(fit.state),
        kinds=list(fit.kinds),
        verdict=wording.fit_verdict(fit),
        misfits=[wording.check_words(check) for check in fit.misfits],
        warnings=warnings,
    )


def further_remarks(campaign_preview: CampaignPreview) -> list[str]:
    """Return those remarks on a campaign that the sentences on its fit do not repeat.

    ``campaign_preview`` holds all remarks on the campaign, which are made without a fit.
    """
    return [
        wording.remark_words(remark)
        for remark in campaign_preview.remarks
        if remark.kind not in _REMARKS_OF_FITS
    ]


# ---- tables of a fit


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
        f"{campaign['name']}: {campaign['tests']} tests, {campaign['readings']} readings.",
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


def conformity_table(decisions: Mapping[str, Mapping[str, Any]]) -> Table:
    """Return a table of decisions on conformity, one row for each quantity with a tolerance.

    The columns include the value, U, the tolerance, the probability of conformity and the guard
    band. The value is the one that the sheets state. Where value ± U would not describe the
    quantity, the distances to the ends of its 95 % interval take the place of U, as on the sheets;
    the caption says so. Of a stiffness that may be infinite, the lower end of this interval is
    stated alone, and no guard band. The numerical error of the probability is stated if the
    decision depends on it.

    Parameters
    ----------
    decisions
        Mapping from the names of the quantities to the decisions. Each decision is a dictionary, as
        `assess_conformity` describes it.

    Returns
    -------
    Table
    """
    rows = []
    for name, decision in decisions.items():
        factor, label = display_unit(decision["unit"])
        guard_band = "–"
        if decision["guard_band"] is not None:
            guard_band = round_uncertainty(decision["guard_band"] * factor)[0]
        rows.append(
            (
                display_name(name),
                *_value_and_U(decision),
                wording.limit_words(decision["lower"], decision["upper"], factor),
                _probability_of_conformance(decision),
                guard_band,
                label,
                decision["decision"],
            )
        )
    heads = (
        "quantity",
        "value",
        "U",
        "tolerance",
        "P(conforms)",
        "guard band",
        "unit",
        "decision",
    )
    caption = "Conformity (ISO 14253-1, JCGM 106)"
    forces_N = {decision["force_N"] for decision in decisions.values()} - {None}
    for force in sorted(forces_N):
        caption += f", at {force:g} N"
    if any(_is_beside_U(decision) for decision in decisions.values()):
        caption += "; +a / −b are the ends of the 95 % interval"
    return Table.of(caption, heads, rows, text=("unit", "decision"))


def _is_beside_U(decision: Mapping[str, Any]) -> bool:
    """Return whether +a / −b describes a quantity that has a tolerance, and value ± U does not."""
    if decision["ci_high"] is None:
        return False
    interval = (decision["ci_low"], decision["ci_high"])
    return needs_interval(decision["value"], decision["sd"], interval)


def _value_and_U(decision: Mapping[str, Any]) -> tuple[str, str]:
    """Return the value of a quantity that has a tolerance, and its U, in the unit shown.

    Where value ± U would not describe the quantity, the distances from the value to the ends of the
    95 % interval are stated in place of U, such as "+19 / −9". Of a stiffness that may be infinite,
    the lower end is stated alone, such as "≥ 11.2". A stiffness that is infinite in the whole
    interval has none.
    """
    low = decision["ci_low"]
    high = decision["ci_high"]
    factor, _ = display_unit(decision["unit"])
    if high is None:
        if low is None:
            return "∞", ""
        return f"≥ {three_digits(low * factor)}", ""
    value = decision["value"]
    sd = decision["sd"]
    if not _is_beside_U(decision):
        return value_and_uncertainty(value * factor, 2.0 * sd * factor)
    statement = state(value, sd, (low, high), decision["unit"])
    return statement.value, statement.expanded


def _probability_of_conformance(decision: Mapping[str, Any]) -> str:
    """Return the probability of conformance, such as "0.948 ± 0.006" if the decision is close.

    A decision is close if other posterior draws might well lead to another one.
    """
    probability = wording.probability_words(decision["probability"])
    error = decision.get("probability_error", 0.0)
    nearest = min(
        abs(decision["probability"] - decision["confidence"]),
        abs(1.0 - decision["probability"] - decision["confidence"]),
    )
    if nearest >= _CLOSE_DECISION * error:
        return probability
    return f"{probability} ± {error:.1g}"


def change_table(changes: Mapping[str, Mapping[str, Any]]) -> Table:
    """Return a table of the changes of compliances over the tested forces.

    The table has one row for each compliance.

    Parameters
    ----------
    changes
        Mapping from the names of the compliances to their changes. Each change is a dictionary, as
        `change_with_force` describes it.

    Returns
    -------
    Table
    """
    rows = []
    caption = wording.PAGE["change"]
    percent = "95 %"
    for name, change in changes.items():
        factor, _ = display_unit(change["unit"])
        by_force = []
        for key in ("at_smallest", "at_largest"):
            value = change[key]
            by_force.append(value_and_uncertainty(value["mean"] * factor, value["sd"] * factor)[0])
        cells = _change_cells(change)
        rows.append(
            (
                display_name(name),
                *by_force,
                cells.value,
                cells.u,
                cells.interval,
                cells.unit,
                _relative_change_cell(change["relative"]),
                wording.direction_words(change),
            )
        )
        percent = f"{100 * change['prob']:g} %"
        smallest = change["smallest_force_N"]
        largest = change["largest_force_N"]
        caption = f"{wording.PAGE['change']} from {smallest:.4g} N to {largest:.4g} N"
    heads = (
        "compliance",
        "C(F_min)",
        "C(F_max)",
        "change",
        "u",
        f"{percent} interval",
        "unit",
        "relative change",
        "direction",
    )
    return Table.of(caption, heads, rows, text=("unit", "direction"))


def change_parts(change: Mapping[str, Any]) -> tuple[Passage, ...]:
    """Return a table and a sentence on the change of one compliance with force.

    The table has the compliance at the smallest force tested, at the reference force and at the
    largest force tested, and the change over the tested forces. The sentence states whether the
    compliance increases or decreases.

    Parameters
    ----------
    change
        Change of the compliance as a dictionary; see `change_with_force`.

    Returns
    -------
    tuple
        The table and the sentence.
    """
    rows = []
    for key in ("smallest", "reference", "largest"):
        label = f"C({change[f'{key}_force_N']:.4g} N)"
        rows.append(_value_row(label, change[f"at_{key}"], change["unit"]))
    cells = _change_cells(change)
    rows.append(("change", cells.value, cells.u, cells.interval, cells.unit))
    relative = change["relative"]
    if relative is not None:
        in_percent = {key: 100.0 * value for key, value in relative.items()}
        rows.append((*_value_row("change / C(F0)", in_percent, "")[:-1], "%"))
    heads = ("quantity", "value", "u", f"{100 * change['prob']:g} % interval", "unit")
    table = Table.of(wording.PAGE["change"], heads, rows, text=("unit",))
    return (table, f"Direction: {wording.direction_words(change)}.")


def _value_row(label: str, value: Mapping[str, float], unit: str) -> tuple[str, ...]:
    """Return the cells of a row: label, value, standard uncertainty, credible interval and unit.

    ``value`` holds the entries ``mean``, ``sd``, ``ci_low`` and ``ci_high``, in the internal unit
    ``unit`` (mm, N, rad).
    """
    statement = units.state(value["mean"], value["sd"], (value["ci_low"], value["ci_high"]), unit)
    return (label, statement.value, statement.u, statement.interval, statement.unit)


class _ResultCells(NamedTuple):
    """Five cells of a row in a table of results: value, u, U (k = 2), credible interval, unit."""

    value: str
    u: str
    expanded: str
    interval: str
    unit: str


def _change_cells(change: Mapping[str, Any]) -> _ResultCells:
    """Return the change of a compliance as texts.

    A change that is almost certainly zero has no uncertainty to state.
    ``change`` is the JSON record of the change over the tested forces, see `change_with_force`.
    """
    if wording.is_exactly_none(change):
        return _ResultCells("0", "–", "–", "–", display_unit(change["unit"])[1])
    value = change["change"]
    interval = (value["ci_low"], value["ci_high"])
    return _statement_cells(units.state(value["mean"], value["sd"], interval, change["unit"]))


def _relative_change_cell(relative: Mapping[str, float] | None) -> str:
    """Return the relative change of a compliance as a string in per cent.

    ``relative`` is a dictionary with the median of the relative change. A dash is returned if
    ``relative`` is None.
    """
    if relative is None:
        return "–"
    return f"{100.0 * relative['median']:.0f} %"


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
        if units.is_slope(name):
            if not result.get("change_with_force"):
                others[name] = entry
        elif units.is_compliance_or_slope(name):
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
        if not name.startswith("lambda_") or entry["median"] >= _ODD_CIRCLE:
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
    change_cells = _change_cells(change)
    cells = [
        wording.changes_by_words(name, change),
        change_cells.value,
        change_cells.u,
        change_cells.interval,
    ]
    if has_prior_means:
        cells.append("–")
    return (*cells, "–", change_cells.unit)


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
    of_U: Mapping[str, Any] | None = None,
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
    of_U
        The same results with intervals of 95 %, from which U is stated. Default: ``result``, whose
        intervals are then of 95 %.

    Returns
    -------
    Table
    """
    of_U = result if of_U is None else of_U
    compliances, others = _parameters_by_kind(result)
    changes = result.get("change_with_force", {})
    rows = []
    for name, entry in compliances.items():
        verdict = wording.verdict_words(verdicts[name], shares=shares)
        rows.append(_result_row(name, entry, verdict, of_U["parameters"][name]))
    for name, change in changes.items():
        label = wording.changes_by_words(name, change)
        cells = _change_cells(of_U["change_with_force"][name])
        cells = cells._replace(interval=_change_cells(change).interval)
        rows.append((label, *cells, "", wording.direction_words(change)))
    for name, entry in others.items():
        verdict = wording.verdict_words(verdicts[name], shares=shares)
        rows.append(_result_row(name, entry, verdict, of_U["parameters"][name]))
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
    of_U: Mapping[str, Any] | None = None,
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
    of_U
        The same results with intervals of 95 %, from which U is stated. Default: ``result``, whose
        intervals are then of 95 %.

    Returns
    -------
    Table
    """
    of_U = result if of_U is None else of_U
    rows = []
    for name, entry in result["parameters"].items():
        if units.is_slope(name):
            verdict = wording.verdict_words(verdicts[name], shares=False)
            rows.append(_result_row(name, entry, verdict, of_U["parameters"][name]))
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
    statement = units.state(entry["mean"], entry["sd"], interval, entry["unit"])
    interval_of_U = wording.interval_of(entry_of_U)
    of_U = units.state(entry["mean"], entry["sd"], interval_of_U, entry["unit"])
    stiffness = ""
    if units.is_direct(name):
        stiffness = units.stiffness(entry["median"], interval)
    cells = _statement_cells(statement)._replace(expanded=of_U.expanded)
    return (display_name(name), *cells, stiffness, verdict)


def _statement_cells(statement: units.Statement) -> _ResultCells:
    """Return five cells of a parameter's row in a table of results, as texts."""
    return _ResultCells(
        statement.value,
        statement.u,
        statement.expanded,
        statement.interval,
        statement.unit,
    )


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
