"""Rows of a sheet that belong to its table."""

from __future__ import annotations

import math
import re
from bisect import bisect_left
from collections.abc import Sequence

from ldbb_bayes.campaign.text_table import Row
from ldbb_bayes.reading.heading import Heading
from ldbb_bayes.reading.lines_above import not_understood, statements_in
from ldbb_bayes.reading.numerals import is_missing, looks_like_number, number_in_text
from ldbb_bayes.reading.sheet import Sheet
from ldbb_bayes.reading.travel_direction import directions_stated, senses_in

__all__ = ["remarks_between", "table_rows"]

# Regular expression for a number at the beginning of a cell, as in "0.9 x 10 um".
_BEGINS_WITH_NUMBER = re.compile(r"\s*[+\-−]?[.,]?\d")
# Regular expression for the beginning of a line with a telephone number, or with a number that
# identifies a company or its bank account.
_CONTACT = re.compile(
    r"\W*(?:tel|phone|telephone|telefon|téléphone|mob|mobile|mobil|fax|gsm|handy|iban|kvk|vat)"
    r"(?![^\W_])",
    re.IGNORECASE,
)


# Regular expression for a remark without digits: after a comment sign, or between dashes.
_REMARK = re.compile(r"(?:#+|%+|//+|!+|;+)\s?[^\W\d][^\d]*|([-=*]{2,}|>{2,})\s?[^\W\d][^\d]*")


def table_rows(sheet: Sheet, heading: Heading) -> list[Row]:
    """Return the rows of a table, without the texts that may stand below it.

    The texts below a table, such as the end of a letter, begin with a row of words; they may hold
    numbers, such as a telephone number. A row of numbers with unknown units belongs to the table.
    Remarks between the rows are left out, too (see `remarks_between`).
    """
    remarks = {row.line for row in remarks_between(sheet, heading)}
    rows = [row for row in sheet.rows[heading.first_row :] if row.line not in remarks]
    while rows and not (_has_number(rows[-1]) or _holds_quantities(rows[-1], heading)):
        rows.pop()
    end = len(rows)
    while end and not _fills_table(rows[end - 1], heading):
        end -= 1
    if 0 < end < len(rows) and _is_remark(rows[end]):
        return rows[:end]
    return rows


def remarks_between(sheet: Sheet, heading: Heading) -> list[Row]:
    """Return the remarks among the rows of a table that state nothing, such as ``# pause``.

    A remark counts only before the first row of numbers, or where the angles or times run on as
    before. Otherwise, it may stand between two circles.

    Parameters
    ----------
    sheet, heading
        The sheet and the heading of its table.
    """
    rows = sheet.rows[heading.first_row :]
    column = heading.roles.get("angle", heading.roles.get("time"))
    plain = [row for row in rows if _is_plain_remark(row)]
    if not plain or column is None:
        return []
    lines_of_remarks = {row.line for row in plain}
    others = [row for row in rows if row.line not in lines_of_remarks]
    lines = [row.line for row in others]
    values = [_value_of(row, column) for row in others]
    remarks = []
    for remark in plain:
        n_before = bisect_left(lines, remark.line)
        if n_before == 0 or _run_on(values[max(n_before - 2, 0) : n_before + 1]):
            remarks.append(remark)
    return remarks


def _value_of(row: Row, column: int) -> float:
    """Return the number in a cell; NaN if the cell is missing, or holds no number."""
    cell = "".join(row.cells[column : column + 1])
    value = number_in_text(cell) if looks_like_number(cell) else None
    return math.nan if value is None else value


def _run_on(values: Sequence[float]) -> bool:
    """Return whether the last of three values follows on the others with about the same step."""
    if len(values) < 3 or any(math.isnan(value) for value in values):
        return False
    step = values[1] - values[0]
    return step != 0.0 and 0.5 <= (values[2] - values[1]) / step <= 1.5


def _is_plain_remark(row: Row) -> bool:
    """Return whether a row is a remark that states nothing, such as ``# pause`` or ``-- START --``.

    The remark is in a single cell, after a comment sign or between dashes. It has no digit, and no
    word for a direction, a load or another field of a test.
    """
    filled = [cell for cell in row.cells if cell]
    if len(filled) != 1 or _REMARK.fullmatch(filled[0]) is None:
        return False
    lines = [(row.line, filled[0])]
    is_about_test = senses_in(filled[0]) or directions_stated(lines)
    return not (is_about_test or statements_in(lines) or not_understood(lines))


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
