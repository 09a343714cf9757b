"""sample(): layout, reproducibility, agreement of what is stored, what a fit finds; two routes and
a third to one posterior."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import arviz_stats
import arviz_stats.base
import numpy as np
import pytest
import xarray as xr
from campaigns import TRUTH, plan, refuses, simulated
from collapsed import collapsed

import ldbb_bayes as lb
from ldbb_bayes.campaign.campaign import Direction
from ldbb_bayes.inference import posterior as posteriors
from ldbb_bayes.inference.density import JointDensity
from ldbb_bayes.inference.fit import State
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.inference.independent_sampler import (
    JointDraws,
    TooRoughError,
    _effective_number,
    draw_jointly,
)
from ldbb_bayes.inference.mcmc import Assessment, Progress, StoppingRule
from ldbb_bayes.inference.posterior import bound_of, campaign_of, draws_of, fit_of, record_of
from ldbb_bayes.inference.sample import _further_steps, run_sampler
from ldbb_bayes.inference.summary import result_json
from ldbb_bayes.model.fourier import basis
from ldbb_bayes.report.fit_description import describe_fit
from ldbb_bayes.report.wording import sampler_words, validation_verdict
from ldbb_bayes.units import to_inside

QUICK = StoppingRule(ess=300.0, rhat=1.05, lengths=1.0)
ROUGH = StoppingRule(ess=150.0, rhat=1.1, lengths=0.3)
MODEL = lb.HybridModel.first(1)
CONSTANT = lb.HybridModel.first(0)
FEW = simulated(plan((30, 30, 30), forces_N=(36.0, 400.0, 742.0)))


@pytest.fixture(scope="module")
def campaign() -> lb.Campaign:
    return simulated(plan(compensated=False))


@pytest.fixture(scope="module", params=["joint", "independent"])
def either(campaign: lb.Campaign, request: pytest.FixtureRequest) -> xr.DataTree:
    return lb.sample(MODEL, campaign, sampler=request.param, seed=3, rule=QUICK)


@pytest.fixture(scope="module")
def posterior(campaign: lb.Campaign) -> xr.DataTree:
    return lb.sample(MODEL, campaign, sampler="independent", seed=3, rule=ROUGH)


@pytest.mark.slow
def test_a_posterior_has_the_groups_and_variables_of_arviz(
    either: xr.DataTree, campaign: lb.Campaign
) -> None:
    sampled = {"posterior", "prior", "sample_stats", "log_prior"}
    assert set(either.children) == sampled | {"observed_data", "constant_data", "provenance"}
    assert list(either["posterior"].data_vars) == [
        *MODEL.bind(campaign).names,
        "sigma",
        "delta",
        "kappa",
        "tau",
    ]
    assert either["posterior"]["C_XXX"].dims == ("chain", "draw")
    assert either["posterior"].sizes["chain"] == 4
    assert either["posterior"]["C_CCY"].attrs["unit"] == "rad/(N mm)"
    readings = np.concatenate([t.readings_mm() for t in campaign.tests])
    np.testing.assert_array_equal(either["observed_data"]["reading_mm"].to_numpy(), readings)


def test_stored_densities_are_consistent(either: xr.DataTree, campaign: lb.Campaign) -> None:
    """lp = ln likelihood + ln prior(β) + ln prior(φ) + Jacobian of the free coordinates, up to
    nothing at all."""
    bound = MODEL.bind(campaign)
    pick = {"chain": 2, "draw": 17}
    draws = either["posterior"].isel(pick)
    log_prior = either["log_prior"].isel(pick)
    beta = np.array([[float(draws[name]) for name in bound.names]])
    phi = np.array([[float(draws[name]) for name in bound.hyper_prior.names]])
    prior = (
        float(log_prior["parameters"])
        + float(log_prior["hyper"])
        + bound.hyper_prior.free(phi).sum()
    )
    expected = bound.log_likelihood(phi, beta)[0] + prior
    assert float(either["sample_stats"]["lp"].isel(pick)) == pytest.approx(expected, abs=1e-6)


def test_draws_and_prior_are_inside_the_truncation(either: xr.DataTree) -> None:
    bound = bound_of(either)
    for group in (either["posterior"], either["prior"]):
        beta = np.stack([group[name].to_numpy() for name in bound.names], axis=-1)
        assert bound.truncation.holds(beta).all()
    assert either["posterior"]["sigma"].min() >= 0.24e-3 / np.sqrt(12.0)
    assert either["prior"]["C_XYX"].to_numpy().std() == pytest.approx(1e-5, rel=0.05)


@pytest.mark.slow
def test_same_seed_same_draws(campaign: lb.Campaign, either: xr.DataTree) -> None:
    again = lb.sample(
        MODEL, campaign, sampler=record_of(either)["sampler"]["kind"], seed=3, rule=QUICK
    )
    assert again["posterior"].dataset.drop_attrs().equals(either["posterior"].dataset.drop_attrs())


def test_diagnostics_are_arvizs(either: xr.DataTree) -> None:
    table = lb.summarize(either)
    reference = arviz_stats.summary(either, ci_prob=0.95, ci_kind="eti", round_to="none")
    for column, rtol in (("mean", 1e-10), ("sd", 1e-3), ("ess_bulk", 1e-6)):
        np.testing.assert_allclose(
            table[column].astype(float), reference[column].astype(float), rtol=rtol
        )
    record = record_of(either)["sampler"]
    assert record["converged"]
    assert record["ess_bulk_min"] == pytest.approx(table["ess_bulk"].min())
    # The chain is judged in ln φ: folded about its median, as R-hat does for scales, κ has other
    # ranks than ln κ.
    assert record["rhat_max"] == pytest.approx(table["rhat"].max(), abs=1e-4)
    assert table[["ess_bulk", "ess_tail"]].to_numpy().min() >= 300.0


def test_summary_numbers(posterior: xr.DataTree) -> None:
    draws = posterior["posterior"]["C_XXX"].to_numpy().ravel()
    row = lb.summarize(posterior, prob=0.9).loc["C_XXX"]
    np.testing.assert_allclose([row["ci_low"], row["ci_high"]], np.quantile(draws, [0.05, 0.95]))
    assert (row["prior_sd"], row["unit"]) == (1e-4, "mm/N")
    refuses("prob must be a number between 0 and 1, got 95", lb.summarize, posterior, prob=95)
    result = result_json(posterior)
    sigma = posterior["posterior"]["sigma"].to_numpy()
    assert result["parameters"]["C_XXX"]["ci95"] == pytest.approx(
        np.quantile(draws, [0.025, 0.975])
    )
    assert result["hyper"]["sigma_um"]["ci95"] == pytest.approx(
        1e3 * np.quantile(sigma, [0.025, 0.975])
    )
    assert result["hyper"]["tau_um"]["prior_sd"] == pytest.approx(
        5.0 * np.sqrt(1 - 2 / np.pi), rel=1e-3
    )


@pytest.mark.parametrize("degree", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_no_mean_or_sd_is_rounded_to_zero(recovered: lb.Campaign, degree: int) -> None:
    """ArviZ rounds to two decimals, in whatever unit."""
    rule = StoppingRule(ess=200.0)
    model = lb.HybridModel.default(degree)
    posterior = lb.sample(model, recovered, sampler="independent", seed=1, rule=rule)
    in_units = lb.to_units(posterior)
    summary = arviz_stats.summary(in_units)[["mean", "sd"]]
    assert not (summary.astype(str).astype(float) == 0.0).any(axis=None)
    assert all("units" in draws.attrs for draws in in_units["posterior"].data_vars.values())


def test_draws_in_units_for_reading_are_not_saved(posterior: xr.DataTree, tmp_path: Path) -> None:
    in_units = lb.to_units(posterior)
    refuses("got one in units for reading", lb.save, in_units, tmp_path / "posterior.nc")


def test_draws_in_units_for_reading(posterior: xr.DataTree) -> None:
    """The same draws with the labels of the tables, also for ArviZ; an analysis refuses them, whose
    numbers would be wrong."""
    in_units = lb.to_units(posterior)
    plain = posterior["posterior"].data_vars
    means = arviz_stats.summary(in_units, round_to="none")["mean"].astype(float)
    assert means["C_XXX"] == pytest.approx(1e6 * plain["C_XXX"].mean())
    for name, draws in in_units["posterior"].data_vars.items():
        inside = []
        for value in draws[0, :3].values.tolist():
            quantity = f"{value!r} {draws.attrs['units']}"
            inside.append(to_inside(quantity, plain[name].attrs["unit"]))
        np.testing.assert_allclose(inside, plain[name][0, :3], rtol=1e-12)
        assert in_units["prior"][name].attrs == draws.attrs
    assert in_units["constant_data"]["force_N"].equals(posterior["constant_data"]["force_N"])
    refuses("got one in units for reading", lb.summarize, in_units)


@pytest.fixture
def no_campaign_is_known(monkeypatch: pytest.MonkeyPatch) -> None:
    """Campaigns are made from what posteriors state, as in a process that has not fitted them."""
    monkeypatch.setattr(posteriors, "_CAMPAIGNS", {})


@pytest.fixture(scope="module")
def file(posterior: xr.DataTree, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The posterior, saved."""
    return lb.save(posterior, tmp_path_factory.mktemp("saved") / "posterior.nc")


@pytest.mark.usefixtures("no_campaign_is_known")
def test_saved_and_read_back_identically(
    posterior: xr.DataTree, campaign: lb.Campaign, file: Path
) -> None:
    read = lb.load(file.parent)
    assert read.identical(posterior)
    assert [p.name for p in file.parent.iterdir()] == ["posterior.nc"]
    back = campaign_of(read)
    assert back.sha256 == campaign.sha256 == record_of(posterior)["campaign"]["sha256"]
    assert (back.mount, back.force_law, back.name) == (
        campaign.mount,
        campaign.force_law,
        campaign.name,
    )
    assert bound_of(posterior).model == MODEL
    np.testing.assert_array_equal(
        bound_of(posterior).interest_columns, MODEL.bind(campaign).interest_columns
    )


def test_posteriors_of_one_campaign_share_its_bound_model(
    posterior: xr.DataTree, file: Path
) -> None:
    read = lb.load(file)
    assert campaign_of(read) is campaign_of(posterior)
    assert bound_of(read) is bound_of(posterior)


def test_a_posterior_with_other_readings_has_a_campaign_of_its_own(
    posterior: xr.DataTree, campaign: lb.Campaign
) -> None:
    changed = posterior.copy(deep=True)
    changed["constant_data"]["reading_as_read_um"].values[0] += 1.0
    first = campaign_of(changed).tests[0].reading_um
    assert first is not None
    assert first[0] == campaign.tests[0].reading_um[0] + 1.0


def test_only_the_campaigns_of_the_last_posteriors_are_kept(
    posterior: xr.DataTree, monkeypatch: pytest.MonkeyPatch
) -> None:
    campaigns: dict[object, lb.Campaign] = {}
    monkeypatch.setattr(posteriors, "_CAMPAIGNS", campaigns)
    for k in range(12):
        changed = posterior.copy(deep=True)
        changed["constant_data"]["reading_as_read_um"].values[0] = float(k)
        campaign_of(changed)
    assert len(campaigns) == 8


@pytest.mark.usefixtures("no_campaign_is_known")
def test_every_field_of_a_campaign_comes_back() -> None:
    tests = [
        replace(t, direction="CCW", temperature_C=20.5, time_s=60.0 * k, setup=k + 1)
        for k, t in enumerate(FEW.tests)
    ]
    foreseen = (replace(tests[0].with_reading_um(None), radius_mm=100.0, name=""),)
    full = replace(
        FEW,
        tests=tuple(tests),
        foreseen=foreseen,
        machine_id="VMC 07",
        date="2026-11-20",
        feed_mm_per_min=2000.0,
        order="random",
        drift=False,
    )
    tree = lb.sample(CONSTANT.without("ball-form"), full, sampler="independent", rule=ROUGH)
    posteriors._CAMPAIGNS.clear()
    assert campaign_of(tree) is not full
    assert campaign_of(tree).sha256 == full.sha256
    assert (campaign_of(tree).machine_id, campaign_of(tree).date) == ("VMC 07", "2026-11-20")
    assert (campaign_of(tree).order, campaign_of(tree).drift) == ("random", False)


@pytest.mark.slow
def test_damaged_results_are_refused(tmp_path: Path, file: Path) -> None:
    for content in (file.read_bytes()[:50_000], b"not a file of ours", b""):
        (tmp_path / "posterior.nc").write_bytes(content)
        refuses(r"posterior\.nc must be a posterior written by ldbb-bayes", lb.load, tmp_path)
    refuses("result must be a folder", lb.load, tmp_path / "nothing")


@pytest.mark.slow
def test_results_of_another_edition_are_refused(tmp_path: Path, posterior: xr.DataTree) -> None:
    older = posterior.copy()
    text = older["provenance"].attrs["json"]
    older["provenance"] = xr.DataTree(
        xr.Dataset(attrs={"json": text.replace('"concerns"', '"warnings"')})
    )
    words = (
        r"must be of this edition of ldbb-bayes, got a fit of another \(its concerns\). Fit again"
    )
    refuses(words, lb.load, lb.save(older, tmp_path / "posterior.nc"))


def of_edition(posterior: xr.DataTree, preset: str, edition: int | None) -> xr.DataTree:
    """Return a posterior whose record states a preset and the edition of the default model."""
    changed = posterior.copy()
    record = json.loads(changed["provenance"].attrs["json"])
    record["model"]["preset"] = preset
    del record["model_edition"]
    if edition is not None:
        record["model_edition"] = edition
    changed["provenance"] = xr.DataTree(xr.Dataset(attrs={"json": json.dumps(record)}))
    return changed


def test_a_saved_posterior_is_replaced_only_on_request(
    tmp_path: Path, posterior: xr.DataTree
) -> None:
    """The rule of --force: what took a computation is not lost without a word."""
    file = lb.save(posterior, tmp_path / "posterior.nc")
    written = file.read_bytes()
    refuses(r"posterior.nc must not exist, got an existing one", lb.save, posterior, file)
    assert file.read_bytes() == written
    assert lb.save(posterior, file, force=True) == file


@pytest.mark.parametrize(("edition", "stated_edition"), [(None, "an earlier one"), (2, "2")])
def test_fits_of_an_earlier_edition_of_the_default_model_are_refused(
    tmp_path: Path, posterior: xr.DataTree, edition: int | None, stated_edition: str
) -> None:
    """Version 0.2.0 stated no edition; the columns of its joints are not those of today."""
    file = lb.save(of_edition(posterior, "default", edition), tmp_path / "posterior.nc")
    words = rf"must be a fit of edition 3 of the default model, got {stated_edition}\. Fit again"
    refuses(words, lb.load, file)


def test_fits_of_a_preset_that_does_not_change_are_read(
    tmp_path: Path, posterior: xr.DataTree
) -> None:
    file = lb.save(of_edition(posterior, "first", None), tmp_path / "posterior.nc")
    assert lb.load(file)["posterior"].equals(posterior["posterior"])


def test_paper_preset_is_least_squares_with_intervals(recovered: lb.Campaign) -> None:
    tree = lb.sample(lb.HybridModel.paper(0), recovered, seed=1, rule=QUICK)
    table = lb.summarize(tree)
    bound = lb.HybridModel.paper(0).bind(recovered)
    columns = []
    for test, interest in zip(bound.reduced, bound.interest_columns, strict=True):
        columns.append(test.factor @ interest)
    design = np.concatenate(columns) * bound.scale
    relative_sd = np.sqrt(np.diag(np.linalg.inv(design.T @ design)))
    expected_sd = float(table.loc["sigma", "mean"]) * relative_sd * bound.scale
    means = table["mean"].to_numpy(float)[:13]
    sds = table["sd"].to_numpy(float)[:13]
    np.testing.assert_allclose((means - bound.least_squares_estimate) / expected_sd, 0.0, atol=0.25)
    np.testing.assert_allclose(sds / expected_sd, 1.0, atol=0.12)
    entry = result_json(tree)["parameters"]["C_XXX"]
    assert (entry["prior_sd"], entry["prior_mean"]) == (None, None)
    assert list(tree["prior"].data_vars) == ["sigma"]


@pytest.mark.slow
def test_emcee_takes_over_where_weights_cannot_be_trusted(
    campaign: lb.Campaign, monkeypatch: pytest.MonkeyPatch
) -> None:
    joint = lb.sample(CONSTANT, campaign, rule=QUICK)
    monkeypatch.setattr("ldbb_bayes.inference.integrals.LARGEST_PARETO_K", -10.0)
    tree = lb.sample(CONSTANT, campaign, sampler="independent", rule=QUICK)
    assert "Sampler joint, as weights of independent draws could not be trusted: " in sampler_words(
        result_json(tree)["sampler"]
    )
    np.testing.assert_array_equal(tree["posterior"]["C_CCY"], joint["posterior"]["C_CCY"])
    validation = lb.calibrate(CONSTANT, FEW, replicates=10, draws=9)
    assert validation.replicates == 10
    assert validation.failures == ()
    assert "emcee for 10 whose" in validation_verdict(validation)


@pytest.mark.slow
def test_independent_draws_are_twice_as_many_where_chance_leaves_the_rule_unmet(
    campaign: lb.Campaign,
) -> None:
    """Of 400 independent draws R-hat is above 1.01 for every fifth seed or so, and for 0."""
    rule = StoppingRule(ess=400.0)
    fits = []
    for seed in (0, 1):
        fits.append(lb.sample(CONSTANT, campaign, sampler="independent", seed=seed, rule=rule))
    assert all(record_of(fit)["sampler"]["converged"] for fit in fits)
    assert {fit["posterior"].sizes["draw"] for fit in fits} == {180, 360}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("sampler", "rule", "words"),
    [
        (
            "joint",
            StoppingRule(ess=1e6, max_steps=60),
            r"ESS ≥ 1·10⁶ and R-hat ≤ 1.01 was not reached in 60 steps.*--max-steps",
        ),
        (
            "independent",
            StoppingRule(ess=10.0, rhat=1.0, max_steps=100),
            "ask for more independent draws",
        ),
    ],
)
def test_a_run_that_misses_its_target_says_so(sampler: str, rule: StoppingRule, words: str) -> None:
    tree = lb.sample(CONSTANT, FEW, sampler=sampler, seed=1, rule=rule)
    assert fit_of(tree).state == State.UNUSABLE
    assert re.search(words, describe_fit(tree)["warnings"][0])


def test_a_contradiction_is_warned_of(recovered: lb.Campaign) -> None:
    model = CONSTANT.without("ball-form")
    tree = lb.sample(model, recovered, sampler="independent", seed=1, rule=QUICK)
    assert fit_of(tree).log_prob_truncation < -10.0
    assert "truncation" in fit_of(tree).kinds
    assert describe_fit(tree)["warnings"][0].startswith(
        "The readings contradict non-negative compliance: ln P(T | y) = −"
    )


def test_a_misfit_is_warned_of() -> None:
    tests = []
    for phase, test in enumerate(FEW.tests):
        wave_um = 30.0 * np.sin(7 * test.angles_rad() + phase)
        tests.append(test.with_reading_um(test.reading_um + wave_um))
    campaign = lb.Campaign(tuple(tests))
    tree = lb.sample(CONSTANT, campaign, sampler="independent", seed=1, rule=QUICK)
    warnings = describe_fit(tree)["warnings"]
    assert any(warning.startswith("Misfit: sigma = 1") for warning in warnings)


def test_truncation_probability_is_reported_though_not_imposed() -> None:
    """Readings that shrink under tension: negative compliance, whether or not the model forbids
    it."""
    planned = plan((40,) * 3, forces_N=(100.0, 300.0, 500.0))
    tests = []
    for test in planned.tests:
        force_N = float(test.force_N or 0)
        tests.append(test.with_reading_um(-0.03 * force_N * np.cos(test.angles_rad()) ** 2))
    campaign = lb.Campaign(tuple(tests))
    for model in (CONSTANT.without("truncation"), lb.HybridModel.paper(0)):
        tree = lb.sample(model, campaign, sampler="independent", seed=1, rule=QUICK)
        assert fit_of(tree).log_prob_truncation < -20.0
        assert fit_of(tree).state == State.DOUBTFUL
        assert tree["posterior"]["C_XXX"].mean() < 0.0


@pytest.mark.slow
def test_noise_at_the_floor_is_sampled_without_strays() -> None:
    hyper = {"sigma": 0.03, "delta": 0.5, "kappa": 0.5, "tau": 3.0}
    campaign = CONSTANT.simulate(plan((720,) * 4), seed=1, hyper_um=hyper).campaign
    states: list[Progress] = []
    tree = lb.sample(CONSTANT, campaign, seed=1, rule=QUICK, progress=states.append)
    sigma = tree["posterior"]["sigma"].to_numpy().ravel() * 1e3
    assert record_of(tree)["sampler"]["converged"]
    assert sigma.min() >= 0.24 / np.sqrt(12.0)
    assert np.quantile(sigma, 0.999) < 0.24 / np.sqrt(12.0) + 0.01
    for number, state in enumerate(states, start=1):
        assert state.steps == 20 * number
        assert state.seconds_left is not None
        assert state.seconds_left >= 0.0
    assert isinstance(states[-1].assessment, Assessment)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"sampler": "nuts"}, "sampler must be one of joint, independent, got 'nuts'"),
        ({"ensembles": 2}, "ensembles must be at least 4, got 2"),
        ({"walkers": 10}, "walkers must be even and at least"),
        ({"campaign": FEW.plan()}, "must have readings to be sampled, got a plan"),
    ],
)
def test_samples_that_cannot_be_are_refused(arguments: dict[str, Any], message: str) -> None:
    refuses(message, lb.sample, CONSTANT, **{"campaign": FEW} | arguments)


@pytest.mark.parametrize("model", [CONSTANT, lb.HybridModel.paper(0)])
def test_three_routes_to_one_posterior(model: lb.HybridModel) -> None:
    """Joint and independent draws against a third route that needs no lattice and no chain."""
    bound = model.bind(FEW)
    hyper_posterior = HyperPosterior(bound, truncated=bound.truncation.active)
    expected = np.hstack(collapsed(hyper_posterior, 3000))
    mean = expected.mean(axis=0)
    sd = expected.std(axis=0)
    for sampler in ("joint", "independent"):
        tree = lb.sample(model, FEW, sampler=sampler, seed=1, rule=QUICK)
        draws = np.hstack(draws_of(tree, bound))
        np.testing.assert_allclose((draws.mean(axis=0) - mean) / sd, 0.0, atol=0.25)
        np.testing.assert_allclose(draws.std(axis=0) / sd, 1.0, atol=0.25)


PRIORS = {
    "C_XXX": (4.4e-5, 4e-6),
    "C_YYY": (5.0e-5, 3e-6),
    "C_CCY": (-2e-10, 4e-10),
    "E_YY1": (-5e-5, 4e-5),
}


@pytest.mark.parametrize("sampler", [pytest.param("joint", marks=pytest.mark.slow), "independent"])
def test_readings_less_what_prior_means_expect(sampler: str) -> None:
    """The posterior with means m of y is that without of y − J m, moved by m: draw by draw."""
    model = MODEL.without("force-error", "truncation").with_prior(PRIORS)
    plain = replace(model, prior=replace(model.prior, means=dict.fromkeys(PRIORS, 0.0)))
    bound = model.bind(FEW)
    tests = []
    for test, interest in zip(FEW.tests, bound.interest_columns, strict=True):
        expected_um = basis(test.angles_rad()) @ interest @ bound.prior_mean * 1e3
        tests.append(test.with_reading_um(np.asarray(test.reading_um) - expected_um))
    less_expected = replace(FEW, tests=tuple(tests))
    short = StoppingRule(ess=100.0, max_steps=200)
    tree = lb.sample(model, FEW, sampler=sampler, seed=3, rule=short)
    with_means = tree["posterior"]
    without_means = lb.sample(plain, less_expected, sampler=sampler, seed=3, rule=short)[
        "posterior"
    ]
    for parameter in bound.parameters:
        name = parameter.name
        moved_by = with_means[name].to_numpy() - without_means[name].to_numpy()
        difference = np.abs(moved_by - parameter.prior_mean)
        assert np.quantile(difference / parameter.prior_sd, 0.99) < 1e-5, name
    for name in bound.hyper_prior.names:
        median = np.quantile(with_means[name], 0.5)
        np.testing.assert_allclose(median, np.quantile(without_means[name], 0.5), rtol=1e-5)
    assert lb.summarize(tree).loc["C_XXX", "prior_mean"] == 4.4e-5
    assert result_json(tree)["model"]["priors"] == "edited"
    assert tree["prior"]["C_YYY"].to_numpy().mean() == pytest.approx(5.0e-5, abs=3e-7)


def test_independent_chains_have_at_most_the_largest_number_of_steps() -> None:
    start = HyperPosterior(CONSTANT.bind(FEW), truncated=False)
    rule = StoppingRule(ess=1e5, max_steps=60)
    run = run_sampler("independent", start, rule=rule, seed=np.random.SeedSequence(1)).run
    assert (run.steps, run.chain.shape[:2], run.converged) == (60, (4, 60), False)


def test_acceptance_of_independent_draws_is_that_of_all_blocks(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    blocks = []

    def recorded(*arguments: Any) -> JointDraws:
        blocks.append(draw_jointly(*arguments))
        return blocks[-1]

    monkeypatch.setattr("ldbb_bayes.inference.sample.draw_jointly", recorded)
    start = HyperPosterior(CONSTANT.bind(FEW), truncated=False)
    rule = StoppingRule(ess=100.0, rhat=0.5, max_steps=400)
    run = run_sampler("independent", start, rule=rule, seed=np.random.SeedSequence(1)).run
    assert len(blocks) == 3
    accepted = sum(block.accepted for block in blocks)
    assert run.acceptance == accepted / sum(block.proposed for block in blocks)


@pytest.mark.parametrize(
    ("reached", "further"),
    [(0.9, 89), (0.3, 400), (1.2, 400), (np.nan, 400), (0.0, 400)],
)
def test_independent_draws_are_added_until_the_effective_size_suffices(
    reached: float, further: int
) -> None:
    """With nine tenths of the size 400 · (1.1 / 0.9 − 1) more; never more than there are."""
    assert _further_steps(400, reached) == further


def test_equal_draws_are_counted() -> None:
    """n² / Σ c²: of 1, 2 and 3 equal draws 36 / 14."""
    free = np.repeat(np.arange(6.0).reshape(3, 2), [1, 2, 3], axis=0)
    assert _effective_number(free) == pytest.approx(36.0 / 14.0)


@pytest.fixture(scope="module")
def rough() -> HyperPosterior:
    """A posterior to which the first proposal is fitted badly: the machine's pattern may be nothing
    at all, and hardly any point lies where it is."""
    tests = []
    circles = plan([36] * 5, forces_N=(36.0, 250.0, 450.0, 600.0, 742.0))
    for k, test in enumerate(circles.tests):
        direction: Direction = "CW" if k % 2 else "CCW"
        tests.append(replace(test, direction=direction, work_ball_deg=35.0 * k, name=f"t{k}"))
    instrument = lb.Instrument(
        work=lb.Ball(sphericity_um=0.25),
        bar_length_error_um=3.0,
        bar_U_um=2.0,
        mount_U_percent=5.0,
    )
    model = lb.HybridModel.default(1)
    planned = replace(circles, tests=tuple(tests), instrument=instrument)
    hyper = {"sigma": 0.4, "delta": 0.8, "kappa": 0.5, "tau": 1.2}
    campaign = model.simulate(planned, seed=5, parameters=TRUTH, hyper_um=hyper).campaign
    return HyperPosterior(model.bind(campaign), truncated=True, seed=0)


def test_few_draws_are_returned_twice_and_no_parameters_are(rough: HyperPosterior) -> None:
    """The proposal is fitted anew where one value of the scales stood for many. Parameters are
    drawn anew each time, and their density is the stated one."""
    size = 3000
    draws = draw_jointly(rough, size, np.random.default_rng(1))
    _, place, counts = np.unique(draws.free, axis=0, return_inverse=True, return_counts=True)
    assert size**2 / np.sum(counts**2) >= 0.5 * size
    assert len(np.unique(draws.beta[:, 0])) == size
    density = JointDensity(rough.bound)
    places = np.flatnonzero(counts[place.ravel()] > 2)[:40]
    assert len(places) == 40
    points = density.join(draws.beta[places], draws.free[places])
    np.testing.assert_allclose(density(points), draws.log_posterior[places], atol=1e-8)


def test_values_that_stand_for_many_draws_lower_the_effective_size(rough: HyperPosterior) -> None:
    """Equal values of the scales follow one another, so that ArviZ counts them once."""
    draws = draw_jointly(rough, 3000, np.random.default_rng(1))
    _, counts = np.unique(draws.free[:, 0], return_counts=True)
    kish = 3000**2 / np.sum(counts**2)
    assert kish < 0.8 * 3000
    column = draws.free[:, 0].reshape(4, -1)
    ess = arviz_stats.base.array_stats.ess(column, chain_axis=0, draw_axis=1, method="bulk")
    assert ess == pytest.approx(kish, rel=0.25)


def test_proposed_points_have_their_log_density(rough: HyperPosterior) -> None:
    sample = rough.without_truncation.weighted_sample
    points, log_density = sample.draw_with_log_density(500, np.random.default_rng(3))
    np.testing.assert_array_equal(points, sample.draw(500, np.random.default_rng(3)))
    np.testing.assert_allclose(log_density, sample.log_proposal(points), atol=1e-8)


def test_the_envelope_is_low_where_the_proposal_fits_well() -> None:
    """Of a posterior in four dimensions more than 60 % of the proposals are accepted, and hardly
    any value comes twice."""
    unrestricted = MODEL.without("truncation")
    start = HyperPosterior(unrestricted.bind(simulated(plan())), truncated=False)
    draws = draw_jointly(start, 4000, np.random.default_rng(1))
    assert draws.accepted / draws.proposed > 0.6
    assert len(np.unique(draws.free[:, 0])) > 0.97 * 4000


def test_emcee_takes_over_where_no_proposal_suffices(
    rough: HyperPosterior, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A value of the scales that stands for many draws is an error, not a result."""
    monkeypatch.setattr("ldbb_bayes.inference.independent_sampler._MOST_REFITS", 0)
    with pytest.raises(TooRoughError, match="effective number"):
        draw_jointly(rough, 3000, np.random.default_rng(1))


def test_a_campaign_of_a_plan_with_a_pilot_is_saved(tmp_path: Path) -> None:
    """The pilot matters only before the tests are run, and is not written."""
    pilot = simulated(plan())
    campaign = replace(simulated(plan()), pilot=pilot)
    posterior = lb.sample(lb.HybridModel.first(0), campaign, sampler="independent", seed=1)
    read = campaign_of(lb.load(lb.save(posterior, tmp_path / "posterior.nc")))
    assert read.sha256 == campaign.sha256
