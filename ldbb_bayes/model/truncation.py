"""Region in which no compliance is negative, and quantiles of Gaussian vectors in this region.

The region is A β ≥ 0. β are the p parameters: compliances, their slopes (changes with force) and
geometric errors. A, shape (m, p), has m rows. The product of each row with β is a compliance at one
force, which must not be negative.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import trapezoid
from scipy.sparse.csgraph import connected_components
from scipy.special import ndtr, ndtri

from ldbb_bayes.errors import require
from ldbb_bayes.model.orthant import Orthant
from ldbb_bayes.results import Array

__all__ = ["Truncation"]

# Number of points of the grid on which the distribution function of one coordinate of a truncated
# Gaussian vector is computed.
_GRID = 1025
# The distribution of one coordinate of a truncated Gaussian vector is computed by integration over
# the other coordinates that have a constraint in common with it. The grid for this integration has
# this number of points per coordinate.
_COARSE_GRID = 257
# The distribution of a coordinate of a truncated Gaussian vector is computed on a grid of values.
# On each side, the grid extends to this number of sds from the mean before truncation. It contains
# no values that the truncation excludes.
_REACH = 9.0
# Smallest width, in sds, of the grid of values of a coordinate. It matters if the truncation
# excludes all values near the mean that the coordinate has before the truncation. The grid then
# begins at the permitted value nearest to this mean. It is narrower than this width only if the
# whole range of permitted values is narrower.
_LEAST_WIDTH = 2.0
# The range of the grid is narrowed this number of times to the values whose density exceeds the
# given fraction of the greatest density.
_NARROWINGS = 3
_NEGLIGIBLE_DENSITY = 1e-12
# Smallest number by which a probability is divided, so that nothing is divided by zero.
_TINY = np.finfo(float).tiny


@dataclass(frozen=True, eq=False)
class Truncation:
    """Region A β ≥ 0 of the parameters β, in which compliances are not negative.

    Parameters
    ----------
    rows
        Matrix A of m constraints on p parameters, shape (m, p). If m is zero, every value of the
        parameters is permitted.
    """

    rows: Array

    @property
    def active(self) -> bool:
        """Whether the region without negative compliances excludes any values of the parameters."""
        return len(self.rows) > 0

    def holds(self, beta: Array) -> Array:
        """Return whether no compliance is negative for given parameters, shape (...).

        ``beta``, shape (..., p), holds values of the p parameters β.
        """
        return np.all(beta @ self.rows.T >= 0.0, axis=-1)

    def orthants(self, mean: Array, spread: Array) -> Orthant:
        """Return the object that computes P(A β ≥ 0) for w Gaussians β ~ N(mean, spread spreadᵀ).

        A β ≥ 0 is the region of the p parameters β in which no compliance is negative. The object
        also makes random draws in this region.

        Parameters
        ----------
        mean
            Means of the Gaussians, shape (w, p).
        spread
            Square roots of the covariances of the Gaussians, shape (w, p, q); q is the number of
            columns of each square root.
        """
        return Orthant(mean @ self.rows.T, self.rows @ spread)

    @property
    def bounds(self) -> Array:
        """Lower and upper bound of each of the p parameters in the region A β ≥ 0, shape (p, 2).

        In this region no compliance is negative. A bound is infinite if the region does not limit
        the parameter.
        """
        p = self.rows.shape[1]
        bounds = np.empty((p, 2))
        for j in range(p):
            # Change the order of the parameters so that the parameter j comes first, because
            # `_limits_of_first` computes limits for the first coordinate only.
            reordered = [j, *(k for k in range(p) if k != j)]
            bounds[j] = _limits_of_first(self.rows[:, reordered], np.zeros(len(self.rows)))
        return bounds

    def quantile(
        self,
        level: Array,
        mean: Array,
        sd: Array,
    ) -> Array:
        """Return n vectors β ~ N(mean, diag sd²) with A β ≥ 0, computed from uniform numbers.

        A β ≥ 0 is the region of the p parameters β in which no compliance is negative. Each
        parameter is a quantile of its conditional distribution given the preceding parameters;
        ``level`` holds the probabilities of these quantiles (Rosenblatt, Ann. Math. Stat. 23,
        470-472, 1952). The quantiles are computed analytically, except for parameters that have a
        constraint in common with later parameters. For these parameters, the distribution function
        is integrated on a grid. The error in probability is 1e-5; in models quadratic in force it
        grows to 1e-4 if the prior sds of the changes with force are as large as that of the
        compliance.

        Parameters
        ----------
        level
            Uniform numbers between 0 and 1, one for each parameter, shape (n, p).
        mean, sd
            Mean and sd of the independent parameters before truncation to the region, shape (p,).

        Returns
        -------
        Parameters β, shape (n, p).

        Raises
        ------
        InputError
            If the Gaussian has practically no probability in the region.
        """
        rows = self.rows * sd
        edge = -self.rows @ mean
        z = np.asarray(ndtri(level))
        for block in _blocks_of((rows != 0.0).tobytes(), len(sd)):
            constraints = rows[np.ix_(block.rows, block.columns)]
            z[:, block.columns] = _quantile_inside(
                level[:, block.columns], constraints, edge[block.rows]
            )
        return mean + z * sd


class _Block(NamedTuple):
    """Group of parameters, each of which is linked to the others by constraints.

    Two parameters are linked if they occur in one constraint, or if both are linked to a third.
    """

    columns: NDArray[np.intp]  # indices of the parameters in the block
    rows: NDArray[np.intp]  # indices of the constraints on the parameters in the block


@lru_cache(maxsize=64)
def _blocks_of(nonzero: bytes, p: int) -> tuple[_Block, ...]:
    """Sort parameters into blocks, so that no constraint depends on parameters of two blocks.

    There are p parameters; those that have no constraint are in no block. ``nonzero`` states, for
    each of m constraints and p parameters, whether the constraint depends on the parameter. The
    array, shape (m, p), is passed as bytes, because arguments of a cached function must be
    hashable.
    """
    depends = np.frombuffer(nonzero, dtype=bool).reshape(-1, p)
    has_common = depends.T.astype(float) @ depends > 0.0
    count, label = connected_components(has_common, directed=False)
    blocks = []
    for k in range(count):
        columns = np.flatnonzero(label == k)
        rows = np.flatnonzero(depends[:, columns].any(axis=1))
        if rows.size:
            blocks.append(_Block(columns, rows))
    return tuple(blocks)


class _Limits(NamedTuple):
    """Lower and upper limits of the values of a variable, infinite where there is no limit."""

    low: Array
    high: Array


class _DensityOnGrid(NamedTuple):
    """Values of a density at the points of a grid. The density is not normalised.

    ``grid`` holds the points, and ``density`` the values there; both have the shape (..., points).
    """

    grid: Array
    density: Array


class _DistributionOnGrid(NamedTuple):
    """Distribution of a variable: density, and probability of lower values, at points of a grid.

    ``grid``, ``density`` and ``probability`` have the shape (points,).
    """

    grid: Array
    density: Array
    probability: Array

    def quantile(self, level: Array) -> Array:
        """Return quantiles of the variable. Its density is linear between the points of the grid.

        ``level`` holds the probabilities of the quantiles.
        """
        cell = np.searchsorted(self.probability, level, side="right") - 1
        cell = np.clip(cell, 0, len(self.grid) - 2)
        width = self.grid[cell + 1] - self.grid[cell]
        density = self.density[cell]
        slope = (self.density[cell + 1] - density) / width
        # The probability p between the lower end of a cell and a quantile at the distance x from
        # this end is p = density x + slope x² / 2. The root is written so that it holds for a slope
        # of zero, too.
        probability = level - self.probability[cell]
        density_there = np.sqrt(np.maximum(density**2 + 2.0 * slope * probability, 0.0))
        distance = 2.0 * probability / np.maximum(density + density_there, _TINY)
        return np.asarray(self.grid[cell] + np.clip(distance, 0.0, width))


def _quantile_inside(
    level: Array,
    rows: Array,
    edge: Array,
) -> Array:
    """Return n standard normal vectors z with rows · z ≥ edge, computed from uniform numbers.

    Each of the k elements of z is a quantile of its conditional distribution given the preceding
    elements. ``level``, shape (n, k), holds the probabilities of these quantiles. The result has
    the shape (n, k). The m constraints have the coefficients ``rows``, shape (m, k), and the lower
    bounds ``edge``, shape (m,).
    """
    n, k = level.shape
    z = np.empty((n, k))
    edges = edge[None]
    for j in range(k):
        if j + 1 == k:
            limits = _limits_of_first(rows[:, j:], edges)
            z[:, j] = _quantile_between(level[:, j], limits)
        elif j == 0:
            distribution = _distribution_of_first(rows.tobytes(), edge.tobytes())
            z[:, j] = distribution.quantile(level[:, j])
        else:
            later_rows = rows[:, j:].tobytes()
            for i in range(n):
                distribution = _distribution_of_first(later_rows, edges[i].tobytes())
                z[i, j] = distribution.quantile(level[i, j])
        edges = edges - z[:, j, None] * rows[:, j]
    return z


@lru_cache(maxsize=64)
def _distribution_of_first(
    rows: bytes,
    edge: bytes,
) -> _DistributionOnGrid:
    """Return a table of the distribution of a truncated normal vector's first coordinate.

    The table has 1025 points. They cover the range in which the density is not negligible, and most
    of them are near its ends: constraints can make the density fall to zero within a small part of
    the range. The vector z is standard normal with k elements, truncated by the m constraints
    rows · z ≥ edge, where ``rows`` has the shape (m, k) and ``edge`` the shape (m,). The two arrays
    are passed as bytes, because arguments of a cached function must be hashable.
    """
    edges = np.frombuffer(edge)
    coefficients = np.frombuffer(rows).reshape(len(edges), -1)
    limits = _range_of_first(coefficients, edges)
    equal_fractions = np.linspace(0.0, 1.0, _COARSE_GRID)
    for _ in range(_NARROWINGS):
        coarse = _density_between(limits, coefficients, edges, equal_fractions)
        limits = _range_of_density(coarse)
    fractions = _fractions_dense_at_ends(_GRID)
    grid, density = _density_between(limits, coefficients, edges, fractions)
    cumulative = np.cumsum(np.diff(grid) * 0.5 * (density[1:] + density[:-1]))
    cumulative = np.insert(cumulative, 0, 0.0)
    total = cumulative[-1]
    return _DistributionOnGrid(grid, density / total, cumulative / total)


def _range_of_density(distribution: _DensityOnGrid) -> _Limits:
    """Return the range outside which a density on a grid is negligible.

    The density must have a single peak. The range reaches to the next points of the grid, so that
    it holds the peak also if the peak is narrower than the steps of the grid.
    """
    grid, density = distribution
    require(
        density.max() > 0.0,
        "prior must give some probability to compliances that are not negative, got none. Correct"
        " the prior means, or make the prior sds larger.",
    )
    counts = np.flatnonzero(density > _NEGLIGIBLE_DENSITY * density.max())
    first = max(counts[0] - 1, 0)
    last = min(counts[-1] + 1, len(grid) - 1)
    return _Limits(grid[first], grid[last])


def _fractions_dense_at_ends(size: int) -> Array:
    """Return ``size`` increasing numbers from 0 to 1, with the smallest steps near 0 and 1.

    They are t³ (10 − 15 t + 6 t²) at equidistant t; near 0 they grow as 10 t³.
    """
    t = np.linspace(0.0, 1.0, size)
    return np.asarray(t**3 * (10.0 - 15.0 * t + 6.0 * t**2))


def _quantile_between(level: Array, limits: _Limits) -> Array:
    """Return quantiles of standard normal variables truncated to intervals, shape (n,).

    ``level``, shape (n,), holds the probabilities of the n quantiles; ``limits`` holds the limits
    of an interval for each quantile, or of one interval for all of them. If an interval is above
    zero, its mirror image below zero is used, which reduces rounding errors.
    """
    low, high = limits
    is_mirrored = low > 0.0
    lower_end = np.where(is_mirrored, -high, low)
    upper_end = np.where(is_mirrored, -low, high)
    share = np.where(is_mirrored, 1.0 - level, level)
    quantile = ndtri(ndtr(lower_end) * (1.0 - share) + ndtr(upper_end) * share)
    return np.clip(np.where(is_mirrored, -quantile, quantile), low, high)


def _range_of_first(rows: Array, edge: Array) -> _Limits:
    """Return the range of the first coordinate of a truncated normal vector z.

    z is a standard normal vector of k elements, truncated by m constraints rows · z ≥ edge. The
    coefficients ``rows`` have the shape (m, k), and the lower bounds ``edge`` the shape (..., m)
    for many sets of bounds. Where the constraints do not limit the range, it ends where
    probabilities are negligible.
    """
    low, high = _limits_of_first(rows, edge)
    low = np.maximum(low, np.minimum(-_REACH, high - _LEAST_WIDTH))
    high = np.minimum(high, np.maximum(_REACH, low + _LEAST_WIDTH))
    return _Limits(low, high)


def _density_between(
    limits: _Limits,
    rows: Array,
    edge: Array,
    fractions: Array,
) -> _DensityOnGrid:
    """Return the density of the first coordinate of a truncated normal vector z on a grid.

    z is a standard normal vector of k elements, truncated by m constraints rows · z ≥ edge. The
    coefficients ``rows`` have the shape (m, k). The lower bounds ``edge`` have the shape (..., m)
    for many sets of bounds. The grid covers the range between the limits; ``fractions`` holds the
    distances of its points from the lower limit, as fractions of the range, shape (points,).
    """
    width = limits.high - limits.low
    grid = limits.low[..., None] + width[..., None] * fractions
    later_edge = edge[..., None, :] - grid[..., None] * rows[:, 0]
    density = np.exp(-0.5 * grid**2) * _probability_inside(rows[:, 1:], later_edge)
    return _DensityOnGrid(grid, density)


def _probability_inside(rows: Array, edge: Array) -> Array:
    """Return the probability of rows · z ≥ edge for standard normal z, up to a constant factor.

    The m constraints on the k elements of z have the coefficients ``rows``, shape (m, k), and the
    lower bounds ``edge``, shape (..., m) for many sets of bounds. The result has the shape (...).
    """
    if rows.shape[1] > 1:
        limits = _range_of_first(rows, edge)
        equal_fractions = np.linspace(0.0, 1.0, _COARSE_GRID)
        grid, density = _density_between(limits, rows, edge, equal_fractions)
        return np.asarray(trapezoid(density, grid, axis=-1))
    low, high = _limits_of_first(rows, edge)
    upper_tail = ndtr(-low) - ndtr(-high)
    lower_tail = ndtr(high) - ndtr(low)
    return np.maximum(np.where(low > 0.0, upper_tail, lower_tail), 0.0)


def _limits_of_first(rows: Array, edge: Array) -> _Limits:
    """Return the limits of the first coordinate of the points z with rows · z ≥ edge.

    The m constraints on the k elements of z have the coefficients ``rows``, shape (m, k), and the
    lower bounds ``edge``, shape (..., m) for many sets of bounds. Both limits have the shape (...);
    they are infinite where there is no limit. The other coordinates of z are eliminated from
    the inequalities one by one, the last coordinate first (Fourier-Motzkin elimination).
    """
    while rows.shape[1] > 1:
        rows, edge = _eliminate_last(rows, edge)
    column = rows[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        limit = edge / column
    lower_limit = np.where(column > 0.0, limit, -np.inf)
    upper_limit = np.where(column < 0.0, limit, np.inf)
    low = lower_limit.max(axis=-1, initial=-np.inf)
    high = upper_limit.min(axis=-1, initial=np.inf)
    return _Limits(low, high)


def _eliminate_last(
    rows: Array,
    edge: Array,
) -> tuple[Array, Array]:
    """Eliminate the last coordinate of z from the constraints rows · z ≥ edge.

    The m constraints on the k coordinates of z have the coefficients ``rows``, shape (m, k), and
    the lower bounds ``edge``, shape (..., m) for many sets of bounds. The result is a pair in the
    same form: coefficients and lower bounds of constraints on the first k − 1 coordinates.
    Constraints that do not contain the last coordinate are kept. Each new constraint is the sum of
    two old constraints: one bounds the last coordinate from below, the other bounds it from above.
    Before they are added, the two are scaled so that the last coordinate cancels.
    """
    last = rows[:, -1]
    free = np.flatnonzero(last == 0.0)
    below, above = _opposite_pairs(last)

    def combine(values: Array) -> Array:
        """Return the coefficients, or the bounds, of the constraints after the elimination.

        Old constraints without the last coordinate are kept. Each of the other constraints is a sum
        of two old constraints, in which the last coordinate cancels. ``values`` holds the
        coefficients, or the lower bounds, of the old constraints, with one row for each constraint.
        """
        scale = last.reshape(-1, *[1] * (values.ndim - 1))
        pairs = values[below] / scale[below] - values[above] / scale[above]
        return np.concatenate([values[free], pairs])

    edge_first = combine(np.moveaxis(edge, -1, 0))
    return combine(rows[:, :-1]), np.moveaxis(edge_first, 0, -1)


def _opposite_pairs(last: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return all pairs of a positive and a negative element of the array ``last``, as indices.

    The result consists of two arrays of equal length. The first holds the index of the positive
    element of each pair, the second the index of its negative element.
    """
    positive = np.flatnonzero(last > 0.0)
    negative = np.flatnonzero(last < 0.0)
    return np.repeat(positive, len(negative)), np.tile(negative, len(positive))
