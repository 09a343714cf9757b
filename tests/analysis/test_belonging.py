"""Tests that do not belong: p-values that are exact, an outlier found without its neighbours, Holm's method."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from campaigns import HYPER_UM, TRUTH, plan
from scipy import stats

import ldbb_bayes as lb
from ldbb_bayes.analysis.outliers import FALSE_ALARMS, _compared

CONSTANT = lb.HybridModel.first(0).without("truncation")
MODELS = {"constant": CONSTANT, "linear": CONSTANT.with_degree(1)}
FORCES_N = (36.0, 200.0, 400.0, 600.0, 742.0)


def campaign(seed: int, odd: str | None = None, harmonics: int = 3) -> lb.Campaign:
    """A campaign without slopes; the odd test has 8 κ more in every harmonic up to an order."""
    planned = plan((36,) * 5, forces_N=FORCES_N)
    made = CONSTANT.simulate(planned, seed=seed, parameters=TRUTH, hyper_um=HYPER_UM).campaign
    tests = []
    for test in made.tests:
        angle = test.angles_rad()
        shape = 1.0 + sum(np.cos(n * angle) + np.sin(n * angle) for n in range(1, harmonics + 1))
        offset = 8.0 * HYPER_UM["kappa"] * shape if test.name == odd else 0.0
        tests.append(test.with_reading_um(np.asarray(test.reading_um) + offset))
    return replace(made, tests=tuple(tests))


def test_an_outlier_is_flagged_alone() -> None:
    odd = "f400"
    found = lb.belonging(MODELS, campaign(4, odd), seed=1, tolerance=0.1, replicates=4000)
    assert list(found.index[found["flag"]]) == [odd]
    assert found.loc[odd, "family_wise_p_value"] < FALSE_ALARMS
    orders = found.loc[odd, [f"order_{n}" for n in range(13)]].astype(float)
    assert orders[["order_2", "order_3"]].max() < 1e-3
    assert orders[[f"order_{n}" for n in range(5, 13)]].min() > 1e-3


def test_a_clean_campaign_is_not() -> None:
    found = lb.belonging(MODELS, campaign(5), seed=1, tolerance=0.1, replicates=4000)
    assert not found["flag"].any()
    assert list(found.columns[:4]) == ["force_N", "p_value", "family_wise_p_value", "flag"]
    assert found["family_wise_p_value"].ge(found["p_value"]).all()


def test_p_values_of_what_the_replicates_are_made_of(rng: np.random.Generator) -> None:
    """Uniform, by order and as a whole, for any covariance; −∞ never comes out."""
    root = np.tril(rng.normal(size=(25, 25))) + 3.0 * np.eye(25)
    replicates = rng.standard_normal((1500, 25)) @ root.T + 1.0
    seen = [_compared(rng.standard_normal(25) @ root.T + 1.0, replicates) for _ in range(300)]
    assert stats.kstest([one.p_value for one in seen], "uniform").pvalue > 1e-3
    assert stats.kstest([one.order_p_values[3] for one in seen], "uniform").pvalue > 1e-3
    far = _compared(np.full(25, 1e3), replicates)
    assert far.p_value == pytest.approx(1.0 / 1501.0)
    assert np.isfinite(far.distance)
    assert far.distance > max(one.distance for one in seen)
    odd = np.zeros(25)
    odd[3], odd[9] = 20.0, 200.0
    assert _compared(odd, rng.standard_normal((1500, 25))).worst_order == 5, "the farthest of those beyond all replicates"


def test_two_that_disagree_are_not_flagged() -> None:
    """Nothing says which of two is wrong; with three the odd one is found."""
    made = campaign(4).select(["f200", "f400", "f742"])
    odd = made.tests[1]
    spoilt = [made.tests[0], odd.with_reading_um(odd.reading_um + 20.0 * np.cos(5.0 * odd.angles_rad()))]
    two = lb.belonging(MODELS, replace(made, tests=tuple(spoilt)), seed=1, tolerance=0.1, replicates=2000)
    assert two["family_wise_p_value"].max() < FALSE_ALARMS
    assert not two["flag"].any()
    three = lb.belonging(MODELS, replace(made, tests=(*spoilt, made.tests[2])), seed=1, tolerance=0.1, replicates=2000)
    assert list(three.index[three["flag"]]) == ["f400"]
