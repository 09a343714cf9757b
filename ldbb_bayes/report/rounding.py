"""Numbers as a metrologist writes them: two significant digits of uncertainty, the value to the same place, a readable unit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

from ldbb_bayes.errors import InputError

__all__ = ["DISPLAY_UNITS", "display_name", "display_unit", "round_like", "round_uncertainty", "value_and_uncertainty"]

DISPLAY_UNITS: Mapping[str, tuple[float, str]] = MappingProxyType(
    {
        "mm/N": (1e3, "µm/N"),
        "mm/N/N": (1e6, "µm/N per kN"),
        "mm/N/N^2": (1e9, "µm/N per kN²"),
        "rad/N": (1e9, "nrad/N"),
        "rad/N/N": (1e12, "nrad/N per kN"),
        "rad/N/N^2": (1e15, "nrad/N per kN²"),
        "rad/(N mm)": (1e9, "µrad/(N m)"),
        "rad/(N mm)/N": (1e12, "µrad/(N m) per kN"),
        "rad/(N mm)/N^2": (1e15, "µrad/(N m) per kN²"),
        "1": (1e6, "µm/m"),
        "1/mm": (1e9, "µm/m²"),
        "rad": (1e6, "µrad"),
        "mm": (1e3, "µm"),
        "um": (1.0, "µm"),
    }
)


def display_unit(unit: str) -> tuple[float, str]:
    """Factor and label that turn an inside unit into one for reading.

    Raises
    ------
    InputError
        For a unit that is not one of ours.
    """
    if unit not in DISPLAY_UNITS:
        raise InputError(f"unit must be one of {', '.join(DISPLAY_UNITS)}, got {unit!r}. Use an inside unit.")
    return DISPLAY_UNITS[unit]


def display_name(name: str) -> str:
    """The name as the paper prints it: E_C0YX → E_C(0Y)X."""
    if len(name) == 6 and name.startswith("E_") and name[3] == "0":
        return f"{name[:3]}({name[3:5]}){name[5]}"
    return name


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
