"""ln g(x) = constant + ηᵀ x − ½ xᵀ P x: the one kernel of Gaussian algebra, with leading batch
axes, and what goes with it.

| what | how |
|---|---|
| prior, known moments | `Gaussian.of(mean, covariance or variances)` |
| likelihood of white rows y = J x + N(0, I) | `Gaussian.from_rows(J, y)`; prior × likelihood: `prior.observe(J, y)` |
| sums of information, possibly singular | `Gaussian(P, η, constant)`; `+` multiplies densities |
| ∫ g, moments, p(x_i) | `log_integral`, `mean`, `sd`, `covariance`, `marginal(keep)` |
| draws, standard coordinates, densities | `draw`, `at`, `white`, `log_density` |

The square root is what is kept: P = S⁻¹ L Lᵀ S⁻¹, S diagonal scales. Rows are factored by QR,
columns scaled; no normal equations, nothing is inverted. Moments need P positive definite; sums do
not.

Beside it: triangular algebra on stacks (`eliminate`, `solve_lower`, `solve_upper`), least squares
of minimum norm, moments and quantiles of mixtures of Gaussians, quantiles of weighted draws,
Newton's method for a mode, Holm's adjustment, Sobol's points.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache, cached_property
from pathlib import Path
from typing import Self

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from ldbb_bayes.errors import InputError
from ldbb_bayes.results import Array, Shown

__all__ = [
    "Gaussian",
    "Sobol",
    "central_differences",
    "components",
    "eliminate",
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

_LOG_2PI = float(np.log(2 * np.pi))
# A pivot this much smaller than the largest has at most three digits above rounding.
_DEPENDENT = 1e-13
_BITS = np.arange(30)


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
        """Independent draws, shape ``(*size, ..., q)``."""
        return self.at(rng.standard_normal((*size, *self.mean.shape)))


def eliminate(
    front: Array,
    links: Array | None = None,
    *,
    sign: Array | None = None,
    linked: Array | None = None,
) -> None:
    """Cholesky factorisation in place, the stack last: of s columns of symmetric matrices and of
    what is right of them, ``front`` (g, s, n, w), n ≥ s, column j from its diagonal on being [:, j,
    j:]; NaN where one is not positive definite. The products of ``links`` (k, n, w), columns
    eliminated before, are subtracted first. L S Lᵀ where pivots have a ``sign`` S (g, s), those of
    the links in ``linked`` (k,)."""
    left = front if sign is None else np.empty_like(front)
    before = links if links is None or linked is None else links * linked[:, None, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        for j in range(front.shape[1]):
            column = front[:, j, j:]
            if links is not None and before is not None:
                column -= np.einsum("kw,kiw->iw", before[:, j], links[:, j:])
            if j:
                column -= np.einsum("gkw,gkiw->giw", left[:, :j, j], front[:, :j, j:])
            own = 1.0 if sign is None else sign[:, j, None, None]
            column *= own / np.sqrt(own * column[:, :1])
            if sign is not None:
                left[:, j, j:] = own * column


def solve_lower(lower: Array, right: Array, *, triangular: bool = False) -> Array:
    """L⁻¹ X of stacks, shapes (..., q, q) and (..., q, k), X perhaps lower ``triangular``
    itself."""
    lower, solved = _stack_last(lower, right, 2)
    for i in range(len(solved)):
        if i:
            k = i if triangular else None
            solved[i, :k] -= np.einsum("j...,jk...->k...", lower[i, :i], solved[:i, :k])
        solved[i] /= lower[i, i]
    return np.moveaxis(solved, (0, 1), (-2, -1))


def solve_upper(lower: Array, right: Array) -> Array:
    """L⁻ᵀ x of stacks, shapes (..., q, q) and (..., q)."""
    lower, solved = _stack_last(lower, right, 1)
    for i in reversed(range(len(solved))):
        if i + 1 < len(solved):
            solved[i] -= np.einsum("j...,j...->...", lower[i + 1 :, i], solved[i + 1 :])
        solved[i] /= lower[i, i]
    return np.moveaxis(solved, 0, -1)


def _stack_last(lower: Array, right: Array, axes: int) -> tuple[Array, Array]:
    """L (q, q, ...) and a copy of the right side (q, ...) or (q, k, ...): the stack last and
    contiguous."""
    batch = np.broadcast_shapes(lower.shape[:-2], right.shape[:-axes])
    turned = np.ascontiguousarray(np.moveaxis(lower, (-2, -1), (0, 1)))
    turned = np.broadcast_to(np.moveaxis(turned, (0, 1), (-2, -1)), (*batch, *lower.shape[-2:]))
    copied = np.empty((*right.shape[-axes:], *batch))
    copied[...] = np.moveaxis(
        np.broadcast_to(right, (*batch, *right.shape[-axes:])), range(-axes, 0), range(axes)
    )
    return np.moveaxis(turned, (-2, -1), (0, 1)), copied


def least_squares(
    jacobian: Array, y: Array, scale: Array | None = None, *, rank_tolerance: float = 1e-10
) -> Array:
    """Minimum-norm least squares (p,) of y (n,) by the columns of a Jacobian (n, p), in units of
    ``scale`` (p,), typical sizes of the parameters, by default reciprocal column norms; directions
    of smaller relative singular values are undetermined."""
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


_ITERATIONS = 100
_CLOSE = 1e-12
_TOGETHER = 200_000


def mixture_moments(weight: Array, mean: Array, sd: Array) -> tuple[Array, Array]:
    """Mean and sd, shape (...), of mixtures of Gaussians: weights (k,), components (k, ...)."""
    middle = np.tensordot(weight, mean, 1)
    return middle, np.sqrt(np.tensordot(weight, sd**2 + (mean - middle) ** 2, 1))


def mixture_quantiles(
    weight: Array, mean: Array, sd: Array, levels: Sequence[float] | Array
) -> Array:
    """Quantiles, shape (levels, ...), of mixtures of Gaussians: Newton's method kept inside a
    bracket. Components (k, ...); weights (k,), or an array that broadcasts with them, sum to one
    along the first axis."""
    flat_mean, flat_sd = (part.reshape(len(mean), -1) for part in (mean, sd))
    weight = weight.reshape(-1, *(1,) * (mean.ndim - 1)) if weight.ndim == 1 else weight
    flat_weight = np.broadcast_to(weight, mean.shape).reshape(flat_mean.shape)
    found = np.empty((len(levels), flat_mean.shape[1]))
    size = max(1, _TOGETHER // len(mean))
    for start in range(0, flat_mean.shape[1], size):
        own = slice(start, start + size)
        for row, level in enumerate(levels):
            found[row, own] = _mixture_quantile(
                flat_weight[:, own], flat_mean[:, own], flat_sd[:, own], level
            )
    return found.reshape(len(levels), *mean.shape[1:])


def _mixture_quantile(weight: Array, mean: Array, sd: Array, level: float) -> Array:
    each = mean + ndtri(level) * sd
    low = each.min(axis=0)
    high = each.max(axis=0)
    middle = (weight * mean).sum(axis=0)
    spread = np.sqrt((weight * (sd**2 + (mean - middle) ** 2)).sum(axis=0))
    x = np.clip(middle + ndtri(level) * spread, low, high)
    step = high - low
    for _ in range(_ITERATIONS):
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            z = (x - mean) / sd
            excess = (weight * ndtr(z)).sum(axis=0) - level
            low = np.where(excess <= 0.0, x, low)
            high = np.where(excess >= 0.0, x, high)
            new = x - excess / (
                (weight * (np.exp(-0.5 * z**2) / sd)).sum(axis=0) / np.sqrt(2.0 * np.pi)
            )
        # Newton's step where it is the last, or stays inside the bracket and is at most half of the
        # one before; else halfway.
        size = np.abs(new - x)
        good = (size <= _CLOSE * spread) | (
            (new > low) & (new < high) & (size <= 0.5 * np.abs(step))
        )
        new = np.where(good, new, 0.5 * (low + high))
        step = new - x
        x = new
        if np.all(np.abs(step) <= _CLOSE * spread):
            break
    return x


def weighted_quantiles(weight: Array, draws: Array, levels: Sequence[float] | Array) -> Array:
    """Quantiles, shape (levels, ...), of weighted draws (k, ...), linear between the middles of
    their weights."""
    flat = draws.reshape(len(draws), -1)
    found = np.empty((len(levels), flat.shape[1]))
    for column in range(flat.shape[1]):
        order = np.argsort(flat[:, column], kind="stable")
        reached = np.cumsum(weight[order]) - 0.5 * weight[order]
        found[:, column] = np.interp(levels, reached, flat[order, column])
    return found.reshape(len(levels), *draws.shape[1:])


_FRACTIONS = (1.0, 0.5, 0.25, 0.1, 0.03)
_LONGEST = 1.5
_STEPS = 60


def newton(
    log_density: Callable[[Array], Array],
    derivatives: Callable[[Array], tuple[Array, Array]],
    start: Array,
    *,
    least_curvature: float = 0.3,
    gain: float = 1e-6,
) -> Array:
    """A mode of a log density (n, h) → (n,), shape (h,), by damped Newton steps from a start;
    ``derivatives`` of a point: its gradient (h,) and Hessian (h, h).

    Directions of wrong curvature are turned round, none counts as flatter than ``least_curvature``,
    no step is longer than 1.5; of several fractions of a step, tried in one call, the best is
    taken. Steps end when the density rises by no more than ``gain`` [nat].
    """
    point = np.array(start, dtype=float)
    fractions = np.array(_FRACTIONS)
    value = float(log_density(point[None])[0])
    for _ in range(_STEPS):
        gradient, hessian = derivatives(point)
        curvature, vectors = np.linalg.eigh(-hessian)
        step = vectors @ ((vectors.T @ gradient) / np.maximum(np.abs(curvature), least_curvature))
        step *= min(1.0, _LONGEST / max(float(np.linalg.norm(step)), 1e-12))
        trials = log_density(point + fractions[:, None] * step)
        best = int(np.argmax(trials))
        if not trials[best] > value + gain:
            break
        point = point + fractions[best] * step
        value = float(trials[best])
    return point


def central_differences(
    function: Callable[[Array], Array], point: Array, step: float
) -> tuple[Array, Array]:
    """Gradient (h,) and Hessian (h, h) of a function (n, h) → (n,), all points in one call."""
    h = len(point)
    unit = np.eye(h) * step
    i, j = np.tril_indices(h, -1)
    corners = [a * unit[i] + b * unit[j] for a, b in ((1, 1), (1, -1), (-1, 1), (-1, -1))]
    values = function(point + np.concatenate([np.zeros((1, h)), unit, -unit, *corners]))
    plus = values[1 : h + 1]
    minus = values[h + 1 : 2 * h + 1]
    hessian = np.diag((plus + minus - 2 * values[0]) / step**2)
    a, b, c, d = values[2 * h + 1 :].reshape(4, -1)
    hessian[i, j] = hessian[j, i] = (a - b - c + d) / (4 * step**2)
    return (plus - minus) / (2 * step), hessian


def components(linked: Array) -> NDArray[np.intp]:
    """Number of the group that each belongs to, shape (n,), what is linked (n, n) directly or
    through others being one group."""
    label = np.arange(len(linked))
    joined = linked | np.eye(len(linked), dtype=bool)
    while np.any(
        label != (nearest := np.where(joined, label, len(linked)).min(axis=1, initial=len(linked)))
    ):
        label = nearest
    return np.unique(label, return_inverse=True)[1]


def holm(p_value: Array) -> Array:
    """p-values that hold the family-wise error whatever the dependence (Holm 1979)."""
    order = np.argsort(p_value, kind="stable")
    stepped = np.minimum(
        np.maximum.accumulate(p_value[order] * np.arange(len(p_value), 0, -1)), 1.0
    )
    found = np.empty(len(p_value))
    found[order] = stepped
    return found


class Sobol:
    """Scrambled points of the unit cube (Joe and Kuo 2008; Matoušek 1998), those of
    `scipy.stats.qmc.Sobol`, whose import would take every command a second."""

    def __init__(self, dimensions: int, rng: np.random.Generator) -> None:
        rng = rng.spawn(1)[0]
        self._shift = rng.integers(2, size=(dimensions, _BITS.size), dtype=np.uint32) @ (1 << _BITS)
        mixing = np.tril(
            rng.integers(2, size=(dimensions, _BITS.size, _BITS.size), dtype=np.uint32), -1
        ) + np.eye(_BITS.size)
        bits = _sobol_directions(dimensions)[:, :, None] >> _BITS[::-1] & 1
        self._directions = (
            (bits @ np.swapaxes(mixing, 1, 2)).astype(np.int64) % 2 @ (1 << _BITS[::-1])
        )
        self._drawn = 0

    def random(self, size: int) -> Array:
        """The next points, shape (size, dimensions)."""
        index = np.arange(self._drawn, self._drawn + size)
        self._drawn += size
        points = np.zeros((1, len(self._shift)), dtype=np.int64)
        for direction in self._directions.T[: int(index[-1]).bit_length()]:
            points = np.concatenate([points, points ^ direction])
        return np.asarray((points[index ^ index >> 1] ^ self._shift) / 2.0**_BITS.size)


@cache
def _sobol_directions(dimensions: int) -> NDArray[np.int64]:
    """Direction numbers (dimensions, bits) by the recurrence of Bratley and Fox (1988), from the
    table that SciPy brings."""
    with np.load(Path(scipy.__file__).parent / "stats" / "_sobol_direction_numbers.npz") as table:
        polynomials = table["poly"].tolist()
        starts = table["vinit"]
    numbers = np.ones((dimensions, _BITS.size), dtype=np.int64)
    for own, polynomial, start in zip(numbers[1:], polynomials[1:], starts[1:], strict=False):
        degree = polynomial.bit_length() - 1
        own[:degree] = start[:degree]
        taps = [k for k in range(1, degree + 1) if polynomial >> (degree - k) & 1]
        for j in range(degree, _BITS.size):
            own[j] = np.bitwise_xor.reduce([own[j - degree], *(own[j - k] << k for k in taps)])
    return numbers << _BITS[::-1]
