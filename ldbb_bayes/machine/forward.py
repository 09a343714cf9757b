"""The exact reading of the bar by homogeneous transforms (Eq. 1-14), with compliance deflections by Eq. 20.

ρ = ‖P_tool − P_work‖ − R, each ball carried by its branch: foundation → joint frames → motions → errors → ball.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.errors import check_known
from ldbb_bayes.machine.chain import Branch, Circle, Joint, Machine
from ldbb_bayes.machine.jacobian import geometric_names, wrench_jacobian, wrench_names

__all__ = ["exact_reading_mm", "geometric_reading_mm"]

Array = NDArray[Any]


def exact_reading_mm(
    machine: Machine,
    circle: Circle,
    angle_rad: Array,
    *,
    force_N: float = 0.0,
    compliances: Mapping[str, float] | None = None,
    geometric_errors: Mapping[str, float] | None = None,
) -> Array:
    """Exact reading of one circle: geometry by Eq. 1-14 plus compliance by Eq. 20.

    Parameters
    ----------
    angle_rad : ndarray, shape (n,) [rad]
    force_N : float [N]
    compliances : mapping, optional
        Any of the 18 ``C_ijk`` [mm/N, rad/N, rad/(N mm)].
    geometric_errors : mapping, optional
        Any of `geometric_names` [1, 1/mm, rad, mm].

    Returns
    -------
    ndarray, shape (n,) [mm]

    Raises
    ------
    InputError
        For a parameter this machine does not have.
    """
    labels = [name.label for name in wrench_names(machine)]
    values = _vector(labels, compliances or {})
    elastic = force_N * wrench_jacobian(machine, circle, angle_rad) @ values
    return geometric_reading_mm(machine, circle, angle_rad, geometric_errors or {}) + elastic


def geometric_reading_mm(machine: Machine, circle: Circle, angle_rad: Array, geometric_errors: Mapping[str, Any]) -> Array:
    """Exact geometric part of the reading (Eq. 13-14), shape (n,) [mm]. Complex errors are allowed (complex step)."""
    errors = _vector(geometric_names(machine), geometric_errors)
    position = circle.position_mm(angle_rad)
    n = len(angle_rad)
    tool = _branch(machine, "tool", position, errors) @ _translation(n, errors[5], errors[6])
    work = _branch(machine, "workpiece", position, errors) @ _translation(n, *circle.centre_mm)
    gap = tool[:, :2, 3] - work[:, :2, 3]
    distance: Array = np.sqrt(gap[:, 0] ** 2 + gap[:, 1] ** 2)
    return distance - circle.radius_mm


def _branch(machine: Machine, branch: Branch, position: Array, errors: Array) -> Array:
    """Transform from the foundation to the end of a branch, shape (n, 4, 4)."""
    transform = np.broadcast_to(np.eye(4, dtype=errors.dtype), (len(position), 4, 4))
    joints = [joint for joint in machine.joints if joint.branch == branch]
    for joint in sorted(joints, key=lambda joint: len(machine.carried_by(joint)), reverse=True):
        transform = transform @ _joint(machine, joint, position, errors)
    return transform


def _joint(machine: Machine, joint: Joint, position: Array, errors: Array) -> Array:
    """One joint: its nominal motion followed by its error motion (Eq. 4-5, 8-9), about its own frame."""
    n = len(position)
    coordinate = joint.sign * position[:, joint.index]
    motion = [np.zeros(n), np.zeros(n)]
    motion[joint.index] = coordinate
    gain, straightness = (errors[0], errors[1]) if joint.index == 0 else (errors[3], errors[2])
    error = [gain * coordinate, straightness * coordinate**2]
    if joint.index == 1:
        error.reverse()
    same_branch = machine.primary.branch == machine.secondary.branch
    squareness = errors[4]
    turn_after = squareness if same_branch and joint == machine.primary else 0.0
    turn_before = squareness if not same_branch and joint == machine.secondary else 0.0
    frame, back = _translation(n, *joint.frame_mm), _translation(n, *(-c for c in joint.frame_mm))
    moved = _rotation(n, turn_before, errors.dtype) @ _translation(n, *motion) @ _translation(n, *error)
    return frame @ moved @ _rotation(n, turn_after, errors.dtype) @ back


def _translation(n: int, first: Any, second: Any) -> Array:
    first, second = np.asarray(first), np.asarray(second)
    transform = np.zeros((n, 4, 4), dtype=np.result_type(first, second, float))
    transform[:] = np.eye(4)
    transform[:, 0, 3] = first
    transform[:, 1, 3] = second
    return transform


def _rotation(n: int, angle: Any, dtype: Any) -> Array:
    transform = np.zeros((n, 4, 4), dtype=dtype)
    transform[:] = np.eye(4)
    cosine, sine = np.cos(angle), np.sin(angle)
    transform[:, 0, 0] = transform[:, 1, 1] = cosine
    transform[:, 0, 1], transform[:, 1, 0] = -sine, sine
    return transform


def _vector(names: Any, values: Mapping[str, Any]) -> Array:
    check_known("parameter", values, names)
    vector: Array = np.array([values.get(name, 0.0) for name in names])
    return vector.astype(np.result_type(vector, float))
