"""Headers of aligned columns with names that contain blanks: ``Angle (deg)   2 bar   4 bar``.

Between two names, such a header has at least two blanks.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from ldbb_bayes.campaign.text_table import Row
from ldbb_bayes.reading.cell_units import number_in_cell
from ldbb_bayes.reading.overview import LONGEST_OVERVIEW
from ldbb_bayes.reading.unit_rows import COMMENT_SIGN

__all__ = ["with_aligned_headers"]

# Regular expression for the blanks between two names of columns in a header line.
_GAP = re.compile(r"\s{2,}|\t")
# A header is looked for in at most this number of rows above the numbers. A row of units and a row
# of dashes may stand between the header and the numbers.
_HEADER_ROWS = 4
# Successive rows of numbers are read as a table if there are at least this many.
_FEWEST_ROWS = 2


def with_aligned_headers(rows: Sequence[Row], lines: Sequence[str]) -> list[Row]:
    """Return rows in which each column name of a header is one cell.

    The rows were split at every blank, which divides a name such as ``Angle (deg)`` into two cells.
    If a row above numbers has too many cells for this reason, its line is split again, but only
    where at least two blanks follow each other. All other rows are returned unchanged.

    Parameters
    ----------
    rows
        Rows of a text, split at every blank.
    lines
        Lines of the text.
    """
    aligned = list(rows)
    for k in range(1, min(len(rows), LONGEST_OVERVIEW)):
        if not _begins_numbers(rows, k):
            continue
        width = len(rows[k].cells)
        for above in range(max(k - _HEADER_ROWS, 0), k):
            row = rows[above]
            names = _GAP.split(COMMENT_SIGN.sub("", lines[row.line - 1]).strip())
            if len(row.cells) != width and len(names) == width:
                aligned[above] = Row(row.line, names)
    return aligned


def _begins_numbers(rows: Sequence[Row], first: int) -> bool:
    """Return whether a table's numbers begin at a row, below a header that is wrongly split.

    ``rows`` are the rows of the text, split at every blank, and ``first`` is the index of the row.
    The header is wrongly split if the row above ``first`` has more or fewer cells than the rows of
    numbers. If it has as many cells, each of its cells is the name of one column, and the result is
    False.
    """
    width = len(rows[first].cells)
    below = rows[first : first + _FEWEST_ROWS]
    if width < 2 or len(below) < _FEWEST_ROWS or len(rows[first - 1].cells) == width:
        return False
    return all(len(row.cells) == width and _count_numbers(row) >= 2 for row in below)


def _count_numbers(row: Row) -> int:
    """Return how many cells of a row hold a number, with or without a unit."""
    return sum(number_in_cell(cell) is not None for cell in row.cells)
