"""compare(): its numbers against those of its parts, what it refuses, what it says; comparison.json read back."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from campaigns import plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.analysis import outliers
from ldbb_bayes.analysis.comparison import SLOPE_SCALES, Comparison, SavageDickey, Sign, _crossings
from ldbb_bayes.analysis.sensitivity import WHITE_NOISE, Assumed, discrepancy_assumptions, nuisance_assumptions
from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.nodes import HyperPosterior
from ldbb_bayes.inference.posterior import fit_of
from ldbb_bayes.model.terms import Discrepancy, SetupShift
from ldbb_bayes.report.wording import comparison_sentences, strength_words, with_words
from ldbb_bayes.result import json_text

LINEAR = lb.HybridModel.default(1)
RATIO = "linear/constant"
CENTRED = "set-up shift of order 1 (centre) only"
SMALL = simulated(plan((30, 30, 30), forces_N=(36.0, 400.0, 742.0)), seed=1)
# Two slopes and two scales: quick.
FEW = LINEAR.without("ball-form", "setup-shift").fixing(*(f"{name}_1" for name in ("C_XXX", "C_YYY", "C_CXY", "C_CYY")))
PAIR = {"constant": FEW.with_degree(0), "linear": FEW}
CAMPAIGN = simulated(plan((30,) * 4), seed=1)


@pytest.fixture(scope="module")
def found() -> Comparison:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(outliers, "_REPLICATES", 4000)
        return lb.compare(PAIR, CAMPAIGN, tolerance=0.1)


def test_evidence_and_probabilities(found: Comparison) -> None:
    for name, model in PAIR.items():
        expected = lb.log_evidence(model, CAMPAIGN)
        assert found.models[name].log_evidence == pytest.approx(expected.log_value, abs=5e-3, rel=0.0)
    value = found.log_bayes_factor[RATIO]
    assert value == pytest.approx(found.models["linear"].log_evidence - found.models["constant"].log_evidence)
    assert found.models["linear"].posterior_probability == pytest.approx(1.0 / (1.0 + np.exp(-value)), rel=1e-9)
    assert found.log_bayes_factor_error[RATIO] < 0.02
    assert found.savage_dickey[RATIO].log_bayes_factor == pytest.approx(value, abs=0.01)
    assert found.within_tolerance


def test_sensitivity_is_the_same_comparison_again(found: Comparison) -> None:
    assert [scaled.slope_scale for scaled in found.prior_sensitivity] == list(SLOPE_SCALES)
    by_scale = {scaled.slope_scale: scaled.log_bayes_factor for scaled in found.prior_sensitivity}
    assert by_scale[0.3] == pytest.approx(found.log_bayes_factor[RATIO], abs=1e-6)
    wide = replace(FEW, prior=replace(FEW.prior, slope_scale=3.0))
    centre = FEW.including(SetupShift("centre"))
    plain = FEW.without("bar-length", "mount", "force-error", "discrepancy", "hysteresis", "truncation")
    naive, centred = (found.assumptions[name].log_bayes_factor for name in (WHITE_NOISE, CENTRED))
    for model, value in ((wide, by_scale[3.0]), (centre, centred), (plain, naive)):
        evidences = [lb.log_evidence(own, CAMPAIGN) for own in (model, model.with_degree(0))]
        assert value == pytest.approx(lb.log_bayes_factor(*evidences)[0], abs=0.02)
    assert found.white_noise_overstates_by_nats == pytest.approx(naive - found.log_bayes_factor[RATIO])
    assert "with ball form" in found.assumptions


def test_the_recovered_experiment_is_not_robust(compared: Comparison) -> None:
    """Constant compliance is favoured; that no zero shift is assumed turns it, and the readings do not rule that out."""
    assert compared.log_bayes_factor[RATIO] < -1.0
    changes = {assumed.assumption: compared.gain(assumed) for assumed in compared.turning()}
    assert changes[CENTRED] > -5.0
    assert changes["without set-up shift"] < -1000.0
    assert list(changes.values()) == sorted(changes.values(), reverse=True)
    assert compared.sign is Sign.OPEN
    assert compared.white_noise_overstates_by_nats > 100.0
    text = " ".join(comparison_sentences(compared))
    for words in ("The sign is NOT robust", "do not rule that assumption out", "in favour of constant", "nats away"):
        assert words in text
    assert [f"{compared.models[name].least_squares.rmse_um:.1f}" for name in PAIR] == ["1.1", "0.9"]


def test_leave_one_force_out(found: Comparison) -> None:
    assert list(found.tests) == [test.name for test in CAMPAIGN.tests]
    for name, model in found.models.items():
        densities = np.array([test.lofo_log_density[name] for test in found.tests.values()])
        assert model.elpd_lofo == pytest.approx(densities.sum())
        whole = HyperPosterior(PAIR[name].bind(CAMPAIGN), truncated=True).nodes(0.1)
        others = HyperPosterior(whole.bound.keeping(["f300", "f520", "f742"]), truncated=True).nodes(0.1)
        assert densities[0] == pytest.approx(whole.evidence.log_value - others.evidence.log_value, abs=0.01)
        error = whole.evidence.error + others.evidence.error
        assert found.tests["f036"].lofo_log_density_error[name] == pytest.approx(error, rel=0.2, abs=1e-3)
        assert model.elpd_lofo_se == pytest.approx(np.sqrt(4 * densities.var(ddof=1)))
    differences = np.array([t.lofo_log_density["linear"] - t.lofo_log_density["constant"] for t in found.tests.values()])
    own = found.elpd_difference[RATIO]
    assert (own.value, own.se) == pytest.approx((differences.sum(), np.sqrt(4 * differences.var(ddof=1))))
    trusted = [(t, m, s) for t in found.tests.values() for m, s in t.psis_loo.items() if s.trustworthy and s.pareto_k < 0.6]
    assert trusted
    for test, name, smoothed in trusted:
        assert smoothed.log_density == pytest.approx(test.lofo_log_density[name], abs=0.2)


def test_what_leaving_out_does(found: Comparison) -> None:
    """Means without a test: the campaign properties frozen, so a plain fit of the rest differs, but not by much."""
    change = found.tests["f520"].without_it["constant"]
    rest = PAIR["constant"].bind(CAMPAIGN.without("f520"))
    mean, sd = HyperPosterior(rest, truncated=True).nodes(1e-2).moments()
    for j, (name, own) in enumerate(change.items()):
        assert own.mean == pytest.approx(mean[j], abs=0.1 * sd[j])
        assert own.sd == pytest.approx(sd[j], rel=0.05)
        whole = found.models["constant"].parameters[name]
        assert own.shift == pytest.approx((own.mean - whole.mean) / whole.sd, abs=0.02)


def test_quality_is_that_of_the_models(found: Comparison) -> None:
    for name, model in found.models.items():
        squares = lb.least_squares(CAMPAIGN, model.degree, fixed=PAIR[name].fixed).quality
        assert model.least_squares.rmse_um == squares.rmse_um
        assert set(model.fitness_percent) == set(model.least_squares.fitness_percent) == set(found.tests)
        middle = model.compliance_against_force["C_XXX"]
        assert middle.mean[20] == pytest.approx(model.parameters["C_XXX"].mean, rel=0.02)
    fit = fit_of(lb.sample(PAIR["linear"], CAMPAIGN, sampler="independent", rule=lb.StoppingRule(ess=400.0)))
    assert found.models["linear"].rmse_um == pytest.approx(fit.rmse_um, rel=0.01)
    assert found.models["linear"].fitness_percent == pytest.approx(fit.fitness_percent, abs=0.1)


def test_json_has_the_agreed_names_and_is_read_back(found: Comparison, tmp_path: Path) -> None:
    text = json_text(with_words(found))
    record = json.loads(text)
    assert {"log_evidence", "log_evidence_error", "elpd_lofo", "elpd_lofo_se", "rmse_um"} <= set(record["models"]["linear"])
    assert {"slope_scale", "log_bayes_factor"} <= set(record["prior_sensitivity"][0])
    assert {"assumption", "log_bayes_factor"} <= set(record["discrepancy_sensitivity"][0])
    assert set(record["slopes"]["C_XYX"]) == {"inclusion_probability"}
    assert {"force_N", "mean", "median", "unit", "ci95"} == set(record["compliance_against_force"]["C_XYX"])
    assert list(record["tests"]["f036"]["lofo_p_value_by_order"]) == [str(n) for n in range(13)]
    assert record["verdict"] == " ".join(record["sentences"])
    assert len(record["slope_subsets"]) == 4
    (tmp_path / "comparison.json").write_text(text, encoding="utf-8")
    back = lb.read_comparison(tmp_path)
    assert json_text(with_words(back)) == text
    pd.testing.assert_frame_equal(back.local_fits, found.local_fits, check_dtype=False)
    del record["models"]["linear"]["rmse_um"]
    (tmp_path / "comparison.json").write_text(json.dumps(record), encoding="utf-8")
    with pytest.raises(InputError, match=r"got a damaged one \(ValidationError: models.linear.rmse_um: Field required\)"):
        lb.read_comparison(tmp_path)
    with pytest.raises(InputError, match=r"must be a folder with comparison\.json"):
        lb.read_comparison(tmp_path / "nothing")


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"campaign": 3}', "{" * 20, '{"a": ' * 3000, "\x00"])
def test_damaged(text: str, tmp_path: Path) -> None:
    (tmp_path / "comparison.json").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"comparison.json must be a comparison written by"):
        lb.read_comparison(tmp_path)


def test_shown(compared: Comparison) -> None:
    assert "ln B over constant" in str(compared)
    assert "<table>" in compared._repr_html_()


@pytest.mark.parametrize(
    ("value", "words"), [(0.4, "bare mention"), (-2.0, "positive"), (4.9, "strong evidence"), (-7.0, "very strong")]
)
def test_strength(value: float, words: str) -> None:
    assert words in strength_words(value)


def test_crossings() -> None:
    scale = np.array([0.1, 1.0, 10.0])
    assert _crossings(scale, np.array([1.0, -1.0, -2.0])) == pytest.approx([10**-0.5])
    assert _crossings(scale, np.array([1.0, -1.0, 3.0])) == pytest.approx([10**-0.5, 10**0.25])
    assert _crossings(scale, np.array([-1.0, -2.0, -3.0])) == ()


def test_a_sign_that_holds(compared: Comparison) -> None:
    """Where no assumption turns the sign the verdict says so; where the slope scale does, it says where."""
    same = tuple(Assumed(a.assumption, -6.0, 1e-3, a.log_evidence) for a in compared.nuisances)
    firm = replace(compared, nuisances=same, discrepancy_sensitivity=same)
    assert firm.sign is Sign.FIRM
    rejected = replace(same[1], log_bayes_factor=3.0, log_evidence={n: z - 500.0 for n, z in same[1].log_evidence.items()})
    held = replace(compared, nuisances=(same[0], rejected), discrepancy_sensitivity=same[:1])
    assert held.sign is Sign.HELD
    assert any(sentence.startswith("It turns with") for sentence in comparison_sentences(held))
    crossed = replace(firm, prior_sensitivity_crossings=(0.12,))
    assert crossed.sign is Sign.OPEN
    assert any("changing sign at 0.12" in sentence for sentence in comparison_sentences(crossed))


def test_sentences_follow_the_numbers(compared: Comparison) -> None:
    """The order of the models, tests at odds, a rough second route, different priors."""
    turned = replace(
        compared,
        models=dict(reversed(compared.models.items())),
        sensitivity_of="constant/linear",
        log_bayes_factor={"constant/linear": 5.85},
        log_bayes_factor_error={"constant/linear": 1e-3},
        savage_dickey={"constant/linear": SavageDickey(5.0, 1.5)},
        elpd_difference={},
        differing_priors=("E_XX1", "E_YY1"),
    )
    text = comparison_sentences(turned)
    assert "in favour of constant" in text[0]
    assert any("second route (Savage-Dickey) gives ln B(constant/linear) = +5.00 ± 2" in sentence for sentence in text)
    assert any("from 1.11 (constant) to 0.90 µm (linear), -19 %" in sentence for sentence in text)
    assert text[-1] == "The models give E_XX1 and E_YY1 different priors: the Bayes factor compares these too."
    name, test = next(iter(compared.tests.items()))
    odd = replace(test, lofo_family_wise_p_value=1e-3, flag=False)
    assert any(sentence.startswith(f"{name} disagree") for sentence in comparison_sentences(replace(compared, tests={name: odd})))
    text = comparison_sentences(replace(compared, tests={name: replace(odd, flag=True, lofo_worst_order=3)}))
    assert any(f"{name} does not belong with the others" in sentence and "most in order 3" in sentence for sentence in text)


def test_assumptions_change_one_thing() -> None:
    bare = LINEAR.without("ball-form", "setup-shift")
    labels = set(nuisance_assumptions([bare.with_degree(0), bare], LINEAR.bind(SMALL).setting))
    assert {"with ball form", "with set-up shift", "without mount"} <= labels
    assert not {label for label in labels if "drift" in label or "hysteresis" in label}
    told = [replace(t, direction=("CW", "CCW")[k % 2], time_s=60.0 * k, temperature_C=20.0) for k, t in enumerate(SMALL.tests)]
    labels = set(nuisance_assumptions([LINEAR], LINEAR.bind(replace(SMALL, tests=tuple(told))).setting))
    assert {label for label in labels if "drift" in label or "hysteresis" in label} == {
        "with drift over time",
        "without hysteresis",
    }
    changed = {label: change(LINEAR) for label, change in discrepancy_assumptions([LINEAR.with_degree(0), LINEAR]).items()}
    assert "discrepancy κ/n" not in changed
    assert next(t for t in changed["discrepancy κ/n²"].nuisances if isinstance(t, Discrepancy)).decay == 2.0
    assert changed["set-up shift: own scales for orders 0 and 1"].hypers == ("sigma", "delta_0", "delta_1", "kappa", "tau")
    assert not any(isinstance(t, SetupShift) for t in changed["without set-up shift"].nuisances)
    for model in changed.values():
        assert [type(t) for t in model.nuisances] == [type(t) for t in LINEAR.nuisances if type(t) in map(type, model.nuisances)]


def test_posteriors_bring_their_readings() -> None:
    rule, model = lb.StoppingRule(ess=100.0), PAIR["constant"]
    posterior, other = (lb.sample(model, own, sampler="independent", rule=rule) for own in (SMALL, SMALL.without("f742")))
    with pytest.raises(InputError, match="must be of the same readings to be compared, got 'b'"):
        lb.compare({"a": posterior, "b": other})
    with pytest.raises(InputError, match="must be given a campaign unless all models are posteriors"):
        lb.compare({"a": posterior, "b": LINEAR})


def test_one_force_compares_nuisances_only() -> None:
    """Degree 0 at one force and one test: no slopes, nothing to leave out, and still an answer."""
    model = lb.HybridModel.default(0).without("truncation", "setup-shift")
    found = lb.compare({"with form": model, "without": model.without("ball-form")}, SMALL.select(["f400"]), tolerance=0.1)
    assert (found.slopes, found.slope_subsets, found.slope_subsets_possible, found.tests) == ({}, (), None, {})
    assert found.prior_sensitivity == ()
    assert found.local_fits.empty
    assert set(found.log_bayes_factor) == {"without/with form"}
    assert found.savage_dickey == {}
    assert not {"without ball form", WHITE_NOISE} & {assumed.assumption for assumed in found.nuisances}
    assert np.isnan(found.white_noise_overstates_by_nats)
    assert np.isnan(found.models["without"].elpd_lofo)
    record = json.loads(json_text(with_words(found)))
    assert record["models"]["without"]["elpd_lofo"] is None
    assert np.isnan(Comparison.from_dict(record).models["without"].elpd_lofo)


@pytest.mark.slow
def test_slopes_are_selected_from_the_widest_model() -> None:
    """Whatever the order of the models, the degree that is compared, and without their having to be quadratic."""
    linear = lb.HybridModel.default(1).without("truncation")
    others = tuple(f"{name}_{k}" for name in ("C_XXX", "C_YYY", "C_CXY", "C_CYY", "C_CCY") for k in (1, 2))
    narrow = linear.fixing(*others[::2])
    for pair in ((("narrow", narrow), ("wide", linear)), (("wide", linear), ("narrow", narrow))):
        assert len(lb.compare(dict(pair), SMALL, tolerance=0.1).slope_subsets) == 64
    one = lb.HybridModel.default(2).without("truncation").fixing(*others)
    both = lb.compare({"constant": one.with_degree(0), "linear": one.with_degree(1)}, SMALL, tolerance=0.1)
    assert len(both.slope_subsets) == 2
    quadratic = lb.compare({"constant": one.with_degree(0), "quadratic": one}, SMALL, tolerance=0.1, quadratic=True)
    assert {subset.powers["C_XYX"] for subset in quadratic.slope_subsets} == {0, 1, 2}


def test_an_assumption_that_the_readings_prefer_is_named() -> None:
    """Circles that differ in low orders only: κ/n² then beats κ/n by far, and the verdict says so."""
    rough = lb.HybridModel.default(0).without("truncation", "ball-form")
    steep = replace(rough, nuisances=tuple(Discrepancy(4.0) if isinstance(t, Discrepancy) else t for t in rough.nuisances))
    hyper = {"sigma": 0.1, "delta": 0.3, "kappa": 3.0}
    campaign = steep.simulate(plan((60,) * 5, forces_N=(36.0, 200.0, 400.0, 600.0, 742.0)), seed=4, hyper_um=hyper).campaign
    found = lb.compare({"constant": rough, "linear": rough.with_degree(1)}, campaign, tolerance=0.1, evidence_only=True)
    preferred = found.preferred_assumption()
    assert preferred is not None
    assert preferred.assumption == "discrepancy κ/n²"
    assert "The readings prefer 'discrepancy κ/n²' by" in " ".join(comparison_sentences(found))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda c: lb.compare({"a": LINEAR}, c), "models must be at least two, got 1"),
        (lambda c: lb.compare({"a": LINEAR, "b": lb.HybridModel.paper(0)}, c), "must have a proper prior to have an evidence"),
        (lambda c: lb.compare(PAIR, c.plan()), "must have readings to give an evidence, got a plan"),
        (lambda c: lb.compare(PAIR, c, leave_out="reading"), "leave_out must be 'test', got 'reading': readings of one circle"),
        (lambda c: lb.compare(PAIR, c, leave_out="order"), "leave_out must be 'test', got 'order': every test is left out"),
        (lambda c: lb.compare(PAIR, c, tolerance=0.0), "tolerance must lie between"),
        (lambda c: lb.compare(PAIR, c, ci_prob=1.5), "ci_prob must lie between 0 and 1"),
        (lambda c: lb.compare({"a": LINEAR, "b": LINEAR}, c), "models must differ, got 'a' and 'b' alike"),
        (lambda c: lb.compare([LINEAR], c), "models must be a mapping of names to models, got list"),
        (lambda c: lb.compare(PAIR, "folder"), "campaign must be a Campaign, got str"),
        (lambda c: lb.belonging({}, c), "models must be at least one"),
        (lambda c: lb.belonging({"a": LINEAR}, c, replicates=0), "replicates must be at least 1, got 0"),
        (lambda c: lb.belonging({"a": LINEAR}, c, replicates=50), "replicates must be at least 76 to judge 3 tests, got 50"),
        (lambda c: lb.belonging({"a": LINEAR}, c.select(["f400"])), "at least two tests"),
        (lambda c: lb.local_fits(LINEAR, "folder"), "campaign must be a Campaign, got str"),
    ],
)  # fmt: skip
def test_refused(call: Callable[[lb.Campaign], object], message: str) -> None:
    with pytest.raises(InputError, match=re.escape(message)):
        call(SMALL)
