"""Deviation of a ball from sphericity, from what a calibration certificate states."""

from __future__ import annotations

from collections.abc import Sequence

from ldbb_bayes.campaign.certified_quantity import (
    METRES_PER_MICROMETRE,
    CertifiedFields,
    CertifiedQuantity,
    quantities_by_role,
    quantities_in_words,
    without_rounding,
)
from ldbb_bayes.errors import InputError

__all__ = ["ball_fields"]


def ball_fields(quantities: Sequence[CertifiedQuantity]) -> CertifiedFields:
    """Return a ball's deviation from sphericity [µm], with the key sphericity_um of campaign.toml.

    Its expanded uncertainty (k = 2) is added to it. If the certificate states several form
    deviations of the ball, the largest sum is returned. Raise an `InputError` if it states none.
    """
    largest_bound = 0.0
    largest = None
    for deviation in quantities_by_role(quantities, "m").get("form", []):
        value, U = deviation.numbers(METRES_PER_MICROMETRE)
        if largest is None or value + U >= largest_bound:
            largest_bound = value + U
            largest = deviation
    if largest is None:
        raise InputError(
            "the DCC must state the form of a ball by a name or refType, got"
            f" {quantities_in_words(quantities)}. Give sphericity_um by hand."
        )
    return CertifiedFields({"sphericity_um": without_rounding(largest_bound)}, (largest,))
