"""Quantiles and moments of mixtures of Gaussians; quantiles of weighted draws."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy import optimize, stats

from ldbb_bayes.model.mixtures import mixture_moments, mixture_quantiles, weighted_quantiles


@example(seed=199, level=0.5988615144518045)
@given(seed=st.integers(0, 10**6), level=st.floats(0.001, 0.999))
def test_quantiles_of_mixtures(seed: int, level: float) -> None:
    """Against a root of the distribution function, narrow and far components too."""
    rng = np.random.default_rng(seed)
    weight = rng.dirichlet(np.ones(5))
    mean = 3.0 * rng.standard_normal((5, 2))
    sd = np.exp(2.0 * rng.standard_normal((5, 2)))
    quantiles = mixture_quantiles(weight, mean, sd, [level])[0]
    _, mixture_sd = mixture_moments(weight, mean, sd)
    for j in range(2):

        def excess(x: float, j: int = j) -> float:
            return float(weight @ stats.norm.cdf(x, mean[:, j], sd[:, j])) - level

        expected = optimize.brentq(excess, -1e4, 1e4, xtol=1e-12)
        assert quantiles[j] == pytest.approx(expected, abs=1e-7 * mixture_sd[j])


def test_weights_may_differ_between_mixtures() -> None:
    rng = np.random.default_rng(1)
    weight = rng.dirichlet(np.ones(5))
    mean = 3.0 * rng.standard_normal((5, 2))
    sd = np.exp(2.0 * rng.standard_normal((5, 2)))
    weights = np.column_stack([weight, weight])
    np.testing.assert_allclose(
        mixture_quantiles(weights, mean, sd, [0.3]), mixture_quantiles(weight, mean, sd, [0.3])
    )


def test_moments_of_mixtures() -> None:
    weight = np.array([0.25, 0.75])
    mean, sd = mixture_moments(weight, np.array([[0.0], [2.0]]), np.array([[1.0], [3.0]]))
    assert mean[0] == pytest.approx(1.5)
    assert sd[0] ** 2 == pytest.approx(0.25 * 1.0 + 0.75 * 9.0 + 0.25 * 0.75 * 4.0)


def test_quantiles_of_equally_weighted_draws() -> None:
    draws = np.arange(100.0)[:, None]
    quantiles = weighted_quantiles(np.full(100, 0.01), draws, [0.005, 0.5, 0.995])
    np.testing.assert_allclose(quantiles[:, 0], [0.0, 49.5, 99.0])


def test_quantiles_are_linear_between_draws() -> None:
    weight = np.array([0.5, 0.5])
    quantiles = weighted_quantiles(weight, np.array([[3.0], [1.0]]), [0.25, 0.5, 0.75])
    np.testing.assert_allclose(quantiles[:, 0], [1.0, 2.0, 3.0])
