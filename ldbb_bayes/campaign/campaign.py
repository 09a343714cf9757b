"""Campaigns of circular tests of one machine. A plan is a campaign without readings."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from functools import cached_property
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BeforeValidator, SkipValidation, StrictBool
from pydantic.dataclasses import dataclass

from ldbb_bayes.campaign.certified_instrument import Ball, Instrument
from ldbb_bayes.campaign.circles_digest import circles_digest
from ldbb_bayes.campaign.circular_test import (
    CENTRE,
    PER_TEST,
    CircularTest,
    Direction,
    TestFields,
    distinct_forces,
    setup_number,
)
from ldbb_bayes.campaign.field_types import (
    STRICT,
    Coordinate,
    Date,
    Label,
    Length,
    Positive,
    Resolution,
)
from ldbb_bayes.campaign.loading import ForceLaw, MountCompensation
from ldbb_bayes.errors import InputError, check_known, require
from ldbb_bayes.files import raises_input_error
from ldbb_bayes.machine.chain import PLANES, Machine
from ldbb_bayes.results import LONGEST_REPR, Array, Shown

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
    "Order",
    "Plan",
    "TestFields",
    "distinct_forces",
    "require_campaign",
]

# Type of the field that describes the order in which the tests of a campaign were run. The value
# "random" means that the tests were run in random order.
Order = Literal["random"]
# Names of those fields of `Campaign` that hold names and dates. No result depends on the values of
# these fields.
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
# Advice to a user who gives something else than a list of tests, such as the name of a folder.
_ADVICE_ON_TESTS = (
    "Make tests with lb.CircularTest(...); read a campaign with lb.read_campaign(...)."
)
# A stated force is that of the force law if it differs from it by at most this share.
_SAME_FORCE = 1e-6
# Names of the fields of a test whose values always contribute to the SHA-256 digest of its
# campaign.
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
# Names and default values of those fields of a test that contribute to the SHA-256 digest of the
# campaign only if their value differs from the default. Older versions of the program did not have
# these fields; the digests computed by older versions therefore remain valid.
_DIGESTED_UNLESS_USUAL = {
    "centre_z_mm": 0.0,
    "setup": 1.0,
    "temperature_C": None,
    "time_s": None,
}


def _as_tuple(tests: Any) -> Any:
    """Return an iterable of tests as a tuple.

    Strings, mappings and objects that are not iterable are returned unchanged; they are refused
    when the fields of the campaign are checked.
    """
    if isinstance(tests, str | bytes | Mapping):
        return tests
    try:
        return tuple(tests)
    except TypeError:
        return tests


# Type of those fields of a campaign that hold tests. Any iterable of tests is accepted; it is
# stored as a tuple.
Tests = Annotated[Sequence[CircularTest], BeforeValidator(_as_tuple)]


@dataclass(frozen=True, eq=False, kw_only=True)
class CampaignFields(Shown):
    """Fields of a campaign that describe machine, instrument and conditions, but not the tests.

    The values of these fields come from the user's script or from the file ``campaign.toml``.
    """

    #: machine axes in order from workpiece to tool, such as wCAFYXZSt: w is the workpiece, F the
    #: machine's foundation, S the spindle and t the tool; the other letters name the axes
    topology: str = "wCAFYXZSt"
    plane: str = "XY"  #: plane (XY, YZ or ZX) of all tests for which no plane is given
    radius_mm: Length = 150.0  #: radius [mm] of all tests for which no radius is given
    name: Label | None = None  #: name of the campaign
    #: name that distinguishes the machine from other machines; by default the machine's serial
    #: number
    machine_id: Label | None = None
    #: date of the measurement in ISO 8601, such as 2026-11-20 or 2026-11-20T14:30
    date: Date | None = None
    # The fields from here to `force_device` hold names and a date, which are printed on the report.
    # No computed number depends on these fields.
    machine_type: Label | None = None  #: maker and type of the machine
    serial_number: Label | None = None  #: serial number of the machine
    operator: Label | None = None  #: name of the person who measured
    place: Label | None = None  #: place of the measurement
    ball_bar: Label | None = None  #: type and number of the ball bar
    ball_bar_calibrated: Date | None = None  #: date of the ball bar's calibration, ISO 8601
    #: name of the device that makes or measures the force, followed by the name of its certificate
    force_device: Label | None = None
    #: tolerances as strings with units, such as {"C_XXX": "60 nm/N"}; the keys are the names of the
    #: quantities. Tolerances do not influence a fit; `assess_conformity` uses them.
    tolerances: Mapping[str, str] = field(default_factory=dict)
    feed_mm_per_min: Positive | None = None  #: feed of the tool along the circle [mm/min]
    #: resolution of the ball bar's readout [µm]; the model assumes that the standard deviation of
    #: the readings' noise is at least ``resolution_um`` / √12
    resolution_um: Resolution = 0.24
    #: order in which the tests were run: None if they were run in the order in which they are
    #: listed, "random" if they were run in random order. If ``time_s`` is given for all tests,
    #: these times are used instead.
    order: Order | None = None
    #: whether the model assumes that the length of the bar and the centre of the circle may have
    #: drifted from test to test, as they do while a machine warms up
    drift: StrictBool = True
    #: deflection of the work ball's mount, and whether readings are compensated for this deflection
    mount: MountCompensation = field(default_factory=MountCompensation)
    #: force law: the force of the bar as a linear function of the regulator's pressure. If only the
    #: force or only the pressure of a test is given, the other quantity is computed with this law.
    force_law: ForceLaw = field(default_factory=ForceLaw)
    #: position (X, Y, Z) [mm] of the coordinate frame of each joint when all axes are at zero,
    #: relative to the point where the two balls coincide; see `Machine`. The keys are the letters
    #: of the joints' axes.
    frames_mm: SkipValidation[Mapping[str, Sequence[float]]] = field(default_factory=dict)


@raises_input_error("campaign", {"tests": _ADVICE_ON_TESTS})
@dataclass(frozen=True, eq=False, config=STRICT)
class Campaign(CampaignFields):
    """Circular tests of one machine: a campaign with readings, or a plan without readings.

    ``lb.Plan`` is another name for the same class. If no radius, plane or centre is given for a
    test, the campaign's value is used. If only the force or only the pressure of a test is given,
    the missing quantity is computed with the campaign's force law, which expresses the force as a
    linear function of the pressure. Tests without a name are named after their force.

    Raises
    ------
    InputError
        If there are no tests, if two tests have the same name, if the machine cannot move in the
        plane of a test, or if only some of the tests have readings.

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

    tests: Tests  #: circular tests of the campaign, either all with readings or all without
    name: Label = field(default="campaign", kw_only=True)  #: name of the campaign
    #: centre (X, Y, Z) of the circle [mm] in all tests for which no centre is given
    centre_mm: Annotated[Sequence[Coordinate], AfterValidator(tuple)] = field(
        default=(0.0, 0.0, 0.0), kw_only=True
    )
    #: certified properties of the instrument: balls, bar, mount, force device and angles
    instrument: Instrument = field(default_factory=Instrument, kw_only=True)
    #: tests without readings that may be run later. The model of the campaign already includes
    #: effects that only these tests can reveal.
    foreseen: Tests = field(default=(), kw_only=True)
    #: the campaign or plan from which this plan was designed; None if there is none. Forecasts of
    #: the plan use what the pilot's readings show about the machine, the scatter and the
    #: instrument. If this campaign has readings, analyses of these readings do not use the pilot.
    pilot: SkipValidation[Campaign | None] = field(default=None, kw_only=True)
    #: whether the tests of this plan are run in addition to the tests of the pilot. If so, the
    #: pilot's tests count as already run. The pilot is the campaign or plan from which this plan
    #: was designed.
    adds_to_pilot: StrictBool = field(default=False, kw_only=True)

    def __post_init__(self) -> None:
        """Check the fields of the campaign, and complete its tests with the campaign's values.

        Every test gets a name, a circle (radius, centre and plane), a force and a pressure. Raise
        an `InputError` if fields contradict each other.
        """
        self._check_pilot()
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
                " without. Add its file, or take the tests that have not been run out."
            )
        for test in self.scope:
            if test.plane != self.plane:
                check_known(f"plane of {test.label}", [str(test.plane)], PLANES)
        _check_radii(self.scope)
        object.__setattr__(self, "frames_mm", dict(self.machine().frames_mm))
        object.__setattr__(self, "machine_id", self.machine_id or self.serial_number)

    def _check_pilot(self) -> None:
        """Raise an `InputError` if a plan cannot be designed from its pilot.

        The pilot is the campaign or plan from which a plan is designed. Its machine must have the
        same topology (sequence of axes) as the machine of the plan. If the plan has no pilot, the
        field ``adds_to_pilot`` must be false; it states whether the plan's tests are run in
        addition to the pilot's tests.
        """
        if self.pilot is None:
            require(
                not self.adds_to_pilot,
                "adds_to_pilot must go with a pilot, got none. Name the pilot, or leave it out.",
            )
            return
        require_campaign(self.pilot)
        require(
            self.pilot.topology == self.topology,
            f"pilot must be of the plan's machine {self.topology}, got {self.pilot.topology}. Take"
            " the pilot of this machine, or none.",
        )

    def _complete(self, test: CircularTest) -> CircularTest:
        """Return a copy of a test with radius, plane, centre, set-up, force and pressure filled in.

        If no radius, plane or centre is given for the test, the campaign's value is filled in. If
        no set-up is given, set-up 1 is assumed. If only the force or only the pressure is given,
        the missing quantity is computed with the campaign's force law, which expresses the force as
        a linear function of the pressure. Raise an `InputError` if the computed force is not
        positive.
        """
        completed: dict[str, Any] = {
            "radius_mm": self.radius_mm,
            "plane": self.plane,
            "setup": 1,
        }
        # If the centre of the circle that the campaign states has only the coordinates X and Y, Z
        # is taken as zero.
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
        if all(getattr(test, name) == value for name, value in completed.items()):
            return test
        return replace(test, **completed)

    def _force_from_pressure(self, test: CircularTest) -> float:
        """Return the force [N] that follows from a test's pressure by the campaign's force law.

        Raise an `InputError` if this force is not positive.
        """
        force_N = self.force_law.force_N(float(test.pressure_bar or 0.0))
        require(
            force_N > 0,
            f"{test.label} must have a force > 0, got {force_N:.4g} N from {test.pressure_bar} bar."
            " Check pressure_bar and [force].",
        )
        return force_N

    def machine(self) -> Machine:
        """Return the campaign's machine, with the planes of all tests of the campaign.

        The planes of foreseen tests, which may be run later, are included.
        """
        return Machine(self.topology, tuple(str(test.plane) for test in self.scope), self.frames_mm)

    @property
    def scope(self) -> tuple[CircularTest, ...]:
        """Tests of the campaign, followed by the tests in ``foreseen``, which may be run later.

        The model of the campaign includes every effect that at least one of these tests can reveal.
        """
        return (*self.tests, *self.foreseen)

    @property
    def is_plan(self) -> bool:
        """Whether the campaign is a plan, whose tests have no readings."""
        return self.tests[0].reading_um is None

    @property
    def mean_centre_mm(self) -> tuple[float, ...]:
        """Mean of the centres of the circles on X, Y and Z [mm].

        On each axis it is the mean of the different centres of those circles in whose plane the
        axis lies; zero if there are none. Each centre counts once, however many tests have it.
        """
        mean_mm = []
        for axis, letter in enumerate("XYZ"):
            centres = {
                tuple(test.circle.centre_mm) for test in self.tests if letter in str(test.plane)
            }
            positions_mm = [centre[axis] for centre in sorted(centres)]
            mean_mm.append(float(np.mean(positions_mm)) if positions_mm else 0.0)
        return tuple(mean_mm)

    @property
    def forces_N(self) -> Array:
        """Force of the bar in each test, shape (tests,) [N]."""
        return np.array([test.force_N for test in self.tests], dtype=float)

    @property
    def force_levels(self) -> int:
        """Number of different forces of the tests.

        Forces that differ by at most 0.1 % of the largest force count as equal.
        """
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
        """Return the campaign without the tests that ``names`` lists.

        If the start times of the tests are not given, the remaining tests are assumed to have been
        run directly one after another. Raise an `InputError` for an unknown name, or if no test
        remains.
        """
        check_known("test", names, [test.name for test in self.tests])
        return replace(self, tests=tuple(test for test in self.tests if test.name not in names))

    def select(self, names: Sequence[str]) -> Campaign:
        """Return the campaign with only the tests that ``names`` lists, in the campaign's order.

        Raise an `InputError` for an unknown name, or if ``names`` is empty.
        """
        check_known("test", names, [test.name for test in self.tests])
        return self.without(*(test.name for test in self.tests if test.name not in names))

    def plan(self) -> Campaign:
        """Return the plan of this campaign: the same tests without their readings."""
        return replace(self, tests=tuple(test.with_reading_um(None) for test in self.tests))

    def __repr__(self) -> str:
        """Return the name of the campaign, its forces and the numbers of its tests and readings."""
        kind = "Plan" if self.is_plan else "Campaign"
        size = (
            f": {len(self.tests)} tests, {self.forces_N.min():.4g} to {self.forces_N.max():.4g} N,"
            f" {self.readings} readings>"
        )
        head = f"<{kind} {self.name}"
        room = LONGEST_REPR - len(size)
        if len(head) > room:
            head = f"{head[: room - 1]}…"
        return head + size

    @cached_property
    def sha256(self) -> str:
        """SHA-256 digest of the readings and the conditions under which they were taken.

        The conditions are the fields of each test, and the fields topology, frames_mm, mount,
        resolution_um, order and drift of the campaign. The digest also depends on the names and the
        sequence of the tests, and on the tests in the field ``foreseen``, which may be run later.
        The digest does not depend on the format of the files, on certificates, or on the pilot (the
        campaign from which a plan was designed).
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
        if self.order is not None:
            head.append(["order", self.order])
        if not self.drift:
            head.append(["drift", self.drift])
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

    @property
    def forces_follow_law(self) -> bool:
        """Whether the force of every test is that of the force law at the pressure of the test.

        It is if tests state forces or pressures, but not both. It is not if they state pressures
        and forces that were measured otherwise, such as with a load cell.
        """
        for test in self.tests:
            by_law_N = self.force_law.force_N(float(test.pressure_bar or 0.0))
            if not np.isclose(float(test.force_N or 0.0), by_law_N, rtol=_SAME_FORCE):
                return False
        return True

    @property
    def uses_force_law(self) -> bool:
        """Whether the force or the pressure of at least one test was computed by the force law.

        If every test states both, the law is not used. A test that states the very numbers that the
        law gives cannot be distinguished from one that states only one of them.
        """
        for test in self.tests:
            by_law_N = self.force_law.force_N(float(test.pressure_bar or 0.0))
            if np.isclose(float(test.force_N or 0.0), by_law_N, rtol=_SAME_FORCE):
                return True
        return False

    @cached_property
    def circles_sha256(self) -> str | None:
        """SHA-256 digest of the angles and readings alone; None for a plan.

        Two campaigns with the same digest were made from the same readings, which must not count
        twice. Unlike ``sha256``, the digest does not depend on anything else that is stated, such
        as names, forces, the order in which the tests were run, or the mount. It also does not
        depend on the sequence of the tests, or on a constant that is added to all readings of a
        test: readings that are compensated for another deflection of the mount differ by such
        constants.
        """
        return None if self.is_plan else circles_digest(self.tests)


Plan = Campaign


def require_campaign(campaign: object) -> None:
    """Raise an `InputError` unless the argument is a `Campaign`."""
    require(
        isinstance(campaign, Campaign),
        f"campaign must be a Campaign, got {type(campaign).__name__}. Read one with"
        " lb.read_campaign(path), or make it from arrays.",
    )


def _digested_fields(test: CircularTest) -> list[Any]:
    """Return the values of a test that contribute to the SHA-256 digest of its campaign.

    The angles and readings contribute to the digest too, but are not returned.
    """
    digested: list[Any] = [test.name]
    digested += [getattr(test, name) for name in _DIGESTED_ALWAYS]
    for name, usual in _DIGESTED_UNLESS_USUAL.items():
        stated = getattr(test, name)
        if name == "setup":
            stated = float(setup_number(test))
        if stated != usual:
            digested.append([name, stated])
    return digested


def _check_radii(tests: Sequence[CircularTest]) -> None:
    """Raise an `InputError` if radii of tests differ, but have the same first six digits.

    Each radius has a bar length of its own, which is named by these digits.
    """
    first_with: dict[str, CircularTest] = {}
    for test in tests:
        radius_mm = test.circle.radius_mm
        first = first_with.setdefault(f"{radius_mm:g}", test)
        require(
            radius_mm == first.circle.radius_mm,
            f"radius_mm must be the same in {first.label} and {test.label}, or differ in its first"
            f" six digits, got {first.circle.radius_mm!r} and {radius_mm!r}. Give both tests the"
            " nominal radius.",
        )


def _name_tests(tests: Sequence[CircularTest]) -> tuple[CircularTest, ...]:
    """Return the tests of a campaign, each with a name; unnamed tests are named after their force.

    A test at 36 N gets the name f036. A second test at this force gets the name f036_2. Raise an
    `InputError` for a name that the user gave twice.
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
    """Return a name for a test that differs from the names of all other tests, ``names``.

    The name is ``stem`` itself if no other test has this name. Otherwise it is the first of stem_2,
    stem_3, … that no other test has.
    """
    name = stem
    number = 1
    while name in names:
        number += 1
        name = f"{stem}_{number}"
    return name
