"""Nodes without one test from the nodes of all tests, against nodes computed anew."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

import ldbb_bayes as lb
from ldbb_bayes.inference import evidences
from ldbb_bayes.inference.evidences import Evidences, leave_one_out
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.inference.importance_sampling import importance_sample
from ldbb_bayes.inference.nodes import Nodes, compute_nodes
from ldbb_bayes.inference.nodes_without_test import NodesWithoutTest, fit_factor
from ldbb_bayes.model.hybrid import BoundModel

MODEL = lb.HybridModel.default(1)
TOLERANCE = 0.05
TESTS = 20


@pytest.fixture(scope="module")
def campaign() -> lb.Campaign:
    """Twenty circles, simulated by the model."""
    angle = np.arange(60) * 6.0
    tests = [lb.CircularTest(force, angle) for force in np.linspace(36.0, 742.0, TESTS)]
    return MODEL.simulate(lb.Campaign(tests), seed=4).campaign


@pytest.fixture(scope="module")
def nodes(campaign: lb.Campaign) -> Nodes:
    return Evidences(campaign, tolerance=TOLERANCE).nodes(MODEL)[0]


def posterior_without(nodes: Nodes, test: str) -> HyperPosterior:
    test_names = [name for name in nodes.bound.test_names if name != test]
    bound = BoundModel(nodes.bound.model, nodes.bound.campaign, keep_tests=test_names)
    return HyperPosterior(bound, truncated=bound.truncation.active)


def quantiles_of(nodes: Nodes, levels: list[float]) -> np.ndarray:
    """Quantiles of all hyper-parameters in unbounded coordinates."""
    draws = nodes.integral.resample(20_000, np.random.default_rng(1))
    return np.quantile(draws, levels, axis=0)


def test_gaussian_factor_integrates_to_one() -> None:
    """Whatever the other coordinates are."""
    root = np.tril(np.random.default_rng(2).normal(size=(3, 3)))

    def log_density(x: np.ndarray) -> np.ndarray:
        return -0.5 * (np.linalg.solve(root, x.T) ** 2).sum(axis=0)

    integral = importance_sample(log_density, [(np.zeros(3), root)], tolerance=0.01)
    factor = fit_factor(integral, 1)

    def density(x: float) -> float:
        return float(np.exp(factor.log_density(np.array([[0.7, x, -2.0]]))[0]))

    assert quad(density, -30.0, 30.0, points=[0.0])[0] == pytest.approx(1.0, abs=1e-6)


def test_gaussian_factor_is_the_conditional_density() -> None:
    """Of N(0, Σ): mean Σ₁₂ Σ₂₂⁻¹ x₂ and variance Σ₁₁ − Σ₁₂ Σ₂₂⁻¹ Σ₂₁."""
    covariance = np.array([[2.0, 0.8, -0.5], [0.8, 1.0, 0.1], [-0.5, 0.1, 1.5]])
    root = np.linalg.cholesky(covariance)

    def log_density(x: np.ndarray) -> np.ndarray:
        return -0.5 * (np.linalg.solve(root, x.T) ** 2).sum(axis=0)

    integral = importance_sample(log_density, [(np.zeros(3), root)], tolerance=0.002)
    factor = fit_factor(integral, 0)
    gain = covariance[0, 1:] @ np.linalg.inv(covariance[1:, 1:])
    np.testing.assert_allclose(factor.slopes, gain, atol=0.01)
    variance = covariance[0, 0] - gain @ covariance[1:, 0]
    assert factor.sd**2 == pytest.approx(variance, rel=0.01)


def test_prior_of_the_logarithm_of_a_noise_factor_integrates_to_one(nodes: Nodes) -> None:
    prior = nodes.bound.hyper_prior

    def density(log_noise: float) -> float:
        return float(np.exp(prior.log_density_of_log_noise(np.array([log_noise]))[0]))

    assert quad(density, -4.0, 12.0, points=[0.0])[0] == pytest.approx(1.0, abs=1e-6)


def test_evidence_is_that_of_nodes_computed_anew(nodes: Nodes) -> None:
    of_all = NodesWithoutTest(nodes, TOLERANCE)
    compared = 0
    for test in nodes.bound.test_names[::6]:
        posterior = posterior_without(nodes, test)
        shared = of_all.nodes(posterior, test)
        if shared is not None:
            anew = compute_nodes(posterior, 0.02)
            difference = shared.evidence.log_value - anew.evidence.log_value
            assert abs(difference) < np.hypot(shared.error, anew.error)
            compared += 1
    assert compared >= 2


def test_hyper_parameters_are_those_of_nodes_computed_anew(nodes: Nodes) -> None:
    """Quartiles; those of the noise factor of the test left out are its prior's."""
    test = nodes.bound.test_names[0]
    posterior = posterior_without(nodes, test)
    shared = NodesWithoutTest(nodes, 0.2).nodes(posterior, test)
    assert shared is not None
    levels = [0.25, 0.5, 0.75]
    anew = quantiles_of(compute_nodes(posterior, 0.02), levels)
    width = anew[2] - anew[0]
    difference = (quantiles_of(shared, levels) - anew) / width
    assert np.abs(difference).max() < 0.12
    axis = posterior.bound.hyper_prior.names.index(f"lambda_{test}")
    prior = np.log(posterior.bound.hyper_prior.draw_noise_factor(100_000, np.random.default_rng(3)))
    np.testing.assert_allclose(
        quantiles_of(shared, levels)[:, axis], np.quantile(prior, levels), atol=0.05
    )


def test_nodes_of_few_tests_are_computed_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nodes of all tests serve only where that saves time."""
    asked = []
    monkeypatch.setattr(NodesWithoutTest, "nodes", lambda self, posterior, test: asked.append(test))
    angle = np.arange(40) * 9.0
    plan = lb.Campaign([lb.CircularTest(force, angle) for force in (50.0, 200.0, 400.0)])
    model = lb.HybridModel.first(1)
    evidences = Evidences(model.simulate(plan, seed=1).campaign, tolerance=0.2)
    leave_one_out({"linear": evidences.nodes(model)[0]}, tolerance=0.2)
    assert asked == []


def test_nodes_that_miss_the_tolerance_are_computed_anew(
    nodes: Nodes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(evidences, "_FEWEST_TESTS", 2)
    monkeypatch.setattr(NodesWithoutTest, "nodes", lambda self, posterior, test: None)
    angle = np.arange(40) * 9.0
    plan = lb.Campaign([lb.CircularTest(force, angle) for force in (50.0, 200.0, 400.0)])
    model = lb.HybridModel.first(1)
    campaign = model.simulate(plan, seed=1).campaign
    (coarse,) = Evidences(campaign, tolerance=0.2).nodes(model)
    left_out = leave_one_out({"linear": coarse}, tolerance=0.2)["linear"]
    assert tuple(left_out) == coarse.bound.test_names


@pytest.mark.slow
def test_progress_counts_every_model_and_test(nodes: Nodes) -> None:
    steps = []
    leave_one_out({"linear": nodes}, tolerance=TOLERANCE, progress=lambda: steps.append(1))
    assert len(steps) == TESTS
