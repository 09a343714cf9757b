"""Are ranks uniform? The band that the empirical distribution of uniform numbers stays inside, everywhere at once.

Säilynoja, Bürkner and Vehtari, Graphical test for discrete uniformity, Statistics and Computing 32:32 (2022): pointwise binomial
intervals, their level adjusted so that all of them hold together with the probability asked for. That probability is computed
exactly here, count by count along the band.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binom

__all__ = ["ecdf", "simultaneous_band"]

Array = NDArray[Any]
_BISECTIONS = 40


def ecdf(ranks: Array, draws: int) -> Array:
    """Empirical distribution of ranks in 0 … draws at (k + 1) / (draws + 1), k = 0 … draws − 1, shape (draws,)."""
    counts = np.bincount(ranks, minlength=draws + 1)
    return np.asarray(np.cumsum(counts)[:-1] / len(ranks))


@cache
def simultaneous_band(replicates: int, draws: int, prob: float) -> tuple[Array, Array]:
    """Lower and upper ends of the band, each of shape (draws,), for the `ecdf` of so many uniform ranks.

    Parameters
    ----------
    replicates : int
        Number of ranks.
    draws : int
        Largest rank.
    prob : float
        Probability with which the whole empirical distribution stays inside; as near above it as whole counts allow.
    """
    level = np.arange(1, draws + 1) / (draws + 1)
    low, high = 0.0, 1.0 - prob
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        if _coverage(replicates, level, *_counts(replicates, level, middle)) >= prob:
            low = middle
        else:
            high = middle
    lower, upper = _counts(replicates, level, low)
    return lower / replicates, upper / replicates


def _counts(replicates: int, level: Array, tail: float) -> tuple[Array, Array]:
    """Pointwise binomial intervals that leave out less than ``tail`` in all."""
    lower = binom.ppf(0.5 * tail, replicates, level)
    upper = binom.isf(0.5 * tail, replicates, level)
    return np.maximum(lower, 0.0).astype(int), np.minimum(upper, replicates).astype(int)


def _coverage(replicates: int, level: Array, lower: Array, upper: Array) -> float:
    """P(lower ≤ counts ≤ upper at every level): from each level to the next a binomial share of the numbers not yet passed."""
    before, start, probability = 0.0, 0, np.ones(1)
    for point, least, most in zip(level, lower, upper, strict=True):
        now = np.arange(least, most + 1)
        origin = np.arange(start, start + len(probability))
        share = (point - before) / (1.0 - before)
        step = binom.pmf(now[None, :] - origin[:, None], replicates - origin[:, None], share)
        probability = probability @ step
        before, start = point, int(least)
    return float(probability.sum())
