"""Extremes of curves with noise: against curves that are known."""

from __future__ import annotations

import numpy as np

from ldbb_bayes.analysis.extremes import extremes_of, without_noise_excess

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
    extremes = extremes_of(CURVE[None])
    assert extremes.index_of_largest.tolist() == [0]
    assert extremes.index_of_smallest.tolist() == [90]


def test_a_shift_leaves_the_spread_of_draws_as_it_is() -> None:
    values = np.array([1.0, 2.0, 6.0])
    shifted = without_noise_excess(values, 2.0)
    np.testing.assert_allclose(shifted, [0.0, 1.0, 5.0])
