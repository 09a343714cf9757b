"""Location of the table in a sheet: header, first row of numbers, and lines above the table.

A sheet is a text file or one sheet of a workbook.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import takewhile
from typing import NamedTuple

from ldbb_bayes.campaign.campaign import PER_TEST
from ldbb_bayes.campaign.circular_test import FEWEST_READINGS
from ldbb_bayes.campaign.text_table import Row
from ldbb_bayes.errors import InputError
from ldbb_bayes.reading.cells_without_numbers import check_cells_are_numbers
from ldbb_bayes.reading.column_roles import find_columns
from ldbb_bayes.reading.derived_columns import check_none_is_derived, without_remarks
from ldbb_bayes.reading.formats import advice_on_format, format_of, is_in_latex
from ldbb_bayes.reading.header_rows import count_numbers, heads_loads, is_rule, names_columns
from ldbb_bayes.reading.header_units import BRACKET, unit_of
from ldbb_bayes.reading.layout import Layout
from ldbb_bayes.reading.lines_above import statements_in
from ldbb_bayes.reading.long_tables import check_has_row_for_each_reading
from ldbb_bayes.reading.names import LOAD_IN_NAME
from ldbb_bayes.reading.numerals import looks_like_number
from ldbb_bayes.reading.overview import LONGEST_OVERVIEW
from ldbb_bayes.reading.role_words import has_role
from ldbb_bayes.reading.sexagesimal import check_angle_is_whole
from ldbb_bayes.reading.sheet import Sheet
from ldbb_bayes.reading.unit_rows import row_of_units, without_comment_sign
from ldbb_bayes.reading.words import (
    LONGEST_NAME,
    LONGEST_TEXT,
    UNITS,
    scaled_unit,
    size_of_unit,
    unit_named,
)

__all__ = ["CONDITION_ROLES", "Heading", "NoTableError", "find_heading", "unused_columns"]

# Roles of columns that state a condition of a test, with the same value in all of its rows.
CONDITION_ROLES = ("force", "pressure", "direction")
# Units that may stand in place of the name of a column.
_UNITS_ALONE = ("deg", "rad", "um", "mm", "nm")
# Fields that a row of labels and numbers above a table may state.
_STATED_IN_ROWS = frozenset({"force_N", "pressure_bar", "radius_mm", "feed_mm_per_min"})
# An error message shows at most this number of cells of a row.
_CELLS_SHOWN = 6
# An error message shows at most this number of characters of a cell.
_CELL_SHOWN = 30
# An error message shows at most this number of characters of a whole row.
_ROW_SHOWN = 60


class NoTableError(InputError):
    """Error for a sheet that holds no table of numbers."""


@dataclass(frozen=True, eq=False)
class Heading:
    """Header and columns of the table in one sheet."""

    line: int  #: line number of the header in the file; 0 if the table has no header
    first_row: int  #: index of the table's first row of numbers among the rows of the sheet
    #: header of each column of the table, as the file writes it; a column of planes is named plane
    headers: list[str]
    units: list[str]  #: unit that the header of each column states; empty if it states none
    #: dict with the index of the column (from 0) for each role; the keys are the roles, such as
    #: angle
    roles: dict[str, int]
    #: lines of the file above the header of the table, each with its line number
    lines_above: list[tuple[int | str, str]]
    #: indices (from 0) of the columns of readings; each column holds the readings of one test
    readings: list[int]
    #: dict with those units in the row of units below the header that have a factor, such as 0.1
    #: um; the keys are the column indices
    scaled_units: Mapping[int, str] = field(default_factory=dict)
    unit_line: int = 0  #: line number of the row of units below the header; 0 if there is none
    #: indices (from 0) of the columns with a unit in the row of units below the header of a table
    columns_with_unit_below: frozenset[int] = frozenset()
    #: name of the test; empty if the sheet does not have one column of readings for each test
    label: str = ""
    #: indices (from 0) of the columns whose cells are units, such as a column "unit" beside the
    #: column of readings
    unit_columns: frozenset[int] = frozenset()
    #: headers as the file writes them, of the columns to which ``headers`` gives another name, such
    #: as ``plane`` for ``Ebene``; the keys are the indices (from 0) of the columns
    replaced_headers: Mapping[int, str] = field(default_factory=dict)

    @property
    def headers_in_file(self) -> list[str]:
        """Header of each column of the table, as the file writes it."""
        written = list(self.headers)
        for column, header in self.replaced_headers.items():
            written[column] = header
        return written

    def column_title(self, role: str, column: int) -> str:
        """Return the role and name of a column for error messages, such as "angle (column 'phi')".

        ``column`` is the index of the column from 0. A column without a name is shown by its
        number.
        """
        name = self.headers[column][:LONGEST_NAME] or column + 1
        return f"{role} (column {name!r})"

    def split_by_readings(self) -> Iterator[Heading]:
        """Yield one heading for each column of readings, because each column is a separate test.

        If there are several columns of readings, the label of each heading is the name of the test.
        """
        if len(self.readings) < 2:
            yield self
            return
        labels = []
        for column in self.readings:
            header = self.headers[column]
            labels.append(BRACKET.split(header)[0].strip() or header or f"column {column + 1}")
        if len(set(labels)) < len(labels):
            labels = [f"{label} {number}" for number, label in enumerate(labels, start=1)]
        for column, label in zip(self.readings, labels, strict=True):
            roles = self.roles | {"reading": column}
            yield replace(self, roles=roles, readings=[column], label=label)


class _HeaderRows(NamedTuple):
    """Names and units of a table's columns, taken from the rows above the numbers."""

    line: int  # line number of the table's header in the file; 0 for a table without a header
    start: int  # index of the header's first row among the rows of the sheet
    end: int  # index of the table's first row of numbers among the rows of the sheet
    headers: list[str]  # name of each column of the table, as the file writes it
    units: list[str]  # unit of each column of the table; empty if none is stated
    # dict with those units in the row of units below the header that have a factor, such as 0.1 um;
    # the keys are the column indices
    scaled_units: Mapping[int, str]
    unit_line: int  # line number of the row of units below the header; 0 if there is none
    # indices of the columns with a unit in the row of units below the header
    columns_with_unit_below: frozenset[int]


def find_heading(sheet: Sheet, layout: Layout) -> Heading:
    """Return the header, the columns and the first row of the table in a sheet.

    ``layout`` is what the user states about the table, such as the line of its header. This
    function does not check whether all rows of the table hold numbers.

    Raises
    ------
    NoTableError
        If the sheet has no table of numbers.
    InputError
        If the header does not fit the table.
    """
    if is_in_latex(sheet):
        raise _no_table(sheet)
    check_has_row_for_each_reading(sheet, layout)
    try:
        return _heading_of_table(sheet, layout)
    except InputError as error:
        has_table = sheet.format and not isinstance(error, NoTableError)
        if not format_of(sheet) or has_table:
            raise
        raise _no_table(sheet) from error


def _no_table(sheet: Sheet) -> NoTableError:
    """Return the error for a file in a format, such as XML, that cannot be imported."""
    return NoTableError(
        f"{sheet.place} must hold a table with one row for each reading, got {format_of(sheet)}."
        f" {advice_on_format(sheet)}"
    )


def _heading_of_table(sheet: Sheet, layout: Layout) -> Heading:
    """Return the header, columns and first row of a sheet's table (see `find_heading`)."""
    numbers_row = _first_row_of_numbers(sheet, layout)
    header_row = _find_header_row(sheet, layout, numbers_row)
    if header_row is None:
        header = _rows_without_header(sheet, numbers_row)
    else:
        header = _rows_of_header(sheet, header_row, numbers_row)
    place = sheet.place
    if header.line:
        place = f"{sheet.place}, line {header.line}"
    column_roles = find_columns(place, layout, header.headers, header.units)
    check_angle_is_whole(place, header.headers, column_roles.columns.get("angle"))
    if "reading" not in layout.columns:
        check_none_is_derived(place, [header.headers[column] for column in column_roles.readings])
    units = list(header.units)
    for column in column_roles.readings:
        name = header.headers[column]
        if units[column] == unit_of(name).unit:
            units[column] = _unit_of_reading(name)
    above = sheet.rows[max(header.end - LONGEST_OVERVIEW, 0) : header.start]
    return Heading(
        line=header.line,
        first_row=header.end,
        headers=header.headers,
        units=units,
        roles=column_roles.columns,
        lines_above=list(sheet.texts(above)),
        readings=column_roles.readings,
        scaled_units=header.scaled_units,
        unit_line=header.unit_line,
        columns_with_unit_below=header.columns_with_unit_below,
    )


def _unit_of_reading(header: str) -> str:
    """Return the unit of readings from a header such as 36 N [mm], which may also state a load."""
    without_load = LOAD_IN_NAME.sub("", without_remarks(header[:LONGEST_TEXT]))
    unit = unit_of(without_load).unit or unit_of(f"reading {without_load}").unit
    if unit == "turn" and BRACKET.search(without_load) is None:
        return ""  # the way back in Spanish, as in "36 N vuelta"
    return unit


def _rows_without_header(sheet: Sheet, numbers_row: int) -> _HeaderRows:
    """Return empty names and empty units for the columns of a table without a header.

    ``numbers_row`` is the index of the row at which the numbers of the table begin.
    """
    first = _first_row_without_header(sheet, numbers_row)
    empty = [""] * len(sheet.rows[numbers_row].cells)
    return _HeaderRows(
        line=0,
        start=first,
        end=first,
        headers=empty,
        units=list(empty),
        scaled_units={},
        unit_line=0,
        columns_with_unit_below=frozenset(),
    )


def _rows_of_header(sheet: Sheet, header_row: int, numbers_row: int) -> _HeaderRows:
    """Return the names and the units of the columns, and the place of the header rows.

    Below the row of names there may be a row of units. A unit in this row replaces the unit that
    the row of names states for the same column. Rows of dashes may underline the header.

    Parameters
    ----------
    sheet
        The sheet, split into rows of cells.
    header_row
        Index of the row of names among the sheet's rows.
    numbers_row
        Index of the first row of numbers below the header.
    """
    names = _column_names(sheet, header_row, numbers_row)
    units = [unit_of(name).unit or _unit_in_place_of_name(name) for name in names]
    scaled_units: dict[int, str] = {}
    unit_line = 0
    units_below: list[str] = []
    next_row = _row_below_rules(sheet, header_row + 1, numbers_row)
    if next_row < numbers_row:
        units_below = row_of_units(sheet.rows[next_row].cells, sheet.separator)
        if units_below:
            _check_units_align(sheet, next_row, units_below, names)
            units = _units_from_below(names, units_below)
            scaled_units = _scaled_units(names, units_below)
            unit_line = sheet.rows[next_row].line
            next_row = _row_below_rules(sheet, next_row + 1, numbers_row)
    return _HeaderRows(
        line=sheet.rows[header_row].line,
        start=header_row,
        end=next_row,
        headers=names,
        units=units,
        scaled_units=scaled_units,
        unit_line=unit_line,
        columns_with_unit_below=frozenset(k for k, unit in enumerate(units_below) if unit),
    )


def _unit_in_place_of_name(header: str) -> str:
    """Return the unit of a header that is nothing but a unit of angle or length, such as ``deg``.

    The result is empty for any other header, and for units that are also other words, such as "in".
    """
    unit = unit_named(header.strip(" []()"))
    return unit if unit in _UNITS_ALONE else ""


def _row_below_rules(sheet: Sheet, row: int, numbers_row: int) -> int:
    """Return the index of the first row, from ``row`` on, that is not a line of dashes.

    ``numbers_row`` is the index of the first row of numbers; the result is at most this index.
    """
    while row < numbers_row and is_rule(sheet.rows[row].cells):
        row += 1
    return row


def _check_units_align(
    sheet: Sheet, row: int, units_below: Sequence[str], names: Sequence[str]
) -> None:
    """Raise an error if a row of units does not show which columns have no unit.

    Some columns have no unit if there are fewer units than columns. In a workbook, the column of
    each unit is always known, and no error is raised. In a text file, empty cells in the row of
    units show which columns have no unit. If there are no empty cells, the units are assumed to
    belong to the first columns. This is accepted if the separator is not a blank and each unit fits
    the name of its column. In all other cases, an error is raised.

    Parameters
    ----------
    sheet, row
        The sheet, and the index of the row of units in it.
    units_below
        Units in this row.
    names
        Names of the columns.
    """
    if not sheet.separator or len(units_below) >= len(names) or "" in sheet.rows[row].cells:
        return
    pairs = zip(names, units_below, strict=False)
    if sheet.separator != " " and all(_fits_name(name, unit) for name, unit in pairs):
        return
    line = sheet.rows[row].line
    units = ", ".join(units_below)
    raise InputError(
        f"{sheet.place}, line {line}: units must be one for each column, got {units[:_ROW_SHOWN]!r}"
        f" for {len(names)} columns. Write '-' in place of each unit that is missing in line"
        f" {line}."
    )


def _fits_name(name: str, unit: str) -> bool:
    """Return whether a unit belongs to the quantity that the name of a column states."""
    quantity = unit_of(name).name
    return any(has_role(quantity, role) and size_of_unit(role, unit) for role in UNITS)


def _units_from_below(headers: Sequence[str], units_below: Sequence[str]) -> list[str]:
    """Return the unit of each column from the row of units below the header.

    ``headers`` are the names of the columns, and ``units_below`` the cells of the row of units.
    """
    units = []
    for column, header in enumerate(headers):
        unit = unit_of(header).unit
        if column < len(units_below) and units_below[column]:
            below = units_below[column]
            if unit and _is_scaled(below):
                # The header states one unit, and the row of units another. Both are stored in one
                # text. This text is not a known unit, so that later code raises an error if the
                # column is used.
                unit = f"{unit} and {below}"
            else:
                unit = unit_of(f"{header} [{below}]").unit
        units.append(unit)
    return units


def _is_scaled(unit: str) -> bool:
    """Return whether a unit is a known unit with a factor, such as 0.1 um."""
    return " " in unit and scaled_unit(unit) == unit


def _scaled_units(headers: Sequence[str], units_below: Sequence[str]) -> dict[int, str]:
    """Return a dict with those units below the header that have a factor, such as 0.1 um.

    The keys are the indices of the columns, and the values are the units. A column whose header
    also states a unit is left out. ``headers`` are the names of the columns, and ``units_below``
    are the cells of the row of units.
    """
    scaled = {}
    for column, unit in enumerate(units_below[: len(headers)]):
        if _is_scaled(unit) and not unit_of(headers[column]).unit:
            scaled[column] = unit
    return scaled


def _first_row_of_numbers(sheet: Sheet, layout: Layout) -> int:
    """Return the index of the row at which the numbers of a sheet's table begin.

    The table begins at the first nine successive rows that have the same number of cells and at
    least two numbers each. At the end of the sheet, two to eight such rows are enough. A table with
    so few rows is too short for a test, but later code raises a clearer error for it, which states
    the number of its readings. If the user states the line of the header, only rows below this line
    are considered. Raise a `NoTableError` if no table begins within 1000 rows.
    """
    rows = sheet.rows
    header_line = layout.header_line or 0
    if header_line and header_line not in [row.line for row in rows]:
        raise InputError(
            f"{sheet.place}: header line must hold names, found none in line {header_line}."
            " Correct --header-line."
        )
    start = len(rows)
    for k, row in enumerate(rows):
        if row.line > header_line:
            start = k
            break
    for k in range(start, min(len(rows) - 1, start + LONGEST_OVERVIEW)):
        if _numbers_begin_at(sheet, k):
            return k
    if not sheet.rows:
        raise NoTableError(
            f"{sheet.path} must hold a table, got a document or a picture. Save its table as CSV,"
            " or as a workbook."
        )
    if _has_single_column(rows[start:]):
        raise NoTableError(
            f"{sheet.place} must hold a table with a column of angles, got one column of"
            " numbers. Add a column 'Angle [deg]', or write a line 'Start angle: 0 deg; angle step:"
            " 1 deg' above the numbers."
        )
    check_cells_are_numbers(sheet)
    raise NoTableError(
        f"{sheet.place} must hold a table of at least {FEWEST_READINGS} rows with two columns of"
        f" numbers, got none. {_middle_row(sheet)}Check the separator (--separator), the encoding"
        " (--encoding) and what the file is; units belong into the header, not into cells."
    )


def _has_single_column(rows: Sequence[Row]) -> bool:
    """Return whether most rows of a sheet, and enough of them for a table, hold one number each."""
    n_numbers = 0
    for row in rows:
        n_numbers += len(row.cells) == 1 and looks_like_number(row.cells[0])
    return n_numbers >= max(FEWEST_READINGS, len(rows) // 2)


def _numbers_begin_at(sheet: Sheet, start: int) -> bool:
    """Return whether the numbers of a table begin at the row with the index ``start``.

    This is the case if this row and the next eight rows have the same number of cells and at least
    two numbers each. At the end of the sheet, fewer rows are enough.
    """
    width = len(sheet.rows[start].cells)
    if heads_loads(sheet.rows[start].cells):
        return False
    for row in sheet.rows[start : start + FEWEST_READINGS]:
        if count_numbers(row.cells) < 2 or len(row.cells) != width:
            return False
    return True


def _middle_row(sheet: Sheet) -> str:
    """Return a sentence that shows the row in the middle of a sheet, for an error message."""
    if not sheet.rows:
        return ""
    row = sheet.rows[len(sheet.rows) // 2]
    cells = ", ".join(repr(cell[:_CELL_SHOWN]) for cell in row.cells[:_CELLS_SHOWN])
    return f"Line {row.line} reads {cells}. "


def _first_row_without_header(sheet: Sheet, numbers_row: int) -> int:
    """Return the index of the first row of a table without a header.

    ``numbers_row`` is the index of the row at which the numbers of the table begin (see
    `_numbers_begin_at`). The row directly above also belongs to the table if it has the same number
    of cells, at least one of which is a number. Raise an `InputError` if rows further up hold
    numbers.
    """
    rows = sheet.rows
    width = len(rows[numbers_row].cells)
    first = numbers_row
    while first:
        cells_above = rows[first - 1].cells
        if len(cells_above) != width or count_numbers(cells_above) == 0:
            break
        first -= 1
    if first == 0:
        return first
    row = rows[first - 1]
    numbers_above = [count_numbers(row_above.cells) for row_above in rows[:first]]
    if numbers_above[-1] > 0 or max(numbers_above) >= 2:
        cells = ", ".join(repr(cell) for cell in row.cells)
        raise InputError(
            f"{sheet.place}, line {row.line}: rows of a table without a header must be alike, got"
            f" {cells[:_ROW_SHOWN]}. Correct or remove the line, or give --header-line."
        )
    return first


def _find_header_row(sheet: Sheet, layout: Layout, numbers_row: int) -> int | None:
    """Return the index of the header row in a sheet; None for a table without a header.

    ``numbers_row`` is the index of the row at which the numbers of the table begin. If the user
    does not state the line of the header, the header is the last row of words above the numbers,
    apart from a row of units. Raise an `InputError` if the table has rows of numbers above the
    header.
    """
    if layout.header_line == 0:
        return None
    rows = sheet.rows
    if layout.header_line is not None:
        header_row = _stated_header_row(sheet, layout.header_line)
    else:
        rows_of_words = [k for k in range(numbers_row) if _is_header(rows[k].cells)]
        if not rows_of_words:
            return None
        header_row = rows_of_words[-1]
        if len(rows_of_words) > 1 and row_of_units(rows[header_row].cells, sheet.separator):
            header_row = rows_of_words[-2]
    _check_no_numbers_above(sheet, header_row, numbers_row)
    return header_row


def _check_no_numbers_above(sheet: Sheet, header_row: int, numbers_row: int) -> None:
    """Raise an `InputError` if the table of a sheet has rows of numbers above its header.

    ``header_row`` and ``numbers_row`` are the indices of the header and of the row at which the
    numbers of the table begin.
    """
    rows = sheet.rows
    width = len(rows[numbers_row].cells)
    numbers_above = [row for row in rows[:header_row] if count_numbers(row.cells) >= 2]
    lines = []
    for row in numbers_above:
        if len(row.cells) == width and not _states_quantities(sheet, row.cells):
            lines.append(row.line)
    place = f"{sheet.place}, line {rows[header_row].line}"
    if len(lines) == 1:
        raise InputError(
            f"{place}: the header must stand above all numbers, got numbers in line {lines[0]}."
            f" Remove line {lines[0]}, or correct --header-line."
        )
    if lines:
        raise InputError(
            f"{place}: the header must stand above all numbers, got numbers in lines {lines[0]} to"
            f" {lines[-1]}. Remove lines {lines[0]} to {lines[-1]}, or correct --header-line."
        )


def _states_quantities(sheet: Sheet, cells: Sequence[str]) -> bool:
    """Return whether a row names a quantity before each number: ``Force [N];36;Radius [mm];100``.

    One of the quantities must be a load, the radius or the feed.
    """
    is_label = [bool(cell) and not looks_like_number(cell) for cell in cells]
    follows_label = [False, *is_label]
    for k, cell in enumerate(cells):
        if looks_like_number(cell) and not follows_label[k]:
            return False
    stated = statements_in([(0, sheet.text_of(cells))])
    return not _STATED_IN_ROWS.isdisjoint(stated)


def _is_header(cells: Sequence[str]) -> bool:
    """Return whether a row of cells is the header of a table (see `names_columns`).

    A row with numbers above the columns of readings is also a header (see `heads_loads`).
    """
    return names_columns(cells) or heads_loads(cells)


def _stated_header_row(sheet: Sheet, line: int) -> int:
    """Return the index, among the rows of a sheet, of the header row that the user states.

    ``line`` is the number of the header's line in the file. Raise an `InputError` if this row holds
    numbers instead of names.
    """
    header_row = [row.line for row in sheet.rows].index(line)
    cells = sheet.rows[header_row].cells
    if count_numbers(cells) >= 2 and not _is_header(cells):
        raise InputError(
            f"{sheet.place}, line {line}: the header must hold names, got numbers. Correct"
            " --header-line; 0: none."
        )
    return header_row


def _column_names(sheet: Sheet, header_row: int, numbers_row: int) -> list[str]:
    """Return the name of every column from the header row; empty for a column without a name.

    ``header_row`` is the index of the header row in the sheet, and ``numbers_row`` the index of the
    row at which the numbers begin. If blanks separate the cells, a unit in brackets is joined to
    the name before it. Raise an `InputError` if there are more names than columns, or if a column
    of the table has numbers but no name.
    """
    row = sheet.rows[header_row]
    names = without_comment_sign(row.cells)
    if sheet.separator == " ":
        names = _join_units(names)
    cells_below = sheet.rows[numbers_row].cells
    width = len(cells_below)
    if len(names) == width - 1 and _are_numbered(sheet.rows[numbers_row:]):
        names.insert(0, "")  # the program R writes row names in a column without a header
    while len(names) > width and not names[-1]:
        names.pop()
    if len(names) > width or any(cells_below[len(names) :]):
        advice = ""
        if sheet.separator == " ":
            advice = (
                " If a program printed the table, as to_string of pandas does: let it write CSV."
            )
        raise InputError(
            f"{sheet.place}, line {row.line}: the header must name every column, got"
            f" {len(names)} names for {width} cells. Correct it; with decimal commas separate the"
            f" cells by semicolons; --header-line where it is another, 0 for none.{advice}"
        )
    return names + [""] * (width - len(names))


def _are_numbered(rows: Sequence[Row]) -> bool:
    """Return whether the first cells of a table's rows are successive integers, such as 1, 2, 3.

    The table ends at the first row with another number of cells than its first row. The first
    integer may be larger than 1, because R numbers the rows of several tables throughout.
    """
    width = len(rows[0].cells)
    table = list(takewhile(lambda row: len(row.cells) == width, rows))
    first = rows[0].cells[0]
    if not first.isdecimal() or len(table) < min(FEWEST_READINGS, len(rows)):
        return False
    return all(row.cells[0] == str(number) for number, row in enumerate(table, start=int(first)))


def _join_units(words: Sequence[str]) -> list[str]:
    """Return the words of a header, with each unit in brackets joined to the word before it.

    ``words`` are the cells of a header that was split at every blank.
    """
    joined: list[str] = []
    for word in words:
        if joined and BRACKET.match(word):
            joined[-1] += f" {word}"
        else:
            joined.append(word)
    return joined


def unused_columns(heading: Heading) -> list[int]:
    """Return the indices of the columns of a table that have a header but no role.

    A role is what a column holds, such as angle. Columns whose header is the name of a field of a
    test, such as setup, are left out.
    """
    columns_in_use = {*heading.roles.values(), *heading.readings, *heading.unit_columns}
    unused = []
    for column, header in enumerate(heading.headers):
        if header and column not in columns_in_use and header not in PER_TEST:
            unused.append(column)
    return unused
