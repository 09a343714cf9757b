"""Split from its neighbours; see there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr, ndtri

from ldbb_bayes.analysis.multiple_testing import holm
from ldbb_bayes.fleet.deviations import estimate_separately, whitened
from ldbb_bayes.fleet.spread_density import (
    SpreadDensity,
    Spreads,
    chunks,
    common_of,
    draw_spreads,
)
from ldbb_bayes.inference.diagnostics import pareto_smooth
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.triangular import eliminate
from ldbb_bayes.results import Array

_ANEW = 512


_MOST_ANEW = 200


@dataclass(frozen=True, eq=False)
class Belonging:
    """The n machines, each against the others.

    ``p_value`` (n,) is the probability, at most, that of so many machines of one population a
    parameter of one stands out so much (Bonferroni over parameters, Holm over machines), ``single``
    (n, c) the two-sided one of each parameter by itself, ``z`` the same as a normal deviate.
    p-values that are ``doubtful`` cannot be trusted (Pareto's k̂).
    """

    p_value: Array
    single: Array
    z: Array
    doubtful: Array


def belonging_of(
    density: SpreadDensity,
    spreads: Spreads,
    common: Gaussian,
    *,
    seed: int,
    progress: Callable[[int, int], None] | None = None,
) -> Belonging:
    """Every machine left out in turn: by weights of these draws, or where they cannot be trusted by
    drawing s anew without it. ``common`` is that of the draws."""
    likelihood, (n, c) = (
        density.likelihood,
        (len(density.likelihood.shift), spreads.spread.shape[1]),
    )
    by_itself = estimate_separately(likelihood, c)
    log_density, z = _left_out(likelihood, by_itself, spreads.spread, common)
    smoothed = [pareto_smooth(spreads.log_weight - log_density[:, m]) for m in range(n)]
    weight, k, good = (np.array(part) for part in zip(*smoothed, strict=True))
    single, side = _averaged(weight, z)
    doubtful = k > good
    again = np.flatnonzero(doubtful)
    again = again[np.argsort(single.min(axis=1)[again], kind="stable")][:_MOST_ANEW]
    for done, m in enumerate(again):
        kept = np.arange(n) != m
        others = SpreadDensity(
            Gaussian(likelihood.precision[kept], likelihood.shift[kept]), density.scale
        )
        own = draw_spreads(others, c, seed=seed, size=_ANEW, start=spreads.mode)
        x = common_of(others.likelihood, own.spread)
        one = [part[m : m + 1] for part in by_itself]
        _, left = _against(
            one, np.moveaxis(x.precision, 0, -1)[..., None], x.shift.T[..., None], own.spread
        )
        doubtful[m] = not own.trusted
        single[m], side[m] = (part[0] for part in _averaged(own.weight[None], left))
        if progress is not None:
            progress(done + 1, len(again))
    overall = holm(np.minimum(1.0, c * single.min(axis=1)))
    return Belonging(overall, single, -side * ndtri(0.5 * single), doubtful)


def _left_out(
    likelihood: Gaussian, by_itself: Sequence[Array], spread: Array, common: Gaussian
) -> tuple[Array, Array]:
    """ln p(y_m | y_−m, s) of every machine, up to a constant, (k, n), and z, (c, k, n)."""
    c = spread.shape[1]
    q = likelihood.shift.shape[1]
    log_density = np.empty((len(spread), len(likelihood.shift)))
    z = np.empty((c, len(spread), len(likelihood.shift)))
    for rows in chunks(spread, likelihood):
        whole = whitened(likelihood, spread[rows])
        square = np.einsum("iakn,ibkn->abkn", whole[:, c:], whole[:, c:])
        precision = (
            np.moveaxis(common.precision[rows], 0, -1)[..., None]
            - likelihood.precision.T[:, :, None]
            + square[:q, :q]
        )
        shift = common.shift[rows].T[..., None] - likelihood.shift.T[:, None] + square[:q, q]
        others, z[:, rows] = _against(by_itself, precision, shift, spread[rows])
        own = 0.5 * square[q, q] - np.log(whole[range(c), range(c)]).sum(axis=0)
        log_density[rows] = (common.log_integral - common.log_constant)[rows, None] + own - others
    return log_density, z


def _against(
    by_itself: Sequence[Array], precision: Array, shift: Array, spread: Array
) -> tuple[Array, Array]:
    """ln ∫ of x as the other machines know it, up to a constant (k, n), and z of what machines by
    themselves estimate (`alone`), (c, k, n); x has precision (q, q, k, n) and shift (q, k, n)."""
    q, c, (own, seen, estimate) = len(shift), spread.shape[1], by_itself
    rows = np.broadcast_to(seen.T[:, :, None], (q, c, *shift.shape[1:]))
    whole = np.concatenate([precision, shift[:, None], rows], axis=1)
    eliminate(whole.reshape(1, *whole.shape[:2], -1))
    x = whole[:, q]
    gain = whole[:, q + 1 :]
    noise = (seen[..., :c] * own).sum(axis=-1).T[:, None]
    variance = (
        (gain**2).sum(axis=0) + np.einsum("ka,nja->jkn", spread**2, seen[..., :c] ** 2) + noise
    )
    left = estimate.T[:, None] - (gain * x[:, None]).sum(axis=0)
    z = np.divide(left, np.sqrt(variance), out=np.zeros_like(left), where=variance > 0.0)
    return 0.5 * (x**2).sum(axis=0) - np.log(whole[range(q), range(q)]).sum(axis=0), z


def _averaged(weights: Array, z: Array) -> tuple[Array, Array]:
    """Two-sided p over s, twice the lesser tail of the mixture, and the side, each (n, c); weights
    (n, k), z (c, k, n)."""
    above, below = (np.einsum("mk,jkm->mj", weights, ndtr(side * z)) for side in (-1.0, 1.0))
    return np.clip(2.0 * np.minimum(above, below), 1e-300, 1.0), np.where(above < below, 1.0, -1.0)
