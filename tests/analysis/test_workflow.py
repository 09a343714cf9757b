"""Checks of a Bayesian workflow: against answers known otherwise, and failing once each."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from campaigns import plan, refuses, simulated
from scipy.optimize import minimize_scalar

import ldbb_bayes as lb
from ldbb_bayes.analysis.workflow import Workflow, check_workflow, stacking_weights
from ldbb_bayes.inference.prior_prediction import prior_circles
from ldbb_bayes.report import wording

CONSTANT = lb.HybridModel.first(0)


def test_stacking_weights_maximise_the_mean_log_density() -> None:
    log_densities = {
        "constant": np.array([1.0, 2.0, 0.5, 3.0]),
        "linear": np.array([1.5, 1.0, 0.8, 2.0]),
    }

    def negative_sum(weight: float) -> float:
        constant = np.exp(log_densities["constant"])
        linear = np.exp(log_densities["linear"])
        return -float(np.log((1.0 - weight) * constant + weight * linear).sum())

    best = minimize_scalar(negative_sum, bounds=(0.0, 1.0), method="bounded").x
    assert stacking_weights(log_densities)["linear"] == pytest.approx(best, abs=1e-3)


def test_one_model_has_all_the_weight() -> None:
    assert stacking_weights({"constant": np.zeros(3)}) == {"constant": 1.0}


def test_prior_circles_scatter_as_simulated_ones() -> None:
    """The sd of the first reading, against the package's simulation of single campaigns."""
    campaign = simulated(plan())
    bound = CONSTANT.bind(campaign)
    first_test = next(prior_circles(bound, 4000, np.random.default_rng(0)))
    readings = []
    for seed in range(400):
        simulation = CONSTANT.simulate(campaign.plan(), seed=seed)
        readings.append(simulation.campaign.tests[0].readings_mm()[0])
    assert first_test[:, 0].std() == pytest.approx(np.std(readings), rel=0.15)


def test_a_plan_is_refused() -> None:
    refuses("readings", check_workflow, CONSTANT, plan())


def test_a_single_circle_is_refused() -> None:
    campaign = simulated(plan((40,), forces_N=(300.0,)))
    refuses("at least two tests", check_workflow, CONSTANT, campaign)


@pytest.fixture(scope="module")
def sound() -> Workflow:
    return check_workflow(CONSTANT, simulated(plan()), replicates=10)


@pytest.mark.slow
def test_nothing_is_wrong_with_a_sound_campaign(sound: Workflow) -> None:
    assert sound.passed
    assert wording.workflow_sentences(sound)[-1] == "Nothing was found wrong."


@pytest.mark.slow
def test_a_wrong_circle_is_named() -> None:
    campaign = simulated(plan((60,) * 6, forces_N=(36.0, 180.0, 320.0, 460.0, 600.0, 742.0)))
    wrong = campaign.tests[3]
    angle = np.deg2rad(wrong.angle_deg)
    spoilt = wrong.with_reading_um(np.asarray(wrong.reading_um) + 60.0 * np.cos(3.0 * angle))
    tests = (*campaign.tests[:3], spoilt, *campaign.tests[4:])
    workflow = check_workflow(CONSTANT, replace(campaign, tests=tests), replicates=10)
    assert workflow.outlying_circles == (spoilt.name,)
    assert not workflow.passed


@pytest.mark.slow
def test_a_prior_that_is_too_narrow_is_named() -> None:
    """Circles of which every reading is forty times as large as the prior allows for."""
    campaign = simulated(plan())
    larger = []
    for test in campaign.tests:
        larger.append(test.with_reading_um(40.0 * np.asarray(test.reading_um)))
    workflow = check_workflow(CONSTANT, replace(campaign, tests=tuple(larger)), replicates=10)
    assert len(workflow.surprising_circles) == 4
