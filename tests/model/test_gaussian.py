"""The Gaussian kernel: Bayes' identity, SciPy, closed forms, singular and nearly singular designs;
mixtures; Newton; Holm."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg
from campaigns import refuses
from hypothesis import example, given
from hypothesis import strategies as st
from scipy import optimize, stats

from ldbb_bayes.analysis.multiple_testing import holm
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.linear_algebra import minimum_norm_solution
from ldbb_bayes.model.mixtures import mixture_moments, mixture_quantiles, weighted_quantiles
from ldbb_bayes.model.newton import central_differences, newton
from ldbb_bayes.model.triangular import eliminate, solve_lower, solve_upper


def problem(
    n: int, p: int, seed: int, *, full: bool, batch: tuple[int, ...] = ()
) -> tuple[Gaussian, np.ndarray, np.ndarray]:
    """A prior, white rows and their values."""
    rng = np.random.default_rng(seed)
    covariance = np.exp(rng.normal(size=(*batch, p)))
    if full:
        root = rng.normal(size=(*batch, p, p + 2))
        covariance = root @ np.swapaxes(root, -1, -2)
    return (
        Gaussian.of(rng.normal(size=(*batch, p)), covariance),
        rng.normal(size=(*batch, n, p)),
        rng.normal(size=(*batch, n)),
    )


@given(n=st.integers(0, 9), p=st.integers(1, 6), seed=st.integers(0, 10**6), full=st.booleans())
def test_bayes_identity(n: int, p: int, seed: int, full: bool) -> None:
    """ln p(y | x) + ln p(x) = ln p(y) + ln p(x | y) at any x; by rows and by information; for a
    stack and one by one."""
    prior, rows, values = problem(n, p, seed, full=full, batch=(2,))
    x = np.random.default_rng(seed).normal(size=(2, p))
    posterior = prior.observe(rows, values)
    likelihood = stats.norm.logpdf(values - np.einsum("bnp,bp->bn", rows, x)).sum(axis=-1)
    left = likelihood + prior.log_density(x)
    right = posterior.log_integral + posterior.log_density(x)
    np.testing.assert_allclose(left, right, rtol=1e-8, atol=1e-7)
    transposed = np.swapaxes(rows, -1, -2)
    constant = -0.5 * ((values**2).sum(axis=-1) + n * np.log(2 * np.pi))
    summed = prior + Gaussian(transposed @ rows, (transposed @ values[..., None])[..., 0], constant)
    np.testing.assert_allclose(summed.log_integral, posterior.log_integral, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(summed.mean, posterior.mean, rtol=1e-5, atol=1e-6)
    alone = Gaussian.factored(prior.mean[1], prior.root[1], prior.scale[1]).observe(
        rows[1], values[1]
    )
    np.testing.assert_allclose(alone.covariance, posterior.covariance[1], rtol=1e-9)
    assert alone.log_integral == pytest.approx(posterior.log_integral[1])


def test_against_scipy() -> None:
    prior, rows, y = problem(7, 3, 5, full=True)
    covariance = rows @ prior.covariance @ rows.T + np.eye(7)
    posterior = prior.observe(rows, y)
    assert posterior.log_integral == pytest.approx(
        stats.multivariate_normal(rows @ prior.mean, covariance).logpdf(y), abs=1e-9
    )
    gain = prior.covariance @ rows.T @ np.linalg.inv(covariance)
    np.testing.assert_allclose(
        posterior.mean, prior.mean + gain @ (y - rows @ prior.mean), atol=1e-9
    )
    np.testing.assert_allclose(
        posterior.covariance, prior.covariance - gain @ rows @ prior.covariance, atol=1e-9
    )
    np.testing.assert_allclose(posterior.sd**2, np.diag(posterior.covariance))
    np.testing.assert_allclose(posterior.precision, np.linalg.inv(posterior.covariance), rtol=1e-9)
    beta = np.array([0.3, -1.0, 2.0])
    expected = stats.multivariate_normal(posterior.mean, posterior.covariance).logpdf(beta)
    assert posterior.log_density(beta) == pytest.approx(expected, abs=1e-8)
    np.testing.assert_allclose(posterior.from_standard(posterior.standardize(beta)), beta)


def test_marginals() -> None:
    prior, rows, y = problem(7, 4, 3, full=True, batch=(3,))
    joint = prior.observe(rows, y)
    keep = [3, 1]
    marginal = joint.marginal(keep)
    np.testing.assert_allclose(marginal.mean, joint.mean[:, keep])
    np.testing.assert_allclose(
        marginal.covariance, joint.covariance[:, [[3], [1]], keep], rtol=1e-9
    )
    np.testing.assert_allclose(marginal.log_integral, joint.log_integral)


def test_draws_have_the_moments(rng: np.random.Generator) -> None:
    prior, rows, y = problem(6, 3, 2, full=True)
    posterior = prior.observe(rows, y)
    draws = posterior.draw(rng, (50_000,))
    np.testing.assert_allclose(
        draws.mean(axis=0), posterior.mean, atol=5 * posterior.sd.max() / np.sqrt(50_000)
    )
    np.testing.assert_allclose(
        np.cov(draws.T), posterior.covariance, atol=0.03 * posterior.sd.max() ** 2
    )


@pytest.mark.parametrize("gap", [0.0, 1e-3, 1e-8])
def test_collinear_columns(gap: float) -> None:
    """Two nearly equal columns: the sum is known, the difference keeps its prior."""
    base = np.linspace(1.0, 2.0, 20) * 1e3
    rows = np.column_stack([base, base * (1.0 + gap)])
    posterior = Gaussian.of(np.zeros(2), np.ones(2)).observe(rows, rows @ np.array([1.0, 2.0]))
    assert posterior.mean.sum() == pytest.approx(3.0, abs=2e-2)
    assert (posterior.spread(np.array([[1.0, -1.0]])) ** 2).sum() == pytest.approx(
        2.0, rel=0.6 if gap == 1e-3 else 1e-3
    )
    assert np.all(np.isfinite(posterior.root))


def test_least_squares_is_minimum_norm_in_the_scale() -> None:
    jacobian = np.array([[1.0, 1.0], [2.0, 2.0], [3.0, 3.0]])
    estimate = minimum_norm_solution(
        jacobian, jacobian @ np.array([1.0, 1.0]), np.array([3.0, 1.0])
    )
    np.testing.assert_allclose(estimate, [2.0 * 9.0 / 10.0, 2.0 * 1.0 / 10.0])
    full = np.random.default_rng(0).normal(size=(9, 4)) * [1e6, 1.0, 1e-6, 1.0]
    truth = np.array([1e-6, 2.0, 3e6, -4.0])
    np.testing.assert_allclose(minimum_norm_solution(full, full @ truth), truth)
    norms = np.linalg.norm(full, axis=0)
    np.testing.assert_allclose(
        minimum_norm_solution(full, np.ones(9)),
        scipy.linalg.pinv(full / norms) @ np.ones(9) / norms,
    )


@pytest.mark.parametrize("q", [1, 2, 7, 27])
def test_stacked_triangular_algebra_against_scipy(q: int) -> None:
    rng = np.random.default_rng(q)
    root = rng.normal(size=(2, 3, q, q + 2))
    matrix = root @ np.swapaxes(root, -1, -2)
    right = rng.normal(size=(2, 3, q))
    several = rng.normal(size=(2, 3, q, 4))
    front = np.concatenate([matrix, right[..., None, :]], axis=-2).transpose(0, 3, 2, 1).copy()
    eliminate(front)
    lower = np.tril(front[:, :, :q].transpose(0, 3, 2, 1))
    white = front[:, :, q].transpose(0, 2, 1)
    upper = solve_upper(lower, right)
    forward = solve_lower(lower, several)
    for i in np.ndindex(2, 3):
        expected = np.linalg.cholesky(matrix[i])
        np.testing.assert_allclose(lower[i], expected, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(
            white[i], scipy.linalg.solve_triangular(expected, right[i], lower=True), rtol=1e-8
        )
        np.testing.assert_allclose(
            forward[i], scipy.linalg.solve_triangular(expected, several[i], lower=True), rtol=1e-8
        )
        np.testing.assert_allclose(
            upper[i], scipy.linalg.solve_triangular(expected.T, right[i]), rtol=1e-8
        )


def test_refused() -> None:
    with pytest.raises(np.linalg.LinAlgError):
        _ = Gaussian(np.array([[1.0, 2.0], [2.0, 1.0]]), np.ones(2)).mean
    refuses(
        r"variances must be positive, got -1\.0",
        Gaussian.of,
        np.zeros(2),
        np.array([1.0, -1.0]),
    )
    refuses(
        "covariance must be positive definite",
        Gaussian.of,
        np.zeros(2),
        np.array([[1.0, 2.0], [2.0, 1.0]]),
    )
    for rows in (np.ones((3, 2)), np.ones((1, 2)), np.array([[1.0, 0.0]] * 3)):
        refuses(
            "rows must determine every coefficient",
            Gaussian.from_rows,
            rows,
            np.zeros(len(rows)),
        )


@example(seed=199, level=0.5988615144518045)
@given(seed=st.integers(0, 10**6), level=st.floats(0.001, 0.999))
def test_quantiles_of_mixtures(seed: int, level: float) -> None:
    """Against a root of the mixture's distribution function, narrow and far components too; weights
    shared or not."""
    rng = np.random.default_rng(seed)
    weight = rng.dirichlet(np.ones(5))
    mean = 3.0 * rng.standard_normal((5, 2))
    sd = np.exp(2.0 * rng.standard_normal((5, 2)))
    found = mixture_quantiles(weight, mean, sd, [level])[0]
    each = mixture_quantiles(np.column_stack([weight, weight]), mean, sd, [level])[0]
    np.testing.assert_allclose(each, found)
    for j in range(2):

        def excess(x: float, j: int = j) -> float:
            return float(weight @ stats.norm.cdf(x, mean[:, j], sd[:, j])) - level

        expected = optimize.brentq(excess, -1e4, 1e4, xtol=1e-12)
        assert found[j] == pytest.approx(
            expected, abs=1e-7 * mixture_moments(weight, mean, sd)[1][j]
        )


def test_moments_of_mixtures_and_weighted_quantiles() -> None:
    weight = np.array([0.25, 0.75])
    middle, spread = mixture_moments(weight, np.array([[0.0], [2.0]]), np.array([[1.0], [3.0]]))
    assert (middle[0], spread[0] ** 2) == pytest.approx(
        (1.5, 0.25 * 1.0 + 0.75 * 9.0 + 0.25 * 0.75 * 4.0)
    )
    draws = np.arange(100.0)[:, None]
    found = weighted_quantiles(np.full(100, 0.01), draws, [0.005, 0.5, 0.995])
    np.testing.assert_allclose(found[:, 0], [0.0, 49.5, 99.0])
    repeated = weighted_quantiles(np.array([0.5, 0.5]), np.array([[3.0], [1.0]]), [0.25, 0.5, 0.75])
    np.testing.assert_allclose(repeated[:, 0], [1.0, 2.0, 3.0])


def test_newton_finds_the_mode_through_wrong_curvature() -> None:
    """ln p = −(x² − 1)² − 2 (y − x)²: at the start the curvature in x has the wrong sign."""

    def log_density(points: np.ndarray) -> np.ndarray:
        x, y = points.T
        return -((x**2 - 1.0) ** 2) - 2.0 * (y - x) ** 2

    def derivatives(point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return central_differences(log_density, point, 1e-4)

    x = 0.3
    y = -0.4
    gradient, hessian = derivatives(np.array([x, y]))
    np.testing.assert_allclose(
        gradient, [-4 * x * (x**2 - 1) + 4 * (y - x), -4 * (y - x)], atol=1e-6
    )
    np.testing.assert_allclose(hessian, [[-12 * x**2 + 4 - 4, 4], [4, -4]], atol=1e-4)
    found = newton(log_density, derivatives, np.array([0.1, -2.0]), gain=1e-12)
    np.testing.assert_allclose(found, np.sign(found), atol=1e-4)


def test_holm() -> None:
    """Holm (1979): the k-th smallest times n + 1 − k, never falling, at most one."""
    np.testing.assert_allclose(holm(np.array([0.01, 0.04, 0.03, 0.005])), [0.03, 0.06, 0.06, 0.02])
    np.testing.assert_allclose(holm(np.array([0.9, 0.5])), [1.0, 1.0])
