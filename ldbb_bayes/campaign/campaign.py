"""Campaigns: the tests of one machine; a plan is a campaign without readings."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from functools import cached_property
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, BeforeValidator, SkipValidation
from pydantic.dataclasses import dataclass

from ldbb_bayes.campaign.certified_instrument import Ball, Instrument
from ldbb_bayes.campaign.circular_test import (
    CENTRE,
    PER_TEST,
    CircularTest,
    Direction,
    TestFields,
    distinct_forces,
)
from ldbb_bayes.campaign.field_types import (
    STRICT,
    Coordinate,
    Date,
    Label,
    Length,
    Number,
    Positive,
)
from ldbb_bayes.campaign.loading import ForceLaw, MountCompensation
from ldbb_bayes.errors import InputError, check_known, require
from ldbb_bayes.files import raises_input_error
from ldbb_bayes.machine.chain import Machine
from ldbb_bayes.results import Array, Shown

__all__ = [
    "LABELS",
    "PER_TEST",
    "Ball",
    "Campaign",
    "CampaignFields",
    "CircularTest",
    "Direction",
    "ForceLaw",
    "Instrument",
    "MountCompensation",
    "Plan",
    "TestFields",
    "distinct_forces",
    "require_campaign",
]

# Fields of a campaign that are only names and dates; no result depends on them.
LABELS = (
    "machine_id",
    "date",
    "machine_type",
    "serial_number",
    "operator",
    "place",
    "ball_bar",
    "ball_bar_calibrated",
    "force_device",
)
# Longest one-line text (``repr``) that displays a campaign [characters].
_LONGEST_REPR = 80
# Fields of a test that always enter the SHA-256 digest of a campaign.
_DIGESTED_ALWAYS = (
    "force_N",
    "pressure_bar",
    "direction",
    "work_ball_deg",
    "tool_ball_deg",
    "radius_mm",
    "plane",
    "centre_x_mm",
    "centre_y_mm",
)
# Usual values of further fields of a test. Such a field enters the campaign's SHA-256 digest only
# if it has another value, so that digests from older versions of the program stay valid.
_DIGESTED_UNLESS_USUAL = {
    "centre_z_mm": 0.0,
    "setup": 1.0,
    "temperature_C": None,
    "time_s": None,
}


def _as_tuple(tests: Any) -> Any:
    """Return an iterable of tests as a tuple, and any other object unchanged.

    Texts and mappings are also unchanged; the validation that follows refuses them.
    """
    if isinstance(tests, str | bytes | Mapping):
        return tests
    try:
        return tuple(tests)
    except TypeError:
        return tests


# Type of a field of tests: any iterable of tests is accepted, and stored as a tuple.
Tests = Annotated[Sequence[CircularTest], BeforeValidator(_as_tuple)]


@dataclass(frozen=True, eq=False, kw_only=True)
class CampaignFields(Shown):
    """Fields of a campaign that describe machine, instrument and conditions, but not the tests.

    A program or ``campaign.toml`` states them.
    """

    topology: str = "wCAFYXZSt"  #: machine axes in order from workpiece to tool
    plane: str = "XY"  #: plane of all tests that do not state their own
    radius_mm: Length = 150.0  #: radius of all tests that do not state their own
    name: Label | None = None  #: name of the campaign
    #: name that tells the machines of a fleet apart; default: the serial number
    machine_id: Label | None = None
    date: Date | None = None  #: date in ISO 8601 (2026-11-20, 2026-11-20T14:30)
    # The following names are printed on the report; no number depends on them.
    machine_type: Label | None = None  #: maker and type of the machine
    serial_number: Label | None = None  #: serial number of the machine
    operator: Label | None = None  #: person who measured
    place: Label | None = None  #: place of the measurement
    ball_bar: Label | None = None  #: type and number of the ball bar
    ball_bar_calibrated: Date | None = None  #: date of the ball bar's calibration, ISO 8601
    #: name of the device that makes or measures the force, and of its certificate
    force_device: Label | None = None
    #: tolerances with their units, by quantity: {"C_XXX": "60 nm/N"}. They do not influence a fit;
    #: `assess_conformity` uses them.
    tolerances: Mapping[str, str] = field(default_factory=dict)
    feed_mm_per_min: Number | None = None  #: feed along the circle
    #: resolution of the readout; the standard deviation of the noise is at least resolution/√12
    resolution_um: Positive = 0.24
    #: deflection of the work ball's mount, and whether readings are compensated for it
    mount: MountCompensation = field(default_factory=MountCompensation)
    #: relation of force and pressure, used where a test states only one of them
    force_law: ForceLaw = field(default_factory=ForceLaw)
    #: position (X, Y, Z) of the frame of each joint, by axis letter, as in `Machine`
    frames_mm: SkipValidation[Mapping[str, Sequence[float]]] = field(default_factory=dict)


@raises_input_error("campaign")
@dataclass(frozen=True, eq=False, config=STRICT)
class Campaign(CampaignFields):
    """Circular tests of one machine, with readings or, as a plan, without.

    ``lb.Plan`` is another name of the same class. Tests take the radius, plane and centre that they
    do not state from the campaign, and a missing force or pressure from its force law. Tests
    without a name are named after their force.

    Raises
    ------
    InputError
        If there are no tests, names are repeated, the machine does not have a test's plane, or
        only some of the tests have readings.

    Examples
    --------
    >>> campaign
    <Campaign wCAFYXZSt, recovered experiment: 6 tests, 36 to 742 N, 4320 readings>
    >>> campaign.without("f036").forces_N.round()
    array([238., 364., 490., 616., 742.])
    >>> angle_deg = np.arange(0.0, 360.0, 5.0)
    >>> plan = lb.Plan([lb.CircularTest(force_N, angle_deg) for force_N in (100.0, 400.0, 700.0)])
    >>> [test.name for test in plan.tests]
    ['f100', 'f400', 'f700']
    """

    tests: Tests  #: tests, either all with readings or all without
    name: Label = field(default="campaign", kw_only=True)  #: name of the campaign
    #: centre of the circle in all tests that do not state their own
    centre_mm: Annotated[Sequence[Coordinate], AfterValidator(tuple)] = field(
        default=(0.0, 0.0, 0.0), kw_only=True
    )
    #: certified properties of the instrument
    instrument: Instrument = field(default_factory=Instrument, kw_only=True)
    #: tests that may be run later: the model already includes the effects that only these tests can
    #: show. Their readings are ignored.
    foreseen: Tests = field(default=(), kw_only=True)

    def __post_init__(self) -> None:
        require(self.tests, "campaign must have at least one test, got none. Add a circular test.")
        foreseen = []
        for test in self.foreseen:
            foreseen.append(self._complete(replace(test.with_reading_um(None), name="")))
        tests = _name_tests([self._complete(test) for test in self.tests])
        object.__setattr__(self, "tests", tests)
        object.__setattr__(self, "foreseen", tuple(foreseen))
        planned = [test.name for test in tests if test.reading_um is None]
        if planned and len(planned) < len(tests):
            raise InputError(
                f"campaign must have readings in all tests or in none, got test {planned[0]!r}"
                " without. Add its file or plan it apart."
            )
        object.__setattr__(self, "frames_mm", dict(self.machine().frames_mm))
        object.__setattr__(self, "machine_id", self.machine_id or self.serial_number)

    def _complete(self, test: CircularTest) -> CircularTest:
        """Return the test with every unstated field filled in from the campaign."""
        completed: dict[str, Any] = {
            "radius_mm": self.radius_mm,
            "plane": self.plane,
            "setup": 1,
        }
        # If the campaign's centre has only two coordinates, its Z is zero.
        completed |= dict(zip(CENTRE, (*self.centre_mm, 0.0)[:3], strict=True))
        for name in completed:
            stated = getattr(test, name)
            if stated is not None:
                completed[name] = stated
        completed["force_N"] = test.force_N
        completed["pressure_bar"] = test.pressure_bar
        if test.force_N is None:
            completed["force_N"] = self._force_from_pressure(test)
        if test.pressure_bar is None:
            completed["pressure_bar"] = self.force_law.pressure_bar(completed["force_N"])
        return replace(test, **completed)

    def _force_from_pressure(self, test: CircularTest) -> float:
        force_N = self.force_law.force_N(float(test.pressure_bar or 0.0))
        require(
            force_N > 0,
            f"{test.label} must have a force > 0, got {force_N:.4g} N from {test.pressure_bar} bar."
            " Check pressure_bar and [force].",
        )
        return force_N

    def machine(self) -> Machine:
        """Return the machine, with the planes of all tests, run or foreseen."""
        return Machine(self.topology, tuple(str(test.plane) for test in self.scope), self.frames_mm)

    @property
    def scope(self) -> tuple[CircularTest, ...]:
        """All tests that determine which effects the model has: tests run, then tests foreseen."""
        return (*self.tests, *self.foreseen)

    @property
    def is_plan(self) -> bool:
        """Whether the campaign is a plan, whose tests have no readings."""
        return self.tests[0].reading_um is None

    @property
    def forces_N(self) -> Array:
        """Force of each test, shape (tests,) [N]."""
        return np.array([test.force_N for test in self.tests], dtype=float)

    @property
    def force_levels(self) -> int:
        """Number of different forces; forces within 0.1 % of the largest force count as equal."""
        return len(distinct_forces(self.forces_N))

    @property
    def pressures_bar(self) -> Array:
        """Pressure of the regulator in each test, shape (tests,) [bar]."""
        return np.array([test.pressure_bar for test in self.tests], dtype=float)

    @property
    def readings(self) -> int:
        """Number of readings in all tests together; for a plan, the number of planned readings."""
        return sum(len(test.angle_deg) for test in self.tests)

    def without(self, *names: str) -> Campaign:
        """Return the campaign without the named tests.

        Raise an `InputError` for an unknown name.
        """
        check_known("test", names, [test.name for test in self.tests])
        return replace(self, tests=tuple(test for test in self.tests if test.name not in names))

    def select(self, names: Sequence[str]) -> Campaign:
        """Return the campaign with the named tests alone.

        Raise an `InputError` for an unknown name.
        """
        check_known("test", names, [test.name for test in self.tests])
        return self.without(*(test.name for test in self.tests if test.name not in names))

    def plan(self) -> Campaign:
        """Return the plan of this campaign: the same tests without their readings."""
        return replace(self, tests=tuple(test.with_reading_um(None) for test in self.tests))

    def __repr__(self) -> str:
        kind = "Plan" if self.is_plan else "Campaign"
        size = (
            f": {len(self.tests)} tests, {self.forces_N.min():.4g} to {self.forces_N.max():.4g} N,"
            f" {self.readings} readings>"
        )
        return f"<{kind} {self.name}"[: _LONGEST_REPR - len(size)] + size

    @cached_property
    def sha256(self) -> str:
        """SHA-256 digest of the readings and the conditions under which they were taken.

        The digest does not depend on how the files are written. It does not depend on certificates
        either, which enter the model as prior knowledge.
        """
        digest = hashlib.sha256()
        head: list[Any] = [
            self.topology,
            self.resolution_um,
            self.mount.deflection_um_per_bar,
            self.mount.compensated,
        ]
        for axis, frame in sorted(self.frames_mm.items()):
            if any(frame):
                head.append([axis, *frame])
        digest.update(json.dumps(head).encode())
        for test in self.tests:
            digest.update(json.dumps(_digested_fields(test)).encode())
            for column in (test.angle_deg, test.reading_um):
                if column is not None:
                    digest.update(np.ascontiguousarray(column, dtype="<f8").tobytes())
        if self.is_plan:
            digest.update(b"plan")
        for test in self.foreseen:
            digest.update(json.dumps(["foreseen", *_digested_fields(test)]).encode())
        return digest.hexdigest()


Plan = Campaign


def require_campaign(campaign: object) -> None:
    """Raise an `InputError` unless the argument is a `Campaign`."""
    require(
        isinstance(campaign, Campaign),
        f"campaign must be a Campaign, got {type(campaign).__name__}. Read one with"
        " lb.read_campaign(path), or make it from arrays.",
    )


def _digested_fields(test: CircularTest) -> list[Any]:
    """Return the fields of a test that enter the campaign's digest, without angles and readings."""
    digested: list[Any] = [test.name]
    digested += [getattr(test, name) for name in _DIGESTED_ALWAYS]
    for name, usual in _DIGESTED_UNLESS_USUAL.items():
        stated = getattr(test, name)
        if name == "setup":
            stated = float(test.setup or 1)
        if stated != usual:
            digested.append([name, stated])
    return digested


def _name_tests(tests: Sequence[CircularTest]) -> tuple[CircularTest, ...]:
    """Return the tests with a name for each; tests without one are named after their force.

    The name of a test at 36 N is f036; repetitions of a force are numbered. Raise an `InputError`
    for a name that the user gave twice.
    """
    given_names = [test.name for test in tests if test.name]
    for name in given_names:
        require(
            given_names.count(name) == 1,
            f"test names must differ, got {name!r} twice. Give each test its own name.",
        )
    names = set(given_names)
    named = []
    for test in tests:
        if test.name:
            named.append(test)
        else:
            name = _free_name(f"f{test.force_N:03.0f}", names)
            named.append(replace(test, name=name))
            names.add(name)
    return tuple(named)


def _free_name(stem: str, names: set[str]) -> str:
    """Return a name that is not in ``names``: the stem, or the stem with the first free number."""
    name = stem
    number = 1
    while name in names:
        number += 1
        name = f"{stem}_{number}"
    return name
