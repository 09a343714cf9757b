"""Tests that do not belong: exact p-values, an outlier without its neighbours, Holm's method."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from campaigns import HYPER_UM, TRUTH, plan, refuses, simulated
from scipy import stats

import ldbb_bayes as lb
from ldbb_bayes.analysis.outlying_tests import FALSE_ALARMS, _scatter_matrix, judge_circle

CONSTANT = lb.HybridModel.first(0).without("truncation")
MODELS = {"constant": CONSTANT, "linear": CONSTANT.with_degree(1)}
FORCES_N = (36.0, 200.0, 400.0, 600.0, 742.0)
OUTLYING = "f400"


def clean_campaign(seed: int) -> lb.Campaign:
    """Return a campaign without slopes."""
    planned = plan((36,) * 5, forces_N=FORCES_N)
    return CONSTANT.simulate(planned, seed=seed, parameters=TRUTH, hyper_um=HYPER_UM).campaign


def with_deviation(test: lb.CircularTest, deviation_um: np.ndarray) -> lb.CircularTest:
    """Return a test with a deviation added to its readings."""
    return test.with_reading_um(np.asarray(test.reading_um) + deviation_um)


def campaign_with_outlier(seed: int) -> lb.Campaign:
    """Return a campaign of which one test has 8 κ more in every harmonic up to order 3."""
    campaign = clean_campaign(seed)
    tests = []
    for test in campaign.tests:
        if test.name == OUTLYING:
            angle = test.angles_rad()
            shape = np.ones_like(angle)
            for order in range(1, 4):
                shape += np.cos(order * angle) + np.sin(order * angle)
            test = with_deviation(test, 8.0 * HYPER_UM["kappa"] * shape)
        tests.append(test)
    return replace(campaign, tests=tuple(tests))


@pytest.mark.slow
def test_an_outlier_is_flagged_alone() -> None:
    table = lb.find_outlying_tests(
        MODELS, campaign_with_outlier(4), seed=1, tolerance=0.1, replicates=4000
    )
    assert list(table.index[table["flag"]]) == [OUTLYING]
    assert table.loc[OUTLYING, "family_wise_p_value"] < FALSE_ALARMS
    p_values = table.loc[OUTLYING, [f"order_{n}" for n in range(13)]].astype(float)
    assert p_values[["order_2", "order_3"]].max() < 1e-3
    assert p_values[[f"order_{n}" for n in range(5, 13)]].min() > 1e-3


def test_an_outlier_among_arcs_is_flagged_at_its_order() -> None:
    """12 µm at order 7, hundreds of times what arcs differ by at that order (κ/7)."""
    planned = plan((36,) * 5, forces_N=FORCES_N, arc_deg=230.0)
    campaign = CONSTANT.simulate(planned, seed=4, parameters=TRUTH, hyper_um=HYPER_UM).campaign
    tests = []
    for test in campaign.tests:
        if test.name == OUTLYING:
            test = with_deviation(test, 12.0 * np.cos(7.0 * test.angles_rad()))
        tests.append(test)
    table = lb.find_outlying_tests(
        {"constant": CONSTANT},
        replace(campaign, tests=tuple(tests)),
        seed=1,
        tolerance=0.3,
        replicates=2000,
    )
    assert list(table.index[table["flag"]]) == [OUTLYING]


def test_a_clean_campaign_has_no_outlier() -> None:
    table = lb.find_outlying_tests(
        MODELS, clean_campaign(5), seed=1, tolerance=0.1, replicates=4000
    )
    assert not table["flag"].any()
    assert list(table.columns[:4]) == ["force_N", "p_value", "family_wise_p_value", "flag"]
    assert table["family_wise_p_value"].ge(table["p_value"]).all()


def test_p_values_of_replicates_are_uniform(rng: np.random.Generator) -> None:
    """Uniform by order and over all orders, for any covariance."""
    root = np.tril(rng.normal(size=(25, 25))) + 3.0 * np.eye(25)
    replicates = rng.standard_normal((1500, 25)) @ root.T + 1.0
    judged = []
    for _ in range(300):
        circle = rng.standard_normal(25) @ root.T + 1.0
        judged.append(judge_circle(circle, replicates))
    p_values = [circle.p_value for circle in judged]
    assert stats.kstest(p_values, "uniform").pvalue > 1e-3
    p_values_of_order_3 = [circle.order_p_values[3] for circle in judged]
    assert stats.kstest(p_values_of_order_3, "uniform").pvalue > 1e-3
    distant = judge_circle(np.full(25, 1e3), replicates)
    assert distant.p_value == pytest.approx(1.0 / 1501.0)
    assert np.isfinite(distant.distance)
    assert distant.distance > max(circle.distance for circle in judged)


def test_a_scatter_matrix_does_not_depend_on_a_few_very_large_replicates(
    rng: np.random.Generator,
) -> None:
    """Replicates of Student t₂ have no covariance, and the known scatter matrix."""
    scatter = np.array([[4.0, 1.9], [1.9, 1.0]])
    normal = np.linalg.cholesky(scatter) @ rng.standard_normal((2, 40_000))
    heavy = normal / np.sqrt(rng.chisquare(2.0, 40_000) / 2.0)
    np.testing.assert_allclose(_scatter_matrix(normal), scatter, rtol=0.05)
    shape = _scatter_matrix(heavy)
    np.testing.assert_allclose(shape / shape[1, 1], scatter, rtol=0.05)
    covariance = np.cov(heavy)
    assert np.abs(covariance / covariance[1, 1] - scatter).max() > 0.2


def test_the_worst_order_is_the_farthest_beyond_all_replicates(rng: np.random.Generator) -> None:
    circle = np.zeros(25)
    circle[3] = 20.0
    circle[9] = 200.0
    assert judge_circle(circle, rng.standard_normal((1500, 25))).worst_order == 5


@pytest.mark.slow
def test_two_that_disagree_are_not_flagged() -> None:
    """Nothing says which of two is wrong; with three the outlying one is found."""
    campaign = clean_campaign(4).select(["f200", "f400", "f742"])
    first, second, third = campaign.tests
    spoilt = with_deviation(second, 20.0 * np.cos(5.0 * second.angles_rad()))
    two_tests = replace(campaign, tests=(first, spoilt))
    table = lb.find_outlying_tests(MODELS, two_tests, seed=1, tolerance=0.1, replicates=2000)
    assert table["family_wise_p_value"].max() < FALSE_ALARMS
    assert not table["flag"].any()
    three_tests = replace(campaign, tests=(first, spoilt, third))
    table = lb.find_outlying_tests(MODELS, three_tests, seed=1, tolerance=0.1, replicates=2000)
    assert list(table.index[table["flag"]]) == ["f400"]


SMALL = simulated(plan((30, 30, 30), forces_N=(36.0, 400.0, 742.0)), seed=1)


def test_too_few_replicates_are_refused() -> None:
    refuses(
        "replicates must be at least 76 to judge 3 tests, got 50",
        lb.find_outlying_tests,
        {"constant": CONSTANT},
        SMALL,
        replicates=50,
    )


def test_one_test_is_refused() -> None:
    refuses(
        "at least two tests", lb.find_outlying_tests, {"constant": CONSTANT}, SMALL.select(["f400"])
    )
