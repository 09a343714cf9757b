"""TODO: say what this module is."""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.special import bdtr, bdtrc

from ldbb_bayes.results import Array

__all__ = ["ecdf", "simultaneous_band"]


_BISECTIONS = 40


def ecdf(ranks: Array, draws: int) -> Array:
    """Empirical distribution of ranks in 0 … draws at (k + 1) / (draws + 1), k = 0 … draws − 1,
    shape (draws,)."""
    counts = np.bincount(ranks, minlength=draws + 1)
    return np.asarray(np.cumsum(counts)[:-1] / len(ranks))


@cache
def simultaneous_band(replicates: int, draws: int, prob: float) -> tuple[Array, Array]:
    """Lower and upper ends of the band, each of shape (draws,), for the `ecdf` of so many ranks,
    uniform in 0 … draws: with probability ``prob`` it stays inside as a whole; as near above that
    as whole counts allow."""
    level = np.arange(1, draws + 1) / (draws + 1)
    below, above = (
        tail(np.arange(replicates + 1.0)[:, None], replicates, level) for tail in (bdtr, bdtrc)
    )

    def pointwise(tail: float) -> tuple[Array, Array]:
        """Binomial intervals that leave out less than ``tail`` in all."""
        return (below < 0.5 * tail).sum(axis=0), (above > 0.5 * tail).sum(axis=0)

    low = 0.0
    high = 1.0 - prob
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (
            (middle, high)
            if _coverage(replicates, level, *pointwise(middle)) >= prob
            else (low, middle)
        )
    lower, upper = pointwise(low)
    return lower / replicates, upper / replicates


def _coverage(replicates: int, level: Array, lower: Array, upper: Array) -> float:
    """P(lower ≤ counts ≤ upper at every level): from each level to the next a binomial share of the
    numbers not yet passed."""
    from scipy.stats import binom  # figures start without it

    before = 0.0
    origin = np.zeros(1, dtype=int)
    probability = np.ones(1)
    for point, least, most in zip(level, lower, upper, strict=True):
        now = np.arange(least, most + 1)
        passed = binom.pmf(
            now - origin[:, None], replicates - origin[:, None], (point - before) / (1.0 - before)
        )
        before = point
        origin = now
        probability = probability @ passed
    return float(probability.sum())
