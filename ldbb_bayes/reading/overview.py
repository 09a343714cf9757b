"""Statements in sheets without a table of readings, about all tests or about single tests.

Such a sheet may hold a list with one row per test.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field

from ldbb_bayes.campaign.campaign import PER_TEST
from ldbb_bayes.reading.column_roles import has_role, names_any_role, names_columns, unit_of
from ldbb_bayes.reading.lines_above import is_direction, is_label
from ldbb_bayes.reading.numerals import NUMBER_IN_TEXT
from ldbb_bayes.reading.sheet import Sheet
from ldbb_bayes.reading.words import comparable

__all__ = ["LONGEST_OVERVIEW", "OverviewLines", "overview_lines"]

# So many rows of a sheet without a table, and of lines above a table, are examined.
LONGEST_OVERVIEW = 1000


@dataclass
class OverviewLines:
    """Lines of sheets without a table of readings: place and text of each."""

    #: lines that concern all tests
    of_all_tests: list[tuple[str, str]] = field(default_factory=list)
    #: cells from the row of one test in a list of tests
    of_this_test: list[tuple[str, str]] = field(default_factory=list)


def overview_lines(sheets: Iterable[Sheet], names: Collection[str]) -> OverviewLines:
    """Return the lines that concern all tests, and those that concern the test of given names.

    Lines outside lists of tests concern all tests. In a list of tests, a row that holds one of the
    names concerns that test; each of its cells is returned as ``header: cell``.
    """
    lines = OverviewLines()
    wanted = {comparable(name) for name in names}
    for sheet in sheets:
        header: list[str] = []
        for row in sheet.rows[:LONGEST_OVERVIEW]:
            place = f"{row.line} of {sheet.place}"
            filled = [cell for cell in row.cells if cell]
            if not filled:
                continue
            if _is_row_of_test(filled, wanted):
                lines.of_this_test += _labelled_cells(place, header, row.cells)
            elif _heads_a_list(filled):
                header = list(row.cells)
            elif not header or _has_label(filled[0]):
                separator = sheet.separator or ";"
                lines.of_all_tests.append((place, separator.join(filled)))
    return lines


def _is_row_of_test(filled: Sequence[str], wanted: set[str]) -> bool:
    """Return whether a row of a list is that of the test, which it must name.

    A row in which the name is only the value of a label, such as ``Operator:``, does not count.
    """
    named = wanted & {comparable(cell) for cell in filled}
    if not named:
        return False
    return comparable(filled[0]) in named or not _has_label(filled[0])


def _labelled_cells(
    place: str, header: Sequence[str], cells: Sequence[str]
) -> list[tuple[str, str]]:
    """Return the filled cells of a row as ``header: cell``, each with its place."""
    labelled = []
    for name, cell in zip(header, cells, strict=False):
        if name and cell:
            if is_direction(cell):
                name = "direction"
            labelled.append((place, f"{name}: {cell}"))
    return labelled


def _has_label(cell: str) -> bool:
    """Return whether a cell labels a value that follows: ``Radius``, ``Ort:``, ``Radius: 100``."""
    name = unit_of(cell).name.rstrip(" :")
    return is_label(name) or re.search(r"\D:|:$", cell) is not None


def _heads_a_list(filled: Sequence[str]) -> bool:
    """Return whether a row names the columns of a list of tests.

    A row with a label and its value does not: ``Radius | 100 mm``.
    """
    if not names_columns(filled):
        return False
    if any(cell.endswith(":") or re.match(NUMBER_IN_TEXT, cell) for cell in filled):
        return False
    first_is_label = _has_label(filled[0])
    if len(filled) == 2 and first_is_label:
        return has_role(unit_of(filled[1]).name, "test")
    candidates = filled
    if len(filled) == 2 or first_is_label:
        candidates = filled[1:]
    return any(names_any_role(cell) or cell in PER_TEST for cell in candidates)
