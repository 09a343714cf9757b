"""What a column looks like on the circle, as a formula: R c²s and the like, c = cos θ, s = sin θ.

Every column is a polynomial in R whose coefficient of Rʳ is homogeneous of degree base + r in (c, s), base being 2 for a
compliance (twist and wrench each bring one direction) and 1 for a geometric error. That makes the formula unique although
c² + s² = 1.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["pattern_of"]

Array = NDArray[Any]
_RADII = np.array([1.0, 2.0, 3.0, 4.0])
_ANGLE = np.arange(24) * (2 * np.pi / 24)
_POWERS = ("", "", "²", "³", "⁴")
_NEGLIGIBLE = 1e-9


def pattern_of(column: Callable[[float, Array], Array], base: int) -> str:
    """The formula of a column, lengths in mm.

    Parameters
    ----------
    column : callable
        (R [mm], angles (n,) [rad]) → values (n,).
    base : int
        Degree in (c, s) of the part without R.
    """
    values = np.stack([column(float(radius), _ANGLE) for radius in _RADII])
    by_power = np.linalg.solve(np.vander(_RADII, increasing=True), values)
    largest = np.abs(values).max()
    if largest < _NEGLIGIBLE:
        return "0"
    said = []
    for power in range(len(_RADII) - 1, -1, -1):
        degree = base + power
        monomials = np.stack([np.cos(_ANGLE) ** (degree - k) * np.sin(_ANGLE) ** k for k in range(degree + 1)], axis=1)
        if np.abs(by_power[power]).max() < _NEGLIGIBLE * largest:
            continue
        found = np.linalg.lstsq(monomials, by_power[power], rcond=None)[0]
        for k, factor in enumerate(found):
            if abs(factor) > _NEGLIGIBLE * largest:
                said.append((float(factor), _length(power) + _factor("c", degree - k) + _factor("s", k)))
    return _sum(said)


def _length(power: int) -> str:
    return f"R{_POWERS[power]} " if power else ""


def _factor(letter: str, power: int) -> str:
    return letter + _POWERS[power] if power else ""


def _sum(terms: list[tuple[float, str]]) -> str:
    """2.5 cs − R c²s."""
    text = ""
    for i, (factor, monomial) in enumerate(terms):
        size = abs(round(factor, 9))
        sign = ("−" if factor < 0 else "") if i == 0 else (" − " if factor < 0 else " + ")
        text += sign + ("" if size == 1.0 else f"{size:g} ") + monomial
    return text
