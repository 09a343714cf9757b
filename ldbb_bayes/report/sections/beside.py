"""Several campaigns side by side."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import pandas as pd

from ldbb_bayes.model.wording import nuisance_words
from ldbb_bayes.report.document import Bullets, Paragraph, Picture, Section, Sheet, sheet
from ldbb_bayes.report.figures.differences import difference_forest
from ldbb_bayes.report.rounding import plus_minus, round_like, round_uncertainty, state
from ldbb_bayes.units import display_name, display_unit

__all__ = ["Beside", "beside", "doubts"]

_CONFLICT = 0.01
_DEGREES = ("constant", "linear", "quadratic")


@dataclass(frozen=True, eq=False)
class Beside:
    """Another campaign beside the first.

    Attributes
    ----------
    name : str
    result : dict
        The JSON of its fit.
    differences : DataFrame
        Of its parameters to those of the first, from `differences`.
    """

    name: str
    result: Mapping[str, Any]
    differences: pd.DataFrame


def beside(first: Mapping[str, Any], others: tuple[Beside, ...], *, same_instrument: bool, ci_prob: float) -> Section:
    """Differences of every parameter with intervals and probabilities.

    Parameters
    ----------
    first : dict
        The JSON of the fit that the others are compared with.
    """
    name = str(first["campaign"]["name"])
    shared = (
        "The instrument was the same (bar, balls, mount, force device): its errors cancel in the differences, as far as both "
        "campaigns see them alike. Truncation is set aside, so an interval that it had narrowed may be wider here."
        if same_instrument
        else "Instruments are taken as independent. If bar, balls, mount and force device were the same, their errors cancel and "
        "most differences are known better than stated here (--same-instrument)."
    )
    degrees = {own["model"]["degree"] for own in (first, *(other.result for other in others))}
    unlike = " The campaigns were fitted with different degrees: only what all have is compared." if len(degrees) > 1 else ""
    return Section(
        "beside",
        "Campaigns side by side",
        (
            Paragraph(
                f"The first campaign is {name}; the rest of the page is about it. Differences are at its reference force "
                f"{first['model']['reference_force_N']:g} N; offsets of the tool ball, which are the set-up's, are left out. "
                f"{shared}{unlike}"
            ),
            Bullets(tuple(_changes(name, other, ci_prob) for other in others)),
            _campaigns(first, others),
            *(_table(name, other, f"{100 * ci_prob:g} %") for other in others),
            Picture(
                "differences",
                "Difference of every parameter to the first campaign",
                "Differences in units of their standard uncertainty.",
                difference_forest({other.name: other.differences for other in others}, ci_prob=ci_prob),
            ),
        ),
    )


def doubts(other: Beside, first: Mapping[str, Any]) -> Iterator[str]:
    """What forbids the use of a difference."""
    if not other.result["sampler"]["converged"]:
        yield f"Not converged: {other.name}. Do not use its numbers."
    conflict = other.differences.attrs.get("conflict")
    if conflict is not None and conflict[1] < _CONFLICT:
        yield (
            f"Not one instrument: {first['campaign']['name']} and {other.name} disagree about the "
            f"{nuisance_words(conflict[0])} (p = {conflict[1]:.1g}). Balls turned or changed? Do not use the differences; make "
            "the page without --same-instrument."
        )


def _changes(first: str, other: Beside, ci_prob: float) -> str:
    """What has changed, in a sentence."""
    table, tail = other.differences, 0.5 - 0.5 * ci_prob
    clear = table[(table["probability_of_increase"] > 1.0 - tail) | (table["probability_of_increase"] < tail)]
    shown = [
        f"{display_name(str(name))} {plus_minus(row['difference'], row['sd'], (row['ci_low'], row['ci_high']), row['unit'])}"
        for name, row in clear.iterrows()
    ]
    said = f"differs from {first} (± U, k = 2): {'; '.join(shown)}" if shown else f"is not told from {first} in any parameter"
    return f"{other.name} {said}. {100 * ci_prob:g} % intervals, each parameter by itself."


def _campaigns(first: Mapping[str, Any], others: tuple[Beside, ...]) -> Sheet:
    rows = []
    every = [(str(first["campaign"]["name"]), first), *((other.name, other.result) for other in others)]
    for name, own in every:
        forces = own["campaign"]["forces_N"]
        rows.append(
            [
                name,
                str(own["campaign"]["tests"]),
                f"{min(forces):g} to {max(forces):g}",
                _DEGREES[own["model"]["degree"]],
                own["provenance"]["started"][:10],
                "yes" if own["sampler"]["converged"] else "NO",
                own["campaign"]["sha256"],
            ]
        )
    heads = ["campaign", "tests", "forces (N)", "compliance", "fitted", "converged", "readings, SHA-256"]
    return sheet("Campaigns", heads, rows, text=(2, 3, 4, 5, 6))


def _table(first: str, other: Beside, percent: str) -> Sheet:
    rows = []
    for parameter, row in other.differences.iterrows():
        own = state(row["difference"], row["sd"], (row["ci_low"], row["ci_high"]), row["unit"])
        factor, _ = display_unit(row["unit"])
        _, decimals = round_uncertainty(row["sd"] * factor)
        values = [round_like(row[key] * factor, decimals) for key in ("first", "second")]
        probability = _probability(row["probability_of_increase"])
        rows.append([display_name(str(parameter)), *values, own.value, own.u, own.interval, own.unit, probability])
    heads = ["parameter", "first", "second", "difference", "u", f"{percent} interval", "unit", "P(second > first)"]
    return sheet(f"Second: {other.name}; first: {first}", heads, rows, text=(6,))


def _probability(value: float) -> str:
    return "> 0.999" if value > 0.999 else "< 0.001" if value < 0.001 else f"{value:.3f}"
