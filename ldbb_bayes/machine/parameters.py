"""Names, kinds and descriptions of the compliances and geometric errors of a machine.

The definitions are those of the paper, the article on which the model is based.
"""

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
# Names of the six components of a twist (displacement and rotation) or of a wrench (force and
# moment). X, Y and Z are displacements or forces along the axes; A, B and C are rotations or
# moments about the axes.
COMPONENTS = LINEAR + ROTARY
# The effect of a geometric error is proportional to a power of the axis coordinate. The dict holds
# the exponent for each kind of geometric error; for kinds that are not keys, it is 0.
_ORDERS: dict[GeometricKind, int] = {"gain": 1, "straightness": 2}


@dataclass(frozen=True)
class ComplianceName:
    """Name of the compliance C_ijk: the motion i at joint k per unit of the load j.

    The motion is a displacement or a rotation (component of a twist). The load that causes it is a
    force or a moment (component of a wrench).
    """

    #: index i of the compliance C_ijk: the motion that the load causes, which is a displacement
    #: along X, Y or Z, or a rotation A, B or C
    twist: str
    #: index j of the compliance C_ijk: the load that causes the motion, which is a force along X, Y
    #: or Z, or a moment A, B or C
    wrench: str
    #: index k of the compliance C_ijk: the machine axis X, Y or Z to which the joint belongs
    joint: str

    @property
    def label(self) -> str:
        """Name of the compliance as results print it, for example ``C_CXY``.

        ``C_CXY`` is the rotation C (about Z) per unit of a force along X at joint Y.
        """
        return f"C_{self.twist}{self.wrench}{self.joint}"

    @property
    def rotations(self) -> int:
        """Number of rotary components (rotation, moment) of the compliance: 0, 1 or 2.

        The number is 2 for a rotation caused by a moment, 1 for a rotation caused by a force, 1 for
        a displacement caused by a moment, and 0 for a displacement caused by a force.
        """
        return (self.twist in ROTARY) + (self.wrench in ROTARY)

    @property
    def kind(self) -> ComplianceKind:
        """Physical kind of the compliance, which determines its unit and its default prior.

        Kinds are, for example, "direct" (displacement along the force) and "cross" (displacement
        perpendicular to the force).
        """
        same_component = self.twist == self.wrench
        if self.rotations == 2:
            return "rotation_for_moment" if same_component else "rotation_for_other_moment"
        if self.rotations == 1:
            return "rotation_for_force"
        return "direct" if same_component else "cross"

    @property
    def meaning(self) -> str:
        """Description of the compliance in words: its motion, its load and its joint.

        For ``C_CXY`` it is "rotation about Z for a force along X, joint Y".
        """
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
        """Sort key for the choice of one compliance that represents a set of compliances.

        The compliances of such a set affect the readings in proportion to each other. Circular
        tests therefore cannot separate them. The compliance with the smallest key represents the
        set. `kept_compliances` lists the rules from which the key is made.
        """
        translation_for_moment = self.wrench in ROTARY and self.twist not in ROTARY
        turned_plane = {axes.rotation: plane for plane, axes in PLANES.items()}
        axis_outside_plane = self.twist in ROTARY and self.joint not in turned_plane[self.twist]
        return (
            translation_for_moment,
            self.rotations,
            self.joint != self.twist,
            axis_outside_plane,
            self.label,
        )


@dataclass(frozen=True)
class GeometricName:
    """Name of a geometric error: one component of the deviation of an axis or of the tool."""

    #: direction of the geometric error: X, Y or Z for a translation, A, B or C for a rotation
    component: str
    axis: str  #: machine axis to which the geometric error belongs; ``t`` for the tool
    #: kind of the geometric error: gain (scale error), straightness, squareness, or offset (of the
    #: tool)
    kind: GeometricKind
    #: reference axis of a squareness error, such as Y in the squareness of X to Y; empty for
    #: geometric errors of other kinds
    reference: str = ""
    #: number of the set-up (2, 3, …) to which a tool offset belongs; 0 for the tool offsets of
    #: set-up 1 and for all other geometric errors
    setup: int = 0

    @property
    def label(self) -> str:
        """Name of the geometric error in code and results, such as E_XX1, E_YX2 and E_Xt0.

        The squareness error E_C(0Y)X of ISO 230-1 is named E_C0YX. The tool offset E_Xt0 of set-up
        2 is named E_Xt0_2.
        """
        if self.kind == "squareness":
            return f"E_{self.component}0{self.reference}{self.axis}"
        setup = f"_{self.setup}" if self.setup else ""
        return f"E_{self.component}{self.axis}{self.order}{setup}"

    @property
    def order(self) -> int:
        """Power of the axis coordinate by which the geometric error is multiplied.

        The power is 1 for a gain, 2 for a quadratic straightness deviation, and 0 for other errors.
        """
        return _ORDERS.get(self.kind, 0)

    @property
    def closes_angle(self) -> bool:
        """Whether a squareness error above zero makes the angle between two axes less than 90°.

        The angle is that from the positive direction of ``axis`` to that of ``reference``. The
        error turns ``axis`` right-handed: about C, X turns towards +Y, but Y away from +X. False
        for geometric errors of other kinds.
        """
        return f"{self.axis}{self.reference}" in ("XY", "YZ", "ZX")

    @property
    def meaning(self) -> str:
        """Description of the geometric error in words, such as squareness error of Y to X."""
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
    """Return the names of all planar compliances of a machine, 18 for one tested plane.

    A planar compliance relates a displacement or rotation in a tested plane to a force or moment in
    the same plane. The names are sorted by plane, then by joint, then by displacement or rotation,
    then by force or moment.
    """
    names: dict[ComplianceName, None] = {}
    for plane in machine.planes:
        for axis in plane:
            for twist in PLANES[plane]:
                for wrench in PLANES[plane]:
                    names[ComplianceName(twist, wrench, axis)] = None
    return tuple(names)


def joint_names(machine: Machine) -> tuple[ComplianceName, ...]:
    """Return the names of all joint compliances of a machine, 6 × 6 = 36 for each joint.

    Each joint has one compliance for every combination of a motion (three displacements, three
    rotations) and a load (three forces, three moments). The joints are those whose axes move in at
    least one tested plane.
    """
    names = []
    for joint in machine.joints:
        for twist in COMPONENTS:
            for wrench in COMPONENTS:
                names.append(ComplianceName(twist, wrench, joint.axis))
    return tuple(names)


def geometric_names(machine: Machine) -> tuple[GeometricName, ...]:
    """Return the names of the machine's geometric errors in the order of the article on the model.

    The errors of each tested plane are scale errors (gains), quadratic straightness deviations and
    the squareness error. An error that belongs to two planes is listed only once. The tool offsets
    come last, one along each linear axis that moves in a tested plane.
    """
    names: list[GeometricName] = []
    for plane in machine.planes:
        reference_joint, turned_joint = machine.squareness_joints(plane)
        a, b, rotation = PLANES[plane]
        names += [
            GeometricName(component=a, axis=a, kind="gain"),
            GeometricName(component=b, axis=a, kind="straightness"),
            GeometricName(component=a, axis=b, kind="straightness"),
            GeometricName(component=b, axis=b, kind="gain"),
            GeometricName(
                component=rotation,
                axis=turned_joint.axis,
                kind="squareness",
                reference=reference_joint.axis,
            ),
        ]
    offsets = []
    for joint in machine.joints:
        offsets.append(GeometricName(component=joint.axis, axis="t", kind="offset"))
    return tuple(dict.fromkeys([*names, *offsets]))
