"""Decimal mark of the numbers in a table: a point or a comma."""

from __future__ import annotations

import re
from collections.abc import Sequence

from ldbb_bayes.errors import InputError
from ldbb_bayes.reading.assumptions import AssumptionLog
from ldbb_bayes.reading.layout import Layout
from ldbb_bayes.reading.numerals import (
    OTHER_MARK,
    could_be_thousands,
    decimal_mark,
    looks_like_number,
)
from ldbb_bayes.reading.sheet import Sheet

__all__ = ["check_thousands", "decimal_mark_of"]

# Commas or points in a column may be decimal marks or separate thousands. A column is checked for
# this only if at least this many of its numbers have the assumed decimal mark.
_FEWEST_MARKED = 5


def decimal_mark_of(
    sheet: Sheet, cells: Sequence[tuple[int, str]], layout: Layout, log: AssumptionLog
) -> str | None:
    """Return the decimal mark that the layout states or, if it states none, that of the cells.

    Return None if neither the layout nor a cell has one. The decimal mark of the cells is noted as
    an assumption if it is a comma, or if it may also separate thousands. Numbers that a workbook
    stores as numbers always have a decimal point. ``cells`` holds the line number and the text of
    every cell with a number.
    """
    if sheet.stores_numbers:
        return "."
    if layout.decimal is not None:
        _note_stated_mark(sheet, cells, layout.decimal, log)
        return layout.decimal
    decimal = _common_mark(sheet, cells)
    if decimal is None:
        return None
    log.keep(decimal=decimal)
    marked = [cell for _, cell in cells if decimal in cell]
    if all(could_be_thousands(cell) for cell in marked):
        reason = "thousands are as likely: three digits behind each"
        log.add(sheet.place, "decimal mark", decimal, reason, "--decimal")
    elif decimal == ",":
        reason = "no cell has a point"
        if any("." in cell for _, cell in cells):
            reason = "points stand between thousands"
        log.add(sheet.place, "decimal mark", decimal, reason, "--decimal")
    return decimal


def check_thousands(sheet: Sheet, lines: Sequence[int], cells: Sequence[str], decimal: str) -> None:
    """Raise an error for a column in which the assumed decimal mark may separate thousands.

    In such a column, three digits follow each mark and some numbers have no mark, for example
    22,658 and 106. If the mark were decimal, the numbers without a mark would have three zeros as
    decimals, which is improbable. ``cells`` are the cells of the column, ``lines`` are their line
    numbers, and ``decimal`` is the assumed decimal mark.
    """
    marked = []
    unmarked = []
    for line, cell in zip(lines, cells, strict=True):
        if decimal in cell:
            marked.append((line, cell))
        elif looks_like_number(cell) and OTHER_MARK[decimal] not in cell:
            unmarked.append(cell)
    integers = [cell for cell in unmarked if re.sub("^[+\\-−–]", "", cell).isdigit()]
    if len(marked) < _FEWEST_MARKED or not all(could_be_thousands(cell) for _, cell in marked):
        return
    if any(cell.strip("+-−–0") for cell in integers):
        line, cell = marked[0]
        raise InputError(
            f"{sheet.place}, line {line}: marks must be decimal or stand between thousands, got"
            f" {cell!r} beside {integers[0]!r}, which may be either. Say which mark is decimal:"
            f" --decimal '{decimal}', or '{OTHER_MARK[decimal]}' if these are thousands."
        )


def _common_mark(sheet: Sheet, cells: Sequence[tuple[int, str]]) -> str | None:
    """Return the decimal mark of all cells; raise an `InputError` if cells have different marks.

    For a workbook, the message adds that the cause may be texts among the numbers. In a workbook,
    numbers have a decimal point, but texts may have a comma. ``cells`` holds the line number and
    the text of every cell with a number.
    """
    try:
        return decimal_mark(sheet.place, cells)
    except InputError as error:
        if sheet.separator:
            raise
        raise InputError(
            f"{error} If texts stand among the numbers, turn them into numbers in the spreadsheet"
            " program."
        ) from error


def _note_stated_mark(
    sheet: Sheet, cells: Sequence[tuple[int, str]], decimal: str, log: AssumptionLog
) -> None:
    """Add a note if cells have a comma or a point, but none has the stated decimal mark.

    The other mark, comma or point, then separates thousands. ``decimal`` is the stated decimal
    mark, and ``cells`` holds the line number and the text of every cell with a number.
    """
    if any(decimal in cell for _, cell in cells):
        return
    other = OTHER_MARK[decimal]
    if any(other in cell for _, cell in cells):
        reason = f"cells have {other!r} alone: thousands"
        log.add(sheet.place, "decimal mark", f"{decimal}, as given", reason, "--decimal")
