"""Pareto distribution of the largest importance weights, and weights smoothed with it.

An importance weight is the ratio of the density that is wanted to the density from which a draw was
made. If a few weights are much larger than all others, averages with these weights cannot be
trusted. A generalised Pareto distribution is therefore fitted to the largest weights. Its shape k̂
states how heavy their tail is; moments of the weights of order 1/k̂ and above do not exist. To
smooth the weights, the largest ones are replaced by quantiles of the fitted distribution (Vehtari,
Simpson, Gelman, Yao and Gabry, Pareto smoothed importance sampling, 2024). The fit is that of Zhang
and Stephens (Technometrics 51 (2009) 316), with a weak prior for the shape.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from ldbb_bayes.results import Array

__all__ = ["SmoothedTail", "smooth_tail"]

# A tail has three times the square root of the number of draws, or a fifth of the draws if there
# are at most ``_FEW_DRAWS``; for 225 draws, the two numbers agree. No tail is fitted to fewer than
# ``_SHORTEST_TAIL`` draws: the lower quartile of fewer is the smallest of them.
_FEW_DRAWS = 225
_SHORTEST_TAIL = 6
# The fit averages over values of the parameter b of the generalised Pareto distribution. There are
# ``_FEWEST_VALUES`` of them, plus the square root of the number of draws in the tail. They are
# scaled by this multiple of the lower quartile of the tail.
_FEWEST_VALUES = 30
_QUARTILES = 3.0
# Values of b with smaller weights than this are left out of the average.
_LEAST_WEIGHT = 10.0 * np.finfo(float).eps
# The shape k̂ is drawn towards 0.5, as if this number of further draws had this shape.
_PRIOR_DRAWS = 10
_PRIOR_SHAPE = 0.5


class SmoothedTail(NamedTuple):
    """Logarithms of importance weights, the largest of them smoothed, and the Pareto shape k̂."""

    log_weight: Array  #: smoothed log importance weights, except for a common constant, shape (n,)
    #: shape k̂ of the Pareto distribution fitted to the largest importance weights. It is −inf if
    #: these weights are equal, and inf if there are too few of them or if the fit fails. In these
    #: cases, the weights are not smoothed.
    shape: float


def smooth_tail(log_weight: Array) -> SmoothedTail:
    """Return log importance weights after smoothing the largest weights, and the Pareto shape k̂.

    ``log_weight``, shape (n,), holds the logarithms of the weights of n draws.
    """
    n = len(log_weight)
    size = int(3.0 * np.sqrt(n)) if n > _FEW_DRAWS else n // 5
    if size < _SHORTEST_TAIL:
        return SmoothedTail(log_weight, np.inf)
    # Weights may be zero, infinite or not a number. The fit then fails, and says so by its shape.
    with np.errstate(all="ignore"):
        smoothed = log_weight - np.max(log_weight)
        order = np.argsort(smoothed)
        tail = smoothed[order[-size:]]
        if np.ptp(tail) < np.finfo(float).tiny:
            return SmoothedTail(log_weight, -np.inf)
        cutoff = np.exp(smoothed[order[-size - 1]])
        shape, scale = _fit_pareto(np.exp(tail) - cutoff)
        probability = (np.arange(size) + 0.5) / size
        quantile = np.log(cutoff + _pareto_quantile(probability, shape, scale))
    if not np.isfinite(shape) or np.isnan(quantile).any():
        return SmoothedTail(log_weight, np.inf)
    smoothed[order[-size:]] = np.minimum(quantile, tail.max())
    return SmoothedTail(smoothed, shape)


def _fit_pareto(excess: Array) -> tuple[float, float]:
    """Return shape and scale of a generalised Pareto distribution fitted to n ascending numbers.

    The distribution starts at zero. Its density is (1 + k x/σ)^(−1/k − 1) / σ for the shape k and
    the scale σ. For given b = −k/σ, the likelihood is largest at k = mean ln(1 − b x). b is the
    mean of its posterior with this k and a prior that follows from the lower quartile of the
    numbers. ``excess``, shape (n,), holds the numbers in ascending order. Shape and scale are NaN
    if a quarter of the numbers are equal to the smallest one: they are not from a Pareto
    distribution.
    """
    n = len(excess)
    lower_quartile = excess[int(n / 4 + 0.5) - 1]
    if lower_quartile <= excess[0]:
        return np.nan, np.nan
    values = _FEWEST_VALUES + int(np.sqrt(n))
    b = 1.0 - np.sqrt(values / (np.arange(values) + 0.5))
    b = b / (_QUARTILES * lower_quartile) + 1.0 / excess[-1]
    shape = np.log1p(-b[:, None] * excess).mean(axis=1)
    log_likelihood = n * (np.log(-b / shape) - shape - 1.0)
    weight = np.exp(log_likelihood - logsumexp(log_likelihood))
    weight = np.where(weight < _LEAST_WEIGHT, 0.0, weight)
    mean_b = float(weight @ b / weight.sum())
    fitted = float(np.log1p(-mean_b * excess).mean())
    shrunk = (n * fitted + _PRIOR_DRAWS * _PRIOR_SHAPE) / (n + _PRIOR_DRAWS)
    return shrunk, -fitted / mean_b


def _pareto_quantile(probability: Array, shape: float, scale: float) -> Array:
    """Return quantiles of a generalised Pareto distribution that starts at zero.

    ``probability`` holds the probabilities, and the quantiles have the same shape. They are NaN if
    the ``scale`` of the distribution is not positive.
    """
    if scale <= 0.0:
        return np.full_like(probability, np.nan)
    log_excess = -np.log1p(-probability)
    if shape == 0.0:
        return np.asarray(scale * log_excess)
    return np.asarray(scale * np.expm1(shape * log_excess) / shape)
