"""The joint sampler against the dense oracle: means within 0.1 sd, sds within 5 %, every parameter and hyper-parameter."""

from __future__ import annotations

import numpy as np
import pytest
from campaigns import oracle_of, plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.inference.stopping import StoppingRule

CASES = {
    "full circles": plan((40, 40, 40, 40)),
    "arcs": plan((30, 40, 35, 30), arc_deg=220.0),
    "few, unequal": plan((9, 40, 12, 30)),
    "few, unequal arcs": plan((9, 40, 12, 30), arc_deg=220.0),
    "one ball clocked": plan((40, 40, 40, 40), work_deg=40.0),
    "both balls clocked": plan((40, 30, 9, 26), work_deg=40.0, tool_deg=-65.0),
}


def reference(campaign: Campaign, degree: int, **options: object) -> tuple[np.ndarray, np.ndarray]:
    """Mean and sd of (β, φ) from the oracle."""
    weighted = oracle_of(campaign, degree, **options).posterior(points=15_000, draws=10, seed=11)
    x = np.hstack([weighted["beta"], np.exp(weighted["log_phi"])])
    weight = weighted["weight"][:, None]
    mean = (weight * x).sum(axis=0)
    return mean, np.sqrt((weight * (x - mean) ** 2).sum(axis=0))


def sampled(campaign: Campaign, model: lb.HybridModel) -> tuple[np.ndarray, np.ndarray]:
    tree = lb.sample(model, campaign, seed=2, rule=StoppingRule(ess=3500.0, max_steps=60_000))
    x = np.array([variable.to_numpy().ravel() for variable in tree["posterior"].data_vars.values()])
    return x.mean(axis=1), x.std(axis=1)


@pytest.mark.slow
@pytest.mark.parametrize("degree", [0, 1])
@pytest.mark.parametrize("case", CASES)
def test_means_and_sds(case: str, degree: int) -> None:
    campaign = simulated(CASES[case])
    mean, sd = reference(campaign, degree)
    found_mean, found_sd = sampled(campaign, lb.HybridModel.default(degree))
    np.testing.assert_allclose((found_mean - mean) / sd, 0.0, atol=0.1)
    np.testing.assert_allclose(found_sd / sd, 1.0, atol=0.05)


@pytest.mark.slow
def test_a_wrong_model_fails_the_same_comparison() -> None:
    """With the mount left out of the oracle the agreement breaks: the comparison can see a wrong answer."""
    campaign = simulated(CASES["full circles"])
    mean, sd = reference(campaign, 0, terms=("form", "length", "force", "setup", "discrepancy"))
    found_mean, found_sd = sampled(campaign, lb.HybridModel.default(0))
    assert max(np.abs((found_mean - mean) / sd).max() / 0.1, np.abs(found_sd / sd - 1.0).max() / 0.05) > 1.0
