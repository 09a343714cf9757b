"""At the real dimension: joint draws, moments and evidence against the dense oracle, truncation on and off."""

from __future__ import annotations

import numpy as np
import pytest
from campaigns import oracle_of, plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.inference.mcmc import StoppingRule

CAMPAIGNS = {
    "3 tests, arcs, both balls turned": plan(
        (30, 26, 28), arc_deg=250.0, forces_N=(100.0, 400.0, 742.0), work_deg=40.0, tool_deg=70.0
    ),
    "4 tests": plan((26, 20, 30, 28)),
    "5 tests": plan((26,) * 5, forces_N=(36.0, 200.0, 400.0, 600.0, 742.0)),
    "7 tests, arcs": plan((24,) * 7, arc_deg=300.0, forces_N=(36.0, 112.0, 238.0, 364.0, 490.0, 616.0, 742.0)),
    "9 tests, repeated forces": plan((25,) * 9, forces_N=(36.0, 36.0, 200.0, 200.0, 400.0, 400.0, 600.0, 742.0, 742.0)),
}
POINTS = 2048


@pytest.mark.slow
@pytest.mark.parametrize("truncated", [False, True])
@pytest.mark.parametrize("name", CAMPAIGNS)
def test_simulated_campaigns(name: str, truncated: bool) -> None:
    campaign = simulated(CAMPAIGNS[name], seed=len(name))
    expected, found = [], []
    for degree in (0, 1):
        model = lb.HybridModel.first(degree)
        found.append(lb.log_evidence(model if truncated else model.without("truncation"), campaign).log_value)
        value, error = oracle_of(campaign, degree, truncated=truncated).log_evidence(points=POINTS, seed=1)
        assert error < 0.01
        expected.append(value)
    assert found[1] - found[0] == pytest.approx(expected[1] - expected[0], abs=0.02)
    assert found == pytest.approx(expected, abs=0.02, rel=0.0)


CASES = {
    "full circles": plan((40, 40, 40, 40)),
    "arcs": plan((30, 40, 35, 30), arc_deg=220.0),
    "few, unequal": plan((9, 40, 12, 30)),
    "few, unequal arcs": plan((9, 40, 12, 30), arc_deg=220.0),
    "one ball clocked": plan((40, 40, 40, 40), work_deg=40.0),
    "both balls clocked": plan((40, 30, 9, 26), work_deg=40.0, tool_deg=-65.0),
}


def reference(campaign: lb.Campaign, degree: int, **options: object) -> tuple[np.ndarray, np.ndarray]:
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
    """With the mount left out of the oracle the agreement breaks: the comparison can see a wrong answer."""
    campaign = simulated(CASES["full circles"])
    mean, sd = reference(campaign, 0, terms=("form", "length", "force", "setup", "discrepancy"))
    found_mean, found_sd = sampled(campaign, lb.HybridModel.first(0))
    assert max(np.abs((found_mean - mean) / sd).max() / 0.1, np.abs(found_sd / sd - 1.0).max() / 0.05) > 1.0
