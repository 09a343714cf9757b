"""Numbers as a metrologist writes them: two significant digits of uncertainty, the value to the same place, a readable unit."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ldbb_bayes.units import display_unit

__all__ = [
    "Statement",
    "is_lopsided",
    "plus_minus",
    "round_like",
    "round_uncertainty",
    "state",
    "stiffness",
    "value_and_uncertainty",
]

_HARDLY = 0.2


def round_uncertainty(uncertainty: float, digits: int = 2) -> tuple[str, int]:
    """The uncertainty to significant ``digits``, and the number of decimals it leaves (negative left of the point)."""
    if not math.isfinite(uncertainty) or uncertainty <= 0:
        return ("0" if uncertainty == 0 else "?"), digits
    decimals = digits - 1 - math.floor(math.log10(uncertainty))
    if float(f"{uncertainty:.{digits - 1}e}") >= 10.0 ** (digits - decimals):
        decimals -= 1
    return round_like(uncertainty, decimals), decimals


def round_like(value: float, decimals: int) -> str:
    """The value rounded to a decimal place; a value that rounds to nothing has no sign."""
    if not math.isfinite(value):
        return "?"
    rounded = round(value, decimals)
    return f"{rounded if rounded != 0 else 0.0:.{max(decimals, 0)}f}"


def value_and_uncertainty(value: float, uncertainty: float) -> tuple[str, str]:
    """Value and uncertainty to the same place, the uncertainty with two significant digits."""
    text, decimals = round_uncertainty(uncertainty)
    return round_like(value, decimals), text


@dataclass(frozen=True)
class Statement:
    """A result as a metrologist writes it; every text without the unit.

    Attributes
    ----------
    value : str
        To the place of u.
    u : str
        Standard uncertainty, two significant digits.
    expanded : str
        U (k = 2); of a lopsided distribution the distances to the ends of the interval, +a/−b.
    interval : str
        Credible interval.
    unit : str
    """

    value: str
    u: str
    expanded: str
    interval: str
    unit: str


def state(mean: float, sd: float, interval: tuple[float, float], unit: str) -> Statement:
    """A result in a unit for reading, from numbers in an inside unit."""
    factor, label = display_unit(unit)
    value, u = value_and_uncertainty(mean * factor, sd * factor)
    _, decimals = round_uncertainty(sd * factor)
    low, high = (bound * factor for bound in interval)
    expanded, _ = round_uncertainty(2.0 * sd * factor)
    if is_lopsided(mean, interval):
        above, below = (round_like(distance, decimals) for distance in (high - mean * factor, mean * factor - low))
        expanded = f"+{above} / −{below}" if low <= mean * factor <= high else "see interval"
    return Statement(_minus(value), u, expanded, _minus(f"[{round_like(low, decimals)}, {round_like(high, decimals)}]"), label)


def is_lopsided(mean: float, interval: tuple[float, float]) -> bool:
    """Whether the middle of the interval lies off the mean by more than a tenth of the interval's width."""
    low, high = interval
    return abs(low + high - 2.0 * mean) > 0.2 * (high - low)


def stiffness(median: float, interval: tuple[float, float]) -> str:
    """1/C in N/µm with its interval, from a compliance in mm/N.

    Only a lower limit where C may be a fifth of its median or less; nothing where C is negative.
    """
    low, high = interval
    if high <= 0.0:
        return ""
    if low < _HARDLY * median or low <= 0.0:
        limit = 1e-3 / high
        return f"at least {round_like(limit, 2 - math.floor(math.log10(limit)))}"
    _, decimals = round_uncertainty(1e-3 / median - 1e-3 / high)
    middle, least, most = (round_like(1e-3 / value, decimals) for value in (median, high, low))
    return f"{middle} [{least}, {most}]"


def plus_minus(mean: float, sd: float, interval: tuple[float, float], unit: str) -> str:
    """Value ± U (k = 2) to the same place and unit; value and interval where the distribution is lopsided."""
    factor, label = display_unit(unit)
    value, expanded = value_and_uncertainty(mean * factor, 2.0 * sd * factor)
    if not is_lopsided(mean, interval):
        return f"{_minus(value)} ± {expanded} {label}"
    own = state(mean, sd, interval, unit)
    return f"{own.value} {own.interval} {own.unit}"


def _minus(text: str) -> str:
    """A minus sign in place of a hyphen."""
    return text.replace("-", "−")
