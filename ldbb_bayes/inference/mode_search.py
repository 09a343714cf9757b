"""Search for the modes (maxima) of the posterior density of the hyper-parameters.

The density is a function of the normal scores of the h hyper-parameters (module `normal_scores`).
In these coordinates every prior is standard normal, except the priors of noise factors. A noise
factor is a hyper-parameter that multiplies the noise of one circle.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.model.newton import central_differences, newton
from ldbb_bayes.results import Array

__all__ = ["Mode", "ModeSearch"]

# Step of central differences, from which derivatives of the log density are computed, in units of
# normal scores.
_DIFFERENCE_STEP = 0.05
# If a curvature (negative second derivative) of the log density is below this value, it is replaced
# by this value.
_LEAST_CURVATURE = 0.3
# The search for a mode (maximum) ends when a step increases the log density by at most this value
# [nat].
_MODE_GAIN = 1e-5
# The starting points of the search are chosen from this fraction of all points, those of highest
# density.
_BEST_SHARE = 0.25
# Largest number of starting points of the search for modes (maxima).
_BASINS = 3
# Two modes (maxima), or two starting points of the search for modes, count as separate if their
# distance in normal scores exceeds this value.
_SEPARATION = 1.5
# Another maximum of the log density is negligible if it is lower than the highest maximum by this
# value [nat] or more.
_NEGLIGIBLE_DEPTH = 12.0
# Maxima are also sought with one hyper-parameter held near zero. The coordinate of this
# hyper-parameter is held below its value at the mode by this number of posterior standard
# deviations.
_BELOW_MODE = 4.0
# The density may have a further maximum where one hyper-parameter is near zero. It is not searched
# for if, at the point where the search would start, the log density is lower than at the mode by
# more than ``_NEGLIGIBLE_START`` [nat]. If it is found, it is neglected if it is lower than the
# mode by at least ``_NEGLIGIBLE_CORNER`` [nat].
_NEGLIGIBLE_START = 12.0
_NEGLIGIBLE_CORNER = 8.0
# Such a search ends when a step increases the log density by at most this value [nat].
_CORNER_GAIN = 1e-2


class Mode(NamedTuple):
    """Mode (maximum) of a log density of h coordinates, with its curvature."""

    point: Array  #: coordinates of the mode, shape (h,)
    #: square root of the inverse of minus the Hessian of the log density at the mode, shape (h, h).
    #: Eigenvalues of minus the Hessian that are below 0.3 are first replaced by 0.3.
    root: Array


class ModeSearch:
    """Search for the modes of a smooth log density of normal scores.

    Parameters
    ----------
    log_density : callable
        Function that returns the log density, shape (w,), at w points, shape (w, h).
    is_noise_factor : ndarray of bool, shape (h,)
        Whether a coordinate belongs to a factor that multiplies the noise of one circle. Two noise
        factors hardly depend on each other. In the search, mixed second derivatives with respect to
        two noise factors are therefore taken as zero. The work then grows only in proportion to the
        number of circles.
    """

    def __init__(
        self, log_density: Callable[[Array], Array], is_noise_factor: NDArray[np.bool_]
    ) -> None:
        """Describe the search for modes of ``log_density``; nothing is computed yet.

        ``is_noise_factor``, shape (h,), is true for coordinates of noise factors of circles.
        """
        self._log_density = log_density
        self._is_noise_factor = is_noise_factor

    def starts(self, points: Array) -> list[Array]:
        """Return starting points for `modes`, at most three of the given points.

        They are chosen for their high density and for a sufficient distance from each other.
        ``points`` has the shape (w, h), each starting point the shape (h,).
        """
        highest_first = points[np.argsort(-self._log_density(points))]
        chosen: list[Array] = []
        for point in highest_first[: int(_BEST_SHARE * len(points))]:
            if len(chosen) < _BASINS and _is_separate(point, chosen):
                chosen.append(point)
        return chosen

    def modes(self, starts: Sequence[Array]) -> list[Mode]:
        """Return the modes that are reached from the starting points, the highest first.

        Modes that are lower than the highest by 12 nat or more are left out. Each of ``starts`` has
        the shape (h,).
        """
        summits: list[Array] = []

        def is_known(point: Array) -> bool:
            # Whether a point of the search is near a maximum that has been reached from an earlier
            # starting point.
            return not _is_separate(point, summits)

        for start in starts:
            summit = newton(
                self._log_density,
                self._derivatives,
                start,
                least_curvature=_LEAST_CURVATURE,
                gain=_MODE_GAIN,
                stop=is_known,
            )
            summits.append(summit)
        height = self._log_density(np.array(summits))
        chosen: list[Array] = []
        for k in np.argsort(-height):
            is_high = height[k] > height.max() - _NEGLIGIBLE_DEPTH
            if is_high and _is_separate(summits[k], chosen):
                chosen.append(summits[k])
        return [self._described(point) for point in chosen]

    def corners(self, mode: Mode, axes: Sequence[int] | NDArray[np.intp]) -> list[Mode]:
        """Return the maxima with one coordinate held far below its value at the highest mode.

        There is at most one maximum for each of the ``axes``, the indices of the coordinates that
        are held. Negligible maxima are left out.
        """
        sd = np.sqrt((mode.root**2).sum(axis=1))
        starts = mode.point - _BELOW_MODE * np.diag(sd)[axes]
        heights = self._log_density(np.concatenate([mode.point[None], starts]))
        corners: list[Mode] = []
        for axis, start, height in zip(axes, starts, heights[1:], strict=True):
            if height < heights[0] - _NEGLIGIBLE_START:
                continue
            corner = newton(
                self._log_density,
                self._derivatives_at_fixed(int(axis)),
                start,
                least_curvature=_LEAST_CURVATURE,
                gain=_CORNER_GAIN,
            )
            if self._log_density(corner[None])[0] > heights[0] - _NEGLIGIBLE_CORNER:
                corners.append(self._described(corner))
        return corners

    def _described(self, point: Array) -> Mode:
        """Return a maximum at ``point``, shape (h,), with its curvature."""
        _, hessian = self._derivatives(point, exact=True)
        return Mode(point, _inverse_root(hessian))

    def _derivatives_at_fixed(self, axis: int) -> Callable[[Array], tuple[Array, Array]]:
        """Return a function that computes derivatives with respect to all but one coordinate.

        The function returns gradient and Hessian, shapes (h,) and (h, h). All derivatives with
        respect to the coordinate with the index ``axis`` are set to zero, so that a search for a
        maximum does not change this coordinate.
        """
        may_change = np.arange(len(self._is_noise_factor)) != axis

        def derivatives(point: Array) -> tuple[Array, Array]:
            # Return gradient and Hessian at a point. All derivatives with respect to the coordinate
            # ``axis``, which is held constant, are set to zero.
            gradient, hessian = self._derivatives(point)
            both_may_change = np.outer(may_change, may_change)
            return np.where(may_change, gradient, 0.0), np.where(both_may_change, hessian, 0.0)

        return derivatives

    def _derivatives(self, point: Array, *, exact: bool = False) -> tuple[Array, Array]:
        """Return the gradient and the Hessian of the log density, shapes (h,) and (h, h).

        ``point`` has the shape (h,). If ``exact`` is False, mixed second derivatives with respect
        to two noise factors are set to zero.
        """
        coupled = np.ones((len(point), len(point)), dtype=bool)
        if not exact:
            coupled = ~np.outer(self._is_noise_factor, self._is_noise_factor)
        return central_differences(self._log_density, point, _DIFFERENCE_STEP, coupled=coupled)


def _is_separate(point: Array, points: list[Array]) -> bool:
    """Return whether a point, shape (h,), is farther than 1.5 from each of ``points``."""
    return all(np.linalg.norm(point - other) > _SEPARATION for other in points)


def _inverse_root(hessian: Array) -> Array:
    """Return a square root of the matrix (−H)⁻¹, shape (h, h), for the Hessian H of a log density.

    Eigenvalues of −H that are below 0.3 are first replaced by 0.3.
    """
    curvature, vectors = np.linalg.eigh(-hessian)
    return np.asarray(vectors / np.sqrt(np.maximum(curvature, _LEAST_CURVATURE)))
