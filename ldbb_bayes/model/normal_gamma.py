"""What the scale of the noise brings with it: Student-t coefficients and the normal-gamma distribution."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
import scipy.special
from numpy.typing import NDArray

from ldbb_bayes.errors import InputError

__all__ = ["NormalGamma", "StudentT", "check_between"]

Array = NDArray[Any]
_LOG_2 = float(np.log(2))
_LOG_2PI = float(np.log(2 * np.pi))


@dataclass(frozen=True, eq=False)
class StudentT:
    """mean + root z √(ν/χ²) with z ~ N(0, I), χ² ~ χ²(ν): the multivariate Student-t distribution.

    Attributes
    ----------
    mean : ndarray, shape (p,)
        Location; the mean from more than one degree of freedom on.
    root : ndarray, shape (p, p)
        Lower triangular square root of the scale matrix, positive diagonal.
    dof : float
        ν, degrees of freedom.
    """

    mean: Array
    root: Array
    dof: float

    @property
    def scale(self) -> Array:
        """Marginal scales, shape (p,): what least squares calls the standard deviations of its estimates."""
        return np.sqrt(np.einsum("ij,ij->i", self.root, self.root))

    @property
    def sd(self) -> Array:
        """Marginal standard deviations, shape (p,); infinite up to two degrees of freedom."""
        return self.scale * np.sqrt(self.dof / (self.dof - 2.0)) if self.dof > 2.0 else np.full(len(self.mean), np.inf)

    @property
    def covariance(self) -> Array:
        """Covariance, shape (p, p).

        Raises
        ------
        InputError
            Up to two degrees of freedom, where there is none.
        """
        if self.dof <= 2.0:
            raise InputError(f"dof must be > 2 for a covariance to exist, got {self.dof:g}. Use interval, or add observations.")
        return self.root @ self.root.T * (self.dof / (self.dof - 2.0))

    def interval(self, prob: float) -> Array:
        """Equal-tailed marginal intervals of probability ``prob``, shape (2, p): lower and upper ends."""
        check_between("prob", prob, 1.0, "Give 0.95 for 95 %.")
        half = float(scipy.special.stdtrit(self.dof, 0.5 + 0.5 * prob)) * self.scale
        return np.stack([self.mean - half, self.mean + half])

    def log_density(self, value: Array) -> float:
        """ln t(value; mean, scale matrix, ν)."""
        p, half = len(self.mean), 0.5 * self.dof
        white = scipy.linalg.solve_triangular(self.root, value - self.mean, lower=True)
        constant = scipy.special.gammaln(half + 0.5 * p) - scipy.special.gammaln(half) - 0.5 * p * np.log(np.pi * self.dof)
        return float(constant - np.log(np.diag(self.root)).sum() - (half + 0.5 * p) * np.log1p(white @ white / self.dof))

    def draw(self, size: int, rng: np.random.Generator) -> Array:
        """Independent draws, shape (size, p)."""
        stretch = np.sqrt(self.dof / rng.chisquare(self.dof, (size, 1)))
        return self.mean + stretch * rng.standard_normal((size, len(self.mean))) @ self.root.T


@dataclass(frozen=True, eq=False)
class NormalGamma:
    """β | σ ~ N(mean, σ² root rootᵀ), 1/σ² ~ Gamma(shape, rate).

    Attributes
    ----------
    mean : ndarray, shape (p,)
    root : ndarray, shape (p, p)
        Lower triangular, positive diagonal.
    shape : float
        Half the number of observations that the knowledge of σ is worth.
    rate : float
        [unit of y, squared]

    Raises
    ------
    InputError
        For sizes that do not fit, a root that is none, or a shape or rate that is not positive.
    """

    mean: Array
    root: Array
    shape: float
    rate: float

    def __post_init__(self) -> None:
        p = len(self.mean)
        if self.root.shape != (p, p) or not np.all(np.diag(self.root) > 0.0) or np.any(np.triu(self.root, 1)):
            raise InputError(
                f"root must be lower triangular, of shape ({p}, {p}), with a positive diagonal, got a matrix of shape "
                f"{self.root.shape}. Take the Cholesky factor of the covariance."
            )
        for name, value in (("shape", self.shape), ("rate", self.rate)):
            check_between(name, value, np.inf, "A small one makes a vague prior.")

    @property
    def scale(self) -> float:
        """Typical σ, (rate / shape)^½ [unit of y]: under the flat prior the residual standard deviation."""
        return float(np.sqrt(self.rate / self.shape))

    @property
    def coefficients(self) -> StudentT:
        """p(β), σ integrated out."""
        return StudentT(self.mean, self.scale * self.root, 2.0 * self.shape)

    @property
    def log_normalizer(self) -> float:
        """ln ∫∫ of the density without its constants of p alone; posterior less prior is the log evidence."""
        log_gamma = scipy.special.gammaln(self.shape) - self.shape * np.log(self.rate)
        return float(log_gamma + np.log(np.diag(self.root)).sum())

    def log_density(self, beta: Array, sigma: float) -> float:
        """ln p(β, σ), a density in β and σ."""
        p = len(self.mean)
        white = scipy.linalg.solve_triangular(self.root, beta - self.mean, lower=True)
        kernel = -(2.0 * self.shape + p + 1.0) * np.log(sigma) - (self.rate + 0.5 * white @ white) / sigma**2
        return float(kernel + _LOG_2 - 0.5 * p * _LOG_2PI - self.log_normalizer)

    def draw(self, size: int, rng: np.random.Generator) -> tuple[Array, Array]:
        """Independent draws of β and σ, shapes (size, p) and (size,)."""
        sigma = 1.0 / np.sqrt(rng.gamma(self.shape, 1.0 / self.rate, size))
        return self.mean + sigma[:, None] * rng.standard_normal((size, len(self.mean))) @ self.root.T, sigma


def check_between(name: str, value: float, largest: float, cure: str) -> None:
    """Refuse a number that is not above 0 and below ``largest``.

    Raises
    ------
    InputError
        Ending with ``cure``.
    """
    if not 0.0 < value < largest:
        raise InputError(f"{name} must be above 0 and below {largest:g}, got {value}. {cure}")
