"""The rows of one test in a table, and what is said of it, into one circular test."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.campaign.circular_test import CircularTest
from ldbb_bayes.campaign.loading import ForceLaw
from ldbb_bayes.errors import InputError
from ldbb_bayes.tables.assumptions import Notes
from ldbb_bayes.tables.heading import Heading
from ldbb_bayes.tables.known import Known
from ldbb_bayes.tables.layout import Layout, TestLayout
from ldbb_bayes.tables.measured import Measured
from ldbb_bayes.tables.preamble import Said, loads_not_understood
from ldbb_bayes.tables.recording import (
    angles_from_time,
    average_laps,
    check_zero,
    direction_run,
    laps_of,
    on_the_circle,
    unwrapped,
)
from ldbb_bayes.tables.sheet import Sheet

__all__ = ["TabledTest"]

Array = NDArray[np.float64]
_LOADS = (("force", "force_N", "N"), ("pressure", "pressure_bar", "bar"))
# A wider span of angles is in degrees.
_LARGEST_SPAN_RAD = 7.0
# Readings whose median is the radius within this are distances of the balls: a bar measures no more; within this share, in mm.
_LARGEST_DEVIATION_MM, _NEAR_RADIUS = 1.5, 0.05
_LARGEST_IN_MM = 0.5
_LONGEST_LIST, _LONGEST_TEST_NAME = 200, 100
# A recording of more turns holds laps, or run-in and run-out.
_MORE_THAN_A_TURN = 1.02
# Share by which force and pressure may miss the force law.
_OFF_THE_LAW = 0.05
_TURN, _TURN_GON = 361.0, 400.0


@dataclass
class TabledTest:
    """The rows of one test, and everything that is said of it.

    Attributes
    ----------
    label : str
        Of its rows in the column of tests; empty where the whole sheet is one test.
    lines : sequence of int
        Of its rows in the file.
    numbers : dict of role to ndarray, shape (n,)
    words : mapping of str to line
        In the column of directions, and where each first stands.
    above : mapping of field to all values
        That the lines above the table say.
    stated : TestLayout or None
    campaign : mapping
        Fields of the campaign that were given.
    fields : dict
        Of the test, from columns that hold one value for it.
    """

    sheet: Sheet
    heading: Heading
    label: str
    lines: Sequence[int]
    numbers: dict[str, Array]
    words: Mapping[str, int]
    above: Mapping[str, Sequence[Said]]
    layout: Layout
    stated: TestLayout | None
    campaign: Mapping[str, Any]
    notes: Notes
    fields: dict[str, Any] = field(default_factory=dict)

    @property
    def place(self) -> str:
        """What a message calls it."""
        return f"{self.sheet.place}, test {self.label!r}" if self.label else self.sheet.place

    @property
    def radius_mm(self) -> float:
        return float(self.fields.get("radius_mm") or self.campaign.get("radius_mm") or 150.0)

    @property
    def _seen(self) -> str:
        """The headers, as far as they fit into a message."""
        return f"{', '.join(map(repr, self.heading.headers))[:_LONGEST_LIST]} in line {self.heading.line}"

    def test(self) -> CircularTest:
        """The circle: load, direction, angles, readings, laps.

        Raises
        ------
        InputError
            Naming the place and the cure.
        """
        self._note_against_columns()
        if self.stated is not None:
            self.fields |= self.stated.model_dump(exclude={"file", "start_deg"}, exclude_none=True)
        if "name" not in self.fields:
            self.fields["name"] = self.name_of_file(self.label or self.sheet.own_name or self.sheet.path.stem)
        known = self.known
        self.fields |= {"direction": known.direction(self.words)} | self._load()
        if self.fields.get("radius_mm") is None and (radius := known.number("radius_mm")) is not None:
            self.fields["radius_mm"] = radius
        angle, reading = self._laps(self._angle(), self._reading())
        fields = {key: value for key, value in self.fields.items() if value is not None}
        with self._placed():
            return CircularTest(angle_deg=angle, reading_um=reading, **fields)

    @contextmanager
    def _placed(self) -> Iterator[None]:
        """A message inside names the test."""
        try:
            yield
        except InputError as error:
            raise InputError(f"{self.place}: {error}") from None

    def with_loads(self, k: int) -> TabledTest:
        """As the k-th test, from 0, of those that were given loads in their order."""
        given = {}
        for key, option, values in (
            ("force_N", "--forces-N", self.layout.forces_N),
            ("pressure_bar", "--pressures-bar", self.layout.pressures_bar),
        ):
            if values and k >= len(values):
                raise InputError(
                    f"{self.place}: {option} must hold one number for each test, got {len(values)} and this is test {k + 1}. "
                    "Give all, in the order of files and sheets."
                )
            if values:
                given[key] = values[k]
        if not given:
            return self
        loads = {"force_N": None, "pressure_bar": None} | given
        return replace(self, stated=(self.stated or TestLayout(file=self.label)).model_copy(update=loads))

    @property
    def measured(self) -> Measured:
        """Its columns of numbers."""
        return Measured(self.place, self.heading, self.layout, self.notes, self.lines, self.numbers)

    @property
    def known(self) -> Known:
        """What is said of it beside its columns."""
        column = self.heading.headers[self.heading.roles["reading"]] if "reading" in self.heading.roles else ""
        names = [name for name in (self.label, column, self.sheet.name, self.sheet.path.stem) if name]
        return Known(self.place, names, self.heading.above, self.above, self.layout, self.stated, self.campaign, self.notes)

    def _note_against_columns(self) -> None:
        """Where a [[test]] of the layout, or an option, and a column of the file differ."""
        stated = {} if self.stated is None else self.stated.model_dump(exclude_none=True)
        for key, value in self.fields.items():
            if value is not None and stated.get(key, value) != value:
                self.notes.add(self.place, key, f"{stated[key]}, as given", f"its column says {value}", "a [[test]] in --layout")
        for key, option in (("radius_mm", "--radius-mm"), ("plane", "--plane")):
            own, given = stated.get(key, self.fields.get(key)), self.campaign.get(key)
            if own and given and own != given:
                self.notes.add(self.place, key, str(own), f"said of this test; {given} is for the others", option)
            above = next((said for said in self.above.get(key, ()) if own and not np.isclose(said.value, float(own))), None)
            if above is not None:
                self.notes.add(self.place, key, f"{own}, as given", f"line {above.line} says {above.value:g}", option)

    def name_of_file(self, stem: str) -> str:
        """A test's name is a file's: signs that cannot stand in one are replaced."""
        name = re.sub(r"^[^\w+\-]|[^\w+\-. ]", "_", stem)[:_LONGEST_TEST_NAME]
        if name != stem:
            self.notes.add(self.place, "name of the test", name, "it names a file", "a [[test]] in --layout")
        return name

    def _load(self) -> dict[str, float]:
        """Force, pressure, or both."""
        found: dict[str, float] = {}
        given = any(self.known.given(key) is not None for _, key, _ in _LOADS)
        for role, key, default in _LOADS:
            value = self.known.number(key, self.measured.one_value(role, default, may_change=given))
            if value is not None:
                found[key] = value
        if not found:
            raise InputError(
                f"{self.place}: force or pressure must be known, got neither from a column, the lines above the table "
                f"or the name.{loads_not_understood(self.heading.above)} "
                "Give --forces-N or --pressures-bar, one for each test in the order of files and sheets, or a "
                "[[test]] in --layout."
            )
        if len(found) == 2:
            law = (self.campaign.get("force_law") or ForceLaw()).force_N(found["pressure_bar"])
            if abs(law - found["force_N"]) > _OFF_THE_LAW * max(law, found["force_N"]):
                both = f"{found['force_N']:g} N and {found['pressure_bar']:g} bar"
                self.notes.add(
                    self.place, "force and pressure", both, f"the force law gives {law:.0f} N", "--forces-N, --force-slope"
                )
        return found

    def _angle(self) -> Array:
        """Angle of every reading, as the plane counts it, shape (n,) [deg]."""
        if "angle" not in self.numbers and "time" not in self.numbers:
            raise InputError(
                f"{self.place}: a column must hold the angle, or the time, got {self._seen}. Say which: --angle-column."
            )
        if "angle" not in self.numbers:
            return self._from_time()
        unused = [name for name in ("feed_mm_per_min", "start_deg", "overshoot_deg") if self.known.given(name)]
        if unused:
            options = ", ".join("--" + name.replace("_", "-") for name in unused)
            self.notes.add(self.place, "not used", options, "a column holds the angle", "--time-column")
        for key in ("feed_mm_per_min", "overshoot_deg"):
            if key in self.above and key not in unused:
                why = f"line {self.above[key][0].line}; a column holds the angle"
                self.notes.add(self.place, "not used", key, why, "--time-column")
        raw = self.numbers["angle"]
        span = float(np.ptp(raw))
        as_gon = span > _TURN and len(raw) > 1 and abs(span + np.median(np.abs(np.diff(raw))) - _TURN_GON) < 1.0
        because = f"it spans {span:.4g}" + (": gon are as likely" if as_gon else "")
        unit = self.measured.unit("angle", "deg" if span > _LARGEST_SPAN_RAD else "rad", because)
        return unwrapped(self.layout.angle_sign * (raw * unit - self.layout.angle_offset_deg))

    def _from_time(self) -> Array:
        if self.layout.angle_sign != 1 or self.layout.angle_offset_deg:
            self.notes.add(
                self.place, "not used", "--angle-sign, --angle-offset-deg", "angles come from time", "--start-deg, --direction"
            )
        feed = self.known.number("feed_mm_per_min")
        if feed is None or not feed > 0.0:
            raise InputError(f"{self.place}: a log over time must come with its feed, got none. Give --feed-mm-per-min.")
        start = self._where("start_deg")
        overshoot = self._where("overshoot_deg")
        self.notes.add(self.place, "feed", "constant from the first reading on", "a log holds no more", "--overshoot-deg")
        if self.fields["direction"] is None:
            self.notes.add(self.place, "direction", "CCW", "none stated", "--direction")
            self.fields["direction"] = "CCW"
        back = np.flatnonzero(np.diff(self.numbers["time"]) <= 0.0)
        if back.size:
            raise InputError(
                f"{self.place}, line {self.lines[back[0] + 1]}: time must increase from row to row. Sort or split the log."
            )
        sense = -1 if self.fields["direction"] == "CW" else 1
        with self._placed():
            angle = angles_from_time(
                self.numbers["time"] * self.measured.unit("time", "s"),
                feed_mm_per_min=feed,
                radius_mm=self.radius_mm,
                start_deg=start,
                overshoot_deg=overshoot,
                sense=sense,
            )
        kept = on_the_circle(angle, start_deg=start, sense=sense)
        left = int(np.count_nonzero(~kept))
        if left:
            self.notes.add(
                self.place, "run-in and run-out", f"{left} readings left out", "outside whole turns", "--overshoot-deg"
            )
        self.numbers = {role: values[kept] for role, values in self.numbers.items()}
        return angle[kept]

    def _where(self, key: str) -> float:
        """Where the circle of a log begins, or its run-in [deg]."""
        said = self.known.number(key)
        if said is not None:
            return said
        self.notes.add(self.place, key, "0°", "nothing says otherwise", "--" + key.replace("_", "-"))
        return 0.0

    def _reading(self) -> Array:
        """Actual ball distance − R, shape (n,) [µm]."""
        if "reading" not in self.numbers:
            raise InputError(f"{self.place}: a column must hold the reading, got {self._seen}. Say which: --reading-column.")
        raw = self.numbers["reading"]
        if np.ptp(raw) == 0.0:
            raise InputError(
                f"{self.place}: the reading must change from row to row, got {raw[0]:g} in all. "
                "Say which column it is: --reading-column."
            )
        largest, by_radius = float(np.abs(raw).max()), abs(np.median(raw) / self.radius_mm - 1.0) < _NEAR_RADIUS
        unit = self.measured.unit(
            "reading", "mm" if by_radius or largest < _LARGEST_IN_MM else "um", f"the largest is {largest:.4g}"
        )
        reading = raw * unit
        median_mm = float(np.median(reading)) * 1e-3
        near = abs(median_mm - self.radius_mm) < _LARGEST_DEVIATION_MM
        with self._placed():
            check_zero(reading, radius_mm=self.radius_mm, zero=self.layout.zero, near=near)
        zero = self.layout.zero or ("distance" if near else "deviation")
        if self.layout.zero is None:
            self.notes.keep(zero=zero)
        if zero == "deviation":
            return self.layout.sign * reading
        if self.layout.zero is None:
            why = f"its median is {median_mm:.4g} mm"
            self.notes.add(self.place, "reading", f"distance of the balls, {self.radius_mm:g} mm subtracted", why, "--zero")
        return self.layout.sign * (reading - 1e3 * self.radius_mm)

    def _laps(self, angle: Array, reading: Array) -> tuple[Array, Array]:
        if len(angle) < 2:
            return angle, reading
        with self._placed():
            travel = direction_run(angle)
        stated = self.fields.get("direction")
        if stated and travel not in (None, stated):
            self.notes.add(
                self.place, "direction", f"{stated}, as stated", f"the angles run {travel}: taken as sorted", "--direction"
            )
        laps = laps_of(angle)
        if laps < _MORE_THAN_A_TURN:
            return angle, reading
        choice = self.layout.laps
        if choice is None:
            choice = "keep"
            self.notes.add(self.place, "laps", f"all {laps:.2f} kept in one test", "longer than a turn", "--laps")
            self.notes.keep(laps=choice)
        if choice == "keep":
            return angle, reading
        with self._placed():
            return average_laps(angle, reading)
