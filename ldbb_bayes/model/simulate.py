"""Readings that the model believes: a plan and truths into a campaign.

ρ_r = H_r β + nuisances ~ N(0, S(φ)) + ε; β and φ given or drawn from their priors.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.errors import InputError, check_known
from ldbb_bayes.model.basis import SIZE, basis
from ldbb_bayes.model.bound import BoundModel
from ldbb_bayes.model.columns import BasisNoise, Columns
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.linearisation import linearisation_error_mm
from ldbb_bayes.notebook import table_html

__all__ = ["Simulation", "draw_parameters", "simulate"]

Array = NDArray[Any]


@dataclass(frozen=True)
class Simulation:
    """A simulated campaign and what it was made from.

    Attributes
    ----------
    campaign : Campaign
    parameters : dict of parameter to true value
        In inside units (mm, N, rad).
    hyper_um : dict of hyper-parameter to true value [µm]
    """

    campaign: Campaign
    parameters: dict[str, float]
    hyper_um: dict[str, float]

    def _repr_html_(self) -> str:
        rows = [{"true parameter": name, "value (mm, N, rad)": value} for name, value in self.parameters.items()]
        rows += [{"true parameter": name, "value (mm, N, rad)": value * 1e-3} for name, value in self.hyper_um.items()]
        return table_html(f"Simulation of {self.campaign.name}, {len(self.campaign.tests)} tests", rows)


def simulate(
    model: HybridModel,
    plan: Campaign,
    *,
    seed: int,
    parameters: Mapping[str, float] | None = None,
    hyper_um: Mapping[str, float] | None = None,
    exact: bool = False,
) -> Simulation:
    """Simulate the readings of a plan (or replace those of a campaign).

    Parameters
    ----------
    parameters : mapping, optional
        True values in inside units; what it leaves out is zero. Default: one draw from the prior, inside the truncation.
    hyper_um : mapping, optional
        True σ, δ, κ, τ [µm]; what it leaves out is drawn from its prior.
    exact : bool
        Geometric errors through the exact forward model (Eq. 1-14) instead of the linear one.

    Raises
    ------
    InputError
        For unknown names, negative hyper-parameters, or a flat prior without parameters.
    """
    rng = np.random.default_rng(seed)
    bound = model.bind(plan)
    beta = _parameters(bound, parameters, rng)
    phi = _hyper(bound, hyper_um, rng)
    names, hypers = bound.names, bound.hyper_prior.names
    truth = replace(bound.setting, compliance_estimate=bound.compliance_at(bound.setting.reference_force_N) @ beta)
    coefficients = bound.interest @ beta + bound.known_offset
    by_name = dict(zip(hypers, phi, strict=True))
    for term in model.nuisances:
        for columns in term.columns(truth):
            coefficients = coefficients + _contribution(columns, by_name, truth.tests, rng)
    tests = []
    for test, own in zip(plan.tests, coefficients, strict=True):
        reading = basis(test.angles_rad()) @ own + rng.normal(0.0, by_name["sigma"], len(test.angle_deg))
        if exact:
            reading = reading + linearisation_error_mm(bound, test, beta)
        tests.append(test.with_reading_um(reading * 1e3))
    return Simulation(
        replace(plan, tests=tuple(tests)),
        dict(zip(names, beta.tolist(), strict=True)),
        {str(name): float(value * 1e3) for name, value in by_name.items()},
    )


def draw_parameters(bound: BoundModel, size: int, rng: np.random.Generator) -> Array:
    """Draws of β from its prior inside the truncation, shape (size, p).

    Raises
    ------
    InputError
        For a flat prior, which cannot be drawn from.
    """
    if bound.model.prior.flat:
        raise InputError("parameters must be given when the prior is flat, got none. Pass true values.")
    p = len(bound.names)
    if not bound.truncation.active:
        return bound.prior_mean + rng.standard_normal((size, p)) * bound.prior_sd
    draws = np.zeros((0, p))
    while len(draws) < size:
        spread = np.broadcast_to(np.diag(bound.prior_sd), (size, p, p))
        mean = np.broadcast_to(bound.prior_mean, (size, p))
        white, exact = bound.truncation.orthants(mean, spread).draw_spread(rng)
        beta = bound.prior_mean + white * bound.prior_sd
        draws = np.concatenate([draws, beta[exact & bound.truncation.holds(beta)]])
    return draws[:size]


def _parameters(bound: BoundModel, given: Mapping[str, float] | None, rng: np.random.Generator) -> Array:
    if given is None:
        return draw_parameters(bound, 1, rng)[0]
    check_known("parameter", given, bound.names)
    return np.array([given.get(name, 0.0) for name in bound.names], dtype=float)


def _hyper(bound: BoundModel, given_um: Mapping[str, float] | None, rng: np.random.Generator) -> Array:
    given = given_um or {}
    names = bound.hyper_prior.names
    check_known("hyper-parameter", given, names)
    for name, value in given.items():
        if not (np.isfinite(value) and value >= 0):
            raise InputError(f"hyper-parameter {name} must be a number ≥ 0 in µm, got {value}. Correct it.")
    drawn = bound.hyper_prior.draw(1, rng)[0]
    return np.array([given[name] * 1e-3 if name in given else value for name, value in zip(names, drawn, strict=True)])


def _contribution(columns: Columns | BasisNoise, phi: Mapping[Any, float], tests: int, rng: np.random.Generator) -> Array:
    """One draw of a nuisance term, shape (tests, 25) [mm]."""
    if isinstance(columns, BasisNoise):
        return phi[columns.hyper] * columns.sd * rng.standard_normal((tests, SIZE))
    sd = columns.sd * (phi[columns.hyper] if columns.hyper else 1.0)
    shape = (tests, len(sd)) if columns.private else (1, len(sd))
    drawn = np.broadcast_to(sd * rng.standard_normal(shape), (tests, len(sd)))
    return np.einsum("tkq,tq->tk", columns.values, drawn)
