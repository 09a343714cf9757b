"""The posterior of the spreads against a fine grid, its mode, and what becomes of it where the machines show no spread."""

from __future__ import annotations

import numpy as np
import pytest
from fleets import fleet
from scipy.stats import halfnorm

from ldbb_bayes.fleet.pooling import SpreadDensity, draw_spreads, pooling
from ldbb_bayes.inference.posterior import pareto_smooth

SCALE = 0.3


def density(rng: np.random.Generator, **options: object) -> SpreadDensity:
    return SpreadDensity(pooling(fleet(rng, **options)), SCALE)  # type: ignore[arg-type]


@pytest.mark.parametrize("spread", [0.0, 0.2])
@pytest.mark.parametrize("parameters", [1, 2])
def test_draws_are_those_of_a_grid(rng: np.random.Generator, parameters: int, spread: float) -> None:
    """Over s itself with its half-normal prior: neither logarithm nor Jacobian."""
    target = density(rng, machines=5, parameters=parameters, spread=spread)
    axis = (np.arange(240) + 0.5) * 1.5 / 240
    grid = np.stack(np.meshgrid(*[axis] * parameters, indexing="ij"), axis=-1).reshape(-1, parameters)
    log_weight = target.pooling.common(grid).log_density + halfnorm(scale=SCALE).logpdf(grid).sum(axis=1)
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    mean = weight @ grid
    sd = np.sqrt(weight @ (grid - mean) ** 2)
    draws = draw_spreads(target, seed=1)
    assert draws.trusted
    np.testing.assert_allclose((draws.weight @ draws.spread - mean) / sd, 0.0, atol=0.03)
    np.testing.assert_allclose(np.sqrt(draws.weight @ (draws.spread - draws.weight @ draws.spread) ** 2), sd, rtol=0.04)


@pytest.mark.parametrize("options", [{"machines": 3}, {"machines": 40}, {"machines": 6, "spread": 0.0}, {"spread": 3.0}])
def test_the_mode_does_not_hang_on_the_start(rng: np.random.Generator, options: dict[str, float]) -> None:
    target = density(rng, **options)
    found, curvature = target.mode()
    assert np.abs(target.gradient(found[None])).max() < 1e-9 * curvature.max()
    for start in (found + 1.0, found - 1.5):
        np.testing.assert_allclose(target.mode(start)[0], found, atol=1e-9)


def test_the_gradient_has_prior_and_jacobian(rng: np.random.Generator) -> None:
    target, h = density(rng, machines=4, parameters=2), 1e-5
    t = np.array([-1.0, -3.0])
    for j, step in enumerate(h * np.eye(2)):
        above, below = target.log(np.array([t + step, t - step]))
        assert target.gradient(t[None])[0, j] == pytest.approx((above - below) / (2.0 * h), rel=1e-7)
    other = t + np.array([0.3, 0.0])
    prior = np.diff(halfnorm(scale=SCALE).logpdf(np.exp([t, other])).sum(axis=1) + np.array([t.sum(), other.sum()]))
    apart = np.diff(target.log(np.array([t, other]))) - np.diff(target.pooling.common(np.exp([t, other])).log_density)
    assert apart == pytest.approx(prior, rel=1e-9)


@pytest.mark.parametrize("scale", [1e-8, 1e-3, 30.0])
def test_any_prior_of_the_spread_will_do(rng: np.random.Generator, scale: float) -> None:
    target = SpreadDensity(pooling(fleet(rng, machines=5)), scale)
    draws = draw_spreads(target, seed=1, size=8192)
    assert draws.trusted
    assert draws.effective > 1000.0
    if scale < 1e-6:
        np.testing.assert_allclose(draws.weight @ draws.spread, scale * np.sqrt(2.0 / np.pi), rtol=0.03)


def test_readings_that_say_nothing_leave_the_prior(rng: np.random.Generator) -> None:
    draws = draw_spreads(density(rng, machines=3, parameters=2, known=1e6), seed=1)
    np.testing.assert_allclose(draws.weight @ draws.spread, SCALE * np.sqrt(2.0 / np.pi), rtol=0.03)
    np.testing.assert_allclose(draws.weight @ draws.spread**2, SCALE**2, rtol=0.05)


def test_the_first_draws_are_draws(rng: np.random.Generator) -> None:
    draws = draw_spreads(density(rng, machines=10, parameters=2), seed=1)
    few = draws.first(256)
    assert len(few.weight) == 256
    assert few.weight.sum() == pytest.approx(1.0)
    np.testing.assert_allclose(few.weight @ few.spread, draws.weight @ draws.spread, rtol=0.03)
    assert draws.first(4096) is draws


def test_smoothed_weights(rng: np.random.Generator) -> None:
    """Light tails stay as they are; a tail without a variance is seen."""
    log_ratio = 0.1 * rng.standard_normal(1000)
    weight, k, good = pareto_smooth(log_ratio)
    assert k < 0.5 < good
    plain = np.exp(log_ratio) / np.exp(log_ratio).sum()
    np.testing.assert_allclose(weight, plain, rtol=0.1)
    _, heavy, _ = pareto_smooth(-1.2 * np.log(rng.uniform(size=1000)))
    assert heavy > 0.9
    equal, none, _ = pareto_smooth(np.zeros(100))
    assert none == -np.inf
    assert equal == pytest.approx(np.full(100, 0.01))
    alone, infinite, _ = pareto_smooth(np.concatenate([[0.0], np.full(99, -2000.0)]))
    assert alone[0] == pytest.approx(1.0)
    assert infinite == np.inf
