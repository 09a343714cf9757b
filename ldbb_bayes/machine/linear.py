"""The linear hybrid Jacobian, and the compliances that circles can separate.

A unit force along the bar, whose direction is B̂, loads joint k with the wrench g_k = J_kᵀ B̂ =
(B̂, lever × B̂), shape (6,): three forces and three moments about the joint's frame. J_k is the
Jacobian of the joint. By Eq. 20 a compliance C_ijk (twist component i for wrench component j at
joint k) changes the reading by g_k,i · g_k,j per unit force. An error motion of joint k, a twist e
about the same frame, changes the reading by g_k · e in the tool branch and −g_k · e in the
workpiece branch (Eq. 16-23). If all lever arms lie in the plane, this is the paper's planar model.

Circles cannot separate all compliances (Table 2). Some never change a reading (null columns), and
some change readings proportionally (proportional sets). One representative of each set is kept.
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

# Angles of the full circle on which columns are compared.
_ANGLES = 64
# Two columns are proportional if |cosine| of the angle between them is at least 1 minus this.
_PARALLEL = 1e-10
# Columns smaller than this share of the largest are null.
_NULL_SHARE = 1e-10
# Weights below this share of the largest are rounding errors.
_ROUNDING_WEIGHT = 1e-7
# A column is independent of others if its remainder after projection on them is larger.
_INDEPENDENT = 1e-8


class ErrorBearer(NamedTuple):
    """The joint at which a geometric error acts."""

    joint: Joint
    before_motion: bool  #: whether the error comes before the joint's own motion


def wrench_jacobian(machine: Machine, circle: Circle, angle_rad: Array) -> Array:
    """Return the paper's planar wrench Jacobian, shape (n, 18) for one plane [1, mm or mm²].

    It is the reading per unit force and unit compliance. Columns are in the order of
    `wrench_names`.
    """
    return compliance_jacobian(machine, circle, angle_rad, wrench_names(machine))


def compliance_jacobian(
    machine: Machine, circle: Circle, angle_rad: Array, names: Sequence[ComplianceName]
) -> Array:
    """Return the reading per unit force and unit compliance (Eq. 20-23).

    Parameters
    ----------
    machine, circle
        Machine and nominal circle of the test.
    angle_rad
        Angles θ, shape (n,) [rad].
    names
        Compliances, any of `joint_names`, one for each column.

    Returns
    -------
    Jacobian, shape (n, compliances) [1, mm or mm²].
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
    """Return the reading per unit geometric error, Eq. 16-18, shape (n, geometric errors).

    Columns are in the order of `geometric_names` [mm per unit of the error].
    """
    columns = [_error_column(machine, circle, angle_rad, name) for name in geometric_names(machine)]
    return np.stack(columns, axis=1)


def _error_column(machine: Machine, circle: Circle, angle_rad: Array, name: GeometricName) -> Array:
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
    """Return the joint at which a geometric error acts.

    If both axes of a squareness error are in one branch, the error acts after the motion of the
    primary (reference) axis; else it acts before the motion of the secondary axis.
    """
    if name.kind != "squareness":
        return ErrorBearer(machine.joint(name.axis), before_motion=False)
    primary = machine.joint(name.reference)
    secondary = machine.joint(name.axis)
    if primary.branch == secondary.branch:
        return ErrorBearer(primary, before_motion=False)
    return ErrorBearer(secondary, before_motion=True)


def _wrench(lever: Array, direction: Array) -> Array:
    """Return forces and moments of a unit force along the bar, shape (n, 6)."""
    return np.concatenate([direction, np.cross(lever, direction)], axis=1)


@dataclass(frozen=True)
class Kept:
    """The compliances that circles can separate, and the others that each one represents."""

    #: one representative per proportional set, in the order of Table 1
    names: tuple[ComplianceName, ...]
    #: for each kept compliance: its proportional set (Table 2), itself first; the readings
    #: determine the weighted sum of a set
    sets: tuple[tuple[str, ...], ...]
    #: weights of the members of the sets: the column of a member divided by that of its
    #: representative [mm to the number of additional rotations]
    weights: tuple[tuple[float, ...], ...]
    #: for each kept compliance: the members of dropped sets that it also represents, with weights
    absorbed: tuple[Mapping[ComplianceName, float], ...]
    #: whether each kept compliance cannot be negative, because it is a deflection in the direction
    #: of the load itself, if the joints' compliance matrices are positive semi-definite
    not_negative: tuple[bool, ...]
    null: tuple[str, ...]  #: compliances that never change a reading
    #: representatives of dropped sets: their columns are combinations of several others
    dependent: tuple[str, ...]
    rank: int  #: rank of the Jacobian of all compliances on full uniform circles
    condition_number: float  #: condition number of the kept columns


def kept_compliances(machine: Machine, *circles: Circle) -> Kept:
    """Return the compliances that circles can separate, and the sets they represent (Table 2).

    They are found numerically from the columns of the wrench Jacobian. The planar
    compliances of every plane are examined, and those of the others that the circles' lever arms
    load. The representative of a set is chosen by these rules, in this order; for the paper's
    machine they give the paper's choice:

    1. a rotation caused by a force before a translation caused by a moment;
    2. the fewest rotary components;
    3. the joint whose axis is the direction of the deflection;
    4. for a rotation, a joint that drives the plane in which it turns;
    5. alphabetical order.

    The circles of a campaign are taken as one set of readings: another centre or plane can separate
    compliances that one circle cannot. Default: R = 150 mm about the frames' origin in every plane.
    """
    if not circles:
        circles = tuple(Circle(plane=plane) for plane in machine.planes)
    return _kept_compliances(machine, circles)


@dataclass(frozen=True, eq=False)
class _Candidates:
    """Compliances that circles may show, with their n readings per unit on full circles."""

    names: tuple[ComplianceName, ...]
    jacobian: Array  #: columns of the compliances, shape (n, candidates)
    unit: Array  #: columns divided by their norms; zero for null columns
    live: tuple[int, ...]  #: indices of the columns that are not null


def _candidates(machine: Machine, circles: tuple[Circle, ...]) -> _Candidates:
    """Return the planar compliances, and of the others those that the lever arms load."""
    angle = np.arange(_ANGLES) * (2 * np.pi / _ANGLES)
    names = joint_names(machine)
    jacobian = np.concatenate(
        [compliance_jacobian(machine, circle, angle, names) for circle in circles]
    )
    # Divide by the radius for each rotary component: then all columns are of comparable size.
    unit = jacobian / [circles[0].radius_mm ** name.rotations for name in names]
    norms = np.linalg.norm(unit, axis=0)
    planar = set(wrench_names(machine))
    index = [i for i, name in enumerate(names) if name in planar]
    loaded = norms > _NULL_SHARE * norms.max()
    index += [i for i, name in enumerate(names) if name not in planar and loaded[i]]
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
    candidates = _candidates(machine, circles)
    names = candidates.names
    jacobian = candidates.jacobian
    set_by_head = {members[0]: members for members in _proportional_sets(candidates)}
    heads = sorted(set_by_head, key=lambda i: _table_order(names[i], machine))
    chosen = _independent(candidates.unit, heads)
    dropped = [i for i in heads if i not in chosen]
    # Express every column by the kept ones, which are scaled to reduce rounding errors.
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
        weights=tuple(_weights(jacobian, set_by_head[i]) for i in chosen),
        absorbed=tuple(absorbed),
        not_negative=_not_negative(names, jacobian, coefficients),
        null=tuple(name.label for i, name in enumerate(names) if i not in live),
        dependent=_labels(names, dropped),
        rank=int(np.linalg.matrix_rank(candidates.unit[:, live], tol=tolerance)),
        condition_number=float(singular[0] / singular[-1]),
    )


def _labels(names: Sequence[ComplianceName], index: Sequence[int]) -> tuple[str, ...]:
    return tuple(names[i].label for i in index)


def _weights(jacobian: Array, members: Sequence[int]) -> tuple[float, ...]:
    """Return the column of each member of a set as a multiple of the first member's column."""
    head = members[0]
    size = (jacobian**2).sum(axis=0)[head]
    weights = jacobian[:, head] @ jacobian[:, members] / size
    return tuple(np.round(weights, 9).tolist())


def _not_negative(
    names: Sequence[ComplianceName], jacobian: Array, coefficients: Array
) -> tuple[bool, ...]:
    """Return which kept compliances cannot be negative.

    A kept compliance with its set is a linear function Σ_k ⟨A_k, C_k⟩ of the compliance matrices
    C_k of the joints k, with symmetric matrices of weights A_k, all of shape (6, 6); ⟨ , ⟩ is the
    sum of the products of entries. It is never negative for positive semi-definite C_k if and only
    if every A_k is positive semi-definite.
    """
    # Typical size of each component's wrench, so that the entries of A_k are comparable.
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
    """Return the symmetric matrices A_k of all joints, shape (6, 6) each, from halved weights."""
    matrices: dict[str, Array] = {}
    for name, half in zip(names, halves, strict=True):
        matrix = matrices.setdefault(name.joint, np.zeros((6, 6)))
        i = COMPONENTS.index(name.twist)
        j = COMPONENTS.index(name.wrench)
        matrix[i, j] += half
        matrix[j, i] += half
    return list(matrices.values())


def _proportional_sets(candidates: _Candidates) -> list[list[int]]:
    """Return sets of columns that are multiples of one another, each led by the preferred name."""
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
    """Sort key for the order of compliances in Table 1 of the paper."""

    rotations: int
    twist: int
    wrench: int
    joint: int


def _table_order(name: ComplianceName, machine: Machine) -> _TableOrder:
    """Return the sort key of a compliance for the order of Table 1.

    Translations caused by forces come first, then rotations caused by forces, then rotations caused
    by moments. Joints are in the order of the planes' axes.
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
    """Return the representatives whose columns do not depend linearly on those before them."""
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
    """Return the reading per unit of every parameter of the linear hybrid model.

    This is J_H of Eq. 28 and, with reference force F0 = 0, of Eq. 33. The column of a compliance
    and of its slope of degree k is F (F − F0)^k j_C, where j_C is the reading per unit force and
    compliance. The compliances are those that this circle alone can separate. Columns are named as
    in results: C_XXX …, C_XXX_1 …, then E_XX1 … . Equations are those of the paper.

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
        Degree of the compliance in force: 0 (constant), 1 (linear) or 2 (quadratic).
    reference_force_N : float, default 0.0
        Reference force F0 [N].

    Returns
    -------
    pandas.DataFrame
        Table of n rows and one column per parameter [mm per internal unit (mm, N, rad) of the
        parameter].

    Raises
    ------
    InputError
        For a degree other than 0, 1 or 2.

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

    For one plane these are the 18 compliances of Table 2 and the 7 errors of Table 3 of the paper.

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
        Table of n rows, with 25 columns for one plane [mm per unit of a geometric error; for
        compliances, mm per unit and newton].

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
