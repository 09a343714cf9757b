"""What the bar reads: exactly by homogeneous transforms (Eq. 1-14), and per unit of every parameter (Eq. 16-23).

For a unit force along the bar, joint k sees the wrench g_k = J_kᵀ B̂ = (B̂, lever × B̂): three forces, three moments about its
frame. By Eq. 20 a compliance C_ijk (twist i for wrench j at joint k) then changes the reading by g_k,i · g_k,j. An error motion
of joint k, a twist e about the same frame, changes it by ± g_k · e, minus in the workpiece branch. The planar model of the paper
is what remains while the levers lie in the plane.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.errors import check_known
from ldbb_bayes.machine.chain import (
    LINEAR,
    ROTARY,
    Branch,
    Circle,
    ComplianceName,
    GeometricName,
    Joint,
    Machine,
    geometric_names,
    joint_names,
    wrench_names,
)

__all__ = ["compliance_jacobian", "exact_reading_mm", "geometric_jacobian", "geometric_reading_mm", "wrench_jacobian"]

Array = NDArray[Any]
_COMPONENTS = LINEAR + ROTARY


def wrench_jacobian(machine: Machine, circle: Circle, angle_rad: Array) -> Array:
    """The paper's planar wrench Jacobian: reading per unit force and unit compliance, shape (n, 18) for one plane.

    Columns in the order of `wrench_names` [1, mm or mm²]; times F [N] and C they give the reading [mm].
    """
    return compliance_jacobian(machine, circle, angle_rad, wrench_names(machine))


def compliance_jacobian(machine: Machine, circle: Circle, angle_rad: Array, names: Sequence[ComplianceName]) -> Array:
    """Reading per unit force and unit compliance, Eq. 20-23, at angles (n,) [rad], of any of `joint_names`, shape
    (n, compliances) [1, mm or mm²]."""
    direction, joints = circle.direction(angle_rad), {name.joint for name in names}
    wrench = {axis: _wrench(machine.lever_mm(machine.joint(axis), circle, angle_rad), direction) for axis in joints}
    columns = np.zeros((len(angle_rad), len(names)))
    for k, name in enumerate(names):
        own = wrench[name.joint]
        columns[:, k] = own[:, _COMPONENTS.index(name.twist)] * own[:, _COMPONENTS.index(name.wrench)]
    return columns


def geometric_jacobian(machine: Machine, circle: Circle, angle_rad: Array) -> Array:
    """Reading per unit geometric error, Eq. 16-18, shape (n, geometric errors): columns in the order of `geometric_names` [mm per
    unit of the error]."""
    return np.stack([_error_column(machine, circle, angle_rad, name) for name in geometric_names(machine)], axis=1)


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
    """The joint at which an error sits, and whether it comes before the joint's own motion.

    A squareness turns what the primary axis carries when both axes are in one branch; else it turns the secondary axis itself.
    """
    if name.kind != "squareness":
        return machine.joint(name.axis), False
    primary, secondary = machine.joint(name.reference), machine.joint(name.axis)
    return (primary, False) if primary.branch == secondary.branch else (secondary, True)


def _wrench(lever: Array, direction: Array) -> Array:
    return np.concatenate([direction, np.cross(lever, direction)], axis=1)


def exact_reading_mm(
    machine: Machine,
    circle: Circle,
    angle_rad: Array,
    *,
    force_N: float = 0.0,
    compliances: Mapping[str, float] | None = None,
    geometric_errors: Mapping[str, float] | None = None,
) -> Array:
    """Exact reading of one circle, shape (n,) [mm]: geometry by Eq. 1-14 plus compliance by Eq. 20, of any of the 36 ``C_ijk`` of
    each joint [mm/N, rad/N, rad/(N mm)] and any of `geometric_names` [1, 1/mm, rad, mm]."""
    given = compliances or {}
    every = {name.label: name for name in joint_names(machine)}
    check_known("parameter", given, tuple(every))
    columns = compliance_jacobian(machine, circle, angle_rad, [every[label] for label in given])
    elastic = force_N * columns @ np.array(list(given.values()), dtype=float)
    return geometric_reading_mm(machine, circle, angle_rad, geometric_errors or {}) + elastic


def geometric_reading_mm(machine: Machine, circle: Circle, angle_rad: Array, geometric_errors: Mapping[str, Any]) -> Array:
    """Exact geometric part of the reading (Eq. 13-14), shape (n,) [mm]. Complex errors are allowed (complex step)."""
    check_known("parameter", geometric_errors, [name.label for name in geometric_names(machine)])
    tool = _branch(machine, "tool", circle, angle_rad, geometric_errors)
    work = _branch(machine, "workpiece", circle, angle_rad, geometric_errors)
    offset = np.array([geometric_errors.get(f"E_{axis}t0", 0.0) for axis in LINEAR])
    tool = tool @ _translation(machine.end_mm("tool", circle, angle_rad) + offset)
    work = work @ _translation(machine.end_mm("workpiece", circle, angle_rad))
    gap = tool[:, :3, 3] - work[:, :3, 3]
    distance: Array = np.sqrt((gap**2).sum(axis=1))
    return distance - circle.radius_mm


def _branch(machine: Machine, branch: Branch, circle: Circle, angle_rad: Array, errors: Mapping[str, Any]) -> Array:
    """Transform from the foundation to the end of a branch, shape (n, 4, 4)."""
    transform = np.broadcast_to(np.eye(4), (len(angle_rad), 4, 4))
    position = circle.position_mm(angle_rad)
    for joint in machine.branch(branch):
        transform = transform @ _joint_transform(machine, joint, joint.sign * position[:, joint.index], errors)
    return transform


def _joint_transform(machine: Machine, joint: Joint, coordinate: Array, errors: Mapping[str, Any]) -> Array:
    """One joint: its nominal motion followed by its error motion (Eq. 4-5, 8-9), about its own frame."""
    motion = np.zeros((len(coordinate), 3), dtype=np.result_type(float, *errors.values()))
    motion[:, joint.index] = coordinate
    before, after = np.eye(4), np.eye(4)
    for name in geometric_names(machine):
        if name.kind == "offset" or _bearer(machine, name)[0] != joint or name.label not in errors:
            continue
        value = errors[name.label]
        if name.kind == "squareness":
            turn = _rotation(ROTARY.index(name.component), value)
            before, after = (before @ turn, after) if _bearer(machine, name)[1] else (before, after @ turn)
        else:
            motion[:, LINEAR.index(name.component)] += value * coordinate**name.order
    frame = np.asarray(joint.frame_mm)[None]
    return _translation(frame) @ before @ _translation(motion) @ after @ _translation(-frame)


def _translation(vector: Array) -> Array:
    """Shape (n, 3) → (n, 4, 4)."""
    transform = np.tile(np.eye(4, dtype=vector.dtype), (len(vector), 1, 1))
    transform[:, :3, 3] = vector
    return transform


def _rotation(axis: int, angle: Any) -> Array:
    """About X, Y or Z, shape (4, 4)."""
    first, second = (axis + 1) % 3, (axis + 2) % 3
    transform = np.eye(4, dtype=np.result_type(float, angle))
    transform[first, first] = transform[second, second] = np.cos(angle)
    transform[first, second], transform[second, first] = -np.sin(angle), np.sin(angle)
    return transform
