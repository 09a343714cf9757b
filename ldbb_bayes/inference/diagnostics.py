"""Diagnostics of random draws, computed with ArviZ: convergence, weights and sensitivity.

ESS is the effective sample size. The Pareto shape k̂ is the shape of the Pareto distribution fitted
to the largest weights; if k̂ is large, averages with these weights cannot be trusted. ArviZ is
imported inside the functions that use it, because ArviZ loads scipy.stats, which takes a long time,
and most commands need no diagnostics.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ldbb_bayes.results import Array

__all__ = [
    "Diagnostics",
    "SmoothedWeights",
    "diagnose",
    "pareto_k",
    "pareto_smooth",
    "power_sensitivity",
]

# ``_LOWER_POWER`` and ``_UPPER_POWER`` are powers near one, to which the prior or the likelihood is
# raised. The change of the posterior between the two powers states how sensitive the posterior is
# to the prior or to the likelihood (Kallioinen et al. 2023). The powers are ArviZ's defaults.
_LOWER_POWER = 0.99
_UPPER_POWER = 1.01
# Probabilities of the two quantiles that represent the tails of a parameter's posterior. The
# effective sample size for the tails is the smaller of those for the two quantiles (Vehtari et al.
# 2021).
_TAILS = (0.05, 0.95)
# Smallest number of importance weights whose tail can be judged. ArviZ fits a Pareto distribution
# to the largest fifth of the weights, and needs at least five weights in this fifth.
_FEWEST_WEIGHTS = 25
# Importance weights count as equal if the range of their logarithms is below this value.
_EQUAL_LOG_RATIOS = float(np.sqrt(np.finfo(float).eps))
# The tail of importance weights can be judged only if their effective sample size is above this
# value.
_FEWEST_EFFECTIVE = 10.0
# Largest Pareto shape k̂ of reliable importance weights, however many draws there are (Vehtari et
# al. 2024).
_LARGEST_GOOD_K = 0.7


class Diagnostics(NamedTuple):
    """Convergence diagnostics of random draws of d parameters."""

    ess_bulk: Array  #: effective sample size for the mean of each of d parameters, shape (d,)
    #: effective sample size for the tails (quantiles at 5 % and 95 %) of each of d parameters,
    #: shape (d,)
    ess_tail: Array
    #: rank-normalised split R-hat of each of d parameters, shape (d,); one if the chains agree
    rhat: Array


def diagnose(chain: Array) -> Diagnostics:
    """Return effective sample sizes and rank-normalised split R-hat of d parameters.

    ``chain`` holds random draws, shape (chains, draws, d). The diagnostics are defined by Vehtari
    et al. 2021. The effective sample size for the tails is the smaller of the effective sample
    sizes for the quantiles at 5 % and at 95 %.
    """
    from arviz_stats.base import array_stats

    axes = {"chain_axis": 0, "draw_axis": 1}
    with np.errstate(invalid="ignore", divide="ignore"):
        return Diagnostics(
            np.asarray(array_stats.ess(chain, method="bulk", **axes)),
            np.asarray(array_stats.ess(chain, method="tail", prob=_TAILS, **axes)),
            np.asarray(array_stats.rhat(chain, method="rank", **axes)),
        )


def power_sensitivity(
    draws: Mapping[str, Array], log_densities: Mapping[str, Array]
) -> dict[str, dict[str, float]]:
    """Return how sensitive the posterior of each parameter is to each factor of the density.

    The factors of the posterior density are, for example, the prior and the likelihood. Each factor
    is raised to a power near one (power-scaling, Kallioinen et al. 2023), which changes the
    posterior of the parameter. The sensitivity is the cumulative Jensen-Shannon distance between
    the posteriors before and after the change, scaled to a doubling of the power. A parameter
    counts as sensitive if its sensitivity is above 0.05. The sensitivity to a factor that is the
    same at all draws is 0.

    ``draws`` is a dict with the posterior draws of each parameter; its keys are the names of the
    parameters. ``log_densities`` is a dict with the logarithm of each factor at these draws; its
    keys are the names of the factors. All arrays have the shape (chains, draws). The result is a
    dict of dicts: the first key is the name of the parameter, the second key the name of the
    factor. The posterior after the change is represented by the same draws with weights, which are
    so nearly equal that they need no smoothing.
    """
    from arviz_stats.base import array_stats

    stacked = np.stack([np.ravel(values) for values in draws.values()])
    sensitivity: dict[str, dict[str, float]] = {name: {} for name in draws}
    for factor, log_density in log_densities.items():
        if np.ptp(log_density) > 0.0:
            by_parameter = array_stats.power_scale_sense(
                stacked,
                _scaling_weights(log_density, _LOWER_POWER, len(stacked)),
                _scaling_weights(log_density, _UPPER_POWER, len(stacked)),
                _LOWER_POWER,
                _UPPER_POWER,
                chain_axis=None,
            )
        else:
            by_parameter = np.zeros(len(stacked))
        for name, value in zip(draws, by_parameter, strict=True):
            sensitivity[name][factor] = float(value)
    return sensitivity


def _scaling_weights(log_density: Array, power: float, parameters: int) -> Array:
    """Return weights with which posterior draws represent a changed posterior.

    The posterior density is a product of factors such as prior and likelihood. In the changed
    posterior, one factor is raised to ``power``. ``log_density``, shape (chains, draws), is the
    logarithm of this factor at the draws. The result has one column for each draw and one row for
    each of ``parameters`` parameters; all rows are equal, because the weights are the same for all
    parameters.
    """
    log_weight = (power - 1.0) * (log_density - log_density.mean())
    return np.broadcast_to(np.exp(log_weight).ravel(), (parameters, log_weight.size))


class SmoothedWeights(NamedTuple):
    """Importance weights of n draws; the largest weights are smoothed by a Pareto distribution.

    The shape k̂ of this distribution shows whether averages computed with the weights can be
    trusted.
    """

    #: smoothed importance weights of n random draws, shape (n,). The weights sum to one.
    weights: Array
    #: shape k̂ of the Pareto distribution fitted to the largest importance weights
    pareto_k: float
    #: largest Pareto shape k̂ with which the importance weights of n random draws can be trusted;
    #: this limit depends on n
    largest_pareto_k: float


def pareto_smooth(log_ratio: Array) -> SmoothedWeights:
    """Return Pareto-smoothed importance weights (Vehtari et al. 2024).

    ``log_ratio``, shape (n,), is the log importance weight of n independent draws, up to a
    constant: ln(target density / density from which the draws come). k̂ is the shape of the Pareto
    distribution fitted to the largest weights. It is infinite if the tail of the weights cannot be
    judged, for example if their effective sample size is 10 or less. It is −inf if all weights are
    equal.
    """
    good_k = min(_LARGEST_GOOD_K, 1.0 - 1.0 / float(np.log10(len(log_ratio))))
    if np.ptp(log_ratio) < _EQUAL_LOG_RATIOS:
        return SmoothedWeights(np.full(len(log_ratio), 1.0 / len(log_ratio)), -np.inf, good_k)
    log_weight = log_ratio
    k = np.inf
    try:
        smoothed, shape = _smooth_tail(log_ratio)
    # ArviZ fits a Pareto distribution to the largest importance weights, and raises a ValueError if
    # there are too few of these weights or if all of them are equal.
    except ValueError:
        pass
    else:
        if not np.isnan(smoothed).any():
            log_weight = smoothed
            k = shape
    weights = np.exp(log_weight - np.max(log_weight))
    weights /= weights.sum()
    effective = 1.0 / np.sum(weights**2)
    if effective <= _FEWEST_EFFECTIVE or not np.isfinite(k):
        k = np.inf
    return SmoothedWeights(weights, k, good_k)


def pareto_k(log_weight: Array) -> float:
    """Return the shape k̂ of the Pareto distribution fitted to the largest of n importance weights.

    ``log_weight``, shape (n,), holds the logarithms of the weights. k̂ is −inf if the largest
    weights are equal. k̂ is infinite if there are too few weights to judge, or if the fit fails.
    """
    try:
        shape = _smooth_tail(log_weight)[1]
    # ArviZ fits a Pareto distribution to the largest importance weights, and raises a ValueError if
    # there are too few of these weights or if all of them are equal.
    except ValueError:
        if len(log_weight) < _FEWEST_WEIGHTS:
            return np.inf
        return -np.inf
    if np.isnan(shape):
        return np.inf
    return shape


def _smooth_tail(log_weight: Array) -> tuple[Array, float]:
    """Return log importance weights after smoothing the largest weights, and the Pareto shape k̂.

    A Pareto distribution with the shape k̂ is fitted to the largest weights. ``log_weight`` and the
    smoothed log weights have the shape (n,), for n draws. If the fit fails, k̂ is NaN. ArviZ raises
    a ValueError if the largest weights are too few or all equal.
    """
    from arviz_stats.base import array_stats

    with np.errstate(all="ignore"), warnings.catch_warnings(action="ignore"):
        smoothed, shape = array_stats.psislw(-log_weight)
    return smoothed, float(shape)
