"""What comes from the readings, what from the prior, and what are two names for one thing."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from campaigns import oracle_of, plan, simulated
from scipy import integrate, stats

import ldbb_bayes as lb
from ldbb_bayes.analysis.identifiability import Confounding, overlap
from ldbb_bayes.inference.mcmc import StoppingRule
from ldbb_bayes.machine.forward import compliance_jacobian, geometric_jacobian
from ldbb_bayes.machine.identifiable import kept_compliances
from ldbb_bayes.model.hybrid import information_of
from ldbb_bayes.model.likelihood import NOISE, OWN, Information
from ldbb_bayes.report.wording import statement, verdict_words, with_words

PHI = np.array([0.3e-3, 0.5e-3, 0.3e-3, 2e-3])
LINEAR = lb.HybridModel.default(1)
AT = np.linspace(0.1, 6.0, 37)


def clocked(turns: tuple[tuple[float, float], ...]) -> lb.Campaign:
    angle = np.arange(60) * 6.0
    forces = (36.0, 238.0, 490.0, 742.0)
    tests = [lb.CircularTest(f, angle, work_ball_deg=w, tool_ball_deg=t) for w, t in turns for f in forces]
    return lb.Campaign(tuple(tests))


def two(angle: float, *, readings: int = 100, noise: float = 1.0, sd: tuple[float, float] = (10.0, 2.0)) -> Information:
    """E and a form whose columns enclose an angle [rad]."""
    rows = np.zeros((readings, 2))
    rows[:, 0] = 1.0
    rows[0::2, 1], rows[1::2, 1] = np.cos(angle) + np.sin(angle), np.cos(angle) - np.sin(angle)
    return Information(("E", "form"), (OWN, "BallForm"), np.array(sd), False, (rows,), ({NOISE: noise**2 * np.eye(readings)},))


# Two parameters


def test_the_limit_of_two_confounded_parameters() -> None:
    """E ~ N(0, 10²), form ~ N(0, 2²), noise 1, many readings: Var(E | y) → 100 · 4 / 104 (MODEL: closed form)."""
    information = two(0.0, readings=2_000_000 // 1000)
    information = replace(information, noise=({NOISE: 1e-9 * np.eye(2000)},))
    confounding = Confounding(information)
    covariance = information.covariance()
    assert 1.0 - confounding.variance[0] == pytest.approx(100.0 / 104.0, abs=1e-6)
    assert 1.0 - confounding.variance[0] == pytest.approx(0.96154, abs=1e-5)
    assert confounding.fraction["BallForm"][0] == pytest.approx(1.0, abs=1e-6)
    assert confounding.sensitivity["BallForm"][0] == pytest.approx(100.0 / 104.0, abs=1e-5)
    assert covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1]) == pytest.approx(-1.0, abs=1e-6)


def test_two_parameters_at_any_noise() -> None:
    """Var(E | y) = 1 / (1/100 + 1/(4 + v)), known form: 1 / (1/100 + 1/v), v = 1/100 the variance of a mean of 100 readings."""
    confounding = Confounding(two(0.0))
    given, known = 1.0 / (0.01 + 1.0 / 4.01), 1.0 / (0.01 + 1.0 / 0.01)
    assert confounding.variance[0] * 100.0 == pytest.approx(given)
    assert confounding.fraction["BallForm"][0] == pytest.approx(1.0 - known / given)
    assert confounding.shares["BallForm"][0] + confounding.shares[NOISE][0] == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("angle", [1e-1, 1e-2, 1e-3, 1e-8, 0.0])
def test_near_collinear_designs_are_graded(angle: float) -> None:
    """The share of E's variance where priors outweigh readings tenfold falls as the columns come apart; nothing breaks."""
    information = two(angle)
    unseen = Confounding(information).unseen_share()[0]
    fraction = Confounding(information).fraction["BallForm"][0]
    expected = np.linalg.inv(np.diag([0.01, 0.25]) + information.design[0].T @ information.design[0])[0, 0]
    assert information.variances()[0] * 100.0 == pytest.approx(expected, rel=1e-6)
    assert 0.0 <= fraction <= 1.0
    assert bool(unseen > 0.5) is (angle < 0.03)
    assert fraction > 0.5


# Shares


@pytest.mark.parametrize("planned", [plan(), plan(work_deg=40.0, tool_deg=-25.0), plan((9, 40, 12, 30), arc_deg=220.0)])
def test_shapley_shares_sum_to_one(planned: lb.Campaign) -> None:
    for degree in (0, 1):
        for entry in lb.identify(lb.HybridModel.default(degree), planned).parameters.values():
            assert sum(entry.shapley.values()) == pytest.approx(1.0, abs=1e-9)
            assert min(entry.shapley.values()) > -1e-9
            assert sum(entry.sensitivity.values()) == pytest.approx(1.0, abs=1e-9)


def test_shapley_shares_by_all_orders() -> None:
    """Averaged over all 6! orders in which the terms become known."""
    from itertools import permutations

    information = information_of(LINEAR.bind(plan()), PHI)
    confounding = Confounding(information)
    terms = confounding.terms
    worth: dict[frozenset[str], np.ndarray] = {}

    def of(known: frozenset[str]) -> np.ndarray:
        if known not in worth:
            worth[known] = 1.0 - information.variances(known) / confounding.variance
        return worth[known]

    total = {term: np.zeros(len(confounding.variance)) for term in terms}
    orders = list(permutations(terms))
    for order in orders:
        for i, term in enumerate(order):
            total[term] += of(frozenset(order[: i + 1])) - of(frozenset(order[:i]))
    for term in terms:
        np.testing.assert_allclose(confounding.shares[term], total[term] / len(orders), atol=1e-12)


@pytest.mark.parametrize("planned", [plan(), plan(work_deg=40.0), plan((9, 40, 12, 30), arc_deg=220.0)])
@pytest.mark.parametrize(("term", "name"), [("BallForm", "form"), ("BarLength", "length"), ("Mount", "mount")])
def test_confounding_fraction_by_the_oracle(planned: lb.Campaign, term: str, name: str) -> None:
    """1 − Var(β | y, g) / Var(β | y): knowing a zero-mean term is leaving it out of the covariance."""
    campaign = simulated(planned)
    bound, oracle = LINEAR.bind(campaign), oracle_of(campaign, 1)
    every = np.diag(oracle.given(PHI)[2])
    if term == "BallForm":
        known = np.diag(oracle.given(PHI * [1, 1, 1, 0])[2])
    else:
        terms = tuple(t for t in ("form", "length", "mount", "force", "setup", "discrepancy") if t != name)
        known = np.diag(oracle_of(campaign, 1, terms=terms).given(PHI)[2])
    found = Confounding(information_of(bound, PHI)).fraction[term]
    np.testing.assert_allclose(found, np.clip(1.0 - known / every, 0.0, 1.0), atol=1e-6)


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
    assert entries["C_XYX"].verdict == "identified"


def test_differences_are_not(recovered: lb.Campaign) -> None:
    """E_XX1 − E_YY1 is not confounded with the length, C_XXX − C_YYY not with the mount, though each of them is."""
    bound = LINEAR.bind(recovered)
    information = information_of(bound, PHI)

    def share(first: str, second: str, term: str) -> tuple[float, float]:
        i, j = bound.names.index(first), bound.names.index(second)
        step = np.zeros(len(information.names))
        step[i], step[j] = information.scale[i], -information.scale[j]

        def of(known: list[str], direction: np.ndarray) -> float:
            return float(direction @ information.covariance(known) @ direction)

        alone = np.where(np.arange(len(step)) == i, step, 0.0)
        return 1.0 - of([term], alone) / of([], alone), 1.0 - of([term], step) / of([], step)

    alone, difference = share("E_XX1", "E_YY1", "BarLength")
    assert alone > 0.5
    assert difference < 1e-6
    alone, difference = share("C_XXX", "C_YYY", "Mount")
    assert alone > 0.2
    assert difference < 1e-3
    gain = Confounding(information).fraction["ForceError"]
    assert gain[bound.names.index("C_XXX")] > 0.05


def test_four_lobes_are_separated_from_rotation_by_force_only(recovered: lb.Campaign) -> None:
    def weak(campaign: lb.Campaign, degree: int) -> lb.ParameterIdentifiability:
        return lb.identify(lb.HybridModel.default(degree), campaign).parameters["C_CCY"]

    one = replace(recovered.plan(), tests=(recovered.plan().tests[-1],))
    assert "BallForm" in weak(one, 0).partners
    assert weak(one, 0).confounding["BallForm"] > 0.9
    assert weak(recovered.plan(), 0).confounding["BallForm"] < 0.9
    assert weak(recovered.plan(), 0).verdict == "identified"


def test_verdicts_of_a_posterior(recovered: lb.Campaign) -> None:
    tree = lb.sample(LINEAR, recovered, rule=StoppingRule(ess=300.0, lengths=1.0))
    found = lb.verdicts(tree)
    assert re.fullmatch(r"confounded with ball form \(\d\d %\)", verdict_words(found["E_C0YX"]))
    assert verdict_words(found["C_XYX"]) == "identified"
    draws = tree["posterior"]["C_XXX"].to_numpy()
    assert found["C_XXX"].sd == pytest.approx(draws.std())
    assert found["C_XXX"].contraction == pytest.approx(1.0 - draws.var() / tree["prior"]["C_XXX"].to_numpy().var())


def test_what_the_prior_decides_is_called_so() -> None:
    """A prior far narrower than the readings can tell leaves nothing to them."""
    model = replace(lb.HybridModel.default(0), prior=replace(lb.Prior.default(), cross_mm_per_N=1e-8))
    entry = lb.identify(model, plan()).parameters["C_XYX"]
    assert (entry.verdict, verdict_words(entry)) == ("prior-limited", "prior-limited")
    assert entry.contraction < 0.2
    assert entry.overlap > 0.8


def test_a_term_left_out_bounds_nothing() -> None:
    entry = lb.identify(lb.HybridModel.default(0).without("ball-form"), plan()).parameters["E_C0YX"]
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
    one = lb.identify(LINEAR, clocked(((0.0, 0.0), (45.0, 0.0), (90.0, 0.0))))
    assert one.parameters["E_C0YX"].verdict == "confounded"
    assert any("the tool ball's 2-lobe form" in statement(d) for d in one.degeneracies)
    half = lb.identify(LINEAR, clocked(((0.0, 0.0), (180.0, 180.0)))).parameters
    assert half["E_C0YX"].verdict == "confounded"
    assert half["E_YX2"].verdict == "identified"


@pytest.mark.parametrize(
    ("turn", "word"), [(0.0, "confounded"), (6e-7, "confounded"), (0.06, "confounded"), (5.0, "confounded"), (20.0, "identified")]
)
def test_the_partner_is_always_named(turn: float, word: str) -> None:
    """From no clocking to enough of it: form holds most of the variance of E_C(0Y)X long before it is told apart, and after."""
    angle = np.arange(60) * 6.0
    tests = [lb.CircularTest(f, angle, work_ball_deg=p, tool_ball_deg=p) for p in (0.0, turn) for f in (36.0, 390.0, 742.0)]
    entry = lb.identify(LINEAR, lb.Campaign(tuple(tests))).parameters["E_C0YX"]
    assert entry.verdict == word
    assert entry.partners[0] == "BallForm"
    assert entry.confounding["BallForm"] > 0.5


def test_readings_change_nothing_but_the_hyper_parameters(recovered: lb.Campaign, identified: lb.Identifiability) -> None:
    assert identified.measured
    assert not lb.identify(LINEAR, recovered.plan()).measured
    exact = lb.marginals(LINEAR.without("truncation"), recovered)
    for name in ("C_XYX", "E_XX1", "E_C0YX"):
        assert identified.parameters[name].mean == pytest.approx(exact.loc[name, "mean"], abs=0.3 * exact.loc[name, "sd"])
        assert identified.parameters[name].sd == pytest.approx(exact.loc[name, "sd"], rel=0.25)


# The other numbers


@pytest.fixture(scope="module")
def small() -> tuple[lb.Campaign, lb.Identifiability]:
    campaign = simulated(plan())
    return campaign, lb.identify(LINEAR, campaign)


def test_directions_by_the_oracle(small: tuple[lb.Campaign, lb.Identifiability]) -> None:
    """Gains, effective parameters and loadings of explicit matrices."""
    campaign, found = small
    oracle = oracle_of(campaign, 1)
    covariance = oracle.given(np.array(list(found.hyper_um.values())) * 1e-3)[2] / np.outer(oracle.sd, oracle.sd)
    gains = np.array([d.gain for d in found.directions])
    expected = np.sort(np.linalg.eigvalsh(np.linalg.inv(covariance)) - 1.0)[::-1]
    np.testing.assert_allclose(gains, expected, rtol=1e-4, atol=1e-6)
    assert found.effective_parameters == pytest.approx((expected / (1.0 + expected)).sum(), rel=1e-6)
    for direction in found.directions[:8]:
        loadings = np.array(list(direction.loadings.values()))
        np.testing.assert_allclose(covariance @ loadings, loadings / (1.0 + direction.gain), atol=1e-7)
        assert np.linalg.norm(loadings) == pytest.approx(1.0)


def test_variance_inflation_and_correlations_by_definition(small: tuple[lb.Campaign, lb.Identifiability]) -> None:
    campaign, found = small
    information = information_of(LINEAR.bind(campaign), np.array(list(found.hyper_um.values())) * 1e-3)
    rows = information.rows()
    precision = rows.T @ rows + np.eye(rows.shape[1])
    covariance = np.linalg.inv(precision)
    sd = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(found.correlation, covariance / np.outer(sd, sd), atol=1e-6)
    for k, (name, entry) in zip(information.own, found.parameters.items(), strict=True):
        assert entry.variance_inflation == pytest.approx(covariance[k, k] * precision[k, k], rel=1e-6)
        others = np.delete(np.abs(covariance[k] / (sd[k] * sd)), k)
        np.testing.assert_allclose(np.abs(list(entry.correlations.values())), np.sort(others)[::-1][:3], atol=1e-6, err_msg=name)


def test_alias_matrix_and_condition_numbers(small: tuple[lb.Campaign, lb.Identifiability]) -> None:
    """One prior sd of a nuisance left out, pushed through numpy's least squares on all readings; numpy's condition numbers."""
    campaign, found = small
    oracle = oracle_of(campaign, 1)
    scaled = oracle.J * oracle.sd
    expected = np.linalg.lstsq(scaled, np.full(len(scaled), 9.4e-3), rcond=None)[0] * oracle.sd
    np.testing.assert_allclose(found.alias["bar_length"], expected, atol=1e-9 * oracle.sd.max())
    assert found.alias.loc["E_XX1", "bar_length"] == pytest.approx(9.4e-3 / 150.0, rel=1e-6)
    assert found.condition_number == pytest.approx(np.linalg.cond(oracle.J), rel=1e-6)
    assert found.scaled_condition_number == pytest.approx(np.linalg.cond(scaled), rel=1e-6)


@pytest.mark.parametrize(
    ("mean", "sd"), [(0.0, 0.2), (1.5, 0.3), (0.0, 1.0), (2.0, 1.0), (0.3, 0.999999), (-4.0, 0.01), (1.0, 2.0)]
)
def test_overlap_by_quadrature(mean: float, sd: float) -> None:
    both = [stats.norm(0.0, 1.0), stats.norm(mean, sd)]
    points = sorted({mean - 8 * sd, mean, mean + 8 * sd, -1.0, 0.0, 1.0})
    area = integrate.quad(lambda x: min(d.pdf(x) for d in both), -12.0, 12.0, points=points, limit=400)[0]
    assert overlap(mean, sd) == pytest.approx(area, abs=1e-6)


# What circles show of a machine


def test_circles_of_the_papers_machine() -> None:
    machine = lb.describe(lb.Machine("wCAFYXZSt", "XY"))
    patterns = {entry.name: entry.pattern["XY"] for entry in (*machine.compliances, *machine.geometric_errors)}
    assert patterns == {
        "C_XXX": "c²",
        "C_XYX": "cs",
        "C_YYY": "s²",
        "C_CXY": "R c²s",
        "C_CYY": "R cs²",
        "C_CCY": "R² c²s²",
        "E_XX1": "R c²",
        "E_YX2": "R² c²s",
        "E_XY2": "R² cs²",
        "E_YY1": "R s²",
        "E_C0YX": "R cs",
        "E_Xt0": "c",
        "E_Yt0": "s",
    }


def value_of(pattern: str, radius: float, angle: np.ndarray) -> np.ndarray:
    """A printed pattern as numbers, by reading it back."""
    text = pattern.replace("−", "-").replace(" - ", " + -").removeprefix("+")
    total = np.zeros_like(angle)
    for term in text.split(" + "):
        sign, body = (-1.0, term[1:]) if term.startswith("-") else (1.0, term)
        value = np.full_like(angle, sign)
        for word in body.split():
            if word[0] in "0123456789.":
                value = value * float(word)
                continue
            for letter, power in zip(word, (*word[1:], ""), strict=True):
                base = {"R": radius, "c": np.cos(angle), "s": np.sin(angle)}.get(letter)
                if base is not None:
                    value = value * base ** {"²": 2, "³": 3, "⁴": 4}.get(power, 1)
        total = total + value
    return total


@pytest.mark.parametrize(
    ("topology", "planes", "frames", "centre"),
    [
        ("wYXFZt", ("XY",), {"X": (0.0, -200.0, 350.0)}, (10.0, 20.0, 0.0)),
        ("wXFYZt", ("XY", "YZ", "ZX"), {"Y": (30.0, 0.0, -120.0)}, (0.0, -15.0, 40.0)),
    ],
)
def test_patterns_say_what_the_columns_are(topology: str, planes: tuple[str, ...], frames: dict, centre: tuple) -> None:
    machine = lb.Machine(topology, planes, frames)
    circles = [lb.Circle(150.0, centre, plane) for plane in planes]
    found = lb.describe(machine, circles)
    kept = kept_compliances(machine, *circles)
    for plane in planes:
        small = lb.Circle(80.0, centre, plane)
        columns = {
            name.label: column
            for name, column in zip(kept.names, compliance_jacobian(machine, small, AT, kept.names).T, strict=True)
        }
        columns |= {
            entry.name: column
            for entry, column in zip(found.geometric_errors, geometric_jacobian(machine, small, AT).T, strict=True)
        }
        for entry in (*found.compliances, *found.geometric_errors):
            shown = entry.pattern.get(plane)
            expected = np.zeros_like(AT) if shown is None else value_of(shown, 80.0, AT)
            np.testing.assert_allclose(columns[entry.name], expected, rtol=1e-5, atol=1e-5 * max(1.0, np.abs(expected).max()))
