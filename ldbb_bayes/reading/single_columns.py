"""Texts with a single column of numbers, whose angles follow from lines above the column."""

from __future__ import annotations

import re
from collections.abc import Sequence

from ldbb_bayes.campaign.circular_test import FEWEST_READINGS
from ldbb_bayes.reading.header_units import unit_of
from ldbb_bayes.reading.role_words import has_role
from ldbb_bayes.reading.stepped_angles import states_step

__all__ = ["is_single_column", "with_points_numbered"]

# Regular expression for a line that consists of one number.
_NUMBER = re.compile(r"[ \t]*[+\-−]?\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?[ \t\r]*")
# Regular expression for characters that separate the cells of a line.
_SEPARATORS = re.compile(r"[;,\t|]")


def with_points_numbered(text: str) -> str:
    """Return a text with a single column of readings, with a column of numbers 1, 2, … before it.

    The lines above the column must state the step of the angles, as in ``Angle step: -1°``. The
    two columns are separated by a semicolon, so that a decimal comma does not separate cells. Any
    other text is returned unchanged.
    """
    lines = text.split("\n")
    numbers = _lines_of_column(lines)
    if not numbers or not any(states_step(line) for line in lines[: numbers[0]]):
        return text
    header = max(k for k in range(numbers[0]) if lines[k].strip())
    lines[header] = f"Point;{lines[header]}"
    for number, k in enumerate(numbers, start=1):
        lines[k] = f"{number};{lines[k]}"
    return "\n".join(lines)


def is_single_column(lines: Sequence[str]) -> bool:
    """Return whether the lines of a text end with a single column of readings."""
    return bool(_lines_of_column(lines))


def _lines_of_column(lines: Sequence[str]) -> list[int]:
    """Return the indices of the lines that are a single column of readings.

    The column ends with the text, and the line above it must be a name of readings. The list is
    empty if there is no such column.
    """
    filled = [k for k, line in enumerate(lines) if line.strip()]
    numbers = [k for k in filled if _NUMBER.fullmatch(lines[k])]
    above = filled[: -len(numbers)]
    if len(numbers) < FEWEST_READINGS or filled[-len(numbers) :] != numbers or not above:
        return []
    header = lines[above[-1]]
    if _SEPARATORS.search(header) or not has_role(unit_of(header).name, "reading"):
        return []
    return numbers
