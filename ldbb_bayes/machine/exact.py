"""Exact model of the readings of a circular test, with homogeneous transforms.

The equations are Eq. 1-14 of the paper, the article on which the model is based.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ldbb_bayes.errors import check_known
from ldbb_bayes.machine.chain import LINEAR, ROTARY, Branch, Circle, Joint, Machine
from ldbb_bayes.machine.linear import compliance_jacobian, error_bearer
from ldbb_bayes.machine.parameters import geometric_names, joint_names
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
    """Return the exact reading of one circle: geometric part (Eq. 1-14) plus elastic part (Eq. 20).

    The geometric part is the distance between the balls minus the radius. The distance is computed
    with homogeneous transforms of the whole chain. The elastic part is F Σ j_C · C, where F is the
    force, C are the compliances, and j_C is the reading per unit force and per unit of each
    compliance. Equation numbers are those of the article on the model.

    Parameters
    ----------
    machine : Machine
        Machine of the test.
    circle : Circle
        Nominal circle of the test.
    angle_rad : ndarray
        The n angles θ of the bar from the first axis of the plane, shape (n,) [rad].
    force_N : float, default 0.0
        Radial force F of the bar [N].
    compliances : mapping of str to float, optional
        Values of any of the 36 compliances ``C_ijk`` of each joint [mm/N, rad/N, rad/(N mm)]. The
        keys are the names of the compliances. Compliances that are not listed are zero.
    geometric_errors : mapping of str to float, optional
        Values of any geometric errors of the machine. The keys are names such as ``E_XX1``.
        Geometric errors that are not listed are zero. Gains have no unit. Straightness deviations
        are quadratic in the coordinate, with coefficients in 1/mm. Squareness errors are in rad and
        tool offsets in mm.

    Returns
    -------
    ndarray
        Readings, shape (n,) [mm].

    Raises
    ------
    InputError
        If the machine does not have a compliance or geometric error with a given name.

    Examples
    --------
    An X axis with a compliance of 60 nm/N, under a bar force of 500 N along X and at 45° to X:

    >>> lb.machine.exact_reading_mm(
    ...     lb.Machine(),
    ...     lb.machine.Circle(),
    ...     np.deg2rad([0.0, 45.0]),
    ...     force_N=500.0,
    ...     compliances={"C_XXX": 60e-6},
    ... ).round(4)
    array([0.03 , 0.015])
    """
    values = compliances or {}
    name_of = {name.label: name for name in joint_names(machine)}
    check_known("parameter", values, tuple(name_of))
    names = [name_of[label] for label in values]
    columns = compliance_jacobian(machine, circle, angle_rad, names)
    elastic = force_N * columns @ np.array(list(values.values()), dtype=float)
    errors = {inside_name(name): value for name, value in (geometric_errors or {}).items()}
    return geometric_reading_mm(machine, circle, angle_rad, errors) + elastic


def geometric_reading_mm(
    machine: Machine, circle: Circle, angle_rad: Array, geometric_errors: Mapping[str, Any]
) -> Array:
    """Return the exact effect of geometric errors on the reading at n angles, shape (n,) [mm].

    The effect is the distance between the two balls minus the nominal radius (Eq. 13-14 of the
    paper).

    Parameters
    ----------
    machine, circle
        Machine and nominal circle of the test.
    angle_rad
        Angles of the bar from the first axis of the plane, shape (n,) [rad].
    geometric_errors
        Values of geometric errors; the keys are names such as E_XX1. Geometric errors that are not
        listed are zero. Gains have no unit. Straightness deviations are quadratic in the
        coordinate, with coefficients in 1/mm. Squareness errors are in rad and tool offsets in mm.
        Complex values are allowed; they are used to compute derivatives with the complex-step
        method.
    """
    check_known("parameter", geometric_errors, [name.label for name in geometric_names(machine)])
    tool = _branch_transform(machine, "tool", circle, angle_rad, geometric_errors)
    work = _branch_transform(machine, "workpiece", circle, angle_rad, geometric_errors)
    offset = np.array([geometric_errors.get(f"E_{axis}t0", 0.0) for axis in LINEAR])
    tool = tool @ _translation(machine.end_mm("tool", circle, angle_rad) + offset)
    work = work @ _translation(machine.end_mm("workpiece", circle, angle_rad))
    gap = tool[:, :3, 3] - work[:, :3, 3]
    distance: Array = np.sqrt((gap**2).sum(axis=1))
    return distance - circle.radius_mm


def _branch_transform(
    machine: Machine, branch: Branch, circle: Circle, angle_rad: Array, errors: Mapping[str, Any]
) -> Array:
    """Return the homogeneous transforms from the machine's foundation to tool or workpiece.

    There is one matrix of shape (4, 4) for each of n angles of the bar (``angle_rad``) on the
    nominal circle ``circle``; the result has the shape (n, 4, 4). ``branch`` is ``tool`` or
    ``workpiece``. ``errors`` maps the names of geometric errors to their values.
    """
    transform = np.broadcast_to(np.eye(4), (len(angle_rad), 4, 4))
    position = circle.position_mm(angle_rad)
    for joint in machine.branch(branch):
        coordinate = joint.sign * position[:, joint.index]
        transform = transform @ _joint_transform(machine, joint, coordinate, errors)
    return transform


def _joint_transform(
    machine: Machine, joint: Joint, coordinate: Array, errors: Mapping[str, Any]
) -> Array:
    """Return the homogeneous transforms of one joint at n positions, shape (n, 4, 4).

    The transforms contain the nominal motion and the error motions of the joint (Eq. 4-5 and 8-9 of
    the article on the model). ``coordinate``, shape (n,), holds the nominal displacements along the
    joint's axis [mm]. For a joint that carries the workpiece, the displacement is the machine
    coordinate times −1. ``errors`` maps the names of geometric errors to their values.
    """
    motion = np.zeros((len(coordinate), 3), dtype=np.result_type(float, *errors.values()))
    motion[:, joint.index] = coordinate
    before = np.eye(4)
    after = np.eye(4)
    for name in geometric_names(machine):
        if name.kind == "offset" or name.label not in errors:
            continue
        bearer = error_bearer(machine, name)
        if bearer.joint != joint:
            continue
        value = errors[name.label]
        if name.kind != "squareness":
            motion[:, LINEAR.index(name.component)] += value * coordinate**name.order
            continue
        rotation = _rotation(ROTARY.index(name.component), value)
        if bearer.before_motion:
            before = before @ rotation
        else:
            after = after @ rotation
    frame = np.asarray(joint.frame_mm)[None]
    return _translation(frame) @ before @ _translation(motion) @ after @ _translation(-frame)


def _translation(vector: Array) -> Array:
    """Return the homogeneous transforms of n translations, shape (n, 4, 4).

    ``vector``, shape (n, 3), holds the translations along X, Y and Z [mm].
    """
    transform = np.tile(np.eye(4, dtype=vector.dtype), (len(vector), 1, 1))
    transform[:, :3, 3] = vector
    return transform


def _rotation(axis: int, angle: Any) -> Array:
    """Return the homogeneous transform of a right-handed rotation about one axis, shape (4, 4).

    ``axis`` is 0 for X, 1 for Y and 2 for Z; ``angle`` is the angle of the rotation [rad].
    """
    first = (axis + 1) % 3
    second = (axis + 2) % 3
    transform = np.eye(4, dtype=np.result_type(float, angle))
    transform[first, first] = np.cos(angle)
    transform[second, second] = np.cos(angle)
    transform[first, second] = -np.sin(angle)
    transform[second, first] = np.sin(angle)
    return transform
