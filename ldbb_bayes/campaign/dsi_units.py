r"""Units of the D-SI (Digital SI), as digital calibration certificates write them.

For example, newton per bar is written ``\newton\bar\tothe{-1}`` or ``\newton\per\bar``.
"""

from __future__ import annotations

import re
import tomllib
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

__all__ = ["DCC_WORDS", "UnitSize", "is_angle", "parse_unit"]

# Content of the file ``dcc.toml`` of the package: prefixes and units of the D-SI (Digital SI), and
# the words by which the quantities of digital calibration certificates are recognised.
DCC_WORDS: Mapping[str, Any] = tomllib.loads(
    (Path(__file__).parent / "dcc.toml").read_text(encoding="utf-8")
)
_PREFIXES: Mapping[str, float] = DCC_WORDS["prefixes"]
_UNITS: Mapping[str, tuple[float, str]] = DCC_WORDS["units"]
_WHOLE_UNIT = re.compile(r"(\\[a-zA-Z]+(\{[-+]?\d\})?)+")
# Units of an angle, the dimension of which is that of a ratio.
_ANGLES = re.compile(r"\\(radian|degree)\b")
_FACTOR = re.compile(r"\\([a-zA-Z]+)(?:\\tothe\{([-+]?\d)\})?")


class UnitSize(NamedTuple):
    """Size and dimension of a unit in which a certificate states a number."""

    #: size of a certificate's unit, such as 1e-6 for µm, in SI units; for a unit of pressure, the
    #: size in bar instead
    factor: float
    #: dimension of a certificate's unit, written as a string of SI units, with bar for pressure,
    #: such as m, N or N/bar. The string is empty for a ratio.
    dimension: str


def parse_unit(unit: str | None) -> UnitSize | None:
    r"""Return the size and the dimension of a unit that is written in the notation of the D-SI.

    The D-SI (Digital SI) is the notation of units in digital calibration certificates. Return None
    for an unknown unit.

    Parameters
    ----------
    unit
        Unit, such as ``\micro\metre`` or ``\newton\per\bar``.
    """
    if unit is None or _WHOLE_UNIT.fullmatch(unit) is None:
        return None
    factor = 1.0
    powers = Counter[str]()
    prefix = 1.0
    sign = 1
    for name, power in _FACTOR.findall(unit):
        if name in _UNITS:
            size, dimension = _UNITS[name]
            exponent = sign * int(power or 1)
            factor *= (prefix * size) ** exponent
            powers[dimension] += exponent
            prefix = 1.0
            sign = 1
        elif name in _PREFIXES:
            prefix = _PREFIXES[name]
        elif name == "per":
            sign = -1
        else:
            return None
    if prefix != 1.0 or sign != 1:
        # A prefix, or the word "per", is followed by no unit.
        return None
    return UnitSize(factor, _dimension_text(powers))


def is_angle(unit: str | None) -> bool:
    r"""Return whether a unit, such as ``\micro\radian``, is one of an angle and not of a ratio."""
    return unit is not None and _ANGLES.search(unit) is not None


def _dimension_text(powers: Mapping[str, int]) -> str:
    """Return the dimension of a unit as a string of SI units, such as N/bar.

    ``powers`` holds the exponent of each unit in the dimension, such as 1 for N and −1 for bar.
    """
    numerators = ""
    denominators = ""
    for dimension, power in powers.items():
        if not dimension or not power:
            continue
        factor = dimension
        if abs(power) > 1:
            factor += str(abs(power))
        if power > 0:
            numerators += factor
        else:
            denominators += f"/{factor}"
    return numerators + denominators
