"""Control charts: limits cover as they say, points and levels are those of dense systems."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import halfnorm

from ldbb_bayes.fleet.change import Series, carry, chart_of, instrument_moments, levels_of, scatter_rule, steps_of, weigh

Array = NDArray[np.float64]
P, S = 2, 1
SCALE, CHANGE = 0.02, 0.2


def drawn(rng: np.random.Generator, n: int, *, r: float | None = None, step: tuple[int, int, float] | None = None) -> Series:
    """Of the model: campaigns that see parameters and instrument each in their own way, some hardly at all."""
    root = rng.standard_normal((n, P + S, P + S + 1)) * np.array([60.0, 4.0, 40.0])[:, None]
    information = root @ np.swapaxes(root, 1, 2)
    own = halfnorm(scale=SCALE).rvs(random_state=rng) if r is None else r
    level = rng.standard_normal(P) + own * rng.standard_normal((n, P))
    if step is not None:
        level[step[0] :, step[1]] += step[2]
    z = np.concatenate([level, np.full((n, S), rng.standard_normal())], axis=1)
    noise = np.einsum("tab,tb->ta", np.linalg.cholesky(information), rng.standard_normal((n, P + S)))
    return Series(information, np.einsum("tab,tb->ta", information, z) + noise, P)


def analysed(series: Series):  # type: ignore[no-untyped-def]
    nodes, prior = scatter_rule(SCALE)
    carried = carry(series, nodes)
    steps = steps_of(carried, CHANGE)
    return nodes, prior, carried, steps, weigh(steps, prior, 0.5)


@pytest.mark.slow
@pytest.mark.parametrize("limits", [0.997, 0.8])
def test_limits_cover_as_they_say(limits: float) -> None:
    """Where nothing changes; of every campaign from the second on, and of the early ones by themselves."""
    rng = np.random.default_rng(5)
    inside = []
    for _ in range(150):
        series = drawn(rng, 7)
        nodes, prior, carried, steps, weights = analysed(series)
        chart = chart_of(series, carried, nodes, prior, instrument_moments(steps, weights, P), limits=limits)
        assert np.isnan(chart.limits[:, 0]).all()
        inside.append((chart.own > chart.limits[0]) & (chart.own < chart.limits[1]))
    share = np.mean(np.array(inside)[:, 1:], axis=(0, 2))
    error = np.sqrt(limits * (1.0 - limits) / 300)
    np.testing.assert_allclose(share, limits, atol=3.5 * error)
    assert share.mean() == pytest.approx(limits, abs=3.0 * error / np.sqrt(3))


@pytest.mark.slow
def test_too_narrow_limits_would_be_seen() -> None:
    """Of a machine that changes ten times as much as the prior has it."""
    rng = np.random.default_rng(6)
    inside = []
    for _ in range(60):
        series = drawn(rng, 3, r=10 * SCALE)
        nodes, prior, carried, steps, weights = analysed(series)
        chart = chart_of(series, carried, nodes, prior, instrument_moments(steps, weights, P), limits=0.8)
        inside.append((chart.own[1:, 0] > chart.limits[0, 1:, 0]) & (chart.own[1:, 0] < chart.limits[1, 1:, 0]))
    assert np.mean(inside) < 0.65


def test_instrument_and_levels_by_drawing_from_every_hypothesis() -> None:
    """Draws of (c, Δ | b at its mean) and of b from each hypothesis, by its dense system."""
    rng = np.random.default_rng(7)
    n, q = 5, P + S
    series = drawn(rng, n, r=0.02, step=(3, 0, 0.12))
    nodes, _, carried, steps, weights = analysed(series)
    mean, covariance = instrument_moments(steps, weights, P)
    levels = levels_of(series, nodes, weights, mean, CHANGE)
    seen, level, total = [], [], []
    for i in range(len(nodes)):
        for k, j in [(n, 0), *((k, j) for k in range(1, n) for j in range(P))]:
            weight = weights.none[i] if k == n else weights.change[i, k - 1, j]
            if weight < 1e-6:
                continue
            take = np.zeros((n, q, q + 1))
            take[:, :, :q] = np.eye(q)
            take[k:, j, q] = 1.0
            precision = np.einsum("tai,tab,tbj->ij", take, carried.information[i], take) + np.diag([*np.ones(q), CHANGE**-2])
            pull = np.einsum("tai,ta->i", take, carried.weighted[i])
            inside = np.linalg.inv(precision)
            count = 200
            seen.append(rng.multivariate_normal(inside @ pull, inside, count)[:, P:q])
            keep = [*range(P), q]
            given = np.linalg.inv(precision[np.ix_(keep, keep)])
            centre = given @ (pull[keep] - precision[np.ix_(keep, range(P, q))] @ mean)
            draws = rng.multivariate_normal(centre, given, count)
            level.append(draws[:, None, :P] + draws[:, None, P:] * take[:, :P, q])
            total.append(np.full(count, weight / count))
    weight = np.concatenate(total)
    b, c = np.concatenate(seen), np.concatenate(level)
    assert weight.sum() == pytest.approx(1.0, abs=1e-3)
    assert weight @ b[:, 0] / weight.sum() == pytest.approx(mean[0], abs=0.1 * np.sqrt(covariance[0, 0]))
    assert weight @ (b[:, 0] - mean[0]) ** 2 == pytest.approx(covariance[0, 0], rel=0.1)
    sd = np.sqrt(np.einsum("h,hta->ta", weight, (c - levels.mean) ** 2))
    np.testing.assert_allclose((np.einsum("h,hta->ta", weight, c) - levels.mean) / sd, 0.0, atol=0.1)
    np.testing.assert_allclose(sd, levels.sd, rtol=0.08)
    within = np.einsum("h,hta->ta", weight, (c > levels.interval[0]) & (c < levels.interval[1]))
    np.testing.assert_allclose(within, 0.95, atol=0.02)


def test_points_are_posteriors_of_campaigns_alone() -> None:
    series = drawn(np.random.default_rng(8), 4)
    nodes, prior, carried, _, _ = analysed(series)
    known, spread = np.array([0.4]), np.array([[0.25]])
    chart = chart_of(series, carried, nodes, prior, (known, spread))
    for t in range(4):
        own = np.linalg.inv(series.information[t, :P, :P] + np.eye(P))
        moved = own @ series.information[t, :P, P:]
        np.testing.assert_allclose(chart.own[t], own @ series.weighted[t, :P] - moved @ known)
        np.testing.assert_allclose(chart.own_sd[t], np.sqrt(np.diag(own)))
    both = np.concatenate(
        [series.information[:, :P, :P].sum(axis=0) + np.eye(P), series.information[:, :P, P:].sum(axis=0)], axis=1
    )
    levels = [np.linalg.solve(both[:, :P], series.weighted[:, :P].sum(axis=0) - both[:, P:] @ b) for b in (known, known + 0.5)]
    np.testing.assert_allclose(chart.common_sd, np.abs(levels[1] - levels[0]))
    other = chart_of(series, carried, nodes, prior, (known + 1.0, spread))
    np.testing.assert_allclose(other.limits[:, 1:] - other.own[1:], chart.limits[:, 1:] - chart.own[1:], atol=1e-9)
