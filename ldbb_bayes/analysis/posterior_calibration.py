"""Simulation-based calibration for machines like the measured one, with enlarged campaigns.

Calibration over the prior (`calibrate`) tests the computation of the posterior for all machines
that the prior allows. Here the computation is tested for machines like the one that was measured
(Säilynoja, Schmitt, Bürkner and Vehtari, Posterior SBC, 2025). With y the measured readings and θ
all unknowns, the steps are:

1. A true θ' is drawn from the posterior p(θ | y).
2. Readings y' of a repetition of the same tests are simulated from θ'.
3. The posterior p(θ | y, y'), given both the measured and the simulated readings, is computed. If
   this posterior is computed correctly, θ' is also a draw from this posterior, and the ranks of θ'
   among other draws from this posterior are uniformly distributed.

Bar, balls, mount and force device are the same in the measured and the simulated campaign. For the
simulated campaign, new values are drawn for the shifts between set-ups, the discrepancy between
model and readings, the random error of the force and the white noise. All effects are linearised at
the estimate Ĉ of the compliances from the measured campaign, as in the posterior p(θ | y).
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
import xarray as xr

from ldbb_bayes.analysis.calibration import (
    Ranks,
    Validation,
    check_numbers_of_replicates,
    rank_replicates,
)
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.campaign.run_times import with_listed_times
from ldbb_bayes.errors import InputError, check_probability, check_seed, require
from ldbb_bayes.inference.coefficients import ModelDraws
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.inference.posterior import bound_of, draws_of, record_of
from ldbb_bayes.inference.prediction import new_circles
from ldbb_bayes.inference.sample import draw
from ldbb_bayes.model.hybrid import BoundModel, HybridModel
from ldbb_bayes.model.terms import CircleScale
from ldbb_bayes.results import Array

__all__ = ["calibrate_posterior"]

_SAMPLER = "independent"


def calibrate_posterior(
    posterior: xr.DataTree,
    *,
    replicates: int = 50,
    draws: int = 99,
    prob: float = 0.99,
    seed: int = 1,
    executor: Executor | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Validation:
    """Return the ranks of true values among posterior draws of simulated, enlarged campaigns.

    In every replicate, true values of the parameters and of the hyper-parameters (such as the
    standard deviation of the noise) are drawn from the posterior. A repetition of the tests is
    simulated from the true values, and the posterior given the measured and the simulated readings
    together is computed. The rank of a true value is the number of draws from this new posterior
    that are below the true value. If the new posterior is computed correctly, the ranks are
    uniformly distributed (posterior SBC, Säilynoja et al. 2025).

    Parameters
    ----------
    posterior : DataTree
        Posterior of one model from `sample` or `load`.
    replicates : int
        Number of simulated campaigns, at least 10.
    draws : int
        Number of independent posterior draws of each enlarged campaign, at least 9.
    prob : float
        Probability that all empirical distributions of ranks stay between the limits
        ``Validation.band`` if the posterior is computed correctly.
    seed : int
        Seed of all random numbers.
    executor : Executor, optional
        Executor of ``concurrent.futures`` that runs the replicates in parallel. Default: this
        process runs them one after the other. The result does not depend on the executor.
    progress : callable, optional
        Function called with the number of replicates done and the number of all replicates.

    Returns
    -------
    Validation
        Ranks of all parameters and hyper-parameters, and whether they are uniformly distributed.

    Raises
    ------
    InputError
        For an average over models, a flat prior, numbers out of range, or if no replicate gives
        draws.

    Examples
    --------
    >>> validation = lb.analysis.calibrate_posterior(posterior, replicates=10, draws=9)
    >>> validation.calibrated
    True
    """
    require(
        "averaged" not in record_of(posterior),
        "the posterior must be of one model, got an average. Fit each model.",
    )
    bound = bound_of(posterior)
    require(
        not bound.model.prior.flat,
        "the prior must be proper, got a flat one. Fit with the default preset.",
    )
    check_numbers_of_replicates(replicates, draws)
    check_probability(prob)
    check_seed(seed)
    beta, phi = draws_of(posterior, bound, replicates)
    require(
        len(beta) == replicates,
        f"the posterior must have at least {replicates} draws, one for each replicate, got"
        f" {len(beta)}. Ask for fewer replicates.",
    )
    study = _EnlargedCampaigns(bound.model, bound.campaign, beta, phi, draws)
    return rank_replicates(
        partial(_rank_replicate, study),
        (*bound.names, *bound.hyper_prior.names),
        replicates=replicates,
        draws=draws,
        sampler=_SAMPLER,
        prob=prob,
        seed=seed,
        executor=executor,
        progress=progress,
    )


class _EnlargedCampaigns(NamedTuple):
    """Settings that all replicates share.

    A replicate is a copy of the measured campaign, enlarged by simulated readings. ``campaign`` is
    the measured campaign. ``beta``, shape (replicates, p), holds posterior draws of the p
    parameters, and ``phi``, shape (replicates, h), posterior draws of the h hyper-parameters. The
    draws in one row of ``beta`` and ``phi`` are the true values of one replicate, from which its
    readings are simulated. ``draws`` is the number of draws from the posterior of the enlarged
    campaign, among which the true values are then ranked.
    """

    model: HybridModel
    campaign: Campaign
    beta: Array
    phi: Array
    draws: int


def _rank_replicate(study: _EnlargedCampaigns, seed: np.random.SeedSequence) -> Ranks | str:
    """Return the ranks of the true values in one replicate (simulated campaign).

    The true values are one posterior draw of the measured campaign. Readings are simulated from
    these values, and the campaign is enlarged by the simulated readings. The true values are then
    ranked among posterior draws of the enlarged campaign. ``seed`` is the seed of the random
    numbers; its last spawn key is the index of the replicate. Return an error message if no
    posterior draws can be made.
    """
    i = seed.spawn_key[-1]
    simulation_seed, sampling_seed = seed.spawn(2)
    measured = with_listed_times(study.campaign)
    model = study.model
    if CircleScale.__name__ not in BoundModel(model, measured).terms:
        # Too few circles were measured for noise factors of circles. The enlarged campaign is
        # simulated and analysed by the same model, although it has circles enough.
        model = model.without(CircleScale.key())
    truth = ModelDraws(BoundModel(model, measured), study.phi[i : i + 1], study.beta[i : i + 1])
    enlarged = _enlarge(measured, truth, np.random.default_rng(simulation_seed))
    bound = BoundModel(model, enlarged, pilot=measured)
    start = HyperPosterior(bound, truncated=bound.truncation.active)
    try:
        beta, phi, by_emcee = draw(_SAMPLER, start, study.draws, seed=sampling_seed)
    except InputError as error:
        return str(error)
    names = truth.bound.hyper_prior.names
    shared = [bound.hyper_prior.names.index(name) for name in names]
    drawn = np.hstack([beta, phi[:, shared]])
    true_values = np.concatenate([truth.beta[0], truth.phi[0]])
    return Ranks(ranks=(drawn < true_values).sum(axis=0), by_emcee=by_emcee)


def _enlarge(campaign: Campaign, truth: ModelDraws, rng: np.random.Generator) -> Campaign:
    """Return a campaign enlarged by a simulated repetition of its tests.

    ``truth`` is one draw of the model's parameters and hyper-parameters. The repetition is
    simulated with these values as the true values.
    """
    plan = campaign.plan()
    tests = list(campaign.tests)
    # The readings must be simulated by the same model that analyses them. Each circle has a factor
    # by which its noise is larger or smaller than average. The factors of the simulated circles are
    # therefore drawn from the model's prior, and not taken from the measured circles.
    circles = new_circles(truth, plan, rng, learn_spread=False)
    for test, readings_mm in zip(plan.tests, circles, strict=True):
        simulated = test.with_reading_um(readings_mm[0] * 1e3)
        tests.append(replace(simulated, name=f"{test.name} simulated"))
    return replace(campaign, tests=tuple(tests))
