"""Tables with one row for each circle, and with the angles in a row instead of a column.

If the first cells of the rows name the angle and the loads, the table is read. For any other such
table, an error says how to exchange its rows and columns.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ldbb_bayes.campaign.text_table import Row
from ldbb_bayes.errors import InputError
from ldbb_bayes.reading.header_units import unit_of
from ldbb_bayes.reading.names import load_in_name
from ldbb_bayes.reading.numerals import looks_like_number, number_in_text
from ldbb_bayes.reading.overview import LONGEST_OVERVIEW
from ldbb_bayes.reading.role_words import has_role
from ldbb_bayes.reading.sheet import Sheet
from ldbb_bayes.results import Array

__all__ = ["check_not_transposed", "with_circles_in_columns"]

# Regular expression for an angle in a row of angles: 5, 5°, 5 deg or a005.
_ANGLE = re.compile(
    r"(?P<name>[A-Za-zθφ]{0,6}[_ ]?)(?P<number>[+\-−]?\d+(?:[.,]\d+)?)\s?(?:°|deg|rad|gon)?"
)
# A row is taken to be a row of angles only if it holds at least this number of angles.
_FEWEST_ANGLES = 18
# Numbers in a row are angles of a circle only if the range that they cover (largest minus smallest
# number, plus one step) lies between these limits. The first two limits are for degrees and gon,
# the others for radians.
_RANGES = ((180.0, 405.0), (3.0, 6.4))
# Angles are evenly spaced if their steps agree within this fraction of a step.
_EVEN_SHARE = 0.02
# A table is taken to be a matrix of angles only if it has at least this many columns and rows.
_FEWEST_OF_MATRIX = 4


def with_circles_in_columns(sheet: Sheet) -> Sheet:
    """Return a sheet whose rows and columns are exchanged if each circle has a row in the file.

    In the file, the first cell of a row must name the angle, and the other cells of this row must
    be angles over at least half a circle. Several rows must follow, each of which begins with its
    load, such as ``36 N``. These rows become columns with the loads as headers, and the angles
    become the first column. The lines above the row of angles are not changed. Any other sheet is
    returned unchanged.

    Raises
    ------
    InputError
        If a row of angles begins with the name of the angle, but the rows below it do not all begin
        with a load. No error is raised if these rows begin with angles.
    """
    for k, row in enumerate(sheet.rows[:LONGEST_OVERVIEW]):
        if not _names_row_of_angles(row.cells):
            continue
        rows_below = sheet.rows[k + 1 :]
        labels = [sheet.cells_as_written(below)[0] for below in rows_below]
        if len(labels) > 1 and all(_is_load(label) for label in labels):
            return _with_rows_as_columns(sheet, k, labels)
        if not _cover_a_circle(_angles_in(labels)):
            check_not_transposed(sheet)
    return sheet


def _names_row_of_angles(cells: Sequence[str]) -> bool:
    """Return whether a row names the angle and then holds only the angles of a circle."""
    if not cells or not has_role(unit_of(cells[0]).name, "angle"):
        return False
    angles = _angles_in(cells[1:])
    return len(angles) == len(cells) - 1 and _cover_a_circle(angles)


def _is_load(label: str) -> bool:
    """Return whether the label of a row states a load with its unit, such as ``36 N``."""
    return not looks_like_number(label) and load_in_name([label]) is not None


def _with_rows_as_columns(sheet: Sheet, first: int, labels: Sequence[str]) -> Sheet:
    """Return a sheet in which the rows of the table have become columns.

    Each new row holds one angle. Its line number is that of the row of angles plus the index of the
    angle, counted from 1. ``first`` is the index of the row of angles, and ``labels`` are the first
    cells of the rows below it.
    """
    turned = sheet.rows[first:]
    line = turned[0].line
    width = len(turned[0].cells)
    rows = [Row(line, [turned[0].cells[0], *labels])]
    for column in range(1, width):
        cells = [row.cells[column] if column < len(row.cells) else "" for row in turned]
        rows.append(Row(line + column, cells))
    return replace(
        sheet,
        rows=[*sheet.rows[:first], *rows],
        cell_units=_turned_units(sheet.cell_units, turned),
        format_units=_turned_units(sheet.format_units, turned),
        formulas_without_value=_turned_units(
            dict.fromkeys(sheet.formulas_without_value, ""), turned
        ),
        struck_cells=_turned_units(dict.fromkeys(sheet.struck_cells, ""), turned),
        line_of_angles=line,
    )


def _turned_units(
    units: Mapping[tuple[int, int], str], turned: Sequence[Row]
) -> dict[tuple[int, int], str]:
    """Return the units of the cells of a table whose rows have been turned into columns.

    Both the result and ``units`` are dicts; each key holds the line number and the column index of
    a cell. ``turned`` holds the rows that were turned into columns, as they stand in the file. The
    first cell of each of these rows became the header of a column. A header states its unit in its
    text, so the result holds no units of headers.
    """
    first_line = turned[0].line
    columns = {row.line: k for k, row in enumerate(turned)}
    turned_units = {}
    for (line, column), unit in units.items():
        if line not in columns:
            turned_units[line, column] = unit
        elif column > 0:
            turned_units[first_line + column, columns[line]] = unit
    return turned_units


def check_not_transposed(sheet: Sheet) -> None:
    """Raise an error if one row of a sheet holds the angles, and each other row holds one circle.

    Parameters
    ----------
    sheet
        The sheet, in which no table of angles and readings was found.

    Raises
    ------
    InputError
        If one of the first 1000 rows ends with evenly spaced angles over at least half a circle, or
        if the table is a matrix in which each angle is the sum of two numbers, one in front of the
        row and one above the column.
    """
    _check_no_matrix(sheet)
    for row in sheet.rows[:LONGEST_OVERVIEW]:
        angles = _angles_in(_without_last_text(row.cells))
        if _cover_a_circle(angles):
            raise InputError(
                f"{sheet.place}, line {row.line}: angles must stand below each other, got"
                f" {angles[0]:g} to {angles[-1]:g} in one row. Transpose the table: the angles in"
                " a column 'Angle [deg]', and each circle in a column with its force in the"
                " header, such as '100 N [um]'."
            )


def _without_last_text(cells: Sequence[str]) -> list[str]:
    """Return the filled cells of a row without a text at its end, such as ``Remark``."""
    filled = [cell for cell in cells if cell]
    if filled and not re.search(r"\d", filled[-1]):
        filled.pop()
    return filled


def _check_no_matrix(sheet: Sheet) -> None:
    """Raise an error for a matrix of readings in which each angle is the sum of two numbers.

    One number stands above the column of a reading, the other in front of its row. An example is a
    table with a row for every 10° and a column for every degree.
    """
    for k, row in enumerate(sheet.rows[:LONGEST_OVERVIEW]):
        units = _angles_in(row.cells)
        if len(units) < _FEWEST_OF_MATRIX or len(units) != len(
            [cell for cell in row.cells if cell]
        ):
            continue
        rows_below = sheet.rows[k + 1 : k + 1 + _FEWEST_OF_MATRIX]
        firsts = []
        for below in rows_below:
            numbers = [cell for cell in below.cells if looks_like_number(cell)]
            if len(numbers) == len(units) + 1:
                firsts.append(number_in_text(numbers[0]) or 0.0)
        if len(firsts) == _FEWEST_OF_MATRIX and _continue_each_other(units, np.array(firsts)):
            raise InputError(
                f"{sheet.place}, line {row.line}: angles must stand in one column, got a matrix in"
                f" which they are sums such as {firsts[1]:g} + {units[1]:g}. Write the angle and"
                " the reading of each cell in a line below 'Angle [deg],Reading [um]'."
            )


def _continue_each_other(columns: Array, rows: Array) -> bool:
    """Return whether the sums of a table's row and column numbers may be angles, such as 10° + 3°.

    This is the case if the sums increase by equal steps from cell to cell, row by row. ``columns``
    are the numbers above the columns, shape (n,), and ``rows`` are the numbers in front of the
    rows, shape (m,).
    """
    steps = np.diff((rows[:, np.newaxis] + columns).ravel())
    return bool(steps[0] > 0.0 and np.allclose(steps, steps[0], rtol=_EVEN_SHARE))


def _angles_in(cells: Sequence[str]) -> Array:
    """Return the angles at the end of a row, shape (n,), in the unit of the file.

    The cells are read backwards from the end of the row, as long as they are angles, such as 5, 5°
    or a005. If one of these cells begins with letters, all of them must begin with the same
    letters.
    """
    filled = [cell for cell in cells if cell]
    numbers: list[float] = []
    names = set()
    for cell in reversed(filled):
        match = _ANGLE.fullmatch(cell)
        if match is None:
            break
        names.add(match["name"])
        number = number_in_text(match["number"].replace("−", "-"))
        if number is None or len(names) > 1:
            break
        numbers.insert(0, number)
    return np.array(numbers)


def _cover_a_circle(angles: Array) -> bool:
    """Return whether numbers are evenly spaced angles over at least half a circle.

    ``angles`` are the numbers, shape (n,), in degrees, gon or radians.
    """
    if len(angles) < _FEWEST_ANGLES:
        return False
    steps = np.diff(angles)
    step = float(np.median(steps))
    if step == 0.0 or np.abs(steps - step).max() > _EVEN_SHARE * abs(step):
        return False
    span = abs(float(angles[-1] - angles[0])) + abs(step)
    return any(low <= span <= high for low, high in _RANGES)
