"""Columns of a foreign table that hold the unit of a number beside them, row by row."""

from __future__ import annotations

from collections.abc import Sequence

from ldbb_bayes.reading.unit_lines import COUNT, UNIT_COLUMN, has_factor
from ldbb_bayes.reading.words import comparable, scaled_unit

__all__ = ["unit_columns"]

# Units of length that are hardly words of anything else; a column of them needs no header.
_PLAIN_UNITS = frozenset(
    {"um", "mm", "cm", "nm", "inch", "mil", "uinch", "deg", "rad", "gon", "kN"}
)
# Largest factor of the unit of counts in a column without a header.
_LARGEST_FACTOR = 10.0


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
    return all(_is_plain_unit(cell.strip("[]() "), is_nameless=not header) for cell in cells)


def _is_plain_unit(text: str, is_nameless: bool) -> bool:
    """Return whether a cell holds nothing but a unit; without a header, also one of counts.

    Without a header a unit with a factor in front, as in x 10 µm, counts too. The unit of counts,
    such as 10 nm, has a factor of at most 10: 100 mm is a length.
    """
    if is_nameless and (COUNT.fullmatch(text) or has_factor(text)):
        return True
    factor, _, name = scaled_unit(text).rpartition(" ")
    if name not in _PLAIN_UNITS:
        return False
    return not factor or (is_nameless and float(factor) <= _LARGEST_FACTOR)
