"""Kinds of parameters of interest: names, units, and the setting that sizes the prior of each kind.

Parameters of interest are the compliances, their slopes (changes with force) and the geometric
errors. A kind is, for example, the direct compliances, such as C_XXX and C_YYY.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from ldbb_bayes.errors import InputError, require, suggestion
from ldbb_bayes.machine.parameters import ComplianceKind, ComplianceName, GeometricKind
from ldbb_bayes.units import is_compliance_or_slope, to_inside

__all__ = [
    "COMPLIANCE_KINDS",
    "DEGREE_NAMES",
    "EXAMPLES",
    "GEOMETRIC_KINDS",
    "ParameterKind",
    "check_possible",
    "compliance_unit",
    "degree_of",
    "geometric_unit",
    "hint_on_kind",
    "is_possible",
    "kind_of",
    "parameter_to_inside",
    "settings_of_sd",
]


# Names of the models in which compliance is a polynomial in force of degree 0, 1 and 2.
DEGREE_NAMES = ("constant", "linear", "quadratic")


class ParameterKind(NamedTuple):
    """Internal unit and default prior of all parameters of one kind, such as direct compliances."""

    unit: str
    #: name of the field of `Prior` that holds the prior sd of all parameters of one kind; for
    #: direct compliances, for example, it is direct_mm_per_N
    sd_field: str


# Internal unit and default prior of every kind of compliance.
COMPLIANCE_KINDS: dict[ComplianceKind, ParameterKind] = {
    "direct": ParameterKind("mm/N", "direct_mm_per_N"),
    "cross": ParameterKind("mm/N", "cross_mm_per_N"),
    "rotation_for_force": ParameterKind("rad/N", "rotation_for_force_rad_per_N"),
    "rotation_for_moment": ParameterKind("rad/(N mm)", "rotation_for_moment_rad_per_N_mm"),
    "rotation_for_other_moment": ParameterKind("rad/(N mm)", "rotation_for_moment_rad_per_N_mm"),
}
# Internal unit and default prior of every kind of geometric error.
GEOMETRIC_KINDS: dict[GeometricKind, ParameterKind] = {
    "gain": ParameterKind("1", "gain"),
    "straightness": ParameterKind("1/mm", "straightness_per_mm"),
    "squareness": ParameterKind("rad", "squareness_rad"),
    "offset": ParameterKind("mm", "offset_mm"),
}
# Examples of names of compliances and geometric errors. An error message about an unknown name
# suggests the most similar of these names.
EXAMPLES = [
    "C_XXX",
    "C_XYX",
    "C_YYY",
    "C_CXY",
    "C_CYY",
    "C_CCY",
    "E_XX1",
    "E_YX2",
    "E_XY2",
    "E_YY1",
    "E_C0YX",
    "E_Xt0",
    "E_Yt0",
]
# Regular expression for the names of compliances, such as C_XXX, and of their slopes, such as
# C_XXX_1.
_COMPLIANCE_NAME = re.compile(r"C_([XYZABC])([XYZABC])([XYZ])(?:_[12])?")
# For each kind of geometric error, a regular expression for the names of such errors. Examples of
# names are E_XX1 (gain), E_YX2 (straightness), E_C0YX (squareness), E_Xt0 (offset of the tool ball
# in set-up 1) and E_Xt0_2 (the same offset in set-up 2).
_GEOMETRIC_NAMES: dict[GeometricKind, re.Pattern[str]] = {
    "gain": re.compile(r"E_(?:XX|YY|ZZ)1"),
    "straightness": re.compile(r"E_([XYZ])(?!\1)[XYZ]2"),
    "squareness": re.compile(r"E_[ABC]0([XYZ])(?!\1)[XYZ]"),
    "offset": re.compile(r"E_[XYZ]t0(?:_\d+)?"),
}


def compliance_unit(name: ComplianceName, degree: int = 0) -> str:
    """Return the internal unit of a compliance, or of its slope, such as mm/N or mm/N/N.

    ``name`` is the name of the compliance. ``degree`` is 0 for the compliance itself, and 1 or 2
    for its slope, that is, its linear or quadratic change with force. Units are made of mm, N and
    rad.
    """
    return COMPLIANCE_KINDS[name.kind].unit + ("", "/N", "/N^2")[degree]


def geometric_unit(kind: GeometricKind) -> str:
    """Return the internal unit of a kind of geometric error, such as rad for squareness.

    Units are made of mm, N and rad.
    """
    return GEOMETRIC_KINDS[kind].unit


def hint_on_kind(kind: str, names: Iterable[str]) -> str:
    """Return a sentence with the names of the geometric errors of a kind, or an empty string.

    It is appended to the error message for a user who stated the kind in place of a name.

    Parameters
    ----------
    kind
        What the user stated; ``squareness``, for example, is a kind of geometric errors.
    names
        Names that the user may state.
    """
    for known_kind, pattern in _GEOMETRIC_NAMES.items():
        if kind.lower() == known_kind:
            of_kind = [name for name in names if pattern.fullmatch(name)]
            if of_kind:
                return f" Errors of {known_kind} are {', '.join(of_kind)}."
    return ""


def check_possible(words: str, parameters: Iterable[str]) -> None:
    """Raise an `InputError` for a name that no parameter of any machine and campaign has.

    A name that passes the check may still belong to no parameter of a certain campaign.

    Parameters
    ----------
    words
        Words for what the parameters are, such as "fixed parameter"; they are used in the message.
    parameters
        Names of parameters, such as C_XXX_1.
    """
    examples = list(EXAMPLES)
    for example in EXAMPLES:
        if is_compliance_or_slope(example):
            examples += [f"{example}_1", f"{example}_2"]
    for parameter in parameters:
        if not is_possible(parameter):
            raise InputError(
                f"{words} must be a compliance, its change with force or a geometric error, such as"
                f" C_XXX, C_XXX_1 and E_XX1, got {parameter!r}.{suggestion(parameter, examples)}"
            )


def is_possible(parameter: str) -> bool:
    """Return whether a machine can have a parameter of the given name.

    A displacement caused by a force has the same effect at every joint. It is always attributed to
    the joint that moves in its direction: there is C_XXX, but never C_XXZ.
    """
    match = _COMPLIANCE_NAME.fullmatch(parameter)
    if match is None:
        return any(pattern.fullmatch(parameter) for pattern in _GEOMETRIC_NAMES.values())
    name = ComplianceName(*match.groups())
    return name.rotations > 0 or name.joint == name.twist


def parameter_to_inside(parameter: str, value: float | str, words: str) -> float:
    """Return a value of a parameter in internal units (mm, N, rad).

    Raise an `InputError` if ``value`` is neither a number nor a string. If ``value`` is a string,
    also raise the error if the unit in the string does not fit the parameter, or if there is no
    parameter of this name.

    Parameters
    ----------
    parameter
        Name of the parameter, such as C_XXX.
    value
        Number in internal units, or string with a unit, such as "5 nm/N".
    words
        Description of the value for error messages, such as "prior sd of".
    """
    if not isinstance(value, str):
        require(
            isinstance(value, int | float | np.number),
            f"{words} {parameter} must be a number or text with its unit, got {value!r}."
            " Correct it.",
        )
        return float(value)
    kind = kind_of(parameter)
    if kind is None:
        raise InputError(
            f"{words} {parameter} must be of a parameter to have a unit, got {value!r}."
            f"{suggestion(parameter, EXAMPLES)} Correct the name."
        )
    return to_inside(value, kind.unit, f"{words} {parameter}")


def settings_of_sd(parameter: str) -> tuple[str, ...]:
    """Return the names of the fields of `Prior` that determine a parameter's prior sd.

    For C_XXX the only field is ``direct_mm_per_N``. For the slope C_XXX_1 (change of C_XXX with
    force), the result also contains ``slope_scale`` and ``slopes_of_estimate``. It never contains
    the fields for single parameters (``overrides``, ``means``). It is an empty tuple if
    ``parameter`` is not the name of a parameter.
    """
    kind = kind_of(parameter)
    if kind is None:
        return ()
    if degree_of(parameter):
        return (kind.sd_field, "slope_scale", "slopes_of_estimate")
    return (kind.sd_field,)


def kind_of(parameter: str) -> ParameterKind | None:
    """Return the unit of a parameter, and the field of `Prior` that holds its default prior sd.

    The unit is internal: it is made of mm, N and rad. For C_XXX, the unit is mm/N and the field is
    direct_mm_per_N. Return None if ``parameter`` is not the name of a parameter.
    """
    match = _COMPLIANCE_NAME.fullmatch(parameter)
    if match is not None:
        name = ComplianceName(*match.groups())
        unit = compliance_unit(name, degree_of(parameter))
        return ParameterKind(unit, COMPLIANCE_KINDS[name.kind].sd_field)
    for kind, pattern in _GEOMETRIC_NAMES.items():
        if pattern.fullmatch(parameter):
            return GEOMETRIC_KINDS[kind]
    return None


def degree_of(parameter: str) -> int:
    """Return the degree of a slope, 1 or 2, from its name; return 0 for all other parameters.

    ``parameter`` is the name of the parameter. The slope C_XXX_1 is linear (degree 1), and C_XXX_2
    is quadratic (degree 2).
    """
    stem, _, suffix = parameter.rpartition("_")
    return int(suffix) if stem.startswith("C_") and suffix.isdigit() else 0
