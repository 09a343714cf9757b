"""RMSE and fitness."""

from __future__ import annotations

import numpy as np
import pytest
from campaigns import plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.inference.coefficients import mean_shared_coefficients
from ldbb_bayes.inference.residuals import fit_quality
from ldbb_bayes.model.fourier import basis

PHI = np.array([[0.3e-3, 0.5e-3, 0.4e-3, 2e-3]])


def test_rmse_and_fitness_by_their_definition() -> None:
    """Eq. 34-35 on the readings themselves; of a dead circle fitness is not a number."""
    measured = simulated(plan((9, 40, 50, 30)))
    dead = measured.tests[3].with_reading_um(np.zeros(30))
    campaign = lb.Campaign((*measured.tests[:3], dead))
    bound = lb.HybridModel.first(0).bind(campaign)
    beta = bound.least_squares_estimate[None].repeat(3, axis=0) * [[0.9], [1.0], [1.1]]
    phi = PHI.repeat(3, axis=0)
    quality = fit_quality(bound, phi, beta)
    coefficients = mean_shared_coefficients(bound, phi, beta)
    errors = [
        basis(test.angles_rad()) @ of_test - test.readings_mm()
        for test, of_test in zip(campaign.tests, coefficients, strict=True)
    ]
    assert quality.rmse_um == pytest.approx(np.sqrt(np.mean(np.concatenate(errors) ** 2)) * 1e3)
    assert np.isnan(quality.fitness_percent["f742"])
    for test, error in zip(campaign.tests[:3], errors[:3], strict=True):
        expected = 100 * (1 - np.sqrt(np.mean(error**2)) / np.ptp(test.readings_mm()))
        assert quality.fitness_percent[test.name] == pytest.approx(expected)
