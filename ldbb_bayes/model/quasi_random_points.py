"""Points for averages over Gaussian vectors: quasi-random lattices and quadrature rules."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from ldbb_bayes.results import Array

__all__ = [
    "SCRAMBLES",
    "QuadratureRule",
    "folded",
    "lattice_points",
    "quadrature_rule",
    "scrambled_lattice",
]

# Number of points, in each dimension, of the Gauss-Legendre quadrature rule with which moments of
# Gaussian vectors u given u ≥ 0 are computed.
_RULE_POINTS = 24
# Number of independent estimates of a probability P(u ≥ 0). Each estimate uses a scramble, which is
# a copy of one set of quasi-random points, shifted by a random vector. The scatter between the
# estimates gives the stated error.
SCRAMBLES = 8
# Generating vector of a lattice of quasi-random points, one number for each of ten dimensions
# (F. Y. Kuo, lattice-32001-1024-1048576). For further dimensions random odd numbers are used.
_LATTICE = (1, 182667, 469891, 498753, 110745, 446979, 250185, 118627, 245333, 283199)
# Random shifts of the lattice of quasi-random points are generated for at least this number of
# dimensions. The shifts of the first dimensions then do not depend on the number of dimensions that
# are used.
_SHIFT_DIMENSIONS = 32


@cache
def scrambled_lattice(dimensions: int, size: int, seed: int) -> Array:
    """Return shifted lattices of quasi-random points, shape (dimensions, scrambles, size).

    Each of the eight scrambles is a copy of the same lattice of ``size`` points, shifted by a
    random vector. The coordinates are not yet reduced modulo 1. ``seed`` is the seed of the random
    vectors.
    """
    rng = np.random.default_rng([seed, size])
    shifts = rng.random((SCRAMBLES, max(dimensions, _SHIFT_DIMENSIONS)))
    shift = shifts[:, :dimensions].T
    return np.asarray(lattice_points(dimensions, size, seed)[:, None] + shift[:, :, None])


def folded(points: Array) -> Array:
    """Return the baker's transformation 1 − |2x − 1| of numbers x between 0 and 1.

    ``points`` holds the numbers x, which are the coordinates of points of a lattice. The
    transformation makes the integrand periodic in x, so that its mean over the lattice is more
    accurate.
    """
    return 1.0 - np.abs(2.0 * points - 1.0)


def lattice_points(dimensions: int, size: int, seed: int) -> Array:
    """Return a lattice of quasi-random points, shape (dimensions, size).

    The coordinates are not yet reduced modulo 1. Point k has the coordinates k g / size, with an
    integer g for each dimension. The integers of the first ten dimensions are fixed; those of
    further dimensions are random numbers from ``seed``.
    """
    rng = np.random.default_rng([seed, 1])
    generators = list(_LATTICE)
    while len(generators) < dimensions:
        generators.append(2 * int(rng.integers(1 << 18)) + 1)
    generator = np.array(generators[:dimensions], dtype=float)
    return np.arange(size) * generator[:, None] / size


class QuadratureRule(NamedTuple):
    """Quadrature rule of n points in the unit cube.

    ``points`` holds the coordinates of the points, shape (dimensions, n), and ``log_weight`` the
    logarithms of their weights, shape (n,).
    """

    points: Array
    log_weight: Array


@cache
def quadrature_rule(dimensions: int) -> QuadratureRule:
    """Return a quadrature rule for the unit cube in one or two dimensions.

    In each dimension, the rule is the Gauss-Legendre rule for a variable s in [0, 1], with the
    substitution u = s³ (10 − 15 s + 6 s²). The points u are dense near 0 and 1, where the integrand
    changes most.
    """
    nodes, legendre_weight = np.polynomial.legendre.leggauss(_RULE_POINTS)
    s = (nodes + 1.0) / 2.0
    u = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    weight = 30.0 * (legendre_weight / 2.0) * s**2 * (1.0 - s) ** 2
    shape = (dimensions, _RULE_POINTS**dimensions)
    points = np.meshgrid(*[u] * dimensions, indexing="ij")
    log_weights = np.meshgrid(*[np.log(weight)] * dimensions, indexing="ij")
    log_weight = np.array(log_weights).reshape(shape).sum(axis=0)
    return QuadratureRule(np.array(points).reshape(shape), log_weight)
