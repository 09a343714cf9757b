"""Columns of a list of tests, such as ``F cal. [kN]`` and ``Setup``.

A list of tests stands on a sheet that holds no readings. It has a row for each test, and a column
for each quantity.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable

from ldbb_bayes.reading.header_units import unit_of
from ldbb_bayes.reading.lines_above import statements_in
from ldbb_bayes.reading.role_words import has_role
from ldbb_bayes.reading.timestamps import stamps_in
from ldbb_bayes.reading.travel_direction import directions_stated
from ldbb_bayes.reading.words import UNITS, comparable

__all__ = ["unread_headers", "with_loads_named"]

# Roles of the columns of loads (forces and pressures). The header of such a column is replaced by
# the name of its role.
_LOADS = ("force", "pressure")


def with_loads_named(cells: Iterable[tuple[str, str]]) -> list[tuple[str, str]]:
    """Return the cells of a row, with simple headers for forces and pressures.

    The row belongs to a list of tests. For example, the header ``F cal. [kN]`` is replaced by
    ``force [kN]``, which later code can read. Other headers are not changed.

    Parameters
    ----------
    cells
        Cells of the row. Each cell is a pair of texts: its line and sheet, such as "3 of
        notes.txt", and its header followed by its content, such as "Setup: 2".
    """
    named = []
    for place, text in cells:
        header, _, cell = text.rpartition(": ")
        stated = unit_of(header)
        for role in _LOADS:
            is_read = bool(statements_in([(place, text)]))
            if has_role(stated.name, role) and stated.unit in UNITS[role] and not is_read:
                text = f"{role} [{stated.unit}]: {cell}"
        named.append((place, text))
    return named


def unread_headers(cells: Iterable[tuple[str, str]], names: Collection[str]) -> list[str]:
    """Return the headers of the columns of a list of tests that are not used for a given test.

    Each row of the list describes one test; ``cells`` are those of the given test.

    Parameters
    ----------
    cells
        Cells in the row of the test, as pairs of texts. The first text of a pair is the place of
        the cell. The second text consists of its header and its content, as in "Setup: 2".
    names
        Names of the test. A cell that holds one of these names is used, so its header is not
        returned.
    """
    names_of_test = {comparable(name).replace(" ", "") for name in names}
    headers = []
    for place, text in cells:
        header, _, cell = text.rpartition(": ")
        lines = [(place, text)]
        is_read = bool(statements_in(lines)) or bool(stamps_in(text))
        is_name = comparable(cell).replace(" ", "") in names_of_test
        if not (is_name or is_read or directions_stated(lines)):
            headers.append(header)
    return headers
