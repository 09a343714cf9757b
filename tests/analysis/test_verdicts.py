"""Verdicts on parameters: identified, prior-limited or confounded."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from campaigns import clocked, oracle_of, plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.analysis.origins import Origin
from ldbb_bayes.analysis.posterior_verdicts import judge_at_force
from ldbb_bayes.analysis.variance_sources import VarianceSource, sources_of
from ldbb_bayes.analysis.verdicts import Verdict, judge, judge_changes, judge_parameters
from ldbb_bayes.model.bound_information import information_of
from ldbb_bayes.model.information import Information
from ldbb_bayes.model.terms.columns import NOISE, PARAMETERS
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
        owners=(PARAMETERS, "BallForm"),
        scale=np.array([10.0, 2.0]),
        flat=False,
        design=(rows,),
        noise=({NOISE: np.eye(100)},),
    )


def variance_share_removed(information: Information, effect: str) -> np.ndarray:
    """Share of each parameter's variance that would vanish if an effect were known."""
    return 1.0 - information.variances([effect]) / information.variances()


# Two parameters


def test_two_parameters_in_closed_form() -> None:
    """With v the variance of the mean reading, Var(E | y) = 1 / (1/100 + 1/(4 + v)).

    With a known form it is the same without the 4; without noise 100 · 4 / 104.
    """
    information = information_of_two(0.0)
    variance = 1.0 / (0.01 + 1.0 / 4.01)
    variance_with_known_form = 1.0 / (0.01 + 1.0 / 0.01)
    assert information.variances()[0] * 100.0 == pytest.approx(variance)
    removed = variance_share_removed(information, "BallForm")[0]
    assert removed == pytest.approx(1.0 - variance_with_known_form / variance)
    exact = replace(information, noise=({NOISE: 1e-9 * np.eye(100)},))
    assert exact.variances()[0] == pytest.approx(4.0 / 104.0, abs=1e-6)
    assert variance_share_removed(exact, "BallForm")[0] == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("angle", [1e-1, 1e-2, 1e-3, 1e-8, 0.0])
def test_near_collinear_designs_are_graded(angle: float) -> None:
    """The share of the form in E's variance falls as the columns part."""
    information = information_of_two(angle)
    design = information.design[0]
    expected = np.linalg.inv(np.diag([0.01, 0.25]) + design.T @ design)[0, 0]
    assert information.variances()[0] * 100.0 == pytest.approx(expected, rel=1e-6)
    share = information.contributions()["BallForm"][0]
    assert bool(share > 0.5) is (angle < 0.03)
    assert 0.5 < variance_share_removed(information, "BallForm")[0] <= 1.0


# Shares of the variance


def test_shares_by_dense_covariances() -> None:
    """Every source pushed through the linear estimate, K = P Hᵀ (H P Hᵀ + G S Gᵀ + N)⁻¹.

    The estimate errs by (K H − 1) β for the parameters β, by K G c for the nuisances c and by K ε
    for the noise. All in plain numpy, without the precisions that the package uses.
    """
    bound = LINEAR.bind(plan())
    information = information_of(bound, PHI)
    interest = list(information.interest)
    nuisances = [k for k in range(len(information.names)) if k not in interest]
    rows = np.concatenate(information.design) * information.scale
    noises: dict[str, np.ndarray] = {}
    start = 0
    for design, sources in zip(information.design, information.noise, strict=True):
        block = slice(start, start + len(design))
        start += len(design)
        for name, covariance in sources.items():
            full = noises.setdefault(name, np.zeros((len(rows), len(rows))))
            full[block, block] = covariance
    parameters = rows[:, interest]
    effects = rows[:, nuisances]
    total = parameters @ parameters.T + effects @ effects.T + sum(noises.values())
    gain = np.linalg.solve(total, parameters).T
    prior_errors = gain @ parameters - np.eye(len(interest))
    nuisance_errors = gain @ effects
    expected: dict[tuple[str, str], float] = {}
    for i, name in enumerate(bound.names):
        for j, other in enumerate(bound.names):
            label = PARAMETERS if other == name else other
            expected[name, label] = prior_errors[i, j] ** 2
        for j, k in enumerate(nuisances):
            key = (name, information.owners[k])
            expected[key] = expected.get(key, 0.0) + nuisance_errors[i, j] ** 2
        for source, covariance in noises.items():
            key = (name, source)
            variance = gain[i] @ covariance @ gain[i]
            expected[key] = expected.get(key, 0.0) + variance
    for name, (sources_of_name, _) in sources_of(bound, information).items():
        variance = sum(value for key, value in expected.items() if key[0] == name)
        shares: dict[str, float] = {}
        for source in sources_of_name:
            shares[source.name] = shares.get(source.name, 0.0) + source.share
        assert sum(shares.values()) == pytest.approx(1.0, abs=1e-9)
        for source_name, share in shares.items():
            assert share == pytest.approx(expected[name, source_name] / variance, abs=1e-7)


# Rules


def assumed(name: str, share: float) -> VarianceSource:
    return VarianceSource(name, Origin.ASSUMED, share)


@pytest.mark.parametrize(
    ("sources", "partners"),
    [
        ([assumed("Mount", 0.51)], ("Mount",)),
        ([assumed("Mount", 0.5)], ()),
        ([assumed("Mount", 0.5 + 1e-9)], ()),
        ([assumed("Mount", 0.4), assumed("Drift", 0.2)], ("Mount", "Drift")),
        ([assumed("E_YY1", 0.6)], ("E_YY1",)),
        ([assumed(PARAMETERS, 0.9)], ()),
        ([VarianceSource("Mount", Origin.STATED, 0.9)], ()),
        ([VarianceSource("Mount", Origin.MEASURED, 0.9)], ()),
        ([assumed("Mount", 0.47), assumed("Drift", 0.04), assumed("Angle", 0.04)], ()),
        ([VarianceSource(NOISE, Origin.MEASURED, 0.45), assumed("Mount", 0.55)], ("Mount",)),
    ],
)
def test_assumed_effects_with_more_than_half_confound(
    sources: list[VarianceSource], partners: tuple[str, ...]
) -> None:
    judgement = judge(sources, contraction=0.99)
    expected = Verdict.CONFOUNDED if partners else Verdict.IDENTIFIED
    assert judgement.verdict == expected
    assert tuple(source.name for source in judgement.partners) == partners


@pytest.mark.parametrize(
    ("contraction", "verdict"),
    [
        (0.7, "prior-limited"),
        (0.75, "identified"),
        (0.75 - 1e-9, "identified"),
        (0.8, "identified"),
        (float("nan"), "identified"),
    ],
)
def test_more_than_half_of_the_prior_sd_is_prior_limited(contraction: float, verdict: str) -> None:
    assert judge([assumed(PARAMETERS, 1.0)], contraction).verdict == verdict


@pytest.mark.parametrize(("cosine", "verdict"), [(0.96, "confounded"), (0.9, "identified")])
def test_several_effects_confound_if_they_act_on_the_same_combination(
    cosine: float, verdict: str
) -> None:
    sources = [assumed("Mount", 0.4), assumed("ForceError", 0.3)]
    likeness = {("Mount", "Mount"): 1.0, ("ForceError", "ForceError"): 1.0}
    likeness |= dict.fromkeys([("Mount", "ForceError"), ("ForceError", "Mount")], cosine)
    assert judge(sources, 0.99, likeness).verdict == verdict


def test_likeness_of_mount_and_force_gain() -> None:
    """Both move C_XXX and C_YYY together; a two-lobe form moves E_XX1 against E_YY1, a length not.

    Likeness from the columns alone: the errors of the estimate are those of least squares.
    """
    bound = LINEAR.bind(plan())
    sources = sources_of(bound, information_of(bound, PHI))
    assert sources["C_XXX"].likeness["Mount", "ForceError"] > 0.5
    assert sources["E_XX1"].likeness["BarLength", "BallForm"] < 0.3


def test_confounded_goes_before_prior_limited() -> None:
    assert judge([assumed("Mount", 0.9)], contraction=0.1).verdict == "confounded"


def test_knowing_the_partners_cuts_u_by_thirty_percent(
    identified: lb.analysis.Identifiability,
) -> None:
    """Knowing effects removes at least their share of the variance."""
    confounded = [e for e in identified.parameters.values() if e.verdict == "confounded"]
    assert confounded
    for entry in confounded:
        assert sum(entry.partner_shares.values()) > 0.5
        assert entry.sd_if_known is not None
        assert entry.sd_if_known < 0.5**0.5 * entry.sd


def test_knowing_what_is_assumed_leaves_what_is_stated() -> None:
    """The random force of circles is assumed, the gain of the load cell stated: one term has both.

    Were the random force known, the gain would still hold the compliance. By a model whose random
    force is as good as zero.
    """
    certified = replace(plan(), instrument=lb.Instrument(force_U_percent=0.6, mount_U_percent=0.1))
    model = lb.HybridModel.first(0)

    def judged(campaign: lb.Campaign) -> lb.analysis.ParameterIdentifiability:
        bound = model.bind(campaign)
        phi = 1e-3 * bound.hyper_prior.quantile(np.full(len(bound.hyper_prior.names), 0.5))
        return judge_parameters(bound, information_of(bound, phi), bound.prior_mean)["C_XXX"]

    with_random_force = judged(certified)
    exact_force = replace(certified.instrument, force_random_N=1e-6)
    assert with_random_force.partners == ("ForceError",)
    assert with_random_force.sd_if_known == pytest.approx(
        judged(replace(certified, instrument=exact_force)).sd, rel=1e-6
    )


def test_every_share_is_counted_once(identified: lb.analysis.Identifiability) -> None:
    for entry in identified.parameters.values():
        assert sum(entry.shares.values()) == pytest.approx(1.0, abs=1e-9)
        assert sum(entry.origin_shares.values()) == pytest.approx(1.0, abs=1e-9)
        assert list(entry.origin_shares) == list(Origin)
        assert entry.held_by.share <= 1.0


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
        assert entries[name].held_by.origin == "assumed"
        assert entries[name].confounding["BallForm"] > 0.9
    assert entries["C_CCY"].verdict == "identified"
    assert entries["C_XYX"].verdict == "identified"


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
    removed = variance_share_removed(information, "ForceError")
    assert removed[information.names.index("C_XXX")] > 0.05


def test_four_lobes_are_separated_from_rotation_by_force_only(recovered: lb.Campaign) -> None:
    model = lb.HybridModel.first(0)
    all_forces = recovered.plan()
    one_force = replace(all_forces, tests=all_forces.tests[-1:])
    confounded = lb.identify(model, one_force).parameters["C_CCY"]
    assert confounded.confounding["BallForm"] > 0.9
    separated = lb.identify(model, all_forces).parameters["C_CCY"]
    assert separated.confounding["BallForm"] < 0.9
    assert separated.verdict == "identified"


@pytest.mark.slow
def test_a_compliance_is_judged_at_the_force_at_which_it_is_stated(recovered: lb.Campaign) -> None:
    """As in a model with this reference force, whose parameters are the compliances there."""
    model = lb.HybridModel.default(1)
    posterior = lb.sample(model, recovered, sampler="independent", seed=1)
    posterior_at_600_N = lb.sample(
        replace(model, reference_force_N=600.0), recovered, sampler="independent", seed=1
    )
    at_force = judge_at_force(posterior, 600.0)
    at_reference = lb.analysis.judge_posterior(posterior)
    wanted = lb.analysis.judge_posterior(posterior_at_600_N)
    for name in ("C_XXX", "C_YYY", "C_XYX", "C_CXY"):
        assert at_force[name].verdict == wanted[name].verdict
        for term, share in wanted[name].shares.items():
            assert at_force[name].shares[term] == pytest.approx(share, abs=0.02)
    change_of_share = (
        at_reference["C_XXX"].shares["JointLoad"] - at_force["C_XXX"].shares["JointLoad"]
    )
    assert change_of_share > 0.05
    assert judge_at_force(posterior, 389.0) == at_reference


def test_verdicts_of_a_posterior(recovered: lb.Campaign) -> None:
    rule = lb.inference.StoppingRule(ess=300.0)
    tree = lb.sample(LINEAR, recovered, sampler="independent", rule=rule)
    entries = lb.analysis.judge_posterior(tree)
    assert re.fullmatch(r"confounded with ball form \(\d\d %\)", verdict_words(entries["E_C0YX"]))
    assert re.fullmatch(
        r"identified, limited by discrepancy \(\d\d %, measured here\)",
        verdict_words(entries["C_XYX"]),
    )
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


def test_what_is_switched_off_is_a_fact_and_no_verdict() -> None:
    identified = lb.identify(lb.HybridModel.first(0).without("ball-form"), plan())
    assert identified.not_modelled == ("BallForm",)
    assert identified.parameters["E_C0YX"].verdict == "identified"
    assert with_words(identified)["notes"] == [
        "Not modelled: ball form. No interval covers what was switched off."
    ]
    assert lb.identify(lb.HybridModel.first(0), plan()).not_modelled == ()


def test_flat_priors() -> None:
    """All parameters are effective, and what compares with a prior is missing in JSON."""
    paper = lb.identify(lb.HybridModel.paper(0), simulated(plan()))
    assert paper.parameters["E_XX1"].verdict == "identified"
    assert paper.parameters["E_XX1"].held_by.name == NOISE
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
        assert clocked_twice[name].shares["BallForm"] < 0.5
        assert clocked_twice[name].sd < 0.6 * unclocked[name].sd


def test_half_a_turn_separates_odd_orders_only() -> None:
    half_turn = lb.identify(LINEAR, clocked(((0.0, 0.0), (180.0, 180.0)))).parameters
    assert half_turn["E_C0YX"].verdict == "confounded"
    assert half_turn["E_YX2"].verdict == "identified"


@pytest.mark.parametrize(
    ("turn", "verdict", "holder", "origin"),
    [
        (0.0, "confounded", "BallForm", "assumed"),
        (6e-7, "confounded", "BallForm", "assumed"),
        (0.06, "confounded", "BallForm", "assumed"),
        (5.0, "identified", "BallForm", "assumed"),
        (20.0, "identified", "Discrepancy", "measured here"),
    ],
)
def test_from_no_clocking_to_enough_of_it(
    turn: float, verdict: str, holder: str, origin: str
) -> None:
    """Form is assumed until a turn shows it, and then scatter limits E_C(0Y)X."""
    angle = np.arange(60) * 6.0
    tests = []
    for clocking in (0.0, turn):
        for force in (36.0, 390.0, 742.0):
            test = lb.CircularTest(force, angle, work_ball_deg=clocking, tool_ball_deg=clocking)
            tests.append(test)
    entry = lb.identify(LINEAR, lb.Campaign(tuple(tests))).parameters["E_C0YX"]
    assert entry.verdict == verdict
    assert entry.held_by.name == holder
    assert entry.held_by.origin == origin
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


def test_the_prior_sd_of_a_geometric_error_is_exact(recovered: lb.Campaign) -> None:
    """Not that of random draws from the prior."""
    model = lb.HybridModel.default(1)
    bound = model.bind(recovered)
    rule = lb.inference.StoppingRule(ess=400.0)
    posterior = lb.sample(model, recovered, sampler="independent", seed=1, rule=rule)
    entries = lb.analysis.judge_posterior(posterior)
    for name in bound.geometric_errors:
        place = bound.names.index(name.label)
        assert entries[name.label].prior_sd == bound.prior_sd[place]


@pytest.mark.parametrize(("sd", "verdict"), [(0.45, "identified"), (0.55, "prior-limited")])
def test_a_change_is_prior_limited_where_more_than_half_of_its_prior_sd_remains(
    sd: float, verdict: str
) -> None:
    sources = SimpleNamespace(sources=[assumed(PARAMETERS, 1.0)], likeness={})
    variance: Any = SimpleNamespace(
        number_of_parameters=0, variance=np.array([sd**2]), sources=lambda *_: sources
    )
    change: Any = SimpleNamespace(
        slopes=(), unit="mm/N", smallest_force_N=36.0, largest_force_N=742.0
    )
    entries = judge_changes(variance, {"C_XXX": change}, np.ones(1))
    assert entries["C_XXX"].verdict == verdict
