"""Marginal posterior densities of the parameters as mixtures, from draws of a posterior.

β are the p parameters: compliances, their changes with force, and geometric errors. φ are the
hyper-parameters, such as the standard deviation of the noise. Given φ and the readings, β is
Gaussian with a mean m and a covariance V. The marginal density of a parameter is therefore a
mixture of Gaussians, one for every draw of φ. From seed to seed, the quantiles of the mixture
scatter less than the quantiles of the draws of β (Rao-Blackwell theorem).

If truncation is active, β is restricted to A β ≥ 0; the elements of A β are the compliances that
must not be negative. The density of a parameter β_j given φ is then no longer Gaussian. A further
condition makes the density simple again: all combinations of parameters that are independent of β_j
keep the values that they have in the draw of β. Under this condition, β can change only in the
direction of column V_j of V. The density of β_j is N(m_j, V_jj), truncated at the two values beyond
which an element of A β would be negative. These truncated Gaussians are the components of the
mixture.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import xarray as xr
from scipy.special import ndtr

from ldbb_bayes.inference.averaged_models import AveragedModel, averaged_models
from ldbb_bayes.inference.coefficients import evenly_spaced
from ldbb_bayes.inference.integrals import CHUNK, Index
from ldbb_bayes.results import Array

__all__ = ["MarginalMixtures", "marginal_mixtures"]

# Largest number of posterior draws from which marginal densities of the parameters are computed.
# Each draw gives one component of the mixture that represents the density of a parameter.
_COMPONENTS = 8192
# Number of bisections in the search for a quantile. With this number, the error of the quantile is
# below 1e-12 of the range of the draws.
_BISECTIONS = 42
# Number of batches of successive draws. The standard error of a quantile is computed from the
# scatter of the quantile between the batches, because successive draws may be correlated.
_BATCHES = 16


class _Truncation(NamedTuple):
    """Intervals to which Gaussians are truncated, and the probabilities of these intervals.

    The probabilities are those before truncation. All arrays have the shape (n, p), for n Gaussians
    of each of p parameters.
    """

    #: lower bounds of truncated Gaussians (n for each of p parameters), as distances from their
    #: means in standard deviations
    low: Array
    #: upper bounds of truncated Gaussians (n for each of p parameters), as distances from their
    #: means in standard deviations
    high: Array
    #: −1 if a Gaussian is truncated to an interval above its mean, otherwise 1. With −1,
    #: probabilities are computed for the mirror image of the interval, below the mean. This is more
    #: accurate: far above the mean, cumulative probabilities are so close to one that rounding
    #: would spoil their difference.
    sign: Array
    #: probability, before truncation, that a Gaussian variable is below the lower bound of the
    #: interval to which it is truncated. If ``sign`` is −1 (an interval above the mean), it is the
    #: complement: the probability that the variable is above the lower bound.
    below: Array
    #: probability, before truncation, that a Gaussian variable is in the interval to which it is
    #: truncated. If ``sign`` is −1 (an interval above the mean), this probability is stored with a
    #: minus sign.
    inside: Array


class MarginalMixtures(NamedTuple):
    """Marginal densities of p parameters, each a mixture of n truncated Gaussians of equal weight.

    Each Gaussian belongs to one posterior draw of the parameters. A Gaussian that is not truncated
    has infinite bounds. A Gaussian whose standard deviation is zero has a single value, the value
    of the parameter in this draw; ``beta`` holds these values.
    """

    beta: Array  #: n posterior draws of the p parameters, shape (n, p)
    #: means of Gaussian densities before truncation, shape (n, p). Each of p parameters has n of
    #: these densities, one for each posterior draw.
    mean: Array
    #: standard deviations of Gaussian densities before truncation, shape (n, p). Each of p
    #: parameters has n of these densities, one for each posterior draw.
    sd: Array
    #: lower bounds of truncated Gaussian densities, shape (n, p). Each of p parameters has n of
    #: these densities, one for each posterior draw.
    low: Array
    #: upper bounds of truncated Gaussian densities, shape (n, p). Each of p parameters has n of
    #: these densities, one for each posterior draw.
    high: Array

    def _truncation(self) -> _Truncation:
        """Return the intervals to which the Gaussians are truncated, and their probabilities.

        Each of the p parameters has n Gaussians, one for each posterior draw.
        """
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            low = (self.low - self.mean) / self.sd
            high = (self.high - self.mean) / self.sd
            sign = np.where(low > 0.0, -1.0, 1.0)
            below = ndtr(sign * low)
            return _Truncation(low, high, sign, below, ndtr(sign * high) - below)

    def _cdf(self, x: Array, truncation: _Truncation) -> Array:
        """Return the posterior probability that each of p parameters is at most ``x``, shape (p,).

        ``x``, shape (p,), holds one value for each parameter. ``truncation`` holds the bounds of
        the truncated Gaussians, as `_truncation` returns them.
        """
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            z = np.clip((x - self.mean) / self.sd, truncation.low, truncation.high)
            share = (ndtr(truncation.sign * z) - truncation.below) / truncation.inside
        share = np.where(np.isfinite(share), share, x >= self.beta)
        return np.asarray(share.mean(axis=0))

    def quantiles(self, levels: Array) -> Array:
        """Return posterior quantiles of p parameters, shape (n, p).

        ``levels``, shape (n,), holds the n probabilities of the quantiles.
        """
        lowest = self.beta.min(axis=0)
        highest = self.beta.max(axis=0)
        margin = highest - lowest
        truncation = self._truncation()
        quantiles = []
        for level in levels:
            below = lowest - margin
            above = highest + margin
            for _ in range(_BISECTIONS):
                middle = 0.5 * (below + above)
                reached = self._cdf(middle, truncation) >= level
                above = np.where(reached, middle, above)
                below = np.where(reached, below, middle)
            quantiles.append(0.5 * (below + above))
        return np.array(quantiles)

    def quantile_errors(self, levels: Array) -> Array:
        """Return the standard errors of the quantiles of p parameters, shape (n, p).

        ``levels``, shape (n,), holds the n probabilities of the quantiles. The Gaussians of the
        mixtures are divided into batches. The standard errors are computed from the scatter between
        the quantiles of the batches.
        """
        count = min(_BATCHES, len(self.beta))
        quantiles = []
        for batch in np.array_split(np.arange(len(self.beta)), count):
            components = MarginalMixtures(*(array[batch] for array in self))
            quantiles.append(components.quantiles(levels))
        return np.asarray(np.std(quantiles, axis=0, ddof=1) / np.sqrt(count))


def marginal_mixtures(posterior: xr.DataTree) -> MarginalMixtures:
    """Return the marginal densities of all parameters, as mixtures of at most 8192 components.

    Each component comes from one posterior draw. If the posterior is an average over models, the
    number of components from each model is proportional to its number of draws. A parameter that a
    model lacks is zero in the components of this model.
    """
    models = averaged_models(posterior)
    total = sum(len(model.phi) for model in models)
    size = min(_COMPONENTS, total)
    of_models = []
    for model in models:
        count = max(1, round(size * len(model.phi) / total))
        of_models.append(_of_model(model, evenly_spaced(len(model.phi), count)))
    joined = [np.concatenate(arrays) for arrays in zip(*of_models, strict=True)]
    return MarginalMixtures(*joined)


def _of_model(model: AveragedModel, draws: Index) -> MarginalMixtures:
    """Return mixture densities of p parameters, computed from posterior draws of one model.

    ``model`` is one of the averaged models, and ``draws`` are the indices of the draws to use. Each
    draw gives one component of the mixtures. If a parameter is not in the model, all its components
    have the mean zero and the standard deviation zero.
    """
    beta = model.beta[draws]
    mean = np.zeros(beta.shape)
    sd = np.zeros(beta.shape)
    low = np.full(beta.shape, -np.inf)
    high = np.full(beta.shape, np.inf)
    for start in range(0, len(draws), CHUNK):
        rows = slice(start, start + CHUNK)
        components = _given_hyper_parameters(model, model.phi[draws[rows]], beta[rows])
        mean[rows, model.parameter_indices] = components.mean
        sd[rows, model.parameter_indices] = components.sd
        low[rows, model.parameter_indices] = components.low
        high[rows, model.parameter_indices] = components.high
    return MarginalMixtures(beta, mean, sd, low, high)


def _given_hyper_parameters(model: AveragedModel, phi: Array, beta: Array) -> MarginalMixtures:
    """Return w truncated Gaussian densities of each parameter of one model, one for each draw.

    ``phi``, shape (w, h), holds w posterior draws of the h hyper-parameters (such as the standard
    deviation of the noise). ``beta``, shape (w, p), holds draws of all p parameters of the average
    over models. The result has only those parameters that ``model`` has.
    """
    conditional = model.bound.given(phi).parameters
    of_model = beta[:, model.parameter_indices]
    spread = conditional.spread()
    sd = np.sqrt((spread**2).sum(axis=2))
    low = np.full(sd.shape, -np.inf)
    high = np.full(sd.shape, np.inf)
    truncation = model.bound.truncation
    if truncation.active:
        # The compliances that must not be negative are A β: linear combinations of the p parameters
        # β, one for each row of the matrix A. If one parameter changes, all other parameters change
        # too, in proportion to their covariances with this parameter. ``rate``, shape (w, rows, p),
        # holds the resulting change of each compliance per unit change of each parameter, at w
        # posterior draws.
        compliances = of_model @ truncation.rows.T
        covariance = conditional.spread(truncation.rows) @ np.swapaxes(spread, 1, 2)
        rate = covariance / sd[:, None] ** 2
        with np.errstate(divide="ignore", invalid="ignore"):
            bounds = of_model[:, None] - compliances[:, :, None] / rate
        low = np.where(rate > 0.0, bounds, -np.inf).max(axis=1)
        high = np.where(rate < 0.0, bounds, np.inf).min(axis=1)
    return MarginalMixtures(of_model, conditional.mean, sd, low, high)
