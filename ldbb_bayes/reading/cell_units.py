"""Units that stand behind the numbers in the cells of a table, as in ``12.5 µm``."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from ldbb_bayes.campaign.text_table import Row
from ldbb_bayes.reading.numerals import looks_like_number
from ldbb_bayes.reading.words import unit_named

__all__ = ["UnitsOfCells", "number_in_cell", "split_units"]

# Pattern of a number with a text behind it, with or without a blank between.
_NUMBER_AND_TEXT = re.compile(r"(?P<number>[+\-−–]?[\d.,]*\d(?:[eE][+\-]?\d+)?)\s*(?P<unit>\D.*)")


# Fewest rows with units for which rows of numbers without units also count as their neighbours.
_FEWEST_ROWS = 3


class _NumberAndUnit(NamedTuple):
    number: str
    unit: str  # unit by the name of this package; empty without a unit


class UnitsOfCells(NamedTuple):
    """Rows of a sheet without the units in its cells, and these units."""

    rows: list[Row]
    units: Mapping[tuple[int, int], str]  #: unit by line number and index of the column


def number_in_cell(cell: str) -> _NumberAndUnit | None:
    """Return the number in a cell, and its unit if there is one; None for other cells."""
    if looks_like_number(cell):
        return _NumberAndUnit(cell, "")
    match = _NUMBER_AND_TEXT.fullmatch(cell)
    if match is None or not looks_like_number(match["number"]):
        return None
    unit = unit_named(match["unit"])
    if not unit:
        return None
    return _NumberAndUnit(match["number"], unit)


def split_units(rows: Sequence[Row]) -> UnitsOfCells:
    """Return the rows of a sheet with the units in cells of numbers taken out.

    A row is changed only if it consists of two or more numbers, at least one with a unit. One of
    the rows next to it must be of this kind too; if three rows or more have units, it is enough
    that it consists of numbers. A row such as ``Force;36 N`` is not changed.
    """
    numbers = [_numbers_of(row.cells) for row in rows]
    is_neighbour = _may_be_neighbours(rows, numbers)
    changed = list(rows)
    units: dict[tuple[int, int], str] = {}
    for k, row in enumerate(rows):
        before = k > 0 and is_neighbour[k - 1]
        behind = k + 1 < len(rows) and is_neighbour[k + 1]
        if not numbers[k] or not (before or behind):
            continue
        cells = list(row.cells)
        for column, entry in numbers[k].items():
            cells[column] = entry.number
            if entry.unit:
                units[row.line, column] = entry.unit
        changed[k] = Row(row.line, cells)
    return UnitsOfCells(changed, units)


def _may_be_neighbours(
    rows: Sequence[Row], numbers: Sequence[Mapping[int, _NumberAndUnit]]
) -> list[bool]:
    """Return for each row whether it shows that the rows beside it belong to a table.

    ``numbers`` are the numbers of each row that has units.
    """
    with_units = [bool(entries) for entries in numbers]
    if sum(with_units) < _FEWEST_ROWS:
        return with_units
    return [all(number_in_cell(cell) for cell in row.cells if cell) for row in rows]


def _numbers_of(cells: Sequence[str]) -> dict[int, _NumberAndUnit]:
    """Return the numbers in a row by column, if all its cells are numbers and one has a unit."""
    entries = {}
    for column, cell in enumerate(cells):
        if not cell:
            continue
        entry = number_in_cell(cell)
        if entry is None:
            return {}
        entries[column] = entry
    if len(entries) < 2 or not any(entry.unit for entry in entries.values()):
        return {}
    return entries
