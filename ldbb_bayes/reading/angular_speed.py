"""Angular speed of a log over time, from a line such as ``Angular speed: 6.4 deg/s``."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from ldbb_bayes.reading.cited_lines import CitedLine, cited_line
from ldbb_bayes.reading.numerals import NUMBER_IN_TEXT, number_in_text
from ldbb_bayes.reading.recording import Recording
from ldbb_bayes.reading.words import LONGEST_TEXT, WORDS

__all__ = ["feed_of_angular_speed"]

# Size of each unit of angular speed in radians per minute.
_RAD_PER_MIN = {
    "deg/s": math.radians(60.0),
    "deg/sec": math.radians(60.0),
    "°/s": math.radians(60.0),
    "deg/min": math.radians(1.0),
    "°/min": math.radians(1.0),
    "rad/s": 60.0,
    "rpm": 2.0 * math.pi,
    "rev/min": 2.0 * math.pi,
    "1/min": 2.0 * math.pi,
    "u/min": 2.0 * math.pi,
}
_UNITS = "|".join(re.escape(unit) for unit in _RAD_PER_MIN)
# Regular expression for a line that states the angular speed, with its unit before or after the
# number.
_ANGULAR_SPEED = re.compile(
    rf"\W*(?:{WORDS['angular_speed']['words']})\s*(?:[\[(](?P<before>{_UNITS})[\])])?"
    rf"\s*[:=;,\t]?\s*(?P<number>{NUMBER_IN_TEXT})\s*[;,\t]?\s*(?P<behind>{_UNITS})?\W*",
    re.IGNORECASE,
)


def feed_of_angular_speed(recording: Recording) -> float | None:
    """Return the feed along the circle [mm/min] that a stated angular speed means, or None.

    The feed is the angular speed times the radius. It is noted. Lines that state different speeds
    count as none.

    Parameters
    ----------
    recording
        Rows of the test in the file, and everything that the file or the user states about the
        test.
    """
    lines = [*recording.heading.lines_above, *recording.lines_of_all_tests]
    speeds = _speeds_in(lines)
    if len({speed for speed, _ in speeds}) != 1:
        return None
    rad_per_min, source = speeds[0]
    feed = rad_per_min * float(recording.radius_mm)
    recording.note("feed", f"{feed:.5g} mm/min", source, "--feed-mm-per-min")
    return feed


def _speeds_in(lines: Sequence[tuple[int | str, str]]) -> list[tuple[float, CitedLine]]:
    """Return the angular speeds [rad/min] that lines state, each with its line."""
    speeds = []
    for line, content in lines:
        match = _ANGULAR_SPEED.fullmatch(content[:LONGEST_TEXT])
        if match is None:
            continue
        unit = match["behind"] or match["before"]
        number = number_in_text(match["number"])
        if unit and number is not None and number > 0.0:
            speeds.append((number * _RAD_PER_MIN[unit.lower()], cited_line(line)))
    return speeds
