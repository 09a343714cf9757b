"""Points and log weights of product rules on the unit cube, for integrands over tilted normal draws."""

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

__all__ = [
    "PUSHED",
    "Orthant",
    "Truncation",
    "core_rows",
    "exponent",
    "product_rule",
    "saddle_point",
    "split_tilt",
    "strict",
    "two_ended_rule",
    "uncertain",
]

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


_DEPENDENT = 1e-7
_CERTAIN = 12.0
PUSHED = -3.0


def uncertain(mean: Array, spread: Array) -> Array:
    """Rows that may fail anywhere in the batch; all of them where the others are far from holding and could push them."""
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = mean / np.linalg.norm(spread, axis=2)
    certain = np.all(distance > _CERTAIN, axis=0)
    pushed = distance[:, ~certain].min(initial=0.0) < PUSHED
    return np.flatnonzero(np.ones_like(certain) if pushed else ~certain)


def core_rows(mean: Array, spread: Array) -> NDArray[np.int_]:
    """Independent rows for every member of the batch, tightest first, shape (w, rank)."""
    if not mean.shape[1]:
        return np.zeros(mean.shape, dtype=int)
    norms = np.linalg.norm(spread, axis=2)
    tightest = np.argsort(mean / norms, axis=1, kind="stable")
    rank = np.linalg.matrix_rank(spread[0] / norms[0][:, None], tol=_DEPENDENT)
    if rank == mean.shape[1]:
        return tightest
    return np.array([_binding_rows(mean[k] / norms[k], spread[k] / norms[k][:, None], rank) for k in range(len(mean))])


def _binding_rows(distance: Array, unit: Array, rank: int) -> list[int]:
    """Rows active at the most probable point inside, then the tightest that add a direction.

    The most probable point is a least-distance problem, solved by non-negative least squares (Lawson and Hanson, ch. 23).
    """
    stacked = np.vstack([unit.T, -distance / max(1.0, float(np.abs(distance).max()))])
    force, _ = nnls(stacked, np.append(np.zeros(unit.shape[1]), 1.0))
    keep: list[int] = []
    basis = np.zeros((0, unit.shape[1]))
    for i in np.lexsort((distance, -force)):
        rest = unit[i] - basis.T @ (basis @ unit[i])
        size = np.linalg.norm(rest)
        if size > _DEPENDENT and len(keep) < rank:
            keep.append(int(i))
            basis = np.vstack([basis, rest / size])
    return sorted(keep, key=lambda i: float(distance[i]))


_ITERATIONS = 60
_HALVINGS = 20
_ROUNDING = 1e-10
_NOWHERE = 1e7


def split_tilt(joined: Array, d: int) -> tuple[Array, Array]:
    """x and tilt, each (w, d), from the 2 (d − 1) numbers that are free: the last of each is zero."""
    zero = np.zeros((len(joined), min(d, 1)))
    if d == 0:
        return zero, zero
    return np.hstack([joined[:, : d - 1], zero]), np.hstack([joined[:, d - 1 :], zero])


def exponent(unit: Array, bound: Array, x: Array, tilt: Array) -> Array:
    """ψ, shape (w,)."""
    edge = bound - np.einsum("wij,wj->wi", strict(unit), x) - tilt
    return (log_ndtr(-edge) + 0.5 * tilt**2 - x * tilt).sum(axis=1)


def strict(unit: Array) -> Array:
    """What lies below the diagonal."""
    return np.tril(unit, -1)


def saddle_point(unit: Array, bound: Array) -> Array:
    """x and tilt of the saddle, joined, shape (w, 2(d − 1)).

    Raises
    ------
    InputError
        Where none is found. Beyond ln P = −1e7, where nothing is decided any more, the best that was found is returned.
    """
    w, d = bound.shape
    if d <= 1:
        return np.zeros((w, 0))
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
    mills = _mills(edge)
    x = np.einsum("wij,wi->wj", unit, mills)
    tilt = np.einsum("wij,wi->wj", strict(unit), mills)
    return np.hstack([x[:, : d - 1], tilt[:, : d - 1]])


def _newton(coupling: Array, bound: Array, start: Array) -> tuple[Array, NDArray[np.bool_], Array]:
    """Edges from a start, where they were found, and the convex function there.

    Steps are halved until the function or the residual falls.
    """
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
            found = _merit(coupling, bound, trial)
            good = open_ & ((found[0] < value) | (found[3] < error))
            edge = np.where(good[:, None], trial, edge)
            value, error = np.where(good, found[0], value), np.where(good, found[3], error)
            residual = np.where(good[:, None], found[1], residual)
            slope = np.where(good[:, None], found[2], slope)
            open_ &= ~good
            if not open_.any():
                break
        if open_[active].all():
            break
    return edge, error <= _ROUNDING, value


def _held_edges(coupling: Array, unit: Array, bound: Array) -> Array:
    """Edges at the most probable point inside: a least-distance problem (Lawson and Hanson, chapter 23)."""
    scale = max(1.0, float(np.abs(bound).max()))
    force, _ = nnls(np.vstack([unit.T, bound / scale]), np.append(np.zeros(len(bound)), 1.0))
    held = np.flatnonzero(force)
    mills = np.zeros(len(bound))
    mills[held] = np.linalg.solve(coupling[np.ix_(held, held)] + np.eye(len(held)), bound[held])
    free = bound - coupling @ mills
    # Far out the inverse Mills ratio is its argument and 1 / argument more.
    return np.where(mills > 1.0, mills - 1.0 / np.maximum(mills, 1.0), free)


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


_FULL = 12
_MOST_NEAR = 3
_MOST_TRIES = 64
_STEEP = 4.0
_HOLDS = 4.0


@dataclass(frozen=True, eq=False)
class Truncation:
    """The region A β ≥ 0.

    Attributes
    ----------
    rows : ndarray, shape (m, p)
        A; none means no truncation.
    """

    rows: Array

    @property
    def active(self) -> bool:
        """Whether there is any constraint."""
        return len(self.rows) > 0

    def holds(self, beta: Array) -> Array:
        """Whether A β ≥ 0, shape (...)."""
        return np.all(beta @ self.rows.T >= 0.0, axis=-1)

    def orthants(self, mean: Array, spread: Array) -> Orthant:
        """The orthant problem of N(mean, spread spreadᵀ), one per leading index.

        Parameters
        ----------
        mean : ndarray, shape (w, p)
        spread : ndarray, shape (w, p, q)
        """
        return Orthant(mean @ self.rows.T, self.rows @ spread)


class Orthant:
    """P(u ≥ 0) for u ~ N(mean, spread spreadᵀ), a batch of w of them.

    Rows that hold with certainty are set aside. Rows beyond the rank of the covariance (a parabola kept positive at more than
    three forces, say) are handled by indicator.

    Parameters
    ----------
    mean : ndarray, shape (w, m)
    spread : ndarray, shape (w, m, q)
    """

    def __init__(self, mean: Array, spread: Array) -> None:
        open_ = uncertain(mean, spread)
        mean, spread = mean[:, open_], spread[:, open_]
        self._w, self._m = mean.shape
        self._mean, self._spread = mean, spread
        self._core = core_rows(mean, spread)
        core_mean = np.take_along_axis(mean, self._core, axis=1)
        core_spread = np.take_along_axis(spread, self._core[:, :, None], axis=1)
        lower = np.swapaxes(np.linalg.qr(np.swapaxes(core_spread, 1, 2), mode="r"), 1, 2)
        diagonal = np.diagonal(lower, axis1=1, axis2=2)
        lower = lower * np.where(diagonal < 0, -1.0, 1.0)[:, None, :]
        self._diagonal = np.abs(diagonal)
        self._distance = np.sort(core_mean / np.linalg.norm(core_spread, axis=2), axis=1)
        self._lower = lower
        self._unit = lower / self._diagonal[:, :, None]
        self._bound = -core_mean / self._diagonal
        self._tilt = saddle_point(self._unit, self._bound)

    @property
    def log_bound(self) -> Array:
        """Upper bound of ln P, tight in the tails, shape (w,). Smooth; exact for one constraint."""
        d = self._bound.shape[1]
        x, tilt = split_tilt(self._tilt, d)
        return exponent(self._unit, self._bound, x, tilt)

    def log_value(self, size: int = 256, *, seed: int = 0) -> Array:
        """ln P, shape (w,): a product of Gauss-Legendre rules where it fits, else ``size`` quasi-random points.

        Finite however small P is. Where no point satisfies the rows beyond the rank, the upper bound.
        """
        counts = self._counts(_FULL)
        if counts is not None:
            return self._by_product(counts)
        return self._by_quasi_random(size, seed)[0]

    def log_probability(self, size: int = 256, *, seed: int = 0) -> tuple[Array, Array]:
        """The same from a finer rule, and its error, each of shape (w,): the change from the rule of `log_value`, or half the
        difference of two halves of the points; infinite where no point satisfies the rows beyond the rank."""
        counts, finer = self._counts(_FULL), self._counts(2 * _FULL)
        if counts is None or finer is None:
            return self._by_quasi_random(size, seed)
        value = self._by_product(finer)
        return value, np.abs(value - self._by_product(counts))

    def moments(self, size: int = 512, *, seed: int = 0) -> tuple[Array, Array, Array]:
        """Mean and covariance of the standard normal e behind u = mean + spread e given u ≥ 0, along the axes that matter.

        Returns
        -------
        mean : ndarray, shape (w, d)
        covariance : ndarray, shape (w, d, d)
        axes : ndarray, shape (w, d, q)
            Orthonormal; across them e stays standard normal.
        """
        d = self._bound.shape[1]
        if d <= 2:
            points, log_rule = two_ended_rule(d, 2 * _FULL)
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
        core = np.take_along_axis(self._spread, self._core[:, :, None], axis=1)
        return solve_lower(self._lower, core)

    def _counts(self, full: int) -> tuple[int, ...] | None:
        """Nodes of the product rule for every row but the last; None where it would need too many or rows nearly repeat others.

        The integrand depends on a row only through those after it, and hardly where these hold anyway.
        """
        d = self._bound.shape[1]
        if d != self._m:
            return None
        if d <= 1:
            return ()
        slack = self._distance.min(axis=0)
        near = d if slack[0] < PUSHED else int(np.sum(slack <= _HOLDS))
        counts = tuple(full if j < near else 1 if slack[j] > 1.5 * _HOLDS else 3 for j in range(1, d))
        steep = near > 1 and np.abs(strict(self._unit)[:, :near]).max() > _STEEP
        return None if steep or near > _MOST_NEAR else counts

    def _by_product(self, counts: tuple[int, ...]) -> Array:
        if self._bound.shape[1] <= 1:
            return self.log_bound
        points, log_weight = product_rule(counts)
        return _log_sum(self._propose(points[None])[0] + log_weight)

    def _by_quasi_random(self, size: int, seed: int) -> tuple[Array, Array]:
        d, half = self._bound.shape[1], size // 2
        rng = np.random.default_rng(seed)
        halves = []
        for _ in range(2):
            points = qmc.Sobol(d, rng=rng).random(half)
            log_weight, x = self._propose(points[None])
            log_weight = np.where(self._rest_holds(x), log_weight, -np.inf)
            halves.append(_log_mean(log_weight))
        both = np.stack(halves)
        found = np.isfinite(both).all(axis=0)
        error = np.full(self._w, np.inf)
        error[found] = np.abs(both[0] - both[1])[found] / 2.0
        return np.where(found, _log_mean(both.T), self.log_bound), error

    def draw(self, rng: np.random.Generator, *, most: int = 12_800) -> tuple[Array, NDArray[np.bool_]]:
        """One exact draw of the standard-normal x behind u = mean + L x for each of the batch, by tilted rejection.

        Returns
        -------
        x : ndarray, shape (w, core)
            In the coordinates of `constrained`.
        accepted : ndarray of bool, shape (w,)
            False where no draw was accepted in about ``most`` proposals; x is then the last one.
        """
        d = self._bound.shape[1]
        x = np.zeros((self._w, d))
        open_ = np.ones(self._w, dtype=bool)
        limit = self.log_bound
        tries, tried = 2, 0
        while tried < most:
            index = np.flatnonzero(open_)
            if not index.size:
                break
            part = self._subset(index)
            log_weight, proposal = part._propose(rng.random((index.size, tries, d)))
            accept = np.log(rng.random(log_weight.shape)) <= log_weight - limit[index, None]
            accept &= part._rest_holds(proposal)
            first = np.argmax(accept, axis=1)
            x[index] = proposal[np.arange(index.size), first]
            open_[index[accept.any(axis=1)]] = False
            tries, tried = min(2 * tries, _MOST_TRIES), tried + tries
        return x, ~open_

    def draw_spread(self, rng: np.random.Generator) -> tuple[Array, NDArray[np.bool_]]:
        """One exact draw of the coordinates e of u = mean + spread e, e ~ N(0, I) given u ≥ 0, shape (w, q)."""
        x, accepted = self.draw(rng)
        return self._complete(x, rng.standard_normal((self._w, self._spread.shape[2]))), accepted

    def propose_spread(self, uniform: Array, normal: Array) -> tuple[Array, Array]:
        """A tilted, nearly exact draw of the same e, and ln (exact density / density it was drawn with), up to ln P.

        Parameters
        ----------
        uniform : ndarray, shape (w, m)
            Uniform numbers; those beyond the rows near their edge are not used.
        normal : ndarray, shape (w, q)
            Standard normal numbers.
        """
        log_weight, x = self._propose(uniform[:, None, : self._bound.shape[1]])
        return self._complete(x[:, 0], normal), log_weight[:, 0]

    def log_weight_of(self, white: Array) -> Array:
        """ln (exact density / density it would be drawn with) of given e (w, q), up to ln P; e inside the truncation."""
        x = np.einsum("wiq,wq->wi", self.axes, white)
        _, tilt = split_tilt(self._tilt, x.shape[1])
        edge = self._bound - np.einsum("wij,wj->wi", strict(self._unit), x) - tilt
        return (log_ndtr(-edge) + 0.5 * tilt**2 - x * tilt).sum(axis=1)

    def _complete(self, x: Array, normal: Array) -> Array:
        """Standard normal e (w, q) given the standard-normal coordinates x behind the rows near their edge."""
        return normal + np.einsum("wiq,wi->wq", self.axes, x - np.einsum("wiq,wq->wi", self.axes, normal))

    def _subset(self, index: Array) -> Orthant:
        part = object.__new__(Orthant)
        part._w, part._m = len(index), self._m
        for name in ("_mean", "_spread", "_core", "_distance", "_diagonal", "_lower", "_unit", "_bound", "_tilt"):
            setattr(part, name, getattr(self, name)[index])
        return part

    def _propose(self, uniform: Array) -> tuple[Array, Array]:
        """Tilted draws x (w, size, d) from uniform numbers (w or 1, size, d), and their log weights (w, size)."""
        d, size = self._bound.shape[1], uniform.shape[1]
        _, tilt = split_tilt(self._tilt, d)
        log_uniform = np.log(np.clip(uniform, 1e-300, 1.0))
        x = np.zeros((self._w, size, d))
        log_weight = np.zeros((self._w, size))
        for j in range(d):
            # The first row depends on no other: one value for all draws.
            shift = np.einsum("wk,wsk->ws", self._unit[:, j, :j], x[..., :j]) if j else 0.0
            edge = self._bound[:, j, None] - shift - tilt[:, j, None]
            log_tail = log_ndtr(-edge)
            log_weight += log_tail + 0.5 * tilt[:, j, None] ** 2
            x[..., j] = tilt[:, j, None] - ndtri_exp(log_uniform[..., j] + log_tail)
            log_weight -= x[..., j] * tilt[:, j, None]
        return log_weight, x

    def _rest_holds(self, x: Array) -> NDArray[np.bool_]:
        """Whether the rows outside the core hold as well; they are linear combinations of the core rows."""
        if self._core.shape[1] == self._m:
            return np.ones(x.shape[:2], dtype=bool)
        core_spread = np.take_along_axis(self._spread, self._core[:, :, None], axis=1)
        core_mean = np.take_along_axis(self._mean, self._core, axis=1)
        mixing = np.swapaxes(np.linalg.pinv(np.swapaxes(core_spread, 1, 2)) @ np.swapaxes(self._spread, 1, 2), 1, 2)
        value = np.einsum("wij,wsj->wsi", self._lower, x)
        every = self._mean[:, None, :] + np.einsum("wmi,wsi->wsm", mixing, value)
        scale = np.abs(core_mean).max(axis=1)[:, None, None] + np.abs(value).max(axis=2, keepdims=True)
        return np.all(every >= -1e-9 * scale, axis=-1)


def _log_sum(log_values: Array) -> Array:
    top = log_values.max(axis=-1)
    total: Array = top + np.log(np.exp(log_values - top[..., None]).sum(axis=-1))
    return total


def _log_mean(log_values: Array) -> Array:
    top = log_values.max(axis=-1, keepdims=True)
    safe = np.where(np.isfinite(top), top, 0.0)
    with np.errstate(divide="ignore"):
        mean: Array = safe[..., 0] + np.log(np.exp(log_values - safe).mean(axis=-1))
    return mean
