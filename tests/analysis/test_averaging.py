"""Averages over models: moments, what reads a posterior reads them, refusals."""

from __future__ import annotations

import itertools
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray as xr
from campaigns import plan, refuses, simulated
from oracle import compliance_columns, geometric_columns
from scipy import stats

import ldbb_bayes as lb
from ldbb_bayes.analysis.averaging import _averaged_prior, _WeightedModels
from ldbb_bayes.inference.evidence import probabilities
from ldbb_bayes.inference.posterior import curves_of, fit_of, model_draws_of, record_of
from ldbb_bayes.inference.summary import result_json
from ldbb_bayes.model.hybrid import BoundModel

DRAWS = 8000
CAMPAIGN = simulated(plan((30,) * 4), seed=1)
LINEAR = lb.HybridModel.default(1).without("ball-form", "setup-shift", "mount", "angle", "position")
PAIR = {"constant": LINEAR.with_degree(0), "linear": LINEAR}
# Number of C_XXX_1 among the parameters.
SLOPE = 6
SUBSETS_OF_RIVALS = ((), ("joint load",), ("curved force law",), LINEAR.rivals)


@pytest.fixture(scope="module")
def averaged() -> xr.DataTree:
    return lb.average(PAIR, CAMPAIGN, draws=DRAWS, evidences=lb.inference.Evidences(CAMPAIGN))


def test_the_rivals_of_slopes() -> None:
    assert LINEAR.rivals == ("joint load", "curved force law")


@pytest.mark.slow
def test_moments_are_those_of_every_model_by_its_probability(averaged: xr.DataTree) -> None:
    posteriors = []
    log_evidence = []
    for model, names in itertools.product(PAIR.values(), SUBSETS_OF_RIVALS):
        variant = model.with_rivals(*names)
        tree = lb.sample(variant, CAMPAIGN, sampler="independent", seed=3)
        posteriors.append(tree["posterior"])
        log_evidence.append(lb.log_evidence(variant, CAMPAIGN, tolerance=1e-2).log_value)
    shares = probabilities(np.array(log_evidence))
    assert (shares > 0.03).sum() > 4, "a test in which most models count"
    group = averaged["posterior"]
    for name in map(str, group.data_vars):
        means = np.zeros(len(posteriors))
        variances = np.zeros(len(posteriors))
        for k, posterior in enumerate(posteriors):
            if name in posterior:
                means[k] = posterior[name].values.mean()
                variances[k] = posterior[name].values.var()
        mean = shares @ means
        sd = np.sqrt(shares @ (variances + (means - mean) ** 2))
        tolerance = 0.25 if name.startswith("lambda") else 0.06  # long tails
        assert group[name].values.mean() == pytest.approx(mean, abs=0.06 * sd), name
        assert group[name].values.std() == pytest.approx(sd, rel=tolerance), name
    probability = record_of(averaged)["averaged"]["probability"]["linear"]
    assert probability == pytest.approx(shares[4:].sum(), abs=0.01)


def test_zero_slopes_are_as_frequent_as_constant_models(averaged: xr.DataTree) -> None:
    probability = record_of(averaged)["averaged"]["probability"]["linear"]
    zeros = (averaged["posterior"]["C_XXX_1"].values == 0.0).mean()
    assert zeros == pytest.approx(1.0 - probability, abs=2.0 / DRAWS)


def white_noise_design(bound: BoundModel) -> np.ndarray:
    """Return the columns of compliances, slopes and geometric errors, by their definitions."""
    blocks = []
    for test in bound.campaign.tests:
        angle = test.angles_rad()
        radius = np.full(len(angle), 150.0)
        assert test.force_N is not None
        elastic = test.force_N * compliance_columns(angle, radius)
        lever = test.force_N - bound.setting.reference_force_N
        blocks.append(np.hstack([elastic, lever * elastic, geometric_columns(angle, radius)]))
    return np.vstack(blocks)


def test_moments_in_closed_form() -> None:
    """Without nuisances and truncation: a dense Gaussian given σ, and σ summed over a grid."""
    plain = lb.HybridModel(1, (), lb.HybridModel.default().without("truncation").prior)
    campaign = simulated(plan((30, 30, 30), forces_N=(36.0, 400.0, 742.0)), seed=2)
    models = {"constant": plain.with_degree(0), "linear": plain}
    posterior = lb.average(models, campaign, draws=DRAWS)
    bound = plain.bind(campaign)
    columns = white_noise_design(bound)
    y = np.concatenate([test.readings_mm() for test in campaign.tests])
    sigmas = np.linspace(1e-4, 0.02, 400)
    sigma_density = np.exp(bound.hyper_prior.log_density(sigmas[:, None]))
    is_constant = np.array(["_1" not in name for name in bound.names])
    log_weights = []
    means = []
    squares = []
    for is_free in (is_constant, np.ones(len(bound.names), dtype=bool)):
        sd = bound.prior_sd * is_free
        design = columns * sd
        for sigma, density in zip(sigmas, sigma_density, strict=True):
            covariance = design @ design.T + sigma**2 * np.eye(len(y))
            log_likelihood = stats.multivariate_normal(cov=covariance).logpdf(y)
            gain = np.linalg.solve(covariance, design).T
            mean = sd * (gain @ y)
            variance = sd**2 * (1.0 - np.einsum("pn,np->p", gain, design))
            log_weights.append(np.log(density) + log_likelihood)
            means.append(mean)
            squares.append(variance + mean**2)
    weights = probabilities(np.array(log_weights))
    probability = record_of(posterior)["averaged"]["probability"]["linear"]
    assert probability == pytest.approx(weights[len(sigmas) :].sum(), abs=0.005)
    mean = weights @ means
    sd = np.sqrt(weights @ squares - mean**2)
    table = lb.summarize(posterior).loc[list(bound.names)]
    group = posterior["posterior"]
    nonzero = np.array([(group[name].values != 0.0).sum() for name in bound.names])
    assert (np.abs(table["mean"] - mean) / sd < 4.0 / np.sqrt(DRAWS)).all()
    assert (np.abs(table["sd"] / sd - 1.0) < 3.0 / np.sqrt(nonzero)).all()


# What reads a posterior reads an average


@pytest.fixture(scope="module")
def loaded(averaged: xr.DataTree, tmp_path_factory: pytest.TempPathFactory) -> xr.DataTree:
    """Return the average, saved and loaded."""
    path = tmp_path_factory.mktemp("averaging") / "posterior.nc"
    lb.save(averaged, path)
    return lb.load(path)


def test_the_record_of_a_loaded_average(loaded: xr.DataTree) -> None:
    record = result_json(loaded)
    assert record["averaged"]["probability"].keys() == {"constant", "linear", *LINEAR.rivals}
    assert fit_of(loaded).state == "usable"
    assert record["sampler"]["converged"]
    assert record["sampler"]["ess_bulk_min"] > 0.8 * DRAWS


def test_priors_are_averaged_too(loaded: xr.DataTree) -> None:
    slope = lb.summarize(loaded).loc["C_XXX_1"]
    assert 0.0 < slope["sd"] < slope["prior_sd"]
    # Each model sizes the prior of its slopes by its own estimate of the machine. Slopes of the
    # constant models, which are half of all models, are zero.
    variances = []
    for names in SUBSETS_OF_RIVALS:
        variances.append(LINEAR.with_rivals(*names).bind(CAMPAIGN).prior_sd[SLOPE] ** 2)
    assert slope["prior_sd"] == pytest.approx(np.sqrt(np.mean(variances) / 2.0))


def test_analyses_read_an_average(loaded: xr.DataTree) -> None:
    parameters = set(result_json(loaded)["parameters"])
    assert lb.analysis.judge_posterior(loaded).keys() == parameters
    assert lb.analysis.budget_uncertainty(loaded).keys() == parameters
    assert np.isfinite(lb.analysis.predict_circularity(loaded)["sd"]).all()
    nuisances = lb.inference.summarize_nuisances(loaded)
    assert nuisances.loc["joint_load_X_slope", "sd"] > 0.0
    assert nuisances.loc["force_curvature", "sd"] > 0.0


def test_compliance_is_constant_without_slopes_and_joint_load(loaded: xr.DataTree) -> None:
    """What the joint load adds to C(F) is of the models that have it alone."""
    curves = curves_of(loaded, np.array([36.0, 742.0]))
    changes = np.abs(curves[:, 1, 0] - curves[:, 0, 0]) > 0.0
    is_constant = []
    for draws in model_draws_of(loaded):
        without_joint_load = "joint load" not in draws.bound.model.rivals
        is_constant.append((draws.beta[:, SLOPE] == 0.0) & without_joint_load)
    np.testing.assert_array_equal(changes, ~np.concatenate(is_constant))


# What is refused


def test_models_that_are_not_nested_are_refused() -> None:
    constant = LINEAR.with_degree(0).without("joint-load", "discrepancy")
    refuses(
        r"models must be nested, .*linear.with_degree\(0\)",
        lb.average,
        {"constant": constant, "linear": LINEAR},
        CAMPAIGN,
    )


def test_too_few_draws_are_refused() -> None:
    refuses(r"draws must be at least 400, got 10\.", lb.average, PAIR, CAMPAIGN, draws=10)


def test_a_posterior_is_refused() -> None:
    refuses(
        r"models must be HybridModels by name, .*got DataTree\. Give for example \{",
        lb.average,
        lb.sample(LINEAR, CAMPAIGN, sampler="independent"),
        CAMPAIGN,
    )


def test_evidences_of_another_campaign_are_refused() -> None:
    refuses(
        r"evidences must be of the campaign .*Evidences\(campaign\)",
        lb.average,
        PAIR,
        CAMPAIGN,
        evidences=lb.inference.Evidences(simulated(plan((30,) * 4), seed=2)),
    )


@pytest.mark.parametrize(
    ("probability", "error", "expected"),
    [((0.5, 0.5), 0.1, 0.025), ((0.995, 0.005), 0.2, 0.0011), ((0.9995, 0.0005), 9.0, 0.80)],
)
def test_an_error_counts_by_what_it_does_to_a_probability(
    probability: tuple[float, float], error: float, expected: float
) -> None:
    nodes = [SimpleNamespace(evidence=SimpleNamespace(error=error)) for _ in probability]
    weighted = _WeightedModels((), tuple(nodes), np.array(probability), None)
    assert weighted.probability_error == pytest.approx(expected, rel=0.02)
    changes = []
    for sign in (-1.0, 1.0):
        evidence = probability[1] * np.exp(sign * error)
        changes.append(abs(evidence / (evidence + probability[0]) - probability[1]))
    assert weighted.probability_error == pytest.approx(max(changes))


def test_an_infinite_error_or_a_single_model() -> None:
    infinite = SimpleNamespace(evidence=SimpleNamespace(error=np.inf))
    exact = SimpleNamespace(evidence=SimpleNamespace(error=0.01))
    both = _WeightedModels((), (infinite, exact), np.array([0.9, 0.1]), None)
    assert both.probability_error == pytest.approx(0.9)
    alone = _WeightedModels((), (exact,), np.array([1.0]), None)
    assert alone.probability_error == 0.0


def test_the_prior_of_an_average_has_the_moments_of_draws_from_either_model() -> None:
    """A stated compliance keeps its prior; a slope that one of two models lacks is zero in half."""
    linear = LINEAR.with_prior(C_XXX=("60 nm/N", "5 nm/N"))
    bounds = [linear.with_degree(0).bind(CAMPAIGN), linear.bind(CAMPAIGN)]
    weighted: Any = SimpleNamespace(bound=bounds[1], bounds=bounds, nodes=[None, None])
    prior_sd = _averaged_prior(weighted, {})["prior_sd"]
    assert prior_sd["C_XXX"] == pytest.approx(5e-6)
    rng = np.random.default_rng(4)
    slope = rng.normal(0.0, bounds[1].prior_sd[SLOPE], 200_000) * (rng.random(200_000) < 0.5)
    assert prior_sd["C_XXX_1"] == pytest.approx(slope.std(), rel=0.01)
