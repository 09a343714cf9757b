"""The region of physical compliances, A β ≥ 0, and quantiles of a Gaussian inside it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components
from scipy.special import ndtr, ndtri

from ldbb_bayes.model.orthant import Orthant
from ldbb_bayes.results import Array

__all__ = ["Truncation"]

# Points of the grid on which a distribution function is summed: of the first coordinate, and of
# the coordinates after it.
_GRID = 1025
_COARSE_GRID = 257
# The grid ends this many sd from the centre, and is this wide at least.
_REACH = 9.0
_LEAST_WIDTH = 2.0


@dataclass(frozen=True, eq=False)
class Truncation:
    """The region A β ≥ 0.

    Parameters
    ----------
    rows
        A, shape (m, p); no rows mean no truncation.
    """

    rows: Array

    @property
    def active(self) -> bool:
        """Whether there is any constraint."""
        return len(self.rows) > 0

    def holds(self, beta: Array) -> Array:
        """Return whether A β ≥ 0, shape (...), of β (..., p)."""
        return np.all(beta @ self.rows.T >= 0.0, axis=-1)

    def orthants(self, mean: Array, spread: Array) -> Orthant:
        """Return the orthant problems of N(mean, spread spreadᵀ).

        Parameters
        ----------
        mean
            Shape (w, p).
        spread
            Shape (w, p, q).
        """
        return Orthant(mean @ self.rows.T, self.rows @ spread)

    @property
    def bounds(self) -> Array:
        """The least and the greatest value of each parameter in the region, shape (p, 2)."""
        p = self.rows.shape[1]
        bounds = np.empty((p, 2))
        for j in range(p):
            reordered = [j, *(k for k in range(p) if k != j)]
            bounds[j] = _support(self.rows[:, reordered], np.zeros(len(self.rows)))
        return bounds

    def quantile(
        self,
        level: Array,
        mean: Array,
        sd: Array,
    ) -> Array:
        """Return β of uniform levels, where β ~ N(mean, diag sd²) inside the region.

        The quantile of each parameter given those before it (Rosenblatt, Ann. Math. Stat. 23,
        470-472, 1952). In closed form but for parameters that share a constraint with later ones,
        whose distribution function is summed on a grid, to 2e-5 of probability.

        Parameters
        ----------
        level
            Shape (n, p).
        mean, sd
            Shape (p,).

        Returns
        -------
        Shape (n, p).
        """
        rows = self.rows * sd
        edge = -self.rows @ mean
        z = np.asarray(ndtri(level))
        nonzero = (rows != 0.0).astype(float)
        count, label = connected_components(nonzero.T @ nonzero > 0.0, directed=False)
        for k in range(count):
            block = np.flatnonzero(label == k)
            block_rows = np.flatnonzero(nonzero[:, block].any(axis=1))
            if block_rows.size:
                constraints = rows[np.ix_(block_rows, block)]
                z[:, block] = _quantile_inside(level[:, block], constraints, edge[block_rows])
        return mean + z * sd


def _quantile_inside(
    level: Array,
    rows: Array,
    edge: Array,
) -> Array:
    """Return z ~ N(0, I) inside rows · z ≥ edge of uniform levels, shape (n, k), rows (m, k)."""
    n, k = level.shape
    z = np.empty((n, k))
    edges = edge[None]
    for j in range(k):
        if j + 1 == k:
            z[:, j] = _quantile_between(level[:, j], *_support(rows[:, j:], edges))
        elif j == 0:
            distribution = _distribution(rows.tobytes(), edge.tobytes())
            z[:, j] = np.interp(level[:, j], *distribution)
        else:
            later_rows = rows[:, j:].tobytes()
            for i in range(n):
                distribution = _distribution(later_rows, edges[i].tobytes())
                z[i, j] = np.interp(level[i, j], *distribution)
        edges = edges - z[:, j, None] * rows[:, j]
    return z


@lru_cache(maxsize=64)
def _distribution(
    rows: bytes,
    edge: bytes,
) -> tuple[Array, Array]:
    """Return the distribution function of the first coordinate, and the values where it is."""
    edges = np.frombuffer(edge)
    coefficients = np.frombuffer(rows).reshape(len(edges), -1)
    grid, density = _first_density(coefficients, edges, _GRID)
    cumulative = np.cumsum(np.diff(grid) * (density[1:] + density[:-1]))
    cumulative = np.insert(cumulative, 0, 0.0)
    return cumulative / cumulative[-1], grid


def _quantile_between(
    level: Array,
    low: Array,
    high: Array,
) -> Array:
    """Return quantiles of a standard normal between low and high, each (n,).

    Those of the upper tail are taken from the lower one, to keep digits.
    """
    flip = low > 0.0
    lower_end = np.where(flip, -high, low)
    upper_end = np.where(flip, -low, high)
    share = np.where(flip, 1.0 - level, level)
    quantile = ndtri(ndtr(lower_end) * (1.0 - share) + ndtr(upper_end) * share)
    return np.clip(np.where(flip, -quantile, quantile), low, high)


def _first_density(
    rows: Array,
    edge: Array,
    size: int,
) -> tuple[Array, Array]:
    """Return values of the first coordinate across its support, and its density there.

    The density is stated up to a constant, (..., size) each.
    """
    low, high = _support(rows, edge)
    low = np.maximum(low, np.minimum(-_REACH, high - _LEAST_WIDTH))
    high = np.minimum(high, np.maximum(_REACH, low + _LEAST_WIDTH))
    grid = low[..., None] + (high - low)[..., None] * np.linspace(0.0, 1.0, size)
    later_edge = edge[..., None, :] - grid[..., None] * rows[:, 0]
    return grid, np.exp(-0.5 * grid**2) * _probability_inside(rows[:, 1:], later_edge)


def _probability_inside(rows: Array, edge: Array) -> Array:
    """Return P(rows · z ≥ edge) up to a constant, edges (..., m)."""
    if rows.shape[1] > 1:
        grid, density = _first_density(rows, edge, _COARSE_GRID)
        return np.asarray(np.trapezoid(density, grid, axis=-1))
    low, high = _support(rows, edge)
    upper_tail = ndtr(-low) - ndtr(-high)
    lower_tail = ndtr(high) - ndtr(low)
    return np.maximum(np.where(low > 0.0, upper_tail, lower_tail), 0.0)


def _support(
    rows: Array,
    edge: Array,
) -> tuple[Array, Array]:
    """Return the least and the greatest first coordinate where rows · z ≥ edge, edges (..., m).

    The other coordinates are eliminated, the last first (Fourier and Motzkin).
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
    return low, high


def _eliminate_last(
    rows: Array,
    edge: Array,
) -> tuple[Array, Array]:
    """Return constraints on all coordinates but the last: every pair that bounds it from two sides.

    The sum of a row that bounds it from below and one that bounds it from above does not hold it.
    """
    last = rows[:, -1]
    free = np.flatnonzero(last == 0.0)
    below, above = _opposite_pairs(last)

    def combine(values: Array) -> Array:
        scale = last.reshape(-1, *[1] * (values.ndim - 1))
        pairs = values[below] / scale[below] - values[above] / scale[above]
        return np.concatenate([values[free], pairs])

    edge_first = combine(np.moveaxis(edge, -1, 0))
    return combine(rows[:, :-1]), np.moveaxis(edge_first, 0, -1)


def _opposite_pairs(last: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return every pair of a row with positive and a row with negative last coefficient."""
    positive = np.flatnonzero(last > 0.0)
    negative = np.flatnonzero(last < 0.0)
    return np.repeat(positive, len(negative)), np.tile(negative, len(positive))
