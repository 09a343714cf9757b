"""Fourier basis functions of the angle on the circle: 1, cos θ, sin θ, …, cos 12θ, sin 12θ.

A function of the angle θ on the circle is represented by its 25 coefficients in this basis.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ldbb_bayes.results import Array

__all__ = ["MAX_ORDER", "ORDERS", "SIZE", "basis", "coefficients", "derivative", "harmonic_index"]

# Highest order n of the Fourier basis functions cos nθ and sin nθ.
MAX_ORDER = 12
# Number of Fourier basis functions 1, cos θ, sin θ, …, cos 12θ, sin 12θ.
SIZE = 2 * MAX_ORDER + 1
# Order n of every Fourier basis function 1, cos θ, sin θ, cos 2θ, …: 0, 1, 1, 2, 2, …, 12, 12.
ORDERS = np.repeat(np.arange(MAX_ORDER + 1), 2)[1:]
ORDERS.setflags(write=False)
# Fourier coefficients of a function of the angle are set to zero if they are smaller than this
# fraction of the largest Fourier coefficient of the function, because they are then rounding
# errors.
_ROUNDING = 1e-13


def basis(angle_rad: Array) -> Array:
    """Return 1, cos θ, sin θ, …, cos 12θ, sin 12θ at n angles θ, shape (n, 25).

    ``angle_rad`` holds the angles θ [rad], shape (n,).
    """
    rotation = np.exp(1j * np.asarray(angle_rad, dtype=float))
    columns = np.empty((len(rotation), SIZE))
    columns[:, 0] = 1.0
    power = np.ones_like(rotation)
    for n in range(1, MAX_ORDER + 1):
        power = power * rotation
        cosine, sine = harmonic_index(n)
        columns[:, cosine] = power.real
        columns[:, sine] = power.imag
    return columns


def harmonic_index(order: int) -> tuple[int, int]:
    """Return the indices of cos nθ and sin nθ among the 25 basis functions, for an order n ≥ 1.

    The basis functions are 1, cos θ, sin θ, …, cos 12θ, sin 12θ. The constant 1 has the index 0.
    """
    return 2 * order - 1, 2 * order


def coefficients(columns: Callable[[Array], Array]) -> Array:
    """Return Fourier coefficients of p functions of the angle on the circle, shape (25, p).

    The functions must be sums of cos nθ and sin nθ with n ≤ 12.

    Parameters
    ----------
    columns
        Function that takes m angles, shape (m,) [rad], and returns the values of the p functions at
        these angles, shape (m, p).
    """
    n = 4 * MAX_ORDER
    angle = np.arange(n) * (2 * np.pi / n)
    weight = np.where(ORDERS == 0, 1.0, 2.0) / n
    values: Array = (basis(angle) * weight).T @ columns(angle)
    largest = np.abs(values).max(axis=0, initial=0.0)
    return np.where(np.abs(values) > _ROUNDING * largest, values, 0.0)


def derivative(values: Array) -> Array:
    """Return Fourier coefficients of the derivatives of functions of the angle, shape (..., 25).

    ``values``, shape (..., 25), holds the Fourier coefficients of the functions. The derivatives
    are with respect to the angle in rad.
    """
    slopes = np.zeros_like(values)
    orders = np.arange(1, MAX_ORDER + 1)
    slopes[..., 1::2] = orders * values[..., 2::2]
    slopes[..., 2::2] = -orders * values[..., 1::2]
    return slopes
