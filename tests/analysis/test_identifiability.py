"""What comes from the readings, what from the prior, and what are two names for one thing."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from campaigns import HYPER_UM, clocked, oracle_of, plan, simulated
from oracle import Stated

import ldbb_bayes as lb
from ldbb_bayes.analysis.budgets import Budget, budgets
from ldbb_bayes.analysis.value_of_certificates import uncertainty_with
from ldbb_bayes.analysis.verdicts import (
    hyper_parameter_nodes,
    prior_dominated_share,
    variance_share_removed,
)
from ldbb_bayes.inference.nodes import HyperPosterior
from ldbb_bayes.machine.linear import compliance_jacobian, geometric_jacobian, kept_compliances
from ldbb_bayes.model.bound_information import information_of
from ldbb_bayes.model.information import Information
from ldbb_bayes.model.terms import NOISE, OWN
from ldbb_bayes.report.wording import remedy_words, verdict_words, with_words

PHI = np.array([0.3e-3, 0.5e-3, 0.3e-3, 2e-3])
LINEAR = lb.HybridModel.first(1)
AT = np.linspace(0.1, 6.0, 37)


def two(
    angle: float, *, readings: int = 100, noise: float = 1.0, sd: tuple[float, float] = (10.0, 2.0)
) -> Information:
    """E and a form whose columns enclose an angle [rad]."""
    rows = np.zeros((readings, 2))
    rows[:, 0] = 1.0
    rows[0::2, 1], rows[1::2, 1] = np.cos(angle) + np.sin(angle), np.cos(angle) - np.sin(angle)
    return Information(
        ("E", "form"),
        (OWN, "BallForm"),
        np.array(sd),
        False,
        (rows,),
        ({NOISE: noise**2 * np.eye(readings)},),
    )


# Two parameters


def test_two_parameters_in_closed_form() -> None:
    """E ~ N(0, 10²), form ~ N(0, 2²), v the variance of the mean reading: Var(E | y) = 1 / (1/100 +
    1/(4 + v)), a known form without the 4; without noise 100 · 4 / 104."""
    information = two(0.0)
    given = 1.0 / (0.01 + 1.0 / 4.01)
    known = 1.0 / (0.01 + 1.0 / 0.01)
    assert information.variances()[0] * 100.0 == pytest.approx(given)
    assert variance_share_removed(information, ["BallForm"])[0] == pytest.approx(
        1.0 - known / given
    )
    exact = replace(information, noise=({NOISE: 1e-9 * np.eye(100)},))
    assert exact.variances()[0] == pytest.approx(4.0 / 104.0, abs=1e-6)
    assert variance_share_removed(exact, ["BallForm"])[0] == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("angle", [1e-1, 1e-2, 1e-3, 1e-8, 0.0])
def test_near_collinear_designs_are_graded(angle: float) -> None:
    """The share of E's variance where priors outweigh readings falls as the columns come apart;
    nothing breaks."""
    information = two(angle)
    expected = np.linalg.inv(
        np.diag([0.01, 0.25]) + information.design[0].T @ information.design[0]
    )[0, 0]
    assert information.variances()[0] * 100.0 == pytest.approx(expected, rel=1e-6)
    assert bool(prior_dominated_share(information)[0] > 0.5) is (angle < 0.03)
    assert 0.5 < variance_share_removed(information, ["BallForm"])[0] <= 1.0


# The recovered experiment


@pytest.fixture(scope="module")
def identified(recovered: lb.Campaign) -> lb.Identifiability:
    return lb.identify(LINEAR, recovered)


def test_geometry_is_confounded_with_length_and_form(identified: lb.Identifiability) -> None:
    entries = identified.parameters
    for name in ("E_XX1", "E_YY1"):
        assert entries[name].verdict == "confounded"
        assert "BarLength" in entries[name].partners
    for name in ("E_YX2", "E_XY2", "E_C0YX"):
        assert (entries[name].verdict, entries[name].partners[0]) == ("confounded", "BallForm")
        assert entries[name].confounding["BallForm"] > 0.9
    assert (entries["C_CCY"].verdict, entries["C_XYX"].verdict) == ("identified", "confounded")


def test_differences_are_not(recovered: lb.Campaign) -> None:
    """E_XX1 − E_YY1 is not confounded with the length, C_XXX − C_YYY not with the mount, though
    each of them is."""
    information = information_of(LINEAR.bind(recovered), PHI)
    every = np.diag(information.scale)
    names = list(information.names)
    for first, second, term, least in (
        ("E_XX1", "E_YY1", "BarLength", 0.5),
        ("C_XXX", "C_YYY", "Mount", 0.2),
    ):
        alone = every[names.index(first)]
        other = every[names.index(second)]
        known = information.covariance([term])
        unknown = information.covariance()
        lost = [
            1.0 - (step @ known @ step) / (step @ unknown @ step) for step in (alone, alone - other)
        ]
        assert lost[0] > least
        assert lost[1] < 1e-3
    assert variance_share_removed(information, ["ForceError"])[names.index("C_XXX")] > 0.05


def test_four_lobes_are_separated_from_rotation_by_force_only(recovered: lb.Campaign) -> None:
    def weak(campaign: lb.Campaign, degree: int) -> lb.ParameterIdentifiability:
        return lb.identify(lb.HybridModel.first(degree), campaign).parameters["C_CCY"]

    one = replace(recovered.plan(), tests=(recovered.plan().tests[-1],))
    assert "BallForm" in weak(one, 0).partners
    assert weak(one, 0).confounding["BallForm"] > 0.9
    assert weak(recovered.plan(), 0).confounding["BallForm"] < 0.9
    assert weak(recovered.plan(), 0).verdict == "identified"


def test_verdicts_of_a_posterior(recovered: lb.Campaign) -> None:
    tree = lb.sample(LINEAR, recovered, sampler="independent", rule=lb.StoppingRule(ess=300.0))
    found = lb.verdicts(tree)
    assert re.fullmatch(r"confounded with ball form \(\d\d %\)", verdict_words(found["E_C0YX"]))
    assert verdict_words(found["C_XYX"]) == "confounded with hysteresis (left out)"
    draws = tree["posterior"]["C_XXX"].to_numpy()
    assert found["C_XXX"].sd == pytest.approx(draws.std())
    assert found["C_XXX"].contraction == pytest.approx(
        1.0 - draws.var() / tree["prior"]["C_XXX"].to_numpy().var()
    )


def test_what_the_prior_decides_is_called_so() -> None:
    """A prior far narrower than the readings can tell leaves nothing to them."""
    model = replace(lb.HybridModel.first(0), prior=replace(lb.Prior.first(), cross_mm_per_N=1e-8))
    entry = lb.identify(model, plan()).parameters["C_XYX"]
    assert (entry.verdict, verdict_words(entry)) == ("prior-limited", "prior-limited")
    assert entry.contraction < 0.2


def test_a_term_left_out_bounds_nothing() -> None:
    entry = lb.identify(lb.HybridModel.first(0).without("ball-form"), plan()).parameters["E_C0YX"]
    assert verdict_words(entry) == "confounded with ball form (left out)"
    paper = lb.identify(lb.HybridModel.paper(0), simulated(plan()))
    assert paper.parameters["E_XX1"].verdict == "confounded"
    assert paper.effective_parameters == len(paper.parameters)
    record = json.loads(json.dumps(with_words(paper), allow_nan=False))
    assert {"statement", "cure", "combination", "modelled"} <= set(record["degeneracies"][0])
    assert record["parameters"]["E_XX1"]["contraction"] is None


# Plans


def test_clocking_both_balls_ends_the_alias() -> None:
    before = lb.identify(LINEAR, clocked(((0.0, 0.0),))).parameters
    after = lb.identify(LINEAR, clocked(((0.0, 0.0), (45.0, 45.0), (90.0, 90.0)))).parameters
    for name in ("E_YX2", "E_XY2", "E_C0YX"):
        assert before[name].verdict == "confounded"
        assert after[name].verdict == "identified"
        assert "BallForm" not in after[name].partners
        assert after[name].sd < 0.6 * before[name].sd
    half = lb.identify(LINEAR, clocked(((0.0, 0.0), (180.0, 180.0)))).parameters
    assert half["E_C0YX"].verdict == "confounded"
    assert half["E_YX2"].verdict == "identified"


@pytest.mark.parametrize(
    ("turn", "word"),
    [
        (0.0, "confounded"),
        (6e-7, "confounded"),
        (0.06, "confounded"),
        (5.0, "confounded"),
        (20.0, "identified"),
    ],
)
def test_the_partner_is_always_named(turn: float, word: str) -> None:
    """From no clocking to enough of it: form holds most of the variance of E_C(0Y)X long before it
    is told apart, and after."""
    angle = np.arange(60) * 6.0
    tests = [
        lb.CircularTest(f, angle, work_ball_deg=p, tool_ball_deg=p)
        for p in (0.0, turn)
        for f in (36.0, 390.0, 742.0)
    ]
    entry = lb.identify(LINEAR, lb.Campaign(tuple(tests))).parameters["E_C0YX"]
    assert entry.verdict == word
    assert entry.partners[0] == "BallForm"
    assert entry.confounding["BallForm"] > 0.5


def test_readings_change_nothing_but_the_hyper_parameters(
    recovered: lb.Campaign, identified: lb.Identifiability
) -> None:
    assert identified.measured
    assert not lb.identify(LINEAR, recovered.plan()).measured
    exact = lb.marginals(LINEAR.without("truncation"), recovered, tolerance=1e-2)
    for name in ("C_XYX", "E_XX1", "E_C0YX"):
        assert identified.parameters[name].mean == pytest.approx(
            exact.loc[name, "mean"], abs=0.3 * exact.loc[name, "sd"]
        )
        assert identified.parameters[name].sd == pytest.approx(exact.loc[name, "sd"], rel=0.25)


def test_matrices_by_the_oracle() -> None:
    """Effective parameters, posterior correlations, and one prior sd of the bar's length pushed
    through numpy's least squares."""
    campaign = simulated(plan())
    found = lb.identify(LINEAR, campaign)
    oracle = oracle_of(campaign, 1)
    covariance = oracle.given(np.array(list(found.hyper_um.values())) * 1e-3)[2]
    gains = np.linalg.eigvalsh(np.linalg.inv(covariance / np.outer(oracle.sd, oracle.sd))) - 1.0
    assert found.effective_parameters == pytest.approx((gains / (1.0 + gains)).sum(), rel=1e-6)
    sd = np.sqrt(np.diag(covariance))
    own = list(found.parameters)
    np.testing.assert_allclose(
        found.correlation.loc[own, own], covariance / np.outer(sd, sd), atol=1e-6
    )
    for entry in found.parameters.values():
        assert sum(entry.shares.values()) == pytest.approx(1.0, abs=1e-9)
    expected = (
        np.linalg.lstsq(oracle.J * oracle.sd, np.full(len(oracle.J), 9.4e-3), rcond=None)[0]
        * oracle.sd
    )
    np.testing.assert_allclose(found.alias["bar_length"], expected, atol=1e-9 * oracle.sd.max())
    assert found.alias.loc["E_XX1", "bar_length"] == pytest.approx(9.4e-3 / 150.0, rel=1e-6)


def test_certificates_by_the_oracle() -> None:
    """Variances given φ are averaged, with a bar certified to 1 µm and without; such they are
    then."""
    campaign = simulated(plan())
    weight = np.array([0.5, 0.3, 0.2])
    bound = LINEAR.without("truncation").bind(campaign)
    phi = hyper_parameter_nodes(bound)[1][[0, 7, -1]]
    oracle = oracle_of(campaign, 1, stated=Stated(length_U_um=1.0))
    expected = weight @ [np.diag(oracle.given(own)[2]) for own in phi]
    np.testing.assert_allclose(
        uncertainty_with(bound, lb.Instrument(bar_U_um=1.0), weight, phi),
        np.sqrt(expected),
        rtol=1e-6,
    )
    found = lb.identify(bound.model, campaign).certificates
    for name, own in (
        ("none of these", campaign),
        ("bar ± 1 µm", replace(campaign, instrument=lb.Instrument(bar_U_um=1.0))),
    ):
        sd = HyperPosterior(bound.model.bind(own), truncated=False).nodes(0.1).moments()[1]
        np.testing.assert_allclose(list(found[name].values()), sd, rtol=0.02)


# What circles show of a machine


def value_of(pattern: str, radius: float, angle: np.ndarray) -> np.ndarray:
    """A printed pattern as numbers, by having Python read it."""
    powers = re.sub(
        "[²³⁴]", lambda found: f"**{'²³⁴'.index(found[0]) + 2}", pattern.replace("−", "-")
    )
    product = re.sub(r"(?<=\w) ?(?=[Rcs])", "*", powers)
    return eval(product, {"R": radius, "c": np.cos(angle), "s": np.sin(angle)}) + np.zeros_like(
        angle
    )


def test_patterns_say_what_the_columns_are() -> None:
    planes = ("XY", "YZ", "ZX")
    centre = (0.0, -15.0, 40.0)
    machine = lb.Machine("wXFYZt", planes, {"Y": (30.0, 0.0, -120.0)})
    circles = [lb.Circle(150.0, centre, plane) for plane in planes]
    found = lb.describe(machine, circles)
    kept = kept_compliances(machine, *circles)
    for plane in planes:
        small = lb.Circle(80.0, centre, plane)
        names = [
            *(name.label for name in kept.names),
            *(entry.name for entry in found.geometric_errors),
        ]
        every = (
            compliance_jacobian(machine, small, AT, kept.names),
            geometric_jacobian(machine, small, AT),
        )
        columns = dict(zip(names, np.hstack(every).T, strict=True))
        for entry in (*found.compliances, *found.geometric_errors):
            shown = entry.pattern.get(plane)
            expected = np.zeros_like(AT) if shown is None else value_of(shown, 80.0, AT)
            np.testing.assert_allclose(
                columns[entry.name],
                expected,
                rtol=1e-5,
                atol=1e-5 * max(1.0, np.abs(expected).max()),
            )


AT_PHI = np.array([HYPER_UM[name] * 1e-3 for name in ("sigma", "delta", "kappa", "tau")])


CAMPAIGN = LINEAR.simulate(plan(), seed=3, hyper_um=HYPER_UM).campaign


@pytest.fixture(scope="module")
def posterior() -> Any:
    return lb.sample(LINEAR, CAMPAIGN, seed=1, sampler="independent")


@pytest.fixture(scope="module")
def found(posterior: Any) -> dict[str, Budget]:
    return budgets(posterior)


def test_shares_sum_to_one_and_give_back_the_variance(
    posterior: Any, found: dict[str, Budget]
) -> None:
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
    assert {
        line.kind
        for line in square.contributions
        if line.source in (NOISE, "Discrepancy", "SetupShift")
    } == {"A"}
    assert found["E_XX1"].as_dict()["contributions"][0]["kind"] == "B"


def test_the_sign_of_a_sensitivity(found: dict[str, Budget]) -> None:
    """Every reading one micrometre longer: how the estimate of a gain moves is the sensitivity to
    the bar's length."""
    longer = replace(
        CAMPAIGN,
        tests=tuple(t.with_reading_um(np.asarray(t.reading_um) + 1.0) for t in CAMPAIGN.tests),
    )
    one, other = (LINEAR.without("truncation").bind(c) for c in (CAMPAIGN, longer))
    moved = (other.given(AT_PHI[None])[1].mean[0] - one.given(AT_PHI[None])[1].mean[0])[
        one.names.index("E_XX1")
    ]
    line = next(x for x in found["E_XX1"].contributions if x.source == "bar_length")
    assert line.sensitivity == pytest.approx(moved / 1e-3, rel=0.1)
