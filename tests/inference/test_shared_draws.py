"""Draws of parameters and shared nuisances against their joint Gaussian density."""

from __future__ import annotations

import numpy as np
import pytest
from campaigns import plan, refuses, simulated
from scipy import stats

import ldbb_bayes as lb
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.inference.conditional_sampling import draw_parameters_given
from ldbb_bayes.inference.shared_draws import draw_with_shared
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.hyper_prior import HyperPrior

MODEL = lb.HybridModel.first(1)
DRAWS = 20_000
REPEATS = 8
CAMPAIGNS = {
    "full circles": plan(),
    "arcs": plan(arc_deg=220.0),
    "circles of several numbers of readings": plan(readings=(40, 75, 40, 61)),
}


def scales(bound: BoundModel) -> np.ndarray:
    """Two values of the hyper-parameters in unbounded coordinates."""
    median = bound.hyper_prior.quantile(np.full(len(bound.hyper_prior.names), 0.5))
    return bound.hyper_prior.free(np.stack([0.5 * median, median]))


def campaign_with_gaps() -> Campaign:
    """Readings a little denser than on a full circle, so that some prior variances are negative."""
    angle = np.linspace(0.0, 356.0, 75)
    forces_N = (36.0, 300.0, 520.0, 742.0)
    return Campaign(tuple(lb.CircularTest(force, angle) for force in forces_N))


@pytest.mark.parametrize("name", CAMPAIGNS)
def test_draws_have_the_moments_of_the_joint_density(name: str) -> None:
    bound = MODEL.without("truncation").bind(simulated(CAMPAIGNS[name]))
    check_moments(bound)


def test_draws_are_right_where_prior_variances_are_negative() -> None:
    bound = MODEL.without("truncation").bind(simulated(campaign_with_gaps()))
    assert not bound.collapsed._design.elimination(len(bound.names)).is_positive
    check_moments(bound)


def check_moments(bound: BoundModel) -> None:
    free = scales(bound)
    repeated = np.repeat(free, DRAWS // REPEATS, axis=0)
    draws = draw_with_shared(bound, repeated, REPEATS, np.random.default_rng(3))
    joint = bound.collapsed.conditional(bound.hyper_prior.phi(free))[1]
    both = np.concatenate([draws.shared, draws.beta - bound.least_squares_estimate], axis=1)
    by_phi = both.reshape(2, DRAWS, -1)
    for k in range(2):
        np.testing.assert_array_equal(draws.phi[k * DRAWS], bound.hyper_prior.phi(free)[k])
        sd = joint.sd[k]
        acts = sd > 0.0
        deviation = (by_phi[k] - joint.mean[k])[:, acts] / sd[acts]
        np.testing.assert_allclose(deviation.mean(axis=0), 0.0, atol=5.0 / np.sqrt(DRAWS))
        correlation = joint.covariance[k][np.ix_(acts, acts)] / np.outer(sd[acts], sd[acts])
        scatter = deviation.T @ deviation / DRAWS
        np.testing.assert_allclose(scatter, correlation, atol=7.0 / np.sqrt(DRAWS))


@pytest.fixture(scope="module")
def truncated() -> BoundModel:
    """A third of all draws would have a negative compliance."""
    truth = {"C_CCY": 1e-11}
    campaign = MODEL.simulate(plan(), parameters=truth, seed=2).campaign
    return MODEL.bind(campaign)


def test_no_compliance_is_negative(truncated: BoundModel) -> None:
    draws = draw_with_shared(truncated, scales(truncated), 2000, np.random.default_rng(1))
    assert truncated.truncation.holds(draws.beta).mean() > 0.999


def test_truncated_draws_follow_the_density_of_single_draws(truncated: BoundModel) -> None:
    """Kolmogorov and Smirnov's test of every parameter against draws by another route."""
    free = scales(truncated)
    draws = draw_with_shared(truncated, free, 4000, np.random.default_rng(1))
    single = draw_parameters_given(
        truncated, np.repeat(free, 4000, axis=0), np.random.default_rng(2)
    )
    for k in range(2):
        rows = slice(4000 * k, 4000 * (k + 1))
        for j in range(len(truncated.names)):
            p_value = stats.ks_2samp(draws.beta[rows, j], single[rows, j]).pvalue
            assert p_value > 1e-4


def test_readings_that_contradict_the_truncation_are_refused(
    truncated: BoundModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    def accept_nothing(self: object, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        size = len(self._mean)  # type: ignore[attr-defined]
        return np.zeros((size, len(truncated.names))), np.zeros(size, dtype=bool)

    monkeypatch.setattr("ldbb_bayes.model.orthant.Orthant.draw_standard", accept_nothing)
    monkeypatch.setattr("ldbb_bayes.inference.shared_draws._PLAIN_TRIES", 0)
    rng = np.random.default_rng(1)
    refuses(
        "the posterior must leave room where no compliance is negative",
        draw_with_shared,
        truncated,
        scales(truncated),
        200,
        rng,
    )


def test_noise_factors_are_drawn_from_their_prior() -> None:
    """λ² ~ InvGamma(3/2, 3/2)."""
    draws = HyperPrior.draw_noise_factor(20_000, np.random.default_rng(1))
    inverse_gamma = stats.invgamma(1.5, scale=1.5)
    assert stats.kstest(draws**2, inverse_gamma.cdf).pvalue > 1e-3
