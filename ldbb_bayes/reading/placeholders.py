"""Placeholders: numbers such as -999 that stand in a file in place of a missing number.

An instrument writes a placeholder if it has lost its signal. A placeholder consists of nines, is
the limit of an integer type, or is at least 1e10 in absolute value. It is also far away from all
other numbers of its column.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.reading.numerals import KEPT_CELLS
from ldbb_bayes.results import Array

__all__ = ["placeholders_in"]

# Regular expression for a number of at least three nines, such as -999, 99.99 or -9.999, which may
# stand in place of a missing number.
_NINES = re.compile(r"[+\-−–]?(?=(?:[.,]?9){3})9+(?:[.,]9*0*)?")
# Largest and smallest numbers of integer types, without sign, such as 32767 and 32768 for signed
# 16-bit integers. A number with these digits may be a placeholder, even if a decimal mark stands
# between the digits.
_LIMITS_OF_INTEGERS = {
    "32767",
    "32768",
    "65535",
    "8388607",
    "8388608",
    "16777215",
    "2147483647",
    "2147483648",
    "4294967295",
}
# Readings and angles never have an absolute value as large as this number. A larger number is taken
# to stand in place of a missing number if it is far away from the other numbers of its column.
_LARGEST_NUMBER = 1e10
# A placeholder is a number, such as -999, in place of a missing one. Let d be the largest distance
# of the other numbers of its column from their median. A number is taken to be a placeholder only
# if its distance from this median is more than this factor times d.
_FAR = 5.0
# Factor that replaces ``_FAR`` for a number that appears several times in its column. It is smaller
# than ``_FAR``, because such a number is more likely to be a placeholder.
_FAR_IF_REPEATED = 1.5
# A column is searched for placeholders (numbers, such as -999, in place of missing ones) only if at
# least this many of its numbers do not have the form of a placeholder.
_FEWEST_NUMBERS = 3


def placeholders_in(cells: Sequence[str], numbers: Array) -> NDArray[np.bool_]:
    """Return, for each number of a column, whether it stands for a missing number, shape (n,).

    A number stands for a missing number if it meets two conditions. First, it is written as nines,
    such as -999, is the limit of an integer type, such as 32767, or is at least 1e10 in absolute
    value. Second, it is far from the median of the other numbers, which do not meet the first
    condition: more than five times as far as the farthest of them. If the number occurs several
    times, 1.5 times as far suffices. If there are fewer than three other numbers, no number is
    taken to stand for a missing number.

    Parameters
    ----------
    cells
        The n cells of the column, as the file writes them.
    numbers
        The numbers in the cells, shape (n,).
    """
    is_like = np.array([_is_like_placeholder(cell) for cell in cells], dtype=bool)
    is_like |= np.abs(numbers) >= _LARGEST_NUMBER
    other_numbers = numbers[~is_like]
    if not is_like.any() or len(other_numbers) < _FEWEST_NUMBERS:
        return np.zeros(len(numbers), dtype=bool)
    median = float(np.median(other_numbers))
    largest_difference = float(np.abs(other_numbers - median).max())
    n_times = Counter(cells)
    is_repeated = np.array([n_times[cell] > 1 for cell in cells], dtype=bool)
    factors = np.where(is_repeated, _FAR_IF_REPEATED, _FAR)
    return is_like & (np.abs(numbers - median) > factors * largest_difference)


@lru_cache(maxsize=KEPT_CELLS)
def _is_like_placeholder(cell: str) -> bool:
    """Return whether a cell looks like a placeholder: nines, or the limit of an integer type."""
    text = cell.strip()
    if _NINES.fullmatch(text):
        return True
    digits = re.sub(r"[^\d]", "", text).lstrip("0")
    whole = re.split(r"[.,]", text)[0]
    digits_of_whole = re.sub(r"[^\d]", "", whole)
    return digits in _LIMITS_OF_INTEGERS or digits_of_whole in _LIMITS_OF_INTEGERS
