"""New circles that a posterior expects, in the place of the tests or of a plan; and each circle given the others, for ArviZ."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from ldbb_bayes.campaign.campaign import Campaign, CircularTest, check_campaign
from ldbb_bayes.errors import require
from ldbb_bayes.inference import predictive
from ldbb_bayes.inference.integrals import in_chunks
from ldbb_bayes.inference.nodes import HyperPosterior
from ldbb_bayes.inference.posterior import check_probability, draws_of, pareto_smooth, parts_of, record_of
from ldbb_bayes.jobs import one_blas_thread
from ldbb_bayes.model.fourier import basis
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.result import Array

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["log_likelihood_of_tests", "new_circles", "predict", "with_predictive"]

_DRAWS = 4000
# ln λ of a circle, to sum over: its density and the likelihood are wide beside the steps.
_LOG_LAMBDA = np.arange(-1.5, 3.01, 0.25)
_TOLERANCE, _LARGE_K, _TAMED_K, _MOST_K = 1e-2, 0.4, 0.2, 2.0


@one_blas_thread
def predict(posterior: xr.DataTree, plan: Campaign, *, ci_prob: float = 0.95, seed: int = 1) -> pd.DataFrame:
    """Predict the readings of new circles on the machine of a posterior, with its bar, balls, mount and force device.

    Machine and what circles share come from the posterior; set-up shift, discrepancy, scatter, random force error and white noise
    are drawn anew. What the campaign says nothing of, such as the bar's length at another radius, has its prior. Nuisances are
    integrated out: draws of them, given each draw of the posterior, are not kept; `nuisances` gives their mean and sd.

    InputError for another machine, or circles that show parameters which the fit does not have.

    Parameters
    ----------
    posterior : from `sample`, `load` or `average`.
    plan : the circles; any readings are ignored.
    ci_prob : probability of the equal-tailed interval of a reading.

    Returns
    -------
    One row per test and angle: test, force_N, angle_deg, mean_um, median_um, ci_low_um, ci_high_um.

    Examples
    --------
    >>> table = lb.predict(posterior, lb.Plan((lb.CircularTest(300.0, np.arange(0.0, 360.0, 5.0)),)))
    """
    check_probability(ci_prob)
    check_campaign(plan)
    rng, levels = np.random.default_rng(seed), [0.5, 0.5 - 0.5 * ci_prob, 0.5 + 0.5 * ci_prob]
    parts = [new_circles(part, plan, rng) for part in parts_of(posterior, _DRAWS)]
    tables = []
    for test, *drawn in zip(plan.tests, *parts, strict=True):
        readings = np.concatenate(drawn) * 1e3
        columns = np.vstack([readings.mean(axis=0), np.quantile(readings, levels, axis=0)])
        numbers = dict(zip(("mean_um", "median_um", "ci_low_um", "ci_high_um"), columns, strict=True))
        tables.append(pd.DataFrame({"test": test.name, "force_N": test.force_N, "angle_deg": test.angle_deg, **numbers}))
    return pd.concat(tables, ignore_index=True)


def new_circles(part: predictive.Part, plan: Campaign, rng: np.random.Generator) -> Iterator[Array]:
    """Readings (draws, n) [mm] of each planned test in turn, one circle for every draw."""
    bound, beta = part.bound, part.beta
    measured, planned = _beside(bound, plan)
    names = planned.hyper_prior.names
    phi = planned.hyper_prior.draw(len(beta), rng)
    for j, name in enumerate(bound.hyper_prior.names):
        phi[:, names.index(name)] = part.phi[:, j]
    value = dict(zip(names, phi.T, strict=True))
    learnt = [name for term in predictive.shared_terms(measured.nuisance_columns) for name in term.names]
    drawn, total = predictive.draw_shared(measured, phi, beta, rng), predictive.machine_coefficients(planned, beta)
    for term in predictive.shared_terms(planned.nuisance_columns):
        own = term.sd_at(value) * rng.standard_normal((len(beta), len(term.names))) + (0.0 if term.mean is None else term.mean)
        for j, name in enumerate(term.names):
            if name in learnt:
                own[:, j] = drawn[:, learnt.index(name)]
        total = total + np.einsum("tkq,wq->wtk", term.values, own)
    for r, test in enumerate(plan.tests):
        yield _readings(test, total[:, r] + predictive.draw_of_circle(planned, phi, r, rng), value["sigma"], rng)


def _readings(test: CircularTest, coefficients: Array, sigma: Array, rng: np.random.Generator) -> Array:
    smooth = coefficients @ basis(test.angles_rad()).T
    return np.asarray(smooth + sigma[:, None] * rng.standard_normal(smooth.shape))


def _beside(bound: BoundModel, plan: Campaign) -> tuple[BoundModel, BoundModel]:
    """The tests measured and those planned as one campaign's: with both balls' forms, all radii and directions of either."""
    campaign, model = bound.campaign, bound.model
    machines = [(one.topology, dict(one.frames_mm)) for one in (campaign, plan)]
    got = f"got {machines[1][0]}. Make the plan with the campaign's topology and frames."
    require(machines[0] == machines[1], f"the plan must be of the posterior's machine {machines[0][0]}, its frames too, {got}")
    new = tuple(replace(test.with_reading_um(None), name="") for test in plan.tests)
    union = replace(campaign, tests=(*campaign.plan().tests, *new))
    model = model if bound.setting.circle[0] else model.without("circle-scale")
    whole = BoundModel(model, union, pilot=campaign)
    other = sorted(set(whole.names) ^ set(bound.names))
    cure = "Fit with replace(campaign, foreseen=plan.tests), so that the model knows of them."
    require(not other, f"the plan must show only what the fit has, got planes or set-ups with {', '.join(other)} too. {cure}")
    names, run = [test.name for test in union.tests], len(campaign.tests)
    measured = whole.keeping(names[:run])
    measured.reduced = bound.reduced
    return measured, whole.keeping(names[run:])


@one_blas_thread
def with_predictive(posterior: xr.DataTree, *, draws: int = 1000, seed: int = 1) -> xr.DataTree:
    """Return the posterior with the groups by which ArviZ checks and compares models.

    ``posterior_predictive.reading_mm`` (chain, draw, reading), beside ``observed_data.reading_mm``: a new circle in the place of
    every test, with the scatter of the circle that was there.

    ``log_likelihood.per_test`` (chain, draw, test): ln p(y_r | y_−r, φ), the readings of one circle given those of all others,
    which are not independent of it, and the hyper-parameters; all that is linear and the circle's own λ_r are integrated out,
    inside the truncation. The harmonic mean of p is the density of a circle left out (Bürkner, Gabry and Vehtari 2021):
    ``arviz.loo`` estimates what `compare` computes. Only the hyper-parameters that circles share must bear a circle's absence,
    which keeps Pareto's k low; where it is above 0.4 all the same, p is raised to a power below one and scaled so that its
    harmonic mean is the exact density. The sum over circles is not ln p of all of them: for the sensitivity to that see
    ``Fit.sensitivity``. InputError for an average over models, flat priors, a single test, or too few draws.

    Parameters
    ----------
    posterior : from `sample` or `load`.
    draws : at most so many, evenly picked; the groups posterior, sample_stats and log_prior keep the same ones.
    """
    import xarray as xr

    require("averaged" not in record_of(posterior), "the posterior must be of one model, got an average. Fit each model.")
    chains, most = (int(posterior["posterior"].sizes[dim]) for dim in ("chain", "draw"))
    require(draws >= chains, f"draws must be at least {chains}, one of each chain, got {draws}. The default is 1000.")
    pick = np.linspace(0, most - 1, min(most, draws // chains)).astype(int)
    made = posterior.copy()
    for group in ("posterior", "sample_stats", "log_prior"):
        made[group] = xr.DataTree(posterior[group].to_dataset().isel(draw=pick).assign_coords(draw=np.arange(len(pick))))
    (bound, *_), *_ = parts_of(posterior, 1)
    require(not bound.model.prior.flat, "the prior must be proper, got a flat one. Fit with the default preset.")
    require(len(bound.test_names) > 1, "a campaign must have at least two tests to leave one out, got one. Add tests.")
    beta, phi = draws_of(made, bound)
    rng, shape = np.random.default_rng(seed), (chains, len(pick), -1)
    circles = np.moveaxis(predictive.new_circle_coefficients(bound, phi, beta, rng), 1, 0)
    sigma = phi[:, bound.hyper_prior.names.index("sigma")]
    drawn = [_readings(test, own, sigma, rng) for test, own in zip(bound.campaign.tests, circles, strict=True)]
    arrays = {
        "posterior_predictive": ("reading_mm", "reading", np.concatenate(drawn, axis=1)),
        "log_likelihood": ("per_test", "test", _steadied(bound, log_likelihood_of_tests(bound, phi))),
    }
    for group, (name, dim, values) in arrays.items():
        at = made["observed_data"]["reading"].values if dim == "reading" else np.array(bound.test_names)
        coords = {"chain": np.arange(chains), "draw": np.arange(len(pick)), dim: at}
        attrs = {"unit": "mm"} if dim == "reading" else {}
        made[group] = xr.DataTree(xr.Dataset({name: (("chain", "draw", dim), values.reshape(shape), attrs)}, coords))
    return made


def log_likelihood_of_tests(bound: BoundModel, phi: Array) -> Array:
    """ln p(y_r | y_−r, φ), without the λ_r in φ (w, h), shape (w, tests); see `with_predictive`."""
    together, found = in_chunks(partial(_log_evidence, bound), phi), np.empty((len(phi), len(bound.test_names)))
    for r, name in enumerate(bound.test_names):
        rest, circle = bound.keeping([other for other in bound.test_names if other != name]), str(bound.setting.circle[r])
        top = together
        if circle:
            each = np.tile(phi[:, None], (1, len(_LOG_LAMBDA), 1))
            each[:, :, bound.hyper_prior.names.index(circle)] = np.exp(_LOG_LAMBDA)
            prior = bound.hyper_prior.log_density(each) + _LOG_LAMBDA
            values = in_chunks(partial(_log_evidence, bound), each.reshape(-1, phi.shape[1])).reshape(prior.shape)
            top = np.logaddexp.reduce(prior + values, axis=1) - np.logaddexp.reduce(prior, axis=1)
        found[:, r] = top - in_chunks(partial(_log_evidence, rest), phi)
    return found


def _steadied(bound: BoundModel, log_density: Array) -> Array:
    """ln p(y_r | y_−r, φ) (w, tests) of draws; where Pareto's k is large, such that w / Σ 1/p is the exact density."""
    for r, name in enumerate(bound.test_names):
        k = pareto_smooth(-log_density[:, r])[1]
        if k > _LARGE_K:
            rest = bound.keeping([other for other in bound.test_names if other != name])
            tempered = log_density[:, r] * _TAMED_K / min(k, _MOST_K)
            posteriors = [HyperPosterior(own, truncated=own.truncation.active) for own in (bound, rest)]
            whole, left = (own.nodes(_TOLERANCE).evidence.log_value for own in posteriors)
            log_density[:, r] = tempered + whole - left + np.logaddexp.reduce(-tempered) - np.log(len(tempered))
    return log_density


def _log_evidence(bound: BoundModel, phi: Array) -> Array:
    """ln p(y | φ) inside the truncation, but for P(T) of the prior, shape (w,)."""
    if not bound.truncation.active:
        return bound.log_evidence(phi)
    log_evidence, given = bound.given(phi)
    return log_evidence + given.orthant.log_probability(_TOLERANCE)[0]
