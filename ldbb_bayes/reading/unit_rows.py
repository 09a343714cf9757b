"""Rows of units, such as ``deg;um``, below the header of a table."""

from __future__ import annotations

import re
from collections.abc import Sequence

from ldbb_bayes.reading.names import load_in_name
from ldbb_bayes.reading.words import WORDS, comparable, scaled_unit

__all__ = [
    "COMMENT_SIGN",
    "LARGEST_FACTOR",
    "UNITS_OF_FEED",
    "joined_factors",
    "row_of_units",
    "without_comment_sign",
]

# Regular expression for a sign, such as #, with which a line of a file begins if it is a comment.
COMMENT_SIGN = re.compile(r"^\s*(?:#|%|//)(?=\s|$)")
# Dashes that may stand in a row of units in place of a unit, if a column has none.
_DASHES = ("-", "–", "—")
# Regular expression for a cell that is a text in brackets, such as a unit.
_BRACKETED = re.compile(r"[\[({].*[\])}]")
# Regular expression for a factor, such as 0.1 in "0.1 um", in a row of units whose cells are
# separated by blanks.
_FACTOR = re.compile(r"[\[({]?(?:1/)?\d+(?:[.,]\d+)?[x×*]?")
# Units of feed, which may stand beside units of angle, length and time in a row of units.
UNITS_OF_FEED = frozenset(WORDS["numbers"]["feed_mm_per_min"]["units"])
# Largest number that may precede a unit in a row of units, such as 10 in "10 nm". After a larger
# number, as in "100 mm", the cell is a length and not a unit.
LARGEST_FACTOR = 10.0
# Largest number of characters of an unknown unit in a row of units. The second number applies to a
# row with at least ``_MANY_UNITS`` known units, the first number to any other row.
_LONGEST_UNIT = 4
_LONGEST_UNIT_AMONG_KNOWN = 8
_MANY_UNITS = 3


def row_of_units(cells: Sequence[str], separator: str) -> list[str]:
    """Return the units in a row below a header; an empty list if the row is not a row of units.

    An unknown unit is returned as it is written. A dash in place of a unit is returned as an empty
    text. A row with a load, such as 36 N, is not a row of units. ``separator`` is the separator of
    the cells. If it is a blank, a factor such as 0.1 is joined to the unit that follows it.
    """
    if separator == " ":
        cells = joined_factors(without_comment_sign(cells))
    units = []
    for cell in cells:
        text = _text_of_unit(cell)
        is_dash = text in _DASHES
        units.append("" if is_dash else _unit_in_row(text) or text)
    holds_load = any(load_in_name([cell]) is not None for cell in cells)
    if holds_load or not _holds_only_units(cells):
        return []
    return units


def without_comment_sign(cells: Sequence[str]) -> list[str]:
    """Return the cells of a row without the sign, such as #, that marks the row as a comment."""
    if cells and COMMENT_SIGN.fullmatch(cells[0]):
        return list(cells[1:])
    return list(cells)


def joined_factors(words: Sequence[str]) -> list[str]:
    """Join each factor in a row of units to the unit after it: "10" and "nm" become "10 nm"."""
    joined: list[str] = []
    for word in words:
        if joined and _FACTOR.fullmatch(joined[-1]) and not _FACTOR.fullmatch(word):
            joined[-1] += f" {word}"
        else:
            joined.append(word)
    return joined


def _text_of_unit(cell: str) -> str:
    """Remove brackets and comment signs from the text of a cell in a row of units."""
    return cell.lstrip("#%").strip("[](){} ")


def _unit_in_row(text: str) -> str:
    """Return the known unit in a cell of a row of units, with its factor; empty if there is none.

    A text with a large number, such as 100 mm, is a length, not a unit.
    """
    unit = scaled_unit(text)
    factor, _, _ = unit.rpartition(" ")
    if factor and float(factor) > LARGEST_FACTOR:
        return ""
    return unit


def _is_known(text: str) -> bool:
    """Return whether a text is a known unit of angle, length, time or load, or of the feed."""
    return bool(_unit_in_row(text)) or text in UNITS_OF_FEED


def _holds_only_units(cells: Sequence[str]) -> bool:
    """Return whether a row of cells is a row of units.

    At least two cells must be known units or texts in brackets, and at least one of these cells
    must be a known unit. A single known unit is enough if no other cell is filled, or if another
    cell is the German word Grad (degree). All other filled cells must have at most four characters;
    in a row with at least three known units, they may have eight.
    """
    n_known = 0
    n_bracketed = 0
    uncertain = []
    for cell in cells:
        if _is_known(_text_of_unit(cell)):
            n_known += 1
        elif _BRACKETED.fullmatch(cell):
            n_bracketed += 1
        elif cell and cell not in _DASHES:
            uncertain.append(cell)
    n_certain = n_known + n_bracketed
    n_needed = min(2, n_certain + len(uncertain))
    if "grad" in [comparable(cell) for cell in uncertain]:  # Grad is the German word for degree
        n_needed = min(1, n_needed)
    if n_known == 0 or n_certain < n_needed:
        return False
    longest = _LONGEST_UNIT_AMONG_KNOWN if n_known >= _MANY_UNITS else _LONGEST_UNIT
    return all(len(cell) <= longest for cell in uncertain)
