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
from ldbb_bayes.errors import InputError, require
from ldbb_bayes.files import raises_input_error
from ldbb_bayes.machine.chain import Circle
from ldbb_bayes.results import Array, Shown

__all__ = ["CENTRE", "PER_TEST", "CircularTest", "Direction", "TestFields", "distinct_forces"]

Direction = Literal["CW", "CCW"]
# Smallest number of readings of a circular test.
_MINIMUM_READINGS = 9
# Smallest arc [deg] that the angles of a circular test must cover.
_MINIMUM_ARC_DEG = 180.0
# Readings larger than this [mm] are refused: they are probably in another unit.
_LARGEST_READING_MM = 100.0
# A circle counts as full if its largest gap between angles is at most this number of median steps.
_ORDINARY_GAP = 3.0
# Forces count as the same if they differ by less than this fraction of the largest force: a
# pressure regulator does not repeat a force more closely.
_SAME_FORCE_SHARE = 1e-3
# Relative tolerance within which steps of the angle count as equal, and an arc as one turn.
_EVEN_TOLERANCE = 1e-6
# Names of the fields of a test that hold the coordinates X, Y, Z of the circle's centre.
CENTRE = ("centre_x_mm", "centre_y_mm", "centre_z_mm")


@dataclass(frozen=True, eq=False, kw_only=True)
class TestFields(Shown):
    """Conditions of a circular test: load, circle, set-up and direction, without the readings.

    A program, ``campaign.toml`` or the layout of a foreign file states them. A field that is not
    stated is None.
    """

    __test__ = False

    name: FileName | None = None  #: name of the test, which can also be the name of a file
    force_N: Force | None = None  #: radial force of the bar, above zero
    pressure_bar: Pressure | None = None  #: pressure of the regulator
    direction: Direction | None = None  #: direction of travel: CW or CCW
    work_ball_deg: Number | None = None  #: clocking: angle by which the work ball is turned
    tool_ball_deg: Number | None = None  #: clocking: angle by which the tool ball is turned
    radius_mm: Length | None = None  #: radius of the circle; default: the campaign's radius
    plane: str | None = None  #: plane of the circle, XY, YZ or ZX; default: the campaign's plane
    centre_x_mm: Coordinate | None = None  #: X of the work ball, in machine coordinates
    centre_y_mm: Coordinate | None = None  #: Y of the work ball, in machine coordinates
    centre_z_mm: Coordinate | None = None  #: Z of the work ball, in machine coordinates
    #: number of the set-up; tests of one set-up have the same offsets of the tool ball
    setup: SetupNumber | None = None
    temperature_C: Number | None = None  #: temperature during the test
    time_s: Number | None = None  #: start of the test, on a clock common to all tests


# Fields of a test that a table may give in columns of other names.
_NOT_PER_TEST = ("name", "force_N", "pressure_bar", "direction")
# Fields of a test that a table of readings may give in columns of exactly these names.
PER_TEST = tuple(entry.name for entry in fields(TestFields) if entry.name not in _NOT_PER_TEST)


@raises_input_error("test")
@dataclass(frozen=True, eq=False, config=STRICT)
class CircularTest(TestFields):
    """One circle at one force, with readings or, if it is planned, without.

    Force or pressure must be given; the campaign's force law supplies the other. Give angles in
    degrees or in radians, and readings in µm or in mm, never in both. Angles may go any number of
    turns.

    Raises
    ------
    InputError
        For angles that are missing, fewer than nine, or cover less than 180°; for angles or
        readings that are not finite or not equally many; for readings of more than 100 mm; and
        for a test without force and pressure, or with a force that is not positive.

    Examples
    --------
    >>> angle_deg = np.arange(0.0, 360.0, 30.0)
    >>> reading_um = 3.0 * np.cos(np.deg2rad(2.0 * angle_deg))
    >>> lb.CircularTest(500.0, angle_deg, reading_um)
    CircularTest(force_N=500, angle_deg=<ndarray, 12>, reading_um=<ndarray, 12>)
    >>> lb.CircularTest(pressure_bar=4.0, angle_deg=angle_deg).arc_deg
    360.0
    """

    force_N: Force | None = None  #: radial force, above zero
    #: angles of the bar from the plane's first axis, one for each of the n readings, shape (n,)
    angle_deg: Any = None
    reading_um: Any = None  #: readings: actual distance of the balls − radius, shape (n,)
    #: name of the test, such as f036 for 36 N; repetitions of a force are numbered
    name: FileName = field(default="", kw_only=True)
    #: clocking: angle by which the work ball is turned in its socket
    work_ball_deg: Number = field(default=0.0, kw_only=True)
    #: clocking: angle by which the tool ball is turned in its socket
    tool_ball_deg: Number = field(default=0.0, kw_only=True)
    #: angles in radians, given instead of ``angle_deg``; they are converted, and this becomes None
    angle_rad: Any = field(default=None, kw_only=True)
    #: readings in mm, given instead of ``reading_um``; they are converted, and this becomes None
    reading_mm: Any = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        """Store angles in degrees and readings in µm.

        Raise an `InputError` for the first fault of the test.
        """
        angle = self._column("angle_deg", "angle_rad", np.rad2deg)
        reading = self._column("reading_um", "reading_mm", _um_of_mm)
        first_fault = next(self._faults(angle, reading), None)
        if first_fault is not None:
            raise InputError(f"{self.label} must {first_fault}")
        object.__setattr__(self, "angle_deg", angle)
        object.__setattr__(self, "reading_um", reading)
        object.__setattr__(self, "angle_rad", None)
        object.__setattr__(self, "reading_mm", None)

    def _column(
        self, name: str, other_name: str, convert: Callable[[Array], Array]
    ) -> Array | None:
        """Return the angles [deg] or the readings [µm], from the unit in which the user gave them.

        ``name`` is the field in the unit that is kept, and ``other_name`` the field in the other
        unit, which ``convert`` converts. Return None if the user gave neither.
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
        array = np.array(column, dtype=float)
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
        """Yield one sentence for each fault of the test: what it must have, and the remedy."""
        if angle is None:
            yield "have angles, got none. Give angle_deg (or angle_rad)."
            return
        if len(angle) < _MINIMUM_READINGS:
            yield (
                f"have at least {_MINIMUM_READINGS} readings, got {len(angle)}. Leave the test out"
                " or record more."
            )
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
        if reading is None:
            return
        largest_mm = np.abs(reading).max() * 1e-3
        if largest_mm > _LARGEST_READING_MM:
            yield (
                f"have readings below {_LARGEST_READING_MM:g} mm, got {largest_mm:.4g} mm. Check"
                " the unit of the readings."
            )

    @property
    def label(self) -> str:
        """Name of the test in messages."""
        if not self.name:
            return "a circular test"
        return f"test {self.name!r}"

    def angles_rad(self) -> Array:
        """Return the angles of the n readings in radians, shape (n,)."""
        return np.deg2rad(self.angle_deg)

    def readings_mm(self) -> Array:
        """Return the n readings in millimetres, shape (n,).

        Raise an `InputError` for a planned test, which has none.
        """
        require(
            self.reading_um is not None,
            f"{self.label} must have readings here, got a planned test. Use a campaign, or simulate"
            " the plan.",
        )
        return np.asarray(self.reading_um) * 1e-3

    def with_reading_um(self, reading_um: ArrayLike | None) -> CircularTest:
        """Return the same test with other readings [µm]."""
        return replace(self, reading_um=reading_um)

    def select(self, keep: NDArray[np.bool_]) -> CircularTest:
        """Return the same test with the readings for which ``keep`` is true, and no others."""
        reading = None
        if self.reading_um is not None:
            reading = self.reading_um[keep]
        return replace(self, angle_deg=self.angle_deg[keep], reading_um=reading)

    @property
    def step_deg(self) -> float:
        """Step from one angle to the next [deg]; zero if steps are unequal or exceed one turn.

        A plan with equal steps states the step instead of all angles.
        """
        steps = np.diff(self.angle_deg)
        is_even = np.allclose(steps, steps[0], rtol=_EVEN_TOLERANCE)
        if is_even and abs(steps.sum()) < 360.0 * (1.0 + _EVEN_TOLERANCE):
            return float(steps[0])
        return 0.0

    def planned(self) -> CircularTest:
        """Return the same test without readings.

        Angles in unequal steps are replaced by as many angles in equal steps over the same arc.
        """
        if self.step_deg:
            return replace(self, reading_um=None)
        arc = self.arc_deg
        is_full = arc == 360.0
        start = 0.0
        if not is_full:
            wrapped = np.unique(np.mod(self.angle_deg, 360.0))
            gaps = np.diff(wrapped, append=wrapped[0] + 360.0)
            start = np.roll(wrapped, -1)[np.argmax(gaps)]
        even = start + np.linspace(0.0, arc, len(self.angle_deg), endpoint=not is_full)
        return replace(self, reading_um=None, angle_deg=even)

    @property
    def circle(self) -> Circle:
        """Nominal circle: radius, centre and plane.

        An unstated radius or coordinate is zero and an unstated plane XY, so the campaign's
        defaults must be filled in before.
        """
        x, y, z = (float(getattr(self, key) or 0.0) for key in CENTRE)
        return Circle(float(self.radius_mm or 0.0), (x, y, z), self.plane or "XY")

    @property
    def arc_deg(self) -> float:
        """Arc that the angles cover [deg]: 360° minus the largest gap between neighbours.

        It is 360° if the largest gap is no wider than three median steps.
        """
        return _arc_of(self.angle_deg.tobytes())


def _um_of_mm(millimetres: Array) -> Array:
    return millimetres * 1e3


@lru_cache(maxsize=64)
def _arc_of(angles: bytes) -> float:
    """Return the arc that angles cover [deg], from the bytes of their array.

    Results are cached, because many tests of a campaign or of a design have the same angles.
    """
    wrapped = np.unique(np.mod(np.frombuffer(angles), 360.0))
    if len(wrapped) < 2:
        return 0.0
    gaps = np.diff(np.append(wrapped, wrapped[0] + 360.0))
    largest = float(gaps.max())
    if largest <= _ORDINARY_GAP * float(np.median(gaps)):
        return 360.0
    return 360.0 - largest


def distinct_forces(forces_N: ArrayLike) -> Array:
    """Return the different forces in ascending order [N].

    Forces that differ by at most a thousandth of the largest count as equal.
    """
    ordered = np.unique(np.asarray(forces_N, dtype=float))
    distinct: list[float] = []
    for force in ordered.tolist():
        if not distinct or force - distinct[-1] > _SAME_FORCE_SHARE * ordered[-1]:
            distinct.append(force)
    return np.array(distinct)
