"""Statements above a log over time: start of the circle, and reduced or increased feed.

A log over time is a table that holds times instead of angles.
"""

from __future__ import annotations

import re

from ldbb_bayes.errors import InputError
from ldbb_bayes.reading.angle_convention import angle_of_axis, says_where_angles_begin
from ldbb_bayes.reading.recording import Recording
from ldbb_bayes.reading.words import LONGEST_TEXT, WORDS

__all__ = ["check_feed_is_whole", "start_at_axis"]

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
# Regular expression for a feed that is stated as a percentage, such as "feed override 50 %".
_SHARE = re.compile(
    r"(?:override|feed|vorschub|avance|avanzamento)\w*\D*(?:.*\D)?(?P<percent>\d+(?:[.,]\d+)?)\s?%",
    re.IGNORECASE,
)
_WHOLE_PERCENT = 100.0
# An error message shows at most this number of characters of a text from a file.
_TEXT_SHOWN = 60


def check_feed_is_whole(recording: Recording) -> None:
    """Raise an error if a line states a feed or override other than 100 %, such as 50 %.

    No error is raised if the user states the feed, or if the table holds angles. ``recording``
    holds the rows of the test in its file, and all statements about the test.
    """
    if recording.stated_value("feed_mm_per_min") is not None or "angle" in recording.numbers:
        return
    for line, content in (*recording.lines_of_all_tests, *recording.heading.lines_above):
        match = _SHARE.search(content[:LONGEST_TEXT])
        if match and float(match["percent"].replace(",", ".")) != _WHOLE_PERCENT:
            raise InputError(
                f"{recording.place}: the feed must be that of the machine, got"
                f" {content.strip()[:_TEXT_SHOWN]!r} in line {line}. Give --feed-mm-per-min."
            )


def start_at_axis(recording: Recording, plane: str) -> float | None:
    """Return the angle [deg] of the axis at which a circle starts; None if no line names an axis.

    Parameters
    ----------
    recording
        Rows of the test in the file, and all statements about the test. The axis is added to the
        log of assumptions.
    plane
        Plane of the test, such as XY.

    Raises
    ------
    InputError
        If lines name different axes, if an axis lies outside the plane, or if a line states the
        coordinates of the starting point. The error is also raised if a line says that angles run
        clockwise or do not begin at +X, because a table with times holds no angles.
    """
    axes: dict[str, str] = {}
    for line, content in (*recording.lines_of_all_tests, *recording.heading.lines_above):
        text = content[:LONGEST_TEXT]
        match = _START.search(text)
        if match is not None:
            sign = "-" if {match["sign"], match["behind"]} & {"-", "−"} else "+"
            axes.setdefault(f"{sign}{match['axis'].upper()}", f"line {line}")
        elif says_where_angles_begin(text) or _COORDINATES.search(text):
            raise InputError(
                f"{recording.place}: a log over time must say where its circle starts, got"
                f" {text.strip()[:_TEXT_SHOWN]!r} in line {line}. Give --start-deg and"
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
