"""Power-scaling sensitivity."""

from __future__ import annotations

import numpy as np
import pytest
from arviz_stats.base import array_stats

from ldbb_bayes.inference.diagnostics import power_sensitivity


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
