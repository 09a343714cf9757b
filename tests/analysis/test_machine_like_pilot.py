"""Machines for a rehearsal: drawn from what the readings of a plan's pilot leave likely."""

import numpy as np

import ldbb_bayes as lb
from ldbb_bayes.analysis.design.present_estimates import present_estimates
from ldbb_bayes.analysis.design.states import draw_machine_like_pilot
from ldbb_bayes.inference.evidences import Evidences

MODEL = lb.HybridModel.default(1)
PILOT = lb.read_campaign(lb.embedded_campaign())


def test_machines_have_the_moments_of_the_posterior() -> None:
    plan = lb.design(MODEL, PILOT, tests=4, forces_N=(36.0, 742.0)).plan()
    estimates = present_estimates(Evidences(PILOT).of(MODEL)[0])
    column = MODEL.bind(PILOT).names.index("C_XXX")
    drawn = []
    for seed in range(100):
        machine = draw_machine_like_pilot(MODEL, plan, seed)
        assert machine is not None
        drawn.append(machine.parameters["C_XXX"])
    standard_error = estimates.sd[column] / 10.0
    assert abs(np.mean(drawn) - estimates.mean[column]) < 4.0 * standard_error
    np.testing.assert_allclose(np.std(drawn), estimates.sd[column], rtol=0.3)


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
