"""Several campaigns side by side."""

from __future__ import annotations

from collections.abc import Mapping

import pandas as pd

from ldbb_bayes.report.document import Paragraph, Picture, Section, Sheet, sheet
from ldbb_bayes.report.figures.differences import difference_forest
from ldbb_bayes.report.rounding import state
from ldbb_bayes.units import display_name

__all__ = ["beside"]


def beside(first: str, differences: Mapping[str, pd.DataFrame], *, same_instrument: bool, ci_prob: float) -> Section:
    """Differences of every parameter with intervals and probabilities.

    Parameters
    ----------
    first : str
        The campaign the others are compared with.
    differences : mapping of campaign to DataFrame
        From `differences`.
    """
    shared = (
        "The instrument was the same (bar, balls clocked alike, mount, force device): its errors cancel in the differences, "
        "as far as both campaigns see them alike; truncation set aside."
        if same_instrument
        else "Instruments are taken as independent. If bar, balls, mount and force device were the same, their errors cancel and "
        "the differences are known better than stated here (--same-instrument)."
    )
    return Section(
        "beside",
        "Campaigns side by side",
        (
            Paragraph(
                f"Difference of every parameter to that of {first}, at its reference force; offsets of the tool ball are left "
                f"out. {shared}"
            ),
            *(_table(name, table, f"{100 * ci_prob:g} %") for name, table in differences.items()),
            Picture(
                "differences",
                "Difference of every parameter to the first campaign",
                "Differences in units of their standard uncertainty.",
                difference_forest(differences),
            ),
        ),
    )


def _table(name: str, table: pd.DataFrame, percent: str) -> Sheet:
    rows = []
    for parameter, row in table.iterrows():
        own = state(row["difference"], row["sd"], (row["ci_low"], row["ci_high"]), row["unit"])
        probability = row["probability_of_increase"]
        rows.append([display_name(str(parameter)), own.value, own.u, own.interval, own.unit, _probability(probability)])
    heads = ["parameter", "difference", "u", f"{percent} interval", "unit", "probability that it is larger"]
    return sheet(f"{name} less the first", heads, rows, text=(4,))


def _probability(value: float) -> str:
    return "> 0.999" if value > 0.999 else "< 0.001" if value < 0.001 else f"{value:.3f}"
