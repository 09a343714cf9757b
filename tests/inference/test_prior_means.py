"""Priors with means, all the way through: three samplers, evidences by brute force, nested Bayes factors, results."""

from __future__ import annotations

import functools
import json
from dataclasses import replace

import numpy as np
import pytest
from campaigns import oracle_of, plan, simulated
from scipy import integrate, stats

import ldbb_bayes as lb
from ldbb_bayes.inference.evidence import Evidence, evidence_on
from ldbb_bayes.inference.marginals import moments
from ldbb_bayes.inference.quadrature import HyperPosterior
from ldbb_bayes.inference.savage_dickey import savage_dickey
from ldbb_bayes.inference.summary import result_json
from ldbb_bayes.model.basis import basis

PRIORS = {"C_XXX": (4.4e-5, 4e-6), "C_YYY": (5.0e-5, 3e-6), "C_CCY": (-2e-10, 4e-10), "E_YY1": (-5e-5, 4e-5)}
SHORT = lb.StoppingRule(ess=100.0, max_steps=200)


def with_priors(model: lb.HybridModel, priors: dict[str, tuple[float, float]] = PRIORS) -> lb.HybridModel:
    means, sds = {name: mean for name, (mean, _) in priors.items()}, {name: sd for name, (_, sd) in priors.items()}
    return replace(model, prior=replace(model.prior, means=means, overrides=sds))


@pytest.mark.parametrize("sampler", ["joint", "collapsed", "quadrature"])
def test_readings_less_what_the_means_expect(sampler: str) -> None:
    """The posterior with means m of y is that without of y − J m, moved by m: draw by draw."""
    model = with_priors(lb.HybridModel.default(1).without("force-error", "truncation"))
    plain = replace(model, prior=replace(model.prior, means=dict.fromkeys(PRIORS, 0.0)))
    campaign = simulated(plan((30, 30, 30), forces_N=(36.0, 400.0, 742.0)))
    bound = model.bind(campaign)
    less = tuple(
        test.with_reading_um(np.asarray(test.reading_um) - basis(test.angles_rad()) @ bound.interest[r] @ bound.prior_mean * 1e3)
        for r, test in enumerate(campaign.tests)
    )
    moved = lb.sample(model, campaign, sampler=sampler, seed=3, rule=SHORT)["posterior"]
    still = lb.sample(plain, replace(campaign, tests=less), sampler=sampler, seed=3, rule=SHORT)["posterior"]
    for parameter in bound.parameters:
        found = moved[parameter.name].to_numpy() - parameter.prior_mean
        expected = still[parameter.name].to_numpy()
        apart = np.abs(found - expected) / parameter.prior_sd
        assert np.quantile(apart, 0.99) < 1e-5, parameter.name
    for name in bound.hyper_prior.names:
        np.testing.assert_allclose(np.quantile(moved[name], 0.5), np.quantile(still[name], 0.5), rtol=1e-5)


def test_samplers_agree_with_the_oracle() -> None:
    """Means that the readings pull at, inside a truncation that cuts into one of the priors."""
    campaign = simulated(plan((30, 30, 30), forces_N=(36.0, 400.0, 742.0)), seed=2)
    model = with_priors(lb.HybridModel.default(0))
    exact = oracle_of(campaign, 0, given_priors=PRIORS).posterior(points=800, draws=100, seed=1)
    mean = exact["weight"] @ exact["beta"]
    sd = np.sqrt(exact["weight"] @ (exact["beta"] - mean) ** 2)
    posterior = HyperPosterior(model.bind(campaign), truncated=True)
    own_mean, own_sd = moments(posterior, posterior.lattice(1e-2), spare=1e-3)
    np.testing.assert_allclose((own_mean - mean) / sd, 0.0, atol=0.08)
    np.testing.assert_allclose(own_sd / sd, 1.0, atol=0.08)
    for sampler in ("joint", "collapsed", "quadrature"):
        table = lb.summarize(lb.sample(model, campaign, sampler=sampler, seed=2))
        rows = table.loc[list(posterior.bound.names)]
        np.testing.assert_allclose((rows["mean"] - own_mean) / own_sd, 0.0, atol=0.15)
        np.testing.assert_allclose(rows["sd"] / own_sd, 1.0, atol=0.12)


@pytest.mark.parametrize("truncated", [True, False])
def test_evidence_by_brute_force(truncated: bool) -> None:
    """White noise alone: an integral over σ of a dense Gaussian, times P(T | y, σ) / P(T)."""
    campaign = simulated(plan((12, 12), forces_N=(100.0, 600.0)), seed=4)
    nuisances = ("ball-form", "bar-length", "mount", "force-error", "setup-shift", "discrepancy", "hysteresis")
    model = with_priors(lb.HybridModel.default(0).without(*nuisances))
    model = model if truncated else model.without("truncation")
    dense = oracle_of(campaign, 0, terms=(), truncated=truncated, given_priors=PRIORS)
    rows = dense._rows()

    def log_density(sigma: float) -> float:
        log_value, mean, covariance = dense.given(np.array([sigma]))
        inside = 0.0
        if truncated:
            inside = stats.multivariate_normal(-rows @ mean, rows @ covariance @ rows.T, seed=1).logcdf(np.zeros(3))
        return log_value + inside + dense.log_prior_of_log(np.log([sigma])) - np.log(sigma)

    free = np.linspace(np.log(0.07e-3), np.log(6e-3), 40)
    top = max(log_density(float(np.exp(one))) for one in free)
    best = free[int(np.argmax([log_density(float(np.exp(one))) + one for one in free]))]
    value, _ = integrate.quad(
        lambda one: np.exp(log_density(float(np.exp(one))) + one - top), free[0], free[-1], points=[best], limit=60, epsrel=1e-6
    )
    found = lb.log_evidence(model, campaign, tolerance=1e-3)
    assert found.log_value == pytest.approx(np.log(value) + top - dense._log_prob_prior(), abs=5e-3)


@functools.cache
def larger(truncated: bool) -> tuple[HyperPosterior, Evidence]:
    """Of a linear model most of whose compliances have a mean."""
    campaign = simulated(plan((30, 30, 30), forces_N=(36.0, 400.0, 742.0)), seed=3)
    model = with_priors(lb.HybridModel.default(1), PRIORS | {"C_XYX": (2e-6, 3e-6), "C_CXY": (3e-8, 3e-8)})
    posterior = HyperPosterior((model if truncated else model.without("truncation")).bind(campaign), truncated=truncated)
    return posterior, evidence_on(posterior, posterior.lattice(1e-2))


@pytest.mark.parametrize("truncated", [pytest.param(True, marks=pytest.mark.slow), False])
@pytest.mark.parametrize("fixed", [("E_YY1",), ("C_XYX", "C_CXY_1"), ("C_CCY", "C_CCY_1")], ids="+".join)
def test_nested_bayes_factor_is_the_difference_of_evidences(fixed: tuple[str, ...], truncated: bool) -> None:
    """Whatever is tested against zero has a prior mean, and so have others."""
    posterior, evidence = larger(truncated)
    model, campaign = posterior.bound.model, posterior.bound.campaign
    value, error = savage_dickey(posterior, evidence, fixed)
    direct, direct_error = lb.log_bayes_factor(lb.log_evidence(model.fixing(*fixed), campaign, tolerance=1e-2), evidence)
    assert value == pytest.approx(direct, abs=0.05)
    assert abs(value - direct) < 3.0 * (error + direct_error) + 1e-4


def test_results_say_the_prior_means() -> None:
    campaign = simulated(plan((30, 30), forces_N=(36.0, 742.0)))
    tree = lb.sample(with_priors(lb.HybridModel.default(0)), campaign, sampler="quadrature", seed=1, rule=SHORT)
    table, result = lb.summarize(tree), result_json(tree)
    assert table.loc["C_XXX", "prior_mean"] == result["parameters"]["C_XXX"]["prior_mean"] == 4.4e-5
    assert table.loc["C_XYX", "prior_mean"] == result["parameters"]["C_XYX"]["prior_mean"] == 0.0
    assert np.isnan(table.loc["tau", "prior_mean"])
    assert "prior_mean" not in result["hyper"]["tau_um"]
    assert result["model"]["priors"] == "edited"
    assert tree["prior"]["C_YYY"].to_numpy().mean() == pytest.approx(5.0e-5, abs=3e-7)
    record = json.loads(tree["provenance"].attrs["json"])
    del record["model"]["prior_mean"]
    tree["provenance"].attrs["json"] = json.dumps(record)
    assert lb.summarize(tree).loc["C_XXX", "prior_mean"] == 0.0
    paper = lb.sample(lb.HybridModel.paper(0), simulated(plan()), sampler="quadrature", seed=1, rule=SHORT)
    assert result_json(paper)["parameters"]["C_XXX"]["prior_mean"] is None
