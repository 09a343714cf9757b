"""The tilt that makes the importance weights of an orthant as even as they can be: a saddle point, found as a minimum.

x ~ N(0, I) with unit x ≥ bound row by row, unit lower triangular with ones on its diagonal;
ψ(x, tilt) = Σ ln P(x_i ≥ edge_i) + tilt² / 2 − x tilt, edge = bound − strict(unit) x − tilt (Botev 2017, section 3). In stacks.

At the saddle x = unitᵀ m and tilt = strict(unit)ᵀ m, m = φ(edge) / Φ(−edge) the inverse Mills ratios, so that the edges solve
edge + (unit unitᵀ − I) m(edge) = bound: there a strictly convex function of m has its minimum, and there is one solution.
Newton's method from the bounds finds it unless they are far and rows nearly repeat each other; then it starts from the most
probable point inside, where m are the forces with which the bounds hold it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls
from scipy.special import erfcx, log_ndtr

from ldbb_bayes.errors import InputError

__all__ = ["exponent", "saddle_point", "split_tilt", "strict"]

Array = NDArray[Any]
_ITERATIONS = 60
_HALVINGS = 20
_ROUNDING = 1e-10
_NOWHERE = 1e7


def split_tilt(joined: Array, d: int) -> tuple[Array, Array]:
    """x and tilt, each (w, d), from the 2 (d − 1) numbers that are free: the last of each is zero."""
    zero = np.zeros((len(joined), min(d, 1)))
    if d == 0:
        return zero, zero
    return np.hstack([joined[:, : d - 1], zero]), np.hstack([joined[:, d - 1 :], zero])


def exponent(unit: Array, bound: Array, x: Array, tilt: Array) -> Array:
    """ψ, shape (w,)."""
    edge = bound - np.einsum("wij,wj->wi", strict(unit), x) - tilt
    return (log_ndtr(-edge) + 0.5 * tilt**2 - x * tilt).sum(axis=1)


def strict(unit: Array) -> Array:
    """What lies below the diagonal."""
    return np.tril(unit, -1)


def saddle_point(unit: Array, bound: Array) -> Array:
    """x and tilt of the saddle, joined, shape (w, 2(d − 1)).

    Raises
    ------
    InputError
        Where none is found. Beyond ln P = −1e7, where nothing is decided any more, the best that was found is returned.
    """
    w, d = bound.shape
    if d <= 1:
        return np.zeros((w, 0))
    coupling = unit @ np.swapaxes(unit, 1, 2) - np.eye(d)
    edge, solved, _ = _newton(coupling, bound, bound)
    hard = np.flatnonzero(~solved)
    if hard.size:
        starts = np.array([_held_edges(coupling[k], unit[k], bound[k]) for k in hard])
        edge[hard], solved[hard], value = _newton(coupling[hard], bound[hard], starts)
        solved[hard] |= np.abs(value) > _NOWHERE
    if not solved.all():
        raise InputError(
            "the probability of physical compliances must be within reach of double precision, got readings too far from them. "
            "Check the sign of the readings, the mount compensation and the forces, or fit --without truncation."
        )
    mills = _mills(edge)
    x = np.einsum("wij,wi->wj", unit, mills)
    tilt = np.einsum("wij,wi->wj", strict(unit), mills)
    return np.hstack([x[:, : d - 1], tilt[:, : d - 1]])


def _newton(coupling: Array, bound: Array, start: Array) -> tuple[Array, NDArray[np.bool_], Array]:
    """Edges from a start, where they were found, and the convex function there.

    Steps are halved until the function or the residual falls.
    """
    edge = np.array(start)
    value, residual, slope, error = _merit(coupling, bound, edge)
    for _ in range(_ITERATIONS):
        active = error > _ROUNDING
        if not active.any():
            break
        system = np.eye(bound.shape[1]) + coupling * slope[:, None, :]
        step = -np.linalg.solve(system, residual[..., None])[..., 0]
        open_ = active.copy()
        for k in range(_HALVINGS):
            trial = np.where(open_[:, None], edge + 0.5**k * step, edge)
            found = _merit(coupling, bound, trial)
            good = open_ & ((found[0] < value) | (found[3] < error))
            edge = np.where(good[:, None], trial, edge)
            value, error = np.where(good, found[0], value), np.where(good, found[3], error)
            residual = np.where(good[:, None], found[1], residual)
            slope = np.where(good[:, None], found[2], slope)
            open_ &= ~good
            if not open_.any():
                break
        if open_[active].all():
            break
    return edge, error <= _ROUNDING, value


def _held_edges(coupling: Array, unit: Array, bound: Array) -> Array:
    """Edges at the most probable point inside: a least-distance problem (Lawson and Hanson, chapter 23)."""
    scale = max(1.0, float(np.abs(bound).max()))
    force, _ = nnls(np.vstack([unit.T, bound / scale]), np.append(np.zeros(len(bound)), 1.0))
    held = np.flatnonzero(force)
    mills = np.zeros(len(bound))
    mills[held] = np.linalg.solve(coupling[np.ix_(held, held)] + np.eye(len(held)), bound[held])
    free = bound - coupling @ mills
    # Far out the inverse Mills ratio is its argument and 1 / argument more.
    return np.where(mills > 1.0, mills - 1.0 / np.maximum(mills, 1.0), free)


def _merit(coupling: Array, bound: Array, edge: Array) -> tuple[Array, Array, Array, Array]:
    """½ mᵀ (K − I) m − boundᵀ m + Σ (edge m + ln Φ(−edge)); its gradient in m; dm / d edge; the gradient's relative size."""
    mills = _mills(edge)
    pulled = np.einsum("wij,wj->wi", coupling, mills)
    value = (mills * (0.5 * pulled - bound + edge) + log_ndtr(-edge)).sum(axis=1)
    size = 1.0 + np.abs(bound) + np.abs(edge) + np.einsum("wij,wj->wi", np.abs(coupling), mills)
    residual = edge + pulled - bound
    return value, residual, np.clip(mills * (mills - edge), 0.0, 1.0), np.abs(residual / size).max(axis=1)


def _mills(edge: Array) -> Array:
    """φ(edge) / Φ(−edge)."""
    with np.errstate(over="ignore"):
        return np.asarray(np.sqrt(2.0 / np.pi) / erfcx(edge / np.sqrt(2.0)))
