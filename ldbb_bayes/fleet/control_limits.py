"""Points and limits of a control chart.

A point is the estimate of a parameter from one campaign alone. The limits of a point are the ends
of the interval in which the estimate should lie according to the earlier campaigns. In the shapes
of arrays, n is the number of campaigns, p the number of parameters, s the number of errors and
effects that all campaigns have in common (errors of the instrument, and effects that the machine
keeps), and q = p + s. The standard deviation of the machine's parameters from campaign to campaign
is not known; the computation uses r possible values of it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from ldbb_bayes.fleet.deviations import estimate_separately
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.mixtures import mixture_quantiles
from ldbb_bayes.results import Array

__all__ = ["LIMITS", "ChartPoints", "chart_points"]

# Probability that the estimate of a parameter from one campaign lies within its control limits if
# the machine does not change. It is the probability that a normally distributed value lies within
# three standard deviations of its mean.
LIMITS = 0.997
# The earlier campaigns predict a distribution for the estimate of a parameter from the next
# campaign. If the standard deviation of this distribution is smaller than this number, this number
# is used instead, to prevent a division by zero.
_SMALLEST_SD = 1e-300


class ChartPoints(NamedTuple):
    """Points and limits of a control chart for p parameters and n campaigns, in order of time.

    A point is the estimate of a parameter from one campaign alone. For these estimates, the errors
    and effects in common are fixed at their posterior means. All values are in units of the
    parameters' prior sds.
    """

    #: estimate of each of p parameters from each of n campaigns alone, in units of the parameters'
    #: prior sd, shape (n, p)
    estimate: Array
    #: standard deviations of the estimates of p parameters from n campaigns, in units of the
    #: parameters' prior sd, shape (n, p)
    sd: Array
    #: lower and upper control limits of the estimates of p parameters from n campaigns, in units of
    #: the parameters' prior sd, shape (2, n, p); NaN at the first campaign
    limits: Array
    #: standard uncertainty of each of p parameters due to the errors and effects that all campaigns
    #: have in common, which shift all estimates together; in units of the parameters' prior sd,
    #: shape (p,)
    common_sd: Array


def chart_points(
    series: Gaussian,
    level_likelihoods: Gaussian,
    scatter: Array,
    scatter_weight: Array,
    common: tuple[Array, Array],
    *,
    limits: float = LIMITS,
) -> ChartPoints:
    """Return the points of a control chart and their limits.

    A point is the estimate of a parameter from one campaign alone. The limits of a point are the
    ends of the interval in which the point should lie according to the earlier campaigns. The
    machine's scatter is the standard deviation of its parameters from campaign to campaign. All
    values are in units of the prior sds.

    Parameters
    ----------
    series : likelihoods of the parameters, and of the errors and effects in common, from the n
        campaigns in order of time, shape (n, q).
    level_likelihoods : likelihoods of the machine's mean parameters, and of the errors and effects
        in common, from the same campaigns, shape (r, n, q). For each of the r values of the
        scatter, the random deviations of the campaigns from the mean parameters are integrated out.
    scatter, scatter_weight : values of the scatter and their prior probabilities, each of shape
        (r,).
    common : posterior mean (s,) and covariance (s, s) of the errors and effects in common.
    limits : probability that a point lies within its limits if the machine does not change.
    """
    common_mean, common_covariance = common
    q = series.shift.shape[-1]
    p = q - len(common_mean)
    separate = estimate_separately(series, p)
    estimate = separate.value - separate.response[..., p:] @ common_mean
    noise_variance = np.einsum("taa->ta", separate.covariance)

    # Errors and effects in common shift the estimates from all campaigns together. The variance of
    # this common shift is computed here.
    total_precision = series.precision[:, :p].sum(axis=0)
    common_response = np.linalg.solve(np.eye(p) + total_precision[:, :p], total_precision[:, p:])
    common_variance = np.einsum("as,su,au->a", common_response, common_covariance, common_response)

    history = _posteriors_of_earlier_campaigns(level_likelihoods)
    # The scatter is the standard deviation of the machine's parameters from campaign to campaign.
    # The weight of each value of the scatter is its posterior probability given the earlier
    # campaigns.
    log_weight = np.log(scatter_weight)[:, None] + history.log_integral
    weight = np.exp(log_weight - logsumexp(log_weight, axis=0))
    # The estimate of a parameter from the next campaign is predicted from the earlier campaigns.
    # The estimate scatters about the prediction for three reasons: the uncertainty of the
    # prediction, the machine's scatter, and the noise of the readings of the next campaign.
    next_response = separate.response[1:]
    parameter_response = next_response[..., :p]
    expected = np.einsum("tab,rtb->rta", next_response, history.mean)
    expected = expected - next_response[..., p:] @ common_mean
    scatter_variance = scatter[:, None, None] ** 2 * (parameter_response**2).sum(axis=-1)
    next_noise_variance = np.einsum("tab,tab->ta", parameter_response, separate.covariance[1:])
    history_variance = (history.spread(next_response) ** 2).sum(axis=-1)
    sd = np.sqrt(history_variance + scatter_variance + next_noise_variance)
    tail = 0.5 - 0.5 * limits
    ends = mixture_quantiles(
        weight[:, :, None], expected, np.maximum(sd, _SMALLEST_SD), (tail, 1.0 - tail)
    )
    unlimited = np.full((2, 1, p), np.nan)
    return ChartPoints(
        estimate=estimate,
        sd=np.sqrt(noise_variance),
        limits=np.concatenate([unlimited, ends], axis=1),
        common_sd=np.sqrt(common_variance),
    )


def _posteriors_of_earlier_campaigns(level_likelihoods: Gaussian) -> Gaussian:
    """Return, for every campaign but the first, the posterior from all campaigns before it.

    ``level_likelihoods``, shape (r, n, q), holds likelihoods of q quantities: the parameters, and
    the errors and effects in common. There is one for each of n campaigns, in order of time, and
    for each of r values of the machine's scatter from campaign to campaign. The result has the
    shape (r, n − 1, q): one Gaussian posterior of the q quantities for each value of the scatter
    and each campaign except the first. The prior of the q quantities is N(0, I).
    """
    precision = np.cumsum(level_likelihoods.precision[:, :-1], axis=1)
    shift = np.cumsum(level_likelihoods.shift[:, :-1], axis=1)
    log_constant = np.cumsum(level_likelihoods.log_constant[:, :-1], axis=1)
    return Gaussian(np.eye(level_likelihoods.shift.shape[-1]) + precision, shift, log_constant)
