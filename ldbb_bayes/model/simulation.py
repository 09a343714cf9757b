"""Simulated campaigns, and the true values from which their readings are drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.campaign.circular_test import LARGEST_READING_MM
from ldbb_bayes.errors import check_known, require
from ldbb_bayes.machine.parameters import ComplianceName
from ldbb_bayes.model.hyper_prior import HyperPrior
from ldbb_bayes.model.parameter_kinds import compliance_unit, parameter_to_inside
from ldbb_bayes.model.setting import Setting
from ldbb_bayes.model.terms.base import Term
from ldbb_bayes.model.terms.columns import Columns, Hyper, Law
from ldbb_bayes.model.terms.joints import joint_load_names, secants_along_axis
from ldbb_bayes.results import Array, Result
from ldbb_bayes.units import inside_name, to_inside

__all__ = [
    "Simulation",
    "TrueChange",
    "draw_nuisances",
    "true_changes",
    "true_hyper_parameters",
    "true_parameters",
]


@dataclass(frozen=True)
class TrueChange:
    """True compliance C(F) of a simulated machine at the tested forces F, and its change.

    C(F) is the same quantity that a fit states: the compliance at the reference force, its slopes
    (changes with force) and, for a direct compliance, the contribution of the term `JointLoad`
    (nonlinear deflection of joints under load). The fields have the names that
    `change_with_force` uses.

    Examples
    --------
    >>> simulation = lb.HybridModel.default().simulate(campaign.plan(), seed=1)
    >>> true = simulation.change_with_force["C_YYY"]
    >>> true.change == true.at_largest - true.at_smallest
    True
    """

    #: unit of the compliance and of its change, made of mm, N and rad, such as mm/N
    unit: str
    smallest_force_N: float  #: smallest force tested, F_min [N]
    reference_force_N: float  #: reference force of the model, F0 [N]
    largest_force_N: float  #: largest force tested, F_max [N]
    at_smallest: float  #: compliance C(F_min) at the smallest force tested
    at_reference: float  #: compliance C(F0) at the reference force
    at_largest: float  #: compliance C(F_max) at the largest force tested
    change: float  #: change of the compliance, C(F_max) − C(F_min)
    #: n different forces of the tests in ascending order, shape (n,) [N]
    forces_N: tuple[float, ...]
    #: compliance at each of the n forces, shape (n,)
    at_forces: tuple[float, ...]


@dataclass(frozen=True)
class Simulation(Result):
    """Simulated campaign, and the true values from which it was simulated.

    The values of coefficients that each test has separately (set-up shifts, discrepancies, random
    force errors) and the noise are not kept.
    """

    campaign: Campaign
    #: true compliances, their changes with force, and geometric errors of the simulated machine by
    #: name, in internal units (mm, N, rad)
    parameters: dict[str, float]
    #: true hyper-parameters (such as the standard deviation of the noise) of the simulation by
    #: name; lengths in µm
    hyper_um: dict[str, float]
    #: units, made of mm, N and rad, of all compliances, slopes, geometric errors and ``effects``;
    #: the keys are the names of these quantities
    units: dict[str, str]
    #: true coefficients of the nuisance terms that tests have in common, by name, in internal units
    #: (mm, N, rad). ``joint_load_X_seat`` is an example.
    effects: dict[str, float]
    #: true compliances C(F) at the tested forces F; the keys are the names of the compliances at
    #: the reference force, such as C_XXX
    change_with_force: dict[str, TrueChange]


class DrawnNuisances(NamedTuple):
    """Nuisances that were drawn at random."""

    #: readings of all tests with the nuisances added, as Fourier coefficients, shape (tests, 25)
    #: [mm]
    readings_mm: Array
    #: coefficients of nuisances that tests have in common, by name, in internal units (mm, N, rad)
    effects: dict[str, float]
    #: units of these coefficients by name, made of mm, N and rad
    units: dict[str, str]


def draw_nuisances(
    nuisances: Sequence[Term],
    truth: Setting,
    phi: Mapping[Hyper, float],
    rng: np.random.Generator,
    readings_mm: Array,
    known: Mapping[str, float] = MappingProxyType({}),
) -> DrawnNuisances:
    """Draw nuisances at random from their priors, and add their effects to readings.

    Parameters
    ----------
    nuisances
        Nuisance terms of the model.
    truth
        Test conditions, linearised at the true parameters.
    phi
        True hyper-parameters by name, with lengths in mm.
    rng
        Generator of random numbers.
    readings_mm
        Readings without nuisances, as Fourier coefficients, shape (tests, 25) [mm].
    known
        Coefficients that tests have in common and that are not drawn, by name, in internal units
        (mm, N, rad).

    Raises
    ------
    InputError
        If ``known`` has a name that no coefficient has, or a value that is no finite number.
    """
    _check_known_effects(known)
    effects: dict[str, float] = {}
    units: dict[str, str] = {}
    for term in nuisances:
        for columns in term.columns(truth):
            if not isinstance(columns, Columns):
                readings_mm = readings_mm + columns.draw(phi, truth.tests, rng)
                continue
            coefficients = columns.draw_coefficients(phi, truth.tests, rng)
            if not columns.private:
                coefficients = _with_known(coefficients, columns.names, known)
                effects |= dict(zip(columns.names, coefficients[0].tolist(), strict=True))
                units |= {name: term.unit_of(name).inside for name in columns.names}
            readings_mm = readings_mm + columns.effect_of(coefficients)
    check_known("effect", known, list(effects))
    return DrawnNuisances(readings_mm, effects, units)


def _check_known_effects(known: Mapping[str, float]) -> None:
    """Raise an `InputError` unless ``known`` holds finite numbers by name."""
    require(
        isinstance(known, Mapping),
        f"effects must be numbers by name, got {known!r}. Give for example {{'bar_length': 1e-3}}.",
    )
    for name, value in known.items():
        require(
            isinstance(value, int | float | np.number) and bool(np.isfinite(value)),
            f"effect {name} must be a finite number in mm, N and rad, got {value!r}. Correct it.",
        )


def _with_known(coefficients: Array, names: Sequence[str], known: Mapping[str, float]) -> Array:
    """Return drawn coefficients, shape (tests, v), with those in ``known`` replaced.

    ``names`` are the names of the v coefficients, which all tests have in common.
    """
    values = coefficients.copy()
    for column, name in enumerate(names):
        if name in known:
            values[:, column] = known[name]
    return values


def true_changes(
    compliances: Sequence[ComplianceName],
    forces_N: Array,
    at_forces: Array,
    effects: Mapping[str, float],
    truth: Setting,
) -> dict[str, TrueChange]:
    """Return the true compliances C(F) of a simulated machine at the tested forces, by name.

    Parameters
    ----------
    compliances
        The c compliances of the model.
    forces_N
        The n forces of the tests in ascending order and, last, the reference force F0, shape
        (n + 1,) [N].
    at_forces
        Compliances at these forces that follow from the parameters alone, shape (n + 1, c), in mm,
        N and rad.
    effects
        Coefficients of the nuisance terms that tests have in common, by name. Those of `JointLoad`
        are added to the direct compliances.
    truth
        Test conditions, with the reference force and the largest force.
    """
    changes: dict[str, TrueChange] = {}
    for index, compliance in enumerate(compliances):
        curve = at_forces[:, index] + _joint_load(compliance, forces_N, effects, truth)
        *tested, at_reference = curve.tolist()
        *tested_N, reference_N = forces_N.tolist()
        changes[compliance.label] = TrueChange(
            unit=compliance_unit(compliance),
            smallest_force_N=tested_N[0],
            reference_force_N=reference_N,
            largest_force_N=tested_N[-1],
            at_smallest=tested[0],
            at_reference=at_reference,
            at_largest=tested[-1],
            change=tested[-1] - tested[0],
            forces_N=tuple(tested_N),
            at_forces=tuple(tested),
        )
    return changes


def _joint_load(
    compliance: ComplianceName, forces_N: Array, effects: Mapping[str, float], truth: Setting
) -> Array:
    """Return what the term `JointLoad` adds to a compliance at n forces, shape (n,) [mm/N].

    The result is zero for a compliance that is not direct, or if ``effects`` has no coefficients of
    the term for the axis. The arguments are those of `true_changes`.
    """
    names = joint_load_names(compliance.twist)
    if compliance.kind != "direct" or names[0] not in effects:
        return np.zeros(len(forces_N))
    coefficients = np.array([effects[name] for name in names])
    secants = secants_along_axis(forces_N, truth.reference_force_N, truth.largest_force_N)
    return np.asarray(secants @ coefficients)


def true_parameters(
    parameters: Mapping[str, float | str], names: Sequence[str], interest: Array
) -> Array:
    """Return the true values of p parameters of interest for a simulation, shape (p,).

    Parameters
    ----------
    parameters
        Values that the user gives by name: numbers in mm, N and rad, or texts with a unit, such as
        "60 nm/N". Parameters that are not named are zero.
    names
        Names of the p parameters.
    interest
        Reading per unit of each parameter, as 25 Fourier coefficients, shape (tests, 25, p).

    Raises
    ------
    InputError
        If a name is unknown, a value is not finite, a text has no unit of the parameter, or a
        reading would exceed 100 mm.
    """
    require(
        isinstance(parameters, Mapping),
        f"true parameters must be numbers or texts by name, got {parameters!r}. Give for example"
        " {'C_XXX': '60 nm/N'}.",
    )
    stated = {inside_name(name): value for name, value in parameters.items()}
    check_known("parameter", stated, names)
    values = {name: parameter_to_inside(name, value, "true") for name, value in stated.items()}
    beta = np.array([values.get(name, 0.0) for name in names], dtype=float)
    for name, value in zip(names, beta.tolist(), strict=True):
        require(
            np.isfinite(value),
            f"true {name} must be a number, got {value}. Correct it.",
        )
    largest_mm = float(np.abs(interest @ beta).max())
    require(
        largest_mm < LARGEST_READING_MM,
        f"true parameters must be in mm, N and rad, got ones that change readings by"
        f" {largest_mm:.3g} mm. For 60 nm/N write 60e-6.",
    )
    return beta


def true_hyper_parameters(
    hyper_um: Mapping[str, float | str], prior: HyperPrior, rng: np.random.Generator
) -> dict[str, float]:
    """Return the true values of all hyper-parameters for a simulation, with lengths in mm.

    Parameters
    ----------
    hyper_um
        Values that the user gives by name. Lengths are numbers in µm, or texts with a unit, such as
        "0.3 µm". All other hyper-parameters are drawn at random from their priors.
    prior
        Prior of the hyper-parameters.
    rng
        Generator of random numbers.

    Raises
    ------
    InputError
        If a name is unknown or a value is out of range.
    """
    require(
        isinstance(hyper_um, Mapping),
        f"hyper_um must be numbers in µm or texts by name, got {hyper_um!r}. Give for example"
        " {'sigma': '0.3 µm'}.",
    )
    check_known("hyper-parameter", hyper_um, prior.names)
    stated = {}
    for name, law, bounds in zip(prior.names, prior.laws, prior.bounds.tolist(), strict=True):
        if name in hyper_um:
            stated[name] = _stated_hyper_parameter(name, hyper_um[name], law)
            _check_hyper_parameter(name, stated[name], law, bounds)
    draw = prior.draw(1, rng)[0]
    units = (1.0 / prior.display_factors).tolist()
    phi = {}
    for name, value, unit in zip(prior.names, draw, units, strict=True):
        phi[name] = stated.get(name, float(value / unit)) * unit
    return phi


def _stated_hyper_parameter(name: str, value: float | str, law: Law) -> float:
    """Return a true hyper-parameter as a number; lengths are in µm.

    A length may be a text with a unit. Raise an `InputError` for anything else that is no number.
    The arguments are those of `_check_hyper_parameter`.
    """
    subject = f"hyper-parameter {name}"
    if isinstance(value, str) and law not in ("decay", "circle"):
        return to_inside(value, "um", subject)
    require(
        isinstance(value, int | float | np.number),
        f"{subject} must be a number, got {value!r}. Correct it.",
    )
    return float(value)


def _check_hyper_parameter(name: str, value: float, law: Law, bounds: Sequence[float]) -> None:
    """Raise an `InputError` if a true hyper-parameter is out of range.

    ``name`` is the name of the hyper-parameter, and ``value`` the true value that a user gives for
    a simulation. Lengths are in µm; the decay and noise factors have no unit. ``law`` is the kind
    of the hyper-parameter's prior. ``bounds`` are the smallest and the largest permitted value;
    they are used only for the decay.
    """
    if law == "decay":
        low, high = bounds
        require(
            low <= value <= high,
            f"hyper-parameter {name} must be a number from {low:g} to {high:g}, got {value}."
            " Correct it.",
        )
    elif law == "circle":
        require(
            0.0 < value < np.inf,
            f"hyper-parameter {name} must be a number > 0, got {value}. Correct it.",
        )
    else:
        require(
            0.0 <= value < np.inf,
            f"hyper-parameter {name} must be a number ≥ 0 in µm, got {value}. Correct it.",
        )
