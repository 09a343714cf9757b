"""Model of a step change in the parameters of one machine over time.

c_t = c + Δ e_j 1[t ≥ k] + w_t, t = 1..n

c_t are the machine's p parameters in campaign t of n campaigns. c are the levels of the parameters
before any change. From campaign k on, parameter j differs from its level by the step Δ; e_j is the
unit vector of parameter j. The factor 1[t ≥ k] is one from campaign k on and zero before. w_t is
the machine's scatter from campaign to campaign, with the standard deviation r. b are the s errors
and effects that all campaigns have in common: errors of the instrument, and effects that the
machine keeps (`machine_effects`). In units of the prior standard deviations:

c ~ N(0, I), b ~ N(0, I), w_t ~ N(0, r² I), r ~ HalfNormal(repeatability), Δ ~ N(0, change_scale²)

At most one step occurs. If a step occurs, all p (n − 1) pairs of a parameter j and a campaign k
from 2 to n are equally probable a priori. A hypothesis states a value of r, and either the
parameter j and the campaign k of a step, or that there is no step. Under each hypothesis all
distributions are Gaussian: w_t is integrated out in each campaign, and the posterior follows from
sums over t ≥ k and one small linear system. The likelihood of a campaign is a Gaussian function of
(c, b), whose precision matrix Λ (inverse covariance) may be singular.

In the shapes of arrays, the letter r has another meaning: the number of values of the scatter. n is
the number of campaigns, p the number of parameters, s the number of errors and effects in common,
and q = p + s.
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
    "common_moments",
    "current_levels",
    "hypotheses",
    "hypothesis_probabilities",
    "scatter_rule",
]

# The scatter r is the standard deviation of a machine's parameters from campaign to campaign. It is
# integrated out by a sum over nodes (values of r). ``_LOWEST_RATIO`` is the lowest node divided by
# the scale of the prior of r, and ``_HIGHEST_RATIO`` is the highest node divided by this scale.
# ``_LOG_STEP`` is the largest step of ln r between nodes. The prior density above the highest node
# is negligible.
_LOWEST_RATIO = 0.03
_HIGHEST_RATIO = 8.0
_LOG_STEP = 0.12
# When quantiles are computed, a hypothesis is left out if its probability is at most this fraction
# of the probability of the most probable hypothesis. A hypothesis assumes a value of the machine's
# scatter from campaign to campaign. It also assumes either that a certain parameter changed by a
# step just before a certain campaign, or that no parameter changed.
_NEGLIGIBLE_WEIGHT = 1e-7


def scatter_rule(repeatability: float) -> tuple[Array, Array]:
    """Return the nodes of the scatter r and the prior weights of the nodes, shape (nodes,) each.

    The scatter r is the standard deviation of a machine's parameters from campaign to campaign.
    Nodes are values of r; an integral over r is computed as a weighted sum over the nodes. The
    weights follow from the trapezoidal rule in ln r, and sum to one. The weight of the lowest node
    includes the prior probability of all smaller values of r.

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


def hypotheses(level_likelihoods: Gaussian, parameters: int, change_scale: float) -> Gaussian:
    """Return the Gaussian posterior of levels, common errors and step under every hypothesis.

    A hypothesis assumes one of r values of the machine's scatter from campaign to campaign. It also
    assumes that one of the p parameters changed by a step just before one of the campaigns 2 to n,
    or that no parameter changed. A Gaussian describes the vector (c, b, Δ): c are the levels of the
    p parameters before the step, b are the errors and effects that all campaigns have in common,
    and Δ is the step; c and b together have q elements.

    The Gaussians have the shape (r, n, p, q + 1). The indices 0 to n − 2 of the second array axis
    stand for a step just before the campaigns 2 to n; the index n − 1 stands for no step. Values
    are in units of the prior sds. The attribute ``log_integral`` is the log evidence of each
    hypothesis, up to a constant that all hypotheses share.

    Parameters
    ----------
    level_likelihoods : likelihoods of the levels c and the errors b from the n campaigns in order
        of time, for each of the r values of the scatter, shape (r, n, q). The deviation w_t of each
        campaign from the level is integrated out (see `deviating`).
    parameters : number p of parameters.
    change_scale : prior standard deviation of the step Δ.
    """
    p = parameters
    r, n, q = level_likelihoods.shift.shape
    precision = _sum_from_here_on(level_likelihoods.precision)
    shift = _sum_from_here_on(level_likelihoods.shift)
    # The step Δ of a machine's parameter affects only the campaigns after the step. The likelihood
    # has a precision matrix and a shift (precision times estimate). In both, the elements that
    # belong to Δ are therefore sums over the campaigns after the step.
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
    log_constant = level_likelihoods.log_constant.sum(axis=1)
    return Gaussian(joint_precision, joint_shift, log_constant[:, None, None])


def _sum_from_here_on(series: Array) -> Array:
    """Return, for each campaign, the sum of an array over this campaign and all later campaigns.

    The second array axis of ``series`` and of the result stands for the campaigns, in order of
    time. ``series`` holds, for example, the precision matrix of every campaign's likelihood.
    """
    return np.asarray(np.cumsum(series[:, ::-1], axis=1)[:, ::-1])


def hypothesis_probabilities(
    log_evidence: Array, scatter_weight: Array, change_probability: float
) -> Array:
    """Return the posterior probability of every hypothesis, shape (r, n, p).

    A hypothesis assumes one of r values of the machine's scatter from campaign to campaign. It also
    assumes that one of the p parameters changed by a step just before one of the campaigns 2 to n,
    or that no parameter changed. The indices 0 to n − 2 of the second array axis stand for a step
    just before the campaigns 2 to n. The index n − 1 stands for no step; the probability of no step
    is divided equally among the p parameters. The sum of all probabilities is one.

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


def common_moments(posteriors: Gaussian, probabilities: Array) -> tuple[Array, Array]:
    """Return the posterior mean (s,) and covariance (s, s) of the s errors and effects in common.

    The mean and the covariance are those of the mixture of all hypotheses, each weighted by its
    posterior probability. A hypothesis assumes one of r values of the machine's scatter from
    campaign to campaign. It also assumes that one of the p parameters changed by a step just before
    one of the campaigns 2 to n, or that no parameter changed. The mean and the covariance are in
    units of the prior sds.

    Parameters
    ----------
    posteriors : joint Gaussian distribution, for each hypothesis (see `hypotheses`), of the levels
        of the parameters before the step, the errors and effects in common, and the size of the
        step.
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
    """Values of p parameters of a machine at the last campaign, in units of their prior sds.

    The values are averages over two kinds of hypotheses: that no parameter has changed, and that
    one of the parameters changed just before one of the campaigns. The weights are the
    probabilities of the hypotheses.
    """

    #: posterior means of the p parameters of a machine at the last campaign, in units of their
    #: prior sd, shape (p,)
    mean: Array
    #: posterior standard deviations of the p parameters of a machine at the last campaign, in units
    #: of their prior sd, shape (p,)
    sd: Array
    #: credible intervals of the p parameters of a machine at the last campaign: lower and upper
    #: ends, in units of the parameters' prior sds, shape (2, p)
    interval: Array


def current_levels(posteriors: Gaussian, probabilities: Array, *, prob: float = 0.95) -> Levels:
    """Return every parameter's value at the last campaign: its initial level plus any step.

    The values are those of the mixture of all hypotheses, each weighted by its posterior
    probability. A hypothesis assumes one of r values of the machine's scatter from campaign to
    campaign. It also assumes that one of the p parameters changed by a step just before one of the
    campaigns 2 to n, or that no parameter changed.

    Parameters
    ----------
    posteriors : joint Gaussian distribution, for each hypothesis (see `hypotheses`), of the levels
        of the parameters before the step, the errors and effects in common, and the size of the
        step.
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
