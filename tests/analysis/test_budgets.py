"""Uncertainty budgets: shares of the variance, what holds it, sensitivities."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from campaigns import HYPER_UM, plan, refuses

import ldbb_bayes as lb
from ldbb_bayes.analysis.budgets import Budget, Contribution
from ldbb_bayes.model.terms.columns import NOISE
from ldbb_bayes.report.wording import remedy_words

LINEAR = lb.HybridModel.first(1)
CAMPAIGN = LINEAR.simulate(plan(), seed=3, hyper_um=HYPER_UM).campaign
PHI = np.array([HYPER_UM[name] * 1e-3 for name in ("sigma", "delta", "kappa", "tau")])


@pytest.fixture(scope="module")
def posterior() -> Any:
    return lb.sample(LINEAR, CAMPAIGN, seed=1, sampler="independent")


@pytest.fixture(scope="module")
def budgets(posterior: Any) -> dict[str, Budget]:
    return lb.analysis.budget_uncertainty(posterior)


def line_of(budget: Budget, source: str) -> Contribution:
    """Return the line of a source."""
    return next(line for line in budget.contributions if line.source == source)


def test_shares_sum_to_one_and_give_back_the_variance(
    posterior: Any, budgets: dict[str, Budget]
) -> None:
    """Nothing is divided by the sum: a source left out or counted twice would show."""
    table = lb.summarize(posterior)
    for name, budget in budgets.items():
        sd = table.loc[name, "sd"]
        assert sum(line.share for line in budget.contributions) == pytest.approx(1.0, abs=1e-9)
        assert budget.u == pytest.approx(sd, rel=1e-6)
        squares = sum(line.share * budget.u**2 for line in budget.contributions)
        assert squares == pytest.approx(sd**2, rel=1e-2)


def test_contributions_are_sensitivity_times_uncertainty(budgets: dict[str, Budget]) -> None:
    for budget in budgets.values():
        for line in budget.contributions:
            assert line.contribution == pytest.approx(np.sqrt(max(line.share, 0.0)) * budget.u)
            if line.u is not None:
                assert line.sensitivity is not None
                assert abs(line.sensitivity) * line.u == pytest.approx(line.contribution)


def test_a_gain_needs_the_bars_length(budgets: dict[str, Budget]) -> None:
    gain = budgets["E_XX1"]
    assert gain.contributions[0].source == "bar_length"
    assert gain.heaviest == "BarLength"
    assert remedy_words(gain) == "Calibrate the bar's length."
    assert gain.u_if_known is not None
    assert gain.u_if_known < 0.5 * gain.u


def test_squareness_needs_the_balls_form(budgets: dict[str, Budget]) -> None:
    """1 mm of sin 2θ is R/2 times 13.3 mrad of squareness; the prior takes a little of it."""
    form = budgets["E_C0YX"].contributions[0]
    assert form.source == "form_sin2"
    assert form.sensitivity is not None
    assert 0.75 * 2.0 / 150.0 < form.sensitivity <= 2.0 / 150.0


@pytest.mark.parametrize("term", ["mount", "Nonsense"])
def test_an_unknown_term_has_no_share(budgets: dict[str, Budget], term: str) -> None:
    refuses("term must be one of .*, got '" + term, budgets["C_XXX"].share, term)
    refuses("term must be one of .*, got '" + term, budgets["C_XXX"].origin_of, term)


def test_a_misspelt_term_gets_the_nearest(budgets: dict[str, Budget]) -> None:
    refuses("Did you mean 'Mount'", budgets["C_XXX"].share, "mount")


def test_a_term_that_the_model_lacks_has_the_share_zero(budgets: dict[str, Budget]) -> None:
    assert "Drift" not in LINEAR.terms
    assert budgets["C_XXX"].share("Drift") == 0.0


def test_scatter_of_the_readings_is_type_a(budgets: dict[str, Budget]) -> None:
    for source in (NOISE, "Discrepancy", "SetupShift"):
        assert line_of(budgets["E_C0YX"], source).kind == "A"
    assert budgets["E_XX1"].as_dict()["contributions"][0]["kind"] == "B"


def test_the_sign_of_a_sensitivity(budgets: dict[str, Budget]) -> None:
    """With every reading one micrometre longer, a gain moves by the bar length's sensitivity."""
    tests = []
    for test in CAMPAIGN.tests:
        tests.append(test.with_reading_um(np.asarray(test.reading_um) + 1.0))
    longer = replace(CAMPAIGN, tests=tuple(tests))
    model = LINEAR.without("truncation")
    gain = model.bind(CAMPAIGN).names.index("E_XX1")
    estimates = []
    for campaign in (CAMPAIGN, longer):
        estimates.append(model.bind(campaign).given(PHI[None])[1].mean[0][gain])
    change_per_mm = (estimates[1] - estimates[0]) / 1e-3
    sensitivity = line_of(budgets["E_XX1"], "bar_length").sensitivity
    assert sensitivity == pytest.approx(change_per_mm, rel=0.1)
