"""Units in sentences above a table, such as ``Readings in 0.0001 in, plus = bar longer``.

The sentence may be one of several statements of a line.
"""

from __future__ import annotations

import math
import re

from ldbb_bayes.reading.words import (
    ARE_STATED,
    LONGEST_TEXT,
    SHARE,
    UNITS,
    WORDS,
    comparable,
    scaled_unit,
    size_of_unit,
    unit_in_shares,
    unit_named,
)

__all__ = ["fraction_mentioned", "units_in_sentences"]

_WORDS = WORDS["unit_lines"]
# Regular expressions for sentences such as "All readings are in mm"; the keys are the roles reading
# and angle. The group ``behind`` matches the text after "in".
_STATED_IN = {
    role: re.compile(
        rf"(?<!\w){_WORDS[words]}{ARE_STATED}"
        r" (?P<in>in|en) (?P<behind>.*)",
        re.IGNORECASE,
    )
    for role, words in {"reading": "readings_in", "angle": "angles_in"}.items()
}
# Regular expression for the beginning of a line such as "Readings: tenths of a micron".
_ANNOUNCED = re.compile(rf"\W*{_WORDS['readings_in']}\s*[:=;|\t]\s*(?P<unit>[^;|\t(\[.,]+)", re.I)
# Regular expression for the text after "in": the words for the unit, and a remark in brackets, as
# in "mm (plus = longer)".
_PHRASE = re.compile(
    r"(?P<phrase>(?:[^;|\t()\[\].,]|[.,](?=\d))*)(?:[(\[](?P<remark>[^)\]]*)[)\]])?(?P<behind>.*)"
)
# Regular expression for a unit, with or without a factor, in front of words that say where angles
# begin, in which sense they are counted, or what the sign of readings means.
_UNIT_IN_FRONT = re.compile(
    rf"(?P<unit>(?:\d[\d.,/]*\s?)?[^\W\d_]{{2,}})\s+(?:{_WORDS['behind_unit']})(?!\w)",
    re.IGNORECASE,
)
# Regular expression for a line that begins with a word for readings and a unit in brackets,
# followed by a separator and further text, as in ``Readings [mm]; …``.
_IN_BRACKETS = re.compile(
    rf"\W*{_WORDS['readings_in']}\s*[\[(](?P<unit>[^\])]+)[\])]\s*[;,|\t]", re.IGNORECASE
)
# Regular expression for a word that stands for the readings, such as "deviations".
_READINGS = re.compile(rf"(?<!\w){_WORDS['readings_in']}(?!\w)", re.IGNORECASE)
# Regular expression for a decimal fraction of a unit, such as 0.0001 in or 1/1000 mm.
_FRACTION = re.compile(
    r"(?<![\w.,/])(?P<fraction>0[.,]0*1|1\s?/\s?10+)\s?(?P<unit>[^\W\d_]+|\")(?![\w/])"
)
# Regular expression for a word for a fraction of a unit, such as "thousandths", or for one count
# (digital step of an instrument).
_SHARE_OR_COUNT = re.compile(rf"{SHARE.pattern}|(?<!\w)(?:{_WORDS['count']})(?!\w)", re.IGNORECASE)
# Regular expression for units of readings that are not units of length, such as V.
_NO_LENGTH = re.compile(_WORDS["no_length"], re.IGNORECASE)
# Regular expression for words for quantities other than readings and angles, such as the radius.
_OTHER = re.compile(rf"\b(?:{_WORDS['other']})\b", re.IGNORECASE)
# Longest text that can be a unit after the word "in", as in "Readings in mm" [characters].
_LONGEST_UNIT = 20


def units_in_sentences(text: str) -> dict[str, str]:
    """Return a dict with the units that a line states in sentences.

    An example of a sentence is ``All readings are in mm``. The keys are ``reading_unit`` and
    ``angle_unit``. A sentence about another quantity, such as the radius, states no unit. An
    unknown unit at the end of the line is returned as written.
    """
    text = text[:LONGEST_TEXT]
    stated: dict[str, str] = {}
    unit = _unit_behind_readings(text)
    if unit:
        stated["reading_unit"] = unit
    for role, pattern in _STATED_IN.items():
        match = pattern.search(text)
        if match is None:
            continue
        phrase_and_remark = _PHRASE.fullmatch(match["behind"])
        if phrase_and_remark is None:
            continue
        end_of_phrase = match.start("behind") + phrase_and_remark.end("phrase")
        if _OTHER.search(text[:end_of_phrase]):
            continue
        phrase = phrase_and_remark["phrase"].strip()
        is_german = "winkel" in comparable(text)
        unit = _unit_of_phrase(phrase, (phrase_and_remark["remark"] or "").strip(), role, is_german)
        is_at_end = not phrase_and_remark["behind"].strip(" .;|\t)")
        # The French word "en" often stands before a word that is no unit, as in "mesures en XY".
        if not unit and is_at_end and match["in"].lower() == "in":
            unit = _unknown_unit(phrase)
        if unit:
            stated[f"{role}_unit"] = unit
    return stated


def _unit_behind_readings(text: str) -> str:
    """Return the unit after a word for readings at the beginning of a line.

    Examples of such lines are ``Readings: mm`` and ``Readings [mm]; …``. The result is empty for
    any other line.
    """
    bracketed = _IN_BRACKETS.match(text)
    if bracketed is not None and _is_of_role(scaled_unit(bracketed["unit"]), "reading"):
        return scaled_unit(bracketed["unit"])
    announced = _ANNOUNCED.match(text)
    if announced is not None and _is_unit_in_words(announced["unit"]):
        return str(announced["unit"]).strip()
    return ""


def _is_unit_in_words(text: str) -> bool:
    """Return whether a text is a unit of readings without a number, such as mm.

    The result is also True for a word such as "tenths", and for a fraction of a unit in words, such
    as ``tenths of a micron``.
    """
    is_plain = unit_named(text.strip()) in UNITS["reading"]
    # The word "tenths" alone does not say tenths of which unit are meant. It is accepted here, and
    # later code raises an error for it.
    is_share_alone = _SHARE_OR_COUNT.fullmatch(text.strip()) is not None
    return is_plain or is_share_alone or _is_of_role(unit_in_shares(text), "reading")


def _is_of_role(unit: str, role: str) -> bool:
    """Return whether a text is a known unit of the quantity ``role``, such as reading or angle."""
    return size_of_unit(role, unit) is not None


def _unit_of_phrase(phrase: str, remark: str, role: str, is_german: bool) -> str:
    """Return the unit in the words after "in", as in ``Readings in mm``; empty if there is none.

    If the remark states another unit, as in ``mm (0.0001 in)``, the result is both units, joined by
    "and". A word such as "tenths" without a unit, and a unit of readings that is no unit of length,
    such as V, are returned as written. Later code raises an error in these cases.

    Parameters
    ----------
    phrase
        Words after "in".
    remark
        Text in brackets after these words, such as ``0.0001 in``; empty if there is none.
    role
        Quantity whose unit is stated: reading or angle.
    is_german
        Whether the line has the German word for angle; the word Grad then means degree.
    """
    in_front = _UNIT_IN_FRONT.match(phrase)
    if in_front is not None:
        phrase = in_front["unit"]
    unit = scaled_unit(phrase)
    if role == "angle" and comparable(phrase) == "grad" and is_german:
        unit = "deg"
    unit_of_remark = scaled_unit(remark)
    is_share = _SHARE_OR_COUNT.search(phrase) is not None
    if _is_of_role(unit_of_remark, role) and (unit or is_share):
        return _unit_with_remark(unit, unit_of_remark, role)
    if _is_of_role(unit, role):
        return unit
    if is_share or (role == "reading" and _NO_LENGTH.fullmatch(phrase)):
        return phrase
    return ""


def _unit_with_remark(unit: str, unit_of_remark: str, role: str) -> str:
    """Return the unit of readings or angles from a text such as ``mm (0.001 mm)``.

    ``unit`` is the unit before the brackets, and ``unit_of_remark`` is the unit in brackets. If
    ``unit`` is empty, the unit in brackets is returned. If both units have the same size, ``unit``
    is returned. If they differ in size, both are returned, joined by "and". ``role`` is reading or
    angle.
    """
    if not unit:
        return unit_of_remark
    size = size_of_unit(role, unit) or 0.0
    size_of_remark = size_of_unit(role, unit_of_remark) or 0.0
    if math.isclose(size, size_of_remark, rel_tol=1e-9):
        return unit
    return f"{unit} and {unit_of_remark}"


def _unknown_unit(phrase: str) -> str:
    """Return ``phrase`` if it may be a unit that this package does not know; else an empty text.

    A short phrase may be such a unit if it is a single word, or if one of its words is a known
    unit, as in "um radial". For "the plane", for example, the result is empty.
    """
    words = phrase.split()
    names_unit = any(unit_named(word) for word in words)
    if len(phrase) <= _LONGEST_UNIT and (len(words) == 1 or names_unit):
        return scaled_unit(phrase) or phrase
    return ""


def fraction_mentioned(text: str) -> str:
    """Return the unit of readings from a line that states it as a fraction, such as 0.0001 inch.

    The result is empty if the line is not about readings or has no such fraction.
    """
    text = text[:LONGEST_TEXT]
    match = _FRACTION.search(text)
    if match is None or not _READINGS.search(text) or _OTHER.search(text):
        return ""
    if unit_named(match["unit"]) not in UNITS["reading"]:
        return ""
    return scaled_unit(f"{match['fraction'].replace(' ', '')} {match['unit']}")
