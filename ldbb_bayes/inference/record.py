"""What a posterior keeps: its groups of arrays, and the record of campaign, model and sampler."""

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
from ldbb_bayes.inference.posterior import campaign_record
from ldbb_bayes.model.hybrid import BoundModel, HybridModel
from ldbb_bayes.model.specification import model_sha256, model_to_toml
from ldbb_bayes.model.terms import Drift
from ldbb_bayes.parallel.versions import versions
from ldbb_bayes.results import Array

__all__ = ["densities_of", "groups_of", "prior_draws_of", "record_from"]


def densities_of(draws: ModelDraws) -> dict[str, Array]:
    """Return the log density of each draw, and those of its priors, (n,) each."""
    bound, phi, beta = draws
    density = JointDensity(bound)
    points = density.join(beta, bound.hyper_prior.free(phi))
    return {
        "lp": in_chunks(density, points),
        "parameters": bound.log_prior(beta),
        "hyper": bound.hyper_prior.log_density(phi),
    }


def prior_draws_of(bound: BoundModel, size: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Draw β (size, p) from the prior inside the truncation, and φ (size, h) [mm].

    There are no draws of β where its prior is flat.
    """
    phi = bound.hyper_prior.draw(size, rng)
    if bound.model.prior.flat:
        return np.zeros((0, 0)), phi
    return bound.draw_parameters(size, rng), phi


def groups_of(
    bound: BoundModel,
    beta: Array,
    phi: Array,
    prior: tuple[Array, Array],
    densities: Mapping[str, Array],
) -> dict[str, dict[str, Array]]:
    """Return the arrays of the posterior, by group.

    Parameters
    ----------
    bound : BoundModel
    beta, phi : array, shape (chains, draws, …)
    prior : pair of arrays
        From `prior_draws_of`.
    densities : mapping
        From `densities_of`, each of shape (chains, draws).
    """
    by_name = {test.name: test for test in bound.campaign.tests}
    tests = [by_name[name] for name in bound.test_names]
    prior_beta, prior_phi = prior
    readings = [len(test.angle_deg) for test in tests]
    return {
        "posterior": _by_name(bound, beta, phi),
        "prior": _by_name(bound, prior_beta[None], prior_phi[None]),
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


def _by_name(bound: BoundModel, beta: Array, phi: Array) -> dict[str, Array]:
    """Return draws (…, p) and (…, h) by the names of parameters and hyper-parameters."""
    arrays = {}
    for column in range(beta.shape[2]):
        arrays[bound.names[column]] = beta[..., column]
    for column, name in enumerate(bound.hyper_prior.names):
        arrays[str(name)] = phi[..., column]
    return arrays


def record_from(
    bound: BoundModel, sampler: Mapping[str, Any], fit: Fit, seed: int, started: datetime
) -> dict[str, Any]:
    """Return what the group ``provenance`` keeps of a posterior."""
    system = f"Python {platform.python_version()}, {platform.system()} {platform.machine()}"
    return {
        "schema": 1,
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
    """Return what the record keeps of a model."""
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
    """Return whether the priors are those of the model's preset.

    A drift may be added, and the truncation switched off or on.
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
