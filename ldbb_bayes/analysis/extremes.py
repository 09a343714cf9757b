"""Largest and smallest value of an uncertain curve.

Each posterior draw of the curve is the mean curve plus an error, here called noise. Noise raises
some points of the curve and lowers others, and the largest value is often one of the raised points.
The largest values of the draws are therefore too large on average. Their mean exceeds the largest
value of the mean curve by about the size of the noise. In the same way, the smallest values are too
small.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ldbb_bayes.analysis.circle_columns import ANGLE_RAD
from ldbb_bayes.model.fourier import basis, derivative
from ldbb_bayes.results import Array

__all__ = [
    "CircleExtremes",
    "CurveExtremes",
    "extremes_of",
    "extremes_on_circle",
    "without_noise_excess",
]

# Number of Newton steps from the best of the angles 0°, 1° … 359° to the angle at which a curve is
# largest. Each step squares the error, so that three steps reach the precision of the computer.
_NEWTON_STEPS = 3


@dataclass(frozen=True)
class CurveExtremes:
    """Posterior draws of the largest and smallest value of a curve, corrected for their bias.

    The draws scatter about the mean curve. Without the correction, the largest values are therefore
    too large on average, and the smallest values too small.
    """

    #: posterior draws of the largest value of an uncertain curve, shape (draws,), in the unit of
    #: the curve
    largest: Array
    #: posterior draws of the smallest value of an uncertain curve, shape (draws,), in the unit of
    #: the curve
    smallest: Array

    @property
    def width(self) -> Array:
        """Largest minus smallest value of each posterior draw of a curve, shape (draws,)."""
        return np.maximum(self.largest - self.smallest, 0.0)


@dataclass(frozen=True)
class CircleExtremes(CurveExtremes):
    """Posterior draws of the extremes of a curve around a circle, and of their angles."""

    #: angle at which an uncertain curve around a circle is largest, for each posterior draw of the
    #: curve, shape (draws,) [rad]; it may lie slightly below 0 or above 2π
    angle_of_largest_rad: Array
    #: angle at which an uncertain curve around a circle is smallest, for each posterior draw of the
    #: curve, shape (draws,) [rad]; it may lie slightly below 0 or above 2π
    angle_of_smallest_rad: Array


def extremes_on_circle(curves: Array) -> CircleExtremes:
    """Return draws of the extremes of a curve around a circle, and of the angles of the extremes.

    ``curves``, shape (draws, 25), holds the Fourier coefficients of posterior draws of the curve.
    The angles are exact, and not only the best of a set of angles. The largest and the smallest
    values are corrected for their bias, as in `extremes_of`.
    """
    angle_of_largest_rad = _angle_of_largest(curves)
    angle_of_smallest_rad = _angle_of_largest(-curves)
    mean_curve = curves.mean(axis=0, keepdims=True)
    largest_of_mean = _values_at(mean_curve, _angle_of_largest(mean_curve))
    smallest_of_mean = _values_at(mean_curve, _angle_of_largest(-mean_curve))
    largest = _values_at(curves, angle_of_largest_rad)
    smallest = _values_at(curves, angle_of_smallest_rad)
    return CircleExtremes(
        largest=without_noise_excess(largest, float(largest_of_mean[0])),
        smallest=without_noise_excess(smallest, float(smallest_of_mean[0])),
        angle_of_largest_rad=angle_of_largest_rad,
        angle_of_smallest_rad=angle_of_smallest_rad,
    )


def _angle_of_largest(curves: Array) -> Array:
    """Return the angle at which each curve around a circle is largest, shape (draws,) [rad].

    ``curves``, shape (draws, 25), holds the Fourier coefficients of the curves. Newton's method
    finds the zero of the first derivative next to the best of the angles 0°, 1° … 359°. Where a
    curve is flat, this best angle itself is returned.
    """
    slopes = derivative(curves)
    curvatures = derivative(slopes)
    best_rad = ANGLE_RAD[np.argmax(curves @ basis(ANGLE_RAD).T, axis=1)]
    farthest_rad = ANGLE_RAD[1]
    angle_rad = best_rad
    for _ in range(_NEWTON_STEPS):
        slope = _values_at(slopes, angle_rad)
        curvature = _values_at(curvatures, angle_rad)
        step_rad = np.divide(
            slope, curvature, out=np.zeros_like(slope), where=np.asarray(curvature < 0.0)
        )
        angle_rad = np.clip(angle_rad - step_rad, best_rad - farthest_rad, best_rad + farthest_rad)
    return np.asarray(angle_rad)


def _values_at(curves: Array, angle_rad: Array) -> Array:
    """Return the value of each curve around a circle at an angle of its own, shape (draws,).

    ``curves``, shape (draws, 25), holds the Fourier coefficients of the curves, and ``angle_rad``,
    shape (draws,), one angle for each curve [rad].
    """
    return np.einsum("dk,dk->d", curves, basis(angle_rad))


def extremes_of(curves: Array) -> CurveExtremes:
    """Return draws of the largest and the smallest value of a curve, corrected for their bias.

    ``curves``, shape (draws, points), are posterior draws of the curve. On average, noise makes the
    largest value of a draw too large, and the smallest value too small. All largest values are
    therefore shifted so that their mean equals the largest value of the mean curve; the smallest
    values are shifted in the same way.
    """
    mean_curve = curves.mean(axis=0)
    return CurveExtremes(
        largest=without_noise_excess(curves.max(axis=1), mean_curve.max()),
        smallest=without_noise_excess(curves.min(axis=1), mean_curve.min()),
    )


def without_noise_excess(values: Array, at_mean: float) -> Array:
    """Return posterior draws of a quantity, shifted so that their mean is ``at_mean``.

    ``values``, shape (draws,), are draws of a quantity that noise makes too large or too small,
    such as the largest or the smallest value of a curve. ``at_mean`` is the value of this quantity
    for the posterior mean of the curve.
    """
    return np.asarray(values - (values.mean() - at_mean))
