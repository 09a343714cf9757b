"""c_t = c + Δ e_j 1[t ≥ k] + w_t, t = 1..n in order of time: every step of one parameter, weighed against none.

In units of the prior's sd: c ~ N(0, I), b ~ N(0, I) the instrument's errors, the same in all campaigns, w_t ~ N(0, r² I) what the
machine itself changes from campaign to campaign, r ~ HalfNormal(repeatability), Δ ~ N(0, change_scale²). With the probability
given there is one step, j uniform over parameters and k over 2..n. Given r, j, k everything is Gaussian: w_t is integrated in
each campaign, the rest needs sums over t ≥ k and one small system for each r. A campaign's Λ may be singular: it is not inverted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf, logsumexp, ndtr

from ldbb_bayes.fleet.statistics import FleetStatistics

__all__ = ["Carried", "Series", "Steps", "Weights", "carry", "mixture_quantile", "scatter_rule", "steps_of", "weigh"]

Array = NDArray[Any]
_LEAST, _MOST, _STEP = 0.03, 8.0, 0.12
_BISECTIONS = 60


@dataclass(frozen=True, eq=False)
class Series:
    """Likelihoods of one machine's campaigns in order of time, in units of the prior's sd from its mean.

    Attributes
    ----------
    information : ndarray, shape (n, q, q)
        Parameters first, then the instrument's errors.
    weighted : ndarray, shape (n, q)
    parameters : int
        p; q less p are the instrument's.
    """

    information: Array
    weighted: Array
    parameters: int

    @classmethod
    def of(cls, statistics: FleetStatistics, order: Sequence[int]) -> Series:
        """Of a fleet's statistics, in the order of time given."""
        sd = np.concatenate([statistics.prior_sd, statistics.instrument_sd])
        mean = np.concatenate([statistics.prior_mean, np.zeros_like(statistics.instrument_sd)])
        take = np.asarray(order, dtype=int)
        information = statistics.information[take]
        weighted = statistics.weighted[take] - information @ mean
        return cls(information * (sd[:, None] * sd), weighted * sd, len(statistics.prior_sd))

    def __len__(self) -> int:
        return len(self.information)

    def given(self, instrument: Array) -> Series:
        """The same with the instrument's errors known."""
        p = self.parameters
        known = self.weighted[:, :p] - self.information[:, :p, p:] @ instrument
        return Series(self.information[:, :p, :p], known, p)


@dataclass(frozen=True, eq=False)
class Carried:
    """ln p(y_t | c + step, b, r) = −½ zᵀ Λ z + ηᵀ z + constant: w_t integrated out, for every r.

    Attributes
    ----------
    information : ndarray, shape (r, n, q, q)
    weighted : ndarray, shape (r, n, q)
    log_constant : ndarray, shape (r, n)
    """

    information: Array
    weighted: Array
    log_constant: Array
    parameters: int


@dataclass(frozen=True, eq=False)
class Steps:
    """Every hypothesis given r, K = n − 1 times; sizes and levels in units of the prior's sd.

    Attributes
    ----------
    log_none : ndarray, shape (r,)
        Log evidence of no change, up to what all hypotheses share.
    log_ratio : ndarray, shape (r, K, p)
        Log evidence of a step of parameter j at t = k + 2 (k counted from 0), over none.
    size, variance : ndarray, shape (r, K, p)
        Of Δ there.
    mean : ndarray, shape (r, q)
        Of (c, b) where nothing changes.
    covariance : ndarray, shape (r, q, q)
    tilt : ndarray, shape (r, K, q, p)
        By how much the mean of (c, b) falls for each unit of Δ.
    """

    log_none: Array
    log_ratio: Array
    size: Array
    variance: Array
    mean: Array
    covariance: Array
    tilt: Array


@dataclass(frozen=True, eq=False)
class Weights:
    """Posterior probabilities; all together are 1.

    Attributes
    ----------
    none : ndarray, shape (r,)
    change : ndarray, shape (r, K, p)
    """

    none: Array
    change: Array

    @property
    def scatter(self) -> Array:
        """Of every r, shape (r,)."""
        return self.none + self.change.sum(axis=(1, 2))


def scatter_rule(repeatability: float, *, step: float = _STEP) -> tuple[Array, Array]:
    """Nodes of r and their weights: trapezoids in ln r; what lies below the lowest counts there.

    Parameters
    ----------
    repeatability : float
        Scale of the half-normal density.
    step : float
        In ln r.

    Returns
    -------
    tuple of ndarray, shape (r,)
    """
    count = int(np.ceil(np.log(_MOST / _LEAST) / step)) + 1
    log_ratio = np.linspace(np.log(_LEAST), np.log(_MOST), count)
    ratio = np.exp(log_ratio)
    weight = ratio * np.sqrt(2.0 / np.pi) * np.exp(-0.5 * ratio**2) * (log_ratio[1] - log_ratio[0])
    weight[[0, -1]] *= 0.5
    weight[0] += erf(_LEAST / np.sqrt(2.0))
    return repeatability * ratio, weight / weight.sum()


def carry(series: Series, scatter: Array) -> Carried:
    """Integrate w_t ~ N(0, r² I) in every campaign, for every r: (I + Λ D)⁻¹ Λ, D = r² on the parameters."""
    p, q = series.parameters, series.information.shape[-1]
    spread = np.zeros((len(scatter), q))
    spread[:, :p] = scatter[:, None] ** 2
    system = np.eye(q) + series.information * spread[:, None, None, :]
    right = np.concatenate([series.information, series.weighted[:, :, None]], axis=2)
    solved = np.linalg.solve(system, np.broadcast_to(right, (len(scatter), *right.shape)))
    information, weighted = solved[..., :q], solved[..., q]
    gain = np.einsum("rq,tq,rtq->rt", spread, series.weighted, weighted)
    _, log_size = np.linalg.slogdet(system)
    return Carried(0.5 * (information + np.swapaxes(information, -1, -2)), weighted, 0.5 * (gain - log_size), p)


def steps_of(carried: Carried, change_scale: float) -> Steps:
    """Evidence of every step over none, its size, and what it makes of (c, b)."""
    p, q = carried.parameters, carried.information.shape[-1]
    after, pull = (np.cumsum(own[:, ::-1], axis=1)[:, ::-1] for own in (carried.information, carried.weighted))
    total, all_pull = after[:, 0], pull[:, 0]
    after, pull = after[:, 1:, :, :p], pull[:, 1:, :p]
    system = np.eye(q) + total
    covariance = np.linalg.inv(system)
    mean = np.einsum("rab,rb->ra", covariance, all_pull)
    _, log_size = np.linalg.slogdet(system)
    log_none = 0.5 * (np.einsum("ra,ra->r", all_pull, mean) - log_size) + carried.log_constant.sum(axis=1)
    tilt = covariance[:, None] @ after
    precision = np.einsum("rkjj->rkj", after[:, :, :p]) - np.einsum("rkaj,rkaj->rkj", after, tilt)
    push = pull - np.einsum("rkaj,ra->rkj", after, mean)
    shrunk = change_scale**2 / (1.0 + change_scale**2 * np.maximum(precision, 0.0))
    log_ratio = 0.5 * (shrunk * push**2 + np.log(shrunk / change_scale**2))
    return Steps(log_none, log_ratio, shrunk * push, shrunk, mean, covariance, tilt)


def weigh(steps: Steps, scatter_weight: Array, probability: float) -> Weights:
    """Posterior probability of every hypothesis.

    Parameters
    ----------
    probability : float
        Prior probability of a change.
    """
    base = np.log(scatter_weight) + steps.log_none
    _, times, parameters = steps.log_ratio.shape
    none = base + np.log1p(-probability)
    change = base[:, None, None] + steps.log_ratio + np.log(probability / (times * parameters))
    whole = np.logaddexp(logsumexp(none), logsumexp(change))
    return Weights(np.exp(none - whole), np.exp(change - whole))


def mixture_quantile(weight: Array, mean: Array, sd: Array, probability: float) -> Array:
    """Quantile of mixtures of normals by bisection; components along the first axis, of weights that sum to 1."""
    low, high = (mean - 9.0 * sd).min(axis=0), (mean + 9.0 * sd).max(axis=0)
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        below = (weight * ndtr((middle - mean) / sd)).sum(axis=0) < probability
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return 0.5 * (low + high)
