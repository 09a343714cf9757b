"""A campaign: the tests of one machine. A plan is the same without readings."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import field, fields, replace
from datetime import date, datetime
from functools import cached_property, lru_cache
from itertools import count
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import AfterValidator, BeforeValidator, ConfigDict, Field, SkipValidation
from pydantic.dataclasses import dataclass

from ldbb_bayes.errors import InputError, check_known, require
from ldbb_bayes.files import refusing
from ldbb_bayes.machine.chain import Circle, Machine
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
    "check_campaign",
    "distinct_forces",
]

Direction = Literal["CW", "CCW"]
MINIMUM_READINGS = 9
MINIMUM_ARC_DEG = 180.0
LARGEST_READING_MM = 100.0
LARGEST_SETUP = 1000
# A regulator repeats a force no better than to this share of the largest.
SAME_FORCE = 1e-3
# Deviation from sphericity that each grade of ISO 3290 allows [µm].
_GRADES_UM = {"G3": 0.08, "G5": 0.13, "G10": 0.25, "G20": 0.5, "G40": 1.0, "G100": 2.5, "G200": 5.0}


def _no_text(value: Any) -> Any:
    if isinstance(value, str | bool):
        raise ValueError("it should be a number")
    return value


def _printable(text: str) -> str:
    if not (text.strip() and text.isprintable()):
        raise ValueError("it should be a name that can be printed")
    return text


def _iso(when: Any) -> str:
    try:
        return (
            when.isoformat()
            if isinstance(when, date)
            else str(datetime.fromisoformat(when) and when)
        )
    except (TypeError, ValueError):
        raise ValueError("it should be a date as ISO 8601, for example 2026-11-20") from None


def _file_name(name: str) -> str:
    if name and not re.fullmatch(r"[\w+\-][\w+\-. ]{0,99}", name):
        raise ValueError(
            "it names a file: letters, digits, spaces, '_', '-', '+' or '.', not starting with"
            " a dot"
        )
    return name


_STRICT = ConfigDict(extra="forbid")
Number = Annotated[float, BeforeValidator(_no_text), Field(allow_inf_nan=False)]
Force = Annotated[Number, Field(gt=0.0, le=1e6)]
Pressure = Annotated[Number, Field(ge=0.0)]
Positive = Annotated[Number, Field(gt=0.0)]
# Of a certificate, µm or N, and degrees: what is larger is in another unit.
Certified = Annotated[Number, Field(gt=0.0, le=1e3)]
CertifiedAngle = Annotated[Number, Field(gt=0.0, le=10.0)]
Percent = Annotated[Number, Field(gt=0.0, le=100.0)]
Harmonic = tuple[Annotated[int, BeforeValidator(_no_text), Field(ge=2, le=12)], Pressure, Number]
Length = Annotated[Number, Field(gt=0.0, le=1e5)]
Coordinate = Annotated[Number, Field(ge=-1e5, le=1e5)]
Label = Annotated[str, AfterValidator(_printable)]
Date = Annotated[str, BeforeValidator(_iso)]


@refusing("force law ([force])")
@dataclass(frozen=True, config=_STRICT)
class ForceLaw(Shown):
    """F = slope · P + offset: what the regulator pressure does to the force (default: the paper's
    bar)."""

    slope_N_per_bar: Positive = 126.04  #: force per pressure
    offset_N: Number = -14.2  #: force at zero pressure

    def force_N(self, pressure_bar: float) -> float:
        """Force at a pressure [N]."""
        return self.slope_N_per_bar * pressure_bar + self.offset_N

    def pressure_bar(self, force_N: float) -> float:
        """Pressure for a force [bar]."""
        return (force_N - self.offset_N) / self.slope_N_per_bar


@refusing("mount ([mount])")
@dataclass(frozen=True, config=_STRICT)
class MountCompensation(Shown):
    """Deflection of the work ball's mount per bar (Eq. 32) and whether the readings are already
    free of it."""

    deflection_um_per_bar: Annotated[Number, Field(ge=0.0, le=1e3)] = 2.33  #: nominal
    compensated: bool = True  #: whether the readings are free of it


@refusing("ball")
@dataclass(frozen=True, config=_STRICT)
class Ball(Shown):
    """What a certificate, or a grade (ISO 3290), says of a ball's form: deviation from sphericity,
    peak to valley; harmonics a cos n(θ − phase) in the ball's own angle, as (n, a [µm], phase
    [deg]), with the expanded uncertainty (k = 2) of each coefficient.
    """

    sphericity_um: Certified | None = None  #: deviation from sphericity, peak to valley
    grade: str | None = None  #: of ISO 3290: G3 to G200, in its place
    harmonics_um: tuple[Harmonic, ...] = ()  #: (order, amplitude [µm], phase [deg])
    U_um: Certified | None = None  #: of their coefficients
    certificate: Label | None = None  #: which one says so: a name, no number depends on it

    def __post_init__(self) -> None:
        check_known("grade of a ball", [] if self.grade is None else [self.grade], _GRADES_UM)
        one = self.grade is None or self.sphericity_um is None
        require(
            one,
            "a ball must have sphericity_um or grade, got both. Keep what its certificate says.",
        )
        orders = [order for order, *_ in self.harmonics_um]
        require(
            len(set(orders)) == len(orders),
            f"harmonics_um must give each order once, got {orders}. Remove one.",
        )
        got = (
            "harmonics_um and U_um of a ball must come together, got"
            f" {'U_um' if self.U_um else 'harmonics_um'} alone"
        )
        require(
            bool(orders) == (self.U_um is not None),
            f"{got}. Give both: U_um is their expanded uncertainty (k = 2).",
        )

    @property
    def stated_sphericity_um(self) -> float | None:
        """Deviation from sphericity as certificate or grade says [µm], None where neither does."""
        return self.sphericity_um if self.grade is None else _GRADES_UM[self.grade]


@refusing("instrument")
@dataclass(frozen=True, config=_STRICT)
class Instrument(Shown):
    """What certificates say of balls, bar, mount, force and angle; U: expanded uncertainties (k =
    2). None: the model's."""

    work: Ball = field(default_factory=Ball)  #: ball
    tool: Ball = field(default_factory=Ball)  #: ball
    bar_length_error_um: Number = 0.0  #: by which readings are too large
    bar_U_um: Certified | None = None  #: of the bar's length
    mount_U_percent: Percent | None = None  #: of its deflection
    force_U_percent: Percent | None = None  #: of the force's gain
    #: largest deviation from the line, of the largest force
    force_linearity_percent: Percent | None = None
    force_random_N: Certified | None = None  #: random error of every force, one sd
    angle_U_deg: CertifiedAngle | None = None  #: of reference and lag
    #: which certificate says so: names, no number depends on them
    bar_certificate: Label | None = None
    force_certificate: Label | None = None  #: likewise

    def __post_init__(self) -> None:
        alone = (
            "the bar's length error must come with its U_um, got it alone. Give the U of its"
            " certificate (k = 2)."
        )
        require(self.bar_U_um or not self.bar_length_error_um, alone)

    @property
    def certificates(self) -> dict[str, str]:
        """Names of the certificates, by what they are of."""
        named = {"bar": self.bar_certificate, "force device": self.force_certificate}
        named |= {"work ball": self.work.certificate, "tool ball": self.tool.certificate}
        return {what: name for what, name in named.items() if name}


@dataclass(frozen=True, eq=False, kw_only=True)
class TestFields(Shown):
    """What a program, campaign.toml or a layout says of a test beside its readings; None: not
    stated."""

    __test__ = False

    name: Annotated[str, AfterValidator(_file_name)] | None = None  #: one that a file may have
    force_N: Force | None = None  #: radial, above zero
    pressure_bar: Pressure | None = None  #: of the regulator
    direction: Direction | None = None  #: of travel: CW or CCW
    work_ball_deg: Number | None = None  #: how far the ball is turned in its socket
    tool_ball_deg: Number | None = None  #: likewise
    radius_mm: Length | None = None  #: default: the campaign's
    plane: str | None = None  #: XY, YZ or ZX; default: the campaign's
    centre_x_mm: Coordinate | None = None  #: of the work ball, in machine coordinates
    centre_y_mm: Coordinate | None = None  #: likewise
    centre_z_mm: Coordinate | None = None  #: likewise
    #: Tests of one set-up share the tool ball's offsets.
    setup: Annotated[int, BeforeValidator(_no_text), Field(ge=1, le=LARGEST_SETUP)] | None = None
    temperature_C: Number | None = None  #: during the test
    time_s: Number | None = None  #: of the start, on any common clock


# Fields of a campaign that only name things: no number depends on them.
LABELS = (
    *("machine_id", "date", "machine_type", "serial_number", "operator", "place"),
    *("ball_bar", "ball_bar_calibrated", "force_device"),
)
# Fields of a test that a table may hold in columns, by these very names, beside its load and
# direction.
PER_TEST = tuple(
    own.name
    for own in fields(TestFields)
    if own.name not in ("name", "force_N", "pressure_bar", "direction")
)
_CENTRE = ("centre_x_mm", "centre_y_mm", "centre_z_mm")


@refusing("test")
@dataclass(frozen=True, eq=False)
class CircularTest(TestFields):
    """One circle at one force. Without readings it is a planned test. Force or pressure must be
    given (the campaign's force law supplies the other), angles in one of two units, readings in at
    most one. Angles may go any number of turns.

    InputError for missing, non-finite, too few or unequal numbers of angles and readings, or a
    force that is not positive.
    """

    force_N: Force | None = None  #: radial, above zero
    #: θ of the bar's sensitive direction from the plane's first axis, shape (n,)
    angle_deg: Any = None
    reading_um: Any = None  #: ρ: actual ball distance − R, shape (n,)
    #: f036 for 36 N, repeats numbered
    name: Annotated[str, AfterValidator(_file_name)] = field(default="", kw_only=True)
    #: how far the ball is turned in its socket
    work_ball_deg: Number = field(default=0.0, kw_only=True)
    #: how far the ball is turned in its socket
    tool_ball_deg: Number = field(default=0.0, kw_only=True)
    angle_rad: Any = field(default=None, kw_only=True)  #: instead of ``angle_deg``; None afterwards
    #: instead of ``reading_um``; None afterwards
    reading_mm: Any = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        angle = self._column("angle_deg", "angle_rad", np.rad2deg)
        reading = self._column("reading_um", "reading_mm", lambda mm: mm * 1e3)
        for fault in self._faults(angle, reading):
            raise InputError(f"{self.label} must {fault}")
        self.__dict__.update(angle_deg=angle, reading_um=reading, angle_rad=None, reading_mm=None)

    def _column(self, plain: str, other: str, convert: Callable[[Array], Array]) -> Array | None:
        """The column as one of two units gives it, in the first."""
        given = {
            name: value for name in (plain, other) if (value := getattr(self, name)) is not None
        }
        require(
            len(given) <= 1,
            f"{self.label} must have {plain} or {other}, got both. Keep one of them.",
        )
        for name, value in given.items():
            array = np.array(value, dtype=float)
            got = f"{name} of shape (n,), got shape {array.shape}"
            require(array.ndim == 1, f"{self.label} must have {got}. Pass one value per reading.")
            for k in np.flatnonzero(~np.isfinite(array)):
                got = f"{array[k]} at reading {k + 1}"
                raise InputError(
                    f"{self.label} must have finite {name}, got {got}. Remove or correct that"
                    " reading."
                )
            array = array if name == plain else convert(array)
            array.setflags(write=False)
            return array
        return None

    def _faults(self, angle: Array | None, reading: Array | None) -> Iterator[str]:
        if angle is None:
            yield "have angles, got none. Give angle_deg (or angle_rad)."
            return
        if len(angle) < MINIMUM_READINGS:
            yield (
                f"have at least {MINIMUM_READINGS} readings, got {len(angle)}. Leave the test out"
                " or record more."
            )
        if reading is not None and len(reading) != len(angle):
            yield (
                f"have one reading per angle, got {len(angle)} angles and {len(reading)} readings."
                " Check the two columns."
            )
        if self.force_N is None and self.pressure_bar is None:
            yield "have a force or a pressure, got neither. Give force_N or pressure_bar."
        if (arc_deg := _arc_of(angle.tobytes())) < MINIMUM_ARC_DEG:
            cure = "Check the unit of the angle (degrees or radians) or leave the test out"
            yield f"cover an arc of at least {MINIMUM_ARC_DEG:g}°, got {arc_deg:.3g}°. {cure}."
        if reading is not None and (largest := np.abs(reading).max() * 1e-3) > LARGEST_READING_MM:
            yield (
                f"have readings below {LARGEST_READING_MM:g} mm, got {largest:.4g} mm. Check the"
                " unit of the readings."
            )

    @property
    def label(self) -> str:
        """How messages call it."""
        return f"test {self.name!r}" if self.name else "a circular test"

    def angles_rad(self) -> Array:
        """θ in radians, shape (n,)."""
        return np.deg2rad(self.angle_deg)

    def readings_mm(self) -> Array:
        """ρ in millimetres, shape (n,); `InputError` for a planned test."""
        got = "got a planned test. Use a campaign, or simulate the plan"
        require(self.reading_um is not None, f"{self.label} must have readings here, {got}.")
        return np.asarray(self.reading_um) * 1e-3

    def with_reading_um(self, reading_um: ArrayLike | None) -> CircularTest:
        """The same test with other readings [µm]."""
        return replace(self, reading_um=reading_um)

    def select(self, keep: NDArray[np.bool_]) -> CircularTest:
        """The same test with only the readings where ``keep`` is true."""
        reading = None if self.reading_um is None else self.reading_um[keep]
        return replace(self, angle_deg=self.angle_deg[keep], reading_um=reading)

    @property
    def step_deg(self) -> float:
        """Step of angles that a plan can state, in equal steps within one turn [deg]; zero of
        others."""
        steps = np.diff(self.angle_deg)
        even = np.allclose(steps, steps[0], rtol=1e-6) and abs(steps.sum()) < 360.0 * (1.0 + 1e-6)
        return float(steps[0]) if even else 0.0

    def planned(self) -> CircularTest:
        """The same test without readings; angles in unequal steps become as many in equal ones over
        the same arc."""
        wrapped = np.unique(np.mod(self.angle_deg, 360.0))
        arc = self.arc_deg
        start = (
            0.0
            if arc == 360.0
            else np.roll(wrapped, -1)[np.argmax(np.diff(wrapped, append=wrapped[0] + 360.0))]
        )
        even = start + np.linspace(0.0, arc, len(self.angle_deg), endpoint=arc < 360.0)
        return replace(self, reading_um=None, angle_deg=self.angle_deg if self.step_deg else even)

    @property
    def circle(self) -> Circle:
        """Radius, centre and plane; the campaign's defaults must have been filled in."""
        x, y, z = (float(getattr(self, key) or 0.0) for key in _CENTRE)
        return Circle(float(self.radius_mm or 0.0), (x, y, z), self.plane or "XY")

    @property
    def arc_deg(self) -> float:
        """Covered arc [deg]: 360° minus the largest gap between neighbouring angles, or 360° where
        it is an ordinary step."""
        return _arc_of(self.angle_deg.tobytes())


@lru_cache(maxsize=64)
def _arc_of(angles: bytes) -> float:
    """The tests of a campaign, and the candidates of a design, often have the same angles."""
    wrapped = np.unique(np.mod(np.frombuffer(angles), 360.0))
    if len(wrapped) < 2:
        return 0.0
    gaps = np.diff(np.append(wrapped, wrapped[0] + 360.0))
    largest = float(gaps.max())
    return 360.0 if largest <= 3.0 * float(np.median(gaps)) else 360.0 - largest


def distinct_forces(forces_N: ArrayLike) -> Array:
    """Return the forces that differ, rising: those less than a thousandth of the largest above
    another are the same force [N]."""
    ordered = np.unique(np.asarray(forces_N, dtype=float))
    distinct: list[float] = []
    for force in ordered.tolist():
        if not distinct or force - distinct[-1] > SAME_FORCE * ordered[-1]:
            distinct.append(force)
    return np.array(distinct)


@dataclass(frozen=True, eq=False, kw_only=True)
class CampaignFields(Shown):
    """What a program or campaign.toml says of a campaign beside its tests."""

    topology: str = "wCAFYXZSt"  #: joints from workpiece to tool
    plane: str = "XY"  #: of tests that state none
    radius_mm: Length = 150.0  #: of tests that state none
    name: Label | None = None  #: of the campaign
    #: what tells the machines of a fleet apart; default: the serial number
    machine_id: Label | None = None
    date: Date | None = None  #: ISO 8601 (2026-11-20, 2026-11-20T14:30)
    # For the certificate; no number depends on them.
    machine_type: Label | None = None  #: maker and type
    serial_number: Label | None = None  #: of the machine
    operator: Label | None = None  #: who measured
    place: Label | None = None  #: where
    ball_bar: Label | None = None  #: type and number
    ball_bar_calibrated: Date | None = None  #: ISO 8601
    force_device: Label | None = None  #: what makes or measures the force, and its certificate
    #: By quantity, a limit with its unit: {"C_XXX": "60 nm/N"}; see `conformity`. Of no weight in a fit either.
    tolerances: Mapping[str, str] = field(default_factory=dict)
    feed_mm_per_min: Number | None = None  #: along the circle
    resolution_um: Positive = 0.24  #: of the readout; sets the floor σ ≥ resolution/√12
    mount: MountCompensation = field(default_factory=MountCompensation)  #: of the work ball
    #: used where a test has only one of force and pressure
    force_law: ForceLaw = field(default_factory=ForceLaw)
    #: Where the joints' frames stand, by axis letter; see `Machine`.
    frames_mm: SkipValidation[Mapping[str, tuple[float, float, float]]] = field(
        default_factory=dict
    )


@refusing("campaign")
@dataclass(frozen=True, eq=False)
class Campaign(CampaignFields):
    """The tests of one machine.

    InputError for no tests, repeated names, planes the machine does not have, or tests both with
    and without readings.
    """

    tests: tuple[CircularTest, ...]  #: all with readings, or none
    name: Label = field(default="campaign", kw_only=True)  #: of the campaign
    #: of tests that state none
    centre_mm: tuple[Coordinate, ...] = field(default=(0.0, 0.0, 0.0), kw_only=True)
    #: what certificates say of it
    instrument: Instrument = field(default_factory=Instrument, kw_only=True)
    #: Tests that may follow: what only they can show is modelled already; their readings, if any, are dropped.
    foreseen: tuple[CircularTest, ...] = field(default=(), kw_only=True)

    def __post_init__(self) -> None:
        require(self.tests, "campaign must have at least one test, got none. Add a circular test.")
        foreseen = tuple(
            self._resolved(replace(test.with_reading_um(None), name="")) for test in self.foreseen
        )
        self.__dict__.update(
            tests=_named([self._resolved(test) for test in self.tests]), foreseen=foreseen
        )
        planned = [test.name for test in self.tests if test.reading_um is None]
        got = (
            "campaign must have readings in all tests or in none, got test"
            f" {next(iter(planned), '')!r} without"
        )
        require(len(planned) in (0, len(self.tests)), f"{got}. Add its file or plan it apart.")
        self.__dict__.update(
            frames_mm=dict(self.machine().frames_mm),
            machine_id=self.machine_id or self.serial_number,
        )

    def _resolved(self, test: CircularTest) -> CircularTest:
        """The test with everything that it leaves to the campaign."""
        usual: dict[str, Any] = {"radius_mm": self.radius_mm, "plane": self.plane, "setup": 1}
        usual |= dict(zip(_CENTRE, (*self.centre_mm, 0.0)[:3], strict=True))
        usual = {
            key: value if (own := getattr(test, key)) is None else own
            for key, value in usual.items()
        }
        force = test.force_N
        pressure = test.pressure_bar
        if force is None:
            force = self.force_law.force_N(float(pressure or 0.0))
            got = f"{force:.4g} N from {pressure} bar"
            require(
                force > 0,
                f"{test.label} must have a force > 0, got {got}. Check pressure_bar and [force].",
            )
        usual |= {
            "force_N": force,
            "pressure_bar": self.force_law.pressure_bar(force) if pressure is None else pressure,
        }
        return replace(test, **usual)

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
        """Number of distinct forces; nearer than a thousandth of the largest is the same."""
        return len(distinct_forces(self.forces_N))

    @property
    def pressures_bar(self) -> Array:
        """Pressure of each test, shape (tests,) [bar]."""
        return np.array([test.pressure_bar for test in self.tests], dtype=float)

    @property
    def readings(self) -> int:
        """Number of angles in all tests."""
        return sum(len(test.angle_deg) for test in self.tests)

    def without(self, *names: str) -> Campaign:
        """The campaign without the named tests; `InputError` for a name that it does not have."""
        check_known("test", names, [test.name for test in self.tests])
        return replace(self, tests=tuple(test for test in self.tests if test.name not in names))

    def select(self, names: Sequence[str]) -> Campaign:
        """The campaign with only the named tests."""
        check_known("test", names, [test.name for test in self.tests])
        return self.without(*(test.name for test in self.tests if test.name not in names))

    def plan(self) -> Campaign:
        """The same campaign without readings."""
        return replace(self, tests=tuple(test.with_reading_um(None) for test in self.tests))

    def __repr__(self) -> str:
        size = (
            f": {len(self.tests)} tests, {self.forces_N.min():.4g} to {self.forces_N.max():.4g} N,"
            f" {self.readings} readings>"
        )
        return f"<{'Plan' if self.is_plan else 'Campaign'} {self.name}"[: 80 - len(size)] + size

    @cached_property
    def sha256(self) -> str:
        """SHA-256 of the readings and how they were taken, whatever the files' layout; certificates
        are beliefs: no part."""
        digest = hashlib.sha256()
        head: list[Any] = [
            self.topology,
            self.resolution_um,
            self.mount.deflection_um_per_bar,
            self.mount.compensated,
        ]
        head += [[axis, *frame] for axis, frame in sorted(self.frames_mm.items()) if any(frame)]
        digest.update(json.dumps(head).encode())
        for test in self.tests:
            digest.update(json.dumps(_digested(test)).encode())
            for column in (test.angle_deg, test.reading_um):
                digest.update(
                    b"" if column is None else np.ascontiguousarray(column, dtype="<f8").tobytes()
                )
        if self.is_plan:
            digest.update(b"plan")
        for test in self.foreseen:
            digest.update(json.dumps(["foreseen", *_digested(test)]).encode())
        return digest.hexdigest()


Plan = Campaign


def check_campaign(campaign: object) -> None:
    """Answer a path, or anything else that is no campaign, with the right call; None passes."""
    cure = "Read one with lb.read_campaign(path), or make it from arrays"
    holds = campaign is None or isinstance(campaign, Campaign)
    require(holds, f"campaign must be a Campaign, got {type(campaign).__name__}. {cure}.")


def _digested(test: CircularTest) -> list[Any]:
    """What the model uses of a test beside its readings, numbers as floats."""
    always = (
        "force_N",
        "pressure_bar",
        "direction",
        "work_ball_deg",
        "tool_ball_deg",
        "radius_mm",
        "plane",
        *_CENTRE[:2],
    )
    unless = {"centre_z_mm": 0.0, "setup": 1.0, "temperature_C": None, "time_s": None}
    values = {key: getattr(test, key) for key in (*always, *unless)} | {
        "setup": float(test.setup or 1)
    }
    extra = [[key, values[key]] for key, usual in unless.items() if values[key] != usual]
    return [test.name, *(values[key] for key in always), *extra]


def _named(tests: Sequence[CircularTest]) -> tuple[CircularTest, ...]:
    """Give unnamed tests names after their force, numbering repeats; refuse repeated given
    names."""
    given = [test.name for test in tests if test.name]
    repeated = next((name for name in given if given.count(name) > 1), None)
    require(
        repeated is None,
        f"test names must differ, got {repeated!r} twice. Give each test its own name.",
    )
    named = []
    used = set(given)
    for test in tests:
        stem = test.name or f"f{test.force_N:03.0f}"
        free = (name for k in count(1) if (name := stem if k == 1 else f"{stem}_{k}") not in used)
        named.append(test if test.name else replace(test, name=next(free)))
        used.add(named[-1].name)
    return tuple(named)
