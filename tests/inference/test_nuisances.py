"""Posterior of the nuisances against dense conditional Gaussians."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from campaigns import HYPER_UM, plan

import ldbb_bayes as lb
from ldbb_bayes.inference.posterior import draws_of
from ldbb_bayes.model.fourier import basis
from ldbb_bayes.model.hybrid import information_of
from ldbb_bayes.model.terms import Columns

MODEL = lb.HybridModel.default(0).without("truncation").including(lb.Drift("time"))


@pytest.fixture(scope="module")
def campaign() -> lb.Campaign:
    planned = plan((40,) * 6, forces_N=(36.0, 300.0, 742.0, 36.0, 300.0, 742.0))
    tests = [replace(t, direction="CW" if k < 3 else "CCW", time_s=600.0 * (k * 5 % 6)) for k, t in enumerate(planned.tests)]
    return MODEL.simulate(replace(planned, tests=tuple(tests)), seed=3, hyper_um=HYPER_UM).campaign


def test_against_dense_conditionals(campaign: lb.Campaign) -> None:
    """Means and variances of all coefficients given φ and the readings, parameters integrated out, by one dense matrix per draw
    of φ; then averaged over φ. Of parameters and nuisances alike nothing is sampled."""
    posterior = lb.sample(MODEL, campaign, seed=2, sampler="independent")
    found = lb.nuisances(posterior)
    bound = MODEL.bind(campaign)
    _, phi = draws_of(posterior, bound, 1000)
    reading = np.concatenate([test.readings_mm() for test in campaign.tests])
    means, variances = [], []
    for value in phi[::10]:
        named = dict(zip(bound.hyper_prior.names, value, strict=True))
        columns = [np.concatenate([basis(t.angles_rad()) @ bound.interest[r] for r, t in enumerate(campaign.tests)])]
        sd = [bound.prior_sd]
        covariance = np.eye(len(reading)) * named["sigma"] ** 2
        start = np.cumsum([0, *(len(t.angle_deg) for t in campaign.tests)])
        for term in bound.nuisance_columns:
            for r, test in enumerate(campaign.tests):
                part, own = slice(start[r], start[r + 1]), basis(test.angles_rad())
                if not isinstance(term, Columns):
                    covariance[part, part] += (own * (term.sd * named[term.hyper]) ** 2) @ own.T
                elif term.private:
                    covariance[part, part] += (own @ term.values[r] * term.sd**2) @ (own @ term.values[r]).T
            if isinstance(term, Columns) and not term.private:
                values = [basis(t.angles_rad()) @ term.values[r] for r, t in enumerate(campaign.tests)]
                columns.append(np.concatenate(values))
                sd.append(term.sd * (named[term.hyper] if term.hyper else 1.0))
        design, prior = np.concatenate(columns, axis=1), np.concatenate(sd)
        weight = np.linalg.solve(covariance, design)
        after = np.linalg.inv(design.T @ weight + np.diag(1.0 / prior**2))
        means.append((after @ weight.T @ reading)[len(bound.names) :])
        variances.append(np.diag(after)[len(bound.names) :])
    mean, sd = np.mean(means, axis=0), np.sqrt(np.mean(variances, axis=0) + np.var(means, axis=0))
    np.testing.assert_allclose((found["mean"] - mean) / sd, 0.0, atol=0.25)
    np.testing.assert_allclose(found["sd"] / sd, 1.0, atol=0.12)
    assert set(found.index) == set(information_of(bound, phi[0]).names) - set(bound.names)
    assert (found.loc["drift_time_length", "unit"], found.loc["hysteresis_sin2", "unit"]) == ("mm/h", "mm")
    flat = lb.sample(lb.HybridModel.paper(0), campaign, seed=1, sampler="independent", rule=lb.StoppingRule(ess=100.0))
    assert lb.nuisances(flat).empty
