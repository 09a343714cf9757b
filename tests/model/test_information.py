"""Posterior covariance of all coefficients at given hyper-parameters, by the oracle, by closed forms and by differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from campaigns import oracle_of, plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.errors import InputError
from ldbb_bayes.model.hybrid import information_of, informations_of
from ldbb_bayes.model.likelihood import NOISE, OWN, Information

PHI = np.array([0.3e-3, 0.5e-3, 0.3e-3, 2e-3])
PLANS = {"circles": plan(), "two balls": plan(work_deg=40.0, tool_deg=-25.0), "arcs": plan((9, 40, 12, 30), arc_deg=220.0)}


@pytest.mark.parametrize("name", PLANS)
def test_known_terms_leave_the_oracle(name: str) -> None:
    campaign = simulated(PLANS[name])
    information = information_of(lb.HybridModel.first(1).bind(campaign), PHI)
    expected = np.diag(oracle_of(campaign, 1, terms=("form", "mount", "setup", "discrepancy")).given(PHI)[2])
    scale = information.scale[information.own]
    np.testing.assert_allclose(information.variances(["BarLength", "ForceError"]) * scale**2, expected, rtol=1e-5)


@pytest.mark.parametrize("name", PLANS)
def test_at_several_hyper_parameters(name: str) -> None:
    """One after the other as each alone; by the dense oracle at both."""
    campaign = simulated(PLANS[name])
    several = np.array([PHI, PHI * [2.0, 0.5, 3.0, 0.7]])
    for phi, information in zip(several, informations_of(lb.HybridModel.first(1).bind(campaign), several), strict=True):
        scale = information.scale[information.own]
        found = information.covariance()[np.ix_(information.own, information.own)] * np.outer(scale, scale)
        expected = oracle_of(campaign, 1).given(phi)[2]
        sd = np.sqrt(np.diag(expected))
        np.testing.assert_allclose(found / np.outer(sd, sd), expected / np.outer(sd, sd), atol=2e-6)


@pytest.mark.parametrize("known", [(), ("BarLength", "BallForm")])
def test_readings_taken_several_times_have_less_noise(known: tuple[str, ...]) -> None:
    information = information_of(lb.HybridModel.first(1).bind(PLANS["arcs"]), PHI)
    quieter = replace(information, noise=tuple({name: part / 4.0 for name, part in own.items()} for own in information.noise))
    found = information.variances(known, times=4.0)
    np.testing.assert_allclose(found, quieter.variances(known), rtol=1e-9)
    assert (found < information.variances(known)).all()


@pytest.mark.parametrize("name", PLANS)
def test_contributions_sum_to_one(name: str) -> None:
    parts = information_of(lb.HybridModel.first(1).bind(PLANS[name]), PHI).contributions()
    assert set(parts) == {OWN, NOISE, "BallForm", "BarLength", "Mount", "ForceError", "SetupShift", "Discrepancy"}
    np.testing.assert_allclose(np.sum(list(parts.values()), axis=0), 1.0, atol=1e-9)
    assert all((share > -1e-12).all() for share in parts.values())


@pytest.mark.parametrize("name", ["arcs"])
@pytest.mark.parametrize("term", ["BarLength", "SetupShift", NOISE, "BallForm"])
def test_contributions_are_logarithmic_derivatives(name: str, term: str) -> None:
    model = lb.HybridModel.first(1)
    bound = model.bind(PLANS[name])
    step = 1e-4

    def log_sd(factor: float) -> np.ndarray:
        if term == "BarLength":
            terms = tuple(replace(t, sd_um=t.sd_um * factor) if hasattr(t, "sd_um") else t for t in model.nuisances)
            return 0.5 * np.log(information_of(replace(model, nuisances=terms).bind(PLANS[name]), PHI).variances())
        index = {NOISE: 0, "SetupShift": 1, "BallForm": 3}[term]
        return 0.5 * np.log(information_of(bound, PHI * np.where(np.arange(4) == index, factor, 1.0)).variances())

    slope = (log_sd(np.exp(step)) - log_sd(np.exp(-step))) / (2 * step)
    np.testing.assert_allclose(information_of(bound, PHI).contributions()[term], slope, atol=2e-6)


def test_noise_must_be_left_and_scales_positive() -> None:
    one = Information(("a",), (OWN,), np.ones(1), False, (np.ones((2, 1)),), ({NOISE: np.eye(2)},))
    assert one.variances() == pytest.approx([1.0 / 3.0])
    with pytest.raises(InputError, match="reading noise must be left"):
        one.variances([NOISE])
    with pytest.raises(InputError, match="prior sd must be positive"):
        replace(one, scale=np.zeros(1))
