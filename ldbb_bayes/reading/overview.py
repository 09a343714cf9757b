"""Statements about tests in sheets that have no table of readings.

A sheet without a table of readings may state values for all tests, or hold a list of tests, with
one row for each test.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field

from ldbb_bayes.campaign.campaign import PER_TEST
from ldbb_bayes.campaign.circular_test import FEWEST_READINGS
from ldbb_bayes.reading.header_rows import count_numbers, names_any_role, names_columns
from ldbb_bayes.reading.header_units import unit_of
from ldbb_bayes.reading.lines_above import is_label
from ldbb_bayes.reading.numerals import NUMBER_IN_TEXT
from ldbb_bayes.reading.role_words import has_role
from ldbb_bayes.reading.sheet import Sheet
from ldbb_bayes.reading.travel_direction import direction_named, is_direction
from ldbb_bayes.reading.unit_lines import UNIT_COLUMN
from ldbb_bayes.reading.unit_rows import row_of_units
from ldbb_bayes.reading.words import WORDS, comparable, unit_named

__all__ = ["LONGEST_OVERVIEW", "OverviewLines", "lists_tests", "overview_lines"]

# Largest number of rows of a sheet that are searched for a table, or for statements above a table.
# A table that begins below these rows is not found.
LONGEST_OVERVIEW = 1000


@dataclass
class OverviewLines:
    """Texts from sheets without a table of readings, as far as they apply to a given test."""

    #: place (line number and sheet) and text of each line that applies to all tests
    of_all_tests: list[tuple[str, str]] = field(default_factory=list)
    #: place (line number and sheet) and text of each cell that describes the given test in a list
    #: of tests; the text is "header: cell"
    of_this_test: list[tuple[str, str]] = field(default_factory=list)


def lists_tests(sheet: Sheet, names: Collection[str]) -> bool:
    """Return whether a sheet is a list of tests, with a row for each test.

    In a list of tests, one column names tests, each of them once. At most 8 rows with two or more
    numbers lack a name in this column. A log of readings over time is therefore not taken for a
    list of tests, although both may have columns of times. Only the first 1000 rows of the sheet
    are examined. ``names`` are the names of the other sheets and files that are imported; these
    names are taken as names of tests.
    """
    wanted = {_without_blanks(name) for name in names}
    rows = [sheet.cells_as_written(row) for row in sheet.rows[:LONGEST_OVERVIEW]]
    width = max((len(cells) for cells in rows), default=0)
    return any(_names_tests(rows, column, wanted) for column in range(width))


def _names_tests(rows: Sequence[Sequence[str]], column: int, wanted: set[str]) -> bool:
    """Return whether a sheet is a list of tests whose names stand in a certain column.

    Each name must stand in the column only once. At most 8 rows with two or more numbers may lack a
    name in the column. ``rows`` are the cells of each row of the sheet, ``column`` is the index of
    this column, and ``wanted`` are the names of tests, without blanks.
    """
    names = []
    n_rows_of_numbers = 0
    for cells in rows:
        cell = "".join(cells[column : column + 1])
        if _without_blanks(cell) in wanted:
            names.append(_without_blanks(cell))
        elif count_numbers(cells) >= 2:
            n_rows_of_numbers += 1
    names_each_once = bool(names) and len(set(names)) == len(names)
    return names_each_once and n_rows_of_numbers < FEWEST_READINGS


def overview_lines(sheets: Iterable[Sheet], names: Collection[str]) -> OverviewLines:
    """Return the lines that apply to all tests, and the cells that describe a given test.

    The lines and cells are searched for in ``sheets``, which have no table of readings. Such a
    sheet may hold a list of tests: a table with one row for each test. A row of the list describes
    the given test if one of its cells is among ``names``, the possible spellings of the test's
    name. Each cell of this row is returned as ``header: cell``. Lines outside such lists apply to
    all tests. Only the first 1000 rows of each sheet are examined.
    """
    lines = OverviewLines()
    wanted = {_without_blanks(name) for name in names}
    for sheet in sheets:
        _add_statements_of_sheet(sheet, wanted, lines)
    return lines


def _add_statements_of_sheet(sheet: Sheet, wanted: set[str], lines: OverviewLines) -> None:
    """Add to ``lines`` what a sheet without a table of readings states about a given test.

    These statements are the lines that apply to all tests and, if the sheet holds a list of tests,
    the cells that describe the given test. Below the header of the list, rows of several cells that
    do not begin with a label describe other tests, and are left out. ``wanted`` holds the possible
    spellings of the name of the given test, without blanks.
    """
    header: list[str] = []
    # cells of the last row that names columns; this row may be the header of a list of tests
    possible_header: list[str] = []
    for line, cells in _rows_with_units(sheet):
        place = f"{line} of {sheet.place}"
        filled = [cell for cell in cells if cell]
        if not filled:
            continue
        if _is_row_of_test(filled, wanted):
            lines.of_this_test += _labelled_cells(place, header or possible_header, cells)
        elif _heads_a_list(filled):
            header = cells
        elif not header or len(filled) == 1 or _has_label(filled[0]):
            separator = sheet.separator or ";"
            lines.of_all_tests.append((place, separator.join(filled)))
            if _may_head_a_list(filled):
                possible_header = cells


def _rows_with_units(sheet: Sheet) -> list[tuple[int, list[str]]]:
    """Return the line number and the cells of the first 1000 rows of a sheet.

    A row that holds only units, directly below a row that names columns, is left out; its units are
    added to the names of the columns.
    """
    rows: list[tuple[int, list[str]]] = []
    for row in sheet.rows[:LONGEST_OVERVIEW]:
        cells = sheet.cells_as_written(row)
        units = row_of_units(cells, sheet.separator or ";")
        if rows and units and not count_numbers(cells):
            line, names = rows[-1]
            if _may_head_a_list([name for name in names if name]):
                rows[-1] = (line, _with_units(names, units))
                continue
        rows.append((row.line, cells))
    return rows


def _may_head_a_list(filled: Sequence[str]) -> bool:
    """Return whether a row names columns, and none of its cells begins with a number.

    ``filled`` are the cells of the row that are not empty.
    """
    return names_columns(filled) and not any(re.match(NUMBER_IN_TEXT, cell) for cell in filled)


def _with_units(header: Sequence[str], units: Sequence[str]) -> list[str]:
    """Return the header of a list of tests with the units that stand in the row below it.

    A header that states a unit of its own is not changed. ``units`` holds the unit of each column;
    it is empty for a column without a unit.
    """
    joined = list(header)
    for column, unit in enumerate(units[: len(joined)]):
        name = joined[column]
        if unit and name and not unit_of(name).unit:
            joined[column] = f"{name} [{unit}]"
    return joined


def _is_row_of_test(filled: Sequence[str], wanted: set[str]) -> bool:
    """Return whether a row in a list of tests describes a certain test.

    The row describes the test if one of its cells is the name of the test. There is one exception:
    after a label such as ``Operator:`` in the first cell, a name is not that of a test. ``filled``
    are the cells of the row that are not empty, and ``wanted`` are the possible spellings of the
    name.
    """
    named = wanted & {_without_blanks(cell) for cell in filled}
    if not named:
        return False
    return _without_blanks(filled[0]) in named or not _has_label(filled[0])


def _without_blanks(name: str) -> str:
    """Return the name of a test in a form for comparison: ``100 N`` becomes equal to ``100N``."""
    return comparable(name).replace(" ", "")


def _labelled_cells(
    place: str, header: Sequence[str], cells: Sequence[str]
) -> list[tuple[str, str]]:
    """Return the place and text of each filled cell of a row in a list of tests.

    ``place`` holds the line number and the sheet. Each text is ``header: cell``, with the header of
    the cell's column. If the cell is a direction such as CW, the text is ``direction: CW``. Cells
    without a header are left out. ``header`` and ``cells`` hold one text for each column. A column
    ``Unit`` states the unit of the column to its left; it is left out.
    """
    labelled = []
    units = _units_to_the_right(header, cells)
    names = _with_units(header, units)
    # A used column of units loses its name: the unit is not that of the readings.
    for column, unit in enumerate(units):
        if unit:
            names[column + 1] = ""
    for name, cell in zip(names, cells, strict=False):
        if name and cell:
            if is_direction(cell):
                name = "direction"
            labelled.append((place, f"{name}: {cell}"))
    return labelled


def _units_to_the_right(header: Sequence[str], cells: Sequence[str]) -> list[str]:
    """Return, for each column of a list of tests, the unit in a column of units to its right.

    The unit is empty if there is none. ``header`` and ``cells`` hold the header of each column, and
    the cells of one row of the list.
    """
    units = [""] * len(header)
    for column in range(1, min(len(header), len(cells))):
        if UNIT_COLUMN.fullmatch(header[column]) and unit_named(cells[column]):
            units[column - 1] = unit_named(cells[column])
    return units


def _has_label(cell: str) -> bool:
    """Return whether a cell is or contains the label of a value: ``Radius`` or ``Place: Hall 3``.

    A colon marks a label if it ends the cell or follows anything but a digit.
    """
    # The last word of a label may look like a unit: "bar" in "Ball bar".
    if is_label(cell):
        return True
    name = unit_of(cell).name.rstrip(" :")
    is_known = is_label(name) or comparable(name) in WORDS["reading_sign"]["labels"]
    return is_known or re.search(r"\D:|:$", cell) is not None


def _heads_a_list(filled: Sequence[str]) -> bool:
    """Return whether a row is the header of a list of tests.

    ``filled`` are the cells of the row that are not empty. The row must have the form of a header
    (`names_columns`), and a cell must name a role, such as force, or a field of a test. The first
    cell does not count if it is a label, such as ``Radius``, or if the row has only two cells. A
    row of a label and one other cell is a header only if the other cell is the header of a column
    of tests, as in ``Radius | Test``.

    A row is not a header if one of its cells is a direction such as CW, ends with a colon, or
    begins with a number, as in ``Radius | 100 mm``. Nor is a row of two cells whose second cell is
    a statement, such as ``positive reading: bar shorter``.
    """
    if _is_statement(filled) or not names_columns(filled):
        return False
    if any(cell.endswith(":") or re.match(NUMBER_IN_TEXT, cell) for cell in filled):
        return False
    first_is_label = _has_label(filled[0])
    if len(filled) == 2 and first_is_label:
        return _names_column_of_tests(filled[1])
    candidates = filled
    if len(filled) == 2 or first_is_label:
        candidates = filled[1:]
    return any(names_any_role(cell) or cell in PER_TEST for cell in candidates)


def _names_column_of_tests(cell: str) -> bool:
    """Return whether a cell is the header of a column that names tests, such as Test or Run."""
    return has_role(unit_of(cell).name, "test")


def _is_statement(filled: Sequence[str]) -> bool:
    """Return whether a row names a direction of travel, or is a label with a text about the tests.

    Examples are ``Sens | horaire`` for the first kind of row, and ``Sign | positive reading: bar
    shorter`` for the second. A row is of the second kind if it has two cells, and the second has a
    colon and a blank between two words. ``filled`` are the cells of the row that are not empty.
    """
    if any(direction_named(cell) in ("CW", "CCW") for cell in filled):
        return True
    return len(filled) == 2 and re.search(r"\w: +\w", filled[1]) is not None
