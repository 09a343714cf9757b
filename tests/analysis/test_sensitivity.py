"""Other assumptions, explanations of a change with force, subsets of slopes, local fits."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from campaigns import HYPER_UM, TRUTH, plan, refuses, simulated

import ldbb_bayes as lb
from ldbb_bayes.analysis import (
    neighbouring_forces,
    rival_explanations,
    sensitivity,
    varying_slopes,
)
from ldbb_bayes.analysis.comparison import Comparison, Sign
from ldbb_bayes.analysis.sensitivity import WHITE_NOISE
from ldbb_bayes.analysis.varying_slopes import SlopeSubset
from ldbb_bayes.inference.evidence import probabilities
from ldbb_bayes.inference.evidences import Evidences
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.inference.nodes import compute_nodes
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.terms import Discrepancy, ForceError, Mount, SetupShift
from ldbb_bayes.report.wording import comparison_sentences, with_words
from ldbb_bayes.results import json_text

LINEAR = lb.HybridModel.first(1)
SMALL = simulated(plan((30, 30, 30), forces_N=(36.0, 400.0, 742.0)), seed=1)
CAMPAIGN = simulated(plan((30,) * 4), seed=1)
FIXED_SLOPES = ("C_XXX_1", "C_YYY_1", "C_CXY_1", "C_CYY_1")
# Two slopes and two scales: quick.
TWO_SLOPES = LINEAR.without("ball-form", "setup-shift").fixing(*FIXED_SLOPES)
FREE = ("C_XYX", "C_CCY")


# Assumptions


@pytest.fixture(scope="module")
def changed() -> dict[str, HybridModel]:
    pair = [LINEAR.with_degree(0), LINEAR]
    models = {}
    for label, change in sensitivity.discrepancy_assumptions(pair).items():
        models[label] = change(LINEAR)
    return models


def test_discrepancies_that_the_model_lacks_are_assumed(changed: dict[str, HybridModel]) -> None:
    assert "discrepancy κ/n" not in changed
    terms = changed["discrepancy κ/n²"].nuisances
    (discrepancy,) = (term for term in terms if isinstance(term, Discrepancy))
    assert discrepancy.decay == 2.0


def test_set_up_shifts_are_assumed(changed: dict[str, HybridModel]) -> None:
    scales = changed["set-up shift: own scales for orders 0 and 1"].scales
    names = [scale.name for scale in scales]
    assert names == ["sigma", "delta_0", "delta_1", "kappa", "tau"]
    without_shift = changed["without set-up shift"].nuisances
    assert not any(isinstance(term, SetupShift) for term in without_shift)


def test_white_noise_is_without_terms_and_truncation(changed: dict[str, HybridModel]) -> None:
    assert changed[WHITE_NOISE].nuisances == ()
    assert not changed[WHITE_NOISE].prior.truncated


def test_assumptions_keep_the_order_of_terms(changed: dict[str, HybridModel]) -> None:
    model_terms = [type(term) for term in LINEAR.nuisances]
    for label, model in changed.items():
        if label != WHITE_NOISE:
            terms = [type(term) for term in model.nuisances]
            assert terms == [term for term in model_terms if term in terms]


# Explanations of a change with force


@pytest.mark.parametrize(
    "is_recovered", [False, pytest.param(True, marks=pytest.mark.slow)], ids=["small", "recovered"]
)
def test_every_combination_of_explanations_is_a_model(
    is_recovered: bool, recovered: lb.Campaign
) -> None:
    """Every one of 16 evidences against nodes of its own, and what is worked out from them."""
    model = lb.HybridModel.default(1)
    campaign = recovered
    if not is_recovered:
        model = model.without("circle-scale", "ball-form", "setup-shift")
        campaign = CAMPAIGN
    pair = {"constant": model.with_degree(0), "linear": model}
    explanations = rival_explanations.compare_explanations(
        pair, Evidences(campaign, tolerance=1e-2)
    )
    models = {}
    log_evidence = {}
    for explained in explanations.models:
        variant = model.with_rivals(*explained.by).with_degree("slopes" in explained.by)
        models[explained.by] = variant
        value = lb.log_evidence(variant, campaign, tolerance=1e-2).log_value
        log_evidence[explained.by] = value
        assert explained.log_evidence == pytest.approx(value, abs=1e-2, rel=0.0)
    assert len({(variant.degree, variant.rivals) for variant in models.values()}) == 16

    shares = probabilities(np.array(list(log_evidence.values())))
    for name, probability in explanations.inclusion_probability.items():
        has_name = np.array([name in combination for combination in log_evidence])
        assert probability == pytest.approx(shares[has_name].sum(), abs=5e-3)
    slopes = explanations.inclusion_probability["slopes"]
    log_odds = np.log(slopes / (1.0 - slopes))
    assert explanations.averaged.log_bayes_factor == pytest.approx(log_odds)
    assert explanations.alone.log_evidence == pytest.approx(
        {"constant": log_evidence[()], "linear": log_evidence["slopes",]}, abs=1e-2, rel=0.0
    )
    alone_error = explanations.alone.log_bayes_factor_error
    assert alone_error <= explanations.averaged.log_bayes_factor_error < 0.02


def test_the_average_alone_is_that_of_the_comparison() -> None:
    model = lb.HybridModel.default(1).without("circle-scale", "ball-form", "setup-shift")
    pair = {"constant": model.with_degree(0), "linear": model}
    compared = rival_explanations.compare_explanations(pair, Evidences(CAMPAIGN, tolerance=0.2))
    averaged = rival_explanations.average_explanations(pair, Evidences(CAMPAIGN, tolerance=0.2))
    assert averaged == compared.averaged


def test_negligible_combinations_of_explanations_hardly_count(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Their limit is 10 nat below the best of those with slopes, or of those without."""
    model = lb.HybridModel.default(1)
    limits = []

    def of_few(_: Evidences, below: float, asked: lb.HybridModel) -> tuple[SimpleNamespace, bool]:
        limits.append(below)
        log_value = 3.0 * len(asked.rivals) + 20.0 * ("joint load" in asked.rivals) - asked.degree
        evidence = SimpleNamespace(log_value=log_value, error=0.1 + 0.1 * asked.degree)
        if log_value <= below:
            evidence.error = 5.0
        return SimpleNamespace(evidence=evidence), log_value <= below

    monkeypatch.setattr(Evidences, "nodes_unless_negligible", of_few)
    pair = {"constant": model.with_degree(0), "linear": model}
    averaged = rival_explanations.average_explanations(pair, Evidences(CAMPAIGN))
    assert averaged.log_bayes_factor == pytest.approx(-1.0)
    assert averaged.log_bayes_factor_error == pytest.approx(0.3)
    assert limits == [-np.inf, *[18.0] * 7, -np.inf, *[19.0] * 7]


@pytest.mark.slow
def test_a_curve_in_the_force_axis_explains_the_experiment_better_than_slopes(
    recovered: lb.Campaign,
) -> None:
    """First edition's priors, zero kept: slopes, or one curvature, against none."""
    curved = (Mount(curvature_um=0.5), ForceError(curvature_sd=0.01), SetupShift("centre"))
    model = LINEAR.without("truncation").with_term(*curved)
    comparison = lb.compare(
        {"constant": model.with_degree(0), "linear": model}, recovered, evidence_only=True
    )
    explanations = comparison.explanations
    assert explanations is not None
    log_evidence = {explained.by: explained.log_evidence for explained in explanations.models}
    gains = []
    for name in ("slopes", "curved mount", "curved force law"):
        gains.append(log_evidence[name,] - log_evidence[()])
    assert gains == pytest.approx([5.79, 10.61, 9.06], abs=0.05)
    assert explanations.alone.log_bayes_factor > 5.0
    assert explanations.averaged.log_bayes_factor < -4.0
    assert comparison.headline[0] == explanations.averaged.log_bayes_factor
    assert explanations.models[0].by == ("curved mount", "curved force law")
    assert 0.5 < explanations.inclusion_probability["curved force law"] < 0.75
    assert explanations.instead == ("curved mount",)
    assert comparison.sign is Sign.HELD
    text = " ".join(comparison_sentences(comparison))
    alone = rf"{explanations.alone.log_bayes_factor:.2f} (error 0.0"
    assert "Strong evidence in favour of constant: averaged over curved mount and curved" in text
    assert f"; with none of them it is +{alone}" in text
    assert "Slopes are not needed: curved mount explains the readings as well." in text
    record = json.loads(json_text(with_words(comparison)))
    assert Comparison.from_dict(record).explanations == explanations


# Subsets of slopes


class Selection:
    """Subsets of slopes of a small campaign, weighed."""

    def __init__(self) -> None:
        evidences = Evidences(CAMPAIGN, tolerance=0.02)
        slopes, subsets, curves = varying_slopes.slope_subsets(TWO_SLOPES, evidences, seed=1)
        self.inclusion = {name: slope.inclusion_probability for name, slope in slopes.items()}
        self.subsets: dict[tuple[str, ...], SlopeSubset] = {}
        for subset in subsets:
            self.subsets[subset.varying] = subset
        self.curves = curves


@pytest.fixture(scope="module")
def selection() -> Selection:
    return Selection()


def with_slopes(names: tuple[str, ...]) -> HybridModel:
    """Return the model with no slopes but these."""
    return TWO_SLOPES.fixing(*(f"{name}_1" for name in FREE if name not in names))


def test_probabilities_of_subsets_are_those_of_their_evidences(selection: Selection) -> None:
    assert set(selection.subsets) == {(), FREE[:1], FREE[1:], FREE}
    expected = []
    for names in selection.subsets:
        evidence = lb.log_evidence(with_slopes(names), CAMPAIGN, tolerance=5e-3)
        expected.append(evidence.log_value)
    subsets = list(selection.subsets.values())
    np.testing.assert_allclose([subset.log_evidence for subset in subsets], expected, atol=0.02)
    shares = [subset.probability for subset in subsets]
    np.testing.assert_allclose(shares, probabilities(np.array(expected)), atol=5e-3)
    assert shares == sorted(shares, reverse=True)


@pytest.mark.parametrize("name", FREE)
def test_inclusion_is_the_sum_over_subsets(selection: Selection, name: str) -> None:
    total = 0.0
    for names, subset in selection.subsets.items():
        if name in names:
            total += subset.probability
    assert selection.inclusion[name] == pytest.approx(total)


def test_averaged_compliance(selection: Selection) -> None:
    """E[C(F)] = Σ P(subset) E[C(F) | subset]."""
    curve = selection.curves["C_XYX"]
    expected = np.zeros(2)
    for names, subset in selection.subsets.items():
        bound = with_slopes(names).bind(CAMPAIGN)
        moments = compute_nodes(HyperPosterior(bound, truncated=True), 1e-2).moments()
        mean = dict(zip(bound.names, moments[0], strict=True))
        slope = mean.get("C_XYX_1", 0.0)
        expected += subset.probability * (mean["C_XYX"] + slope * np.array([-353.0, 353.0]))
    sd = (curve.high - curve.low)[[0, -1]] / 4.0
    np.testing.assert_allclose(curve.mean[[0, -1]] / sd, expected / sd, atol=0.08)
    assert np.all((curve.low < curve.mean) & (curve.mean < curve.high))


def test_a_compliance_without_a_slope_has_a_flat_band(selection: Selection) -> None:
    assert np.ptp(selection.curves["C_XXX"].mean) == pytest.approx(0.0, abs=1e-18)


@pytest.mark.parametrize("slopes", [4, 15])
def test_too_many_subsets_are_searched_from_the_best(slopes: int) -> None:
    """Of compliances of known, independent evidence all sets of 4, and 100 of 32768, are weighed.

    These hold the best and most probability.
    """
    all_gains = [3.0, -4.0, 2.5, -3.0, -5.0, 1.5, -2.0, -6.0, -3.5, -4.5, -2.5, -3.0, 4.0, -5.5]
    gain = np.array([*all_gains, -4.0])[:slopes]

    def weigh(subset: tuple[bool, ...]) -> Any:
        evidence = SimpleNamespace(log_value=float(gain @ np.array(subset)))
        return SimpleNamespace(evidence=evidence)

    nodes_by_subset = varying_slopes._best_first(slopes, weigh)
    assert len(nodes_by_subset) == min(2**slopes, 100)
    log_value = np.array([nodes.evidence.log_value for nodes in nodes_by_subset.values()])
    subsets = list(nodes_by_subset)
    assert subsets[int(np.argmax(log_value))] == tuple(gain > 0)
    assert np.exp(log_value - np.log1p(np.exp(gain)).sum()).sum() > 0.8
    inclusion = probabilities(log_value) @ np.array(subsets)
    np.testing.assert_allclose(inclusion, 1.0 / (1.0 + np.exp(-gain)), atol=0.05)


def test_a_slope_that_is_there_is_included() -> None:
    model = LINEAR.without("truncation").fixing(*FIXED_SLOPES)
    truth = TRUTH | {"C_XYX_1": 1.5e-8}
    campaign = LINEAR.simulate(plan(), seed=3, parameters=truth, hyper_um=HYPER_UM).campaign
    slopes, *_ = varying_slopes.slope_subsets(model, Evidences(campaign, tolerance=1e-2), seed=1)
    assert slopes["C_XYX"].inclusion_probability > 0.95
    assert slopes["C_CCY"].inclusion_probability < 0.95


# Local fits: a window's posterior and least squares (the paper's Tables 7 and 8, in tests/studies),
# repeated forces

COLUMNS = [
    "force_low_N",
    "force_high_N",
    "force_N",
    "tests",
    "parameter",
    "unit",
    "least_squares",
    "least_squares_u",
    "mean",
    "sd",
    "ci_low",
    "ci_high",
]


def test_a_window_is_a_campaign_of_its_own(recovered: lb.Campaign) -> None:
    """Without truncation and force error `marginalize` and `fit_least_squares` say the same."""
    model = lb.HybridModel.first(0).without("truncation", "force-error").fixing("C_CCY")
    table = lb.local_fits(model, recovered.select(["f036", "f238", "f364"]))
    assert list(table.columns) == COLUMNS
    assert "C_CCY" not in set(table["parameter"])
    local = table[table["force_low_N"] == 238.0].set_index("parameter")
    window = recovered.select(["f238", "f364"])
    expected = lb.inference.marginalize(model, window).loc[local.index]
    sd = expected["sd"]
    np.testing.assert_allclose(local["mean"] / sd, expected["mean"] / sd, atol=0.02)
    np.testing.assert_allclose(local["sd"], sd, rtol=0.02)
    width = local["ci_high"] - local["ci_low"]
    expected_width = expected["ci_high"] - expected["ci_low"]
    np.testing.assert_allclose(width / expected_width, 1.0, atol=0.05)
    squares = lb.fit_least_squares(window, fixed=("C_CCY",)).table
    np.testing.assert_allclose(
        local[["least_squares", "least_squares_u"]], squares[["estimate", "u"]], rtol=1e-9
    )


def test_pairs_of_force_levels() -> None:
    planned = plan((30,) * 5, forces_N=(400.0, 36.0, 400.0, 742.0, 200.0))
    assert neighbouring_forces._neighbouring_pairs(planned) == [
        ("f036", "f200"),
        ("f200", "f400", "f400_2"),
        ("f400", "f400_2", "f742"),
    ]


@pytest.mark.parametrize("change", [{"setup": 2}, {"plane": "YZ", "setup": 2}])
def test_windows_that_lack_a_set_up_or_a_plane(change: dict[str, Any]) -> None:
    """Each window keeps the campaign's parameters; high forces are in another set-up or plane."""
    model = lb.HybridModel.first(0).without("truncation", "ball-form", "discrepancy")
    planned = plan((40,) * 4, forces_N=(50.0, 300.0, 500.0, 700.0))
    high_forces = [replace(test, **change) for test in planned.tests[2:]]
    tests = (*planned.tests[:2], *high_forces)
    campaign = model.simulate(replace(planned, tests=tests), seed=3).campaign
    table = lb.local_fits(model, campaign)
    assert set(table["parameter"]) == set(model.bind(campaign).names)
    assert np.isfinite(table["mean"]).all()


def test_local_fits_of_one_force_are_refused() -> None:
    message = "local fits must have at least two force levels, got one"
    refuses(re.escape(message), lb.local_fits, LINEAR, SMALL.select(["f400"]))


def test_local_fits_with_flat_priors_are_refused() -> None:
    refuses("must have a proper prior", lb.local_fits, lb.HybridModel.paper(0), SMALL)
