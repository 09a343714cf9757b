"""Circularity of the readings as they are, balls, bar and mount included."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from ldbb_bayes.analysis.circularity import (
    _CLOSED_DEG,
    _COS2,
    _SIN2,
    BIDIRECTIONAL,
    MINIMUM_ZONES,
    QUANTITIES,
    _per_second_order,
)
from ldbb_bayes.analysis.radial_zones import least_squares_zone, minimum_zone_width
from ldbb_bayes.campaign.campaign import Campaign, CircularTest
from ldbb_bayes.inference.posterior import bound_of
from ldbb_bayes.model.fourier import SIZE, basis
from ldbb_bayes.model.hybrid import BoundModel, HybridModel
from ldbb_bayes.results import Array, readable

__all__ = ["measured_circularity"]


def measured_circularity(posterior: xr.DataTree | Campaign) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The same of the readings as they are, balls, bar and mount included.

    Parameters
    ----------
    posterior : or the campaign: nothing of a fit enters.

    Returns
    -------
    tests : DataFrame
        One row per test: force_N, direction, plane, radius_mm, arc_deg; G, G_minimum_zone, F_max,
        F_min (about the least-squares centre) [µm]; squareness and scale_mismatch [µm/m], not a
        number for less than a full circle.
    pairs : DataFrame
        One row per clockwise and counterclockwise test of the same circle: G_b, G_b_minimum_zone, D
        [µm].
    """
    bound = (
        HybridModel.first(0).bind(posterior)
        if isinstance(posterior, Campaign)
        else bound_of(posterior)
    )
    tests = {test.name: _measured(bound, test) for test in bound.campaign.tests}
    pairs = {}
    for one, other in _pairs(bound.campaign.tests):
        traces = _trace(one), _trace(other)
        both = np.concatenate(traces, axis=1)
        pairs[f"{one.name} + {other.name}"] = {
            "force_N": one.force_N,
            "plane": one.plane,
            "G_b": least_squares_zone(*both).width,
            "G_b_minimum_zone": minimum_zone_width(*both),
            "D": float(np.mean([least_squares_zone(*trace).mean for trace in traces])),
        }
    columns = ["force_N", "plane", *BIDIRECTIONAL, "G_b_minimum_zone"]
    units = QUANTITIES | BIDIRECTIONAL | MINIMUM_ZONES
    by_test = readable(
        pd.DataFrame.from_dict(tests, orient="index"), "The readings as they are", units
    )
    return by_test, readable(
        pd.DataFrame.from_dict(pairs, orient="index", columns=columns), "Both directions", units
    )


def _measured(bound: BoundModel, test: CircularTest) -> dict[str, Any]:
    angle, reading = _trace(test)
    zone = least_squares_zone(angle, reading)
    second = np.full(2, np.nan)
    if test.arc_deg >= _CLOSED_DEG and len(angle) > SIZE:
        second = np.linalg.lstsq(basis(angle), reading, rcond=None)[0][[_COS2, _SIN2]]
    mismatch, square = second * _per_second_order(bound, bound.test_names.index(test.name))
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
        "squareness": square,
        "scale_mismatch": mismatch,
    }


def _trace(test: CircularTest) -> Array:
    """Angles and readings, shape (2, n)."""
    return np.array([test.angles_rad(), test.reading_um], dtype=float)


def _pairs(tests: Sequence[CircularTest]) -> Iterator[tuple[CircularTest, CircularTest]]:
    """Clockwise and counterclockwise tests of the same circle, force, set-up and clocking."""

    def place(test: CircularTest) -> tuple[Any, ...]:
        return test.circle, test.force_N, test.setup, test.work_ball_deg, test.tool_ball_deg

    clockwise, other = ([test for test in tests if test.direction == way] for way in ("CW", "CCW"))
    return ((one, two) for one, two in product(clockwise, other) if place(one) == place(two))
