"""ln g(x) = constant + ηᵀ x − ½ xᵀ P x: the one kernel of Gaussian algebra, with leading batch
axes, and what goes with it.

| what | how |
|---|---|
| prior, known moments | `Gaussian.of(mean, covariance or variances)` |
| likelihood of white rows y = J x + N(0, I) | `Gaussian.from_rows(J, y)`; prior × likelihood: `prior.observe(J, y)` |
| sums of information, possibly singular | `Gaussian(P, η, constant)`; `+` multiplies densities |
| ∫ g, moments, p(x_i) | `log_integral`, `mean`, `sd`, `covariance`, `marginal(keep)` |
| draws, standard coordinates, densities | `draw`, `from_standard`, `standardize`, `log_density` |

The square root is what is kept: P = S⁻¹ L Lᵀ S⁻¹, S diagonal scales. Rows are factored by QR,
columns scaled; no normal equations, nothing is inverted. Moments need P positive definite; sums do
not.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Self

import numpy as np

from ldbb_bayes.errors import InputError
from ldbb_bayes.model.triangular import log_diagonal, solve_lower, solve_upper
from ldbb_bayes.results import Array, Shown

__all__ = ["Gaussian"]

_LOG_2PI = float(np.log(2 * np.pi))
# A pivot this much smaller than the largest has at most three digits above rounding.
_DEPENDENT = 1e-13


class Gaussian(Shown):
    """g(x) = exp(constant + ηᵀ x − ½ xᵀ P x), one for every index of the leading axes: precision P
    (..., q, q), symmetric, which may be singular as long as no moments are asked for; shift η = P ·
    mean (..., q); log_constant (...)."""

    shown = ("precision", "shift")

    def __init__(self, precision: Array, shift: Array, log_constant: Array | float = 0.0) -> None:
        self.__dict__.update(
            precision=precision, shift=shift, log_constant=np.asarray(log_constant, dtype=float)
        )

    @classmethod
    def factored(
        cls, mean: Array, root: Array, scale: Array, log_integral: Array | float = 0.0
    ) -> Self:
        """From its mean (..., q), the lower L (..., q, q) and the scales (..., q) of P = S⁻¹ L Lᵀ
        S⁻¹, and ln ∫ g."""
        found = object.__new__(cls)
        found.__dict__.update(
            _factored=(mean, root, scale), log_integral=np.asarray(log_integral, dtype=float)
        )
        return found

    @classmethod
    def of(cls, mean: Array, covariance: Array) -> Gaussian:
        """N(mean, covariance), from covariances (..., q, q) that must be positive definite, or
        independent variances (..., q)."""
        q = mean.shape[-1]
        if covariance.shape == mean.shape:
            if not np.all(covariance > 0):
                raise InputError(
                    f"variances must be positive, got {covariance.min()}. Remove that column or"
                    " correct it."
                )
            return cls.factored(
                mean, np.broadcast_to(np.eye(q), (*mean.shape, q)), np.sqrt(covariance)
            )
        sd = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
        try:
            root = np.linalg.cholesky(covariance / (sd[..., :, None] * sd[..., None, :]))
        except np.linalg.LinAlgError:
            raise InputError(
                "a covariance must be positive definite, got a singular or indefinite one."
                " Correct it."
            ) from None
        inverse = solve_lower(root, np.broadcast_to(np.eye(q), covariance.shape))
        return cls.factored(mean, _positive(np.asarray(np.linalg.qr(inverse, mode="r"))), sd)

    @classmethod
    def from_rows(cls, rows: Array, values: Array) -> Gaussian:
        """Π N(values; rows · x, 1) as a function of x, rows (..., n, q) in units of the noise and
        values (..., n): least squares, whose residual sum of squares is in ``log_integral``.
        InputError where rows do not determine x."""
        n, q = rows.shape[-2:]
        scale = _powers_of_two(rows)
        stack = np.concatenate([rows * scale[..., None, :], values[..., None]], axis=-1)
        triangle = np.asarray(np.linalg.qr(stack, mode="r")) if n else stack
        pivots = np.abs(np.diagonal(triangle, axis1=-2, axis2=-1))[..., :q]
        if n < q or np.any(pivots <= _DEPENDENT * pivots.max(axis=-1, keepdims=True)):
            raise InputError(
                "rows must determine every coefficient, got columns that follow from others. Give a"
                " proper prior."
            )
        return cls._of_triangle(
            triangle, np.zeros(q), scale, -0.5 * n * _LOG_2PI + 0.5 * q * _LOG_2PI
        )

    def observe(self, rows: Array, values: Array) -> Gaussian:
        """The product with Π N(values; rows · x, 1), rows (..., n, q) in units of the noise and
        values (..., n): prior to posterior, ``log_integral`` gaining the log evidence."""
        mean, root, scale = self._factored
        residual = values - (rows @ mean[..., None])[..., 0]
        stack = np.concatenate([rows * scale[..., None, :], residual[..., None]], axis=-1)
        before = np.concatenate(
            [np.swapaxes(root, -1, -2), np.zeros((*root.shape[:-1], 1))], axis=-1
        )
        batch = np.broadcast_shapes(stack.shape[:-2], before.shape[:-2])
        both = [np.broadcast_to(part, (*batch, *part.shape[-2:])) for part in (stack, before)]
        triangle = np.asarray(np.linalg.qr(np.concatenate(both, axis=-2), mode="r"))
        constant = self.log_integral + log_diagonal(root) - 0.5 * rows.shape[-2] * _LOG_2PI
        return Gaussian._of_triangle(triangle, mean, scale, constant, scaled=True)

    @classmethod
    def _of_triangle(
        cls,
        triangle: Array,
        about: Array,
        scale: Array,
        constant: Array | float,
        *,
        scaled: bool = False,
    ) -> Gaussian:
        """From the R factor of [rows · scale, values], or of the same with a prior's root below."""
        q = scale.shape[-1]
        root = _positive(triangle[..., :q, :q])
        sign = np.where(np.diagonal(triangle[..., :q, :q], axis1=-2, axis2=-1) < 0, -1.0, 1.0)
        mean = about + scale * solve_upper(root, triangle[..., :q, q] * sign)
        log_integral = (
            constant - log_diagonal(root) + (0.0 if scaled else np.log(scale).sum(axis=-1))
        )
        if triangle.shape[-2] > q:
            log_integral = log_integral - 0.5 * triangle[..., q, q] ** 2
        return cls.factored(mean, root, np.broadcast_to(scale, mean.shape), log_integral)

    @cached_property
    def _factored(self) -> tuple[Array, Array, Array]:
        diagonal = np.diagonal(self.precision, axis1=-2, axis2=-1)
        scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
        root = np.linalg.cholesky(self.precision * (scale[..., :, None] * scale[..., None, :]))
        white = solve_lower(root, (self.shift * scale)[..., None])[..., 0]
        return solve_upper(root, white) * scale, root, scale

    @cached_property
    def precision(self) -> Array:
        """P, shape (..., q, q)."""
        _, root, scale = self._factored
        return (root @ np.swapaxes(root, -1, -2)) / (scale[..., :, None] * scale[..., None, :])

    @cached_property
    def shift(self) -> Array:
        """η = P · mean, shape (..., q)."""
        return np.einsum("...ij,...j->...i", self.precision, self.mean)

    @cached_property
    def log_constant(self) -> Array:
        """ln g(0), shape (...)."""
        return np.asarray(self.log_integral + self.log_density(np.zeros(self.mean.shape[-1])))

    @cached_property
    def log_integral(self) -> Array:
        """ln ∫ g, shape (...): of a prior times a likelihood the log evidence."""
        mean, root, scale = self._factored
        volume = np.log(scale).sum(axis=-1) - log_diagonal(root) + 0.5 * mean.shape[-1] * _LOG_2PI
        return np.asarray(self.log_constant + 0.5 * (self.shift * mean).sum(axis=-1) + volume)

    @property
    def mean(self) -> Array:
        """Shape (..., q)."""
        return self._factored[0]

    @property
    def root(self) -> Array:
        """Lower triangular L of P = S⁻¹ L Lᵀ S⁻¹, shape (..., q, q)."""
        return self._factored[1]

    @property
    def scale(self) -> Array:
        """Diagonal of S, shape (..., q)."""
        return self._factored[2]

    def spread(self, combinations: Array | None = None) -> Array:
        """X with X Xᵀ = covariance, shape (..., q, q); of linear combinations (m, q) of x: shape
        (..., m, q)."""
        rows = np.eye(self.scale.shape[-1]) if combinations is None else combinations
        scaled = np.swapaxes(rows * self.scale[..., None, :], -1, -2)
        return np.swapaxes(solve_lower(self.root, scaled, triangular=combinations is None), -1, -2)

    @property
    def covariance(self) -> Array:
        """Shape (..., q, q)."""
        spread = self.spread()
        return spread @ np.swapaxes(spread, -1, -2)

    @property
    def sd(self) -> Array:
        """Marginal standard deviations, shape (..., q)."""
        return np.sqrt((self.spread() ** 2).sum(axis=-1))

    def __add__(self, other: Gaussian) -> Gaussian:
        return Gaussian(
            self.precision + other.precision,
            self.shift + other.shift,
            self.log_constant + other.log_constant,
        )

    def marginal(self, keep: Sequence[int]) -> Gaussian:
        """∫ g over the other coefficients, in the order of ``keep``."""
        mean, root, scale = self._factored
        q = mean.shape[-1]
        k = len(keep)
        order = [*np.setdiff1d(np.arange(q), keep), *keep]
        if order != list(range(q)):
            root = _positive(
                np.asarray(np.linalg.qr(np.swapaxes(root, -1, -2)[..., order], mode="r"))
            )
        return Gaussian.factored(
            mean[..., keep], root[..., q - k :, q - k :], scale[..., keep], self.log_integral
        )

    def from_standard(self, white: Array) -> Array:
        """x from standard normal coordinates, shape (..., q)."""
        return self.mean + solve_upper(self.root, white) * self.scale

    def standardize(self, x: Array) -> Array:
        """The reverse of `from_standard`."""
        return np.einsum("...ij,...i->...j", self.root, (x - self.mean) / self.scale)

    def log_density(self, x: Array) -> Array:
        """ln of the normalised density N(x; mean, covariance), shape (...)."""
        white = self.standardize(x)
        log_root = log_diagonal(self.root) - np.log(self.scale).sum(axis=-1)
        return np.asarray(log_root - 0.5 * ((white**2).sum(axis=-1) + white.shape[-1] * _LOG_2PI))

    def draw(self, rng: np.random.Generator, size: tuple[int, ...] = ()) -> Array:
        """Independent draws, shape ``(*size, ..., q)``."""
        return self.from_standard(rng.standard_normal((*size, *self.mean.shape)))


def _positive(upper: Array) -> Array:
    """Lower triangular, positive diagonal: the transpose of an R factor with its signs turned."""
    sign = np.where(np.diagonal(upper, axis1=-2, axis2=-1) < 0, -1.0, 1.0)
    return np.swapaxes(upper * sign[..., :, None], -1, -2)


def _powers_of_two(rows: Array) -> Array:
    """Scales that bring columns to a length near one without rounding, shape (..., q)."""
    norms = np.linalg.norm(rows, axis=-2)
    return np.ldexp(1.0, -np.round(np.log2(np.where(norms > 0.0, norms, 1.0))).astype(int))
