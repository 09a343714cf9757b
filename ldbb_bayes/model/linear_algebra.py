"""Least-squares solutions of minimum norm, and square roots of singular covariance matrices."""

from __future__ import annotations

import numpy as np

from ldbb_bayes.results import Array

__all__ = ["minimum_norm_solution", "singular_root"]


def minimum_norm_solution(
    jacobian: Array,
    y: Array,
    scale: Array | None = None,
    *,
    rank_tolerance: float = 1e-10,
) -> Array:
    """Return the least-squares solution of smallest norm for p parameters, shape (p,).

    Parameters
    ----------
    jacobian
        Columns of the parameters, shape (n, p).
    y
        Readings, shape (n,).
    scale
        Units of the parameters in which the norm is computed, shape (p,); by default the reciprocal
        norms of the columns.
    rank_tolerance
        Combinations of parameters whose singular value is below this share of the largest count as
        undetermined by the readings.
    """
    if scale is None:
        norms = np.linalg.norm(jacobian, axis=0)
        scale = 1.0 / np.where(norms > 0, norms, 1.0)
    solution, *_ = np.linalg.lstsq(jacobian * scale, y, rcond=rank_tolerance)
    return solution * scale


def singular_root(covariance: Array) -> Array:
    """Return a square root X of a covariance matrix, X Xᵀ = covariance, shape (..., p, p).

    The covariance may be singular, unlike for a Cholesky factor.
    """
    symmetric = 0.5 * (covariance + np.swapaxes(covariance, -1, -2))
    values, vectors = np.linalg.eigh(symmetric)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :])
