"""average(): its moments against those of every model by itself and in closed form; all that reads
a posterior reads it."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
from campaigns import plan, refuses, simulated
from oracle import compliance_columns, geometric_columns
from scipy import stats

import ldbb_bayes as lb
from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.evidence import probabilities
from ldbb_bayes.inference.posterior import curves_of, fit_of, model_draws_of, record_of
from ldbb_bayes.inference.summary import result_json

DRAWS = 8000
CAMPAIGN = simulated(plan((30,) * 4), seed=1)
LINEAR = lb.HybridModel.default(1).without("ball-form", "setup-shift", "mount", "angle", "position")
PAIR = {"constant": LINEAR.with_degree(0), "linear": LINEAR}


@pytest.fixture(scope="module")
def averaged():  # type: ignore[no-untyped-def]
    return lb.average(PAIR, CAMPAIGN, draws=DRAWS, evidences=lb.Evidences(CAMPAIGN))


def test_moments_are_those_of_every_model_by_its_probability(averaged) -> None:  # type: ignore[no-untyped-def]
    kinds = list(
        itertools.product(
            PAIR.values(), ((), ("joint load",), ("curved force law",), LINEAR.rivals)
        )
    )
    assert LINEAR.rivals == ("joint load", "curved force law")
    fits = [
        lb.sample(model.with_rivals(*own), CAMPAIGN, sampler="independent", seed=3)["posterior"]
        for model, own in kinds
    ]
    value = [
        lb.log_evidence(model.with_rivals(*rivals), CAMPAIGN, tolerance=1e-2).log_value
        for model, rivals in kinds
    ]
    share = probabilities(np.array(value))
    assert (share > 0.03).sum() > 4, "a test in which most models count"
    group = averaged["posterior"]
    for name in map(str, group.data_vars):
        draws = [fit[name].values.ravel() if name in fit else np.zeros(2) for fit in fits]
        mean = share @ [own.mean() for own in draws]
        variance = share @ [own.var() + (own.mean() - mean) ** 2 for own in draws]
        own = group[name].values
        assert own.mean() == pytest.approx(mean, abs=0.06 * np.sqrt(variance)), name
        assert own.std() == pytest.approx(
            np.sqrt(variance), rel=0.25 if name.startswith("lambda") else 0.06
        ), name  # long tails
    found = record_of(averaged)["averaged"]
    assert found["probability"]["linear"] == pytest.approx(share[4:].sum(), abs=0.01)
    zero = (group["C_XXX_1"].values == 0.0).mean()
    assert zero == pytest.approx(1.0 - found["probability"]["linear"], abs=2.0 / DRAWS)


def test_in_closed_form() -> None:
    """Neither nuisances nor truncation: given σ everything is one Gaussian, dense, and σ a sum over
    a grid."""
    plain = lb.HybridModel(1, (), lb.HybridModel.default().without("truncation").prior)
    campaign = simulated(plan((30, 30, 30), forces_N=(36.0, 400.0, 742.0)), seed=2)
    posterior = lb.average(
        {"constant": plain.with_degree(0), "linear": plain}, campaign, draws=DRAWS
    )
    bound = plain.bind(campaign)
    radius = np.full(30, 150.0)
    blocks = []
    for test in campaign.tests:
        elastic = test.force_N * compliance_columns(test.angles_rad(), radius)
        lever = test.force_N - bound.setting.reference_force_N
        blocks.append(
            np.hstack([elastic, lever * elastic, geometric_columns(test.angles_rad(), radius)])
        )
    whole = np.vstack(blocks)
    y = np.concatenate([test.readings_mm() for test in campaign.tests])
    grid = np.linspace(1e-4, 0.02, 400)
    prior = np.exp(bound.hyper_prior.log_density(grid[:, None]))
    weights = []
    means = []
    squares = []
    for kept in (
        np.array(["_1" not in name for name in bound.names]),
        np.ones(len(bound.names), dtype=bool),
    ):
        design = whole * kept * bound.prior_sd
        sd = bound.prior_sd * kept
        for sigma, own in zip(grid, prior, strict=True):
            covariance = design @ design.T + sigma**2 * np.eye(len(y))
            gain = np.linalg.solve(covariance, design).T
            weights.append(np.log(own) + stats.multivariate_normal(cov=covariance).logpdf(y))
            means.append(sd * (gain @ y))
            squares.append(sd**2 * (1.0 - np.einsum("pn,np->p", gain, design)) + means[-1] ** 2)
    weight = probabilities(np.array(weights))
    probability = weight[len(grid) :].sum()
    assert record_of(posterior)["averaged"]["probability"]["linear"] == pytest.approx(
        probability, abs=0.005
    )
    mean = weight @ means
    sd = np.sqrt(weight @ squares - mean**2)
    table = lb.summarize(posterior).loc[list(bound.names)]
    counted = np.array([(posterior["posterior"][name].values != 0.0).sum() for name in bound.names])
    assert (np.abs(table["mean"] - mean) / sd < 4.0 / np.sqrt(DRAWS)).all()
    assert (np.abs(table["sd"] / sd - 1.0) < 3.0 / np.sqrt(counted)).all()


def test_all_that_reads_a_posterior_reads_an_average(averaged, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    lb.save(averaged, tmp_path / "posterior.nc")
    again = lb.load(tmp_path / "posterior.nc")
    found = result_json(again)
    assert found["averaged"]["probability"].keys() == {"constant", "linear", *LINEAR.rivals}
    assert fit_of(again).state == "usable"
    assert found["sampler"]["converged"]
    assert found["sampler"]["ess_bulk_min"] > 0.8 * DRAWS
    table = lb.summarize(again)
    assert 0.0 < table.loc["C_XXX_1", "sd"] < table.loc["C_XXX_1", "prior_sd"]
    assert table.loc["C_XXX_1", "prior_sd"] == pytest.approx(
        LINEAR.bind(CAMPAIGN).prior_sd[6] / np.sqrt(2.0)
    )
    assert lb.verdicts(again).keys() == lb.budgets(again).keys() == set(found["parameters"])
    assert np.isfinite(lb.circularity(again)["sd"]).all()
    # What the joint load adds to C(F) is of the models that have it alone: without it and without
    # slopes C(F) is constant.
    parts = model_draws_of(again)
    curves = curves_of(again, np.array([36.0, 742.0]))
    changes = np.abs(np.diff(curves[:, :, 0], axis=1)[:, 0]) > 0.0
    without = np.concatenate(
        [(part.beta[:, 6] == 0.0) & ("joint load" not in part.bound.model.rivals) for part in parts]
    )
    np.testing.assert_array_equal(changes, ~without)
    table = lb.nuisances(again)
    sizes = {
        name: float(table.loc[f"{name}_X_slope" if "joint" in name else name, "sd"])
        for name in ("joint_load", "force_curvature")
    }
    assert all(size > 0.0 for size in sizes.values())


def test_refusals() -> None:
    with pytest.raises(InputError, match=r"models must be nested, .*linear.with_degree\(0\)"):
        lb.average(
            {
                "constant": LINEAR.with_degree(0).without("joint-load", "discrepancy"),
                "linear": LINEAR,
            },
            CAMPAIGN,
        )
    refuses(r"draws must be at least 400, got 10\.", lb.average, PAIR, CAMPAIGN, draws=10)
    with pytest.raises(
        InputError,
        match=r"models must be HybridModels by name, .*got DataTree\. Call lb\.average\({",
    ):
        lb.average(lb.sample(LINEAR, CAMPAIGN, sampler="independent"), CAMPAIGN)  # type: ignore[arg-type]
    with pytest.raises(
        InputError, match=r"evidences must be of the campaign .*Evidences\(campaign\)"
    ):
        lb.average(PAIR, CAMPAIGN, evidences=lb.Evidences(simulated(plan((30,) * 4), seed=2)))
