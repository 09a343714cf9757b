"""Quantities that may have a tolerance, and tolerances read from strings with a unit."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.errors import check_known, placed, require
from ldbb_bayes.model.hybrid import BoundModel, HybridModel
from ldbb_bayes.model.parameter_kinds import hint_on_kind
from ldbb_bayes.results import Shown
from ldbb_bayes.units import inside_name, is_direct, to_inside

__all__ = [
    "PATH_QUANTITIES",
    "STIFFNESS_QUANTITIES",
    "Quantity",
    "Tolerance",
    "check_stated_tolerances",
    "name_in_plane",
    "quantities",
    "quantities_of",
    "tolerances_in",
]

_UPPER = ("upper",)
_LOWER = ("lower",)
_BOTH = ("lower", "upper")
# Quantities of the machine's circular path that may have a tolerance. The keys are the names of the
# quantities. Each value states how a tolerance that is a single number without a sign is
# understood: as an upper or as a lower limit of the quantity.
PATH_QUANTITIES = {"G": _UPPER, "F_max": _UPPER, "F_min": _LOWER}
# Stiffnesses in a plane for which the user may state a tolerance: the least and the greatest
# stiffness along the bar, and the ratio of the greatest to the least. The keys are the names of
# these quantities. Each value states how a tolerance that is a single number without a sign is
# understood: as an upper or as a lower limit of the quantity.
STIFFNESS_QUANTITIES = {"k_min": _LOWER, "k_max": _LOWER, "k_ratio": _UPPER}
# Internal units of the stiffnesses in ``STIFFNESS_QUANTITIES``; the ratio has no unit.
_STIFFNESS_UNITS = {"k_min": "N/mm", "k_max": "N/mm", "k_ratio": ""}
# Regular expressions for names of quantities that cannot be negative. ``_DIRECT_COMPLIANCE``
# matches direct compliances (deflection in the direction of the force, or tilt about the axis of
# the moment). ``_NEVER_NEGATIVE`` also matches stiffnesses, the ratio of stiffnesses and the
# circular deviation G.
_DIRECT_COMPLIANCE = re.compile(r"C_(.)\1.")
_NEVER_NEGATIVE = re.compile(
    _DIRECT_COMPLIANCE.pattern + r"|stiffness_.|(G|k_min|k_max|k_ratio)(_..)?"
)
# Meaning of a sign before the number of a tolerance: the number is the upper limit (≤), the lower
# limit (≥) or both limits (±).
_SIDES_BY_SIGN = {"±": _BOTH, "≤": _UPPER, "<=": _UPPER, "≥": _LOWER, ">=": _LOWER}
_SIGN = re.compile(r"\s*(±|≤|<=|≥|>=)?")
_NUMBER = re.compile(r"^\s*[+−-]?[\d.]+(e[+-]?\d+)?", re.IGNORECASE)
_EXPONENT = re.compile(r"\de[+-]?\d", re.IGNORECASE)
# Regular expression for the dots between the lower and the upper limit of a tolerance that is
# stated as a range, such as −20..40 µrad.
_RANGE_DOTS = re.compile(r"\s*(?:\.{2,}|…)\s*")
_UNIT_CHARACTER = re.compile(r"[^\W\d]|[%°]")


@dataclass(frozen=True)
class Tolerance(Shown):
    """Tolerance of a quantity: its lower limit, its upper limit or both.

    Limits are in internal units (mm, N, rad). A value equal to a limit conforms. At least one limit
    must be given. If both limits are given, the lower limit must be smaller than the upper limit.

    Examples
    --------
    >>> tolerance = lb.analysis.Tolerance(upper=60e-6)  # mm/N, that is 60 nm/N
    >>> tolerance.ends
    (-inf, 6e-05)
    >>> lb.assess_conformity(posterior, {"C_YYY": tolerance})["C_YYY"].decision.value
    'conforms'
    """

    lower: float | None = None  #: lower limit of the tolerance; None if it has no lower limit
    upper: float | None = None  #: upper limit of the tolerance; None if it has no upper limit

    def __post_init__(self) -> None:
        """Raise an `InputError` unless the tolerance has one limit, or two in the right order."""
        low, high = self.ends
        require(
            low < high,
            f"a tolerance must have a lower limit below its upper one, got {low:g} and {high:g}."
            " Correct it.",
        )
        require(
            np.isfinite([low, high]).any(),
            "a tolerance must have a limit, got none. Write for example 60 nm/N.",
        )

    @property
    def ends(self) -> tuple[float, float]:
        """Lower and upper limit of the tolerance of a quantity; a missing limit is infinite."""
        return (
            -np.inf if self.lower is None else self.lower,
            np.inf if self.upper is None else self.upper,
        )


@dataclass(frozen=True)
class Quantity:
    """A quantity that may have a tolerance.

    ``unit`` is the internal unit of the quantity (composed of mm, N and rad). If a tolerance is a
    single number without a sign, ``sides`` states whether this number is the upper limit, the lower
    limit or both.
    """

    unit: str
    sides: tuple[str, ...]


def quantities(units: Mapping[str, str], planes: Collection[str] = ()) -> dict[str, Quantity]:
    """Return the quantities that may have a tolerance; the keys are the names of the quantities.

    Parameters
    ----------
    units : mapping of str to str
        Internal units (mm, N, rad) of the parameters; the keys are names of parameters.
    planes : collection of str
        The planes in which the machine's circular path and the stiffness along the bar may have a
        tolerance.
    """
    by_name = {}
    for name, unit in units.items():
        sides: tuple[str, ...] = _BOTH
        if _DIRECT_COMPLIANCE.fullmatch(name):
            sides = _UPPER
        by_name[name] = Quantity(unit, sides)
    for name in units:
        if is_direct(name):
            by_name[f"stiffness_{name[2]}"] = Quantity("N/mm", _LOWER)
    for plane in planes:
        for name, limited_sides in PATH_QUANTITIES.items():
            by_name[name_in_plane(name, plane, planes)] = Quantity("mm", limited_sides)
        for name, limited_sides in STIFFNESS_QUANTITIES.items():
            quantity = Quantity(_STIFFNESS_UNITS[name], limited_sides)
            by_name[name_in_plane(name, plane, planes)] = quantity
    return by_name


def name_in_plane(name: str, plane: str, planes: Collection[str]) -> str:
    """Return the name of a quantity in a plane, such as ``G_YZ``, or ``G`` for a single plane.

    ``planes`` are all planes that were tested. If several planes were tested, the name of the plane
    is appended to ``name``.
    """
    return f"{name}_{plane}" if len(planes) > 1 else name


def quantities_of(bound: BoundModel) -> dict[str, Quantity]:
    """Return the quantities for which a tolerance may be stated; the keys are their names.

    The quantities are the parameters of the model ``bound``, the stiffnesses of single axes (such
    as ``stiffness_X``) and, for each plane, six more quantities: the least and the greatest
    stiffness along the bar, the ratio of the greatest to the least stiffness, and G, F_max and
    F_min of the machine's circular path.
    """
    units = {parameter.name: parameter.unit for parameter in bound.parameters}
    return quantities(units, bound.setting.tested_planes)


def tolerances_in(
    known: Mapping[str, Quantity], given: Mapping[str, str | Tolerance]
) -> dict[str, Tolerance]:
    """Read tolerances from strings with a unit, check their names and limits, and return them.

    ``given`` are the tolerances as the user stated them, and ``known`` are all quantities that may
    have a tolerance. The keys of ``given``, of ``known`` and of the result are names of quantities.

    For a direct compliance, G, F_max and a ratio, a single number such as ``60 nm/N`` is the upper
    limit. For a stiffness and F_min, a single number is the lower limit. For any other quantity,
    the limits are plus and minus this number. A sign before the number takes precedence over these
    rules: ``≤`` states an upper limit, ``≥`` a lower limit and ``±`` both. A range such as
    ``−20..40 µrad`` or ``−20…40 µrad`` also states both limits.
    """
    require(
        isinstance(given, Mapping),
        f"tolerances must be texts or Tolerances by name, got {given!r}. Give for example"
        " {'C_XXX': '60 nm/N'}.",
    )
    tolerances = {}
    for stated_name, stated in given.items():
        name = inside_name(stated_name)
        check_known("tolerance", [name], known, instead=hint_on_kind(name, known))
        if isinstance(stated, Tolerance):
            tolerance = stated
        else:
            require(
                isinstance(stated, str),
                f"tolerance of {name} must be a text with a unit or a Tolerance, got {stated!r}."
                " Write for example '60 nm/N'.",
            )
            tolerance = _read_tolerance(name, stated, known[name])
        if _NEVER_NEGATIVE.fullmatch(name):
            limit = tolerance.upper
            if limit is None:
                limit = tolerance.lower
            require(
                limit is None or limit > 0.0,
                f"tolerance of {name} must have a limit above 0, for {name} cannot be negative, got"
                f" {stated}. Leave the sign out.",
            )
        tolerances[name] = tolerance
    return tolerances


def check_stated_tolerances(campaign: Campaign, model: HybridModel) -> None:
    """Raise an `InputError` if a tolerance that a campaign states cannot be used.

    Parameters
    ----------
    campaign : the campaign as its campaign.toml states it.
    model : model with which the campaign will be fitted.

    Raises
    ------
    InputError
        If a limit cannot be read, or the model has no such quantity.
    """
    if not campaign.tolerances:
        return
    with placed("campaign.toml, [tolerance]"):
        tolerances_in(quantities_of(model.bind(campaign)), campaign.tolerances)


def _read_tolerance(name: str, text: str, quantity: Quantity) -> Tolerance:
    """Return the tolerance of a quantity from a string with a unit, such as ``≥ 18 N/µm``.

    The string is a range, such as ``−20..40 µrad``, or a number. A number with the sign ≤ is the
    upper limit, a number with the sign ≥ the lower limit, and a number with the sign ± states both
    limits. A number without a sign states the limits that are usual for the quantity (``sides``).
    The limits are in the internal unit of the quantity. An `InputError` is raised if the string
    cannot be read; its message contains ``name``, the name of the quantity.
    """
    subject = f"tolerance of {name}"
    lower, *uppers = _RANGE_DOTS.split(text, maxsplit=1)
    if uppers:
        return _read_range(subject, text, lower, uppers[0], quantity.unit)
    sides = quantity.sides
    number = text
    sign = _SIGN.match(text)
    if sign is not None:
        sides = _SIDES_BY_SIGN.get(sign[1], quantity.sides)
        number = text[sign.end() :]
    value = to_inside(number, quantity.unit, subject)
    if sides == _BOTH:
        require(
            value != 0.0,
            f"{subject} must leave room about 0, got {text!r}. Write for example ± 20 µrad.",
        )
        return Tolerance(-abs(value), abs(value))
    if sides == _LOWER:
        return Tolerance(lower=value)
    return Tolerance(upper=value)


def _read_range(subject: str, text: str, lower: str, upper: str, inside_unit: str) -> Tolerance:
    """Return the tolerance whose limits are the strings ``lower`` and ``upper``.

    A lower limit without a unit has the unit of the upper limit. ``inside_unit`` is the internal
    unit of the result (composed of mm, N and rad). ``subject``, such as "tolerance of C_XXX", and
    ``text``, the whole tolerance as the user wrote it, appear in error messages.
    """
    if not _UNIT_CHARACTER.search(_EXPONENT.sub("", lower)):
        lower += _NUMBER.sub("", upper)
    low = to_inside(lower, inside_unit, subject)
    high = to_inside(upper, inside_unit, subject)
    require(
        low < high,
        f"{subject} must have its lower limit first, got {text!r}. Write for example −20..40 µrad.",
    )
    return Tolerance(low, high)
