"""Orthant probabilities and truncated draws against SciPy, closed forms and plain rejection."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from pairs import pair_by_quadrature
from scipy import stats
from scipy.integrate import quad
from scipy.special import log_ndtr

from ldbb_bayes.model.truncation import Orthant, Truncation


def test_one_constraint_is_exact_however_far() -> None:
    mean = np.array([[1.0], [-3.0], [-60.0], [-2000.0]])
    orthant = Orthant(mean, np.full((4, 1, 1), 2.0))
    np.testing.assert_allclose(orthant.log_probability()[0], log_ndtr(mean[:, 0] / 2.0), rtol=1e-12)
    np.testing.assert_allclose(orthant.log_bound, log_ndtr(mean[:, 0] / 2.0), rtol=1e-12)


def test_two_constraints_in_closed_form() -> None:
    """P(both ≥ 0) = 1/4 + asin(ρ) / 2π at zero mean."""
    for rho in (-0.99, -0.5, 0.0, 0.9):
        spread = np.linalg.cholesky(np.array([[1.0, rho], [rho, 1.0]]))
        value, error = Orthant(np.zeros((1, 2)), spread[None]).log_probability(4096)
        assert value[0] == pytest.approx(np.log(0.25 + np.arcsin(rho) / (2 * np.pi)), abs=2e-3)
        assert error[0] < 5e-3


@pytest.mark.parametrize(("d", "shift"), [(3, 0.5), (6, 0.0), (6, -2.0)])
def test_against_scipy(d: int, shift: float) -> None:
    rng = np.random.default_rng(d)
    mean, spread = shift + 0.3 * rng.normal(size=(4, d)), rng.normal(size=(4, d, d + 3))
    values, _ = Orthant(mean, spread).log_probability(4096)
    for k in range(4):
        cov = spread[k] @ spread[k].T
        expected = np.log(stats.multivariate_normal.cdf(np.zeros(d), mean=-mean[k], cov=cov, maxpts=2_000_000, abseps=1e-10))
        assert values[k] == pytest.approx(expected, abs=5e-3)


def test_far_tails_are_finite_and_bounded() -> None:
    rng = np.random.default_rng(2)
    mean, spread = -40.0 + rng.normal(size=(5, 6)), rng.normal(size=(5, 6, 9))
    orthant = Orthant(mean, spread)
    values, error = orthant.log_probability(512)
    assert np.all(values < -400.0)
    assert np.all(np.isfinite(values))
    assert np.all(values <= orthant.log_bound + 1e-6)
    assert np.all(error < 0.05)


def test_independent_constraints_multiply_in_the_tail() -> None:
    mean = np.array([[-10.0, -20.0, -30.0]])
    expected = log_ndtr(mean[0]).sum()
    assert Orthant(mean, np.eye(3)[None]).log_probability()[0][0] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("start", [0.5, -6.0])
def test_a_parabola_kept_positive_at_six_places(start: float) -> None:
    """More rows than rank: plain Monte Carlo near the mode, importance from a shifted Gaussian in the tail."""
    x = np.linspace(-1.0, 1.0, 6)
    rows = np.vander(x, 3, increasing=True)
    mean, sd = np.array([start, 0.0, 0.3]), np.array([1.0, 1.0, 1.0])
    truncation = Truncation(rows)
    value = truncation.orthants(mean[None], np.diag(sd)[None]).log_probability(1 << 14)[0][0]
    rng = np.random.default_rng(0)
    proposal = np.array([max(start, 0.4), 0.0, 0.3])
    draws = proposal + rng.normal(size=(4_000_000, 3))
    log_weight = -0.5 * ((draws - mean) ** 2).sum(axis=1) + 0.5 * ((draws - proposal) ** 2).sum(axis=1)
    expected = np.log(np.mean(np.where(truncation.holds(draws), np.exp(log_weight), 0.0)))
    assert value == pytest.approx(expected, abs=0.03)


def test_truncated_draws_have_the_right_moments() -> None:
    rng = np.random.default_rng(4)
    rows = np.array([[1.0, 0.5, 0.0], [1.0, -0.5, 0.2]])
    mean, spread = np.array([-0.8, 0.3, 0.1]), np.tril(rng.normal(size=(3, 3)))
    n = 20_000
    orthant = Truncation(rows).orthants(np.tile(mean, (n, 1)), np.tile(spread, (n, 1, 1)))
    white, exact = orthant.draw_spread(rng)
    draws = mean + white @ spread.T
    plain = mean + rng.normal(size=(1_000_000, 3)) @ spread.T
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
    white, exact = Orthant(mean, spread).draw_spread(rng)
    value = mean + np.einsum("wij,wj->wi", spread, white)
    assert exact.mean() > 0.99
    assert np.all(value >= -1e-9)


def test_no_constraint_is_inactive() -> None:
    assert not Truncation(np.zeros((0, 3))).active
    assert Truncation(np.zeros((0, 3))).holds(np.ones((4, 3))).all()


def test_members_of_a_batch_do_not_depend_on_one_another() -> None:
    """A parabola at twelve places: every member chooses its own binding rows."""
    rows = np.vander(np.linspace(-1.0, 1.0, 12), 3, increasing=True)
    truncation, sd = Truncation(rows), np.diag([0.5, 0.5, 1.5])
    means = np.array([[1.0, 0.0, 0.0], [-8.0, 0.0, 0.0], [-2.0, 0.0, 0.0], [-2.0, 1.0, 0.5]])
    together = truncation.orthants(means, np.tile(sd, (4, 1, 1))).log_probability(1 << 12)[0]
    alone = [truncation.orthants(mean[None], sd[None]).log_probability(1 << 12)[0][0] for mean in means]
    np.testing.assert_allclose(together, alone, atol=0.02)
    rng = np.random.default_rng(0)
    proposal = np.array([0.3, 0.0, 0.0])
    draws = proposal + rng.normal(size=(4_000_000, 3)) * [0.5, 0.5, 1.5]
    shift = ((draws - means[2]) / [0.5, 0.5, 1.5]) ** 2 - ((draws - proposal) / [0.5, 0.5, 1.5]) ** 2
    expected = np.log(np.mean(np.where(truncation.holds(draws), np.exp(-0.5 * shift.sum(axis=1)), 0.0)))
    assert together[2] == pytest.approx(expected, abs=0.05)


@pytest.mark.parametrize("shift", [0.0, 2.0, -4.0])
def test_product_rule_against_conditional_integration(shift: float) -> None:
    """Two rows: ∫ φ(x) Φ(…) dx over the first, by adaptive quadrature."""
    rng = np.random.default_rng(4)
    for _ in range(10):
        root = np.array([[1.0 + rng.random(), 0.0], [rng.normal(), 0.7 + rng.random()]])
        mean = rng.normal(size=2) + shift
        first, slope, rest = root[0, 0], root[1, 0], root[1, 1]
        points = np.linspace(0.0, 12.0, 13) - mean[0] / first

        def inside(z: float, mean: np.ndarray = mean, slope: float = slope, rest: float = rest) -> float:
            return float(stats.norm.pdf(z) * stats.norm.cdf((mean[1] + slope * z) / rest))

        pieces = [quad(inside, a, b, epsabs=0.0, epsrel=1e-12)[0] for a, b in itertools.pairwise(points)]
        orthant = Orthant(mean[None], root[None])
        value, error = orthant.log_probability()
        assert value[0] == pytest.approx(np.log(np.sum(pieces)), abs=max(1e-8, error[0]))
        assert orthant.log_value()[0] == pytest.approx(np.log(np.sum(pieces)), abs=2e-5)


def test_rows_that_hold_with_certainty_change_nothing() -> None:
    mean = np.array([[0.3, 40.0, -0.2], [0.5, 35.0, 0.1]])
    spread = np.array([[1.0, 0.0, 0.0], [0.4, 1.0, 0.0], [-0.5, 0.2, 0.8]])
    with_row = Orthant(mean, np.tile(spread, (2, 1, 1)))
    without = Orthant(mean[:, [0, 2]], np.tile(spread[[0, 2]], (2, 1, 1)))
    np.testing.assert_allclose(with_row.log_value(), without.log_value(), atol=1e-12)
    nothing = Orthant(np.full((2, 1), 50.0), np.ones((2, 1, 1)))
    np.testing.assert_array_equal(nothing.log_value(), 0.0)
    assert nothing.draw_spread(np.random.default_rng(1))[1].all()


def test_a_certain_row_is_kept_when_the_others_push_it() -> None:
    """u2 ~ N(20, 1) with correlation −0.9 to u1 ~ N(−30, 1): given u1 ≥ 0 it is pushed to −7."""
    spread = np.array([[1.0, 0.0], [-0.9, np.sqrt(1 - 0.81)]])
    alone = Orthant(np.array([[-30.0]]), np.ones((1, 1, 1))).log_value()[0]
    both = Orthant(np.array([[-30.0, 20.0]]), spread[None]).log_value()[0]
    assert both < alone - 100.0


@pytest.mark.parametrize(
    ("mean", "rho"),
    [
        ((-12.0, -43.658), 0.999),
        ((-2.5, -40.7), 0.999),
        ((-8.5, 0.0), 0.999),
        ((0.0, -8.3), 0.999),
        ((-29.5, 0.0), -0.999),
        ((-5.0, -20.0), 0.99),
        ((-30.0, -31.0), 0.99999),
        ((-5.0, -20.0), 0.9),
    ],
)
def test_rows_that_nearly_repeat_each_other(mean: tuple[float, float], rho: float) -> None:
    """Violated together: a Newton iteration on the gradient alone stalls here."""
    spread = np.linalg.cholesky(np.array([[1.0, rho], [rho, 1.0]]))
    orthant = Orthant(np.array([mean]), spread[None])
    expected = pair_by_quadrature(mean, rho)
    assert orthant.log_probability(1 << 13)[0][0] == pytest.approx(expected, rel=2e-6, abs=2e-3)
    assert expected - 1e-3 <= orthant.log_bound[0] <= expected + 1.0


@pytest.mark.parametrize("d", [2, 3, 5, 8])
def test_the_bound_is_one(d: int) -> None:
    """No log weight exceeds it, down to ln P = −10⁷ and rows that nearly repeat each other: rejection stays exact."""
    rng = np.random.default_rng(d)
    seen = []
    for k in range(120):
        spread = rng.standard_normal((1, d, d)) * np.logspace(0.0, -rng.uniform(0.0, 4.0) * (k % 2), d)
        spread /= np.linalg.norm(spread, axis=2, keepdims=True)
        orthant = Orthant(rng.uniform(-60.0, 5.0, (1, d)) * rng.choice([0.1, 1.0, 3.0]), spread)
        bound = float(orthant.log_bound[0])
        if bound < -1e7:
            continue
        _, log_weight = orthant.propose_spread(rng.random((1, d)), rng.standard_normal((1, d)))
        assert log_weight[0] <= bound + 1e-8 * (1.0 + abs(bound))
        seen.append(bound)
    assert min(seen) < -1e4
    assert len(seen) > 60
