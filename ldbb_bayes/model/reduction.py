"""Readings of a circular test reduced to the circle's basis.

Every column of the model is a polynomial in the basis, so that a test is 25 coefficients wide
whatever its number of readings.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.model.fourier import ORDERS, SIZE, basis
from ldbb_bayes.results import Array

__all__ = ["NearUniform", "Reduced", "reduce_readings"]

# Readings that are projected at once: bounded memory.
_CHUNK = 8192
# A departure from uniform sampling of this size changes a log density by 1e-6.
_LEAST_DEPARTURE = 1e-6
# With more departures than these a circle counts as an arc.
_MOST_DEPARTURES = 4
# Entries of directions below this size are rounding.
_ROUNDING = 1e-12


class NearUniform(NamedTuple):
    """A nearly uniform full circle: RᵀR = S (1 + V λ Vᵀ) S.

    S V are those of a uniform circle where λ is zero.
    """

    #: Diagonal of S, the norms of the basis functions on a uniform circle, shape (25,).
    column_norms: Array
    #: λ, the largest first, shape (25,); positive where readings lie closer than elsewhere.
    departure: Array
    #: V, shape (25, 25).
    directions: Array

    @property
    def significant(self) -> NDArray[np.bool_]:
        """Which departures change a log density by more than 1e-6."""
        return np.abs(self.departure) > _LEAST_DEPARTURE


@dataclass(frozen=True, eq=False)
class Reduced:
    """One test after projection on the basis."""

    #: z = Qᵀ y [mm], m = min(n, 25) numbers; None of a planned test.
    projection: Array | None
    #: R of the basis at the test's angles, B = Q R, shape (m, 25).
    factor: Array
    #: Sum of squares outside the basis [mm²].
    residual_ss: float
    #: Number of readings n.
    readings: int

    @cached_property
    def near_uniform(self) -> NearUniform | None:
        """How the circle departs from a uniform one; None of arcs and of few readings."""
        if self.readings < SIZE:
            return None
        root = np.where(ORDERS == 0, 1.0, np.sqrt(0.5))
        gram = self.factor.T @ self.factor
        eigenvalues, vectors = np.linalg.eigh(gram / np.outer(root, root))
        middle = np.median(eigenvalues)
        departure = eigenvalues / middle - 1.0
        order = np.argsort(-np.abs(departure), kind="stable")
        directions = np.where(np.abs(vectors) > _ROUNDING, vectors, 0.0)
        circle = NearUniform(np.sqrt(middle) * root, departure[order], directions[:, order])
        if np.count_nonzero(circle.significant) > _MOST_DEPARTURES or eigenvalues[0] <= 0.0:
            return None
        return circle


def reduce_readings(angle_rad: Array, reading_mm: Array | None) -> Reduced:
    """Project one test on the basis, however its circle is sampled.

    Parameters
    ----------
    angle_rad
        Angles, shape (n,) [rad].
    reading_mm
        Readings, shape (n,) [mm]; None of a planned test.
    """
    n = len(angle_rad)
    readings = np.zeros(n) if reading_mm is None else reading_mm
    triangle = np.zeros((0, SIZE + 1))
    for start in range(0, n, _CHUNK):
        chunk = slice(start, start + _CHUNK)
        rows = np.column_stack([basis(angle_rad[chunk]), readings[chunk]])
        stacked = np.vstack([triangle, rows])
        triangle = np.asarray(np.linalg.qr(stacked, mode="r"))
    m = min(n, SIZE)
    projection = None if reading_mm is None else triangle[:m, SIZE]
    residual_ss = float(triangle[SIZE, SIZE] ** 2) if n > SIZE else 0.0
    return Reduced(projection, triangle[:m, :SIZE], residual_ss, n)
