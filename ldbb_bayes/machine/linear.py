"""The linear hybrid Jacobian, and the compliances that circles can separate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from ldbb_bayes.errors import require
from ldbb_bayes.machine.chain import LINEAR, ROTARY, Circle, Joint, Machine
from ldbb_bayes.machine.parameters import (
    _COMPONENTS,
    ComplianceName,
    GeometricName,
    geometric_names,
    joint_names,
    wrench_names,
)
from ldbb_bayes.results import Array, readable

__all__ = [
    "Kept",
    "compliance_jacobian",
    "geometric_jacobian",
    "hybrid_jacobian",
    "kept_compliances",
    "patterns",
    "wrench_jacobian",
]

if TYPE_CHECKING:
    import pandas as pd


def wrench_jacobian(machine: Machine, circle: Circle, angle_rad: Array) -> Array:
    """The paper's planar wrench Jacobian: reading per unit force and unit compliance, shape (n, 18)
    for one plane. Columns in the order of `wrench_names` [1, mm or mm²]; times F [N] and C they
    give the reading [mm]."""
    return compliance_jacobian(machine, circle, angle_rad, wrench_names(machine))


def compliance_jacobian(
    machine: Machine, circle: Circle, angle_rad: Array, names: Sequence[ComplianceName]
) -> Array:
    """Reading per unit force and unit compliance, Eq. 20-23, at angles (n,) [rad], of any of
    `joint_names`, shape (n, compliances) [1, mm or mm²]."""
    direction = circle.direction(angle_rad)
    joints = {name.joint for name in names}
    wrench = {
        axis: _wrench(machine.lever_mm(machine.joint(axis), circle, angle_rad), direction)
        for axis in joints
    }
    columns = np.zeros((len(angle_rad), len(names)))
    for k, name in enumerate(names):
        own = wrench[name.joint]
        columns[:, k] = (
            own[:, _COMPONENTS.index(name.twist)] * own[:, _COMPONENTS.index(name.wrench)]
        )
    return columns


def geometric_jacobian(machine: Machine, circle: Circle, angle_rad: Array) -> Array:
    """Reading per unit geometric error, Eq. 16-18, shape (n, geometric errors): columns in the
    order of `geometric_names` [mm per unit of the error]."""
    return np.stack(
        [_error_column(machine, circle, angle_rad, name) for name in geometric_names(machine)],
        axis=1,
    )


def _error_column(machine: Machine, circle: Circle, angle_rad: Array, name: GeometricName) -> Array:
    direction = circle.direction(angle_rad)
    component = _COMPONENTS.index(name.component)
    if name.kind == "offset":
        return direction[:, component]
    joint, before = _bearer(machine, name)
    lever = machine.lever_mm(joint, circle, angle_rad)
    coordinate = joint.sign * circle.position_mm(angle_rad)[:, joint.index]
    if before:
        lever[:, joint.index] += coordinate
    return joint.sign * coordinate**name.order * _wrench(lever, direction)[:, component]


def _bearer(machine: Machine, name: GeometricName) -> tuple[Joint, bool]:
    """The joint at which an error sits, and whether it comes before the joint's own motion. A
    squareness turns what the primary axis carries when both axes are in one branch; else it turns
    the secondary axis itself."""
    if name.kind != "squareness":
        return machine.joint(name.axis), False
    primary = machine.joint(name.reference)
    secondary = machine.joint(name.axis)
    return (primary, False) if primary.branch == secondary.branch else (secondary, True)


def _wrench(lever: Array, direction: Array) -> Array:
    return np.concatenate([direction, np.cross(lever, direction)], axis=1)


_ANGLES = 64


_PARALLEL = 1e-10


_TINY = 1e-10


_TINY_WEIGHT = 1e-7


_NEW = 1e-8


@dataclass(frozen=True)
class Kept:
    """What remains of the wrench Jacobian. The weights of a set are the pattern of each member in
    units of the representative's [mm or mm² per rotation more]."""

    #: one representative per proportional set, in the order of Table 1
    names: tuple[ComplianceName, ...]
    #: proportional sets (Table 2), whose weighted sums the kept ones are, representative first
    sets: tuple[tuple[str, ...], ...]
    weights: tuple[tuple[float, ...], ...]
    #: what each stands for beside its set: dropped sets, with weights
    absorbed: tuple[Mapping[ComplianceName, float], ...]
    #: a deflection under the load itself, whatever the joints' (semi-definite) matrices are
    not_negative: tuple[bool, ...]
    null: tuple[str, ...]  #: never change a reading
    dependent: tuple[str, ...]  #: heads of sets that are combinations of several others
    rank: int  #: of the full Jacobian: unit force, full uniform circle, unscaled (mm, N)
    condition_number: float  #: of the kept columns


def kept_compliances(machine: Machine, *circles: Circle) -> Kept:
    """Null columns, proportional sets and representatives of the wrench Jacobian (Table 2), found
    numerically.

    The planar compliances of every plane are looked at, and of the others those that the circles'
    lever arms load. In a set the representative is chosen by these rules, in this order; for the
    paper's machine they give the paper's choice:

    1. a rotation for a force before a translation for a moment;
    2. the fewest rotations;
    3. the joint whose axis is the deflection;
    4. of a rotation, a joint that drives the plane it turns;
    5. alphabetical order.

    The circles of a campaign are taken together: another centre or plane can separate compliances
    that one circle cannot. Default: R = 150 mm about the frames' origin in every plane.
    """
    return _kept(machine, circles or tuple(Circle(plane=plane) for plane in machine.planes))


@lru_cache(maxsize=64)
def _kept(machine: Machine, circles: tuple[Circle, ...]) -> Kept:
    angle = np.arange(_ANGLES) * (2 * np.pi / _ANGLES)
    planar = set(wrench_names(machine))
    names = joint_names(machine)
    jacobian = np.concatenate(
        [compliance_jacobian(machine, circle, angle, names) for circle in circles]
    )
    unit = jacobian / [circles[0].radius_mm ** name.rotations for name in names]
    norms = np.linalg.norm(unit, axis=0)
    used = [i for i in range(len(names)) if norms[i] > _TINY * norms.max() or names[i] in planar]
    used.sort(key=lambda i: (names[i] not in planar, i))
    names = tuple(names[i] for i in used)
    jacobian = jacobian[:, used]
    unit = unit[:, used]
    norms = norms[used]
    live = [i for i in range(len(names)) if norms[i] > _TINY * norms.max()]
    unit = unit / np.where(norms > 0, norms, 1.0)
    by_head = {group[0]: group for group in _proportional_sets(unit, live, names)}
    heads = sorted(by_head, key=lambda i: _table_order(names[i], machine))
    chosen = _independent(unit, heads)
    dropped = [i for i in heads if i not in chosen]
    singular = np.linalg.svd(jacobian[:, chosen], compute_uv=False)
    scale = np.abs(jacobian[:, chosen]).max(axis=0)
    coefficients = (
        np.linalg.lstsq(jacobian[:, chosen] / scale, jacobian, rcond=None)[0] / scale[:, None]
    )
    sizes = (jacobian**2).sum(axis=0)
    relative = scale[:, None] / np.maximum(np.abs(jacobian).max(axis=0), _TINY)
    return Kept(
        names=tuple(names[i] for i in chosen),
        sets=tuple(tuple(names[j].label for j in by_head[i]) for i in chosen),
        weights=tuple(
            tuple(np.round(jacobian[:, i] @ jacobian[:, by_head[i]] / sizes[i], 9).tolist())
            for i in chosen
        ),
        absorbed=tuple(
            {
                names[j]: float(np.round(row[j], 9))
                for i in dropped
                for j in by_head[i]
                if abs(row[j] * size[j]) > _TINY_WEIGHT
            }
            for row, size in zip(coefficients, relative, strict=True)
        ),
        not_negative=_not_negative(names, jacobian, coefficients),
        null=tuple(name.label for i, name in enumerate(names) if i not in live),
        dependent=tuple(names[i].label for i in dropped),
        rank=int(np.linalg.matrix_rank(unit[:, live], tol=_TINY * np.sqrt(len(live)))),
        condition_number=float(singular[0] / singular[-1]),
    )


def _not_negative(
    names: Sequence[ComplianceName], jacobian: Array, coefficients: Array
) -> tuple[bool, ...]:
    """A kept compliance is Σ_k ⟨A_k, C_k⟩ over the joints' matrices, all columns written in those
    kept: it cannot be negative for positive semi-definite C_k if and only if every A_k is positive
    semi-definite."""
    six = LINEAR + ROTARY
    unit = dict.fromkeys(LINEAR + ROTARY, 1.0)
    for i, name in enumerate(names):
        if name.twist == name.wrench:
            unit[name.twist] = max(unit[name.twist], float(np.sqrt(np.abs(jacobian[:, i]).max())))
    found = []
    for row in coefficients:
        joints: dict[str, Array] = {}
        for name, value in zip(names, row, strict=True):
            matrix = joints.setdefault(name.joint, np.zeros((6, 6)))
            i = six.index(name.twist)
            j = six.index(name.wrench)
            weight = 0.5 * value / (unit[name.twist] * unit[name.wrench])
            matrix[i, j] += weight
            matrix[j, i] += weight
        largest = max(np.abs(matrix).max() for matrix in joints.values())
        found.append(
            all(
                np.linalg.eigvalsh(matrix).min() > -_TINY_WEIGHT * largest
                for matrix in joints.values()
            )
        )
    return tuple(found)


def _proportional_sets(
    unit: Array, live: Sequence[int], names: Sequence[ComplianceName]
) -> list[list[int]]:
    """Group columns that are multiples of one another; the preferred name leads its set."""
    sets: list[list[int]] = []
    for i in live:
        same = (group for group in sets if 1.0 - abs(unit[:, i] @ unit[:, group[0]]) <= _PARALLEL)
        if (group := next(same, None)) is None:
            sets.append([i])
        else:
            group.append(i)
    return [sorted(group, key=lambda i: names[i].preference) for group in sets]


def _table_order(name: ComplianceName, machine: Machine) -> tuple[int, int, int, int]:
    """Order of Table 1: translations for forces, rotations for forces, rotation for moment; joints
    in the planes' order."""
    joints = [joint.axis for joint in machine.joints]
    components = [*joints, *(axis for axis in LINEAR if axis not in joints), *ROTARY]
    return (
        name.rotations,
        components.index(name.twist),
        components.index(name.wrench),
        joints.index(name.joint),
    )


def _independent(unit: Array, representatives: Sequence[int]) -> list[int]:
    """Representatives in order that each add a new direction."""
    chosen: list[int] = []
    basis = np.zeros((unit.shape[0], 0))
    for i in representatives:
        if np.linalg.norm(unit[:, i] - basis @ (basis.T @ unit[:, i])) > _NEW:
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
    """Return the reading per unit of every parameter of the linear hybrid model, J_H of Eq. 28 and,
    with F0 = 0, 33: DataFrame, shape (n, (degree + 1) compliances + geometric errors) [mm per
    inside unit of the parameter].

    Column k of a compliance is F (F − F0)^k j_C. Columns are those of this circle alone, named as
    in results: C_XXX …, C_XXX_1 …, then E_XX1 … . InputError for a degree other than 0, 1 or 2.

    Parameters
    ----------
    circle, angle_rad : where: angles θ, shape (n,) [rad].
    force_N, reference_force_N : radial force F, and F0.
    degree : 0, 1 or 2.
    """
    import pandas as pd

    require(
        degree in (0, 1, 2),
        f"degree must be 0, 1 or 2, got {degree}. Choose constant, linear or quadratic compliance.",
    )
    angle = np.asarray(angle_rad, dtype=float)
    kept = kept_compliances(machine, circle).names
    elastic = force_N * compliance_jacobian(machine, circle, angle, kept)
    columns = {
        name.label + (f"_{k}" if k else ""): elastic[:, j] * (force_N - reference_force_N) ** k
        for k in range(degree + 1)
        for j, name in enumerate(kept)
    }
    geometric = geometric_jacobian(machine, circle, angle).T
    columns |= {
        name.label: own for name, own in zip(geometric_names(machine), geometric, strict=True)
    }
    return readable(pd.DataFrame(columns))


def patterns(machine: Machine, circle: Circle, angle_rad: Array) -> pd.DataFrame:
    """Return what one unit of every planar compliance, 18 for one plane, and of every geometric
    error, 7, does to readings of a ``circle`` at ``angle_rad`` (n,): DataFrame, shape (n, 25) [mm
    per unit, and N of compliances] (Tables 2 and 3)."""
    import pandas as pd

    angle = np.asarray(angle_rad, dtype=float)
    names = [
        *(name.label for name in wrench_names(machine)),
        *(name.label for name in geometric_names(machine)),
    ]
    values = np.hstack(
        [wrench_jacobian(machine, circle, angle), geometric_jacobian(machine, circle, angle)]
    )
    return readable(pd.DataFrame(values, columns=names))
