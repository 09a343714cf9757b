"""Columns with the signs of numbers that stand in another column, such as + and −.

Some displays and their loggers write the sign and the absolute value of a reading apart.
"""

from __future__ import annotations

from collections.abc import Sequence

from ldbb_bayes.errors import InputError
from ldbb_bayes.reading.heading import Heading
from ldbb_bayes.reading.sheet import Sheet
from ldbb_bayes.reading.words import LONGEST_NAME, WORDS, comparable

__all__ = ["check_signs_are_not_apart"]

# Names of columns of signs, such as "sign".
_NAMES = frozenset(WORDS["reading_sign"]["column"])
# Cells of a column of signs, and those of them that mean a negative number.
_NEGATIVE = frozenset(("-", "−", "–", "-1", "−1", "neg", "negative", "negativ"))
_POSITIVE = frozenset(("+", "1", "+1", "pos", "positive", "positiv", "", "0"))


def check_signs_are_not_apart(
    sheet: Sheet, heading: Heading, lines: Sequence[int], cells: Sequence[Sequence[str]]
) -> None:
    """Raise an `InputError` if the signs of readings stand in a column of their own.

    Parameters
    ----------
    sheet, heading
        The sheet and the heading of its table.
    lines
        Line numbers of the rows of the table.
    cells
        Cells of each column.
    """
    used = {*heading.roles.values(), *heading.readings}
    for column, header in enumerate(heading.headers):
        if column in used or comparable(header) not in _NAMES:
            continue
        signs = [comparable(cell) for cell in cells[column]]
        if not set(signs) <= _NEGATIVE | _POSITIVE:
            continue
        negative = [k for k, sign in enumerate(signs) if sign in _NEGATIVE]
        if negative and _are_absolute(cells, heading):
            raise InputError(
                f"{sheet.place}, line {lines[negative[0]]}: readings must have their sign, got it"
                f" in column {header[:LONGEST_NAME]!r}. Write the sign in front of the reading."
            )


def _are_absolute(cells: Sequence[Sequence[str]], heading: Heading) -> bool:
    """Return whether no reading has a minus sign."""
    columns = {*heading.readings, heading.roles.get("reading")} - {None}
    for column in columns:
        if column is not None and any(cell.strip()[:1] in ("-", "−") for cell in cells[column]):
            return False
    return True
