"""Recommended next tests."""

from __future__ import annotations

import numpy as np

from ldbb_bayes.analysis.designed import Design
from ldbb_bayes.report.document import Bullets, Paragraph, Picture, Section, Sheet, sheet
from ldbb_bayes.report.figures.design import expected_widths, information
from ldbb_bayes.report.findings import Findings
from ldbb_bayes.report.rounding import round_uncertainty
from ldbb_bayes.units import display_name, display_unit

__all__ = ["plan"]


def plan(found: Findings) -> Section:
    """Which circles to run instead of these, and what they would tell."""
    title = "Recommended next tests"
    chosen = found.design
    if not isinstance(chosen, Design):
        return Section("plan", title, (Paragraph(f"No tests are recommended: {chosen}"),))
    return Section(
        "plan",
        title,
        (
            Paragraph(
                "A campaign of as many circles as asked for, from the forces of this one, that tells most about all "
                "compliances and geometric errors together (expected information gain). ldbb-bayes design has other goals: "
                "clockings, radii, directions, costs, adding to the tests already run."
            ),
            Bullets(tuple(said for said in chosen.sentences() if "looks exactly like" not in said)),
            _expected(chosen, found),
            Picture(
                "information",
                "How much a circle tells at every force, and the circles recommended",
                "Where a circle tells most, and the circles recommended.",
                information(chosen),
            ),
            Picture(
                "expected_widths",
                "Expected uncertainty of every parameter",
                "Expected uncertainties beside those of equal steps of force.",
                expected_widths(chosen),
            ),
        ),
    )


def _expected(chosen: Design, found: Findings) -> Sheet:
    baseline = chosen.baseline.forecast.expected
    now = {name: entry["sd"] for name, entry in found.result["parameters"].items()}
    rows = []
    for name, entry in chosen.forecast.expected.items():
        factor, unit = display_unit(entry.unit)
        values = (now.get(name, np.nan), entry.sd, baseline[name].sd, entry.floor_sd, entry.prior_sd)
        cells = [round_uncertainty(value * factor)[0] if np.isfinite(value) else "–" for value in values]
        rows.append([display_name(name), *cells, unit])
    heads = ["parameter", "u now", "expected u", chosen.baseline.name, "no less than", "prior", "unit"]
    degree = ("constant", "linear", "quadratic")[chosen.model.degree]
    caption = (
        f"Standard uncertainties, {degree} compliance: of this campaign, and expected of the circles recommended in its place "
        "(averaged over readings not yet taken); no less than: what a million circles would leave"
    )
    return sheet(caption, heads, rows, text=(6,))
