"""Columns of units in a table: each cell is the unit of a number in the same row."""

from __future__ import annotations

import re
from collections.abc import Sequence

from ldbb_bayes.reading.column_roles import names_circle
from ldbb_bayes.reading.header_units import unit_of
from ldbb_bayes.reading.role_words import has_role
from ldbb_bayes.reading.unit_lines import (
    COUNT,
    UNIT_COLUMN,
    is_unit_with_unread_factor,
    partner_of_units,
)
from ldbb_bayes.reading.unit_rows import LARGEST_FACTOR, UNITS_OF_FEED
from ldbb_bayes.reading.words import ROLES, UNITS, WORDS, comparable, scaled_unit, unit_named

__all__ = ["unit_columns"]

# Units, such as um, that are hardly used as other words. If all cells of a column are such units,
# it is taken as a column of units, whatever its header is.
_PLAIN_UNITS = frozenset(
    {"um", "mm", "cm", "nm", "inch", "mil", "uinch", "deg", "rad", "gon", "kN"}
)
# Regular expression for the header of a column of feeds.
_FEED = re.compile(WORDS["numbers"]["feed_mm_per_min"]["words"], re.IGNORECASE)


def unit_columns(
    headers: Sequence[str], cells: Sequence[Sequence[str]], numeric: Sequence[int]
) -> dict[int, int]:
    """Return a dict that assigns to columns of numbers the columns that hold their units.

    The keys are the indices of the columns of numbers, and the values are the indices of the
    columns of units. Columns of numbers without units are left out. A column holds units if the
    header says so, or if every cell is a unit. Its header may name the column of numbers, as
    ``theta_unit`` does. If it names none, the units belong to the nearest column of numbers on the
    left that has no units yet, or else to the nearest one on the right.

    Parameters
    ----------
    headers
        Header of each column.
    cells
        Cells of each column.
    numeric
        Indices of the columns of numbers that have a role, such as angle.
    """
    pairs = _pairs_by_name(headers, numeric)
    for column, header in enumerate(headers):
        if column in numeric or partner_of_units(header) or not _holds_units(header, cells[column]):
            continue
        if column and _holds_radius_or_feed(
            headers[column - 1], cells[column], column - 1, numeric
        ):
            pairs.setdefault(column - 1, column)
            continue
        to_the_left = [number for number in numeric if number < column and number not in pairs]
        to_the_right = [number for number in numeric if number > column and number not in pairs]
        if to_the_left:
            pairs[max(to_the_left)] = column
        elif to_the_right:
            pairs[min(to_the_right)] = column
    return pairs


def _holds_radius_or_feed(
    header: str, units: Sequence[str], column: int, numeric: Sequence[int]
) -> bool:
    """Return whether a column without a role is named after the radius or the feed.

    ``header`` is its header and ``column`` its index; ``units`` are the cells of the column of
    units behind it, which must be units of the same kind. ``numeric`` are the columns with a role.
    """
    if column in numeric or unit_of(header).unit:
        return False
    if _FEED.fullmatch(comparable(header)):
        return all(unit.strip("[]() ") in UNITS_OF_FEED for unit in units)
    is_circle = names_circle(unit_of(header).name)
    return is_circle and all(unit_named(unit.strip("[]() ")) in UNITS["reading"] for unit in units)


def _pairs_by_name(headers: Sequence[str], numeric: Sequence[int]) -> dict[int, int]:
    """Return a dict with those columns of units whose headers say to which numbers they belong.

    The keys are the indices of the columns of numbers, and the values are the indices of the
    columns of units. For example, the column ``theta_unit`` holds the units of the column
    ``theta``. If no column of numbers has the name that the header states, the units belong to the
    columns of the same quantity: the units in the column ``angle unit`` belong to the column of
    angles ``phi``. ``numeric`` are the indices of the columns of numbers, and ``headers`` are all
    headers.
    """
    pairs: dict[int, int] = {}
    for column, header in enumerate(headers):
        partner = partner_of_units(header)
        if not partner or column in numeric:
            continue
        of_name = [number for number in numeric if _comparable_name(headers[number]) == partner]
        of_role = [number for number in numeric if _have_common_role(headers[number], partner)]
        for number in of_name or of_role:
            pairs.setdefault(number, column)
    return pairs


def _comparable_name(header: str) -> str:
    """Return a header without its unit, in a form in which names can be compared."""
    return comparable(unit_of(header).name)


def _have_common_role(header: str, partner: str) -> bool:
    """Return whether a header and a name mean the same quantity, such as the angle.

    ``header`` may also state a unit. ``partner`` is the name.
    """
    name = _comparable_name(header)
    return any(has_role(name, role) and has_role(partner, role) for role in ROLES)


def _holds_units(header: str, cells: Sequence[str]) -> bool:
    """Return whether a column holds units: its header says so, or every cell is a unit."""
    if UNIT_COLUMN.fullmatch(comparable(header).strip("[]() ")):
        return True
    return all(_is_plain_unit(cell.strip("[]() "), is_nameless=not header) for cell in cells)


def _is_plain_unit(text: str, is_nameless: bool) -> bool:
    """Return whether the text of a cell is nothing but a unit.

    ``is_nameless`` is true if the column has no header. Three further kinds of texts are then taken
    as units: a word for counts (digital steps of an instrument), a unit with the factor sign x in
    front, as in x 10 µm, and a unit with a factor of at most 10, as in 10 nm. A text with a larger
    number, such as 100 mm, is a length and not a unit.
    """
    if is_nameless and (COUNT.fullmatch(text) or is_unit_with_unread_factor(text)):
        return True
    factor, _, name = scaled_unit(text).rpartition(" ")
    if name not in _PLAIN_UNITS:
        return False
    return not factor or (is_nameless and float(factor) <= LARGEST_FACTOR)
