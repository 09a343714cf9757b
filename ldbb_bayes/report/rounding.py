"""Numbers as a metrologist writes them: two significant digits of uncertainty, the value to the same place, a readable unit."""

from __future__ import annotations

import math

__all__ = ["round_like", "round_uncertainty", "value_and_uncertainty"]


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
