"""Contributions of compliances and geometric errors to the readings of one circle."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
import pandas as pd
import xarray as xr

from ldbb_bayes.analysis.circle_columns import (
    ANGLE_RAD,
    MachineColumns,
    first_circle,
    is_tool_ball_offset,
    machine_columns,
    place_of_circle,
)
from ldbb_bayes.analysis.circularity import summarise_draws
from ldbb_bayes.analysis.extremes import extremes_of
from ldbb_bayes.campaign.circular_test import CENTRE
from ldbb_bayes.campaign.tested_forces import check_deflecting_force
from ldbb_bayes.deprecation import renamed_keyword
from ldbb_bayes.errors import check_probability, require
from ldbb_bayes.inference.coefficients import ModelDraws
from ldbb_bayes.inference.elastic_deflections import joint_load_circles
from ldbb_bayes.inference.posterior import bound_of, model_draws_of
from ldbb_bayes.model.fourier import basis
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array, readable

__all__ = [
    "COMPLIANCE",
    "DRAWS",
    "GEOMETRY",
    "TOGETHER",
    "contribution_paths",
    "decompose_deviation",
]

# Number of posterior draws from which contributions to the readings of a circle are computed.
DRAWS = 2000
# Names of three sums of contributions to the readings: ``TOGETHER`` names the sum over all effects
# of the machine, ``COMPLIANCE`` the sum over all compliances, and ``GEOMETRY`` the sum over all
# geometric errors.
TOGETHER = "compliance and geometry"
COMPLIANCE = "compliance"
GEOMETRY = "geometry"
# Columns of the table of contributions to the readings. ``_PLACE_COLUMNS`` give the circle, the
# force and the source of the contribution; ``_VALUE_COLUMNS`` hold values in µm.
_PLACE_COLUMNS = ["plane", "radius_mm", *CENTRE, "force_N", "source"]
_VALUE_COLUMNS = ["maximum", "minimum", "peak_to_peak", "sd", "ci_low", "ci_high"]


@one_blas_thread
@renamed_keyword("ci_prob", "prob")
def decompose_deviation(
    posterior: xr.DataTree, force_N: float | None = None, *, prob: float = 0.95
) -> pd.DataFrame:
    """Return the contributions of compliances and geometric errors to readings of circles [µm].

    In each plane, the contributions are computed for the circle of the first test in the plane. For
    each source (compliance or geometric error), the table states the largest and the smallest
    contribution along the circle, and the peak-to-peak value of the contribution.

    Parameters
    ----------
    posterior : DataTree
        Posterior from `sample`, `load` or `average`.
    force_N : float, optional
        Force of the bar [N]. Default: the highest force tested.
    prob : float
        Probability of the equal-tailed intervals, between 0 and 1.

    Returns
    -------
    DataFrame
        One row per plane and source. Sources are every compliance (including its change with
        force), every geometric error, and three sums: of all effects, of all compliances and of all
        geometric errors. Offsets of the tool ball are separate sources, and are not included in the
        sums. The columns plane, radius_mm, centre_x_mm, centre_y_mm, centre_z_mm, force_N and
        source describe the row. All other columns are in µm:

        - ``maximum`` and ``minimum``: largest and smallest value, along the circle, of the
          posterior mean of the contribution;
        - ``peak_to_peak`` and ``sd``: posterior median and standard deviation of the peak-to-peak
          value;
        - ``ci_low`` and ``ci_high``: ends of the credible interval of the peak-to-peak value.

        Because the contribution is uncertain, the peak-to-peak values of the posterior draws are
        too large on average. This mean error is subtracted.

    Raises
    ------
    InputError
        For a probability that is not between 0 and 1, a negative force, a force above 1.5 times the
        largest force tested, or a posterior from `to_units`.

    Examples
    --------
    >>> table = lb.analysis.decompose_deviation(posterior, force_N=500.0).set_index("source")
    >>> table.index.to_list()[:4]
    ['compliance and geometry', 'compliance', 'geometry', 'C_XXX']
    >>> round(table.loc["C_XXX", "maximum"])  # µm, C_XXX times 500 N
    28
    """
    check_probability(prob)
    bound = bound_of(posterior)
    force = float(bound.setting.force_N.max())
    if force_N is not None:
        force = float(force_N)
    require(
        force >= 0.0,
        f"force_N must not be negative, got {force:g}. The bar pushes tool and table apart.",
    )
    check_deflecting_force(bound.campaign, force, "force_N")
    rows = []
    for plane in bound.setting.tested_planes:
        r = first_circle(bound, plane)
        for source, path in contribution_paths(posterior, r, force).items():
            mean_path = path.mean(axis=0)
            place = place_of_circle(bound, r) | {"force_N": force, "source": source}
            ends = {"maximum": float(mean_path.max()), "minimum": float(mean_path.min())}
            rows.append(place | ends | summarise_draws(extremes_of(path).width, prob))
    table = pd.DataFrame(rows).rename(columns={"median": "peak_to_peak"})
    table = table.reindex(columns=[*_PLACE_COLUMNS, *_VALUE_COLUMNS])
    caption = f"Contributions to the reading, {100 * prob:g} % intervals of the peak-to-peak"
    return readable(table, caption, dict.fromkeys(_VALUE_COLUMNS, "µm"))


def contribution_paths(
    posterior: xr.DataTree, r: int, force_N: float, only: Collection[str] = ()
) -> Mapping[str, Array]:
    """Return contributions of the sources, such as ``C_XXX``, to the readings on one circle.

    The keys are names of sources, as in `decompose_deviation`. Each value holds draws of the
    contribution at the angles 0°, 1° … 359°, shape (draws, 360) [µm]. The circle is that of the
    test with index ``r``, at the force ``force_N`` [N]. Direct compliances contain what the term
    `JointLoad` adds to them. Sources that do not change the readings are left out. If ``only`` is
    not empty, sources that it does not name are left out, too.
    """
    rng = np.random.default_rng(0)
    turn = basis(ANGLE_RAD).T * 1e3
    by_model = [
        _contributing_circles(draws, r, force_N, rng) for draws in model_draws_of(posterior, DRAWS)
    ]
    paths = {}
    for source in by_model[0]:
        if only and source not in only:
            continue
        path = np.concatenate([circles[source] for circles in by_model]) @ turn
        if path.any():
            paths[source] = path
    return paths


def _contributing_circles(
    draws: ModelDraws, r: int, force_N: float, rng: np.random.Generator
) -> dict[str, Array]:
    """Return draws of the contribution of each source to a circle, shape (draws, 25) [mm].

    The contributions are Fourier coefficients. ``draws`` are posterior draws of one model. The
    other arguments are those of `contribution_paths`; ``rng`` draws the coefficients of
    `JointLoad`.
    """
    bound = draws.bound
    columns_by_source = _columns_by_source(bound, machine_columns(bound, r, force_N))
    circles = {source: draws.beta @ columns.T for source, columns in columns_by_source.items()}
    for compliance, added in joint_load_circles(draws, r, force_N, rng).items():
        for source in (TOGETHER, COMPLIANCE, compliance):
            circles[source] = circles[source] + added
    return circles


def _columns_by_source(bound: BoundModel, columns: MachineColumns) -> dict[str, Array]:
    """Return a matrix for each source, with its effects on a circle, shape (25, p).

    A source is a single effect of the machine, such as a compliance, or a sum of effects, such as
    the sum of all compliances. The keys are names of sources. Each matrix has one column for each
    of the p parameters: the change of the circle's 25 Fourier coefficients per unit of the
    parameter. The columns of parameters that do not belong to the source are zero. Offsets of the
    tool ball are separate sources, and are not included in the sums.
    """
    geometry = np.where(is_tool_ball_offset(bound), 0.0, columns.geometric)
    by_source = {
        TOGETHER: columns.elastic + geometry,
        COMPLIANCE: columns.elastic,
        GEOMETRY: geometry,
    }
    for compliance in bound.compliances:
        belongs = []
        for parameter in bound.parameters:
            is_elastic = parameter.group != "geometric"
            belongs.append(is_elastic and parameter.compliance == compliance.label)
        by_source[compliance.label] = np.where(belongs, columns.elastic, 0.0)
    for j, parameter in enumerate(bound.parameters):
        if parameter.group == "geometric":
            is_parameter = np.arange(len(bound.names)) == j
            by_source[parameter.name] = np.where(is_parameter, columns.geometric, 0.0)
    return by_source
