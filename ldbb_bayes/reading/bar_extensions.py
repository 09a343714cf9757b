"""Length of a bar with its extension, from a line such as ``Bar: 100 mm + extension 50 mm``."""

from __future__ import annotations

import math
import re

from ldbb_bayes.reading.numerals import number_in_text
from ldbb_bayes.reading.words import OTHER_QUANTITY, UNITS, WORDS, unit_named

__all__ = ["length_of_sum", "names_extension"]

# Regular expression for a plus sign between lengths. It does not match the plus in "+ = longer",
# which states a sign, or in "+Y", which states a direction.
_PLUS = re.compile(r"\+(?!\s*[=:]|[XYZ](?!\w)|ve\b)|\bplus\b(?!\s*[=:])", re.IGNORECASE)
# Regular expression for signs before a tolerance, such as +/- 0.01.
_TOLERANCE = re.compile(r"\+\s?[/\-−]|±")
_LENGTH = re.compile(r"(?<![\w.,])(?P<number>\d+(?:[.,]\d+)?)\s?(?P<unit>[^\W\d_]+|\")?")
_EXTENSION_WORDS = WORDS["bar_extension"]["words"]
_EXTENSION = re.compile(
    rf"(?<!\w)(?:{_EXTENSION_WORDS})(?!\w)[\s:=;,|\t]*(?:of\s|von\s|de\s)?"
    r"\d+(?:[.,]\d+)?\s?(?:mm|cm|in|\")"
    rf"|\d\s?(?:mm|cm|in|inch|\")[\s-](?:{_EXTENSION_WORDS})(?!\w)",
    re.IGNORECASE,
)
# Smallest length that counts as a bar or an extension [mm]. A shorter length after a plus sign is
# taken to be a tolerance; the text is then not a sum of lengths.
_SMALLEST_MM = 10.0
_MM_PER_UM = 1e-3


def names_extension(text: str) -> bool:
    """Return whether a text names an extension of the bar and states the extension's length."""
    return _EXTENSION.search(text) is not None


def length_of_sum(text: str) -> float | None:
    """Return the sum [mm] of lengths in a text, such as 150 for ``100 mm + extension 50 mm``.

    Return None if the text is not a sum of lengths. This is the case if it has no plus sign, if its
    last length has no unit, or if one of its lengths is less than 10 mm: in ``100 mm + 0.01 mm``,
    the second length is a tolerance.

    Return NaN if the text has a plus sign, but the sum is uncertain. This is the case if the text
    before or after a plus sign has no length, has several lengths, or names another quantity.
    """
    terms = _PLUS.split(text)
    if len(terms) < 2 or _TOLERANCE.search(text):
        return None
    total = 0.0
    size_um = None
    for term in reversed(terms):
        matches = list(_LENGTH.finditer(term))
        if len(matches) != 1 or OTHER_QUANTITY.search(term):
            return math.nan
        # A number without a unit has the unit of the next number: 100 + 50 mm means 100 mm + 50 mm.
        size_um = UNITS["reading"].get(unit_named(matches[0]["unit"] or ""), size_um)
        value = number_in_text(matches[0]["number"])
        if size_um is None or value is None:
            return None
        length_mm = value * size_um * _MM_PER_UM
        if length_mm < _SMALLEST_MM:
            return None
        total += length_mm
    return total
