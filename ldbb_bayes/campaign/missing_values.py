"""Missing values in arrays of angles and readings: masked entries of NumPy, and NA of pandas."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["missing_entries", "without_entries"]


def missing_entries(column: Any) -> NDArray[np.bool_]:
    """Return a mask of the n entries of a column, shape (n,), that is true for missing entries.

    An entry is missing if it is masked in a masked array of NumPy, or if it is pandas' NA. A NaN is
    an invalid number and does not count as missing. The result is empty for a column that is not
    one-dimensional.
    """
    if isinstance(column, np.ma.MaskedArray):
        mask: NDArray[np.bool_] = np.ma.getmaskarray(column)
        return mask if mask.ndim == 1 else np.zeros(0, dtype=bool)
    dtype = getattr(column, "dtype", None)
    if hasattr(column, "isna") and not isinstance(dtype, np.dtype):
        return np.asarray(column.isna(), dtype=bool)
    if isinstance(dtype, np.dtype) and dtype.kind != "O":
        return np.zeros(len(column) if column.ndim == 1 else 0, dtype=bool)
    try:
        entries = list(column)
    except TypeError:
        return np.zeros(0, dtype=bool)
    return np.array([_is_missing(entry) for entry in entries], dtype=bool)


def _is_missing(entry: Any) -> bool:
    """Return whether one angle or reading is masked by NumPy, or is pandas' NA."""
    return entry is np.ma.masked or type(entry).__name__ == "NAType"


def without_entries(column: Any, missing: NDArray[np.bool_]) -> list[Any]:
    """Return the angles or the readings of a test without the missing ones.

    ``column`` holds the n values, and ``missing``, shape (n,), is true for the values to leave out.
    """
    if isinstance(column, np.ma.MaskedArray):
        column = column.data
    return [entry for entry, is_missing in zip(column, missing, strict=True) if not is_missing]
