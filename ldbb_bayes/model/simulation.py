"""Simulated campaigns, and the true values from which their readings are drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.errors import check_known, require
from ldbb_bayes.model.hyper_prior import HyperPrior
from ldbb_bayes.model.terms.columns import Law
from ldbb_bayes.results import Array, Result
from ldbb_bayes.units import inside_name

__all__ = ["Simulation", "true_hyper_parameters", "true_parameters"]

# Readings that are simulated from true parameters must stay below this size [mm]; larger ones come
# from parameters in another unit.
_LARGEST_READING_MM = 100.0


@dataclass(frozen=True)
class Simulation(Result):
    """Simulated campaign, and the true values of all parameters from which it was simulated."""

    campaign: Campaign
    #: true compliances, their changes with force, and geometric errors of the simulated machine by
    #: name, in internal units (mm, N, rad)
    parameters: dict[str, float]
    #: true hyper-parameters (such as the standard deviation of the noise) of the simulation by
    #: name; lengths in µm
    hyper_um: dict[str, float]
    #: units, made of mm, N and rad, of all compliances, slopes (changes of compliances with force)
    #: and geometric errors; the keys are the names of these parameters
    units: dict[str, str]


def true_parameters(
    parameters: Mapping[str, float], names: Sequence[str], interest: Array
) -> Array:
    """Return the true values of p parameters of interest for a simulation, shape (p,).

    Parameters
    ----------
    parameters
        Values that the user gives by name, in mm, N and rad; parameters that are not named are
        zero.
    names
        Names of the p parameters.
    interest
        Reading per unit of each parameter, as 25 Fourier coefficients, shape (tests, 25, p).

    Raises
    ------
    InputError
        If a name is unknown, a value is not finite, or a reading would exceed 100 mm.
    """
    values = {inside_name(name): value for name, value in parameters.items()}
    check_known("parameter", values, names)
    beta = np.array([values.get(name, 0.0) for name in names], dtype=float)
    for name, value in zip(names, beta.tolist(), strict=True):
        require(
            np.isfinite(value),
            f"true {name} must be a number, got {value}. Correct it.",
        )
    largest_mm = float(np.abs(interest @ beta).max())
    require(
        largest_mm < _LARGEST_READING_MM,
        f"true parameters must be in mm, N and rad, got ones that change readings by"
        f" {largest_mm:.3g} mm. For 60 nm/N write 60e-6.",
    )
    return beta


def true_hyper_parameters(
    hyper_um: Mapping[str, float], prior: HyperPrior, rng: np.random.Generator
) -> dict[str, float]:
    """Return the true values of all hyper-parameters for a simulation, with lengths in mm.

    Parameters
    ----------
    hyper_um
        Values that the user gives by name, with lengths in µm. All other hyper-parameters are drawn
        at random from their priors.
    prior
        Prior of the hyper-parameters.
    rng
        Generator of random numbers.

    Raises
    ------
    InputError
        If a name is unknown or a value is out of range.
    """
    check_known("hyper-parameter", hyper_um, prior.names)
    for name, law, bounds in zip(prior.names, prior.laws, prior.bounds.tolist(), strict=True):
        if name in hyper_um:
            _check_hyper_parameter(name, hyper_um[name], law, bounds)
    draw = prior.draw(1, rng)[0]
    units = (1.0 / prior.shown).tolist()
    phi = {}
    for name, value, unit in zip(prior.names, draw, units, strict=True):
        phi[name] = hyper_um.get(name, float(value / unit)) * unit
    return phi


def _check_hyper_parameter(name: str, value: float, law: Law, bounds: Sequence[float]) -> None:
    """Raise an `InputError` if a true hyper-parameter is out of range.

    ``name`` is the name of the hyper-parameter, and ``value`` the true value that a user gives for
    a simulation. Lengths are in µm; the decay and the factor that multiplies the noise of a circle
    have no unit. ``law`` is the kind of the hyper-parameter's prior. ``bounds`` are the smallest
    and the largest permitted value; they are used only for the decay p. The decay is an exponent:
    the prior sds of form errors with n waves around the circle are proportional to n^(−p).
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
