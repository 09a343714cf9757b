"""Certificates of balls that the readings contradict are no cure, and cannot be bought."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from campaigns import refuses

import ldbb_bayes as lb
from ldbb_bayes.analysis.hyper_parameter_nodes import hyper_parameter_nodes
from ldbb_bayes.analysis.usability import ReasonKind, Use, judge_fit
from ldbb_bayes.analysis.value_of_certificates import CERTIFICATES, missing_certificates
from ldbb_bayes.inference.contradicted_certificates import (
    _log_mean_ratio,
    contradicted_certificates,
    log_ratio_of_stated_balls,
)
from ldbb_bayes.inference.fit import ConcernKind, Fit, State
from ldbb_bayes.inference.posterior import fit_of
from ldbb_bayes.report import wording

MODEL = lb.HybridModel.default(1)
BALLS = "balls of grade G10"
ROUND = lb.Instrument(**CERTIFICATES[BALLS])


@cache
def campaign_of(balls: str) -> lb.Campaign:
    """Circles with turned balls: of grade G10, or of a form error ten times as large."""
    angle = np.arange(0.0, 360.0, 5.0)
    tests = []
    for k, force_N in enumerate((50.0, 200.0, 350.0, 500.0, 650.0)):
        tests.append(
            lb.CircularTest(
                force_N,
                angle,
                name=f"f{force_N:g}",
                direction="CW",
                work_ball_deg=40.0 * k,
                tool_ball_deg=25.0 * k,
            )
        )
    instrument = ROUND if balls == "round" else lb.Instrument()
    plan = lb.Campaign(tuple(tests), instrument=instrument)
    hyper = {} if balls == "round" else {"tau": 2.5}
    campaign = MODEL.simulate(plan, seed=4, hyper_um=hyper).campaign
    return replace(campaign, instrument=lb.Instrument())


def test_the_ratio_of_densities_is_averaged_by_the_weights() -> None:
    """ln [(3 e^a + e^b) / 4] where it is a and b at the two values of φ."""
    campaign = campaign_of("lobed")
    bound = MODEL.bind(campaign)
    certified = MODEL.bind(replace(campaign, instrument=ROUND))
    median = np.full(len(bound.hyper_prior.names), 0.5)
    phi = bound.hyper_prior.quantile(np.array([median, 0.8 * median]))
    a, b = (_log_mean_ratio(certified, bound, np.ones(1), phi[k : k + 1]) for k in range(2))
    expected = np.logaddexp(a + np.log(3.0), b) - np.log(4.0)
    assert abs(a - b) > 0.1
    weighted = _log_mean_ratio(certified, bound, np.array([3.0, 1.0]), phi)
    assert weighted == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(("balls", "contradicted"), [("round", ()), ("lobed", (BALLS,))])
def test_balls_less_round_than_a_grade(balls: str, contradicted: tuple[str, ...]) -> None:
    """As the evidences of both models say, computed by integrals over all scales."""
    campaign = campaign_of(balls)
    bound = MODEL.bind(campaign)
    missing = missing_certificates(campaign.instrument)
    nodes = hyper_parameter_nodes(bound)
    assert contradicted_certificates(bound, missing, *nodes) == contradicted
    certified = replace(campaign, instrument=ROUND)
    evidences = [
        lb.log_evidence(MODEL, readings, tolerance=0.1) for readings in (campaign, certified)
    ]
    log_ratio = evidences[1].log_value - evidences[0].log_value
    assert (log_ratio < -5.0) == bool(contradicted)


def test_balls_much_rounder_than_a_grade_do_not_contradict_it() -> None:
    """The readings are less probable with the grade, as they show no form at all."""
    angle = np.arange(0.0, 360.0, 5.0)
    tests = []
    for force_N in (100.0, 300.0, 500.0, 700.0):
        for direction in ("CW", "CCW"):
            tests.append(lb.CircularTest(force_N, angle, direction=direction))
    hyper = {"sigma": 0.1, "delta": 0.01, "kappa": 0.02, "tau": 1e-3, "decay": 2.0}
    campaign = MODEL.simulate(lb.Campaign(tuple(tests)), seed=2, hyper_um=hyper).campaign
    bound = MODEL.bind(campaign)
    certified = replace(campaign, instrument=ROUND)
    evidences = [
        lb.log_evidence(MODEL, readings, tolerance=0.1) for readings in (campaign, certified)
    ]
    assert evidences[1].log_value - evidences[0].log_value < -5.0
    missing = missing_certificates(campaign.instrument)
    assert contradicted_certificates(bound, missing, *hyper_parameter_nodes(bound)) == ()


def judged(balls: str) -> Fit:
    """Return the fit of the campaign whose balls are stated to be of grade G10."""
    campaign = replace(campaign_of(balls), instrument=ROUND)
    return fit_of(lb.sample(MODEL, campaign, sampler="independent", seed=1))


def test_a_fit_says_that_balls_are_less_round_than_stated() -> None:
    """By as much as the evidences differ; and the results are not to be used."""
    fit = judged("lobed")
    (concern,) = [one for one in fit.concerns if one.kind == ConcernKind.BALLS]
    campaign = campaign_of("lobed")
    certified = replace(campaign, instrument=ROUND)
    evidences = [
        lb.log_evidence(MODEL, readings, tolerance=0.1) for readings in (campaign, certified)
    ]
    assert concern.value == pytest.approx(evidences[1].log_value - evidences[0].log_value, rel=0.02)
    assert fit.state == State.DOUBTFUL
    judgement = judge_fit(fit)
    assert judgement.use == Use.DO_NOT_USE
    assert ReasonKind.BALLS in {reason.kind for reason in judgement.reasons}
    (sentence,) = wording.concern_sentences((concern,), {})
    assert "The readings contradict the stated form of the balls" in sentence


def test_a_fit_does_not_doubt_balls_that_are_as_round_as_stated() -> None:
    assert ConcernKind.BALLS not in {concern.kind for concern in judged("round").concerns}


@pytest.mark.parametrize(
    "instrument",
    [lb.Instrument(), lb.Instrument(work=lb.Ball(harmonics_um=[(2, 0.05, 30.0)], U_um=0.02))],
)
def test_without_a_stated_sphericity_nothing_is_contradicted(instrument: lb.Instrument) -> None:
    bound = MODEL.bind(replace(campaign_of("lobed"), instrument=instrument))
    assert log_ratio_of_stated_balls(bound, *hyper_parameter_nodes(bound)) == 0.0


@pytest.mark.slow
def test_identify_says_that_the_stated_form_is_contradicted() -> None:
    result = lb.identify(MODEL, replace(campaign_of("lobed"), instrument=ROUND))
    sentence = "The readings contradict the stated form of the balls: the balls are less round."
    assert sentence in wording.identifiability_screen(result)
    as_stated = lb.identify(MODEL, replace(campaign_of("round"), instrument=ROUND))
    assert as_stated.contradicted_certificates == ()


def test_a_plan_contradicts_nothing_by_itself() -> None:
    plan = campaign_of("lobed").plan()
    bound = MODEL.bind(replace(plan, pilot=None))
    missing = missing_certificates(plan.instrument)
    assert contradicted_certificates(bound, missing, *hyper_parameter_nodes(bound)) == ()


@pytest.mark.slow
def test_identify_offers_no_certificate_that_cannot_be_had() -> None:
    """No parameter is worse known with a certificate; the plan that is designed from the readings
    says the same."""
    campaign = campaign_of("lobed")
    result = lb.identify(MODEL, campaign)
    assert result.contradicted_certificates == (BALLS,)
    assert BALLS not in result.certificates
    without = result.certificates["none of these"]
    for sd in result.certificates.values():
        assert all(sd[name] < 1.02 * without[name] for name in sd)
    remedies = [entry.remedy for entry in result.parameters.values()]
    assert not [one for one in remedies if one is not None and one.certificate == BALLS]
    sentence = f"The readings contradict {BALLS}: the balls are less round."
    assert sentence in wording.identifiability_screen(result)
    assert sentence in wording.identifiability_sentences(result)
    of_plan = lb.identify(MODEL, replace(campaign.plan(), pilot=campaign))
    assert of_plan.contradicted_certificates == (BALLS,)
    assert f"The readings of the pilot contradict {BALLS}: the balls are less round." in (
        wording.identifiability_screen(of_plan)
    )
    assert lb.identify(MODEL, campaign_of("round")).contradicted_certificates == ()


def test_it_cannot_be_bought() -> None:
    refuses(
        "must agree with the readings .* got balls of grade G10",
        lb.design,
        MODEL,
        pilot=campaign_of("lobed"),
        goals={"E_YX2": "40 %"},
        certificates={"balls G10": 300.0},
    )
