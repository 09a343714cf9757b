"""Densities of circles left out, in the layout that ArviZ's checks and comparisons read."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
import xarray as xr

from ldbb_bayes.errors import require
from ldbb_bayes.inference.coefficients import evenly_spaced, new_circle_coefficients
from ldbb_bayes.inference.diagnostics import pareto_smooth
from ldbb_bayes.inference.integrals import in_chunks
from ldbb_bayes.inference.nodes import HyperPosterior
from ldbb_bayes.inference.posterior import draws_of, model_draws_of, record_of
from ldbb_bayes.inference.prediction import readings_drawn
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array

__all__ = ["log_likelihood_of_tests", "with_predictive"]

# ln λ of a circle, to sum over: its density and the likelihood are wide beside the steps.
_LOG_LAMBDA = np.arange(-1.5, 3.01, 0.25)
# Tolerance of evidences and of probabilities of the truncation [nat].
_TOLERANCE = 1e-2
# Densities with a larger Pareto k̂ are tempered ...
_LARGE_K = 0.4
# ... to about this one,
_TEMPERED_K = 0.2
# taking k̂ to be no larger than this.
_LARGEST_K = 2.0


@one_blas_thread
def with_predictive(posterior: xr.DataTree, *, draws: int = 1000, seed: int = 1) -> xr.DataTree:
    """Return the posterior with the groups by which ArviZ checks and compares models.

    Parameters
    ----------
    posterior : DataTree
        From `sample` or `load`.
    draws : int
        At most so many, evenly picked; the groups posterior, sample_stats and log_prior keep the
        same ones.
    seed : int

    Returns
    -------
    DataTree
        With the groups ``posterior_predictive`` and ``log_likelihood``, see the notes.

    Raises
    ------
    InputError
        For an average over models, flat priors, a single test, or too few draws.

    Notes
    -----
    ``posterior_predictive.reading_mm`` (chain, draw, reading), beside ``observed_data.reading_mm``:
    a new circle in the place of every test, with the scatter of the circle that was there. For
    ``arviz_stats.loo_pit``, ``per_test`` of both groups is the range of each test's readings [mm].

    ``log_likelihood.per_test`` (chain, draw, test): ln p(y_r | y_−r, φ), the readings of one circle
    given those of all others, which are not independent of it, and the hyper-parameters; all that
    is linear and the circle's own λ_r are integrated out, inside the truncation. The harmonic mean
    of p is the density of a circle left out (Bürkner, Gabry and Vehtari 2021): ``arviz.loo``
    estimates what `compare` computes. Only the hyper-parameters that circles share must bear a
    circle's absence, which keeps Pareto's k low; where it is above 0.4 all the same, p is raised to
    a power below one and scaled so that its harmonic mean is the exact density. The sum over
    circles is not ln p of all of them: for the sensitivity to that see ``Fit.sensitivity``.
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
    readings_by_test = _draw_readings(bound, phi, beta, np.random.default_rng(seed))
    observed_by_test = [test.readings_mm() for test in bound.campaign.tests]
    log_density = _with_moderate_tails(bound, log_likelihood_of_tests(bound, phi))
    observed = thinned["observed_data"].to_dataset()
    names = np.array(bound.test_names)
    thinned["observed_data"] = xr.DataTree(
        observed.assign_coords(test=names).assign(per_test=("test", _ranges(observed_by_test)))
    )
    predicted = {
        "reading_mm": ("reading", np.concatenate(readings_by_test, axis=1)),
        "per_test": ("test", _ranges(readings_by_test)),
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
    """Return the posterior with so many draws of each chain at most, evenly picked."""
    chosen = evenly_spaced(int(posterior["posterior"].sizes["draw"]), draws)
    thinned = posterior.copy()
    for group in ("posterior", "sample_stats", "log_prior"):
        dataset = posterior[group].to_dataset().isel(draw=chosen)
        thinned[group] = xr.DataTree(dataset.assign_coords(draw=np.arange(len(chosen))))
    return thinned


def _draw_readings(
    bound: BoundModel, phi: Array, beta: Array, rng: np.random.Generator
) -> list[Array]:
    """Draw readings (draws, n) [mm] of a new circle in the place of every test."""
    coefficients = new_circle_coefficients(bound, phi, beta, rng)
    sigma = phi[:, bound.hyper_prior.names.index("sigma")]
    return [
        readings_drawn(coefficients[:, r], sigma, test.angles_rad(), rng)
        for r, test in enumerate(bound.campaign.tests)
    ]


def _ranges(readings_by_test: Sequence[Array]) -> Array:
    """Return the range of each test's readings (…, n), shape (…, tests)."""
    return np.stack([np.ptp(readings, axis=-1) for readings in readings_by_test], axis=-1)


def _sampled_group(
    variables: dict[str, tuple[str, Array]], chains: int, coordinates: dict[str, Array]
) -> xr.DataTree:
    """Return a group of variables by name, each a dimension and an array (chains × draws, …)."""
    data = {}
    draws = 0
    for name, (dimension, values) in variables.items():
        by_chain = values.reshape(chains, -1, values.shape[1])
        draws = by_chain.shape[1]
        data[name] = (("chain", "draw", dimension), by_chain)
    sampled = {"chain": np.arange(chains), "draw": np.arange(draws)}
    return xr.DataTree(xr.Dataset(data, sampled | coordinates))


def log_likelihood_of_tests(bound: BoundModel, phi: Array) -> Array:
    """Return ln p(y_r | y_−r, φ), without the λ_r in φ (w, h), shape (w, tests).

    See `with_predictive`.
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
    return bound.keeping([other for other in bound.test_names if other != name])


def _without_circle_scale(bound: BoundModel, phi: Array, circle_scale: str) -> Array:
    """Return ln p(y | φ) with a circle's scale λ integrated out, shape (w,)."""
    grid = np.tile(phi[:, None], (1, len(_LOG_LAMBDA), 1))
    grid[:, :, bound.hyper_prior.names.index(circle_scale)] = np.exp(_LOG_LAMBDA)
    log_prior = bound.hyper_prior.log_density(grid) + _LOG_LAMBDA
    log_evidence = in_chunks(partial(_log_evidence, bound), grid.reshape(-1, phi.shape[1]))
    log_joint = log_prior + log_evidence.reshape(log_prior.shape)
    return np.asarray(
        np.logaddexp.reduce(log_joint, axis=1) - np.logaddexp.reduce(log_prior, axis=1)
    )


def _with_moderate_tails(bound: BoundModel, log_density: Array) -> Array:
    """Return ln p(y_r | y_−r, φ) (w, tests), tempered where Pareto's k̂ of 1/p is large.

    A tempered density is scaled so that its harmonic mean over the draws is the exact density.
    """
    moderate = log_density.copy()
    for r, name in enumerate(bound.test_names):
        k = pareto_smooth(-log_density[:, r]).pareto_k
        if k <= _LARGE_K:
            continue
        tempered = log_density[:, r] * _TEMPERED_K / min(k, _LARGEST_K)
        exact = _exact_log_evidence(bound) - _exact_log_evidence(_without_test(bound, name))
        log_mean_inverse = np.logaddexp.reduce(-tempered) - np.log(len(tempered))
        moderate[:, r] = tempered + exact + log_mean_inverse
    return moderate


def _exact_log_evidence(bound: BoundModel) -> float:
    """Return ln p(y), all parameters and hyper-parameters integrated out."""
    posterior = HyperPosterior(bound, truncated=bound.truncation.active)
    return posterior.nodes(_TOLERANCE).evidence.log_value


def _log_evidence(bound: BoundModel, phi: Array) -> Array:
    """Return ln p(y | φ) inside the truncation, but for P(T) of the prior, shape (w,)."""
    if not bound.truncation.active:
        return bound.log_evidence(phi)
    log_evidence, conditional = bound.given(phi)
    return log_evidence + conditional.orthant.log_probability(_TOLERANCE)[0]
