"""Loads, radii and planes that the names of files, sheets, columns or tests state, such as 238N.

Loads are forces and pressures.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

from ldbb_bayes.reading.numerals import NUMBER_IN_TEXT, may_be_thousands, number_in_text
from ldbb_bayes.reading.planes import PLANE_OF_SWAPPED, plane_named
from ldbb_bayes.reading.words import ABSOLUTE_PRESSURE, LONGEST_TEXT, UNITS, unit_named

__all__ = [
    "LOAD_IN_NAME",
    "NamedLoad",
    "load_in_name",
    "load_is_ambiguous",
    "name_as_words",
    "plane_in_name",
    "radii_of_columns",
    "radius_in_name",
    "unknown_length_in_name",
]

# Regular expression for a number with a unit of force or pressure in a name, such as 238N or 2.5
# bar. In "run 1 N=36", N is not a unit but the number of readings.
LOAD_IN_NAME = re.compile(
    rf"(?<![\d.,A-Za-z])({NUMBER_IN_TEXT})[ _-]?"
    r"(kN|daN|N|newton|lbf|lbs?|kgf|kp|bar|mbar|MPa|kPa|psi|к?Н(?![а-яё]))(?![a-zA-Z])"
    r"(?!\s*=\s*\d+(?![\d.,]*\s?[a-zA-Z]))",
    re.IGNORECASE,
)
# Regular expression for a load (force or pressure) that can be read in two ways. An underscore, a
# hyphen or a p may stand for a decimal point (3_5bar), and a blank may separate thousands (1 238
# N). Forces above 5999 N are not expected.
_AMBIGUOUS_LOAD = re.compile(
    r"\d[_p\-]\d+[ _]?(?:[a-z]*bar|kN|MPa|kPa|psi)"
    r"|(?<!\d)0[_p\-]\d+[ _]?N(?![a-z])"
    r"|\d[_p\-]\d[ _]?N(?![a-z])"
    r"|(?<![a-zA-Z\d])[1-5][ ']\d{3}[ _]?k?N(?![a-z])",
    re.IGNORECASE,
)
# Regular expression for a force of two or three digits without a unit in a name, such as F238.
# Longer numbers after F, such as F2000, are feeds.
_FORCE_AFTER_F = re.compile(r"(?<![a-zA-Z0-9])[fF](\d{2,3})(?![\d.,])")
# Regular expression for a radius of at least 50 mm in a name, such as R100. A smaller number after
# R does not match, because it is probably the number of a run.
_RADIUS_AFTER_R = re.compile(
    r"(?<![a-zA-Z0-9])(?:R|[Rr]adius)[ _=\-]?([5-9]\d(?:\.\d+)?|[1-9]\d{2,3}(?:\.\d+)?)"
    r"(?:[ _]?mm)?(?![a-zA-Z\d.,])(?![ _](?:N|kN|daN|lbf|kgf|bar|psi)(?![^\W_]))"
)
# Regular expression for the radius or diameter of the circle in the name of a test or file. It
# matches a number in mm, or a number after a letter or word for a radius, diameter, length or bar.
_LENGTH_IN_NAME = re.compile(
    r"(?<![\d.,])(?:[5-9]\d|[1-9]\d\d)(?:[.,]\d+)?[ _\-]?mm(?![/\w])"
    r"|(?<![^\W_])(?:[RrDdLØø]|[Bb]ar|[Dd]ia(?:meter)?|[Dd]urchmesser|[Rr]ad(?:ius)?)[ _=\-]?"
    r"(?:0\.\d+[ _]?m(?![^\W_])"
    r"|(?:[5-9]\d|[1-9]\d\d)(?![.\d])(?![ _]?(?:k?N|daN|lbf|kgf|bar|psi)(?![^\W_])))"
)
# Regular expression for a radius in a name that also states its unit, such as "radius 10 cm". In
# "radius 75 in XY", "in" is no inch.
_RADIUS_WITH_UNIT = re.compile(
    r"(?<![^\W_])(?:radius|rayon|raggio|promień|半径)[ _=:\-]{0,3}(?P<number>\d+(?:[.,]\d+)?)[ _]?"
    r"(?P<unit>mm|cm|m|in(?![ _]+[^\W\d_])|inch(?:es)?)(?![^\W_])",
    re.IGNORECASE,
)
# Smallest and largest radius that a name may state in such a way [mm].
_SMALLEST_RADIUS_MM = 20.0
_LARGEST_RADIUS_MM = 2000.0
# Regular expression for any number behind a word for a radius, diameter or length in a name.
_LENGTH_AFTER_WORD = re.compile(
    r"(?<![^\W_])(?:(?:bar|nominal|nenn) ?(?:length|länge)|radius|rayon|raggio|diameter|durchmesser"
    r"|diamètre|半径|直径)[ _=:;~\-]{0,3}\d[\d.,]*(?:e\d+)?(?: ?(?:mm|cm|m|in|inch)(?![^\W_]))?",
    re.IGNORECASE,
)
# Regular expression for the label of radii in the first cell of a line.
_RADIUS_LABEL = re.compile(r"(?:nominal )?(?:R|radius|radii|radien|rayons?)\W*", re.IGNORECASE)
# Regular expression for a radius in mm, with or without a label, such as "R = 100 mm".
_RADIUS_IN_CELL = re.compile(
    r"(?P<label>(?:R|radius|rayon)\s*[=:]?\s*)?(?P<radius>[5-9]\d|[1-9]\d{2,3})\s?mm", re.IGNORECASE
)
# Regular expression for the place in a name at which a new word begins with a capital letter, as
# before CW in "anglesCW".
_CAPITAL_WITHIN = re.compile(r"(?<=[a-z])(?=[A-Z])")
# Regular expression for a plane in a name: its letters, such as XY, or its word of G-code, such as
# G17.
_PLANE = re.compile(r"(?<![a-zA-Z])(XY|YX|YZ|ZY|ZX|XZ|xy|yx|yz|zy|zx|xz|G1[789](?!\d))(?![a-zA-Z])")


class NamedLoad(NamedTuple):
    """Load (force or pressure) that the name of a file, sheet, column or test states."""

    key: str  #: kind of load that a name states: force_N or pressure_bar
    value: float  #: value of the load that a name states, in N for a force or bar for a pressure
    name: str  #: name of the file, sheet, column or test that states the load


class _WrittenLoad(NamedTuple):
    """Load that the name of a test, column, sheet or file states as a number with a unit."""

    key: str  # kind of load that a name states: force_N or pressure_bar
    text: str  # value of the load as a text, such as "238", as the name states it
    unit_size: float  # size of the unit of the load in N or bar, such as 1000 for kN


def load_in_name(names: Sequence[str], key: str = "") -> NamedLoad | None:
    """Return the force or pressure that a name states, as in ``238N``, ``2.5 bar`` or ``f238``.

    The first name that contains exactly one load is used. Return None if there is no such name.

    Parameters
    ----------
    names
        Names of test, column, sheet and file, in the order in which they are examined.
    key
        Kind of load, force_N or pressure_bar; empty if any kind is accepted.
    """
    for name in names:
        text = name[:LONGEST_TEXT]
        written = [load for load in _written_loads(text) if key in ("", load.key)]
        after_f = _FORCE_AFTER_F.findall(text)
        if not written and len(after_f) == 1 and key in ("", "force_N"):
            return NamedLoad("force_N", float(after_f[0]), name)
        if len(written) != 1 or _AMBIGUOUS_LOAD.search(name):
            continue
        load = written[0]
        if load.key == "pressure_bar" and ABSOLUTE_PRESSURE.search(name):
            continue
        is_force = load.key == "force_N"
        if is_force and may_be_thousands(load.key, load.text, load.unit_size):
            continue
        value = number_in_text(load.text)
        if value is not None:
            return NamedLoad(load.key, abs(value) * load.unit_size, name)
    return None


def _written_loads(text: str) -> list[_WrittenLoad]:
    """Return all loads in a text; a load is a number with a unit of force or pressure.

    The list holds the forces first, then the pressures.
    """
    forces = []
    pressures = []
    for digits, word in LOAD_IN_NAME.findall(text):
        unit = unit_named(word)
        if unit in UNITS["force"]:
            forces.append(_WrittenLoad("force_N", digits, UNITS["force"][unit]))
        if unit in UNITS["pressure"]:
            pressures.append(_WrittenLoad("pressure_bar", digits, UNITS["pressure"][unit]))
    return forces + pressures


def load_is_ambiguous(names: Sequence[str]) -> bool:
    """Return whether any of the names contains a force or pressure that can be read in two ways.

    An example is ``1 238 N``: it may be 1238 N, or 238 N after another number.
    """
    return any(_AMBIGUOUS_LOAD.search(name) for name in names)


def radius_in_name(names: Sequence[str]) -> float | None:
    """Return the radius [mm] that the name of a test, column, sheet or file states, as in ``R100``.

    The first name that contains exactly one radius is used. Return None if there is no such name.
    """
    for name in names:
        radii = {float(radius) for radius in _RADIUS_AFTER_R.findall(name[:LONGEST_TEXT])}
        radii |= _radii_with_unit(name[:LONGEST_TEXT])
        if len(radii) == 1:
            return radii.pop()
    return None


def _radii_with_unit(name: str) -> set[float]:
    """Return the radii [mm] that a name states with their unit, as in ``radius 10 cm``.

    A number that cannot be the radius of a bar is left out.
    """
    radii = set()
    for match in _RADIUS_WITH_UNIT.finditer(name):
        number = number_in_text(match["number"])
        if number is None:
            continue
        radius_mm = number * UNITS["reading"][unit_named(match["unit"])] / UNITS["reading"]["mm"]
        if _SMALLEST_RADIUS_MM <= radius_mm <= _LARGEST_RADIUS_MM:
            radii.add(radius_mm)
    return radii


def radii_of_columns(cells: Sequence[str]) -> list[str]:
    """Return the radii in a line, such as ``R100``, one for each cell except the first.

    In each cell, or in the first, a word must say that the numbers are radii, as in ``R = 100 mm``.
    An empty cell gives an empty text. The result is empty for any other line, and for a line with
    fewer than two radii. ``cells`` are the cells of the line.
    """
    is_labelled = _RADIUS_LABEL.fullmatch(cells[0].strip()) is not None
    radii = []
    for cell in cells[1:]:
        match = _RADIUS_IN_CELL.fullmatch(cell.strip())
        if match is not None and (match["label"] or is_labelled):
            radii.append(f"R{match['radius']}")
        elif cell:
            return []
        else:
            radii.append("")
    return radii if sum(map(bool, radii)) > 1 else []


def unknown_length_in_name(names: Sequence[str]) -> str:
    """Return a note on the first name that states a length, such as 100 mm in ``300N_100mm``.

    The length may be the radius or the diameter of the circle. The note is empty if no name states
    a length. ``names`` are the names of the test, its column, its sheet and its file.
    """
    for name in names:
        text = name[:LONGEST_TEXT]
        match = _LENGTH_AFTER_WORD.search(text) or _LENGTH_IN_NAME.search(text)
        if match is not None:
            return f"its name says {match[0]}, not taken"
    return ""


def name_as_words(name: str) -> str:
    """Return a name with blanks between its words: ``300N angles CW`` for ``300N_anglesCW``."""
    return _CAPITAL_WITHIN.sub(" ", name[:LONGEST_TEXT]).replace("_", " ")


def plane_in_name(names: Sequence[str]) -> str | None:
    """Return the plane that the name of a test, column, sheet or file states, such as XY.

    The first name that contains exactly one plane is used. G18 gives ZX. If the letters of the
    plane are in the other order, as in XZ, they are returned so; later code raises an error then.
    Return None if there is no such name.
    """
    for name in names:
        planes = [plane_named(word) for word in _PLANE.findall(name[:LONGEST_TEXT])]
        usual = {PLANE_OF_SWAPPED.get(plane, plane) for plane in planes}
        if len(usual) == 1:
            return planes[0]
    return None
