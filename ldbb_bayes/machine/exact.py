"""The exact forward model of a circular test."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ldbb_bayes.errors import check_known
from ldbb_bayes.machine.chain import LINEAR, ROTARY, Branch, Circle, Joint, Machine
from ldbb_bayes.machine.linear import _bearer, compliance_jacobian
from ldbb_bayes.machine.parameters import (
    geometric_names,
    joint_names,
)
from ldbb_bayes.results import Array
from ldbb_bayes.units import inside_name

__all__ = ["exact_reading_mm", "geometric_reading_mm"]


def exact_reading_mm(
    machine: Machine,
    circle: Circle,
    angle_rad: Array,
    *,
    force_N: float = 0.0,
    compliances: Mapping[str, float] | None = None,
    geometric_errors: Mapping[str, float] | None = None,
) -> Array:
    """Return the exact reading of one circle, shape (n,) [mm]: geometry by Eq. 1-14 plus compliance
    by Eq. 20.

    InputError for names that the machine does not have.

    Parameters
    ----------
    circle, angle_rad : where: angles θ, shape (n,) [rad].
    force_N : radial force.
    compliances : any of the 36 ``C_ijk`` of each joint [mm/N, rad/N, rad/(N mm)]; the others are
        zero.
    geometric_errors : any of `geometric_names` [1, 1/mm, rad, mm]; the others are zero.
    """
    given = compliances or {}
    every = {name.label: name for name in joint_names(machine)}
    check_known("parameter", given, tuple(every))
    columns = compliance_jacobian(machine, circle, angle_rad, [every[label] for label in given])
    elastic = force_N * columns @ np.array(list(given.values()), dtype=float)
    errors = {inside_name(name): value for name, value in (geometric_errors or {}).items()}
    return geometric_reading_mm(machine, circle, angle_rad, errors) + elastic


def geometric_reading_mm(
    machine: Machine, circle: Circle, angle_rad: Array, geometric_errors: Mapping[str, Any]
) -> Array:
    """Exact geometric part of the reading (Eq. 13-14), shape (n,) [mm]. Complex errors are allowed
    (complex step)."""
    check_known("parameter", geometric_errors, [name.label for name in geometric_names(machine)])
    tool = _branch(machine, "tool", circle, angle_rad, geometric_errors)
    work = _branch(machine, "workpiece", circle, angle_rad, geometric_errors)
    offset = np.array([geometric_errors.get(f"E_{axis}t0", 0.0) for axis in LINEAR])
    tool = tool @ _translation(machine.end_mm("tool", circle, angle_rad) + offset)
    work = work @ _translation(machine.end_mm("workpiece", circle, angle_rad))
    gap = tool[:, :3, 3] - work[:, :3, 3]
    distance: Array = np.sqrt((gap**2).sum(axis=1))
    return distance - circle.radius_mm


def _branch(
    machine: Machine, branch: Branch, circle: Circle, angle_rad: Array, errors: Mapping[str, Any]
) -> Array:
    """Transform from the foundation to the end of a branch, shape (n, 4, 4)."""
    transform = np.broadcast_to(np.eye(4), (len(angle_rad), 4, 4))
    position = circle.position_mm(angle_rad)
    for joint in machine.branch(branch):
        transform = transform @ _joint_transform(
            machine, joint, joint.sign * position[:, joint.index], errors
        )
    return transform


def _joint_transform(
    machine: Machine, joint: Joint, coordinate: Array, errors: Mapping[str, Any]
) -> Array:
    """One joint: its nominal motion followed by its error motion (Eq. 4-5, 8-9), about its own
    frame."""
    motion = np.zeros((len(coordinate), 3), dtype=np.result_type(float, *errors.values()))
    motion[:, joint.index] = coordinate
    before = np.eye(4)
    after = np.eye(4)
    for name in geometric_names(machine):
        if name.kind == "offset" or _bearer(machine, name)[0] != joint or name.label not in errors:
            continue
        value = errors[name.label]
        if name.kind == "squareness":
            turn = _rotation(ROTARY.index(name.component), value)
            before, after = (
                (before @ turn, after) if _bearer(machine, name)[1] else (before, after @ turn)
            )
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
    first = (axis + 1) % 3
    second = (axis + 2) % 3
    transform = np.eye(4, dtype=np.result_type(float, angle))
    transform[first, first] = transform[second, second] = np.cos(angle)
    transform[first, second], transform[second, first] = -np.sin(angle), np.sin(angle)
    return transform
