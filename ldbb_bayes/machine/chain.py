"""The machine as a serial chain: topology string and test plane → two driven joints with frames and branches.

A topology such as ``wCAFYXZSt`` reads from the workpiece ``w`` through the foundation ``F`` to the tool ``t``
(ISO 10791 style). A circular test drives the two linear axes of its plane; only their joints carry the compliance
and geometric errors of the model.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.errors import InputError, check_known

__all__ = ["PLANES", "Axes", "Circle", "Joint", "Machine"]

Array = NDArray[Any]
Branch = Literal["tool", "workpiece"]


@dataclass(frozen=True)
class Axes:
    """The two translations of a plane and the rotation about its normal (right-handed)."""

    first: str
    second: str
    rotation: str

    @property
    def components(self) -> tuple[str, str, str]:
        """Planar twist and wrench components in order: translation or force, translation or force, rotation or moment."""
        return (self.first, self.second, self.rotation)


PLANES: Mapping[str, Axes] = MappingProxyType({"XY": Axes("X", "Y", "C"), "YZ": Axes("Y", "Z", "A"), "ZX": Axes("Z", "X", "B")})
_LINEAR = "XYZ"
_AXIS_LETTERS = "XYZABCUVWS"


@dataclass(frozen=True)
class Circle:
    """The nominal circle of a test: the tool ball runs at distance ``radius_mm`` around the work ball.

    Parameters
    ----------
    radius_mm : float
        Nominal radius R [mm].
    centre_mm : tuple of two floats
        Axis coordinates of the work ball in the plane [mm].
    """

    radius_mm: float = 150.0
    centre_mm: tuple[float, float] = (0.0, 0.0)

    def direction(self, angle_rad: Array) -> Array:
        """Sensitive direction B̂ of the bar, shape (n, 2) [1]."""
        return np.stack([np.cos(angle_rad), np.sin(angle_rad)], axis=-1)

    def position_mm(self, angle_rad: Array) -> Array:
        """Nominal axis coordinates of the tool ball, shape (n, 2) [mm]."""
        return self.radius_mm * self.direction(angle_rad) + np.asarray(self.centre_mm)


@dataclass(frozen=True)
class Joint:
    """A driven linear joint: its axis, its index in the plane (0 or 1), its branch and where its frame stands."""

    axis: str
    index: int
    branch: Branch
    frame_mm: tuple[float, float]

    @property
    def sign(self) -> float:
        """+1 in the tool branch; −1 in the workpiece branch, which moves and deviates against the tool."""
        return 1.0 if self.branch == "tool" else -1.0


@dataclass(frozen=True)
class Machine:
    """A serial machine tool seen in one plane.

    Parameters
    ----------
    topology : str
        Joints from workpiece to tool, for example ``wCAFYXZSt``.
    plane : {"XY", "YZ", "ZX"}
        Plane of the circular test; angles count from its first axis.
    frames_mm : mapping of axis letter to (x, y, z), optional
        Where a joint's frame stands [mm], with all axes at zero, from the point where tool ball and work ball coincide. The
        default is that point itself, as in the paper.

    Raises
    ------
    InputError
        For an unknown plane, a topology without ``w…F…t``, or a plane whose axes the machine does not have.
    """

    topology: str = "wCAFYXZSt"
    plane: str = "XY"
    frames_mm: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_known("plane", [self.plane], PLANES)
        inner = self.topology[1:-1]
        if not (self.topology.startswith("w") and self.topology.endswith("t") and inner.count("F") == 1):
            raise InputError(
                f"topology must read w…F…t (workpiece, foundation, tool), got {self.topology!r}. "
                "Write the joints from workpiece to tool, for example 'wCAFYXZSt'."
            )
        for letter in inner.replace("F", ""):
            if letter not in _AXIS_LETTERS:
                raise InputError(
                    f"topology must use the axis letters {', '.join(_AXIS_LETTERS)}, got {letter!r} in {self.topology!r}. "
                    "Check the spelling of the chain."
                )
            if inner.count(letter) > 1:
                raise InputError(
                    f"topology must name each axis once, got {letter!r} twice in {self.topology!r}. Remove one of them."
                )
        for axis in (self.axes.first, self.axes.second):
            if axis not in inner:
                raise InputError(
                    f"topology must hold the axes of plane {self.plane}, got {self.topology!r} without {axis}. "
                    "Choose another plane or correct the topology."
                )
        for axis, frame in self.frames_mm.items():
            if axis not in _LINEAR or axis not in inner:
                raise InputError(
                    f"frames_mm must name linear axes of {self.topology!r}, got {axis!r}. Remove it or correct the letter."
                )
            if len(frame) != 3 or not np.all(np.isfinite(frame)):
                raise InputError(f"frames_mm[{axis!r}] must be three finite numbers (x, y, z) in mm, got {frame!r}. Correct it.")
        object.__setattr__(self, "frames_mm", MappingProxyType(dict(self.frames_mm)))

    @property
    def axes(self) -> Axes:
        """The axes of the test plane."""
        return PLANES[self.plane]

    @property
    def joints(self) -> tuple[Joint, Joint]:
        """The two driven joints in the order of the plane's axes."""
        first, second = (self._joint(axis, i) for i, axis in enumerate((self.axes.first, self.axes.second)))
        return first, second

    def _joint(self, axis: str, index: int) -> Joint:
        x, y, z = self.frames_mm.get(axis, (0.0, 0.0, 0.0))
        frame = {"X": x, "Y": y, "Z": z}
        branch: Branch = "workpiece" if self.topology.index(axis) < self.topology.index("F") else "tool"
        return Joint(axis, index, branch, (frame[self.axes.first], frame[self.axes.second]))

    @property
    def primary(self) -> Joint:
        """The reference axis of the squareness error: nearer the foundation, or in the workpiece branch if branches differ."""
        a, b = self.joints
        if a.branch != b.branch:
            return a if a.branch == "workpiece" else b
        return a if self._distance_to_foundation(a) < self._distance_to_foundation(b) else b

    @property
    def secondary(self) -> Joint:
        """The axis whose direction the squareness error turns."""
        a, b = self.joints
        return b if self.primary == a else a

    def _distance_to_foundation(self, joint: Joint) -> int:
        return abs(self.topology.index(joint.axis) - self.topology.index("F"))

    def carried_by(self, joint: Joint) -> tuple[Joint, ...]:
        """The driven joints further out than ``joint`` in its branch: their motion sets its lever arm."""
        return tuple(
            other
            for other in self.joints
            if other.branch == joint.branch and self._distance_to_foundation(other) > self._distance_to_foundation(joint)
        )

    def lever_mm(self, joint: Joint, position_mm: Array, circle: Circle) -> Array:
        """Lever arm from the joint's frame to the ball its branch carries.

        Parameters
        ----------
        position_mm : ndarray, shape (n, 2) [mm]
            Nominal axis coordinates of the tool ball.

        Returns
        -------
        ndarray, shape (n, 2) [mm]
            Tool ball − frame in the tool branch; work ball − frame in the workpiece branch.
        """
        lever = np.zeros_like(position_mm) - np.asarray(joint.frame_mm)
        if joint.branch == "workpiece":
            lever = lever + np.asarray(circle.centre_mm)
        for other in self.carried_by(joint):
            lever[:, other.index] += other.sign * position_mm[:, other.index]
        return lever
