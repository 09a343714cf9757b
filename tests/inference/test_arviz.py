"""ArviZ's functions run on what sample, with_predictive and validate return."""

from __future__ import annotations

from dataclasses import replace
from types import ModuleType

import arviz_stats
import corner
import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr
from campaigns import plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.inference.posterior import bound_of, model_draws_of
from ldbb_bayes.inference.prediction import new_circles

pytestmark = [
    pytest.mark.slow,
    # arviz-stats 0.8 sorts frames in place, which pandas 3.1 says it will not allow.
    pytest.mark.filterwarnings("ignore:The inplace keyword in DataFrame"),
    # arviz-plots 0.8 drops one level of an index, which xarray says it will not allow.
    pytest.mark.filterwarnings("ignore:Deleting a single level of a MultiIndex"),
]

CAMPAIGN = simulated(plan())
PLOTS_OF_POSTERIOR = (
    "plot_trace_dist",
    "plot_rank",
    "plot_forest",
    "plot_prior_posterior",
    "plot_pair",
)


def draws_of_model(degree: int) -> xr.DataTree:
    model = lb.HybridModel.default(degree)
    return lb.sample(model, CAMPAIGN, sampler="independent", seed=1)


@pytest.fixture(scope="module")
def posterior() -> xr.DataTree:
    return draws_of_model(1)


@pytest.fixture(scope="module")
def constant() -> xr.DataTree:
    return draws_of_model(0)


@pytest.fixture(scope="module")
def checked(posterior: xr.DataTree) -> xr.DataTree:
    return lb.inference.with_predictive(posterior, draws=400)


@pytest.fixture
def arviz_plots() -> ModuleType:
    return pytest.importorskip("arviz_plots", exc_type=ImportError)


def test_arviz_summarizes_a_posterior_alike(posterior: xr.DataTree) -> None:
    table = arviz_stats.summary(posterior, ci_prob=0.95, ci_kind="eti", round_to="none")
    expected = lb.summarize(posterior)
    np.testing.assert_allclose(table["mean"].astype(float), expected["mean"])
    np.testing.assert_allclose(table["ess_bulk"].astype(float), expected["ess_bulk"])


def test_loo_and_compare(checked: xr.DataTree, constant: xr.DataTree) -> None:
    assert np.isfinite(arviz_stats.loo(checked).elpd)
    rivals = {"linear": checked, "constant": lb.inference.with_predictive(constant, draws=400)}
    assert set(arviz_stats.compare(rivals).index) == {"linear", "constant"}


def test_loo_pit_is_the_share_of_circles_with_a_smaller_range(checked: xr.DataTree) -> None:
    """The share of circles with a smaller range, as a fit without the test predicts them."""
    shares = arviz_stats.loo_pit(checked, var_names=["per_test"])["per_test"]
    assert shares.sizes == {"test": len(CAMPAIGN.tests)}
    # A fit of three tests has no noise factors of circles. The preset has none at all.
    first = lb.HybridModel.first(1)
    fit_of_all = lb.sample(first, CAMPAIGN, sampler="independent", seed=1)
    checked_first = lb.inference.with_predictive(fit_of_all, draws=1000)
    shares = arviz_stats.loo_pit(checked_first, var_names=["per_test"])["per_test"]
    reference_force_N = bound_of(fit_of_all).setting.reference_force_N
    for left_out in CAMPAIGN.tests[1:-1]:
        others = tuple(test for test in CAMPAIGN.tests if test is not left_out)
        model = replace(first, reference_force_N=reference_force_N)
        fit = lb.sample(model, replace(CAMPAIGN, tests=others), sampler="independent", seed=2)
        plan_of_one = replace(CAMPAIGN, tests=(left_out,)).plan()
        (draws,) = model_draws_of(fit, 4000)
        (circles,) = new_circles(draws, plan_of_one, np.random.default_rng(3))
        smaller = np.ptp(circles, axis=1) < np.ptp(left_out.readings_mm())
        assert float(shares.sel(test=left_out.name)) == pytest.approx(smaller.mean(), abs=0.06)


def test_psense_summary(checked: xr.DataTree) -> None:
    assert "C_XXX" in arviz_stats.psense_summary(checked).index


@pytest.mark.parametrize("name", PLOTS_OF_POSTERIOR)
def test_plots_of_a_posterior(name: str, posterior: xr.DataTree, arviz_plots: ModuleType) -> None:
    getattr(arviz_plots, name)(posterior, var_names=["C_XXX", "C_YYY"], backend="matplotlib")
    plt.close("all")


def test_plot_of_predicted_readings(checked: xr.DataTree, arviz_plots: ModuleType) -> None:
    arviz_plots.plot_ppc_dist(checked, backend="matplotlib")
    plt.close("all")


def test_plot_of_ranks(arviz_plots: ModuleType) -> None:
    validation = lb.calibrate(lb.HybridModel.first(0), plan(), replicates=10, draws=19)
    arviz_plots.plot_ecdf_pit(validation.pit, var_names=["C_XXX"], backend="matplotlib")
    plt.close("all")


def test_corner_overlays_two_posteriors_and_the_prior(
    posterior: xr.DataTree, constant: xr.DataTree
) -> None:
    names = ["C_XXX", "E_YX2"]
    figure = None
    for group in (posterior["prior"], posterior["posterior"], constant["posterior"]):
        draws = np.column_stack([group[name].values.ravel() for name in names])
        figure = corner.corner(draws, labels=names, fig=figure, plot_datapoints=False)
    assert figure is not None
    assert len(figure.axes) == 4
    plt.close("all")
