"""Leaving tests out: exact, campaign properties frozen, the sum of what each adds, replicates as the model has them."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from campaigns import oracle_of, plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.inference.evidence import evidence_on
from ldbb_bayes.inference.leave_one_out import harmonics_of, leave_one_out, pareto_smoothed, replicate_left_out
from ldbb_bayes.inference.quadrature import HyperPosterior
from ldbb_bayes.model.bound import BoundModel

CASES = {
    "uniform": (simulated(plan(), seed=1), 1, True),
    "arcs, clocked": (simulated(plan((30, 26, 40, 12), arc_deg=250.0, work_deg=35.0), seed=2), 1, False),
    "constant": (simulated(plan((30, 30, 30), forces_N=(36.0, 400.0, 742.0)), seed=3), 0, True),
}


PARAMETERS = [pytest.param(name, marks=pytest.mark.slow if name != "constant" else ()) for name in CASES]


def posterior_of(bound: BoundModel, *, truncated: bool) -> HyperPosterior:
    return HyperPosterior(bound, truncated=truncated)


def log_ratio(larger: BoundModel, smaller: BoundModel, posterior: HyperPosterior) -> float:
    """ln E[p(y_r | y_<r, φ)] over p(φ | y_<r), integrated on the nodes of the smaller posterior alone."""
    lattice = posterior.lattice(1e-3)
    gained = []
    for start in range(0, len(lattice.free), 256):
        phi = smaller.hyper_prior.phi(lattice.free[start : start + 256])
        (more, given_more), (less, given_less) = larger.given(phi), smaller.given(phi)
        gained.append(more - less)
        if posterior.truncated:
            gained[-1] = gained[-1] + given_more.orthant.log_value() - given_less.orthant.log_value()
    return float(np.logaddexp.reduce(np.log(lattice.weight) + np.concatenate(gained)))


@pytest.mark.parametrize("name", PARAMETERS)
def test_sequential_predictives_sum_to_the_evidence(name: str) -> None:
    """ln Z(y) = ln p(y_1) + Σ ln p(y_r | y_<r), every term over the posterior of the tests before."""
    campaign, degree, truncated = CASES[name]
    model = lb.HybridModel.default(degree)
    whole = (model if truncated else model.without("truncation")).bind(campaign)
    names = whole.test_names
    kept = [whole.keeping(names[:k]) for k in range(1, len(names) + 1)]
    first = posterior_of(kept[0], truncated=truncated)
    total = evidence_on(first, first.lattice(1e-2)).log_value
    for smaller, larger in itertools.pairwise(kept):
        total += log_ratio(larger, smaller, posterior_of(smaller, truncated=truncated))
    assert total == pytest.approx(lb.log_evidence(whole.model, campaign).log_value, abs=0.02)


@pytest.mark.parametrize("name", PARAMETERS)
def test_exact_and_from_a_cold_start(name: str) -> None:
    """The search that starts where the posterior of all tests had its mode finds what a search from nothing finds."""
    campaign, degree, truncated = CASES[name]
    model = lb.HybridModel.default(degree)
    bound = (model if truncated else model.without("truncation")).bind(campaign)
    posterior = posterior_of(bound, truncated=truncated)
    evidence = evidence_on(posterior, posterior.lattice(1e-2))
    left = leave_one_out(posterior, evidence)
    assert tuple(left) == bound.test_names
    for test, found in left.items():
        cold = posterior_of(bound.keeping([other for other in bound.test_names if other != test]), truncated=truncated)
        expected = evidence.log_value - evidence_on(cold, cold.lattice(1e-2)).log_value
        assert found.log_density == pytest.approx(expected, abs=5e-3)
        assert found.error < 2e-2


def test_properties_of_the_campaign_stay_frozen() -> None:
    """F0, force range, Ĉ and the bar lengths are the campaign's: leaving out an end force moves none of them."""
    campaign = simulated(plan(), seed=1)
    bound = lb.HybridModel.default(1).bind(campaign)
    rest = bound.keeping(bound.test_names[:-1])
    assert rest.setting.reference_force_N == bound.setting.reference_force_N == 389.0
    np.testing.assert_array_equal(rest.prior_sd, bound.prior_sd)
    np.testing.assert_array_equal(rest.setting.compliance_estimate, bound.setting.compliance_estimate)
    np.testing.assert_array_equal(rest.truncation.rows, bound.truncation.rows)
    mixed = lb.Campaign((*campaign.plan().tests[:3], lb.CircularTest(742.0, np.arange(40) * 9.0, radius_mm=100.0, name="small")))
    whole = lb.HybridModel.default(0).bind(simulated(mixed))
    names = [name for part in whole.nuisance_columns for name in getattr(part, "names", ())]
    without = [name for part in whole.keeping(whole.test_names[:3]).nuisance_columns for name in getattr(part, "names", ())]
    assert names == without
    assert "bar_length_100" in names


def test_importance_sampling_agrees_where_it_can(recovered: lb.Campaign) -> None:
    bound = lb.HybridModel.default(0).bind(recovered)
    posterior = posterior_of(bound, truncated=True)
    lattice = posterior.lattice(1e-2)
    left = leave_one_out(posterior, evidence_on(posterior, lattice))
    log_density, pareto_k, good_k = pareto_smoothed(posterior, lattice)
    trusted = pareto_k < good_k
    assert 0 < trusted.sum() < len(trusted)
    exact = np.array([found.log_density for found in left.values()])
    np.testing.assert_allclose(log_density[trusted], exact[trusted], atol=0.15)


@pytest.mark.parametrize("test", [0, 2])
def test_replicates_are_the_predictive_distribution(test: int) -> None:
    """Mean and covariance of harmonics of a left-out circle, at given hyper-parameters, from the dense oracle."""
    campaign = simulated(plan(), seed=4)
    model = lb.HybridModel.default(1).without("truncation")
    bound = model.bind(campaign)
    name = bound.test_names[test]
    posterior = posterior_of(bound, truncated=False)
    found = leave_one_out(posterior, evidence_on(posterior, posterior.lattice(1e-2)))[name]
    rng = np.random.default_rng(1)
    replicates = replicate_left_out(bound, found, 40_000, rng, each=4)

    oracle = oracle_of(campaign, 1)
    own = np.concatenate([np.full(t.angle.size, i == test) for i, t in enumerate(oracle.tests)])
    angle = oracle.tests[test].angle
    columns = np.column_stack([np.ones_like(angle), *(f(n * angle) for n in range(1, 13) for f in (np.cos, np.sin))])
    inverse = np.linalg.pinv(columns)
    means, covariances = [], []
    for free in found.lattice.pick(60, rng):
        covariance = oracle.covariance(found.posterior.bound.hyper_prior.phi(free))
        covariance = covariance + (oracle.J * oracle.sd**2) @ oracle.J.T
        gain = covariance[np.ix_(own, ~own)] @ np.linalg.inv(covariance[np.ix_(~own, ~own)])
        means.append(inverse @ (gain @ oracle.y[~own]))
        covariances.append(inverse @ (covariance[np.ix_(own, own)] - gain @ covariance[np.ix_(~own, own)]) @ inverse.T)
    mean = np.mean(means, axis=0)
    sd = np.sqrt(np.diag(np.mean(covariances, axis=0) + np.cov(np.array(means).T)))
    np.testing.assert_allclose(replicates.mean(axis=0) / sd, mean / sd, atol=0.06)
    np.testing.assert_allclose(replicates.std(axis=0), sd, rtol=0.08)
    observed = harmonics_of(bound, test) @ np.asarray(bound.reduced[test].projection)
    np.testing.assert_allclose(observed, inverse @ oracle.tests[test].reading, atol=1e-12)
