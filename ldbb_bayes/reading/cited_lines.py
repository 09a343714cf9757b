"""Texts that state the reason for an assumption by naming or quoting a line of a file.

An example is "line 3 says 'R = 100 mm'".
"""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["TEXT_SHOWN", "CitedLine", "cited_line", "quoted_line", "with_words"]

# A note or an error message shows at most this number of characters of a line or text of a file.
TEXT_SHOWN = 60
# Remarks on a line from which nothing was taken, although it may matter.
_UNREAD = ("not understood", "not used")


class CitedLine(NamedTuple):
    """Line of a file that is the reason for an assumption, as in "line 3 says 'R = 100 mm'"."""

    #: text that states why an assumption was made, by naming or quoting a line, such as "line 3"
    reason: str
    #: number of the line that is the reason for an assumption; for a line of another sheet, a text
    #: such as "3 of notes.txt"
    line: int | str
    #: words that the reason for an assumption quotes from the line; empty if the reason only states
    #: the number of the line
    quoted: str = ""
    #: whether the line was understood; False for a line that is told because nothing was taken
    #: from it
    is_understood: bool = True

    def __str__(self) -> str:
        """Return the text that states the reason for an assumption."""
        return self.reason


def cited_line(line: int | str) -> CitedLine:
    """Return a `CitedLine` that names the line on which an assumption is based, as in "line 3"."""
    return CitedLine(f"line {line}", line)


def quoted_line(line: int | str, text: str, remark: str = "", longest: int = 60) -> CitedLine:
    """Return a `CitedLine` that quotes the line on which an assumption is based.

    An example of its text is ``line 3 says 'Mode: diameter', not understood``.

    Parameters
    ----------
    line
        Line number, or a text such as "3 of notes.txt" for a line of another sheet.
    text
        Words of the line.
    remark
        Words after the quotation, such as "not understood".
    longest
        Largest number of characters of ``text`` that are quoted.
    """
    reason = f"line {line} says {text.strip()[:longest]!r}"
    if remark:
        reason += f", {remark}"
    return CitedLine(reason, line, text.strip(), is_understood=remark not in _UNREAD)


def with_words(reason: str | CitedLine, words: str) -> str | CitedLine:
    """Return the reason for an assumption with ``words`` added at its end.

    For example, "line 3" with the words " says 100 mm" becomes "line 3 says 100 mm".
    """
    if isinstance(reason, CitedLine):
        return reason._replace(reason=f"{reason}{words}")
    return f"{reason}{words}"
