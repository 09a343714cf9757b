"""The simultaneous band against simulation and against another library."""

from __future__ import annotations

import arviz_stats.ecdf_utils
import numpy as np
import pytest

from ldbb_bayes.analysis.ranks import ecdf, simultaneous_band


@pytest.mark.parametrize(("replicates", "draws", "prob"), [(100, 99, 0.9), (30, 19, 0.8), (400, 49, 0.95), (12, 9, 0.99)])
def test_holds_with_the_probability_it_claims(replicates: int, draws: int, prob: float) -> None:
    lower, upper = simultaneous_band(replicates, draws, prob)
    rng = np.random.default_rng(1)
    every = np.array([ecdf(rng.integers(0, draws + 1, replicates), draws) for _ in range(4000)])
    share = np.mean(np.all((every >= lower) & (every <= upper), axis=1))
    error = np.sqrt(prob * (1.0 - prob) / 4000)
    assert prob - 4.0 * error < share < prob + 4.0 * error + 0.03, "counts are whole: a little more than asked for"


def test_against_another_library() -> None:
    level = np.arange(1, 100) / 100
    pointwise = arviz_stats.ecdf_utils.simulate_confidence_bands(500, 1, level, 0.95, 4000, np.random.default_rng(2))
    lower, upper = arviz_stats.ecdf_utils.get_pointwise_confidence_band(pointwise, 500, level)
    found = simultaneous_band(500, 99, 0.95)
    np.testing.assert_allclose(found[0], lower, atol=0.0041)
    np.testing.assert_allclose(found[1], upper, atol=0.0041)


def test_ecdf_counts_ranks() -> None:
    np.testing.assert_allclose(ecdf(np.array([0, 0, 3, 4]), 4), [0.5, 0.5, 0.5, 0.75])
