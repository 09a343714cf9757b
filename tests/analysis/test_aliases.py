"""Degeneracies of a campaign's design: every statement holds in the exact forward model."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from campaigns import clocked, plan

import ldbb_bayes as lb
from ldbb_bayes.analysis.aliases import Degeneracy, degeneracies
from ldbb_bayes.machine.exact import geometric_reading_mm
from ldbb_bayes.machine.linear import wrench_jacobian
from ldbb_bayes.machine.parameters import wrench_names
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.report.wording import degeneracy_sentence

FORM = re.compile(r"(work_|tool_)?form_(cos|sin)(\d+)")


def degeneracies_of(campaign: lb.Campaign, degree: int = 1) -> tuple[Degeneracy, ...]:
    """Return the degeneracies of the first edition's model."""
    return degeneracies(lb.HybridModel.first(degree).bind(campaign))


def parameters_by_nuisance(campaign: lb.Campaign, degree: int = 1) -> dict[str, set[str]]:
    """Return the parameters that each nuisance looks like, "" for parameters alone."""
    parameters = {}
    for degeneracy in degeneracies_of(campaign, degree):
        nuisance = degeneracy.nuisances[0] if degeneracy.term else ""
        parameters[nuisance] = set(degeneracy.parameters)
    return parameters


def two_radii() -> lb.Campaign:
    campaign = plan(work_deg=40.0, tool_deg=-65.0)
    tests = []
    for test, radius in zip(campaign.tests, (150, 100, 150, 100), strict=True):
        tests.append(replace(test, radius_mm=radius))
    return replace(campaign, tests=tuple(tests))


def test_recovered_experiment(recovered: lb.Campaign) -> None:
    expected = {
        "form_cos2": {"E_XX1", "E_YY1"},
        "form_sin2": {"E_C0YX"},
        "form_cos3": {"E_XY2", "E_Xt0"},
        "form_sin3": {"E_YX2", "E_Yt0"},
        "bar_length": {"E_XX1", "E_YY1"},
        "mount": {"C_XXX", "C_YYY"},
        "force_gain": {"C_XXX", "C_YYY", "C_CXY", "C_CCY"},
    }
    assert parameters_by_nuisance(recovered) == expected
    assert parameters_by_nuisance(recovered, 0).keys() == expected.keys()


def test_exchange_rates(recovered: lb.Campaign) -> None:
    """cos 2θ of 1 µm at R = 150 mm is E_XX1 − E_YY1 = 2/150 = 13.3 µm/m.

    A length of 1 µm is 1/150 on both.
    """
    by_nuisance = {d.nuisances[0]: d for d in degeneracies_of(recovered)}
    form = by_nuisance["form_cos2"].combination
    assert form["form_cos2"] == pytest.approx(1e-3)
    assert -form["E_XX1"] == pytest.approx(1e-3 / 150.0, rel=1e-9)
    assert form["E_YY1"] == pytest.approx(1e-3 / 150.0, rel=1e-9)
    length = by_nuisance["bar_length"].combination
    assert -length["E_XX1"] == pytest.approx(1e-3 / 150.0, rel=1e-6)
    assert -length["E_YY1"] == pytest.approx(1e-3 / 150.0, rel=1e-6)
    squareness = by_nuisance["form_sin2"].combination["E_C0YX"]
    assert -squareness == pytest.approx(2e-3 / 150.0, rel=1e-9)


def test_statements_name_exchange_rates(recovered: lb.Campaign) -> None:
    by_nuisance = {d.nuisances[0]: d for d in degeneracies_of(recovered)}
    assert (
        degeneracy_sentence(by_nuisance["form_cos2"])
        == "1.00 µm of 2-lobe form (cos 2θ) looks exactly like +6.67 µm/m of E_XX1 and −6.67 µm/m"
        " of E_YY1."
    )
    assert degeneracy_sentence(by_nuisance["force_gain"]).startswith(
        "1.00 % of force gain looks exactly like +0.619 nm/N of C_XXX, +0.461 nm/N of C_YYY"
    )


# Changes of readings in the exact model


def exact_change_um(
    campaign: lb.Campaign, combination: Mapping[str, float], degree: int = 1
) -> float:
    """Return the largest change of a reading by a combination.

    Geometry is exact, all else from the definition of each coefficient.
    """
    bound = lb.HybridModel.first(degree).bind(campaign)
    largest = 0.0
    for test, pressure in zip(campaign.tests, campaign.pressures_bar, strict=True):
        change = geometric_change_mm(campaign, test, combination)
        for name, amount in combination.items():
            if not name.startswith("E_"):
                column = column_mm(bound, test, pressure, name)
                change = change + amount * column
        largest = max(largest, float(np.abs(change).max()))
    return largest * 1e3


def geometric_change_mm(
    campaign: lb.Campaign, test: lb.CircularTest, combination: Mapping[str, float]
) -> np.ndarray:
    """Return the exact reading by the geometric errors of a combination."""
    errors = {name: amount for name, amount in combination.items() if name.startswith("E_")}
    return geometric_reading_mm(campaign.machine(), test.circle, test.angles_rad(), errors)


def column_mm(
    bound: BoundModel, test: lb.CircularTest, pressure: float, name: str
) -> np.ndarray | float:
    """Return the reading per unit of a compliance or nuisance, from its definition."""
    campaign = bound.campaign
    force = float(test.force_N or 0.0)
    wrench = wrench_jacobian(campaign.machine(), test.circle, test.angles_rad())
    labels = [label.label for label in wrench_names(campaign.machine())]
    if name.startswith("C_"):
        stem = name.removesuffix("_1")
        column = force * wrench[:, labels.index(stem)]
        if name.endswith("_1"):
            forces = campaign.forces_N
            column = column * (force - 0.5 * (forces.min() + forces.max()))
        return np.asarray(column)
    if FORM.fullmatch(name):
        return form_mm(test, name)
    if name.startswith("bar_length"):
        radius = name.removeprefix("bar_length").removeprefix("_")
        return float(not radius or float(radius) == test.radius_mm)
    if name == "mount":
        return float(pressure)
    assert name == "force_gain"
    compliances = [labels.index(compliance.label) for compliance in bound.compliances]
    return np.asarray(force * wrench[:, compliances] @ bound.setting.compliance_estimate)


def form_mm(test: lb.CircularTest, name: str) -> np.ndarray:
    """Return a harmonic of a ball's form at the clocking of its ball."""
    match = FORM.fullmatch(name)
    assert match is not None
    ball, function, order = match.groups()
    clocking = test.tool_ball_deg - 180.0 if ball == "tool_" else test.work_ball_deg
    phase = int(order) * (test.angles_rad() - np.deg2rad(clocking))
    return np.cos(phase) if function == "cos" else np.sin(phase)


def lead_of(degeneracy: Degeneracy) -> dict[str, float]:
    """Return the first coefficient of a combination by itself."""
    name = next(iter(degeneracy.combination))
    return {name: degeneracy.combination[name]}


CAMPAIGNS = {
    "two balls": clocked(((0.0, 0.0), (180.0, 180.0))),
    "one ball": clocked(((0.0, 0.0), (45.0, 0.0), (90.0, 0.0))),
    "two radii": two_radii(),
    "arcs": plan((30, 40, 50, 30), arc_deg=230.0),
}


@pytest.mark.slow
@pytest.mark.parametrize("degree", [0, 1])
@pytest.mark.parametrize("name", ["recovered", *CAMPAIGNS])
def test_every_statement_holds_in_the_exact_model(
    recovered: lb.Campaign, name: str, degree: int
) -> None:
    campaign = CAMPAIGNS.get(name, recovered)
    check_statements(campaign, degree)


def test_statements_on_one_force_hold_in_the_exact_model() -> None:
    check_statements(plan((40,), forces_N=(300.0,)), 0)


def check_statements(campaign: lb.Campaign, degree: int) -> None:
    """Check that no reading moves by more than the linearisation error and what is not seen."""
    combinations = degeneracies_of(campaign, degree)
    assert combinations
    for degeneracy in combinations:
        change = exact_change_um(campaign, degeneracy.combination, degree)
        lead_change = exact_change_um(campaign, lead_of(degeneracy), degree)
        assert change < 0.05 * lead_change + 1e-6
        change_per_sd = change / max(degeneracy.prior_sds, 1.0)
        assert change_per_sd < 0.1 * campaign.resolution_um, degeneracy_sentence(degeneracy)
        assert change == pytest.approx(degeneracy.change_um, rel=0.03, abs=2e-3)


# What separates a degeneracy's members


def imitated_forms(turns: tuple[tuple[float, float], ...], order: int) -> set[str]:
    """Return nuisances of an order that some parameter imitates at (work, tool) clockings."""
    names = set()
    for degeneracy in degeneracies_of(clocked(turns), 0):
        for name in degeneracy.nuisances:
            if name.endswith((f"cos{order}", f"sin{order}")):
                names.add(name)
    return names


@pytest.mark.parametrize("order", [2, 3, 4, 11])
def test_clocking_both_balls(order: int) -> None:
    """ψ separates order n unless nψ is a multiple of 360°."""
    assert bool(imitated_forms(((0.0, 0.0),), order)) is (order < 4)
    assert not imitated_forms(((0.0, 0.0), (45.0, 45.0), (90.0, 90.0)), order)
    half_turn = imitated_forms(((0.0, 0.0), (180.0, 180.0)), order)
    assert bool(half_turn) is (order == 2)


@pytest.mark.parametrize("order", [2, 3])
def test_clocking_one_ball_leaves_the_other(order: int) -> None:
    work_clocked = imitated_forms(((0.0, 0.0), (45.0, 0.0), (90.0, 0.0)), order)
    assert work_clocked == {f"tool_form_cos{order}", f"tool_form_sin{order}"}
    tool_clocked = imitated_forms(((0.0, 0.0), (0.0, 45.0), (0.0, 90.0)), order)
    assert tool_clocked == {f"work_form_cos{order}", f"work_form_sin{order}"}


@pytest.mark.parametrize("order", [4, 11])
def test_high_orders_need_no_clocking_of_both_balls(order: int) -> None:
    assert not imitated_forms(((0.0, 0.0), (45.0, 0.0), (90.0, 0.0)), order)
    assert not imitated_forms(((0.0, 0.0), (0.0, 45.0), (0.0, 90.0)), order)


def test_a_second_radius_brings_a_second_length() -> None:
    """Form is separated; lengths in proportion to the radii are a scale."""
    lengths = [d for d in degeneracies_of(two_radii()) if d.term == "BarLength"]
    assert len(lengths) == 1
    change = lengths[0].combination
    assert change["bar_length_150"] / change["bar_length_100"] == pytest.approx(1.5, rel=1e-6)
    assert set(lengths[0].parameters) == {"E_XX1", "E_YY1"}


def test_what_the_model_leaves_out_is_stated_too(recovered: lb.Campaign) -> None:
    combinations = degeneracies(lb.HybridModel.paper(0).bind(recovered))
    assert not any(d.modelled for d in combinations)
    text = degeneracy_sentence(combinations[0])
    assert "the model leaves it out, and the intervals do not cover it" in text


@pytest.mark.parametrize("readings", [9, 24])
def test_what_no_reading_sees_has_no_partner(readings: int) -> None:
    """sin 12θ is zero at 24 uniform angles, which is no likeness with unseen compliances."""
    campaign = plan((readings,) * 4)
    for degeneracy in degeneracies_of(campaign):
        largest = max(abs(change) for change in degeneracy.combination.values())
        assert largest < 1.0
        assert exact_change_um(campaign, lead_of(degeneracy)) > 0.024


def test_unseen_form_is_not_confounded_with_compliances() -> None:
    model = lb.HybridModel.first(1).without("ball-form")
    for degeneracy in degeneracies(model.bind(plan((24,) * 4))):
        if degeneracy.term == "BallForm":
            assert {"C_XXX", "C_YYY", "C_CCY"}.isdisjoint(degeneracy.parameters)


@pytest.mark.parametrize("readings", [3585, 3600])
def test_several_turns_of_the_same_angles(readings: int) -> None:
    angle = np.arange(readings) * 3.0
    tests = tuple(lb.CircularTest(force, angle) for force in (36.0, 390.0, 742.0))
    model = lb.HybridModel.first(1).without("ball-form")
    assert len(degeneracies(model.bind(lb.Campaign(tests)))) == 7


def test_another_machine_and_plane() -> None:
    """Degeneracies are found numerically: a machine of the other order in another plane."""
    angle = np.arange(40) * 9.0
    tests = tuple(lb.CircularTest(force, angle) for force in (100.0, 400.0))
    campaign = lb.Campaign(tests, topology="wXFYZt", plane="YZ")
    parameters = parameters_by_nuisance(campaign, 0)
    assert parameters["bar_length"] == {"E_YY1", "E_ZZ1"}
    assert parameters["form_cos2"] == {"E_YY1", "E_ZZ1"}
    assert parameters["mount"] >= {"C_YYY", "C_ZZZ"}
