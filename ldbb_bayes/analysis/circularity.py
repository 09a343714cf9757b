"""The quantities of a circular test after ISO 230-4: of readings, and with credible intervals of the machine's path at any force.

Radial deviations are small beside R: a shift of the centre by (a, b) takes a cos θ + b sin θ from them (to ρ²/R, some 10⁻⁵ µm).
The machine's path is Jβ: geometry and compliance, without balls, bar, mount and what differs between circles.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray
from scipy.optimize import linprog

from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.origin import bound_of, draws_of
from ldbb_bayes.inference.summary import check_probability
from ldbb_bayes.model.basis import SIZE, basis
from ldbb_bayes.model.bound import BoundModel

__all__ = ["Zone", "circularity", "least_squares_zone", "measured_circularity", "minimum_zone"]

Array = NDArray[Any]
_ANGLE = np.arange(360) * (np.pi / 180.0)
_DRAWS, _EVERY = 200, 2
_FEWEST = 3


@dataclass(frozen=True)
class Zone:
    """Two concentric circles that enclose a path.

    Attributes
    ----------
    centre : (a, b)
        Shift of their centre from the nominal one, in the unit of the deviations.
    lower, upper : float
        Smallest and largest radial deviation from the nominal radius about that centre.
    """

    centre: tuple[float, float]
    lower: float
    upper: float

    @property
    def width(self) -> float:
        """Circular deviation G."""
        return self.upper - self.lower


def least_squares_zone(angle_rad: Array, deviation: Array) -> Zone:
    """About the centre of the least-squares circle.

    Parameters
    ----------
    angle_rad, deviation : ndarray, shape (n,)
        Radial deviation of the path from the nominal circle at each angle; any unit.
    """
    columns = _columns(angle_rad, deviation)
    _, a, b = np.linalg.lstsq(columns, deviation, rcond=None)[0]
    rest = deviation - columns[:, 1:] @ [a, b]
    return Zone((float(a), float(b)), float(rest.min()), float(rest.max()))


def minimum_zone(angle_rad: Array, deviation: Array) -> Zone:
    """About the centre that makes the zone narrowest: a linear programme, solved exactly."""
    columns = _columns(angle_rad, deviation)
    size = max(float(np.abs(deviation).max()), np.finfo(float).tiny)
    scaled, ones = deviation / size, np.ones(len(deviation))
    # a, b, lower, upper: lower ≤ ρ − a cos θ − b sin θ ≤ upper.
    above = np.column_stack([-columns[:, 1:], 0.0 * ones, -ones])
    below = np.column_stack([columns[:, 1:], ones, 0.0 * ones])
    solved = linprog(
        [0.0, 0.0, -1.0, 1.0], np.vstack([above, below]), np.concatenate([-scaled, scaled]), bounds=(None, None), method="highs"
    )
    if solved.x is None or not solved.success:
        raise InputError(f"a minimum zone must exist, got none ({solved.message}). Check the readings.")
    a, b = solved.x[:2] * size
    rest = deviation - columns[:, 1:] @ [a, b]
    return Zone((float(a), float(b)), float(rest.min()), float(rest.max()))


def _columns(angle_rad: Array, deviation: Array) -> Array:
    if len(deviation) < _FEWEST or len(angle_rad) != len(deviation):
        raise InputError(
            f"a zone must have at least {_FEWEST} angles with a deviation each, got {len(deviation)}. Give the trace."
        )
    return np.column_stack([np.ones(len(angle_rad)), np.cos(angle_rad), np.sin(angle_rad)])


def measured_circularity(posterior: xr.DataTree) -> pd.DataFrame:
    """G, F_max and F_min of every test's readings, balls, bar and mount included [µm].

    Returns
    -------
    DataFrame
        One row per test: force_N, direction, plane, G (least-squares centre), G_minimum_zone, F_max, F_min (nominal centre).
    """
    rows = {}
    for test in bound_of(posterior).campaign.tests:
        angle, reading = test.angles_rad(), np.asarray(test.reading_um)
        rows[test.name] = {
            "force_N": test.force_N,
            "direction": test.direction,
            "plane": test.plane,
            "G": least_squares_zone(angle, reading).width,
            "G_minimum_zone": minimum_zone(angle, reading).width,
            "F_max": float(reading.max()),
            "F_min": float(reading.min()),
        }
    return pd.DataFrame.from_dict(rows, orient="index")


def circularity(posterior: xr.DataTree, forces_N: Sequence[float] = (), *, ci_prob: float = 0.95) -> pd.DataFrame:
    """The machine's own path: G, F_max, F_min at every force with credible intervals [µm].

    Parameters
    ----------
    forces_N : sequence of float
        Default: 0 (geometry alone) and the tested forces.
    ci_prob : float

    Returns
    -------
    DataFrame
        One row per plane, force and quantity: mean, sd, median, ci_low, ci_high. G about the least-squares centre and about that
        of the minimum zone, F_max and F_min about the nominal one. A G is a largest difference: where the path is not known it is
        more often too large than too small.
    """
    check_probability(ci_prob)
    bound = bound_of(posterior)
    beta, _ = draws_of(posterior, bound, _DRAWS)
    forces = list(forces_N) or [0.0, *np.unique(bound.setting.force_N).tolist()]
    tail = 0.5 - 0.5 * ci_prob
    rows = []
    for plane in bound.setting.planes:
        for force in forces:
            traces = _paths_um(bound, plane, float(force), beta)
            zones = [least_squares_zone(_ANGLE, trace) for trace in traces]
            found = {
                "G": [zone.width for zone in zones],
                "G_minimum_zone": [minimum_zone(_ANGLE[::_EVERY], trace[::_EVERY]).width for trace in traces],
                "F_max": traces.max(axis=1),
                "F_min": traces.min(axis=1),
            }
            for quantity, values in found.items():
                low, median, high = np.quantile(values, [tail, 0.5, 1.0 - tail])
                rows.append(
                    {
                        "plane": plane,
                        "force_N": float(force),
                        "quantity": quantity,
                        "mean": float(np.mean(values)),
                        "sd": float(np.std(values)),
                        "median": float(median),
                        "ci_low": float(low),
                        "ci_high": float(high),
                    }
                )
    return pd.DataFrame(rows)


def _paths_um(bound: BoundModel, plane: str, force_N: float, beta: Array) -> Array:
    """Radial deviation of the machine's path at a force, on the first circle of a plane, shape (draws, 360) [µm]."""
    first = next(r for r, own in enumerate(bound.setting.plane) if own == plane)
    degrees: Array = np.array([p.degree for p in bound.parameters])
    elastic = np.array([p.group != "geometric" for p in bound.parameters])
    labels = [name.label for name in bound.compliances]
    columns = np.zeros((SIZE, len(bound.names)))
    lever = force_N - bound.setting.reference_force_N
    for j, parameter in enumerate(bound.parameters):
        if elastic[j]:
            columns[:, j] = force_N * lever ** degrees[j] * bound.setting.wrench[first][:, labels.index(parameter.compliance)]
        else:
            columns[:, j] = bound.interest[first][:, j]
    return np.asarray(beta @ (basis(_ANGLE) @ columns).T * 1e3)
