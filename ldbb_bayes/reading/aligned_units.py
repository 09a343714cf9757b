"""Rows of units below the names of aligned columns, where some columns have no unit.

An example is a row with ``deg`` and ``um`` below ``No  Angle  Deviation  Temp``. Each unit belongs
to the column whose name stands above it, or whose numbers stand below it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

from ldbb_bayes.campaign.text_table import Row
from ldbb_bayes.reading.cell_units import number_in_cell
from ldbb_bayes.reading.header_rows import is_rule
from ldbb_bayes.reading.overview import LONGEST_OVERVIEW
from ldbb_bayes.reading.unit_rows import COMMENT_SIGN, joined_factors, row_of_units

__all__ = ["with_aligned_units"]

# The header and the row of units are looked for in at most this number of rows above the numbers.
_HEADER_ROWS = 4
# Number of rows from which the places of the columns in the lines of a text file are determined.
_SAMPLE_ROWS = 9
# Regular expressions for the names of columns in a header line that has no separators but blanks.
# The first expression is for names without blanks, the second for names with single blanks.
_NAMES = (re.compile(r"\S+"), re.compile(r"\S+(?: \S+)*"))


class _Word(NamedTuple):
    """Text in a line, with the indices of the characters at which it begins and ends."""

    text: str
    start: int  # index, in a line of a file, of the first character of the text
    end: int  # index, in a line of a file, of the character that follows the text


def with_aligned_units(rows: Sequence[Row], lines: Sequence[str]) -> list[Row]:
    """Return rows, with each unit below a header moved to the column to which it belongs.

    Where some columns have no unit, a row of units that was split at blanks has too few cells. The
    place of a unit in the line then shows its column. A row is changed only if each unit aligns
    with a different column. All other rows are returned unchanged.

    Parameters
    ----------
    rows
        Rows of a text, split at blanks.
    lines
        Lines of the text.
    """
    aligned = list(rows)
    for k in range(1, min(len(rows) - 1, LONGEST_OVERVIEW)):
        if not _begins_numbers(rows, k):
            continue
        width = len(rows[k].cells)
        for above in range(max(k - _HEADER_ROWS, 1), k):
            row = rows[above]
            units = _units_with_places(row, lines)
            if not units or len(units) >= width:
                continue
            header_line = _line_above(rows[:above], lines)
            numbers = [lines[other.line - 1] for other in rows[k : k + _SAMPLE_ROWS]]
            columns = _aligned_columns(units, _places_of_columns(header_line, numbers, width))
            if columns:
                cells = [""] * width
                for column, unit in zip(columns, units, strict=True):
                    cells[column] = unit.text
                aligned[above] = Row(row.line, cells)
    return aligned


def _begins_numbers(rows: Sequence[Row], first: int) -> bool:
    """Return whether rows of numbers begin at the row with the index ``first``.

    ``rows`` are the rows of the text, split at every blank.
    """
    width = len(rows[first].cells)
    if width < 2 or (len(rows[first - 1].cells) == width and _holds_numbers(rows[first - 1])):
        return False
    return all(len(row.cells) == width and _holds_numbers(row) for row in rows[first : first + 2])


def _holds_numbers(row: Row) -> bool:
    """Return whether at least two cells of a row hold a number, with or without a unit."""
    return sum(number_in_cell(cell) is not None for cell in row.cells) >= 2


def _line_above(rows: Sequence[Row], lines: Sequence[str]) -> str:
    """Return the line of the last row that is not a line of dashes, as it stands in the file.

    The result is empty if all ``rows`` are lines of dashes. ``lines`` are all lines of the text.
    """
    rows_of_words = [row for row in rows if not is_rule(row.cells)]
    if not rows_of_words:
        return ""
    return lines[rows_of_words[-1].line - 1]


def _texts_with_places(line: str, pattern: re.Pattern[str]) -> list[_Word]:
    """Return the texts of a line that match a pattern, each with its beginning and end.

    Tabs are replaced by blanks, as on a printed page. A sign that marks the line as a comment is
    ignored.
    """
    text = COMMENT_SIGN.sub(lambda sign: " " * len(sign[0]), line.expandtabs(), count=1)
    return [_Word(match[0], match.start(), match.end()) for match in pattern.finditer(text)]


def _units_with_places(row: Row, lines: Sequence[str]) -> list[_Word]:
    """Return the units of a row, each with its beginning and end in the line.

    A factor, such as 10, belongs to the unit that follows it. The result is an empty list if the
    row is not a row of units. ``lines`` are all lines of the text.
    """
    words = _texts_with_places(lines[row.line - 1], _NAMES[0])
    texts = joined_factors([word.text for word in words])
    if not row_of_units(texts, " "):
        return []
    units = []
    first = 0
    for text in texts:
        last = first + text.count(" ")
        units.append(_Word(text, words[first].start, words[last].end))
        first = last + 1
    return units


def _places_of_columns(header: str, numbers: Sequence[str], width: int) -> list[_Word]:
    """Return a list that states, for each column, where its texts begin and end in a line.

    The texts of a column are its name and its numbers. The list is empty if the line of the header
    does not hold one name for each column.

    Parameters
    ----------
    header
        Line above the row of units.
    numbers
        Lines of numbers below the row of units.
    width
        Number of columns.
    """
    for pattern in _NAMES:
        places = _texts_with_places(header, pattern)
        if len(places) == width:
            break
    else:
        return []
    for line in numbers:
        cells = _texts_with_places(line, _NAMES[0])
        if len(cells) != width:
            break
        for column, cell in enumerate(cells):
            name = places[column]
            start = min(name.start, cell.start)
            places[column] = _Word(name.text, start, max(name.end, cell.end))
    return places


def _aligned_columns(units: Sequence[_Word], places: Sequence[_Word]) -> list[int]:
    """Return the column that each unit aligns with; an empty list if units do not align.

    A unit aligns with the column whose place in the line overlaps the unit most, or else with the
    nearest column. Units do not align if a unit is equally near to two columns, or if two units
    align with the same column. ``units`` and ``places`` hold the beginnings and ends of the units
    and of the columns in a line.
    """
    if not places:
        return []
    columns = []
    for unit in units:
        shared = [min(unit.end, place.end) - max(unit.start, place.start) for place in places]
        if shared.count(max(shared)) > 1:
            return []
        columns.append(shared.index(max(shared)))
    if any(column >= next_column for column, next_column in pairwise(columns)):
        return []
    return columns
