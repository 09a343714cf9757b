"""Description of a machine by the parameters that its circular tests can determine.

Each parameter is described by its name, unit, meaning and pattern. The pattern is a formula that
gives the change of the readings per unit of the parameter. It contains the angle θ and the radius R
of the circle.
"""

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
from ldbb_bayes.model.parameter_kinds import compliance_unit, geometric_unit
from ldbb_bayes.results import Array, Result

__all__ = ["DescribedMachine", "VisibleParameter", "describe_machine"]

# Radii of circles for which the effects of the parameters on the readings are computed, to find a
# formula for these effects [mm]. Four radii suffice, because an effect is a polynomial in the
# radius of degree 3 at most.
_RADII_MM = np.array([1.0, 2.0, 3.0, 4.0])
# Angles on the circle at which the effects of the parameters on the readings are computed, to find
# a formula for these effects [rad].
_ANGLES_RAD = np.arange(24) * (2 * np.pi / 24)
# In the formula for the effect of a compliance on the reading, each term without the radius has
# this number of factors cos θ or sin θ, where θ is the angle of the circle. The compliance C_XXX,
# for example, changes the reading by cos²θ per unit of compliance and of force. One factor comes
# from the force, which acts along the bar, and one from the deflection, which is measured along the
# bar. Terms that contain the radius have more factors.
_COMPLIANCE_DEGREE = 2
# In the formula for the effect of a geometric error on the reading, each term without the radius
# has this number of factors cos θ or sin θ, where θ is the angle of the circle. There is one
# factor, because the reading shows only the component of the error along the bar. Terms that
# contain the radius have more factors.
_GEOMETRIC_DEGREE = 1
# Superscripts with which the powers 0 … 4 of a symbol are written in a formula, such as c²; the
# superscripts of the powers 0 and 1 are empty.
_EXPONENTS = ("", "", "²", "³", "⁴")
# The formula for a parameter's effect on the readings is fitted to computed values of the effect. A
# numerical factor of the formula counts as a rounding error if it is at most this number times the
# largest of these values. If all values are below 1, this number itself is the limit.
_ROUNDING = 1e-9
# Number of decimals to which a numerical factor is rounded before it is printed in the formula of a
# parameter's effect on the readings.
_FACTOR_DECIMALS = 9


@dataclass(frozen=True)
class VisibleParameter:
    """A compliance or geometric error that circular tests can determine."""

    name: str
    unit: str
    meaning: str
    #: formula for the effect of the parameter on the reading, for each plane; the keys are names of
    #: planes. The effect of a geometric error is the change of the reading [mm] per unit of the
    #: error. The effect of a compliance is the change of the reading [mm] per unit of the
    #: compliance and per N of force. In the formula, c = cos θ and s = sin θ for the angle θ on the
    #: circle, and R is the radius of the circle in mm.
    pattern: Mapping[str, str]
    #: whether the parameter is at least zero for all possible compliances of the joints. If so, the
    #: prior excludes negative values of the parameter.
    not_negative: bool
    #: If the readings determine only a weighted sum of several compliances, this parameter
    #: represents the sum. The keys are then the names of these compliances, and the values are
    #: their weights. Otherwise, the mapping is empty.
    members: Mapping[str, float]


@dataclass(frozen=True)
class DescribedMachine(Result):
    """Description of a machine by the parameters that its circular tests can determine."""

    topology: str
    planes: tuple[str, ...]
    #: description of each joint in words (axis, branch of the workpiece or of the tool, and frame),
    #: in order from the workpiece to the tool
    joints: tuple[str, ...]
    centres_mm: tuple[tuple[float, ...], ...]
    compliances: tuple[VisibleParameter, ...]
    geometric_errors: tuple[VisibleParameter, ...]
    null: tuple[str, ...]  #: names of the machine's compliances that have no effect on any reading
    #: names of the compliances that are not in ``compliances``, because other compliances together
    #: have the same effect on the readings
    dependent: tuple[str, ...]
    #: number of linearly independent effects that the machine's compliances have on the readings;
    #: this is the rank of the matrix that holds the derivatives of the readings with respect to all
    #: compliances
    rank: int
    #: condition number of the matrix that holds the derivatives of the readings with respect to
    #: ``compliances``, for full circles with evenly spaced angles. The derivatives are computed in
    #: units of mm and N, without any scaling of the columns of the matrix.
    condition_number: float


def describe_machine(machine: Machine, circles: Sequence[Circle] = ()) -> DescribedMachine:
    """Describe a machine by the parameters that circular tests can determine.

    Parameters
    ----------
    machine : Machine
        Machine with its joints, planes and frames.
    circles : sequence of Circle
        Circles in the machine's planes. Default: one circle in every plane, with a radius of 150 mm
        and its centre at the origin of the frames. The formulas in the result are those for the
        first circle of each plane.

    Returns
    -------
    DescribedMachine
        Name, unit, meaning and pattern of each parameter, in internal units (mm, N, rad). The
        pattern is a formula for the change of the reading per unit of the parameter. In the
        formula, c = cos θ and s = sin θ for the angle θ of the circle, and R is the radius in mm.

    Raises
    ------
    InputError
        For a circle in a plane that the machine does not have, or for a centre with a coordinate
        above 100 m.

    Examples
    --------
    >>> described = lb.describe_machine(lb.Machine())
    >>> [compliance.name for compliance in described.compliances]
    ['C_XXX', 'C_XYX', 'C_YYY', 'C_CXY', 'C_CYY', 'C_CCY']
    >>> described.compliances[0].pattern["XY"], described.compliances[2].pattern["XY"]
    ('c²', 's²')
    >>> described.null  # compliances that change no reading
    ('C_XCX', 'C_YCX', 'C_CXX', 'C_CYX', 'C_CCX')
    """
    circles = tuple(circles) or tuple(Circle(plane=plane) for plane in machine.planes)
    _check_circles(machine, circles)
    visible = kept_compliances(machine, *circles)
    return DescribedMachine(
        topology=machine.topology,
        planes=tuple(machine.planes),
        joints=tuple(_describe_joint(joint) for joint in machine.joints),
        centres_mm=tuple(dict.fromkeys(tuple(circle.centre_mm) for circle in circles)),
        compliances=_describe_compliances(machine, circles, visible),
        geometric_errors=_describe_geometric_errors(machine, circles),
        null=visible.null,
        dependent=visible.dependent,
        rank=visible.rank,
        condition_number=visible.condition_number,
    )


def _check_circles(machine: Machine, circles: Sequence[Circle]) -> None:
    """Raise an `InputError` if the machine cannot run one of the circles.

    The centre of a circle may be too far from the origin of the machine's coordinates, or the
    machine may not have the plane of the circle.
    """
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
    """Return a text with a joint's axis, branch (workpiece or tool) and frame position [mm]."""
    frame = ", ".join(f"{x:g}" for x in joint.frame_mm)
    return f"{joint.axis} in the {joint.branch} branch, frame at ({frame}) mm"


def _describe_compliances(
    machine: Machine, circles: Sequence[Circle], visible: Kept
) -> tuple[VisibleParameter, ...]:
    """Return a description of each of the compliances ``visible``.

    These are the compliances that circular tests can determine. If the readings determine only a
    weighted sum of several compliances, one of them represents the sum, and ``visible`` holds the
    names and weights of all compliances in the sum. Each description states how the compliance
    changes the readings of the first of ``circles`` in each plane.
    """
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
    """Return a description of each geometric error that circular tests can determine.

    The description has a formula for the effect of the error on the readings, as a function of the
    angle. The formula holds for the first of ``circles`` in each plane.
    """
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
    """Return copies of the first circle in each plane, one for each of the radii ``_RADII_MM``.

    The keys are names of planes; each value is the list of the copies. Planes without a circle are
    left out.
    """
    first_circles = {circle.plane: circle for circle in reversed(circles)}
    sampled = {}
    for plane in machine.planes:
        if plane in first_circles:
            circle = first_circles[plane]
            sampled[plane] = [replace(circle, radius_mm=float(radius)) for radius in _RADII_MM]
    return sampled


class _Monomial(NamedTuple):
    """One term of a formula: a factor, and a product of powers as text, such as ``R c²``.

    R is the radius in mm and c = cos θ for the angle θ of the circle.
    """

    factor: float
    product: str


def _formulas(jacobians: Mapping[str, Array], column: int, degree: int) -> dict[str, str]:
    """Return the formula for one parameter's effect on the readings in each plane.

    The keys of ``jacobians`` and of the result are names of planes. Planes in which the parameter
    changes no reading are left out. For each plane, ``jacobians`` holds the change of the reading
    per unit of each parameter, shape (radii, angles, parameters). ``column`` is the index of the
    parameter. ``degree`` is ``_COMPLIANCE_DEGREE`` for a compliance and ``_GEOMETRIC_DEGREE`` for a
    geometric error.
    """
    formulas = {}
    for plane, jacobian in jacobians.items():
        monomials = _monomials(jacobian[:, :, column], degree)
        if monomials:
            formulas[plane] = _write_sum(monomials)
    return formulas


def _monomials(values: Array, degree: int) -> list[_Monomial]:
    """Return the terms of a formula for the effect of one parameter on the readings.

    The formula contains the radius R, c = cos θ and s = sin θ, for the angle θ of the circle. The
    term with the factor R^k is a product of ``degree`` + k factors c or s. With ``degree`` 2, for
    example, the terms without R contain c², c s and s².

    ``values``, shape (radii, angles), holds the effect, computed at the radii ``_RADII_MM`` and the
    angles ``_ANGLES_RAD``. The formula reproduces these values.
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
    """Return a power as text, such as ``c²`` for the letter "c" and the power 2.

    The text is empty for the power 0.
    """
    if power == 0:
        return ""
    return letter + _EXPONENTS[power]


def _write_sum(monomials: Sequence[_Monomial]) -> str:
    """Return the sum of the terms ``monomials`` as text, such as ``2 R c² − s``.

    The text is the formula for a parameter's effect on the readings, with the radius R, c = cos θ
    and s = sin θ for the angle θ of the circle. A factor of one is not written.
    """
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
