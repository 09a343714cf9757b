"""Sheets without a table of readings: what they state of all tests, and of one test in a list."""

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

# Rows of such a sheet, and rows above a table, that are looked at.
LONGEST_OVERVIEW = 1000


@dataclass
class OverviewLines:
    """Lines of sheets without a table of readings, each with its place."""

    of_all_tests: list[tuple[str, str]] = field(default_factory=list)
    of_this_test: list[tuple[str, str]] = field(default_factory=list)


def overview_lines(sheets: Iterable[Sheet], names: Collection[str]) -> OverviewLines:
    """Return the lines that state something of all tests, and those of the test of these names.

    Lines outside lists of tests are of all tests. In a list, a row with one of the names is of that
    test; its cells come as ``header: cell``.
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
    """Return whether a row names the test, and not as the value of a label."""
    named = wanted & {comparable(cell) for cell in filled}
    if not named:
        return False
    return comparable(filled[0]) in named or not _has_label(filled[0])


def _labelled_cells(
    place: str, header: Sequence[str], cells: Sequence[str]
) -> list[tuple[str, str]]:
    """Return the filled cells of a row, each behind the name of its column."""
    labelled = []
    for name, cell in zip(header, cells, strict=False):
        if name and cell:
            if is_direction(cell):
                name = "direction"
            labelled.append((place, f"{name}: {cell}"))
    return labelled


def _has_label(cell: str) -> bool:
    """Return whether a cell is the label of a value beside or behind it: ``Radius``, ``Ort:``."""
    name = unit_of(cell).name.rstrip(" :")
    return is_label(name) or re.search(r"\D:|:$", cell) is not None


def _heads_a_list(filled: Sequence[str]) -> bool:
    """Return whether a row names the columns of a list of tests.

    A label with its value is no such row: ``Radius | 100 mm``.
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
