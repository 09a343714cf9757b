"""Assessment of a fit of one model, or of an average: its quality, checks and warnings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ldbb_bayes.inference.checks import TestChecks, average_checks, check_predictions
from ldbb_bayes.inference.coefficients import ModelDraws, mean_shared_coefficients, pool_draws
from ldbb_bayes.inference.diagnostics import power_sensitivity
from ldbb_bayes.inference.effects_of_failures import effects_of_failures
from ldbb_bayes.inference.fit import Concern, Fit
from ldbb_bayes.inference.posterior_concerns import concerns_of_posterior
from ldbb_bayes.inference.residuals import QUALITY_DRAWS, FitQuality, quality_of
from ldbb_bayes.inference.truncation_factor import ProbabilityInside
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.results import Array

__all__ = ["assess_fit"]

# Number of posterior draws from which the posterior predictive checks are computed.
_CHECKED_DRAWS = 500


def assess_fit(
    bound: BoundModel,
    draws_by_model: Sequence[ModelDraws],
    groups: Mapping[str, Mapping[str, Array]],
    truncation: ProbabilityInside,
    concerns: Sequence[Concern],
    rng: np.random.Generator,
    prior_level: Array | float = 0.0,
) -> Fit:
    """Return how well one model, or an average of several models, fits.

    Parameters
    ----------
    bound : BoundModel
        Model of the campaign with the parameters of all averaged models.
    draws_by_model : sequence of ModelDraws
        The posterior draws in ``groups``, separately for each model.
    groups : mapping
        Groups ``posterior``, ``log_prior`` and ``sample_stats`` of the posterior, with arrays of
        shape (chains, draws). The first key is the name of the group, the second key the name of
        the array.
    truncation : ProbabilityInside
        Log posterior probability that no compliance is negative, with its error [nat].
    concerns : sequence of Concern
        Warnings from the sampler.
    rng : Generator
        Generator of the random draws of new circles.
    prior_level : float or array
        Expected value, under the prior, of the log prior density of the parameters. It is
        subtracted from the log prior density. Otherwise, different expected values of the models in
        an average would be mistaken for sensitivity to the prior. For an average, give an array,
        shape (chains, draws), with the expected value for the model of each draw. For a single
        model, any number may be given, because a constant does not change the sensitivity.

    Returns
    -------
    Fit
        Quality of the fit, checks and warnings.
    """
    sizes = np.array([len(draws.phi) for draws in draws_by_model])
    shares = sizes / sizes.sum()
    quality = _average_quality(bound, draws_by_model, shares)
    checks = _average_checks(draws_by_model, shares, rng)
    posterior = groups["posterior"]
    beta, phi = pool_draws(
        _stack(posterior, bound.names), _stack(posterior, bound.hyper_prior.names)
    )
    linearisation_error_mm = bound.largest_linearisation_error_mm(beta.mean(axis=0))
    posterior_concerns = concerns_of_posterior(bound, phi, beta, truncation.log_value)
    shift, widening = effects_of_failures(bound, phi.mean(axis=0), checks)
    return Fit(
        rmse_um=quality.rmse_um,
        fitness_percent=quality.fitness_percent,
        log_prob_truncation=truncation.log_value,
        log_prob_truncation_error=truncation.error,
        log_prob_truncation_prior=bound.parameter_prior.normalisation.log_value,
        linearisation_error_um=linearisation_error_mm * 1e3,
        concerns=(*concerns, *posterior_concerns),
        predictive_checks=checks,
        sensitivity=power_sensitivity(posterior, _log_densities(bound, groups, prior_level)),
        shift=shift,
        widening=widening,
    )


def _average_quality(
    bound: BoundModel, draws_by_model: Sequence[ModelDraws], shares: Array
) -> FitQuality:
    """Return how well a prediction that is averaged over several models agrees with the readings.

    The result holds the root-mean-square residual and the fitness of the averaged prediction.

    ``draws_by_model`` holds the posterior draws of each model. The readings that these draws
    predict are averaged over the draws of each model, then over the models, with the weights
    ``shares``, which sum to one. ``bound`` is the model that has the parameters of all models.
    """
    predictions = []
    for share, draws in zip(shares, draws_by_model, strict=True):
        thinned = draws.thinned(int(np.ceil(share * QUALITY_DRAWS)))
        predictions.append(mean_shared_coefficients(thinned.bound, thinned.phi, thinned.beta))
    return quality_of(bound, np.tensordot(shares, predictions, axes=1))


def _average_checks(
    draws_by_model: Sequence[ModelDraws], shares: Array, rng: np.random.Generator
) -> dict[str, TestChecks]:
    """Return the posterior predictive p-values of each test, averaged over several models.

    ``draws_by_model`` holds the posterior draws of each model, from which its p-values are
    computed. In the average, the models have the weights ``shares``, which sum to one. The keys of
    the result are the names of the tests. ``rng`` generates the random draws of new circles.
    """
    checks = []
    for share, draws in zip(shares, draws_by_model, strict=True):
        thinned = draws.thinned(int(np.ceil(share * _CHECKED_DRAWS)))
        checks.append(check_predictions(thinned.bound, thinned.phi, thinned.beta, rng))
    return average_checks(shares, checks)


def _stack(group: Mapping[str, Array], names: Sequence[str]) -> Array:
    """Return draws of the named variables in one array, shape (chains, draws, variables).

    ``group`` is a dict with the names of the variables as keys and the draws of each variable,
    shape (chains, draws), as values.
    """
    return np.stack([group[str(name)] for name in names], axis=-1)


def _log_densities(
    bound: BoundModel, groups: Mapping[str, Mapping[str, Array]], prior_level: Array | float
) -> dict[str, Array]:
    """Return the log densities of priors and likelihood at every posterior draw.

    The log densities are used to examine how sensitive the posterior is to the priors and to the
    readings. The result is a dict of three arrays of shape (chains, draws):

    - ``prior``: the log prior density of the parameters minus ``prior_level``; see `assess_fit`;
    - ``hyper_prior``: the log prior density of the hyper-parameters (such as the standard deviation
      of the noise);
    - ``likelihood``: the log density of the readings given parameters and hyper-parameters.

    ``groups`` holds the arrays of the posterior; see `assess_fit`. ``bound`` is the model of the
    campaign.
    """
    phi = _stack(groups["posterior"], bound.hyper_prior.names)
    log_prior = groups["log_prior"]["parameters"]
    log_hyper_prior = groups["log_prior"]["hyper"]
    free = bound.hyper_prior.free(phi)
    log_jacobian = bound.hyper_prior.log_density_of_free(free) - log_hyper_prior
    log_posterior = groups["sample_stats"]["lp"]
    return {
        "prior": log_prior - prior_level,
        "hyper_prior": log_hyper_prior,
        "likelihood": log_posterior - log_prior - log_hyper_prior - log_jacobian,
    }
