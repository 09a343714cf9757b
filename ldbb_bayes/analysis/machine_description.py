"""Describe a machine as its circular tests see it: parameters, units and patterns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ldbb_bayes.errors import require
from ldbb_bayes.machine.chain import LARGEST_MM, Circle, Joint, Machine
from ldbb_bayes.machine.linear import (
    Kept,
    compliance_jacobian,
    geometric_jacobian,
    kept_compliances,
)
from ldbb_bayes.machine.parameters import geometric_names
from ldbb_bayes.model.prior import compliance_unit, geometric_unit
from ldbb_bayes.results import Array, Result

__all__ = ["DescribedMachine", "VisibleParameter", "describe"]

# Radii at which patterns are sampled [mm]: a pattern is a polynomial in R of degree 3 at most.
_RADII_MM = np.array([1.0, 2.0, 3.0, 4.0])
# Angles at which patterns are sampled [rad].
_ANGLES_RAD = np.arange(24) * (2 * np.pi / 24)
# Degree in (c, s) of a pattern's part without R: forces act along the bar, and are seen along it.
_COMPLIANCE_DEGREE = 2
# The same of geometric errors, which are only seen along the bar.
_GEOMETRIC_DEGREE = 1
# Signs of powers from 0 to 4.
_EXPONENTS = ("", "", "²", "³", "⁴")
# Factors below this share of a pattern's largest value, or of one, are rounding.
_ROUNDING = 1e-9
# Decimals to which a factor is rounded before it is printed.
_FACTOR_DECIMALS = 9


@dataclass(frozen=True)
class VisibleParameter:
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
    compliances: tuple[VisibleParameter, ...]
    geometric_errors: tuple[VisibleParameter, ...]
    null: tuple[str, ...]  #: compliances that no reading shows
    dependent: tuple[str, ...]  #: those whose pattern is a combination of several kept ones
    rank: int
    #: of the kept compliances' columns, unscaled (mm, N), uniform full circles
    condition_number: float


def describe(machine: Machine, circles: Sequence[Circle] = ()) -> DescribedMachine:
    """Return names, units, patterns and sets of all that circular tests show of a machine.

    Parameters
    ----------
    machine
        Joints, planes and frames.
    circles
        Circles in the machine's planes. Default: R = 150 mm about the frames' origin in every
        plane. Patterns are those of the first circle of each plane.

    Returns
    -------
    DescribedMachine
        In inside units.

    Raises
    ------
    InputError
        For a circle in another plane, or with a centre out of reach.

    Examples
    --------
    >>> print(lb.describe(lb.Machine()))
    """
    circles = tuple(circles) or tuple(Circle(plane=plane) for plane in machine.planes)
    _check_circles(machine, circles)
    visible = kept_compliances(machine, *circles)
    return DescribedMachine(
        topology=machine.topology,
        planes=tuple(machine.planes),
        joints=tuple(_describe_joint(joint) for joint in machine.joints),
        centres_mm=tuple(dict.fromkeys(circle.centre_mm for circle in circles)),
        compliances=_describe_compliances(machine, circles, visible),
        geometric_errors=_describe_geometric_errors(machine, circles),
        null=visible.null,
        dependent=visible.dependent,
        rank=visible.rank,
        condition_number=visible.condition_number,
    )


def _check_circles(machine: Machine, circles: Sequence[Circle]) -> None:
    largest = max(np.abs(circle.centre_mm).max() for circle in circles)
    require(
        largest <= LARGEST_MM,
        f"centres must lie within {LARGEST_MM:g} mm, got {largest:g} mm. Check the unit.",
    )
    strange_planes = sorted({circle.plane for circle in circles} - set(machine.planes))
    require(
        not strange_planes,
        f"circles must lie in the machine's planes {machine.plane}, got"
        f" {', '.join(strange_planes[:1])}. Add the plane.",
    )


def _describe_joint(joint: Joint) -> str:
    """Return a joint in words, with branch and frame."""
    frame = ", ".join(f"{x:g}" for x in joint.frame_mm)
    return f"{joint.axis} in the {joint.branch} branch, frame at ({frame}) mm"


def _describe_compliances(
    machine: Machine, circles: Sequence[Circle], visible: Kept
) -> tuple[VisibleParameter, ...]:
    """Return the kept compliances, with what each stands for."""
    jacobians = {}
    for plane, sampled in _sampled_circles(machine, circles).items():
        columns = [
            compliance_jacobian(machine, circle, _ANGLES_RAD, visible.names) for circle in sampled
        ]
        jacobians[plane] = np.stack(columns)
    compliances = []
    for k, name in enumerate(visible.names):
        members = dict(zip(visible.sets[k], visible.weights[k], strict=True))
        for absorbed, weight in visible.absorbed[k].items():
            members[absorbed.label] = weight
        if len(members) == 1:
            members = {}
        compliance = VisibleParameter(
            name=name.label,
            unit=compliance_unit(name),
            meaning=name.meaning,
            pattern=_formulas(jacobians, k, _COMPLIANCE_DEGREE),
            not_negative=visible.not_negative[k],
            members=members,
        )
        compliances.append(compliance)
    return tuple(compliances)


def _describe_geometric_errors(
    machine: Machine, circles: Sequence[Circle]
) -> tuple[VisibleParameter, ...]:
    """Return the geometric errors."""
    jacobians = {}
    for plane, sampled in _sampled_circles(machine, circles).items():
        columns = [geometric_jacobian(machine, circle, _ANGLES_RAD) for circle in sampled]
        jacobians[plane] = np.stack(columns)
    errors = []
    for k, name in enumerate(geometric_names(machine)):
        error = VisibleParameter(
            name=name.label,
            unit=geometric_unit(name.kind),
            meaning=name.meaning,
            pattern=_formulas(jacobians, k, _GEOMETRIC_DEGREE),
            not_negative=False,
            members={},
        )
        errors.append(error)
    return tuple(errors)


def _sampled_circles(machine: Machine, circles: Sequence[Circle]) -> dict[str, list[Circle]]:
    """Return the first circle of each plane at the radii at which patterns are sampled."""
    first_circles = {circle.plane: circle for circle in reversed(circles)}
    sampled = {}
    for plane in machine.planes:
        if plane in first_circles:
            circle = first_circles[plane]
            sampled[plane] = [replace(circle, radius_mm=float(radius)) for radius in _RADII_MM]
    return sampled


class _Monomial(NamedTuple):
    """One term of a pattern: a factor, and a product of powers in words."""

    factor: float
    product: str


def _formulas(jacobians: Mapping[str, Array], column: int, degree: int) -> dict[str, str]:
    """Return formulas of one column by plane, planes that do not show it left out.

    ``jacobians`` have shape (radii, angles, columns).
    """
    formulas = {}
    for plane, jacobian in jacobians.items():
        monomials = _monomials(jacobian[:, :, column], degree)
        if monomials:
            formulas[plane] = _write_sum(monomials)
    return formulas


def _monomials(values: Array, degree: int) -> list[_Monomial]:
    """Return the monomials in R, c and s of a pattern sampled at (radii, angles).

    ``degree`` is the degree in (c, s) of the part without R.
    """
    by_radius_power = np.linalg.solve(np.vander(_RADII_MM, increasing=True), values)
    threshold = _ROUNDING * max(np.abs(values).max(), 1.0)
    cosine = np.cos(_ANGLES_RAD)
    sine = np.sin(_ANGLES_RAD)
    monomials = []
    for radius_power in reversed(range(len(_RADII_MM))):
        total = degree + radius_power
        columns = [cosine ** (total - power) * sine**power for power in range(total + 1)]
        design = np.stack(columns, axis=1)
        factors = np.linalg.lstsq(design, by_radius_power[radius_power], rcond=None)[0]
        for sine_power, factor in enumerate(factors.tolist()):
            if abs(factor) <= threshold:
                continue
            radius = _write_power("R", radius_power)
            separator = " " if radius else ""
            angle = _write_power("c", total - sine_power) + _write_power("s", sine_power)
            monomials.append(_Monomial(factor, radius + separator + angle))
    return monomials


def _write_power(letter: str, power: int) -> str:
    if power == 0:
        return ""
    return letter + _EXPONENTS[power]


def _write_sum(monomials: Sequence[_Monomial]) -> str:
    """Return a sum of monomials as text, factors of one left out."""
    text = ""
    for monomial in monomials:
        is_negative = monomial.factor < 0
        if is_negative:
            text += " − " if text else "−"
        elif text:
            text += " + "
        size = abs(round(monomial.factor, _FACTOR_DECIMALS))
        if size != 1.0:
            text += f"{size:g} "
        text += monomial.product
    return text
