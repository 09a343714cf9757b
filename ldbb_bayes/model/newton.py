"""Newton's method for the mode of a log density."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ldbb_bayes.results import Array

__all__ = ["central_differences", "newton"]


_FRACTIONS = (1.0, 0.5, 0.25, 0.1, 0.03)


_LONGEST = 1.5


_STEPS = 60


def newton(
    log_density: Callable[[Array], Array],
    derivatives: Callable[[Array], tuple[Array, Array]],
    start: Array,
    *,
    least_curvature: float = 0.3,
    gain: float = 1e-6,
) -> Array:
    """A mode of a log density (n, h) → (n,), shape (h,), by damped Newton steps from a start;
    ``derivatives`` of a point: its gradient (h,) and Hessian (h, h).

    Directions of wrong curvature are turned round, none counts as flatter than ``least_curvature``,
    no step is longer than 1.5; of several fractions of a step, tried in one call, the best is
    taken. Steps end when the density rises by no more than ``gain`` [nat].
    """
    point = np.array(start, dtype=float)
    fractions = np.array(_FRACTIONS)
    value = float(log_density(point[None])[0])
    for _ in range(_STEPS):
        gradient, hessian = derivatives(point)
        curvature, vectors = np.linalg.eigh(-hessian)
        step = vectors @ ((vectors.T @ gradient) / np.maximum(np.abs(curvature), least_curvature))
        step *= min(1.0, _LONGEST / max(float(np.linalg.norm(step)), 1e-12))
        trials = log_density(point + fractions[:, None] * step)
        best = int(np.argmax(trials))
        if not trials[best] > value + gain:
            break
        point = point + fractions[best] * step
        value = float(trials[best])
    return point


def central_differences(
    function: Callable[[Array], Array], point: Array, step: float
) -> tuple[Array, Array]:
    """Gradient (h,) and Hessian (h, h) of a function (n, h) → (n,), all points in one call."""
    h = len(point)
    unit = np.eye(h) * step
    i, j = np.tril_indices(h, -1)
    corners = [a * unit[i] + b * unit[j] for a, b in ((1, 1), (1, -1), (-1, 1), (-1, -1))]
    values = function(point + np.concatenate([np.zeros((1, h)), unit, -unit, *corners]))
    plus = values[1 : h + 1]
    minus = values[h + 1 : 2 * h + 1]
    hessian = np.diag((plus + minus - 2 * values[0]) / step**2)
    a, b, c, d = values[2 * h + 1 :].reshape(4, -1)
    hessian[i, j] = hessian[j, i] = (a - b - c + d) / (4 * step**2)
    return (plus - minus) / (2 * step), hessian
