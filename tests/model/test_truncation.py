"""Quantiles of priors without negative compliances, against integrals and rejection."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import integrate, special

from ldbb_bayes.errors import InputError
from ldbb_bayes.model.truncation import Truncation

LEVELS = np.array([1e-6, 1e-4, 1e-3, 0.01, 0.1, 0.5, 0.9, 0.999])


@pytest.mark.parametrize("slope_sd", [1.0, 0.3, 0.05, 0.015, 0.005])
def test_quantiles_of_a_compliance_with_a_slope(slope_sd: float) -> None:
    """C ± slope / 2 ≥ 0 leaves C the density φ(C) (2 Φ(2 C / sd) − 1), C and slope being normal.

    The smallest slopes are those of a machine so stiff that its compliance may be zero.
    """
    rows = np.array([[1.0, -0.5], [1.0, 0.5]])
    level = np.stack([LEVELS, np.full(len(LEVELS), 0.5)], axis=1)
    compliance = Truncation(rows).quantile(level, np.zeros(2), np.array([1.0, slope_sd]))[:, 0]

    def density(value: float) -> float:
        inside = 2.0 * special.ndtr(2.0 * value / slope_sd) - 1.0
        return float(np.exp(-0.5 * value**2) * inside)

    def probability_below(value: float) -> float:
        edge = min(10.0 * slope_sd, value)
        near_zero = integrate.quad(density, 0.0, edge, epsabs=0.0)[0]
        return near_zero + integrate.quad(density, edge, value, epsabs=0.0)[0]

    total = probability_below(10.0)
    probabilities = [probability_below(value) / total for value in compliance]
    np.testing.assert_allclose(probabilities, LEVELS, rtol=2e-3, atol=0.0)


def test_small_quantiles_of_a_compliance_with_a_curvature(rng: np.random.Generator) -> None:
    """The reference force is none of the tested ones, where C may be slightly negative."""
    force = np.array([-325.0, -175.0, 25.0, 325.0])
    rows = np.stack([np.ones(4), force, force**2], axis=1)
    sd = np.array([1.0, 1e-1 / 650.0, 1e-1 / 650.0**2])
    normal = rng.standard_normal((1_000_000, 3)) * sd
    rejected = normal[(normal @ rows.T >= 0.0).all(axis=1)]
    level = rng.random((400, 3))
    level[:, 0] *= 0.01
    draws = Truncation(rows).quantile(level, np.zeros(3), sd)
    low = rejected[rejected[:, 0] < np.quantile(rejected[:, 0], 0.01)]
    assert draws[:, 0].min() > low[:, 0].min() - 1e-3
    for quantity in range(3):
        difference = draws[:, quantity].mean() - low[:, quantity].mean()
        error = np.hypot(draws[:, quantity].std() / 20.0, low[:, quantity].std() / len(low) ** 0.5)
        assert abs(difference) < 4.0 * error
        assert draws[:, quantity].std() == pytest.approx(low[:, quantity].std(), rel=0.2)


@pytest.mark.parametrize("mean", [[-50.0, 0.0], [0.0, 200.0]])
def test_a_prior_of_negative_compliances_alone_is_refused(mean: list[float]) -> None:
    """No floating-point number is small enough for its probability in the region."""
    rows = np.array([[1.0, -0.5], [1.0, 0.5]])
    with pytest.raises(InputError, match="prior must give some probability to compliances"):
        Truncation(rows).quantile(np.full((1, 2), 0.5), np.array(mean), np.ones(2))
