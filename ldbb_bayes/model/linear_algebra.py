"""Least squares of minimum norm and square roots of singular covariances."""

from __future__ import annotations

import numpy as np

from ldbb_bayes.results import Array

__all__ = ["least_squares", "singular_root"]


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
