"""Least squares of minimum norm."""

from __future__ import annotations

import numpy as np
import scipy.linalg

from ldbb_bayes.model.linear_algebra import minimum_norm_solution


def test_collinear_columns_share_in_proportion_to_their_squared_scales() -> None:
    jacobian = np.array([[1.0, 1.0], [2.0, 2.0], [3.0, 3.0]])
    estimate = minimum_norm_solution(
        jacobian, jacobian @ np.array([1.0, 1.0]), np.array([3.0, 1.0])
    )
    np.testing.assert_allclose(estimate, [2.0 * 9.0 / 10.0, 2.0 * 1.0 / 10.0])


def test_widely_spread_units_do_not_matter() -> None:
    jacobian = np.random.default_rng(0).normal(size=(9, 4)) * [1e6, 1.0, 1e-6, 1.0]
    truth = np.array([1e-6, 2.0, 3e6, -4.0])
    np.testing.assert_allclose(minimum_norm_solution(jacobian, jacobian @ truth), truth)
    norms = np.linalg.norm(jacobian, axis=0)
    expected = scipy.linalg.pinv(jacobian / norms) @ np.ones(9) / norms
    np.testing.assert_allclose(minimum_norm_solution(jacobian, np.ones(9)), expected)
