"""What would end a degeneracy: tests tried by adding them to the plan, and the calibration that supplies the nuisance."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.campaign.circular_test import CircularTest, Direction
from ldbb_bayes.errors import InputError
from ldbb_bayes.model.bound import BoundModel
from ldbb_bayes.model.degeneracies import Degeneracy, degeneracies
from ldbb_bayes.model.wording import joined

__all__ = ["cures"]

_FULL_DEG = 355.0
_MANY = 36
_CALIBRATIONS: Mapping[str, str] = {
    "BallForm": "a calibration of the balls' form",
    "BarLength": "a calibration of the bar's length",
    "Mount": "a measurement of the mount's deflection",
    "ForceError": "a calibration of the force",
    "Hysteresis": "a narrower prior of it",
    "Drift": "a measurement of it",
}


def cures(bound: BoundModel, found: Sequence[Degeneracy]) -> tuple[str, ...]:
    """For each degeneracy what would end it: tests tried by adding them to the plan, and the calibration that supplies it."""
    tried = {words: degeneracies(_with_tests(bound, tests)) for words, tests in _further_tests(bound.campaign.plan()).items()}
    said = []
    for degeneracy in found:
        helping = [words for words, left in tried.items() if not any(_same(degeneracy, other) for other in left)]
        if any(words in helping for words in ("clocking the work ball (0/45/90°)", "clocking the tool ball (0/45/90°)")):
            helping = [words for words in helping if not words.startswith("clocking both")]
        if degeneracy.term:
            helping.append(_CALIBRATIONS[degeneracy.term])
        text = joined(helping, "or") if helping else "a narrower prior on one of them"
        said.append(text[0].upper() + text[1:] + ".")
    return tuple(said)


def _with_tests(bound: BoundModel, tests: Sequence[CircularTest]) -> BoundModel:
    """The same model bound to a plan with further tests."""
    plan = bound.campaign.plan()
    more = replace(plan, tests=(*plan.tests, *(replace(test, name="") for test in tests)))
    return BoundModel(bound.model, more, pilot=bound.pilot)


def _same(one: Degeneracy, other: Degeneracy) -> bool:
    """Whether another plan still has it: the nuisance in the same pattern, or parameters two of which it shares."""
    if one.term != other.term:
        return False
    if one.term:
        return _order(one.nuisances[0]) == _order(other.nuisances[0])
    return len(set(one.parameters) & set(other.parameters)) >= min(2, len(one.parameters))


def _further_tests(plan: Campaign) -> dict[str, list[CircularTest]]:
    """Tests one could add, by what is new about them."""
    first, last = min(plan.tests, key=_force), max(plan.tests, key=_force)
    radius = float(first.radius_mm or plan.radius_mm)

    def again(work: float, tool: float) -> list[CircularTest]:
        return [
            replace(test, work_ball_deg=test.work_ball_deg + work * turn, tool_ball_deg=test.tool_ball_deg + tool * turn)
            for test in plan.tests
            for turn in (45.0, 90.0)
        ]

    levels = [round(factor * _force(test), 3) for factor, test in ((0.5, first), (1.5, last))]
    further = {
        "other force levels": [replace(first, force_N=level, pressure_bar=None) for level in levels],
        "clocking the work ball (0/45/90°)": again(1.0, 0.0),
        "clocking the tool ball (0/45/90°)": again(0.0, 1.0),
        "clocking both balls (0/45/90°)": again(1.0, 1.0),
        "a second radius": [replace(test, radius_mm=round(radius * 2.0 / 3.0, 1)) for test in plan.tests],
    }
    if all(test.direction for test in plan.tests):
        turned: dict[str, Direction] = {"CW": "CCW", "CCW": "CW"}
        further["both directions of travel at the same forces"] = [
            replace(test, direction=turned.get(test.direction or "")) for test in plan.tests
        ]
    times = [test.time_s for test in plan.tests]
    if all(time is not None for time in times) and len(set(times)) > 1:
        end = 2.0 * max(time for time in times if time is not None) + 1.0
        further["the same tests once more in reverse order"] = [
            replace(test, time_s=end - float(test.time_s or 0.0)) for test in plan.tests
        ]
    if any(test.arc_deg < _FULL_DEG or len(np.unique(np.round(test.angle_deg % 360.0, 6))) < _MANY for test in plan.tests):
        further["full circles of more readings"] = [replace(test, angle_deg=np.arange(120) * 3.0) for test in plan.tests]
    return further


def _force(test: CircularTest) -> float:
    if test.force_N is None:
        raise InputError(f"{test.label} must have a force here.")
    return float(test.force_N)


def _order(nuisance: str) -> str:
    """What kind of pattern a nuisance coefficient has, whichever ball it is of."""
    return re.sub(r"^(work_|tool_)|_(cos|sin)|_[\d.]+$", "", nuisance)
