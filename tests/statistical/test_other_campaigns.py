"""Radii, directions, planes and drift: calibrated, and the same posterior by joint sampling and by quadrature."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import ldbb_bayes as lb

STUDY = Path(__file__).parents[2] / "studies" / "08_other_campaigns"


@pytest.fixture(scope="module")
def plans() -> ModuleType:
    spec = importlib.util.spec_from_file_location("plans_of_other_campaigns", STUDY / "plans.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.slow
def test_calibrated_with_radii_directions_and_drift(plans: ModuleType) -> None:
    model, plan = plans.everything()
    result = lb.validate(model, plan, replicates=80, draws=49, seed=11)
    assert result.calibrated, result.verdict


@pytest.mark.slow
def test_left_out_hysteresis_is_noticed(plans: ModuleType) -> None:
    """The check can fail: readings with hysteresis, a model without."""
    result = lb.validate(
        plans.MODEL.without("hysteresis"), plans.both_directions(), generator=plans.MODEL, replicates=60, draws=49, seed=12
    )
    assert not result.calibrated


@pytest.mark.slow
@pytest.mark.parametrize("name", ["everything", "three_planes"])
def test_joint_sampling_and_quadrature_agree(plans: ModuleType, name: str) -> None:
    model, plan = plans.everything() if name == "everything" else (plans.MODEL.with_degree(0), plans.three_planes())
    campaign = model.simulate(plan, seed=4).campaign
    exact = lb.marginals(model, campaign)
    posterior = lb.sample(model, campaign, seed=4)
    found = lb.summarize(posterior)
    for parameter in model.bind(campaign).names:
        mean, sd = float(posterior["posterior"][parameter].mean()), float(posterior["posterior"][parameter].std())
        assert abs(mean - exact.loc[parameter, "mean"]) < 0.2 * exact.loc[parameter, "sd"], parameter
        assert sd == pytest.approx(exact.loc[parameter, "sd"], rel=0.12), parameter
    assert np.isfinite(found.select_dtypes("number").to_numpy()).any()
