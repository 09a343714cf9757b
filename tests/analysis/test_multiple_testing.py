"""Holm's adjustment (1979): the k-th smallest p-value times n + 1 − k."""

from __future__ import annotations

import numpy as np

from ldbb_bayes.analysis.multiple_testing import holm


def test_each_p_value_is_multiplied_by_its_rank() -> None:
    adjusted = holm(np.array([0.01, 0.04, 0.03, 0.005]))
    np.testing.assert_allclose(adjusted, [0.03, 0.06, 0.06, 0.02])


def test_none_exceeds_one() -> None:
    np.testing.assert_allclose(holm(np.array([0.9, 0.5])), [1.0, 1.0])
