"""Coordinates whose mean and width depend on others: inverse, volume, and what is found."""

from __future__ import annotations

import numpy as np
import pytest

from ldbb_bayes.inference.coordinate_dependence import fit_dependence

Array = np.ndarray
N = 20_000
H = 4
EVEN = np.full(N, 1.0 / N)


def standardised(u: Array) -> Array:
    """Return coordinates that have the mean zero, the variance one and no correlation."""
    centred = u - u.mean(axis=0)
    root = np.linalg.cholesky(np.cov(centred.T, bias=True))
    return np.linalg.solve(root, centred.T).T


def funnel() -> Array:
    """The first coordinate is twice the log width of the others."""
    z = np.random.default_rng(1).normal(size=(N, H))
    z[:, 1:] *= np.exp(0.3 * z[:, :1])
    return standardised(z)


def banana() -> Array:
    """The mean of the last coordinate falls with the square of the second."""
    z = np.random.default_rng(2).normal(size=(N, H))
    z[:, 3] -= 0.4 * z[:, 1] ** 2
    return standardised(z)


def test_normal_coordinates_depend_on_nothing() -> None:
    u = standardised(np.random.default_rng(0).normal(size=(N, H)))
    dependence = fit_dependence(u, EVEN)
    assert np.count_nonzero(dependence.mean) + np.count_nonzero(dependence.log_width) <= 3
    np.testing.assert_allclose(dependence.remove(u).points, u, atol=0.1)


@pytest.mark.parametrize("u", [funnel(), banana()])
def test_restoring_is_the_inverse_of_removing(u: Array) -> None:
    dependence = fit_dependence(u, EVEN)
    np.testing.assert_allclose(dependence.restore(dependence.remove(u).points), u, atol=1e-12)


def test_the_log_width_is_that_of_the_numerical_derivative() -> None:
    dependence = fit_dependence(funnel(), EVEN)
    point = np.array([[0.3, -0.8, 0.5, 1.2]])
    step = 1e-6
    change = step * np.eye(H)
    above = dependence.remove(point + change).points
    below = dependence.remove(point - change).points
    log_det = np.linalg.slogdet((above - below) / (2.0 * step))[1]
    assert dependence.remove(point).log_width[0] == pytest.approx(-log_det, abs=1e-8)


def test_the_width_of_a_funnel_is_found() -> None:
    u = funnel()
    z = fit_dependence(u, EVEN).remove(u).points
    correlation = np.corrcoef(u[:, 0], u[:, 2] ** 2)[0, 1]
    correlation_removed = np.corrcoef(u[:, 0], z[:, 2] ** 2)[0, 1]
    assert correlation > 0.3
    assert abs(correlation_removed) < 0.03


def test_the_bend_of_a_banana_is_found() -> None:
    u = banana()
    z = fit_dependence(u, EVEN).remove(u).points
    correlation = np.corrcoef(u[:, 1] ** 2, u[:, 3])[0, 1]
    correlation_removed = np.corrcoef(u[:, 1] ** 2, z[:, 3])[0, 1]
    assert correlation < -0.3
    assert abs(correlation_removed) < 0.03


def test_a_single_coordinate_depends_on_nothing() -> None:
    u = standardised(np.random.default_rng(0).normal(size=(N, 2)))[:, :1]
    dependence = fit_dependence(u, EVEN)
    np.testing.assert_allclose(dependence.restore(dependence.remove(u).points), u, atol=1e-12)
