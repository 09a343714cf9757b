"""Merged cells in columns of conditions, such as a force that stands only in the first row.

On the screen, merged cells appear as one cell. In the file they are separate cells: the first holds
the value, and the others are empty. Tables of pandas with several indices are written so.
"""

from __future__ import annotations

from collections.abc import Sequence

from ldbb_bayes.campaign.campaign import PER_TEST
from ldbb_bayes.campaign.circular_test import FEWEST_READINGS
from ldbb_bayes.machine.chain import PLANES
from ldbb_bayes.reading.assumptions import AssumptionLog
from ldbb_bayes.reading.column_roles import names_circle
from ldbb_bayes.reading.header_units import unit_of
from ldbb_bayes.reading.heading import CONDITION_ROLES, Heading
from ldbb_bayes.reading.planes import plane_named
from ldbb_bayes.reading.sheet import Sheet
from ldbb_bayes.reading.words import LONGEST_NAME

__all__ = ["filled_downwards", "with_merged_rows_filled"]


def with_merged_rows_filled(
    sheet: Sheet,
    heading: Heading,
    lines: Sequence[int],
    cells: Sequence[Sequence[str]],
    log: AssumptionLog,
) -> list[list[str]]:
    """Return the cells of each column, with the empty cells of conditions filled from above.

    Conditions are the force, the direction, the plane and others that hold for a whole circle. A
    column of conditions is filled if its first cell is not empty, and if each value stands above at
    least eight empty cells. If a further column names the test of every row, each test must have a
    value in its first row. All other columns are returned unchanged. The filled columns are noted.

    Parameters
    ----------
    sheet, heading
        The sheet and the heading of its table.
    lines
        Line number of each row.
    cells
        Cells of each column.
    log
        Log to which the filled columns are added.
    """
    filled = [list(words) for words in cells]
    headers = []
    first_rows = _first_rows_of_tests(heading, cells)
    for column, words in enumerate(cells):
        has_units = any((line, column) in sheet.cell_units for line in lines)
        if has_units or not _states_condition(heading, column, words):
            continue
        if _stands_once_above_empty_cells(words) and all(words[row] for row in first_rows):
            filled[column] = filled_downwards(words)
            headers.append(repr(heading.headers[column][:LONGEST_NAME]))
    if headers:
        reason = "each value stands once, above empty cells"
        log.add(sheet.place, "filled downwards", ", ".join(headers), reason, "a value in each row")
    return filled


def _first_rows_of_tests(heading: Heading, cells: Sequence[Sequence[str]]) -> list[int]:
    """Return the index of the first row of each test; empty if no column names the tests of rows.

    It is also empty if a column names each test only once. ``cells`` holds the cells of each
    column.
    """
    if "test" not in heading.roles:
        return []
    labels = cells[heading.roles["test"]]
    if "" in labels:
        return []
    return [row for row, label in enumerate(labels) if row == 0 or label != labels[row - 1]]


def _states_condition(heading: Heading, column: int, words: Sequence[str]) -> bool:
    """Return whether a column states a condition of a circle, such as the force or the plane.

    ``column`` is the index of the column, and ``words`` are its cells.
    """
    if column in [heading.roles.get(role) for role in CONDITION_ROLES]:
        return True
    if column in heading.roles.values() or column in heading.readings:
        return False
    header = heading.headers[column]
    stated = [word for word in words if word]
    are_planes = bool(stated) and all(plane_named(word) in PLANES for word in stated)
    return are_planes or names_circle(header) or unit_of(header).name in PER_TEST


def _stands_once_above_empty_cells(words: Sequence[str]) -> bool:
    """Return whether each value in a column stands above at least eight empty cells.

    ``words`` are the cells of the column. The first of them must not be empty.
    """
    filled = [row for row, word in enumerate(words) if word]
    if not filled or filled[0] != 0:
        return False
    ends = [*filled[1:], len(words)]
    return all(end - start >= FEWEST_READINGS for start, end in zip(filled, ends, strict=True))


def filled_downwards(words: Sequence[str]) -> list[str]:
    """Return the cells of a column, with each empty cell replaced by the cell above it."""
    filled: list[str] = []
    for word in words:
        filled.append(word or filled[-1])
    return filled
