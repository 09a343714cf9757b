"""Weighted nodes of p(φ | y) against one-dimensional integrals; exact draws given the nodes."""

from __future__ import annotations

import numpy as np
import pytest
from campaigns import HYPER_UM, TRUTH, plan, simulated
from scipy.special import log_ndtr

import ldbb_bayes as lb
from ldbb_bayes.inference import independent_sampler
from ldbb_bayes.inference.conditional_sampling import conditional_draws
from ldbb_bayes.inference.density import JointDensity
from ldbb_bayes.inference.evidence import log_prob_truncation
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.inference.independent_sampler import draw_jointly
from ldbb_bayes.inference.nodes import compute_nodes
from ldbb_bayes.inference.truncation_factor import TruncationFactor, _mean_probability
from ldbb_bayes.model.hybrid import BoundModel


@pytest.fixture(scope="module")
def bound() -> BoundModel:
    return lb.HybridModel.first(1).bind(simulated(plan()))


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


def test_conditional_draws_have_the_conditional_moments(bound: BoundModel) -> None:
    rng = np.random.default_rng(0)
    model = lb.HybridModel.first(1).without("truncation")
    plain = HyperPosterior(model.bind(bound.campaign), truncated=False)
    free = np.tile(plain.mode, (6_000, 1))
    beta, exact = conditional_draws(plain.bound, free, rng)
    _, conditional = plain.given(free[:1])
    sd = np.linalg.norm(conditional.spread()[0], axis=1)
    assert exact.all()
    np.testing.assert_allclose((beta.mean(axis=0) - conditional.mean[0]) / sd, 0.0, atol=0.06)
    np.testing.assert_allclose(beta.std(axis=0) / sd, 1.0, atol=0.04)


@pytest.fixture(scope="module")
def soft() -> BoundModel:
    """Four of five draws would have a negative compliance, because C_CCY is zero."""
    model = lb.HybridModel.first(1)
    return model.bind(model.simulate(plan(), parameters={**TRUTH, "C_CCY": 0.0}, seed=2).campaign)


def test_no_probability_is_computed_twice(
    soft: BoundModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A sample of the nodes does not suffice; its probabilities are those of all nodes too."""
    posterior = HyperPosterior(soft, truncated=True)
    nodes = compute_nodes(posterior.without_truncation, 1e-2).integral
    _, conditional = posterior.given(nodes.free)
    inside, _ = conditional.orthant.log_probability(1e-3)
    expected = np.logaddexp.reduce(nodes.log_density + nodes.log_volume + inside)
    evaluated: list[np.ndarray] = []
    given = soft.given

    def counted(phi: np.ndarray) -> object:
        evaluated.append(phi)
        return given(phi)

    monkeypatch.setattr(soft, "given", counted)
    truncated = posterior.truncate(nodes, 2e-3)
    assert truncated.integral.log_integral == pytest.approx(expected, abs=1e-3)
    points = np.concatenate(evaluated)
    assert len(evaluated) > 1
    assert len(np.unique(points, axis=0)) == len(points)


def test_the_error_of_a_mean_probability_is_twice_its_standard_error(soft: BoundModel) -> None:
    """Of ten nodes with the probability p and ten with q, that is 2 √(1/19) |p − q| / (p + q); the
    numerical error of p and q adds less than 0.001."""
    levels = np.full((2, len(soft.hyper_prior.names)), 0.5)
    levels[1] = 0.9
    free = soft.hyper_prior.free(soft.hyper_prior.quantile(levels))
    log_p, log_q = (
        _mean_probability(soft, np.tile(node, (2, 1)), 1e-6, 0).log_value for node in free
    )
    p, q = np.exp([log_p, log_q])
    mean = _mean_probability(soft, np.repeat(free, 10, axis=0), 1e-6, 0)
    assert abs(p - q) > 0.05 * (p + q)
    assert mean.log_value == pytest.approx(np.log(0.5 * (p + q)), abs=1e-4)
    expected = 2.0 * np.sqrt(1.0 / 19.0) * abs(p - q) / (p + q)
    assert mean.error == pytest.approx(expected, abs=1e-3)


def test_common_errors_of_a_factor_add_up_and_random_ones_add_as_squares(soft: BoundModel) -> None:
    """¼ · 0.4 + ¾ · 0.8 = 0.7; of the random ones, which are 0.3 and 0.4 after weighting, 0.5."""
    nodes = compute_nodes(HyperPosterior(soft, truncated=False), 0.2)
    factor = TruncationFactor(soft, nodes.integral, tolerance=1e-2, seed=0)
    weight = np.zeros(len(nodes.integral.free))
    weight[:2] = (0.25, 0.75)
    factor._common_error[:3] = (0.4, 0.8, 5.0)
    factor._noise[:3] = (0.3 / 0.25, 0.4 / 0.75, 5.0)
    assert factor.error(weight) == pytest.approx(0.7 + 0.5, rel=1e-12)


@pytest.mark.parametrize("required", [True, False])
def test_draws_of_a_density_without_truncation_have_negative_compliances(
    soft: BoundModel, required: bool
) -> None:
    """The model may require compliances that are not negative: its density without this counts."""
    model = soft.model if required else soft.model.without("truncation")
    posterior = HyperPosterior(model.bind(soft.campaign), truncated=False)
    beta, _ = compute_nodes(posterior, 0.1).draw(400, np.random.default_rng(1))
    assert 0.1 < soft.truncation.holds(beta).mean() < 0.9


@pytest.mark.parametrize("required", [True, False])
def test_draws_of_a_truncated_density_have_no_negative_compliance(
    soft: BoundModel, required: bool
) -> None:
    model = soft.model if required else soft.model.without("truncation")
    posterior = HyperPosterior(model.bind(soft.campaign), truncated=True)
    beta, _ = compute_nodes(posterior, 0.1).draw(400, np.random.default_rng(1))
    assert soft.truncation.holds(beta).all()


def check_moments(draws: np.ndarray, mean: np.ndarray, sd: np.ndarray) -> None:
    standard_error = 1.0 / np.sqrt(len(draws))
    error = (draws.mean(axis=0) - mean) / sd
    np.testing.assert_allclose(error, 0.0, atol=4.0 * standard_error)
    np.testing.assert_allclose(draws.std(axis=0) / sd, 1.0, atol=6.0 * standard_error)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("truncated", "few_inside", "size"), [(False, 0.0, 6000), (True, 0.0, 6000), (True, 1.0, 1500)]
)
def test_draws_have_the_moments_of_the_nodes(
    recovered: lb.Campaign,
    truncated: bool,
    few_inside: float,
    size: int,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """ln P(T | y) is −1.2: several β for each φ; and by tilting, as where it is far smaller."""
    monkeypatch.setattr(independent_sampler, "_SMALLEST_SHARE_INSIDE", few_inside)
    model = lb.HybridModel.first(1)
    if not truncated:
        model = model.without("truncation")
    posterior = HyperPosterior(model.bind(recovered), truncated=truncated)
    nodes = compute_nodes(posterior, 1e-2)
    draws = draw_jointly(posterior, size, np.random.default_rng(2))
    free, beta, accepted, proposed, log_posterior = draws
    assert len(free) == len(beta) == size
    mean = nodes.integral.weight @ nodes.integral.free
    sd = np.sqrt(nodes.integral.weight @ (nodes.integral.free - mean) ** 2)
    check_moments(free, mean, sd)
    check_moments(beta, *nodes.moments(spare=1e-4))
    density = JointDensity(posterior.bound)
    np.testing.assert_allclose(log_posterior, density(density.join(beta, free)), atol=1e-8)
    if truncated:
        assert posterior.bound.physical.holds(beta).all()
    assert len(np.unique(beta, axis=0)) == size
    assert len(np.unique(free, axis=0)) > 0.95 * size
    assert 0.2 < accepted / proposed < 1.0


@pytest.mark.parametrize(
    ("planned", "left_out"),
    [(plan(), []), (plan((9, 40, 12, 30)), ["ball-form"]), (plan(work_deg=40.0), [])],
)
def test_a_proposal_reaches_the_corners_of_the_density(
    planned: lb.Campaign, left_out: list[str]
) -> None:
    """Where one noise vanishes and another makes up for it one draw would stand for hundreds: the
    lattice's nodes go there."""
    model = lb.HybridModel.first(1)
    campaign = model.simulate(planned, seed=4, parameters=TRUTH, hyper_um=HYPER_UM).campaign
    posterior = HyperPosterior(model.without(*left_out).bind(campaign), truncated=False)
    free, _ = compute_nodes(posterior, 1e-2).integral.heaviest(1e-5)
    log_weight = (
        posterior.log_density(free)
        - posterior.weighted_sample.log_proposal(free)
        - posterior.weighted_sample.log_integral
    )
    assert posterior.weighted_sample.trusted
    assert np.exp(log_weight.max()) < 12.0


def test_mode_is_a_maximum(bound: BoundModel) -> None:
    posterior = HyperPosterior(bound, truncated=True)
    around = posterior.mode + 0.3 * np.random.default_rng(0).normal(size=(200, 4))
    highest = posterior.log_density(posterior.mode[None])[0]
    assert posterior.log_density(around).max() <= highest + 1e-4


def test_the_mode_of_a_similar_density_does_not_hide_a_higher_mode() -> None:
    angle_deg = np.arange(0.0, 360.0, 9.0)
    tests = []
    for force_N in np.round(np.linspace(40.0, 740.0, 12)):
        tests.append(lb.CircularTest(float(force_N), angle_deg, name=f"{force_N:g}"))
    linear = lb.HybridModel.first(1).without("truncation")
    scales_um = {"tau": 15.0, "kappa": 0.5, "delta": 0.0, "sigma": 0.3}
    campaign = linear.simulate(lb.Campaign(tests), seed=0, hyper_um=scales_um).campaign
    of_linear = HyperPosterior(linear.bind(campaign), truncated=False)
    # Without the slope of C_XXX, which is large here, the readings ask for other scales.
    reduced = linear.fixing("C_XXX_1").bind(campaign)
    from_prior = HyperPosterior(reduced, truncated=False)
    from_mode_nearby = HyperPosterior(reduced, truncated=False, near=of_linear.mode)
    heights = [float(one.log_density(one.mode[None])[0]) for one in (from_prior, from_mode_nearby)]
    assert heights[1] == pytest.approx(heights[0], abs=1e-3)
