"""Rows of printed tables, divided at blanks, that have more cells than their header has names.

The additional cells are remarks in some of the rows, as in ``90  -37  small bump``, or units behind
the numbers of all rows, as in ``7°30'  7,7 µm``.
"""

from __future__ import annotations

from collections.abc import Sequence

from ldbb_bayes.campaign.circular_test import FEWEST_READINGS
from ldbb_bayes.campaign.text_table import Row
from ldbb_bayes.reading.cell_units import number_in_cell
from ldbb_bayes.reading.header_rows import is_rule, names_any_role, names_columns
from ldbb_bayes.reading.numerals import looks_like_number
from ldbb_bayes.reading.words import unit_named

__all__ = ["with_remarks_joined", "with_units_joined"]


def with_units_joined(rows: Sequence[Row]) -> list[Row]:
    """Return rows in which a unit that stands behind a number is joined to the number.

    This is done if all rows of a table have such a unit in the same place, and the header has no
    name for it. For example, the cells ``7,7`` and ``µm`` become ``7,7 µm``.
    """
    joined = list(rows)
    for header, row in enumerate(rows):
        if not _may_be_header(row):
            continue
        start, end = _table_below(rows, header)
        columns = _columns_of_units(rows[start:end])
        if columns and len(row.cells) == len(rows[start].cells) - len(columns):
            for k in range(start, end):
                joined[k] = Row(rows[k].line, _joined_cells(rows[k].cells, columns))
    return joined


def with_remarks_joined(rows: Sequence[Row]) -> list[Row]:
    """Return rows in which the words of a remark behind the numbers of a row are one cell.

    This is done if the last name of a header names no quantity, such as ``Remark``, and the first
    row below it has numbers in all other columns. A row without a remark gets an empty cell.
    """
    joined = list(rows)
    for header, row in enumerate(rows):
        n_names = len(row.cells)
        if n_names < 3 or not _may_be_header(row) or names_any_role(row.cells[-1]):
            continue
        n_numbers = n_names - 1
        numbered = []
        for k in range(header + 1, len(rows)):
            if is_rule(rows[k].cells):
                continue
            if not _begins_with_numbers(rows[k].cells, n_numbers):
                break
            numbered.append(k)
        if len(numbered) < FEWEST_READINGS:
            continue
        if all(len(rows[k].cells) >= n_names for k in numbered):
            continue  # each row has a cell for each name
        for k in numbered:
            remark = " ".join(rows[k].cells[n_numbers:])
            joined[k] = Row(rows[k].line, [*rows[k].cells[:n_numbers], remark])
    return joined


def _may_be_header(row: Row) -> bool:
    """Return whether a row has names for columns, at least one of which names a quantity."""
    return names_columns(row.cells) and any(names_any_role(cell) for cell in row.cells)


def _begins_with_numbers(cells: Sequence[str], n_numbers: int) -> bool:
    """Return whether the first ``n_numbers`` cells of a row are numbers, and no further one is."""
    first = cells[:n_numbers]
    if len(first) < n_numbers or not all(looks_like_number(cell) for cell in first):
        return False
    return not any(looks_like_number(cell) for cell in cells[n_numbers:])


def _table_below(rows: Sequence[Row], header: int) -> tuple[int, int]:
    """Return the indices of the first row of a table and of the row that follows its last row.

    ``header`` is the index of the header. Lines of dashes directly below the header are skipped.
    The rows of the table have the same number of cells.
    """
    start = header + 1
    while start < len(rows) and is_rule(rows[start].cells):
        start += 1
    end = start
    while end < len(rows) and len(rows[end].cells) == len(rows[start].cells):
        end += 1
    return start, end


def _columns_of_units(rows: Sequence[Row]) -> list[int]:
    """Return the indices of the columns that hold a unit in each row, behind a number."""
    if len(rows) < FEWEST_READINGS:
        return []
    columns = []
    for column in range(1, len(rows[0].cells)):
        are_units = all(unit_named(row.cells[column]) for row in rows)
        if are_units and all(number_in_cell(row.cells[column - 1]) for row in rows):
            columns.append(column)
    return columns


def _joined_cells(cells: Sequence[str], columns_of_units: Sequence[int]) -> list[str]:
    """Return the cells of a row, with each unit joined to the cell before it."""
    joined: list[str] = []
    for column, cell in enumerate(cells):
        if column in columns_of_units:
            joined[-1] += f" {cell}"
        else:
            joined.append(cell)
    return joined
