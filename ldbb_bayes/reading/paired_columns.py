"""Several tables beside each other in one sheet, such as a pair of columns for each test."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

from ldbb_bayes.campaign.text_table import Row
from ldbb_bayes.errors import InputError
from ldbb_bayes.reading.header_units import BRACKET, unit_of
from ldbb_bayes.reading.laps import TURN_DEG
from ldbb_bayes.reading.layout import Layout
from ldbb_bayes.reading.numerals import looks_like_number, number_in_text
from ldbb_bayes.reading.open_question import OpenQuestionError
from ldbb_bayes.reading.role_words import has_role
from ldbb_bayes.reading.sheet import Sheet
from ldbb_bayes.reading.stacked_tables import first_header
from ldbb_bayes.reading.travel_direction import direction_named, senses_in, without_directions
from ldbb_bayes.reading.words import LONGEST_NAME, comparable

__all__ = ["split_pairs"]

# Several tables may stand beside each other in a sheet. Each of them has at least this number of
# columns: one column of angles and one column of readings.
_FEWEST_COLUMNS = 2
# Tables beside each other are regarded as parts of one circle only if the angles of each table have
# a gap of at least this size [deg].
_SMALLEST_GAP_DEG = 60.0
# Regular expression for brackets from which a direction was taken out, as in "Angle ( )".
_EMPTY_BRACKETS = re.compile(r"[(\[]\s*[)\]]")


def split_pairs(sheet: Sheet, layout: Layout) -> list[Sheet]:
    """Return the tables that stand beside each other in a sheet, each as a separate sheet.

    A new table begins at each column of angles. Columns before the first column of angles must
    number the rows, as in 1, 2, 3; they are added at the end of each table, and so are columns of
    texts to the right of all tables. All tables must have the same number of columns. If ``layout``
    names columns, every table must have columns with these names. A sheet that does not meet these
    conditions is returned unchanged. A table is named after the header of its second column without
    the unit, such as "100 N". The tables may differ in length: rows of the sheet that are empty
    within a table are left out of it.

    Raise an `OpenQuestionError` if the angles are headed CW and CCW, and the readings do not show
    that these are directions of travel.
    """
    header = first_header(sheet.rows)
    if header is None:
        return [sheet]
    names = list(sheet.rows[header].cells)
    text_columns = _columns_of_texts(sheet.rows[header + 1 :], names)
    names = _with_last_gap(names[: len(names) - len(text_columns)])
    width = _width_of_tables(names)
    if not width:
        return [sheet]
    first_start = _columns_of_angles(names)[0]
    numbering = range(first_start)
    if not all(_numbers_rows(sheet.rows[header + 1 :], column) for column in numbering):
        return [sheet]
    starts = range(first_start, len(names), width)
    headers_in_file = [names[start : start + width] for start in starts]
    are_angles_of_runs = _are_angles_of_runs(sheet.rows[header + 1 :], starts, headers_in_file)
    headers = _without_directions_of_travel(headers_in_file, layout, are_angles_of_runs)
    _check_sense_of_angles(sheet, header, headers, layout)
    if not all(_has_stated_columns(layout, table_names) for table_names in headers):
        return [sheet]
    titles = _names_of_tables(headers, sheet.name)
    if headers != headers_in_file:
        titles = _with_directions(titles, headers_in_file)
    tables = []
    for start, title, table_names in zip(starts, titles, headers, strict=True):
        columns = range(start, start + width)
        further_columns = [*numbering, *text_columns]
        table = _table_in_columns(sheet, header, columns, further_columns, title)
        tables.append(_with_header_of_angles(table, header, table_names[0]))
    _check_whole_circles(sheet, [_angles_of_table(table) for table in tables])
    return tables


def _without_directions_of_travel(
    headers: Sequence[Sequence[str]], layout: Layout, are_angles_of_runs: bool
) -> list[list[str]]:
    """Return the headers of each table, with no direction in the header of its angles.

    The direction in a header such as "Angle CW" is usually the sense in which the angles are
    counted. If both directions occur, it is the direction of travel in two cases: the header of the
    readings of each table names the same direction, or the user states in which sense angles are
    counted and these headers name no direction. In all other cases, the headers are returned
    unchanged. They are also unchanged if the angles do not run as their headers say
    (``are_angles_of_runs`` is False) and the user does not state the sense. ``headers`` are the
    headers of each table.
    """
    is_sense_stated = _is_sense_stated(layout)
    unchanged = [list(names) for names in headers]
    if not (are_angles_of_runs or is_sense_stated):
        return unchanged
    named: set[str] = set()
    for names in headers:
        of_angles = senses_in(names[0])
        of_readings = senses_in(names[1])
        is_of_travel = of_readings == of_angles or (is_sense_stated and not of_readings)
        if len(of_angles) != 1 or not is_of_travel:
            return unchanged
        named |= of_angles
    if len(named) < 2:
        return unchanged
    changed = []
    for names in headers:
        header_of_angles = _EMPTY_BRACKETS.sub("", without_directions(names[0]))
        changed.append([" ".join(header_of_angles.split()), *names[1:]])
    return changed


def _are_angles_of_runs(
    rows: Sequence[Row], starts: Sequence[int], headers: Sequence[Sequence[str]]
) -> bool:
    """Return whether angles headed CW fall from row to row, and angles headed CCW rise.

    They are then angles of runs in these directions, counted counter-clockwise. If angles headed CW
    rise, they may be counted clockwise, or sorted. ``rows`` are the rows below the header,
    ``starts`` are the indices of the columns of angles, and ``headers`` are the headers of each
    table.
    """
    for start, names in zip(starts, headers, strict=True):
        senses = senses_in(names[0])
        if senses and senses != {_sense_of_rows(rows, start)}:
            return False
    return True


def _sense_of_rows(rows: Sequence[Row], column: int) -> str:
    """Return CW if the angles in a column fall at most of the steps from row to row, else CCW."""
    angles = []
    for row in rows:
        cell = _cell(row, column)
        angle = number_in_text(cell) if looks_like_number(cell) else None
        if angle is not None:
            angles.append(angle)
    n_falling = sum(following < angle for angle, following in pairwise(angles))
    return "CW" if 2 * n_falling > len(angles) else "CCW"


def _with_directions(titles: Sequence[str], headers: Sequence[Sequence[str]]) -> list[str]:
    """Return the names of tables, each with the direction of travel in the header of its angles.

    A name that states a direction is not changed. ``headers`` are the headers of each table.
    """
    names_of_tables = []
    for title, names in zip(titles, headers, strict=True):
        words = [title]
        if not senses_in(title):
            words += senses_in(names[0])
        names_of_tables.append(" ".join(words))
    return names_of_tables


def _is_sense_stated(layout: Layout) -> bool:
    """Return whether the user states in which sense angles are counted."""
    return layout.angle_sense is not None or layout.angle_sign is not None


def _check_sense_of_angles(
    sheet: Sheet, header: int, headers: Sequence[Sequence[str]], layout: Layout
) -> None:
    """Raise an `OpenQuestionError` if the angles of the tables are headed CW and CCW.

    These may be the directions of travel, or the senses in which the angles are counted. No error
    is raised if the user states in which sense angles are counted. ``header`` is the index of the
    row of headers, and ``headers`` are the headers of each table, without directions of travel.
    """
    if _is_sense_stated(layout):
        return
    named: set[str] = set()
    for names in headers:
        named |= senses_in(names[0])
    if len(named) < 2:
        return
    titles = ", ".join(names[0] for names in headers)
    raise OpenQuestionError(
        f"{sheet.place}: angles must run clockwise or counter-clockwise, got"
        f" {titles[:LONGEST_NAME]!r} in line {sheet.rows[header].line}. Say which: --angle-sense CW"
        " or CCW.",
        "angle_sense",
        ("CW", "CCW"),
    )


def _with_header_of_angles(table: Sheet, header: int, name: str) -> Sheet:
    """Return a table with ``name`` as the header of its first column, which holds the angles.

    ``header`` is the index of the row of headers.
    """
    rows = list(table.rows)
    row = rows[header]
    rows[header] = Row(row.line, [name, *row.cells[1:]])
    return replace(table, rows=rows)


def _columns_of_angles(names: Sequence[str]) -> list[int]:
    """Return the indices of the columns of angles. ``names`` are the headers of all columns."""
    return [k for k, name in enumerate(names) if has_role(unit_of(name).name, "angle")]


def _cell(row: Row, column: int) -> str:
    """Return the text of a cell; empty if the row ends before the column."""
    return "".join(row.cells[column : column + 1])


def _columns_of_texts(rows: Sequence[Row], names: Sequence[str]) -> range:
    """Return the indices of the columns to the right of all tables that hold texts only.

    An example is a column of remarks. ``rows`` are the rows below the header, and ``names`` are the
    headers of all columns.
    """
    starts = _columns_of_angles(names)
    if len(starts) < 2:
        return range(0)
    width = starts[1] - starts[0]
    columns = range(min(starts[0] + width * len(starts), len(names)), len(names))
    for row in rows:
        if any(looks_like_number(_cell(row, column)) for column in columns):
            return range(0)
    return columns


def _numbers_rows(rows: Sequence[Row], column: int) -> bool:
    """Return whether a column numbers the rows of a table, counted from 0 or 1.

    ``column`` is the index of the column, counted from 0.
    """
    numbers = []
    for row in rows:
        cell = _cell(row, column)
        if cell:
            numbers.append(cell)
    counted_from_0 = [str(number) for number in range(len(numbers))]
    counted_from_1 = [str(number) for number in range(1, len(numbers) + 1)]
    return bool(numbers) and numbers in (counted_from_0, counted_from_1)


def _angles_of_table(table: Sheet) -> list[float]:
    """Return the angles in the first column of a table, each once, in ascending order."""
    angles = set()
    for row in table.rows:
        angle = number_in_text(row.cells[0]) if looks_like_number(row.cells[0]) else None
        if angle is not None:
            angles.add(angle)
    return sorted(angles)


def _check_whole_circles(sheet: Sheet, angles_of_tables: Sequence[Sequence[float]]) -> None:
    """Raise an `InputError` if the tables beside each other are parts of one circle.

    The tables are parts of one circle if no two tables have an angle in common, and if the angles
    of each table have a gap of at least 60°. ``angles_of_tables`` are the numbers in the angle
    column of each table, in ascending order.
    """
    n_angles = sum(len(angles) for angles in angles_of_tables)
    n_different = len({angle for angles in angles_of_tables for angle in angles})
    if n_different < n_angles or not all(angles_of_tables):
        return
    for angles in angles_of_tables:
        gaps = [angles[0] + TURN_DEG - angles[-1]]
        gaps += [following - angle for angle, following in pairwise(angles)]
        if max(gaps) < _SMALLEST_GAP_DEG:
            return
    first = angles_of_tables[0]
    second = angles_of_tables[1]
    raise InputError(
        f"{sheet.place}: a pair of columns must hold a whole circle, got parts from {first[0]:g}"
        f" and from {second[0]:g} on. Put all pairs below each other in one pair of"
        " columns, in the order of the readings."
    )


def _with_last_gap(names: Sequence[str]) -> list[str]:
    """Return the headers of a sheet, with empty headers for columns that are missing at its end.

    Empty columns may separate tables that stand beside each other in a sheet. Such columns are
    often missing after the last table. With the added headers, all tables have the same number of
    columns. ``names`` are the headers of all columns in the file.
    """
    padded = list(names)
    starts = _columns_of_angles(names)
    if len(starts) < 2:
        return padded
    width = starts[1] - starts[0]
    n_missing = (starts[0] - len(names)) % width
    if not any(names[starts[1] - n_missing : starts[1]]):
        padded += [""] * n_missing
    return padded


def _width_of_tables(names: Sequence[str]) -> int:
    """Return the number of columns in each of the tables that stand beside each other in a sheet.

    The result is 0 if there is only one table, or if the tables do not have the same number of
    columns. Columns before the first column of angles belong to no table. ``names`` are the headers
    of all columns.
    """
    starts = _columns_of_angles(names)
    if len(starts) < 2:
        return 0
    width = starts[1] - starts[0]
    n_columns = len(names) - starts[0]
    is_even = n_columns % width == 0 and starts == list(range(starts[0], len(names), width))
    if width < _FEWEST_COLUMNS or not is_even:
        return 0
    return width


def _table_in_columns(
    sheet: Sheet, header: int, columns: range, further_columns: Sequence[int], title: str
) -> Sheet:
    """Return one of the tables that stand beside each other in a sheet, as a separate sheet.

    The table is in the given ``columns``, and ``title`` is the name of the separate sheet. The rows
    above the row of headers, whose index is ``header``, are copied too; of a row with a direction
    above each table, only the direction of this table. The columns
    ``further_columns``, which hold the numbers of the rows or texts, are appended to the right of
    the table.
    """
    rows = []
    for row in sheet.rows[:header]:
        if _states_directions_of_tables(row.cells, len(columns)):
            rows.append(Row(row.line, row.cells[columns.start : columns.stop]))
        else:
            rows.append(row)
    for row in sheet.rows[header:]:
        cells = row.cells[columns.start : columns.stop]
        if any(cells):
            n_missing = len(columns) - len(cells)
            further_cells = [_cell(row, column) for column in further_columns]
            rows.append(Row(row.line, [*cells, *[""] * n_missing, *further_cells]))
    return replace(
        sheet,
        name=title,
        rows=rows,
        cell_units=_units_in_columns(sheet.cell_units, columns),
        format_units=_units_in_columns(sheet.format_units, columns),
        formulas_without_value=_in_columns(sheet.formulas_without_value, columns),
        struck_cells=_in_columns(sheet.struck_cells, columns),
    )


def _in_columns(cells: Collection[tuple[int, int]], columns: range) -> set[tuple[int, int]]:
    """Return the cells of a sheet with column indices that count from the first of ``columns``.

    Each of ``cells`` is a line number and a column index.
    """
    return {(line, column - columns.start) for line, column in cells}


def _states_directions_of_tables(cells: Sequence[str], width: int) -> bool:
    """Return whether a row above several tables states one direction of travel for each of them.

    ``cells`` are the cells of the row, and ``width`` is the number of columns of each table.
    """
    directions = []
    for start in range(0, len(cells), width):
        words = [cell for cell in cells[start : start + width] if cell]
        if len(words) != 1:
            return False
        directions.append(direction_named(words[0]))
    return len(directions) > 1 and set(directions) <= {"CW", "CCW"}


def _has_stated_columns(layout: Layout, headers: Sequence[str]) -> bool:
    """Return whether a table has all columns that the layout states by name.

    The result is also False if the layout states a column by its number, or if it states a list of
    columns of readings. Upper and lower case are not distinguished.
    """
    names = {comparable(header) for header in headers}
    for reference in layout.columns.values():
        if not isinstance(reference, str) or comparable(reference) not in names:
            return False
    return True


def _units_in_columns(
    units: Mapping[tuple[int, int], str], columns: range
) -> dict[tuple[int, int], str]:
    """Return the units of the cells in the given columns of a sheet, which form one table.

    Both the result and ``units`` are dicts; each key is a pair of the line number and the column
    index of a cell. In ``units``, columns are counted from the first column of the sheet; in the
    result, they are counted from the first column of the table.
    """
    in_table = {}
    for (line, column), unit in units.items():
        if column in columns:
            in_table[line, column - columns.start] = unit
    return in_table


def _names_of_tables(headers: Sequence[Sequence[str]], sheet_name: str) -> list[str]:
    """Return a name for each of several tables that stand beside each other in a sheet.

    The name is the header of the column of readings without the unit. If two of these headers are
    equal, or if one is empty, the headers of the columns of angles are used instead. If these are
    equal or empty too, the tables are numbered, behind the name of the sheet, which may state their
    force. ``headers`` are the headers of each table, and ``sheet_name`` is the name of the sheet.
    """
    for column in (1, 0):
        titles = [BRACKET.split(of_table[column])[0].strip() for of_table in headers]
        if len(set(titles)) == len(titles) and all(titles):
            return titles
    return [f"{sheet_name} table {number}".strip() for number in range(1, len(headers) + 1)]
