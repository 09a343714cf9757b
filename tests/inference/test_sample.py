"""The joint sampler end to end: layout, stopping, reproducibility, and the agreement of what is stored."""

from __future__ import annotations

from pathlib import Path

import arviz_stats
import numpy as np
import pytest
import xarray as xr
from campaigns import plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.ensemble import Progress, run_ensembles
from ldbb_bayes.inference.origin import bound_of, campaign_of, record_of
from ldbb_bayes.inference.posterior import assess
from ldbb_bayes.inference.stopping import Assessment, StoppingRule
from ldbb_bayes.inference.summary import result_json

QUICK = StoppingRule(ess=300.0, rhat=1.05, lengths=1.0)


@pytest.fixture(scope="module")
def campaign() -> lb.Campaign:
    return simulated(plan(compensated=False))


@pytest.fixture(scope="module")
def posterior(campaign: lb.Campaign) -> xr.DataTree:
    return lb.sample(lb.HybridModel.default(1), campaign, seed=3, rule=QUICK)


def test_layout(posterior: xr.DataTree, campaign: lb.Campaign) -> None:
    assert set(posterior.children) == {
        "posterior",
        "prior",
        "sample_stats",
        "log_prior",
        "log_likelihood",
        "observed_data",
        "constant_data",
        "provenance",
    }
    bound = lb.HybridModel.default(1).bind(campaign)
    assert list(posterior["posterior"].data_vars) == [*bound.names, "sigma", "delta", "kappa", "tau"]
    assert posterior["posterior"]["C_XXX"].dims == ("chain", "draw")
    assert posterior["posterior"].sizes["chain"] == 4
    assert posterior["posterior"]["C_CCY"].attrs["unit"] == "rad/(N mm)"
    assert posterior["log_likelihood"]["per_test"].dims == ("chain", "draw", "test")
    assert list(posterior["log_likelihood"].coords["test"].to_numpy()) == [t.name for t in campaign.tests]
    np.testing.assert_allclose(
        posterior["observed_data"]["reading_mm"].to_numpy(), np.concatenate([t.readings_mm() for t in campaign.tests])
    )


def test_stored_densities_are_consistent(posterior: xr.DataTree, campaign: lb.Campaign) -> None:
    """lp = ln likelihood + ln prior(β) + ln prior(φ) + Jacobian of the free coordinates, up to nothing at all."""
    bound = lb.HybridModel.default(1).bind(campaign)
    pick = {"chain": 2, "draw": 17}
    draws = posterior["posterior"].isel(pick)
    beta = np.array([[float(draws[name]) for name in bound.names]])
    phi = np.array([[float(draws[name]) for name in bound.hyper_prior.names]])
    log_prior = posterior["log_prior"].isel(pick)
    expected = (
        bound.log_likelihood(phi, beta)[0]
        + float(log_prior["parameters"])
        + float(log_prior["hyper"])
        + bound.hyper_prior.free(phi).sum()
    )
    assert float(posterior["sample_stats"]["lp"].isel(pick)) == pytest.approx(expected, abs=1e-6)
    per_test = posterior["log_likelihood"]["per_test"].isel(pick).to_numpy()
    np.testing.assert_allclose(per_test, bound.log_likelihood_per_test(phi, beta)[0], atol=1e-7)


def test_draws_and_prior_are_inside_the_truncation(posterior: xr.DataTree, campaign: lb.Campaign) -> None:
    bound = lb.HybridModel.default(1).bind(campaign)
    for group in ("posterior", "prior"):
        beta = np.stack([posterior[group][name].to_numpy() for name in bound.names], axis=-1)
        assert bound.truncation.holds(beta).all()
    assert posterior["posterior"]["sigma"].min() >= 0.24e-3 / np.sqrt(12.0)
    assert posterior["prior"]["C_XYX"].to_numpy().std() == pytest.approx(1e-5, rel=0.05)


def test_saved_and_read_back_identically(posterior: xr.DataTree, tmp_path: Path) -> None:
    lb.save(posterior, tmp_path / "posterior.nc")
    assert lb.load(tmp_path / "posterior.nc").identical(posterior)
    assert lb.load(tmp_path).identical(posterior)
    assert [p.name for p in tmp_path.iterdir()] == ["posterior.nc"]


def test_campaign_and_model_come_back_from_the_posterior(posterior: xr.DataTree, campaign: lb.Campaign) -> None:
    back = campaign_of(posterior)
    assert back.sha256 == campaign.sha256 == record_of(posterior)["campaign"]["sha256"]
    assert (back.mount, back.force_law, back.name) == (campaign.mount, campaign.force_law, campaign.name)
    bound, original = bound_of(posterior), lb.HybridModel.default(1).bind(campaign)
    assert bound.model == original.model
    np.testing.assert_array_equal(bound.interest, original.interest)


def test_same_seed_same_draws(campaign: lb.Campaign, posterior: xr.DataTree) -> None:
    again = lb.sample(lb.HybridModel.default(1), campaign, seed=3, rule=QUICK)
    assert again["posterior"].dataset.drop_attrs().equals(posterior["posterior"].dataset.drop_attrs())
    other = lb.sample(lb.HybridModel.default(1), campaign, seed=4, rule=QUICK)
    assert not np.array_equal(other["posterior"]["C_XXX"][:, :5], posterior["posterior"]["C_XXX"][:, :5])


def test_diagnostics_are_arvizs(posterior: xr.DataTree) -> None:
    table = lb.summarize(posterior)
    reference = arviz_stats.summary(posterior, ci_prob=0.95, ci_kind="eti", round_to="none")
    np.testing.assert_allclose(table["mean"].astype(float), reference["mean"].astype(float), rtol=1e-10)
    np.testing.assert_allclose(table["sd"].astype(float), reference["sd"].astype(float), rtol=1e-3)
    np.testing.assert_allclose(table["ess_bulk"].astype(float), reference["ess_bulk"].astype(float), rtol=1e-6)
    record = record_of(posterior)["sampler"]
    assert record["converged"]
    assert record["ess_bulk_min"] == pytest.approx(table["ess_bulk"].min())
    # The two middle draws are equally far from the median but for rounding, which orders them one way or the other.
    assert record["rhat_max"] == pytest.approx(table["rhat"].max(), abs=1e-5)
    assert table["ess_bulk"].min() >= 300.0
    assert table["ess_tail"].min() >= 300.0


def test_summary_numbers(posterior: xr.DataTree) -> None:
    table = lb.summarize(posterior, ci_prob=0.9)
    draws = posterior["posterior"]["C_XXX"].to_numpy().ravel()
    row = table.loc["C_XXX"]
    np.testing.assert_allclose([row["ci_low"], row["ci_high"]], np.quantile(draws, [0.05, 0.95]))
    assert row["prior_sd"] == 1e-4
    assert row["unit"] == "mm/N"
    with pytest.raises(InputError, match="ci_prob must lie between 0 and 1, got 95"):
        lb.summarize(posterior, ci_prob=95)


def test_json_names(posterior: xr.DataTree) -> None:
    result = result_json(posterior)
    assert list(result) == ["schema", "campaign", "model", "parameters", "hyper", "sampler", "fit", "provenance"]
    assert {"name", "sha256", "tests", "readings", "forces_N"} <= set(result["campaign"])
    assert {"preset", "degree", "reference_force_N", "terms", "sha256"} <= set(result["model"])
    assert set(result["parameters"]["C_XXX"]) == {"unit", "mean", "sd", "median", "ci95", "prior_mean", "prior_sd"}
    assert list(result["hyper"]) == ["sigma_um", "delta_um", "kappa_um", "tau_um"]
    assert {"kind", "ess_bulk_min", "ess_tail_min", "rhat_max", "converged", "draws", "seconds"} <= set(result["sampler"])
    assert {"rmse_um", "fitness_percent", "log_prob_truncation", "warnings"} <= set(result["fit"])
    assert {"versions", "seed", "started", "platform"} <= set(result["provenance"])
    assert result["hyper"]["tau_um"]["prior_sd"] == pytest.approx(5.0 * np.sqrt(1 - 2 / np.pi), rel=1e-3)


def test_paper_preset_is_least_squares_with_intervals(recovered: lb.Campaign) -> None:
    tree = lb.sample(lb.HybridModel.paper(0), recovered, seed=1, rule=QUICK)
    table = lb.summarize(tree)
    bound = lb.HybridModel.paper(0).bind(recovered)
    sigma = float(table.loc["sigma", "mean"])
    design = np.concatenate([t.factor @ bound.interest[r] for r, t in enumerate(bound.reduced)]) * bound.scale
    expected_sd = sigma * np.sqrt(np.diag(np.linalg.inv(design.T @ design))) * bound.scale
    means, sds = table["mean"].to_numpy(float)[:13], table["sd"].to_numpy(float)[:13]
    np.testing.assert_allclose((means - bound.centre) / expected_sd, 0.0, atol=0.25)
    np.testing.assert_allclose(sds / expected_sd, 1.0, atol=0.12)
    assert result_json(tree)["parameters"]["C_XXX"]["prior_sd"] is None
    assert list(tree["prior"].data_vars) == ["sigma"]
    assert f"{result_json(tree)['fit']['rmse_um']:.1f}" == "1.1"


def test_a_run_that_misses_its_target_says_so(campaign: lb.Campaign) -> None:
    rule = StoppingRule(ess=1e6, max_steps=60)
    result = result_json(lb.sample(lb.HybridModel.default(0), campaign, seed=1, rule=rule))
    assert not result["sampler"]["converged"]
    told = result["fit"]["warnings"][0]
    assert told.startswith("Not converged: ESS ≥ 1e+06 and R-hat ≤ 1.01 was not reached in 60 steps")
    assert "allow more steps" in told
    few = StoppingRule(ess=10.0, rhat=1.0)
    result = result_json(lb.sample(lb.HybridModel.default(0), campaign, sampler="quadrature", seed=1, rule=few))
    assert not result["sampler"]["converged"]
    assert "ask for more independent draws" in result["fit"]["warnings"][0]


def test_contradiction_and_misfit_are_warned_of(recovered: lb.Campaign) -> None:
    result = result_json(lb.sample(lb.HybridModel.default(0).without("ball-form"), recovered, seed=1, rule=QUICK))
    assert result["fit"]["log_prob_truncation"] < -10.0
    assert any("contradict non-negative compliance" in warning for warning in result["fit"]["warnings"])
    loud = simulated(plan())
    loud = lb.Campaign(
        tuple(t.with_reading_um(t.reading_um + 30.0 * np.sin(7 * t.angles_rad() + i)) for i, t in enumerate(loud.tests))
    )
    result = result_json(lb.sample(lb.HybridModel.default(0), loud, seed=1, rule=QUICK))
    assert any(warning.startswith("Misfit: sigma = 13") for warning in result["fit"]["warnings"])


def test_truncation_probability_is_reported_though_not_imposed() -> None:
    """Readings that shrink under tension: negative compliance, whether or not the model forbids it."""
    planned = plan((40,) * 3, forces_N=(100.0, 300.0, 500.0))
    tests = [t.with_reading_um(-0.03 * float(t.force_N or 0) * np.cos(t.angles_rad()) ** 2) for t in planned.tests]
    for model in (lb.HybridModel.default(0).without("truncation"), lb.HybridModel.paper(0)):
        result = result_json(lb.sample(model, lb.Campaign(tuple(tests)), seed=1, rule=QUICK))
        assert result["fit"]["log_prob_truncation"] < -20.0
        assert any("contradict non-negative compliance" in warning for warning in result["fit"]["warnings"])
        assert result["parameters"]["C_XXX"]["mean"] < 0.0


def test_noise_at_the_floor_is_sampled_without_strays() -> None:
    hyper = {"sigma": 0.03, "delta": 0.5, "kappa": 0.5, "tau": 3.0}
    campaign = lb.HybridModel.default(0).simulate(plan((720,) * 4), seed=1, hyper_um=hyper).campaign
    tree = lb.sample(lb.HybridModel.default(0), campaign, seed=1, rule=QUICK)
    sigma = tree["posterior"]["sigma"].to_numpy().ravel() * 1e3
    assert record_of(tree)["sampler"]["converged"]
    assert sigma.min() >= 0.24 / np.sqrt(12.0)
    assert np.quantile(sigma, 0.999) < 0.24 / np.sqrt(12.0) + 0.01


def test_progress_is_reported(campaign: lb.Campaign) -> None:
    seen: list[Progress] = []
    lb.sample(lb.HybridModel.default(0), campaign, seed=1, rule=QUICK, progress=seen.append)
    assert [state.steps for state in seen] == [20 * (i + 1) for i in range(len(seen))]
    assert all(state.seconds_left is not None and state.seconds_left >= 0.0 for state in seen)
    assert isinstance(seen[-1].assessment, Assessment)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"sampler": "nuts"}, "sampler must be one of joint, collapsed, quadrature"),
        ({"ensembles": 2}, "ensembles must be at least 4, got 2"),
        ({"walkers": 10}, "walkers must be even and at least"),
    ],
)
def test_refused(campaign: lb.Campaign, arguments: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        lb.sample(lb.HybridModel.default(0), campaign, **arguments)


def test_a_plan_cannot_be_sampled() -> None:
    with pytest.raises(InputError, match="must have readings to be sampled, got a plan"):
        lb.sample(lb.HybridModel.default(0), plan())


@pytest.mark.parametrize("content", [b"", b"not a file of ours", None])
def test_damaged_results_are_refused(tmp_path: Path, posterior: xr.DataTree, content: bytes | None) -> None:
    file = lb.save(posterior, tmp_path / "posterior.nc")
    file.write_bytes(file.read_bytes()[:50_000] if content is None else content)
    with pytest.raises(InputError, match=r"posterior\.nc must be a posterior written by ldbb-bayes"):
        lb.load(tmp_path)
    with pytest.raises(InputError, match="result must be a folder"):
        lb.load(tmp_path / "nothing")


def test_ensembles_sample_a_correlated_normal_at_the_real_dimension() -> None:
    """23 dimensions: the moves must not bias the spread (a known fault of another move is sd 0.88)."""
    rng = np.random.default_rng(0)
    d = 23
    root = np.tril(rng.normal(size=(d, d)), -1) * 0.3 + np.diag(np.exp(rng.normal(size=d)))
    inverse = np.linalg.inv(root)
    starts = rng.normal(size=(4, 92, d)) @ root.T

    def log_density(x: np.ndarray) -> np.ndarray:
        return -0.5 * ((x @ inverse.T) ** 2).sum(axis=1)

    run = run_ensembles(log_density, starts, assess, rule=StoppingRule(ess=4000.0), seed=np.random.SeedSequence(1))
    white = run.chain.reshape(-1, d) @ inverse.T
    assert run.converged
    np.testing.assert_allclose(white.std(axis=0), 1.0, atol=0.05)
    np.testing.assert_allclose(white.mean(axis=0), 0.0, atol=0.06)


def test_walker_major_order() -> None:
    """Ensembles whose walkers stand still must not look like thousands of independent draws."""
    starts = np.random.default_rng(0).normal(size=(4, 64, 2))
    run = run_ensembles(
        lambda x: np.where(np.isin(x[:, 0], starts[..., 0]), 0.0, -np.inf),
        starts,
        assess,
        rule=StoppingRule(ess=1000.0, max_steps=400),
        seed=np.random.SeedSequence(1),
    )
    assert not run.converged
    assert run.assessment.ess_bulk_min < 500.0
