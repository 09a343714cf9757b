"""Holm's adjustment (1979): the k-th smallest p-value times n + 1 − k. Pooled p-values: their
size where nothing is wrong, and values known otherwise."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2, norm

from ldbb_bayes.analysis.multiple_testing import holm, pooled_p_value, uniformity_p_value


def test_each_p_value_is_multiplied_by_its_rank() -> None:
    adjusted = holm(np.array([0.01, 0.04, 0.03, 0.005]))
    np.testing.assert_allclose(adjusted, [0.03, 0.06, 0.06, 0.02])


def test_none_exceeds_one() -> None:
    np.testing.assert_allclose(holm(np.array([0.9, 0.5])), [1.0, 1.0])


def test_a_single_p_value_is_pooled_to_itself() -> None:
    assert pooled_p_value(np.array([0.03])) == pytest.approx(0.03)


def test_equal_p_values_are_pooled_to_themselves() -> None:
    assert pooled_p_value(np.full(5, 0.2)) == pytest.approx(0.2)


@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.95])
def test_pooled_p_values_hold_their_size_where_tests_are_correlated(correlation: float) -> None:
    rng = np.random.default_rng(1)
    common = rng.standard_normal((20_000, 1))
    single = rng.standard_normal((20_000, 7))
    z = np.sqrt(correlation) * common + np.sqrt(1.0 - correlation) * single
    assert np.mean(pooled_p_value(norm.sf(z)) < 0.05) == pytest.approx(0.05, abs=0.01)


def test_fisher_does_not_hold_its_size_where_tests_are_correlated() -> None:
    """Pooling as if the tests were independent fails, so that the test before can."""
    rng = np.random.default_rng(1)
    z = rng.standard_normal((2000, 1)) + 0.2 * rng.standard_normal((2000, 7))
    p_values = norm.sf(z / np.hypot(1.0, 0.2))
    fisher = -2.0 * np.log(p_values).sum(axis=1)
    assert np.mean(chi2(14).sf(fisher) < 0.05) > 0.15


@pytest.mark.parametrize("count", [4, 7, 20])
def test_uniform_values_alarm_in_one_of_twenty(count: int) -> None:
    values = np.random.default_rng(2).random((10_000, count))
    assert np.mean(uniformity_p_value(values) < 0.05) == pytest.approx(0.05, abs=0.015)


def test_values_that_are_all_too_large_are_found() -> None:
    assert uniformity_p_value(np.full(7, 0.95)) < 0.001


def test_values_that_are_all_rather_small_are_found_where_holm_finds_none() -> None:
    values = np.linspace(0.01, 0.1, 7)
    assert holm(values).min() > 0.05
    assert uniformity_p_value(values) < 0.001
