"""Digital calibration certificates (DCC) of the bar, the force device and the balls.

The numbers of a certificate are returned as dictionaries with the keys of ``campaign.toml``. They
are later stored in fields of `Instrument`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ldbb_bayes.campaign.dsi_units import DCC_WORDS, is_angle, parse_unit
from ldbb_bayes.errors import InputError, placed, require
from ldbb_bayes.results import Shown

__all__ = ["CalibrationCertificate", "CertifiedQuantity"]

# Regular expressions that show the role of a certified quantity, that is, what the quantity is,
# such as a length, a force or a form deviation. The keys are the roles. The role is the key of the
# first expression that matches the quantity's name or its attribute refType.
_ROLES: dict[str, str] = DCC_WORDS["roles"]
_METRES_PER_MICROMETRE = 1e-6
# Largest number of certified quantities that an error message lists.
_QUANTITIES_LISTED = 12
# Pattern of a length in the name of a bar, such as 100 mm.
_LENGTH_IN_NAME = re.compile(r"(?<![\d.,])(\d+(?:[.,]\d+)?)\s?mm\b")
# Largest error of a bar's length [µm] that a certificate may state. A larger number is a length.
_LARGEST_LENGTH_ERROR_UM = 1000.0
# Two nominal lengths of a ball bar count as equal if they differ by at most this fraction of the
# length.
_NOMINAL_TOLERANCE = 1e-3
# Longest name of a certificate that is written into campaign.toml [characters].
_LONGEST_LABEL = 200


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

    def numbers(self, factor: float = 1.0) -> tuple[float, float]:
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
        value = _without_rounding(self.value * size.factor / factor)
        if self.U is None:
            return value, 0.0
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
        return value, _without_rounding(U * size.factor / factor)

    def magnitude(self) -> float:
        """Return the absolute value of the quantity in SI units or, for a pressure, in bar."""
        value, _ = self.numbers()
        return abs(value)


def _without_rounding(number: float) -> float:
    """Return a number rounded to 12 significant digits.

    This removes the rounding errors that the conversion of units causes.
    """
    return float(f"{number:.12g}")


@dataclass(frozen=True)
class CalibrationCertificate(Shown):
    """Digital calibration certificate (DCC): its identifier and its numbers.

    The methods return dictionaries of what the certificate states about a bar, a force device or a
    ball. The dictionaries have the keys of ``campaign.toml``. The methods raise an `InputError` if
    the certificate says nothing about such an object.
    """

    path: Path
    identifier: str
    quantities: tuple[CertifiedQuantity, ...]

    def fields(self, kind: str, *, bar_length_mm: float | None = None) -> dict[str, Any]:
        """Return what the certificate states about a bar, a force device or a ball.

        Parameters
        ----------
        kind
            Kind of object: ``bar``, ``force`` (force device) or ``ball``.
        bar_length_mm
            Nominal length of the bar [mm]. This length is used to choose a bar if the certificate
            describes several bars.

        Returns
        -------
        Dictionary of certified values, with the keys of the object's table in campaign.toml.

        Raises
        ------
        InputError
            If the certificate states nothing about the object; the message names the file.
        """
        readers = {"force": self.force, "ball": self.ball}
        with placed(self.path):
            if kind == "bar":
                return self.bar(bar_length_mm)
            return readers[kind]()

    def bar(self, length_mm: float | None = None) -> dict[str, Any]:
        """Return the length error of a bar, its expanded uncertainty, and the certificate's name.

        The keys are named as in the table [bar] of campaign.toml: length_error_um [µm], U_um (k =
        2) [µm] and certificate. The length error is the amount by which readings are too large. It
        is computed from what the certificate states:

        - An error of indication is used unchanged.
        - A deviation from the nominal length is used with the opposite sign, because the readings
          of a bar that is too long are too small.
        - An actual length is subtracted from the nominal length.

        If the certificate describes several bars, the bar of the nominal length ``length_mm`` is
        used. Raise an `InputError` if no uncertainty is stated, or if the certificate still states
        several errors after the bar has been chosen, or if it states that its only bar has another
        nominal length.
        """
        lengths = self._quantities_by_role("m")
        quantity = self._bar_quantity(lengths, length_mm)
        error, U = _error_of_length(quantity, lengths)
        return {
            "length_error_um": error,
            "U_um": U,
            "certificate": self._certificate_name(quantity),
        }

    def _bar_quantity(
        self, lengths: Mapping[str, list[CertifiedQuantity]], length_mm: float | None
    ) -> CertifiedQuantity:
        """Return the certified quantity that states the error of a bar's length.

        An error of indication is used if the certificate states one. Otherwise a deviation from the
        nominal length is used or, if there is none, an actual length that is stated together with
        the nominal length. If the certificate describes several bars, the bar with the nominal
        length ``length_mm`` is chosen. ``lengths`` is a dictionary of lists of all certified
        lengths; its keys are roles such as ``deviation``. Raise an `InputError` if no quantity
        states an error, or if several such quantities remain.
        """
        candidates = lengths.get("indication") or lengths.get("deviation") or []
        if not candidates and "nominal" in lengths:
            candidates = lengths.get("length", [])
        if not candidates:
            raise InputError(
                "the DCC must state the error of a bar's length by a name or refType, got"
                f" {self._quantities_in_words()}. Give length_error_um and U_um by hand."
            )
        if len(candidates) > 1 and length_mm is not None:
            of_length = []
            for quantity in candidates:
                if _is_of_length(quantity, lengths.get("nominal", []), length_mm):
                    of_length.append(quantity)
            candidates = of_length or candidates
        if len(candidates) > 1:
            raise _several_errors(candidates, lengths)
        if length_mm is not None:
            _check_nominal_length(candidates[0], lengths.get("nominal", []), length_mm)
        return candidates[0]

    def force(self) -> dict[str, Any]:
        """Return what the certificate states about a force device, with the keys of campaign.toml.

        The result has these keys:

        - U_percent is the expanded uncertainty (k = 2) of the gain, in percent of the gain. If the
          certificate states no gain, U_percent is the largest amount by which a force may be wrong,
          in percent of the largest certified force: its expanded uncertainty or, if the certificate
          states deviations, the absolute deviation plus the expanded uncertainty of the deviation.
        - linearity_percent is the largest deviation from a straight line, in percent of the largest
          force.
        - certificate is the name of the certificate.

        A percentage that the certificate does not state is left out. Raise an `InputError` if it
        states neither of them.
        """
        stated: dict[str, Any] = {}
        sources = []
        scale = self._force_scale()
        if scale is not None and scale.value:
            value, U = scale.numbers()
            source = scale
            if scale.dimension == "N":
                U, source = self._largest_force_error(scale)
            if U:
                stated["U_percent"] = _without_rounding(100.0 * U / abs(value))
                sources.append(source)
        linearity = self._linearity()
        if linearity is not None:
            percent = 100.0 * self._linearity_ratio(linearity)
            stated["linearity_percent"] = _without_rounding(percent)
            sources.append(linearity)
        if not stated:
            raise InputError(
                "the DCC must state the U of a force device, or its linearity by a name or refType,"
                f" got {self._quantities_in_words()}. Give U_percent and linearity_percent by hand."
            )
        return stated | {"certificate": self._certificate_name(*sources)}

    def _force_scale(self) -> CertifiedQuantity | None:
        """Return the certified gain of a force device, that is, its force per pressure [N/bar].

        If the certificate states no gain, return the largest certified force [N]. If it states
        neither a gain nor a force, return None.
        """
        gains = self._quantities_by_role("N/bar").get("gain", [])
        if gains:
            return _only_quantity(gains)
        return _largest_quantity(self._forces())

    def _forces(self) -> list[CertifiedQuantity]:
        """Return the forces that the calibration certificate states, in the order of the file."""
        return self._quantities_by_role("N").get("force", [])

    def _largest_force_error(self, force: CertifiedQuantity) -> tuple[float, CertifiedQuantity]:
        """Return by how much a certified force may be wrong [N], and the quantity that states it.

        A certificate that compares the device with a reference states indications or deviations,
        too. Their expanded uncertainty is that of the device; that of the reference force is
        smaller. The force may be wrong by the absolute deviation plus its expanded uncertainty,
        because the forces of the campaign are not corrected for it. The largest of these amounts is
        returned. ``force`` is the largest certified force.
        """
        _, largest_N = force.numbers()
        source = force
        for other in self._forces():
            _, error_N = other.numbers()
            if error_N > largest_N:
                largest_N = error_N
                source = other
        for deviations in self._deviations_by_name():
            for deviation, reference in self._with_references(deviations, force):
                error_N = _force_error_N(deviation, reference)
                if error_N > largest_N:
                    largest_N = error_N
                    source = deviation
        return largest_N, source

    def _deviations_by_name(self) -> list[list[CertifiedQuantity]]:
        """Return the indications and deviations of a force device, in newtons or as ratios.

        Those of one name, such as those at several forces, are in one list, in the order of the
        file.
        """
        by_name: dict[tuple[str, ...], list[CertifiedQuantity]] = {}
        for dimension in ("N", ""):
            by_role = self._quantities_by_role(dimension)
            for quantity in (*by_role.get("indication", []), *by_role.get("deviation", [])):
                if quantity.dimension == dimension and not is_angle(quantity.unit):
                    names = (*quantity.holders, quantity.name, quantity.ref_type)
                    by_name.setdefault(names, []).append(quantity)
        return list(by_name.values())

    def _with_references(
        self, deviations: Sequence[CertifiedQuantity], largest: CertifiedQuantity
    ) -> list[tuple[CertifiedQuantity, CertifiedQuantity]]:
        """Return pairs of an indication or deviation and the force to which it belongs.

        If the certificate states as many forces as ``deviations``, beside them or altogether, both
        are in the same order. Otherwise, an indication belongs to the force that it is nearest to,
        and a ratio to ``largest``, the largest force.
        """
        forces = self._forces()
        forces_beside = [force for force in forces if force.holders == deviations[0].holders]
        for references in (forces_beside, forces):
            if len(references) == len(deviations):
                return list(zip(deviations, references, strict=True))
        pairs = []
        for deviation in deviations:
            reference = largest
            if deviation.dimension == "N":
                value_N, _ = deviation.numbers()
                distances = [abs(value_N - force.numbers()[0]) for force in forces]
                reference = forces[distances.index(min(distances))]
            pairs.append((deviation, reference))
        return pairs

    def _linearity(self) -> CertifiedQuantity | None:
        """Return the largest linearity error of a force device that the certificate states.

        The linearity error is the deviation from a straight line, as a ratio or as a force in
        newtons. To compare the errors, those in newtons are divided by the largest certified
        force. If several errors are equally large, return the last of them. Return None if no error
        is stated.
        """
        shares = self._quantities_by_role("").get("linearity", [])
        newtons = self._quantities_by_role("N").get("linearity", [])
        if not (shares or newtons):
            return None
        return sorted([*shares, *newtons], key=self._linearity_ratio)[-1]

    def _linearity_ratio(self, linearity: CertifiedQuantity) -> float:
        """Return the absolute value of a force device's linearity error, divided by the force.

        An error that is stated as a ratio is not divided. An error in newtons is divided by the
        largest certified force. Raise an `InputError` for an error in newtons if no force is
        certified.
        """
        size = linearity.magnitude()
        if linearity.dimension == "":
            return size
        largest_force = _largest_quantity(self._forces())
        if largest_force is None or not largest_force.magnitude():
            raise InputError(
                f"{linearity.title!r} in newtons must come with forces, got none. Give"
                " linearity_percent by hand."
            )
        return size / largest_force.magnitude()

    def ball(self) -> dict[str, Any]:
        """Return a dict with a ball's deviation from sphericity [µm] and its certificate's name.

        The keys are sphericity_um and certificate, as in campaign.toml. The deviation from
        sphericity includes its expanded uncertainty (k = 2), which is added to it. If the
        certificate states several form deviations of the ball, the largest sum is returned.
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
                f" {self._quantities_in_words()}. Give sphericity_um by hand."
            )
        return {
            "sphericity_um": _without_rounding(largest_bound),
            "certificate": self._certificate_name(quantity),
        }

    def _quantities_by_role(self, dimension: str) -> dict[str, list[CertifiedQuantity]]:
        """Return, by role, the certified quantities whose unit has the given dimension, such as m.

        A role says what a quantity is, such as a length or a force. The result is a dictionary of
        lists of quantities; its keys are the roles. Quantities with an unknown unit are included
        too, but quantities without a role are left out.
        """
        by_role: dict[str, list[CertifiedQuantity]] = {}
        for quantity in self.quantities:
            if quantity.role and quantity.dimension in (dimension, None):
                by_role.setdefault(quantity.role, []).append(quantity)
        return by_role

    def _certificate_name(self, *quantities: CertifiedQuantity) -> str:
        """Return a name for this calibration certificate, on one line, for campaign.toml.

        The name has at most 200 characters. It consists of the file's name, the identifier of the
        certificate and the names of ``quantities``, the certified quantities that are used.
        """
        titles = ", ".join(_title_with_holder(quantity) for quantity in quantities)
        text = f"{self.path.name}, DCC {self.identifier}: {titles}"
        label = ""
        for sign in text[:_LONGEST_LABEL]:
            label += sign if sign.isprintable() else " "
        return label

    def _quantities_in_words(self) -> str:
        """Return the names and units of the certificate's quantities as text, for messages."""
        return _listed(self.quantities) or "no number at all"


def _force_error_N(deviation: CertifiedQuantity, reference: CertifiedQuantity) -> float:
    """Return the absolute deviation of a force device plus its expanded uncertainty, in newtons.

    ``deviation`` is a deviation in newtons, a ratio to the force ``reference``, or an indicated
    force, which is closer to ``reference`` than to zero. If it has no uncertainty, that of
    ``reference`` is used.
    """
    deviation_N, U_N = deviation.numbers()
    reference_N, reference_U_N = reference.numbers()
    if deviation.dimension == "":
        deviation_N *= reference_N
        U_N *= abs(reference_N)
    elif abs(deviation_N - reference_N) < abs(deviation_N):
        deviation_N -= reference_N
    return abs(deviation_N) + (U_N or reference_U_N)


def _error_of_length(
    quantity: CertifiedQuantity, lengths: Mapping[str, list[CertifiedQuantity]]
) -> tuple[float, float]:
    """Return the amount by which a bar's readings are too large, and its uncertainty U, in µm.

    U is the expanded uncertainty (k = 2) of this amount. An indication or deviation of more than
    1 mm is a length, from which the nominal length is subtracted. Raise an `InputError` if the
    certificate gives no uncertainty, if the error is above 1 mm, or if the nominal length is needed
    but is not unique.

    Parameters
    ----------
    quantity
        Certified quantity from which the error is computed.
    lengths
        Dictionary of lists of all certified lengths; the keys are roles such as ``nominal``.
    """
    value, U = quantity.numbers(_METRES_PER_MICROMETRE)
    if not U:
        raise InputError(
            f"{quantity.title!r} must have an uncertainty, got none. Give U_um by hand."
        )
    nominals = lengths.get("nominal", [])
    is_length = quantity.role == "length" or abs(value) > _LARGEST_LENGTH_ERROR_UM
    if is_length and nominals:
        nominals_beside = [one for one in nominals if one.holders == quantity.holders]
        nominal, _ = _only_quantity(nominals_beside or nominals).numbers(_METRES_PER_MICROMETRE)
        value -= nominal
    require(
        abs(value) <= _LARGEST_LENGTH_ERROR_UM,
        f"the error of the bar's length must be at most {_LARGEST_LENGTH_ERROR_UM:g} µm, got"
        f" {value:g} µm from {quantity.title!r}. Give length_error_um and U_um by hand.",
    )
    # A bar that is too long gives readings that are too small.
    error = value if quantity.role == "indication" else 0.0 - value
    return _without_rounding(error), U


def _is_of_length(
    quantity: CertifiedQuantity, nominals: Sequence[CertifiedQuantity], length_mm: float
) -> bool:
    """Return whether a certified quantity belongs to a bar of the nominal length ``length_mm``.

    This is so in two cases:

    - The length is part of the quantity's name, or of the name of an XML element that contains the
      quantity. An example is ``Bar 100 mm``.
    - The XML element that contains the quantity also contains one of the certified lengths
      ``nominals``, and this nominal length equals ``length_mm``.
    """
    texts = " ".join((*quantity.holders, quantity.name))
    for match in _LENGTH_IN_NAME.finditer(texts):
        if _is_close(float(match[1].replace(",", ".")), length_mm):
            return True
    lengths_beside_mm = _nominal_lengths_beside_mm(quantity, nominals)
    return any(_is_close(nominal_mm, length_mm) for nominal_mm in lengths_beside_mm)


def _nominal_lengths_beside_mm(
    quantity: CertifiedQuantity, nominals: Sequence[CertifiedQuantity]
) -> list[float]:
    """Return the nominal lengths [mm] in the XML element that contains a certified quantity."""
    lengths_mm = []
    for nominal in nominals:
        if nominal.holders == quantity.holders and nominal.dimension == "m":
            lengths_mm.append(1e3 * nominal.magnitude())
    return lengths_mm


def _check_nominal_length(
    quantity: CertifiedQuantity, nominals: Sequence[CertifiedQuantity], length_mm: float
) -> None:
    """Raise an `InputError` if a certified error belongs to a bar of another nominal length.

    This is so if the XML element that contains the ``quantity`` also contains certified nominal
    lengths, and none of them equals ``length_mm``. ``nominals`` are all nominal lengths.
    """
    lengths_beside_mm = _nominal_lengths_beside_mm(quantity, nominals)
    if not lengths_beside_mm or _is_of_length(quantity, nominals, length_mm):
        return
    lengths_mm = " and ".join(f"{nominal_mm:g}" for nominal_mm in lengths_beside_mm)
    raise InputError(
        f"the DCC must be of a bar of radius_mm = {length_mm:g}, got {lengths_mm} mm beside"
        f" {quantity.title!r}. Give the DCC of the bar that was used, or its numbers by hand."
    )


def _is_close(length_mm: float, nominal_mm: float) -> bool:
    """Return whether a certified length equals a bar's nominal length to within 0.1 %."""
    return abs(length_mm - nominal_mm) <= _NOMINAL_TOLERANCE * nominal_mm


def _several_errors(
    candidates: Sequence[CertifiedQuantity], lengths: Mapping[str, list[CertifiedQuantity]]
) -> InputError:
    """Return the `InputError` for a certificate that states several errors of a bar's length.

    The message lists the first twelve errors. For each of them, it gives a name that distinguishes
    the error from the others, and the two numbers that the user may enter instead of the
    certificate: length_error_um and U_um. If one of these errors has no uncertainty, an
    `InputError` about this error is raised instead. ``candidates`` holds the certified quantities
    that state the errors. ``lengths`` is a dictionary of lists of all certified lengths; its keys
    are roles such as ``nominal``.
    """
    texts = []
    for quantity in candidates[:_QUANTITIES_LISTED]:
        error, U = _error_of_length(quantity, lengths)
        name = _distinguishing_name(quantity, candidates)
        texts.append(f"{name!r} (length_error_um {error:g}, U_um {U:g})")
    return InputError(
        f"the DCC must state the error of the bar's length once, got {', '.join(texts)}. Give these"
        " two numbers of the right one by hand instead of the DCC; of bars of several lengths"
        " radius_mm chooses where campaign.toml names the DCC."
    )


def _distinguishing_name(quantity: CertifiedQuantity, others: Sequence[CertifiedQuantity]) -> str:
    """Return a string that distinguishes a certified quantity from the quantities ``others``.

    The string consists of the names of the XML elements that contain the quantity, followed by the
    name of the quantity. Names that occur in all of ``others`` are left out. If no name remains,
    return the quantity's title.
    """
    names = []
    for name in (*quantity.holders, quantity.name):
        n_with_name = sum(name in (*other.holders, other.name) for other in others)
        if name and n_with_name < len(others):
            names.append(name)
    return ", ".join(dict.fromkeys(names)) or quantity.title


def _title_with_holder(quantity: CertifiedQuantity) -> str:
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


def _largest_quantity(quantities: Sequence[CertifiedQuantity]) -> CertifiedQuantity | None:
    """Return the certified quantity with the largest absolute value.

    If several quantities are equally large, return the last of them. Return None if ``quantities``
    is empty.
    """
    if not quantities:
        return None
    return sorted(quantities, key=CertifiedQuantity.magnitude)[-1]


def _only_quantity(quantities: Sequence[CertifiedQuantity]) -> CertifiedQuantity:
    """Return the only certified quantity in ``quantities``, such as the gain of a force device.

    Raise an `InputError` unless ``quantities`` has exactly one entry.
    """
    require(
        len(quantities) == 1,
        f"{_listed(quantities[:1])} must stand there once, got {_listed(quantities)}. Give the"
        " right one by hand.",
    )
    return quantities[0]


def _listed(quantities: Sequence[CertifiedQuantity]) -> str:
    """Return the names and units of certified quantities as one line of text, for messages.

    If there are more than twelve different entries, the first twelve are listed, followed by the
    number of entries left out.
    """
    texts = list(dict.fromkeys(f"{quantity.title!r} ({quantity.unit})" for quantity in quantities))
    listed = ", ".join(texts[:_QUANTITIES_LISTED])
    if len(texts) > _QUANTITIES_LISTED:
        listed += f" and {len(texts) - _QUANTITIES_LISTED} more"
    return listed
