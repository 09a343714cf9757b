"""Ranks of posterior draws in the campaign enlarged by simulated readings."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from campaigns import plan, refuses, simulated
from reports import fitted

import ldbb_bayes as lb
from ldbb_bayes.analysis import posterior_calibration
from ldbb_bayes.analysis.posterior_calibration import _enlarge, calibrate_posterior
from ldbb_bayes.campaign.run_times import with_listed_times
from ldbb_bayes.inference.coefficients import ModelDraws
from ldbb_bayes.inference.posterior import bound_of, draws_of
from ldbb_bayes.inference.prediction import new_circles
from ldbb_bayes.inference.sample import IndependentDraws, draw
from ldbb_bayes.results import Array

CONSTANT = lb.HybridModel.first(0)
# Effects of the model whose circles differ from one another in nothing but how much they scatter.
SCATTER = ("setup-shift", "discrepancy", "circle-scale")


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
    timed = with_listed_times(simulated(plan()))
    assert [test.time_s for test in timed.tests] == [0.0, 360.0, 720.0, 1080.0]


def test_stated_times_are_kept() -> None:
    campaign = simulated(plan())
    tests = []
    for k, test in enumerate(campaign.tests):
        tests.append(replace(test, time_s=100.0 * k))
    timed = replace(campaign, tests=tuple(tests))
    assert with_listed_times(timed) is timed


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


def shifted(draws: Array) -> Array:
    """Return draws that lie one and a half standard deviations too high."""
    return np.asarray(draws + 1.5 * draws.std(axis=0))


def narrowed(draws: Array) -> Array:
    """Return draws that scatter by a quarter of what they should."""
    middle = draws.mean(axis=0)
    return np.asarray(middle + 0.25 * (draws - middle))


@pytest.mark.slow
@pytest.mark.parametrize("spoil", [shifted, narrowed])
def test_a_sampler_that_is_wrong_is_found(
    posterior: xr.DataTree, monkeypatch: pytest.MonkeyPatch, spoil: Callable[[Array], Array]
) -> None:
    """The draws of every enlarged campaign are spoilt; without that, the ranks are uniform."""

    def draw_wrongly(*arguments: object, seed: np.random.SeedSequence) -> IndependentDraws:
        draws = draw(*arguments, seed=seed)  # type: ignore[arg-type]
        return draws._replace(beta=spoil(draws.beta))

    monkeypatch.setattr(posterior_calibration, "draw", draw_wrongly)
    validation = calibrate_posterior(posterior, replicates=40, draws=19)
    assert {"C_XXX", "C_YYY", "E_XX1"} <= set(validation.outside)
    assert not {"sigma", "tau"} & set(validation.outside)


@pytest.fixture(scope="module")
def posterior_of_scattering_circles() -> xr.DataTree:
    """Six circles that scatter alike, so that their noise factors are learnt to be alike."""
    model = lb.HybridModel.default(0).without("truncation")
    others = [term.key() for term in model.nuisances if term.key() not in SCATTER]
    model = model.without(*others)
    planned = plan((40,) * 6, forces_N=(36.0, 180.0, 320.0, 460.0, 600.0, 742.0))
    scales_um = dict.fromkeys(("sigma", "delta", "kappa"), 1.0)
    for test in planned.tests:
        scales_um[f"lambda_{test.name}"] = 1.0
    simulation = model.simulate(planned, seed=1, parameters={}, hyper_um=scales_um)
    return fitted(model, simulation.campaign)


@pytest.mark.slow
def test_circles_that_scatter_differently_are_calibrated(
    posterior_of_scattering_circles: xr.DataTree,
) -> None:
    validation = calibrate_posterior(posterior_of_scattering_circles, replicates=100, draws=19)
    assert validation.calibrated, validation.outside


@pytest.mark.slow
def test_three_circles_are_calibrated() -> None:
    """Too few for noise factors of circles; of six, three measured and three simulated, each would
    have one."""
    three = simulated(plan([40] * 3, forces_N=(100.0, 400.0, 700.0)))
    posterior = lb.sample(lb.HybridModel.default(1), three, sampler="independent", seed=1)
    for seed in (1, 2):
        validation = calibrate_posterior(posterior, replicates=60, draws=99, seed=seed)
        assert validation.calibrated, validation


@pytest.mark.slow
def test_readings_that_the_model_does_not_simulate_are_found(
    posterior: xr.DataTree, monkeypatch: pytest.MonkeyPatch
) -> None:
    """New circles shift and scatter four times as much as the posterior of their scales says."""

    def scattering_circles(
        truth: ModelDraws, planned: lb.Campaign, rng: np.random.Generator, *, learn_spread: bool
    ) -> Iterator[Array]:
        assert not learn_spread
        phi = truth.phi.copy()
        for name in ("delta", "kappa"):
            phi[:, truth.bound.hyper_prior.names.index(name)] *= 4.0
        return new_circles(truth._replace(phi=phi), planned, rng, learn_spread=False)

    monkeypatch.setattr(posterior_calibration, "new_circles", scattering_circles)
    validation = calibrate_posterior(posterior, replicates=40, draws=19)
    assert {"delta", "kappa"} <= set(validation.outside)
