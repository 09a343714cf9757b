"""Probability that no compliance is negative, over nodes of p(φ | y), against integrals."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import log_ndtr

import ldbb_bayes as lb
from ldbb_bayes.inference.conditional_sampling import conditional_draws
from ldbb_bayes.inference.evidence import log_prob_truncation
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.inference.nodes import compute_nodes
from ldbb_bayes.inference.truncation_factor import TruncationFactor, _mean_probability
from ldbb_bayes.model.hybrid import BoundModel


def test_hopeless_truncation_is_exact(recovered: lb.Campaign) -> None:
    """σ alone is left: ln P(T | y) = −1311 by one-dimensional quadrature, C_CCY being the only
    constraint that binds."""
    bound = (
        lb.HybridModel.first(0).without("ball-form", "discrepancy", "setup-shift").bind(recovered)
    )
    row = bound.names.index("C_CCY")
    sigma = np.linspace(0.9e-3, 1.4e-3, 20_001)[:, None]
    log_evidence, conditional = bound.given(sigma)
    mean = conditional.mean[:, row]
    sd = np.linalg.norm(conditional.spread()[:, row], axis=1)
    plain = log_evidence + bound.hyper_prior.log_density(sigma)
    inside = plain + log_ndtr(mean / sd)
    expected = np.logaddexp.reduce(inside) - np.logaddexp.reduce(plain)
    log_prob, _ = log_prob_truncation(HyperPosterior(bound, truncated=True))
    assert expected < -1000.0
    assert log_prob == pytest.approx(expected, abs=0.02)


@pytest.mark.slow
def test_hopeless_truncation_stays_finite(recovered: lb.Campaign) -> None:
    bound = (
        lb.HybridModel.first(2).without("ball-form", "discrepancy", "setup-shift").bind(recovered)
    )
    truncated = HyperPosterior(bound, truncated=True)
    log_prob, _ = log_prob_truncation(truncated)
    other_seed, _ = log_prob_truncation(HyperPosterior(bound, truncated=True, seed=1))
    assert -2500.0 < log_prob < -1500.0
    assert log_prob == pytest.approx(other_seed, abs=0.1)
    rng = np.random.default_rng(0)
    beta, exact = conditional_draws(bound, truncated.coarse_integral.resample(64, rng), rng)
    assert bound.truncation.holds(beta[exact]).all()
    assert exact.mean() > 0.8, "the rest lie on the edge to rounding"


def test_no_probability_is_computed_twice(
    usually_negative: BoundModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A sample of the nodes does not suffice; its probabilities are those of all nodes too."""
    posterior = HyperPosterior(usually_negative, truncated=True)
    nodes = compute_nodes(posterior.without_truncation, 1e-2).integral
    _, conditional = posterior.given(nodes.free)
    inside, _ = conditional.orthant.log_probability(1e-3)
    expected = np.logaddexp.reduce(nodes.log_density + nodes.log_volume + inside)
    evaluated: list[np.ndarray] = []
    given = usually_negative.given

    def counted(phi: np.ndarray) -> object:
        evaluated.append(phi)
        return given(phi)

    monkeypatch.setattr(usually_negative, "given", counted)
    truncated = posterior.truncate(nodes, 2e-3)
    assert truncated.integral.log_integral == pytest.approx(expected, abs=1e-3)
    points = np.concatenate(evaluated)
    assert len(evaluated) > 1
    assert len(np.unique(points, axis=0)) == len(points)


def test_the_error_of_a_mean_probability_is_twice_its_standard_error(
    usually_negative: BoundModel,
) -> None:
    """Of ten nodes with the probability p and ten with q, that is 2 √(1/19) |p − q| / (p + q); the
    numerical error of p and q adds less than 0.001."""
    levels = np.full((2, len(usually_negative.hyper_prior.names)), 0.5)
    levels[1] = 0.9
    free = usually_negative.hyper_prior.free(usually_negative.hyper_prior.quantile(levels))
    log_p, log_q = (
        _mean_probability(usually_negative, np.tile(node, (2, 1)), 1e-6, 0).log_value
        for node in free
    )
    p, q = np.exp([log_p, log_q])
    mean = _mean_probability(usually_negative, np.repeat(free, 10, axis=0), 1e-6, 0)
    assert abs(p - q) > 0.05 * (p + q)
    assert mean.log_value == pytest.approx(np.log(0.5 * (p + q)), abs=1e-4)
    expected = 2.0 * np.sqrt(1.0 / 19.0) * abs(p - q) / (p + q)
    assert mean.error == pytest.approx(expected, abs=1e-3)


def test_common_errors_of_a_factor_add_up_and_random_ones_add_as_squares(
    usually_negative: BoundModel,
) -> None:
    """¼ · 0.4 + ¾ · 0.8 = 0.7; of the random ones, which are 0.3 and 0.4 after weighting, 0.5."""
    nodes = compute_nodes(HyperPosterior(usually_negative, truncated=False), 0.2)
    factor = TruncationFactor(usually_negative, nodes.integral, tolerance=1e-2, seed=0)
    weight = np.zeros(len(nodes.integral.free))
    weight[:2] = (0.25, 0.75)
    factor._common_error[:3] = (0.4, 0.8, 5.0)
    factor._noise[:3] = (0.3 / 0.25, 0.4 / 0.75, 5.0)
    assert factor.error(weight) == pytest.approx(0.7 + 0.5, rel=1e-12)
