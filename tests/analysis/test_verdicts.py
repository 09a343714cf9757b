"""Verdicts on parameters: identified, prior-limited or confounded."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from campaigns import clocked, oracle_of, plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.analysis.verdicts import prior_dominated_share, variance_share_removed
from ldbb_bayes.model.bound_information import information_of
from ldbb_bayes.model.information import Information
from ldbb_bayes.model.terms.columns import NOISE, OWN
from ldbb_bayes.report.wording import verdict_words, with_words

PHI = np.array([0.3e-3, 0.5e-3, 0.3e-3, 2e-3])
LINEAR = lb.HybridModel.first(1)


def information_of_two(angle: float) -> Information:
    """Return the information on E ~ N(0, 10²) and a form ~ N(0, 2²) of 100 readings, noise 1.

    Their columns enclose an angle [rad].
    """
    rows = np.ones((100, 2))
    rows[0::2, 1] = np.cos(angle) + np.sin(angle)
    rows[1::2, 1] = np.cos(angle) - np.sin(angle)
    return Information(
        names=("E", "form"),
        owners=(OWN, "BallForm"),
        scale=np.array([10.0, 2.0]),
        flat=False,
        design=(rows,),
        noise=({NOISE: np.eye(100)},),
    )


# Two parameters


def test_two_parameters_in_closed_form() -> None:
    """With v the variance of the mean reading, Var(E | y) = 1 / (1/100 + 1/(4 + v)).

    With a known form it is the same without the 4; without noise 100 · 4 / 104.
    """
    information = information_of_two(0.0)
    variance = 1.0 / (0.01 + 1.0 / 4.01)
    variance_with_known_form = 1.0 / (0.01 + 1.0 / 0.01)
    assert information.variances()[0] * 100.0 == pytest.approx(variance)
    removed = variance_share_removed(information, ["BallForm"])[0]
    assert removed == pytest.approx(1.0 - variance_with_known_form / variance)
    exact = replace(information, noise=({NOISE: 1e-9 * np.eye(100)},))
    assert exact.variances()[0] == pytest.approx(4.0 / 104.0, abs=1e-6)
    assert variance_share_removed(exact, ["BallForm"])[0] == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("angle", [1e-1, 1e-2, 1e-3, 1e-8, 0.0])
def test_near_collinear_designs_are_graded(angle: float) -> None:
    """The share of E's variance that priors dominate falls as the columns part."""
    information = information_of_two(angle)
    design = information.design[0]
    expected = np.linalg.inv(np.diag([0.01, 0.25]) + design.T @ design)[0, 0]
    assert information.variances()[0] * 100.0 == pytest.approx(expected, rel=1e-6)
    assert bool(prior_dominated_share(information)[0] > 0.5) is (angle < 0.03)
    assert 0.5 < variance_share_removed(information, ["BallForm"])[0] <= 1.0


# The recovered experiment


@pytest.fixture(scope="module")
def identified(recovered: lb.Campaign) -> lb.analysis.Identifiability:
    return lb.identify(LINEAR, recovered)


def test_geometry_is_confounded_with_length_and_form(
    identified: lb.analysis.Identifiability,
) -> None:
    entries = identified.parameters
    for name in ("E_XX1", "E_YY1"):
        assert entries[name].verdict == "confounded"
        assert "BarLength" in entries[name].partners
    for name in ("E_YX2", "E_XY2", "E_C0YX"):
        assert entries[name].verdict == "confounded"
        assert entries[name].partners[0] == "BallForm"
        assert entries[name].confounding["BallForm"] > 0.9
    assert entries["C_CCY"].verdict == "identified"
    assert entries["C_XYX"].verdict == "confounded"


@pytest.mark.parametrize(
    ("first", "second", "term", "lowest_share"),
    [("E_XX1", "E_YY1", "BarLength", 0.5), ("C_XXX", "C_YYY", "Mount", 0.2)],
)
def test_differences_are_not_confounded(
    recovered: lb.Campaign, first: str, second: str, term: str, lowest_share: float
) -> None:
    """A difference is not confounded with length or mount, though each of its members is."""
    information = information_of(LINEAR.bind(recovered), PHI)
    directions = np.diag(information.scale)
    single = directions[information.names.index(first)]
    difference = single - directions[information.names.index(second)]
    covariance = information.covariance()
    covariance_if_known = information.covariance([term])

    def removed_share(direction: np.ndarray) -> float:
        variance = direction @ covariance @ direction
        return float(1.0 - direction @ covariance_if_known @ direction / variance)

    assert removed_share(single) > lowest_share
    assert removed_share(difference) < 1e-3


def test_force_error_holds_part_of_a_direct_compliance(recovered: lb.Campaign) -> None:
    information = information_of(LINEAR.bind(recovered), PHI)
    removed = variance_share_removed(information, ["ForceError"])
    assert removed[information.names.index("C_XXX")] > 0.05


def test_four_lobes_are_separated_from_rotation_by_force_only(recovered: lb.Campaign) -> None:
    model = lb.HybridModel.first(0)
    all_forces = recovered.plan()
    one_force = replace(all_forces, tests=all_forces.tests[-1:])
    confounded = lb.identify(model, one_force).parameters["C_CCY"]
    assert "BallForm" in confounded.partners
    assert confounded.confounding["BallForm"] > 0.9
    separated = lb.identify(model, all_forces).parameters["C_CCY"]
    assert separated.confounding["BallForm"] < 0.9
    assert separated.verdict == "identified"


def test_verdicts_of_a_posterior(recovered: lb.Campaign) -> None:
    rule = lb.inference.StoppingRule(ess=300.0)
    tree = lb.sample(LINEAR, recovered, sampler="independent", rule=rule)
    entries = lb.analysis.judge_posterior(tree)
    assert re.fullmatch(r"confounded with ball form \(\d\d %\)", verdict_words(entries["E_C0YX"]))
    assert verdict_words(entries["C_XYX"]) == "confounded with hysteresis (left out)"
    draws = tree["posterior"]["C_XXX"].to_numpy()
    prior_draws = tree["prior"]["C_XXX"].to_numpy()
    assert entries["C_XXX"].sd == pytest.approx(draws.std())
    contraction = 1.0 - draws.var() / prior_draws.var()
    assert entries["C_XXX"].contraction == pytest.approx(contraction)


def test_what_the_prior_decides_is_prior_limited() -> None:
    """A prior far narrower than the readings can resolve leaves nothing to them."""
    narrow_prior = replace(lb.Prior.first(), cross_mm_per_N=1e-8)
    model = replace(lb.HybridModel.first(0), prior=narrow_prior)
    entry = lb.identify(model, plan()).parameters["C_XYX"]
    assert entry.verdict == "prior-limited"
    assert verdict_words(entry) == "prior-limited"
    assert entry.contraction < 0.2


def test_a_term_left_out_bounds_nothing() -> None:
    entry = lb.identify(lb.HybridModel.first(0).without("ball-form"), plan()).parameters["E_C0YX"]
    assert verdict_words(entry) == "confounded with ball form (left out)"


def test_flat_priors() -> None:
    """All parameters are effective, and what compares with a prior is missing in JSON."""
    paper = lb.identify(lb.HybridModel.paper(0), simulated(plan()))
    assert paper.parameters["E_XX1"].verdict == "confounded"
    assert paper.effective_parameters == len(paper.parameters)
    record = json.loads(json.dumps(with_words(paper), allow_nan=False))
    assert {"statement", "cure", "combination", "modelled"} <= set(record["degeneracies"][0])
    assert record["parameters"]["E_XX1"]["contraction"] is None


# Plans


def test_clocking_both_balls_separates_form_and_geometry() -> None:
    unclocked = lb.identify(LINEAR, clocked(((0.0, 0.0),))).parameters
    turns = ((0.0, 0.0), (45.0, 45.0), (90.0, 90.0))
    clocked_twice = lb.identify(LINEAR, clocked(turns)).parameters
    for name in ("E_YX2", "E_XY2", "E_C0YX"):
        assert unclocked[name].verdict == "confounded"
        assert clocked_twice[name].verdict == "identified"
        assert "BallForm" not in clocked_twice[name].partners
        assert clocked_twice[name].sd < 0.6 * unclocked[name].sd


def test_half_a_turn_separates_odd_orders_only() -> None:
    half_turn = lb.identify(LINEAR, clocked(((0.0, 0.0), (180.0, 180.0)))).parameters
    assert half_turn["E_C0YX"].verdict == "confounded"
    assert half_turn["E_YX2"].verdict == "identified"


@pytest.mark.parametrize(
    ("turn", "verdict"),
    [
        (0.0, "confounded"),
        (6e-7, "confounded"),
        (0.06, "confounded"),
        (5.0, "confounded"),
        (20.0, "identified"),
    ],
)
def test_the_partner_is_always_named(turn: float, verdict: str) -> None:
    """Form holds most of the variance of E_C(0Y)X, from no clocking to enough of it."""
    angle = np.arange(60) * 6.0
    tests = []
    for clocking in (0.0, turn):
        for force in (36.0, 390.0, 742.0):
            test = lb.CircularTest(force, angle, work_ball_deg=clocking, tool_ball_deg=clocking)
            tests.append(test)
    entry = lb.identify(LINEAR, lb.Campaign(tuple(tests))).parameters["E_C0YX"]
    assert entry.verdict == verdict
    assert entry.partners[0] == "BallForm"
    assert entry.confounding["BallForm"] > 0.5


def test_readings_change_nothing_but_the_hyper_parameters(
    recovered: lb.Campaign, identified: lb.analysis.Identifiability
) -> None:
    assert identified.measured
    assert not lb.identify(LINEAR, recovered.plan()).measured
    exact = lb.inference.marginalize(LINEAR.without("truncation"), recovered, tolerance=1e-2)
    for name in ("C_XYX", "E_XX1", "E_C0YX"):
        entry = identified.parameters[name]
        mean = exact.loc[name, "mean"]
        sd = exact.loc[name, "sd"]
        assert entry.mean == pytest.approx(mean, abs=0.3 * sd)
        assert entry.sd == pytest.approx(sd, rel=0.25)


def test_matrices_by_the_oracle() -> None:
    """Effective parameters and posterior correlations."""
    campaign = simulated(plan())
    identified = lb.identify(LINEAR, campaign)
    oracle = oracle_of(campaign, 1)
    covariance = oracle.given(np.array(list(identified.hyper_um.values())) * 1e-3)[2]
    scaled_precision = np.linalg.inv(covariance / np.outer(oracle.sd, oracle.sd))
    gains = np.linalg.eigvalsh(scaled_precision) - 1.0
    assert identified.effective_parameters == pytest.approx((gains / (1.0 + gains)).sum(), rel=1e-6)
    sd = np.sqrt(np.diag(covariance))
    names = list(identified.parameters)
    np.testing.assert_allclose(
        identified.correlation.loc[names, names], covariance / np.outer(sd, sd), atol=1e-6
    )
    for entry in identified.parameters.values():
        assert sum(entry.shares.values()) == pytest.approx(1.0, abs=1e-9)


def test_aliases_by_least_squares() -> None:
    """One prior sd of the bar's length pushed through numpy's least squares."""
    campaign = simulated(plan())
    alias = lb.identify(LINEAR, campaign).alias
    oracle = oracle_of(campaign, 1)
    length_error = np.full(len(oracle.J), 9.4e-3)
    solution = np.linalg.lstsq(oracle.J * oracle.sd, length_error, rcond=None)[0]
    np.testing.assert_allclose(
        alias["bar_length"], solution * oracle.sd, atol=1e-9 * oracle.sd.max()
    )
    assert alias.loc["E_XX1", "bar_length"] == pytest.approx(9.4e-3 / 150.0, rel=1e-6)
