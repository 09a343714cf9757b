"""Limits for the empirical distribution of ranks, to test whether the ranks are uniform.

A rank is the number of posterior draws below the true value in a simulated campaign. The method is
that of Säilynoja, Bürkner and Vehtari, Graphical test for discrete uniformity, Statistics and
Computing 32:32 (2022). The limits form a band. For each k, the band has one interval for the number
of ranks that are at most k. If the ranks are uniform, this number has a binomial distribution, and
lies inside the interval with nearly the same probability for every k. The intervals are made just
wide enough that the empirical distribution of uniform ranks stays inside all intervals with the
required probability, which is computed exactly.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.special import bdtr, bdtrc
from scipy.stats import binom

from ldbb_bayes.results import Array

__all__ = ["ecdf", "simultaneous_band"]

# Number of bisections in the search for the band that contains the empirical distribution of ranks.
# For every number k, the band has a lower and an upper limit for how many ranks are at most k. All
# limits follow from one probability: that of being outside the limits at a single k. The search
# finds the largest value of this probability for which the limits are met at all k together with
# the required probability. With this number of bisections, the error of the value is below 1e-12.
_BISECTIONS = 40


def ecdf(ranks: Array, draws: int) -> Array:
    """Return the empirical distribution of ranks, shape (draws,).

    ``ranks`` are whole numbers from 0 to ``draws``, such as the numbers of posterior draws below
    true values. The result is the share of ranks that are at most k, for k = 0 … draws − 1.
    """
    counts = np.bincount(ranks, minlength=draws + 1)
    return np.asarray(np.cumsum(counts)[:-1] / len(ranks))


@cache
def simultaneous_band(replicates: int, draws: int, prob: float) -> tuple[Array, Array]:
    """Return a band for the empirical distribution of ranks.

    If the ranks are uniform in 0 … draws, the whole empirical distribution `ecdf` stays inside the
    band with probability ``prob``, or with a slightly larger probability. The probability cannot
    always be met exactly, because the limits are whole numbers of ranks.

    Parameters
    ----------
    replicates
        Number of ranks.
    draws
        Largest rank.
    prob
        Probability that the whole empirical distribution stays inside the band.

    Returns
    -------
    lower, upper : Array
        Limits of the share of ranks that are at most k, for k = 0 … draws − 1, shape (draws,) each.
    """
    level = np.arange(1, draws + 1) / (draws + 1)
    counts = np.arange(replicates + 1.0)[:, None]
    # For each k, the number of uniformly distributed ranks that are at most k has a binomial
    # distribution. ``at_most`` holds the probability that this number is at most n, and
    # ``more_than`` the probability that it is more than n. Both matrices have one row for each n
    # from 0 to ``replicates``, and one column for each k.
    at_most = bdtr(counts, replicates, level)
    more_than = bdtrc(counts, replicates, level)

    def pointwise_intervals(excluded: float) -> tuple[Array, Array]:
        """Return lower and upper limits of the number of ranks that are at most k, for every k.

        The two arrays hold the limits for k = 0 … draws − 1, shape (draws,) each. If the ranks are
        uniform, the number of ranks that are at most k has a binomial distribution. For each k, the
        probability that this number is outside its limits is at most ``excluded``.
        """
        lower = (at_most < 0.5 * excluded).sum(axis=0)
        upper = (more_than > 0.5 * excluded).sum(axis=0)
        return lower, upper

    holding = 0.0
    excessive = 1.0 - prob
    for _ in range(_BISECTIONS):
        middle = 0.5 * (holding + excessive)
        lower, upper = pointwise_intervals(middle)
        if _simultaneous_coverage(replicates, level, lower, upper) >= prob:
            holding = middle
        else:
            excessive = middle
    lower, upper = pointwise_intervals(holding)
    return lower / replicates, upper / replicates


def _simultaneous_coverage(replicates: int, level: Array, lower: Array, upper: Array) -> float:
    """Return the probability that, at every level, the number of ranks below it is within limits.

    There are ``replicates`` ranks, scaled to 0 … 1 and uniformly distributed. ``level`` holds
    increasing values between 0 and 1. ``lower`` and ``upper`` hold, for each level, the limits of
    the number of ranks below this level. From level to level, the numbers of ranks form a Markov
    chain with binomial transition probabilities.
    """
    previous_level = 0.0
    previous_counts = np.zeros(1, dtype=int)
    probability = np.ones(1)
    for current_level, least, largest in zip(level, lower, upper, strict=True):
        counts = np.arange(least, largest + 1)
        step_probability = (current_level - previous_level) / (1.0 - previous_level)
        transition = binom.pmf(
            counts - previous_counts[:, None],
            replicates - previous_counts[:, None],
            step_probability,
        )
        previous_level = current_level
        previous_counts = counts
        probability = probability @ transition
    return float(probability.sum())
