"""Verdicts and budgets of averages over models: mixtures worked out by hand, and their rules."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest
import xarray as xr
from campaigns import plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.analysis.budgets import Budget
from ldbb_bayes.analysis.origins import Origin
from ldbb_bayes.analysis.posterior_verdicts import confounded_at, confounded_in, judge_quantities
from ldbb_bayes.analysis.variance_sources import MODEL_CHOICE, AveragedVariance, _variances_of
from ldbb_bayes.analysis.verdicts import (
    ParameterIdentifiability,
    SampledSd,
    Verdict,
    judge,
    judge_parameters,
)
from ldbb_bayes.inference.averaged_models import AveragedModel, averaged_models
from ldbb_bayes.inference.posterior import model_draws_of, record_of
from ldbb_bayes.model.bound_information import information_of
from ldbb_bayes.model.terms.columns import NOISE
from ldbb_bayes.report.wording import source_words, verdict_words
from ldbb_bayes.units import is_slope

CAMPAIGN = simulated(plan((30,) * 4), seed=1)
LINEAR = lb.HybridModel.default(1).without("ball-form", "setup-shift", "angle", "drift")
PAIR = {"constant": LINEAR.with_degree(0), "linear": LINEAR}


@pytest.fixture(scope="module")
def averaged() -> xr.DataTree:
    return lb.average(PAIR, CAMPAIGN, draws=2000, evidences=lb.inference.Evidences(CAMPAIGN))


@pytest.fixture(scope="module")
def models(averaged: xr.DataTree) -> list[AveragedModel]:
    return averaged_models(averaged)


@pytest.fixture(scope="module")
def verdicts(averaged: xr.DataTree) -> Mapping[str, ParameterIdentifiability]:
    return lb.analysis.judge_posterior(averaged)


@pytest.fixture(scope="module")
def budgets(averaged: xr.DataTree) -> Mapping[str, Budget]:
    return lb.analysis.budget_uncertainty(averaged)


# By hand: one parameter E and one mount, whose columns are equal


class ModelOfOne(NamedTuple):
    """A model E ~ N(0, 100²), mount ~ N(0, s²), and readings of E + mount whose mean has noise 1.

    The estimate of E is g = 1 − v/100² times the mean reading, with the variance
    v = 1 / (1/100² + 1/(s² + 1)). It errs by g times the mount, g times the noise and (g − 1) E.
    """

    probability: float
    mean: np.ndarray
    mount_sd: float

    @property
    def variance(self) -> float:
        return 1.0 / (1e-4 + 1.0 / (self.mount_sd**2 + 1.0))

    def errors(self) -> dict[tuple[str, Origin], np.ndarray]:
        gain = 1.0 - self.variance / 100.0**2
        return {
            ("Mount", Origin.ASSUMED): np.array([[gain**2 * self.mount_sd**2]]),
            (NOISE, Origin.MEASURED): np.array([[gain**2]]),
            ("E", Origin.ASSUMED): np.array([[(gain - 1.0) ** 2 * 100.0**2]]),
        }

    def variance_without_assumed(self, partners: tuple[str, ...]) -> np.ndarray:
        assert partners == ("Mount",)
        return np.array([1.0 / (1e-4 + 1.0)])


def test_a_mixture_by_hand() -> None:
    """Models with the mount at sd 3 and 0.5, of probability 0.8 and 0.2, at means 0 and 5."""
    models: Any = (
        ModelOfOne(0.8, np.array([0.0]), 3.0),
        ModelOfOne(0.2, np.array([5.0]), 0.5),
    )
    average = AveragedVariance(models, 1)
    spread = 0.8 * 1.0**2 + 0.2 * 4.0**2
    variance = 0.8 * models[0].variance + 0.2 * models[1].variance + spread
    assert average.mean[0] == pytest.approx(1.0)
    assert average.variance[0] == pytest.approx(variance)
    sources = {source.name: source for source in average.sources(0, ("E",)).sources}
    gains = [1.0 - model.variance / 100.0**2 for model in models]
    from_mount = 0.8 * gains[0] ** 2 * 9.0 + 0.2 * gains[1] ** 2 * 0.25
    from_noise = 0.8 * gains[0] ** 2 + 0.2 * gains[1] ** 2
    assert sources["Mount"].share == pytest.approx(from_mount / variance)
    assert sources[NOISE].share == pytest.approx(from_noise / variance)
    assert sources[MODEL_CHOICE].share == pytest.approx(spread / variance)
    assert sources[MODEL_CHOICE].origin == Origin.MEASURED
    assert sum(source.share for source in sources.values()) == pytest.approx(1.0)
    sd = average.sd_without_assumed(("Mount",))[0]
    assert sd == pytest.approx(np.sqrt(1.0 / (1e-4 + 1.0) + spread))


def test_the_verdict_on_a_mixture_by_hand() -> None:
    """The first model alone is confounded, nine tenths mount; the spread of the means undoes it."""
    confounded = ModelOfOne(0.5, np.array([0.0]), 3.0)
    near: Any = (confounded, ModelOfOne(0.5, np.array([0.1]), 3.0))
    sources = AveragedVariance(near, 1).sources(0, ("E",)).sources
    assert judge(sources, 0.99).verdict == "confounded"
    far: Any = (confounded, ModelOfOne(0.5, np.array([10.0]), 3.0))
    sources = AveragedVariance(far, 1).sources(0, ("E",)).sources
    assert sources[0].name == MODEL_CHOICE
    assert judge(sources, 0.99).verdict == "identified"


# The models of an average


def test_models_of_an_average_have_its_draws(
    averaged: xr.DataTree, models: list[AveragedModel]
) -> None:
    assert sum(model.probability for model in models) == pytest.approx(1.0)
    assert sum(len(model.beta) for model in models) == 2000
    described = record_of(averaged)["averaged"]["models"]
    indices = np.unique(averaged["sample_stats"]["model"].to_numpy())
    assert len(models) == len(indices)
    for index, model in zip(indices.tolist(), models, strict=True):
        assert tuple(described[index]["rivals"]) == model.bound.model.rivals
        is_linear = described[index]["model"] == "linear"
        assert ("C_XXX_1" in model.bound.names) is is_linear


def test_models_of_an_average_are_bound_as_they_were(models: list[AveragedModel]) -> None:
    constant = next(model for model in models if "C_XXX_1" not in model.bound.names)
    expected = LINEAR.with_degree(0).with_rivals(*constant.bound.model.rivals).bind(CAMPAIGN)
    assert constant.bound.names == expected.names
    np.testing.assert_allclose(constant.bound.prior_sd, expected.prior_sd, rtol=1e-12)


def test_a_single_model_is_an_average_of_one() -> None:
    rule = lb.inference.StoppingRule(ess=300.0)
    posterior = lb.sample(LINEAR, CAMPAIGN, sampler="independent", rule=rule)
    (model,) = averaged_models(posterior)
    assert model.probability == 1.0
    (draws,) = model_draws_of(posterior)
    np.testing.assert_array_equal(model.beta, draws.beta)


# Verdicts and budgets of an average, from those of its models


def shares_by_hand(models: list[AveragedModel], name: str, place: int) -> dict[str, float]:
    """Return Σ p_m var_m share_m / var by term, and Σ p_m (mean_m − mean)² / var."""
    mean = sum(model.probability * model.beta[:, place].mean() for model in models)
    shares = {MODEL_CHOICE: 0.0}
    for model in models:
        draws = model.beta[:, place]
        shares[MODEL_CHOICE] += model.probability * (draws.mean() - mean) ** 2
        if name not in model.bound.names:
            continue
        verdicts = judge_parameters(
            model.bound,
            information_of(model.bound, model.phi.mean(axis=0)),
            model.bound.prior_mean,
        )[name]
        for term, share in verdicts.shares.items():
            weighted = model.probability * draws.var() * share
            shares[term] = shares.get(term, 0.0) + weighted
    variance = np.concatenate([model.beta[:, place] for model in models]).var()
    return {term: share / variance for term, share in shares.items()}


@pytest.mark.parametrize("name", ["C_XXX", "C_YYY", "C_CCY", "C_XXX_1", "E_XX1", "E_C0YX"])
def test_shares_are_averaged_like_the_numbers(
    name: str,
    averaged: xr.DataTree,
    models: list[AveragedModel],
    verdicts: Mapping[str, ParameterIdentifiability],
) -> None:
    place = list(verdicts).index(name)
    expected = shares_by_hand(models, name, place)
    shares = verdicts[name].shares
    assert set(shares) == set(expected)
    for term, share in expected.items():
        assert shares[term] == pytest.approx(share, abs=1e-9), term
    assert sum(shares.values()) == pytest.approx(1.0)
    draws = averaged["posterior"][name].to_numpy()
    assert verdicts[name].sd == pytest.approx(draws.std())
    assert verdicts[name].mean == pytest.approx(draws.mean())


@pytest.mark.parametrize("name", ["C_XXX", "C_XXX_1", "E_XX1"])
def test_the_budget_of_an_average(
    name: str,
    averaged: xr.DataTree,
    models: list[AveragedModel],
    verdicts: Mapping[str, ParameterIdentifiability],
    budgets: Mapping[str, Budget],
) -> None:
    """Its u is that of all draws; the spread between the models is a line of it."""
    budget = budgets[name]
    assert budget.u == pytest.approx(averaged["posterior"][name].to_numpy().std(ddof=1))
    assert sum(line.share for line in budget.contributions) == pytest.approx(1.0)
    expected = shares_by_hand(models, name, list(verdicts).index(name))
    assert budget.share(MODEL_CHOICE) == pytest.approx(expected[MODEL_CHOICE], abs=1e-9)
    assert budget.origin_of(MODEL_CHOICE) == Origin.MEASURED
    # Shares of draws, averaged over the scales, differ a little from those at the mean scales.
    assert budget.share("Mount") == pytest.approx(expected["Mount"], abs=0.05)


def test_partners_are_those_of_the_averaged_shares(
    verdicts: Mapping[str, ParameterIdentifiability],
) -> None:
    for entry in verdicts.values():
        if entry.verdict == "confounded":
            assert sum(entry.partner_shares.values()) > 0.5
            assert entry.sd_if_known is not None
            assert entry.sd_if_known < 0.75 * entry.sd


def test_a_known_term_leaves_the_spread_between_models(
    models: list[AveragedModel], verdicts: Mapping[str, ParameterIdentifiability]
) -> None:
    entry = verdicts["C_XXX"]
    remaining = entry.shares[MODEL_CHOICE] * entry.sd**2
    for model in models:
        of_model = judge_parameters(
            model.bound,
            information_of(model.bound, model.phi.mean(axis=0)),
            model.bound.prior_mean,
            SampledSd(model.bound.prior_sd, model.sd[model.parameter_indices]),
        )["C_XXX"]
        unknown = 1.0 - of_model.confounding["Mount"]
        remaining += model.probability * unknown * model.sd[0] ** 2
    assert 1.0 - entry.confounding["Mount"] == pytest.approx(remaining / entry.sd**2)


def test_changes_with_force_are_judged_too(averaged: xr.DataTree) -> None:
    judged = judge_quantities(averaged)
    stated = lb.analysis.change_with_force(averaged)
    assert list(judged.changes) == list(stated)
    for name, change in judged.changes.items():
        # Two sets of draws of the joints' load
        assert change.sd == pytest.approx(stated[name].change.sd, rel=0.1)
    in_most_models = 1.0 - stated["C_XYX"].probability_of_no_change
    probability = record_of(averaged)["averaged"]["probability"]["linear"]
    assert in_most_models == pytest.approx(probability, abs=2e-3)


@pytest.mark.parametrize("average", [True, False])
def test_the_note_of_a_fit_names_what_is_confounded_by_the_verdicts(
    averaged: xr.DataTree, recovered: lb.Campaign, average: bool
) -> None:
    """Parameters and changes with force; the note left the changes out."""
    posterior = averaged
    if not average:
        posterior = lb.sample(lb.HybridModel.default(1), recovered, sampler="independent", seed=1)
    judged = judge_quantities(posterior)
    expected = {}
    for name, parameter in judged.parameters.items():
        if parameter.verdict == Verdict.CONFOUNDED and not is_slope(name):
            expected[name] = parameter.partners
    for name, change in judged.changes.items():
        if change.verdict == Verdict.CONFOUNDED:
            expected[f"Δ{name}"] = tuple(change.partner_shares)
    assert confounded_in(posterior) == expected
    if not average:
        (model,) = averaged_models(posterior)
        assert confounded_at(model.bound, model.phi.mean(axis=0)) == expected
    (note,) = [
        text
        for text in lb.report.describe_fit(posterior)["warnings"]
        if text.startswith("Confounded")
    ]
    assert ("Δ: change over the tested forces." in note) is any("Δ" in name for name in expected)
    if not average:
        assert "ΔC_YYY with joint load" in note


def test_a_change_that_no_draw_has_is_not_judged() -> None:
    """Readings in mm that were taken for µm leave the linear model no draw, so that the posterior
    and the prior variance of a change are zero. There is no uncertainty to be judged, and nothing
    is divided by zero."""
    tests = []
    for test in CAMPAIGN.tests:
        tests.append(test.with_reading_um(1e-3 * np.asarray(test.reading_um)))
    campaign = replace(CAMPAIGN, tests=tuple(tests))
    models = {"constant": lb.HybridModel.first(0), "linear": lb.HybridModel.first(1)}
    still = lb.average(models, campaign, draws=1000, evidences=lb.inference.Evidences(campaign))
    assert lb.analysis.change_with_force(still)["C_XXX"].probability_of_no_change == 1.0
    with np.errstate(invalid="raise"):
        judged = judge_quantities(still)
    assert judged.changes == {}
    assert "C_XXX" in judged.parameters


def test_parameters_are_judged_alike_beside_changes(
    averaged: xr.DataTree, verdicts: Mapping[str, ParameterIdentifiability]
) -> None:
    judged = judge_quantities(averaged).parameters
    for name, entry in verdicts.items():
        assert judged[name].verdict == entry.verdict
        assert judged[name].sd == entry.sd
        assert judged[name].shares == pytest.approx(entry.shares)


def test_words_for_the_choice_between_models() -> None:
    assert source_words(MODEL_CHOICE) == "choice between models"


def test_words_of_an_averaged_verdict(verdicts: Mapping[str, ParameterIdentifiability]) -> None:
    assert all(verdict_words(entry) for entry in verdicts.values())


def test_variances_of_sums_are_the_quadratic_forms_of_their_weights() -> None:
    rng = np.random.default_rng(3)
    weights = rng.normal(size=(5, 7))
    root = rng.normal(size=(7, 7))
    expected = np.einsum("qi,ij,qj->q", weights, root @ root.T, weights)
    np.testing.assert_allclose(_variances_of(weights, root @ root.T), expected, rtol=1e-12)
