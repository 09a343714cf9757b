"""Recommended next tests."""

from __future__ import annotations

import numpy as np

from ldbb_bayes.analysis.designed import Design
from ldbb_bayes.analysis.recorded import RecordedDesign, recorded
from ldbb_bayes.report.document import Bullets, Paragraph, Part, Picture, Section, Sheet, sheet
from ldbb_bayes.report.figures.design import information
from ldbb_bayes.report.findings import Findings
from ldbb_bayes.report.rounding import round_uncertainty
from ldbb_bayes.units import display_name, display_unit

__all__ = ["plan"]

_AS_ASKED = "As ldbb-bayes design found it."
_AS_WORKED_OUT = (
    "As many circles in place of this campaign, of the forces between its lowest and highest, that tell most about all "
    "compliances and geometric errors together (criterion eig, expected information gain: a single interval may be wider). "
    "ldbb-bayes design has other goals: clockings, radii, directions, costs, adding to the tests already run; its result "
    "comes here with --design DIR."
)


def plan(found: Findings) -> Section:
    """Which circles to run instead of these, and what they would tell."""
    title = "Recommended next tests"
    chosen = found.design
    if isinstance(chosen, str):
        return Section("plan", title, (Paragraph(f"No tests are recommended: {chosen}"),))
    told = recorded(chosen) if isinstance(chosen, Design) else chosen
    parts: list[Part] = [
        Paragraph(_AS_ASKED if found.design_given else _AS_WORKED_OUT),
        Bullets(tuple(said for said in told.sentences if "looks exactly like" not in said)),
        _expected(told, found),
    ]
    if isinstance(chosen, Design):
        parts += [
            Picture(
                "information",
                "How much a circle tells at every force, and the circles recommended",
                "Where a circle tells most, and the circles recommended.",
                information(chosen),
            ),
        ]
    return Section("plan", title, tuple(parts))


def _expected(told: RecordedDesign, found: Findings) -> Sheet:
    now = {name: entry["sd"] for name, entry in found.result["parameters"].items()}
    rows = []
    for name, entry in told.expected.items():
        factor, unit = display_unit(entry.unit)
        values = (now.get(name, np.nan), entry.sd, told.baseline[name].sd, entry.floor_sd, entry.prior_sd)
        cells = [round_uncertainty(value * factor)[0] if np.isfinite(value) else "–" for value in values]
        rows.append([display_name(name), *cells, unit])
    heads = ["parameter", "u now", "expected u", told.baseline_name, "no less than", "prior", "unit"]
    degree = ("constant", "linear", "quadratic")[told.degree]
    where = "added to it" if told.augment else "in its place"
    caption = (
        f"Standard uncertainties, {degree} compliance: of this campaign, and expected of the circles recommended {where} "
        "(averaged over readings not yet taken); no less than: what a million circles would leave"
    )
    return sheet(caption, heads, rows, text=(6,))
