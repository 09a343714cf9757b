"""Words which change a statement about angles or about the direction of travel.

In ``Angles counter-clockwise from +X, seen from below``, the last words turn the sense around. In
``Angle from X less 30``, they move the angle zero. A statement with such words is not used as if
they were missing; the user is asked instead.
"""

from __future__ import annotations

import re

from ldbb_bayes.reading.words import LONGEST_TEXT, WORDS

__all__ = [
    "without_usual_view",
    "words_of_another_zero",
    "words_of_exception",
    "words_of_view",
]

_WORDS = WORDS["qualifications"]
# Regular expression for the usual view, from above, which changes nothing.
_USUAL_VIEW = re.compile(_WORDS["usual_view"], re.IGNORECASE)
# Regular expression for words for any view, such as "seen from".
_VIEW = re.compile(_WORDS["view"], re.IGNORECASE)
# Regular expression for words, such as "except", which limit a statement or deny it.
_EXCEPTION = re.compile(_WORDS["exception"], re.IGNORECASE)
# Regular expression for numbers that do not move the angle zero: the step, the unit and the range
# of angles, the angles 0 and 360, an offset of zero, and the angle at an axis, as in "90° = +Y".
_NO_SHIFT = re.compile(_WORDS["no_shift"], re.IGNORECASE)
# Regular expression for a number that is added to angles or subtracted from them, for an angle, and
# for words such as "offset".
_SHIFT = re.compile(_WORDS["shift"], re.IGNORECASE)


def without_usual_view(text: str) -> str:
    """Return a text without words for the view from above, such as ``seen from +Z``."""
    return _USUAL_VIEW.sub(" ", text[:LONGEST_TEXT])


def words_of_view(text: str) -> str:
    """Return the words of a text for a view other than from above; empty if there are none."""
    match = _VIEW.search(without_usual_view(text))
    return match[0].strip() if match else ""


def words_of_exception(text: str) -> str:
    """Return the word of a text, such as "except" or "not", that limits or denies what it states.

    The result is empty if there is no such word.
    """
    match = _EXCEPTION.search(text[:LONGEST_TEXT])
    return match[0].strip() if match else ""


def words_of_another_zero(text: str) -> str:
    """Return the words of a text that may move the angle zero, such as "30 deg" or "less 30".

    The result is empty if there are no such words.
    """
    match = _SHIFT.search(_NO_SHIFT.sub(" ", text[:LONGEST_TEXT]))
    return match[0].strip() if match else ""
