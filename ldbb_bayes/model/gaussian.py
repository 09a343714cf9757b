"""y | β ~ N(Jβ, Σ), β ~ N(m, S): the linear Gaussian model, dense and free of any domain.

Everything by QR and Cholesky; nothing is inverted, no normal equations. Where the noise is known only up to a scale σ, which is
to be inferred too, see `ldbb_bayes.model.regression`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from ldbb_bayes.errors import InputError

__all__ = [
    "Gaussian",
    "LinearGaussian",
    "covariance_root",
    "least_squares",
    "lower_root",
    "singular_root",
]

Array = NDArray[Any]
_LOG_2PI = float(np.log(2 * np.pi))


@dataclass(frozen=True, eq=False)
class Gaussian:
    """N(mean, root rootᵀ).

    Attributes
    ----------
    mean : ndarray, shape (p,)
    root : ndarray, shape (p, p)
        Lower triangular square root of the covariance, positive diagonal.
    """

    mean: Array
    root: Array

    @property
    def covariance(self) -> Array:
        """Covariance, shape (p, p)."""
        return self.root @ self.root.T

    @property
    def sd(self) -> Array:
        """Marginal standard deviations, shape (p,)."""
        return np.sqrt(np.einsum("ij,ij->i", self.root, self.root))

    def log_density(self, value: Array) -> float:
        """ln N(value; mean, covariance)."""
        white = scipy.linalg.solve_triangular(self.root, value - self.mean, lower=True)
        log_root = np.log(np.diag(self.root)).sum()
        return float(-0.5 * (white @ white) - log_root - 0.5 * len(white) * _LOG_2PI)

    def draw(self, size: int, rng: np.random.Generator) -> Array:
        """Independent draws, shape (size, p)."""
        return self.mean + rng.standard_normal((size, len(self.mean))) @ self.root.T

    def kl_from(self, other: Gaussian) -> float:
        """Kullback-Leibler divergence of this distribution from ``other`` [nat]."""
        mixed = scipy.linalg.solve_triangular(other.root, self.root, lower=True)
        shift = scipy.linalg.solve_triangular(other.root, self.mean - other.mean, lower=True)
        log_ratio = np.log(np.diag(other.root)).sum() - np.log(np.diag(self.root)).sum()
        return float(0.5 * (np.sum(mixed**2) + shift @ shift - len(shift)) + log_ratio)


@dataclass(frozen=True, eq=False)
class LinearGaussian:
    """y | β ~ N(Jβ, Σ), β ~ N(m, S).

    | symbol | argument | shape |
    |---|---|---|
    | J | jacobian | (n, p) |
    | Σ | noise | (n, n), or (n,) variances |
    | m | prior_mean | (p,) |
    | S | prior_covariance | (p, p), or (p,) variances |

    Raises
    ------
    InputError
        For shapes that do not fit or a covariance that is not positive definite.
    """

    jacobian: Array
    noise: Array
    prior_mean: Array
    prior_covariance: Array

    def __post_init__(self) -> None:
        n, p = self.jacobian.shape
        for name, array, size in (("noise", self.noise, n), ("prior_covariance", self.prior_covariance, p)):
            if array.shape not in ((size,), (size, size)):
                raise InputError(f"{name} must have shape ({size},) or ({size}, {size}), got {array.shape}. Check the sizes.")
        if self.prior_mean.shape != (p,):
            raise InputError(f"prior_mean must have shape ({p},), got {self.prior_mean.shape}. Check the sizes.")

    @property
    def prior(self) -> Gaussian:
        """p(β)."""
        return Gaussian(self.prior_mean, covariance_root(self.prior_covariance, "prior_covariance"))

    def likelihood(self, beta: Array) -> Gaussian:
        """p(y | β)."""
        return Gaussian(self.jacobian @ beta, covariance_root(self.noise, "noise"))

    def posterior(self, y: Array) -> Gaussian:
        """p(β | y), from the QR factors of the whitened stack [Σ^-½ J; S^-½]."""
        prior_root, noise_root = self.prior.root, covariance_root(self.noise, "noise")
        p = len(self.prior_mean)
        whiten = scipy.linalg.solve_triangular
        scaled = whiten(noise_root, self.jacobian @ prior_root, lower=True)
        residual = whiten(noise_root, y - self.jacobian @ self.prior_mean, lower=True)
        stack = np.vstack([np.column_stack([scaled, residual]), np.eye(p, p + 1)])
        triangle = np.asarray(np.linalg.qr(stack, mode="r"))
        shift = whiten(triangle[:p, :p], triangle[:p, p])
        spread = prior_root @ whiten(triangle[:p, :p], np.eye(p))
        return Gaussian(self.prior_mean + prior_root @ shift, lower_root(spread))

    @property
    def evidence(self) -> Gaussian:
        """p(y), all of β integrated out."""
        root = np.hstack([self.jacobian @ self.prior.root, covariance_root(self.noise, "noise")])
        return Gaussian(self.jacobian @ self.prior_mean, lower_root(root))

    def information_gain(self, y: Array) -> float:
        """Kullback-Leibler divergence of the posterior from the prior [nat]."""
        return self.posterior(y).kl_from(self.prior)


def least_squares(jacobian: Array, y: Array, scale: Array | None = None, *, rank_tolerance: float = 1e-10) -> Array:
    """Minimum-norm least squares in units of ``scale`` per column.

    Parameters
    ----------
    jacobian : ndarray, shape (n, p)
    y : ndarray, shape (n,)
    scale : ndarray, shape (p,), optional
        Typical sizes of the parameters; default: reciprocal column norms.
    rank_tolerance : float
        Relative singular value below which a direction counts as undetermined.

    Returns
    -------
    ndarray, shape (p,)
    """
    if scale is None:
        norms = np.linalg.norm(jacobian, axis=0)
        scale = 1.0 / np.where(norms > 0, norms, 1.0)
    solution, *_ = np.linalg.lstsq(jacobian * scale, y, rcond=rank_tolerance)
    return solution * scale


def covariance_root(covariance: Array, name: str) -> Array:
    """Lower triangular square root of a covariance of shape (p, p), or (p,) variances.

    Raises
    ------
    InputError
        Naming ``name`` when it is not positive definite.
    """
    if covariance.ndim == 1:
        if not np.all(covariance > 0):
            raise InputError(f"{name} must have positive variances, got {covariance.min()}. Remove that column or correct it.")
        return np.diag(np.sqrt(covariance))
    try:
        return np.asarray(np.linalg.cholesky(covariance))
    except np.linalg.LinAlgError:
        raise InputError(f"{name} must be positive definite, got a singular or indefinite matrix. Correct it.") from None


def lower_root(root: Array) -> Array:
    """Lower triangular square root, positive diagonal, of root rootᵀ."""
    triangle = np.asarray(np.linalg.qr(root.T, mode="r")).T
    signs = np.where(np.diag(triangle) < 0, -1.0, 1.0)
    return triangle * signs


def singular_root(covariance: Array) -> Array:
    """X with X Xᵀ = covariance, shape (..., p, p), of covariances that may be singular."""
    values, vectors = np.linalg.eigh(0.5 * (covariance + np.swapaxes(covariance, -1, -2)))
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :])
