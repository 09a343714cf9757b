"""Names, units and meaning of compliances and geometric errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from ldbb_bayes.machine.chain import LINEAR, PLANES, ROTARY, Machine

__all__ = [
    "COMPONENTS",
    "ComplianceKind",
    "ComplianceName",
    "GeometricKind",
    "GeometricName",
    "geometric_names",
    "joint_names",
    "wrench_names",
]

GeometricKind = Literal["gain", "straightness", "squareness", "offset"]
ComplianceKind = Literal[
    "direct", "cross", "rotation_for_force", "rotation_for_moment", "rotation_for_other_moment"
]
# The components of a twist or wrench, in order: along X, Y, Z and about them.
COMPONENTS = LINEAR + ROTARY
# The power of its axis' coordinate that a geometric error goes with, where it is not 0.
_ORDERS: dict[GeometricKind, int] = {"gain": 1, "straightness": 2}


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
        """How many of twist and wrench are rotary (0, 1 or 2)."""
        return (self.twist in ROTARY) + (self.wrench in ROTARY)

    @property
    def kind(self) -> ComplianceKind:
        """What the parameter is physically; priors and units follow from it."""
        same_component = self.twist == self.wrench
        if self.rotations == 2:
            return "rotation_for_moment" if same_component else "rotation_for_other_moment"
        if self.rotations == 1:
            return "rotation_for_force"
        return "direct" if same_component else "cross"

    @property
    def meaning(self) -> str:
        """In words."""
        axis_of = dict(zip(ROTARY, LINEAR, strict=True))
        motion = f"translation along {self.twist}"
        if self.twist in ROTARY:
            motion = f"rotation about {axis_of[self.twist]}"
        load = f"force along {self.wrench}"
        if self.wrench in ROTARY:
            load = f"moment about {axis_of[self.wrench]}"
        return f"{motion} for a {load}, joint {self.joint}"

    @property
    def preference(self) -> tuple[bool, int, bool, bool, str]:
        """Sort key within a proportional set, see `kept_compliances`."""
        translation_for_moment = self.wrench in ROTARY and self.twist not in ROTARY
        turned_plane = {axes.rotation: plane for plane, axes in PLANES.items()}
        idle = self.twist in ROTARY and self.joint not in turned_plane[self.twist]
        return (translation_for_moment, self.rotations, self.joint != self.twist, idle, self.label)


@dataclass(frozen=True)
class GeometricName:
    """A geometric error: a component of an axis' deviation."""

    component: str  #: X, Y, Z of a translation, A, B, C of a rotation
    axis: str  #: the axis it belongs to; ``t``: the tool
    kind: GeometricKind
    reference: str = ""  #: of a squareness, its reference axis
    setup: int = 0  #: of a tool offset, its set-up where there are several

    @property
    def label(self) -> str:
        """The name in code: E_XX1, E_YX2, E_C0YX (ISO 230-1: E_C(0Y)X), E_Xt0.

        E_Xt0_2 in set-up 2.
        """
        if self.kind == "squareness":
            return f"E_{self.component}0{self.reference}{self.axis}"
        setup = f"_{self.setup}" if self.setup else ""
        return f"E_{self.component}{self.axis}{self.order}{setup}"

    @property
    def order(self) -> int:
        """The power of the axis' coordinate that it goes with."""
        return _ORDERS.get(self.kind, 0)

    @property
    def meaning(self) -> str:
        """In words."""
        if self.kind == "gain":
            return (
                f"scale error of {self.axis}: positioning deviation in proportion to its coordinate"
            )
        if self.kind == "straightness":
            return (
                f"straightness deviation of {self.axis} in the direction of {self.component},"
                " quadratic"
            )
        if self.kind == "squareness":
            return f"squareness error of {self.axis} to {self.reference}"
        setup = f", set-up {self.setup}" if self.setup else ""
        return f"offset of the tool ball along {self.component}{setup}"


def wrench_names(machine: Machine) -> tuple[ComplianceName, ...]:
    """Return the names of the columns of the planar wrench Jacobian, 18 for one plane.

    Order: joint, then twist, then wrench component.
    """
    names: dict[ComplianceName, None] = {}
    for plane in machine.planes:
        for axis in plane:
            for twist in PLANES[plane]:
                for wrench in PLANES[plane]:
                    names[ComplianceName(twist, wrench, axis)] = None
    return tuple(names)


def joint_names(machine: Machine) -> tuple[ComplianceName, ...]:
    """Return the names of all compliances of all joints, 36 a joint of six degrees of freedom."""
    names = []
    for joint in machine.joints:
        for twist in COMPONENTS:
            for wrench in COMPONENTS:
                names.append(ComplianceName(twist, wrench, joint.axis))
    return tuple(names)


def geometric_names(machine: Machine) -> tuple[GeometricName, ...]:
    """Return the geometric errors in the paper's order.

    Of each plane gains, quadratic straightness, squareness; then tool offsets.
    """
    names: list[GeometricName] = []
    for plane in machine.planes:
        primary, secondary = machine.squared(plane)
        a, b, rotation = PLANES[plane]
        names += [
            GeometricName(a, a, "gain"),
            GeometricName(b, a, "straightness"),
            GeometricName(a, b, "straightness"),
            GeometricName(b, b, "gain"),
            GeometricName(rotation, secondary.axis, "squareness", primary.axis),
        ]
    offsets = [GeometricName(joint.axis, "t", "offset") for joint in machine.joints]
    return tuple(dict.fromkeys([*names, *offsets]))
