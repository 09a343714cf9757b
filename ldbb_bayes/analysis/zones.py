"""Circles that enclose a path: the zone about the least-squares centre and the narrowest one.

Radial deviations are small beside R: a shift of the centre by (a, b) takes a cos θ + b sin θ from them (to e²/2R: 0.01 µm for a
circle 50 µm off centre).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from ldbb_bayes.errors import InputError

__all__ = ["Zone", "least_squares_zone", "minimum_zone", "minimum_zone_widths"]

Array = NDArray[Any]
_FEWEST = 3
_EXCHANGES = 200
_LEVEL = 1e-9
_SIGNS = np.array([1.0, -1.0, 1.0, -1.0])


@dataclass(frozen=True)
class Zone:
    """Two concentric circles that enclose a path.

    Attributes
    ----------
    centre : (a, b)
        Shift of their centre from the nominal one, in the unit of the deviations.
    lower, upper : float
        Smallest and largest radial deviation from the nominal radius about that centre.
    mean : float
        Mean of these for the minimum zone; radius of the least-squares circle less the nominal one.
    """

    centre: tuple[float, float]
    lower: float
    upper: float
    mean: float

    @property
    def width(self) -> float:
        """Circular deviation G."""
        return self.upper - self.lower


def least_squares_zone(angle_rad: Array, deviation: Array) -> Zone:
    """About the centre of the least-squares circle.

    Parameters
    ----------
    angle_rad, deviation : ndarray, shape (n,)
        Radial deviation of the path from the nominal circle at each angle; any unit.
    """
    columns = _columns(angle_rad, deviation)
    mean, a, b = np.linalg.lstsq(columns, deviation, rcond=None)[0]
    rest = deviation - columns[:, 1:] @ [a, b]
    return Zone((float(a), float(b)), float(rest.min()), float(rest.max()), float(mean))


def minimum_zone(angle_rad: Array, deviation: Array) -> Zone:
    """About the centre that makes the zone narrowest: a linear programme, solved exactly."""
    columns = _columns(angle_rad, deviation)
    size = max(float(np.abs(deviation).max()), np.finfo(float).tiny)
    scaled, ones = deviation / size, np.ones(len(deviation))
    # a, b, lower, upper: lower ≤ ρ − a cos θ − b sin θ ≤ upper.
    above = np.column_stack([-columns[:, 1:], 0.0 * ones, -ones])
    below = np.column_stack([columns[:, 1:], ones, 0.0 * ones])
    solved = linprog(
        [0.0, 0.0, -1.0, 1.0], np.vstack([above, below]), np.concatenate([-scaled, scaled]), bounds=(None, None), method="highs"
    )
    if solved.x is None or not solved.success:
        raise InputError(f"a minimum zone must exist, got none ({solved.message}). Check the readings.")
    a, b = solved.x[:2] * size
    rest = deviation - columns[:, 1:] @ [a, b]
    lower, upper = float(rest.min()), float(rest.max())
    return Zone((float(a), float(b)), lower, upper, 0.5 * (lower + upper))


def minimum_zone_widths(angle_rad: Array, deviations: Array) -> Array:
    """Widths of the minimum zones of many full circles at once.

    1, cos θ, sin θ satisfy Haar's condition, so the best fit deviates equally, with alternating sign, at four angles; they are
    found by exchanging one at a time for where the deviation is largest.

    Parameters
    ----------
    angle_rad : ndarray, shape (n,)
        Different angles, rising, within one turn.
    deviations : ndarray, shape (traces, n)

    Returns
    -------
    ndarray, shape (traces,)
    """
    deviations = np.atleast_2d(deviations)
    columns = _columns(angle_rad, deviations[0])
    at = np.tile(np.arange(4) * len(angle_rad) // 4, (len(deviations), 1))
    found = np.zeros(len(deviations))
    left = np.arange(len(deviations))
    for _ in range(_EXCHANGES):
        own, trace = at[left], deviations[left]
        matrix = np.concatenate([columns[own], np.broadcast_to(_SIGNS[:, None], (len(left), 4, 1))], axis=2)
        solved = np.linalg.solve(matrix, np.take_along_axis(trace, own, axis=1)[..., None])[..., 0]
        rest = trace - solved[:, :3] @ columns.T
        worst = np.abs(rest).argmax(axis=1)
        largest = np.take_along_axis(np.abs(rest), worst[:, None], axis=1)[:, 0]
        found[left] = 2.0 * largest
        open_ = largest > np.abs(solved[:, 3]) * (1.0 + _LEVEL) + _LEVEL * np.abs(trace).max(axis=1)
        deviation = np.take_along_axis(rest, worst[:, None], axis=1)[:, 0]
        at[left] = np.where(open_[:, None], _exchanged(own, worst, deviation, solved[:, 3]), own)
        left = left[open_]
        if not len(left):
            break
    return found


def _exchanged(points: Array, new: Array, deviation: Array, level: Array) -> Array:
    """Four points a trace (n, 4), the one beside ``new`` that deviates to the same side replaced by it; the first deviates by
    ``level``."""
    sign = np.where(level < 0.0, -1.0, 1.0)[:, None] * _SIGNS
    place = (points < new[:, None]).sum(axis=1)
    before, after = (place - 1) % 4, place % 4
    rows = np.arange(len(points))
    replaced = np.where(sign[rows, before] * deviation > 0.0, before, after)
    points = points.copy()
    points[rows, replaced] = new
    return np.sort(points, axis=1)


def _columns(angle_rad: Array, deviation: Array) -> Array:
    if len(deviation) < _FEWEST or len(angle_rad) != len(deviation):
        raise InputError(
            f"a zone must have at least {_FEWEST} angles with a deviation each, got {len(deviation)}. Give the trace."
        )
    return np.column_stack([np.ones(len(angle_rad)), np.cos(angle_rad), np.sin(angle_rad)])
