"""Uncertainty budgets: shares that sum, the variance they give back, and signs; `tests/model` holds shares to derivatives."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from campaigns import HYPER_UM, plan

import ldbb_bayes as lb
from ldbb_bayes.analysis.identifiability import Budget, budgets
from ldbb_bayes.model.likelihood import NOISE
from ldbb_bayes.report.wording import remedy_words

MODEL = lb.HybridModel.first(1)
PHI = np.array([HYPER_UM[name] * 1e-3 for name in ("sigma", "delta", "kappa", "tau")])


CAMPAIGN = MODEL.simulate(plan(), seed=3, hyper_um=HYPER_UM).campaign


@pytest.fixture(scope="module")
def posterior() -> Any:
    return lb.sample(MODEL, CAMPAIGN, seed=1, sampler="independent")


@pytest.fixture(scope="module")
def found(posterior: Any) -> dict[str, Budget]:
    return budgets(posterior)


def test_shares_sum_to_one_and_give_back_the_variance(posterior: Any, found: dict[str, Budget]) -> None:
    """Nothing is divided by the sum: a source left out or counted twice would show."""
    table = lb.summarize(posterior)
    for name, budget in found.items():
        assert sum(line.share for line in budget.contributions) == pytest.approx(1.0, abs=1e-9)
        assert budget.u == pytest.approx(table.loc[name, "sd"], rel=1e-6)
        squares = sum(line.share * budget.u**2 for line in budget.contributions)
        assert squares == pytest.approx(table.loc[name, "sd"] ** 2, rel=1e-2)
        for line in budget.contributions:
            assert line.contribution == pytest.approx(np.sqrt(max(line.share, 0.0)) * budget.u)
            if line.u is not None:
                assert abs(line.sensitivity or 0.0) * line.u == pytest.approx(line.contribution)


def test_what_the_paper_needs_to_know(found: dict[str, Budget]) -> None:
    gain = found["E_XX1"]
    assert gain.contributions[0].source == "bar_length"
    assert (gain.heaviest, remedy_words(gain)) == ("BarLength", "Calibrate the bar's length.")
    assert gain.u_if_known < 0.5 * gain.u
    square = found["E_C0YX"]
    assert square.contributions[0].source == "form_sin2"
    # 1 mm of sin 2θ is R/2 times 13.3 mrad of squareness; the prior takes a little of it.
    assert 0.75 * 2.0 / 150.0 < (square.contributions[0].sensitivity or 0.0) <= 2.0 / 150.0
    assert {line.kind for line in square.contributions if line.source in (NOISE, "Discrepancy", "SetupShift")} == {"A"}
    assert found["E_XX1"].as_dict()["contributions"][0]["kind"] == "B"


def test_the_sign_of_a_sensitivity(found: dict[str, Budget]) -> None:
    """Every reading one micrometre longer: how the estimate of a gain moves is the sensitivity to the bar's length."""
    longer = replace(CAMPAIGN, tests=tuple(t.with_reading_um(np.asarray(t.reading_um) + 1.0) for t in CAMPAIGN.tests))
    one, other = (MODEL.without("truncation").bind(c) for c in (CAMPAIGN, longer))
    moved = (other.given(PHI[None])[1].mean[0] - one.given(PHI[None])[1].mean[0])[one.names.index("E_XX1")]
    line = next(x for x in found["E_XX1"].contributions if x.source == "bar_length")
    assert line.sensitivity == pytest.approx(moved / 1e-3, rel=0.1)
