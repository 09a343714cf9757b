"""Circularity computed from the readings, including the errors of balls, bar and mount.

All quantities are computed from the readings without a model of the machine. They therefore do not
describe the path of the machine alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from ldbb_bayes.analysis.circle_columns import COS2, SIN2, second_order_factors
from ldbb_bayes.analysis.circularity import BIDIRECTIONAL, MINIMUM_ZONES, QUANTITIES
from ldbb_bayes.analysis.radial_zones import least_squares_zone, minimum_zone_width
from ldbb_bayes.campaign.campaign import Campaign, CircularTest
from ldbb_bayes.errors import require
from ldbb_bayes.inference.posterior import bound_of
from ldbb_bayes.model.fourier import SIZE, basis
from ldbb_bayes.model.hybrid import BoundModel, HybridModel
from ldbb_bayes.results import Array, readable

__all__ = ["FULL_CIRCLE_DEG", "measure_circularity"]

# Smallest arc [°] of a test that counts as a full circle. Squareness, scale mismatch and the mean
# deviation D are computed from full circles only. G and the radial deviations of an arc are those
# of the arc, and are mostly smaller than those of the whole circle.
FULL_CIRCLE_DEG = 350.0


def measure_circularity(posterior: xr.DataTree | Campaign) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return the circular-test quantities of ISO 230-4, computed directly from the readings.

    No model is fitted, so that the quantities include the errors of the instrument.

    Parameters
    ----------
    posterior : DataTree or Campaign
        Campaign with readings, or posterior. If a posterior is given, only its campaign is used.

    Returns
    -------
    tests : DataFrame
        One row per test. The columns force_N, direction, plane, radius_mm and arc_deg describe the
        test. G is the circular deviation, and F_max and F_min are the largest and the smallest
        deviation from the least-squares circle [µm]. G_minimum_zone is the circular deviation about
        the centre of the minimum zone [µm]. F_max_nominal and F_min_nominal are the largest and the
        smallest deviation from a circle with the least-squares centre and the nominal radius [µm].
        The columns squareness and scale_mismatch [µm/m] are NaN for an arc of less than 350° and
        for a test of at most 25 readings. They are also NaN if the readings are at too few
        different angles to tell the Fourier orders apart.
    pairs : DataFrame
        One row per pair of a clockwise and a counterclockwise test of the same circle. The columns
        force_N and plane describe the pair. G_b is the bidirectional deviation about the
        least-squares centre [µm], and G_b_minimum_zone the bidirectional deviation about the centre
        of the minimum zone [µm]. D is the mean radial deviation from the nominal radius [µm]; it is
        NaN if one of the two tests is an arc of less than 350°.

    Raises
    ------
    InputError
        For a plan (a campaign without readings), or a posterior from `to_units`.

    Examples
    --------
    >>> tests, pairs = lb.analysis.measure_circularity(campaign)
    >>> tests["F_max"].round(1).to_list()  # µm
    [6.5, 6.3, 7.2, 8.1, 9.3, 10.3]
    >>> len(pairs)  # all circles were run clockwise
    0
    """
    if isinstance(posterior, Campaign):
        require(
            not posterior.is_plan,
            "a campaign must have readings to be measured, got a plan. Run the tests, or simulate"
            " it.",
        )
        bound = HybridModel.first(0).bind(posterior)
    else:
        bound = bound_of(posterior)
    tests = {test.name: _measure_test(bound, test) for test in bound.campaign.tests}
    pairs = {}
    for pair in _opposite_pairs(bound.campaign.tests):
        name = f"{pair.clockwise.name} + {pair.counterclockwise.name}"
        pairs[name] = _measure_pair(pair)
    columns = ["force_N", "plane", *BIDIRECTIONAL, "G_b_minimum_zone"]
    units = QUANTITIES | BIDIRECTIONAL | MINIMUM_ZONES
    test_table = pd.DataFrame.from_dict(tests, orient="index")
    pair_table = pd.DataFrame.from_dict(pairs, orient="index", columns=columns)
    return (
        readable(test_table, "The readings as they are", units),
        readable(pair_table, "Both directions", units),
    )


class _Pair(NamedTuple):
    """A clockwise and a counterclockwise test of the same circle.

    Both tests have the same force and set-up, and the same angles of the balls in their sockets.
    """

    clockwise: CircularTest
    counterclockwise: CircularTest


def _measure_pair(pair: _Pair) -> dict[str, Any]:
    """Return the table row of two tests of the same circle, run in opposite directions.

    The row states the force [N], the plane and three quantities [µm]. ``G_b`` and
    ``G_b_minimum_zone`` are bidirectional deviations: the width of a zone between concentric
    circles that contains the traces of both tests. For ``G_b``, the circles have the least-squares
    centre. For ``G_b_minimum_zone``, they have the centre for which the zone is narrowest. ``D`` is
    the mean radial deviation of the two tests from the nominal radius. It is NaN for an arc, on
    which the mean deviation and the centre are confounded with the form of the path.
    """
    clockwise_angle, clockwise_reading = _trace(pair.clockwise)
    counter_angle, counter_reading = _trace(pair.counterclockwise)
    angle = np.concatenate([clockwise_angle, counter_angle])
    reading = np.concatenate([clockwise_reading, counter_reading])
    means = [
        least_squares_zone(clockwise_angle, clockwise_reading).mean,
        least_squares_zone(counter_angle, counter_reading).mean,
    ]
    mean_deviation = np.nan
    if min(pair.clockwise.arc_deg, pair.counterclockwise.arc_deg) >= FULL_CIRCLE_DEG:
        mean_deviation = float(np.mean(means))
    return {
        "force_N": pair.clockwise.force_N,
        "plane": pair.clockwise.plane,
        "G_b": least_squares_zone(angle, reading).width,
        "G_b_minimum_zone": minimum_zone_width(angle, reading),
        "D": mean_deviation,
    }


def _measure_test(bound: BoundModel, test: CircularTest) -> dict[str, Any]:
    """Return the table row of one test; the keys are names of columns.

    The row holds the conditions of the test, and the following quantities computed from the
    readings:

    - G, F_max and F_min, the deviations from the least-squares circle [µm];
    - G about the centre of the minimum zone [µm];
    - the largest and the smallest deviation from a circle with the least-squares centre and the
      nominal radius [µm];
    - squareness and scale mismatch [µm/m], which are NaN for an arc, and for a circle with too few
      different angles to tell the Fourier orders apart.
    """
    angle, reading = _trace(test)
    zone = least_squares_zone(angle, reading)
    squareness = np.nan
    scale_mismatch = np.nan
    if test.arc_deg >= FULL_CIRCLE_DEG and len(angle) > SIZE:
        coefficients, _, rank, _ = np.linalg.lstsq(basis(angle), reading, rcond=None)
        if rank == SIZE:
            factors = second_order_factors(bound, bound.test_names.index(test.name))
            squareness = coefficients[SIN2] * factors.squareness
            scale_mismatch = coefficients[COS2] * factors.scale_mismatch
    return {
        "force_N": test.force_N,
        "direction": test.direction,
        "plane": test.plane,
        "radius_mm": float(test.circle.radius_mm),
        "arc_deg": test.arc_deg,
        "G": zone.width,
        "F_max": zone.upper - zone.mean,
        "F_min": zone.lower - zone.mean,
        "G_minimum_zone": minimum_zone_width(angle, reading),
        "squareness": squareness,
        "scale_mismatch": scale_mismatch,
        "F_max_nominal": zone.upper,
        "F_min_nominal": zone.lower,
    }


def _trace(test: CircularTest) -> Array:
    """Return the angles [rad] of the n readings of a test, and the readings [µm], shape (2, n)."""
    return np.array([test.angles_rad(), test.reading_um], dtype=float)


def _opposite_pairs(tests: Sequence[CircularTest]) -> list[_Pair]:
    """Return all pairs of tests that differ only in direction, clockwise and counterclockwise."""
    pairs = []
    for clockwise in tests:
        if clockwise.direction != "CW":
            continue
        for counterclockwise in tests:
            if counterclockwise.direction == "CCW" and _same_place(clockwise, counterclockwise):
                pairs.append(_Pair(clockwise, counterclockwise))
    return pairs


def _same_place(test: CircularTest, other: CircularTest) -> bool:
    """Return whether two tests have the same circle, force, set-up and angles of both balls."""
    return (
        test.circle == other.circle
        and test.force_N == other.force_N
        and test.setup == other.setup
        and test.work_ball_deg == other.work_ball_deg
        and test.tool_ball_deg == other.tool_ball_deg
    )
