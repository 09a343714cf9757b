"""Functions that yield the sections of the annex from the results of a fit.

The annex is the part of the report that follows the test certificate. Each section consists of
paragraphs, lists, tables and figures.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Any, TypeAlias

import numpy as np
import pandas as pd

from ldbb_bayes.analysis.aliases import degeneracies
from ldbb_bayes.analysis.budgets import Budget
from ldbb_bayes.analysis.circle_columns import squareness_name
from ldbb_bayes.analysis.circularity import BIDIRECTIONAL, QUANTITIES
from ldbb_bayes.analysis.common_effects import Shared
from ldbb_bayes.analysis.comparison import Comparison
from ldbb_bayes.analysis.cures import cures
from ldbb_bayes.analysis.design import Design
from ldbb_bayes.analysis.machine_description import describe_machine
from ldbb_bayes.analysis.verdicts import not_modelled
from ldbb_bayes.inference.posterior import bound_of, campaign_of, fit_of, record_of
from ldbb_bayes.machine.chain import LINEAR
from ldbb_bayes.model.terms import BallForm
from ldbb_bayes.report import fit_tables, text, wording
from ldbb_bayes.report.findings import Findings, FurtherCampaign
from ldbb_bayes.report.fit_description import further_remarks
from ldbb_bayes.report.pictures import Picture, picture
from ldbb_bayes.report.text import parts_of
from ldbb_bayes.results import ByName, Passage, Table
from ldbb_bayes.units import (
    display_name,
    display_unit,
    is_slope,
    ranked,
    round_like,
    round_uncertainty,
    state,
    stated_decimals,
    two_digits,
)

__all__ = ["SECTIONS", "Details", "Part", "Section", "beside"]

_MOST_FORCES = 12  # largest number of forces (rows) in a table of circular-test quantities
_WORDS_OF_QUANTITIES = {"scale_mismatch": "scale mismatch", "G_b": "G(b)"}


@dataclass(frozen=True)
class Details:
    """Content of the HTML page that is hidden on the screen until the reader opens it.

    Parameters
    ----------
    summary
        Heading, which the screen always shows.
    content
        Tables, lists and sentences below the heading.
    """

    summary: str
    content: tuple[Passage, ...]


Part: TypeAlias = Passage | Picture | Details
"""One part of a section of the HTML page: a paragraph, list, table, figure, or hidden details.

A paragraph of several lines is shown as code.
"""


@dataclass(frozen=True)
class Section:
    """A section of the HTML page: its anchor (id), heading and content."""

    key: str
    title: str
    content: tuple[Part, ...]


def campaign(findings: Findings) -> Iterator[Part]:
    """Yield the section on the campaign: a table of tests, remarks, and what a fit assumes."""
    yield from parts_of(findings.preview)


def results(findings: Findings) -> Iterator[Part]:
    """Yield the section on the estimated parameters and on other effects, such as ball form."""
    yield wording.model_words(findings.result["model"])
    yield wording.PAGE["results"].format(percent=wording.percent_of(findings.result))
    yield fit_tables.results_table(
        findings.result, findings.verdicts_of_fit, shares=False, result_of_U=findings.result_of_U
    )
    yield picture("forest", findings.posterior)
    if len(bound_of(findings.posterior_of_certificate).setting.tested_planes) == len(LINEAR):
        yield picture("compliance_ellipsoid", findings.posterior_of_certificate)
    coefficients = fit_tables.coefficient_table(
        findings.result, findings.verdicts_of_fit, result_of_U=findings.result_of_U
    )
    if coefficients.rows:
        yield Details(wording.PAGE["coefficients_hint"], (coefficients,))
    nuisances = fit_tables.nuisance_table(findings.result["nuisances"])
    yield Details("What the fit says of other effects", (nuisances,))
    tests = campaign_of(findings.posterior)
    description = describe_machine(tests.machine(), [test.circle for test in tests.tests])
    yield Details("What the parameters are", parts_of(description))


def limits(findings: Findings) -> Iterator[Part]:
    """Yield the section on degeneracies, and on tests or calibrations that would resolve them.

    A degeneracy is a combination of parameters and other effects that the readings cannot separate.
    The section also names the effects that the user has switched off in the model. The verdicts on
    single parameters are in the section on results.
    """
    bound = bound_of(findings.posterior)
    alike = degeneracies(bound)
    cures_of_alike = cures(bound, alike)
    items = wording.degeneracy_items(alike, cures_of_alike)
    if items:
        yield wording.TO_SEPARATE
        yield wording.cure_items(alike, cures_of_alike)
        yield Details(wording.PAGE["alike_hint"], (wording.ALIKE, items))
    else:
        yield wording.NONE_ALIKE
    yield from wording.not_modelled_sentences(not_modelled(bound))


def degree(findings: Findings) -> Iterator[Part]:
    """Yield the section on whether compliance changes with force.

    The section states the evidence for each model, and how the evidence depends on assumptions. If
    the comparison of models includes them, two further results follow. One is the probability that
    each slope (change of a compliance with force) differs from zero. The other compares each test
    with a prediction made from the other tests.
    """
    comparison = findings.comparison
    if not isinstance(comparison, Comparison):
        yield f"The models were not compared: {comparison}"
        return
    # Leave out the RMSE (root-mean-square residual) of the models. The section on the quality of
    # the fit also states an RMSE, but from other random draws, so that the two numbers would differ
    # slightly.
    yield from text.comparison_parts(comparison, rmse=False)
    yield picture("evidence", comparison)
    if not comparison.local_fits.empty:
        yield picture("compliance_with_local_fits", comparison)


def uncertainty(findings: Findings) -> Iterator[Part]:
    """Yield the section on uncertainty budgets.

    The section also states what would reduce each uncertainty most. A table and a figure of the
    largest sources of uncertainty are always visible. The budget of each parameter is hidden until
    the reader opens it, and so are the budgets of slopes (changes of compliances with force).
    """
    budgets = ByName[Budget]()
    of_slopes = ByName[Budget]()
    for name, budget in findings.budgets.items():
        kind = of_slopes if is_slope(name) else budgets
        kind[name] = budget
    yield wording.PAGE["budget"]
    if findings.averaged is not None:
        yield wording.PAGE["budget_of_average"]
    yield from parts_of(budgets)
    yield picture("budget", budgets)
    for name, budget in budgets.items():
        factor, unit = display_unit(budget.unit)
        heading = f"{display_name(name)}: u = {two_digits(budget.u, factor)} {unit}"
        yield Details(heading, parts_of(budget))
    if of_slopes:
        yield Details(wording.PAGE["coefficients_budget_hint"], parts_of(of_slopes))


def path(findings: Findings) -> Iterator[Part]:
    """Yield the section on the tool path, with circular-test quantities as functions of force."""
    bound = bound_of(findings.posterior)
    planes = list(dict.fromkeys(findings.circularity["plane"]))
    squarenesses = [display_name(squareness_name(bound, plane)) for plane in planes]
    whose = "path_of_machine"
    if BallForm.__name__ not in bound.terms:
        whose = "path_with_balls"
    quantities = wording.PAGE["path"].format(squareness=wording.joined(squarenesses))
    of_path = wording.PAGE[whose].format(percent=wording.percent_of(findings.result))
    yield f"{quantities} {of_path}"
    for plane in planes:
        table = findings.circularity[findings.circularity["plane"] == plane]
        where = f", plane {plane}" if len(planes) > 1 else ""
        radius_mm = table["radius_mm"].iloc[0]
        caption = f"The machine's path{where} (R = {radius_mm:g} mm)"
        yield _quantities_table(table, QUANTITIES, caption)
        if table["quantity"].isin(list(BIDIRECTIONAL)).any():
            caption = (
                f"Both directions{where}: bidirectional deviation G(b), mean radial deviation D,"
                " hysteresis included"
            )
            yield _quantities_table(table, BIDIRECTIONAL, caption)
    for key in ("circularity", "contributions", "parameter_contributions"):
        yield picture(key, findings.posterior)


def _quantities_table(table: pd.DataFrame, quantities: Mapping[str, str], caption: str) -> Table:
    """Return a table of circular-test quantities with credible intervals, one row for each force.

    ``table`` holds the quantities at all forces. ``quantities`` is a mapping from the names of the
    quantities that are shown to their units. If there are more than 12 forces, only 12 of them have
    a row.
    """
    row_by_force = {(row["force_N"], row["quantity"]): row for _, row in table.iterrows()}
    rows = []
    for force in _shown_forces(list(dict.fromkeys(table["force_N"]))):
        cells = [f"{force:.4g} N"]
        cells += [_interval_cell(row_by_force[force, quantity]) for quantity in quantities]
        rows.append(tuple(cells))
    heads = ["force"]
    for name, unit in quantities.items():
        heads.append(f"{_WORDS_OF_QUANTITIES.get(name, name)} ({unit})")
    return Table.of(caption, tuple(heads), rows)


def _shown_forces(forces: Sequence[float]) -> list[float]:
    """Return the forces [N] that have a row in a table: at most 12 of the given ``forces``.

    If more than 12 forces are given, 12 of them are chosen evenly, including the first and the
    last.
    """
    if len(forces) <= _MOST_FORCES:
        return list(forces)
    chosen = np.linspace(0, len(forces) - 1, _MOST_FORCES).round().astype(int)
    return [forces[index] for index in chosen]


def _interval_cell(row: pd.Series[Any]) -> str:
    """Return a median and a credible interval as a string, such as "17.2 [11.5, 39.8]".

    ``row`` holds the entries ``median``, ``sd``, ``ci_low`` and ``ci_high`` of one quantity. The
    numbers are rounded to a decimal place that depends on ``sd``.
    """
    _, decimals = round_uncertainty(row["sd"])
    median = round_like(row["median"], decimals)
    low = round_like(row["ci_low"], decimals)
    high = round_like(row["ci_high"], decimals)
    return f"{median} [{low}, {high}]"


def plan(findings: Findings) -> Iterator[Part]:
    """Yield the section on the tests to run next and on the uncertainties expected afterwards."""
    design = findings.design
    if not isinstance(design, Design):
        yield f"No tests are recommended: {design}"
        return
    yield from parts_of(design)
    today = {name: entry["sd"] for name, entry in findings.result["parameters"].items()}
    yield picture("expected_widths", design, today=today)


def fit(findings: Findings) -> Iterator[Part]:
    """Yield the section on the quality of the fit.

    The section states the RMSE (root-mean-square residual) of the fit. For each test, the section
    states the fitness and the p-values of posterior predictive checks. The fitness of a test is 100
    % · (1 − RMSE / range), where "range" is the range of its readings (Eq. 35 of the article on
    which the model is based).
    """
    quality = findings.result["fit"]
    rows = []
    for test in findings.preview.tests:
        checks = quality["predictive_checks"][test.name]
        order, smallest_p = ranked(checks["orders_p"].items(), lambda item: -item[1])[0]
        rows.append(
            (
                test.name,
                f"{test.force_N:.4g}",
                f"{quality['fitness_percent'][test.name]:.1f}",
                f"{wording.p_value_digits(smallest_p)} (order {order})",
                _p_value_cell(checks["noise_p"]),
                _autocorrelation_cell(checks["autocorrelation"]),
                _p_value_cell(checks["autocorrelation_p"]),
            )
        )
    heads = (
        "test",
        "force (N)",
        "fitness (%)",
        "smallest p by order",
        "p, white noise",
        "autocorrelation (1)",
        "p, autocorrelation",
    )
    caption = (
        "Fitness (Eq. 35) and posterior predictive checks: small p where the model does not expect"
        " the reading"
    )
    yield wording.quality_words(quality)
    yield Table.of(caption, heads, rows)
    concerns = wording.concern_sentences(
        fit_of(findings.posterior).concerns, findings.result["sampler"]
    )
    notes = (*concerns, *further_remarks(findings.preview))
    if notes:
        yield notes
    yield picture("residuals", findings.posterior)


def _p_value_cell(value: float | None) -> str | None:
    """Return a p-value as a string with two significant digits, or None if ``value`` is None."""
    return None if value is None else wording.p_value_digits(value)


def _autocorrelation_cell(value: float | None) -> str | None:
    """Return an autocorrelation with two significant digits, or None if ``value`` is None."""
    return None if value is None else f"{value:.2g}"


def assumptions(findings: Findings) -> Iterator[Part]:
    """Yield the section on the assumptions of the fit.

    The section has a table with the prior and the posterior of every parameter, and the model as
    text in TOML format.
    """
    yield fit_tables.parameter_table(findings.result, coefficients=True)
    toml = record_of(findings.posterior)["model"]["toml"]
    yield Details("The whole model as TOML (edit and fit again with --model)", (toml,))


def diagnostics(findings: Findings) -> Iterator[Part]:
    """Yield the section on the sampling of the posterior, with diagnostics of each parameter.

    The diagnostics are effective sample sizes, R-hat and sensitivity to the prior.
    """
    sensitivity = record_of(findings.posterior)["fit"]["sensitivity"]
    yield wording.sampler_words(findings.result["sampler"])
    rows = []
    for name, row in findings.summary.to_dict(orient="index").items():
        to_prior = ""
        if name in sensitivity:
            to_prior = f"{sensitivity[name]['prior']:.3f}"
        rows.append(
            (
                display_name(str(name)),
                f"{row['ess_bulk']:.0f}",
                f"{row['ess_tail']:.0f}",
                f"{row['rhat']:.4f}",
                to_prior,
            )
        )
    yield Table.of(
        "By parameter; above 0.05 a number moves when its prior's scale does (power scaling)",
        ("parameter", "ESS bulk", "ESS tail", "R-hat", "sensitivity to the prior (1)"),
        rows,
    )


def method(findings: Findings) -> Iterator[Part]:
    """Yield the section that summarises the method and states the provenance of the fit.

    The provenance consists of the SHA-256 digests of the readings and of the model, the versions of
    the programs, and the seed of the random numbers.
    """
    result = findings.result
    provenance = result["provenance"]
    versions = [f"{name} {version}" for name, version in provenance["versions"].items()]
    yield wording.method_sentences(bound_of(findings.posterior))
    rows = (
        ("campaign", result["campaign"]["name"]),
        ("readings, SHA-256", result["campaign"]["sha256"]),
        ("model, SHA-256", result["model"]["sha256"]),
        ("sampler and seed", f"{result['sampler']['kind']}, {provenance['seed']}"),
        ("fitted", f"{provenance['started']}, {provenance['platform']}"),
        ("versions", ", ".join(versions)),
    )
    yield Table.of("Provenance", ("what", "value"), rows, text=("value",))


def glossary(findings: Findings) -> Iterator[Part]:
    """Yield the glossary: every technical term with its meaning in one line."""
    catalogue = files("ldbb_bayes.report") / "templates" / "glossary.toml"
    meanings = tomllib.loads(catalogue.read_text(encoding="utf-8"))
    yield Table.of("Terms", ("term", "meaning"), list(meanings.items()), text=("meaning",))


def beside(
    first: Mapping[str, Any],
    others: Sequence[FurtherCampaign],
    shared: Shared,
    *,
    prob: float,
) -> Iterator[Part]:
    """Yield the section on the differences between the first campaign and other campaigns.

    For every parameter the section states the difference, its credible interval, and the
    probability that the parameter is larger in the other campaign. The differences of slopes
    (changes of compliances with force) are hidden until the reader opens them.

    Parameters
    ----------
    first
        Results of the fit of the first campaign, as the command ``fit --json`` prints them.
    others
        The other campaigns.
    shared
        What the other campaigns have in common with the first campaign.
    prob
        Probability of the credible intervals.

    Yields
    ------
    str, tuple of str, or Table
    """
    name = str(first["campaign"]["name"])
    yield wording.common_words(first["model"]["reference_force_N"], shared)
    yield tuple(
        wording.change_sentence(
            name, other.name, other.differences, prob, of_U=other.differences_of_U
        )
        for other in others
    )
    percent = f"{100 * prob:g} %"
    for other in others:
        is_of_slope = other.differences.index.map(is_slope).to_numpy(dtype=bool)
        yield _differences_table(name, other, other.differences[~is_of_slope], percent)
        if is_of_slope.any():
            coefficients = _differences_table(name, other, other.differences[is_of_slope], percent)
            yield Details(wording.PAGE["coefficients_differences_hint"], (coefficients,))


def _differences_table(
    first: str, other: FurtherCampaign, differences: pd.DataFrame, percent: str
) -> Table:
    """Return a table that compares the parameters of two campaigns, one row for each parameter.

    Each row states the values of the parameter in both campaigns, the difference with its credible
    interval, and the probability that the parameter is larger in the second campaign. Both values
    and the difference have the decimals of U (k = 2), as on the sheet. ``first`` is the name of the
    first campaign. ``percent`` is the probability of the intervals as a string, such as "95 %".
    """
    rows = []
    differences_of_U = other.differences_of_U.loc[differences.index]
    for (parameter, row), (_, of_U) in zip(
        differences.iterrows(), differences_of_U.iterrows(), strict=True
    ):
        interval = (row["ci_low"], row["ci_high"])
        difference = state(row["difference"], row["sd"], interval, row["unit"])
        interval_of_U = (of_U["ci_low"], of_U["ci_high"])
        decimals = stated_decimals(row["difference"], row["sd"], interval_of_U, row["unit"])
        factor, _ = display_unit(row["unit"])
        rows.append(
            (
                display_name(str(parameter)),
                round_like(row["first"] * factor, decimals),
                round_like(row["second"] * factor, decimals),
                round_like(row["difference"] * factor, decimals),
                difference.u,
                difference.interval,
                difference.unit,
                wording.probability_words(row["probability_of_increase"]),
            )
        )
    heads = (
        "parameter",
        "first",
        "second",
        "difference",
        "u",
        f"{percent} interval",
        "unit",
        "P(second > first)",
    )
    digest = other.result["campaign"]["sha256"]
    caption = f"Second: {other.name} (readings, SHA-256 {digest}); first: {first}"
    return Table.of(caption, heads, rows, text=("unit",))


_SECTION_WRITERS = (
    campaign,
    results,
    limits,
    degree,
    uncertainty,
    path,
    plan,
    fit,
    assumptions,
    diagnostics,
    method,
    glossary,
)
#: Sections of the annex (the part of a report after the certificate), in the order of the page.
#: Each key is the anchor (id) of a section. The value is a pair: the title of the section, and the
#: function that yields its content.
SECTIONS: Mapping[str, tuple[str, Callable[[Findings], Iterator[Part]]]] = {
    write.__name__: (wording.PAGE["sections"][write.__name__], write) for write in _SECTION_WRITERS
}
