"""Constant and linear compliance from one posterior: against the models themselves."""

from __future__ import annotations

import numpy as np
import pytest
from campaigns import plan, simulated
from scipy import stats

import ldbb_bayes as lb
from ldbb_bayes.analysis.design.present_estimates import averaged_sds_now
from ldbb_bayes.analysis.hyper_parameter_nodes import hyper_parameter_nodes
from ldbb_bayes.analysis.nested_models import (
    Coefficients,
    NestedModels,
    averaged_sds,
    averaged_variances,
)
from ldbb_bayes.analysis.truncated_moments import symmetric_root, truncated_moments
from ldbb_bayes.inference.evidences import Evidences

CAMPAIGN = simulated(plan((30,) * 4), seed=1)
# In this model, nothing depends on the compliances that are estimated first, so that constant and
# linear compliance differ in the slopes alone.
FIXED = lb.HybridModel.first(1).without("force-error")


def nested(model: lb.HybridModel = FIXED) -> NestedModels:
    models = NestedModels.of(model.bind(CAMPAIGN))
    assert models is not None
    return models


def scales(bound: lb.model.BoundModel) -> np.ndarray:
    return bound.hyper_prior.quantile(
        np.full((3, len(bound.hyper_prior.names)), [[0.3], [0.5], [0.8]])
    )


def test_evidence_and_posterior_are_those_of_the_model_without_slopes() -> None:
    """The Savage-Dickey ratio, against an elimination of the smaller model of its own."""
    models = nested()
    assert models.zeros == ((), tuple(range(6, 12)))
    phi = scales(models.bound)
    conditional = models.coefficients_given(phi)
    log_ratio, restricted = models.restrict(1, conditional, np.ones(len(models.prior_sd)))
    constant = FIXED.with_degree(0).bind(CAMPAIGN)
    log_evidence, posterior = constant.given(phi)
    log_evidence_of_largest, _ = models.bound.given(phi)
    np.testing.assert_allclose(log_ratio, log_evidence - log_evidence_of_largest, atol=1e-8)
    parameters = models.parameters_of(restricted)
    columns = [models.bound.names.index(name) for name in constant.names]
    unit = constant.scale
    np.testing.assert_allclose(parameters.mean[:, columns] / unit, posterior.mean / unit, atol=1e-9)
    np.testing.assert_allclose(
        parameters.covariance[:, columns][:, :, columns] / np.outer(unit, unit),
        posterior.covariance / np.outer(unit, unit),
        atol=1e-9,
    )
    assert not parameters.mean[:, 6:12].any()
    assert not parameters.covariance[:, 6:12].any()


def test_a_narrower_prior_of_slopes_is_that_of_a_model_with_it() -> None:
    """A prior precision of 4 is a prior sd of one half: for slopes, half their stated scale."""
    models = nested()
    phi = scales(models.bound)
    half = FIXED.with_slope_scale(0.5 * FIXED.prior.slope_scale)
    with_half = NestedModels.of(half.bind(CAMPAIGN))
    assert with_half is not None
    expected, _ = with_half.restrict(1, with_half.coefficients_given(phi), np.ones(13 + 6))
    conditional = models.coefficients_given(phi)
    added = np.zeros(len(models.prior_sd))
    added[6:12] = 3.0
    covariance = np.linalg.inv(np.linalg.inv(conditional.covariance) + np.diag(added))
    shift = np.linalg.solve(conditional.covariance, conditional.mean[..., None])
    narrowed = Coefficients((covariance @ shift)[..., 0], covariance)
    log_ratio, _ = models.restrict(1, narrowed, 1.0 + added)
    np.testing.assert_allclose(log_ratio, expected, atol=1e-8)


def test_the_models_are_those_of_average() -> None:
    linear = lb.HybridModel.default(1)
    models = nested(linear)
    assert len(models.zeros) == 2 ** (1 + len(linear.rivals))
    assert len(set(models.zeros)) == len(models.zeros)
    assert models.zeros[0] == ()
    lacking_all = len(models.prior_sd) - (len(models.bound.names) - 6)
    assert len(models.zeros[-1]) == lacking_all


@pytest.mark.parametrize(
    "model", [lb.HybridModel.default(0), lb.HybridModel.default(2), lb.HybridModel.paper(1)]
)
def test_there_is_nothing_to_average(model: lb.HybridModel) -> None:
    assert NestedModels.of(model.bind(CAMPAIGN)) is None


@pytest.mark.slow
@pytest.mark.parametrize("source", ["simulated", "published"])
def test_uncertainties_are_about_those_of_average(source: str) -> None:
    """`average` estimates the compliances anew in every model, and draws: both within 6 %."""
    campaign = CAMPAIGN if source == "simulated" else lb.read_campaign(lb.embedded_campaign())
    linear = lb.HybridModel.default(1)
    evidences = Evidences(campaign)
    nodes = evidences.nodes(linear)[0]
    sds = averaged_sds_now(nodes)
    pair = {"constant": linear.with_degree(0), "linear": linear}
    averaged = lb.average(pair, campaign, evidences=evidences, draws=8000)["posterior"]
    assert set(sds) == {name for name in map(str, averaged.data_vars) if name in sds}
    assert "C_XXX_1" not in sds
    for name, sd in sds.items():
        assert sd == pytest.approx(float(averaged[name].std()), rel=0.06), name
    weight, phi = hyper_parameter_nodes(nodes.bound)
    chosen = np.random.default_rng(1).choice(len(phi), 256, p=weight / weight.sum())
    for name, sd in averaged_sds(nodes.bound, phi[chosen], truncated=False).items():
        assert sd == pytest.approx(sds[name], rel=0.06), name


def test_variances_are_averaged_in_closed_form() -> None:
    """One parameter of two models with weights 1 : 3 at one value of the scales."""
    models = nested()
    conditional = models.coefficients_given(scales(models.bound))
    first, second = models.posteriors(conditional, np.ones(len(models.prior_sd)))
    one = averaged_variances([first._replace(log_ratio=np.zeros(3))], np.zeros(3))
    mean = first.mean.mean(axis=0)
    np.testing.assert_allclose(one, (first.variance + (first.mean - mean) ** 2).mean(axis=0))
    pair = [first._replace(log_ratio=np.zeros(3)), second._replace(log_ratio=np.full(3, np.log(3)))]
    both = averaged_variances(pair, np.array([0.0, -np.inf, -np.inf]))
    gap = first.mean[0] - second.mean[0]
    expected = 0.25 * first.variance[0] + 0.75 * second.variance[0] + 0.25 * 0.75 * gap**2
    np.testing.assert_allclose(both, expected)


def test_moments_without_negative_compliances_by_rejection() -> None:
    """Mean, variance and probability of a model with zero slopes, against rejected draws."""
    models = nested()
    bound = models.bound
    q = len(models.prior_sd)
    rng = np.random.default_rng(2)
    rows = rng.standard_normal((q, q))
    covariance = rows @ rows.T / q
    wide = Coefficients(np.full((1, q), 0.7), covariance[None])
    _, restricted = models.restrict(1, wide, np.ones(q))
    mean, cov = models.parameters_of(restricted)
    inside = truncated_moments(bound, mean, cov)
    root = symmetric_root(cov[0] / np.outer(bound.scale, bound.scale)) * bound.scale[:, None]
    draws = mean[0] + rng.standard_normal((400_000, len(bound.names))) @ root.T
    accepted = draws[bound.truncation.holds(draws)]
    share = len(accepted) / len(draws)
    assert np.exp(inside.log_probability[0]) == pytest.approx(share, abs=5e-3)
    assert len(accepted) > 50_000
    sd = bound.scale
    np.testing.assert_allclose(inside.mean[0] / sd, accepted.mean(axis=0) / sd, atol=0.025)
    np.testing.assert_allclose(inside.variance[0] / sd**2, accepted.var(axis=0) / sd**2, atol=0.03)


def test_moments_are_unchanged_where_compliances_may_be_negative() -> None:
    bound = FIXED.without("truncation").bind(CAMPAIGN)
    p = len(bound.names)
    mean = -np.ones((2, p))
    inside = truncated_moments(bound, mean, np.eye(p))
    assert inside.mean is mean
    np.testing.assert_array_equal(inside.variance, np.ones((2, p)))
    np.testing.assert_array_equal(inside.log_probability, np.zeros(2))


def test_a_root_of_a_singular_covariance_has_no_rounding_errors() -> None:
    covariance = stats.wishart.rvs(9, np.eye(5), random_state=1)
    covariance[2] = 0.0
    covariance[:, 2] = 0.0
    root = symmetric_root(covariance)
    np.testing.assert_allclose(root @ root, covariance, atol=1e-12)
    assert not root[2].any()
    assert not root[:, 2].any()
