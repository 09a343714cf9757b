"""ln g(x) = constant + ηᵀ x − ½ xᵀ P x: the one kernel of Gaussian algebra, with leading batch axes, and what goes with it.

| what | how |
|---|---|
| prior, known moments | `Gaussian.of(mean, covariance or variances)` |
| likelihood of white rows y = J x + N(0, I) | `Gaussian.from_rows(J, y)`; prior × likelihood: `prior.observe(J, y)` |
| sums of information, possibly singular | `Gaussian(P, η, constant)`; `+` multiplies densities, `-` divides them |
| ∫ g, moments, p(x_i), p(x_r given x_i) | `log_integral`, `mean`, `sd`, `covariance`, `marginal(keep)`, `given(index, values)` |
| draws, standard coordinates, densities | `draw`, `at`, `white`, `log_density` |

The square root is what is kept: P = S⁻¹ L Lᵀ S⁻¹, S diagonal scales. Rows are factored by QR, columns scaled; no normal
equations, nothing is inverted. Moments need P positive definite; sums and conditionals do not.

Beside it: triangular algebra on stacks (`factor_and_solve`, `solve_lower`, `solve_upper`), least squares of minimum norm, moments
and quantiles of mixtures of Gaussians, quantiles of weighted draws, Newton's method for a mode, and Holm's adjustment.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from ldbb_bayes.errors import InputError

__all__ = [
    "Gaussian",
    "central_differences",
    "factor_and_solve",
    "holm",
    "least_squares",
    "log_diagonal",
    "mixture_moments",
    "mixture_quantiles",
    "newton",
    "singular_root",
    "solve_lower",
    "solve_upper",
    "weighted_quantiles",
]

Array = NDArray[Any]
_LOG_2PI = float(np.log(2 * np.pi))
_NEVER_REACHED = 1e30
# A pivot this much smaller than the largest has at most three digits above rounding.
_DEPENDENT = 1e-13


class Gaussian:
    """g(x) = exp(constant + ηᵀ x − ½ xᵀ P x), one for every index of the leading axes: precision P (..., q, q), symmetric, which
    may be singular as long as no moments are asked for; shift η = P · mean (..., q); log_constant (...)."""

    def __init__(self, precision: Array, shift: Array, log_constant: Array | float = 0.0) -> None:
        self.__dict__.update(precision=precision, shift=shift, log_constant=np.asarray(log_constant, dtype=float))

    @classmethod
    def factored(cls, mean: Array, root: Array, scale: Array, log_integral: Array | float = 0.0) -> Self:
        """From its mean (..., q), the lower L (..., q, q) and the scales (..., q) of P = S⁻¹ L Lᵀ S⁻¹, and ln ∫ g."""
        found = object.__new__(cls)
        found.__dict__.update(_factored=(mean, root, scale), log_integral=np.asarray(log_integral, dtype=float))
        return found

    @classmethod
    def of(cls, mean: Array, covariance: Array) -> Gaussian:
        """N(mean, covariance), from covariances (..., q, q) that must be positive definite, or independent variances (..., q)."""
        q = mean.shape[-1]
        if covariance.shape == mean.shape:
            if not np.all(covariance > 0):
                raise InputError(f"variances must be positive, got {covariance.min()}. Remove that column or correct it.")
            return cls.factored(mean, np.broadcast_to(np.eye(q), (*mean.shape, q)), np.sqrt(covariance))
        sd = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
        try:
            root = np.linalg.cholesky(covariance / (sd[..., :, None] * sd[..., None, :]))
        except np.linalg.LinAlgError:
            raise InputError("a covariance must be positive definite, got a singular or indefinite one. Correct it.") from None
        inverse = solve_lower(root, np.broadcast_to(np.eye(q), covariance.shape))
        return cls.factored(mean, _positive(np.asarray(np.linalg.qr(inverse, mode="r"))), sd)

    @classmethod
    def from_rows(cls, rows: Array, values: Array) -> Gaussian:
        """Π N(values; rows · x, 1) as a function of x, rows (..., n, q) in units of the noise and values (..., n): least squares,
        whose residual sum of squares is in ``log_integral``. InputError where rows do not determine x."""
        n, q = rows.shape[-2:]
        scale = _powers_of_two(rows)
        stack = np.concatenate([rows * scale[..., None, :], values[..., None]], axis=-1)
        triangle = np.asarray(np.linalg.qr(stack, mode="r")) if n else stack
        pivots = np.abs(np.diagonal(triangle, axis1=-2, axis2=-1))[..., :q]
        if n < q or np.any(pivots <= _DEPENDENT * pivots.max(axis=-1, keepdims=True)):
            raise InputError("rows must determine every coefficient, got columns that follow from others. Give a proper prior.")
        return cls._of_triangle(triangle, np.zeros(q), scale, -0.5 * n * _LOG_2PI + 0.5 * q * _LOG_2PI)

    def observe(self, rows: Array, values: Array) -> Gaussian:
        """The product with Π N(values; rows · x, 1), rows (..., n, q) in units of the noise and values (..., n): prior to
        posterior, ``log_integral`` gaining the log evidence."""
        mean, root, scale = self._factored
        residual = values - (rows @ mean[..., None])[..., 0]
        stack = np.concatenate([rows * scale[..., None, :], residual[..., None]], axis=-1)
        before = np.concatenate([np.swapaxes(root, -1, -2), np.zeros((*root.shape[:-1], 1))], axis=-1)
        batch = np.broadcast_shapes(stack.shape[:-2], before.shape[:-2])
        both = [np.broadcast_to(part, (*batch, *part.shape[-2:])) for part in (stack, before)]
        triangle = np.asarray(np.linalg.qr(np.concatenate(both, axis=-2), mode="r"))
        constant = self.log_integral + log_diagonal(root) - 0.5 * rows.shape[-2] * _LOG_2PI
        return Gaussian._of_triangle(triangle, mean, scale, constant, scaled=True)

    @classmethod
    def _of_triangle(
        cls, triangle: Array, about: Array, scale: Array, constant: Array | float, *, scaled: bool = False
    ) -> Gaussian:
        """From the R factor of [rows · scale, values], or of the same with a prior's root below."""
        q = scale.shape[-1]
        upper = triangle[..., :q, :q]
        sign = np.where(np.diagonal(upper, axis1=-2, axis2=-1) < 0, -1.0, 1.0)
        root = np.swapaxes(upper * sign[..., :, None], -1, -2)
        mean = about + scale * solve_upper(root, triangle[..., :q, q] * sign)
        log_integral = constant - log_diagonal(root) + (0.0 if scaled else np.log(scale).sum(axis=-1))
        if triangle.shape[-2] > q:
            log_integral = log_integral - 0.5 * triangle[..., q, q] ** 2
        return cls.factored(mean, root, np.broadcast_to(scale, mean.shape), log_integral)

    @cached_property
    def _factored(self) -> tuple[Array, Array, Array]:
        diagonal = np.diagonal(self.precision, axis1=-2, axis2=-1)
        scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
        root, white = factor_and_solve(self.precision * (scale[..., :, None] * scale[..., None, :]), self.shift * scale)
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
        """X with X Xᵀ = covariance, shape (..., q, q); of linear combinations (m, q) of x: shape (..., m, q)."""
        rows = np.eye(self.scale.shape[-1]) if combinations is None else combinations
        scaled = np.swapaxes(rows * self.scale[..., None, :], -1, -2)
        return np.swapaxes(solve_lower(self.root, scaled), -1, -2)

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
        return Gaussian(self.precision + other.precision, self.shift + other.shift, self.log_constant + other.log_constant)

    def __sub__(self, other: Gaussian) -> Gaussian:
        return Gaussian(self.precision - other.precision, self.shift - other.shift, self.log_constant - other.log_constant)

    def given(self, index: Sequence[int], values: Array) -> Gaussian:
        """g as a function of the other coefficients, those of ``index`` having values (..., k)."""
        left = np.setdiff1d(np.arange(self.shift.shape[-1]), index)
        across, inside = self.precision[..., left[:, None], index], self.precision[..., np.array(index)[:, None], index]
        constant = (values * (self.shift[..., index] - 0.5 * np.einsum("...ij,...j->...i", inside, values))).sum(axis=-1)
        shift = self.shift[..., left] - np.einsum("...ij,...j->...i", across, values)
        return Gaussian(self.precision[..., left[:, None], left], shift, self.log_constant + constant)

    def marginal(self, keep: Sequence[int]) -> Gaussian:
        """∫ g over the other coefficients, in the order of ``keep``."""
        mean, root, scale = self._factored
        q, k = mean.shape[-1], len(keep)
        order = [*np.setdiff1d(np.arange(q), keep), *keep]
        if order != list(range(q)):
            root = _positive(np.asarray(np.linalg.qr(np.swapaxes(root, -1, -2)[..., order], mode="r")))
        return Gaussian.factored(mean[..., keep], root[..., q - k :, q - k :], scale[..., keep], self.log_integral)

    def at(self, white: Array) -> Array:
        """x from standard normal coordinates, shape (..., q)."""
        return self.mean + solve_upper(self.root, white) * self.scale

    def white(self, x: Array) -> Array:
        """The reverse of `at`."""
        return np.einsum("...ij,...i->...j", self.root, (x - self.mean) / self.scale)

    def log_density(self, x: Array) -> Array:
        """ln of the normalised density N(x; mean, covariance), shape (...)."""
        white = self.white(x)
        log_root = log_diagonal(self.root) - np.log(self.scale).sum(axis=-1)
        return np.asarray(log_root - 0.5 * ((white**2).sum(axis=-1) + white.shape[-1] * _LOG_2PI))

    def draw(self, rng: np.random.Generator, size: tuple[int, ...] = ()) -> Array:
        """Independent draws, shape (*size, ..., q)."""
        return self.at(rng.standard_normal((*size, *self.mean.shape)))


def factor_and_solve(matrix: Array, right: Array) -> tuple[Array, Array]:
    """Cholesky factor L of A, shape (..., q, q), and L⁻¹ b, shape (..., q); LinAlgError where A is not positive definite.

    b is the last row of a matrix one larger, whose factor holds both; its last diagonal entry only has to be large enough.
    """
    q = matrix.shape[-1]
    if q == 1:
        lower = np.sqrt(matrix)
        return lower, right / lower[..., 0]
    bordered = np.zeros((*matrix.shape[:-2], q + 1, q + 1))
    bordered[..., :q, :q] = matrix
    bordered[..., q, :q] = right
    bordered[..., q, q] = 1.0 + _NEVER_REACHED * (right**2).sum(axis=-1)
    factor = np.linalg.cholesky(bordered)
    return factor[..., :q, :q], factor[..., q, :q]


def solve_lower(lower: Array, right: Array) -> Array:
    """L⁻¹ X of stacks, shapes (..., q, q) and (..., q, k)."""
    solved = np.zeros(np.broadcast_shapes(lower.shape[:-2], right.shape[:-2]) + right.shape[-2:])
    for i in range(lower.shape[-1]):
        known = (lower[..., i, :i, None] * solved[..., :i, :]).sum(axis=-2)
        solved[..., i, :] = (right[..., i, :] - known) / lower[..., i, i, None]
    return solved


def solve_upper(lower: Array, right: Array) -> Array:
    """L⁻ᵀ x of stacks, shapes (..., q, q) and (..., q)."""
    rest = np.array(np.broadcast_to(right, np.broadcast_shapes(lower.shape[:-1], right.shape)))
    for i in reversed(range(lower.shape[-1])):
        rest[..., i] /= lower[..., i, i]
        rest[..., :i] -= lower[..., i, :i] * rest[..., i, None]
    return rest


def least_squares(jacobian: Array, y: Array, scale: Array | None = None, *, rank_tolerance: float = 1e-10) -> Array:
    """Minimum-norm least squares (p,) of y (n,) by the columns of a Jacobian (n, p), in units of ``scale`` (p,), typical sizes of
    the parameters, by default reciprocal column norms; directions of smaller relative singular values are undetermined."""
    if scale is None:
        norms = np.linalg.norm(jacobian, axis=0)
        scale = 1.0 / np.where(norms > 0, norms, 1.0)
    solution, *_ = np.linalg.lstsq(jacobian * scale, y, rcond=rank_tolerance)
    return solution * scale


def singular_root(covariance: Array) -> Array:
    """X with X Xᵀ = covariance, shape (..., p, p), of covariances that may be singular."""
    values, vectors = np.linalg.eigh(0.5 * (covariance + np.swapaxes(covariance, -1, -2)))
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :])


def _positive(upper: Array) -> Array:
    """Lower triangular, positive diagonal: the transpose of an R factor with its signs turned."""
    sign = np.where(np.diagonal(upper, axis1=-2, axis2=-1) < 0, -1.0, 1.0)
    return np.swapaxes(upper * sign[..., :, None], -1, -2)


def log_diagonal(root: Array) -> Array:
    """ln det of triangular factors (..., q, q), shape (...)."""
    return np.log(np.diagonal(root, axis1=-2, axis2=-1)).sum(axis=-1)


def _powers_of_two(rows: Array) -> Array:
    """Scales that bring columns to a length near one without rounding, shape (..., q)."""
    norms = np.linalg.norm(rows, axis=-2)
    return np.ldexp(1.0, -np.round(np.log2(np.where(norms > 0.0, norms, 1.0))).astype(int))


_ITERATIONS, _CLOSE = 100, 1e-12
_TOGETHER = 200_000


def mixture_moments(weight: Array, mean: Array, sd: Array) -> tuple[Array, Array]:
    """Mean and sd, shape (...), of mixtures of Gaussians: weights (k,), components (k, ...)."""
    middle = np.tensordot(weight, mean, 1)
    return middle, np.sqrt(np.tensordot(weight, sd**2 + (mean - middle) ** 2, 1))


def mixture_quantiles(weight: Array, mean: Array, sd: Array, levels: Sequence[float] | Array) -> Array:
    """Quantiles, shape (levels, ...), of mixtures of Gaussians: Newton's method kept inside a bracket.

    Components (k, ...); weights (k,), or an array that broadcasts with them, sum to one along the first axis.
    """
    flat_mean, flat_sd = (part.reshape(len(mean), -1) for part in (mean, sd))
    weight = weight.reshape(-1, *(1,) * (mean.ndim - 1)) if weight.ndim == 1 else weight
    flat_weight = np.broadcast_to(weight, mean.shape).reshape(flat_mean.shape)
    found = np.empty((len(levels), flat_mean.shape[1]))
    size = max(1, _TOGETHER // len(mean))
    for start in range(0, flat_mean.shape[1], size):
        own = slice(start, start + size)
        for row, level in enumerate(levels):
            found[row, own] = _mixture_quantile(flat_weight[:, own], flat_mean[:, own], flat_sd[:, own], level)
    return found.reshape(len(levels), *mean.shape[1:])


def _mixture_quantile(weight: Array, mean: Array, sd: Array, level: float) -> Array:
    each = mean + ndtri(level) * sd
    low, high = each.min(axis=0), each.max(axis=0)
    middle = (weight * mean).sum(axis=0)
    spread = np.sqrt((weight * (sd**2 + (mean - middle) ** 2)).sum(axis=0))
    x = np.clip(middle + ndtri(level) * spread, low, high)
    for _ in range(_ITERATIONS):
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            z = (x - mean) / sd
            excess = (weight * ndtr(z)).sum(axis=0) - level
            low, high = np.where(excess <= 0.0, x, low), np.where(excess >= 0.0, x, high)
            new = x - excess / ((weight * (np.exp(-0.5 * z**2) / sd)).sum(axis=0) / np.sqrt(2.0 * np.pi))
        new = np.where((new >= low) & (new <= high), new, 0.5 * (low + high))
        moved, x = np.abs(new - x), new
        if np.all(moved <= _CLOSE * spread):
            break
    return x


def weighted_quantiles(weight: Array, draws: Array, levels: Sequence[float] | Array) -> Array:
    """Quantiles, shape (levels, ...), of weighted draws (k, ...), linear between the middles of their weights."""
    flat = draws.reshape(len(draws), -1)
    found = np.empty((len(levels), flat.shape[1]))
    for column in range(flat.shape[1]):
        order = np.argsort(flat[:, column], kind="stable")
        reached = np.cumsum(weight[order]) - 0.5 * weight[order]
        found[:, column] = np.interp(levels, reached, flat[order, column])
    return found.reshape(len(levels), *draws.shape[1:])


_FRACTIONS = (1.0, 0.5, 0.25, 0.1, 0.03)


def newton(
    log_density: Callable[[Array], Array],
    derivatives: Callable[[Array], tuple[Array, Array]],
    start: Array,
    *,
    least_curvature: float = 0.3,
    longest: float = 1.5,
    gain: float = 1e-6,
    iterations: int = 60,
) -> Array:
    """A mode of a log density (n, h) → (n,), shape (h,), by damped Newton steps from a start; ``derivatives`` of a point:
    its gradient (h,) and Hessian (h, h).

    Directions of wrong curvature are turned round, none counts as flatter than ``least_curvature``, no step is longer than
    ``longest``; of several fractions of a step, tried in one call, the best is taken. Steps end when the density rises by no more
    than ``gain`` [nat].
    """
    point, fractions = np.array(start, dtype=float), np.array(_FRACTIONS)
    value = float(log_density(point[None])[0])
    for _ in range(iterations):
        gradient, hessian = derivatives(point)
        curvature, vectors = np.linalg.eigh(-hessian)
        step = vectors @ ((vectors.T @ gradient) / np.maximum(np.abs(curvature), least_curvature))
        step *= min(1.0, longest / max(float(np.linalg.norm(step)), 1e-12))
        trials = log_density(point + fractions[:, None] * step)
        best = int(np.argmax(trials))
        if not trials[best] > value + gain:
            break
        point, value = point + fractions[best] * step, float(trials[best])
    return point


def central_differences(function: Callable[[Array], Array], point: Array, step: float) -> tuple[Array, Array]:
    """Gradient (h,) and Hessian (h, h) of a function (n, h) → (n,), all points in one call."""
    h = len(point)
    unit = np.eye(h) * step
    i, j = np.tril_indices(h, -1)
    corners = [a * unit[i] + b * unit[j] for a, b in ((1, 1), (1, -1), (-1, 1), (-1, -1))]
    values = function(point + np.concatenate([np.zeros((1, h)), unit, -unit, *corners]))
    plus, minus = values[1 : h + 1], values[h + 1 : 2 * h + 1]
    hessian = np.diag((plus + minus - 2 * values[0]) / step**2)
    a, b, c, d = values[2 * h + 1 :].reshape(4, -1)
    hessian[i, j] = hessian[j, i] = (a - b - c + d) / (4 * step**2)
    return (plus - minus) / (2 * step), hessian


def holm(p_value: Array) -> Array:
    """p-values that hold the family-wise error whatever the dependence (Holm 1979)."""
    order = np.argsort(p_value, kind="stable")
    stepped = np.minimum(np.maximum.accumulate(p_value[order] * np.arange(len(p_value), 0, -1)), 1.0)
    found = np.empty(len(p_value))
    found[order] = stepped
    return found
