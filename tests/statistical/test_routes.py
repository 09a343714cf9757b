"""At the real dimension: joint and independent draws against the exact marginals (recovered
experiment, 20 simulated campaigns, drift, planes) and against the dense oracle."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from arviz_stats import mcse
from campaigns import HYPER_UM, TRUTH, oracle_of, plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.inference.mcmc import StoppingRule

PLANS = {
    "circles": plan(),
    "arcs": plan((30, 40, 35, 30), arc_deg=220.0),
    "work ball clocked": plan(work_deg=40.0),
    "both balls clocked, arcs": plan((40, 30, 9, 26), work_deg=40.0, tool_deg=-65.0, arc_deg=300.0),
    "few readings": plan((9, 40, 12, 30)),
}
MODELS = {
    "constant": lb.HybridModel.first(0),
    "linear": lb.HybridModel.first(1),
    "constant without ball form": lb.HybridModel.first(0).without("ball-form"),
    "linear without truncation": lb.HybridModel.first(1).without("truncation"),
}
RULE = StoppingRule(ess=5000.0)


def differences(
    model: lb.HybridModel, campaign: lb.Campaign, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return mean − exact and sd − exact of both samplers, in Monte Carlo errors.

    The Monte Carlo error of a standard deviation is ArviZ's: it is larger where the tails are
    heavy, as those of a scale are.
    """
    exact = lb.inference.marginalize(model, campaign)
    of_means = []
    of_sds = []
    for sampler in ("joint", "independent"):
        fit = lb.sample(model, campaign, sampler=sampler, seed=seed, rule=RULE)
        summary = lb.summarize(fit)
        errors_of_sds = mcse(fit, method="sd")
        for name, row in summary.iterrows():
            mean_error = exact["sd"][name] / np.sqrt(row["ess_bulk"])
            of_means.append((row["mean"] - exact["mean"][name]) / mean_error)
            of_sds.append((row["sd"] - exact["sd"][name]) / float(errors_of_sds[name]))
    return np.array(of_means), np.array(of_sds)


@pytest.mark.slow
@pytest.mark.parametrize("degree", [0, 1])
def test_recovered_experiment(recovered: lb.Campaign, degree: int) -> None:
    for z in differences(lb.HybridModel.first(degree), recovered, 1):
        assert np.abs(z).max() < 4.0
        assert np.mean(np.abs(z) > 3.0) < 0.02


@pytest.mark.slow
def test_simulated_campaigns() -> None:
    """Five plans, four models. Of some seven hundred differences of either kind a few pass three
    Monte Carlo errors by chance."""
    z_of_means = []
    z_of_sds = []
    for k, planned in enumerate(PLANS.values()):
        campaign = (
            lb.HybridModel.first(0)
            .simulate(planned, seed=k, parameters=TRUTH, hyper_um=HYPER_UM)
            .campaign
        )
        for model in MODELS.values():
            of_means, of_sds = differences(model, campaign, k)
            z_of_means.append(of_means)
            z_of_sds.append(of_sds)
    for z in (np.concatenate(z_of_means), np.concatenate(z_of_sds)):
        assert len(z) > 700
        assert np.abs(z).max() < 4.5
        assert np.mean(np.abs(z) > 3.0) < 0.01


@pytest.fixture(scope="module")
def plans() -> ModuleType:
    sys.path.insert(0, str(Path(__file__).parents[2] / "studies" / "08_other_campaigns"))
    return importlib.import_module("plans")


@pytest.mark.slow
def test_calibrated_with_radii_directions_and_drift(plans: ModuleType) -> None:
    model, plan = plans.everything()
    result = lb.calibrate(model, plan, replicates=80, draws=49, seed=11)
    assert result.calibrated, result.outside


@pytest.mark.slow
def test_left_out_hysteresis_is_noticed(plans: ModuleType) -> None:
    """The check can fail: readings with hysteresis, a model without."""
    result = lb.calibrate(
        plans.MODEL.without("hysteresis"),
        plans.both_directions(),
        generator=plans.MODEL,
        replicates=60,
        draws=49,
        seed=12,
    )
    assert not result.calibrated


# ---- against the dense oracle

CASES = {
    "full circles": plan((40, 40, 40, 40)),
    "arcs": plan((30, 40, 35, 30), arc_deg=220.0),
    "few, unequal": plan((9, 40, 12, 30)),
    "few, unequal arcs": plan((9, 40, 12, 30), arc_deg=220.0),
    "one ball clocked": plan((40, 40, 40, 40), work_deg=40.0),
    "both balls clocked": plan((40, 30, 9, 26), work_deg=40.0, tool_deg=-65.0),
}


def reference(
    campaign: lb.Campaign, degree: int, **options: object
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and sd of (β, φ) from the oracle."""
    x, weight = oracle_of(campaign, degree, **options).posterior(points=15_000, draws=10, seed=11)
    mean = weight @ x
    return mean, np.sqrt(weight @ (x - mean) ** 2)


def sampled(campaign: lb.Campaign, model: lb.HybridModel) -> tuple[np.ndarray, np.ndarray]:
    tree = lb.sample(model, campaign, seed=2, rule=StoppingRule(ess=3500.0, max_steps=60_000))
    x = np.array([variable.to_numpy().ravel() for variable in tree["posterior"].data_vars.values()])
    return x.mean(axis=1), x.std(axis=1)


@pytest.mark.slow
@pytest.mark.parametrize("degree", [0, 1])
@pytest.mark.parametrize("case", CASES)
def test_means_and_sds(case: str, degree: int) -> None:
    campaign = simulated(CASES[case])
    mean, sd = reference(campaign, degree)
    found_mean, found_sd = sampled(campaign, lb.HybridModel.first(degree))
    np.testing.assert_allclose((found_mean - mean) / sd, 0.0, atol=0.1)
    np.testing.assert_allclose(found_sd / sd, 1.0, atol=0.05)


@pytest.mark.slow
def test_a_wrong_model_fails_the_same_comparison() -> None:
    """With the mount left out of the oracle the agreement breaks: the comparison can see a wrong
    answer."""
    campaign = simulated(CASES["full circles"])
    mean, sd = reference(campaign, 0, terms=("form", "length", "force", "setup", "discrepancy"))
    found_mean, found_sd = sampled(campaign, lb.HybridModel.first(0))
    assert (
        max(np.abs((found_mean - mean) / sd).max() / 0.1, np.abs(found_sd / sd - 1.0).max() / 0.05)
        > 1.0
    )
