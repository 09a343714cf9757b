"""Least-squares circle and minimum zone of radial deviations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linprog

from ldbb_bayes.errors import require
from ldbb_bayes.results import Array

__all__ = ["Zone", "least_squares_zone", "minimum_zone_width"]

# Minimum number of angles from which a circle is computed: three points determine its centre and
# radius.
_FEWEST_ANGLES = 3


@dataclass(frozen=True)
class Zone:
    """Range of the radial deviations of a path, about the centre of the least-squares circle.

    All values are in the unit of the radial deviations.
    """

    #: smallest distance of the machine's tool path from the centre of its least-squares circle,
    #: minus the nominal radius
    lower: float
    #: largest distance of the machine's tool path from the centre of its least-squares circle,
    #: minus the nominal radius
    upper: float
    #: radius of the least-squares circle of the machine's tool path, minus the nominal radius
    mean: float

    @property
    def width(self) -> float:
        """Circular deviation G: the largest minus the smallest radial deviation."""
        return self.upper - self.lower


def least_squares_zone(angle_rad: Array, deviation: Array) -> Zone:
    """Return the range of radial deviations about the centre of the least-squares circle.

    ``deviation``, shape (n,), are the radial deviations at the angles ``angle_rad``, shape (n,).
    The deviations may have any unit; the result has the same unit.
    """
    columns = _circle_columns(angle_rad, deviation)
    mean, *centre = np.linalg.lstsq(columns, deviation, rcond=None)[0].tolist()
    centred = deviation - columns[:, 1:] @ centre
    return Zone(float(centred.min()), float(centred.max()), mean)


def minimum_zone_width(angle_rad: Array, deviation: Array) -> float:
    """Return the width of the narrowest ring, about any centre, that contains a path.

    ``deviation``, shape (n,), are the radial deviations ρ of the path at the angles θ
    (``angle_rad``, shape (n,)). A linear programme finds the centre (a, b) of the ring and its
    limits ``lower`` and ``upper`` that make ``upper - lower`` smallest, subject to
    ``lower`` ≤ ρ − a cos θ − b sin θ ≤ ``upper``. The width has the unit of the deviations.
    """
    columns = _circle_columns(angle_rad, deviation)
    scale = max(float(np.abs(deviation).max()), np.finfo(float).tiny)
    ones = columns[:, :1]
    zeros = 0.0 * ones
    centre = columns[:, 1:]
    # The linear programme for the minimum zone (the narrowest ring that contains the path) has four
    # unknowns: the two coordinates of the ring's centre, and the lower and the upper limit of the
    # radial deviations in the ring.
    below_upper = -np.column_stack([centre, zeros, ones])
    above_lower = np.column_stack([centre, ones, zeros])
    limits = np.concatenate([-deviation, deviation]) / scale
    solution = linprog(
        [0.0, 0.0, -1.0, 1.0],
        np.vstack([below_upper, above_lower]),
        limits,
        bounds=(None, None),
        method="highs",
    )
    require(
        solution.success,
        f"a minimum zone must exist, got none ({solution.message}). Check the readings.",
    )
    best_centre = np.asarray(solution.x)[:2] * scale
    return float(np.ptp(deviation - centre @ best_centre))


def _circle_columns(angle_rad: Array, deviation: Array) -> Array:
    """Return the design matrix of a circle with the columns 1, cos θ and sin θ, shape (n, 3).

    Each row belongs to one angle θ of ``angle_rad``. Raise an `InputError` for fewer than three
    angles, and if the numbers of angles and deviations differ.
    """
    require(
        len(deviation) >= _FEWEST_ANGLES and len(angle_rad) == len(deviation),
        f"a zone must have at least {_FEWEST_ANGLES} angles with a deviation each, got"
        f" {len(angle_rad)} angles and {len(deviation)} deviations. Give the trace.",
    )
    return np.column_stack([np.ones(len(angle_rad)), np.cos(angle_rad), np.sin(angle_rad)])
