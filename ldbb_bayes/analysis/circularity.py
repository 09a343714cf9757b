"""Circular-test quantities in the sense of ISO 230-4, of the machine's own path and of the readings
as they are.

Radial deviations are small beside R: a shift of the centre by (a, b) takes a cos θ + b sin θ from
them (to e²/2R: 0.01 µm for a circle 50 µm off centre).
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from ldbb_bayes.campaign.campaign import distinct_forces
from ldbb_bayes.inference.coefficients import draw_shared, shared_columns, shared_terms
from ldbb_bayes.inference.posterior import bound_of, model_draws_of
from ldbb_bayes.inference.summary import check_probability
from ldbb_bayes.model.fourier import SIZE, basis, harmonic_index
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.setting import geometric_errors_of
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array, readable

__all__ = [
    "BIDIRECTIONAL",
    "MINIMUM_ZONES",
    "QUANTITIES",
    "circularity",
    "first_circle",
    "offsets",
    "path_draws",
    "squareness_name",
]


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
