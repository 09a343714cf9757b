"""Loads in a line above the header, such as ``Force [N],100,300,600`` above three columns.

Names, planes and directions for the columns may stand in further lines next to the line of loads.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

from ldbb_bayes.campaign.text_table import Row
from ldbb_bayes.machine.chain import PLANES
from ldbb_bayes.reading.column_roles import has_role, unit_of
from ldbb_bayes.reading.names import load_in_name
from ldbb_bayes.reading.numerals import looks_like_number
from ldbb_bayes.reading.planes import plane_named
from ldbb_bayes.reading.sheet import Sheet
from ldbb_bayes.reading.stacked_tables import first_header
from ldbb_bayes.reading.travel_direction import direction_named
from ldbb_bayes.reading.words import UNITS, unit_named

__all__ = ["with_loads_in_header"]


def with_loads_in_header(sheet: Sheet) -> Sheet:
    """Return a sheet in which the loads from the line above the header are put into the header.

    Loads are forces and pressures. The line of loads must state a load, such as ``100 N``, for each
    column except the first. If the first cell of this line names force or pressure with a unit, the
    other cells may be numbers without units. For example, the header ``Deviation [um]`` below 100 N
    is changed to ``100 N Deviation [um]``. Lines next to the line of loads may state a name, a
    plane or a direction for each column; their words are put into the header, too. A sheet without
    a line of loads is returned unchanged.
    """
    header = first_header(sheet.rows)
    if not header:
        return sheet
    names = sheet.rows[header]
    lines = _lines_of_columns(sheet.rows[:header], len(names.cells))
    if not lines:
        return sheet
    first = header - len(lines)
    merged = [names.cells[0]]
    for column, name in enumerate(names.cells[1:]):
        above = " ".join(words[column] for words in lines)
        unit_or_name = f"[{name}]" if unit_named(name) else name
        merged.append(f"{above} {unit_or_name}")
    rows = [*sheet.rows[:first], Row(names.line, merged), *sheet.rows[header + 1 :]]
    return replace(sheet, rows=rows)


def _lines_of_columns(rows: Sequence[Row], width: int) -> list[list[str]]:
    """Return, for each line that describes the columns below, one text for each column.

    The texts are loads, names, planes or directions. The lines stand directly above the header, and
    one of them must state loads; if none does, the list is empty. The first column has no text.
    ``rows`` are the rows above the header, and ``width`` is the number of cells of the header.
    """
    lines: list[list[str]] = []
    has_loads = False
    for row in reversed(rows):
        if len(row.cells) != width:
            break
        loads = _loads_of(row.cells)
        words = loads or _words_of_columns(row.cells)
        if not words or (loads and has_loads):
            break
        has_loads = has_loads or bool(loads)
        lines.insert(0, words)
    if not has_loads:
        return []
    return lines


def _words_of_columns(cells: Sequence[str]) -> list[str]:
    """Return the names, planes or directions in a line, one for each cell except the first.

    In a line of names, all names must differ, and the first cell must be empty. The result is an
    empty list if the line is no line of names, planes or directions.
    """
    words = list(cells[1:])
    if not all(words):
        return []
    if all(plane_named(word) in PLANES for word in words):
        return words
    directions = [direction_named(word) for word in words]
    if set(directions) <= {"CW", "CCW"}:
        return directions
    has_letters = all(re.search(r"[^\W\d]", word) for word in words)
    is_unit = any(unit_named(word.strip("[]()")) for word in words)
    if not cells[0] and has_letters and not is_unit and len(set(words)) == len(words):
        return words
    return []


def _loads_of(cells: Sequence[str]) -> list[str]:
    """Return the loads in a line, such as "100 N", one for each cell except the first.

    Return an empty list if one of these cells states no load.
    """
    unit = _unit_of_loads(cells[0])
    loads = []
    for cell in cells[1:]:
        load = cell
        if unit and looks_like_number(cell):
            load = f"{cell} {unit}"
        if load_in_name([load]) is None:
            return []
        loads.append(load)
    return loads


def _unit_of_loads(cell: str) -> str:
    """Return the unit of force or pressure that a cell states; empty if the cell states none."""
    header = unit_of(cell)
    for role in ("force", "pressure"):
        if has_role(header.name, role) and header.unit in UNITS[role]:
            return header.unit
    return ""
