"""The tilt that makes the importance weights of an orthant as even as they can be: a saddle point, by Newton's method.

x ~ N(0, I) with unit x ≥ bound row by row; ψ(x, tilt) = Σ ln P(edge) + tilt² / 2 − x tilt (Botev 2017, section 3). In stacks.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr

__all__ = ["exponent", "saddle_point", "split_tilt", "strict"]

Array = NDArray[Any]
_LOG_2PI = float(np.log(2 * np.pi))


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


def saddle_point(unit: Array, bound: Array, *, iterations: int = 60) -> Array:
    """Newton iteration with step halving on the gradient of the tilted exponent, shape (w, 2(d − 1))."""
    w, d = bound.shape
    point = np.zeros((w, 2 * max(d - 1, 0)))
    if d <= 1:
        return point
    below = strict(unit)
    gradient, hessian = _gradient(below, bound, point)
    error = np.linalg.norm(gradient, axis=1)
    for _ in range(iterations):
        active = error > 1e-9 * (1.0 + np.abs(bound).max(axis=1))
        if not active.any():
            break
        step = np.linalg.solve(hessian, gradient[..., None])[..., 0]
        length = np.where(active, 1.0, 0.0)
        best, best_error = point, error
        for _ in range(12):
            trial = point - length[:, None] * step
            trial_gradient, trial_hessian = _gradient(below, bound, trial)
            trial_error = np.linalg.norm(trial_gradient, axis=1)
            better = (trial_error < best_error) & (length > 0)
            best = np.where(better[:, None], trial, best)
            best_error = np.where(better, trial_error, best_error)
            gradient = np.where(better[:, None], trial_gradient, gradient)
            hessian = np.where(better[:, None, None], trial_hessian, hessian)
            length = np.where(better, 0.0, length / 2.0)
            if not (length > 1e-4).any():
                break
        if np.array_equal(best, point):
            break
        point, error = best, best_error
    return point


def _gradient(below: Array, bound: Array, point: Array) -> tuple[Array, Array]:
    """Gradient and Hessian of the tilted exponent in (x, tilt) without their last entries."""
    d = bound.shape[1]
    x, tilt = split_tilt(point, d)
    edge = bound - np.einsum("wij,wj->wi", below, x) - tilt
    mills = np.exp(-0.5 * edge**2 - 0.5 * _LOG_2PI - log_ndtr(-edge))
    by_x = -tilt + np.einsum("wij,wi->wj", below, mills)
    by_tilt = tilt - x + mills
    change = -(mills**2) + edge * mills
    scaled = change[:, :, None] * below
    mixed = (-np.eye(d) + scaled)[:, : d - 1, : d - 1]
    curvature = np.einsum("wij,wik->wjk", below, scaled)[:, : d - 1, : d - 1]
    diagonal = np.zeros((len(x), d - 1, d - 1))
    span = np.arange(d - 1)
    diagonal[:, span, span] = 1.0 + change[:, : d - 1]
    gradient = np.hstack([by_x[:, : d - 1], by_tilt[:, : d - 1]])
    hessian = np.concatenate(
        [np.concatenate([curvature, np.swapaxes(mixed, 1, 2)], axis=2), np.concatenate([mixed, diagonal], axis=2)], axis=1
    )
    return gradient, hessian
