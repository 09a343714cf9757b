"""Least-squares circle and minimum zone of radial deviations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ldbb_bayes.errors import require
from ldbb_bayes.results import Array

__all__ = ["Zone", "least_squares_zone", "minimum_zone_width"]


_FEWEST = 3


_SIDES = ((-1.0, 0.0, 1.0), (1.0, 1.0, 0.0))


@dataclass(frozen=True)
class Zone:
    """A path about the centre of its least-squares circle: smallest and largest radial deviation
    from the nominal radius, and that of the least-squares circle, in the unit of the deviations."""

    lower: float
    upper: float
    mean: float

    @property
    def width(self) -> float:
        """Circular deviation G."""
        return self.upper - self.lower


def least_squares_zone(angle_rad: Array, deviation: Array) -> Zone:
    """The zone about the centre of the least-squares circle, of radial deviations at each angle,
    shape (n,), in any unit."""
    columns = _columns(angle_rad, deviation)
    mean, *centre = np.linalg.lstsq(columns, deviation, rcond=None)[0].tolist()
    rest = deviation - columns[:, 1:] @ centre
    return Zone(float(rest.min()), float(rest.max()), mean)


def minimum_zone_width(angle_rad: Array, deviation: Array) -> float:
    """Width of the zone about the centre that makes it narrowest: a linear programme, solved
    exactly."""
    from scipy.optimize import linprog

    columns = _columns(angle_rad, deviation)
    size = max(float(np.abs(deviation).max()), np.finfo(float).tiny)
    # Centre, lower, upper: lower ≤ ρ − a cos θ − b sin θ ≤ upper.
    sides = [
        sign * np.column_stack([columns[:, 1:], columns[:, :1] * low, columns[:, :1] * high])
        for sign, low, high in _SIDES
    ]
    limits = np.concatenate([-deviation, deviation]) / size
    solved = linprog(
        [0.0, 0.0, -1.0, 1.0], np.vstack(sides), limits, bounds=(None, None), method="highs"
    )
    require(
        solved.success,
        f"a minimum zone must exist, got none ({solved.message}). Check the readings.",
    )
    return float(np.ptp(deviation - columns[:, 1:] @ (np.asarray(solved.x)[:2] * size)))


def _columns(angle_rad: Array, deviation: Array) -> Array:
    require(
        len(deviation) >= _FEWEST and len(angle_rad) == len(deviation),
        f"a zone must have at least {_FEWEST} angles with a deviation each, got {len(deviation)}."
        " Give the trace.",
    )
    return np.column_stack([np.ones(len(angle_rad)), np.cos(angle_rad), np.sin(angle_rad)])
