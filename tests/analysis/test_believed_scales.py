"""Scales that the analysis of planned tests believes in: information about them, and beliefs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr

import ldbb_bayes as lb
from ldbb_bayes.analysis.design.believed_scales import (
    _ScoresBefore,
    believed_scales,
    fisher_information,
)
from ldbb_bayes.analysis.design.simulated_analyses import simulate_analyses
from ldbb_bayes.analysis.design.states import extend_hyper_parameters
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.inference.nodes import compute_nodes
from tests.campaigns import oracle_of, plan, simulated

FIRST = lb.HybridModel.first(1)


def test_levels_are_the_inverse_of_quantiles(rng: np.random.Generator) -> None:
    prior = lb.HybridModel.default(1).bind(plan((60,) * 4)).hyper_prior
    levels = rng.uniform(0.01, 0.99, (20, len(prior.names)))
    np.testing.assert_allclose(prior.level(prior.quantile(levels)), levels, atol=1e-9)


def test_information_is_that_of_the_dense_covariance() -> None:
    """I_ij = ½ tr(V⁻¹ ∂_iV V⁻¹ ∂_jV) of all readings, with the covariance V of the oracle."""
    campaign = simulated(plan((30,) * 4))
    bound = FIRST.bind(campaign)
    oracle = oracle_of(campaign, 1)
    prior_sd = oracle.J * oracle.sd
    scores = np.array([-1.0, -0.3, -0.5, 0.2])
    step = 0.1

    def covariance(normal_scores: np.ndarray) -> np.ndarray:
        phi = bound.hyper_prior.quantile(ndtr(normal_scores[None]))[0]
        return oracle.covariance(phi) + prior_sd @ prior_sd.T

    precision = np.linalg.inv(covariance(scores))
    products = []
    for axis in step * np.eye(4):
        slope = (covariance(scores + axis) - covariance(scores - axis)) / (2.0 * step)
        products.append(precision @ slope)
    dense = 0.5 * np.einsum("iab,jba->ij", products, products)
    information = fisher_information(bound, scores[None])[0]
    np.testing.assert_allclose(information, dense, rtol=1e-6)


def test_information_of_several_machines_is_that_of_each_alone(rng: np.random.Generator) -> None:
    """They are computed by several threads, in any order."""
    bound = lb.HybridModel.default(1).bind(plan())
    scores = rng.standard_normal((6, len(bound.hyper_prior.names)))
    together = fisher_information(bound, scores)
    for k in range(len(scores)):
        np.testing.assert_allclose(together[k], fisher_information(bound, scores[k : k + 1])[0])


@pytest.mark.parametrize("machines", [2, 6, 100])
def test_correlations_of_few_draws_are_shrunk(machines: int) -> None:
    """Of K draws of two scores that are always equal, the correlation is K / (K + 2), not 1."""
    scores = np.linspace(-1.0, 3.0, machines)
    before = _ScoresBefore.of(np.stack([scores, scores], axis=1), tests_run=1)
    covariance = before.root @ before.root.T
    np.testing.assert_allclose(before.mean, 1.0, rtol=1e-12)
    np.testing.assert_allclose(np.diag(covariance), scores.var(ddof=1), rtol=1e-12)
    correlation = covariance[0, 1] / covariance[0, 0]
    assert correlation == pytest.approx(machines / (machines + 2), rel=1e-12)


def test_of_many_circles_the_form_of_the_balls_is_not_known() -> None:
    """One circle more than 24 tells hardly more about it, and nothing makes it known at once."""
    model = lb.HybridModel.default(1)
    spread = []
    for circles in (24, 26):
        bound = model.bind(plan((40,) * circles, forces_N=tuple(np.linspace(36, 742, circles))))
        names = list(bound.hyper_prior.names)
        phi = np.tile(bound.hyper_prior.quantile(np.full((1, len(names)), 0.5)), (16, 1))
        scales = believed_scales(bound, phi, 8, 1)
        tau = np.log(scales[..., names.index("tau")])
        spread.append(tau.std())
        factors = [k for k, name in enumerate(names) if name.startswith("lambda")]
        is_known = (scales[..., factors] == phi[:, None, factors]).all(axis=(0, 1))
        assert is_known.sum() == max(0, circles - 24)
    assert spread[1] == pytest.approx(spread[0], rel=0.2)
    assert spread[0] > 0.1


@pytest.mark.slow
def test_information_against_the_scatter_of_the_score(rng: np.random.Generator) -> None:
    """The Fisher information is the covariance of the gradient of the log density, here found by
    differences in 400 simulated campaigns."""
    planned = plan((30,) * 4)
    bound = FIRST.bind(planned)
    scores = np.array([-1.0, -0.3, -0.5, 0.2])
    phi = bound.hyper_prior.quantile(ndtr(scores))
    step = 0.05
    around = [scores + sign * step * axis for axis in np.eye(4) for sign in (1.0, -1.0)]
    points = bound.hyper_prior.quantile(ndtr(np.array(around)))
    hyper_um = bound.hyper_prior.display_values(phi)
    gradients = []
    for seed in range(400):
        beta = bound.prior_sd * rng.standard_normal(len(bound.names))
        parameters = dict(zip(bound.names, beta.tolist(), strict=True))
        campaign = FIRST.without("truncation").simulate(
            planned, seed=seed, parameters=parameters, hyper_um=hyper_um
        )
        heights = FIRST.bind(campaign.campaign).log_evidence(points)
        gradients.append((heights[0::2] - heights[1::2]) / (2.0 * step))
    information = fisher_information(bound, scores[None])[0]
    scatter = np.cov(np.array(gradients).T)
    root = np.linalg.inv(np.linalg.cholesky(information))
    np.testing.assert_allclose(root @ scatter @ root.T, np.eye(4), atol=0.35)


def test_beliefs_are_the_prior_where_readings_say_nothing() -> None:
    """Two circles of 9 readings, each with noise as large as it may be, tell nearly nothing of the
    smallest scale."""
    bound = FIRST.bind(plan((9,) * 2, forces_N=(36.0, 742.0)))
    scores = np.array([2.0, -1.5, -1.5, 0.0])
    phi = np.tile(bound.hyper_prior.quantile(ndtr(scores)), (400, 1))
    believed = bound.hyper_prior.level(believed_scales(bound, phi, 4, 1))
    assert believed[..., 2].mean() == pytest.approx(0.5, abs=0.1)
    assert believed[..., 2].std() == pytest.approx(np.sqrt(1.0 / 12.0), abs=0.08)


@pytest.mark.slow
def test_beliefs_are_true_after_many_circles() -> None:
    bound = FIRST.bind(plan((360,) * 20, forces_N=np.linspace(36.0, 742.0, 20).tolist()))
    scores = np.array([-0.5, -0.3, 0.2, 0.4])
    phi = np.tile(bound.hyper_prior.quantile(ndtr(scores)), (20, 1))
    believed = believed_scales(bound, phi, 4, 1)
    ratio = believed / phi[:, None]
    np.testing.assert_allclose(ratio.mean(axis=(0, 1)), 1.0, atol=0.15)


@pytest.mark.slow
def test_what_circles_run_so_far_show_counts_in_the_belief_about_scales() -> None:
    """One more circle in the same direction hardly shows more of hysteresis: the belief about its
    size stays the posterior of the circles run so far, not the prior."""
    model = lb.HybridModel.default(1)
    pilot = lb.read_campaign(lb.embedded_campaign())
    goals = {"E_C0YX": "10 µrad"}
    step = lb.analysis.next_circle(
        model,
        pilot,
        goals=goals,
        forces_N=(36.0,),
        directions=("CW", "CCW"),
        clockings_deg=((90.0, 90.0),),
    )
    template = step.plan()
    clockwise = tuple(replace(test, direction="CW") for test in template.tests)
    plan = replace(template, tests=clockwise)
    analyses = simulate_analyses(model, plan, machines=256)
    bound = analyses.bound
    column = bound.names.index("E_C0YX")
    believed = analyses.covariance[:, :, column, column].mean() * bound.scale[column] ** 2

    assert plan.pilot is not None
    posterior = HyperPosterior(model.bind(plan.pilot), truncated=True)
    free = compute_nodes(posterior, 0.1).integral.resample(512, np.random.default_rng(1))
    phi = extend_hyper_parameters(bound, posterior.bound.hyper_prior.phi(free), len(pilot.tests))
    exact = (bound.given(phi)[1].sd[:, column] ** 2).mean()
    np.testing.assert_allclose(np.sqrt(believed), np.sqrt(exact), rtol=0.15)
