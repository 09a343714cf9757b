"""Exact evidence against brute force on the dense oracle, to 1e-6; nested Bayes factors by two
routes; marginals; tests left out: campaign properties frozen, replicates as the model has them."""

from __future__ import annotations

import runpy
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from campaigns import TRUTH, oracle_of, plan, refuses, simulated
from oracle import Oracle
from scipy import stats

import ldbb_bayes as lb
from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.evidence import log_prob_truncation
from ldbb_bayes.inference.evidence_value import Evidence
from ldbb_bayes.inference.evidences import Evidences, leave_one_out
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.inference.mcmc import StoppingRule
from ldbb_bayes.inference.nodes import compute_nodes
from ldbb_bayes.inference.prediction import replicate_left_out
from ldbb_bayes.inference.residuals import matrix_to_harmonics
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.orthant import Orthant

FOUR = {
    "C_XXX": (4.4e-5, 4e-6),
    "C_YYY": (5.0e-5, 3e-6),
    "C_CCY": (-2e-10, 4e-10),
    "E_YY1": (-5e-5, 4e-5),
}
PRIORS = FOUR | {"C_XYX": (2e-6, 3e-6), "C_CXY": (3e-8, 3e-8)}
SMALL = lb.HybridModel.first(0).without("ball-form", "setup-shift")
SEEDS = (2, 3, 7, 17, 21, 170, 196, 207, 218, 259, 77, 103, 294)
FORCES_N = (100.0, 400.0, 742.0)


@pytest.fixture(scope="module")
def campaign() -> lb.Campaign:
    return simulated(plan((12, 9, 14), forces_N=FORCES_N), seed=3)


def panels(edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points and weights of the Gauss-Legendre rule of ten points on every panel."""
    nodes, weights = np.polynomial.legendre.leggauss(10)
    half = np.diff(edges) / 2.0
    points = (edges[:-1] + half)[:, None] + half[:, None] * nodes
    return points.ravel(), (half[:, None] * weights).ravel()


def brute_force(oracle: Oracle) -> tuple[float, float]:
    """ln ∫∫ p(y | σ, κ) p(σ) p(κ) [P(T | y, σ, κ) / P(T)] dσ dκ by Gauss-Legendre rules over the
    dense oracle, panel by panel: without and with the factor in brackets."""
    floor = oracle.resolution / np.sqrt(12.0)
    sigma, sigma_weight = panels(np.geomspace(floor, 5e-3, 9))
    kappa, kappa_weight = panels(np.array([0.0, 2e-4, 5e-4, 1e-3, 2e-3, 3.5e-3, 6e-3, 9e-3]))
    log_prior = stats.halfnorm.logpdf(sigma, scale=1e-3) - stats.halfnorm.logsf(floor, scale=1e-3)
    values, physical, doubt = np.zeros((3, len(sigma), len(kappa)))
    for i, s in enumerate(sigma):
        for j, k in enumerate(kappa):
            log_evidence, mean, covariance = oracle.given(np.array([s, k]))
            values[i, j] = log_evidence + stats.halfnorm.logpdf(k, scale=1e-3)
            posterior_sd = np.sqrt(np.diag(covariance))
            distance = (mean / posterior_sd)[[0, 2, 5]]
            doubt[i, j] = stats.norm.sf(distance[:2]).sum()
            physical[i, j] = stats.norm.logcdf(distance[2]) - oracle._log_prob_prior()
    plain = values + (log_prior + np.log(sigma_weight))[:, None] + np.log(kappa_weight)
    total = plain + physical
    assert np.average(doubt, weights=np.exp(total - total.max())) < 1e-8, "C_XXX and C_YYY hold"
    log_plain = np.logaddexp.reduce(plain.ravel())
    log_total = np.logaddexp.reduce(total.ravel())
    return float(log_plain), float(log_total)


@pytest.mark.slow
@pytest.mark.parametrize("priors", [{}, FOUR])
def test_to_a_millionth_of_a_nat(
    campaign: lb.Campaign, priors: dict[str, tuple[float, float]]
) -> None:
    oracle = oracle_of(
        campaign,
        0,
        terms=("length", "mount", "force", "discrepancy"),
        truncated=True,
        given_priors=priors,
    )
    models = (SMALL.without("truncation"), SMALL)
    for model, expected in zip(models, brute_force(oracle), strict=True):
        evidence = lb.log_evidence(model.with_prior(priors), campaign, tolerance=5e-7)
        assert evidence.error < 1e-6
        assert evidence.log_value == pytest.approx(expected, abs=1e-6, rel=0.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("degree", "planned"),
    [(0, plan()), (1, plan((30, 26, 40, 12), arc_deg=250.0, work_deg=35.0))],
)
def test_the_stated_error_holds(degree: int, planned: lb.Campaign) -> None:
    """A loose tolerance against a tight one, arcs and clockings, all four hyper-parameters."""
    bound = lb.HybridModel.first(degree).bind(simulated(planned, seed=degree))
    plain = HyperPosterior(bound, truncated=False)
    loose = compute_nodes(plain, 3e-2).evidence
    tight = compute_nodes(plain, 1e-3).evidence
    assert loose.error <= 3e-2
    assert abs(loose.log_value - tight.log_value) <= loose.error
    assert tight.nodes > loose.nodes


@pytest.mark.slow
def test_the_stated_error_holds_on_campaigns_of_every_kind(root: Path) -> None:
    """A few of the study's; of number 73, P(T | y, φ) once took the error beyond the tolerance."""
    study = runpy.run_path(str(root / "studies" / "90_speed" / "stated_errors.py"))
    comparisons = []
    for seed in SEEDS:
        comparisons += study["compare_with_reference"](seed)
    assert max(comparison.difference for comparison in comparisons) <= 3.0
    assert max(comparison.stated_error for comparison in comparisons) <= 1e-2
    assert lb.log_evidence(*study["campaign_of"](73), tolerance=1e-2).error <= 1e-2


@pytest.mark.slow
def test_the_seed_moves_a_truncated_evidence_by_no_more_than_its_error(
    recovered: lb.Campaign,
) -> None:
    """At degree 2 P(T | y, φ) comes from 256 points: common to all nodes they left the evidence
    with an sd of 0.011 nat."""
    bound = lb.HybridModel.first(2).bind(recovered)
    near = HyperPosterior(bound, truncated=True).mode
    log_values = []
    errors = []
    for seed in range(6):
        nodes = compute_nodes(HyperPosterior(bound, truncated=True, seed=seed, near=near), 3e-2)
        log_values.append(nodes.evidence.log_value)
        errors.append(nodes.error - nodes.integral.error)
    scatter = np.std(log_values, ddof=1)
    assert scatter < 0.006
    assert 0.3 * scatter < np.mean(errors) < 0.01


@pytest.mark.parametrize(
    ("model", "tolerance", "message"),
    [
        (
            lb.HybridModel.paper(0),
            1e-3,
            "must have a proper prior to have an evidence, got a flat one",
        ),
        (SMALL, 0.0, "tolerance must be a positive number of nats, got 0"),
    ],
)
def test_evidences_that_cannot_be_are_refused(
    campaign: lb.Campaign, model: lb.HybridModel, tolerance: float, message: str
) -> None:
    refuses(message, lb.log_evidence, model, campaign, tolerance=tolerance)


def test_a_plan_has_no_evidence() -> None:
    message = "must have readings to give an evidence, got a plan"
    refuses(message, lb.log_evidence, SMALL, plan(), tolerance=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("degree", "without"), [(2, ()), (1, ("setup-shift", "discrepancy"))])
def test_readings_of_the_wrong_sign(
    recovered: lb.Campaign, degree: int, without: tuple[str, ...]
) -> None:
    """All compliances negative and strongly correlated through the mount: far from physical, and
    said so at once."""
    tests = []
    for test in recovered.tests:
        tests.append(test.with_reading_um(-np.asarray(test.reading_um)))
    flipped = replace(recovered, tests=tuple(tests))
    bound = lb.HybridModel.first(degree).without(*without).bind(flipped)
    plain = HyperPosterior(bound, truncated=False)
    truncated = HyperPosterior(bound, truncated=True)
    log_prob, error = log_prob_truncation(truncated)
    assert -2000.0 < log_prob < -50.0
    assert error < 0.5
    highest_truncated = truncated.log_density(truncated.mode[None])[0]
    highest_plain = plain.log_density(plain.mode[None])[0]
    assert highest_truncated < highest_plain - 40.0


UNIFORM = simulated(plan(), seed=1)


@pytest.fixture
def no_weights_trusted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ldbb_bayes.inference.quadrature.LARGEST_LATTICE_DIMENSION", 0)
    monkeypatch.setattr("ldbb_bayes.inference.integrals.LARGEST_PARETO_K", -10.0)


@pytest.mark.slow
@pytest.mark.usefixtures("no_weights_trusted")
def test_an_evidence_whose_weights_cannot_be_trusted_says_so() -> None:
    model = lb.HybridModel.first(0).without("truncation")
    with pytest.warns(RuntimeWarning, match="Sample the posterior with sampler='joint'"):
        evidence = lb.log_evidence(model, UNIFORM, tolerance=0.1)
    assert not evidence.trusted
    assert evidence.error == np.inf


@pytest.mark.slow
@pytest.mark.parametrize("truncated", [False, True])
def test_marginals_whose_weights_cannot_be_trusted_say_so(
    truncated: bool, request: pytest.FixtureRequest
) -> None:
    model = lb.HybridModel.first(0)
    if not truncated:
        model = model.without("truncation")
    exact = lb.inference.marginalize(model, UNIFORM)
    request.getfixturevalue("no_weights_trusted")
    with (
        pytest.warns(RuntimeWarning, match="neither the evidence nor marginals"),
        pytest.warns(RuntimeWarning, match="quantiles of the hyper-parameters"),
    ):
        table = lb.inference.marginalize(model, UNIFORM, tolerance=0.1)
    assert ((table["median"] - exact["median"]) / exact["sd"]).abs().max() < 0.1


def test_equal_models_have_one_entry_each() -> None:
    model = lb.HybridModel.first(0)
    first, second = Evidences(UNIFORM, tolerance=4e-2).nodes(model, model)
    assert first is second


@pytest.mark.slow
@pytest.mark.parametrize("truncated", [False, True])
def test_models_from_the_nodes_of_the_largest(truncated: bool) -> None:
    """Slopes fixed, rescaled, known better: evidence and left-out densities are those of nodes of
    their own."""
    linear = lb.HybridModel.first(1)
    if not truncated:
        linear = linear.without("truncation")
    narrow = replace(linear, prior=replace(linear.prior, overrides={"C_YYY_1": 1e-9}))
    models = [
        linear.with_degree(0),
        linear.fixing("C_XYX_1", "C_YYY_1", "C_CXY_1"),
        linear,
        linear.with_slope_scale(2.0),
        narrow,
    ]
    nodes_of_models = Evidences(UNIFORM, tolerance=4e-2).nodes(*models)
    constant, _, largest, _, narrowest = nodes_of_models
    for nodes in nodes_of_models:
        assert nodes.integral.free is narrowest.integral.free, nodes.integral.error
    for model, nodes in zip(models, nodes_of_models, strict=True):
        posterior = HyperPosterior(model.bind(UNIFORM), truncated=truncated)
        evidence = compute_nodes(posterior, 4e-3).evidence
        difference = nodes.evidence.log_value - evidence.log_value
        assert abs(difference) < min(nodes.error + evidence.error, 0.02)

    left_out = leave_one_out({"constant": constant, "linear": largest})["constant"]
    second_left_out = list(left_out.values())[1]
    posterior = HyperPosterior(second_left_out.bound, truncated=truncated)
    evidence = compute_nodes(posterior, 1e-3).evidence
    difference = second_left_out.evidence.log_value - evidence.log_value
    assert abs(difference) < second_left_out.error + evidence.error

    one_by_one = Evidences(UNIFORM, tolerance=4e-2)
    assert one_by_one.nodes(linear)[0].evidence == largest.evidence, "the largest first"
    for model, nodes in zip(models, nodes_of_models, strict=True):
        assert one_by_one.nodes(model)[0].evidence == nodes.evidence


@pytest.mark.slow
def test_third_edition_from_shared_nodes() -> None:
    """Every model has an estimate Ĉ of its own; from shared nodes, which suit most of the models,
    comes the evidence of nodes of its own."""
    linear = lb.HybridModel.default(1).without("circle-scale")
    models = [linear, linear.with_degree(0), linear.with_rivals(), linear.with_rivals("joint load")]
    nodes_of_models = Evidences(UNIFORM, tolerance=4e-2).nodes(*models)
    estimates = [nodes.bound.estimate.compliances[0] for nodes in nodes_of_models]
    assert len(set(estimates)) == len(models)
    largest = nodes_of_models[0].integral.free
    assert sum(nodes.integral.free is largest for nodes in nodes_of_models) >= 3
    for model, nodes in zip(models, nodes_of_models, strict=True):
        evidence = lb.log_evidence(model, UNIFORM, tolerance=1e-2)
        difference = nodes.evidence.log_value - evidence.log_value
        assert abs(difference) < nodes.error + evidence.error


def test_nodes_that_do_not_suit_are_not_used() -> None:
    """Slopes that the readings need, taken away, move the noise out of reach of the nodes of the
    largest model."""
    truth = TRUTH | {"C_XXX_1": 4e-8, "C_YYY_1": -4e-8}
    linear = lb.HybridModel.first(1).without("truncation", "setup-shift", "discrepancy")
    hyper_um = {"sigma": 0.1, "tau": 0.0}
    simulation = linear.simulate(plan(), seed=2, parameters=truth, hyper_um=hyper_um)
    evidences = Evidences(simulation.campaign, tolerance=1e-2)
    larger, constant = evidences.nodes(linear, linear.with_degree(0))
    evidence = compute_nodes(HyperPosterior(constant.bound, truncated=False), 1e-3).evidence
    assert constant.integral.free is not larger.integral.free
    difference = constant.evidence.log_value - evidence.log_value
    assert abs(difference) < constant.error + evidence.error < 0.02


def test_different_readings_are_refused(campaign: lb.Campaign) -> None:
    evidence = lb.log_evidence(SMALL, campaign)
    other_evidence = Evidence(0.0, 0.0, 1, UNIFORM.sha256)
    with pytest.raises(
        InputError, match="must be between models of the same readings, got two campaigns"
    ):
        lb.inference.log_bayes_factor(other_evidence, evidence)


@pytest.mark.slow
def test_marginals_against_independent_draws() -> None:
    model = lb.HybridModel.first(0)
    campaign = simulated(plan())
    exact = lb.inference.marginalize(model, campaign, tolerance=1e-2)
    tree = lb.sample(model, campaign, sampler="independent", seed=2, rule=StoppingRule(ess=6000.0))
    summary = lb.summarize(tree)
    assert list(exact.index) == list(summary.index)
    assert list(exact["unit"]) == list(summary["unit"])
    error = exact["sd"] / np.sqrt(summary["ess_bulk"])
    assert ((summary["mean"] - exact["mean"]) / error).abs().max() < 4.0
    assert (summary["sd"] / exact["sd"] - 1.0).abs().max() < 0.05
    for column, level in (("median", 0.5), ("ci_low", 0.025), ("ci_high", 0.975)):
        tolerance = 4.0 * np.sqrt(level * (1.0 - level) / 6000.0) + 0.005
        for name, variable in tree["posterior"].data_vars.items():
            share = float((variable.to_numpy() < exact.loc[name, column]).mean())
            assert share == pytest.approx(level, abs=tolerance), (name, column)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"campaign": plan()}, "must be asked of a campaign with readings, got a plan"),
        ({"prob": 95.0}, "prob must be a number between 0 and 1, got 95"),
        ({"tolerance": -1.0}, "tolerance must lie between 0 and 1, got -1"),
    ],
)
def test_marginals_refuse(options: dict[str, Any], message: str) -> None:
    refuses(
        message,
        lb.inference.marginalize,
        lb.HybridModel.first(0),
        **{"campaign": UNIFORM} | options,
    )


@pytest.mark.parametrize("mean", [-40.0, -2.0, 0.0, 1.0, 5.0])
def test_one_truncated_normal_in_closed_form(mean: float) -> None:
    inside = Orthant(np.array([[mean]]), np.array([[[2.0]]])).moments()
    expected = stats.truncnorm(-mean / 2.0, np.inf)
    assert inside.mean[0, 0] == pytest.approx(expected.mean(), rel=1e-5, abs=1e-7)
    assert inside.covariance[0, 0, 0] == pytest.approx(expected.var(), rel=1e-4)
    assert inside.axes[0, 0, 0] == pytest.approx(1.0)
    assert inside.log_probability[0] == pytest.approx(stats.norm.logcdf(mean / 2.0), abs=1e-6)


@pytest.mark.parametrize("rows", [2, 3])
def test_moments_inside_the_orthant_by_rejection(rows: int) -> None:
    rng = np.random.default_rng(rows)
    spread = np.eye(rows, 4) + 0.4 * rng.normal(size=(rows, 4))
    mean = rng.normal(size=rows)
    inside = Orthant(mean[None], spread[None]).moments(1 << 14)
    shift = inside.mean[0]
    axes = inside.axes[0]
    proposals = rng.standard_normal((400_000, 4))
    accepted = proposals[np.all(mean + proposals @ spread.T >= 0.0, axis=1)]
    standard_error = 1.0 / np.sqrt(len(accepted))
    np.testing.assert_allclose(axes.T @ shift, accepted.mean(axis=0), atol=5.0 * standard_error)
    excess = inside.covariance[0] - np.eye(len(shift))
    covariance = np.eye(4) + axes.T @ excess @ axes
    np.testing.assert_allclose(covariance, np.cov(accepted.T), atol=8.0 * standard_error)
    share = len(accepted) / len(proposals)
    share_error = np.sqrt(share * (1.0 - share) / len(proposals))
    assert np.exp(inside.log_probability[0]) == pytest.approx(share, abs=5.0 * share_error)


def test_properties_of_the_campaign_stay_frozen() -> None:
    """F0, force range, Ĉ and the bar lengths are the campaign's: leaving out an end force moves
    none of them."""
    campaign = simulated(plan(work_deg=40.0), seed=1)
    bound = lb.HybridModel.first(1).bind(campaign)
    reduced = bound.keeping(bound.test_names[:-1])
    assert reduced.test_names == bound.test_names[:-1]
    assert reduced.setting.reference_force_N == 389.0
    for name in ("reference_force_N", "force_range_N", "two_balls"):
        assert getattr(reduced.setting, name) == getattr(bound.setting, name)
    np.testing.assert_array_equal(reduced.prior_sd, bound.prior_sd)
    np.testing.assert_array_equal(
        reduced.setting.compliance_estimate, bound.setting.compliance_estimate
    )
    np.testing.assert_array_equal(reduced.truncation.rows, bound.truncation.rows)


def nuisance_names(bound: BoundModel) -> list[str]:
    names: list[str] = []
    for columns in bound.nuisance_columns:
        names.extend(getattr(columns, "names", ()))
    return names


def test_the_length_of_a_bar_stays_when_its_only_test_is_left_out() -> None:
    small = lb.CircularTest(742.0, np.arange(40) * 9.0, radius_mm=100.0, name="small")
    mixed = lb.Campaign((*plan(work_deg=40.0).tests[:3], small))
    bound = lb.HybridModel.first(0).bind(simulated(mixed))
    names = nuisance_names(bound)
    assert names == nuisance_names(bound.keeping(bound.test_names[:3]))
    assert "bar_length_100" in names


class GaussianMoments(NamedTuple):
    mean: np.ndarray
    covariance: np.ndarray


def left_out_harmonics(
    oracle: Oracle, is_left_out: np.ndarray, pseudo_inverse: np.ndarray, phi: np.ndarray
) -> GaussianMoments:
    """Harmonics of the circle left out, given the readings of all others and φ."""
    observed = ~is_left_out
    covariance = oracle.covariance(phi) + (oracle.J * oracle.sd**2) @ oracle.J.T
    crossed = covariance[np.ix_(is_left_out, observed)]
    gain = crossed @ np.linalg.inv(covariance[np.ix_(observed, observed)])
    mean = gain @ oracle.y[observed]
    remaining = covariance[np.ix_(is_left_out, is_left_out)] - gain @ crossed.T
    return GaussianMoments(pseudo_inverse @ mean, pseudo_inverse @ remaining @ pseudo_inverse.T)


@pytest.mark.slow
def test_replicates_are_the_predictive_distribution() -> None:
    """Mean and covariance of harmonics of a left-out circle, at given hyper-parameters, from the
    dense oracle."""
    test = 2
    campaign = simulated(plan(), seed=4)
    model = lb.HybridModel.first(1).without("truncation")
    bound = model.bind(campaign)
    name = bound.test_names[test]
    nodes = compute_nodes(HyperPosterior(bound, truncated=False), 1e-2)
    left_out = leave_one_out({"linear": nodes})["linear"]
    assert tuple(left_out) == bound.test_names
    without_test = left_out[name]
    cold = compute_nodes(HyperPosterior(without_test.bound, truncated=False), 1e-2)
    assert without_test.evidence.log_value == pytest.approx(cold.evidence.log_value, abs=5e-3)
    rng = np.random.default_rng(1)
    replicates = replicate_left_out(bound, without_test, name, 40_000, rng, circles_per_draw=4)

    oracle = oracle_of(campaign, 1)
    sizes = [circle.angle.size for circle in oracle.tests]
    is_left_out = np.repeat(np.arange(len(sizes)) == test, sizes)
    angle = oracle.tests[test].angle
    columns = [np.ones_like(angle)]
    for order in range(1, 13):
        columns += [np.cos(order * angle), np.sin(order * angle)]
    pseudo_inverse = np.linalg.pinv(np.column_stack(columns))
    means = []
    covariances = []
    for free in without_test.integral.resample(60, rng):
        phi = without_test.bound.hyper_prior.phi(free)
        harmonics = left_out_harmonics(oracle, is_left_out, pseudo_inverse, phi)
        means.append(harmonics.mean)
        covariances.append(harmonics.covariance)
    mean = np.mean(means, axis=0)
    sd = np.sqrt(np.diag(np.mean(covariances, axis=0) + np.cov(np.array(means).T)))
    np.testing.assert_allclose(replicates.mean(axis=0) / sd, mean / sd, atol=0.06)
    np.testing.assert_allclose(replicates.std(axis=0), sd, rtol=0.08)
    observed = matrix_to_harmonics(bound, test) @ np.asarray(bound.reduced[test].reading_mm)
    expected = pseudo_inverse @ oracle.tests[test].reading
    np.testing.assert_allclose(observed, expected, atol=1e-12)


def test_readings_that_are_all_zero_have_no_evidence() -> None:
    measured = simulated(plan())
    tests = [replace(test, reading_um=np.zeros(len(test.angle_deg))) for test in measured.tests]
    silent = replace(measured, tests=tuple(tests))
    refuses("readings must not all be zero", lb.log_evidence, lb.HybridModel.first(0), silent)
