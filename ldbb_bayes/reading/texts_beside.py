"""Texts beside a table, or in its unused columns, such as ``+ = bar shorter`` among the remarks.

A text that may state something about the test takes part like a line below the table.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Sequence
from typing import NamedTuple

from ldbb_bayes.campaign.text_table import Row
from ldbb_bayes.reading.heading import Heading, unused_columns
from ldbb_bayes.reading.numerals import looks_like_number
from ldbb_bayes.reading.sheet import Sheet
from ldbb_bayes.reading.timestamps import stamps_in
from ldbb_bayes.reading.travel_direction import directions_stated
from ldbb_bayes.reading.words import LONGEST_TEXT

__all__ = ["TextBeside", "texts_beside", "texts_of_test", "without_texts_behind"]

# Largest number of texts that are taken from a column. Texts that differ only in their numbers
# count as one text.
_MOST_TEXTS = 20
# A header is taken as a text, and not as a name, if it has at least this number of words.
_FEWEST_WORDS_OF_TEXT = 4
# A header is taken as a text only if at most this fraction of the cells below it is filled.
_LARGEST_SHARE_FILLED = 0.5
_LETTER = re.compile(r"[^\W\d_]")
_WORD = re.compile(r"[^\W\d_]{2,}")
# Regular expression for an equation of words, such as "+ = bar shorter".
_EQUATION = re.compile(r"=\s*[^\W\d]|[^\W\d]\s*=")
# Regular expression for a number. Texts that differ only in their numbers count as one text.
_NUMBER = re.compile(r"[\d.,]+")


class TextBeside(NamedTuple):
    """Text beside a table, or in a column of it that is not used."""

    #: number of the row of the table that holds the text; 0 for a header, which is about all rows
    row_line: int
    #: place of the text in messages: the line, and the column if the column has a name
    place: int | str
    text: str
    #: whether the text may state something about the test; a single word, and the label of a
    #: number, states nothing
    may_state: bool


def texts_beside(
    sheet: Sheet, heading: Heading, lines: Collection[int], columns_in_use: Collection[int]
) -> list[TextBeside]:
    """Return the texts beside the rows of a table, or in its unused columns.

    From a column with a name, only texts that may state something about a test are returned. The
    name of the column is returned, too, if it is itself such a text.

    Parameters
    ----------
    sheet, heading
        The sheet and the heading of its table.
    lines
        Numbers of the lines of the table.
    columns_in_use
        Indices of columns that are used although they have no role, such as columns of units.
    """
    wanted = set(lines)
    rows = [row for row in sheet.rows if row.line in wanted]
    in_use = {*heading.roles.values(), *heading.readings, *heading.unit_columns, *columns_in_use}
    texts = []
    for header in _headers_that_are_texts(heading, rows):
        place = f"{heading.line}, column {heading.headers.index(header) + 1}"
        texts.append(TextBeside(0, place, header, may_state=True))
    named = [column for column in unused_columns(heading) if column not in in_use]
    unnamed = [column for column, header in enumerate(heading.headers) if not header]
    widest = max((len(row.cells) for row in rows), default=0)
    unnamed += range(len(heading.headers), widest)
    for column in named:
        texts += _texts_of_named_column(heading, rows, column)
    for column in unnamed:
        if column not in in_use:
            texts += _texts_of_unnamed_column(rows, column, in_use)
    return texts


def without_texts_behind(rows: Sequence[Row], width: int) -> list[Row]:
    """Return the rows of a table, without labelled numbers that stand behind its last column.

    An example are rows that end with ``;;Mean;1.2``, where other rows end with the last column of
    the table. The first cell behind the table must be empty, a word must stand before each number,
    and more than half of the rows must end with the table. Other rows are returned unchanged.

    Parameters
    ----------
    rows
        Rows of the table.
    width
        Number of columns of the table.
    """
    n_longer = sum(any(row.cells[width:]) for row in rows)
    if 2 * n_longer >= len(rows):
        return list(rows)
    trimmed = []
    for row in rows:
        behind = row.cells[width:]
        cells = row.cells[:width] if _are_labelled(behind) else row.cells
        trimmed.append(Row(row.line, cells))
    return trimmed


def _are_labelled(cells: Sequence[str]) -> bool:
    """Return whether the first cell is empty, and a word stands before each number."""
    if not any(cells) or cells[0]:
        return False
    before = ""
    for cell in cells:
        if looks_like_number(cell) and not _LETTER.search(before):
            return False
        before = "" if looks_like_number(cell) else cell
    return True


def _headers_that_are_texts(heading: Heading, rows: Sequence[Row]) -> list[str]:
    """Return those headers of unused columns that are remarks, such as ``+ means bar longer``.

    A remark is no name of a column: the cells below it are empty, or a few of them hold further
    remarks. ``rows`` are the rows of the table.
    """
    headers = []
    for column in unused_columns(heading):
        header = heading.headers[column]
        is_text = _EQUATION.search(header) or len(_WORD.findall(header)) >= _FEWEST_WORDS_OF_TEXT
        cells = [_cell(row, column) for row in rows]
        filled = [cell for cell in cells if cell]
        has_number = any(looks_like_number(cell) for cell in filled)
        if is_text and not has_number and len(filled) <= _LARGEST_SHARE_FILLED * len(cells):
            headers.append(header)
    return headers


def texts_of_test(
    texts: Sequence[TextBeside], lines: Collection[int]
) -> list[tuple[int | str, str]]:
    """Return the place and the words of each text beside a table that may be about one test.

    A text in a row of another test is left out if it states a direction of travel, because the
    direction may differ from test to test. ``lines`` are the numbers of the lines of the test.
    """
    of_test = []
    for text in texts:
        is_shared = not directions_stated([(text.place, text.text)])
        is_about_test = is_shared or text.row_line == 0 or text.row_line in lines
        if text.may_state and is_about_test:
            of_test.append((text.place, text.text))
    return of_test


def _cell(row: Row, column: int) -> str:
    """Return the text of a cell; empty if the row ends before the column."""
    return "".join(row.cells[column : column + 1]).strip()


def _may_state(text: str) -> bool:
    """Return whether a text has at least two words, or is an equation such as ``+ = shorter``."""
    return len(_WORD.findall(text)) > 1 or _EQUATION.search(text) is not None


def _texts_of_named_column(
    heading: Heading, rows: Sequence[Row], column: int
) -> Iterator[TextBeside]:
    """Yield the texts in an unused column that may state something about a test.

    Times are left out, and so are texts that differ from an earlier one only in their numbers.
    """
    header = heading.headers[column]
    seen: set[str] = set()
    for row in rows:
        text = _cell(row, column)[:LONGEST_TEXT]
        pattern = _NUMBER.sub("", text)
        if pattern in seen or not _may_state(text) or stamps_in(f"{header}: {text}"):
            continue
        seen.add(pattern)
        yield TextBeside(row.line, f"{row.line}, column {header!r}", text, may_state=True)
        if len(seen) == _MOST_TEXTS:
            return


def _texts_of_unnamed_column(
    rows: Sequence[Row], column: int, in_use: Collection[int]
) -> Iterator[TextBeside]:
    """Yield the texts in a column without a name; a text before a number is only its label."""
    n_stating = 0
    for row in rows:
        text = _cell(row, column)
        if not _LETTER.search(text):
            continue
        is_label = column + 1 not in in_use and looks_like_number(_cell(row, column + 1))
        may_state = _may_state(text) and not is_label and n_stating < _MOST_TEXTS
        n_stating += may_state
        yield TextBeside(row.line, row.line, text, may_state)
