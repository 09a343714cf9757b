"""What readings tell at given hyper-parameters: variances and their sources."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from campaigns import oracle_of, plan, refuses, simulated

import ldbb_bayes as lb
from ldbb_bayes.model.bound_information import information_of, informations_of
from ldbb_bayes.model.information import Information
from ldbb_bayes.model.terms.columns import NOISE, PARAMETERS

# σ, δ, κ and τ [mm].
PHI = np.array([0.3e-3, 0.5e-3, 0.3e-3, 2e-3])
PLANS = {
    "circles": plan(),
    "two balls": plan(work_deg=40.0, tool_deg=-25.0),
    "arcs": plan((9, 40, 12, 30), arc_deg=220.0),
}
MODEL = lb.HybridModel.first(1)


@pytest.mark.parametrize("name", PLANS)
def test_fixed_terms_leave_the_oracle(name: str) -> None:
    campaign = simulated(PLANS[name])
    information = information_of(MODEL.bind(campaign), PHI)
    oracle = oracle_of(campaign, 1, terms=("form", "mount", "setup", "discrepancy"))
    _, _, covariance = oracle.given(PHI)
    scale = information.scale[information.interest]
    variances = information.variances(["BarLength", "ForceError"]) * scale**2
    np.testing.assert_allclose(variances, np.diag(covariance), rtol=1e-5)


@pytest.mark.parametrize("name", PLANS)
def test_at_several_hyper_parameters(name: str) -> None:
    """One after the other as each alone; by the dense oracle at both."""
    campaign = simulated(PLANS[name])
    phi = np.array([PHI, PHI * [2.0, 0.5, 3.0, 0.7]])
    oracle = oracle_of(campaign, 1)
    informations = informations_of(MODEL.bind(campaign), phi)
    for phi_k, information in zip(phi, informations, strict=True):
        interest = information.interest
        scale = information.scale[interest]
        covariance = information.covariance()[np.ix_(interest, interest)] * np.outer(scale, scale)
        _, _, expected = oracle.given(phi_k)
        sd = np.sqrt(np.diag(expected))
        unit = np.outer(sd, sd)
        np.testing.assert_allclose(covariance / unit, expected / unit, atol=2e-6)


@pytest.mark.parametrize("fixed", [(), ("BarLength", "BallForm")])
def test_readings_taken_several_times_have_less_noise(fixed: tuple[str, ...]) -> None:
    information = information_of(MODEL.bind(PLANS["arcs"]), PHI)
    quieter_noise = []
    for sources in information.noise:
        quieter_noise.append({name: noise / 4.0 for name, noise in sources.items()})
    quieter = replace(information, noise=tuple(quieter_noise))
    repeated = np.diag(information.covariance(fixed, times=4.0))[information.interest]
    np.testing.assert_allclose(repeated, quieter.variances(fixed), rtol=1e-9)
    assert (repeated < information.variances(fixed)).all()


@pytest.mark.parametrize("name", PLANS)
def test_contributions_sum_to_one(name: str) -> None:
    shares = information_of(MODEL.bind(PLANS[name]), PHI).contributions()
    nuisances = {"BallForm", "BarLength", "Mount", "ForceError", "SetupShift", "Discrepancy"}
    assert set(shares) == {PARAMETERS, NOISE, *nuisances}
    np.testing.assert_allclose(np.sum(list(shares.values()), axis=0), 1.0, atol=1e-9)
    assert all((share > -1e-12).all() for share in shares.values())


def log_sd_with_bar_length(factor: float) -> np.ndarray:
    """ln sd of the parameters with the uncertainty of the bar's length times a factor."""
    nuisances = []
    for term in MODEL.nuisances:
        scaled = replace(term, sd_um=term.sd_um * factor) if hasattr(term, "sd_um") else term
        nuisances.append(scaled)
    bound = replace(MODEL, nuisances=tuple(nuisances)).bind(PLANS["arcs"])
    return 0.5 * np.log(information_of(bound, PHI).variances())


def log_sd_with_hyper(index: int, factor: float) -> np.ndarray:
    """ln sd of the parameters with one hyper-parameter times a factor."""
    phi = PHI.copy()
    phi[index] *= factor
    return 0.5 * np.log(information_of(MODEL.bind(PLANS["arcs"]), phi).variances())


STEP = 1e-4


@pytest.fixture(scope="module")
def contributions() -> dict[str, np.ndarray]:
    return information_of(MODEL.bind(PLANS["arcs"]), PHI).contributions()


def test_the_bar_length_contributes_its_logarithmic_derivative(
    contributions: dict[str, np.ndarray],
) -> None:
    higher = log_sd_with_bar_length(np.exp(STEP))
    lower = log_sd_with_bar_length(np.exp(-STEP))
    slope = (higher - lower) / (2 * STEP)
    np.testing.assert_allclose(contributions["BarLength"], slope, atol=2e-6)


@pytest.mark.parametrize(("term", "index"), [(NOISE, 0), ("SetupShift", 1), ("BallForm", 3)])
def test_a_scale_contributes_its_logarithmic_derivative(
    contributions: dict[str, np.ndarray], term: str, index: int
) -> None:
    higher = log_sd_with_hyper(index, np.exp(STEP))
    lower = log_sd_with_hyper(index, np.exp(-STEP))
    slope = (higher - lower) / (2 * STEP)
    np.testing.assert_allclose(contributions[term], slope, atol=2e-6)


ONE_READING_TWICE = Information(
    names=("a",),
    owners=(PARAMETERS,),
    scale=np.ones(1),
    flat=False,
    design=(np.ones((2, 1)),),
    noise=({NOISE: np.eye(2)},),
)


def test_two_readings_of_one_parameter() -> None:
    assert ONE_READING_TWICE.variances() == pytest.approx([1.0 / 3.0])


def test_noise_must_be_left() -> None:
    refuses("reading noise must be left", ONE_READING_TWICE.variances, [NOISE])


def test_scales_must_be_positive() -> None:
    refuses("prior sd must be positive", replace, ONE_READING_TWICE, scale=np.zeros(1))
