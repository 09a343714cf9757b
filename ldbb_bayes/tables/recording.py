"""From what an instrument records to one circle: angles from time, laps of a recording longer than a turn."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.errors import InputError

__all__ = ["angles_from_time", "average_laps", "check_zero", "direction_run", "laps_of", "on_the_circle", "unwrapped"]

Array = NDArray[np.float64]
_TURN = 360.0
_SMALLEST_RADIUS_MM = 20.0


def angles_from_time(
    time_s: Array, *, feed_mm_per_min: float, radius_mm: float, start_deg: float, overshoot_deg: float, sense: int
) -> Array:
    """Angle of every reading of a log over time, shape (n,) [deg], not modulo 360°.

    The axes run at constant feed along the circle: θ(t) = start + sense · (feed (t − t0) / R − overshoot), with t0 the first
    reading's time. Acceleration at the ends is inside the overshoot, or neglected.

    Parameters
    ----------
    sense : {1, -1}
        Counter-clockwise, clockwise.

    Raises
    ------
    InputError
        When time does not increase, or the log ends before it has covered the overshoot and half a turn.
    """
    if not np.all(np.diff(time_s) > 0.0):
        k = int(np.flatnonzero(np.diff(time_s) <= 0.0)[0]) + 1
        raise InputError(
            f"time must increase from reading to reading, got {time_s[k]:g} s after {time_s[k - 1]:g} s (reading {k + 1}). "
            "Sort or split the log."
        )
    travelled = np.rad2deg(feed_mm_per_min / 60.0 / radius_mm) * (time_s - time_s[0])
    if travelled[-1] < overshoot_deg + 0.5 * _TURN:
        raise InputError(
            f"a log must cover the overshoot and half a turn, got {travelled[-1]:.1f}° at {feed_mm_per_min:g} mm/min "
            f"on {radius_mm:g} mm. Check feed, radius and the unit of time."
        )
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


def unwrapped(angle_deg: Array) -> Array:
    """Angles that run on past 360° where the recording starts again at 0°."""
    return np.unwrap(angle_deg, period=_TURN)


def laps_of(angle_deg: Array) -> float:
    """Turns that a recording covers; one of a full circle whose last reading stands one step before the first."""
    steps = np.diff(angle_deg)
    return float(abs(angle_deg[-1] - angle_deg[0]) + np.median(np.abs(steps))) / _TURN


def average_laps(angle_deg: Array, reading_um: Array) -> tuple[Array, Array]:
    """The mean of the whole laps, at the angles of the first; readings beyond the last whole lap are left out.

    Readings of later laps are interpolated between their neighbours where their angles differ from those of the first.

    Raises
    ------
    InputError
        When the angles change direction, or there is no whole second lap.
    """
    once = np.concatenate([[True], np.diff(angle_deg) != 0.0])
    angle_deg, reading_um = angle_deg[once], reading_um[once]
    steps = np.diff(angle_deg)
    if not (np.all(steps > 0.0) or np.all(steps < 0.0)):
        raise InputError(
            "angles must run in one direction for laps to be averaged, got changes of direction. Keep the laps (--laps keep)."
        )
    along = np.abs(angle_deg - angle_deg[0])
    step = float(np.median(np.abs(steps)))
    whole = int((along[-1] + 1.01 * step) // _TURN)
    if whole < 2:
        raise InputError(
            f"a recording must hold two whole laps to be averaged, got {along[-1] / _TURN:.2f}. Keep the laps (--laps keep)."
        )
    first = along < _TURN - 1e-6 * step
    grid = along[first]
    laps = [np.interp(grid + lap * _TURN, along, reading_um) for lap in range(whole)]
    return angle_deg[first], np.mean(laps, axis=0)


def direction_run(angle_deg: Array) -> str | None:
    """CW or CCW, as the angles run; None for less than half a turn.

    Raises
    ------
    InputError
        For there and back: two tests.
    """
    way = angle_deg - angle_deg[0]
    far = float(way[np.argmax(np.abs(way))])
    if abs(far) > 0.5 * _TURN and abs(far - way[-1]) > 0.5 * _TURN:
        raise InputError(
            f"angles must run one way in a test, got {way[-1] - far:+.0f}° after {far:+.0f}°. "
            "Name the test of each row in a column (--test-column), or split the file."
        )
    return None if abs(far) <= 0.5 * _TURN else "CCW" if far > 0.0 else "CW"


def check_zero(reading_um: Array, *, radius_mm: float, zero: str | None, near: bool) -> None:
    """Distances of the balls on another radius are no deviations of this one; nor are deviations distances.

    Parameters
    ----------
    zero : {"distance", "deviation"}, optional
        As given.
    near : bool
        Whether the readings stand at the radius.

    Raises
    ------
    InputError
    """
    median_mm = float(np.median(reading_um)) * 1e-3
    scatter_mm = float(np.median(np.abs(reading_um - 1e3 * median_mm))) * 1e-3
    far = median_mm > _SMALLEST_RADIUS_MM and scatter_mm < 0.01 * median_mm
    if {"distance": not near, "deviation": far, None: far and not near}[zero]:
        given = f" as {zero} (--zero)" if zero else ""
        raise InputError(
            f"readings must be deviations from {radius_mm:g} mm, or distances near it, got {median_mm:.5g} mm{given}. "
            "Give --radius-mm, or --unit, or --zero."
        )
