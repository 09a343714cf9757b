"""What a reader sees first does not hang on rounding."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from ldbb_bayes.units import ranked

NUMBERS = st.lists(st.integers(-1000, 1000), max_size=12)


@given(NUMBERS, st.integers(0, 2**32 - 1))
def test_ranked_is_a_sort_that_rounding_does_not_change(values: list[int], seed: int) -> None:
    keys = [
        value * (1.0 + 1e-12 * x) for value, x in zip(values, np.random.default_rng(seed).normal(size=len(values)), strict=True)
    ]
    assert [values[i] for i in ranked(range(len(values)), keys.__getitem__)] == sorted(values, reverse=True)
    assert ranked(range(len(values)), keys.__getitem__) == ranked(range(len(values)), values.__getitem__)


def test_ranked_keeps_the_order_of_ties_and_infinities_first() -> None:
    keys = {"a": 1.0, "b": 1.0 + 1e-9, "c": np.inf, "d": 2.0}
    assert ranked("abcd", keys.__getitem__) == ["c", "d", "a", "b"]
