"""Pareto-smoothed importance weights, held against ArviZ and against known shapes."""

from __future__ import annotations

import numpy as np
import pytest
from arviz_stats.base import array_stats
from scipy import stats
from scipy.special import logsumexp

from ldbb_bayes.inference.diagnostics import pareto_smooth
from ldbb_bayes.inference.pareto_tail import smooth_tail


@pytest.mark.parametrize("shape", [-0.5, 0.0, 0.3, 0.7, 1.2])
@pytest.mark.parametrize("draws", [30, 130, 225, 226, 1024, 4001])
def test_weights_and_shape_are_those_of_arviz(
    shape: float, draws: int, rng: np.random.Generator
) -> None:
    ratio = stats.genpareto.rvs(shape, loc=1.0, size=draws, random_state=rng)
    log_weight = 700.0 + np.log(ratio)
    expected, expected_shape = array_stats.psislw(-log_weight)
    smoothed = smooth_tail(log_weight)
    assert smoothed.shape == pytest.approx(float(expected_shape), rel=1e-10)
    normalised = smoothed.log_weight - logsumexp(smoothed.log_weight)
    assert np.allclose(normalised, expected, rtol=1e-10)


def test_weights_of_zero_are_as_in_arviz(rng: np.random.Generator) -> None:
    log_weight = rng.standard_normal(400)
    log_weight[:300] = -np.inf
    expected = array_stats.psislw(-log_weight)[1]
    assert smooth_tail(log_weight).shape == pytest.approx(float(expected), rel=1e-10)


def test_the_shape_of_many_draws_is_that_of_their_distribution(rng: np.random.Generator) -> None:
    ratio = stats.genpareto.rvs(0.5, size=400_000, random_state=rng)
    assert smooth_tail(np.log(ratio)).shape == pytest.approx(0.5, abs=0.1)


@pytest.mark.parametrize(
    ("log_weight", "shape"),
    [
        (np.zeros(100), -np.inf),
        (np.arange(29.0), np.inf),
        (np.r_[np.zeros(60), np.ones(30), np.arange(2.0, 12.0)], np.inf),
        (np.full(100, np.nan), np.inf),
        (np.r_[np.zeros(99), np.inf], np.inf),
    ],
)
def test_a_tail_that_cannot_be_fitted_is_left_as_it_is(
    log_weight: np.ndarray, shape: float
) -> None:
    tail = smooth_tail(log_weight)
    assert tail.shape == shape
    assert np.array_equal(tail.log_weight, log_weight, equal_nan=True)


def test_few_weights_cannot_be_judged() -> None:
    assert pareto_smooth(np.arange(20.0)).pareto_k == np.inf
