"""Posterior predictive checks: uniform when the model is right, small when not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from campaigns import FORCES_N, HYPER_UM, oracle_of, plan, simulated
from scipy import stats

import ldbb_bayes as lb
from ldbb_bayes.inference import checks as predictive_checks
from ldbb_bayes.inference.centre_shift import _p_value_of_no_slope, centre_shift
from ldbb_bayes.inference.checks import (
    Check,
    CheckKind,
    TestChecks,
    _squares_of_orders,
    autocorrelation,
    check_predictions,
    failing_checks,
)
from ldbb_bayes.inference.effects_of_failures import (
    _noise_variance_above_order_12,
    effects_of_failures,
)
from ldbb_bayes.inference.fit import Fit, State
from ldbb_bayes.inference.posterior import fit_of
from ldbb_bayes.model.fourier import MAX_ORDER, ORDERS, SIZE
from ldbb_bayes.report.wording import check_words

MODEL = lb.HybridModel.first(0)
PHI = np.array([0.3e-3, 0.5e-3, 0.4e-3, 2e-3])


def fit_to(campaign: lb.Campaign) -> Fit:
    rule = lb.inference.StoppingRule(ess=400.0)
    return fit_of(lb.sample(MODEL, campaign, sampler="independent", seed=1, rule=rule))


def planted(harmonic: int, amplitude_um: float, arc_deg: float = 360.0) -> lb.Campaign:
    """A wave on one test of the campaign."""
    campaign = simulated(plan((120,) * 4, arc_deg=arc_deg))
    tests = list(campaign.tests)
    wave = amplitude_um * np.cos(harmonic * tests[2].angles_rad())
    tests[2] = tests[2].with_reading_um(np.asarray(tests[2].reading_um) + wave)
    return replace(campaign, tests=tuple(tests))


def test_a_right_model_passes() -> None:
    """Few readings have no scatter to look at."""
    fit = fit_to(simulated(plan((120, 20, 120, 100), arc_deg=230.0)))
    assert fit.misfits == ()
    assert fit.predictive_checks["f300"].noise_p is None
    assert fit.predictive_checks["f300"].autocorrelation is None
    assert len(fit.checks) == 3 * 15 + 13


def test_the_p_value_of_readings_without_any_noise_is_no_rounding_error(
    rng: np.random.Generator,
) -> None:
    """Twice the lower tail of χ², which is far below the rounding of one less the upper tail."""
    bound = MODEL.bind(simulated(plan((120,) * 4)))
    phi = np.tile(10.0 * PHI, (10, 1))
    beta = np.tile(bound.prior_mean, (10, 1))
    checks = check_predictions(bound, phi, beta, rng)
    for test, reduced in zip(bound.test_names, bound.reduced, strict=True):
        squares = reduced.residual_ss / phi[0, 0] ** 2
        expected = 2.0 * stats.chi2.cdf(squares, reduced.readings - SIZE)
        assert 0.0 < expected < 1e-30
        assert checks[test].noise_p == pytest.approx(expected, rel=1e-6, abs=0.0)


@pytest.mark.parametrize(
    ("harmonic", "amplitude_um", "expected"),
    [
        (7, 4.0, {"order 7 of f520"}),
        (20, 1.0, {"white noise of f520", "autocorrelation of f520"}),
    ],
)
def test_a_wave_on_one_circle_is_found_where_it_is(
    harmonic: int, amplitude_um: float, expected: set[str]
) -> None:
    fit = fit_to(planted(harmonic, amplitude_um))
    unexpected = [check_words(check) for check in fit.unexpected]
    assert expected <= set(unexpected)
    assert unexpected[0] in expected
    assert fit.state == State.USABLE, "neither moves an interval"


@pytest.mark.parametrize("arc_deg", [280.0, 220.0])
def test_a_wave_on_one_arc_is_found_where_it_is(arc_deg: float) -> None:
    """A fit of all 25 coefficients to an arc shows the noise, millions of times as large."""
    unexpected = fit_to(planted(7, 8.0, arc_deg)).unexpected
    assert check_words(unexpected[0]) == "order 7 of f520"


@pytest.mark.parametrize("arc_deg", [360.0, 300.0, 220.0, 190.0])
def test_white_noise_of_an_arc_is_as_large_as_it_is(arc_deg: float) -> None:
    """Variance 1 µm² of 800 circles, whose mean of eight or fewer χ² is known to 2 to 4 %."""
    rng = np.random.default_rng(3)
    campaign = plan((120,) * 4, arc_deg=arc_deg)
    variances = []
    for _ in range(200):
        tests = tuple(test.with_reading_um(rng.standard_normal(120)) for test in campaign.tests)
        bound = MODEL.bind(replace(campaign, tests=tests))
        variances.append(_noise_variance_above_order_12(bound))
    assert np.mean(variances) == pytest.approx(1e-6, rel=0.12)


def widening_by_waves(campaign: lb.Campaign, turn_rad: float) -> float:
    """Widening of intervals by 1 µm at order 14, turned from circle to circle."""
    tests = []
    for index, test in enumerate(campaign.tests):
        wave = np.cos(14 * test.angles_rad() + index * turn_rad)
        tests.append(test.with_reading_um(np.asarray(test.reading_um) + wave))
    failing = {test.name: TestChecks({}, 1e-9, 0.9, 1e-9) for test in tests}
    bound = MODEL.bind(replace(campaign, tests=tuple(tests)))
    return effects_of_failures(bound, PHI, failing)[1]


def test_only_what_circles_do_not_share_beyond_the_orders_widens_intervals() -> None:
    """1 µm at order 14: in all circles the same, nothing.

    At four phases, as white noise of a variance of 4/3 · 120/2 · 1/8 µm² more.
    """
    campaign = simulated(plan((120,) * 4))
    oracle = oracle_of(campaign, 0)
    noisy = PHI * [np.sqrt(1.0 + 10.0 / 0.3**2), 1.0, 1.0, 1.0]
    variance = np.diag(oracle.given(PHI)[2])
    variance_with_noise = np.diag(oracle.given(noisy)[2])
    growth = np.sqrt(variance_with_noise / variance).max() - 1.0
    assert widening_by_waves(campaign, 0.0) == pytest.approx(0.0, abs=0.1)
    assert widening_by_waves(campaign, 0.5 * np.pi) == pytest.approx(growth, rel=0.05)


def test_autocorrelation_of_white_noise_is_uniform() -> None:
    rng = np.random.default_rng(2)
    angle = np.sort(rng.uniform(0.0, 360.0, 150))
    p_values = []
    for _ in range(400):
        test = lb.CircularTest(100.0, angle, rng.normal(size=150))
        p_values.append(autocorrelation(test)[1])
    assert stats.kstest(p_values, "uniform").pvalue > 0.01


@pytest.mark.parametrize("readings", [36, 72])
def test_autocorrelation_of_few_readings_is_uniform(readings: int) -> None:
    """The residuals of a full circle of few readings are of few orders, and vary little."""
    rng = np.random.default_rng(2)
    angle = np.arange(readings) * 360.0 / readings
    p_values = []
    for _ in range(400):
        test = lb.CircularTest(100.0, angle, rng.normal(size=readings))
        p_values.append(autocorrelation(test)[1])
    assert stats.kstest(p_values, "uniform").pvalue > 0.01


def test_autocorrelation_with_one_degree_of_freedom_says_nothing() -> None:
    reading = np.random.default_rng(2).normal(size=26)
    assert autocorrelation(lb.CircularTest(100.0, np.arange(26) * 360.0 / 26, reading))[1] > 0.99


def test_autocorrelation_of_smoothed_noise_is_seen() -> None:
    noise = np.random.default_rng(2).normal(size=402)
    smooth = np.convolve(noise, np.ones(3) / 3.0, mode="valid")
    value, p = autocorrelation(lb.CircularTest(100.0, np.arange(400) * 0.9, smooth))
    assert value > 0.5
    assert p < 1e-6


def test_a_dead_circle_has_no_autocorrelation() -> None:
    dead = lb.CircularTest(100.0, np.arange(400) * 0.9, np.zeros(400))
    assert autocorrelation(dead) == (0.0, 1.0)


def with_moving_centre(campaign: lb.Campaign, plane: str) -> lb.Campaign:
    """The centre of the circles of one plane moves along X by 0.1 µm per newton."""
    tests = []
    for test in campaign.tests:
        reading = np.asarray(test.reading_um)
        if test.plane == plane:
            wave = np.cos(test.angles_rad()) if plane == "XY" else np.sin(test.angles_rad())
            reading = reading + 0.1 * test.force_N * wave
        tests.append(test.with_reading_um(reading))
    return replace(campaign, tests=tuple(tests))


@pytest.mark.parametrize("slope", [0.0, 0.7, -3.0])
def test_the_p_value_of_a_slope_is_that_of_linear_regression(
    slope: float, rng: np.random.Generator
) -> None:
    """Two-sided, with n − 2 degrees of freedom."""
    force_N = np.array([50.0, 200.0, 350.0, 500.0, 650.0])
    centre = 1e-3 * (slope * force_N / 650.0 + rng.standard_normal(5))
    expected = stats.linregress(force_N, centre).pvalue
    assert _p_value_of_no_slope(force_N, centre) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("plane", ["XY", "ZX"])
def test_a_centre_that_moves_in_one_plane_is_seen_beside_others(plane: str) -> None:
    """X belongs to two planes; a quiet one does not hide the other."""
    tests = []
    for name in ("XY", "YZ", "ZX"):
        for force in FORCES_N:
            tests.append(lb.CircularTest(force, np.arange(0.0, 360.0, 5.0), plane=name))
    simulation = MODEL.simulate(lb.Campaign(tests), seed=1, hyper_um=HYPER_UM)
    bound = MODEL.bind(simulation.campaign)
    beta = np.array([simulation.parameters[name] for name in bound.names])
    assert centre_shift(bound, beta) == {}
    moving = MODEL.bind(with_moving_centre(simulation.campaign, plane))
    assert list(centre_shift(moving, beta)) == ["X"]


@pytest.mark.parametrize(("moves", "expected"), [(True, {"X"}), (False, set())])
def test_a_centre_that_moves_is_told_from_a_mount_that_yields_on_arcs(
    moves: bool, expected: set[str]
) -> None:
    """0.02 µm per newton along X, or in all directions, with noise of 0.1 µm."""
    rng = np.random.default_rng(5)
    tests = []
    for test in plan((120,) * 4, arc_deg=220.0).tests:
        shape = np.cos(test.angles_rad()) if moves else np.ones(120)
        noise = 0.1 * rng.standard_normal(120)
        tests.append(test.with_reading_um(0.02 * float(test.force_N or 0.0) * shape + noise))
    bound = MODEL.bind(lb.Campaign(tuple(tests)))
    assert set(centre_shift(bound, np.zeros(len(bound.names)))) == expected


def test_p_values_of_orders_are_those_of_chi_squares(
    monkeypatch: pytest.MonkeyPatch, rng: np.random.Generator
) -> None:
    """Of one degree of freedom at the order 0, of two at all others; averaged over the draws."""
    bound = MODEL.bind(simulated(plan()))
    squares = rng.gamma(2.0, size=(3, MAX_ORDER + 1))
    monkeypatch.setattr(predictive_checks, "_squares_of_orders", lambda *_: squares)
    checks = check_predictions(bound, np.tile(PHI, (3, 1)), np.tile(bound.prior_mean, (3, 1)), rng)
    freedom = np.array([1, *[2] * MAX_ORDER])
    expected = stats.chi2(freedom).sf(squares).mean(axis=0)
    for of_test in checks.values():
        assert list(of_test.orders_p.values()) == pytest.approx(expected, rel=1e-9)


def test_squares_of_orders_are_those_of_each_covariance() -> None:
    """Beside the covariance matrix of each order in full, solved draw by draw."""
    rng = np.random.default_rng(8)
    residual = rng.normal(size=(5, SIZE))
    columns = rng.normal(size=(SIZE, 40))
    sd = rng.gamma(2.0, size=(5, 40))
    squares = _squares_of_orders(residual, columns, sd)
    for order in range(MAX_ORDER + 1):
        own = order == ORDERS
        for draw in range(5):
            covariance = columns[own] @ np.diag(sd[draw] ** 2) @ columns[own].T
            expected = residual[draw, own] @ np.linalg.solve(covariance, residual[draw, own])
            assert squares[draw, order] == pytest.approx(expected, rel=1e-10)


def test_one_of_a_hundred_right_fits_has_a_failing_check(rng: np.random.Generator) -> None:
    """However many checks a fit has: their p-values are uniform where the model is right."""
    alarms = []
    for p_values in rng.random((20_000, 30)):
        checks = [Check(CheckKind.NOISE, "f300", p) for p in p_values]
        alarms.append(bool(failing_checks(checks)))
    assert np.mean(alarms) == pytest.approx(0.01, abs=0.003)


def test_a_failing_circle_shifts_by_the_most_sds_of_any_parameter() -> None:
    """Posterior means with and without the circle, by the dense oracle."""
    campaign = planted(3, 4.0)
    bound = MODEL.bind(campaign)
    failing = {"f520": TestChecks({3: 1e-9}, None, None, None)}
    shift, _ = effects_of_failures(bound, PHI, failing)
    remaining = tuple(test for test in campaign.tests if test.name != "f520")
    whole = oracle_of(campaign, 0).given(PHI)
    without = oracle_of(replace(campaign, tests=remaining), 0).given(PHI)
    sd = np.sqrt(np.diag(whole.covariance))
    expected = np.max(np.abs(without.mean - whole.mean) / sd)
    # The compliance that sizes the force errors is estimated anew by the oracle.
    assert shift["f520"] == pytest.approx(expected, rel=0.02)
