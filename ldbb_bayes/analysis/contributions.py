"""What geometry and compliance each contribute to the reading at a force (the paper's Figs. 8-10), with credible intervals.

A compliance contributes with its slope: C(F) F. Offsets of the tool ball are the set-up's: listed, but not counted as geometry.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from ldbb_bayes.analysis.circularity import elastic_columns, first_circle, geometric_columns, offsets
from ldbb_bayes.inference.origin import bound_of, draws_of
from ldbb_bayes.inference.summary import check_probability
from ldbb_bayes.model.basis import basis
from ldbb_bayes.model.bound import BoundModel
from ldbb_bayes.threads import one_blas_thread

__all__ = ["COMPLIANCE", "GEOMETRY", "TOGETHER", "contribution_paths", "contributions"]

Array = NDArray[Any]
_ANGLE = np.arange(360) * (np.pi / 180.0)
_DRAWS = 2000
TOGETHER, COMPLIANCE, GEOMETRY = "compliance and geometry", "compliance", "geometry"


@one_blas_thread
def contributions(posterior: xr.DataTree, force_N: float | None = None, *, ci_prob: float = 0.95) -> pd.DataFrame:
    """Largest, smallest and peak-to-peak contribution to the reading of one circle [µm].

    Parameters
    ----------
    force_N : float, optional
        Default: the highest tested.
    ci_prob : float

    Returns
    -------
    DataFrame
        One row per plane and source: the two together, compliance, geometry, every compliance (its slope included) and every
        geometric error; radius_mm, force_N; maximum, minimum and peak_to_peak of the mean path; median, sd, ci_low and ci_high of
        the peak-to-peak. Where a source is hardly known its median exceeds the peak-to-peak of its mean, which may be zero.
    """
    check_probability(ci_prob)
    bound = bound_of(posterior)
    beta, _ = draws_of(posterior, bound, _DRAWS)
    force = float(bound.setting.force_N.max()) if force_N is None else float(force_N)
    tail = 0.5 - 0.5 * ci_prob
    rows = []
    for plane in bound.setting.planes:
        r = first_circle(bound, plane)
        for source, path in contribution_paths(bound, r, force, beta).items():
            mean = path.mean(axis=0)
            size = np.ptp(path, axis=1)
            low, median, high = np.quantile(size, [tail, 0.5, 1.0 - tail])
            rows.append(
                {
                    "plane": plane,
                    "radius_mm": float(bound.setting.radius_mm[r]),
                    "force_N": force,
                    "source": source,
                    "maximum": float(mean.max()),
                    "minimum": float(mean.min()),
                    "peak_to_peak": float(np.ptp(mean)),
                    "median": float(median),
                    "sd": float(size.std()),
                    "ci_low": float(low),
                    "ci_high": float(high),
                }
            )
    return pd.DataFrame(rows)


def contribution_paths(bound: BoundModel, r: int, force_N: float, beta: Array) -> Mapping[str, Array]:
    """Contributions on the circle of test r at 0°, 1° … 359°, each (draws, 360) [µm], keyed as in `contributions`."""
    turn = basis(_ANGLE).T * 1e3
    elastic, geometric = elastic_columns(bound, r, force_N), geometric_columns(bound, r)
    machine = np.where(offsets(bound), 0.0, geometric)
    found = {
        TOGETHER: beta @ (elastic + machine).T @ turn,
        COMPLIANCE: beta @ elastic.T @ turn,
        GEOMETRY: beta @ machine.T @ turn,
    }
    for name in (compliance.label for compliance in bound.compliances):
        own = np.array([p.group != "geometric" and p.compliance == name for p in bound.parameters])
        found[name] = beta[:, own] @ elastic[:, own].T @ turn
    for j, parameter in enumerate(bound.parameters):
        if parameter.group == "geometric":
            found[parameter.name] = np.outer(beta[:, j], geometric[:, j]) @ turn
    return {name: path for name, path in found.items() if path.any()}
