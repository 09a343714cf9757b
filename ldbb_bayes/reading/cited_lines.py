"""Reasons for assumptions that cite lines of files, such as "line 3 says 'R = 100 mm'"."""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["CitedLine", "cited_line", "quoted_line", "with_words"]


class CitedLine(NamedTuple):
    """Reason for an assumption that names or quotes a line, as in "line 3 says 'R = 100 mm'"."""

    reason: str  #: reason for an assumption in words, such as "line 3"
    #: number of the line that is the reason for an assumption; for a line of another sheet, a text
    #: such as "3 of notes.txt"
    line: int | str
    #: words that the reason for an assumption quotes from the line; empty if the reason only states
    #: the number of the line
    quoted: str = ""

    def __str__(self) -> str:
        """Return the reason for an assumption in words."""
        return self.reason


def cited_line(line: int | str) -> CitedLine:
    """Return a reason that names a line, such as "line 3"."""
    return CitedLine(f"line {line}", line)


def quoted_line(line: int | str, text: str, remark: str = "", longest: int = 60) -> CitedLine:
    """Return a reason that quotes a line: ``line 3 says 'Mode: diameter', not understood``.

    Parameters
    ----------
    line
        Line number, or a text such as "3 of notes.txt" for a line of another sheet.
    text
        Words of the line.
    remark
        Words after the quotation, such as "not understood".
    longest
        Largest number of characters of ``text`` that the reason shows.
    """
    reason = f"line {line} says {text.strip()[:longest]!r}"
    if remark:
        reason += f", {remark}"
    return CitedLine(reason, line, text.strip())


def with_words(reason: str | CitedLine, words: str) -> str | CitedLine:
    """Return the reason for an assumption with ``words`` added at its end.

    For example, "line 3" with the words " says 100 mm" becomes "line 3 says 100 mm".
    """
    if isinstance(reason, CitedLine):
        return reason._replace(reason=f"{reason}{words}")
    return f"{reason}{words}"
