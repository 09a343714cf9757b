"""The trigonometric basis of a circle: 1, cos θ, sin θ, …, cos 12θ, sin 12θ.

Every column of the model is a polynomial in this basis, so a test is 25 coefficients wide whatever its number of readings.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["MAX_ORDER", "ORDERS", "SIZE", "Reduced", "basis", "coefficients", "harmonic_index", "reduce_readings"]

Array = NDArray[Any]

MAX_ORDER = 12
SIZE = 2 * MAX_ORDER + 1
ORDERS = np.array([0, *(n for n in range(1, MAX_ORDER + 1) for _ in range(2))])
ORDERS.setflags(write=False)


def basis(angle_rad: Array) -> Array:
    """Basis functions at the angles, shape (n, 25) [1]."""
    turn = np.exp(1j * np.asarray(angle_rad, dtype=float))
    columns = np.empty((len(turn), SIZE))
    columns[:, 0] = 1.0
    power = np.ones_like(turn)
    for n in range(1, MAX_ORDER + 1):
        power = power * turn
        columns[:, 2 * n - 1], columns[:, 2 * n] = power.real, power.imag
    return columns


def harmonic_index(order: int) -> tuple[int, int]:
    """Positions of cos nθ and sin nθ in the basis, n ≥ 1."""
    return 2 * order - 1, 2 * order


def coefficients(columns: Callable[[Array], Array]) -> Array:
    """Basis coefficients of functions of the angle that are trigonometric polynomials of order ≤ 12.

    Parameters
    ----------
    columns : callable
        Angles (n,) [rad] → values (n, p).

    Returns
    -------
    ndarray, shape (25, p)
    """
    n = 4 * MAX_ORDER
    angle = np.arange(n) * (2 * np.pi / n)
    weight = np.where(ORDERS == 0, 1.0, 2.0) / n
    found: Array = (basis(angle) * weight).T @ columns(angle)
    return np.where(np.abs(found) > 1e-13 * np.abs(found).max(axis=0, initial=0.0), found, 0.0)


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
