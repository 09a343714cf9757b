"""Minimax tilting of Gaussian vectors truncated to an orthant (Botev 2017)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import erfcx, log_ndtr, ndtri_exp

from ldbb_bayes.errors import InputError
from ldbb_bayes.results import Array

DEPENDENT = 1e-7


_ITERATIONS = 60


_HALVINGS = 20


ROUNDING = 1e-10


_NOWHERE = 1e7


class Tilted(NamedTuple):
    """Independent rows, tightest first, in units of their own x: L_jk / L_jj (d, d, w), bounds (d,
    w); the saddle point x and its tilt (d, w), the last of each zero; rows beyond the rank as unit
    combinations of x (k, d, w), their means, and the last x that each of them depends on, (k,
    w)."""

    unit: Array
    bound: Array
    x: Array
    tilt: Array
    rest: Array
    rest_mean: Array
    last: Array

    def take(self, index: Array) -> Tilted:
        """Some of the batch."""
        return Tilted(*(part[..., index] for part in self))

    @property
    def log_bound(self) -> Array:
        """ψ at the saddle point, shape (w,)."""
        return self._replace(last=np.full_like(self.last, -1)).log_weight(self.x[:, None])[0]

    def propose(self, uniform: Array, *, last: bool = True) -> tuple[Array, Array]:
        """Log weights (s, w) and tilted draws x (d, s, w) from uniform numbers (d, s, w or 1), the
        last of which may be left out: weights do not depend on it."""
        d, w = self.bound.shape
        x = np.zeros((d, uniform.shape[1], w))
        log_weight = np.zeros((uniform.shape[1], w))
        for j in range(d):
            edge, far = self._interval(j, x)
            log_mass, log_tail, ratio, turn = _mass(edge, far)
            log_weight += log_mass
            if last or j < d - 1:
                u = np.clip(uniform[j], 1e-300, 1.0)
                x[j] = self.tilt[j] - turn * ndtri_exp(
                    np.log(u if ratio is None else u + (1.0 - u) * ratio) + log_tail
                )
                log_weight += self.tilt[j] * (0.5 * self.tilt[j] - x[j])
        return log_weight, x

    def log_weight(self, x: Array) -> Array:
        """ψ of given x (d, s, w), shape (s, w)."""
        log_mass = [_mass(*self._interval(j, x))[0] for j in range(len(x))]
        tilt = self.tilt[:, None]
        return np.asarray(
            sum(log_mass, np.zeros(x.shape[1:])) + (tilt * (0.5 * tilt - x)).sum(axis=0)
        )

    def _interval(self, j: int, x: Array) -> tuple[Array, Array | None]:
        """Edges (s, w) between which x_j, less its tilt, must lie given those before; None where
        there is no upper one."""
        # The first row depends on no other: one value for all points.
        before = np.einsum("kw,ksw->sw", self.unit[j, :j], x[:j]) if j else 0.0
        edge = np.atleast_2d(self.bound[j] - before - self.tilt[j])
        rows = np.flatnonzero((self.last == j).any(axis=1))
        if not rows.size:
            return edge, None
        far = np.full(x.shape[1:], np.inf)
        for mean, along, last in zip(
            self.rest_mean[rows], self.rest[rows], self.last[rows], strict=True
        ):
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                place = (
                    -(mean + np.einsum("kw,ksw->sw", along[:j], x[:j])) / along[j] - self.tilt[j]
                )
            edge = np.where((last == j) & (along[j] > 0.0), np.maximum(edge, place), edge)
            far = np.where((last == j) & (along[j] < 0.0), np.minimum(far, place), far)
        return edge, far


def _mass(low: Array, high: Array | None) -> tuple[Array, Array, Array | None, Array | float]:
    """ln (Φ(high) − Φ(low)); ln of the larger tail beyond, the other over it, and −1 where tails
    are to the left, 1 else."""
    if high is None:
        log_tail = log_ndtr(-low)
        return log_tail, log_tail, None, 1.0
    left = low + high < 0.0
    log_tail = log_ndtr(np.where(left, high, -low))
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        ratio = np.where(high > low, np.exp(log_ndtr(np.where(left, low, -high)) - log_tail), 1.0)
        return (
            log_tail + np.log1p(-np.minimum(ratio, 1.0)),
            log_tail,
            np.minimum(ratio, 1.0),
            np.where(left, -1.0, 1.0),
        )


def least_distance(unit: Array, bound: Array) -> Array:
    """Forces, up to a factor, with which the rows ``unit`` · x ≥ bound hold the point nearest to
    zero."""
    from scipy.optimize import nnls

    force, _ = nnls(
        np.vstack([unit.T, bound / max(1.0, float(np.abs(bound).max()))]),
        np.append(np.zeros(unit.shape[1]), 1.0),
    )
    return np.asarray(force)


def saddle_point(unit: Array, bound: Array) -> tuple[Array, Array]:
    """x and tilt of the saddle, each (w, d), the last of each zero. Beyond ln P = −1e7, where
    nothing is decided any more, the best that Newton's method found."""
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
            "the probability of physical compliances must be within reach of double precision, got"
            " readings too far from them. Check the sign of the readings, the mount compensation"
            " and the forces, or fit --without truncation."
        )
    free = _mills(edge)
    x = np.einsum("wij,wi->wj", unit, free)
    tilt = np.einsum("wij,wi->wj", np.tril(unit, -1), free)
    x[:, -1] = tilt[:, -1] = 0.0
    return x, tilt


def _newton(coupling: Array, bound: Array, start: Array) -> tuple[Array, NDArray[np.bool_], Array]:
    """Edges from a start, where found, and the convex function there; steps are halved until it or
    the residual falls."""
    edge = np.array(start)
    value, residual, slope, error = _merit(coupling, bound, edge)
    for _ in range(_ITERATIONS):
        active = error > ROUNDING
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
            value = np.where(good, new[0], value)
            error = np.where(good, new[3], error)
            residual, slope = (
                np.where(good[:, None], one, old)
                for one, old in zip(new[1:3], (residual, slope), strict=True)
            )
            open_ &= ~good
            if not open_.any():
                break
        if open_[active].all():
            break
    return edge, error <= ROUNDING, value


def _held_edges(coupling: Array, unit: Array, bound: Array) -> Array:
    """Edges at the most probable point inside."""
    held = np.flatnonzero(least_distance(unit, bound))
    mills = np.zeros(len(bound))
    mills[held] = np.linalg.solve(coupling[np.ix_(held, held)] + np.eye(len(held)), bound[held])
    # Far out the inverse Mills ratio is its argument and 1 / argument more.
    return np.where(mills > 1.0, mills - 1.0 / np.maximum(mills, 1.0), bound - coupling @ mills)


def _merit(coupling: Array, bound: Array, edge: Array) -> tuple[Array, Array, Array, Array]:
    """½ mᵀ (K − I) m − boundᵀ m + Σ (edge m + ln Φ(−edge)); its gradient in m; dm / d edge; the
    gradient's relative size."""
    mills = _mills(edge)
    pulled = np.einsum("wij,wj->wi", coupling, mills)
    value = (mills * (0.5 * pulled - bound + edge) + log_ndtr(-edge)).sum(axis=1)
    size = 1.0 + np.abs(bound) + np.abs(edge) + np.einsum("wij,wj->wi", np.abs(coupling), mills)
    residual = edge + pulled - bound
    return (
        value,
        residual,
        np.clip(mills * (mills - edge), 0.0, 1.0),
        np.abs(residual / size).max(axis=1),
    )


def _mills(edge: Array) -> Array:
    """φ(edge) / Φ(−edge)."""
    with np.errstate(over="ignore"):
        return np.asarray(np.sqrt(2.0 / np.pi) / erfcx(edge / np.sqrt(2.0)))
