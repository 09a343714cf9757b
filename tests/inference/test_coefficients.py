"""Predictions in their layers against dense algebra."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from campaigns import oracle_of, plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.inference.coefficients import machine_coefficients, mean_shared_coefficients
from ldbb_bayes.inference.elastic_deflections import added_compliances
from ldbb_bayes.model.fourier import basis

PHI = np.array([[0.3e-3, 0.5e-3, 0.4e-3, 2e-3]])


def readings_of(campaign: lb.Campaign, coefficients: np.ndarray) -> np.ndarray:
    """Readings [mm] of all tests, of basis coefficients (tests, 25)."""
    readings = [
        basis(test.angles_rad()) @ of_test
        for test, of_test in zip(campaign.tests, coefficients, strict=True)
    ]
    return np.concatenate(readings)


@pytest.mark.parametrize(
    "planned",
    [plan(), plan((40, 50, 60, 45), arc_deg=220.0), plan(work_deg=40.0, compensated=False)],
)
def test_shared_layer_is_the_dense_conditional_mean(planned: lb.Campaign) -> None:
    """E[form + length + mount + force error | y, β, φ] = S Σ⁻¹ (y − Jβ).

    All terms but set-up shift, discrepancy and noise.
    """
    campaign = simulated(planned)
    bound = lb.HybridModel.first(1).bind(campaign)
    oracle = oracle_of(campaign, 1)
    beta = bound.least_squares_estimate[None] + 0.01 * bound.scale
    machine = oracle.J @ beta[0]
    residual = oracle.y - machine
    covariance = oracle.covariance(PHI[0])
    expected = machine + oracle.shared(PHI[0]) @ np.linalg.solve(covariance, residual)
    offset = np.concatenate([test.readings_mm() for test in campaign.tests]) - oracle.y
    predicted = readings_of(campaign, mean_shared_coefficients(bound, PHI, beta))
    np.testing.assert_allclose(predicted, expected + offset, atol=1e-9)
    predicted = readings_of(campaign, machine_coefficients(bound, beta)[0])
    np.testing.assert_allclose(predicted, machine + offset, atol=1e-12)


def test_a_joint_load_of_a_derived_class_adds_to_compliances(
    recovered: lb.Campaign, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The class is known to the package during this test only.
    monkeypatch.setattr(lb.terms.Term, "kinds", dict(lb.terms.Term.kinds))

    @dataclass(frozen=True)
    class StiffJointLoad(lb.terms.JointLoad):
        """A joint load of a class of its own."""

    model = lb.HybridModel.default(1)
    derived = model.without("joint-load").with_term(StiffJointLoad())
    labels = [entry.label for entry in added_compliances(model.bind(recovered))]
    assert labels == ["C_XXX", "C_YYY"]
    assert [entry.label for entry in added_compliances(derived.bind(recovered))] == labels
    assert added_compliances(model.without("joint-load").bind(recovered)) == []
