"""The Gaussian kernel: Bayes' identity, SciPy, closed forms, collinear designs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from campaigns import refuses
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from ldbb_bayes.model.gaussian import Gaussian


class Regression(NamedTuple):
    """A prior, whitened rows and their values."""

    prior: Gaussian
    rows: np.ndarray
    y: np.ndarray


def regression(n: int, p: int, seed: int, *, full: bool, batch: tuple[int, ...] = ()) -> Regression:
    """Random numbers; a prior of full covariance, or of independent variances."""
    rng = np.random.default_rng(seed)
    covariance = np.exp(rng.normal(size=(*batch, p)))
    if full:
        root = rng.normal(size=(*batch, p, p + 2))
        covariance = root @ np.swapaxes(root, -1, -2)
    prior = Gaussian.of(rng.normal(size=(*batch, p)), covariance)
    rows = rng.normal(size=(*batch, n, p))
    return Regression(prior, rows, rng.normal(size=(*batch, n)))


sizes = st.integers(0, 9)
parameters = st.integers(1, 6)
seeds = st.integers(0, 10**6)


@given(n=sizes, p=parameters, seed=seeds, full=st.booleans())
def test_bayes_identity(n: int, p: int, seed: int, full: bool) -> None:
    """ln p(y | x) + ln p(x) = ln p(y) + ln p(x | y) at any x."""
    prior, rows, y = regression(n, p, seed, full=full, batch=(2,))
    x = np.random.default_rng(seed).normal(size=(2, p))
    posterior = prior.observe(rows, y)
    log_likelihood = stats.norm.logpdf(y - np.einsum("bnp,bp->bn", rows, x)).sum(axis=-1)
    log_joint = log_likelihood + prior.log_density(x)
    log_evidence = posterior.log_integral
    np.testing.assert_allclose(
        log_joint, log_evidence + posterior.log_density(x), rtol=1e-8, atol=1e-7
    )


@given(n=sizes, p=parameters, seed=seeds, full=st.booleans())
def test_sums_of_information(n: int, p: int, seed: int, full: bool) -> None:
    prior, rows, y = regression(n, p, seed, full=full, batch=(2,))
    posterior = prior.observe(rows, y)
    transposed = np.swapaxes(rows, -1, -2)
    log_constant = -0.5 * ((y**2).sum(axis=-1) + n * np.log(2 * np.pi))
    shift = (transposed @ y[..., None])[..., 0]
    summed = prior + Gaussian(transposed @ rows, shift, log_constant)
    np.testing.assert_allclose(summed.log_integral, posterior.log_integral, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(summed.mean, posterior.mean, rtol=1e-5, atol=1e-6)


@given(n=sizes, p=parameters, seed=seeds, full=st.booleans())
def test_members_of_a_stack_are_independent(n: int, p: int, seed: int, full: bool) -> None:
    prior, rows, y = regression(n, p, seed, full=full, batch=(2,))
    posterior = prior.observe(rows, y)
    single_prior = Gaussian.factored(prior.mean[1], prior.root[1], prior.scale[1])
    single = single_prior.observe(rows[1], y[1])
    np.testing.assert_allclose(single.covariance, posterior.covariance[1], rtol=1e-9)
    assert single.log_integral == pytest.approx(posterior.log_integral[1])


def test_against_scipy() -> None:
    prior, rows, y = regression(7, 3, 5, full=True)
    covariance = rows @ prior.covariance @ rows.T + np.eye(7)
    posterior = prior.observe(rows, y)
    predicted = stats.multivariate_normal(rows @ prior.mean, covariance)
    assert posterior.log_integral == pytest.approx(predicted.logpdf(y), abs=1e-9)
    gain = prior.covariance @ rows.T @ np.linalg.inv(covariance)
    expected_mean = prior.mean + gain @ (y - rows @ prior.mean)
    np.testing.assert_allclose(posterior.mean, expected_mean, atol=1e-9)
    expected_covariance = prior.covariance - gain @ rows @ prior.covariance
    np.testing.assert_allclose(posterior.covariance, expected_covariance, atol=1e-9)
    np.testing.assert_allclose(posterior.sd**2, np.diag(posterior.covariance))
    np.testing.assert_allclose(posterior.precision, np.linalg.inv(posterior.covariance), rtol=1e-9)
    beta = np.array([0.3, -1.0, 2.0])
    expected = stats.multivariate_normal(posterior.mean, posterior.covariance).logpdf(beta)
    assert posterior.log_density(beta) == pytest.approx(expected, abs=1e-8)
    np.testing.assert_allclose(posterior.from_standard(posterior.standardize(beta)), beta)


def test_marginals() -> None:
    prior, rows, y = regression(7, 4, 3, full=True, batch=(3,))
    joint = prior.observe(rows, y)
    keep = [3, 1]
    marginal = joint.marginal(keep)
    np.testing.assert_allclose(marginal.mean, joint.mean[:, keep])
    expected = joint.covariance[:, [[3], [1]], keep]
    np.testing.assert_allclose(marginal.covariance, expected, rtol=1e-9)
    np.testing.assert_allclose(marginal.log_integral, joint.log_integral)


def test_draws_have_the_moments(rng: np.random.Generator) -> None:
    prior, rows, y = regression(6, 3, 2, full=True)
    posterior = prior.observe(rows, y)
    draws = posterior.draw(rng, (50_000,))
    largest_sd = posterior.sd.max()
    tolerance = 5 * largest_sd / np.sqrt(50_000)
    np.testing.assert_allclose(draws.mean(axis=0), posterior.mean, atol=tolerance)
    np.testing.assert_allclose(np.cov(draws.T), posterior.covariance, atol=0.03 * largest_sd**2)


@pytest.mark.parametrize(("gap", "tolerance"), [(0.0, 1e-3), (1e-3, 0.6), (1e-8, 1e-3)])
def test_collinear_columns(gap: float, tolerance: float) -> None:
    """Two nearly equal columns: the sum is known, the difference keeps its prior."""
    base = np.linspace(1.0, 2.0, 20) * 1e3
    rows = np.column_stack([base, base * (1.0 + gap)])
    prior = Gaussian.of(np.zeros(2), np.ones(2))
    posterior = prior.observe(rows, rows @ np.array([1.0, 2.0]))
    assert posterior.mean.sum() == pytest.approx(3.0, abs=2e-2)
    difference_variance = (posterior.spread(np.array([[1.0, -1.0]])) ** 2).sum()
    assert difference_variance == pytest.approx(2.0, rel=tolerance)
    assert np.all(np.isfinite(posterior.root))


INDEFINITE = np.array([[1.0, 2.0], [2.0, 1.0]])


def test_moments_of_an_indefinite_precision_are_refused() -> None:
    with pytest.raises(np.linalg.LinAlgError):
        _ = Gaussian(INDEFINITE, np.ones(2)).mean


def test_variances_must_be_positive() -> None:
    message = r"variances must be positive, got -1\.0"
    refuses(message, Gaussian.of, np.zeros(2), np.array([1.0, -1.0]))


def test_covariances_must_be_positive_definite() -> None:
    refuses("covariance must be positive definite", Gaussian.of, np.zeros(2), INDEFINITE)


@pytest.mark.parametrize("rows", [np.ones((3, 2)), np.ones((1, 2)), np.array([[1.0, 0.0]] * 3)])
def test_rows_must_determine_every_coefficient(rows: np.ndarray) -> None:
    message = "rows must determine every coefficient"
    refuses(message, Gaussian.from_rows, rows, np.zeros(len(rows)))
