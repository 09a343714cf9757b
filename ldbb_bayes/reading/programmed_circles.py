"""Circles that are programmed in lines above a table: radius, direction, start and feed.

The lines are blocks of G-code or blocks for a Heidenhain control. An example of G-code is ``G2 X100
Y0 I-100 J0 F2000``, which programs a clockwise circle of radius 100 mm that starts at +X. A block
such as ``C X+100 Y+0 DR-`` is for a Heidenhain control; an earlier block then states the centre of
the arc, which is called the pole.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from ldbb_bayes.reading.words import LONGEST_TEXT
from ldbb_bayes.units import MM_PER_INCH

__all__ = [
    "ProgrammedArc",
    "ProgrammedFeed",
    "programmed_arcs",
    "programs_arc",
    "radius_beside_feed",
]

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
# Regular expression for a coordinate of the centre of an arc, relative to the arc's starting point.
_CENTRE = re.compile(rf"(?<![A-Za-z])(?P<letter>[IJK])\s?=?\s?(?P<number>{_NUMBER})", re.IGNORECASE)
# Axes to which the coordinates of an arc's centre belong. The keys are the letters of these
# coordinates in G-code: for example, the number after I is the coordinate along X.
_AXIS_OF_CENTRE = {"I": "X", "J": "Y", "K": "Z"}
# Regular expression for a coordinate, such as X100, of the point to which a block (line) of an NC
# programme moves the machine.
_POINT = re.compile(rf"(?<![A-Za-z])(?P<letter>[XYZ])\s?=?\s?(?P<number>{_NUMBER})", re.IGNORECASE)
# Regular expression for a block that moves along a straight line: G0, G1, or, for a Heidenhain
# control, L.
_STRAIGHT = re.compile(r"(?<![A-Za-z\d])G0?[01](?![\d.])|^\W*(?:\d+\s+)?L\s", re.IGNORECASE)
# Regular expression for a block that sets the centre of an arc (CC) for a Heidenhain control.
_POLE = re.compile(r"^\W*(?:\d+\s+)?CC\s")
# Regular expressions for the word F of G-code, which states the feed, and for the words G93 and
# G95, after which F is not a speed.
_FEED = re.compile(r"(?<![A-Za-z])F\s?=?\s?(?P<number>\d+\.?\d*)", re.IGNORECASE)
_FEED_IS_NO_SPEED = re.compile(r"(?<![A-Za-z\d])G9[35](?![\d.])", re.IGNORECASE)
# Regular expression for the radius of an arc in a block of an NC programme, such as R100 or CR=100.
_RADIUS = re.compile(rf"(?<![A-Za-z])C?R\s?=?\s?(?P<number>{_NUMBER})", re.IGNORECASE)
# Regular expressions for a line that holds only the words R and F of G-code, such as R100 F1000, in
# either order. A feed has at least four digits; in F238, the number may be a force.
_WORD_R = r"R\s?=?\s?(?P<radius>(?:[5-9]\d|[1-9]\d\d)(?:\.\d*)?)"
_WORD_F = r"F\s?=?\s?(?P<feed>\d{4,5}(?:\.\d*)?)"
_RADIUS_BESIDE_FEED = (
    re.compile(rf"\W*{_WORD_R}[\s,;]+{_WORD_F}\W*", re.IGNORECASE),
    re.compile(rf"\W*{_WORD_F}[\s,;]+{_WORD_R}\W*", re.IGNORECASE),
)
# Regular expression for the word G90.1, after which the coordinates of centres are relative to the
# zero point of the programme.
_ABSOLUTE_CENTRE = re.compile(r"(?<![A-Za-z\d])G90\.1(?!\d)", re.IGNORECASE)
# Regular expression for the words G20 and G70, after which lengths are in inches.
_INCHES = re.compile(r"(?<![A-Za-z\d])G(?:20|70)(?![\d.])", re.IGNORECASE)
# Regular expression for the words DR+ and DR- of a Heidenhain control, which say whether an arc
# runs counter-clockwise or clockwise.
_ARC_AROUND_POLE = re.compile(r"(?<![A-Za-z])DR\s?(?P<sense>[+\-])(?!\d)")
# Directions of travel that the words G2, G3, DR- and DR+ select; the keys are the last characters
# of the words.
_SENSES = {"2": "CW", "3": "CCW", "-": "CW", "+": "CCW"}


class ProgrammedFeed(NamedTuple):
    """Feed rate in a block of an NC programme."""

    line: int | str  #: number of the line of the NC programme that states the feed rate
    mm_per_min: float  #: feed rate of the machine along the path [mm/min]


class ProgrammedArc(NamedTuple):
    """Arc that is programmed by a block of G-code, or by a block for a Heidenhain control."""

    line: int | str  #: number of the line of the NC programme that describes the arc
    text: str  #: text of the block (line) of the NC programme that describes the arc
    direction: str  #: direction of travel: CW for G2 and DR-, CCW for G3 and DR+
    #: radius of the arc [mm]; None if it does not follow from the programme
    radius_mm: float | None
    #: coordinates of the start of the arc relative to its centre [mm]; the keys are the axes X, Y
    #: and Z; None if the start does not follow from the programme. The start may be wrong if the
    #: arc is not a full circle
    start_mm: Mapping[str, float] | None
    #: feed rate that applies to the arc; None if no block (line) of the NC programme states a feed
    feed: ProgrammedFeed | None
    #: whether the block (line) of the NC programme is only the word G2 or G3, without coordinates
    is_bare_word: bool


@dataclass
class _Programme:
    """State of an NC programme after the blocks (lines) that have been read so far."""

    #: size of the unit of length in the NC programme [mm]: 1 for millimetres, 25.4 for inches
    unit_mm: float
    #: whether the coordinates of arc centres are relative to the zero point of the NC programme; if
    #: not, they are relative to the start of the arc
    has_absolute_centres: bool
    #: whether the word F of the G-code states a feed rate, and not a feed per revolution or an
    #: inverse time
    has_feeds: bool
    #: coordinates of the end of the last motion in the NC programme [mm]; the keys are the axes;
    #: the dict is empty if the end is not known
    position: dict[str, float] = field(default_factory=dict)
    #: coordinates of the pole (centre of later arcs) for a Heidenhain control [mm]; the keys are
    #: the axes; the dict is empty if the pole is not known
    pole: dict[str, float] = field(default_factory=dict)
    #: feed rate that applies to the block (line) of the NC programme that is read next
    feed: ProgrammedFeed | None = None


def programs_arc(text: str) -> bool:
    """Return whether a line of text is a block of an NC programme that moves along an arc."""
    text = text[:LONGEST_TEXT]
    return _ARC.search(text) is not None or _ARC_AROUND_POLE.search(text) is not None


def radius_beside_feed(text: str) -> tuple[float, float] | None:
    """Return the radius [mm] and the feed [mm/min] of a line such as ``R100 F1000``, or None.

    The line must hold nothing else, and the numbers must be a radius and a feed in millimetres.
    """
    for pattern in _RADIUS_BESIDE_FEED:
        match = pattern.fullmatch(text[:LONGEST_TEXT])
        if match is not None:
            return float(match["radius"]), float(match["feed"])
    return None


def programmed_arcs(lines: Sequence[tuple[int | str, str]]) -> list[ProgrammedArc]:
    """Return the arcs that are programmed in lines of text, in the order of the lines.

    A line that is only the word G2 or G3 counts as an arc, too.

    Parameters
    ----------
    lines
        Line number and text of each line.
    """
    texts = [text[:LONGEST_TEXT] for _, text in lines]
    unit_mm = 1.0
    if any(_INCHES.search(text) for text in texts):
        unit_mm = MM_PER_INCH
    programme = _Programme(
        unit_mm,
        has_absolute_centres=any(_ABSOLUTE_CENTRE.search(text) for text in texts),
        has_feeds=not any(_FEED_IS_NO_SPEED.search(text) for text in texts),
    )
    arcs = []
    for line, content in lines:
        arc = _read_block(programme, line, content[:LONGEST_TEXT])
        if arc is not None:
            arcs.append(arc)
    return arcs


def _read_block(programme: _Programme, line: int | str, text: str) -> ProgrammedArc | None:
    """Return the arc that a block (line) of a programme describes; None if it describes no arc.

    ``text`` is the block, and ``line`` its line number. A block that is only the word G2 or G3 is
    also an arc. Values that later blocks need are stored in ``programme``: the feed, the end of a
    motion, and the pole (centre of later arcs).
    """
    path = _ARC.search(text) or _ARC_AROUND_POLE.search(text)
    is_motion = path is not None or _STRAIGHT.search(text) is not None
    if is_motion:
        _take_feed(programme, line, text)
    match = path or _WORD_OF_ARC.fullmatch(text)
    arc = None
    if match is not None:
        start = _start_of_arc(programme, text)
        arc = ProgrammedArc(
            line,
            text,
            _SENSES[match["sense"]],
            _radius_of_arc(programme, text, start),
            start,
            programme.feed,
            is_bare_word=path is None,
        )
    if is_motion:
        programme.position |= _coordinates(programme, text)
    elif _POLE.search(text):
        programme.pole = _coordinates(programme, text)
    return arc


def _take_feed(programme: _Programme, line: int | str, block: str) -> None:
    """Store in ``programme`` the feed rate that a block states, for this and later blocks.

    ``line`` is the number of the line of the block. Nothing is stored if the block states no feed,
    or if the word F of the programme is not a speed.
    """
    match = _FEED.search(block)
    if match is not None and programme.has_feeds:
        mm_per_min = float(match["number"]) * programme.unit_mm
        programme.feed = ProgrammedFeed(line, mm_per_min)


def _coordinates(programme: _Programme, block: str) -> dict[str, float]:
    """Return the X, Y and Z coordinates in a block of a programme [mm]; the keys are the axes.

    ``programme`` states the unit of the lengths.
    """
    coordinates = {}
    for match in _POINT.finditer(block):
        coordinates[match["letter"].upper()] = float(match["number"]) * programme.unit_mm
    return coordinates


def _start_of_arc(programme: _Programme, block: str) -> dict[str, float] | None:
    """Return the start of an arc relative to its centre [mm], or None if it is not known.

    The result is a dict of coordinates; the keys are the axes, such as X. ``block`` is the line of
    the programme that describes the arc. In most programmes, it states the centre relative to the
    start. In other programmes, the centre is stated relative to the zero point, either in the block
    or, for a Heidenhain control, as the pole in an earlier block. The arc then starts at the end of
    the last motion. If this point is not known, the end of the arc is used, because a full circle
    ends where it starts. ``programme`` holds the end of the last motion and the pole.
    """
    centre = {}
    for match in _CENTRE.finditer(block):
        axis = _AXIS_OF_CENTRE[match["letter"].upper()]
        centre[axis] = float(match["number"]) * programme.unit_mm
    if centre and not programme.has_absolute_centres:
        return {axis: -distance for axis, distance in centre.items()}
    if _ARC_AROUND_POLE.search(block):
        centre = programme.pole
    point = programme.position or _coordinates(programme, block)
    if not centre or not point:
        return None
    return {axis: point.get(axis, 0.0) - centre[axis] for axis in centre}


def _radius_of_arc(
    programme: _Programme, block: str, start_mm: Mapping[str, float] | None
) -> float | None:
    """Return the radius of an arc [mm]; None if it does not follow from the programme.

    If the block does not state the radius, the distance between start and centre is returned.
    ``block`` is the line of the programme that describes the arc, and ``start_mm`` is the start of
    the arc relative to its centre [mm]; None if it is not known.
    """
    stated = _RADIUS.search(block)
    if stated is not None and not _ARC_AROUND_POLE.search(block):
        return abs(float(stated["number"])) * programme.unit_mm or None
    if start_mm is None:
        return None
    return math.hypot(*start_mm.values()) or None
