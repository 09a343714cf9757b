"""Reduction of readings to at most 25 numbers per test loses nothing."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ldbb_bayes.model.fourier import SIZE, basis, reduce_readings


@given(n=st.integers(9, 120), arc=st.floats(190.0, 720.0), seed=st.integers(0, 10**6))
def test_nothing_is_lost(n: int, arc: float, seed: int) -> None:
    """‖y − B a‖² = ‖z − R a‖² + residual for any coefficients a and any sampling."""
    rng = np.random.default_rng(seed)
    angle = np.deg2rad(np.sort(rng.uniform(0.0, arc, n)))
    y, a = rng.normal(size=n), rng.normal(size=SIZE)
    reduced = reduce_readings(angle, y)
    assert reduced.factor.shape == (min(n, SIZE), SIZE)
    direct = np.sum((y - basis(angle) @ a) ** 2)
    assert np.sum((reduced.projection - reduced.factor @ a) ** 2) + reduced.residual_ss == pytest.approx(direct, rel=1e-10)


def test_chunks_do_not_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(3)
    angle, y = rng.uniform(0.0, 7.0, 1000), rng.normal(size=1000)
    whole = reduce_readings(angle, y)
    monkeypatch.setattr("ldbb_bayes.model.fourier._CHUNK", 33)
    parts = reduce_readings(angle, y)
    np.testing.assert_allclose(parts.factor.T @ parts.factor, whole.factor.T @ whole.factor, atol=1e-9)
    np.testing.assert_allclose(parts.factor.T @ parts.projection, whole.factor.T @ whole.projection, atol=1e-9)
    assert parts.residual_ss == pytest.approx(whole.residual_ss, rel=1e-12)


@pytest.mark.parametrize(
    ("n", "arc", "orthogonal"),
    [(25, 360.0, True), (720, 360.0, True), (24, 360.0, False), (720, 220.0, False), (721, 360.5, False)],
)
def test_uniform_circles_are_recognised(n: int, arc: float, orthogonal: bool) -> None:
    angle = np.deg2rad(33.0 + arc * np.arange(n) / n)
    assert reduce_readings(angle, None).is_orthogonal is orthogonal
    assert reduce_readings(angle, None).projection is None
