"""Name and unit that the header of a column states, as in ``Angle [deg]`` and ``reading_um``."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

from ldbb_bayes.reading.names import LOAD_IN_NAME
from ldbb_bayes.reading.role_words import KEPT_HEADERS, has_role
from ldbb_bayes.reading.unit_lines import COUNT
from ldbb_bayes.reading.words import (
    LONGEST_NAME,
    UNITS,
    WORDS,
    comparable,
    joined_prefixes,
    unit_in_shares,
    unit_named,
)

__all__ = ["BRACKET", "Header", "unit_of"]

# Regular expression for the opening bracket in front of the unit in a header.
BRACKET = re.compile(r"[\[({<]")
# Regular expression for a text in brackets in a header.
_INSIDE_BRACKETS = re.compile(r"[\[({<]\s*([^\[\](){}<>]+?)\s*(?=[\[\](){}<>])")
# Regular expression for a range before a unit of angle in a header, such as 0-360°.
_RANGE = re.compile(r"-?\d+\s*(?:-|–|to|\.\.\.?)\s*\d+\s*(?=°|deg)")
# Regular expression for words that stand before a unit in brackets, such as "in" in "(in mm)".
_BEFORE_UNIT = re.compile(r"^(?:all\s)?(?:in|units?|einheit)\s?:?\s(?=\S)", re.IGNORECASE)
# Regular expression for a factor before a unit in a header, as in "10-3 mm" (10⁻³ mm), "x 10 µm" or
# "0.1 µm". The number of a run, as in "run1", is no factor.
_FACTOR = re.compile(r"[x×*]|(?!(?!mal|times)[^\W\d_]{2,}\d{1,2}$)\S*[\d⁰¹²³⁴⁵⁶⁷⁸⁹]\S*")
# Regular expression for the number of a column in its header, such as 2 in "reading 2 µm". The
# number has one or two digits. It is not 10, which is a factor of the unit, as in "10 µm".
_COLUMN_NUMBER = re.compile(r"(?!10)\d{1,2}")
# Regular expression for the header of a column in a table of the program R, which has dots in place
# of blanks and brackets, such as ``force..lbf.``.
_HEADER_WITH_DOTS = re.compile(r"[^\W\d_][\w.]*\.[\w.]*")
# Regular expression for the dots that the program R writes in a header in place of blanks and other
# characters. Decimal points are not matched.
_DOTS = re.compile(r"(?<!\d)\.+|\.+(?!\d)")
# Regular expression for a unit whose first character is missing in a header that the program R
# wrote. R writes a dot for each blank, bracket and µ, so that `` (µm)`` becomes ``...m.``.
_LOST_SIGN = re.compile(r"\.{3,}(?:m|s|N|in|inch)\.$")
# Regular expression for the number that the program R adds to the second of two equal headers.
_NUMBER_OF_EQUAL = re.compile(r"\.\d+$")
# Regular expression for a word which shows that the next word is not a unit, such as "of" in "Angle
# of turn".
_BEFORE_NO_UNIT = re.compile(WORDS["columns"]["before_no_unit"], re.IGNORECASE)
# Regular expressions for two kinds of words before a unit. The first is for a word that multiplies
# or divides the unit, such as "half". The second is for a word that may stand between this word and
# the unit, such as "of".
_MULTIPLIER = re.compile(WORDS["columns"]["multiplier"], re.IGNORECASE)
_BETWEEN = re.compile(WORDS["columns"]["between"], re.IGNORECASE)
# For each role of a column, such as force, the regular expression for headers that end with a unit
# that this package does not read. The keys are the roles.
_FOREIGN_UNITS = {
    role: re.compile(
        rf"(?P<name>.*[^\W_])[\s_/.,]+(?P<unit>{WORDS['columns'][f'foreign_{role}']})\.?", re.I
    )
    for role in ("force", "pressure", "reading", "angle")
}
# Regular expression for a factor and a unit without a blank between them, as in "Reading 0.1um" and
# "reading_10um".
_FACTOR_AND_UNIT = re.compile(r"(?<![^\W_])(?:0[.,]?\d+|10+)(?P<unit>[^\W\d_]+)$")
# Units whose words may also mean a way, such as the Spanish "vuelta" (way back).
_WORDS_FOR_WAYS = ("turn",)
# Regular expression for a load at the end of the text before a word, as in "300 N vuelta".
_LOAD_AT_END = re.compile(rf"{LOAD_IN_NAME.pattern}$", re.IGNORECASE)
# Regular expression for a length at the end of a name, as in "deviation from 150 mm".
_LENGTH_WITH_NUMBER = re.compile(r"(?<=\s)[1-9]\d+\s?mm$")
# Regular expression for the number of a column behind its unit, as in "Reading [um] 2".
_NUMBER_BEHIND = re.compile(r"\s+(?!10)\d{1,2}\s*")
# Regular expressions for a name and its unit, with "in" or a separator between them.
_UNIT_AFTER_IN = re.compile(r"(.*?)\s+in\s+(.+)")
_UNIT_AT_END = re.compile(r"(.*?)(?:\s*/\s*|_|\s*,\s*|\s+)([^\s/_,\d]+)\s*")
# Regular expression for a difference of two radii that defines the readings, such as "nominal -
# measured".
_DIFFERENCE = re.compile(
    rf"\s*(?:{WORDS['reading_sign']['nominal_less_actual']}"
    rf"|{WORDS['reading_sign']['actual_less_nominal']})\s*"
)


class Header(NamedTuple):
    """Name and unit that the header of a column states."""

    name: str
    #: name that this package uses for the unit; for an unknown unit, the text in the header; empty
    #: if the header states no unit
    unit: str


@lru_cache(maxsize=KEPT_HEADERS)
def unit_of(header: str) -> Header:
    """Return the name and the unit that a header states: "Angle" and "deg" for ``Angle [°]``.

    The unit is empty if the header states none. An unknown unit, in brackets or after "in", is
    returned as the text in the header; later code raises an error for it only if the column is
    used. If a header states two units of one quantity, such as mm and µm, both are returned as one
    text, which later code treats as an unknown unit.
    """
    header = joined_prefixes(header)
    stated = _with_multiplier(_unit_between_dots(header) or _name_and_unit(header))
    behind = re.split(r"[\])}>]", header)[-1]
    for text in (stated.name, behind):
        words = re.split(r"[\s_]+", _LENGTH_WITH_NUMBER.sub("", text.strip()))
        if _contradicts(words[-1], stated.unit):
            return Header(stated.name, f"{words[-1]} and {stated.unit}")
    return stated


def _unit_between_dots(header: str) -> Header | None:
    """Return the name and unit of a header in which the program R put dots for blanks and brackets.

    Examples are ``force..lbf.`` for ``force [lbf]``, and ``deviation.thousandths.of.an.inch``.
    Return None for any other header, and for one that states no unit.
    """
    header = _NUMBER_OF_EQUAL.sub("", header.strip()[:LONGEST_NAME])
    if _HEADER_WITH_DOTS.fullmatch(header) is None:
        return None
    if _LOST_SIGN.search(header):
        return Header(_DOTS.split(header)[0], f"?{_DOTS.split(header.strip('.'))[-1]}")
    words = _DOTS.sub(" ", header).split()
    for k in range(1, len(words)):
        unit = " ".join(words[k:])
        if _BEFORE_NO_UNIT.fullmatch(words[k - 1]) or _FACTOR.fullmatch(words[k - 1]):
            continue
        if unit_named(unit) or unit_in_shares(unit):
            return Header(" ".join(words[:k]), unit_named(unit) or unit)
    stated = _unit_at_end(" ".join(words))
    return stated if stated.unit else None


def _with_multiplier(stated: Header) -> Header:
    """Return a header after moving words that multiply the unit from the name to the unit.

    For the name "Angle half" and the unit deg, the unit becomes the text "half deg". Later code
    raises an error for such a text unless it is a known fraction of a unit, such as "tenths of a
    deg".
    """
    words = re.split(r"[\s_.]+", stated.name)
    first = len(words)
    while first > 1 and (_MULTIPLIER.fullmatch(words[first - 1]) or _is_between(words, first - 1)):
        first -= 1
    multiplier = words[first:]
    if not stated.unit or not multiplier or _BETWEEN.fullmatch(multiplier[0]):
        return stated
    return Header(" ".join(words[:first]), " ".join([*multiplier, stated.unit]))


def _is_between(words: Sequence[str], k: int) -> bool:
    """Return whether a word of a header, such as "of", may stand between a multiplier and a unit.

    A multiplier is a word such as "half". ``words`` are the words of the header, and ``k`` is the
    index of the word.
    """
    return k > 1 and _BETWEEN.fullmatch(words[k]) is not None


def _contradicts(word: str, unit: str) -> bool:
    """Return whether a word of a header is a unit that contradicts ``unit``.

    The word contradicts if it is another unit of the same quantity.
    """
    other = unit_named(word)
    if other in ("", unit) or len(word) < 2 or comparable(word) == "in":
        return False
    return any(other in units and unit in units for units in UNITS.values())


def _name_and_unit(header: str) -> Header:
    """Return the name and the unit that a header states in brackets or one after the other.

    Examples are ``Angle [deg]``, ``[deg] Angle``, ``Angle in deg`` and ``Angle, deg``. A number
    after the brackets, as in ``Reading [um] x 10``, may be a factor; the unit is then returned as a
    text that later code treats as an unknown unit.
    """
    header = header.strip().lstrip("#%").strip()
    if len(header) > LONGEST_NAME:
        return Header(header, "")
    name = BRACKET.split(header)[0].strip(" _")
    if not name:  # the unit precedes the name, as in "[mm] Reading"
        name = re.sub(r"[\[({<][^\])}>]*[\])}>]", "", header).strip(" _")
    before_brackets = _unit_before_remark(header, name)
    if before_brackets is not None:
        return before_brackets
    bracketed = []
    for text in _INSIDE_BRACKETS.findall(header):
        bracketed.append(_BEFORE_UNIT.sub("", _RANGE.sub("", text)))
    if name and bracketed:
        after_brackets = re.split(r"[\])}>]", header)[-1].removesuffix(name)
        is_scaled = re.search(r"\d", after_brackets) is not None
        if _NUMBER_BEHIND.fullmatch(after_brackets):
            is_scaled = False
        is_after_in = _UNIT_AFTER_IN.fullmatch(header) is not None
        return Header(name, _stated_unit(name, bracketed, is_scaled and not is_after_in))
    after_in = _UNIT_AFTER_IN.fullmatch(header)
    if after_in:
        name = after_in[1].strip(" _")
        bracketed = [after_in[2].strip()]
    if name and bracketed:
        return Header(name, _stated_unit(name, bracketed, is_scaled=False))
    return _unit_at_end(header)


def _unit_before_remark(header: str, name: str) -> Header | None:
    """Return the name and unit of a header in which a remark in brackets follows them.

    An example is "Reading, µm (radial)". Return None for any other header. ``name`` is the part of
    the header before its first bracket, here "Reading, µm".
    """
    remarks = _INSIDE_BRACKETS.findall(header)
    if len(remarks) != 1 or not re.fullmatch(r"[^\W\d_]{4,}(?: [^\W\d_]+)*", remarks[0]):
        return None
    if unit_named(remarks[0]):
        return None
    header_before_bracket = _unit_at_end(name)
    if header_before_bracket.unit in ("", name) or not unit_named(header_before_bracket.unit):
        return None
    return header_before_bracket


def _stated_unit(name: str, texts: Sequence[str], is_scaled: bool) -> str:
    """Return the unit that the header of a column states in brackets or after "in".

    ``name`` is the name of the column, and ``texts`` are the texts in brackets or after "in". If
    they state exactly one known unit, this unit is returned. If they state no known unit, or
    several, the texts are returned, joined by "and". The texts are also returned, followed by "…",
    if a number stands behind the brackets (``is_scaled``) and may multiply the unit. Later code
    raises an error for such a result, because it is not a known unit.
    """
    is_german_angle = comparable(name).startswith("winkel")
    if is_german_angle and len(texts) == 1 and comparable(texts[0]) == "grad":
        # In German, Grad means degree; in other languages a grad is a hundredth of a right angle.
        return "deg"
    if len(texts) == 1 and unit_in_shares(texts[0]):
        return texts[0]
    texts = [_without_definition(text) for text in texts]
    units = {unit_named(text) for text in texts} - {""}
    if len(units) == 1 and not is_scaled:
        return units.pop()
    stated = " and ".join(texts)
    if is_scaled:
        return f"{stated} …"
    return stated


def _without_definition(text: str) -> str:
    """Return the unit in a text in which a definition of the readings follows the unit.

    An example is ``mm, nominal - measured``. Any other text is returned unchanged.
    """
    unit, _, definition = text.partition(",")
    if unit_named(unit.strip()) and _DIFFERENCE.fullmatch(comparable(definition)):
        return unit.strip()
    return text


def _with_factor_apart(header: str) -> str:
    """Return a header with a blank between factor and unit.

    For example, ``Reading 0.1um`` becomes ``Reading 0.1 um``. Other headers are not changed.
    """
    joined = _FACTOR_AND_UNIT.search(header)
    if joined is None or unit_named(joined["unit"]) not in UNITS["reading"]:
        return header
    return f"{header[: joined.start('unit')]} {joined['unit']}"


def _unit_at_end(header: str) -> Header:
    """Return the name and the unit of a header that ends with its unit, such as ``reading_um``.

    A factor in front of the unit, as in ``Reading 10 um``, becomes part of the unit: ``(10) um``,
    which later code treats as an unknown unit. The unit is empty if the header does not end with a
    unit, or if its last word belongs to the name, as in ``Angle of turn``.
    """
    written = header
    header = _with_factor_apart(written)
    match = _UNIT_AT_END.fullmatch(header)
    if not match:
        return _unread_unit_at_end(header)
    name = match[1].strip(" _")
    unit = unit_named(match[2])
    if comparable(match[2]) == "grad" and comparable(name).startswith("winkel"):
        unit = "deg"  # in German, Grad means degree
    if not unit and COUNT.fullmatch(comparable(match[2])) and has_role(name, "reading"):
        # The readings are counts (digital steps); the size of one count must be stated elsewhere.
        return Header(name, match[2])
    if not unit:
        return _unread_unit_at_end(header)
    last_word = re.split(r"[\s_]+", name)[-1]
    if _BEFORE_NO_UNIT.fullmatch(last_word) or _is_way(name, unit):
        return Header(header, "")
    if _is_factor(last_word, is_joined=header != written):
        return Header(name, f"({last_word}) {unit}")
    if not name:
        return Header(header, "")
    return Header(name, unit)


def _is_factor(word: str, is_joined: bool) -> bool:
    """Return whether a word before a unit is its factor, and not the number of the column.

    If factor and unit are written as one word (``is_joined``), as in ``reading_01um``, the number
    is no number of a column.
    """
    is_number_of_column = _COLUMN_NUMBER.fullmatch(word) is not None and not is_joined
    return _FACTOR.fullmatch(word) is not None and not is_number_of_column


def _is_way(name: str, unit: str) -> bool:
    """Return whether a word for ``unit`` means a way back, because ``name`` ends with a load."""
    return unit in _WORDS_FOR_WAYS and _LOAD_AT_END.search(name) is not None


def _unread_unit_at_end(header: str) -> Header:
    """Return the name and the unit of a header that ends with a unit that this package cannot read.

    Examples are a force in oz, and a reading in "tenths", which may be tenths of a millimetre or of
    another unit. The name must have a word for the quantity that has this unit, such as "force" for
    oz. For any other header, the name is the whole header and the unit is empty.
    """
    for role, pattern in _FOREIGN_UNITS.items():
        match = pattern.fullmatch(header)
        if match is not None and has_role(match["name"], role):
            return Header(match["name"], match["unit"])
    return Header(header, "")
