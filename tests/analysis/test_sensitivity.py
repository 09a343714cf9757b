"""Slope subsets: probabilities that sum, inclusion by hand, and C(F) as its pieces have it."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from campaigns import HYPER_UM, TRUTH, plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.analysis import sensitivity
from ldbb_bayes.analysis.sensitivity import SlopeSubsets, _best_first, count_subsets, slope_subsets
from ldbb_bayes.inference.evidence import Evidences, probabilities
from ldbb_bayes.inference.nodes import HyperPosterior

FREE = ("C_XYX", "C_CCY")
LINEAR = lb.HybridModel.default(1).without("truncation").fixing(*(f"{name}_1" for name in ("C_XXX", "C_YYY", "C_CXY", "C_CYY")))


@pytest.fixture(scope="module")
def campaign() -> lb.Campaign:
    return simulated(plan(), seed=1)


@pytest.fixture(scope="module")
def found(campaign: lb.Campaign) -> SlopeSubsets:
    return slope_subsets(LINEAR, Evidences(campaign, tolerance=1e-2), quadratic=False, seed=1)


def test_every_subset_once(found: SlopeSubsets, campaign: lb.Campaign) -> None:
    assert {subset.varying for subset in found.subsets} == {(), FREE[:1], FREE[1:], FREE}
    assert count_subsets(LINEAR, Evidences(campaign, tolerance=1e-2), quadratic=False) == 4
    assert sum(subset.probability for subset in found.subsets) == pytest.approx(1.0)
    assert [s.probability for s in found.subsets] == sorted((s.probability for s in found.subsets), reverse=True)
    for name in FREE:
        share = sum(subset.probability for subset in found.subsets if name in subset.varying)
        assert found.slopes[name].inclusion_probability == pytest.approx(share)


def test_probabilities_are_those_of_the_evidences(found: SlopeSubsets, campaign: lb.Campaign) -> None:
    by_hand = {}
    for subset in found.subsets:
        model = LINEAR.fixing(*(f"{name}_1" for name in FREE if name not in subset.varying))
        by_hand[subset.varying] = lb.log_evidence(model, campaign, tolerance=5e-3).log_value
        assert subset.log_evidence == pytest.approx(by_hand[subset.varying], abs=5e-3)
    share = probabilities(np.array(list(by_hand.values())))
    np.testing.assert_allclose([subset.probability for subset in found.subsets], share, atol=5e-3)


def test_averaged_compliance(found: SlopeSubsets, campaign: lb.Campaign) -> None:
    """E[C(F)] = Σ P(subset) E[C(F) | subset]; a compliance without a slope has a flat band."""
    curve = found.curves["C_XYX"]
    means = np.zeros(2)
    for subset in found.subsets:
        model = LINEAR.fixing(*(f"{name}_1" for name in FREE if name not in subset.varying))
        nodes = HyperPosterior(model.bind(campaign), truncated=False).nodes(1e-2)
        mean = dict(zip(nodes.bound.names, nodes.moments()[0], strict=True))
        means += subset.probability * (mean["C_XYX"] + mean.get("C_XYX_1", 0.0) * np.array([-353.0, 353.0]))
    sd = (curve.high - curve.low)[[0, -1]] / 4.0
    np.testing.assert_allclose(curve.mean[[0, -1]] / sd, means / sd, atol=0.08)
    assert np.all(curve.low < curve.mean)
    assert np.all(curve.mean < curve.high)
    flat = found.curves["C_XXX"]
    assert np.ptp(flat.mean) == pytest.approx(0.0, abs=1e-18)


def test_a_slope_that_is_there_is_found() -> None:
    truth = TRUTH | {"C_XYX_1": 1.5e-8}
    campaign = lb.HybridModel.default(1).simulate(plan(), seed=3, parameters=truth, hyper_um=HYPER_UM).campaign
    found = slope_subsets(LINEAR, Evidences(campaign, tolerance=1e-2), quadratic=False, seed=1)
    assert found.slopes["C_XYX"].inclusion_probability > 0.95 > found.slopes["C_CCY"].inclusion_probability


def test_quadratic_on_request() -> None:
    """Constant, linear or quadratic for every compliance; a parabola that is there is found."""
    model = lb.HybridModel.default(2).without("truncation")
    model = model.fixing(*(f"{name}_{k}" for name in ("C_XXX", "C_YYY", "C_CXY", "C_CYY", "C_CCY") for k in (1, 2)))
    truth, quiet = TRUTH | {"C_XYX_2": 2e-11}, {"sigma": 0.1, "delta": 0.1, "kappa": 0.03, "tau": 2.0}
    planned = plan((30,) * 5, forces_N=(36.0, 200.0, 400.0, 600.0, 742.0))
    campaign = model.simulate(planned, seed=2, parameters=truth, hyper_um=quiet).campaign
    evidences = Evidences(campaign, tolerance=1e-2)
    found = slope_subsets(model, evidences, quadratic=True, seed=1)
    assert sorted(subset.powers["C_XYX"] for subset in found.subsets) == [0, 1, 2]
    assert (found.slopes["C_XYX"].quadratic_probability or 0.0) > 0.9
    together = slope_subsets(model, evidences, quadratic=False, seed=1)
    assert len(together.subsets) == 2
    assert together.slopes["C_XYX"].quadratic_probability is None


def test_too_many_subsets_are_searched_from_the_best() -> None:
    """15 compliances of known, independent evidence: 100 of 32768 sets hold the best and most of the probability."""
    gain = np.array([3.0, -4.0, 2.5, -3.0, -5.0, 1.5, -2.0, -6.0, -3.5, -4.5, -2.5, -3.0, 4.0, -5.5, -4.0])

    def of(powers: tuple[int, ...]) -> SimpleNamespace:
        return SimpleNamespace(evidence=SimpleNamespace(log_value=float(gain @ np.array(powers))))

    found = _best_first([(0, 1)] * 15, of)  # type: ignore[arg-type]
    assert len(found) == 100
    assert max(found, key=lambda powers: found[powers].evidence.log_value) == tuple((gain > 0).astype(int))
    log_total = np.log1p(np.exp(gain)).sum()
    share = np.exp([one.evidence.log_value for one in found.values()]) / np.exp(log_total)
    assert share.sum() > 0.8
    inclusion = probabilities(np.array([one.evidence.log_value for one in found.values()])) @ np.array(list(found))
    np.testing.assert_allclose(inclusion, 1.0 / (1.0 + np.exp(-gain)), atol=0.05)


def test_the_search_visits_every_subset_of_few(
    campaign: lb.Campaign, monkeypatch: pytest.MonkeyPatch, found: SlopeSubsets
) -> None:
    monkeypatch.setattr(sensitivity, "_EVERY", 1)
    searched = slope_subsets(LINEAR, Evidences(campaign, tolerance=1e-2), quadratic=False, seed=1)
    assert {s.varying for s in searched.subsets} == {s.varying for s in found.subsets}
    for name, slope in searched.slopes.items():
        assert slope.inclusion_probability == pytest.approx(found.slopes[name].inclusion_probability)
    assert searched.possible == 4
