"""Columns that show that the rows of a table are of several machines, or of several days."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from datetime import date, timedelta

from ldbb_bayes.campaign.cell_numbers import LONGEST_CELL_SHOWN
from ldbb_bayes.errors import InputError
from ldbb_bayes.reading.heading import unused_columns
from ldbb_bayes.reading.lines_above import statements_in
from ldbb_bayes.reading.recording import FIELDS_OF_MACHINE, option_for
from ldbb_bayes.reading.sheet_columns import SheetColumns

__all__ = ["check_rows_are_of_one_machine"]

# A test may begin before midnight and end after it.
_LONGEST_TEST = timedelta(days=1)


def check_rows_are_of_one_machine(
    columns: SheetColumns, rows_by_test: Mapping[str, Sequence[int]], stated: Collection[str]
) -> None:
    """Raise an error if a column names several machines, or dates of one test that lie apart.

    Without this check, two circles with the same number, of two machines or of two years, would be
    joined as two laps of one circle.

    Parameters
    ----------
    columns
        The table of a sheet.
    rows_by_test
        Indices of the rows of each test. The keys are the names of the tests.
    stated
        Fields of the campaign that the user's options set. A machine that they state is that of all
        rows.

    Raises
    ------
    InputError
        If a column names several machines, or if the rows of a test are days apart.
    """
    for column in unused_columns(columns.heading):
        header = columns.heading.headers[column]
        cells = columns.cells[column]
        filled = [row for row, cell in enumerate(cells) if cell]
        if not header or not filled:
            continue
        keys = statements_in([(0, f"{header}: {cells[filled[0]]}")])
        for key in FIELDS_OF_MACHINE:
            if key in keys and key not in stated:
                _check_is_one_machine(columns, column, filled, key)
        if "date" in keys:
            for test, rows in rows_by_test.items():
                _check_days(columns, column, test, rows)


def _check_is_one_machine(
    columns: SheetColumns, column: int, filled: Sequence[int], key: str
) -> None:
    """Raise an error if the filled cells of a column differ.

    ``filled`` are the indices of the rows with a filled cell, and ``key`` is the field that the
    column states.
    """
    cells = columns.cells[column]
    first = cells[filled[0]]
    for row in filled:
        if cells[row] != first:
            raise InputError(
                f"{columns.sheet.place}, line {columns.lines[row]}: {key} must be the same in all"
                f" rows, got {cells[row][:LONGEST_CELL_SHOWN]!r} after"
                f" {first[:LONGEST_CELL_SHOWN]!r}. Import machines one by one: write the rows of"
                f" each into a file of its own. Of one machine, give {option_for(key)}."
            )


def _check_days(columns: SheetColumns, column: int, test: str, rows: Sequence[int]) -> None:
    """Raise an error if a column of dates shows that the rows of a test are days apart."""
    first: date | None = None
    last_cell = ""
    for row in rows:
        cell = columns.cells[column][row]
        if cell == last_cell:
            continue
        last_cell = cell
        dates = statements_in([(0, f"{columns.heading.headers[column]}: {cell}")]).get("date")
        if not dates:
            continue
        day = date.fromisoformat(str(dates[0].value))
        first = first or day
        if abs(day - first) > _LONGEST_TEST:
            raise InputError(
                f"{columns.sheet.place}, line {columns.lines[row]}: date must be the same in all"
                f" rows of test {test!r}, got {cell[:LONGEST_CELL_SHOWN]!r} after"
                f" {first.isoformat()!r}. Write the rows of each day into a file of its own."
            )
