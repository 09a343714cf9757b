"""Normal scores of hyper-parameters against SciPy's distributions and numerical derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from ldbb_bayes.inference.importance_sampling import importance_sample
from ldbb_bayes.inference.normal_scores import NormalScores
from ldbb_bayes.model.hyper_prior import HyperPrior

PRIOR = HyperPrior(
    names=("sigma", "delta", "decay", "lambda_f036"),
    scale=np.array([1e-3, 2e-3, 2.0, 1.0]),
    lower=np.array([7e-5, 0.0, 0.0, 0.0]),
    laws=("half-normal", "half-normal", "decay", "circle"),
    decay_sd=0.7,
)
SCORES = NormalScores(PRIOR)
POINTS = np.random.default_rng(0).normal(size=(200, 4))


def test_a_score_is_the_normal_quantile_of_the_prior_probability() -> None:
    phi = PRIOR.phi(SCORES.free(POINTS))
    sigma = stats.truncnorm(0.07, np.inf, scale=1e-3)
    decay = stats.truncnorm(-1.5 / 0.7, 1.5 / 0.7, loc=2.0, scale=0.7)
    np.testing.assert_allclose(sigma.cdf(phi[:, 0]), stats.norm.cdf(POINTS[:, 0]), rtol=1e-9)
    np.testing.assert_allclose(
        stats.halfnorm(scale=2e-3).cdf(phi[:, 1]), stats.norm.cdf(POINTS[:, 1]), rtol=1e-9
    )
    np.testing.assert_allclose(decay.cdf(phi[:, 2]), stats.norm.cdf(POINTS[:, 2]), rtol=1e-9)


def test_a_noise_factor_keeps_its_logarithm() -> None:
    np.testing.assert_array_equal(SCORES.free(POINTS)[:, 3], POINTS[:, 3])


def test_scores_of_free_coordinates_are_the_inverse() -> None:
    np.testing.assert_allclose(SCORES.scores(SCORES.free(POINTS)), POINTS, atol=1e-7)


@pytest.mark.parametrize("distance", [6.0, 7.0, 9.0, 15.0])
def test_scores_next_to_a_bound_are_the_inverse_too(distance: float) -> None:
    """There a value differs from its bound by less than rounding, and its distance does not."""
    points = np.array([[-distance] * 3 + [0.0], [distance] * 3 + [0.0]])
    np.testing.assert_allclose(SCORES.scores(SCORES.free(points)), points, rtol=1e-6, atol=1e-12)


def test_the_distance_from_a_bound_is_the_probability_over_the_density() -> None:
    score = -12.0
    log_probability = stats.norm.logcdf(score)
    free = SCORES.free(np.full((1, 4), score))[0]
    sigma = stats.truncnorm(0.07, np.inf, scale=1e-3)
    decay = stats.truncnorm(-1.5 / 0.7, 1.5 / 0.7, loc=2.0, scale=0.7)
    assert free[0] == pytest.approx(log_probability - sigma.logpdf(7.0000001e-5), rel=1e-7)
    log_width = np.log(3.0)
    assert free[2] == pytest.approx(log_probability - decay.logpdf(0.5000001) - log_width, rel=1e-7)


@pytest.mark.parametrize("distance", [8.0, 20.0])
def test_scores_far_from_zero_are_finite(distance: float) -> None:
    both = np.array([[-distance] * 4, [distance] * 3 + [1.0]])
    assert np.isfinite(SCORES.free(both)[:, :2]).all()
    assert np.isfinite(SCORES.log_jacobian(both[:, [0, 1, 2, 3]])).all()


def test_the_jacobian_is_the_numerical_derivative() -> None:
    step = 1e-6
    log_slope = np.zeros(len(POINTS))
    for axis in range(4):
        change = step * np.eye(4)[axis]
        difference = SCORES.free(POINTS + change) - SCORES.free(POINTS - change)
        log_slope += np.log(difference[:, axis] / (2.0 * step))
    np.testing.assert_allclose(SCORES.log_jacobian(POINTS), log_slope, atol=1e-6)


def test_an_integral_of_the_prior_is_one_in_both_coordinates() -> None:
    def log_density(scores: np.ndarray) -> np.ndarray:
        return PRIOR.log_density_of_free(SCORES.free(scores)) + SCORES.log_jacobian(scores)

    of_scores = importance_sample(log_density, [(np.zeros(4), np.eye(4))], tolerance=1e-2)
    of_free = SCORES.to_free(of_scores)
    assert of_scores.log_integral == pytest.approx(0.0, abs=3.0 * of_scores.error)
    assert of_free.log_integral == pytest.approx(of_scores.log_integral, abs=1e-9)
    np.testing.assert_allclose(
        of_free.log_density, PRIOR.log_density_of_free(of_free.free), atol=1e-8
    )
    log_difference = of_free.log_proposal(of_free.free) + np.log(len(of_free.free))
    assert np.abs(log_difference + of_free.log_volume).max() < 1e-5


def test_the_log_prior_of_scores_is_that_of_free_coordinates_times_the_jacobian() -> None:
    expected = PRIOR.log_density_of_free(SCORES.free(POINTS)) + SCORES.log_jacobian(POINTS)
    np.testing.assert_allclose(SCORES.log_prior(POINTS), expected, atol=1e-9)


def test_nodes_come_back_from_free_coordinates() -> None:
    def log_density(scores: np.ndarray) -> np.ndarray:
        return -0.5 * (scores**2).sum(axis=1)

    sample = importance_sample(log_density, [(np.zeros(4), np.eye(4))], tolerance=0.1)
    back = SCORES.from_free(SCORES.to_free(sample))
    np.testing.assert_allclose(back.free, sample.free, atol=1e-6)
    np.testing.assert_allclose(back.log_density, sample.log_density, atol=1e-6)
    np.testing.assert_allclose(back.log_volume, sample.log_volume, atol=1e-6)
    assert back.proposal is sample.proposal
