"""Leaving tests out: exact, campaign properties frozen, the sum of what each adds, replicates as the model has them."""

from __future__ import annotations

import numpy as np
import pytest
from campaigns import oracle_of, plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.inference.evidence import leave_one_out
from ldbb_bayes.inference.nodes import HyperPosterior
from ldbb_bayes.inference.predictive import harmonics_of, replicate_left_out


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


def test_replicates_are_the_predictive_distribution() -> None:
    """Mean and covariance of harmonics of a left-out circle, at given hyper-parameters, from the dense oracle."""
    test, campaign = 2, simulated(plan(), seed=4)
    model = lb.HybridModel.default(1).without("truncation")
    bound = model.bind(campaign)
    name = bound.test_names[test]
    left = leave_one_out(HyperPosterior(bound, truncated=False).nodes(1e-2))
    assert tuple(left) == bound.test_names
    found = left[name]
    cold = HyperPosterior(found.bound, truncated=False).nodes(1e-2)
    assert found.evidence.log_value == pytest.approx(cold.evidence.log_value, abs=5e-3)
    rng = np.random.default_rng(1)
    replicates = replicate_left_out(bound, found, name, 40_000, rng, each=4)

    oracle = oracle_of(campaign, 1)
    own = np.concatenate([np.full(t.angle.size, i == test) for i, t in enumerate(oracle.tests)])
    angle = oracle.tests[test].angle
    columns = np.column_stack([np.ones_like(angle), *(f(n * angle) for n in range(1, 13) for f in (np.cos, np.sin))])
    inverse = np.linalg.pinv(columns)
    means, covariances = [], []
    for free in found.lattice.pick(60, rng):
        covariance = oracle.covariance(found.bound.hyper_prior.phi(free))
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
