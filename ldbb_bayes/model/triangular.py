"""Cholesky factors and solutions of triangular systems, for many small matrices at once.

The matrices have the same size and are stored in one array, called a stack. NumPy and SciPy solve
one triangular system after the other. The functions of this module solve the systems of all
matrices of a stack together, which is much faster for thousands of small systems.
"""

from __future__ import annotations

import numpy as np

from ldbb_bayes.results import Array

__all__ = ["eliminate", "log_diagonal", "solve_columns", "solve_lower", "solve_upper"]


def eliminate(front: Array, *, signs: Array | None = None) -> None:
    """Compute the first columns of the Cholesky factors of many symmetric matrices, in place.

    The factor of a symmetric matrix P is the lower triangular matrix L with P = L S Lᵀ. S is a
    diagonal matrix of signs ±1, by default the unit matrix. Only the first s columns of L are
    computed. If P has no factor with these signs, entries become NaN, and NumPy warns.

    Below the last row of P, ``front`` may have further rows with right-hand sides b, one in each
    row. The first s numbers of b are replaced by those of L⁻¹ b.

    Parameters
    ----------
    front
        First s columns of many matrices P, shape (groups, s, n, w) with n ≥ s; the number of
        matrices is groups · w. Only the part of column j on and below the diagonal, ``front[group,
        j, j:]``, is used. The columns of L overwrite the columns of P.
    signs
        Signs ±1 on the diagonal of S, shape (groups, s); None if all are positive.
    """
    signed = front
    if signs is not None:
        signed = np.empty_like(front)
    for j in range(front.shape[1]):
        column = front[:, j, j:]
        if j > 0:
            column -= np.einsum("gkw,gkiw->giw", signed[:, :j, j], front[:, :j, j:])
        if signs is None:
            column *= 1.0 / np.sqrt(column[:, :1])
        else:
            sign = signs[:, j, None, None]
            column *= sign / np.sqrt(sign * column[:, :1])
            signed[:, j, j:] = sign * column


def solve_lower(
    lower: Array,
    right: Array,
    *,
    triangular: bool = False,
) -> Array:
    """Return L⁻¹ X, shape (..., q, k), for lower triangular matrices L and right-hand sides X.

    Parameters
    ----------
    lower
        Matrices L, shape (..., q, q).
    right
        Right-hand sides X with q rows and k columns, shape (..., q, k).
    triangular
        Whether X is lower triangular too, which saves half of the computation.
    """
    lower, solved = _move_stack_last(lower, right, 2)
    for i in range(len(solved)):
        if i > 0:
            columns = slice(i) if triangular else slice(None)
            solved[i, columns] -= np.einsum("j...,jk...->k...", lower[i, :i], solved[:i, columns])
        solved[i] /= lower[i, i]
    return np.moveaxis(solved, (0, 1), (-2, -1))


def solve_upper(lower: Array, right: Array) -> Array:
    """Return L⁻ᵀ x, shape (..., q), for lower triangular matrices L and right-hand sides x.

    L⁻ᵀ is the inverse of the transpose of L. Each matrix L has q rows and columns.

    Parameters
    ----------
    lower
        Matrices L, shape (..., q, q).
    right
        Right-hand sides x, shape (..., q).
    """
    lower, solved = _move_stack_last(lower, right, 1)
    return np.moveaxis(solve_columns(np.swapaxes(lower, 0, 1), solved), 0, -1)


def solve_columns(columns: Array, right: Array) -> Array:
    """Return L⁻ᵀ x, shape (q, ...), for lower triangular matrices L and right-hand sides x.

    L⁻ᵀ is the inverse of the transpose of L. The result is the same as that of `solve_upper`, but
    the indices of an array are in another order: the indices in a matrix or vector come first, and
    the indices of the matrices or vectors (shape "...") come last.

    Parameters
    ----------
    columns
        Matrices L, shape (q, q, ...); the first index is the column, the second the row.
    right
        Right-hand sides x, shape (q, ...).
    """
    solved = right.copy()
    for i in reversed(range(len(solved))):
        if i + 1 < len(solved):
            solved[i] -= np.einsum("j...,j...->...", columns[i, i + 1 :], solved[i + 1 :])
        solved[i] /= columns[i, i]
    return solved


def log_diagonal(root: Array) -> Array:
    """Return log determinants of triangular matrices with positive diagonals, shape (...).

    ``root`` holds the matrices of q rows and columns, shape (..., q, q).
    """
    return np.log(np.diagonal(root, axis1=-2, axis2=-1)).sum(axis=-1)


def _move_stack_last(
    lower: Array,
    right: Array,
    right_axes: int,
) -> tuple[Array, Array]:
    """Return matrices and right-hand sides of triangular systems with their stack dimensions last.

    ``lower`` holds a stack of matrices of q rows and columns, shape (..., q, q); they are returned
    with the shape (q, q, ...). ``right`` holds the right-hand sides, of which a copy is returned.
    If ``right_axes`` is 1, they are vectors of shape (..., q) and are returned with the shape (q,
    ...). If it is 2, they are matrices of k columns, shape (..., q, k), and are returned with the
    shape (q, k, ...).
    """
    stack = np.broadcast_shapes(lower.shape[:-2], right.shape[:-right_axes])
    stack_last = np.moveaxis(lower, (-2, -1), (0, 1))
    if stack_last.strides[-1] != stack_last.itemsize:
        # The matrices of the stack are made contiguous in memory before they are broadcast, because
        # copying the larger broadcast array would be slow.
        stack_last = np.ascontiguousarray(stack_last)
    stack_first = np.moveaxis(stack_last, (0, 1), (-2, -1))
    full_lower = np.broadcast_to(stack_first, (*stack, *lower.shape[-2:]))
    full_right = np.broadcast_to(right, (*stack, *right.shape[-right_axes:]))
    copied = np.empty((*right.shape[-right_axes:], *stack))
    copied[...] = np.moveaxis(full_right, range(-right_axes, 0), range(right_axes))
    return np.moveaxis(full_lower, (-2, -1), (0, 1)), copied
