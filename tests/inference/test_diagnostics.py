"""Power-scaling sensitivity."""

from __future__ import annotations

import numpy as np
import pytest
from arviz_stats.base import array_stats

from ldbb_bayes.inference.diagnostics import diagnose, power_sensitivity


@pytest.mark.parametrize(
    ("chains", "draws"), [(1, 100), (2, 4), (4, 5), (4, 7), (4, 50), (4, 375), (9, 1000)]
)
def test_convergence_is_that_of_arviz(chains: int, draws: int) -> None:
    """Of white, slow, antithetic, constant and rounded draws, and of draws that come twice."""
    rng = np.random.default_rng(draws)
    chain = rng.normal(size=(chains, draws, 6))
    for t in range(1, draws):
        chain[:, t, 1:3] += np.array([0.95, -0.7]) * chain[:, t - 1, 1:3]
    chain[..., 3] = 1.0
    chain[..., 4] = np.round(chain[..., 4], 1)
    chain[:, 1::2, 5] = chain[:, ::2, 5][:, : draws // 2]
    axes = {"chain_axis": 0, "draw_axis": 1}
    with np.errstate(invalid="ignore", divide="ignore"):
        bulk = array_stats.ess(chain, method="bulk", **axes)
        tail = array_stats.ess(chain, method="tail", prob=(0.05, 0.95), **axes)
        rhat = array_stats.rhat(chain, method="rank", **axes)
    diagnostics = diagnose(chain)
    np.testing.assert_allclose(diagnostics.ess_bulk, bulk, rtol=1e-10)
    np.testing.assert_allclose(diagnostics.ess_tail, tail, rtol=1e-10)
    np.testing.assert_allclose(diagnostics.rhat, rhat, rtol=1e-10)


def test_convergence_of_what_has_none() -> None:
    """Of three draws, and of draws that are not numbers."""
    assert np.isnan(diagnose(np.zeros((4, 3, 2)))).all()
    chain = np.random.default_rng(1).normal(size=(4, 100, 2))
    chain[0, 0, 0] = np.nan
    diagnostics = np.array(diagnose(chain))
    assert np.isnan(diagnostics[:, 0]).all()
    assert np.isfinite(diagnostics[:, 1]).all()


def test_sensitivity_is_that_of_arviz() -> None:
    """Of plain weights, which are nearly even; a constant factor counts as none."""
    rng = np.random.default_rng(3)
    draws = {"a": rng.normal(size=(4, 300)), "b": rng.gamma(2.0, size=(4, 300))}
    factors = {
        "one": -0.5 * draws["a"] ** 2,
        "two": draws["a"] - draws["b"],
        "constant": np.ones((4, 300)),
    }
    sensitivity = power_sensitivity(draws, factors)
    for factor in ("one", "two"):
        lower = np.exp(-0.01 * factors[factor])
        upper = np.exp(0.01 * factors[factor])
        lower /= lower.sum()
        upper /= upper.sum()
        for name, values in draws.items():
            expected = array_stats.power_scale_sense(values, lower, upper, 0.99, 1.01)
            assert sensitivity[name][factor] == pytest.approx(float(expected), rel=1e-9)
    assert sensitivity["a"]["constant"] == 0.0
    assert sensitivity["b"]["constant"] == 0.0
