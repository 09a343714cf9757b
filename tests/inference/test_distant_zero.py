"""The constant that all readings have in common is as large as it is said to be expected."""

from __future__ import annotations

import numpy as np
import pytest

import ldbb_bayes as lb
from ldbb_bayes.inference import distant_zero

SIMULATIONS = 60
DRAWS = 200


def test_the_constant_has_the_stated_standard_deviation(
    recovered: lb.Campaign, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Over campaigns that the model simulates, the distance is normal with a third of the limit.

    The hyper-parameters are those of the simulation, and the parameters are drawn from their
    conditional distribution, so that no sampler is needed. Every distance is returned, because the
    limit is made very small.
    """
    tiny = 1e-9
    monkeypatch.setattr(distant_zero, "_LARGEST_DISTANCE", tiny)
    model = lb.HybridModel.default(1)
    plan = recovered.plan()
    distances = []
    for seed in range(SIMULATIONS):
        simulation = model.simulate(plan, seed=seed)
        bound = model.bind(simulation.campaign)
        hyper_um = [simulation.hyper_um[name] for name in bound.hyper_prior.names]
        phi = np.array(hyper_um) / bound.hyper_prior.display_factors
        conditional = bound.given(phi[None]).parameters
        spread = conditional.spread()[0]
        white = np.random.default_rng(seed).standard_normal((DRAWS, spread.shape[1]))
        beta = conditional.mean[0] + white @ spread.T
        (zero,) = distant_zero.distant_zeros(bound, np.tile(phi, (DRAWS, 1)), beta)
        distances.append(zero.distance_mm / (zero.expected_mm / tiny))
    assert np.mean(distances) == pytest.approx(0.0, abs=3.3 / np.sqrt(SIMULATIONS))
    assert np.std(distances) == pytest.approx(1.0, abs=3.3 / np.sqrt(2 * SIMULATIONS))
