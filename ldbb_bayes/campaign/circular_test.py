"""Circular tests: the readings of one circle at one force, with their conditions."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import field, fields, replace
from functools import lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic.dataclasses import dataclass

from ldbb_bayes.campaign.field_types import (
    STRICT,
    Coordinate,
    FileName,
    Force,
    Length,
    Number,
    Pressure,
    SetupNumber,
)
from ldbb_bayes.campaign.missing_values import missing_entries, without_entries
from ldbb_bayes.errors import InputError, require
from ldbb_bayes.files import raises_input_error
from ldbb_bayes.machine.chain import Circle
from ldbb_bayes.results import Array, Shown

__all__ = [
    "CENTRE",
    "FEWEST_READINGS",
    "LARGEST_READING_MM",
    "PER_TEST",
    "CircularTest",
    "Direction",
    "TestFields",
    "distinct_forces",
    "planned_angles",
    "setup_number",
    "usual_gap",
]

Direction = Literal["CW", "CCW"]
# Smallest number of readings that a circular test may have. Rows of numbers, numbers in a list or
# names beside rows that are fewer are therefore not taken for those of a test.
FEWEST_READINGS = 9
# Smallest arc [deg] that the angles of a circular test must cover.
_MINIMUM_ARC_DEG = 180.0
# Largest number of turns of the bar that the angles of a circular test may span.
_MOST_TURNS = 40.0
# Largest reading that a circular test may have [mm]. A test with a larger reading is refused,
# because its readings are probably in another unit.
LARGEST_READING_MM = 100.0
# A circle counts as full if the largest gap between neighbouring angles of its readings is at most
# this multiple of the usual gap (see `usual_gap`).
_ORDINARY_GAP = 3.0
# Forces of several tests count as equal if they differ by at most this fraction of the largest
# force. The repeatability of a pressure regulator is not better than this.
_SAME_FORCE_SHARE = 1e-3
# Relative tolerance for two checks: whether the angles of a test are evenly spaced, and whether the
# angles cover at most one turn.
_EVEN_TOLERANCE = 1e-6
# Relative tolerance within which the arc of a planned test counts as a full turn.
_TURN_TOLERANCE = 1e-6
# Names of the fields of a test that hold the coordinates X, Y, Z of the circle's centre.
CENTRE = ("centre_x_mm", "centre_y_mm", "centre_z_mm")


@dataclass(frozen=True, eq=False, kw_only=True)
class TestFields(Shown):
    """Conditions of a circular test: load, circle, set-up and direction, without the readings.

    The conditions come from the user's script, from the file ``campaign.toml``, or from the
    description of an imported file's layout. A field is None if no value is given.
    """

    __test__ = False

    #: name of the test, made of characters that are permitted in the name of a file
    name: FileName | None = None
    force_N: Force | None = None  #: radial force of the bar during the test, above zero [N]
    #: pressure of the regulator during the test [bar]; this pressure produces the force
    pressure_bar: Pressure | None = None
    #: direction of travel along the circle: clockwise (CW) or counterclockwise (CCW)
    direction: Direction | None = None
    #: clocking: angle by which the work ball is turned in its socket [deg]
    work_ball_deg: Number | None = None
    #: clocking: angle by which the tool ball is turned in its socket [deg]
    tool_ball_deg: Number | None = None
    #: nominal radius of the circle [mm]; by default the radius of the campaign
    radius_mm: Length | None = None
    #: plane of the circle, XY, YZ or ZX; by default the plane of the campaign
    plane: str | None = None
    #: X of the circle's centre (the work ball), in machine coordinates [mm]
    centre_x_mm: Coordinate | None = None
    #: Y of the circle's centre (the work ball), in machine coordinates [mm]
    centre_y_mm: Coordinate | None = None
    #: Z of the circle's centre (the work ball), in machine coordinates [mm]
    centre_z_mm: Coordinate | None = None
    #: number of the set-up in which the test is run; the offsets of the tool ball are the same in
    #: all tests of one set-up
    setup: SetupNumber | None = None
    temperature_C: Number | None = None  #: temperature during the test [°C]
    time_s: Number | None = None  #: start of the test [s], on a clock common to all tests


# Fields of a test for which an imported table needs no column. If the column is missing, the import
# can take the value of the field from elsewhere, for example from the name of the file.
_NOT_PER_TEST = ("name", "force_N", "pressure_bar", "direction")
# Fields of a test that an import can fill only from a column with the name of the field.
PER_TEST = tuple(entry.name for entry in fields(TestFields) if entry.name not in _NOT_PER_TEST)


@raises_input_error("test")
@dataclass(frozen=True, eq=False, config=STRICT)
class CircularTest(TestFields):
    """One circle at one force of the bar. A planned test has no readings.

    Force or pressure must be given. If only one of them is given, the other is computed with the
    campaign's force law. Give angles either in degrees or in radians, and readings either in µm or
    in mm. The angles may go over any number of turns. Masked angles and readings, and pandas' NA,
    are left out.

    Raises
    ------
    InputError
        For any of these faults:

        - The test has neither a force nor a pressure, or the force is not positive.
        - There are fewer than nine angles, or the angles cover less than 180°.
        - The numbers of angles and readings differ.
        - Angles or readings are not finite, or are given in two units.
        - A reading exceeds 100 mm.

    Examples
    --------
    >>> angle_deg = np.arange(0.0, 360.0, 30.0)
    >>> reading_um = 3.0 * np.cos(np.deg2rad(2.0 * angle_deg))
    >>> lb.CircularTest(500.0, angle_deg, reading_um)
    CircularTest(force_N=500, angle_deg=<ndarray, 12>, reading_um=<ndarray, 12>)
    >>> lb.CircularTest(pressure_bar=4.0, angle_deg=angle_deg).arc_deg
    360.0
    """

    force_N: Force | None = None  #: radial force of the bar during the test, above zero [N]
    #: angles between the plane's first axis and the bar [deg], one for each of the n readings,
    #: shape (n,)
    angle_deg: Any = None
    #: n readings of the ball bar [µm], shape (n,); None for a planned test. A reading is the actual
    #: distance between the balls minus the nominal radius.
    reading_um: Any = None
    #: name of the test. By default, the campaign names the test after its force, such as f036 for
    #: 36 N; repetitions of a force are numbered.
    name: FileName = field(default="", kw_only=True)
    #: clocking: angle by which the work ball is turned in its socket [deg]
    work_ball_deg: Number = field(default=0.0, kw_only=True)
    #: clocking: angle by which the tool ball is turned in its socket [deg]
    tool_ball_deg: Number = field(default=0.0, kw_only=True)
    #: angles of the bar in radians, shape (n,), given instead of ``angle_deg``. They are converted
    #: to ``angle_deg``; after the conversion, ``angle_rad`` is None.
    angle_rad: Any = field(default=None, kw_only=True)
    #: readings of the ball bar in mm, shape (n,), given instead of ``reading_um``. They are
    #: converted to ``reading_um``; after the conversion, ``reading_mm`` is None.
    reading_mm: Any = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        """Convert the angles to degrees and the readings to µm, and check the test.

        Masked readings and angles, and pandas' NA, are left out. Raise an `InputError` for the
        first fault of the test.
        """
        self._leave_out_missing()
        angle = self._column("angle_deg", "angle_rad", np.rad2deg)
        reading = self._column("reading_um", "reading_mm", _um_of_mm)
        first_fault = next(self._faults(angle, reading), None)
        if first_fault is not None:
            raise InputError(f"{self.label} must {first_fault}")
        object.__setattr__(self, "angle_deg", angle)
        object.__setattr__(self, "reading_um", reading)
        object.__setattr__(self, "angle_rad", None)
        object.__setattr__(self, "reading_mm", None)

    def _leave_out_missing(self) -> None:
        """Leave out each angle and its reading if either of them is masked or is pandas' NA."""
        columns = {}
        for name in ("angle_deg", "angle_rad", "reading_um", "reading_mm"):
            if getattr(self, name) is not None:
                columns[name] = getattr(self, name)
        masks = [missing_entries(column) for column in columns.values()]
        if not any(mask.any() for mask in masks):
            return
        lengths = {len(mask) for mask in masks}
        require(
            len(lengths) == 1,
            f"{self.label} must have one reading per angle, got {max(lengths)} and {min(lengths)}"
            " with some missing. Check the two columns.",
        )
        missing = np.logical_or.reduce(masks)
        for name, column in columns.items():
            object.__setattr__(self, name, without_entries(column, missing))

    def _column(
        self, name: str, other_name: str, convert: Callable[[Array], Array]
    ) -> Array | None:
        """Return the angles of a test in degrees, or its readings in µm.

        The user gives the values in the field ``name``, such as angle_deg, or in the field
        ``other_name``, such as angle_rad. The function ``convert`` converts values in the field
        ``other_name`` from radians to degrees, or from mm to µm. Return None if the user gave
        neither field. The result has the shape (n,) and is read-only. Raise an `InputError` if both
        are given, or if the values are not one-dimensional, not numbers or not finite.
        """
        column = getattr(self, name)
        other_column = getattr(self, other_name)
        require(
            column is None or other_column is None,
            f"{self.label} must have {name} or {other_name}, got both. Keep one of them.",
        )
        if column is not None:
            array = self._finite_array(name, column)
        elif other_column is not None:
            array = convert(self._finite_array(other_name, other_column))
        else:
            return None
        array.setflags(write=False)
        return array

    def _finite_array(self, name: str, column: Any) -> Array:
        """Return the values of a field of the test as an array of finite numbers, shape (n,).

        ``name`` is the name of the field for error messages, and ``column`` holds the values as the
        user gave them. Raise an `InputError` if ``column`` is not one-dimensional, or if a value is
        not a finite number.
        """
        try:
            array = np.array(column, dtype=float)
        except (TypeError, ValueError) as error:
            raise InputError(
                f"{self.label} must have {name} made of numbers, got: {error}. Pass one number per"
                " reading."
            ) from None
        require(
            array.ndim == 1,
            f"{self.label} must have {name} of shape (n,), got shape {array.shape}. Pass one value"
            " per reading.",
        )
        for k in np.flatnonzero(~np.isfinite(array)):
            raise InputError(
                f"{self.label} must have finite {name}, got {array[k]} at reading {k + 1}. Remove"
                " or correct that reading."
            )
        return array

    def _faults(self, angle: Array | None, reading: Array | None) -> Iterator[str]:
        """Yield a message for each fault of a test: what is required, and what the user can do.

        ``angle`` holds the angles of the test [deg], and ``reading`` the readings [µm]. Each of
        these arguments is None if the user did not give it.
        """
        if angle is None:
            yield "have angles, got none. Give angle_deg (or angle_rad)."
            return
        if len(angle) < FEWEST_READINGS:
            yield _too_few(len(angle), is_planned=reading is None)
        if reading is not None and len(reading) != len(angle):
            yield (
                f"have one reading per angle, got {len(angle)} angles and {len(reading)} readings."
                " Check the two columns."
            )
        if self.force_N is None and self.pressure_bar is None:
            yield "have a force or a pressure, got neither. Give force_N or pressure_bar."
        arc_deg = _arc_of(angle.tobytes())
        if arc_deg < _MINIMUM_ARC_DEG:
            yield (
                f"cover an arc of at least {_MINIMUM_ARC_DEG:g}°, got {arc_deg:.3g}°. Check the"
                " unit of the angle (degrees or radians) or leave the test out."
            )
        turns = float(np.ptp(angle)) / 360.0
        if turns > _MOST_TURNS:
            yield (
                f"have angles that span at most {_MOST_TURNS:g} turns, got {turns:.1f}. Check the"
                " unit of the angle: degrees that are taken for radians span 57 times as much."
            )
        if reading is None:
            return
        largest_mm = np.abs(reading).max() * 1e-3
        if largest_mm > LARGEST_READING_MM:
            yield (
                f"have readings below {LARGEST_READING_MM:g} mm, got {largest_mm:.4g} mm. Check"
                " the unit of the readings."
            )

    @property
    def label(self) -> str:
        """Name of the test in messages, such as test 'f036'."""
        if not self.name:
            return "a circular test"
        return f"test {self.name!r}"

    def angles_rad(self) -> Array:
        """Return the angles of the n readings in radians, shape (n,)."""
        return np.deg2rad(self.angle_deg)

    def readings_mm(self) -> Array:
        """Return the n readings in millimetres, shape (n,).

        Raise an `InputError` for a planned test, which has no readings.
        """
        require(
            self.reading_um is not None,
            f"{self.label} must have readings here, got a planned test. Use a campaign, or simulate"
            " the plan.",
        )
        return np.asarray(self.reading_um) * 1e-3

    def with_reading_um(self, reading_um: ArrayLike | None) -> CircularTest:
        """Return a copy of this test with the readings ``reading_um`` [µm].

        If ``reading_um`` is None, the copy has no readings.
        """
        return replace(self, reading_um=reading_um)

    def select(self, keep: NDArray[np.bool_]) -> CircularTest:
        """Return a copy of this test with only the angles and readings for which ``keep`` is true.

        ``keep`` has one entry for each of the n angles, shape (n,).
        """
        reading = None
        if self.reading_um is not None:
            reading = self.reading_um[keep]
        return replace(self, angle_deg=self.angle_deg[keep], reading_um=reading)

    @property
    def step_deg(self) -> float:
        """Step from one angle of the test to the next [deg]; negative if the angles decrease.

        The step is zero if the angles are not evenly spaced or extend over more than one turn.
        """
        steps = np.diff(self.angle_deg)
        is_even = np.allclose(steps, steps[0], rtol=_EVEN_TOLERANCE)
        if is_even and abs(steps.sum()) < 360.0 * (1.0 + _EVEN_TOLERANCE):
            return float(steps[0])
        return 0.0

    def planned(self) -> CircularTest:
        """Return a copy of this test as a planned test, which has no readings.

        If the angles are unevenly spaced or extend over more than one turn, they are replaced with
        the same number of evenly spaced angles over the same arc, but at most one turn. Evenly
        spaced angles are computed anew from their number, first angle and arc. A planned test
        therefore has exactly the same angles after it has been stored in campaign.toml and read
        again.
        """
        readings = len(self.angle_deg)
        if self.step_deg:
            angle_deg = planned_angles(readings, float(self.angle_deg[0]), self.planned_arc_deg)
            return replace(self, reading_um=None, angle_deg=angle_deg)
        arc = self.arc_deg
        is_full = arc == 360.0
        start = 0.0
        if not is_full:
            wrapped = np.unique(np.mod(self.angle_deg, 360.0))
            gaps = np.diff(wrapped, append=wrapped[0] + 360.0)
            start = np.roll(wrapped, -1)[np.argmax(gaps)]
        even = planned_angles(readings, float(start), arc)
        return replace(self, reading_um=None, angle_deg=even)

    @property
    def planned_arc_deg(self) -> float:
        """Arc [deg] that the angles of a planned test cover, as campaign.toml states it.

        The angles are evenly spaced. The arc is negative if the angles decrease. The arc of a full
        turn is 360 or −360.
        """
        readings = len(self.angle_deg)
        turn_deg = readings * self.step_deg
        if abs(abs(turn_deg) - 360.0) < _TURN_TOLERANCE * 360.0:
            return float(np.copysign(360.0, turn_deg))
        return (readings - 1) * self.step_deg

    @property
    def circle(self) -> Circle:
        """Nominal circle of the test: its radius, centre and plane.

        If the radius or a coordinate of the centre is not given, zero is assumed; if the plane is
        not given, XY is assumed. In the tests of a campaign, radius, centre and plane are always
        known, because the campaign fills in missing values.
        """
        x, y, z = (float(getattr(self, key) or 0.0) for key in CENTRE)
        return Circle(float(self.radius_mm or 0.0), (x, y, z), self.plane or "XY")

    @property
    def arc_deg(self) -> float:
        """Arc that the angles of the test cover [deg].

        Angles of several turns are first reduced to one turn. The arc is then 360° minus the
        largest gap between neighbouring angles on the circle. The arc counts as a full 360° if the
        largest gap is at most three times the usual gap (see ``usual_gap``).
        """
        return _arc_of(self.angle_deg.tobytes())


def _um_of_mm(millimetres: Array) -> Array:
    """Return lengths in µm, given the same lengths in mm."""
    return millimetres * 1e3


def _too_few(count: int, *, is_planned: bool) -> str:
    """Return the message that a test has too few readings or, if it is planned, too few angles."""
    if is_planned:
        return (
            f"have at least {FEWEST_READINGS} angles, got {count}. Give the angles of all readings"
            " that are planned, such as every 10°."
        )
    return (
        f"have at least {FEWEST_READINGS} readings, got {count}. Leave the test out or record more."
    )


@lru_cache(maxsize=64)
def _arc_of(angles: bytes) -> float:
    """Return the arc [deg] that the angles of a test cover, see `CircularTest.arc_deg`.

    The arc is zero if all angles are equal. ``angles`` are the bytes of the array of angles [deg].
    Bytes are used because, unlike an array, they can be the key of a cache. The cache saves time,
    because many tests have the same angles.
    """
    wrapped = np.unique(np.mod(np.frombuffer(angles), 360.0))
    if len(wrapped) < 2:
        return 0.0
    gaps = np.diff(np.append(wrapped, wrapped[0] + 360.0))
    largest = float(gaps.max())
    if largest <= _ORDINARY_GAP * usual_gap(gaps):
        return 360.0
    return 360.0 - largest


def usual_gap(gaps_deg: Array) -> float:
    """Return the usual width of the gaps between neighbouring angles on a circle [deg].

    The usual width is the weighted median of all gaps except the largest. Each gap is weighted by
    its width, so that a few very narrow gaps between nearly equal angles have hardly any influence.

    Parameters
    ----------
    gaps_deg
        The n gaps [deg], at least two, shape (n,); their sum is 360°.
    """
    ordered = np.sort(gaps_deg)[:-1]
    covered = np.cumsum(ordered)
    return float(ordered[np.searchsorted(covered, 0.5 * covered[-1])])


def distinct_forces(forces_N: ArrayLike) -> Array:
    """Return the distinct values among the forces ``forces_N``, in ascending order [N].

    A force is left out if it exceeds the next lower force in the result by at most a thousandth of
    the largest force in ``forces_N``.
    """
    ordered = np.unique(np.asarray(forces_N, dtype=float))
    distinct: list[float] = []
    for force in ordered.tolist():
        if not distinct or force - distinct[-1] > _SAME_FORCE_SHARE * ordered[-1]:
            distinct.append(force)
    return np.array(distinct)


def setup_number(test: CircularTest) -> int:
    """Return the number of a test's set-up; 1 if the test does not state it."""
    return test.setup or 1


def planned_angles(readings: int, start_deg: float, arc_deg: float) -> Array:
    """Return the evenly spaced angles of a planned test [deg], shape (readings,).

    The number of angles is ``readings``, the first angle is ``start_deg``, and the angles cover the
    arc ``arc_deg``. If ``arc_deg`` is negative, the angles decrease. The angles include both ends
    of the arc, but in a full turn the first angle is not repeated.
    """
    steps = readings - 1
    if abs(arc_deg) == 360.0:
        steps = readings
    return np.asarray(start_deg + arc_deg * (np.arange(readings) / steps))
