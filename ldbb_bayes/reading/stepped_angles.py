"""Angles of a table without a column of angles, from lines that state the first angle and the step.

Such lines stand above the table. Apart from the readings, the table has at most a column that
numbers the points.
"""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np

from ldbb_bayes.errors import InputError
from ldbb_bayes.reading.cited_lines import CitedLine
from ldbb_bayes.reading.numerals import NUMBER_IN_TEXT, number_in_text
from ldbb_bayes.reading.recording import Recording
from ldbb_bayes.reading.words import LONGEST_TEXT, UNITS, WORDS, unit_named
from ldbb_bayes.results import Array

__all__ = ["may_be_stepped", "states_step", "stepped_angles"]

_STATED = rf"\s*[:=;,]?\s*(?P<number>{NUMBER_IN_TEXT})\s*(?P<unit>°|[^\W\d_]+)?"
_WORDS = WORDS["stepped_angles"]
# Regular expressions for the start, the end and the step of the angles in a line.
_START = re.compile(rf"(?<![^\W_])(?:{_WORDS['start']}){_STATED}", re.IGNORECASE)
_END = re.compile(rf"(?<![^\W_])(?:{_WORDS['end']}){_STATED}", re.IGNORECASE)
_STEP = re.compile(rf"(?<![^\W_])(?:{_WORDS['step']}){_STATED}", re.IGNORECASE)
_NAMES_ANGLE = re.compile(_WORDS["angle"], re.IGNORECASE)
# The last angle that a file states must be a whole number of steps away from the first angle. A
# deviation of less than this fraction of a step is allowed.
_EVEN_SHARE = 0.01


class _StatedAngle(NamedTuple):
    """Angle that a line above a table states, such as the first angle of the readings."""

    value_deg: float  # angle that the line states [deg]
    # number of the line that states the angle; if this line is not in the sheet of the table, a
    # text with the number and the other sheet, such as "3 of notes.txt"
    line: int | str
    quoted: str  # words with which a line above the table states an angle, such as "Start: 0 deg"


def may_be_stepped(recording: Recording) -> bool:
    """Return whether no column states the angles of a test, so that lines above may state them.

    This is the case if the table has no column of angles. It is also the case if the column of
    angles has no unit and only counts the readings: 1, 2, 3 and so on, or 0, 1, 2 and so on.
    """
    numbers = recording.numbers.get("angle")
    if numbers is None:
        return True
    unit = recording.heading.units[recording.heading.roles["angle"]]
    is_counted = numbers[0] in (0.0, 1.0) and bool(np.all(np.diff(numbers) == 1.0))
    return is_counted and not unit


def states_step(text: str) -> bool:
    """Return whether a line states the step of angles, as in ``Angle step: 5°``."""
    step = _STEP.search(text[:LONGEST_TEXT])
    if step is None:
        return False
    return unit_named(step["unit"] or "") in UNITS["angle"] or _NAMES_ANGLE.search(text) is not None


def stepped_angles(recording: Recording, direction: str | None) -> Array | None:
    """Return the angles [deg] that lines above a table state, shape (n,), one for each reading.

    The use of these lines is noted. Return None if no line states a step other than zero. Also
    return None if a column of the table holds the numbers 0, 1, 2 and so on, and the lines do not
    contradict them: these numbers may then be the angles.

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
        If a step is stated without a start, or an end without a step. The error is also raised if a
        test with the direction CW has a positive step but no stated end, if the test leaves out
        rows of the table, or if the end does not agree with the number of readings.
    """
    start = _stated_angle(recording, _START)
    end = _stated_angle(recording, _END)
    step = _stated_angle(recording, _STEP, is_of_angle=start is not None or end is not None)
    n_readings = len(recording.lines)
    if _column_may_hold_angles(recording, start, end, step):
        return None
    if step is None or step.value_deg == 0.0:
        _check_no_end(recording, start, end)
        return None
    if start is None:
        raise InputError(
            f"{recording.place}: angles must follow from start and step, got a step in line"
            f" {step.line} and no start. Write a line"
            f" 'Start angle: {_start_before(end, step, n_readings):g} deg' above the table, or add"
            " a column 'Angle [deg]'."
        )
    step_deg = step.value_deg
    if end is None:
        if direction == "CW" and step_deg > 0.0:
            raise InputError(
                f"{recording.place}: angles must follow from start, step and end, got CW and no"
                " end. Write a line 'End angle: 0 deg' above the table, or add a column"
                " 'Angle [deg]'."
            )
    elif (end.value_deg - start.value_deg) * step_deg < 0.0:
        step_deg = -step_deg
    _check_readings_are_complete(recording, start, end, step_deg)
    value = f"from {start.value_deg:g}° in steps of {step_deg:g}°"
    reason = f"line {start.line}, line {step.line}"
    used = [angle for angle in (start, step, end) if angle is not None]
    recording.log.cite(recording.place, [CitedLine("", angle.line, angle.quoted) for angle in used])
    recording.note("angle", value, reason, "a column of angles")
    return start.value_deg + step_deg * np.arange(n_readings)


def _check_no_end(
    recording: Recording, start: _StatedAngle | None, end: _StatedAngle | None
) -> None:
    """Raise an `InputError` if lines state where the angles end, but not their step.

    The error is not raised if the table has a column that may hold the angles, or a column of times
    from which the angles follow.
    """
    if end is None or "time" in recording.numbers:
        return
    n_readings = len(recording.lines)
    if start is not None:
        raise InputError(
            f"{recording.place}: angles must follow from start and step, got start and end in line"
            f" {start.line} and no step. Write a line"
            f" 'Angle step: {_usual_step(end.value_deg - start.value_deg, n_readings):g} deg' above"
            " the table, or add a column 'Angle [deg]'."
        )
    if "angle" not in recording.numbers:
        raise InputError(
            f"{recording.place}: angles must follow from start and step, got an end in line"
            f" {end.line} and no start. Write a line 'Start angle: 0 deg; angle step:"
            f" {_usual_step(end.value_deg, n_readings):g} deg' above the table, or add a column"
            " 'Angle [deg]'."
        )


def _usual_step(range_deg: float, n_readings: int) -> float:
    """Return the most probable step [deg] from one angle to the next.

    ``range_deg`` is the stated last angle minus the first angle. The last angle may be that of the
    last reading or lie one step further. The range is therefore divided by the number of readings
    minus one, and by the number of readings. The quotient with fewer digits is returned.
    """
    steps = [range_deg / (n_readings - 1), range_deg / n_readings]
    return min(steps, key=lambda step: len(f"{step:g}"))


def _start_before(end: _StatedAngle | None, step: _StatedAngle, n_readings: int) -> float:
    """Return the angle [deg] at which a circle probably starts, computed from its end.

    The end may be the angle of the last of ``n_readings`` readings, or lie one step further. Of the
    two possible starts, the one nearer to 0° is returned. If no end is stated, the start is 0°.
    """
    if end is None:
        return 0.0
    last = abs(step.value_deg) * n_readings
    starts = [end.value_deg - last + abs(step.value_deg), end.value_deg - last]
    return min(starts, key=abs)


def _column_may_hold_angles(
    recording: Recording,
    start: _StatedAngle | None,
    end: _StatedAngle | None,
    step: _StatedAngle | None,
) -> bool:
    """Return whether a column with the numbers 0, 1, 2 and so on may hold the stated angles.

    ``start``, ``end`` and ``step`` are the start, the end and the step of the angles, as stated
    above the table. An argument is None if it is not stated.
    """
    numbers = recording.numbers.get("angle")
    if numbers is None:
        return False
    if step is not None and step.value_deg != 1.0:
        return False
    if start is not None and start.value_deg != numbers[0]:
        return False
    return end is None or end.value_deg - numbers[-1] in (0.0, 1.0)


def _stated_angle(
    recording: Recording, pattern: re.Pattern[str], is_of_angle: bool = False
) -> _StatedAngle | None:
    """Return the angle in the first line above the table that matches a pattern, or None.

    ``pattern`` matches words such as "start", the number after them and, if there is one, the unit
    of the number. A line without a unit is skipped, because its number may be that of another
    quantity. It is not skipped if it contains a word such as "angle", or if ``is_of_angle`` is
    true: another line then states the first or the last angle.
    """
    for line, content in recording.heading.lines_above:
        match = pattern.search(content[:LONGEST_TEXT])
        if match is None:
            continue
        if not (match["unit"] or is_of_angle or _NAMES_ANGLE.search(content)):
            # Without the word angle and without a unit of angle, the start, end or step in a line
            # may be that of another quantity.
            continue
        value = number_in_text(match["number"])
        unit = unit_named(match["unit"] or "deg")
        if (match["unit"] or "").casefold() == "grad":  # in German, Grad means degree
            unit = "deg"
        if value is not None and unit in UNITS["angle"]:
            return _StatedAngle(value * UNITS["angle"][unit], line, match[0])
    return None


def _check_readings_are_complete(
    recording: Recording, start: _StatedAngle, end: _StatedAngle | None, step_deg: float
) -> None:
    """Raise an `InputError` if the readings do not fit the stated start, step and end.

    No reading may be missing. The end must be the angle of the last reading, or one step further.
    ``start`` and ``end`` are the stated angles, and ``step_deg`` is the step [deg]; ``end`` is None
    if it is not stated.
    """
    n_readings = len(recording.lines)
    lines_of_table = [row.line for row in recording.sheet.rows[recording.heading.first_row :]]
    first = lines_of_table.index(recording.lines[0])
    has_all_rows = lines_of_table[first : first + n_readings] == recording.lines
    has_first_row = first == 0 or bool(recording.label)
    fits_end = True
    if end is not None:
        n_steps = (end.value_deg - start.value_deg) / step_deg
        misfit = min(abs(n_steps - n_readings), abs(n_steps - n_readings + 1))
        fits_end = misfit < _EVEN_SHARE
    if not (has_all_rows and has_first_row and fits_end):
        raise InputError(
            f"{recording.place}: readings must be complete to follow from the step in the lines"
            f" above, got {n_readings} that do not fit. Add a column 'Angle [deg]'."
        )
