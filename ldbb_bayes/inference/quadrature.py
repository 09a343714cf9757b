"""p(φ | y), all linear parameters integrated out exactly: its mode, its curvature, and weighted nodes over it.

p(φ | y) ∝ p(y | φ) p(φ), with truncation times P(T | y, φ). Each density is centred on its own mode, because P(T | y) may
move the mode far.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
import scipy.stats
from numpy.typing import NDArray

from ldbb_bayes.inference.lattice import Lattice, grow_lattice
from ldbb_bayes.model.bound import BoundModel
from ldbb_bayes.model.conditional import ParameterConditional

__all__ = ["HyperPosterior", "conditional_draws"]

Array = NDArray[Any]

_STEP = 0.05
_STARTS = 256
_CHUNK = 256
_BASINS = 3
_COARSE = 0.2
_COARSE_STEP = 1.25
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
    bound : BoundModel
    truncated : bool
    mode : ndarray, shape (h,)
        Of the density in free coordinates.
    spread : ndarray, shape (h, h)
        Root of the inverse curvature there.
    """

    def __init__(self, bound: BoundModel, *, truncated: bool, seed: int = 0, near: Array | None = None) -> None:
        self.bound, self.truncated, self._seed = bound, truncated, seed
        self.mode, self.spread = self._locate() if near is None else self._around(self._climb(near))

    def log_density(self, free: Array) -> Array:
        """ln p(y, free coordinates), shape (w,), with ln P(T | y, φ) where truncated."""
        return self._log_density(free, lambda given: given.orthant.log_value(seed=self._seed))

    def log_smooth_density(self, free: Array) -> Array:
        """The same with the upper bound of P(T | y, φ), which is cheaper and smooth."""
        return self._log_density(free, lambda given: given.orthant.log_bound)

    def _log_density(self, free: Array, log_truncation: Callable[[ParameterConditional], Array]) -> Array:
        prior = self.bound.hyper_prior.log_density_of_free(free)
        total = np.full(len(free), -np.inf)
        inside = np.isfinite(prior)
        if not inside.any():
            return total
        phi = self.bound.hyper_prior.phi(free[inside])
        if not self.truncated:
            total[inside] = prior[inside] + self.bound.log_evidence(phi)
            return total
        log_evidence, given = self.bound.given(phi)
        total[inside] = prior[inside] + log_evidence + log_truncation(given)
        return total

    def lattice(self, tolerance: float = 1e-3) -> Lattice:
        """Weighted nodes of p(y, free coordinates) whose integral has this tolerance [nat]."""
        step = _STEP_BY_DEFAULT if tolerance < _LOOSE else _LONG_STEP
        lattice = grow_lattice(self.log_smooth_density, self.mode, self.spread, tolerance=tolerance, step=step)
        return self._exact(lattice, spare=tolerance / 100.0)

    @cached_property
    def coarse(self) -> Lattice:
        """A lattice good enough to propose from; P(T | y, φ) by its bound."""
        return grow_lattice(self.log_smooth_density, self.mode, self.spread, tolerance=_COARSE, step=_COARSE_STEP)

    @cached_property
    def brief(self) -> Lattice:
        """The coarse lattice with P(T | y, φ) itself."""
        return self._exact(self.coarse, spare=_COARSE / 100.0)

    def _exact(self, lattice: Lattice, *, spare: float) -> Lattice:
        return lattice.corrected(self.log_density, spare=spare) if self.truncated else lattice

    def draw(self, size: int, rng: np.random.Generator, *, temperature: float = 1.0) -> Array:
        """Starting points in free coordinates, shape (size, h): nearly the posterior, or its power 1/temperature."""
        return self.coarse.draw(size, rng, temperature=temperature)

    def _locate(self) -> tuple[Array, Array]:
        """Mode and curvature: Newton from the best of many starting points, several basins tried."""
        prior = self.bound.hyper_prior
        points = scipy.stats.qmc.Sobol(len(prior.names), rng=np.random.default_rng(self._seed)).random(_STARTS)
        starts = np.log(2.0 * prior.scale_mm) - points * np.where(prior.lower_mm > 0, 12.0, 6.0)
        starts = starts[np.argsort(-self.log_smooth_density(starts))]
        basins: list[Array] = []
        for start in starts[: _STARTS // 4]:
            if all(np.linalg.norm(start - other) > 1.5 for other in basins):
                basins.append(start)
            if len(basins) == _BASINS:
                break
        modes = np.array([self._climb(start) for start in basins])
        return self._around(modes[int(np.argmax(self.log_smooth_density(modes)))])

    def _around(self, mode: Array) -> tuple[Array, Array]:
        """The mode and the root of the inverse curvature there."""
        _, _, hessian = self._stencil(mode)
        curvature, vectors = np.linalg.eigh(-hessian)
        return mode, vectors / np.sqrt(np.maximum(curvature, 0.3))

    def _climb(self, point: Array) -> Array:
        """Damped Newton steps on central differences, all points of a stencil in one call."""
        sizes = np.array([1.0, 0.5, 0.25, 0.1, 0.03])
        for _ in range(60):
            value, gradient, hessian = self._stencil(point)
            curvature, vectors = np.linalg.eigh(-hessian)
            step = vectors @ ((vectors.T @ gradient) / np.maximum(np.abs(curvature), 0.3))
            step *= min(1.0, 1.5 / max(float(np.linalg.norm(step)), 1e-12))
            trials = self.log_smooth_density(point + sizes[:, None] * step)
            best = int(np.argmax(trials))
            if not trials[best] > value + 1e-6:
                break
            point = point + sizes[best] * step
        return point

    def _stencil(self, point: Array) -> tuple[float, Array, Array]:
        """Value, gradient and Hessian by central differences."""
        h = len(point)
        unit = np.eye(h) * _STEP
        pairs = [(i, j) for i in range(h) for j in range(i)]
        offsets = [np.zeros(h), *unit, *-unit]
        offsets += [a * unit[i] + b * unit[j] for i, j in pairs for a, b in ((1, 1), (1, -1), (-1, 1), (-1, -1))]
        values = self.log_smooth_density(point + np.array(offsets))
        plus, minus = values[1 : h + 1], values[h + 1 : 2 * h + 1]
        gradient = (plus - minus) / (2 * _STEP)
        hessian = np.diag((plus + minus - 2 * values[0]) / _STEP**2)
        for k, (i, j) in enumerate(pairs):
            a, b, c, d = values[2 * h + 1 + 4 * k : 2 * h + 5 + 4 * k]
            hessian[i, j] = hessian[j, i] = (a - b - c + d) / (4 * _STEP**2)
        return float(values[0]), gradient, hessian


def conditional_draws(bound: BoundModel, free: Array, rng: np.random.Generator) -> tuple[Array, NDArray[np.bool_]]:
    """One draw of β for each free coordinates from its exact conditional Gaussian inside the truncation.

    Returns
    -------
    beta : ndarray, shape (w, p)
    exact : ndarray of bool, shape (w,)
        False where the rejection sampler gave up, or rounding left β outside.
    """
    beta, exact = np.zeros((len(free), len(bound.names))), np.ones(len(free), dtype=bool)
    for start in range(0, len(free), _CHUNK):
        part = slice(start, start + _CHUNK)
        _, given = bound.given(bound.hyper_prior.phi(free[part]))
        if bound.truncation.active:
            beta[part], exact[part] = given.draw_inside(rng)
        else:
            beta[part] = given.draw(rng)
    return beta, exact
