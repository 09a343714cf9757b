"""Columns that may name the test of each row, or hold the readings of a further test.

Two error messages name such columns to help the user. One says that the rows of one test have
different directions of travel. The other says that the user states more forces or pressures than a
table has tests.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby, pairwise

from ldbb_bayes.campaign.circular_test import FEWEST_READINGS
from ldbb_bayes.reading.numbering_columns import divides_a_circle
from ldbb_bayes.reading.numerals import looks_like_number
from ldbb_bayes.reading.recording import Recording
from ldbb_bayes.reading.words import LONGEST_NAME

__all__ = ["advice_on_tests", "cells_of", "columns_of_further_readings", "columns_that_name_tests"]

# An unused column may hold readings only if at least this fraction of its cells are numbers.
_SHARE_OF_NUMBERS = 0.8
# Columns with these roles hold one number for each reading, and cannot hold the names of tests.
_ROLES_OF_NUMBERS = ("angle", "reading", "time")
# A message names at most this number of columns.
_COLUMNS_SHOWN = 6


def columns_that_name_tests(
    recording: Recording, directions: Sequence[str] = (), n_tests: int | None = None
) -> list[str]:
    """Return the headers of the columns that may name the test of each row.

    In such a column, rows with the same word follow one another without interruption. Each word
    stands in at least nine rows, because a test has at least nine rows. No other column may divide
    these rows into several circles.

    Parameters
    ----------
    recording
        Rows that are so far regarded as one test.
    directions
        Direction of travel in each of these rows; all rows with the same word in the column must
        have the same direction. Empty if the directions do not matter.
    n_tests
        Number of tests that the column must name; None for any number. Other columns are not
        considered if it is stated.
    """
    headers = []
    in_use = {recording.heading.roles.get(role) for role in _ROLES_OF_NUMBERS}
    for column, header in enumerate(recording.heading.headers):
        if not header or column in in_use:
            continue
        words = cells_of(recording, column)
        if not _stand_in_blocks(words):
            continue
        n_words = len(set(words))
        if n_tests not in (None, n_words):
            continue
        if n_tests is None and _joins_circles(recording, column):
            continue
        pairs = set(zip(words, directions, strict=False))
        if not directions or len(pairs) == n_words:
            headers.append(header[:LONGEST_NAME])
    return headers


def _joins_circles(recording: Recording, column: int) -> bool:
    """Return whether a column gives the same name to rows that another column divides into circles.

    ``column`` is the index of the column.
    """
    headers = recording.heading.headers
    cells = [cells_of(recording, k) for k in range(len(headers))]
    blocks = [len(list(block)) for _, block in groupby(cells[column])]
    in_use = {recording.heading.roles.get(role) for role in _ROLES_OF_NUMBERS}
    angle = recording.heading.roles.get("angle")
    return divides_a_circle(headers, cells, blocks, {*in_use, column}, angle)


def columns_of_further_readings(recording: Recording) -> list[str]:
    """Return the headers of the unused columns that may hold the readings of further tests.

    In the rows of a test, such a column holds at least nine different numbers. At most a fifth of
    its cells may lack a number.
    """
    headers = []
    for column, header in enumerate(recording.heading.headers):
        if header not in recording.unused_columns:
            continue
        numbers = [cell for cell in cells_of(recording, column) if looks_like_number(cell)]
        is_full = len(numbers) >= _SHARE_OF_NUMBERS * len(recording.lines)
        if is_full and len(set(numbers)) >= FEWEST_READINGS:
            headers.append(header[:LONGEST_NAME])
    return headers


def advice_on_tests(recordings: Sequence[Recording], n_stated: int) -> str:
    """Return the advice for a user who states more forces or pressures than there are tests.

    ``n_stated`` is the number of stated values. The advice names the columns that may hold the
    readings of further tests, or that may name the test of each row; it is empty if there are none.
    """
    n_tests, remainder = divmod(n_stated, len(recordings))
    if remainder or n_tests < 2 or any(recording.label for recording in recordings):
        return ""
    recording = recordings[0]
    parting = columns_that_name_tests(recording, n_tests=n_tests)
    if parting:
        return f"If {parting[0]!r} names the test of each row, give --test-column '{parting[0]}'."
    readings = columns_of_further_readings(recording)
    reading_column = recording.heading.roles.get("reading")
    if readings and reading_column is not None:
        readings.insert(0, recording.heading.headers[reading_column])
    if len(readings) < 2:
        return ""
    options = " ".join(f"--reading-column '{header}'" for header in readings[:_COLUMNS_SHOWN])
    if len(readings) > _COLUMNS_SHOWN:
        options += " …"
    return f"If each of these columns holds the readings of a test, give {options}."


def cells_of(recording: Recording, column: int) -> list[str]:
    """Return the cells of a column in the rows of a test; ``column`` is the index of the column."""
    lines = set(recording.lines)
    rows = recording.sheet.rows[recording.heading.first_row :]
    return [row.cells[column] for row in rows if row.line in lines]


def _stand_in_blocks(words: Sequence[str]) -> bool:
    """Return whether the words of a column divide its rows into successive blocks, one per test.

    ``words`` holds the word in each row. There must be at least two different words, and no empty
    word. Rows with the same word must follow one another without interruption, and each word must
    stand in at least nine rows.
    """
    n_blocks = 1
    for word, next_word in pairwise(words):
        n_blocks += word != next_word
    different = set(words)
    if "" in different or len(different) != n_blocks or n_blocks < 2:
        return False
    return all(words.count(word) >= FEWEST_READINGS for word in different)
