"""From goals to the cheapest campaign: against dense matrices, brute force and `identify`."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import combinations_with_replacement

import numpy as np
import pytest

import ldbb_bayes as lb
from ldbb_bayes.analysis.design import Costs, GoalDesign, cheapest_search, goals_in, minutes_of
from ldbb_bayes.analysis.design.bound_plans import bind_tests
from ldbb_bayes.analysis.design.campaign_family import CampaignFamily
from ldbb_bayes.analysis.design.cheapest_search import _Progress, _Search
from ldbb_bayes.analysis.design.goal_design import _near_misses
from ldbb_bayes.analysis.design.goals import Goal
from ldbb_bayes.analysis.design.goals_in_reach import u_in_reach
from ldbb_bayes.analysis.design.judged_campaigns import (
    JudgedCampaign,
    are_enough,
    judge_plan,
    judged_on_fresh_machines,
    shares_of_machines,
)
from ldbb_bayes.analysis.design.simulated_analyses import StatedByMachines
from ldbb_bayes.analysis.design.space import Space
from ldbb_bayes.analysis.design.states import extend_hyper_parameters, states_before
from ldbb_bayes.errors import InputError
from ldbb_bayes.results import text_of

MODEL = lb.HybridModel.default(1)
PILOT = lb.read_campaign(lb.embedded_campaign())
FORCES = (36.0, 742.0)
GOALS = {"C_XXX": "24 %", "E_C0YX": "25 µrad"}

pytestmark = pytest.mark.usefixtures("few_states_of_module")


@pytest.fixture(scope="module")
def family():
    space = Space(
        model=MODEL,
        pilot=PILOT,
        forces_N=FORCES,
        clockings_deg=((0.0, 0.0), (45.0, 45.0)),
        directions=("CW", "CCW"),
        parameters=tuple(GOALS),
    )
    states = states_before(MODEL, space.pilot, 64, 1, augment=False)
    return CampaignFamily(space, (), goals_in(space.bound, GOALS), states)


@pytest.fixture(scope="module")
def cheapest():
    return lb.design(MODEL, PILOT, goals={"E_C0YX": "25 µrad"}, forces_N=FORCES)


def test_the_quick_forecast_is_the_mean_of_the_exact_variances_given_the_scales(family):
    counts = np.array([1, 0, 2, 0, 0, 1, 0, 1])
    tests = family.tests_of(counts)
    bound = bind_tests(MODEL, family.space.pilot, tests, keep_pilot_tests=False)
    chosen = np.unique(np.linspace(0, 63, 6).round().astype(int))
    phi = extend_hyper_parameters(bound, family.states.phi[chosen], 0)
    sd = bound.given(phi)[1].sd
    expected = []
    for name, goal in family.goals.items():
        k = bound.names.index(name)
        limit = goal.limit_u(family.states.beta[chosen, k])
        expected.append(np.log(sd[:, k] / limit).mean())
    np.testing.assert_allclose(family.quick.distances(counts), expected, rtol=1e-6)


def test_distances_after_one_more_circle_are_those_of_the_longer_campaigns(family):
    counts = np.array([1, 0, 1, 0, 0, 1, 0, 0])
    quick = family.quick
    distances = quick._distances_after(quick._covariance(counts))
    longer = [quick.distance(counts + one) for one in np.eye(len(counts), dtype=int)]
    np.testing.assert_allclose(distances, longer, rtol=1e-9)


@pytest.mark.parametrize("circles", [2, 3, 4])
def test_exchanges_find_the_best_campaign_of_few_circles(family, circles):
    distances = []
    for chosen in combinations_with_replacement(range(8), circles):
        distances.append(family.quick.distance(np.bincount(chosen, minlength=8)))
    none = np.zeros(8, dtype=int)
    by_exchanges = family.quick.distance(family.quick.best_counts(circles, none))
    assert by_exchanges == pytest.approx(min(distances), abs=1e-9)


@pytest.mark.slow
def test_no_campaign_of_up_to_six_circles_is_cheaper_by_brute_force(family):
    costs = Costs()
    best = lb.design(MODEL, PILOT, goals=GOALS, forces_N=FORCES, costs=costs).best
    assert best.circles <= 6
    cheaper = []
    for circles in range(1, 7):
        for chosen in combinations_with_replacement(range(8), circles):
            counts = np.bincount(chosen, minlength=8)
            tests = family.tests_of(counts)
            if minutes_of(costs, tests) < best.minutes and len({t.force_N for t in tests}) > 1:
                cheaper.append((family.quick.distance(counts), counts))
    assert len(cheaper) > 100
    cheaper.sort(key=lambda entry: entry[0])
    for _, counts in cheaper[:12]:
        campaign = judge_plan(family, family.tests_of(counts))
        assert shares_of_machines(campaign.stated, family.goals)[""] < 0.9


def test_circles_are_chosen_anew_where_a_growing_campaign_stays_in_one_direction(
    family, monkeypatch
) -> None:
    # Squareness shares its order with the form of the balls and with hysteresis. Both ball angles
    # in both directions show all three, in four circles. Four circles in one direction do not show
    # hysteresis: 1 µm of two lobes (1 sd) is 1 µm / (75 mm) = 13 µrad, and U larger than 20 µrad.
    goals = goals_in(family.bound, {"E_C0YX": "20 µrad"})
    of_squareness = CampaignFamily(family.space, (), goals, family.states)
    tests = family.space.tests
    in_one_direction = np.array([int(test.direction == "CW") for test in tests])
    in_both = np.array([int(test.force_N == FORCES[0]) for test in tests])
    in_both[:2] = (0, 1)  # two different forces

    def best_counts(_self, circles, start=None):
        assert circles == 4
        return in_both if start is None else in_one_direction

    monkeypatch.setattr(CampaignFamily, "best_counts", best_counts)
    monkeypatch.setattr(_Search, "_with_fewer_circles", lambda _self, _progress, found: found)
    search = _Search(goals, Costs(), 0.9)
    progress = _Progress(of_squareness, circles=4, counts=np.zeros(len(tests), dtype=int))
    found = search.attempt(progress)
    assert found is not None
    assert {test.direction for test in found.tests} == {"CW", "CCW"}


def test_the_cheapest_campaign_keeps_its_promise_by_its_own_forecast(cheapest):
    assert cheapest.best.probability >= 0.9
    assert cheapest.best.goals["E_C0YX"].likely_U <= 25e-6


def test_minutes_and_price_are_those_of_the_plan(cheapest):
    minutes = minutes_of(Costs(), cheapest.plan().tests)
    assert cheapest.best.minutes == minutes
    assert cheapest.best.price == pytest.approx(minutes)


def test_plans_come_with_rising_prices(cheapest):
    prices = [plan.price for plan in cheapest.plans]
    assert len(prices) == 3
    assert prices == sorted(prices)


def test_identify_of_the_written_plan_states_the_forecast_to_the_digit(cheapest, tmp_path):
    lb.write_campaign(cheapest.plan(), tmp_path / "plan")
    plan = lb.read_campaign(tmp_path / "plan")
    stated = lb.identify(MODEL, plan).parameters
    for name, expected in cheapest.best.expected.items():
        assert stated[name].sd == expected.sd


@pytest.mark.slow
def test_identify_of_a_certified_plan_states_the_forecast_to_the_digit(tmp_path):
    design = lb.design(
        MODEL,
        PILOT,
        goals={"E_C0YX": "25 µrad"},
        forces_N=FORCES,
        clockings_deg=((0.0, 0.0),),
        certificates={"balls G10": 300.0},
    )
    assert design.best.certificates == ("balls of grade G10",)
    lb.write_campaign(design.plan(), tmp_path / "plan")
    plan = lb.read_campaign(tmp_path / "plan")
    stated = lb.identify(MODEL, plan).parameters["E_C0YX"].sd
    assert stated == design.best.expected["E_C0YX"].sd


def test_customary_campaigns_run_both_directions_without_turning_the_balls(cheapest):
    steps, published = cheapest.customary
    assert steps.customary.circles == cheapest.best.circles == steps.ours.circles
    assert published.customary.circles == published.ours.circles == 7
    for compared in (steps, published):
        tests = compared.customary.plan().tests
        assert {test.direction for test in tests} == {"CW", "CCW"}
        assert {test.work_ball_deg for test in tests} == {0.0}


def test_goals_are_found_as_they_are_printed(cheapest):
    again = GoalDesign.from_dict(cheapest.as_dict())
    for result in (cheapest, again):
        assert result.goals["E_C(0Y)X"] is result.goals["E_C0YX"]


def test_our_plan_beats_what_is_done_today(cheapest):
    for compared in cheapest.customary:
        ours = compared.ours.goals["E_C0YX"].U
        assert ours < compared.customary.goals["E_C0YX"].U


def test_a_goal_that_circles_cannot_reach_names_what_holds_it_and_the_certificate():
    design = lb.design(MODEL, PILOT, goals={"C_XXX": "5 %"})
    obstacle = design.obstacles["C_XXX"]
    assert design.unreachable == ("C_XXX",)
    assert design.plans == ()
    assert obstacle.held_by == "Mount"
    assert obstacle.certificate == "mount ± 2 %"
    assert obstacle.U_with_certificate < obstacle.U_floor
    assert "no number of circles brings U below" in text_of(design)


@pytest.mark.slow
def test_what_to_ask_for_instead_of_a_goal_out_of_reach_is_in_reach():
    design = lb.design(MODEL, PILOT, goals={"C_XXX": "5 %"}, directions=("CW", "CCW"))
    asked = re.search(r"Ask for ([0-9.]+ nm/N) or more", text_of(design)).group(1)
    again = lb.design(MODEL, PILOT, goals={"C_XXX": asked}, directions=("CW", "CCW"))
    assert again.all_reached


def test_a_goal_that_the_pilot_meets_needs_nothing():
    design = lb.design(MODEL, PILOT, goals={"C_XXX": "30 %"})
    assert design.goals["C_XXX"].met_by_pilot
    assert design.all_reached
    assert design.plans == ()
    assert "nothing is needed: C_XXX" in text_of(design)
    assert "U now is not above what is wanted" in " ".join(text_of(design).split())


@pytest.fixture(scope="module")
def hardly_met():
    """Design for a goal in percent that U now meets at the estimate, but not on most machines."""
    now = lb.analysis.next_circle(MODEL, PILOT, goals={"C_XXX": "30 %"}).goals["C_XXX"]
    goals = {"C_XXX": f"{100.5 * now.U / now.value:.2f} %"}
    return goals, lb.design(MODEL, PILOT, goals=goals, directions=("CW",))


def test_a_goal_that_hangs_on_the_true_value_is_not_met_already(hardly_met):
    stated = hardly_met[1].goals["C_XXX"]
    assert stated.limit_U > stated.U
    assert not stated.met_by_pilot
    assert not hardly_met[1].all_met


def test_design_and_next_state_one_probability_that_a_goal_is_met(hardly_met):
    goals, design = hardly_met
    step = lb.analysis.next_circle(MODEL, PILOT, goals=goals)
    stated = design.goals["C_XXX"]
    assert 0.4 < stated.probability < 0.7
    assert stated.probability == step.goals["C_XXX"].probability
    assert f"enough on {100.0 * stated.probability:.0f} % of" in " ".join(text_of(design).split())


def test_a_goal_is_met_already_by_the_fit_that_next_stops_with():
    """Hysteresis that only circles of the other direction can show does not count: between U of
    the fit and U with it, `design` wanted circles where `next` said that the aim is reached."""
    options = {"directions": ("CW", "CCW"), "forces_N": FORCES}
    now = lb.analysis.next_circle(MODEL, PILOT, goals={"C_YYY": "30 %"}, **options).goals["C_YYY"]
    limit = 0.5e6 * (now.U_of_fit + now.U)
    options["goals"] = {"C_YYY": f"{limit:.3f} nm/N"}
    design = lb.design(MODEL, PILOT, **options)
    assert now.U_of_fit < now.U
    assert lb.analysis.next_circle(MODEL, PILOT, **options).goals["C_YYY"].probability == 1.0
    assert design.goals["C_YYY"].met_by_pilot
    assert design.goals["C_YYY"].probability == 1.0
    (row,) = re.findall(r"C_YYY +[\d.]+ +([\d.]+) +met already", text_of(design))
    assert float(row) == pytest.approx(1e6 * now.U_of_fit, rel=0.01)
    assert f"it is: C_YYY {1e6 * now.U:.1f} nm/N" in " ".join(text_of(design).split())


def test_a_campaign_that_takes_too_long_is_not_offered():
    design = lb.design(
        MODEL, PILOT, goals={"E_C0YX": "25 µrad"}, forces_N=FORCES, costs=Costs(hours=0.3)
    )
    assert design.plans == ()
    assert design.too_long
    assert "No campaign within 0.3 h" in text_of(design)


def test_an_offer_that_the_campaign_states_already_is_not_dropped_silently():
    instrument = replace(PILOT.instrument, work=lb.Ball(grade="G5"))
    pilot = replace(PILOT, instrument=instrument)
    with pytest.raises(InputError, match="Offer 'tool ball G10' instead"):
        lb.design(MODEL, pilot, goals={"E_C0YX": "25 µrad"}, certificates={"balls G10": 300.0})


def test_what_is_too_long_says_how_long_the_cheapest_takes(cheapest):
    design = lb.design(
        MODEL, PILOT, goals={"E_C0YX": "25 µrad"}, forces_N=FORCES, costs=Costs(hours=0.3)
    )
    assert design.without_limit.minutes == cheapest.best.minutes
    assert design.without_limit.circles == cheapest.best.circles
    assert f"takes {cheapest.best.minutes / 60.0:.1f} h" in " ".join(text_of(design).split())


@pytest.mark.slow
def test_no_campaign_buys_a_certificate_that_saves_no_time():
    offers = {"bar": 150.0, "balls G10": 300.0}
    design = lb.design(
        MODEL, PILOT, goals={"E_C0YX": "25 µrad"}, forces_N=FORCES, certificates=offers
    )
    assert len(design.plans) == 3
    for dearer in design.plans[1:]:
        for cheaper in design.plans:
            has_more_certificates = set(dearer.certificates) > set(cheaper.certificates)
            assert not has_more_certificates or dearer.minutes < cheaper.minutes


def test_the_record_survives_json(cheapest):
    record = cheapest.as_dict()
    assert GoalDesign.from_dict(record).as_dict() == record


def test_a_design_from_a_file_has_no_plan(cheapest):
    with pytest.raises(InputError, match="a plan must be at hand"):
        GoalDesign.from_dict(cheapest.as_dict()).plan()


def test_the_sentences_state_circles_minutes_and_share_of_machines(cheapest):
    best = cheapest.best
    text = text_of(cheapest)
    assert f"Run {best.circles} circles in {best.minutes:.0f} min" in text


def test_one_circle_is_not_called_circles(cheapest):
    single = replace(cheapest.best, circles=1)
    assert "Run 1 circle in" in text_of(replace(cheapest, plans=(single,)))
    short = replace(cheapest.costs, hours=0.1)
    too_long = replace(cheapest, plans=(), customary=(), without_limit=single, costs=short)
    text = " ".join(text_of(too_long).split())
    assert " h: 1 circle, price" in text


def test_a_goal_in_percent_is_out_of_reach_by_percent():
    """The goal is 5 % of each machine's own C_XXX: no U in nm/N is out of reach on all of them."""
    design = lb.design(MODEL, PILOT, goals={"C_XXX": "5 %"}, forces_N=FORCES)
    goal = design.goals["C_XXX"]
    obstacle = replace(design.obstacles["C_XXX"], U_floor=1.7 * goal.limit_U)
    text = " ".join(text_of(replace(design, obstacles={"C_XXX": obstacle})).split())
    assert "C_XXX: no number of circles brings U below 8.5 %; 5.0 % is wanted." in text


@pytest.mark.parametrize(("probability", "u_in_nm"), [(0.9, 59.0), (0.5, 33.0), (0.99, 64.0)])
def test_what_is_in_reach_is_what_enough_machines_reach(probability, u_in_nm):
    """Of 64 machines 59 are 90 % of 65: the goal has to be above the 59th, and that will do."""
    u = np.arange(64.0, 0.0, -1.0)[:, None]
    stated = StatedByMachines(("C_XXX",), np.ones_like(u), u)
    goals = {"C_XXX": Goal("C_XXX", "mm/N", absolute=0.1)}
    assert u_in_reach(stated, goals, probability) == {"C_XXX": u_in_nm}
    assert are_enough(np.mean(u <= u_in_nm), 64, probability)
    assert probability > 0.98 or not are_enough(np.mean(u < u_in_nm), 64, probability)


def test_what_is_in_reach_of_several_goals_is_reached_by_them_together():
    """Of 100 machines, 5 have a large u of one parameter and 5 others of another. Each goal alone
    is met on 95, both on 90: 90 % of 101 machines are 91, so that one of these ten has to be
    reached too. The goal that all machines meet stays as it is."""
    u = np.ones((100, 3))
    u[:5, 0] = [2.0, 3.0, 4.0, 5.0, 6.0]
    u[5:10, 1] = [2.0, 3.0, 4.0, 5.0, 6.0]
    stated = StatedByMachines(("C_XXX", "C_YYY", "C_CCY"), np.ones_like(u), u)
    goals = {name: Goal(name, "mm/N", absolute=3.8) for name in ("C_XXX", "C_YYY")}
    goals["C_CCY"] = Goal("C_CCY", "mm/N", absolute=4.0)
    assert u_in_reach(stated, goals, 0.9) == {"C_XXX": 2.0}
    assert np.sum((u[:, 0] <= 2.0) & (u[:, 1] <= 1.9)) == 91


def test_a_goal_that_is_reached_stays_as_it_is():
    u = np.stack([np.linspace(1.0, 2.0, 64), np.linspace(1.0, 9.0, 64)], axis=1)
    stated = StatedByMachines(("C_XXX", "C_YYY"), np.ones_like(u), u)
    goals = {
        "C_XXX": Goal("C_XXX", "mm/N", absolute=4.0),
        "C_YYY": Goal("C_YYY", "mm/N", absolute=4.0),
    }
    (name,) = u_in_reach(stated, goals, 0.9)
    assert name == "C_YYY"
    assert u_in_reach(stated, {"C_XXX": goals["C_XXX"]}, 0.9) == {}


def test_hours_in_which_no_campaign_fits_are_answered_with_what_the_shortest_takes():
    """A set-up of 15 min and two circles of 3 min each, for two forces."""
    goals = {"E_C0YX": "25 µrad"}
    design = lb.design(MODEL, PILOT, goals=goals, forces_N=FORCES, costs=Costs(hours=0.3))
    assert design.nearest is None
    assert design.shortest_minutes == 21.0
    assert "The shortest campaign takes 21 min" in " ".join(text_of(design).split())


@pytest.mark.slow
def test_what_to_ask_for_within_the_hours_is_what_a_campaign_within_them_leaves():
    """Two goals are out of reach whatever the time; the third is so within this time."""
    goals = {"C_XXX": "8 %", "C_YYY": "12 %", "E_C0YX": "3 µrad"}
    options = {"costs": Costs(hours=0.7), "augment": True}
    design = lb.design(MODEL, PILOT, goals=goals, **options)
    text = " ".join(text_of(design).split())
    assert not design.all_reached
    assert design.nearest.minutes <= 42.0
    asked = dict(re.findall(r"(C_...): no number [^:]*? Ask for ([0-9.]+ nm/N) or more", text))
    assert set(asked) == {"C_XXX", "C_YYY"}
    assert set(asked) < set(design.in_reach)
    for name, goal in asked.items():
        assert float(goal.split()[0]) >= 1.05e6 * design.in_reach[name]
    assert minutes_of(Costs(), design.nearest.plan().tests) == design.nearest.minutes


@pytest.mark.parametrize(
    ("share_of_present", "sentence"),
    [(0.9, "Ask for"), (0.99, "40 circles alone leave no less than is known already.")],
)
def test_no_goal_is_suggested_that_is_no_less_than_the_present_one(share_of_present, sentence):
    """A goal 5 % above what 40 circles leave is suggested: 0.99 of U now is too much."""
    design = lb.design(MODEL, PILOT, goals={"C_XXX": "5 %"}, forces_N=FORCES)
    stated = design.goals["C_XXX"]
    present_U = stated.U_of_fit or stated.U
    obstacle = replace(design.obstacles["C_XXX"], reachable_U=share_of_present * present_U)
    text = text_of(replace(design, obstacles={"C_XXX": obstacle}))
    assert sentence in " ".join(text.split())
    for asked in re.findall(r"Ask for ([0-9.]+) nm/N", text):
        assert share_of_present * present_U <= 1e-6 * float(asked) / 1.05 < present_U
    added = replace(design, adds_to_pilot=True, obstacles={"C_XXX": obstacle})
    hardly = "Adding 40 circles hardly narrows U." in " ".join(text_of(added).split())
    assert hardly == (share_of_present == 0.99)


def test_circles_that_are_added_need_not_have_the_clocking_of_the_pilot():
    """One circle with turned balls is enough; with the balls as they were it would not help."""
    turned = (90.0, 90.0)
    for clockings in ((turned,), ((0.0, 0.0), turned)):
        design = lb.design(
            MODEL,
            PILOT,
            goals={"E_C0YX": "45 µrad"},
            forces_N=FORCES,
            clockings_deg=clockings,
            augment=True,
        )
        (test,) = design.best.plan().tests
        assert (test.work_ball_deg, test.tool_ball_deg) == turned


def test_a_goal_just_below_what_remains_reads_as_less_than_it():
    """Of 5.43 and 5.40 two digits would be the same."""
    far = lb.design(MODEL, PILOT, goals={"E_C0YX": "1e-3 µrad"}, forces_N=FORCES)
    goal = 0.999 * far.obstacles["E_C0YX"].U_floor
    design = lb.design(MODEL, PILOT, goals={"E_C0YX": goal}, forces_N=FORCES)
    pattern = r"brings U below ([\d.]+) µrad; ([\d.]+) µrad is wanted"
    (numbers,) = re.findall(pattern, " ".join(text_of(design).split()))
    floor, wanted = map(float, numbers)
    assert floor > wanted


def test_what_remains_is_above_a_goal_in_percent_as_it_is_stated():
    design = lb.design(MODEL, PILOT, goals={"C_XXX": "5 %"}, forces_N=FORCES)
    assert design.obstacles["C_XXX"].U_floor > design.goals["C_XXX"].limit_U
    assert "C_XXX: wanted is 5 % of " in text_of(design)


def test_a_design_states_the_u_that_the_next_circle_states():
    """Same circles, same model, same directions: the same value, the same U, the same goal."""
    goals = {"C_XXX": "5 %"}
    directions = ("CW", "CCW")
    stated = lb.design(MODEL, PILOT, goals=goals, forces_N=FORCES, directions=directions)
    step = lb.analysis.next_circle(
        MODEL, PILOT, goals=goals, forces_N=FORCES, directions=directions
    )
    of_design = stated.goals["C_XXX"]
    of_next = step.goals["C_XXX"]
    assert of_design.value == of_next.value
    assert of_design.U == of_next.U
    assert of_design.limit_U == of_next.limit
    assert of_design.U_of_fit == of_next.U_of_fit


def test_next_and_design_state_one_floor():
    """Very many circles leave the same U, whether they are planned at once or one by one."""
    options = {"forces_N": FORCES, "clockings_deg": ((0.0, 0.0), (45.0, 45.0))}
    options |= {"directions": ("CW", "CCW"), "goals": {"C_XXX": "4 nm/N"}}
    stated = lb.design(MODEL, PILOT, augment=True, **options)
    step = lb.analysis.next_circle(MODEL, PILOT, **options)
    assert step.more_circles is None
    floor = stated.obstacles["C_XXX"].U_floor
    assert step.goals["C_XXX"].U_floor == pytest.approx(floor, rel=0.05)


@pytest.mark.slow
def test_forty_circles_do_not_beat_what_no_number_of_circles_is_said_to_beat():
    """That C_CCY is not negative narrows it, which the quick forecast leaves out."""
    options = {"forces_N": FORCES, "directions": ("CW",), "augment": True}
    forty = lb.design(MODEL, PILOT, tests=40, parameters=["C_CCY"], **options)
    design = lb.design(MODEL, PILOT, goals={"C_CCY": "0.01 µrad/(N m)"}, **options)
    assert design.obstacles["C_CCY"].U_floor < 2.0 * forty.expected["C_CCY"].sd


@pytest.mark.parametrize("directed", [True, False])
def test_where_hysteresis_holds_a_goal_both_directions_are_named(directed):
    pilot = PILOT
    if not directed:
        pilot = replace(pilot, tests=tuple(replace(test, direction=None) for test in pilot.tests))
    design = lb.design(MODEL, pilot, goals={"E_C0YX": "1e-3 µrad"}, forces_N=FORCES)
    is_named = "--directions both" in " ".join(text_of(design).split())
    assert is_named == (design.obstacles["E_C0YX"].held_by == "Hysteresis") == (not directed)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"tests": 6}, "goals must go without tests"),
        ({"criterion": "d"}, "goals must go without criterion"),
        ({"probability": 1.5}, "probability must be a number between 0 and 1"),
        ({"goals": {"C_XXY": "5 %"}}, "goal must be one of"),
        ({"certificates": {"bars": 1.0}}, "certificate must be one of"),
    ],
)
def test_what_does_not_go_with_goals_is_refused(options, message):
    with pytest.raises(InputError, match=message):
        lb.design(MODEL, PILOT, **{"goals": {"C_XXX": "5 %"}, **options})


def test_costs_without_goals_are_refused():
    with pytest.raises(InputError, match="costs and certificates must go with goals"):
        lb.design(MODEL, PILOT, costs=Costs())


def test_flat_priors_are_refused():
    with pytest.raises(InputError, match="goals must be held against proper priors"):
        lb.design(lb.HybridModel.paper(), PILOT, goals={"C_XXX": "5 %"})


@pytest.mark.slow
def test_a_plan_without_readings_may_be_the_pilot():
    design = lb.design(MODEL, replace(PILOT.plan()), goals={"E_C0YX": "60 µrad"}, forces_N=FORCES)
    assert not design.measured
    assert not design.goals["E_C0YX"].met_by_pilot


@pytest.fixture(scope="module")
def just_missed():
    """Goal a little above what very many circles leave, so that 40 circles do not reach it."""
    beyond_reach = lb.design(MODEL, PILOT, goals={"E_C0YX": "1e-3 µrad"}, forces_N=FORCES)
    floor = beyond_reach.obstacles["E_C0YX"].U_floor
    costs = Costs(hours=8.0)
    return lb.design(MODEL, PILOT, goals={"E_C0YX": 1.02 * floor}, forces_N=FORCES, costs=costs)


@pytest.mark.slow
def test_a_goal_that_only_very_many_circles_reach_is_a_near_miss(just_missed):
    near_miss = just_missed.near_misses["E_C0YX"]
    assert just_missed.plans == ()
    assert just_missed.obstacles == {}
    assert near_miss.circles == 40
    assert near_miss.probability < 0.9


def test_the_largest_campaign_of_a_near_miss_leaves_more_than_the_goal(just_missed):
    assert just_missed.near_misses["E_C0YX"].likely_U > just_missed.goals["E_C0YX"].limit_U


def test_a_goal_that_no_campaign_reaches_is_named_first(just_missed):
    assert str(text_of(just_missed)).startswith("Out of reach, for the reasons below: E_C(0Y)X.")


@pytest.mark.slow
def test_goals_beside_a_near_miss_still_get_a_campaign(just_missed):
    floor = just_missed.goals["E_C0YX"].limit_U
    goals = {"E_C0YX": floor, "C_XYX": "2 nm/N"}
    design = lb.design(MODEL, PILOT, goals=goals, forces_N=FORCES)
    assert list(design.near_misses) == ["E_C0YX"]
    assert list(design.best.goals) == ["C_XYX"]
    assert not design.all_reached
    text = " ".join(text_of(design).split())
    assert text.startswith("Out of reach, for the reasons below: E_C(0Y)X. Run ")
    assert "The other goals are met" in text


@pytest.mark.slow
def test_what_the_plan_leaves_of_a_goal_out_of_reach_is_stated():
    """By the forecast of the plan, beside the goals that it reaches, and in the file."""
    goals = {"E_C0YX": "1e-3 µrad", "C_XYX": "2 nm/N"}
    design = lb.design(MODEL, PILOT, goals=goals, forces_N=FORCES)
    assert design.unreachable == ("E_C0YX",)
    unreached = design.unreached["E_C0YX"]
    expected = design.best.expected["E_C0YX"]
    assert (unreached.U, unreached.likely_U) == (2.0 * expected.sd, 2.0 * expected.likely_sd)
    assert unreached.probability == 0.0
    assert unreached.averaged_U > 0.0
    (row,) = re.findall(r"E_C\(0Y\)X +[\d.]+ +[\d.]+ +([\d.]+) +not reached", text_of(design))
    assert float(row) == pytest.approx(1e6 * unreached.U, rel=0.05)
    assert GoalDesign.from_dict(design.as_dict()).unreached == design.unreached
    older = design.as_dict()
    del older["unreached"]
    assert GoalDesign.from_dict(older).unreached == {}


def test_no_goal_is_left_where_all_are_reached_or_no_campaign_is_found(cheapest, just_missed):
    assert cheapest.unreached == just_missed.unreached == {}
    assert "U expected" in text_of(cheapest)
    assert "U expected" not in text_of(just_missed)


def test_a_campaign_is_judged_on_fresh_machines_too(family):
    campaign = judge_plan(family, family.tests_of(np.array([1, 0, 2, 0, 0, 1, 0, 1])))
    again = judged_on_fresh_machines(campaign).stated.u
    machines = len(campaign.stated.u)
    assert len(again) > machines
    np.testing.assert_array_equal(again[:machines], campaign.stated.u)
    assert not np.isin(again[machines:], again[:machines]).any()


@pytest.mark.parametrize(
    ("successes", "probability", "reached"),
    [(58, 0.9, False), (59, 0.9, True), (63, 0.99, False), (64, 0.99, True)],
)
def test_the_probability_is_that_of_one_more_machine(successes, probability, reached):
    """Of 64 machines and one more, the new one is the worst with probability 1/65."""
    u = np.where(np.arange(64) < successes, 1e-6, 3e-6)[:, None]
    stated = StatedByMachines(("C_XXX",), np.full((64, 1), 5e-5), u)
    campaign = JudgedCampaign(None, (), None, None, stated)
    goals = {"C_XXX": Goal("C_XXX", "mm/N", absolute=4e-6)}
    assert _Search(goals, Costs(), probability)._is_met(campaign) == reached


def test_a_goal_that_most_machines_reach_is_no_near_miss(monkeypatch):
    """58 of 64 machines are too few for 90 % of one more: that goal is missed, the other is not."""
    stub = "ldbb_bayes.analysis.design.goal_design.near_miss_of"
    monkeypatch.setattr(stub, lambda family, name, **numbers: numbers["probability"])
    u = np.full((64, 2), 1e-6)
    u[58:, 1] = 3e-6
    stated = StatedByMachines(("C_XXX", "C_YYY"), np.full((64, 2), 5e-5), u)
    nearest = JudgedCampaign(None, (), None, None, stated)
    goals = {name: Goal(name, "mm/N", absolute=4e-6) for name in ("C_XXX", "C_YYY")}
    by_goal = dict.fromkeys(goals, nearest)
    assert _near_misses(nearest, by_goal, goals, 0.9) == {"C_YYY": 58 / 64}
    assert _near_misses(nearest, by_goal, goals, 0.8) == {"C_YYY": 58 / 64}


def test_a_goal_that_another_campaign_reaches_is_no_near_miss(monkeypatch):
    """C_XXX is reached by none, so that all campaigns are equally far from both goals together."""
    stub = "ldbb_bayes.analysis.design.goal_design.near_miss_of"
    monkeypatch.setattr(stub, lambda family, name, **numbers: numbers["probability"])
    goals = {name: Goal(name, "mm/N", absolute=4e-6) for name in ("C_XXX", "C_YYY")}
    search = _Search(goals, Costs(), 0.9)
    for u_of_second in (3e-6, 1e-6):
        u = np.tile([3e-6, u_of_second], (64, 1))
        stated = StatedByMachines(tuple(goals), np.full((64, 2), 5e-5), u)
        search._keep_nearest(JudgedCampaign(None, (), None, None, stated))
    missed = _near_misses(search.nearest, search.nearest_by_goal, goals, 0.9)
    assert missed == {"C_XXX": 0.0}


def test_costs_must_be_costs():
    with pytest.raises(InputError, match="costs must be Costs, got 60"):
        lb.design(MODEL, PILOT, goals={"E_C0YX": "25 µrad"}, costs=60)


def test_a_near_miss_is_not_put_down_to_a_lack_of_time(just_missed):
    assert not just_missed.too_long
    assert not just_missed.all_reached
    assert "Allow more time" not in text_of(just_missed)


def test_a_near_miss_states_what_the_largest_campaign_leaves_and_what_holds_it(just_missed):
    text = " ".join(text_of(just_missed).split())
    assert "E_C(0Y)X: 40 circles leave U of up to" in text
    assert "holds the largest share of what still more circles would leave" in text


@pytest.mark.slow
def test_goals_that_need_many_more_circles_than_are_tried_first_get_a_campaign():
    """C_XXX is asked for little more than very many circles leave of it."""
    goals = {"C_XXX": "13 %", "E_C0YX": "10 µrad"}
    design = lb.design(MODEL, PILOT, goals=goals, directions=("CW", "CCW"))
    assert design.plans or design.near_misses
    if design.plans:
        assert design.best.probability >= 0.9


def test_the_averaged_u_of_the_cheapest_campaign_is_that_of_identify(cheapest):
    expected = lb.identify(cheapest.best.model, cheapest.plan()).averaged_sd
    averaged_U = cheapest.best.goals["E_C0YX"].averaged_U
    assert averaged_U == 2.0 * expected["E_C0YX"]
    assert cheapest.goals["E_C0YX"].averaged_U > averaged_U
    assert all(goal.averaged_U is None for goal in cheapest.plans[1].goals.values())


@pytest.mark.slow
def test_a_search_that_no_campaign_ends_says_why(monkeypatch):
    """All campaigns miss the goals on fresh machines, although the largest seemed to reach them."""
    monkeypatch.setattr(cheapest_search, "judged_on_fresh_machines", _all_unlucky)
    design = lb.design(MODEL, PILOT, goals={"E_C0YX": "25 µrad"}, forces_N=FORCES)
    assert not design.plans
    assert list(design.near_misses) == ["E_C0YX"]


def _all_unlucky(campaign: JudgedCampaign) -> JudgedCampaign:
    return replace(campaign, stated=replace(campaign.stated, u=1e3 * campaign.stated.u))
