"""Which machines do not belong with the others, and which contradict themselves from campaign to campaign.

A machine is compared with what the others predict of it, everything but their spread integrated out; a machine's campaigns with
one another.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, ndtr, ndtri

from ldbb_bayes.fleet.pooling import (
    Common,
    Pooling,
    SpreadDensity,
    Spreads,
    back,
    cholesky,
    draw_spreads,
    forward,
    log_determinant,
)
from ldbb_bayes.fleet.statistics import FleetStatistics
from ldbb_bayes.inference.posterior import pareto_smooth
from ldbb_bayes.model.gaussian import holm

__all__ = ["Belonging", "belonging_of", "contradicting"]

Array = NDArray[Any]
FALSE_ALARMS = 0.05
# Information, in units of the prior's, and relative to the most: less tells nothing, and may be rounding.
_SEEN, _RELATIVE = 1e-6, 1e-12
_ANEW, _MOST_ANEW = 512, 200


@dataclass(frozen=True, eq=False)
class Belonging:
    """The n machines, each against the others.

    Attributes
    ----------
    p_value, family_wise : ndarray, shape (n,)
        Probability, at most, that a parameter of a machine of the same population stands out so much; allowing for the number of
        machines (Holm).
    z, parameter_p_value : ndarray, shape (c, n)
        Of each parameter by itself, two-sided.
    flagged : ndarray of bool, shape (n,)
    seen : ndarray of bool, shape (n,)
        Whether readings say anything of the machine.
    pareto_k, good_k : ndarray, shape (n,)
        Of the weights of s without the machine.
    """

    p_value: Array
    family_wise: Array
    z: Array
    parameter_p_value: Array
    flagged: Array
    seen: Array
    pareto_k: Array
    good_k: Array

    @property
    def doubtful(self) -> Array:
        """Machines whose p-value cannot be trusted, shape (n,)."""
        return self.pareto_k > self.good_k


def belonging_of(
    density: SpreadDensity, spreads: Spreads, *, seed: int, progress: Callable[[int, int], None] | None = None
) -> Belonging:
    """Every machine left out in turn.

    Parameters
    ----------
    spreads : Spreads
        Of all machines.
    seed : int
        Of draws made anew.
    """
    pooled = density.pooling
    eyes = _eyes(pooled)
    log_density, z = _all_at_once(pooled, eyes, spreads.spread)
    n = len(pooled)
    weight, k, good = zip(*(pareto_smooth(spreads.log_weight - log_density[:, m]) for m in range(n)), strict=True)
    weights, pareto_k, good_k = np.array(weight), np.array(k), np.array(good)
    single, sign = _averaged(weights, z)
    again = np.flatnonzero(pareto_k > good_k)
    again = again[np.argsort(single.min(axis=0)[again], kind="stable")][:_MOST_ANEW]
    for done, m in enumerate(again):
        others = SpreadDensity(pooled.without(int(m)), density.scale)
        own = draw_spreads(others, seed=seed, size=_ANEW, start=spreads.mode)
        one = _against(eyes.of(np.array([m])), others.pooling.common(own.spread), own.spread)
        pareto_k[m], good_k[m] = own.pareto_k, own.good_k
        single[:, m], sign[:, m] = (part[:, 0] for part in _averaged(own.weight[None], one))
        if progress is not None:
            progress(done + 1, len(again))
    overall = np.minimum(1.0, len(single) * single.min(axis=0))
    family, seen = holm(overall), eyes.count > 0
    return Belonging(overall, family, -sign * ndtri(0.5 * single), single, family < FALSE_ALARMS, seen, pareto_k, good_k)


@dataclass(frozen=True, eq=False)
class _Eyes:
    """w = (R Q) (c, b) + N(0, I): a machine's a as r white numbers, and t = T w, what it estimates alone (b = 0).

    Attributes
    ----------
    seen : ndarray, shape (c, q, n)
        (R Q).
    white : ndarray, shape (c, n)
        w; nothing where the readings tell fewer than c numbers.
    count : ndarray of int, shape (n,)
        r.
    alone : ndarray, shape (c, c, n)
        T.
    """

    seen: Array
    white: Array
    count: Array
    alone: Array

    def of(self, machines: Array) -> _Eyes:
        return _Eyes(self.seen[..., machines], self.white[:, machines], self.count[machines], self.alone[..., machines])


def _eyes(pooled: Pooling) -> _Eyes:
    c = pooled.parameters
    rows = np.moveaxis(pooled.information[:c], -1, 0)
    values, vectors = np.linalg.eigh(rows[..., :c])
    told = values > np.maximum(_SEEN, _RELATIVE * values[:, -1:])
    inverse = np.where(told, 1.0 / np.sqrt(np.where(told, values, 1.0)), 0.0)
    whiten = inverse[:, :, None] * np.swapaxes(vectors, 1, 2)
    seen = whiten @ rows
    white = np.einsum("mij,jm->im", whiten, pooled.weighted[:c])
    alone = vectors * (np.sqrt(np.where(told, values, 0.0)) / (values.clip(min=0.0) + 1.0))[:, None, :]
    return _Eyes(np.moveaxis(seen, 0, -1), white, told.sum(axis=1), np.moveaxis(alone, 0, -1))


def _all_at_once(pooled: Pooling, eyes: _Eyes, spread: Array) -> tuple[Array, Array]:
    """ln p(y_m | y_−m, s) of every machine, (k, n), and z, (c, k, n)."""
    k, n, q = len(spread), len(pooled), len(pooled.weighted)
    log_density, z = np.empty((k, n)), np.empty((pooled.parameters, k, n))
    every = pooled.common(spread)
    for part in pooled.each(spread):
        square = np.einsum("iakm,ibkm->abkm", part.solved, part.solved)
        own = pooled.information[:, :, None] - square[:q, :q]
        precision = np.moveaxis(every.precision[part.rows], 0, -1)[..., None] - own
        weighted = every.weighted[part.rows].T[:, :, None] - pooled.weighted[:, None] + square[:q, q]
        lower = cholesky(precision)
        white = forward(lower, weighted[:, None])[:, 0]
        constant = 0.5 * (square[q, q] - log_determinant(part.lower))
        without = 0.5 * ((white**2).sum(axis=0) - log_determinant(lower))
        together = (every.log_density - every.constant)[part.rows]
        log_density[part.rows] = together[:, None] + constant - without
        mean = back(lower, white[:, None])[:, 0]
        z[:, part.rows] = _compared(eyes, lower, mean, spread[part.rows])
    return log_density, z


def _against(eyes: _Eyes, others: Common, spread: Array) -> Array:
    """z, (c, k, 1), of one machine, the others' x at hand."""
    lower = np.moveaxis(np.linalg.cholesky(others.precision), 0, -1)[..., None]
    return _compared(eyes, lower, others.mean.T[:, :, None], spread)


def _compared(eyes: _Eyes, lower: Array, mean: Array, spread: Array) -> Array:
    """z of t, (c, k, n), under x ~ N(mean, (L Lᵀ)⁻¹) and the spread of machines."""
    c = len(eyes.white)
    gain = forward(lower, np.broadcast_to(eyes.seen.swapaxes(0, 1)[:, :, None], (len(lower), c, *mean.shape[1:])))
    around = eyes.seen[:, :c, None] * spread.T[None, :, :, None]
    covariance = np.einsum("qikm,qjkm->ijkm", gain, gain) + np.einsum("iakm,jakm->ijkm", around, around)
    covariance[range(c), range(c)] += 1.0
    left = eyes.white[:, None] - np.einsum("iqm,qkm->ikm", eyes.seen, mean)
    variance = np.einsum("jim,ilkm,jlm->jkm", eyes.alone, covariance, eyes.alone, optimize=True)
    shift = np.einsum("jim,ikm->jkm", eyes.alone, left)
    return np.divide(shift, np.sqrt(variance), out=np.zeros_like(shift), where=variance > 0.0)


def _averaged(weights: Array, z: Array) -> tuple[Array, Array]:
    """Two-sided p over s, twice the lesser tail of the mixture, and the side, each (c, n); weights (n, k), z (c, k, n)."""
    above, below = (np.einsum("mk,jkm->jm", weights, ndtr(side * z)) for side in (-1.0, 1.0))
    return np.clip(2.0 * np.minimum(above, below), 1e-300, 1.0), np.where(above < below, 1.0, -1.0)


_CONTRADICTION = 0.01


def _repeat_p_values(statistics: FleetStatistics, mean: Array, covariance: Array) -> dict[str, float]:
    """p of every machine with at least two campaigns.

    Parameters
    ----------
    mean, covariance : ndarray, shapes (s,) and (s, s)
        Of the instrument's errors b, in units of their prior sd, as all campaigns know them.
    """
    c = len(statistics.parameters)
    scale = np.concatenate([statistics.prior_sd, statistics.instrument_sd])
    of: dict[str, list[int]] = {}
    for place, name in enumerate(statistics.machines):
        of.setdefault(name, []).append(place)
    found = {}
    for name, places in of.items():
        if len(places) < 2:
            continue
        seen, left = [], []
        for i in places:
            rows = (statistics.information[i] * scale[:, None] * scale)[:c]
            values, vectors = np.linalg.eigh(rows[:, :c])
            told = values > _SEEN
            whiten = (vectors[:, told] / np.sqrt(values[told])).T
            seen.append(whiten @ rows)
            left.append(whiten @ (statistics.weighted[i] * scale)[:c] - whiten @ rows[:, c:] @ mean)
        design = np.concatenate(seen)
        root = np.linalg.cholesky(np.eye(len(design)) + design[:, c:] @ covariance @ design[:, c:].T)
        own, reading = np.linalg.solve(root, design[:, :c]), np.linalg.solve(root, np.concatenate(left))
        best, _, rank, _ = np.linalg.lstsq(own, reading, rcond=1e-10)
        freedom = len(design) - int(rank)
        found[name] = float(chdtrc(freedom, np.sum((reading - own @ best) ** 2))) if freedom > 0 else 1.0
    return found


def contradicting(statistics: FleetStatistics, mean: Array, covariance: Array) -> list[str]:
    """Machines whose campaigns contradict one another: family-wise p (Holm) below 1 %."""
    p = _repeat_p_values(statistics, mean, covariance)
    family = holm(np.array(list(p.values()))) if p else np.zeros(0)
    return [name for name, own in zip(p, family, strict=True) if own < _CONTRADICTION]
