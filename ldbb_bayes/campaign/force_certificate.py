"""Uncertainty and linearity of a force device, from what a calibration certificate states.

A force device makes the force of the bar from the pressure of a regulator. Its gain is the force
per pressure.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from ldbb_bayes.campaign.certified_quantity import (
    CertifiedFields,
    CertifiedQuantity,
    largest_quantity,
    only_quantity,
    quantities_by_role,
    quantities_in_words,
    without_rounding,
)
from ldbb_bayes.campaign.dsi_units import is_angle
from ldbb_bayes.errors import InputError

__all__ = ["force_fields"]


def force_fields(quantities: Sequence[CertifiedQuantity]) -> CertifiedFields:
    """Return what the certificate states about a force device, with the keys of campaign.toml.

    The result has these keys:

    - U_percent is the expanded uncertainty (k = 2) of the gain, in percent of the gain. If the
      certificate states no gain, U_percent is the largest amount by which a force may be wrong,
      in percent of the largest certified force: its expanded uncertainty or, if the certificate
      states deviations, the absolute deviation plus the expanded uncertainty of the deviation.
    - linearity_percent is the largest deviation from a straight line, in percent of the largest
      force.

    A percentage that the certificate does not state is left out. Raise an `InputError` if it
    states neither of them.
    """
    stated: dict[str, float] = {}
    sources = []
    scale = _force_scale(quantities)
    if scale is not None and scale.value:
        value, U = scale.numbers()
        source = scale
        if scale.dimension == "N":
            U, source = _largest_force_error(quantities, scale)
        if U:
            stated["U_percent"] = without_rounding(100.0 * U / abs(value))
            sources.append(source)
    linearity = _linearity(quantities)
    if linearity is not None:
        percent = 100.0 * _linearity_ratio(quantities, linearity)
        stated["linearity_percent"] = without_rounding(percent)
        sources.append(linearity)
    if not stated:
        raise InputError(
            "the DCC must state the U of a force device, or its linearity by a name or refType,"
            f" got {quantities_in_words(quantities)}. Give U_percent and linearity_percent by hand."
        )
    return CertifiedFields(stated, tuple(sources))


def _force_scale(quantities: Sequence[CertifiedQuantity]) -> CertifiedQuantity | None:
    """Return the certified gain of a force device, that is, its force per pressure [N/bar].

    If the certificate states no gain, return the largest certified force [N]. If it states
    neither a gain nor a force, return None.
    """
    gains = quantities_by_role(quantities, "N/bar").get("gain", [])
    if gains:
        return only_quantity(gains)
    return largest_quantity(_forces(quantities))


def _forces(quantities: Sequence[CertifiedQuantity]) -> list[CertifiedQuantity]:
    """Return the forces that the calibration certificate states, in the order of the file."""
    return quantities_by_role(quantities, "N").get("force", [])


def _largest_force_error(
    quantities: Sequence[CertifiedQuantity], force: CertifiedQuantity
) -> tuple[float, CertifiedQuantity]:
    """Return by how much a certified force may be wrong [N], and the quantity that states it.

    A certificate that compares the device with a reference states indications or deviations,
    too. Their expanded uncertainty is that of the device; that of the reference force is
    smaller. The force may be wrong by the absolute deviation plus its expanded uncertainty,
    because the forces of the campaign are not corrected for it. The largest of these amounts is
    returned. ``force`` is the largest certified force.
    """
    largest_N = force.numbers().U
    source = force
    for other in _forces(quantities):
        error_N = other.numbers().U
        if error_N > largest_N:
            largest_N = error_N
            source = other
    for deviations in _deviations_by_name(quantities):
        for deviation, reference in _with_references(_forces(quantities), deviations, force):
            error_N = _force_error_N(deviation, reference)
            if error_N > largest_N:
                largest_N = error_N
                source = deviation
    return largest_N, source


def _deviations_by_name(quantities: Sequence[CertifiedQuantity]) -> list[list[CertifiedQuantity]]:
    """Return the indications and deviations of a force device, in newtons or as ratios.

    Those of one name, such as those at several forces, are in one list, in the order of the
    file.
    """
    by_name: dict[tuple[str, ...], list[CertifiedQuantity]] = {}
    for dimension in ("N", ""):
        by_role = quantities_by_role(quantities, dimension)
        for quantity in (*by_role.get("indication", []), *by_role.get("deviation", [])):
            if quantity.dimension == dimension and not is_angle(quantity.unit):
                names = (*quantity.holders, quantity.name, quantity.ref_type)
                by_name.setdefault(names, []).append(quantity)
    return list(by_name.values())


def _with_references(
    forces: Sequence[CertifiedQuantity],
    deviations: Sequence[CertifiedQuantity],
    largest: CertifiedQuantity,
) -> list[tuple[CertifiedQuantity, CertifiedQuantity]]:
    """Return pairs of an indication or deviation and the force to which it belongs.

    ``forces`` are the forces that the certificate states. If they are as many as ``deviations``,
    beside them or altogether, both are in the same order. Otherwise, an indication belongs to the
    force that it is nearest to, and a ratio to ``largest``, the largest force.
    """
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


def _linearity(quantities: Sequence[CertifiedQuantity]) -> CertifiedQuantity | None:
    """Return the largest linearity error of a force device that the certificate states.

    The linearity error is the deviation from a straight line, as a ratio or as a force in
    newtons. To compare the errors, those in newtons are divided by the largest certified
    force. If several errors are equally large, return the last of them. Return None if no error
    is stated.
    """
    shares = quantities_by_role(quantities, "").get("linearity", [])
    newtons = quantities_by_role(quantities, "N").get("linearity", [])
    if not (shares or newtons):
        return None
    return sorted([*shares, *newtons], key=partial(_linearity_ratio, quantities))[-1]


def _linearity_ratio(
    quantities: Sequence[CertifiedQuantity], linearity: CertifiedQuantity
) -> float:
    """Return the absolute value of a force device's linearity error, divided by the force.

    An error that is stated as a ratio is not divided. An error in newtons is divided by the
    largest certified force. Raise an `InputError` for an error in newtons if no force is
    certified.
    """
    size = linearity.magnitude()
    if linearity.dimension == "":
        return size
    largest_force = largest_quantity(_forces(quantities))
    if largest_force is None or not largest_force.magnitude():
        raise InputError(
            f"{linearity.title!r} in newtons must come with forces, got none. Give"
            " linearity_percent by hand."
        )
    return size / largest_force.magnitude()


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
