"""p(φ | y), everything linear integrated out: its mode, weighted nodes, and exact draws of φ and of β given φ.

Nodes are those of the trapezoidal rule in several dimensions, on a grid that grows from the mode until nothing is left to find.
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
import scipy.stats
from numpy.typing import NDArray

from ldbb_bayes.errors import InputError
from ldbb_bayes.model.gaussian import central_differences, newton
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.likelihood import ParameterConditional

__all__ = ["CHUNK", "HyperPosterior", "Lattice", "conditional_draws", "draw_hyper", "draw_parameters_given", "grow_lattice"]

Array = NDArray[Any]
CHUNK = 256
_REACH = 1 << 13
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
    """Weighted nodes of a density f on ℝ^h.

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

    @cached_property
    def _places(self) -> Array:
        return np.concatenate([grid.index + grid.offset for grid in self.grids])

    @cached_property
    def free(self) -> Array:
        """Nodes, shape (n, h)."""
        return _points(self.centre, self.root, self.step, self._places)

    @cached_property
    def log_density(self) -> Array:
        """ln f at the nodes, shape (n,)."""
        return np.concatenate([grid.log_density for grid in self.grids])

    @cached_property
    def weight(self) -> Array:
        """Normalised weights of the nodes, shape (n,)."""
        weight = np.exp(self.log_density - self.log_density.max())
        return weight / weight.sum()

    @cached_property
    def _halves(self) -> tuple[float, float]:
        cell = len(self.centre) * np.log(self.step) + np.linalg.slogdet(self.root)[1]
        first, second = (float(np.logaddexp.reduce(grid.log_density) + cell) for grid in self.grids)
        return first, second

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

    def heaviest(self, spare: float) -> tuple[Array, Array]:
        """Nodes and normalised weights, but for a share ``spare`` of the integral."""
        heavy = self._heavy(spare)
        return self.free[heavy], self.weight[heavy] / self.weight[heavy].sum()

    def _heavy(self, spare: float) -> NDArray[np.intp]:
        order = np.argsort(self.weight)
        return np.sort(order[np.cumsum(self.weight[order]) >= spare])

    def draw(self, size: int, rng: np.random.Generator | np.random.RandomState, *, temperature: float = 1.0) -> Array:
        """Independent draws from the density as the lattice sees it, constant in every cell, shape (size, h).

        Parameters
        ----------
        temperature : float
            More than 1 draws from the density's power 1/temperature, which is wider.
        """
        cumulated = np.cumsum(self.weight if temperature == 1.0 else self.weight ** (1.0 / temperature))
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

    def corrected(self, log_density: Callable[[Array], Array], *, spare: float) -> Lattice:
        """The lattice of a nearby density: evaluated where the nodes count, but for a share ``spare`` of the integral."""
        heavy, values = self._heavy(spare), self.log_density.copy()
        values[heavy] = _in_chunks(log_density, self.free[heavy])
        parts = np.split(values, [len(self.grids[0].key)])
        first, second = (replace(grid, log_density=part) for grid, part in zip(self.grids, parts, strict=True))
        return replace(self, grids=(first, second))


def grow_lattice(
    log_density: Callable[[Array], Array],
    centre: Array,
    root: Array,
    *,
    tolerance: float = 1e-3,
    step: float = 1.0,
    most: int = 200_000,
) -> Lattice:
    """A lattice whose error of ln ∫ f is below the tolerance: grown out to what no longer counts, its step shortened as needed.

    ``log_density`` maps (n, h) to (n,); ``root`` (h, h) is a square root of the covariance at ``centre``, where the density is
    high; the first ``step`` is in sd. At ``most`` nodes growing and shortening stop, and the error says what was left out.
    """
    depth = 8.0 - np.log(tolerance)
    while True:
        first, second = (_grow(log_density, centre, root, step, offset, depth, most) for offset in (0.0, 0.5))
        total = np.logaddexp.reduce(np.concatenate([first[0].log_density, second[0].log_density]))
        left_out = _BEYOND * float(np.exp(np.logaddexp(first[1], second[1]) - total))
        lattice = Lattice(centre, root, step, (first[0], second[0]), left_out)
        if lattice.error <= tolerance or len(lattice.weight) * 0.75 ** -len(centre) > most:
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
        value = _in_chunks(log_density, _points(centre, root, step, front + offset))
        seen = np.union1d(seen, _key(front))
        indices.append(front)
        values.append(value)
        top, count = max(top, float(value.max())), count + len(front)
        if count > most:
            break
        candidates = (front[value > top - depth][:, None] + neighbours).reshape(-1, h)
        key, first = np.unique(_key(candidates), return_index=True)
        front = candidates[first[~np.isin(key, seen)]]
    index, value = np.concatenate(indices), np.concatenate(values)
    edge = value <= top - depth
    if count > most:
        edge[-len(front) :] = True
    log_edge = float(np.logaddexp.reduce(value[edge])) if edge.any() else -np.inf
    key = _key(index)
    order = np.argsort(key)
    return _Grid(offset, key[order], index[order], value[order]), log_edge


def _in_chunks(log_density: Callable[[Array], Array], points: Array) -> Array:
    return np.concatenate([log_density(part) for part in np.array_split(points, max(1, -(-len(points) // CHUNK)))])


def _points(centre: Array, root: Array, step: float, place: Array) -> Array:
    return np.asarray(centre + step * place @ root.T)


def _key(index: NDArray[np.int64]) -> NDArray[np.int64]:
    """One integer for each grid point."""
    limited = np.clip(index, -_REACH, _REACH - 1)
    key: NDArray[np.int64] = (limited + _REACH) @ ((2 * _REACH) ** np.arange(index.shape[1], dtype=np.int64))
    return key


_STEP, _FLATTEST = 0.05, 0.3
_STARTS, _BASINS, _APART = 256, 3, 1.5
_COARSE, _COARSE_STEP = 0.2, 1.25
_LOOSE, _STEP_BY_DEFAULT, _LONG_STEP = 1e-2, 1.0, 1.75


class HyperPosterior:
    """p(φ | y), with or without the truncation, in free coordinates.

    Parameters
    ----------
    bound : BoundModel
    truncated : bool
        Include P(T | y, φ), the probability of physical compliances (whether or not the model imposes them).
    seed : int
        Of the starting points of the search and of the quasi-random points of P(T | y, φ).
    near : ndarray, shape (h,), optional
        Free coordinates of the mode of a density much like this one; saves the search for it.

    Attributes
    ----------
    mode : ndarray, shape (h,)
        Of the density in free coordinates.
    spread : ndarray, shape (h, h)
        Root of the inverse curvature there.
    """

    def __init__(self, bound: BoundModel, *, truncated: bool, seed: int = 0, near: Array | None = None) -> None:
        self.bound, self.truncated, self._seed = bound, truncated, seed
        self.mode = self._locate() if near is None else self._climb(near)
        curvature, vectors = np.linalg.eigh(-self._derivatives(self.mode)[1])
        self.spread = vectors / np.sqrt(np.maximum(curvature, _FLATTEST))

    def given(self, free: Array) -> tuple[Array, ParameterConditional]:
        """ln p(y | φ), shape (w,), and p(β | y, φ) at free coordinates (w, h)."""
        return self.bound.given(self.bound.hyper_prior.phi(free))

    def log_density(self, free: Array) -> Array:
        """ln p(y, free coordinates), shape (w,), with ln P(T | y, φ) where truncated."""
        return self._log_density(free, lambda given: given.orthant.log_value(seed=self._seed))

    def log_smooth_density(self, free: Array) -> Array:
        """The same with the upper bound of P(T | y, φ), which is cheaper and smooth."""
        return self._log_density(free, lambda given: given.orthant.log_bound)

    def _log_density(self, free: Array, log_truncation: Callable[[ParameterConditional], Array]) -> Array:
        total = self.bound.hyper_prior.log_density_of_free(free)
        inside = np.isfinite(total)
        if inside.any() and self.truncated:
            log_evidence, given = self.given(free[inside])
            total[inside] += log_evidence + log_truncation(given)
        elif inside.any():
            total[inside] += self.bound.log_evidence(self.bound.hyper_prior.phi(free[inside]))
        return np.asarray(total)

    def lattice(self, tolerance: float = 1e-3) -> Lattice:
        """Weighted nodes of p(y, free coordinates) whose integral has this tolerance [nat]."""
        step = _STEP_BY_DEFAULT if tolerance < _LOOSE else _LONG_STEP
        lattice = grow_lattice(self.log_smooth_density, self.mode, self.spread, tolerance=tolerance, step=step)
        return self._exact(lattice, tolerance)

    @cached_property
    def coarse(self) -> Lattice:
        """A lattice good enough to propose from; P(T | y, φ) by its bound."""
        return grow_lattice(self.log_smooth_density, self.mode, self.spread, tolerance=_COARSE, step=_COARSE_STEP)

    @cached_property
    def brief(self) -> Lattice:
        """The coarse lattice with P(T | y, φ) itself."""
        return self._exact(self.coarse, _COARSE)

    def _exact(self, lattice: Lattice, tolerance: float) -> Lattice:
        return lattice.corrected(self.log_density, spare=tolerance / 100.0) if self.truncated else lattice

    def _locate(self) -> Array:
        """The mode: Newton's method from the best of many starting points, several basins tried."""
        prior = self.bound.hyper_prior
        points = scipy.stats.qmc.Sobol(len(prior.names), rng=np.random.default_rng(self._seed)).random(_STARTS)
        starts = np.log(2.0 * prior.scale_mm) - points * np.where(prior.lower_mm > 0, 12.0, 6.0)
        starts = starts[np.argsort(-self.log_smooth_density(starts))]
        basins: list[Array] = []
        for start in starts[: _STARTS // 4]:
            if len(basins) < _BASINS and all(np.linalg.norm(start - other) > _APART for other in basins):
                basins.append(start)
        modes = np.array([self._climb(start) for start in basins])
        return np.asarray(modes[int(np.argmax(self.log_smooth_density(modes)))])

    def _climb(self, start: Array) -> Array:
        return newton(self.log_smooth_density, self._derivatives, start, least_curvature=_FLATTEST)

    def _derivatives(self, point: Array) -> tuple[Array, Array]:
        return central_differences(self.log_smooth_density, point, _STEP)


_ROUNDS_INSIDE = 20
_ROUNDS_OF_PROPOSALS = 50
_ENVELOPE = 2.0


def conditional_draws(bound: BoundModel, free: Array, rng: np.random.Generator) -> tuple[Array, NDArray[np.bool_]]:
    """One draw of β for each free coordinates from its exact conditional Gaussian inside the truncation.

    Returns
    -------
    beta : ndarray, shape (w, p)
    exact : ndarray of bool, shape (w,)
        False where the rejection sampler gave up, or rounding left β outside.
    """
    beta, exact = np.zeros((len(free), len(bound.names))), np.ones(len(free), dtype=bool)
    for start in range(0, len(free), CHUNK):
        part = slice(start, start + CHUNK)
        _, given = bound.given(bound.hyper_prior.phi(free[part]))
        if bound.truncation.active:
            beta[part], exact[part] = given.draw_inside(rng)
        else:
            beta[part] = given.draw(rng)
    return beta, exact


def draw_parameters_given(start: HyperPosterior, free: Array, rng: np.random.Generator) -> Array:
    """β given each φ, shape (w, p): exact conditional draws, repeated until all are inside the truncation.

    Raises
    ------
    InputError
        When rounds of exact rejection leave some undrawn: the readings leave no room inside the truncation.
    """
    beta, accepted = conditional_draws(start.bound, free, rng)
    for _ in range(_ROUNDS_INSIDE):
        if accepted.all():
            break
        missing = np.flatnonzero(~accepted)
        beta[missing], accepted[missing] = conditional_draws(start.bound, free[missing], rng)
    if not accepted.all():
        raise InputError(
            "the posterior must leave room inside the truncation, got draws that never fall into it. The readings contradict "
            "non-negative compliance: check signs, mount compensation and forces, or fit --without truncation."
        )
    return beta


def draw_hyper(start: HyperPosterior, size: int, rng: np.random.Generator) -> tuple[Array, float]:
    """Independent draws of free coordinates, shape (size, h), and the share of proposals used.

    Rejection from the coarse lattice. Where the density passes the envelope the proposal is used as often as it is owed.

    Raises
    ------
    InputError
        When almost nothing is accepted: the density is too rough for its lattice.
    """
    lattice = start.coarse
    kept: list[Array] = []
    used, tried = 0, 0
    scale: float | None = None
    for _ in range(_ROUNDS_OF_PROPOSALS):
        wanted = max(int(1.2 * _ENVELOPE * (size - used)), CHUNK)
        free = lattice.draw(wanted, rng)
        ratio = _in_chunks(start.log_density, free) - lattice.log_proposal(free)
        if scale is None:
            scale = float(np.logaddexp.reduce(ratio) - np.log(wanted)) + np.log(_ENVELOPE)
        owed = np.exp(ratio - scale)
        times = np.floor(owed) + (rng.random(wanted) < owed % 1.0)
        kept.append(np.repeat(free, times.astype(int), axis=0))
        used, tried = used + len(kept[-1]), tried + wanted
        if used >= size:
            return rng.permutation(np.concatenate(kept))[:size], used / tried
    raise InputError(
        f"the density of the hyper-parameters must be smooth, got {used} of {size} draws from {tried} proposals. "
        "Use --sampler joint."
    )
