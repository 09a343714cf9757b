"""The parameters of interest given readings and hyper-parameters: β | y, φ ~ N(mean, covariance), and its truncation A β ≥ 0.

One Gaussian per φ. Its precision is kept as Cholesky factor, of which the last rows and columns are the marginal of the last
coefficients: with β last, nothing else needs to be solved for.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.model.orthant import Orthant, Truncation
from ldbb_bayes.model.triangular import solve_lower, solve_upper

__all__ = ["ParameterConditional"]

Array = NDArray[Any]
_LOG_2PI = float(np.log(2 * np.pi))


@dataclass(frozen=True, eq=False)
class ParameterConditional:
    """p(β | y, φ) for w values of φ, truncation aside.

    Attributes
    ----------
    mean : ndarray, shape (w, p)
    root : ndarray, shape (w, p, p)
        Cholesky factor L of the scaled precision; covariance = diag(scale) (L Lᵀ)⁻¹ diag(scale).
    scale : ndarray, shape (w, p)
    physical : Truncation
        A β ≥ 0, whether or not the model imposes it.
    """

    mean: Array
    root: Array
    scale: Array
    physical: Truncation

    def spread(self) -> Array:
        """X with X Xᵀ = covariance, shape (w, p, p)."""
        return self._spread_of(np.eye(self.mean.shape[1]))

    @cached_property
    def orthant(self) -> Orthant:
        """The problem of P(A β ≥ 0 | y, φ)."""
        return Orthant(self.mean @ self.physical.rows.T, self._spread_of(self.physical.rows))

    def at(self, white: Array) -> Array:
        """β from standard normal coordinates, shape (w, p)."""
        return self.mean + solve_upper(self.root, white) * self.scale

    def white(self, beta: Array) -> Array:
        """The reverse of `at`."""
        return np.einsum("wij,wi->wj", self.root, (beta - self.mean) / self.scale)

    def log_density(self, beta: Array) -> Array:
        """ln N(β; mean, covariance), shape (w,)."""
        white = self.white(beta)
        log_root = np.log(np.diagonal(self.root, axis1=1, axis2=2)).sum(axis=1) - np.log(self.scale).sum(axis=1)
        return np.asarray(log_root - 0.5 * ((white**2).sum(axis=1) + white.shape[1] * _LOG_2PI))

    def draw(self, rng: np.random.Generator) -> Array:
        """One draw of β per φ, truncation aside, shape (w, p)."""
        return self.at(rng.standard_normal(self.mean.shape))

    def draw_inside(self, rng: np.random.Generator) -> tuple[Array, NDArray[np.bool_]]:
        """One exact draw per φ inside A β ≥ 0.

        Returns
        -------
        beta : ndarray, shape (w, p)
        exact : ndarray of bool, shape (w,)
            False where the rejection sampler gave up, or rounding left β outside.
        """
        white, exact = self.orthant.draw_spread(rng)
        beta = self.at(white)
        return beta, exact & self.physical.holds(beta)

    def _spread_of(self, combinations: Array) -> Array:
        """X with X Xᵀ = covariance of linear combinations of β: (m, p) → (w, m, p)."""
        scaled = np.swapaxes(combinations * self.scale[:, None, :], 1, 2)
        return np.swapaxes(solve_lower(self.root, scaled), 1, 2)
