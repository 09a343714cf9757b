"""Which rows of u = mean + spread e ≥ 0 matter: those that may fail, and among these an independent set, tightest first."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

__all__ = ["PUSHED", "core_rows", "uncertain"]

Array = NDArray[Any]
_DEPENDENT = 1e-7
_CERTAIN = 12.0
PUSHED = -3.0


def uncertain(mean: Array, spread: Array) -> Array:
    """Rows that may fail anywhere in the batch; all of them where the others are far from holding and could push them."""
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = mean / np.linalg.norm(spread, axis=2)
    certain = np.all(distance > _CERTAIN, axis=0)
    pushed = distance[:, ~certain].min(initial=0.0) < PUSHED
    return np.flatnonzero(np.ones_like(certain) if pushed else ~certain)


def core_rows(mean: Array, spread: Array) -> NDArray[np.int_]:
    """Independent rows for every member of the batch, tightest first, shape (w, rank)."""
    if not mean.shape[1]:
        return np.zeros(mean.shape, dtype=int)
    norms = np.linalg.norm(spread, axis=2)
    tightest = np.argsort(mean / norms, axis=1, kind="stable")
    rank = np.linalg.matrix_rank(spread[0] / norms[0][:, None], tol=_DEPENDENT)
    if rank == mean.shape[1]:
        return tightest
    return np.array([_binding_rows(mean[k] / norms[k], spread[k] / norms[k][:, None], rank) for k in range(len(mean))])


def _binding_rows(distance: Array, unit: Array, rank: int) -> list[int]:
    """Rows active at the most probable point inside, then the tightest that add a direction.

    The most probable point is a least-distance problem, solved by non-negative least squares (Lawson and Hanson, ch. 23).
    """
    stacked = np.vstack([unit.T, -distance / max(1.0, float(np.abs(distance).max()))])
    force, _ = nnls(stacked, np.append(np.zeros(unit.shape[1]), 1.0))
    keep: list[int] = []
    basis = np.zeros((0, unit.shape[1]))
    for i in np.lexsort((distance, -force)):
        rest = unit[i] - basis.T @ (basis @ unit[i])
        size = np.linalg.norm(rest)
        if size > _DEPENDENT and len(keep) < rank:
            keep.append(int(i))
            basis = np.vstack([basis, rest / size])
    return sorted(keep, key=lambda i: float(distance[i]))
