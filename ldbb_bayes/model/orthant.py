"""P(A β ≥ 0) of a Gaussian, and exact draws inside it, however improbable: minimax exponential tilting.

x ~ N(0, I), L x + A μ ≥ 0, drawn one coordinate after the other from truncated normals shifted by a tilt that makes the
importance weights as even as they can be (Botev 2017, J. R. Stat. Soc. B 79, 125-148). The maximum of the tilted
exponent bounds ln P from above and is smooth in the Gaussian's parameters.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, ndtri_exp
from scipy.stats import qmc

from ldbb_bayes.model.constraints import PUSHED, core_rows, uncertain
from ldbb_bayes.model.rules import product_rule, two_ended_rule
from ldbb_bayes.model.tilting import exponent, saddle_point, split_tilt, strict
from ldbb_bayes.model.triangular import solve_lower

__all__ = ["Orthant", "Truncation"]

Array = NDArray[Any]
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
