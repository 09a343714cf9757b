"""p(φ | y), everything linear integrated out: its mode, weighted nodes, exact draws, and what is averaged over the nodes.

Nodes are those of the trapezoidal rule in several dimensions, on a grid that grows from the mode until nothing is left to find.
For a smooth function that dies away on every side the rule converges geometrically in its step (Trefethen and Weideman,
SIAM Review 56, 385-458, 2014). Two grids, the second moved by half a step along every axis, make one body-centred lattice:
errors along single axes cancel in their mean, and what is left is of the order of the square of their difference.
"""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
import scipy.stats
from numpy.typing import NDArray

from ldbb_bayes.errors import InputError
from ldbb_bayes.model.gaussian import central_differences, mixture_quantiles, newton
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.likelihood import ParameterConditional
from ldbb_bayes.model.truncation import Orthant

__all__ = [
    "CHUNK",
    "Evidence",
    "HyperPosterior",
    "Lattice",
    "Nodes",
    "conditional_draws",
    "draw_hyper",
    "draw_parameters_given",
    "grow_lattice",
]

Array = NDArray[Any]
LogDensity = Callable[[Array], Array]
CHUNK = 256
_REACH = 1 << 13
_BEYOND, _MEAN_OF_TWO = 3.0, 0.25


@dataclass(frozen=True, eq=False)
class Lattice:
    """Weighted nodes of a density f on ℝ^h.

    ``place`` (n, h) are the nodes in steps ``step · root`` (h, h) from the ``centre`` (h,): those of the ``first`` grid, whole,
    then the other's, moved by a half, each in the order of `_key`; ``log_density`` (n,) is ln f there; ``left_out`` the share of
    the integral beyond the edge, estimated by what lies on it.
    """

    centre: Array
    root: Array
    step: float
    place: Array
    first: int
    log_density: Array
    left_out: float

    @cached_property
    def free(self) -> Array:
        """Nodes, shape (n, h)."""
        return _points(self.centre, self.root, self.step, self.place)

    @cached_property
    def weight(self) -> Array:
        """Normalised weights of the nodes, shape (n,)."""
        weight = np.exp(self.log_density - self.log_density.max())
        return weight / weight.sum()

    @property
    def _halves(self) -> tuple[float, float]:
        """ln ∫ f by each of the two grids."""
        cell = len(self.centre) * np.log(self.step) + np.linalg.slogdet(self.root)[1]
        first, second = (float(np.logaddexp.reduce(half) + cell) for half in np.split(self.log_density, [self.first]))
        return first, second

    @property
    def log_integral(self) -> float:
        """ln ∫ f."""
        return float(np.logaddexp(*self._halves) - np.log(2.0))

    @property
    def error(self) -> float:
        """Of the logarithm: a quarter of the two grids' difference (seen to bound the error of their mean), and what lies beyond
        the edge."""
        first, second = self._halves
        return float(max((first - second) ** 2, _MEAN_OF_TWO * abs(first - second)) + self.left_out)

    def heaviest(self, spare: float) -> tuple[Array, Array]:
        """Nodes and normalised weights, but for a share ``spare`` of the integral."""
        heavy = self._heavy(spare)
        return self.free[heavy], self.weight[heavy] / self.weight[heavy].sum()

    def _heavy(self, spare: float) -> NDArray[np.intp]:
        order = np.argsort(self.weight)
        return np.sort(order[np.cumsum(self.weight[order]) >= spare])

    def pick(self, size: int, rng: np.random.Generator) -> Array:
        """Nodes picked by their weights, systematically and in random order, shape (size, h)."""
        order = np.lexsort(self.free.T)
        reached = np.searchsorted(np.cumsum(self.weight[order]), (rng.random() + np.arange(size)) / size)
        return rng.permutation(self.free[order][np.minimum(reached, len(order) - 1)])

    def draw(self, size: int, rng: np.random.Generator | np.random.RandomState, *, temperature: float = 1.0) -> Array:
        """Independent draws from f to the power 1/temperature as the lattice sees it, constant in every cell, shape (size, h)."""
        cumulated = np.cumsum(self.weight if temperature == 1.0 else self.weight ** (1.0 / temperature))
        picked = np.searchsorted(cumulated, cumulated[-1] * rng.uniform(size=size), side="right")
        place = self.place[np.minimum(picked, len(cumulated) - 1)]
        return _points(self.centre, self.root, self.step, place + rng.uniform(-0.5, 0.5, (size, len(self.centre))))

    def log_proposal(self, free: Array) -> Array:
        """Log density with which `draw` gives points (n, h), on the scale of f, shape (n,); −inf where it never does."""
        place = np.linalg.solve(self.root, (free - self.centre).T).T / self.step
        values = []
        for offset, keys, value in zip((0.0, 0.5), self._keys, np.split(self.log_density, [self.first]), strict=True):
            key = _key(np.rint(place - offset))
            nearest = np.minimum(np.searchsorted(keys, key), len(keys) - 1)
            values.append(np.where(keys[nearest] == key, value[nearest], -np.inf))
        return np.logaddexp(*values) - np.log(2.0)

    @cached_property
    def _keys(self) -> list[NDArray[np.int64]]:
        return np.split(_key(np.floor(self.place)), [self.first])

    def corrected(self, log_density: LogDensity, *, spare: float) -> Lattice:
        """The lattice of a nearby density: evaluated where the nodes count, but for a share ``spare`` of the integral."""
        heavy, values = self._heavy(spare), self.log_density.copy()
        values[heavy] = _in_chunks(log_density, self.free[heavy])
        return replace(self, log_density=values)


def grow_lattice(
    log_density: LogDensity, centre: Array, root: Array, *, tolerance: float = 1e-3, step: float = 1.0, most: int = 200_000
) -> Lattice:
    """A lattice whose error of ln ∫ f is below the tolerance: grown out to what no longer counts, its step shortened as needed.

    ``log_density`` maps (n, h) to (n,); ``root`` (h, h) is a square root of the covariance at ``centre``, where the density is
    high; the first ``step`` is in sd. At ``most`` nodes growing and shortening stop, and the error says what was left out.
    """
    depth = 8.0 - np.log(tolerance)
    while True:
        points = partial(_points, centre, root, step)
        grids = [_grow(log_density, points, len(centre), offset, depth, most) for offset in (0.0, 0.5)]
        place, value, edge = (np.concatenate(parts) for parts in zip(*grids, strict=True))
        beyond = np.logaddexp.reduce(value[edge]) if edge.any() else -np.inf
        left_out = _BEYOND * float(np.exp(beyond - np.logaddexp.reduce(value)))
        lattice = Lattice(centre, root, step, place, len(grids[0][0]), value, left_out)
        if lattice.error <= tolerance or len(value) * 0.75 ** -len(centre) > most:
            return lattice
        if left_out > tolerance / 2.0:
            depth += 3.0
        else:
            step *= 0.75


def _grow(
    log_density: LogDensity, points: Callable[[Array], Array], h: int, offset: float, depth: float, most: int
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Places of one grid, their log densities, and which of them are its edge: from the centre on, neighbours of what counts."""
    neighbours = np.vstack([np.eye(h), -np.eye(h)])
    front = np.array(list(itertools.product((0.0, -1.0) if offset else (0.0,), repeat=h)))
    keys = np.zeros(0, dtype=np.int64)
    index, values, top = np.zeros((0, h)), np.zeros(0), -np.inf
    while len(front) and len(index) <= most:
        value = _in_chunks(log_density, points(front + offset))
        index, values, keys = np.concatenate([index, front]), np.concatenate([values, value]), np.union1d(keys, _key(front))
        top, last = max(top, float(value.max())), len(front)
        candidates = (front[value > top - depth][:, None] + neighbours).reshape(-1, h)
        key, fresh = np.unique(_key(candidates), return_index=True)
        front = candidates[fresh[~np.isin(key, keys)]]
    edge = values <= top - depth
    if len(index) > most:
        edge[-last:] = True
    order = np.argsort(_key(index))
    return index[order] + offset, values[order], edge[order]


def _in_chunks(log_density: LogDensity, points: Array) -> Array:
    return np.concatenate([log_density(part) for part in np.array_split(points, max(1, -(-len(points) // CHUNK)))])


def _points(centre: Array, root: Array, step: float, place: Array) -> Array:
    return np.asarray(centre + step * place @ root.T)


def _key(index: Array) -> NDArray[np.int64]:
    """One integer for each grid point."""
    limited = np.clip(index, -_REACH, _REACH - 1).astype(np.int64)
    key: NDArray[np.int64] = (limited + _REACH) @ ((2 * _REACH) ** np.arange(index.shape[1], dtype=np.int64))
    return key


_STEP, _FLATTEST = 0.05, 0.3
_STARTS, _BASINS, _APART = 256, 3, 1.5
_COARSE, _COARSE_STEP = 0.2, 1.25
_LOOSE, _STEP_BY_DEFAULT, _LONG_STEP = 1e-2, 1.0, 1.75


class HyperPosterior:
    """p(φ | y), with or without the truncation, in free coordinates.

    Its ``mode`` (h,), and ``spread`` (h, h), a root of the inverse curvature there.

    Parameters
    ----------
    bound : BoundModel
    truncated : bool
        Include P(T | y, φ), the probability of physical compliances (whether or not the model imposes them).
    seed : int
        Of the starting points of the search and of the quasi-random points of P(T | y, φ).
    near : ndarray, shape (h,), optional
        Free coordinates of the mode of a density much like this one; saves the search for it.
    """

    def __init__(self, bound: BoundModel, *, truncated: bool, seed: int = 0, near: Array | None = None) -> None:
        self.bound, self.truncated, self._seed = bound, truncated, seed
        self.mode = self._locate() if near is None else self._climb(near)
        curvature, vectors = np.linalg.eigh(-self._derivatives(self.mode)[1])
        self.spread = vectors / np.sqrt(np.maximum(curvature, _FLATTEST))

    def given(self, free: Array) -> tuple[Array, ParameterConditional]:
        """ln p(y | φ), shape (w,), and p(β | y, φ) at free coordinates (w, h)."""
        return self.bound.given(self.bound.hyper_prior.phi(free))

    def log_density(self, free: Array, *, smooth: bool = False) -> Array:
        """ln p(y, free coordinates), shape (w,), where truncated with ln P(T | y, φ) or its upper bound, cheaper and smooth."""
        total = self.bound.hyper_prior.log_density_of_free(free)
        inside = np.isfinite(total)
        if inside.any() and self.truncated:
            log_evidence, given = self.given(free[inside])
            total[inside] += log_evidence + (given.orthant.log_bound if smooth else given.orthant.log_value(seed=self._seed))
        elif inside.any():
            total[inside] += self.bound.log_evidence(self.bound.hyper_prior.phi(free[inside]))
        return np.asarray(total)

    def nodes(self, tolerance: float = 1e-3) -> Nodes:
        """Weighted nodes of p(y, free coordinates) whose integral has this tolerance [nat]."""
        step = _STEP_BY_DEFAULT if tolerance < _LOOSE else _LONG_STEP
        lattice = grow_lattice(self._smooth, self.mode, self.spread, tolerance=tolerance, step=step)
        return Nodes(self, self._exact(lattice, tolerance))

    @cached_property
    def coarse(self) -> Lattice:
        """A lattice good enough to propose from; P(T | y, φ) by its bound."""
        return grow_lattice(self._smooth, self.mode, self.spread, tolerance=_COARSE, step=_COARSE_STEP)

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
        starts = starts[np.argsort(-self._smooth(starts))]
        basins: list[Array] = []
        for start in starts[: _STARTS // 4]:
            if len(basins) < _BASINS and all(np.linalg.norm(start - other) > _APART for other in basins):
                basins.append(start)
        modes = np.array([self._climb(start) for start in basins])
        return np.asarray(modes[int(np.argmax(self._smooth(modes)))])

    def _climb(self, start: Array) -> Array:
        return newton(self._smooth, self._derivatives, start, least_curvature=_FLATTEST)

    def _smooth(self, free: Array) -> Array:
        return self.log_density(free, smooth=True)

    def _derivatives(self, point: Array) -> tuple[Array, Array]:
        return central_differences(self._smooth, point, _STEP)


@dataclass(frozen=True)
class Evidence:
    """ln Z of a model and a campaign.

    Attributes
    ----------
    log_value : float
        ln of the density of the readings in mm; only differences between models of the same readings mean anything.
    error : float
        Of ``log_value`` [nat].
    nodes : int
        Of the quadrature.
    sha256 : str
        Digest of the readings it is of.
    """

    log_value: float
    error: float
    nodes: int
    sha256: str


_CHECKED = 64
_SPARE, _COMPONENTS = 1e-7, 8192


@dataclass(frozen=True, eq=False)
class Nodes:
    """p(φ | y) as weighted nodes, and what is averaged over them."""

    posterior: HyperPosterior
    lattice: Lattice

    @property
    def bound(self) -> BoundModel:
        """The model and its campaign."""
        return self.posterior.bound

    @cached_property
    def error(self) -> float:
        """Of the log integral [nat]: the lattice's, and that of P(T | y, φ) over the heaviest nodes, which all share."""
        if not self.posterior.truncated:
            return self.lattice.error
        heaviest = np.argsort(-self.lattice.weight)[:_CHECKED]
        _, error = self.posterior.given(self.lattice.free[heaviest])[1].orthant.log_probability()
        return self.lattice.error + float(np.average(error, weights=self.lattice.weight[heaviest]))

    @cached_property
    def evidence(self) -> Evidence:
        """ln Z = ln ∫ p(y | φ) p(φ) dφ; truncated: ln Z + ln P(T | y) − ln P(T | prior)."""
        campaign, names = self.bound.campaign, self.bound.test_names
        sha256 = campaign.sha256
        if len(names) < len(campaign.tests):
            sha256 = hashlib.sha256("\n".join([sha256, *names]).encode()).hexdigest()
        prior = self.bound.log_prob_truncation_prior if self.posterior.truncated else 0.0
        return Evidence(self.lattice.log_integral - prior, self.error, len(self.lattice.weight), sha256)

    def draw(self, size: int, rng: np.random.Generator) -> tuple[Array, Array]:
        """β given nodes picked by their weights, shape (size, p), and their φ, shape (size, h) [mm]."""
        free = self.lattice.pick(size, rng)
        return draw_parameters_given(self.posterior, free, rng), self.bound.hyper_prior.phi(free)

    def moments(self, *, spare: float = _SPARE) -> tuple[Array, Array]:
        """Mean and sd of β, each (p,): those given φ, averaged over the nodes but for a share ``spare`` of the integral."""
        free, weight = self.lattice.heaviest(spare)
        every, variance = self._given(free, lambda orthant: orthant.moments()[:2])
        mean = weight @ every
        return mean, np.sqrt(weight @ (variance + (every - mean) ** 2))

    def quantiles(self, levels: Array, *, seed: int, components: int = _COMPONENTS) -> Array:
        """Quantiles of β, shape (levels, p): of Gaussians given φ and, inside the truncation, the constrained directions."""
        rng = np.random.default_rng(seed)

        def drawn(orthant: Orthant) -> tuple[Array, Array]:
            x, _ = orthant.draw(rng)
            return x, np.zeros((*x.shape, x.shape[1]))

        mean, variance = self._given(self.lattice.pick(components, rng), drawn)
        sd = np.maximum(np.sqrt(np.maximum(variance, 0.0)), 1e-6 * mean.std(axis=0))
        return mixture_quantiles(np.full(len(mean), 1.0 / len(mean)), mean, sd, levels)

    def _given(self, free: Array, inside: Callable[[Orthant], tuple[Array, Array]]) -> Iterator[Array]:
        """Means and variances of β given φ, (w, p) each; ``inside``: mean and covariance along the axes truncation acts on."""
        parts = []
        for start in range(0, len(free), CHUNK):
            _, given = self.posterior.given(free[start : start + CHUNK])
            spread = given.spread()
            mean, variance = given.mean, (spread**2).sum(axis=2)
            if self.posterior.truncated:
                shift, covariance = inside(given.orthant)
                along = spread @ np.swapaxes(given.orthant.axes, 1, 2)
                mean = mean + np.einsum("wpd,wd->wp", along, shift)
                variance = variance + np.einsum("wpd,wde,wpe->wp", along, covariance - np.eye(shift.shape[1]), along)
            parts.append((mean, variance))
        return (np.concatenate(own) for own in zip(*parts, strict=True))


_ROUNDS_INSIDE, _ROUNDS_OF_PROPOSALS = 20, 50
_ENVELOPE = 2.0


def conditional_draws(bound: BoundModel, free: Array, rng: np.random.Generator) -> tuple[Array, NDArray[np.bool_]]:
    """One draw of β (w, p) for each free coordinates from its exact conditional Gaussian inside the truncation; and whether it is
    exact: not where the rejection sampler gave up, or rounding left β outside."""
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
    beta, missing = np.zeros((len(free), len(start.bound.names))), np.arange(len(free))
    for _ in range(1 + _ROUNDS_INSIDE):
        beta[missing], exact = conditional_draws(start.bound, free[missing], rng)
        missing = missing[~exact]
        if not missing.size:
            return beta
    raise InputError(
        "the posterior must leave room inside the truncation, got draws that never fall into it. The readings contradict "
        "non-negative compliance: check signs, mount compensation and forces, or fit --without truncation."
    )


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
