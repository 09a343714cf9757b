"""Checks against the readings: uniform when the model is right, small when something is planted."""

from __future__ import annotations

from dataclasses import replace

import arviz_base
import arviz_stats
import numpy as np
import pytest
from campaigns import HYPER_UM, TRUTH, plan, simulated
from scipy import stats

import ldbb_bayes as lb
from ldbb_bayes.inference.diagnostics import PredictiveChecks, autocorrelation, predictive_checks, sensitive, verdict
from ldbb_bayes.inference.origin import bound_of, draws_of, record_of
from ldbb_bayes.inference.posterior import power_sensitivity

MODEL = lb.HybridModel.default(0)


def checks_of(campaign: lb.Campaign, model: lb.HybridModel = MODEL) -> PredictiveChecks:
    tree = lb.sample(model, campaign, sampler="quadrature", seed=1)
    bound = bound_of(tree)
    beta, phi = (part.reshape(-1, part.shape[-1]) for part in draws_of(tree, bound))
    return predictive_checks(bound, phi, beta, np.random.default_rng(0))


def planted(harmonic: int, amplitude_um: float) -> lb.Campaign:
    """A wave on one test of the campaign."""
    campaign = simulated(plan((120,) * 4))
    tests = list(campaign.tests)
    wave = amplitude_um * np.cos(harmonic * tests[2].angles_rad())
    tests[2] = tests[2].with_reading_um(np.asarray(tests[2].reading_um) + wave)
    return replace(campaign, tests=tuple(tests))


def test_a_right_model_passes() -> None:
    for arc in (360.0, 230.0):
        checks = checks_of(simulated(plan((120, 90, 120, 100), arc_deg=arc)))
        assert checks.misfits == ()
        assert len(checks.tests) == 4
        assert checks.worst()[2] == 4 * 15


@pytest.mark.parametrize("harmonic", [4, 7])
def test_a_wave_on_one_circle_is_found_at_its_order(harmonic: int) -> None:
    checks = checks_of(planted(harmonic, 4.0))
    assert checks.misfits[0] == f"order {harmonic} of f520"


def test_a_wave_beyond_the_basis_is_found_in_the_scatter() -> None:
    checks = checks_of(planted(20, 1.0))
    assert {"white noise of f520", "autocorrelation of f520"} <= set(checks.misfits)


def test_few_readings_have_no_scatter_to_look_at() -> None:
    checks = checks_of(simulated(plan((20, 40, 40, 40))))
    assert checks.tests["f036"].noise_p is None
    assert checks.tests["f036"].autocorrelation is None
    assert checks.tests["f300"].noise_p is not None


def test_autocorrelation_of_white_noise_is_uniform() -> None:
    rng = np.random.default_rng(2)
    angle = np.sort(rng.uniform(0.0, 360.0, 150))
    p_values = [autocorrelation(lb.CircularTest(100.0, angle, rng.normal(size=150)))[1] for _ in range(400)]
    assert stats.kstest(p_values, "uniform").pvalue > 0.01


def test_autocorrelation_of_smoothed_noise_is_seen() -> None:
    rng = np.random.default_rng(2)
    smooth = np.convolve(rng.normal(size=402), np.ones(3) / 3.0, mode="valid")
    value, p = autocorrelation(lb.CircularTest(100.0, np.arange(400) * 0.9, smooth))
    assert value > 0.5
    assert p < 1e-6
    assert autocorrelation(lb.CircularTest(100.0, np.arange(400) * 0.9, np.zeros(400))) == (0.0, 1.0)


def test_sensitivity_of_a_conjugate_normal() -> None:
    """y ~ N(x, 1), x ~ N(0, s²): a tight prior moves the posterior when scaled, a wide one does not."""
    rng = np.random.default_rng(0)
    found = {}
    for scale in (0.5, 50.0):
        precision = 1.0 + 1.0 / scale**2
        x = rng.normal(3.0 / precision, precision**-0.5, (4, 2000))
        parts = {"prior": stats.norm(0.0, scale).logpdf(x), "likelihood": stats.norm(3.0, 1.0).logpdf(x)}
        found[scale] = power_sensitivity({"x": x}, parts)["x"]
    assert found[0.5]["prior"] > 0.1
    assert found[50.0]["prior"] < 0.02
    assert found[50.0]["likelihood"] > 0.05
    assert sensitive({"a": {"prior": 0.06}, "b": {"prior": 0.2}, "c": {"prior": 0.01}}) == ("b", "a")


def test_sensitivity_is_that_of_arviz() -> None:
    """Of arrays here, of labelled data there; a part that is constant counts as none."""
    rng = np.random.default_rng(3)
    draws = {"a": rng.normal(size=(4, 300)), "b": rng.gamma(2.0, size=(4, 300))}
    parts = {"one": -0.5 * draws["a"] ** 2, "two": draws["a"] - draws["b"], "none": np.ones((4, 300))}
    found = power_sensitivity(draws, parts)
    for name in ("one", "two"):
        tree = arviz_base.from_dict({"posterior": draws, "log_prior": {"part": parts[name]}})
        expected = arviz_stats.psense(tree, group="prior")
        assert [found[own][name] for own in draws] == pytest.approx([float(expected[own]) for own in draws], rel=1e-12)
    assert [found[own]["none"] for own in draws] == [0.0, 0.0]


def test_every_result_says_in_one_line_whether_it_can_be_used() -> None:
    model = MODEL.without("discrepancy")
    hyper = HYPER_UM | {"kappa": 3.0}
    campaign = MODEL.simulate(plan((120,) * 4), seed=1, parameters=TRUTH, hyper_um=hyper).campaign
    tree = lb.sample(model, campaign, sampler="quadrature", seed=1)
    fit = record_of(tree)["fit"]
    assert fit["verdict"].startswith("Converged; the model does not expect readings like these (")
    assert lb.summarize(tree).attrs["verdict"] == fit["verdict"]
    assert set(fit["sensitivity"]["C_XXX"]) == {"prior", "hyper_prior", "likelihood"}
    assert set(fit["predictive_checks"]["f300"]) == {"orders_p", "noise_p", "autocorrelation", "autocorrelation_p"}


def test_the_line_puts_first_what_matters_most() -> None:
    checks = checks_of(simulated(plan()))
    given = {"checks": checks, "sensitive_to_prior": ("E_XX1",), "parameters": 17}
    assert verdict(converged=False, contradicts=True, **given) == "NOT CONVERGED: do not use the numbers."
    assert "speak against non-negative compliance" in verdict(converged=True, contradicts=True, **given)
    assert verdict(converged=True, contradicts=False, **given).endswith("1 of 17 numbers are sensitive to their prior (E_XX1).")
