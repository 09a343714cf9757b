"""Radii that no bar has, such as the 0.1 of ``Radius: 0.1``, which may be in metres."""

from __future__ import annotations

import re
from collections.abc import Iterable

from ldbb_bayes.errors import InputError
from ldbb_bayes.reading.words import LONGEST_TEXT

__all__ = ["check_radius_is_possible", "check_unit_of_radius"]

# Smallest and largest radius of a circle that a ball bar measures, with a wide margin [mm].
# Regular expression for a radius in a unit of length that is not read.
_IN_OTHER_UNIT = re.compile(
    r"\b(?:radius|rayon|raggio|radio|raio)\W{1,4}\d[\d.,]*[\s;,|]*(?:ft|feet|foot|dm|yd|km)\b",
    re.IGNORECASE,
)
_SMALLEST_MM = 10.0
_LARGEST_MM = 5000.0


def check_unit_of_radius(place: str, lines: Iterable[tuple[int | str, str]]) -> None:
    """Raise an error if a line states the radius in a unit of length that is not read, such as ft.

    Parameters
    ----------
    place
        Name of the test in the error message.
    lines
        Line number and text of each line above the table.

    Raises
    ------
    InputError
        If there is such a line.
    """
    for line, content in lines:
        match = _IN_OTHER_UNIT.search(content[:LONGEST_TEXT])
        if match is not None:
            raise InputError(
                f"{place}: the radius must be in mm, cm, m or inch, got {match[0]!r} in line"
                f" {line}. Write it in mm, or give --radius-mm."
            )


def check_radius_is_possible(place: str, radius_mm: float | None) -> None:
    """Raise an error if no bar measures a circle of the radius that a file states.

    Parameters
    ----------
    place
        Name of the test in the error message.
    radius_mm
        Radius of the circle [mm]; None if the file states none.

    Raises
    ------
    InputError
        If the radius is below 10 mm or above 5 m.
    """
    if radius_mm is None or _SMALLEST_MM <= radius_mm <= _LARGEST_MM:
        return
    raise InputError(
        f"{place}: the radius must be {_SMALLEST_MM:g} to {_LARGEST_MM:g} mm, got {radius_mm:g} mm"
        " in the file. Write its unit into the file, or give --radius-mm."
    )
