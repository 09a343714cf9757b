"""Sampling a model and a campaign into a posterior, by one of two routes."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict
from datetime import UTC, datetime
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.errors import check_known, renamed, require
from ldbb_bayes.inference.coefficients import ModelDraws, pool_draws
from ldbb_bayes.inference.density import JointDensity, LinearRedraw, starting_points
from ldbb_bayes.inference.evidence import log_prob_truncation
from ldbb_bayes.inference.fit import Concern, ConcernKind, assess_fit
from ldbb_bayes.inference.independent_sampler import TooRoughError, draw_jointly
from ldbb_bayes.inference.mcmc import EnsembleRun, Progress, StoppingRule, assess, run_ensembles
from ldbb_bayes.inference.nodes import HyperPosterior
from ldbb_bayes.inference.posterior import build_tree
from ldbb_bayes.inference.record import densities_of, groups_of, prior_draws_of, record_from
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array

__all__ = [
    "IndependentDraws",
    "SampledDraws",
    "draw",
    "run_sampler",
    "sample",
    "sample_from",
    "sampler_named",
]

# Chains of independent draws, and the fewest ensembles of walkers: R-hat compares them.
_CHAINS = 4
# Walkers of an ensemble, unless four times the number of coordinates is more.
_WALKERS = 128
# So much more than the target ESS is drawn, that the smallest of many estimates reaches it.
_SURPLUS = 1.3
# Draws of each chain beyond that.
_SURPLUS_DRAWS = 50
# A run is worth so many times the draws that are thinned from it.
_THINNING = 4.0
# R-hat and autocorrelation times that suffice for draws thinned so far.
_RHAT_WHEN_THINNED = 1.05
_LENGTHS_WHEN_THINNED = 2.0


class SampledDraws(NamedTuple):
    """A run of a sampler, and its draws."""

    run: EnsembleRun
    beta: Array  #: (chains, draws, p)
    phi: Array  #: (chains, draws, h) [mm]


class IndependentDraws(NamedTuple):
    """Draws that are as good as independent."""

    beta: Array  #: (size, p)
    phi: Array  #: (size, h) [mm]
    by_emcee: bool  #: thinned from a run of emcee


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

    Parameters
    ----------
    model : HybridModel
    campaign : Campaign
        With readings.
    sampler : {"joint", "independent"}
        ``joint``: emcee over everything but the nuisances, which are integrated out.
        ``independent``: independent draws from weighted nodes over the hyper-parameters; where
        these cannot be trusted ``joint`` takes over and the record says so.
    seed : int
    ensembles : int
        At least 4 independent ensembles.
    walkers : int, optional
        Of each ensemble.
    rule : StoppingRule, optional
        When to stop; by default every parameter has bulk and tail ESS ≥ 1000 and R-hat ≤ 1.01.
    progress : callable, optional
        Called with a `Progress` at every look.

    Returns
    -------
    DataTree
        In ArviZ's layout: posterior, prior, sample_stats (lp: the log density over ln(φ − lower),
        of decay the logit), log_prior, observed_data, constant_data, provenance; `with_predictive`
        adds the groups for checks of models. In mm, N, rad.

    Raises
    ------
    InputError
        For a plan, an unknown sampler, or a model that the campaign cannot carry.
    """
    sampler = sampler_named(sampler)
    require(
        not campaign.is_plan,
        "campaign must have readings to be sampled, got a plan. Run the tests, or simulate the"
        " plan.",
    )
    inside = HyperPosterior(model.bind(campaign), truncated=True, seed=seed)
    return sample_from(
        inside,
        sampler,
        seed=seed,
        rule=StoppingRule() if rule is None else rule,
        ensembles=ensembles,
        walkers=walkers,
        progress=progress,
    )


def sampler_named(name: str) -> str:
    """Return the name of a sampler; refuse what is no sampler."""
    sampler = renamed(
        "sampler", name, {"quadrature": "independent"}, refused_from="0.3.0", stacklevel=5
    )
    check_known("sampler", [sampler], ("joint", "independent"))
    return sampler


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
    """Sample as `sample` does, from the density of the hyper-parameters inside the truncation.

    Where the model has no truncation, the density without it is sampled.
    """
    started = datetime.now(UTC)
    clock = time.perf_counter()
    bound = inside.bound
    sampling, *checking = np.random.SeedSequence(seed).spawn(3)
    start = inside if bound.truncation.active else inside.plain
    run, beta, phi = run_sampler(sampler, start, rule=rule, seed=sampling, **options)
    chains, size = beta.shape[:2]
    flat_beta, flat_phi = pool_draws(beta, phi)
    draws = ModelDraws(bound, flat_phi, flat_beta)
    densities = {name: values.reshape(chains, size) for name, values in densities_of(draws).items()}
    prior = prior_draws_of(bound, prior_draws, np.random.default_rng(checking[0]))
    groups = groups_of(bound, beta, phi, prior, densities)
    concerns = []
    if not run.converged:
        concerns.append(Concern(ConcernKind.NOT_CONVERGED, run.steps, rule.ess))
    sampler_record = {
        "kind": "joint" if run.walkers > 1 else sampler,
        "by_emcee": sampler == "independent" and run.walkers > 1,
        **asdict(run.assessment),
        "converged": run.converged,
        "draws": chains * size,
        "seconds": time.perf_counter() - clock,
        "steps": run.steps,
        "walkers": run.walkers,
        "acceptance": run.acceptance,
        "target_ess": rule.ess,
        "target_rhat": rule.rhat,
    }
    rng = np.random.default_rng(checking[1])
    fit = assess_fit(bound, [draws], groups, log_prob_truncation(inside), concerns, rng)
    return build_tree(groups, bound, record_from(bound, sampler_record, fit, seed, started))


def run_sampler(
    sampler: str,
    start: HyperPosterior,
    *,
    rule: StoppingRule,
    seed: np.random.SeedSequence,
    progress: Callable[[Progress], None] | None = None,
    **ensembles: Any,
) -> SampledDraws:
    """Run a sampler until the rule is met.

    Of independent draws ``steps`` counts those of one chain, ``walkers`` is 1, ``acceptance`` the
    share of proposals used.
    """
    if sampler == "independent":
        try:
            return _sample_independently(start, rule=rule, seed=seed, progress=progress)
        except TooRoughError:  # the weights of the nodes cannot be trusted
            pass
    return _sample_jointly(start, rule=rule, seed=seed, progress=progress, **ensembles)


def _sample_independently(
    start: HyperPosterior,
    *,
    rule: StoppingRule,
    seed: np.random.SeedSequence,
    progress: Callable[[Progress], None] | None,
) -> SampledDraws:
    """Draw independently from the nodes, doubling the draws until the rule is met."""
    rng = np.random.default_rng(seed)
    block = int(np.ceil(_SURPLUS * rule.ess / _CHAINS + _SURPLUS_DRAWS))
    free_blocks = []
    beta_blocks = []
    while True:
        free, beta, acceptance = draw_jointly(start, _CHAINS * block, rng)
        free_blocks.append(free.reshape(_CHAINS, block, -1))
        beta_blocks.append(beta.reshape(_CHAINS, block, -1))
        chain = np.concatenate(free_blocks, axis=1)
        beta = np.concatenate(beta_blocks, axis=1)
        assessment = assess(np.concatenate([beta, chain], axis=2))
        steps = chain.shape[1]
        converged = assessment.meets(rule, walkers=0)
        if progress is not None:
            progress(Progress(steps, steps, rule.ess, assessment))
        if converged or 2 * steps > rule.max_steps:
            run = EnsembleRun(chain, assessment, converged, steps, 1, acceptance)
            return SampledDraws(run, beta, start.bound.hyper_prior.phi(chain))
        block = steps


def _sample_jointly(
    start: HyperPosterior,
    *,
    rule: StoppingRule,
    seed: np.random.SeedSequence,
    progress: Callable[[Progress], None] | None = None,
    ensembles: int = _CHAINS,
    walkers: int | None = None,
) -> SampledDraws:
    """Sample the joint posterior by emcee.

    Ensembles start from φ drawn a little wider than its posterior, and from the exact conditional
    Gaussian of β.
    """
    density = JointDensity(start.bound)
    d = len(start.bound.names) + len(start.bound.hyper_prior.names)
    count = walkers or max(_WALKERS, 4 * d)
    require(
        ensembles >= _CHAINS,
        f"ensembles must be at least 4, got {ensembles}. R-hat needs independent chains.",
    )
    require(
        count >= 2 * d and count % 2 == 0,
        f"walkers must be even and at least {2 * d} for {d} parameters, got {count}. Use more"
        " walkers.",
    )
    starting, sampling = seed.spawn(2)
    redraw = LinearRedraw(density, start)
    random = np.random.RandomState(starting.generate_state(8))
    starts = starting_points(redraw, ensembles * count, random).reshape(ensembles, count, d)
    run = run_ensembles(density, starts, rule=rule, seed=sampling, progress=progress, redraw=redraw)
    beta, free = density.split(run.chain)
    return SampledDraws(run, beta, start.bound.hyper_prior.phi(free))


def draw(
    sampler: str, start: HyperPosterior, size: int, *, seed: np.random.SeedSequence
) -> IndependentDraws:
    """Return draws that are as good as independent.

    Those of emcee are thinned from a run worth four times as many. It also takes the place of
    ``independent`` where the weights of the nodes cannot be trusted.
    """
    if sampler == "independent":
        try:
            free, beta, _ = draw_jointly(start, size, np.random.default_rng(seed))
        except TooRoughError:
            pass
        else:
            return IndependentDraws(beta, start.bound.hyper_prior.phi(free), by_emcee=False)
    rule = StoppingRule(
        ess=_THINNING * size, rhat=_RHAT_WHEN_THINNED, lengths=_LENGTHS_WHEN_THINNED
    )
    run, beta, phi = _sample_jointly(start, rule=rule, seed=seed)
    require(
        run.converged,
        f"emcee must converge, got R-hat {run.assessment.rhat_max:.3f} after {run.steps} steps. Use"
        " --seed.",
    )
    thinned_beta, thinned_phi = pool_draws(beta, phi, size)
    return IndependentDraws(thinned_beta, thinned_phi, by_emcee=True)
