"""Order of candidates some of which are equally good.

A campaign that is symmetric in the two directions of travel gains as much from a circle in one
direction as from the same circle in the other. The two computed values then differ by rounding
errors, which differ between computers. They must not decide which of the two is chosen.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.results import Array

__all__ = ["ascending_order"]


def ascending_order(values: Array, tolerance: float) -> NDArray[np.intp]:
    """Return the indices that sort values, the smallest first.

    Values that are neighbours in this order and differ by at most ``tolerance`` are treated as
    equal; the indices of equal values are in ascending order. Values that are not a number count as
    infinite.
    """
    values = np.where(np.isnan(values), np.inf, values)
    order = np.argsort(values, kind="stable")
    ordered = values[order]
    is_larger = np.zeros(len(values), dtype=bool)
    is_larger[1:] = ordered[1:] > ordered[:-1] + tolerance
    rank = np.cumsum(is_larger)
    return np.asarray(order[np.lexsort((order, rank))])
