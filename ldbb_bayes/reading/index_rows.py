"""Headers of several levels above a row with the name of the index, as pandas writes them.

An example are the rows ``,100 N,100 N``, ``,CW,CCW`` and ``angle_deg,,``. In a workbook, equal
names next to each other are one merged cell, of which only the first holds the name.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from ldbb_bayes.campaign.text_table import Row
from ldbb_bayes.reading.column_roles import count_numbers, has_role, unit_of
from ldbb_bayes.reading.overview import LONGEST_OVERVIEW
from ldbb_bayes.reading.sheet import Sheet
from ldbb_bayes.reading.travel_direction import direction_named
from ldbb_bayes.reading.words import unit_named

__all__ = ["with_index_names"]

# Directions of travel in the cells of a column.
_DIRECTIONS = {"CW", "CCW"}


def with_index_names(sheet: Sheet) -> Sheet:
    """Return a sheet in which the name of the index and the names of all levels are one header.

    The header of a column is made of its names in all levels, such as ``100 N dev_um``. A column of
    equal directions below a name such as ``100 N`` becomes part of the headers of the other columns
    below this name. A sheet without a row for the name of the index is returned unchanged.
    """
    rows = sheet.rows
    for k in range(1, min(len(rows) - 1, LONGEST_OVERVIEW)):
        n_index = _count_index_names(rows[k], rows[k - 1], rows[k + 1])
        if not n_index:
            continue
        width = len(rows[k + 1].cells)
        first = k - 1
        while first > 0 and _is_level(rows[first - 1], n_index, width):
            first -= 1
        levels = [_filled(row, n_index, width) for row in rows[first:k]]
        names = rows[k].cells[:n_index]
        for column in range(n_index, width):
            names.append(" ".join(level[column] for level in levels if level[column]))
        header = Row(rows[k - 1].line, names)
        joined = replace(sheet, rows=[*rows[:first], header, *rows[k + 1 :]])
        return _without_directions(joined, first, levels, n_index)
    return sheet


def _count_index_names(row: Row, above: Row, below: Row) -> int:
    """Return how many names of an index a row holds; zero if it holds anything else.

    The row must hold nothing else. The row above it must have names in the other columns, and the
    row below it must have numbers.
    """
    width = len(below.cells)
    n_index = sum(bool(cell) for cell in row.cells)
    if not 0 < n_index < width or any(row.cells[n_index:]) or count_numbers(below.cells) < 2:
        return 0
    has_names_above = len(above.cells) == width and all(above.cells[n_index:])
    if not has_names_above or count_numbers([*row.cells, *above.cells]):
        return 0
    return n_index if _may_be_index(row.cells[:n_index], above.cells[:n_index]) else 0


def _may_be_index(names: Sequence[str], above: Sequence[str]) -> bool:
    """Return whether texts are names of an index, and not units below the names of columns.

    The cells ``above`` them are usually empty; otherwise one of the texts must name angles or
    times.
    """
    if any(unit_named(name) for name in names):
        return False
    roles = [has_role(unit_of(name).name, role) for name in names for role in ("angle", "time")]
    return any(roles) or not any(above)


def _is_level(row: Row, n_index: int, width: int) -> bool:
    """Return whether a row holds the names of a level above the lowest level of a header.

    The first column behind the index has a name; if the level itself has a name, at least one more
    column has. No name is a number. ``n_index`` is the number of columns of the index, and
    ``width`` the number of all columns.
    """
    cells = row.cells
    n_names = sum(bool(cell) for cell in cells[n_index:])
    if n_names < 1 + any(cells[:n_index]) or not cells[n_index]:
        return False
    return len(cells) <= width and not count_numbers(cells)


def _filled(row: Row, n_index: int, width: int) -> list[str]:
    """Return the names of a level in all columns; an empty cell has the name to its left.

    The cells of the index, whose number is ``n_index``, are left empty. ``width`` is the number of
    columns.
    """
    filled = [""] * n_index
    for cell in [*row.cells, *[""] * width][n_index:width]:
        filled.append(cell or filled[-1])
    return filled


def _without_directions(
    sheet: Sheet, header: int, levels: Sequence[Sequence[str]], n_index: int
) -> Sheet:
    """Return a sheet without columns of equal directions, which become part of the other headers.

    Parameters
    ----------
    sheet
        The sheet with one header.
    header
        Index of the header among the rows of the sheet.
    levels
        Names of all columns in each level, from the highest level to the lowest.
    n_index
        Number of columns of the index.
    """
    names = list(sheet.rows[header].cells)
    below = sheet.rows[header + 1 :]
    if len(levels) < 2 or any(len(row.cells) != len(names) for row in below):
        return sheet
    groups = list(zip(*levels[:-1], strict=True))
    kept = list(range(n_index))
    for column in range(n_index, len(names)):
        directions = {direction_named(row.cells[column]) for row in below}
        if len(directions) > 1 or not directions <= _DIRECTIONS:
            kept.append(column)
            continue
        for other in range(n_index, len(names)):
            if groups[other] == groups[column]:
                names[other] = f"{min(directions)} {names[other]}"
    if len(kept) == len(names):
        return sheet
    return _with_columns(sheet, header, names, kept)


def _with_columns(sheet: Sheet, header: int, names: Sequence[str], kept: Sequence[int]) -> Sheet:
    """Return a sheet with some columns of its table.

    ``header`` is the index of the header among the rows, ``names`` are the headers of all columns,
    and ``kept`` the indices of the columns to return.
    """
    rows = list(sheet.rows[:header])
    for row in [Row(sheet.rows[header].line, list(names)), *sheet.rows[header + 1 :]]:
        rows.append(Row(row.line, [row.cells[column] for column in kept]))
    return replace(
        sheet,
        rows=rows,
        cell_units=_with_places(sheet.cell_units, kept),
        format_units=_with_places(sheet.format_units, kept),
    )


def _with_places(
    units: Mapping[tuple[int, int], str], kept: Sequence[int]
) -> dict[tuple[int, int], str]:
    """Return units of cells for a table with the columns ``kept`` of another table."""
    return {
        (line, kept.index(column)): unit for (line, column), unit in units.items() if column in kept
    }
