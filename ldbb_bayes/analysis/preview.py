"""A campaign before any model is fitted: what is in it, what looks odd, and what a fit will assume."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.campaign.circular_test import CircularTest
from ldbb_bayes.model.basis import SIZE, basis
from ldbb_bayes.model.reduction import reduce_readings
from ldbb_bayes.notebook import table_html

__all__ = ["CampaignPreview", "TestPreview", "preview", "resolution_of"]

Array = NDArray[np.float64]
_FULL = 359.0
_MOST_READINGS = 200_000
_LEAST_FORCE_N = 5.0
# Steps that few readings repeat: not below this size, nor in fewer values.
_FINEST_UM, _ENOUGH = 0.005, 50


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
    remarks : tuple of str
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
    remarks: tuple[str, ...]


@dataclass(frozen=True)
class CampaignPreview:
    """The tests of a campaign and the assumptions a fit would make."""

    name: str
    sha256: str
    topology: str
    plane: str
    is_plan: bool
    tests: tuple[TestPreview, ...]
    assumptions: tuple[str, ...]
    remarks: tuple[str, ...]

    def _repr_html_(self) -> str:
        rows = [{key: value for key, value in asdict(test).items() if key != "remarks"} for test in self.tests]
        return table_html(f"{self.name}: {' '.join(self.remarks)}", rows)

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {"schema": 1, **asdict(self)}


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
) -> list[str]:
    found = []
    if not campaign.is_plan and test.direction and travel and test.direction != travel and not _sorted(campaign):
        found.append(f"stated {test.direction}, but the angles run {travel}")
    if test.arc_deg < _FULL:
        found.append(f"arc of {test.arc_deg:.0f}° only: harmonics mix")
    elif gap > 10.0 * usual:
        found.append(f"gap of {gap:.1f}°")
    if noise is not None and start_end is not None and abs(start_end) > 10.0 * max(noise, campaign.resolution_um):
        found.append(f"start and end differ by {start_end:+.1f} µm: drift, or a trace that does not close")
    if test.reading_um is not None and float(np.ptp(test.reading_um)) == 0.0:
        found.append("all readings equal")
    if test.reading_um is not None and 0.0 < float(np.ptp(test.reading_um)) < 3.0 * campaign.resolution_um:
        found.append("readings hardly exceed the resolution: check their unit")
    if test.reading_um is not None and float(np.ptp(test.reading_um)) > 1000.0:
        found.append("readings span more than 1 mm: check their unit")
    law = campaign.force_law.force_N(float(test.pressure_bar or 0.0))
    if abs(law - float(test.force_N or 0.0)) > 0.02 * campaign.force_law.force_N(float(campaign.pressures_bar.max())):
        found.append(f"force {test.force_N:g} N, but the force law gives {law:.0f} N at {test.pressure_bar:g} bar")
    return found


def _sorted(campaign: Campaign) -> bool:
    """Whether angles rise in all tests although some are stated to run the other way: a sorted table."""
    rising = all(np.all(np.diff(test.angle_deg) > 0) for test in campaign.tests)
    return rising and {"CW", "CCW"} <= {test.direction for test in campaign.tests}


def _spikes(test: CircularTest) -> dict[int, float]:
    """Readings far outside their neighbours' scatter, by the median absolute deviation from a Fourier fit to order 12 [µm]."""
    if test.reading_um is None or not SIZE + 10 <= len(test.angle_deg) <= _MOST_READINGS:
        return {}
    columns = basis(test.angles_rad())
    rest = test.reading_um - columns @ np.linalg.lstsq(columns, test.reading_um, rcond=1e-9)[0]
    scatter = 1.4826 * float(np.median(np.abs(rest - np.median(rest))))
    return {int(k): float(rest[k]) for k in np.flatnonzero(np.abs(rest) > 8.0 * max(scatter, 1e-9))}


def _spike_remark(test: CircularTest, spikes: dict[int, float]) -> list[str]:
    if not spikes:
        return []
    worst = max(spikes, key=lambda k: abs(spikes[k]))
    many = "" if len(spikes) == 1 else f"; {len(spikes)} readings do so"
    return [f"reading {worst + 1} at {test.angle_deg[worst]:g}° stands {spikes[worst]:+.1f} µm off its neighbours{many}"]


def resolution_of(reading_um: Array) -> float | None:
    """Step by which readings differ [µm]: the smallest difference, if all differences are whole multiples of it within 5 %.

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


def _step_remark(step: float | None, campaign: Campaign) -> list[str]:
    if step is None or 0.5 * campaign.resolution_um < step < 1.5 * campaign.resolution_um:
        return []
    return [
        f"readings go in steps of {step:.3g} µm, the campaign states a resolution of {campaign.resolution_um:g} µm, below whose "
        "√12th part no noise is looked for: state the step (--resolution-um, or resolution_um in campaign.toml)"
    ]


def _noise_um(test: CircularTest) -> float | None:
    """Root mean square outside orders 0-12 [µm]."""
    if len(test.angle_deg) < SIZE + 10:
        return None
    reduced = reduce_readings(test.angles_rad(), test.readings_mm())
    return float(np.sqrt(reduced.residual_ss / (reduced.readings - SIZE)) * 1e3)


def _assumptions(campaign: Campaign) -> tuple[str, ...]:
    mount, law = campaign.mount, campaign.force_law
    state = "already compensated" if mount.compensated else "not compensated: the nominal deflection will be subtracted"
    clocked = len({(test.work_ball_deg % 360.0, test.tool_ball_deg % 360.0) for test in campaign.tests}) > 1
    forces = campaign.forces_N
    radii = sorted({float(test.radius_mm or 0.0) for test in campaign.tests})
    frames = "; ".join(f"{axis} ({', '.join(f'{x:g}' for x in at)})" for axis, at in campaign.frames_mm.items())
    return (
        f"Machine {campaign.topology}, plane {campaign.machine().plane}, R = {', '.join(f'{r:g}' for r in radii)} mm"
        + (", each with a length of its own." if len(radii) > 1 else "."),
        *([f"Joint frames stand at {frames} mm."] if frames else []),
        *_several(campaign),
        f"Readings are actual ball distance − R; readout resolution {campaign.resolution_um:g} µm.",
        f"Mount (Eq. 32) {mount.deflection_um_per_bar:g} µm/bar, {state}.",
        f"Force law F = {law.slope_N_per_bar:g} N/bar · P {law.offset_N:+g} N, where a test gives only one of the two.",
        f"Reference force F0 = {(forces.min() + forces.max()) / 2:g} N, the middle of the tested range.",
        "Balls clocked between tests: two forms."
        if clocked
        else "No ball clocked between tests: one form, the sum of both balls.",
    )


def _several(campaign: Campaign) -> list[str]:
    """What a fit makes of set-ups, directions, times and temperatures."""
    said = []
    setups = sorted({test.setup or 1 for test in campaign.tests})
    if len(setups) > 1:
        said.append(f"Set-ups {', '.join(map(str, setups))}: tool offsets of each; everything else is shared.")
    both = [p for p in campaign.machine().planes if {"CW", "CCW"} <= {t.direction for t in campaign.tests if t.plane == p}]
    if both:
        said.append(f"Both directions of travel in {', '.join(both)}: hysteresis is a term of the model.")
    for what, values in (
        ("times", [test.time_s for test in campaign.tests]),
        ("temperatures", [test.temperature_C for test in campaign.tests]),
    ):
        if None not in values and len(set(values)) > 1:
            said.append(f"Tests record {what}; a drift over them is modelled only when asked for (--drift {what[:-1]}).")
    return said


def _remarks(campaign: Campaign) -> tuple[str, ...]:
    found = []
    levels = np.unique(campaign.forces_N)
    if len(levels) == 1:
        found.append(
            "One force level: constant compliance and geometry are told apart by their priors alone; "
            "degree 0 only. Test a second force."
        )
    elif len(levels) == 2:
        found.append("Two force levels: constant compliance only is checked by the readings; a slope needs a third.")
    if campaign.forces_N.max() < _LEAST_FORCE_N:
        found.append(f"The largest force is {campaign.forces_N.max():g} N: check the unit of force_N.")
    found += [
        f"Tests {first.name} and {second.name} hold the same readings: a file read twice?"
        for first, second in combinations(campaign.tests, 2)
        if first.reading_um is not None and np.array_equal(first.reading_um, second.reading_um)
    ]
    for plane in campaign.machine().planes:
        if not {"CW", "CCW"} <= {test.direction for test in campaign.tests if test.plane == plane}:
            first, second = sorted(plane)
            cross = f"C_{first}{second}{first}"
            where = f" in plane {plane}" if len(campaign.machine().planes) > 1 else ""
            found.append(f"One direction of travel (or none stated){where}: friction in the bar cannot be told from {cross}.")
    if not campaign.is_plan and _sorted(campaign):
        found.append("Angles rise in all tests, those stated CW among them: taken as sorted, and the directions as stated.")
    for plane in campaign.machine().planes:
        own = [test for test in campaign.tests if test.plane == plane]
        silent = [test.name for test in own if test.direction is None]
        if silent and {"CW", "CCW"} <= {test.direction for test in own}:
            found.append(f"Test {silent[0]} states no direction while others run both ways: a fit will refuse it. State it.")
        for setup in sorted({test.setup or 1 for test in own}):
            if len({test.circle.centre_mm for test in own if (test.setup or 1) == setup}) > 1:
                found.append(
                    f"Several centres in set-up {setup}: the tool ball's offsets are shared, as if the work ball had been moved "
                    "by exactly what the axes say. If it was mounted anew, number the set-ups."
                )
    if len({test.setup for test in campaign.tests}) == 1 and len(campaign.machine().planes) > 1:
        found.append(
            "Several planes in one set-up: the tool ball's offsets are shared. If the bar was mounted anew, number the set-ups."
        )
    return tuple(dict.fromkeys(found))
