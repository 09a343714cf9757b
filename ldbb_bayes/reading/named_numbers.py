"""Tables from lines with a name before each number, such as ``ang=12.5 dev=3.1 F=238``."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

from ldbb_bayes.campaign.circular_test import FEWEST_READINGS
from ldbb_bayes.campaign.text_table import Row
from ldbb_bayes.reading.cell_units import UnitsOfCells
from ldbb_bayes.reading.words import LONGEST_TEXT, unit_named

__all__ = ["rows_of_named_numbers"]

# Regular expression for a name and its number, with the unit of the number if it has one. A word
# after a number is not its unit if the word is the name of the next number. A time such as 12:00:05
# counts as a number, and so does a word directly after the sign =, as in dir=CW.
_PAIR = re.compile(
    r"(?<![\w.])(?P<name>[^\W\d][\w.]*(?:\s?[\[(][^\])=:]*[\])])?)\s*[=:]\s*"
    r"(?P<value>[+\-−]?(?:\d+:\d\d(?::\d\d)?(?:[.,]\d+)?|\d+(?:[.,]\d+)?(?:[eE][+\-]?\d+)?)"
    r"|(?<==)[^\W\d][\w\-]*)(?![\d:/])(?:\s?(?P<unit>°|[^\W\d_]+)(?![\w.\[\]()]*\s*[=:]))?"
)
# Regular expression for a letter and its number, as in N0010C0.000W.0037, which controllers write.
_ADDRESS = re.compile(r"(?P<name>[A-Z])\s*(?P<value>[+\-]?(?:\d+\.?\d*|\.\d+))(?P<unit>)")
# Regular expression for a line that consists of letters, each followed by its number. Such a line
# with the letter G or M does not match, because it is a block of an NC programme.
_ADDRESSES = re.compile(r"(?:[A-FH-LN-Z]\s*[+\-]?(?:\d+\.?\d*|\.\d+)\s*){2,}")
# Name of the column for the words of each line that are neither names nor numbers nor units.
_COLUMN_OF_TEXTS = "text"


class _NamedNumbers(NamedTuple):
    """Names and numbers of a line, and the other words of the line."""

    names: tuple[str, ...]  # name in front of each number of the line
    numbers: list[str]  # the numbers of the line as texts
    units: list[str]  # unit after each number of the line; empty if a number has none
    words: str  # all words of the line that are neither names nor numbers nor units


def rows_of_named_numbers(text: str) -> UnitsOfCells:
    """Return the rows of a text in which many lines have the same names before their numbers.

    The names become the header, in a row above the first of these lines. Other words in these
    lines, such as the date and time of a log, become a column of texts. Each line without these
    names is a row of one cell. The rows hold the numbers without their units; the result holds the
    units separately. Both the rows and the units are empty for a text without such lines.
    """
    lines = text.split("\n")
    named = [_named_numbers(line) for line in lines]
    names = _names_of_most_lines(named)
    if not names:
        return UnitsOfCells([], {})
    readings = {
        line: of_line for line, of_line in enumerate(named, start=1) if of_line.names == names
    }
    has_words = any(of_line.words for of_line in readings.values())
    first_line = min(readings)
    rows: list[Row] = []
    units: dict[tuple[int, int], str] = {}
    for line, content in enumerate(lines, start=1):
        if line not in readings:
            if content.strip():
                rows.append(Row(line, [content.strip()]))
            continue
        if line == first_line:
            rows.append(Row(line, _with_last(names, _COLUMN_OF_TEXTS, has_words)))
        of_line = readings[line]
        rows.append(Row(line, _with_last(of_line.numbers, of_line.words, has_words)))
        for column, unit in enumerate(of_line.units):
            if unit:
                units[line, column] = unit
    return UnitsOfCells(rows, units)


def _names_of_most_lines(named: Sequence[_NamedNumbers]) -> tuple[str, ...]:
    """Return the names of the most frequent kind of line: ang and dev for ``ang=12.5 dev=3.1``.

    Two lines are of the same kind if they have the same names before their numbers, in the same
    order. Only lines with at least two names are counted. The result is an empty tuple if there are
    fewer than nine lines of the most frequent kind. ``named`` holds the names and numbers of each
    line.
    """
    n_lines = Counter(of_line.names for of_line in named if len(of_line.names) >= 2)
    if not n_lines:
        return ()
    ((names, n_alike),) = n_lines.most_common(1)
    return names if n_alike >= FEWEST_READINGS else ()


def _with_last(cells: Sequence[str], last: str, has_last: bool) -> list[str]:
    """Return the cells of a row; the cell ``last`` is added at the end if ``has_last`` is true."""
    return [*cells, last] if has_last else [*cells]


def _named_numbers(line: str) -> _NamedNumbers:
    """Return the names and numbers in a line, and the other words of the line."""
    line = line[:LONGEST_TEXT]
    has_addresses = _ADDRESSES.fullmatch(line.strip()) is not None
    if not has_addresses and "=" not in line and ":" not in line:
        return _NamedNumbers((), [], [], "")
    names = []
    numbers = []
    units = []
    words = line
    pattern = _ADDRESS if has_addresses else _PAIR
    for match in pattern.finditer(line):
        unit = unit_named(match["unit"] or "")
        names.append(match["name"])
        numbers.append(match["value"])
        units.append(unit)
        end = match.end() if unit else match.end("value")
        words = words.replace(line[match.start() : end], " ", 1)
    other_words = " ".join(words.split()).strip(" ;,|{}()-")
    return _NamedNumbers(tuple(names), numbers, units, other_words)
