"""P(u ≥ 0) of Gaussian vectors and exact draws of them inside, by minimax tilting; the region of physical compliances.

u = L (x − x₀) row by row, x standard normal: each x_j is drawn beyond its edge from a normal shifted by a tilt μ_j. Its weight

    ψ(x, μ) = Σ_j ln Φ(−e_j) + ½ μ_j² − x_j μ_j,   e_j = bound_j − Σ_{k<j} L_jk x_k / L_jj − μ_j,

is bounded by its value at the saddle point, which makes rejection exact and sums efficient however small P is (Botev, J. R.
Statist. Soc. B 79, 125-148, 2017).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls
from scipy.special import erfcx, log_ndtr, ndtri_exp
from scipy.stats import qmc

from ldbb_bayes.errors import InputError
from ldbb_bayes.model.gaussian import solve_lower

__all__ = ["Orthant", "Truncation"]

Array = NDArray[Any]
_DEPENDENT = 1e-7
_CERTAIN, _PUSHED = 12.0, -3.0
_ITERATIONS, _HALVINGS, _ROUNDING, _NOWHERE = 60, 20, 1e-10, 1e7
_FULL, _MOST_NEAR, _STEEP, _HOLDS = 12, 3, 4.0, 4.0
_MOST_TRIES = 64


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


class Orthant:
    """P(u ≥ 0) for u ~ N(mean, spread spreadᵀ), a batch of w of them.

    Rows that hold with certainty are left out. Rows beyond the rank of the covariance (a parabola kept positive at more than
    three forces, say) are handled by indicator.

    Parameters
    ----------
    mean : ndarray, shape (w, m)
    spread : ndarray, shape (w, m, q)

    Raises
    ------
    InputError
        Where the saddle point is out of reach of double precision.
    """

    def __init__(self, mean: Array, spread: Array) -> None:
        open_ = _uncertain(mean, spread)
        self._mean, self._spread = mean[:, open_], spread[:, open_]
        self._core = _core_rows(self._mean, self._spread)
        core_mean = np.take_along_axis(self._mean, self._core, axis=1)
        core_spread = np.take_along_axis(self._spread, self._core[:, :, None], axis=1)
        lower = np.swapaxes(np.linalg.qr(np.swapaxes(core_spread, 1, 2), mode="r"), 1, 2)
        diagonal = np.diagonal(lower, axis1=1, axis2=2)
        self._lower = lower * np.where(diagonal < 0, -1.0, 1.0)[:, None, :]
        self._distance = np.sort(core_mean / np.linalg.norm(core_spread, axis=2), axis=1)
        self._unit = self._lower / np.abs(diagonal)[:, :, None]
        self._bound = -core_mean / np.abs(diagonal)
        self._x, self._tilt = _saddle_point(self._unit, self._bound)

    @property
    def log_bound(self) -> Array:
        """Upper bound of ln P, tight in the tails, shape (w,). Smooth; exact for one constraint."""
        return self._log_weight(self._x)

    def log_value(self, size: int = 256, *, seed: int = 0) -> Array:
        """ln P, shape (w,): a product of Gauss-Legendre rules where it fits, else ``size`` quasi-random points.

        Finite however small P is. Where no point satisfies the rows beyond the rank, the upper bound.
        """
        counts = self._counts(_FULL)
        return self._by_quasi_random(size, seed)[0] if counts is None else self._by_product(counts)

    def log_probability(self, size: int = 256, *, seed: int = 0) -> tuple[Array, Array]:
        """The same from a finer rule, and its error, each of shape (w,): the change from the rule of `log_value`, or half the
        difference of two halves of the points; infinite where no point satisfies the rows beyond the rank."""
        counts, finer = self._counts(_FULL), self._counts(2 * _FULL)
        if counts is None or finer is None:
            return self._by_quasi_random(size, seed)
        value = self._by_product(finer)
        return value, np.abs(value - self._by_product(counts))

    def moments(self, size: int = 512, *, seed: int = 0) -> tuple[Array, Array, Array]:
        """Mean (w, d) and covariance (w, d, d) of the standard normal e behind u = mean + spread e given u ≥ 0, along the
        orthonormal `axes` (w, d, q) that matter; across them e stays standard normal."""
        d = self._bound.shape[1]
        if d <= 2:
            points, log_rule = _rule((2 * _FULL,) * d, two_ended=True)
        else:
            points, log_rule = qmc.Sobol(d, rng=np.random.default_rng(seed)).random(size), np.zeros(size)
        log_weight, x = self._propose(points[None])
        log_weight = np.where(self._rest_holds(x), log_weight + log_rule, -np.inf)
        weight = np.exp(log_weight - log_weight.max(axis=1, keepdims=True))
        weight /= weight.sum(axis=1, keepdims=True)
        mean = np.einsum("ws,wsd->wd", weight, x)
        centred = x - mean[:, None, :]
        return mean, np.einsum("ws,wsd,wse->wde", weight, centred, centred), self.axes

    @cached_property
    def axes(self) -> Array:
        """Orthonormal directions of e that the rows near their edge depend on, shape (w, d, q): x = axes e."""
        return solve_lower(self._lower, np.take_along_axis(self._spread, self._core[:, :, None], axis=1))

    def draw(self, rng: np.random.Generator, *, most: int = 12_800) -> tuple[Array, NDArray[np.bool_]]:
        """One exact draw of x = axes e given u ≥ 0 for each of the batch (w, d), by tilted rejection, and where one was accepted
        in about ``most`` proposals; elsewhere x is the last one."""
        x = np.zeros_like(self._bound)
        open_ = np.ones(len(x), dtype=bool)
        limit = self.log_bound
        tries, tried = 2, 0
        while tried < most and open_.any():
            index = np.flatnonzero(open_)
            part = self._subset(index)
            log_weight, proposal = part._propose(rng.random((index.size, tries, x.shape[1])))
            accept = np.log(rng.random(log_weight.shape)) <= log_weight - limit[index, None]
            accept &= part._rest_holds(proposal)
            x[index] = proposal[np.arange(index.size), np.argmax(accept, axis=1)]
            open_[index[accept.any(axis=1)]] = False
            tries, tried = min(2 * tries, _MOST_TRIES), tried + tries
        return x, ~open_

    def draw_spread(self, rng: np.random.Generator) -> tuple[Array, NDArray[np.bool_]]:
        """One exact draw of the coordinates e of u = mean + spread e, e ~ N(0, I) given u ≥ 0, shape (w, q)."""
        x, accepted = self.draw(rng)
        return self._complete(x, rng.standard_normal((len(x), self._spread.shape[2]))), accepted

    def propose_spread(self, uniform: Array, normal: Array) -> tuple[Array, Array]:
        """A tilted, nearly exact draw of the same e, and ln (exact density / density it was drawn with), up to ln P, from uniform
        numbers (w, m), of which those beyond the rows near their edge are not used, and normal ones (w, q)."""
        log_weight, x = self._propose(uniform[:, None, : self._bound.shape[1]])
        return self._complete(x[:, 0], normal), log_weight[:, 0]

    def log_weight_of(self, white: Array) -> Array:
        """ln (exact density / density it would be drawn with) of given e (w, q), up to ln P; e inside the truncation."""
        return self._log_weight(np.einsum("wiq,wq->wi", self.axes, white))

    def _log_weight(self, x: Array) -> Array:
        """ψ, shape (w,)."""
        edge = self._bound - np.einsum("wij,wj->wi", np.tril(self._unit, -1), x) - self._tilt
        return np.asarray((log_ndtr(-edge) + 0.5 * self._tilt**2 - x * self._tilt).sum(axis=1))

    def _complete(self, x: Array, normal: Array) -> Array:
        """Standard normal e (w, q) given the standard-normal coordinates x behind the rows near their edge."""
        return normal + np.einsum("wiq,wi->wq", self.axes, x - np.einsum("wiq,wq->wi", self.axes, normal))

    def _subset(self, index: Array) -> Orthant:
        part = object.__new__(Orthant)
        part.__dict__.update({name: value[index] for name, value in vars(self).items()})
        return part

    def _counts(self, full: int) -> tuple[int, ...] | None:
        """Nodes of the product rule for every row but the last; None where it would need too many or rows nearly repeat others.

        The integrand depends on a row only through those after it, and hardly where these hold anyway.
        """
        d = self._bound.shape[1]
        if d != self._mean.shape[1]:
            return None
        if d <= 1:
            return ()
        slack = self._distance.min(axis=0)
        near = d if slack[0] < _PUSHED else int(np.sum(slack <= _HOLDS))
        steep = near > 1 and np.abs(np.tril(self._unit, -1)[:, :near]).max() > _STEEP
        if steep or near > _MOST_NEAR:
            return None
        return tuple(full if j < near else 1 if slack[j] > 1.5 * _HOLDS else 3 for j in range(1, d))

    def _by_product(self, counts: tuple[int, ...]) -> Array:
        if self._bound.shape[1] <= 1:
            return self.log_bound
        points, log_weight = _rule((*counts, 1))
        return _log_sum(self._propose(points[None])[0] + log_weight)

    def _by_quasi_random(self, size: int, seed: int) -> tuple[Array, Array]:
        rng = np.random.default_rng(seed)
        halves = []
        for _ in range(2):
            log_weight, x = self._propose(qmc.Sobol(self._bound.shape[1], rng=rng).random(size // 2)[None])
            halves.append(_log_sum(np.where(self._rest_holds(x), log_weight, -np.inf)) - np.log(size // 2))
        both = np.stack(halves, axis=1)
        known = np.isfinite(both).all(axis=1)
        error = np.full(len(both), np.inf)
        error[known] = np.abs(both[known, 0] - both[known, 1]) / 2.0
        return np.where(known, _log_sum(both) - np.log(2.0), self.log_bound), error

    def _propose(self, uniform: Array) -> tuple[Array, Array]:
        """Tilted draws x (w, size, d) from uniform numbers (w or 1, size, d), and their log weights (w, size)."""
        w, d = self._bound.shape
        log_uniform = np.log(np.clip(uniform, 1e-300, 1.0))
        x, log_weight = np.zeros((w, uniform.shape[1], d)), np.zeros((w, uniform.shape[1]))
        for j in range(d):
            # The first row depends on no other: one value for all draws.
            shift = np.einsum("wk,wsk->ws", self._unit[:, j, :j], x[..., :j]) if j else 0.0
            tilt = self._tilt[:, j, None]
            log_tail = log_ndtr(shift + tilt - self._bound[:, j, None])
            x[..., j] = tilt - ndtri_exp(log_uniform[..., j] + log_tail)
            log_weight += log_tail + 0.5 * tilt**2 - x[..., j] * tilt
        return log_weight, x

    def _rest_holds(self, x: Array) -> NDArray[np.bool_]:
        """Whether the rows outside the core hold as well; they are linear combinations of the core rows."""
        if self._core.shape[1] == self._mean.shape[1]:
            return np.ones(x.shape[:2], dtype=bool)
        core_spread = np.take_along_axis(self._spread, self._core[:, :, None], axis=1)
        core_mean = np.take_along_axis(self._mean, self._core, axis=1)
        mixing = np.swapaxes(np.linalg.pinv(np.swapaxes(core_spread, 1, 2)) @ np.swapaxes(self._spread, 1, 2), 1, 2)
        value = np.einsum("wij,wsj->wsi", self._lower, x)
        every = self._mean[:, None, :] + np.einsum("wmi,wsi->wsm", mixing, value)
        scale = np.abs(core_mean).max(axis=1)[:, None, None] + np.abs(value).max(axis=2, keepdims=True)
        return np.all(every >= -1e-9 * scale, axis=-1)


@cache
def _rule(counts: tuple[int, ...], *, two_ended: bool = False) -> tuple[Array, Array]:
    """Points of the unit cube and their log weights: Gauss-Legendre in s, u = s⁴, as u → 0 is the far tail, where the integrand
    is no polynomial of u; or u = s³ (10 − 15 s + 6 s²) where it changes towards both ends. One node is in the middle."""
    points, log_weight = np.zeros((1, 0)), np.zeros(1)
    for count in counts:
        nodes, weight = np.polynomial.legendre.leggauss(count)
        s, weight = (nodes + 1.0) / 2.0, weight / 2.0
        if two_ended:
            s, weight = s**3 * (10.0 - 15.0 * s + 6.0 * s**2), 30.0 * weight * s**2 * (1.0 - s) ** 2
        elif count > 1:
            s, weight = s**4, 4.0 * weight * s**3
        points = np.column_stack([np.repeat(points, count, axis=0), np.tile(s, len(points))])
        log_weight = np.add.outer(log_weight, np.log(weight)).ravel()
    return points, log_weight


def _uncertain(mean: Array, spread: Array) -> Array:
    """Rows that may fail anywhere in the batch; all of them where the others are far from holding and could push them."""
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
    rank = np.linalg.matrix_rank(spread[0] / norms[0][:, None], tol=_DEPENDENT)
    if rank == mean.shape[1]:
        return np.argsort(mean / norms, axis=1, kind="stable")
    return np.array([_binding_rows(mean[k] / norms[k], spread[k] / norms[k][:, None], rank) for k in range(len(mean))])


def _binding_rows(distance: Array, unit: Array, rank: int) -> list[int]:
    """Rows active at the most probable point inside, then the tightest that add a direction.

    The most probable point is a least-distance problem, solved by non-negative least squares (Lawson and Hanson, ch. 23).
    """
    force = _least_distance(unit, -distance)
    keep: list[int] = []
    basis = np.zeros((0, unit.shape[1]))
    for i in np.lexsort((distance, -force)):
        rest = unit[i] - basis.T @ (basis @ unit[i])
        size = np.linalg.norm(rest)
        if size > _DEPENDENT and len(keep) < rank:
            keep.append(int(i))
            basis = np.vstack([basis, rest / size])
    return sorted(keep, key=lambda i: float(distance[i]))


def _least_distance(unit: Array, bound: Array) -> Array:
    """Forces, up to a factor, with which the rows ``unit`` · x ≥ bound hold the point nearest to zero."""
    force, _ = nnls(np.vstack([unit.T, bound / max(1.0, float(np.abs(bound).max()))]), np.append(np.zeros(unit.shape[1]), 1.0))
    return np.asarray(force)


def _saddle_point(unit: Array, bound: Array) -> tuple[Array, Array]:
    """x and tilt of the saddle, each (w, d), the last of each zero. Beyond ln P = −1e7, where nothing is decided any more, the
    best that Newton's method found."""
    w, d = bound.shape
    if d <= 1:
        return np.zeros((w, d)), np.zeros((w, d))
    coupling = unit @ np.swapaxes(unit, 1, 2) - np.eye(d)
    edge, solved, _ = _newton(coupling, bound, bound)
    hard = np.flatnonzero(~solved)
    if hard.size:
        starts = np.array([_held_edges(coupling[k], unit[k], bound[k]) for k in hard])
        edge[hard], solved[hard], value = _newton(coupling[hard], bound[hard], starts)
        solved[hard] |= np.abs(value) > _NOWHERE
    if not solved.all():
        raise InputError(
            "the probability of physical compliances must be within reach of double precision, got readings too far from them. "
            "Check the sign of the readings, the mount compensation and the forces, or fit --without truncation."
        )
    free = _mills(edge)
    x, tilt = np.einsum("wij,wi->wj", unit, free), np.einsum("wij,wi->wj", np.tril(unit, -1), free)
    x[:, -1] = tilt[:, -1] = 0.0
    return x, tilt


def _newton(coupling: Array, bound: Array, start: Array) -> tuple[Array, NDArray[np.bool_], Array]:
    """Edges from a start, where they were found, and the convex function there. Steps are halved until the function or the
    residual falls."""
    edge = np.array(start)
    value, residual, slope, error = _merit(coupling, bound, edge)
    for _ in range(_ITERATIONS):
        active = error > _ROUNDING
        if not active.any():
            break
        system = np.eye(bound.shape[1]) + coupling * slope[:, None, :]
        step = -np.linalg.solve(system, residual[..., None])[..., 0]
        open_ = active.copy()
        for k in range(_HALVINGS):
            trial = np.where(open_[:, None], edge + 0.5**k * step, edge)
            new = _merit(coupling, bound, trial)
            good = open_ & ((new[0] < value) | (new[3] < error))
            edge = np.where(good[:, None], trial, edge)
            value, error = np.where(good, new[0], value), np.where(good, new[3], error)
            residual, slope = (
                np.where(good[:, None], one, other) for one, other in zip(new[1:3], (residual, slope), strict=True)
            )
            open_ &= ~good
            if not open_.any():
                break
        if open_[active].all():
            break
    return edge, error <= _ROUNDING, value


def _held_edges(coupling: Array, unit: Array, bound: Array) -> Array:
    """Edges at the most probable point inside."""
    held = np.flatnonzero(_least_distance(unit, bound))
    mills = np.zeros(len(bound))
    mills[held] = np.linalg.solve(coupling[np.ix_(held, held)] + np.eye(len(held)), bound[held])
    # Far out the inverse Mills ratio is its argument and 1 / argument more.
    return np.where(mills > 1.0, mills - 1.0 / np.maximum(mills, 1.0), bound - coupling @ mills)


def _merit(coupling: Array, bound: Array, edge: Array) -> tuple[Array, Array, Array, Array]:
    """½ mᵀ (K − I) m − boundᵀ m + Σ (edge m + ln Φ(−edge)); its gradient in m; dm / d edge; the gradient's relative size."""
    mills = _mills(edge)
    pulled = np.einsum("wij,wj->wi", coupling, mills)
    value = (mills * (0.5 * pulled - bound + edge) + log_ndtr(-edge)).sum(axis=1)
    size = 1.0 + np.abs(bound) + np.abs(edge) + np.einsum("wij,wj->wi", np.abs(coupling), mills)
    residual = edge + pulled - bound
    return value, residual, np.clip(mills * (mills - edge), 0.0, 1.0), np.abs(residual / size).max(axis=1)


def _mills(edge: Array) -> Array:
    """φ(edge) / Φ(−edge)."""
    with np.errstate(over="ignore"):
        return np.asarray(np.sqrt(2.0 / np.pi) / erfcx(edge / np.sqrt(2.0)))


def _log_sum(log_values: Array) -> Array:
    """ln Σ exp along the last axis."""
    top = log_values.max(axis=-1, keepdims=True)
    top = np.where(np.isfinite(top), top, 0.0)
    with np.errstate(divide="ignore"):
        return np.asarray(top[..., 0] + np.log(np.exp(log_values - top).sum(axis=-1)))
