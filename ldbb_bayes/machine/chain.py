"""Machine tools as serial chains of axes: topology, planes of tests and driven joints.

A topology such as ``wCAFYXZSt`` lists the axes from the workpiece ``w`` through the foundation
``F`` to the tool ``t``, in the style of ISO 10791. A circular test drives the two linear axes of
its plane. The model has compliances and geometric errors at the joints of all axes that circular
tests drive. Vectors have the components X, Y and Z of the machine coordinate system.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np

from ldbb_bayes.errors import check_known, require
from ldbb_bayes.results import Array, Shown

__all__ = [
    "LARGEST_MM",
    "LINEAR",
    "PLANES",
    "ROTARY",
    "Axes",
    "Branch",
    "Circle",
    "Joint",
    "Machine",
]

Branch = Literal["tool", "workpiece"]
# Letters of the linear axes, in the order in which vectors hold the components along the axes.
LINEAR = "XYZ"
# Letters of the rotations about X, Y and Z, in the order in which vectors hold the rotations.
ROTARY = "ABC"
# Letters that axes may have in a topology; U, V, W are secondary axes, S is the spindle.
_AXIS_LETTERS = "XYZABCUVWS"
# Largest permitted coordinate of a joint's frame [mm]. A larger number was probably entered in
# another unit.
LARGEST_MM = 1e5


class Axes(NamedTuple):
    """Names of the three motions in a plane: two translations, and the rotation about the normal.

    The names are letters such as X, Y and C; the rotation is right-handed.
    """

    #: first axis of the plane of a circular test, such as X; angles in the plane are measured from
    #: this axis
    first: str
    second: str  #: second axis of the plane of a circular test, such as Y
    rotation: str  #: rotation about the normal of the circle's plane, such as C for XY


# Planes in which circular tests are possible, with the names of their axes and of their rotation.
PLANES: Mapping[str, Axes] = {
    "XY": Axes("X", "Y", "C"),
    "YZ": Axes("Y", "Z", "A"),
    "ZX": Axes("Z", "X", "B"),
}


@dataclass(frozen=True)
class Circle(Shown):
    """The nominal circle of a test, on which the tool ball moves around the work ball.

    The centre of the circle is given in machine coordinates.

    Examples
    --------
    >>> circle = lb.machine.Circle(radius_mm=100.0, centre_mm=(50.0, 0.0, 0.0))
    >>> circle.position_mm(np.array([0.0, np.pi])).round(3)
    array([[150., 0., 0.],
           [-50., 0., 0.]])
    """

    radius_mm: float = 150.0  #: nominal distance between work ball and tool ball [mm]
    #: position (X, Y, Z) of the work ball in machine coordinates [mm]. The coordinate perpendicular
    #: to the plane of the circle changes the readings only through the lever arms from the joints
    #: of the machine axes to the balls.
    centre_mm: Sequence[float] = (0.0, 0.0, 0.0)
    #: plane of the circle, such as XY; angles are measured from the plane's first axis
    plane: str = "XY"

    def __post_init__(self) -> None:
        """Store the coordinates of the circle's centre as a tuple."""
        object.__setattr__(self, "centre_mm", tuple(self.centre_mm))

    def direction(self, angle_rad: Array) -> Array:
        """Return the direction from work ball to tool ball as unit vectors, shape (n, 3).

        ``angle_rad`` holds the n angles of the bar, measured from the first axis of the plane
        [rad].
        """
        direction = np.zeros((len(angle_rad), 3))
        direction[:, LINEAR.index(self.plane[0])] = np.cos(angle_rad)
        direction[:, LINEAR.index(self.plane[1])] = np.sin(angle_rad)
        return direction

    def position_mm(self, angle_rad: Array) -> Array:
        """Return the nominal coordinates X, Y and Z of the tool ball, shape (n, 3) [mm].

        ``angle_rad`` holds the n angles of the bar, measured from the first axis of the plane
        [rad].
        """
        return self.radius_mm * self.direction(angle_rad) + np.asarray(self.centre_mm)


@dataclass(frozen=True)
class Joint:
    """Joint of a linear axis, with the position of the joint's frame.

    The frame is the coordinate system of the joint. The compliances and error motions of the joint
    refer to the origin of this frame.
    """

    axis: str  #: name of the linear axis to which the joint belongs: X, Y or Z
    branch: Branch  #: what the axis of the joint carries: ``tool`` or ``workpiece``
    #: position (X, Y, Z) of the joint's coordinate system (frame), measured from the centre of the
    #: tool ball [mm]; all machine axes are at zero
    frame_mm: Sequence[float]

    @property
    def index(self) -> int:
        """Index of the joint's linear axis in a vector (X, Y, Z): 0 for X, 1 for Y, 2 for Z."""
        return LINEAR.index(self.axis)

    @property
    def sign(self) -> float:
        """Sign of the motion: +1 if the joint carries the tool, −1 if it carries the workpiece.

        To move the tool by +1 mm relative to the workpiece, a joint that carries the workpiece
        moves by −1 mm.
        """
        return 1.0 if self.branch == "tool" else -1.0


def _is_position(point_mm: Sequence[float]) -> bool:
    """Return whether a point has three finite coordinates, none of them too large."""
    if len(point_mm) != 3 or not np.all(np.isfinite(point_mm)):
        return False
    return bool(np.abs(point_mm).max() <= LARGEST_MM)


@dataclass(frozen=True)
class Machine(Shown):
    """A machine tool as a serial chain of axes, and the planes in which it is tested.

    The topology lists the axes from the workpiece ``w`` through the foundation ``F`` to the tool
    ``t``, in the style of ISO 10791. Axes before ``F`` carry the workpiece, and axes after ``F``
    carry the tool. In ``wCAFYXZSt``, C and A carry the workpiece; Y, X, Z and the spindle S carry
    the tool. The linear axes of the tested planes are modelled; all other axes are treated as rigid
    and free of errors.

    Raises
    ------
    InputError
        If a plane is unknown; if the topology is not written as described, has an unknown or
        repeated axis, or lacks an axis of a tested plane; if a frame belongs to no linear axis of
        the topology, or is not three finite numbers of at most 100 000 mm.

    Examples
    --------
    >>> machine = lb.Machine("wXFYZt", planes=("XY", "ZX"))
    >>> [(joint.axis, joint.branch) for joint in machine.joints]
    [('X', 'workpiece'), ('Y', 'tool'), ('Z', 'tool')]
    >>> lb.Machine("wYXt")
    Traceback (most recent call last):
        ...
    ldbb_bayes.errors.InputError: topology must read w…F…t (workpiece, foundation, tool), got
    'wYXt'. Write the joints from workpiece to tool, for example 'wCAFYXZSt'.
    """

    topology: str = "wCAFYXZSt"  #: letters of the machine axes, in order from workpiece to tool
    #: planes of the circular tests: one or more of XY, YZ and ZX
    planes: str | Sequence[str] = ("XY",)
    #: dict of the positions (X, Y, Z) of the coordinate systems (frames) of joints [mm]; its keys
    #: are the letters of the axes. Positions are measured from the centre of the tool ball, with
    #: all axes at zero. The frame of a joint that is not listed is at this centre, as in the paper.
    frames_mm: Mapping[str, Sequence[float]] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        """Check the fields, and store the planes and the positions of the frames as tuples."""
        planes = (self.planes,) if isinstance(self.planes, str) else tuple(self.planes)
        check_known("plane", planes, PLANES)
        object.__setattr__(self, "planes", tuple(plane for plane in PLANES if plane in planes))
        self._check_topology()
        for axis, frame in self.frames_mm.items():
            self._check_frame(axis, frame)
        frames = {axis: tuple(frame) for axis, frame in self.frames_mm.items()}
        object.__setattr__(self, "frames_mm", frames)

    def _check_frame(self, axis: str, frame: Sequence[float]) -> None:
        """Raise an `InputError` unless the position of a joint's frame is valid.

        The frame is the coordinate system in which the compliances and errors of the joint act.
        ``axis``, the axis of the joint, must be a linear axis of the topology; all other joints are
        modelled as rigid. ``frame`` is the position (X, Y, Z) of the frame's origin. It must be
        three finite numbers with absolute values of at most ``LARGEST_MM`` [mm].
        """
        require(
            axis in LINEAR and axis in self.topology,
            f"frames_mm must name linear axes of {self.topology!r}, got {axis!r}."
            " Remove it: other joints count as rigid.",
        )
        require(
            _is_position(frame),
            f"frames_mm[{axis!r}] must be three finite numbers (x, y, z) below {LARGEST_MM:g} mm,"
            f" got {frame!r}. Correct it.",
        )

    def _check_topology(self) -> None:
        """Raise an `InputError` if the topology is not valid.

        A valid topology has the form w…F…t. It consists of known axis letters, each of which occurs
        once, and it contains both axes of every tested plane.
        """
        topology = self.topology
        inner = topology[1:-1]
        require(
            topology.startswith("w") and topology.endswith("t") and inner.count("F") == 1,
            f"topology must read w…F…t (workpiece, foundation, tool), got {topology!r}. "
            "Write the joints from workpiece to tool, for example 'wCAFYXZSt'.",
        )
        for letter in inner.replace("F", ""):
            require(
                letter in _AXIS_LETTERS,
                f"topology must use the axis letters {', '.join(_AXIS_LETTERS)},"
                f" got {letter!r} in {topology!r}. Check the spelling of the chain.",
            )
            require(
                inner.count(letter) == 1,
                f"topology must name each axis once, got {letter!r} twice in {topology!r}."
                " Remove one of them.",
            )
        for plane in self.planes:
            for axis in plane:
                require(
                    axis in inner,
                    f"topology must hold the axes of plane {plane}, got {topology!r} without"
                    f" {axis}. Choose another plane or correct the topology.",
                )

    @property
    def plane(self) -> str:
        """Names of the tested planes, joined by plus signs, such as XY + YZ."""
        return " + ".join(self.planes)

    @property
    def joints(self) -> tuple[Joint, ...]:
        """Joints at which the model has compliances and geometric errors.

        There is one joint for each linear axis that moves in a tested plane. The joints are in the
        order in which their axes first occur in the names of the planes.
        """
        return tuple(self.joint(axis) for axis in dict.fromkeys("".join(self.planes)))

    def joint(self, axis: str) -> Joint:
        """Return the joint of the linear axis with the given name: X, Y or Z.

        In the topology, the axes that carry the workpiece come before the foundation F, and the
        axes that carry the tool come after it. If ``frames_mm`` has no entry for the axis, the
        frame of the joint is at the centre of the tool ball when all axes are at zero.
        """
        branch: Branch = "tool"
        if self.topology.index(axis) < self.topology.index("F"):
            branch = "workpiece"
        return Joint(axis, branch, self.frames_mm.get(axis, (0.0, 0.0, 0.0)))

    def squareness_joints(self, plane: str) -> tuple[Joint, Joint]:
        """Return the reference joint of a plane's squareness error, and the plane's other joint.

        If both joints carry the tool, or both carry the workpiece, the reference is the joint
        nearer to the foundation. If one joint carries the tool and the other the workpiece, the
        reference is the joint that carries the workpiece. The squareness error turns the axis of
        the joint that is not the reference. ``plane`` is XY, YZ or ZX.
        """
        a = self.joint(plane[0])
        b = self.joint(plane[1])
        if a.branch != b.branch:
            a_is_reference = a.branch == "workpiece"
        else:
            branch = self.branch(a.branch)
            a_is_reference = branch.index(a) < branch.index(b)
        return (a, b) if a_is_reference else (b, a)

    def branch(self, branch: Branch) -> tuple[Joint, ...]:
        """Return the joints of linear axes that carry the tool, or those that carry the workpiece.

        ``branch`` is ``tool`` or ``workpiece``. The joints are listed in their order from the
        foundation to the tool or the workpiece.
        """
        work, tool = self.topology.split("F")
        axes = work[::-1] if branch == "workpiece" else tool
        return tuple(self.joint(axis) for axis in axes if axis in LINEAR)

    def lever_mm(self, joint: Joint, circle: Circle, angle_rad: Array) -> Array:
        """Return the lever arm from a joint's frame to the ball that the joint carries.

        The frame moves with the joint. The result has one lever arm (X, Y, Z) for each of n angles,
        shape (n, 3) [mm].

        Parameters
        ----------
        joint
            Joint of a linear axis.
        circle
            Nominal circle of the test.
        angle_rad
            Angles of the bar from the first axis of the plane, shape (n,) [rad].
        """
        position = circle.position_mm(angle_rad)
        lever = self.end_mm(joint.branch, circle, angle_rad) - np.asarray(joint.frame_mm)
        branch = self.branch(joint.branch)
        for outer in branch[branch.index(joint) + 1 :]:
            lever[:, outer.index] += outer.sign * position[:, outer.index]
        return lever

    def end_mm(self, branch: Branch, circle: Circle, angle_rad: Array) -> Array:
        """Return the position (X, Y, Z) of a ball with all axes at zero, shape (n, 3) [mm].

        There is one position for each of n angles of the bar. The work ball is at the circle's
        centre, and the tool ball is at the origin. If the machine lacks one of the linear axes X, Y
        and Z, the tool ball's coordinate along the missing axis is its nominal coordinate on the
        circle instead of zero.

        Parameters
        ----------
        branch
            ``tool`` for the tool ball, ``workpiece`` for the work ball.
        circle
            Nominal circle of the test.
        angle_rad
            Angles of the bar from the first axis of the plane, shape (n,) [rad].
        """
        if branch == "workpiece":
            return np.zeros((len(angle_rad), 3)) + np.asarray(circle.centre_mm)
        without_axis = [axis not in self.topology for axis in LINEAR]
        return np.where(without_axis, circle.position_mm(angle_rad), 0.0)
