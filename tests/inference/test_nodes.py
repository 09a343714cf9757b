"""Weighted nodes against closed forms, brute force and one-dimensional integrals; exact draws given the nodes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from campaigns import plan, simulated
from scipy import stats
from scipy.special import gammaln, log_ndtr

import ldbb_bayes as lb
from ldbb_bayes.inference.evidence import log_prob_truncation
from ldbb_bayes.inference.nodes import HyperPosterior, conditional_draws, draw_hyper, grow_lattice
from ldbb_bayes.model.hybrid import BoundModel

Array = np.ndarray


def correlated_gaussian(x: Array) -> Array:
    covariance = np.array([[1.0, 0.7, 0.0, 0.1], [0.7, 2.0, 0.3, 0.0], [0.0, 0.3, 0.5, 0.2], [0.1, 0.0, 0.2, 1.5]])
    return np.atleast_1d(stats.multivariate_normal(np.array([0.3, -0.2, 0.1, 0.4]), covariance).logpdf(x)) + 12.5


def half_normals_in_logarithms(x: Array) -> Array:
    """ln φ of half-normal φ: falls like e^x on the left, doubly exponentially on the right."""
    return np.asarray((x + 0.5 * np.log(2.0 / np.pi) - 0.5 * np.exp(2.0 * x)).sum(axis=1))


def log_gammas(x: Array) -> Array:
    return np.asarray((2.5 * x - np.exp(x) - gammaln(2.5)).sum(axis=1))


def two_modes(x: Array) -> Array:
    """3 sd apart."""
    one, other = (stats.norm(centre, 1.0).logpdf(x).sum(axis=1) for centre in (-1.5, 1.5))
    return np.asarray(np.logaddexp(one, other) - np.log(2.0))


CASES: dict[str, tuple[Callable[[Array], Array], Array, Array, float]] = {
    "Gaussian": (correlated_gaussian, np.zeros(4), np.diag([1.0, 1.2, 0.7, 1.2]), 12.5),
    "half-normals": (half_normals_in_logarithms, np.zeros(3), 0.7 * np.eye(3), 0.0),
    "log gammas": (log_gammas, np.full(2, np.log(2.5)), np.eye(2) / np.sqrt(2.5), 0.0),
    "two modes": (two_modes, np.full(2, 1.5), np.eye(2), 0.0),
    "one dimension": (log_gammas, np.array([np.log(2.5)]), np.array([[0.6]]), 0.0),
}


@pytest.mark.parametrize("tolerance", [1e-2, 1e-5])
@pytest.mark.parametrize("case", CASES)
def test_integral_and_its_error(case: str, tolerance: float) -> None:
    log_density, centre, root, expected = CASES[case]
    lattice = grow_lattice(log_density, centre, root, tolerance=tolerance)
    assert lattice.error <= tolerance
    assert abs(lattice.log_integral - expected) <= lattice.error + 1e-9
    assert lattice.weight.sum() == pytest.approx(1.0)


def test_the_error_says_so_when_nodes_run_out() -> None:
    lattice = grow_lattice(half_normals_in_logarithms, np.zeros(3), 0.05 * np.eye(3), tolerance=1e-6, most=2000)
    assert lattice.error > 1e-6


def test_moments_of_the_nodes() -> None:
    lattice = grow_lattice(correlated_gaussian, np.zeros(4), np.eye(4), tolerance=1e-6)
    np.testing.assert_allclose(lattice.weight @ lattice.free, [0.3, -0.2, 0.1, 0.4], atol=1e-5)
    centred = lattice.free - lattice.weight @ lattice.free
    covariance = (lattice.weight[:, None] * centred).T @ centred
    np.testing.assert_allclose(np.diag(covariance), [1.0, 2.0, 0.5, 1.5], atol=1e-4)


@pytest.mark.parametrize("case", ["half-normals", "two modes", "one dimension"])
def test_draws_come_from_the_density_they_say(case: str) -> None:
    """Weighted by density over proposal they give the integral; every proposal density is that of its cells."""
    log_density, centre, root, expected = CASES[case]
    lattice = grow_lattice(log_density, centre, root, tolerance=1e-3)
    free = lattice.draw(20_000, np.random.default_rng(3))
    weight = np.exp(log_density(free) - lattice.log_proposal(free) + lattice.log_integral - expected)
    assert weight.mean() == pytest.approx(1.0, abs=5.0 * weight.std() / np.sqrt(len(weight)) + 1e-3)
    assert weight.sum() ** 2 / (weight**2).sum() > 0.6 * len(weight)
    wider = lattice.draw(20_000, np.random.default_rng(3), temperature=2.0)
    assert np.all(wider.std(axis=0) > 1.1 * free.std(axis=0))


def test_a_corrected_lattice_is_that_of_the_other_density() -> None:
    def tilted(x: Array) -> Array:
        return correlated_gaussian(x) + np.log(stats.norm.cdf(x[:, 0]))

    lattice = grow_lattice(correlated_gaussian, np.zeros(4), np.eye(4), tolerance=1e-4)
    corrected = lattice.corrected(tilted, spare=1e-7)
    expected = 12.5 + stats.norm.logcdf(0.3 / np.sqrt(2.0))
    assert corrected.log_integral == pytest.approx(expected, abs=2e-4)


@pytest.fixture(scope="module")
def bound() -> BoundModel:
    return lb.HybridModel.default(1).bind(simulated(plan()))


def test_hopeless_truncation_is_exact(recovered: lb.Campaign) -> None:
    """σ alone is left: ln P(T | y) = −1311 by one-dimensional quadrature, C_CCY being the only constraint that binds."""
    bound = lb.HybridModel.default(0).without("ball-form", "discrepancy", "setup-shift").bind(recovered)
    row = bound.names.index("C_CCY")
    sigma = np.linspace(0.9e-3, 1.4e-3, 20_001)[:, None]
    log_evidence, given = bound.given(sigma)
    mean, spread = given.mean, given.spread()
    plain = log_evidence + bound.hyper_prior.log_density(sigma)
    inside = plain + log_ndtr(mean[:, row] / np.linalg.norm(spread[:, row], axis=1))
    expected = np.logaddexp.reduce(inside) - np.logaddexp.reduce(plain)
    found = log_prob_truncation(HyperPosterior(bound, truncated=False), HyperPosterior(bound, truncated=True))
    assert expected < -1000.0
    assert found[0] == pytest.approx(expected, abs=0.02)


def test_hopeless_truncation_stays_finite(recovered: lb.Campaign) -> None:
    bound = lb.HybridModel.default(2).without("ball-form", "discrepancy", "setup-shift").bind(recovered)
    truncated = HyperPosterior(bound, truncated=True)
    values = [log_prob_truncation(HyperPosterior(bound, truncated=False, seed=s), truncated)[0] for s in (0, 1)]
    assert -2500.0 < values[0] < -1500.0
    assert values[0] == pytest.approx(values[1], abs=0.1)
    rng = np.random.default_rng(0)
    beta, exact = conditional_draws(bound, truncated.coarse.draw(64, rng), rng)
    assert bound.truncation.holds(beta[exact]).all()
    assert exact.mean() > 0.8, "the rest lie on the edge to rounding"


def test_conditional_draws_have_the_conditional_moments(bound: BoundModel) -> None:
    rng = np.random.default_rng(0)
    plain = lb.HybridModel.default(1).without("truncation").bind(bound.campaign)
    free = np.tile(HyperPosterior(plain, truncated=False).mode, (6_000, 1))
    beta, exact = conditional_draws(plain, free, rng)
    _, given = plain.given(plain.hyper_prior.phi(free[:1]))
    mean, spread = given.mean, given.spread()
    sd = np.linalg.norm(spread[0], axis=1)
    assert exact.all()
    np.testing.assert_allclose((beta.mean(axis=0) - mean[0]) / sd, 0.0, atol=0.06)
    np.testing.assert_allclose(beta.std(axis=0) / sd, 1.0, atol=0.04)


def test_mode_is_a_maximum(bound: BoundModel) -> None:
    posterior = HyperPosterior(bound, truncated=True)
    around = posterior.mode + 0.3 * np.random.default_rng(0).normal(size=(200, 4))
    assert posterior.log_density(around).max() <= posterior.log_density(posterior.mode[None])[0] + 1e-4


def test_draws_of_hyper_parameters_have_the_moments_of_the_nodes(bound: BoundModel) -> None:
    posterior = HyperPosterior(bound, truncated=True)
    lattice = posterior.nodes(1e-2).lattice
    free, used = draw_hyper(posterior, 4000, np.random.default_rng(2))
    mean = lattice.weight @ lattice.free
    sd = np.sqrt(lattice.weight @ (lattice.free - mean) ** 2)
    np.testing.assert_allclose((free.mean(axis=0) - mean) / sd, 0.0, atol=0.08)
    np.testing.assert_allclose(free.std(axis=0) / sd, 1.0, atol=0.08)
    assert 0.2 < used < 1.0
