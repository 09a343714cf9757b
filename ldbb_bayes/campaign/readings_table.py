"""Reading of CSV files with the readings of one test, and of CSV files of a whole campaign.

A CSV file of a whole campaign is tidy: it has one row for each reading.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ldbb_bayes.campaign.cell_numbers import strict_numbers
from ldbb_bayes.campaign.circular_test import PER_TEST, CircularTest
from ldbb_bayes.campaign.text_table import Row, columns_of, read_strict_table
from ldbb_bayes.errors import InputError, placed, require, suggestion
from ldbb_bayes.results import Array

__all__ = ["is_tidy_table", "read_readings", "tests_of_table"]

# Largest number of columns that a table of readings may have.
_LARGEST_COLUMNS = 1000
# Largest number of characters of a column's name that an error message shows.
_SHOWN_NAME = 60
_ANGLES = ("angle_deg", "angle_rad")
_READINGS = ("reading_um", "reading_mm")
# Columns of a tidy CSV whose value must be the same in all rows of a test. A tidy CSV is a table
# with one row for each reading.
_TEST_COLUMNS = ("force_N", "pressure_bar", "direction", *PER_TEST)
# Names that the columns of a table with one row for each reading may have.
_TIDY_COLUMNS = ("test", *_ANGLES, *_READINGS, *_TEST_COLUMNS)
_TEXT_COLUMNS = ("test", "direction", "plane")
# Smallest range that the angles in a column ``angle_deg`` may cover [deg]. Angles that cover less
# are probably in radians, and the table is refused.
_SMALLEST_SPAN_DEG = 7.0
# Largest range that the angles in a column ``angle_rad`` may cover [rad]. Angles that cover more
# are probably in degrees, and the table is refused.
_LARGEST_SPAN_RAD = 8.0 * np.pi


def read_readings(path: Path) -> dict[str, Array]:
    """Return the column of angles and the column of readings in the CSV file of one test.

    The result is a dictionary; its keys are the names of the columns: angle_deg or angle_rad, and
    reading_um or reading_mm. Raise an `InputError` for a file that cannot be read.
    """
    return _angles_and_readings(path, _read_columns(path, (*_ANGLES, *_READINGS)))


def is_tidy_table(path: Path) -> bool:
    """Return whether a file is a tidy CSV that `tests_of_table` can read.

    The first line must hold the names of the columns. A column "test" must be among them, and all
    names must be known to `tests_of_table`. All other tables must be imported with
    `import_campaign`, which determines what their columns mean.
    """
    if path.suffix.lower() != ".csv":
        return False
    try:
        rows, _ = read_strict_table(path)
    except InputError:
        return False
    names = [name.strip() for name in rows[0].cells]
    return rows[0].line == 1 and "test" in names and set(names) <= set(_TIDY_COLUMNS)


def tests_of_table(path: Path) -> tuple[CircularTest, ...]:
    """Return the tests in a tidy CSV file, which has one row for each reading.

    The columns are test (the name of the test), force_N or pressure_bar, angle_deg or angle_rad,
    and reading_um or reading_mm; columns for other fields of a test are optional.
    """
    columns = _read_columns(path, _TIDY_COLUMNS)
    require(
        "test" in columns,
        f"{path}, line 1: columns must hold 'test', got none. Name the test each row belongs to.",
    )
    readings = _angles_and_readings(path, columns)
    unnamed = np.flatnonzero(columns["test"] == "").tolist()
    if unnamed:
        raise InputError(
            f"{path}: every row must name its test, got {len(unnamed)} that do not, the first at"
            f" reading {unnamed[0] + 1}. Write the name of the test into the column."
        )
    tests = []
    for name in dict.fromkeys(columns["test"].tolist()):
        rows = columns["test"] == name
        fields: dict[str, Any] = {key: column[rows] for key, column in readings.items()}
        for key in _TEST_COLUMNS:
            if key in columns:
                fields[key] = _single_value(path, name, key, columns[key][rows])
        with placed(path):
            tests.append(CircularTest(name=name, **fields))
    return tuple(tests)


def _single_value(path: Path, test: str, column: str, values: Any) -> str | float | None:
    """Return the value that a column has in all rows of one test; None if the cells are empty.

    ``test`` is the name of the test, and ``column`` the name of the column. ``values`` are the
    values of the column in the rows of the test. Raise an `InputError` if the values differ.
    """
    require(
        len(set(values.tolist())) == 1,
        f"{path}: {column} must be the same in all rows of a test, got {values.min()} to"
        f" {values.max()} in {test!r}. Split the test or correct the rows.",
    )
    if column in _TEXT_COLUMNS:
        return values[0] or None
    return float(values[0])


def _read_columns(path: Path, known: Sequence[str]) -> dict[str, Any]:
    """Return a dictionary of the columns of a CSV file; each column is an array.

    The keys are the names of the columns, and the arrays contain numbers or strings. If semicolons
    or tabs separate the cells and no number contains a point, commas are read as decimal marks.
    ``known`` are the permitted names of columns. Raise an `InputError` for a name that is not
    permitted, and for a cell without a number in a column of numbers.
    """
    rows, separator = read_strict_table(path)
    names = [""]
    if rows[0].line == 1:
        names = [name.strip() for name in rows[0].cells]
    _check_header(path, names, known)
    filled = [row for row in rows[1:] if any(row.cells)]
    _check_rows(path, filled, len(names))
    lines, cells = columns_of(str(path), filled, len(names))
    cells_by_name = dict(zip(names, cells, strict=True))
    decimal = "."
    if separator != "," and not _has_point(cells_by_name):
        decimal = ","
    columns: dict[str, Any] = {}
    for name, column in cells_by_name.items():
        if name in _TEXT_COLUMNS:
            columns[name] = np.array(column, dtype=object)
        else:
            columns[name] = strict_numbers(str(path), name, lines, column, decimal)
    return columns


def _check_header(path: Path, names: Sequence[str], known: Sequence[str]) -> None:
    """Raise an `InputError` for a header with too many, unknown or repeated names.

    ``known`` are the permitted names.
    """
    require(
        len(names) <= _LARGEST_COLUMNS,
        f"{path}, line 1: a table must have at most {_LARGEST_COLUMNS} columns, got {len(names)}."
        " Export it again.",
    )
    for name in names:
        if name not in known:
            shown = name[:_SHOWN_NAME]
            hint = suggestion(shown, known)
            raise InputError(
                f"{path}, line 1: columns must be among {', '.join(known)}, got {shown!r}.{hint}"
                " Rename or remove the column, or let ldbb-bayes import read the file."
            )
        require(
            names.count(name) == 1,
            f"{path}, line 1: columns must differ, got {name!r} twice. Remove one.",
        )


def _check_rows(path: Path, rows: Sequence[Row], width: int) -> None:
    """Raise an `InputError` if a table has no rows, or if all rows are wider than the header.

    ``width`` is the number of columns that the header names.
    """
    require(
        rows,
        f"{path} must hold readings below its header, got none. Fill the file or remove the test.",
    )
    all_too_wide = all(any(row.cells[width:]) for row in rows)
    require(
        not all_too_wide,
        f"{path}, line 1: the header must name every column, got fewer names than columns. Name"
        " them all; with decimal commas separate the cells by semicolons.",
    )


def _has_point(cells_by_name: Mapping[str, Sequence[str]]) -> bool:
    """Return whether any cell in the columns of numbers contains a decimal point.

    ``cells_by_name`` holds the cells of every column of the table, as strings.
    """
    for name, cells in cells_by_name.items():
        if name not in _TEXT_COLUMNS and any("." in cell for cell in cells):
            return True
    return False


def _angles_and_readings(path: Path, columns: Mapping[str, Any]) -> dict[str, Array]:
    """Return a dictionary with the column of angles and the column of readings of a table.

    The keys are the names of the columns. ``columns`` are all columns of the table. Raise an
    `InputError` if the table has no angles or no readings, or has either of them in two units. Also
    raise it if the range of the angles contradicts their unit.
    """
    angle = _present_name(path, columns, _ANGLES)
    reading = _present_name(path, columns, _READINGS)
    span = float(np.ptp(columns[angle]))
    if angle == "angle_deg":
        require(
            span >= _SMALLEST_SPAN_DEG,
            f"{path}: angle_deg must span more than 7°, got {span:.3g}°. If the angles are radians,"
            " name the column angle_rad.",
        )
    else:
        require(
            span <= _LARGEST_SPAN_RAD,
            f"{path}: angle_rad must span at most 4 turns, got {span:.4g} rad. If the angles are"
            " degrees, name the column angle_deg.",
        )
    return {angle: columns[angle], reading: columns[reading]}


def _present_name(path: Path, columns: Mapping[str, Any], names: tuple[str, str]) -> str:
    """Return which of the two column names in ``names`` occurs in a table.

    ``columns`` holds the columns of the table; the keys are the names of the columns. Raise an
    `InputError` if the table has columns of both names, or no column of these names.
    """
    present = [name for name in names if name in columns]
    if len(present) != 1:
        number = "both" if present else "neither"
        raise InputError(
            f"{path}, line 1: columns must hold {names[0]} or {names[1]}, got {number}. Correct the"
            " header."
        )
    return present[0]
