"""Checks of a Bayesian workflow: against answers known otherwise, and failing once each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from campaigns import plan, refuses, simulated
from scipy.optimize import minimize_scalar

import ldbb_bayes as lb
from ldbb_bayes.analysis import workflow
from ldbb_bayes.analysis.workflow import Workflow, check_workflow, stacking_weights
from ldbb_bayes.inference import sample as sample_module
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.inference.independent_sampler import JointDraws, draw_jointly
from ldbb_bayes.inference.mcmc import StoppingRule
from ldbb_bayes.inference.posterior import fit_of, record_of
from ldbb_bayes.inference.prior_prediction import prior_circles
from ldbb_bayes.report import wording

CONSTANT = lb.HybridModel.first(0)
LINEAR = lb.HybridModel.first(1)
SIX_FORCES_N = (36.0, 180.0, 320.0, 460.0, 600.0, 742.0)


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


@pytest.mark.slow
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
    campaign = simulated(plan((60,) * 6, forces_N=SIX_FORCES_N))
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


def with_one_chain_shifted(draws: JointDraws) -> JointDraws:
    """Return draws of which the first of four chains lies half a standard deviation too high."""
    beta = draws.beta.copy()
    beta[: len(beta) // 4] += 0.5 * beta.std(axis=0)
    return draws._replace(beta=beta)


def with_one_chain_stuck(draws: JointDraws) -> JointDraws:
    """Return draws of which the first of four chains does not move."""
    beta = draws.beta.copy()
    beta[: len(beta) // 4] = beta[0]
    return draws._replace(beta=beta)


def with_draws_repeated(draws: JointDraws) -> JointDraws:
    """Return draws of which every tenth is held for ten steps, as a slow chain does."""
    held = 10 * (np.arange(len(draws.beta)) // 10)
    log_posterior = draws.log_posterior[held]
    return draws._replace(beta=draws.beta[held], free=draws.free[held], log_posterior=log_posterior)


def sampler_record() -> dict[str, object]:
    """Return the record of a sampler that may draw 500 times in each of four chains."""
    posterior = lb.sample(
        CONSTANT,
        simulated(plan()),
        sampler="independent",
        seed=1,
        rule=StoppingRule(max_steps=500),
    )
    return dict(record_of(posterior)["sampler"])


def test_a_sampler_that_works_has_converged() -> None:
    assert sampler_record()["converged"]


@pytest.mark.parametrize(
    "spoil", [with_one_chain_shifted, with_one_chain_stuck, with_draws_repeated]
)
def test_a_sampler_that_does_not_work_has_not_converged(
    monkeypatch: pytest.MonkeyPatch, spoil: Callable[[JointDraws], JointDraws]
) -> None:
    def draw_wrongly(start: HyperPosterior, size: int, rng: np.random.Generator) -> JointDraws:
        return spoil(draw_jointly(start, size, rng))

    monkeypatch.setattr(sample_module, "draw_jointly", draw_wrongly)
    assert not sampler_record()["converged"]


@pytest.mark.slow
def test_a_sampler_that_has_not_converged_is_stated(sound: Workflow) -> None:
    workflow = replace(sound, converged=False, ess_bulk_min=90.0)
    assert not workflow.passed
    assert "90 (means)" in wording.workflow_sentences(workflow)[1]
    assert "too few, draw more" in wording.workflow_sentences(workflow)[1]


def test_no_parameter_of_a_sound_campaign_depends_on_the_prior() -> None:
    posterior = lb.sample(CONSTANT, simulated(plan()), sampler="independent", seed=1)
    assert fit_of(posterior).sensitive == ()


def test_a_prior_that_contradicts_the_readings_is_noticed() -> None:
    """A prior whose sd is a fifth of the compliance that the readings show."""
    prior = replace(CONSTANT.prior, direct_mm_per_N=1e-5)
    posterior = lb.sample(
        replace(CONSTANT, prior=prior), simulated(plan()), sampler="independent", seed=1
    )
    assert {"C_XXX", "C_YYY"} <= set(fit_of(posterior).sensitive)


@pytest.mark.slow
def test_a_machine_of_constant_compliance_is_predicted_by_the_constant_model() -> None:
    campaign = simulated(plan((40,) * 6, forces_N=SIX_FORCES_N))
    workflow = check_workflow(LINEAR, campaign, replicates=10, draws=9)
    assert workflow.stacking_weights["constant"] > 0.9


@pytest.mark.slow
def test_a_machine_of_changing_compliance_is_predicted_by_the_linear_model() -> None:
    """From the smallest to the largest force, the compliance of one axis grows by a half."""
    truth = {"C_XXX": 5.5e-5, "C_YYY": 4e-5, "C_XXX_1": 4e-8}
    scales_um = {"sigma": 0.3, "delta": 0.5, "kappa": 0.3, "tau": 2.0}
    planned = plan((40,) * 6, forces_N=SIX_FORCES_N)
    simulation = LINEAR.simulate(planned, seed=1, parameters=truth, hyper_um=scales_um)
    workflow = check_workflow(LINEAR, simulation.campaign, replicates=10, draws=9)
    assert workflow.stacking_weights["linear"] > 0.9


@pytest.mark.slow
def test_circles_of_a_sound_campaign_scatter_as_predicted(sound: Workflow) -> None:
    assert sound.scatter_as_predicted


@pytest.mark.slow
def test_circles_that_all_deviate_a_little_do_not_scatter_as_predicted(sound: Workflow) -> None:
    left_out = {}
    for name, circle in sound.left_out.items():
        left_out[name] = replace(circle, p_value=0.06, family_wise_p_value=0.24)
    workflow = replace(sound, left_out=left_out)
    assert not workflow.outlying_circles
    assert not workflow.scatter_as_predicted
    assert "do not scatter as predicted" in wording.workflow_sentences(workflow)[3]


@pytest.mark.slow
def test_ranks_that_are_not_uniform_fail_the_workflow(sound: Workflow) -> None:
    ranks = np.zeros_like(sound.calibration.ranks)
    workflow = replace(sound, calibration=replace(sound.calibration, ranks=ranks))
    assert not workflow.passed


@pytest.mark.slow
def test_the_figure_has_a_panel_for_every_comparison(sound: Workflow) -> None:
    figure = lb.figures.workflow_checks(sound)
    assert len(figure.axes) == 4


@pytest.mark.slow
def test_circles_that_deviate_less_than_the_prior_expects_are_stated(sound: Workflow) -> None:
    ranges = {}
    for name, expected in sound.prior_ranges.items():
        ranges[name] = replace(expected, measured_um=0.5 * expected.low_um)
    workflow = replace(sound, prior_ranges=ranges)
    assert workflow.quiet_circles == tuple(ranges)
    assert "4 of 4 circles deviate less" in wording.workflow_sentences(workflow)[0]


def test_a_range_that_no_simulated_circle_reaches_is_not_impossible(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of n simulated circles and the measured one, the measured one is the largest: 1/(n + 1)."""
    bound = CONSTANT.bind(simulated(plan()))
    monkeypatch.setattr(workflow, "bound_of", lambda _: bound)
    monkeypatch.setattr(workflow, "prior_circles", lambda *_: [np.zeros((9, 2))] * 4)
    monkeypatch.setattr(workflow, "_PRIOR_CIRCLES", 9)
    ranges = workflow._prior_ranges(xr.DataTree(), 1)
    assert [entry.p_value for entry in ranges.values()] == [pytest.approx(0.1)] * 4
