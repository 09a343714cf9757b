"""Cells without a reading: empty cells, and words such as NaN in place of a number."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.reading.numerals import is_missing

__all__ = ["missing_in"]

# Largest fraction of the readings in a column that may be missing. If more are missing, the column
# probably holds something other than readings.
_LARGEST_SHARE = 0.5


def missing_in(cells: Sequence[str]) -> NDArray[np.bool_]:
    """Return, for each cell of a column of readings, whether its reading is missing.

    A reading is missing if its cell is empty or holds a word such as NaN. If more than half of the
    readings are missing, the result is False for all cells; later code then raises an error that
    names the first cell without a reading.

    Parameters
    ----------
    cells
        The n cells of the column, as the file writes them.

    Returns
    -------
    Array of shape (n,).
    """
    missing = np.array([not cell.strip() or is_missing(cell) for cell in cells], dtype=bool)
    if np.count_nonzero(missing) > _LARGEST_SHARE * len(cells):
        return np.zeros(len(cells), dtype=bool)
    return missing
