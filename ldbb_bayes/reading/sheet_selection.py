"""Selection of those sheets of imported files that hold a table of angles and readings."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from ldbb_bayes.errors import InputError
from ldbb_bayes.reading.assumptions import AssumptionLog
from ldbb_bayes.reading.cited_lines import CitedLine, quoted_line
from ldbb_bayes.reading.companion_files import (
    holds_temperatures,
    holds_text_only,
    or_left_out,
    without_columns,
    without_table,
)
from ldbb_bayes.reading.header_units import unit_of
from ldbb_bayes.reading.heading import Heading, NoTableError, find_heading
from ldbb_bayes.reading.layout import Layout
from ldbb_bayes.reading.numerals import looks_like_number
from ldbb_bayes.reading.overview import LONGEST_OVERVIEW, lists_tests
from ldbb_bayes.reading.role_words import has_role
from ldbb_bayes.reading.sheet import Sheet
from ldbb_bayes.reading.transposed_tables import check_not_transposed
from ldbb_bayes.reading.words import LONGEST_NAME, UNITS

__all__ = ["HeadedSheet", "SheetSelection", "note_left_out", "select_sheets"]

# Number of rows at the beginning of a table that are examined for numbers.
_FIRST_ROWS = 9


class HeadedSheet(NamedTuple):
    """Sheet of a file, with the header and columns of its table."""

    sheet: Sheet
    heading: Heading


@dataclass
class SheetSelection:
    """Sheets of imported files, divided into sheets with and sheets without a table of readings."""

    tables: list[HeadedSheet] = field(default_factory=list)  #: sheets with a table of readings
    left_out: list[Sheet] = field(default_factory=list)  #: sheets without a table of readings


def select_sheets(
    sheets: Sequence[Sheet],
    layout: Layout,
    log: AssumptionLog,
    matched: Collection[Path] = (),
) -> SheetSelection:
    """Return the sheets with a table of angles and readings, and the sheets that are left out.

    A sheet without such a table is left out in three cases: if it is one of several sheets in a
    workbook, if the file was found by a pattern with ``*`` or ``?``, or if it is a text with few
    numbers and other files have tables. A list of tests counts as a sheet without such a table. An
    `InputError` is raised for any other sheet without a table. It is also raised if no file has a
    table.

    Parameters
    ----------
    sheets
        All sheets, in the order of files.
    layout
        Layout that the user states. If the layout names sheets, each named sheet must have a table.
    log
        Log to which hidden sheets and rows are added.
    matched
        Files that were found by a pattern, and were not named by the user.
    """
    _note_hidden(sheets, log)
    selection = SheetSelection()
    # tables that lack a column of angles or a column of readings
    incomplete: list[HeadedSheet] = []
    errors: list[InputError] = []
    optional = {*matched}  # files that need not hold a table of readings
    if not layout.sheets:
        optional |= _workbooks_of_several_sheets(sheets)
    optional |= _files_of_text_only(sheets, layout, optional)
    selection.left_out += _lists_of_tests(sheets, optional)
    lists = {sheet.place for sheet in selection.left_out}
    for sheet in [sheet for sheet in sheets if sheet.place not in lists]:
        is_optional = sheet.path in optional
        try:
            heading = _heading_of(sheet, layout, is_optional)
        except InputError as error:
            if not is_optional or not _has_no_readings(sheet, error):
                raise
            errors.append(error)
            selection.left_out.append(sheet)
            continue
        table = HeadedSheet(sheet, heading)
        if is_optional and not _holds_readings(table, layout):
            incomplete.append(table)
            selection.left_out.append(sheet)
        else:
            selection.tables.append(table)
    if not selection.tables:
        _check_none_transposed(sheets)
        if not incomplete:
            raise errors[-1]
        # All tables lack a column of angles or of readings. The code that reads their rows raises
        # an error that states the missing column.
        selection = SheetSelection(tables=incomplete)
        return _mark_only_tables(selection, list(incomplete))
    return _mark_only_tables(selection, selection.tables)


def note_left_out(left_out: Sequence[Sheet], lists: Collection[str], log: AssumptionLog) -> None:
    """Add a note on each sheet without a table of readings.

    Parameters
    ----------
    left_out
        Sheets without a table of readings.
    lists
        File and name of each sheet that lists tests, with one test in each row.
    log
        Log to which the notes are added.
    """
    for sheet in left_out:
        subject = "left out"
        reason = "it holds no table of angles and readings"
        option = "a table in it"
        if sheet.place in lists:
            subject = "list of tests"
            reason = "its rows name tests"
        value = "the file"
        if sheet.name:
            value = "the sheet"
            option = "--sheets"
        log.add(sheet.place, subject, value, reason, option)


def _lists_of_tests(sheets: Sequence[Sheet], optional: Collection[Path]) -> list[Sheet]:
    """Return the sheets with a list of tests whose readings are on other sheets.

    ``optional`` are the files that need not hold a table of readings; sheets of other files are not
    returned. If every sheet seems to be a list, the result is empty, because each sheet is then
    assumed to have a table of readings below its list.
    """
    lists = []
    for sheet in sheets:
        names: set[str] = set()
        for other in sheets:
            if other is not sheet:
                names |= {other.name, other.path.name, other.path.stem} - {""}
        names -= {sheet.path.name, sheet.path.stem}
        if sheet.path in optional and lists_tests(sheet, names):
            lists.append(sheet)
    if len(lists) == len(sheets):
        return []
    return lists


def _files_of_text_only(
    sheets: Sequence[Sheet], layout: Layout, optional: Collection[Path]
) -> set[Path]:
    """Return the files with a sheet of text but no table of readings, if other files have a table.

    A sheet of text has at most a few lines of numbers (see `holds_text_only`). The result is empty
    if no file has a table of readings. ``optional`` are the files that need not have such a table.

    Raises
    ------
    InputError
        If a file has no table of readings, but a sheet that is not a sheet of text, while other
        files have tables of readings. Examples are a picture and a table of temperatures. The
        message advises to leave this file out, or, if angles stand in a row, to transpose the
        table. No error is raised for the files in ``optional``, nor for a sheet that names columns
        of readings in a header that cannot be read.
    """
    errors: dict[Path, InputError] = {}
    with_table: set[Path] = set()
    texts: set[Path] = set()
    for sheet in sheets:
        try:
            heading = find_heading(sheet, layout)
        except NoTableError as error:
            if holds_text_only(sheet):
                texts.add(sheet.path)
            else:
                errors[sheet.path] = without_table(sheet, error)
        except InputError as error:
            if _has_no_readings(sheet, error):
                errors[sheet.path] = or_left_out(error, sheet.path)
        else:
            if _is_complete(heading) and not holds_temperatures(heading):
                with_table.add(sheet.path)
            else:
                errors[sheet.path] = without_columns(sheet, heading)
    if not with_table:
        return set()
    for sheet in sheets:
        path = sheet.path
        if path in errors and path not in {*with_table, *optional}:
            check_not_transposed(sheet)
            raise errors[path]
    return texts - with_table


def _heading_of(sheet: Sheet, layout: Layout, is_optional: bool) -> Heading:
    """Return the header of a sheet's table and the content of each of its columns.

    Raise an `InputError` if the sheet has no table, or if the header of its table cannot be read.
    ``is_optional`` says whether the file may lack a table of readings. If it must have one, an
    error is also raised for a table whose angles stand in a row, because such a table has no column
    of angles or readings.
    """
    try:
        heading = find_heading(sheet, layout)
    except InputError as error:
        if not is_optional or not _has_no_readings(sheet, error):
            check_not_transposed(sheet)
        raise
    if not is_optional and not _is_complete(heading):
        check_not_transposed(sheet)
    return heading


def _check_none_transposed(sheets: Sequence[Sheet]) -> None:
    """Raise an `InputError` if the angles of a sheet stand in a row instead of a column."""
    for sheet in sheets:
        check_not_transposed(sheet)


def _note_hidden(sheets: Sequence[Sheet], log: AssumptionLog) -> None:
    """Add notes to the log on what is left out of the files, and on how their sheets are read.

    For example, hidden sheets and hidden rows are left out. A note is also added if the file states
    a factor by which all numbers of a table are multiplied, or if the hidden rows and number
    formats of a workbook cannot be examined.
    """
    first_sheets: dict[Path, Sheet] = {}
    for sheet in sheets:
        _note_rows(sheet, log)
        first_sheets.setdefault(sheet.path, sheet)
    for sheet in first_sheets.values():
        _note_other_sheets(sheet, log)


def _note_rows(sheet: Sheet, log: AssumptionLog) -> None:
    """Add notes to the log on repeated headers and hidden rows of one sheet.

    Further notes are added if the rows of the table are read as columns, and if all numbers of the
    sheet were multiplied by a common factor.
    """
    if sheet.n_headers:
        headers = f"{sheet.n_headers} passed over, the table is read whole"
        reason = "the table goes on below them"
        remedy = "a file for each table, if there are several"
        log.add(sheet.place, "repeated headers", headers, reason, remedy)
    if sheet.line_of_angles:
        value = "the table is turned: its rows are read as columns"
        cited = CitedLine(f"line {sheet.line_of_angles} holds the angles", sheet.line_of_angles)
        remedy = "a column for each circle"
        log.add(sheet.place, "table on its side", value, cited, remedy)
    if sheet.factor:
        remedy = "write the numbers without a factor (format long g)"
        value = f"{float(sheet.factor):g} in all columns"
        cited = quoted_line(sheet.factor_line, f"{sheet.factor} *")
        log.add(sheet.place, "factor", value, cited, remedy)
    if sheet.hidden_rows:
        rows = f"{sheet.hidden_rows} hidden rows"
        remedy = "show them in the spreadsheet program"
        log.add(sheet.place, "left out", rows, "hidden or filtered", remedy)


def _note_other_sheets(sheet: Sheet, log: AssumptionLog) -> None:
    """Add notes to the log on the format of a file, and on its sheets that are left out.

    The format is noted only if the file is not written in rows, for example if it is JSON. A
    further note is added if the hidden rows and number formats of a workbook cannot be examined.
    """
    place = str(sheet.path)
    if sheet.format:
        reason = "lines count the entries of the file"
        log.add(place, "format", sheet.format, reason, "save it as CSV")
    if sheet.hidden_sheets:
        names = ", ".join(repr(name) for name in sheet.hidden_sheets)[:LONGEST_NAME]
        log.add(place, "left out", f"hidden sheets: {names}", "hidden", "--sheets")
    if sheet.sheets_not_wanted:
        names = ", ".join(repr(name) for name in sheet.sheets_not_wanted)[:LONGEST_NAME]
        log.add(place, "left out", f"sheets: {names}", "other sheets are named", "--sheets")
    if sheet.name and not sheet.encoding and not sheet.is_examined:
        subject = "hidden rows and number formats"
        reason = "this kind of workbook does not show them"
        log.add(place, subject, "not looked at", reason, "save it as XLSX")


def _workbooks_of_several_sheets(sheets: Sequence[Sheet]) -> set[Path]:
    """Return the paths of the workbooks from which more than one sheet is imported."""
    paths = set()
    for sheet, following in pairwise(sheets):
        if sheet.path == following.path:
            paths.add(sheet.path)
    return paths


def _has_no_readings(sheet: Sheet, error: InputError) -> bool:
    """Return whether a sheet whose header cannot be read holds no readings.

    ``error`` is the error that was raised when the header was read. A sheet holds no readings if it
    has no table of numbers, or if no row names both a column of readings and a column of angles or
    times.
    """
    if isinstance(error, NoTableError):
        return True
    return not any(_names_readings(row.cells) for row in sheet.rows[:LONGEST_OVERVIEW])


def _names_readings(cells: Sequence[str]) -> bool:
    """Return whether a row names both a column of readings and a column of angles or times."""
    names = [unit_of(cell).name for cell in cells if cell and not looks_like_number(cell)]
    has_abscissa = any(has_role(name, "angle") or has_role(name, "time") for name in names)
    return has_abscissa and any(has_role(name, "reading") for name in names)


def _is_complete(heading: Heading) -> bool:
    """Return whether a table has both a column of readings and a column of angles or times."""
    has_abscissa = "angle" in heading.roles or "time" in heading.roles
    return has_abscissa and bool(heading.readings)


def _holds_readings(table: HeadedSheet, layout: Layout) -> bool:
    """Return whether a table has a column of readings, and a column of angles or times.

    If the user states columns, these columns must hold angles and readings.
    """
    return _is_complete(table.heading) and _fits_stated_columns(table, layout)


def _fits_stated_columns(table: HeadedSheet, layout: Layout) -> bool:
    """Return whether the columns that the user states hold angles and readings in this sheet.

    The user may state columns by their numbers. In a list of tests, the column with such a number
    may hold texts, forces or pressures instead; the result is then False.
    """
    heading = table.heading
    rows = table.sheet.rows[heading.first_row : heading.first_row + _FIRST_ROWS]
    columns: list[int] = []
    if "reading" in layout.columns:
        columns += heading.readings
    if "angle" in layout.columns:
        columns.append(heading.roles["angle"])
    for column in columns:
        header = unit_of(heading.headers[column])
        if header.unit in (*UNITS["force"], *UNITS["pressure"]):
            return False
        if not any(looks_like_number(row.cells[column]) for row in rows if len(row.cells) > column):
            return False
    return True


def _mark_only_tables(selection: SheetSelection, tables: Sequence[HeadedSheet]) -> SheetSelection:
    """Return a selection with ``tables``, marking each table that is the only one in its file.

    To mark a table, the field ``is_only_table`` of its sheet is set. The sheets without a table are
    taken from ``selection``.
    """
    paths = [table.sheet.path for table in tables]
    marked = []
    for sheet, heading in tables:
        if paths.count(sheet.path) == 1:
            sheet = replace(sheet, is_only_table=True)
        marked.append(HeadedSheet(sheet, heading))
    return SheetSelection(marked, selection.left_out)
