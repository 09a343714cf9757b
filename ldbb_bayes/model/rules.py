"""Points and log weights of product rules on the unit cube, for integrands over tilted normal draws."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["product_rule", "two_ended_rule"]

Array = NDArray[Any]


@cache
def product_rule(counts: tuple[int, ...]) -> tuple[Array, Array]:
    """Points of the unit cube and their log weights, Gauss-Legendre in s with u = s⁴: u → 0 is the far tail, where the integrand
    is no polynomial of u. One more coordinate, on which nothing depends, is added."""
    axes, weights = [np.array([0.5])], [np.array([1.0])]
    for count in reversed(counts):
        nodes, weight = np.polynomial.legendre.leggauss(count)
        s = (nodes + 1.0) / 2.0
        axes.insert(0, s**4 if count > 1 else s)
        weights.insert(0, 2.0 * weight * s**3 if count > 1 else weight / 2.0)
    points = np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")], axis=1)
    return points, np.log(np.prod(np.meshgrid(*weights, indexing="ij"), axis=0)).ravel()


@cache
def two_ended_rule(d: int, count: int) -> tuple[Array, Array]:
    """The same for integrands that change towards both ends of the last coordinate too: u = s³ (10 − 15 s + 6 s²)."""
    nodes, weight = np.polynomial.legendre.leggauss(count)
    s = (nodes + 1.0) / 2.0
    axes, weights = [s**3 * (10.0 - 15.0 * s + 6.0 * s**2)] * d, [15.0 * weight * s**2 * (1.0 - s) ** 2] * d
    points = np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")], axis=1) if d else np.zeros((1, 0))
    return points, np.log(np.prod(np.meshgrid(*weights, indexing="ij"), axis=0)).ravel() if d else np.zeros(1)
