"""Columns of the linear hybrid model: wrench Jacobian (Eq. 20-23), geometric Jacobian (Eq. 16-18), and what can be kept.

For a unit force along the bar, joint k sees the wrench g_k = J_kᵀ B̂ (two forces, one moment). By Eq. 20 a compliance
C_ijk (twist i for wrench j at joint k) then changes the reading by g_k,i · g_k,j: the whole 18-column wrench Jacobian.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from ldbb_bayes.machine.chain import Circle, Machine

__all__ = [
    "ComplianceName",
    "Kept",
    "geometric_jacobian",
    "geometric_kinds",
    "geometric_names",
    "kept_compliances",
    "wrench_jacobian",
    "wrench_names",
]

Array = NDArray[Any]
GeometricKind = Literal["gain", "straightness", "squareness", "offset"]
ComplianceKind = Literal["direct", "cross", "rotation_for_force", "rotation_for_moment"]

_PARALLEL = 1e-10
_TINY = 1e-10


@dataclass(frozen=True)
class ComplianceName:
    """C_ijk of the paper: twist component i caused by wrench component j at joint k."""

    twist: str
    wrench: str
    joint: str

    @property
    def label(self) -> str:
        """The name as printed, for example ``C_CXY``."""
        return f"C_{self.twist}{self.wrench}{self.joint}"

    @property
    def rotations(self) -> int:
        """How many of twist and wrench are about the plane's normal (0, 1 or 2)."""
        return sum(component in "ABC" for component in (self.twist, self.wrench))

    @property
    def kind(self) -> ComplianceKind:
        """What the parameter is physically; priors and units follow from it."""
        if self.rotations == 2:
            return "rotation_for_moment"
        if self.rotations == 1:
            return "rotation_for_force"
        return "direct" if self.twist == self.wrench else "cross"

    @property
    def preference(self) -> tuple[bool, bool, str]:
        """Sort key within a proportional set: a rotation for a force before a translation for a moment, then the joint
        whose axis is the deflection, then alphabetical. For the paper's machine this is the paper's choice."""
        translation_for_moment = self.wrench in "ABC" and self.twist not in "ABC"
        return (translation_for_moment, self.joint != self.twist, self.label)


@dataclass(frozen=True)
class Kept:
    """What remains of the wrench Jacobian.

    Attributes
    ----------
    names : tuple of ComplianceName
        One representative per proportional set, in the order of Table 1.
    sets : tuple of tuples of str
        The proportional sets (Table 2), representative first. Each kept parameter stands for its set's sum.
    null : tuple of str
        Compliances that never change a reading.
    dependent : tuple of str
        Sets dropped because they are combinations of several others (only with joint-frame offsets).
    rank : int
        Rank of the full Jacobian.
    condition_number : float
        Ratio of singular values of the kept columns: unit force, full uniform circle, unscaled (mm, N).
    """

    names: tuple[ComplianceName, ...]
    sets: tuple[tuple[str, ...], ...]
    null: tuple[str, ...]
    dependent: tuple[str, ...]
    rank: int
    condition_number: float


def wrench_names(machine: Machine) -> tuple[ComplianceName, ...]:
    """Names of the 18 columns of the wrench Jacobian: joint, then twist, then wrench component."""
    components = machine.axes.components
    return tuple(ComplianceName(i, j, joint.axis) for joint in machine.joints for i in components for j in components)


def wrench_jacobian(machine: Machine, circle: Circle, angle_rad: Array) -> Array:
    """Reading per unit force and unit compliance, Eq. 20-23.

    Parameters
    ----------
    angle_rad : ndarray, shape (n,) [rad]

    Returns
    -------
    ndarray, shape (n, 18)
        Columns in the order of `wrench_names` [1, mm or mm²]; times F [N] and C they give the reading [mm].
    """
    direction = circle.direction(angle_rad)
    position = circle.position_mm(angle_rad)
    columns = []
    for joint in machine.joints:
        lever = machine.lever_mm(joint, position, circle)
        moment = lever[:, 0] * direction[:, 1] - lever[:, 1] * direction[:, 0]
        wrench = np.column_stack([direction, moment])
        columns.append((wrench[:, :, None] * wrench[:, None, :]).reshape(-1, 9))
    return np.concatenate(columns, axis=1)


def geometric_names(machine: Machine) -> tuple[str, ...]:
    """Names of the geometric errors in the paper's order (ISO 230-1): gains, quadratic straightness, squareness, offsets."""
    a, b = machine.axes.first, machine.axes.second
    squareness = f"E_{machine.axes.rotation}0{machine.primary.axis}{machine.secondary.axis}"
    return (f"E_{a}{a}1", f"E_{b}{a}2", f"E_{a}{b}2", f"E_{b}{b}1", squareness, f"E_{a}t0", f"E_{b}t0")


def geometric_kinds() -> tuple[GeometricKind, ...]:
    """What each geometric error is physically; priors and units follow from it."""
    return ("gain", "straightness", "straightness", "gain", "squareness", "offset", "offset")


def geometric_jacobian(machine: Machine, circle: Circle, angle_rad: Array) -> Array:
    """Reading per unit geometric error, Eq. 16-18.

    Returns
    -------
    ndarray, shape (n, 7)
        Columns in the order of `geometric_names` [mm per unit of the error].
    """
    direction = circle.direction(angle_rad)
    position = circle.position_mm(angle_rad)
    coordinate = position * [joint.sign for joint in machine.joints]
    shift = np.zeros((len(angle_rad), 7, 2))
    a, b = machine.joints
    shift[:, 0, 0] = a.sign * coordinate[:, 0]
    shift[:, 1, 1] = a.sign * coordinate[:, 0] ** 2
    shift[:, 2, 0] = b.sign * coordinate[:, 1] ** 2
    shift[:, 3, 1] = b.sign * coordinate[:, 1]
    shift[:, 4] = _squareness_shift(machine, circle, position)
    shift[:, 5, 0] = 1.0
    shift[:, 6, 1] = 1.0
    return np.einsum("nd,npd->np", direction, shift)


def _squareness_shift(machine: Machine, circle: Circle, position: Array) -> Array:
    """Displacement of tool against work ball per radian of squareness, shape (n, 2) [mm]."""
    primary, secondary = machine.primary, machine.secondary
    if primary.branch == secondary.branch:
        lever = primary.sign * machine.lever_mm(primary, position, circle)
    else:
        lever = -np.asarray(secondary.frame_mm) + np.zeros_like(position)
        lever[:, secondary.index] += position[:, secondary.index]
    return np.stack([-lever[:, 1], lever[:, 0]], axis=-1)


@lru_cache(maxsize=64)
def _kept(key: tuple[str, str, tuple[Any, ...]], circles: tuple[Circle, ...]) -> Kept:
    topology, plane, frames = key
    machine = Machine(topology, plane, dict(frames))
    names = wrench_names(machine)
    angle = np.arange(64) * (2 * np.pi / 64)
    jacobian = np.concatenate([wrench_jacobian(machine, circle, angle) for circle in circles])
    unit = jacobian / [circles[0].radius_mm ** name.rotations for name in names]
    norms = np.linalg.norm(unit, axis=0)
    live = [i for i in range(len(names)) if norms[i] > _TINY * norms.max()]
    unit = unit / np.where(norms > 0, norms, 1.0)
    by_head = {group[0]: group for group in _proportional_sets(unit, live, names)}
    chosen, dropped = _independent(unit, sorted(by_head, key=lambda i: _table_order(names[i], machine)))
    singular = np.linalg.svd(jacobian[:, chosen], compute_uv=False)
    return Kept(
        names=tuple(names[i] for i in chosen),
        sets=tuple(tuple(names[j].label for j in by_head[i]) for i in chosen),
        null=tuple(name.label for i, name in enumerate(names) if i not in live),
        dependent=tuple(names[i].label for i in dropped),
        rank=int(np.linalg.matrix_rank(unit[:, live], tol=_TINY * np.sqrt(len(live)))),
        condition_number=float(singular[0] / singular[-1]),
    )


def kept_compliances(machine: Machine, *circles: Circle) -> Kept:
    """Null columns, proportional sets and representatives of the wrench Jacobian (Table 2), found numerically.

    Parameters
    ----------
    machine : Machine
    *circles : Circle
        The circles of the campaign, taken together: another centre can tell compliances apart that one circle cannot.
        Default: R = 150 mm about the frames' origin.
    """
    frames = tuple(sorted((axis, tuple(frame)) for axis, frame in machine.frames_mm.items()))
    return _kept((machine.topology, machine.plane, frames), circles or (Circle(),))


def _proportional_sets(unit: Array, live: Sequence[int], names: Sequence[ComplianceName]) -> list[list[int]]:
    """Group columns that are multiples of one another; the preferred name leads its set."""
    sets: list[list[int]] = []
    for i in live:
        for group in sets:
            if 1.0 - abs(unit[:, i] @ unit[:, group[0]]) <= _PARALLEL:
                group.append(i)
                break
        else:
            sets.append([i])
    return [sorted(group, key=lambda i: names[i].preference) for group in sets]


def _table_order(name: ComplianceName, machine: Machine) -> tuple[int, int, int]:
    """Order of Table 1: translations for forces, rotations for forces, rotation for moment."""
    order = machine.axes.components
    return (name.rotations, order.index(name.twist), order.index(name.wrench))


def _independent(unit: Array, representatives: Sequence[int]) -> tuple[list[int], list[int]]:
    """Keep representatives in order while each adds a new direction."""
    chosen: list[int] = []
    dropped: list[int] = []
    basis = np.zeros((unit.shape[0], 0))
    for i in representatives:
        rest = unit[:, i] - basis @ (basis.T @ unit[:, i])
        if np.linalg.norm(rest) > 1e-8:
            chosen.append(i)
            basis = scipy.linalg.orth(unit[:, chosen])
        else:
            dropped.append(i)
    return chosen, dropped
