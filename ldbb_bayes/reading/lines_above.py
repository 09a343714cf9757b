"""Lines above a table, and what they state: numbers, names, dates and directions."""

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

# Line numbers (or places) and texts.
Lines = Sequence[tuple[int | str, str]]


@dataclass(frozen=True)
class LineStatement:
    """One value that a line states."""

    #: in the unit of its field's name; NaN where a mark may be decimal or of thousands: 1,000
    value: Any
    unit: str  #: as the line names it; empty where it names none
    line: int | str


class _Quantity(NamedTuple):
    """A quantity that stands in a line with its number."""

    words: str  #: a pattern
    usual_unit: str  #: where the line names none; empty: it has to name one
    units: Mapping[str, float]  #: with their sizes in ours


def _expand_parts() -> dict[str, str]:
    """Return the parts of patterns, each with those before it filled in."""
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
# A number in a line: not the beginning of a clock, a date or a longer number.
_WHOLE_NUMBER = rf"(?P<number>{NUMBER_IN_TEXT})(?![\d:/]|[.,]\d|[\-−]\d|\s\d{{3}}(?!\d))(?!')"
# A unit before the number: "in" and a word, or brackets.
_UNIT_BEFORE = r"(?:in\s+(?P<inside>[^\s:=;,|]+)|[\[(](?P<brackets>[^\])]*)[\])])"
# What follows the number, in the same cell or in the next.
_FOLLOWING = r"\s*(?P<cell>[;|,\t]?)\s*(?P<following>[^\s;,|()\[\]]*)"
# Words before a name, by field; and a cell or line that holds a name after such words.
_NAME_WORDS = {key: words % _PARTS for key, words in WORDS["names"].items()}
_NAME_AFTER = rf"{_PARTS['cell']}(?:%s)\s*(?:[:=]\s*[;,|\t]?|[;|\t])\s*(\w(?:[^;,|\t]|,\s)*)"
# Patterns of what is stated in words, by field.
_IN_WORDS = {key: words % _PARTS for key, words in WORDS["in_words"].items()}
_IN_WORDS |= {key: _NAME_AFTER % words for key, words in _NAME_WORDS.items()}
# A cell that is nothing but the words before a name or a date.
_LABEL = re.compile(
    "|".join((*_NAME_WORDS.values(), "date|datum|plane|ebene", _PARTS["calibrated"])),
    re.IGNORECASE,
)
# Fields that are dates.
_DATES = ("date", "ball_bar_calibrated")
# A date of calibration behind the name of a ball bar.
_CALIBRATED_BEHIND = re.compile(rf",\s*{_PARTS['calibrated']}", re.IGNORECASE)
_PRODUCT = re.compile(_PARTS["product"], re.IGNORECASE)
# Readings or the mount as subject of a sentence, and words around them that decide nothing.
_READINGS = re.compile(WORDS["mount"]["readings"], re.IGNORECASE)
_FILLING = re.compile(f"{_READINGS.pattern}|{WORDS['mount']['filling']}", re.IGNORECASE)
_MOUNT_STATES = {state: WORDS["mount"][state] for state in ("raw", "compensated")}
# The beginnings of months' names, in English and German.
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
# CW or CCW, in any word for it.
_SENSE = re.compile(
    rf"(?<![a-zA-Z])({_DIRECTION_WORDS['clock_hand']}|ccw|cw|{_DIRECTION_WORDS['in_words']})"
    r"(?![a-z])",
    re.IGNORECASE,
)
# A word for direction, and what follows it.
_DIRECTION = re.compile(_DIRECTION_WORDS["after"], re.IGNORECASE)
# Words by which a line speaks of a field, whether it is understood or not.
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

    What has no known unit, or is of another kind (maximum, ambient, …), is left alone.
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
    """Return the pattern of words, a unit perhaps, the number, and what follows it."""
    between = rf"{_PARTS['between']}{{0,4}}"
    return re.compile(
        rf"\b{words}\b{between}(?:{_UNIT_BEFORE}{between})?{_WHOLE_NUMBER}{_FOLLOWING}",
        re.IGNORECASE,
    )


def _stated_number(
    key: str, quantity: _Quantity, match: re.Match[str], line: int | str
) -> LineStatement | None:
    """Return the number of a match in our unit; None for another quantity or unit."""
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
    """Return what stands in the cell before the number."""
    before_match = match.string[: match.start()]
    cell = re.split(r"[;,|\t]", before_match)[-1]
    return cell + match.string[match.start() : match.start("number")]


def _unit_among(name: str, units: Mapping[str, float]) -> str | None:
    """Return the unit of a name, or None."""
    wanted = {name.casefold(), unit_named(name).casefold()}
    for unit in units:
        if unit.casefold() in wanted:
            return unit
    return None


def _stated_in_words(text: str) -> Iterator[tuple[str, str]]:
    """Yield fields with plane, date (ISO 8601), names, and whether readings are compensated."""
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
    """Return the value of a field from the words for it; empty where they are no value."""
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
    """Return whether the words after a label are another label, or the header of a column."""
    if key == "ball_bar" and _PRODUCT.fullmatch(value):
        return False
    if _LABEL.fullmatch(value):
        return True
    return names_any_role(value) and re.search(r"[:=\d]", matched) is None


def _mount_states(passage: str, is_whole_line: bool) -> Iterator[str]:
    """Yield raw or compensated where a passage says so of the readings."""
    remaining = " ".join(_FILLING.sub(" ", passage.casefold()).split())
    if not (_READINGS.search(passage) or (is_whole_line and "ompens" in remaining)):
        return
    for state, pattern in _MOUNT_STATES.items():
        if re.fullmatch(pattern, remaining):
            yield state


def _iso_date(text: str) -> str:
    """Return a date as ISO 8601; empty for one that the calendar lacks."""
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
    """Return the number of a month; 0 for a word that is none."""
    for k, beginnings in enumerate(_MONTHS, start=1):
        if name[:3] in beginnings:
            return str(k)
    return "0"


def is_label(text: str) -> bool:
    """Return whether a text is nothing but the words before a value: ``Operator``, ``Radius``."""
    if _LABEL.fullmatch(text) or _DIRECTION.fullmatch(text):
        return True
    quantities = _QUANTITIES.values()
    return any(re.fullmatch(quantity.words, text, re.IGNORECASE) for quantity in quantities)


def is_direction(text: str) -> bool:
    """Return whether a text is a word for CW or CCW."""
    return _SENSE.fullmatch(text) is not None


def directions_stated(lines: Lines, names: Sequence[str] = ()) -> set[str]:
    """Return CW and CCW as lines state them after a word for direction, and as names hold them.

    Of the names the first counts that holds any.
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
    """Return the senses in what follows a word for direction."""
    senses = _senses(text)
    if len(senses) > 1:
        # A line may list both before it states one: (CW/CCW): CCW.
        return _senses(re.split(r"[:=;|\t]", text)[-1])
    return senses


def _senses(text: str) -> set[str]:
    senses = set()
    counter_words = tuple(_DIRECTION_WORDS["counter"])
    for match in _SENSE.finditer(text):
        if match[1].casefold().startswith(counter_words):
            senses.add("CCW")
        else:
            senses.add("CW")
    return senses


def not_understood(lines: Lines) -> dict[str, str]:
    """Return, by field, the first line that speaks of it without a value that is understood."""
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
