"""Sentences on the method: each is true of the model and of the campaign."""

from __future__ import annotations

from dataclasses import replace

import pytest
from campaigns import plan

import ldbb_bayes as lb
from ldbb_bayes.report.annex_translation import annex_translation
from ldbb_bayes.report.translation import words_of
from ldbb_bayes.report.wording import method_sentences

DEFAULT = lb.HybridModel.default(0)
FIRST = lb.HybridModel.first(0)
PAPER = lb.HybridModel.paper(0)
GRADED = lb.Instrument(work=lb.Ball(grade="G5"), tool=lb.Ball(grade="G5"))
ONE_GRADED = lb.Instrument(work=lb.Ball(grade="G5"))


def method_of(model: lb.HybridModel, **of_campaign: object) -> str:
    return " ".join(method_sentences(model.bind(replace(plan(), **of_campaign))))


def with_times() -> tuple[lb.CircularTest, ...]:
    """Tests that state when they began, and their temperature."""
    tests = enumerate(plan().tests)
    return tuple(replace(test, time_s=60.0 * k, temperature_C=20.0 + k) for k, test in tests)


def test_a_model_without_other_effects_averages_over_none() -> None:
    sentences = method_of(PAPER)
    assert "no other effect is modelled" in sentences
    assert "averaged over" not in sentences
    assert "with other effects" not in sentences


def test_other_effects_are_those_of_the_model() -> None:
    sentences = method_of(DEFAULT.without("mount"))
    assert "bar length" in sentences
    assert "mount" not in sentences


@pytest.mark.parametrize(
    ("model", "instrument", "sentences", "others"),
    [
        (DEFAULT, lb.Instrument(), ["up to 2.5 µm"], ["certificate or grade"]),
        (DEFAULT, ONE_GRADED, ["up to 2.5 µm", "certificate or grade"], []),
        (DEFAULT, GRADED, ["certificate or grade"], ["lobes"]),
        (FIRST, GRADED, ["fall as 1/n", "grades of balls are not used"], ["up to", "bounded"]),
        (PAPER, GRADED, ["The form of the balls is not modelled"], ["lobes", "bounded"]),
        (
            DEFAULT.with_term(lb.terms.BallForm(sphericity_um=0.5)),
            lb.Instrument(),
            ["up to 0.5 µm"],
            ["2.5"],
        ),
    ],
)
def test_the_form_of_the_balls_is_as_the_model_takes_it(
    model: lb.HybridModel,
    instrument: lb.Instrument,
    sentences: list[str],
    others: list[str],
) -> None:
    method = method_of(model, instrument=instrument)
    assert [sentence for sentence in sentences if sentence not in method] == []
    assert [other for other in others if other in method] == []


@pytest.mark.parametrize(
    ("model", "of_campaign", "sentence"),
    [
        (DEFAULT, {}, "linear in time, in the order in which the tests are listed."),
        (DEFAULT, {"tests": with_times()}, "linear in time, as the tests state it."),
        (DEFAULT, {"order": "random"}, "The tests were run in random order: drift"),
        (DEFAULT, {"drift": False}, "Nothing drifts from test to test (stated)."),
        (
            DEFAULT.with_term(lb.terms.Drift(over="temperature")),
            {"tests": with_times()},
            "linear in the temperature that the tests state.",
        ),
        (FIRST, {}, "Drift is not modelled."),
        (PAPER, {"drift": False}, "Nothing drifts from test to test (stated)."),
    ],
)
def test_drift_is_as_model_and_campaign_have_it(
    model: lb.HybridModel, of_campaign: dict[str, object], sentence: str
) -> None:
    method = method_of(model, **of_campaign)
    assert sentence in method
    assert ("Drift of bar and centre is linear" in method) == ("linear" in sentence)


@pytest.mark.parametrize("model", [DEFAULT, FIRST, PAPER])
@pytest.mark.parametrize("instrument", [lb.Instrument(), GRADED])
@pytest.mark.parametrize(
    "of_campaign", [{}, {"order": "random"}, {"drift": False}, {"tests": with_times()}]
)
def test_the_method_is_translated(
    model: lb.HybridModel, instrument: lb.Instrument, of_campaign: dict[str, object]
) -> None:
    translation = annex_translation(words_of("de"), frozenset())
    assert translation is not None
    bound = model.bind(replace(plan(), instrument=instrument, **of_campaign))
    for sentence in method_sentences(bound):
        translation.text(sentence)
    assert not translation.missing


def test_drift_with_temperature_is_translated() -> None:
    translation = annex_translation(words_of("de"), frozenset())
    assert translation is not None
    model = DEFAULT.with_term(lb.terms.Drift(over="temperature"))
    for sentence in method_sentences(model.bind(replace(plan(), tests=with_times()))):
        translation.text(sentence)
    assert not translation.missing
