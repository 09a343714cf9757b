"""Units that stand after the numbers in the cells of a table, as in ``12.5 µm``."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from functools import lru_cache
from typing import NamedTuple

from ldbb_bayes.campaign.text_table import Row
from ldbb_bayes.reading.numerals import KEPT_CELLS, looks_like_number
from ldbb_bayes.reading.sexagesimal import SECONDS_UNIT, columns_in_sexagesimal, seconds_in
from ldbb_bayes.reading.words import scaled_unit, unit_named

__all__ = ["UnitsOfCells", "number_in_cell", "split_units"]

# Regular expression for a number that is followed by a text, with or without a blank between them.
_NUMBER_AND_TEXT = re.compile(r"(?P<number>[+\-−–]?[\d.,]*\d(?:[eE][+\-]?\d+)?)\s*(?P<unit>\D.*)")


# A row of numbers with units belongs to a table if the row above or below it also holds numbers. If
# the sheet has fewer than ``_FEWEST_ROWS`` rows of numbers with units, these neighbouring numbers
# must have units, too.
_FEWEST_ROWS = 3


class _NumberAndUnit(NamedTuple):
    """Number in a cell, as text, and the unit that stands after it."""

    number: str
    # unit after the number in the cell, as this package spells it; empty if the cell has no unit
    unit: str


class UnitsOfCells(NamedTuple):
    """Rows of a sheet after the units were removed from the cells, and the removed units."""

    rows: list[Row]
    #: dict with the units that were removed from the cells of a table because they stood after a
    #: number; each key is the line number and the column index of a cell
    units: Mapping[tuple[int, int], str]


@lru_cache(maxsize=KEPT_CELLS)
def number_in_cell(cell: str, *, is_sexagesimal: bool = False) -> _NumberAndUnit | None:
    """Return the number in a cell, and its unit if there is one.

    Return None if the cell does not hold a number, or if the text after the number is not a known
    unit. An angle such as 12° 30' 15" is returned as 45015 arcsec. ``is_sexagesimal`` states
    whether the header of the column says that angles are in degrees, minutes and seconds.
    """
    seconds = seconds_in(cell, is_named=is_sexagesimal)
    if seconds:
        return _NumberAndUnit(seconds, SECONDS_UNIT)
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
    """Return the rows of a sheet without the units after their numbers, and the removed units.

    Units are removed only from rows of a table. A row of numbers with units has at least two
    numbers, of which at least one is followed by a unit. It may also have cells with only a unit,
    but no other texts. Such a row belongs to a table if the row directly above or below is also a
    row of numbers with units. If the sheet has at least three rows of numbers with units, it is
    enough that the row directly above or below has numbers, even without units. A row that stands
    alone, such as ``Force;36 N``, is left as it is.

    In a row with other texts, an angle in degrees and minutes, such as 12°30', is replaced by a
    number in arcseconds. This is done only if the cell directly above or below also holds such an
    angle.
    """
    sexagesimal = columns_in_sexagesimal(row.cells for row in rows)
    numbers = [_numbers_of(row.cells, sexagesimal) for row in rows]
    is_neighbour = _are_evidence_of_table(rows, numbers)
    changed = list(rows)
    units: dict[tuple[int, int], str] = {}
    for k, row in enumerate(rows):
        has_neighbour_above = k > 0 and is_neighbour[k - 1]
        has_neighbour_below = k + 1 < len(rows) and is_neighbour[k + 1]
        if not numbers[k] or not (has_neighbour_above or has_neighbour_below):
            continue
        cells = list(row.cells)
        for column, entry in numbers[k].items():
            cells[column] = entry.number
            if entry.unit:
                units[row.line, column] = entry.unit
        changed[k] = Row(row.line, cells)
    _split_angles_beside_texts(changed, units)
    return UnitsOfCells(changed, units)


def _split_angles_beside_texts(rows: list[Row], units: dict[tuple[int, int], str]) -> None:
    """Replace angles such as 12°30' by numbers in arcseconds, in rows that also hold texts.

    An angle is replaced only if the row above or below also has an angle in this column. The cells
    are replaced in ``rows``, and their unit is stored in the dict ``units``. Its keys are pairs of
    the line number and the column index of a cell.
    """
    angles = [_angles_in(row) for row in rows]
    if not any(angles):
        return
    for k, row in enumerate(rows):
        neighbours: set[int] = set()
        for angles_beside in (angles[max(k - 1, 0)], angles[min(k + 1, len(rows) - 1)]):
            if angles_beside is not angles[k]:
                neighbours |= angles_beside.keys()
        cells = list(row.cells)
        for column in angles[k].keys() & neighbours:
            cells[column] = angles[k][column]
            units[row.line, column] = SECONDS_UNIT
        rows[k] = Row(row.line, cells)


def _angles_in(row: Row) -> dict[int, str]:
    """Return a dict with the angles of a row that are written in degrees and minutes.

    The keys are the indices of the columns. The angles are converted to arcseconds.
    """
    angles = {}
    for column, cell in enumerate(row.cells):
        seconds = seconds_in(cell)
        if seconds:
            angles[column] = seconds
    return angles


def _are_evidence_of_table(
    rows: Sequence[Row], numbers: Sequence[Mapping[int, _NumberAndUnit]]
) -> list[bool]:
    """Return, for each row, whether it is evidence that the rows next to it belong to a table.

    A row of numbers with units is such evidence. A row of numbers without units is evidence only in
    a sheet with at least three rows of numbers with units. ``numbers`` holds one dict for each row:
    the numbers with their units, or an empty dict for any other row (see `_numbers_of`).
    """
    have_units = [bool(entries) for entries in numbers]
    if sum(have_units) < _FEWEST_ROWS:
        return have_units
    are_evidence = []
    for row, has_units in zip(rows, have_units, strict=True):
        filled = [cell for cell in row.cells if cell]
        holds_numbers = all(number_in_cell(cell) is not None for cell in filled)
        are_evidence.append(has_units or holds_numbers)
    return are_evidence


def _numbers_of(cells: Sequence[str], sexagesimal: Collection[int]) -> dict[int, _NumberAndUnit]:
    """Return a dict with the numbers in a row; its keys are the indices of the columns.

    ``sexagesimal`` are the indices of the columns whose angles are in degrees, minutes and seconds.

    The dict is empty if a filled cell is neither a number nor a unit, if there are fewer than two
    numbers, or if no number has a unit.
    """
    entries = {}
    for column, cell in enumerate(cells):
        if not cell:
            continue
        entry = number_in_cell(cell, is_sexagesimal=column in sexagesimal)
        if entry is not None:
            entries[column] = entry
        elif not scaled_unit(cell):
            return {}
    if len(entries) < 2 or not any(entry.unit for entry in entries.values()):
        return {}
    return entries
