"""Rows of a sheet that belong to its table."""

from __future__ import annotations

import re

from ldbb_bayes.campaign.text_table import Row
from ldbb_bayes.reading.heading import Heading
from ldbb_bayes.reading.numerals import is_missing, looks_like_number
from ldbb_bayes.reading.sheet import Sheet

__all__ = ["table_rows"]

# Regular expression for a number at the beginning of a cell, as in "0.9 x 10 um".
_BEGINS_WITH_NUMBER = re.compile(r"\s*[+\-−]?[.,]?\d")
# Regular expression for the beginning of a line with a telephone number, or with a number that
# identifies a company or its bank account.
_CONTACT = re.compile(
    r"\W*(?:tel|phone|telephone|telefon|téléphone|mob|mobile|mobil|fax|gsm|handy|iban|kvk|vat)"
    r"(?![^\W_])",
    re.IGNORECASE,
)


def table_rows(sheet: Sheet, heading: Heading) -> list[Row]:
    """Return the rows of a table, without the texts that may stand below it.

    The texts below a table, such as the end of a letter, begin with a row of words; they may hold
    numbers, such as a telephone number. A row of numbers with unknown units belongs to the table.
    """
    rows = sheet.rows[heading.first_row :]
    while rows and not (_has_number(rows[-1]) or _holds_quantities(rows[-1], heading)):
        rows.pop()
    end = len(rows)
    while end and not _fills_table(rows[end - 1], heading):
        end -= 1
    if 0 < end < len(rows) and _is_remark(rows[end]):
        return rows[:end]
    return rows


def _fills_table(row: Row, heading: Heading) -> bool:
    """Return whether a row has a cell for each column, and a number in its column of angles.

    A table without angles may have a column of times; the number must then stand in this column. If
    the table has neither angles nor times, the number may stand in any column.
    """
    if len(row.cells) < len(heading.headers):
        return False
    column = heading.roles.get("angle", heading.roles.get("time"))
    cells = row.cells if column is None else [row.cells[column]]
    return any(_BEGINS_WITH_NUMBER.match(cell) for cell in cells)


def _is_remark(row: Row) -> bool:
    """Return whether a row is a text, and not a row of a table.

    A text has words and no number, or it begins with a word such as "phone", which precedes a
    telephone number, or "vat", which precedes the number of a company.
    """
    text = " ".join(row.cells)
    if _CONTACT.match(text):
        return True
    return re.search(r"[^\W\d_]{2}", text) is not None and not _has_number(row)


def _holds_quantities(row: Row, heading: Heading) -> bool:
    """Return whether a row fills all columns and every cell begins with a number.

    A row with cells such as ``0.9 x 10 um`` belongs to the table, although its units cannot be
    read. Later code raises an error for these units.
    """
    if len(row.cells) != len(heading.headers):
        return False
    return all(_BEGINS_WITH_NUMBER.match(cell) for cell in row.cells)


def _has_number(row: Row) -> bool:
    """Return whether a row has a number, or a text such as NaN in place of a missing number."""
    return any(looks_like_number(cell) or is_missing(cell) for cell in row.cells)
