"""From raw readings to readings the model takes: masks, angles from time, laps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.campaign.campaign import CircularTest
from ldbb_bayes.errors import InputError, require

__all__ = ["angles_from_time", "average_laps", "direction_run", "mask_angles", "mask_reversals", "on_the_circle"]

Array = NDArray[np.float64]
_TURN = 360.0


def mask_angles(test: CircularTest, arcs_deg: Sequence[tuple[float, float]]) -> CircularTest:
    """Drop the readings inside the given arcs [deg], counter-clockwise from start to end, modulo 360°."""
    keep = np.ones(len(test.angle_deg), dtype=bool)
    for start, end in arcs_deg:
        if not (np.isfinite(start) and np.isfinite(end)):
            raise InputError(f"arcs_deg must be finite angles, got ({start}, {end}). Give start and end in degrees.")
        width = 360.0 if abs(end - start) >= 360.0 else np.mod(end - start, 360.0)
        keep &= np.mod(test.angle_deg - start, 360.0) > width
    require(keep.any(), f"arcs_deg must leave readings, got arcs that cover all of test {test.name!r}. Make them smaller.")
    return test.select(keep)


def mask_reversals(test: CircularTest, half_width_deg: float = 5.0) -> CircularTest:
    """Drop the readings within ``half_width_deg`` of the axis reversal points 0°, 90°, 180° and 270°."""
    require(0.0 < half_width_deg < 45.0, f"half_width_deg must lie between 0 and 45, got {half_width_deg}. Choose a few degrees.")
    return mask_angles(test, [(q - half_width_deg, q + half_width_deg) for q in (0.0, 90.0, 180.0, 270.0)])


def angles_from_time(
    time_s: Array, *, feed_mm_per_min: float, radius_mm: float, start_deg: float, overshoot_deg: float, sense: int
) -> Array:
    """Angle of every reading of a log over time, shape (n,) [deg], not modulo 360°.

    The axes run at constant feed along the circle: θ(t) = start + sense · (feed (t − t0) / R − overshoot), with t0 the first
    reading's time and sense 1 counter-clockwise, −1 clockwise. Acceleration at the ends is inside the overshoot, or neglected.
    """
    travelled = np.rad2deg(feed_mm_per_min / 60.0 / radius_mm) * (time_s - time_s[0])
    got = f"{travelled[-1]:.1f}° at {feed_mm_per_min:g} mm/min on {radius_mm:g} mm. Check feed, radius and the unit of time"
    enough = travelled[-1] >= overshoot_deg + 0.5 * _TURN
    require(enough, f"a log must cover the overshoot and half a turn, got {got}.")
    return start_deg + sense * (travelled - overshoot_deg)


def on_the_circle(angle_deg: Array, *, start_deg: float, sense: int) -> NDArray[np.bool_]:
    """Which readings of a log lie on the circle: from its start over whole turns, run-in and run-out left out.

    A turn may lack its closing reading. A log that ends before a turn is complete is an arc, kept to its end.
    """
    along = sense * (angle_deg - start_deg)
    step = float(np.median(np.diff(along)))
    turns = np.floor((along.max() + 1.5 * step) / _TURN)
    kept: NDArray[np.bool_] = (along > -0.5 * step) & (along < _TURN * max(1.0, turns) - 0.5 * step)
    return kept


def average_laps(angle_deg: Array, reading_um: Array) -> tuple[Array, Array]:
    """The mean of the whole laps at the angles of the first, later ones interpolated; readings beyond the last are left out."""
    once = np.concatenate([[True], np.diff(angle_deg) != 0.0])
    angle_deg, reading_um = angle_deg[once], reading_um[once]
    steps = np.diff(angle_deg)
    got = "angles must run in one direction for laps to be averaged, got changes of direction"
    require(np.all(steps > 0.0) or np.all(steps < 0.0), f"{got}. Keep the laps (--laps keep).")
    along = np.abs(angle_deg - angle_deg[0])
    step = float(np.median(np.abs(steps)))
    whole = int((along[-1] + 1.01 * step) // _TURN)
    got = f"a recording must hold two whole laps to be averaged, got {along[-1] / _TURN:.2f}"
    require(whole >= 2, f"{got}. Keep the laps (--laps keep).")
    first = along < _TURN - 1e-6 * step
    laps = [np.interp(along[first] + lap * _TURN, along, reading_um) for lap in range(whole)]
    return angle_deg[first], np.mean(laps, axis=0)


def direction_run(angle_deg: Array) -> str | None:
    """CW or CCW, as the angles run; None for less than half a turn. There and back is refused: two tests."""
    way = angle_deg - angle_deg[0]
    far = float(way[np.argmax(np.abs(way))])
    if abs(far) > 0.5 * _TURN and abs(far - way[-1]) > 0.5 * _TURN:
        raise InputError(
            f"angles must run one way in a test, got {way[-1] - far:+.0f}° after {far:+.0f}°. "
            "Name the test of each row in a column (--test-column), or split the file."
        )
    return None if abs(far) <= 0.5 * _TURN else "CCW" if far > 0.0 else "CW"
