"""New circles against the oracle's Gaussian; the groups for ArviZ, whose functions run on them
without a warning."""

from __future__ import annotations

from dataclasses import replace

import arviz_stats
import numpy as np
import pytest
import xarray as xr
from campaigns import HYPER_UM, oracle_of, plan, refuses, simulated
from scipy import stats

import ldbb_bayes as lb
from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.coefficients import ModelDraws
from ldbb_bayes.inference.cross_validation import log_likelihood_of_tests
from ldbb_bayes.inference.evidences import Evidences, leave_one_out
from ldbb_bayes.inference.mcmc import StoppingRule
from ldbb_bayes.inference.prediction import new_circles

MODEL = lb.HybridModel.first(1)
CAMPAIGN = simulated(plan())
ANGLE = np.arange(0.0, 360.0, 15.0)


@pytest.fixture(scope="module")
def posterior() -> xr.DataTree:
    return lb.sample(MODEL, CAMPAIGN, sampler="independent", seed=3, rule=StoppingRule(ess=1500.0))


@pytest.fixture(scope="module")
def checked(posterior: xr.DataTree) -> xr.DataTree:
    return lb.with_predictive(posterior)


def test_new_circles_are_the_oracles(rng: np.random.Generator) -> None:
    """At given scales: the Gaussian of further circles given those measured, also at another radius
    and with turned balls."""
    model = MODEL.without("force-error", "truncation")
    new = [
        lb.CircularTest(520.0, ANGLE, ANGLE),
        lb.CircularTest(60.0, ANGLE, ANGLE, radius_mm=100.0),
    ]
    new.append(lb.CircularTest(300.0, ANGLE, ANGLE, work_ball_deg=50.0, tool_ball_deg=20.0))
    planned = lb.Campaign(tuple(new))
    every = lb.Campaign((*CAMPAIGN.tests, *new), mount=CAMPAIGN.mount)
    dense = oracle_of(every, 1, terms=("form", "length", "mount", "setup", "discrepancy"))
    phi = np.array([HYPER_UM[name] * 1e-3 for name in dense.hypers])
    old = np.arange(len(dense.y)) < CAMPAIGN.readings
    covariance = dense.covariance(phi) + (dense.J * dense.sd**2) @ dense.J.T
    gain = np.linalg.solve(covariance[np.ix_(old, old)], covariance[np.ix_(old, ~old)]).T
    mean = gain @ dense.y[old]
    sd = np.sqrt(np.diag(covariance[np.ix_(~old, ~old)] - gain @ covariance[np.ix_(old, ~old)]))
    bound = model.bind(CAMPAIGN)
    draws = np.tile(phi, (20_000, 1))
    found = np.concatenate(
        list(new_circles(ModelDraws(bound, draws, bound.given(draws)[1].draw(rng)), planned, rng)),
        axis=1,
    )
    np.testing.assert_allclose(found.mean(axis=0), mean, atol=5.0 * sd.max() / np.sqrt(len(draws)))
    np.testing.assert_allclose(found.std(axis=0), sd, rtol=0.03)


def test_prediction_as_a_table(posterior: xr.DataTree) -> None:
    later = plan((24, 24), forces_N=(100.0, 742.0))
    table = lb.predict(posterior, later, ci_prob=0.8, seed=2)
    assert list(table.columns) == [
        "test",
        "force_N",
        "angle_deg",
        "mean_um",
        "median_um",
        "ci_low_um",
        "ci_high_um",
    ]
    assert list(table["test"].unique()) == ["f100", "f742"]
    assert table.equals(lb.predict(posterior, later, ci_prob=0.8, seed=2))
    again = lb.predict(posterior, CAMPAIGN)
    reading = np.concatenate([test.reading_um for test in CAMPAIGN.tests])
    assert ((again["ci_low_um"] < reading) & (reading < again["ci_high_um"])).mean() > 0.9
    averaged = lb.average({"constant": MODEL.with_degree(0), "linear": MODEL}, CAMPAIGN, draws=800)
    np.testing.assert_allclose(lb.predict(averaged, later)["mean_um"], table["mean_um"], atol=1.0)
    with pytest.raises(
        InputError,
        match=(
            r"got planes or set-ups with E_Xt0_2, E_Yt0_2 too\. Fit with replace\(campaign,"
            r" foreseen"
        ),
    ):
        lb.predict(posterior, replace(later, tests=(replace(later.tests[0], setup=2),)))
    refuses(
        "the plan must be of the posterior's machine wCAFYXZSt",
        lb.predict,
        posterior,
        replace(later, topology="wFYXZSt"),
    )
    refuses("posterior must be of one model, got an average", lb.with_predictive, averaged)


@pytest.mark.filterwarnings(
    "ignore:The inplace keyword in DataFrame"
)  # arviz-stats 0.8 with pandas 3.1
def test_arviz_judges_the_posterior(checked: xr.DataTree, posterior: xr.DataTree) -> None:
    """Warnings are errors here. Its leave-one-out is that of the nodes, circle by circle."""
    loo = arviz_stats.loo(checked, pointwise=True)
    (nodes,) = Evidences(CAMPAIGN).of(MODEL)
    left = leave_one_out({"": nodes})[""]
    exact = [nodes.evidence.log_value - left[name].evidence.log_value for name in left]
    np.testing.assert_allclose(loo.elpd_i, exact, atol=0.15)
    constant = lb.sample(
        MODEL.with_degree(0), CAMPAIGN, sampler="independent", seed=3, rule=StoppingRule(ess=1500.0)
    )
    assert set(
        arviz_stats.compare({"linear": checked, "constant": lb.with_predictive(constant)}).index
    ) == {"linear", "constant"}
    assert "C_XXX" in arviz_stats.psense_summary(checked).index
    readings = checked["posterior_predictive"]["reading_mm"]
    observed = checked["observed_data"]["reading_mm"]
    assert readings.dims == ("chain", "draw", "reading")
    assert (
        readings.sizes["draw"]
        == checked["posterior"].sizes["draw"]
        == checked["log_likelihood"].sizes["draw"]
        == 250
    )
    low, high = readings.quantile([0.025, 0.975], dim=("chain", "draw")).to_numpy()
    assert ((low < observed) & (observed < high)).mean() > 0.9
    shown = arviz_stats.summary(lb.to_units(posterior), ci_prob=0.95, ci_kind="eti")
    assert not (shown["sd"].astype(str).astype(float) == 0.0).any()
    plots = pytest.importorskip("arviz_plots", exc_type=Exception)
    plots.plot_ppc_dist(checked, backend="matplotlib")


def test_circle_given_the_others_is_the_oracles() -> None:
    """ln p(y_r | y_−r, φ) of the dense covariance, parameters integrated out; the circle's own
    scale summed over its law."""
    model = lb.HybridModel.default(0).without(
        "truncation", "joint-load", "position", "angle", "force-error", "mount"
    )
    bound = model.bind(CAMPAIGN)
    dense = oracle_of(
        CAMPAIGN,
        0,
        edition="second",
        terms=("form", "length", "setup", "discrepancy", "circle"),
    )
    phi = bound.hyper_prior.quantile(np.full(len(bound.hyper_prior.names), 0.4))
    (found,) = log_likelihood_of_tests(bound, phi[None])
    r = 2
    log_scale = np.linspace(-1.5, 3.5, 150)
    other = dense.circle != r

    def log_density(value: float, rows: np.ndarray) -> float:
        covariance = dense.covariance(np.where(np.array(dense.hypers) == "lambda_3", value, phi))
        covariance = covariance + (dense.J * dense.sd**2) @ dense.J.T
        return float(
            stats.multivariate_normal(None, covariance[np.ix_(rows, rows)]).logpdf(dense.y[rows])
        )

    law = stats.invgamma.logpdf(np.exp(2.0 * log_scale), 1.5, scale=1.5) + 2.0 * log_scale
    values = np.array([log_density(value, np.arange(len(other))) for value in np.exp(log_scale)])
    expected = (
        np.logaddexp.reduce(law + values)
        - np.logaddexp.reduce(law)
        - log_density(1.0, np.flatnonzero(other))
    )
    assert found[r] == pytest.approx(expected, abs=0.01)
