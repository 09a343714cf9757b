"""Triangular algebra on stacks of small matrices."""

from __future__ import annotations

import numpy as np

from ldbb_bayes.results import Array

__all__ = ["eliminate", "log_diagonal", "solve_lower", "solve_upper"]


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


def log_diagonal(root: Array) -> Array:
    """ln det of triangular factors (..., q, q), shape (...)."""
    return np.log(np.diagonal(root, axis1=-2, axis2=-1)).sum(axis=-1)
