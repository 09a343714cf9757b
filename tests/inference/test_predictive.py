"""Predictions in their layers and nuisances against dense algebra; checks: uniform when the model
is right, small when not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from arviz_stats.base import array_stats
from campaigns import HYPER_UM, oracle_of, plan, simulated
from scipy import stats

import ldbb_bayes as lb
from ldbb_bayes.inference.checks import (
    TestChecks,
    autocorrelation,
    effects_of_failures,
)
from ldbb_bayes.inference.coefficients import (
    machine_coefficients,
    shared_coefficients,
)
from ldbb_bayes.inference.diagnostics import power_sensitivity
from ldbb_bayes.inference.fit import Concern, ConcernKind, Fit, State
from ldbb_bayes.inference.posterior import draws_of, fit_of
from ldbb_bayes.inference.residuals import fit_quality
from ldbb_bayes.model.bound_information import information_of
from ldbb_bayes.model.fourier import basis
from ldbb_bayes.model.terms import Columns
from ldbb_bayes.report.wording import check_notes, check_words, fit_verdict

MODEL = lb.HybridModel.first(0)
PHI = np.array([[0.3e-3, 0.5e-3, 0.4e-3, 2e-3]])


@pytest.mark.parametrize(
    "planned",
    [plan(), plan((40, 50, 60, 45), arc_deg=220.0), plan(work_deg=40.0, compensated=False)],
)
def test_shared_layer_is_the_dense_conditional_mean(planned: lb.Campaign) -> None:
    """E[form + length + mount + force error | y, β, φ] = S Σ⁻¹ (y − Jβ), all terms but set-up
    shift, discrepancy and noise."""
    campaign = simulated(planned)
    bound = lb.HybridModel.first(1).bind(campaign)
    oracle = oracle_of(campaign, 1)
    beta = bound.centre[None] + 0.01 * bound.scale
    shared = oracle.shared(PHI[0])
    residual = oracle.y - oracle.J @ beta[0]
    expected = oracle.J @ beta[0] + shared @ np.linalg.solve(oracle.covariance(PHI[0]), residual)
    offset = np.concatenate([t.readings_mm() for t in campaign.tests]) - oracle.y
    found = shared_coefficients(bound, PHI, beta)[0]
    predicted = np.concatenate(
        [basis(t.angles_rad()) @ a for t, a in zip(campaign.tests, found, strict=True)]
    )
    np.testing.assert_allclose(predicted, expected + offset, atol=1e-9)
    machine = machine_coefficients(bound, beta)[0]
    predicted = np.concatenate(
        [basis(t.angles_rad()) @ a for t, a in zip(campaign.tests, machine, strict=True)]
    )
    np.testing.assert_allclose(predicted, oracle.J @ beta[0] + offset, atol=1e-12)


def test_rmse_and_fitness_by_their_definition() -> None:
    """Eq. 34-35 on the readings themselves; of a dead circle fitness is not a number."""
    made = simulated(plan((9, 40, 50, 30)))
    campaign = lb.Campaign((*made.tests[:3], made.tests[3].with_reading_um(np.zeros(30))))
    bound = lb.HybridModel.first(0).bind(campaign)
    beta = bound.centre[None].repeat(3, axis=0) * [[0.9], [1.0], [1.1]]
    phi = PHI.repeat(3, axis=0)
    quality = fit_quality(bound, phi, beta)
    predicted = shared_coefficients(bound, phi, beta).mean(axis=0)
    errors = [
        basis(t.angles_rad()) @ a - t.readings_mm()
        for t, a in zip(campaign.tests, predicted, strict=True)
    ]
    assert quality.rmse_um == pytest.approx(np.sqrt(np.mean(np.concatenate(errors) ** 2)) * 1e3)
    assert np.isnan(quality.fitness_percent["f742"])
    for test, error in zip(campaign.tests[:3], errors, strict=False):
        expected = 100 * (1 - np.sqrt(np.mean(error**2)) / np.ptp(test.readings_mm()))
        assert quality.fitness_percent[test.name] == pytest.approx(expected)


def fit_to(campaign: lb.Campaign) -> Fit:
    return fit_of(
        lb.sample(MODEL, campaign, sampler="independent", seed=1, rule=lb.StoppingRule(ess=400.0))
    )


def planted(harmonic: int, amplitude_um: float) -> lb.Campaign:
    """A wave on one test of the campaign."""
    campaign = simulated(plan((120,) * 4))
    tests = list(campaign.tests)
    wave = amplitude_um * np.cos(harmonic * tests[2].angles_rad())
    tests[2] = tests[2].with_reading_um(np.asarray(tests[2].reading_um) + wave)
    return replace(campaign, tests=tuple(tests))


def test_a_right_model_passes() -> None:
    """Few readings have no scatter to look at."""
    fit = fit_to(simulated(plan((120, 20, 120, 100), arc_deg=230.0)))
    assert fit.misfits == ()
    assert (
        fit.predictive_checks["f300"].noise_p,
        fit.predictive_checks["f300"].autocorrelation,
    ) == (None, None)
    assert len(fit.checks) == 3 * 15 + 13


@pytest.mark.parametrize(
    ("harmonic", "amplitude_um", "found"),
    [
        (7, 4.0, {"order 7 of f520"}),
        (20, 1.0, {"white noise of f520", "autocorrelation of f520"}),
    ],
)
def test_a_wave_on_one_circle_is_found_where_it_is(
    harmonic: int, amplitude_um: float, found: set[str]
) -> None:
    fit = fit_to(planted(harmonic, amplitude_um))
    every = [check_words(check) for check in fit.unexpected]
    assert found <= set(every)
    assert every[0] in found
    assert fit.state == State.USABLE, "neither moves an interval"


def test_only_what_circles_do_not_share_beyond_the_orders_widens_intervals() -> None:
    """1 µm at order 14: in all alike, nothing; at four phases, as white noise of a variance of 4/3
    · 120/2 · 1/8 µm² more."""
    campaign = simulated(plan((120,) * 4))
    widening = []
    oracle = oracle_of(campaign, 0)
    noisy = PHI[0] * [np.sqrt(1.0 + 10.0 / 0.3**2), 1.0, 1.0, 1.0]
    for turn in (0.0, 0.5 * np.pi):
        waves = [np.cos(14 * test.angles_rad() + k * turn) for k, test in enumerate(campaign.tests)]
        pairs = zip(campaign.tests, waves, strict=True)
        tests = tuple(
            test.with_reading_um(np.asarray(test.reading_um) + wave) for test, wave in pairs
        )
        fails = {test.name: TestChecks({}, 1e-9, 0.9, 1e-9) for test in tests}
        widening.append(
            effects_of_failures(MODEL.bind(replace(campaign, tests=tests)), PHI[0], fails)[1]
        )
    growth = np.sqrt(np.diag(oracle.given(noisy)[2]) / np.diag(oracle.given(PHI[0])[2])).max() - 1.0
    assert widening == [pytest.approx(0.0, abs=0.1), pytest.approx(growth, rel=0.05)]


def test_autocorrelation_of_white_noise_is_uniform_and_of_smoothed_noise_is_seen() -> None:
    rng = np.random.default_rng(2)
    angle = np.sort(rng.uniform(0.0, 360.0, 150))
    p_values = [
        autocorrelation(lb.CircularTest(100.0, angle, rng.normal(size=150)))[1] for _ in range(400)
    ]
    assert stats.kstest(p_values, "uniform").pvalue > 0.01
    smooth = np.convolve(np.random.default_rng(2).normal(size=402), np.ones(3) / 3.0, mode="valid")
    value, p = autocorrelation(lb.CircularTest(100.0, np.arange(400) * 0.9, smooth))
    assert value > 0.5
    assert p < 1e-6
    assert autocorrelation(lb.CircularTest(100.0, np.arange(400) * 0.9, np.zeros(400))) == (
        0.0,
        1.0,
    )


def test_sensitivity_is_that_of_arviz() -> None:
    """Of plain weights, which are nearly even; a constant part counts as none."""
    rng = np.random.default_rng(3)
    draws = {"a": rng.normal(size=(4, 300)), "b": rng.gamma(2.0, size=(4, 300))}
    parts = {
        "one": -0.5 * draws["a"] ** 2,
        "two": draws["a"] - draws["b"],
        "none": np.ones((4, 300)),
    }
    found = power_sensitivity(draws, parts)
    for part in ("one", "two"):
        weights = [np.exp((power - 1.0) * parts[part]) for power in (0.99, 1.01)]
        lower, upper = (weight / weight.sum() for weight in weights)
        for name, values in draws.items():
            expected = array_stats.power_scale_sense(values, lower, upper, 0.99, 1.01)
            assert found[name][part] == pytest.approx(float(expected), rel=1e-9)
    assert [found[own]["none"] for own in draws] == [0.0, 0.0]


def test_the_line_puts_first_what_matters_most() -> None:
    checks = {"a": TestChecks(dict.fromkeys(range(13), 0.5), 0.2, 0.1, 0.3)}
    sensitivity = {
        "E_XX1": {"prior": 0.06},
        "C_XXX": {"prior": 0.2},
        "C_XYX": {"prior": 0.01},
        "tau": {"prior": 0.3},
    }
    fit = Fit(1.0, {"a": 99.0}, -1.0, 0.0, -2.0, 0.0, (), checks, sensitivity, {"a": 0.7}, 0.2)
    missed = Concern(ConcernKind.NOT_CONVERGED, 200.0, 1000.0)
    against = Concern(ConcernKind.TRUNCATION, -20.0, -6.9)
    assert (
        fit_verdict(fit)
        == "Converged; the model expects readings like these (15 checks, smallest p = 0.2, white"
        " noise of a); 2 of 3 parameters are sensitive to their prior (C_XXX, E_XX1)."
    )
    assert (fit.state, fit.kinds) == (State.USABLE, ())
    assert "speak against non-negative compliance" in fit_verdict(replace(fit, concerns=(against,)))
    assert replace(fit, concerns=(against,)).state == State.DOUBTFUL
    assert (
        fit_verdict(replace(fit, concerns=(missed, against)))
        == "NOT CONVERGED: do not use the numbers."
    )
    assert replace(fit, concerns=(missed,)).state == State.UNUSABLE
    unlikely = replace(
        fit, predictive_checks={"a": replace(checks["a"], orders_p={0: 1e-9, 1: 0.5})}
    )
    assert fit_verdict(unlikely).startswith(
        "Converged; the model does not expect readings like these (order 0 of a): without a"
    )
    quiet = replace(unlikely, shift={"a": 0.3})
    assert "(order 0 of a) hardly moves an interval" in fit_verdict(quiet)
    assert (quiet.state, quiet.kinds, len(quiet.unexpected)) == (State.USABLE, (), 1)
    assert list(check_notes(quiet)) == [
        "The model does not expect order 0 of a: without a a parameter moves by 0.3 u."
    ]
    assert (unlikely.state, unlikely.kinds) == (State.DOUBTFUL, ("order",))
    assert "order" not in str(fit)
    assert "<p>Converged; the model does not expect" in unlikely._repr_html_()
    assert Fit.from_dict(unlikely.as_dict()) == unlikely


DRIFTING = lb.HybridModel.first(0).without("truncation").with_term(lb.Drift("time"))


@pytest.fixture(scope="module")
def drifting() -> lb.Campaign:
    planned = plan((40,) * 6, forces_N=(36.0, 300.0, 742.0, 36.0, 300.0, 742.0))
    tests = [
        replace(t, direction="CW" if k < 3 else "CCW", time_s=600.0 * (k * 5 % 6))
        for k, t in enumerate(planned.tests)
    ]
    return DRIFTING.simulate(
        replace(planned, tests=tuple(tests)), seed=3, hyper_um=HYPER_UM
    ).campaign


@pytest.mark.parametrize(
    "model", [DRIFTING, lb.HybridModel.default(0).without("truncation").with_term(lb.Drift("time"))]
)
def test_nuisances_against_dense_conditionals(model: lb.HybridModel, drifting: lb.Campaign) -> None:
    """Means and variances of all coefficients, by name, given φ and the readings, parameters
    integrated out, by one dense matrix per draw of φ; then averaged over φ. Of parameters and
    nuisances alike nothing is sampled."""
    posterior = lb.sample(model, drifting, seed=2, sampler="independent")
    bound = model.bind(drifting)
    shared = [
        term for term in bound.nuisance_columns if isinstance(term, Columns) and not term.private
    ]
    found = lb.nuisances(posterior).loc[[name for term in shared for name in term.names]]
    _, phi = draws_of(posterior, bound, 1000)
    reading = np.concatenate([test.readings_mm() for test in drifting.tests])
    means = []
    variances = []
    for value in phi[::10]:
        named = dict(zip(bound.hyper_prior.names, value, strict=True))
        columns = [
            np.concatenate(
                [basis(t.angles_rad()) @ bound.interest[r] for r, t in enumerate(drifting.tests)]
            )
        ]
        sd = [bound.prior_sd]
        covariance = np.eye(len(reading)) * named["sigma"] ** 2
        start = np.cumsum([0, *(len(t.angle_deg) for t in drifting.tests)])
        for term in bound.nuisance_columns:
            for r, test in enumerate(drifting.tests):
                part = slice(start[r], start[r + 1])
                own = basis(test.angles_rad())
                if not isinstance(term, Columns):
                    covariance[part, part] += (own * term.sd_at(named, r) ** 2) @ own.T
                elif term.private:
                    covariance[part, part] += (own @ term.values[r] * term.sd_at(named) ** 2) @ (
                        own @ term.values[r]
                    ).T
            if isinstance(term, Columns) and not term.private:
                values = [
                    basis(t.angles_rad()) @ term.values[r] for r, t in enumerate(drifting.tests)
                ]
                columns.append(np.concatenate(values))
                sd.append(term.sd_at(named))
        design = np.concatenate(columns, axis=1)
        prior = np.concatenate(sd)
        weight = np.linalg.solve(covariance, design)
        after = np.linalg.inv(design.T @ weight + np.diag(1.0 / prior**2))
        means.append((after @ weight.T @ reading)[len(bound.names) :])
        variances.append(np.diag(after)[len(bound.names) :])
    mean, sd = np.mean(means, axis=0), np.sqrt(np.mean(variances, axis=0) + np.var(means, axis=0))
    np.testing.assert_allclose((found["mean"] - mean) / sd, 0.0, atol=0.25)
    np.testing.assert_allclose(found["sd"] / sd, 1.0, atol=0.12)
    assert set(found.index) == set(information_of(bound, phi[0]).names) - set(bound.names)
    assert (found.loc["drift_time_length", "unit"], found.loc["hysteresis_sin2", "unit"]) == (
        "mm/h",
        "mm",
    )
    flat = lb.sample(
        lb.HybridModel.paper(0),
        drifting,
        seed=1,
        sampler="independent",
        rule=lb.StoppingRule(ess=100.0),
    )
    assert lb.nuisances(flat).empty
