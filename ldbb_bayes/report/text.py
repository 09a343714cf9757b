"""Results as tables and sentences, for a terminal, a notebook and the page."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

import ldbb_bayes as lb
from ldbb_bayes import units
from ldbb_bayes.analysis.budgets import Budget
from ldbb_bayes.analysis.calibration import Validation
from ldbb_bayes.analysis.comparison import Comparison
from ldbb_bayes.analysis.design import Design
from ldbb_bayes.analysis.machine_description import DescribedMachine, VisibleParameter
from ldbb_bayes.analysis.verdicts import Identifiability, ParameterIdentifiability
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.campaign.preview import CampaignPreview, RemarkKind, preview
from ldbb_bayes.inference.density import LogDensity
from ldbb_bayes.inference.fit import Fit
from ldbb_bayes.inference.least_squares import LeastSquares
from ldbb_bayes.model.hybrid import HybridModel, Simulation
from ldbb_bayes.model.terms import Term, Uncertainties
from ldbb_bayes.reading.importing import Imported
from ldbb_bayes.report import wording
from ldbb_bayes.report.wording import IN_FORCE
from ldbb_bayes.results import (
    ByName,
    Passage,
    Shown,
    Table,
    parts_of,
)
from ldbb_bayes.units import (
    display_name,
    display_unit,
    round_like,
    round_uncertainty,
    value_and_uncertainty,
)

if TYPE_CHECKING:
    import xarray as xr

__all__ = [
    "FitWords",
    "Passage",
    "comparison_parts",
    "conformity_table",
    "fit_in_words",
    "full_result",
    "further_remarks",
    "nuisance_table",
    "parameter_table",
    "parts_of",
    "parts_of_fit",
    "results_table",
    "two_digits",
]


def two_digits(value: float | None, factor: float = 1.0) -> str:
    """Return a number of either sign with two significant digits and no exponent; a dash for one
    that is missing or infinite.
    """
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
def _(campaign: Campaign) -> tuple[Passage, ...]:
    """With a row per test, and what is not known of any left out."""
    shown = {
        "test": "name",
        "force (N)": "force_N",
        "pressure (bar)": "pressure_bar",
        "arc (°)": "arc_deg",
    }
    shown |= {"direction": "direction", "plane": "plane", "radius (mm)": "radius_mm"}
    shown |= {"work ball (°)": "work_ball_deg", "tool ball (°)": "tool_ball_deg"}
    rows = [
        [*(getattr(own, key) for key in shown.values()), len(own.angle_deg)]
        for own in campaign.tests
    ]
    text = ["plane", *(["direction"] if any(own.direction for own in campaign.tests) else [])]
    where = f"{campaign.topology}, plane {campaign.machine().plane}, R = {campaign.radius_mm:g} mm"
    return (Table.of(f"{repr(campaign)[1:-1]}; {where}", [*shown, "readings"], rows, text=text),)


@parts_of.register
def _(result: Imported) -> tuple[Passage, ...]:
    campaign = result.campaign
    head = (
        f"{campaign.name}: {len(campaign.tests)} tests, {campaign.readings} readings. Assumed"
        " (change it with the option named):"
    )
    return (head, tuple(map(wording.assumption_words, result.assumptions)))


@parts_of.register
def _(seen: CampaignPreview) -> tuple[Passage, ...]:
    """With a row per test; plane, set-up, radius and centre where tests differ in them."""
    different = [
        field for field in _PLACES if len({getattr(test, field) for test in seen.tests}) > 1
    ]
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
            *(
                "–" if own is None else f"{own:.3g}"
                for own in (test.noise_um, test.start_end_um, test.peak_to_peak_um)
            ),
        )
        for test in seen.tests
    ]
    first = ("test", "force (N)", "pressure (bar)", "readings", "arc (°)", "gap (°)", "direction")
    heads = (
        *first,
        *(_PLACES[field][0] for field in different),
        "balls (°)",
        "step (µm)",
        "spikes",
        "noise (µm)",
    )
    last = ("end − start (µm)", "peak to peak (µm)")
    table = Table.of("", (*heads, *last), rows, text=("direction", "plane", "centre (mm)"))
    return (
        table,
        *wording.preview_sentences(seen),
        "A fit will assume:",
        tuple(map(wording.remark_words, seen.assumptions)),
    )


@parts_of.register
def _(found: Uncertainties) -> tuple[Passage, ...]:
    """With nominal value, u, where that is from, and what certificate states it."""
    rows = []
    for own in found.assumed:
        (_, one, label), (words, where) = (
            Term.owner(own.name).unit_of(own.name),
            wording.assumed_words(own),
        )
        nominal, spread = value_and_uncertainty(own.value / one, own.sd / one)
        rows.append(
            (words, nominal, spread, label, "certificate" if own.stated else "the model", where)
        )
    heads = ("assumed", "nominal", "u (1 sd)", "unit", "source", "in campaign.toml")
    table = Table.of("What a fit assumes of the instrument", heads, rows, text=heads[3:])
    return (
        table,
        *(f"Certificate of the {what}: {name}" for what, name in found.certificates.items()),
        wording.PAGE["lobes"],
    )


@parts_of.register
def _(machine: DescribedMachine) -> tuple[Passage, ...]:
    first, *others = wording.machine_sentences(machine)
    patterns = (
        ["pattern"]
        if len(machine.planes) == 1
        else [f"pattern in {plane}" for plane in machine.planes]
    )

    def table(title: str, entries: tuple[VisibleParameter, ...], *last: str) -> Table:
        heads = (title, "unit", *patterns, "what it is", *last)
        rows = []
        for entry in entries:
            shown = (entry.pattern.get(plane, "·") for plane in machine.planes)
            words = (entry.meaning, *[wording.sum_in_words(entry)] * len(last))
            rows.append((display_name(entry.name), display_unit(entry.unit)[1], *shown, *words))
        return Table.of("", heads, rows, text=heads)

    compliances = table("compliance", machine.compliances, "stands for")
    return (first, compliances, table("geometric error", machine.geometric_errors), *others)


# ---- model and fit


@parts_of.register
def _(model: HybridModel) -> tuple[Passage, ...]:
    prior = (
        "flat"
        if model.prior.flat
        else "proper, no compliance negative"
        if model.prior.truncated
        else "proper"
    )
    rows = [
        (
            type(term).__name__,
            ", ".join(
                f"{k} = {v if isinstance(v, str) else f'{v:g}'}" for k, v in vars(term).items()
            ),
        )
        for term in model.nuisances
    ]
    caption = f"HybridModel: compliance {IN_FORCE[model.degree]}; priors {prior}; other effects"
    return (Table.of(caption, ("term", "settings"), rows or [("none", "")], text=("settings",)),)


@parts_of.register
def _(density: LogDensity) -> tuple[Passage, ...]:
    rows = [
        (display_name(name), unit, *own)
        for name, unit, own in zip(density.names, density.units, density.bounds, strict=True)
    ]
    return (
        Table.of(repr(density), ("coordinate", "unit", "least", "greatest"), rows, text=("unit",)),
    )


@parts_of.register
def _(made: Simulation) -> tuple[Passage, ...]:
    sizes = {name: display_unit(unit) for name, unit in made.units.items()}
    rows = [
        (display_name(name), value * sizes[name][0], sizes[name][1])
        for name, value in made.parameters.items()
    ]
    rows += [
        (name, size, "" if name == "decay" or name.startswith("lambda_") else "µm")
        for name, size in made.hyper_um.items()
    ]
    caption = f"Simulation of {made.campaign.name}, {len(made.campaign.tests)} tests"
    return (Table.of(caption, ("true parameter", "value", "unit"), rows, text=("unit",)),)


@parts_of.register
def _(fit: Fit) -> tuple[Passage, ...]:
    others = tuple(concern for concern in fit.concerns if concern.kind != "not-converged")
    return (wording.fit_verdict(fit), *wording.concern_sentences(others, {}))


@parts_of.register
def _(result: LeastSquares) -> tuple[Passage, ...]:
    rows = []
    for name, row in result.table.iterrows():
        factor, unit = display_unit(row["unit"])
        rows.append(
            (
                display_name(str(name)),
                *value_and_uncertainty(row["estimate"] * factor, row["u"] * factor),
                unit,
            )
        )
    caption = (
        f"Least squares (Eq. 31), RMSE {result.quality.rmse_um:.3g} µm; u from the scatter of the"
        " readings alone"
    )
    return (Table.of(caption, ("parameter", "estimate", "u (1 sd)", "unit"), rows, text=("unit",)),)


def full_result(posterior: xr.DataTree, ci_prob: float) -> dict[str, Any]:
    """The JSON of a fit, with nuisances, and what a look at the readings finds among its
    warnings.
    """
    from ldbb_bayes.inference.posterior import campaign_of
    from ldbb_bayes.inference.summary import nuisances, result_json

    result = result_json(posterior, ci_prob=ci_prob)
    result["nuisances"] = nuisances(posterior).to_dict(orient="index")
    result["fit"] |= fit_in_words(posterior)
    if campaign_of(posterior).tolerances:
        result["conformity"] = {
            name: own.as_dict() for name, own in lb.conformity(posterior).items()
        }
    return result


class FitWords(Shown, dict[str, Any]):
    """A fit in words, by key; printed as the verdict and what to mind."""

    def __repr__(self) -> str:
        return f"<fit in words: {self['state']}, {len(self['warnings'])} warnings>"


@parts_of.register
def _(words: FitWords) -> tuple[Passage, ...]:
    return (words["verdict"], tuple(words["warnings"]))


def fit_in_words(posterior: xr.DataTree) -> FitWords:
    """Return a fit's state, the kinds of what to mind, and verdict, misfits and warnings in words;
    it prints as sentences.
    """
    from ldbb_bayes.analysis.aliases import degeneracies, standing_degeneracies
    from ldbb_bayes.inference.posterior import bound_of, fit_of, record_of

    fit = fit_of(posterior)
    bound = bound_of(posterior)
    alike = degeneracies(bound)
    seen = preview(bound.campaign)
    concerns = wording.concern_sentences(fit.concerns, record_of(posterior)["sampler"])
    standing = map(wording.standing_words, standing_degeneracies(bound, alike))
    return FitWords(
        state=str(fit.state),
        kinds=list(fit.kinds),
        verdict=wording.fit_verdict(fit),
        misfits=[wording.check_words(check) for check in fit.misfits],
        warnings=[
            *concerns,
            *wording.check_notes(fit),
            *wording.alias_sentences(alike),
            *standing,
            *wording.look_sentences(seen),
            *further_remarks(seen),
        ],
    )


def further_remarks(seen: CampaignPreview) -> list[str]:
    """Remarks on a campaign that a fit does not make itself."""
    own = (RemarkKind.ONE_LEVEL, RemarkKind.TWO_LEVELS, RemarkKind.ONE_WAY)
    return [wording.remark_words(remark) for remark in seen.remarks if remark.kind not in own]


def parts_of_fit(result: Mapping[str, Any]) -> tuple[Passage, ...]:
    """Return the JSON of a fit as tables and sentences, other effects of the instrument left
    out.
    """
    others = {
        name: own
        for name, own in result["nuisances"].items()
        if not Term.kinds.get(own["term"], Term).instrument
    }
    nuisances = [nuisance_table(others)] if others else []
    tables = [
        parameter_table(result),
        *nuisances,
        *([conformity_table(own)] if (own := result.get("conformity")) else []),
    ]
    campaign = result["campaign"]
    quality = result["fit"]
    head = f"{campaign['name']}: {campaign['tests']} tests, {campaign['readings']} readings."
    went = (wording.quality_words(quality), wording.sampler_words(result["sampler"]))
    notes = (f"Note: {warning}" for warning in quality["warnings"])
    prior = [wording.PAGE["prior_from"].format(**own)] if (own := result.get("prior_from")) else []
    return (
        f"Verdict: {quality['verdict']}",
        head,
        *tables,
        *went,
        *notes,
        wording.model_words(result["model"]),
        *prior,
    )


def conformity_table(found: Mapping[str, Mapping[str, Any]]) -> Table:
    """Return tolerance, probability of conformance, guard band and decision of every quantity, from
    the JSON of `conformity`.
    """
    rows = []
    for name, own in found.items():
        factor, label = display_unit(own["unit"])
        band = round_uncertainty(own["guard_band"] * factor)[0]
        limits = wording.limit_words(own["lower"], own["upper"], factor)
        cells = (
            limits,
            wording.probability_words(own["probability"]),
            band,
            label,
            own["decision"],
        )
        rows.append((display_name(name), *cells))
    heads = ("quantity", "tolerance", "P(conforms)", "guard band", "unit", "decision")
    where = "".join(
        f", at {force:g} N" for force in sorted({own["force_N"] for own in found.values()} - {None})
    )
    return Table.of(
        f"Conformity (ISO 14253-1, JCGM 106){where}", heads, rows, text=("unit", "decision")
    )


_ODD = 2.5


def parameter_table(result: Mapping[str, Any]) -> Table:
    """Return posterior mean and sd, interval, and sd of the prior (its mean too where priors have
    any) from the JSON of a fit; of the circles' scales λ those of odd circles alone.
    """
    entries = {**result["parameters"], **result["hyper"]}
    means = any(entry.get("prior_mean") for entry in entries.values())
    rows = []
    for name, entry in entries.items():
        if name.startswith("lambda_") and entry["median"] < _ODD:
            continue
        factor, unit = display_unit(entry["unit"])
        spread, decimals = round_uncertainty(entry["sd"] * factor)
        low, high = (round_like(bound * factor, decimals) for bound in wording.interval_of(entry))
        prior = ["flat" if entry["prior_sd"] is None else _three_digits(entry["prior_sd"] * factor)]
        if means:
            middle = entry.get("prior_mean")
            prior.insert(
                0,
                (
                    "–"
                    if middle is None
                    else value_and_uncertainty(middle * factor, entry["prior_sd"] * factor)[0]
                ),
            )
        shown = display_name(name.removesuffix("_um"))
        rows.append(
            (
                shown,
                round_like(entry["mean"] * factor, decimals),
                spread,
                f"[{low}, {high}]",
                *prior,
                unit,
            )
        )
    priors = ("prior mean", "prior sd") if means else ("prior sd",)
    heads = (
        "parameter",
        "mean",
        "u (1 sd)",
        f"{wording.percent_of(result)} interval",
        *priors,
        "unit",
    )
    return Table.of("", heads, rows, text=("unit",))


def results_table(
    result: Mapping[str, Any],
    verdicts: Mapping[str, ParameterIdentifiability],
    *,
    shares: bool = True,
) -> Table:
    """Return value, u, U, interval, unit, stiffness of the direct compliances, and verdict of every
    parameter; with the share of the variance that every partner holds, where no budget stands
    beside it.
    """
    rows = []
    for name, entry in result["parameters"].items():
        own = units.state(entry["mean"], entry["sd"], wording.interval_of(entry), entry["unit"])
        stiff = (
            units.stiffness(entry["median"], wording.interval_of(entry))
            if units.is_direct(name)
            else ""
        )
        verdict = wording.verdict_words(verdicts[name], shares=shares)
        rows.append(
            (
                display_name(name),
                own.value,
                own.u,
                own.expanded,
                own.interval,
                own.unit,
                stiff,
                verdict,
            )
        )
    interval = f"{wording.percent_of(result)} interval"
    heads = (
        "parameter",
        "value",
        "u",
        "U (k = 2)",
        interval,
        "unit",
        "stiffness (N/µm)",
        "verdict",
    )
    return Table.of(
        "Compliances, their slopes, geometric errors", heads, rows, text=("unit", "verdict")
    )


def nuisance_table(entries: Mapping[str, Mapping[str, Any]]) -> Table | str:
    """Return mean, u, prior sd and unit of the nuisance coefficients that lie more than 2 sd off
    zero, or that none does.
    """
    rows = []
    for name, entry in entries.items():
        if abs(entry["mean"]) > 2.0 * entry["sd"]:
            one, unit = wording.unit_words(name)
            mean, spread = value_and_uncertainty(entry["mean"] / one, entry["sd"] / one)
            rows.append(
                (
                    wording.nuisance_words(name),
                    mean,
                    spread,
                    round_uncertainty(entry["prior_sd"] / one)[0],
                    unit,
                )
            )
    if not rows:
        return f"None of the {len(entries)} other effects differs from zero by more than 2 u."
    caption = (
        f"Other effects that differ from zero by more than 2 u; {len(entries) - len(rows)} of"
        f" {len(entries)} do not"
    )
    return Table.of(
        caption, ("effect", "mean", "u (1 sd)", "prior sd", "unit"), rows, text=("unit",)
    )


# ---- identifiability and calibration


@parts_of.register
def _(result: Identifiability) -> tuple[Passage, ...]:
    """With prior sd and u, contraction, information and verdict of every parameter."""
    rows = []
    for name, entry in result.parameters.items():
        factor, unit = display_unit(entry.unit)
        proper = entry.prior_sd < float("inf")
        prior = _three_digits(entry.prior_sd * factor) if proper else "flat"
        gains = (
            (f"{entry.contraction:.4f}", f"{entry.information_gain:.1f}") if proper else ("", "")
        )
        rows.append(
            (
                display_name(name),
                prior,
                round_uncertainty(entry.sd * factor)[0],
                unit,
                *gains,
                wording.verdict_words(entry),
            )
        )
    heads = (
        "parameter",
        "prior sd",
        "u, sign free",
        "unit",
        "contraction",
        "gain (nat)",
        "verdict",
    )
    items = wording.degeneracy_items(result.degeneracies, result.cures)
    alike = (wording.ALIKE, items) if items else (wording.NONE_ALIKE,)
    table = Table.of("", heads, rows, text=("unit", "verdict"))
    return (
        table,
        *wording.identifiability_sentences(result),
        *alike,
        tuple(map(wording.standing_words, result.standing)),
    )


@parts_of.register
def _(validation: Validation) -> tuple[Passage, ...]:
    """With the share of truths inside their intervals, its standard error, and whether the ranks
    stay inside the band.
    """
    coverage = validation.coverage()
    claimed = [name for name in coverage.columns if not name.startswith("u")]
    rows = []
    for name, row in coverage.loc[list(validation.names)].iterrows():
        shares = [f"{100 * row[p]:.1f}" for p in claimed]
        rows.append(
            (
                display_name(str(name)),
                *shares,
                "outside the band" if name in validation.outside else "inside",
            )
        )
    heads = ("quantity", *(f"in {interval} % interval (%)" for interval in claimed), "ranks")
    errors = wording.joined([f"{100 * coverage['u' + p].iloc[0]:.1f} %" for p in claimed])
    uncertain = f"Standard uncertainty of these shares, from the number of replicates: {errors}."
    return (
        Table.of("", heads, rows, text=("ranks",)),
        uncertain,
        wording.validation_verdict(validation),
    )


_SMALL = 0.005
_RUNNERS = 0.05


@parts_of.register(ByName)
def _(found: ByName[Any]) -> tuple[Passage, ...]:
    """Conformities; or of budgets what limits every parameter, what would improve it most, and u
    then.
    """
    if not all(type(own).__name__ == "Budget" for own in found.values()):
        return (conformity_table({name: own.as_dict() for name, own in found.items()}),)
    rows = []
    for name, budget in found.items():
        factor, unit = display_unit(budget.unit)
        shares = {line.term: budget.share(line.term) for line in budget.contributions}
        heavy = units.ranked(
            [item for item in shares.items() if item[1] >= _RUNNERS], lambda item: item[1]
        )[:3]
        largest = ", ".join(
            f"{wording.source_words(term)} {100 * share:.0f} %" for term, share in heavy
        )
        u, then = (two_digits(size, factor) for size in (budget.u, budget.u_if_known))
        rows.append((display_name(name), u, unit, largest, wording.remedy_words(budget), then))
    heads = ("parameter", "u", "unit", "largest sources", "what would improve it most", "u then")
    return (Table.of("What limits every parameter", heads, rows, text=heads[2:5]),)


@parts_of.register
def _(budget: Budget) -> tuple[Passage, ...]:
    factor, unit = display_unit(budget.unit)
    small = sum(line.share for line in budget.contributions if line.share < _SMALL)
    rows: list[tuple[str, ...]] = []
    for line in budget.contributions:
        if line.share >= _SMALL:
            source, one, one_unit = _source(line)
            own = ("", "") if line.u is None else (two_digits(line.u * one), one_unit)
            sensitivity = (
                "" if line.sensitivity is None else two_digits(line.sensitivity * factor / one)
            )
            share = f"{100 * line.share:.1f} %"
            rows.append(
                (
                    source,
                    line.kind,
                    *own,
                    sensitivity,
                    two_digits(line.contribution * factor),
                    share,
                )
            )
    if abs(small) >= 5e-4:
        contribution = two_digits(max(small, 0.0) ** 0.5 * budget.u * factor)
        rows.append(("all smaller ones", "", "", "", "", contribution, f"{100 * small:.1f} %"))
    rows.append(("together", "", "", "", "", two_digits(budget.u * factor), "100.0 %"))
    heads = (
        "source",
        "type",
        "its u",
        "its unit",
        f"sensitivity ({unit} per its unit)",
        f"contribution ({unit})",
        "share",
    )
    return (
        Table.of(
            f"Budget of {display_name(budget.parameter)}", heads, rows, text=("type", "its unit")
        ),
    )


def _source(line: Any) -> tuple[str, float, str]:
    """What a line of a budget is called, and factor and label that its own uncertainty is read
    in.
    """
    if line.source == line.term:
        return wording.source_words(line.term), *((1.0, "N") if line.unit == "N" else (1e3, "µm"))
    one, label = wording.unit_words(line.source)
    other = line.source.startswith("other ")
    return (
        (
            f"other {wording.source_words(line.term)}"
            if other
            else wording.nuisance_words(line.source)
        ),
        1.0 / one,
        label,
    )


# ---- comparison


def comparison_parts(result: Comparison, *, rmse: bool = True) -> tuple[Passage, ...]:
    """Return the tables and sentences of a comparison, with or without the RMSE of its models."""
    slopes = [
        (display_name(name), f"{slope.inclusion_probability:.2f}")
        for name, slope in result.slopes.items()
    ]
    one_by_one = Table.of("Slopes one by one", ("compliance", "varies with probability"), slopes)
    tables = (
        _models_table(result, rmse),
        _assumption_table(result),
        one_by_one,
        _left_out_table(result),
    )
    return (*(table for table in tables if table.rows), *wording.comparison_sentences(result))


parts_of.register(comparison_parts)


def _models_table(comparison: Comparison, rmse: bool) -> Table:
    """A row per model: ln B over the first, probability, leave-one-force-out, RMSE."""
    first = comparison.pair[0]
    rows = []
    for name, model in comparison.models.items():
        ratio = f"{name}/{first}"
        gain = comparison.elpd_difference.get(ratio)
        squares = model.least_squares_rmse_um
        factor = ("0", "0")
        elpd = ("0", "0")
        if name != first:
            error = max(comparison.log_bayes_factor_error[ratio], 1e-3)
            factor = (f"{comparison.log_bayes_factor[ratio]:+.3f}", f"{error:.1g}")
            elpd = ("–", "–") if gain is None else (f"{gain.value:+.1f}", f"{gain.se:.1f}")
        fits = (
            *([f"{model.rmse_um:.2f}"] if rmse else []),
            "–" if np.isnan(squares) else f"{squares:.2f}",
        )
        rows.append((name, *factor, f"{model.posterior_probability:.3g}", *elpd, *fits))
    over = [f"{what} over {first} (nat)" for what in ("ln B", "elpd")]
    fitted = (*(["RMSE of the model (µm)"] if rmse else []), "least squares (µm)")
    heads = ("model", over[0], "error", "probability", over[1], "u of elpd", *fitted)
    return Table.of("Models at equal prior odds", heads, rows)


def _assumption_table(comparison: Comparison) -> Table:
    """Ln B under every assumption, and by how much the readings prefer it to what the models
    assume.
    """
    rows = [
        (f"slope scale {s.slope_scale:g}", s.log_bayes_factor, s.error, "")
        for s in comparison.prior_sensitivity
    ]
    every = comparison.discrepancy_sensitivity
    rows += [
        (a.assumption, a.log_bayes_factor, a.log_bayes_factor_error, f"{comparison.gain(a):+.1f}")
        for a in every
    ]
    heads = ("assumption", "ln B (nat)", "error", "preferred by (nat)")
    shown = [
        (name, f"{value:+.2f}", f"{max(error, 1e-3):.1g}", gain)
        for name, value, error, gain in rows
    ]
    return Table.of(f"ln B({comparison.sensitivity_of}) under other assumptions", heads, shown)


def _left_out_table(comparison: Comparison) -> Table:
    """Every test left out: p-values, and what tells the models apart."""
    first, second = comparison.pair
    rows = []
    for name, test in comparison.tests.items():
        p = [
            f"{p:.2f}" if p >= 0.01 else f"{p:.1g}"
            for p in (test.lofo_p_value, test.lofo_family_wise_p_value)
        ]
        ratio = f"{test.lofo_log_density[second] - test.lofo_log_density[first]:+.2f}"
        rows.append((name, f"{test.force_N:.4g}", *p, "FLAG" if test.flag else "", ratio))
    heads = (
        "test",
        "force (N)",
        "p",
        "p, all tests",
        "flag",
        f"ln p({comparison.sensitivity_of}) (nat)",
    )
    return Table.of("Every test as the others expect it", heads, rows, text=("flag",))


# ---- design


@parts_of.register
def _(design: Design) -> tuple[Passage, ...]:
    """With the different tests and how often to run each, and the expected standard uncertainty of
    every parameter beside that of baseline and others, floor and prior.
    """
    every = design.table.to_numpy(dtype=object).tolist()
    rows = [[value if isinstance(value, str) else f"{value:.4g}" for value in row] for row in every]
    heads = [wording.PAGE["tests"].get(name, name) for name in ("force_N", *design.columns)]
    run = Table.of("Tests to run", [*heads, "circles"], rows)
    rows = []
    for name, entry in design.expected.items():
        factor, unit = display_unit(entry.unit)
        sizes = [
            entry.sd,
            *(own.expected[name].sd for own in design.compared),
            entry.floor_sd,
            entry.prior_sd,
        ]
        mark = "" if name in design.parameters else " (other effect)"
        rows.append(
            [f"{display_name(name)}{mark}", *(two_digits(size, factor) for size in sizes), unit]
        )
    heads = [
        "expected u",
        "recommended",
        *(own.name for own in design.compared),
        "no less than",
        "prior",
        "unit",
    ]
    expected = Table.of(wording.PAGE["expected"], heads, rows, text=("unit",))
    return (run, expected, *wording.design_sentences(design))
