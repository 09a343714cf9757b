"""What the log of assumptions says of a sheet's format, and of the columns of its table."""

from __future__ import annotations

from typing import Any

from ldbb_bayes.reading.assumptions import AssumptionLog, shown_list
from ldbb_bayes.reading.heading import Heading
from ldbb_bayes.reading.layout import Layout
from ldbb_bayes.reading.sheet import Sheet

__all__ = ["note_heading"]


def note_heading(sheet: Sheet, heading: Heading, layout: Layout, log: AssumptionLog) -> None:
    """Add to the log what was assumed about the format of a sheet and the roles of its columns.

    A role is what a column holds, such as angle. What the layout states is not added. ``heading``
    holds the header and the columns of the table.
    """
    _note_format(sheet, heading, layout, log)
    _note_columns(sheet, heading, layout, log)
    if _has_numbered_rows(sheet, heading):
        reason = "the header has one name fewer than the table has columns"
        log.add(sheet.place, "column 1", "numbers of the rows, not used", reason, "--header-line")


def _has_numbered_rows(sheet: Sheet, heading: Heading) -> bool:
    """Return whether the first column holds row numbers and has no name in the header."""
    if heading.headers[0]:
        return False
    n_names = {row.line: len(row.cells) for row in sheet.rows}
    return n_names.get(heading.line, 0) == len(heading.headers) - 1


def _note_columns(sheet: Sheet, heading: Heading, layout: Layout, log: AssumptionLog) -> None:
    """Add a note to the log on the columns that were assumed because the user has not stated them.

    The note names each column together with its role, which is what the column holds, such as
    angle. The log also stores these columns in the layout with which the files can be read again
    (see `AssumptionLog.keep`).
    """
    columns: dict[str, Any] = {}
    for role, column in heading.roles.items():
        if role not in layout.columns:
            columns[role] = heading.headers[column] or column + 1
    if len(heading.readings) > 1 and "reading" not in layout.columns:
        columns["reading"] = [heading.headers[column] for column in heading.readings]
    if columns:
        log.keep(columns=dict(layout.columns) | columns)
        assignments = [f"{role} = {column!r}" for role, column in columns.items()]
        reason = "their names"
        if not heading.line:
            reason = "no header: the first two"
        options = ", ".join(f"--{role}-column" for role in columns)
        log.add(sheet.place, "columns", shown_list(assignments), reason, options)


def _note_format(sheet: Sheet, heading: Heading, layout: Layout, log: AssumptionLog) -> None:
    """Add encoding, separator and header line to the log of assumptions.

    Values that the user has stated in the layout are not added. Usual values (utf-8, comma, line 1
    or no header) are stored, but they are not reported as assumptions.
    """
    if sheet.encoding and layout.encoding is None:
        log.keep(encoding=sheet.encoding)
        if sheet.encoding != "utf-8":
            log.add(sheet.place, "encoding", sheet.encoding, "its bytes", "--encoding")
    if sheet.separator and layout.separator is None:
        log.keep(separator=sheet.separator)
        if sheet.separator != ",":
            reason = "most lines split alike"
            log.add(sheet.place, "separator", repr(sheet.separator), reason, "--separator")
    if layout.header_line is None:
        log.keep(header_line=heading.line)
        if heading.line > 1:
            reason = "numbers begin below it"
            log.add(sheet.place, "header", f"line {heading.line}", reason, "--header-line")
