"""Triangular algebra on stacks of small matrices, column by column so that a whole stack moves at once.

NumPy factors stacks but solves them only by LU; here L Lᵀ = A and L⁻¹ b come out of one Cholesky factorisation.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["factor_and_solve", "solve_lower", "solve_upper"]

Array = NDArray[Any]
_NEVER_REACHED = 1e30


def factor_and_solve(matrix: Array, right: Array) -> tuple[Array, Array]:
    """Cholesky factor L of A, shape (..., q, q), and L⁻¹ b, shape (..., q).

    b is the last row of a matrix one larger, whose factor holds both; its last diagonal entry only has to be large enough.

    Raises
    ------
    LinAlgError
        When a matrix is not positive definite.
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
