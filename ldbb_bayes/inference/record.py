"""Functions that return the contents of a posterior: its arrays, and a record of how it was made.

The record describes the campaign, the model and the sampler.

β are the p parameters: compliances, their changes with force, and geometric errors. φ are the h
hyper-parameters, such as the standard deviation of the noise.
"""

from __future__ import annotations

import platform
from collections.abc import Mapping
from dataclasses import replace
from datetime import datetime
from typing import Any

import numpy as np

from ldbb_bayes.inference.coefficients import ModelDraws
from ldbb_bayes.inference.density import JointDensity
from ldbb_bayes.inference.fit import Fit
from ldbb_bayes.inference.integrals import in_chunks
from ldbb_bayes.inference.posterior import MODEL_EDITION, campaign_record
from ldbb_bayes.inference.residuals import tests_in_order
from ldbb_bayes.model.hybrid import BoundModel, HybridModel
from ldbb_bayes.model.specification import model_sha256, model_to_toml
from ldbb_bayes.model.terms import Drift
from ldbb_bayes.parallel.versions import versions
from ldbb_bayes.results import Array

__all__ = ["densities_of", "groups_of", "prior_draws_of", "record_from"]


def densities_of(draws: ModelDraws, log_posterior: Array | None = None) -> dict[str, Array]:
    """Return log posterior and log prior densities of n posterior draws, in a dict of arrays (n,).

    The entry ``lp`` is the logarithm of the posterior density in the coordinates of the sampler
    (see `JointDensity`); the density is not divided by the evidence. The entry ``parameters`` is
    the log prior density of the parameters (compliances, their changes with force, geometric
    errors). The entry ``hyper`` is the log prior density of the hyper-parameters (such as the
    standard deviation of the noise). ``log_posterior`` is the first of these if the sampler already
    knows it, else None.
    """
    bound, phi, beta = draws
    if log_posterior is None:
        density = JointDensity(bound)
        points = density.join(beta, bound.hyper_prior.free(phi))
        log_posterior = in_chunks(density, points)
    return {
        "lp": log_posterior,
        "parameters": bound.parameter_prior.log_density(beta),
        "hyper": bound.hyper_prior.log_density(phi),
    }


def prior_draws_of(bound: BoundModel, size: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return random draws of the p parameters and of the h hyper-parameters from the prior.

    Parameters are compliances, their changes with force, and geometric errors; hyper-parameters are
    quantities such as the standard deviation of the noise. The arrays have the shapes (size, p) and
    (size, h). If the model excludes negative compliances, the draws contain none. If the prior of
    the parameters is flat, no parameters can be drawn, and their array has the shape (0, 0).
    ``rng`` generates the random numbers. ``bound`` is the model of the campaign.
    """
    phi = bound.hyper_prior.draw(size, rng)
    if bound.model.prior.flat:
        return np.zeros((0, 0)), phi
    return bound.parameter_prior.draw(size, rng), phi


def groups_of(
    bound: BoundModel,
    beta: Array,
    phi: Array,
    prior: tuple[Array, Array],
    densities: Mapping[str, Array],
) -> dict[str, dict[str, Array]]:
    """Return the arrays of a posterior as a dict of groups; each group is a dict of arrays by name.

    Parameters
    ----------
    bound : BoundModel
        The model of the campaign.
    beta, phi : array, shapes (chains, draws, p) and (chains, draws, h)
        Random draws of the p parameters and of the h hyper-parameters from the posterior.
    prior : pair of arrays
        Random draws from the prior, as `prior_draws_of` returns them.
    densities : mapping
        Log densities as `densities_of` returns them, but each of shape (chains, draws).
    """
    tests = tests_in_order(bound)
    prior_beta, prior_phi = prior
    readings = [len(test.angle_deg) for test in tests]
    return {
        "posterior": _draws_by_name(bound, beta, phi),
        "prior": _draws_by_name(bound, prior_beta[None], prior_phi[None]),
        "sample_stats": {"lp": densities["lp"]},
        "log_prior": {"parameters": densities["parameters"], "hyper": densities["hyper"]},
        "observed_data": {"reading_mm": np.concatenate([test.readings_mm() for test in tests])},
        "constant_data": {
            "angle_rad": np.concatenate([test.angles_rad() for test in tests]),
            "angle_as_read_deg": np.concatenate([test.angle_deg for test in tests]),
            "reading_as_read_um": np.concatenate([test.reading_um for test in tests]),
            "test_index": np.repeat(np.arange(len(tests)), readings),
            "force_N": bound.setting.force_N,
            "pressure_bar": bound.setting.pressure_bar,
            "work_ball_deg": np.array([test.work_ball_deg for test in tests]),
            "tool_ball_deg": np.array([test.tool_ball_deg for test in tests]),
            "radius_mm": bound.setting.radius_mm,
            "reference_force_N": np.array(bound.setting.reference_force_N),
        },
    }


def _draws_by_name(bound: BoundModel, beta: Array, phi: Array) -> dict[str, Array]:
    """Return a dict with the random draws of each parameter and hyper-parameter.

    ``beta``, shape (chains, draws, p), holds the draws of the p parameters; ``phi``, shape (chains,
    draws, h), holds the draws of the h hyper-parameters. The keys of the result are the names of
    parameters and hyper-parameters; the arrays have the shape (chains, draws). ``bound`` is the
    model of the campaign.
    """
    arrays = {}
    for column in range(beta.shape[2]):
        arrays[bound.names[column]] = beta[..., column]
    for column, name in enumerate(bound.hyper_prior.names):
        arrays[str(name)] = phi[..., column]
    return arrays


def record_from(
    bound: BoundModel, sampler: Mapping[str, Any], fit: Fit, seed: int, started: datetime
) -> dict[str, Any]:
    """Return a record of how a posterior was made.

    The group ``provenance`` of the posterior keeps the record as JSON text. The record states the
    campaign, the model, how the sampler ran, the quality of the fit, the versions of the software,
    the seed of the random numbers, and the time ``started`` at which sampling began. ``bound`` is
    the model of the campaign.
    """
    system = f"Python {platform.python_version()}, {platform.system()} {platform.machine()}"
    return {
        "schema": 1,
        "model_edition": MODEL_EDITION,
        "campaign": campaign_record(bound.campaign),
        "model": _model_record(bound),
        "sampler": dict(sampler),
        "fit": fit.as_dict(),
        "provenance": {
            "versions": versions(),
            "seed": seed,
            "started": started.isoformat(timespec="seconds"),
            "platform": system,
        },
    }


def _model_record(bound: BoundModel) -> dict[str, Any]:
    """Return the entry ``model`` of the record that states how a posterior was made.

    The entry holds the preset, the terms, the priors and the TOML text of the model. ``bound`` is
    the model of the campaign.
    """
    model = bound.model
    prior_sd: dict[str, float | None] = {}
    prior_mean = {}
    for parameter in bound.parameters:
        prior_sd[parameter.name] = None
        if np.isfinite(parameter.prior_sd):
            prior_sd[parameter.name] = parameter.prior_sd
            prior_mean[parameter.name] = parameter.prior_mean
    hyper_prior = bound.hyper_prior
    for name, sd in zip(hyper_prior.names, hyper_prior.sd.tolist(), strict=True):
        prior_sd[str(name)] = sd
    return {
        "preset": model.preset,
        "degree": model.degree,
        "reference_force_N": bound.setting.reference_force_N,
        "terms": list(bound.terms),
        "idle_terms": [name for name in model.terms if name not in bound.terms],
        "truncated": model.prior.truncated,
        "priors": "preset" if _has_preset_priors(model) else "edited",
        "sha256": model_sha256(model),
        "toml": model_to_toml(model),
        "prior_sd": prior_sd,
        "prior_mean": prior_mean,
        "fixed": list(model.fixed),
        "groups": {parameter.name: parameter.group for parameter in bound.parameters},
    }


def _has_preset_priors(model: HybridModel) -> bool:
    """Return whether a model has the priors of the preset from which it was derived.

    A preset is one of the models that the package defines, such as the default model. The result is
    also True if a drift over time or temperature was added with its default priors, if terms were
    left out, or if the condition that no compliance is negative was switched on or off.
    """
    preset = HybridModel.from_preset(model.preset, model.degree)
    preset_terms = {type(term): term for term in preset.nuisances}
    for term in model.nuisances:
        if isinstance(term, Drift):
            is_preset = replace(term, over="time") == Drift()
        else:
            is_preset = preset_terms.get(type(term)) == term
        if not is_preset:
            return False
    return replace(model.prior, truncated=preset.prior.truncated) == preset.prior
