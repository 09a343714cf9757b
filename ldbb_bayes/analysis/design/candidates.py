"""Candidate tests of a design, the model applied to them, and the order in which to run tests.

The pilot is the campaign or plan that a design starts from. The model takes its reference force F0,
its range of force, and the estimate Ĉ of the compliances about which it is linearised, from the
pilot. A clocking is the pair of angles by which the two balls are turned. If the tests have
different clockings, the model has separate terms for the form errors of the two balls. If all tests
have the same clocking, the readings cannot distinguish the form errors of the two balls, and the
model has one common term for both balls.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from ldbb_bayes.campaign.campaign import Campaign, CircularTest, Direction
from ldbb_bayes.campaign.circular_test import planned_angles
from ldbb_bayes.campaign.run_times import (
    SECONDS_PER_TEST,
    TimeSource,
    after_the_others,
    time_source,
    with_listed_times,
)
from ldbb_bayes.machine.chain import PLANES
from ldbb_bayes.model.hybrid import BoundModel, HybridModel

__all__ = [
    "Clocking",
    "add_foreseen_tests",
    "bind_plan",
    "bind_tests",
    "grid_of_tests",
    "running_order",
    "templates",
]

# An order of tests is not used if the absolute correlation between the forces of the tests and
# their positions exceeds ``_MOST_SORTED``. At most ``_MOST_ORDERS`` random orders are drawn.
_MOST_SORTED = 0.5
_MOST_ORDERS = 24

# Clocking of a test: pair of angles by which the work ball and the tool ball are turned in their
# sockets [°].
Clocking = tuple[float, float]


def templates(pilot: Campaign, directions: Sequence[Direction] = ()) -> tuple[CircularTest, ...]:
    """Return a test without readings for every plane and every direction of travel.

    ``directions`` are the directions of travel. By default, each plane has the directions of the
    pilot's tests in the plane. All other settings are copied from one of the pilot's tests in the
    plane: the test with the median number of readings. The angles of the tests returned are in
    equal steps. A plane of which the pilot has only foreseen tests counts, too.
    """
    tests: list[CircularTest] = []
    for plane in dict.fromkeys(test.plane for test in pilot.scope):
        in_plane = [test for test in pilot.tests if test.plane == plane]
        if not in_plane:
            # The angles of foreseen tests have no meaning.
            angle_deg = _median_test(pilot.tests).angle_deg
            foreseen = [test for test in pilot.foreseen if test.plane == plane]
            in_plane = [replace(test, angle_deg=angle_deg) for test in foreseen]
        template = replace(
            _median_test(in_plane).planned(),
            pressure_bar=None,
            name="",
            temperature_C=None,
            time_s=None,
        )
        plane_directions: Iterable[Direction | None] = directions
        if not directions:
            plane_directions = dict.fromkeys(test.direction for test in in_plane)
        tests += [_in_direction(template, direction) for direction in plane_directions]
    return tuple(tests)


def _in_direction(test: CircularTest, direction: Direction | None) -> CircularTest:
    """Return a planned test in a direction of travel, with its angles in this order.

    Angles increase counterclockwise (CCW). If the angles of ``test`` run in the other direction,
    their order is reversed. A full circle then starts at the same point as before.
    """
    arc_deg = test.planned_arc_deg
    if direction is None or (arc_deg > 0.0) == (direction == "CCW"):
        return replace(test, direction=direction)
    start_deg = float(test.angle_deg[-1])
    if abs(arc_deg) == 360.0:
        start_deg = float(test.angle_deg[0]) % 360.0
    angle_deg = planned_angles(len(test.angle_deg), start_deg, -arc_deg)
    return replace(test, direction=direction, angle_deg=angle_deg).planned()


def _median_test(tests: Sequence[CircularTest]) -> CircularTest:
    """Return the test with the median number of readings."""
    by_readings = sorted(tests, key=_number_of_angles)
    return by_readings[len(tests) // 2]


def _number_of_angles(test: CircularTest) -> int:
    """Return the number of angles at which the test has a reading."""
    return len(test.angle_deg)


class _TestKind(NamedTuple):
    """Kind of a test: its plane, set-up, centre, radius and direction of travel.

    The parameters and effects that a model has depend on the kinds of the tests.
    """

    plane: str | None
    setup: int | None
    centre_mm: tuple[float, ...]
    radius_mm: float | None
    direction: Direction | None


def add_foreseen_tests(
    pilot: Campaign,
    candidates: Sequence[CircularTest],
    compared_tests: Sequence[CircularTest] = (),
) -> Campaign:
    """Return the pilot, extended so that its model has all parameters that a design may need.

    A campaign may list foreseen tests, which may be run later. The model of the campaign has every
    parameter that changes the readings of at least one test, whether run or foreseen. A design may
    contain kinds of tests that the pilot does not have. The function therefore adds a foreseen test
    of each of these kinds, so that the same model applies to every design. The kind of a test is
    its plane, set-up, centre, radius and direction.

    Parameters
    ----------
    pilot
        The campaign or plan that the design starts from.
    candidates
        Tests to choose from. If the candidates in a plane run in both directions, foreseen tests in
        both directions are added, so that the model includes hysteresis.
    compared_tests
        Tests of designs that are only compared with this design. The direction of travel of these
        tests is ignored.

    Returns
    -------
    Campaign
        The pilot with the foreseen tests added; the pilot itself if it already has tests of all
        kinds.
    """
    uses_radius = _model_depends_on_radius(pilot, (*candidates, *compared_tests))
    # Kinds of tests that need not be added. The pilot's tests are entered here without their
    # directions of travel, because a design may be analysed without these tests. If the kind of a
    # candidate includes a direction, the candidate therefore counts as new, even if the pilot has a
    # test in this direction.
    known_kinds = {_kind_of(test, None, uses_radius) for test in pilot.scope}
    known_kinds |= {_kind_of(test, test.direction, uses_radius) for test in pilot.foreseen}
    new_tests = []
    for kind, test in _tests_by_kind(candidates, compared_tests, uses_radius).items():
        if kind not in known_kinds:
            new_tests.append(replace(test, direction=kind.direction))
    if not new_tests:
        return pilot
    return replace(pilot, foreseen=(*pilot.foreseen, *new_tests))


def _model_depends_on_radius(pilot: Campaign, tests: Sequence[CircularTest]) -> bool:
    """Return whether the parameters of the model depend on the radii of the circles.

    The parameters depend on the radii only if the centre of a circle, or the coordinate frame of a
    joint, does not lie at the machine's origin. The circles considered are those of the pilot and
    of ``tests``, which may be run.
    """
    if any(any(frame) for frame in pilot.frames_mm.values()):
        return True
    return any(any(test.circle.centre_mm) for test in (*pilot.scope, *tests))


def _kind_of(test: CircularTest, direction: Direction | None, uses_radius: bool) -> _TestKind:
    """Return the kind of a test: its plane, set-up, centre, radius and direction of travel.

    ``direction`` takes the place of the test's own direction; None means that the kind does not
    include the direction. The radius is left out if ``uses_radius`` is false.
    """
    radius_mm = test.radius_mm if uses_radius else None
    return _TestKind(test.plane, test.setup, tuple(test.circle.centre_mm), radius_mm, direction)


def _tests_by_kind(
    candidates: Sequence[CircularTest], compared_tests: Sequence[CircularTest], uses_radius: bool
) -> dict[_TestKind, CircularTest]:
    """Return a dict with one test of every kind; its keys are the kinds.

    ``candidates`` are the tests to choose from; ``compared_tests`` are tests of other designs. If
    several tests have the same kind, the result holds the first of them; candidates come before
    tests of other designs.

    The kind of a test consists of its plane, set-up, centre, radius and direction of travel. The
    radius is left out if ``uses_radius`` is false. The direction is left out for all tests of other
    designs. For the candidates in a plane, it is left out unless some of them run clockwise and
    others counterclockwise.
    """
    both_ways = _planes_run_both_ways(candidates)
    possible = []
    for test in candidates:
        direction = test.direction if str(test.plane) in both_ways else None
        possible.append((_kind_of(test, direction, uses_radius), test))
    possible += [(_kind_of(test, None, uses_radius), test) for test in compared_tests]
    # The list ``possible`` holds pairs of a kind and a test of this kind. If a kind occurs several
    # times, the dictionary keeps the last test. The list is therefore reversed, so that the first
    # test of each kind is kept.
    return dict(reversed(possible))


def _planes_run_both_ways(tests: Sequence[CircularTest]) -> set[str]:
    """Return the planes in which some tests run clockwise and others counterclockwise."""
    planes = set()
    for plane in PLANES:
        directions = {test.direction for test in tests if test.plane == plane}
        if {"CW", "CCW"} <= directions:
            planes.add(plane)
    return planes


def grid_of_tests(
    templates: Sequence[CircularTest],
    forces_N: Sequence[float],
    clockings_deg: Sequence[Clocking],
    radii_mm: Sequence[float],
) -> tuple[CircularTest, ...]:
    """Return every combination of template, radius, clocking and force as a planned test.

    A template is a test without readings. In the result, the force changes fastest, then the
    clocking, then the radius. The template changes most slowly.
    """
    tests = []
    for template, radius_mm, clocking, force_N in product(
        templates, radii_mm, clockings_deg, forces_N
    ):
        work_ball_deg, tool_ball_deg = clocking
        test = replace(
            template,
            force_N=float(force_N),
            work_ball_deg=float(work_ball_deg),
            tool_ball_deg=float(tool_ball_deg),
            radius_mm=float(radius_mm),
        )
        tests.append(test)
    return tuple(tests)


def bind_tests(
    model: HybridModel, pilot: Campaign, tests: Sequence[CircularTest], *, keep_pilot_tests: bool
) -> BoundModel:
    """Return the model applied to planned tests, alone or together with the pilot's tests.

    The model takes its reference force, its range of force and the estimate Ĉ of the compliances
    from the pilot. Even if the pilot's tests are left out, the model keeps the parameters that only
    these tests can determine. The coefficients of hysteresis are an exception: which of them the
    model has depends on the directions of travel, and the directions of tests that are left out do
    not count.

    Parameters
    ----------
    model
        Model that is applied to the tests.
    pilot
        The campaign or plan that the design starts from.
    tests
        Planned tests, without those of the pilot.
    keep_pilot_tests
        Whether the model is applied to the tests of the pilot and the planned tests together. If
        so, the tests of the pilot come first. If not, it is applied to the planned tests alone.

    Returns
    -------
    BoundModel
        The model applied to the tests.
    """
    plan = replace(pilot, tests=tuple(tests), foreseen=(), pilot=None, adds_to_pilot=False)
    if not keep_pilot_tests:
        # The order in which the planned tests will be run is not known yet: a random order is
        # assumed.
        plan = replace(plan, order="random")
    return _bind_to_pilot(model, plan, pilot, keep_pilot_tests=keep_pilot_tests)


def bind_plan(model: HybridModel, plan: Campaign) -> BoundModel:
    """Return the model applied to a plan.

    The pilot is the campaign that the plan starts from. If the plan has a pilot, the model takes
    its reference force, its range of force and the estimate Ĉ of the compliances from the pilot.
    The instrument and the order of the tests are always taken from the plan. If the plan is to be
    analysed together with its pilot, the model is applied to the pilot's tests, followed by the
    tests of the plan.
    """
    pilot = plan.pilot
    if pilot is None:
        return model.bind(plan)
    alone = replace(_with_times(plan, pilot), pilot=None, adds_to_pilot=False)
    return _bind_to_pilot(model, alone, pilot, keep_pilot_tests=plan.adds_to_pilot)


def _with_times(plan: Campaign, pilot: Campaign) -> Campaign:
    """Return a plan whose tests have times, which determine how a drift affects them.

    The pilot is the campaign that the plan starts from. If the plan is to be analysed together with
    its pilot, its tests are run after those of the pilot, one every six minutes. A time that a test
    of the plan states is kept, but only if all tests of the pilot state times: a fit of both, too,
    uses times only if all tests state them. Otherwise, the mean time of the plan's tests is that of
    the pilot's tests. A plan is returned unchanged if its tests are not run in the order in which
    they are listed.
    """
    if plan.order is not None:
        return plan
    if plan.adds_to_pilot:
        planned = plan.tests
        if time_source(pilot) == TimeSource.LISTED:
            planned = tuple(replace(test, time_s=None) for test in planned)
        return replace(plan, tests=after_the_others(with_listed_times(pilot), planned))
    planned_s = np.array([test.time_s for test in plan.tests], dtype=float)
    if not np.isfinite(planned_s).all():
        planned_s = SECONDS_PER_TEST * np.arange(len(plan.tests))
    pilot_s = np.array([test.time_s for test in pilot.tests], dtype=float)
    centred_s = planned_s - planned_s.mean()
    if np.isfinite(pilot_s).all():
        centred_s = centred_s + pilot_s.mean()
    tests = []
    for test, time_s in zip(plan.tests, centred_s.tolist(), strict=True):
        tests.append(replace(test, time_s=time_s))
    return replace(plan, tests=tuple(tests))


def _bind_to_pilot(
    model: HybridModel, plan: Campaign, pilot: Campaign, *, keep_pilot_tests: bool
) -> BoundModel:
    """Return the model applied to the tests of a plan, with settings of the pilot.

    ``pilot`` is the campaign that the plan starts from; the model takes its reference force and
    force range from this campaign. If ``keep_pilot_tests`` is true, the model is applied to the
    tests of the pilot and of the plan together; the tests of the pilot come first. If it is false,
    the model is applied to the tests of the plan alone. It then still has all parameters that the
    pilot's tests could determine, except those of effects that depend on the directions of travel.
    """
    tests = plan.tests
    pilot_tests = pilot.plan().tests
    # Remove the names of the tests. The plan then gives every test a different name, even if the
    # same test is planned several times.
    planned = tuple(replace(test, name="") if test.name else test for test in tests)
    if keep_pilot_tests:
        planned = (*with_listed_times(pilot).plan().tests, *planned)
    pilot_kinds = [replace(test, direction=None) for test in pilot_tests]
    foreseen = (*plan.foreseen, *pilot.foreseen, *pilot_kinds)
    joined = replace(plan, tests=planned, foreseen=foreseen)
    return BoundModel(model, joined, pilot=pilot)


def running_order(
    tests: Sequence[CircularTest], rng: np.random.Generator
) -> tuple[CircularTest, ...]:
    """Return ``tests`` in a random order, so that a drift is not mistaken for an effect of force.

    Random orders are drawn until the correlation between force and position is between −0.5 and
    0.5, but at most 24. If none of them is suitable, the one with the smallest correlation is
    returned; `_random_order` describes how an order is drawn.
    """
    best = _random_order(tests, rng)
    for _ in range(_MOST_ORDERS - 1):
        if _correlation_with_order(best) <= _MOST_SORTED:
            break
        other = _random_order(tests, rng)
        if _correlation_with_order(other) < _correlation_with_order(best):
            best = other
    return best


def _correlation_with_order(tests: Sequence[CircularTest]) -> float:
    """Return the absolute correlation between the forces of tests and their positions, 0 to 1.

    It is 0 if all forces are equal, or if there is only one test.
    """
    forces_N = np.array([float(test.force_N or 0.0) for test in tests])
    from_mean_N = forces_N - forces_N.mean()
    positions = np.arange(len(tests)) - 0.5 * (len(tests) - 1)
    size = float(np.linalg.norm(from_mean_N) * np.linalg.norm(positions))
    if size == 0.0:
        return 0.0
    return abs(float(from_mean_N @ positions)) / size


def _random_order(
    tests: Sequence[CircularTest], rng: np.random.Generator
) -> tuple[CircularTest, ...]:
    """Return ``tests`` in a random order in which balls and radius are changed rarely.

    Tests are grouped by set-up, within a set-up by plane and radius, and within these groups by the
    angle of the work ball. At each of these three levels, the groups are in random order. Within a
    group with the same angle of the work ball, the tests are sorted by the angle of the tool ball:
    in ascending order in the first group, in descending order in the second, and so on alternately.
    Tests with the same angles of both balls are in random order.
    """
    ordered: list[CircularTest] = []
    for setup_block in _random_blocks(tests, _setup, rng):
        for circle_block in _random_blocks(setup_block, _plane_and_radius, rng):
            for k, work_ball_block in enumerate(_random_blocks(circle_block, _work_ball_deg, rng)):
                angles = sorted({test.tool_ball_deg for test in work_ball_block})
                if k % 2:
                    angles.reverse()
                for tool_ball_deg in angles:
                    block = [t for t in work_ball_block if t.tool_ball_deg == tool_ball_deg]
                    ordered += [block[i] for i in rng.permutation(len(block))]
    return tuple(replace(test, name="") for test in ordered)


def _random_blocks(
    tests: Sequence[CircularTest], key: Callable[[CircularTest], Any], rng: np.random.Generator
) -> list[list[CircularTest]]:
    """Return the tests in groups with a common property; the order of the groups is random.

    ``key`` is a function that returns the property of a test, for example its set-up.
    """
    blocks: dict[Any, list[CircularTest]] = {}
    for test in tests:
        blocks.setdefault(key(test), []).append(test)
    keys = sorted(blocks)
    return [blocks[keys[i]] for i in rng.permutation(len(keys))]


def _setup(test: CircularTest) -> int:
    """Return the number of the test's set-up; 1 if the test does not state it."""
    return test.setup or 1


def _plane_and_radius(test: CircularTest) -> tuple[str, float]:
    """Return the plane of the test's circle, and its radius [mm]."""
    return str(test.plane), float(test.radius_mm or 0.0)


def _work_ball_deg(test: CircularTest) -> float:
    """Return the angle by which the work ball is turned in its socket [°]."""
    return test.work_ball_deg
