"""Columns with words of G-code, such as ``G`` with the numbers 2 and 3: G2 and G3."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

from ldbb_bayes.reading.heading import Heading, unused_columns

__all__ = ["with_columns_of_g_words"]

# Regular expression for the header of a column with words of G-code.
_HEADER = re.compile(r"G(?:[-_ ]?(?:codes?|words?|functions?|wort|funktion))?", re.IGNORECASE)
# Regular expressions for cells with the word for an arc, G2 or G3, and for a plane, G17 to G19. The
# letter G may be left out, and a spreadsheet may have added a decimal.
_ARC = re.compile(r"G?0?(?P<number>[23])(?:\.0+)?", re.IGNORECASE)
_PLANE = re.compile(r"G?(?P<number>1[789])(?:\.0+)?", re.IGNORECASE)


def with_columns_of_g_words(
    heading: Heading, cells: Sequence[Sequence[str]]
) -> tuple[Heading, list[list[str]]]:
    """Return a heading and its columns, with the letter G before the numbers of a column ``G``.

    A column whose cells are all 2 or 3 holds the directions of travel, G2 and G3, if no other
    column does. In a column whose cells are all 17 to 19, they are planes. Other columns are
    returned unchanged.

    Parameters
    ----------
    heading
        Heading of a table.
    cells
        Cells of each column.
    """
    columns = [list(column_cells) for column_cells in cells]
    roles = dict(heading.roles)
    for column in unused_columns(heading):
        if not cells[column] or not _HEADER.fullmatch(heading.headers[column].strip()):
            continue
        arcs = [_ARC.fullmatch(cell.strip()) for cell in cells[column]]
        planes = [_PLANE.fullmatch(cell.strip()) for cell in cells[column]]
        words = arcs if None not in arcs else planes
        if None in words:
            continue
        columns[column] = [f"G{word['number']}" for word in words if word is not None]
        if words is arcs:
            roles.setdefault("direction", column)
    return replace(heading, roles=roles), columns
