"""Tolerances: which quantities may have one, and reading them from texts with a unit."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.errors import check_known, require
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.results import Shown
from ldbb_bayes.units import inside_name, is_direct, to_inside

__all__ = ["Quantity", "Tolerance", "check_force", "quantities", "quantities_of", "tolerances_in"]


_PATHS = {"G": ("upper",), "F_max": ("upper",), "F_min": ("lower",)}


_POSITIVE = re.compile(r"C_(.)\1.")  # deflection and tilt under their own force and moment


_NEVER_NEGATIVE = re.compile(_POSITIVE.pattern + r"|stiffness_.|G(_..)?")


_LEAST = 0.1


_MOST = 1.5  # of the tested forces, where C(F) may be stated


@dataclass(frozen=True)
class Tolerance(Shown):
    """What a quantity may be, limits included, in inside units (mm, N, rad); None: no limit on that
    side."""

    lower: float | None = None  #: limit
    upper: float | None = None  #: limit

    def __post_init__(self) -> None:
        low, high = self.ends
        require(
            low < high,
            f"a tolerance must have a lower limit below its upper one, got {low:g} and {high:g}."
            " Correct it.",
        )
        require(
            np.isfinite([low, high]).any(),
            "a tolerance must have a limit, got none. Write for example 60 nm/N.",
        )

    @property
    def ends(self) -> tuple[float, float]:
        """Both limits, infinite where there is none."""
        return (
            -np.inf if self.lower is None else self.lower,
            np.inf if self.upper is None else self.upper,
        )


@dataclass(frozen=True)
class Quantity:
    """What may have a tolerance: its unit, and the sides that a single number limits."""

    unit: str
    sides: tuple[str, ...]


def quantities(units: Mapping[str, str], planes: Collection[str] = ()) -> dict[str, Quantity]:
    """What may have a tolerance, by name: parameters with these units, stiffnesses, and the
    machine's path in these planes."""
    found = {
        key: Quantity(unit, ("upper",) if _POSITIVE.fullmatch(key) else ("lower", "upper"))
        for key, unit in units.items()
    }
    found |= {
        f"stiffness_{name[2]}": Quantity("N/mm", ("lower",)) for name in units if is_direct(name)
    }
    ends = [f"_{plane}" for plane in planes] if len(planes) > 1 else [""] * len(planes)
    return found | {
        name + end: Quantity("mm", sides) for name, sides in _PATHS.items() for end in ends
    }


def quantities_of(bound: BoundModel) -> dict[str, Quantity]:
    """The same of a bound model."""
    return quantities({own.name: own.unit for own in bound.parameters}, bound.setting.planes)


def tolerances_in(
    known: Mapping[str, Quantity], given: Mapping[str, str | Tolerance]
) -> dict[str, Tolerance]:
    """Tolerances by name: texts with a unit read, names and limits checked. ``60 nm/N`` is an upper
    limit of what cannot be negative, of a stiffness a lower one (``18 N/µm``), of anything else ±;
    ``−20..40 µrad`` is both, and ``≤``, ``≥`` or ``±`` before a number say which."""
    read = {}
    for name, tolerance in ((inside_name(name), own) for name, own in given.items()):
        check_known("tolerance", [name], known)
        read[name] = own = (
            tolerance if isinstance(tolerance, Tolerance) else _read(name, tolerance, known[name])
        )
        limit = own.lower if own.upper is None else own.upper
        said = (
            f"tolerance of {name} must have a limit above 0, for {name} cannot be negative, got"
            f" {tolerance}. Leave the sign out."
        )
        require(limit is None or limit > 0.0 or not _NEVER_NEGATIVE.fullmatch(name), said)
    return read


def check_force(campaign: Campaign, force_N: float | None) -> None:
    """Refuse a force far from those tested, at which nothing can be stated; None passes."""
    least, most = (float(end) for end in (campaign.forces_N.min(), campaign.forces_N.max()))
    got = f"{campaign.name!r} was tested from {least:g} to {most:g} N, got {force_N}"
    cure = "Choose one within what was tested, or test at that force"
    said = (
        f"force_N (--force-N) must be a force from {_LEAST * least:g} to {_MOST * most:g} N, for"
        f" {got}. {cure}."
    )
    require(force_N is None or (force_N > 0.0 and _LEAST * least <= force_N <= _MOST * most), said)


def _read(name: str, text: str, quantity: Quantity) -> Tolerance:
    what = f"tolerance of {name}"
    least, between, most = text.partition("..")
    if between:
        unit = re.sub(r"^\s*[+−-]?[\d.]+(e[+-]?\d+)?", "", most, flags=re.IGNORECASE)
        least = (
            least if re.search(r"[^\W\d]|[%°]", re.sub(r"\de[+-]?\d", "", least)) else least + unit
        )
        low, high = (to_inside(end, quantity.unit, what) for end in (least, most))
        require(
            low < high,
            f"{what} must have its lower limit first, got {text!r}. Write for example −20..40"
            " µrad.",
        )
        return Tolerance(low, high)
    sign = re.match(r"\s*(±|≤|<=|≥|>=)?", text)
    told = {
        "±": ("lower", "upper"),
        "≤": ("upper",),
        "<=": ("upper",),
        "≥": ("lower",),
        ">=": ("lower",),
    }
    sides = told.get(sign[1] if sign and sign[1] else "", quantity.sides)
    value = to_inside(text[sign.end() if sign else 0 :], quantity.unit, what)
    if len(sides) == 2:
        return Tolerance(-abs(value), abs(value))
    return Tolerance(**{sides[0]: value})
