"""Machines against the others: p-values uniform under the model, an outlier found, the same from machines left out by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fleets import dense, fleet, scaled
from scipy.stats import chi2, kstest, norm
from trends import doubts

from ldbb_bayes.fleet import membership as module
from ldbb_bayes.fleet.membership import _repeat_p_values, belonging_of, contradicting
from ldbb_bayes.fleet.pooling import SpreadDensity, Spreads, draw_spreads, pooling
from ldbb_bayes.fleet.population import pool

SPREAD = np.array([0.3, 0.05])


def fixed(spread: np.ndarray) -> Spreads:
    """Draws that are all the same spread."""
    n = 64
    return Spreads(np.tile(spread, (n, 1)), np.zeros(n), np.full(n, 1.0 / n), -np.inf, 0.5, np.log(spread))


def test_a_machine_against_the_dense_prediction(rng: np.random.Generator) -> None:
    """s known: a given the others is Gaussian, with moments from one dense matrix of everything."""
    statistics = fleet(rng, machines=6, parameters=2)
    found = belonging_of(SpreadDensity(pooling(statistics), 0.3), fixed(SPREAD), seed=1)
    information, weighted = scaled(statistics)
    for m in range(6):
        others = [k for k in range(6) if k != m]
        kept = replace(
            statistics,
            machines=tuple(statistics.machines[k] for k in others),
            information=statistics.information[others],
            weighted=statistics.weighted[others],
        )
        _, mean, covariance = dense(kept, SPREAD)
        mean, covariance = mean[10:], covariance[10:, 10:].copy()
        covariance[:2, :2] += np.diag(SPREAD**2)
        rows = information[m][:2]
        left = weighted[m][:2] - rows @ mean
        spread = rows @ covariance @ rows.T + rows[:, :2]
        alone = np.linalg.inv(rows[:, :2] + np.eye(2))
        z = (alone @ left) / np.sqrt(np.diag(alone @ spread @ alone.T))
        np.testing.assert_allclose(found.z[:, m], z, rtol=1e-6)
        np.testing.assert_allclose(found.parameter_p_value[:, m], 2.0 * norm.sf(np.abs(z)), rtol=1e-6)
        assert found.p_value[m] == pytest.approx(min(1.0, 4.0 * norm.sf(np.abs(z)).min()), rel=1e-6)


def test_the_weight_of_a_machine_is_its_predictive_density(rng: np.random.Generator) -> None:
    """p(y_m | y_−m, s) = p(y | s) / p(y_−m | s), the latter from sums made without the machine."""
    pooled = pooling(fleet(rng, machines=6, parameters=2))
    spreads = np.array([SPREAD, SPREAD[::-1], 2.0 * SPREAD])
    found, _ = module._all_at_once(pooled, module._eyes(pooled), spreads)
    whole = pooled.common(spreads).log_density
    for m in range(6):
        left = pooled.without(m).common(spreads).log_density
        np.testing.assert_allclose(np.diff(found[:, m]), np.diff(whole - left), rtol=1e-8)


def test_readings_that_tell_fewer_numbers_than_parameters(rng: np.random.Generator) -> None:
    """A machine of rank one has one z, whatever the parameter; of one that tells nothing there is nothing to say."""
    statistics = fleet(rng, machines=6, parameters=2)
    information, weighted = statistics.information.copy(), statistics.weighted.copy()
    row = np.array([1.0, 0.5, 0.2, 0.1]) / np.concatenate([statistics.prior_sd, statistics.instrument_sd])
    information[0], weighted[0] = np.outer(row, row) * 100.0, 10.0 * row * 8.0
    information[1], weighted[1] = 0.0, 0.0
    odd = replace(statistics, information=information, weighted=weighted)
    found = belonging_of(SpreadDensity(pooling(odd), 0.3), fixed(SPREAD), seed=1)
    assert found.p_value[1] == 1.0
    assert found.z[:, 1].tolist() == [0.0, 0.0]
    assert found.seen.tolist() == [True, False, True, True, True, True]
    assert abs(found.z[0, 0]) == pytest.approx(abs(found.z[1, 0]), rel=1e-6)


def test_drawn_anew_or_weighted(rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch) -> None:
    """Weights that can be trusted give what draws without the machine give."""
    density = SpreadDensity(pooling(fleet(rng, machines=12, parameters=2)), 0.3)
    spreads = draw_spreads(density, seed=1)
    weighed = belonging_of(density, spreads, seed=1)
    calls = []
    monkeypatch.setattr(module, "pareto_smooth", lambda log_ratio: (np.full(len(log_ratio), 1.0 / len(log_ratio)), 9.0, 0.5))
    anew = belonging_of(density, spreads, seed=1, progress=lambda done, total: calls.append((done, total)))
    assert calls[-1] == (12, 12)
    np.testing.assert_allclose(anew.p_value, weighed.p_value, rtol=0.1, atol=2e-3)
    np.testing.assert_allclose(anew.z, weighed.z, atol=0.1)


@pytest.mark.slow
def test_no_more_than_five_per_cent_of_fleets_have_a_machine_that_stands_out() -> None:
    """Fleets of the model; the average over s of a χ² of all parameters finds one in 18 of these 150."""
    rng = np.random.default_rng(12)
    flagged = 0
    for _ in range(150):
        spread, mean = np.abs(rng.standard_normal(6)) * 0.3, rng.standard_normal(6)
        density = SpreadDensity(pooling(fleet(rng, machines=8, spread=spread, mean=mean, known=0.05)), 0.3)
        flagged += belonging_of(density, draw_spreads(density, seed=1, size=128), seed=1).flagged.any()
    assert flagged <= 12  # 5 % of 150, and 1.7 standard deviations of counting


def test_the_tail_over_spreads_is_that_of_the_prediction(rng: np.random.Generator) -> None:
    """t from N(mean_s, sd_s²), s one of two: p is uniform, whichever of the two it was."""
    n, mean, sd = 4000, np.array([0.5, -1.0]), np.array([0.3, 1.0])
    weight = np.array([0.3, 0.7])
    s = rng.choice(2, n, p=weight)
    t = mean[s] + sd[s] * rng.standard_normal(n)
    p, side = module._averaged(np.tile(weight, (n, 1)), ((t - mean[:, None]) / sd[:, None])[None])
    assert kstest(p[0], "uniform").pvalue > 0.01
    assert np.mean(side[0] == np.sign(t - np.median(t))) > 0.97


def test_p_values_are_uniform_and_z_standard() -> None:
    """Fleets of the model, spreads and all; one machine of each, so that they are independent."""
    rng = np.random.default_rng(11)
    p, z = [], []
    for _ in range(100):
        spread, mean = np.abs(rng.standard_normal(2)) * 0.3, rng.standard_normal(2)
        density = SpreadDensity(pooling(fleet(rng, machines=7, parameters=2, spread=spread, mean=mean)), 0.3)
        found = belonging_of(density, draw_spreads(density, seed=1, size=256), seed=1)
        p.append(found.parameter_p_value[:, 3])
        z.append(found.z[:, 3])
    assert kstest(np.ravel(p), "uniform").pvalue > 0.01
    assert kstest(np.ravel(z), "norm").pvalue > 0.01


@pytest.mark.parametrize("machines", [6, 30])
def test_an_outlier_is_flagged(machines: int) -> None:
    rng = np.random.default_rng(5)
    outlier = np.array([0.0, 0.0, 3.0, 0.0, 0.0, 0.0])
    density = SpreadDensity(pooling(fleet(rng, machines=machines, outlier=outlier)), 0.3)
    found = belonging_of(density, draw_spreads(density, seed=1, size=1024), seed=1)
    assert found.flagged.tolist() == [True] + [False] * (machines - 1)
    assert np.argmax(np.abs(found.z[:, 0])) == 2
    assert found.z[2, 0] > 5.0
    assert not found.doubtful.any()


def test_two_campaigns_are_compared_by_their_difference(rng: np.random.Generator) -> None:
    """The instrument known: (ĉ₁ − ĉ₂)ᵀ (A₁⁻¹ + A₂⁻¹)⁻¹ (ĉ₁ − ĉ₂)."""
    made = fleet(rng, machines=1, campaigns=2, parameters=3)
    scale = np.concatenate([made.prior_sd, made.instrument_sd])
    b = np.array([0.3, -0.2])
    covariance, estimates = np.zeros((3, 3)), []
    for information, weighted in zip(made.information * scale[:, None] * scale, made.weighted * scale, strict=True):
        covariance += np.linalg.inv(information[:3, :3])
        estimates.append(np.linalg.solve(information[:3, :3], weighted[:3] - information[:3, 3:] @ b))
    apart = estimates[0] - estimates[1]
    expected = chi2(3).sf(apart @ np.linalg.solve(covariance, apart))
    assert _repeat_p_values(made, b, np.zeros((2, 2)))["M01"] == pytest.approx(expected, rel=1e-6)


def test_p_values_of_repeats_are_uniform() -> None:
    """The instrument known as little as before any campaign."""
    rng = np.random.default_rng(4)
    p = [_repeat_p_values(fleet(rng, machines=1, campaigns=3), np.zeros(2), np.eye(2))["M01"] for _ in range(300)]
    assert kstest(p, "uniform").pvalue > 0.01


def test_a_machine_that_changed_is_named(rng: np.random.Generator) -> None:
    made = fleet(rng, machines=4, parameters=2)
    _, mean, covariance = dense(made, np.array([0.2, 0.2]))
    other = replace(made, machines=("a", "a", "b", "c"), weighted=made.weighted.copy())
    other.weighted[1] += other.information[1, :, 0] * 3.0 * made.prior_sd[0]
    assert contradicting(other, mean[-2:], covariance[-2:, -2:]) == ["a"]
    assert contradicting(made, mean[-2:], covariance[-2:, -2:]) == []
    assert "Campaigns of one machine contradict one another: a." in " ".join(doubts(pool(other)))
