"""Random changes of files from the field: units, radii and conventions change in header, column,
line, cell, number format or name.

Each mutation knows the numbers that stand in its files and what they truly mean.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import field_files as field
import numpy as np
from field_files import Array, Circle

__all__ = ["Meaning", "Mutation", "WrittenCircle", "circle_of", "mutation"]

Random = np.random.Generator
# Every second reading of the field files.
TRUTH = tuple(
    replace(circle, angle_deg=circle.angle_deg[::2], reading_um=circle.reading_um[::2])
    for circle in field.TRUTH
)
# Units of readings, as they may be written, each with its size [µm].
READING_UNITS = {
    "um": 1.0,
    "µm": 1.0,
    "μm": 1.0,
    "micron": 1.0,
    "mm": 1e3,
    "MM": 1e3,
    "cm": 1e4,
    "nm": 1e-3,
    "inch": 25400.0,
    "in": 25400.0,
    "mil": 25.4,
    "thou": 25.4,
    "uinch": 0.0254,
    "0.1 um": 0.1,
    "мкм": 1.0,
    "Mikrometer": 1.0,
    "10 nm": 0.01,
    "1/1000 mm": 1.0,
    "0,001 mm": 1.0,
    "x 10 um": 10.0,
    "counts": 0.1,
    "V": 1.0,
    "furlong": 1.0,
}
# Units of angles, as they may be written, each with its size [deg].
ANGLE_UNITS = {
    "deg": 1.0,
    "°": 1.0,
    "degrees": 1.0,
    "Grad": 1.0,
    "rad": 180.0 / np.pi,
    "gon": 0.9,
    "mrad": 0.18 / np.pi,
    "turns": 360.0,
}
# Units of forces, as they may be written, each with its size [N].
FORCE_UNITS = {"N": 1.0, "kN": 1e3, "daN": 10.0, "lbf": 4.4482216152605, "kgf": 9.80665}
READING_WORDS = (
    "Reading",
    "Deviation",
    "Messwert",
    "Abweichung",
    "Value",
    "Écart",
    "偏差",
    "Отклонение",
    "dR",
)
DIAMETER_WORDS = (
    "Diameter deviation",
    "ΔD",
    "Durchmesserabweichung",
    "Diametral error",
    "Écart diamètre",
    "Dia. error",
    "Deviation Ø",
    "Delta diam",
    "dØ",
    "D deviation",
    "D - Dnom",
    "2dR",
    "2 x dR",
    "Durchm.-Abw.",
    "Double deviation",
    "Reading (diameter)",
)
DIAMETER_LINES = (
    "Values: diameter deviations",
    "Messwerte: Durchmesser",
    "Readings are of the diameter",
    "Output: diametral",
    "Mode: diameter",
    "Measurement type: diameter",
    "Messgröße: Durchmesser",
    "Quantity: ΔD",
    "Readings doubled",
    "Values: 2 x radial deviation",
    "Column 2: diameter deviation",
    "Deviation (diameter)",
)
NEGATED_WORDS = (
    "-dR",
    "R0 - R",
    "Nominal - actual",
    "Nominal minus actual",
    "Soll-Ist",
    "Reading inverted",
    "Deviation (neg)",
    "Negative deviation",
    "Shortening",
    "Stauchung",
    "-1*dR",
    "Inward deviation",
)
ANGLE_WORDS = ("Angle", "Winkel", "theta", "角度", "Угол", "Position", "phi")
# How the unit stands in the header of a column, by the place of the unit.
HEADERS = {
    "brackets": "{word} [{unit}]",
    "round brackets": "{word} ({unit})",
    "no brackets": "{word} {unit}",
    "in": "{word} in {unit}",
    "slash": "{word} / {unit}",
    "comma": "{word}, {unit}",
    "underscore": "{word}_{unit}",
    "tight brackets": "{word}({unit})",
    "angle brackets": "{word} <{unit}>",
    "braces": "{word} {{{unit}}}",
    "dash": "{word} - {unit}",
    "colon": "{word}: {unit}",
    "brackets with in": "{word} (in {unit})",
    "unit first": "[{unit}] {word}",
    "given in": "{word} given in {unit}",
    "twice": "{word} {unit} [{unit}]",
}
# Lines in which nothing but its place says that a word is a unit.
_LINES_WITHOUT_WORDS_FOR_UNITS = ("{u}", "[{u}]", "Deviation ({u})", "Readings [{u}]")
# Places in a header where a word that is no unit is a word of the header.
_BARE = ("no brackets", "slash", "comma", "underscore", "dash", "colon", "nameless column")
READING_PLACES = (*HEADERS, "row", "line", "column", "cells", "format", "nowhere")
ANGLE_PLACES = (*HEADERS, "row", "line", "cells", "nowhere")
READING_UNIT_LINES = (
    "Units: {u}",
    "Einheit: {u}",
    "Unit of readings = {u}",
    "All values in {u}",
    "Readings in {u}",
    "Messwerte in {u}",
    "Deviation unit: {u}",
    "Scale: 1 {u} per count",
    "Readings [{u}]",
    "Deviation ({u})",
    "[{u}]",
    "{u}",
    "Reading unit; {u}",
    "Measurement unit - {u}",
    "Units ({u})",
)
ANGLE_UNIT_LINES = ("Angle unit: {u}", "Unit of angle = {u}", "Angles in {u}", "Winkel in {u}")
RADIUS_LINES = (
    "Radius: {r} mm",
    "R = {r} mm",
    "r={r}mm",
    "Radius {r}",
    "Diameter: {d} mm",
    "Ø {d} mm",
    "D{d}",
    "Bar length: {r} mm",
    "Ballbar length: {r} mm",
    "Length of the ball bar = {r} mm",
    "Kreisdurchmesser: {d} mm",
    "Kreis-Ø: {d} mm",
    "Rayon: {r} mm",
    "Rayon nominal : {r} mm",
    "Raggio {r} mm",
    "Radius {ri} inch",
    "Radius: {cm} cm",
    "Radius (m): {m}",
    "Radius [mm]{s}{r}",
    "Radius{s}{r}{s}mm",
    "Nominal radius = {r}",
    "Länge der Stange: {r} mm",
    "Circle: {r} mm",
    "Circle of {d} mm diameter",
    "Bar {r} mm",
    "{r} mm bar",
    "Kugelabstand: {r} mm",
    "Nennmaß: {r} mm",
    "Test circle dia {d} mm",
    "半径: {r} mm",
    "Радиус: {r} мм",
    "Radius: {r} ± 0.01 mm",
    "Radius: {r} +/- 0.01 mm",
    "Radius = {r}. mm",
    "Radius, mm: {r}",
    "Radius (in mm): {r}",
    "radius_mm={r}",
    "radius_mm;{r}",
    "Half diameter: {r} mm",
    "2R = {d} mm",
    "Diameter/2 = {r} mm",
    "Radius (programmed) {r} mm",
    "Bar: {h} mm + extension {h} mm",
    "Bar {h} + {h} mm",
    "Bar: {h} mm with extension {h} mm",
    "Ballbar {h} mm; extension {h} mm",
    "Stab {h} mm + Verlängerung {h} mm",
    "Ballbar {r}",
    "Bar (mm): {r}",
    "R{r}",
    "R: {r}",
    "CR={r}",
    "L = {r} mm",
    "Ball centre distance: {r} mm",
    "Distance between balls {r} mm",
    "Calibrated length: {r} mm",
    "Circle size {d} mm",
    "G41 D{d}",
    "C X+{r} Y+0 DR+",
    "Size of circle;{d};mm",
    "Radius µm: {um}",
)
# Blocks of G-code above a table, each with the direction of its arc.
PROGRAM_LINES = {
    "G2 X{r} Y0 I-{r} J0 F2000": "CW",
    "N20 G3 I-{r}": "CCW",
    "G03 X0 Y0 R{r}": "CCW",
    "G02X0Y0I-{r}J0": "CW",
    "G3 X0 Y0 CR={r}": "CCW",
    "G17 G2 I{r}": "CW",
    "G20 G2 I-{ri}": "CW",
}
# Lines and headers about angles, each with the angle from +X at which angles begin [deg], and +1 or
# −1 for counter-clockwise or clockwise.
ANGLE_LINES = {
    "Angle from Y clockwise": (90.0, -1),
    "Zero of the angle: +Y": (90.0, 1),
    "Zero of the angle: -X": (180.0, 1),
    "Angle counted clockwise from +X": (0.0, -1),
    "Winkel ab +Y im Uhrzeigersinn": (90.0, -1),
    "Nullpunkt des Winkels: -Y": (270.0, 1),
    "0° at +Y, clockwise positive": (90.0, -1),
    "Angles are measured from the Y axis, cw": (90.0, -1),
    "theta = 0 on the -X axis, ccw": (180.0, 1),
    "Angles increase clockwise": (0.0, -1),
    "Positive angles: clockwise": (0.0, -1),
    "Winkelzählung im Uhrzeigersinn": (0.0, -1),
    "Clockwise angles": (0.0, -1),
    "Angle zero: 12 o'clock, clockwise": (90.0, -1),
    "Angle origin is the machine's Y+ direction, cw": (90.0, -1),
    "Start of angle at Y+, cw": (90.0, -1),
    "Bezug der Winkel: +Y, UZS": (90.0, -1),
    "Angle axis: Y (cw)": (90.0, -1),
    "Compass angles": (90.0, -1),
    "Angles: negative": (0.0, -1),
    "Angles negative": (0.0, -1),
    "Winkel negativ": (0.0, -1),
    "Angle sign: -1": (0.0, -1),
    "Angles reversed": (0.0, -1),
    "Angles: left-handed": (0.0, -1),
    "Angles decreasing": (0.0, -1),
    "Angle = -theta": (0.0, -1),
    "theta = 90 - angle": (90.0, -1),
    "Winkel rechtsdrehend": (0.0, -1),
    "Angles multiplied by -1": (0.0, -1),
    "Angle: math negative": (0.0, -1),
    "Angular direction: CW": (0.0, -1),
    "phi: CW": (0.0, -1),
    "Negative angles: counter-clockwise": (0.0, -1),
    "0 deg: +Y; cw": (90.0, -1),
    "+Y = 0°; angles cw": (90.0, -1),
    "Y+ is 0 deg": (90.0, 1),
    "Polar axis: +Y": (90.0, 1),
    "0° = 12 o'clock": (90.0, -1),
    "Azimuth": (90.0, -1),
    "Zero at top": (90.0, -1),
    "Angles start at -Y; ccw": (270.0, 1),
    "Winkel von Y": (90.0, -1),
    "Angle 0 = Y+ (clockwise)": (90.0, -1),
    "Angle offset = 90": (90.0, 1),
    "Angles as on the drawing": (90.0, -1),
}
ANGLE_ADDITIONS = {
    " from Y clockwise": (90.0, -1),
    " cw": (0.0, -1),
    " (from -X; ccw)": (180.0, 1),
    " from +Y cw": (90.0, -1),
    " clockwise from Y": (90.0, -1),
    " ab Y im UZS": (90.0, -1),
    " CW+": (0.0, -1),
    " negative": (0.0, -1),
    " (reversed)": (0.0, -1),
    " negativ": (0.0, -1),
    " (from Y axis)": (90.0, -1),
    " ccw from -Y": (270.0, 1),
    " (0=Y; CW)": (90.0, -1),
    " left-handed": (0.0, -1),
    " N=0": (90.0, -1),
}
SIGN_LINES = (
    "Positive reading: bar shorter",
    "Sign: + means shorter",
    "Vorzeichen: positiv = kürzer",
    "Positive values mean a shorter bar",
    "Readings count positive inwards",
    "Positive = inside",
    "Negative: away from centre",
    "Compression positive",
    "Readings inverted",
    "Reading sign: inverted",
    "Sign: -1",
    "Vorzeichen: umgekehrt",
    "Readings multiplied by -1",
    "Deviation = nominal - measured",
    "Reading = -(R - R0)",
    "Plus: material",
    "Reading increases when bar shortens",
    "Polarity: reversed",
)
# Lines and headers that multiply readings, each with the factor.
FACTOR_LINES = {
    "Values x 10": 10.0,
    "Readings multiplied by 10": 10.0,
    "Readings divided by 2": 0.5,
    "Gain: 10": 10.0,
    "Multiply by 10": 10.0,
    "Scale factor 1000": 1000.0,
    "All values times 1000": 1000.0,
    "Sensitivity: 0.5": 0.5,
}
FACTOR_WORDS = {
    "Reading x10": 10.0,
    "10*dR": 10.0,
    "Reading/10": 0.1,
    "Reading (x1000)": 1000.0,
    "dR x 10": 10.0,
}
# What names of files add, each with what it means: fields of a meaning.
NAME_ADDITIONS = {
    "_R{r}": {},
    " R{r}mm": {},
    "_radius_{r}mm": {},
    "_{r}mm": {},
    "_D{d}": {},
    "_bar{r}": {},
    " r={r}": {},
    "_angle_cw": {"zero_deg": 0.0, "sense": -1},
    "_fromY_cw": {"zero_deg": 90.0, "sense": -1},
    " angles from Y clockwise": {"zero_deg": 90.0, "sense": -1},
    "_compass": {"zero_deg": 90.0, "sense": -1},
    "_diameter": {"is_diameter": True},
    " Durchmesser": {"is_diameter": True},
    "_inverted": {"sign": -1},
    "_negated": {"sign": -1},
}
# Columns that hold the radius in all rows: header, and cell.
RADIUS_COLUMNS = {
    "R [mm]": "{r}",
    "Radius": "{r}",
    "Radius [mm]": "{r}",
    "Diameter [mm]": "{d}",
    "Bar length [mm]": "{r}",
    "Radius [cm]": "{cm}",
    "radius_mm": "{r}",
    "Circle [mm]": "{r}",
    "Ballbar": "{r} mm",
}
# Feeds as lines above a log write them, each with the feed [mm/min].
FEED_LINES = {
    "Feed: 2000 mm/min": 2000.0,
    "Feed 1500": 1500.0,
    "Vorschub [mm/min]: 1500": 1500.0,
    "Feed: 1.5 m/min": 1500.0,
    "Feed rate = 25 mm/s": 1500.0,
    "Feed: 60 ipm": 1524.0,
    "Feed: 1500 ± 10 mm/min": 1500.0,
    "Feed: 2000 mm/min; override 50 %": 1000.0,
    "Feed: 2000 mm/min x 50 %": 1000.0,
    "Vorschub 1500 (programmiert)": 1500.0,
    "F1500": 1500.0,
}
# Starts of the circle as lines above a log write them, each with the angle [deg].
START_LINES = {
    "Start angle: 90°": 90.0,
    "Start: 90": 90.0,
    "Startwinkel 180 deg": 180.0,
    "Start angle [rad]: 1.5707963": 90.0,
    "Start: 100 gon": 90.0,
    "Begin: 90 deg": 90.0,
    "Start at +Y": 90.0,
    "Start point: Y-": 270.0,
    "Start position -X": 180.0,
    "Angles from Y": 90.0,
}
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "min": 60.0, "sec": 1.0, "milliseconds": 1e-3, "µs": 1e-6}
TIME_WORDS = ("Time", "t", "Zeit", "Elapsed time", "时间")
DIRECTION_LINES = {
    "Direction: CW": "CW",
    "Direction: counterclockwise": "CCW",
    "Drehrichtung: im Uhrzeigersinn": "CW",
    "Umlaufsinn: gegen den Uhrzeigersinn": "CCW",
    "Direction of travel: clockwise": "CW",
    "Run: CCW": "CCW",
    "Measured clockwise": "CW",
    "Sens horaire": "CW",
    "Rotation: CW": "CW",
    "Direction: negative": "CW",
    "Turned right": "CW",
    "Drehrichtung: rechts": "CW",
    "G2": "CW",
    "Direction: G3": "CCW",
}
SHAPES = ("files", "files", "files", "long", "wide")
FORCE_PLACES = ("name", "name", "name", "line", "column")
FORCE_LINES = ("Force: {f} {u}", "Kraft = {f} {u}", "Load [{u}]: {f}", "Prüfkraft{s}{f}{s}{u}")


@dataclass(frozen=True)
class Meaning:
    """What the numbers of one circle mean."""

    um_per_reading: float
    deg_per_angle: float = 1.0
    is_diameter: bool = False
    is_distance: bool = False
    sign: int = 1
    zero_deg: float = 0.0
    sense: int = 1
    radius_mm: float = 150.0
    N_per_force: float = 1.0
    direction: str | None = None
    #: of a log over time: feed [mm/min], and seconds in the unit of its times; a feed of zero for
    #: tables of angles
    feed_mm_per_min: float = 0.0
    s_per_time: float = 1.0


@dataclass(frozen=True, eq=False)
class WrittenCircle:
    """Numbers of one circle as they stand in its file, and what they mean."""

    #: name in the file, or of the file, that notes about the circle bear
    name: str
    force: float
    angle: Array
    reading: Array
    meaning: Meaning


@dataclass(frozen=True, eq=False)
class Mutation:
    """Mutated files, and the circles that they hold."""

    description: str
    files: Mapping[str, bytes]
    circles: Sequence[WrittenCircle]
    #: subjects of notes on what the files state in some way: a note must not say that nothing does
    stated: frozenset[str]


def circle_of(written: WrittenCircle, meaning: Meaning) -> Circle:
    """Return the circle that written numbers are if they mean ``meaning``."""
    reading = written.reading * meaning.um_per_reading
    if meaning.is_diameter:
        reading = 0.5 * reading
    if meaning.is_distance:
        reading = reading - 1e3 * meaning.radius_mm
    angle = written.angle * _deg_per_number(meaning)
    angle = meaning.sense * angle + meaning.zero_deg
    return Circle(
        written.force * meaning.N_per_force,
        np.mod(np.round(angle, 3), 360.0),
        meaning.sign * reading,
        meaning.radius_mm,
        meaning.direction,
    )


def _deg_per_number(meaning: Meaning) -> float:
    """Return the angle that belongs to one of the numbers that stand for angles, or for times."""
    if meaning.feed_mm_per_min == 0.0:
        return meaning.deg_per_angle
    mm_per_number = meaning.feed_mm_per_min / 60.0 * meaning.s_per_time
    return float(np.rad2deg(mm_per_number / meaning.radius_mm))


def _written(circle: Circle, name: str, meaning: Meaning) -> WrittenCircle:
    """Return the numbers that a file holds for a circle, rounded as they are written."""
    reading = meaning.sign * circle.reading_um
    if meaning.is_distance:
        reading = reading + 1e3 * meaning.radius_mm
    if meaning.is_diameter:
        reading = 2.0 * reading
    angle = np.mod(meaning.sense * (circle.angle_deg - meaning.zero_deg), 360.0)
    order = np.arange(len(angle))
    if meaning.feed_mm_per_min:
        order = np.argsort(angle)
    return WrittenCircle(
        name,
        float(f"{circle.force_N / meaning.N_per_force:.7g}"),
        np.round(angle / _deg_per_number(meaning), 7)[order],
        np.round(reading / meaning.um_per_reading, 9)[order],
        meaning,
    )


def pick(random: Random, values: Sequence[str] | Mapping[str, object]) -> str:
    return str(random.choice(list(values)))


def chance(random: Random, share: float) -> bool:
    return bool(random.random() < share)


@dataclass
class _Draft:
    """Choices for one mutation: what stands where."""

    random: Random
    separator: str
    decimal: str
    above: list[str]
    meaning: Meaning
    shape: str = "files"
    reading_unit: str = "um"
    reading_place: str = "brackets"
    angle_unit: str = "deg"
    angle_place: str = "brackets"
    reading_word: str = "Reading"
    unit_header: str = "Unit"
    angle_word: str = "Angle"
    force_unit: str = "N"
    force_place: str = "name"
    is_unit_of_force_stated: bool = True
    #: unit of each circle's readings, where it differs from circle to circle
    changing_units: Sequence[str] = ()
    #: what the names of files add, and the header and cell of a column of radii
    name_addition: str = ""
    radius_column: str = ""
    #: line that states the unit of readings
    unit_line: str = ""
    #: factor by which the numbers of readings are multiplied
    factor: float = 1.0

    def add_line(self, lines: Sequence[str] | Mapping[str, object], unit: str = "") -> str:
        """Put one of the lines above the table, with the radius or a unit, and return it."""
        line = pick(self.random, lines)
        self.above.append(self.with_radius(line, unit))
        return line

    def with_radius(self, text: str, unit: str = "") -> str:
        """Return a text with the radius, in some unit, or a unit in its places."""
        radius = self.meaning.radius_mm
        return text.format(
            r=f"{radius:g}",
            d=f"{2.0 * radius:g}",
            h=f"{radius / 2.0:g}",
            ri=f"{radius / 25.4:.9f}",
            cm=f"{radius / 10.0:g}",
            m=f"{radius / 1e3:g}",
            um=f"{radius * 1e3:g}",
            s=self.separator,
            u=unit,
        )

    def number(self, value: float, digits: int) -> str:
        return f"{value:.{digits}f}".replace(".", self.decimal)

    def units(self) -> Sequence[str]:
        """Return the units of all readings."""
        return self.changing_units or [self.reading_unit]

    def unit_of(self, k: int) -> str:
        """Return the unit of the readings of circle k."""
        return self.changing_units[k] if self.changing_units else self.reading_unit

    def meaning_of(self, k: int) -> Meaning:
        size = READING_UNITS[self.unit_of(k)] / self.factor
        return replace(self.meaning, um_per_reading=size)


def mutation(random: Random) -> Mutation:
    """Return files with random units, places of units, radii and conventions."""
    draft = _Draft(
        random,
        pick(random, (";", "\t", "|")),
        pick(random, (".", ",")),
        [],
        Meaning(1.0),
    )
    _draw_readings(draft)
    is_log = chance(random, 0.12)
    if not is_log:
        _draw_angles(draft)
    _draw_circle(draft)
    draft.shape = pick(random, SHAPES)
    if is_log:
        _draw_log(draft)
    elif draft.shape == "files":
        _draw_name(draft)
    random.shuffle(draft.above)
    if draft.reading_place == "format":
        draft.shape = "workbook"
    if draft.shape == "files":
        _draw_force(draft)
    elif draft.radius_column:
        draft.radius_column = ""
        draft.add_line(RADIUS_LINES)
    _draw_changing_units(draft)
    return _mutation_of(draft)


def _draw_readings(draft: _Draft) -> None:
    """Choose the unit of the readings, its place, and what the readings are of."""
    random = draft.random
    draft.reading_unit = pick(random, READING_UNITS)
    draft.reading_place = pick(random, READING_PLACES)
    if draft.reading_place == "format" and not chance(random, 0.3):
        draft.reading_place = "brackets"  # workbooks are slow
    draft.unit_header = pick(random, ("Unit", "Einheit", "Units", "", "Dim.", "[unit]"))
    draft.reading_word = pick(random, READING_WORDS)
    if chance(random, 0.15):
        draft.meaning = replace(draft.meaning, is_diameter=True)
        if chance(random, 0.7):
            draft.reading_word = pick(random, DIAMETER_WORDS)
        else:
            draft.add_line(DIAMETER_LINES)
    elif chance(random, 0.06):
        draft.meaning = replace(draft.meaning, is_distance=True)
        draft.reading_unit = pick(random, ("mm", "um", "inch"))
        draft.reading_word = pick(random, ("Distance", "Length", "Radius", "Reading"))
    elif chance(random, 0.1):
        draft.meaning = replace(draft.meaning, sign=-1)
        if chance(random, 0.5):
            draft.add_line(SIGN_LINES)
        else:
            draft.reading_word = pick(random, NEGATED_WORDS)
    elif chance(random, 0.08):
        if chance(random, 0.5):
            draft.factor = FACTOR_LINES[draft.add_line(FACTOR_LINES)]
        else:
            draft.reading_word = pick(random, FACTOR_WORDS)
            draft.factor = FACTOR_WORDS[draft.reading_word]


def _draw_angles(draft: _Draft) -> None:
    """Choose the unit of the angles, where they begin, which way they run, and the direction."""
    random = draft.random
    draft.angle_word = pick(random, ANGLE_WORDS)
    if chance(random, 0.5):
        draft.angle_unit = pick(random, ANGLE_UNITS)
        draft.angle_place = pick(random, ANGLE_PLACES)
    if draft.angle_unit == "Grad":
        draft.angle_word = "Winkel"  # in German alone it means degree
    draft.meaning = replace(draft.meaning, deg_per_angle=ANGLE_UNITS[draft.angle_unit])
    convention = (0.0, 1)
    if chance(random, 0.25):
        convention = ANGLE_LINES[draft.add_line(ANGLE_LINES)]
    elif chance(random, 0.15):
        addition = pick(random, ANGLE_ADDITIONS)
        convention = ANGLE_ADDITIONS[addition]
        draft.angle_word += addition
    draft.meaning = replace(draft.meaning, zero_deg=convention[0], sense=convention[1])
    if chance(random, 0.15):
        direction = DIRECTION_LINES[draft.add_line(DIRECTION_LINES)]
        draft.meaning = replace(draft.meaning, direction=direction)


def _draw_circle(draft: _Draft) -> None:
    """Choose the radius and the lines that state it and the units."""
    random = draft.random
    if chance(random, 0.4):
        radius = float(random.choice([50.0, 100.0, 120.5, 200.0, 250.0, 300.0]))
        draft.meaning = replace(draft.meaning, radius_mm=radius)
        if chance(random, 0.2):
            draft.radius_column = pick(random, RADIUS_COLUMNS)
        elif draft.meaning.direction is None and chance(random, 0.15):
            direction = PROGRAM_LINES[draft.add_line(PROGRAM_LINES)]
            draft.meaning = replace(draft.meaning, direction=direction)
        else:
            draft.add_line(RADIUS_LINES)
    if draft.angle_place == "line":
        draft.add_line(ANGLE_UNIT_LINES, draft.angle_unit)


def _draw_name(draft: _Draft) -> None:
    """Choose what the names of files add to the force, and what it means."""
    random = draft.random
    if not chance(random, 0.2):
        return
    addition = pick(random, NAME_ADDITIONS)
    changed = NAME_ADDITIONS[addition]
    plain = Meaning(1.0)
    # What lines and headers change already is not changed again.
    for key in changed:
        if getattr(draft.meaning, key) != getattr(plain, key):
            return
    if "zero_deg" in changed and draft.meaning.sense != plain.sense:
        return
    draft.name_addition = draft.with_radius(addition)
    draft.meaning = replace(draft.meaning, **changed)


def _draw_force(draft: _Draft) -> None:
    """Choose place and unit of the force of each file."""
    draft.force_place = pick(draft.random, FORCE_PLACES)
    draft.force_unit = pick(draft.random, FORCE_UNITS)
    draft.meaning = replace(draft.meaning, N_per_force=FORCE_UNITS[draft.force_unit])


def _draw_changing_units(draft: _Draft) -> None:
    """Choose whether the unit of the readings differs from circle to circle, where it can."""
    if draft.shape == "wide":
        return
    places = ("column", "cells")
    if draft.shape == "files":
        places = ("column", "cells", "line", "brackets")
    if draft.reading_place in places and chance(draft.random, 0.15):
        draft.changing_units = [pick(draft.random, READING_UNITS) for _ in TRUTH]


def _draw_log(draft: _Draft) -> None:
    """Choose feed, start, direction and unit of the times of a log."""
    random = draft.random
    draft.shape = "files"
    draft.angle_word = pick(random, TIME_WORDS)
    draft.angle_unit = pick(random, TIME_UNITS)
    draft.angle_place = pick(random, (*HEADERS, "row"))
    feed = FEED_LINES[draft.add_line(FEED_LINES)]
    start = 0.0
    if chance(random, 0.5):
        start = START_LINES[draft.add_line(START_LINES)]
    direction = draft.meaning.direction
    if direction is None and chance(random, 0.4):
        direction = DIRECTION_LINES[draft.add_line(DIRECTION_LINES)]
    draft.meaning = replace(
        draft.meaning,
        zero_deg=start,
        sense=-1 if direction == "CW" else 1,
        direction=direction,
        feed_mm_per_min=feed,
        s_per_time=TIME_UNITS[draft.angle_unit],
    )


def _header(word: str, unit: str, place: str) -> str:
    if place not in HEADERS:
        return word
    return HEADERS[place].format(word=word, unit=unit)


def _row_of_cells(draft: _Draft, written: WrittenCircle, j: int, unit: str) -> list[str]:
    """Return the cells of a row with angle, reading, and the unit where it stands in the row."""
    angle = draft.number(written.angle[j], 7)
    reading = draft.number(written.reading[j], 9)
    if draft.angle_place == "cells":
        angle += f" {draft.angle_unit}"
    if draft.reading_place == "cells":
        reading += f" {unit}"
    cells = [angle, reading]
    if draft.reading_place == "column":
        cells.append(unit)
    return cells


def _mutation_of(draft: _Draft) -> Mutation:
    """Return the files of a draft, as one for each circle, one table, or a workbook."""
    between = " " if draft.shape == "long" else ""
    addition = draft.name_addition if draft.shape == "workbook" else ""
    circles = []
    for k, circle in enumerate(TRUTH):
        name = f"{circle.force_N:g}{between}N{addition}"
        circles.append(_written(circle, name, draft.meaning_of(k)))
    if draft.reading_place == "line":
        draft.unit_line = _line_of_unit(draft)
    if draft.shape == "files":
        files, circles = _one_file_each(draft, circles)
    else:
        files = _all_in_one_file(draft, circles)
    return Mutation(_description(draft), files, circles, _stated(draft))


def _line_of_unit(draft: _Draft) -> str:
    """Choose the line that states the unit of the readings, with a place for the unit."""
    line = pick(draft.random, READING_UNIT_LINES)
    units = draft.units()
    if any(re.search(r"\d", unit) for unit in units):
        line = line.replace("1 ", "")
    if "counts" in (*draft.changing_units, draft.reading_unit):
        line = READING_UNIT_LINES[0]
    return line


def _all_in_one_file(draft: _Draft, circles: Sequence[WrittenCircle]) -> dict[str, bytes]:
    """Return a workbook, or a table in which circles stand below or beside each other."""
    lines = list(draft.above)
    if draft.unit_line:
        lines.append(draft.unit_line.format(u=draft.reading_unit))
    if draft.shape == "workbook":
        return _workbook(draft, circles, lines)
    if draft.shape == "long":
        return {"all.csv": _text([*lines, *_long_rows(draft, circles)])}
    return {"all.csv": _text([*lines, *_wide_rows(draft, circles)])}


def _description(draft: _Draft) -> str:
    """Return all choices of a draft in words."""
    choices = [
        draft.shape,
        f"unit {'/'.join(draft.units())!r} in {draft.reading_place}",
        f"angle {draft.angle_unit!r} in {draft.angle_place}",
        f"force {draft.force_unit} in {draft.force_place}",
        draft.reading_word,
        draft.angle_word,
        draft.radius_column,
        draft.name_addition,
        draft.unit_line,
        *draft.above,
    ]
    return "; ".join(choices)


def _stated(draft: _Draft) -> frozenset[str]:
    """Return the subjects of notes on what the files of a draft state."""
    stated = set()
    if _is_unit_of_reading_stated(draft):
        stated.add("unit of the reading")
    if draft.angle_place != "nowhere" and not draft.meaning.feed_mm_per_min:
        stated.add("unit of the angle")
    if draft.is_unit_of_force_stated:
        stated.add("unit of the force")
    if draft.meaning.radius_mm != Meaning(1.0).radius_mm:
        stated.add("radius_mm")
    return frozenset(stated)


def _is_unit_of_reading_stated(draft: _Draft) -> bool:
    """Whether a file states the unit of the reading; words that are no units need brackets."""
    units = draft.units()
    is_unknown_word = "V" in units or "furlong" in units
    place = draft.reading_place
    if place == "column" and not draft.unit_header:
        place = "nameless column"
    if place == "line" and draft.unit_line in _LINES_WITHOUT_WORDS_FOR_UNITS:
        is_unknown_word = is_unknown_word or "counts" in units
        if is_unknown_word:
            place = "comma"
    if is_unknown_word and place in _BARE:
        return False
    return place != "nowhere"


def _text(lines: Sequence[str]) -> bytes:
    return "\n".join([*lines, ""]).encode()


def _heads(draft: _Draft, unit: str) -> list[list[str]]:
    """Return the rows of the header: names, and units where they have a row of their own."""
    names = [
        _header(draft.angle_word, draft.angle_unit, draft.angle_place),
        _header(draft.reading_word, unit, draft.reading_place),
    ]
    if draft.reading_place == "column":
        names.append(draft.unit_header)
    if "row" not in (draft.reading_place, draft.angle_place):
        return [names]
    units = ["", ""]
    if draft.angle_place == "row":
        units[0] = draft.angle_unit
    if draft.reading_place == "row":
        units[1] = unit
    brackets = pick(draft.random, ("{}", "[{}]", "({})"))
    units = [brackets.format(text) if text else "" for text in units]
    return [names, [*units, *names[2:]]]


def _one_file_each(
    draft: _Draft, circles: Sequence[WrittenCircle]
) -> tuple[dict[str, bytes], list[WrittenCircle]]:
    """Return a file for each circle, and the circles with the names of the files."""
    force_line = pick(draft.random, FORCE_LINES)
    force_word = pick(draft.random, ("Force", "Kraft", "Load"))
    if draft.force_place == "column":
        draft.is_unit_of_force_stated = chance(draft.random, 0.7)
    files = {}
    named = []
    for k, written in enumerate(circles):
        force = f"{written.force:.7g}"
        name = f"c{k}"
        if draft.force_place == "name":
            name = f"{force} {draft.force_unit}"
        file = f"{name}{draft.name_addition}.csv"
        unit = draft.unit_of(k)
        lines = list(draft.above)
        if draft.unit_line:
            lines.append(draft.unit_line.format(u=unit))
        force = force.replace(".", draft.decimal)
        if draft.force_place == "line":
            lines.append(force_line.format(f=force, u=draft.force_unit, s=draft.separator))
        lines += _rows_of_one_circle(draft, written, unit, force, force_word)
        files[file] = _text(lines)
        named.append(replace(written, name=file))
    return files, named


def _rows_of_one_circle(
    draft: _Draft, written: WrittenCircle, unit: str, force: str, force_word: str
) -> list[str]:
    """Return header and rows of one circle, with columns of its force and radius if chosen."""
    heads = _heads(draft, unit)
    last_cells = []
    if draft.force_place == "column":
        place = "brackets" if draft.is_unit_of_force_stated else "nowhere"
        heads[0].append(_header(force_word, draft.force_unit, place))
        last_cells.append(force)
    if draft.radius_column:
        heads[0].append(draft.radius_column)
        radius = draft.with_radius(RADIUS_COLUMNS[draft.radius_column])
        last_cells.append(radius.replace(".", draft.decimal))
    lines = [draft.separator.join(cells) for cells in heads]
    for j in range(len(written.angle)):
        cells = [*_row_of_cells(draft, written, j, unit), *last_cells]
        lines.append(draft.separator.join(cells))
    return lines


def _long_rows(draft: _Draft, circles: Sequence[WrittenCircle]) -> list[str]:
    """Return a table with a row for each reading of all circles."""
    heads = _heads(draft, draft.reading_unit)
    heads[0].insert(0, "test")
    if len(heads) > 1:
        heads[1].insert(0, "")
    rows = [draft.separator.join(cells) for cells in heads]
    for k, written in enumerate(circles):
        for j in range(len(written.angle)):
            cells = _row_of_cells(draft, written, j, draft.unit_of(k))
            rows.append(draft.separator.join([written.name, *cells]))
    return rows


def _wide_rows(draft: _Draft, circles: Sequence[WrittenCircle]) -> list[str]:
    """Return a table with one column of angles and one of readings for each circle."""
    names = [_header(draft.angle_word, draft.angle_unit, draft.angle_place)]
    units = [draft.angle_unit if draft.angle_place == "row" else ""]
    for written in circles:
        force = f"{written.force:g} N"
        names.append(_header(f"{draft.reading_word} {force}", draft.reading_unit, ""))
        if draft.reading_place in HEADERS:
            names[-1] = _header(
                f"{draft.reading_word} {force}", draft.reading_unit, draft.reading_place
            )
        units.append(draft.reading_unit if draft.reading_place == "row" else "")
    rows = [draft.separator.join(names)]
    if any(units):
        rows.append(draft.separator.join(units))
    unit = draft.reading_unit if draft.reading_place in ("cells", "column") else ""
    for j in range(len(circles[0].angle)):
        cells = [draft.number(circles[0].angle[j], 7)]
        if draft.angle_place == "cells":
            cells[0] += f" {draft.angle_unit}"
        for written in circles:
            cells.append(f"{draft.number(written.reading[j], 9)} {unit}".strip())
        rows.append(draft.separator.join(cells))
    return rows


def _workbook(
    draft: _Draft, circles: Sequence[WrittenCircle], lines: Sequence[str]
) -> dict[str, bytes]:
    """Return a workbook with a sheet for each circle, its unit in the number format of cells."""

    def fill(book: field.Workbook) -> None:
        for written in circles:
            sheet = book.create_sheet(written.name)
            for line in lines:
                sheet.append([line])
            for cells in _heads(draft, draft.reading_unit):
                sheet.append(cells)
            for j in range(len(written.angle)):
                sheet.append([float(written.angle[j]), float(written.reading[j])])
                cell = sheet.cell(sheet.max_row, 2)
                cell.number_format = f'0.000000" {draft.reading_unit}"'
                if draft.angle_place == "cells":
                    angle = sheet.cell(sheet.max_row, 1)
                    angle.number_format = f'0.000000" {draft.angle_unit}"'

    return {"m.xlsx": field.workbook(fill)}
