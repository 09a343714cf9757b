"""Angles of a log over time, and means of laps, by hand-worked examples."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from ldbb_bayes.errors import InputError
from ldbb_bayes.reading.laps import (
    angles_from_time,
    average_laps,
    direction_of_travel,
    is_in_random_order,
    on_the_circle,
)


def test_log_over_time() -> None:
    """At 2000 mm/min on 150 mm a turn takes 28.274 s; the run-in of 45° takes an eighth of that."""
    turn = 2.0 * np.pi * 150.0 / (2000.0 / 60.0)
    assert turn == pytest.approx(28.2743, abs=1e-4)
    time = np.arange(0.0, 1.25 * turn, 0.01)
    angle = angles_from_time(
        time, feed_mm_per_min=2000.0, radius_mm=150.0, start_deg=90.0, overshoot_deg=45.0, sense=-1
    )
    assert angle[0] == pytest.approx(135.0)
    assert angle[int(np.searchsorted(time, turn / 8.0 + turn / 4.0))] == pytest.approx(
        0.0, abs=0.13
    )
    on_circle = on_the_circle(angle, start_deg=90.0, sense=-1)
    assert angle[on_circle].max() <= 90.0 + 0.07
    assert np.ptp(angle[on_circle]) == pytest.approx(360.0, abs=0.26)


def test_laps_are_averaged_at_the_angles_of_the_first() -> None:
    """The second lap lies between the angles of the first."""
    first = np.arange(0.0, 360.0, 5.0)
    second = np.arange(362.0, 722.0, 5.0)
    angle, mean = average_laps(np.concatenate([first, second]), np.repeat([1.0, 2.0], 72))
    np.testing.assert_array_equal(angle, first)
    np.testing.assert_allclose(mean[1:], 1.5)


def run_through(*turning_points_deg: float) -> np.ndarray:
    """Return angles that run from each turning point to the next in steps of about 5° [deg]."""
    runs = [np.array(turning_points_deg[:1])]
    for start, end in pairwise(turning_points_deg):
        steps = round(abs(end - start) / 5.0)
        runs.append(np.linspace(start, end, steps + 1)[1:])
    return np.concatenate(runs)


@pytest.mark.parametrize(
    ("turning_points", "runs"),
    [
        ((0.0, 360.0, 0.0), r"\+360° and -360°"),
        ((0.0, 360.0, 0.0, 360.0), r"\+360° and -360°"),
        ((0.0, 360.0, -720.0), r"\+360° and -1080°"),
        ((0.0, 180.0, 0.0), r"\+180° and -180°"),
        ((0.0, 400.0, 225.0), r"\+400° and -175°"),
    ],
)
def test_angles_that_run_forth_and_back_are_refused(
    turning_points: tuple[float, ...], runs: str
) -> None:
    with pytest.raises(InputError, match=f"one way in a test, got runs of {runs}"):
        direction_of_travel(run_through(*turning_points))


@pytest.mark.parametrize(
    ("turning_points", "direction"),
    [
        ((0.0, 720.0), "CCW"),
        ((0.0, -360.0), "CW"),
        ((0.0, 100.0), None),
        ((0.0, -5.0, 365.0, 360.0), "CCW"),
        ((45.0, 50.0, 30.0, -400.0, -360.0), "CW"),
    ],
)
def test_direction_of_travel_allows_for_overshoot(
    turning_points: tuple[float, ...], direction: str | None
) -> None:
    assert direction_of_travel(run_through(*turning_points)) == direction


def test_angles_that_fill_a_turn_in_any_order_are_recognised() -> None:
    shuffled = np.random.default_rng(1).permutation(np.arange(-180.0, 180.0, 5.0))
    assert is_in_random_order(shuffled)
    assert not is_in_random_order(shuffled[:50] / 2.0)
    assert not is_in_random_order(np.append(shuffled, shuffled[0]))


@pytest.mark.parametrize("turning_points", [(0.0, 355.0), (0.0, 355.0, 1.0), (0.0, 1081.0)])
def test_angles_along_the_circle_are_not_in_random_order(
    turning_points: tuple[float, ...],
) -> None:
    assert not is_in_random_order(run_through(*turning_points))
