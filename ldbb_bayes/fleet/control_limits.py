"""Split from its neighbours; see there."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from ldbb_bayes.fleet.deviations import estimate_separately
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.mixtures import mixture_quantiles
from ldbb_bayes.results import Array

__all__ = ["LIMITS"]


LIMITS = 0.997


class Chart(NamedTuple):
    """What is drawn of every campaign, in order of time, the instrument's errors at their posterior
    mean. ``own`` and ``own_sd`` (n, p) are of each campaign alone, ``limits`` (2, n, p) NaN at the
    first; ``common_sd`` (p,) what the instrument's errors add to the level of all campaigns
    together."""

    own: Array
    own_sd: Array
    limits: Array
    common_sd: Array


def chart_of(
    series: Gaussian,
    carried: Gaussian,
    scatter: Array,
    scatter_weight: Array,
    instrument: tuple[Array, Array],
    *,
    limits: float = LIMITS,
) -> Chart:
    """Points with their uncertainty, and limits of this probability from the campaigns before each.
    ``series`` (n, q) and ``carried`` (r, n, q) are the campaigns in order of time, scatter and its
    weights (r,) the prior of r, ``instrument`` posterior mean and covariance of the instrument's
    errors."""
    known, spread = instrument
    q = series.shift.shape[-1]
    p = q - len(known)
    shrink, seen, estimate = estimate_separately(series, p)
    own = estimate - seen[..., p:] @ known
    whole = series.precision[:, :p].sum(axis=0)
    pulled = np.linalg.solve(np.eye(p) + whole[:, :p], whole[:, p:])
    common = np.sqrt(np.einsum("as,su,au->a", pulled, spread, pulled))

    sums = [
        np.cumsum(part[:, :-1], axis=1)
        for part in (carried.precision, carried.shift, carried.log_constant)
    ]
    before = Gaussian(np.eye(q) + sums[0], *sums[1:])
    log_weight = np.log(scatter_weight)[:, None] + before.log_integral
    weight = np.exp(log_weight - logsumexp(log_weight, axis=0))
    take = seen[1:]
    expected = np.einsum("tab,rtb->rta", take, before.mean) - take[..., p:] @ known
    deviation = scatter[:, None, None] ** 2 * (take[..., :p] ** 2).sum(axis=-1)
    noise = np.einsum("tab,tab->ta", take[..., :p], shrink[1:])
    sd = np.sqrt((before.spread(take) ** 2).sum(axis=-1) + deviation + noise)
    tail = 0.5 - 0.5 * limits
    ends = mixture_quantiles(
        weight[:, :, None], expected, np.maximum(sd, 1e-300), (tail, 1.0 - tail)
    )
    nothing = np.full((2, 1, p), np.nan)
    return Chart(
        own, np.sqrt(np.einsum("taa->ta", shrink)), np.concatenate([nothing, ends], axis=1), common
    )
