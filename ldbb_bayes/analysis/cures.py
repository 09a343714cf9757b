"""Further tests, or a calibration, that would resolve the degeneracies of a campaign.

A degeneracy is a combination of parameters and nuisance coefficients whose effects on every reading
cancel. Nuisance coefficients describe effects that are modelled but not of interest.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from ldbb_bayes.analysis.aliases import Degeneracy, degeneracies
from ldbb_bayes.campaign.campaign import Campaign, CircularTest, Direction
from ldbb_bayes.model.hybrid import BoundModel

__all__ = ["Cure", "Directed", "at_other_radius", "clocked", "cures", "in_other_direction"]

# A test whose arc is shorter than this angle is not a full circle [°].
_FULL_CIRCLE_DEG = 355.0
# A test with readings at fewer different angles than this number is not treated as a full circle,
# because its readings do not determine all Fourier orders.
_FEWEST_ANGLES = 36
# Angles of the readings [°] in the full circles that are tried as further tests.
_FULL_CIRCLE_ANGLES_DEG = np.arange(120) * 3.0
# Two angles of readings [°] count as equal if they are equal after rounding to this number of
# decimals.
_ANGLE_DECIMALS = 6
# Angles by which a ball is turned in its socket in further tests [°], to separate the form error of
# the ball from the machine's errors.
_CLOCKINGS_DEG = (45.0, 90.0)
# Tests at two other forces may be added to a plan: at ``_LOWER_FORCE_SHARE`` times the lowest force
# of the plan, and at ``_HIGHER_FORCE_SHARE`` times its highest force.
_LOWER_FORCE_SHARE = 0.5
_HIGHER_FORCE_SHARE = 1.5
# If tests at another radius are added to a plan, their radius is a radius of the plan times this
# factor, or times its square, its cube and so on.
_OTHER_RADIUS_SHARE = 2.0 / 3.0
# The radii of two circles are treated as equal if their difference is at most this share of the
# larger radius.
_SAME_RADIUS_SHARE = 0.01
# Opposite of each direction of travel, which is clockwise (CW) or counterclockwise (CCW).
_OPPOSITE: dict[str, Direction] = {"CW": "CCW", "CCW": "CW"}
# Direction of travel that is assumed for the circles of a plane if none of these circles states a
# direction.
_FIRST_DIRECTION: Direction = "CW"


class Cure(StrEnum):
    """A way to resolve a degeneracy: further tests of one kind, or a calibration.

    The further tests differ from those of the plan in one respect. For example, they are run at
    other forces, with a ball turned, at another radius, or in the opposite direction.
    """

    FORCES = "forces"
    WORK_BALL = "work ball"
    TOOL_BALL = "tool ball"
    BOTH_BALLS = "both balls"
    RADIUS = "radius"
    DIRECTIONS = "directions"
    FULL_CIRCLES = "full circles"
    CALIBRATION = "calibration"


def cures(bound: BoundModel, aliases: Sequence[Degeneracy]) -> tuple[tuple[Cure, ...], ...]:
    """Return what would resolve each degeneracy: kinds of further tests, or a calibration.

    The result lists each kind of tests that removes the degeneracy when such tests are added to the
    plan. One kind is tests with one ball turned; tests with both balls turned are listed only if
    one turned ball is not enough. A calibration is listed for every degeneracy whose field ``term``
    is not empty. In such a degeneracy, other coefficients cancel the effect of a nuisance
    coefficient, and a calibration could determine this effect.

    Parameters
    ----------
    bound
        Model applied to a campaign or plan.
    aliases
        The `degeneracies` of the bound model. The result has one entry for each degeneracy, in the
        same order.
    """
    plan = bound.campaign.plan()
    remaining_after: dict[Cure, tuple[Degeneracy, ...]] = {}
    directed = in_other_direction(plan)
    for cure, tests in _further_tests(plan, directed).items():
        before = directed.stated if cure == Cure.DIRECTIONS else plan.tests
        unnamed = [replace(test, name="") for test in tests]
        longer_plan = replace(plan, tests=(*before, *unnamed))
        longer = BoundModel(bound.model, longer_plan, pilot=bound.pilot)
        remaining_after[cure] = degeneracies(longer)
    cures_of_each = []
    for degeneracy in aliases:
        helpful = [
            cure
            for cure, remaining in remaining_after.items()
            if not _is_among(degeneracy, remaining)
        ]
        if Cure.WORK_BALL in helpful or Cure.TOOL_BALL in helpful:
            helpful = [cure for cure in helpful if cure != Cure.BOTH_BALLS]
        if degeneracy.term:
            helpful.append(Cure.CALIBRATION)
        cures_of_each.append(tuple(helpful))
    return tuple(cures_of_each)


def _is_among(degeneracy: Degeneracy, remaining: Sequence[Degeneracy]) -> bool:
    """Return whether a degeneracy of a plan is among those that ``remaining`` lists."""
    return any(_is_same(degeneracy, candidate) for candidate in remaining)


def _is_same(degeneracy: Degeneracy, candidate: Degeneracy) -> bool:
    """Return whether two degeneracies are treated as the same degeneracy.

    The pivot of a degeneracy is the coefficient whose effect on the readings the other coefficients
    cancel. Two degeneracies whose pivots are nuisance coefficients are the same if the names of the
    pivots differ at most in the ball, the phase (cosine or sine) or the radius. Two degeneracies
    whose pivots are parameters are the same if they have two parameters in common. If
    ``degeneracy`` has only one parameter, it is enough that they have this one in common.
    """
    if degeneracy.term != candidate.term:
        return False
    if degeneracy.term:
        name = _name_without_details(degeneracy.nuisances[0])
        return name == _name_without_details(candidate.nuisances[0])
    shared = set(degeneracy.parameters) & set(candidate.parameters)
    return len(shared) >= min(2, len(degeneracy.parameters))


def _name_without_details(nuisance: str) -> str:
    """Return the name of a nuisance coefficient without the ball, the phase and the radius.

    In the name, ``work_`` or ``tool_`` at the beginning states the ball, ``_cos`` or ``_sin`` the
    phase, and a number at the end the radius.
    """
    return re.sub(r"^(work_|tool_)|_(cos|sin)|_[\d.]+$", "", nuisance)


def _further_tests(plan: Campaign, directed: Directed) -> dict[Cure, list[CircularTest]]:
    """Return tests that may separate effects which a plan cannot separate.

    The result is a dict. Its keys are the kinds of tests, such as tests at other forces.
    ``directed`` holds the circles of the plan with their directions of travel, and copies of these
    circles in the opposite direction.
    """
    further = {
        Cure.FORCES: _at_other_forces(plan),
        Cure.WORK_BALL: clocked(plan, _CLOCKINGS_DEG, work_ball=True),
        Cure.TOOL_BALL: clocked(plan, _CLOCKINGS_DEG, tool_ball=True),
        Cure.BOTH_BALLS: clocked(plan, _CLOCKINGS_DEG, work_ball=True, tool_ball=True),
        Cure.RADIUS: at_other_radius(plan),
    }
    if directed.further:
        further[Cure.DIRECTIONS] = directed.further
    if any(_is_incomplete(test) for test in plan.tests):
        further[Cure.FULL_CIRCLES] = [
            replace(test, angle_deg=_FULL_CIRCLE_ANGLES_DEG) for test in plan.tests
        ]
    return further


def _at_other_forces(plan: Campaign) -> list[CircularTest]:
    """Return two copies, with other forces, of the test that has the lowest force of a plan.

    One copy has half the lowest force of the plan, the other 1.5 times the highest force.
    """
    forces = plan.forces_N
    first = plan.tests[int(forces.argmin())]
    lower = round(_LOWER_FORCE_SHARE * float(forces.min()), 3)
    higher = round(_HIGHER_FORCE_SHARE * float(forces.max()), 3)
    return [replace(first, force_N=force, pressure_bar=None) for force in (lower, higher)]


class Directed(NamedTuple):
    """Circles of a plan with their directions of travel, and copies in the opposite direction.

    ``stated`` are the circles of the plan. If no circle of a plane states its direction, all
    circles of the plane are taken to be clockwise. If all circles of a plane have the same
    direction, ``further`` holds a copy of each of them in the opposite direction.
    """

    stated: list[CircularTest]
    further: list[CircularTest]


def in_other_direction(plan: Campaign) -> Directed:
    """Return the circles of a plan, and copies of them that run in the opposite direction."""
    directions_of: dict[str, set[str | None]] = {}
    for test in plan.tests:
        directions_of.setdefault(str(test.plane), set()).add(test.direction)
    stated = []
    further = []
    for test in plan.tests:
        directions = directions_of[str(test.plane)]
        directed = test
        if directions == {None}:
            directed = replace(test, direction=_FIRST_DIRECTION)
        stated.append(directed)
        if len(directions) == 1 and directed.direction is not None:
            further.append(replace(directed, direction=_OPPOSITE[directed.direction]))
    return Directed(stated, further)


def clocked(
    plan: Campaign,
    turns_deg: Sequence[float],
    *,
    work_ball: bool = False,
    tool_ball: bool = False,
) -> list[CircularTest]:
    """Return copies of all tests of a plan with one ball or both balls turned in their sockets.

    Each test is copied once for each angle of ``turns_deg`` [°]. In the copy, this angle is added
    to the angle by which the ball is turned in the test. ``work_ball`` and ``tool_ball`` say which
    balls are turned.
    """
    tests = []
    for test in plan.tests:
        for turn in turns_deg:
            turned = test
            if work_ball:
                turned = replace(turned, work_ball_deg=test.work_ball_deg + turn)
            if tool_ball:
                turned = replace(turned, tool_ball_deg=test.tool_ball_deg + turn)
            tests.append(turned)
    return tests


def at_other_radius(plan: Campaign) -> list[CircularTest]:
    """Return copies of all tests of a plan at a radius that the plan does not have.

    The new radius is two thirds of the radius of the test with the lowest force. If a test of the
    plan has nearly this radius, the new radius is multiplied by two thirds again, and so on.
    """
    radii_of_plan = np.array([test.circle.radius_mm for test in plan.tests])
    radius = float(radii_of_plan[plan.forces_N.argmin()])
    while np.isclose(radius, radii_of_plan, rtol=_SAME_RADIUS_SHARE).any():
        radius *= _OTHER_RADIUS_SHARE
    return [replace(test, radius_mm=radius) for test in plan.tests]


def _is_incomplete(test: CircularTest) -> bool:
    """Return whether a test is an arc, or has readings at too few angles for a full circle."""
    angles = np.unique(np.round(test.angle_deg % 360.0, _ANGLE_DECIMALS))
    return test.arc_deg < _FULL_CIRCLE_DEG or len(angles) < _FEWEST_ANGLES
