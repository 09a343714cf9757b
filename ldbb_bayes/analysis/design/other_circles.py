"""Kinds of circles that are not among those to choose from, and the space with these added.

If circles of the kinds allowed do not reach an aim, circles of other kinds may: of both directions
of travel, with the balls turned in their sockets, of a second radius, or at another force.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from enum import StrEnum
from typing import Any

from ldbb_bayes.analysis.design.candidates import Clocking
from ldbb_bayes.analysis.design.space import Space
from ldbb_bayes.campaign.campaign import Direction, distinct_forces

__all__ = ["CircleKind", "kinds_not_allowed", "with_other_kinds"]

# Clockings (pairs of angles of the balls [°]), directions, and ratios of radii and of forces to
# those of a campaign, that are added to a space that has only one of them. Turns of 45° and 90°
# change the phase of form errors with 2, 3 and 4 waves per turn.
_CLOCKINGS: tuple[Clocking, ...] = ((0.0, 0.0), (45.0, 45.0), (90.0, 90.0))
_DIRECTIONS: tuple[Direction, ...] = ("CW", "CCW")
_RATIO_OF_RADII = 2.0 / 3.0
_RATIO_OF_FORCES = 0.5


class CircleKind(StrEnum):
    """Kind of circles that differ from one another in one setting."""

    FORCES = "another force"
    DIRECTIONS = "both directions"
    BALLS = "turned balls"
    RADII = "a second radius"


def kinds_not_allowed(space: Space) -> tuple[CircleKind, ...]:
    """Return the kinds of circles that are not among the possible next circles in ``space``."""
    settings: dict[CircleKind, Collection[Any]] = {
        CircleKind.FORCES: distinct_forces([*space.pilot.forces_N, *space.forces_N]),
        CircleKind.DIRECTIONS: {test.direction for test in space.tests},
        CircleKind.BALLS: {(test.work_ball_deg, test.tool_ball_deg) for test in space.tests},
        CircleKind.RADII: {test.radius_mm for test in space.tests},
    }
    return tuple(kind for kind, values in settings.items() if len(values) < 2)


def with_other_kinds(space: Space) -> Space:
    """Return a space of possible circles to which all kinds of circles that it lacks are added.

    If the circles run so far state no direction, they count as run clockwise: the model takes them
    to be of one direction, too. Of many forces the lowest and the highest are kept.
    """
    kinds = kinds_not_allowed(space)
    pilot = space.pilot
    forces_N = [min(space.forces_N), max(space.forces_N)]
    if CircleKind.FORCES in kinds:
        forces_N.append(_RATIO_OF_FORCES * forces_N[0])
    directions = space.directions
    if CircleKind.DIRECTIONS in kinds:
        directions = _DIRECTIONS
        tests = [replace(test, direction=test.direction or "CW") for test in pilot.tests]
        foreseen = [replace(test, direction=test.direction or "CW") for test in pilot.foreseen]
        pilot = replace(pilot, tests=tuple(tests), foreseen=tuple(foreseen))
    clockings_deg = space.clockings_deg
    if CircleKind.BALLS in kinds:
        clockings_deg = (*clockings_deg, *_CLOCKINGS)
    radii_mm = tuple(space.radii_mm)
    if CircleKind.RADII in kinds:
        radii_mm = (*radii_mm, _RATIO_OF_RADII * radii_mm[0])
    return replace(
        space,
        pilot=pilot,
        forces_N=forces_N,
        directions=directions,
        clockings_deg=clockings_deg,
        radii_mm=radii_mm,
    )
