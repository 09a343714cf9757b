"""From draws of s and Gaussians given s to what is told of parameters and machines, in inside units."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from ldbb_bayes.fleet.belonging_machines import Belonging
from ldbb_bayes.fleet.mixtures import mixture_moments, mixture_quantiles, weighted_quantiles
from ldbb_bayes.fleet.pooled import PooledMachine, PooledParameter, Summary
from ldbb_bayes.fleet.pooling import Common, Pooling
from ldbb_bayes.fleet.spreads import Spreads
from ldbb_bayes.fleet.statistics import FleetStatistics

__all__ = ["instrument_moments", "told_of_machines", "told_of_parameters"]

Array = NDArray[Any]
# Standard uncertainties that a mean must be away from zero before a spread is told in per cent of it.
_TOLD = 5.0


def told_of_parameters(
    statistics: FleetStatistics,
    spreads: Spreads,
    few: Spreads,
    common: Common,
    tails: tuple[float, float],
) -> dict[str, PooledParameter]:
    """μ and the next machine from conditional Gaussians, s from its draws.

    Parameters
    ----------
    few : Spreads
        The first draws of ``spreads``; ``common`` is theirs.
    tails : tuple of float
        Levels of the ends of intervals.
    """
    units = _Units(statistics)
    c = len(units.names)
    mean, variance = common.mean[:, :c], (common.root[:, :c] ** 2).sum(axis=-1)
    mu = units.summaries(*_mixture(few.weight, mean, np.sqrt(variance), tails))
    following = units.summaries(*_mixture(few.weight, mean, np.sqrt(variance + few.spread**2), tails))
    middle = spreads.weight @ spreads.spread
    sd = np.sqrt(spreads.weight @ (spreads.spread - middle) ** 2)
    spread = units.summaries(middle, sd, *weighted_quantiles(spreads.weight, spreads.spread, tails), spread=True)
    known = np.linalg.inv(common.precision[:, :c, :c])
    shared = few.weight @ (variance - np.diagonal(known, axis1=1, axis2=2)).clip(min=0.0) * bool(statistics.instrument)
    total = _mixture(few.weight, mean, np.sqrt(variance), tails)[1] ** 2
    return {
        name: PooledParameter(
            name=name,
            unit=statistics.units[j],
            prior_mean=float(statistics.prior_mean[j]),
            prior_sd=float(statistics.prior_sd[j]),
            mean=mu[j],
            spread=spread[j],
            next=following[j],
            percent=_percent(spread[j], mu[j]),
            instrument_sd=float(units.scale[j] * np.sqrt(shared[j])),
            instrument_share=float(min(1.0, shared[j] / total[j])),
        )
        for j, name in enumerate(units.names)
    }


def told_of_machines(
    pooled: Pooling,
    statistics: FleetStatistics,
    few: Spreads,
    common: Common,
    belonging: Belonging | None,
    tails: tuple[float, float],
) -> dict[str, PooledMachine]:
    """Every machine with the population, alone, and against the others; arguments as for `told_of_parameters`."""
    c, n, units = pooled.parameters, len(pooled), _Units(statistics)
    mean, sd = np.empty((2, len(few.weight), c, n))
    shrinkage = np.zeros((c, n))
    for part in pooled.each(few.spread):
        own = Common(*(value[part.rows] for value in vars(common).values()))
        middle, width, share = pooled.estimates(part, own, few.spread)
        mean[part.rows], sd[part.rows] = middle.swapaxes(0, 1), width.swapaxes(0, 1)
        shrinkage += np.einsum("k,jkm->jm", few.weight[part.rows], share)
    estimate = np.stack(_mixture(few.weight, mean, sd, tails))
    alone = _alone(pooled, few, common, tails)
    return {
        name: PooledMachine(
            name=name,
            campaigns=int(pooled.campaigns[m]),
            estimate=dict(zip(units.names, units.summaries(*estimate[..., m]), strict=True)),
            alone=dict(zip(units.names, units.summaries(*alone[..., m]), strict=True)),
            shrinkage=dict(zip(units.names, shrinkage[:, m].tolist(), strict=True)),
            **_judged(units.names, belonging, m),
        )
        for m, name in enumerate(pooled.machines)
    }


def _judged(names: tuple[str, ...], belonging: Belonging | None, m: int) -> dict[str, Any]:
    if belonging is None:
        return {"p_value": None, "family_wise_p_value": None, "z": {}, "parameter_p_value": {}, "flag": False}
    return {
        "p_value": float(belonging.p_value[m]),
        "family_wise_p_value": float(belonging.family_wise[m]),
        "z": dict(zip(names, belonging.z[:, m].tolist(), strict=True)),
        "parameter_p_value": dict(zip(names, belonging.parameter_p_value[:, m].tolist(), strict=True)),
        "flag": bool(belonging.flagged[m]),
    }


def instrument_moments(pooled: Pooling, few: Spreads, common: Common) -> tuple[Array, Array]:
    """Mean and covariance of b, in units of its prior sd, as all campaigns know it."""
    b, roots = common.mean[:, pooled.parameters :], common.root[:, pooled.parameters :]
    mean = few.weight @ b
    apart = b - mean
    covariance = np.einsum("k,kir,kjr->ij", few.weight, roots, roots) + np.einsum("k,ki,kj->ij", few.weight, apart, apart)
    return mean, covariance


def _alone(pooled: Pooling, few: Spreads, common: Common, tails: tuple[float, float]) -> Array:
    """(A + I)⁻¹ (a − B b) with b as all campaigns know it: mean, sd and interval, shape (4, c, n)."""
    c = pooled.parameters
    mean, covariance = instrument_moments(pooled, few, common)
    rows = np.moveaxis(pooled.information[:c], -1, 0)
    inverse = np.linalg.inv(rows[..., :c] + np.eye(c))
    gain = inverse @ rows[..., c:]
    middle = np.einsum("mij,jm->im", inverse, pooled.weighted[:c]) - (gain @ mean).T
    sd = np.sqrt(np.diagonal(inverse + gain @ covariance @ np.swapaxes(gain, 1, 2), axis1=1, axis2=2)).T
    return np.stack([middle, sd, *(middle + ndtri(tail) * sd for tail in tails)])


def _mixture(weight: Array, mean: Array, sd: Array, tails: tuple[float, float]) -> tuple[Array, Array, Array, Array]:
    low, high = mixture_quantiles(weight, mean, sd, tails)
    return (*mixture_moments(weight, mean, sd), low, high)


class _Units:
    """From units of the prior sd about the prior mean back to inside units."""

    def __init__(self, statistics: FleetStatistics) -> None:
        self.names = statistics.parameters
        self.centre, self.scale = statistics.prior_mean, statistics.prior_sd

    def summaries(self, mean: Array, sd: Array, low: Array, high: Array, *, spread: bool = False) -> list[Summary]:
        """Of every parameter, arrays of shape (c,); a spread has no centre."""
        centre = 0.0 * self.centre if spread else self.centre
        parts = (centre + self.scale * mean, self.scale * sd, centre + self.scale * low, centre + self.scale * high)
        return [Summary(m, u, (a, b)) for m, u, a, b in zip(*(part.tolist() for part in parts), strict=True)]


def _percent(spread: Summary, mean: Summary) -> Summary | None:
    if abs(mean.mean) <= _TOLD * mean.sd:
        return None
    factor = 100.0 / abs(mean.mean)
    return Summary(spread.mean * factor, spread.sd * factor, (spread.interval[0] * factor, spread.interval[1] * factor))
