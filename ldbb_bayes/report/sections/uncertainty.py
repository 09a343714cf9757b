"""The uncertainty budget of every parameter in the form of the GUM."""

from __future__ import annotations

import pandas as pd

from ldbb_bayes.analysis.budget import Budget, Contribution
from ldbb_bayes.model.information import NOISE, OWN
from ldbb_bayes.model.wording import nuisance_words, unit_words
from ldbb_bayes.report.document import Details, Paragraph, Picture, Section, Sheet, sheet
from ldbb_bayes.report.figures.budget import budget_bars, source_words
from ldbb_bayes.report.findings import Findings
from ldbb_bayes.report.rounding import round_uncertainty
from ldbb_bayes.units import display_name, display_unit

__all__ = ["budget_frame", "uncertainty"]

_SMALL = 0.005
_RUNNERS = 0.05


def uncertainty(found: Findings) -> Section:
    """What each uncertainty is made of, and what would improve it most."""
    return Section(
        "uncertainty",
        "Uncertainty budget",
        (
            Paragraph(
                "Contributions are independent and come from the model in one go; shares are of the posterior variance and "
                "sum to one. Type A: evaluated from the scatter of the readings; type B: from what else is known. "
                "Sensitivity: change of the estimate per unit of the source, with all other sources at work. The last column "
                "of the first table is the standard uncertainty that would be left if the largest term were known exactly: "
                "less than its share alone leaves, where knowing it lets the readings say more of the others; – where the "
                "largest is noise or a prior, which nothing makes known."
            ),
            _overview(found),
            Picture(
                "budget",
                "Share of every source of uncertainty in the variance of every parameter",
                "Uncertainty budgets.",
                budget_bars(found.budgets),
            ),
            *(Details(_line(budget), (_budget(budget),)) for budget in found.budgets.values()),
        ),
    )


def _overview(found: Findings) -> Sheet:
    rows = []
    for name, budget in found.budgets.items():
        factor, unit = display_unit(budget.unit)
        terms = {line.term: budget.share(line.term) for line in budget.contributions}
        heavy = sorted((term for term in terms if terms[term] >= _RUNNERS), key=lambda term: -terms[term])[:3]
        told = ", ".join(f"{source_words(term)} {100 * terms[term]:.0f} %" for term in heavy)
        left = "–" if budget.u_if_known is None else round_uncertainty(budget.u_if_known * factor)[0]
        rows.append([display_name(name), round_uncertainty(budget.u * factor)[0], unit, told, budget.improve, left])
    heads = ["parameter", "u", "unit", "largest sources", "what would improve it most", "u then"]
    return sheet("What limits every parameter", heads, rows, text=(2, 3, 4))


def _line(budget: Budget) -> str:
    factor, unit = display_unit(budget.unit)
    return f"{display_name(budget.parameter)}: u = {round_uncertainty(budget.u * factor)[0]} {unit}"


def _budget(budget: Budget) -> Sheet:
    factor, unit = display_unit(budget.unit)
    rows, small = [], 0.0
    for line in budget.contributions:
        if line.share < _SMALL:
            small += line.share
            continue
        own, own_unit = _own(line)
        rows.append(
            [
                _source(line),
                line.kind,
                "" if line.u is None else _two(line.u * own),
                own_unit if line.u is not None else "",
                "" if line.sensitivity is None else _two(line.sensitivity * factor / own),
                _two(line.contribution * factor),
                f"{100 * line.share:.1f} %",
            ]
        )
    if abs(small) >= 5e-4:
        rows.append(
            ["all smaller ones", "", "", "", "", _two(max(small, 0.0) ** 0.5 * budget.u * factor), f"{100 * small:.1f} %"]
        )
    rows.append(["together", "", "", "", "", _two(budget.u * factor), "100.0 %"])
    heads = ["source", "type", "its u", "its unit", f"sensitivity ({unit} per its unit)", f"contribution ({unit})", "share"]
    return sheet(f"Budget of {display_name(budget.parameter)}", heads, rows, text=(1, 3))


def _source(line: Contribution) -> str:
    if line.source.startswith("other "):
        return f"other {source_words(line.term)}"
    return source_words(line.term) if line.source == line.term else nuisance_words(line.source)


def _own(line: Contribution) -> tuple[float, str]:
    """Factor and label that the source's own uncertainty is read in."""
    if line.source == line.term:
        return (1.0, "N") if line.unit == "N" else (1e3, "µm")
    one, label = unit_words(line.source)
    return 1.0 / one, label


def _two(value: float) -> str:
    """Two significant digits without an exponent."""
    return f"{'−' if value < 0 else ''}{round_uncertainty(abs(value))[0]}"


def budget_frame(found: Findings) -> pd.DataFrame:
    """Every line of every budget for files; inside units."""
    rows = [
        {
            "parameter": name,
            "unit": budget.unit,
            "source": line.source,
            "term": {NOISE: "ReadingNoise", OWN: "Parameters"}.get(line.term, line.term),
            "type": line.kind,
            "u": line.u,
            "u_unit": line.unit,
            "sensitivity": line.sensitivity,
            "contribution": line.contribution,
            "share": line.share,
        }
        for name, budget in found.budgets.items()
        for line in budget.contributions
    ]
    return pd.DataFrame(rows)
