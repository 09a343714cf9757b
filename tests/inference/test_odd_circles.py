"""Circles that scatter far more than circles usually do."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from scipy.stats import gamma

from ldbb_bayes.inference import odd_circles as module
from ldbb_bayes.inference.odd_circles import OddCircle, odd_circles


@pytest.fixture
def posterior(monkeypatch: pytest.MonkeyPatch) -> xr.DataTree:
    tests = tuple(SimpleNamespace(name=name) for name in ("a", "b", "without factor"))
    bound = SimpleNamespace(campaign=SimpleNamespace(tests=tests))
    monkeypatch.setattr(module, "bound_of", lambda _: bound)
    factors = np.linspace(0.0, 1.0, 2001).reshape(1, -1)
    draws = xr.Dataset(
        {
            "lambda_a": (("chain", "draw"), 2.0 + 4.0 * factors),
            "lambda_b": (("chain", "draw"), 5.0 + 10.0 * factors),
        }
    )
    return xr.DataTree.from_dict({"posterior": draws})


def test_a_circle_is_odd_if_the_whole_interval_is_above_the_limit(posterior: xr.DataTree) -> None:
    """Uniform draws from 2 to 6 reach below 2.5; of those from 5 to 15 it is 5.25 to 14.75."""
    (circle,) = odd_circles(posterior)
    assert circle == OddCircle("b", pytest.approx(10.0), pytest.approx((5.25, 14.75)))


def test_every_thirteenth_circle_exceeds_the_limit_under_the_prior() -> None:
    """λ² ~ InvGamma(3/2, 3/2), so that 1 / λ² ~ Gamma(3/2, rate 3/2)."""
    exceeds = gamma.cdf(1.0 / module.LARGE_NOISE_FACTOR**2, 1.5, scale=1.0 / 1.5)
    assert 1.0 / exceeds == pytest.approx(13.0, abs=0.5)
