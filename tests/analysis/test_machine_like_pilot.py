"""Machines for a rehearsal: drawn from what the readings of a plan's pilot leave likely."""

from dataclasses import replace

import numpy as np
import pytest
from campaigns import refuses
from reports import plan_of_three_planes

import ldbb_bayes as lb
from ldbb_bayes.analysis.design.present_estimates import present_estimates
from ldbb_bayes.analysis.design.states import draw_machine_like_pilot
from ldbb_bayes.inference.evidences import Evidences

MODEL = lb.HybridModel.default(1)
# A direct compliance below this is likely for the stiff machine of `run`. The prior sd is 1e-4.
STIFF_MM_PER_N = 4e-5
PILOT = lb.read_campaign(lb.embedded_campaign())


@pytest.mark.slow
def test_machines_have_the_moments_of_the_posterior() -> None:
    plan = lb.design(MODEL, PILOT, tests=4, forces_N=(36.0, 742.0)).plan()
    estimates = present_estimates(Evidences(PILOT).nodes(MODEL)[0])
    column = MODEL.bind(PILOT).names.index("C_XXX")
    values = []
    for seed in range(100):
        machine = draw_machine_like_pilot(MODEL, plan, seed)
        assert machine is not None
        values.append(machine.parameters["C_XXX"])
    standard_error = estimates.sd[column] / 10.0
    assert abs(np.mean(values) - estimates.mean[column]) < 4.0 * standard_error
    np.testing.assert_allclose(np.std(values), estimates.sd[column], rtol=0.3)


@pytest.mark.slow
def test_machines_change_with_force_as_the_pilot_leaves_likely() -> None:
    """Most of C(F) at small forces is joint load, which the readings of the pilot narrow."""
    plan = lb.design(MODEL, PILOT, tests=4, forces_N=(36.0, 742.0)).plan()
    posterior = lb.sample(MODEL, PILOT, sampler="independent", seed=1)
    wanted = lb.analysis.change_with_force(posterior)["C_XXX"].change
    changes = []
    for seed in range(100):
        machine = draw_machine_like_pilot(MODEL, plan, seed)
        assert machine is not None
        simulation = MODEL.simulate(plan, seed=seed, **machine._asdict())
        changes.append(simulation.change_with_force["C_XXX"].change)
    assert abs(np.mean(changes) - wanted.mean) < 4.0 * wanted.sd / 10.0
    np.testing.assert_allclose(np.std(changes), wanted.sd, rtol=0.3)


@pytest.mark.slow
def test_the_bar_is_that_of_the_pilot_only_in_a_plan_that_adds_to_it() -> None:
    design = lb.design(MODEL, PILOT, tests=2, forces_N=(36.0, 742.0), augment=True)
    added = draw_machine_like_pilot(MODEL, design.plan(), 1)
    anew = draw_machine_like_pilot(MODEL, replace(design.plan(), adds_to_pilot=False), 1)
    assert added is not None
    assert anew is not None
    assert added.effects.keys() - anew.effects.keys() == {"bar_length"}


def test_drift_is_not_that_of_the_pilot() -> None:
    """Planned circles are simulated as if it began with them."""
    design = lb.design(MODEL, PILOT, tests=2, forces_N=(36.0, 742.0), augment=True)
    added = draw_machine_like_pilot(MODEL, design.plan(), 1)
    assert added is not None
    assert not any(name.startswith("drift") for name in added.effects)


def test_a_machine_yields_as_much_in_a_plan_with_a_smaller_largest_force() -> None:
    """Joint load is scaled by the largest force of a campaign."""
    model = replace(MODEL, reference_force_N=100.0)
    curves = []
    for largest_N in (742.0, 300.0):
        tests = []
        for test, force_N in zip(PILOT.tests, (36.0, 100.0, largest_N), strict=False):
            tests.append(replace(test, force_N=force_N, pressure_bar=None))
        plan = replace(PILOT.plan(), tests=tuple(tests), pilot=PILOT).plan()
        machine = draw_machine_like_pilot(model, replace(plan, pilot=PILOT), 1)
        assert machine is not None
        simulation = model.simulate(plan, seed=1, **machine._asdict())
        curves.append(simulation.change_with_force["C_XXX"].at_smallest)
    assert curves[0] == pytest.approx(curves[1], rel=1e-6)


def test_scales_of_single_circles_are_not_those_of_the_pilot() -> None:
    plan = lb.design(MODEL, PILOT, tests=4, forces_N=(36.0, 742.0)).plan()
    machine = draw_machine_like_pilot(MODEL, plan, 1)
    assert machine is not None
    assert {"sigma", "delta", "kappa"} <= set(machine.hyper_um)
    assert not any(name.startswith("lambda") for name in machine.hyper_um)
    rehearsed = MODEL.simulate(
        plan, seed=1, parameters=machine.parameters, hyper_um=machine.hyper_um
    )
    assert rehearsed.parameters == machine.parameters


def test_without_readings_there_is_no_machine_to_be_like() -> None:
    assert draw_machine_like_pilot(MODEL, PILOT.plan(), 1) is None


def test_the_next_circle_can_be_simulated() -> None:
    """The pilot has the forces by which the machine's compliance changes."""
    circle = lb.CircularTest(300.0, np.arange(0.0, 360.0, 5.0), direction="CW")
    plan = replace(PILOT.plan(), tests=(circle,), pilot=PILOT, adds_to_pilot=True)
    machine = draw_machine_like_pilot(MODEL, plan, 1)
    assert machine is not None
    simulation = MODEL.simulate(plan, seed=1, parameters=machine.parameters)
    assert simulation.campaign.readings == 72
    change = simulation.change_with_force["C_XXX"]
    assert change.reference_force_N == MODEL.bind(PILOT).setting.reference_force_N


def test_one_force_is_still_refused_where_the_pilot_has_no_other() -> None:
    one_force = PILOT.select([PILOT.tests[0].name])
    plan = replace(one_force.plan(), pilot=one_force, adds_to_pilot=True)
    refuses("must have at least two force levels", MODEL.simulate, plan, seed=1)


def in_planes(*planes: str) -> lb.Campaign:
    """A campaign of two forces in each of these planes, without readings."""
    three_planes = plan_of_three_planes()
    tests = tuple(test for test in three_planes.tests if test.plane in planes)
    return replace(three_planes, tests=tests)


def run(campaign: lb.Campaign) -> lb.Campaign:
    """The campaign with readings of a machine that is much stiffer than the prior's."""
    names = MODEL.bind(campaign).names
    stiff = {name: 1e-6 for name in ("C_XXX", "C_YYY", "C_ZZZ") if name in names}
    return MODEL.simulate(campaign, seed=1, parameters=stiff).campaign


def test_a_plan_of_fewer_planes_is_rehearsed_with_a_machine_like_the_pilot() -> None:
    plan = replace(in_planes("XY"), pilot=run(in_planes("XY", "YZ")))
    names = MODEL.bind(plan).names
    for seed in range(4):
        machine = draw_machine_like_pilot(MODEL, plan, seed)
        assert machine is not None
        assert set(machine.parameters) == set(names)
        assert 0.0 <= machine.parameters["C_XXX"] < STIFF_MM_PER_N


def test_parameters_that_the_pilot_lacks_are_drawn_from_the_prior() -> None:
    """Also where the model states a prior of one of them."""
    plan = replace(in_planes("XY", "YZ"), pilot=run(in_planes("XY")))
    model = MODEL.with_prior(E_A0YZ=(0.0, 1e-3))
    names = model.bind(plan).names
    values = []
    for seed in range(4):
        machine = draw_machine_like_pilot(model, plan, seed)
        assert machine is not None
        assert set(machine.parameters) == set(names)
        assert 0.0 <= machine.parameters["C_XXX"] < STIFF_MM_PER_N
        values.append(machine.parameters["C_ZZZ"])
    assert max(values) > STIFF_MM_PER_N


def test_a_machine_has_its_compliances_at_the_reference_force_of_the_plan() -> None:
    """The pilot's middle is 400 N; that of the plan, at which it is simulated, 200 N."""
    pilot = run(in_planes("XY"))
    tests = []
    for test, force_N in zip(in_planes("XY").tests, (100.0, 300.0), strict=True):
        tests.append(replace(test, force_N=force_N))
    plan = replace(in_planes("XY"), tests=tuple(tests), pilot=pilot)
    at_plan = MODEL.bind(plan).setting.reference_force_N
    like_pilot = draw_machine_like_pilot(replace(MODEL, reference_force_N=at_plan), plan, 1)
    assert at_plan == 200.0
    assert draw_machine_like_pilot(MODEL, plan, 1) == like_pilot
