"""Diagnostics of random draws: convergence, weights and sensitivity.

ESS is the effective sample size. The Pareto shape k̂ is the shape of the Pareto distribution fitted
to the largest weights; if k̂ is large, averages with these weights cannot be trusted. All
diagnostics are those of ArviZ. ArviZ evaluates one parameter after the other. Convergence and
sensitivity are computed here for all parameters at once, which takes a fraction of the time.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft
from scipy.special import ndtri

from ldbb_bayes.inference.pareto_tail import smooth_tail
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
# Smallest number of draws of a chain from which convergence is assessed.
_FEWEST_DRAWS = 4
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
    sizes for the quantiles at 5 % and at 95 %. If there are fewer than four draws, or if a draw of
    a parameter is not a number, the diagnostics are NaN.
    """
    d = chain.shape[2]
    half = chain.shape[1] // 2
    if chain.shape[1] < _FEWEST_DRAWS:
        unknown = np.full(d, np.nan)
        return Diagnostics(unknown, unknown, unknown)
    pooled = chain.reshape(-1, d)
    below = [chain <= quantile for quantile in np.quantile(pooled, _TAILS, axis=0)]
    split = np.concatenate([chain[:, :half], chain[:, -half:]])
    scores = _normal_scores(split)
    distances = np.abs(split - np.median(split.reshape(-1, d), axis=0))
    with np.errstate(invalid="ignore", divide="ignore"):
        rhat = np.maximum(_rhat(scores), _rhat(_normal_scores(distances)))
    halves = [np.concatenate([part[:, :half], part[:, -half:]]) for part in below]
    ess = _effective_sizes(np.concatenate([scores, *halves], axis=2)).reshape(3, d)
    is_number = ~np.isnan(pooled).any(axis=0)
    # ArviZ has no R-hat of a single chain.
    has_rhat = is_number & (len(chain) > 1)
    return Diagnostics(
        np.where(is_number, ess[0], np.nan),
        np.where(is_number, np.minimum(ess[1], ess[2]), np.nan),
        np.where(has_rhat, rhat, np.nan),
    )


def _normal_scores(chain: Array) -> Array:
    """Return the normal scores of draws, computed from their ranks among the draws of all chains.

    ``chain`` and the result have the shape (chains, draws, d). Of the n draws of a parameter, the
    draw with the rank r has the score Φ⁻¹((r − 3/8) / (n + 1/4)). Equal draws have the mean of
    their ranks (Blom 1958; Vehtari et al. 2021).
    """
    by_parameter = np.ascontiguousarray(chain.reshape(-1, chain.shape[2]).T)
    n = by_parameter.shape[1]
    order = np.argsort(by_parameter, axis=1)
    in_order = np.take_along_axis(by_parameter, order, axis=1)
    rank = np.tile(np.arange(1.0, n + 1.0), (len(in_order), 1))
    has_equal_draws = (in_order[:, 1:] == in_order[:, :-1]).any(axis=1)
    for k in np.flatnonzero(has_equal_draws):
        smaller = np.searchsorted(in_order[k], in_order[k], side="left")
        not_larger = np.searchsorted(in_order[k], in_order[k], side="right")
        rank[k] = 0.5 * (smaller + 1 + not_larger)
    scores = np.empty(by_parameter.shape)
    np.put_along_axis(scores, order, ndtri((rank - 0.375) / (n + 0.25)), axis=1)
    return scores.T.reshape(chain.shape)


def _rhat(chain: Array) -> Array:
    """Return the square root of total variance over variance within chains, for d parameters.

    ``chain`` has the shape (chains, draws, d), the result the shape (d,).
    """
    draws = chain.shape[1]
    between = draws * chain.mean(axis=1).var(axis=0, ddof=1)
    within = chain.var(axis=1, ddof=1).mean(axis=0)
    return np.asarray(np.sqrt((between / within + draws - 1.0) / draws))


def _effective_sizes(chain: Array) -> Array:
    """Return the effective sample sizes of d parameters, shape (d,).

    ``chain``, shape (chains, draws, d), holds random draws. If all draws of a parameter are equal,
    its effective sample size is the number of draws.
    """
    chains, draws, d = chain.shape
    by_parameter = np.moveaxis(chain, 2, 0).astype(float)
    means = by_parameter.mean(axis=2)
    # The autocovariances at all lags are computed by a Fourier transform, and averaged over the
    # chains. The draws are padded with zeros, so that the first draws do not follow the last ones.
    length = next_fast_len(2 * draws, real=True)
    transformed = rfft(by_parameter - means[:, :, None], n=length, axis=2)
    power = (transformed.real**2 + transformed.imag**2).mean(axis=1)
    covariance = irfft(power, n=length, axis=1)[:, :draws] / draws
    within = covariance[:, :1] * draws / (draws - 1.0)
    total = covariance[:, :1]
    if chains > 1:
        total = total + means.var(axis=1, ddof=1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = 1.0 - (within - covariance) / total
    correlation[:, 0] = 1.0
    time = np.maximum(_autocorrelation_times(correlation), 1.0 / np.log10(chains * draws))
    is_constant = np.ptp(by_parameter.reshape(d, -1), axis=1) < np.finfo(float).resolution
    return np.where(is_constant, 1.0, 1.0 / time) * chains * draws


def _autocorrelation_times(correlation: Array) -> Array:
    """Return the autocorrelation times of d parameters' draws, in draws, shape (d,).

    The effective sample size is the number of draws divided by this time. The time is −1 plus twice
    the sum of the autocorrelations at all lags. ``correlation``, shape (d, draws), holds them from
    lag 0 on. They are added in pairs (lags 0 and 1, 2 and 3, ...), and a pair never counts more
    than the pair before it. The sum ends at the first pair whose sum is not positive; of this pair,
    only the first autocorrelation counts, once and if it is positive (Geyer 1992).
    """
    last_pair = max((correlation.shape[1] - 3) // 2, 0)
    pairs = correlation[:, : 2 * last_pair + 2].reshape(len(correlation), -1, 2).sum(axis=2)
    ends = ~(pairs > 0.0)
    ends[:, 0] = False
    ends[:, last_pair] = True
    end = ends.argmax(axis=1)
    counts = np.arange(last_pair + 1) < end[:, None]
    of_pairs = np.where(counts, np.minimum.accumulate(pairs, axis=1), 0.0).sum(axis=1)
    after = correlation[np.arange(len(correlation)), 2 * end]
    return np.asarray(-1.0 + 2.0 * of_pairs + np.maximum(after, 0.0))


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
    stacked = np.stack([np.ravel(values) for values in draws.values()])
    order = np.argsort(stacked, axis=1)
    width = np.diff(np.take_along_axis(stacked, order, axis=1), axis=1)
    sensitivity: dict[str, dict[str, float]] = {name: {} for name in draws}
    for factor, log_density in log_densities.items():
        by_parameter = np.zeros(len(stacked))
        if np.ptp(log_density) > 0.0:
            for power in (_LOWER_POWER, _UPPER_POWER):
                weight = _scaling_weights(log_density, power)[order]
                distance = np.maximum(
                    _distances(width, weight), _distances(width[:, ::-1], weight[:, ::-1])
                )
                by_parameter += 0.5 * distance / abs(np.log2(power))
        for name, value in zip(draws, by_parameter, strict=True):
            sensitivity[name][factor] = float(value)
    return sensitivity


def _scaling_weights(log_density: Array, power: float) -> Array:
    """Return weights with which posterior draws represent a changed posterior, shape (n,).

    The posterior density is a product of factors such as prior and likelihood. In the changed
    posterior, one factor is raised to ``power``. ``log_density``, shape (chains, draws), is the
    logarithm of this factor at the n draws of all chains. The weights sum to one.
    """
    weight = np.exp((power - 1.0) * (log_density - log_density.mean())).ravel()
    return np.asarray(weight / weight.sum())


def _distances(width: Array, weight: Array) -> Array:
    """Return cumulative Jensen-Shannon distances between equal and given weights, shape (p,).

    The distance compares two distribution functions of a parameter: P, in which all n draws have
    equal weights, and Q, in which they have the weights ``weight``, shape (p, n), in the order of
    the p parameters' draws. ``width``, shape (p, n − 1), holds the distances between successive
    draws (Nguyen and Vreeken 2015; Kallioinen et al. 2023).
    """
    n = weight.shape[1]
    p = np.linspace(1.0 / n, 1.0 - 1.0 / n, n - 1)
    q = np.cumsum(weight, axis=1)[:, :-1]
    log_middle = np.log(0.5 * (p + q))
    area_of_p = width @ p
    area_of_q = (width * q).sum(axis=1)
    from_p = (width * (p * (np.log(p) - log_middle))).sum(axis=1)
    from_q = (width * (q * (np.log(q) - log_middle))).sum(axis=1)
    change = 0.5 * (area_of_q - area_of_p)
    # Each of the two divergences is zero or positive; rounding errors may make it negative.
    divergence = np.maximum(from_p + change, 0.0) + np.maximum(from_q - change, 0.0)
    area = area_of_p + area_of_q
    with np.errstate(invalid="ignore"):
        return np.asarray(np.sqrt(divergence / area / np.log(2.0)))


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
    log_weight, k = smooth_tail(log_ratio)
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
    return smooth_tail(log_weight).shape
