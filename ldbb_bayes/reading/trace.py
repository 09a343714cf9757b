"""Traces: the angles [deg] and readings [µm] of one test, made from its columns."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.errors import InputError, placed, require
from ldbb_bayes.reading.laps import (
    TURN_DEG,
    angles_from_time,
    average_laps,
    direction_run,
    on_the_circle,
)
from ldbb_bayes.reading.recording import Recording, option_for
from ldbb_bayes.reading.stated_values import quantity_of, unit_size
from ldbb_bayes.results import Array

__all__ = ["Trace", "trace_of"]

# Angles without a unit that span more than this are in degrees.
_LARGEST_SPAN_RAD = 7.0
# Readings whose median is within this of the radius are distances of the balls: deviations that a
# bar can measure are no larger.
_LARGEST_DEVIATION_MM = 1.5
# Readings without a unit whose median is within this share of the radius in mm are in mm.
_NEAR_RADIUS = 0.05
# Readings without a unit that are all smaller than this are in mm.
_LARGEST_IN_MM = 0.5
# Readings whose median is larger than this [mm], and whose scatter is below this share of the
# median, are distances of the balls.
_SMALLEST_RADIUS_MM = 20.0
_SMALLEST_SCATTER = 0.01
# A recording of more than so many turns holds several laps, or run-in and run-out.
_MORE_THAN_A_TURN = 1.02
# A message shows so many characters of a list of columns.
_LIST_SHOWN = 200


class Trace(NamedTuple):
    """Angles and readings of one test."""

    #: angles from the plane's first axis, counter-clockwise, not reduced modulo 360°, shape (n,)
    angle_deg: Array
    reading_um: Array  #: actual distance of the balls − radius, shape (n,)
    direction: str | None  #: CW, CCW or None for unknown; always known for a log over time


class _Log(NamedTuple):
    """Angles computed for a log over time."""

    angle_deg: Array  # angles of the m readings on the circle, shape (m,)
    on_circle: NDArray[np.bool_]  # which of all n readings lie on the circle, shape (n,)
    direction: str


def trace_of(recording: Recording, direction: str | None) -> Trace:
    """Return the trace of a test.

    Parameters
    ----------
    recording
        The test, with its radius.
    direction
        CW or CCW as stated; None where nothing states it.

    Raises
    ------
    InputError
        For missing columns, readings that fit neither deviations nor distances, and laps that
        cannot be averaged.
    """
    readings = recording.numbers.get("reading")
    if "angle" not in recording.numbers and "time" in recording.numbers:
        log = _angles_of_log(recording, direction)
        angle = log.angle_deg
        direction = log.direction
        if readings is not None:
            readings = readings[log.on_circle]
    else:
        angle = _angles_of_column(recording)
    if readings is None:
        raise _missing_column(recording, "reading", "reading")
    reading = _deviations(recording, readings)
    with placed(recording.place):
        return _handle_laps(recording, Trace(angle, reading, direction))


def _missing_column(recording: Recording, role: str, content: str) -> InputError:
    headers = ", ".join(repr(header) for header in recording.heading.headers)
    return InputError(
        f"{recording.place}: a column must hold the {content}, got {headers[:_LIST_SHOWN]} in line"
        f" {recording.heading.line}. Say which: --{role}-column."
    )


def _angles_of_column(recording: Recording) -> Array:
    """Return the angle of every reading, from the plane's first axis, shape (n,) [deg]."""
    raw = recording.numbers.get("angle")
    if raw is None:
        raise _missing_column(recording, "angle", "angle, or the time")
    span = float(np.ptp(raw))
    usual_unit = "rad"
    if span > _LARGEST_SPAN_RAD:
        usual_unit = "deg"
    size = unit_size(recording, "angle", usual_unit, f"it spans {span:.4g}")
    layout = recording.layout
    angle = layout.angle_sign * (raw * size - layout.angle_offset_deg)
    return np.unwrap(angle, period=TURN_DEG)


def _angles_of_log(recording: Recording, direction: str | None) -> _Log:
    """Return the angles of a log over time, for its readings on the circle."""
    feed = quantity_of(recording, "feed_mm_per_min")
    if feed is None or not feed > 0.0:
        raise InputError(
            f"{recording.place}: a log over time must come with its feed, got none. Give"
            " --feed-mm-per-min."
        )
    start_deg = _angle_or_zero(recording, "start_deg")
    overshoot_deg = _angle_or_zero(recording, "overshoot_deg")
    reason = "a log holds no more"
    recording.note("feed", "constant from the first reading on", reason, "--overshoot-deg")
    if direction is None:
        direction = "CCW"
        recording.note("direction", direction, "none stated", "--direction")
    sense = -1 if direction == "CW" else 1
    times = recording.numbers["time"]
    backwards = np.flatnonzero(np.diff(times) <= 0.0)
    if backwards.size:
        line = recording.lines[backwards[0] + 1]
        raise InputError(
            f"{recording.place}, line {line}: time must increase from row to row. Sort or split the"
            " log."
        )
    with placed(recording.place):
        angle = angles_from_time(
            times * unit_size(recording, "time", "s"),
            feed_mm_per_min=feed,
            radius_mm=recording.radius_mm,
            start_deg=start_deg,
            overshoot_deg=overshoot_deg,
            sense=sense,
        )
    on_circle = on_the_circle(angle, start_deg=start_deg, sense=sense)
    if not on_circle.all():
        count = f"{np.count_nonzero(~on_circle)} readings left out"
        recording.note("run-in and run-out", count, "outside whole turns", "--overshoot-deg")
    return _Log(angle[on_circle], on_circle, direction)


def _angle_or_zero(recording: Recording, key: str) -> float:
    """Return a stated angle of a log over time, or else zero, which is noted as an assumption."""
    value = quantity_of(recording, key)
    if value is None:
        recording.note(key, "0°", "nothing says otherwise", option_for(key))
        return 0.0
    return value


def _deviations(recording: Recording, raw: Array) -> Array:
    """Return the readings as actual distance of the balls − radius, shape (n,) [µm]."""
    require(
        np.ptp(raw) > 0.0,
        f"{recording.place}: the reading must change from row to row, got {raw[0]:g} in all. Say"
        " which column it is: --reading-column.",
    )
    largest = float(np.abs(raw).max())
    is_near_radius = abs(np.median(raw) / recording.radius_mm - 1.0) < _NEAR_RADIUS
    usual_unit = "um"
    if is_near_radius or largest < _LARGEST_IN_MM:
        usual_unit = "mm"
    reading = raw * unit_size(recording, "reading", usual_unit, f"the largest is {largest:.4g}")
    if _zero_of(recording, reading) == "distance":
        reading = reading - 1e3 * recording.radius_mm
    return recording.layout.sign * reading


def _zero_of(recording: Recording, reading_um: Array) -> str:
    """Return "deviation" for deviations from the radius, "distance" for distances of the balls."""
    radius_mm = recording.radius_mm
    # Distances of the balls on another radius must not be taken for deviations from this one.
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
    """Return the trace with its laps kept or averaged, as the layout states.

    A stated direction that contradicts the order of the angles is noted.
    """
    angle = trace.angle_deg
    if len(angle) < 2:
        return trace
    run = direction_run(angle)
    if trace.direction and run not in (None, trace.direction):
        recording.note(
            "direction",
            f"{trace.direction}, as stated",
            f"the angles run {run}: taken as sorted",
            "--direction",
        )
    # A full circle whose last reading is one step before the first counts as one turn.
    step = np.median(np.abs(np.diff(angle)))
    n_laps = float(abs(angle[-1] - angle[0]) + step) / TURN_DEG
    if n_laps < _MORE_THAN_A_TURN or recording.layout.laps == "keep":
        return trace
    if recording.layout.laps == "average":
        angle, reading = average_laps(angle, trace.reading_um)
        return Trace(angle, reading, trace.direction)
    recording.note("laps", f"all {n_laps:.2f} kept in one test", "longer than a turn", "--laps")
    recording.log.keep(laps="keep")
    return trace
