"""Cholesky and triangular solves of very many small matrices at once: rows and columns first, the stack last.

Every step is one array operation over the whole stack, so that a matrix costs its multiplications and no call of its own.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["back", "cholesky", "forward", "log_determinant"]

Array = NDArray[Any]


def cholesky(matrix: Array) -> Array:
    """Lower L with L Lᵀ = A, shapes (q, q, ...); only the lower triangle of A is read.

    Raises
    ------
    LinAlgError
        When a matrix is not positive definite.
    """
    lower = np.zeros_like(matrix)
    for j in range(len(matrix)):
        pivot = matrix[j, j] - np.einsum("k...,k...->...", lower[j, :j], lower[j, :j])
        if not np.all(pivot > 0.0):
            raise np.linalg.LinAlgError("a matrix of the stack is not positive definite")
        lower[j, j] = np.sqrt(pivot)
        for i in range(j + 1, len(matrix)):
            lower[i, j] = (matrix[i, j] - np.einsum("k...,k...->...", lower[i, :j], lower[j, :j])) / lower[j, j]
    return lower


def forward(lower: Array, right: Array) -> Array:
    """L⁻¹ X, shapes (q, q, ...) and (q, r, ...)."""
    solved = np.empty_like(right)
    for i in range(len(right)):
        rest = right[i].copy()
        for j in range(i):
            rest -= lower[i, j] * solved[j]
        solved[i] = rest / lower[i, i]
    return solved


def back(lower: Array, right: Array) -> Array:
    """L⁻ᵀ X, shapes (q, q, ...) and (q, r, ...)."""
    solved = np.empty_like(right)
    for i in reversed(range(len(right))):
        rest = right[i].copy()
        for j in range(i + 1, len(right)):
            rest -= lower[j, i] * solved[j]
        solved[i] = rest / lower[i, i]
    return solved


def log_determinant(lower: Array) -> Array:
    """ln |L Lᵀ|, shape (...)."""
    return 2.0 * np.log(np.einsum("ii...->i...", lower)).sum(axis=0)
