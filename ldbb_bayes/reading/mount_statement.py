"""Statements on whether the deflection of the work ball's mount is still in the readings.

Readings that contain this deflection are called raw; other readings are compensated. An example is
the line ``Mount deflection not removed``, which means raw readings.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

from ldbb_bayes.errors import InputError
from ldbb_bayes.reading.cited_lines import TEXT_SHOWN, CitedLine, quoted_line
from ldbb_bayes.reading.line_parts import divide_line
from ldbb_bayes.reading.words import LONGEST_TEXT, WORDS

__all__ = ["check_mount_is_clear", "mount_state", "unread_mount"]

_WORDS = WORDS["mount_statement"]
# Regular expression for a word for the mount of the work ball.
_MOUNT = re.compile(_WORDS["mount"], re.IGNORECASE)
# Regular expression for words, such as "removed", which say that the deflection of the mount was
# removed from the readings.
_REMOVED = re.compile(_WORDS["removed"], re.IGNORECASE)
# Regular expression for words which say that the readings contain the deflection of the mount.
_CONTAINED = re.compile(_WORDS["contained"], re.IGNORECASE)
# Regular expression for a negation.
_NOT = re.compile(_WORDS["negation"], re.IGNORECASE)
# Regular expression for words such as "corrected", which may say whether the deflection of the
# mount was removed. If a statement with such a word and a word for the mount is not understood, an
# error is raised.
_DONE = re.compile(_WORDS["done"], re.IGNORECASE)
# Regular expression for words, such as "bending", that may denote the deflection of the ball's
# mount.
_DEFLECTION = re.compile(_WORDS["deflection"], re.IGNORECASE)
# Regular expression for words, such as "not" or "in the readings". Together with a word for the
# deflection, they may say whether the readings contain it.
_IN_READINGS = re.compile(_WORDS["in_readings"], re.IGNORECASE)
# Regular expression for words, such as "raw", which say that readings are uncorrected.
_RAW = re.compile(_WORDS["raw"], re.IGNORECASE)
# Regular expression for words, such as "the" and "readings", which do not change the meaning of a
# statement about the mount.
_BESIDE = re.compile(_WORDS["beside"], re.IGNORECASE)


def mount_state(statement: str) -> str:
    """Return "raw" or "compensated" if a statement says that the readings are raw or compensated.

    Raw readings contain the deflection of the work ball's mount; compensated readings do not. The
    result is empty for any other statement. It is also empty for a statement with unknown words,
    because such a statement may be about another correction.
    """
    if _MOUNT.search(statement) is None:
        return ""
    removed = _REMOVED.findall(statement)
    contained = _CONTAINED.findall(statement)
    negations = _NOT.findall(statement)
    if len(removed) + len(contained) != 1 or len(negations) > 1:
        return ""
    remaining = statement
    for words in (_REMOVED, _CONTAINED, _NOT, _MOUNT, _BESIDE):
        remaining = words.sub(" ", remaining)
    if re.search(r"\w", remaining):
        return ""
    is_removed = bool(removed) != bool(negations)
    return "compensated" if is_removed else "raw"


def check_mount_is_clear(place: str, lines: Iterable[tuple[int | str, str]]) -> None:
    """Raise an `InputError` if it is unclear whether readings contain the mount's deflection.

    Lines about the deflection of the work ball's mount are checked.

    Parameters
    ----------
    place
        Name of the table in the error message.
    lines
        Line number and text of each line. For a line of another sheet, the line number is replaced
        by a text such as "3 of notes.txt".
    """
    for line, text in lines:
        for statement in divide_line(text[:LONGEST_TEXT]):
            if _is_ambiguous(statement):
                raise InputError(
                    f"{place}: whether the readings contain the deflection of the ball's mount"
                    f" must be clear, got {statement.strip()[:TEXT_SHOWN]!r} in line {line}. Give"
                    " --raw if they do, or --mount-um-per-bar (µm per bar) if they are compensated"
                    " for it."
                )


def unread_mount(lines: Iterable[tuple[int | str, str]]) -> CitedLine | None:
    """Return a note that quotes the first unclear statement about the deflection of the mount.

    A statement is a part of a line, such as ``Mount deflection 2.33 µm/bar``. The mount is that of
    the work ball. A statement is unclear if it mentions the deflection of the mount, or raw data,
    but does not say in known words whether the readings contain the deflection. Return None if
    there is no such statement, or if an earlier statement is clear. ``lines`` holds the number and
    the text of each line; the number may be a text that also names the sheet.
    """
    for line, text in lines:
        for statement in divide_line(text[:LONGEST_TEXT]):
            if mount_state(statement):
                return None
            is_of_mount = _MOUNT.search(statement) and _DEFLECTION.search(statement)
            if is_of_mount or _RAW.search(statement):
                return quoted_line(line, statement, "not understood", TEXT_SHOWN)
    return None


def _is_ambiguous(statement: str) -> bool:
    """Return whether a statement is about the mount's deflection, but is not understood."""
    if _MOUNT.search(statement) is None or mount_state(statement):
        return False
    if _DONE.search(statement):
        return True
    return bool(_DEFLECTION.search(statement) and _IN_READINGS.search(statement))
