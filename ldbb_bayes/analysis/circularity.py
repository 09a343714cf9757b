"""Circular-test quantities in the sense of ISO 230-4, of the machine's own path and of the readings
as they are.

Radial deviations are small beside R: a shift of the centre by (a, b) takes a cos θ + b sin θ from
them (to e²/2R: 0.01 µm for a circle 50 µm off centre).
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from ldbb_bayes.campaign.campaign import Campaign, CircularTest, distinct_forces
from ldbb_bayes.errors import require
from ldbb_bayes.inference.coefficients import draw_shared, shared_columns, shared_terms
from ldbb_bayes.inference.posterior import bound_of, draws_of, model_draws_of
from ldbb_bayes.inference.summary import check_probability
from ldbb_bayes.model.fourier import SIZE, basis, harmonic_index
from ldbb_bayes.model.hybrid import BoundModel, HybridModel
from ldbb_bayes.model.setting import geometric_errors_of
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array, readable

__all__ = [
    "BIDIRECTIONAL",
    "COMPLIANCE",
    "DRAWS",
    "GEOMETRY",
    "MINIMUM_ZONES",
    "QUANTITIES",
    "TOGETHER",
    "Zone",
    "circularity",
    "contribution_paths",
    "contributions",
    "first_circle",
    "least_squares_zone",
    "measured_circularity",
    "minimum_zone_width",
    "offsets",
    "path_draws",
    "squareness_name",
]

_FEWEST = 3
_SIDES = ((-1.0, 0.0, 1.0), (1.0, 1.0, 0.0))


@dataclass(frozen=True)
class Zone:
    """A path about the centre of its least-squares circle: smallest and largest radial deviation
    from the nominal radius, and that of the least-squares circle, in the unit of the deviations."""

    lower: float
    upper: float
    mean: float

    @property
    def width(self) -> float:
        """Circular deviation G."""
        return self.upper - self.lower


def least_squares_zone(angle_rad: Array, deviation: Array) -> Zone:
    """The zone about the centre of the least-squares circle, of radial deviations at each angle,
    shape (n,), in any unit."""
    columns = _columns(angle_rad, deviation)
    mean, *centre = np.linalg.lstsq(columns, deviation, rcond=None)[0].tolist()
    rest = deviation - columns[:, 1:] @ centre
    return Zone(float(rest.min()), float(rest.max()), mean)


def minimum_zone_width(angle_rad: Array, deviation: Array) -> float:
    """Width of the zone about the centre that makes it narrowest: a linear programme, solved
    exactly."""
    from scipy.optimize import linprog

    columns = _columns(angle_rad, deviation)
    size = max(float(np.abs(deviation).max()), np.finfo(float).tiny)
    # Centre, lower, upper: lower ≤ ρ − a cos θ − b sin θ ≤ upper.
    sides = [
        sign * np.column_stack([columns[:, 1:], columns[:, :1] * low, columns[:, :1] * high])
        for sign, low, high in _SIDES
    ]
    limits = np.concatenate([-deviation, deviation]) / size
    solved = linprog(
        [0.0, 0.0, -1.0, 1.0], np.vstack(sides), limits, bounds=(None, None), method="highs"
    )
    require(
        solved.success,
        f"a minimum zone must exist, got none ({solved.message}). Check the readings.",
    )
    return float(np.ptp(deviation - columns[:, 1:] @ (np.asarray(solved.x)[:2] * size)))


def _columns(angle_rad: Array, deviation: Array) -> Array:
    require(
        len(deviation) >= _FEWEST and len(angle_rad) == len(deviation),
        f"a zone must have at least {_FEWEST} angles with a deviation each, got {len(deviation)}."
        " Give the trace.",
    )
    return np.column_stack([np.ones(len(angle_rad)), np.cos(angle_rad), np.sin(angle_rad)])


_ANGLE = np.arange(360) * (np.pi / 180.0)
_CLOSED_DEG = 350.0
_CENTRED = np.arange(SIZE) >= 3  # without radius and centre
_COS2, _SIN2 = harmonic_index(2)
QUANTITIES = {
    **dict.fromkeys(("G", "F_max", "F_min"), "µm"),
    **dict.fromkeys(("squareness", "scale_mismatch"), "µm/m"),
}
BIDIRECTIONAL = dict.fromkeys(("G_b", "D"), "µm")
MINIMUM_ZONES = dict.fromkeys(("G_minimum_zone", "G_b_minimum_zone"), "µm")


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


@one_blas_thread
def circularity(
    posterior: xr.DataTree,
    forces_N: Sequence[float] = (),
    *,
    ci_prob: float = 0.95,
    draws: int = 2000,
) -> pd.DataFrame:
    """The machine's own path at every force, with credible intervals.

    Parameters
    ----------
    forces_N : default: 0 (geometry alone) and the tested forces.
    ci_prob : float
    draws : of the posterior, evenly picked.

    Returns
    -------
    One row per plane, force and quantity: radius_mm, unit, mean, sd, median, ci_low, ci_high; on
    the first circle of the plane. G, F_max, F_min about the least-squares centre and radius;
    squareness (in the sense and sign of the plane's own parameter, E_C0YX in XY) and scale_mismatch
    (gain of the first axis less that of the second), as the second harmonic shows them, compliance
    included; where the plane is run both ways G_b and D, the mean radius less the nominal one (G
    and F are then of the mean path). A G is a largest difference: where the path is not known it is
    more often too large than too small.
    """
    check_probability(ci_prob)
    units = QUANTITIES | BIDIRECTIONAL
    rows = []
    for where, found in path_draws(posterior, forces_N, draws):
        rows += [
            {
                **where,
                "quantity": quantity,
                "unit": units[quantity],
                "mean": float(values.mean()),
                **_spread(values, ci_prob),
            }
            for quantity, values in found.items()
        ]
    return readable(pd.DataFrame(rows), f"The machine's own path, {100 * ci_prob:g} % intervals")


def path_draws(
    posterior: xr.DataTree, forces_N: Sequence[float] = (), draws: int = 2000
) -> Iterator[tuple[dict[str, Any], dict[str, Array]]]:
    """Plane, radius and force, and the draws of every quantity of `circularity` there, each
    (draws,)."""
    bound = bound_of(posterior)
    parts = model_draws_of(posterior, draws)
    each = [_travel_draws(*part) for part in parts] if bound.setting.both_ways else [{}]
    travel = {
        plane: [np.concatenate(own) for own in zip(*(one[plane] for one in each), strict=True)]
        for plane in each[0]
    }
    beta = np.where(offsets(bound), 0.0, np.concatenate([part.beta for part in parts]))
    forces = list(forces_N) or [0.0, *distinct_forces(bound.setting.force_N).tolist()]
    for plane in bound.setting.planes:
        r = first_circle(bound, plane)
        for force in map(float, forces):
            path = beta @ np.add(*_machine_columns(bound, r, force)).T * 1e3
            centred, (of_cos, of_sin) = np.where(_CENTRED, path, 0.0), _per_second_order(bound, r)
            trace = centred @ basis(_ANGLE).T
            found = {
                "G": np.ptp(trace, axis=1),
                "F_max": trace.max(axis=1),
                "F_min": trace.min(axis=1),
            }
            found |= {
                "squareness": path[:, _SIN2] * of_sin,
                "scale_mismatch": path[:, _COS2] * of_cos,
            }
            if plane in travel:
                constant, proportional = travel[plane]
                # The least-squares centre common to both paths, path ± half of their difference, is
                # that of their mean.
                half = (constant + force * proportional) * 1e3
                traces = np.concatenate(
                    [(centred + way * half) @ basis(_ANGLE).T for way in (1.0, -1.0)], axis=1
                )
                found |= {"G_b": np.ptp(traces, axis=1), "D": path[:, 0]}
            yield (
                {"plane": plane, "radius_mm": float(bound.setting.radius_mm[r]), "force_N": force},
                found,
            )


def _spread(values: Array, ci_prob: float) -> dict[str, float]:
    low, median, high = np.quantile(values, [0.5 - 0.5 * ci_prob, 0.5, 0.5 + 0.5 * ci_prob])
    return {
        "sd": float(values.std()),
        "median": float(median),
        "ci_low": float(low),
        "ci_high": float(high),
    }


def _travel_draws(bound: BoundModel, phi: Array, beta: Array) -> dict[str, tuple[Array, Array]]:
    """Draws of the hysteresis in every plane run both ways, constant [mm] and per newton [mm/N],
    each (draws, 25)."""
    names = [name for term in shared_terms(bound.nuisance_columns) for name in term.names]
    columns = shared_columns(bound)
    drawn = draw_shared(bound, phi, beta, np.random.default_rng(0))
    found = {}
    for plane in bound.setting.both_ways:
        r = next(
            r
            for r, own in enumerate(bound.setting.plane)
            if own == plane and bound.setting.travel[r] != 0.0
        )
        parts = []
        for stem, per in (
            (r"hysteresis_(?!force)", 1.0),
            ("hysteresis_force", bound.setting.force_N[r]),
        ):
            own = [j for j, name in enumerate(names) if re.match(stem, name)]
            parts.append(drawn[:, own] @ (columns[r][:, own].T * (bound.setting.travel[r] / per)))
        if any(part.any() for part in parts):
            found[plane] = (parts[0], parts[1])
    return found


def _per_second_order(bound: BoundModel, r: int) -> Array:
    """Scale mismatch per µm of cos 2θ, squareness per µm of sin 2θ, on the circle of a test, shape
    (2,) [µm/m per µm]."""
    radius_m = float(bound.setting.radius_mm[r]) * 1e-3
    return np.array(
        [2.0 / radius_m, 1e3 / float(bound.setting.geometric[r][_SIN2, _squareness(bound, r)])]
    )


def _squareness(bound: BoundModel, r: int) -> int:
    """Which geometric error is the squareness of the plane of test r."""
    every = enumerate(geometric_errors_of(bound.campaign))
    return next(
        j
        for j, own in every
        if own.kind == "squareness" and bound.setting.geometric[r][_SIN2, j] != 0.0
    )


def squareness_name(bound: BoundModel, plane: str) -> str:
    """The squareness error of a plane: E_C0YX."""
    return geometric_errors_of(bound.campaign)[_squareness(bound, first_circle(bound, plane))].label


def first_circle(bound: BoundModel, plane: str) -> int:
    """The first test of a plane."""
    return next(r for r, own in enumerate(bound.setting.plane) if own == plane)


def offsets(bound: BoundModel) -> Array:
    """Which parameters are offsets of the tool ball, shape (p,)."""
    return np.array([name.startswith("E_") and name[3] == "t" for name in bound.names])


def _machine_columns(bound: BoundModel, r: int, force_N: float) -> tuple[Array, Array]:
    """Columns of compliances and slopes at any force, and of geometric errors, on the circle of a
    test, each (25, p)."""
    geometric = np.array([p.group == "geometric" for p in bound.parameters])
    elastic = force_N * bound.setting.wrench[r] @ bound.compliance_at(force_N)
    return elastic, np.where(geometric, bound.interest[r], 0.0)


DRAWS = 2000
TOGETHER = "compliance and geometry"
COMPLIANCE = "compliance"
GEOMETRY = "geometry"


@one_blas_thread
def contributions(
    posterior: xr.DataTree, force_N: float | None = None, *, ci_prob: float = 0.95
) -> pd.DataFrame:
    """Largest, smallest and peak-to-peak contribution to the reading of one circle [µm].

    Parameters
    ----------
    force_N : default: the highest tested.
    ci_prob : float

    Returns
    -------
    One row per plane and source: the two together, compliance, geometry, every compliance (its
    slope included) and every geometric error; radius_mm, force_N; maximum, minimum and peak_to_peak
    of the mean path; median, sd, ci_low and ci_high of the peak-to-peak. Where a source is hardly
    known its median exceeds the peak-to-peak of its mean, which may be zero.
    """
    check_probability(ci_prob)
    bound = bound_of(posterior)
    beta, _ = draws_of(posterior, bound, DRAWS)
    force = float(bound.setting.force_N.max()) if force_N is None else float(force_N)
    rows = []
    for plane in bound.setting.planes:
        r = first_circle(bound, plane)
        where = {"plane": plane, "radius_mm": float(bound.setting.radius_mm[r]), "force_N": force}
        for source, path in contribution_paths(bound, r, force, beta).items():
            mean = path.mean(axis=0)
            ends = {"maximum": float(mean.max()), "minimum": float(mean.min())}
            rows.append(
                {**where, "source": source, **ends, **_spread(np.ptp(path, axis=1), ci_prob)}
            )
    columns = ["maximum", "minimum", "median", "sd", "ci_low", "ci_high"]
    found = pd.DataFrame(rows, columns=["plane", "radius_mm", "force_N", "source", *columns])
    units = dict.fromkeys(("maximum", "minimum", "peak_to_peak", "sd", "ci_low", "ci_high"), "µm")
    caption = f"Contributions to the reading, {100 * ci_prob:g} % intervals of the peak-to-peak"
    return readable(found.rename(columns={"median": "peak_to_peak"}), caption, units)


def contribution_paths(
    bound: BoundModel, r: int, force_N: float, beta: Array, only: Collection[str] = ()
) -> Mapping[str, Array]:
    """Contributions on the circle of test r at 0°, 1° … 359°, each (draws, 360) [µm], keyed as in
    `contributions`."""
    turn = basis(_ANGLE).T * 1e3
    elastic, geometric = _machine_columns(bound, r, force_N)
    machine = np.where(offsets(bound), 0.0, geometric)
    columns = {TOGETHER: elastic + machine, COMPLIANCE: elastic, GEOMETRY: machine}
    for compliance in bound.compliances:
        own = [
            p.group != "geometric" and p.compliance == compliance.label for p in bound.parameters
        ]
        columns[compliance.label] = np.where(own, elastic, 0.0)
    for j, parameter in enumerate(bound.parameters):
        if parameter.group == "geometric":
            columns[parameter.name] = np.where(np.arange(len(bound.names)) == j, geometric, 0.0)
    paths = {name: beta @ own.T @ turn for name, own in columns.items() if not only or name in only}
    return {name: path for name, path in paths.items() if path.any()}
