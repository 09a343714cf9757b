"""Next circular tests that the sliders of the page describe, or the best in the same range."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import ldbb_bayes as lb
from ldbb_bayes.analysis.design.candidates import grid_of_tests
from ldbb_bayes.analysis.design.design_result import read_design
from ldbb_bayes.analysis.design.search import efficient_rounding, exchange
from ldbb_bayes.analysis.design.space import Space
from ldbb_bayes.app.fields import RESULT, linear_model
from ldbb_bayes.app.goal_fields import GOAL_PREFIX
from ldbb_bayes.app.sliders import COST_SLIDERS, Slider, slider_values
from ldbb_bayes.campaign.campaign import Direction
from ldbb_bayes.errors import require
from ldbb_bayes.results import Array

__all__ = [
    "PlannedTests",
    "Report",
    "pilot_of",
    "planned_tests",
    "report_of",
    "settings_of_tests",
]

# name of the file with the tests that the report recommends
_DESIGN_NAME = "design.json"
_DIRECTIONS: Mapping[str, tuple[Direction, ...]] = {
    "both": ("CW", "CCW"),
    "CW": ("CW",),
    "CCW": ("CCW",),
}
_MOST_CIRCLES = 60  # largest number of tests in a plan
# Limit on the number of candidate tests from which the best tests are chosen. If there are more
# candidates, fewer forces are used, but the limit does not make the number of forces smaller than
# ``_FEWEST_LEVELS``. With very many combinations of ball angles, radii and directions, the number
# of candidates therefore exceeds the limit.
_MOST_CANDIDATES = 180
# Largest number of circles for which the search for the best tests is started several times, each
# time from another design.
_MOST_SEARCHED_CIRCLES = 12
# Number of forces that the limit ``_MOST_CANDIDATES`` always permits: the lowest, the middle and
# the highest force.
_FEWEST_LEVELS = 3


def _sliders_of_tests(settings: Mapping[str, Any], pilot: lb.Campaign) -> dict[str, float]:
    """Return the values of the sliders that describe the next tests.

    The sliders are named ``circles``, ``levels`` (number of forces), ``low`` and ``high`` (lowest
    and highest force [N]), ``work`` and ``tool`` (number of angles of each ball), ``turn`` (step
    between these angles [°]) and ``radius`` [mm]. The defaults depend on the campaign ``pilot``, on
    which the plan is based. Raise an `InputError` if a value is outside its limits, or if the
    lowest force exceeds the highest.
    """
    lowest_force = float(pilot.forces_N.min())
    highest_force = float(pilot.forces_N.max())
    from_force = min(1.0, lowest_force)
    to_force = 5 * highest_force
    circles = min(len(pilot.tests), _MOST_CIRCLES)
    values = slider_values(
        settings,
        {
            "circles": Slider(circles, 1, _MOST_CIRCLES),
            "levels": Slider(min(circles, 6), 1, _MOST_CIRCLES),
            "low": Slider(lowest_force, from_force, to_force),
            "high": Slider(highest_force, from_force, to_force),
            "work": Slider(1, 1, 6),
            "tool": Slider(1, 1, 6),
            "turn": Slider(45, 1, 180),
            "radius": Slider(0, 0, 2000),
        },
    )
    require(
        values["low"] <= values["high"],
        f"the lowest force must not exceed the highest, got {values['low']:g} N. Lower it.",
    )
    return values


class Report(NamedTuple):
    """Folder and time that together identify one report of a session (one browser tab).

    Results computed from the report are cached, and this tuple is a part of their key. They are
    therefore computed again after a new report has been written.
    """

    folder: Path  #: Folder of the files of the session. A session belongs to one browser tab.
    #: Time at which the report was written [ns].
    time_ns: int


class _Pilot(NamedTuple):
    """Campaign on which a plan of the next tests is based, with the results of its fit."""

    #: Campaign whose report the session (one browser tab) shows.
    campaign: lb.Campaign
    #: Standard uncertainty of every parameter from the fit with compliance linear in force.
    sd: Mapping[str, float]
    #: Estimate of every parameter from the fit with compliance linear in force.
    mean: Mapping[str, float]


@lru_cache(maxsize=12)
def pilot_of(report: Report) -> _Pilot:
    """Return the campaign of a report, with the estimates and standard uncertainties of its fit."""
    result = report.folder / RESULT
    summary = json.loads((result / "summary.json").read_text(encoding="utf-8"))
    sd = {name: entry["sd"] for name, entry in summary["parameters"].items()}
    mean = {name: entry["mean"] for name, entry in summary["parameters"].items()}
    return _Pilot(lb.read_campaign(result / "campaign"), sd, mean)


def report_of(folder: Path) -> Report:
    """Return the folder of a session and the time of its report, which identify the report.

    Raise an `InputError` if the session has no report yet.
    """
    path = folder / RESULT / "summary.json"
    require(path.is_file(), "a plan must follow a fit, got none yet. Fit first.")
    return Report(folder, path.stat().st_mtime_ns)


def settings_of_tests(settings: Mapping[str, Any]) -> str:
    """Return the values of the page's sliders that describe the tests, as JSON text.

    Results of computations are cached under this text. The sliders for time and cost, and the
    fields for goals, are left out.
    """
    not_of_tests = ("fine", *COST_SLIDERS)
    stated = {}
    for name, value in sorted(settings.items()):
        if name not in not_of_tests and not name.startswith(GOAL_PREFIX):
            stated[name] = value
    return json.dumps(stated)


@lru_cache(maxsize=6)
def _space_of(
    report: Report,
    clockings_deg: tuple[tuple[float, float], ...],
    radii_mm: tuple[float, ...],
    directions: tuple[Direction, ...],
    augment: bool,
) -> Space:
    """Return the space of possible tests at given angles of the balls, radii and directions.

    Parameters
    ----------
    report
        Report of the fit on which the plan is based.
    clockings_deg
        Pairs of angles by which the work ball and the tool ball are turned in their sockets [deg].
    radii_mm
        Radii of the circles [mm].
    directions
        Directions of travel, CW and CCW. If empty, the directions of the earlier tests are used.
    augment
        Whether the new tests are evaluated together with the readings of the earlier tests.
    """
    pilot = pilot_of(report).campaign
    forces_N = sorted({float(force) for force in pilot.forces_N})
    return Space(
        linear_model(), pilot, forces_N, clockings_deg, radii_mm, directions, augment=augment
    )


class PlannedTests(NamedTuple):
    """Tests that the sliders of the browser page describe."""

    #: All tests that could be run. The tests of ``plan`` were chosen from them.
    space: Space
    #: Plan of the tests, in the order in which to run them.
    plan: lb.Campaign
    #: Values of the sliders of the browser page; the keys are the names of the sliders.
    sliders: Mapping[str, float]


@lru_cache(maxsize=32)
def planned_tests(report: Report, settings_json: str) -> PlannedTests:
    """Return the tests that the sliders of the page describe, in the order in which to run them.

    If the user asks for the best tests, the tests with the most expected information are returned.
    They are the tests that the report recommends, if the report chose them with these settings. If
    the user does not ask for the best tests, the tests have equally spaced forces, and the ball
    angles, radii and directions change from test to test. Ball angles are the angles by which the
    two balls are turned in their sockets.

    Parameters
    ----------
    report
        Report of the fit on which the plan is based.
    settings_json
        Values of the sliders as JSON text; the keys are the names of the sliders. As text, the
        values can be the key of a cache.

    Raises
    ------
    InputError
        If the value of a slider is out of range.
    """
    settings = json.loads(settings_json)
    sliders = _sliders_of_tests(settings, pilot_of(report).campaign)
    space = _space_of_sliders(report, settings, sliders)
    if settings.get("best"):
        tests = _tests_of_report(report, space, sliders) or _best_tests(space, sliders)
    else:
        tests = _equally_spaced_tests(space, sliders)
    return PlannedTests(space, space.plan_of(tests), sliders)


def _equally_spaced_tests(
    space: Space, sliders: Mapping[str, float]
) -> tuple[lb.CircularTest, ...]:
    """Return tests at equally spaced forces, which are rounded to whole newtons or to tenths.

    ``sliders`` holds the values of the page's sliders, which state the number of circles, the
    number of different forces, and the lowest and the highest force. There are not more forces than
    circles; rounding may make forces equal, so that there are fewer (`_force_levels`). A single
    force is the highest force. The tests use the settings of ``space`` in turn: the angles by which
    the two balls are turned in their sockets, the radii, the directions of travel and the planes.
    """
    number = int(sliders["circles"])
    tests_at_lowest_force = _tests_of_all_settings(space, sliders["low"])
    forces_N = _force_levels(sliders["low"], sliders["high"], int(min(sliders["levels"], number)))
    tests = []
    for force_N, test in _pairs_in_turn(forces_N, tests_at_lowest_force, number):
        tests.append(replace(test, force_N=force_N))
    return tuple(tests)


def _space_of_sliders(
    report: Report, settings: Mapping[str, Any], sliders: Mapping[str, float]
) -> Space:
    """Return the space of possible tests that the page's sliders and settings describe.

    ``report`` identifies the fit on which the plan is based. The space has all combinations of the
    angles by which the work ball and the tool ball are turned in their sockets. The radii are the
    radii of the tests already run, and the value of the slider for the radius if this value is
    above zero. The entries ``directions`` and ``augment`` of ``settings`` state the directions of
    travel, and whether the tests are evaluated together with the readings of the earlier tests.
    Without an entry ``directions``, the directions of the earlier tests are used.
    """
    work_deg = [sliders["turn"] * k for k in range(int(sliders["work"]))]
    tool_deg = [sliders["turn"] * k for k in range(int(sliders["tool"]))]
    clockings_deg = _pairs_in_turn(work_deg, tool_deg, len(work_deg) * len(tool_deg))
    pilot = pilot_of(report).campaign
    radii_mm = {test.circle.radius_mm for test in pilot.tests}
    if sliders["radius"] > 0.0:
        radii_mm.add(sliders["radius"])
    return _space_of(
        report,
        tuple(clockings_deg),
        tuple(sorted(radii_mm)),
        _DIRECTIONS.get(str(settings.get("directions")), ()),
        bool(settings.get("augment")),
    )


def _tests_of_all_settings(space: Space, force_N: float) -> list[lb.CircularTest]:
    """Return one test for every combination of ball angles, radius, direction of travel and plane.

    Ball angles are the angles by which the two balls are turned in their sockets. All these tests
    have the force ``force_N``. In their order, ball angles usually change from one test to the next
    (`_pairs_in_turn`).
    """
    unturned_tests = grid_of_tests(space.templates, [force_N], [(0.0, 0.0)], space.radii_mm)
    number = len(unturned_tests) * len(space.clockings_deg)
    tests = []
    for test, (work_deg, tool_deg) in _pairs_in_turn(unturned_tests, space.clockings_deg, number):
        tests.append(replace(test, work_ball_deg=work_deg, tool_ball_deg=tool_deg))
    return tests


def _tests_of_report(
    report: Report, space: Space, sliders: Mapping[str, float]
) -> tuple[lb.CircularTest, ...]:
    """Return the next tests that the annex of a report recommends.

    The result is empty if the report recommends no tests, or if it chose them from other tests than
    those that ``space`` and the page's ``sliders`` describe.
    """
    path = report.folder / RESULT / _DESIGN_NAME
    if not (path.is_file() and _is_space_of_report(space, sliders)):
        return ()
    table = read_design(path).table
    if table["count"].sum() != sliders["circles"]:
        return ()
    counts = table.set_index(list(table.columns.drop("count")))["count"]
    candidates = replace(space, forces_N=sorted(set(table["force_N"])))
    rows = candidates.frame(candidates.tests).itertuples(index=False, name=None)
    tests = []
    for test, row in zip(candidates.tests, rows, strict=True):
        tests += [test] * int(counts.get(row, 0))
    return tuple(tests)


def _is_space_of_report(space: Space, sliders: Mapping[str, float]) -> bool:
    """Return whether a report chooses the next tests from those of ``space`` and the ``sliders``.

    A report chooses from all forces in the range of the tests already run, at their radii and in
    their directions of travel. The balls are not turned, and the tests already run do not count.
    """
    space_of_report = Space(space.model, space.pilot, space.forces_N)
    return (
        sliders["low"] == min(space.forces_N)
        and sliders["high"] == max(space.forces_N)
        and space.clockings_deg == space_of_report.clockings_deg
        and set(space.radii_mm) == set(space_of_report.radii_mm)
        and space.directions == space_of_report.directions
        and space.augment == space_of_report.augment
    )


def _best_tests(space: Space, sliders: Mapping[str, float]) -> tuple[lb.CircularTest, ...]:
    """Return the tests with the most expected information, as the command ``design`` finds them.

    The tests are chosen from all combinations of ball angles, radii and directions of ``space``, at
    forces in equal steps from the lowest to the highest force of the page's ``sliders``. If the
    tests that `_equally_spaced_tests` returns give more expected information than the tests found,
    the equally spaced tests are returned. They are also returned if the model needs more different
    forces than there are circles or possible forces.

    The two sets of tests are compared as in the forecast of the page: the information of each set
    is computed with a model made for this set alone. The search, in contrast, uses a model made for
    all candidate tests. This model may have more effects, because some effects are modelled only if
    balls are turned.
    """
    low = sliders["low"]
    high = sliders["high"]
    tests_per_force = len(_tests_of_all_settings(space, low))
    most_levels = max(_FEWEST_LEVELS, _MOST_CANDIDATES // tests_per_force)
    levels = _force_levels(low, high, max(2, min(round(high - low) + 1, most_levels)))
    # Sort the ball angles as the command ``design`` does, so that its search and this search start
    # from the same tests.
    clockings_deg = tuple(sorted(space.clockings_deg))
    candidates = replace(space, forces_N=levels, clockings_deg=clockings_deg)
    number = int(sliders["circles"])
    equally_spaced = _equally_spaced_tests(space, sliders)
    if min(number, len(levels)) < candidates.search.levels:
        # A model with linear compliance needs tests at two different forces. The search cannot meet
        # this condition if there is only one circle, or only one possible force.
        return equally_spaced
    counts = _best_counts(candidates, number)
    indices_of_best = np.repeat(np.arange(len(counts)), counts)
    best = tuple(candidates.tests[k] for k in indices_of_best)
    if _information(space, equally_spaced) > _information(space, best):
        return equally_spaced
    return best


def _information(space: Space, tests: Sequence[lb.CircularTest]) -> float:
    """Return the value of the design criterion for a campaign in which each test is run once.

    ``space`` gives the model and the criterion. A larger value means more expected information.
    """
    return space.objective(tests).value(np.ones(len(tests)))


def _best_counts(candidates: Space, number: int) -> Array:
    """Return how often to run each candidate test.

    ``number`` is the number of all runs (circles), and ``candidates`` the space of the tests that
    may be chosen. If there are at most 12 runs and at most 180 candidate tests, the search is the
    same as in the command ``design``. It is started several times, each time from another design.
    If there are more runs or candidate tests, the search is started only once, from a design that
    is probably good: the best share of all runs is computed for each test, and the shares are
    converted to whole numbers of runs.
    """
    search = candidates.search
    if number <= _MOST_SEARCHED_CIRCLES and len(candidates.tests) <= _MOST_CANDIDATES:
        return search.find_design(number).counts
    start = efficient_rounding(search.shares(float(number)).share, number)
    rng = np.random.default_rng(candidates.seed)
    counts, _ = exchange(search.objective, start, rng, thorough=False)
    return counts


def _pairs_in_turn(first: Sequence[Any], second: Sequence[Any], number: int) -> list[Any]:
    """Return ``number`` pairs of elements of two sequences, balanced as in a Latin square.

    Each round takes all elements of the first sequence in turn. In each round, every element of the
    first sequence is paired with the element of the second sequence that follows its partner of the
    round before.
    """
    pairs = []
    for k in range(number):
        turn, position = divmod(k, len(first))
        pairs.append((first[position], second[(turn + position) % len(second)]))
    return pairs


def _force_levels(low: float, high: float, number: int) -> list[float]:
    """Return ``number`` equally spaced forces from ``low`` to ``high`` [N].

    The forces are rounded to whole newtons if the rounded forces differ and are above zero. If not,
    they are rounded to tenths of a newton, and equal rounded forces are returned only once. If
    ``number`` is one, the force is ``high``, because the highest force gives the most information.
    """
    if number == 1:
        levels = [high]
    else:
        levels = [low + (high - low) * k / (number - 1) for k in range(number)]
    rounded = sorted({float(round(level)) for level in levels})
    if len(rounded) == number and rounded[0] > 0.0:
        return rounded
    return sorted({round(level, 1) for level in levels})
