"""Circles at several places of the machine, predicted ones too; another law of the regulator."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from campaigns import plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.campaign.loading import ForceLaw
from ldbb_bayes.inference.coefficients import shared_terms
from ldbb_bayes.inference.prediction import _bind_with_plan
from ldbb_bayes.model.fourier import basis
from ldbb_bayes.model.terms.joints import Position

MODEL = lb.HybridModel.default(1)
CAMPAIGN = simulated(plan())
ANGLE_DEG = np.arange(0.0, 360.0, 5.0)


def circle(**settings: float) -> lb.Campaign:
    return lb.Plan((lb.CircularTest(600.0, ANGLE_DEG, **settings),))


@pytest.mark.parametrize(
    ("settings", "centre_mm", "radius_mm"),
    [
        ({}, (0.0, 0.0), 150.0),
        ({"centre_x_mm": 300.0, "centre_y_mm": -200.0}, (300.0, -200.0), 150.0),
        ({"radius_mm": 260.0}, (0.0, 0.0), 260.0),
        ({"centre_x_mm": -80.0, "radius_mm": 100.0}, (-80.0, 0.0), 100.0),
    ],
)
def test_the_compliance_changes_along_the_axis_and_not_along_the_circle(
    settings: dict[str, float], centre_mm: tuple[float, float], radius_mm: float
) -> None:
    """L x/R + Q ((x/R)² − ½) at the place x of the axis, R = 150 mm of the measured circle."""
    _, planned = _bind_with_plan(MODEL.bind(CAMPAIGN), circle(**settings))
    terms = {term.names: term for term in shared_terms(planned.nuisance_columns)}
    angle = np.deg2rad(ANGLE_DEG)
    for axis, u in enumerate((np.cos(angle), np.sin(angle))):
        letter = "XY"[axis]
        names = (f"position_{letter}_linear", f"position_{letter}_quadratic")
        place = (centre_mm[axis] + radius_mm * u) / 150.0
        readings = basis(angle) @ terms[names].values[0]
        np.testing.assert_allclose(readings[:, 0], 600.0 * u**2 * place, atol=1e-9)
        np.testing.assert_allclose(readings[:, 1], 600.0 * u**2 * (place**2 - 0.5), atol=1e-9)


def test_a_prediction_at_a_larger_force_scales_the_joint_load_as_the_campaign_does() -> None:
    """The coefficients are those of the campaign's fit, with its largest force."""
    measured = MODEL.bind(CAMPAIGN)
    beyond = lb.Plan((lb.CircularTest(2.0 * CAMPAIGN.forces_N.max(), ANGLE_DEG),))
    _, planned = _bind_with_plan(measured, beyond)
    assert planned.setting.largest_force_N == measured.setting.largest_force_N


def test_a_campaign_of_several_places_has_one_machine() -> None:
    """Springs that change along the axes, in exact geometry: of readings at three centres and two
    radii the model has the right ones but for rounding of its Fourier series."""
    places = [((0.0, 0.0), 150.0), ((200.0, 100.0), 150.0), ((-80.0, 50.0), 260.0)]
    tests = []
    for (x_mm, y_mm), radius_mm in places:
        tests.append(
            lb.CircularTest(
                600.0, ANGLE_DEG, centre_x_mm=x_mm, centre_y_mm=y_mm, radius_mm=radius_mm
            )
        )
    bound = lb.HybridModel.default(0).bind(lb.Plan(tuple(tests)))
    setting = bound.setting
    mean_x_mm, mean_y_mm = np.mean([place for place, _ in places], axis=0)
    assert setting.reference_centre_mm == pytest.approx((mean_x_mm, mean_y_mm, 0.0))
    assert setting.reference_radius_mm == 150.0
    terms = {term.names: term for term in shared_terms(bound.nuisance_columns)}
    angle = np.deg2rad(ANGLE_DEG)
    stiffness_N_per_mm = 2e4
    for axis, (u, mean_mm) in enumerate(((np.cos(angle), mean_x_mm), (np.sin(angle), mean_y_mm))):
        letter = "XY"[axis]
        names = (f"position_{letter}_linear", f"position_{letter}_quadratic")
        for r, (centre_mm, radius_mm) in enumerate(places):
            x = (centre_mm[axis] + radius_mm * u - mean_mm) / 150.0
            compliance = (1.0 + 0.08 * x + 0.05 * (x**2 - 0.5)) / stiffness_N_per_mm
            # the spring yields along its axis to the share of the force along it
            reading_mm = 600.0 * u * compliance * u
            columns = basis(angle) @ terms[names].values[r]
            modelled = 600.0 * u**2 + columns @ [0.08, 0.05]
            np.testing.assert_allclose(modelled / stiffness_N_per_mm, reading_mm, atol=1e-12)


def test_one_place_has_the_columns_of_its_circle() -> None:
    """F u³ and F (u⁴ − u²/2) wherever the circle is, whatever its radius."""
    at_zero = MODEL.bind(plan())
    for settings in ({"centre_x_mm": 300.0}, {"radius_mm": 260.0}):
        tests = [replace(test, **settings) for test in plan().tests]
        elsewhere = MODEL.bind(lb.Plan(tuple(tests)))
        for first, second in zip(
            shared_terms(at_zero.nuisance_columns),
            shared_terms(elsewhere.nuisance_columns),
            strict=True,
        ):
            if first.names[0].startswith(Position.stem):
                np.testing.assert_allclose(second.values, first.values, atol=1e-9)


def test_two_planes_have_a_reference_on_each_axis() -> None:
    """Y moves in both planes, Z in one."""
    tests = [
        lb.CircularTest(100.0, ANGLE_DEG, plane="XY", centre_y_mm=10.0),
        lb.CircularTest(200.0, ANGLE_DEG, plane="XY", centre_y_mm=10.0),
        lb.CircularTest(100.0, ANGLE_DEG, plane="YZ", centre_y_mm=50.0, centre_z_mm=80.0, setup=2),
    ]
    bound = MODEL.bind(lb.Plan(tuple(tests)))
    assert bound.setting.reference_centre_mm == pytest.approx((0.0, 30.0, 80.0))


def test_a_plan_has_the_pressures_of_the_campaign_it_is_predicted_for() -> None:
    """Its own law of the regulator would subtract another deflection of the mount."""
    law = ForceLaw(252.08, 0.0)
    campaign = simulated(replace(plan(compensated=False), force_law=law))
    rule = lb.inference.StoppingRule(ess=300.0)
    posterior = lb.sample(MODEL, campaign, sampler="independent", rule=rule)
    planned_circle = circle()
    by_default = lb.predict(posterior, planned_circle)
    by_law = lb.predict(posterior, replace(campaign.plan(), tests=planned_circle.tests))
    stated = lb.CircularTest(600.0, ANGLE_DEG, pressure_bar=600.0 / 252.08)
    by_pressure = lb.predict(posterior, replace(campaign.plan(), tests=(stated,)))
    np.testing.assert_allclose(by_default["mean_um"], by_pressure["mean_um"], atol=1e-9)
    assert abs(by_default["mean_um"] - by_law["mean_um"]).max() > 1.0


def test_a_pressure_that_the_plan_states_is_kept() -> None:
    campaign = simulated(plan(compensated=False))
    rule = lb.inference.StoppingRule(ess=300.0)
    posterior = lb.sample(MODEL, campaign, sampler="independent", rule=rule)
    higher = lb.Plan((lb.CircularTest(600.0, ANGLE_DEG, pressure_bar=6.0),))
    change_um = (
        lb.predict(posterior, higher)["mean_um"] - lb.predict(posterior, circle())["mean_um"]
    )
    expected_um = 2.33 * (6.0 - CAMPAIGN.force_law.pressure_bar(600.0))
    np.testing.assert_allclose(change_um.mean(), expected_um, rtol=0.1)
