"""One circular test: one circle at one force, measured or planned."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ldbb_bayes.errors import InputError
from ldbb_bayes.machine.chain import Circle

__all__ = ["LARGEST_LENGTH_MM", "CircularTest", "Direction", "check_positive"]

Array = NDArray[np.float64]
Direction = Literal["CW", "CCW"]
MINIMUM_READINGS = 9
MINIMUM_ARC_DEG = 180.0
LARGEST_READING_UM = 1e5
LARGEST_FORCE_N = 1e6
LARGEST_LENGTH_MM = 1e5
LARGEST_SETUP = 1000
_CENTRE = ("centre_x_mm", "centre_y_mm", "centre_z_mm")
SAFE_NAME = re.compile(r"[\w+\-][\w+\-. ]{0,99}")


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
    radius_mm, plane, centre_x_mm, centre_y_mm, centre_z_mm : optional
        Default: the campaign's. The centre is the work ball in machine coordinates, whatever the plane.
    setup : int, optional
        Number of the set-up, 1, 2, …: tests of one set-up share the tool ball's offsets. Default 1.
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
    centre_z_mm: float | None = None
    setup: int | None = None
    temperature_C: float | None = None
    time_s: float | None = None
    angle_rad: Any = None
    reading_mm: Any = None

    def __post_init__(self) -> None:
        angle = _one_of(self, "angle_deg", self.angle_deg, "angle_rad", self.angle_rad, np.rad2deg)
        reading = _one_of(self, "reading_um", self.reading_um, "reading_mm", self.reading_mm, lambda x: x * 1e3)
        if angle is None:
            raise InputError(f"{self.label} must have angles, got none. Give angle_deg (or angle_rad).")
        if len(angle) < MINIMUM_READINGS:
            raise InputError(
                f"{self.label} must have at least {MINIMUM_READINGS} readings, got {len(angle)}. "
                "Leave the test out or record more."
            )
        if reading is not None and len(reading) != len(angle):
            raise InputError(
                f"{self.label} must have one reading per angle, got {len(angle)} angles and {len(reading)} readings. "
                "Check the two columns."
            )
        if self.force_N is None and self.pressure_bar is None:
            raise InputError(f"{self.label} must have a force or a pressure, got neither. Give force_N or pressure_bar.")
        if _arc_deg(angle) < MINIMUM_ARC_DEG:
            raise InputError(
                f"{self.label} must cover an arc of at least {MINIMUM_ARC_DEG:g}°, got {_arc_deg(angle):.3g}°. "
                "Check the unit of the angle (degrees or radians) or leave the test out."
            )
        check_positive(self, "force_N", self.force_N, "N", LARGEST_FORCE_N)
        check_positive(self, "radius_mm", self.radius_mm, "mm", LARGEST_LENGTH_MM)
        if self.pressure_bar is not None and self.pressure_bar < 0:
            raise InputError(f"{self.label} must have pressure_bar ≥ 0, got {self.pressure_bar}. Correct it.")
        if reading is not None and np.abs(reading).max() > LARGEST_READING_UM:
            raise InputError(
                f"{self.label} must have readings below {LARGEST_READING_UM * 1e-3:g} mm, "
                f"got {np.abs(reading).max() * 1e-3:.4g} mm. Check the unit of the readings."
            )
        if self.name and not SAFE_NAME.fullmatch(self.name):
            raise InputError(
                f"a test's name must be letters, digits, spaces, '_', '-', '+' or '.', not starting with a dot, "
                f"got {self.name!r}. Rename it: the name becomes a file's."
            )
        for field in ("pressure_bar", "work_ball_deg", "tool_ball_deg", *_CENTRE, "temperature_C", "time_s"):
            value = getattr(self, field)
            if value is not None and not (
                np.isfinite(value) and (not field.startswith("centre") or abs(value) <= LARGEST_LENGTH_MM)
            ):
                raise InputError(f"{self.label} must have a finite {field}, got {value}. Correct or remove it.")
        if self.setup is not None and (self.setup != int(self.setup) or not 1 <= self.setup <= LARGEST_SETUP):
            raise InputError(f"{self.label} must have a setup of 1, 2, …, got {self.setup}. Number the set-ups, or leave it out.")
        if self.direction not in (None, "CW", "CCW"):
            raise InputError(f"{self.label} must have direction CW or CCW, got {self.direction!r}. Correct or remove it.")
        object.__setattr__(self, "setup", None if self.setup is None else int(self.setup))
        object.__setattr__(self, "angle_deg", angle)
        object.__setattr__(self, "reading_um", reading)
        object.__setattr__(self, "angle_rad", None)
        object.__setattr__(self, "reading_mm", None)

    @property
    def label(self) -> str:
        """How messages call it."""
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
            raise InputError(f"{self.label} must have readings here, got a planned test. Use a campaign, or simulate the plan.")
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
        """Radius, centre and plane; the campaign's defaults must have been filled in."""
        x, y, z = (float(getattr(self, field) or 0.0) for field in _CENTRE)
        return Circle(float(self.radius_mm or 0.0), (x, y, z), self.plane or "XY")

    @property
    def arc_deg(self) -> float:
        """Covered arc [deg]: 360° minus the largest gap between neighbouring angles, or 360° where it is an ordinary step."""
        return _arc_deg(self.angle_deg)


def _arc_deg(angle_deg: Array) -> float:
    wrapped = np.unique(np.mod(angle_deg, 360.0))
    if len(wrapped) < 2:
        return 0.0
    gaps = np.diff(np.append(wrapped, wrapped[0] + 360.0))
    largest = float(gaps.max())
    return 360.0 if largest <= 3.0 * float(np.median(gaps)) else 360.0 - largest


def _one_of(test: CircularTest, plain: str, value: Any, other: str, other_value: Any, convert: Any) -> Array | None:
    if value is not None and other_value is not None:
        raise InputError(f"{test.label} must have {plain} or {other}, got both. Keep one of them.")
    given, name = (value, plain) if value is not None else (other_value, other)
    if given is None:
        return None
    array = np.array(given, dtype=float)
    if array.ndim != 1:
        raise InputError(f"{test.label} must have {name} of shape (n,), got shape {array.shape}. Pass one value per reading.")
    bad = np.flatnonzero(~np.isfinite(array))
    if bad.size:
        raise InputError(
            f"{test.label} must have finite {name}, got {array[bad[0]]} at reading {bad[0] + 1}. Remove or correct that reading."
        )
    array = array if value is not None else convert(array)
    array.setflags(write=False)
    return array


def check_positive(owner: Any, field: str, value: float | None, unit: str, largest: float) -> None:
    """Refuse a field of ``owner`` that is not a positive number, or absurdly large."""
    if value is not None and value > largest:
        raise InputError(f"{owner.label} must have {field} ≤ {largest:g} {unit}, got {value}. Check the unit.")
    if value is not None and not (np.isfinite(value) and value > 0):
        raise InputError(f"{owner.label} must have {field} > 0 {unit}, got {value}. Correct it.")
