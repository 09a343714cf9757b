"""Columns of a foreign table that hold the unit of a number beside them, row by row."""

from __future__ import annotations

from collections.abc import Sequence

from ldbb_bayes.reading.unit_lines import UNIT_COLUMN
from ldbb_bayes.reading.words import comparable, unit_named

__all__ = ["unit_columns"]

# Units of length that are hardly words of anything else; a column of them needs no header.
_PLAIN_UNITS = frozenset({"um", "mm", "nm", "inch", "mil", "uinch", "deg", "rad", "gon", "kN"})


def unit_columns(
    headers: Sequence[str], cells: Sequence[Sequence[str]], numeric: Sequence[int]
) -> dict[int, int]:
    """Return the index of the column of units for each column of numbers that has one.

    A column holds units if its header says so, or if it holds nothing but units. The units are
    those of the nearest column of numbers to the left, or else to the right.

    Parameters
    ----------
    headers
        Header of each column.
    cells
        Cells of each column.
    numeric
        Indices of the columns of numbers that have a role.
    """
    pairs: dict[int, int] = {}
    for column, header in enumerate(headers):
        if column in numeric or not _holds_units(header, cells[column]):
            continue
        before = [number for number in numeric if number < column and number not in pairs]
        behind = [number for number in numeric if number > column and number not in pairs]
        if before:
            pairs[max(before)] = column
        elif behind:
            pairs[min(behind)] = column
    return pairs


def _holds_units(header: str, cells: Sequence[str]) -> bool:
    if UNIT_COLUMN.fullmatch(comparable(header).strip("[]() ")):
        return True
    return all(unit_named(cell.strip("[]() ")) in _PLAIN_UNITS for cell in cells)
