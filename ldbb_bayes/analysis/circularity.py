"""The quantities of a circular test after ISO 230-4: of readings, and with credible intervals of the machine's path at any force.

The machine's path is Jβ: geometry and compliance, without balls, bar, mount, what differs between circles, and the offsets of the
tool ball, which are the set-up's. Where a plane is run both ways, each way has its hysteresis too.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from ldbb_bayes.analysis.zones import Zone, least_squares_zone, minimum_zone, minimum_zone_widths
from ldbb_bayes.campaign.circular_test import CircularTest
from ldbb_bayes.inference.nuisances import draw_nuisances
from ldbb_bayes.inference.origin import bound_of, draws_of
from ldbb_bayes.inference.summary import check_probability
from ldbb_bayes.model.basis import SIZE, basis, harmonic_index
from ldbb_bayes.model.bound import BoundModel
from ldbb_bayes.model.setting import geometric_errors_of
from ldbb_bayes.threads import one_blas_thread

__all__ = [
    "BIDIRECTIONAL",
    "QUANTITIES",
    "circularity",
    "elastic_columns",
    "first_circle",
    "geometric_columns",
    "measured_circularity",
    "offsets",
    "squareness_name",
]

Array = NDArray[Any]
_ANGLE = np.arange(360) * (np.pi / 180.0)
_CLOSED_DEG = 350.0
# Minimum zones of two paths at once are a linear programme each.
_ZONES = 200
_COS2, _SIN2 = harmonic_index(2)
QUANTITIES = {
    "G": "µm",
    "G_minimum_zone": "µm",
    "F_max": "µm",
    "F_min": "µm",
    "squareness": "µm/m",
    "scale_mismatch": "µm/m",
}
BIDIRECTIONAL = {"G_b": "µm", "G_b_minimum_zone": "µm", "D": "µm"}


def measured_circularity(posterior: xr.DataTree) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The same of the readings as they are, balls, bar and mount included.

    Returns
    -------
    tests : DataFrame
        One row per test: force_N, direction, plane, radius_mm, arc_deg; G, G_minimum_zone, F_max, F_min (about the least-squares
        centre) [µm]; squareness and scale_mismatch [µm/m], not a number for less than a full circle.
    pairs : DataFrame
        One row per clockwise and counterclockwise test of the same circle: G_b, G_b_minimum_zone, D [µm].
    """
    bound = bound_of(posterior)
    tests = {test.name: _measured(bound, test) for test in bound.campaign.tests}
    pairs = {
        f"{one.name} + {other.name}": {"force_N": one.force_N, "plane": one.plane, **_both(_trace(one), _trace(other))}
        for one, other in _pairs(bound.campaign.tests)
    }
    columns = ["force_N", "plane", *BIDIRECTIONAL]
    return pd.DataFrame.from_dict(tests, orient="index"), pd.DataFrame.from_dict(pairs, orient="index", columns=columns)


def _measured(bound: BoundModel, test: CircularTest) -> dict[str, Any]:
    angle, reading = _trace(test)
    zone = least_squares_zone(angle, reading)
    second = np.full(2, np.nan)
    if test.arc_deg >= _CLOSED_DEG and len(angle) > SIZE:
        second = np.linalg.lstsq(basis(angle), reading, rcond=None)[0][[_COS2, _SIN2]]
    mismatch, square = second * _per_second_order(bound, test.name)
    return {
        "force_N": test.force_N,
        "direction": test.direction,
        "plane": test.plane,
        "radius_mm": float(test.circle.radius_mm),
        "arc_deg": test.arc_deg,
        **_zone_numbers(zone),
        "G_minimum_zone": minimum_zone(angle, reading).width,
        "squareness": square,
        "scale_mismatch": mismatch,
    }


def _trace(test: CircularTest) -> tuple[Array, Array]:
    return test.angles_rad(), np.asarray(test.reading_um, dtype=float)


def _zone_numbers(zone: Zone) -> dict[str, float]:
    return {"G": zone.width, "F_max": zone.upper - zone.mean, "F_min": zone.lower - zone.mean}


def _both(one: tuple[Array, Array], other: tuple[Array, Array]) -> dict[str, float]:
    """G(b) about the common centre of both paths, and D: the mean of their least-squares radii less the nominal one."""
    angle, deviation = np.concatenate([one[0], other[0]]), np.concatenate([one[1], other[1]])
    return {
        "G_b": least_squares_zone(angle, deviation).width,
        "G_b_minimum_zone": minimum_zone(angle, deviation).width,
        "D": 0.5 * (least_squares_zone(*one).mean + least_squares_zone(*other).mean),
    }


def _pairs(tests: Sequence[CircularTest]) -> Iterator[tuple[CircularTest, CircularTest]]:
    """Clockwise and counterclockwise tests of the same circle, force, set-up and clocking."""

    def place(test: CircularTest) -> tuple[Any, ...]:
        return test.circle, test.force_N, test.setup, test.work_ball_deg, test.tool_ball_deg

    clockwise, other = ([test for test in tests if test.direction == way] for way in ("CW", "CCW"))
    return ((one, two) for one, two in product(clockwise, other) if place(one) == place(two))


@one_blas_thread
def circularity(
    posterior: xr.DataTree, forces_N: Sequence[float] = (), *, ci_prob: float = 0.95, draws: int = 2000, both_ways: bool = True
) -> pd.DataFrame:
    """The machine's own path at every force, with credible intervals.

    Parameters
    ----------
    forces_N : sequence of float
        Default: 0 (geometry alone) and the tested forces.
    ci_prob : float
    draws : int
        Of the posterior, evenly picked (for G_b of the minimum zone 200 at most).
    both_ways : bool
        Whether G_b and D are wanted where a plane is run both ways.

    Returns
    -------
    DataFrame
        One row per plane, force and quantity: radius_mm, unit, mean, sd, median, ci_low, ci_high; on the first circle of the
        plane. G about the least-squares centre and that of the minimum zone; F_max, F_min about the least-squares centre and
        radius; squareness (in the sense and sign of the plane's own parameter, `squareness_name`) and scale_mismatch (gain of
        the first axis less that of the second), as the second harmonic shows them, compliance included; where the plane is run
        both ways G_b by either centre and D, the mean radius less the nominal one (G and F are then of the mean path). A G is a
        largest difference: where the path is not known it is more often too large than too small.
    """
    check_probability(ci_prob)
    bound = bound_of(posterior)
    beta, phi = draws_of(posterior, bound, draws)
    travel = _travel_draws(bound, beta, phi) if both_ways and bound.setting.both_ways else {}
    beta = np.where(offsets(bound), 0.0, beta)
    forces = list(forces_N) or [0.0, *np.unique(bound.setting.force_N).tolist()]
    tail = 0.5 - 0.5 * ci_prob
    rows = []
    for plane in bound.setting.planes:
        r = first_circle(bound, plane)
        for force in forces:
            path = beta @ (geometric_columns(bound, r) + elastic_columns(bound, r, float(force))).T * 1e3
            found = _of_paths(path, _per_second_order(bound, bound.test_names[r]))
            if plane in travel:
                constant, proportional = travel[plane]
                found |= _of_both_ways(path, (constant + force * proportional) * 1e3)
            for quantity, values in found.items():
                low, median, high = np.quantile(values, [tail, 0.5, 1.0 - tail])
                rows.append(
                    {
                        "plane": plane,
                        "radius_mm": float(bound.setting.radius_mm[r]),
                        "force_N": float(force),
                        "quantity": quantity,
                        "unit": (QUANTITIES | BIDIRECTIONAL)[quantity],
                        "mean": float(np.mean(values)),
                        "sd": float(np.std(values)),
                        "median": float(median),
                        "ci_low": float(low),
                        "ci_high": float(high),
                    }
                )
    return pd.DataFrame(rows)


def _of_paths(path: Array, per_second_order: Array) -> dict[str, Array]:
    """Of many paths, basis coefficients (draws, 25) [µm]."""
    centred = path.copy()
    centred[:, :3] = 0.0
    trace = centred @ basis(_ANGLE).T
    upper, lower = trace.max(axis=1), trace.min(axis=1)
    return {
        "G": upper - lower,
        "G_minimum_zone": minimum_zone_widths(_ANGLE, trace),
        "F_max": upper,
        "F_min": lower,
        "squareness": path[:, _SIN2] * per_second_order[1],
        "scale_mismatch": path[:, _COS2] * per_second_order[0],
    }


def _of_both_ways(path: Array, half: Array) -> dict[str, Array]:
    """Of two paths, path ± half of their difference; the least-squares centre common to both is that of their mean."""
    centred = path.copy()
    centred[:, :3] = 0.0
    traces = np.concatenate([(centred + half) @ basis(_ANGLE).T, (centred - half) @ basis(_ANGLE).T], axis=1)
    some = np.linspace(0, len(traces) - 1, min(len(traces), _ZONES)).astype(int)
    return {
        "G_b": np.ptp(traces, axis=1),
        "G_b_minimum_zone": np.array([minimum_zone(np.tile(_ANGLE[::4], 2), trace[::4]).width for trace in traces[some]]),
        "D": path[:, 0],
    }


def _travel_draws(bound: BoundModel, beta: Array, phi: Array) -> dict[str, tuple[Array, Array]]:
    """Draws of the hysteresis in every plane run both ways, constant [mm] and per newton [mm/N], each (draws, 25)."""
    drawn = draw_nuisances(bound, phi, beta, np.random.default_rng(0))
    found = {}
    for plane in bound.setting.both_ways:
        r = next(r for r, own in enumerate(bound.setting.plane) if own == plane and bound.setting.travel[r] != 0.0)
        parts = [np.zeros((len(beta), SIZE)), np.zeros((len(beta), SIZE))]
        for j, name in enumerate(drawn.names):
            if name.startswith("hysteresis"):
                share = drawn.values[r, :, j] * bound.setting.travel[r]
                per_force = name.startswith("hysteresis_force")
                parts[per_force] += np.outer(drawn.draws[:, j], share / (bound.setting.force_N[r] if per_force else 1.0))
        if parts[0].any() or parts[1].any():
            found[plane] = (parts[0], parts[1])
    return found


def _per_second_order(bound: BoundModel, name: str) -> Array:
    """Scale mismatch per µm of cos 2θ, squareness per µm of sin 2θ, on the circle of a test, shape (2,) [µm/m per µm]."""
    r = bound.test_names.index(name)
    radius_m = float(bound.setting.radius_mm[r]) * 1e-3
    return np.array([2.0 / radius_m, 1e3 / float(bound.setting.geometric[r][_SIN2, _squareness(bound, r)])])


def _squareness(bound: BoundModel, r: int) -> int:
    """Which geometric error is the squareness of the plane of test r."""
    every = enumerate(geometric_errors_of(bound.campaign))
    return next(j for j, own in every if own.kind == "squareness" and bound.setting.geometric[r][_SIN2, j] != 0.0)


def squareness_name(bound: BoundModel, plane: str) -> str:
    """The squareness error of a plane: E_C0YX."""
    return geometric_errors_of(bound.campaign)[_squareness(bound, first_circle(bound, plane))].label


def first_circle(bound: BoundModel, plane: str) -> int:
    """The first test of a plane."""
    return next(r for r, own in enumerate(bound.setting.plane) if own == plane)


def offsets(bound: BoundModel) -> Array:
    """Which parameters are offsets of the tool ball, shape (p,)."""
    return np.array([name.startswith("E_") and name[3] == "t" for name in bound.names])


def geometric_columns(bound: BoundModel, r: int) -> Array:
    """Columns of the geometric errors on the circle of a test, zero for compliances, shape (25, p)."""
    geometric = np.array([p.group == "geometric" for p in bound.parameters])
    return np.where(geometric, bound.interest[r], 0.0)


def elastic_columns(bound: BoundModel, r: int, force_N: float) -> Array:
    """Columns of the compliances and slopes at any force on the circle of a test, zero for geometric errors, shape (25, p)."""
    labels = [name.label for name in bound.compliances]
    columns = np.zeros((SIZE, len(bound.names)))
    lever = force_N - bound.setting.reference_force_N
    for j, parameter in enumerate(bound.parameters):
        if parameter.group != "geometric":
            columns[:, j] = force_N * lever**parameter.degree * bound.setting.wrench[r][:, labels.index(parameter.compliance)]
    return columns
