"""Cells in place of numbers: formulas without a stored value, and numbers in brackets."""

from __future__ import annotations

import re
from collections import Counter

from ldbb_bayes.campaign.cell_numbers import LONGEST_CELL_SHOWN
from ldbb_bayes.campaign.circular_test import FEWEST_READINGS
from ldbb_bayes.errors import InputError
from ldbb_bayes.reading.header_units import unit_of
from ldbb_bayes.reading.role_words import has_role
from ldbb_bayes.reading.sheet import Sheet

__all__ = ["check_cells_are_numbers"]

# Regular expression for a decimal number in brackets, with which accounts show a negative number.
_IN_BRACKETS = re.compile(r"\(\s*\d+[.,]\d+\s*\)")


def check_cells_are_numbers(sheet: Sheet) -> None:
    """Raise an error if a sheet has no table because its cells are formulas, or in brackets.

    Only a sheet with a header of angles and readings is examined. Any other sheet, such as a
    summary, may be left out.

    Parameters
    ----------
    sheet
        A sheet in which no table of numbers was found.

    Raises
    ------
    InputError
        If a column has several formulas without a stored value, or numbers in brackets.
    """
    if not any(_heads_readings(row.cells) for row in sheet.rows):
        return
    n_formulas = Counter(column for _, column in sheet.formulas_without_value)
    if n_formulas and max(n_formulas.values()) >= FEWEST_READINGS:
        line = min(line for line, _ in sheet.formulas_without_value)
        raise InputError(
            f"{sheet.place}, line {line}: cells must hold values, got a formula without a stored"
            " value. Open the file in a spreadsheet program and save it once, or export the sheet"
            " as CSV."
        )
    bracketed = []
    for row in sheet.rows:
        bracketed += [(row.line, cell) for cell in row.cells if _IN_BRACKETS.fullmatch(cell)]
    if len(bracketed) > 1:
        line, cell = bracketed[0]
        raise InputError(
            f"{sheet.place}, line {line}: a number must stand without brackets, got"
            f" {cell[:LONGEST_CELL_SHOWN]!r}. Write a minus sign in place of the brackets if they"
            " mean a negative number."
        )


def _heads_readings(cells: list[str]) -> bool:
    """Return whether a row names a column of angles or times, and a column of readings."""
    names = [unit_of(cell).name for cell in cells if cell]
    has_abscissa = any(has_role(name, "angle") or has_role(name, "time") for name in names)
    return has_abscissa and any(has_role(name, "reading") for name in names)
