"""Functions that find the parts of a line that the import does not use although it uses others.

In the line ``Force 238 N; e = L0 - L``, the import takes the force from the first segment, but
nothing from the second.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence

from ldbb_bayes.reading.angle_convention import states_angles, states_zero
from ldbb_bayes.reading.circle_centre import without_centre
from ldbb_bayes.reading.line_parts import finer_divisions, segments_of_line
from ldbb_bayes.reading.lines_above import is_label, statements_in
from ldbb_bayes.reading.mount_statement import mount_state
from ldbb_bayes.reading.names import load_in_name
from ldbb_bayes.reading.numerals import is_missing
from ldbb_bayes.reading.reading_sign import (
    is_about_sign,
    leaves_difference_unread,
    names_sign_or_length,
)
from ldbb_bayes.reading.timestamps import stamps_in
from ldbb_bayes.reading.travel_direction import directions_stated, senses_in
from ldbb_bayes.reading.words import LONGEST_TEXT, WORDS, unit_named

__all__ = ["states_correction", "unused_segments"]

# A segment with fewer letters than this, such as a unit or the number of a page, is not shown in a
# note, unless it is an equation.
_FEWEST_LETTERS = 4
_LETTER = re.compile(r"[^\W\d_]")
# Regular expression for the word "in" before a unit, as in "in µm".
_IN = re.compile(r"(?:in|en)\s+", re.IGNORECASE)
# Regular expression for an equation between quantities, such as "e = L0 - L".
_EQUATION = re.compile(r"[^\W\d]\w*\s*=\s*[+\-−(]*[^\W\d]")
# Regular expression for words which show that readings must be corrected by a number.
_CORRECTION = re.compile(rf"(?<![^\W_])(?:{WORDS['corrections']['words']})", re.IGNORECASE)


def states_correction(text: str) -> bool:
    """Return whether a text may say that readings must be corrected, as in ``Preset: 10 um``."""
    text = text[:LONGEST_TEXT]
    return _CORRECTION.search(text) is not None and not mount_state(text)


def unused_segments(text: str, quoted: Collection[str]) -> str:
    """Return the unused segments of a line, as they stand in it.

    A segment is unused if nothing was taken from it. Centres of circles are left out, because
    another note shows them.

    Parameters
    ----------
    text
        A line of which at least one segment was used.
    quoted
        Parts of the line that notes already quote. A segment that a note quotes by itself is left
        out. If a note quotes the whole line, only the segments that state a load are left out.
    """
    segments = segments_of_line(without_centre(text[:LONGEST_TEXT]))
    # At least one segment was used. If the line has only one, nothing is therefore left to return,
    # with two exceptions. The segment may have several parts, some of which are unused. Or it may
    # define the readings as a difference whose sign was not understood, as in "Force 238 N nominal
    # minus measured".
    has_parts = len(next(finer_divisions(text))) > 1
    if len(segments) == 1 and not has_parts and not leaves_difference_unread(text):
        return ""
    unused = []
    for k, segment in enumerate(segments):
        if _is_label_of_next(segments, k, text) and _is_used(segments, k + 1, text):
            continue
        if not _may_matter(segment) or _is_quoted(segment, text, quoted):
            continue
        if _is_used(segments, k, text) and not (_defines(segment) and states_correction(segment)):
            unused += _unused_parts(segment, quoted)
        else:
            unused.append(segment.strip())
    return _as_they_stand(text, unused)


def _is_quoted(segment: str, text: str, quoted: Collection[str]) -> bool:
    """Return whether a note quotes a segment, or the whole line ``text`` if the segment is a load.

    ``quoted`` are the parts of the line that notes quote.
    """
    is_line_quoted = text.strip() in quoted
    return segment.strip() in quoted or (is_line_quoted and load_in_name([segment]) is not None)


def _is_label_of_next(pieces: Sequence[str], k: int, text: str) -> bool:
    """Return whether a piece of a line is the label of the next piece.

    A label ends with a colon, or it is a cell of one or two words at the beginning of a line with
    tabs, as in ``Encoder<tab>7200 pulses/rev``. ``k`` is the index of the piece among ``pieces``,
    into which the line ``text`` is divided.
    """
    if k + 1 == len(pieces):
        return False
    piece = pieces[k].strip()
    is_first_cell = k == 0 and text.lstrip().startswith(f"{piece}\t")
    is_short = len(piece.split()) <= 2 and not states_correction(piece)
    return piece.endswith((":", "=")) or (is_first_cell and is_short)


def _as_they_stand(text: str, parts: Sequence[str]) -> str:
    """Join parts of the line ``text``, in their order, by the marks that stand between them there.

    Parts with other words between them are joined by semicolons. In ``e = R - R0``, the minus sign
    between two parts is kept.
    """
    joined = ""
    end = 0
    for part in parts:
        start = text.find(part, end)
        between = text[end:start] if start >= 0 else ""
        is_next = start >= 0 and re.search(r"\w", between) is None
        if joined:
            joined += between if is_next else "; "
        joined += part
        end = max(start, end) + len(part)
    return joined


def _is_needed(parts: Sequence[str], k: int, segment: str) -> bool:
    """Return whether part k of a segment is used: without it, the segment would state less."""
    part = parts[k]
    remainder = " - ".join([*parts[:k], *parts[k + 1 :]])
    if is_about_sign(part) or _stated_facts(segment) != _stated_facts(remainder):
        return True
    # A label such as "Start time" tells what the time behind it is of.
    return stamps_in(segment) != stamps_in(remainder) or _is_label_of_next(parts, k, segment)


def _unused_parts(segment: str, quoted: Collection[str]) -> list[str]:
    """Return the unused parts of a segment if other parts of it were used.

    The segment is divided at dashes and slashes. In ``Force 36 N - gauge turned over``, the last
    part is unused. A part counts as used if the segment without it states fewer fields, such as the
    force, or another time, or if the part is about the sign of readings. ``quoted`` holds those
    parts of the line that notes already quote; they are left out. An equation with an unused part
    is returned as a whole, because its parts do not show what it means.
    """
    parts = next(finer_divisions(segment))
    unused = []
    for k, part in enumerate(parts):
        is_quoted = part.strip() in quoted
        if len(parts) == 1 or is_quoted or not _may_matter(part):
            continue
        if not _is_needed(parts, k, segment):
            unused.append(part.strip())
    if not unused or _EQUATION.search(segment) is None:
        return unused
    # An equation such as "deviation = measured - nominal" only states the sign of readings. With a
    # number, as in "2 x (measured - nominal)", it states more.
    only_states_sign = is_about_sign(segment) and re.search(r"\d", segment) is None
    return [] if only_states_sign else [segment.strip()]


def _defines(segment: str) -> bool:
    """Return whether a segment is an equation, such as ``true deviation = reading - preset``."""
    return re.search(r"[^\W\d]\s*=\s*[^\W\d].*\s[+\-−–]\s*[^\W\d]", segment) is not None


def _may_matter(segment: str) -> bool:
    """Return whether a segment of a line may contain information.

    A segment that is only a unit, a label, a placeholder for a missing value, or a few letters
    contains no information. An equation, such as ``e = L0 - L``, always does.
    """
    word = segment.strip(" \t:=#*\"'[]()")
    if _EQUATION.search(word):
        return True
    if len(_LETTER.findall(word)) < _FEWEST_LETTERS:
        return False
    return not (is_label(word) or is_missing(word) or unit_named(_IN.sub("", word, count=1)))


def _is_used(segments: list[str], k: int, text: str) -> bool:
    """Return whether a segment of a line was used, alone or together with a neighbouring segment.

    In ``Operator;Meier``, the two segments together state the operator. ``k`` is the index of the
    segment among the segments of the line ``text``. ``segments`` are all segments of the line.
    """
    segment = segments[k]
    if leaves_difference_unread(segment):
        return False
    if _stated_facts(segment) or is_about_sign(segment) or stamps_in(segment):
        return True
    if _continues_statement(segment, text):
        return True
    for first in (k - 1, k):
        pair = segments[max(first, 0) : first + 2]
        facts_of_pair = _stated_facts(";".join(pair))
        if len(pair) > 1 and facts_of_pair - _stated_facts(pair[0]) - _stated_facts(pair[1]):
            return True
    return False


def _continues_statement(segment: str, text: str) -> bool:
    """Return whether a segment is part of a statement that begins earlier in the line ``text``.

    In ``Angle from +Y, clockwise positive``, the second segment states the sense of the angles. In
    ``Operator: Meier, Huber``, the second segment is the second of two names.
    """
    if states_angles(text) and (senses_in(segment) or states_zero(segment)):
        return True
    if names_sign_or_length(segment) and is_about_sign(text):
        return True
    name = segment.strip()
    for statements in statements_in([(0, text)]).values():
        for statement in statements:
            if isinstance(statement.value, str) and name in statement.value:
                return True
    return False


def _stated_facts(text: str) -> set[str]:
    """Return the names of the fields that a text states, such as ``operator``.

    The result also contains the direction of travel (CW or CCW) if the text states it. It contains
    ``angle`` if the text states where angles begin or in which sense they run.
    """
    lines = [(0, text)]
    facts = set(statements_in(lines)) | directions_stated(lines)
    if states_angles(text):
        facts.add("angle")
    return facts
