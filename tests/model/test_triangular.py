"""Stacked triangular algebra against SciPy, matrix by matrix."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg

from ldbb_bayes.model.triangular import eliminate, solve_lower, solve_upper

STACK = (2, 3)


def positive_definite(rng: np.random.Generator, q: int) -> np.ndarray:
    root = rng.normal(size=(*STACK, q, q + 2))
    return root @ np.swapaxes(root, -1, -2)


@pytest.mark.parametrize("q", [1, 2, 7, 27])
def test_elimination_is_cholesky(q: int) -> None:
    rng = np.random.default_rng(q)
    matrix = positive_definite(rng, q)
    right = rng.normal(size=(*STACK, q))
    bordered = np.concatenate([matrix, right[..., None, :]], axis=-2)
    front = bordered.transpose(0, 3, 2, 1).copy()
    eliminate(front)
    lower = np.tril(front[:, :, :q].transpose(0, 3, 2, 1))
    white = front[:, :, q].transpose(0, 2, 1)
    for i in np.ndindex(*STACK):
        root = np.linalg.cholesky(matrix[i])
        np.testing.assert_allclose(lower[i], root, rtol=1e-9, atol=1e-12)
        solved = scipy.linalg.solve_triangular(root, right[i], lower=True)
        np.testing.assert_allclose(white[i], solved, rtol=1e-8)


@pytest.mark.parametrize("q", [1, 2, 7, 27])
def test_solutions(q: int) -> None:
    rng = np.random.default_rng(q)
    lower = np.linalg.cholesky(positive_definite(rng, q))
    right = rng.normal(size=(*STACK, q))
    columns = rng.normal(size=(*STACK, q, 4))
    upper_solved = solve_upper(lower, right)
    lower_solved = solve_lower(lower, columns)
    for i in np.ndindex(*STACK):
        expected = scipy.linalg.solve_triangular(lower[i], columns[i], lower=True)
        np.testing.assert_allclose(lower_solved[i], expected, rtol=1e-8)
        expected = scipy.linalg.solve_triangular(lower[i].T, right[i])
        np.testing.assert_allclose(upper_solved[i], expected, rtol=1e-8)
