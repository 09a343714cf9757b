"""Division of a line about several subjects, such as angles and readings, into statements.

An example is the line ``Angles clockwise; run: CCW``.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator

__all__ = [
    "divide_line",
    "finer_divisions",
    "segments_of_line",
    "sentences_of_line",
    "statements_of_line",
]

# Regular expression for a mark that ends a sentence or a cell of a line.
_STRONG_MARK = re.compile(r"[;|\t]|\.(?=\s)")
# Regular expression for a mark between two statements of a line. A comma before a digit does not
# match, because it may be a decimal mark.
_ANY_MARK = re.compile(r"[;|\t]|\.(?=\s)|,(?!\d)")
# Regular expression for the marks or wide spaces between the segments of a line. Marks before a
# number are not matched, because the number may be the value of the words before it.
_SEGMENT_MARK = re.compile(rf"(?:{_ANY_MARK.pattern}|\s{{2,}})+(?!\W*\d)")
# Each of the next four regular expressions is for a mark that may divide two statements of a line:
# a dash or slash, a colon, a bracket, or a word such as "and". These marks often stand within a
# statement, too.
_DASH_OR_SLASH = r"\s[-–—/]\s"
_COLON = r":(?=\s)"
_BRACKET = r"[()\[\]]"
_AND = r"\s(?:and|und|et|y)\s"


def divide_line(text: str) -> list[str]:
    """Return the parts into which semicolons, ``|``, tabs, full stops and commas divide a line."""
    return _ANY_MARK.split(text)


def sentences_of_line(text: str) -> list[str]:
    """Return the parts into which semicolons, ``|``, tabs and full stops divide a line."""
    return _STRONG_MARK.split(text)


def finer_divisions(text: str) -> Iterator[list[str]]:
    """Yield the parts of a line seven times, each time divided at different marks.

    The line is always divided at the marks of `divide_line`. For the first list of parts, it is
    also divided at dashes and slashes between blanks, for the second at colons, for the third at
    brackets, and for the fourth at words such as "and". The last three lists combine dashes and
    slashes with colons, with brackets, or with words such as "and". There are several lists because
    each of these marks may also stand within a statement. In the line ``Force 36 N - positive: bar
    shorter``, the dash separates two statements, but the colon does not.
    """
    others = (_COLON, _BRACKET, _AND)
    for marks in (_DASH_OR_SLASH, *others):
        yield re.split(f"{_ANY_MARK.pattern}|{marks}", text)
    for marks in others:
        yield re.split(f"{_ANY_MARK.pattern}|{_DASH_OR_SLASH}|{marks}", text)


def segments_of_line(text: str) -> list[str]:
    """Divide a line into segments, which may be about different things.

    Segments are divided by semicolons, ``|``, tabs, full stops, commas, and two or more blanks. A
    number stays with the words before it: ``Force;238 N;travel CW`` has two segments.
    """
    return [segment for segment in _SEGMENT_MARK.split(text) if segment.strip()]


def statements_of_line(text: str, is_mixed: Callable[[str], bool]) -> Iterator[str]:
    """Yield the statements of a line. If possible, each statement is about one subject.

    A line about one subject is a single statement. A line about several subjects is divided at
    semicolons, ``|``, tabs and full stops. A part that is still about several subjects is also
    divided at commas.

    Parameters
    ----------
    text
        The line.
    is_mixed
        Function that returns whether a text is about several subjects.
    """
    if not is_mixed(text):
        yield text
        return
    for sentence in _STRONG_MARK.split(text):
        if is_mixed(sentence):
            yield from divide_line(sentence)
        else:
            yield sentence
