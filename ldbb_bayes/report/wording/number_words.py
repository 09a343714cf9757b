"""Numbers in words: intervals, probabilities, limits, and changes with force."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ldbb_bayes.units import display_name, interval_statement

__all__ = [
    "SMALLEST_SHOWN_PROBABILITY",
    "SURE",
    "changes_by_words",
    "direction_words",
    "interval_of",
    "is_exactly_none",
    "limit_words",
    "p_value_digits",
    "p_value_words",
    "percent_of",
    "probability_words",
]

# Probabilities below this value, which would be rounded to 0.000, are stated as "< 0.001".
SMALLEST_SHOWN_PROBABILITY = 5e-4
# p-values below this value, which may be too small for a floating-point number, are stated as
# "< 0.0001".
_LEAST_P_VALUE = 1e-4
# If a change has at least this probability, sentences state it as a fact. The change may be that a
# compliance increases or decreases with force, or that a slope (a coefficient of this change)
# differs from zero.
SURE = 0.95
# A difference of probabilities that is at most this value counts as zero, because it may be a
# rounding error.
_ROUNDING = 1e-9


def interval_of(entry: Mapping[str, Any]) -> tuple[float, float]:
    """Return the two ends of the credible interval in the JSON record of a parameter."""
    low, high = entry[_interval_key(entry)]
    return low, high


def percent_of(result: Mapping[str, Any]) -> str:
    """Return the probability of a fit's credible intervals as text, such as "95 %".

    ``result`` is the JSON record of the fit.
    """
    entry = next(iter(result["parameters"].values()))
    return f"{_interval_key(entry).removeprefix('ci')} %"


def _interval_key(entry: Mapping[str, Any]) -> str:
    """Return the key of the credible interval in a parameter's JSON record, such as ``ci95``."""
    return next(key for key in entry if key.startswith("ci"))


def probability_words(probability: float) -> str:
    """Return a probability as a string with three decimals.

    The string is "< 0.001" for a probability near 0, and "> 0.999" for a probability near 1.
    """
    if probability < SMALLEST_SHOWN_PROBABILITY:
        return "< 0.001"
    if probability >= 1.0 - SMALLEST_SHOWN_PROBABILITY:
        return "> 0.999"
    return f"{probability:.3f}"


def p_value_digits(p_value: float, digits: int = 2) -> str:
    """Return a p-value as a string with ``digits`` significant digits, or "< 0.0001"."""
    if p_value < _LEAST_P_VALUE:
        return "< 0.0001"
    return f"{p_value:.{digits}g}"


def p_value_words(p_value: float, digits: int = 2) -> str:
    """Return a p-value as the right side of "p = 0.02" or "p < 0.0001", with the sign.

    ``digits`` is the number of significant digits.
    """
    number = p_value_digits(p_value, digits)
    if number.startswith("<"):
        return number
    return f"= {number}"


def changes_by_words(name: str, change: Mapping[str, Any]) -> str:
    """Return the heading of a row that states the change of a compliance with force.

    An example is "C_XXX changes from 36 N to 742 N by". ``name`` is the name of the compliance, and
    ``change`` the JSON record of its change.
    """
    smallest = change["smallest_force_N"]
    largest = change["largest_force_N"]
    return f"{display_name(name)} changes from {smallest:.4g} N to {largest:.4g} N by"


def direction_words(change: Mapping[str, Any]) -> str:
    """Return a string that states whether a compliance increases or decreases with force.

    ``change`` is the JSON record of the compliance's change over the tested forces. If neither an
    increase nor a decrease has a probability of at least 95 %, the string states the probabilities
    of both. For an average over models, the string then also states the probability that there is
    no change at all. If it is almost certain that there is none (`is_exactly_none`), the string
    also has the interval of the changes that are not zero.
    """
    increase = change["probability_of_increase"]
    decrease = change["probability_of_decrease"]
    if increase >= SURE:
        return f"increases with probability {probability_words(increase)}"
    if decrease >= SURE:
        return f"decreases with probability {probability_words(decrease)}"
    probabilities = [
        f"increase {probability_words(increase)}",
        f"decrease {probability_words(decrease)}",
    ]
    none = 1.0 - increase - decrease
    if none > _ROUNDING:
        probabilities.append(f"exactly none {probability_words(none)}")
    return f"no change shown ({', '.join(probabilities)}{_interval_if_any(change)})"


def is_exactly_none(change: Mapping[str, Any]) -> bool:
    """Return whether a compliance almost certainly does not change with force at all.

    This is the case if "exactly none" has a probability of at least 95 %, or if the credible
    interval of the change is the single value zero. An interval with equal tails, such as
    [0.00, 0.91], would then be of the few draws that have a change, on one side of zero alone.

    ``change`` is the JSON record of the compliance's change over the tested forces.
    """
    value = change["change"]
    none = 1.0 - change["probability_of_increase"] - change["probability_of_decrease"]
    return bool(none >= SURE or value["ci_low"] == value["ci_high"] == 0.0)


def _interval_if_any(change: Mapping[str, Any]) -> str:
    """Return a string with the interval of a change, given that it is not exactly zero.

    The string is empty if the change ``change`` is not almost certainly zero (`is_exactly_none`),
    or if no other interval is known.
    """
    if_any = change.get("if_any")
    if if_any is None or not is_exactly_none(change):
        return ""
    statement = interval_statement((if_any["ci_low"], if_any["ci_high"]), change["unit"])
    low, high = statement.ends
    return f"; if any, {low} to {high} {statement.unit}"


def limit_words(lower: float | None, upper: float | None, factor: float = 1.0) -> str:
    """Return a string with tolerance limits, such as "≤ 60", "≥ 18", "± 20" or "−20 … 40".

    Parameters
    ----------
    lower, upper
        Lower limit and upper limit. None if the tolerance has no such limit.
    factor
        Factor that converts the unit of the limits to the unit shown.

    Returns
    -------
    str
        String with the limits, or an empty string if there are no limits.
    """
    if lower is None and upper is None:
        return ""
    low = "" if lower is None else _limit_digits(lower * factor)
    high = "" if upper is None else _limit_digits(upper * factor)
    if low == f"−{high}":
        return f"± {high}"
    if low and high:
        return f"{low} … {high}"
    if low:
        return f"≥ {low}"
    return f"≤ {high}"


def _limit_digits(limit: float) -> str:
    """Return the limit of a tolerance as a string.

    The limit is rounded to four significant digits or, if it is at least 1000, to a whole number.
    """
    digits = f"{limit:.0f}" if abs(limit) >= 1000.0 else f"{limit:.4g}"
    return digits.replace("-", "−")
