"""Steps in a series of campaigns against stacked normal distributions, brute force and simulation from the model itself."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import block_diag
from scipy.stats import halfnorm, multivariate_normal, norm

from ldbb_bayes.fleet.change import Series, carry, scatter_rule, steps_of, weigh

Array = NDArray[np.float64]
P, S = 3, 2


def informations(rng: np.random.Generator, n: int, size: float = 300.0) -> Array:
    """Full rank, of very different directions."""
    root = rng.standard_normal((n, P + S, P + S + 1)) * np.sqrt(size) * np.array([3.0, 1.0, 0.1, 1.0, 0.5])[:, None]
    return root @ np.swapaxes(root, 1, 2)


def drawn(rng: np.random.Generator, information: Array, level: Array, instrument: Array) -> Array:
    """η of campaigns at given parameters: its mean is Λ z, its covariance Λ."""
    z = np.concatenate([level, np.broadcast_to(instrument, (len(level), len(instrument)))], axis=1)
    values, vectors = np.linalg.eigh(information)
    root = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    return np.einsum("tab,tb->ta", information, z) + np.einsum("tab,tb->ta", root, rng.standard_normal(z.shape))


def stacked(series: Series, r: float, change_scale: float, step: tuple[int, int] | None) -> float:
    """ln p(maxima of the likelihoods, all campaigns in one vector), by its whole covariance."""
    n, p = len(series), series.parameters
    q = series.information.shape[1]
    take = np.tile(np.eye(q), (n, 1))
    whole = take @ take.T + np.kron(np.eye(n), np.diag([r**2] * p + [0.0] * (q - p)))
    whole += block_diag(*map(np.linalg.inv, series.information))
    if step is not None:
        k, j = step
        moved = np.zeros(n * q)
        moved[j + q * k :: q] = 1.0
        whole += change_scale**2 * np.outer(moved, moved)
    maxima = np.linalg.solve(series.information, series.weighted[:, :, None]).ravel()
    return float(multivariate_normal(np.zeros(n * q), whole).logpdf(maxima))


@pytest.fixture(scope="module")
def series() -> Series:
    rng = np.random.default_rng(3)
    information = informations(rng, 5)
    level = np.tile([0.5, -0.2, 0.1], (5, 1)) + 0.02 * rng.standard_normal((5, P))
    level[3:, 0] += 0.15
    return Series(information, drawn(rng, information, level, np.array([0.3, -1.0])), P)


def test_evidence_of_every_hypothesis(series: Series) -> None:
    scatter = np.array([0.001, 0.02, 0.3])
    steps = steps_of(carry(series, scatter), 0.2)
    dense = np.array([stacked(series, r, 0.2, None) for r in scatter])
    np.testing.assert_allclose(steps.log_none - steps.log_none[0], dense - dense[0], atol=1e-7)
    for i, r in enumerate(scatter):
        for k in range(1, 5):
            for j in range(P):
                own = stacked(series, r, 0.2, (k, j)) - dense[i]
                assert steps.log_ratio[i, k - 1, j] == pytest.approx(own, abs=1e-7)


def test_size_and_level_given_a_step(series: Series) -> None:
    """Against least squares on all unknowns at once: c, b, Δ and every w_t."""
    r, k, j, n, q = 0.05, 3, 0, 5, P + S
    steps = steps_of(carry(series, np.array([r])), 0.2)
    unknown = q + 1 + n * P
    precision = np.diag(np.concatenate([np.ones(q), [1.0 / 0.04], np.full(n * P, r**-2)]))
    right = np.zeros(unknown)
    for t in range(n):
        take = np.zeros((q, unknown))
        take[:, :q] = np.eye(q)
        take[j, q] = t >= k
        take[:P, q + 1 + t * P : q + 1 + (t + 1) * P] = np.eye(P)
        precision += take.T @ series.information[t] @ take
        right += take.T @ series.weighted[t]
    covariance = np.linalg.inv(precision)
    mean = covariance @ right
    at = (0, k - 1)
    assert steps.size[(*at, j)] == pytest.approx(mean[q], rel=1e-8)
    assert steps.variance[(*at, j)] == pytest.approx(covariance[q, q], rel=1e-8)
    tilt, size, variance = steps.tilt[at][:, j], steps.size[(*at, j)], steps.variance[(*at, j)]
    np.testing.assert_allclose(steps.mean[0] - tilt * size, mean[:q], rtol=1e-7)
    whole = steps.covariance[0] + variance * np.outer(tilt, tilt)
    np.testing.assert_allclose(whole, covariance[:q, :q], rtol=1e-6, atol=1e-12)


def test_a_campaign_that_says_nothing_changes_nothing(series: Series) -> None:
    """Λ singular, even zero: the evidence of steps before and after it is the same."""
    information, weighted = np.insert(series.information, 2, 0.0, axis=0), np.insert(series.weighted, 2, 0.0, axis=0)
    scatter = np.array([0.02])
    one, other = (steps_of(carry(own, scatter), 0.2) for own in (series, Series(information, weighted, P)))
    np.testing.assert_allclose(other.log_ratio[:, [0, 1, 3, 4]], one.log_ratio, atol=1e-9)
    np.testing.assert_allclose(other.log_ratio[:, 2], one.log_ratio[:, 1], atol=1e-9)


def test_a_known_instrument_is_a_sharp_prior_of_it(series: Series) -> None:
    known = np.array([0.3, -0.7])
    sharp = series.information.copy()
    pull = series.weighted.copy()
    sharp[0, P:, P:] += 1e9 * np.eye(S)
    pull[0, P:] += 1e9 * known
    scatter = np.array([0.02])
    one = steps_of(carry(series.given(known), scatter), 0.2)
    other = steps_of(carry(Series(sharp, pull, P), scatter), 0.2)
    np.testing.assert_allclose(one.log_ratio, other.log_ratio, atol=1e-4)
    np.testing.assert_allclose(one.mean, other.mean[:, :P], atol=1e-5)


def test_probability_by_brute_force() -> None:
    """One parameter, r and Δ on fine grids, c by its closed form for three campaigns."""
    precision, maxima = np.array([4e3, 2e3, 3e3]), np.array([0.30, 0.33, 0.34])
    series = Series(precision[:, None, None], (precision * maxima)[:, None], 1)
    nodes, weight = scatter_rule(0.02)
    found = weigh(steps_of(carry(series, nodes), 0.1), weight, 0.3)
    r = (np.arange(400) + 0.5) * 1.2e-1 / 400
    delta = (np.arange(801) - 400) * 0.7 / 400
    totals = {}
    for k in (None, 1, 2):
        total = 0.0
        for one, prior in zip(r, halfnorm(scale=0.02).pdf(r), strict=True):
            covariance = np.ones((3, 3)) + np.diag(1.0 / precision + one**2)
            if k is None:
                density = multivariate_normal(np.zeros(3), covariance).pdf(maxima)
            else:
                shifted = maxima - delta[:, None] * (np.arange(3) >= k)
                own = multivariate_normal(np.zeros(3), covariance).pdf(shifted)
                density = np.sum(own * norm(0.0, 0.1).pdf(delta)) * (delta[1] - delta[0])
            total += prior * density
        totals[k] = total * (0.7 if k is None else 0.15)
    expected = np.array([totals[None], totals[1], totals[2]]) / sum(totals.values())
    np.testing.assert_allclose([found.none.sum(), *found.change.sum(axis=(0, 2))], expected, atol=2e-4)
    assert found.scatter.sum() == pytest.approx(1.0)


@pytest.mark.parametrize("step", [0.12, 0.25, 0.35])
def test_scatter_rule_is_a_half_normal(step: float) -> None:
    nodes, weight = scatter_rule(0.01, step=step)
    assert weight.sum() == pytest.approx(1.0)
    assert weight @ nodes == pytest.approx(0.01 * np.sqrt(2.0 / np.pi), rel=2e-3)
    assert weight @ nodes**2 == pytest.approx(1e-4, rel=2e-3)
    assert weight @ np.exp(-nodes / 0.003) == pytest.approx(halfnorm(scale=0.01).expect(lambda r: np.exp(-r / 0.003)), rel=0.01)


@pytest.mark.slow
def test_probabilities_are_calibrated() -> None:
    """Series drawn from the model: of those said to have changed with probability 0.8, 0.8 have."""
    rng = np.random.default_rng(11)
    nodes, weight = scatter_rule(0.02, step=0.25)
    said, true, false_alarms = [], [], 0
    for _ in range(1200):
        n = int(rng.integers(3, 9))
        information = informations(rng, n, 2e3)
        level = rng.standard_normal(P) + abs(0.02 * rng.standard_normal()) * rng.standard_normal((n, P))
        changed = rng.random() < 0.5
        if changed:
            level[rng.integers(1, n) :, rng.integers(P)] += 0.2 * rng.standard_normal()
        series = Series(information, drawn(rng, information, level, rng.standard_normal(S)), P)
        said.append(1.0 - weigh(steps_of(carry(series, nodes), 0.2), weight, 0.5).none.sum())
        true.append(changed)
    place = np.digitize(said, [0.2, 0.35, 0.5, 0.8, 0.95])
    for one in range(6):
        own = place == one
        expected, spread = np.mean(np.array(said)[own]), np.sqrt(np.sum(np.array(said)[own] * (1.0 - np.array(said)[own])))
        assert own.sum() > 20
        assert abs(np.mean(np.array(true)[own]) - expected) < 3.5 * max(spread, 1.0) / own.sum()
    false_alarms = np.mean(np.array(said)[~np.array(true)] > 0.95)
    assert false_alarms < 0.05
