"""The machine's path: circular-test quantities of ISO 230-4, and what compliance and geometry contribute to it."""

from __future__ import annotations

import pandas as pd

from ldbb_bayes.analysis.circularity import BIDIRECTIONAL, QUANTITIES, squareness_name
from ldbb_bayes.analysis.contributions import COMPLIANCE, GEOMETRY, TOGETHER
from ldbb_bayes.inference.origin import bound_of
from ldbb_bayes.model.wording import joined
from ldbb_bayes.report.document import Paragraph, Part, Picture, Section, Sheet, sheet
from ldbb_bayes.report.figures.circularity import circularity
from ldbb_bayes.report.figures.contributions import contributions, parameter_contributions
from ldbb_bayes.report.findings import Findings
from ldbb_bayes.report.rounding import round_like, round_uncertainty
from ldbb_bayes.units import display_name

__all__ = ["path"]

_HEADS = {
    "G": "G (µm)",
    "G_minimum_zone": "G, minimum zone (µm)",
    "F_max": "F_max (µm)",
    "F_min": "F_min (µm)",
    "squareness": "squareness (µm/m)",
    "scale_mismatch": "scale mismatch (µm/m)",
    "G_b": "G(b) (µm)",
    "G_b_minimum_zone": "G(b), minimum zone (µm)",
    "D": "D (µm)",
}
_FEW = 12


def path(found: Findings) -> Section:
    """Per force and as a function of force."""
    percent = f"{100 * found.ci_prob:g} %"
    planes = list(dict.fromkeys(found.path["plane"]))
    bound = bound_of(found.posterior)
    squares = joined([display_name(squareness_name(bound, plane)) for plane in planes])
    parts: list[Part] = [
        Paragraph(
            "Circular deviation G, radial deviations F_max and F_min about the least-squares circle (ISO 230-4), and from the "
            f"second harmonic squareness (in the sense and sign of {squares}) and scale mismatch (gain of the first axis less "
            "that of the second), as a circle shows them: under load compliance is in them. Of the machine's own path, "
            f"without balls, bar, mount and tool offsets: median and {percent} interval; 0 N is geometry alone. G is a largest "
            "difference: where the path is hardly known it is more often too large than too small."
        )
    ]
    for plane in planes:
        own = found.path[found.path["plane"] == plane]
        where = f", plane {plane}" if len(planes) > 1 else ""
        parts.append(_quantities(own, list(QUANTITIES), f"The machine's path{where} (R = {own['radius_mm'].iloc[0]:g} mm)"))
        if own["quantity"].isin(list(BIDIRECTIONAL)).any():
            caption = f"Both directions{where}: bidirectional deviation G(b), mean radial deviation D, hysteresis included"
            parts.append(_quantities(own, list(BIDIRECTIONAL), caption))
    parts.append(_measured(found.measured, "The readings themselves, balls, bar and mount included; no uncertainty"))
    if len(found.pairs):
        rows = [
            [str(name), f"{row['force_N']:.4g}", *(f"{row[quantity]:.2f}" for quantity in BIDIRECTIONAL)]
            for name, row in found.pairs.iterrows()
        ]
        parts.append(sheet("Pairs of readings", ["tests", "force (N)", *(_HEADS[q] for q in BIDIRECTIONAL)], rows))
    parts += [
        Picture(
            "circularity",
            "Circular deviation, radial deviation, squareness and scale mismatch against force",
            "Circular-test quantities as functions of force.",
            circularity(found.posterior),
        ),
        *(_contributions(found.contributions, plane, percent, len(planes) > 1) for plane in planes),
        Picture(
            "contributions",
            "Contribution of compliance and geometry to the reading at every force",
            "What compliance and geometry contribute (Fig. 8 of the paper), tool offsets left out.",
            contributions(found.posterior),
        ),
        Picture(
            "parameter_contributions",
            "Contribution of every parameter to the reading at the highest force",
            "What every parameter contributes (Figs. 9 and 10 of the paper).",
            parameter_contributions(found.posterior),
        ),
    ]
    return Section("path", "Circular-test quantities", tuple(parts))


def _quantities(table: pd.DataFrame, quantities: list[str], caption: str) -> Sheet:
    forces = list(dict.fromkeys(table["force_N"]))
    shown = forces if len(forces) <= _FEW else [*forces[:: len(forces) // (_FEW - 2)], forces[-1]]
    rows = [[f"{force:.4g} N", *(_cell(table, force, quantity) for quantity in quantities)] for force in dict.fromkeys(shown)]
    return sheet(caption, ["force", *(_HEADS[quantity] for quantity in quantities)], rows)


def _cell(table: pd.DataFrame, force: float, quantity: str) -> str:
    row = table[(table["force_N"] == force) & (table["quantity"] == quantity)].iloc[0]
    _, decimals = round_uncertainty(row["sd"])
    middle, low, high = (round_like(row[key], decimals) for key in ("median", "ci_low", "ci_high"))
    return f"{middle} [{low}, {high}]".replace("-", "−")


def _measured(table: pd.DataFrame, caption: str) -> Sheet:
    def number(value: float) -> str:
        return "–" if value != value else f"{value:.2f}".replace("-", "−")

    places = [field for field in ("plane", "radius_mm") if table[field].nunique() > 1]
    rows = [
        [
            str(name),
            *(f"{row[field]}".removesuffix(".0") for field in places),
            f"{row['force_N']:.4g}",
            row["direction"] or "–",
            *(number(row[quantity]) for quantity in QUANTITIES),
        ]
        for name, row in table.iterrows()
    ]
    heads = ["test", *({"plane": "plane", "radius_mm": "R (mm)"}[field] for field in places), "force (N)", "travel"]
    return sheet(caption, [*heads, *(_HEADS[quantity] for quantity in QUANTITIES)], rows, text=(len(heads) - 1,))


def _contributions(table: pd.DataFrame, plane: str, percent: str, several: bool) -> Sheet:
    own = table[table["plane"] == plane]
    rows = []
    for _, row in own.iterrows():
        _, decimals = round_uncertainty(row["sd"])
        numbers = [round_like(row[key], max(decimals, 1)) for key in ("maximum", "minimum", "median", "ci_low", "ci_high")]
        most, least, size, low, high = (text.replace("-", "−") for text in numbers)
        source = row["source"] if row["source"] in (TOGETHER, COMPLIANCE, GEOMETRY) else display_name(row["source"])
        rows.append([source, most, least, size, f"[{low}, {high}]"])
    where = f", plane {plane}" if several else ""
    caption = (
        f"Contributions to the reading at {own['force_N'].iloc[0]:.4g} N{where}, a compliance with its slope. Largest and "
        "smallest: of the mean path; peak to peak: median over what is likely, which does not shrink for not being known"
    )
    heads = ["source", "largest (µm)", "smallest (µm)", "peak to peak (µm)", f"{percent} interval of it (µm)"]
    return sheet(caption, heads, rows)
