"""Stacked triangular algebra against SciPy, matrix by matrix."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg

from ldbb_bayes.model.triangular import factor_and_solve, solve_lower, solve_upper


@pytest.mark.parametrize("q", [1, 2, 7, 27])
def test_against_scipy(q: int) -> None:
    rng = np.random.default_rng(q)
    root = rng.normal(size=(5, 3, q, q + 2))
    matrix = root @ np.swapaxes(root, -1, -2)
    right, several = rng.normal(size=(5, 3, q)), rng.normal(size=(5, 3, q, 4))
    lower, white = factor_and_solve(matrix, right)
    upper, forward = solve_upper(lower, right), solve_lower(lower, several)
    for i in np.ndindex(5, 3):
        expected = np.linalg.cholesky(matrix[i])
        np.testing.assert_allclose(lower[i], expected, rtol=1e-9)
        np.testing.assert_allclose(white[i], scipy.linalg.solve_triangular(expected, right[i], lower=True), rtol=1e-8)
        np.testing.assert_allclose(forward[i], scipy.linalg.solve_triangular(expected, several[i], lower=True), rtol=1e-8)
        np.testing.assert_allclose(upper[i], scipy.linalg.solve_triangular(expected.T, right[i]), rtol=1e-8)


def test_an_indefinite_matrix_is_refused() -> None:
    with pytest.raises(np.linalg.LinAlgError):
        factor_and_solve(np.array([[1.0, 2.0], [2.0, 1.0]]), np.ones(2))
