"""The exact evidence against brute force on the dense oracle, to 1e-6, and what it refuses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from campaigns import oracle_of, plan, simulated
from oracle import Oracle
from pairs import pair_by_quadrature
from scipy import stats

import ldbb_bayes as lb
from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.evidence import evidence_of, log_prob_truncation
from ldbb_bayes.inference.origin import record_of
from ldbb_bayes.inference.quadrature import HyperPosterior

SMALL = lb.HybridModel.default(0).without("ball-form", "setup-shift")
FORCES_N = (100.0, 400.0, 742.0)


@pytest.fixture(scope="module")
def campaign() -> lb.Campaign:
    return simulated(plan((26, 20, 30), forces_N=FORCES_N), seed=3)


def brute_force(oracle: Oracle, *, truncated: bool) -> float:
    """ln ∫∫ p(y | σ, κ) p(σ) p(κ) [P(T | y, σ, κ) / P(T)] dσ dκ by Gauss-Legendre rules over the dense oracle, panel by panel."""
    nodes, weights = np.polynomial.legendre.leggauss(12)

    def panels(edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        half = np.diff(edges) / 2.0
        points = (edges[:-1] + half)[:, None] + half[:, None] * nodes
        return points.ravel(), (half[:, None] * weights).ravel()

    floor = oracle.resolution / np.sqrt(12.0)
    sigma, sigma_weight = panels(np.geomspace(floor, 5e-3, 9))
    kappa, kappa_weight = panels(np.array([0.0, 2e-4, 5e-4, 1e-3, 2e-3, 3.5e-3, 6e-3, 9e-3]))
    log_prior = stats.halfnorm.logpdf(sigma, scale=1e-3) - stats.halfnorm.logsf(floor, scale=1e-3)
    values, doubt = np.empty((len(sigma), len(kappa))), np.zeros((len(sigma), len(kappa)))
    for i, s in enumerate(sigma):
        for j, k in enumerate(kappa):
            log_evidence, mean, covariance = oracle.given(np.array([s, k]))
            values[i, j] = log_evidence + stats.halfnorm.logpdf(k, scale=1e-3)
            if truncated:
                distance = mean[[0, 2, 5]] / np.sqrt(np.diag(covariance)[[0, 2, 5]])
                doubt[i, j] = stats.norm.sf(distance[:2]).sum()
                values[i, j] += stats.norm.logcdf(distance[2]) - np.log(1 / 8)
    total = values + (log_prior + np.log(sigma_weight))[:, None] + np.log(kappa_weight)
    assert np.average(doubt, weights=np.exp(total - total.max())) < 1e-8, "C_XXX and C_YYY hold"
    return float(np.logaddexp.reduce(total.ravel()))


@pytest.mark.parametrize("truncated", [False, True])
def test_to_a_millionth_of_a_nat(campaign: lb.Campaign, truncated: bool) -> None:
    model = SMALL if truncated else SMALL.without("truncation")
    oracle = oracle_of(campaign, 0, terms=("length", "mount", "force", "discrepancy"))
    found = lb.log_evidence(model, campaign, tolerance=1e-7)
    assert found.error < 1e-6
    assert found.log_value == pytest.approx(brute_force(oracle, truncated=truncated), abs=1e-6, rel=0.0)


@pytest.mark.parametrize("degree", [0, 1])
def test_the_stated_error_holds(degree: int) -> None:
    """A loose tolerance against a tight one, arcs and clockings, all four hyper-parameters."""
    plans = (plan(), plan((30, 26, 40, 12), arc_deg=250.0, work_deg=35.0))
    for seed, planned in enumerate(plans):
        bound = lb.HybridModel.default(degree).bind(simulated(planned, seed=seed))
        plain = HyperPosterior(bound, truncated=False)
        loose, tight = evidence_of(plain, tolerance=1e-2), evidence_of(plain, tolerance=1e-4)
        assert loose.error <= 1e-2
        assert abs(loose.log_value - tight.log_value) <= loose.error
        assert tight.nodes > loose.nodes


def test_truncation_raises_the_evidence_of_what_it_allows(recovered: lb.Campaign) -> None:
    """ln Z_T = ln Z + ln P(T | y) − ln P(T): three free compliances of one sign in eight."""
    model = lb.HybridModel.default(0)
    plain, truncated = lb.log_evidence(model.without("truncation"), recovered), lb.log_evidence(model, recovered)
    posterior = lb.sample(model, recovered, sampler="quadrature", seed=1)
    log_prob = record_of(posterior)["fit"]["log_prob_truncation"]
    assert truncated.log_value - plain.log_value == pytest.approx(log_prob - np.log(1 / 8), abs=0.02)


@pytest.mark.parametrize(
    ("model", "planned", "tolerance", "message"),
    [
        (lb.HybridModel.paper(0), False, 1e-3, "must have a proper prior to have an evidence, got a flat one"),
        (SMALL, True, 1e-3, "must have readings to give an evidence, got a plan"),
        (SMALL, False, 0.0, "tolerance must be a positive number of nats, got 0"),
    ],
)
def test_refused(campaign: lb.Campaign, model: lb.HybridModel, planned: bool, tolerance: float, message: str) -> None:
    with pytest.raises(InputError, match=message):
        lb.log_evidence(model, plan() if planned else campaign, tolerance=tolerance)


@pytest.mark.parametrize(("degree", "without"), [(2, ()), (1, ("discrepancy",)), (1, ("setup-shift", "discrepancy"))])
def test_readings_of_the_wrong_sign(recovered: lb.Campaign, degree: int, without: tuple[str, ...]) -> None:
    """All compliances negative and strongly correlated through the mount: far from physical, and said so at once."""
    flipped = replace(recovered, tests=tuple(t.with_reading_um(-np.asarray(t.reading_um)) for t in recovered.tests))
    bound = lb.HybridModel.default(degree).without(*without).bind(flipped)
    plain, truncated = HyperPosterior(bound, truncated=False), HyperPosterior(bound, truncated=True)
    found = log_prob_truncation(plain, truncated)
    assert -2000.0 < found.log_value < -50.0
    assert found.error < 0.5
    assert truncated.log_density(truncated.mode[None])[0] < plain.log_density(plain.mode[None])[0] - 40.0


def test_a_strong_contradiction_by_one_dimensional_quadrature() -> None:
    """Two direct compliances far below zero, σ the only hyper-parameter: dense oracle and a plain sum over σ."""
    terms = ("setup-shift", "discrepancy", "ball-form", "force-error")
    planned = plan((60,) * 6, forces_N=(36.0, 100.0, 250.0, 400.0, 600.0, 742.0))
    model = lb.HybridModel.default(0).without(*terms)
    truth = {"C_XXX": -2e-5, "C_YYY": -8e-5, "C_CCY": 4e-10}
    campaign = model.simulate(planned, seed=4, parameters=truth, hyper_um={"sigma": 0.1}).campaign
    oracle = oracle_of(campaign, 0, terms=("length", "mount"))
    bound = model.bind(campaign)
    free = np.log(1e-3) + np.linspace(-9.0, 1.5, 211)
    log_density = np.empty(len(free))
    for i, value in enumerate(free):
        phi = bound.hyper_prior.phi(np.array([[value]]))[0]
        log_evidence, mean, covariance = oracle.given(phi)
        rows = bound.physical.rows[:2]
        spread = rows @ covariance @ rows.T
        sd = np.sqrt(np.diag(spread))
        pair = pair_by_quadrature(tuple(rows @ mean / sd), float(spread[0, 1] / sd.prod()))
        log_density[i] = log_evidence + bound.hyper_prior.log_density_of_free(np.array([[value]]))[0] + pair
    top = log_density.max()
    expected = top + np.log(np.trapezoid(np.exp(log_density - top), free)) - 3.0 * np.log(0.5)
    assert lb.log_evidence(model, campaign).log_value == pytest.approx(expected, abs=5e-3)
