"""Order of equally good candidates: rounding errors do not decide."""

from __future__ import annotations

import numpy as np
import pytest

from ldbb_bayes.analysis.design.criteria import Determinant
from ldbb_bayes.analysis.design.objective import Objective
from ldbb_bayes.analysis.design.quick_forecast import QuickForecast
from ldbb_bayes.analysis.design.shares import largest_positions
from ldbb_bayes.analysis.design.ties import ascending_order


@pytest.mark.parametrize(
    ("values", "order"),
    [
        ([3.0, 1.0, 2.0], [1, 2, 0]),
        ([1.0 + 1e-12, 2.0, 1.0], [0, 2, 1]),
        ([2.0, np.inf, 1.0, np.inf], [2, 0, 1, 3]),
        ([np.nan, np.inf, 1.0, -np.inf], [3, 2, 0, 1]),
        ([], []),
    ],
)
def test_values_within_the_tolerance_keep_their_order(
    values: list[float], order: list[int]
) -> None:
    assert ascending_order(np.array(values), 1e-9).tolist() == order


def test_values_on_both_sides_of_any_threshold_are_equal() -> None:
    """No grid of rounded values has a border between two values that differ by rounding."""
    for middle in np.linspace(1.0, 2.0, 1001):
        values = np.array([middle - 1e-13, middle + 1e-13, 0.5])
        assert largest_positions(values, 2).tolist() == [0, 1]


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_of_two_equal_circles_the_first_is_run(rng: np.random.Generator, sign: float) -> None:
    """The same circle is listed twice; the second differs from the first by rounding alone."""
    circle = rng.standard_normal((2, 1, 4, 3))
    rows = np.concatenate([circle, circle * (1.0 + sign * 1e-14)], axis=1)
    prior = np.broadcast_to(np.eye(3), (2, 3, 3))
    objective = Objective(rows, prior, 1, Determinant(1))
    quick = QuickForecast(objective, np.full((2, 1), 0.3))
    assert quick.best_counts(5, np.zeros(2, dtype=int)).tolist() == [5, 0]
