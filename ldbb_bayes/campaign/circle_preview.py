"""Preview of one circular test: its angles, its readings, and what looks odd in them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ldbb_bayes.campaign.campaign import Campaign, CircularTest
from ldbb_bayes.campaign.circular_test import setup_number, usual_gap
from ldbb_bayes.campaign.remarks import Remark, RemarkKind, RemarkList
from ldbb_bayes.campaign.spikes import SERIES_ORDER, fit_regular_readings, regular_readings
from ldbb_bayes.results import Array
from ldbb_bayes.units import ranked

__all__ = ["TestPreview", "preview_test", "resolution_of"]

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
# Smallest resolution [µm] that is accepted if more than nine tenths of the readings are distinct. A
# smaller step only shows the number of digits with which the readings were written.
_FINEST_STEP_UM = 0.005
# If more than nine tenths of the readings are distinct, a resolution is determined only if the
# number of distinct readings is at least this large.
_MIN_VALUES = 50


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


def preview_test(test: CircularTest, campaign: Campaign) -> TestPreview:
    """Return the summary of one test of a campaign, including remarks on what looks odd."""
    remarks = RemarkList()
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
    test: CircularTest, campaign: Campaign, angles: _Angles, remarks: RemarkList
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


def _remark_on_force(test: CircularTest, campaign: Campaign, remarks: RemarkList) -> None:
    """Add a remark if the force given for a test does not agree with its pressure.

    The given force is compared with the force that follows from the pressure by the campaign's
    force law. The remark is added to ``remarks``.
    """
    force_N = float(test.force_N or 0.0)
    pressure_bar = float(test.pressure_bar or 0.0)
    law_N = campaign.force_law.force_N(pressure_bar)
    largest_N = campaign.force_law.force_N(float(campaign.pressures_bar.max()))
    remarks.add_if(
        abs(law_N - force_N) > _FORCE_LAW_SHARE * largest_N,
        RemarkKind.FORCE_LAW,
        force_N=force_N,
        law_N=law_N,
        pressure_bar=pressure_bar,
    )


def _preview_readings(
    test: CircularTest, stated_um: float, angles: _Angles, remarks: RemarkList
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
    remarks.add_if(
        not is_usual,
        RemarkKind.UNIT,
        what="peak to peak",
        value=span,
        unit="µm",
    )
    remarks.add_if(
        resolution_um and not 0.5 * stated_um < resolution_um < 1.5 * stated_um,
        RemarkKind.STEP,
        step_um=resolution_um,
        stated_um=stated_um,
    )
    return _Readings(resolution_um, spikes, noise_um, start_end_um, span)


def _noise_and_spikes(
    test: CircularTest, resolution_um: float, closes: bool, remarks: RemarkList
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
        remarks.add_if(is_open, RemarkKind.OPEN, start_end_um=jump)

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
