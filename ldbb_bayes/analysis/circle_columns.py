"""Effects of the parameters on the circle of one test, at any bar force.

A circle is described by 25 Fourier coefficients of its radial deviation. The effect of a parameter
is one column of the design matrix: the changes of these coefficients per unit of the parameter.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ldbb_bayes.campaign.circular_test import CENTRE
from ldbb_bayes.model.campaign_setting import geometric_errors_of
from ldbb_bayes.model.fourier import harmonic_index
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.results import Array

__all__ = [
    "ANGLE_RAD",
    "COS2",
    "SIN2",
    "MachineColumns",
    "SecondOrderFactors",
    "first_circle",
    "is_tool_ball_offset",
    "machine_columns",
    "place_of_circle",
    "second_order_factors",
    "squareness_name",
]

# Angles at which tool paths are evaluated [rad]: 0°, 1° … 359°.
ANGLE_RAD = np.arange(360) * (np.pi / 180.0)
# Indices of cos 2θ and sin 2θ among the 25 Fourier coefficients of a circle.
COS2, SIN2 = harmonic_index(2)


class MachineColumns(NamedTuple):
    """Changes of the 25 Fourier coefficients of one circle per unit of each of p parameters.

    The coefficients describe the radial deviation of the circle [mm]. The parameters are the
    compliances, their slopes (changes with force) and the geometric errors.
    """

    #: changes per unit of compliances and slopes, shape (25, p); the columns of geometric errors
    #: are zero
    elastic: Array
    #: changes per unit of geometric errors, shape (25, p); the columns of compliances and slopes
    #: are zero
    geometric: Array


class SecondOrderFactors(NamedTuple):
    """Factors that convert a circle's second harmonic [µm] to scale mismatch and squareness [µm/m].

    The second harmonic of the radial deviation has two amplitudes: one of cos 2θ and one of sin 2θ.
    """

    #: scale mismatch of the plane's two axes, divided by the amplitude of cos 2θ
    scale_mismatch: float
    #: squareness of the plane's two axes, divided by the amplitude of sin 2θ
    squareness: float


def machine_columns(bound: BoundModel, r: int, force_N: float) -> MachineColumns:
    """Return the effects of the parameters on the circle of the test with index ``r``.

    The effects are computed at the force ``force_N`` of the bar [N], which may differ from the
    force of the test.
    """
    is_geometric = np.array([parameter.group == "geometric" for parameter in bound.parameters])
    elastic = force_N * bound.setting.elastic[r] @ bound.compliance_at(force_N)
    return MachineColumns(elastic, np.where(is_geometric, bound.interest_columns[r], 0.0))


def second_order_factors(bound: BoundModel, r: int) -> SecondOrderFactors:
    """Return the factors that convert the second harmonic to scale mismatch and squareness.

    The second harmonic is that of the radial deviation [µm] in the circle of the test with index
    ``r``. Scale mismatch and squareness are those of the two axes of the circle's plane. The
    factors depend on the radius and the plane of the circle.
    """
    radius_m = float(bound.setting.radius_mm[r]) * 1e-3
    sin2_of_squareness = float(bound.setting.geometric[r][SIN2, _squareness_index(bound, r)])
    return SecondOrderFactors(2.0 / radius_m, 1e3 / sin2_of_squareness)


def _squareness_index(bound: BoundModel, r: int) -> int:
    """Return the index of the squareness error in the plane of the test with index ``r``.

    The result is the position of this error in the list of the campaign's geometric errors, counted
    from 0. ``bound`` is the model applied to the campaign.
    """
    sin2 = bound.setting.geometric[r][SIN2]
    for j, error in enumerate(geometric_errors_of(bound.campaign)):
        if error.kind == "squareness" and sin2[j] != 0.0:
            return j
    raise LookupError(f"test {r} must have a squareness error in its plane, got none")


def squareness_name(bound: BoundModel, plane: str) -> str:
    """Return the name of the squareness error of a plane, such as ``E_C0YX``."""
    index = _squareness_index(bound, first_circle(bound, plane))
    return geometric_errors_of(bound.campaign)[index].label


def first_circle(bound: BoundModel, plane: str) -> int:
    """Return the index of the first test of the campaign in a plane, such as XY."""
    return list(bound.setting.plane).index(plane)


def place_of_circle(bound: BoundModel, r: int) -> dict[str, Any]:
    """Return where the circle of the test with index ``r`` lies.

    The keys are names of columns of tables: the plane, the radius and the centre of the circle. The
    centre is given by its machine coordinates X, Y and Z [mm].
    """
    circle = bound.campaign.tests[r].circle
    place = {"plane": str(bound.setting.plane[r]), "radius_mm": float(bound.setting.radius_mm[r])}
    return place | dict(zip(CENTRE, map(float, circle.centre_mm), strict=True))


def is_tool_ball_offset(bound: BoundModel) -> Array:
    """Return a mask of the p parameters, shape (p,), that is true for offsets of the tool ball."""
    return np.array([name.startswith("E_") and name[3] == "t" for name in bound.names])
