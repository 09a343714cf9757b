"""Table of decisions on conformity with tolerances, one row for each quantity."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ldbb_bayes.report import wording
from ldbb_bayes.results import Table
from ldbb_bayes.units import (
    display_name,
    display_unit,
    needs_interval,
    round_uncertainty,
    state,
    three_digits,
    value_and_uncertainty,
)

__all__ = ["conformity_table"]

# A decision on conformity is close if the probability is less than this number of its numerical
# standard errors away from the probability at which the decision changes.
_CLOSE_DECISION = 2.0


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
