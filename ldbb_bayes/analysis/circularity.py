"""Circular-test quantities of ISO 230-4 for the machine's path, without instrument errors.

The quantities are defined as in ISO 230-4. The circular deviation G is the width of the narrowest
ring that contains the path and has the least-squares centre. The radial deviations F_max and F_min
are measured from the least-squares circle. F_max_nominal and F_min_nominal are measured from a
circle that has the same centre and the nominal radius.

The path is not known exactly. A single posterior draw of the path is therefore more wavy than the
posterior mean path, and its peak-to-peak value G is larger. To correct this, the draws of G are
shifted so that their mean equals G of the posterior mean path; see `extremes`.

Radial deviations are small compared with the radius R. If the centre from which they are measured
is shifted by (a, b), the deviation at the angle θ therefore decreases by a cos θ + b sin θ. The
error of this approximation is at most e²/2R for a shift by e, for example 0.01 µm for e = 50 µm and
R = 125 mm.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from ldbb_bayes.analysis.circle_columns import (
    ANGLE_RAD,
    COS2,
    SIN2,
    first_circle,
    is_tool_ball_offset,
    machine_columns,
    place_of_circle,
    second_order_factors,
)
from ldbb_bayes.analysis.extremes import extremes_of
from ldbb_bayes.campaign.campaign import distinct_forces
from ldbb_bayes.campaign.tested_forces import check_deflecting_force, listed_forces
from ldbb_bayes.deprecation import renamed_keyword
from ldbb_bayes.errors import check_probability, require
from ldbb_bayes.inference.coefficients import (
    ModelDraws,
    draw_shared,
    shared_columns,
    shared_terms,
)
from ldbb_bayes.inference.posterior import bound_of, elastic_draws_of, model_draws_of
from ldbb_bayes.model.fourier import SIZE, basis
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array, readable

__all__ = [
    "BIDIRECTIONAL",
    "MINIMUM_ZONES",
    "QUANTITIES",
    "PathDraws",
    "path_draws",
    "predict_circularity",
    "summarise_draws",
]

# Three dicts of circular-test quantities of ISO 230-4: the keys are their names, and the values are
# their units. The ``QUANTITIES`` are computed for every tool path, the ``BIDIRECTIONAL`` ones only
# for planes in which circles are run both clockwise and counterclockwise. The ``MINIMUM_ZONES`` are
# widths of the narrowest ring that contains the path (``G_minimum_zone``), or the paths of both
# directions of travel (``G_b_minimum_zone``).
QUANTITIES = {
    "G": "µm",
    "F_max": "µm",
    "F_min": "µm",
    "squareness": "µm/m",
    "scale_mismatch": "µm/m",
    "F_max_nominal": "µm",
    "F_min_nominal": "µm",
}
BIDIRECTIONAL = {"G_b": "µm", "D": "µm"}
MINIMUM_ZONES = {"G_minimum_zone": "µm", "G_b_minimum_zone": "µm"}
# Mask of the 25 Fourier coefficients of a circle. It is false for the three coefficients that
# describe the radius and the centre: the mean radius, and the amplitudes of cos θ and sin θ.
_CENTRED = np.arange(SIZE) >= 3
# Regular expressions for the names of hysteresis coefficients. ``_CONSTANT_HYSTERESIS`` matches
# coefficients of the part of the hysteresis that does not depend on force.
# ``_PROPORTIONAL_HYSTERESIS`` matches coefficients of the part that is proportional to force.
_CONSTANT_HYSTERESIS = re.compile(r"hysteresis_(?!force)")
_PROPORTIONAL_HYSTERESIS = re.compile("hysteresis_force")


@one_blas_thread
@renamed_keyword("ci_prob", "prob")
def predict_circularity(
    posterior: xr.DataTree,
    forces_N: float | Sequence[float] = (),
    *,
    prob: float = 0.95,
    draws: int = 2000,
) -> pd.DataFrame:
    """Return circular-test quantities of the machine's tool path, with credible intervals.

    The quantities are defined in ISO 230-4. They are computed without errors of the instrument, for
    the circle of the first test in each plane. The circular deviation G is the largest difference
    of radii along the path. If the readings do not determine the path well, the draws of G and of
    the absolute values of F_max and F_min are too large on average. The mean excess is subtracted.

    Parameters
    ----------
    posterior : DataTree
        Posterior from `sample`, `load` or `average`.
    forces_N : float or sequence of float
        Force or forces of the bar [N]; 0 means geometric errors alone. Default: 0 and the tested
        forces.
    prob : float
        Probability of the equal-tailed intervals, between 0 and 1.
    draws : int
        Number of posterior draws used, evenly spaced among all draws.

    Returns
    -------
    DataFrame
        One row per plane, force and quantity. Columns are plane, radius_mm, centre_x_mm,
        centre_y_mm, centre_z_mm, force_N, quantity, unit, mean, sd, median, ci_low, ci_high. G,
        F_max and F_min [µm] are measured from the circle with the least-squares centre and radius.
        F_max_nominal and F_min_nominal [µm] are measured from the circle with the least-squares
        centre and the nominal radius; they are more uncertain, because of the uncertainty of the
        bar's length. The best estimate of each quantity is its mean. Squareness and scale_mismatch
        [µm/m] are computed from the second harmonic of the path, and include the effect of
        compliance. Squareness has the sign of the squareness parameter of the plane, E_C0YX in XY;
        scale_mismatch is the scale error of the first axis minus that of the second axis. If the
        circles of a plane are run in both directions of travel, G, F_max and F_min are computed
        from the mean of both paths. For such a plane there are also the bidirectional deviation G_b
        [µm] and the mean deviation D [µm], which is the mean radius minus the nominal radius.

    Raises
    ------
    InputError
        For a negative force, a force above 1.5 times the largest force tested, a probability not
        between 0 and 1, or a posterior from `to_units`.

    Examples
    --------
    >>> table = lb.analysis.predict_circularity(posterior, [0.0, 300.0], draws=400)
    >>> table["quantity"].to_list()[:5]
    ['G', 'F_max', 'F_min', 'squareness', 'scale_mismatch']
    >>> table["force_N"].unique().tolist()
    [0.0, 300.0]
    """
    check_probability(prob)
    units = QUANTITIES | BIDIRECTIONAL
    rows = []
    for path in path_draws(posterior, forces_N, draws):
        for quantity, values in path.quantities.items():
            row = {"quantity": quantity, "unit": units[quantity], "mean": float(values.mean())}
            rows.append(path.place | row | summarise_draws(values, prob))
    return readable(pd.DataFrame(rows), f"The machine's own path, {100 * prob:g} % intervals")


class PathDraws(NamedTuple):
    """Posterior draws of the circular-test quantities (ISO 230-4) of one tool path.

    The tool path is the path along which the machine moves the tool in one plane, at one force of
    the bar.
    """

    #: a dict with the plane of the tool path, the radius and the centre of the path [mm] and the
    #: force of the bar [N]. The keys are names of columns of the table that `predict_circularity`
    #: returns.
    place: dict[str, Any]
    #: posterior draws of each quantity of the tool path, shape (draws,); the keys are names of the
    #: quantities that `predict_circularity` computes
    quantities: dict[str, Array]


def path_draws(
    posterior: xr.DataTree, forces_N: float | Sequence[float] = (), draws: int = 2000
) -> Iterator[PathDraws]:
    """Yield posterior draws of the circular-test quantities (ISO 230-4) of each tool path.

    One `PathDraws` is yielded for each plane and each force. It holds, for each quantity that
    `predict_circularity` explains, an array of draws of shape (draws,). The bidirectional
    quantities G_b and D are included only if the posterior contains hysteresis in this plane.
    ``forces_N`` are forces of the bar [N], by default 0 and the tested forces. ``draws`` is the
    number of posterior draws used.
    """
    bound = bound_of(posterior)
    draws_of_models = model_draws_of(posterior, draws)
    geometric_errors = np.concatenate([model_draws.beta for model_draws in draws_of_models])
    geometric_errors = np.where(is_tool_ball_offset(bound), 0.0, geometric_errors)
    hysteresis = _draw_hysteresis(bound, draws_of_models)
    forces = _forces_of_paths(bound, forces_N)
    circles = [first_circle(bound, plane) for plane in bound.setting.tested_planes]
    loaded = np.array([force for force in forces if force > 0.0])
    per_force = None
    if len(loaded):
        per_force = elastic_draws_of(posterior, circles, loaded, draws).per_force
    for k, plane in enumerate(bound.setting.tested_planes):
        r = circles[k]
        geometric_um = geometric_errors @ machine_columns(bound, r, 0.0).geometric.T * 1e3
        for force in forces:
            path_um = geometric_um
            if per_force is not None and force > 0.0:
                position = int(np.argmax(loaded == force))
                path_um = geometric_um + per_force[:, k, position] * (force * 1e3)
            quantities = _path_quantities(bound, r, path_um)
            if plane in hysteresis:
                half_difference_um = hysteresis[plane].at_force(force) * 1e3
                quantities |= _bidirectional_quantities(path_um, half_difference_um)
            place = place_of_circle(bound, r) | {"force_N": force}
            yield PathDraws(place, quantities)


def _forces_of_paths(bound: BoundModel, forces_N: float | Sequence[float]) -> list[float]:
    """Return the forces at which tool paths are computed [N], by default 0 and the tested forces.

    Raise an `InputError` for a negative force, or one too far above the tested forces.
    """
    forces = listed_forces(forces_N)
    if not forces:
        return [0.0, *distinct_forces(bound.setting.force_N).tolist()]
    require(
        min(forces) >= 0.0,
        f"forces_N must not be negative, got {min(forces):g}. The bar pushes tool and table apart.",
    )
    for force in forces:
        if force != bound.setting.reference_force_N:
            check_deflecting_force(bound.campaign, force, "forces_N")
    return forces


def _path_quantities(bound: BoundModel, r: int, path_um: Array) -> dict[str, Array]:
    """Return posterior draws of the circular-test quantities (ISO 230-4) of one tool path.

    The result is a dict of arrays of shape (draws,); its keys are the names in `QUANTITIES`.
    ``path_um``, shape (draws, 25), holds posterior draws of the 25 Fourier coefficients of the
    radial deviation [µm]. The path is the circle of the test with index ``r``.
    """
    factors = second_order_factors(bound, r)
    trace = np.where(_CENTRED, path_um, 0.0) @ basis(ANGLE_RAD).T
    about_mean_radius = extremes_of(trace)
    about_nominal_radius = extremes_of(trace + path_um[:, :1])
    return {
        "G": about_mean_radius.width,
        "F_max": np.maximum(about_mean_radius.largest, 0.0),
        "F_min": np.minimum(about_mean_radius.smallest, 0.0),
        "squareness": path_um[:, SIN2] * factors.squareness,
        "scale_mismatch": path_um[:, COS2] * factors.scale_mismatch,
        "F_max_nominal": about_nominal_radius.largest,
        "F_min_nominal": about_nominal_radius.smallest,
    }


def _bidirectional_quantities(path_um: Array, half_difference_um: Array) -> dict[str, Array]:
    """Return the bidirectional deviation G_b and the mean deviation D of ISO 230-4 [µm].

    ``path_um`` is the mean of the clockwise and the counterclockwise tool path, and
    ``half_difference_um`` is half their difference, clockwise minus counterclockwise. Both have the
    shape (draws, 25): they hold, for each posterior draw, the 25 Fourier coefficients of the radial
    deviation (the constant, and the cosine and sine terms of the harmonics 1 to 12). G_b is
    measured from the least-squares circle of the mean path.
    """
    centred = np.where(_CENTRED, path_um, 0.0)
    clockwise = (centred + half_difference_um) @ basis(ANGLE_RAD).T
    counterclockwise = (centred - half_difference_um) @ basis(ANGLE_RAD).T
    traces = np.concatenate([clockwise, counterclockwise], axis=1)
    return {"G_b": extremes_of(traces).width, "D": path_um[:, 0]}


def summarise_draws(values: Array, prob: float) -> dict[str, float]:
    """Return the standard deviation, the median and the credible interval of posterior draws.

    ``values`` are the draws, shape (draws,); ``prob`` is the probability of the equal-tailed
    interval. The result is a dict with the keys sd, median, ci_low and ci_high.
    """
    low, median, high = np.quantile(values, [0.5 - 0.5 * prob, 0.5, 0.5 + 0.5 * prob])
    return {
        "sd": float(values.std()),
        "median": float(median),
        "ci_low": float(low),
        "ci_high": float(high),
    }


class _Hysteresis(NamedTuple):
    """Posterior draws of the hysteresis of a circle, described by 25 Fourier coefficients.

    Hysteresis is half the difference of the radial deviations in clockwise and counterclockwise
    travel, clockwise minus counterclockwise.
    """

    #: part of the hysteresis that does not depend on force, as Fourier coefficients of the radial
    #: deviation, shape (draws, 25) [mm]
    constant: Array
    #: part of the hysteresis that is proportional to force, as Fourier coefficients of the radial
    #: deviation per unit of force, shape (draws, 25) [mm/N]
    proportional: Array

    def at_force(self, force_N: float) -> Array:
        """Return posterior draws of the hysteresis of a circle at a force of the bar [N].

        The result holds the 25 Fourier coefficients of the hysteresis in each draw, shape (draws,
        25) [mm].
        """
        return self.constant + force_N * self.proportional


def _draw_hysteresis(
    bound: BoundModel, draws_of_models: Sequence[ModelDraws]
) -> dict[str, _Hysteresis]:
    """Return random draws of the hysteresis in each plane that is run in both directions of travel.

    The result is a dict with the planes as keys; planes whose hysteresis is zero are left out.
    ``draws_of_models`` holds posterior draws of each model. There are several models if the
    posterior is an average over models; each value then holds the draws of all models, one model
    after the other.
    """
    if not bound.setting.both_ways:
        return {}
    by_model = [_draw_hysteresis_of_model(model_draws) for model_draws in draws_of_models]
    hysteresis = {}
    for plane in by_model[0]:
        hysteresis[plane] = _Hysteresis(
            np.concatenate([planes[plane].constant for planes in by_model]),
            np.concatenate([planes[plane].proportional for planes in by_model]),
        )
    return hysteresis


def _draw_hysteresis_of_model(draws: ModelDraws) -> dict[str, _Hysteresis]:
    """Return draws of the hysteresis in each plane, under one model of an average.

    The result is a dict; its keys are the planes in which circles are run in both directions of
    travel. Planes in which the hysteresis is zero in all draws are left out. Hysteresis changes its
    sign with the direction of travel; the result has the sign of clockwise travel. Each value has
    two parts: one that does not depend on the force, and one that is proportional to the force.
    """
    bound = draws.bound
    names: list[str] = []
    for term in shared_terms(bound.nuisance_columns):
        names.extend(term.names)
    constant = [j for j, name in enumerate(names) if _CONSTANT_HYSTERESIS.match(name)]
    proportional = [j for j, name in enumerate(names) if _PROPORTIONAL_HYSTERESIS.match(name)]
    columns = shared_columns(bound)
    coefficients = draw_shared(bound, draws.phi, draws.beta, np.random.default_rng(0))
    hysteresis = {}
    for plane in bound.setting.both_ways:
        r = _first_travelled_circle(bound, plane)
        # The direction of travel is 1 for clockwise and −1 for counterclockwise.
        travel = bound.setting.travel[r]
        travel_per_newton = travel / bound.setting.force_N[r]
        plane_hysteresis = _Hysteresis(
            coefficients[:, constant] @ (columns[r][:, constant].T * travel),
            coefficients[:, proportional] @ (columns[r][:, proportional].T * travel_per_newton),
        )
        if plane_hysteresis.constant.any() or plane_hysteresis.proportional.any():
            hysteresis[plane] = plane_hysteresis
    return hysteresis


def _first_travelled_circle(bound: BoundModel, plane: str) -> int:
    """Return the index of the first test in ``plane`` whose direction of travel is stated."""
    in_plane = np.array(bound.setting.plane) == plane
    return int(np.argmax(in_plane & (np.asarray(bound.setting.travel) != 0.0)))
