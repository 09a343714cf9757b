"""Integrals over the hyper-parameters against brute force in small cases."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from campaigns import TRUTH, oracle_of, plan, simulated
from scipy.special import log_ndtr

import ldbb_bayes as lb
from ldbb_bayes.inference.evidence import evidence_of, log_prob_truncation
from ldbb_bayes.inference.quadrature import HyperPosterior, conditional_draws
from ldbb_bayes.model.bound import BoundModel


@pytest.fixture(scope="module")
def bound() -> BoundModel:
    return lb.HybridModel.default(1).bind(simulated(plan()))


def grid_integral(log_density: Callable[[np.ndarray], np.ndarray], axes: Sequence[np.ndarray]) -> float:
    """ln ∫ over log hyper-parameters on an even grid."""
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))
    values = np.concatenate([log_density(part) for part in np.array_split(points, 50)])
    return float(np.logaddexp.reduce(values) + sum(np.log(axis[1] - axis[0]) for axis in axes))


@pytest.mark.parametrize("truncated", [False, True])
def test_evidence_by_brute_force(truncated: bool) -> None:
    """σ and κ only; κ may be almost zero, a long tail. With truncation the integrand carries P(T | y, φ)."""
    small = lb.HybridModel.default(0).without("ball-form", "setup-shift").bind(simulated(plan()))
    posterior = HyperPosterior(small, truncated=truncated)
    axes = np.linspace(np.log(1e-4), np.log(3e-3), 140), np.linspace(np.log(1e-7), np.log(1e-2), 300)
    expected = grid_integral(posterior.log_density, axes)
    found = evidence_of(posterior)
    prior = np.log(1 / 8) if truncated else 0.0
    assert found.log_value == pytest.approx(expected - prior, abs=0.01)
    assert found.error < 0.01


def test_small_truncation_probability_by_brute_force(recovered: lb.Campaign) -> None:
    """Without ball form C_CCY is forced against its sign: ln P(T | y) by one-dimensional normal probabilities and a grid."""
    bound = lb.HybridModel.default(0).without("ball-form", "setup-shift").bind(recovered)
    row = bound.names.index("C_CCY")

    def both(free: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        phi = bound.hyper_prior.phi(free)
        log_evidence, given = bound.given(phi)
        mean, spread = given.mean, given.spread()
        plain = log_evidence + bound.hyper_prior.log_density_of_free(free)
        return plain, plain + log_ndtr(mean[:, row] / np.linalg.norm(spread[:, row], axis=1))

    axis_sigma, axis_kappa = np.linspace(np.log(4.4e-5), np.log(5.7e-5), 41), np.linspace(np.log(8e-4), np.log(6e-3), 200)
    points = np.stack(np.meshgrid(axis_sigma, axis_kappa, indexing="ij"), axis=-1).reshape(-1, 2)
    plain, inside = both(points)
    expected = np.logaddexp.reduce(inside) - np.logaddexp.reduce(plain)
    found = log_prob_truncation(HyperPosterior(bound, truncated=False), HyperPosterior(bound, truncated=True))
    assert expected < -10.0
    assert found.log_value == pytest.approx(expected, abs=0.05)


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
    assert found.log_value == pytest.approx(expected, abs=0.02)


@pytest.mark.parametrize("degree", [1, 2])
def test_hopeless_truncation_stays_finite(recovered: lb.Campaign, degree: int) -> None:
    bound = lb.HybridModel.default(degree).without("ball-form", "discrepancy", "setup-shift").bind(recovered)
    truncated = HyperPosterior(bound, truncated=True)
    values = [log_prob_truncation(HyperPosterior(bound, truncated=False, seed=s), truncated).log_value for s in (0, 1)]
    assert -2500.0 < values[0] < -1500.0
    assert values[0] == pytest.approx(values[1], abs=0.1)
    rng = np.random.default_rng(0)
    beta, exact = conditional_draws(bound, truncated.draw(64, rng), rng)
    assert bound.truncation.holds(beta[exact]).all()
    assert exact.mean() > 0.8, "the rest lie on the edge to rounding"


@pytest.mark.parametrize("quiet_um", [0.5, 0.01])
def test_noise_at_the_floor_of_the_resolution(quiet_um: float) -> None:
    """σ = 0.03 µm lies under resolution/√12 = 0.069 µm: the posterior crowds at the edge, and the integrals still agree."""
    hyper = {"sigma": 0.03, "delta": quiet_um, "kappa": quiet_um, "tau": 3.0}
    model = lb.HybridModel.default(0)
    campaign = model.simulate(plan((720,) * 4), seed=1, parameters=TRUTH, hyper_um=hyper).campaign
    bound = model.bind(campaign)
    integrals = [HyperPosterior(bound, truncated=False, seed=seed).lattice() for seed in range(3)]
    values = np.array([integral.log_integral for integral in integrals])
    assert np.ptp(values) < 0.1
    assert max(integral.error for integral in integrals) < 0.05
    posterior = HyperPosterior(bound, truncated=False)
    rng = np.random.default_rng(0)
    around = posterior.mode + rng.normal(size=(2000, 4)) * [2.0, 0.5, 0.5, 0.5]
    assert posterior.log_density(around).max() <= posterior.log_density(posterior.mode[None])[0] + 1e-3


def test_evidence_and_truncation_against_the_oracle() -> None:
    campaign = simulated(plan((30, 26, 9), forces_N=(36.0, 400.0, 742.0)))
    bound, oracle = lb.HybridModel.default(0).bind(campaign), oracle_of(campaign, 0)
    reference = oracle.posterior(points=1500, draws=100, seed=3)
    plain, truncated = HyperPosterior(bound, truncated=False), HyperPosterior(bound, truncated=True)
    assert plain.lattice().log_integral == pytest.approx(reference["log_evidence"], abs=0.1)
    assert log_prob_truncation(plain, truncated).log_value == pytest.approx(reference["log_prob_truncation"], abs=0.1)


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
