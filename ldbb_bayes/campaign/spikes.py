"""Spikes: readings of a test that are far from a curve fitted to the other readings.

The curve is a sum of functions of the angle, usually a Fourier series. It is fitted to the n
readings of a test by least squares, without the spikes. Readings that are no spikes are called
regular.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.results import Array

__all__ = ["SERIES_ORDER", "CurveFit", "fit_regular_readings", "regular_readings"]

# Highest order of the Fourier series that is fitted to the readings of a test.
SERIES_ORDER = 12
# A reading is a spike if it deviates from the Fourier series fitted to its test by more than this
# number of standard deviations. The standard deviation is that of the readings about the series.
_SPIKE_SCATTERS = 8.0
# Spikes are searched for in two steps. The first step makes this number of fits, and gives the
# readings new weights after each fit. The second step makes at most this number of fits. Each of
# them leaves out the spikes that the previous fit shows; the step ends when the spikes no longer
# change.
_MAX_ROUNDS = 20
# Ratio of the standard deviation of a normal distribution to its median absolute deviation (MAD).
# The MAD of readings times this factor is an estimate of their standard deviation.
_SD_PER_MAD = 1.4826


class CurveFit(NamedTuple):
    """Result of a least-squares fit of a curve to the n readings of a test, without its spikes.

    The curve is a sum of k functions of the angle.
    """

    coefficients: Array  #: coefficients of the k functions, shape (k,)
    #: deviations of the n readings from the curve, spikes included [µm], shape (n,)
    deviation: Array
    scatter: float  #: standard deviation of the readings about the curve, without spikes [µm]


def fit_regular_readings(columns: Array, reading: Array, regular: NDArray[np.bool_]) -> CurveFit:
    """Fit a curve to the n readings of a test by least squares, without the spikes.

    ``columns`` (n, k) are the values of the k fitted functions at the angles of the readings, and
    ``reading`` (n,) [µm] are the readings. ``regular`` is a mask of the readings, shape (n,), that
    is false for spikes.
    """
    solution = np.linalg.lstsq(columns[regular], reading[regular], rcond=1e-9)
    coefficients: Array = solution[0].astype(float)
    deviation = reading - columns @ coefficients
    freedom = np.count_nonzero(regular) - columns.shape[1]
    scatter = float(np.sqrt(np.sum(deviation[regular] ** 2) / freedom))
    return CurveFit(coefficients, deviation, scatter)


def regular_readings(columns: Array, reading: Array) -> NDArray[np.bool_]:
    """Return a mask of the n readings of a test, shape (n,), that is false for spikes.

    A reading is a spike if it deviates from a fitted curve by more than eight standard deviations.
    The first curve minimises the sum of absolute deviations. Then the spikes are left out and a new
    curve is fitted by least squares. This step is repeated until the set of spikes no longer
    changes, at most 20 times. ``columns`` (n, k) are the values of the k fitted functions at the
    angles of the readings, and ``reading`` (n,) [µm] are the readings.
    """
    deviation, p = _least_absolute_deviations(columns, reading)
    regular = np.ones(len(reading), dtype=bool)
    for _ in range(_MAX_ROUNDS):
        # The first fitted curve is a weighted sum of p functions. Because it minimises the sum of
        # absolute deviations, it passes exactly through p of the readings. These readings say
        # nothing about the scatter and are left out.
        scatter = _SD_PER_MAD * float(np.median(np.sort(np.abs(deviation))[p:]))
        previous = regular
        regular = np.abs(deviation) <= _SPIKE_SCATTERS * max(scatter, 1e-9)
        if np.array_equal(previous, regular) or np.count_nonzero(regular) <= p:
            break
        deviation = fit_regular_readings(columns, reading, regular).deviation
    return regular


def _least_absolute_deviations(columns: Array, reading: Array) -> tuple[Array, int]:
    """Return the deviations of n readings from a robust fit, and the rank of ``columns``.

    The fit minimises the sum of absolute deviations, by iteratively reweighted least squares.
    ``columns`` (n, k) are the values of the k fitted functions at the angles of the readings,
    and ``reading`` (n,) are the readings. The deviations have the shape (n,).
    """
    basis, size, _ = np.linalg.svd(columns, full_matrices=False)
    basis = basis[:, size > 1e-9 * size[0]]
    deviation = reading - basis @ (basis.T @ reading)
    for _ in range(_MAX_ROUNDS):
        distance = np.abs(deviation)
        weight = 1.0 / np.maximum(distance, 1e-6 * distance.max() + 1e-12)
        normal_matrix = (basis.T * weight) @ basis
        coefficients = np.linalg.solve(normal_matrix, basis.T @ (weight * reading))
        deviation = reading - basis @ coefficients
    return deviation, basis.shape[1]
