"""Predictions in their layers against dense algebra."""

from __future__ import annotations

import numpy as np
import pytest
from campaigns import oracle_of, plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.inference.predictive import fit_quality, machine_coefficients, shared_coefficients
from ldbb_bayes.model.basis import basis

PHI = np.array([[0.3e-3, 0.5e-3, 0.4e-3, 2e-3]])


@pytest.mark.parametrize("planned", [plan(), plan((40, 50, 60, 45), arc_deg=220.0), plan(work_deg=40.0, compensated=False)])
def test_shared_layer_is_the_dense_conditional_mean(planned: lb.Campaign) -> None:
    """E[form + length + mount + force error | y, β, φ] = S Σ⁻¹ (y − Jβ), all terms but set-up shift, discrepancy and noise."""
    campaign = simulated(planned)
    bound, oracle = lb.HybridModel.default(1).bind(campaign), oracle_of(campaign, 1)
    beta = bound.centre[None] + 0.01 * bound.scale
    shared = oracle.fixed + PHI[0, 3] ** 2 * oracle.form_part
    residual = oracle.y - oracle.J @ beta[0]
    expected = oracle.J @ beta[0] + shared @ np.linalg.solve(oracle.covariance(PHI[0]), residual)
    offset = np.concatenate([t.readings_mm() for t in campaign.tests]) - oracle.y
    found = shared_coefficients(bound, PHI, beta)[0]
    predicted = np.concatenate([basis(t.angles_rad()) @ a for t, a in zip(campaign.tests, found, strict=True)])
    np.testing.assert_allclose(predicted, expected + offset, atol=1e-9)
    machine = machine_coefficients(bound, beta)[0]
    predicted = np.concatenate([basis(t.angles_rad()) @ a for t, a in zip(campaign.tests, machine, strict=True)])
    np.testing.assert_allclose(predicted, oracle.J @ beta[0] + offset, atol=1e-12)


def test_rmse_and_fitness_by_their_definition() -> None:
    """Eq. 34-35 on the readings themselves."""
    campaign = simulated(plan((9, 40, 50, 30)))
    bound = lb.HybridModel.default(0).bind(campaign)
    beta = bound.centre[None].repeat(3, axis=0) * [[0.9], [1.0], [1.1]]
    phi = PHI.repeat(3, axis=0)
    quality = fit_quality(bound, phi, beta)
    predicted = shared_coefficients(bound, phi, beta).mean(axis=0)
    errors = [basis(t.angles_rad()) @ a - t.readings_mm() for t, a in zip(campaign.tests, predicted, strict=True)]
    assert quality.rmse_um == pytest.approx(np.sqrt(np.mean(np.concatenate(errors) ** 2)) * 1e3)
    for test, error in zip(campaign.tests, errors, strict=True):
        expected = 100 * (1 - np.sqrt(np.mean(error**2)) / np.ptp(test.readings_mm()))
        assert quality.fitness_percent[test.name] == pytest.approx(expected)


def test_fitness_of_a_dead_circle_is_not_a_number() -> None:
    campaign = simulated(plan())
    dead = campaign.tests[0].with_reading_um(np.zeros(40))
    bound = lb.HybridModel.default(0).bind(lb.Campaign((dead, *campaign.tests[1:])))
    assert np.isnan(fit_quality(bound, PHI, bound.centre[None]).fitness_percent["f036"])
