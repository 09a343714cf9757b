"""Reading of loads from a line above the header of a table.

An example is the line ``Force [N],100,300,600``, which states the loads of three columns. Names,
planes and directions for the columns may stand in further lines next to the line of loads. If the
header itself states the loads, planes, directions and radii may stand in lines above it.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import replace

from ldbb_bayes.campaign.text_table import Row
from ldbb_bayes.machine.chain import PLANES
from ldbb_bayes.reading.header_rows import count_numbers
from ldbb_bayes.reading.header_units import unit_of
from ldbb_bayes.reading.merged_cells import with_merged_cells_filled
from ldbb_bayes.reading.names import load_in_name, radii_of_columns
from ldbb_bayes.reading.numerals import looks_like_number
from ldbb_bayes.reading.overview import LONGEST_OVERVIEW
from ldbb_bayes.reading.planes import PLANE_OF_SWAPPED, plane_named
from ldbb_bayes.reading.role_words import has_role
from ldbb_bayes.reading.sheet import Sheet
from ldbb_bayes.reading.stacked_tables import first_header
from ldbb_bayes.reading.travel_direction import direction_named
from ldbb_bayes.reading.words import UNITS, unit_named

__all__ = ["with_loads_in_header"]


# Regular expression for an opening bracket in a text, as in "Run 1 (36 N)".
_OPENING = re.compile(r"\s*[\[({]\s*(?=\S)")
# A line of loads has at least this number of cells; a line with fewer cells is a label and its
# value, as in Force;300 N.
_FEWEST_COLUMNS = 3


def with_loads_in_header(sheet: Sheet) -> Sheet:
    """Return a sheet in which loads from a line above the header are added to the header.

    Loads are forces and pressures. For example, the header ``Deviation [um]`` below the cell 100 N
    is changed to ``100 N Deviation [um]``. The line of loads must state a load for each column
    except the first. If the first cell of this line names force or pressure with a unit, the other
    cells may be numbers without units. Lines next to the line of loads may state a name, a plane or
    a direction for each column; these words are added to the header, too. If the header itself
    states the loads, planes, directions and radii in lines above it are added to it. In all of
    these lines, a text in merged cells applies to all columns below. The headers of columns of
    angles are not changed. A sheet without such a line is returned unchanged.
    """
    rows = _with_angles_named_below(sheet.rows)
    header = first_header(rows)
    if not header or len(rows[header].cells) < _FEWEST_COLUMNS:
        return sheet
    names = rows[header]
    rows_above = []
    merged_lines = set()  # line numbers of the rows above the header that have merged cells
    for row in rows[:header]:
        filled = with_merged_cells_filled(row, names.cells)
        rows_above.append(filled)
        if filled is not row:
            merged_lines.add(row.line)
    lines = _lines_of_columns(rows_above, len(names.cells), merged_lines)
    if not lines and _are_loads(names.cells):
        lines = _lines_of_conditions(rows_above, len(names.cells))
    if not lines:
        return sheet
    first = header - len(lines)
    merged = [names.cells[0]]
    is_named = _columns_named(names.cells)
    for column, name in enumerate(names.cells[1:]):
        if not is_named[column + 1]:
            merged.append(name)
            continue
        above = " ".join(_without_brackets(words[column]) for words in lines)
        unit_or_name = f"[{name}]" if unit_named(name) else name
        merged.append(f"{above} {unit_or_name}")
    joined = [*rows[:first], Row(names.line, merged), *rows[header + 1 :]]
    return replace(sheet, rows=joined)


def _with_angles_named_below(rows: Sequence[Row]) -> Sequence[Row]:
    """Return rows in which the name of the angles stands in the header, not beside the loads.

    In a header of two rows, the upper row may name the angles and the loads, as in ``Angle;100
    N;;300 N;``, and the lower row the columns below each load, as in ``°;CCW [µm];CW [µm];CCW
    [µm];CW [µm]``. Directions or planes may stand in the place of the loads, as in
    ``Angle;CW;;CCW;`` above ``;100 N;300 N;100 N;300 N``. The first cell of the lower row is empty
    or a unit of angles. The name of the angles is moved down into this cell. Other rows are
    returned unchanged.
    """
    for k in range(min(len(rows) - 1, LONGEST_OVERVIEW)):
        above = rows[k]
        below = rows[k + 1]
        if not _names_angles_and_conditions(above.cells) or len(below.cells) != len(above.cells):
            continue
        name = _name_of_angles(above.cells[0], below.cells[0])
        are_units = all(unit_named(cell.strip("[](){} ")) for cell in below.cells[1:])
        if name and all(below.cells[1:]) and not are_units and not count_numbers(below.cells):
            loads = Row(above.line, ["", *above.cells[1:]])
            header = Row(below.line, [name, *below.cells[1:]])
            return [*rows[:k], loads, header, *rows[k + 2 :]]
    return rows


def _names_angles_and_conditions(cells: Sequence[str]) -> bool:
    """Return whether a row names the angles in its first cell, and conditions in its other cells.

    The conditions are either loads, directions or planes. Cells may be empty, but not all of them.
    """
    if not cells or not has_role(unit_of(cells[0]).name, "angle"):
        return False
    conditions = [cell for cell in cells[1:] if cell]
    if not conditions:
        return False
    return (
        all(load_in_name([cell]) is not None for cell in conditions)
        or {direction_named(cell) for cell in conditions} <= {"CW", "CCW"}
        or all(plane_named(cell) in PLANES for cell in conditions)
    )


def _name_of_angles(name: str, below: str) -> str:
    """Return the header of the column of angles from its name and the cell below the name.

    The cell may be empty, or a unit such as °. The result is empty for any other cell.
    """
    if not below:
        return name
    unit = unit_named(below.strip("[](){} "))
    if unit in UNITS["angle"]:
        return f"{name} [{unit}]"
    return ""


def _without_brackets(text: str) -> str:
    """Return a text with commas instead of brackets: ``Run 1, 36 N`` for ``Run 1 [36 N]``.

    In a header, only the unit may be in brackets.
    """
    return re.sub(r"[\])}]", "", _OPENING.sub(", ", text)).removeprefix(", ")


def _columns_named(names: Sequence[str]) -> list[bool]:
    """Return, for each column, whether the texts above its header become part of the header.

    Usually, the result is True for every column except those whose header is empty or names angles.
    If there are several columns of angles, and equally many columns of readings, it is True only
    for the columns of readings. ``names`` are the headers of all columns.
    """
    angles = [has_role(unit_of(name).name, "angle") for name in names]
    readings = [has_role(unit_of(name).name, "reading") for name in names]
    if sum(angles) > 1 and sum(readings) == sum(angles):
        return readings
    return [bool(name) and not angle for name, angle in zip(names, angles, strict=True)]


def _lines_of_columns(
    rows: Sequence[Row], width: int, merged_lines: Collection[int]
) -> list[list[str]]:
    """Return the texts of the lines above a header that describe the columns below them.

    The result holds a list for each line, with one text for each column except the first. The texts
    are loads, names, planes or directions. The lines stand directly above the header, and one of
    them must state loads; if none does, the result is empty. The line of loads is the first in the
    result, because the caller joins the texts of a column in this order. If a line of names came
    first, the joined text could be ``Run 2 100 N``, and its load could be read as 2100 N. ``rows``
    are the rows above the header, and ``width`` is the number of cells of the header.
    ``merged_lines`` are the numbers of the lines with merged cells.
    """
    lines: list[list[str]] = []
    line_of_loads: list[str] = []
    for row in reversed(rows):
        if len(row.cells) != width:
            break
        loads = _loads_of(row.cells)
        words = loads or _words_of_columns(row.cells, row.line in merged_lines)
        if not words or (loads and line_of_loads):
            break
        if loads:
            line_of_loads = words
        else:
            lines.insert(0, words)
    if not line_of_loads:
        return []
    return [line_of_loads, *lines]


def _are_loads(names: Sequence[str]) -> bool:
    """Return whether every header of a table except that of the angles states a load."""
    is_named = _columns_named(names)
    of_readings = [name for name, is_reading in zip(names, is_named, strict=True) if is_reading]
    return all(load_in_name([name]) is not None for name in of_readings)


def _lines_of_conditions(rows: Sequence[Row], width: int) -> list[list[str]]:
    """Return the texts of the lines with planes, directions or radii above a header of loads.

    The result holds a list for each line, with one text for each column except the first. The lines
    stand directly above the header. A plane may have swapped letters, as in XZ; later code raises
    an error for it. ``rows`` are the rows above the header, and ``width`` is the number of cells of
    the header.
    """
    lines: list[list[str]] = []
    for row in reversed(rows):
        if len(row.cells) != width:
            break
        words = list(row.cells[1:])
        directions = [direction_named(word) for word in words]
        if set(directions) <= {"CW", "CCW"}:
            lines.insert(0, directions)
        elif all(plane_named(word) in (*PLANES, *PLANE_OF_SWAPPED) for word in words):
            lines.insert(0, words)
        elif all(words) and radii_of_columns(row.cells):
            lines.insert(0, radii_of_columns(row.cells))
        else:
            break
    return lines


def _words_of_columns(cells: Sequence[str], is_merged: bool) -> list[str]:
    """Return the names, planes or directions that a line above a table states for its columns.

    Every cell except the first must hold a name, a plane or a direction. ``is_merged`` states
    whether the line has merged cells. In a line of names without merged cells, all names must
    differ, and the first cell must be empty. The result is an empty list for any other line.
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
    are_names = not cells[0] and len(set(words)) == len(words)
    if has_letters and not is_unit and (are_names or is_merged):
        return words
    return []


def _loads_of(cells: Sequence[str]) -> list[str]:
    """Return the loads in a line, such as "100 N", one for each cell except the first.

    Return an empty list if one of these cells states no load. ``cells`` are the cells of the line.
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
