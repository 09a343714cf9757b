"""Angles [deg] and readings [µm] of one test, computed from the columns of its table."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.campaign.circular_test import FEWEST_READINGS
from ldbb_bayes.errors import InputError, placed, require
from ldbb_bayes.reading.angle_convention import (
    angle_convention,
    header_of_quadrants,
    header_of_rotary_axis,
    header_of_rotation,
)
from ldbb_bayes.reading.angular_speed import feed_of_angular_speed
from ldbb_bayes.reading.assumptions import LIST_SHOWN, NOTHING_STATED
from ldbb_bayes.reading.cartesian_columns import (
    advice_on_positions,
    lie_on_circle,
    plane_of_positions,
    position_headers,
)
from ldbb_bayes.reading.column_units import unit_size
from ldbb_bayes.reading.derived_columns import derived_words
from ldbb_bayes.reading.header_units import unit_of
from ldbb_bayes.reading.laps import (
    TURN_DEG,
    angles_from_time,
    average_laps,
    direction_of_travel,
    is_in_random_order,
    on_the_circle,
)
from ldbb_bayes.reading.log_start import start_at_axis, start_of_programme, unread_run_in
from ldbb_bayes.reading.log_times import times_of_log
from ldbb_bayes.reading.open_question import OpenQuestionError
from ldbb_bayes.reading.programmed_circles import programmed_arcs
from ldbb_bayes.reading.reading_sign import sign_of_readings
from ldbb_bayes.reading.recording import AssumedUnit, Recording
from ldbb_bayes.reading.stated_values import quantity_of
from ldbb_bayes.reading.stepped_angles import may_be_stepped, stepped_angles
from ldbb_bayes.reading.travel_direction import unread_direction
from ldbb_bayes.reading.words import UNITS
from ldbb_bayes.results import Array

__all__ = ["Trace", "trace_of"]

# Largest deviation from the radius that a bar can measure [mm]. If the difference between the
# median of the readings and the nominal radius is smaller, the readings are taken as distances
# between the balls.
_LARGEST_DEVIATION_MM = 1.5
# Readings are probably distances between the balls, and not deviations from the radius, if their
# median is larger than this [mm] and their scatter is small.
_SMALLEST_RADIUS_MM = 20.0
# The scatter of readings is small if their median absolute deviation is below this fraction of
# their median.
_SMALLEST_SCATTER = 0.01
# Usual units of angles and readings. They are not used if the user or the file states a unit.
_DEGREES = AssumedUnit("deg", "")
_MICROMETRES = AssumedUnit("um", "")
# Fewest angles in one turn of a test with several turns. If a turn has fewer, the angles are
# probably in another unit.
_FEWEST_ANGLES_OF_TURN = 4
# A test whose angles cover more than this number of turns holds several laps, or a run-in and
# run-out in addition to its circle.
_MORE_THAN_A_TURN = 1.02
# Angles from 0 to 360, with rounding, are those of one turn whose first angle stands again [deg].
_CLOSED_TURN_DEG = 360.01
# Angles that span no more than a quarter of a turn, with rounding, may be those within a quadrant
# [deg].
_QUADRANT_DEG = 90.01
# Words for the directions of travel and the senses of angles.
_IN_WORDS = {"CW": "clockwise", "CCW": "counter-clockwise"}
# An error message shows at most this number of computed columns, and of characters of a header.
_COLUMNS_SHOWN = 4
_LONGEST_HEADER_SHOWN = 40


class Trace(NamedTuple):
    """Angles, readings and direction of travel of one test."""

    #: angles of the n readings of a test [deg], shape (n,), counted counter-clockwise from the
    #: plane's first axis; they continue beyond 360°
    angle_deg: Array
    #: the n readings of a test: actual distance between the balls minus radius [µm], shape (n,)
    reading_um: Array
    direction: str | None  #: direction of travel of the test, CW or CCW; None if unknown


class _Log(NamedTuple):
    """Angles and direction of travel of a test whose table has times instead of angles."""

    # angles of the m readings on the circle, without run-in and run-out [deg], shape (m,)
    angle_deg: Array
    # whether each of the n readings is on the circle, and not in the run-in or run-out, shape (n,)
    on_circle: NDArray[np.bool_]
    direction: str  # direction of travel, CW or CCW; CCW if nothing states it


def trace_of(recording: Recording, direction: str | None) -> Trace:
    """Return angles [deg], readings [µm] and direction of travel of a test.

    Several laps are averaged if the layout says so; otherwise all laps are kept. If the table has
    times instead of angles, the readings in the run-in and run-out are left out, and the direction
    is assumed to be CCW if nothing states it.

    Parameters
    ----------
    recording
        Rows of the test in the file, and everything that the file or the user states about the
        test.
    direction
        Stated direction of travel, CW or CCW; None if nothing states it.

    Raises
    ------
    InputError
        If a column is missing, if times do not increase, if the feed is not stated for a table with
        times, if readings can be neither deviations nor distances, or if laps cannot be averaged.
    """
    readings = recording.numbers.get("reading")
    if "angle" not in recording.numbers and "time" in recording.numbers:
        log = _angles_of_log(recording, direction)
        angle = log.angle_deg
        direction = log.direction
        if readings is not None:
            readings = readings[log.on_circle]
    else:
        angle = _angles_of_column(recording, direction)
    if readings is None:
        raise _missing_column(recording, "reading", "reading")
    reading = _deviations(recording, readings)
    if is_in_random_order(angle):
        angle = np.mod(angle, TURN_DEG)
        order = np.argsort(angle)
        angle, reading = angle[order], reading[order]
        recording.note("rows", "sorted by angle", "they fill a turn in no order", "sort the file")
    with placed(recording.place):
        return _handle_laps(recording, Trace(angle, reading, direction))


def _missing_column(recording: Recording, role: str, content: str) -> InputError:
    """Return the error for a table without a column of angles, or without a column of readings.

    ``role`` is the role of the missing column, and ``content`` says in words what it must hold. If
    the table has positions along two axes, the message says how to compute angles from them.
    """
    headers = ", ".join(repr(header) for header in recording.heading.headers_in_file)
    options = f"--{role}-column"
    if role == "angle":
        options += ", or --time-column"
    positions = position_headers(recording.heading.headers)
    if positions:
        column = recording.heading.roles.get("reading")
        has_reading = column is not None and recording.heading.headers[column] not in positions
        plane = plane_of_positions(positions, _plane_of(recording))
        return InputError(
            f"{recording.place}: a column must hold the {content}, got {headers[:LIST_SHOWN]} in"
            f" line {recording.heading.line}. {advice_on_positions(plane, has_reading)}"
            f" If one column is the {role}: --{role}-column."
        )
    advice = _computed_columns(recording) if role == "reading" else ""
    return InputError(
        f"{recording.place}: a column must hold the {content}, got {headers[:LIST_SHOWN]} in line"
        f" {recording.heading.line}. Say which: {options}.{advice}"
    )


def _computed_columns(recording: Recording) -> str:
    """Return a sentence on columns whose headers say that they hold computed numbers.

    An example is "std". The sentence is empty if there are no such columns. Columns that hold
    another quantity, such as a nominal force, are left out.
    """
    heading = recording.heading
    computed = []
    for column, header in enumerate(heading.headers):
        if column not in heading.roles.values() and derived_words(unit_of(header).name):
            computed.append(repr(header[:_LONGEST_HEADER_SHOWN]))
    if not computed:
        return ""
    return f" Columns that look computed: {' and '.join(computed[:_COLUMNS_SHOWN])}."


def _angles_of_column(recording: Recording, direction: str | None) -> Array:
    """Return the angle of every reading of a test, shape (n,) [deg].

    The angles are taken from the column of angles. If lines above the table state the first angle
    and the step of the angles instead, the angles are computed from these. Raise an `InputError` if
    there are neither such lines nor a column of angles. The returned angles are counted
    counter-clockwise from the plane's first axis, and continue beyond 360°. ``recording`` holds the
    rows of the test in its file, and everything that the file or the user states about the test.
    ``direction`` is the stated direction of travel.
    """
    raw = recording.numbers.get("angle")
    if may_be_stepped(recording):
        stepped = stepped_angles(recording, direction)
        if stepped is not None:
            convention = angle_convention(recording, _plane_of(recording))
            return convention.sign * (stepped - convention.offset_deg)
    if raw is None:
        raise _missing_column(recording, "angle", "angle, or the time")
    reading = recording.numbers.get("reading")
    if recording.heading.line == 0 and reading is not None and lie_on_circle(raw, reading):
        advice = advice_on_positions(_plane_of(recording), has_reading=False)
        raise InputError(
            f"{recording.place}: a table without a header must hold angles and readings, got two"
            f" columns of positions on a circle. {advice}"
        )
    assumed = recording.assumed_units.get("angle", _DEGREES)
    size = unit_size(recording, "angle", assumed.unit, assumed.reason)
    _check_unit_of_angles(recording, raw * size)
    _check_quadrants(recording, raw * size)
    convention = angle_convention(recording, _plane_of(recording))
    angle = convention.sign * (raw * size - convention.offset_deg)
    return np.unwrap(angle, period=TURN_DEG)


def _check_unit_of_angles(recording: Recording, angle_deg: Array) -> None:
    """Raise an error if there are so few readings in a turn that the angles' unit must be wrong.

    ``angle_deg`` are the angles of all readings, shape (n,) [deg].
    """
    n_turns = float(np.ptp(angle_deg)) / TURN_DEG
    n_readings = len(angle_deg)
    if n_turns > _MORE_THAN_A_TURN and n_readings < _FEWEST_ANGLES_OF_TURN * n_turns:
        count = _unit_of_counts(n_turns)
        raise OpenQuestionError(
            f"{recording.place}: a turn must have {_FEWEST_ANGLES_OF_TURN} angles or more, got"
            f" {n_readings} in {n_turns:.4g} turns. Say in which unit the angles are:"
            f" --angle-unit, such as '{count}' for counts.",
            "angle_unit",
            [*UNITS["angle"], count],
        )


def _check_quadrants(recording: Recording, angle_deg: Array) -> None:
    """Raise an error if angles are counted anew in each quadrant, which a column beside them names.

    ``angle_deg`` are the angles of all readings, shape (n,) [deg].
    """
    header = header_of_quadrants(recording)
    require(
        not header or float(np.ptp(angle_deg)) > _QUADRANT_DEG,
        f"{recording.place}: angles must run around the circle, got {header!r} in line"
        f" {recording.heading.line} and angles within a quadrant. Replace them by angles around the"
        " circle, 0° to 360°.",
    )


def _unit_of_counts(n_turns: float) -> str:
    """Return the angle of one count (step of an encoder) as a unit, such as ``0.01 deg``.

    The candidates are 0.1 deg, 0.01 deg and so on. The result is the candidate with which the
    angles cover about one turn. ``n_turns`` is the number of turns that the angles would cover if
    they were in degrees.
    """
    return f"{10.0 ** -max(1, round(np.log10(n_turns))):g} deg"


def _plane_of(recording: Recording) -> str:
    """Return the plane that a test states, or else the plane of the campaign, or else XY."""
    return recording.fields.get("plane") or recording.campaign.get("plane") or "XY"


def _start_of_circle(recording: Recording, direction: str | None) -> float:
    """Return the angle [deg] at which the circle of a test with times instead of angles starts.

    Three sources are tried in this order:

    - a stated value of ``start_deg``,
    - a line that names an axis, such as +X, as the start,
    - an NC programme in the file.

    The first source that states the angle is used. If none states it, the angle is zero.
    ``direction`` is the stated direction of travel, CW or CCW; None if nothing states it.
    """
    stated = quantity_of(recording, "start_deg")
    if stated is not None:
        return stated
    plane = _plane_of(recording)
    at_axis = start_at_axis(recording, plane)
    if at_axis is not None:
        return at_axis
    programmed = start_of_programme(recording, plane, direction)
    if programmed is not None:
        return programmed
    recording.note("start_deg", "0°", NOTHING_STATED, "--start-deg")
    return 0.0


def _angles_of_log(recording: Recording, direction: str | None) -> _Log:
    """Return the angles of a test whose table has times instead of angles.

    The angles are computed from times, feed and radius. Only angles of readings on the circle are
    returned; readings in the run-in and run-out are left out. ``direction`` is the stated direction
    of travel, CW or CCW. If it is None, CCW is assumed. ``recording`` holds the rows of the test in
    its file, and everything that the file or the user states about the test.
    """
    feed = quantity_of(recording, "feed_mm_per_min")
    if feed is None:
        feed = feed_of_angular_speed(recording)
    if feed is None or not feed > 0.0:
        raise _missing_feed(recording)
    if direction is None:
        _check_no_direction(recording)
    start_deg = _start_of_circle(recording, direction)
    run_in_deg = quantity_of(recording, "overshoot_deg")
    reason = "a log holds no more"
    recording.note("feed", "constant from the first reading on", reason, "--overshoot-deg")
    if direction is None:
        direction = "CCW"
        recording.note("direction", direction, "none stated", "--direction")
    sense = -1 if direction == "CW" else 1
    times = times_of_log(recording)
    with placed(recording.place):
        angle = angles_from_time(
            times,
            feed_mm_per_min=feed,
            radius_mm=recording.radius_mm,
            start_deg=start_deg,
            overshoot_deg=run_in_deg or 0.0,
            sense=sense,
        )
    _check_readings_of_turn(recording, angle)
    if run_in_deg is None:
        _check_run_in(recording, angle)
    on_circle = on_the_circle(angle, start_deg=start_deg, sense=sense)
    if not on_circle.all():
        count = f"{np.count_nonzero(~on_circle)} readings left out"
        recording.note("run-in and run-out", count, "outside whole turns", "--overshoot-deg")
    return _Log(angle[on_circle], on_circle, direction)


def _missing_feed(recording: Recording) -> InputError:
    """Return the error for a table with times instead of angles if the feed is not stated.

    If the table also has positions along two axes, the message says how to compute angles from
    them.
    """
    positions = position_headers(recording.heading.headers)
    if positions:
        listed = ", ".join(repr(header) for header in positions)
        plane = plane_of_positions(positions, _plane_of(recording))
        return InputError(
            f"{recording.place}: a log over time must come with its feed, got none, and positions"
            f" {listed[:LIST_SHOWN]}. {advice_on_positions(plane, has_reading=True)} If the"
            " feed is known: --feed-mm-per-min."
        )
    return InputError(
        f"{recording.place}: a log over time must come with its feed, got none. Give"
        " --feed-mm-per-min."
    )


def _check_no_direction(recording: Recording) -> None:
    """Raise an error if the direction of travel is unknown although lines seem to state it.

    The error is raised if a line about the direction is not understood, or if G-code in lines above
    the table programs circles in both directions. The direction must be known, because the angles
    of a table with times are computed from it.
    """
    lines = [*recording.lines_of_all_tests, *recording.heading.lines_above]
    words = ""
    unread = unread_direction(recording.lines_outside)
    if unread is not None:
        words = f"{unread.text!r} in line {unread.line}"
    elif len({arc.direction for arc in programmed_arcs(lines)}) > 1:
        words = "G2 and G3 in lines above the table"
    if words:
        raise OpenQuestionError(
            f"{recording.place}: the direction of a log over time must be CW or CCW, got {words}."
            " Say which: --direction CW or CCW.",
            "direction",
            ("CW", "CCW"),
        )


def _check_readings_of_turn(recording: Recording, angle_deg: Array) -> None:
    """Raise an error if a table with times has too few readings in one turn of the bar.

    ``angle_deg`` are the angles of all readings, shape (n,) [deg].
    """
    n_turns = float(np.ptp(angle_deg)) / TURN_DEG
    n_readings = len(angle_deg) / max(n_turns, 1.0)
    require(
        n_readings >= FEWEST_READINGS,
        f"{recording.place}: a log must have {FEWEST_READINGS} readings in a turn, got"
        f" {n_readings:.2g} ({len(angle_deg)} in {n_turns:.4g} turns). Give --time-unit (ms?), or"
        " correct feed and radius.",
    )


def _check_run_in(recording: Recording, angle_deg: Array) -> None:
    """Note that a log begins on the circle, or raise an error if it holds more than whole turns.

    The function is used for a log whose run-in is not stated. The readings beyond whole turns may
    belong to the run-in before the circle, or to the run-out after it. If they belong to the
    run-in, all angles would be wrong by its angle.

    ``angle_deg`` are the angles of all readings, computed from their times, shape (n,) [deg].
    """
    step = float(np.median(np.abs(np.diff(angle_deg))))
    covered_deg = float(np.ptp(angle_deg)) + step
    n_turns = covered_deg // TURN_DEG
    beyond_deg = covered_deg - n_turns * TURN_DEG
    unread = unread_run_in(recording)
    if n_turns < 1.0 or beyond_deg < (_MORE_THAN_A_TURN - 1.0) * TURN_DEG:
        recording.note("overshoot_deg", "0°", unread or NOTHING_STATED, "--overshoot-deg")
        return
    hint = "" if unread is None else f" and {unread.quoted!r} in line {unread.line}"
    raise InputError(
        f"{recording.place}: a log longer than whole turns must say how far the machine moved"
        f" before the circle, got {covered_deg:.0f}° of readings{hint}. Give --overshoot-deg"
        " (0 if the first reading is on the circle)."
    )


def _deviations(recording: Recording, raw: Array) -> Array:
    """Return the readings of a test, shape (n,) [µm]: actual minus nominal distance of the balls.

    The nominal distance is the radius of the circle. ``raw`` are the numbers in the file, in the
    unit of the file, shape (n,). ``recording`` holds the rows of the test in its file, and
    everything that the file or the user states about the test.
    """
    require(
        np.ptp(raw) > 0.0,
        f"{recording.place}: the reading must change from row to row, got {raw[0]:g} in all. Say"
        " which column it is: --reading-column.",
    )
    assumed = recording.assumed_units.get("reading", _MICROMETRES)
    reading = raw * unit_size(recording, "reading", assumed.unit, assumed.reason)
    if _kind_of_readings(recording, reading) == "distance":
        reading = reading - 1e3 * recording.radius_mm
    return sign_of_readings(recording) * reading


def _kind_of_readings(recording: Recording, reading_um: Array) -> str:
    """Return "deviation" or "distance", depending on what the readings of a test are.

    Readings are either deviations from the nominal radius, or distances between the balls. If the
    user does not state which, the median of the readings decides. Raise an `InputError` if the
    readings seem to be distances on a circle of another radius, or if they contradict what the user
    states. ``recording`` holds the rows of the test in its file, and everything that the file or
    the user states about the test; ``reading_um`` are the readings of the test [µm].
    """
    radius_mm = recording.radius_mm
    # Readings are either distances between the balls or deviations from the radius. ``is_near`` is
    # true if they can be distances on a circle with the nominal radius. ``is_far`` is true if they
    # are probably too large for deviations; they are then distances on a circle of any radius.
    median_mm = float(np.median(reading_um)) * 1e-3
    scatter_mm = float(np.median(np.abs(reading_um - 1e3 * median_mm))) * 1e-3
    is_near = abs(median_mm - radius_mm) < _LARGEST_DEVIATION_MM
    is_far = median_mm > _SMALLEST_RADIUS_MM and scatter_mm < _SMALLEST_SCATTER * median_mm
    stated = recording.layout.zero
    if stated == "distance":
        is_wrong = not is_near
    elif stated == "deviation":
        is_wrong = is_far
    else:
        is_wrong = is_far and not is_near
    if is_wrong:
        as_stated = ""
        if stated is not None:
            as_stated = f" as {stated} (--zero)"
        raise InputError(
            f"{recording.place}: readings must be deviations from {radius_mm:g} mm, or distances"
            f" near it, got {median_mm:.5g} mm{as_stated}. Give --radius-mm, or --unit, or --zero."
        )
    if stated is not None:
        return stated
    if not is_near:
        recording.log.keep(zero="deviation")
        return "deviation"
    recording.log.keep(zero="distance")
    subtracted = f"distance of the balls, {radius_mm:g} mm subtracted"
    recording.note("reading", subtracted, f"its median is {median_mm:.4g} mm", "--zero")
    return "distance"


def _handle_laps(recording: Recording, trace: Trace) -> Trace:
    """Return the angles and readings of a test. Laps are averaged if the layout says so.

    A lap is one turn of the bar. If the angles cover less than 1.02 turns, nothing is averaged. If
    they cover more and the layout says nothing about laps, all readings are kept. This is noted,
    and stored in the layout for later imports. A contradiction between the angles and the stated
    direction of travel is noted, or raises an `InputError`. ``recording`` holds the rows of the
    test in its file, and everything that the file or the user states about the test; ``trace``
    holds the angles and readings of the test.
    """
    angle = trace.angle_deg
    if len(angle) < 2:
        return trace
    # The last reading of a full circle is usually one step before the angle at which the circle
    # began. This step is therefore added to the angle that the readings cover.
    step = np.median(np.abs(np.diff(angle)))
    n_laps = float(abs(angle[-1] - angle[0]) + step) / TURN_DEG
    _check_direction(recording, trace, n_laps)
    if n_laps < _MORE_THAN_A_TURN or recording.layout.laps == "keep":
        return trace
    if recording.layout.laps == "average":
        angle, reading = average_laps(angle, trace.reading_um)
        return Trace(angle, reading, trace.direction)
    recording.note("laps", f"all {n_laps:.2f} kept in one test", "longer than a turn", "--laps")
    recording.log.keep(laps="keep")
    return trace


def _check_axis_is_clear(recording: Recording, trace: Trace) -> None:
    """Raise an error if the angle of a rotary axis falls and nothing states the direction.

    The axis may have turned clockwise, or it may count clockwise angles as positive.
    """
    if "angle" not in recording.numbers or trace.direction is not None:
        return
    header = header_of_rotary_axis(recording)
    falls = float(np.median(np.diff(recording.numbers["angle"]))) < 0.0
    require(
        not (header and falls),
        f"{header!r} must have a known sense, got falling angles and no direction. If the circle"
        " ran clockwise, give --direction CW; if the axis counts clockwise, give --angle-sense CW.",
    )


def _check_direction(recording: Recording, trace: Trace, n_laps: float) -> None:
    """Add a note if the stated direction of travel contradicts the order of the angles.

    The angles of a single lap may have been sorted, so that their order does not show the
    direction. This also holds if the first angle stands again at the end, as in 0 to 360. Angles
    that continue over several laps cannot have been sorted, and falling angles that the file counts
    clockwise were hardly sorted: "Angle CW" may name the direction of travel. If such angles
    contradict the stated direction, an `InputError` is raised instead, unless the layout states in
    which sense angles are counted. It is also raised for angles with a header such as "Path angle",
    which may be counted along the travel. ``n_laps`` is the number of laps. ``trace`` holds the
    angles and the stated direction of travel.
    """
    run = direction_of_travel(trace.angle_deg)
    _check_axis_is_clear(recording, trace)
    if trace.direction is None or run in (None, trace.direction):
        return
    layout = recording.layout
    is_sense_stated = layout.angle_sense is not None or layout.angle_sign is not None
    steps = np.diff(recording.numbers["angle"])
    rises = float(np.median(steps)) > 0.0
    falls_clockwise = run == "CCW" and bool(np.all(steps < 0.0))
    span_deg = float(abs(trace.angle_deg[-1] - trace.angle_deg[0]))
    is_longer = n_laps >= _MORE_THAN_A_TURN and span_deg > _CLOSED_TURN_DEG
    was_not_sorted = is_longer or falls_clockwise
    if was_not_sorted and not is_sense_stated:
        other_sense = "CCW"
        # Nothing states in which sense the angles are counted. ``run`` is the direction of travel
        # that follows from the angles if they are counted counter-clockwise.
        if rises == (run == "CCW"):
            other_sense = "CW"
        raise InputError(
            f"direction must agree with the angles, got {trace.direction} and angles that run {run}"
            f" over {n_laps:.2f} laps. If the angles are counted {_IN_WORDS[other_sense]}, give"
            f" --angle-sense {other_sense}; if the machine ran {_IN_WORDS[run]}, give --direction"
            f" {run}."
        )
    header = header_of_rotation(recording)
    require(
        not header or rises,
        f"{header!r} must count from an axis, got direction {trace.direction} and angles that run"
        f" {run}. They fall, and an angle travelled from the start rises. If it is counted"
        " clockwise, give --angle-sense CW; if it is counted counter-clockwise and the rows were"
        " put in another order, give --angle-sense CCW.",
    )
    require(
        not header,
        f"{header!r} must count from an axis, got direction {trace.direction} and angles that run"
        f" {run}. If it is the angle travelled from the start, call the column 'travelled angle';"
        " if it is counted counter-clockwise whatever the direction, give --angle-sense CCW.",
    )
    recording.note(
        "direction",
        f"{trace.direction}, as stated",
        f"the angles run {run}: taken as sorted",
        "--direction",
    )
