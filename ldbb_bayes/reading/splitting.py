"""Functions that split imported tables into tests, and convert the cells to numbers."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.campaign.campaign import LABELS, PER_TEST
from ldbb_bayes.campaign.text_table import Row, columns_of
from ldbb_bayes.errors import InputError
from ldbb_bayes.reading.assumptions import AssumptionLog, shown_list
from ldbb_bayes.reading.column_contents import (
    check_angle_columns,
    check_directions,
    name_plane_column,
    with_condition_that_names_tests,
)
from ldbb_bayes.reading.column_roles import BRACKET, unit_of
from ldbb_bayes.reading.headers import Heading, note_heading, unused_columns
from ldbb_bayes.reading.layout import Layout
from ldbb_bayes.reading.line_parts import segments_of_line
from ldbb_bayes.reading.lines_above import Lines, LineStatement, statements_in
from ldbb_bayes.reading.list_columns import unread_headers, with_loads_named
from ldbb_bayes.reading.missing_readings import missing_in
from ldbb_bayes.reading.numbering_columns import columns_that_number
from ldbb_bayes.reading.numerals import (
    OTHER_MARK,
    constant_value,
    could_be_thousands,
    decimal_mark,
    is_clock,
    is_missing,
    looks_like_number,
    numbers_in,
    seconds_of,
)
from ldbb_bayes.reading.overview import overview_lines
from ldbb_bayes.reading.placeholders import placeholders_in
from ldbb_bayes.reading.planes import plane_named
from ldbb_bayes.reading.recording import Recording, RowUnits
from ldbb_bayes.reading.sheet import Sheet
from ldbb_bayes.reading.statistics_rows import (
    label_of_statistics,
    rows_of_statistics,
    statistics_among,
    words_among_numbers,
)
from ldbb_bayes.reading.texts_beside import TextBeside, texts_beside, texts_of_test
from ldbb_bayes.reading.travel_direction import with_sides_in_full
from ldbb_bayes.reading.unit_columns import unit_columns
from ldbb_bayes.reading.unit_lines import UNIT_KEYS
from ldbb_bayes.reading.unit_sentences import units_in_sentences
from ldbb_bayes.reading.words import LONGEST_NAME, LONGEST_TEXT, UNITS, unit_named
from ldbb_bayes.results import Array

__all__ = ["FIELDS_OF_ALL_TESTS", "layout_names", "split_sheet"]

# A role says what a column holds. Columns with the following roles hold no numbers that apply to
# all tests of a sheet: columns with the roles test and direction hold words, and a column with the
# role reading may belong to a single test. Numbers in all other columns apply to all tests.
_NOT_SHARED = ("test", "direction", "reading")
# Regular expression for a number at the beginning of a cell, as in "0.9 x 10 um".
_BEGINS_WITH_NUMBER = re.compile(r"\s*[+\-−]?[.,]?\d")
# Commas or points in a column may be decimal marks or separate thousands. A column is checked for
# this only if at least this many of its numbers have the assumed decimal mark.
_FEWEST_MARKED = 5
# Regular expression for the beginning of a line with a telephone number, or with a number that
# identifies a company or its bank account.
_CONTACT = re.compile(
    r"\W*(?:tel|phone|telephone|telefon|téléphone|mob|mobile|mobil|fax|gsm|handy|iban|kvk|vat)"
    r"(?![^\W_])",
    re.IGNORECASE,
)
# If the name of a test stands only in its first row, the test must have at least this number of
# rows.
_FEWEST_ROWS = 9
# Fields of a test that a column of the table may also state, with the same value in all rows of the
# test.
_FIELDS_OF_COLUMNS = ("radius_mm", "feed_mm_per_min", "start_deg", "overshoot_deg")
# Regular expression for a number that may be a result of a measurement, such as 12 µm. It does not
# match G2, G3 or a factor of −1.
_RESULT = re.compile(r"(?<![^\W_])(?:\d\d|\d(?<![-−]1))")
# Fields for which the lines below a table, and the texts beside it, are searched: whether readings
# measure the radius or the diameter, and whether they contain the deflection of the mount. Values
# of other fields are not taken from these lines, because they may be results.
_STATED_AROUND = ("measured", "mount")
# Fields of a test or of the campaign. If a sheet has no table, its lines may state values of these
# fields. Such a value applies to all tests.
FIELDS_OF_ALL_TESTS = {
    "plane",
    "resolution_um",
    "mount",
    "feed_mm_per_min",
    "radius_mm",
    "temperature_C",
    *UNIT_KEYS,
    *LABELS,
}


@dataclass(frozen=True)
class _SheetColumns:
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
    # indices of two columns that together identify the tests, although neither column does so
    # alone; empty if there are none
    numbering: Sequence[int]

    @property
    def numbering_headers(self) -> list[str]:
        """Headers of the two columns that together identify the tests, but do not do so alone."""
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
        in_use.update(self.numbering)
        for column, header in enumerate(self.heading.headers):
            cells = set(self.cells_with_units(column, rows))
            if header and column not in in_use and len(cells) == 1 and header not in PER_TEST:
                lines.append(
                    (
                        self.place_of_column(column),
                        f"{_with_unit_in_brackets(header)}: {cells.pop()}",
                    )
                )
        return lines

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


def _with_unit_in_brackets(header: str) -> str:
    """Return a header with its unit in brackets: ``Radius [m]`` for ``Radius_m``.

    A header that has brackets or no known unit is returned unchanged.
    """
    stated = unit_of(header)
    if BRACKET.search(header) or stated.name == header or not unit_named(stated.unit):
        return header
    return f"{stated.name.replace('_', ' ')} [{stated.unit}]"


def split_sheet(
    sheet: Sheet,
    heading: Heading,
    layout: Layout,
    campaign: Mapping[str, Any],
    log: AssumptionLog,
    left_out: Sequence[Sheet],
) -> Iterator[Recording]:
    """Split the table of one sheet into tests, and yield a recording for each test.

    A table holds one test for every column of readings. If a column names the tests, the table
    holds one test for every name in that column. The tests are yielded in the order of the columns
    of readings; tests that a column names are yielded in the order of their first rows. Each
    recording has the numbers of the test, and everything that the file, the name of the file and
    the user state about the test.

    Parameters
    ----------
    sheet, heading
        The sheet and the heading of its table.
    layout
        Layout that the user states.
    campaign
        Fields of the campaign that the user's options set.
    log
        Log to which assumptions are added.
    left_out
        Sheets without a table, which may state fields for all tests or for one test.

    Raises
    ------
    InputError
        If a cell is not a number, or if a statement does not fit the tests.
    """
    sheet = _without_statistics(sheet, heading, log)
    columns = _read_columns(sheet, heading, layout, campaign.get("plane"), log)
    shared_numbers = _shared_numbers(columns, layout)
    labels = _labels_of(columns, log)
    rows_by_label: dict[str, list[int]] = {}
    for row, label in enumerate(labels):
        rows_by_label.setdefault(label, []).append(row)
    field_columns = _field_columns(columns, labels, log)
    holds_several = len(rows_by_label) > 1 or len(heading.readings) > 1 or bool(sheet.name_in_file)
    texts_below = _texts_below(sheet, columns.lines)
    lines_below = _without_results(texts_below)
    columns_in_use = {*columns.unit_columns.values(), *columns.numbering, *field_columns.values()}
    beside = texts_beside(sheet, columns.heading, columns.lines, columns_in_use)
    unused = _unused_columns(columns, list(rows_by_label.values()), beside)
    for test_heading in columns.heading.split_by_readings():
        numbers = dict(shared_numbers)
        for column in test_heading.readings:
            numbers["reading"] = columns.numbers("reading", column)
        for label, all_rows in rows_by_label.items():
            title = label or test_heading.label
            rows = _with_readings(columns, test_heading, numbers, all_rows, title, log)
            rows = _without_placeholders(columns, test_heading, numbers, rows, title, log)
            _check_start_of_log(columns, test_heading, all_rows, rows, title)
            stated = _stated_fields(sheet, title, layout, holds_several)
            fields = {}
            for key, column in field_columns.items():
                fields[key] = columns.constant(title, key, column, rows)
            name = label or sheet.name or sheet.path.stem
            overview = overview_lines(left_out, [name, sheet.path.name])
            listed = with_loads_named(overview.of_this_test)
            lines_above = [*test_heading.lines_above, *listed]
            _note_unread_list(sheet, unread_headers(listed, [name, sheet.path.name]), log)
            statements = _statements_of_all_tests(overview.of_all_tests)
            statements |= columns.constant_statements(rows)
            statements |= statements_in(lines_above)
            lines_beside = texts_of_test(beside, {columns.lines[row] for row in all_rows})
            _add_statements_around(statements, [*lines_below, *lines_beside])
            _add_units_around(statements, test_heading, [*texts_below, *lines_beside])
            yield Recording(
                sheet=sheet,
                heading=replace(test_heading, lines_above=lines_above),
                label=title,
                lines=[columns.lines[row] for row in rows],
                numbers={role: column_numbers[rows] for role, column_numbers in numbers.items()},
                row_units=columns.row_units(test_heading.roles, rows),
                first_cells=columns.cells_by_header(rows[0]),
                direction_words=columns.direction_words(rows),
                statements=statements,
                layout=layout,
                stated=stated,
                campaign=campaign,
                log=log,
                fields=fields,
                lines_of_all_tests=overview.of_all_tests,
                lines_below=lines_below,
                lines_beside=lines_beside,
                texts_beside=beside,
                constant_columns=columns.constant_lines(rows),
                numbering_headers=columns.numbering_headers,
                unused_columns=unused,
            )


def _texts_below(sheet: Sheet, lines_of_table: Sequence[int]) -> list[tuple[int | str, str]]:
    """Return the number and the text of each line below a table.

    ``lines_of_table`` are the numbers of the lines of the table.
    """
    last_line = max(lines_of_table, default=0)
    return list(sheet.texts(row for row in sheet.rows if row.line > last_line))


def _without_results(lines: Lines) -> list[tuple[int | str, str]]:
    """Return the number and the text of each line below a table, leaving out possible results.

    A segment of a line is left out if it holds a number that may be a result of the test, as in
    ``Circularity CW: 12 µm``.
    """
    remaining: list[tuple[int | str, str]] = []
    for line, text in lines:
        text_without_results = text
        if _RESULT.search(text):
            segments = segments_of_line(text[:LONGEST_TEXT])
            text_without_results = "; ".join(
                segment for segment in segments if not _RESULT.search(segment)
            )
        if text_without_results:
            remaining.append((line, text_without_results))
    return remaining


def _add_statements_around(statements: dict[str, list[LineStatement]], lines: Lines) -> None:
    """Add to ``statements`` what lines below a table, and texts beside it, state about readings.

    These lines may state whether the readings measure the radius or the diameter, and whether they
    contain the deflection of the mount. Other numbers and texts below a table may be results of the
    measurement, and are not added.
    """
    statements_of_lines = statements_in(lines)
    for key in _STATED_AROUND:
        if key in statements_of_lines:
            statements[key] = [*statements.get(key, ()), *statements_of_lines[key]]


def _add_units_around(
    statements: dict[str, list[LineStatement]], heading: Heading, lines: Lines
) -> None:
    """Add to ``statements`` the units of angles and readings that sentences around a table state.

    An example is ``All deviations in 0.1 µm`` below the table. A unit is added only if neither the
    header nor a line above the table states the unit. Other texts with a unit may be results.
    """
    for role in ("angle", "reading"):
        key = f"{role}_unit"
        if key in statements or role not in heading.roles or heading.units[heading.roles[role]]:
            continue
        stated = []
        for line, text in lines:
            unit = units_in_sentences(text).get(key)
            if unit:
                stated.append(LineStatement(unit, unit, line))
        if stated:
            statements[key] = stated


def _note_unread_list(sheet: Sheet, headers: Sequence[str], log: AssumptionLog) -> None:
    """Add a note to the log on unused columns in a list of tests.

    ``headers`` are the headers of these columns. ``sheet`` is the sheet with the table of the test.
    """
    if headers:
        log.add(
            sheet.place,
            "columns not used",
            shown_list(headers, LONGEST_NAME),
            "in the list of tests on another sheet, no role is known for them",
            "a [[test]] in --layout",
        )


def _with_readings(
    columns: _SheetColumns,
    heading: Heading,
    numbers: Mapping[str, Array],
    rows: Sequence[int],
    title: str,
    log: AssumptionLog,
) -> list[int]:
    """Return the indices of the rows of a test that have a reading.

    The number of rows without a reading is noted. The parameters are explained in
    `_without_placeholders`.
    """
    if "reading" not in numbers or not heading.readings:
        return list(rows)
    readings = numbers["reading"]
    with_reading = [row for row in rows if np.isfinite(readings[row])]
    without_reading = [row for row in rows if not np.isfinite(readings[row])]
    if not with_reading:
        raise InputError(
            f"{_place_of_test(columns, title)}: a test must have readings, got none in lines"
            f" {columns.lines[rows[0]]} to {columns.lines[rows[-1]]}. Say which column holds them"
            " (--reading-column), or remove these lines."
        )
    if without_reading:
        cells = [columns.cells[heading.readings[0]][row] for row in without_reading]
        words = dict.fromkeys(repr(cell) if cell else "no number" for cell in cells)
        reason = f"{', '.join(words)} from line {columns.lines[without_reading[0]]} on"
        place = _place_of_test(columns, title)
        count = _count_left_out(len(without_reading))
        log.add(place, "missing readings", count, reason, "numbers in these cells")
    return with_reading


def _check_start_of_log(
    columns: _SheetColumns,
    heading: Heading,
    all_rows: Sequence[int],
    rows: Sequence[int],
    title: str,
) -> None:
    """Raise an error if the first readings of a table with times instead of angles are missing.

    The first row is needed, because the angle of every reading is computed from the time since the
    first row. ``all_rows`` are all rows of the test, and ``rows`` are the rows with a reading.
    ``title`` is the name of the test; it is empty if the table holds one test. ``columns`` is the
    table of the sheet.
    """
    is_log = "time" in heading.roles and "angle" not in heading.roles
    if is_log and rows[0] != all_rows[0]:
        raise InputError(
            f"{_place_of_test(columns, title)}: a log over time must begin with a reading, got none"
            f" in line {columns.lines[all_rows[0]]}, where the circle begins. Remove the lines up"
            f" to line {columns.lines[rows[0]] - 1}, and give --start-deg: the angle at line"
            f" {columns.lines[rows[0]]}."
        )


def _place_of_test(columns: _SheetColumns, title: str) -> str:
    """Return the name of a test for messages: file, sheet and, if not empty, ``title``."""
    if not title:
        return columns.sheet.place
    return f"{columns.sheet.place}, test {title!r}"


def _count_left_out(n_rows: int) -> str:
    """Return how many rows were left out, as words for a note: ``3 rows left out``."""
    if n_rows == 1:
        return "1 row left out"
    return f"{n_rows} rows left out"


def _without_placeholders(
    columns: _SheetColumns,
    heading: Heading,
    numbers: Mapping[str, Array],
    rows: Sequence[int],
    title: str,
    log: AssumptionLog,
) -> list[int]:
    """Return the rows of a test whose angle and reading are not placeholders.

    A placeholder is a number such as -999 in place of a missing number. Rows with a placeholder are
    left out and noted. If every row has a placeholder, all rows are returned.

    Parameters
    ----------
    columns
        Table of the sheet.
    heading
        Heading of the test; only one of its columns holds readings.
    numbers
        Dictionary with the numbers in each column of the table. Its keys are the roles of the
        columns: a role, such as angle or reading, says what a column holds.
    rows
        Indices of all rows of the test.
    title
        Name of the test in its sheet; empty if the whole sheet is one test.
    log
        Log to which the note is added.
    """
    left_out: dict[int, str] = {}
    for role in ("angle", "reading"):
        if role not in numbers or role not in heading.roles:
            continue
        cells = [columns.cells[heading.roles[role]][row] for row in rows]
        for k in np.flatnonzero(placeholders_in(cells, numbers[role][rows])).tolist():
            left_out[rows[k]] = cells[k]
    if len(left_out) == len(rows):
        # All rows of the test hold placeholders (numbers such as -999 for missing ones). Later code
        # raises an error for such rows.
        return list(rows)
    if left_out:
        listed = shown_list(dict.fromkeys(left_out.values()), LONGEST_NAME)
        reason = (
            f"{listed} from line {columns.lines[min(left_out)]} on, far from all other numbers of"
            " the column"
        )
        place = _place_of_test(columns, title)
        count = _count_left_out(len(left_out))
        log.add(place, "missing readings", count, reason, "other numbers in these cells")
    return [row for row in rows if row not in left_out]


def _statements_of_all_tests(lines: Lines) -> dict[str, list[LineStatement]]:
    """Return the statements that apply to all tests, from lines in sheets without a table.

    The keys are fields. Fields that differ from test to test, such as the force, are left out.
    """
    statements = {}
    for key, statements_of_field in statements_in(lines).items():
        if key in FIELDS_OF_ALL_TESTS:
            statements[key] = statements_of_field
    return statements


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


def _read_columns(
    sheet: Sheet, heading: Heading, layout: Layout, stated_plane: str | None, log: AssumptionLog
) -> _SheetColumns:
    """Return the table of a sheet, with the cells of each column in a list.

    Assumptions about the header and the decimal mark of the table are added to the log.
    ``stated_plane`` is the plane that the user states for all tests, or None.
    """
    lines, cells = columns_of(sheet.place, _table_rows(sheet, heading), len(heading.headers))
    cells_with_units = _cells_with_units(sheet, lines, cells)
    columns_of_units = unit_columns(heading.headers, cells_with_units, _numeric_columns(heading))
    heading = replace(heading, unit_columns=frozenset(columns_of_units.values()))
    check_angle_columns(sheet, heading, cells)
    heading = with_condition_that_names_tests(sheet, heading, cells, layout)
    heading = name_plane_column(sheet, heading, cells, stated_plane, log)
    check_directions(sheet, heading, cells, layout)
    _check_rows_hold_readings(sheet, heading, lines, cells)
    numbering = _two_numbering_columns(heading, cells)
    if numbering and "test" not in layout.columns:
        heading = _without_test_column(heading)
    note_heading(sheet, heading, layout, log)
    clock_column = None
    if "time" in heading.roles and is_clock(cells[heading.roles["time"]][0]):
        clock_column = heading.roles["time"]
    number_columns = [column for column in _numeric_columns(heading) if column != clock_column]
    _check_formulas(sheet, heading, lines, number_columns)
    cells_by_line: list[tuple[int, str]] = []
    for k, line in enumerate(lines):
        cells_by_line += [(line, cells[column][k]) for column in number_columns]
    decimal = _decimal_mark_of(sheet, cells_by_line, layout, log)
    if decimal is not None and layout.decimal is None and not sheet.stores_numbers:
        for column in number_columns:
            _check_thousands(sheet, lines, cells[column], decimal)
    if clock_column is not None:
        units = list(heading.units)
        units[clock_column] = "s"
        heading = replace(heading, units=units)
    return _SheetColumns(
        sheet, heading, lines, cells, clock_column, decimal, columns_of_units, numbering
    )


def _check_rows_hold_readings(
    sheet: Sheet, heading: Heading, lines: Sequence[int], cells: Sequence[Sequence[str]]
) -> None:
    """Raise an `InputError` if an otherwise unused column says that some rows hold no readings.

    For example, a column ``stat`` may hold the word "raw" in rows of readings, and "mean" in a row
    of means. Or a column of row numbers may hold the words "Gain" and "Offset" in its first cells.
    ``lines`` are the line numbers of the rows, and ``cells`` are the cells of each column.
    """
    for column in unused_columns(heading):
        rows = statistics_among(cells[column])
        if rows:
            name = heading.headers[column][:LONGEST_NAME]
            listed = shown_list([str(lines[row]) for row in rows], LONGEST_NAME)
            raise InputError(
                f"{sheet.place}: rows must hold readings, got {cells[column][rows[0]]!r} in column"
                f" {name!r}. Remove the rows of statistics: {listed}."
            )
        words = words_among_numbers(cells[column])
        if words:
            name = heading.headers[column][:LONGEST_NAME]
            word = cells[column][words[0]][:LONGEST_NAME]
            listed = shown_list([str(lines[row]) for row in words], LONGEST_NAME)
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


def _numeric_columns(heading: Heading) -> list[int]:
    """Return the indices of the columns that hold numbers.

    These are all columns with a role (angle, reading, …), except the columns that name tests or
    directions.
    """
    columns = []
    for role, column in heading.roles.items():
        if role not in _NOT_SHARED:
            columns.append(column)
    return columns + heading.readings


def _without_statistics(sheet: Sheet, heading: Heading, log: AssumptionLog) -> Sheet:
    """Return a sheet without the rows of its table that hold statistics, such as a mean.

    A note with the number of these rows is added to the log.
    """
    column = heading.roles.get("angle", heading.roles.get("time"))
    if column is None:
        return sheet
    statistics = rows_of_statistics(_table_rows(sheet, heading), column)
    if not statistics:
        return sheet
    labels = [repr(label_of_statistics(row, column)) for row in statistics]
    reason = (
        f"{shown_list(list(dict.fromkeys(labels)), LONGEST_NAME)} from line {statistics[0].line} on"
    )
    count = _count_left_out(len(statistics))
    log.add(sheet.place, "left out", count, reason, "numbers in these cells")
    lines = {row.line for row in statistics}
    return replace(sheet, rows=[row for row in sheet.rows if row.line not in lines])


def _table_rows(sheet: Sheet, heading: Heading) -> list[Row]:
    """Return the rows of a table, without the texts that may stand below it.

    The texts below a table, such as the end of a letter, begin with a row of words; they may hold
    numbers, such as a telephone number. A row of numbers with unknown units belongs to the table.
    """
    rows = sheet.rows[heading.first_row :]
    while rows and not (_has_number(rows[-1]) or _holds_quantities(rows[-1], heading)):
        rows.pop()
    end = len(rows)
    while end and not _fills_table(rows[end - 1], heading):
        end -= 1
    if 0 < end < len(rows) and _is_remark(rows[end]):
        return rows[:end]
    return rows


def _fills_table(row: Row, heading: Heading) -> bool:
    """Return whether a row has a cell for each column, and a number in its column of angles.

    A table without angles may have a column of times; the number must then stand in this column. If
    the table has neither angles nor times, the number may stand in any column.
    """
    if len(row.cells) < len(heading.headers):
        return False
    column = heading.roles.get("angle", heading.roles.get("time"))
    cells = row.cells if column is None else [row.cells[column]]
    return any(_BEGINS_WITH_NUMBER.match(cell) for cell in cells)


def _is_remark(row: Row) -> bool:
    """Return whether a row is a text, and not a row of a table.

    A text has words and no number, or it begins with a word such as "phone", which precedes a
    telephone number, or "vat", which precedes the number of a company.
    """
    text = " ".join(row.cells)
    if _CONTACT.match(text):
        return True
    return re.search(r"[^\W\d_]{2}", text) is not None and not _has_number(row)


def _holds_quantities(row: Row, heading: Heading) -> bool:
    """Return whether a row fills all columns and every cell begins with a number.

    A row with cells such as ``0.9 x 10 um`` belongs to the table, although its units cannot be
    read. Later code raises an error for these units.
    """
    if len(row.cells) != len(heading.headers):
        return False
    return all(_BEGINS_WITH_NUMBER.match(cell) for cell in row.cells)


def _has_number(row: Row) -> bool:
    """Return whether a row has a number, or a text such as NaN in place of a missing number."""
    return any(looks_like_number(cell) or is_missing(cell) for cell in row.cells)


def _decimal_mark_of(
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


def _check_thousands(
    sheet: Sheet, lines: Sequence[int], cells: Sequence[str], decimal: str
) -> None:
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


def _shared_numbers(columns: _SheetColumns, layout: Layout) -> dict[str, Array]:
    """Return a dict with the numbers in the columns that apply to all tests, such as angles.

    The keys are the roles of the columns: a role says what a column holds. Columns of readings,
    test names and directions are left out. Times of day are converted to seconds. ``columns`` is
    the table of the sheet.
    """
    numbers = {}
    for role, column in columns.heading.roles.items():
        if role not in _NOT_SHARED and column != columns.clock_column:
            numbers[role] = columns.numbers(role, column)
    if columns.clock_column is not None:
        if layout.time_unit not in (None, "s"):
            raise InputError(
                f"{columns.sheet.place}: times of day have no unit, got {layout.time_unit!r}. Leave"
                " --time-unit out."
            )
        cells = columns.cells[columns.clock_column]
        numbers["time"] = seconds_of(columns.sheet.place, columns.lines, cells)
    return numbers


def _two_numbering_columns(heading: Heading, cells: Sequence[Sequence[str]]) -> list[int]:
    """Return the indices of two columns that together identify the tests, but do not do so alone.

    Examples are the columns ``run`` and ``pass``. All rows with the same cells in both columns have
    the same force, pressure and direction. This is not true of either column alone. Return an empty
    list if there are no such columns. ``cells`` holds the cells of each column.
    """
    roles = heading.roles
    conditions = [roles[role] for role in ("force", "pressure", "direction") if role in roles]
    if not conditions:
        return []
    numbering = columns_that_number(heading.headers, cells, conditions)
    if len(numbering) < 2:
        return []
    return numbering


def _without_test_column(heading: Heading) -> Heading:
    """Return a copy of a table's heading in which no column has the role of naming the tests."""
    roles = dict(heading.roles)
    roles.pop("test", None)
    return replace(heading, roles=roles)


def _labels_of_two_columns(columns: _SheetColumns, log: AssumptionLog) -> list[str]:
    """Return, for each row, the name of its test, made from the cells of two columns.

    The use of these columns is noted. ``columns`` is the table of the sheet.
    """
    names = columns.numbering_headers
    reason = "only both together name tests of one force"
    log.add(columns.sheet.place, "test of each row", ", ".join(names), reason, "--test-column")
    labels = []
    for row in range(len(columns.lines)):
        words = [f"{columns.heading.headers[k]} {columns.cells[k][row]}" for k in columns.numbering]
        labels.append(" ".join(words))
    return labels


def _labels_of(columns: _SheetColumns, log: AssumptionLog) -> list[str]:
    """Return the name of the test to which each row of a table belongs.

    If no single column names the tests, but two columns together do, the names are made from the
    cells of both columns. If no columns name the tests, the names are empty. Raise an `InputError`
    if a single column names the tests, but has an empty cell that cannot be filled from above.
    ``columns`` is the table of the sheet.
    """
    if columns.numbering and "test" not in columns.heading.roles:
        return _labels_of_two_columns(columns, log)
    if "test" not in columns.heading.roles:
        return [""] * len(columns.lines)
    rows = range(len(columns.lines))
    # In the file, a number may be followed by a unit, which was removed when the file was read. The
    # unit is added again here, because a label such as "100 N" may be the name of a test.
    labels = columns.cells_with_units(columns.heading.roles["test"], rows)
    if "" in labels and _names_tests_once(labels):
        header = columns.heading.headers[columns.heading.roles["test"]][:LONGEST_NAME]
        reason = "each name stands once, above empty cells"
        value = f"column {header!r}, filled downwards"
        log.add(columns.sheet.place, "test of each row", value, reason, "a name in each row")
        labels = _filled_downwards(labels)
    if "" in labels:
        line = columns.lines[labels.index("")]
        raise InputError(
            f"{columns.sheet.place}, line {line}: rows must name their test, got none. Complete or"
            " remove the line."
        )
    return labels


def _names_tests_once(labels: Sequence[str]) -> bool:
    """Return whether a column names each test only once, in the first row of the test.

    All other cells must be empty, as they are if the cells of a test were merged. There must be
    several names, and enough rows for this number of tests. ``labels`` are the cells of the column.
    """
    names = [label for label in labels if label]
    if len(set(names)) < max(2, len(names)) or len(labels) < _FEWEST_ROWS * len(names):
        return False
    followed = [not below for label, below in pairwise(labels) if label]
    return bool(labels[0]) and all(followed)


def _filled_downwards(labels: Sequence[str]) -> list[str]:
    """Return the names of tests in a column, with each empty cell replaced by the name above it."""
    filled: list[str] = []
    for label in labels:
        filled.append(label or filled[-1])
    return filled


def layout_names(sheet: Sheet, label: str) -> list[str]:
    """Return the names by which an entry [[test]] of the layout may refer to a test.

    ``label`` is the name of the test in its sheet. The most specific name is first.
    """
    path = sheet.path
    names = (label, sheet.name_in_file, path.name, path.stem, str(path), sheet.name)
    return [name for name in names if name]


def _stated_fields(sheet: Sheet, label: str, layout: Layout, holds_several: bool) -> dict[str, Any]:
    """Return the values that entries [[test]] of the layout state for one test.

    The field ``file`` of an entry names the test, its sheet or its file. If several entries state a
    value for the same field, the entry with the most specific name is used. Raise an `InputError`
    if an entry for a file with several tests states a force or pressure.

    Parameters
    ----------
    sheet
        Sheet of the test.
    label
        Name of the test in its sheet.
    layout
        Layout with these entries.
    holds_several
        Whether the file holds several tests.
    """
    entries = {entry.file: entry for entry in layout.test}
    fields: dict[str, Any] = {}
    for name in reversed(layout_names(sheet, label)):
        if name not in entries:
            continue
        entry = entries[name]
        is_of_file = name not in (label, sheet.name_in_file)
        if is_of_file and holds_several and (entry.force_N or entry.pressure_bar):
            raise InputError(
                f"{sheet.place}: a force or pressure given for the file must be of one test, got"
                " several in it. Give --forces-N with one for each, a [[test]] for each in"
                " --layout, or a column."
            )
        fields |= entry.stated()
    return fields


def _unused_columns(
    columns: _SheetColumns, rows_of_tests: Sequence[Sequence[int]], beside: Sequence[TextBeside]
) -> list[str]:
    """Return the headers of the columns of a table that are not used.

    A column without a role (angle, reading, …) counts as used only if it states a field, such as
    the radius, for every test. Two columns that together identify the tests also count as used. If
    an unused column has the same header and the same cells as a used column, its header is left out
    of the result. If only the headers are the same, the number of the unused column is added to its
    header. A column that holds only texts which take part like lines below the table is left out.
    The header of a column of times is included even if the start times of the tests are taken from
    this column later. ``rows_of_tests`` holds the indices of the rows of each test, and ``beside``
    the texts beside the table and in its columns. ``columns`` is the table of the sheet.
    """
    texts = {entry.text for entry in beside}
    all_columns = range(len(columns.heading.headers))
    used_in_all_tests = {columns.place_of_column(column) for column in all_columns}
    for rows in rows_of_tests:
        used_in_test = set()
        for statements in columns.constant_statements(rows).values():
            used_in_test |= {statement.line for statement in statements}
        used_in_all_tests &= used_in_test
    headers = []
    for column in unused_columns(columns.heading):
        is_used = columns.place_of_column(column) in used_in_all_tests
        if is_used or column in columns.numbering or _holds_texts(columns, column, texts):
            continue
        namesake = _namesake(columns.heading, column)
        if namesake is None:
            headers.append(columns.heading.headers[column])
        elif columns.cells[column] != columns.cells[namesake]:
            headers.append(f"{columns.heading.headers[column]} (column {column + 1})")
    return headers


def _holds_texts(columns: _SheetColumns, column: int, texts: Collection[str]) -> bool:
    """Return whether all filled cells of a column, or its header, are among ``texts``."""
    filled = [cell for cell in columns.cells[column] if cell]
    if filled:
        return all(cell in texts for cell in filled)
    return columns.heading.headers[column] in texts


def _namesake(heading: Heading, column: int) -> int | None:
    """Return the index of a used column that has the same header as an unused column.

    ``column`` is the index of the unused column. Return None if no used column has its header.
    """
    for used in (*heading.roles.values(), *heading.readings):
        if used != column and heading.headers[used] == heading.headers[column]:
            return used
    return None


def _field_columns(
    columns: _SheetColumns, labels: Sequence[str], log: AssumptionLog
) -> dict[str, int]:
    """Return a dict with the indices of the columns that state a field of each test, such as setup.

    The keys are the fields. ``labels`` holds the name of the test for each row. A column of times
    or temperatures whose values change within a test is left out, and this is noted in the log.
    ``columns`` is the table of the sheet.
    """
    heading = columns.heading
    field_columns = {
        header: column
        for column, header in enumerate(heading.headers)
        if header in PER_TEST and column not in heading.roles.values()
    }
    for key in ("temperature_C", "time_s"):
        if key not in field_columns:
            continue
        values = set(zip(labels, columns.cells[field_columns[key]], strict=True))
        if len(values) > len(set(labels)):
            log.add(
                columns.sheet.place,
                "columns not used",
                key,
                "it changes within a test",
                "a [[test]] in --layout",
            )
            del field_columns[key]
    return field_columns
