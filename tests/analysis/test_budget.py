"""Uncertainty budgets: shares that sum, the variance they give back, and every source alone through simulated estimates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from campaigns import HYPER_UM, plan

import ldbb_bayes as lb
from ldbb_bayes.analysis.budget import Budget, budgets
from ldbb_bayes.model.fourier import basis
from ldbb_bayes.model.hybrid import information_of
from ldbb_bayes.model.likelihood import NOISE, OWN
from ldbb_bayes.model.terms import BasisNoise, Columns
from ldbb_bayes.report.wording import remedy_words

MODEL = lb.HybridModel.default(1)
PHI = np.array([HYPER_UM[name] * 1e-3 for name in ("sigma", "delta", "kappa", "tau")])


@pytest.fixture(scope="module")
def posterior() -> object:
    return lb.sample(MODEL, MODEL.simulate(plan(), seed=3, hyper_um=HYPER_UM).campaign, seed=1, sampler="independent")


@pytest.fixture(scope="module")
def found(posterior: object) -> dict[str, Budget]:
    return budgets(posterior)  # type: ignore[arg-type]


def test_shares_sum_to_one_and_give_back_the_variance(posterior: object, found: dict[str, Budget]) -> None:
    """Nothing is divided by the sum: a source left out or counted twice would show."""
    table = lb.summarize(posterior)  # type: ignore[arg-type]
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


@pytest.mark.parametrize("arc_deg", [360.0, 300.0])
def test_every_source_alone(arc_deg: float) -> None:
    """The estimate as one dense matrix K of all readings: a source with covariance V of the readings leaves K V Kᵀ, the
    parameters' own deviation S from their prior (K H − 1) S (K H − 1)ᵀ. Truncation and unknown hyper-parameters set aside."""
    model = MODEL.without("truncation")
    planned = plan((30,) * 4, arc_deg=arc_deg, work_deg=40.0)
    bound = model.bind(planned)
    value = dict(zip(bound.hyper_prior.names, PHI, strict=True))
    turns = [basis(test.angles_rad()) for test in planned.tests]
    n = sum(map(len, turns))
    start = np.cumsum([0, *map(len, turns)])
    readings = {NOISE: np.eye(n) * value["sigma"] ** 2}
    for term in model.nuisances:
        covariance = np.zeros((n, n))
        for part in term.columns(bound.setting):
            if isinstance(part, Columns) and not part.private:
                sd = part.sd * (value[part.hyper] if part.hyper else 1.0)
                every = np.concatenate([own @ part.values[r] * sd for r, own in enumerate(turns)])
                covariance += every @ every.T
                continue
            for r, own in enumerate(turns):
                rows = slice(start[r], start[r + 1])
                columns = own * part.sd * value[part.hyper] if isinstance(part, BasisNoise) else own @ part.values[r] * part.sd
                covariance[rows, rows] += columns @ columns.T
        readings[type(term).__name__] = covariance
    readings = {name: covariance for name, covariance in readings.items() if covariance.any()}
    design = np.concatenate([own @ bound.interest[r] for r, own in enumerate(turns)])
    prior = bound.prior_sd**2
    estimate = np.linalg.solve(sum(readings.values()) + (design * prior) @ design.T, design * prior).T
    left = estimate @ design - np.eye(len(prior))
    parts = {name: np.diag(estimate @ covariance @ estimate.T) for name, covariance in readings.items()}
    parts[OWN] = np.diag((left * prior) @ left.T)
    total = sum(parts.values())
    information = information_of(bound, PHI)
    own = information.own
    covariance = information.covariance()[np.ix_(own, own)]
    np.testing.assert_allclose(np.diag(covariance) * information.scale[own] ** 2, total, rtol=1e-6)
    shares = information.shares(covariance)
    assert {term for _, term in shares} == set(parts)
    for name, expected in parts.items():
        share = sum((values for (_, term), values in shares.items() if term == name), np.zeros(len(own)))
        np.testing.assert_allclose(share, expected / total, atol=1e-6, err_msg=name)


def test_the_sign_of_a_sensitivity() -> None:
    """Every reading one micrometre longer: how the estimate of a gain moves is the sensitivity to the bar's length."""
    campaign = MODEL.simulate(plan(), seed=3, hyper_um=HYPER_UM).campaign
    longer = replace(campaign, tests=tuple(t.with_reading_um(np.asarray(t.reading_um) + 1.0) for t in campaign.tests))
    one, other = (MODEL.without("truncation").bind(c) for c in (campaign, longer))
    moved = other.given(PHI[None])[1].mean[0] - one.given(PHI[None])[1].mean[0]
    found = budgets(lb.sample(MODEL.without("truncation"), campaign, seed=1, sampler="independent"))
    line = next(x for x in found["E_XX1"].contributions if x.source == "bar_length")
    assert np.sign(line.sensitivity or 0.0) == np.sign(moved[one.names.index("E_XX1")])
    assert line.sensitivity == pytest.approx(moved[one.names.index("E_XX1")] / 1e-3, rel=0.1)
