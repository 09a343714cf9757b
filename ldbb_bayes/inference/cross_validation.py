"""Predictive densities of the readings of tests that are left out, in the form that ArviZ needs.

y_r are the readings of test r, y_−r those of all other tests. φ are the h hyper-parameters, such as
the standard deviation of the noise. One of them, λ_r, multiplies two random effects on circle r:
its set-up shift (of zero and centre) and its discrepancy (unexplained deviations). β are the p
parameters: compliances, their changes with force, and geometric errors. Truncation restricts β to
compliances that are not negative. k̂ is the Pareto shape of the tail of importance weights.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
import xarray as xr

from ldbb_bayes.errors import require
from ldbb_bayes.inference.coefficients import evenly_spaced, new_circle_coefficients
from ldbb_bayes.inference.diagnostics import pareto_smooth
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.inference.integrals import in_chunks
from ldbb_bayes.inference.nodes import compute_nodes
from ldbb_bayes.inference.posterior import draws_of, model_draws_of, record_of
from ldbb_bayes.inference.prediction import predict_left_out, readings_drawn
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array

__all__ = ["log_likelihood_of_tests", "with_predictive"]

# Values of ln λ for integrals over λ, which are computed as sums over these values. λ is the noise
# factor of a circle: it multiplies the random shift of the circle's zero and centre, and its
# unexplained deviations of the orders 2 to 12. The distance between successive values is small
# compared with the width of the density of ln λ.
_LOG_LAMBDA = np.arange(-1.5, 3.01, 0.25)
# Error allowed in each log evidence [nat], and in each logarithm of the probability that no
# compliance is negative.
_TOLERANCE = 1e-2
# Pareto shape k̂ above which the densities of a test's readings are tempered, that is, raised to a
# power below one. The inverse densities at the posterior draws are the importance weights of the
# draws; k̂ states how heavy the tail of these weights is.
_LARGE_K = 0.4
# The inverse densities of a test's readings are importance weights of the posterior draws. If these
# weights are very unequal, the densities are tempered, that is, raised to a power below one. The
# power is this value divided by the Pareto shape k̂ of the weights; after tempering, the Pareto
# shape is about equal to this value.
_TEMPERED_K = 0.2
# Densities whose inverses have a heavy tail are tempered, that is, raised to a power below one. The
# power is computed from the Pareto shape k̂ of the tail, or from this value if k̂ is larger.
_LARGEST_K = 2.0


@one_blas_thread
def with_predictive(posterior: xr.DataTree, *, draws: int = 1000, seed: int = 1) -> xr.DataTree:
    """Return a posterior with two more groups, which ArviZ needs to check and compare models.

    Parameters
    ----------
    posterior : DataTree
        Posterior from `sample` or `load`.
    draws : int
        Largest number of draws used, in all chains together. They are taken at equal intervals
        along each chain. The groups posterior, sample_stats and log_prior of the result hold only
        these draws.
    seed : int
        Seed of the random draws of new circles.

    Returns
    -------
    DataTree
        Posterior with the groups ``posterior_predictive`` and ``log_likelihood``; see the notes.

    Raises
    ------
    InputError
        If the posterior is an average over models, if its priors are flat, if the campaign has a
        single test, or if ``draws`` is less than the number of chains.

    Notes
    -----
    ``posterior_predictive.reading_mm``, with the dimensions (chain, draw, reading), holds the
    readings of a new circle for every test. In a model with noise factors, λ_r multiplies the
    set-up shift (of zero and centre) and the discrepancy (unexplained deviations) of circle r. The
    new circle of test r then has the same λ_r as the measured circle. The measured readings are
    ``observed_data.reading_mm``. ``observed_data.per_test`` is the range of the readings of each
    test [mm]. ``posterior_predictive.per_test`` is the range of readings drawn from
    p(y_r | y_−r, φ), the density that ``log_likelihood`` states. ``arviz_stats.loo_pit`` weights
    these draws so that φ, too, does not depend on the readings of test r.

    ``log_likelihood.per_test``, with the dimensions (chain, draw, test), is ln p(y_r | y_−r, φ). It
    is the log density of the readings of test r, given the readings of all other tests and the
    hyper-parameters φ (such as the standard deviation of the noise). All unknowns on which the
    readings depend linearly are integrated out. If the model forbids negative compliances, the
    integral is over compliances that are not negative. If the model has a factor λ_r, this factor
    is integrated out as well. If circle r is left out, the predictive density of its readings is
    the harmonic mean, over the draws, of p(y_r | y_−r, φ) (Bürkner, Gabry and Vehtari 2021). For
    this reason ``arviz.loo`` estimates the same quantity that `compare` computes.

    If circle r is left out, ``arviz.loo`` gives each draw the weight 1 / p(y_r | y_−r, φ). The
    Pareto shape k̂ of the weights is usually low, because leaving out circle r changes the density
    of the hyper-parameters other than λ_r only little. If k̂ exceeds 0.4, the values of
    p(y_r | y_−r, φ) are raised to a power below one. They are then multiplied by a constant, so
    that their harmonic mean equals the predictive density of circle r, which is computed separately
    and exactly. The sum of ``per_test`` over the tests is not the log likelihood of all readings;
    ``Fit.sensitivity`` states how sensitive the posterior is to the log likelihood of all readings.

    Examples
    --------
    >>> posterior = lb.sample(lb.HybridModel.first(0), campaign, sampler="independent")
    >>> checked = lb.inference.with_predictive(posterior, draws=40)
    >>> checked["log_likelihood"]["per_test"].dims
    ('chain', 'draw', 'test')
    >>> checked["posterior_predictive"]["reading_mm"].shape
    (4, 10, 4320)
    """
    require(
        "averaged" not in record_of(posterior),
        "the posterior must be of one model, got an average. Fit each model.",
    )
    chains = int(posterior["posterior"].sizes["chain"])
    require(
        draws >= chains,
        f"draws must be at least {chains}, one of each chain, got {draws}. The default is 1000.",
    )
    bound = model_draws_of(posterior, 1)[0].bound
    require(
        not bound.model.prior.flat,
        "the prior must be proper, got a flat one. Fit with the default preset.",
    )
    require(
        len(bound.test_names) > 1,
        "a campaign must have at least two tests to leave one out, got one. Add tests.",
    )
    thinned = _thin_chains(posterior, draws // chains)
    beta, phi = draws_of(thinned, bound)
    rng = np.random.default_rng(seed)
    readings_by_test = _draw_readings(bound, phi, beta, rng)
    left_out_by_test = []
    for name in bound.test_names:
        remaining = _without_test(bound, name)
        left_out_by_test.append(predict_left_out(bound, remaining, phi, name, rng))
    observed_by_test = [test.readings_mm() for test in bound.campaign.tests]
    log_density = _with_moderate_tails(bound, log_likelihood_of_tests(bound, phi))
    observed = thinned["observed_data"].to_dataset()
    names = np.array(bound.test_names)
    thinned["observed_data"] = xr.DataTree(
        observed.assign_coords(test=names).assign(per_test=("test", _ranges(observed_by_test)))
    )
    predicted = {
        "reading_mm": ("reading", np.concatenate(readings_by_test, axis=1)),
        "per_test": ("test", _ranges(left_out_by_test)),
    }
    coordinates = {"reading": observed["reading"].values, "test": names}
    thinned["posterior_predictive"] = _sampled_group(predicted, chains, coordinates)
    for group in ("observed_data", "posterior_predictive"):
        for variable in thinned[group].data_vars.values():
            variable.attrs["unit"] = "mm"
    likelihood = {"per_test": ("test", log_density)}
    thinned["log_likelihood"] = _sampled_group(likelihood, chains, {"test": names})
    return thinned


def _thin_chains(posterior: xr.DataTree, draws: int) -> xr.DataTree:
    """Return a copy of a posterior with at most ``draws`` draws of each chain.

    The draws are taken at equal intervals along the chain.
    """
    indices = evenly_spaced(int(posterior["posterior"].sizes["draw"]), draws)
    thinned = posterior.copy()
    for group in ("posterior", "sample_stats", "log_prior"):
        dataset = posterior[group].to_dataset().isel(draw=indices)
        thinned[group] = xr.DataTree(dataset.assign_coords(draw=np.arange(len(indices))))
    return thinned


def _draw_readings(
    bound: BoundModel, phi: Array, beta: Array, rng: np.random.Generator
) -> list[Array]:
    """Return random readings of new circles, one array for every test, shape (draws, n) [mm].

    A test has n readings. Each posterior draw gives one new circle of every test. ``rng`` generates
    the random numbers. ``phi``, shape (draws, h), holds draws of the h hyper-parameters (such as
    the standard deviation of the noise); ``beta``, shape (draws, p), holds draws of the p
    parameters (compliances, their changes with force, geometric errors). ``bound`` is the model of
    the campaign.
    """
    coefficients = new_circle_coefficients(bound, phi, beta, rng)
    sigma = phi[:, bound.hyper_prior.names.index("sigma")]
    return [
        readings_drawn(coefficients[:, r], sigma, test.angles_rad(), rng)
        for r, test in enumerate(bound.campaign.tests)
    ]


def _ranges(readings_by_test: Sequence[Array]) -> Array:
    """Return the range (largest minus smallest) of the readings of each test, shape (…, tests).

    ``readings_by_test`` holds an array of shape (…, n) for each test: its n readings, or random
    draws of its readings.
    """
    return np.stack([np.ptp(readings, axis=-1) for readings in readings_by_test], axis=-1)


def _sampled_group(
    variables: dict[str, tuple[str, Array]], chains: int, coordinates: dict[str, Array]
) -> xr.DataTree:
    """Return random draws as a group of a DataTree, split into chains.

    ``variables`` is a dict with the names of the variables as keys. Each value is a pair: the name
    of the array's second dimension, of length m, and the array of draws, shape (chains × draws, m).
    ``coordinates`` is a dict with the names of these second dimensions as keys; each value holds
    the m labels along the dimension.
    """
    data = {}
    draws = 0
    for name, (dimension, values) in variables.items():
        by_chain = values.reshape(chains, -1, values.shape[1])
        draws = by_chain.shape[1]
        data[name] = (("chain", "draw", dimension), by_chain)
    sampled = {"chain": np.arange(chains), "draw": np.arange(draws)}
    return xr.DataTree(xr.Dataset(data, sampled | coordinates))


def log_likelihood_of_tests(bound: BoundModel, phi: Array) -> Array:
    """Return the log density of each test's readings given all other readings, shape (w, tests).

    The density is p(y_r | y_−r, φ), where y_r are the readings of test r and y_−r those of all
    other tests. φ are the h hyper-parameters (such as the standard deviation of the noise);
    ``phi``, shape (w, h), holds w values of them. If the model has a factor that multiplies the
    set-up shift (of zero and centre) and the discrepancy (unexplained deviations) of test r, this
    factor is integrated out. See `with_predictive`. ``bound`` is the model of the campaign.
    """
    log_evidence = in_chunks(partial(_log_evidence, bound), phi)
    log_density = np.empty((len(phi), len(bound.test_names)))
    for r, name in enumerate(bound.test_names):
        log_joint = log_evidence
        circle_scale = str(bound.setting.circle[r])
        if circle_scale:
            log_joint = _without_circle_scale(bound, phi, circle_scale)
        remaining = _without_test(bound, name)
        log_density[:, r] = log_joint - in_chunks(partial(_log_evidence, remaining), phi)
    return log_density


def _without_test(bound: BoundModel, name: str) -> BoundModel:
    """Return the model of the campaign without the test ``name``."""
    return bound.keeping([other for other in bound.test_names if other != name])


def _without_circle_scale(bound: BoundModel, phi: Array, circle_scale: str) -> Array:
    """Return the log density of readings with one hyper-parameter integrated out, shape (w,).

    The hyper-parameter with the name ``circle_scale`` multiplies two random effects on one circle:
    its set-up shift (of zero and centre) and its discrepancy (unexplained deviations). The integral
    over this hyper-parameter is weighted by its prior. The result is ln p(y | φ), where y are the
    readings and φ the other hyper-parameters (such as the standard deviation of the noise).
    ``phi``, shape (w, h), holds w values of all h hyper-parameters. ``bound`` is the model of the
    campaign.
    """
    grid = np.tile(phi[:, None], (1, len(_LOG_LAMBDA), 1))
    grid[:, :, bound.hyper_prior.names.index(circle_scale)] = np.exp(_LOG_LAMBDA)
    log_prior = bound.hyper_prior.log_density(grid) + _LOG_LAMBDA
    log_evidence = in_chunks(partial(_log_evidence, bound), grid.reshape(-1, phi.shape[1]))
    log_joint = log_prior + log_evidence.reshape(log_prior.shape)
    return np.asarray(
        np.logaddexp.reduce(log_joint, axis=1) - np.logaddexp.reduce(log_prior, axis=1)
    )


def _with_moderate_tails(bound: BoundModel, log_density: Array) -> Array:
    """Return log densities of the tests' readings, tempered if importance weights are unreliable.

    ``log_density``, shape (w, tests), is the log density of each test's readings given those of all
    other tests. It is given at w draws of the hyper-parameters (such as the standard deviation of
    the noise). ``bound`` is the model of the campaign.

    If a test is left out, the inverses of its w densities are the importance weights of the draws.
    If the Pareto shape k̂ of these weights is above 0.4, the densities of the test are tempered:
    they are raised to a power below one. They are then multiplied by a constant, so that their
    harmonic mean over the draws equals the predictive density of the test's readings. The exact
    value of the predictive density is known: it is the evidence of all tests divided by the
    evidence of all other tests.
    """
    large_k_by_test = {}
    for r in range(len(bound.test_names)):
        k = pareto_smooth(-log_density[:, r]).pareto_k
        if k > _LARGE_K:
            large_k_by_test[r] = k
    moderate = log_density.copy()
    if not large_k_by_test:
        return moderate
    log_evidence = _exact_log_evidence(bound)
    for r, k in large_k_by_test.items():
        tempered = log_density[:, r] * _TEMPERED_K / min(k, _LARGEST_K)
        other_tests = _without_test(bound, bound.test_names[r])
        exact = log_evidence - _exact_log_evidence(other_tests)
        log_mean_inverse = np.logaddexp.reduce(-tempered) - np.log(len(tempered))
        moderate[:, r] = tempered + exact + log_mean_inverse
    return moderate


def _exact_log_evidence(bound: BoundModel) -> float:
    """Return the log evidence of a model: the log density of its campaign's readings.

    All unknowns, the hyper-parameters (such as the standard deviation of the noise) included, are
    integrated out. ``bound`` is the model of the campaign.
    """
    posterior = HyperPosterior(bound, truncated=bound.truncation.active)
    return compute_nodes(posterior, _TOLERANCE).evidence.log_value


def _log_evidence(bound: BoundModel, phi: Array) -> Array:
    """Return ln p(y | φ) of the readings y at w values of the hyper-parameters φ, shape (w,).

    φ are the h hyper-parameters, such as the standard deviation of the noise; ``phi``, shape (w,
    h), holds w values of them. If the model forbids negative compliances, the result is ln p(y,
    T | φ), where T is the condition that no compliance is negative. The density is joint, and
    therefore not divided by the prior probability of T. ``bound`` is the model of the campaign.
    """
    if not bound.truncation.active:
        return bound.log_evidence(phi)
    log_evidence, conditional = bound.given(phi)
    return log_evidence + conditional.orthant.log_probability(_TOLERANCE)[0]
