"""From raw readings to readings the model takes: pressure ↔ force, mount compensation (Eq. 32), masks and trimming."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.campaign.circular_test import CircularTest
from ldbb_bayes.errors import InputError

__all__ = ["compensate_mount", "fill_force_and_pressure", "mask_angles", "mask_reversals", "trim_overshoot"]


def fill_force_and_pressure(campaign: Campaign) -> Campaign:
    """Give every test both a force and a pressure, by the campaign's force law where one is missing.

    F = slope · P + offset, P = (F − offset) / slope.
    """
    law = campaign.force_law
    tests = []
    for test in campaign.tests:
        if test.force_N is None and test.pressure_bar is not None:
            test = replace(test, force_N=law.force_N(test.pressure_bar))
        elif test.pressure_bar is None and test.force_N is not None:
            test = replace(test, pressure_bar=law.pressure_bar(test.force_N))
        tests.append(test)
    return replace(campaign, tests=tuple(tests))


def compensate_mount(campaign: Campaign) -> Campaign:
    """Subtract the deflection of the work ball's mount, P · deflection (Eq. 32, bar level), from every reading.

    Raises
    ------
    InputError
        When the readings are compensated already.
    """
    if campaign.is_plan:
        raise InputError("mount compensation must have readings to correct, got a plan. Measure or simulate it first.")
    if campaign.mount.compensated:
        raise InputError(
            "mount compensation must be applied once, got readings marked compensated. "
            "Set [mount] compensated = false if they are raw."
        )
    filled = fill_force_and_pressure(campaign)
    tests = tuple(
        test.with_reading_um(test.reading_um - campaign.mount.deflection_um_per_bar * (test.pressure_bar or 0.0))
        for test in filled.tests
    )
    return replace(filled, tests=tests, mount=replace(campaign.mount, compensated=True))


def mask_angles(test: CircularTest, arcs_deg: Sequence[tuple[float, float]]) -> CircularTest:
    """Drop the readings inside the given arcs.

    Parameters
    ----------
    arcs_deg : sequence of (start, end) [deg]
        Counter-clockwise from start to end, modulo 360°; an arc may run through 0°.

    Raises
    ------
    InputError
        When an arc is not finite or nothing would remain.
    """
    keep = np.ones(len(test.angle_deg), dtype=bool)
    for start, end in arcs_deg:
        if not (np.isfinite(start) and np.isfinite(end)):
            raise InputError(f"arcs_deg must be finite angles, got ({start}, {end}). Give start and end in degrees.")
        width = 360.0 if abs(end - start) >= 360.0 else np.mod(end - start, 360.0)
        keep &= np.mod(test.angle_deg - start, 360.0) > width
    if not keep.any():
        raise InputError(f"arcs_deg must leave readings, got arcs that cover all of test {test.name!r}. Make them smaller.")
    return test.select(keep)


def mask_reversals(test: CircularTest, half_width_deg: float = 5.0) -> CircularTest:
    """Drop the readings within ``half_width_deg`` of the axis reversal points 0°, 90°, 180° and 270°.

    Raises
    ------
    InputError
        When the half width is not between 0° and 45°.
    """
    if not 0.0 < half_width_deg < 45.0:
        raise InputError(f"half_width_deg must lie between 0 and 45, got {half_width_deg}. Choose a few degrees.")
    return mask_angles(test, [(q - half_width_deg, q + half_width_deg) for q in (0.0, 90.0, 180.0, 270.0)])


def trim_overshoot(test: CircularTest, *, start_deg: float | None = None, arc_deg: float = 360.0) -> CircularTest:
    """Keep one pass of ``arc_deg`` of a recording that ran in before and ran out after.

    Parameters
    ----------
    start_deg : float, optional
        Angle at which the pass begins, as recorded (not modulo 360°) [deg]. Default: the pass is centred in the recording.
    arc_deg : float
        Length of the pass [deg]. The reading that repeats the first angle is dropped.

    Raises
    ------
    InputError
        When the recording is shorter than the pass, or its angles do not run in one direction.
    """
    angle = test.angle_deg
    steps = np.diff(angle)
    if not (np.all(steps > 0) or np.all(steps < 0)):
        raise InputError(
            f"angles must run in one direction to be trimmed, got test {test.name!r} with changes of direction. "
            "Unwrap the angles past 360° first."
        )
    travel = 1.0 if steps[0] > 0 else -1.0
    along = travel * angle
    span = along[-1] - along[0]
    if span + abs(np.median(steps)) < arc_deg:
        raise InputError(f"recording must span {arc_deg:g}°, got {span:g}° in test {test.name!r}. Give a shorter arc_deg.")
    start = along[0] + max(span - arc_deg, 0.0) / 2 if start_deg is None else travel * start_deg
    tolerance = 1e-6 * arc_deg
    if start < along[0] - tolerance or start + arc_deg > along[-1] + abs(np.median(steps)) + tolerance:
        raise InputError(
            f"start_deg must leave {arc_deg:g}° of recording, got {start_deg} in test {test.name!r}, which runs from "
            f"{angle[0]:g}° to {angle[-1]:g}°. Start elsewhere or give a shorter arc_deg."
        )
    keep = (along >= start - tolerance) & (along < start + arc_deg - tolerance)
    return test.select(keep)
