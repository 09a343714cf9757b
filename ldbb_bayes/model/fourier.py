"""The circle's basis 1, cos θ, sin θ, …, cos 12θ, sin 12θ; readings reduced to it; the tests of a
campaign as columns in it.

Every column of the model is a polynomial in this basis, so a test is 25 coefficients wide whatever
its number of readings.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ldbb_bayes.results import Array

__all__ = ["MAX_ORDER", "ORDERS", "SIZE", "basis", "coefficients", "derivative", "harmonic_index"]

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
    """Basis coefficients (25, p) of trigonometric polynomials of order ≤ 12 of the angle, (n,)
    [rad] → (n, p)."""
    n = 4 * MAX_ORDER
    angle = np.arange(n) * (2 * np.pi / n)
    weight = np.where(ORDERS == 0, 1.0, 2.0) / n
    found: Array = (basis(angle) * weight).T @ columns(angle)
    return np.where(np.abs(found) > 1e-13 * np.abs(found).max(axis=0, initial=0.0), found, 0.0)


def derivative(values: Array) -> Array:
    """Coefficients (..., 25) of the derivative with respect to the angle."""
    found = np.zeros_like(values)
    orders = np.arange(1, MAX_ORDER + 1)
    found[..., 1::2], found[..., 2::2] = orders * values[..., 2::2], -orders * values[..., 1::2]
    return found
