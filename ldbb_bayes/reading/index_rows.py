"""Headers of several rows with a separate row for the name of the index, as pandas writes them.

The index consists of the first column or columns of a table; usually it holds the angles. Each row
of the header above the name of the index is called a level. In the header with the rows
``,100 N,100 N``, ``,CW,CCW`` and ``angle_deg,,``, the first two rows are levels, and the third
names the index. In a workbook, equal names next to each other are one merged cell, of which only
the first cell holds the name.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from ldbb_bayes.campaign.text_table import Row
from ldbb_bayes.reading.header_rows import count_numbers, is_rule
from ldbb_bayes.reading.header_units import unit_of
from ldbb_bayes.reading.numerals import looks_like_number
from ldbb_bayes.reading.overview import LONGEST_OVERVIEW
from ldbb_bayes.reading.role_words import has_role
from ldbb_bayes.reading.sheet import Sheet
from ldbb_bayes.reading.travel_direction import direction_named
from ldbb_bayes.reading.words import UNITS, unit_named

__all__ = ["with_index_names"]

# Directions of travel that the cells of a column may hold.
_DIRECTIONS = {"CW", "CCW"}


def with_index_names(sheet: Sheet) -> Sheet:
    """Return a sheet in which the rows of a header are joined into one row.

    For example, the rows ``,100 N,300 N``, ``,dev_um,dev_um`` and ``angle_deg,,`` become the row
    ``angle_deg,100 N dev_um,300 N dev_um``. The last row of the header must name only the first
    column or columns, as ``angle_deg,,`` does. Any other sheet is returned unchanged. If all cells
    of a column hold the same direction of travel, the column is removed. The direction is added to
    the headers of the columns in the same group, such as all columns below ``100 N``.
    """
    rows = [_with_unit_of_loads(row) for row in sheet.rows[:LONGEST_OVERVIEW]]
    rows += sheet.rows[LONGEST_OVERVIEW:]
    for k in range(1, min(len(rows) - 1, LONGEST_OVERVIEW)):
        n_index = _count_index_names(rows[k], rows[k - 1], rows[k + 1])
        if not n_index:
            continue
        width = len(rows[k + 1].cells)
        first = k - 1
        while first > 0 and _is_level(rows[first - 1], n_index, width):
            first -= 1
        levels = [_names_of_level(row, n_index, width) for row in rows[first:k]]
        names = rows[k].cells[:n_index]
        for column in range(n_index, width):
            names.append(" ".join(level[column] for level in levels if level[column]))
        header = Row(rows[k - 1].line, names)
        joined = replace(sheet, rows=[*rows[:first], header, *rows[k + 1 :]])
        return _without_directions(joined, first, levels, n_index)
    return sheet


def _with_unit_of_loads(row: Row) -> Row:
    """Return a row of loads, with the unit of the loads appended to each number.

    For example, ``Force_N,36,238`` becomes ``Force_N,36 N,238 N``. Cells behind the first load may
    be empty, because they are merged with the cell to the left of them. Any other row is returned
    unchanged.
    """
    label = unit_of(row.cells[0]) if row.cells else None
    loads = row.cells[1:]
    if label is None or label.unit not in UNITS["force"] or not has_role(label.name, "force"):
        return row
    stated = [cell for cell in loads if cell]
    if len(stated) < 2 or not loads[0] or not all(looks_like_number(cell) for cell in stated):
        return row
    return Row(
        row.line, [row.cells[0], *[f"{cell} {label.unit}" if cell else "" for cell in loads]]
    )


def _count_index_names(row: Row, above: Row, below: Row) -> int:
    """Return the number of index columns whose names stand in a row: 1 for ``angle_deg,,``.

    The index consists of the first column or columns of the table, such as the angles. The result
    is zero unless three conditions hold: the row has names of index columns and nothing else, the
    row ``above`` has names in all other columns, and the row ``below`` has numbers, one of them in
    another column. Thus, ``Angle;Reading;;`` below ``Force;36 N;Radius;100 mm`` is a whole header.
    """
    width = len(below.cells)
    n_index = sum(bool(cell) for cell in row.cells)
    if not 0 < n_index < width or any(row.cells[n_index:]) or count_numbers(below.cells) < 2:
        return 0
    if is_rule(row.cells) or not count_numbers(below.cells[n_index:]):
        return 0
    has_names_above = len(above.cells) == width and all(above.cells[n_index:])
    if not has_names_above or count_numbers([*row.cells, *above.cells]):
        return 0
    is_named_level = n_index == 1 and bool(above.cells[0]) and _hold_units(above.cells[1:])
    may_be_index = _may_be_index(row.cells[:n_index], above.cells[:n_index])
    return n_index if is_named_level or may_be_index else 0


def _hold_units(cells: Sequence[str]) -> bool:
    """Return whether all cells of a row are units, as in the row ``°,mm,°,mm`` of a header."""
    return all(unit_named(cell) for cell in cells)


def _may_be_index(names: Sequence[str], above: Sequence[str]) -> bool:
    """Return whether the texts in a row may name the columns of a table's index.

    The index consists of the first column or columns of the table, such as the angles. The texts do
    not name them if one of the texts is a unit, because the row then holds the units of a header.
    ``above`` are the cells above the texts. If one of these cells is not empty, one of the texts
    must name angles or times.
    """
    if any(unit_named(name) for name in names):
        return False
    roles = [has_role(unit_of(name).name, role) for name in names for role in ("angle", "time")]
    return any(roles) or not any(above)


def _is_level(row: Row, n_index: int, width: int) -> bool:
    """Return whether a row is one of several rows of names (levels) that form a header.

    The first ``n_index`` columns of the table are its index, such as the angles. The row must have
    a name for the first column after the index, and no numbers. If a cell in the columns of the
    index holds a text, this text is taken to be the name of the level. The row must then have names
    for at least two of the columns after the index. ``width`` is the number of all columns.
    """
    cells = row.cells
    n_names = sum(bool(cell) for cell in cells[n_index:])
    if n_names < 1 + any(cells[:n_index]) or not cells[n_index]:
        return False
    return len(cells) <= width and not count_numbers(cells)


def _names_of_level(row: Row, n_index: int, width: int) -> list[str]:
    """Return the name of each column from one row of a header that consists of several rows.

    If the cell of a column is empty, the name to its left also applies to this column. The names of
    the first ``n_index`` columns, such as the column of angles, are empty. ``width`` is the number
    of all columns.
    """
    filled = [""] * n_index
    for cell in [*row.cells, *[""] * width][n_index:width]:
        filled.append(cell or filled[-1])
    return filled


def _without_directions(
    sheet: Sheet, header: int, levels: Sequence[Sequence[str]], n_index: int
) -> Sheet:
    """Return a sheet without columns of directions; the directions are added to headers instead.

    If all cells of a column hold the same direction, the column is removed. The direction is then
    added to the headers of the other columns in the same group. Before the header was joined into
    one row, it had several rows of names, called levels. Columns are in the same group if they have
    the same names in all levels except the lowest.

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
    remaining_columns = list(range(n_index))
    for column in range(n_index, len(names)):
        directions = {direction_named(row.cells[column]) for row in below}
        if len(directions) > 1 or not directions <= _DIRECTIONS:
            remaining_columns.append(column)
            continue
        for same_group in range(n_index, len(names)):
            if groups[same_group] == groups[column]:
                names[same_group] = f"{min(directions)} {names[same_group]}"
    if len(remaining_columns) == len(names):
        return sheet
    return _with_columns(sheet, header, names, remaining_columns)


def _with_columns(sheet: Sheet, header: int, names: Sequence[str], columns: Sequence[int]) -> Sheet:
    """Return a sheet with some of the columns of its table.

    ``header`` is the index of the header among the rows, ``names`` are the headers of all columns,
    and ``columns`` are the indices of the columns that remain.
    """
    rows = list(sheet.rows[:header])
    for row in [Row(sheet.rows[header].line, list(names)), *sheet.rows[header + 1 :]]:
        rows.append(Row(row.line, [row.cells[column] for column in columns]))
    return replace(
        sheet,
        rows=rows,
        cell_units=_units_of_columns(sheet.cell_units, columns),
        format_units=_units_of_columns(sheet.format_units, columns),
    )


def _units_of_columns(
    units: Mapping[tuple[int, int], str], columns: Sequence[int]
) -> dict[tuple[int, int], str]:
    """Return a dict with the units of cells, after some columns of the table were removed.

    Each key is a pair: the line number and the column index of a cell. ``units`` is the dict before
    the removal, and ``columns`` are the indices of the columns that remain. In the result, the
    columns have new indices, because the removed columns are no longer counted.
    """
    remaining = {}
    for (line, column), unit in units.items():
        if column in columns:
            remaining[line, columns.index(column)] = unit
    return remaining
