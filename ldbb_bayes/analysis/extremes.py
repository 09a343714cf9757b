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

from ldbb_bayes.results import Array

__all__ = ["CurveExtremes", "extremes_of", "without_noise_excess"]


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
    #: index of the point at which an uncertain curve is largest, for each posterior draw of the
    #: curve, shape (draws,)
    index_of_largest: Array
    #: index of the point at which an uncertain curve is smallest, for each posterior draw of the
    #: curve, shape (draws,)
    index_of_smallest: Array

    @property
    def width(self) -> Array:
        """Largest minus smallest value of each posterior draw of a curve, shape (draws,)."""
        return np.maximum(self.largest - self.smallest, 0.0)


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
        index_of_largest=curves.argmax(axis=1),
        index_of_smallest=curves.argmin(axis=1),
    )


def without_noise_excess(values: Array, at_mean: float) -> Array:
    """Return posterior draws of a quantity, shifted so that their mean is ``at_mean``.

    ``values``, shape (draws,), are draws of a quantity that noise makes too large or too small,
    such as the largest or the smallest value of a curve. ``at_mean`` is the value of this quantity
    for the posterior mean of the curve.
    """
    return np.asarray(values - (values.mean() - at_mean))
