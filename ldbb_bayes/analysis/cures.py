"""Find further tests that would separate what no reading of a campaign separates."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from enum import StrEnum

import numpy as np

from ldbb_bayes.analysis.aliases import Degeneracy, degeneracies
from ldbb_bayes.campaign.campaign import Campaign, CircularTest, Direction
from ldbb_bayes.model.hybrid import BoundModel

__all__ = ["Cure", "cures"]


class Cure(StrEnum):
    """What would separate a degeneracy's members: further tests, or a calibration of the
    nuisance."""

    FORCES = "forces"
    WORK_BALL = "work ball"
    TOOL_BALL = "tool ball"
    BOTH_BALLS = "both balls"
    RADIUS = "radius"
    DIRECTIONS = "directions"
    FULL_CIRCLES = "full circles"
    CALIBRATION = "calibration"


_FULL_DEG = 355.0


_MANY = 36


def cures(bound: BoundModel, found: Sequence[Degeneracy]) -> tuple[tuple[Cure, ...], ...]:
    """Return for each degeneracy what would end it: tests tried by adding them to the plan, and the
    nuisance's calibration."""
    plan = bound.campaign.plan()
    tried = {}
    every = []
    for cure, tests in _further_tests(plan).items():
        more = replace(plan, tests=(*plan.tests, *(replace(test, name="") for test in tests)))
        tried[cure] = degeneracies(BoundModel(bound.model, more, pilot=bound.pilot))
    for degeneracy in found:
        helping = [
            cure
            for cure, left in tried.items()
            if not any(_same(degeneracy, other) for other in left)
        ]
        if {Cure.WORK_BALL, Cure.TOOL_BALL} & set(helping):
            helping = [cure for cure in helping if cure != Cure.BOTH_BALLS]
        every.append((*helping, *([Cure.CALIBRATION] if degeneracy.term else [])))
    return tuple(every)


def _same(one: Degeneracy, other: Degeneracy) -> bool:
    """Whether another plan still has it: the nuisance in the same pattern, or parameters two of
    which it shares."""
    if one.term != other.term:
        return False
    if one.term:
        return _order(one.nuisances[0]) == _order(other.nuisances[0])
    return len(set(one.parameters) & set(other.parameters)) >= min(2, len(one.parameters))


def _further_tests(plan: Campaign) -> dict[Cure, list[CircularTest]]:
    """Tests one could add, by what is new about them."""
    forces = plan.forces_N
    first = plan.tests[int(forces.argmin())]
    radius = float(first.radius_mm or plan.radius_mm)

    def again(work: float, tool: float) -> list[CircularTest]:
        return [
            replace(
                test,
                work_ball_deg=test.work_ball_deg + work * turn,
                tool_ball_deg=test.tool_ball_deg + tool * turn,
            )
            for test in plan.tests
            for turn in (45.0, 90.0)
        ]

    levels = round(0.5 * float(forces.min()), 3), round(1.5 * float(forces.max()), 3)
    further = {
        Cure.FORCES: [replace(first, force_N=level, pressure_bar=None) for level in levels],
        Cure.WORK_BALL: again(1.0, 0.0),
        Cure.TOOL_BALL: again(0.0, 1.0),
        Cure.BOTH_BALLS: again(1.0, 1.0),
        Cure.RADIUS: [replace(test, radius_mm=round(radius * 2.0 / 3.0, 1)) for test in plan.tests],
    }
    if all(test.direction for test in plan.tests):
        turned: dict[str, Direction] = {"CW": "CCW", "CCW": "CW"}
        further[Cure.DIRECTIONS] = [
            replace(test, direction=turned.get(test.direction or "")) for test in plan.tests
        ]
    if any(
        test.arc_deg < _FULL_DEG or len(np.unique(np.round(test.angle_deg % 360.0, 6))) < _MANY
        for test in plan.tests
    ):
        further[Cure.FULL_CIRCLES] = [
            replace(test, angle_deg=np.arange(120) * 3.0) for test in plan.tests
        ]
    return further


def _order(nuisance: str) -> str:
    """What kind of pattern a nuisance coefficient has, whichever ball it is of."""
    return re.sub(r"^(work_|tool_)|_(cos|sin)|_[\d.]+$", "", nuisance)
