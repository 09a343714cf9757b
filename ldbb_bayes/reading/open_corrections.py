"""Lines which say that readings still have to be corrected.

An example is ``Calibration factor (not applied): 1.02``: all readings must be multiplied by 1.02.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

from ldbb_bayes.errors import InputError
from ldbb_bayes.reading.numerals import NUMBER_IN_TEXT
from ldbb_bayes.reading.words import LONGEST_TEXT, WORDS

__all__ = ["check_readings_are_corrected"]

_WORDS = WORDS["corrections"]
# Regular expression for a correction, such as "offset", with words which say that it is not made.
_OPEN_CORRECTION = re.compile(
    rf"(?:{_WORDS['corrected_by']}).*(?<![^\W_])(?:{_WORDS['not_made']})", re.IGNORECASE
)
# Regular expression for the number by which readings are to be corrected.
_NUMBER = re.compile(rf"(?<![^\W_]){NUMBER_IN_TEXT}")
# Regular expression for words which show that a correction is not one of the readings, such as
# "angle", or that it needs other options, such as "mount".
_OTHER_QUANTITY = re.compile(_WORDS["of_others"], re.IGNORECASE)
# An error message shows at most this number of characters of a line.
_LINE_SHOWN = 80


def check_readings_are_corrected(place: str, lines: Iterable[tuple[int | str, str]]) -> None:
    """Raise an `InputError` for a line with a number by which readings are still to be corrected.

    Parameters
    ----------
    place
        Name of the table in the error message.
    lines
        Line number and text of each line. For a line of another sheet, the line number is replaced
        by a text such as "3 of notes.txt".
    """
    for line, text in lines:
        if _leaves_correction_open(text[:LONGEST_TEXT]):
            raise InputError(
                f"{place}: readings must be corrected, got {text.strip()[:_LINE_SHOWN]!r} in line"
                f" {line}. Correct the readings by this number and remove the line; or remove the"
                " line if they are corrected."
            )


def _leaves_correction_open(text: str) -> bool:
    """Return whether a line states a correction of readings that is not made, with its number."""
    if _OPEN_CORRECTION.search(text) is None or _OTHER_QUANTITY.search(text):
        return False
    numbers = _NUMBER.findall(text)
    return any(number.strip("+-−0.,") != "" for number in numbers)
