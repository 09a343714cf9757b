"""Predicted circles at other places of the machine, and with another law of the regulator."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from campaigns import plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.campaign.loading import ForceLaw
from ldbb_bayes.inference.coefficients import shared_terms
from ldbb_bayes.inference.other_circles import shared_terms_of_plan
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
    measured, planned = _bind_with_plan(MODEL.bind(CAMPAIGN), circle(**settings))
    terms = {term.names: term for term in shared_terms_of_plan(measured, planned)}
    angle = np.deg2rad(ANGLE_DEG)
    for axis, u in enumerate((np.cos(angle), np.sin(angle))):
        letter = "XY"[axis]
        names = (f"position_{letter}_linear", f"position_{letter}_quadratic")
        place = (centre_mm[axis] + radius_mm * u) / 150.0
        readings = basis(angle) @ terms[names].values[0]
        np.testing.assert_allclose(readings[:, 0], 600.0 * u**2 * place, atol=1e-9)
        np.testing.assert_allclose(readings[:, 1], 600.0 * u**2 * (place**2 - 0.5), atol=1e-9)


def test_all_other_effects_are_those_of_the_plan() -> None:
    measured, planned = _bind_with_plan(MODEL.bind(CAMPAIGN), circle(centre_x_mm=300.0))
    moved = shared_terms_of_plan(measured, planned)
    own = shared_terms(planned.nuisance_columns)
    assert [term.names for term in moved] == [term.names for term in own]
    for first, second in zip(moved, own, strict=True):
        is_same = np.array_equal(first.values, second.values)
        assert is_same is (first.names[0] != f"{Position.stem}_X_linear"), first.names


def test_the_nearest_measured_circle_of_the_plane_counts() -> None:
    """Twice the radius of the small circle, three quarters of that of the large one."""
    small, large = plan(), plan()
    tests = [replace(test, name="") for test in small.tests]
    for test in large.tests:
        tests.append(replace(test, name="", radius_mm=400.0, centre_x_mm=500.0))
    both = simulated(replace(small, tests=tuple(tests)))
    for centre_x_mm, expected in ((20.0, 2.0), (480.0, 0.75)):
        planned_circle = circle(radius_mm=300.0, centre_x_mm=centre_x_mm)
        union = replace(both, foreseen=planned_circle.tests)
        measured, planned = _bind_with_plan(MODEL.bind(union), planned_circle)
        (term,) = [
            term
            for term in shared_terms_of_plan(measured, planned)
            if term.names[0] == "position_Y_linear"
        ]
        readings = basis(np.deg2rad(ANGLE_DEG)) @ term.values[0, :, 0]
        u = np.sin(np.deg2rad(ANGLE_DEG))
        np.testing.assert_allclose(readings, 600.0 * u**3 * expected, atol=1e-9)


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
