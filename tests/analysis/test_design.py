"""design(): the paper's preset, dense oracles, order and cost, directions and radii, forecasts
against simulation, refusals."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations_with_replacement, pairwise, product
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from campaigns import TRUTH, cases, plan, refuses, simulated
from oracle import Oracle, OracleTest
from scipy.stats import norm

import ldbb_bayes as lb
from ldbb_bayes.analysis.design import forecast
from ldbb_bayes.analysis.design.analysis_model import analysis_model
from ldbb_bayes.analysis.design.bound_plans import bind_plan, bind_tests
from ldbb_bayes.analysis.design.campaign_design import _limits
from ldbb_bayes.analysis.design.candidates import add_foreseen_tests, grid_of_tests, templates
from ldbb_bayes.analysis.design.discrimination import discrimination_of
from ldbb_bayes.analysis.design.forecast import (
    _sd_before,
    forecast_plan,
    forecast_tests,
    posteriors,
)
from ldbb_bayes.analysis.design.randomisation import running_order
from ldbb_bayes.analysis.design.reference_estimates import draw_reference_estimates
from ldbb_bayes.analysis.design.simulated_analyses import (
    precision_added_by_slope_priors,
    simulate_analyses,
    stated_variances,
)
from ldbb_bayes.analysis.design.space import Space
from ldbb_bayes.analysis.design.states import (
    States,
    extend_hyper_parameters,
    hyper_nodes,
    states_before,
)
from ldbb_bayes.errors import InputError
from ldbb_bayes.model.bound_information import information_of
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.report.wording import design_notes, design_screen, design_sentences, with_words
from ldbb_bayes.results import json_text

LINEAR = lb.HybridModel.first(1)
REFUSALS: list[list[object]] = cases(__file__, "refusals.toml")["design"]
LEVELS = tuple(np.linspace(36.0, 742.0, 13))
THREE = (36.0, 389.0, 742.0)
BOTH = tuple(product((0.0, 45.0, 90.0), repeat=2))
PHI = np.array([1.2e-4, 6e-4, 2.5e-4, 2e-3])
pytestmark = pytest.mark.usefixtures("few_states_of_module")
PHI_UM = dict(zip(("sigma", "delta", "kappa", "tau"), 1e3 * PHI, strict=True))


@pytest.fixture(scope="module")
def pilot() -> lb.Campaign:
    return simulated(plan(), seed=2)


@pytest.fixture(scope="module")
def clockwise(pilot: lb.Campaign) -> lb.Campaign:
    return replace(pilot, tests=tuple(replace(test, direction="CW") for test in pilot.tests))


@pytest.fixture(scope="module")
def six(pilot: lb.Campaign) -> lb.analysis.Design:
    return lb.design(LINEAR, pilot, tests=6, forces_N=LEVELS, against={"its own": pilot})


@pytest.mark.slow
@pytest.mark.parametrize(
    ("degree", "forces", "shares", "efficiency"),
    [
        (0, (36.0, 742.0), (0.4547, 0.5453), 0.725),
        (1, (36.0, 386.4, 742.0), (0.2959, 0.3513, 0.3528), 0.804),
    ],
)
def test_the_paper_preset(
    degree: int, forces: tuple[float, ...], shares: tuple[float, ...], efficiency: float
) -> None:
    """D-optimal shares over 36 to 742 N on a 1 N grid, the certificate there, and what the paper's
    seven levels are worth."""
    seven = plan((60,) * 7, forces_N=(36.0, 112.0, 238.0, 364.0, 490.0, 616.0, 742.0))
    design = lb.design(lb.HybridModel.paper(degree), seven, tests=7, against={"seven": seven})
    support = design.shares.groupby((design.shares["force_N"] / 100.0).round())
    np.testing.assert_allclose(support["share"].sum(), shares, atol=1e-4)
    centre = support.apply(
        lambda level: np.average(level["force_N"], weights=level["share"]), include_groups=False
    )
    np.testing.assert_allclose(centre, forces, atol=0.35)
    assert len(design.sensitivity) == 707
    parameters = 13 if degree == 0 else 19
    assert design.certificate.bound == pytest.approx(parameters, abs=1e-6)
    assert design.certificate.max_sensitivity <= parameters * (1.0 + 1e-5)
    assert design.certificate.is_global
    assert design.compared[1].efficiency == pytest.approx(efficiency, abs=1e-3)
    assert design.compared[0].efficiency < design.efficiency <= 1.0


def test_information_against_the_dense_oracle(pilot: lb.Campaign) -> None:
    """Posterior covariance of a plan with clocked balls and two radii, and the expected information
    gain, by dense matrices."""
    model = LINEAR.without("force-error", "truncation")
    like = [replace(test, angle_deg=np.arange(30) * 12.0) for test in templates(pilot)]
    tests = [
        *grid_of_tests(like, (36.0, 742.0), ((0.0, 0.0), (45.0, 90.0)), (150.0,)),
        *grid_of_tests(like, (300.0,), ((0.0, 0.0),), (100.0,)),
    ]
    law = pilot.force_law
    stated = [
        (
            t.force_N,
            law.pressure_bar(t.force_N),
            *map(np.deg2rad, (t.angle_deg, t.work_ball_deg, t.tool_ball_deg)),
            t.radius_mm,
        )
        for t in tests
    ]
    oracle_tests = [
        OracleTest(f, p, angle, np.zeros(30), work, tool, radius)
        for f, p, angle, work, tool, radius in stated
    ]
    dense = Oracle(oracle_tests, 1, terms=("form", "length", "mount", "setup", "discrepancy"))
    _, _, covariance = dense.given(PHI)
    p = len(dense.names)
    prior = Gaussian.of(np.zeros((1, p)), dense.sd[None] ** 2)
    forecast = forecast_tests(
        bind_tests(model, pilot, tests, keep_pilot_tests=False),
        States(PHI[None], np.zeros((1, p)), prior),
        known_scales=True,
    )
    assert list(forecast.expected) == dense.names
    sd = np.array([entry.sd for entry in forecast.expected.values()])
    np.testing.assert_allclose(sd, np.sqrt(np.diag(covariance)), rtol=1e-7)
    gain = 0.5 * (np.log(dense.sd**2).sum() - np.linalg.slogdet(covariance)[1])
    assert forecast.information_gain == pytest.approx(gain, abs=1e-6)


def dense_sd(
    model: lb.HybridModel,
    campaign: lb.Campaign,
    tests: Sequence[lb.CircularTest],
    name: str,
    *,
    times: float,
) -> float:
    """Posterior sd of a parameter at PHI, every test run so often, by inverting the whole precision
    matrix."""
    information = information_of(bind_tests(model, campaign, tests, keep_pilot_tests=False), PHI)
    rows = information.rows()
    k = information.names.index(name)
    covariance = np.linalg.inv(times * rows.T @ rows + np.eye(rows.shape[1]))
    return float(np.sqrt(covariance[k, k]) * information.scale[k])


@pytest.mark.slow
def test_planned_circles_never_make_a_parameter_less_well_known(recovered: lb.Campaign) -> None:
    """By the exact marginals; a forecast of 64 machines alone is up to 8 % above them."""
    model = lb.HybridModel.default(1)
    sd_of_pilot = lb.inference.marginalize(model.without("truncation"), recovered)["sd"]
    design = lb.design(model, recovered, tests=6, forces_N=(36.0, 742.0), augment=True)
    expected = lb.analysis.forecast_plan(model, design.plan(), machines=64).expected
    for name, entry in expected.items():
        assert entry.untruncated_sd <= 1.01 * sd_of_pilot[name], name
        assert entry.sd <= 1.01 * sd_of_pilot[name], name


def test_very_many_planned_circles_do_not_repeat_those_already_run(clockwise: lb.Campaign) -> None:
    """Floors by inverting the whole precision matrix, each circle already run counted once."""
    tests = clockwise.plan().tests[:2]
    bound = bind_tests(LINEAR.without("truncation"), clockwise, tests, keep_pilot_tests=True)
    run = len(clockwise.tests)
    _, floor = posteriors(bound, PHI[None], run)
    information = information_of(bound, extend_hyper_parameters(bound, PHI[None], run)[0])
    precision = np.eye(len(information.names))
    for k, rows in enumerate(information.blocks()):
        times = 1.0 if k < run else 1e6
        precision += times * rows.T @ rows
    dense = np.sqrt(np.diag(np.linalg.inv(precision)))[information.interest]
    np.testing.assert_allclose(floor, dense, rtol=1e-3)


@pytest.mark.slow
def test_hysteresis_counts_for_every_design_that_could_have_both_ways(
    clockwise: lb.Campaign,
) -> None:
    """Expected and least sd of C_XYX by dense matrices: circles of one direction show it no better
    than the friction does."""
    plain = LINEAR.without("truncation")
    both = lb.design(
        plain, clockwise, tests=6, forces_N=THREE, directions=("CW", "CCW"), parameters=["C_XYX"]
    )
    assert {test.direction for test in both.tests} == {"CW", "CCW"}
    space = Space(plain, add_foreseen_tests(clockwise, templates(clockwise, ("CW", "CCW"))), THREE)
    p = len(space.bound.names)
    states = States(
        PHI[None], np.zeros((1, p)), Gaussian.of(np.zeros((1, p)), space.bound.prior_sd[None] ** 2)
    )
    sd = {}
    for direction in ("CW", "CCW", ""):
        tests = (
            tuple(replace(test, direction=direction) for test in both.tests)
            if direction
            else both.tests
        )
        forecast = forecast_tests(
            bind_tests(plain, space.pilot, tests, keep_pilot_tests=False), states, known_scales=True
        )
        entry, sd[direction] = (
            forecast.expected["C_XYX"],
            dense_sd(plain, space.pilot, tests, "C_XYX", times=1.0),
        )
        assert entry.sd == pytest.approx(sd[direction], rel=1e-9)
        assert entry.floor_sd == pytest.approx(
            dense_sd(plain, space.pilot, tests, "C_XYX", times=1e6), rel=1e-3
        )
        assert _limits(space, tests, forecast).one_way == ({"XY": direction} if direction else {})
    # F s sin 2θ of 1 µm/kN is 2 µm/kN of C_XYX: with one sd of 2 µm/kN / 2 a friction of 2e-6 mm/N
    # stays in it.
    hidden = 2e-6 * 1e-5 / np.hypot(2e-6, 1e-5)
    assert sd["CW"] == pytest.approx(hidden, rel=0.15)
    assert sd["CW"] == pytest.approx(sd["CCW"], rel=1e-6)
    assert sd[""] < 0.75 * hidden
    # Tests that are only compared bring their parameters, not their direction.
    compared = tuple(replace(test, direction="CCW") for test in clockwise.plan().tests)
    assert Space(LINEAR, clockwise, THREE, compared_tests=compared).bound.setting.both_ways == ()


def value_of(space: Space, tests: Sequence[lb.CircularTest]) -> float:
    return space.objective(tests).value(np.ones(len(tests)))


@pytest.fixture(scope="module")
def arcs() -> lb.Campaign:
    return simulated(plan((40,) * 4, arc_deg=250.0), seed=3)


@pytest.mark.slow
@pytest.mark.parametrize("criterion", ["eig", "a", "i", "discriminate"])
def test_the_search_and_the_forecast_agree(
    pilot: lb.Campaign, arcs: lb.Campaign, criterion: str
) -> None:
    """The criterion by the search's compact rows against explicit covariances, arcs and clockings
    included, at the same φ."""
    for campaign, augment in ((pilot, False), (arcs, True)):
        space = Space(LINEAR, campaign, LEVELS[::4], BOTH[:3], criterion=criterion, augment=augment)
        tests = (*space.tests[:3], space.tests[7])
        bound = bind_tests(LINEAR, campaign, tests, keep_pilot_tests=augment)
        values = []
        for value in hyper_nodes(LINEAR, campaign, 4, 1):
            information = information_of(bound, value)
            indices = [information.names.index(name) for name in space.chosen]
            c = information.covariance()[np.ix_(indices, indices)]
            s = np.linalg.eigvalsh(np.linalg.inv(c))
            rows = np.array(
                [bound.compliance_at(f) * bound.scale for f in np.linspace(36.0, 742.0, 33)]
            )
            unit = bound.scale[:6, None]
            values.append(
                {
                    "eig": lambda c=c: -np.linalg.slogdet(c)[1],
                    "a": lambda c=c: -np.trace(c) / len(c),
                    "i": lambda c=c, r=rows, u=unit: (
                        -np.mean([np.diag((x / u) @ c @ (x / u).T) for x in r[:, :, :12]])
                    ),
                    "discriminate": lambda s=s: 0.25 * ((s - 1.0) ** 2 / s).sum(),
                }[criterion]()
            )
        assert len(space.search.objective.prior) == len(values)
        assert value_of(space, tests) == pytest.approx(np.mean(values), rel=1e-6)
        counts = np.zeros(len(space.tests))
        counts[[0, 1, 2, 7]] = 1.0
        assert space.search.objective.value(counts) == pytest.approx(
            value_of(space, tests), rel=1e-9
        )


def test_what_does_not_matter(pilot: lb.Campaign) -> None:
    """How F0 is given, for criterion i; whole turns; the pilot's rule for balls, and a common turn
    of all tests. Arcs do."""
    fixed_reference = replace(LINEAR, reference_force_N=389.0)
    values = [
        value_of(s := Space(m, pilot, (200.0, 389.0, 742.0), criterion="i"), s.tests)
        for m in (LINEAR, fixed_reference)
    ]
    assert values[0] == pytest.approx(values[1], rel=1e-6)
    plain = Space(LINEAR, pilot, LEVELS)
    space = Space(LINEAR, pilot, LEVELS, ((0, 0), (360, 0), (45, 90), (405, 450)))
    assert space.clockings_deg == ((0.0, 0.0), (45.0, 90.0))
    turned = grid_of_tests(space.templates, LEVELS[::3], ((45.0, 90.0),), space.radii_mm)
    still = grid_of_tests(plain.templates, LEVELS[::3], ((0.0, 0.0),), plain.radii_mm)
    assert value_of(space, turned) == pytest.approx(value_of(plain, still), rel=1e-9)
    assert value_of(plain, plan((40,) * 4, arc_deg=220.0).tests) < value_of(plain, plan().tests)


def test_a_design_of_six(six: lb.analysis.Design, pilot: lb.Campaign) -> None:
    assert len(six.tests) == six.table["count"].sum() == 6
    assert six.certificate.holds
    assert six.compared[0].efficiency < six.efficiency <= 1.0
    assert six.efficiency > 0.99
    forces = {float(t.force_N) for t in six.tests}
    assert (min(forces), max(forces), six.compared[1].name) == (36.0, 742.0, "its own")
    for name, entry in six.expected.items():
        assert 0.0 < entry.floor_sd < entry.untruncated_sd <= entry.prior_sd * (1 + 1e-9), name
        assert entry.sd <= entry.untruncated_sd * (
            1 + 5e-3
        )  # 512 points for each of 16 states: 1e-3 off with some versions
    sentences = " ".join(design_sentences(six))
    assert "Run 6 circles" in sentences
    assert "looks exactly like +13.3 µrad of E_C(0Y)X. Cure: Clocking both balls" in sentences
    table = six.expected_table().set_index("parameter")
    assert table.loc["C_CCY", ["sd", "baseline_sd"]].tolist() == [
        forecast["C_CCY"].sd for forecast in (six.expected, six.baseline)
    ]


def test_one_circle_is_singular(six: lb.analysis.Design) -> None:
    one = replace(six, table=six.table.head(1).assign(count=1))
    assert "Run 1 circle: 1 × 36 N" in " ".join(design_sentences(one))


def test_intervals_of_equal_width_are_called_as_wide(six: lb.analysis.Design) -> None:
    against = f"Expected intervals against {six.compared[0].name}: "
    as_wide = replace(six, expected=six.baseline)
    assert f"{against}as wide for every parameter." in design_sentences(as_wide)
    half = replace(six.baseline["C_XXX"], sd=0.5 * six.baseline["C_XXX"].sd)
    sentences = design_sentences(replace(six, expected={**six.baseline, "C_XXX": half}))
    (sentence,) = [text for text in sentences if text.startswith(against)]
    assert sentence.startswith(f"{against}0.50 times as wide for C_XXX to as wide for ")


@pytest.mark.parametrize(("circles", "reason"), [(6, "as known"), (7, "more circles leave less")])
def test_less_uncertainty_at_a_lower_efficiency_is_explained(
    six: lb.analysis.Design, circles: int, reason: str
) -> None:
    """A lower efficiency beside a smaller expected u has its reason there.

    Of three circles of one machine, equal steps had an efficiency of 0.59 against 0.78, and left 11
    nm/N against 13: efficiency takes the scatter between circles as known.
    """
    equal_steps = six.compared[0]
    tests = pd.concat([equal_steps.tests] * 2, ignore_index=True).head(circles)
    lower = replace(equal_steps, efficiency=six.efficiency - 0.1, tests=tests)
    for factor, said in ((0.9, 1), (1.1, 0)):
        expected = {
            name: replace(entry, sd=factor * six.expected[name].sd)
            for name, entry in six.expected.items()
        }
        design = replace(six, compared=(replace(lower, expected=expected),))
        for sentences in (design_screen(design), design_sentences(design)):
            reasons = [s for s in sentences if "at a lower efficiency" in s]
            assert len(reasons) == said
            assert all(reason in sentence for sentence in reasons)


def test_read_back(six: lb.analysis.Design, pilot: lb.Campaign, tmp_path: Path) -> None:
    """design.json holds every finding: sentences and numbers of a design read back are the same;
    its tests are in the plan."""
    (tmp_path / "design.json").write_text(
        json_text({"schema": 1, **with_words(six)}), encoding="utf-8"
    )
    back = lb.analysis.read_design(tmp_path)
    assert json_text(back.as_dict()) == json_text(six.as_dict())
    assert design_sentences(back) == design_sentences(six)
    refuses("a design must be at hand, got one read from a file", back.plan)
    (tmp_path / "design.json").write_text('{"pilot": {}}', encoding="utf-8")
    refuses(r"design\.json must be a design written by", lb.analysis.read_design, tmp_path)


def test_the_best_of_few(pilot: lb.Campaign) -> None:
    """Against every design of four tests among five levels."""
    space = Space(LINEAR, pilot, LEVELS[::3])
    design = space.search.find_design(4)
    all_counts = [
        np.bincount(chosen, minlength=5).astype(float)
        for chosen in combinations_with_replacement(range(5), 4)
    ]
    assert design.value == pytest.approx(
        max(map(space.search.objective.value, all_counts)), rel=1e-9
    )
    assert design.efficiency <= 1.0 + 1e-9


@pytest.mark.parametrize(
    ("clockings", "changes"),
    [
        ([(0, 0), (45, 0), (90, 0)], 0),
        ([(0, 0), (0, 45), (0, 90)], 2),
        ([*product((0, 45, 90), repeat=2)], 6),
    ],
)
def test_order_of_clockings(clockings: list[tuple[float, float]], changes: int) -> None:
    """By hand: blocks of the work ball, in them of the tool ball, there and back; all tests are
    run."""
    tests = [
        lb.CircularTest(f, np.arange(36) * 10.0, work_ball_deg=w, tool_ball_deg=t)
        for w, t in clockings
        for f in (50.0, 90.0)
    ]
    for seed in range(5):
        run = running_order(tests, np.random.default_rng(seed))
        assert (
            sum(one.work_ball_deg != other.work_ball_deg for one, other in pairwise(run))
            == len(dict(clockings)) - 1
        )
        assert (
            sum(one.tool_ball_deg != other.tool_ball_deg for one, other in pairwise(run)) == changes
        )
        assert {(t.work_ball_deg, t.tool_ball_deg, t.force_N) for t in run} == {
            (*c, f) for c in clockings for f in (50.0, 90.0)
        }


def test_no_order_follows_the_forces() -> None:
    """Of two forces three times each, one order in ten is sorted; of six forces at two clockings,
    the turned balls come with the larger forces."""
    angle = np.arange(36) * 10.0
    twice = [lb.CircularTest(force, angle) for force in (36.0, 742.0) for _ in range(3)]
    clocked = [
        lb.CircularTest(force, angle, work_ball_deg=45.0 * (force > 400.0))
        for force in (36.0, 177.0, 318.0, 460.0, 601.0, 742.0)
    ]
    for seed in range(40):
        run = running_order(twice, np.random.default_rng(seed))
        forces_N = [test.force_N for test in run]
        assert abs(np.corrcoef(forces_N, range(len(run)))[0, 1]) <= 0.5
        run = running_order(clocked, np.random.default_rng(seed))
        forces_N = [test.force_N for test in run]
        # No order that turns the balls once has less than 0.54; sorted ones have 1.
        assert abs(np.corrcoef(forces_N, range(len(run)))[0, 1]) < 0.7


def test_set_ups_are_run_one_after_the_other() -> None:
    """In them one radius after the other; forces at random, the same for the same seed."""
    tests = [
        lb.CircularTest(force, np.arange(36) * 10.0, setup=setup, radius_mm=radius)
        for force, setup, radius in product((100.0, 400.0, 700.0), (1, 2, 3), (100.0, 150.0))
    ]
    orders = set()
    for seed in range(5):
        run, again = (running_order(tests, np.random.default_rng(seed)) for _ in range(2))
        places = [(test.setup, test.radius_mm) for test in run]
        assert sum(one != other for one, other in pairwise(places)) == 5
        assert sum(one[0] != other[0] for one, other in pairwise(places)) == 2
        forces = tuple(test.force_N for test in run)
        assert forces == tuple(test.force_N for test in again)
        orders.add(forces)
    assert len(orders) > 3


def test_a_certificate_may_fail(pilot: lb.Campaign, monkeypatch: pytest.MonkeyPatch) -> None:
    """As where half of the bound were asked for."""
    monkeypatch.setattr("ldbb_bayes.analysis.design.campaign_design._CERTIFICATE_TOLERANCE", -0.5)
    assert not lb.design(LINEAR, pilot, tests=4, forces_N=THREE).certificate.holds


@pytest.mark.slow
def test_a_plan_for_a_model_with_drift(pilot: lb.Campaign) -> None:
    """Listed in the order in which to run it, whatever the pilot's was, or at its mean temperature;
    the plan is one that the model can be asked about."""
    timed = replace(
        pilot,
        tests=tuple(
            replace(t, time_s=600.0 * k, temperature_C=20.0 + k) for k, t in enumerate(pilot.tests)
        ),
    )
    timed = replace(timed, order="random")
    design = lb.design(LINEAR.with_term(lb.terms.Drift("time")), timed, tests=5, forces_N=THREE)
    assert design.certificate.holds
    assert design.limits.drift
    assert design.plan().order is None
    assert {test.time_s for test in design.plan().tests} == {None}
    assert lb.identify(design.model, design.plan()).parameters
    warm = lb.design(
        LINEAR.with_term(lb.terms.Drift("temperature")), timed.plan(), tests=5, forces_N=THREE
    )
    assert {test.temperature_C for test in warm.plan().tests} == {21.5}


def test_levels_that_cannot_show_another_degree(pilot: lb.Campaign) -> None:
    """Geometry and the coefficients of degree 1 take three levels; the fourth is the first that
    checks them."""
    space = Space(LINEAR, pilot, LEVELS)
    for number, too_few in ((2, 2), (3, 3), (4, None)):
        tests = space.equal_steps(number)
        assert _limits(space, tests, space.forecast(space.plan_of(tests))).levels == too_few


def test_one_circle_is_not_called_circles(pilot: lb.Campaign) -> None:
    design = lb.design(LINEAR, pilot, tests=1, forces_N=THREE, augment=True)
    sentences = " ".join(design_sentences(design))
    assert "Run 1 more circle: 1 × " in sentences
    assert "(1 circle)" in sentences
    assert "1 circles" not in sentences


@pytest.mark.parametrize("augment", [False, True])
def test_forecasts_are_of_the_model_beside_the_plan(pilot: lb.Campaign, augment: bool) -> None:
    """Also where the range of force is not the pilot's: identify expects what design expected."""
    model = lb.HybridModel.default(1)
    forces_N = (100.0, 600.0)
    design = lb.design(model, pilot, tests=2, forces_N=forces_N, augment=augment)
    judged = lb.identify(design.model, design.plan())
    for name, expected in design.expected.items():
        assert judged.parameters[name].sd == pytest.approx(expected.sd, rel=1e-9)


def test_added_circles_keep_the_range_of_force_and_its_priors(pilot: lb.Campaign) -> None:
    """They are analysed together with the pilot's: only forces outside its range change it."""
    model = lb.HybridModel.default(1)
    within = Space(model, pilot, (100.0, 600.0), augment=True)
    assert not analysis_model(within, within.tests).prior.overrides
    beyond = Space(model, pilot, (100.0, 900.0), augment=True)
    slopes = {name for name in beyond.bound.names if name.endswith("_1")}
    assert set(analysis_model(beyond, beyond.tests).prior.overrides) == slopes


def test_augmenting(pilot: lb.Campaign) -> None:
    """Two tests on top of the pilot's own: no wider than without them."""
    design = lb.design(LINEAR, pilot, tests=2, forces_N=LEVELS[::3], augment=True)
    names = {test.name for test in design.plan().tests}
    assert not names & {test.name for test in pilot.tests}
    without = lb.analysis.forecast_plan(LINEAR, replace(pilot.plan(), pilot=pilot)).expected
    for name, entry in design.expected.items():
        error = np.hypot(entry.sd_error, without[name].sd_error)
        assert entry.sd <= without[name].sd + 2.0 * error
    assert "Run 2 more circles" in design_sentences(design)[0]


def pilot_and_added_circles(
    model: lb.HybridModel, times_s: tuple[float | None, ...]
) -> tuple[lb.Campaign, lb.Campaign]:
    """A pilot of three circles run at these times, and a plan that adds one more of each force."""
    forces_N = (100.0, 350.0, 600.0)
    tests = []
    for force_N, time_s in zip(forces_N, times_s, strict=True):
        angle_deg = np.arange(0.0, 360.0, 15.0)
        tests.append(lb.CircularTest(force_N, angle_deg, np.zeros(24), time_s=time_s))
    pilot = lb.Campaign(tuple(tests))
    space = Space(model, pilot, forces_N, augment=True)
    return pilot, space.plan_of(space.tests)


@pytest.mark.parametrize(
    ("name", "name_of_plan"),
    [("Messung", "Messung (2)"), ("Messung (2)", "Messung (3)"), ("bar (new)", "bar (new) (2)")],
)
def test_a_plan_is_named_without_words(pilot: lb.Campaign, name: str, name_of_plan: str) -> None:
    """The name also stands on sheets in other languages."""
    space = Space(lb.HybridModel.first(1), replace(pilot, name=name), THREE)
    assert space.plan_of(space.tests[:1]).name == name_of_plan


@pytest.mark.parametrize("times_s", [(None, None, None), (0.0, 500.0, 1400.0)])
def test_added_circles_run_after_the_pilot_as_in_a_fit_of_both(
    times_s: tuple[float | None, ...],
) -> None:
    """Drift acts on the circles of ``--augment`` as in a fit of one list with all circles."""
    model = lb.HybridModel.default(1)
    pilot, plan = pilot_and_added_circles(model, times_s)
    hours = bind_plan(model, plan).setting.time_h

    last_s = times_s[-1]
    added = []
    for k, test in enumerate(plan.tests, start=1):
        time_s = None if last_s is None else last_s + 360.0 * k
        run = replace(test, name="", time_s=time_s)
        added.append(run.with_reading_um(np.zeros(len(test.angle_deg))))
    both = model.bind(replace(pilot, tests=(*pilot.tests, *added))).setting.time_h
    np.testing.assert_allclose(hours - hours[0], both - both[0], atol=1e-12)


@pytest.mark.parametrize("times_s", [(None, None, None), (0.0, None, 1400.0)])
def test_times_of_added_circles_do_not_count_where_the_pilot_has_none(
    times_s: tuple[float | None, ...],
) -> None:
    """They would count from another start: a fit of both takes all circles in their order."""
    model = lb.HybridModel.default(1)
    pilot, plan = pilot_and_added_circles(model, times_s)
    stated = [replace(test, time_s=600.0 * k) for k, test in enumerate(plan.tests)]
    hours = bind_plan(model, replace(plan, tests=tuple(stated))).setting.time_h

    added = [replace(test, name="").with_reading_um(np.zeros(24)) for test in stated]
    both = model.bind(replace(pilot, tests=(*pilot.tests, *added))).setting.time_h
    np.testing.assert_allclose(hours, both, atol=1e-12)


def test_what_forces_cannot_do(pilot: lb.Campaign) -> None:
    """E_C(0Y)X looks like the 2-lobe form: the alias is named, and what cures it; and it does."""
    options = {"tests": 6, "criterion": "c", "parameters": ("E_C(0Y)X",), "forces_N": THREE}
    design = lb.design(LINEAR, pilot, **options)
    assert (
        "2-lobe form (sin 2θ) looks exactly like +13.3 µrad of E_C(0Y)X. Cure: Clocking both balls"
        in " ".join(design_notes(design))
    )
    assert design.expected["E_C0YX"].floor_sd > 8e-6
    cured = lb.design(LINEAR, pilot, **options, clockings_deg=BOTH)
    assert cured.expected["E_C0YX"].sd < 2e-6
    assert lb.identify(LINEAR, cured.plan()).parameters["E_C0YX"].verdict == "identified"


@pytest.mark.slow
def test_slope_priors_that_analyses_will_use(pilot: lb.Campaign) -> None:
    """The prior sd of a slope follows from the compliance that new readings show. The forecast
    spread of the prior sds, beside those of models bound to simulated readings of the same
    machines."""
    model = lb.HybridModel.default(1)
    space = Space(model, pilot, THREE)
    new = space.plan_of(space.tests)
    bound = bind_plan(model, new)
    states = states_before(model, pilot, 512, 2, augment=False)
    phi = extend_hyper_parameters(bound, states.phi, 0, scattering=True)
    estimates = draw_reference_estimates(bound, phi, states.beta, 2)
    added = precision_added_by_slope_priors(bound, estimates)
    assert not added[:, [p.group != "slope" for p in bound.parameters]].any()
    forecast = (added + 1.0) ** -0.5

    ratios = []
    for k, (beta, phi) in enumerate(zip(states.beta, states.phi, strict=True)):
        machine = dict(zip(bound.names, beta.tolist(), strict=True))
        scales_um = dict(zip(bound.hyper_prior.names, (1e3 * phi).tolist(), strict=False))
        names = {name: scales_um[name] for name in ("sigma", "delta", "kappa", "tau")}
        readings = model.simulate(new, seed=k, parameters=machine, hyper_um=names).campaign
        ratios.append(model.bind(readings).prior_sd / bound.prior_sd)
    levels = [0.1, 0.5, 0.9]
    for name, least_spread in (("C_XXX_1", 1.1), ("C_CXY_1", 1.3), ("C_CCY_1", 1.3)):
        slope = bound.names.index(name)
        expected = np.quantile(np.array(ratios)[:, slope], levels)
        assert expected[2] > least_spread * expected[0]
        np.testing.assert_allclose(np.quantile(forecast[:, slope], levels), expected, rtol=0.1)


@pytest.mark.slow
def test_the_prior_beside_a_forecast_is_that_of_the_analysis_to_come(pilot: lb.Campaign) -> None:
    """The medians over simulated readings of the same machines, as models are bound to them."""
    model = lb.HybridModel.default(1)
    space = Space(model, pilot, THREE)
    new = space.plan_of(space.tests)
    analyses = simulate_analyses(model, new, machines=256)
    bound = analyses.bound
    priors = []
    for k, beta in enumerate(analyses.states.beta):
        machine = dict(zip(bound.names, beta.tolist(), strict=True))
        readings = model.simulate(new, seed=k, parameters=machine).campaign
        priors.append(model.bind(readings).prior_sd)
    slopes = [k for k, parameter in enumerate(bound.parameters) if parameter.group == "slope"]
    not_slopes = [k for k in range(len(bound.names)) if k not in slopes]
    np.testing.assert_allclose(analyses.prior_sd[not_slopes], bound.prior_sd[not_slopes])
    medians = np.median(priors, axis=0)
    np.testing.assert_allclose(analyses.prior_sd[slopes], medians[slopes], rtol=0.15)
    expected = forecast_plan(model, new, analyses=analyses).expected
    stated = [entry.prior_sd for entry in expected.values()]
    np.testing.assert_array_equal(stated, analyses.prior_sd)


def test_finding_a_slope(pilot: lb.Campaign) -> None:
    """Designed for it, larger slopes are found more often, and more often than by a design for
    everything."""
    options = {"tests": 6, "forces_N": LEVELS[::3], "parameters": ("C_XYX_1",)}
    small, large = (
        lb.design(LINEAR, pilot, criterion="discriminate", slope_size=size, **options)
        for size in (1.0, 2.0)
    )
    plain = lb.design(LINEAR, pilot, tests=6, forces_N=LEVELS[::3], slope_size=2.0)
    power = [
        design.discrimination.power["C_XYX_1"]
        for design in (small, large, plain)
        if design.discrimination is not None
    ]
    assert power[1] > max(power[0], power[2])
    assert not large.certificate.is_global


def test_the_paper_preset_takes_sigma_from_the_pilot(pilot: lb.Campaign) -> None:
    """Forecast of the pilot's own plan against what its readings give."""
    model = lb.HybridModel.paper(1)
    forecast = lb.analysis.forecast_plan(model, replace(pilot.plan(), pilot=pilot))
    marginals = lb.inference.marginalize(model, pilot)
    for name, entry in forecast.expected.items():
        assert entry.sd == pytest.approx(marginals.loc[name, "sd"], rel=0.03)


def test_designs_that_leave_something_undetermined(pilot: lb.Campaign) -> None:
    """Two levels do not determine a linear compliance under flat priors: no efficiency, no u, no
    number that looks like one."""
    two = pilot.without("f300", "f520").plan()
    design = lb.design(
        lb.HybridModel.paper(1), pilot, tests=5, forces_N=LEVELS, against={"two": two}
    )
    assert design.compared[1].efficiency == 0.0
    assert not design.compared[1].determined
    record = json.loads(json_text(design.as_dict()))
    assert record["compared"][1]["expected"]["C_XXX"]["sd"] is None
    with pytest.raises(InputError, match="the candidates must determine the parameters"):
        lb.design(lb.HybridModel.paper(1), pilot, tests=5, forces_N=(36.0, 742.0))


# Directions, radii, planes


def test_templates_are_the_pilots_in_equal_steps(rng: np.random.Generator) -> None:
    """Half circles that overlap become one circle, and an uneven arc across 0° keeps its ends: a
    plan can be written."""
    halves = np.r_[np.arange(-10.0, 190.0, 2.0), np.arange(170.0, 370.0, 2.0)]
    arc = rng.permutation([-110.0, 110.0, *rng.uniform(-110.0, 110.0, 98)])
    for uneven, first, last in ((halves, 0.0, 358.2), (arc, 250.0, 470.0)):
        (like,) = templates(lb.Campaign((lb.CircularTest(100.0, uneven),)))
        np.testing.assert_allclose(like.angle_deg, np.linspace(first, last, len(uneven)), atol=1e-9)
        assert like.step_deg > 0.0
    tests = [
        lb.CircularTest(100.0, np.arange(36) * 10.0, plane="XY", setup=1, centre_x_mm=5.0),
        lb.CircularTest(100.0, np.arange(72) * 5.0, plane="YZ", setup=4, direction="CW"),
        lb.CircularTest(200.0, np.arange(72) * 5.0, plane="YZ", setup=4, direction="CCW"),
    ]
    campaign = lb.Campaign(tuple(tests), topology="wFXYZt")
    facts = [
        (t.plane, t.setup, t.direction, t.circle.centre_mm[0], len(t.angle_deg))
        for t in templates(campaign)
    ]
    assert facts == [("XY", 1, None, 5.0, 36), ("YZ", 4, "CW", 0.0, 72), ("YZ", 4, "CCW", 0.0, 72)]
    extended = add_foreseen_tests(campaign, templates(campaign))
    assert [(test.plane, test.direction) for test in extended.foreseen] == [
        ("YZ", "CCW"),
        ("YZ", "CW"),
    ]
    assert add_foreseen_tests(extended, templates(campaign)) is extended


@pytest.mark.parametrize(
    ("angle_deg", "ccw", "cw"),
    [
        (np.arange(360.0, 0.0, -5.0), np.arange(0.0, 360.0, 5.0), np.arange(360.0, 0.0, -5.0)),
        (np.arange(0.0, 360.0, 5.0), np.arange(0.0, 360.0, 5.0), np.arange(360.0, 0.0, -5.0)),
        (np.arange(250.0, 20.0, -5.0), np.arange(25.0, 255.0, 5.0), np.arange(250.0, 20.0, -5.0)),
    ],
)
def test_angles_of_templates_run_in_their_direction(
    angle_deg: np.ndarray, ccw: np.ndarray, cw: np.ndarray
) -> None:
    """A circle keeps its starting point, an arc its ends."""
    pilot = lb.Campaign((lb.CircularTest(100.0, angle_deg),))
    first, second = templates(pilot, ("CCW", "CW"))
    np.testing.assert_allclose(first.angle_deg, ccw, atol=1e-9)
    np.testing.assert_allclose(np.sort(second.angle_deg % 360.0), np.sort(cw % 360.0), atol=1e-9)
    assert second.angle_deg[-1] < second.angle_deg[0]


def test_foreseen_parameters_do_not_change_what_is_known(clockwise: lb.Campaign) -> None:
    """A plane that is judged adds parameters at their prior; the readings' evidence and all else
    stay as they were."""
    wider = add_foreseen_tests(
        clockwise, (), [replace(clockwise.plan().tests[0], plane="YZ", setup=2)]
    )
    (alone, found, given), (more, wide, wide_given) = (
        (bound, *bound.given(PHI[None])) for bound in (LINEAR.bind(clockwise), LINEAR.bind(wider))
    )
    assert wide[0] == pytest.approx(found[0], abs=1e-8)
    assert {"C_ZZZ", "C_AYY", "E_ZZ1", "E_Yt0_2"} < set(more.names)
    index = [more.names.index(name) for name in alone.names]
    np.testing.assert_allclose(
        wide_given.mean[0][index], given.mean[0], atol=1e-9 * alone.scale.max()
    )
    new = np.setdiff1d(np.arange(len(more.names)), index)
    np.testing.assert_allclose(
        np.sqrt((wide_given.spread()[0] ** 2).sum(axis=1))[new], more.prior_sd[new], rtol=1e-6
    )


def test_a_second_radius_against_one(pilot: lb.Campaign) -> None:
    one, two = (
        Space(LINEAR, pilot, THREE, radii_mm=radii, parameters=["E_C0YX"])
        for radii in ((), (150.0, 100.0))
    )
    chosen_tests = [space.tests_of(space.search.find_design(6)) for space in (one, two)]
    assert {test.radius_mm for test in chosen_tests[1]} == {150.0, 100.0}
    single, both = (
        space.forecast(space.plan_of(tests)).expected["E_C0YX"]
        for space, tests in zip((one, two), chosen_tests, strict=True)
    )
    assert both.sd < 0.8 * single.sd
    # More circles of one radius would not help, more of two would.
    assert single.floor_sd > 0.9 * single.sd
    assert both.floor_sd < 0.01 * both.sd


def test_a_pilot_of_two_planes(clockwise: lb.Campaign) -> None:
    """Tests of either plane one after the other, equal steps, the model for the analysis with
    overrides and fixed parameters."""
    other = [replace(test, plane="YZ", setup=2, name="") for test in clockwise.plan().tests]
    both = replace(clockwise.plan(), tests=(*clockwise.plan().tests, *other))
    prior = replace(LINEAR.prior, overrides={"C_ZZZ": 2e-5})
    model = replace(LINEAR, prior=prior, fixed=("C_CCY_1",))
    design = lb.design(model, both, tests=6, forces_N=(200.0, 300.0, 400.0), seed=3)
    assert set(zip(design.table["plane"], design.table["setup"], strict=True)) == {
        ("XY", 1),
        ("YZ", 2),
    }
    planned = design.plan(seed=1)
    assert sum(one.plane != other.plane for one, other in pairwise(planned.tests)) == 1
    bound = design.model.bind(planned)
    assert set(bound.names) == set(design.expected)
    np.testing.assert_allclose(
        bound.prior_sd, [design.expected[name].prior_sd for name in bound.names], rtol=1e-12
    )
    assert (bound.prior_sd[bound.names.index("C_ZZZ")], design.model.reference_force_N) == (
        2e-5,
        389.0,
    )
    assert any("plane YZ" in sentence for sentence in design_sentences(design))
    steps = design.compared[0].tests
    assert set(zip(steps["plane"], steps["force_N"], strict=True)) >= {("XY", 200.0), ("YZ", 400.0)}


def test_a_pilot_that_does_not_state_its_direction(pilot: lb.Campaign) -> None:
    with pytest.raises(
        InputError, match=r"'f036' must state its direction, CW or CCW, as circles of plane XY"
    ):
        lb.design(LINEAR, pilot, tests=4, forces_N=THREE, directions=("CW", "CCW"))
    assert {test.direction for test in Space(LINEAR, pilot, THREE, directions=("CW",)).tests} == {
        "CW"
    }
    partly = replace(
        pilot,
        tests=tuple(replace(t, direction="CW" if k else None) for k, t in enumerate(pilot.tests)),
    )
    with pytest.raises(InputError, match=r"'f036' must state its direction.* in other tests"):
        lb.identify(LINEAR, partly)
    # What is foreseen is no part of the readings: the design is still one after these.
    directed = replace(pilot, tests=tuple(replace(t, direction="CW") for t in pilot.tests))
    assert (
        lb.design(LINEAR, directed, tests=4, forces_N=THREE, directions=("CW", "CCW")).pilot.sha256
        == directed.sha256
    )


# Forecasts against simulation


def test_evidence_of_old_and_new_readings_together() -> None:
    """With tests already run: ln B of all readings, the new ones drawn given the old, by dense
    evidences."""
    rng = np.random.default_rng(1)
    old = rng.standard_normal((5, 3))
    new = rng.standard_normal((6, 3))
    rows = np.vstack([old, new])
    y = Gaussian.of(np.zeros(5), old @ old.T + np.eye(5)).draw(rng)
    full, reduced = (
        Gaussian.of(np.zeros(11), columns @ columns.T + np.eye(11))
        for columns in (rows, rows[:, :1])
    )
    three = Gaussian.of(np.zeros(3), np.ones(3))
    samples = {}
    for has_slopes, size in ((True, 3), (False, 1)):
        posterior = Gaussian.of(np.zeros(size), np.ones(size)).observe(old[:, :size], y)
        new_readings = posterior.draw(rng, (40_000,)) @ new[:, :size].T + rng.standard_normal(
            (40_000, 6)
        )
        both = np.hstack([np.tile(y, (40_000, 1)), new_readings])
        samples[has_slopes] = full.log_density(both) - reduced.log_density(both)
    run = three.observe(old, y).marginal([1, 2])
    pilot_posterior = Gaussian.of(run.mean[None], run.covariance[None])
    final_covariance = three.observe(rows, np.zeros(11)).covariance[None, 1:, 1:]
    discrimination = discrimination_of(
        final_covariance, ("a", "b"), size=1.0, before=pilot_posterior, threshold=1.0
    )
    assert discrimination.augmented
    for value, sample in (
        (discrimination.expected_with, samples[True]),
        (discrimination.expected_without, samples[False]),
    ):
        assert value == pytest.approx(sample.mean(), abs=0.1)
    for probability, is_so in (
        (discrimination.decisive_with, samples[True] > 1.0),
        (discrimination.misleading_with, samples[True] < -1.0),
        (discrimination.decisive_without, samples[False] < -1.0),
        (discrimination.misleading_without, samples[False] > 1.0),
    ):
        assert probability == pytest.approx(is_so.mean(), abs=0.01)


@pytest.mark.parametrize("size", [1.0, 3.0])
def test_the_power_for_one_slope_is_that_of_its_estimate(size: float) -> None:
    """A slope of which readings leave the variance c = 0.1 has a posterior mean m that scatters by
    √(c (1 − c)) about (1 − c) β; ln B exceeds 2 where m² is above c (2 · 2 − ln c)."""
    c = 0.1
    discrimination = discrimination_of(np.full((1, 1, 1), c), ("a",), size=size, threshold=2.0)
    edge = np.sqrt(c * (4.0 - np.log(c)))
    m = norm((1.0 - c) * size, np.sqrt(c * (1.0 - c)))
    assert discrimination.power["a"] == pytest.approx(m.sf(edge) + m.cdf(-edge), rel=1e-6)


def test_expected_and_likely_uncertainties_are_quantiles_over_the_machines(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of u = 1, 2, … 9, the median is 5, and nine of ten further machines have u up to 9. The
    median of normal values scatters √(π/2) times as much as their mean."""
    u = np.arange(1.0, 10.0)[:, None]
    monkeypatch.setattr(forecast, "stated_variances", lambda *_, **__: u**2)
    bound = SimpleNamespace(
        scale=np.ones(1),
        model=SimpleNamespace(prior=SimpleNamespace(flat=True)),
        parameters=[SimpleNamespace(name="C_XXX", unit="mm/N")],
    )
    analyses: Any = SimpleNamespace(
        bound=bound,
        states_of_analyses=SimpleNamespace(phi=np.zeros((9, 1))),
        covariance=np.ones((9, 1, 1, 1)),
        prior_sd=np.array([20.0]),
    )
    expected = forecast.expected_uncertainties(analyses, np.ones((9, 1, 1)), np.zeros(1))["C_XXX"]
    assert (expected.sd, expected.untruncated_sd) == (5.0, 5.0)
    assert expected.likely_sd == pytest.approx(9.0, rel=1e-12)
    error = np.sqrt(0.5 * np.pi) * np.sqrt(60.0 / 9.0) / 3.0
    assert expected.sd_error == pytest.approx(error, rel=1e-4)


def test_the_sd_before_the_tests_has_the_scatter_of_the_means_in_it() -> None:
    """Of N(0, 1) and N(4, 3²), each as likely, the variance is (1 + 9) / 2 + 2²."""
    before = Gaussian.of(np.array([[0.0], [4.0]]), np.array([[1.0], [9.0]]))
    states = States(np.zeros((2, 1)), np.zeros((2, 1)), before)
    assert _sd_before(states) == pytest.approx(3.0, rel=1e-12)


@pytest.mark.slow
def test_intervals_inside_the_truncation_against_simulation() -> None:
    """Expected variances of truncated parameters against those found in simulated campaigns at
    given φ and truth."""
    model = LINEAR.without("force-error")
    planned = plan((30,) * 4)
    truth = TRUTH | {"C_CCY": 2e-11}
    bound = model.bind(planned)
    variances = []
    for seed in range(150):
        campaign = model.simulate(planned, seed=seed, parameters=truth, hyper_um=PHI_UM).campaign
        _, posterior = model.bind(campaign).given(PHI[None])
        moments = posterior.orthant.moments()
        along = posterior.spread() @ np.swapaxes(moments.axes, 1, 2)
        change = moments.covariance - np.eye(moments.mean.shape[1])
        variance = (posterior.spread() ** 2).sum(axis=2) + np.einsum(
            "wpd,wde,wpe->wp", along, change, along
        )
        variances.append(variance[0])
    information = information_of(bound, PHI)
    covariance = information.covariance()[
        np.ix_(information.interest, information.interest)
    ] * np.outer(bound.scale, bound.scale)
    states = 100
    beta = np.tile([truth.get(name, 0.0) for name in bound.names], (states, 1))
    truth_states = States(
        np.tile(PHI, (states, 1)),
        beta,
        Gaussian.of(np.zeros_like(beta), np.tile(bound.prior_sd**2, (states, 1))),
    )
    stated = stated_variances(bound, truth_states, np.tile(covariance, (states, 1, 1, 1)))
    expected = stated.mean(axis=0)
    np.testing.assert_allclose(np.sqrt(expected), np.sqrt(np.mean(variances, axis=0)), rtol=0.05)
    untruncated = np.sqrt(np.diag(covariance))[bound.names.index("C_CCY")]
    assert np.sqrt(expected)[bound.names.index("C_CCY")] < 0.85 * untruncated


def states_of(bound: BoundModel, states: int) -> States:
    """Return a number of equal states of the machine, with the prior before the tests."""
    beta = np.tile([TRUTH.get(name, 0.0) for name in bound.names], (states, 1))
    prior = Gaussian.of(np.zeros_like(beta), np.tile(bound.prior_sd**2, (states, 1)))
    return States(np.tile(PHI, (states, 1)), beta, prior)


def test_impossible_states_do_not_count_in_expected_variances() -> None:
    bound = LINEAR.without("force-error").bind(plan((30,) * 4))
    possible = states_of(bound, 4)
    covariance = np.tile(np.diag(0.01 * bound.prior_sd**2), (8, 1, 1, 1))
    covariance[4:] *= 100.0
    both = states_of(bound, 8)
    both.beta[4:, bound.names.index("C_XXX")] = -1e-4
    np.testing.assert_array_equal(
        stated_variances(bound, both, covariance),
        stated_variances(bound, possible, covariance[:4]),
    )


@pytest.mark.parametrize(
    ("options", "message"),
    [
        *REFUSALS,
        (
            {"model": lb.HybridModel.paper(1), "criterion": "discriminate"},
            "criterion discriminate must have proper priors",
        ),
        (
            {"model": lb.HybridModel.paper(1), "tests": 2},
            "tests must be enough to determine the parameters, got 2",
        ),
        (
            {"forces_N": range(36, 743), "clockings_deg": BOTH},
            "a design must choose among 1 to 5000 candidates, got 6363",
        ),
        ({"against": {"equal steps": plan()}}, "against must not use the name 'equal steps'"),
        (
            {"against": {"it": replace(plan(), topology="wXYFZt")}},
            "it must be of the pilot's machine wCAFYXZSt",
        ),
    ],
)
def test_designs_that_cannot_be_are_refused(
    pilot: lb.Campaign, options: dict[str, object], message: str
) -> None:
    refuses(message, lb.design, **{"model": LINEAR, "pilot": pilot, "forces_N": LEVELS, **options})


@pytest.mark.parametrize("augment", [False, True])
def test_offsets_of_a_setup_without_planned_circles_are_shown_by_none(
    pilot: lb.Campaign, augment: bool
) -> None:
    """What is left of them is not shared by all circles: no circle of the plan has them."""
    again = [replace(test, setup=2, name=f"{test.name} again") for test in pilot.tests[:2]]
    twice = replace(pilot, tests=(*pilot.tests, *again))
    constant = lb.HybridModel.first(0)
    design = lb.design(constant, twice, tests=4, forces_N=THREE, augment=augment)
    assert design.limits.not_shown == ("E_Xt0_2", "E_Yt0_2")
    assert not set(design.limits.shared) & set(design.limits.not_shown)
    assert "No circle of this plan shows E_Xt0_2 and E_Yt0_2." in design_sentences(design)


def test_a_plan_in_the_setup_of_its_pilot_shows_every_parameter(six: lb.analysis.Design) -> None:
    assert six.limits.not_shown == ()
    assert not any("No circle of this plan" in sentence for sentence in design_sentences(six))


def test_what_is_known_of_slopes_is_the_ratio_of_their_densities_at_zero() -> None:
    """By Savage and Dickey, ln B of the tests so far is that of prior over posterior at zero."""
    mean = np.array([[0.8]])
    before = Gaussian.of(mean, np.array([[[0.3**2]]]))
    present = norm(0.0, 1.0).logpdf(0.0) - norm(0.8, 0.3).logpdf(0.0)
    covariance = np.full((1, 1, 1), 0.05)
    by_default = discrimination_of(covariance, ("a",), size=1.0, before=before)
    stated = discrimination_of(covariance, ("a",), size=1.0, before=before, present=present)
    assert stated.expected_with == pytest.approx(by_default.expected_with)
    assert stated.decisive_without == pytest.approx(by_default.decisive_without)


def test_larger_slopes_are_expected_to_show_by_the_square_of_their_size() -> None:
    """m = (1 − c) β + √(c (1 − c)) ε, ln B = ½ (ln c + m²/c), for β ~ N(0, 3²)."""
    c = 0.1
    rng = np.random.default_rng(5)
    m = (1.0 - c) * rng.normal(0.0, 3.0, 400_000) + rng.normal(0.0, np.sqrt(c * (1 - c)), 400_000)
    log_bayes_factor = 0.5 * (np.log(c) + m**2 / c)
    discrimination = discrimination_of(np.full((1, 1, 1), c), ("a",), size=3.0)
    assert discrimination.expected_with == pytest.approx(log_bayes_factor.mean(), rel=0.01)
    share = (log_bayes_factor > discrimination.threshold).mean()
    assert discrimination.decisive_with == pytest.approx(share, abs=0.003)
