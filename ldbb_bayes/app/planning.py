"""Plan of the next circular tests, and the expected results of these tests."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import ldbb_bayes as lb
from ldbb_bayes.analysis.design.analysis_model import analysis_model
from ldbb_bayes.analysis.design.averaged_forecast import averaged_uncertainties
from ldbb_bayes.analysis.design.candidates import grid_of_tests
from ldbb_bayes.analysis.design.costs import Costs, effort_of, minutes_of
from ldbb_bayes.analysis.design.search import efficient_rounding, exchange
from ldbb_bayes.analysis.design.simulated_analyses import simulate_analyses
from ldbb_bayes.analysis.design.space import Space
from ldbb_bayes.app.fields import RESULT, linear_model
from ldbb_bayes.app.goal_fields import GOAL_PREFIX, goal_texts, with_goals
from ldbb_bayes.app.worth import uncertainty_change
from ldbb_bayes.campaign.campaign import Direction
from ldbb_bayes.campaign.folder import MODEL_NAME, files_of, write_campaign_into
from ldbb_bayes.campaign.mountings import mounted_anew, setups_as_run
from ldbb_bayes.errors import require
from ldbb_bayes.files import staged_folder
from ldbb_bayes.model.specification import model_to_toml
from ldbb_bayes.report.operator_sheet import mounting_sentences
from ldbb_bayes.report.wording import is_noticeable
from ldbb_bayes.results import Array
from ldbb_bayes.units import display_unit, two_digits

__all__ = ["COST_SLIDERS", "PLAN", "circle_rows", "effort_row", "forecast", "pilot_row", "plan"]

PLAN = "plan"  # subfolder of a session (one browser tab) for the plan of the next tests
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
# Number of possible machines over which a forecast is averaged while the user moves a slider.
# Possible machines are machines that are likely given the readings so far. The number is smaller
# than for the final forecast, to make the forecast fast.
_QUICK_STATES = 16


class _Slider(NamedTuple):
    """A slider of the browser page: its default, lowest and highest value."""

    default: float
    lowest: float
    highest: float


_USUAL_COSTS = Costs()
# Sliders for what circles cost, with the names that the command ``design`` gives these options. The
# search for the cheapest campaign takes its costs from them, too.
COST_SLIDERS = {
    "minutes_per_circle": _Slider(_USUAL_COSTS.minutes_per_circle, 0.5, 600),
    "minutes_per_setup": _Slider(_USUAL_COSTS.minutes_per_setup, 0, 600),
    "minutes_per_clocking": _Slider(_USUAL_COSTS.minutes_per_clocking, 0, 600),
    "price_per_hour": _Slider(_USUAL_COSTS.price_per_hour, 1, 1e5),
}


def _slider_values(settings: Mapping[str, Any], sliders: Mapping[str, _Slider]) -> dict[str, float]:
    """Return the values of sliders as numbers; a slider without a value has its default.

    ``settings`` are the values that the page sent, and ``sliders`` the defaults and limits. The
    keys are the names of the sliders. Raise an `InputError` if a value is outside its limits.
    """
    values = {}
    for name, slider in sliders.items():
        value = settings.get(name, slider.default)
        is_number = isinstance(value, int | float) and math.isfinite(value)
        require(
            is_number and slider.lowest <= value <= slider.highest,
            f"{name} must be between {slider.lowest:g} and {slider.highest:g}, got {value!r}. Move"
            " its slider.",
        )
        values[name] = float(value)
    return values


def _test_sliders(settings: Mapping[str, Any], pilot: lb.Campaign) -> dict[str, float]:
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
    values = _slider_values(
        settings,
        {
            "circles": _Slider(circles, 1, _MOST_CIRCLES),
            "levels": _Slider(min(circles, 6), 1, _MOST_CIRCLES),
            "low": _Slider(lowest_force, from_force, to_force),
            "high": _Slider(highest_force, from_force, to_force),
            "work": _Slider(1, 1, 6),
            "tool": _Slider(1, 1, 6),
            "turn": _Slider(45, 1, 180),
            "radius": _Slider(0, 0, 2000),
        },
    )
    require(
        values["low"] <= values["high"],
        f"the lowest force must not exceed the highest, got {values['low']:g} N. Lower it.",
    )
    return values


# ---- the fit on which the plan is based


class _Report(NamedTuple):
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
def _pilot_of(report: _Report) -> _Pilot:
    """Return the campaign of a report, with the estimates and standard uncertainties of its fit."""
    result = report.folder / RESULT
    summary = json.loads((result / "summary.json").read_text(encoding="utf-8"))
    sd = {name: entry["sd"] for name, entry in summary["parameters"].items()}
    mean = {name: entry["mean"] for name, entry in summary["parameters"].items()}
    return _Pilot(lb.read_campaign(result / "campaign"), sd, mean)


def _report_of(folder: Path) -> _Report:
    """Return the folder of a session and the time of its report, which identify the report.

    Raise an `InputError` if the session has no report yet.
    """
    path = folder / RESULT / "summary.json"
    require(path.is_file(), "a plan must follow a fit, got none yet. Fit first.")
    return _Report(folder, path.stat().st_mtime_ns)


def _test_settings(settings: Mapping[str, Any]) -> str:
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
    report: _Report,
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
    pilot = _pilot_of(report).campaign
    forces_N = sorted({float(force) for force in pilot.forces_N})
    return Space(
        linear_model(), pilot, forces_N, clockings_deg, radii_mm, directions, augment=augment
    )


# ---- the tests that the sliders of the page describe


class _PlannedTests(NamedTuple):
    """Tests that the sliders of the browser page describe."""

    #: All tests that could be run. The tests of ``plan`` were chosen from them.
    space: Space
    #: Plan of the tests, in the order in which to run them.
    plan: lb.Campaign
    #: Values of the sliders of the browser page; the keys are the names of the sliders.
    sliders: Mapping[str, float]


@lru_cache(maxsize=32)
def _planned_tests(report: _Report, settings_json: str) -> _PlannedTests:
    """Return the tests that the sliders of the page describe, in the order in which to run them.

    If the user asks for the best tests, the tests with the most expected information are returned.
    If not, the tests have equally spaced forces, and the ball angles, radii and directions change
    from test to test. Ball angles are the angles by which the two balls are turned in their
    sockets.

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
    sliders = _test_sliders(settings, _pilot_of(report).campaign)
    space = _space_of_sliders(report, settings, sliders)
    if settings.get("best"):
        tests = _best_tests(space, sliders)
    else:
        tests = _equally_spaced_tests(space, sliders)
    return _PlannedTests(space, space.plan_of(tests), sliders)


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
    report: _Report, settings: Mapping[str, Any], sliders: Mapping[str, float]
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
    pilot = _pilot_of(report).campaign
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


# ---- expected results of the planned tests


def forecast(folder: Path, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the expected results of the tests that the sliders of the page describe.

    Parameters
    ----------
    folder
        Folder of the session (one browser tab).
    settings
        Values of the page's sliders and entry fields; the keys are their names.

    Returns
    -------
    dict
        Expanded uncertainty U (k = 2) of every parameter before these tests (from the fit), the U
        expected after these tests, and its goal (``rows``). Slopes (changes of compliance with
        force) are left out. The dict also has two probabilities of decisive evidence (``settle``):
        for linear compliance if the compliance is linear, and for constant compliance if it is
        constant. Further entries are the time and cost, the numbers of set-ups and of turns of
        the balls, the values of the sliders (``asked``), the campaign on which the plan is based
        (``pilot``), and the tests in the order in which to run them.

    Raises
    ------
    InputError
        If there is no fit yet, or the value of a slider is out of range.
    """
    costs = _slider_values(settings, COST_SLIDERS)
    report = _report_of(folder)
    settings_json = _test_settings(settings)
    planned = _planned_tests(report, settings_json)
    expected = _expected_uncertainties(report, settings_json, fine=bool(settings.get("fine", True)))
    minutes = minutes_of(Costs(**costs), planned.plan.tests)
    stated: dict[str, Any] = {
        **planned.sliders,
        **costs,
        "directions": str(settings.get("directions") or ""),
        "augment": planned.space.augment,
    }
    pilot = planned.space.pilot
    texts = goal_texts(settings)
    stated["goals"] = texts
    rows = with_goals(expected["rows"], texts, planned.space.bound, _pilot_of(report).mean)
    return {
        "rows": rows,
        "settle": expected["settle"],
        "asked": stated,
        "best": bool(settings.get("best")),
        **effort_row(planned.plan),
        "minutes": round(minutes),
        "cost": round(minutes / 60.0 * costs["price_per_hour"]),
        "pilot": pilot_row(pilot),
        **circle_rows(planned.plan),
    }


@lru_cache(maxsize=128)
def _expected_uncertainties(report: _Report, settings_json: str, *, fine: bool) -> dict[str, Any]:
    """Return what to expect from planned tests: uncertainties, and the choice between two models.

    Entry ``rows`` of the result holds two expanded uncertainties U (k = 2) of every parameter: U
    from the fit, and U expected after the planned tests. Slopes (changes of compliance with force)
    are left out. Each row also holds the standard uncertainty to expect (``sd``) and the one that
    is not exceeded on 90 % of the possible machines (``likely_sd``). In a fine forecast, entry
    ``averaged`` of a row is U to expect, averaged over constant and linear compliance, with two
    digits. Entry ``settle`` holds two
    probabilities of decisive evidence: for compliance linear in force if the compliance is linear,
    and for constant compliance if it is constant. The entry is None if these probabilities cannot
    be forecast.

    Parameters
    ----------
    report
        Report of the fit on which the plan is based.
    settings_json
        Values of the page's sliders as JSON text; the keys are the names of the sliders.
    fine
        Whether to average over 64 possible machines, as the final forecast does. If False, the
        forecast averages over fewer machines and is faster.
    """
    space, plan_of_tests, _ = _planned_tests(report, settings_json)
    sd_today = _pilot_of(report).sd
    machines = None
    if not fine:
        machines = _QUICK_STATES
    analyses = simulate_analyses(space.model, plan_of_tests, machines=machines)
    expectation = space.forecast(plan_of_tests, analyses=analyses)
    averaged = averaged_uncertainties(analyses) if fine else {}
    rows = []
    for parameter in space.bound.parameters:
        if parameter.group != "slope":
            name = parameter.name
            expected = expectation.expected[name]
            sd_before = sd_today.get(name, math.inf)
            row = uncertainty_change(name, sd_before, expected.sd, expected.unit)
            row |= {"key": name, "sd": expected.sd, "likely_sd": expected.likely_sd}
            row["averaged"] = None
            if name in averaged and is_noticeable(averaged[name].sd, expected.sd):
                factor, _ = display_unit(expected.unit)
                row["averaged"] = two_digits(2.0 * averaged[name].sd, factor)
            rows.append(row)
    settle = None
    if expectation.discrimination is not None:
        settle = {
            "linear": expectation.discrimination.decisive_with,
            "constant": expectation.discrimination.decisive_without,
        }
    return {"rows": rows, "settle": settle}


def effort_row(plan: lb.Campaign) -> dict[str, int]:
    """Return the numbers of set-ups and of turns of the balls that a plan needs.

    Parameters
    ----------
    plan
        Plan of the tests.

    Returns
    -------
    dict
        The keys are ``setups`` and ``turns``.
    """
    effort = effort_of(plan.tests)
    return {"setups": effort.setups, "turns": effort.turns}


def circle_rows(plan: lb.Campaign) -> dict[str, Any]:
    """Return what the operator's sheet states of the circles of a plan.

    Parameters
    ----------
    plan
        Plan of the tests, in the order in which to run them.

    Returns
    -------
    dict
        ``tests`` holds the settings of each circle as texts, among them the number of the set-up
        in which it will be run. ``mountings`` holds sentences in English on when to mount the bar
        anew, and ``keeps_setup`` states whether it is never mounted anew.
    """
    tests = []
    for test, setup in zip(plan.tests, setups_as_run(plan), strict=True):
        tests.append({**_test_row(test, plan), "setup": f"{setup}"})
    return {
        "tests": tests,
        "mountings": list(mounting_sentences(plan)),
        "keeps_setup": not mounted_anew(plan),
    }


def _test_row(test: lb.CircularTest, plan: lb.Campaign) -> dict[str, Any]:
    """Return the settings of a test as texts; the pressure follows from the plan's force law."""
    force = float(test.force_N or 0.0)
    return {
        "force": f"{force:.4g}",
        "pressure": f"{plan.force_law.pressure_bar(force):.3g}",
        "plane": test.plane,
        "direction": test.direction or "",
        "radius": f"{test.radius_mm:g}",
        "work": f"{test.work_ball_deg or 0:g}",
        "tool": f"{test.tool_ball_deg or 0:g}",
    }


# Names of the attributes of a campaign that are texts on the operator's sheet.
_PILOT_TEXTS = (
    "name",
    "machine_type",
    "serial_number",
    "place",
    "ball_bar",
    "force_device",
    "topology",
)


def pilot_row(pilot: lb.Campaign) -> dict[str, Any]:
    """Return what the operator's sheet states about the campaign that a plan is based on.

    Parameters
    ----------
    pilot
        Campaign on which a plan is based.

    Returns
    -------
    dict
        Texts with the keys ``name``, ``machine_type``, ``serial_number``, ``place``, ``ball_bar``,
        ``force_device``, ``topology`` and ``feed`` [mm/min]; a text is empty if the campaign does
        not state it. Three numbers with the keys ``low`` and ``high``, the lowest and the highest
        force [N], and ``tests``, the number of tests.
    """
    row: dict[str, Any] = {name: getattr(pilot, name) or "" for name in _PILOT_TEXTS}
    row["feed"] = ""
    if pilot.feed_mm_per_min is not None:
        row["feed"] = f"{pilot.feed_mm_per_min:g}"
    row["low"] = float(pilot.forces_N.min())
    row["high"] = float(pilot.forces_N.max())
    row["tests"] = len(pilot.tests)
    return row


def plan(folder: Path, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Write a plan with the tests that the page's sliders describe, and return its forecast.

    A plan is a campaign without readings. The file ``model.toml`` beside it is the model for the
    analysis of its readings. An earlier plan in the same folder is replaced.

    Parameters
    ----------
    folder
        Folder of the session (one browser tab); the plan is written into its subfolder ``plan``.
    settings
        Values of the page's sliders; the keys are the names of the sliders.

    Returns
    -------
    dict
        Result of `forecast`.

    Raises
    ------
    InputError
        If there is no fit yet, or the value of a slider is out of range.
    """
    expected = forecast(folder, settings)
    planned = _planned_tests(_report_of(folder), _test_settings(settings))
    campaign = replace(planned.plan, tolerances={})
    model = analysis_model(planned.space, campaign.tests)
    target = folder / PLAN
    with staged_folder(target, force=True, ours={MODEL_NAME, *files_of(target)}) as staging:
        write_campaign_into(campaign, staging)
        (staging / MODEL_NAME).write_text(model_to_toml(model), encoding="utf-8")
    return expected
