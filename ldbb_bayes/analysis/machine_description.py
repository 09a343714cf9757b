"""Describe a machine as its circular tests see it: parameters, units and patterns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ldbb_bayes.errors import require
from ldbb_bayes.machine import chain
from ldbb_bayes.machine.chain import Circle, Machine
from ldbb_bayes.model.prior import compliance_unit, geometric_unit
from ldbb_bayes.results import Array, Result

__all__ = ["DescribedMachine", "Seen", "describe"]


@dataclass(frozen=True)
class Seen:
    """A parameter that circles show."""

    name: str
    unit: str
    meaning: str
    #: by plane, of the reading per unit (and N of a compliance); c = cos θ, s = sin θ, lengths
    #: in mm
    pattern: Mapping[str, str]
    not_negative: bool  #: whatever the joints are; the prior's truncation is about these
    #: what it is the sum of, with their weights; empty where it stands for itself
    members: Mapping[str, float]


@dataclass(frozen=True)
class DescribedMachine(Result):
    """A machine as its circular tests see it."""

    topology: str
    planes: tuple[str, ...]
    joints: tuple[str, ...]  #: with branch, from the workpiece to the tool
    centres_mm: tuple[tuple[float, float, float], ...]
    compliances: tuple[Seen, ...]
    geometric_errors: tuple[Seen, ...]
    null: tuple[str, ...]  #: compliances that no reading shows
    dependent: tuple[str, ...]  #: those whose pattern is a combination of several kept ones
    rank: int
    #: of the kept compliances' columns, unscaled (mm, N), uniform full circles
    condition_number: float


def describe(machine: Machine, circles: Sequence[Circle] = ()) -> DescribedMachine:
    """Names, units, patterns and sets of all that circular tests in these planes show.

    Parameters
    ----------
    circles : default: R = 150 mm about the frames' origin in every plane. Patterns are those of the
        first circle of each plane.
    """
    circles = tuple(circles) or tuple(Circle(plane=plane) for plane in machine.planes)
    largest = max(abs(x) for circle in circles for x in circle.centre_mm)
    require(
        largest <= chain.LARGEST_MM,
        f"centres must lie within {chain.LARGEST_MM:g} mm, got {largest:g} mm. Check the unit.",
    )
    stranger = next(iter(sorted({circle.plane for circle in circles} - set(machine.planes))), None)
    require(
        not stranger,
        f"circles must lie in the machine's planes {machine.plane}, got {stranger}. Add the plane.",
    )
    kept = chain.kept_compliances(machine, *circles)
    first = {circle.plane: circle for circle in reversed(circles)}

    at = {
        plane: [replace(first[plane], radius_mm=float(r)) for r in _RADII]
        for plane in machine.planes
        if plane in first
    }
    seen = chain.compliance_jacobian
    elastic = {
        p: np.stack([seen(machine, own, _ANGLE, kept.names) for own in each])
        for p, each in at.items()
    }
    rigid = {
        p: np.stack([chain.geometric_jacobian(machine, own, _ANGLE) for own in each])
        for p, each in at.items()
    }
    compliances = []
    for k, name in enumerate(kept.names):
        members = dict(zip(kept.sets[k], kept.weights[k], strict=True)) | {
            n.label: w for n, w in kept.absorbed[k].items()
        }
        pattern = _patterns(elastic, k, 2)
        stands_for = members if len(members) > 1 else {}
        compliances.append(
            Seen(
                name.label,
                compliance_unit(name),
                name.meaning,
                pattern,
                kept.not_negative[k],
                stands_for,
            )
        )
    errors = [
        Seen(name.label, geometric_unit(name.kind), name.meaning, _patterns(rigid, k, 1), False, {})
        for k, name in enumerate(chain.geometric_names(machine))
    ]
    joints = [
        (joint.axis, joint.branch, ", ".join(f"{x:g}" for x in joint.frame_mm))
        for joint in machine.joints
    ]
    return DescribedMachine(
        machine.topology,
        tuple(machine.planes),
        tuple(f"{axis} in the {branch} branch, frame at ({at}) mm" for axis, branch, at in joints),
        tuple(dict.fromkeys(circle.centre_mm for circle in circles)),
        tuple(compliances),
        tuple(errors),
        kept.null,
        kept.dependent,
        kept.rank,
        kept.condition_number,
    )


_RADII = np.array([1.0, 2.0, 3.0, 4.0])


_ANGLE = np.arange(24) * (2 * np.pi / 24)


_POWERS = ("", "", "²", "³", "⁴")


_NEGLIGIBLE = 1e-9


def _patterns(values: Mapping[str, Array], k: int, base: int) -> dict[str, str]:
    """Formulas of column k by plane, planes that do not show it left out; values (radii, angles,
    columns)."""
    return {plane: text for plane, own in values.items() if (text := _formula(own[:, :, k], base))}


def _formula(values: Array, base: int) -> str:
    """The formula of a column (radii, angles); ``base``: degree in (c, s) of the part without R."""
    by_power = np.linalg.solve(np.vander(_RADII, increasing=True), values)
    least = _NEGLIGIBLE * max(np.abs(values).max(), 1.0)
    text = ""
    for power in range(len(_RADII) - 1, -1, -1):
        degree = base + power
        monomials = np.stack(
            [np.cos(_ANGLE) ** (degree - k) * np.sin(_ANGLE) ** k for k in range(degree + 1)],
            axis=1,
        )
        for k, factor in enumerate(
            np.linalg.lstsq(monomials, by_power[power], rcond=None)[0].tolist()
        ):
            if abs(factor) > least:
                size = abs(round(factor, 9))
                sign = (" − " if factor < 0 else " + ") if text else "−" * (factor < 0)
                monomial = _power("R", power, " ") + _power("c", degree - k) + _power("s", k)
                text += sign + ("" if size == 1.0 else f"{size:g} ") + monomial
    return text


def _power(letter: str, power: int, after: str = "") -> str:
    return letter + _POWERS[power] + after if power else ""
