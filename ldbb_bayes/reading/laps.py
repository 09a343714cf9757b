"""Functions that compute angles from times, average laps, and find the order of angles.

A lap is one turn of the bar. The readings of one test in a file may cover several laps.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.errors import InputError, require
from ldbb_bayes.results import Array

__all__ = [
    "TURN_DEG",
    "angles_from_time",
    "average_laps",
    "direction_of_travel",
    "is_in_random_order",
    "on_the_circle",
]

TURN_DEG = 360.0
# Within one test, the bar may turn back, against the direction of travel, by at most this angle
# [deg]. Overshoot and scatter of the angles are much smaller. If the bar turned back by more, it
# was driven over the circle in both directions, and the readings belong to two tests.
_LARGEST_RETREAT_DEG = 120.0
# Neighbouring angles of a turn that is filled differ by at most this angle [deg]. Angles are listed
# in random order only if the bar usually turns by more than this angle from one row to the next.
_WIDEST_GAP_DEG = 30.0
# Angles are listed in random order only if the bar turns back after more than this share of the
# rows. If the order were random, it would be about one half.
_TO_AND_FRO = 0.25


def angles_from_time(
    time_s: Array,
    *,
    feed_mm_per_min: float,
    radius_mm: float,
    start_deg: float,
    overshoot_deg: float,
    sense: int,
) -> Array:
    """Return the angle of every reading, computed from the times of the readings.

    The function is used for a test whose table has times instead of angles. The machine is assumed
    to move along the circle of radius R at the constant feed F. It accelerates only in the run-in
    before the circle, and decelerates only in the run-out after the circle. The angle at time t is
    then θ(t) = start + sense · (F (t − t0) / R − overshoot). Here, t0 is the time of the first
    reading. The angles continue beyond 360°.

    Parameters
    ----------
    time_s
        Time of every reading, shape (n,) [s].
    feed_mm_per_min
        Feed F along the circle [mm/min].
    radius_mm
        Radius R of the circle [mm].
    start_deg
        Angle at which the circle begins [deg].
    overshoot_deg
        Angle of the run-in before the circle begins [deg].
    sense
        Direction of travel: 1 counter-clockwise, −1 clockwise.

    Returns
    -------
    Angles, shape (n,) [deg].

    Raises
    ------
    InputError
        If the readings cover less than the overshoot plus half a turn.
    """
    degrees_per_second = np.rad2deg(feed_mm_per_min / 60.0 / radius_mm)
    travelled = degrees_per_second * (time_s - time_s[0])
    require(
        travelled[-1] >= overshoot_deg + 0.5 * TURN_DEG,
        f"a log must cover the overshoot and half a turn, got {travelled[-1]:.1f}° at"
        f" {feed_mm_per_min:g} mm/min on {radius_mm:g} mm. Check feed, radius and the unit of"
        " time.",
    )
    return start_deg + sense * (travelled - overshoot_deg)


def on_the_circle(angle_deg: Array, *, start_deg: float, sense: int) -> NDArray[np.bool_]:
    """Return, for each reading of a test, whether it was recorded on the circle.

    All other readings belong to the run-in before the circle, where the machine accelerates, or to
    the run-out after it, where the machine decelerates. The circle begins at ``start_deg`` and
    covers whole turns; the last reading of a turn may be missing. If the readings end before one
    turn is complete, all readings after the start are on the circle.

    Parameters
    ----------
    angle_deg
        Angles [deg], shape (n,), that only increase or only decrease: 360° may be followed by 361°,
        but not by 1°.
    start_deg
        Angle at which the circle begins [deg].
    sense
        Direction of travel: 1 for counter-clockwise, −1 for clockwise.

    Returns
    -------
    True for readings on the circle, shape (n,).
    """
    travelled = sense * (angle_deg - start_deg)
    step = float(np.median(np.diff(travelled)))
    # Usually, the last reading of a turn of the bar is one step before the end of the turn, because
    # a reading at the end would only repeat the first angle. One step is therefore added to the
    # travelled angle, so that such a turn counts as whole. Another half step is added, because the
    # steps may differ a little.
    n_turns = max(1.0, np.floor((travelled.max() + 1.5 * step) / TURN_DEG))
    is_after_start = travelled > -0.5 * step
    is_before_end = travelled < TURN_DEG * n_turns - 0.5 * step
    on_circle: NDArray[np.bool_] = is_after_start & is_before_end
    return on_circle


def average_laps(angle_deg: Array, reading_um: Array) -> tuple[Array, Array]:
    """Return the readings of a test averaged over whole laps, and the angles of the first lap.

    A lap is one turn of the bar. Readings of later laps are interpolated at the angles of the first
    lap. Readings after the last whole lap are left out. Of successive readings at the same angle,
    only the first is used.

    Parameters
    ----------
    angle_deg, reading_um
        Angles [deg] and readings [µm] of two laps or more, shape (n,) each.

    Returns
    -------
    Angles [deg] and mean readings [µm] of one lap, shape (m,) each.

    Raises
    ------
    InputError
        If the angles neither increase throughout nor decrease throughout, apart from equal
        successive angles, or if they cover fewer than two whole laps.
    """
    is_new_angle = np.concatenate([[True], np.diff(angle_deg) != 0.0])
    angle_deg = angle_deg[is_new_angle]
    reading_um = reading_um[is_new_angle]
    steps = np.diff(angle_deg)
    require(
        np.all(steps > 0.0) or np.all(steps < 0.0),
        "angles must run in one direction for laps to be averaged, got changes of direction. Keep"
        " the laps (--laps keep).",
    )
    travelled = np.abs(angle_deg - angle_deg[0])
    step = float(np.median(np.abs(steps)))
    # The readings of n laps usually cover n turns less one step, because the last reading of a lap
    # is one step before the angle at which the lap began. One step is therefore added before the
    # laps are counted. The factor 1.01 makes this step a little longer, so that no lap is lost to
    # rounding.
    n_laps = int((travelled[-1] + 1.01 * step) // TURN_DEG)
    require(
        n_laps >= 2,
        "a recording must hold two whole laps to be averaged, got"
        f" {travelled[-1] / TURN_DEG:.2f}. Keep the laps (--laps keep).",
    )
    in_first_lap = travelled < TURN_DEG - 1e-6 * step
    first_lap = travelled[in_first_lap]
    laps = [np.interp(first_lap + lap * TURN_DEG, travelled, reading_um) for lap in range(n_laps)]
    return angle_deg[in_first_lap], np.mean(laps, axis=0)


def is_in_random_order(angle_deg: Array) -> bool:
    """Return whether the angles of a test fill one turn, each once, but are listed in any order.

    A coordinate measuring machine, for example, may measure points in any order. The bar is then
    moved to and fro, usually by a large part of a turn, from one point to the next. ``angle_deg``
    are the angles as listed, shape (n,) [deg].
    """
    positions = np.sort(np.mod(angle_deg, TURN_DEG))
    gaps = np.diff(positions, append=positions[0] + TURN_DEG)
    is_filled_once = np.min(gaps) > 0.0 and np.max(gaps) <= _WIDEST_GAP_DEG
    steps = np.diff(np.unwrap(angle_deg, period=TURN_DEG))
    if not is_filled_once or len(steps) < 2:
        return False
    share_of_turns = float(np.mean(steps[1:] * steps[:-1] < 0.0))
    return float(np.median(np.abs(steps))) > _WIDEST_GAP_DEG and share_of_turns > _TO_AND_FRO


def direction_of_travel(angle_deg: Array) -> str | None:
    """Return the direction of travel of a test, CW or CCW, from the order of its angles.

    Return None if the angles cover half a turn or less.

    Parameters
    ----------
    angle_deg
        Angles, which continue beyond 360°, shape (n,) [deg].

    Raises
    ------
    InputError
        If the bar turns by more than 120° clockwise and also by more than 120° counter-clockwise.
        The readings then belong to two tests.
    """
    largest_rise = float(np.max(angle_deg - np.minimum.accumulate(angle_deg)))
    largest_fall = float(np.max(np.maximum.accumulate(angle_deg) - angle_deg))
    if min(largest_rise, largest_fall) > _LARGEST_RETREAT_DEG:
        raise InputError(
            f"angles must run one way in a test, got runs of {largest_rise:+.0f}° and"
            f" {-largest_fall:+.0f}°. Name the test of each row in a column (--test-column), or"
            " split the file."
        )
    if max(largest_rise, largest_fall) <= 0.5 * TURN_DEG:
        return None
    return "CCW" if largest_rise > largest_fall else "CW"
