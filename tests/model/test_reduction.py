"""Readings reduced to at most 25 numbers per test."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ldbb_bayes.model.fourier import SIZE, basis
from ldbb_bayes.model.reduction import reduce_readings


@given(n=st.integers(9, 120), arc=st.floats(190.0, 720.0), seed=st.integers(0, 10**6))
def test_nothing_is_lost(n: int, arc: float, seed: int) -> None:
    """‖y − B a‖² = ‖z − R a‖² + residual for any coefficients a and any sampling."""
    rng = np.random.default_rng(seed)
    angle = np.deg2rad(np.sort(rng.uniform(0.0, arc, n)))
    y = rng.normal(size=n)
    a = rng.normal(size=SIZE)
    reduced = reduce_readings(angle, y)
    assert reduced.factor.shape == (min(n, SIZE), SIZE)
    direct = np.sum((y - basis(angle) @ a) ** 2)
    inside = np.sum((reduced.reading_mm - reduced.factor @ a) ** 2)
    assert inside + reduced.residual_ss == pytest.approx(direct, rel=1e-10)


def test_chunks_do_not_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(3)
    angle = rng.uniform(0.0, 7.0, 1000)
    y = rng.normal(size=1000)
    at_once = reduce_readings(angle, y)
    monkeypatch.setattr("ldbb_bayes.model.reduction._CHUNK", 33)
    chunked = reduce_readings(angle, y)
    gram = at_once.factor.T @ at_once.factor
    np.testing.assert_allclose(chunked.factor.T @ chunked.factor, gram, atol=1e-9)
    moment = at_once.factor.T @ at_once.reading_mm
    np.testing.assert_allclose(chunked.factor.T @ chunked.reading_mm, moment, atol=1e-9)
    assert chunked.residual_ss == pytest.approx(at_once.residual_ss, rel=1e-12)


@pytest.mark.parametrize(
    ("n", "arc", "uniform"),
    [
        (25, 360.0, True),
        (720, 360.0, True),
        (24, 360.0, False),
        (720, 220.0, False),
        (721, 360.5, True),
    ],
)
def test_uniform_circles_are_recognised(n: int, arc: float, uniform: bool) -> None:
    angle = np.deg2rad(33.0 + arc * np.arange(n) / n)
    assert (reduce_readings(angle, None).near_uniform is not None) is uniform


def test_a_planned_test_has_no_projection() -> None:
    angle = np.deg2rad(np.arange(0.0, 360.0, 10.0))
    assert reduce_readings(angle, None).reading_mm is None
