"""Goals of a campaign: the largest expanded uncertainty U (k = 2) that a parameter may have.

A goal is absolute, as in E_C0YX = 10 µrad, or relative to the value of the parameter, as in C_XXX =
5 %. A relative goal permits less uncertainty, in absolute terms, on a stiffer machine. The limit of
a relative goal is known only after the parameter has been estimated.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ldbb_bayes.errors import InputError, check_known, require
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.interest import Parameter
from ldbb_bayes.model.parameter_kinds import hint_on_kind
from ldbb_bayes.results import Array, Result
from ldbb_bayes.units import inside_name, to_inside

__all__ = ["COVERAGE_FACTOR", "USUAL_PROBABILITY", "Goal", "goals_in"]

# Coverage factor k of the expanded uncertainty U = k u that a goal limits (GUM, 6.3.3).
COVERAGE_FACTOR = 2.0
# Share of the possible machines on which all goals for uncertainties are to be met, if the user
# states no other share.
USUAL_PROBABILITY = 0.9
# A goal for U that exceeds U without any reading by more than this factor is refused as an error. A
# larger goal would be met by every campaign.
_MOST_TIMES_U_WITHOUT_READINGS = 1000.0
# Regular expression for a goal (limit of an uncertainty) in percent of the parameter's value, such
# as "5 %".
_PERCENTAGE = re.compile(r"\s*([+−-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?)\s*%\s*", re.IGNORECASE)
# Regular expression for the signs ±, ≤ and <= that may stand before a goal. These signs are
# ignored: every goal is an upper limit of U, and U extends equally to both sides of the estimate.
_SIGN = re.compile(r"^\s*(±|≤|<=)\s*")


@dataclass(frozen=True)
class Goal(Result):
    """Largest expanded uncertainty U (k = 2) that a parameter may have: U ≤ limit.

    Either ``absolute`` states the limit in the parameter's unit, or ``share`` states it as a
    fraction of the parameter's value; the other one is None.

    Examples
    --------
    >>> from ldbb_bayes.analysis.design import Goal
    >>> float(Goal("C_XXX", "mm/N", share=0.05).limit_U(6e-5))
    3e-06
    """

    name: str  #: name of the parameter whose uncertainty the goal limits, such as C_XXX
    unit: str  #: unit of the goal's parameter, composed of mm, N and rad, such as mm/N
    #: largest expanded uncertainty U that the goal permits, in ``unit``; None for a goal in percent
    absolute: float | None = None
    #: largest expanded uncertainty U that the goal permits, as a fraction of the parameter's
    #: absolute value (0.05 for 5 %); None for a goal in the parameter's unit
    share: float | None = None

    @property
    def is_relative(self) -> bool:
        """Whether the goal limits the uncertainty U to a fraction of the parameter's value."""
        return self.share is not None

    def limit_U(self, value: ArrayLike) -> Array:
        """Return the largest expanded uncertainty U (k = 2) that the goal permits.

        Parameters
        ----------
        value
            Values of the parameter in the unit ``unit`` (composed of mm, N and rad), of any shape.

        Returns
        -------
        Array
            Limits of U in the same unit and of the same shape.
        """
        size = np.abs(np.asarray(value, dtype=float))
        if self.share is not None:
            return np.asarray(self.share * size)
        return np.full(size.shape, self.absolute)

    def times(self, factor: float) -> Goal:
        """Return the goal that permits an uncertainty larger by ``factor``."""
        if self.share is not None:
            return replace(self, share=factor * self.share)
        return replace(self, absolute=factor * float(self.limit_U(0.0)))

    def limit_u(self, value: ArrayLike) -> Array:
        """Return the largest standard uncertainty u = U/2 that the goal permits.

        ``value`` holds values of the goal's parameter in the unit ``unit``. The result has the same
        unit and shape.
        """
        return np.asarray(self.limit_U(value) / COVERAGE_FACTOR)

    def is_met(self, value: ArrayLike, u: ArrayLike) -> Array:
        """Return whether standard uncertainties u meet the goal, for given parameter values.

        Parameters
        ----------
        value
            Values of the parameter in the unit ``unit``.
        u
            Standard uncertainties in the same unit, of the same shape.

        Returns
        -------
        Array
            Boolean values of the same shape.
        """
        return np.asarray(np.asarray(u) <= self.limit_u(value))

    def probability_met(self, draws: Array, u: float) -> float:
        """Return the probability that a standard uncertainty u meets the goal.

        A goal in percent is of the parameter's true value, which is not known exactly. A goal with
        a fixed limit is met with the probability 0 or 1.

        Parameters
        ----------
        draws
            Equally likely values of the parameter in the unit ``unit``, shape (n,).
        u
            Standard uncertainty in the same unit.

        Returns
        -------
        float
            Share of the values with which the goal is met.
        """
        return float(self.is_met(draws, u).mean())


def goals_in(bound: BoundModel, stated: Mapping[str, str | float | Goal]) -> dict[str, Goal]:
    """Read and check goals, and return them with the names of the parameters as keys.

    Parameters
    ----------
    bound
        Model applied to a campaign or a plan. Goals may be stated for the parameters of this model,
        in units that suit these parameters.
    stated
        Goals; the keys are the names of the parameters. A goal has one of three forms: a text with
        a unit, such as "10 µrad" or "5 %"; a number in the parameter's internal unit, which is
        composed of mm, N and rad; or a `Goal`.

    Returns
    -------
    dict
        Goals in the order in which they were stated; the keys are the names of the parameters.

    Raises
    ------
    InputError
        For an unknown parameter, a unit that does not suit the parameter, an uncertainty that is
        not above zero, or a percentage of a parameter that may be zero.
    """
    require(
        isinstance(stated, Mapping) and len(stated) > 0,
        f"goals must be uncertainties U by name, got {stated!r}. Give for example"
        " {'C_XXX': '5 %', 'E_C0YX': '10 µrad'}.",
    )
    parameters = {parameter.name: parameter for parameter in bound.parameters}
    goals: dict[str, Goal] = {}
    for stated_name, entry in stated.items():
        name = inside_name(str(stated_name))
        require(
            not name.startswith("Δ"),
            f"a goal must be of a parameter, got the change {name}. State it of the slope"
            f" {name[1:]}_1, which is the change by newton.",
        )
        check_known("goal", [name], parameters, instead=hint_on_kind(name, parameters))
        require(
            name not in goals,
            f"a goal must be stated once, got two of {name}. Leave out one of them.",
        )
        parameter = parameters[name]
        goals[name] = _read_goal(parameter, entry)
    return goals


def _read_goal(parameter: Parameter, entry: object) -> Goal:
    """Return the goal that the user stated as ``entry`` for the uncertainty of a parameter.

    ``entry`` is a string such as "5 %" or "2 nm/N", a number in the parameter's unit (composed of
    mm, N and rad), or a `Goal`.
    """
    name = parameter.name
    unit = parameter.unit
    group = parameter.group
    subject = f"goal of {name}"
    goal: Goal
    if isinstance(entry, Goal):
        goal = entry
        require(
            goal.name == name and goal.unit == unit,
            f"{subject} must be of {name} in {unit}, got one of {goal.name} in {goal.unit}."
            " Correct the name.",
        )
    elif isinstance(entry, str):
        goal = _goal_from_text(subject, name, unit, group, entry)
        _require_size_of_uncertainty(subject, goal, parameter, entry)
    elif isinstance(entry, int | float) and not isinstance(entry, bool):
        goal = Goal(name, unit, absolute=float(entry))
        require(
            not COVERAGE_FACTOR * parameter.prior_sd < entry < np.inf,
            f"{subject} must be smaller than U without any reading, got {entry!r} {unit}. A number"
            " is in this unit; for another write a text, for example '5 %' or '2 nm/N'.",
        )
    else:
        raise InputError(
            f"{subject} must be a text with a unit, or a number in {unit}, got {entry!r}. Write for"
            " example '5 %' or '2 nm/N'."
        )
    _check_size(subject, group, goal, entry)
    return goal


def _require_size_of_uncertainty(subject: str, goal: Goal, parameter: Parameter, text: str) -> None:
    """Raise an `InputError` if a goal is so large that its number or its unit must be wrong.

    ``subject`` names the goal of the parameter, and ``text`` is the goal as the user stated it.
    """
    if goal.absolute is None:
        return
    largest = _MOST_TIMES_U_WITHOUT_READINGS * COVERAGE_FACTOR * parameter.prior_sd
    require(
        not goal.absolute > largest,
        f"{subject} must be at most {_MOST_TIMES_U_WITHOUT_READINGS:g} times U without any reading,"
        f" got {text}. Correct the number or its unit.",
    )


def _goal_from_text(subject: str, name: str, unit: str, group: str, text: str) -> Goal:
    """Return the goal that a string such as "5 %" or "2 nm/N" states.

    A goal is the largest expanded uncertainty that a parameter may have. ``name``, ``unit`` and
    ``group`` are the name, the unit and the group of the parameter. ``subject`` names the goal in
    error messages.
    """
    number = _SIGN.sub("", text)
    percentage = _PERCENTAGE.fullmatch(number)
    if percentage is None:
        more = " Or write a percentage of the value, like 5 %." if group == "compliance" else ""
        return Goal(name, unit, absolute=to_inside(number, unit, subject, more))
    percent = float(percentage[1].replace("−", "-"))
    return Goal(name, unit, share=float(f"{percent / 100.0:.15g}"))


def _check_size(subject: str, group: str, goal: Goal, entry: object) -> None:
    """Raise an `InputError` if a goal is not above zero, or is a percentage that is not allowed.

    A percentage must be below 100 %. A percentage is refused for a parameter whose ``group`` is not
    "compliance", because such a parameter may be zero. ``entry`` is the goal as the user stated it,
    and ``subject`` is the name of the goal; both are for the error message.
    """
    size = goal.share if goal.absolute is None else goal.absolute
    require(
        size is not None and np.isfinite(size) and size > 0.0,
        f"{subject} must be an uncertainty above 0, got {entry}. Uncertainties have no sign, and"
        " none is zero: state the largest U (k = 2) that will do.",
    )
    if goal.share is None:
        return
    require(
        group == "compliance",
        f"{subject} must be an uncertainty with its unit, got {entry}. A percentage is of a"
        f" compliance; {goal.name} may well be zero.",
    )
    require(
        goal.share < 1.0,
        f"{subject} must be below 100 %, got {entry}. At 100 % the value is not known at all.",
    )
