"""The machine as a serial chain: topology, planes and driven joints.

A topology such as ``wCAFYXZSt`` reads from the workpiece ``w`` through the foundation ``F`` to the
tool ``t`` (ISO 10791 style). A circular test drives the two linear axes of its plane; the joints of
all planes tested carry the compliances and geometric errors of the model. Vectors are (X, Y, Z) of
the machine.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np

from ldbb_bayes.errors import check_known, require
from ldbb_bayes.results import Array, Shown

__all__ = ["Axes", "Circle", "Joint", "LARGEST_MM", "LINEAR", "Machine", "PLANES", "ROTARY"]

Branch = Literal["tool", "workpiece"]
LINEAR = "XYZ"
ROTARY = "ABC"
_AXIS_LETTERS = "XYZABCUVWS"
LARGEST_MM = 1e5


class Axes(NamedTuple):
    """The planar twist and wrench components: the two translations of a plane, the rotation about
    its normal (right-handed)."""

    first: str
    second: str
    rotation: str


PLANES: Mapping[str, Axes] = {
    "XY": Axes("X", "Y", "C"),
    "YZ": Axes("Y", "Z", "A"),
    "ZX": Axes("Z", "X", "B"),
}


@dataclass(frozen=True)
class Circle(Shown):
    """The nominal circle of a test: the tool ball runs at distance ``radius_mm`` around the work
    ball."""

    radius_mm: float = 150.0
    #: of the work ball; across the plane it changes lever arms only
    centre_mm: tuple[float, float, float] = (
        0.0,
        0.0,
        0.0,
    )
    plane: str = "XY"  #: angles count from its first axis

    def direction(self, angle_rad: Array) -> Array:
        """Sensitive direction B̂ of the bar, shape (n, 3) [1]."""
        direction = np.zeros((len(angle_rad), 3))
        for axis, component in zip(self.plane, (np.cos(angle_rad), np.sin(angle_rad)), strict=True):
            direction[:, LINEAR.index(axis)] = component
        return direction

    def position_mm(self, angle_rad: Array) -> Array:
        """Nominal axis coordinates of the tool ball, shape (n, 3) [mm]."""
        return self.radius_mm * self.direction(angle_rad) + np.asarray(self.centre_mm)


@dataclass(frozen=True)
class Joint:
    """A linear joint: its axis, its branch and where its frame stands (X, Y, Z) [mm]."""

    axis: str
    branch: Branch
    frame_mm: tuple[float, float, float]

    @property
    def index(self) -> int:
        """Where its axis stands in a vector (X, Y, Z)."""
        return LINEAR.index(self.axis)

    @property
    def sign(self) -> float:
        """+1 in the tool branch; −1 in the workpiece branch, which moves and deviates against the
        tool."""
        return 1.0 if self.branch == "tool" else -1.0


@dataclass(frozen=True)
class Machine(Shown):
    """A serial machine tool and the planes it is tested in."""

    topology: str = "wCAFYXZSt"  #: joints from workpiece to tool
    planes: str | tuple[str, ...] = ("XY",)
    #: Where a joint's frame stands, all axes at zero, from the point where the balls coincide: by default there, as in the paper.
    frames_mm: Mapping[str, tuple[float, float, float]] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        planes = (self.planes,) if isinstance(self.planes, str) else tuple(self.planes)
        check_known("plane", planes, PLANES)
        object.__setattr__(self, "planes", tuple(plane for plane in PLANES if plane in planes))
        self._check_topology()
        for axis, frame in self.frames_mm.items():
            cure = f"got {axis!r}. Remove it: other joints count as rigid."
            require(
                axis in LINEAR and axis in self.topology,
                f"frames_mm must name linear axes of {self.topology!r}, {cure}",
            )
            numbers = f"three finite numbers (x, y, z) below {LARGEST_MM:g} mm"
            usable = (
                len(frame) == 3 and np.all(np.isfinite(frame)) and np.abs(frame).max() <= LARGEST_MM
            )
            require(usable, f"frames_mm[{axis!r}] must be {numbers}, got {frame!r}. Correct it.")
        object.__setattr__(self, "frames_mm", {k: tuple(v) for k, v in self.frames_mm.items()})

    def _check_topology(self) -> None:
        topology, inner = self.topology, self.topology[1:-1]
        require(
            topology.startswith("w") and topology.endswith("t") and inner.count("F") == 1,
            f"topology must read w…F…t (workpiece, foundation, tool), got {topology!r}. "
            "Write the joints from workpiece to tool, for example 'wCAFYXZSt'.",
        )
        for letter in inner.replace("F", ""):
            got = f"got {letter!r} in {topology!r}. Check the spelling of the chain."
            require(
                letter in _AXIS_LETTERS,
                f"topology must use the axis letters {', '.join(_AXIS_LETTERS)}, {got}",
            )
            got = f"got {letter!r} twice in {topology!r}. Remove one of them."
            require(inner.count(letter) == 1, f"topology must name each axis once, {got}")
        for plane in self.planes:
            for axis in plane:
                got = (
                    f"got {topology!r} without {axis}. Choose another plane or correct the"
                    " topology."
                )
                require(axis in inner, f"topology must hold the axes of plane {plane}, {got}")

    @property
    def plane(self) -> str:
        """The planes in words: XY, or XY + YZ."""
        return " + ".join(self.planes)

    @property
    def joints(self) -> tuple[Joint, ...]:
        """The joints whose compliances and errors count: those driven in any of the planes, in the
        order of the planes' axes."""
        return tuple(self.joint(axis) for axis in dict.fromkeys("".join(self.planes)))

    def joint(self, axis: str) -> Joint:
        """The joint of an axis."""
        branch: Branch = (
            "workpiece" if self.topology.index(axis) < self.topology.index("F") else "tool"
        )
        return Joint(axis, branch, self.frames_mm.get(axis, (0.0, 0.0, 0.0)))

    def squared(self, plane: str) -> tuple[Joint, Joint]:
        """The axes of a plane's squareness error: the reference, nearer the foundation, or in the
        workpiece branch if branches differ; and the one whose direction it turns."""
        a, b = map(self.joint, plane)
        first = (
            a.branch == "workpiece"
            if a.branch != b.branch
            else self.branch(a.branch).index(a) < self.branch(a.branch).index(b)
        )
        return (a, b) if first else (b, a)

    def branch(self, branch: Branch) -> tuple[Joint, ...]:
        """The linear joints of a branch, from the foundation outwards."""
        work, tool = self.topology.split("F")
        return tuple(
            self.joint(axis)
            for axis in (work[::-1] if branch == "workpiece" else tool)
            if axis in LINEAR
        )

    def lever_mm(self, joint: Joint, circle: Circle, angle_rad: Array) -> Array:
        """Lever arm from the joint's frame, which moves with it, to the ball its branch carries,
        shape (n, 3) [mm]."""
        position = circle.position_mm(angle_rad)
        lever = self.end_mm(joint.branch, circle, angle_rad) - np.asarray(joint.frame_mm)
        own = self.branch(joint.branch)
        for other in own[own.index(joint) + 1 :]:
            lever[:, other.index] += other.sign * position[:, other.index]
        return lever

    def end_mm(self, branch: Branch, circle: Circle, angle_rad: Array) -> Array:
        """Where a branch's ball stands with all its axes at zero, shape (n, 3) [mm]: the work ball
        at the circle's centre, the tool ball at the origin but for coordinates that the machine has
        no axis for."""
        if branch == "workpiece":
            return np.zeros((len(angle_rad), 3)) + np.asarray(circle.centre_mm)
        lacking = [axis not in self.topology for axis in LINEAR]
        return np.where(lacking, circle.position_mm(angle_rad), 0.0)


# ---- what can be known of the compliances
