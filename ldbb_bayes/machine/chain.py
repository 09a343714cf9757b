"""The machine as a serial chain: topology and planes → driven joints, and the names of all
compliances and geometric errors.

A topology such as ``wCAFYXZSt`` reads from the workpiece ``w`` through the foundation ``F`` to the
tool ``t`` (ISO 10791 style). A circular test drives the two linear axes of its plane; the joints of
all planes tested carry the compliances and geometric errors of the model. Vectors are (X, Y, Z) of
the machine.

The bar reads what homogeneous transforms say (Eq. 1-14), or what every parameter adds per unit (Eq.
16-23). For a unit force along the bar, joint k sees the wrench g_k = J_kᵀ B̂ = (B̂, lever × B̂):
three forces, three moments about its frame. By Eq. 20 a compliance C_ijk (twist i for wrench j at
joint k) then changes the reading by g_k,i · g_k,j. An error motion of joint k, a twist e about the
same frame, changes it by ± g_k · e, minus in the workpiece branch. The planar model of the paper is
what remains while the levers lie in the plane. Of the compliances only what circles can separate is
kept: null columns, proportional sets and their representatives (Table 2).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from ldbb_bayes.errors import check_known, require
from ldbb_bayes.results import Array, Shown, readable
from ldbb_bayes.units import inside_name

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "LARGEST_MM",
    "LINEAR",
    "PLANES",
    "ROTARY",
    "Axes",
    "Circle",
    "ComplianceKind",
    "ComplianceName",
    "GeometricKind",
    "GeometricName",
    "Joint",
    "Kept",
    "Machine",
    "compliance_jacobian",
    "exact_reading_mm",
    "geometric_jacobian",
    "geometric_names",
    "geometric_reading_mm",
    "hybrid_jacobian",
    "joint_names",
    "kept_compliances",
    "patterns",
    "wrench_jacobian",
    "wrench_names",
]

Branch = Literal["tool", "workpiece"]
LINEAR = "XYZ"
ROTARY = "ABC"
_COMPONENTS = LINEAR + ROTARY
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


def wrench_jacobian(machine: Machine, circle: Circle, angle_rad: Array) -> Array:
    """The paper's planar wrench Jacobian: reading per unit force and unit compliance, shape (n, 18)
    for one plane. Columns in the order of `wrench_names` [1, mm or mm²]; times F [N] and C they
    give the reading [mm]."""
    return compliance_jacobian(machine, circle, angle_rad, wrench_names(machine))


def compliance_jacobian(
    machine: Machine, circle: Circle, angle_rad: Array, names: Sequence[ComplianceName]
) -> Array:
    """Reading per unit force and unit compliance, Eq. 20-23, at angles (n,) [rad], of any of
    `joint_names`, shape (n, compliances) [1, mm or mm²]."""
    direction = circle.direction(angle_rad)
    joints = {name.joint for name in names}
    wrench = {
        axis: _wrench(machine.lever_mm(machine.joint(axis), circle, angle_rad), direction)
        for axis in joints
    }
    columns = np.zeros((len(angle_rad), len(names)))
    for k, name in enumerate(names):
        own = wrench[name.joint]
        columns[:, k] = (
            own[:, _COMPONENTS.index(name.twist)] * own[:, _COMPONENTS.index(name.wrench)]
        )
    return columns


def geometric_jacobian(machine: Machine, circle: Circle, angle_rad: Array) -> Array:
    """Reading per unit geometric error, Eq. 16-18, shape (n, geometric errors): columns in the
    order of `geometric_names` [mm per unit of the error]."""
    return np.stack(
        [_error_column(machine, circle, angle_rad, name) for name in geometric_names(machine)],
        axis=1,
    )


def _error_column(machine: Machine, circle: Circle, angle_rad: Array, name: GeometricName) -> Array:
    direction = circle.direction(angle_rad)
    component = _COMPONENTS.index(name.component)
    if name.kind == "offset":
        return direction[:, component]
    joint, before = _bearer(machine, name)
    lever = machine.lever_mm(joint, circle, angle_rad)
    coordinate = joint.sign * circle.position_mm(angle_rad)[:, joint.index]
    if before:
        lever[:, joint.index] += coordinate
    return joint.sign * coordinate**name.order * _wrench(lever, direction)[:, component]


def _bearer(machine: Machine, name: GeometricName) -> tuple[Joint, bool]:
    """The joint at which an error sits, and whether it comes before the joint's own motion. A
    squareness turns what the primary axis carries when both axes are in one branch; else it turns
    the secondary axis itself."""
    if name.kind != "squareness":
        return machine.joint(name.axis), False
    primary = machine.joint(name.reference)
    secondary = machine.joint(name.axis)
    return (primary, False) if primary.branch == secondary.branch else (secondary, True)


def _wrench(lever: Array, direction: Array) -> Array:
    return np.concatenate([direction, np.cross(lever, direction)], axis=1)


def exact_reading_mm(
    machine: Machine,
    circle: Circle,
    angle_rad: Array,
    *,
    force_N: float = 0.0,
    compliances: Mapping[str, float] | None = None,
    geometric_errors: Mapping[str, float] | None = None,
) -> Array:
    """Return the exact reading of one circle, shape (n,) [mm]: geometry by Eq. 1-14 plus compliance
    by Eq. 20.

    InputError for names that the machine does not have.

    Parameters
    ----------
    circle, angle_rad : where: angles θ, shape (n,) [rad].
    force_N : radial force.
    compliances : any of the 36 ``C_ijk`` of each joint [mm/N, rad/N, rad/(N mm)]; the others are
        zero.
    geometric_errors : any of `geometric_names` [1, 1/mm, rad, mm]; the others are zero.
    """
    given = compliances or {}
    every = {name.label: name for name in joint_names(machine)}
    check_known("parameter", given, tuple(every))
    columns = compliance_jacobian(machine, circle, angle_rad, [every[label] for label in given])
    elastic = force_N * columns @ np.array(list(given.values()), dtype=float)
    errors = {inside_name(name): value for name, value in (geometric_errors or {}).items()}
    return geometric_reading_mm(machine, circle, angle_rad, errors) + elastic


def geometric_reading_mm(
    machine: Machine, circle: Circle, angle_rad: Array, geometric_errors: Mapping[str, Any]
) -> Array:
    """Exact geometric part of the reading (Eq. 13-14), shape (n,) [mm]. Complex errors are allowed
    (complex step)."""
    check_known("parameter", geometric_errors, [name.label for name in geometric_names(machine)])
    tool = _branch(machine, "tool", circle, angle_rad, geometric_errors)
    work = _branch(machine, "workpiece", circle, angle_rad, geometric_errors)
    offset = np.array([geometric_errors.get(f"E_{axis}t0", 0.0) for axis in LINEAR])
    tool = tool @ _translation(machine.end_mm("tool", circle, angle_rad) + offset)
    work = work @ _translation(machine.end_mm("workpiece", circle, angle_rad))
    gap = tool[:, :3, 3] - work[:, :3, 3]
    distance: Array = np.sqrt((gap**2).sum(axis=1))
    return distance - circle.radius_mm


def _branch(
    machine: Machine, branch: Branch, circle: Circle, angle_rad: Array, errors: Mapping[str, Any]
) -> Array:
    """Transform from the foundation to the end of a branch, shape (n, 4, 4)."""
    transform = np.broadcast_to(np.eye(4), (len(angle_rad), 4, 4))
    position = circle.position_mm(angle_rad)
    for joint in machine.branch(branch):
        transform = transform @ _joint_transform(
            machine, joint, joint.sign * position[:, joint.index], errors
        )
    return transform


def _joint_transform(
    machine: Machine, joint: Joint, coordinate: Array, errors: Mapping[str, Any]
) -> Array:
    """One joint: its nominal motion followed by its error motion (Eq. 4-5, 8-9), about its own
    frame."""
    motion = np.zeros((len(coordinate), 3), dtype=np.result_type(float, *errors.values()))
    motion[:, joint.index] = coordinate
    before = np.eye(4)
    after = np.eye(4)
    for name in geometric_names(machine):
        if name.kind == "offset" or _bearer(machine, name)[0] != joint or name.label not in errors:
            continue
        value = errors[name.label]
        if name.kind == "squareness":
            turn = _rotation(ROTARY.index(name.component), value)
            before, after = (
                (before @ turn, after) if _bearer(machine, name)[1] else (before, after @ turn)
            )
        else:
            motion[:, LINEAR.index(name.component)] += value * coordinate**name.order
    frame = np.asarray(joint.frame_mm)[None]
    return _translation(frame) @ before @ _translation(motion) @ after @ _translation(-frame)


def _translation(vector: Array) -> Array:
    """Shape (n, 3) → (n, 4, 4)."""
    transform = np.tile(np.eye(4, dtype=vector.dtype), (len(vector), 1, 1))
    transform[:, :3, 3] = vector
    return transform


def _rotation(axis: int, angle: Any) -> Array:
    """About X, Y or Z, shape (4, 4)."""
    first = (axis + 1) % 3
    second = (axis + 2) % 3
    transform = np.eye(4, dtype=np.result_type(float, angle))
    transform[first, first] = transform[second, second] = np.cos(angle)
    transform[first, second], transform[second, first] = -np.sin(angle), np.sin(angle)
    return transform


# ---- what can be known of the compliances

_ANGLES = 64
_PARALLEL = 1e-10
_TINY = 1e-10
_TINY_WEIGHT = 1e-7
_NEW = 1e-8


@dataclass(frozen=True)
class Kept:
    """What remains of the wrench Jacobian. The weights of a set are the pattern of each member in
    units of the representative's [mm or mm² per rotation more]."""

    #: one representative per proportional set, in the order of Table 1
    names: tuple[ComplianceName, ...]
    #: proportional sets (Table 2), whose weighted sums the kept ones are, representative first
    sets: tuple[tuple[str, ...], ...]
    weights: tuple[tuple[float, ...], ...]
    #: what each stands for beside its set: dropped sets, with weights
    absorbed: tuple[Mapping[ComplianceName, float], ...]
    #: a deflection under the load itself, whatever the joints' (semi-definite) matrices are
    not_negative: tuple[bool, ...]
    null: tuple[str, ...]  #: never change a reading
    dependent: tuple[str, ...]  #: heads of sets that are combinations of several others
    rank: int  #: of the full Jacobian: unit force, full uniform circle, unscaled (mm, N)
    condition_number: float  #: of the kept columns


def kept_compliances(machine: Machine, *circles: Circle) -> Kept:
    """Null columns, proportional sets and representatives of the wrench Jacobian (Table 2), found
    numerically.

    The planar compliances of every plane are looked at, and of the others those that the circles'
    lever arms load. In a set the representative is chosen by these rules, in this order; for the
    paper's machine they give the paper's choice:

    1. a rotation for a force before a translation for a moment;
    2. the fewest rotations;
    3. the joint whose axis is the deflection;
    4. of a rotation, a joint that drives the plane it turns;
    5. alphabetical order.

    The circles of a campaign are taken together: another centre or plane can separate compliances
    that one circle cannot. Default: R = 150 mm about the frames' origin in every plane.
    """
    return _kept(machine, circles or tuple(Circle(plane=plane) for plane in machine.planes))


@lru_cache(maxsize=64)
def _kept(machine: Machine, circles: tuple[Circle, ...]) -> Kept:
    angle = np.arange(_ANGLES) * (2 * np.pi / _ANGLES)
    planar = set(wrench_names(machine))
    names = joint_names(machine)
    jacobian = np.concatenate(
        [compliance_jacobian(machine, circle, angle, names) for circle in circles]
    )
    unit = jacobian / [circles[0].radius_mm ** name.rotations for name in names]
    norms = np.linalg.norm(unit, axis=0)
    used = [i for i in range(len(names)) if norms[i] > _TINY * norms.max() or names[i] in planar]
    used.sort(key=lambda i: (names[i] not in planar, i))
    names = tuple(names[i] for i in used)
    jacobian = jacobian[:, used]
    unit = unit[:, used]
    norms = norms[used]
    live = [i for i in range(len(names)) if norms[i] > _TINY * norms.max()]
    unit = unit / np.where(norms > 0, norms, 1.0)
    by_head = {group[0]: group for group in _proportional_sets(unit, live, names)}
    heads = sorted(by_head, key=lambda i: _table_order(names[i], machine))
    chosen = _independent(unit, heads)
    dropped = [i for i in heads if i not in chosen]
    singular = np.linalg.svd(jacobian[:, chosen], compute_uv=False)
    scale = np.abs(jacobian[:, chosen]).max(axis=0)
    coefficients = (
        np.linalg.lstsq(jacobian[:, chosen] / scale, jacobian, rcond=None)[0] / scale[:, None]
    )
    sizes = (jacobian**2).sum(axis=0)
    relative = scale[:, None] / np.maximum(np.abs(jacobian).max(axis=0), _TINY)
    return Kept(
        names=tuple(names[i] for i in chosen),
        sets=tuple(tuple(names[j].label for j in by_head[i]) for i in chosen),
        weights=tuple(
            tuple(np.round(jacobian[:, i] @ jacobian[:, by_head[i]] / sizes[i], 9).tolist())
            for i in chosen
        ),
        absorbed=tuple(
            {
                names[j]: float(np.round(row[j], 9))
                for i in dropped
                for j in by_head[i]
                if abs(row[j] * size[j]) > _TINY_WEIGHT
            }
            for row, size in zip(coefficients, relative, strict=True)
        ),
        not_negative=_not_negative(names, jacobian, coefficients),
        null=tuple(name.label for i, name in enumerate(names) if i not in live),
        dependent=tuple(names[i].label for i in dropped),
        rank=int(np.linalg.matrix_rank(unit[:, live], tol=_TINY * np.sqrt(len(live)))),
        condition_number=float(singular[0] / singular[-1]),
    )


def _not_negative(
    names: Sequence[ComplianceName], jacobian: Array, coefficients: Array
) -> tuple[bool, ...]:
    """A kept compliance is Σ_k ⟨A_k, C_k⟩ over the joints' matrices, all columns written in those
    kept: it cannot be negative for positive semi-definite C_k if and only if every A_k is positive
    semi-definite."""
    six = LINEAR + ROTARY
    unit = dict.fromkeys(LINEAR + ROTARY, 1.0)
    for i, name in enumerate(names):
        if name.twist == name.wrench:
            unit[name.twist] = max(unit[name.twist], float(np.sqrt(np.abs(jacobian[:, i]).max())))
    found = []
    for row in coefficients:
        joints: dict[str, Array] = {}
        for name, value in zip(names, row, strict=True):
            matrix = joints.setdefault(name.joint, np.zeros((6, 6)))
            i = six.index(name.twist)
            j = six.index(name.wrench)
            weight = 0.5 * value / (unit[name.twist] * unit[name.wrench])
            matrix[i, j] += weight
            matrix[j, i] += weight
        largest = max(np.abs(matrix).max() for matrix in joints.values())
        found.append(
            all(
                np.linalg.eigvalsh(matrix).min() > -_TINY_WEIGHT * largest
                for matrix in joints.values()
            )
        )
    return tuple(found)


def _proportional_sets(
    unit: Array, live: Sequence[int], names: Sequence[ComplianceName]
) -> list[list[int]]:
    """Group columns that are multiples of one another; the preferred name leads its set."""
    sets: list[list[int]] = []
    for i in live:
        same = (group for group in sets if 1.0 - abs(unit[:, i] @ unit[:, group[0]]) <= _PARALLEL)
        if (group := next(same, None)) is None:
            sets.append([i])
        else:
            group.append(i)
    return [sorted(group, key=lambda i: names[i].preference) for group in sets]


def _table_order(name: ComplianceName, machine: Machine) -> tuple[int, int, int, int]:
    """Order of Table 1: translations for forces, rotations for forces, rotation for moment; joints
    in the planes' order."""
    joints = [joint.axis for joint in machine.joints]
    components = [*joints, *(axis for axis in LINEAR if axis not in joints), *ROTARY]
    return (
        name.rotations,
        components.index(name.twist),
        components.index(name.wrench),
        joints.index(name.joint),
    )


def _independent(unit: Array, representatives: Sequence[int]) -> list[int]:
    """Representatives in order that each add a new direction."""
    chosen: list[int] = []
    basis = np.zeros((unit.shape[0], 0))
    for i in representatives:
        if np.linalg.norm(unit[:, i] - basis @ (basis.T @ unit[:, i])) > _NEW:
            chosen.append(i)
            basis = np.linalg.qr(unit[:, chosen])[0]
    return chosen


def hybrid_jacobian(
    machine: Machine,
    circle: Circle,
    angle_rad: Array,
    force_N: float,
    *,
    degree: int = 0,
    reference_force_N: float = 0.0,
) -> pd.DataFrame:
    """Return the reading per unit of every parameter of the linear hybrid model, J_H of Eq. 28 and,
    with F0 = 0, 33: DataFrame, shape (n, (degree + 1) compliances + geometric errors) [mm per
    inside unit of the parameter].

    Column k of a compliance is F (F − F0)^k j_C. Columns are those of this circle alone, named as
    in results: C_XXX …, C_XXX_1 …, then E_XX1 … . InputError for a degree other than 0, 1 or 2.

    Parameters
    ----------
    circle, angle_rad : where: angles θ, shape (n,) [rad].
    force_N, reference_force_N : radial force F, and F0.
    degree : 0, 1 or 2.
    """
    import pandas as pd

    require(
        degree in (0, 1, 2),
        f"degree must be 0, 1 or 2, got {degree}. Choose constant, linear or quadratic compliance.",
    )
    angle = np.asarray(angle_rad, dtype=float)
    kept = kept_compliances(machine, circle).names
    elastic = force_N * compliance_jacobian(machine, circle, angle, kept)
    columns = {
        name.label + (f"_{k}" if k else ""): elastic[:, j] * (force_N - reference_force_N) ** k
        for k in range(degree + 1)
        for j, name in enumerate(kept)
    }
    geometric = geometric_jacobian(machine, circle, angle).T
    columns |= {
        name.label: own for name, own in zip(geometric_names(machine), geometric, strict=True)
    }
    return readable(pd.DataFrame(columns))


def patterns(machine: Machine, circle: Circle, angle_rad: Array) -> pd.DataFrame:
    """Return what one unit of every planar compliance, 18 for one plane, and of every geometric
    error, 7, does to readings of a ``circle`` at ``angle_rad`` (n,): DataFrame, shape (n, 25) [mm
    per unit, and N of compliances] (Tables 2 and 3)."""
    import pandas as pd

    angle = np.asarray(angle_rad, dtype=float)
    names = [
        *(name.label for name in wrench_names(machine)),
        *(name.label for name in geometric_names(machine)),
    ]
    values = np.hstack(
        [wrench_jacobian(machine, circle, angle), geometric_jacobian(machine, circle, angle)]
    )
    return readable(pd.DataFrame(values, columns=names))
