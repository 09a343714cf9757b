"""Newton's method and central differences on ln p = −(x² − 1)² − 2 (y − x)²."""

from __future__ import annotations

import numpy as np

from ldbb_bayes.model.newton import central_differences, newton


def log_density(points: np.ndarray) -> np.ndarray:
    x, y = points.T
    return -((x**2 - 1.0) ** 2) - 2.0 * (y - x) ** 2


def derivatives(point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return central_differences(log_density, point, 1e-4)


def test_central_differences() -> None:
    x = 0.3
    y = -0.4
    gradient, hessian = derivatives(np.array([x, y]))
    expected = [-4 * x * (x**2 - 1) + 4 * (y - x), -4 * (y - x)]
    np.testing.assert_allclose(gradient, expected, atol=1e-6)
    np.testing.assert_allclose(hessian, [[-12 * x**2 + 4 - 4, 4], [4, -4]], atol=1e-4)


def test_the_mode_is_reached_through_wrong_curvature() -> None:
    """At the start the curvature in x has the wrong sign."""
    mode = newton(log_density, derivatives, np.array([0.1, -2.0]), gain=1e-12)
    np.testing.assert_allclose(mode, np.sign(mode), atol=1e-4)


def test_mixed_derivatives_of_pairs_that_are_not_coupled_are_zero() -> None:
    coupled = np.eye(2, dtype=bool)
    _, hessian = central_differences(log_density, np.array([0.3, -0.4]), 1e-4, coupled=coupled)
    np.testing.assert_allclose(hessian, np.diag([-12 * 0.3**2, -4.0]), atol=1e-4)


def test_a_search_stops_where_it_may() -> None:
    stopped = newton(log_density, derivatives, np.array([0.1, -2.0]), stop=lambda _: True)
    mode = newton(log_density, derivatives, np.array([0.1, -2.0]))
    assert log_density(stopped[None])[0] > log_density(np.array([[0.1, -2.0]]))[0]
    assert np.linalg.norm(stopped - mode) > 0.1
