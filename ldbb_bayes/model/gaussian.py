"""Algebra of Gaussian functions of coefficients x: ln g(x) = constant + ηᵀ x − ½ xᵀ P x.

x are q coefficients. P, shape (q, q), is the precision matrix (the inverse of the covariance), and
η = P · mean, shape (q,). Leading array dimensions "..." hold many Gaussian functions. "Whitened"
rows and readings are divided by the standard deviation of the noise. The class `Gaussian` is used
for all linear Gaussian computations:

| what | how |
|---|---|
| prior of known mean and covariance | `Gaussian.of(mean, covariance or variances)` |
| likelihood of whitened rows y = J x + N(0, I) | `Gaussian.from_rows(J, y)` |
| prior × likelihood | `prior.observe(J, y)` |
| function with a precision matrix P that may be singular | `Gaussian(P, η, constant)` |
| product of two Gaussian functions f and g of the same coefficients | `f + g` |
| ∫ g, moments, marginal densities | `log_integral`, `mean`, `sd`, `covariance`, `marginal(keep)` |
| random draws, standardised x, densities | `draw`, `from_standard`, `standardize`, `log_density` |

P is stored as P = S⁻¹ L Lᵀ S⁻¹, where L is lower triangular and S is a diagonal matrix of scales.
To limit rounding errors, likelihoods are computed by the QR decomposition of rows with scaled
columns, without normal equations. Means and covariances exist only if P is positive definite;
products of Gaussian functions can be computed for any P.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np

from ldbb_bayes.errors import InputError
from ldbb_bayes.model.triangular import log_diagonal, solve_lower, solve_upper
from ldbb_bayes.results import Array, Shown

__all__ = ["LOG_2PI", "Gaussian"]

LOG_2PI = float(np.log(2 * np.pi))
# Columns of a design matrix count as linearly dependent if a diagonal entry of the R factor of
# their QR decomposition is below this fraction of the largest diagonal entry. Such an entry has at
# most three correct digits.
_DEPENDENT = 1e-13


class _Factors(NamedTuple):
    """Mean of q Gaussian coefficients, and factors of their precision matrix P = S⁻¹ L Lᵀ S⁻¹.

    ``mean`` has shape (..., q). ``root`` is the lower triangular matrix L, shape (..., q, q).
    ``scale`` is the diagonal of the diagonal matrix S, shape (..., q).
    """

    mean: Array
    root: Array
    scale: Array


class Gaussian(Shown):
    """Gaussian functions g(x) = exp(constant + ηᵀ x − ½ xᵀ P x), which need not be normalised.

    The vector x holds q coefficients. Leading array dimensions "..." hold many functions.

    Parameters
    ----------
    precision
        Symmetric precision matrix P, shape (..., q, q). If it is singular, mean and covariance
        cannot be computed.
    shift
        Vector η = P · mean, shape (..., q).
    log_constant
        Logarithm of g at x = 0, shape (...).
    """

    shown = ("precision", "shift")

    def __init__(
        self,
        precision: Array,
        shift: Array,
        log_constant: Array | float = 0.0,
    ) -> None:
        """Store precision, shift and constant; mean and factors are computed when needed."""
        # These attributes are cached properties. Because they are assigned here, they are not
        # computed from mean and root.
        self.precision = precision
        self.shift = shift
        self.log_constant = np.asarray(log_constant, dtype=float)

    @classmethod
    def factored(
        cls,
        mean: Array,
        root: Array,
        scale: Array,
        log_integral: Array | float = 0.0,
    ) -> Self:
        """Return the Gaussian function of q coefficients with precision P = S⁻¹ L Lᵀ S⁻¹.

        Parameters
        ----------
        mean
            Mean of the coefficients, shape (..., q).
        root
            Lower triangular matrix L, shape (..., q, q).
        scale
            Diagonal of the diagonal matrix S, which scales the coefficients, shape (..., q).
        log_integral
            Logarithm of the integral of the function over all coefficients, shape (...); 0 if the
            function is a normalised density.
        """
        gaussian = cls.__new__(cls)
        gaussian._factors = _Factors(mean, root, scale)
        gaussian.log_integral = np.asarray(log_integral, dtype=float)
        return gaussian

    @classmethod
    def of(cls, mean: Array, covariance: Array) -> Gaussian:
        """Return the normalised Gaussian density N(mean, covariance) of q coefficients.

        Parameters
        ----------
        mean
            Mean of the coefficients, shape (..., q).
        covariance
            Covariance matrix, shape (..., q, q), or the variances of independent coefficients,
            shape (..., q).

        Raises
        ------
        InputError
            If a covariance matrix is not positive definite, or a variance is not positive.
        """
        q = mean.shape[-1]
        if covariance.shape == mean.shape:
            if not np.all(covariance > 0):
                raise InputError(
                    f"variances must be positive, got {covariance.min()}. Remove that column or"
                    " correct it."
                )
            unit_root = np.broadcast_to(np.eye(q), (*mean.shape, q))
            return cls.factored(mean, unit_root, np.sqrt(covariance))
        sd = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
        try:
            root = np.linalg.cholesky(covariance / (sd[..., :, None] * sd[..., None, :]))
        except np.linalg.LinAlgError:
            raise InputError(
                "a covariance must be positive definite, got a singular or indefinite one."
                " Correct it."
            ) from None
        unit_matrices = np.broadcast_to(np.eye(q), covariance.shape)
        inverse = solve_lower(root, unit_matrices)
        upper = np.asarray(np.linalg.qr(inverse, mode="r"))
        return cls.factored(mean, _lower_with_positive_diagonal(upper), sd)

    @classmethod
    def from_rows(cls, rows: Array, values: Array) -> Gaussian:
        """Return the likelihood Π N(values; rows · x, 1) as a function of q coefficients x.

        The product runs over n readings. The mean of the result is the least-squares estimate of x.
        The ``log_integral`` of the result contains −½ times the residual sum of squares.

        Parameters
        ----------
        rows
            Design matrix of n readings and q coefficients, divided by the sd of the noise, shape
            (..., n, q).
        values
            Readings divided by the sd of the noise, shape (..., n).

        Raises
        ------
        InputError
            If the readings do not determine every coefficient.
        """
        n, q = rows.shape[-2:]
        scale = _column_scales(rows)
        stack = np.concatenate([rows * scale[..., None, :], values[..., None]], axis=-1)
        triangle = stack
        if n > 0:
            triangle = np.asarray(np.linalg.qr(stack, mode="r"))
        pivots = np.abs(np.diagonal(triangle, axis1=-2, axis2=-1))[..., :q]
        largest_pivot = pivots.max(axis=-1, keepdims=True)
        if n < q or np.any(pivots <= _DEPENDENT * largest_pivot):
            raise InputError(
                "rows must determine every coefficient, got columns that follow from others. Give a"
                " proper prior."
            )
        log_norm = -0.5 * n * LOG_2PI + 0.5 * q * LOG_2PI
        return cls._from_triangle(triangle, np.zeros(q), scale, log_norm)

    def observe(self, rows: Array, values: Array) -> Gaussian:
        """Return the posterior density of q coefficients x: prior times Gaussian likelihood.

        The prior is the Gaussian function to which the method belongs. The likelihood is Π
        N(values; rows · x, 1), a product over n readings. The ``log_integral`` of the posterior is
        the ``log_integral`` of the prior plus the log evidence, ln p(values).

        Parameters
        ----------
        rows
            Design matrix of n readings and q coefficients, divided by the sd of the noise, shape
            (..., n, q).
        values
            Readings divided by the sd of the noise, shape (..., n).
        """
        mean, root, scale = self._factors
        residual = values - (rows @ mean[..., None])[..., 0]
        stack = np.concatenate([rows * scale[..., None, :], residual[..., None]], axis=-1)
        no_values = np.zeros((*root.shape[:-1], 1))
        prior_stack = np.concatenate([np.swapaxes(root, -1, -2), no_values], axis=-1)
        batch = np.broadcast_shapes(stack.shape[:-2], prior_stack.shape[:-2])
        stack = np.broadcast_to(stack, (*batch, *stack.shape[-2:]))
        prior_stack = np.broadcast_to(prior_stack, (*batch, *prior_stack.shape[-2:]))
        joint = np.concatenate([stack, prior_stack], axis=-2)
        triangle = np.asarray(np.linalg.qr(joint, mode="r"))
        constant = self.log_integral + log_diagonal(root) - 0.5 * rows.shape[-2] * LOG_2PI
        return Gaussian._from_triangle(triangle, mean, scale, constant, has_prior=True)

    @classmethod
    def _from_triangle(
        cls,
        triangle: Array,
        origin: Array,
        scale: Array,
        constant: Array | float,
        *,
        has_prior: bool = False,
    ) -> Gaussian:
        """Return a Gaussian function of q coefficients x from a QR decomposition.

        The function is the likelihood of readings with a linear model or, if there is a prior, the
        product of prior and likelihood. Let ``rows`` be the design matrix and ``values`` the
        readings, both divided by the sd of the noise. The matrix that was decomposed has the
        columns of rows · S, where S is diagonal, and the last column values − rows · origin.

        Parameters
        ----------
        triangle
            Triangular factor R of the QR decomposition, shape (..., rows, q + 1). It has at least q
            rows.
        origin
            Values of the q coefficients, shape (..., q). The decomposition is computed for the
            deviations of the coefficients from these values, which reduces rounding errors.
        scale
            Diagonal of the diagonal matrix S, shape (..., q).
        constant
            Term that is added to the logarithm of the function's integral, in addition to the terms
            computed from R and ``scale``. If there is a prior, this term includes ln det L.
        has_prior
            Whether the decomposed matrix also has the rows [Lᵀ, 0] of a prior with the mean
            ``origin`` and the precision matrix S⁻¹ L Lᵀ S⁻¹, where L is lower triangular.
        """
        q = scale.shape[-1]
        upper = triangle[..., :q, :q]
        root = _lower_with_positive_diagonal(upper)
        sign = np.where(np.diagonal(upper, axis1=-2, axis2=-1) < 0, -1.0, 1.0)
        mean = origin + scale * solve_upper(root, triangle[..., :q, q] * sign)
        log_integral = constant - log_diagonal(root)
        if not has_prior:
            log_integral = log_integral + np.log(scale).sum(axis=-1)
        if triangle.shape[-2] > q:
            log_integral = log_integral - 0.5 * triangle[..., q, q] ** 2
        return cls.factored(mean, root, np.broadcast_to(scale, mean.shape), log_integral)

    @cached_property
    def _factors(self) -> _Factors:
        """Means of the Gaussian functions, and factors L and S of their precision matrices.

        A Gaussian function of q coefficients has a precision matrix P = S⁻¹ L Lᵀ S⁻¹, with a lower
        triangular matrix L and a diagonal matrix S. Means and factors are computed from the fields
        ``precision`` and ``shift``.
        """
        diagonal = np.diagonal(self.precision, axis1=-2, axis2=-1)
        scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
        root = np.linalg.cholesky(self.precision * (scale[..., :, None] * scale[..., None, :]))
        white_shift = solve_lower(root, (self.shift * scale)[..., None])[..., 0]
        return _Factors(solve_upper(root, white_shift) * scale, root, scale)

    @cached_property
    def precision(self) -> Array:
        """Precision matrix P of each Gaussian function of q coefficients, shape (..., q, q)."""
        _, root, scale = self._factors
        return (root @ np.swapaxes(root, -1, -2)) / (scale[..., :, None] * scale[..., None, :])

    @cached_property
    def shift(self) -> Array:
        """Vector η = P · mean of each Gaussian function of q coefficients, shape (..., q).

        P is the precision matrix of the function.
        """
        return np.einsum("...ij,...j->...i", self.precision, self.mean)

    @cached_property
    def log_constant(self) -> Array:
        """Logarithm of the Gaussian function at the point where all q coefficients are zero.

        There is one number for each Gaussian function, shape (...).
        """
        origin = np.zeros(self.mean.shape[-1])
        return np.asarray(self.log_integral + self.log_density(origin))

    @cached_property
    def log_integral(self) -> Array:
        """Logarithm of the integral of the Gaussian function over all coefficients, shape (...).

        If the function is the product of a normalised prior and a likelihood, the result is the log
        evidence.
        """
        mean, root, scale = self._factors
        q = mean.shape[-1]
        log_volume = np.log(scale).sum(axis=-1) - log_diagonal(root) + 0.5 * q * LOG_2PI
        peak = self.log_constant + 0.5 * (self.shift * mean).sum(axis=-1)
        return np.asarray(peak + log_volume)

    @property
    def mean(self) -> Array:
        """Mean of the q coefficients of each Gaussian function, shape (..., q)."""
        return self._factors.mean

    @property
    def root(self) -> Array:
        """Lower triangular factor L of the scaled precision matrix S P S = L Lᵀ, shape (..., q, q).

        P is the precision matrix of a Gaussian function of q coefficients, and S is the diagonal
        matrix of the scales of these coefficients.
        """
        return self._factors.root

    @property
    def scale(self) -> Array:
        """Scales of the q coefficients of each Gaussian function, shape (..., q).

        The scales are the diagonal of S in the precision matrix (inverse covariance) S⁻¹ L Lᵀ S⁻¹
        of the coefficients, with L lower triangular.
        """
        return self._factors.scale

    def spread(self, combinations: Array | None = None) -> Array:
        """Return a square root X of the covariance of the q coefficients, with X Xᵀ = covariance.

        Parameters
        ----------
        combinations
            Matrix A, shape (..., m, q). Each of its m rows holds the weights of the q coefficients
            in a linear combination. The leading dimensions of A are broadcast with the dimensions
            "..." of the Gaussian functions. If A is given, X is the square root of the covariance
            of the m combinations.

        Returns
        -------
        Square root X. Its shape is (..., q, q), or (..., m, q) for m linear combinations.
        """
        rows = np.eye(self.scale.shape[-1]) if combinations is None else combinations
        scaled = np.swapaxes(rows * self.scale[..., None, :], -1, -2)
        solved = solve_lower(self.root, scaled, triangular=combinations is None)
        return np.swapaxes(solved, -1, -2)

    @property
    def covariance(self) -> Array:
        """Covariance matrix of the q coefficients of each Gaussian function, shape (..., q, q)."""
        spread = self.spread()
        return spread @ np.swapaxes(spread, -1, -2)

    @property
    def sd(self) -> Array:
        """Standard deviations of the q coefficients of each Gaussian function, shape (..., q)."""
        return np.sqrt((self.spread() ** 2).sum(axis=-1))

    def __add__(self, other: Gaussian) -> Gaussian:
        """Return the product of this Gaussian function and the Gaussian function ``other``.

        The product is written with the operator +, because the logarithms of the functions are
        added.
        """
        return Gaussian(
            self.precision + other.precision,
            self.shift + other.shift,
            self.log_constant + other.log_constant,
        )

    def marginal(self, keep: Sequence[int]) -> Gaussian:
        """Return the marginal Gaussian of the coefficients with the indices ``keep``.

        All other coefficients are integrated out. The coefficients of the result are in the order
        of ``keep``.
        """
        mean, root, scale = self._factors
        q = mean.shape[-1]
        first = q - len(keep)
        order = [*np.setdiff1d(np.arange(q), keep), *keep]
        if order != list(range(q)):
            reordered = np.swapaxes(root, -1, -2)[..., order]
            root = _lower_with_positive_diagonal(np.asarray(np.linalg.qr(reordered, mode="r")))
        return Gaussian.factored(
            mean[..., keep], root[..., first:, first:], scale[..., keep], self.log_integral
        )

    def from_standard(self, z: Array) -> Array:
        """Return the coefficients mean + S L⁻ᵀ z, shape (..., q), for standard normal values z.

        S⁻¹ L Lᵀ S⁻¹ is the precision matrix of the q coefficients, with S diagonal and L lower
        triangular.
        """
        return self.mean + solve_upper(self.root, z) * self.scale

    def standardize(self, x: Array) -> Array:
        """Return standard normal coordinates Lᵀ S⁻¹ (x − mean) of coefficients x, shape (..., q).

        S⁻¹ L Lᵀ S⁻¹ is the precision matrix of the q coefficients, with S diagonal and L lower
        triangular.
        """
        return np.einsum("...ij,...i->...j", self.root, (x - self.mean) / self.scale)

    def log_density(self, x: Array) -> Array:
        """Return the log of the normalised density at q coefficients x, shape (...).

        ``x`` has the shape (..., q).
        """
        z = self.standardize(x)
        log_root = log_diagonal(self.root) - np.log(self.scale).sum(axis=-1)
        return np.asarray(log_root - 0.5 * ((z**2).sum(axis=-1) + z.shape[-1] * LOG_2PI))

    def draw(
        self,
        rng: np.random.Generator,
        size: tuple[int, ...] = (),
    ) -> Array:
        """Return random draws from Gaussian functions of q coefficients, shape ``(*size, ..., q)``.

        ``size`` is the shape of the array of draws from each Gaussian function; by default, there
        is one draw from each. The dimensions "..." hold the Gaussian functions. The draws are
        independent.
        """
        return self.from_standard(rng.standard_normal((*size, *self.mean.shape)))


def _lower_with_positive_diagonal(upper: Array) -> Array:
    """Return upper triangular matrices as lower triangular matrices with a positive diagonal.

    ``upper``, shape (..., q, q), holds upper triangular matrices with q rows and columns. Each row
    with a negative diagonal entry is multiplied by −1; then the matrices are transposed.
    """
    sign = np.where(np.diagonal(upper, axis1=-2, axis2=-1) < 0, -1.0, 1.0)
    return np.swapaxes(upper * sign[..., :, None], -1, -2)


def _column_scales(rows: Array) -> Array:
    """Return factors, shape (..., q), by which columns are scaled to norms close to one.

    ``rows``, shape (..., n, q), holds matrices of n rows and q columns. There is one factor for
    each column. The factors are powers of two, so that multiplication by them causes no rounding
    errors.
    """
    norms = np.linalg.norm(rows, axis=-2)
    exponent = np.round(np.log2(np.where(norms > 0.0, norms, 1.0))).astype(int)
    return np.ldexp(1.0, -exponent)
