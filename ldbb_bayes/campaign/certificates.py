"""Digital calibration certificates (DCC) of bar, force device and balls.

Their numbers are turned into the fields of `Instrument`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ldbb_bayes.campaign.dsi_units import DCC_WORDS, parse_unit
from ldbb_bayes.errors import InputError, placed, require
from ldbb_bayes.results import Shown

__all__ = ["CalibrationCertificate", "CertifiedQuantity"]

# Patterns by role of a quantity (length, force, form, …); the first pattern found in the name or
# refType of a quantity decides its role.
_ROLES: dict[str, str] = DCC_WORDS["roles"]
_METRES_PER_MICROMETRE = 1e-6
# Largest number of quantities that an error message lists.
_QUANTITIES_LISTED = 12
# Longest label in campaign.toml [characters].
_LONGEST_LABEL = 200


@dataclass(frozen=True)
class CertifiedQuantity:
    """One number of a certificate, as the certificate writes it."""

    name: str
    ref_type: str  #: refType attribute of the quantity
    holders: tuple[str, ...]  #: names of the elements that contain the quantity, outermost first
    value: float
    unit: str | None  #: unit in the notation of the D-SI
    U: float | None  #: expanded uncertainty
    k: float | None  #: coverage factor of U
    coverage: float | None  #: coverage probability of U

    @property
    def title(self) -> str:
        """Name of the quantity, else of the innermost named element around it, else its refType."""
        for text in (self.name, *reversed(self.holders), self.ref_type):
            if text:
                return text
        return "no name"

    @property
    def role(self) -> str:
        """Role of the quantity, such as length or force, by its name or else its holders' names.

        The role is empty for a quantity that concerns neither bar, force device nor ball.
        """
        own_text = f"{self.name} {self.ref_type}".lower()
        holder_text = " ".join(self.holders).lower()
        for text in (own_text, holder_text):
            for role, pattern in _ROLES.items():
                if re.search(pattern, text):
                    return role
        return ""

    @property
    def dimension(self) -> str | None:
        """Dimension of the quantity's unit; None for an unknown unit."""
        size = parse_unit(self.unit)
        return None if size is None else size.dimension

    def numbers(self, factor: float = 1.0) -> tuple[float, float]:
        """Return the value and its expanded uncertainty U (k = 2), zero where none is stated.

        Parameters
        ----------
        factor
            Size of the unit of the returned numbers, in SI units (bar for pressure).

        Raises
        ------
        InputError
            For an unknown unit, or a U without coverage factor.
        """
        size = parse_unit(self.unit)
        if size is None:
            raise InputError(
                rf"the unit of {self.title!r} must be of D-SI (like \micro\metre, \milli\metre,"
                rf" \newton, \percent), got {self.unit!r}. Correct it in a copy."
            )
        value = _without_rounding(self.value * size.factor / factor)
        if self.U is None:
            return value, 0.0
        if not self.k:
            raise InputError(
                f"{self.title!r} must have a coverage factor k beside U, got none. State U by hand."
            )
        U = 2.0 * self.U / self.k
        return value, _without_rounding(U * size.factor / factor)

    def magnitude(self) -> float:
        """Return the absolute value, in SI units (bar for pressure)."""
        value, _ = self.numbers()
        return abs(value)


def _without_rounding(number: float) -> float:
    """Return a number rounded to 12 digits, free of rounding errors of the unit conversion."""
    return float(f"{number:.12g}")


@dataclass(frozen=True)
class CalibrationCertificate(Shown):
    """A digital calibration certificate: its identifier and its numbers.

    The methods return what the certificate states of an instrument, by the keys of
    ``campaign.toml``. They raise an `InputError` if it states nothing of that kind.
    """

    path: Path
    identifier: str
    quantities: tuple[CertifiedQuantity, ...]

    def fields(self, kind: str) -> dict[str, Any]:
        """Return what the certificate states of a bar, a force device or a ball.

        Parameters
        ----------
        kind
            bar, force or ball.

        Returns
        -------
        Keys and values of the table in campaign.toml.

        Raises
        ------
        InputError
            For a certificate of something else; the message names the file.
        """
        readers = {"bar": self.bar, "force": self.force, "ball": self.ball}
        with placed(self.path):
            return readers[kind]()

    def bar(self) -> dict[str, Any]:
        """Return length_error_um, U_um and certificate of a bar.

        An error of indication is used unchanged. A deviation from the nominal length, stated or
        computed from length and nominal length, changes its sign, because a longer bar reads too
        small.
        """
        lengths = self._quantities_by_role("m")
        quantity = self._bar_quantity(lengths)
        value, U = quantity.numbers(_METRES_PER_MICROMETRE)
        if not U:
            raise InputError(
                f"{quantity.title!r} must have an uncertainty, got none. Give U_um by hand."
            )
        error = value
        if quantity.role == "deviation":
            error = _without_rounding(0.0 - value)
        elif quantity.role == "length":
            nominal, _ = _only(lengths["nominal"]).numbers(_METRES_PER_MICROMETRE)
            error = _without_rounding(nominal - value)
        return {"length_error_um": error, "U_um": U, "certificate": self._label(quantity)}

    def _bar_quantity(self, lengths: dict[str, list[CertifiedQuantity]]) -> CertifiedQuantity:
        """Return the quantity that states the error of a bar's length."""
        if "indication" in lengths:
            return _only(lengths["indication"])
        if "deviation" in lengths:
            return _only(lengths["deviation"])
        if "length" in lengths and "nominal" in lengths:
            return _only(lengths["length"])
        raise InputError(
            "the DCC must state the error of a bar's length by a name or refType, got"
            f" {self._content()}. Give length_error_um and U_um by hand."
        )

    def force(self) -> dict[str, Any]:
        """Return U_percent and linearity_percent of a force device, as far as stated.

        U_percent is the uncertainty of the gain or, without a gain, of the largest force.
        """
        stated: dict[str, Any] = {}
        sources = []
        scale = self._force_scale()
        if scale is not None and scale.U and scale.value:
            value, U = scale.numbers()
            stated["U_percent"] = _without_rounding(100.0 * U / abs(value))
            sources.append(scale)
        linearity = self._linearity()
        if linearity is not None:
            full_scale = self._full_scale(linearity)
            percent = 100.0 * linearity.magnitude() / full_scale
            stated["linearity_percent"] = _without_rounding(percent)
            sources.append(linearity)
        if not stated:
            raise InputError(
                "the DCC must state the U of a force device, or its linearity by a name or refType,"
                f" got {self._content()}. Give U_percent and linearity_percent by hand."
            )
        return stated | {"certificate": self._label(*sources)}

    def _force_scale(self) -> CertifiedQuantity | None:
        """Return the gain, or else the largest force; None where neither is stated."""
        gains = self._quantities_by_role("N/bar").get("gain", [])
        if gains:
            return _only(gains)
        return _largest(self._forces())

    def _forces(self) -> list[CertifiedQuantity]:
        return self._quantities_by_role("N").get("force", [])

    def _linearity(self) -> CertifiedQuantity | None:
        """Return the largest linearity error, a ratio or in newtons; None where none is stated."""
        shares = self._quantities_by_role("").get("linearity", [])
        newtons = self._quantities_by_role("N").get("linearity", [])
        return _largest([*shares, *newtons])

    def _full_scale(self, linearity: CertifiedQuantity) -> float:
        """Return the number to divide a linearity error by: 1, or the largest force [N]."""
        if linearity.dimension == "":
            return 1.0
        largest_force = _largest(self._forces())
        if largest_force is None or not largest_force.magnitude():
            raise InputError(
                f"{linearity.title!r} in newtons must come with forces, got none. Give"
                " linearity_percent by hand."
            )
        return largest_force.magnitude()

    def ball(self) -> dict[str, Any]:
        """Return sphericity_um and certificate of a ball.

        The sphericity is the largest sum of a stated form deviation and its U (k = 2).
        """
        largest_bound = 0.0
        quantity = None
        for deviation in self._quantities_by_role("m").get("form", []):
            value, U = deviation.numbers(_METRES_PER_MICROMETRE)
            if quantity is None or value + U >= largest_bound:
                largest_bound = value + U
                quantity = deviation
        if quantity is None:
            raise InputError(
                "the DCC must state the form of a ball by a name or refType, got"
                f" {self._content()}. Give sphericity_um by hand."
            )
        return {
            "sphericity_um": _without_rounding(largest_bound),
            "certificate": self._label(quantity),
        }

    def _quantities_by_role(self, dimension: str) -> dict[str, list[CertifiedQuantity]]:
        """Return, by role, the quantities that have this dimension or an unknown unit."""
        by_role: dict[str, list[CertifiedQuantity]] = {}
        for quantity in self.quantities:
            if quantity.role and quantity.dimension in (dimension, None):
                by_role.setdefault(quantity.role, []).append(quantity)
        return by_role

    def _label(self, *quantities: CertifiedQuantity) -> str:
        """Return file name, identifier and quantities as one line of text."""
        titles = ", ".join(_title_with_holder(quantity) for quantity in quantities)
        text = f"{self.path.name}, DCC {self.identifier}: {titles}"
        label = ""
        for sign in text[:_LONGEST_LABEL]:
            label += sign if sign.isprintable() else " "
        return label

    def _content(self) -> str:
        return _listed(self.quantities) or "no number at all"


def _title_with_holder(quantity: CertifiedQuantity) -> str:
    """Return a quantity's title, preceded by the closest holder that has no refType as name.

    A name with an underscore is a refType.
    """
    if quantity.name:
        for holder in reversed(quantity.holders):
            if "_" not in holder:
                return f"{holder}: {quantity.title}"
    return quantity.title


def _largest(quantities: Sequence[CertifiedQuantity]) -> CertifiedQuantity | None:
    """Return the largest quantity, the last of equally large ones; None for an empty sequence."""
    if not quantities:
        return None
    return sorted(quantities, key=CertifiedQuantity.magnitude)[-1]


def _only(quantities: Sequence[CertifiedQuantity]) -> CertifiedQuantity:
    """Return the only quantity of a sequence; raise an `InputError` for several."""
    require(
        len(quantities) == 1,
        f"{_listed(quantities[:1])} must stand there once, got {_listed(quantities)}. Give the"
        " right one by hand.",
    )
    return quantities[0]


def _listed(quantities: Sequence[CertifiedQuantity]) -> str:
    """Return the first twelve distinct titles, with units, as one line of text."""
    texts = list(dict.fromkeys(f"{quantity.title!r} ({quantity.unit})" for quantity in quantities))
    listed = ", ".join(texts[:_QUANTITIES_LISTED])
    if len(texts) > _QUANTITIES_LISTED:
        listed += f" and {len(texts) - _QUANTITIES_LISTED} more"
    return listed
