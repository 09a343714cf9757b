"""sample(): a model and a campaign into a posterior, by one of two routes."""

from __future__ import annotations

import platform
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict, replace
from datetime import UTC, datetime
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.errors import check_known, renamed, require
from ldbb_bayes.inference.coefficients import (
    ModelDraws,
    pool_draws,
)
from ldbb_bayes.inference.density import JointDensity, LinearRedraw, starting_points
from ldbb_bayes.inference.evidence import log_prob_truncation
from ldbb_bayes.inference.fit import Concern, ConcernKind, Fit, fit_of_parts
from ldbb_bayes.inference.integrals import in_chunks
from ldbb_bayes.inference.mcmc import EnsembleRun, Progress, StoppingRule, assess, run_ensembles
from ldbb_bayes.inference.nodes import HyperPosterior, TooRoughError, draw_jointly
from ldbb_bayes.inference.posterior import build_tree, campaign_record
from ldbb_bayes.model.hybrid import BoundModel, HybridModel
from ldbb_bayes.model.specification import model_sha256, model_to_toml
from ldbb_bayes.model.terms import Drift
from ldbb_bayes.parallel import one_blas_thread, versions
from ldbb_bayes.results import Array

if TYPE_CHECKING:
    import xarray as xr

__all__ = [
    "densities_of",
    "draw",
    "groups_of",
    "prior_draws_of",
    "record_from",
    "run_sampler",
    "sample",
    "sample_from",
    "sampler_named",
]

_CHAINS = 4
_SPACING = 4.0
_WALKERS = 128


def _joint(
    start: HyperPosterior,
    *,
    ensembles: int = 4,
    walkers: int | None = None,
    rule: StoppingRule,
    seed: np.random.SeedSequence,
    progress: Callable[[Progress], None] | None = None,
) -> tuple[EnsembleRun, Array, Array]:
    """The run, and draws of β (ensembles, draws, p) and φ (ensembles, draws, h) [mm] from the joint
    posterior.

    Ensembles start from φ drawn a little wider than its posterior, and from the exact conditional
    Gaussian of β."""
    density = JointDensity(start.bound)
    d = len(start.bound.names) + len(start.bound.hyper_prior.names)
    count = walkers or max(_WALKERS, 4 * d)
    require(
        ensembles >= 4,
        f"ensembles must be at least 4, got {ensembles}. R-hat needs independent chains.",
    )
    even = count >= 2 * d and count % 2 == 0
    require(
        even,
        f"walkers must be even and at least {2 * d} for {d} parameters, got {count}. Use more"
        " walkers.",
    )
    starting, sampling = seed.spawn(2)
    redraw = LinearRedraw(density, start)
    random = np.random.RandomState(starting.generate_state(8))
    starts = starting_points(redraw, ensembles * count, random).reshape(ensembles, count, d)
    run = run_ensembles(density, starts, rule=rule, seed=sampling, progress=progress, redraw=redraw)
    beta, free = density.split(run.chain)
    return run, beta, start.bound.hyper_prior.phi(free)


def sampler_named(name: str) -> str:
    """Return the name of a sampler; what is no sampler is refused."""
    sampler = renamed(
        "sampler", name, {"quadrature": "independent"}, refused_from="0.3.0", stacklevel=5
    )
    check_known("sampler", [sampler], ("joint", "independent"))
    return sampler


def run_sampler(
    sampler: str,
    start: HyperPosterior,
    *,
    rule: StoppingRule,
    seed: np.random.SeedSequence,
    progress: Callable[[Progress], None] | None = None,
    **ensembles: Any,
) -> tuple[EnsembleRun, Array, Array]:
    """A run until the rule is met, β (chains, draws, p) and φ (chains, draws, h) [mm].

    Of independent draws ``steps`` counts those of one chain, ``walkers`` is 1, ``acceptance`` the
    share of proposals used.
    """
    emcee = partial(_joint, start, rule=rule, seed=seed, progress=progress, **ensembles)
    if sampler == "joint":
        return emcee()
    rng = np.random.default_rng(seed)
    # A third more than the target, so that the smallest of many estimates of ESS reaches it; twice
    # as many where it does not.
    each = int(np.ceil(1.3 * rule.ess / _CHAINS + 50))
    found = list[tuple[Array, ...]]()
    while True:
        try:
            free, beta, acceptance = draw_jointly(start, _CHAINS * each, rng)
        except TooRoughError:
            return emcee()
        found.append((free.reshape(_CHAINS, each, -1), beta.reshape(_CHAINS, each, -1)))
        chain, beta = (np.concatenate(own, axis=1) for own in zip(*found, strict=True))
        assessment = assess(np.concatenate([beta, chain], axis=2))
        steps = chain.shape[1]
        converged = assessment.meets(rule, walkers=0)
        if progress is not None:
            progress(Progress(steps, steps, rule.ess, assessment))
        if converged or 2 * steps > rule.max_steps:
            break
        each = steps
    run = EnsembleRun(chain, assessment, converged, steps, 1, acceptance)
    return run, beta, start.bound.hyper_prior.phi(chain)


def draw(
    sampler: str, start: HyperPosterior, size: int, *, seed: np.random.SeedSequence
) -> tuple[Array, Array, bool]:
    """As good as independent draws: β, shape (size, p), and φ, shape (size, h) [mm]; and whether
    they are emcee's: thinned from a run worth four times as many, also in place of ``independent``
    where its weights cannot be trusted."""
    with suppress(TooRoughError):
        if sampler == "independent":
            free, beta, _ = draw_jointly(start, size, np.random.default_rng(seed))
            return beta, start.bound.hyper_prior.phi(free), False
    rule = StoppingRule(ess=_SPACING * size, rhat=1.05, lengths=2.0)
    run, beta, phi = _joint(start, rule=rule, seed=seed)
    require(
        run.converged,
        f"emcee must converge, got R-hat {run.assessment.rhat_max:.3f} after {run.steps} steps. Use"
        " --seed.",
    )
    return *pool_draws(beta, phi, size), True


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
) -> xr.DataTree:
    """Sample the posterior of compliances, slopes, geometric errors and hyper-parameters.

    InputError for a plan, an unknown sampler, or a model that the campaign cannot carry.

    Parameters
    ----------
    model : HybridModel
    campaign : with readings.
    sampler : {"joint", "independent"}
        ``joint``: emcee over everything but the nuisances, which are integrated out.
        ``independent``: independent draws from weighted nodes over the hyper-parameters; where
        these cannot be trusted ``joint`` takes over and the record says so.
    seed : int
    ensembles, walkers : at least 4 independent ensembles; walkers each.
    rule : when to stop; by default every parameter has bulk and tail ESS ≥ 1000 and R-hat ≤ 1.01.
    progress : called with a `Progress` at every look.

    Returns
    -------
    ArviZ's layout: posterior, prior, sample_stats (lp: the log density over ln(φ − lower), of decay
    the logit), log_prior, observed_data, constant_data, provenance; `with_predictive` adds the
    groups for checks of models. In mm, N, rad.
    """
    sampler = sampler_named(sampler)
    require(
        not campaign.is_plan,
        "campaign must have readings to be sampled, got a plan. Run the tests, or simulate the"
        " plan.",
    )
    inside = HyperPosterior(model.bind(campaign), truncated=True, seed=seed)
    options: dict[str, Any] = {
        "ensembles": ensembles,
        "walkers": walkers,
        "rule": rule or StoppingRule(),
        "progress": progress,
    }
    return sample_from(inside, sampler, seed=seed, **options)


@one_blas_thread
def sample_from(
    inside: HyperPosterior,
    sampler: str,
    *,
    seed: int,
    rule: StoppingRule,
    prior_draws: int = 4000,
    **options: Any,
) -> xr.DataTree:
    """The same by the density of the hyper-parameters inside the truncation, and where the model
    has none without it."""
    started = datetime.now(UTC)
    clock = time.perf_counter()
    bound = inside.bound
    sampling, *checking = np.random.SeedSequence(seed).spawn(3)
    start = inside if bound.truncation.active else inside.plain
    run, beta, phi = run_sampler(sampler, start, rule=rule, seed=sampling, **options)
    flat = ModelDraws(bound, *reversed(pool_draws(beta, phi)))
    arrays = {
        name: own.reshape(*beta.shape[:2], *own.shape[1:])
        for name, own in densities_of(flat).items()
    }
    prior = prior_draws_of(bound, prior_draws, np.random.default_rng(checking[0]))
    groups = groups_of(bound, beta, phi, prior, arrays)
    missed = [] if run.converged else [Concern(ConcernKind.NOT_CONVERGED, run.steps, rule.ess)]
    route = {
        "kind": "joint" if run.walkers > 1 else sampler,
        "by_emcee": sampler == "independent" and run.walkers > 1,
        **asdict(run.assessment),
        "converged": run.converged,
        "draws": int(beta.shape[0] * beta.shape[1]),
        "seconds": time.perf_counter() - clock,
        "steps": run.steps,
        "walkers": run.walkers,
        "acceptance": run.acceptance,
        "target_ess": rule.ess,
        "target_rhat": rule.rhat,
    }
    fit = fit_of_parts(
        bound,
        [flat],
        groups,
        log_prob_truncation(inside),
        missed,
        np.random.default_rng(checking[1]),
    )
    return build_tree(groups, bound, record_from(bound, route, fit, seed, started))


def record_from(
    bound: BoundModel, sampler: Mapping[str, Any], fit: Fit, seed: int, started: datetime
) -> dict[str, Any]:
    """What the group ``provenance`` keeps of a posterior."""
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
            "platform": (
                f"Python {platform.python_version()}, {platform.system()} {platform.machine()}"
            ),
        },
    }


def densities_of(part: ModelDraws) -> dict[str, Array]:
    """Of each draw its log density and those of its priors, (n,) each."""
    bound, phi, beta = part
    density = JointDensity(bound)
    lp = in_chunks(density, density.join(beta, bound.hyper_prior.free(phi)))
    return {
        "lp": lp,
        "parameters": bound.log_prior(beta),
        "hyper": bound.hyper_prior.log_density(phi),
    }


def prior_draws_of(bound: BoundModel, size: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Draws of β (size, p) from the prior inside the truncation, none where it is flat, and of φ
    (size, h) [mm]."""
    phi = bound.hyper_prior.draw(size, rng)
    return np.zeros((0, 0)) if bound.model.prior.flat else bound.draw_parameters(size, rng), phi


def groups_of(
    bound: BoundModel,
    beta: Array,
    phi: Array,
    prior: tuple[Array, Array],
    densities: Mapping[str, Array],
) -> dict[str, dict[str, Array]]:
    """The arrays of the posterior, by group, from draws (chains, draws, …), `prior_draws_of` and
    `densities_of`."""
    tests = [next(t for t in bound.campaign.tests if t.name == name) for name in bound.test_names]
    return {
        "posterior": _named(bound, beta, phi),
        "prior": _named(bound, prior[0][None], prior[1][None]),
        "sample_stats": {"lp": densities["lp"]},
        "log_prior": {name: densities[name] for name in ("parameters", "hyper")},
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
            "radius_mm": bound.setting.radius_mm,
            "reference_force_N": np.array(bound.setting.reference_force_N),
        },
    }


def _named(bound: BoundModel, beta: Array, phi: Array) -> dict[str, Array]:
    named = {name: beta[..., j] for j, name in enumerate(bound.names[: beta.shape[2]])}
    return named | {str(name): phi[..., j] for j, name in enumerate(bound.hyper_prior.names)}


def _model_record(bound: BoundModel) -> dict[str, Any]:
    prior_sd = {p.name: p.prior_sd if np.isfinite(p.prior_sd) else None for p in bound.parameters}
    prior_sd |= {
        str(name): sd
        for name, sd in zip(bound.hyper_prior.names, bound.hyper_prior.sd.tolist(), strict=True)
    }
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
        "prior_sd": prior_sd,
        "prior_mean": {p.name: p.prior_mean for p in bound.parameters if np.isfinite(p.prior_sd)},
        "fixed": list(bound.model.fixed),
        "groups": {p.name: p.group for p in bound.parameters},
    }


def _has_preset_priors(model: HybridModel) -> bool:
    preset = HybridModel.from_preset(model.preset, model.degree)
    usual = {type(term): term for term in preset.nuisances}
    same = all(
        (
            replace(term, over="time") == Drift()
            if isinstance(term, Drift)
            else usual.get(type(term)) == term
        )
        for term in model.nuisances
    )
    return same and replace(model.prior, truncated=preset.prior.truncated) == preset.prior
