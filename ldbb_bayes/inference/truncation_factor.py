"""Probability P(T | y, φ) that no compliance is negative, at nodes φ of an integral.

y are the readings, and nodes are values of the hyper-parameters φ (such as the standard deviation
of the noise). Truncation multiplies the posterior density of φ by P(T | y, φ), an integral of the
Gaussian density of the parameters. It is computed from quasi-random points and has two errors. One
may be common to all nodes. The other is random, differs between nodes, and cancels in a mean.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ldbb_bayes.inference.density_ratio import LogValues
from ldbb_bayes.inference.integrals import CHUNK, Index, Integral
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.orthant import NoisyLogProbability, Orthant
from ldbb_bayes.results import Array

__all__ = [
    "ProbabilityInside",
    "TruncationFactor",
    "common_error_allowed",
    "mean_probability_inside",
]

# The error of ln P(T | y, φ) that may be common to all nodes is allowed to be this share of the
# tolerance of the log evidence.
_SHARE_OF_TOLERANCE = 0.25
# Smallest error [nat] that is allowed in ln P(T | y, φ), however small the tolerance is.
_FINEST_TOLERANCE = 1e-3
# Random error allowed in the log probability that no compliance is negative at one node (value of
# the hyper-parameters), as a multiple of the tolerance. The probability is computed from
# quasi-random points. The points differ between nodes, so that the errors cancel in the mean over
# hundreds of nodes.
_NOISE_PER_TOLERANCE = 2.0
# The probability that no compliance is negative is first averaged over ``_FEWEST_PICKED`` nodes
# (values of the hyper-parameters). As long as the error of the average is too large, the number of
# nodes is multiplied by ``_PICKED_GROWTH``.
_FEWEST_PICKED = 256
_PICKED_GROWTH = 4
# The probabilities that no compliance is negative are averaged over many values of the
# hyper-parameters. To avoid underflow, they are first divided by the largest of them. Two limits
# keep the logarithm of the mean finite. If the logarithm of the largest probability is below
# ``_LEAST_LOG_PROBABILITY``, this limit is used instead. If the mean of the quotients is below
# ``_LEAST_SHARE_INSIDE``, that limit is used instead.
_LEAST_LOG_PROBABILITY = -700.0
_LEAST_SHARE_INSIDE = 1e-300


class TruncationFactor:
    """Posterior density with truncation at the nodes of an integral of the density without it.

    The factor P(T | y, φ) is computed at a node when it is first needed there, and kept.

    Parameters
    ----------
    bound : BoundModel
        The model of the campaign.
    integral : Integral
        Integral of the density that allows negative compliances, with its n nodes.
    tolerance : float
        Error allowed in the log integral of the density with truncation [nat].
    seed : int
        Seed of the quasi-random points from which P(T | y, φ) is computed.
    bounded : bool
        Whether the density in ``integral`` includes an upper bound of P(T | y, φ) as a factor. The
        bound is then replaced by P(T | y, φ).
    """

    def __init__(
        self,
        bound: BoundModel,
        integral: Integral,
        *,
        tolerance: float,
        seed: int,
        bounded: bool = False,
    ) -> None:
        """Store the arguments; the factor is not known at any node yet."""
        self._bound = bound
        self._integral = integral
        self._tolerance = tolerance
        self._seed = seed
        self._bounded = bounded
        self._log_factor = np.full(len(integral.free), np.nan)
        self._common_error = np.zeros(len(integral.free))
        self._noise = np.zeros(len(integral.free))

    def log_truncated_density(self, index: Index) -> LogValues:
        """Return the log density with truncation at k nodes, and their common error [nat].

        ``index``, shape (k,), holds the indices of the nodes. The factor is computed anew at all of
        them.
        """
        orthant = _orthants(self._bound, self._integral.free[index])
        probability = _log_probability(orthant, self._tolerance, self._seed)
        log_factor = probability.log_value
        if self._bounded:
            log_factor = log_factor - orthant.log_bound
        self._log_factor[index] = log_factor
        self._common_error[index] = probability.common_error
        self._noise[index] = probability.noise
        return LogValues(self._integral.log_density[index] + log_factor, probability.common_error)

    def log_factor(self, index: Index) -> Array:
        """Return the log of the factor at k nodes, shape (k,).

        ``index``, shape (k,), holds the indices of the nodes. The factor is computed at those where
        it is not known yet. If the density in the integral
        contains an upper bound of P(T | y, φ), the log of this bound is subtracted.
        """
        unknown = index[np.isnan(self._log_factor[index])]
        for start in range(0, len(unknown), CHUNK):
            self.log_truncated_density(unknown[start : start + CHUNK])
        return self._log_factor[index]

    def error(self, weight: Array) -> float:
        """Return the error of the log integral over the nodes that comes from the factor [nat].

        ``weight``, shape (n,), holds the weights of the nodes with truncation, which sum to one.
        Errors that may have the same sign at all nodes do not cancel in a sum over the nodes, and
        are added. Errors that are random and independent between nodes are added as squares.
        """
        has_weight = weight > 0.0
        weight = weight[has_weight]
        common_error = weight @ self._common_error[has_weight]
        return float(common_error + np.linalg.norm(weight * self._noise[has_weight]))


class ProbabilityInside(NamedTuple):
    """Log posterior probability that no compliance is negative, and its error."""

    log_value: float  #: log posterior probability that no compliance is negative
    #: error of ``log_value``, the log posterior probability that no compliance is negative [nat]
    error: float


def mean_probability_inside(
    bound: BoundModel, integral: Integral, *, tolerance: float, seed: int
) -> ProbabilityInside:
    """Return the posterior probability that no compliance is negative, from a few nodes.

    The result holds the logarithm of the mean of P(T | y, φ) over nodes φ that are picked from
    ``integral`` in proportion to their weights. At first 256 nodes are picked. As long as the error
    exceeds the tolerance, the number of picked nodes is multiplied by four, but it does not exceed
    the number of nodes of ``integral``.

    Parameters
    ----------
    bound : BoundModel
        The model of the campaign.
    integral : Integral
        Integral of the density that allows negative compliances, with its nodes.
    tolerance : float
        Error allowed in ln P(T | y) [nat].
    seed : int
        Seed of the choice of nodes, and of the quasi-random points from which P is computed.
    """
    picked = _FEWEST_PICKED
    while True:
        free = integral.resample(picked, np.random.default_rng(seed))
        probability = _mean_probability(bound, free, tolerance, seed)
        picked *= _PICKED_GROWTH
        if probability.error <= tolerance or picked > len(integral.free):
            return probability


def _mean_probability(
    bound: BoundModel, free: Array, tolerance: float, seed: int
) -> ProbabilityInside:
    """Return the mean of P(T | y, φ) over n values of the hyper-parameters φ, with its error.

    The result holds the logarithm of the mean, and the error of this logarithm. ``free``, shape
    (n, h), holds the values of the h hyper-parameters in unbounded coordinates (mostly
    ln(value − lower bound)). The error is twice the standard error, plus the mean numerical error
    of P(T | y, φ), both divided by the mean. The standard error follows from the scatter of
    P(T | y, φ) between these values. ``tolerance`` is the error allowed in ln P(T | y) [nat].
    """
    log_values = []
    errors = []
    for start in range(0, len(free), CHUNK):
        orthant = _orthants(bound, free[start : start + CHUNK])
        probability = _log_probability(orthant, tolerance, seed)
        log_values.append(probability.log_value)
        errors.append(probability.common_error)
    log_value = np.concatenate(log_values)
    highest = max(float(log_value.max()), _LEAST_LOG_PROBABILITY)
    share = np.exp(log_value - highest)
    mean = max(float(share.mean()), _LEAST_SHARE_INSIDE)
    scatter = 2.0 * float(share.std(ddof=1)) / np.sqrt(len(share))
    numerical_error = float(share @ np.minimum(np.concatenate(errors), 1.0)) / len(share)
    return ProbabilityInside(highest + float(np.log(mean)), (scatter + numerical_error) / mean)


def common_error_allowed(tolerance: float) -> float:
    """Return the error allowed in ln P(T | y, φ) that may be common to all nodes φ [nat].

    It is a quarter of the tolerance, but at least 0.001 nat. ``tolerance`` is the error allowed in
    the log evidence, or in ln P(T | y) [nat].
    """
    return max(_SHARE_OF_TOLERANCE * tolerance, _FINEST_TOLERANCE)


def _orthants(bound: BoundModel, free: Array) -> Orthant:
    """Return the Gaussian densities of the compliances given w values of the hyper-parameters.

    ``free``, shape (w, h), holds the values in unbounded coordinates.
    """
    conditional = bound.given(bound.hyper_prior.phi(free)).parameters
    return conditional.orthant


def _log_probability(orthant: Orthant, tolerance: float, seed: int) -> NoisyLogProbability:
    """Return ln P(T | y, φ) at nodes φ (values of the hyper-parameters), with errors.

    ``orthant`` holds the Gaussian density of the compliances for every node. ``tolerance`` is the
    error allowed in the logarithm of the mean of P over many nodes [nat]. ``seed`` is the seed of
    the quasi-random points from which P is computed. The part of the error that all nodes have in
    common is allowed to be a quarter of the tolerance. The random part, which cancels in the mean,
    is allowed to be larger.
    """
    return orthant.log_probability_with_noise(
        common_error_allowed(tolerance),
        max(_NOISE_PER_TOLERANCE * tolerance, _FINEST_TOLERANCE),
        seed=seed,
    )
