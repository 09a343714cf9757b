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
from ldbb_bayes.analysis.comparison import (
    SLOPE_SCALES,
    WHITE_NOISE,
    Assumed,
    Comparison,
    SavageDickey,
    Sign,
    _crossings,
    _discrepancy_assumptions,
    _nuisance_assumptions,
)
from ldbb_bayes.errors import InputError
from ldbb_bayes.model.terms import Discrepancy, SetupShift
from ldbb_bayes.report.wording import comparison_sentences, strength_words, with_words
from ldbb_bayes.table import json_text

LINEAR = lb.HybridModel.default(1)
PAIR = {"constant": LINEAR.with_degree(0), "linear": LINEAR}
RATIO = "linear/constant"
SMALL = simulated(plan((30, 30, 30), forces_N=(36.0, 400.0, 742.0)), seed=1)


@pytest.fixture(scope="module")
def found(compared: Comparison) -> Comparison:
    return compared


def test_evidence_and_probabilities(found: Comparison, recovered: lb.Campaign) -> None:
    for name, model in PAIR.items():
        expected = lb.log_evidence(model, recovered)
        assert found.models[name].log_evidence == pytest.approx(expected.log_value, abs=5e-3, rel=0.0)
    value = found.log_bayes_factor[RATIO]
    assert found.models["linear"].posterior_probability == pytest.approx(1.0 / (1.0 + np.exp(-value)), rel=1e-9)
    assert found.log_bayes_factor_error[RATIO] < 0.02
    assert found.savage_dickey[RATIO].log_bayes_factor == pytest.approx(value, abs=0.05)
    assert found.within_tolerance


def test_sensitivity_is_the_same_comparison_again(found: Comparison, recovered: lb.Campaign) -> None:
    assert [scaled.slope_scale for scaled in found.prior_sensitivity] == list(SLOPE_SCALES)
    by_scale = {scaled.slope_scale: scaled.log_bayes_factor for scaled in found.prior_sensitivity}
    assert by_scale[0.3] == pytest.approx(found.log_bayes_factor[RATIO], abs=1e-6)
    wide = replace(LINEAR, prior=replace(LINEAR.prior, slope_scale=3.0))
    centre = replace(LINEAR, nuisances=tuple(SetupShift("centre") if isinstance(t, SetupShift) else t for t in LINEAR.nuisances))
    plain = LINEAR.without("ball-form", "bar-length", "mount", "force-error", "setup-shift", "discrepancy", "truncation")
    naive = found.assumptions[WHITE_NOISE].log_bayes_factor
    centred = found.assumptions["set-up shift of order 1 (centre) only"].log_bayes_factor
    for model, value in ((wide, by_scale[3.0]), (centre, centred), (plain, naive)):
        evidences = [lb.log_evidence(own, recovered) for own in (model, model.with_degree(0))]
        assert value == pytest.approx(lb.log_bayes_factor(*evidences)[0], abs=0.02)
    assert found.white_noise_overstates_by_nats == pytest.approx(naive - found.log_bayes_factor[RATIO])


def test_the_recovered_experiment_is_not_robust(found: Comparison) -> None:
    """Constant compliance is favoured; that no zero shift is assumed turns it, and the readings do not rule that out."""
    assert found.log_bayes_factor[RATIO] < -1.0
    changes = {assumed.assumption: found.gain(assumed) for assumed in found.turning()}
    assert changes["set-up shift of order 1 (centre) only"] > -5.0
    assert changes["without set-up shift"] < -1000.0
    assert list(changes.values()) == sorted(changes.values(), reverse=True)
    assert found.sign is Sign.OPEN
    assert found.white_noise_overstates_by_nats > 100.0
    text = " ".join(comparison_sentences(found))
    for words in ("The sign is NOT robust", "do not rule that assumption out", "in favour of constant", "nats away"):
        assert words in text


def test_leave_one_force_out(found: Comparison, recovered: lb.Campaign) -> None:
    for name, model in found.models.items():
        densities = np.array([test.lofo_log_density[name] for test in found.tests.values()])
        assert model.elpd_lofo == pytest.approx(densities.sum())
        assert model.elpd_lofo_se == pytest.approx(np.sqrt(len(densities) * densities.var(ddof=1)))
    differences = np.array([t.lofo_log_density["linear"] - t.lofo_log_density["constant"] for t in found.tests.values()])
    own = found.elpd_difference[RATIO]
    assert (own.value, own.se) == pytest.approx((differences.sum(), np.sqrt(6 * differences.var(ddof=1))))
    for test in found.tests.values():
        for model, smoothed in test.psis_loo.items():
            if smoothed.pareto_k < 0.6:
                assert smoothed.log_density == pytest.approx(test.lofo_log_density[model], abs=0.3)
    assert list(found.tests) == [test.name for test in recovered.tests]


def test_what_leaving_out_does(found: Comparison, recovered: lb.Campaign) -> None:
    """Means without a test: the campaign properties frozen, so a plain fit of the rest differs, but not by much."""
    change = found.tests["f490"].without_it["constant"]
    expected = lb.marginals(PAIR["constant"], recovered.without("f490"))
    for name, own in change.items():
        assert own.mean == pytest.approx(expected.loc[name, "mean"], abs=0.1 * expected.loc[name, "sd"])
        assert own.sd == pytest.approx(expected.loc[name, "sd"], rel=0.05)
        whole = found.models["constant"].parameters[name]
        assert own.shift == pytest.approx((own.mean - whole.mean) / whole.sd, abs=0.02)


def test_rmse_is_equation_34(found: Comparison) -> None:
    assert f"{found.models['constant'].least_squares.rmse_um:.1f}" == "1.1"
    assert f"{found.models['linear'].least_squares.rmse_um:.1f}" == "0.9"
    assert set(found.models["linear"].least_squares.fitness_percent) == set(found.tests)
    assert 0.0 < found.models["linear"].rmse_um < found.models["constant"].rmse_um


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
    assert len(record["slope_subsets"]) == 64
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


def test_shown(found: Comparison) -> None:
    assert "ln B over constant" in str(found)
    assert "<table>" in found._repr_html_()


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


def test_a_sign_that_holds(found: Comparison) -> None:
    """Where no assumption turns the sign the verdict says so; where the slope scale does, it says where."""
    same = tuple(Assumed(a.assumption, -6.0, 1e-3, a.log_evidence) for a in found.nuisances)
    firm = replace(found, nuisances=same, discrepancy_sensitivity=same)
    assert firm.sign is Sign.FIRM
    rejected = replace(same[1], log_bayes_factor=3.0, log_evidence={n: z - 500.0 for n, z in same[1].log_evidence.items()})
    held = replace(found, nuisances=(same[0], rejected), discrepancy_sensitivity=same[:1])
    assert held.sign is Sign.HELD
    assert any(sentence.startswith("It turns with") for sentence in comparison_sentences(held))
    crossed = replace(firm, prior_sensitivity_crossings=(0.12,))
    assert crossed.sign is Sign.OPEN
    assert any("changing sign at 0.12" in sentence for sentence in comparison_sentences(crossed))


def test_sentences_follow_the_numbers(found: Comparison) -> None:
    """The order of the models, tests at odds, a rough second route, different priors."""
    turned = replace(
        found,
        models=dict(reversed(found.models.items())),
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
    name, test = next(iter(found.tests.items()))
    odd = replace(test, lofo_family_wise_p_value=1e-3, flag=False)
    assert any(sentence.startswith(f"{name} disagree") for sentence in comparison_sentences(replace(found, tests={name: odd})))
    text = comparison_sentences(replace(found, tests={name: replace(odd, flag=True, lofo_worst_order=3)}))
    assert any(f"{name} does not belong with the others" in sentence and "most in order 3" in sentence for sentence in text)


def test_assumptions_change_one_thing() -> None:
    bare = {name: model.without("ball-form", "setup-shift") for name, model in PAIR.items()}
    labels = list(_nuisance_assumptions(bare.values(), LINEAR.bind(SMALL).setting))
    assert "with ball form" in labels
    assert "with set-up shift" in labels
    assert "without mount" in labels
    changed = {label: change(LINEAR) for label, change in _discrepancy_assumptions(PAIR.values()).items()}
    assert "discrepancy κ/n" not in changed
    assert next(t for t in changed["discrepancy κ/n²"].nuisances if isinstance(t, Discrepancy)).decay == 2.0
    assert changed["set-up shift: own scales for orders 0 and 1"].hypers == ("sigma", "delta_0", "delta_1", "kappa", "tau")
    assert not any(isinstance(t, SetupShift) for t in changed["without set-up shift"].nuisances)
    for model in changed.values():
        assert [type(t) for t in model.nuisances] == [type(t) for t in LINEAR.nuisances if type(t) in map(type, model.nuisances)]


def test_posteriors_bring_their_readings() -> None:
    rule = lb.StoppingRule(ess=100.0)
    posterior = lb.sample(PAIR["constant"], SMALL, sampler="independent", rule=rule)
    other = lb.sample(PAIR["constant"], SMALL.without("f742"), sampler="independent", rule=rule)
    with pytest.raises(InputError, match="must be of the same readings to be compared, got 'b'"):
        lb.compare({"a": posterior, "b": other})
    with pytest.raises(InputError, match="must be given a campaign unless all models are posteriors"):
        lb.compare({"a": posterior, "b": LINEAR})


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"models": {"a": LINEAR}}, "models must be at least two, got 1"),
        ({"models": {"a": LINEAR, "b": lb.HybridModel.paper(0)}}, "must have a proper prior to have an evidence"),
        ({"campaign": SMALL.plan()}, "must have readings to give an evidence, got a plan"),
        ({"leave_out": "reading"}, "leave_out must be 'test', got 'reading': readings of one circle share"),
        ({"leave_out": "order"}, "leave_out must be 'test', got 'order': every test is left out in turn"),
        ({"tolerance": 0.0}, "tolerance must lie between"),
        ({"ci_prob": 1.5}, "ci_prob must lie between 0 and 1"),
    ],
)
def test_refused(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        lb.compare(**({"models": PAIR, "campaign": SMALL} | arguments))  # type: ignore[arg-type]


def test_one_force_compares_nuisances_only() -> None:
    """Degree 0 at one force and one test: no slopes, nothing to leave out, and still an answer."""
    model = lb.HybridModel.default(0).without("truncation")
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


def test_different_priors_are_named() -> None:
    plain = PAIR["constant"].without("truncation")
    wider = replace(plain, prior=replace(plain.prior, gain=4e-4))
    found = lb.compare({"as it is": plain, "wider": wider}, SMALL, tolerance=0.1, evidence_only=True)
    assert found.differing_priors == ("E_XX1", "E_YY1")


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
    rough = lb.HybridModel.default(0).without("truncation")
    steep = replace(rough, nuisances=tuple(Discrepancy(4.0) if isinstance(t, Discrepancy) else t for t in rough.nuisances))
    hyper = {"sigma": 0.1, "delta": 0.3, "kappa": 3.0, "tau": 1.0}
    campaign = steep.simulate(plan((60,) * 5, forces_N=(36.0, 200.0, 400.0, 600.0, 742.0)), seed=4, hyper_um=hyper).campaign
    found = lb.compare({"constant": rough, "linear": rough.with_degree(1)}, campaign, tolerance=0.1, evidence_only=True)
    preferred = found.preferred_assumption()
    assert preferred is not None
    assert preferred.assumption == "discrepancy κ/n²"
    assert "The readings prefer 'discrepancy κ/n²' by" in " ".join(comparison_sentences(found))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda c: lb.compare({"a": LINEAR, "b": LINEAR}, c), "models must differ, got 'a' and 'b' alike"),
        (lambda c: lb.compare([LINEAR], c), "models must be a mapping of names to models, got list"),
        (lambda c: lb.compare({"a": LINEAR, "b": LINEAR.with_degree(0)}, "folder"), "campaign must be a Campaign, got str"),
        (lambda c: lb.belonging({}, c), "models must be at least one"),
        (lambda c: lb.belonging({"a": LINEAR}, c, replicates=0), "replicates must be at least 1, got 0"),
        (lambda c: lb.local_fits(LINEAR, "folder"), "campaign must be a Campaign, got str"),
    ],
)
def test_wrong_calls(call: Callable[[lb.Campaign], object], message: str) -> None:
    with pytest.raises(InputError, match=re.escape(message)):
        call(SMALL)
