"""Presentation of results as tables and sentences: in the terminal, a notebook and the HTML page.

The function `parts_of` returns the passages (tables and sentences) of a result. The function
`with_words` returns the JSON record of a result, with sentences that describe the result. Both
functions have a separate implementation for each class of results. This module contains the
implementations for most classes, and imports the modules that contain the other implementations.

Tables of models use two terms. The log Bayes factor ln B states how much the readings favour one
model over another. The expected log predictive density, elpd, states how well a model predicts
readings that it has not seen.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ldbb_bayes import units
from ldbb_bayes.analysis.budgets import Budget
from ldbb_bayes.analysis.calibration import Validation
from ldbb_bayes.analysis.comparison import Comparison
from ldbb_bayes.analysis.compliance_change import ChangeWithForce
from ldbb_bayes.analysis.design import Design
from ldbb_bayes.analysis.directional_stiffness import DirectionalStiffness
from ldbb_bayes.analysis.workflow import Workflow
from ldbb_bayes.inference.density import LogDensity
from ldbb_bayes.inference.fit import Fit
from ldbb_bayes.inference.least_squares import LeastSquares
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.simulation import Simulation
from ldbb_bayes.report import (
    campaign_text,
    goal_design_text,
    identifiability_text,
    import_text,
    machine_text,
    next_circle_text,
    screens,
    wording,
)
from ldbb_bayes.report.change_tables import change_parts, change_table
from ldbb_bayes.report.comparison_tables import (
    assumptions_table,
    left_out_tests_table,
    models_table,
)
from ldbb_bayes.report.conformity_tables import conformity_table
from ldbb_bayes.report.fit_description import FitWords
from ldbb_bayes.report.wording import IN_FORCE
from ldbb_bayes.results import ByName, Passage, Table, parts_of, table_of
from ldbb_bayes.units import (
    counted,
    display_name,
    display_unit,
    two_digits,
    value_and_uncertainty,
)

__all__ = ["comparison_parts", "parts_of"]

# Further modules with functions that make tables and sentences from results. The modules are
# imported only to register these functions with `parts_of`, `with_words` or `screen_of`.
_REGISTERED_MODULES = (
    campaign_text,
    goal_design_text,
    identifiability_text,
    import_text,
    machine_text,
    next_circle_text,
    screens,
)

# In the table of an uncertainty budget, a contribution has a row if its share of the variance is at
# least this value. One further row states the sum of all smaller contributions.
_SMALL_SHARE = 0.005
# The table of an uncertainty budget states the sum of all small contributions only if this sum is
# at least this fraction of the variance.
_NEGLIGIBLE_SHARE = 5e-4
# A table of budgets names a source of uncertainty if its share of the parameter's variance is at
# least this value.
_LARGE_SHARE = 0.05
# Largest number of sources of uncertainty that a table of budgets names for each parameter.
_MOST_SOURCES = 3


# ---- model and fit


@parts_of.register
def _passages_of_hybrid_model(model: HybridModel) -> tuple[Passage, ...]:
    """Return a table of a model's terms: effects other than compliances and geometric errors.

    Each row has the name and the settings of a term. The caption states the degree of compliance as
    a function of force, and whether the priors are flat.
    """
    prior = "proper"
    if model.prior.flat:
        prior = "flat"
    elif model.prior.truncated:
        prior = "proper, no compliance negative"
    rows = []
    for term in model.nuisances:
        settings = [_setting_words(name, value) for name, value in vars(term).items()]
        rows.append((type(term).__name__, ", ".join(settings)))
    if not rows:
        rows.append(("none", ""))
    caption = f"HybridModel: compliance {IN_FORCE[model.degree]}; priors {prior}; other effects"
    return (Table.of(caption, ("term", "settings"), rows, text=("settings",)),)


def _setting_words(name: str, value: Any) -> str:
    """Return a setting of a model term as a string, such as "sd_um = 0.2"."""
    if isinstance(value, str):
        return f"{name} = {value}"
    return f"{name} = {value:g}"


@parts_of.register
def _passages_of_log_density(density: LogDensity) -> tuple[Passage, ...]:
    """Return a table of the parameters and hyper-parameters on which a log density depends."""
    rows = []
    for name, unit, bounds in zip(density.names, density.units, density.bounds, strict=True):
        rows.append((display_name(name), unit, *bounds))
    heads = ("coordinate", "unit", "least", "greatest")
    return (Table.of(repr(density), heads, rows, text=("unit",)),)


@parts_of.register
def _passages_of_simulation(simulation: Simulation) -> tuple[Passage, ...]:
    """Return a table of the parameters and hyper-parameters with which readings were simulated.

    The hyper-parameters are quantities such as the standard deviation of the noise.
    """
    rows: list[tuple[Any, ...]] = []
    for name, value in simulation.parameters.items():
        factor, label = display_unit(simulation.units[name])
        rows.append((display_name(name), value * factor, label))
    for name, size in simulation.hyper_um.items():
        has_no_unit = name == "decay" or name.startswith("lambda_")
        rows.append((name, size, "" if has_no_unit else "µm"))
    campaign = simulation.campaign
    caption = f"Simulation of {campaign.name}, {counted(len(campaign.tests), 'test')}"
    return (Table.of(caption, ("true parameter", "value", "unit"), rows, text=("unit",)),)


@parts_of.register
def _passages_of_fit(fit: Fit) -> tuple[Passage, ...]:
    """Return sentences on whether a fit can be used, and on each concern about the fit."""
    # Leave out the concern "not-converged", because the sentence on whether the fit can be used
    # already states that the sampler has not converged.
    concerns = tuple(concern for concern in fit.concerns if concern.kind != "not-converged")
    return (wording.fit_verdict(fit), *wording.concern_sentences(concerns, {}))


@parts_of.register
def _passages_of_fit_words(words: FitWords) -> tuple[Passage, ...]:
    """Return a sentence on whether a fit can be used, and the list of warnings about the fit."""
    return (words["verdict"], tuple(words["warnings"]))


@parts_of.register
def _passages_of_least_squares(result: LeastSquares) -> tuple[Passage, ...]:
    """Return a table of the estimates of a fit by least squares, with standard uncertainties u."""
    rows = []
    for name, row in result.table.iterrows():
        factor, unit = display_unit(row["unit"])
        estimate, spread = value_and_uncertainty(row["estimate"] * factor, row["u"] * factor)
        rows.append((display_name(str(name)), estimate, spread, unit))
    caption = (
        f"Least squares (Eq. 31), RMSE {result.quality.rmse_um:.3g} µm; u from the scatter of the"
        " readings alone"
    )
    heads = ("parameter", "estimate", "u (1 sd)", "unit")
    return (Table.of(caption, heads, rows, text=("unit",)),)


# ---- results of simulation-based calibration, of workflow checks and of uncertainty budgets


@parts_of.register
def _passages_of_validation(validation: Validation) -> tuple[Passage, ...]:
    """Return a table of the percentage of credible intervals that contain the simulated true value.

    The table has one row for each quantity. Each row also states whether the ranks of the
    quantity's true values are uniformly distributed. A rank is the number of posterior draws below
    the true value. Two sentences follow. The first states the standard uncertainty of the
    percentages in the table. The second states whether the ranks of all quantities are uniformly
    distributed.
    """
    coverage = validation.coverage()
    intervals = [name for name in coverage.columns if not name.startswith("u")]
    rows = []
    for name, row in coverage.loc[list(validation.names)].iterrows():
        shares = [f"{100 * row[interval]:.1f}" for interval in intervals]
        ranks = "outside the band" if name in validation.outside else "inside"
        rows.append((display_name(str(name)), *shares, ranks))
    heads = ("quantity", *(f"in {interval} % interval (%)" for interval in intervals), "ranks")
    errors = [f"{100 * coverage[f'u{interval}'].iloc[0]:.1f} %" for interval in intervals]
    return (
        Table.of("", heads, rows, text=("ranks",)),
        "Standard uncertainty of these shares, from the number of replicates:"
        f" {wording.joined(errors)}.",
        wording.validation_verdict(validation),
    )


@parts_of.register
def _passages_of_workflow(workflow: Workflow) -> tuple[Passage, ...]:
    """Return a table of the circles, and a sentence on each check of a Bayesian workflow.

    The table has one row for each circle. Each row states the range of the readings [µm], the
    interval that the prior predicts for this range, and how well the other circles predict the
    readings.
    """
    rows = []
    for name, expected in workflow.prior_ranges.items():
        circle = workflow.left_out[name]
        rows.append(
            (
                name,
                f"{expected.measured_um:.1f}",
                f"{expected.low_um:.1f} … {expected.high_um:.1f}",
                wording.probability_words(circle.p_value),
                str(circle.worst_order),
            )
        )
    prior = f"range the prior expects, {100 * workflow.prior_prob:g} % (µm)"
    heads = ("test", "range (µm)", prior, "p-value given the others", "order of largest deviation")
    return (Table.of("Every circle", heads, rows), *wording.workflow_sentences(workflow))


@wording.with_words.register
def _record_of_workflow(result: Workflow) -> dict[str, Any]:
    """Return the JSON record of the checks of a workflow, with a sentence on each check."""
    return {
        **result.as_dict(),
        "passed": result.passed,
        "sentences": list(wording.workflow_sentences(result)),
    }


@wording.with_words.register
def _record_of_validation(result: Validation) -> dict[str, Any]:
    """Return the JSON record of a simulation-based calibration, with a sentence on the result."""
    return {**result.as_dict(), "verdict": wording.validation_verdict(result)}


@parts_of.register(ByName)
def _passages_of_results_by_name(results: ByName[Any]) -> tuple[Passage, ...]:
    """Return a table of uncertainty budgets, decisions on conformity, or changes with force.

    All ``results`` are of one of these three kinds. Their keys are names: budgets have the names of
    parameters, decisions have the names of quantities, and changes with force have the names of
    compliances. The table has one row for each result. If there are no results, a sentence says so.
    """
    if not results:
        return ("No results.",)
    if all(isinstance(result, ChangeWithForce) for result in results.values()):
        return (change_table({name: change.as_dict() for name, change in results.items()}),)
    if not all(isinstance(result, Budget) for result in results.values()):
        return (conformity_table({name: result.as_dict() for name, result in results.items()}),)
    rows = []
    for name, budget in results.items():
        factor, unit = display_unit(budget.unit)
        rows.append(
            (
                display_name(name),
                two_digits(budget.u, factor),
                unit,
                _largest_sources(budget),
                wording.remedy_words(budget),
                two_digits(budget.u_if_known, factor),
            )
        )
    heads = ("parameter", "u", "unit", "largest sources", "what would improve it most", "u then")
    return (Table.of("What limits every parameter", heads, rows, text=heads[2:5]),)


def _largest_sources(budget: Budget) -> str:
    """Return a string that names the largest sources of a parameter's variance.

    For each source, the string states its share of the variance [%]. It also states whether the
    standard uncertainty of the source was measured in the campaign, is stated by the user, or is
    assumed by the model.
    """
    shares = {}
    for contribution in budget.contributions:
        share = budget.share(contribution.term)
        if share >= _LARGE_SHARE:
            shares[contribution.term] = share
    terms = units.ranked(shares, shares.__getitem__)[:_MOST_SOURCES]
    texts = []
    for term in terms:
        origin = wording.origin_words(budget.origin_of(term))
        texts.append(f"{wording.source_words(term)} {100 * shares[term]:.0f} % ({origin})")
    return ", ".join(texts)


@parts_of.register
def _passages_of_stiffness(stiffness: DirectionalStiffness) -> tuple[Passage, ...]:
    """Return a table of the stiffnesses and directions in every plane at every force."""
    return (table_of(stiffness.table()),)


@parts_of.register
def _passages_of_change_with_force(change: ChangeWithForce) -> tuple[Passage, ...]:
    """Return a table and a sentence on the change of one compliance with force."""
    return change_parts(change.as_dict())


@parts_of.register
def _passages_of_budget(budget: Budget) -> tuple[Passage, ...]:
    """Return the table of one uncertainty budget. One row states the sum of small contributions."""
    factor, unit = display_unit(budget.unit)
    rows: list[tuple[str, ...]] = []
    small_share = 0.0
    for contribution in budget.contributions:
        if contribution.share >= _SMALL_SHARE:
            rows.append(_budget_row(contribution, factor))
        else:
            small_share += contribution.share
    if abs(small_share) >= _NEGLIGIBLE_SHARE:
        u_small = two_digits(max(small_share, 0.0) ** 0.5 * budget.u * factor)
        share = f"{100 * small_share:.1f} %"
        rows.append(("all smaller ones", "", "", "", "", "", u_small, share))
    rows.append(("together", "", "", "", "", "", two_digits(budget.u * factor), "100.0 %"))
    heads = (
        "source",
        "type",
        "origin",
        "its u",
        "its unit",
        f"sensitivity ({unit} per its unit)",
        f"contribution ({unit})",
        "share",
    )
    caption = f"Budget of {display_name(budget.parameter)}"
    return (Table.of(caption, heads, rows, text=("type", "origin", "its unit")),)


def _budget_row(contribution: Any, factor: float) -> tuple[str, ...]:
    """Return the cells of the row for one contribution to an uncertainty budget.

    ``factor`` converts the parameter from its internal unit (mm, N, rad) to the unit shown.
    """
    source = _budget_source(contribution)
    u = ""
    unit = ""
    if contribution.u is not None:
        u = two_digits(contribution.u * source.factor)
        unit = source.unit
    sensitivity = ""
    if contribution.sensitivity is not None:
        sensitivity = two_digits(contribution.sensitivity * factor / source.factor)
    return (
        source.words,
        contribution.kind,
        wording.origin_words(contribution.origin),
        u,
        unit,
        sensitivity,
        two_digits(contribution.contribution * factor),
        f"{100 * contribution.share:.1f} %",
    )


class _BudgetSource(NamedTuple):
    """Source of uncertainty in a budget: its name in words, and the unit of its uncertainty."""

    words: str
    #: factor from the internal unit of the source's uncertainty (mm, N, rad) to the unit shown
    factor: float
    unit: str


def _budget_source(contribution: Any) -> _BudgetSource:
    """Return the source of a contribution to an uncertainty budget, as the budget's table shows it.

    The result holds the name of the source in words, and the unit of its standard uncertainty.
    """
    term_words = wording.source_words(contribution.term)
    factor, label = wording.source_unit_words(
        contribution.source, contribution.term, contribution.unit
    )
    if contribution.source == contribution.term:
        return _BudgetSource(term_words, factor, label)
    words = wording.nuisance_words(contribution.source)
    if contribution.source.startswith("other "):
        words = f"other {term_words}"
    return _BudgetSource(words, factor, label)


@wording.with_words.register
def _record_of_budget(result: Budget) -> dict[str, Any]:
    """Return the JSON record of the uncertainty budget of a parameter.

    The record also states what would reduce the parameter's standard uncertainty most.
    """
    return {**result.as_dict(), "improve": wording.remedy_words(result)}


# ---- comparison of models


def comparison_parts(comparison: Comparison, *, rmse: bool = True) -> tuple[Passage, ...]:
    """Return the tables and sentences of a comparison of models.

    Parameters
    ----------
    comparison
        Comparison of models.
    rmse
        Whether the RMSE (root-mean-square residual) of every model is shown.

    Returns
    -------
    tuple
        Tables, followed by sentences.
    """
    slopes = []
    for name, slope in comparison.slopes.items():
        slopes.append((display_name(name), f"{slope.inclusion_probability:.2f}"))
    tables = (
        models_table(comparison, rmse=rmse),
        assumptions_table(comparison),
        Table.of("Slopes one by one", ("compliance", "varies with probability"), slopes),
        left_out_tests_table(comparison),
    )
    filled = [table for table in tables if table.rows]
    return (*filled, *wording.comparison_sentences(comparison))


@parts_of.register
def _passages_of_comparison(comparison: Comparison) -> tuple[Passage, ...]:
    """Return all tables and sentences of a comparison of models.

    The table of the models includes the RMSE (root-mean-square residual) of each model.
    """
    return comparison_parts(comparison)


@wording.with_words.register
def _record_of_comparison(result: Comparison) -> dict[str, Any]:
    """Return the JSON record of a comparison of models, with sentences that explain it."""
    sentences = wording.comparison_sentences(result)
    record = {name: value for name, value in result.as_dict().items() if value is not None}
    return {**record, "verdict": " ".join(sentences), "sentences": list(sentences)}


# ---- design of tests


@parts_of.register
def _passages_of_design(design: Design) -> tuple[Passage, ...]:
    """Return two tables and sentences on a design of tests.

    The first table lists the tests to run, the second states the expected uncertainties.
    """
    heads = [wording.PAGE["tests"].get(name, name) for name in ("force_N", *design.columns)]
    rows = []
    for row in design.table.to_numpy(dtype=object).tolist():
        rows.append([_design_cell(value) for value in row])
    tests = Table.of("Tests to run", [*heads, "circles"], rows)
    return (tests, _expected_table(design), *wording.design_sentences(design))


@wording.with_words.register
def _record_of_design(result: Design) -> dict[str, Any]:
    """Return the JSON record of a design of tests, with sentences and notes that explain it."""
    return {
        **result.as_dict(),
        "notes": list(wording.design_notes(result)),
        "sentences": list(wording.design_sentences(result)),
    }


def _design_cell(value: Any) -> str:
    """Return a cell of a design's table of tests as a string.

    A number is rounded to four significant digits.
    """
    return value if isinstance(value, str) else f"{value:.4g}"


def _expected_table(design: Design) -> Table:
    """Return a table of the expected standard uncertainty u of every parameter.

    One column states u after the recommended tests. Further columns state u after the tests of each
    other design, u after very many repetitions of the recommended tests, and the prior standard
    deviation.
    """
    rows = []
    for name, expected in design.expected.items():
        factor, unit = display_unit(expected.unit)
        label = display_name(name)
        if name not in design.parameters:
            label += " (other effect)"
        sds = [expected.sd]
        sds += [other.expected[name].sd for other in design.compared]
        sds += [expected.floor_sd, expected.prior_sd]
        rows.append([label, *(two_digits(sd, factor) for sd in sds), unit])
    heads = ["expected u", "recommended"]
    heads += [other.name for other in design.compared]
    heads += ["no less than", "prior", "unit"]
    return Table.of(wording.PAGE["expected"], heads, rows, text=("unit",))
