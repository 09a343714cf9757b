"""The structured likelihood against the dense oracle, and the symmetries it must have; readings
reduced to at most 25 numbers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from campaigns import HYPER_UM, oracle_of, plan, refuses, simulated
from hypothesis import given as drawn
from hypothesis import strategies as st

import ldbb_bayes as lb
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.model.fourier import SIZE, basis
from ldbb_bayes.model.hybrid import BoundModel, information_of, informations_of
from ldbb_bayes.model.information import Information
from ldbb_bayes.model.reduction import reduce_readings
from ldbb_bayes.model.terms import NOISE, OWN

SAMPLINGS = {
    "uniform": plan((40, 40, 40, 40)),
    "uneven counts": plan((60, 30, 26, 45)),
    "arc": plan((40, 50, 60, 45), arc_deg=220.0, work_deg=40.0),
    "few on arc": plan((9, 30, 12, 25), arc_deg=220.0),
    "crowded, even, sparse at the seam": plan((75, 90, 120, 85), arc_deg=356.0),
    "both balls": plan((9, 30, 40, 25), work_deg=40.0, tool_deg=-25.0),
    "raw": plan(compensated=False),
    "repeated forces": plan(forces_N=(300.0, 300.0, 742.0, 742.0), compensated=False),
    "two radii": replace(
        plan(),
        tests=tuple(
            replace(t, radius_mm=r) for t, r in zip(plan().tests, (150, 100, 150, 100), strict=True)
        ),
    ),
}


def points(bound: BoundModel, size: int = 3, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    scale = [HYPER_UM[str(name)] * 1e-3 for name in bound.hyper_prior.names]
    phi = np.exp(rng.normal(np.log(scale), 0.4, (size, len(scale))))
    return phi, bound.centre + 0.1 * bound.scale * rng.normal(size=(size, len(bound.names)))


@pytest.mark.parametrize("degree", [0, 1, 2])
@pytest.mark.parametrize("sampling", SAMPLINGS)
def test_against_the_dense_oracle(sampling: str, degree: int) -> None:
    campaign = simulated(SAMPLINGS[sampling])
    bound = lb.HybridModel.first(degree).bind(campaign)
    oracle = oracle_of(campaign, degree)
    assert list(bound.names) == oracle.names
    np.testing.assert_allclose(
        bound.setting.compliance_estimate / oracle.sd[:6],
        oracle.estimate[:6] / oracle.sd[:6],
        atol=1e-9,
    )
    phi, beta = points(bound)
    expected = [oracle.log_likelihood(p, b) for p, b in zip(phi, beta, strict=True)]
    np.testing.assert_allclose(bound.log_likelihood(phi, beta), expected, atol=1e-5)
    log_evidence, given = bound.given(phi)
    mean = given.mean
    spread = given.spread()
    for k, p in enumerate(phi):
        value, oracle_mean, covariance = oracle.given(p)
        assert log_evidence[k] == pytest.approx(value, abs=1e-5)
        np.testing.assert_allclose((mean[k] - oracle_mean) / oracle.sd, 0.0, atol=1e-8)
        np.testing.assert_allclose(
            (spread[k] @ spread[k].T - covariance) / np.outer(oracle.sd, oracle.sd), 0.0, atol=1e-8
        )
    prior = [oracle.log_prior_of_log(np.log(p)) for p in phi]
    np.testing.assert_allclose(
        bound.hyper_prior.log_density(phi) + np.log(phi).sum(axis=1), prior, atol=1e-9
    )
    np.testing.assert_array_equal(bound.truncation.holds(beta), oracle.inside(beta))


@pytest.mark.parametrize("degree", [0, 1])
def test_flat_priors_integrate_to_the_formula(degree: int) -> None:
    """ln ∫ N(y; J β, σ² I) dβ = −½ rss/σ² − ½ (n − p) ln(2π σ²) − ½ ln det JᵀJ, β in inside units,
    its constants included."""
    campaign = simulated(plan((30, 35, 40, 45)))
    bound = lb.HybridModel.paper(degree).bind(campaign)
    oracle = oracle_of(campaign, degree, terms=())
    scale = np.linalg.norm(oracle.J, axis=0)
    solution, square, *_ = np.linalg.lstsq(oracle.J / scale, oracle.y, rcond=None)
    free = len(oracle.y) - len(solution)
    volume = (
        0.5 * np.linalg.slogdet((oracle.J / scale).T @ (oracle.J / scale))[1] + np.log(scale).sum()
    )
    sigma = np.array([2e-4, 1e-3])
    expected = -0.5 * square / sigma**2 - 0.5 * free * np.log(2 * np.pi * sigma**2) - volume
    found, given = bound.given(sigma[:, None])
    np.testing.assert_allclose(found, expected, atol=1e-6)
    np.testing.assert_allclose(bound.log_evidence(sigma[:, None]), expected, atol=1e-6)
    np.testing.assert_allclose(
        given.mean * scale, np.tile(solution, (2, 1)), atol=1e-9 * np.abs(solution).max()
    )


def everything(campaign: Campaign, degree: int = 1) -> tuple[np.ndarray, np.ndarray]:
    bound = lb.HybridModel.first(degree).bind(campaign)
    log_evidence, given = bound.given(np.array([[0.3e-3, 0.5e-3, 0.4e-3, 2e-3]]))
    return log_evidence, given.mean[0] / bound.prior_sd


def assert_same(
    first: tuple[np.ndarray, np.ndarray], second: tuple[np.ndarray, np.ndarray], atol: float = 1e-6
) -> None:
    for a, b in zip(first, second, strict=True):
        np.testing.assert_allclose(a, b, atol=atol)


@pytest.mark.parametrize("sampling", ["uniform", "arc", "both balls"])
def test_start_angle_and_whole_turns_do_not_matter(sampling: str) -> None:
    campaign = simulated(SAMPLINGS[sampling])
    turned = tuple(
        replace(
            test,
            angle_deg=np.roll(test.angle_deg, 7) + 360.0 * (i - 1),
            reading_um=np.roll(test.reading_um, 7),
            work_ball_deg=test.work_ball_deg + 360.0,
        )
        for i, test in enumerate(campaign.tests)
    )
    assert_same(everything(campaign), everything(replace(campaign, tests=turned)), atol=1e-5)


def test_columns_of_zeros_do_no_harm() -> None:
    """A bar without pressure has no mount column; a test at F0 alone has no slope columns; dead
    circles have no force error."""
    planned = replace(plan(), tests=tuple(replace(t, pressure_bar=0.0) for t in plan().tests))
    dead = replace(plan(), tests=tuple(t.with_reading_um(np.zeros(40)) for t in plan().tests))
    middle = simulated(plan((40,) * 3, forces_N=(100.0, 300.0, 500.0)))
    for campaign, keep in ((simulated(planned), None), (dead, None), (middle, ["f300"])):
        bound = lb.HybridModel.first(1).bind(campaign)
        bound = bound.keeping(keep) if keep else bound
        phi, beta = points(bound)
        log_evidence, given = bound.given(phi)
        assert all(
            np.isfinite(own).all()
            for own in (log_evidence, given.mean, bound.log_likelihood(phi, beta))
        )
        if not keep:
            oracle = oracle_of(campaign, 1)
            expected = [oracle.log_likelihood(p, b) for p, b in zip(phi, beta, strict=True)]
            np.testing.assert_allclose(bound.log_likelihood(phi, beta), expected, atol=1e-5)


@pytest.mark.parametrize("sampling", ["uniform", "arc", "crowded, even, sparse at the seam"])
def test_results_do_not_depend_on_the_stack(sampling: str) -> None:
    """One φ alone, and any number of them in several passes."""
    bound = lb.HybridModel.first(1).bind(simulated(SAMPLINGS[sampling]))
    phi, beta = points(bound, 700)
    together = bound.log_evidence(phi), bound.log_likelihood(phi, beta)
    given = bound.given(phi)[1]
    for part in (slice(0, 1), slice(3, 16), slice(500, 700)):
        alone = bound.log_evidence(phi[part]), bound.log_likelihood(phi[part], beta[part])
        for one, whole in zip(alone, together, strict=True):
            np.testing.assert_allclose(one, whole[part], rtol=1e-12)
        np.testing.assert_allclose(
            bound.given(phi[part])[1].mean / bound.scale,
            given.mean[part] / bound.scale,
            rtol=0,
            atol=1e-11,
        )


def test_prior_sd_of_zero_and_scales_of_zero_are_no_column_at_all() -> None:
    """A mount that does not yield, and a ball without form, to all digits; widely spread units of
    the others."""
    campaign = simulated(plan())
    bound = lb.HybridModel.first(1).bind(campaign)
    phi, beta = points(bound)
    phi[:, bound.hyper_prior.names.index("tau")] = 0.0
    rigid = replace(bound.setting, deflection_um_per_bar=0.0)
    bound.setting = rigid
    less = lb.HybridModel.first(1).without("ball-form", "mount").bind(campaign)
    kept = [bound.hyper_prior.names.index(name) for name in less.hyper_prior.names]
    np.testing.assert_allclose(
        bound.log_likelihood(phi, beta), less.log_likelihood(phi[:, kept], beta), rtol=1e-12
    )
    np.testing.assert_allclose(bound.log_evidence(phi), less.log_evidence(phi[:, kept]), rtol=1e-12)
    given, expected = bound.given(phi)[1], less.given(phi[:, kept])[1]
    np.testing.assert_allclose(given.covariance, expected.covariance, rtol=1e-6)
    np.testing.assert_allclose(given.mean / bound.scale, expected.mean / bound.scale, atol=1e-9)


PHI = np.array([0.3e-3, 0.5e-3, 0.3e-3, 2e-3])
PLANS = {
    "circles": plan(),
    "two balls": plan(work_deg=40.0, tool_deg=-25.0),
    "arcs": plan((9, 40, 12, 30), arc_deg=220.0),
}


@pytest.mark.parametrize("name", PLANS)
def test_known_terms_leave_the_oracle(name: str) -> None:
    campaign = simulated(PLANS[name])
    information = information_of(lb.HybridModel.first(1).bind(campaign), PHI)
    expected = np.diag(
        oracle_of(campaign, 1, terms=("form", "mount", "setup", "discrepancy")).given(PHI)[2]
    )
    scale = information.scale[information.interest]
    np.testing.assert_allclose(
        information.variances(["BarLength", "ForceError"]) * scale**2, expected, rtol=1e-5
    )


@pytest.mark.parametrize("name", PLANS)
def test_at_several_hyper_parameters(name: str) -> None:
    """One after the other as each alone; by the dense oracle at both."""
    campaign = simulated(PLANS[name])
    several = np.array([PHI, PHI * [2.0, 0.5, 3.0, 0.7]])
    for phi, information in zip(
        several, informations_of(lb.HybridModel.first(1).bind(campaign), several), strict=True
    ):
        scale = information.scale[information.interest]
        found = information.covariance()[
            np.ix_(information.interest, information.interest)
        ] * np.outer(scale, scale)
        expected = oracle_of(campaign, 1).given(phi)[2]
        sd = np.sqrt(np.diag(expected))
        np.testing.assert_allclose(found / np.outer(sd, sd), expected / np.outer(sd, sd), atol=2e-6)


@pytest.mark.parametrize("known", [(), ("BarLength", "BallForm")])
def test_readings_taken_several_times_have_less_noise(known: tuple[str, ...]) -> None:
    information = information_of(lb.HybridModel.first(1).bind(PLANS["arcs"]), PHI)
    quieter = replace(
        information,
        noise=tuple({name: part / 4.0 for name, part in own.items()} for own in information.noise),
    )
    found = information.variances(known, times=4.0)
    np.testing.assert_allclose(found, quieter.variances(known), rtol=1e-9)
    assert (found < information.variances(known)).all()


@pytest.mark.parametrize("name", PLANS)
def test_contributions_sum_to_one(name: str) -> None:
    parts = information_of(lb.HybridModel.first(1).bind(PLANS[name]), PHI).contributions()
    assert set(parts) == {
        OWN,
        NOISE,
        "BallForm",
        "BarLength",
        "Mount",
        "ForceError",
        "SetupShift",
        "Discrepancy",
    }
    np.testing.assert_allclose(np.sum(list(parts.values()), axis=0), 1.0, atol=1e-9)
    assert all((share > -1e-12).all() for share in parts.values())


@pytest.mark.parametrize("term", ["BarLength", "SetupShift", NOISE, "BallForm"])
def test_contributions_are_logarithmic_derivatives(term: str) -> None:
    model = lb.HybridModel.first(1)
    bound = model.bind(PLANS["arcs"])
    step = 1e-4

    def log_sd(factor: float) -> np.ndarray:
        if term == "BarLength":
            terms = tuple(
                replace(t, sd_um=t.sd_um * factor) if hasattr(t, "sd_um") else t
                for t in model.nuisances
            )
            return 0.5 * np.log(
                information_of(replace(model, nuisances=terms).bind(PLANS["arcs"]), PHI).variances()
            )
        index = {NOISE: 0, "SetupShift": 1, "BallForm": 3}[term]
        return 0.5 * np.log(
            information_of(bound, PHI * np.where(np.arange(4) == index, factor, 1.0)).variances()
        )

    slope = (log_sd(np.exp(step)) - log_sd(np.exp(-step))) / (2 * step)
    np.testing.assert_allclose(information_of(bound, PHI).contributions()[term], slope, atol=2e-6)


def test_noise_must_be_left_and_scales_positive() -> None:
    one = Information(("a",), (OWN,), np.ones(1), False, (np.ones((2, 1)),), ({NOISE: np.eye(2)},))
    assert one.variances() == pytest.approx([1.0 / 3.0])
    refuses("reading noise must be left", one.variances, [NOISE])
    refuses("prior sd must be positive", replace, one, scale=np.zeros(1))


# ---- readings reduced to at most 25 numbers per test


@drawn(n=st.integers(9, 120), arc=st.floats(190.0, 720.0), seed=st.integers(0, 10**6))
def test_nothing_is_lost(n: int, arc: float, seed: int) -> None:
    """‖y − B a‖² = ‖z − R a‖² + residual for any coefficients a and any sampling."""
    rng = np.random.default_rng(seed)
    angle = np.deg2rad(np.sort(rng.uniform(0.0, arc, n)))
    y = rng.normal(size=n)
    a = rng.normal(size=SIZE)
    reduced = reduce_readings(angle, y)
    assert reduced.factor.shape == (min(n, SIZE), SIZE)
    direct = np.sum((y - basis(angle) @ a) ** 2)
    assert np.sum(
        (reduced.projection - reduced.factor @ a) ** 2
    ) + reduced.residual_ss == pytest.approx(direct, rel=1e-10)


def test_chunks_do_not_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(3)
    angle = rng.uniform(0.0, 7.0, 1000)
    y = rng.normal(size=1000)
    whole = reduce_readings(angle, y)
    monkeypatch.setattr("ldbb_bayes.model.reduction._CHUNK", 33)
    parts = reduce_readings(angle, y)
    np.testing.assert_allclose(
        parts.factor.T @ parts.factor, whole.factor.T @ whole.factor, atol=1e-9
    )
    np.testing.assert_allclose(
        parts.factor.T @ parts.projection, whole.factor.T @ whole.projection, atol=1e-9
    )
    assert parts.residual_ss == pytest.approx(whole.residual_ss, rel=1e-12)


@pytest.mark.parametrize(
    ("n", "arc", "orthogonal"),
    [
        (25, 360.0, True),
        (720, 360.0, True),
        (24, 360.0, False),
        (720, 220.0, False),
        (721, 360.5, True),
    ],
)
def test_uniform_circles_are_recognised(n: int, arc: float, orthogonal: bool) -> None:
    angle = np.deg2rad(33.0 + arc * np.arange(n) / n)
    assert (reduce_readings(angle, None).near_uniform is not None) is orthogonal
    assert reduce_readings(angle, None).projection is None
