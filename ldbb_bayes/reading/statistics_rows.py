"""Rows of a table that hold no readings: statistics, such as the mean, and factors, such as a gain.

Rows that a column calls bad hold no readings either. Factors are numbers with which all readings
of a column are to be converted.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from ldbb_bayes.campaign.text_table import Row
from ldbb_bayes.reading.cell_units import number_in_cell
from ldbb_bayes.reading.numerals import is_missing, looks_like_number
from ldbb_bayes.reading.words import LONGEST_NAME, WORDS, comparable

__all__ = [
    "label_of_statistics",
    "rows_of_statistics",
    "statistics_among",
    "unfit_among",
    "words_among_numbers",
]

# The name of a statistic, such as the mean, consists of words from this set.
_WORDS = frozenset(WORDS["statistics"]["words"].split())
# Words which show, if they are the whole text of a cell, that its row holds a statistic.
_SURE_WORDS = frozenset(WORDS["statistics"]["sure"].split())
# Words, such as "gain", which mean that a row states how the readings are to be converted.
_CONVERSIONS = frozenset(WORDS["statistics"]["conversion"].split())
# Regular expression for a cell which says that its row holds no good reading, such as "Bad".
_UNFIT = re.compile(WORDS["statistics"]["unfit"], re.IGNORECASE)
# Regular expression for a cell, such as "Bad", which says so even if it stands in every row. Other
# words, such as "not used", may then be about a setting of the instrument.
_SURELY_UNFIT = re.compile(WORDS["statistics"]["surely_unfit"], re.IGNORECASE)
# A column holds numbers if at least this fraction of its filled cells are numbers.
_SHARE_OF_NUMBERS = 0.9
# Names of axes, which may stand behind the name of a statistic.
_AXES = frozenset("xyz")
# Regular expression for a word of at least three letters at the beginning of a cell.
_FIRST_WORD = re.compile(r"\W*[^\W\d_]{3,}")


def statistics_among(cells: Sequence[str]) -> list[int]:
    """Return the indices of the cells of a column that name a statistic, such as "mean".

    A less certain word, such as "max", counts next to a word that is certain. The list is empty if
    all cells of the column name a statistic, because all rows are then of the same kind.
    """
    statistics = [k for k, cell in enumerate(cells) if comparable(cell) in _SURE_WORDS]
    if len(statistics) == len(cells):
        return []
    neighbours = set(statistics)
    for first in statistics:
        for step in (-1, 1):
            k = first + step
            while 0 <= k < len(cells) and _consists_of_statistics(cells[k]):
                neighbours.add(k)
                k += step
    return sorted(neighbours)


def _consists_of_statistics(cell: str) -> bool:
    """Return whether all words of a cell may be parts of the name of a statistic."""
    words = re.findall(r"[^\W\d_]+", comparable(cell))
    if len(words) > 1 and words[-1] in _AXES:  # as in "Centre x"
        words.pop()
    return bool(words) and set(words) <= _WORDS


def words_among_numbers(cells: Sequence[str]) -> list[int]:
    """Return the indices of the cells of a column whose rows hold no readings.

    A row holds no readings if its cell is a word such as "gain" or "offset". If there is no such
    word in a column of numbers, a row whose cell is any other word holds no readings either, unless
    the word stands for a missing value. The list is empty if every cell of the column is a word
    such as "gain".
    """
    conversions = [k for k, cell in enumerate(cells) if _names_conversion(cell)]
    if len(conversions) == len(cells):
        return []
    if conversions or not _holds_numbers(cells):
        return conversions
    return [k for k, cell in enumerate(cells) if _is_word(cell)]


def unfit_among(cells: Sequence[str]) -> list[int]:
    """Return the indices of the cells of a column which say that their rows hold no good reading.

    Such a cell is ``Bad_NoCommunication`` in a column of qualities, or "outlier, do not use" in a
    column of remarks. If every cell of the column says so, only words without another meaning
    count, such as "Bad", but not "not used".
    """
    unfit = [k for k, cell in enumerate(cells) if _UNFIT.fullmatch(cell.strip())]
    if len(unfit) < len(cells):
        return unfit
    return [k for k, cell in enumerate(cells) if _SURELY_UNFIT.fullmatch(cell.strip())]


def _holds_numbers(cells: Sequence[str]) -> bool:
    """Return whether nearly all cells of a column are numbers; empty cells are not counted."""
    filled = [cell for cell in cells if cell and not is_missing(cell)]
    n_numbers = sum(looks_like_number(cell) for cell in filled)
    return bool(filled) and n_numbers >= _SHARE_OF_NUMBERS * len(filled)


def _is_word(cell: str) -> bool:
    """Return whether a cell begins with a word and does not stand for a missing value."""
    is_number = looks_like_number(cell) or is_missing(cell)
    return _FIRST_WORD.match(cell) is not None and not is_number


def _names_conversion(cell: str) -> bool:
    """Return whether a cell is a word such as "gain", "scale factor" or "Offset:"."""
    return re.sub(r"[\W_]+", "", comparable(cell)) in _CONVERSIONS


def label_of_statistics(row: Row, angle_column: int) -> str:
    """Return the name of the statistic in a row, such as "std. dev."; empty for a row of readings.

    The name stands in the column of angles or times, whose index is ``angle_column``, or else in
    the cells before the first number. A row with a number in the column of angles or times, with or
    without a unit, is not a row of statistics.
    """
    angle = "".join(row.cells[angle_column : angle_column + 1])
    if number_in_cell(angle) is not None:
        return ""
    texts: list[str] = []
    for cell in row.cells:
        if looks_like_number(cell):
            break
        if cell:
            texts.append(cell)
    for label in (angle, " ".join(texts)[:LONGEST_NAME]):
        if _consists_of_statistics(label):
            return label
    return ""


def rows_of_statistics(rows: Sequence[Row], angle_column: int) -> list[Row]:
    """Return the rows of a table that hold statistics, such as the mean, instead of readings.

    ``angle_column`` is the index of the column of angles or times.
    """
    return [row for row in rows if label_of_statistics(row, angle_column)]
