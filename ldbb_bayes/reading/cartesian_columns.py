"""Columns of positions along two axes, which some tables have instead of angles and readings."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from ldbb_bayes.machine.chain import PLANES
from ldbb_bayes.reading.header_units import unit_of
from ldbb_bayes.results import Array

__all__ = ["advice_on_positions", "lie_on_circle", "plane_of_positions", "position_headers"]

# Regular expression for the name of a column of positions along an axis, such as "X" or "Y actual".
# The group ``axis`` is the letter of the axis.
_POSITION = re.compile(
    r"(?:pos(?:ition)?|act(?:ual)?|nom(?:inal)?|cmd|coord(?:inate)?|axis|achse)?"
    r"[ _.\-]{0,2}(?P<axis>[XYZ])"
    r"(?:[ _.\-]{0,2}(?:pos\w*|act\w*|ist\w*|soll\w*|nom\w*|cmd|coord\w*|koord\w*|axis|achse))?",
    re.IGNORECASE,
)
# Positions lie on a circle about the origin if their distances from the origin differ by less than
# this fraction of the median distance.
_LARGEST_SCATTER = 0.02
# Positions are taken as points of a circle only if their median distance from the origin is at
# least this radius [mm].
_SMALLEST_RADIUS_MM = 20.0


def position_headers(headers: Sequence[str]) -> list[str]:
    """Return the headers that name a position along an axis, such as ``X [mm]``.

    The list is empty if there are fewer than two such headers.
    """
    found_headers = [header for header in headers if _POSITION.fullmatch(unit_of(header).name)]
    if len(found_headers) < 2:
        return []
    return found_headers


def lie_on_circle(x: Array, y: Array) -> bool:
    """Return whether positions lie on a circle about the origin and in all four quadrants.

    ``x`` and ``y`` are the positions along the two axes [mm], shape (n,) each.
    """
    radius = np.hypot(x, y)
    middle = float(np.median(radius))
    quadrants = np.unique(2 * (x > 0.0) + (y > 0.0))
    is_round = float(np.ptp(radius)) < _LARGEST_SCATTER * middle
    return middle > _SMALLEST_RADIUS_MM and is_round and len(quadrants) == 4


def plane_of_positions(headers: Sequence[str], stated_plane: str) -> str:
    """Return the plane of positions along two axes, such as ``ZX`` for the headers Z and X.

    If the headers do not name exactly two axes, the plane is ``stated_plane``.
    """
    axes = set()
    for header in headers:
        match = _POSITION.fullmatch(unit_of(header).name)
        if match is not None:
            axes.add(match["axis"].upper())
    for plane in PLANES:
        if set(plane) == axes:
            return plane
    return stated_plane


def advice_on_positions(plane: str, has_reading: bool) -> str:
    """Return the advice in the error message for a table that holds positions instead of angles.

    ``plane`` is the plane of the positions, such as ZX, in which angles count from +Z towards +X.
    ``has_reading`` states whether the table has a column of readings beside the positions.
    """
    first = plane[0]
    second = plane[1]
    advice = (
        f"Positions are not read: add a column 'angle [deg]', arctan2({second}, {first}) about the"
        " centre of the circle"
    )
    if not has_reading:
        advice += f", and a column 'reading [mm]', √({first}² + {second}²) less the radius"
    return f"{advice}."
