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
from ldbb_bayes.campaign.run_times import with_listed_times
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
    return lb.inference.with_predictive(posterior)


def test_new_circles_are_the_oracles(rng: np.random.Generator) -> None:
    """At given scales: the Gaussian of further circles given those measured, also at another radius
    and with turned balls."""
    model = MODEL.without("force-error", "truncation")
    new = [
        lb.CircularTest(520.0, ANGLE, ANGLE),
        lb.CircularTest(60.0, ANGLE, ANGLE, radius_mm=100.0),
    ]
    new.append(lb.CircularTest(300.0, ANGLE, ANGLE, work_ball_deg=50.0, tool_ball_deg=20.0))
    measured_and_new = lb.Campaign((*CAMPAIGN.tests, *new), mount=CAMPAIGN.mount)
    terms = ("form", "length", "mount", "setup", "discrepancy")
    dense = oracle_of(measured_and_new, 1, terms=terms)
    phi = np.array([HYPER_UM[name] * 1e-3 for name in dense.hypers])
    measured = np.arange(len(dense.y)) < CAMPAIGN.readings
    covariance = dense.covariance(phi) + (dense.J * dense.sd**2) @ dense.J.T
    covariance_measured = covariance[np.ix_(measured, measured)]
    covariance_new = covariance[np.ix_(~measured, ~measured)]
    crossed = covariance[np.ix_(measured, ~measured)]
    gain = np.linalg.solve(covariance_measured, crossed).T
    mean = gain @ dense.y[measured]
    sd = np.sqrt(np.diag(covariance_new - gain @ crossed))

    bound = model.bind(CAMPAIGN)
    phi_draws = np.tile(phi, (20_000, 1))
    beta_draws = bound.given(phi_draws)[1].draw(rng)
    draws = ModelDraws(bound, phi_draws, beta_draws)
    readings = np.concatenate(list(new_circles(draws, lb.Campaign(tuple(new)), rng)), axis=1)
    standard_error = sd.max() / np.sqrt(len(phi_draws))
    np.testing.assert_allclose(readings.mean(axis=0), mean, atol=5.0 * standard_error)
    np.testing.assert_allclose(readings.std(axis=0), sd, rtol=0.03)


LATER = plan((24, 24), forces_N=(100.0, 742.0))


@pytest.fixture(scope="module")
def averaged() -> xr.DataTree:
    return lb.average({"constant": MODEL.with_degree(0), "linear": MODEL}, CAMPAIGN, draws=800)


def test_prediction_as_a_table(posterior: xr.DataTree, averaged: xr.DataTree) -> None:
    table = lb.predict(posterior, LATER, prob=0.8, seed=2)
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
    assert table.equals(lb.predict(posterior, LATER, prob=0.8, seed=2))
    mean_um = lb.predict(averaged, LATER)["mean_um"]
    np.testing.assert_allclose(mean_um, table["mean_um"], atol=1.0)
    wide = lb.predict(posterior, LATER, prob=0.95, seed=2)
    ratio = stats.norm.isf(0.1) / stats.norm.isf(0.025)
    half_widths = [(one["ci_high_um"] - one["ci_low_um"]).mean() for one in (table, wide)]
    assert half_widths[0] / half_widths[1] == pytest.approx(ratio, rel=0.08)


@pytest.mark.slow
def test_circles_without_times_follow_the_measured_ones() -> None:
    """They drift on: as if the times had been stated, and wider than at the mean time."""
    model = lb.HybridModel.default(1)
    timed = with_listed_times(CAMPAIGN)
    stated = lb.sample(model, timed, sampler="independent", seed=1)
    listed = lb.sample(model, CAMPAIGN, sampler="independent", seed=1)
    last_s = max(test.time_s for test in timed.tests)
    later = []
    for k, test in enumerate(LATER.tests, start=1):
        later.append(replace(test, time_s=last_s + 360.0 * k))
    in_the_middle = [replace(test, time_s=0.5 * last_s) for test in LATER.tests]
    tables = (
        lb.predict(stated, LATER),
        lb.predict(listed, LATER),
        lb.predict(stated, replace(LATER, tests=tuple(later))),
        lb.predict(stated, replace(LATER, tests=tuple(in_the_middle))),
    )
    widths = [float((table["ci_high_um"] - table["ci_low_um"]).mean()) for table in tables]
    assert widths[0] == widths[2]
    assert widths[1] == pytest.approx(widths[2], rel=1e-6)
    assert widths[2] > 1.1 * widths[3]


BALLS = lb.Instrument(work=lb.Ball(grade="G10"), tool=lb.Ball(grade="G10"))


@pytest.mark.slow
@pytest.mark.parametrize("direction", ["CW", "CCW"])
def test_a_circle_is_predicted_alike_whatever_stands_beside_it_in_the_plan(direction: str) -> None:
    """The machine's pattern of its direction is known from the circles run so far."""
    planned = plan((36,) * 6, forces_N=(100.0, 200.0, 300.0, 450.0, 600.0, 742.0))
    tests = []
    for k, test in enumerate(planned.tests):
        tests.append(replace(test, direction=("CW", "CCW")[k % 2], name=f"t{k}"))
    model = lb.HybridModel.default(1)
    campaign = model.simulate(
        replace(planned, tests=tuple(tests), instrument=BALLS),
        seed=2,
        hyper_um={"sigma": 0.3, "delta": 0.3, "kappa": 0.3, "omega": 3.0},
    ).campaign
    posterior = lb.sample(model, campaign, sampler="independent", seed=1)
    wanted = replace(tests[2], direction=direction, name="wanted")
    other = replace(wanted, direction="CCW" if direction == "CW" else "CW", name="other")
    of_one_circle = lb.predict(posterior, replace(planned, tests=(wanted,)))
    of_two_circles = lb.predict(posterior, replace(planned, tests=(wanted, other))).query(
        "test == 'wanted'"
    )
    width = (of_one_circle["ci_high_um"] - of_one_circle["ci_low_um"]).to_numpy()
    width_beside = (of_two_circles["ci_high_um"] - of_two_circles["ci_low_um"]).to_numpy()
    np.testing.assert_allclose(width, width_beside, rtol=0.15)
    np.testing.assert_allclose(
        of_one_circle["mean_um"].to_numpy(),
        of_two_circles["mean_um"].to_numpy(),
        atol=0.1 * width.max(),
    )


def test_intervals_hold_the_readings_of_the_fit(posterior: xr.DataTree) -> None:
    table = lb.predict(posterior, CAMPAIGN)
    reading = np.concatenate([test.reading_um for test in CAMPAIGN.tests])
    assert ((table["ci_low_um"] < reading) & (reading < table["ci_high_um"])).mean() > 0.9


def test_prediction_of_another_setup_is_refused(posterior: xr.DataTree) -> None:
    second_setup = replace(LATER.tests[0], setup=2)
    message = (
        r"got planes or set-ups with E_Xt0_2, E_Yt0_2 too\. Fit with replace\(campaign, foreseen"
    )
    refuses(message, lb.predict, posterior, replace(LATER, tests=(second_setup,)))


def test_prediction_for_another_machine_is_refused(posterior: xr.DataTree) -> None:
    message = "the plan must be of the posterior's machine wCAFYXZSt"
    refuses(message, lb.predict, posterior, replace(LATER, topology="wFYXZSt"))


def test_an_average_has_no_predictive_groups(averaged: xr.DataTree) -> None:
    refuses(
        "posterior must be of one model, got an average", lb.inference.with_predictive, averaged
    )


@pytest.mark.slow
@pytest.mark.filterwarnings(
    "ignore:The inplace keyword in DataFrame"
)  # arviz-stats 0.8 with pandas 3.1
def test_arviz_judges_the_posterior(checked: xr.DataTree, posterior: xr.DataTree) -> None:
    """Warnings are errors here. Its leave-one-out is that of the nodes, circle by circle."""
    loo = arviz_stats.loo(checked, pointwise=True)
    (nodes,) = Evidences(CAMPAIGN).nodes(MODEL)
    log_evidence = nodes.evidence.log_value
    exact = []
    for nodes_without_test in leave_one_out({"": nodes})[""].values():
        exact.append(log_evidence - nodes_without_test.evidence.log_value)
    np.testing.assert_allclose(loo.elpd_i, exact, atol=0.15)
    rule = StoppingRule(ess=1500.0)
    constant = lb.sample(MODEL.with_degree(0), CAMPAIGN, sampler="independent", seed=3, rule=rule)
    fits = {"linear": checked, "constant": lb.inference.with_predictive(constant)}
    assert set(arviz_stats.compare(fits).index) == {"linear", "constant"}
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
    summary = arviz_stats.summary(lb.to_units(posterior), ci_prob=0.95, ci_kind="eti")
    assert not (summary["sd"].astype(str).astype(float) == 0.0).any()


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
        edition="third",
        terms=("form", "length", "setup", "discrepancy", "hysteresis", "drift", "circle"),
    )
    phi = bound.hyper_prior.quantile(np.full(len(bound.hyper_prior.names), 0.4))
    (log_likelihood,) = log_likelihood_of_tests(bound, phi[None])
    r = 2
    all_rows = np.arange(len(dense.y))
    other_rows = np.flatnonzero(dense.circle != r)

    def log_density(scale: float, rows: np.ndarray) -> float:
        hyper = np.where(np.array(dense.hypers) == "lambda_3", scale, phi)
        covariance = dense.covariance(hyper) + (dense.J * dense.sd**2) @ dense.J.T
        law = stats.multivariate_normal(None, covariance[np.ix_(rows, rows)])
        return float(law.logpdf(dense.y[rows]))

    log_scale = np.linspace(-1.5, 3.5, 150)
    log_prior = stats.invgamma.logpdf(np.exp(2.0 * log_scale), 1.5, scale=1.5) + 2.0 * log_scale
    values = np.array([log_density(scale, all_rows) for scale in np.exp(log_scale)])
    log_all = np.logaddexp.reduce(log_prior + values) - np.logaddexp.reduce(log_prior)
    expected = log_all - log_density(1.0, other_rows)
    assert log_likelihood[r] == pytest.approx(expected, abs=0.01)
