"""Split from its neighbours; see there."""

from __future__ import annotations

import numpy as np
from scipy.special import erf, logsumexp

from ldbb_bayes.fleet.campaign_statistics import mixture_covariance
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.mixtures import mixture_moments, mixture_quantiles
from ldbb_bayes.results import Array

_LEAST = 0.03


_MOST = 8.0


_STEP = 0.12


_NEGLIGIBLE = 1e-7


def scatter_rule(repeatability: float) -> tuple[Array, Array]:
    """Nodes of r and their weights, shape (r,): trapezoids in ln r; what lies below the lowest
    counts there."""
    count = int(np.ceil(np.log(_MOST / _LEAST) / _STEP)) + 1
    log_ratio = np.linspace(np.log(_LEAST), np.log(_MOST), count)
    ratio = np.exp(log_ratio)
    weight = ratio * np.sqrt(2.0 / np.pi) * np.exp(-0.5 * ratio**2) * (log_ratio[1] - log_ratio[0])
    weight[[0, -1]] *= 0.5
    weight[0] += erf(_LEAST / np.sqrt(2.0))
    return repeatability * ratio, weight / weight.sum()


def hypotheses(carried: Gaussian, parameters: int, change_scale: float) -> Gaussian:
    """(c, b, Δ) under every hypothesis, shape (r, n, p, q + 1); ``log_integral`` is their log
    evidence, up to what all share. Place k, counted from 0, is a step just before campaign k + 2;
    the last, of whatever parameter, is no step at all. ``carried`` are the campaigns in order of
    time, (r, n, q), their w_t integrated: `deviating`."""
    precision, shift = (
        np.cumsum(own[:, ::-1], axis=1)[:, ::-1] for own in (carried.precision, carried.shift)
    )
    (r, n, q), p = shift.shape, parameters
    late = np.swapaxes(precision[:, 1:, :, :p], -1, -2)
    whole = np.zeros((r, n, p, q + 1, q + 1))
    pull = np.zeros((r, n, p, q + 1))
    whole[..., :q, :q] = np.eye(q) + precision[:, None, :1]
    whole[..., q, q] = change_scale**-2.0
    whole[:, :-1, :, q, q] += np.einsum("rkjj->rkj", late[..., :p])
    whole[:, :-1, :, :q, q] = whole[:, :-1, :, q, :q] = late
    pull[..., :q], pull[:, :-1, :, q] = shift[:, None, :1], shift[:, 1:, :p]
    return Gaussian(whole, pull, carried.log_constant.sum(axis=1)[:, None, None])


def weigh(log_evidence: Array, scatter_weight: Array, probability: float) -> Array:
    """Posterior probability of every hypothesis, (r, n, p), from their log evidence, weights of r
    and the prior of a change."""
    _, times, parameters = log_evidence.shape
    prior = np.full((times, parameters), probability / max((times - 1) * parameters, 1))
    prior[-1] = (1.0 - probability) / parameters
    log_weight = log_evidence + np.log(prior) + np.log(scatter_weight)[:, None, None]
    return np.asarray(np.exp(log_weight - logsumexp(log_weight)))


def instrument_moments(found: Gaussian, weights: Array) -> tuple[Array, Array]:
    """Posterior mean and covariance of the instrument's errors, averaged over hypotheses; shapes
    (s,), (s, s)."""
    p = weights.shape[2]
    q = found.mean.shape[-1] - 1
    spread = found.spread(np.eye(q + 1)[p:q])
    covariance = (spread @ np.swapaxes(spread, -1, -2)).reshape(weights.size, q - p, q - p)
    return mixture_covariance(
        weights.ravel(), found.mean[..., p:q].reshape(weights.size, q - p), covariance
    )


def levels_of(
    found: Gaussian, weights: Array, *, ci_prob: float = 0.95
) -> tuple[Array, Array, Array]:
    """Mean and sd (p,) and interval (2, p) of c, with the step where there was one, averaged over
    hypotheses."""
    _, n, p = weights.shape
    level = np.eye(p, found.mean.shape[-1]) + np.zeros((n, p, p, 1))
    level[: n - 1, range(p), range(p), -1] = 1.0
    mean = np.einsum("kjab,rkjb->rkja", level, found.mean).reshape(-1, p)
    sd = np.sqrt((found.spread(level) ** 2).sum(axis=-1)).reshape(-1, p)
    counts = weights.ravel() > _NEGLIGIBLE * weights.max()
    weight = weights.ravel()[counts] / weights.ravel()[counts].sum()
    tail = 0.5 - 0.5 * ci_prob
    ends = mixture_quantiles(weight, mean[counts], sd[counts], (tail, 1.0 - tail))
    return (*mixture_moments(weight, mean[counts], sd[counts]), ends)
