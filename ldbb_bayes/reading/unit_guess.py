"""Units that are assumed for readings and angles if neither the user nor a file states them.

The same unit is assumed for all tests of a campaign. A unit of the readings, such as mm, is
possible under two conditions. In this unit, the readings must not be larger than the deviations
that a bar can measure. The change of the readings with force must also fit the stiffness of real
machines.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ldbb_bayes.campaign.campaign import ForceLaw
from ldbb_bayes.reading.cited_lines import (
    TEXT_SHOWN,
    CitedLine,
    cited_line,
    quoted_line,
    with_words,
)
from ldbb_bayes.reading.column_units import is_unit_stated
from ldbb_bayes.reading.lines_above import Lines, statements_in
from ldbb_bayes.reading.loads_in_lines import unit_of_all_loads
from ldbb_bayes.reading.measured_length import doubles_readings, may_be_diameter
from ldbb_bayes.reading.multiplied_angles import check_angles_are_not_multiplied
from ldbb_bayes.reading.open_question import OpenQuestionError
from ldbb_bayes.reading.recording import AssumedUnit, Recording
from ldbb_bayes.reading.unit_lines import (
    header_has_factor,
    inch_alone,
    mentions_scale,
    multiplies_readings,
    states_gain,
    unit_mentioned,
    unknown_unit_in,
)
from ldbb_bayes.reading.unit_sentences import fraction_mentioned
from ldbb_bayes.reading.words import SHARE, UNITS, shares_mentioned, size_of_unit

__all__ = ["assume_units"]

# Readings are assumed to be distances between the balls in mm if their median, read as a number of
# mm, differs from the radius by less than this fraction of the radius.
_NEAR_RADIUS = 0.05
# If the median absolute deviation of the readings is below this fraction of their median, the
# readings may be distances between the balls.
_SMALL_SCATTER = 0.01
# Largest deviation from the radius that a bar can measure [µm].
_LARGEST_DEVIATION_UM = 1500.0
# The largest reading divided by the largest force is assumed to be at least this [µm/N], because
# hardly any machine is stiffer.
_STIFFEST_UM_PER_N = 0.003
# The change of the readings with the force is assumed to be at most this [µm/N], because hardly any
# machine is softer.
_SOFTEST_UM_PER_N = 1.0
# If the largest force of all tests is below this number, forces without a unit are not taken as
# newtons, because loaded bars exert larger forces.
_SMALLEST_LOAD_N = 5.0
# Units that are tried for readings without a unit.
_USUAL_UNITS = ("um", "mm")
# Angles without a unit are taken as degrees if their range is larger than this number, and as
# radians if the range is smaller.
_LARGEST_SPAN_RAD = 7.0
# Regular expression for a word for counts (digital steps of an instrument), as in "run1_counts", or
# for a unit with a factor, as in "0.1um". It is searched for in names of tests, sheets and files.
_COUNTS_OR_SCALED_UNIT = re.compile(
    r"(?<![^\W\d_])counts?(?![^\W_])|(?<!\d)(?:0[.,]\d+|10)[ _]?[uµμn]m", re.IGNORECASE
)
# Size of a full turn in units of angle that are seldom used. If the angles of a test cover a whole
# turn in one of these units, the user is asked for the unit.
_OTHER_TURNS = {"gon": 400.0, "mrad": 2e3 * np.pi, "arcmin": 21_600.0, "turn": 1.0}
_TURN_DEG = 360.0
# The angles of a test are taken to cover whole turns if the range that they cover differs from a
# whole number of turns by at most this number of steps. A step is the difference of successive
# angles.
_STEPS_OF_TURN = 1.5
# Largest plausible step from one angle of a circle to the next [deg]. If a step in degrees would be
# larger, other units of angle are tried.
_LARGEST_STEP_DEG = 45.0


class _ReadingSize(NamedTuple):
    """Size of readings whose unit is not stated, computed from the numbers in the files."""

    largest: float  # largest absolute value of the readings of all tests, in the unit of the files
    # absolute difference between the median readings of the tests with the smallest and the largest
    # force, in the unit of the files
    change: float
    forces_N: tuple[float, float]  # smallest and largest force of the tests [N]


def assume_units(recordings: Sequence[Recording], campaign: Mapping[str, Any]) -> None:
    """Assume units for readings and angles for which neither the files nor the user state a unit.

    Readings that are distances between the balls are in mm. All other readings without a stated
    unit get the same unit, and so do all angles without a stated unit. The units are stored in the
    field ``assumed_units`` of the recordings. Forces without a stated unit are taken as newtons; an
    error is raised if they are too small. ``campaign`` are the fields of the campaign that options
    or files state.

    Raises
    ------
    OpenQuestionError
        If several units fit or none fits, if forces are too small to be in newtons, or if a header
        or line says that readings are multiplied by a number.
    """
    for recording in recordings:
        _check_factors(recording)
        check_angles_are_not_multiplied(recording)
    unstated = [entry for entry in recordings if _lacks_unit(entry, "reading")]
    distances = [recording for recording in unstated if _is_distance(recording)]
    for recording in distances:
        middle = float(np.median(recording.numbers["reading"]))
        recording.assumed_units["reading"] = AssumedUnit("mm", f"its median is {middle:.4g}")
    deviations = [recording for recording in unstated if not _is_distance(recording)]
    if deviations:
        _assume_reading_unit(deviations, campaign)
    _check_unit_of_forces(recordings)
    unstated = [entry for entry in recordings if _lacks_unit(entry, "angle")]
    if unstated:
        _assume_angle_unit(unstated)


def _lacks_unit(recording: Recording, role: str) -> bool:
    """Return whether a test has a column for ``role``, such as angle, but no stated unit for it."""
    return role in recording.numbers and not is_unit_stated(recording, role)


def _check_unit_of_forces(recordings: Sequence[Recording]) -> None:
    """Raise an error if forces whose unit is not stated are too small to be in newtons."""
    without_unit = []
    largest = 0.0
    for recording in recordings:
        force = _force_without_unit(recording)
        if force is not None:
            without_unit.append(recording)
            largest = max(largest, force)
    if without_unit and largest < _SMALLEST_LOAD_N:
        raise OpenQuestionError(
            f"{without_unit[0].place}: forces must have a unit, got none, and numbers up to"
            f" {largest:.4g}, which are few newtons. Say which: --force-unit.",
            "force_unit",
            list(UNITS["force"]),
        )


def _force_without_unit(recording: Recording) -> float | None:
    """Return the largest force of a test as the file writes it, if nothing states its unit.

    The force stands in a column, or in a line above the table or of a list of tests. Return None if
    its unit is known, or if the test has no such force.
    """
    if _lacks_unit(recording, "force"):
        return float(np.abs(recording.numbers["force"]).max())
    is_stated = recording.stated_value("force_N") is not None or "force" in recording.numbers
    lines = [*recording.heading.lines_above, *recording.lines_of_all_tests]
    has_unit = recording.layout.force_unit is not None or unit_of_all_loads("force_N", lines)
    if is_stated or has_unit:
        return None
    for statement in recording.statements.get("force_N", ())[:1]:
        if not statement.unit:
            return abs(statement.value)
    return None


def _is_distance(recording: Recording) -> bool:
    """Return whether readings without a unit are taken as distances between the balls in mm.

    This is the case if their median is near the radius of the circle in mm.
    """
    median = float(np.median(recording.numbers["reading"]))
    return abs(median / recording.radius_mm - 1.0) < _NEAR_RADIUS


def _may_be_distance(recording: Recording) -> bool:
    """Return whether readings scatter so little that they may be distances between the balls."""
    readings = recording.numbers["reading"]
    median = float(np.median(readings))
    scatter = float(np.median(np.abs(readings - median)))
    return scatter < _SMALL_SCATTER * abs(median)


def _assume_reading_unit(recordings: Sequence[Recording], campaign: Mapping[str, Any]) -> None:
    """Assume the unit of the readings, µm or mm, if only one of the two units is possible.

    The unit is recorded with its reason. Raise an `OpenQuestionError` if both units or none are
    possible, if a line mentions a scale or another unit, or if the readings may be distances
    between the balls. If all readings are zero, no unit is assumed.
    """
    size = _size_of_readings(recordings, campaign)
    if size.largest == 0.0:
        return
    fitting = [unit for unit in _USUAL_UNITS if _fits_unit(size, UNITS["reading"][unit])]
    for line, text in recordings[0].heading.lines_above:
        if mentions_scale(text):
            raise OpenQuestionError(
                f"{recordings[0].place}: readings must have a unit, got none, and"
                f" {text.strip()[:TEXT_SHOWN]!r} in line {line}. Say which: --unit.",
                "reading_unit",
                list(UNITS["reading"]),
            )
    if all(_may_be_distance(recording) for recording in recordings):
        raise OpenQuestionError(
            f"{recordings[0].place}: readings must have a unit, got none, and numbers up to"
            f" {size.largest:.4g} that hardly differ, as distances of the balls. Say which:"
            " --unit.",
            "reading_unit",
            list(UNITS["reading"]),
        )
    if len(fitting) != 1:
        softness = [f"{_um_per_N(size, unit):.2g} µm/N in {unit}" for unit in _USUAL_UNITS]
        raise OpenQuestionError(
            f"{recordings[0].place}: readings must have a unit, got none, and numbers up to"
            f" {size.largest:.4g}: {' or '.join(softness)}. Say which: --unit.",
            "reading_unit",
            list(UNITS["reading"]),
        )
    reason = f"numbers up to {size.largest:.4g} fit this unit"
    for recording in recordings:
        source = _check_mentions(recording, fitting[0])
        if source:
            recording.assumed_units["reading"] = AssumedUnit(fitting[0], source)
            continue
        recording.assumed_units["reading"] = AssumedUnit(fitting[0], reason)


def _lines_about_test(recording: Recording) -> Lines:
    """Return the lines above the table of a test, and the lines that apply to all tests.

    The latter are the lines of sheets without a table.
    """
    return [*recording.lines_of_all_tests, *recording.heading.lines_above]


def _check_factors(recording: Recording) -> None:
    """Raise an error if a header or a line says that readings are multiplied by a number.

    A text that says that readings are doubled, and may mean diameters, raises no error here. A line
    with the gain of an amplifier does, because the readings may still contain it. If the header
    states a unit, but a line mentions a scale or another unit, this line is noted. Nothing is
    checked if the user states the unit of the readings.
    """
    if "reading" not in recording.numbers or recording.layout.reading_unit is not None:
        return
    column = recording.heading.roles["reading"]
    header = recording.heading.headers[column]
    unit = recording.heading.units[column]
    if _has_unread_factor(header, unit):
        raise _unread_factor(recording, f"the header {header[:TEXT_SHOWN]!r}")
    for line, content in _lines_about_test(recording):
        text = content.strip()[:TEXT_SHOWN]
        is_multiplied = multiplies_readings(content) and not doubles_readings(content)
        if is_multiplied or (unit and states_gain(content)):
            raise _unread_factor(recording, f"{text!r} in line {line}")
        if unit and (mentions_scale(content) or _mentions_other(line, content, unit)):
            reason = quoted_line(line, content, "not used", TEXT_SHOWN)
            recording.note("unit of the reading", unit, reason, "--unit")


def _has_unread_factor(header: str, unit: str) -> bool:
    """Return whether a header says that its readings are multiplied by a number.

    The number may be a fraction of a unit that the header does not name, as in ``Error,
    millionths``. ``unit`` is the unit that the header states; empty if it states none.
    """
    if not unit and SHARE.search(header):
        return True
    # A factor inside the unit, as in "10 µm", is not examined here, because the function that reads
    # units raises an error for it.
    is_unit_plain = re.search(r"\d", unit) is None
    return is_unit_plain and header_has_factor(header) and not may_be_diameter(header)


def _unread_factor(recording: Recording, shown: str) -> OpenQuestionError:
    """Return the error for a header or line that says that readings are multiplied by a number.

    ``shown`` says what was found, such as "the header 'Reading x10'".
    """
    return OpenQuestionError(
        f"{recording.place}: the unit of readings must be known, got {shown}. Say which unit the"
        " numbers in the file have: --unit (a tenth of a micrometre: --unit '0.1 um').",
        "reading_unit",
        list(UNITS["reading"]),
    )


def _mentions_other(line: int | str, text: str, unit: str) -> bool:
    """Return whether a line mentions a unit of readings that differs from ``unit``.

    The result is always False for a line that states a property of the test, such as its radius.
    """
    if statements_in([(line, text)]):
        return False
    return unit_mentioned(text) not in ("", unit)


def _check_mentions(recording: Recording, unit: str) -> str | CitedLine:
    """Return a note on a line or name that mentions ``unit``, the unit that fits the readings.

    Lines outside the table of readings are searched, as are the names of the test, its sheet and
    its file. Lines that state a property of the test, such as its radius, are left out, because
    their units are not those of the readings. The note is empty if no line or name mentions
    ``unit``. Raise an `OpenQuestionError` if a line or name mentions another
    unit of readings, or if a name mentions counts or a unit with a factor, such as 0.1um.
    """
    note: str | CitedLine = ""
    mentions: list[tuple[str | CitedLine, str]] = []
    for line, text in _lines_on_units(recording):
        if not statements_in([(line, text)]):
            mentions.append((cited_line(line), text))
    mentions += [("its name", name) for name in recording.names_of_files()]
    for source, text in mentions:
        mentioned = unit_mentioned(text)
        if isinstance(source, CitedLine):
            mentioned = mentioned or inch_alone(text) or unknown_unit_in(text)
            mentioned = mentioned or _other_fraction(text, unit)
        if mentioned == unit:
            note = with_words(source, f" says {text.strip()[:TEXT_SHOWN]!r}")
        if not isinstance(source, CitedLine) and _COUNTS_OR_SCALED_UNIT.search(text):
            mentioned = text
        if mentioned not in ("", unit):
            raise OpenQuestionError(
                f"{recording.place}: readings must have a unit, got none, numbers that fit {unit},"
                f" and {text.strip()[:TEXT_SHOWN]!r} in {source}. Say which: --unit.",
                "reading_unit",
                list(UNITS["reading"]),
            )
    return note


def _lines_on_units(recording: Recording) -> Lines:
    """Return the lines outside the table that may mention the unit of the readings.

    A line below the table is returned only if it names a fraction of a unit, such as tenths of a
    µm, because other lines there may hold results.
    """
    lines = [*_lines_about_test(recording), *recording.lines_beside]
    lines += [(line, text) for line, text in recording.lines_below if shares_mentioned(text)]
    return lines


def _other_fraction(text: str, unit: str) -> str:
    """Return a fraction of a unit, such as 0.0001 inch, that may be the unit of the readings.

    ``text`` is a line of the file, and ``unit`` is the unit that is assumed for the readings. The
    result is empty if the line is not about readings, if it mentions no fraction of a unit, or if
    the fraction equals ``unit``. For example, 0.001 mm equals um.
    """
    fraction = fraction_mentioned(text)
    size = size_of_unit("reading", fraction)
    if size is None or math.isclose(size, UNITS["reading"][unit], rel_tol=1e-9):
        return ""
    return fraction


def _um_per_N(size: _ReadingSize, unit: str) -> float:
    """Return the change of the readings per newton [µm/N], for readings in the unit ``unit``.

    If the readings do not change with the force, or if all tests have the same force, return the
    largest reading divided by the largest force. ``size`` states how large the readings are in
    their unknown unit.
    """
    lightest, heaviest = size.forces_N
    if size.change > 0.0 and heaviest > lightest:
        return size.change * UNITS["reading"][unit] / (heaviest - lightest)
    return size.largest * UNITS["reading"][unit] / heaviest


def _size_of_readings(recordings: Sequence[Recording], campaign: Mapping[str, Any]) -> _ReadingSize:
    """Return how large the readings of all tests are, and how much they change with the force."""
    law = campaign.get("force_law") or ForceLaw()
    forces = []
    medians = []
    largest = 0.0
    for recording in recordings:
        readings = recording.numbers["reading"]
        force = recording.fields.get("force_N")
        if force is None:
            force = law.force_N(recording.fields["pressure_bar"])
        forces.append(float(force))
        medians.append(float(np.median(readings)))
        largest = max(largest, float(np.abs(readings).max()))
    lightest = int(np.argmin(forces))
    heaviest = int(np.argmax(forces))
    change = abs(medians[heaviest] - medians[lightest])
    return _ReadingSize(largest, change, (forces[lightest], forces[heaviest]))


def _fits_unit(size: _ReadingSize, um_per_unit: float) -> bool:
    """Return whether the readings can be in a unit that is ``um_per_unit`` micrometres long.

    ``size`` states how large the readings are in their unknown unit.
    """
    lightest, heaviest = size.forces_N
    largest_um = size.largest * um_per_unit
    if largest_um > _LARGEST_DEVIATION_UM or largest_um < _STIFFEST_UM_PER_N * heaviest:
        return False
    return size.change * um_per_unit <= _SOFTEST_UM_PER_N * max(heaviest - lightest, 1.0)


def _assume_angle_unit(recordings: Sequence[Recording]) -> None:
    """Assume degrees or radians for the angles, depending on the range that the angles span.

    The unit is recorded with its reason. Raise an `OpenQuestionError` if some tests seem to have
    degrees and others radians, or if the angles of the first test may have another unit, such as
    gon.
    """
    spans = {}
    for recording in recordings:
        spans[recording.place] = float(np.ptp(recording.numbers["angle"]))
    units = {place: _angle_unit_of_span(span) for place, span in spans.items()}
    other = _other_turn(recordings[0])
    if len(set(units.values())) > 1 or other:
        candidates = list(dict.fromkeys([*units.values(), *other]))
        place = recordings[0].place
        raise OpenQuestionError(
            f"{place}: angles must have a unit, got none, and they span {min(spans.values()):.4g}"
            f" to {max(spans.values()):.4g}, which may be {' or '.join(candidates)}. Say which:"
            " --angle-unit.",
            "angle_unit",
            candidates,
        )
    for recording in recordings:
        span = spans[recording.place]
        unit = units[recording.place]
        recording.assumed_units["angle"] = AssumedUnit(unit, f"it spans {span:.4g}")


def _angle_unit_of_span(span: float) -> str:
    """Return "deg" if the range of a test's angles is too large for radians, and "rad" otherwise.

    ``span`` is the range of the angles, in their unknown unit.
    """
    return "deg" if span > _LARGEST_SPAN_RAD else "rad"


def _other_turn(recording: Recording) -> list[str]:
    """Return the units, such as gon, in which the angles of a test cover a whole turn.

    Degrees and radians are not considered. The list is empty if the angles cover a whole turn in
    none of the units, if there are fewer than two angles, or if the angles cover whole turns in
    degrees, in steps of at most 45°.
    """
    angles = recording.numbers["angle"]
    if len(angles) < 2:
        return []
    step = float(np.median(np.abs(np.diff(angles))))
    covered = float(np.ptp(angles)) + step
    n_turns = round(covered / _TURN_DEG)
    covers_turns = abs(covered - n_turns * _TURN_DEG) <= _STEPS_OF_TURN * step
    if covers_turns and step <= _LARGEST_STEP_DEG:
        return []
    units = []
    for unit, turn in _OTHER_TURNS.items():
        if abs(covered - turn) <= _STEPS_OF_TURN * step:
            units.append(unit)
    return units
