"""Names, units and meaning of compliances and geometric errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from ldbb_bayes.machine.chain import LINEAR, PLANES, ROTARY, Machine

__all__ = [
    "ComplianceKind",
    "ComplianceName",
    "GeometricKind",
    "GeometricName",
    "geometric_names",
    "joint_names",
    "wrench_names",
]


_COMPONENTS = LINEAR + ROTARY


GeometricKind = Literal["gain", "straightness", "squareness", "offset"]


ComplianceKind = Literal[
    "direct", "cross", "rotation_for_force", "rotation_for_moment", "rotation_for_other_moment"
]


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
        if self.rotations == 2:
            return (
                "rotation_for_moment" if self.twist == self.wrench else "rotation_for_other_moment"
            )
        if self.rotations == 1:
            return "rotation_for_force"
        return "direct" if self.twist == self.wrench else "cross"

    @property
    def meaning(self) -> str:
        """In words."""
        about = dict(zip(ROTARY, LINEAR, strict=True))
        moved = (
            f"rotation about {about[self.twist]}"
            if self.twist in ROTARY
            else f"translation along {self.twist}"
        )
        load = (
            f"moment about {about[self.wrench]}"
            if self.wrench in ROTARY
            else f"force along {self.wrench}"
        )
        return f"{moved} for a {load}, joint {self.joint}"

    @property
    def preference(self) -> tuple[bool, int, bool, bool, str]:
        """Sort key within a proportional set, see `kept_compliances`."""
        translation_for_moment = self.wrench in ROTARY and self.twist not in ROTARY
        turned = {axes.rotation: plane for plane, axes in PLANES.items()}
        idle = self.twist in ROTARY and self.joint not in turned[self.twist]
        return (translation_for_moment, self.rotations, self.joint != self.twist, idle, self.label)


@dataclass(frozen=True)
class GeometricName:
    """A geometric error: component of the deviation (X, Y, Z of a translation, A, B, C of a
    rotation), the axis it belongs to (``t``: the tool), its kind; of a squareness its reference
    axis, of a tool offset its set-up, where there are several."""

    component: str
    axis: str
    kind: GeometricKind
    reference: str = ""
    setup: int = 0

    @property
    def label(self) -> str:
        """The name in code: E_XX1, E_YX2, E_C0YX (ISO 230-1: E_C(0Y)X), E_Xt0, E_Xt0_2 in set-up
        2."""
        if self.kind == "squareness":
            return f"E_{self.component}0{self.reference}{self.axis}"
        return f"E_{self.component}{self.axis}{self.order}" + (
            f"_{self.setup}" if self.setup else ""
        )

    @property
    def order(self) -> int:
        """The power of the axis' coordinate that it goes with."""
        return {"gain": 1, "straightness": 2}.get(self.kind, 0)

    @property
    def meaning(self) -> str:
        """In words."""
        return {
            "gain": (
                f"scale error of {self.axis}: positioning deviation in proportion to its coordinate"
            ),
            "straightness": (
                f"straightness deviation of {self.axis} in the direction of {self.component},"
                " quadratic"
            ),
            "squareness": f"squareness error of {self.axis} to {self.reference}",
            "offset": (
                f"offset of the tool ball along {self.component}"
                + (f", set-up {self.setup}" if self.setup else "")
            ),
        }[self.kind]


def wrench_names(machine: Machine) -> tuple[ComplianceName, ...]:
    """Names of the columns of the planar wrench Jacobian, 18 for one plane: joint, then twist, then
    wrench component."""
    planes = [(plane, PLANES[plane]) for plane in machine.planes]
    return tuple(
        dict.fromkeys(
            ComplianceName(i, j, axis)
            for plane, own in planes
            for axis in plane
            for i in own
            for j in own
        )
    )


def joint_names(machine: Machine) -> tuple[ComplianceName, ...]:
    """Names of all compliances of all joints with six degrees of freedom each, 36 a joint."""
    six = LINEAR + ROTARY
    return tuple(
        ComplianceName(i, j, joint.axis) for joint in machine.joints for i in six for j in six
    )


def geometric_names(machine: Machine) -> tuple[GeometricName, ...]:
    """The geometric errors in the paper's order: of each plane gains, quadratic straightness,
    squareness; then tool offsets."""
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
