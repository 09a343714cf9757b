"""The sign of squareness errors, by the exact forward model."""

from __future__ import annotations

import numpy as np
import pytest

import ldbb_bayes as lb
from ldbb_bayes.machine.parameters import GeometricName
from ldbb_bayes.model.campaign_setting import geometric_errors_of

ANGLES_DEG = np.arange(0.0, 360.0, 5.0)
RADIUS_MM = 150.0


def squareness_of(topology: str, plane: str) -> GeometricName:
    """Return the squareness error that circles in one plane show."""
    circle = lb.CircularTest(100.0, ANGLES_DEG, plane=plane)
    errors = geometric_errors_of(lb.Campaign((circle,), topology=topology))
    (squareness,) = [error for error in errors if error.kind == "squareness"]
    return squareness


@pytest.mark.parametrize("plane", ["XY", "YZ", "ZX"])
@pytest.mark.parametrize("topology", ["wCAFYXZSt", "wXYFZSt", "wZFYXSt"])
def test_an_angle_below_90_degrees_makes_the_diagonal_longer(topology: str, plane: str) -> None:
    """The diagonal between the positive axes, of a path that the error alone deforms."""
    squareness = squareness_of(topology, plane)
    reading_mm = lb.machine.exact_reading_mm(
        lb.Machine(topology, planes=(plane,)),
        lb.machine.Circle(plane=plane, radius_mm=RADIUS_MM),
        np.radians([45.0, 135.0]),
        force_N=0.0,
        geometric_errors={squareness.label: 1e-4},
    )
    half_radius_mm = 0.5 * RADIUS_MM * 1e-4
    sign = 1.0 if squareness.closes_angle else -1.0
    assert reading_mm == pytest.approx([sign * half_radius_mm, -sign * half_radius_mm], rel=1e-3)
