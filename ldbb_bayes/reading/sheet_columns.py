"""Table of a sheet, whose cells are stored column by column."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.campaign.campaign import PER_TEST
from ldbb_bayes.campaign.text_table import columns_of
from ldbb_bayes.errors import InputError
from ldbb_bayes.reading.assumptions import AssumptionLog, shown_list
from ldbb_bayes.reading.column_contents import (
    check_angle_columns,
    check_directions,
    name_plane_column,
    with_condition_that_names_tests,
)
from ldbb_bayes.reading.column_roles import names_circle
from ldbb_bayes.reading.decimal_marks import check_thousands, decimal_mark_of
from ldbb_bayes.reading.g_words import with_columns_of_g_words
from ldbb_bayes.reading.header_units import BRACKET, unit_of
from ldbb_bayes.reading.heading import Heading, unused_columns
from ldbb_bayes.reading.heading_notes import note_heading
from ldbb_bayes.reading.layout import Layout
from ldbb_bayes.reading.lines_above import LineStatement, statements_in
from ldbb_bayes.reading.merged_rows import with_merged_rows_filled
from ldbb_bayes.reading.missing_readings import missing_in
from ldbb_bayes.reading.numbering_columns import (
    column_that_repeats,
    columns_that_number,
    conditions_that_number,
)
from ldbb_bayes.reading.numerals import (
    constant_value,
    is_clock,
    is_missing,
    looks_like_number,
    numbers_in,
)
from ldbb_bayes.reading.planes import plane_named
from ldbb_bayes.reading.recording import RowUnits
from ldbb_bayes.reading.sheet import Sheet
from ldbb_bayes.reading.sign_columns import check_signs_are_not_apart
from ldbb_bayes.reading.statistics_rows import (
    statistics_among,
    unfit_among,
    words_among_numbers,
)
from ldbb_bayes.reading.table_rows import table_rows
from ldbb_bayes.reading.texts_beside import without_texts_behind
from ldbb_bayes.reading.travel_direction import with_sides_in_full
from ldbb_bayes.reading.unit_columns import unit_columns
from ldbb_bayes.reading.words import LONGEST_NAME, UNITS, unit_named
from ldbb_bayes.reading.workbook_parts import PERCENT, THOUSANDS
from ldbb_bayes.results import Array

__all__ = ["NOT_SHARED", "SheetColumns", "read_columns"]

# A role says what a column holds. Columns with the following roles hold no numbers that apply to
# all tests of a sheet: columns with the roles test and direction hold words, and a column with the
# role reading may belong to a single test. Numbers in all other columns apply to all tests.
NOT_SHARED = ("test", "direction", "reading")
# Fields of a test that a column of the table may also state, with the same value in all rows of the
# test.
_FIELDS_OF_COLUMNS = ("radius_mm", "feed_mm_per_min", "start_deg", "overshoot_deg")
# Number formats that show another number than is stored.
_SHOWN_OTHERWISE = (PERCENT, THOUSANDS)
# Headers of columns that state conditions of a test without a role.
_CONDITIONS = ("plane", "radius_mm")


@dataclass(frozen=True)
class SheetColumns:
    """Table of a sheet, whose cells are stored column by column."""

    sheet: Sheet
    heading: Heading
    lines: list[int]  # line number, in the file, of each row of the table
    cells: list[list[str]]  # cells of each column of the table
    clock_column: int | None  # index of the column with times of day; None if there is none
    decimal: str | None  # decimal mark of the table's numbers; None if no number has one
    # index of the column of units for each column of numbers that has one; the keys are the indices
    # of the columns of numbers
    unit_columns: Mapping[int, int]
    # indices of columns that together identify the tests, although none of them does so alone;
    # empty if there are none
    numbering: Sequence[int]

    @property
    def numbering_headers(self) -> list[str]:
        """Headers of the columns that together identify the tests, but do not do so alone."""
        return [self.heading.headers[column] for column in self.numbering]

    def row_units(self, roles: Mapping[str, int], rows: Sequence[int]) -> dict[str, list[RowUnits]]:
        """Return a dict with the units of each column whose units the file states row by row.

        The keys are the roles of the columns: a role, such as angle, says what a column holds.
        ``roles`` holds the index of the column for each role, and ``rows`` holds the indices of the
        rows of a test.
        """
        units = {}
        for role, column in roles.items():
            if role in UNITS:
                units[role] = [entry for entry in self._units(column, rows) if any(entry.units)]
        return units

    def _units(self, column: int, rows: Sequence[int]) -> Iterator[RowUnits]:
        """Yield the units of a column in the given rows, once for each place that may state units.

        There are three places: a column of units, the cells of the column itself, and the number
        formats of these cells. ``column`` is the index of the column, and ``rows`` are the indices
        of the rows.
        """
        if column in self.unit_columns:
            units = self.cells_with_units(self.unit_columns[column], rows)
            yield RowUnits(units, "a column of units")
        places = [(self.lines[row], column) for row in rows]
        cell_units = self.sheet.cell_units
        yield RowUnits([cell_units.get(place, "") for place in places], "its cells")
        format_units = self.sheet.format_units
        source = "the number format of its cells"
        yield RowUnits([format_units.get(place, "") for place in places], source)

    def cells_with_units(self, column: int, rows: Sequence[int]) -> list[str]:
        """Return the cells of a column as they stand in the file, with the units after the numbers.

        When the file is read, a unit after a number is removed from the cell; here it is put back.
        For example, "0.1 µm" may be a cell of a column of units: it is a unit with a factor.
        ``column`` and ``rows`` are the indices of the column and of the rows.
        """
        cells = self.cells[column]
        if not self.sheet.cell_units:
            return [cells[row].strip() for row in rows]
        texts = []
        for row in rows:
            unit = self.sheet.cell_units.get((self.lines[row], column), "")
            texts.append(f"{cells[row]} {unit}".strip())
        return texts

    def numbers(self, role: str, column: int) -> Array:
        """Return the numbers in a column as an array, one for each of the n rows, shape (n,).

        A cell that is empty or holds a word such as NaN gives NaN, provided that its row has no
        reading. Any other cell that is not a number raises an `InputError`. ``column`` is the index
        of the column from 0; ``role`` is the role of the column, such as angle.
        """
        title = self.heading.column_title(role, column)
        place = self.sheet.place
        cells = self.cells[column]
        may_be_missing = self._rows_without_reading(role, column)
        numbers = np.full(len(cells), np.nan)
        present = []
        for row, cell in enumerate(cells):
            if not (may_be_missing[row] and (not cell or is_missing(cell))):
                present.append(row)
        numbers[present] = numbers_in(
            place,
            title,
            [self.lines[row] for row in present],
            [cells[row] for row in present],
            self.decimal,
        )
        return numbers

    def _rows_without_reading(self, role: str, column: int) -> NDArray[np.bool_]:
        """Return an array that states for each of the n rows whether it has no reading, shape (n,).

        ``role`` says what the column with the index ``column`` holds. If it is a column of
        readings, a row has no reading if its cell in this column is missing. If the column holds
        anything else, such as angles, a row has no reading if its cells in all columns of readings
        are missing.
        """
        if role == "reading":
            return missing_in(self.cells[column])
        without_reading = np.full(len(self.lines), bool(self.heading.readings))
        for reading_column in self.heading.readings:
            without_reading &= missing_in(self.cells[reading_column])
        return without_reading

    def constant(self, test: str, key: str, column: int, rows: Sequence[int]) -> str | float | None:
        """Return the value of a column in all rows of one test; None if these cells are empty.

        Planes and directions are returned as texts, all other values as numbers. Raise an
        `InputError` if these rows have different values.

        Parameters
        ----------
        test
            Name of the test, for the message.
        key
            Field of the test that the column states.
        column
            Index of the column from 0.
        rows
            Indices of the rows of the test from 0.
        """
        lines = [self.lines[k] for k in rows]
        cells = [self.cells[column][k] for k in rows]
        if key == "plane":
            cells = [plane_named(cell) for cell in cells]
        return constant_value(self.sheet.place, test, key, lines, cells, self.decimal)

    def cells_by_header(self, row: int) -> dict[str, str]:
        """Return a dict with the texts of the cells in a row; the keys are the headers.

        ``row`` is the index of the row. Cells of columns without a header are left out.
        """
        texts = {}
        for header, cells in zip(self.heading.headers, self.cells, strict=True):
            if header:
                texts[header] = cells[row]
        return texts

    def constant_lines(self, rows: Sequence[int]) -> list[tuple[int | str, str]]:
        """Return a line of text for each column whose cells are all equal in the rows of one test.

        ``R [mm]: 100``, for example, is the line for a column ``R [mm]`` or ``R_mm`` whose cells
        are all 100. ``rows`` are the indices of the rows of the test. Columns that are read
        elsewhere, such as angles and readings, are left out. The result is a list of pairs: a text
        that names the column, and the line.
        """
        lines: list[tuple[int | str, str]] = []
        in_use = {*self.heading.roles.values(), *self.heading.readings, *self.unit_columns.values()}
        # A radius both identifies a circle and is a number of the test.
        for column in self.numbering:
            if not _states_radius(self.heading, column, self.cells[column][rows[0]]):
                in_use.add(column)
        for column, header in enumerate(self.heading.headers):
            cells = {self._with_unit_of_format(column, k) for k in rows}
            if header and column not in in_use and len(cells) == 1 and header not in PER_TEST:
                lines.append(
                    (
                        self.place_of_column(column),
                        f"{_header_with_unit(self.heading, column)}: {cells.pop()}",
                    )
                )
        return lines

    def _with_unit_of_format(self, column: int, row: int) -> str:
        """Return a cell with the unit behind its number, in its column of units, or in its format.

        ``column`` and ``row`` are the indices of the column and of the row.
        """
        cell = self.cells_with_units(column, [row])[0]
        if column in self.unit_columns:
            return f"{cell} {self.cells[self.unit_columns[column]][row]}".strip()
        unit = unit_named(self.sheet.format_units.get((self.lines[row], column), ""))
        return f"{cell} {unit}" if unit and looks_like_number(cell) else cell

    def place_of_column(self, column: int) -> str:
        """Return a text that names a column in messages by its line and its header.

        An example is "3, column 'R [mm]'", where 3 is the line of the header.
        """
        return f"{self.heading.line}, column {self.heading.headers[column]!r}"

    def constant_statements(self, rows: Sequence[int]) -> dict[str, list[LineStatement]]:
        """Return a dict with the fields of a test, such as the radius, that constant columns state.

        The keys are the names of the fields. In a constant column, the cells are equal in all rows
        of the test. For example, a column ``R [mm]`` whose cells are all 100 states the radius.
        Only radius, feed, start angle and overshoot can be stated in this way
        (``_FIELDS_OF_COLUMNS``). ``rows`` are the indices of the rows of the test.
        """
        statements = {}
        for key, statements_of_field in statements_in(self.constant_lines(rows)).items():
            if key in _FIELDS_OF_COLUMNS:
                statements[key] = statements_of_field
        return statements

    def direction_words(self, rows: Sequence[int]) -> dict[str, int]:
        """Return a dict with the line in which each word of the column of directions first appears.

        The keys are the words, and the values are the line numbers. An empty cell counts as the
        word "". If the column holds both letters R and L and no other word, the letters are
        replaced by "right" and "left". The dict is empty if the table has no such column. ``rows``
        are the indices (from 0) of the rows that are considered.
        """
        words: dict[str, int] = {}
        if "direction" in self.heading.roles:
            cells = with_sides_in_full(self.cells[self.heading.roles["direction"]])
            for k in rows:
                words.setdefault(cells[k], self.lines[k])
        return words


def _header_with_unit(heading: Heading, column: int) -> str:
    """Return a header with its unit in brackets: ``Radius [m]`` for ``Radius_m``.

    A unit that stands in the row of units below the header takes precedence. A header that has
    brackets or no known unit is returned unchanged. ``column`` is the index of the column from 0.
    """
    header = heading.headers[column]
    stated = unit_of(header)
    unit_below = heading.units[column] if column in heading.columns_with_unit_below else ""
    if unit_below and unit_below != stated.unit:
        return f"{stated.name.replace('_', ' ')} [{unit_below}]"
    if BRACKET.search(header) or stated.name == header or not unit_named(stated.unit):
        return header
    return f"{stated.name.replace('_', ' ')} [{stated.unit}]"


def read_columns(
    sheet: Sheet, heading: Heading, layout: Layout, stated_plane: str | None, log: AssumptionLog
) -> SheetColumns:
    """Return the table of a sheet, with the cells of each column in a list.

    Assumptions about the header and the decimal mark of the table are added to the log.
    ``stated_plane`` is the plane that the user states for all tests, or None.
    """
    lines, cells = _columns_of_table(sheet, heading)
    cells_with_units = _cells_with_units(sheet, lines, cells)
    columns_of_units = unit_columns(heading.headers, cells_with_units, _numeric_columns(heading))
    heading = replace(heading, unit_columns=frozenset(columns_of_units.values()))
    check_angle_columns(sheet, heading, cells)
    cells = with_merged_rows_filled(sheet, heading, lines, cells, log)
    heading, cells = with_columns_of_g_words(heading, cells)
    heading = with_condition_that_names_tests(sheet, heading, cells, layout)
    heading = name_plane_column(sheet, heading, cells, stated_plane, log)
    check_directions(sheet, heading, cells, layout)
    _check_rows_hold_readings(sheet, heading, lines, cells)
    check_signs_are_not_apart(sheet, heading, lines, cells)
    numbering = _numbering_columns(heading, cells, layout)
    _check_radii_have_a_unit(sheet, heading, cells, numbering, layout)
    if numbering and "test" not in layout.columns:
        heading = _without_test_column(heading)
    note_heading(sheet, heading, layout, log)
    clock_column = None
    if "time" in heading.roles and is_clock(cells[heading.roles["time"]][0]):
        clock_column = heading.roles["time"]
    number_columns = [column for column in _numeric_columns(heading) if column != clock_column]
    _check_formulas(sheet, heading, lines, number_columns)
    _check_struck_cells(sheet, heading, lines, number_columns, cells)
    _check_shown_numbers(sheet, heading, lines, number_columns)
    cells_by_line: list[tuple[int, str]] = []
    for k, line in enumerate(lines):
        cells_by_line += [(line, cells[column][k]) for column in number_columns]
    decimal = decimal_mark_of(sheet, cells_by_line, layout, log)
    if decimal is not None and layout.decimal is None and not sheet.stores_numbers:
        for column in number_columns:
            check_thousands(sheet, lines, cells[column], decimal)
    if clock_column is not None:
        units = list(heading.units)
        units[clock_column] = "s"
        heading = replace(heading, units=units)
    return SheetColumns(
        sheet, heading, lines, cells, clock_column, decimal, columns_of_units, numbering
    )


def _columns_of_table(sheet: Sheet, heading: Heading) -> tuple[list[int], list[list[str]]]:
    """Return the line number of each row of the table of a sheet, and the cells of each column."""
    width = len(heading.headers)
    rows = table_rows(sheet, heading)
    if sheet.separator != " ":
        rows = without_texts_behind(rows, width)
    return columns_of(sheet.place, rows, width)


def _cells_with_units(
    sheet: Sheet, lines: Sequence[int], cells: Sequence[Sequence[str]]
) -> list[list[str]]:
    """Return the cells of each column of a table as in the file, with the units after numbers.

    ``cells`` holds the cells of each column. The units were removed from these cells when the sheet
    was read, and are stored in the field ``cell_units`` of ``sheet``. ``lines`` are the line
    numbers of the rows.
    """
    columns = []
    for column, texts in enumerate(cells):
        with_units = []
        for line, text in zip(lines, texts, strict=True):
            with_units.append(f"{text} {sheet.cell_units.get((line, column), '')}".strip())
        columns.append(with_units)
    return columns


def _check_rows_hold_readings(
    sheet: Sheet, heading: Heading, lines: Sequence[int], cells: Sequence[Sequence[str]]
) -> None:
    """Raise an `InputError` if an otherwise unused column says that some rows hold no readings.

    For example, a column ``stat`` may hold the word "raw" in rows of readings, and "mean" in a row
    of means, or a column ``Quality`` the words "Good" and "Bad". Or a column of row numbers may
    hold the words "Gain" and "Offset" in its first cells. ``lines`` are the line numbers of the
    rows, and ``cells`` are the cells of each column.
    """
    for column in unused_columns(heading):
        rows = statistics_among(cells[column])
        if rows:
            name = heading.headers[column][:LONGEST_NAME]
            listed = shown_list([str(lines[row]) for row in rows])
            raise InputError(
                f"{sheet.place}: rows must hold readings, got {cells[column][rows[0]]!r} in column"
                f" {name!r}. Remove the rows of statistics: {listed}."
            )
        unfit = unfit_among(cells[column])
        if unfit:
            name = heading.headers[column][:LONGEST_NAME]
            listed = shown_list([str(lines[row]) for row in unfit])
            raise InputError(
                f"{sheet.place}, line {lines[unfit[0]]}: rows must hold readings, got"
                f" {cells[column][unfit[0]][:LONGEST_NAME]!r} in column {name!r}. Remove the rows:"
                f" {listed}. If they are readings, remove these words."
            )
        words = words_among_numbers(cells[column])
        if words:
            name = heading.headers[column][:LONGEST_NAME]
            word = cells[column][words[0]][:LONGEST_NAME]
            listed = shown_list([str(lines[row]) for row in words])
            raise InputError(
                f"{sheet.place}: rows must hold readings, got {word!r} in column {name!r}. Apply to"
                f" the readings what these rows state, and remove the rows: {listed}."
            )


def _check_formulas(
    sheet: Sheet, heading: Heading, lines: Sequence[int], columns: Sequence[int]
) -> None:
    """Raise an `InputError` for a formula without a stored value in a column of numbers.

    ``lines`` are the line numbers of the rows of the table, and ``columns`` are the indices of the
    columns of numbers.
    """
    for line in lines:
        for column in columns:
            if (line, column) in sheet.formulas_without_value:
                name = heading.headers[column][:LONGEST_NAME] or column + 1
                raise InputError(
                    f"{sheet.place}, line {line}: column {name!r} must hold values, got a formula"
                    " without a stored value. Open the file in a spreadsheet program and save it"
                    " once, or export the sheet as CSV."
                )


def _check_struck_cells(
    sheet: Sheet,
    heading: Heading,
    lines: Sequence[int],
    columns: Sequence[int],
    cells: Sequence[Sequence[str]],
) -> None:
    """Raise an `InputError` for numbers that are struck through: they are no good readings.

    ``lines`` are the line numbers of the rows of the table. ``columns`` are the indices of the
    columns of numbers, and ``cells`` are the cells of each column of the table.
    """
    for column in columns:
        struck_lines = []
        for line, cell in zip(lines, cells[column], strict=True):
            if cell and (line, column) in sheet.struck_cells:
                struck_lines.append(str(line))
        if struck_lines:
            name = heading.headers[column][:LONGEST_NAME] or column + 1
            raise InputError(
                f"{sheet.place}, line {struck_lines[0]}: rows must hold readings, got numbers"
                f" struck through in column {name!r}. Empty the cells in lines"
                f" {shown_list(struck_lines)}. If"
                " they are readings, remove the line through them."
            )


def _check_shown_numbers(
    sheet: Sheet, heading: Heading, lines: Sequence[int], columns: Sequence[int]
) -> None:
    """Raise an `InputError` for a cell in percent or in thousands in a column of numbers.

    A workbook shows another number than it stores in such a cell. Nothing says which of the two is
    in the unit of the column. ``lines`` are the line numbers of the rows of the
    table, and ``columns`` are the indices of the columns of numbers.
    """
    for line in lines:
        for column in columns:
            if sheet.format_units.get((line, column)) in _SHOWN_OTHERWISE:
                name = heading.headers[column][:LONGEST_NAME] or column + 1
                raise InputError(
                    f"{sheet.place}, line {line}: column {name!r} must hold numbers in its unit,"
                    " got a cell shown in percent or in thousands. Format the column as number, and"
                    " see that the numbers are right."
                )


def _numeric_columns(heading: Heading) -> list[int]:
    """Return the indices of the columns that hold numbers.

    These are all columns with a role (angle, reading, …), except the columns that name tests or
    directions.
    """
    columns = []
    for role, column in heading.roles.items():
        if role not in NOT_SHARED:
            columns.append(column)
    return columns + heading.readings


def _numbering_columns(
    heading: Heading, cells: Sequence[Sequence[str]], layout: Layout
) -> list[int]:
    """Return the indices of columns without the role of naming tests that identify the tests.

    Examples are the columns ``run`` and ``pass``. All rows with the same cells in both columns have
    the same force, pressure and direction. This is not true of either column alone. A column such
    as ``rep`` identifies the tests alone if all rows have the same conditions. If no column numbers
    the tests, the conditions themselves may identify them, such as force, direction and plane.
    Return an empty list if there are no such columns. ``cells`` holds the cells of each column, and
    ``layout`` is the layout that the user states.
    """
    roles = heading.roles
    conditions = [roles[role] for role in ("force", "pressure", "direction") if role in roles]
    numbering: list[int] = []
    if conditions:
        numbering = columns_that_number(heading.headers, cells, conditions)
    if len(numbering) > 1:
        return numbering
    if len(heading.readings) > 1:
        return []
    without_role = _columns_without_role(heading, cells)
    if "test" not in roles:
        stated = sorted({*conditions, *without_role})
        repeated = column_that_repeats(heading.headers, cells, stated, roles.get("angle"))
        if repeated:
            return repeated
    if numbering:
        return []
    columns = conditions_that_number(
        heading.headers,
        cells,
        sorted({*conditions, *without_role}),
        roles.get("angle"),
        without_role,
    )
    is_named = "test" in roles and "test" not in layout.columns
    if is_named and roles["test"] not in columns:
        return []
    return columns


def _columns_without_role(heading: Heading, cells: Sequence[Sequence[str]]) -> list[int]:
    """Return the indices of columns without a role that state conditions, such as the radius.

    ``cells`` holds the cells of each column.
    """
    columns = []
    for column, header in enumerate(heading.headers):
        if column in heading.roles.values() or column in heading.readings or not cells[column]:
            continue
        if header in _CONDITIONS or _states_radius(heading, column, cells[column][0]):
            columns.append(column)
    return columns


def _check_radii_have_a_unit(
    sheet: Sheet,
    heading: Heading,
    cells: Sequence[Sequence[str]],
    numbering: Sequence[int],
    layout: Layout,
) -> None:
    """Raise an `InputError` if tests differ in a radius whose unit nothing states.

    An example is a column ``R`` with the numbers 100 and 150. No error is raised if the layout
    states radii. ``numbering`` are the indices of the columns that identify the tests, and
    ``cells`` holds the cells of each column.
    """
    if any(entry.radius_mm is not None for entry in layout.test):
        return
    for column in numbering:
        header = heading.headers[column][:LONGEST_NAME]
        line = f"{_header_with_unit(heading, column)}: {cells[column][0]}"
        if not names_circle(header) or "radius_mm" in statements_in([(0, line)]):
            continue
        raise InputError(
            f"{sheet.place}, line {heading.line}: radii must have a unit, got none in column"
            f" {header!r}. Write it into the header, for example '{header} [mm]'."
        )


def _states_radius(heading: Heading, column: int, cell: str) -> bool:
    """Return whether a column with this cell states the radius of a circle.

    ``column`` is the index of the column from 0.
    """
    line = f"{_header_with_unit(heading, column)}: {cell}"
    return names_circle(heading.headers[column]) or "radius_mm" in statements_in([(0, line)])


def _without_test_column(heading: Heading) -> Heading:
    """Return a copy of a table's heading in which no column has the role of naming the tests."""
    roles = dict(heading.roles)
    roles.pop("test", None)
    return replace(heading, roles=roles)
