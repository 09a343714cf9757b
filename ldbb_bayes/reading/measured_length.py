"""Texts in headers and lines that say whether readings measure the radius or the diameter."""

from __future__ import annotations

import re

from ldbb_bayes.reading.line_parts import segments_of_line
from ldbb_bayes.reading.names import LOAD_IN_NAME
from ldbb_bayes.reading.words import LONGEST_TEXT, OTHER_QUANTITY, WORDS, comparable

__all__ = [
    "doubles_readings",
    "leaves_length_open",
    "may_be_diameter",
    "measured_length",
    "measured_length_stated",
    "names_diameter",
]

_WORDS = WORDS["diameters"]
# Regular expression for a header or text that names a diameter.
_DIAMETER = re.compile(rf"(?<![a-zäöüéèáâ])(?:{_WORDS['header']})")
# Regular expression for a word for diameter inside a longer word, such as Kreisdurchmesser.
_LONG_WORD = re.compile("durchmesser|diamet")
# Regular expression for the letter D as a word of its own in a header; it may mean the diameter.
_LETTER = re.compile(_WORDS["letter"])
_RADIAL = re.compile(_WORDS["radial"])
# Regular expression for words, such as "not", that negate what follows them.
_DENIED = re.compile(_WORDS["denied"])
# Regular expression for the beginning of a text, up to the first punctuation mark, such as a comma.
_TO_NEXT_MARK = re.compile(r"[^,;:()|\t]*")
# Regular expression for words which show that a line is about the readings.
_READINGS = re.compile(_WORDS["line"])
# Regular expression for words which show that a diameter in a text is not what the readings
# measure.
_OTHER = re.compile(_WORDS["other"])
# Regular expression for words which say that readings are doubled.
_DOUBLED = re.compile(_WORDS["doubled"])
# Regular expression for the number of a column, as in "Column 2: diameter deviation".
_NUMBER_OF_COLUMN = re.compile(r"\b(?:col(?:umn)?|spalte|channel|kanal|ch)\.? ?\d+")
# Regular expression for a number with a unit of length, or a number at the end of a text.
_LENGTH_BEFORE = re.compile(r"\d\s*(?:(?:[µuμ]m|mm|cm|m|in|inch|\")(?![^\W_])|$)")


def measured_length(text: str) -> str:
    """Return "radius" or "diameter", depending on which of the two lengths a text names.

    The result is an empty string if the text names neither or both.
    """
    words = _without_denied_lengths(comparable(text[:LONGEST_TEXT]))
    is_diameter = _DIAMETER.search(words) is not None or _LONG_WORD.search(words) is not None
    is_radial = _RADIAL.search(words) is not None
    if is_diameter == is_radial:
        return ""
    return "diameter" if is_diameter else "radius"


def _without_denied_lengths(words: str) -> str:
    """Remove a negated length from words, such as ``of the diameter (not of the radius)``.

    If the words before the negation name a length, all words after it are removed. If they do not,
    only the words up to the next punctuation mark, such as a comma, are removed.
    """
    denial = _DENIED.search(words)
    if denial is None:
        return words
    before = words[: denial.start()]
    if any(pattern.search(before) for pattern in (_DIAMETER, _LONG_WORD, _RADIAL)):
        return before
    return before + _TO_NEXT_MARK.sub("", words[denial.end() :], count=1)


def measured_length_stated(text: str) -> dict[str, str]:
    """Return which length readings measure according to a line: the radius or the diameter.

    The result is a dict. For the line ``Values: diameter deviation``, it is {"measured":
    "diameter"}. It is empty if the line does not name exactly one of the two lengths, if it is not
    about readings, or if it contains a number other than a load or the number of a column. If the
    line as a whole states no length, each of its segments is examined by itself: in ``Run 3;
    diameter deviation``, the last segment states the diameter.
    """
    lengths = {_length_of_readings(text)}
    if lengths == {""}:
        lengths = {_length_of_readings(segment) for segment in segments_of_line(text)}
    lengths.discard("")
    if len(lengths) != 1:
        return {}
    return {"measured": lengths.pop()}


def _length_of_readings(text: str) -> str:
    """Return "radius" or "diameter" if a text says that readings measure this; otherwise ""."""
    words = _without_numbers_of_others(text)
    if _READINGS.search(words) is None or re.search(r"\d", words):
        return ""
    return measured_length(words)


def _without_numbers_of_others(text: str) -> str:
    """Return a text in lower case, without loads and without words such as ``column 2``.

    A load is a number with a unit of force or pressure, such as ``36 N``.
    """
    return _NUMBER_OF_COLUMN.sub("", LOAD_IN_NAME.sub("", comparable(text[:LONGEST_TEXT])))


def doubles_readings(text: str) -> bool:
    """Return whether a line says that readings are doubled: ``Values: 2 x radial deviation``."""
    words = comparable(text[:LONGEST_TEXT])
    is_about_readings = _READINGS.search(words) or _RADIAL.search(words)
    return is_about_readings is not None and _DOUBLED.search(words) is not None


def may_be_diameter(header: str) -> bool:
    """Return whether a header may mean the diameter, although it does not contain this word.

    Such a header contains the letter D as a word of its own, or says that readings are doubled.
    Examples are ``D [um]`` and ``2 x dR``. Words for the diameter are found by `measured_length`.
    """
    words = comparable(header[:LONGEST_TEXT]).replace("_", " ")
    return _LETTER.search(words) is not None or _DOUBLED.search(words) is not None


def leaves_length_open(text: str) -> bool:
    """Return whether a line may mean that the readings are diameters; it need not say so clearly.

    Examples are ``Mode: diameter``, and a title such as ``Table 3: diameter deviation``. The result
    is False if the line states the value of a diameter, or is about another subject. If the result
    is False for the line as a whole, each of its segments is examined by itself.
    """
    return any(_may_be_measured_diameter(passage) for passage in (text, *segments_of_line(text)))


def _may_be_measured_diameter(text: str) -> bool:
    """Return whether a text may mean that the readings are diameters.

    The result is False if the text states the value of a diameter, or is about another subject.
    """
    words = _without_numbers_of_others(text)
    if _OTHER.search(words) or OTHER_QUANTITY.search(words) or _states_diameter(words):
        return False
    return measured_length(words) == "diameter"


def _states_diameter(words: str) -> bool:
    """Return whether a text names a diameter and has a number that may be its value.

    A number may be the value if it stands after the word for diameter, or directly before this
    word. An earlier number may be the value only if it has a unit of length. The 3 in ``table 3:
    diameter deviation`` has none, and is therefore not the value of a diameter.
    """
    match = _DIAMETER.search(words) or _LONG_WORD.search(words)
    if match is None:
        return False
    has_number_behind = re.search(r"\d", words[match.end() :]) is not None
    return has_number_behind or _LENGTH_BEFORE.search(words[: match.start()]) is not None


def names_diameter(name: str) -> bool:
    """Return whether a name has a word for diameter that is not followed by a number.

    ``name`` is the name of a file or test.
    """
    words = re.split(r"[\W_]+", name[:LONGEST_TEXT])
    for word, next_word in zip(words, [*words[1:], ""], strict=True):
        if measured_length(word) == "diameter" and not re.search(r"\d", word + next_word):
            return True
    return False
