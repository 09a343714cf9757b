"""Contributions of compliances and geometric errors to the reading of one circle."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
import pandas as pd
import xarray as xr

from ldbb_bayes.analysis.circularity import _ANGLE, _machine_columns, _spread, first_circle, offsets
from ldbb_bayes.inference.posterior import bound_of, draws_of
from ldbb_bayes.inference.summary import check_probability
from ldbb_bayes.model.fourier import basis
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array, readable

__all__ = ["COMPLIANCE", "DRAWS", "GEOMETRY", "TOGETHER", "contribution_paths", "contributions"]


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
