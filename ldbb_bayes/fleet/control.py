"""x_t = (I + Λ_cc)⁻¹ (η_c − Λ_cb b̂), N(mean, variance) given the campaigns before t and no change: points and control limits.

x_t is what campaign t alone says of its machine's parameters, the instrument's errors known to be b̂, their posterior mean over
all campaigns. b̂ moves the points and their limits alike: what all campaigns share widens neither, and where campaigns see the
instrument differently (other forces) the limits allow for it. Units as in `change`: the prior's sd from its mean.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.fleet.change import Carried, Series, Steps, Weights, carry, mixture_quantile, steps_of

__all__ = ["Chart", "Levels", "chart_of", "instrument_moments", "levels_of"]

Array = NDArray[Any]
_NEGLIGIBLE = 1e-7


@dataclass(frozen=True, eq=False)
class Chart:
    """What is drawn of every campaign, in order of time.

    Attributes
    ----------
    own, own_sd : ndarray, shape (n, p)
        Of each campaign alone, the instrument's errors at their posterior mean.
    limits : ndarray, shape (2, n, p)
        Control limits; of the first campaign NaN.
    common_sd : ndarray, shape (p,)
        What the instrument's errors add to the level of all campaigns together.
    """

    own: Array
    own_sd: Array
    limits: Array
    common_sd: Array


@dataclass(frozen=True, eq=False)
class Levels:
    """c and the step at every campaign, averaged over hypotheses, the instrument's errors at their posterior mean.

    Attributes
    ----------
    mean, sd : ndarray, shape (n, p)
        Of the mixture over hypotheses.
    interval : ndarray, shape (2, n, p)
    """

    mean: Array
    sd: Array
    interval: Array


def instrument_moments(steps: Steps, weights: Weights, parameters: int) -> tuple[Array, Array]:
    """Posterior mean and covariance of the instrument's errors, averaged over hypotheses; shapes (s,), (s, s)."""
    tilt = steps.tilt[:, :, parameters:]
    apart = -tilt * steps.size[:, :, None]
    base = steps.mean[:, parameters:]
    every = base[:, None, :, None] + apart
    mean = np.einsum("r,rs->s", weights.none, base) + np.einsum("rkj,rksj->s", weights.change, every)
    alone, other = base - mean, every - mean[:, None]
    inside = steps.covariance[:, parameters:, parameters:]
    covariance = np.einsum("r,rst->st", weights.scatter, inside) + np.einsum("r,rs,rt->st", weights.none, alone, alone)
    covariance += np.einsum("rkj,rksj,rktj->st", weights.change, other, other)
    return mean, covariance + np.einsum("rkj,rksj,rktj->st", weights.change * steps.variance, tilt, tilt)


def chart_of(
    series: Series,
    carried: Carried,
    scatter: Array,
    scatter_weight: Array,
    instrument: tuple[Array, Array],
    *,
    limits: float = 0.997,
) -> Chart:
    """Points with their uncertainty, and limits from the campaigns before each.

    Parameters
    ----------
    scatter, scatter_weight : ndarray, shape (r,)
        Values of r and their prior probabilities.
    instrument : tuple of ndarray
        Posterior mean and covariance of the instrument's errors.
    limits : float
        Probability of lying between the limits where nothing changes.
    """
    p, q = series.parameters, series.information.shape[-1]
    known, spread = instrument
    alone = series.given(known)
    shrink = np.linalg.inv(np.eye(p) + alone.information)
    own = np.einsum("tab,tb->ta", shrink, alone.weighted)
    seen = shrink @ series.information[:, :p, p:]
    whole = series.information[:, :p].sum(axis=0)
    pulled = np.linalg.solve(np.eye(p) + whole[:, :p], whole[:, p:])
    common = np.sqrt(np.einsum("as,su,au->a", pulled, spread, pulled))

    before, pull = (np.cumsum(part[:, :-1], axis=1) for part in (carried.information, carried.weighted))
    system = np.eye(q) + before
    covariance = np.linalg.inv(system)
    mean = np.einsum("rtab,rtb->rta", covariance, pull)
    log_evidence = 0.5 * (np.einsum("rta,rta->rt", pull, mean) - np.linalg.slogdet(system)[1])
    log_weight = np.log(scatter_weight)[:, None] + log_evidence + np.cumsum(carried.log_constant[:, :-1], axis=1)
    weight = np.exp(log_weight - log_weight.max(axis=0))
    weight /= weight.sum(axis=0)

    take = shrink[1:] @ series.information[1:, :p]
    covariance[:, :, range(p), range(p)] += scatter[:, None, None] ** 2
    noise = np.einsum("tab,tbc,tac->ta", shrink[1:], alone.information[1:], shrink[1:])
    expected = np.einsum("tab,rtb->rta", take, mean) - np.einsum("tas,s->ta", seen[1:], known)
    sd = np.sqrt(np.einsum("tab,rtbc,tac->rta", take, covariance, take) + noise)
    tail = 0.5 - 0.5 * limits
    ends = [mixture_quantile(weight[:, :, None], expected, np.maximum(sd, 1e-300), end) for end in (tail, 1.0 - tail)]
    nothing = np.full((2, 1, p), np.nan)
    return Chart(
        own,
        np.sqrt(np.einsum("taa->ta", shrink)),
        np.concatenate([nothing, np.array(ends)], axis=1),
        common,
    )


def levels_of(
    series: Series, scatter: Array, weights: Weights, known: Array, change_scale: float, *, ci_prob: float = 0.95
) -> Levels:
    """Level of every parameter at every campaign, under the probabilities that hypotheses have.

    Parameters
    ----------
    weights : Weights
        Of the series with its instrument's errors unknown.
    known : ndarray, shape (s,)
        Their posterior mean.
    """
    n, p = len(series), series.parameters
    steps = steps_of(carry(series.given(known), scatter), change_scale)
    variance = np.einsum("raa->ra", steps.covariance)
    base = steps.mean[:, None, :, None] - steps.tilt * steps.size[:, :, None]
    reach = np.zeros((2, *base.shape[1:]))
    square = np.zeros_like(reach)
    share = _share(weights.change, axis=0)
    for moved in (0, 1):
        extra = moved * np.eye(p)
        mean = base + extra * steps.size[:, :, None]
        spread = variance[:, None, :, None] + (extra - steps.tilt) ** 2 * steps.variance[:, :, None]
        reach[moved] = np.einsum("rkj,rkij->kij", share, mean)
        square[moved] = np.einsum("rkj,rkij->kij", share, spread + (mean - reach[moved]) ** 2)
    of_none = _share(weights.none, axis=0)
    none = np.einsum("r,ra->a", of_none, steps.mean)
    none_variance = np.einsum("r,ra->a", of_none, variance + (steps.mean - none) ** 2)

    total = weights.change.sum(axis=0)
    times, movers = np.nonzero(total > _NEGLIGIBLE * total.max())
    weight = np.concatenate([[weights.none.sum()], total[times, movers]])
    weight /= weight.sum()
    moved_yet = (np.arange(n)[None, :] > times[:, None]).astype(int)
    means = np.concatenate([np.broadcast_to(none, (1, n, p)), reach[moved_yet, times[:, None], :, movers[:, None]]])
    variances = np.concatenate([np.broadcast_to(none_variance, (1, n, p)), square[moved_yet, times[:, None], :, movers[:, None]]])
    sd = np.sqrt(variances)
    half = 0.5 * ci_prob
    ends = [mixture_quantile(weight[:, None, None], means, sd, end) for end in (0.5 - half, 0.5 + half)]
    middle = np.einsum("h,hta->ta", weight, means)
    return Levels(middle, np.sqrt(np.einsum("h,hta->ta", weight, variances + (means - middle) ** 2)), np.array(ends))


def _share(weight: Array, axis: int) -> Array:
    """Of the whole along an axis; of nothing, equal shares."""
    total = weight.sum(axis=axis, keepdims=True)
    return np.where(total > 0.0, weight / np.where(total > 0.0, total, 1.0), 1.0 / weight.shape[axis])
