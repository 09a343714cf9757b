"""The tests one could run, in which order to run them, what to expect of them, and the space of
designs made of them.

Model properties, F0, force range and Ĉ, are the pilot's. Ball forms count as two terms as soon as
any clocking differs; where none does, two terms and one are the same model.

Expected are the posterior sd of every parameter, the information gained, constant or linear: of the
linear Gaussian model at given hyper-parameters, averaged over these; sd inside the truncation,
evidence without it. This takes the general route through `ldbb_bayes.model.information.Information`
and none of the search's.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from ldbb_bayes.campaign.campaign import Campaign, CircularTest, Direction
from ldbb_bayes.machine.chain import PLANES
from ldbb_bayes.model.hybrid import BoundModel, HybridModel

__all__ = ["Clocking", "bind_tests", "running_order"]

Clocking = tuple[float, float]


def templates(pilot: Campaign, directions: Sequence[Direction] = ()) -> tuple[CircularTest, ...]:
    """A test without readings for every plane of the pilot and every direction, by default those of
    the pilot there; else it is like the pilot's test in that plane with the median number of
    readings, its angles in equal steps."""
    made: list[CircularTest] = []
    for plane in dict.fromkeys(test.plane for test in pilot.tests):
        there = [test for test in pilot.tests if test.plane == plane]
        plain = sorted(there, key=lambda test: len(test.angle_deg))[len(there) // 2]
        plain = replace(
            plain.planned(), pressure_bar=None, name="", temperature_C=None, time_s=None
        )
        ways: Sequence[Direction | None] = directions or tuple(
            dict.fromkeys(test.direction for test in there)
        )
        made += [replace(plain, direction=way) for way in ways]
    return tuple(made)


def foreseen_by(
    pilot: Campaign, candidates: Sequence[CircularTest], judged: Sequence[CircularTest] = ()
) -> Campaign:
    """The pilot, knowing of tests of a kind it has not run: what only they can show is in its
    model. Where candidates go both ways in a plane, so do those foreseen: hysteresis then counts
    for every design. Tests that are only judged bring their parameters, not their direction."""
    both = {
        plane
        for plane in PLANES
        if {"CW", "CCW"} <= {test.direction for test in candidates if test.plane == plane}
    }
    possible = [(test, test.direction if str(test.plane) in both else None) for test in candidates]
    possible += [(test, None) for test in judged]
    offset = any(map(any, pilot.frames_mm.values())) or any(
        any(t.circle.centre_mm) for t in (*pilot.scope, *candidates, *judged)
    )

    def kind(test: CircularTest, *way: Any) -> tuple[Any, ...]:
        return (
            test.plane,
            test.setup,
            test.circle.centre_mm,
            test.radius_mm if offset else None,
            *way,
        )

    # A direction counts as foreseen only where it is: the pilot's own tests need not be part of
    # what is analysed.
    there = {kind(test) for test in pilot.scope} | {
        kind(test, test.direction) for test in pilot.foreseen
    }
    further = {kind(test, *([way] if way else [])): (test, way) for test, way in reversed(possible)}
    new = [replace(test, direction=way) for key, (test, way) in further.items() if key not in there]
    return replace(pilot, foreseen=(*pilot.foreseen, *new)) if new else pilot


def grid_of_tests(
    templates: Sequence[CircularTest],
    forces_N: Sequence[float],
    clockings_deg: Sequence[Clocking],
    radii_mm: Sequence[float],
) -> tuple[CircularTest, ...]:
    """Every combination as a planned test: all forces of the first template, radius and clocking,
    then of the next."""
    return tuple(
        replace(
            like,
            force_N=float(force),
            work_ball_deg=float(work),
            tool_ball_deg=float(tool),
            radius_mm=float(radius),
        )
        for like, radius, (work, tool), force in product(
            templates, radii_mm, clockings_deg, forces_N
        )
    )


def bind_tests(
    model: HybridModel, pilot: Campaign, tests: Sequence[CircularTest], *, keep: bool
) -> BoundModel:
    """The model bound to a plan of these tests, after the pilot's own where these are kept; F0,
    force range and Ĉ the pilot's."""
    run = pilot.plan().tests
    planned = tuple(replace(test, name="") if test.name else test for test in tests)
    known = (*pilot.foreseen, *(replace(test, direction=None) for test in run))
    return BoundModel(
        model, replace(pilot, tests=(*(run if keep else ()), *planned), foreseen=known), pilot=pilot
    )


def running_order(
    tests: Sequence[CircularTest], rng: np.random.Generator
) -> tuple[CircularTest, ...]:
    """The tests in the order in which to run them, so that drift is not force: blocks of one
    set-up, plane and radius, in them of one work-ball clocking, in them of one tool-ball clocking,
    there and back; forces and directions of travel at random."""

    def blocks(
        tests: Sequence[CircularTest], key: Callable[[CircularTest], Any]
    ) -> list[list[CircularTest]]:
        keys = sorted({key(test) for test in tests})
        return [
            [test for test in tests if key(test) == keys[i]] for i in rng.permutation(len(keys))
        ]

    ordered: list[CircularTest] = []
    for mounted in blocks(tests, lambda test: test.setup or 1):
        for place in blocks(mounted, lambda test: (str(test.plane), float(test.radius_mm or 0.0))):
            for k, turned in enumerate(blocks(place, lambda test: test.work_ball_deg)):
                for tool in sorted({test.tool_ball_deg for test in turned}, reverse=bool(k % 2)):
                    alike = [test for test in turned if test.tool_ball_deg == tool]
                    ordered += [alike[i] for i in rng.permutation(len(alike))]
    return tuple(replace(test, name="") for test in ordered)


# ---- what to expect of tests before they are run


# ---- the space of designs
