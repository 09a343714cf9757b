"""design(): the paper's preset, dense oracles, goals, places, forecasts against simulation, refusals."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations_with_replacement, pairwise, product
from pathlib import Path

import numpy as np
import pytest
from campaigns import TRUTH, plan, simulated
from oracle import Oracle, OracleTest

import ldbb_bayes as lb
from ldbb_bayes.analysis.design import candidates
from ldbb_bayes.analysis.design.candidates import Space, bind_tests, foreseen_by, grid_of_tests, running_order, templates
from ldbb_bayes.analysis.design.design import Outcome, RemedyKind, _limits, fewest
from ldbb_bayes.analysis.design.forecast import States, discrimination_of, narrowed
from ldbb_bayes.errors import InputError
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.hybrid import information_of
from ldbb_bayes.model.terms import SetupShift
from ldbb_bayes.report.wording import design_notes, design_sentences, with_words
from ldbb_bayes.result import json_text

LINEAR = lb.HybridModel.default(1)
LEVELS = tuple(np.linspace(36.0, 742.0, 13))
THREE = (36.0, 389.0, 742.0)
BOTH = tuple(product((0.0, 45.0, 90.0), repeat=2))
PHI = np.array([1.2e-4, 6e-4, 2.5e-4, 2e-3])
pytestmark = pytest.mark.usefixtures("few_states")
PHI_UM = dict(zip(("sigma", "delta", "kappa", "tau"), 1e3 * PHI, strict=True))


@pytest.fixture(scope="module")
def pilot() -> lb.Campaign:
    return simulated(plan(), seed=2)


@pytest.fixture(scope="module")
def clockwise(pilot: lb.Campaign) -> lb.Campaign:
    return replace(pilot, tests=tuple(replace(test, direction="CW") for test in pilot.tests))


@pytest.fixture(scope="module")
def six(pilot: lb.Campaign) -> lb.Design:
    return lb.design(LINEAR, pilot, tests=6, forces_N=LEVELS, against={"its own": pilot}, curve=True)


@pytest.mark.parametrize(
    ("degree", "forces", "shares", "efficiency"),
    [(0, (36.0, 742.0), (0.4547, 0.5453), 0.725), (1, (36.0, 386.4, 742.0), (0.2959, 0.3513, 0.3528), 0.804)],
)
def test_the_paper_preset(degree: int, forces: tuple[float, ...], shares: tuple[float, ...], efficiency: float) -> None:
    """D-optimal shares over 36 to 742 N on a 1 N grid, the certificate there, and what the paper's seven levels are worth."""
    seven = plan((60,) * 7, forces_N=(36.0, 112.0, 238.0, 364.0, 490.0, 616.0, 742.0))
    found = lb.design(lb.HybridModel.paper(degree), seven, tests=7, against={"seven": seven})
    support = found.shares.groupby((found.shares["force_N"] / 100.0).round())
    np.testing.assert_allclose(support["share"].sum(), shares, atol=1e-4)
    centre = support.apply(lambda own: np.average(own["force_N"], weights=own["share"]), include_groups=False)
    np.testing.assert_allclose(centre, forces, atol=0.35)
    assert len(found.sensitivity) == 707
    parameters = 13 if degree == 0 else 19
    assert found.certificate.bound == pytest.approx(parameters, abs=1e-6)
    assert found.certificate.max_sensitivity <= parameters * (1.0 + 1e-5)
    assert found.certificate.is_global
    assert found.compared[1].efficiency == pytest.approx(efficiency, abs=1e-3)
    assert found.compared[0].efficiency < found.efficiency <= 1.0


def test_information_against_the_dense_oracle(pilot: lb.Campaign) -> None:
    """Posterior covariance of a plan with clocked balls and two radii, and the expected information gain, by dense matrices."""
    model, like = LINEAR.without("force-error", "truncation"), templates(pilot, (), (), ())
    tests = [
        *grid_of_tests(like, (36.0, 742.0), ((0.0, 0.0), (45.0, 90.0)), (150.0,), 30),
        *grid_of_tests(like, (300.0,), ((0.0, 0.0),), (100.0,), 30),
    ]
    law = pilot.force_law
    stated = [
        (t.force_N, law.pressure_bar(t.force_N), *map(np.deg2rad, (t.angle_deg, t.work_ball_deg, t.tool_ball_deg)), t.radius_mm)
        for t in tests
    ]
    own = [OracleTest(f, p, angle, np.zeros(30), work, tool, radius) for f, p, angle, work, tool, radius in stated]
    dense = Oracle(own, 1, terms=("form", "length", "mount", "setup", "discrepancy"))
    _, _, covariance = dense.given(PHI)
    p = len(dense.names)
    prior = Gaussian.of(np.zeros((1, p)), dense.sd[None] ** 2)
    found = Space(model, pilot, LEVELS).forecast(tests, states=States(PHI[None], np.zeros((1, p)), prior))
    assert list(found.expected) == dense.names
    sd = np.array([entry.sd for entry in found.expected.values()])
    np.testing.assert_allclose(sd, np.sqrt(np.diag(covariance)), rtol=1e-7)
    gain = 0.5 * (np.log(dense.sd**2).sum() - np.linalg.slogdet(covariance)[1])
    assert found.information_gain == pytest.approx(gain, abs=1e-6)


def dense_sd(model: lb.HybridModel, campaign: lb.Campaign, tests: Sequence[lb.CircularTest], name: str, *, times: float) -> float:
    """Posterior sd of a parameter at PHI, every test run so often, by inverting the whole precision matrix."""
    information = information_of(bind_tests(model, campaign, tests, keep=False), PHI)
    rows, k = information.rows(), information.names.index(name)
    covariance = np.linalg.inv(times * rows.T @ rows + np.eye(rows.shape[1]))
    return float(np.sqrt(covariance[k, k]) * information.scale[k])


def test_hysteresis_counts_for_every_design_that_could_have_both_ways(clockwise: lb.Campaign) -> None:
    """Expected and least sd of C_XYX by dense matrices: circles of one direction show it no better than the friction does."""
    plain = LINEAR.without("truncation")
    both = lb.design(plain, clockwise, tests=6, forces_N=THREE, directions=("CW", "CCW"), parameters=["C_XYX"])
    assert {test.direction for test in both.tests} == {"CW", "CCW"}
    one_way = tuple(replace(test, direction="CW") for test in both.tests)
    wider = foreseen_by(clockwise, templates(clockwise, (), ("CW", "CCW"), ()))
    p = len(plain.bind(wider).names)
    prior = Gaussian.of(np.zeros((1, p)), plain.bind(wider).prior_sd[None] ** 2)
    for tests in (both.tests, one_way):
        states = States(PHI[None], np.zeros((1, p)), prior)
        found = Space(plain, wider, THREE).forecast(tests, states=states).expected["C_XYX"]
        assert found.sd == pytest.approx(dense_sd(plain, wider, tests, "C_XYX", times=1.0), rel=1e-9)
        assert found.floor_sd == pytest.approx(dense_sd(plain, wider, tests, "C_XYX", times=1e6), rel=1e-3)
    # F s sin 2θ of 1 µm/kN is 2 µm/kN of C_XYX: with one sd of 2 µm/kN / 2 a friction of 2e-6 mm/N stays in it.
    hidden = 2e-6 * 1e-5 / np.hypot(2e-6, 1e-5)
    assert dense_sd(plain, wider, one_way, "C_XYX", times=1.0) == pytest.approx(hidden, rel=0.15)
    assert dense_sd(plain, wider, both.tests, "C_XYX", times=1.0) < 0.75 * hidden


@pytest.mark.parametrize("criterion", ["eig", "a", "e", "i", "discriminate"])
def test_the_search_and_the_forecast_agree(pilot: lb.Campaign, criterion: str) -> None:
    """The criterion by the search's compact rows against explicit covariances, arcs and clockings included, at the same φ."""
    arcs = simulated(plan((40,) * 4, arc_deg=250.0), seed=3)
    for campaign, augment in ((pilot, False), (arcs, True)):
        space = Space(LINEAR, campaign, LEVELS[::4], BOTH[:3], criterion=criterion, augment=augment)
        tests = (*space.tests[:3], space.tests[7])
        bound = bind_tests(LINEAR, campaign, tests, keep=augment)
        values = []
        for value in candidates.hyper_nodes(LINEAR, campaign, 4, 1):
            information = information_of(bound, value)
            own = [information.names.index(name) for name in space.chosen]
            c = information.covariance()[np.ix_(own, own)]
            s = np.linalg.eigvalsh(np.linalg.inv(c))
            rows = np.array([bound.compliance_at(f) * bound.scale for f in np.linspace(36.0, 742.0, 33)])
            unit = bound.scale[:6, None]
            values.append(
                {
                    "eig": lambda c=c: -np.linalg.slogdet(c)[1],
                    "a": lambda c=c: -np.trace(c) / len(c),
                    "e": lambda s=s: s[0],
                    "i": lambda c=c, r=rows, u=unit: -np.mean([np.diag((x / u) @ c @ (x / u).T) for x in r[:, :, :12]]),
                    "discriminate": lambda s=s: 0.25 * ((s - 1.0) ** 2 / s).sum(),
                }[criterion]()
            )
        assert len(space.search.objective.cases[0].weight) == len(values)
        assert space.value(tests) == pytest.approx(np.mean(values), rel=1e-6)
        counts = np.zeros(len(space.tests))
        counts[[0, 1, 2, 7]] = 1.0
        assert space.search.objective.value(counts) == pytest.approx(space.value(tests), rel=1e-9)


def test_what_does_not_matter(pilot: lb.Campaign) -> None:
    """How F0 is given, for criterion i; whole turns; the pilot's rule for balls, and a common turn of all tests. Arcs do."""
    given = replace(LINEAR, reference_force_N=389.0)
    values = [(s := Space(m, pilot, (200.0, 389.0, 742.0), criterion="i")).value(s.tests) for m in (LINEAR, given)]
    assert values[0] == pytest.approx(values[1], rel=1e-6)
    space, plain = (
        Space(LINEAR, pilot, LEVELS, ((0.0, 0.0), (360.0, 0.0), (45.0, 90.0), (405.0, 450.0))),
        Space(LINEAR, pilot, LEVELS),
    )
    assert space.clockings_deg == ((0.0, 0.0), (45.0, 90.0))
    turned = grid_of_tests(space.templates, LEVELS[::3], ((45.0, 90.0),), space.radii_mm, None)
    still = grid_of_tests(plain.templates, LEVELS[::3], ((0.0, 0.0),), plain.radii_mm, None)
    assert space.value(turned) == pytest.approx(plain.value(still), rel=1e-9)
    assert plain.value(plan((40,) * 4, arc_deg=220.0).tests) < plain.value(plan().tests)


def test_a_design_of_six(six: lb.Design, pilot: lb.Campaign) -> None:
    assert len(six.tests) == six.table["count"].sum() == 6
    assert six.certificate.holds
    assert six.compared[0].efficiency < six.efficiency <= 1.0
    assert six.efficiency > 0.99
    assert six.compared[1].name == "its own"
    forces = sorted({float(t.force_N) for t in six.tests})
    assert (forces[0], forces[-1]) == (36.0, 742.0)
    assert list(six.trade_off["efficiency"] > six.trade_off["efficiency_equal_steps"] - 1e-9) == [True] * len(six.trade_off)
    assert 6 in set(six.trade_off["tests"])
    for name, entry in six.expected.items():
        assert 0.0 < entry.floor_sd < entry.untruncated_sd <= entry.prior_sd * (1 + 1e-9), name
        assert entry.sd <= entry.untruncated_sd * (1 + 1e-3)
    said = " ".join(design_sentences(six))
    assert "Run 6 circles" in said
    assert "looks exactly like +13.3 µrad of E_C(0Y)X. Cure: Clocking both balls" in said
    assert "Good over" not in said
    assert len(six.expected_table()) == 19


def test_read_back(six: lb.Design, pilot: lb.Campaign, tmp_path: Path) -> None:
    """design.json holds every finding: sentences and numbers of a design read back are the same; its tests are in the plan."""
    (tmp_path / "design.json").write_text(json_text({"schema": 1, **with_words(six)}), encoding="utf-8")
    back = lb.read_design(tmp_path)
    assert json_text(back.as_dict()) == json_text(six.as_dict())
    assert design_sentences(back) == design_sentences(six)
    assert back.pilot.sha256 == pilot.sha256
    with pytest.raises(InputError, match="a design must be at hand, got one read from a file"):
        back.plan()
    (tmp_path / "design.json").write_text('{"pilot": {}}', encoding="utf-8")
    with pytest.raises(InputError, match=r"design\.json must be a design written by"):
        lb.read_design(tmp_path)


def test_the_best_of_few(pilot: lb.Campaign) -> None:
    """Against every design of four tests among five levels."""
    space = Space(LINEAR, pilot, LEVELS[::3])
    found = space.search.of_number(4)
    every = [np.bincount(chosen, minlength=5).astype(float) for chosen in combinations_with_replacement(range(5), 4)]
    assert found.value == pytest.approx(max(map(space.search.objective.value, every)), rel=1e-9)
    assert found.efficiency <= 1.0 + 1e-9


def test_a_budget_that_pays_for_both_balls_or_neither(pilot: lb.Campaign) -> None:
    """Clocking one ball alone is not worth its set-up, both are: two more clockings are tried at once."""
    options = {"forces_N": LEVELS[::6], "clockings_deg": ((0.0, 0.0), (45.0, 0.0), (0.0, 45.0)), "costs": lb.Costs(1.0, 4.0, 4.0)}
    found = lb.design(LINEAR, pilot, budget=20.0, **options)
    other = lb.design(LINEAR, pilot, tests=12, **options)
    assert other.cost <= 20.0
    assert found.information_gain >= other.information_gain - 1e-3
    assert "among the clockings chosen" in design_notes(found)[0]


@pytest.mark.parametrize(
    ("clockings", "changes"),
    [
        ([(0, 0), (45, 0), (90, 0)], 0),
        ([(0, 0), (0, 45), (0, 90)], 2),
        ([(0, 0), (0, 45), (45, 0), (45, 45)], 2),
        ([(0, 0), (45, 45), (90, 0)], 1),
        ([(0, 0), (45, 45), (90, 90)], 2),
        ([(0, 0), (0, 45), (45, 45), (90, 90)], 2),
    ],
)
def test_tool_ball_changes(clockings: list[tuple[float, float]], changes: int) -> None:
    """By hand: blocks of the work ball in the order that turns the tool ball least; the running order keeps to it."""
    works = len({work for work, _ in clockings})
    assert lb.Costs(1.0, 100.0, 1.0).setups(clockings) == 100.0 * (works - 1) + changes
    tests = [
        lb.CircularTest(100.0, np.arange(36) * 10.0, work_ball_deg=w, tool_ball_deg=t) for w, t in clockings for _ in range(2)
    ]
    for seed in range(5):
        run = running_order(tests, np.random.default_rng(seed))
        assert sum(a.tool_ball_deg != b.tool_ball_deg for a, b in pairwise(run)) == changes
        assert sum(a.work_ball_deg != b.work_ball_deg for a, b in pairwise(run)) == works - 1


def test_set_ups_are_run_one_after_the_other() -> None:
    tests = [
        lb.CircularTest(force, np.arange(36) * 10.0, setup=setup, radius_mm=radius)
        for force, setup, radius in product((100.0, 400.0, 700.0), (1, 2, 3), (100.0, 150.0))
    ]
    for seed in range(5):
        places = [(test.setup, test.radius_mm) for test in running_order(tests, np.random.default_rng(seed))]
        assert sum(one != other for one, other in pairwise(places)) == 5
        assert sum(one[0] != other[0] for one, other in pairwise(places)) == 2


def test_the_order_in_which_to_run(six: lb.Design) -> None:
    """Forces at random, the same for the same seed."""
    ordered = six.plan(seed=3)
    assert ordered.is_plan
    assert sorted(ordered.forces_N) == sorted(float(t.force_N) for t in six.tests)
    assert tuple(ordered.forces_N) == tuple(six.plan(seed=3).forces_N)
    assert len({tuple(six.plan(seed=seed).forces_N) for seed in range(6)}) > 3


def test_a_plan_for_a_model_with_drift(pilot: lb.Campaign) -> None:
    """At the pilot's pace, or at its mean temperature; the plan is one that the model can be asked about."""
    timed = replace(pilot, tests=tuple(replace(t, time_s=600.0 * k, temperature_C=20.0 + k) for k, t in enumerate(pilot.tests)))
    found = lb.design(LINEAR.including(lb.Drift("time")), timed, tests=5, forces_N=THREE)
    assert found.certificate.holds
    assert found.limits.drift
    assert [test.time_s for test in found.plan().tests] == [0.0, 600.0, 1200.0, 1800.0, 2400.0]
    assert lb.identify(found.model, found.plan()).parameters
    warm = lb.design(LINEAR.including(lb.Drift("temperature")), timed.plan(), tests=5, forces_N=THREE)
    assert {test.temperature_C for test in warm.plan().tests} == {21.5}


def test_targets(pilot: lb.Campaign) -> None:
    """The fewest tests reach every target; one fewer does not, not even in the best shares."""
    wanted = {"C_XYX": 9e-7, "C_CCY": 9e-11}
    found = lb.design(LINEAR, pilot, targets=wanted, forces_N=LEVELS)
    assert all(found.expected[name].sd <= sd for name, sd in wanted.items())
    number = len(found.tests)
    goal = f"{number} circles are the fewest found that reach u(C_XYX) ≤ 0.0009 µm/N and u(C_CCY) ≤ 0.09 µrad/(N m)."
    assert goal in design_notes(found)
    fewer = lb.design(LINEAR, pilot, tests=number - 1, forces_N=LEVELS, criterion="a", parameters=tuple(wanted))
    assert any(fewer.expected[name].untruncated_sd > sd for name, sd in wanted.items())


def test_a_truncated_target(pilot: lb.Campaign) -> None:
    """C_CCY is narrower inside the truncation than without: a target between the two is reached by as few circles."""
    space = Space(LINEAR, pilot, LEVELS, criterion="c", parameters=("C_CCY",))
    entry = space.forecast(space.tests_of(space.search.of_number(6))).expected["C_CCY"]
    assert entry.sd < 0.95 * entry.untruncated_sd
    target = 0.5 * (entry.sd + entry.untruncated_sd)
    aimed = replace(space, criterion="a", targets={"C_CCY": target})
    found, goal = fewest(aimed, None)
    assert (goal.outcome, goal.tests) == (Outcome.REACHED, found.tests)
    assert found.tests <= 6
    assert aimed.forecast(aimed.tests_of(found)).expected["C_CCY"].sd <= target


def test_a_target_that_forces_cannot_meet(pilot: lb.Campaign) -> None:
    """E_C(0Y)X looks like the 2-lobe form: the alias is named, and what cures it, with the number of circles; and it does."""
    found = lb.design(LINEAR, pilot, targets={"E_C0YX": 3e-6}, forces_N=LEVELS)
    said = " ".join(design_notes(found))
    assert "No number of these circles up to 100 reaches u(E_C(0Y)X) ≤ 3 µrad." in said
    assert "both balls clocked at 0, 45 and 90°" in said
    assert "a second radius of 100 mm" in said
    assert "2-lobe form (sin 2θ) looks exactly like +13.3 µrad of E_C(0Y)X" in said
    assert found.expected["E_C0YX"].floor_sd > 3e-6
    cured = lb.design(LINEAR, pilot, targets={"E_C0YX": 3e-6}, forces_N=LEVELS, clockings_deg=BOTH)
    assert cured.expected["E_C0YX"].sd <= 3e-6
    assert "fewest" in design_notes(cured)[0]
    assert lb.identify(LINEAR, cured.plan()).parameters["E_C0YX"].verdict == "identified"


def test_power(pilot: lb.Campaign) -> None:
    found = lb.design(LINEAR, pilot, power=0.8, parameters=("C_XYX_1",), slope_size=2.0, forces_N=LEVELS, threshold=3.0)
    assert found.criterion == "discriminate"
    assert found.discrimination is not None
    assert found.discrimination.power["C_XYX_1"] >= 0.8
    assert not found.certificate.is_global


def test_augmenting_and_other_levels(pilot: lb.Campaign) -> None:
    """Two tests on top of the pilot's own: no wider than without them. A target already reached needs no more."""
    more = lb.design(LINEAR, pilot, tests=2, forces_N=LEVELS[::3], augment=True)
    alone = Space(LINEAR, pilot, LEVELS).forecast(pilot.tests).expected
    assert all(entry.untruncated_sd <= alone[name].untruncated_sd * (1 + 1e-6) for name, entry in more.expected.items())
    assert "Run 2 more circles" in design_sentences(more)[0]
    space = Space(LINEAR, pilot, LEVELS[::3], criterion="a", parameters=("C_XXX",), targets={"C_XXX": 1e-4}, augment=True)
    assert fewest(space, None)[1].outcome is Outcome.ALREADY
    # Two levels leave C_XYX to its slope: other levels cure that, clocking and radii do not.
    space = Space(LINEAR, pilot, (36.0, 742.0), criterion="a", parameters=("C_XYX",), targets={"C_XYX": 9e-7})
    goal = fewest(space, None)[1]
    assert goal.outcome is Outcome.OUT_OF_REACH
    assert [remedy.kind for remedy in goal.remedies] == [RemedyKind.LEVELS]


def test_robustness(pilot: lb.Campaign) -> None:
    found = lb.design(LINEAR, pilot, tests=5, forces_N=LEVELS, robust=True)
    table = found.robustness
    assumptions = [column for column in table if column not in ("tests", "worst")]
    assert len(assumptions) == 10
    for label in assumptions:
        assert table.loc[f"best for: {label}", label] == pytest.approx(table[label].max(), abs=5e-3)
    assert table.loc["good over all", "worst"] >= table.loc["equal steps", "worst"]
    assert table.loc["good over all", assumptions].mean() >= table.loc["best for: constant compliance", assumptions].mean()
    assert "Good over 10 assumptions" in " ".join(design_sentences(found))
    space = Space(LINEAR, pilot, THREE, robust=True)
    alone = [own.value(np.ones(3)) * 19 / own.cases[0].interest for own in space.objectives(space.tests).values()]
    assert space.value(space.tests) == pytest.approx(np.mean(alone), rel=1e-9)
    apart = replace(LINEAR, nuisances=tuple(SetupShift("apart") if isinstance(t, SetupShift) else t for t in LINEAR.nuisances))
    counts = [(LINEAR, "discriminate", 9), (apart, "eig", 12), (lb.HybridModel.default(0), "eig", 7)]
    for model, criterion, number in counts:
        assert len(Space(model, pilot, LEVELS, criterion=criterion, robust=True).assumptions) == number


@pytest.mark.parametrize("degree", [0, 1])
def test_the_paper_preset_takes_sigma_from_the_pilot(pilot: lb.Campaign, degree: int) -> None:
    """Forecast of the pilot's own plan against what its readings give."""
    model = lb.HybridModel.paper(degree)
    found = Space(model, pilot, LEVELS, criterion="d").forecast(pilot.plan().tests)
    marginals = lb.marginals(model, pilot)
    for name, entry in found.expected.items():
        assert entry.sd == pytest.approx(marginals.loc[name, "sd"], rel=0.03)


def test_designs_that_leave_something_undetermined(pilot: lb.Campaign) -> None:
    """Two levels do not determine a linear compliance under flat priors: no efficiency, no u, no number that looks like one."""
    two = pilot.without("f300", "f520").plan()
    found = lb.design(lb.HybridModel.paper(1), pilot, tests=5, forces_N=LEVELS, against={"two": two})
    assert found.compared[1].efficiency == 0.0
    assert not found.compared[1].determined
    record = json.loads(json_text(found.as_dict()))
    assert record["compared"][1]["expected"]["C_XXX"]["sd"] is None
    with pytest.raises(InputError, match="the candidates must determine the parameters"):
        lb.design(lb.HybridModel.paper(1), pilot, tests=5, forces_N=(36.0, 742.0))
    worst = Space(lb.HybridModel.paper(0), pilot, LEVELS[::4], criterion="e", parameters=("C_XYX", "C_CCY")).search.of_number(5)
    assert worst.efficiency > 0.5


# Planes, directions, centres


def test_templates_are_the_pilots() -> None:
    tests = [
        lb.CircularTest(100.0, np.arange(36) * 10.0, plane="XY", setup=1, centre_x_mm=5.0),
        lb.CircularTest(100.0, np.arange(72) * 5.0, plane="YZ", setup=4, direction="CW"),
        lb.CircularTest(200.0, np.arange(72) * 5.0, plane="YZ", setup=4, direction="CCW"),
    ]
    campaign = lb.Campaign(tuple(tests), topology="wFXYZt")
    own = [(t.plane, t.setup, t.direction, t.circle.centre_mm[0], len(t.angle_deg)) for t in templates(campaign, (), (), ())]
    assert own == [("XY", 1, None, 5.0, 36), ("YZ", 4, "CW", 0.0, 72), ("YZ", 4, "CCW", 0.0, 72)]
    (new,) = templates(campaign, ("ZX",), ("CW",), ((1.0, 2.0, 3.0),))
    assert (new.plane, new.setup, new.circle.centre_mm) == ("ZX", 5, (1.0, 2.0, 3.0))
    known = foreseen_by(campaign, templates(campaign, (), (), ()))
    assert [(test.plane, test.direction) for test in known.foreseen] == [("YZ", "CCW"), ("YZ", "CW")]
    assert foreseen_by(known, templates(campaign, (), (), ())) is known
    silent = replace(campaign, tests=campaign.tests[:1])
    assert foreseen_by(silent, templates(silent, (), (), ())) is silent


def test_foreseen_parameters_do_not_change_what_is_known(clockwise: lb.Campaign) -> None:
    """A plane that may follow adds parameters at their prior; the readings' evidence and all else stay as they were."""
    alone, more = LINEAR.bind(clockwise), LINEAR.bind(foreseen_by(clockwise, templates(clockwise, ("YZ",), (), ())))
    found, given = alone.given(PHI[None])
    wide, wide_given = more.given(PHI[None])
    assert wide[0] == pytest.approx(found[0], abs=1e-8)
    assert {"C_ZZZ", "C_AYY", "E_ZZ1", "E_Yt0_2"} < set(more.names)
    index = [more.names.index(name) for name in alone.names]
    np.testing.assert_allclose(wide_given.mean[0][index], given.mean[0], atol=1e-9 * alone.scale.max())
    sd = np.sqrt((wide_given.spread()[0] ** 2).sum(axis=1))
    new = [i for i, name in enumerate(more.names) if name not in alone.names]
    np.testing.assert_allclose(sd[new], more.prior_sd[new], rtol=1e-6)
    unseen = [k for k, name in enumerate(more.compliances) if name.label == "C_ZZZ"]
    assert more.setting.compliance_estimate[unseen] == pytest.approx(5e-5)


def test_a_second_radius_against_one(pilot: lb.Campaign) -> None:
    one, two = (Space(LINEAR, pilot, THREE, radii_mm=radii, parameters=["E_C0YX"]) for radii in ((), (150.0, 100.0)))
    shown = [space.tests_of(space.search.of_number(6)) for space in (one, two)]
    assert {test.radius_mm for test in shown[1]} == {150.0, 100.0}
    single, both = (space.forecast(tests).expected["E_C0YX"] for space, tests in zip((one, two), shown, strict=True))
    assert both.sd < 0.8 * single.sd
    # More circles of one radius would not help, more of two would.
    assert single.floor_sd > 0.9 * single.sd
    assert both.floor_sd < 0.01 * both.sd


def test_another_centre_is_another_set_up(pilot: lb.Campaign) -> None:
    """Else the ball's displacement would measure the scale: with offsets of its own a second centre adds little to it."""
    found = lb.design(LINEAR, pilot, tests=6, forces_N=THREE, centres_mm=((0.0, 0.0, 0.0), (200.0, 0.0, 0.0)))
    assert {(test.centre_x_mm, test.setup) for test in found.tests} == {(0.0, 1), (200.0, 2)}
    one = Space(LINEAR, pilot, THREE)
    alone = one.forecast(one.tests_of(one.search.of_number(6))).expected["E_XX1"].sd
    assert found.expected["E_XX1"].sd > 0.8 * alone
    # Mounted once, with the same offsets at both centres, it would be known from them.
    mounted_once = [replace(test, setup=1) for test in found.tests]
    space = Space(LINEAR, pilot, THREE, judged=tuple(mounted_once))
    assert space.forecast(mounted_once).expected["E_XX1"].sd < 0.5 * alone
    order = [test.setup for test in found.plan(seed=4).tests]
    assert order in (sorted(order), sorted(order, reverse=True))


def test_another_plane_is_planned(clockwise: lb.Campaign) -> None:
    """Set-ups, equal steps, the model for the analysis, and overrides and fixed parameters of either plane."""
    prior = replace(LINEAR.prior, overrides={"C_ZZZ": 2e-5})
    model = replace(LINEAR, prior=prior, fixed=("C_CCY_1",))
    found = lb.design(model, clockwise, tests=6, forces_N=THREE, planes=("XY", "YZ"), seed=3)
    assert set(found.table["plane"]) == {"XY", "YZ"}
    assert set(found.table["setup"]) == {1, 2}
    assert {"C_ZZZ", "E_ZZ1"} < set(found.expected)
    planned = found.plan(seed=1)
    assert [test.plane for test in planned.tests] in (["XY"] * 3 + ["YZ"] * 3, ["YZ"] * 3 + ["XY"] * 3)
    bound = found.model.bind(planned)
    assert set(bound.names) == set(found.expected)
    for name, entry in found.expected.items():
        assert bound.prior_sd[bound.names.index(name)] == pytest.approx(entry.prior_sd)
    assert any("plane YZ" in sentence for sentence in design_sentences(found))
    steps = found.compared[0].tests
    assert set(zip(steps["plane"], steps["force_N"], strict=True)) >= {("XY", 36.0), ("YZ", 742.0)}
    other = replace(model, prior=replace(prior, overrides={"C_XXX": 1e-5, "C_ZZZ": 2e-5}))
    alone = lb.design(other, clockwise, tests=4, forces_N=(200.0, 300.0, 400.0), planes=("YZ",))
    bound = alone.model.bind(alone.plan())
    np.testing.assert_allclose(bound.prior_sd, [alone.expected[name].prior_sd for name in bound.names], rtol=1e-12)
    assert bound.prior_sd[bound.names.index("C_ZZZ")] == 2e-5
    assert alone.model.reference_force_N == 389.0
    assert "C_XXX" not in bound.names
    assert {"E_Yt0_2", "E_Zt0_2"} < set(bound.names) <= set(alone.expected)


def test_equal_steps_are_candidates(pilot: lb.Campaign) -> None:
    steps = Space(LINEAR, pilot, (36.0, 100.0, 742.0), radii_mm=(100.0,), planes=("XY", "YZ")).equal_steps(6)
    assert {test.force_N for test in steps} == {36.0, 100.0, 742.0}
    assert {(test.plane, test.radius_mm) for test in steps} == {("XY", 100.0), ("YZ", 100.0)}


def test_a_pilot_that_does_not_state_its_direction(pilot: lb.Campaign) -> None:
    with pytest.raises(InputError, match=r"'f036' must state its direction, CW or CCW, as circles of plane XY"):
        lb.design(LINEAR, pilot, tests=4, forces_N=THREE, directions=("CW", "CCW"))
    assert {test.direction for test in Space(LINEAR, pilot, THREE, directions=("CW",)).tests} == {"CW"}
    partly = replace(pilot, tests=tuple(replace(t, direction="CW" if k else None) for k, t in enumerate(pilot.tests)))
    assert lb.identify(LINEAR, partly).parameters


def test_a_design_of_one_direction_says_what_it_does_not_see(clockwise: lb.Campaign) -> None:
    """Whichever direction it happens to be: hysteresis counts for circles all CW as for circles all CCW."""
    space = Space(LINEAR, clockwise, THREE, directions=("CW", "CCW"))
    sd = {}
    for way in ("CW", "CCW"):
        alone = [test for test in space.tests if test.direction == way]
        assert bind_tests(LINEAR, space.pilot, alone, keep=False).setting.both_ways == ("XY",)
        expected = space.forecast(alone)
        sd[way] = expected.expected["C_XYX"].sd
        assert _limits(space, alone, expected).one_way == {"XY": way}
    assert sd["CW"] == pytest.approx(sd["CCW"], rel=1e-6)
    every = space.forecast(space.tests)
    assert not _limits(space, space.tests, every).one_way
    assert sd["CW"] > 1.5 * every.expected["C_XYX"].sd
    # Tests that are only judged bring their parameters, not their direction.
    judged = tuple(replace(test, direction="CCW") for test in clockwise.plan().tests)
    assert Space(LINEAR, clockwise, THREE, judged=judged).bound.setting.both_ways == ()
    # Only the other direction may be chosen, and the pilot's tests do not count as run: no hysteresis anywhere.
    back, same = (Space(LINEAR, clockwise, THREE, directions=ways) for ways in (("CCW",), ()))
    assert back.forecast(back.tests).expected["C_XYX"].sd == pytest.approx(
        same.forecast(same.tests).expected["C_XYX"].sd, rel=1e-6
    )


# Forecasts against simulation


@pytest.mark.slow
def test_decisive_evidence_against_simulated_evidences() -> None:
    """ln B of simulated campaigns at given φ, by the exact evidences, has the mean and the tails foretold."""
    linear = LINEAR.without("truncation", "force-error")
    constant = linear.with_degree(0)
    planned = plan((30,) * 4)
    drawn: dict[bool, list[float]] = {True: [], False: []}
    for seed in range(300):
        for there in drawn:
            campaign = (linear if there else constant).simulate(planned, seed=seed, hyper_um=PHI_UM).campaign
            own, other = (model.bind(campaign).log_evidence(PHI[None])[0] for model in (linear, constant))
            drawn[there].append(float(own - other))
    bound = linear.bind(planned)
    information = information_of(bound, PHI)
    slopes = [information.names.index(p.name) for p in bound.parameters if p.group == "slope"]
    found = discrimination_of(information.covariance()[np.ix_(slopes, slopes)][None], tuple(bound.names[6:12]), size=1.0)
    with_, without = np.array(drawn[True]), np.array(drawn[False])
    assert found.expected_with == pytest.approx(with_.mean(), abs=4 * with_.std() / np.sqrt(300))
    assert found.expected_without == pytest.approx(without.mean(), abs=4 * without.std() / np.sqrt(300))
    assert found.decisive_with == pytest.approx((with_ > 5.0).mean(), abs=0.08)
    assert found.decisive_without == pytest.approx((without < -5.0).mean(), abs=0.08)
    assert found.misleading_without == pytest.approx((without > 5.0).mean(), abs=0.02)


def test_evidence_of_old_and_new_readings_together() -> None:
    """With tests already run: ln B of all readings, the new ones drawn given the old, by dense evidences."""
    rng = np.random.default_rng(1)
    old, new = rng.standard_normal((5, 3)), rng.standard_normal((6, 3))
    every = np.vstack([old, new])
    y = Gaussian.of(np.zeros(5), old @ old.T + np.eye(5)).draw(rng)
    one, three = (Gaussian.of(np.zeros(p), np.ones(p)) for p in (1, 3))
    pilots = {True: three.observe(old, y), False: one.observe(old[:, :1], y)}
    full = Gaussian.of(np.zeros(11), every @ every.T + np.eye(11))
    reduced = Gaussian.of(np.zeros(11), every[:, :1] @ every[:, :1].T + np.eye(11))
    drawn = {}
    for there, posterior in pilots.items():
        beta = np.zeros((4000, 3))
        beta[:, : len(posterior.mean)] = posterior.draw(rng, (4000,))
        more = beta @ new.T + rng.standard_normal((4000, 6))
        both = np.hstack([np.tile(y, (4000, 1)), more])
        drawn[there] = full.log_density(both) - reduced.log_density(both)
    after = three.observe(every, np.zeros(11)).covariance[1:, 1:]
    run = pilots[True].marginal([1, 2])
    before = Gaussian.of(run.mean[None], run.covariance[None])
    found = discrimination_of(after[None], ("a", "b"), size=1.0, before=before, threshold=1.0)
    assert found.augmented
    for value, sample in ((found.expected_with, drawn[True]), (found.expected_without, drawn[False])):
        assert value == pytest.approx(sample.mean(), abs=0.1)
    assert found.decisive_with == pytest.approx((drawn[True] > 1.0).mean(), abs=0.04)
    assert found.misleading_without == pytest.approx((drawn[False] > 1.0).mean(), abs=0.04)


@pytest.mark.slow
def test_intervals_inside_the_truncation_against_simulation() -> None:
    """Expected variances of truncated parameters against those found in simulated campaigns at given φ and truth."""
    model = LINEAR.without("force-error")
    planned = plan((30,) * 4)
    truth = TRUTH | {"C_CCY": 2e-11}
    bound = model.bind(planned)
    found = []
    for seed in range(150):
        campaign = model.simulate(planned, seed=seed, parameters=truth, hyper_um=PHI_UM).campaign
        _, given = model.bind(campaign).given(PHI[None])
        shift, inside, axes = given.orthant.moments()
        along = given.spread() @ np.swapaxes(axes, 1, 2)
        variance = (given.spread() ** 2).sum(axis=2) + np.einsum("wpd,wde,wpe->wp", along, inside - np.eye(shift.shape[1]), along)
        found.append(variance[0])
    information = information_of(bound, PHI)
    covariance = information.covariance()[np.ix_(information.own, information.own)] * np.outer(bound.scale, bound.scale)
    states = 100
    beta = np.tile([truth.get(name, 0.0) for name in bound.names], (states, 1))
    known = States(np.tile(PHI, (states, 1)), beta, Gaussian.of(np.zeros_like(beta), np.tile(bound.prior_sd**2, (states, 1))))
    expected = narrowed(bound, known, np.tile(covariance, (states, 1, 1)), 1)
    np.testing.assert_allclose(np.sqrt(expected), np.sqrt(np.mean(found, axis=0)), rtol=0.05)
    untruncated = np.sqrt(np.diag(covariance))[bound.names.index("C_CCY")]
    assert np.sqrt(expected)[bound.names.index("C_CCY")] < 0.85 * untruncated


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"tests": 0}, "tests must be between 1 and 300, got 0"),
        ({"tests": 1}, "tests must be at 2 different forces at least for this degree, got 1"),
        ({"forces_N": (100.0,)}, "tests must be at 2 different forces at least for this degree, got 1"),
        ({"tests": 3, "budget": 5.0}, "a design must have one goal, got tests and budget"),
        ({"budget": -1.0}, "budget must be a positive number, got -1"),
        ({"targets": {"C_XYY": 1e-7}}, "target must be one of .* Did you mean"),
        ({"targets": {"C_XYX": 0.0}}, "target of C_XYX must be a positive sd, got 0"),
        ({"power": 2.0}, "power must lie between 0 and 1, got 2"),
        ({"criterion": "dd"}, "criterion must be one of eig, d, a, c, i, e, discriminate, got 'dd'"),
        ({"criterion": "c"}, "criterion c must be given one parameter, got 19"),
        ({"criterion": "i", "parameters": ("E_XX1",)}, "criterion i must be about compliances"),
        ({"criterion": "discriminate", "parameters": ("C_XXX",)}, "criterion discriminate must be about slopes"),
        ({"parameters": ("C_ZZZ",)}, "parameter must be one of"),
        ({"forces_N": (0.0, 100.0)}, "forces must be > 0 N, got 0"),
        ({"forces_N": ()}, "must have forces and clockings to choose from, got none"),
        ({"forces_N": range(36, 743), "clockings_deg": BOTH}, "a design must choose among at most 5000 candidates, got 6363"),
        ({"radii_mm": (-1.0,)}, "radii must be > 0 mm, got -1"),
        ({"slope_size": 0.0}, "slope_size must be a positive number, got 0"),
        ({"costs": "x"}, "costs must be Costs"),
        ({"targets": {"C_XYX": 1e-7}, "criterion": "d"}, "criterion must be left to the goal here, which needs 'a', got 'd'"),
        ({"model": LINEAR.with_degree(0), "power": 0.9}, "criterion discriminate must be about slopes"),
        ({"model": lb.HybridModel.paper(1), "tests": 2}, "tests must be enough to determine the parameters, got 2"),
        ({"model": lb.HybridModel.paper(1), "criterion": "discriminate"}, "criterion discriminate must have proper priors"),
        ({"pilot": "folder"}, "campaign must be a Campaign, got str"),
        ({"tests": 2.5}, "tests must be a whole number, got 2.5"),
        ({"seed": -1}, "seed must be a whole number ≥ 0, got -1"),
        ({"forces_N": 300.0}, "forces_N must be a sequence, got 300.0"),
        ({"parameters": "C_XYX"}, "parameters must be a sequence, got 'C_XYX'"),
        ({"clockings_deg": (0.0, 45.0)}, "clockings_deg must be pairs"),
        ({"against": plan()}, "against must be a mapping of names to campaigns, got Campaign"),
        ({"against": {"equal steps": plan()}}, "against must not use the name 'equal steps'"),
        ({"against": {"it": "folder"}}, "campaign must be a Campaign, got str"),
        ({"against": {"it": replace(plan(), topology="wXYFZt")}}, "it must be of the pilot's machine wCAFYXZSt, got wXYFZt"),
        ({"budget": 1e5}, "budget must pay for at most 300 circles, got 100000 with 1 each"),
        ({"readings": 10**9}, "readings must be between 25 and 100000 per circle, got 1000000000"),
        ({"planes": ("XZ",)}, "plane must be one of XY, YZ, ZX"),
        ({"planes": "XY"}, "planes must be a sequence"),
        ({"directions": ("left",)}, "direction must be one of CW, CCW"),
        ({"centres_mm": ((1.0, 2.0),)}, "centres_mm must be triples"),
        ({"centres_mm": ((1.0, 2.0, float("nan")),)}, "finite centre_z_mm"),
    ],
)
def test_refused(pilot: lb.Campaign, options: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        lb.design(**{"model": LINEAR, "pilot": pilot, "forces_N": LEVELS, **options})  # type: ignore[arg-type]


def test_costs_refused() -> None:
    with pytest.raises(InputError, match="cost of circle must be a number ≥ 0, that of a circle > 0, got 0"):
        lb.Costs(circle=0.0)
