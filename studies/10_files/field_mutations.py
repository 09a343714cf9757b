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
)
DIAMETER_LINES = (
    "Values: diameter deviations",
    "Messwerte: Durchmesser",
    "Readings are of the diameter",
    "Output: diametral",
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
}
# Places in a header where a word that is no unit is a word of the header.
_BARE = ("no brackets", "slash", "comma", "underscore", "nameless column")
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
)
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
}
ANGLE_ADDITIONS = {
    " from Y clockwise": (90.0, -1),
    " cw": (0.0, -1),
    " (from -X; ccw)": (180.0, 1),
    " from +Y cw": (90.0, -1),
    " clockwise from Y": (90.0, -1),
    " ab Y im UZS": (90.0, -1),
    " CW+": (0.0, -1),
}
SIGN_LINES = (
    "Positive reading: bar shorter",
    "Sign: + means shorter",
    "Vorzeichen: positiv = kürzer",
    "Positive values mean a shorter bar",
    "Readings count positive inwards",
)
DIRECTION_LINES = {
    "Direction: CW": "CW",
    "Direction: counterclockwise": "CCW",
    "Drehrichtung: im Uhrzeigersinn": "CW",
    "Umlaufsinn: gegen den Uhrzeigersinn": "CCW",
    "Direction of travel: clockwise": "CW",
    "Run: CCW": "CCW",
    "Measured clockwise": "CW",
    "Sens horaire": "CW",
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

    what: str
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
    angle = meaning.sense * written.angle * meaning.deg_per_angle + meaning.zero_deg
    return Circle(
        written.force * meaning.N_per_force,
        np.mod(np.round(angle, 3), 360.0),
        meaning.sign * reading,
        meaning.radius_mm,
        meaning.direction,
    )


def _written(circle: Circle, name: str, meaning: Meaning) -> WrittenCircle:
    """Return the numbers that a file holds for a circle, rounded as they are written."""
    reading = meaning.sign * circle.reading_um
    if meaning.is_distance:
        reading = reading + 1e3 * meaning.radius_mm
    if meaning.is_diameter:
        reading = 2.0 * reading
    angle = np.mod(meaning.sense * (circle.angle_deg - meaning.zero_deg), 360.0)
    return WrittenCircle(
        name,
        float(f"{circle.force_N / meaning.N_per_force:.7g}"),
        np.round(angle / meaning.deg_per_angle, 7),
        np.round(reading / meaning.um_per_reading, 9),
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

    def add_line(self, lines: Sequence[str] | Mapping[str, object], unit: str = "") -> str:
        """Put one of the lines above the table, with the radius or a unit, and return it."""
        line = pick(self.random, lines)
        radius = self.meaning.radius_mm
        self.above.append(
            line.format(
                r=f"{radius:g}",
                d=f"{2.0 * radius:g}",
                ri=f"{radius / 25.4:.9f}",
                cm=f"{radius / 10.0:g}",
                m=f"{radius / 1e3:g}",
                s=self.separator,
                u=unit,
            )
        )
        return line

    def number(self, value: float, digits: int) -> str:
        return f"{value:.{digits}f}".replace(".", self.decimal)

    def unit_of(self, k: int) -> str:
        """Return the unit of the readings of circle k."""
        return self.changing_units[k] if self.changing_units else self.reading_unit

    def meaning_of(self, k: int) -> Meaning:
        size = READING_UNITS[self.unit_of(k)]
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
    _draw_angles(draft)
    _draw_circle(draft)
    draft.shape = pick(random, SHAPES)
    if draft.reading_place == "format":
        draft.shape = "workbook"
    if draft.shape == "files":
        draft.force_place = pick(random, FORCE_PLACES)
        draft.force_unit = pick(random, FORCE_UNITS)
        draft.meaning = replace(draft.meaning, N_per_force=FORCE_UNITS[draft.force_unit])
    if draft.shape != "wide" and draft.reading_place in ("line", "column", "cells", "brackets"):
        is_separate = draft.shape == "files" or draft.reading_place in ("column", "cells")
        if is_separate and chance(random, 0.15):
            draft.changing_units = [pick(random, READING_UNITS) for _ in TRUTH]
    return _files(draft)


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
    elif chance(random, 0.05):
        draft.meaning = replace(draft.meaning, sign=-1)
        draft.add_line(SIGN_LINES)


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
        draft.add_line(RADIUS_LINES)
    if draft.angle_place == "line":
        draft.add_line(ANGLE_UNIT_LINES, draft.angle_unit)
    random.shuffle(draft.above)


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


def _files(draft: _Draft) -> Mutation:
    """Return the files of a draft, as one for each circle, one table, or a workbook."""
    names = [f"{circle.force_N:g}N" for circle in TRUTH]
    circles = []
    for k, circle in enumerate(TRUTH):
        circles.append(_written(circle, names[k], draft.meaning_of(k)))
    unit_line = ""
    if draft.reading_place == "line":
        unit_line = pick(draft.random, READING_UNIT_LINES)
        if any(re.search(r"\d", unit) for unit in draft.changing_units or [draft.reading_unit]):
            unit_line = unit_line.replace("1 ", "")
        if "counts" in (*draft.changing_units, draft.reading_unit):
            unit_line = READING_UNIT_LINES[0]
    if draft.shape == "files":
        files, circles = _one_file_each(draft, circles, unit_line)
    else:
        lines = list(draft.above)
        if unit_line:
            lines.append(unit_line.format(u=draft.reading_unit))
        if draft.shape == "workbook":
            files = _workbook(draft, circles, lines)
        elif draft.shape == "long":
            files = {"all.csv": _text([*lines, *_long_rows(draft, circles)])}
        else:
            files = {"all.csv": _text([*lines, *_wide_rows(draft, circles)])}
    units = draft.changing_units or [draft.reading_unit]
    shown = [
        draft.shape,
        f"unit {'/'.join(units)!r} in {draft.reading_place}",
        f"angle {draft.angle_unit!r} in {draft.angle_place}",
        f"force {draft.force_unit} in {draft.force_place}",
        draft.reading_word,
        draft.angle_word,
        unit_line,
        *draft.above,
    ]
    return Mutation("; ".join(shown), files, circles, _stated(draft))


def _stated(draft: _Draft) -> frozenset[str]:
    """Return the subjects of notes on what the files of a draft state."""
    stated = set()
    units = draft.changing_units or [draft.reading_unit]
    is_unknown_word = any(unit in ("V", "furlong") for unit in units)
    place = draft.reading_place
    if place == "column" and not draft.unit_header:
        place = "nameless column"
    if place not in (*(_BARE if is_unknown_word else ()), "nowhere"):
        stated.add("unit of the reading")
    if draft.angle_place != "nowhere":
        stated.add("unit of the angle")
    if draft.is_unit_of_force_stated:
        stated.add("unit of the force")
    if draft.meaning.radius_mm != Meaning(1.0).radius_mm:
        stated.add("radius_mm")
    return frozenset(stated)


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
    draft: _Draft, circles: Sequence[WrittenCircle], unit_line: str
) -> tuple[dict[str, bytes], list[WrittenCircle]]:
    """Return a file for each circle, and the circles with the names of the files."""
    files = {}
    named = []
    force_line = pick(draft.random, FORCE_LINES)
    force_word = pick(draft.random, ("Force", "Kraft", "Load"))
    if draft.force_place == "column":
        draft.is_unit_of_force_stated = chance(draft.random, 0.7)
    for k, written in enumerate(circles):
        force = f"{written.force:.7g}"
        unit = draft.unit_of(k)
        lines = list(draft.above)
        if unit_line:
            lines.append(unit_line.format(u=unit))
        name = f"c{k}"
        if draft.force_place == "name":
            name = f"{force} {draft.force_unit}"
        force = force.replace(".", draft.decimal)
        if draft.force_place == "line":
            lines.append(force_line.format(f=force, u=draft.force_unit, s=draft.separator))
        heads = _heads(draft, unit)
        if draft.force_place == "column":
            place = "brackets" if draft.is_unit_of_force_stated else "nowhere"
            heads[0].append(_header(force_word, draft.force_unit, place))
        lines += [draft.separator.join(cells) for cells in heads]
        for j in range(len(written.angle)):
            cells = _row_of_cells(draft, written, j, unit)
            if draft.force_place == "column":
                cells.append(force)
            lines.append(draft.separator.join(cells))
        files[f"{name}.csv"] = _text(lines)
        named.append(replace(written, name=f"{name}.csv"))
    return files, named


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
