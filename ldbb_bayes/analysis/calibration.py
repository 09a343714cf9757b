"""Simulation-based calibration: ranks of true values among posterior draws.

In every replicate, true values of the parameters and hyper-parameters (such as the standard
deviation of the noise) are drawn at random from their priors. Readings are simulated from these
true values, and posterior draws are computed from the readings. The rank of a true value is the
number of posterior draws of the same quantity that are below the true value. If the posterior is
computed correctly, the ranks of many replicates are uniformly distributed (Talts et al. 2018).
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from pydantic import model_serializer

from ldbb_bayes.analysis.rank_uniformity import ecdf, simultaneous_band
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.errors import InputError, check_probability, check_seed, require, require_whole
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.inference.sample import check_sampler, draw
from ldbb_bayes.model.hybrid import BoundModel, HybridModel, require_model
from ldbb_bayes.model.hyper_prior import HyperPrior
from ldbb_bayes.parallel import Lost, done
from ldbb_bayes.results import Array, Numbers, Result, readable

__all__ = [
    "LOG_LIKELIHOOD",
    "Ranks",
    "Validation",
    "calibrate",
    "check_numbers_of_replicates",
    "rank_replicates",
]

# Name of the log likelihood in `Validation.names`. Ranks are computed not only for the parameters
# and hyper-parameters, but also for the log likelihood. The true value of the log likelihood is its
# value at the true parameters and hyper-parameters.
LOG_LIKELIHOOD = "log_likelihood"
# Probabilities of the credible intervals whose coverage (share of true values inside) is reported.
_INTERVALS = (0.5, 0.8, 0.95)
# Smallest number of replicates (simulated campaigns) that a caller may ask for.
_FEWEST_REPLICATES = 10
# Smallest number of posterior draws of each replicate that a caller may ask for.
_FEWEST_DRAWS = 9


@dataclass(frozen=True, eq=False)
class Validation(Result):
    """Ranks of true values among posterior draws, from simulation-based calibration.

    Examples
    --------
    >>> plan = campaign.plan()
    >>> validation = lb.calibrate(lb.HybridModel.first(0), plan, replicates=10, draws=9)
    >>> validation.ranks.shape, len(validation.names)
    ((10, 18), 18)
    >>> validation.coverage().columns.to_list()
    ['50', 'u50', '80', 'u80', '95', 'u95']
    """

    #: names of the quantities whose true values are ranked among posterior draws: the parameters
    #: and hyper-parameters of the model, and ``log_likelihood``
    names: tuple[str, ...]
    #: number of posterior draws below each true value, 0 … ``draws``, shape (replicates,
    #: quantities). A replicate is a simulated campaign. The ranks are uniformly distributed if the
    #: posterior is calibrated.
    ranks: Numbers
    draws: int  #: number of posterior draws in each replicate (simulated campaign)
    sampler: str  #: method of drawing from the posterior: ``joint`` or ``independent``
    #: probability that the empirical distributions of the ranks of all quantities stay between
    #: their limits (``band``), if the posterior is calibrated. A rank is the number of posterior
    #: draws below a true value.
    prob: float
    #: error messages for replicates (simulated campaigns) whose posterior could not be sampled;
    #: these replicates have no ranks
    failures: tuple[str, ...]
    #: indices (from 0) of the rows of ``ranks`` for which the posterior was sampled with emcee,
    #: because the importance weights of independent draws were not reliable
    by_emcee: tuple[int, ...] = ()

    @property
    def replicates(self) -> int:
        """Number of simulated campaigns (replicates) for which ranks of true values exist."""
        return len(self.ranks)

    @cached_property
    def band(self) -> tuple[Array, Array]:
        """Lower and upper limit of the empirical distribution of ranks, shape (draws,) each.

        The rank of a quantity is the number of posterior draws below its true value in a simulated
        campaign. The limits apply to the empirical distribution that `ecdf` returns, and are the
        same for every quantity. If the posterior is calibrated, the empirical distributions of all
        quantities stay between the limits with probability ``prob``.
        """
        prob_of_one = self.prob ** (1.0 / len(self.names))
        return simultaneous_band(self.replicates, self.draws, prob_of_one)

    @property
    def pit(self) -> xr.DataTree:
        """The scaled ranks, in the form that the function ``plot_ecdf_pit`` of ArviZ needs.

        A rank is the number of posterior draws below the true value in a replicate (simulated
        campaign). The scaled rank is (rank + ½) / (draws + 1), where ``draws`` is the number of
        posterior draws in each replicate. The scaled ranks are in the group ``prior_sbc`` of the
        result, where the dimension ``draw`` runs over the replicates.
        """
        shares = (self.ranks + 0.5) / (self.draws + 1.0)
        data = {
            name: (("chain", "draw"), shares[None, :, index])
            for index, name in enumerate(self.names)
        }
        coordinates = {"chain": [0], "draw": np.arange(self.replicates)}
        return xr.DataTree.from_dict({"prior_sbc": xr.Dataset(data, coordinates)})

    def ecdf(self, name: str) -> Array:
        """Return the empirical distribution of one quantity's ranks, shape (draws,).

        Parameters
        ----------
        name
            Name of the quantity.

        Returns
        -------
        Array
            Share of replicates (simulated campaigns) whose rank is at most k, for k from 0 to
            draws − 1. The rank is the number of posterior draws below the true value, and ``draws``
            the number of posterior draws in each replicate.
        """
        return ecdf(self.ranks[:, self.names.index(name)], self.draws)

    @cached_property
    def outside(self) -> tuple[str, ...]:
        """Names of the quantities whose ranks are not uniformly distributed.

        The rank of a quantity is the number of posterior draws below its true value in a simulated
        campaign. A quantity is named if the empirical distribution of its ranks leaves the limits
        ``band`` anywhere. If the ranks of all quantities are uniformly distributed, the probability
        that no quantity is named is ``prob``.
        """
        lower, upper = self.band
        outside = []
        for name in self.names:
            shares = self.ecdf(name)
            if np.any((shares < lower) | (shares > upper)):
                outside.append(name)
        return tuple(outside)

    @property
    def calibrated(self) -> bool:
        """Whether the ranks agree with a correctly computed posterior.

        The result is true if no replicate (simulated campaign) failed, and if the empirical
        distributions of the ranks of all quantities stay between the limits ``band``. A rank is the
        number of posterior draws below the true value.
        """
        return not self.outside and not self.failures

    def coverage(self) -> pd.DataFrame:
        """Return the share of true values that lie inside their equal-tailed credible intervals.

        Returns
        -------
        pandas.DataFrame
            One row per quantity. The columns 50, 80 and 95 hold the shares; the name of a column is
            the nominal probability of the interval in percent. Columns u50, u80 and u95 hold the
            binomial standard errors of these shares for a calibrated posterior.
        """
        distance = np.abs(2 * self.ranks - self.draws)
        table = pd.DataFrame(index=list(self.names))
        for prob in _INTERVALS:
            limit = prob * (self.draws + 1)
            # A true value that coincides with an end of the credible interval counts as half
            # inside.
            inside = 0.5 * (distance < limit - 1e-9) + 0.5 * (distance < limit + 1e-9)
            table[_percent(prob)] = inside.mean(axis=0)
            table[f"u{_percent(prob)}"] = np.sqrt(prob * (1.0 - prob) / self.replicates)
        return readable(table, "Share of true values inside their intervals")

    @model_serializer
    def _record_without_ranks(self) -> dict[str, Any]:
        """Return the results of a simulation-based calibration as a dictionary for a JSON file.

        The dictionary does not contain the ranks, but it states the coverage of each quantity: the
        share of true values that lie inside their credible intervals. It also states for each
        quantity whether its ranks stay between the limits ``band``.
        """
        columns = [_percent(prob) for prob in _INTERVALS]
        coverage = self.coverage()[columns].to_dict(orient="index")
        quantities = {}
        for name in self.names:
            inside_band = name not in self.outside
            quantities[name] = {"inside_band": inside_band, "coverage": coverage[name]}
        return {
            "sampler": self.sampler,
            "replicates": self.replicates,
            "draws": self.draws,
            "band_probability": self.prob,
            "quantities": quantities,
            "failures": list(self.failures),
            "by_emcee": list(self.by_emcee),
            "calibrated": self.calibrated,
        }


def _percent(prob: float) -> str:
    """Return a probability in percent as text without the percent sign, such as "95" for 0.95."""
    return f"{100 * prob:g}"


def calibrate(
    model: HybridModel,
    plan: Campaign,
    *,
    replicates: int = 100,
    draws: int = 99,
    sampler: str = "independent",
    generator: HybridModel | None = None,
    prob: float = 0.99,
    seed: int = 1,
    executor: Executor | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Validation:
    """Return the ranks of true values among posterior draws of simulated campaigns.

    In every replicate, true parameters and hyper-parameters (such as the standard deviation of the
    noise) are drawn from their priors, readings are simulated, and posterior draws are computed.
    The rank of a true value is the number of posterior draws that are below the true value. If the
    posterior is computed correctly, the ranks are uniformly distributed (Talts et al. 2018).

    Parameters
    ----------
    model : HybridModel
        Model whose posterior is validated. Its priors must be proper.
    plan : Campaign
        Campaign whose tests are simulated, with the forces, angles and other settings that it
        states. The readings of this campaign are ignored.
    replicates : int
        Number of simulated campaigns, at least 10.
    draws : int
        Number of independent posterior draws of each campaign, at least 9.
    sampler : {"independent", "joint"}
        Method of drawing from the posterior, as in `sample`.
    generator : HybridModel, optional
        Model that simulates the readings. Default: ``model``. With a different model, the result
        shows the effect of an analysis with a wrong model. Its reference force must be that of
        ``model``, because true compliances at one force are no truth at another.
    prob : float
        Probability that the empirical distributions of the ranks of all quantities stay between
        their limits, ``Validation.band``, if the posterior is calibrated.
    seed : int
        Seed of all random numbers.
    executor : Executor, optional
        Executor of ``concurrent.futures`` that runs the replicates in parallel, with one BLAS
        thread for each replicate. Default: this process runs them one after the other. The result
        does not depend on the executor.
    progress : callable, optional
        Function that is called with the number of replicates done and the number of all replicates.

    Returns
    -------
    Validation
        Ranks, and whether they are uniformly distributed. ``failures`` holds an error message for
        each replicate without posterior draws.

    Raises
    ------
    InputError
        For a flat prior, an unknown sampler, numbers out of range, two models of different
        reference forces, or a plan to which the model cannot be fitted. Also if no replicate gives
        draws.

    Examples
    --------
    >>> plan = campaign.plan()
    >>> validation = lb.calibrate(lb.HybridModel.first(0), plan, replicates=10, draws=9)
    >>> validation.calibrated, validation.outside
    (True, ())
    """
    check_sampler(sampler)
    require_model(model)
    if generator is None:
        generator = model
    require(
        not (model.prior.flat or generator.prior.flat),
        "validation must start from proper priors, got flat ones: nothing can be drawn. Use the"
        " default preset.",
    )
    check_numbers_of_replicates(replicates, draws)
    check_probability(prob)
    check_seed(seed)
    bound = model.bind(plan)
    _check_reference_force(bound, generator.bind(plan))
    rank_replicate = partial(_rank_replicate, _Study(model, generator, plan, sampler, draws))
    return rank_replicates(
        rank_replicate,
        (*bound.names, *bound.hyper_prior.names, LOG_LIKELIHOOD),
        replicates=replicates,
        draws=draws,
        sampler=sampler,
        prob=prob,
        seed=seed,
        executor=executor,
        progress=progress,
    )


def _check_reference_force(model: BoundModel, generator: BoundModel) -> None:
    """Raise an `InputError` if two models state compliances at different reference forces.

    ``generator`` is the model that simulates readings, ``model`` the one that is fitted to them. A
    true compliance at one force cannot be ranked among draws of the compliance at another force.
    """
    force_N = model.setting.reference_force_N
    of_generator_N = generator.setting.reference_force_N
    require(
        force_N == of_generator_N,
        "the model that simulates must have the reference force of the model that is validated,"
        f" {force_N:g} N, got {of_generator_N:g} N. Give both the same reference_force_N.",
    )


def rank_replicates(
    rank_replicate: Callable[[np.random.SeedSequence], Ranks | str],
    names: tuple[str, ...],
    *,
    replicates: int,
    draws: int,
    sampler: str,
    prob: float,
    seed: int,
    executor: Executor | None,
    progress: Callable[[int, int], None] | None,
) -> Validation:
    """Return the ranks of true values among posterior draws, for many simulated campaigns.

    The function ``rank_replicate`` takes the seed of one campaign and returns the ranks of the
    quantities ``names`` (parameters, hyper-parameters and the log likelihood). If there are no
    ranks, it returns the reason as a string. The other arguments are the same as in `calibrate`.
    """
    outcomes: dict[int, Ranks | str] = {}
    seeds = np.random.SeedSequence(seed).spawn(replicates)
    for i, outcome in done(rank_replicate, seeds, executor):
        outcomes[i] = outcome.reason if isinstance(outcome, Lost) else outcome
        if progress is not None:
            progress(len(outcomes), replicates)
    ranks: list[Array] = []
    by_emcee: list[int] = []
    failures: list[str] = []
    for _, outcome in sorted(outcomes.items()):
        if isinstance(outcome, str):
            failures.append(outcome)
            continue
        if outcome.by_emcee:
            by_emcee.append(len(ranks))
        ranks.append(outcome.ranks)
    if not ranks:
        raise InputError(
            f"at least one replicate must give draws, got none. First reason: {failures[0]}"
        )
    return Validation(
        names=names,
        ranks=np.array(ranks),
        draws=draws,
        sampler=sampler,
        prob=prob,
        failures=tuple(failures),
        by_emcee=tuple(by_emcee),
    )


def check_numbers_of_replicates(replicates: int, draws: int) -> None:
    """Raise an `InputError` unless ``replicates`` and ``draws`` are whole and large enough.

    ``replicates`` is the number of simulated campaigns, and ``draws`` the number of posterior draws
    of each campaign.
    """
    limits = (("replicates", replicates, _FEWEST_REPLICATES), ("draws", draws, _FEWEST_DRAWS))
    for name, number, least in limits:
        require_whole(name, number)
        require(number >= least, f"{name} must be at least {least}, got {number}. Ask for more.")


class _Study(NamedTuple):
    """Settings of a simulation-based calibration that all replicates have in common.

    ``generator`` is the model with which readings are simulated for the tests of ``plan``.
    ``model`` is the model whose posterior is computed. ``sampler`` is the method of drawing from
    the posterior, and ``draws`` the number of posterior draws in each replicate.
    """

    model: HybridModel
    generator: HybridModel
    plan: Campaign
    sampler: str
    draws: int


class Ranks(NamedTuple):
    """Ranks of the true values among the posterior draws of one simulated campaign."""

    #: number of posterior draws below the true value of each parameter and hyper-parameter, and of
    #: the log likelihood, shape (quantities,)
    ranks: Array
    by_emcee: bool  #: whether the posterior draws of a simulated campaign come from emcee


def _rank_replicate(study: _Study, seed: np.random.SeedSequence) -> Ranks | str:
    """Return the ranks of true values among the posterior draws of one simulated campaign.

    A rank is the number of posterior draws below the true value. ``study`` holds the settings of
    the calibration. ``seed`` is the seed of all random numbers: those of the simulation and those
    of the posterior draws. Return an error message if no posterior draws can be made.
    """
    simulation_seed, sampling_seed = seed.spawn(2)
    simulation = study.generator.simulate(
        study.plan, seed=int(simulation_seed.generate_state(1)[0])
    )
    bound = study.model.bind(simulation.campaign)
    start = HyperPosterior(bound, truncated=bound.truncation.active)
    try:
        beta, phi, by_emcee = draw(study.sampler, start, study.draws, seed=sampling_seed)
    except InputError as error:
        return str(error)
    hyper_prior = bound.hyper_prior
    true_by_name = dict(simulation.parameters) | _values_without_effect(hyper_prior)
    for name, um_per_unit in zip(hyper_prior.names, hyper_prior.display_factors, strict=True):
        if name in simulation.hyper_um:
            true_by_name[name] = simulation.hyper_um[name] / float(um_per_unit)
    names = (*bound.names, *hyper_prior.names)
    truth = np.array([true_by_name.get(name, 0.0) for name in names])
    ranks = (np.hstack([beta, phi]) < truth).sum(axis=0)
    p = len(bound.names)
    true_log_likelihood = bound.log_likelihood(truth[None, p:], truth[None, :p])[0]
    log_likelihood_rank = (bound.log_likelihood(phi, beta) < true_log_likelihood).sum()
    return Ranks(
        ranks=np.append(ranks, log_likelihood_rank),
        by_emcee=by_emcee and study.sampler == "independent",
    )


def _values_without_effect(hyper_prior: HyperPrior) -> dict[str, float]:
    """Return the values of hyper-parameters that a generator without them implies, by name.

    The size of an effect that the generator lacks is zero. A factor that multiplies the noise of a
    circle is one. The decay of form errors with their order has no effect without form errors; the
    result has its prior median.
    """
    medians = hyper_prior.quantile(np.full(len(hyper_prior.names), 0.5))
    values = {}
    for name, law, median in zip(hyper_prior.names, hyper_prior.laws, medians, strict=True):
        if law == "circle":
            values[name] = 1.0
        elif law == "decay":
            values[name] = float(median)
        else:
            values[name] = 0.0
    return values
