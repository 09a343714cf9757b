"""A campaign before any model is fitted: what is in it, what looks odd, and what a fit will assume."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.campaign.campaign import Campaign, CircularTest
from ldbb_bayes.result import Result
from ldbb_bayes.units import ranked

__all__ = ["CampaignPreview", "Remark", "RemarkKind", "TestPreview", "preview", "resolution_of"]

Array = NDArray[np.float64]
_ORDER = 12
_SIZE = 2 * _ORDER + 1
_FULL = 359.0
_MOST_READINGS = 200_000
_LEAST_FORCE_N = 5.0
# Steps that few readings repeat: not below this size, nor in fewer values.
_FINEST_UM, _ENOUGH = 0.005, 50


class RemarkKind(StrEnum):
    """What a preview sees: of one test, of the campaign, and what a fit will assume of it."""

    TRAVEL = "travel"
    ARC = "arc"
    GAP = "gap"
    OPEN = "open trace"
    EQUAL = "equal readings"
    SMALL = "small readings"
    LARGE = "large readings"
    FORCE_LAW = "force law"
    SPIKES = "spikes"
    STEP = "step"
    ONE_LEVEL = "one force level"
    TWO_LEVELS = "two force levels"
    SMALL_FORCE = "small force"
    COPY = "copy"
    ONE_WAY = "one way"
    SORTED = "sorted"
    NO_DIRECTION = "no direction"
    CENTRES = "centres of one set-up"
    PLANES = "planes of one set-up"
    MACHINE = "machine"
    FRAMES = "frames"
    SETUPS = "set-ups"
    BOTH_WAYS = "both ways"
    COVARIATE = "covariate"
    READINGS = "readings"
    MOUNT = "mount"
    FORCES = "forces"
    REFERENCE = "reference force"
    BALLS = "balls"


@dataclass(frozen=True)
class Remark:
    """Something seen, and its numbers and names."""

    kind: RemarkKind
    values: dict[str, Any]


@dataclass(frozen=True)
class TestPreview:
    """One test at a glance; None where it cannot be told.

    Attributes
    ----------
    arc_deg, largest_gap_deg : float
        Covered arc; widest distance between neighbouring angles.
    gaps : int
        Distances of neighbouring angles above ten times the usual one.
    direction, travel : str or None
        As stated; as the order of the angles shows it.
    resolution_um : float or None
        Step by which all readings differ, where enough of them repeat to see one [µm].
    spikes : int
        Readings more than eight times the scatter off a Fourier fit to order 12.
    noise_um : float or None
        Scatter left by a Fourier fit to order 12 [µm], where there are at least 35 readings.
    start_end_um : float or None
        Last reading minus first, where the circle closes [µm].
    peak_to_peak_um : float or None
    remarks : tuple of Remark
    """

    __test__ = False

    name: str
    force_N: float
    pressure_bar: float
    readings: int
    arc_deg: float
    largest_gap_deg: float
    gaps: int
    direction: str | None
    travel: str | None
    plane: str
    setup: int
    radius_mm: float
    centre_mm: tuple[float, float, float]
    work_ball_deg: float
    tool_ball_deg: float
    resolution_um: float | None
    spikes: int
    noise_um: float | None
    start_end_um: float | None
    peak_to_peak_um: float | None
    remarks: tuple[Remark, ...]


@dataclass(frozen=True)
class CampaignPreview(Result):
    """The tests of a campaign and the assumptions a fit would make."""

    name: str
    sha256: str
    topology: str
    plane: str
    is_plan: bool
    tests: tuple[TestPreview, ...]
    assumptions: tuple[Remark, ...]
    remarks: tuple[Remark, ...]


def preview(campaign: Campaign) -> CampaignPreview:
    """Look at a campaign or plan without fitting anything."""
    machine = campaign.machine()
    return CampaignPreview(
        name=campaign.name,
        sha256=campaign.sha256,
        topology=campaign.topology,
        plane=machine.plane,
        is_plan=campaign.is_plan,
        tests=tuple(_preview(test, campaign) for test in campaign.tests),
        assumptions=_assumptions(campaign),
        remarks=_remarks(campaign),
    )


def _preview(test: CircularTest, campaign: Campaign) -> TestPreview:
    angle = np.asarray(test.angle_deg)
    wrapped = np.sort(np.mod(angle, 360.0))
    between = np.diff(np.append(wrapped, wrapped[0] + 360.0))
    steps = np.diff(angle)
    gap, usual = float(between.max()), max(float(np.median(between)), float(np.median(np.abs(steps))))
    travel = "CCW" if np.all(steps > 0) else "CW" if np.all(steps < 0) else None
    reading = None if test.reading_um is None else np.asarray(test.reading_um)
    noise = _noise_um(test) if reading is not None else None
    step = None if reading is None else resolution_of(reading)
    spikes = _spikes(test)
    closes = travel is not None and abs(abs(angle[-1] - angle[0]) - 360.0) <= 2.0 * float(np.median(np.abs(steps)))
    start_end = float(reading[-1] - reading[0]) if reading is not None and closes else None
    return TestPreview(
        name=test.name,
        force_N=float(test.force_N or 0.0),
        pressure_bar=float(test.pressure_bar or 0.0),
        readings=len(angle),
        arc_deg=test.arc_deg,
        largest_gap_deg=gap,
        gaps=int(np.count_nonzero(between > 10.0 * usual)),
        direction=test.direction,
        travel=travel,
        plane=str(test.plane),
        setup=test.setup or 1,
        radius_mm=test.circle.radius_mm,
        centre_mm=test.circle.centre_mm,
        work_ball_deg=test.work_ball_deg,
        tool_ball_deg=test.tool_ball_deg,
        resolution_um=step,
        spikes=len(spikes),
        noise_um=noise,
        start_end_um=start_end,
        peak_to_peak_um=None if reading is None else float(np.ptp(reading)),
        remarks=(
            *_test_remarks(test, campaign, travel, gap, usual, noise, start_end),
            *_spike_remark(test, spikes),
            *_step_remark(step, campaign),
        ),
    )


def _test_remarks(
    test: CircularTest,
    campaign: Campaign,
    travel: str | None,
    gap: float,
    usual: float,
    noise: float | None,
    start_end: float | None,
) -> list[Remark]:
    found = []
    if not campaign.is_plan and test.direction and travel and test.direction != travel and not _sorted(campaign):
        found.append(Remark(RemarkKind.TRAVEL, {"stated": test.direction, "travel": travel}))
    if test.arc_deg < _FULL:
        found.append(Remark(RemarkKind.ARC, {"arc_deg": test.arc_deg}))
    elif gap > 10.0 * usual:
        found.append(Remark(RemarkKind.GAP, {"gap_deg": gap}))
    if noise is not None and start_end is not None and abs(start_end) > 10.0 * max(noise, campaign.resolution_um):
        found.append(Remark(RemarkKind.OPEN, {"start_end_um": start_end}))
    if test.reading_um is not None:
        span = float(np.ptp(test.reading_um))
        if span == 0.0:
            found.append(Remark(RemarkKind.EQUAL, {}))
        elif span < 3.0 * campaign.resolution_um:
            found.append(Remark(RemarkKind.SMALL, {}))
        elif span > 1000.0:
            found.append(Remark(RemarkKind.LARGE, {}))
    force, pressure = float(test.force_N or 0.0), float(test.pressure_bar or 0.0)
    law = campaign.force_law.force_N(pressure)
    if abs(law - force) > 0.02 * campaign.force_law.force_N(float(campaign.pressures_bar.max())):
        found.append(Remark(RemarkKind.FORCE_LAW, {"force_N": force, "law_N": law, "pressure_bar": pressure}))
    return found


def _sorted(campaign: Campaign) -> bool:
    """Whether angles rise in all tests although some are stated to run the other way: a sorted table."""
    rising = all(np.all(np.diff(test.angle_deg) > 0) for test in campaign.tests)
    return rising and {"CW", "CCW"} <= {test.direction for test in campaign.tests}


def _spikes(test: CircularTest) -> dict[int, float]:
    """Readings far outside their neighbours' scatter, by the median absolute deviation from a Fourier fit to order 12 [µm]."""
    if test.reading_um is None or not _SIZE + 10 <= len(test.angle_deg) <= _MOST_READINGS:
        return {}
    rest = _off_the_path(test)
    scatter = 1.4826 * float(np.median(np.abs(rest - np.median(rest))))
    return {int(k): float(rest[k]) for k in np.flatnonzero(np.abs(rest) > 8.0 * max(scatter, 1e-9))}


def _spike_remark(test: CircularTest, spikes: dict[int, float]) -> list[Remark]:
    if not spikes:
        return []
    worst = ranked(spikes, lambda k: abs(spikes[k]))[0]
    values = {"reading": worst + 1, "angle_deg": float(test.angle_deg[worst]), "off_um": spikes[worst], "count": len(spikes)}
    return [Remark(RemarkKind.SPIKES, values)]


def resolution_of(reading_um: Array) -> float | None:
    """Return the step by which readings differ [µm]: the smallest difference, if all are whole multiples of it within 5 %.

    None where fewer than a tenth of the readings repeat another and the step is below 0.005 µm: a number of digits then.
    """
    values = np.unique(np.round(reading_um, 6))
    if len(values) < 3:
        return None
    differences = np.diff(values)
    step = float(np.median(differences[differences < 1.5 * differences.min()]))
    if len(values) > 0.9 * len(reading_um) and (step < _FINEST_UM or len(values) < _ENOUGH):
        return None
    off = np.abs(differences / step - np.rint(differences / step))
    return step if float(off.max()) < 0.05 else None


def _step_remark(step: float | None, campaign: Campaign) -> list[Remark]:
    stated = campaign.resolution_um
    if step is None or 0.5 * stated < step < 1.5 * stated:
        return []
    return [Remark(RemarkKind.STEP, {"step_um": step, "stated_um": stated})]


def _noise_um(test: CircularTest) -> float | None:
    """Root mean square outside orders 0-12 [µm]."""
    if len(test.angle_deg) < _SIZE + 10:
        return None
    rest = _off_the_path(test)
    return float(np.sqrt(rest @ rest / (len(rest) - _SIZE)))


def _off_the_path(test: CircularTest) -> Array:
    """Readings off a Fourier fit to order 12 [µm]."""
    turns = np.exp(1j * np.outer(test.angles_rad(), np.arange(_ORDER + 1)))
    columns = np.hstack([turns.real, turns.imag[:, 1:]])
    rest: Array = test.reading_um - columns @ np.linalg.lstsq(columns, test.reading_um, rcond=1e-9)[0]
    return rest


def _assumptions(campaign: Campaign) -> tuple[Remark, ...]:
    mount, law, forces, machine = campaign.mount, campaign.force_law, campaign.forces_N, campaign.machine()
    radii = sorted({float(test.radius_mm or 0.0) for test in campaign.tests})
    setups = sorted({test.setup or 1 for test in campaign.tests})
    both = [plane for plane in machine.planes if {"CW", "CCW"} <= _directions(campaign, plane)]
    clocked = len({(test.work_ball_deg % 360.0, test.tool_ball_deg % 360.0) for test in campaign.tests}) > 1
    recorded = {"time": [t.time_s for t in campaign.tests], "temperature": [t.temperature_C for t in campaign.tests]}
    kinds = RemarkKind
    return (
        Remark(kinds.MACHINE, {"topology": campaign.topology, "plane": machine.plane, "radii_mm": radii}),
        *([Remark(kinds.FRAMES, {"frames_mm": dict(campaign.frames_mm)})] if campaign.frames_mm else []),
        *([Remark(kinds.SETUPS, {"setups": setups})] if len(setups) > 1 else []),
        *([Remark(kinds.BOTH_WAYS, {"planes": both})] if both else []),
        *(Remark(kinds.COVARIATE, {"over": over}) for over, v in recorded.items() if None not in v and len(set(v)) > 1),
        Remark(kinds.READINGS, {"resolution_um": campaign.resolution_um}),
        Remark(kinds.MOUNT, {"deflection_um_per_bar": mount.deflection_um_per_bar, "compensated": mount.compensated}),
        Remark(kinds.FORCES, {"slope_N_per_bar": law.slope_N_per_bar, "offset_N": law.offset_N}),
        Remark(kinds.REFERENCE, {"force_N": float(forces.min() + forces.max()) / 2}),
        Remark(kinds.BALLS, {"clocked": clocked}),
    )


def _directions(campaign: Campaign, plane: str) -> set[str | None]:
    return {test.direction for test in campaign.tests if test.plane == plane}


def _remarks(campaign: Campaign) -> tuple[Remark, ...]:
    found, kinds = [], RemarkKind
    planes, force = campaign.machine().planes, float(campaign.forces_N.max())
    levels = len(np.unique(campaign.forces_N))
    if levels <= 2:
        found.append(Remark(kinds.ONE_LEVEL if levels == 1 else kinds.TWO_LEVELS, {}))
    if force < _LEAST_FORCE_N:
        found.append(Remark(kinds.SMALL_FORCE, {"force_N": force}))
    found += [
        Remark(kinds.COPY, {"first": first.name, "second": second.name})
        for first, second in combinations(campaign.tests, 2)
        if first.reading_um is not None and np.array_equal(first.reading_um, second.reading_um)
    ]
    for plane in planes:
        if not {"CW", "CCW"} <= _directions(campaign, plane):
            first_axis, second_axis = sorted(plane)
            cross = f"C_{first_axis}{second_axis}{first_axis}"
            found.append(Remark(kinds.ONE_WAY, {"compliance": cross, "plane": plane if len(planes) > 1 else ""}))
    if not campaign.is_plan and _sorted(campaign):
        found.append(Remark(kinds.SORTED, {}))
    for plane in planes:
        own = [test for test in campaign.tests if test.plane == plane]
        silent = [test.name for test in own if test.direction is None]
        if silent and {"CW", "CCW"} <= _directions(campaign, plane):
            found.append(Remark(kinds.NO_DIRECTION, {"test": silent[0]}))
        for setup in sorted({test.setup or 1 for test in own}):
            if len({test.circle.centre_mm for test in own if (test.setup or 1) == setup}) > 1:
                found.append(Remark(kinds.CENTRES, {"setup": setup}))
    if len({test.setup for test in campaign.tests}) == 1 and len(planes) > 1:
        found.append(Remark(kinds.PLANES, {}))
    return tuple(own for k, own in enumerate(found) if own not in found[:k])
