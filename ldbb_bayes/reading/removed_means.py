"""Headers and lines which say that the mean of each circle was subtracted from its readings.

The growth of the circle with force, and with it the length of the bar, is then lost.
"""

from __future__ import annotations

import re

from ldbb_bayes.errors import InputError
from ldbb_bayes.reading.recording import Recording
from ldbb_bayes.reading.words import LONGEST_NAME, LONGEST_TEXT, WORDS

__all__ = ["check_mean_is_not_removed"]

_WORDS = WORDS["removed_means"]
# Regular expression for readings without their mean, such as "deviation from mean", in a header.
_IN_HEADER = re.compile(_WORDS["header"], re.IGNORECASE)
# Regular expression for a line which says that the mean was removed, such as "Mean removed".
_IN_LINE = re.compile(rf"\W*(?:{_WORDS['line']})\W*", re.IGNORECASE)


def check_mean_is_not_removed(recording: Recording) -> None:
    """Raise an `InputError` if the mean of the circle was removed from the readings of a test.

    Parameters
    ----------
    recording
        Rows of the test in the file, and everything that the file or the user states about the
        test. Nothing is checked if the user states that the readings are deviations from the
        nominal radius.
    """
    if recording.layout.zero is not None:
        return
    column = recording.heading.roles.get("reading")
    if column is None:
        return
    header = recording.heading.headers[column][:LONGEST_NAME]
    if _IN_HEADER.search(header):
        raise _no_mean(recording, header, recording.heading.line)
    for line, text in recording.lines_outside:
        if _IN_LINE.fullmatch(text[:LONGEST_TEXT]):
            raise _no_mean(recording, text, line)


def _no_mean(recording: Recording, text: str, line: int | str | None) -> InputError:
    """Return the error for readings without their mean. ``text`` in ``line`` says so."""
    return InputError(
        f"{recording.place}: readings must be deviations from the nominal radius, got"
        f" {text.strip()[:LONGEST_NAME]!r} in line {line}. Without its mean, a circle does not"
        " show how it grows with force. Export the readings themselves; or give --zero deviation"
        " if they contain the mean."
    )
