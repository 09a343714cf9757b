"""Convergence, importance weights and sensitivity of draws, computed by ArviZ."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from arviz_stats.base import array_stats

from ldbb_bayes.results import Array

__all__ = [
    "Diagnostics",
    "SmoothedWeights",
    "diagnose",
    "pareto_k",
    "pareto_smooth",
    "power_sensitivity",
]

# Powers to which a factor of the joint density is raised (Kallioinen et al. 2023, ArviZ's default).
_LOWER_POWER = 0.99
_UPPER_POWER = 1.01
# Tail probabilities at which the tail ESS is computed (Vehtari et al. 2021).
_TAILS = (0.05, 0.95)
# ArviZ fits the Pareto tail to a fifth of few draws, and needs five of them.
_FEWEST_WEIGHTS = 25
# Log ratios that spread less are equal.
_EQUAL_LOG_RATIOS = float(np.sqrt(np.finfo(float).eps))
# With fewer effective draws the weights cannot be judged.
_FEWEST_EFFECTIVE = 10.0
# Largest k̂ of reliable weights, however many draws there are (Vehtari et al. 2024).
_LARGEST_GOOD_K = 0.7


class Diagnostics(NamedTuple):
    """Convergence of every parameter, each of shape (d,)."""

    ess_bulk: Array
    ess_tail: Array
    rhat: Array


def diagnose(chain: Array) -> Diagnostics:
    """Return bulk ESS, tail ESS and rank-normalised split R-hat of a chain (chains, draws, d).

    See Vehtari et al. 2021; tail ESS is the smaller of those at 5 % and 95 %.
    """
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
    """Return how much each parameter's posterior changes when a factor of the density is rescaled.

    Each factor of the joint density is raised to a power near one (power-scaling, Kallioinen et al.
    2023); the sensitivity is the cumulative Jensen-Shannon distance by which a power of two would
    move the posterior, above 0.05 a parameter counts as sensitive. Draws and log densities have
    shape (chains, draws). A factor that is constant has sensitivity 0. The weights are so even that
    they need no smoothing.
    """
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
    """Return weights of draws under a density raised to a power, one row a parameter."""
    log_weight = (power - 1.0) * (log_density - log_density.mean())
    return np.broadcast_to(np.exp(log_weight).ravel(), (parameters, log_weight.size))


class SmoothedWeights(NamedTuple):
    """Importance weights, shape (n,), whose largest are smoothed by a Pareto tail."""

    weights: Array
    pareto_k: float  #: shape of the tail
    largest_pareto_k: float  #: above which weights cannot be trusted


def pareto_smooth(log_ratio: Array) -> SmoothedWeights:
    """Return Pareto-smoothed importance weights (Vehtari et al. 2024).

    ``log_ratio`` is ln of target over proposal at independent draws, up to a constant. k̂ is
    infinite where hardly a draw counts or the tail cannot be judged, −inf for equal weights.
    """
    good_k = min(_LARGEST_GOOD_K, 1.0 - 1.0 / float(np.log10(len(log_ratio))))
    if np.ptp(log_ratio) < _EQUAL_LOG_RATIOS:
        return SmoothedWeights(np.full(len(log_ratio), 1.0 / len(log_ratio)), -np.inf, good_k)
    log_weight = log_ratio
    k = np.inf
    try:
        smoothed, shape = _smooth_tail(log_ratio)
    except ValueError:  # ArviZ refuses tails that are too short or all equal
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
    """Return the shape k̂ of the Pareto tail of importance weights, from their logarithms (n,).

    −inf where the largest weights are equal, infinite where there are too few weights to judge.
    """
    try:
        shape = _smooth_tail(log_weight)[1]
    except ValueError:  # ArviZ refuses tails that are too short or all equal
        if len(log_weight) < _FEWEST_WEIGHTS:
            return np.inf
        return -np.inf
    if np.isnan(shape):
        return np.inf
    return shape


def _smooth_tail(log_weight: Array) -> tuple[Array, float]:
    """Smooth the largest weights; return log weights and k̂, not a number where the fit fails."""
    with np.errstate(all="ignore"), warnings.catch_warnings(action="ignore"):
        smoothed, shape = array_stats.psislw(-log_weight)
    return smoothed, float(shape)
