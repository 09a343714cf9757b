"""Functions that find the start of a circle and check the feed, for tables without angles.

Such a table holds times instead of angles. The lines above it may state where the circle starts.
They may also state a feed override, which reduces or increases the programmed feed.
"""

from __future__ import annotations

import math
import re

from ldbb_bayes.errors import InputError
from ldbb_bayes.reading.angle_convention import angle_of_axis, says_where_angles_begin
from ldbb_bayes.reading.cited_lines import TEXT_SHOWN, CitedLine, cited_line, quoted_line
from ldbb_bayes.reading.programmed_circles import ProgrammedArc, programmed_arcs
from ldbb_bayes.reading.recording import Recording
from ldbb_bayes.reading.words import LONGEST_TEXT, WORDS

__all__ = ["check_feed_is_whole", "start_at_axis", "start_of_programme", "unread_run_in"]

# Regular expression for a line that says at which axis a circle starts, such as "Start point: Y+".
_START = re.compile(
    rf"(?:{WORDS['angle_convention']['start']})[^XYZ+\-−]*(?P<sign>[+\-−]?)(?P<axis>[XYZ])"
    r"(?P<behind>[+\-−]?)(?!\w|\s*[:=]?\s*[+\-−]?\d)",
    re.IGNORECASE,
)
# Regular expression for a line that says at which coordinates a circle starts.
_COORDINATES = re.compile(
    rf"(?:{WORDS['angle_convention']['start']}).*?(?<![A-Za-z])[XYZ]\s*[:=]?\s*[+\-−]?\d",
    re.IGNORECASE,
)
# Regular expression for a line that says at which hour of a clock face, or towards which side, a
# circle starts.
_NO_AXIS = re.compile(
    rf"(?:{WORDS['angle_convention']['start']}).*?(?:{WORDS['angle_convention']['start_no_axis']})",
    re.IGNORECASE,
)
# Regular expression for a line with a number and a word for a run-in before the circle or a run-out
# after it.
_RUN_IN = re.compile(rf"(?:{WORDS['angle_convention']['run_in']})\D*\d", re.IGNORECASE)
# Regular expression for a feed that is stated as a percentage, such as "feed override 50 %".
_SHARE = re.compile(
    r"(?:override|feed|vorschub|avance|avanzamento)\w*\D*(?:.*\D)?(?P<percent>\d+(?:[.,]\d+)?)\s?%",
    re.IGNORECASE,
)
_WHOLE_PERCENT = 100.0
# An arc in a programme is the circle of a test, and not a path to it or from it, if its radius
# differs from that of the test by at most this fraction.
_SAME_RADIUS = 1e-3
# Two starts of a circle agree if they differ by at most this angle [deg].
_SAME_START_DEG = 0.01
# The start of a circle lies in the plane of the test if its coordinate along the third axis,
# divided by the radius, is at most this value.
_IN_PLANE = 1e-6


def check_feed_is_whole(recording: Recording) -> None:
    """Raise an `InputError` if a line gives the feed as a percentage other than 100 %.

    An example is ``Feed 50 %``. The lines are those above the table and those of sheets without a
    table. No error is raised if the user states the feed, or if the table holds angles.
    ``recording`` holds the rows of the test in its file, and everything that the file or the user
    states about the test.
    """
    if recording.stated_value("feed_mm_per_min") is not None or "angle" in recording.numbers:
        return
    for line, content in (*recording.lines_of_all_tests, *recording.heading.lines_above):
        match = _SHARE.search(content[:LONGEST_TEXT])
        if match and float(match["percent"].replace(",", ".")) != _WHOLE_PERCENT:
            raise InputError(
                f"{recording.place}: the feed must be that of the machine, got"
                f" {content.strip()[:TEXT_SHOWN]!r} in line {line}. Give --feed-mm-per-min."
            )


def unread_run_in(recording: Recording) -> CitedLine | None:
    """Return a note on the first line that may state a run-in; None if there is no such line.

    A run-in is the path before the circle. The line ``Overlap 45 deg`` may state a run-in: it does
    not say whether the overlap lies before or after the circle. The lines above the table, and
    those of sheets without a table, are examined. ``recording`` holds the rows of the test in its
    file, and everything that the file or the user states about the test.
    """
    for line, content in (*recording.lines_of_all_tests, *recording.heading.lines_above):
        if _RUN_IN.search(content[:LONGEST_TEXT]):
            return quoted_line(line, content, "not understood", TEXT_SHOWN)
    return None


def start_at_axis(recording: Recording, plane: str) -> float | None:
    """Return the angle [deg] of the axis at which a circle starts; None if no line names an axis.

    The lines are those of sheets without a table and those above the table.

    Parameters
    ----------
    recording
        Rows of the test in the file, and everything that the file or the user states about the
        test. The axis is added to the log of assumptions.
    plane
        Plane of the test, such as XY.

    Raises
    ------
    InputError
        If lines name different axes, if an axis lies outside the plane, or if a line states the
        starting point by its coordinates or by a word such as "north". The error is also raised if
        a line says that angles run clockwise or do not begin at +X, because a table with times
        holds no angles.
    """
    axes: dict[str, CitedLine] = {}
    for line, content in (*recording.lines_of_all_tests, *recording.heading.lines_above):
        text = content[:LONGEST_TEXT]
        match = _START.search(text)
        if match is not None:
            sign = "-" if {match["sign"], match["behind"]} & {"-", "−"} else "+"
            axes.setdefault(f"{sign}{match['axis'].upper()}", cited_line(line))
        elif _is_unclear(text):
            raise InputError(
                f"{recording.place}: a log over time must say where its circle starts, got"
                f" {text.strip()[:TEXT_SHOWN]!r} in line {line}. Give --start-deg and"
                " --direction."
            )
    if len(axes) > 1:
        raise InputError(
            f"{recording.place}: the start of the circle must be said once, got"
            f" {' and '.join(axes)}. Give --start-deg."
        )
    for axis, source in axes.items():
        angle = angle_of_axis(recording, axis, plane)
        recording.note("start_deg", f"{angle:g}°, {axis}", source, "--start-deg")
        return angle
    return None


def _is_unclear(text: str) -> bool:
    """Return whether a line says where a circle starts, but names no axis at which it starts."""
    is_place = _COORDINATES.search(text) is not None or _NO_AXIS.search(text) is not None
    return is_place or says_where_angles_begin(text)


def start_of_programme(recording: Recording, plane: str, direction: str | None) -> float | None:
    """Return the angle [deg] at which a programmed circle starts; None if no line programs one.

    Parameters
    ----------
    recording
        Rows of the test in the file, and everything that the file or the user states about the
        test. The start is added to the log of assumptions.
    plane
        Plane of the test, such as XY.
    direction
        Direction of travel of the test, CW or CCW; None if nothing states it.

    Raises
    ------
    InputError
        If the start of a circle does not follow from the programme, for example because the line
        states no centre. The error is also raised if a start lies outside the plane, or if lines
        program circles that start at different points.
    """
    starts: dict[float, ProgrammedArc] = {}
    for arc in _circles_in_programme(recording, direction):
        starts.setdefault(_start_in_plane(recording, arc, plane), arc)
    if not starts:
        return None
    if max(starts) - min(starts) > _SAME_START_DEG:
        angles = " and ".join(f"{angle:g}°" for angle in starts)
        raise InputError(
            f"{recording.place}: the start of the circle must be said once, got {angles}. Give"
            " --start-deg."
        )
    angle = min(starts)
    recording.note("start_deg", f"{angle:g}°", cited_line(starts[angle].line), "--start-deg")
    return angle


def _circles_in_programme(recording: Recording, direction: str | None) -> list[ProgrammedArc]:
    """Return those arcs of a programme that have the radius and the direction of the test.

    The programme stands above the table. If no line above the table is an arc or the word G2 or G3,
    the programme is taken from sheets without a table. Lines that are only the word G2 or G3 are
    left out of the result. If no arc has the radius of the test, all arcs in its direction are
    returned. ``direction`` is CW or CCW. If it is None, arcs in both directions are returned.
    ``recording`` holds the rows of the test in its file, and everything that the file or the user
    states about the test.
    """
    lines = recording.heading.lines_above
    arcs = []
    for arc in programmed_arcs(lines) or programmed_arcs(recording.lines_of_all_tests):
        if not arc.is_bare_word and direction in (None, arc.direction):
            arcs.append(arc)
    radius_mm = recording.radius_mm
    circles = []
    for arc in arcs:
        if abs((arc.radius_mm or 0.0) - radius_mm) <= _SAME_RADIUS * radius_mm:
            circles.append(arc)
    return circles or arcs


def _start_in_plane(recording: Recording, arc: ProgrammedArc, plane: str) -> float:
    """Return the angle at which an arc starts, counted from the first axis of the plane.

    The angle is at least 0 and below 360 [deg]. Raise an `InputError` if the start does not follow
    from the programme, or lies outside the plane. ``recording`` states the radius of the test.
    """
    start_mm = arc.start_mm or {}
    limit = _IN_PLANE * recording.radius_mm
    is_in_plane = all(
        axis in plane or abs(coordinate) <= limit for axis, coordinate in start_mm.items()
    )
    first = start_mm.get(plane[0], 0.0)
    second = start_mm.get(plane[1], 0.0)
    if not is_in_plane or math.hypot(first, second) <= limit:
        raise InputError(
            f"{recording.place}: a log over time must say where its circle starts, got"
            f" {arc.text.strip()[:TEXT_SHOWN]!r} in line {arc.line}. Give --start-deg."
        )
    return math.degrees(math.atan2(second, first)) % 360.0
