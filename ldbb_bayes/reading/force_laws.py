"""Lines that state the force law of the ball bar: its force as a function of its pressure.

An example is ``F = 118.5 N/bar * p - 9.0 N``.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

from ldbb_bayes.errors import InputError
from ldbb_bayes.reading.cited_lines import TEXT_SHOWN
from ldbb_bayes.reading.words import LONGEST_TEXT

__all__ = ["check_force_law", "states_force_law"]

_FORCE = r"(?:kN|daN|N|lbf|lbs?|kgf)"
_PRESSURE = r"(?:m?[bB]ar|[MkK]?Pa|psi)"
# Regular expression for a force per pressure, such as N/bar or N per bar.
_FORCE_PER_PRESSURE = re.compile(
    rf"(?<![^\W\d_]){_FORCE}[\])]?\s?(?:/|per|pro|je|par)\s?[\[(]?{_PRESSURE}(?!\w)"
    rf"|(?<![^\W\d_]){_FORCE}\s?[·*⋅.]?\s?{_PRESSURE}\s?(?:\^\s?\(?[-−]1|⁻¹)"
)
_NUMBER = r"\d+(?:[.,]\d+)?"
_PRESSURE_WORD = r"(?:p|P|pressure|Pressure|druck|Druck|pression|pressione)(?![^\W_]|\s?[:=])"
# Regular expression for a number times the pressure after an equals sign, as in
# "F = 118.5 * p - 9".
_TIMES_PRESSURE = re.compile(
    rf"=.*?(?:{_NUMBER}\s?(?:[*·×⋅x]\s?)?{_PRESSURE_WORD}"
    rf"|{_PRESSURE_WORD}\s?(?:[\[(]\w+[\])])?\s?[*·×⋅x]\s?{_NUMBER})"
)
# Regular expression for the force at a pressure of one unit, as in "1 bar = 118.5 N".
_FORCE_OF_ONE = re.compile(
    rf"(?<![\w.,])1(?:[.,]0+)?\s?{_PRESSURE}\s?"
    r"(?:=|≙|:|is|gives|corresponds?\sto|entspricht|ergibt)"
    rf"\s?{_NUMBER}\s?{_FORCE}(?!\w)"
)
# Regular expression for the name and the value of a constant of the force law: the slope, the
# offset or the area of the piston.
_NAMED_TERM = re.compile(
    rf"(?:\bforce[ -](?:slope|gain|factor|offset|constant|law)"
    rf"|\bkraft-?(?:steigung|faktor|offset|gesetz|konstante)"
    rf"|\b(?:piston|cylinder|kolben|zylinder)[ -]?(?:area|fläche)"
    rf"|=\s?A\s?[*·×⋅x]\s?p)\b.*?{_NUMBER}",
    re.IGNORECASE,
)
# Regular expressions for statements of a force law, or of a single constant of a force law.
_LAWS = (_FORCE_PER_PRESSURE, _TIMES_PRESSURE, _FORCE_OF_ONE, _NAMED_TERM)


def states_force_law(text: str) -> bool:
    """Return whether a line states a force law of the bar, such as ``F = 118.5 N/bar * p``."""
    beginning = text[:LONGEST_TEXT]
    return any(law.search(beginning) is not None for law in _LAWS)


def check_force_law(place: str, lines: Iterable[tuple[int | str, str]]) -> None:
    """Raise an `InputError` for a line that states the force as a function of the pressure.

    Such a line is not used. The user must state the force law with command-line options.

    Parameters
    ----------
    place
        Name of the table in the error message.
    lines
        Line number and text of each line. For a line of another sheet, the line number is replaced
        by a text such as "3 of notes.txt".
    """
    for line, text in lines:
        if states_force_law(text):
            raise InputError(
                f"{place}: the law of force and pressure must be given by options, got"
                f" {text.strip()[:TEXT_SHOWN]!r} in line {line}. Give it as --force-slope (N per"
                " bar) and --force-offset (N at zero pressure)."
            )
