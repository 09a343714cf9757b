"""Reduction of the readings of a circular test to at most 25 numbers.

The model describes readings at the angles θ by the 25 Fourier functions 1, cos θ, sin θ, …, cos
12θ, sin 12θ. Let B be the matrix of these functions at the n angles of a test, and B = Q R its QR
decomposition. All information that the readings carry about the model is contained in the at most
25 numbers Qᵀ · readings, and in the sum of squares of the part of the readings that the functions
cannot describe. This holds for any number of readings.
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

# Largest number of readings of a test that one QR decomposition reduces; it limits the memory used.
_CHUNK = 8192
# Departures of a circle from uniformly spaced angles (`NearUniform.departure`, without unit) are
# neglected if their absolute value is at most this number. They then change the log density of the
# readings by less than 1e-6.
_LEAST_DEPARTURE = 1e-6
# `NearUniform.departure` holds 25 numbers that describe how the angles of a test depart from
# uniform spacing. The test counts as an arc instead of a full circle if more than
# ``_MOST_DEPARTURES`` of these numbers are significant.
_MOST_DEPARTURES = 4
# Elements of the eigenvectors of RᵀR count as zero if their absolute value is at most this number,
# because they are then rounding errors. R is the triangular factor in the QR decomposition of the
# Fourier functions at the test's angles.
_ROUNDING = 1e-12


class NearUniform(NamedTuple):
    """Departure of the angles of a full circle from uniform spacing, for nearly uniform angles.

    R is the triangular factor in the QR decomposition of the 25 Fourier functions at the test's
    angles. At exactly uniform angles, RᵀR = S², where the diagonal matrix S holds the norms of
    these functions. At other angles, RᵀR = S (I + V Λ Vᵀ) S, where I is the identity matrix, V is
    orthogonal and Λ is diagonal. The diagonal elements λ of Λ describe how far the angles are from
    uniform spacing; they are called departures. All matrices have the shape (25, 25).
    """

    #: Diagonal of S: the norms that the Fourier functions have at uniform angles, shape (25,). A
    #: norm is the square root of the sum of squares over the angles of the test.
    column_norms: Array
    #: Diagonal elements λ of Λ, sorted so that the largest absolute value is first, shape (25,).
    departure: Array
    #: Orthogonal matrix V, shape (25, 25). Each column belongs to one element of ``departure``.
    directions: Array

    @property
    def significant(self) -> NDArray[np.bool_]:
        """Whether each of the numbers ``departure`` is too large to be neglected, shape (25,)."""
        return np.abs(self.departure) > _LEAST_DEPARTURE


@dataclass(frozen=True, eq=False)
class Reduced:
    """Readings of one test, reduced to at most 25 numbers by projection on the Fourier basis.

    The Fourier basis is a matrix B, shape (n, 25): the 25 Fourier functions at the test's n angles.
    With the QR decomposition B = Q R, the readings are projected on the columns of Q.
    """

    #: Reduced readings Qᵀ y [mm], shape (m,) with m = min(n, 25), where y are the n readings of the
    #: test. None for a planned test, which has no readings.
    reading_mm: Array | None
    #: Triangular factor R, shape (m, 25). It converts Fourier coefficients into reduced readings.
    factor: Array
    #: Sum of squares of the part of the readings that the Fourier functions cannot describe [mm²].
    residual_ss: float
    #: Number n of readings of the test, before they are reduced.
    readings: int

    @cached_property
    def near_uniform(self) -> NearUniform | None:
        """Departure of the test's angles from uniform spacing on a full circle.

        The value is None if the test is an arc, has fewer than 25 readings, or has angles that are
        spaced too unevenly.
        """
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
    """Return the readings of one test, reduced to at most 25 numbers and a sum of squares.

    The model describes readings by the 25 Fourier functions 1, cos θ, sin θ, …, sin 12θ. The matrix
    B of these functions at the test's angles has the QR decomposition B = Q R. The at most 25
    numbers are Qᵀ · readings; the sum of squares is computed from the part of the readings that the
    functions cannot describe. The result also holds the triangular factor R.

    Parameters
    ----------
    angle_rad
        Angles θ at which the n readings are taken, shape (n,) [rad]; they need not be uniform.
    reading_mm
        Readings, shape (n,) [mm]; None for a planned test, which has no readings.
    """
    n = len(angle_rad)
    readings = np.zeros(n) if reading_mm is None else reading_mm
    # Triangular factor of the QR decomposition of [B, readings], the matrix B with one more column.
    # It is updated with one chunk of readings after the other.
    triangle = np.zeros((0, SIZE + 1))
    for start in range(0, n, _CHUNK):
        chunk = slice(start, start + _CHUNK)
        rows = np.column_stack([basis(angle_rad[chunk]), readings[chunk]])
        stacked = np.vstack([triangle, rows])
        triangle = np.asarray(np.linalg.qr(stacked, mode="r"))
    m = min(n, SIZE)
    reduced_mm = None if reading_mm is None else triangle[:m, SIZE]
    residual_ss = float(triangle[SIZE, SIZE] ** 2) if n > SIZE else 0.0
    return Reduced(reduced_mm, triangle[:m, :SIZE], residual_ss, n)
