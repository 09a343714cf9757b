"""Files as they are found into a campaign: what they say is taken, what they leave open is assumed
and said; masks and laps."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import takewhile
from pathlib import Path, PureWindowsPath
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import PlainSerializer

from ldbb_bayes.campaign.campaign import (
    LABELS,
    PER_TEST,
    Campaign,
    CircularTest,
    ForceLaw,
    MountCompensation,
)
from ldbb_bayes.campaign.certificates import SUFFIX, BallbarRecord, read_b5r
from ldbb_bayes.campaign.preview import resolution_of
from ldbb_bayes.errors import InputError, placed, require
from ldbb_bayes.machine.chain import PLANES
from ldbb_bayes.reading import headers, spreadsheet
from ldbb_bayes.reading.headers import UNITS, WORDS, Assumption, Heading, Layout, Notes, Said
from ldbb_bayes.reading.spreadsheet import Sheet, numbers_of, read_sheets
from ldbb_bayes.results import Array, Result

__all__ = ["Imported", "import_campaign", "mask_angles", "mask_reversals", "matching"]

_TURN = 360.0
LARGEST_TESTS = 1000
_LONGEST_LIST = 200
_LONGEST_NAME = 100
# A wider span of angles is in degrees.
_LARGEST_SPAN_RAD = 7.0
# Readings whose median is the radius within this are distances of the balls: a bar measures no
# more; within this share, in mm.
_LARGEST_DEVIATION_MM = 1.5
_NEAR_RADIUS = 0.05
_SMALLEST_RADIUS_MM = 20.0
_LARGEST_IN_MM = 0.5
# A recording of more turns holds laps, or run-in and run-out.
_MORE_THAN_A_TURN = 1.02
# Arcs of which two make a circle; what may differ between them.
_HALF_DEG = (150.0, 240.0)
_OF_A_FILE = ("name", "time_s", "temperature_C")
# Steps of readings that a readout may have [µm], at most this share of their span.
_STEPS_UM = (0.001, 5.0)
_LARGEST_STEP = 0.1
# Shares by which a value may be rounded: in a line, in a name; and a force be off what the force
# law makes of its pressure.
_IN_LINE = 1e-3
_IN_NAME = 0.02
_OFF_LAW = 0.05
_UNIT = {"force_N": "N", "pressure_bar": "bar", "radius_mm": "mm", "feed_mm_per_min": "mm/min"}
_UNIT |= {"resolution_um": "µm"}
_LOADS = {"force_N": ("force", "forces_N"), "pressure_bar": ("pressure", "pressures_bar")}
# What lines above a table say of the campaign, and what says otherwise.
_OF_CAMPAIGN = {
    "plane": "--plane",
    "resolution_um": "--resolution-um",
    "mount": "--raw, --mount-um-per-bar",
}
_OF_CAMPAIGN |= {"feed_mm_per_min": "--feed-mm-per-min"} | {
    key: f"--{key.replace('_', '-')}" for key in LABELS
}
_OF_ALL = {*_OF_CAMPAIGN, "radius_mm", "temperature_C"}
# Of these each test may say its own; of people, places and instruments all are named.
_OF_EACH = ("plane", "date")
_OF_SEVERAL = ("operator", "place", "ball_bar", "force_device")
_MAY_DIFFER = (*_OF_SEVERAL, "ball_bar_calibrated", "feed_mm_per_min")
_SENSES = {word: way for way in ("CW", "CCW") for word in WORDS["directions"][way]}


def _option(key: str) -> str:
    return f"--{_LOADS[key][1] if key in _LOADS else key}".replace("_", "-")


def _sense(word: str) -> str:
    """CW or CCW, or the word itself."""
    return _SENSES.get(re.sub(r"(?<=\w)[-_ ](?:DE[NM][-_ ])?", "", word.upper()), word.upper())


@dataclass
class _Table:
    """The rows of one test, and everything that is said of it."""

    sheet: Sheet
    heading: Heading
    label: str  #: of its rows in the column of tests; empty where the whole sheet is one test
    lines: list[int]  #: of its rows in the file
    numbers: dict[str, Array]  #: by role, as the file has them
    words: Mapping[str, int]  #: in the column of directions, and where each first stands
    above: Mapping[str, Sequence[Said]]
    layout: Layout
    stated: dict[str, Any]  #: in a [[test]] of the layout
    campaign: Mapping[str, Any]  #: fields of the campaign that were given
    notes: Notes
    fields: dict[str, Any]  #: of the test, from columns that hold one value for it
    of_all: Sequence[tuple[str, str]]  #: lines of sheets left out that speak of all tests

    @property
    def place(self) -> str:
        """What a message calls it."""
        return f"{self.sheet.place}, test {self.label!r}" if self.label else self.sheet.place

    @property
    def own_name(self) -> str:
        """What the file calls it."""
        return self.label or self.sheet.own_name or self.sheet.path.stem

    @property
    def radius_mm(self) -> float:
        return float(self.fields.get("radius_mm") or self.campaign.get("radius_mm") or 150.0)

    def names(self) -> list[str]:
        """Of test, column, sheet and file."""
        column = (
            self.heading.headers[self.heading.roles["reading"]]
            if "reading" in self.heading.roles
            else ""
        )
        return [
            name for name in (self.label, column, self.sheet.name, self.sheet.path.stem) if name
        ]

    def note(self, what: str, value: str, because: str, option: str) -> None:
        self.notes.add(self.place, what, value, because, option)

    def given(self, key: str) -> Any:
        """As an option or the layout gives it, of the test before of all; None where neither
        does."""
        sources = (self.stated.get(key), getattr(self.layout, key, None), self.campaign.get(key))
        return next((value for value in sources if value is not None), None)

    def circle(self, loads: dict[str, float]) -> _Circle:
        """The fields of the circular test: load, direction, angles, readings, laps."""
        if loads:
            self.stated = {
                key: value for key, value in self.stated.items() if key not in _LOADS
            } | loads
        self.fields |= {
            key: value for key, value in self.stated.items() if key not in ("file", "start_deg")
        }
        if "name" not in self.fields:
            self.fields["name"] = self.name_of_file(self.own_name)
        self.fields["direction"] = self._direction()
        self.fields |= self._load()
        self.fields["radius_mm"] = self.quantity("radius_mm", self.fields.get("radius_mm"))
        angle = self._angle()
        reading = self._reading()
        with placed(self.place):
            angle, reading = self._laps(angle, reading)
        return _Circle(
            self,
            {key: value for key, value in self.fields.items() if value is not None},
            angle,
            reading,
        )

    def name_of_file(self, stem: str) -> str:
        """A test's name is a file's: signs that cannot stand in one are replaced."""
        name = re.sub(r"^[^\w+\-]|[^\w+\-. ]", "_", stem)[:_LONGEST_NAME]
        if name != stem:
            self.note("name of the test", name, "it names a file", "a [[test]] in --layout")
        return name

    def quantity(self, key: str, column: float | None = None) -> float | None:
        """A quantity of the test: by its column, as given, by the lines above the table, the name;
        None where none says it."""
        unit = _UNIT.get(key, "°")
        option = _option(key)
        named = headers.load_in_name(self.names(), key) if key in _LOADS else None
        radius = headers.radius_in_name(self.names()) if key == "radius_mm" else None
        first = [(column, "its column", _IN_LINE), (self.given(key), "as given", _IN_LINE)]
        first = first if key == "radius_mm" else first[::-1]
        sure = [
            (float(value), where, within) for value, where, within in first if value is not None
        ]
        said = [(own.value, f"line {own.line}", _IN_LINE) for own in self.above.get(key, ())]
        said += (
            [(named[1], f"the name {named[2]!r}", _IN_NAME)] if named and named[0] == key else []
        )
        said += [(radius, "its name", _IN_NAME)] if radius is not None else []
        if not (sure or said):
            return None
        (value, where, _), *others = sure + said
        if math.isnan(value):
            got = f"a mark in {where} that may stand between thousands"
            raise InputError(f"{self.place}: {key} must be one number, got {got}. Give {option}.")
        for other, there, within in others:
            if not (math.isnan(other) or np.isclose(other, value, rtol=within)):
                if not sure:
                    got = f"{value:g} {unit} in {where} and {other:g} {unit} in {there}"
                    raise InputError(
                        f"{self.place}: {key} must be said once, got {got}. Give {option}."
                    )
                self.note(
                    key, f"{value:g} {unit}, {where}", f"{there} says {other:g} {unit}", option
                )
        if not sure:
            above = self.above.get(key)
            self.note(
                key,
                f"{value:g} {unit}",
                where + (", no unit there" if above and not above[0].unit else ""),
                option,
            )
        return value

    def _direction(self) -> str | None:
        """CW or CCW: as given, by the words of its column, the lines above and names; None where
        none says it."""
        given: str | None = self.given("direction")
        lines = {_sense(word): line for word, line in self.words.items() if word}
        elsewhere = headers.directions_said(self.of_all, ())
        elsewhere = elsewhere if len(elsewhere) == 1 else set()  # both: not of one test
        said = set(lines) or headers.directions_said(self.heading.above, self.names()) or elsewhere
        if given is not None:
            if said - {given}:
                self.note(
                    "direction", f"{given}, as given", "the file says the other", "--direction"
                )
            return given
        if len(lines) > 1 or set(lines) - {"CW", "CCW"}:
            got = (
                "direction must be CW or CCW in all rows of a test, got"
                f" {', '.join(sorted(lines))[:60]!r}"
            )
            raise InputError(
                f"{self.place}, line {max(lines.values())}: {got}. Correct it, or give --direction."
            )
        got = "CW and CCW above the table or in names"
        require(
            len(said) <= 1,
            f"{self.place}: direction must be said once, got {got}. Give --direction.",
        )
        direction = next(iter(said), None)
        if direction and not lines:
            self.note("direction", direction, "a line above the table, or the name", "--direction")
        return direction

    def _load(self) -> dict[str, float]:
        """Force, pressure, or both."""
        given = any(self.given(key) is not None for key in _LOADS)
        found = {key: self.quantity(key, None if given else self._one_value(key)) for key in _LOADS}
        loads = {key: value for key, value in found.items() if value is not None}
        got = "got neither from a column, the lines above the table or the name"
        got += f" (which number does {self.own_name!r} mean?)" * headers.load_is_ambiguous(
            self.names()
        )
        cure = (
            "Give --forces-N or --pressures-bar, one for each test in the order of files and"
            " sheets, or a [[test]] in --layout"
        )
        require(loads, f"{self.place}: force or pressure must be known, {got}. {cure}.")
        return loads

    def _one_value(self, key: str) -> float | None:
        """The one value of a column of loads."""
        role = _LOADS[key][0]
        unit = _UNIT[key]
        if role not in self.numbers:
            return None
        values = self.numbers[role] * self._unit(role, unit)
        changed = np.flatnonzero(
            np.abs(values - values[0]) > 1e-9 * max(float(np.abs(values).max()), 1.0)
        )
        if changed.size:
            got = (
                f"{role} must be the same in all rows of a test, got {values.min():g} to"
                f" {values.max():g} {unit}"
            )
            cure = (
                "Name the test of each row in a column (--test-column), or give the nominal value"
                f" ({_option(key)})"
            )
            raise InputError(f"{self.place}, line {self.lines[changed[0]]}: {got}. {cure}.")
        return float(values[0])

    def _unit(self, role: str, default: str, because: str = "no unit in the header") -> float:
        """Of one unit in ours: the unit that was given, else the one the header names, else the
        default, told."""
        header: str = self.heading.units[self.heading.roles[role]]
        given: str | None = getattr(self.layout, f"{role}_unit")
        named = given or header
        option = "--unit" if role == "reading" else f"--{role}-unit"
        if (named or default) not in UNITS[role]:
            got = (
                f"the {role} must be in {', '.join(UNITS[role])}, got {named[:40]!r} in line"
                f" {self.heading.line}"
            )
            raise InputError(f"{self.place}: {got}. Correct the header, or give {option}.")
        if not named:
            self.note(f"unit of the {role}", default, because, option)
        elif header not in ("", named):
            self.note(
                f"unit of the {role}",
                f"{named}, as given",
                f"line {self.heading.line} says {header}",
                option,
            )
        self.notes.keep(**{f"{role}_unit": None if header else named or default})
        return UNITS[role][named or default]

    def _column(self, role: str, what: str) -> Array:
        if role not in self.numbers:
            seen = (
                f"{', '.join(map(repr, self.heading.headers))[:_LONGEST_LIST]} in line"
                f" {self.heading.line}"
            )
            raise InputError(
                f"{self.place}: a column must hold the {what}, got {seen}. Say which:"
                f" --{role}-column."
            )
        return self.numbers[role]

    def _angle(self) -> Array:
        """Angle of every reading, as the plane counts it, shape (n,) [deg]."""
        if "angle" not in self.numbers and "time" in self.numbers:
            return self._from_time()
        raw = self._column("angle", "angle, or the time")
        span = float(np.ptp(raw))
        unit = self._unit(
            "angle", "deg" if span > _LARGEST_SPAN_RAD else "rad", f"it spans {span:.4g}"
        )
        return np.unwrap(
            self.layout.angle_sign * (raw * unit - self.layout.angle_offset_deg), period=_TURN
        )

    def _from_time(self) -> Array:
        feed = self.quantity("feed_mm_per_min")
        if feed is None or not feed > 0.0:
            raise InputError(
                f"{self.place}: a log over time must come with its feed, got none. Give"
                " --feed-mm-per-min."
            )
        where = {}
        for key in ("start_deg", "overshoot_deg"):
            value = self.quantity(key)
            if value is None:
                self.note(key, "0°", "nothing says otherwise", _option(key))
            where[key] = value or 0.0
        self.note(
            "feed", "constant from the first reading on", "a log holds no more", "--overshoot-deg"
        )
        if self.fields["direction"] is None:
            self.note("direction", "CCW", "none stated", "--direction")
            self.fields["direction"] = "CCW"
        back = np.flatnonzero(np.diff(self.numbers["time"]) <= 0.0)
        if back.size:
            line = self.lines[back[0] + 1]
            raise InputError(
                f"{self.place}, line {line}: time must increase from row to row. Sort or split the"
                " log."
            )
        sense = -1 if self.fields["direction"] == "CW" else 1
        with placed(self.place):
            time_s = self.numbers["time"] * self._unit("time", "s")
            angle = angles_from_time(
                time_s, feed_mm_per_min=feed, radius_mm=self.radius_mm, sense=sense, **where
            )
        kept = on_the_circle(angle, start_deg=where["start_deg"], sense=sense)
        if not kept.all():
            left = f"{np.count_nonzero(~kept)} readings left out"
            self.note("run-in and run-out", left, "outside whole turns", "--overshoot-deg")
        self.numbers = {role: values[kept] for role, values in self.numbers.items()}
        return angle[kept]

    def _reading(self) -> Array:
        """Actual ball distance − R, shape (n,) [µm]."""
        raw = self._column("reading", "reading")
        got = f"the reading must change from row to row, got {raw[0]:g} in all"
        require(
            np.ptp(raw) > 0.0, f"{self.place}: {got}. Say which column it is: --reading-column."
        )
        largest = float(np.abs(raw).max())
        by_radius = abs(np.median(raw) / self.radius_mm - 1.0) < _NEAR_RADIUS
        usual = "mm" if by_radius or largest < _LARGEST_IN_MM else "um"
        reading = raw * self._unit("reading", usual, f"the largest is {largest:.4g}")
        # Distances on another radius are no deviations of this one.
        median_mm = float(np.median(reading)) * 1e-3
        scatter_mm = float(np.median(np.abs(reading - 1e3 * median_mm))) * 1e-3
        near = abs(median_mm - self.radius_mm) < _LARGEST_DEVIATION_MM
        far = median_mm > _SMALLEST_RADIUS_MM and scatter_mm < 0.01 * median_mm
        given = self.layout.zero
        if {"distance": not near, "deviation": far, None: far and not near}[given]:
            got = (
                f"got {median_mm:.5g} mm{f' as {given} (--zero)' if given else ''}. Give"
                " --radius-mm, or --unit, or --zero."
            )
            raise InputError(
                f"{self.place}: readings must be deviations from {self.radius_mm:g} mm, or"
                f" distances near it, {got}"
            )
        zero = given or ("distance" if near else "deviation")
        if given is None:
            self.notes.keep(zero=zero)
        if zero == "distance" and given is None:
            why = f"its median is {median_mm:.4g} mm"
            self.note(
                "reading", f"distance of the balls, {self.radius_mm:g} mm subtracted", why, "--zero"
            )
        return self.layout.sign * (
            reading - 1e3 * self.radius_mm if zero == "distance" else reading
        )

    def _laps(self, angle: Array, reading: Array) -> tuple[Array, Array]:
        if len(angle) < 2:
            return angle, reading
        travel = direction_run(angle)
        stated = self.fields.get("direction")
        if stated and travel not in (None, stated):
            self.note(
                "direction",
                f"{stated}, as stated",
                f"the angles run {travel}: taken as sorted",
                "--direction",
            )
        # A full circle whose last reading stands one step before the first is one.
        laps = float(abs(angle[-1] - angle[0]) + np.median(np.abs(np.diff(angle)))) / _TURN
        if laps < _MORE_THAN_A_TURN or self.layout.laps == "keep":
            return angle, reading
        if self.layout.laps == "average":
            return average_laps(angle, reading)
        self.note("laps", f"all {laps:.2f} kept in one test", "longer than a turn", "--laps")
        self.notes.keep(laps="keep")
        return angle, reading


@dataclass
class _Circle:
    """A circular test as its file has it, before it is one: half of it may stand in another."""

    table: _Table
    fields: dict[str, Any]
    angle_deg: Array
    reading_um: Array

    def test(self) -> CircularTest:
        with placed(self.table.sheet.place):
            return CircularTest(angle_deg=self.angle_deg, reading_um=self.reading_um, **self.fields)

    @property
    def arc_deg(self) -> float:
        return float(np.ptp(self.angle_deg))

    def completed_by(self, other: _Circle) -> bool:
        """Whether both are arcs of one force and direction, run the same way, that together make a
        circle."""
        mine, theirs = (
            {k: v for k, v in own.fields.items() if k not in _OF_A_FILE} for own in (self, other)
        )
        ways = [own.angle_deg[-1] > own.angle_deg[0] for own in (self, other)]
        arcs = all(_HALF_DEG[0] <= own.arc_deg <= _HALF_DEG[1] for own in (self, other))
        if not arcs or mine != theirs or ways[0] != ways[1]:
            return False
        around = np.sort(np.mod(np.concatenate([self.angle_deg, other.angle_deg]), _TURN))
        largest = float(np.diff(np.append(around, around[0] + _TURN)).max())
        return largest <= 3.0 * max(
            float(np.median(np.abs(np.diff(own.angle_deg)))) for own in (self, other)
        )

    def joined(self, other: _Circle) -> _Circle:
        """Both as one test, its angles running on."""
        on = other.angle_deg + _TURN * round((self.angle_deg[-1] - other.angle_deg[0]) / _TURN)
        names = [str(own.fields["name"]) for own in (self, other)]
        alike = "".join(
            a for a, _ in takewhile(lambda pair: pair[0] == pair[1], zip(*names, strict=False))
        )
        name = alike.rstrip(" _-.,+(") or names[0]
        because = "of one force and direction, together they make a circle"
        self.table.notes.add(
            "",
            "half circles",
            f"{names[0]!r} and {names[1]!r} are one test",
            because,
            "setup of a [[test]] in --layout",
        )
        angle = np.concatenate([self.angle_deg, on])
        reading = np.concatenate([self.reading_um, other.reading_um])
        return replace(
            self, fields=self.fields | {"name": name}, angle_deg=angle, reading_um=reading
        )


def _stitched(circles: Sequence[_Circle]) -> list[_Circle]:
    """Circles, two halves of one joined where the first stands."""
    left = list(circles)
    made = []
    while left:
        first = left.pop(0)
        half = next((k for k, own in enumerate(left) if first.completed_by(own)), None)
        made.append(first if half is None else first.joined(left.pop(half)))
    return made


def _tests_in(
    sheet: Sheet,
    heading: Heading,
    layout: Layout,
    campaign: Mapping[str, Any],
    notes: Notes,
    left_out: Sequence[Sheet],
) -> Iterator[_Table]:
    """The tests of one sheet, in the order of their first rows; with what the sheets left out say
    of them."""
    rows = sheet.rows[heading.first :]
    while rows and not any(
        spreadsheet.looks_like_number(cell) or spreadsheet.is_missing(cell) for cell in rows[-1][1]
    ):
        rows.pop()  # what is no row of numbers may only stand below the table
    lines, columns = spreadsheet.columns_of(sheet.place, rows, len(heading.headers))
    headers.note_heading(sheet, heading, layout, notes)
    numeric = {
        role: c for role, c in heading.roles.items() if role not in ("test", "direction", "reading")
    }
    clock = (
        numeric.pop("time")
        if "time" in numeric and spreadsheet.is_clock(columns[numeric["time"]][0])
        else None
    )
    decimal = _decimal(
        sheet, lines, [columns[c] for c in (*numeric.values(), *heading.readings)], layout, notes
    )
    numbers = {
        role: numbers_of(sheet.place, heading.column(role, c), lines, columns[c], decimal)
        for role, c in numeric.items()
    }
    if clock is not None:
        if layout.time_unit not in (None, "s"):
            raise InputError(
                f"{sheet.place}: times of day have no unit, got {layout.time_unit!r}. Leave"
                " --time-unit out."
            )
        numbers["time"] = spreadsheet.seconds_of(sheet.place, lines, columns[clock])
        heading.units[clock] = "s"
    labels = columns[heading.roles["test"]] if "test" in heading.roles else [""] * len(lines)
    if "test" in heading.roles and "" in labels:
        got = f"line {lines[labels.index('')]}: rows must name their test, got none"
        raise InputError(f"{sheet.place}, {got}. Complete or remove the line.")
    groups: dict[str, list[int]] = {}
    for k, label in enumerate(labels):
        groups.setdefault(label, []).append(k)
    per_test = _per_test(sheet, heading, columns, labels, notes)
    for own in heading.each():
        for c in own.readings:
            numbers["reading"] = numbers_of(
                sheet.place, heading.column("reading", c), lines, columns[c], decimal
            )
        for label, mine in groups.items():
            at = [lines[k] for k in mine]
            name = label or own.label
            words = (
                {columns[own.roles["direction"]][k]: lines[k] for k in reversed(mine)}
                if "direction" in own.roles
                else {}
            )
            several = len(mine) < len(lines) or len(heading.readings) > 1 or bool(sheet.own_name)
            stated = _stated(sheet, name, layout, several)
            fields = {
                key: spreadsheet.constant(
                    sheet.place, name, key, at, [columns[c][k] for k in mine], decimal
                )
                for key, c in per_test.items()
            }
            part = {role: values[mine] for role, values in numbers.items()}
            of_all, of_one = headers.said_elsewhere(
                left_out, [label or sheet.name or sheet.path.stem, sheet.path.name]
            )
            all_said = {
                key: said for key, said in headers.said_above(of_all).items() if key in _OF_ALL
            }
            heard = replace(own, above=[*own.above, *of_one])
            above = all_said | headers.said_above(heard.above)
            yield _Table(
                sheet,
                heard,
                name,
                at,
                part,
                words,
                above,
                layout,
                stated,
                campaign,
                notes,
                fields,
                of_all,
            )


def _names(sheet: Sheet, label: str) -> list[str]:
    """By which a [[test]] of the layout may call a test."""
    return [
        name
        for name in (
            label,
            sheet.own_name,
            sheet.path.name,
            sheet.path.stem,
            str(sheet.path),
            sheet.name,
        )
        if name
    ]


def _stated(sheet: Sheet, label: str, layout: Layout, several: bool) -> dict[str, Any]:
    """What the layout says of a test, by any of its names, the first of them before the others."""
    names = _names(sheet, label)
    of_file = [
        entry
        for entry in layout.test
        if entry.file in names and entry.file not in (label, sheet.own_name)
    ]
    if several and any(entry.force_N or entry.pressure_bar for entry in of_file):
        cure = "Give --forces-N with one for each, a [[test]] for each in --layout, or a column"
        raise InputError(
            f"{sheet.place}: a force or pressure given for the file must be of one test, got"
            f" several in it. {cure}."
        )
    entries = sorted(
        (own for own in layout.test if own.file in names), key=lambda own: -names.index(own.file)
    )
    return {key: value for entry in entries for key, value in entry.stated().items()}


def _per_test(
    sheet: Sheet,
    heading: Heading,
    columns: Sequence[Sequence[str]],
    labels: Sequence[str],
    notes: Notes,
) -> dict[str, int]:
    """Columns that hold one value for each test; times and temperatures of every reading are left
    out, and told."""
    found = {
        header: c
        for c, header in enumerate(heading.headers)
        if header in PER_TEST and c not in heading.roles.values()
    }
    for header in sorted(set(found) & {"time_s", "temperature_C"}):
        if len(set(zip(labels, columns[found[header]], strict=True))) > len(set(labels)):
            notes.add(
                sheet.place,
                "columns not used",
                header,
                "it changes within a test",
                "a [[test]] in --layout",
            )
            del found[header]
    return found


def _decimal(
    sheet: Sheet,
    lines: Sequence[int],
    columns: Sequence[Sequence[str]],
    layout: Layout,
    notes: Notes,
) -> str | None:
    """The decimal mark, as given or found out; told where it may be another."""
    cells = [(line, column[k]) for k, line in enumerate(lines) for column in columns]
    decimal = layout.decimal or spreadsheet.decimal_mark(sheet.place, cells)
    marked = [cell for _, cell in cells if decimal and decimal in cell]
    other = "," if decimal == "." else "."
    if layout.decimal is not None:
        if not marked and any(other in cell for _, cell in cells):
            why = f"cells have {other!r} alone: thousands"
            notes.add(sheet.place, "decimal mark", f"{decimal}, as given", why, "--decimal")
    elif decimal:
        notes.keep(decimal=decimal)
        doubtful = all(spreadsheet.could_be_thousands(cell) for cell in marked)
        if doubtful or decimal == ",":
            why = (
                "thousands are as likely: three digits behind each"
                if doubtful
                else "no cell has a point"
            )
            notes.add(sheet.place, "decimal mark", decimal, why, "--decimal")
    return decimal


_Summary = Annotated[
    Campaign,
    PlainSerializer(
        lambda own: {"name": own.name, "tests": len(own.tests), "readings": own.readings}
    ),
]
_Given = Annotated[
    Layout, PlainSerializer(lambda own: own.model_dump(by_alias=True, exclude_none=True))
]


@dataclass(frozen=True, eq=False)
class Imported(Result):
    """A campaign from files, with everything that was assumed."""

    schema: int = field(default=1, init=False)  #: edition
    campaign: _Summary  #: in JSON its name and numbers of tests and readings
    #: with what was found out filled in: reading the same files with it guesses nothing of them
    layout: _Given
    assumptions: tuple[Assumption, ...]  #: with the option that changes each
    #: fields of the campaign for which the usual value was taken, as nothing says another
    unsaid: tuple[str, ...]
    records: tuple[BallbarRecord, ...] = ()  #: of Renishaw's files among them


def import_campaign(
    files: Sequence[str | os.PathLike[str]] | str | os.PathLike[str],
    *,
    layout: Layout | None = None,
    **campaign: Any,
) -> Imported:
    """Read tables as they are found into one campaign.

    Each of ``files`` (CSV or text of any kind) or sheet of a workbook (XLSX, XLS, ODS) is one test,
    or holds a column that names the test of each row; a .b5r file is kept as a record. What the
    layout does not say is found out and told; other arguments are fields of `Campaign`. An
    `InputError` names the file, the line and the cure.
    """
    layout = layout or Layout()
    notes = Notes()
    given = [files] if isinstance(files, str | os.PathLike) else files
    paths = matching(given)
    named = {Path(file) for file in given}
    records = tuple(read_b5r(path) for path in paths if path.suffix.lower() == SUFFIX)
    paths = [path for path in paths if path.suffix.lower() != SUFFIX]
    got = (
        f"got {given[0]} alone: how a {SUFFIX} file writes its trace is described nowhere in public"
    )
    require(
        paths, f"files must hold readings, {got}. Export the trace as text, and name that file too."
    )
    tests: list[CircularTest] = []
    tables: list[_Table] = []
    read = partial(
        read_sheets, encoding=layout.encoding, separator=layout.separator, sheets=layout.sheets
    )
    sheets = [sheet for path in paths for sheet in read(path)]
    found, left_out = headers.find_headings(sheets, layout, notes, set(paths) - named)
    for sheet, heading in found:
        tables += list(_tests_in(sheet, heading, layout, campaign, notes, left_out))
        if len(tables) > LARGEST_TESTS:
            raise InputError(
                f"{sheet.path}: a campaign must have at most {LARGEST_TESTS} tests, got more."
                " Import fewer at once."
            )
    loads = {key: values for key, (_, name) in _LOADS.items() if (values := getattr(layout, name))}
    for key, values in loads.items():
        listed = ", ".join(table.own_name for table in tables)[:_LONGEST_LIST]
        got = (
            f"{_option(key)} must hold one number for each test, got {len(values)} for"
            f" {len(tables)} tests ({listed})"
        )
        require(len(values) == len(tables), f"{got}. Give all, in the order of files and sheets.")
    _take_said(campaign, tables)
    circles = _stitched(
        [
            table.circle({key: own[k] for key, own in loads.items()})
            for k, table in enumerate(tables)
        ]
    )
    for test, table in ((circle.test(), circle.table) for circle in circles):
        if table.label and test.name in [own.name for own in tests]:
            name = table.name_of_file(
                f"{table.sheet.own_name or table.sheet.path.stem} {test.name}"
            )
            table.note(
                "name of the test",
                name,
                f"{test.name!r} stands elsewhere too",
                "a [[test]] in --layout",
            )
            test = replace(test, name=name)
        tests.append(test)
    names = [test.name for test in tests]
    twice = next((name for k, name in enumerate(names) if name in names[:k]), None)
    got = (
        f"{', '.join(map(str, paths))[:_LONGEST_LIST]}: tests must bear different names, got"
        f" {twice!r} twice."
    )
    require(
        twice is None,
        f"{got} A file or sheet named twice? Else rename one, or give it a name in a [[test]] of"
        " --layout.",
    )
    used = {name for table in tables for name in _names(table.sheet, table.label)}
    for entry in layout.test:
        if entry.file not in used:
            notes.add(
                "",
                "[[test]] not used",
                entry.file[:_LONGEST_LIST],
                "no file, sheet or label of that name",
                "--layout",
            )
    _take_resolution(campaign, tests, notes)
    for key, said in headers.said_above(tables[0].of_all).items():
        for own in said if key in _LOADS else ():
            why = (
                f"line {own.line} says {own.value:g} {key.partition('_')[2]} outside the list of"
                " tests"
            )
            notes.add("", key, "taken for no test", why, _option(_LOADS[key][1]))
    unsaid = _note_machine(campaign, tests, notes, headers.not_understood(tables[0].of_all))
    campaign.setdefault(
        "name", paths[0].stem if len(paths) == 1 else paths[0].resolve().parent.name or "campaign"
    )
    return Imported(
        Campaign(tuple(tests), **campaign), notes.layout(layout), notes.told(), unsaid, records
    )


def matching(files: Iterable[str | os.PathLike[str]]) -> list[Path]:
    """Return the files that are named: ``*`` and ``?`` stand for what they match, as not every
    shell sees to, in natural order. Backslashes may separate folders; hidden files, and those that
    a spreadsheet has open (``~$``), match nothing."""
    found: list[Path] = []
    for given in files:
        text = os.fspath(given).strip('"')
        windows = PureWindowsPath(text)
        path = Path(text)
        path = (
            Path(*windows.parts) if "\\" in text and not (windows.anchor or path.exists()) else path
        )
        wild = next((k for k, part in enumerate(path.parts) if set("*?") & set(part)), None)
        if wild is None or path.exists():
            found.append(path)
            continue
        above = Path(*path.parts[:wild])
        pattern = "/".join(path.parts[wild:]).replace("[", "[[]")
        matches = [own for own in above.glob(pattern) if not own.name.startswith((".", "~$"))]
        matches = sorted([own for own in matches if own.is_file()] or matches, key=_naturally)
        there = sorted(
            (own.name for own in above.glob("*") if not own.name.startswith((".", "~$"))),
            key=_naturally,
        )
        holds = f"{above} holds {', '.join(map(repr, there))[:_LONGEST_LIST] or 'nothing'}"
        cure = (
            f"got none: {holds if above.is_dir() else f'there is no folder {above}'}. Name the"
            " files, or correct the pattern"
        )
        require(matches, f"{text} must match a file, {cure}.")
        found += [own for own in matches if own not in found]
    require(found, "files must be given, got none. Name the tables to read.")
    return found


def _naturally(name: object) -> list[Any]:
    """For sorting: 2 N before 10 N."""
    return [
        int(part) if part.isdigit() else part
        for part in re.split(r"([0-9]+)", str(name).casefold())
    ]


def _take_said(campaign: dict[str, Any], tables: Sequence[_Table]) -> None:
    """Fill what nothing gives from lines above tables: plane and temperature of each test, the rest
    of all; the first date."""
    for key, option in _OF_CAMPAIGN.items():
        found: dict[Any, str] = {}
        for table in tables:
            lines = [own for own in table.above.get(key, ()) if own.value == own.value]
            said = {
                own.value if isinstance(own.value, str) else round(own.value, 9): f"line {own.line}"
                for own in lines
            }
            own = {
                value: line if " of " in line else f"{line} of {table.sheet.place}"
                for value, line in said.items()
            }
            if key == "plane" and (named := headers.plane_in_name(table.names())):
                said, own = ({named: "its name"} | lines for lines in (said, own))
            sure = table.stated.get(key) or table.fields.get(key) or table.given(key)
            if sure is not None:
                sure = (
                    ("raw", "compensated")[sure.compensated]
                    if isinstance(sure, MountCompensation)
                    else sure
                )
                own.pop(sure, None)
                got = f"{sure} as given and raw in {own.get('raw')}"
                require(
                    "raw" not in own,
                    f"{table.place}: {key} must be said once, got {got}. Correct the line, or give"
                    " --raw.",
                )
                for value in own:
                    table.note(key, f"{sure}, as given", f"{said[value]} says {value}", option)
                continue
            found |= own
            all_said = own if key in _OF_EACH else found
            several = len(all_said) > 1 and key not in _MAY_DIFFER
            if several or (key == "plane" and own.keys() - PLANES.keys()):
                must = "said once" if several else f"one of {', '.join(PLANES)}"
                got = " and ".join(f"{value} in {where}" for value, where in all_said.items())
                raise InputError(
                    f"{table.place}: {key} must be {must}, got {got}. Correct the lines, or give"
                    f" {option}."
                )
            for value in own:
                table.note(
                    key, f"{value:g} {_UNIT[key]}" if key in _UNIT else value, said[value], option
                )
                table.fields |= {key: value} if key == "plane" else {}
        if found and (
            key != "plane"
            or ({table.fields.get(key) for table in tables} == set(found) and len(found) == 1)
        ):
            _take(campaign, key, list(found))
    campaign.setdefault("machine_id", campaign.get("serial_number") or campaign.get("machine_type"))
    for table in tables:
        for heat in table.above.get("temperature_C", ())[:1]:
            if "temperature_C" not in table.stated and table.fields.get("temperature_C") is None:
                table.fields["temperature_C"] = heat.value
                table.note(
                    "temperature_C",
                    f"{heat.value:g} °C",
                    f"line {heat.line}",
                    "a [[test]] in --layout",
                )


def _take(campaign: dict[str, Any], key: str, found: list[Any]) -> None:
    """What was said of a field: of people, places and instruments all, of calibrations the last, of
    other dates the first."""
    if key == "mount":
        campaign[key] = MountCompensation(compensated=found == ["compensated"])
    elif key in _OF_SEVERAL:
        campaign[key] = ", ".join(found)
    elif key != "feed_mm_per_min" or len(found) == 1:
        campaign[key] = max(found) if key == "ball_bar_calibrated" else min(found)


def _take_resolution(campaign: dict[str, Any], tests: Sequence[CircularTest], notes: Notes) -> None:
    """The smallest step of the readings, where they have one that a readout may have."""
    if "resolution_um" in campaign:
        return
    steps = [(resolution_of(test.reading_um), float(np.ptp(test.reading_um))) for test in tests]
    likely = [
        step
        for step, span in steps
        if step and _STEPS_UM[0] <= step <= min(_STEPS_UM[1], _LARGEST_STEP * span)
    ]
    if likely and len(likely) == len(tests):
        campaign["resolution_um"] = float(f"{min(likely):.3g}")
        notes.add(
            "",
            "resolution_um",
            f"{campaign['resolution_um']:g} µm",
            "the smallest step of the readings",
            "--resolution-um",
        )


def _note_machine(
    campaign: Mapping[str, Any],
    tests: Sequence[CircularTest],
    notes: Notes,
    unclear: Mapping[str, str],
) -> tuple[str, ...]:
    """What the model needs to know of the machine and no table says, or not clearly: its fields are
    told."""
    unsaid = []
    law = ForceLaw()
    unclear = dict(unclear)
    for key, value, option in (
        ("topology", "wCAFYXZSt", "--topology"),
        ("plane", "XY", "--plane"),
        ("radius_mm", "150 mm", "--radius-mm"),
        ("resolution_um", "0.24 µm", "--resolution-um"),
        ("mount", "readings compensated for its deflection", "--raw"),
    ):
        if key not in campaign and not (
            key in ("radius_mm", "plane") and all(getattr(test, key) for test in tests)
        ):
            notes.add("", key, value, unclear.pop(key, "nothing says otherwise"), option)
            unsaid.append(key)
    for key, line in unclear.items():
        notes.add("", key, "not taken from there", line, _option(key))
    both = [(own.force_N, own.pressure_bar) for own in tests]
    apart = [
        (f, bar)
        for f, bar in both
        if f is not None and bar is not None and abs(law.force_N(bar) - f) > _OFF_LAW * abs(f)
    ]
    if apart and "force_law" not in campaign:
        said = ", ".join(f"{force:g} N at {bar:g} bar" for force, bar in apart)[:_LONGEST_LIST]
        by_law = ", ".join(f"{law.force_N(bar):.4g} N" for _, bar in apart)[:_LONGEST_LIST]
        notes.add(
            "",
            "force",
            said,
            f"of the pressures the force law makes {by_law}",
            "--force-slope, --force-offset",
        )
    if any(test.force_N is None for test in tests) and "force_law" not in campaign:
        words = f"{law.slope_N_per_bar:g} N/bar × pressure − {-law.offset_N:g} N"
        notes.add("", "force", words, "pressure alone is given", "--force-slope, --force-offset")
    return tuple(unsaid)


def mask_angles(test: CircularTest, arcs_deg: Sequence[tuple[float, float]]) -> CircularTest:
    """Return the test without the readings inside ``arcs_deg``, each counter-clockwise from start
    to end [deg], modulo 360°."""
    keep = np.ones(len(test.angle_deg), dtype=bool)
    for start, end in arcs_deg:
        if not (np.isfinite(start) and np.isfinite(end)):
            raise InputError(
                f"arcs_deg must be finite angles, got ({start}, {end}). Give start and end in"
                " degrees."
            )
        width = 360.0 if abs(end - start) >= 360.0 else np.mod(end - start, 360.0)
        keep &= np.mod(test.angle_deg - start, 360.0) > width
    require(
        keep.any(),
        f"arcs_deg must leave readings, got arcs that cover all of test {test.name!r}. Make them"
        " smaller.",
    )
    return test.select(keep)


def mask_reversals(test: CircularTest, half_width_deg: float = 5.0) -> CircularTest:
    """Return the test without the readings within ``half_width_deg`` of the axis reversal points
    0°, 90°, 180° and 270°."""
    require(
        0.0 < half_width_deg < 45.0,
        f"half_width_deg must lie between 0 and 45, got {half_width_deg}. Choose a few degrees.",
    )
    return mask_angles(
        test, [(q - half_width_deg, q + half_width_deg) for q in (0.0, 90.0, 180.0, 270.0)]
    )


def angles_from_time(
    time_s: Array,
    *,
    feed_mm_per_min: float,
    radius_mm: float,
    start_deg: float,
    overshoot_deg: float,
    sense: int,
) -> Array:
    """Angle of every reading of a log over time, shape (n,) [deg], not modulo 360°. The axes run at
    constant feed along the circle: θ(t) = start + sense · (feed (t − t0) / R − overshoot), with t0
    the first reading's time and sense 1 counter-clockwise, −1 clockwise. Acceleration at the ends
    is inside the overshoot, or neglected."""
    travelled = np.rad2deg(feed_mm_per_min / 60.0 / radius_mm) * (time_s - time_s[0])
    got = (
        f"{travelled[-1]:.1f}° at {feed_mm_per_min:g} mm/min on {radius_mm:g} mm. Check feed,"
        " radius and the unit of time"
    )
    enough = travelled[-1] >= overshoot_deg + 0.5 * _TURN
    require(enough, f"a log must cover the overshoot and half a turn, got {got}.")
    return start_deg + sense * (travelled - overshoot_deg)


def on_the_circle(angle_deg: Array, *, start_deg: float, sense: int) -> NDArray[np.bool_]:
    """Which readings of a log lie on the circle: from its start over whole turns, run-in and
    run-out left out. A turn may lack its closing reading. A log that ends before a turn is complete
    is an arc, kept to its end."""
    along = sense * (angle_deg - start_deg)
    step = float(np.median(np.diff(along)))
    turns = np.floor((along.max() + 1.5 * step) / _TURN)
    kept: NDArray[np.bool_] = (along > -0.5 * step) & (along < _TURN * max(1.0, turns) - 0.5 * step)
    return kept


def average_laps(angle_deg: Array, reading_um: Array) -> tuple[Array, Array]:
    """The mean of the whole laps at the angles of the first, later ones interpolated; readings
    beyond the last are left out."""
    once = np.concatenate([[True], np.diff(angle_deg) != 0.0])
    angle_deg = angle_deg[once]
    reading_um = reading_um[once]
    steps = np.diff(angle_deg)
    got = "angles must run in one direction for laps to be averaged, got changes of direction"
    require(np.all(steps > 0.0) or np.all(steps < 0.0), f"{got}. Keep the laps (--laps keep).")
    along = np.abs(angle_deg - angle_deg[0])
    step = float(np.median(np.abs(steps)))
    whole = int((along[-1] + 1.01 * step) // _TURN)
    got = f"a recording must hold two whole laps to be averaged, got {along[-1] / _TURN:.2f}"
    require(whole >= 2, f"{got}. Keep the laps (--laps keep).")
    first = along < _TURN - 1e-6 * step
    laps = [np.interp(along[first] + lap * _TURN, along, reading_um) for lap in range(whole)]
    return angle_deg[first], np.mean(laps, axis=0)


def direction_run(angle_deg: Array) -> str | None:
    """CW or CCW, as the angles run; None for less than half a turn. There and back is refused: two
    tests."""
    way = angle_deg - angle_deg[0]
    far = float(way[np.argmax(np.abs(way))])
    if abs(far) > 0.5 * _TURN and abs(far - way[-1]) > 0.5 * _TURN:
        cure = "Name the test of each row in a column (--test-column), or split the file."
        raise InputError(
            f"angles must run one way in a test, got {way[-1] - far:+.0f}° after {far:+.0f}°."
            f" {cure}"
        )
    return None if abs(far) <= 0.5 * _TURN else "CCW" if far > 0.0 else "CW"
