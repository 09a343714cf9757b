"""What a circular test can show of a machine: compliances and geometric errors with their patterns and sets."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.errors import InputError
from ldbb_bayes.machine.chain import LARGEST_MM, Circle, Machine, geometric_names
from ldbb_bayes.machine.forward import compliance_jacobian, geometric_jacobian
from ldbb_bayes.machine.identifiable import Kept, kept_compliances
from ldbb_bayes.model.prior import compliance_unit, geometric_unit
from ldbb_bayes.result import Result

__all__ = ["DescribedMachine", "Seen", "describe"]

Array = NDArray[Any]


@dataclass(frozen=True)
class Seen:
    """A parameter that circles show.

    Attributes
    ----------
    name, unit, meaning : str
        Inside unit.
    pattern : mapping of plane to str
        Change of the reading per unit (per unit and N for a compliance); c = cos θ, s = sin θ, lengths in mm.
    not_negative : bool
        Whether it cannot be negative, whatever the joints are; the prior's truncation is about these.
    members : mapping of name to float
        What the parameter stands for: the sum of these times their weights. Empty where it stands for itself.
    """

    name: str
    unit: str
    meaning: str
    pattern: Mapping[str, str]
    not_negative: bool
    members: Mapping[str, float]


@dataclass(frozen=True)
class DescribedMachine(Result):
    """A machine as its circular tests see it.

    Attributes
    ----------
    topology, planes, joints : as words
        Joints with branch, from the workpiece to the tool.
    centres_mm : tuple of (X, Y, Z)
        Of the circles taken together.
    compliances, geometric_errors : tuple of Seen
    null : tuple of str
        Compliances that no reading shows.
    dependent : tuple of str
        Compliances whose pattern is a combination of several kept ones.
    rank : int
    condition_number : float
        Of the kept compliances' columns, unscaled (mm, N), uniform full circles.
    """

    topology: str
    planes: tuple[str, ...]
    joints: tuple[str, ...]
    centres_mm: tuple[tuple[float, float, float], ...]
    compliances: tuple[Seen, ...]
    geometric_errors: tuple[Seen, ...]
    null: tuple[str, ...]
    dependent: tuple[str, ...]
    rank: int
    condition_number: float


def describe(machine: Machine, circles: Sequence[Circle] = ()) -> DescribedMachine:
    """Names, units, patterns and sets of all that circular tests in these planes show.

    Parameters
    ----------
    machine : Machine
    circles : sequence of Circle
        Default: R = 150 mm about the frames' origin in every plane. Patterns are those of the first circle of each plane.
    """
    circles = tuple(circles) or tuple(Circle(plane=plane) for plane in machine.planes)
    largest = max(abs(x) for circle in circles for x in circle.centre_mm)
    if largest > LARGEST_MM:
        raise InputError(f"centres must lie within {LARGEST_MM:g} mm, got {largest:g} mm. Check the unit.")
    strangers = sorted({circle.plane for circle in circles} - set(machine.planes))
    if strangers:
        raise InputError(f"circles must lie in the machine's planes {machine.plane}, got {strangers[0]}. Add the plane.")
    kept = kept_compliances(machine, *circles)
    first = {circle.plane: circle for circle in reversed(circles)}
    return DescribedMachine(
        machine.topology,
        tuple(machine.planes),
        tuple(
            f"{joint.axis} in the {joint.branch} branch, frame at ({', '.join(f'{x:g}' for x in joint.frame_mm)}) mm"
            for joint in machine.joints
        ),
        tuple(dict.fromkeys(circle.centre_mm for circle in circles)),
        tuple(_compliance(machine, first, kept, k) for k in range(len(kept.names))),
        tuple(_geometric(machine, first, k) for k in range(len(geometric_names(machine)))),
        kept.null,
        kept.dependent,
        kept.rank,
        kept.condition_number,
    )


def _compliance(machine: Machine, circles: Mapping[str, Circle], kept: Kept, k: int) -> Seen:
    name = kept.names[k]

    def column(circle: Circle, radius_mm: float, angle_rad: Array) -> Array:
        return compliance_jacobian(machine, replace(circle, radius_mm=radius_mm), angle_rad, [name])[:, 0]

    members = dict(zip(kept.sets[k], kept.weights[k], strict=True)) | {n.label: w for n, w in kept.absorbed[k].items()}
    members = members if len(members) > 1 else {}
    pattern = _patterns(machine, circles, column, 2)
    return Seen(name.label, compliance_unit(name), name.meaning, pattern, kept.not_negative[k], members)


def _geometric(machine: Machine, circles: Mapping[str, Circle], k: int) -> Seen:
    name = geometric_names(machine)[k]

    def column(circle: Circle, radius_mm: float, angle_rad: Array) -> Array:
        return geometric_jacobian(machine, replace(circle, radius_mm=radius_mm), angle_rad)[:, k]

    return Seen(name.label, geometric_unit(name.kind), name.meaning, _patterns(machine, circles, column, 1), False, {})


def _patterns(
    machine: Machine, circles: Mapping[str, Circle], column: Callable[[Circle, float, Array], Array], base: int
) -> dict[str, str]:
    """By plane, in the machine's order, planes that do not show it left out."""
    every = {plane: _pattern_of(partial(column, circles[plane]), base) for plane in machine.planes if plane in circles}
    return {plane: pattern for plane, pattern in every.items() if pattern != "0"}


_RADII = np.array([1.0, 2.0, 3.0, 4.0])
_ANGLE = np.arange(24) * (2 * np.pi / 24)
_POWERS = ("", "", "²", "³", "⁴")
_NEGLIGIBLE = 1e-9


def _pattern_of(column: Callable[[float, Array], Array], base: int) -> str:
    """The formula of a column (R [mm], angles (n,) [rad]) → (n,); ``base``: degree in (c, s) of the part without R."""
    values = np.stack([column(float(radius), _ANGLE) for radius in _RADII])
    by_power = np.linalg.solve(np.vander(_RADII, increasing=True), values)
    largest = np.abs(values).max()
    if largest < _NEGLIGIBLE:
        return "0"
    text = ""
    for power in range(len(_RADII) - 1, -1, -1):
        degree = base + power
        monomials = np.stack([np.cos(_ANGLE) ** (degree - k) * np.sin(_ANGLE) ** k for k in range(degree + 1)], axis=1)
        if np.abs(by_power[power]).max() < _NEGLIGIBLE * largest:
            continue
        factors = np.linalg.lstsq(monomials, by_power[power], rcond=None)[0]
        for k, factor in enumerate(factors.tolist()):
            if abs(factor) > _NEGLIGIBLE * largest:
                size = abs(round(factor, 9))
                sign = (" − " if factor < 0 else " + ") if text else "−" * (factor < 0)
                monomial = _power("R", power, " ") + _power("c", degree - k) + _power("s", k)
                text += sign + ("" if size == 1.0 else f"{size:g} ") + monomial
    return text


def _power(letter: str, power: int, after: str = "") -> str:
    return letter + _POWERS[power] + after if power else ""
