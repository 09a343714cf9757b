"""Designs of whole tests: efficient rounding of shares, and exchange of single tests from many starts."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.analysis.optimal.objective import Objective

__all__ = ["efficient_rounding", "exchange"]

Array = NDArray[Any]
_ALL = 64
_LEADING, _THOROUGH = 12, 128
_GAIN = 1e-9
_SWEEPS = 50


def efficient_rounding(share: Array, tests: int) -> Array:
    """Whole numbers of tests nearest to shares (Pukelsheim and Rieder 1992), shape (candidates,), summing to ``tests``."""
    share = share / share.sum()
    support = np.flatnonzero(share)
    if len(support) > tests:
        support = support[np.argsort(-share[support], kind="stable")[:tests]]
    counts = np.zeros(len(share), dtype=int)
    counts[support] = np.ceil((tests - 0.5 * len(support)) * share[support]).astype(int)
    while (total := counts.sum()) != tests:
        own = share[support]
        if total < tests:
            counts[support[np.argmin(counts[support] / own)]] += 1
        else:
            counts[support[np.argmax((counts[support] - 1) / own)]] -= 1
    return counts


def exchange(
    objective: Objective,
    start: Array,
    rng: np.random.Generator,
    *,
    allowed: Array | None = None,
    feasible: Callable[[Array], bool] | None = None,
    thorough: bool = True,
) -> tuple[Array, float]:
    """Replace one test at a time by a better one until none is.

    Parameters
    ----------
    start : ndarray of int, shape (candidates,)
    allowed : ndarray of int, optional
        The candidates to choose from; default: all.
    feasible : callable, optional
        Whether a design (counts) may be had; that of ``start`` must be.
    thorough : bool
        End only when all candidates were tried in every place (of many, those of the largest sensitivity); else when a few were.

    Returns
    -------
    counts : ndarray of int, shape (candidates,)
    value : float
    """
    allowed = np.arange(objective.candidates) if allowed is None else allowed
    counts, value = start.copy(), objective.value(start.astype(float))
    size = _LEADING if len(allowed) > _ALL else len(allowed)
    for _ in range(_SWEEPS):
        improved = False
        for i in rng.permutation(np.flatnonzero(counts)):
            base = counts.copy()
            base[i] -= 1
            into = _likely(objective, base, allowed, size, rng)
            counts, value, moved = _best_move(objective, base, i, into, value, feasible)
            improved |= moved
        if improved:
            continue
        if size >= min(_THOROUGH, len(allowed)) or not thorough:
            break
        size = _THOROUGH
    return counts, value


def _best_move(
    objective: Objective, base: Array, out: int, into: Array, value: float, feasible: Callable[[Array], bool] | None
) -> tuple[Array, float, bool]:
    """The best place for one test taken away from ``out``."""
    unit = np.eye(1, len(base), out, dtype=int)[0]
    if feasible is not None:
        into = np.array([j for j in into if feasible(base + np.eye(1, len(base), j, dtype=int)[0])], dtype=int)
    if not len(into):
        return base + unit, value, False
    values = objective.after_adding(base.astype(float), into)
    best = int(np.argmax(values))
    gain = values[best] - value if np.isfinite(value) else np.inf if np.isfinite(values[best]) else 0.0
    if not gain > _GAIN * max(1.0, abs(value) if np.isfinite(value) else 1.0):
        return base + unit, value, False
    return base + np.eye(1, len(base), into[best], dtype=int)[0], float(values[best]), True


def _likely(objective: Objective, base: Array, allowed: Array, size: int, rng: np.random.Generator) -> Array:
    """The candidates of the largest sensitivity, and some at random; all when there are no more."""
    if size >= len(allowed):
        return allowed
    drawn = rng.choice(allowed, min(size, len(allowed)), replace=False)
    try:
        _, slope = objective.sensitivity(base.astype(float))
    except np.linalg.LinAlgError:
        return drawn
    return np.union1d(allowed[np.argsort(-slope[allowed])][:size], drawn)
