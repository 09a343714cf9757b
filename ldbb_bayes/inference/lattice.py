"""The trapezoidal rule in several dimensions, on a grid that grows from the mode until nothing is left to find.

For a smooth function that dies away on every side the rule converges geometrically in its step (Trefethen and Weideman,
SIAM Review 56, 385-458, 2014). Two grids, the second moved by half a step along every axis, make one body-centred lattice:
errors along single axes cancel in their mean, and what is left is of the order of the square of their difference.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Lattice", "grow_lattice"]

Array = NDArray[Any]
_REACH = 1 << 13
_CHUNK = 256
_BEYOND = 3.0
_MEAN_OF_TWO = 0.25


@dataclass(frozen=True, eq=False)
class _Grid:
    """Points centre + step · root (index + offset), sorted by key; their log densities."""

    offset: float
    key: NDArray[np.int64]
    index: NDArray[np.int64]
    log_density: Array

    def at(self, place: Array) -> Array:
        """Log density of the cell that holds each place (in steps), −inf outside the grid."""
        key = _key(np.rint(place - self.offset).astype(np.int64))
        found = np.minimum(np.searchsorted(self.key, key), len(self.key) - 1)
        return np.where(self.key[found] == key, self.log_density[found], -np.inf)


@dataclass(frozen=True, eq=False)
class Lattice:
    """Weighted nodes of a density on ℝ^h.

    Attributes
    ----------
    centre : ndarray, shape (h,)
    root : ndarray, shape (h, h)
        One step along axis i is ``step · root[:, i]``.
    step : float
    grids : the two grids
    left_out : float
        Share of the integral beyond the edge, estimated by what lies on it.
    """

    centre: Array
    root: Array
    step: float
    grids: tuple[_Grid, _Grid]
    left_out: float

    @property
    def free(self) -> Array:
        """Nodes, shape (n, h)."""
        return np.concatenate([_points(self.centre, self.root, self.step, grid.index + grid.offset) for grid in self.grids])

    @property
    def log_density(self) -> Array:
        """ln f at the nodes, shape (n,)."""
        return np.concatenate([grid.log_density for grid in self.grids])

    @property
    def weight(self) -> Array:
        """Normalised weights of the nodes, shape (n,)."""
        weight = np.exp(self.log_density - self.log_density.max())
        return weight / weight.sum()

    @property
    def log_integral(self) -> float:
        """ln ∫ f."""
        return float(np.logaddexp(*self._halves) - np.log(2.0))

    @property
    def error(self) -> float:
        """Of the logarithm: a quarter of the two grids' difference (seen to bound the error of their mean), and what lies beyond
        the edge."""
        apart = abs(self._halves[0] - self._halves[1])
        return float(max(apart**2, _MEAN_OF_TWO * apart) + self.left_out)

    def draw(self, size: int, rng: np.random.Generator | np.random.RandomState, *, temperature: float = 1.0) -> Array:
        """Independent draws from the density as the lattice sees it, constant in every cell, shape (size, h).

        Parameters
        ----------
        temperature : float
            More than 1 draws from the density's power 1/temperature, which is wider.
        """
        cumulated = self._cumulated if temperature == 1.0 else np.cumsum(self.weight ** (1.0 / temperature))
        picked = np.searchsorted(cumulated, cumulated[-1] * rng.uniform(size=size), side="right")
        place = self._places[np.minimum(picked, len(cumulated) - 1)] + rng.uniform(-0.5, 0.5, (size, len(self.centre)))
        return _points(self.centre, self.root, self.step, place)

    def pick(self, size: int, rng: np.random.Generator) -> Array:
        """Nodes picked by their weights, systematically and in random order, shape (size, h)."""
        order = np.lexsort(self.free.T)
        places = (rng.random() + np.arange(size)) / size
        found = np.minimum(np.searchsorted(np.cumsum(self.weight[order]), places), len(order) - 1)
        return rng.permutation(self.free[order][found])

    def log_proposal(self, free: Array) -> Array:
        """Log density with which `draw` gives points (n, h), on the scale of f, shape (n,); −inf where it never does."""
        place = np.linalg.solve(self.root, (free - self.centre).T).T / self.step
        return np.logaddexp(*[grid.at(place) for grid in self.grids]) - np.log(2.0)

    @cached_property
    def _places(self) -> Array:
        return np.concatenate([grid.index + grid.offset for grid in self.grids])

    @cached_property
    def _cumulated(self) -> Array:
        return np.cumsum(self.weight)

    def corrected(self, log_density: Callable[[Array], Array], *, spare: float) -> Lattice:
        """The lattice of a nearby density: evaluated where the nodes matter, but for a share ``spare`` of the integral."""
        order = np.argsort(self.weight)
        matter = np.ones(len(order), dtype=bool)
        matter[order[np.cumsum(self.weight[order]) < spare]] = False
        free, values = self.free, self.log_density
        values[matter] = _in_chunks(log_density, free[matter])
        parts = np.split(values, [len(self.grids[0].key)])
        first, second = (replace(grid, log_density=part) for grid, part in zip(self.grids, parts, strict=True))
        return replace(self, grids=(first, second))

    @property
    def _halves(self) -> tuple[float, float]:
        cell = len(self.centre) * np.log(self.step) + np.linalg.slogdet(self.root)[1]
        first, second = (float(np.logaddexp.reduce(grid.log_density) + cell) for grid in self.grids)
        return first, second


def grow_lattice(
    log_density: Callable[[Array], Array],
    centre: Array,
    root: Array,
    *,
    tolerance: float = 1e-3,
    step: float = 1.0,
    most: int = 200_000,
) -> Lattice:
    """A lattice whose error is below the tolerance: grown outwards to what no longer counts, its step shortened as needed.

    Parameters
    ----------
    log_density : callable
        (n, h) → (n,).
    centre : ndarray, shape (h,)
        Where the density is high.
    root : ndarray, shape (h, h)
        A square root of the covariance there.
    tolerance : float
        Of ln ∫ f. The lattice's ``error`` says what was reached.
    step : float
        First step, in sd.
    most : int
        Nodes at which shortening the step stops; growing stops there too, and the error says what was left out.
    """
    depth = 8.0 - np.log(tolerance)
    while True:
        first, second = (_grow(log_density, centre, root, step, offset, depth, most) for offset in (0.0, 0.5))
        total = np.logaddexp.reduce(np.concatenate([first[0].log_density, second[0].log_density]))
        left_out = _BEYOND * float(np.exp(np.logaddexp(first[1], second[1]) - total))
        lattice = Lattice(centre, root, step, (first[0], second[0]), left_out)
        size = len(first[0].key) + len(second[0].key)
        if lattice.error <= tolerance or size * 0.75 ** -len(centre) > most:
            return lattice
        if left_out > tolerance / 2.0:
            depth += 3.0
        else:
            step *= 0.75


def _grow(
    log_density: Callable[[Array], Array], centre: Array, root: Array, step: float, offset: float, depth: float, most: int
) -> tuple[_Grid, float]:
    """One grid, and the log sum over its outermost points."""
    h = len(centre)
    neighbours = np.vstack([np.eye(h, dtype=np.int64), -np.eye(h, dtype=np.int64)])
    front = np.array(list(itertools.product((0, -1) if offset else (0,), repeat=h)), dtype=np.int64)
    seen = np.zeros(0, dtype=np.int64)
    indices, values, top, count = [], [], -np.inf, 0
    while len(front):
        points = _points(centre, root, step, front + offset)
        value = _in_chunks(log_density, points)
        seen = np.union1d(seen, _key(front))
        indices.append(front)
        values.append(value)
        top, count = max(top, float(value.max())), count + len(front)
        onward = front[value > top - depth]
        if count > most:
            break
        candidates = (onward[:, None] + neighbours).reshape(-1, h)
        key, first = np.unique(_key(candidates), return_index=True)
        front = candidates[first[~np.isin(key, seen)]]
    index, value = np.concatenate(indices), np.concatenate(values)
    order = np.argsort(_key(index))
    edge = value <= top - depth
    if count > most:
        edge[-len(front) :] = True
    log_edge = float(np.logaddexp.reduce(value[edge])) if edge.any() else -np.inf
    return _Grid(offset, _key(index)[order], index[order], value[order]), log_edge


def _in_chunks(log_density: Callable[[Array], Array], points: Array) -> Array:
    return np.concatenate([log_density(part) for part in np.array_split(points, max(1, -(-len(points) // _CHUNK)))])


def _points(centre: Array, root: Array, step: float, place: Array) -> Array:
    return np.asarray(centre + step * place @ root.T)


def _key(index: NDArray[np.int64]) -> NDArray[np.int64]:
    """One integer for each grid point."""
    limited = np.clip(index, -_REACH, _REACH - 1)
    key: NDArray[np.int64] = (limited + _REACH) @ ((2 * _REACH) ** np.arange(index.shape[1], dtype=np.int64))
    return key
