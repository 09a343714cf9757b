"""What was measured, or is to be: one circular test, a campaign of them, and a plan (a campaign without readings)."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ldbb_bayes.errors import InputError, check_known
from ldbb_bayes.machine.chain import Circle, Machine
from ldbb_bayes.notebook import table_html

__all__ = ["Campaign", "CircularTest", "ForceLaw", "MountCompensation", "Plan"]

Array = NDArray[np.float64]
Direction = Literal["CW", "CCW"]
MINIMUM_READINGS = 9
MINIMUM_ARC_DEG = 180.0
LARGEST_READING_UM = 1e5
LARGEST_FORCE_N = 1e6
LARGEST_LENGTH_MM = 1e5
SAFE_NAME = re.compile(r"[\w+\-][\w+\-. ]{0,99}")


@dataclass(frozen=True)
class ForceLaw:
    """F = slope · P + offset: what the regulator pressure does to the force (default: the paper's bar)."""

    slope_N_per_bar: float = 126.04
    offset_N: float = -14.2

    def __post_init__(self) -> None:
        if not (np.isfinite(self.slope_N_per_bar) and self.slope_N_per_bar > 0 and np.isfinite(self.offset_N)):
            raise InputError(
                f"force law must have a positive finite slope and a finite offset, got {self.slope_N_per_bar} N/bar and "
                f"{self.offset_N} N. Correct the [force] table."
            )

    def force_N(self, pressure_bar: float) -> float:
        """Force at a pressure [N]."""
        return self.slope_N_per_bar * pressure_bar + self.offset_N

    def pressure_bar(self, force_N: float) -> float:
        """Pressure for a force [bar]."""
        return (force_N - self.offset_N) / self.slope_N_per_bar


@dataclass(frozen=True)
class MountCompensation:
    """Deflection of the work ball's mount per bar (Eq. 32) and whether the readings are already free of it."""

    deflection_um_per_bar: float = 2.33
    compensated: bool = True

    def __post_init__(self) -> None:
        if not (np.isfinite(self.deflection_um_per_bar) and self.deflection_um_per_bar >= 0):
            raise InputError(
                f"mount deflection must be a number ≥ 0 in µm/bar, got {self.deflection_um_per_bar}. Correct the [mount] table."
            )


@dataclass(frozen=True, eq=False)
class CircularTest:
    """One circle at one force. Without readings it is a planned test.

    Parameters
    ----------
    force_N : float, optional
        Radial force F [N]. Either force or pressure must be given; the campaign's force law supplies the other.
    angle_deg, angle_rad : array-like, shape (n,), one of the two
        Angle θ of the bar's sensitive direction from the plane's first axis, any number of turns.
    reading_um, reading_mm : array-like, shape (n,), at most one of the two
        ρ: actual ball distance − R.
    pressure_bar : float, optional
        Regulator pressure P [bar].
    name : str, optional
        Default: ``f036`` for 36 N; the campaign numbers repeats.
    direction : {"CW", "CCW"}, optional
    work_ball_deg, tool_ball_deg : float
        Clocking ψ: how far each ball is turned in its socket [deg].
    radius_mm, plane, centre_x_mm, centre_y_mm : optional
        Default: the campaign's.
    temperature_C : float, optional
    time_s : float, optional
        Start of the test on any common clock [s].

    Raises
    ------
    InputError
        For missing, non-finite, too few or unequal numbers of angles and readings, or a force that is not positive.
    """

    force_N: float | None = None
    angle_deg: Any = None
    reading_um: Any = None
    pressure_bar: float | None = None
    name: str = ""
    direction: Direction | None = None
    work_ball_deg: float = 0.0
    tool_ball_deg: float = 0.0
    radius_mm: float | None = None
    plane: str | None = None
    centre_x_mm: float | None = None
    centre_y_mm: float | None = None
    temperature_C: float | None = None
    time_s: float | None = None
    angle_rad: Any = None
    reading_mm: Any = None

    def __post_init__(self) -> None:
        angle = _one_of(self, "angle_deg", self.angle_deg, "angle_rad", self.angle_rad, np.rad2deg)
        reading = _one_of(self, "reading_um", self.reading_um, "reading_mm", self.reading_mm, lambda x: x * 1e3)
        if angle is None:
            raise InputError(f"{self._label} must have angles, got none. Give angle_deg (or angle_rad).")
        if len(angle) < MINIMUM_READINGS:
            raise InputError(
                f"{self._label} must have at least {MINIMUM_READINGS} readings, got {len(angle)}. "
                "Leave the test out or record more."
            )
        if reading is not None and len(reading) != len(angle):
            raise InputError(
                f"{self._label} must have one reading per angle, got {len(angle)} angles and {len(reading)} readings. "
                "Check the two columns."
            )
        if self.force_N is None and self.pressure_bar is None:
            raise InputError(f"{self._label} must have a force or a pressure, got neither. Give force_N or pressure_bar.")
        if _arc_deg(angle) < MINIMUM_ARC_DEG:
            raise InputError(
                f"{self._label} must cover an arc of at least {MINIMUM_ARC_DEG:g}°, got {_arc_deg(angle):.3g}°. "
                "Check the unit of the angle (degrees or radians) or leave the test out."
            )
        _check_positive(self, "force_N", self.force_N, "N", LARGEST_FORCE_N)
        _check_positive(self, "radius_mm", self.radius_mm, "mm", LARGEST_LENGTH_MM)
        if self.pressure_bar is not None and self.pressure_bar < 0:
            raise InputError(f"{self._label} must have pressure_bar ≥ 0, got {self.pressure_bar}. Correct it.")
        if reading is not None and np.abs(reading).max() > LARGEST_READING_UM:
            raise InputError(
                f"{self._label} must have readings below {LARGEST_READING_UM * 1e-3:g} mm, "
                f"got {np.abs(reading).max() * 1e-3:.4g} mm. Check the unit of the readings."
            )
        if self.name and not SAFE_NAME.fullmatch(self.name):
            raise InputError(
                f"a test's name must be letters, digits, spaces, '_', '-', '+' or '.', not starting with a dot, "
                f"got {self.name!r}. Rename it: the name becomes a file's."
            )
        for field in ("pressure_bar", "work_ball_deg", "tool_ball_deg", "centre_x_mm", "centre_y_mm", "temperature_C", "time_s"):
            value = getattr(self, field)
            if value is not None and not (
                np.isfinite(value) and (not field.startswith("centre") or abs(value) <= LARGEST_LENGTH_MM)
            ):
                raise InputError(f"{self._label} must have a finite {field}, got {value}. Correct or remove it.")
        if self.direction not in (None, "CW", "CCW"):
            raise InputError(f"{self._label} must have direction CW or CCW, got {self.direction!r}. Correct or remove it.")
        object.__setattr__(self, "angle_deg", angle)
        object.__setattr__(self, "reading_um", reading)
        object.__setattr__(self, "angle_rad", None)
        object.__setattr__(self, "reading_mm", None)

    @property
    def _label(self) -> str:
        return f"test {self.name!r}" if self.name else "a circular test"

    def angles_rad(self) -> Array:
        """θ in radians, shape (n,)."""
        return np.deg2rad(self.angle_deg)

    def readings_mm(self) -> Array:
        """ρ in millimetres, shape (n,).

        Raises
        ------
        ValueError
            For a planned test.
        """
        if self.reading_um is None:
            raise InputError(f"{self._label} must have readings here, got a planned test. Use a campaign, or simulate the plan.")
        return np.asarray(self.reading_um) * 1e-3

    def with_reading_um(self, reading_um: ArrayLike | None) -> CircularTest:
        """The same test with other readings [µm]."""
        return replace(self, reading_um=reading_um)

    def select(self, keep: NDArray[np.bool_]) -> CircularTest:
        """The same test with only the readings where ``keep`` is true."""
        reading = None if self.reading_um is None else self.reading_um[keep]
        return replace(self, angle_deg=self.angle_deg[keep], reading_um=reading)

    @property
    def circle(self) -> Circle:
        """Radius and centre; the campaign's defaults must have been filled in."""
        return Circle(float(self.radius_mm or 0.0), (float(self.centre_x_mm or 0.0), float(self.centre_y_mm or 0.0)))

    @property
    def arc_deg(self) -> float:
        """Covered arc [deg]: 360° minus the largest gap between neighbouring angles, or 360° where it is an ordinary step."""
        return _arc_deg(self.angle_deg)


@dataclass(frozen=True, eq=False)
class Campaign:
    """The tests of one machine.

    Parameters
    ----------
    tests : sequence of CircularTest
    topology, plane, radius_mm : the machine and the default circle
    name : str
    feed_mm_per_min : float, optional
    resolution_um : float
        Of the readout; sets the floor σ ≥ resolution/√12 (default: the paper's 0.24 µm).
    mount : MountCompensation
    force_law : ForceLaw
        Used where a test has only one of force and pressure.
    centre_mm : tuple of two floats
        Default circle centre.

    Raises
    ------
    InputError
        For no tests, repeated names, tests in planes the machine does not have, or a mix of tests with and without readings.
    """

    tests: tuple[CircularTest, ...]
    topology: str = "wCAFYXZSt"
    plane: str = "XY"
    radius_mm: float = 150.0
    name: str = "campaign"
    feed_mm_per_min: float | None = None
    resolution_um: float = 0.24
    mount: MountCompensation = MountCompensation()
    force_law: ForceLaw = ForceLaw()
    centre_mm: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        tests = tuple(self.tests)
        if not tests:
            raise InputError("campaign must have at least one test, got none. Add a circular test.")
        if not (np.isfinite(self.resolution_um) and self.resolution_um > 0):
            raise InputError(f"resolution_um must be a positive number, got {self.resolution_um}. Give the readout's step in µm.")
        _check_positive(self, "radius_mm", self.radius_mm, "mm", LARGEST_LENGTH_MM)
        object.__setattr__(self, "tests", _named(self._resolved(test) for test in tests))
        with_readings = [test.reading_um is not None for test in self.tests]
        if any(with_readings) and not all(with_readings):
            missing = next(test.name for test in self.tests if test.reading_um is None)
            raise InputError(
                f"campaign must have readings in all tests or in none, got test {missing!r} without. "
                "Add its file or plan it apart."
            )
        for plane in dict.fromkeys(test.plane for test in self.tests):
            self.machine(plane)
        if len({test.plane for test in self.tests}) > 1:
            raise InputError("campaign must have all tests in one plane, got several. Fit each plane apart.")

    _label = "campaign"

    def _resolved(self, test: CircularTest) -> CircularTest:
        force, pressure = test.force_N, test.pressure_bar
        if force is None:
            force = self.force_law.force_N(float(pressure or 0.0))
            if force <= 0:
                raise InputError(
                    f"{test._label} must have a force > 0, got {force:.4g} N from {pressure} bar. Check pressure_bar and [force]."
                )
        return replace(
            test,
            force_N=float(force),
            pressure_bar=self.force_law.pressure_bar(force) if pressure is None else float(pressure),
            radius_mm=self.radius_mm if test.radius_mm is None else float(test.radius_mm),
            plane=self.plane if test.plane is None else test.plane,
            centre_x_mm=self.centre_mm[0] if test.centre_x_mm is None else float(test.centre_x_mm),
            centre_y_mm=self.centre_mm[1] if test.centre_y_mm is None else float(test.centre_y_mm),
        )

    def machine(self, plane: str | None = None) -> Machine:
        """The machine in the campaign's plane (or another)."""
        return Machine(self.topology, plane or self.tests[0].plane or self.plane)

    @property
    def is_plan(self) -> bool:
        """True without readings."""
        return self.tests[0].reading_um is None

    @property
    def forces_N(self) -> Array:
        """Force of each test, shape (tests,) [N]."""
        return np.array([test.force_N for test in self.tests], dtype=float)

    @property
    def force_levels(self) -> int:
        """Number of forces that differ by more than a millionth of the largest."""
        ordered = np.sort(self.forces_N)
        return 1 + int(np.sum(np.diff(ordered) > 1e-6 * ordered[-1]))

    @property
    def pressures_bar(self) -> Array:
        """Pressure of each test, shape (tests,) [bar]."""
        return np.array([test.pressure_bar for test in self.tests], dtype=float)

    @property
    def readings(self) -> int:
        """Number of angles in all tests."""
        return sum(len(test.angle_deg) for test in self.tests)

    def without(self, *names: str) -> Campaign:
        """The campaign without the named tests.

        Raises
        ------
        ValueError
            For a name the campaign does not have.
        """
        check_known("test", names, [test.name for test in self.tests])
        return replace(self, tests=tuple(test for test in self.tests if test.name not in names))

    def select(self, names: Sequence[str]) -> Campaign:
        """The campaign with only the named tests."""
        check_known("test", names, [test.name for test in self.tests])
        return self.without(*(test.name for test in self.tests if test.name not in names))

    def plan(self) -> Campaign:
        """The same campaign without readings."""
        return replace(self, tests=tuple(test.with_reading_um(None) for test in self.tests))

    def _repr_html_(self) -> str:
        rows = [
            {
                "test": test.name,
                "force (N)": test.force_N,
                "pressure (bar)": test.pressure_bar,
                "readings": len(test.angle_deg),
                "arc (°)": test.arc_deg,
                "direction": test.direction,
                "work ball (°)": test.work_ball_deg,
                "tool ball (°)": test.tool_ball_deg,
            }
            for test in self.tests
        ]
        kind = "Plan" if self.is_plan else "Campaign"
        return table_html(f"{kind} {self.name}: {self.topology}, plane {self.machine().plane}, R = {self.radius_mm:g} mm", rows)

    @cached_property
    def sha256(self) -> str:
        """SHA-256 of the parsed data: everything the model uses, independent of file layout and of text formatting."""
        digest = hashlib.sha256()
        head = [self.topology, self.resolution_um, self.mount.deflection_um_per_bar, self.mount.compensated]
        digest.update(json.dumps(head).encode())
        for test in self.tests:
            fields = [test.name, test.force_N, test.pressure_bar, test.direction, test.work_ball_deg, test.tool_ball_deg]
            fields += [test.radius_mm, test.plane, test.centre_x_mm, test.centre_y_mm]
            digest.update(json.dumps(fields).encode())
            for column in (test.angle_deg, test.reading_um):
                digest.update(b"" if column is None else np.ascontiguousarray(column, dtype="<f8").tobytes())
        return digest.hexdigest()


Plan = Campaign


def _arc_deg(angle_deg: Array) -> float:
    wrapped = np.unique(np.mod(angle_deg, 360.0))
    if len(wrapped) < 2:
        return 0.0
    gaps = np.diff(np.append(wrapped, wrapped[0] + 360.0))
    largest = float(gaps.max())
    return 360.0 if largest <= 3.0 * float(np.median(gaps)) else 360.0 - largest


def _one_of(test: CircularTest, plain: str, value: Any, other: str, other_value: Any, convert: Any) -> Array | None:
    if value is not None and other_value is not None:
        raise InputError(f"{test._label} must have {plain} or {other}, got both. Keep one of them.")
    given, name = (value, plain) if value is not None else (other_value, other)
    if given is None:
        return None
    array = np.array(given, dtype=float)
    if array.ndim != 1:
        raise InputError(f"{test._label} must have {name} of shape (n,), got shape {array.shape}. Pass one value per reading.")
    bad = np.flatnonzero(~np.isfinite(array))
    if bad.size:
        raise InputError(
            f"{test._label} must have finite {name}, got {array[bad[0]]} at reading {bad[0] + 1}. Remove or correct that reading."
        )
    array = array if value is not None else convert(array)
    array.setflags(write=False)
    return array


def _check_positive(owner: Any, field: str, value: float | None, unit: str, largest: float) -> None:
    if value is not None and value > largest:
        raise InputError(f"{owner._label} must have {field} ≤ {largest:g} {unit}, got {value}. Check the unit.")
    if value is not None and not (np.isfinite(value) and value > 0):
        raise InputError(f"{owner._label} must have {field} > 0 {unit}, got {value}. Correct it.")


def _named(tests: Iterable[CircularTest]) -> tuple[CircularTest, ...]:
    """Give unnamed tests names after their force, numbering repeats; refuse repeated given names."""
    named: list[CircularTest] = []
    tests = tuple(tests)
    taken = [test.name for test in tests if test.name]
    repeated = next((name for name in taken if taken.count(name) > 1), None)
    if repeated is not None:
        raise InputError(f"test names must differ, got {repeated!r} twice. Give each test its own name.")
    used = set(taken)
    for test in tests:
        if not test.name:
            stem = f"f{test.force_N:03.0f}"
            name = next(n for n in (stem, *(f"{stem}_{i}" for i in range(2, len(tests) + 2))) if n not in used)
            used.add(name)
            test = replace(test, name=name)
        named.append(test)
    return tuple(named)
