"""Radius and direction of a circle that is programmed by G-code in lines above a table.

An example is the block ``G2 X100 Y0 I-100 J0``, a clockwise circle of radius 100 mm.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import NamedTuple

from ldbb_bayes.reading.words import LONGEST_TEXT

__all__ = ["ProgrammedArc", "programmed_arcs", "programs_arc"]

_NUMBER = r"[+\-]?(?:\d+\.?\d*|\.\d+)"
# Regular expression for the word that begins an arc, G2 or G3. It matches only if a word for an
# axis, the centre or the radius follows in the line.
_ARC = re.compile(
    r"(?<![A-Za-z\d])G0?(?P<sense>[23])(?![\d.])"
    rf"(?=.*?[^A-Za-z]?(?:[XYZIJK]\s?{_NUMBER}|C?R\s?=?\s?{_NUMBER}))",
    re.IGNORECASE,
)
# Regular expression for a line that is nothing but the word G2 or G3.
_WORD_OF_ARC = re.compile(r"\W*G0?(?P<sense>[23])\W*", re.IGNORECASE)
# Regular expression for a coordinate of the centre of an arc, counted from the start of the arc.
_CENTRE = re.compile(rf"(?<![A-Za-z])[IJK]\s?=?\s?(?P<number>{_NUMBER})", re.IGNORECASE)
# Regular expression for the radius of an arc.
_RADIUS = re.compile(rf"(?<![A-Za-z])C?R\s?=?\s?(?P<number>{_NUMBER})", re.IGNORECASE)
# Regular expression for the word G90.1, after which the coordinates of centres are counted from the
# zero point of the programme.
_ABSOLUTE_CENTRE = re.compile(r"(?<![A-Za-z\d])G90\.1(?!\d)", re.IGNORECASE)
# Regular expression for the words G20 and G70, after which lengths are in inches.
_INCHES = re.compile(r"(?<![A-Za-z\d])G(?:20|70)(?![\d.])", re.IGNORECASE)
# Regular expression for the sense of an arc in programmes for Heidenhain controls. The radius of
# such an arc is in other blocks.
_ARC_AROUND_POLE = re.compile(r"(?<![A-Za-z])DR\s?[+\-](?!\d)")
_MM_PER_INCH = 25.4
# Directions of travel that the words G2 and G3 select; the keys are the digits of these words.
_SENSES = {"2": "CW", "3": "CCW"}


class ProgrammedArc(NamedTuple):
    """Arc that is programmed by a block of G-code."""

    line: int | str  #: number of the line
    direction: str  #: CW for G2, CCW for G3
    radius_mm: float | None  #: radius; None if the block does not state it


def programs_arc(text: str) -> bool:
    """Return whether a line of text is a block of a programme for an arc."""
    text = text[:LONGEST_TEXT]
    return _ARC.search(text) is not None or _ARC_AROUND_POLE.search(text) is not None


def programmed_arcs(lines: Sequence[tuple[int | str, str]]) -> list[ProgrammedArc]:
    """Return the arcs that are programmed by G-code in lines of text, in the order of the lines.

    Parameters
    ----------
    lines
        Numbers and texts of the lines.
    """
    texts = [text[:LONGEST_TEXT] for _, text in lines]
    unit_mm = 1.0
    if any(_INCHES.search(text) for text in texts):
        unit_mm = _MM_PER_INCH
    is_absolute = any(_ABSOLUTE_CENTRE.search(text) for text in texts)
    arcs = []
    for line, content in lines:
        text = content[:LONGEST_TEXT]
        match = _ARC.search(text) or _WORD_OF_ARC.fullmatch(text)
        if match is None:
            continue
        radius = _radius_in(text, is_absolute)
        if radius is not None:
            radius *= unit_mm
        arcs.append(ProgrammedArc(line, _SENSES[match["sense"]], radius))
    return arcs


def _radius_in(block: str, is_absolute: bool) -> float | None:
    """Return the radius that a block of G-code states; None if the block states no radius.

    The radius is in the unit of the block. The block states the radius itself, or the coordinates
    of the centre, from which the radius is computed. This is possible only if the coordinates are
    counted from the start of the arc. If ``is_absolute`` is true, they are counted from the zero
    point of the programme, and the result is None.
    """
    stated = _RADIUS.search(block)
    if stated is not None:
        return abs(float(stated["number"])) or None
    distances = [float(match["number"]) for match in _CENTRE.finditer(block)]
    if is_absolute:
        return None
    return math.hypot(*distances) or None
