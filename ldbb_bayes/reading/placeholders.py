"""Numbers such as -999 that files write in place of a missing number.

An instrument writes such a placeholder if it has lost its signal. A placeholder consists of nines,
or is the largest number of a type of integer, and is far away from all other numbers of its column.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.results import Array

__all__ = ["placeholders_in"]

# Regular expression for a number of at least three nines, such as -999, 99.99 or -9.999.
_NINES = re.compile(r"[+\-−–]?(?=(?:[.,]?9){3})9+(?:[.,]9*0*)?")
# Digits of the largest and smallest numbers of types of integers, such as 32767 for 16 bits with
# sign, also where a decimal mark stands between the digits.
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
# A number at least as large as this is a placeholder if it is far away: no file holds such readings
# or angles.
_LARGEST_NUMBER = 1e10
# A number is far away if its difference from the median of the other numbers is larger than their
# largest difference from the median, times this factor.
_FAR = 5.0
# The same factor for a number that the column repeats, as a file does with a placeholder.
_FAR_IF_REPEATED = 1.5
# Fewest numbers of a column that are no placeholders.
_FEWEST_NUMBERS = 3


def placeholders_in(cells: Sequence[str], numbers: Array) -> NDArray[np.bool_]:
    """Return whether each number of a column stands for a missing number, shape (n,).

    Parameters
    ----------
    cells
        The n cells of the column, as the file writes them.
    numbers
        The numbers in the cells, shape (n,).
    """
    is_like = np.array([_is_like_placeholder(cell) for cell in cells], dtype=bool)
    is_like |= np.abs(numbers) >= _LARGEST_NUMBER
    others = numbers[~is_like]
    if not is_like.any() or len(others) < _FEWEST_NUMBERS:
        return np.zeros(len(numbers), dtype=bool)
    median = float(np.median(others))
    largest_difference = float(np.abs(others - median).max())
    n_times = Counter(cells)
    is_repeated = np.array([n_times[cell] > 1 for cell in cells], dtype=bool)
    factors = np.where(is_repeated, _FAR_IF_REPEATED, _FAR)
    return is_like & (np.abs(numbers - median) > factors * largest_difference)


def _is_like_placeholder(cell: str) -> bool:
    """Return whether a cell has the form of a placeholder: nines, or the limit of an integer."""
    text = cell.strip()
    if _NINES.fullmatch(text):
        return True
    digits = re.sub(r"[^\d]", "", text).lstrip("0")
    whole = re.split(r"[.,]", text)[0]
    digits_of_whole = re.sub(r"[^\d]", "", whole)
    return digits in _LIMITS_OF_INTEGERS or digits_of_whole in _LIMITS_OF_INTEGERS
