"""Files as they are found into a campaign: what they say is taken, what they leave open is assumed and said."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import PlainSerializer

from ldbb_bayes.campaign import headers, spreadsheet
from ldbb_bayes.campaign.campaign import PER_TEST, Campaign, CircularTest, ForceLaw
from ldbb_bayes.campaign.headers import Heading, Said, find_headings, load_in_name, note_heading, said_above
from ldbb_bayes.campaign.layout import UNITS, Assumption, Layout, Notes, in_ours
from ldbb_bayes.campaign.preparation import angles_from_time, average_laps, direction_run, on_the_circle
from ldbb_bayes.campaign.spreadsheet import Sheet, Unusable, numbers_of, read_sheets
from ldbb_bayes.errors import InputError, nearest, placed, require
from ldbb_bayes.result import Result

__all__ = ["Imported", "import_campaign"]

Array = NDArray[np.float64]
_TURN = 360.0
LARGEST_TESTS, _LONGEST_LIST, _LONGEST_NAME = 1000, 200, 100
# A wider span of angles is in degrees; a span of a turn in gon is that of 400.
_LARGEST_SPAN_RAD, _TURN_GON = 7.0, 400.0
# Readings whose median is the radius within this are distances of the balls: a bar measures no more; within this share, in mm.
_LARGEST_DEVIATION_MM, _NEAR_RADIUS, _SMALLEST_RADIUS_MM, _LARGEST_IN_MM = 1.5, 0.05, 20.0, 0.5
# A recording of more turns holds laps, or run-in and run-out.
_MORE_THAN_A_TURN = 1.02
# Shares by which force and pressure may miss the force law, and by which a value may be rounded: in a line, in a name.
_OFF_THE_LAW, _IN_LINE, _IN_NAME = 0.05, 1e-3, 0.02
_UNIT = {"force_N": "N", "pressure_bar": "bar", "radius_mm": "mm", "feed_mm_per_min": "mm/min"}
_LOADS = {"force_N": ("force", "forces_N"), "pressure_bar": ("pressure", "pressures_bar")}
_SENSES = {"CW": ("CLOCKWISE", "-", "G2", "G02"), "CCW": ("COUNTERCLOCKWISE", "ANTICLOCKWISE", "+", "G3", "G03")}


def _option(key: str) -> str:
    return f"--{_LOADS[key][1] if key in _LOADS else key}".replace("_", "-")


def _sense(word: str) -> str:
    """CW or CCW, or the word itself."""
    word = word.upper()
    return next((sense for sense, words in _SENSES.items() if re.sub(r"(?<=\w)[-_ ]", "", word) in words), word)


@dataclass
class _Table:
    """The rows of one test, and everything that is said of it."""

    sheet: Sheet
    heading: Heading
    label: str  # of its rows in the column of tests; empty where the whole sheet is one test
    lines: list[int]  # of its rows in the file
    numbers: dict[str, Array]  # by role, as the file has them
    words: Mapping[str, int]  # in the column of directions, and where each first stands
    above: Mapping[str, Sequence[Said]]
    layout: Layout
    stated: dict[str, Any]  # in a [[test]] of the layout
    campaign: Mapping[str, Any]  # fields of the campaign that were given
    notes: Notes
    fields: dict[str, Any]  # of the test, from columns that hold one value for it

    @property
    def place(self) -> str:
        """What a message calls it."""
        return f"{self.sheet.place}, test {self.label!r}" if self.label else self.sheet.place

    @property
    def radius_mm(self) -> float:
        return float(self.fields.get("radius_mm") or self.campaign.get("radius_mm") or 150.0)

    def names(self) -> list[str]:
        """Of test, column, sheet and file."""
        column = self.heading.headers[self.heading.roles["reading"]] if "reading" in self.heading.roles else ""
        return [name for name in (self.label, column, self.sheet.name, self.sheet.path.stem) if name]

    def note(self, what: str, value: str, because: str, option: str) -> None:
        self.notes.add(self.place, what, value, because, option)

    def given(self, key: str) -> Any:
        """As an option or the layout gives it, of the test before of all; None where neither does."""
        sources = (self.stated.get(key), getattr(self.layout, key, None), self.campaign.get(key))
        return next((value for value in sources if value is not None), None)

    def circle(self, loads: Mapping[str, float]) -> CircularTest:
        """The circular test: load, direction, angles, readings, laps."""
        if loads:
            self.stated = {key: value for key, value in self.stated.items() if key not in _LOADS} | dict(loads)
        self._note_against_columns()
        self.fields |= {key: value for key, value in self.stated.items() if key not in ("file", "start_deg")}
        if "name" not in self.fields:
            self.fields["name"] = self.name_of_file(self.label or self.sheet.own_name or self.sheet.path.stem)
        self.fields["direction"] = self._direction()
        self.fields |= self._load()
        if self.fields.get("radius_mm") is None:
            self.fields["radius_mm"] = self.quantity("radius_mm")
        angle, reading = self._angle(), self._reading()
        with placed(self.place):
            angle, reading = self._laps(angle, reading)
            fields = {key: value for key, value in self.fields.items() if value is not None}
            return CircularTest(angle_deg=angle, reading_um=reading, **fields)

    def _note_against_columns(self) -> None:
        """Where a [[test]] of the layout, or an option, and a column of the file differ."""
        for key, value in self.fields.items():
            if value is not None and self.stated.get(key, value) != value:
                self.note(key, f"{self.stated[key]}, as given", f"its column says {value}", "a [[test]] in --layout")
        for key, option in (("radius_mm", "--radius-mm"), ("plane", "--plane")):
            own, given = self.stated.get(key, self.fields.get(key)), self.campaign.get(key)
            if own and given and own != given:
                self.note(key, str(own), f"said of this test; {given} is for the others", option)
            above = next((said for said in self.above.get(key, ()) if own and not np.isclose(said.value, float(own))), None)
            if above is not None:
                self.note(key, f"{own}, as given", f"line {above.line} says {above.value:g}", option)

    def name_of_file(self, stem: str) -> str:
        """A test's name is a file's: signs that cannot stand in one are replaced."""
        name = re.sub(r"^[^\w+\-]|[^\w+\-. ]", "_", stem)[:_LONGEST_NAME]
        if name != stem:
            self.note("name of the test", name, "it names a file", "a [[test]] in --layout")
        return name

    def quantity(self, key: str, column: float | None = None) -> float | None:
        """A quantity of the test: as given, by its column, the lines above the table, the name; None where none says it."""
        unit, option = _UNIT.get(key, "°"), _option(key)
        given, above = self.given(key), self.above.get(key, ())
        said = [(own.value, f"line {own.line}", _IN_LINE) for own in above]
        named = load_in_name(self.names(), key) if key in _LOADS else None
        if named is not None and named[0] == key:
            said.append((named[1], f"the name {named[2]!r}", _IN_NAME))
        if given is not None and column is not None:
            said.insert(0, (column, "its column", _IN_LINE))
        first = given if given is not None else column
        if first is not None:
            how = "as given" if given is not None else "its column"
            for value, where, within in said:
                if not (math.isnan(value) or np.isclose(value, first, rtol=within)):
                    self.note(key, f"{first:g} {unit}, {how}", f"{where} says {value:g} {unit}", option)
            return float(first)
        unclear = next((where for value, where, _ in said if math.isnan(value)), None)
        if unclear is not None:
            got = f"a mark in {unclear} that may stand between thousands"
            raise InputError(f"{self.place}: {key} must be one number, got {got}. Give {option}.")
        for other, there, within in said[1:]:
            if not np.isclose(other, said[0][0], rtol=within):
                got = f"{said[0][0]:g} {unit} in {said[0][1]} and {other:g} {unit} in {there}"
                raise InputError(f"{self.place}: {key} must be said once, got {got}. Give {option}.")
        if not said:
            return None
        value, where, _ = said[0]
        self.note(key, f"{value:g} {unit}", where + (", no unit there" if above and not above[0].unit else ""), option)
        return value

    def _direction(self) -> str | None:
        """CW or CCW: as given, by the words of its column, the lines above and names; None where none says it."""
        given: str | None = self.given("direction")
        lines = {_sense(word): line for word, line in sorted(self.words.items(), key=lambda own: -own[1]) if word}
        senses, beside = set(lines), headers.directions_said(self.heading.above, self.names())
        said = senses or beside
        if given is not None:
            if said - {given}:
                self.note("direction", f"{given}, as given", "the file says the other", "--direction")
            return given
        if len(senses) > 1 or senses - {"CW", "CCW"}:
            got = f"direction must be CW or CCW in all rows of a test, got {', '.join(sorted(senses))[:60]!r}"
            raise InputError(f"{self.place}, line {max(lines.values())}: {got}. Correct it, or give --direction.")
        if len(said) > 1:
            got = "CW and CCW above the table or in names"
            raise InputError(f"{self.place}: direction must be said once, got {got}. Give --direction.")
        direction = next(iter(said), None)
        line = headers.direction_not_understood(self.heading.above)
        if direction is None and line is not None:
            self.note("direction", "none", f"line {line} is not understood", "--direction")
        elif direction and not senses:
            self.note("direction", direction, "a line above the table, or the name", "--direction")
        elif beside - senses:
            self.note("direction", f"{direction}, its column", "a line above or a name says the other", "--direction")
        return direction

    def _load(self) -> dict[str, float]:
        """Force, pressure, or both."""
        given = any(self.given(key) is not None for key in _LOADS)
        found = {key: self.quantity(key, self._one_value(key, may_change=given)) for key in _LOADS}
        loads = {key: value for key, value in found.items() if value is not None}
        if not loads:
            raise InputError(
                f"{self.place}: force or pressure must be known, got neither from a column, the lines above the table "
                f"or the name.{headers.loads_not_understood(self.heading.above)} "
                "Give --forces-N or --pressures-bar, one for each test in the order of files and sheets, or a "
                "[[test]] in --layout."
            )
        if len(loads) == 2:
            law = (self.campaign.get("force_law") or ForceLaw()).force_N(loads["pressure_bar"])
            if abs(law - loads["force_N"]) > _OFF_THE_LAW * max(law, loads["force_N"]):
                both = f"{loads['force_N']:g} N and {loads['pressure_bar']:g} bar"
                self.note("force and pressure", both, f"the force law gives {law:.0f} N", "--forces-N, --force-slope")
        return loads

    def _one_value(self, key: str, *, may_change: bool) -> float | None:
        """The one value of a column of loads; one that changes is left out, and told, where a load is given."""
        role, unit = _LOADS[key][0], _UNIT[key]
        if role not in self.numbers:
            return None
        try:
            values = self.numbers[role] * self._unit(role, unit)
        except InputError as error:
            if not may_change:
                raise
            self.note(f"column of the {role}", "not used", str(error).removeprefix(f"{self.place}: "), f"--{role}-column")
            return None
        if np.ptp(values) <= 1e-9 * max(float(np.abs(values).max()), 1.0):
            return float(values[0])
        span = f"{values.min():g} to {values.max():g} {unit}"
        if may_change:
            self.note(f"column of the {role}", "not used", f"it changes, {span}", f"--{role}-column")
            return None
        line = self.lines[int(np.flatnonzero(values != values[0])[0])]
        cure = f"Name the test of each row in a column (--test-column), or give the nominal value ({_option(key)})"
        raise InputError(f"{self.place}, line {line}: {role} must be the same in all rows of a test, got {span}. {cure}.")

    def _unit(self, role: str, default: str, because: str = "no unit in the header") -> float:
        """Of one unit in ours: the unit that was given, else the one the header names, else the default, told."""
        header: str = self.heading.units[self.heading.roles[role]]
        given: str | None = getattr(self.layout, f"{role}_unit")
        named, option = given or header, "--unit" if role == "reading" else f"--{role}-unit"
        one = in_ours(role, named or default)
        if one is None:
            got = f"the {role} must be in {', '.join(UNITS[role])}, got {named[:40]!r} in line {self.heading.line}"
            raise InputError(f"{self.place}: {got}. Correct the header, or give {option}.")
        if not named:
            self.note(f"unit of the {role}", default, because, option)
        elif not given and " " in header:
            self.note(f"unit of the {role}", header, f"line {self.heading.line}", option)
        elif header and in_ours(role, header) != one:
            self.note(f"unit of the {role}", f"{named}, as given", f"line {self.heading.line} says {header}", option)
        self.notes.keep(**{f"{role}_unit": None if header else named or default})
        return one

    def _column(self, role: str, what: str) -> Array:
        if role not in self.numbers:
            seen = f"{', '.join(map(repr, self.heading.headers))[:_LONGEST_LIST]} in line {self.heading.line}"
            raise InputError(f"{self.place}: a column must hold the {what}, got {seen}. Say which: --{role}-column.")
        return self.numbers[role]

    def _angle(self) -> Array:
        """Angle of every reading, as the plane counts it, shape (n,) [deg]."""
        if "angle" not in self.numbers and "time" in self.numbers:
            return self._from_time()
        raw = self._column("angle", "angle, or the time")
        unused = [key for key in ("feed_mm_per_min", "start_deg", "overshoot_deg") if self.given(key)]
        if unused:
            self.note("not used", ", ".join(map(_option, unused)), "a column holds the angle", "--time-column")
        for key in ("feed_mm_per_min", "overshoot_deg"):
            if key in self.above and key not in unused:
                self.note("not used", key, f"line {self.above[key][0].line}; a column holds the angle", "--time-column")
        span = float(np.ptp(raw))
        as_gon = span > _TURN + 1.0 and abs(span + np.median(np.abs(np.diff(raw))) - _TURN_GON) < 1.0
        because = f"it spans {span:.4g}" + (": gon are as likely" if as_gon else "")
        unit = self._unit("angle", "deg" if span > _LARGEST_SPAN_RAD else "rad", because)
        return np.unwrap(self.layout.angle_sign * (raw * unit - self.layout.angle_offset_deg), period=_TURN)

    def _from_time(self) -> Array:
        if self.layout.angle_sign != 1 or self.layout.angle_offset_deg:
            self.note("not used", "--angle-sign, --angle-offset-deg", "angles come from time", "--start-deg, --direction")
        feed = self.quantity("feed_mm_per_min")
        if feed is None or not feed > 0.0:
            raise InputError(f"{self.place}: a log over time must come with its feed, got none. Give --feed-mm-per-min.")
        where = {}
        for key in ("start_deg", "overshoot_deg"):
            value = self.quantity(key)
            if value is None:
                self.note(key, "0°", "nothing says otherwise", _option(key))
            where[key] = value or 0.0
        self.note("feed", "constant from the first reading on", "a log holds no more", "--overshoot-deg")
        if self.fields["direction"] is None:
            self.note("direction", "CCW", "none stated", "--direction")
            self.fields["direction"] = "CCW"
        back = np.flatnonzero(np.diff(self.numbers["time"]) <= 0.0)
        if back.size:
            line = self.lines[back[0] + 1]
            raise InputError(f"{self.place}, line {line}: time must increase from row to row. Sort or split the log.")
        sense = -1 if self.fields["direction"] == "CW" else 1
        with placed(self.place):
            time_s = self.numbers["time"] * self._unit("time", "s")
            angle = angles_from_time(time_s, feed_mm_per_min=feed, radius_mm=self.radius_mm, sense=sense, **where)
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
        require(np.ptp(raw) > 0.0, f"{self.place}: {got}. Say which column it is: --reading-column.")
        largest, by_radius = float(np.abs(raw).max()), abs(np.median(raw) / self.radius_mm - 1.0) < _NEAR_RADIUS
        usual = "mm" if by_radius or largest < _LARGEST_IN_MM else "um"
        reading = raw * self._unit("reading", usual, f"the largest is {largest:.4g}")
        # Distances on another radius are no deviations of this one.
        median_mm = float(np.median(reading)) * 1e-3
        scatter_mm = float(np.median(np.abs(reading - 1e3 * median_mm))) * 1e-3
        near = abs(median_mm - self.radius_mm) < _LARGEST_DEVIATION_MM
        far = median_mm > _SMALLEST_RADIUS_MM and scatter_mm < 0.01 * median_mm
        given = self.layout.zero
        if {"distance": not near, "deviation": far, None: far and not near}[given]:
            raise InputError(
                f"{self.place}: readings must be deviations from {self.radius_mm:g} mm, or distances near it, got "
                f"{median_mm:.5g} mm{f' as {given} (--zero)' if given else ''}. Give --radius-mm, or --unit, or --zero."
            )
        zero = given or ("distance" if near else "deviation")
        if given is None:
            self.notes.keep(zero=zero)
        if zero == "distance" and given is None:
            why = f"its median is {median_mm:.4g} mm"
            self.note("reading", f"distance of the balls, {self.radius_mm:g} mm subtracted", why, "--zero")
        return self.layout.sign * (reading - 1e3 * self.radius_mm if zero == "distance" else reading)

    def _laps(self, angle: Array, reading: Array) -> tuple[Array, Array]:
        if len(angle) < 2:
            return angle, reading
        travel, stated = direction_run(angle), self.fields.get("direction")
        if stated and travel not in (None, stated):
            self.note("direction", f"{stated}, as stated", f"the angles run {travel}: taken as sorted", "--direction")
        # A full circle whose last reading stands one step before the first is one.
        laps = float(abs(angle[-1] - angle[0]) + np.median(np.abs(np.diff(angle)))) / _TURN
        if laps >= _MORE_THAN_A_TURN and self.layout.laps is None:
            self.note("laps", f"all {laps:.2f} kept in one test", "longer than a turn", "--laps")
            self.notes.keep(laps="keep")
        average = laps >= _MORE_THAN_A_TURN and self.layout.laps == "average"
        return average_laps(angle, reading) if average else (angle, reading)


def _tests_in(sheet: Sheet, heading: Heading, layout: Layout, campaign: Mapping[str, Any], notes: Notes) -> Iterator[_Table]:
    """The tests of one sheet, in the order of their first rows."""
    rows = sheet.rows[heading.first :]
    while rows and not any(spreadsheet.looks_like_number(cell) or spreadsheet.is_missing(cell) for cell in rows[-1][1]):
        rows.pop()  # what is no row of numbers may only stand below the table
    lines, columns = spreadsheet.columns_of(sheet.place, rows, len(heading.headers))
    note_heading(sheet, heading, layout, notes)
    numeric = {role: c for role, c in heading.roles.items() if role not in ("test", "direction", "reading")}
    clock = numeric.pop("time") if "time" in numeric and spreadsheet.is_clock(columns[numeric["time"]][0]) else None
    decimal = _decimal(sheet, lines, [columns[c] for c in (*numeric.values(), *heading.readings)], layout, notes)
    numbers = {role: numbers_of(sheet.place, role, lines, columns[c], decimal) for role, c in numeric.items()}
    if clock is not None:
        if layout.time_unit not in (None, "s"):
            raise InputError(f"{sheet.place}: times of day have no unit, got {layout.time_unit!r}. Leave --time-unit out.")
        numbers["time"] = spreadsheet.seconds_of(sheet.place, lines, columns[clock])
        heading.units[clock] = "s"
    labels = columns[heading.roles["test"]] if "test" in heading.roles else [""] * len(lines)
    groups = _groups(sheet, heading, lines, labels)
    per_test, above = _per_test(sheet, heading, columns, labels, notes), said_above(heading.above)
    for own in heading.each():
        for c in own.readings:
            numbers["reading"] = numbers_of(sheet.place, "reading", lines, columns[c], decimal)
        for label, mine in groups.items():
            at, name = [lines[k] for k in mine], label or own.label
            blocks = 1 + int(np.count_nonzero(np.diff(mine) > 1))
            if blocks > 1:
                place = f"{sheet.place}, test {label!r}"
                notes.add(place, "rows", f"{blocks} blocks joined", "others stand between", "--test-column")
            words = {columns[own.roles["direction"]][k]: lines[k] for k in reversed(mine)} if "direction" in own.roles else {}
            several = len(mine) < len(lines) or len(heading.readings) > 1 or bool(sheet.own_name)
            stated = _stated(sheet, name, layout, several)
            fields = {
                key: spreadsheet.constant(sheet.place, name, key, at, [columns[c][k] for k in mine], decimal)
                for key, c in per_test.items()
            }
            part = {role: values[mine] for role, values in numbers.items()}
            yield _Table(sheet, own, name, at, part, words, above, layout, stated, campaign, notes, fields)


def _groups(sheet: Sheet, heading: Heading, lines: Sequence[int], labels: Sequence[str]) -> dict[str, list[int]]:
    """Rows of each test, by its label, in the order of their first rows."""
    groups: dict[str, list[int]] = {}
    for k, label in enumerate(labels):
        if isinstance(label, Unusable):
            raise InputError(label.why)
        if not label and "test" in heading.roles:
            raise InputError(f"{sheet.place}, line {lines[k]}: rows must name their test, got none. Complete or remove the line.")
        groups.setdefault(label, []).append(k)
    return groups


def _names(sheet: Sheet, label: str) -> list[str]:
    """By which a [[test]] of the layout may call a test."""
    return [name for name in (label, sheet.own_name, sheet.path.name, sheet.path.stem, str(sheet.path), sheet.name) if name]


def _stated(sheet: Sheet, label: str, layout: Layout, several: bool) -> dict[str, Any]:
    """What the layout says of a test, by any of its names, the first of them before the others."""
    names = _names(sheet, label)
    of_file = [entry for entry in layout.test if entry.file in names and entry.file not in (label, sheet.own_name)]
    if several and any(entry.force_N or entry.pressure_bar for entry in of_file):
        cure = "Give --forces-N with one for each, a [[test]] for each in --layout, or a column"
        raise InputError(f"{sheet.place}: a force or pressure given for the file must be of one test, got several in it. {cure}.")
    stated: dict[str, Any] = {}
    for entry in sorted((own for own in layout.test if own.file in names), key=lambda own: -names.index(own.file)):
        stated |= entry.model_dump(exclude_none=True)
    return stated


def _per_test(
    sheet: Sheet, heading: Heading, columns: Sequence[Sequence[str]], labels: Sequence[str], notes: Notes
) -> dict[str, int]:
    """Columns that hold one value for each test; times and temperatures of every reading are left out, and told."""
    found = {header: c for c, header in enumerate(heading.headers) if header in PER_TEST and c not in heading.roles.values()}
    for header in sorted(set(found) & {"time_s", "temperature_C"}):
        if len(set(zip(labels, columns[found[header]], strict=True))) > len(set(labels)):
            notes.add(sheet.place, "columns not used", header, "it changes within a test", "a [[test]] in --layout")
            del found[header]
    return found


def _decimal(sheet: Sheet, lines: Sequence[int], columns: Sequence[Sequence[str]], layout: Layout, notes: Notes) -> str | None:
    """The decimal mark, as given or found out; told where it may be another."""
    cells = [(line, column[k]) for k, line in enumerate(lines) for column in columns if not isinstance(column[k], Unusable)]
    decimal = layout.decimal or spreadsheet.decimal_mark(sheet.place, cells)
    marked = [cell for _, cell in cells if decimal and decimal in cell]
    value, because = str(decimal), ""
    if layout.decimal is not None:
        other = "," if decimal == "." else "."
        if not marked and any(other in cell for _, cell in cells):
            value, because = f"{decimal}, as given", f"cells have {other!r} alone: thousands"
    elif marked and all(spreadsheet.could_be_thousands(cell) for cell in marked):
        because = "thousands are as likely: three digits behind each"
    elif decimal == ",":
        because = "no cell has a point"
    if because:
        notes.add(sheet.place, "decimal mark", value, because, "--decimal")
    if decimal and layout.decimal is None:
        notes.keep(decimal=decimal)
    return decimal


_Summary = Annotated[Campaign, PlainSerializer(lambda own: {"name": own.name, "tests": len(own.tests), "readings": own.readings})]
_Given = Annotated[Layout, PlainSerializer(lambda own: own.model_dump(by_alias=True, exclude_none=True))]


@dataclass(frozen=True, eq=False)
class Imported(Result):
    """A campaign from files, with everything that was assumed.

    Attributes
    ----------
    campaign : Campaign
        In JSON its name and numbers of tests and readings.
    layout : Layout
        With what was found out filled in: reading the same files with it guesses nothing of them.
    assumptions : tuple of Assumption
    """

    schema: int = field(default=1, init=False)
    campaign: _Summary
    layout: _Given
    assumptions: tuple[Assumption, ...]


def import_campaign(
    files: Sequence[str | os.PathLike[str]] | str | os.PathLike[str], *, layout: Layout | None = None, **campaign: Any
) -> Imported:
    """Read tables as they are found into one campaign.

    Every file (or sheet of a workbook) is one test, or holds a column that names the test of each row.

    Parameters
    ----------
    files : path or sequence of paths
        CSV or text of any encoding and separator, XLSX.
    layout : Layout, optional
        What is known of the tables; the rest is found out and told.
    **campaign
        Fields of `Campaign`: topology, plane, radius_mm, …

    Raises
    ------
    InputError
        One message that names the file, the line and the cure.
    """
    layout, notes = layout or Layout(), Notes()
    paths = [Path(file) for file in ([files] if isinstance(files, str | os.PathLike) else files)]
    require(paths, "files must be given, got none. Name the tables to read.")
    tests: list[CircularTest] = []
    tables = []
    for path in paths:
        sheets = read_sheets(path, encoding=layout.encoding, separator=layout.separator, sheets=layout.sheets)
        for sheet, heading in find_headings(sheets, layout, notes):
            tables += list(_tests_in(sheet, heading, layout, campaign, notes))
        if len(tables) > LARGEST_TESTS:
            raise InputError(f"{path}: a campaign must have at most {LARGEST_TESTS} tests, got more. Import fewer at once.")
    loads = _loads_in_order(layout, tables)
    for k, table in enumerate(tables):
        test = table.circle({key: values[k] for key, values in loads.items()})
        if table.label and test.name in [own.name for own in tests]:
            name = table.name_of_file(f"{table.sheet.own_name or table.sheet.path.stem} {test.name}")
            table.note("name of the test", name, f"{test.name!r} stands elsewhere too", "a [[test]] in --layout")
            test = replace(test, name=name)
        tests.append(test)
    names = [test.name for test in tests]
    twice = next((name for k, name in enumerate(names) if name in names[:k]), None)
    got = f"{', '.join(map(str, paths))[:_LONGEST_LIST]}: tests must bear different names, got {twice!r} twice."
    require(twice is None, f"{got} A file or sheet named twice? Else rename one, or give it a name in a [[test]] of --layout.")
    used = {name for table in tables for name in _names(table.sheet, table.label)}
    known = sorted({path.name for path in paths} | set(names))
    for entry in layout.test:
        if entry.file not in used:
            why = f"no file, sheet or label of that name; did you mean {nearest(entry.file, known)!r}?"
            notes.add("", "[[test]] not used", entry.file[:_LONGEST_LIST], why, "--layout")
    _note_machine(campaign, tests, notes)
    campaign.setdefault("name", paths[0].stem if len(paths) == 1 else paths[0].resolve().parent.name or "campaign")
    return Imported(Campaign(tuple(tests), **campaign), notes.layout(layout), notes.told())


def _loads_in_order(layout: Layout, tables: Sequence[_Table]) -> dict[str, list[float]]:
    """Loads that were given for all tests in their order."""
    given = {key: values for key, (_, name) in _LOADS.items() if (values := getattr(layout, name))}
    for key, values in given.items():
        names = ", ".join(table.label or table.sheet.own_name or table.sheet.path.stem for table in tables)[:_LONGEST_LIST]
        got = f"{_option(key)} must hold one number for each test, got {len(values)} for {len(tables)} tests ({names})"
        require(len(values) == len(tables), f"{got}. Give all, in the order of files and sheets.")
    return given


def _note_machine(campaign: Mapping[str, Any], tests: Sequence[CircularTest], notes: Notes) -> None:
    """What the model needs to know of the machine and no table says."""
    for key, value, option in (
        ("topology", "wCAFYXZSt", "--topology"),
        ("plane", "XY", "--plane"),
        ("radius_mm", "150 mm", "--radius-mm"),
        ("resolution_um", "0.24 µm", "--resolution-um"),
        ("mount", "readings compensated for its deflection", "--raw"),
    ):
        if key not in campaign and not (key == "radius_mm" and all(test.radius_mm for test in tests)):
            notes.add("", key, value, "nothing says otherwise", option)
    if any(test.force_N is None for test in tests) and "force_law" not in campaign:
        law = "126.04 N/bar × pressure − 14.2 N"
        notes.add("", "force", law, "pressure alone is given", "--force-slope, --force-offset")
