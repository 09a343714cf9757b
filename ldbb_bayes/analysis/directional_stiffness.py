"""Stiffness of the machine by direction: compliance along the bar, and principal stiffnesses.

A bar force F at the angle θ of a circle deflects the tool along the bar by F c(θ; F). With
c = cos θ, s = sin θ and the radius R, in the plane XY,

    c(θ; F) = C_XXX c² + C_XYX c s + C_YYY s² + R (C_CXY c² s + C_CYY c s²) + R² C_CCY c² s²,

where every compliance is its value at the force F; C_XXX, for example, is the deflection along X
per unit of force along X. c(θ; F) includes the change of the compliances with force and the term
`JointLoad` (nonlinear deflection of joints under load), whose effect also depends on the direction.
The first three compliances determine the deflection of a tool in the circle's centre. The other
three add the deflection of a tool at the position (R c, R s) on the circle, which is caused by the
rotation of an axis under the bar's load. A stiffness is 1 / c(θ; F).

The symmetric matrix S with the elements C_XXX, C_XYX / 2 and C_YYY is the compliance tensor of the
plane in the circle's centre. Its principal axes are at the angle ½ atan2(C_XYX, C_XXX − C_YYY).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from ldbb_bayes.analysis.circle_columns import first_circle
from ldbb_bayes.analysis.extremes import (
    CurveExtremes,
    extremes_on_circle,
    without_noise_excess,
)
from ldbb_bayes.analysis.stated_quantities import (
    AxialDirection,
    StatedValue,
    above_zero,
    axial_direction,
    is_hardly_positive,
    stated_stiffness,
    stated_value,
    stiffness_from,
)
from ldbb_bayes.campaign.campaign import distinct_forces
from ldbb_bayes.campaign.tested_forces import check_force, listed_forces
from ldbb_bayes.errors import check_probability, require
from ldbb_bayes.inference.coefficients import ModelDraws
from ldbb_bayes.inference.elastic_deflections import ElasticDraws, elastic_draws
from ldbb_bayes.inference.posterior import bound_of, elastic_draws_of
from ldbb_bayes.machine.chain import LINEAR
from ldbb_bayes.machine.linear import compliance_jacobian
from ldbb_bayes.model.fourier import basis
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array, Numbers, Result, readable

__all__ = [
    "DirectionalStiffness",
    "PlaneStiffness",
    "PrincipalStiffness",
    "stiffness",
    "stiffness_draws",
    "stiffness_of_fit",
]

# Number of posterior draws from which the stiffness is computed.
_DRAWS = 2000
# Step [°] between the angles at which the compliance along the bar and its credible intervals are
# stated.
_STEP_DEG = 5
# The direction of a principal axis in space counts as not determined if the half angle of the cone
# about it is at least this large [°]. A cone of this half angle may contain two principal axes.
_WIDEST_CONE_DEG = 45.0
# Radius [mm] of a circle so small that the compliance on it practically equals the compliance at
# its centre.
_CENTRE_RADIUS_MM = 1e-6
# Lever arm [mm] above which a compliance of a tilt counts as part of a compliance tensor.
_LEAST_LEVER_MM = 1e-3
# Angles of three directions in a plane [rad]: its first axis, its second axis, and midway between
# both axes. The compliance tensor is computed from the compliances in these directions.
_TENSOR_ANGLES_RAD = np.array([0.0, 0.5 * np.pi, 0.25 * np.pi])


@dataclass(frozen=True)
class PlaneStiffness(Result):
    """Stiffness of one plane by direction, at one force of the bar.

    Examples
    --------
    >>> plane = lb.stiffness(posterior).planes[0]
    >>> plane.plane, plane.force_N, plane.cross_name, plane.difference_name
    ('XY', 36.0, 'C_XYX', 'C_XXX − C_YYY')
    >>> plane.least.mean < plane.greatest.mean
    True
    """

    #: plane of the circle, such as XY; angles are measured from the first axis of the plane
    plane: str
    radius_mm: float  #: radius of the first circle tested in the plane [mm]
    force_N: float  #: force of the bar [N]
    angle_deg: Numbers  #: n angles θ of the bar, shape (n,) [°]
    #: posterior mean of the compliance along the bar at n angles of the bar, shape (n,) [mm/N]
    compliance: Numbers
    #: lower end of the credible interval of the compliance along the bar, at each of the n angles,
    #: shape (n,) [mm/N]
    compliance_low: Numbers
    #: upper end of the credible interval of the compliance along the bar, at each of the n angles,
    #: shape (n,) [mm/N]
    compliance_high: Numbers
    #: least value k_min of the stiffness along the bar, over all angles of the circle
    least: StatedValue
    #: greatest value k_max of the stiffness along the bar, over all angles of the circle
    greatest: StatedValue
    ratio: StatedValue  #: greatest stiffness divided by least stiffness, k_max / k_min
    softest: AxialDirection  #: direction in the plane in which the stiffness is least
    stiffest: AxialDirection  #: direction in the plane in which the stiffness is greatest
    #: direction of the softer principal axis of the compliance tensor at the circle's centre
    principal_axis: AxialDirection
    #: names of the compliances on which the compliance tensor at the circle's centre depends. If
    #: the centre is not at the machine's zero, compliances of tilts are among them.
    tensor_of: tuple[str, ...]
    #: whether the compliance along the bar depends on compliances of tilts, such as C_CXY, on the
    #: circle of the plane
    counts_tilts: bool
    #: name of the cross compliance (deflection along one axis of the plane per unit of force along
    #: the other), such as C_XYX; empty if the model has no cross compliance in this plane
    cross_name: str
    #: cross compliance of the plane: deflection along one axis per unit of force along the other;
    #: None if the model has no such compliance
    cross: StatedValue | None
    #: name of the difference of the compliances along the two axes of the plane, such as
    #: C_XXX − C_YYY
    difference_name: str
    #: compliance along the first axis of the plane minus compliance along its second axis
    difference: StatedValue


@dataclass(frozen=True)
class PrincipalAxis(Result):
    """One principal stiffness of a machine, and its direction in space."""

    #: stiffness of the machine along a principal axis of its compliance tensor
    stiffness: StatedValue
    #: components along X, Y and Z of a unit vector along a principal axis of the machine's
    #: compliance tensor; the opposite vector is equivalent
    direction: tuple[float, float, float]
    #: half angle [°] of a cone about ``direction``, the estimated direction of a principal axis.
    #: The true axis lies inside the cone with the probability ``DirectionalStiffness.prob``.
    cone_deg: float
    #: whether the readings determine the direction of a principal axis. This is the case if
    #: ``cone_deg`` is below 45°; it is the half angle of the cone in which the true axis lies with
    #: a given probability.
    is_determined: bool


@dataclass(frozen=True)
class PrincipalStiffness(Result):
    """Principal stiffnesses of a machine tested in three planes, at one force of the bar.

    The stiffnesses are the inverse eigenvalues of the compliance tensor at the centre of the first
    circle.
    """

    force_N: float  #: force of the bar [N]
    #: the three principal axes of the machine's compliance tensor, softest first
    axes: tuple[PrincipalAxis, ...]


@dataclass(frozen=True)
class DirectionalStiffness(Result):
    """Stiffness by direction, for every plane and force; see `stiffness`.

    Examples
    --------
    >>> result = lb.stiffness(posterior, [300.0])
    >>> table = result.table()
    >>> table["quantity"].to_list()[:3]
    ['k_min', 'k_max', 'k_ratio']
    """

    prob: float  #: probability of the credible intervals of stiffnesses and directions
    #: stiffness by direction in every plane at every force: the first plane at all forces, then the
    #: next plane at all forces
    planes: tuple[PlaneStiffness, ...]
    #: principal stiffnesses of the machine in space at every force; empty unless three planes were
    #: tested
    principal: tuple[PrincipalStiffness, ...] = ()

    def at(self, force_N: float) -> tuple[PlaneStiffness, ...]:
        """Return the stiffness by direction in every plane at the bar force ``force_N`` [N]."""
        return tuple(plane for plane in self.planes if plane.force_N == force_N)

    def table(self) -> pd.DataFrame:
        """Return stiffnesses, compliances and directions as a table.

        There is one row per plane, force and quantity. The columns plane, force_N, quantity and
        unit describe the row. The columns mean, sd, U_k2, median, ci_low and ci_high describe the
        posterior of the quantity; directions are in degrees. The column is_determined states
        whether the readings determine the quantity.

        If three planes were tested, there are further rows for the principal stiffnesses, with XYZ
        as the plane. In these rows, the columns x, y and z hold the components of a unit vector
        along the principal axis. The column cone_deg holds the half angle of a cone about this
        vector; the true axis lies inside the cone with the probability ``prob``.
        """
        rows = []
        for plane in self.planes:
            place = {"plane": plane.plane, "force_N": plane.force_N}
            rows += [place | row for row in _rows_of_plane(plane)]
        for principal in self.principal:
            place = {"plane": "XYZ", "force_N": principal.force_N}
            for k, axis in enumerate(principal.axes):
                rows.append(place | _row_of_axis(f"k_{k + 1}", axis))
        caption = f"Stiffness by direction, {100 * self.prob:g} % intervals"
        return readable(pd.DataFrame(rows), caption)


def _rows_of_plane(plane: PlaneStiffness) -> list[dict[str, object]]:
    """Return the rows of the stiffness table for one plane at one force.

    There is one row for each stiffness, compliance and direction; the keys of a row are names of
    columns.
    """
    values = {"k_min": plane.least, "k_max": plane.greatest, "k_ratio": plane.ratio}
    rows = [_row_of_value(name, value) for name, value in values.items()]
    directions = {
        "softest direction": plane.softest,
        "stiffest direction": plane.stiffest,
        "principal axis": plane.principal_axis,
    }
    rows += [_row_of_direction(name, direction) for name, direction in directions.items()]
    if plane.cross is not None:
        rows.append(_row_of_value(plane.cross_name, plane.cross))
    rows.append(_row_of_value(plane.difference_name, plane.difference))
    return rows


def _row_of_axis(name: str, axis: PrincipalAxis) -> dict[str, object]:
    """Return the table row of a principal stiffness in space, such as ``k_1``.

    The keys are names of columns. The columns x, y, z and cone_deg describe the principal axis.
    """
    x, y, z = axis.direction
    direction = {"x": x, "y": y, "z": z, "cone_deg": axis.cone_deg}
    return _row_of_value(name, axis.stiffness) | direction


def _row_of_value(name: str, value: StatedValue) -> dict[str, object]:
    """Return the table row of a stiffness or compliance; the keys are names of columns.

    ``name`` is the name of the stiffness or compliance, and ``value`` its estimate with
    uncertainties. The column ``is_determined`` states whether the readings determine both ends of
    the credible interval.
    """
    return {
        "quantity": name,
        "unit": value.unit,
        "mean": value.mean,
        "sd": value.sd,
        "U_k2": value.U_k2,
        "median": value.median,
        "ci_low": value.ci_low,
        "ci_high": value.ci_high,
        "is_determined": not value.only_lower_limit,
    }


def _row_of_direction(name: str, direction: AxialDirection) -> dict[str, object]:
    """Return the table row of a direction in a plane; the keys are names of columns.

    ``name`` is the name of the direction, such as "stiffest direction". The column ``median`` holds
    the mean direction, because no median is computed for directions.
    """
    return {
        "quantity": name,
        "unit": "deg",
        "mean": direction.angle_deg,
        "sd": direction.sd_deg,
        "U_k2": direction.U_deg,
        "median": direction.angle_deg,
        "ci_low": direction.ci_low_deg,
        "ci_high": direction.ci_high_deg,
        "is_determined": direction.is_determined,
    }


@one_blas_thread
def stiffness(
    posterior: xr.DataTree, forces_N: float | Sequence[float] = (), *, prob: float = 0.95
) -> DirectionalStiffness:
    """Return the stiffness by direction in every tested plane, with its uncertainty.

    The compliance along the bar is the deflection along the bar at the angle θ of the circle,
    divided by the bar's force F. This compliance includes the change of compliances with force and
    the term `JointLoad` (nonlinear deflection of joints under load). An error of the bar's length
    does not change the results. An error of the mount's compliance cancels in the difference of two
    compliances. A constant relative error of the force cancels in the ratio of stiffnesses.

    Parameters
    ----------
    posterior : DataTree
        Posterior from `sample`, `load` or `average`.
    forces_N : float or sequence of float
        Force or forces of the bar [N]. Default: the smallest force tested, the model's reference
        force and the largest force tested.
    prob : float
        Probability of the equal-tailed credible intervals, between 0 and 1.

    Returns
    -------
    DirectionalStiffness
        The following quantities, for every plane and force:

        - the compliance along the bar at each angle, with credible intervals;
        - the least and the greatest stiffness, and their directions;
        - the ratio of the greatest to the least stiffness;
        - the direction of the softer principal axis;
        - the cross compliance (deflection along one axis of the plane per unit of force along the
          other);
        - the difference of the compliances along the two axes.

        If three planes were tested, the result also holds the principal stiffnesses in space. If
        the readings hardly determine the compliance along the bar in some directions, noise makes
        the least stiffness too small and the greatest stiffness too large on average. Both errors
        are corrected.

    Raises
    ------
    InputError
        For a force below a tenth of the smallest force tested or above 1.5 times the largest, a
        probability that is not between 0 and 1, or a posterior from `to_units`.

    Examples
    --------
    >>> result = lb.stiffness(posterior)
    >>> plane = result.planes[-1]  # at the largest force
    >>> round(plane.least.mean / 1e3), round(plane.greatest.mean / 1e3)  # N/µm
    (17, 24)
    >>> plane.softest.is_determined
    True
    """
    check_probability(prob)
    bound = bound_of(posterior)
    forces = _forces_of_stiffness(bound, forces_N)
    for force in forces.tolist():
        if force != bound.setting.reference_force_N:
            check_force(bound.campaign, force, "forces_N")
    circles = _circle_of_each_plane(bound)
    draws = elastic_draws_of(posterior, circles, forces, _DRAWS)
    return _stiffness_of(bound, circles, forces, draws, prob)


def stiffness_of_fit(
    draws: ModelDraws, force_N: float, *, prob: float = 0.95
) -> DirectionalStiffness:
    """Return the stiffness by direction at one force, from draws of a fitted model.

    The result is the same as that of `stiffness`. No stored posterior is needed, which saves time.
    ``draws`` are posterior draws of the model, ``force_N`` is the force of the bar [N], and
    ``prob`` is the probability of the credible intervals.
    """
    bound = draws.bound
    forces = _forces_of_stiffness(bound, [force_N])
    circles = _circle_of_each_plane(bound)
    elastic = elastic_draws(draws.thinned(_DRAWS), circles, forces, np.random.default_rng(0))
    return _stiffness_of(bound, circles, forces, elastic, prob)


def _stiffness_of(
    bound: BoundModel, circles: Sequence[int], forces: Array, draws: ElasticDraws, prob: float
) -> DirectionalStiffness:
    """Return the stiffness by direction from draws of compliances and deflections.

    ``circles`` holds the index of one test for each plane. ``draws`` holds posterior draws of the
    compliances, and of the deflection per unit of force along the circles of these tests, at each
    of the forces ``forces`` [N]. ``prob`` is the probability of the credible intervals.
    """
    planes = []
    for k, r in enumerate(circles):
        for f, force in enumerate(forces.tolist()):
            compliances = draws.compliances[:, f]
            curve = draws.per_force[:, k, f]
            planes.append(_plane_stiffness(bound, r, force, curve, compliances, prob))
    principal = []
    if len(circles) == len(LINEAR):
        for f, force in enumerate(forces.tolist()):
            principal.append(_principal_stiffness(bound, force, draws.compliances[:, f], prob))
    return DirectionalStiffness(prob, tuple(planes), tuple(principal))


def stiffness_draws(posterior: xr.DataTree, force_N: float) -> dict[str, dict[str, Array]]:
    """Return, for each plane, draws of the least and the greatest stiffness and of their ratio.

    ``force_N`` is the force of the bar [N]. The keys of the result are names of planes. The value
    for a plane is a dict with three arrays of draws, shape (draws,): the least stiffness ``k_min``
    [N/mm], the greatest stiffness ``k_max`` [N/mm], and ``k_ratio``, the greatest divided by the
    least.
    """
    bound = bound_of(posterior)
    forces = _forces_of_stiffness(bound, [force_N])
    circles = _circle_of_each_plane(bound)
    draws = elastic_draws_of(posterior, circles, forces, _DRAWS)
    by_plane = {}
    for k, plane in enumerate(bound.setting.tested_planes):
        extremes = extremes_on_circle(draws.per_force[:, k, 0])
        by_plane[plane] = {
            "k_min": stiffness_from(extremes.largest),
            "k_max": stiffness_from(extremes.smallest),
            "k_ratio": _stiffness_ratio(extremes),
        }
    return by_plane


def _circle_of_each_plane(bound: BoundModel) -> list[int]:
    """Return the index of the first test in each tested plane."""
    return [first_circle(bound, plane) for plane in bound.setting.tested_planes]


def _forces_of_stiffness(bound: BoundModel, forces_N: float | Sequence[float]) -> Array:
    """Return the forces at which stiffness is computed [N].

    The result holds the forces in ``forces_N``. If ``forces_N`` is empty, the result holds the
    smallest force tested, the reference force and the largest force tested, in ascending order. Of
    these forces, those that are not above zero are left out, and of forces that differ by at most
    a thousandth of the largest force, only the smallest is kept. Raise an `InputError` if
    ``forces_N`` is no list of numbers, or if one of its forces is not positive and finite.
    """
    forces = np.array(listed_forces(forces_N))
    if not len(forces):
        tested = bound.setting.force_N
        reference = bound.setting.reference_force_N
        forces = np.array([tested.min(), reference, tested.max()])
        forces = distinct_forces(forces[forces > 0.0])
    require(
        bool((forces > 0.0).all() and np.isfinite(forces).all()),
        f"forces_N must be positive, got {forces.min():g}. Stiffness is force over deflection.",
    )
    return forces


def _plane_stiffness(
    bound: BoundModel, r: int, force_N: float, curve: Array, compliances: Array, prob: float
) -> PlaneStiffness:
    """Return the stiffness in the plane of the test with index ``r``, at the force ``force_N`` [N].

    ``curve``, shape (draws, 25), holds posterior draws of the Fourier coefficients of the
    compliance along the bar. ``compliances``, shape (draws, n), holds draws of the model's n
    compliances. ``prob`` is the probability of the credible intervals.
    """
    plane = str(bound.setting.plane[r])
    extremes = extremes_on_circle(curve)
    angle_deg = np.arange(0, 360, _STEP_DEG)
    along_bar = curve @ basis(np.deg2rad(angle_deg)).T
    tail = 0.5 * (1.0 - prob)
    band = np.quantile(along_bar, [tail, 1.0 - tail], axis=0)
    tensor = _plane_tensor(bound, r, plane, compliances)
    principal_rad = 0.5 * np.arctan2(2.0 * tensor.cross, tensor.first - tensor.second)
    cross_name, cross = _cross_compliance(bound, plane, compliances, prob)
    first = _direct_compliance(bound, plane[0], compliances)
    second = _direct_compliance(bound, plane[1], compliances)
    return PlaneStiffness(
        plane=plane,
        radius_mm=float(bound.setting.radius_mm[r]),
        force_N=force_N,
        angle_deg=angle_deg,
        compliance=along_bar.mean(axis=0),
        compliance_low=band[0],
        compliance_high=band[1],
        least=stated_stiffness(extremes.largest, prob),
        greatest=stated_stiffness(extremes.smallest, prob),
        ratio=stated_value(
            "", _stiffness_ratio(extremes), prob, is_hardly_positive(extremes.smallest, prob)
        ),
        softest=axial_direction(extremes.angle_of_largest_rad, prob),
        stiffest=axial_direction(extremes.angle_of_smallest_rad, prob),
        principal_axis=axial_direction(principal_rad, prob),
        tensor_of=tensor.compliances,
        counts_tilts=_counts_tilts(bound, r),
        cross_name=cross_name,
        cross=cross,
        difference_name=f"{first.name} − {second.name}",
        difference=stated_value("mm/N", first.draws - second.draws, prob),
    )


def _counts_tilts(bound: BoundModel, r: int) -> bool:
    """Return whether a compliance of a tilt acts on the circle of the test with index ``r``.

    Such a compliance describes a rotation, or the effect of a moment.
    """
    is_tilt = np.array([compliance.rotations > 0 for compliance in bound.compliances])
    acts = np.abs(bound.setting.elastic[r]).max(axis=0) > _LEAST_LEVER_MM
    return bool((is_tilt & acts).any())


class _NamedDraws(NamedTuple):
    """Name of a compliance, and posterior draws of the compliance [mm/N], shape (draws,)."""

    name: str
    draws: Array


def _direct_compliance(bound: BoundModel, axis: str, compliances: Array) -> _NamedDraws:
    """Return the name and draws of the compliance along ``axis`` under a force along this axis.

    ``compliances``, shape (draws, n), holds posterior draws of the n compliances of the model
    ``bound`` [mm/N].
    """
    for k, compliance in enumerate(bound.compliances):
        if compliance.kind == "direct" and compliance.twist == axis:
            return _NamedDraws(compliance.label, compliances[:, k])
    raise LookupError(f"axis {axis} must have a direct compliance, got none")


def _cross_compliance(
    bound: BoundModel, plane: str, compliances: Array, prob: float
) -> tuple[str, StatedValue | None]:
    """Return the name and the estimate of a plane's cross compliance.

    A cross compliance is the deflection along one axis of the plane, divided by the force along the
    other axis. If the model has no such compliance, the name is empty and the estimate None.
    ``compliances``, shape (draws, n), holds posterior draws of the model's n compliances, and
    ``prob`` is the probability of the credible interval.
    """
    for k, compliance in enumerate(bound.compliances):
        if compliance.kind == "cross" and {compliance.twist, compliance.wrench} == set(plane):
            return compliance.label, stated_value("mm/N", compliances[:, k], prob)
    return "", None


class _Tensor(NamedTuple):
    """Posterior draws of the elements of a plane's compliance tensor [mm/N], shape (draws,)."""

    first: Array  #: diagonal element of the compliance tensor for the plane's first axis
    second: Array  #: diagonal element of the compliance tensor for the plane's second axis
    cross: Array  #: off-diagonal element of the compliance tensor of a plane
    #: names of the compliances on which the compliance tensor of a plane depends
    compliances: tuple[str, ...]


def _plane_tensor(bound: BoundModel, r: int, plane: str, compliances: Array) -> _Tensor:
    """Return the compliance tensor of a plane, in the centre of the circle of one test.

    ``r`` is the index of this test. ``compliances``, shape (draws, n), holds posterior draws of the
    model's n compliances. The compliance in the centre along a unit vector u is uᵀ S u, where S is
    the tensor. S is computed from the compliances along three directions.
    """
    circle = bound.campaign.tests[r].circle
    centre = replace(circle, radius_mm=_CENTRE_RADIUS_MM, plane=plane)
    columns = compliance_jacobian(
        bound.campaign.machine(), centre, _TENSOR_ANGLES_RAD, bound.compliances
    )
    first, second, between = (compliances @ columns.T).T
    is_used = np.abs(columns).max(axis=0) > _LEAST_LEVER_MM
    names = [name.label for name, used in zip(bound.compliances, is_used, strict=True) if used]
    return _Tensor(first, second, between - 0.5 * (first + second), tuple(names))


def _principal_stiffness(
    bound: BoundModel, force_N: float, compliances: Array, prob: float
) -> PrincipalStiffness:
    """Return the principal stiffnesses in space at the centre of the first circle.

    ``compliances``, shape (draws, n), holds posterior draws of the model's n compliances at the
    force ``force_N`` of the bar [N]. ``prob`` is the probability of the credible intervals.
    """
    tensors = np.zeros((len(compliances), 3, 3))
    for plane in bound.setting.tested_planes:
        tensor = _plane_tensor(bound, 0, plane, compliances)
        i = LINEAR.index(plane[0])
        j = LINEAR.index(plane[1])
        tensors[:, i, i] = tensor.first
        tensors[:, j, j] = tensor.second
        tensors[:, i, j] = tensor.cross
        tensors[:, j, i] = tensor.cross
    values, vectors = np.linalg.eigh(tensors)
    mean_values, mean_vectors = np.linalg.eigh(tensors.mean(axis=0))
    axes = []
    # The eigenvalues of the compliance tensor are in ascending order, so that the last eigenvalue
    # belongs to the softest axis.
    for k in (2, 1, 0):
        eigenvalues = without_noise_excess(values[:, k], float(mean_values[k]))
        direction = mean_vectors[:, k]
        cosines = np.abs(vectors[:, :, k] @ direction)
        cone_deg = float(np.degrees(np.quantile(np.arccos(np.minimum(cosines, 1.0)), prob)))
        x, y, z = direction.tolist()
        axes.append(
            PrincipalAxis(
                stiffness=stated_stiffness(eigenvalues, prob),
                direction=(x, y, z),
                cone_deg=cone_deg,
                is_determined=cone_deg < _WIDEST_CONE_DEG,
            )
        )
    return PrincipalStiffness(force_N, tuple(axes))


def _stiffness_ratio(extremes: CurveExtremes) -> Array:
    """Return draws of the stiffness ratio along the bar: the greatest divided by the least.

    The ratio is computed from ``extremes``, draws of the largest and the smallest compliance along
    the bar on a circle. A ratio below one is set to one.
    """
    return np.asarray(np.maximum(extremes.largest / above_zero(extremes.smallest), 1.0))
