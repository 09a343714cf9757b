"""Extremes of curves with noise: against curves that are known."""

from __future__ import annotations

import numpy as np
import pytest

from ldbb_bayes.analysis.extremes import extremes_of, extremes_on_circle, without_noise_excess
from ldbb_bayes.model.fourier import MAX_ORDER, ORDERS, SIZE, basis, coefficients

ANGLE = np.deg2rad(np.arange(360))
CURVE = 3.0 * np.cos(2.0 * ANGLE)


def noisy_curves(size: float, draws: int = 4000) -> np.ndarray:
    """Draws about the curve whose mean is the curve exactly."""
    rng = np.random.default_rng(1)
    amplitudes = rng.normal(0.0, size, (4, draws))
    orders = np.stack([np.cos(2 * ANGLE), np.sin(2 * ANGLE), np.cos(3 * ANGLE), np.sin(3 * ANGLE)])
    noise = amplitudes.T @ orders
    return CURVE + noise - noise.mean(axis=0)


def test_noise_makes_the_largest_value_of_draws_too_large() -> None:
    assert noisy_curves(1.0).max(axis=1).mean() > 3.5


def test_the_mean_of_the_extremes_is_that_of_the_mean_curve() -> None:
    extremes = extremes_of(noisy_curves(1.0))
    np.testing.assert_allclose(extremes.largest.mean(), 3.0)
    np.testing.assert_allclose(extremes.smallest.mean(), -3.0)


def test_without_noise_the_extremes_are_those_of_the_curve() -> None:
    extremes = extremes_of(np.tile(CURVE, (5, 1)))
    np.testing.assert_allclose(extremes.largest, 3.0)
    np.testing.assert_allclose(extremes.width, 6.0)


def test_the_width_of_a_curve_that_may_be_flat_is_not_negative() -> None:
    curves = noisy_curves(1.0) - CURVE
    assert extremes_of(curves).width.min() == 0.0


def test_extremes_are_at_the_angles_of_the_curve() -> None:
    extremes = extremes_on_circle(coefficients(lambda angle: 3.0 * np.cos(2.0 * angle)[:, None]).T)
    np.testing.assert_allclose(extremes.angle_of_largest_rad, 0.0, atol=1e-12)
    np.testing.assert_allclose(extremes.angle_of_smallest_rad, 0.5 * np.pi)


@pytest.mark.slow
def test_extremes_between_whole_degrees_are_those_of_a_dense_search() -> None:
    """Curves of all orders, at every 0.001° about their best whole degree."""
    rng = np.random.default_rng(7)
    curves = rng.normal(0.0, 1.0 / (1.0 + ORDERS), (20, SIZE))
    curves -= curves.mean(axis=0)
    extremes = extremes_on_circle(curves)
    dense_deg = np.arange(-1.0, 361.0, 0.001)
    angles_rad = np.deg2rad(dense_deg)
    for draw, curve in enumerate(curves):
        values = np.full(len(dense_deg), curve[0])
        for n in range(1, MAX_ORDER + 1):
            values += curve[2 * n - 1] * np.cos(n * angles_rad)
            values += curve[2 * n] * np.sin(n * angles_rad)
        found_rad = np.array([extremes.angle_of_largest_rad[draw]])
        off_deg = np.degrees(found_rad[0]) - dense_deg[values.argmax()]
        assert abs((off_deg + 180.0) % 360.0 - 180.0) < 0.00051
        np.testing.assert_allclose((basis(found_rad) @ curve)[0], values.max(), rtol=1e-8)
        found_deg = np.degrees(extremes.angle_of_smallest_rad[draw])
        off_deg = found_deg - dense_deg[values.argmin()]
        assert abs((off_deg + 180.0) % 360.0 - 180.0) < 0.00051


def test_a_flat_curve_has_an_angle_too() -> None:
    extremes = extremes_on_circle(np.eye(1, SIZE))
    assert np.isfinite(extremes.angle_of_largest_rad).all()
    np.testing.assert_allclose(extremes.width, 0.0, atol=1e-15)


def test_a_shift_leaves_the_spread_of_draws_as_it_is() -> None:
    values = np.array([1.0, 2.0, 6.0])
    shifted = without_noise_excess(values, 2.0)
    np.testing.assert_allclose(shifted, [0.0, 1.0, 5.0])
