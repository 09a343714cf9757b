"""Model of a step change in the parameters of one machine over time.

c_t = c + Δ e_j 1[t ≥ k] + w_t, t = 1..n

c_t are the machine's p parameters in campaign t of n; c is their level before any change. From
campaign k on, parameter j differs by the step Δ. The unit vector of that parameter is e_j. The
factor 1[t ≥ k] is one from campaign k on and zero before. w_t is the machine's scatter from
campaign to campaign, with the standard deviation r. b are the s errors of the instrument, the same
in all campaigns. In units of the prior's sd:

c ~ N(0, I), b ~ N(0, I), w_t ~ N(0, r² I), r ~ HalfNormal(repeatability), Δ ~ N(0, change_scale²)

At most one step occurs. If a step occurs, all p (n − 1) pairs of a parameter j and a campaign k
from 2 to n are equally probable a priori. A hypothesis states a value of r, and either the
parameter j and the campaign k of a step, or that there is no step. Under each hypothesis all
distributions are Gaussian: w_t is integrated out in each campaign, and the posterior follows from
sums over t ≥ k and one small linear system. The likelihood of a campaign has a precision matrix
(inverse covariance) Λ of (c, b), which may be singular.

In the shapes of arrays, r has another meaning: it is the number of nodes (values) of the scatter.
n is the number of campaigns, p that of parameters, s that of instrument errors, and q = p + s.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import erf, logsumexp

from ldbb_bayes.fleet.campaign_statistics import mixture_covariance
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.mixtures import mixture_moments, mixture_quantiles
from ldbb_bayes.results import Array

__all__ = [
    "Levels",
    "current_levels",
    "hypotheses",
    "hypothesis_probabilities",
    "instrument_moments",
    "scatter_rule",
]

# The scatter r is the standard deviation of a machine's parameters from campaign to campaign. It is
# integrated out as a sum over nodes (values of r). ``_LOWEST_RATIO`` and ``_HIGHEST_RATIO`` are the
# lowest and the highest node divided by the scale of the prior of r. ``_LOG_STEP`` is the step of
# ln r between nodes. The prior density beyond the highest node is negligible.
_LOWEST_RATIO = 0.03
_HIGHEST_RATIO = 8.0
_LOG_STEP = 0.12
# A hypothesis states which parameter of a machine changed by a step and just before which campaign,
# or that no parameter changed. Quantiles are computed without those hypotheses whose probability,
# divided by the probability of the most probable hypothesis, is at most this number.
_NEGLIGIBLE_WEIGHT = 1e-7


def scatter_rule(repeatability: float) -> tuple[Array, Array]:
    """Return nodes of the scatter r and their prior weights, each of shape (number of nodes,).

    The scatter r is the standard deviation of a machine's parameters from campaign to campaign;
    nodes are the values used for integration over r. The weights are those of the trapezoidal rule
    in ln r. The weight of the lowest node includes the prior probability of all smaller values of
    r.

    Parameters
    ----------
    repeatability : scale of the half-normal density of r.
    """
    log_range = np.log(_HIGHEST_RATIO / _LOWEST_RATIO)
    count = int(np.ceil(log_range / _LOG_STEP)) + 1
    log_ratio = np.linspace(np.log(_LOWEST_RATIO), np.log(_HIGHEST_RATIO), count)
    ratio = np.exp(log_ratio)
    step = log_ratio[1] - log_ratio[0]
    weight = ratio * np.sqrt(2.0 / np.pi) * np.exp(-0.5 * ratio**2) * step
    weight[[0, -1]] *= 0.5
    weight[0] += erf(_LOWEST_RATIO / np.sqrt(2.0))
    return repeatability * ratio, weight / weight.sum()


def hypotheses(carried: Gaussian, parameters: int, change_scale: float) -> Gaussian:
    """Return the Gaussian of levels, instrument errors and step (c, b, Δ) under every hypothesis.

    A hypothesis assumes one of r values of the machine's scatter from campaign to campaign. It also
    assumes that one of the p parameters changed by a step just before one of the campaigns 2 to n,
    or that no parameter changed. c are the levels of the p parameters before the step Δ, b the
    errors of the instrument; q is the number of all elements of c and b.

    The Gaussians have the shape (r, n, p, q + 1). The indices 0 to n − 2 of the second array axis
    mean a step just before the campaigns 2 to n; its last index, n − 1, means no step. Values are
    in units of the parameters' prior sd. The attribute ``log_integral`` is the log evidence of each
    hypothesis, up to a constant that all hypotheses share.

    Parameters
    ----------
    carried : likelihoods of the n campaigns in order of time for each value of the scatter, shape
        (r, n, q). The scatter of the parameters in each campaign is integrated out (see
        `deviating`).
    parameters : number p of parameters.
    change_scale : prior standard deviation of the step Δ.
    """
    p = parameters
    r, n, q = carried.shift.shape
    precision = _sum_from_here_on(carried.precision)
    shift = _sum_from_here_on(carried.shift)
    step_precision = np.swapaxes(precision[:, 1:, :, :p], -1, -2)
    joint_precision = np.zeros((r, n, p, q + 1, q + 1))
    joint_precision[..., :q, :q] = np.eye(q) + precision[:, None, :1]
    joint_precision[..., q, q] = change_scale**-2.0
    joint_precision[:, :-1, :, q, q] += np.einsum("rkjj->rkj", step_precision[..., :p])
    joint_precision[:, :-1, :, :q, q] = step_precision
    joint_precision[:, :-1, :, q, :q] = step_precision
    joint_shift = np.zeros((r, n, p, q + 1))
    joint_shift[..., :q] = shift[:, None, :1]
    joint_shift[:, :-1, :, q] = shift[:, 1:, :p]
    log_constant = carried.log_constant.sum(axis=1)
    return Gaussian(joint_precision, joint_shift, log_constant[:, None, None])


def _sum_from_here_on(series: Array) -> Array:
    """Return for each campaign the sum of the values of this campaign and of all later campaigns.

    ``series`` holds the values. Its second axis, and that of the result, counts the campaigns in
    order of time.
    """
    return np.asarray(np.cumsum(series[:, ::-1], axis=1)[:, ::-1])


def hypothesis_probabilities(
    log_evidence: Array, scatter_weight: Array, change_probability: float
) -> Array:
    """Return the posterior probability of every hypothesis of a step, shape (r, n, p).

    A hypothesis assumes one of r values of the machine's scatter from campaign to campaign. It also
    assumes that one of the p parameters changed by a step just before one of the campaigns 2 to n,
    or that no parameter changed. The indices 0 to n − 2 of the second array axis mean a step just
    before the campaigns 2 to n. Its last index, n − 1, means no step; the probability of no step is
    divided equally among the p parameters. All probabilities together sum to one.

    Parameters
    ----------
    log_evidence : log evidences of the hypotheses, shape (r, n, p).
    scatter_weight : prior probabilities of the values of the scatter, shape (r,).
    change_probability : prior probability that there is a step.
    """
    _, campaigns, parameters = log_evidence.shape
    steps = (campaigns - 1) * parameters
    prior = np.full((campaigns, parameters), change_probability / max(steps, 1))
    prior[-1] = (1.0 - change_probability) / parameters
    log_weight = log_evidence + np.log(prior) + np.log(scatter_weight)[:, None, None]
    return np.asarray(np.exp(log_weight - logsumexp(log_weight)))


def instrument_moments(posteriors: Gaussian, probabilities: Array) -> tuple[Array, Array]:
    """Return the posterior mean (s,) and covariance (s, s) of the instrument's s errors.

    Mean and covariance are those of the mixture of all hypotheses, weighted by their probabilities.
    A hypothesis assumes one of r values of the machine's scatter from campaign to campaign. It also
    assumes that one of the p parameters changed by a step just before one of the campaigns 2 to n,
    or that no parameter changed. Mean and covariance are in units of the errors' prior sd.

    Parameters
    ----------
    posteriors : Gaussians of level, instrument errors and step under every hypothesis, see
        `hypotheses`.
    probabilities : posterior probabilities of the hypotheses, shape (r, n, p).
    """
    count = probabilities.size
    p = probabilities.shape[2]
    q = posteriors.mean.shape[-1] - 1
    s = q - p
    spread = posteriors.spread(np.eye(q + 1)[p:q])
    covariance = (spread @ np.swapaxes(spread, -1, -2)).reshape(count, s, s)
    mean = posteriors.mean[..., p:q].reshape(count, s)
    return mixture_covariance(probabilities.ravel(), mean, covariance)


class Levels(NamedTuple):
    """Values of p parameters of a machine at the last campaign, in units of their prior sd.

    It is uncertain whether a parameter has changed, which parameter this is, and just before which
    campaign. The values are those of the mixture of all possibilities, weighted by their
    probabilities.
    """

    #: posterior means of the p parameters at the last campaign, in units of their prior sd, shape
    #: (p,)
    mean: Array
    #: posterior standard deviations of the p parameters at the last campaign, in units of their
    #: prior sd, shape (p,)
    sd: Array
    #: lower and upper ends of the credible intervals of the p parameters at the last campaign, in
    #: units of their prior sd, shape (2, p)
    interval: Array


def current_levels(posteriors: Gaussian, probabilities: Array, *, prob: float = 0.95) -> Levels:
    """Return every parameter's value at the last campaign: its first level plus any step.

    The result is that of the mixture of all hypotheses, weighted by their probabilities. A
    hypothesis assumes one of r values of the machine's scatter from campaign to campaign. It also
    assumes that one of the p parameters changed by a step just before one of the campaigns 2 to n,
    or that no parameter changed.

    Parameters
    ----------
    posteriors : Gaussians of level, instrument errors and step under every hypothesis, see
        `hypotheses`.
    probabilities : posterior probabilities of the hypotheses, shape (r, n, p).
    prob : probability of the credible intervals.
    """
    _, n, p = probabilities.shape
    combinations = np.eye(p, posteriors.mean.shape[-1]) + np.zeros((n, p, p, 1))
    combinations[: n - 1, range(p), range(p), -1] = 1.0
    mean = np.einsum("kjab,rkjb->rkja", combinations, posteriors.mean).reshape(-1, p)
    sd = np.sqrt((posteriors.spread(combinations) ** 2).sum(axis=-1)).reshape(-1, p)
    weight = probabilities.ravel()
    counts = weight > _NEGLIGIBLE_WEIGHT * weight.max()
    weight = weight[counts] / weight[counts].sum()
    tail = 0.5 - 0.5 * prob
    interval = mixture_quantiles(weight, mean[counts], sd[counts], (tail, 1.0 - tail))
    level, level_sd = mixture_moments(weight, mean[counts], sd[counts])
    return Levels(level, level_sd, interval)
