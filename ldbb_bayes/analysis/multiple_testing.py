"""Adjustment of p-values for multiple testing."""

from __future__ import annotations

import numpy as np

from ldbb_bayes.results import Array

__all__ = ["holm"]


def holm(p_value: Array) -> Array:
    """p-values that hold the family-wise error whatever the dependence (Holm 1979)."""
    order = np.argsort(p_value, kind="stable")
    stepped = np.minimum(
        np.maximum.accumulate(p_value[order] * np.arange(len(p_value), 0, -1)), 1.0
    )
    found = np.empty(len(p_value))
    found[order] = stepped
    return found
