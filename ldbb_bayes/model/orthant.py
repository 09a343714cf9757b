"""Probabilities of orthants under Gaussian distributions, and exact draws inside."""

from __future__ import annotations

from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, ndtr, owens_t

from ldbb_bayes.model.tilting import DEPENDENT, ROUNDING, Tilted, least_distance, saddle_point
from ldbb_bayes.model.triangular import solve_lower
from ldbb_bayes.results import Array

__all__ = ["Orthant"]


_CERTAIN = 12.0


_PUSHED = -3.0


_NEAR = 6.0


_MOST_TRIES = 64


_RULE = 24


# Quasi-random points of each of so many scrambles; Student's factor for their scatter; how much of
# plain random numbers' error is left at least, as few scrambles may agree by luck; numbers computed
# together.
_SIZES = (32, 128, 512, 2048, 8192)


_SCRAMBLES = 8


_STUDENT = 1.5


_LUCK = 0.1


_TOGETHER = 1 << 20


_DIGITS = 1e5


# Owen's T is exact to 1e-15: of smaller probabilities, or rows more alike, too few digits are left.
_OWEN = 1e-15


_LEAST_PAIR = 1e-9


_ALIKE = 1e-6


# A lattice for up to 2²⁰ points, extensible (F. Y. Kuo, lattice-32001-1024-1048576), then any odd
# numbers.
_LATTICE = (1, 182667, 469891, 498753, 110745, 446979, 250185, 118627, 245333, 283199)


class Orthant:
    """P(u ≥ 0) for u ~ N(mean, spread spreadᵀ), a batch of w of them: means (w, m), spreads (w, m,
    q). InputError where the saddle point is out of reach of double precision."""

    def __init__(self, mean: Array, spread: Array) -> None:
        self._mean = mean
        self._spread = spread

    def log_probability(self, tolerance: float = 1e-3, *, seed: int = 0) -> tuple[Array, Array]:
        """ln P and its error [nat], each of shape (w,), of every member alone, whatever else is in
        the batch.

        In closed form where bounds are no further apart than the tolerance, else from as many
        quasi-random points as it needs, up to 65 536: the scatter of independent scrambles times
        Student's factor, so that three errors hold 99 %. Members share points: their errors add up.
        Infinite, at the upper bound, where no point satisfies rows beyond the rank.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = self._mean / np.linalg.norm(self._spread, axis=2)
        distance = np.where(np.isnan(distance), np.inf, distance)
        value, error = _closed_form(distance, self._spread)
        open_ = np.flatnonzero(error > tolerance)
        for near in (_NEAR, np.inf):
            # Rows that are far from failing are left out at first; where these are too many, all
            # are taken.
            kept = distance[open_] < near
            again = np.zeros(len(open_), dtype=bool)
            for pattern in np.unique(kept, axis=0):
                alike = np.flatnonzero((kept == pattern).all(axis=1))
                index = open_[alike]
                part = Orthant(self._mean[index][:, pattern], self._spread[index][:, pattern])
                value[index], error[index] = part._by_points(tolerance, seed)
                with np.errstate(divide="ignore", over="ignore"):
                    left_out = np.exp(
                        np.log(ndtr(-distance[index][:, ~pattern]).sum(axis=1)) - value[index]
                    )
                error[index] += left_out
                again[alike] = left_out > 0.1 * tolerance
            open_ = open_[again]
        return value, error

    @property
    def log_bound(self) -> Array:
        """Upper bound of ln P, tight in the tails, shape (w,). Smooth; exact for one constraint."""
        return self._tilted.log_bound

    def moments(self, size: int = 512, *, seed: int = 0) -> tuple[Array, Array, Array]:
        """Mean (w, d) and covariance (w, d, d) of the standard normal e behind u = mean + spread e
        given u ≥ 0, along the orthonormal `axes` (w, d, q) that matter; across them e stays
        standard normal.

        The points of each member are moved by digits of its own numbers: what averages over many
        then averages their errors, and nothing depends on who else is in the batch.
        """
        d = len(self._tilted.bound)
        if d <= 2:
            points, log_rule = _rule(d)
            points = points[..., None]
        else:
            moved = (
                _lattice(d, size, seed)[:, :, None] + self._tilted.bound[:, None] * _DIGITS
            ) % 1.0
            points = 1.0 - np.abs(2.0 * moved - 1.0)
            log_rule = np.zeros(1)
        log_weight, x = self._tilted.propose(points)
        weight = np.exp(log_rule[:, None] + log_weight - log_weight.max(axis=0))
        weight /= weight.sum(axis=0)
        mean = np.einsum("sw,dsw->wd", weight, x)
        centred = x.transpose(2, 1, 0) - mean[:, None, :]
        return mean, np.einsum("sw,wsd,wse->wde", weight, centred, centred), self.axes

    @property
    def axes(self) -> Array:
        """Orthonormal directions of e that the rows near their edge depend on, shape (w, d, q): x =
        axes e."""
        return self._solved[1]

    def draw_along_axes(
        self, rng: np.random.Generator, *, most: int = 12_800
    ) -> tuple[Array, NDArray[np.bool_]]:
        """One exact draw of x = axes e given u ≥ 0 for each of the batch (w, d), by tilted
        rejection, and where one was accepted in about ``most`` proposals; elsewhere x is the last
        one."""
        d, w = self._tilted.bound.shape
        x = np.zeros((d, w))
        open_ = np.arange(w)
        tries = 2
        tried = 0
        while tried < most and open_.size:
            part = self._tilted.take(open_)
            log_weight, proposal = part.propose(
                rng.random((open_.size, tries, d)).transpose(2, 1, 0)
            )
            accept = log_weight - part.log_bound >= np.log(rng.random(log_weight.shape[::-1])).T
            x[:, open_] = proposal[:, np.argmax(accept, axis=0), np.arange(open_.size)]
            open_ = open_[~accept.any(axis=0)]
            tries, tried = min(2 * tries, _MOST_TRIES), tried + tries
        return x.T, ~np.isin(np.arange(w), open_)

    def draw_standard(self, rng: np.random.Generator) -> tuple[Array, NDArray[np.bool_]]:
        """One exact draw of the coordinates e of u = mean + spread e, e ~ N(0, I) given u ≥ 0,
        shape (w, q)."""
        x, accepted = self.draw_along_axes(rng)
        return self._complete(x, rng.standard_normal((len(x), self._spread.shape[2]))), accepted

    def propose_standard(self, uniform: Array, normal: Array) -> tuple[Array, Array]:
        """A tilted, nearly exact draw of the same e, and ln (exact density / density it was drawn
        with), up to ln P, from uniform numbers (w, m), of which those beyond the rows near their
        edge are not used, and normal ones (w, q)."""
        log_weight, x = self._tilted.propose(uniform.T[: len(self._tilted.bound), None])
        return self._complete(x[:, 0].T, normal), log_weight[0]

    def log_proposal_weight(self, white: Array) -> Array:
        """ln (exact density / density it would be drawn with) of given e (w, q), up to ln P; e
        inside the truncation."""
        return self._tilted.log_weight(np.einsum("wiq,wq->iw", self.axes, white)[:, None])[0]

    def _complete(self, x: Array, normal: Array) -> Array:
        """Standard normal e (w, q) given the standard-normal coordinates x behind the rows near
        their edge."""
        return normal + np.einsum(
            "wiq,wi->wq", self.axes, x - np.einsum("wiq,wq->wi", self.axes, normal)
        )

    def _by_points(self, tolerance: float, seed: int) -> tuple[Array, Array]:
        """ln P and its error by quasi-random points, four times as many until the error is within
        the tolerance."""
        tilted = self._tilted
        value = tilted.log_bound.copy()
        error = np.zeros(len(self._mean))
        if len(tilted.bound) + len(tilted.rest) > 1:
            error[:] = np.inf
        for size in _SIZES:
            points = _points(max(len(tilted.bound) - 1, 1), size, seed).reshape(
                -1, _SCRAMBLES * size, 1
            )
            every = np.flatnonzero(error > tolerance)
            for index in np.array_split(every, -(-every.size * points.shape[1] // _TOGETHER) or 1):
                log_weight = (
                    tilted.take(index).propose(points, last=False)[0].reshape(_SCRAMBLES, size, -1)
                )
                top = log_weight.max(axis=(0, 1))
                weight = np.exp(log_weight - np.where(np.isfinite(top), top, 0.0))
                mean, scatter = (
                    weight.mean(axis=(0, 1)),
                    weight.mean(axis=1).std(axis=0, ddof=1) / np.sqrt(_SCRAMBLES),
                )
                scatter = np.maximum(
                    _STUDENT * scatter, _LUCK * weight.std(axis=(0, 1)) / np.sqrt(_SCRAMBLES * size)
                )
                seen = mean > 0.0
                value[index[seen]] = top[seen] + np.log(mean[seen])
                error[index[seen]] = scatter[seen] / mean[seen] + ROUNDING
        return value, error

    @property
    def _tilted(self) -> Tilted:
        return self._solved[0]

    @cached_property
    def _solved(self) -> tuple[Tilted, Array]:
        """The tilted problem, and the axes. Rows that hold with certainty in the whole batch are
        left out."""
        open_ = _uncertain(self._mean, self._spread)
        mean = self._mean[:, open_]
        spread = self._spread[:, open_]
        core = _core_rows(mean, spread)
        core_mean = np.take_along_axis(mean, core, axis=1)
        core_spread = np.take_along_axis(spread, core[:, :, None], axis=1)
        lower = np.swapaxes(np.linalg.qr(np.swapaxes(core_spread, 1, 2), mode="r"), 1, 2)
        diagonal = np.diagonal(lower, axis1=1, axis2=2)
        lower = lower * np.where(diagonal < 0, -1.0, 1.0)[:, None, :]
        unit = lower / np.abs(diagonal)[:, :, None]
        bound = -core_mean / np.abs(diagonal)
        x, tilt = saddle_point(unit, bound)
        axes = solve_lower(lower, core_spread)
        beyond = np.ones(mean.shape, dtype=bool)
        np.put_along_axis(beyond, core, values=False, axis=1)
        others = np.nonzero(beyond)[1].reshape(len(core), -1)
        rest = np.take_along_axis(spread, others[:, :, None], axis=1) @ np.swapaxes(axes, 1, 2)
        size = np.linalg.norm(rest, axis=2)
        rest = rest / size[:, :, None]
        rest_mean = np.take_along_axis(mean, others, axis=1) / size
        last = np.where(np.abs(rest) > DEPENDENT, np.arange(core.shape[1]), -1).max(
            axis=2, initial=-1
        )
        parts = (
            unit.transpose(1, 2, 0),
            bound.T,
            x.T,
            tilt.T,
            rest.transpose(1, 2, 0),
            rest_mean.T,
            last.T,
        )
        return Tilted(*map(np.ascontiguousarray, parts)), axes


def _closed_form(distance: Array, spread: Array) -> tuple[Array, Array]:
    """ln P between two bounds, and how far it may be from either, each (w,): infinite where one of
    them says nothing."""
    w, m = distance.shape
    if m < 2:
        return (log_ndtr(distance[:, 0]) if m else np.zeros(w)), np.zeros(w)
    order = np.argsort(distance, axis=1, kind="stable")
    unit = np.take_along_axis(
        spread / np.linalg.norm(spread, axis=2, keepdims=True), order[:, :, None], axis=1
    )
    d = np.take_along_axis(distance, order, axis=1).T
    tail = ndtr(-d)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        # One row rules.
        value = log_ndtr(d[0])
        lost = tail[1:].sum(axis=0)
        error = np.where(lost == 0.0, 0.0, lost * np.exp(-value))
        two = np.flatnonzero(error > 1e-9)
        d = d[:, two]
        tail = tail[:, two]
        unit = unit[two]
        alike = np.einsum("wmq,wnq->mnw", unit, unit[:, :2])
        pair = _pair(d[0], d[1], alike[1, 0])
        usable = np.abs(alike[1, 0]) < 1.0 - _ALIKE
        loss = np.zeros(len(two))
        for j in range(2, m):
            each = [
                np.where(np.abs(alike[j, i]) < 1.0 - _ALIKE, _pair(-d[j], d[i], -alike[j, i]), 1.0)
                for i in (0, 1)
            ]
            loss += np.maximum(np.minimum(tail[j], np.minimum(*each)), 0.0)
        middle = pair - 0.5 * loss
        either = (0.5 * loss + _OWEN * m) / middle
        good = usable & (pair > _LEAST_PAIR) & (middle > 0.0) & (either < error[two])
        value[two[good]], error[two[good]] = np.log(middle[good]), either[good]
    return value, error


def _pair(h: Array, k: Array, rho: Array) -> Array:
    """P(x < h, y < k) of standard normals with correlation ρ (Owen, Ann. Math. Stat. 27, 1075-1090,
    1956)."""
    h, k = (np.where(own == 0.0, 1e-300, own) for own in (h, k))
    root = np.sqrt((1.0 - rho) * (1.0 + rho))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        apart = owens_t(h, (k / h - rho) / root) + owens_t(k, (h / k - rho) / root)
    return np.asarray(0.5 * (ndtr(h) + ndtr(k)) - apart - 0.5 * ((h < 0.0) != (k < 0.0)))


@cache
def _points(dimensions: int, size: int, seed: int) -> Array:
    """A lattice, moved at random and folded: independent scrambles of ``size`` points, shape
    (dimensions, scrambles, size)."""
    shift = (
        np.random.default_rng([seed, size])
        .random((_SCRAMBLES, max(dimensions, 32)))[:, :dimensions]
        .T
    )
    moved = (_lattice(dimensions, size, seed)[:, None] + shift[:, :, None]) % 1.0
    return 1.0 - np.abs(2.0 * moved - 1.0)


def _lattice(dimensions: int, size: int, seed: int) -> Array:
    """As many points, shape (dimensions, size), not yet modulo 1."""
    rng = np.random.default_rng([seed, 1])
    more = [2 * int(rng.integers(1 << 18)) + 1 for _ in range(dimensions - len(_LATTICE))]
    return np.arange(size) * np.array([*_LATTICE, *more][:dimensions], dtype=float)[:, None] / size


@cache
def _rule(dimensions: int) -> tuple[Array, Array]:
    """Points of the unit cube (dimensions, n) and their log weights (n,): Gauss-Legendre in s, u =
    s³ (10 − 15 s + 6 s²), as the integrand changes towards both ends."""
    nodes, weight = np.polynomial.legendre.leggauss(_RULE)
    s = (nodes + 1.0) / 2.0
    weight = weight / 2.0
    s, weight = s**3 * (10.0 - 15.0 * s + 6.0 * s**2), 30.0 * weight * s**2 * (1.0 - s) ** 2
    points = np.array(np.meshgrid(*[s] * dimensions, indexing="ij")).reshape(
        dimensions, _RULE**dimensions
    )
    weights = np.array(np.meshgrid(*[np.log(weight)] * dimensions, indexing="ij")).reshape(
        dimensions, _RULE**dimensions
    )
    return points, weights.sum(axis=0)


def _uncertain(mean: Array, spread: Array) -> Array:
    """Rows that may fail anywhere in the batch; all of them where the others are far from holding
    and could push them."""
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = mean / np.linalg.norm(spread, axis=2)
    certain = np.all(distance > _CERTAIN, axis=0)
    pushed = distance[:, ~certain].min(initial=0.0) < _PUSHED
    return np.flatnonzero(np.ones_like(certain) if pushed else ~certain)


def _core_rows(mean: Array, spread: Array) -> NDArray[np.int_]:
    """Independent rows for every member of the batch, tightest first, shape (w, rank)."""
    if not mean.shape[1]:
        return np.zeros(mean.shape, dtype=int)
    norms = np.linalg.norm(spread, axis=2)
    rank = np.linalg.matrix_rank(spread[0] / norms[0][:, None], tol=DEPENDENT)
    if rank == mean.shape[1]:
        return np.argsort(mean / norms, axis=1, kind="stable")
    return np.array(
        [
            _binding_rows(mean[k] / norms[k], spread[k] / norms[k][:, None], rank)
            for k in range(len(mean))
        ]
    )


def _binding_rows(distance: Array, unit: Array, rank: int) -> list[int]:
    """Rows active at the most probable point inside, then those that follow least from the others,
    tightest first. The most probable point is a least-distance problem, solved by non-negative
    least squares (Lawson and Hanson, ch. 23)."""
    force = least_distance(unit, -distance) if (distance < 0.0).any() else np.zeros(len(unit))
    keep: list[int] = []
    rest = unit.copy()
    while len(keep) < rank:
        size = np.linalg.norm(rest, axis=1)
        i = int(
            np.argmax(np.where(size > DEPENDENT, np.where(force > 0.0, 2.0 + force, size), -1.0))
        )
        keep.append(i)
        force[i] = 0.0
        rest = rest - np.outer(rest @ rest[i], rest[i]) / size[i] ** 2
        rest[i] = 0.0
    return sorted(keep, key=lambda i: float(distance[i]))
