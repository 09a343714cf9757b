"""Ranks of posterior draws in the campaign enlarged by simulated readings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from campaigns import plan, refuses, simulated
from reports import fitted

import ldbb_bayes as lb
from ldbb_bayes.analysis.posterior_calibration import _enlarge, _with_times, calibrate_posterior
from ldbb_bayes.inference.coefficients import ModelDraws
from ldbb_bayes.inference.posterior import bound_of, draws_of

CONSTANT = lb.HybridModel.first(0)


@pytest.fixture(scope="module")
def posterior() -> xr.DataTree:
    return fitted(CONSTANT, simulated(plan()))


def test_every_test_is_run_once_more(posterior: xr.DataTree) -> None:
    bound = bound_of(posterior)
    beta, phi = draws_of(posterior, bound, 1)
    truth = ModelDraws(bound, phi, beta)
    enlarged = _enlarge(bound.campaign, truth, np.random.default_rng(0))
    forces_N = [test.force_N for test in bound.campaign.tests]
    assert [test.force_N for test in enlarged.tests] == forces_N * 2
    assert not enlarged.is_plan


def test_repeated_tests_have_the_times_of_the_listed_order() -> None:
    timed = _with_times(simulated(plan()))
    assert [test.time_s for test in timed.tests] == [0.0, 360.0, 720.0, 1080.0]


def test_stated_times_are_kept() -> None:
    campaign = simulated(plan())
    tests = []
    for k, test in enumerate(campaign.tests):
        tests.append(replace(test, time_s=100.0 * k))
    timed = replace(campaign, tests=tuple(tests))
    assert _with_times(timed) is timed


def test_an_average_is_refused(recovered: lb.Campaign) -> None:
    models = {"constant": CONSTANT, "linear": lb.HybridModel.first(1)}
    average = lb.average(models, recovered, draws=400)
    refuses("of one model", calibrate_posterior, average)


def test_more_replicates_than_draws_are_refused(posterior: xr.DataTree) -> None:
    refuses("Ask for fewer replicates", calibrate_posterior, posterior, replicates=100_000)


@pytest.mark.slow
def test_the_posterior_is_calibrated(posterior: xr.DataTree) -> None:
    validation = calibrate_posterior(posterior, replicates=100, draws=19)
    assert validation.calibrated
    assert validation.coverage()["50"].mean() == pytest.approx(0.5, abs=0.05)


@pytest.mark.slow
def test_a_posterior_that_is_too_narrow_is_found(posterior: xr.DataTree) -> None:
    """True values drawn from a posterior of twice the width leave the band."""
    wide = posterior.copy(deep=True)
    for name in ("C_XXX", "C_YYY", "E_XX1"):
        draws = wide["posterior"][name]
        middle = draws.mean()
        wide["posterior"][name] = middle + 4.0 * (draws - middle)
    validation = calibrate_posterior(wide, replicates=60, draws=19)
    assert {"C_XXX", "C_YYY", "E_XX1"} <= set(validation.outside)
