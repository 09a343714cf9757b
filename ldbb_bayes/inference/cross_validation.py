"""Densities of circles left out, in the layout that ArviZ's checks and comparisons read."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ldbb_bayes.errors import require
from ldbb_bayes.inference.coefficients import (
    new_circle_coefficients,
)
from ldbb_bayes.inference.diagnostics import pareto_smooth
from ldbb_bayes.inference.integrals import in_chunks
from ldbb_bayes.inference.nodes import HyperPosterior
from ldbb_bayes.inference.posterior import draws_of, model_draws_of, record_of
from ldbb_bayes.inference.prediction import readings_drawn
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array

if TYPE_CHECKING:
    import xarray as xr
__all__ = ["log_likelihood_of_tests", "with_predictive"]

# ln λ of a circle, to sum over: its density and the likelihood are wide beside the steps.
_LOG_LAMBDA = np.arange(-1.5, 3.01, 0.25)
_TOLERANCE = 1e-2
_LARGE_K = 0.4
_TAMED_K = 0.2
_MOST_K = 2.0


@one_blas_thread
def with_predictive(posterior: xr.DataTree, *, draws: int = 1000, seed: int = 1) -> xr.DataTree:
    """Return the posterior with the groups by which ArviZ checks and compares models.

    ``posterior_predictive.reading_mm`` (chain, draw, reading), beside ``observed_data.reading_mm``:
    a new circle in the place of every test, with the scatter of the circle that was there.

    ``log_likelihood.per_test`` (chain, draw, test): ln p(y_r | y_−r, φ), the readings of one circle
    given those of all others, which are not independent of it, and the hyper-parameters; all that
    is linear and the circle's own λ_r are integrated out, inside the truncation. The harmonic mean
    of p is the density of a circle left out (Bürkner, Gabry and Vehtari 2021): ``arviz.loo``
    estimates what `compare` computes. Only the hyper-parameters that circles share must bear a
    circle's absence, which keeps Pareto's k low; where it is above 0.4 all the same, p is raised to
    a power below one and scaled so that its harmonic mean is the exact density. The sum over
    circles is not ln p of all of them: for the sensitivity to that see ``Fit.sensitivity``.
    InputError for an average over models, flat priors, a single test, or too few draws.

    Parameters
    ----------
    posterior : from `sample` or `load`.
    draws : at most so many, evenly picked; the groups posterior, sample_stats and log_prior keep
        the same ones.
    """
    import xarray as xr

    require(
        "averaged" not in record_of(posterior),
        "the posterior must be of one model, got an average. Fit each model.",
    )
    chains, most = (int(posterior["posterior"].sizes[dim]) for dim in ("chain", "draw"))
    require(
        draws >= chains,
        f"draws must be at least {chains}, one of each chain, got {draws}. The default is 1000.",
    )
    pick = np.linspace(0, most - 1, min(most, draws // chains)).astype(int)
    made = posterior.copy()
    for group in ("posterior", "sample_stats", "log_prior"):
        made[group] = xr.DataTree(
            posterior[group].to_dataset().isel(draw=pick).assign_coords(draw=np.arange(len(pick)))
        )
    (bound, *_), *_ = model_draws_of(posterior, 1)
    require(
        not bound.model.prior.flat,
        "the prior must be proper, got a flat one. Fit with the default preset.",
    )
    require(
        len(bound.test_names) > 1,
        "a campaign must have at least two tests to leave one out, got one. Add tests.",
    )
    beta, phi = draws_of(made, bound)
    rng = np.random.default_rng(seed)
    shape = (chains, len(pick), -1)
    circles = np.moveaxis(new_circle_coefficients(bound, phi, beta, rng), 1, 0)
    sigma = phi[:, bound.hyper_prior.names.index("sigma")]
    pairs = zip(circles, bound.campaign.tests, strict=True)
    drawn = [readings_drawn(own, sigma, test.angles_rad(), rng) for own, test in pairs]
    arrays = {
        "posterior_predictive": ("reading_mm", "reading", np.concatenate(drawn, axis=1)),
        "log_likelihood": (
            "per_test",
            "test",
            _steadied(bound, log_likelihood_of_tests(bound, phi)),
        ),
    }
    for group, (name, dim, values) in arrays.items():
        at = (
            made["observed_data"]["reading"].values
            if dim == "reading"
            else np.array(bound.test_names)
        )
        coords = {"chain": np.arange(chains), "draw": np.arange(len(pick)), dim: at}
        attrs = {"unit": "mm"} if dim == "reading" else {}
        made[group] = xr.DataTree(
            xr.Dataset({name: (("chain", "draw", dim), values.reshape(shape), attrs)}, coords)
        )
    return made


def log_likelihood_of_tests(bound: BoundModel, phi: Array) -> Array:
    """ln p(y_r | y_−r, φ), without the λ_r in φ (w, h), shape (w, tests); see `with_predictive`."""
    together = in_chunks(partial(_log_evidence, bound), phi)
    found = np.empty((len(phi), len(bound.test_names)))
    for r, name in enumerate(bound.test_names):
        rest = bound.keeping([other for other in bound.test_names if other != name])
        circle = str(bound.setting.circle[r])
        top = together
        if circle:
            each = np.tile(phi[:, None], (1, len(_LOG_LAMBDA), 1))
            each[:, :, bound.hyper_prior.names.index(circle)] = np.exp(_LOG_LAMBDA)
            prior = bound.hyper_prior.log_density(each) + _LOG_LAMBDA
            values = in_chunks(
                partial(_log_evidence, bound), each.reshape(-1, phi.shape[1])
            ).reshape(prior.shape)
            top = np.logaddexp.reduce(prior + values, axis=1) - np.logaddexp.reduce(prior, axis=1)
        found[:, r] = top - in_chunks(partial(_log_evidence, rest), phi)
    return found


def _steadied(bound: BoundModel, log_density: Array) -> Array:
    """ln p(y_r | y_−r, φ) (w, tests) of draws; where Pareto's k is large, such that w / Σ 1/p is
    the exact density."""
    for r, name in enumerate(bound.test_names):
        k = pareto_smooth(-log_density[:, r])[1]
        if k > _LARGE_K:
            rest = bound.keeping([other for other in bound.test_names if other != name])
            tempered = log_density[:, r] * _TAMED_K / min(k, _MOST_K)
            posteriors = [
                HyperPosterior(own, truncated=own.truncation.active) for own in (bound, rest)
            ]
            whole, left = (own.nodes(_TOLERANCE).evidence.log_value for own in posteriors)
            log_density[:, r] = (
                tempered + whole - left + np.logaddexp.reduce(-tempered) - np.log(len(tempered))
            )
    return log_density


def _log_evidence(bound: BoundModel, phi: Array) -> Array:
    """ln p(y | φ) inside the truncation, but for P(T) of the prior, shape (w,)."""
    if not bound.truncation.active:
        return bound.log_evidence(phi)
    log_evidence, given = bound.given(phi)
    return log_evidence + given.orthant.log_probability(_TOLERANCE)[0]
