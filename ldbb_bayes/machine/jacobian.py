"""Columns of the linear hybrid model: wrench Jacobian (Eq. 20-23) and geometric Jacobian (Eq. 16-18), six degrees of freedom.

For a unit force along the bar, joint k sees the wrench g_k = J_kᵀ B̂ = (B̂, lever × B̂): three forces, three moments about its
frame. By Eq. 20 a compliance C_ijk (twist i for wrench j at joint k) then changes the reading by g_k,i · g_k,j. An error motion
of joint k, a twist e about the same frame, changes it by ± g_k · e, minus in the workpiece branch. The planar model of the paper
is what remains while the levers lie in the plane.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.machine.chain import LINEAR, ROTARY, Circle, Joint, Machine
from ldbb_bayes.machine.names import ComplianceName, GeometricName, geometric_names, wrench_names

__all__ = ["bearer", "compliance_jacobian", "geometric_jacobian", "joint_wrench", "wrench_jacobian"]

Array = NDArray[Any]
_COMPONENTS = LINEAR + ROTARY


def wrench_jacobian(machine: Machine, circle: Circle, angle_rad: Array) -> Array:
    """The paper's planar wrench Jacobian: reading per unit force and unit compliance, shape (n, 18) for one plane.

    Columns in the order of `wrench_names` [1, mm or mm²]; times F [N] and C they give the reading [mm].
    """
    return compliance_jacobian(machine, circle, angle_rad, wrench_names(machine))


def compliance_jacobian(machine: Machine, circle: Circle, angle_rad: Array, names: Sequence[ComplianceName]) -> Array:
    """Reading per unit force and unit compliance, Eq. 20-23.

    Parameters
    ----------
    angle_rad : ndarray, shape (n,) [rad]
    names : sequence of ComplianceName
        Any of `joint_names`.

    Returns
    -------
    ndarray, shape (n, compliances) [1, mm or mm²]
    """
    wrench = {axis: joint_wrench(machine, machine.joint(axis), circle, angle_rad) for axis in {name.joint for name in names}}
    columns = np.zeros((len(angle_rad), len(names)))
    for k, name in enumerate(names):
        own = wrench[name.joint]
        columns[:, k] = own[:, _COMPONENTS.index(name.twist)] * own[:, _COMPONENTS.index(name.wrench)]
    return columns


def joint_wrench(machine: Machine, joint: Joint, circle: Circle, angle_rad: Array) -> Array:
    """Force and moment (X, Y, Z, A, B, C) about the joint's frame for a unit force along the bar, shape (n, 6) [1, mm]."""
    return _wrench(machine.lever_mm(joint, circle, angle_rad), circle.direction(angle_rad))


def geometric_jacobian(machine: Machine, circle: Circle, angle_rad: Array) -> Array:
    """Reading per unit geometric error, Eq. 16-18.

    Returns
    -------
    ndarray, shape (n, geometric errors)
        Columns in the order of `geometric_names` [mm per unit of the error].
    """
    return np.stack([_error_column(machine, circle, angle_rad, name) for name in geometric_names(machine)], axis=1)


def _error_column(machine: Machine, circle: Circle, angle_rad: Array, name: GeometricName) -> Array:
    direction = circle.direction(angle_rad)
    component = _COMPONENTS.index(name.component)
    if name.kind == "offset":
        return direction[:, component]
    joint, before = bearer(machine, name)
    lever = machine.lever_mm(joint, circle, angle_rad)
    coordinate = joint.sign * circle.position_mm(angle_rad)[:, joint.index]
    if before:
        lever[:, joint.index] += coordinate
    size = {"gain": coordinate, "straightness": coordinate**2}.get(name.kind, np.ones(len(angle_rad)))
    return joint.sign * size * _wrench(lever, direction)[:, component]


def bearer(machine: Machine, name: GeometricName) -> tuple[Joint, bool]:
    """The joint at which an error sits, and whether it comes before the joint's own motion.

    A squareness turns what the primary axis carries when both axes are in one branch; else it turns the secondary axis itself.
    """
    if name.kind != "squareness":
        return machine.joint(name.axis), False
    primary, secondary = machine.joint(name.reference), machine.joint(name.axis)
    apart = primary.branch != secondary.branch
    return (secondary, True) if apart else (primary, False)


def _wrench(lever: Array, direction: Array) -> Array:
    return np.concatenate([direction, np.cross(lever, direction)], axis=1)
