"""Candidate tests of a design, and foreseen tests that give its model all parameters.

The pilot is the campaign or plan that a design starts from. A clocking is the pair of angles by
which the two balls are turned.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import product
from typing import NamedTuple

from ldbb_bayes.campaign.campaign import Campaign, CircularTest, Direction
from ldbb_bayes.campaign.circular_test import planned_angles
from ldbb_bayes.machine.chain import PLANES

__all__ = [
    "VERY_MANY_REPETITIONS",
    "Clocking",
    "add_foreseen_tests",
    "grid_of_tests",
    "templates",
    "with_angles_as_run",
]

# The uncertainty that would remain after very many circles is computed as if each candidate circle
# were run this number of times.
VERY_MANY_REPETITIONS = 1e6

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


def with_angles_as_run(plan: Campaign) -> Campaign:
    """Return a campaign whose planned tests have their angles in the order in which they are run.

    A test that is run clockwise has decreasing angles. Tests that have readings, and those that
    state no direction or whose angles are not evenly spaced, stay as they are.
    """
    tests = []
    for test in plan.tests:
        if test.reading_um is None and test.direction is not None and test.step_deg:
            tests.append(_in_direction(test, test.direction))
        else:
            tests.append(test)
    return replace(plan, tests=tuple(tests))


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
