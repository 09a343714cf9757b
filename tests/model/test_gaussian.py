"""The dense linear Gaussian model: Bayes' identity for every shape, closed forms, singular and nearly singular designs."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from ldbb_bayes.errors import InputError
from ldbb_bayes.model.gaussian import Gaussian, LinearGaussian, least_squares


def problem(n: int, p: int, seed: int, *, full: bool) -> tuple[LinearGaussian, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    jacobian, mean = rng.normal(size=(n, p)), rng.normal(size=p)
    noise = np.exp(rng.normal(size=n))
    prior = np.exp(rng.normal(size=p))
    if full:
        noise = np.cov(rng.normal(size=(n, 3 * n + 2))) if n > 1 else noise[:, None]
        prior = np.cov(rng.normal(size=(p, 3 * p + 2))) if p > 1 else prior[:, None]
    return LinearGaussian(jacobian, noise, mean, prior), rng.normal(size=n), rng.normal(size=p)


@given(n=st.integers(1, 9), p=st.integers(1, 6), seed=st.integers(0, 10**6), full=st.booleans())
def test_bayes_identity(n: int, p: int, seed: int, full: bool) -> None:
    """ln p(y | β) + ln p(β) = ln p(y) + ln p(β | y) at any β."""
    model, y, beta = problem(n, p, seed, full=full)
    left = model.likelihood(beta).log_density(y) + model.prior.log_density(beta)
    right = model.evidence.log_density(y) + model.posterior(y).log_density(beta)
    assert left == pytest.approx(right, rel=1e-8, abs=1e-7)


def test_against_scipy_and_textbook() -> None:
    model, y, beta = problem(7, 3, 5, full=True)
    covariance = model.jacobian @ model.prior_covariance @ model.jacobian.T + model.noise
    expected = stats.multivariate_normal(model.jacobian @ model.prior_mean, covariance).logpdf(y)
    assert model.evidence.log_density(y) == pytest.approx(expected, abs=1e-9)
    gain = model.prior_covariance @ model.jacobian.T @ np.linalg.inv(covariance)
    posterior = model.posterior(y)
    np.testing.assert_allclose(posterior.mean, model.prior_mean + gain @ (y - model.jacobian @ model.prior_mean), atol=1e-9)
    np.testing.assert_allclose(
        posterior.covariance, model.prior_covariance - gain @ model.jacobian @ model.prior_covariance, atol=1e-9
    )
    np.testing.assert_allclose(posterior.sd**2, np.diag(posterior.covariance))
    assert posterior.log_density(beta) == pytest.approx(
        stats.multivariate_normal(posterior.mean, posterior.covariance).logpdf(beta), abs=1e-8
    )


def test_information_gain_of_the_unit_line() -> None:
    """y = a + b x at x = −1, 1 with unit noise and unit prior: expected gain ln 3, so at the prior-predictive mean ln 3 − 2/3."""
    model = LinearGaussian(np.array([[1.0, -1.0], [1.0, 1.0]]), np.ones(2), np.zeros(2), np.ones(2))
    assert model.information_gain(np.zeros(2)) == pytest.approx(np.log(3.0) - 2.0 / 3.0, abs=1e-12)


def test_divergence_of_one_dimensional_gaussians() -> None:
    narrow, wide = Gaussian(np.array([1.0]), np.array([[0.5]])), Gaussian(np.array([0.0]), np.array([[2.0]]))
    expected = np.log(2.0 / 0.5) + (0.25 + 1.0) / (2 * 4.0) - 0.5
    assert narrow.kl_from(wide) == pytest.approx(expected)
    assert narrow.kl_from(narrow) == pytest.approx(0.0, abs=1e-14)


def test_draws_have_the_moments(rng: np.random.Generator) -> None:
    posterior = problem(6, 3, 2, full=True)[0].posterior(np.ones(6))
    draws = posterior.draw(200_000, rng)
    np.testing.assert_allclose(draws.mean(axis=0), posterior.mean, atol=5 * posterior.sd.max() / np.sqrt(200_000))
    np.testing.assert_allclose(np.cov(draws.T), posterior.covariance, atol=0.02 * posterior.sd.max() ** 2)


@pytest.mark.parametrize("gap", [0.0, 1e-3, 1e-8])
def test_collinear_columns(gap: float) -> None:
    """Two nearly equal columns: the sum is known, the difference keeps its prior."""
    base = np.linspace(1.0, 2.0, 20)
    jacobian = np.column_stack([base, base * (1.0 + gap)])
    model = LinearGaussian(jacobian, np.full(20, 1e-6), np.zeros(2), np.ones(2))
    posterior = model.posterior(jacobian @ np.array([1.0, 2.0]))
    assert posterior.mean.sum() == pytest.approx(3.0, abs=2e-2)
    difference = np.array([1.0, -1.0]) @ posterior.covariance @ np.array([1.0, -1.0])
    assert difference == pytest.approx(2.0, rel=0.6 if gap == 1e-3 else 1e-3)
    assert np.all(np.isfinite(posterior.root))


def test_least_squares_is_minimum_norm_in_the_scale() -> None:
    jacobian = np.array([[1.0, 1.0], [2.0, 2.0], [3.0, 3.0]])
    estimate = least_squares(jacobian, jacobian @ np.array([1.0, 1.0]), np.array([3.0, 1.0]))
    np.testing.assert_allclose(estimate, [2.0 * 9.0 / 10.0, 2.0 * 1.0 / 10.0])
    full = np.random.default_rng(0).normal(size=(9, 4)) * [1e6, 1.0, 1e-6, 1.0]
    truth = np.array([1e-6, 2.0, 3e6, -4.0])
    np.testing.assert_allclose(least_squares(full, full @ truth), truth)
    norms = np.linalg.norm(full, axis=0)
    np.testing.assert_allclose(least_squares(full, np.ones(9)), scipy.linalg.pinv(full / norms) @ np.ones(9) / norms)


@pytest.mark.parametrize(
    ("noise", "prior", "message"),
    [
        (np.array([1.0, -1.0]), np.ones(1), "noise must have positive variances"),
        (np.array([[1.0, 2.0], [2.0, 1.0]]), np.ones(1), "noise must be positive definite"),
        (np.ones(3), np.ones(1), r"noise must have shape \(2,\) or \(2, 2\), got \(3,\)"),
        (np.ones(2), np.zeros(1), "prior_covariance must have positive"),
    ],
)
def test_refused(noise: np.ndarray, prior: np.ndarray, message: str) -> None:
    with pytest.raises(InputError, match=message):
        LinearGaussian(np.ones((2, 1)), noise, np.zeros(1), prior).posterior(np.zeros(2))
