"""Posterior averaged over several models.

The averaged posterior is p(β, φ | y) = Σ_M p(M | y) p(β, φ | y, M): the posterior under each model
M, weighted by the posterior probability of the model given the readings y. β are the parameters
(compliances, their slopes and geometric errors), φ the hyper-parameters (such as the standard
deviation of the noise). The models differ in two respects: whether compliance changes with force
(the change is called a slope), and which alternative explanations the model includes. Alternative
explanations are other effects that change the readings in a similar way to slopes.

Every model is combined with every subset of its alternative explanations, and all these
combinations have the same prior probability. A parameter that a model does not have is zero in the
draws of that model. The share of zeros among all draws of a parameter is therefore the probability
that the parameter is zero (Hoeting, Madigan, Raftery and Volinsky 1999).
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.special import expit, logit

from ldbb_bayes.analysis.comparison_plan import largest_model
from ldbb_bayes.analysis.rival_explanations import subsets
from ldbb_bayes.campaign.campaign import Campaign, require_campaign
from ldbb_bayes.errors import InputError, require
from ldbb_bayes.inference.coefficients import ModelDraws
from ldbb_bayes.inference.evidence import log_prob_truncation, probabilities, require_models
from ldbb_bayes.inference.evidences import Evidences
from ldbb_bayes.inference.fit import Concern, ConcernKind
from ldbb_bayes.inference.fit_assessment import assess_fit
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.inference.mcmc import StoppingRule, assess
from ldbb_bayes.inference.nodes import Nodes
from ldbb_bayes.inference.posterior import build_tree
from ldbb_bayes.inference.record import densities_of, groups_of, prior_draws_of, record_from
from ldbb_bayes.inference.sample import CHAINS
from ldbb_bayes.inference.truncation_factor import ProbabilityInside
from ldbb_bayes.model.hybrid import BoundModel, HybridModel
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["average"]

# Smallest number of draws from the averaged posterior that a caller may ask for.
_FEWEST_DRAWS = 400
# Models whose posterior probability is below this number are ignored when the largest error of the
# log evidences is determined.
_NEGLIGIBLE_PROBABILITY = 1e-3
# Largest error of a model's posterior probability at which the average can be trusted. An error of
# 0.1 nat in the log evidence of one of two equally probable models changes their probabilities by
# this number.
_LARGEST_ERROR = 0.025


class _Combination(NamedTuple):
    """One of the models over which a posterior is averaged, with its alternative explanations.

    ``name`` is the name of the model, and ``rivals`` are the names of the alternative explanations
    that the model includes. These are effects, such as a nonlinear mount, that influence the
    readings in a similar way to a compliance that changes with force.
    """

    name: str
    rivals: tuple[str, ...]


@dataclass(frozen=True)
class _WeightedModels:
    """The models of an average with their posterior probabilities.

    ``combinations`` describes each model by its name and by the alternative explanations that it
    includes. ``nodes`` has an entry for each model: weighted values of the hyper-parameters that
    represent the posterior under the model. ``probability``, shape (models,), sums to one.
    ``bound`` is the largest model, the one with the most parameters, applied to the campaign.
    """

    combinations: tuple[_Combination, ...]
    nodes: tuple[Nodes, ...]
    probability: Array
    bound: BoundModel

    @property
    def bounds(self) -> list[BoundModel]:
        """Return the models of a model average, each applied to the campaign."""
        return [nodes.bound for nodes in self.nodes]

    @property
    def log_evidence_error(self) -> float:
        """Return the largest numerical error of the averaged models' log evidences [nat].

        Models with a posterior probability below 0.001 are ignored.
        """
        return float(self._errors[self.probability > _NEGLIGIBLE_PROBABILITY].max())

    @property
    def probability_error(self) -> float:
        """Return the largest change of a model's posterior probability by its numerical error.

        If the log evidence of a model changes by e, its odds p / (1 − p) are multiplied by exp(e).
        A model that is nearly certain, or nearly excluded, needs no exact evidence.
        """
        odds = logit(self.probability)
        above = expit(odds + self._errors)
        below = expit(odds - self._errors)
        return float(np.maximum(above - self.probability, self.probability - below).max())

    @property
    def _errors(self) -> Array:
        """Numerical errors of the log evidences [nat], shape (models,)."""
        return np.array([nodes.evidence.error for nodes in self.nodes])


@one_blas_thread
def average(
    models: Mapping[str, HybridModel],
    campaign: Campaign,
    *,
    seed: int = 1,
    draws: int = 4000,
    evidences: Evidences | None = None,
) -> xr.DataTree:
    """Return the posterior averaged over models (Bayesian model averaging).

    The average is p(β, φ | y) = Σ_M p(M | y) p(β, φ | y, M): the posterior of the parameters β and
    hyper-parameters φ under each model M, weighted by the probability of the model given the
    readings y. Some effects, such as a nonlinear mount, influence the readings in a similar way to
    a compliance that changes with force. They are called alternative explanations. The average
    includes each of the ``models`` with every subset of its alternative explanations; all these
    models have the same prior probability.

    Parameters
    ----------
    models : mapping of str to HybridModel
        Models by name, for example constant and linear compliance. Each model must equal the
        largest model, except that some parameters may be fixed at zero.
    campaign : Campaign
        Campaign with readings.
    seed : int
        Seed of the random draws.
    draws : int
        Number of draws in all four chains together, at least 400; it is rounded down to a multiple
        of four. The share of each model in the draws equals the probability of the model.
    evidences : Evidences, optional
        Evidences that are already known, for example because `compare` was called with the same
        object. They are not computed again.

    Returns
    -------
    DataTree
        Posterior as returned by `sample`, with the parameters of the largest model. A parameter
        that a model does not have is zero in the draws of this model. The posterior also stores a
        record (a dictionary). Its entry ``averaged`` lists the models with their alternative
        explanations, log evidences and probabilities. ``sample_stats.model`` holds, for each draw,
        the index of the draw's model in this list (counted from 0). The prior draws come from all
        models in equal numbers.

    Raises
    ------
    InputError
        If no models are given, or if a model differs from the largest model by more than parameters
        fixed at zero. The error is also raised for a plan (a campaign without readings), a flat
        prior, too few draws, or evidences of another campaign.

    Examples
    --------
    >>> linear = lb.HybridModel.first(1)
    >>> models = {"constant": linear.with_degree(0), "linear": linear}
    >>> averaged = lb.average(models, campaign, draws=400)
    >>> slope = averaged["posterior"]["C_XXX_1"]
    >>> round(float((slope == 0.0).mean()), 1)  # probability that compliance is constant
    1.0
    """
    started = datetime.now(UTC)
    clock = time.perf_counter()
    require_campaign(campaign)
    _check_arguments(models, draws)
    evidences = evidences or Evidences(campaign)
    evidences.check_campaign(campaign)
    weighted = _weigh_models(models, evidences)
    bound = weighted.bound
    seeds = np.random.SeedSequence(seed).spawn(3)
    posterior_rng, prior_rng, check_rng = (np.random.default_rng(child) for child in seeds)

    draws_per_chain = draws // CHAINS
    model_of_draw, posterior_draws = _draw_posteriors(
        weighted, CHAINS * draws_per_chain, posterior_rng
    )
    prior_draws = _draw_priors(weighted, draws, prior_rng)
    order = posterior_rng.permutation(len(model_of_draw)).reshape(CHAINS, draws_per_chain)
    beta, phi = _join_draws_of_models(bound, posterior_draws)
    groups = groups_of(
        bound,
        beta[order],
        phi[order],
        _join_draws_of_models(bound, prior_draws),
        _log_densities(posterior_draws, order),
    )
    groups["sample_stats"]["model"] = model_of_draw[order]

    concerns = []
    if not weighted.probability_error <= _LARGEST_ERROR:
        concerns.append(Concern(ConcernKind.NOT_CONVERGED, draws_per_chain, draws))
    fit = assess_fit(
        bound,
        posterior_draws,
        groups,
        _truncation_of_most_probable(weighted),
        concerns,
        check_rng,
        _mean_log_priors(prior_draws)[model_of_draw[order]],
    )
    seconds = time.perf_counter() - clock
    sampler = _describe_sampler(
        beta[order], phi[order], draws, converged=not concerns, seconds=seconds
    )
    record = record_from(bound, sampler, fit, seed, started)
    record["model"] |= _averaged_prior(weighted, record["model"]["prior_sd"])
    record["averaged"] = _describe_models(weighted)
    return build_tree(groups, bound, record)


def _check_arguments(models: Mapping[str, HybridModel], draws: int) -> None:
    """Raise an `InputError` if there are no models to average, or too few draws to return."""
    require_models(models)
    require(
        draws >= _FEWEST_DRAWS,
        f"draws must be at least {_FEWEST_DRAWS}, got {draws}. The default is 4000.",
    )


def _weigh_models(models: Mapping[str, HybridModel], evidences: Evidences) -> _WeightedModels:
    """Return the models of the average with their posterior probabilities.

    Some effects, such as a nonlinear mount, influence the readings in a similar way to a compliance
    that changes with force. They are called alternative explanations (rivals). The average contains
    every given model once with each subset of its rivals. All these models have the same prior
    probability. Evidences that are missing in ``evidences`` are computed. Raise an `InputError` if
    a model is not nested in the largest one.
    """
    combinations = []
    variants = []
    for name, model in models.items():
        for rivals in subsets(model.rivals):
            combinations.append(_Combination(name, rivals))
            variants.append(model.with_rivals(*rivals))
    nodes = evidences.nodes(*variants)
    bound = evidences.nodes(largest_model(models))[0].bound
    for variant_nodes in nodes:
        _check_nested(variant_nodes.bound, bound)
    log_evidence = np.array([variant_nodes.evidence.log_value for variant_nodes in nodes])
    return _WeightedModels(
        combinations=tuple(combinations),
        nodes=tuple(nodes),
        probability=probabilities(log_evidence),
        bound=bound,
    )


def _check_nested(bound: BoundModel, largest: BoundModel) -> None:
    """Raise an `InputError` if a model is not nested in the largest model.

    A model is nested if it differs from the largest one only because some parameters are fixed at
    zero. Three conditions are checked: both models have the same hyper-parameters, all parameters
    of ``bound`` are parameters of ``largest``, and both have the same reference force.
    """
    same_terms = bound.hyper_prior.names == largest.hyper_prior.names
    fewer_parameters = set(bound.names) <= set(largest.names)
    same_force = bound.setting.reference_force_N == largest.setting.reference_force_N
    if not (same_terms and fewer_parameters and same_force):
        raise InputError(
            "models must be nested, which means that each is the largest model with some parameters"
            " fixed at zero, got models with other terms, parameters or reference force. Make one"
            " from the other: linear.with_degree(0)."
        )


def _draw_posteriors(
    weighted: _WeightedModels, size: int, rng: np.random.Generator
) -> tuple[Array, list[ModelDraws]]:
    """Return ``size`` draws from the averaged posterior.

    Each draw comes from one of the models in ``weighted``. The first result, shape (size,), holds
    the index of this model for each draw. The second result holds the draws of each model, in the
    order of the models; a model without draws is left out. The number of draws of a model is
    ``size`` times the probability of the model, rounded up or down.
    """
    cumulative = np.append(0.0, np.cumsum(weighted.probability) / weighted.probability.sum())
    ends = np.floor(cumulative * size + rng.random()).astype(int)
    model_of_draw = np.repeat(np.arange(len(weighted.nodes)), np.diff(ends))
    draws_of_models = []
    for k, count in zip(*np.unique(model_of_draw, return_counts=True), strict=True):
        nodes = weighted.nodes[k]
        beta, phi = nodes.draw(int(count), rng)
        draws_of_models.append(ModelDraws(nodes.bound, phi, beta))
    return model_of_draw, draws_of_models


def _draw_priors(
    weighted: _WeightedModels, draws: int, rng: np.random.Generator
) -> list[ModelDraws]:
    """Return random draws from the prior of each averaged model, the same number for every model.

    ``weighted`` holds the models. ``draws`` is the number of draws from all models together; it is
    rounded up to a multiple of the number of models.
    """
    size = math.ceil(draws / len(weighted.nodes))
    draws_of_models = []
    for bound in weighted.bounds:
        beta, phi = prior_draws_of(bound, size, rng)
        draws_of_models.append(ModelDraws(bound, phi, beta))
    return draws_of_models


def _join_draws_of_models(
    bound: BoundModel, draws_of_models: Sequence[ModelDraws]
) -> tuple[Array, Array]:
    """Return the draws of all models in one array for parameters and one for hyper-parameters.

    The n draws of the p parameters have the shape (n, p), those of the h hyper-parameters the shape
    (n, h). The draws of the first model come first, then those of the next model, and so on. The
    parameters are those of ``bound``, the largest model. A parameter that a model does not have is
    zero in the draws of this model.
    """
    pooled_beta = []
    for draws_of_model in draws_of_models:
        beta = np.zeros((len(draws_of_model.phi), len(bound.names)))
        columns = [bound.names.index(name) for name in draws_of_model.bound.names]
        beta[:, columns] = draws_of_model.beta
        pooled_beta.append(beta)
    pooled_phi = [draws_of_model.phi for draws_of_model in draws_of_models]
    return np.concatenate(pooled_beta), np.concatenate(pooled_phi)


def _log_densities(draws_of_models: Sequence[ModelDraws], order: Array) -> dict[str, Array]:
    """Return a dict with the log densities of the draws from all models.

    Its keys are the names of the densities, such as ``lp`` for the log density of the posterior.
    Each value is an array of shape (chains, draws). ``draws_of_models`` holds the draws of each
    model. These draws are numbered consecutively: first those of the first model, then those of the
    next model, and so on. ``order``, shape (chains, draws), holds the number of the draw for each
    place in the arrays.
    """
    by_model = [densities_of(draws_of_model) for draws_of_model in draws_of_models]
    pooled = {}
    for name in by_model[0]:
        pooled[name] = np.concatenate([densities[name] for densities in by_model])[order]
    return pooled


def _mean_log_priors(prior_draws: Sequence[ModelDraws]) -> Array:
    """Return the expected log prior density of the parameters under each model, shape (models,).

    ``prior_draws`` holds draws from the prior of each model.
    """
    means = []
    for draws_of_model in prior_draws:
        means.append(draws_of_model.bound.parameter_prior.log_density(draws_of_model.beta).mean())
    return np.array(means)


def _describe_sampler(
    beta: Array, phi: Array, target_ess: int, *, converged: bool, seconds: float
) -> dict[str, Any]:
    """Return how the draws were made, to be stored with the posterior.

    ``beta``, shape (chains, draws, p), and ``phi``, shape (chains, draws, h), are the draws of the
    parameters and hyper-parameters, of which ``target_ess`` were asked for. They are independent,
    as if a single walker had accepted every step. ``seconds`` is the time that was needed.
    """
    chains, steps = phi.shape[:2]
    return {
        "kind": "independent",
        "by_emcee": False,
        **asdict(assess(_varying_coordinates(beta, phi))),
        "converged": converged,
        "draws": chains * steps,
        "seconds": seconds,
        "steps": steps,
        "walkers": 1,
        "acceptance": 1.0,
        "target_ess": float(target_ess),
        "target_rhat": StoppingRule().rhat,
    }


def _truncation_of_most_probable(weighted: _WeightedModels) -> ProbabilityInside:
    """Return the log probability that no compliance is negative, and its numerical error [nat].

    It is the probability under the posterior of the most probable model in which compliances may be
    negative.
    """
    most_probable = weighted.bounds[int(np.argmax(weighted.probability))]
    near = weighted.nodes[0].posterior.without_truncation.mode
    return log_prob_truncation(HyperPosterior(most_probable, truncated=True, near=near))


def _varying_coordinates(beta: Array, phi: Array) -> Array:
    """Return the draws of those parameters β and hyper-parameters φ that are not constant.

    A parameter or hyper-parameter is omitted if it has the same value in all draws. ``beta`` holds
    the draws of the p parameters β, shape (chains, draws, p), and ``phi`` those of the h
    hyper-parameters φ, shape (chains, draws, h). The result has the shape (chains, draws, k), where
    k is at most p + h.
    """
    coordinates = np.concatenate([beta, phi], axis=2)
    return coordinates[:, :, np.ptp(coordinates, axis=(0, 1)) > 0.0]


def _averaged_prior(
    weighted: _WeightedModels, prior_sd: Mapping[str, float]
) -> dict[str, dict[str, float]]:
    """Return the prior mean and standard deviation of every parameter, averaged over the models.

    All models have the same prior probability. A parameter that a model does not have counts as
    zero under this model. ``prior_sd`` holds the prior standard deviations of the largest model, by
    name of parameter or hyper-parameter. The standard deviations of hyper-parameters are returned
    unchanged.
    """
    names = weighted.bound.names
    mean = np.zeros(len(names))
    mean_square = np.zeros(len(names))
    for bound in weighted.bounds:
        columns = [names.index(name) for name in bound.names]
        mean[columns] += bound.prior_mean / len(weighted.nodes)
        mean_square[columns] += (bound.prior_mean**2 + bound.prior_sd**2) / len(weighted.nodes)
    sd = np.sqrt(mean_square - mean**2)
    return {
        "prior_sd": {**prior_sd, **dict(zip(names, sd.tolist(), strict=True))},
        "prior_mean": dict(zip(names, mean.tolist(), strict=True)),
    }


def _describe_models(weighted: _WeightedModels) -> dict[str, Any]:
    """Return names, evidences and probabilities of the models, to be stored with the posterior.

    The result is a dict with three entries:

    - ``models``: a list with one entry for each model. The entry states the name of the model, the
      alternative explanations that it includes (``rivals``), its log evidence and its posterior
      probability. Several models can have the same name and differ only in these explanations.
    - ``probability``: sums of posterior probabilities. The key is the name of a model or of an
      explanation, and the sum is over all models that have this name or include this explanation.
    - ``log_evidence_error``: the largest numerical error of the log evidences [nat].
    """
    models = []
    for combination, nodes, probability in zip(
        weighted.combinations, weighted.nodes, weighted.probability.tolist(), strict=True
    ):
        entry = {
            "model": combination.name,
            "rivals": combination.rivals,
            "log_evidence": nodes.evidence.log_value,
            "probability": probability,
        }
        models.append(entry)
    labels = [combination.name for combination in weighted.combinations]
    for combination in weighted.combinations:
        labels.extend(combination.rivals)
    probability_by_label = {}
    for label in dict.fromkeys(labels):
        has_label = [label in (name, *rivals) for name, rivals in weighted.combinations]
        probability_by_label[label] = float(weighted.probability[has_label].sum())
    return {
        "models": models,
        "probability": probability_by_label,
        "log_evidence_error": weighted.log_evidence_error,
    }
