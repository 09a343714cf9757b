"""Campaigns of one machine: p-values uniform where it did not change, and one that did is named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fleets import dense, fleet
from scipy.stats import chi2, kstest

from ldbb_bayes.fleet.population import pool
from ldbb_bayes.fleet.repeats import changed_machines, repeat_p_values


def test_two_campaigns_are_compared_by_their_difference(rng: np.random.Generator) -> None:
    """The instrument known: (ĉ₁ − ĉ₂)ᵀ (A₁⁻¹ + A₂⁻¹)⁻¹ (ĉ₁ − ĉ₂)."""
    made = fleet(rng, machines=1, campaigns=2, parameters=3)
    scale = np.concatenate([made.prior_sd, made.instrument_sd])
    b = np.array([0.3, -0.2])
    covariance, estimates = np.zeros((3, 3)), []
    for information, weighted in zip(made.information * scale[:, None] * scale, made.weighted * scale, strict=True):
        covariance += np.linalg.inv(information[:3, :3])
        estimates.append(np.linalg.solve(information[:3, :3], weighted[:3] - information[:3, 3:] @ b))
    apart = estimates[0] - estimates[1]
    expected = chi2(3).sf(apart @ np.linalg.solve(covariance, apart))
    assert repeat_p_values(made, b, np.zeros((2, 2)))["M01"] == pytest.approx(expected, rel=1e-6)


def test_p_values_are_uniform() -> None:
    """The instrument known as little as before any campaign."""
    rng = np.random.default_rng(4)
    p = [repeat_p_values(fleet(rng, machines=1, campaigns=3), np.zeros(2), np.eye(2))["M01"] for _ in range(300)]
    assert kstest(p, "uniform").pvalue > 0.01


def test_a_machine_that_changed_is_named(rng: np.random.Generator) -> None:
    made = fleet(rng, machines=4, parameters=2)
    _, mean, covariance = dense(made, np.array([0.2, 0.2]))
    other = replace(made, machines=("a", "a", "b", "c"), weighted=made.weighted.copy())
    other.weighted[1] += other.information[1, :, 0] * 3.0 * made.prior_sd[0]
    assert changed_machines(other, mean[-2:], covariance[-2:, -2:]) == ["a"]
    assert changed_machines(made, mean[-2:], covariance[-2:, -2:]) == []
    assert "Campaigns of one machine contradict one another: a." in " ".join(pool(other).doubts)
