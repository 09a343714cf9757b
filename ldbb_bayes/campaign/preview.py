"""Preview of a campaign before a fit: its tests, what looks odd, and what a fit will assume."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from ldbb_bayes.campaign.campaign import Campaign, CircularTest, require_campaign
from ldbb_bayes.campaign.circular_test import setup_number, usual_gap
from ldbb_bayes.campaign.run_times import SECONDS_PER_TEST, time_source
from ldbb_bayes.campaign.spikes import SERIES_ORDER, fit_regular_readings, regular_readings
from ldbb_bayes.results import Array, Result
from ldbb_bayes.units import ranked

__all__ = [
    "CampaignPreview",
    "Remark",
    "RemarkKind",
    "TestPreview",
    "check_campaign",
    "preview_of_model",
    "resolution_of",
]

# Smallest arc [deg] that counts as a full circle in the preview. A remark is made on a test whose
# angles cover a smaller arc.
_FULL_DEG = 359.0
# A remark on a test whose angles do not cover the full circle states the covered arc if the arc is
# at most this limit [deg], and otherwise the largest gap between angles. The limit is a full circle
# minus one period of the highest order of the fitted Fourier series.
_LARGEST_ARC_DEG = 360.0 - 360.0 / SERIES_ORDER
# A gap between neighbouring angles of a test is reported if it is wider than this multiple of the
# usual step from one angle to the next.
_GAP_STEPS = 10.0
# The preview compares the force given for a test with the force that follows from the test's
# pressure by the campaign's force law. It reports a difference larger than this fraction of the
# force at the campaign's largest pressure.
_FORCE_LAW_SHARE = 0.02
# Usual range of a campaign's largest force [N]. If the force is outside this range, the unit of the
# forces is probably wrong.
_FORCES_N = (5.0, 10_000.0)
# Usual range of a circle's radius [mm]. If the radius is outside this range, its unit is probably
# wrong.
_RADII_MM = (10.0, 2000.0)
# If the peak-to-peak value of a test's readings is smaller than this multiple of the resolution of
# the readout, the unit of the readings is probably wrong.
_SMALLEST_SPAN_RESOLUTIONS = 3.0
# If the peak-to-peak value of a test's readings is larger than this number [µm], the unit of the
# readings is probably wrong.
_LARGEST_SPAN_UM = 1000.0
# The preview fits a Fourier series only to tests whose number of readings is in this range.
_FITTED_READINGS = range(2 * SERIES_ORDER + 11, 200_001)
# For a test that goes once round the circle, the preview computes the jump between the last and the
# first reading. It reports the circle as not closed if the jump exceeds this multiple of the noise
# level. The noise level is the standard deviation of the noise or the resolution of the readout,
# whichever is larger.
_OPEN_SCATTERS = 10.0
# The preview examines the sign of the readings if at least `_FEWEST_FOR_SIGN` tests were run on the
# same circle. Only tests that cover more than `_WHOLE_TURN_DEG` [deg] are counted. A remark is made
# if the mean reading falls by more than `_SMALLEST_FALL_UM` [µm] from the smallest to the largest
# force, and if its correlation with the force is below `_FALLING`.
_FEWEST_FOR_SIGN = 3
_WHOLE_TURN_DEG = 340.0
_SMALLEST_FALL_UM = 2.0
_FALLING = -0.95
# One test seems to have the other sign if its mean reading lies opposite to what the other tests of
# its circle let one expect, by this fraction of the expected value or less. The expected value must
# be at least `_LEAST_MIRRORED_UM` [µm]: below it, a zero that was set anew could do the same.
_MIRRORED_WITHIN = 0.25
_LEAST_MIRRORED_UM = 5.0
# Smallest resolution [µm] that is accepted if more than nine tenths of the readings are distinct. A
# smaller step only shows the number of digits with which the readings were written.
_FINEST_STEP_UM = 0.005
# If more than nine tenths of the readings are distinct, a resolution is determined only if the
# number of distinct readings is at least this large.
_MIN_VALUES = 50


class RemarkKind(StrEnum):
    """Kinds of remarks in the preview of a campaign.

    A remark concerns one test, the campaign as a whole, or an assumption of a fit.
    """

    TRAVEL = "travel"
    ARC = "arc"
    GAP = "gap"
    OPEN = "open trace"
    UNIT = "unit"
    FORCE_LAW = "force law"
    SPIKES = "spikes"
    STEP = "step"
    ONE_LEVEL = "one force level"
    TWO_LEVELS = "two force levels"
    COPY = "copy"
    NOT_RUN = "not run"
    MODEL_FILE = "model file"
    SIGN = "sign"
    MIRRORED = "sign of one test"
    ONE_WAY = "one way"
    PLACES = "places of one set-up"
    ONE_BAR = "one bar certificate"
    ONE_TRACE = "one trace of a ball"
    MACHINE = "machine"
    FRAMES = "frames"
    CENTRES = "centres"
    SETUPS = "set-ups"
    BOTH_WAYS = "both ways"
    DRIFT = "drift"
    TEMPERATURES = "temperatures"
    READINGS = "readings"
    MOUNT = "mount"
    FORCES = "forces"
    REFERENCE = "reference force"
    BALLS = "balls"
    NOT_MODELLED = "not modelled"


# Remarks on what a fit will assume that hold only if the model has a certain term. The values are
# the names of the classes of the terms.
_TERM_OF_REMARK = {
    RemarkKind.BOTH_WAYS: "Hysteresis",
    RemarkKind.DRIFT: "Drift",
    RemarkKind.TEMPERATURES: "Drift",
    RemarkKind.BALLS: "BallForm",
}


@dataclass(frozen=True)
class Remark:
    """Remark on a test or campaign in a preview.

    ``kind`` is the kind of the remark. ``values`` holds the numbers and names that are inserted
    into the sentence of the remark; the keys are the names of the placeholders in the sentence.
    """

    kind: RemarkKind
    values: dict[str, Any]


class _Remarks:
    """Remarks on what looks odd in a campaign, collected while the campaign is examined."""

    def __init__(self) -> None:
        """Create an empty list, to which remarks on a campaign can be added."""
        self._remarks: list[Remark] = []

    def add(self, kind: RemarkKind, condition: object = True, **values: Any) -> None:
        """Add a remark on a campaign or test to the preview if ``condition`` is true.

        ``kind`` is the kind of the remark, and ``values`` are the numbers and names that the
        sentence of the remark will contain.
        """
        if condition:
            self._remarks.append(Remark(kind, values))

    def as_tuple(self) -> tuple[Remark, ...]:
        """Return all remarks on the campaign and its tests that have been collected so far."""
        return tuple(self._remarks)


@dataclass(frozen=True)
class TestPreview:
    """Summary of one circular test in the preview of a campaign.

    A field is None if it cannot be determined from the test.
    """

    __test__ = False

    name: str
    force_N: float
    pressure_bar: float
    readings: int
    #: arc of the circle that the angles of the test cover [deg]
    arc_deg: float
    #: largest gap between neighbouring angles of the test on the circle [deg]
    largest_gap_deg: float
    #: direction of travel given for the test: clockwise (CW) or counterclockwise (CCW)
    direction: str | None
    #: direction of travel that the order of the test's angles shows: clockwise (CW) or
    #: counterclockwise (CCW)
    travel: str | None
    plane: str
    setup: int
    radius_mm: float
    centre_mm: tuple[float, ...]
    work_ball_deg: float
    tool_ball_deg: float
    #: resolution of the readings [µm]: the digital step. All differences between readings are
    #: multiples of this step.
    resolution_um: float | None
    #: number of spikes, which are readings that deviate from a fitted Fourier series of order 12 by
    #: more than eight standard deviations. The series is fitted without the spikes.
    spikes: int
    #: standard deviation of the readings about a fitted Fourier series of order 12, without spikes
    #: [µm]; computed only for tests of 35 to 200 000 readings
    noise_um: float | None
    #: last reading of a test minus its first reading [µm]; computed only if the test goes once
    #: round the circle
    start_end_um: float | None
    peak_to_peak_um: float | None
    remarks: tuple[Remark, ...]


@dataclass(frozen=True)
class CampaignPreview(Result):
    """Summary of a campaign before a fit.

    It holds a summary of each test, remarks on what looks odd, and the assumptions that a fit would
    make.
    """

    name: str
    sha256: str
    topology: str
    plane: str
    is_plan: bool
    tests: tuple[TestPreview, ...]
    assumptions: tuple[Remark, ...]
    remarks: tuple[Remark, ...]


def check_campaign(campaign: Campaign) -> CampaignPreview:
    """Return a preview of a campaign or plan without fitting the model.

    The printed preview shows a table of the tests, remarks on what looks odd, and the assumptions
    that a fit would make.

    Parameters
    ----------
    campaign : Campaign
        A campaign or plan.

    Returns
    -------
    CampaignPreview
        Summaries of the ``tests`` with the scatter, resolution and spikes of their readings,
        ``remarks`` on what looks odd, and the ``assumptions`` that a fit would make.

    Examples
    --------
    >>> preview = lb.check_campaign(campaign)
    >>> [str(remark.kind) for remark in preview.remarks]
    ['one way']
    >>> test = preview.tests[0]
    >>> test.name, test.travel, round(test.noise_um, 2), test.spikes
    ('f036', 'CW', 0.12, 0)
    """
    require_campaign(campaign)
    return CampaignPreview(
        name=campaign.name,
        sha256=campaign.sha256,
        topology=campaign.topology,
        plane=campaign.machine().plane,
        is_plan=campaign.is_plan,
        tests=tuple(_preview_test(test, campaign) for test in campaign.tests),
        assumptions=_assumption_remarks(campaign),
        remarks=_campaign_remarks(campaign),
    )


def preview_of_model(preview: CampaignPreview, terms: Collection[str]) -> CampaignPreview:
    """Return a preview without assumptions about terms that a model does not have.

    Parameters
    ----------
    preview
        Preview of a campaign, with the assumptions of the default model.
    terms
        Names of the terms of the model, such as Hysteresis.
    """
    assumptions = []
    for remark in preview.assumptions:
        term = _TERM_OF_REMARK.get(remark.kind)
        if term is None or term in terms:
            assumptions.append(remark)
    return replace(preview, assumptions=tuple(assumptions))


class _Angles(NamedTuple):
    """How far apart the angles of a test's readings are, and in which direction they run."""

    #: median absolute difference of the angle from one reading to the next [deg]
    step_deg: float
    #: largest gap between neighbouring angles of the test on the circle [deg]
    largest_gap_deg: float
    #: usual gap between neighbouring angles on the circle [deg] (see `usual_gap`) or ``step_deg``,
    #: whichever is larger
    usual_step_deg: float
    #: direction in which the angles run from reading to reading: clockwise (CW), counterclockwise
    #: (CCW), or None if the direction changes
    travel: str | None


def _describe_angles(test: CircularTest) -> _Angles:
    """Return the steps and gaps of a test's angles [deg], and the direction in which they run.

    Steps are differences of the angle from one reading to the next; gaps lie between neighbouring
    angles on the circle. The direction is None unless the angles rise throughout or fall
    throughout.
    """
    angle = np.asarray(test.angle_deg)
    around = np.sort(np.mod(angle, 360.0))
    gaps = np.diff(np.append(around, around[0] + 360.0))
    steps = np.diff(angle)
    step_deg = float(np.median(np.abs(steps)))
    travel = None
    if np.all(steps > 0):
        travel = "CCW"
    elif np.all(steps < 0):
        travel = "CW"
    usual_step_deg = max(usual_gap(gaps), step_deg)
    return _Angles(step_deg, float(gaps.max()), usual_step_deg, travel)


class _Readings(NamedTuple):
    """Quantities computed from the readings of a test, with the same names as in `TestPreview`.

    The default values are for a planned test, which has no readings.
    """

    resolution_um: float | None = None
    spikes: int = 0
    noise_um: float | None = None
    start_end_um: float | None = None
    peak_to_peak_um: float | None = None


def _preview_test(test: CircularTest, campaign: Campaign) -> TestPreview:
    """Return the summary of one test of a campaign, including remarks on what looks odd."""
    remarks = _Remarks()
    angles = _describe_angles(test)
    _remark_on_angles(test, campaign, angles, remarks)
    _remark_on_force(test, campaign, remarks)
    readings = _Readings()
    if test.reading_um is not None:
        readings = _preview_readings(test, campaign.resolution_um, angles, remarks)
    return TestPreview(
        name=test.name,
        force_N=float(test.force_N or 0.0),
        pressure_bar=float(test.pressure_bar or 0.0),
        readings=len(test.angle_deg),
        arc_deg=test.arc_deg,
        largest_gap_deg=angles.largest_gap_deg,
        direction=test.direction,
        travel=angles.travel,
        plane=test.circle.plane,
        setup=setup_number(test),
        radius_mm=test.circle.radius_mm,
        centre_mm=tuple(test.circle.centre_mm),
        work_ball_deg=test.work_ball_deg,
        tool_ball_deg=test.tool_ball_deg,
        resolution_um=readings.resolution_um,
        spikes=readings.spikes,
        noise_um=readings.noise_um,
        start_end_um=readings.start_end_um,
        peak_to_peak_um=readings.peak_to_peak_um,
        remarks=remarks.as_tuple(),
    )


def _remark_on_angles(
    test: CircularTest, campaign: Campaign, angles: _Angles, remarks: _Remarks
) -> None:
    """Add remarks on the angles of ``test`` to ``remarks``.

    A remark is made if the order of the angles contradicts the direction of travel given for the
    test, if the angles do not cover the full circle, or if there is a wide gap between neighbouring
    angles. ``campaign`` is the campaign of the test. ``angles`` holds the steps and gaps of the
    angles, and the direction in which they run.
    """
    contradicts = test.direction and angles.travel and test.direction != angles.travel
    if contradicts and not campaign.is_plan and not _order_shows_no_travel(campaign):
        remarks.add(RemarkKind.TRAVEL, stated=test.direction, travel=angles.travel)
    is_wide_gap = angles.largest_gap_deg > _GAP_STEPS * angles.usual_step_deg
    if test.arc_deg <= _LARGEST_ARC_DEG:
        remarks.add(RemarkKind.ARC, arc_deg=test.arc_deg)
    elif test.arc_deg < _FULL_DEG or is_wide_gap:
        remarks.add(RemarkKind.GAP, gap_deg=angles.largest_gap_deg)


def _order_shows_no_travel(campaign: Campaign) -> bool:
    """Return whether the angles increase in all tests, although some tests run CW and others CCW.

    The tables of readings were then probably sorted by angle, and the order of the readings does
    not show the direction of travel.
    """
    directions = {test.direction for test in campaign.tests}
    all_rise = all(np.all(np.diff(test.angle_deg) > 0) for test in campaign.tests)
    return all_rise and {"CW", "CCW"} <= directions


def _remark_on_force(test: CircularTest, campaign: Campaign, remarks: _Remarks) -> None:
    """Add a remark if the force given for a test does not agree with its pressure.

    The given force is compared with the force that follows from the pressure by the campaign's
    force law. The remark is added to ``remarks``.
    """
    force_N = float(test.force_N or 0.0)
    pressure_bar = float(test.pressure_bar or 0.0)
    law_N = campaign.force_law.force_N(pressure_bar)
    largest_N = campaign.force_law.force_N(float(campaign.pressures_bar.max()))
    remarks.add(
        RemarkKind.FORCE_LAW,
        abs(law_N - force_N) > _FORCE_LAW_SHARE * largest_N,
        force_N=force_N,
        law_N=law_N,
        pressure_bar=pressure_bar,
    )


def _preview_readings(
    test: CircularTest, stated_um: float, angles: _Angles, remarks: _Remarks
) -> _Readings:
    """Return quantities computed from the readings of ``test``, such as noise and resolution.

    Remarks on the readings, for example on a unit that is probably wrong, are added to ``remarks``.
    ``stated_um`` is the resolution given for the campaign [µm]. ``angles`` holds the steps and gaps
    of the test's angles, and the direction in which they run.
    """
    reading = test.reading_um
    span = float(np.ptp(reading))
    resolution_um = resolution_of(reading)
    turn_deg = abs(test.angle_deg[-1] - test.angle_deg[0])
    closes = angles.travel is not None and abs(turn_deg - 360.0) <= 2.0 * angles.step_deg
    start_end_um = None
    if closes:
        start_end_um = float(reading[-1] - reading[0])
    noise_um = None
    spikes = 0
    if len(reading) in _FITTED_READINGS:
        noise_um, spikes = _noise_and_spikes(test, stated_um, closes, remarks)
    is_usual = _SMALLEST_SPAN_RESOLUTIONS * stated_um <= span <= _LARGEST_SPAN_UM
    remarks.add(
        RemarkKind.UNIT,
        not is_usual,
        what="peak to peak",
        value=span,
        unit="µm",
    )
    remarks.add(
        RemarkKind.STEP,
        resolution_um and not 0.5 * stated_um < resolution_um < 1.5 * stated_um,
        step_um=resolution_um,
        stated_um=stated_um,
    )
    return _Readings(resolution_um, spikes, noise_um, start_end_um, span)


def _noise_and_spikes(
    test: CircularTest, resolution_um: float, closes: bool, remarks: _Remarks
) -> tuple[float, int]:
    """Return the scatter of a test's readings about a fitted curve [µm], and the number of spikes.

    The curve is a Fourier series of order 12. Spikes are readings far from the curve. The scatter
    is the standard deviation of all other readings about the curve. If the test goes once round the
    circle (``closes``), the curve with which the spikes are found also includes a drift linear in
    the angle. The jump between the last and the first reading is computed from this curve. Remarks
    on spikes and on a large jump are added to ``remarks``. ``resolution_um`` is the resolution of
    the readout [µm].
    """
    phases = np.exp(1j * np.outer(test.angles_rad(), np.arange(SERIES_ORDER + 1)))
    reading = np.asarray(test.reading_um)
    fourier_columns = np.hstack([phases.real, phases.imag[:, 1:]])
    turn = test.angle_deg / 360.0
    columns = fourier_columns
    if closes:
        columns = np.column_stack([fourier_columns, turn])
    regular = regular_readings(columns, reading)
    fit = fit_regular_readings(columns, reading, regular)
    deviation = fit.deviation
    if closes:
        drift = (turn[-1] - turn[0]) * fit.coefficients[-1]
        jump = float(deviation[-1] - deviation[0] + drift)
        is_open = abs(jump) > _OPEN_SCATTERS * max(fit.scatter, resolution_um)
        remarks.add(RemarkKind.OPEN, is_open, start_end_um=jump)

    def size_of_spike(position: int) -> float:
        """Return the distance [µm] between one reading of a test and the curve fitted to the test.

        ``position`` is the index of the reading.
        """
        return abs(float(deviation[position]))

    spikes = ranked(np.flatnonzero(~regular).tolist(), size_of_spike)
    if spikes:
        largest = spikes[0]
        remarks.add(
            RemarkKind.SPIKES,
            reading=largest + 1,
            angle_deg=float(test.angle_deg[largest]),
            off_um=float(deviation[largest]),
            count=len(spikes),
        )
    return fit_regular_readings(fourier_columns, reading, regular).scatter, len(spikes)


def resolution_of(reading_um: Array) -> float | None:
    """Return the resolution of readings [µm], or None if the readings do not show a resolution.

    The distinct readings are sorted, and the differences between neighbours are taken. The
    resolution is the median of those differences that are below 1.5 times the smallest difference.
    The result is None in four cases:

    - There are fewer than three distinct readings.
    - A difference is not a multiple of the resolution to within 5 % of the resolution.
    - More than nine tenths of the readings are distinct, and the resolution is below 0.005 µm. The
      differences then only show how many digits were written.
    - More than nine tenths of the readings are distinct, and there are fewer than 50 distinct
      readings.

    Parameters
    ----------
    reading_um
        The n readings of a test, shape (n,) [µm].

    Returns
    -------
    float or None
        Resolution of the readings [µm].
    """
    values = np.unique(np.round(reading_um, 6))
    if len(values) < 3:
        return None
    differences = np.diff(values)
    step = float(np.median(differences[differences < 1.5 * differences.min()]))
    few_repeat = len(values) > 0.9 * len(reading_um)
    if few_repeat and (step < _FINEST_STEP_UM or len(values) < _MIN_VALUES):
        return None
    multiples = differences / step
    remainder = np.abs(multiples - np.rint(multiples))
    if float(remainder.max()) >= 0.05:
        return None
    return step


def _assumption_remarks(campaign: Campaign) -> tuple[Remark, ...]:
    """Return remarks on what a fit of the campaign will assume, such as its reference force."""
    kinds = RemarkKind
    tests = campaign.tests
    machine = campaign.machine()
    law = campaign.force_law
    forces = campaign.forces_N
    setups = sorted({setup_number(test) for test in tests})
    both_ways = [plane for plane in machine.planes if _runs_both_ways(campaign, plane)]
    clockings = {(test.work_ball_deg % 360.0, test.tool_ball_deg % 360.0) for test in tests}
    temperatures = {test.temperature_C for test in tests}
    remarks = _Remarks()
    remarks.add(
        kinds.MACHINE, topology=campaign.topology, plane=machine.plane, radii_mm=_radii(campaign)
    )
    remarks.add(kinds.FRAMES, campaign.frames_mm, frames_mm=dict(campaign.frames_mm))
    centres = {tuple(test.circle.centre_mm) for test in tests}
    remarks.add(kinds.CENTRES, len(centres) > 1, mean_mm=campaign.mean_centre_mm)
    remarks.add(kinds.SETUPS, len(setups) > 1, setups=setups)
    remarks.add(kinds.BOTH_WAYS, both_ways, planes=both_ways)
    _remark_on_drift(campaign, remarks)
    remarks.add(
        kinds.TEMPERATURES, campaign.drift and None not in temperatures and len(temperatures) > 1
    )
    remarks.add(kinds.READINGS, resolution_um=campaign.resolution_um)
    remarks.add(kinds.MOUNT, **asdict(campaign.mount))
    remarks.add(kinds.FORCES, slope_N_per_bar=law.slope_N_per_bar, offset_N=law.offset_N)
    remarks.add(kinds.REFERENCE, force_N=float(forces.min() + forces.max()) / 2)
    remarks.add(kinds.BALLS, clocked=len(clockings) > 1)
    return remarks.as_tuple()


def _remark_on_drift(campaign: Campaign, remarks: _Remarks) -> None:
    """Add a remark that says where the times of the tests come from.

    A fit uses these times to compute the drift of the bar's length and of the circle's centre.
    """
    number = len(campaign.tests)
    times_s = [test.time_s for test in campaign.tests if test.time_s is not None]
    span_min = None
    if len(times_s) == number:
        span_min = (max(times_s) - min(times_s)) / 60.0
    remarks.add(
        RemarkKind.DRIFT,
        number > 1,
        source=str(time_source(campaign)),
        tests=number,
        stated=len(times_s),
        span_min=span_min,
        pace_min=SECONDS_PER_TEST / 60.0,
    )


def _radii(campaign: Campaign) -> list[float]:
    """Return the different nominal radii of a campaign's circles [mm], in ascending order."""
    return sorted({test.circle.radius_mm for test in campaign.tests})


def _runs_both_ways(campaign: Campaign, plane: str) -> bool:
    """Return whether both clockwise and counterclockwise tests were run in a plane."""
    return {"CW", "CCW"} <= {test.direction for test in campaign.tests if test.plane == plane}


def _campaign_remarks(campaign: Campaign) -> tuple[Remark, ...]:
    """Return remarks on odd properties of the campaign as a whole, such as equal forces."""
    kinds = RemarkKind
    remarks = _Remarks()
    remarks.add(kinds.ONE_LEVEL, campaign.force_levels == 1)
    remarks.add(kinds.TWO_LEVELS, campaign.force_levels == 2)
    largest_force = float(campaign.forces_N.max())
    _remark_on_unit("the largest force", largest_force, "N", _FORCES_N, remarks)
    for radius in _radii(campaign):
        _remark_on_unit("a radius", radius, "mm", _RADII_MM, remarks)
    if not campaign.is_plan:
        remarks.add(
            kinds.NOT_RUN,
            campaign.foreseen,
            forces_N=[float(test.force_N or 0.0) for test in campaign.foreseen],
            run=len(campaign.tests),
        )
        for first, second in combinations(campaign.tests, 2):
            is_copy = np.array_equal(first.reading_um, second.reading_um)
            remarks.add(kinds.COPY, is_copy, first=first.name, second=second.name)
        _remark_on_sign(campaign, remarks)
        _remark_on_mirrored_tests(campaign, remarks)
    planes = campaign.machine().planes
    for plane in planes:
        first_axis, second_axis = sorted(plane)
        remarks.add(
            kinds.ONE_WAY,
            not _runs_both_ways(campaign, plane),
            compliance=f"C_{first_axis}{second_axis}{first_axis}",
            plane=plane if len(planes) > 1 else "",
        )
    circles = {(test.setup, test.plane, test.circle.centre_mm) for test in campaign.tests}
    circles_by_setup = Counter(setup or 1 for setup, _, _ in circles)
    for setup, number in sorted(circles_by_setup.items()):
        remarks.add(kinds.PLACES, number > 1, setup=setup)
    _remark_on_certificates(campaign, remarks)
    return remarks.as_tuple()


def _remark_on_certificates(campaign: Campaign, remarks: _Remarks) -> None:
    """Add remarks on certificates that the model uses beyond what they usually certify.

    The bar has another length at each radius, but the campaign states one certificate. A ball
    touches along another great circle in each plane, but its harmonics are those of one trace.
    """
    instrument = campaign.instrument
    is_bar_stated = instrument.bar_U_um is not None
    radii = [f"{radius:g}" for radius in _radii(campaign)]
    remarks.add(RemarkKind.ONE_BAR, is_bar_stated and len(radii) > 1, radii=" and ".join(radii))
    planes = list(campaign.machine().planes)
    balls = {"work ball": instrument.work, "tool ball": instrument.tool}
    for name, ball in balls.items():
        is_trace_shared = bool(ball.harmonics_um) and len(planes) > 1
        remarks.add(RemarkKind.ONE_TRACE, is_trace_shared, ball=name, planes=" and ".join(planes))


class _MeanReading(NamedTuple):
    """Mean reading of a test that covers the whole circle."""

    name: str
    force_N: float
    mean_um: float


def _means_of_circles(campaign: Campaign) -> list[list[_MeanReading]]:
    """Return the mean readings of tests, a list for each circle, set-up and direction of travel."""
    means_of_circle: dict[Any, list[_MeanReading]] = {}
    for test, test_force_N in zip(campaign.tests, campaign.forces_N, strict=True):
        circle = (test.circle, test.setup, test.direction)
        if test.reading_um is not None and test.arc_deg > _WHOLE_TURN_DEG:
            mean = _MeanReading(test.name, float(test_force_N), float(np.mean(test.reading_um)))
            means_of_circle.setdefault(circle, []).append(mean)
    return list(means_of_circle.values())


def _remark_on_mirrored_tests(campaign: Campaign, remarks: _Remarks) -> None:
    """Add a remark on each test whose mean reading has the other sign than its neighbours'.

    What to expect of a test is a straight line over force through the mean readings of the other
    tests of its circle, which must lie on that line themselves.
    """
    for means in _means_of_circles(campaign):
        for mean in means:
            others = [other for other in means if other is not mean]
            other_N = np.array([other.force_N for other in others])
            other_um = np.array([other.mean_um for other in others])
            if len(others) < _FEWEST_FOR_SIGN or np.ptp(other_N) == 0.0:
                continue
            line = np.polyfit(other_N, other_um, 1)
            expected_um = float(np.polyval(line, mean.force_N))
            tolerance_um = _MIRRORED_WITHIN * abs(expected_um)
            largest_residual_um = np.max(np.abs(other_um - np.polyval(line, other_N)))
            remarks.add(
                RemarkKind.MIRRORED,
                abs(expected_um) >= _LEAST_MIRRORED_UM
                and abs(mean.mean_um + expected_um) <= tolerance_um
                and largest_residual_um <= tolerance_um,
                test=mean.name,
                mean_um=mean.mean_um,
                expected_um=expected_um,
            )


def _remark_on_sign(campaign: Campaign, remarks: _Remarks) -> None:
    """Add one remark if the mean reading on a circle falls as the force rises.

    Tests are compared with each other if they have the same circle (plane, centre and radius),
    set-up and direction of travel. The bar pushes tool and table apart, so that the mean reading
    must rise with the force. If the mean reading falls, the sign of the readings is probably wrong.
    The remark states the largest fall, because the cure is the same for all circles.
    """
    falls = []
    for means in _means_of_circles(campaign):
        if len(means) < _FEWEST_FOR_SIGN:
            continue
        force_N = np.array([mean.force_N for mean in means])
        mean_um = np.array([mean.mean_um for mean in means])
        if np.ptp(force_N) == 0.0 or np.ptp(mean_um) == 0.0:
            continue
        fall_um = -float(np.polyfit(force_N, mean_um, 1)[0] * np.ptp(force_N))
        correlation = float(np.corrcoef(force_N, mean_um)[0, 1])
        if fall_um > _SMALLEST_FALL_UM and correlation < _FALLING:
            falls.append(
                {
                    "fall_um": fall_um,
                    "low_N": float(force_N.min()),
                    "high_N": float(force_N.max()),
                }
            )
    if falls:
        largest = max(falls, key=lambda fall: fall["fall_um"])
        remarks.add(RemarkKind.SIGN, **largest)


def _remark_on_unit(
    quantity: str, value: float, unit: str, usual: tuple[float, float], remarks: _Remarks
) -> None:
    """Add a remark if a value is outside its usual range, which suggests a wrong unit.

    ``quantity`` is the name of the quantity, ``value`` its value in ``unit``, and ``usual`` holds
    the two ends of its usual range. The remark is added to ``remarks``.
    """
    smallest, largest = usual
    is_usual = smallest <= value <= largest
    remarks.add(RemarkKind.UNIT, not is_usual, what=quantity, value=value, unit=unit)
