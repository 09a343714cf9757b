"""What the cells of one row are: the header of a table, a rule below it, or numbers."""

from __future__ import annotations

import re
from collections.abc import Sequence

from ldbb_bayes.reading.header_units import unit_of
from ldbb_bayes.reading.numerals import is_missing, looks_like_number
from ldbb_bayes.reading.role_words import has_role
from ldbb_bayes.reading.words import ROLES

__all__ = ["RULE", "count_numbers", "heads_loads", "is_rule", "names_any_role", "names_columns"]

# Regular expression for a text that is the number of a test, such as "T1" or "T2 new". Without this
# check, such a text would be read as the header "t" of a column of times.
_NUMBER_OF_TEST = re.compile(r"[^\W\d_]{1,3}[-_]?\d+(?:[^\W\d_]|[\s_-]+[^\W\d_].*)?")
# Regular expression for a cell of dashes or similar signs that underlines a header.
RULE = re.compile(r"[-=+_|: ]*")


def names_any_role(cell: str) -> bool:
    """Return whether a cell is a header that names any role, such as angle, reading or time."""
    name = unit_of(cell).name
    return any(has_role(name, role) for role in ROLES)


def names_columns(cells: Sequence[str]) -> bool:
    """Return whether a row of cells is the header of a table.

    A header has at least two cells with words, and no number. A row with numbers is also a header
    if its words name at least two of the roles angle, reading and time.
    """
    words = [cell for cell in cells if _is_word(cell)]
    if len(words) < 2:
        return False
    if count_numbers(cells) == 0:
        return True
    names = [unit_of(word).name for word in words]
    n_roles = 0
    for role in ("angle", "reading", "time"):
        n_roles += any(has_role(name, role) for name in names)
    return n_roles >= 2


def heads_loads(cells: Sequence[str]) -> bool:
    """Return whether a row is a header in which numbers stand above the columns of readings.

    An example is ``Angle,100,300,600``, where the numbers are loads. A row whose first cell is the
    number of a test, such as ``T1``, is not such a header.
    """
    if _NUMBER_OF_TEST.fullmatch(cells[0]):
        return False
    name = unit_of(cells[0]).name
    names_abscissa = has_role(name, "angle") or has_role(name, "time")
    has_several = len(cells) > 2
    return names_abscissa and has_several and all(looks_like_number(cell) for cell in cells[1:])


def _is_word(cell: str) -> bool:
    """Return whether a cell holds words: it is not empty, not a number and not a line of dashes.

    A text in place of a missing number, such as NaN, does not count as words.
    """
    if not cell or looks_like_number(cell) or is_missing(cell):
        return False
    return RULE.fullmatch(cell) is None


def is_rule(cells: Sequence[str]) -> bool:
    """Return whether a row consists of dashes or similar signs that underline a header."""
    return all(RULE.fullmatch(cell) for cell in cells)


def count_numbers(cells: Sequence[str]) -> int:
    """Return how many cells of a row are numbers."""
    return sum(looks_like_number(cell) for cell in cells)
