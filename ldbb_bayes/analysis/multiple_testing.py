"""Adjustment of p-values for multiple testing."""

from __future__ import annotations

import numpy as np

from ldbb_bayes.results import Array

__all__ = ["holm"]


def holm(p_value: Array) -> Array:
    """Return p-values adjusted by Holm's method (Scand. J. Statist. 6, 65-70, 1979), shape (n,).

    If each test with an adjusted p-value below α is called significant, the probability of any
    false alarm among all n tests is at most α. This holds however the tests depend on one another.

    Parameters
    ----------
    p_value
        p-values of the n single tests, shape (n,).
    """
    order = np.argsort(p_value, kind="stable")
    multiplied = p_value[order] * np.arange(len(p_value), 0, -1)
    adjusted = np.empty(len(p_value))
    adjusted[order] = np.minimum(np.maximum.accumulate(multiplied), 1.0)
    return adjusted
