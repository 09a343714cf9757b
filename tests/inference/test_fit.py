"""What a fit says of itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtri

import ldbb_bayes as lb
from ldbb_bayes.inference.checks import TestChecks
from ldbb_bayes.inference.fit import Concern, ConcernKind, Fit, State
from ldbb_bayes.inference.posterior import draws_of, fit_of
from ldbb_bayes.inference.posterior_concerns import _compliances_near_zero
from ldbb_bayes.model.bound_information import information_of
from ldbb_bayes.report.message_translation import in_language
from ldbb_bayes.report.wording import check_notes, concern_sentences, fit_verdict

CHECKS = TestChecks(dict.fromkeys(range(13), 0.5), 0.2, 0.1, 0.3)
MISSED = Concern(ConcernKind.NOT_CONVERGED, 200.0, 1000.0)
AGAINST = Concern(ConcernKind.TRUNCATION, -20.0, -6.9)


@pytest.fixture
def fit() -> Fit:
    sensitivity = {
        "E_XX1": {"prior": 0.06},
        "C_XXX": {"prior": 0.2},
        "C_XYX": {"prior": 0.01},
        "tau": {"prior": 0.3},
    }
    return Fit(
        rmse_um=1.0,
        fitness_percent={"a": 99.0},
        log_prob_truncation=-1.0,
        log_prob_truncation_error=0.0,
        log_prob_truncation_prior=-2.0,
        linearisation_error_um=0.0,
        concerns=(),
        predictive_checks={"a": CHECKS},
        sensitivity=sensitivity,
        shift={"a": 0.7},
        widening=0.2,
    )


@pytest.fixture
def unlikely(fit: Fit) -> Fit:
    return replace(fit, predictive_checks={"a": replace(CHECKS, orders_p={0: 1e-9, 1: 0.5})})


def test_a_usable_fit(fit: Fit) -> None:
    assert (
        fit_verdict(fit)
        == "Converged; the model expects readings like these (15 checks, smallest p = 0.2, white"
        " noise of a); 2 of 3 parameters are sensitive to their prior (C_XXX, E_XX1)."
    )
    assert (fit.state, fit.kinds) == (State.USABLE, ())


def test_of_a_single_sensitive_parameter_the_verdict_has_the_singular(fit: Fit) -> None:
    others = {name: entry for name, entry in fit.sensitivity.items() if name != "E_XX1"}
    verdict = fit_verdict(replace(fit, sensitivity=others))
    assert verdict.endswith("; 1 of 2 parameters is sensitive to its prior (C_XXX).")
    german = in_language(verdict, "de", ["a"])
    assert german is not None
    assert german.endswith("; 1 von 2 Parametern hängt von seinem Vorwissen ab (C_XXX).")


def test_readings_against_non_negative_compliance_are_doubtful(fit: Fit) -> None:
    doubtful = replace(fit, concerns=(AGAINST,))
    assert "speak against non-negative compliance" in fit_verdict(doubtful)
    assert doubtful.state == State.DOUBTFUL


def test_what_has_not_converged_is_unusable(fit: Fit) -> None:
    verdict = fit_verdict(replace(fit, concerns=(MISSED, AGAINST)))
    assert verdict == "NOT CONVERGED: do not use the numbers."
    assert replace(fit, concerns=(MISSED,)).state == State.UNUSABLE


def test_readings_in_another_unit_are_doubtful(fit: Fit) -> None:
    """One sentence names all the circles whose readings span too little, and another one those
    whose readings span too much; a misfit is then no news."""
    spans_mm = {"a": 1.2e-5, "b": 0.0, "c": 12.34}
    concerns = tuple(
        Concern(ConcernKind.UNIT, span_mm, 9e-5 if span_mm < 1.0 else 3.0, name)
        for name, span_mm in spans_mm.items()
    )
    doubtful = replace(fit, concerns=concerns)
    assert "the unit of the readings is in doubt: do not use the numbers" in fit_verdict(doubtful)
    assert (doubtful.state, doubtful.kinds) == (State.DOUBTFUL, ("unit",))
    small, large = concern_sentences(concerns, {})
    assert small.startswith(
        "The unit of the readings is in doubt: those of a, b span 0 … 0.012 µm, less than the 0.090"
        " µm that every ball bar shows."
    )
    assert large.startswith(
        "The unit of the readings is in doubt: those of c span 12 mm, more than the 3.0 mm that a"
        " ball bar can show."
    )


def test_a_fit_names_what_its_warnings_of_one_kind_concern(fit: Fit) -> None:
    prior = Concern(ConcernKind.PRIOR, 4.0, 3.0, "C_XXX")
    units = [Concern(ConcernKind.UNIT, 1.2e-5, 9e-5, name) for name in ("a", "b")]
    warned = replace(fit, concerns=(units[0], prior, units[1]))
    assert warned.names_of_concerns(ConcernKind.UNIT) == ("a", "b")
    assert warned.names_of_concerns(ConcernKind.PRIOR) == ("C_XXX",)
    assert warned.names_of_concerns(ConcernKind.HYPER) == ()


def test_a_failing_check_that_moves_intervals_is_doubtful(unlikely: Fit) -> None:
    assert fit_verdict(unlikely).startswith(
        "Converged; the model does not expect readings like these (order 0 of a): without a"
    )
    assert (unlikely.state, unlikely.kinds) == (State.DOUBTFUL, ("order",))
    assert "<p>Converged; the model does not expect" in unlikely._repr_html_()
    assert Fit.from_dict(unlikely.as_dict()) == unlikely


def test_a_failing_check_that_moves_nothing_is_a_note(unlikely: Fit) -> None:
    quiet = replace(unlikely, shift={"a": 0.3})
    assert "(order 0 of a) hardly moves an interval" in fit_verdict(quiet)
    assert (quiet.state, quiet.kinds, len(quiet.unexpected)) == (State.USABLE, (), 1)
    assert list(check_notes(quiet)) == [
        "The model does not expect order 0 of a: without a a parameter moves by 0.3 u."
    ]


def test_print_names_no_order_where_none_fails(fit: Fit) -> None:
    assert "order" not in str(fit)


def test_a_compliance_that_may_be_zero_has_an_upper_limit(recovered: lb.Campaign) -> None:
    """Draws of a half-normal distribution: 95 % of it lie below 1.95996 of its scale. A compliance
    of four standard deviations has no such limit, nor has one that may be negative."""
    bound = lb.HybridModel.default(0).bind(recovered)
    quantiles = (np.arange(20_000) + 0.5) / 20_000
    beta = np.zeros((len(quantiles), len(bound.names)))
    beta[:, bound.names.index("C_XXX")] = 4e-5 + 1e-5 * ndtri(quantiles)
    beta[:, bound.names.index("C_XYX")] = 1e-6 * ndtri(quantiles)
    beta[:, bound.names.index("C_YYY")] = 4e-5 + 1e-5 * ndtri(quantiles)
    beta[:, bound.names.index("C_CCY")] = 3e-10 * ndtri(0.5 + 0.5 * quantiles)
    (concern,) = _compliances_near_zero(bound, beta)
    assert (concern.kind, concern.name, concern.unit) == ("near-zero", "C_CCY", "rad/(N mm)")
    assert concern.limit == pytest.approx(1.95996 * 3e-10, rel=1e-4)
    (sentence,) = concern_sentences((concern,), {})
    assert "read it as 0 to 0.59 µrad/(N m) (95 %)" in sentence
    untruncated = lb.HybridModel.default(0).without("truncation")
    assert not list(_compliances_near_zero(untruncated.bind(recovered), beta))


def zero_concerns(campaign: lb.Campaign, constant_um: float) -> list[Concern]:
    """Return the warnings of a common constant, after one was added to all readings."""
    tests = []
    for test in campaign.tests:
        reading_um = np.asarray(test.reading_um) + constant_um
        tests.append(replace(test, reading_um=reading_um))
    shifted = replace(campaign, tests=tuple(tests))
    model = lb.HybridModel.default(1)
    fit = fit_of(lb.sample(model, shifted, sampler="independent", seed=1))
    return [concern for concern in fit.concerns if concern.kind == "zero"]


@pytest.mark.slow
def test_a_zero_that_was_not_set_is_told(recovered: lb.Campaign) -> None:
    """The limit is three times the sd of the constant by generalised least squares (dense)."""
    assert zero_concerns(recovered, 0.0) == []
    (first,) = zero_concerns(recovered, 150.0)
    (second,) = zero_concerns(recovered, 250.0)
    stated = lb.Instrument(bar_length_error_um=-100.0, bar_U_um=10.0)
    (third,) = zero_concerns(replace(recovered, instrument=stated), 150.0)
    assert third.value - first.value == pytest.approx(0.1, rel=0.05)
    assert second.value - first.value == pytest.approx(0.1, rel=0.05)
    bound = lb.HybridModel.default(1).bind(recovered)
    posterior = lb.sample(bound.model, recovered, sampler="independent", seed=1)
    information = information_of(bound, draws_of(posterior, bound)[1].mean(axis=0))
    design = np.concatenate(information.design) * information.scale
    covariance = design @ design.T
    start = 0
    for sources in information.noise:
        noise = np.sum(list(sources.values()), axis=0)
        end = start + len(noise)
        covariance[start:end, start:end] += noise
        start = end
    constant = np.concatenate(information.design)[:, information.names.index("bar_length")]
    sd = 1.0 / np.sqrt(constant @ np.linalg.solve(covariance, constant))
    assert first.limit == pytest.approx(3.0 * sd, rel=0.1)
    (sentence,) = concern_sentences((first,), {})
    assert sentence.startswith("All readings contain a constant of about +13")
