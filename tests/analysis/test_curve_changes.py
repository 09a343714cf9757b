"""Verdicts on the change of compliances with force, against slopes and plain formulas."""

from __future__ import annotations

import numpy as np
import pytest

import ldbb_bayes as lb
from ldbb_bayes.analysis.curve_changes import curve_changes
from ldbb_bayes.model.bound_information import information_of

FORCES_N = (36.0, 238.0, 364.0, 490.0, 616.0, 742.0)
SPAN_N = 706.0
MIDDLE_N = 389.0
LARGEST_N = 742.0
LINEAR = lb.HybridModel.default(1)
NO_JOINT_LOAD = ("C_XYX", "C_CXY", "C_CYY", "C_CCY")


def plan(*forces_N: float) -> lb.Campaign:
    angle_deg = np.arange(0.0, 360.0, 5.0)
    return lb.Campaign(tuple(lb.CircularTest(force_N, angle_deg) for force_N in forces_N))


@pytest.fixture(scope="module")
def identified() -> lb.analysis.Identifiability:
    return lb.identify(LINEAR, plan(*FORCES_N))


@pytest.fixture(scope="module")
def measured() -> lb.analysis.Identifiability:
    """Verdicts after readings; the expected sd of a plan's parameter is that of its forecast."""
    return lb.identify(LINEAR, LINEAR.simulate(plan(*FORCES_N), seed=1).campaign)


@pytest.mark.parametrize("name", NO_JOINT_LOAD)
def test_without_joint_load_the_change_is_judged_as_its_slope(
    measured: lb.analysis.Identifiability, name: str
) -> None:
    slope = measured.parameters[f"{name}_1"]
    change = measured.changes[name]
    assert change.sd == pytest.approx(slope.sd * SPAN_N, rel=1e-9)
    assert change.prior_sd == pytest.approx(slope.prior_sd * SPAN_N, rel=1e-9)
    assert change.verdict == slope.verdict
    assert change.held_by.name == slope.held_by.name
    assert change.held_by.share == pytest.approx(slope.held_by.share, rel=1e-9)
    assert change.origin_shares == pytest.approx(slope.origin_shares, abs=1e-9)
    assert (change.remedy is None) == (slope.remedy is None)
    if change.remedy is not None and slope.remedy is not None:
        assert change.remedy.kind == slope.remedy.kind
        assert change.remedy.ratio == pytest.approx(slope.remedy.ratio, rel=1e-9)


def force_law(law: str, force_N: float) -> float:
    """Return what one unit of a coefficient of `JointLoad` adds to a compliance at one force."""
    if law == "slope":
        return (force_N - MIDDLE_N) / LARGEST_N
    return float(np.cbrt(MIDDLE_N / force_N)) - 1.0


@pytest.mark.parametrize("axis", ["X", "Y"])
def test_the_joint_load_is_in_the_change_of_a_direct_compliance(
    identified: lb.analysis.Identifiability, axis: str
) -> None:
    """The dense posterior covariance (1 + AᵀA)⁻¹, times weights written by hand."""
    bound = LINEAR.bind(plan(*FORCES_N))
    phi = bound.hyper_prior.quantile(np.full((1, len(bound.hyper_prior.names)), 0.5))[0]
    information = information_of(bound, phi)
    rows = information.rows()
    covariance = np.linalg.inv(np.eye(rows.shape[1]) + rows.T @ rows)
    by_name = {f"C_{axis}{axis}{axis}_1": SPAN_N}
    for law in ("slope", "contact", "seat"):
        difference = force_law(law, LARGEST_N) - force_law(law, FORCES_N[0])
        by_name[f"joint_load_{axis}_{law}"] = difference
    weights = np.array([by_name.get(name, 0.0) for name in information.names])
    weights *= information.scale
    change = identified.changes[f"C_{axis}{axis}{axis}"]
    assert change.sd == pytest.approx(np.sqrt(weights @ covariance @ weights), rel=1e-6)
    assert change.prior_sd == pytest.approx(np.linalg.norm(weights), rel=1e-9)


def test_shares_sum_to_one(identified: lb.analysis.Identifiability) -> None:
    for change in identified.changes.values():
        assert sum(change.origin_shares.values()) == pytest.approx(1.0, abs=1e-9)


def test_constant_compliance_changes_by_the_joint_load_alone() -> None:
    identified = lb.identify(lb.HybridModel.default(0), plan(*FORCES_N))
    assert list(identified.changes) == ["C_XXX", "C_YYY"]
    assert "Parameters" not in {change.held_by.name for change in identified.changes.values()}


def test_at_one_force_nothing_changes() -> None:
    bound = lb.HybridModel.default(0).bind(plan(200.0, 200.0))
    phi = bound.hyper_prior.quantile(np.full((1, len(bound.hyper_prior.names)), 0.5))[0]
    assert curve_changes(bound, information_of(bound, phi)) == {}
