"""Newton's method for the mode (the maximum) of a log density."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.results import Array

__all__ = ["central_differences", "newton"]

# In the search for the maximum of a log density, these fractions of each Newton step are tried
# simultaneously. The fraction with the largest density is used. The fraction zero gives the density
# at the point from which the step starts.
_FRACTIONS = (0.0, 1.0, 0.5, 0.25, 0.1, 0.03)
# Longest permitted Newton step in the search for the maximum of a log density, as a distance in the
# coordinates of the density. If a coordinate is the logarithm of a scale, a step of this length
# multiplies or divides the scale by 4.5.
_LONGEST_STEP = 1.5
# Maximum number of Newton steps in the search for a mode. From a good starting point, ten are
# enough.
_STEPS = 60


def newton(
    log_density: Callable[[Array], Array],
    derivatives: Callable[[Array], tuple[Array, Array]],
    start: Array,
    *,
    least_curvature: float = 0.3,
    gain: float = 1e-6,
    stop: Callable[[Array], bool] | None = None,
) -> Array:
    """Return a mode (local maximum) of a log density of h coordinates, shape (h,).

    The mode is computed by damped Newton steps. The curvatures (eigenvalues of the negative
    Hessian) are replaced by their absolute values, or by ``least_curvature`` if this is larger, so
    that every step leads uphill. No step is longer than 1.5. Several fractions of each step are
    tried, and the fraction with the largest density is used. The search ends after at most 60
    steps.

    Parameters
    ----------
    log_density
        Function that takes n points (n, h) and returns their log densities (n,).
    derivatives
        Function that takes a point (h,) and returns the gradient (h,) and the Hessian (h, h) of the
        log density there.
    start
        Point where the search starts, shape (h,).
    least_curvature
        Lower limit of the curvatures with which a step is computed.
    gain
        The search ends when a step raises the log density by at most this amount [nat].
    stop
        Function that takes a point (h,) and returns whether the search may end there, for example
        because the point is near a mode that is already known.
    """
    point = np.array(start, dtype=float)
    fractions = np.array(_FRACTIONS)
    for _ in range(_STEPS):
        gradient, hessian = derivatives(point)
        curvature, vectors = np.linalg.eigh(-hessian)
        bounded_curvature = np.maximum(np.abs(curvature), least_curvature)
        step = vectors @ ((vectors.T @ gradient) / bounded_curvature)
        length = max(float(np.linalg.norm(step)), 1e-12)
        step *= min(1.0, _LONGEST_STEP / length)
        trials = log_density(point + fractions[:, None] * step)
        best = int(np.argmax(trials))
        if not trials[best] > trials[0] + gain:
            break
        point = point + fractions[best] * step
        if stop is not None and stop(point):
            break
    return point


def central_differences(
    function: Callable[[Array], Array],
    point: Array,
    step: float,
    *,
    coupled: NDArray[np.bool_] | None = None,
) -> tuple[Array, Array]:
    """Return gradient (h,) and Hessian (h, h) of a function at a point, by central differences.

    The function has h coordinates. The mixed derivative with respect to coordinates i and j needs
    two further points: at one point both coordinates are increased, at the other both are
    decreased.

    Parameters
    ----------
    function
        Function that takes n points (n, h) and returns its values there (n,). It is called once,
        with all points that the differences need.
    point
        Point where the derivatives are computed, shape (h,).
    step
        Distance between neighbouring points at which the function is computed, the same for every
        coordinate.
    coupled
        Whether the mixed derivative is computed for each pair of coordinates, shape (h, h),
        symmetric. For all other pairs, the mixed derivative is set to zero. By default it is
        computed for all pairs.
    """
    h = len(point)
    steps = np.eye(h) * step
    if coupled is None:
        coupled = np.ones((h, h), dtype=bool)
    i, j = np.nonzero(np.tril(coupled, -1))
    both = steps[i] + steps[j]
    values = function(point + np.concatenate([np.zeros((1, h)), steps, -steps, both, -both]))
    middle = values[0]
    forward = values[1 : h + 1]
    backward = values[h + 1 : 2 * h + 1]
    second = forward + backward - 2.0 * middle
    both_forward, both_backward = values[2 * h + 1 :].reshape(2, -1)
    second_along_both = both_forward + both_backward - 2.0 * middle
    mixed = (second_along_both - second[i] - second[j]) / (2.0 * step**2)
    hessian = np.diag(second / step**2)
    hessian[i, j] = mixed
    hessian[j, i] = mixed
    return (forward - backward) / (2.0 * step), hessian
