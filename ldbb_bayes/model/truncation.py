"""P(u ≥ 0) of Gaussian vectors and exact draws of them inside, by minimax tilting; the region of
physical compliances.

u = L (x − x₀) row by row, x standard normal: each x_j is drawn beyond its edge from a normal
shifted by a tilt μ_j. Its weight

    ψ(x, μ) = Σ_j ln Φ(−e_j) + ½ μ_j² − x_j μ_j,   e_j = bound_j − Σ_{k<j} L_jk x_k / L_jj − μ_j,

is bounded by its value at the saddle point, which makes rejection exact and sums efficient however
small P is (Botev, J. R. Statist. Soc. B 79, 125-148, 2017). Rows beyond the rank narrow the last x
they depend on to an interval: weights only fall.

Most probabilities need none of it: with P₁₂ that of the two tightest rows, P₁₂ − Σ_{j>2} P(u_j < 0
≤ u₁) ≤ P ≤ P₁₂.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.sparse.csgraph import connected_components
from scipy.special import ndtr, ndtri

from ldbb_bayes.model.orthant import Orthant
from ldbb_bayes.results import Array

__all__ = ["Truncation"]


@dataclass(frozen=True, eq=False)
class Truncation:
    """The region A β ≥ 0, ``rows`` A (m, p); no rows mean no truncation."""

    rows: Array

    @property
    def active(self) -> bool:
        """Whether there is any constraint."""
        return len(self.rows) > 0

    def holds(self, beta: Array) -> Array:
        """Whether A β ≥ 0, shape (...)."""
        return np.all(beta @ self.rows.T >= 0.0, axis=-1)

    def orthants(self, mean: Array, spread: Array) -> Orthant:
        """The orthant problem of N(mean, spread spreadᵀ), means (w, p) and spreads (w, p, q)."""
        return Orthant(mean @ self.rows.T, self.rows @ spread)

    @property
    def bounds(self) -> Array:
        """The least and the greatest value that it leaves each parameter, shape (p, 2)."""
        rows, free = self.rows, range(self.rows.shape[1])
        return np.array(
            [
                _support(rows[:, [j, *(k for k in free if k != j)]], np.zeros(len(rows)))
                for j in free
            ]
        )

    def quantile(self, level: Array, mean: Array, sd: Array) -> Array:
        """β (n, p) from uniform levels (n, p), where these are of N(mean, diag sd²) inside the
        region: the quantile of each parameter given those before it (Rosenblatt 1952). In closed
        form but for parameters that share a constraint with later ones, whose distribution function
        is summed on a grid, to 2e-5 of probability."""
        rows, edge = self.rows * sd, -self.rows @ mean
        white = np.asarray(ndtri(level))
        met = (rows != 0.0).astype(float)
        _, label = connected_components(met.T @ met > 0.0, directed=False)
        for k in np.unique(label[met.any(axis=0)]):
            block = np.flatnonzero(label == k)
            among = met[:, label == k].any(axis=1)
            white[:, block] = _quantile_inside(
                level[:, block], rows[np.ix_(among, block)], edge[among]
            )
        return mean + white * sd


_GRID = 1025
_COARSE_GRID = 257
_REACH = 9.0
_LEAST_WIDTH = 2.0


def _quantile_inside(level: Array, rows: Array, edge: Array) -> Array:
    """Standard normal w (n, k) inside rows · w ≥ edge, rows (m, k), from uniform levels (n, k)."""
    found = np.empty(level.shape)
    left = edge[None]
    for j, own in enumerate(level.T):
        if j + 1 == len(rows.T):
            found[:, j] = _between(own, *_support(rows[:, j:], left))
        elif j == 0:
            found[:, 0] = np.interp(own, *_distribution(rows.tobytes(), edge.tobytes()))
        else:
            of_each = (_distribution(rows[:, j:].tobytes(), each.tobytes()) for each in left)
            found[:, j] = [np.interp(one, *table) for one, table in zip(own, of_each, strict=True)]
        left = left - found[:, j, None] * rows[:, j]
    return found


@lru_cache(maxsize=64)
def _distribution(rows: bytes, edge: bytes) -> tuple[Array, Array]:
    """The distribution function of the first coordinate, and at which values."""
    edges = np.frombuffer(edge)
    places, density = _first(np.frombuffer(rows).reshape(len(edges), -1), edges, _GRID)
    below = np.insert(np.cumsum(np.diff(places) * (density[1:] + density[:-1])), 0, 0.0)
    return below / below[-1], places


def _between(level: Array, low: Array, high: Array) -> Array:
    """Quantiles of a standard normal from low to high, each (n,); of the upper tail from the lower
    one, to keep digits."""
    flip = low > 0.0
    one = np.where(flip, -high, low)
    other = np.where(flip, -low, high)
    level = np.where(flip, 1.0 - level, level)
    found = ndtri(ndtr(one) * (1.0 - level) + ndtr(other) * level)
    return np.clip(np.where(flip, -found, found), low, high)


def _first(rows: Array, edge: Array, size: int) -> tuple[Array, Array]:
    """Places across the support of the first coordinate and its density there up to a constant,
    (..., size) each."""
    low, high = _support(rows, edge)
    low = np.maximum(low, np.minimum(-_REACH, high - _LEAST_WIDTH))
    high = np.minimum(high, np.maximum(_REACH, low + _LEAST_WIDTH))
    places = low[..., None] + (high - low)[..., None] * np.linspace(0.0, 1.0, size)
    return places, np.exp(-0.5 * places**2) * _inside(
        rows[:, 1:], edge[..., None, :] - places[..., None] * rows[:, 0]
    )


def _inside(rows: Array, edge: Array) -> Array:
    """P(rows · w ≥ edge) up to a constant, edges (..., m)."""
    if rows.shape[1] > 1:
        places, density = _first(rows, edge, _COARSE_GRID)
        return np.asarray(np.trapezoid(density, places, axis=-1))
    low, high = _support(rows, edge)
    return np.maximum(np.where(low > 0.0, ndtr(-low) - ndtr(-high), ndtr(high) - ndtr(low)), 0.0)


def _support(rows: Array, edge: Array) -> tuple[Array, Array]:
    """Least and greatest first coordinate where rows · w ≥ edge (..., m): others eliminated, last
    first (Fourier, Motzkin)."""
    while rows.shape[1] > 1:
        last = rows[:, -1]
        up = np.flatnonzero(last > 0.0)
        down = np.flatnonzero(last < 0.0)
        free = np.flatnonzero(last == 0.0)
        pairs = (np.repeat(up, len(down)), np.tile(down, len(up)))
        both = np.concatenate(
            [
                rows[:, :-1],
                np.moveaxis(edge, -1, 0).reshape(len(rows), int(np.prod(edge.shape[:-1]))),
            ],
            axis=1,
        )
        among = np.concatenate(
            [
                both[free],
                both[pairs[0]] / last[pairs[0], None] - both[pairs[1]] / last[pairs[1], None],
            ]
        )
        shape = (len(among), *edge.shape[:-1])
        rows, edge = (
            among[:, : rows.shape[1] - 1],
            np.moveaxis(among[:, rows.shape[1] - 1 :].reshape(shape), 0, -1),
        )
    column = rows[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        at = edge / column
    low = np.where(column > 0.0, at, -np.inf).max(axis=-1, initial=-np.inf)
    return low, np.where(column < 0.0, at, np.inf).min(axis=-1, initial=np.inf)
