"""A campaign: the tests of one machine. A plan is the same without readings."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.campaign.circular_test import LARGEST_LENGTH_MM, CircularTest, check_positive
from ldbb_bayes.campaign.loading import ForceLaw, MountCompensation
from ldbb_bayes.errors import InputError, check_known
from ldbb_bayes.machine.chain import Machine
from ldbb_bayes.notebook import table_html

__all__ = ["Campaign", "Plan", "check_campaign"]

Array = NDArray[np.float64]


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
    centre_mm : tuple of two or three floats
        Default circle centre (X, Y, Z) in machine coordinates.
    frames_mm : mapping of axis letter to (x, y, z), optional
        Where the joints' frames stand; see `Machine`.
    machine_id : str, optional
        Which machine was measured (a serial or inventory number): what tells the machines of a fleet apart.
    date : str, optional
        When, as ISO 8601 (2026-11-20, 2026-11-20T14:30).
    foreseen : sequence of CircularTest, optional
        Tests that may follow: what only they can show is modelled already. Their readings, if any, are dropped.

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
    mount: MountCompensation = field(default_factory=MountCompensation)
    force_law: ForceLaw = field(default_factory=ForceLaw)
    centre_mm: tuple[float, ...] = (0.0, 0.0, 0.0)
    frames_mm: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    foreseen: tuple[CircularTest, ...] = ()
    machine_id: str | None = None
    date: str | None = None

    def __post_init__(self) -> None:
        tests = tuple(self.tests)
        if not tests:
            raise InputError("campaign must have at least one test, got none. Add a circular test.")
        if not self.name.isprintable():
            raise InputError(f"campaign must have a name that can be printed, got {self.name[:80]!r}. Correct it.")
        _check_origin(self.machine_id, self.date)
        if not (np.isfinite(self.resolution_um) and self.resolution_um > 0):
            raise InputError(f"resolution_um must be a positive number, got {self.resolution_um}. Give the readout's step in µm.")
        check_positive(self, "radius_mm", self.radius_mm, "mm", LARGEST_LENGTH_MM)
        object.__setattr__(self, "tests", _named(self._resolved(test) for test in tests))
        foreseen = tuple(self._resolved(replace(test.with_reading_um(None), name="")) for test in self.foreseen)
        object.__setattr__(self, "foreseen", foreseen)
        with_readings = [test.reading_um is not None for test in self.tests]
        if any(with_readings) and not all(with_readings):
            missing = next(test.name for test in self.tests if test.reading_um is None)
            raise InputError(
                f"campaign must have readings in all tests or in none, got test {missing!r} without. "
                "Add its file or plan it apart."
            )
        object.__setattr__(self, "frames_mm", dict(self.machine().frames_mm))

    label = "campaign"

    def _resolved(self, test: CircularTest) -> CircularTest:
        x, y, z = (*self.centre_mm, 0.0)[:3]
        force, pressure = test.force_N, test.pressure_bar
        if force is None:
            force = self.force_law.force_N(float(pressure or 0.0))
            if force <= 0:
                raise InputError(
                    f"{test.label} must have a force > 0, got {force:.4g} N from {pressure} bar. Check pressure_bar and [force]."
                )
        return replace(
            test,
            force_N=float(force),
            pressure_bar=self.force_law.pressure_bar(force) if pressure is None else float(pressure),
            radius_mm=self.radius_mm if test.radius_mm is None else float(test.radius_mm),
            plane=self.plane if test.plane is None else test.plane,
            centre_x_mm=x if test.centre_x_mm is None else float(test.centre_x_mm),
            centre_y_mm=y if test.centre_y_mm is None else float(test.centre_y_mm),
            centre_z_mm=z if test.centre_z_mm is None else float(test.centre_z_mm),
            setup=1 if test.setup is None else test.setup,
        )

    def machine(self) -> Machine:
        """The machine and the planes of all tests, run or foreseen."""
        return Machine(self.topology, tuple(str(test.plane) for test in self.scope), self.frames_mm)

    @property
    def scope(self) -> tuple[CircularTest, ...]:
        """All tests that the model knows of: those run and those foreseen."""
        return (*self.tests, *self.foreseen)

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
                "plane": test.plane,
                "radius (mm)": test.radius_mm,
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
        head: list[Any] = [self.topology, self.resolution_um, self.mount.deflection_um_per_bar, self.mount.compensated]
        head += [[axis, *frame] for axis, frame in sorted(self.frames_mm.items()) if any(frame)]
        digest.update(json.dumps(head).encode())
        for test in self.tests:
            digest.update(json.dumps(_digested(test)).encode())
            for column in (test.angle_deg, test.reading_um):
                digest.update(b"" if column is None else np.ascontiguousarray(column, dtype="<f8").tobytes())
        if self.is_plan:
            digest.update(b"plan")
        for test in self.foreseen:
            digest.update(json.dumps(["foreseen", *_digested(test)]).encode())
        return digest.hexdigest()


Plan = Campaign


def check_campaign(campaign: object) -> None:
    """Answer a path, or anything else that is no campaign, with the right call; None passes."""
    if campaign is not None and not isinstance(campaign, Campaign):
        raise InputError(
            f"campaign must be a Campaign, got {type(campaign).__name__}. "
            "Read one with lb.read_campaign(path), or make it from arrays."
        )


def _check_origin(machine_id: str | None, date: str | None) -> None:
    if machine_id is not None and not (machine_id.strip() and machine_id.isprintable()):
        raise InputError(f"machine_id must be a name that can be printed, got {machine_id[:80]!r}. Correct it or leave it out.")
    try:
        datetime.fromisoformat(date or "2026-11-20")
    except ValueError:
        raise InputError(f"date must be a date as ISO 8601, got {str(date)[:80]!r}. For example 2026-11-20.") from None


def _digested(test: CircularTest) -> list[Any]:
    """What the model uses of a test beside its readings, numbers as floats."""
    fields: list[Any] = [test.name, _float(test.force_N), _float(test.pressure_bar), test.direction]
    fields += [_float(test.work_ball_deg), _float(test.tool_ball_deg), _float(test.radius_mm)]
    fields += [test.plane, _float(test.centre_x_mm), _float(test.centre_y_mm)]
    usual = {"centre_z_mm": 0.0, "setup": 1.0, "temperature_C": None, "time_s": None}
    return fields + [[name, _float(getattr(test, name))] for name, value in usual.items() if _float(getattr(test, name)) != value]


def _float(value: float | None) -> float | None:
    return None if value is None else float(value)


def _named(tests: Iterable[CircularTest]) -> tuple[CircularTest, ...]:
    """Give unnamed tests names after their force, numbering repeats; refuse repeated given names."""
    named: list[CircularTest] = []
    tests = tuple(tests)
    taken = [test.name for test in tests if test.name]
    repeated = next((name for name in taken if taken.count(name) > 1), None)
    if repeated is not None:
        raise InputError(f"test names must differ, got {repeated!r} twice. Give each test its own name.")
    used = set(taken)
    repeats: dict[str, int] = {}
    for test in tests:
        if not test.name:
            stem = f"f{test.force_N:03.0f}"
            count = repeats.get(stem, 0) + 1
            name = stem if count == 1 else f"{stem}_{count}"
            while name in used:
                count += 1
                name = f"{stem}_{count}"
            repeats[stem] = count
            used.add(name)
            test = replace(test, name=name)
        named.append(test)
    return tuple(named)
