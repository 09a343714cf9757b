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
