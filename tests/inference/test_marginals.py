"""Deterministic moments and quantiles: against independent draws, and where the truncated normal is known in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from campaigns import plan, simulated
from scipy import stats

import ldbb_bayes as lb
from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.stopping import StoppingRule
from ldbb_bayes.model.orthant import Orthant


@pytest.mark.parametrize("mean", [-40.0, -2.0, 0.0, 1.0, 5.0])
def test_one_truncated_normal_in_closed_form(mean: float) -> None:
    found, variance, axes = Orthant(np.array([[mean]]), np.array([[[2.0]]])).moments()
    known = stats.truncnorm(-mean / 2.0, np.inf)
    assert found[0, 0] == pytest.approx(known.mean(), rel=1e-5, abs=1e-7)
    assert variance[0, 0, 0] == pytest.approx(known.var(), rel=1e-4)
    assert axes[0, 0, 0] == pytest.approx(1.0)


@pytest.mark.parametrize("rows", [2, 3])
def test_moments_inside_the_orthant_by_rejection(rows: int) -> None:
    rng = np.random.default_rng(rows)
    spread = np.eye(rows, 4) + 0.4 * rng.normal(size=(rows, 4))
    mean = rng.normal(size=rows)
    shift, covariance, axes = (part[0] for part in Orthant(mean[None], spread[None]).moments(1 << 14))
    white = rng.standard_normal((400_000, 4))
    white = white[np.all(mean + white @ spread.T >= 0.0, axis=1)]
    along = axes.T @ shift
    np.testing.assert_allclose(along, white.mean(axis=0), atol=5.0 / np.sqrt(len(white)))
    expected = np.eye(4) + axes.T @ (covariance - np.eye(len(shift))) @ axes
    np.testing.assert_allclose(expected, np.cov(white.T), atol=8.0 / np.sqrt(len(white)))


@pytest.mark.parametrize("model", [lb.HybridModel.default(0), lb.HybridModel.default(1).without("truncation")])
def test_against_independent_draws(model: lb.HybridModel) -> None:
    campaign = simulated(plan())
    exact = lb.marginals(model, campaign)
    tree = lb.sample(model, campaign, sampler="quadrature", seed=2, rule=StoppingRule(ess=6000.0))
    drawn = lb.summarize(tree)
    assert list(exact.index) == list(drawn.index)
    assert list(exact["unit"]) == list(drawn["unit"])
    error = exact["sd"] / np.sqrt(drawn["ess_bulk"])
    assert ((drawn["mean"] - exact["mean"]) / error).abs().max() < 4.0
    assert (drawn["sd"] / exact["sd"] - 1.0).abs().max() < 0.05
    for column, level in (("median", 0.5), ("ci_low", 0.025), ("ci_high", 0.975)):
        for name, variable in tree["posterior"].data_vars.items():
            share = float((variable.to_numpy() < exact.loc[name, column]).mean())
            assert share == pytest.approx(level, abs=4.0 * np.sqrt(level * (1.0 - level) / 6000.0) + 0.005), (name, column)


def test_refused() -> None:
    with pytest.raises(InputError, match="must be asked of a campaign with readings, got a plan"):
        lb.marginals(lb.HybridModel.default(0), plan())
    with pytest.raises(InputError, match="ci_prob must lie between 0 and 1, got 95"):
        lb.marginals(lb.HybridModel.default(0), simulated(plan()), ci_prob=95.0)
    with pytest.raises(InputError, match="tolerance must lie between 0 and 1, got -1"):
        lb.marginals(lb.HybridModel.default(0), simulated(plan()), tolerance=-1.0)
