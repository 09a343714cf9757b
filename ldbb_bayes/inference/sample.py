"""Random draws from the posterior of a model applied to a campaign.

The draws are made by the Markov chain sampler emcee, or they are independent of each other. β are
the p parameters: compliances, their changes with force, and geometric errors. φ are the h
hyper-parameters, such as the standard deviation of the noise. ESS is the effective sample size.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import asdict
from datetime import UTC, datetime
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from ldbb_bayes.campaign.campaign import Campaign, require_campaign
from ldbb_bayes.errors import check_known, check_seed, require
from ldbb_bayes.inference.coefficients import ModelDraws, pool_draws
from ldbb_bayes.inference.density import JointDensity, LinearRedraw, starting_points
from ldbb_bayes.inference.evidence import log_prob_truncation
from ldbb_bayes.inference.fit import Concern, ConcernKind, Fit
from ldbb_bayes.inference.fit_assessment import assess_fit
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.inference.independent_sampler import TooRoughError, draw_jointly
from ldbb_bayes.inference.mcmc import EnsembleRun, Progress, StoppingRule, assess, run_ensembles
from ldbb_bayes.inference.posterior import build_tree
from ldbb_bayes.inference.record import densities_of, groups_of, prior_draws_of, record_from
from ldbb_bayes.model.hybrid import HybridModel, require_model
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array

__all__ = [
    "CHAINS",
    "FittedModel",
    "IndependentDraws",
    "SampledDraws",
    "check_sampler",
    "draw",
    "fit_model",
    "run_sampler",
    "sample",
]

# Independent draws are divided into this number of chains. If emcee is used, it runs at least this
# number of ensembles of walkers. R-hat compares the chains, or the ensembles, with each other.
CHAINS = 4
# Default number of walkers of an ensemble of emcee. If four times the number of parameters and
# hyper-parameters is larger, that number is used instead.
_WALKERS = 128
# Number of independent draws, divided by the required effective sample size. This ratio is above
# one because every parameter must reach the required size, and the computed effective sample size
# scatters from parameter to parameter.
_SURPLUS = 1.3
# Number of independent draws that are added to each chain. The computed effective sample size
# scatters from parameter to parameter; with the additional draws, every parameter reaches the
# required size.
_SURPLUS_DRAWS = 50
# If the effective sample size is too small, draws are added until it is expected to be this many
# times the size required.
_REACHED_AT_LEAST = 1.1
# If nearly independent draws are picked from a run of emcee, the effective sample size of the run
# must be at least this many times the number of draws picked.
_THINNING = 4.0
# If nearly independent draws are picked from a run of emcee, the R-hat of the run must be at most
# ``_RHAT_WHEN_THINNED``, and the run must span at least ``_LENGTHS_WHEN_THINNED`` autocorrelation
# times.
_RHAT_WHEN_THINNED = 1.05
_LENGTHS_WHEN_THINNED = 2.0


class SampledDraws(NamedTuple):
    """Posterior draws of parameters and hyper-parameters, and statistics of the sampler's run."""

    run: EnsembleRun
    #: posterior draws of the p parameters (compliances, their changes with force, geometric errors)
    #: in mm, N and rad, shape (chains, draws, p)
    beta: Array
    #: posterior draws of the h hyper-parameters (scales of the noise and of other effects; scales
    #: that are lengths are in mm), shape (chains, draws, h)
    phi: Array
    #: log posterior density at every draw, as `JointDensity` defines it, shape (chains, draws);
    #: None if the sampler does not keep it
    log_posterior: Array | None = None


class IndependentDraws(NamedTuple):
    """Independent or nearly independent posterior draws of parameters and hyper-parameters."""

    #: posterior draws of the p parameters (compliances, their changes with force, geometric errors)
    #: in mm, N and rad, shape (size, p)
    beta: Array
    #: posterior draws of the h hyper-parameters, such as the standard deviation of the noise, shape
    #: (size, h); lengths are in mm
    phi: Array
    #: whether posterior draws are thinned from a run of emcee; if False, the draws are independent
    by_emcee: bool


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
    """Return random draws from the posterior of the parameters and hyper-parameters of a model.

    The posterior is p(β, φ | y) ∝ p(y | β, φ) p(β) p(φ). y are the readings. β are the parameters:
    compliances, their changes with force, and geometric errors. φ are the hyper-parameters, such as
    the standard deviation of the noise. Nuisances, effects that are modelled but not of interest,
    are integrated out.

    Parameters
    ----------
    model : HybridModel
        Model with its nuisances and priors.
    campaign : Campaign
        Campaign with readings.
    sampler : {"joint", "independent"}
        ``joint``: emcee samples all parameters and hyper-parameters. ``independent``: rejection
        sampling gives independent draws; its proposal density is fitted to the posterior of the
        hyper-parameters. If the importance weights of this density cannot be trusted, ``joint`` is
        used instead, and the record of the posterior states this.
    seed : int
        Seed of all random numbers.
    ensembles : int
        Number of independent ensembles of walkers, at least 4; only for ``joint``.
    walkers : int, optional
        Number of walkers of each ensemble, even and at least twice the number d of parameters and
        hyper-parameters; only for ``joint``. Default: 4 d, but at least 128.
    rule : StoppingRule, optional
        Rule that decides when sampling stops. Default: every parameter has bulk and tail ESS
        (effective sample size) ≥ 1000 and R-hat ≤ 1.01, and the further conditions of
        `StoppingRule` are met.
    progress : callable, optional
        Function called with a report of the run each time that convergence is assessed.

    Returns
    -------
    DataTree
        Posterior in ArviZ's layout, in mm, N and rad, with the groups posterior, prior,
        sample_stats, log_prior, observed_data, constant_data and provenance. Draws have the shape
        (chain, draw). ``lp`` in sample_stats is the log posterior density in unbounded coordinates
        of the hyper-parameters φ: ln(φ − lower bound), or a logit for a decay (exponent with which
        form errors decrease with their order). `with_predictive` adds the groups for checks of
        models.

    Raises
    ------
    InputError
        For a plan (a campaign without readings), an unknown sampler, too few ensembles or walkers,
        or a model that cannot be fitted to the campaign.

    Examples
    --------
    >>> posterior = lb.sample(lb.HybridModel.first(0), campaign, sampler="independent")
    >>> compliance = posterior["posterior"]["C_YYY"]
    >>> compliance.dims, compliance.attrs["unit"]
    (('chain', 'draw'), 'mm/N')
    >>> round(float(compliance.mean()) * 1e6)  # nm/N
    43
    """
    check_sampler(sampler)
    require_model(model)
    check_seed(seed)
    require_campaign(campaign)
    require(
        not campaign.is_plan,
        "campaign must have readings to be sampled, got a plan. Run the tests, or simulate the"
        " plan.",
    )
    inside = HyperPosterior(model.bind(campaign), truncated=True, seed=seed)
    fitted = fit_model(
        inside,
        sampler,
        seed=seed,
        rule=StoppingRule() if rule is None else rule,
        ensembles=ensembles,
        walkers=walkers,
        progress=progress,
    )
    return fitted.tree()


def check_sampler(name: str) -> None:
    """Raise an `InputError` unless ``name`` is that of a sampler, "joint" or "independent"."""
    require(
        name != "emcee",
        "sampler must be joint or independent, got 'emcee'. emcee draws in sampler='joint'.",
    )
    check_known("sampler", [name], ("joint", "independent"))


class FittedModel(NamedTuple):
    """Posterior draws from the fit of a model to a campaign, and how well the model fits.

    Most analyses need the draws as a DataTree, which `tree` builds. It is built only on request,
    which saves time when many campaigns are fitted.
    """

    #: model of the campaign, with the posterior draws of its parameters and hyper-parameters; the
    #: draws of all chains are joined
    draws: ModelDraws
    #: draws, log densities and data of a posterior, in a dict of groups; each group is a dict of
    #: arrays. The keys are the names of the groups and of the arrays
    groups: Mapping[str, Mapping[str, Array]]
    fit: Fit  #: how well the model fits the readings, and warnings for the user
    #: how the sampler ran, for example its number of draws; stored as the entry ``sampler`` of the
    #: posterior's record
    sampler: Mapping[str, Any]
    seed: int  #: seed of all random numbers of a fit
    started: datetime  #: date and time at which the sampling of a posterior started

    def tree(self) -> xr.DataTree:
        """Return the posterior as a DataTree in ArviZ's layout, with a record of the fit."""
        bound = self.draws.bound
        record = record_from(bound, self.sampler, self.fit, self.seed, self.started)
        return build_tree(self.groups, bound, record)


@one_blas_thread
def fit_model(
    inside: HyperPosterior,
    sampler: str,
    *,
    seed: int,
    rule: StoppingRule,
    prior_draws: int = 4000,
    **options: Any,
) -> FittedModel:
    """Fit a model to a campaign. Return posterior draws, and how well the model fits.

    Parameters
    ----------
    inside : HyperPosterior
        Posterior density of the hyper-parameters (such as the standard deviation of the noise)
        under the condition that no compliance is negative. If the model allows negative
        compliances, the density without this condition is used instead
        (``inside.without_truncation``).
    sampler : {"joint", "independent"}
        Name of the sampler.
    seed : int
        Seed of all random numbers.
    rule : StoppingRule
        Rule that decides when sampling stops.
    prior_draws : int
        Number of random draws from the prior that are stored with the posterior.
    **options
        Further arguments of `run_sampler`.
    """
    started = datetime.now(UTC)
    clock = time.perf_counter()
    bound = inside.bound
    sampling, *checking = np.random.SeedSequence(seed).spawn(3)
    start = inside if bound.truncation.active else inside.without_truncation
    sampled = run_sampler(sampler, start, rule=rule, seed=sampling, **options)
    run = sampled.run
    beta = sampled.beta
    phi = sampled.phi
    chains, size = beta.shape[:2]
    flat_beta, flat_phi = pool_draws(beta, phi)
    draws = ModelDraws(bound, flat_phi, flat_beta)
    densities = {
        name: values.reshape(chains, size)
        for name, values in densities_of(draws, sampled.log_posterior).items()
    }
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
    return FittedModel(draws, groups, fit, sampler_record, seed, started)


def run_sampler(
    sampler: str,
    start: HyperPosterior,
    *,
    rule: StoppingRule,
    seed: np.random.SeedSequence,
    progress: Callable[[Progress], None] | None = None,
    **ensembles: Any,
) -> SampledDraws:
    """Return posterior draws of parameters and hyper-parameters, drawn by the named sampler.

    If ``sampler`` is "independent" but the importance weights cannot be trusted, emcee samples
    parameters and hyper-parameters jointly instead. The field ``run`` of the result describes the
    run of the sampler. ``run.converged`` states whether the draws meet the stopping rule; if they
    do not, the sampler gave up. For independent draws, ``run.steps`` is the number of draws of one
    chain, ``run.walkers`` is 1, and ``run.acceptance`` is the share of proposals accepted.

    Parameters
    ----------
    sampler
        ``independent`` or ``joint``.
    start
        Posterior density of the hyper-parameters (such as the standard deviation of the noise). The
        independent draws, or the starting points of emcee, are drawn from it.
    rule
        Rule that states the effective sample size to reach, and when the sampler gives up.
    seed
        Seed of the random draws.
    progress
        Function called with a `Progress` each time that convergence is assessed.
    **ensembles
        ``ensembles`` is the number of ensembles that emcee runs, and ``walkers`` the number of
        walkers of each ensemble. Neither is used for independent draws.

    Returns
    -------
    SampledDraws
        The run, and the draws of parameters and hyper-parameters.
    """
    if sampler == "independent":
        try:
            return _sample_independently(start, rule=rule, seed=seed, progress=progress)
        except TooRoughError:
            # Rejection sampling failed, because its proposal density differs too much from the
            # posterior. Parameters and hyper-parameters are drawn by emcee instead.
            pass
    return _sample_jointly(start, rule=rule, seed=seed, progress=progress, **ensembles)


def _sample_independently(
    start: HyperPosterior,
    *,
    rule: StoppingRule,
    seed: np.random.SeedSequence,
    progress: Callable[[Progress], None] | None,
) -> SampledDraws:
    """Return independent posterior draws; draws are added until the stopping rule is met.

    Parameters and hyper-parameters are drawn from the posterior density ``start``, in four chains.
    The stopping rule ``rule`` sets a minimum for the effective sample size and a maximum for R-hat.
    A chain never has more draws than ``max_steps`` of ``rule``, whether or not the rule is met.
    ``seed`` is the seed of the random numbers; ``progress`` is called whenever the rule is checked.
    """
    rng = np.random.default_rng(seed)
    block = int(np.ceil(_SURPLUS * rule.ess / CHAINS + _SURPLUS_DRAWS))
    block = min(block, rule.max_steps)
    accepted = 0
    proposed = 0
    free_blocks = []
    beta_blocks = []
    log_posterior_blocks = []
    while True:
        draws = draw_jointly(start, CHAINS * block, rng)
        accepted += draws.accepted
        proposed += draws.proposed
        free_blocks.append(draws.free.reshape(CHAINS, block, -1))
        beta_blocks.append(draws.beta.reshape(CHAINS, block, -1))
        log_posterior_blocks.append(draws.log_posterior.reshape(CHAINS, block))
        free = np.concatenate(free_blocks, axis=1)
        beta = np.concatenate(beta_blocks, axis=1)
        assessment = assess(np.concatenate([beta, free], axis=2))
        steps = free.shape[1]
        converged = assessment.meets(rule, walkers=0)
        if progress is not None:
            progress(Progress(steps, steps, rule.ess, assessment))
        block = _further_steps(steps, assessment.share(rule, walkers=0))
        if converged or steps + block > rule.max_steps:
            run = EnsembleRun(
                chain=free,
                assessment=assessment,
                converged=converged,
                steps=steps,
                walkers=1,
                acceptance=accepted / proposed,
            )
            log_posterior = np.concatenate(log_posterior_blocks, axis=1)
            return SampledDraws(run, beta, start.bound.hyper_prior.phi(free), log_posterior)


def _further_steps(steps: int, reached: float) -> int:
    """Return the number of independent draws to add to a chain, at most as many as it has.

    ``steps`` is the number of draws of the chain, and ``reached`` the effective sample size reached
    as a fraction of the one required. The number of draws is doubled if enough is reached and only
    R-hat is too large, or if the fraction is not a number.
    """
    if not 0.0 < reached < 1.0:
        return steps
    factor = min(_REACHED_AT_LEAST / reached, 2.0)
    return int(np.ceil((factor - 1.0) * steps))


def _sample_jointly(
    start: HyperPosterior,
    *,
    rule: StoppingRule,
    seed: np.random.SeedSequence,
    progress: Callable[[Progress], None] | None = None,
    ensembles: int = CHAINS,
    walkers: int | None = None,
) -> SampledDraws:
    """Return a run of emcee over parameters and hyper-parameters, and its posterior draws.

    The walkers start from random points. Their hyper-parameters (such as the standard deviation of
    the noise) are drawn from a density a little wider than the posterior ``start``; their
    parameters are drawn given these hyper-parameters. ``ensembles`` is the number of ensembles of
    walkers, and ``walkers`` the number of walkers of each ensemble. By default there are four times
    as many walkers as coordinates (parameters and hyper-parameters), but at least 128. ``rule``
    decides when the run stops, ``seed`` is the seed of the random numbers, and ``progress`` is
    called at every assessment of convergence.
    """
    density = JointDensity(start.bound)
    d = len(start.bound.names) + len(start.bound.hyper_prior.names)
    count = walkers or max(_WALKERS, 4 * d)
    require(
        ensembles >= CHAINS,
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
    """Return ``size`` posterior draws that are independent, or nearly so.

    Parameters and hyper-parameters are drawn from the posterior density ``start``. If ``sampler``
    is "joint", the draws are thinned from a run of emcee with an effective sample size four times
    as large as the number of draws. If ``sampler`` is "independent", the draws come from rejection
    sampling and are independent; if the importance weights of the rejection sampler cannot be
    trusted, emcee is used instead. ``seed`` is the seed of the random numbers. Raise an
    `InputError` if emcee does not converge.
    """
    if sampler == "independent":
        try:
            draws = draw_jointly(start, size, np.random.default_rng(seed))
        except TooRoughError:
            pass
        else:
            phi = start.bound.hyper_prior.phi(draws.free)
            return IndependentDraws(draws.beta, phi, by_emcee=False)
    rule = StoppingRule(
        ess=_THINNING * size, rhat=_RHAT_WHEN_THINNED, lengths=_LENGTHS_WHEN_THINNED
    )
    sampled = _sample_jointly(start, rule=rule, seed=seed)
    run = sampled.run
    require(
        run.converged,
        f"emcee must converge, got R-hat {run.assessment.rhat_max:.3f} after {run.steps} steps. Use"
        " --seed.",
    )
    thinned_beta, thinned_phi = pool_draws(sampled.beta, sampled.phi, size)
    return IndependentDraws(thinned_beta, thinned_phi, by_emcee=True)
