"""Everything but s integrated out, against one dense Gaussian of all machines, their population and the instrument."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fleets import dense, fleet, scaled

from ldbb_bayes.fleet.pooling import (
    Common,
    back,
    cholesky,
    forward,
    log_determinant,
    pooling,
)
from ldbb_bayes.fleet.statistics import FleetStatistics

SPREAD = np.array([0.3, 0.05, 1.4])


@pytest.fixture
def statistics(rng: np.random.Generator) -> FleetStatistics:
    """Four machines, one of them with three campaigns, about a prior mean that is not zero."""
    found = fleet(rng, machines=6, parameters=3)
    return replace(found, machines=("a", "b", "b", "c", "d", "b"), prior_mean=np.array([0.4, -0.1, 0.2]) * found.prior_sd)


def test_log_density_is_the_dense_one(statistics: FleetStatistics) -> None:
    spreads = np.array([SPREAD, 0.5 * SPREAD, SPREAD[::-1]])
    found = pooling(statistics).common(spreads).log_density
    expected = np.array([dense(statistics, spread)[0] for spread in spreads])
    np.testing.assert_allclose(found - found[0], expected - expected[0], atol=1e-8)


def test_moments_are_the_dense_ones(statistics: FleetStatistics) -> None:
    pooled = pooling(statistics)
    assert pooled.machines == ("a", "b", "c", "d")
    assert pooled.campaigns.tolist() == [1, 3, 1, 1]
    _, mean, covariance = dense(statistics, SPREAD)
    spread = SPREAD[None]
    common = pooled.common(spread)
    np.testing.assert_allclose(common.mean[0], mean[12:], atol=1e-8)
    np.testing.assert_allclose(common.root[0] @ common.root[0].T, covariance[12:, 12:], atol=1e-9)
    (part,) = pooled.each(spread)
    middle, sd, share = pooled.estimates(part, common, spread)
    np.testing.assert_allclose(middle[:, 0].T.ravel(), mean[:12], atol=1e-8)
    np.testing.assert_allclose(sd[:, 0].T.ravel(), np.sqrt(np.diag(covariance)[:12]), atol=1e-8)
    z, variance = pooled.deviations(part, common)
    for m in range(4):
        pick = np.zeros((3, len(mean)))
        pick[:, m * 3 : m * 3 + 3], pick[:, 12:15] = np.eye(3), -np.eye(3)
        np.testing.assert_allclose(z[:, 0, m] * SPREAD, pick @ mean, atol=1e-8)
        np.testing.assert_allclose(variance[:, 0, m] * SPREAD**2, np.diag(pick @ covariance @ pick.T), atol=1e-8)
    assert ((share > 0.0) & (share < 1.0)).all()


def test_shrinkage_is_what_is_left_of_the_machines_variance(statistics: FleetStatistics) -> None:
    """μ and b known: a precise machine keeps nothing of it, one without readings all."""
    information, _ = scaled(statistics)
    pooled = pooling(statistics)
    (part,) = pooled.each(SPREAD[None])
    _, _, share = pooled.estimates(part, pooled.common(SPREAD[None]), SPREAD[None])
    left = np.linalg.inv(information[0][:3, :3] + np.diag(SPREAD**-2.0))
    np.testing.assert_allclose(share[:, 0, 0], np.diag(left) / SPREAD**2, rtol=1e-8)


def test_gradient_is_the_slope_of_the_density(statistics: FleetStatistics) -> None:
    pooled, t, h = pooling(statistics), np.log(SPREAD), 1e-5
    slope = pooled.excess(SPREAD[None])[0]
    for j, step in enumerate(h * np.eye(3)):
        above, below = pooled.common(np.exp(np.array([t + step, t - step]))).log_density
        assert slope[j] == pytest.approx((above - below) / (2.0 * h), rel=1e-7, abs=1e-7)


def test_one_machine_left_out(statistics: FleetStatistics) -> None:
    kept = [0, 3, 4]
    other = replace(
        statistics,
        campaigns=tuple(statistics.campaigns[k] for k in kept),
        machines=tuple(statistics.machines[k] for k in kept),
        information=statistics.information[kept],
        weighted=statistics.weighted[kept],
    )
    left = pooling(statistics).without(1)
    assert left.machines == ("a", "c", "d")
    found, expected = (own.common(SPREAD[None]) for own in (left, pooling(other)))
    for name in vars(found):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=1e-10, atol=1e-12)


def test_chunks_are_the_whole(rng: np.random.Generator) -> None:
    """Many spreads at once, and one by one."""
    pooled = pooling(fleet(rng, machines=300, parameters=2))
    spreads = rng.uniform(0.1, 0.5, (70, 2))
    together = pooled.common(spreads)
    assert isinstance(together, Common)
    single = [float(pooled.common(spread[None]).log_density[0]) for spread in spreads]
    np.testing.assert_allclose(together.log_density, single, rtol=1e-12)
    np.testing.assert_allclose(pooled.excess(spreads)[40], pooled.excess(spreads[40:41])[0], rtol=1e-9)


def test_stacks_are_numpy_s(rng: np.random.Generator) -> None:
    square = rng.standard_normal((5, 4, 4))
    matrix, right = square @ np.swapaxes(square, 1, 2) + np.eye(4), rng.standard_normal((5, 4, 2))
    lower = cholesky(np.moveaxis(matrix, 0, -1))
    solved = back(lower, forward(lower, np.moveaxis(right, 0, -1)))
    np.testing.assert_allclose(np.moveaxis(solved, -1, 0), np.linalg.solve(matrix, right), rtol=1e-9)
    np.testing.assert_allclose(log_determinant(lower), np.linalg.slogdet(matrix)[1], rtol=1e-12)
    with pytest.raises(np.linalg.LinAlgError, match="not positive definite"):
        cholesky(-np.moveaxis(matrix, 0, -1))
