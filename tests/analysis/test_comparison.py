"""compare(): its numbers against those of its parts, what it refuses, what it says."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from campaigns import plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.analysis.assumptions import (
    SLOPE_SCALES,
    WHITE_NOISE,
    Assumed,
    crossings,
    discrepancy_assumptions,
    nuisance_assumptions,
)
from ldbb_bayes.analysis.compared import Comparison
from ldbb_bayes.analysis.weight import strength, turned, verdict_of
from ldbb_bayes.errors import InputError
from ldbb_bayes.model.terms import Discrepancy, SetupShift
from ldbb_bayes.report.plain import json_text

LINEAR = lb.HybridModel.default(1)
PAIR = {"constant": LINEAR.with_degree(0), "linear": LINEAR}


@pytest.fixture(scope="module")
def found(compared: Comparison) -> Comparison:
    return compared


def test_evidence_and_probabilities(found: Comparison, recovered: lb.Campaign) -> None:
    for name, model in PAIR.items():
        expected = lb.log_evidence(model, recovered)
        assert found.models[name].evidence.log_value == pytest.approx(expected.log_value, abs=5e-3, rel=0.0)
    value, error = found.log_bayes_factor["linear/constant"]
    assert found.models["linear"].probability == pytest.approx(1.0 / (1.0 + np.exp(-value)), rel=1e-9)
    assert error < 0.02
    assert found.savage_dickey["linear/constant"][0] == pytest.approx(value, abs=0.05)
    assert found.within_tolerance


def test_sensitivity_is_the_same_comparison_again(found: Comparison, recovered: lb.Campaign) -> None:
    assert [scaled.slope_scale for scaled in found.prior_sensitivity] == list(SLOPE_SCALES)
    by_scale = {scaled.slope_scale: scaled.log_bayes_factor for scaled in found.prior_sensitivity}
    assert by_scale[0.3] == pytest.approx(found.log_bayes_factor["linear/constant"][0], abs=1e-6)
    wide = replace(LINEAR, prior=replace(LINEAR.prior, slope_scale=3.0))
    evidences = [lb.log_evidence(model, recovered) for model in (wide, PAIR["constant"])]
    assert by_scale[3.0] == pytest.approx(lb.log_bayes_factor(*evidences)[0], abs=0.02)
    centre = replace(LINEAR, nuisances=tuple(SetupShift("centre") if isinstance(t, SetupShift) else t for t in LINEAR.nuisances))
    evidences = [lb.log_evidence(model, recovered) for model in (centre, centre.with_degree(0))]
    assumed = {a.label: a for a in found.discrepancy_sensitivity}
    direct = lb.log_bayes_factor(*evidences)[0]
    assert assumed["set-up shift of order 1 (centre) only"].log_bayes_factor == pytest.approx(direct, abs=0.02)
    naive = next(a for a in found.nuisances if a.label == WHITE_NOISE)
    plain = LINEAR.without("ball-form", "bar-length", "mount", "force-error", "setup-shift", "discrepancy", "truncation")
    evidences = [lb.log_evidence(model, recovered) for model in (plain, plain.with_degree(0))]
    assert naive.log_bayes_factor == pytest.approx(lb.log_bayes_factor(*evidences)[0], abs=0.02)
    assert found.overstatement == pytest.approx(naive.log_bayes_factor - found.log_bayes_factor["linear/constant"][0])


def test_the_recovered_experiment_is_not_robust(found: Comparison) -> None:
    """Constant compliance is favoured; that no zero shift is assumed turns it, and the readings do not rule that out."""
    value = found.log_bayes_factor["linear/constant"][0]
    assert value < -1.0
    changes = {assumed.label: own for assumed, own in turned(found)}
    assert changes["set-up shift of order 1 (centre) only"] > -5.0
    assert changes["without set-up shift"] < -1000.0
    text = " ".join(found.verdict)
    assert "The sign is NOT robust" in text
    assert "do not rule that assumption out" in text
    assert "in favour of constant" in text
    assert f"{abs(found.overstatement):.0f} nats away" in text
    assert found.overstatement > 100.0


def test_leave_one_force_out(found: Comparison, recovered: lb.Campaign) -> None:
    for name, model in found.models.items():
        densities = np.array([test.lofo_log_density[name] for test in found.tests.values()])
        assert model.elpd_lofo == pytest.approx(densities.sum())
        assert model.elpd_lofo_se == pytest.approx(np.sqrt(6 * densities.var(ddof=1)))
    differences = np.array([t.lofo_log_density["linear"] - t.lofo_log_density["constant"] for t in found.tests.values()])
    value, spread = found.elpd_difference["linear/constant"]
    assert (value, spread) == pytest.approx((differences.sum(), np.sqrt(6 * differences.var(ddof=1))))
    for test in found.tests.values():
        for model in PAIR:
            if test.pareto_k[model] < 0.6:
                assert test.psis_log_density[model] == pytest.approx(test.lofo_log_density[model], abs=0.3)
    assert list(found.tests) == [test.name for test in recovered.tests]


def test_what_leaving_out_does(found: Comparison, recovered: lb.Campaign) -> None:
    """Means without a test: the campaign properties frozen, so a plain fit of the rest differs, but not by much."""
    change = found.tests["f490"].dropping["constant"]
    expected = lb.marginals(PAIR["constant"], recovered.without("f490"))
    for name, own in change.items():
        assert own.mean == pytest.approx(expected.loc[name, "mean"], abs=0.1 * expected.loc[name, "sd"])
        assert own.sd == pytest.approx(expected.loc[name, "sd"], rel=0.05)
        _, mean, sd = found.models["constant"].parameters[name]
        assert own.shift == pytest.approx((own.mean - mean) / sd, abs=0.02)


def test_rmse_is_equation_34(found: Comparison) -> None:
    assert f"{found.models['constant'].least_squares_rmse_um:.1f}" == "1.1"
    assert f"{found.models['linear'].least_squares_rmse_um:.1f}" == "0.9"
    assert set(found.models["linear"].least_squares_fitness_percent) == set(found.tests)
    assert 0.0 < found.models["linear"].rmse_um < found.models["constant"].rmse_um


def test_json_has_the_agreed_names(found: Comparison) -> None:
    record = json.loads(json_text(found.as_dict()))
    model = record["models"]["linear"]
    assert {"log_evidence", "log_evidence_error", "elpd_lofo", "elpd_lofo_se", "rmse_um"} <= set(model)
    assert set(record["log_bayes_factor"]) == {"linear/constant"}
    assert {"slope_scale", "log_bayes_factor"} <= set(record["prior_sensitivity"][0])
    assert {"assumption", "log_bayes_factor"} <= set(record["discrepancy_sensitivity"][0])
    assert set(record["slopes"]) == {"C_XXX", "C_XYX", "C_YYY", "C_CXY", "C_CYY", "C_CCY"}
    assert 0.0 < record["slopes"]["C_XYX"]["inclusion_probability"] < 1.0
    test = record["tests"]["f036"]
    assert set(test["lofo_log_density"]) == {"constant", "linear"}
    assert isinstance(test["flag"], bool)
    assert 0.0 < test["lofo_p_value"] <= 1.0
    assert isinstance(record["verdict"], str)
    assert len(record["slope_subsets"]) == 64
    assert record["prior_sensitivity_crossings"] == []


def test_shown(found: Comparison) -> None:
    assert "ln B over first" in str(found)
    assert "<table>" in found._repr_html_()


@pytest.mark.parametrize(
    ("value", "words"), [(0.4, "bare mention"), (-2.0, "positive"), (4.9, "strong evidence"), (-7.0, "very strong")]
)
def test_strength(value: float, words: str) -> None:
    assert words in strength(value)


def test_crossings() -> None:
    scale = np.array([0.1, 1.0, 10.0])
    assert crossings(scale, np.array([1.0, -1.0, -2.0])) == pytest.approx([10**-0.5])
    assert crossings(scale, np.array([1.0, -1.0, 3.0])) == pytest.approx([10**-0.5, 10**0.25])
    assert crossings(scale, np.array([-1.0, -2.0, -3.0])) == ()


def test_a_verdict_that_holds(found: Comparison) -> None:
    """Where no assumption turns the sign the verdict says so; where the slope scale does, it says where."""
    same = tuple(Assumed(a.label, a.log_evidence, -6.0, 1e-3) for a in found.nuisances)
    holds = verdict_of(replace(found, nuisances=same, discrepancy_sensitivity=same, crossings=()))
    assert "The sign holds under every assumption tried." in holds
    rejected = replace(same[1], log_bayes_factor=3.0, log_evidence={n: z - 500.0 for n, z in same[1].log_evidence.items()})
    turned_only_there = (same[0], rejected)
    said = verdict_of(replace(found, nuisances=turned_only_there, discrepancy_sensitivity=same[:1], crossings=()))
    assert "The sign holds under every assumption that the readings do not reject." in said
    assert any(sentence.startswith("It turns with") for sentence in said)
    crossed = verdict_of(replace(found, nuisances=same, discrepancy_sensitivity=same, crossings=(0.12,)))
    assert "The sign is NOT robust: it depends on what is assumed." in crossed
    assert any("changing sign at 0.12" in sentence for sentence in crossed)


def test_sentences_follow_the_numbers(found: Comparison) -> None:
    """The order of the models, tests at odds, a rough second route."""
    turned_round = replace(found, pair=("linear", "constant"), models=dict(reversed(found.models.items())))
    turned_round = replace(
        turned_round,
        log_bayes_factor={"constant/linear": (5.85, 1e-3)},
        savage_dickey={"constant/linear": (5.0, 1.5)},
        elpd_difference={"constant/linear": (1.6, 1.1)},
    )
    said = verdict_of(turned_round)
    assert any("from 1.11 (constant) to 0.90 µm (linear), -19 %" in sentence for sentence in said)
    assert any("in favour of constant" in sentence for sentence in said[:1])
    assert any("second route (Savage-Dickey) gives ln B(constant/linear) = +5.00 ± 2" in sentence for sentence in said)
    name, test = next(iter(found.tests.items()))
    odd = replace(test, belonging=replace(test.belonging, family_wise_p_value=1e-3, flag=False))
    assert any(sentence.startswith(f"{name} disagree") for sentence in verdict_of(replace(found, tests={name: odd})))
    flagged = replace(test, belonging=replace(test.belonging, family_wise_p_value=1e-3, flag=True, worst_order=3))
    said = verdict_of(replace(found, tests={name: flagged}))
    assert any(f"{name} does not belong with the others" in sentence and "most in order 3" in sentence for sentence in said)


def test_assumptions_change_one_thing() -> None:
    bare = {name: model.without("ball-form", "setup-shift") for name, model in PAIR.items()}
    labels = [assumption.label for assumption in nuisance_assumptions(bare, simulated(plan()))]
    assert "with ball form" in labels
    assert "with set-up shift" in labels
    assert "without mount" in labels
    changed = {a.label: a.change(LINEAR) for a in discrepancy_assumptions(PAIR)}
    assert "discrepancy κ/n" not in changed
    assert next(t for t in changed["discrepancy κ/n²"].nuisances if isinstance(t, Discrepancy)).decay == 2.0
    assert changed["set-up shift: own scales for orders 0 and 1"].hypers == ("sigma", "delta_0", "delta_1", "kappa", "tau")
    assert not any(isinstance(t, SetupShift) for t in changed["without set-up shift"].nuisances)
    for model in changed.values():
        assert [type(t) for t in model.nuisances] == [type(t) for t in LINEAR.nuisances if type(t) in map(type, model.nuisances)]


SMALL = simulated(plan((30, 30, 30), forces_N=(36.0, 400.0, 742.0)), seed=1)


def test_posteriors_bring_their_readings() -> None:
    rule = lb.StoppingRule(ess=100.0)
    posterior = lb.sample(PAIR["constant"], SMALL, sampler="quadrature", rule=rule)
    other = lb.sample(PAIR["constant"], SMALL.without("f742"), sampler="quadrature", rule=rule)
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
    model = lb.HybridModel.default(0)
    found = lb.compare({"with form": model, "without": model.without("ball-form")}, SMALL.select(["f400"]), tolerance=0.1)
    assert found.slopes is None
    assert found.tests == {}
    assert found.prior_sensitivity == ()
    assert found.local_fits.empty
    assert set(found.log_bayes_factor) == {"without/with form"}
    assert found.savage_dickey == {}
    assert "without ball form" not in [assumed.label for assumed in found.nuisances]
    assert WHITE_NOISE not in [assumed.label for assumed in found.nuisances]
    assert np.isnan(found.overstatement)
    assert np.isnan(found.models["without"].elpd_lofo)
    assert json.loads(json_text(found.as_dict()))["models"]["without"]["elpd_lofo"] is None


def test_different_priors_are_named() -> None:
    wider = replace(LINEAR, prior=replace(LINEAR.prior, gain=4e-4))
    found = lb.compare({"as it is": PAIR["constant"], "wider": wider.with_degree(0)}, SMALL, tolerance=0.1)
    assert found.verdict[-1].startswith("The models give E_XX1 and E_YY1 different priors")


def test_slopes_are_selected_from_the_widest_model() -> None:
    """Whatever the order of the models, the degree that is compared, and without their having to be quadratic."""
    campaign = simulated(plan((30, 30, 30), forces_N=(36.0, 400.0, 742.0)), seed=1)
    linear = lb.HybridModel.default(1).without("truncation")
    others = tuple(f"{name}_{k}" for name in ("C_XXX", "C_YYY", "C_CXY", "C_CYY", "C_CCY") for k in (1, 2))
    narrow = linear.fixing(*others[::2])
    found = [
        lb.compare(dict(pair), campaign, tolerance=0.1).slopes
        for pair in ((("narrow", narrow), ("wide", linear)), (("wide", linear), ("narrow", narrow)))
    ]
    assert all(slopes is not None and len(slopes.subsets) == 64 for slopes in found)
    one = lb.HybridModel.default(2).without("truncation").fixing(*others)
    both = lb.compare({"constant": one.with_degree(0), "linear": one.with_degree(1)}, campaign, tolerance=0.1, quadratic=False)
    assert both.slopes is not None
    assert len(both.slopes.subsets) == 2
    quadratic = lb.compare({"constant": one.with_degree(0), "quadratic": one}, campaign, tolerance=0.1, quadratic=True).slopes
    assert quadratic is not None
    assert {subset.words for subset in quadratic.subsets} == {(), ("C_XYX",), ("C_XYX²",)}


def test_an_assumption_that_the_readings_prefer_is_named() -> None:
    """Circles that differ in low orders only: κ/n² then beats κ/n by far, and the verdict says so."""
    rough = lb.HybridModel.default(0).without("truncation")
    steep = replace(rough, nuisances=tuple(Discrepancy(4.0) if isinstance(t, Discrepancy) else t for t in rough.nuisances))
    hyper = {"sigma": 0.1, "delta": 0.3, "kappa": 3.0, "tau": 1.0}
    campaign = steep.simulate(plan((60,) * 5, forces_N=(36.0, 200.0, 400.0, 600.0, 742.0)), seed=4, hyper_um=hyper).campaign
    said = " ".join(lb.compare({"constant": rough, "linear": rough.with_degree(1)}, campaign, tolerance=0.1).verdict)
    assert "The readings prefer 'discrepancy κ/n²' by" in said


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
    campaign = simulated(plan((30, 30), forces_N=(36.0, 742.0)), seed=1)
    with pytest.raises(lb.InputError, match=re.escape(message)):
        call(campaign)
