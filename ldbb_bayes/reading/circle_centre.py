"""Centre of the circle that a line states, such as ``centre X300 Y-120``: told, and not used.

A campaign states centres in machine coordinates. Lines in files often state them in the coordinates
of a programme or of a workpiece, and do not say in which.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

from ldbb_bayes.campaign.circular_test import CENTRE
from ldbb_bayes.reading.numerals import NUMBER_IN_TEXT
from ldbb_bayes.reading.recording import Recording
from ldbb_bayes.reading.words import LONGEST_TEXT, WORDS

__all__ = ["note_centres"]

# Regular expression for one coordinate, such as X300 or Y = -120 mm.
_COORDINATE = rf"[XYZ]\s?[:=]?\s?{NUMBER_IN_TEXT}"
# Regular expression for a word for the centre, followed by at least two of its coordinates. The
# letters of the axes may be missing if the numbers follow a colon, as in "Centre: 300, -120".
_CENTRE = re.compile(
    rf"(?<!\w)(?:{WORDS['circle']['centre']})(?!\w)(?:[^;|\t]*?(?<!\w){_COORDINATE}(?:\s?mm)?"
    rf"[\s,;|/]*{_COORDINATE}|\s?[:=]\s?{NUMBER_IN_TEXT}(?:\s?mm)?[\s,;|/]+{NUMBER_IN_TEXT})",
    re.IGNORECASE,
)
# A note shows at most this number of characters of a line.
_TEXT_SHOWN = 60


def note_centres(recordings: Iterable[Recording]) -> None:
    """Add a note on each line that states a centre, for each test whose centre nothing else states.

    The centre of these tests is taken at the zero of the machine.
    """
    for recording in recordings:
        stated = recording.stated | recording.fields
        if any(stated.get(key) is not None for key in CENTRE):
            continue
        for line, text in (*recording.lines_of_all_tests, *recording.heading.lines_above):
            centre = _CENTRE.search(text[:LONGEST_TEXT])
            if centre is not None:
                shown = centre[0].strip()[:_TEXT_SHOWN]
                reason = f"line {line} says {shown!r}, perhaps not in machine coordinates"
                recording.note("centre", "X 0, Y 0, Z 0 mm", reason, "a [[test]] in --layout")
