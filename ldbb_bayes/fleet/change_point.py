"""A step change in the parameters of one machine over time.

c_t = c + Δ e_j 1[t ≥ k] + w_t, t = 1..n

In units of the prior's sd: c ~ N(0, I), b ~ N(0, I) the instrument's errors, the same in all
campaigns, w_t ~ N(0, r² I) what the machine itself changes from campaign to campaign, r ~
HalfNormal(repeatability), Δ ~ N(0, change_scale²). With the prior probability of a change there is
one step, j uniform over parameters and k over 2..n. Given r, j, k everything is Gaussian: w_t is
integrated in each campaign, the rest needs sums over t ≥ k and one small system for each r, k, j. A
campaign's Λ may be singular.

Sizes: r nodes of the scatter, n campaigns, p parameters, s instrument errors, q = p + s.
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

# Lowest and highest node of r, in units of the repeatability, and the step of their logarithm: the
# half-normal density is negligible beyond.
_LOWEST_RATIO = 0.03
_HIGHEST_RATIO = 8.0
_LOG_STEP = 0.12
# Hypotheses below this share of the most probable one do not count for quantiles.
_NEGLIGIBLE_WEIGHT = 1e-7


def scatter_rule(repeatability: float) -> tuple[Array, Array]:
    """Return nodes of r and their weights, each of shape (r,).

    They are trapezoids in ln r; what lies below the lowest node counts there.

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
    """Return (c, b, Δ) under every hypothesis, shape (r, n, p, q + 1).

    Place k, counted from 0, is a step just before campaign k + 2; the last, of whatever parameter,
    is no step at all. ``log_integral`` is the log evidence, up to what all hypotheses share.

    Parameters
    ----------
    carried : campaigns in order of time, (r, n, q), their w_t integrated: see `deviating`.
    parameters : p.
    change_scale : sd of Δ.
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
    """Return the sums over each campaign and all after it; campaigns are the second axis."""
    return np.asarray(np.cumsum(series[:, ::-1], axis=1)[:, ::-1])


def hypothesis_probabilities(
    log_evidence: Array, scatter_weight: Array, change_probability: float
) -> Array:
    """Return the posterior probability of every hypothesis, shape (r, n, p).

    Parameters
    ----------
    log_evidence : of the hypotheses, shape (r, n, p).
    scatter_weight : prior weights of the nodes of r, shape (r,).
    change_probability : prior probability that there is a step.
    """
    _, campaigns, parameters = log_evidence.shape
    steps = (campaigns - 1) * parameters
    prior = np.full((campaigns, parameters), change_probability / max(steps, 1))
    prior[-1] = (1.0 - change_probability) / parameters
    log_weight = log_evidence + np.log(prior) + np.log(scatter_weight)[:, None, None]
    return np.asarray(np.exp(log_weight - logsumexp(log_weight)))


def instrument_moments(posteriors: Gaussian, probabilities: Array) -> tuple[Array, Array]:
    """Return the posterior mean (s,) and covariance (s, s) of the instrument's errors.

    Parameters
    ----------
    posteriors : under every hypothesis, see `hypotheses`.
    probabilities : of the hypotheses, shape (r, n, p).
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
    """The parameters at the last campaign, averaged over hypotheses."""

    mean: Array  #: shape (p,)
    sd: Array  #: shape (p,)
    interval: Array  #: ends, shape (2, p)


def current_levels(posteriors: Gaussian, probabilities: Array, *, ci_prob: float = 0.95) -> Levels:
    """Return the level of every parameter, with the step where there was one.

    Parameters
    ----------
    posteriors : under every hypothesis, see `hypotheses`.
    probabilities : of the hypotheses, shape (r, n, p).
    ci_prob : probability of the intervals.
    """
    _, n, p = probabilities.shape
    combinations = np.eye(p, posteriors.mean.shape[-1]) + np.zeros((n, p, p, 1))
    combinations[: n - 1, range(p), range(p), -1] = 1.0
    mean = np.einsum("kjab,rkjb->rkja", combinations, posteriors.mean).reshape(-1, p)
    sd = np.sqrt((posteriors.spread(combinations) ** 2).sum(axis=-1)).reshape(-1, p)
    weight = probabilities.ravel()
    counts = weight > _NEGLIGIBLE_WEIGHT * weight.max()
    weight = weight[counts] / weight[counts].sum()
    tail = 0.5 - 0.5 * ci_prob
    interval = mixture_quantiles(weight, mean[counts], sd[counts], (tail, 1.0 - tail))
    level, level_sd = mixture_moments(weight, mean[counts], sd[counts])
    return Levels(level, level_sd, interval)
