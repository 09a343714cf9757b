"""Digital calibration certificates (DCC) of the bar, the force device and the balls.

The numbers of a certificate are returned as dictionaries with the keys of ``campaign.toml``. They
are later stored in fields of `Instrument`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ldbb_bayes.campaign.bar_certificate import (
    check_nominal_length,
    error_of_length,
    is_of_length,
    several_errors,
)
from ldbb_bayes.campaign.certified_quantity import (
    METRES_PER_MICROMETRE,
    CertifiedQuantity,
    largest_quantity,
    listed_quantities,
    only_quantity,
    title_with_holder,
    without_rounding,
)
from ldbb_bayes.campaign.dsi_units import is_angle
from ldbb_bayes.errors import InputError, placed
from ldbb_bayes.results import Shown

__all__ = ["CalibrationCertificate"]

# Longest name of a certificate that is written into campaign.toml [characters].
_LONGEST_LABEL = 200


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
        error, U = error_of_length(quantity, lengths)
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
                if is_of_length(quantity, lengths.get("nominal", []), length_mm):
                    of_length.append(quantity)
            candidates = of_length or candidates
        if len(candidates) > 1:
            raise several_errors(candidates, lengths)
        if length_mm is not None:
            check_nominal_length(candidates[0], lengths.get("nominal", []), length_mm)
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
                stated["U_percent"] = without_rounding(100.0 * U / abs(value))
                sources.append(source)
        linearity = self._linearity()
        if linearity is not None:
            percent = 100.0 * self._linearity_ratio(linearity)
            stated["linearity_percent"] = without_rounding(percent)
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
            return only_quantity(gains)
        return largest_quantity(self._forces())

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
        largest_N = force.numbers().U
        source = force
        for other in self._forces():
            error_N = other.numbers().U
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
                value_N = deviation.numbers().value
                distances = [abs(value_N - force.numbers().value) for force in forces]
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
        largest_force = largest_quantity(self._forces())
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
            value, U = deviation.numbers(METRES_PER_MICROMETRE)
            if quantity is None or value + U >= largest_bound:
                largest_bound = value + U
                quantity = deviation
        if quantity is None:
            raise InputError(
                "the DCC must state the form of a ball by a name or refType, got"
                f" {self._quantities_in_words()}. Give sphericity_um by hand."
            )
        return {
            "sphericity_um": without_rounding(largest_bound),
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
        titles = ", ".join(title_with_holder(quantity) for quantity in quantities)
        text = f"{self.path.name}, DCC {self.identifier}: {titles}"
        label = ""
        for sign in text[:_LONGEST_LABEL]:
            label += sign if sign.isprintable() else " "
        return label

    def _quantities_in_words(self) -> str:
        """Return the names and units of the certificate's quantities as text, for messages."""
        return listed_quantities(self.quantities) or "no number at all"


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
