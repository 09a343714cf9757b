"""Certificates that could be bought for the instrument, each with its price."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from ldbb_bayes.analysis.value_of_certificates import CERTIFICATES
from ldbb_bayes.campaign.campaign import Ball, Instrument
from ldbb_bayes.errors import InputError, check_known, placed, require
from ldbb_bayes.results import Result

__all__ = ["CertificateOffer", "certified_with", "offers_in", "require_missing", "sets_of_offers"]

# Each key is a word that a user writes for a certificate, and each value is the key of this
# certificate in ``CERTIFICATES``. Certificates of balls are not included, because their names
# contain the grade, as in "balls G10".
_STATED_BY_WORD = {
    "bar": "bar ± 1 µm",
    "mount": "mount ± 2 %",
    "force": "force ± 0.5 %, linearity 0.2 %, random 1 N",
    "angle": "angle ± 0.05°",
}
_FIELDS_BY_BALLS = {
    "balls": ("work", "tool"),
    "work ball": ("work",),
    "tool ball": ("tool",),
}
# Words for the fields of the instrument that a certificate can state.
_WORDS_OF_FIELDS = {
    "work": "the work ball",
    "tool": "the tool ball",
    "bar_U_um": "the bar's length",
    "mount_U_percent": "the mount's deflection",
    "force_U_percent": "the force",
    "force_linearity_percent": "the force's linearity",
    "force_random_N": "the force's random error",
    "angle_U_deg": "the angle",
}
# Regular expression for the name of a certificate of balls. The name ends with the grade of the
# balls, as in "balls G10".
_BALLS = re.compile(r"(balls|work ball|tool ball)\s+(G\d+)", re.IGNORECASE)
# Largest number of certificates whose prices may be given for a search for the cheapest campaign.
# The number is limited because the search tries every set of certificates.
_MOST_OFFERS = 5


@dataclass(frozen=True)
class CertificateOffer(Result):
    """One certificate that could be bought: the values that it states, and its price."""

    #: name of the calibration certificate. For example, "balls of grade G10" is a certificate that
    #: states the grade, and with it the largest form error, of both balls.
    name: str
    price: float  #: price of the calibration certificate, in the unit of money of `Costs`
    #: values that the calibration certificate states for properties of the instrument; the keys are
    #: the names of these properties as attributes of `Instrument`
    statements: Annotated[Mapping[str, Any], Field(exclude=True)] = field(default_factory=dict)


def offers_in(stated: Mapping[str, float]) -> tuple[CertificateOffer, ...]:
    """Return the certificates that a user can buy, from their names and prices.

    Parameters
    ----------
    stated
        Prices of the certificates; the keys are the names of the certificates. The names are:

        - "balls G10", "work ball G5" and "tool ball G5": form errors of one ball or of both; other
          grades are possible;
        - "bar": length of the bar, to 1 µm;
        - "mount": deflection of the work ball's mount, to 2 %;
        - "force": force measurement, with a gain error of at most 0.5 %, a linearity error of at
          most 0.2 % and a random error of 1 N;
        - "angle": angle of the readings, to 0.05°.

    Returns
    -------
    tuple of CertificateOffer
        The certificates, in the order of ``stated``.

    Raises
    ------
    InputError
        For an unknown certificate, a price below zero, or more than five certificates.
    """
    require(
        len(stated) <= _MOST_OFFERS,
        f"certificates must be at most {_MOST_OFFERS}, got {len(stated)}: every set of them is"
        " tried. Leave out the dearest.",
    )
    offers = []
    for word, price in stated.items():
        require(
            np.isfinite(price) and price >= 0.0,
            f"the price of certificate {word!r} must be a number of at least 0, got {price}."
            " Correct it.",
        )
        offers.append(_offer_of(word.strip(), float(price)))
    return tuple(offers)


def _offer_of(word: str, price: float) -> CertificateOffer:
    """Return the certificate with the name ``word``, for example "balls G10", and its price."""
    balls = _BALLS.fullmatch(word)
    if balls is not None:
        with placed(f"certificate {word!r}"):
            ball = Ball(grade=balls[2].upper())
        kind = balls[1].lower()
        statements = dict.fromkeys(_FIELDS_BY_BALLS[kind], ball)
        return CertificateOffer(f"{kind} of grade {balls[2].upper()}", price, statements)
    if word.lower() in _FIELDS_BY_BALLS:
        raise InputError(
            f"certificate {word!r} must state the grade of the ball, got none. Write for example"
            f" {word} G10."
        )
    check_known("certificate", [word], ["balls G10", *_STATED_BY_WORD])
    name = _STATED_BY_WORD[word]
    return CertificateOffer(name, price, CERTIFICATES[name])


def require_missing(offers: Sequence[CertificateOffer], instrument: Instrument) -> None:
    """Raise an `InputError` if the instrument already has what one of the ``offers`` certifies.

    An example is a certificate of both balls if the grade of one ball is stated already.
    """
    for offer in offers:
        certified = _certified_fields(offer, instrument)
        if not certified:
            continue
        missing = [key for key in offer.statements if key not in certified]
        advice = "Leave this certificate out."
        if missing in (["work"], ["tool"]):
            grade = offer.statements[missing[0]].grade
            advice = f"Offer '{missing[0]} ball {grade}' instead, or leave this certificate out."
        listed = " and ".join(_WORDS_OF_FIELDS[key] for key in certified)
        raise InputError(
            f"certificates must state what the campaign does not state yet, got {offer.name!r}, and"
            f" the campaign states {listed}. {advice}"
        )


def _certified_fields(offer: CertificateOffer, instrument: Instrument) -> list[str]:
    """Return those fields that a certificate states and that the instrument states already."""
    uncertified = Instrument()
    return [
        key for key in offer.statements if getattr(instrument, key) != getattr(uncertified, key)
    ]


def sets_of_offers(
    offers: Sequence[CertificateOffer], instrument: Instrument
) -> tuple[tuple[CertificateOffer, ...], ...]:
    """Return all sets of certificates that could be bought for an instrument.

    A certificate is left out if it states a property, such as the length of the bar, that is
    already certified for the instrument. Sets in which two certificates state the same property are
    left out too. The first set is empty.
    """
    useful = [offer for offer in offers if not _certified_fields(offer, instrument)]
    sets: list[tuple[CertificateOffer, ...]] = []
    for number in range(len(useful) + 1):
        for chosen in combinations(useful, number):
            keys = [key for offer in chosen for key in offer.statements]
            if len(keys) == len(set(keys)):
                sets.append(chosen)
    return tuple(sets)


def certified_with(instrument: Instrument, offers: Sequence[CertificateOffer]) -> Instrument:
    """Return the instrument, completed with the values that the certificates ``offers`` state."""
    statements: dict[str, Any] = {}
    for offer in offers:
        statements.update(offer.statements)
    return replace(instrument, **statements)
