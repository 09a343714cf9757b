"""Readings → a few numbers per test.

y = B a + ε with ε ~ N(0, σ² I) and B = Q R: z = Qᵀ y ~ N(R a, σ² I) and the residual sum of squares ‖y − Q z‖² hold all
that y says about a and σ. For n readings z has min(n, 25) entries; the rest of the model never sees n again.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.model.basis import SIZE, basis

__all__ = ["Reduced", "reduce_readings"]

Array = NDArray[Any]

_CHUNK = 8192
_ORTHOGONAL = 1e-9


@dataclass(frozen=True, eq=False)
class Reduced:
    """One test after projection on the basis.

    Attributes
    ----------
    projection : ndarray, shape (m,), or None for a planned test
        z = Qᵀ y [mm], m = min(n, 25).
    factor : ndarray, shape (m, 25)
        R of the QR factorisation of the basis at the test's angles.
    residual_ss : float
        Squares left outside the basis [mm²].
    readings : int
        n.
    """

    projection: Array | None
    factor: Array
    residual_ss: float
    readings: int

    @property
    def is_orthogonal(self) -> bool:
        """True when the sampling makes the basis functions orthogonal (a uniform full circle with n ≥ 25)."""
        if self.readings < SIZE:
            return False
        gram = self.factor.T @ self.factor
        off = gram - np.diag(np.diag(gram))
        return bool(np.abs(off).max() <= _ORTHOGONAL * self.readings)


def reduce_readings(angle_rad: Array, reading_mm: Array | None) -> Reduced:
    """Project one test on the basis; any sampling of the circle, in chunks of bounded memory.

    Parameters
    ----------
    angle_rad : ndarray, shape (n,) [rad]
    reading_mm : ndarray, shape (n,) [mm], or None
    """
    n = len(angle_rad)
    stack = np.zeros((0, SIZE + 1))
    for start in range(0, n, _CHUNK):
        part = slice(start, start + _CHUNK)
        reading = np.zeros(len(angle_rad[part])) if reading_mm is None else reading_mm[part]
        rows = np.column_stack([basis(angle_rad[part]), reading])
        stack = np.asarray(np.linalg.qr(np.vstack([stack, rows]), mode="r"))
    m = min(n, SIZE)
    residual = float(stack[SIZE, SIZE] ** 2) if n > SIZE else 0.0
    projection = None if reading_mm is None else stack[:m, SIZE]
    return Reduced(projection, stack[:m, :SIZE], residual, n)
