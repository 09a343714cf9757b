"""Cells without a reading: empty cells, and words such as NaN in place of a number."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.reading.numerals import is_missing

__all__ = ["missing_in"]

# Largest share of a column of readings whose cells may be missing. If more are, the column is
# probably not that of the readings.
_LARGEST_SHARE = 0.5


def missing_in(cells: Sequence[str]) -> NDArray[np.bool_]:
    """Return whether each cell of a column of readings states that its number is missing.

    If more than half of the cells do, False is returned for all of them: later code then raises an
    error that names the first of these cells.

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
