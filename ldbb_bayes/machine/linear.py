"""Linear effects of compliances and errors on readings, and the compliances that tests identify.

A unit force along the bar, whose direction is B̂, causes three forces and three moments at joint k,
about the origin of its frame. They form the wrench g_k, shape (6,). Let J_k be the Jacobian of the
joint, and let the lever be the vector from the frame to the ball. Then the wrench is g_k = J_kᵀ B̂
= (B̂, lever × B̂). A compliance C_ijk is the displacement or rotation i caused by the force or
moment j at joint k. This compliance changes the reading by g_k,i · g_k,j per unit force and per
unit of the compliance (Eq. 20 of the paper, the article on which the model is based). An error
motion e of joint k consists of three displacements and three rotations about the same frame. It
changes the reading by g_k · e if the joint carries the tool, and by −g_k · e if the joint carries
the workpiece (Eq. 16-23). If all levers lie in the plane of the circle, this is the paper's planar
model.

Circular tests cannot identify all compliances (Table 2 of the article on the model). Some
compliances never change a reading (null columns). Others change the readings in proportion to each
other (proportional sets); one compliance of each proportional set is kept and represents the set.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ldbb_bayes.errors import require
from ldbb_bayes.machine.chain import LINEAR, Circle, Joint, Machine
from ldbb_bayes.machine.parameters import (
    COMPONENTS,
    ComplianceName,
    GeometricName,
    geometric_names,
    joint_names,
    wrench_names,
)
from ldbb_bayes.results import Array, readable

__all__ = [
    "ErrorBearer",
    "Kept",
    "compliance_jacobian",
    "error_bearer",
    "geometric_jacobian",
    "hybrid_jacobian",
    "kept_compliances",
    "patterns",
    "wrench_jacobian",
]

# Number of angles of a full circle at which the effects of compliances on the reading are compared.
_ANGLES = 64
# In the matrix of effects, each compliance has a column: the change of the readings per unit of the
# compliance. Two columns count as proportional if the cosine of the angle between them differs from
# ±1 by at most this number.
_PARALLEL = 1e-10
# In the matrix of effects, each compliance has a column: the change of the readings per unit of the
# compliance. If the norm of a column is smaller than this fraction of the largest norm of all
# columns, the compliance is treated as having no effect.
_NULL_SHARE = 1e-10
# A number counts as a rounding error if its absolute value is below this fraction of a reference
# value. There are two uses. The effect of a compliance on the readings may be written as a sum of
# effects of other compliances; terms smaller than this fraction of the effect are ignored. A matrix
# counts as positive semi-definite even if it has a negative eigenvalue, provided that the absolute
# value of the eigenvalue is below this fraction of the largest element.
_ROUNDING_WEIGHT = 1e-7
# In the matrix of effects, each compliance has a column: the change of the readings per unit of the
# compliance, scaled to length one. A column counts as linearly independent of other columns if its
# component orthogonal to them is longer than this number.
_INDEPENDENT = 1e-8


class ErrorBearer(NamedTuple):
    """Where a geometric error acts: at which joint, and before or after the joint's motion."""

    joint: Joint  #: joint of a machine axis at which the geometric error acts
    #: whether the geometric error acts before the motion of the joint, in the kinematic chain from
    #: the foundation to the tool or workpiece
    before_motion: bool


def wrench_jacobian(machine: Machine, circle: Circle, angle_rad: Array) -> Array:
    """Return the reading per unit force and per unit of each planar compliance, at n angles.

    A planar compliance relates a displacement or rotation in a tested plane to a force or moment in
    the same plane. The result is the wrench Jacobian of the article on the model. It has the shape
    (n, 18) for one plane, and its elements have the unit 1, mm or mm². The columns are in the order
    of `wrench_names`. ``circle`` is the nominal circle on ``machine``. ``angle_rad``, shape (n,),
    holds the angles of the bar, measured from the first axis of the plane [rad].
    """
    return compliance_jacobian(machine, circle, angle_rad, wrench_names(machine))


def compliance_jacobian(
    machine: Machine, circle: Circle, angle_rad: Array, names: Sequence[ComplianceName]
) -> Array:
    """Return the reading per unit force and per unit of each compliance.

    The equations are Eq. 20-23 of the article on the model.

    Parameters
    ----------
    machine, circle
        Machine and nominal circle of the test.
    angle_rad
        The n angles of the bar from the first axis of the plane, shape (n,) [rad].
    names
        Names of the compliances, one for each column.

    Returns
    -------
    Matrix of shape (n, number of compliances). The unit of a column is 1, mm or mm².
    """
    direction = circle.direction(angle_rad)
    wrenches = {}
    for axis in {name.joint for name in names}:
        lever = machine.lever_mm(machine.joint(axis), circle, angle_rad)
        wrenches[axis] = _wrench(lever, direction)
    columns = np.zeros((len(angle_rad), len(names)))
    for k, name in enumerate(names):
        wrench = wrenches[name.joint]
        twist_component = wrench[:, COMPONENTS.index(name.twist)]
        columns[:, k] = twist_component * wrench[:, COMPONENTS.index(name.wrench)]
    return columns


def geometric_jacobian(machine: Machine, circle: Circle, angle_rad: Array) -> Array:
    """Return the change of the reading per unit of each geometric error.

    The equations are Eq. 16-18 of the article on the model. The result has one row for each of n
    angles, and one column for each name that `geometric_names` returns. Readings are in mm. The
    unit of an error is 1 for scale errors, rad for squareness errors, 1/mm for straightness
    deviations and mm for tool offsets. ``circle`` is the nominal circle of the test on ``machine``.
    ``angle_rad``, shape (n,), holds the angles of the bar, measured from the first axis of the
    plane [rad].
    """
    columns = [_error_column(machine, circle, angle_rad, name) for name in geometric_names(machine)]
    return np.stack(columns, axis=1)


def _error_column(machine: Machine, circle: Circle, angle_rad: Array, name: GeometricName) -> Array:
    """Return the change of the reading at n angles per unit of a geometric error, shape (n,).

    ``name`` is the name of the geometric error. ``circle`` is the nominal circle of the test on
    ``machine``. ``angle_rad``, shape (n,), holds the angles of the bar, measured from the first
    axis of the plane [rad].
    """
    direction = circle.direction(angle_rad)
    component = COMPONENTS.index(name.component)
    if name.kind == "offset":
        return direction[:, component]
    joint, before_motion = error_bearer(machine, name)
    lever = machine.lever_mm(joint, circle, angle_rad)
    coordinate = joint.sign * circle.position_mm(angle_rad)[:, joint.index]
    if before_motion:
        lever[:, joint.index] += coordinate
    return joint.sign * coordinate**name.order * _wrench(lever, direction)[:, component]


def error_bearer(machine: Machine, name: GeometricName) -> ErrorBearer:
    """Return a geometric error's joint, and whether the error acts before the joint's motion.

    A squareness error concerns two axes. If both axes carry the tool, or both carry the workpiece,
    the error acts after the motion of the reference axis. If one axis carries the tool and the
    other the workpiece, the error acts before the motion of the axis that is not the reference.
    Scale errors (gains) and straightness deviations act at the joint of their axis, after its
    motion. ``name`` is the name of an error of ``machine``; it must not be a tool offset, because
    tool offsets act at no joint.
    """
    if name.kind != "squareness":
        return ErrorBearer(machine.joint(name.axis), before_motion=False)
    primary = machine.joint(name.reference)
    secondary = machine.joint(name.axis)
    if primary.branch == secondary.branch:
        return ErrorBearer(primary, before_motion=False)
    return ErrorBearer(secondary, before_motion=True)


def _wrench(lever: Array, direction: Array) -> Array:
    """Return the forces and moments that a unit force along the bar causes at a joint.

    The result, shape (n, 6) for n angles, holds three forces and three moments. ``lever`` (n, 3) is
    the vector from the joint's frame to the ball [mm], and ``direction`` (n, 3) the unit vector of
    the bar.
    """
    return np.concatenate([direction, np.cross(lever, direction)], axis=1)


@dataclass(frozen=True)
class Kept:
    """Compliances that circular tests can separate; each is kept as the representative of a set.

    A proportional set is a set of compliances that change the readings in proportion to each other.
    The readings determine only the weighted sum of the set's compliances; one compliance, the
    representative, is kept for the set.
    """

    #: compliances that circular tests can separate, in the order of Table 1 of the article on the
    #: model. Each is kept as the representative of its proportional set, that is, of the
    #: compliances whose effects on the readings are proportional to each other.
    names: tuple[ComplianceName, ...]
    #: for each compliance in ``names`` (those that circular tests can separate), the names of all
    #: compliances of its proportional set (Table 2 of the article on the model). The compliances of
    #: a set change the readings in proportion to each other. The first name in each set is that of
    #: the compliance in ``names``.
    sets: tuple[tuple[str, ...], ...]
    #: for each proportional set in ``sets``, a tuple with one weight for each compliance of the
    #: set, in the same order. The weight is the effect of the compliance on the reading divided by
    #: the effect of the first compliance of the set. Its unit is a power of mm.
    weights: tuple[tuple[float, ...], ...]
    #: for each compliance in ``names`` (those that circular tests can separate), a dict of other
    #: compliances that change its estimated value. The effect of such a compliance on the readings
    #: is a linear combination of the effects of compliances in ``names``. The keys are these other
    #: compliances; the values are weights. The estimated value contains the sum of these
    #: compliances, each multiplied by its weight.
    absorbed: tuple[Mapping[ComplianceName, float], ...]
    #: whether physics excludes negative values of each compliance in ``names`` (the compliances
    #: that circular tests can separate). Negative values are excluded, for example, for a
    #: deflection in the direction of the load that causes it.
    not_negative: tuple[bool, ...]
    #: names of the compliances that never change a reading of a circular test
    null: tuple[str, ...]
    #: names of the compliances that are not kept, because their effect on the reading is a linear
    #: combination of the effects of several kept compliances (those in ``names``). If several such
    #: compliances have effects proportional to each other, only one of them is named.
    dependent: tuple[str, ...]
    #: rank of the matrix with one column for each compliance that may change a reading; a column
    #: holds the readings per unit of the compliance, at equally spaced angles of full circles
    rank: int
    #: condition number of the matrix with one column for each compliance that circular tests can
    #: separate; a column holds the readings per unit of the compliance
    condition_number: float


def kept_compliances(machine: Machine, *circles: Circle) -> Kept:
    """Return the compliances that circular tests can separate, and the set that each represents.

    The compliances and sets (Table 2 of the article on the model) are computed numerically from the
    readings per unit compliance. A compliance of a joint is its motion in one direction per unit of
    one force or moment. Compliances whose motion and load lie in a tested plane are examined in any
    case, all others only if they change a reading. Compliances that change the readings in
    proportion to each other form a set, and one compliance of each set represents it in the result.
    For the machine in the article, the rules below choose the same compliances as the article. The
    rules are, the most important first:

    1. prefer a compliance that is not a translation caused by a moment;
    2. prefer a displacement caused by a force to a rotation caused by a force, and the latter to a
       rotation caused by a moment;
    3. prefer a compliance at the joint that moves in the direction of the deflection;
    4. of rotations, prefer a compliance at a joint whose axis lies in the plane of the rotation;
    5. choose the first compliance in alphabetical order.

    The readings of all circles are examined together: circles with different centres or planes can
    separate compliances that one circle cannot separate. If no circles are given, a circle with the
    radius 150 mm about the origin is assumed in every plane of the machine.
    """
    if not circles:
        circles = tuple(Circle(plane=plane) for plane in machine.planes)
    return _kept_compliances(machine, circles)


@dataclass(frozen=True, eq=False)
class _Candidates:
    """Compliances that may change readings, with their effects at n angles of full circles.

    n is the total number of angles of all circles.
    """

    #: names of the compliances that may change a reading of a circular test
    names: tuple[ComplianceName, ...]
    #: reading at n angles per unit force and per unit of each compliance, shape (n, number of
    #: compliances)
    jacobian: Array
    #: columns of ``jacobian`` (readings per unit of each compliance), divided by their norms;
    #: columns of zeros stay zero
    unit: Array
    #: indices, from 0, of those compliances in ``names`` that change at least one reading
    live: tuple[int, ...]


def _candidates(machine: Machine, circles: tuple[Circle, ...]) -> _Candidates:
    """Return the compliances that may change readings on ``circles``, with their effects.

    A planar compliance relates a displacement or rotation in a tested plane to a force or moment in
    the same plane. All planar compliances of ``machine`` are returned. Other compliances are
    returned only if they change a reading on one of ``circles``.
    """
    angle = np.arange(_ANGLES) * (2 * np.pi / _ANGLES)
    names = joint_names(machine)
    jacobian = np.concatenate(
        [compliance_jacobian(machine, circle, angle, names) for circle in circles]
    )
    # Each column holds the readings per unit of a compliance. Divide the column by the radius, once
    # for every rotary component of the compliance. All columns are then of comparable size.
    unit = jacobian / [circles[0].radius_mm ** name.rotations for name in names]
    norms = np.linalg.norm(unit, axis=0)
    planar = set(wrench_names(machine))
    index = [i for i, name in enumerate(names) if name in planar]
    changes_a_reading = norms > _NULL_SHARE * norms.max()
    index += [i for i, name in enumerate(names) if name not in planar and changes_a_reading[i]]
    unit = unit[:, index]
    norms = norms[index]
    live = np.flatnonzero(norms > _NULL_SHARE * norms.max())
    return _Candidates(
        tuple(names[i] for i in index),
        jacobian[:, index],
        unit / np.where(norms > 0, norms, 1.0),
        tuple(live.tolist()),
    )


@lru_cache(maxsize=64)
def _kept_compliances(machine: Machine, circles: tuple[Circle, ...]) -> Kept:
    """Return the compliances that circular tests can separate: the parameters of the model.

    Compliances whose effects on the readings are proportional form a set. One compliance of each
    set is kept as a parameter, unless its effect is a linear combination of the effects of
    compliances that are already kept. Each parameter therefore represents a weighted sum of
    compliances; the result also contains the weights. ``circles`` are the nominal circles of tests
    on ``machine``.
    """
    candidates = _candidates(machine, circles)
    names = candidates.names
    jacobian = candidates.jacobian
    set_by_head = {members[0]: members for members in _proportional_sets(candidates)}
    heads = sorted(set_by_head, key=lambda i: _table_order(names[i], machine))
    chosen = _independent(candidates.unit, heads)
    dropped = [i for i in heads if i not in chosen]
    # A column holds the readings per unit of a compliance. Express the column of every compliance
    # as a linear combination of the columns of the compliances that are kept as parameters. The
    # columns of the kept compliances are scaled first, to reduce rounding errors.
    scale = np.abs(jacobian[:, chosen]).max(axis=0)
    scaled = np.linalg.lstsq(jacobian[:, chosen] / scale, jacobian, rcond=None)[0]
    coefficients = scaled / scale[:, None]
    relative = scale[:, None] / np.maximum(np.abs(jacobian).max(axis=0), _NULL_SHARE)
    dropped_members: list[int] = []
    for i in dropped:
        dropped_members += set_by_head[i]
    absorbed = []
    for row, size in zip(coefficients, relative, strict=True):
        weights = {}
        for j in dropped_members:
            if abs(row[j] * size[j]) > _ROUNDING_WEIGHT:
                weights[names[j]] = float(np.round(row[j], 9))
        absorbed.append(weights)
    singular = np.linalg.svd(jacobian[:, chosen], compute_uv=False)
    live = list(candidates.live)
    tolerance = _NULL_SHARE * np.sqrt(len(live))
    return Kept(
        names=tuple(names[i] for i in chosen),
        sets=tuple(_labels(names, set_by_head[i]) for i in chosen),
        weights=tuple(_effects_relative_to_first(jacobian, set_by_head[i]) for i in chosen),
        absorbed=tuple(absorbed),
        not_negative=_not_negative(names, jacobian, coefficients),
        null=tuple(name.label for i, name in enumerate(names) if i not in live),
        dependent=_labels(names, dropped),
        rank=int(np.linalg.matrix_rank(candidates.unit[:, live], tol=tolerance)),
        condition_number=float(singular[0] / singular[-1]),
    )


def _labels(names: Sequence[ComplianceName], index: Sequence[int]) -> tuple[str, ...]:
    """Return the printed names, such as C_XXX, of the compliances with the indices ``index``."""
    return tuple(names[i].label for i in index)


def _effects_relative_to_first(jacobian: Array, members: Sequence[int]) -> tuple[float, ...]:
    """Return the effect of each compliance of a set, divided by the effect of the first compliance.

    The compliances of a set change the readings in proportion to each other. ``jacobian`` (n, m)
    holds the readings at n angles per unit of each of m compliances, and ``members`` the indices of
    the compliances of the set.
    """
    head = members[0]
    size = (jacobian**2).sum(axis=0)[head]
    weights = jacobian[:, head] @ jacobian[:, members] / size
    return tuple(np.round(weights, 9).tolist())


def _not_negative(
    names: Sequence[ComplianceName], jacobian: Array, coefficients: Array
) -> tuple[bool, ...]:
    """Return for each kept compliance whether the laws of physics exclude negative values.

    A kept compliance represents a weighted sum Σ_k ⟨A_k, C_k⟩ of the compliance matrices C_k of the
    joints k. A_k are symmetric matrices of weights, all of shape (6, 6), and ⟨ , ⟩ is the sum of
    the products of corresponding elements. A compliance matrix is positive semi-definite. If every
    A_k is positive semi-definite, the weighted sum can therefore not be negative. If at least one
    A_k is not positive semi-definite, the sum can be negative.

    Parameters
    ----------
    names
        Names of m compliances.
    jacobian
        Readings at n angles per unit of each compliance, shape (n, m).
    coefficients
        Weight of each compliance in the sum that each kept compliance represents, shape (number of
        kept compliances, m).
    """
    # The weights of compliances in different units differ by orders of magnitude. Divide them by
    # typical magnitudes of the forces and moments, so that all elements of A_k are comparable.
    unit = dict.fromkeys(COMPONENTS, 1.0)
    for i, name in enumerate(names):
        if name.twist == name.wrench:
            size = float(np.sqrt(np.abs(jacobian[:, i]).max()))
            unit[name.twist] = max(unit[name.twist], size)
    units = np.array([unit[name.twist] * unit[name.wrench] for name in names])
    flags = []
    for row in coefficients:
        matrices = _joint_matrices(names, 0.5 * row / units)
        largest = max(np.abs(matrix).max() for matrix in matrices)
        lowest = min(np.linalg.eigvalsh(matrix).min() for matrix in matrices)
        flags.append(bool(lowest > -_ROUNDING_WEIGHT * largest))
    return tuple(flags)


def _joint_matrices(names: Sequence[ComplianceName], halves: NDArray[np.float64]) -> list[Array]:
    """Return a symmetric matrix of the weights of compliances for each joint, shape (6, 6).

    Rows and columns are in the order X, Y, Z, A, B, C. A compliance relates a motion component i to
    a load component j; its weight is divided equally between the elements (i, j) and (j, i) of the
    matrix. ``halves`` holds, for each compliance in ``names``, half of its weight.
    """
    matrices: dict[str, Array] = {}
    for name, half in zip(names, halves, strict=True):
        matrix = matrices.setdefault(name.joint, np.zeros((6, 6)))
        i = COMPONENTS.index(name.twist)
        j = COMPONENTS.index(name.wrench)
        matrix[i, j] += half
        matrix[j, i] += half
    return list(matrices.values())


def _proportional_sets(candidates: _Candidates) -> list[list[int]]:
    """Return sets of compliances whose effects on the readings are proportional to each other.

    ``candidates`` are all compliances that may change readings. Each set is a list of indices into
    the candidates. The first index belongs to the compliance that represents the set. A compliance
    whose effect is not proportional to any other effect forms a set of its own.
    """
    unit = candidates.unit
    sets: list[list[int]] = []
    for i in candidates.live:
        for members in sets:
            if 1.0 - abs(unit[:, i] @ unit[:, members[0]]) <= _PARALLEL:
                members.append(i)
                break
        else:
            sets.append([i])
    return [sorted(members, key=lambda i: candidates.names[i].preference) for members in sets]


class _TableOrder(NamedTuple):
    """Sort key for the order of compliances in Table 1 of the article on the model."""

    # number of rotary components of the compliance: 0, 1 or 2. A compliance relates a motion to a
    # load; the motion counts if it is a rotation, and the load counts if it is a moment
    rotations: int
    # number for the index i of the compliance C_ijk, which denotes a displacement or rotation: its
    # position in the order that Table 1 of the article on the model uses
    twist: int
    # number for the index j of the compliance C_ijk, which denotes a force or moment: its position
    # in the order that Table 1 of the article on the model uses
    wrench: int
    # number for the index k of the compliance C_ijk, which denotes a joint (machine axis X, Y or
    # Z): its position in the order that Table 1 of the article on the model uses
    joint: int


def _table_order(name: ComplianceName, machine: Machine) -> _TableOrder:
    """Return a sort key that puts compliances in the order of Table 1 of the article on the model.

    Displacements that are caused by forces come first. Next come displacements that are caused by
    moments, and rotations that are caused by forces. Rotations that are caused by moments come
    last. ``name`` is the name of a compliance of ``machine``.
    """
    joints = [joint.axis for joint in machine.joints]
    rigid = [axis for axis in LINEAR if axis not in joints]
    components = [*joints, *rigid, *COMPONENTS[len(LINEAR) :]]
    return _TableOrder(
        name.rotations,
        components.index(name.twist),
        components.index(name.wrench),
        joints.index(name.joint),
    )


def _independent(unit: Array, representatives: Sequence[int]) -> list[int]:
    """Return the indices of compliances whose effects on the readings are linearly independent.

    The compliances are examined in the order of ``representatives``, which holds their indices. A
    compliance is left out if its effect is a linear combination of the effects of compliances that
    were chosen before. ``unit``, shape (n, m), has one column for each of m compliances. A column
    holds the readings at n angles, scaled to length one.
    """
    chosen: list[int] = []
    basis = np.zeros((unit.shape[0], 0))
    for i in representatives:
        remainder = unit[:, i] - basis @ (basis.T @ unit[:, i])
        if np.linalg.norm(remainder) > _INDEPENDENT:
            chosen.append(i)
            basis = np.linalg.qr(unit[:, chosen])[0]
    return chosen


def hybrid_jacobian(
    machine: Machine,
    circle: Circle,
    angle_rad: Array,
    force_N: float,
    *,
    degree: int = 0,
    reference_force_N: float = 0.0,
) -> pd.DataFrame:
    """Return the reading per unit of every parameter of the model, for one circle.

    The parameters are compliances, their slopes and geometric errors. The table is the matrix J_H
    of Eq. 28 of the article on the model; with the reference force F0 = 0, it is also J_H of Eq.
    33. The column of a compliance is F j_C, where j_C is the reading per unit force and compliance.
    A slope of degree k is a change of the compliance with force; its column is F (F − F0)^k j_C.
    The compliances are those that this circle alone can separate. Columns are named like the
    parameters in the results of a fit: first compliances such as C_XXX, then slopes such as
    C_XXX_1, then geometric errors such as E_XX1.

    Parameters
    ----------
    machine : Machine
        Machine of the test.
    circle : Circle
        Nominal circle of the test.
    angle_rad : ndarray
        Angles θ of the bar from the first axis of the plane, shape (n,) [rad].
    force_N : float
        Radial force F of the bar [N].
    degree : int, default 0
        Degree of the compliance as a polynomial in the force: 0 (constant), 1 (linear) or 2
        (quadratic).
    reference_force_N : float, default 0.0
        Reference force F0 [N].

    Returns
    -------
    pandas.DataFrame
        Table of n rows and one column per parameter. Readings are in mm; the unit of a parameter,
        such as mm/N, is a product of powers of mm, N and rad.

    Raises
    ------
    InputError
        If the degree is not 0, 1 or 2, or ``circle`` is not a `Circle`.

    Examples
    --------
    >>> machine, circle = lb.Machine(), lb.machine.Circle()
    >>> angle_rad = np.deg2rad([0.0, 45.0])
    >>> columns = lb.machine.hybrid_jacobian(machine, circle, angle_rad, 50.0, degree=1)
    >>> columns[["C_XXX", "C_XXX_1", "E_XX1"]].round(3)
       C_XXX  C_XXX_1  E_XX1
    0     50     2500    150
    1     25     1250     75
    """
    require(
        isinstance(circle, Circle),
        f"circle must be a Circle, got {type(circle).__name__}. Give"
        " lb.machine.Circle(radius_mm=150.0).",
    )
    require(
        degree in (0, 1, 2),
        f"degree must be 0, 1 or 2, got {degree!r}."
        " Choose constant, linear or quadratic compliance.",
    )
    angle = np.asarray(angle_rad, dtype=float)
    compliances = kept_compliances(machine, circle).names
    elastic = force_N * compliance_jacobian(machine, circle, angle, compliances)
    columns: dict[str, Array] = {}
    for k in range(degree + 1):
        suffix = f"_{k}" if k else ""
        for j, compliance in enumerate(compliances):
            column = elastic[:, j] * (force_N - reference_force_N) ** k
            columns[compliance.label + suffix] = column
    geometric = geometric_jacobian(machine, circle, angle)
    for j, error in enumerate(geometric_names(machine)):
        columns[error.label] = geometric[:, j]
    return readable(pd.DataFrame(columns))


def patterns(machine: Machine, circle: Circle, angle_rad: Array) -> pd.DataFrame:
    """Return the readings per unit of every planar compliance and geometric error.

    For one plane, the table holds the 18 compliances of Table 2 and the 7 errors of Table 3 of the
    paper.

    Parameters
    ----------
    machine : Machine
        Machine of the test.
    circle : Circle
        Nominal circle of the test.
    angle_rad : ndarray
        Angles θ of the bar from the first axis of the plane, shape (n,) [rad].

    Returns
    -------
    pandas.DataFrame
        Table of n rows, with 25 columns for one plane. Columns of geometric errors are in mm per
        unit of the error, columns of compliances in mm per newton and per unit of the compliance.

    Examples
    --------
    >>> angle_rad = np.deg2rad([0.0, 45.0])
    >>> columns = lb.machine.patterns(lb.Machine(), lb.machine.Circle(), angle_rad)
    >>> columns.shape
    (2, 25)
    >>> columns[["C_XXX", "E_C0YX"]].round(3)
       C_XXX  E_C0YX
    0      1       0
    1    0.5      75
    """
    angle = np.asarray(angle_rad, dtype=float)
    names = [name.label for name in wrench_names(machine)]
    names += [name.label for name in geometric_names(machine)]
    elastic = wrench_jacobian(machine, circle, angle)
    geometric = geometric_jacobian(machine, circle, angle)
    return readable(pd.DataFrame(np.hstack([elastic, geometric]), columns=names))
