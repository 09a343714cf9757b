"""The structured likelihood against the dense oracle, and the symmetries that it must have."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from campaigns import HYPER_UM, oracle_of, plan, simulated
from oracle import Oracle

import ldbb_bayes as lb
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.likelihood import _group_equal_rows


def two_radii() -> Campaign:
    tests = []
    for test, radius in zip(plan().tests, (150, 100, 150, 100), strict=True):
        tests.append(replace(test, radius_mm=radius))
    return replace(plan(), tests=tuple(tests))


SAMPLINGS = {
    "uniform": plan((40, 40, 40, 40)),
    "uneven counts": plan((60, 30, 26, 45)),
    "arc": plan((40, 50, 60, 45), arc_deg=220.0, work_deg=40.0),
    "few on arc": plan((9, 30, 12, 25), arc_deg=220.0),
    "crowded, even, sparse at the seam": plan((75, 90, 120, 85), arc_deg=356.0),
    "both balls": plan((9, 30, 40, 25), work_deg=40.0, tool_deg=-25.0),
    "raw": plan(compensated=False),
    "repeated forces": plan(forces_N=(300.0, 300.0, 742.0, 742.0), compensated=False),
    "two radii": two_radii(),
}
LINEAR = lb.HybridModel.first(1)


class Points(NamedTuple):
    """Hyper-parameters and parameters."""

    phi: np.ndarray
    beta: np.ndarray


def points(bound: BoundModel, size: int = 3, seed: int = 0) -> Points:
    rng = np.random.default_rng(seed)
    scale = [HYPER_UM[str(name)] * 1e-3 for name in bound.hyper_prior.names]
    phi = np.exp(rng.normal(np.log(scale), 0.4, (size, len(scale))))
    beta = bound.least_squares_estimate + 0.1 * bound.scale * rng.normal(
        size=(size, len(bound.names))
    )
    return Points(phi, beta)


def dense_log_likelihood(oracle: Oracle, phi: np.ndarray, beta: np.ndarray) -> list[float]:
    return [oracle.log_likelihood(phi[k], beta[k]) for k in range(len(phi))]


@pytest.mark.parametrize("degree", [0, 1, 2])
@pytest.mark.parametrize("sampling", SAMPLINGS)
def test_against_the_dense_oracle(sampling: str, degree: int) -> None:
    campaign = simulated(SAMPLINGS[sampling])
    bound = lb.HybridModel.first(degree).bind(campaign)
    oracle = oracle_of(campaign, degree)
    assert list(bound.names) == oracle.names
    estimate_error = bound.setting.compliance_estimate - oracle.estimate[:6]
    np.testing.assert_allclose(estimate_error / oracle.sd[:6], 0.0, atol=1e-9)
    phi, beta = points(bound)
    expected = dense_log_likelihood(oracle, phi, beta)
    np.testing.assert_allclose(bound.log_likelihood(phi, beta), expected, atol=1e-5)
    log_evidence, conditional = bound.given(phi)
    covariances = conditional.covariance
    unit = np.outer(oracle.sd, oracle.sd)
    for k in range(len(phi)):
        value, mean, covariance = oracle.given(phi[k])
        assert log_evidence[k] == pytest.approx(value, abs=1e-5)
        np.testing.assert_allclose((conditional.mean[k] - mean) / oracle.sd, 0.0, atol=1e-8)
        np.testing.assert_allclose((covariances[k] - covariance) / unit, 0.0, atol=1e-8)
    log_prior = bound.hyper_prior.log_density(phi) + np.log(phi).sum(axis=1)
    expected_prior = [oracle.log_prior_of_log(np.log(phi_k)) for phi_k in phi]
    np.testing.assert_allclose(log_prior, expected_prior, atol=1e-9)
    np.testing.assert_array_equal(bound.truncation.holds(beta), oracle.inside(beta))


@pytest.mark.parametrize("degree", [0, 1])
def test_flat_priors_integrate_to_the_formula(degree: int) -> None:
    """ln ∫ N(y; J β, σ² I) dβ = −½ rss/σ² − ½ (n − p) ln(2π σ²) − ½ ln det JᵀJ.

    β in inside units, the constants included.
    """
    campaign = simulated(plan((30, 35, 40, 45)))
    bound = lb.HybridModel.paper(degree).bind(campaign)
    oracle = oracle_of(campaign, degree, terms=())
    scale = np.linalg.norm(oracle.J, axis=0)
    unit_columns = oracle.J / scale
    solution, square, *_ = np.linalg.lstsq(unit_columns, oracle.y, rcond=None)
    freedom = len(oracle.y) - len(solution)
    log_determinant = np.linalg.slogdet(unit_columns.T @ unit_columns)[1]
    volume = 0.5 * log_determinant + np.log(scale).sum()
    sigma = np.array([2e-4, 1e-3])
    expected = -0.5 * square / sigma**2 - 0.5 * freedom * np.log(2 * np.pi * sigma**2) - volume
    log_evidence, conditional = bound.given(sigma[:, None])
    np.testing.assert_allclose(log_evidence, expected, atol=1e-6)
    np.testing.assert_allclose(bound.log_evidence(sigma[:, None]), expected, atol=1e-6)
    tolerance = 1e-9 * np.abs(solution).max()
    np.testing.assert_allclose(conditional.mean * scale, np.tile(solution, (2, 1)), atol=tolerance)


@pytest.mark.parametrize("sampling", ["uniform", "arc", "both balls"])
def test_start_angle_and_whole_turns_do_not_matter(sampling: str) -> None:
    campaign = simulated(SAMPLINGS[sampling])
    turned = []
    for i, test in enumerate(campaign.tests):
        turned.append(
            replace(
                test,
                angle_deg=np.roll(test.angle_deg, 7) + 360.0 * (i - 1),
                reading_um=np.roll(test.reading_um, 7),
                work_ball_deg=test.work_ball_deg + 360.0,
            )
        )
    bound = LINEAR.bind(campaign)
    phi = np.array([[0.3e-3, 0.5e-3, 0.4e-3, 2e-3]])
    log_evidence, conditional = bound.given(phi)
    turned_evidence, turned_conditional = LINEAR.bind(replace(campaign, tests=tuple(turned))).given(
        phi
    )
    np.testing.assert_allclose(turned_evidence, log_evidence, atol=1e-5)
    difference = turned_conditional.mean - conditional.mean
    np.testing.assert_allclose(difference / bound.prior_sd, 0.0, atol=1e-5)


def assert_finite(bound: BoundModel) -> None:
    phi, beta = points(bound)
    log_evidence, conditional = bound.given(phi)
    assert np.isfinite(log_evidence).all()
    assert np.isfinite(conditional.mean).all()
    assert np.isfinite(bound.log_likelihood(phi, beta)).all()


def without_pressure() -> Campaign:
    """Its mount has no column."""
    tests = [replace(test, pressure_bar=0.0) for test in plan().tests]
    return simulated(replace(plan(), tests=tuple(tests)))


def dead_circles() -> Campaign:
    """They have no force error."""
    tests = [test.with_reading_um(np.zeros(40)) for test in plan().tests]
    return replace(plan(), tests=tuple(tests))


@pytest.mark.parametrize("campaign", [without_pressure(), dead_circles()])
def test_columns_of_zeros_do_no_harm(campaign: Campaign) -> None:
    bound = LINEAR.bind(campaign)
    assert_finite(bound)
    phi, beta = points(bound)
    expected = dense_log_likelihood(oracle_of(campaign, 1), phi, beta)
    np.testing.assert_allclose(bound.log_likelihood(phi, beta), expected, atol=1e-5)


def test_a_test_at_the_reference_force_has_no_slope_columns() -> None:
    campaign = simulated(plan((40,) * 3, forces_N=(100.0, 300.0, 500.0)))
    assert_finite(LINEAR.bind(campaign).keeping(["f300"]))


@pytest.mark.parametrize("members", [slice(0, 1), slice(3, 16), slice(500, 700)])
@pytest.mark.parametrize("sampling", ["uniform", "arc", "crowded, even, sparse at the seam"])
def test_results_do_not_depend_on_the_stack(sampling: str, members: slice) -> None:
    """One φ alone, and any number of them in several passes."""
    bound = LINEAR.bind(simulated(SAMPLINGS[sampling]))
    phi, beta = points(bound, 700)
    log_evidence = bound.log_evidence(phi)
    log_likelihood = bound.log_likelihood(phi, beta)
    mean = bound.given(phi)[1].mean
    np.testing.assert_allclose(bound.log_evidence(phi[members]), log_evidence[members], rtol=1e-12)
    np.testing.assert_allclose(
        bound.log_likelihood(phi[members], beta[members]), log_likelihood[members], rtol=1e-12
    )
    difference = bound.given(phi[members])[1].mean - mean[members]
    np.testing.assert_allclose(difference / bound.scale, 0.0, atol=1e-11)


def test_prior_sd_of_zero_and_scales_of_zero_are_no_column_at_all() -> None:
    """A mount that does not yield, and a ball without form, to all digits.

    The other columns have widely spread units.
    """
    campaign = simulated(plan())
    bound = LINEAR.bind(campaign)
    phi, beta = points(bound)
    phi[:, bound.hyper_prior.names.index("tau")] = 0.0
    bound.setting = replace(bound.setting, deflection_um_per_bar=0.0)
    smaller = LINEAR.without("ball-form", "mount").bind(campaign)
    common = [bound.hyper_prior.names.index(name) for name in smaller.hyper_prior.names]
    smaller_phi = phi[:, common]
    np.testing.assert_allclose(
        bound.log_likelihood(phi, beta), smaller.log_likelihood(smaller_phi, beta), rtol=1e-12
    )
    np.testing.assert_allclose(
        bound.log_evidence(phi), smaller.log_evidence(smaller_phi), rtol=1e-12
    )
    conditional = bound.given(phi)[1]
    expected = smaller.given(smaller_phi)[1]
    np.testing.assert_allclose(conditional.covariance, expected.covariance, rtol=1e-6)
    difference = conditional.mean - expected.mean
    np.testing.assert_allclose(difference / bound.scale, 0.0, atol=1e-9)


def test_equal_rows_form_one_group_and_groups_are_in_the_order_of_their_rows() -> None:
    values = np.array([[2.0, 0.0], [1.0, 3.0], [2.0, -0.0], [1.0, -3.0], [1.0, 3.0]])
    first, group = _group_equal_rows(values)
    assert first.tolist() == [3, 1, 0]
    assert group.tolist() == [2, 1, 2, 0, 1]


def test_groups_of_equal_rows_are_those_of_numpy(rng: np.random.Generator) -> None:
    values = rng.integers(-1, 2, (500, 4)) * 0.1
    first, group = _group_equal_rows(values)
    _, expected_first, expected_group = np.unique(
        values, axis=0, return_index=True, return_inverse=True
    )
    np.testing.assert_array_equal(first, expected_first)
    np.testing.assert_array_equal(group, expected_group.ravel())
