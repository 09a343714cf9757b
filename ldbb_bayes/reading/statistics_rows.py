"""Rows of statistics in a table, such as the mean and the maximum of the readings."""

from __future__ import annotations

import re
from collections.abc import Sequence

from ldbb_bayes.campaign.text_table import Row
from ldbb_bayes.reading.numerals import looks_like_number
from ldbb_bayes.reading.words import LONGEST_NAME, WORDS, comparable

__all__ = ["label_of_statistics", "rows_of_statistics", "statistics_among"]

# Words, such as "mean", of which the label of a row of statistics consists.
_WORDS = frozenset(WORDS["statistics"]["words"].split())
# Words which mean a row of statistics if a cell consists of such a word alone.
_SURE_WORDS = frozenset(WORDS["statistics"]["sure"].split())


def statistics_among(cells: Sequence[str]) -> list[int]:
    """Return the indices of the cells of a column that name a statistic, such as "mean".

    The list is empty if all cells of the column name a statistic, because no row then stands out.
    """
    statistics = [k for k, cell in enumerate(cells) if comparable(cell) in _SURE_WORDS]
    if len(statistics) == len(cells):
        return []
    return statistics


def label_of_statistics(row: Row, angle_column: int) -> str:
    """Return the label of a row of statistics, such as "std. dev."; empty for any other row.

    The label stands in the column of angles or times, whose index is ``angle_column``, or else in
    the filled cells before the first number. A row with a number in that column is not a row of
    statistics.
    """
    angle = "".join(row.cells[angle_column : angle_column + 1])
    if looks_like_number(angle):
        return ""
    texts: list[str] = []
    for cell in row.cells:
        if looks_like_number(cell):
            break
        if cell:
            texts.append(cell)
    for label in (angle, " ".join(texts)[:LONGEST_NAME]):
        words = re.findall(r"[^\W\d_]+", comparable(label))
        if words and set(words) <= _WORDS:
            return label
    return ""


def rows_of_statistics(rows: Sequence[Row], angle_column: int) -> list[Row]:
    """Return the rows of statistics of a table, at its end or between groups of readings.

    ``angle_column`` is the index of the column of angles or times.
    """
    return [row for row in rows if label_of_statistics(row, angle_column)]
