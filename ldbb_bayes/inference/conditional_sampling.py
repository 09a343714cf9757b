"""Exact draws of the parameters β given the hyper-parameters φ, inside the truncation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.integrals import CHUNK
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.results import Array

__all__ = ["conditional_draws", "draw_parameters_given"]

# How often draws that did not fall inside the truncation are repeated.
_REPEATS = 20


def conditional_draws(
    bound: BoundModel, free: Array, rng: np.random.Generator
) -> tuple[Array, NDArray[np.bool_]]:
    """Draw β once from p(β | y, φ), inside the truncation, at free coordinates (w, h).

    Returns
    -------
    beta : ndarray, shape (w, p)
    exact : ndarray of bool, shape (w,)
        False where the rejection sampler gave up, or rounding left β outside the truncation.
    """
    beta = np.zeros((len(free), len(bound.names)))
    exact = np.ones(len(free), dtype=bool)
    nodes, node_of_row = np.unique(free, axis=0, return_inverse=True)
    node_of_row = node_of_row.ravel()
    # Where points repeat the conditional is computed once for each node.
    conditional_of_nodes = None
    if 2 * len(nodes) <= len(free):
        conditional_of_nodes = bound.given(bound.hyper_prior.phi(nodes))[1]
    for start in range(0, len(free), CHUNK):
        rows = slice(start, start + CHUNK)
        if conditional_of_nodes is not None:
            conditional = conditional_of_nodes.select(node_of_row[rows])
        else:
            conditional = bound.given(bound.hyper_prior.phi(free[rows]))[1]
        if bound.truncation.active:
            beta[rows], exact[rows] = conditional.draw_truncated(rng)
        else:
            beta[rows] = conditional.draw(rng)
    return beta, exact


def draw_parameters_given(bound: BoundModel, free: Array, rng: np.random.Generator) -> Array:
    """Draw β once at each free coordinates (w, h), shape (w, p), all inside the truncation.

    Raises
    ------
    InputError
        When rounds of exact rejection leave some undrawn: the readings leave no room inside the
        truncation.
    """
    beta = np.zeros((len(free), len(bound.names)))
    missing = np.arange(len(free))
    for _ in range(1 + _REPEATS):
        beta[missing], exact = conditional_draws(bound, free[missing], rng)
        missing = missing[~exact]
        if not missing.size:
            return beta
    raise InputError(
        "the posterior must leave room where no compliance is negative, got no draw that falls"
        " there. The readings contradict non-negative compliance: check signs, mount compensation"
        " and forces, or fit --without truncation."
    )
