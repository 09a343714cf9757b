"""Remarks beside the quantities of the test certificate: how far the readings determine each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ldbb_bayes.report.stated_quantity import StatedQuantity
from ldbb_bayes.report.translation import Words
from ldbb_bayes.units import display_unit, interval_statement, two_digits

if TYPE_CHECKING:
    from ldbb_bayes.analysis.verdicts import ChangeIdentifiability, ParameterIdentifiability


__all__ = ["remark"]


def remark(quantity: StatedQuantity, words: Words) -> str:
    """Return a short remark on how well the readings determine a quantity.

    Parameters
    ----------
    quantity
        Quantity that the test certificate states.
    words
        Texts of the certificate in its language.

    Returns
    -------
    str
        The remark in the language of the certificate, or an empty string if no remark is needed.
    """
    if quantity.direction:
        return _change_remark(quantity, words)
    if quantity.entry is None:
        confounded = ""
        if quantity.confounding_effects:
            partners = _partner_words(quantity.confounding_effects, words)
            confounded = words("remarks.confounded", partners=partners)
        return "; ".join(part for part in (quantity.note, confounded) if part)
    near_zero = ""
    if quantity.limit_near_zero is not None:
        factor, _ = display_unit(quantity.unit)
        limit = words.number(two_digits(quantity.limit_near_zero, factor))
        near_zero = words("remarks.near_zero", limit=limit)
    verdict = _verdict_remark(quantity.entry, words)
    return "; ".join(part for part in (quantity.note, near_zero, verdict) if part)


def _change_remark(quantity: StatedQuantity, words: Words) -> str:
    """Return a remark on the change of a compliance with force.

    The remark states whether the compliance increases or decreases, and the verdict on how well the
    readings determine the change. If the sign of the change is uncertain, the remark has no
    verdict, because the verdict "identified" would seem to contradict the uncertain sign. If the
    change is almost certainly zero (`StatedQuantity.is_exactly_none`), the remark has the interval
    of the changes that are not zero.
    """
    direction = words(f"remarks.{quantity.direction}")
    if quantity.direction == "no_change":
        if quantity.no_change == 0.0:
            return direction
        probability = words.percent(quantity.no_change)
        if quantity.if_any is None or not quantity.is_exactly_none:
            return words("remarks.exactly_none", probability=probability)
        statement = interval_statement(quantity.if_any, quantity.unit)
        return words(
            "remarks.none_or_between",
            probability=probability,
            low=words.number(statement.ends[0]),
            high=words.number(statement.ends[1]),
            unit=words.unit(statement.unit),
        )
    if quantity.change_entry is None:
        return direction
    return f"{direction}; {_verdict_remark(quantity.change_entry, words)}"


def _verdict_remark(entry: ParameterIdentifiability | ChangeIdentifiability, words: Words) -> str:
    """Return a short remark on how well the readings determine a parameter or a change.

    ``entry`` is the verdict on a parameter, or on the change of a compliance with force.
    """
    if entry.verdict == "confounded":
        partners = [
            words("remarks.partner", name=words.term(name), share=_percent(share, words))
            for name, share in entry.partner_shares.items()
        ]
        return words("remarks.confounded", partners=words.joined(partners))
    if entry.verdict == "prior-limited":
        return words("remarks.prior")
    return words(
        "remarks.identified",
        source=words.term(entry.held_by.name),
        share=_percent(entry.held_by.share, words),
        origin=words(f"origins.{entry.held_by.origin}"),
    )


def _percent(share: float, words: Words) -> str:
    """Return a share as a string in per cent, without decimals."""
    return words("percent", value=f"{100.0 * share:.0f}")


def _partner_words(names: Sequence[str], words: Words) -> str:
    """Return a string that names effects in words.

    ``names`` are the class names of the model terms that describe the effects.
    """
    return words.joined([words.term(name) for name in names])
