"""Error of a bar's length, from the lengths that a calibration certificate states."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from ldbb_bayes.campaign.certified_quantity import (
    METRES_PER_MICROMETRE,
    MOST_QUANTITIES_LISTED,
    CertifiedFields,
    CertifiedQuantity,
    only_quantity,
    quantities_by_role,
    quantities_in_words,
    without_rounding,
)
from ldbb_bayes.errors import InputError, require

__all__ = ["bar_fields"]

# Pattern of a length in the name of a bar, such as 100 mm.
_LENGTH_IN_NAME = re.compile(r"(?<![\d.,])(\d+(?:[.,]\d+)?)\s?mm\b")
# Largest error of a bar's length [µm] that a certificate may state. A larger number is a length.
_LARGEST_LENGTH_ERROR_UM = 1000.0
# Two nominal lengths of a ball bar count as equal if they differ by at most this fraction of the
# length.
_NOMINAL_TOLERANCE = 1e-3


def bar_fields(
    quantities: Sequence[CertifiedQuantity], length_mm: float | None = None
) -> CertifiedFields:
    """Return the length error of a bar and its expanded uncertainty.

    The keys are named as in the table [bar] of campaign.toml: length_error_um [µm] and U_um (k = 2)
    [µm]. The length error is the amount by which readings are too large. It is computed from what
    the certificate states:

    - An error of indication is used unchanged.
    - A deviation from the nominal length is used with the opposite sign, because the readings of a
      bar that is too long are too small.
    - An actual length is subtracted from the nominal length.

    If the certificate describes several bars, the bar of the nominal length ``length_mm`` is used.
    Raise an `InputError` if no uncertainty is stated, or if the certificate still states several
    errors after the bar has been chosen, or if it states that its only bar has another nominal
    length.
    """
    lengths = quantities_by_role(quantities, "m")
    if not _candidates(lengths):
        raise InputError(
            "the DCC must state the error of a bar's length by a name or refType, got"
            f" {quantities_in_words(quantities)}. Give length_error_um and U_um by hand."
        )
    quantity = _quantity_of_bar(lengths, length_mm)
    error, U = _error_of_length(quantity, lengths)
    return CertifiedFields({"length_error_um": error, "U_um": U}, (quantity,))


def _candidates(lengths: Mapping[str, list[CertifiedQuantity]]) -> list[CertifiedQuantity]:
    """Return the certified quantities that may state the error of a bar's length.

    These are errors of indication if the certificate states one. Otherwise they are deviations from
    the nominal length or, if there is none, actual lengths that are stated together with the
    nominal length. ``lengths`` is a dictionary of lists of all certified lengths; its keys are
    roles such as ``deviation``.
    """
    candidates = lengths.get("indication") or lengths.get("deviation") or []
    if not candidates and "nominal" in lengths:
        return lengths.get("length", [])
    return candidates


def _quantity_of_bar(
    lengths: Mapping[str, list[CertifiedQuantity]], length_mm: float | None
) -> CertifiedQuantity:
    """Return the certified quantity that states the error of a bar's length.

    If the certificate describes several bars, the bar with the nominal length ``length_mm`` is
    chosen. ``lengths`` is a dictionary of lists of all certified lengths; its keys are roles such
    as ``deviation``. Raise an `InputError` if several quantities state an error.
    """
    candidates = _candidates(lengths)
    nominals = lengths.get("nominal", [])
    if len(candidates) > 1 and length_mm is not None:
        of_length = []
        for quantity in candidates:
            if _is_of_length(quantity, nominals, length_mm):
                of_length.append(quantity)
        candidates = of_length or candidates
    if len(candidates) > 1:
        raise _several_errors(candidates, lengths)
    if length_mm is not None:
        _check_nominal_length(candidates[0], nominals, length_mm)
    return candidates[0]


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
    value, U = quantity.numbers(METRES_PER_MICROMETRE)
    if not U:
        raise InputError(
            f"{quantity.title!r} must have an uncertainty, got none. Give U_um by hand."
        )
    nominals = lengths.get("nominal", [])
    is_length = quantity.role == "length" or abs(value) > _LARGEST_LENGTH_ERROR_UM
    if is_length and nominals:
        nominals_beside = [nominal for nominal in nominals if nominal.holders == quantity.holders]
        nominal = only_quantity(nominals_beside or nominals)
        value -= nominal.numbers(METRES_PER_MICROMETRE).value
    require(
        abs(value) <= _LARGEST_LENGTH_ERROR_UM,
        f"the error of the bar's length must be at most {_LARGEST_LENGTH_ERROR_UM:g} µm, got"
        f" {value:g} µm from {quantity.title!r}. Give length_error_um and U_um by hand.",
    )
    # A bar that is too long gives readings that are too small.
    error = value if quantity.role == "indication" else 0.0 - value
    return without_rounding(error), U


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
    for quantity in candidates[:MOST_QUANTITIES_LISTED]:
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
