"""Orthant probabilities and truncated draws against SciPy, closed forms and plain rejection."""

from __future__ import annotations

import numpy as np
import pytest
from orthants import pair_by_quadrature, random_case
from scipy import integrate, stats
from scipy.special import log_ndtr

from ldbb_bayes.model.orthant import Orthant
from ldbb_bayes.model.truncation import Truncation


def test_one_constraint_is_exact_however_far() -> None:
    mean = np.array([[1.0], [-3.0], [-60.0], [-2000.0]])
    orthant = Orthant(mean, np.full((4, 1, 1), 2.0))
    np.testing.assert_allclose(orthant.log_probability()[0], log_ndtr(mean[:, 0] / 2.0), rtol=1e-12)
    np.testing.assert_allclose(orthant.log_bound, log_ndtr(mean[:, 0] / 2.0), rtol=1e-12)


def test_a_constraint_that_is_far_until_another_holds() -> None:
    """u₁ is −8 and u₂ 6.5 sds above zero: where u₁ ≥ 0 after all, u₂ is −0.7, because they are
    correlated by −0.9. By one-dimensional quadrature."""
    rho = -0.9
    rest_sd = np.sqrt(1.0 - rho**2)
    orthant = Orthant(np.array([[-8.0, 6.5]]), np.array([[[1.0, 0.0], [rho, rest_sd]]]))

    def density(x: float) -> float:
        return float(stats.norm.pdf(x) * stats.norm.cdf((6.5 + rho * x) / rest_sd))

    expected = np.log(integrate.quad(density, 8.0, 20.0, epsabs=0.0, epsrel=1e-9)[0])
    assert expected < log_ndtr(-8.0) - 3.0
    assert orthant.log_probability(1e-4)[0][0] == pytest.approx(expected, abs=2e-4)


@pytest.mark.parametrize(("d", "shift"), [(3, 0.5), (6, 0.0)])
def test_against_scipy(d: int, shift: float) -> None:
    rng = np.random.default_rng(d)
    mean = shift + 0.3 * rng.normal(size=(2, d))
    spread = rng.normal(size=(2, d, d + 3))
    values, _ = Orthant(mean, spread).log_probability(1e-4)
    for k in range(2):
        cov = spread[k] @ spread[k].T
        expected = np.log(
            stats.multivariate_normal.cdf(
                np.zeros(d), mean=-mean[k], cov=cov, maxpts=100_000, abseps=1e-6
            )
        )
        assert values[k] == pytest.approx(expected, abs=5e-3)


@pytest.mark.parametrize("start", [0.5, -6.0])
def test_a_parabola_kept_positive_at_six_places(start: float) -> None:
    """More rows than rank: plain Monte Carlo near the mode, importance from a shifted Gaussian in
    the tail."""
    x = np.linspace(-1.0, 1.0, 6)
    rows = np.vander(x, 3, increasing=True)
    mean = np.array([start, 0.0, 0.3])
    sd = np.array([1.0, 1.0, 1.0])
    truncation = Truncation(rows)
    value = truncation.orthants(mean[None], np.diag(sd)[None]).log_probability(1e-4)[0][0]
    rng = np.random.default_rng(0)
    proposal = np.array([max(start, 0.4), 0.0, 0.3])
    draws = proposal + rng.normal(size=(1_000_000, 3))
    log_weight = -0.5 * ((draws - mean) ** 2).sum(axis=1) + 0.5 * ((draws - proposal) ** 2).sum(
        axis=1
    )
    expected = np.log(np.mean(np.where(truncation.holds(draws), np.exp(log_weight), 0.0)))
    assert value == pytest.approx(expected, abs=0.03)


def test_truncated_draws_have_the_right_moments() -> None:
    rng = np.random.default_rng(4)
    rows = np.array([[1.0, 0.5, 0.0], [1.0, -0.5, 0.2]])
    mean = np.array([-0.8, 0.3, 0.1])
    spread = np.tril(rng.normal(size=(3, 3)))
    n = 20_000
    orthant = Truncation(rows).orthants(np.tile(mean, (n, 1)), np.tile(spread, (n, 1, 1)))
    white, exact = orthant.draw_standard(rng)
    draws = mean + white @ spread.T
    plain = mean + rng.normal(size=(400_000, 3)) @ spread.T
    plain = plain[Truncation(rows).holds(plain)]
    assert exact.all()
    assert Truncation(rows).holds(draws).all()
    sd = plain.std(axis=0)
    np.testing.assert_allclose((draws.mean(axis=0) - plain.mean(axis=0)) / sd, 0.0, atol=0.04)
    np.testing.assert_allclose(draws.std(axis=0) / sd, 1.0, atol=0.03)


def test_draws_do_not_hang_in_the_tail() -> None:
    rng = np.random.default_rng(5)
    n = 200
    mean = np.tile([-50.0, -45.0], (n, 1))
    spread = np.tile(np.array([[1.0, 0.0], [0.95, 0.3]]), (n, 1, 1))
    white, exact = Orthant(mean, spread).draw_standard(rng)
    value = mean + np.einsum("wij,wj->wi", spread, white)
    assert exact.mean() > 0.99
    assert np.all(value >= -1e-9)


def test_members_of_a_batch_do_not_depend_on_one_another() -> None:
    """A parabola at twelve places: every member chooses its own binding rows."""
    rows = np.vander(np.linspace(-1.0, 1.0, 12), 3, increasing=True)
    truncation = Truncation(rows)
    sd = np.diag([0.5, 0.5, 1.5])
    means = np.array(
        [
            [1.0, 0.0, 0.0],
            [-8.0, 0.0, 0.0],
            [-2.0, 0.0, 0.0],
            [-2.0, 1.0, 0.5],
            [9.0, 0.0, 0.0],
            [2.0, 1.0, 0.0],
        ]
    )
    batch = truncation.orthants(means, np.tile(sd, (6, 1, 1))).log_probability(1e-2)
    single = [truncation.orthants(mean[None], sd[None]).log_probability(1e-2) for mean in means]
    np.testing.assert_allclose(np.array(batch), np.squeeze(single).T, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(
    ("tolerance", "count", "first"),
    [
        (1e-3, 40, 1),
        pytest.param(1e-2, 400, 2, marks=pytest.mark.slow),
        pytest.param(1e-4, 300, 3, marks=pytest.mark.slow),
    ],
)
def test_the_stated_error_holds(tolerance: float, count: int, first: int) -> None:
    """Correlated by up to 0.99, down to ln P of some thousand, with rows that follow from others;
    2e-6 is the references' own."""
    rng = np.random.default_rng(first)
    ratios = []
    stated_errors = []
    for _ in range(count):
        case = random_case(rng)
        if case.log_probability > -3000.0:
            orthant = Orthant(case.mean[None], case.spread[None])
            value, error = orthant.log_probability(tolerance)
            actual_error = abs(value[0] - case.log_probability)
            ratios.append(actual_error / (error[0] + 2e-6))
            stated_errors.append(error[0])
    assert len(ratios) > 0.9 * count
    assert np.mean(np.array(ratios) <= 3.0) >= 0.99
    assert np.mean(np.array(ratios) > 0.1) > 0.1, "nor is it stated many times too large"
    assert np.median(stated_errors) <= tolerance


@pytest.mark.parametrize(
    ("mean", "rho"),
    [
        ((-12.0, -43.658), 0.999),
        ((0.0, -8.3), 0.999),
        ((-29.5, 0.0), -0.999),
        ((-30.0, -31.0), 0.99999),
        ((-5.0, -20.0), 0.9),
    ],
)
def test_rows_that_nearly_repeat_each_other(mean: tuple[float, float], rho: float) -> None:
    """Violated together: a Newton iteration on the gradient alone stalls here."""
    spread = np.linalg.cholesky(np.array([[1.0, rho], [rho, 1.0]]))
    orthant = Orthant(np.array([mean]), spread[None])
    expected = pair_by_quadrature(mean, rho)
    assert orthant.log_probability(1e-4)[0][0] == pytest.approx(expected, rel=2e-6, abs=2e-3)
    assert expected - 1e-3 <= orthant.log_bound[0] <= expected + 1.0


@pytest.mark.parametrize("d", [2, 3, 5, 8])
def test_the_bound_is_one(d: int) -> None:
    """No log weight exceeds it, down to ln P = −10⁷ and rows that nearly repeat each other:
    rejection stays exact."""
    rng = np.random.default_rng(d)
    bounds = []
    for k in range(120):
        directions = rng.standard_normal((1, d, d))
        smallest = -rng.uniform(0.0, 4.0) * (k % 2)
        spread = directions * np.logspace(0.0, smallest, d)
        spread /= np.linalg.norm(spread, axis=2, keepdims=True)
        mean = rng.uniform(-60.0, 5.0, (1, d)) * rng.choice([0.1, 1.0, 3.0])
        orthant = Orthant(mean, spread)
        bound = float(orthant.log_bound[0])
        if bound < -1e7:
            continue
        _, log_weight = orthant.propose_standard(rng.random((1, d)), rng.standard_normal((1, d)))
        assert log_weight[0] <= bound + 1e-8 * (1.0 + abs(bound))
        bounds.append(bound)
    assert min(bounds) < -1e4
    assert len(bounds) > 60


def test_errors_of_moments_average_out_over_members() -> None:
    """Six constraints, members alike but for a thousandth, as nodes are: the mean of their
    variances is that of a long run."""
    rng = np.random.default_rng(3)
    spread = rng.standard_normal((1, 6, 6))
    mean = rng.uniform(0.0, 2.0, (1, 6)) * np.linalg.norm(spread, axis=2)
    means = mean * (1.0 + 1e-3 * rng.uniform(-1.0, 1.0, (200, 6)))
    covariances = Orthant(means, np.tile(spread, (200, 1, 1))).moments().covariance
    average = np.diagonal(covariances, axis1=1, axis2=2).mean(axis=0)
    long_run = Orthant(mean, spread).moments(1 << 18).covariance
    exact = np.diagonal(long_run, axis1=1, axis2=2)[0]
    np.testing.assert_allclose(average / exact, 1.0, atol=0.005)


def similar_problems(count: int) -> Orthant:
    """Problems of five constraints whose means differ a little."""
    rng = np.random.default_rng(8)
    spread = np.tile(rng.normal(size=(5, 7)), (count, 1, 1))
    mean = rng.normal(size=5) + 0.05 * rng.normal(size=(count, 5))
    return Orthant(mean, spread)


@pytest.mark.slow
def test_the_noise_of_similar_problems_cancels_in_their_mean() -> None:
    """It is as large as stated, and so is its mean: 400 problems have a twentieth of it."""
    orthant = similar_problems(400)
    exact, _ = orthant.log_probability(1e-5)
    noisy = orthant.log_probability_with_noise(1e-3, 0.1)
    ratio = np.expm1(noisy.log_value - exact)
    assert noisy.noise.min() > 0.005
    assert np.mean(np.abs(ratio) <= 3.0 * noisy.noise) >= 0.99
    assert abs(ratio.mean()) <= 2.0 * np.linalg.norm(noisy.noise) / len(ratio)


def test_the_noise_of_a_problem_does_not_depend_on_the_others() -> None:
    of_six = similar_problems(6).log_probability_with_noise(1e-3, 0.1)
    mean = similar_problems(6)._mean[4:5]
    of_one = Orthant(mean, similar_problems(1)._spread).log_probability_with_noise(1e-3, 0.1)
    assert of_one.log_value[0] == pytest.approx(of_six.log_value[4], rel=1e-12)


def test_analytical_bounds_are_not_noise() -> None:
    """One constraint has a closed form; two that hardly bind have close bounds."""
    mean = np.array([[3.0, 9.0], [1.0, 60.0]])
    spread = np.tile(np.eye(2), (2, 1, 1))
    estimate = Orthant(mean, spread).log_probability_with_noise(1e-3, 0.5)
    np.testing.assert_allclose(estimate.log_value, log_ndtr(mean[:, 0]), atol=1e-8)
    assert estimate.noise.max() < 1e-3
