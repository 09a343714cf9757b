"""Priors and nuisance columns, number by number."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from campaigns import cases, oracle_of, plan, refuses, simulated
from reports import plan_of_three_planes
from scipy import integrate, stats

import ldbb_bayes as lb
from ldbb_bayes.model.terms import BallForm, BarLength, Discrepancy, Drift, SetupShift


def test_default_prior_of_the_papers_machine() -> None:
    bound = lb.HybridModel.first(2).bind(plan())
    span = 742.0 - 36.0
    expected = {
        "C_XXX": 1e-4,
        "C_YYY": 1e-4,
        "C_XYX": 1e-5,
        "C_CXY": 1e-7,
        "C_CYY": 1e-7,
        "C_CCY": 1e-9,
    }
    for name, sd in list(expected.items()):
        expected[f"{name}_1"] = 0.3 * sd / span
        expected[f"{name}_2"] = 0.3 * sd / span**2
    expected |= {
        "E_XX1": 2e-4,
        "E_YY1": 2e-4,
        "E_C0YX": 5e-5,
        "E_YX2": 1e-6,
        "E_XY2": 1e-6,
        "E_Xt0": 0.02,
        "E_Yt0": 0.02,
    }
    assert {p.name: p.prior_sd for p in bound.parameters} == pytest.approx(expected)
    units = {p.name: p.unit for p in bound.parameters}
    assert (units["C_XXX"], units["C_CXY_1"], units["C_CCY"]) == ("mm/N", "rad/N/N", "rad/(N mm)")
    assert (units["E_XX1"], units["E_YX2"], units["E_C0YX"], units["E_Xt0"]) == (
        "1",
        "1/mm",
        "rad",
        "mm",
    )


def test_hyper_priors_are_normalised_half_normals_above_the_resolution() -> None:
    prior = lb.Prior.first().hyper(lb.HybridModel.first().scales, 0.24)
    np.testing.assert_allclose(prior.scale, [1e-3, 1e-3, 1e-3, 5e-3])
    floor = 0.24e-3 / np.sqrt(12.0)
    np.testing.assert_allclose(prior.lower, [floor, 0.0, 0.0, 0.0])
    single = lb.Prior.first().hyper(lb.HybridModel.paper().scales, 0.24)
    mass, _ = integrate.quad(
        lambda x: float(np.exp(single.log_density(np.array([x])))), floor, 2e-2, points=[1e-3]
    )
    assert mass == pytest.approx(1.0, abs=1e-6)
    assert single.log_density(np.array([floor * 0.999])) == -np.inf
    mass, _ = integrate.quad(
        lambda u: float(np.exp(single.log_density_of_free(np.array([u])))),
        -30.0,
        -3.0,
        points=[-7.0],
    )
    assert mass == pytest.approx(1.0, abs=1e-6)


@pytest.mark.filterwarnings("error")
def test_a_noise_factor_is_positive() -> None:
    prior = lb.HybridModel.default().bind(plan()).hyper_prior
    draw = prior.quantile(np.full(len(prior.names), 0.5))
    assert np.isfinite(prior.log_density(draw))
    factor = prior.laws.index("circle")
    for impossible in (-1.0, 0.0, 1e-200):
        draw[factor] = impossible
        assert prior.log_density(draw) == -np.inf


def test_hyper_draws_follow_their_density(rng: np.random.Generator) -> None:
    prior = lb.Prior.first().hyper(
        lb.HybridModel.first().without("setup-shift", "discrepancy").scales, 2.0
    )
    draws = prior.draw(20_000, rng)
    floor = 2.0e-3 / np.sqrt(12.0)
    assert draws[:, 0].min() >= floor
    assert (
        stats.kstest(draws[:, 0], stats.truncnorm(floor / 1e-3, np.inf, scale=1e-3).cdf).pvalue
        > 1e-3
    )
    assert stats.kstest(draws[:, 1], stats.halfnorm(scale=5e-3).cdf).pvalue > 1e-3


def test_hyper_sd_is_that_of_the_laws() -> None:
    bound = lb.HybridModel.default(1).bind(replace(plan(), resolution_um=0.9))
    sd = dict(zip(bound.hyper_prior.names, bound.hyper_prior.sd, strict=True))
    law = stats.invgamma(1.5, scale=1.5)
    assert sd["sigma"] == pytest.approx(
        stats.truncnorm(0.9 / np.sqrt(12.0), np.inf, scale=1e-3).std(), rel=1e-9
    )
    assert sd["tau"] == pytest.approx(stats.halfnorm(scale=1.5e-3).std(), rel=1e-12)
    assert sd["decay"] == pytest.approx(
        stats.truncnorm(-1.5 / 0.7, 1.5 / 0.7, scale=0.7).std(), rel=1e-9
    )
    assert sd["lambda_f036"] == pytest.approx(
        np.sqrt(law.mean() - law.expect(np.sqrt) ** 2), rel=1e-6
    )


@pytest.mark.parametrize(("degree", "rows"), [(0, 3), (1, 6), (2, 12)])
def test_truncation_is_at_every_force_that_can_bind(degree: int, rows: int) -> None:
    bound = lb.HybridModel.first(degree).bind(plan())
    assert len(bound.truncation.rows) == rows
    beta = np.zeros(len(bound.names))
    beta[[0, 2, 5]] = [1e-5, 1e-5, 1e-12]
    assert bound.truncation.holds(beta)
    if degree:
        beta[bound.names.index("C_XXX_1")] = -1.01e-5 / 353.0
        assert not bound.truncation.holds(beta)


@pytest.mark.parametrize(("changes", "message"), cases(__file__, "spec.toml")["prior"])
def test_prior_refused(changes: dict, message: str) -> None:
    refuses(message, replace, lb.Prior.first(), **changes)


def test_overrides() -> None:
    """Slopes follow their compliance; their own overrides go with the degree, and change with the
    slopes' scale in proportion."""

    def sds(degree: int, scale: float, **overrides: float) -> dict[str, float]:
        model = (
            lb.HybridModel(1, (), replace(lb.Prior.first(), overrides=overrides))
            .with_slope_scale(scale)
            .with_degree(degree)
        )
        return {p.name: p.prior_sd for p in model.bind(plan()).parameters}

    sd = sds(1, 0.3, C_XXX=2e-5, E_Xt0=1.0)
    assert [sd[name] for name in ("C_XXX", "E_Xt0", "C_YYY", "C_XXX_1")] == pytest.approx(
        [2e-5, 1.0, 1e-4, 0.3 * 2e-5 / 706.0]
    )
    assert sds(0, 0.3, C_XXX=2e-4, C_XXX_1=3e-8)["C_XXX"] == 2e-4
    sd = sds(1, 0.6, C_XXX=2e-4, C_XXX_1=3e-8)
    assert [sd[name] for name in ("C_XXX", "C_XXX_1", "C_XYX_1")] == pytest.approx(
        [2e-4, 6e-8, 0.6 * 1e-5 / 706.0]
    )
    refuses("prior override must be one of", sds, 1, 0.3, C_XXY=1.0)


def test_a_kept_compliance_has_the_prior_of_what_it_absorbs() -> None:
    """Circles at heights of 100 and 300 mm: h² = 400 h − 30000 there, so C_YYY holds −30000 mm² of
    C_AAY, C_AYY 400 mm."""
    heights = (100.0, 300.0, 100.0, 300.0)
    tests = tuple(
        replace(test, centre_z_mm=height)
        for test, height in zip(plan().tests, heights, strict=True)
    )
    bound = lb.HybridModel.first(0).bind(replace(plan(), tests=tests))
    sd = dict(zip(bound.names, bound.prior_sd, strict=True))
    assert sd["C_YYY"] == pytest.approx(np.hypot(1e-4, 30_000.0 * 1e-9))
    assert sd["C_AYY"] == pytest.approx(np.hypot(1e-7, 400.0 * 1e-9))
    assert sd["C_XYX"] == pytest.approx(np.hypot(1e-5, 30_000.0 * 1e-9))


def test_terms_are_replaced_and_left_out_by_name() -> None:
    model = lb.HybridModel.first()
    assert model.with_term(Drift("temperature"), BarLength(1.0)).nuisances[1::6] == (
        BarLength(1.0),
        Drift("temperature"),
    )
    assert model.with_term(Drift()).without("drift") == model
    assert [scale.name for scale in model.without("discrepancy", "ball-form").scales] == [
        "sigma",
        "delta",
    ]
    assert not model.without("truncation").prior.truncated
    assert lb.HybridModel.paper().terms == ("Compliance", "GeometricErrors")
    refuses("Did you mean 'ball-form'", model.without, "ballform")
    refuses("degree must be 0, 1 or 2, got 3", lb.HybridModel.first, 3)
    refuses(
        "flat prior must stand without nuisances, got BarLength",
        lb.HybridModel,
        0,
        (BarLength(),),
        lb.Prior.paper(),
    )
    refuses("nuisances must differ", lb.HybridModel, 0, (BarLength(), BarLength(1.0)))


@pytest.mark.parametrize(
    ("model", "forces", "message"),
    [
        (lb.HybridModel.first(1), (300.0,), r"at least two force levels, got one \(300 N\)"),
        (
            lb.HybridModel.paper(0),
            (300.0, 300.0),
            "flat priors must have at least two force levels",
        ),
        (lb.HybridModel.paper(1), (300.0, 500.0), "at least three force levels at degree 1, got 2"),
    ],
)
def test_forces_a_model_needs(model: lb.HybridModel, forces: tuple, message: str) -> None:
    refuses(message, model.bind, plan([40] * len(forces), forces_N=forces))


@pytest.mark.parametrize(
    ("moves", "places"), [("zero", [0]), ("centre", [1, 2]), ("together", [0, 1, 2])]
)
def test_set_up_shift_moves_what_it_says(moves: str, places: list[int]) -> None:
    """Zero is order 0, centre is order 1."""
    setting = lb.HybridModel.first(0).bind(plan()).setting
    (columns,) = SetupShift(moves).columns(setting)  # type: ignore[arg-type]
    assert np.flatnonzero(columns.sd).tolist() == places
    assert columns.hyper == "delta"


@pytest.mark.parametrize("order", [2, 3, 5])
def test_form_of_a_ball_without_certificate(order: int) -> None:
    """MODEL.md 3: sd² = τ²/2 (n/6)^(−2p) + [n is 2 or 3] S²/24, S = 2.5 µm."""
    assumed_um2 = 2.5**2 / 24.0 if order <= 3 else 0.0
    expected_um2 = 0.8**2 / 2.0 * (order / 6.0) ** (-2.0 * 1.7) + assumed_um2
    sd_um = BallForm().coefficient_sd_um(lb.Ball(), order, np.array([0.8]), np.array([1.7]))
    np.testing.assert_allclose(sd_um, [np.sqrt(expected_um2)], rtol=1e-12)


@pytest.mark.parametrize(("order", "relative"), [(2, 1.0), (3, 1.0), (6, 0.5)])
def test_form_of_a_ball_of_a_grade(order: int, relative: float) -> None:
    """S²/24 · min(1, 3/n)² with S = 0.25 µm of grade G10, whatever τ and p are."""
    ball = lb.Ball(grade="G10")
    sd_um = BallForm().coefficient_sd_um(ball, order, np.array([0.8]), np.array([1.7]))
    np.testing.assert_allclose(sd_um, [0.25 / np.sqrt(24.0) * relative], rtol=1e-12)


@pytest.mark.parametrize("arc_deg", [360.0, 250.0])
def test_variants_of_what_differs_between_circles(arc_deg: float) -> None:
    """ln p(y | φ) with scales of their own and κ/n²: the dense covariance, written out."""
    campaign = simulated(plan((30, 26, 40, 28), arc_deg=arc_deg), seed=3)
    nuisances = (BallForm(law="1/n"), BarLength(), SetupShift("apart"), Discrepancy(2.0))
    model = lb.HybridModel(1, nuisances, replace(lb.Prior.first(), truncated=False))
    bound = model.bind(campaign)
    assert bound.hyper_prior.names == ("sigma", "delta_0", "delta_1", "kappa", "tau")
    np.testing.assert_allclose(bound.hyper_prior.scale, [1e-3, 1e-3, 1e-3, 1e-3, 5e-3])
    sigma, zero, centre, kappa, tau = phi = np.array([3e-4, 7e-4, 2e-4, 5e-4, 2e-3])
    oracle = oracle_of(campaign, 1, terms=("form", "length"), truncated=False)
    covariance = oracle.covariance(np.array([sigma, tau])) + (oracle.J * oracle.sd**2) @ oracle.J.T
    start = 0
    for test in oracle.tests:
        circle = slice(start, start + test.angle.size)
        start += test.angle.size
        c = np.cos(test.angle)
        s = np.sin(test.angle)
        covariance[circle, circle] += zero**2 + centre**2 * (np.outer(c, c) + np.outer(s, s))
        for n in range(2, 13):
            c = np.cos(n * test.angle)
            s = np.sin(n * test.angle)
            covariance[circle, circle] += kappa**2 / n**4 * (np.outer(c, c) + np.outer(s, s))
    expected = stats.multivariate_normal(np.zeros(oracle.y.size), covariance).logpdf(oracle.y)
    assert bound.log_evidence(phi[None])[0] == pytest.approx(expected, abs=1e-5)


def test_fixed_parameters_leave_the_model() -> None:
    """A parameter fixed at zero is one that the model has not; C(F), truncation and priors of the
    others stay."""
    planned = plan()
    model = lb.HybridModel.first(1)
    full = model.bind(planned)
    fixed = model.fixing("C_XXX_1", "E_Xt0").bind(planned)
    index = [j for j, name in enumerate(full.names) if name not in ("C_XXX_1", "E_Xt0")]
    assert fixed.names == tuple(full.names[j] for j in index)
    np.testing.assert_array_equal(fixed.interest_columns, full.interest_columns[:, :, index])
    np.testing.assert_array_equal(fixed.prior_sd, full.prior_sd[index])
    assert len(full.physical.rows) == 6
    assert len(fixed.physical.rows) == 5
    np.testing.assert_allclose(fixed.compliance_at(742.0), full.compliance_at(742.0)[:, index])
    assert fixed.compliance_at(389.0)[0, fixed.names.index("C_XXX")] == 1.0
    assert full.compliance_at(742.0)[0, full.names.index("C_XXX_1")] == 353.0
    assert lb.HybridModel.first(2).fixing("C_XXX_2", "C_XXX_1").with_degree(1).fixed == ("C_XXX_1",)
    refuses(
        r"fixed parameter must be one of .* got 'C_ZZZ_1'",
        lb.HybridModel.first(1).fixing("C_ZZZ_1").bind,
        planned,
    )


@pytest.mark.parametrize(
    ("name", "nearest"),
    [
        ("C_XXX1", "C_XXX_1"),
        ("C_XXZ", "C_XXX"),
        ("C_XXY_1", "C_XYX_1"),
        ("E_XX3", "E_XX1"),
        ("E_CYX", "E_C0YX"),
    ],
)
def test_a_name_of_no_machine_is_refused_at_once(name: str, nearest: str) -> None:
    model = lb.HybridModel.first(1)
    message = f"must be a compliance, .*, got '{name}'. Did you mean '{nearest}'"
    refuses(f"fixed parameter {message}", model.fixing, name)
    refuses(f"parameter with a prior {message}", model.with_prior, {name: (0.0, 1e-6)})


def test_every_parameter_of_three_planes_is_possible() -> None:
    names = lb.HybridModel.default(2).bind(plan_of_three_planes()).names
    assert set(lb.HybridModel.default(2).fixing(*names).fixed) == set(names)


@pytest.mark.parametrize(
    ("term", "given"),
    [("bar-length", "'bar-length'"), (lb.terms.BarLength, "the class BarLength")],
)
def test_the_name_or_class_of_a_term_is_no_term(term: Any, given: str) -> None:
    message = rf"a term must be an object, got {given}\. Write lb\.terms\.BarLength\(\.\.\.\)"
    refuses(message, lb.HybridModel.default(1).with_term, term)


@pytest.mark.parametrize(
    ("name", "question"),
    [("xyz", ""), ("Drft", " Did you mean 'Drift'?"), ("ball form", " Did you mean 'BallForm'?")],
)
def test_a_name_that_no_term_has_is_answered_with_those_there_are(name: str, question: str) -> None:
    """Who wrote 'foo' was told to write ForceError, and nothing of the other classes."""
    message = (
        rf"one of the classes BallForm, .*, Drift.*, got '{name}'\.{re.escape(question)} Write"
    )
    refuses(message, lb.HybridModel.default(1).with_term, name)


def test_a_class_that_is_no_term_is_no_term() -> None:
    model = lb.HybridModel.default(1)
    refuses("nuisances must be terms, got type", model.with_term, lb.Campaign)


def test_a_slope_alone_about_the_middle_is_refused() -> None:
    """C(F) = (F − F0) C_1 cannot be positive on both sides of F0: no truncated prior, no
    evidence."""
    planned = plan()
    model = lb.HybridModel.first(1).fixing("C_CCY")
    refuses(
        "C_CCY must not be fixed at zero while C_CCY_1 is free: about F0 = 389 N",
        model.bind,
        planned,
    )
    for reference in (0.0, 742.0):
        replace(model, reference_force_N=reference).bind(planned)
    model.fixing("C_CCY_1").bind(planned)


def test_names_as_they_are_printed() -> None:
    """E_C(0Y)X wherever a parameter is named."""
    for name in ("E_C0YX", "E_C(0Y)X"):
        prior = replace(lb.Prior.default(), overrides={name: 1e-6})
        assert lb.HybridModel(0, prior=prior).bind(plan()).prior_sd[10] == 1e-6
        assert "E_C0YX" not in lb.HybridModel.default(0).fixing(name).bind(plan()).names
        simulation = lb.HybridModel.default(0).simulate(plan(), seed=1, parameters={name: 1e-4})
        assert simulation.parameters["E_C0YX"] == 1e-4
        machine = plan().machine()
        angle = np.array([0.7])
        reading = lb.machine.exact_reading_mm(
            machine, lb.machine.Circle(), angle, geometric_errors={name: 1e-4}
        )
        assert reading == pytest.approx(150.0 * 1e-4 * np.cos(0.7) * np.sin(0.7), rel=1e-3)
