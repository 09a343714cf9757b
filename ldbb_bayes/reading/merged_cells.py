"""Merged cells above the header, with one text, such as ``100 N``, for several columns.

On the screen, merged cells appear as one cell. In the file they are separate cells: one of them,
usually the first, holds the text, and the others are empty.
"""

from __future__ import annotations

from collections.abc import Sequence

from ldbb_bayes.campaign.text_table import Row
from ldbb_bayes.reading.header_units import unit_of
from ldbb_bayes.reading.role_words import has_role

__all__ = ["with_merged_cells_filled"]


def with_merged_cells_filled(row: Row, names: Sequence[str]) -> Row:
    """Return a row above the header with the text of each merged cell in all columns that it spans.

    The columns form groups, for example one for each force. The row is changed only if it has
    exactly one text for each group; its first cell may also be a label, such as ``Force [N]``. Any
    other row is returned unchanged. A group begins at each column of angles. Columns before the
    first column of angles, such as the numbers of the rows, belong to no group. If only the first
    column holds angles, a group begins at each filled cell after the first cell of the row, and all
    groups must have the same number of columns.

    Parameters
    ----------
    row
        A row above the header.
    names
        Headers of all columns.
    """
    cells = [*row.cells, *[""] * (len(names) - len(row.cells))]
    if len(cells) > len(names) or all(cells[1:]):
        return row
    starts = [k for k, name in enumerate(names) if has_role(unit_of(name).name, "angle")]
    if not starts:
        return row
    if starts == [0]:
        starts = _starts_of_even_groups(cells)
    if len(starts) < 2:
        return row
    filled = _with_groups_filled(cells, starts)
    if filled is None and cells[0]:
        # The first cell may be a label of the row, such as "Force [N]". Such a label belongs to no
        # group.
        filled = _with_groups_filled(["", *cells[1:]], starts)
        if filled is not None:
            filled[0] = cells[0]
    if filled is None:
        return row
    return Row(row.line, filled)


def _starts_of_even_groups(cells: Sequence[str]) -> list[int]:
    """Return the indices of the cells that begin groups with the same number of columns.

    Each filled cell after the first cell begins a group of columns. Return an empty list if the
    groups have different numbers of columns, if there are fewer than two groups, or if the second
    cell is empty.
    """
    starts = [k for k, cell in enumerate(cells) if cell and k > 0]
    if len(starts) < 2 or starts[0] != 1:
        return []
    width = starts[1] - starts[0]
    if starts != list(range(1, len(cells), width)) or (len(cells) - 1) % width:
        return []
    return starts


def _with_groups_filled(cells: Sequence[str], starts: Sequence[int]) -> list[str] | None:
    """Return a row in which every cell of a group of columns holds the text of the group.

    In ``cells``, only one cell of each group holds this text. Return None if a group does not have
    exactly one filled cell. ``starts`` are the indices of the columns at which the groups begin.
    """
    filled = list(cells[: starts[0]])
    ends = [*starts[1:], len(cells)]
    for start, end in zip(starts, ends, strict=True):
        texts = [cell for cell in cells[start:end] if cell]
        if len(texts) != 1:
            return None
        filled += texts * (end - start)
    return filled
