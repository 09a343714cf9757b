"""sample(): a model and a campaign into a posterior."""

from __future__ import annotations

import json
import os
import platform
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, replace
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import version
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.errors import InputError, check_known
from ldbb_bayes.inference.checkpoint import Checkpoint
from ldbb_bayes.inference.diagnostics import PredictiveChecks, predictive_checks, sensitive, verdict
from ldbb_bayes.inference.ensemble import Progress
from ldbb_bayes.inference.evidence import TruncationProbability, log_prob_truncation
from ldbb_bayes.inference.joint import JointDensity
from ldbb_bayes.inference.origin import campaign_record
from ldbb_bayes.inference.posterior import build_tree, power_sensitivity
from ldbb_bayes.inference.predictive import fit_quality
from ldbb_bayes.inference.quadrature import HyperPosterior
from ldbb_bayes.inference.samplers import SAMPLERS, run_sampler
from ldbb_bayes.inference.stopping import StoppingRule
from ldbb_bayes.model.bound import BoundModel
from ldbb_bayes.model.degeneracies import degeneracies, sentences, standing_degeneracies
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.linearisation import largest_linearisation_error_mm
from ldbb_bayes.model.simulate import draw_parameters
from ldbb_bayes.model.spec import model_sha256, model_to_toml
from ldbb_bayes.model.terms import Drift
from ldbb_bayes.threads import one_blas_thread

__all__ = ["sample", "sample_with_densities", "versions"]

Array = NDArray[Any]
_VERSIONS = ("ldbb-bayes", "numpy", "scipy", "emcee")
_ALL_VERSIONS = (*_VERSIONS, "arviz-stats")
_PRIOR_DRAWS = 4000
_CHUNK = 256
_QUALITY_DRAWS = 1000
_IMPROBABLE = 1e-3
_IMPOSSIBLE = 1e-6


@one_blas_thread
def sample(
    model: HybridModel,
    campaign: Campaign,
    *,
    sampler: str = "joint",
    seed: int = 1,
    ensembles: int = 4,
    walkers: int | None = None,
    rule: StoppingRule | None = None,
    progress: Callable[[Progress], None] | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    resume: bool = False,
) -> xr.DataTree:
    """Sample the posterior of compliances, slopes, geometric errors and hyper-parameters.

    Parameters
    ----------
    model : HybridModel
    campaign : Campaign
        With readings.
    sampler : {"joint", "collapsed", "quadrature"}
        ``joint``: emcee over everything but the nuisances, which are integrated out. ``collapsed``: emcee over the
        hyper-parameters alone, then exact conditional draws. ``quadrature``: independent draws from weighted nodes.
    seed : int
    ensembles, walkers : int
        At least 4 independent ensembles; walkers each.
    rule : StoppingRule
        When to stop; by default every parameter has bulk and tail ESS ≥ 1000 and R-hat ≤ 1.01.
    progress : callable, optional
        Called with a `Progress` at every look.
    checkpoint : path, optional
        Folder that keeps every block of a run, so that it can be resumed after whatever stopped it; remove it when the result is
        saved. `quadrature` takes seconds and keeps nothing.
    resume : bool
        Take the blocks found in ``checkpoint`` as they are and go on to the target: the result is that of an uninterrupted run,
        to the last bit. A raised target goes on where the run had ended.

    Returns
    -------
    xarray.DataTree
        ArviZ's layout: posterior, prior, sample_stats, log_prior, log_likelihood (per test, conditional on the other tests),
        observed_data, constant_data, provenance. All numbers in mm, N, rad.

    Raises
    ------
    InputError
        For a plan, an unknown sampler, a model that the campaign cannot carry, or a checkpoint that is damaged, of another run,
        or there without ``resume``.
    """
    tree, _ = sample_with_densities(
        model,
        campaign,
        sampler=sampler,
        seed=seed,
        ensembles=ensembles,
        walkers=walkers,
        rule=rule,
        progress=progress,
        checkpoint=checkpoint,
        resume=resume,
    )
    return tree


@one_blas_thread
def sample_with_densities(
    model: HybridModel,
    campaign: Campaign,
    *,
    sampler: str = "joint",
    seed: int = 1,
    ensembles: int = 4,
    walkers: int | None = None,
    rule: StoppingRule | None = None,
    progress: Callable[[Progress], None] | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    resume: bool = False,
) -> tuple[xr.DataTree, dict[bool, HyperPosterior]]:
    """The same, with the densities over the hyper-parameters it went by: True the one inside the truncation, False the other."""
    check_known("sampler", [sampler], SAMPLERS)
    if campaign.is_plan:
        raise InputError("campaign must have readings to be sampled, got a plan. Run the tests, or simulate the plan.")
    rule = rule or StoppingRule()
    started, clock = datetime.now(UTC), time.perf_counter()
    bound = model.bind(campaign)
    store = None
    if checkpoint is not None and sampler != "quadrature":
        store = Checkpoint(checkpoint, _run_key(bound, sampler, seed, ensembles, walkers, rule), resume=resume)
    seeds = np.random.SeedSequence(seed).spawn(3)
    start = HyperPosterior(bound, truncated=bound.truncation.active, seed=seed)
    run, beta, phi = run_sampler(
        sampler, start, ensembles=ensembles, walkers=walkers, rule=rule, seed=seeds[0], progress=progress, store=store
    )
    other = HyperPosterior(bound, truncated=not start.truncated, seed=seed)
    densities = {start.truncated: start, other.truncated: other}
    truncation = log_prob_truncation(densities[False], densities[True])
    quality = _fit(bound, beta, phi, truncation)
    groups = _groups(bound, beta, phi, np.random.default_rng(seeds[1]))
    record: dict[str, Any] = {
        "schema": 1,
        "campaign": campaign_record(campaign),
        "model": _model_record(bound),
        "sampler": {
            "kind": sampler,
            **asdict(run.assessment),
            "converged": run.converged,
            "draws": int(beta.shape[0] * beta.shape[1]),
            "seconds": time.perf_counter() - clock,
            "steps": run.steps,
            "walkers": run.walkers,
            "acceptance": run.acceptance,
            "target_ess": rule.ess,
            "target_rhat": rule.rhat,
        },
        "fit": quality,
        "provenance": {
            "versions": versions(),
            "seed": seed,
            "started": started.isoformat(timespec="seconds"),
            "platform": f"Python {platform.python_version()}, {platform.system()} {platform.machine()}",
        },
    }
    checks, sensitivity = _check(bound, beta, phi, groups, np.random.default_rng(seeds[2]))
    quality["predictive_checks"], quality["misfits"] = checks.as_dict(), list(checks.misfits)
    quality["sensitivity"] = sensitivity
    quality["verdict"] = verdict(
        converged=run.converged,
        checks=checks,
        contradicts=truncation.log_value < np.log(_IMPROBABLE),
        sensitive_to_prior=sensitive(sensitivity),
        parameters=len(sensitivity),
    )
    if not run.converged:
        target = f"ESS ≥ {rule.ess:g} and R-hat ≤ {rule.rhat:g}"
        cure = "allow more steps (--max-steps; with --resume --force a run kept by --out goes on)."
        if sampler == "quadrature":
            cure = "ask for more independent draws (a larger --ess)."
        record["fit"]["warnings"].insert(
            0,
            f"Not converged: {target} was not reached in {run.steps} steps. Do not use the numbers; {cure}",
        )
    tree = build_tree(
        groups,
        dims=_DIMS,
        coords={"test": list(bound.test_names)},
        units=_units(bound),
        provenance=json.dumps(record, ensure_ascii=False),
    )
    return tree, densities


@cache
def versions() -> dict[str, str]:
    """Versions of the packages that numbers come from."""
    return {name: version(name) for name in _ALL_VERSIONS}


def _run_key(
    bound: BoundModel, sampler: str, seed: int, ensembles: int, walkers: int | None, rule: StoppingRule
) -> dict[str, str]:
    """What fixes every block of a run; the target only says how many there are."""
    key: dict[str, object] = {
        "campaign": bound.campaign.sha256,
        "model": model_sha256(bound.model),
        "sampler": sampler,
        "seed": seed,
        "ensembles": ensembles,
        "walkers": walkers,
        "block": rule.block,
    }
    return {name: str(value) for name, value in (key | {f"version of {name}": version(name) for name in _VERSIONS}).items()}


_DIMS = {
    "per_test": ["test"],
    "force_N": ["test"],
    "pressure_bar": ["test"],
    "work_ball_deg": ["test"],
    "tool_ball_deg": ["test"],
    "radius_mm": ["test"],
    "angle_rad": ["reading"],
    "angle_as_read_deg": ["reading"],
    "reading_as_read_um": ["reading"],
    "test_index": ["reading"],
    "reading_mm": ["reading"],
    "reference_force_N": [],
}


def _fit(bound: BoundModel, beta: Array, phi: Array, truncation: TruncationProbability) -> dict[str, Any]:
    flat_beta, flat_phi = beta.reshape(-1, beta.shape[2]), phi.reshape(-1, phi.shape[2])
    pick = np.linspace(0, len(flat_beta) - 1, min(_QUALITY_DRAWS, len(flat_beta))).astype(int)
    quality = fit_quality(bound, flat_phi[pick], flat_beta[pick])
    return {
        "rmse_um": quality.rmse_um,
        "fitness_percent": quality.fitness_percent,
        "log_prob_truncation": truncation.log_value,
        "log_prob_truncation_error": truncation.error,
        "log_prob_truncation_prior": bound.log_prob_truncation_prior,
        "linearisation_error_um": largest_linearisation_error_mm(bound, flat_beta.mean(axis=0)) * 1e3,
        "warnings": list(_warnings(bound, flat_phi, truncation)),
    }


def _check(
    bound: BoundModel, beta: Array, phi: Array, groups: Mapping[str, Mapping[str, Array]], rng: np.random.Generator
) -> tuple[PredictiveChecks, dict[str, dict[str, float]]]:
    """Posterior predictive checks, and what scaling prior or likelihood would change."""
    prior, hyper_prior = groups["log_prior"]["parameters"], groups["log_prior"]["hyper"]
    jacobian = bound.hyper_prior.log_density_of_free(bound.hyper_prior.free(phi)) - hyper_prior
    likelihood = groups["sample_stats"]["lp"] - prior - hyper_prior - jacobian
    parts = {"prior": prior, "hyper_prior": hyper_prior, "likelihood": likelihood}
    sensitivity = power_sensitivity(groups["posterior"], parts)
    checks = predictive_checks(bound, phi.reshape(-1, phi.shape[2]), beta.reshape(-1, beta.shape[2]), rng)
    return checks, sensitivity


def _warnings(bound: BoundModel, phi: Array, truncation: TruncationProbability) -> Iterator[str]:
    if truncation.log_value < np.log(_IMPROBABLE):
        verb = "contradict" if truncation.log_value < np.log(_IMPOSSIBLE) else "speak against"
        yield (
            f"The readings {verb} non-negative compliance: ln P(T | y) = {truncation.log_value:.1f} (expected above "
            f"{np.log(_IMPROBABLE):.1f}). A nuisance may be missing, or a sign, a force or the mount compensation be wrong."
        )
    levels, needed = bound.campaign.force_levels, bound.model.degree + 2
    if levels == 1:
        yield "One force level: constant compliance and geometry are told apart by their priors alone."
    elif levels < needed:
        yield (
            f"Only {levels} force levels: at degree {bound.model.degree} compliance and geometry need {needed} to be told apart "
            "by the readings; here their priors do it."
        )
    limit = bound.hyper_prior.quantile(np.full(phi.shape[1], 0.999))
    for name, median, top in zip(bound.hyper_prior.names, np.median(phi, axis=0), limit, strict=True):
        if median > top:
            yield (
                f"Misfit: {name} = {median * 1e3:.3g} µm lies far above what its prior expects ({top * 1e3:.3g} µm at 99.9 %). "
                "The model misses something in these readings."
            )
    found = degeneracies(bound)
    yield from sentences(found)
    yield from standing_degeneracies(bound, found)


def _groups(bound: BoundModel, beta: Array, phi: Array, rng: np.random.Generator) -> dict[str, dict[str, Array]]:
    flat_beta, flat_phi = beta.reshape(-1, beta.shape[2]), phi.reshape(-1, phi.shape[2])
    shape = beta.shape[:2]
    per_test = [
        bound.log_likelihood_per_test(flat_phi[i : i + _CHUNK], flat_beta[i : i + _CHUNK])
        for i in range(0, len(flat_beta), _CHUNK)
    ]
    tests = [next(t for t in bound.campaign.tests if t.name == name) for name in bound.test_names]
    log_prior = {"parameters": bound.log_prior(beta)}
    log_prior["hyper"] = bound.hyper_prior.log_density(phi)
    groups: dict[str, dict[str, Array]] = {
        "posterior": _named(bound, beta, phi),
        "prior": _prior_draws(bound, rng),
        "sample_stats": {"lp": _log_density(bound, flat_beta, flat_phi).reshape(shape)},
        "log_prior": log_prior,
        "log_likelihood": {"per_test": np.concatenate(per_test).reshape(*shape, -1)},
        "observed_data": {"reading_mm": np.concatenate([test.readings_mm() for test in tests])},
        "constant_data": {
            "angle_rad": np.concatenate([test.angles_rad() for test in tests]),
            "angle_as_read_deg": np.concatenate([test.angle_deg for test in tests]),
            "reading_as_read_um": np.concatenate([test.reading_um for test in tests]),
            "test_index": np.repeat(np.arange(len(tests)), [len(test.angle_deg) for test in tests]),
            "force_N": bound.setting.force_N,
            "pressure_bar": bound.setting.pressure_bar,
            "work_ball_deg": np.array([test.work_ball_deg for test in tests]),
            "tool_ball_deg": np.array([test.tool_ball_deg for test in tests]),
            "radius_mm": np.array([test.radius_mm for test in tests], dtype=float),
            "reference_force_N": np.array(bound.setting.reference_force_N),
        },
    }
    return groups


def _log_density(bound: BoundModel, beta: Array, phi: Array) -> Array:
    """ln p(β, free coordinates of φ | y) up to a constant, shape (draws,)."""
    density = JointDensity(bound)
    points = density.join(beta, bound.hyper_prior.free(phi))
    return np.concatenate([density(points[i : i + _CHUNK]) for i in range(0, len(points), _CHUNK)])


def _named(bound: BoundModel, beta: Array, phi: Array) -> dict[str, Array]:
    named = {name: beta[..., j] for j, name in enumerate(bound.names)}
    return named | {str(name): phi[..., j] for j, name in enumerate(bound.hyper_prior.names)}


def _prior_draws(bound: BoundModel, rng: np.random.Generator) -> dict[str, Array]:
    """Draws of the prior inside the truncation, one chain; a flat prior leaves the hyper-parameters only."""
    phi = bound.hyper_prior.draw(_PRIOR_DRAWS, rng)[None]
    hyper = {str(name): phi[..., j] for j, name in enumerate(bound.hyper_prior.names)}
    if bound.model.prior.flat:
        return hyper
    return _named(bound, draw_parameters(bound, _PRIOR_DRAWS, rng)[None], phi)


def _units(bound: BoundModel) -> dict[str, str]:
    units = {parameter.name: parameter.unit for parameter in bound.parameters}
    units |= {str(name): "mm" for name in bound.hyper_prior.names}
    return units | {"force_N": "N", "pressure_bar": "bar", "reading_mm": "mm", "angle_rad": "rad", "radius_mm": "mm"}


def _model_record(bound: BoundModel) -> dict[str, Any]:
    finite = {p.name: (p.prior_sd if np.isfinite(p.prior_sd) else None) for p in bound.parameters}
    quantiles = bound.hyper_prior.quantile((np.arange(2000)[:, None] + 0.5) / 2000)
    finite |= {str(name): float(sd) for name, sd in zip(bound.hyper_prior.names, quantiles.std(axis=0), strict=True)}
    return {
        "preset": bound.model.preset,
        "degree": bound.model.degree,
        "reference_force_N": bound.setting.reference_force_N,
        "terms": list(bound.terms),
        "idle_terms": [name for name in bound.model.terms if name not in bound.terms],
        "truncated": bound.model.prior.truncated,
        "priors": "preset" if _has_preset_priors(bound.model) else "edited",
        "sha256": model_sha256(bound.model),
        "toml": model_to_toml(bound.model),
        "prior_sd": finite,
        "prior_mean": {p.name: p.prior_mean for p in bound.parameters if np.isfinite(p.prior_sd)},
        "fixed": list(bound.model.fixed),
        "groups": {p.name: p.group for p in bound.parameters},
    }


def _has_preset_priors(model: HybridModel) -> bool:
    preset = HybridModel.from_preset(model.preset, model.degree)
    usual = {type(term): term for term in preset.nuisances}
    same = all(
        replace(term, over="time") == Drift() if isinstance(term, Drift) else usual.get(type(term)) == term
        for term in model.nuisances
    )
    return same and replace(model.prior, truncated=preset.prior.truncated) == preset.prior
