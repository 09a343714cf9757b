"""Statements in the lines above a table: numbers, names, dates and directions."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from functools import cache
from typing import Any, NamedTuple

from ldbb_bayes.reading.column_roles import names_any_role
from ldbb_bayes.reading.numerals import (
    NUMBER_IN_TEXT,
    is_missing,
    may_be_thousands,
    number_in_text,
)
from ldbb_bayes.reading.words import (
    LONGEST_TEXT,
    OTHER_QUANTITY,
    UNITS,
    WORDS,
    unit_named,
)

__all__ = [
    "LineStatement",
    "Lines",
    "directions_stated",
    "is_direction",
    "is_label",
    "not_understood",
    "statements_in",
]

# Lines as pairs of line number (or place) and text.
Lines = Sequence[tuple[int | str, str]]


@dataclass(frozen=True)
class LineStatement:
    """One value of a field that a line states."""

    #: value in the unit that the field's name ends with; NaN if a mark may be decimal or separate
    #: thousands: 1,000
    value: Any
    unit: str  #: unit as the line writes it; empty if it names none
    line: int | str  #: line number, or place of the line


class _Quantity(NamedTuple):
    """A quantity of which a line may state the number."""

    words: str  #: pattern of the words for the quantity
    usual_unit: str  #: unit if the line names none; empty if it must name one
    units: Mapping[str, float]  #: sizes of the allowed units in the unit of the field


def _expand_parts() -> dict[str, str]:
    """Return the named parts of patterns; each may contain earlier parts, which are filled in."""
    expanded: dict[str, str] = {}
    for name, pattern in WORDS["parts"].items():
        expanded[name] = pattern % expanded
    return expanded


def _quantities() -> dict[str, _Quantity]:
    quantities = {}
    for key, entry in WORDS["numbers"].items():
        units = entry["units"]
        if isinstance(units, str):  # the name of a role
            units = UNITS[units]
        scale = entry.get("one", 1.0)
        scaled = {unit: scale * size for unit, size in units.items()}
        quantities[key] = _Quantity(entry["words"], entry["unit"], scaled)
    return quantities


_PARTS = _expand_parts()
_QUANTITIES = _quantities()
# Pattern of a number in a line that is not the beginning of a time, a date or a longer number.
_WHOLE_NUMBER = rf"(?P<number>{NUMBER_IN_TEXT})(?![\d:/]|[.,]\d|[\-−]\d|\s\d{{3}}(?!\d))(?!')"
# Pattern of a unit before the number: "in" and a word, or a text in brackets.
_UNIT_BEFORE = r"(?:in\s+(?P<inside>[^\s:=;,|]+)|[\[(](?P<brackets>[^\])]*)[\])])"
# Pattern of what follows the number, in the same cell or in the next.
_FOLLOWING = r"\s*(?P<cell>[;|,\t]?)\s*(?P<following>[^\s;,|()\[\]]*)"
# Patterns of the words before a name ("Operator"), by field, and of a cell or line that holds a
# name after such words.
_NAME_WORDS = {key: words % _PARTS for key, words in WORDS["names"].items()}
_NAME_AFTER = rf"{_PARTS['cell']}(?:%s)\s*(?:[:=]\s*[;,|\t]?|[;|\t])\s*(\w(?:[^;,|\t]|,\s)*)"
# Patterns of statements in words, by field.
_IN_WORDS = {key: words % _PARTS for key, words in WORDS["in_words"].items()}
_IN_WORDS |= {key: _NAME_AFTER % words for key, words in _NAME_WORDS.items()}
# Pattern of a cell that holds only the words before a name or a date.
_LABEL = re.compile(
    "|".join((*_NAME_WORDS.values(), "date|datum|plane|ebene", _PARTS["calibrated"])),
    re.IGNORECASE,
)
# Fields that are dates.
_DATES = ("date", "ball_bar_calibrated")
# Pattern of the words for a date of calibration after the name of a ball bar.
_CALIBRATED_BEHIND = re.compile(rf",\s*{_PARTS['calibrated']}", re.IGNORECASE)
_PRODUCT = re.compile(_PARTS["product"], re.IGNORECASE)
# Patterns of readings or the mount as subject of a sentence, and of filling words, which do not
# decide whether readings are compensated.
_READINGS = re.compile(WORDS["mount"]["readings"], re.IGNORECASE)
_FILLING = re.compile(f"{_READINGS.pattern}|{WORDS['mount']['filling']}", re.IGNORECASE)
_MOUNT_STATES = {state: WORDS["mount"][state] for state in ("raw", "compensated")}
# First three letters of the months' names, in English and German.
_MONTHS = (
    "jan",
    "feb",
    "mar mär",
    "apr",
    "may mai",
    "jun",
    "jul",
    "aug",
    "sep",
    "oct okt",
    "nov",
    "dec dez",
)
_DIRECTION_WORDS: Mapping[str, Any] = WORDS["directions"]
# Pattern of any word for CW or CCW.
_SENSE = re.compile(
    rf"(?<![a-zA-Z])({_DIRECTION_WORDS['clock_hand']}|ccw|cw|{_DIRECTION_WORDS['in_words']})"
    r"(?![a-z])",
    re.IGNORECASE,
)
# Pattern of a word for direction, and what follows it.
_DIRECTION = re.compile(_DIRECTION_WORDS["after"], re.IGNORECASE)
# Patterns of words that show that a line is about a field, whether it is understood or not.
_SUBJECTS = {
    "force_N": re.compile(rf"\b{_QUANTITIES['force_N'].words}\b", re.IGNORECASE),
    "pressure_bar": re.compile(rf"\b{_QUANTITIES['pressure_bar'].words}\b", re.IGNORECASE),
    "feed_mm_per_min": re.compile(rf"\b{_QUANTITIES['feed_mm_per_min'].words}\b", re.IGNORECASE),
    "radius_mm": re.compile("(?i)(?<!kugel)radius"),
    "direction": _DIRECTION,
    "mount": re.compile("(?i)ompens|mount"),
}


def statements_in(lines: Lines) -> dict[str, list[LineStatement]]:
    """Return all that lines state, by field.

    Numbers without a known unit, and quantities of another kind (maximum, ambient, …), are ignored.
    """
    statements: dict[str, list[LineStatement]] = {}
    for line, content in lines:
        text = content[:LONGEST_TEXT]
        for key, quantity in _QUANTITIES.items():
            for match in _pattern(quantity.words).finditer(text):
                statement = _stated_number(key, quantity, match, line)
                if statement is not None:
                    statements.setdefault(key, []).append(statement)
        for key, words in _stated_in_words(text):
            statements.setdefault(key, []).append(LineStatement(words, "", line))
    return statements


@cache
def _pattern(words: str) -> re.Pattern[str]:
    """Return the pattern of the given words, an optional unit, a number, and what follows it."""
    between = rf"{_PARTS['between']}{{0,4}}"
    return re.compile(
        rf"\b{words}\b{between}(?:{_UNIT_BEFORE}{between})?{_WHOLE_NUMBER}{_FOLLOWING}",
        re.IGNORECASE,
    )


def _stated_number(
    key: str, quantity: _Quantity, match: re.Match[str], line: int | str
) -> LineStatement | None:
    """Return the number of a match in the unit of its field; None for other quantities or units."""
    if OTHER_QUANTITY.search(_words_before_number(match)):
        return None
    following = match["following"]
    if OTHER_QUANTITY.fullmatch(following):
        return None
    if match["cell"] and _unit_among(following, quantity.units) is None:
        following = ""  # the next cell is of something else
    named = match["inside"] or match["brackets"] or following
    unit: str | None = quantity.usual_unit
    if named:
        unit = _unit_among(named, quantity.units)
    if not unit:
        return None
    if may_be_thousands(key, match["number"]):
        return LineStatement(math.nan, named, line)
    return LineStatement(number_in_text(match["number"]) * quantity.units[unit], named, line)


def _words_before_number(match: re.Match[str]) -> str:
    """Return the text before the number in its cell."""
    before_match = match.string[: match.start()]
    cell = re.split(r"[;,|\t]", before_match)[-1]
    return cell + match.string[match.start() : match.start("number")]


def _unit_among(name: str, units: Mapping[str, float]) -> str | None:
    """Return the one of the allowed units that a text names; None if it names none of them."""
    wanted = {name.casefold(), unit_named(name).casefold()}
    for unit in units:
        if unit.casefold() in wanted:
            return unit
    return None


def _stated_in_words(text: str) -> Iterator[tuple[str, str]]:
    """Yield the fields that a text states in words, each with its value.

    They are the plane, dates (in ISO 8601), names, and whether readings are raw or compensated.
    """
    for key, pattern in _IN_WORDS.items():
        for match in re.finditer(pattern, text, re.IGNORECASE):
            groups = [group for group in match.groups() if group]
            value = _value_in_words(key, groups[0].strip(), match[0])
            if value.isprintable() and not is_missing(value or "-"):
                yield key, value
    for passage in (text, *re.split(r"[;|\t]|,(?!\s)", text)):
        for state in _mount_states(passage, is_whole_line=passage == text):
            yield "mount", state


def _value_in_words(key: str, value: str, matched: str) -> str:
    """Return the value of a field from its words in a line; empty if they are no value."""
    if key == "plane":
        return re.sub("[-/]", "", value.upper())
    if key in _DATES:
        return _iso_date(value)
    if key in _NAME_WORDS:
        if _is_header_beside(key, value, matched):
            return ""
        return _CALIBRATED_BEHIND.split(value)[0]
    return value


def _is_header_beside(key: str, value: str, matched: str) -> bool:
    """Return whether the words after a label are no value but another label, or a header."""
    if key == "ball_bar" and _PRODUCT.fullmatch(value):
        return False
    if _LABEL.fullmatch(value):
        return True
    return names_any_role(value) and re.search(r"[:=\d]", matched) is None


def _mount_states(passage: str, is_whole_line: bool) -> Iterator[str]:
    """Yield "raw" or "compensated" if a passage states this of the readings or the mount."""
    remaining = " ".join(_FILLING.sub(" ", passage.casefold()).split())
    if not (_READINGS.search(passage) or (is_whole_line and "ompens" in remaining)):
        return
    for state, pattern in _MOUNT_STATES.items():
        if re.fullmatch(pattern, remaining):
            yield state


def _iso_date(text: str) -> str:
    """Return a date in ISO 8601; empty for a date that does not exist."""
    first, second, third = re.findall(r"[^-/., ]+", text.casefold())
    day = first
    month = second
    year = third
    if first.isalpha():  # March 4, 2026
        day = second
        month = first
    elif len(first) == 4:  # 2026-03-04
        year = first
        day = third
    if month.isalpha():
        month = _month_number(month)
    try:
        return date(int(year), int(month), int(day)).isoformat()
    except ValueError:
        return ""


def _month_number(name: str) -> str:
    """Return the number of a month; 0 for a word that is no month."""
    for k, beginnings in enumerate(_MONTHS, start=1):
        if name[:3] in beginnings:
            return str(k)
    return "0"


def is_label(text: str) -> bool:
    """Return whether a text is only a label of a value: ``Operator``, ``Radius``."""
    if _LABEL.fullmatch(text) or _DIRECTION.fullmatch(text):
        return True
    quantities = _QUANTITIES.values()
    return any(re.fullmatch(quantity.words, text, re.IGNORECASE) for quantity in quantities)


def is_direction(text: str) -> bool:
    """Return whether a text is a word for CW or CCW."""
    return _SENSE.fullmatch(text) is not None


def directions_stated(lines: Lines, names: Sequence[str] = ()) -> set[str]:
    """Return the directions, CW and CCW, that lines and names state.

    A line states a direction after a word for direction. Of the names, only the first that
    contains a direction counts.
    """
    directions: set[str] = set()
    for name in names:
        directions = _senses(name[:LONGEST_TEXT])
        if directions:
            break
    for _, text in lines:
        match = _DIRECTION.search(text[:LONGEST_TEXT])
        if match:
            directions = directions | _direction_after(match[1])
    return directions


def _direction_after(text: str) -> set[str]:
    """Return CW and CCW, as far as stated in the text after a word for direction."""
    senses = _senses(text)
    if len(senses) > 1:
        # A line may list both directions before it states one: "Direction (CW/CCW): CCW".
        return _senses(re.split(r"[:=;|\t]", text)[-1])
    return senses


def _senses(text: str) -> set[str]:
    """Return the directions of travel, CW and CCW, that a text names."""
    senses = set()
    counter_words = tuple(_DIRECTION_WORDS["counter"])
    for match in _SENSE.finditer(text):
        if match[1].casefold().startswith(counter_words):
            senses.add("CCW")
        else:
            senses.add("CW")
    return senses


def not_understood(lines: Lines) -> dict[str, str]:
    """Return, by field, a note of the first line about the field that could not be understood."""
    unclear: dict[str, str] = {}
    for line, text in lines:
        if _is_understood(line, text):
            continue
        for key, words in _SUBJECTS.items():
            if words.search(text[:LONGEST_TEXT]):
                subject = key.split("_")[0]
                unclear.setdefault(key, f"line {line} says {subject}, not understood")
    return unclear


def _is_understood(line: int | str, text: str) -> bool:
    if statements_in([(line, text)]) or OTHER_QUANTITY.search(text):
        return True
    return len(directions_stated([(line, text)])) == 1
