"""Loads in lines that do not call them force or pressure, such as ``Run 1: 490 N``.

Such a line is used only if no other source states the load of a test.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from ldbb_bayes.reading.line_parts import divide_line
from ldbb_bayes.reading.lines_above import statements_in
from ldbb_bayes.reading.names import LOAD_IN_NAME, load_in_name
from ldbb_bayes.reading.reading_sign import is_about_sign
from ldbb_bayes.reading.recording import LOAD_ROLES
from ldbb_bayes.reading.travel_direction import directions_stated, without_directions
from ldbb_bayes.reading.words import (
    ARE_STATED,
    LONGEST_TEXT,
    OTHER_QUANTITY,
    UNITS,
    WORDS,
    unit_named,
)

__all__ = [
    "LoadInLine",
    "line_with_unit_of_loads",
    "lines_with_preload",
    "lines_with_unread_load",
    "load_of_lines",
    "loads_in_lines",
    "unit_of_all_loads",
]

# Regular expression for words, such as "run", that may stand beside a load in a line. A line that
# contains only a load and such words is taken to state the load of a test.
_BESIDE = re.compile(WORDS["loads"]["beside"], re.IGNORECASE)
# Regular expression for a comma between a word and a number. Such a comma is not a decimal mark.
_COMMA_BEFORE_NUMBER = re.compile(r"(?<=[^\W\d]),(?=\d)")
# Regular expression for words that mean a preload.
_PRELOAD = re.compile(r"pre-?(?:load|tension)|vorspann|vorlast", re.IGNORECASE)
_WORD = re.compile(r"[^\W\d_]+")
# Regular expression for a word that means a force or a pressure, before a number and a unit.
_NAMED_LOAD = re.compile(
    rf"\b(?:{WORDS['numbers']['force_N']['words']}|{WORDS['numbers']['pressure_bar']['words']})"
    r"(?!\w)[\s:=;,|]{1,4}\d[\d.,]*[\s;,|]?[^\W\d]+",
    re.IGNORECASE,
)


# Regular expressions for a sentence such as "all forces in kN"; the keys are the fields of a load.
_UNIT_OF_LOADS = {
    key: re.compile(
        rf"(?<!\w)(?:{WORDS['loads'][words]}){ARE_STATED}"
        r"\s*(?:(?:in|en)\s|[:=])\s*(?P<unit>[^\W\d]+)\W*(?:$|[;,|\t(])",
        re.IGNORECASE,
    )
    for key, words in {"force_N": "forces", "pressure_bar": "pressures"}.items()
}


# Regular expressions for a line that is only the unit of all loads, such as "Force unit: kN"; the
# keys are the fields of a load.
_ONLY_UNIT_OF_LOADS = {
    key: re.compile(
        rf"\W*(?:{WORDS['loads'][words]})[ _-]?(?:units?|einheit)\W+(?P<unit>[^\W\d]+)\W*",
        re.IGNORECASE,
    )
    for key, words in {"force_N": "forces", "pressure_bar": "pressures"}.items()
}


class LoadInLine(NamedTuple):
    """Load in a line such as ``238 N``, which has no word for force or pressure."""

    key: str  #: kind of load that a line states: force_N or pressure_bar
    value: float  #: force in N or pressure in bar; NaN if the load is uncertain
    line: int | str  #: number of the line that states the load
    text: str  #: text of the line that states the load
    #: whether no other text in the line can change the meaning of the load; see `_is_clear`
    is_clear: bool


def loads_in_lines(lines: Sequence[tuple[int | str, str]]) -> Iterator[LoadInLine]:
    """Yield the load of each line that states a number with a unit of force or pressure.

    The load is NaN if the line states several loads, or one that can be read in two ways. Lines
    about forces that are not the load of a test, such as a preload, are left out.

    Parameters
    ----------
    lines
        Line number and text of each line.
    """
    for line, content in lines:
        text = _COMMA_BEFORE_NUMBER.sub(", ", content[:LONGEST_TEXT])
        if LOAD_IN_NAME.search(text) is None or OTHER_QUANTITY.search(text):
            continue
        load = load_in_name([text])
        if load is None:
            yield LoadInLine("force_N", math.nan, line, text.strip(), False)
        else:
            yield LoadInLine(load.key, load.value, line, text.strip(), _is_clear(text))


def load_of_lines(loads: Sequence[LoadInLine]) -> LoadInLine | None:
    """Return the load of a test from the lines above its table; None if the load is uncertain.

    ``loads`` are the loads in all these lines. The load is certain if all of them are equal, and if
    no other text in a line can change the meaning of the load (see `_is_clear`).
    """
    values = {(load.key, load.value) for load in loads}
    if len(values) == 1 and all(load.is_clear for load in loads):
        return loads[0]
    return None


def line_with_unit_of_loads(
    key: str, lines: Sequence[tuple[int | str, str]]
) -> tuple[int | str, str] | None:
    """Return the number and text of the first line that states another unit of all loads than N.

    An example is ``all forces in kN``. For pressures, it is another unit than bar. Return None if
    there is no such line. ``key`` is force_N or pressure_bar.
    """
    role = LOAD_ROLES[key]
    for line, content in lines:
        match = _UNIT_OF_LOADS[key].search(content[:LONGEST_TEXT])
        if match is None:
            continue
        size = UNITS[role].get(unit_named(match["unit"]))
        if size is not None and size != 1.0:
            return line, content.strip()
    return None


def unit_of_all_loads(key: str, lines: Sequence[tuple[int | str, str]]) -> str:
    """Return the unit that a line such as ``Force unit: kN`` states for all loads, or "".

    ``key`` is force_N or pressure_bar. Lines that state different units count as none.
    """
    units = set()
    for _, content in lines:
        match = _ONLY_UNIT_OF_LOADS[key].fullmatch(content[:LONGEST_TEXT])
        unit = unit_named(match["unit"]) if match is not None else ""
        if unit in UNITS[LOAD_ROLES[key]]:
            units.add(unit)
    return units.pop() if len(units) == 1 else ""


def lines_with_preload(lines: Sequence[tuple[int | str, str]]) -> list[tuple[int | str, str]]:
    """Return the number and text of the lines that state a preload, such as ``Preload: -100 N``.

    A preload is hardly the load of a test, but some people call the force of the bar so.
    """
    preloads = []
    for line, content in lines:
        text = content[:LONGEST_TEXT].strip()
        if LOAD_IN_NAME.search(text) is not None and _PRELOAD.search(text):
            preloads.append((line, text))
    return preloads


def lines_with_unread_load(lines: Sequence[tuple[int | str, str]]) -> list[tuple[int | str, str]]:
    """Return the number and text of the lines that name a load with a value that cannot be read.

    An example is ``Load: 10 kg``, whose unit is not one of force. Lines about other loads, such as
    a preload, are left out.
    """
    unread = []
    for line, content in lines:
        text = content[:LONGEST_TEXT].strip()
        has_value = _NAMED_LOAD.search(text) is not None
        if has_value and not OTHER_QUANTITY.search(text) and not statements_in([(line, text)]):
            unread.append((line, text))
    return unread


def _is_clear(text: str) -> bool:
    """Return whether a line states a load so clearly that it is certainly the load of the test.

    The load may stand beside a direction of travel (clockwise or counter-clockwise) and words such
    as "run". All other parts of the line, for example a part about the sign of the readings, must
    be understood. The result is also True for a line without a load if all its parts are
    understood.
    """
    for part in divide_line(text):
        has_load = LOAD_IN_NAME.search(part) is not None
        words = _WORD.findall(without_directions(LOAD_IN_NAME.sub(" ", part)))
        if all(_BESIDE.fullmatch(word) for word in words):
            continue
        if has_load or not _is_understood(part):
            return False
    return True


def _is_understood(text: str) -> bool:
    """Return whether a text states the sign of readings, or a property of a test."""
    lines = [(0, text)]
    return bool(statements_in(lines)) or bool(directions_stated(lines)) or is_about_sign(text)
