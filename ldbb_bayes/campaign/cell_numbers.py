"""Numbers in the cells of a text table, and the message for a cell that holds none."""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from ldbb_bayes.errors import InputError
from ldbb_bayes.results import Array

__all__ = ["LONGEST_CELL_SHOWN", "number_error", "strict_numbers"]

# Largest number of characters of a table's cell that an error message shows.
LONGEST_CELL_SHOWN = 60


def strict_numbers(
    place: str, name: str, lines: Sequence[int], cells: Sequence[str], decimal: str
) -> Array:
    """Return the numbers in the n cells of a table's column, shape (n,).

    Raise an `InputError` for a cell that is not a finite number, and for a number with thousands
    separators, such as 1,000,000. In a cell such as 1.000, the point is read as a decimal mark.

    Parameters
    ----------
    place, name
        Name of the file and name of the column, for error messages.
    lines
        Number of the line that holds each cell, for error messages.
    cells
        Texts of the cells.
    decimal
        Decimal mark: point or comma.
    """
    # Python would read 1_000 as 1000, but a cell with an underscore does not count as a number.
    plain = "_" not in "".join(cells)
    if plain and decimal == ".":
        with suppress(ValueError):
            values = np.array([float(cell) for cell in cells])
            if np.isfinite(values).all():
                return values
    values = np.full(len(cells), np.nan)
    for k, cell in enumerate(cells):
        if "_" in cell:
            continue
        with suppress(ValueError):
            values[k] = float(cell.replace(decimal, "."))
    not_finite = np.flatnonzero(~np.isfinite(values))
    if not_finite.size:
        first = not_finite[0]
        raise number_error(place, lines[first], name, cells[first])
    return values


def number_error(
    place: str, line: int, name: str, cell: str, remedy: str = "Correct or remove the line."
) -> InputError:
    """Return the `InputError` for a cell of a text table that should hold a finite number.

    Parameters
    ----------
    place, line
        Name of the file and number of the line.
    name
        Name of the column.
    cell
        Text of the cell.
    remedy
        Sentence that says what the user can do. If the cell looks like a date, a sentence about
        dates is used instead.
    """
    content = "an empty cell"
    if cell:
        content = repr(cell[:LONGEST_CELL_SHOWN])
    if re.match(r"\d{4}-\d\d-\d\d", cell):
        remedy = "A spreadsheet took a number for a date: format the column as number."
    return InputError(
        f"{place}, line {line}: {name} must be a finite number, got {content}. {remedy}"
    )
