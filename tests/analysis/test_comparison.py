"""Comparison of models: its numbers against those of its parts, what it says and refuses."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from campaigns import plan, refuses, simulated

import ldbb_bayes as lb
from ldbb_bayes.analysis import outlying_tests
from ldbb_bayes.analysis.comparison import Comparison, Sign
from ldbb_bayes.analysis.comparison_plan import SLOPE_SCALES
from ldbb_bayes.analysis.model_comparison import interpolate_crossings
from ldbb_bayes.analysis.rival_explanations import Explained, Explanations
from ldbb_bayes.analysis.sensitivity import WHITE_NOISE, Assumed
from ldbb_bayes.inference.evidences import Evidences
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.inference.nodes import compute_nodes
from ldbb_bayes.inference.posterior import fit_of
from ldbb_bayes.model.terms import SetupShift
from ldbb_bayes.parallel import process_executor
from ldbb_bayes.report.text import parts_of
from ldbb_bayes.report.wording import comparison_sentences, strength_words, with_words
from ldbb_bayes.results import json_text

LINEAR = lb.HybridModel.first(1)
RATIO = "linear/constant"
CENTRED = "set-up shift of order 1 (centre) only"
SMALL = simulated(plan((30, 30, 30), forces_N=(36.0, 400.0, 742.0)), seed=1)
# Two slopes and two scales: quick.
TWO_SLOPES = LINEAR.without("ball-form", "setup-shift").fixing(
    "C_XXX_1", "C_YYY_1", "C_CXY_1", "C_CYY_1"
)
PAIR = {"constant": TWO_SLOPES.with_degree(0), "linear": TWO_SLOPES}
CAMPAIGN = simulated(plan((30,) * 4), seed=1)


@pytest.fixture(scope="module")
def comparison() -> Comparison:
    steps = []

    def record_step(done: int, total: int) -> None:
        steps.append((done, total))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(outlying_tests, "_REPLICATES", 4000)
        comparison = lb.compare(PAIR, CAMPAIGN, tolerance=0.02, progress=record_step)
    assert steps == [(k + 1, len(steps)) for k in range(len(steps))], "as many as were counted"
    return comparison


@pytest.mark.slow
def test_a_second_process_changes_no_number(recovered: lb.Campaign) -> None:
    """Its parts start from what is known when they begin, wherever they are computed."""
    model = lb.HybridModel(1)
    models = {"constant": model.with_degree(0), "linear": model}
    with process_executor(3) as executor:
        list(executor.map(time.sleep, [2.0] * 3))  # three are at work, so that each takes a part
        shared = lb.compare(models, recovered, tolerance=0.05, executor=executor)
    in_one_process = lb.compare(models, recovered, tolerance=0.05)
    assert json_text(shared.as_dict()) == json_text(in_one_process.as_dict())


def test_copied_evidences_keep_what_was_known(recovered: lb.Campaign) -> None:
    evidences = Evidences(recovered, tolerance=0.3)
    (nodes,) = evidences.nodes(LINEAR)
    copied = evidences.copy()
    evidences.nodes(LINEAR.with_degree(0))
    assert len(copied.computed) == 1
    assert copied.nodes(LINEAR) == [nodes]
    (related,) = evidences._related_models.values()
    related._refine()
    (related_of_copy,) = copied._related_models.values()
    assert related_of_copy._untruncated is not related._untruncated


def log_bayes_factor(model: lb.HybridModel, campaign: lb.Campaign) -> float:
    """Return ln B of a model over the same with constant compliance."""
    linear = lb.log_evidence(model, campaign)
    constant = lb.log_evidence(model.with_degree(0), campaign)
    return lb.inference.log_bayes_factor(linear, constant)[0]


def test_evidence_and_probabilities(comparison: Comparison) -> None:
    for name, model in PAIR.items():
        expected = lb.log_evidence(model, CAMPAIGN).log_value
        log_evidence = comparison.models[name].log_evidence
        assert log_evidence == pytest.approx(expected, abs=5e-3, rel=0.0)
    linear = comparison.models["linear"]
    value = comparison.log_bayes_factor[RATIO]
    assert value == pytest.approx(linear.log_evidence - comparison.models["constant"].log_evidence)
    probability = 1.0 / (1.0 + np.exp(-value))
    assert linear.posterior_probability == pytest.approx(probability, rel=1e-9)
    assert comparison.log_bayes_factor_error[RATIO] < 0.03
    assert comparison.within_tolerance


def test_sensitivity_to_the_slopes_prior_is_the_same_comparison_again(
    comparison: Comparison,
) -> None:
    scales = [scaled.slope_scale for scaled in comparison.prior_sensitivity]
    assert scales == list(SLOPE_SCALES)
    by_scale = {s.slope_scale: s.log_bayes_factor for s in comparison.prior_sensitivity}
    assert by_scale[0.3] == pytest.approx(comparison.log_bayes_factor[RATIO], abs=1e-6)
    wide = replace(TWO_SLOPES, prior=replace(TWO_SLOPES.prior, slope_scale=3.0))
    assert by_scale[3.0] == pytest.approx(log_bayes_factor(wide, CAMPAIGN), abs=0.02)


def test_a_model_without_slopes_is_the_same_for_every_prior_of_slopes() -> None:
    evidences = Evidences(CAMPAIGN, tolerance=0.1)
    lb.compare(PAIR, CAMPAIGN, evidence_only=True, evidences=evidences)
    without_slopes = [nodes for nodes in evidences._nodes.values() if nodes.bound.model.degree == 0]
    assert len({nodes.bound.model.prior.slope_scale for nodes in without_slopes}) == 1


def test_sensitivity_to_assumptions_is_the_same_comparison_again(comparison: Comparison) -> None:
    assumed = {a.assumption: a.log_bayes_factor for a in comparison.discrepancy_sensitivity}
    assert next(iter(assumed)) == "as in the model"
    centre = TWO_SLOPES.with_term(SetupShift("centre"))
    assert assumed[CENTRED] == pytest.approx(log_bayes_factor(centre, CAMPAIGN), abs=0.02)
    plain = TWO_SLOPES.without(
        "bar-length", "mount", "force-error", "discrepancy", "hysteresis", "truncation"
    )
    assert assumed[WHITE_NOISE] == pytest.approx(log_bayes_factor(plain, CAMPAIGN), abs=0.02)


@pytest.mark.slow
def test_rejected_assumptions_are_weighed_roughly(recovered: lb.Campaign) -> None:
    """They have an error of their own, which is shown; others are as exact as was asked."""
    model = LINEAR.without("ball-form", "truncation")
    comparison = lb.compare(
        {"constant": model.with_degree(0), "linear": model},
        recovered,
        evidence_only=True,
        tolerance=1e-3,
    )
    by_name = {assumed.assumption: assumed for assumed in comparison.discrepancy_sensitivity}
    rough = by_name["without set-up shift"]
    assert 2e-3 < rough.log_bayes_factor_error < 0.2
    exact = log_bayes_factor(model.without("setup-shift"), recovered)
    assert abs(rough.log_bayes_factor - exact) < rough.log_bayes_factor_error
    cells = f"'{rough.log_bayes_factor:+.2f}', '{rough.log_bayes_factor_error:.1g}'"
    assert cells in str(parts_of(comparison)[1])
    assert comparison.largest_error < 1e-3
    # Each of the two evidences of a Bayes factor was asked to 1e-3.
    assert by_name[CENTRED].log_bayes_factor_error < 2e-3


def test_the_recovered_experiment_is_not_robust(compared: Comparison) -> None:
    """Constant compliance is favoured; that no zero shift is assumed turns it."""
    assert compared.log_bayes_factor[RATIO] < -1.0
    changes = {assumed.assumption: compared.gain(assumed) for assumed in compared.turning()}
    assert changes[CENTRED] > -5.0
    assert changes["without set-up shift"] < -1000.0
    assert list(changes.values()) == sorted(changes.values(), reverse=True)
    assert compared.sign is Sign.OPEN
    assert re.search(
        r"Not decided: ln B.* very strong evidence in favour of constant\. .*The sign of ln B is"
        r" not robust.*the readings do not rule out",
        " ".join(comparison_sentences(compared)),
    )
    assert f"{compared.models['constant'].least_squares_rmse_um:.1f}" == "1.1"
    assert f"{compared.models['linear'].least_squares_rmse_um:.1f}" == "0.9"


def test_leave_one_force_out(comparison: Comparison) -> None:
    assert list(comparison.tests) == [test.name for test in CAMPAIGN.tests]
    densities_by_model = {}
    for name, model in comparison.models.items():
        densities = np.array([test.lofo_log_density[name] for test in comparison.tests.values()])
        densities_by_model[name] = densities
        assert model.elpd_lofo == pytest.approx(densities.sum())
        assert model.elpd_lofo_se == pytest.approx(np.sqrt(4 * densities.var(ddof=1)))
    differences = densities_by_model["linear"] - densities_by_model["constant"]
    difference = comparison.elpd_difference[RATIO]
    assert difference.value == pytest.approx(differences.sum())
    assert difference.se == pytest.approx(np.sqrt(4 * differences.var(ddof=1)))


@pytest.mark.parametrize("name", PAIR)
def test_density_of_a_test_left_out(comparison: Comparison, name: str) -> None:
    """ln p(y_r | y_−r) = ln Z(y) − ln Z(y_−r)."""
    bound = PAIR[name].bind(CAMPAIGN)
    all_tests = compute_nodes(HyperPosterior(bound, truncated=True), 0.1)
    remaining = bound.keeping(["f300", "f520", "f742"])
    without_first = compute_nodes(HyperPosterior(remaining, truncated=True), 0.1)
    expected = all_tests.evidence.log_value - without_first.evidence.log_value
    density = comparison.tests["f036"].lofo_log_density[name]
    assert density == pytest.approx(expected, abs=0.01)


def test_quality_is_that_of_the_models(comparison: Comparison) -> None:
    for name, model in comparison.models.items():
        squares = lb.fit_least_squares(CAMPAIGN, model.degree, fixed=PAIR[name].fixed)
        assert model.least_squares_rmse_um == squares.quality.rmse_um
        middle = model.compliance_against_force["C_XXX"].mean[20]
        assert middle == pytest.approx(model.parameters["C_XXX"].mean, rel=0.02)
    rule = lb.inference.StoppingRule(ess=400.0)
    fit = fit_of(lb.sample(PAIR["linear"], CAMPAIGN, sampler="independent", rule=rule))
    assert comparison.models["linear"].rmse_um == pytest.approx(fit.rmse_um, rel=0.01)


def test_inclusion_of_slopes_is_the_sum_over_subsets(comparison: Comparison) -> None:
    assert len(comparison.slope_subsets) == 4
    for name, slope in comparison.slopes.items():
        total = sum(s.probability for s in comparison.slope_subsets if name in s.varying)
        assert slope.inclusion_probability == pytest.approx(total)
    flat_curve = comparison.compliance_against_force["C_XXX"]
    assert np.ptp(flat_curve.mean) == pytest.approx(0.0, abs=1e-18)


# Files


def write_record(folder: Path, record: Mapping[str, Any]) -> None:
    (folder / "comparison.json").write_text(json.dumps(record), encoding="utf-8")


def test_json_has_the_agreed_names(comparison: Comparison) -> None:
    record = json.loads(json_text(with_words(comparison)))
    assert {"log_evidence", "log_evidence_error", "elpd_lofo", "elpd_lofo_se", "rmse_um"} <= set(
        record["models"]["linear"]
    )
    assert {"slope_scale", "log_bayes_factor"} <= set(record["prior_sensitivity"][0])
    assert {"assumption", "log_bayes_factor"} <= set(record["discrepancy_sensitivity"][0])
    assert set(record["slopes"]["C_XYX"]) == {"inclusion_probability"}
    assert {"unit", "force_N", "mean", "median", "low", "high", "prob"} == set(
        record["compliance_against_force"]["C_XYX"]
    )
    assert list(record["tests"]["f036"]["lofo_p_value_by_order"]) == [str(n) for n in range(13)]
    assert record["verdict"] == " ".join(record["sentences"])
    assert "explanations" not in record, "no rivals of slopes in the first edition"
    assert len(record["slope_subsets"]) == 4


def test_a_written_comparison_is_read_back(comparison: Comparison, tmp_path: Path) -> None:
    text = json_text(with_words(comparison))
    (tmp_path / "comparison.json").write_text(text, encoding="utf-8")
    read = lb.analysis.read_comparison(tmp_path)
    assert json_text(with_words(read)) == text
    assert "Models at equal prior odds" in str(read)
    assert "<table>" in read._repr_html_()
    pd.testing.assert_frame_equal(comparison.local_fits, read.local_fits, check_dtype=False)


def test_missing_errors_are_infinite(comparison: Comparison, tmp_path: Path) -> None:
    record = json.loads(json_text(with_words(comparison)))
    record["largest_error"] = None
    record["models"]["linear"]["log_evidence_error"] = None
    record["prior_sensitivity"][0]["error"] = None
    write_record(tmp_path, record)
    assert lb.analysis.read_comparison(tmp_path).largest_error == np.inf


def test_a_damaged_comparison_is_refused(comparison: Comparison, tmp_path: Path) -> None:
    record = json.loads(json_text(with_words(comparison)))
    del record["models"]["linear"]["rmse_um"]
    write_record(tmp_path, record)
    refuses(
        r"got another file or a damaged one \(models.linear.rmse_um: Field required\)",
        lb.analysis.read_comparison,
        tmp_path,
    )


def test_a_folder_without_comparison_is_refused(tmp_path: Path) -> None:
    refuses(
        r"must be a folder with comparison\.json", lb.analysis.read_comparison, tmp_path / "nothing"
    )


# The sign of the log Bayes factor


@pytest.mark.parametrize(
    ("log_bayes_factor", "expected"),
    [
        ([1.0, -1.0, -2.0], [10**-0.5]),
        ([1.0, -1.0, 3.0], [10**-0.5, 10**0.25]),
        ([-1.0, -2.0, -3.0], []),
    ],
)
def test_crossings(log_bayes_factor: list[float], expected: list[float]) -> None:
    scale = np.array([0.1, 1.0, 10.0])
    assert interpolate_crossings(scale, np.array(log_bayes_factor)) == pytest.approx(expected)


@pytest.fixture
def firm(compared: Comparison) -> Comparison:
    """Return a comparison that no assumption turns."""
    assumptions = []
    for assumed in compared.discrepancy_sensitivity:
        assumptions.append(Assumed(assumed.assumption, -6.0, 1e-3, assumed.log_evidence))
    return replace(compared, discrepancy_sensitivity=tuple(assumptions))


def with_assumption(firm: Comparison, log_bayes_factor: float, gain: float) -> Comparison:
    """Return a comparison under one assumption with so much more evidence than the models' own."""
    unchanged, changed, *_ = firm.discrepancy_sensitivity
    log_evidence = {name: value + gain for name, value in unchanged.log_evidence.items()}
    assumed = replace(changed, log_bayes_factor=log_bayes_factor, log_evidence=log_evidence)
    return replace(firm, discrepancy_sensitivity=(unchanged, assumed))


def test_a_sign_that_no_assumption_turns(firm: Comparison) -> None:
    assert firm.sign is Sign.FIRM
    assert firm.preferred_assumption() is None
    first, *_ = comparison_sentences(firm)
    assert re.match(r"\w+( \w+)? evidence in favour of \w+: .*ln B", first)


def test_the_verdict_stands_before_the_number_that_it_is_about(firm: Comparison) -> None:
    """ln B with none of the other explanations stands last: it has the other sign."""
    averaged = Assumed("averaged", -1.49, 0.02, {"constant": 100.0, "linear": 98.5})
    without_rivals = Assumed("alone", 2.39, 0.02, {"constant": 97.0, "linear": 99.4})
    models = (Explained(("joint load",), 100.0, 0.01, 1.0),)
    shares = {"slopes": 0.18, "joint load": 0.98}
    explained = replace(firm, explanations=Explanations(shares, models, averaged, without_rivals))
    first, *_ = comparison_sentences(explained)
    assert first.startswith(
        "Positive evidence in favour of constant: averaged over joint load, each in the model or"
        " not, ln B(linear/constant) = −1.49 (error 0.02); with none of them it is +2.39 (error"
        " 0.02). "
    )
    crossed = replace(explained, prior_sensitivity_crossings=(0.12,))
    first, *_ = comparison_sentences(crossed)
    assert first.startswith("Not decided: averaged over joint load, each in the model or not, ln B")
    by_itself = "by itself positive evidence in favour of constant; with none"
    assert f"= −1.49 (error 0.02), {by_itself}" in first


def test_a_sign_that_a_rejected_assumption_turns(firm: Comparison) -> None:
    comparison = with_assumption(firm, log_bayes_factor=3.0, gain=-500.0)
    assert comparison.sign is Sign.HELD
    sentences = comparison_sentences(comparison)
    assert any(sentence.startswith("The answer changes with") for sentence in sentences)


def test_a_sign_that_the_slope_scale_turns(firm: Comparison) -> None:
    crossed = replace(firm, prior_sensitivity_crossings=(0.12,))
    assert crossed.sign is Sign.OPEN
    sentences = comparison_sentences(crossed)
    assert any("changing sign at 0.12" in sentence for sentence in sentences)


@pytest.mark.parametrize(
    ("of_estimate", "words"),
    [(False, "C being the prior sd of the compliance"), (True, "C being the estimate of")],
)
def test_of_what_the_size_expected_of_slopes_is_a_multiple(
    of_estimate: bool, words: str, comparison: Comparison
) -> None:
    """The prior of the compared models is that of the first edition."""
    assert not comparison.slopes_of_estimate
    other = replace(comparison, slopes_of_estimate=of_estimate)
    assert any(words in sentence for sentence in comparison_sentences(other))


@pytest.mark.parametrize(
    ("tolerance", "words"),
    [(0.01, "more than 0.01, the default of compare."), (0.05, "more than the 0.05 allowed.")],
)
def test_an_error_that_is_too_large_is_compared_with_what_was_allowed(
    firm: Comparison, tolerance: float, words: str
) -> None:
    """In a report of files --tolerance is the limit of a parameter; it is not named."""
    rough = replace(firm, tolerance=tolerance, largest_error=0.07)
    text = " ".join(comparison_sentences(rough))
    assert f"has an error of 0.07 nats, {words}" in text
    assert "--tolerance" not in text


def test_an_assumption_that_the_readings_prefer(firm: Comparison) -> None:
    comparison = with_assumption(firm, log_bayes_factor=-2.0, gain=20.0)
    better = comparison.discrepancy_sensitivity[1]
    assert comparison.preferred_assumption() == better
    text = " ".join(comparison_sentences(comparison))
    assert f"The readings prefer '{better.assumption}' by 20.0 nats" in text


def test_white_noise_alone_is_never_recommended(firm: Comparison) -> None:
    """It drops bar length, mount and force errors, which a few quiet circles cannot show."""
    comparison = with_assumption(firm, log_bayes_factor=-2.0, gain=20.0)
    label = comparison.discrepancy_sensitivity[1].assumption
    renamed = [
        replace(assumed, assumption=WHITE_NOISE) if assumed.assumption == label else assumed
        for assumed in comparison.discrepancy_sensitivity
    ]
    noisy = replace(comparison, discrepancy_sensitivity=tuple(renamed))
    assert comparison.preferred_assumption() is not None
    assert noisy.preferred_assumption() is None


def test_models_that_tie_within_their_errors_are_all_named(compared: Comparison) -> None:
    """Which of them is ahead depends on the tolerance alone."""
    models = (
        Explained(("slopes", "joint load"), 100.0, 0.01, 0.4),
        Explained(("joint load",), 99.985, 0.01, 0.39),
        Explained(("slopes",), 99.4, 0.01, 0.21),
    )
    shares = {"slopes": 0.61, "joint load": 0.79}
    odds = Assumed("averaged", 0.4, 0.02, {"constant": 99.6, "linear": 100.0})
    tied = replace(compared, explanations=Explanations(shares, models, odds, odds))
    text = " ".join(comparison_sentences(tied))
    assert "most probable: slopes and joint load (0.400)" in text
    assert "Equally probable within the numerical error: joint load." in text
    parted = replace(models[1], log_evidence=99.97)
    explanations = replace(tied.explanations, models=(models[0], parted, models[2]))
    text = " ".join(comparison_sentences(replace(tied, explanations=explanations)))
    assert "Equally probable" not in text


def test_sentences_follow_the_order_of_the_models(compared: Comparison) -> None:
    turned = replace(
        compared,
        models=dict(reversed(compared.models.items())),
        sensitivity_of="constant/linear",
        log_bayes_factor={"constant/linear": 5.85},
        log_bayes_factor_error={"constant/linear": 1e-3},
        elpd_difference={},
    )
    assert "in favour of constant" in comparison_sentences(turned)[0]


def test_sentences_name_tests_at_odds(compared: Comparison) -> None:
    name, test = next(iter(compared.tests.items()))
    at_odds = replace(test, lofo_family_wise_p_value=1e-3, flag=False)
    sentences = comparison_sentences(replace(compared, tests={name: at_odds}))
    assert any(sentence.startswith(f"{name} disagree") for sentence in sentences)


def test_sentences_name_outlying_tests(compared: Comparison) -> None:
    name, test = next(iter(compared.tests.items()))
    outlying = replace(test, lofo_family_wise_p_value=1e-3, flag=True, lofo_worst_order=3)
    sentences = comparison_sentences(replace(compared, tests={name: outlying}))
    expected = f"{name} does not belong with the others"
    assert any(expected in sentence and "most in order 3" in sentence for sentence in sentences)


@pytest.mark.parametrize(
    ("value", "words"),
    [(0.4, "bare mention"), (-2.0, "positive"), (4.9, "strong evidence"), (-7.0, "very strong")],
)
def test_strength(value: float, words: str) -> None:
    assert words in strength_words(value)


# Other pairs of models, and what is refused


@pytest.mark.slow
def test_one_force_compares_nuisances_only() -> None:
    """Degree 0 at one force and one test: no slopes, nothing to leave out, and still an answer."""
    model = lb.HybridModel.first(0).without("truncation", "setup-shift")
    comparison = lb.compare(
        {"with form": model, "without": model.without("ball-form")},
        SMALL.select(["f400"]),
        tolerance=0.1,
    )
    assert comparison.slopes == {}
    assert comparison.slope_subsets == ()
    assert comparison.tests == {}
    assert comparison.prior_sensitivity == ()
    assert comparison.local_fits.empty
    assert set(comparison.log_bayes_factor) == {"without/with form"}
    assumptions = {assumed.assumption for assumed in comparison.discrepancy_sensitivity}
    assert WHITE_NOISE not in assumptions, "leaves no difference"
    assert np.isnan(comparison.models["without"].elpd_lofo)
    record = json.loads(json_text(with_words(comparison)))
    assert record["models"]["without"]["elpd_lofo"] is None
    assert np.isnan(Comparison.from_dict(record).models["without"].elpd_lofo)


@pytest.mark.slow
def test_slopes_are_selected_from_the_widest_model() -> None:
    """Whatever the order of the models, and linear whatever their degree."""
    narrow = LINEAR.without("truncation").fixing("C_XXX_1", "C_YYY_1", "C_CXY_1", "C_CYY_1")
    wide = LINEAR.without("truncation").fixing("C_XXX_1", "C_YYY_1", "C_CXY_1")
    quadratic = wide.with_degree(2).fixing("C_XYX_2", "C_CYY_2", "C_CCY_2")
    pairs = [
        {"narrow": narrow, "wide": wide},
        {"wide": wide, "narrow": narrow},
        {"wide": wide, "quadratic": quadratic},
    ]
    for models in pairs:
        assert len(lb.compare(models, SMALL, tolerance=0.1).slope_subsets) == 8


@pytest.mark.parametrize(
    ("models", "message"),
    [
        ({"a": LINEAR}, "models must be at least two, got 1"),
        (
            {"a": LINEAR, "b": lb.HybridModel.paper(0)},
            "must have a proper prior to have an evidence",
        ),
        ({"a": LINEAR, "b": LINEAR}, "models must differ, got 'a' and 'b' alike"),
    ],
)
def test_models_that_are_refused(models: Mapping[str, lb.HybridModel], message: str) -> None:
    refuses(re.escape(message), lb.compare, models, SMALL)


def test_a_plan_is_refused() -> None:
    refuses("must have readings to give an evidence, got a plan", lb.compare, PAIR, SMALL.plan())


def test_a_folder_is_refused() -> None:
    refuses("campaign must be a Campaign, got str", lb.compare, PAIR, "folder")


def test_a_tolerance_out_of_range_is_refused() -> None:
    refuses("tolerance must lie between", lb.compare, PAIR, SMALL, tolerance=0.0)
