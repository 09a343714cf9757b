"""Numbers of a calibration certificate, each with its unit, role and uncertainty."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from ldbb_bayes.campaign.dsi_units import DCC_WORDS, parse_unit
from ldbb_bayes.errors import InputError, require

__all__ = [
    "METRES_PER_MICROMETRE",
    "MOST_QUANTITIES_LISTED",
    "CertifiedFields",
    "CertifiedQuantity",
    "largest_quantity",
    "listed_quantities",
    "only_quantity",
    "quantities_by_role",
    "quantities_in_words",
    "title_with_holder",
    "without_rounding",
]

# Regular expressions that show the role of a certified quantity, that is, what the quantity is,
# such as a length, a force or a form deviation. The keys are the roles. The role is the key of the
# first expression that matches the quantity's name or its attribute refType.
_ROLES: dict[str, str] = DCC_WORDS["roles"]
# Factor with which `CertifiedQuantity.numbers` returns lengths in µm.
METRES_PER_MICROMETRE = 1e-6
# Largest number of certified quantities that an error message lists.
MOST_QUANTITIES_LISTED = 12


class CertifiedNumbers(NamedTuple):
    """Value of a certified quantity, and its expanded uncertainty, in the same unit."""

    value: float
    U: float  #: expanded uncertainty (k = 2); zero if the certificate states none


@dataclass(frozen=True)
class CertifiedQuantity:
    """One number of a calibration certificate, exactly as the certificate states it.

    ``name`` is the name that the certificate gives the quantity; it is empty if the certificate
    gives no name. ``value`` is the number.
    """

    name: str
    #: attribute refType of the certified quantity, a standardised name of its kind; empty if
    #: missing
    ref_type: str
    #: names and refType attributes of the certificate's XML elements that contain the certified
    #: quantity, outermost first
    holders: tuple[str, ...]
    value: float
    #: unit of the certified value in the notation of the D-SI (Digital SI), such as \micro\metre;
    #: None if missing
    unit: str | None
    #: expanded uncertainty of the certified value, in the unit of the value; None if the
    #: certificate states none
    U: float | None
    #: coverage factor k of the expanded uncertainty of the certified value, as the certificate
    #: states it; None if missing
    k: float | None
    #: coverage probability of the expanded uncertainty of the certified value, as the certificate
    #: states it; None if missing
    coverage: float | None

    @property
    def title(self) -> str:
        """Name that error messages use for a quantity of a calibration certificate.

        It is the first of the following names that is not empty:

        - the name of the quantity,
        - the name or attribute refType of the innermost element that contains the quantity,
        - the attribute refType of the quantity,
        - "no name".
        """
        for text in (self.name, *reversed(self.holders), self.ref_type):
            if text:
                return text
        return "no name"

    @property
    def role(self) -> str:
        """Role of the certified quantity, that is, what the quantity is, such as ``length``.

        The name or the attribute refType of the quantity shows the role. If neither does, the names
        and refType attributes of the elements that contain the quantity are used. If these do not
        show the role either, the role is an empty string.
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
        """Dimension of the certified quantity's unit, such as m or N/bar; None if it is unknown."""
        size = parse_unit(self.unit)
        return None if size is None else size.dimension

    def numbers(self, factor: float = 1.0) -> CertifiedNumbers:
        """Return the value of the certified quantity, and its expanded uncertainty U for k = 2.

        U is zero if the certificate states no uncertainty.

        Parameters
        ----------
        factor
            Unit in which the value and U are returned, as a multiple of the SI unit or, for
            pressures, of 1 bar. For example, 1e-6 returns a length in µm, because 1 µm is 1e-6 m.

        Raises
        ------
        InputError
            For an unknown unit, an uncertainty U without coverage factor k, a negative or infinite
            U, or a k that is not a positive number.
        """
        size = parse_unit(self.unit)
        if size is None:
            raise InputError(
                rf"the unit of {self.title!r} must be of D-SI (like \micro\metre, \milli\metre,"
                rf" \newton, \percent), got {self.unit!r}. Correct it in a copy."
            )
        value = without_rounding(self.value * size.factor / factor)
        if self.U is None:
            return CertifiedNumbers(value, 0.0)
        if not self.k:
            raise InputError(
                f"{self.title!r} must have a coverage factor k beside U, got none. State U by hand."
            )
        require(
            0.0 <= self.U < math.inf and 0.0 < self.k < math.inf,
            f"{self.title!r} must have a U that is not negative and a positive coverage factor k,"
            f" got U = {self.U:g} and k = {self.k:g}. State U by hand.",
        )
        U = 2.0 * self.U / self.k
        return CertifiedNumbers(value, without_rounding(U * size.factor / factor))

    def magnitude(self) -> float:
        """Return the absolute value of the quantity in SI units or, for a pressure, in bar."""
        return abs(self.numbers().value)


class CertifiedFields(NamedTuple):
    """What a certificate states about an object, and the quantities from which it is taken."""

    #: certified values, with the keys of the object's table in campaign.toml
    values: Mapping[str, float]
    quantities: tuple[CertifiedQuantity, ...]


def without_rounding(number: float) -> float:
    """Return a number rounded to 12 significant digits.

    This removes the rounding errors that the conversion of units causes.
    """
    return float(f"{number:.12g}")


def title_with_holder(quantity: CertifiedQuantity) -> str:
    """Return a string that names a certified quantity and an XML element that contains it.

    An example is "Bar: length error". The element is the innermost element whose name contains no
    underscore, because names with underscores are technical. If there is no such element, or if the
    quantity has no name, return the title of the quantity alone.
    """
    if quantity.name:
        for holder in reversed(quantity.holders):
            if "_" not in holder:
                return f"{holder}: {quantity.title}"
    return quantity.title


def largest_quantity(quantities: Sequence[CertifiedQuantity]) -> CertifiedQuantity | None:
    """Return the certified quantity with the largest absolute value.

    If several quantities are equally large, return the last of them. Return None if ``quantities``
    is empty.
    """
    if not quantities:
        return None
    return sorted(quantities, key=CertifiedQuantity.magnitude)[-1]


def only_quantity(quantities: Sequence[CertifiedQuantity]) -> CertifiedQuantity:
    """Return the only certified quantity in ``quantities``, such as the gain of a force device.

    Raise an `InputError` unless ``quantities`` has exactly one entry.
    """
    first = listed_quantities(quantities[:1])
    listed = listed_quantities(quantities)
    require(
        len(quantities) == 1,
        f"{first} must stand there once, got {listed}. Give the right one by hand.",
    )
    return quantities[0]


def listed_quantities(quantities: Sequence[CertifiedQuantity]) -> str:
    """Return the names and units of certified quantities as one line of text, for messages.

    If there are more than twelve different entries, the first twelve are listed, followed by the
    number of entries left out.
    """
    texts = list(dict.fromkeys(f"{quantity.title!r} ({quantity.unit})" for quantity in quantities))
    listed = ", ".join(texts[:MOST_QUANTITIES_LISTED])
    if len(texts) > MOST_QUANTITIES_LISTED:
        listed += f" and {len(texts) - MOST_QUANTITIES_LISTED} more"
    return listed


def quantities_by_role(
    quantities: Sequence[CertifiedQuantity], dimension: str
) -> dict[str, list[CertifiedQuantity]]:
    """Return, by role, the certified quantities whose unit has the given dimension, such as m.

    A role says what a quantity is, such as a length or a force. The result is a dictionary of lists
    of quantities; its keys are the roles. Quantities with an unknown unit are included too, but
    quantities without a role are left out.
    """
    by_role: dict[str, list[CertifiedQuantity]] = {}
    for quantity in quantities:
        if quantity.role and quantity.dimension in (dimension, None):
            by_role.setdefault(quantity.role, []).append(quantity)
    return by_role


def quantities_in_words(quantities: Sequence[CertifiedQuantity]) -> str:
    """Return the names and units of a certificate's quantities as text, for messages."""
    return listed_quantities(quantities) or "no number at all"
