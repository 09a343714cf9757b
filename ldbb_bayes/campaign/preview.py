"""A campaign before any model is fitted: what is in it, what looks odd, and what a fit will
assume."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from enum import StrEnum
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.campaign.campaign import Campaign, CircularTest
from ldbb_bayes.results import Array, Result
from ldbb_bayes.units import ranked

__all__ = ["CampaignPreview", "Remark", "RemarkKind", "TestPreview", "preview", "resolution_of"]

_ORDER = 12
_FULL_DEG = 359.0
_FORCES_N = (5.0, 10_000.0)
_RADII_MM = (10.0, 2000.0)
# Numbers of readings that a path is fitted to; scatters off it that make a spike; rounds of
# reweighting.
_FITTED = range(2 * _ORDER + 11, 200_001)
_SPIKE = 8.0
_ROUNDS = 20
# Steps that few readings repeat: not below this size, nor in fewer values.
_FINEST_UM = 0.005
_ENOUGH = 50


class RemarkKind(StrEnum):
    """What a preview sees: of one test, of the campaign, and what a fit will assume of it."""

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
    ONE_WAY = "one way"
    PLACES = "places of one set-up"
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


class _Remarks(list[Remark]):
    def add(self, kind: RemarkKind, seen: object = True, **values: Any) -> None:
        if seen:
            self.append(Remark(kind, values))


@dataclass(frozen=True)
class TestPreview:
    """One test at a glance; None where it cannot be told."""

    __test__ = False

    name: str
    force_N: float
    pressure_bar: float
    readings: int
    arc_deg: float  #: covered
    largest_gap_deg: float  #: widest distance between neighbouring angles
    direction: str | None  #: as stated
    travel: str | None  #: as the order of the angles shows it
    plane: str
    setup: int
    radius_mm: float
    centre_mm: tuple[float, float, float]
    work_ball_deg: float
    tool_ball_deg: float
    #: step by which all readings differ, where enough of them repeat to see one
    resolution_um: float | None
    #: readings more than eight times the scatter off a resistant Fourier fit to order 12
    spikes: int
    #: scatter left by a Fourier fit to order 12 without the spikes, of 35 to 200 000 readings
    noise_um: float | None
    start_end_um: float | None  #: last reading minus first, where the circle closes
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
    return CampaignPreview(
        name=campaign.name,
        sha256=campaign.sha256,
        topology=campaign.topology,
        plane=campaign.machine().plane,
        is_plan=campaign.is_plan,
        tests=tuple(_preview(test, campaign) for test in campaign.tests),
        assumptions=_assumptions(campaign),
        remarks=_remarks(campaign),
    )


_SHOWN = (
    "name",
    "force_N",
    "pressure_bar",
    "arc_deg",
    "direction",
    "plane",
    "setup",
    "work_ball_deg",
    "tool_ball_deg",
)


def _preview(test: CircularTest, campaign: Campaign) -> TestPreview:
    angle = np.asarray(test.angle_deg)
    stated = campaign.resolution_um
    remarks = _Remarks()
    kinds = RemarkKind
    around = np.sort(np.mod(angle, 360.0))
    steps = np.diff(angle)
    between = np.diff(np.append(around, around[0] + 360.0))
    step = float(np.median(np.abs(steps)))
    gap = float(between.max())
    usual = max(float(np.median(between)), step)
    travel = "CCW" if np.all(steps > 0) else "CW" if np.all(steps < 0) else None
    # Angles that rise in all tests, although some are stated to run the other way, are those of a
    # sorted table.
    both = {"CW", "CCW"} <= {own.direction for own in campaign.tests}
    in_order = both and all(np.all(np.diff(own.angle_deg) > 0) for own in campaign.tests)
    against = (
        test.direction
        and travel
        and test.direction != travel
        and not (campaign.is_plan or in_order)
    )
    remarks.add(kinds.TRAVEL, against, stated=test.direction, travel=travel)
    remarks.add(kinds.ARC, test.arc_deg < _FULL_DEG, arc_deg=test.arc_deg)
    remarks.add(kinds.GAP, test.arc_deg >= _FULL_DEG and gap > 10.0 * usual, gap_deg=gap)
    force = float(test.force_N or 0.0)
    pressure = float(test.pressure_bar or 0.0)
    law = campaign.force_law.force_N(pressure)
    off = abs(law - force) > 0.02 * campaign.force_law.force_N(float(campaign.pressures_bar.max()))
    remarks.add(kinds.FORCE_LAW, off, force_N=force, law_N=law, pressure_bar=pressure)
    seen: dict[str, Any] = {
        "resolution_um": None,
        "spikes": 0,
        "noise_um": None,
        "start_end_um": None,
        "peak_to_peak_um": None,
    }
    if test.reading_um is not None:
        reading = test.reading_um
        span = float(np.ptp(test.reading_um))
        digit = resolution_of(test.reading_um)
        closes = travel is not None and abs(abs(angle[-1] - angle[0]) - 360.0) <= 2.0 * step
        seen |= {"resolution_um": digit, "peak_to_peak_um": span}
        seen |= {"start_end_um": float(reading[-1] - reading[0]) if closes else None}
        if len(reading) in _FITTED:
            seen["noise_um"], seen["spikes"] = _path(test, stated, closes, remarks)
        remarks.add(
            kinds.UNIT,
            not 3.0 * stated <= span <= 1000.0,
            what="peak to peak",
            value=span,
            unit="µm",
        )
        remarks.add(
            kinds.STEP,
            digit and not 0.5 * stated < digit < 1.5 * stated,
            step_um=digit,
            stated_um=stated,
        )
    return TestPreview(
        **{key: getattr(test, key) for key in _SHOWN},
        readings=len(angle),
        largest_gap_deg=gap,
        travel=travel,
        radius_mm=test.circle.radius_mm,
        centre_mm=test.circle.centre_mm,
        **seen,
        remarks=tuple(remarks),
    )


def _path(
    test: CircularTest, resolution_um: float, closes: bool, remarks: _Remarks
) -> tuple[float, int]:
    """Scatter off a Fourier fit to order 12 [µm], and the number of spikes; what looks odd is
    remarked. Where the circle closes, a drift linear in the angle is fitted too: last and first
    reading are a step of the path apart."""
    turns = np.exp(1j * np.outer(test.angles_rad(), np.arange(_ORDER + 1)))
    reading = np.asarray(test.reading_um)
    path = np.hstack([turns.real, turns.imag[:, 1:]])
    turn = test.angle_deg / 360.0
    columns = np.column_stack([path, turn]) if closes else path
    kept = _without_spikes(columns, reading)
    coefficients, off, scatter = _fit(columns, reading, kept)
    jump = float(off[-1] - off[0] + (turn[-1] - turn[0]) * coefficients[-1]) if closes else 0.0
    remarks.add(RemarkKind.OPEN, abs(jump) > 10.0 * max(scatter, resolution_um), start_end_um=jump)
    spikes = ranked(np.flatnonzero(~kept).tolist(), lambda k: abs(off[k]))
    for k in spikes[:1]:
        at = float(test.angle_deg[k])
        remarks.add(
            RemarkKind.SPIKES, reading=k + 1, angle_deg=at, off_um=float(off[k]), count=len(spikes)
        )
    return _fit(path, reading, kept)[2], len(spikes)


def _fit(columns: Array, reading: Array, kept: NDArray[np.bool_]) -> tuple[Array, Array, float]:
    """Coefficients of least squares over the readings kept, all readings off it, and the scatter of
    those kept."""
    coefficients: Array = np.linalg.lstsq(columns[kept], reading[kept], rcond=1e-9)[0].astype(float)
    off = reading - columns @ coefficients
    return (
        coefficients,
        off,
        float(np.sqrt(np.sum(off[kept] ** 2) / (np.count_nonzero(kept) - columns.shape[1]))),
    )


def _without_spikes(columns: Array, reading: Array) -> NDArray[np.bool_]:
    """Which readings stand less than eight scatters off the path of least absolute deviations, then
    off that of the others."""
    span, size, _ = np.linalg.svd(columns, full_matrices=False)
    span = span[:, size > 1e-9 * size[0]]
    n, p = span.shape
    off = reading - span @ (span.T @ reading)
    for _ in range(_ROUNDS):
        weight = 1.0 / np.maximum(np.abs(off), 1e-6 * np.abs(off).max() + 1e-12)
        off = reading - span @ np.linalg.solve(
            (span.T * weight) @ span, span.T @ (weight * reading)
        )
    kept = np.ones(n, dtype=bool)
    for _ in range(_ROUNDS):
        # A path of least absolute deviations goes through p readings.
        scatter = 1.4826 * float(np.median(np.sort(np.abs(off))[p:]))
        before = kept
        kept = np.abs(off) <= _SPIKE * max(scatter, 1e-9)
        if np.array_equal(before, kept) or np.count_nonzero(kept) <= p:
            break
        off = _fit(columns, reading, kept)[1]
    return kept


def resolution_of(reading_um: Array) -> float | None:
    """Return the step by which readings differ [µm]: the smallest difference, if all are whole
    multiples of it within 5 %. None where fewer than a tenth of the readings repeat another and the
    step is below 0.005 µm: a number of digits then."""
    values = np.unique(np.round(reading_um, 6))
    if len(values) < 3:
        return None
    differences = np.diff(values)
    step = float(np.median(differences[differences < 1.5 * differences.min()]))
    if len(values) > 0.9 * len(reading_um) and (step < _FINEST_UM or len(values) < _ENOUGH):
        return None
    off = np.abs(differences / step - np.rint(differences / step))
    return step if float(off.max()) < 0.05 else None


def _assumptions(campaign: Campaign) -> tuple[Remark, ...]:
    tests = campaign.tests
    machine = campaign.machine()
    law = campaign.force_law
    forces = campaign.forces_N
    kinds = RemarkKind
    setups = sorted({test.setup or 1 for test in tests})
    both = [plane for plane in machine.planes if _both_ways(campaign, plane)]
    remarks = _Remarks()
    radii = sorted({test.circle.radius_mm for test in tests})
    remarks.add(kinds.MACHINE, topology=campaign.topology, plane=machine.plane, radii_mm=radii)
    remarks.add(kinds.FRAMES, campaign.frames_mm, frames_mm=dict(campaign.frames_mm))
    remarks.add(kinds.SETUPS, len(setups) > 1, setups=setups)
    remarks.add(kinds.BOTH_WAYS, both, planes=both)
    for over, values in (
        ("time", [t.time_s for t in tests]),
        ("temperature", [t.temperature_C for t in tests]),
    ):
        remarks.add(kinds.COVARIATE, None not in values and len(set(values)) > 1, over=over)
    remarks.add(kinds.READINGS, resolution_um=campaign.resolution_um)
    remarks.add(kinds.MOUNT, **asdict(campaign.mount))
    remarks.add(kinds.FORCES, slope_N_per_bar=law.slope_N_per_bar, offset_N=law.offset_N)
    remarks.add(kinds.REFERENCE, force_N=float(forces.min() + forces.max()) / 2)
    remarks.add(
        kinds.BALLS,
        clocked=len({(test.work_ball_deg % 360.0, test.tool_ball_deg % 360.0) for test in tests})
        > 1,
    )
    return tuple(remarks)


def _both_ways(campaign: Campaign, plane: str) -> bool:
    return {"CW", "CCW"} <= {test.direction for test in campaign.tests if test.plane == plane}


def _remarks(campaign: Campaign) -> tuple[Remark, ...]:
    remarks = _Remarks()
    tests = campaign.tests
    planes = campaign.machine().planes
    kinds = RemarkKind
    force = float(campaign.forces_N.max())
    remarks.add(kinds.ONE_LEVEL, campaign.force_levels == 1)
    remarks.add(kinds.TWO_LEVELS, campaign.force_levels == 2)
    remarks.add(
        kinds.UNIT,
        not _FORCES_N[0] <= force <= _FORCES_N[1],
        what="the largest force",
        value=force,
        unit="N",
    )
    for radius in sorted({test.circle.radius_mm for test in tests}):
        remarks.add(
            kinds.UNIT,
            not _RADII_MM[0] <= radius <= _RADII_MM[1],
            what="a radius",
            value=radius,
            unit="mm",
        )
    for first, second in combinations(tests if not campaign.is_plan else (), 2):
        remarks.add(
            kinds.COPY,
            np.array_equal(first.reading_um, second.reading_um),
            first=first.name,
            second=second.name,
        )
    for plane in planes:
        one, other = sorted(plane)
        named = plane if len(planes) > 1 else ""
        remarks.add(
            kinds.ONE_WAY,
            not _both_ways(campaign, plane),
            compliance=f"C_{one}{other}{one}",
            plane=named,
        )
    places = {(test.setup, test.plane, test.circle.centre_mm) for test in tests}
    for setup in sorted({test.setup or 1 for test in tests}):
        remarks.add(kinds.PLACES, sum(own == setup for own, *_ in places) > 1, setup=setup)
    return tuple(remarks)
