"""Adjustment of p-values for multiple testing, and combination of several p-values into one."""

from __future__ import annotations

import numpy as np
from scipy.special import betainc

from ldbb_bayes.results import Array

__all__ = ["holm", "pooled_p_value", "uniformity_p_value"]

# Before p-values are combined, p-values below this number are raised to it, and p-values above one
# minus this number are lowered to one minus this number. The Cauchy quantiles then stay finite.
_LEAST = 1e-12


def holm(p_value: Array) -> Array:
    """Return p-values adjusted by Holm's method (Scand. J. Statist. 6, 65-70, 1979), shape (n,).

    If every test with an adjusted p-value below α is called significant, the probability of one or
    more false alarms among the n tests is at most α. The tests may depend on one another in any
    way.

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


def pooled_p_value(p_values: Array) -> Array:
    """Return one p-value from n p-values, which may depend on one another (Cauchy combination).

    Every p-value p is transformed to a Cauchy variate tan((1/2 − p) π). The result is the
    probability that a Cauchy variate exceeds the mean of these n variates. If the p-values are
    independent, the mean has a Cauchy distribution too. If the p-values depend on one another, the
    upper tail of the mean's distribution is nearly that of a Cauchy distribution (Liu and Xie, J.
    Am. Stat. Assoc. 115, 2020).

    Parameters
    ----------
    p_values
        p-values of the n single tests, shape (..., n). The result has the shape (...).
    """
    clipped = np.clip(p_values, _LEAST, 1.0 - _LEAST)
    mean = np.tan((0.5 - clipped) * np.pi).mean(axis=-1)
    # Each p-value has been transformed to a Cauchy variate. The returned value is the probability
    # that a Cauchy variate exceeds the mean of these variates. The function arctan2 computes this
    # probability accurately even if the mean is large.
    return np.asarray(np.arctan2(1.0, mean) / np.pi)


def uniformity_p_value(p_values: Array) -> Array:
    """Return the p-value of the hypothesis that n values are uniformly distributed from 0 to 1.

    The values may depend on one another. The i-th smallest of n independent uniform values has the
    distribution Beta(i, n + 1 − i). From this distribution, a two-sided p-value is computed for
    each value, and `pooled_p_value` combines the n two-sided p-values into one (Cauchy combination,
    which allows for dependence). This is the test called POT by Tesso and Vehtari (LOO-PIT
    predictive model checking, arXiv:2603.02928, 2026), with one difference: they leave out large
    two-sided p-values before pooling. Here, all n are pooled, because without the large ones the
    test rejects too often for small n. The test detects values that are too small. It also detects
    values that are all too near one, such as the p-values of circles whose predicted uncertainties
    are too large.

    Parameters
    ----------
    p_values
        The n values, shape (..., n). They may be p-values, for example one for each circle, which
        compares the circle with the prediction from all other circles. The result has the shape
        (...).
    """
    count = p_values.shape[-1]
    rank = np.arange(1, count + 1)
    below = betainc(rank, count + 1.0 - rank, np.sort(p_values, axis=-1))
    return pooled_p_value(2.0 * np.minimum(below, 1.0 - below))
