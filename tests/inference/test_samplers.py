"""Collapsed and quadrature sampling: the same posterior as the joint sampler, by other routes."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from campaigns import plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.inference.origin import bound_of, draws_of, record_of
from ldbb_bayes.inference.stopping import StoppingRule

QUICK = StoppingRule(ess=150.0, rhat=1.1, lengths=0.3)


def moments(tree: xr.DataTree) -> tuple[np.ndarray, np.ndarray]:
    draws = np.array([variable.to_numpy().ravel() for variable in tree["posterior"].data_vars.values()])
    return draws.mean(axis=1), draws.std(axis=1)


@pytest.mark.parametrize("sampler", ["collapsed", "quadrature"])
def test_same_layout_as_the_joint_sampler(sampler: str) -> None:
    campaign, model = simulated(plan()), lb.HybridModel.default(0)
    tree, joint = (lb.sample(model, campaign, sampler=kind, seed=2, rule=QUICK) for kind in (sampler, "joint"))
    assert set(tree.children) == set(joint.children)
    for group in tree.children:
        assert list(tree[group].data_vars) == list(joint[group].data_vars)
    assert record_of(tree)["sampler"]["kind"] == sampler
    assert record_of(tree)["sampler"]["converged"]
    bound = bound_of(tree)
    beta, _ = draws_of(tree, bound)
    assert bound.truncation.holds(beta).all()
    again = lb.sample(model, campaign, sampler=sampler, seed=2, rule=QUICK)
    assert again["posterior"].dataset.drop_attrs().equals(tree["posterior"].dataset.drop_attrs())


@pytest.mark.parametrize("sampler", ["collapsed", "quadrature"])
@pytest.mark.parametrize("model", [lb.HybridModel.paper(0), lb.HybridModel.default(0).without("truncation", "ball-form")])
def test_models_without_truncation(sampler: str, model: lb.HybridModel) -> None:
    tree = lb.sample(model, simulated(plan()), sampler=sampler, seed=1, rule=QUICK)
    joint = lb.sample(model, simulated(plan()), seed=1, rule=QUICK)
    mean, sd = moments(joint)
    assert np.abs((moments(tree)[0] - mean) / sd).max() < 0.3


@pytest.mark.parametrize("sampler", ["collapsed", "quadrature"])
def test_no_acceptance_rate_hangs_it(sampler: str, recovered: lb.Campaign) -> None:
    """ln P(T | y) = −1311: draws inside all the same."""
    model = lb.HybridModel.default(0).without("ball-form", "discrepancy", "setup-shift")
    tree = lb.sample(model, recovered, sampler=sampler, seed=1, rule=StoppingRule(ess=200.0, rhat=1.1, lengths=0.5))
    assert record_of(tree)["fit"]["log_prob_truncation"] == pytest.approx(-1311.03, abs=0.1)
    assert tree["posterior"]["C_CCY"].to_numpy().min() >= 0.0
