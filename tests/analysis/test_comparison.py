"""compare(): its numbers against those of its parts, what it refuses and says; local fits; tests
that do not belong."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from campaigns import HYPER_UM, TRUTH, plan, refuses, simulated
from scipy import stats

import ldbb_bayes as lb
from ldbb_bayes.analysis import comparison, outlying_tests, sensitivity
from ldbb_bayes.analysis.comparison import SLOPE_SCALES, Comparison, Sign
from ldbb_bayes.analysis.outlying_tests import FALSE_ALARMS, judge_circle
from ldbb_bayes.analysis.sensitivity import WHITE_NOISE, Assumed
from ldbb_bayes.inference.evidence import Evidences, probabilities
from ldbb_bayes.inference.nodes import HyperPosterior
from ldbb_bayes.inference.posterior import fit_of
from ldbb_bayes.model.terms import Discrepancy, ForceError, Mount, SetupShift
from ldbb_bayes.report.text import parts_of
from ldbb_bayes.report.wording import comparison_sentences, strength_words, with_words
from ldbb_bayes.results import json_text

LINEAR = lb.HybridModel.first(1)
RATIO = "linear/constant"
CENTRED = "set-up shift of order 1 (centre) only"
SMALL = simulated(plan((30, 30, 30), forces_N=(36.0, 400.0, 742.0)), seed=1)
# Two slopes and two scales: quick.
FREE = ("C_XYX", "C_CCY")
FEW = LINEAR.without("ball-form", "setup-shift").fixing(
    *(f"{name}_1" for name in ("C_XXX", "C_YYY", "C_CXY", "C_CYY"))
)
PAIR = {"constant": FEW.with_degree(0), "linear": FEW}
CAMPAIGN = simulated(plan((30,) * 4), seed=1)


@pytest.fixture(scope="module")
def found() -> Comparison:
    steps: list[tuple[int, int]] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(outlying_tests, "_REPLICATES", 4000)
        found = lb.compare(
            PAIR, CAMPAIGN, tolerance=0.02, progress=lambda *step: steps.append(step)
        )
    assert steps == [(k + 1, len(steps)) for k in range(len(steps))], "as many as were counted"
    return found


def test_evidence_and_probabilities(found: Comparison) -> None:
    for name, model in PAIR.items():
        expected = lb.log_evidence(model, CAMPAIGN)
        assert found.models[name].log_evidence == pytest.approx(
            expected.log_value, abs=5e-3, rel=0.0
        )
    value = found.log_bayes_factor[RATIO]
    assert value == pytest.approx(
        found.models["linear"].log_evidence - found.models["constant"].log_evidence
    )
    assert found.models["linear"].posterior_probability == pytest.approx(
        1.0 / (1.0 + np.exp(-value)), rel=1e-9
    )
    assert found.log_bayes_factor_error[RATIO] < 0.03
    assert found.within_tolerance


def test_sensitivity_is_the_same_comparison_again(found: Comparison) -> None:
    assert [scaled.slope_scale for scaled in found.prior_sensitivity] == list(SLOPE_SCALES)
    by_scale = {scaled.slope_scale: scaled.log_bayes_factor for scaled in found.prior_sensitivity}
    assert by_scale[0.3] == pytest.approx(found.log_bayes_factor[RATIO], abs=1e-6)
    wide = replace(FEW, prior=replace(FEW.prior, slope_scale=3.0))
    centre = FEW.with_term(SetupShift("centre"))
    plain = FEW.without(
        "bar-length", "mount", "force-error", "discrepancy", "hysteresis", "truncation"
    )
    assumed = {a.assumption: a.log_bayes_factor for a in found.discrepancy_sensitivity}
    assert next(iter(assumed)) == "as in the model"
    naive = assumed[WHITE_NOISE]
    centred = assumed[CENTRED]
    for model, value in ((wide, by_scale[3.0]), (centre, centred), (plain, naive)):
        evidences = [lb.log_evidence(own, CAMPAIGN) for own in (model, model.with_degree(0))]
        assert value == pytest.approx(lb.log_bayes_factor(*evidences)[0], abs=0.02)


def test_rejected_assumptions_are_weighed_roughly(recovered: lb.Campaign) -> None:
    """Within an error of their own, which no exit code hangs on, and which is shown; others as
    exactly as asked."""
    model = lb.HybridModel.first(1).without("ball-form", "truncation")
    found = lb.compare(
        {"constant": model.with_degree(0), "linear": model},
        recovered,
        evidence_only=True,
        tolerance=1e-3,
    )
    by_name = {assumed.assumption: assumed for assumed in found.discrepancy_sensitivity}
    rough = by_name["without set-up shift"]
    assert 2e-3 < rough.log_bayes_factor_error < 0.2
    exact = [
        lb.log_evidence(model.without("setup-shift").with_degree(k), recovered) for k in (1, 0)
    ]
    assert (
        abs(rough.log_bayes_factor - lb.log_bayes_factor(*exact)[0]) < rough.log_bayes_factor_error
    )
    assert f"'{rough.log_bayes_factor:+.2f}', '{rough.log_bayes_factor_error:.1g}'" in str(
        parts_of(found)[1]
    )
    assert found.largest_error < 1e-3 > by_name[CENTRED].log_bayes_factor_error


def test_the_recovered_experiment_is_not_robust(compared: Comparison) -> None:
    """Constant compliance is favoured; that no zero shift is assumed turns it, and the readings do
    not rule that out."""
    assert compared.log_bayes_factor[RATIO] < -1.0
    changes = {assumed.assumption: compared.gain(assumed) for assumed in compared.turning()}
    assert changes[CENTRED] > -5.0
    assert changes["without set-up shift"] < -1000.0
    assert list(changes.values()) == sorted(changes.values(), reverse=True)
    assert compared.sign is Sign.OPEN
    text = " ".join(comparison_sentences(compared))
    assert re.search(
        r"very strong evidence, in favour of constant.*The sign is NOT robust.*the readings do not"
        r" rule out",
        text,
    )
    assert [f"{compared.models[name].least_squares_rmse_um:.1f}" for name in PAIR] == ["1.1", "0.9"]


def test_leave_one_force_out(found: Comparison) -> None:
    assert list(found.tests) == [test.name for test in CAMPAIGN.tests]
    for name, model in found.models.items():
        densities = np.array([test.lofo_log_density[name] for test in found.tests.values()])
        assert model.elpd_lofo == pytest.approx(densities.sum())
        whole = HyperPosterior(PAIR[name].bind(CAMPAIGN), truncated=True).nodes(0.1)
        others = HyperPosterior(
            whole.bound.keeping(["f300", "f520", "f742"]), truncated=True
        ).nodes(0.1)
        assert densities[0] == pytest.approx(
            whole.evidence.log_value - others.evidence.log_value, abs=0.01
        )
        assert model.elpd_lofo_se == pytest.approx(np.sqrt(4 * densities.var(ddof=1)))
    differences = np.array(
        [
            t.lofo_log_density["linear"] - t.lofo_log_density["constant"]
            for t in found.tests.values()
        ]
    )
    own = found.elpd_difference[RATIO]
    assert (own.value, own.se) == pytest.approx(
        (differences.sum(), np.sqrt(4 * differences.var(ddof=1)))
    )


def test_quality_is_that_of_the_models(found: Comparison) -> None:
    for name, model in found.models.items():
        assert (
            model.least_squares_rmse_um
            == lb.least_squares(CAMPAIGN, model.degree, fixed=PAIR[name].fixed).quality.rmse_um
        )
        middle = model.compliance_against_force["C_XXX"].mean[20]
        assert middle == pytest.approx(model.parameters["C_XXX"].mean, rel=0.02)
    fit = fit_of(
        lb.sample(PAIR["linear"], CAMPAIGN, sampler="independent", rule=lb.StoppingRule(ess=400.0))
    )
    assert found.models["linear"].rmse_um == pytest.approx(fit.rmse_um, rel=0.01)


def test_json_has_the_agreed_names_and_is_read_back(found: Comparison, tmp_path: Path) -> None:
    text = json_text(with_words(found))
    record = json.loads(text)
    assert {"log_evidence", "log_evidence_error", "elpd_lofo", "elpd_lofo_se", "rmse_um"} <= set(
        record["models"]["linear"]
    )
    assert {"slope_scale", "log_bayes_factor"} <= set(record["prior_sensitivity"][0])
    assert {"assumption", "log_bayes_factor"} <= set(record["discrepancy_sensitivity"][0])
    assert set(record["slopes"]["C_XYX"]) == {"inclusion_probability"}
    assert {"unit", "force_N", "mean", "median", "low", "high", "ci_prob"} == set(
        record["compliance_against_force"]["C_XYX"]
    )
    assert list(record["tests"]["f036"]["lofo_p_value_by_order"]) == [str(n) for n in range(13)]
    assert record["verdict"] == " ".join(record["sentences"])
    assert "explanations" not in record, "no rivals of slopes in the first edition"
    assert len(record["slope_subsets"]) == 4
    (tmp_path / "comparison.json").write_text(text, encoding="utf-8")
    back = lb.read_comparison(tmp_path)
    assert json_text(with_words(back)) == text
    assert "Models at equal prior odds" in str(back)
    assert "<table>" in back._repr_html_()
    pd.testing.assert_frame_equal(found.local_fits, back.local_fits, check_dtype=False)
    record["largest_error"] = record["models"]["linear"]["log_evidence_error"] = record[
        "prior_sensitivity"
    ][0]["error"] = None
    (tmp_path / "comparison.json").write_text(json.dumps(record), encoding="utf-8")
    assert lb.read_comparison(tmp_path).largest_error == np.inf
    del record["models"]["linear"]["rmse_um"]
    (tmp_path / "comparison.json").write_text(json.dumps(record), encoding="utf-8")
    refuses(
        r"got a damaged one \(ValidationError: models.linear.rmse_um: Field required\)",
        lb.read_comparison,
        tmp_path,
    )
    refuses(r"must be a folder with comparison\.json", lb.read_comparison, tmp_path / "nothing")


def test_crossings() -> None:
    scale = np.array([0.1, 1.0, 10.0])
    assert comparison.interpolate_crossings(scale, np.array([1.0, -1.0, -2.0])) == pytest.approx(
        [10**-0.5]
    )
    assert comparison.interpolate_crossings(scale, np.array([1.0, -1.0, 3.0])) == pytest.approx(
        [10**-0.5, 10**0.25]
    )
    assert comparison.interpolate_crossings(scale, np.array([-1.0, -2.0, -3.0])) == ()


def test_the_sign_and_what_the_readings_prefer(compared: Comparison) -> None:
    """Where no assumption turns the sign the verdict says so; where the slope scale does, it says
    where."""
    same = tuple(
        Assumed(a.assumption, -6.0, 1e-3, a.log_evidence) for a in compared.discrepancy_sensitivity
    )
    firm = replace(compared, discrepancy_sensitivity=same)
    assert firm.sign is Sign.FIRM
    assert firm.preferred_assumption() is None
    rejected, better = (
        replace(
            same[1],
            log_bayes_factor=value,
            log_evidence={n: z + gain for n, z in same[0].log_evidence.items()},
        )
        for value, gain in ((3.0, -500.0), (-2.0, 20.0))
    )
    held = replace(compared, discrepancy_sensitivity=(same[0], rejected))
    assert held.sign is Sign.HELD
    assert any(
        sentence.startswith("The answer changes with") for sentence in comparison_sentences(held)
    )
    crossed = replace(firm, prior_sensitivity_crossings=(0.12,))
    assert crossed.sign is Sign.OPEN
    assert any("changing sign at 0.12" in sentence for sentence in comparison_sentences(crossed))
    preferred = replace(compared, discrepancy_sensitivity=(same[0], better))
    assert preferred.preferred_assumption() == better
    assert f"The readings prefer '{better.assumption}' by 20.0 nats" in " ".join(
        comparison_sentences(preferred)
    )


def test_sentences_follow_the_numbers(compared: Comparison) -> None:
    """The order of the models, and tests at odds."""
    turned = replace(
        compared,
        models=dict(reversed(compared.models.items())),
        sensitivity_of="constant/linear",
        log_bayes_factor={"constant/linear": 5.85},
        log_bayes_factor_error={"constant/linear": 1e-3},
        elpd_difference={},
    )
    text = comparison_sentences(turned)
    assert "in favour of constant" in text[0]
    name, test = next(iter(compared.tests.items()))
    odd = replace(test, lofo_family_wise_p_value=1e-3, flag=False)
    assert any(
        sentence.startswith(f"{name} disagree")
        for sentence in comparison_sentences(replace(compared, tests={name: odd}))
    )
    text = comparison_sentences(
        replace(compared, tests={name: replace(odd, flag=True, lofo_worst_order=3)})
    )
    assert any(
        f"{name} does not belong with the others" in sentence and "most in order 3" in sentence
        for sentence in text
    )


def test_assumptions_change_one_thing() -> None:
    changed = {
        k: change(LINEAR)
        for k, change in sensitivity.discrepancy_assumptions(
            [LINEAR.with_degree(0), LINEAR]
        ).items()
    }
    assert "discrepancy κ/n" not in changed
    assert (
        next(t for t in changed["discrepancy κ/n²"].nuisances if isinstance(t, Discrepancy)).decay
        == 2.0
    )
    own = changed["set-up shift: own scales for orders 0 and 1"].scales
    assert [scale.name for scale in own] == ["sigma", "delta_0", "delta_1", "kappa", "tau"]
    assert not any(isinstance(t, SetupShift) for t in changed["without set-up shift"].nuisances)
    plain = changed.pop(WHITE_NOISE)
    assert (plain.nuisances, plain.prior.truncated) == ((), False)
    for model in changed.values():
        assert [type(t) for t in model.nuisances] == [
            type(t) for t in LINEAR.nuisances if type(t) in map(type, model.nuisances)
        ]


def test_one_force_compares_nuisances_only() -> None:
    """Degree 0 at one force and one test: no slopes, nothing to leave out, and still an answer."""
    model = lb.HybridModel.first(0).without("truncation", "setup-shift")
    found = lb.compare(
        {"with form": model, "without": model.without("ball-form")},
        SMALL.select(["f400"]),
        tolerance=0.1,
    )
    assert (found.slopes, found.slope_subsets, found.tests) == ({}, (), {})
    assert found.prior_sensitivity == ()
    assert found.local_fits.empty
    assert set(found.log_bayes_factor) == {"without/with form"}
    assert WHITE_NOISE not in {assumed.assumption for assumed in found.discrepancy_sensitivity}, (
        "leaves no difference"
    )
    assert np.isnan(found.models["without"].elpd_lofo)
    record = json.loads(json_text(with_words(found)))
    assert record["models"]["without"]["elpd_lofo"] is None
    assert np.isnan(Comparison.from_dict(record).models["without"].elpd_lofo)


@pytest.mark.slow
def test_slopes_are_selected_from_the_widest_model() -> None:
    """Whatever the order of the models, and linear whatever their degree."""
    narrow = LINEAR.without("truncation").fixing("C_XXX_1", "C_YYY_1", "C_CXY_1", "C_CYY_1")
    wide = LINEAR.without("truncation").fixing("C_XXX_1", "C_YYY_1", "C_CXY_1")
    for pair in ((("narrow", narrow), ("wide", wide)), (("wide", wide), ("narrow", narrow))):
        assert len(lb.compare(dict(pair), SMALL, tolerance=0.1).slope_subsets) == 8
    quadratic = wide.with_degree(2).fixing("C_XYX_2", "C_CYY_2", "C_CCY_2")
    assert (
        len(lb.compare({"wide": wide, "quadratic": quadratic}, SMALL, tolerance=0.1).slope_subsets)
        == 8
    )


# Explanations of a change with force


@pytest.mark.parametrize("whole", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_every_combination_of_explanations_is_a_model(whole: bool, recovered: lb.Campaign) -> None:
    """Every one of 16 evidences against nodes of its own, and what is worked out from them."""
    model = lb.HybridModel.default(1)
    campaign = recovered if whole else CAMPAIGN
    model = model if whole else model.without("circle-scale", "ball-form", "setup-shift")
    pair = {"constant": model.with_degree(0), "linear": model}
    found = sensitivity.explanations(pair, Evidences(campaign, tolerance=1e-2))
    own = {of.by: model.with_rivals(*of.by).with_degree("slopes" in of.by) for of in found.models}
    value = {
        by: lb.log_evidence(alone, campaign, tolerance=1e-2).log_value for by, alone in own.items()
    }
    assert len({(alone.degree, alone.rivals) for alone in own.values()}) == 16
    np.testing.assert_allclose(
        [of.log_evidence - value[of.by] for of in found.models], 0.0, atol=1e-2
    )
    share = dict(zip(value, probabilities(np.array([*value.values()])), strict=True))
    for name, probability in found.inclusion_probability.items():
        assert probability == pytest.approx(
            sum(p for by, p in share.items() if name in by), abs=5e-3
        )
    slopes = found.inclusion_probability["slopes"]
    assert found.averaged.log_bayes_factor == pytest.approx(np.log(slopes / (1.0 - slopes)))
    assert found.alone.log_evidence == pytest.approx(
        {"constant": value[()], "linear": value["slopes",]}, abs=1e-2, rel=0.0
    )
    assert found.alone.log_bayes_factor_error <= found.averaged.log_bayes_factor_error < 0.02


def test_a_curve_in_the_force_axis_explains_the_experiment_better_than_slopes(
    recovered: lb.Campaign,
) -> None:
    """First edition's priors, zero kept: slopes, or one curvature, against none."""
    curved = (Mount(curvature_um=0.5), ForceError(curvature_sd=0.01), SetupShift("centre"))
    model = lb.HybridModel.first(1).without("truncation").with_term(*curved)
    whole = lb.compare(
        {"constant": model.with_degree(0), "linear": model}, recovered, evidence_only=True
    )
    found = whole.explanations
    assert found is not None
    value = {own.by: own.log_evidence for own in found.models}
    gain = [value[name,] - value[()] for name in ("slopes", "curved mount", "curved force law")]
    assert gain == pytest.approx([5.79, 10.61, 9.06], abs=0.05)
    assert (
        found.alone.log_bayes_factor
        > 5.0
        > -4.0
        > whole.headline[0]
        == found.averaged.log_bayes_factor
    )
    assert found.instead == ("curved mount", "curved force law")
    assert whole.sign is Sign.HELD
    text = " ".join(comparison_sentences(whole))
    assert (
        "over curved mount and curved force law, each in the model or not; +5.79 (error 0.01) with"
        " none of them: strong" in text
    )
    assert (
        "Slopes are not needed: curved mount and curved force law explain the readings as well."
        in text
    )
    assert Comparison.from_dict(json.loads(json_text(with_words(whole)))).explanations == found


# Subsets of slopes


def without_slopes(*names: str) -> lb.HybridModel:
    return FEW.fixing(*(f"{name}_1" for name in names))


def test_probabilities_of_subsets_are_those_of_their_evidences(found: Comparison) -> None:
    subsets = {subset.varying: subset for subset in found.slope_subsets}
    assert set(subsets) == {(), FREE[:1], FREE[1:], FREE}
    by_hand = [
        lb.log_evidence(without_slopes(*(set(FREE) - set(own))), CAMPAIGN, tolerance=5e-3).log_value
        for own in subsets
    ]
    np.testing.assert_allclose(
        [subset.log_evidence for subset in subsets.values()], by_hand, atol=0.02
    )
    share = [subset.probability for subset in subsets.values()]
    np.testing.assert_allclose(share, probabilities(np.array(by_hand)), atol=5e-3)
    assert share == sorted(share, reverse=True)
    for name in FREE:
        total = sum(subset.probability for own, subset in subsets.items() if name in own)
        assert found.slopes[name].inclusion_probability == pytest.approx(total)


def test_averaged_compliance(found: Comparison) -> None:
    """E[C(F)] = Σ P(subset) E[C(F) | subset]; a compliance without a slope has a flat band."""
    curve = found.compliance_against_force["C_XYX"]
    means = np.zeros(2)
    for subset in found.slope_subsets:
        bound = without_slopes(*(set(FREE) - set(subset.varying))).bind(CAMPAIGN)
        mean = dict(
            zip(
                bound.names,
                HyperPosterior(bound, truncated=True).nodes(1e-2).moments()[0],
                strict=True,
            )
        )
        means += subset.probability * (
            mean["C_XYX"] + mean.get("C_XYX_1", 0.0) * np.array([-353.0, 353.0])
        )
    sd = (curve.high - curve.low)[[0, -1]] / 4.0
    np.testing.assert_allclose(curve.mean[[0, -1]] / sd, means / sd, atol=0.08)
    assert np.all((curve.low < curve.mean) & (curve.mean < curve.high))
    assert np.ptp(found.compliance_against_force["C_XXX"].mean) == pytest.approx(0.0, abs=1e-18)


@pytest.mark.parametrize("slopes", [4, 15])
def test_too_many_subsets_are_searched_from_the_best(slopes: int) -> None:
    """Compliances of known, independent evidence: all sets of 4, and 100 of 32768, which hold the
    best and most probability."""
    gain = np.array(
        [3.0, -4.0, 2.5, -3.0, -5.0, 1.5, -2.0, -6.0, -3.5, -4.5, -2.5, -3.0, 4.0, -5.5, -4.0]
    )[:slopes]

    def of(there: tuple[bool, ...]) -> SimpleNamespace:
        return SimpleNamespace(evidence=SimpleNamespace(log_value=float(gain @ np.array(there))))

    found = sensitivity._best_first(slopes, of)  # type: ignore[arg-type]
    assert len(found) == min(2**slopes, 100)
    assert max(found, key=lambda there: found[there].evidence.log_value) == tuple(gain > 0)
    log_value = np.array([one.evidence.log_value for one in found.values()])
    assert np.exp(log_value - np.log1p(np.exp(gain)).sum()).sum() > 0.8
    inclusion = probabilities(log_value) @ np.array(list(found))
    np.testing.assert_allclose(inclusion, 1.0 / (1.0 + np.exp(-gain)), atol=0.05)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda c: lb.compare({"a": LINEAR}, c), "models must be at least two, got 1"),
        (
            lambda c: lb.compare({"a": LINEAR, "b": lb.HybridModel.paper(0)}, c),
            "must have a proper prior to have an evidence",
        ),
        (
            lambda c: lb.compare(PAIR, c.plan()),
            "must have readings to give an evidence, got a plan",
        ),
        (lambda c: lb.compare(PAIR, c, tolerance=0.0), "tolerance must lie between"),
        (
            lambda c: lb.compare({"a": LINEAR, "b": LINEAR}, c),
            "models must differ, got 'a' and 'b' alike",
        ),
        (lambda c: lb.compare(PAIR, "folder"), "campaign must be a Campaign, got str"),
        (
            lambda c: lb.belonging({"a": LINEAR}, c, replicates=50),
            "replicates must be at least 76 to judge 3 tests, got 50",
        ),
        (lambda c: lb.belonging({"a": LINEAR}, c.select(["f400"])), "at least two tests"),
        (
            lambda c: lb.local_fits(LINEAR, c.select(["f400"])),
            "local fits must have at least two force levels, got one",
        ),
        (lambda c: lb.local_fits(lb.HybridModel.paper(0), c), "must have a proper prior"),
    ],
)
def test_refused(call: Callable[[lb.Campaign], object], message: str) -> None:
    refuses(re.escape(message), call, SMALL)


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
]


def test_a_window_is_a_campaign_of_its_own(recovered: lb.Campaign) -> None:
    """Without truncation and force error: `marginals` and `least_squares` say the same, and fix
    what the model fixes."""
    model = lb.HybridModel.first(0).without("truncation", "force-error").fixing("C_CCY")
    some = recovered.select(["f036", "f238", "f364"])
    local = lb.local_fits(model, some)
    assert list(local.columns) == [*COLUMNS, "mean", "sd", "ci_low", "ci_high"]
    assert "C_CCY" not in set(local["parameter"])
    own = local[local["force_low_N"] == 238.0].set_index("parameter")
    window = recovered.select(["f238", "f364"])
    expected = lb.marginals(model, window).loc[own.index]
    np.testing.assert_allclose(
        own["mean"] / expected["sd"], expected["mean"] / expected["sd"], atol=0.02
    )
    np.testing.assert_allclose(own["sd"], expected["sd"], rtol=0.02)
    np.testing.assert_allclose(
        (own["ci_high"] - own["ci_low"]) / (expected["ci_high"] - expected["ci_low"]),
        1.0,
        atol=0.05,
    )
    squares = lb.least_squares(window, fixed=("C_CCY",)).table
    np.testing.assert_allclose(
        own[["least_squares", "least_squares_u"]], squares[["estimate", "u"]], rtol=1e-9
    )


def test_pairs_of_force_levels() -> None:
    planned = plan((30,) * 5, forces_N=(400.0, 36.0, 400.0, 742.0, 200.0))
    assert sensitivity._pairs(planned) == [
        ("f036", "f200"),
        ("f200", "f400", "f400_2"),
        ("f400", "f400_2", "f742"),
    ]


def test_windows_that_lack_a_set_up_or_a_plane() -> None:
    """Low forces in one set-up, high ones in another; then in another plane: each window keeps the
    campaign's parameters."""
    model = lb.HybridModel.first(0).without("truncation", "ball-form", "discrepancy")
    for further in ({"setup": 2}, {"plane": "YZ", "setup": 2}):
        planned = plan((40,) * 4, forces_N=(50.0, 300.0, 500.0, 700.0))
        tests = (*planned.tests[:2], *(replace(test, **further) for test in planned.tests[2:]))
        campaign = model.simulate(replace(planned, tests=tests), seed=3).campaign
        table = lb.local_fits(model, campaign)
        assert set(table["parameter"]) == set(model.bind(campaign).names)
        assert np.isfinite(table["mean"]).all()


# Tests that do not belong: p-values that are exact, an outlier found without its neighbours, Holm's
# method

CONSTANT = lb.HybridModel.first(0).without("truncation")
MODELS = {"constant": CONSTANT, "linear": CONSTANT.with_degree(1)}
FORCES_N = (36.0, 200.0, 400.0, 600.0, 742.0)


def campaign(seed: int, odd: str | None = None, harmonics: int = 3) -> lb.Campaign:
    """A campaign without slopes; the odd test has 8 κ more in every harmonic up to an order."""
    planned = plan((36,) * 5, forces_N=FORCES_N)
    made = CONSTANT.simulate(planned, seed=seed, parameters=TRUTH, hyper_um=HYPER_UM).campaign
    tests = []
    for test in made.tests:
        angle = test.angles_rad()
        shape = 1.0 + sum(np.cos(n * angle) + np.sin(n * angle) for n in range(1, harmonics + 1))
        offset = 8.0 * HYPER_UM["kappa"] * shape if test.name == odd else 0.0
        tests.append(test.with_reading_um(np.asarray(test.reading_um) + offset))
    return replace(made, tests=tuple(tests))


def test_an_outlier_is_flagged_alone() -> None:
    odd = "f400"
    found = lb.belonging(MODELS, campaign(4, odd), seed=1, tolerance=0.1, replicates=4000)
    assert list(found.index[found["flag"]]) == [odd]
    assert found.loc[odd, "family_wise_p_value"] < FALSE_ALARMS
    orders = found.loc[odd, [f"order_{n}" for n in range(13)]].astype(float)
    assert orders[["order_2", "order_3"]].max() < 1e-3
    assert orders[[f"order_{n}" for n in range(5, 13)]].min() > 1e-3


def test_a_clean_campaign_is_not() -> None:
    found = lb.belonging(MODELS, campaign(5), seed=1, tolerance=0.1, replicates=4000)
    assert not found["flag"].any()
    assert list(found.columns[:4]) == ["force_N", "p_value", "family_wise_p_value", "flag"]
    assert found["family_wise_p_value"].ge(found["p_value"]).all()


def test_p_values_of_what_the_replicates_are_made_of(rng: np.random.Generator) -> None:
    """Uniform, by order and as a whole, for any covariance; −∞ never comes out."""
    root = np.tril(rng.normal(size=(25, 25))) + 3.0 * np.eye(25)
    replicates = rng.standard_normal((1500, 25)) @ root.T + 1.0
    seen = [judge_circle(rng.standard_normal(25) @ root.T + 1.0, replicates) for _ in range(300)]
    assert stats.kstest([one.p_value for one in seen], "uniform").pvalue > 1e-3
    assert stats.kstest([one.order_p_values[3] for one in seen], "uniform").pvalue > 1e-3
    far = judge_circle(np.full(25, 1e3), replicates)
    assert far.p_value == pytest.approx(1.0 / 1501.0)
    assert np.isfinite(far.distance)
    assert far.distance > max(one.distance for one in seen)
    odd = np.zeros(25)
    odd[3], odd[9] = 20.0, 200.0
    assert judge_circle(odd, rng.standard_normal((1500, 25))).worst_order == 5, (
        "the farthest of those beyond all replicates"
    )


def test_two_that_disagree_are_not_flagged() -> None:
    """Nothing says which of two is wrong; with three the odd one is found."""
    made = campaign(4).select(["f200", "f400", "f742"])
    odd = made.tests[1]
    spoilt = [
        made.tests[0],
        odd.with_reading_um(odd.reading_um + 20.0 * np.cos(5.0 * odd.angles_rad())),
    ]
    two = lb.belonging(
        MODELS, replace(made, tests=tuple(spoilt)), seed=1, tolerance=0.1, replicates=2000
    )
    assert two["family_wise_p_value"].max() < FALSE_ALARMS
    assert not two["flag"].any()
    three = lb.belonging(
        MODELS,
        replace(made, tests=(*spoilt, made.tests[2])),
        seed=1,
        tolerance=0.1,
        replicates=2000,
    )
    assert list(three.index[three["flag"]]) == ["f400"]


@pytest.mark.parametrize(
    ("value", "words"),
    [(0.4, "bare mention"), (-2.0, "positive"), (4.9, "strong evidence"), (-7.0, "very strong")],
)
def test_strength(value: float, words: str) -> None:
    assert words in strength_words(value)


def test_a_slope_that_is_there_is_found() -> None:
    model = LINEAR.without("truncation").fixing(*FEW.fixed)
    truth = TRUTH | {"C_XYX_1": 1.5e-8}
    campaign = LINEAR.simulate(plan(), seed=3, parameters=truth, hyper_um=HYPER_UM).campaign
    slopes, *_ = sensitivity.slope_subsets(model, Evidences(campaign, tolerance=1e-2), seed=1)
    assert slopes["C_XYX"].inclusion_probability > 0.95 > slopes["C_CCY"].inclusion_probability
