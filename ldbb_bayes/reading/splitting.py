"""Functions that split imported tables into tests."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ldbb_bayes.campaign.campaign import LABELS, PER_TEST
from ldbb_bayes.errors import InputError
from ldbb_bayes.reading.assumptions import AssumptionLog, shown_list
from ldbb_bayes.reading.heading import Heading, unused_columns
from ldbb_bayes.reading.layout import Layout
from ldbb_bayes.reading.line_parts import segments_of_line
from ldbb_bayes.reading.lines_above import Lines, LineStatement, statements_in
from ldbb_bayes.reading.list_columns import unread_headers, with_loads_named
from ldbb_bayes.reading.numerals import seconds_of
from ldbb_bayes.reading.overview import overview_lines
from ldbb_bayes.reading.placeholders import placeholders_in
from ldbb_bayes.reading.recording import Recording
from ldbb_bayes.reading.row_labels import labels_of
from ldbb_bayes.reading.rows_of_one_machine import check_rows_are_of_one_machine
from ldbb_bayes.reading.sheet import Sheet
from ldbb_bayes.reading.sheet_columns import NOT_SHARED, SheetColumns, read_columns
from ldbb_bayes.reading.statistics_rows import label_of_statistics, rows_of_statistics
from ldbb_bayes.reading.table_rows import remarks_between, table_rows
from ldbb_bayes.reading.texts_beside import TextBeside, texts_beside, texts_of_test
from ldbb_bayes.reading.unit_lines import UNIT_KEYS
from ldbb_bayes.reading.unit_sentences import units_in_sentences
from ldbb_bayes.reading.words import LONGEST_NAME, LONGEST_TEXT
from ldbb_bayes.results import Array

__all__ = ["FIELDS_OF_ALL_TESTS", "layout_names", "split_sheet"]

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
    holds one test for every name in that column and for every column of readings. The tests are
    yielded in the order of the columns of readings; tests that a column names are yielded in the
    order of their first rows. Each recording has the numbers of the test, and everything that the
    file, the name of the file and the user state about the test.

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
    columns = read_columns(sheet, heading, layout, campaign.get("plane"), log)
    shared_numbers = _shared_numbers(columns, layout)
    labels = labels_of(columns, log)
    rows_by_label = _rows_by_label(labels)
    check_rows_are_of_one_machine(columns, rows_by_label, campaign)
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
            title = " ".join(name for name in (label, test_heading.label) if name)
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


def _rows_by_label(labels: Sequence[str]) -> dict[str, list[int]]:
    """Return a dict with the indices of the rows of each test; the keys are the names of the tests.

    ``labels`` holds the name of the test of each row.
    """
    rows_by_label: dict[str, list[int]] = {}
    for row, label in enumerate(labels):
        rows_by_label.setdefault(label, []).append(row)
    return rows_by_label


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
            shown_list(headers),
            "in the list of tests on another sheet, no role is known for them",
            "a [[test]] in --layout",
        )


def _with_readings(
    columns: SheetColumns,
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
    columns: SheetColumns,
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


def _place_of_test(columns: SheetColumns, title: str) -> str:
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
    columns: SheetColumns,
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
        listed = shown_list(dict.fromkeys(left_out.values()))
        reason = (
            f"{listed} from line {columns.lines[min(left_out)]} on, far from all other numbers of"
            " the column"
        )
        place = _place_of_test(columns, title)
        count = _count_left_out(len(left_out))
        log.add(place, "missing readings", count, reason, "other numbers in these cells")
    return [row for row in rows if row not in left_out]


def _without_statistics(sheet: Sheet, heading: Heading, log: AssumptionLog) -> Sheet:
    """Return a sheet without the rows of its table that hold statistics, such as a mean.

    A note with the number of these rows is added to the log. Remarks between the rows, which are
    left out when the table is read, are noted, too.
    """
    column = heading.roles.get("angle", heading.roles.get("time"))
    if column is None:
        return sheet
    for remark in remarks_between(sheet, heading):
        reason = f"{sheet.text_of(remark.cells)[:LONGEST_NAME]!r} in line {remark.line}"
        log.add(sheet.place, "left out", _count_left_out(1), reason, "remove the line")
    statistics = rows_of_statistics(table_rows(sheet, heading), column)
    if not statistics:
        return sheet
    labels = [repr(label_of_statistics(row, column)) for row in statistics]
    reason = f"{shown_list(list(dict.fromkeys(labels)))} from line {statistics[0].line} on"
    count = _count_left_out(len(statistics))
    log.add(sheet.place, "left out", count, reason, "numbers in these cells")
    lines = {row.line for row in statistics}
    return replace(sheet, rows=[row for row in sheet.rows if row.line not in lines])


def _statements_of_all_tests(lines: Lines) -> dict[str, list[LineStatement]]:
    """Return the statements that apply to all tests, from lines in sheets without a table.

    The keys are fields. Fields that differ from test to test, such as the force, are left out.
    """
    statements = {}
    for key, statements_of_field in statements_in(lines).items():
        if key in FIELDS_OF_ALL_TESTS:
            statements[key] = statements_of_field
    return statements


def _shared_numbers(columns: SheetColumns, layout: Layout) -> dict[str, Array]:
    """Return a dict with the numbers in the columns that apply to all tests, such as angles.

    The keys are the roles of the columns: a role says what a column holds. Columns of readings,
    test names and directions are left out. Times of day are converted to seconds. ``columns`` is
    the table of the sheet.
    """
    numbers = {}
    for role, column in columns.heading.roles.items():
        if role not in NOT_SHARED and column != columns.clock_column:
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
    columns: SheetColumns, rows_of_tests: Sequence[Sequence[int]], beside: Sequence[TextBeside]
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


def _holds_texts(columns: SheetColumns, column: int, texts: Collection[str]) -> bool:
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
    columns: SheetColumns, labels: Sequence[str], log: AssumptionLog
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
