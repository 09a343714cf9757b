"""Expected uncertainties that are averaged over constant and linear compliance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from campaigns import plan, simulated
from reports import plan_of_three_planes

import ldbb_bayes as lb
from ldbb_bayes.analysis.design.averaged_forecast import (
    _draw_machines,
    _known_before,
    averaged_uncertainties,
)
from ldbb_bayes.analysis.design.forecast import forecast_plan
from ldbb_bayes.analysis.design.simulated_analyses import simulate_analyses
from ldbb_bayes.analysis.nested_models import NestedModels

LINEAR = lb.HybridModel.default(1)
# A model without rivals.
ALONE = lb.HybridModel.first(1)
PLAN = plan((30,) * 4)


def planned(pilot: lb.Campaign, *, adds: bool = False) -> lb.Campaign:
    return replace(PLAN, pilot=pilot, adds_to_pilot=adds)


def of_slopes(shares_of_sd: float) -> lb.Campaign:
    """Simulated readings with little noise, whose slopes are all so many prior sds."""
    bound = ALONE.bind(PLAN)
    values = 0.5 * bound.prior_sd
    values[6:12] = shares_of_sd * bound.prior_sd[6:12]
    parameters = dict(zip(bound.names, values.tolist(), strict=True))
    hyper_um = {"sigma": 0.2, "delta": 0.2, "kappa": 0.2, "tau": 1.0}
    hyper_um = {name: hyper_um[name] for name in bound.hyper_prior.names}
    return ALONE.simulate(PLAN, seed=3, parameters=parameters, hyper_um=hyper_um).campaign


def test_slopes_that_are_certain_leave_the_uncertainties_of_linear_compliance() -> None:
    analyses = simulate_analyses(ALONE, planned(of_slopes(1.0)))
    averaged = averaged_uncertainties(analyses)
    expected = forecast_plan(ALONE, analyses.bound.campaign, analyses=analyses).expected
    assert set(averaged) == {name for name in expected if not name.endswith("_1")}
    for name, entry in averaged.items():
        assert entry.unit == expected[name].unit
        assert entry.sd == pytest.approx(expected[name].sd, rel=0.06), name
        assert entry.sd <= entry.likely_sd


def test_slopes_that_are_certainly_zero_leave_those_of_constant_compliance() -> None:
    pilot = of_slopes(0.0)
    averaged = averaged_uncertainties(simulate_analyses(ALONE, planned(pilot)))
    constant = ALONE.with_degree(0)
    expected = forecast_plan(constant, planned(pilot)).expected
    linear = forecast_plan(ALONE, planned(pilot)).expected
    for name in ("C_XXX", "C_YYY"):
        assert averaged[name].sd == pytest.approx(expected[name].sd, rel=0.1), name
        assert averaged[name].sd < 0.9 * linear[name].sd


def test_machines_have_slopes_and_rivals_as_often_as_the_models_have_without_readings() -> None:
    """Before any reading, each of slopes and rivals is there with probability one half."""
    analyses = simulate_analyses(LINEAR, PLAN, machines=256)
    models = NestedModels.of(analyses.bound)
    assert models is not None
    distribution = _known_before(models, analyses)
    machines = _draw_machines(models, distribution, np.random.default_rng(1))
    assert len(machines.coefficients) == 256
    p = len(models.bound.names)
    assert (machines.coefficients[:, 6] != 0.0).mean() == pytest.approx(0.5, abs=0.03)
    assert (machines.coefficients[:, p] != 0.0).mean() == pytest.approx(0.5, abs=0.03)
    beta = models.bound.prior_mean + machines.coefficients[:, :p] * models.bound.scale
    assert models.bound.truncation.holds(beta).all()


@pytest.mark.slow
def test_machines_have_the_moments_of_the_average_given_a_pilot() -> None:
    """Means and sds of compliances, against `average` of the same pilot."""
    pilot = lb.read_campaign(lb.embedded_campaign())
    analyses = simulate_analyses(LINEAR, planned(pilot), machines=512)
    models = NestedModels.of(analyses.bound)
    assert models is not None
    machines = _draw_machines(models, _known_before(models, analyses), np.random.default_rng(1))
    p = len(models.bound.names)
    beta = models.bound.prior_mean + machines.coefficients[:, :p] * models.bound.scale
    pair = {"constant": LINEAR.with_degree(0), "linear": LINEAR}
    posterior = lb.average(pair, pilot)["posterior"]
    for name in ("C_XXX", "C_YYY", "C_XYX", "E_XX1"):
        draws = posterior[name].values
        column = beta[:, models.bound.names.index(name)]
        assert column.mean() == pytest.approx(draws.mean(), abs=0.2 * draws.std()), name
        assert column.std() == pytest.approx(draws.std(), rel=0.15), name


def test_circles_that_add_to_a_pilot_leave_no_more_than_the_pilot_does() -> None:
    pilot = simulated(PLAN, seed=1)
    added = averaged_uncertainties(simulate_analyses(LINEAR, planned(pilot, adds=True)))
    of_pilot = averaged_uncertainties(simulate_analyses(LINEAR, planned(pilot)))
    for name, entry in added.items():
        assert entry.sd < 1.03 * of_pilot[name].sd, name
    assert added["C_XXX"].sd < 0.95 * of_pilot["C_XXX"].sd


def test_a_new_certificate_does_not_make_its_effect_more_probable() -> None:
    """The curvature of the force law is as probable as without a certificate that narrows it."""
    pilot = simulated(PLAN, seed=1)
    certified = replace(
        planned(pilot),
        instrument=replace(pilot.instrument, force_linearity_percent=0.05),
    )
    analyses = simulate_analyses(LINEAR, certified, machines=256)
    models = NestedModels.of(analyses.bound)
    assert models is not None
    distribution = _known_before(models, analyses)
    machines = _draw_machines(models, distribution, np.random.default_rng(1))
    curvature = machines.coefficients[:, -1]
    assert (curvature != 0.0).mean() == pytest.approx(0.5, abs=0.1)
    assert curvature[curvature != 0.0].std() == pytest.approx(1.0, abs=0.2)


def test_a_plan_of_other_planes_than_its_pilot_is_refused() -> None:
    three_planes = plan_of_three_planes()
    one_plane = [test.name for test in three_planes.tests if test.plane == "XY"]
    other = replace(three_planes, pilot=simulated(three_planes.select(one_plane)))
    with pytest.raises(lb.InputError, match="must have the parameters of its pilot"):
        lb.identify(LINEAR, other)


@pytest.mark.slow
def test_a_plan_of_fewer_planes_knows_what_the_pilot_says_of_its_coefficients() -> None:
    """The pilot's third axis does not move in the plan, which has no joint load of it."""
    three_planes = plan_of_three_planes()
    pilot = simulated(three_planes)
    in_xy = [test for test in three_planes.tests if test.plane == "XY"]
    in_other_planes = tuple(test for test in three_planes.tests if test.plane != "XY")
    one_plane = replace(three_planes, tests=tuple(in_xy), foreseen=in_other_planes, pilot=pilot)
    analyses = simulate_analyses(LINEAR, one_plane)
    models = NestedModels.of(analyses.bound)
    of_pilot = NestedModels.of(LINEAR.bind(pilot))
    assert models is not None
    assert of_pilot is not None
    assert {name for name in of_pilot.names if name.startswith("joint_load_Z")}
    assert not {name for name in models.names if name.startswith("joint_load_Z")}
    expected = of_pilot.coefficients_given(analyses.states.phi)
    places = [of_pilot.names.index(name) for name in models.names]
    distribution = _known_before(models, analyses)
    np.testing.assert_allclose(distribution.mean, expected.mean[:, places], atol=1e-7)
    block = expected.covariance[:, places][:, :, places]
    np.testing.assert_allclose(distribution.covariance, block, atol=1e-7)
    averaged = averaged_uncertainties(analyses)
    assert 0.0 < averaged["C_XXX"].sd < 2.5e-5


@pytest.mark.parametrize("model", [lb.HybridModel.default(0), lb.HybridModel.default(2)])
def test_there_is_nothing_to_average(model: lb.HybridModel) -> None:
    assert averaged_uncertainties(simulate_analyses(model, PLAN)) == {}


@pytest.mark.slow
def test_identify_states_them_for_plans_and_campaigns() -> None:
    of_plan = lb.identify(LINEAR, planned(simulated(PLAN, seed=1)))
    averaged = averaged_uncertainties(simulate_analyses(LINEAR, planned(simulated(PLAN, seed=1))))
    assert of_plan.averaged_sd == {name: entry.sd for name, entry in averaged.items()}
    of_campaign = lb.identify(LINEAR, simulated(PLAN, seed=1))
    assert of_campaign.averaged_sd["C_XXX"] < of_campaign.parameters["C_XXX"].sd
    assert not lb.identify(lb.HybridModel.default(0), PLAN).averaged_sd
