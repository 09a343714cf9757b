"""What compliances stand for: against the wrench Jacobian, whatever the radius; which differences count."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from campaigns import plan

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.fleet.population_prior import same_meaning, stands_for
from ldbb_bayes.machine.chain import ComplianceName
from ldbb_bayes.machine.forward import compliance_jacobian

FRAMES = {"X": (10.0, 300.0, -200.0), "Y": (-50.0, 20.0, 400.0)}


def placed(centre_mm: tuple[float, float, float] = (0.0, 0.0, 0.0), radius_mm: float = 150.0, **fields: Any) -> Campaign:
    """A plan whose circles lie there."""
    x, y, z = centre_mm
    own = {"centre_x_mm": x, "centre_y_mm": y, "centre_z_mm": z, "radius_mm": radius_mm}
    made = plan()
    return replace(made, tests=tuple(replace(test, **own) for test in made.tests), **fields)


def test_the_sum_is_what_readings_see(rng: np.random.Generator) -> None:
    """Joints' compliances drawn, the kept ones made of them: the same readings of a circle off the centre."""
    made = placed((120.0, -40.0, 90.0), frames_mm=FRAMES)
    meant = stands_for(made)
    members = sorted({label for parts in meant.values() for label in parts})
    truth = dict(zip(members, rng.standard_normal(len(members)), strict=True))
    names = [ComplianceName(*label[2:]) for label in (*members, *meant)]
    circle = next(iter(made.tests)).circle
    jacobian = compliance_jacobian(made.machine(), circle, np.linspace(0.0, 6.0, 40), names)
    kept = [sum(weight * truth[label] for label, weight in parts.items()) for parts in meant.values()]
    every = jacobian[:, : len(members)] @ list(truth.values())
    assert np.linalg.norm(jacobian[:, len(members) :] @ kept - every) < 1e-6 * np.linalg.norm(every)


@pytest.mark.parametrize("frames", [{}, FRAMES])
def test_a_radius_does_not_matter(frames: dict[str, Any]) -> None:
    meant = stands_for(placed((0.0, 0.0, 80.0), frames_mm=frames))
    assert meant == stands_for(placed((0.0, 0.0, 80.0), radius_mm=50.0, frames_mm=frames))
    assert meant["C_XXX"]["C_BXX"] == (280.0 if frames else 80.0)


def test_circles_in_the_frames_plane() -> None:
    usual = stands_for(plan())
    assert usual["C_XXX"] == {"C_XXX": 1.0, "C_XXY": 1.0}
    assert stands_for(placed((100.0, -30.0, 0.0))) == usual


def test_a_millimetre_counts_for_nothing_and_a_decimetre_does() -> None:
    one, near, far = (stands_for(placed((0.0, 0.0, z))) for z in (0.0, 1.0, 100.0))
    assert far["C_XXX"]["C_BXX"] == pytest.approx(100.0)
    assert near["C_XXX"] != one["C_XXX"]
    assert all(same_meaning(name, one[name], near[name]) for name in one)
    assert [name for name in one if not same_meaning(name, one[name], far[name])] == ["C_XXX", "C_XYX", "C_YYY", "C_CXY", "C_CYY"]
