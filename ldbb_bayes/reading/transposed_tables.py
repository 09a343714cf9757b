"""Tables with one row for each circle, and with the angles in a row instead of a column."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from ldbb_bayes.errors import InputError
from ldbb_bayes.reading.numerals import number_in_text
from ldbb_bayes.reading.overview import LONGEST_OVERVIEW
from ldbb_bayes.reading.sheet import Sheet
from ldbb_bayes.results import Array

__all__ = ["check_not_transposed"]

# Regular expression for an angle in a row of angles: 5, 5°, 5 deg or a005.
_ANGLE = re.compile(
    r"(?P<name>[A-Za-zθφ]{0,6}[_ ]?)(?P<number>[+\-−]?\d+(?:[.,]\d+)?)\s?(?:°|deg|rad|gon)?"
)
# A row is taken to be a row of angles only if it holds at least this number of angles.
_FEWEST_ANGLES = 18
# Numbers in a row are angles of a circle only if their range (largest minus smallest number, plus
# one step) lies between these limits. The first limits are for degrees and gon, the second for
# radians.
_RANGES = ((180.0, 405.0), (3.0, 6.4))
# Angles are evenly spaced if their steps agree within this fraction of a step.
_EVEN_SHARE = 0.02


def check_not_transposed(sheet: Sheet) -> None:
    """Raise an error if one row of a sheet holds the angles, and each other row one circle.

    Parameters
    ----------
    sheet
        The sheet, in which no table of angles and readings was found.

    Raises
    ------
    InputError
        If one of the first 1000 rows ends with evenly spaced angles over at least half a circle.
    """
    for row in sheet.rows[:LONGEST_OVERVIEW]:
        angles = _angles_in(row.cells)
        if _cover_a_circle(angles):
            raise InputError(
                f"{sheet.place}, line {row.line}: angles must stand below each other, got"
                f" {angles[0]:g} to {angles[-1]:g} in one row. Transpose the table: the angles in"
                " a column 'Angle [deg]', and each circle in a column with its force in the"
                " header, such as '100 N [um]'."
            )


def _angles_in(cells: Sequence[str]) -> Array:
    """Return the angles at the end of a row, shape (n,), in the unit of the file.

    The angles are the last cells of the row that can be read as angles, such as 5, 5° or a005. If
    one of these cells begins with letters, all of them begin with the same letters.
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
