"""Designs over planes, directions and centres: what is foreseen, what each adds, and what the plan says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from campaigns import plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.analysis.candidates import bind_tests
from ldbb_bayes.analysis.costs import running_order
from ldbb_bayes.analysis.design import _limits
from ldbb_bayes.analysis.places import foreseen_by, templates
from ldbb_bayes.analysis.space import DesignSpace
from ldbb_bayes.model.information import information_of

LINEAR = lb.HybridModel.default(1)
LEVELS = (36.0, 389.0, 742.0)


@pytest.fixture(scope="module")
def pilot() -> lb.Campaign:
    made = simulated(plan(), seed=2)
    return replace(made, tests=tuple(replace(test, direction="CW") for test in made.tests))


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


def test_foreseen_parameters_do_not_change_what_is_known(pilot: lb.Campaign) -> None:
    """A plane that may follow adds parameters at their prior; the readings' evidence and all else stay as they were."""
    wider = foreseen_by(pilot, templates(pilot, ("YZ",), (), ()))
    alone, more = LINEAR.bind(pilot), LINEAR.bind(wider)
    phi = np.array([[2e-4, 5e-4, 3e-4, 2e-3]])
    found, given = alone.given(phi)
    wide, wide_given = more.given(phi)
    assert wide[0] == pytest.approx(found[0], abs=1e-8)
    assert {"C_ZZZ", "C_AYY", "E_ZZ1", "E_Yt0_2"} < set(more.names)
    index = [more.names.index(name) for name in alone.names]
    np.testing.assert_allclose(wide_given.mean[0][index], given.mean[0], atol=1e-9 * alone.scale.max())
    spread = wide_given.spread()[0]
    sd = np.sqrt((spread**2).sum(axis=1))
    for name in set(more.names) - set(alone.names):
        assert sd[more.names.index(name)] == pytest.approx(more.prior_sd[more.names.index(name)])
    unseen = [k for k, name in enumerate(more.compliances) if name.label == "C_ZZZ"]
    assert more.setting.compliance_estimate[unseen] == pytest.approx(5e-5)


def test_hysteresis_counts_for_every_design_that_could_have_both_ways(pilot: lb.Campaign) -> None:
    """Expected sd of C_XYX by dense matrices: circles of one direction know it no better than the friction does."""
    both = lb.design(LINEAR, pilot, tests=6, forces_N=LEVELS, directions=("CW", "CCW"), parameters=["C_XYX"])
    assert {test.direction for test in both.tests} == {"CW", "CCW"}
    one_way = tuple(replace(test, direction="CW") for test in both.tests)
    wider = foreseen_by(pilot, templates(pilot, (), ("CW", "CCW"), ()))
    phi = np.array([2e-4, 5e-4, 3e-4, 2e-3])

    def sd(tests: tuple[lb.CircularTest, ...]) -> float:
        information = information_of(bind_tests(LINEAR, wider, tests, keep=False), phi)
        rows = information.rows()
        covariance = np.linalg.inv(rows.T @ rows + np.eye(rows.shape[1]))
        k = information.names.index("C_XYX")
        return float(np.sqrt(covariance[k, k]) * information.scale[k])

    # F s sin 2θ of 1 µm/kN is 2 µm/kN of C_XYX: with one sd of 2 µm/kN / 2 a friction of 2e-6 mm/N stays in it.
    friction = 2.0 * 2e-6 / 2.0
    prior = 1e-5
    hidden = friction * prior / np.hypot(friction, prior)
    assert sd(one_way) == pytest.approx(hidden, rel=0.15)
    assert sd(both.tests) < 0.75 * sd(one_way)


def test_a_second_radius_against_one(pilot: lb.Campaign) -> None:
    two = lb.design(LINEAR, pilot, tests=6, forces_N=LEVELS, radii_mm=(150.0, 100.0), parameters=["E_C0YX"])
    one = lb.design(LINEAR, pilot, tests=6, forces_N=LEVELS, parameters=["E_C0YX"])
    assert {test.radius_mm for test in two.tests} == {150.0, 100.0}
    assert two.forecast.expected["E_C0YX"].sd < 0.8 * one.forecast.expected["E_C0YX"].sd
    # More circles of one radius would not help, more of two would.
    assert one.forecast.expected["E_C0YX"].floor_sd > 0.9 * one.forecast.expected["E_C0YX"].sd
    assert two.forecast.expected["E_C0YX"].floor_sd < 0.01 * two.forecast.expected["E_C0YX"].sd


def test_another_plane_is_planned(pilot: lb.Campaign) -> None:
    found = lb.design(LINEAR, pilot, tests=6, forces_N=LEVELS, planes=("XY", "YZ"), seed=3)
    table = found.table()
    assert set(table["plane"]) == {"XY", "YZ"}
    assert set(table["setup"]) == {1, 2}
    assert {"C_ZZZ", "E_ZZ1"} < set(found.forecast.expected)
    planned = found.plan(seed=1)
    assert [test.plane for test in planned.tests] in (["XY"] * 3 + ["YZ"] * 3, ["YZ"] * 3 + ["XY"] * 3)
    bound = found.model.bind(planned)
    assert set(bound.names) == set(found.forecast.expected)
    for name, entry in found.forecast.expected.items():
        assert bound.prior_sd[bound.names.index(name)] == pytest.approx(entry.prior_sd)
    assert any("plane YZ" in sentence for sentence in found.sentences())
    assert found.as_dict()["tests"][0]["plane"] in ("XY", "YZ")


def test_only_the_other_plane_is_planned(pilot: lb.Campaign) -> None:
    found = lb.design(LINEAR, pilot, tests=4, forces_N=LEVELS, planes=("YZ",), parameters=["C_ZZZ"])
    assert {test.plane for test in found.tests} == {"YZ"}
    assert found.model.bind(found.plan()).names


def test_another_height_tells_rotations_apart(pilot: lb.Campaign) -> None:
    found = lb.design(LINEAR, pilot, tests=6, forces_N=LEVELS, centres_mm=((0.0, 0.0, 0.0), (0.0, 0.0, 300.0)))
    assert "C_AYY" in found.forecast.expected
    assert found.forecast.expected["C_AYY"].sd < 0.5 * found.forecast.expected["C_AYY"].prior_sd
    assert set(found.table()["centre_z_mm"]) == {0.0, 300.0}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"planes": ("XZ",)}, "plane must be one of XY, YZ, ZX"),
        ({"planes": "XY"}, "planes must be a sequence"),
        ({"directions": ("left",)}, "direction must be one of CW, CCW"),
        ({"centres_mm": ((1.0, 2.0),)}, "centres_mm must be triples"),
        ({"centres_mm": ((1.0, 2.0, float("nan")),)}, "finite centre_z_mm"),
    ],
)
def test_refused(pilot: lb.Campaign, options: dict, message: str) -> None:
    with pytest.raises(lb.InputError, match=message):
        lb.design(LINEAR, pilot, tests=4, forces_N=LEVELS, **options)


def test_a_pilot_that_does_not_state_its_direction() -> None:
    silent = simulated(plan(), seed=2)
    with pytest.raises(lb.InputError, match=r"'f036' must state its direction, CW or CCW, as circles of plane XY"):
        lb.design(LINEAR, silent, tests=4, forces_N=LEVELS, directions=("CW", "CCW"))
    assert {test.direction for test in lb.design(LINEAR, silent, tests=4, forces_N=LEVELS, directions=("CW",)).tests} == {"CW"}
    partly = replace(silent, tests=tuple(replace(t, direction="CW" if k else None) for k, t in enumerate(silent.tests)))
    assert lb.identify(LINEAR, partly).parameters


def test_another_centre_is_another_set_up(pilot: lb.Campaign) -> None:
    """Else the ball's displacement would measure the scale: with offsets of its own a second centre adds little to it."""
    found = lb.design(LINEAR, pilot, tests=6, forces_N=LEVELS, centres_mm=((0.0, 0.0, 0.0), (200.0, 0.0, 0.0)))
    assert {(test.centre_x_mm, test.setup) for test in found.tests} == {(0.0, 1), (200.0, 2)}
    one = lb.design(LINEAR, pilot, tests=6, forces_N=LEVELS)
    assert found.forecast.expected["E_XX1"].sd > 0.8 * one.forecast.expected["E_XX1"].sd
    order = [test.setup for test in found.plan(seed=4).tests]
    assert order in (sorted(order), sorted(order, reverse=True))


def test_set_ups_are_run_one_after_the_other() -> None:
    tests = [
        lb.CircularTest(force, np.arange(36) * 10.0, setup=setup, radius_mm=radius)
        for force in (100.0, 400.0, 700.0)
        for setup in (1, 2, 3)
        for radius in (100.0, 150.0)
    ]
    for seed in range(5):
        ordered = running_order(tests, np.random.default_rng(seed))
        places = [(test.setup, test.radius_mm) for test in ordered]
        assert len([k for k in range(1, len(places)) if places[k] != places[k - 1]]) == 5
        assert len([k for k in range(1, len(places)) if places[k][0] != places[k - 1][0]]) == 2


def test_what_is_only_judged_does_not_change_the_design(pilot: lb.Campaign) -> None:
    other = replace(pilot.plan(), tests=tuple(replace(test, direction="CCW") for test in pilot.plan().tests))
    alone = lb.design(LINEAR, pilot, tests=4, forces_N=LEVELS)
    beside = lb.design(LINEAR, pilot, tests=4, forces_N=LEVELS, against={"the other way": other})
    assert [t.force_N for t in alone.tests] == [t.force_N for t in beside.tests]
    for name, entry in alone.forecast.expected.items():
        assert beside.forecast.expected[name].sd == pytest.approx(entry.sd, rel=1e-9)
    elsewhere = replace(pilot.plan(), tests=tuple(replace(test, plane="YZ", setup=2) for test in pilot.plan().tests))
    judged = lb.design(LINEAR, pilot, tests=4, forces_N=LEVELS, against={"YZ": elsewhere}).others[0]
    assert judged.forecast.expected["C_XXX"].sd == pytest.approx(judged.forecast.expected["C_XXX"].prior_sd, rel=0.5)


def test_one_direction_is_analysed_as_one(pilot: lb.Campaign) -> None:
    """Only the other direction may be chosen, and the pilot's tests do not count as run: no hysteresis anywhere."""
    back = lb.design(LINEAR, pilot, tests=4, forces_N=LEVELS, directions=("CCW",))
    same = lb.design(LINEAR, pilot, tests=4, forces_N=LEVELS)
    for name, entry in same.forecast.expected.items():
        assert back.forecast.expected[name].sd == pytest.approx(entry.sd, rel=1e-6)
    more = lb.design(LINEAR, pilot, tests=4, forces_N=LEVELS, directions=("CCW",), augment=True)
    assert bind_tests(LINEAR, more.pilot, more.tests, keep=True).setting.both_ways == ("XY",)


def test_equal_steps_go_over_the_whole_range(pilot: lb.Campaign) -> None:
    levels = np.linspace(36.0, 742.0, 15)
    found = lb.design(LINEAR, pilot, tests=6, forces_N=levels, planes=("XY", "YZ"), directions=("CW", "CCW"))
    forces = [float(test.force_N or 0.0) for test in found.baseline.tests]
    assert (len(forces), min(forces), max(forces)) == (6, 36.0, 742.0)
    places = {(test.plane, test.direction) for test in found.baseline.tests}
    assert places == {(plane, way) for plane in ("XY", "YZ") for way in ("CW", "CCW")}


def test_overrides_and_fixed_parameters_of_other_planes(pilot: lb.Campaign) -> None:
    prior = replace(LINEAR.prior, overrides={"C_XXX": 1e-5, "C_ZZZ": 2e-5})
    model = replace(LINEAR, prior=prior, fixed=("C_CCY_1",))
    found = lb.design(model, pilot, tests=4, forces_N=(200.0, 300.0, 400.0), planes=("YZ",))
    bound = found.model.bind(found.plan())
    assert bound.prior_sd[bound.names.index("C_ZZZ")] == 2e-5
    assert "C_XXX" not in bound.names
    assert {"E_Yt0_2", "E_Zt0_2"} < set(bound.names) <= set(found.forecast.expected)


def test_a_plan_for_a_model_with_drift(pilot: lb.Campaign) -> None:
    timed = replace(pilot, tests=tuple(replace(t, time_s=600.0 * k, temperature_C=20.0 + k) for k, t in enumerate(pilot.tests)))
    found = lb.design(LINEAR.including(lb.Drift("time")), timed, tests=5, forces_N=LEVELS)
    assert [test.time_s for test in found.plan().tests] == [0.0, 600.0, 1200.0, 1800.0, 2400.0]
    assert lb.identify(found.model, found.plan()).parameters
    warm = lb.design(LINEAR.including(lb.Drift("temperature")), timed, tests=5, forces_N=LEVELS)
    assert {test.temperature_C for test in warm.plan().tests} == {21.5}


def test_a_design_of_one_direction_says_what_it_does_not_see(pilot: lb.Campaign) -> None:
    """Whichever direction it happens to be: hysteresis counts for circles all CW as for circles all CCW."""
    space = DesignSpace(LINEAR, pilot, LEVELS, directions=("CW", "CCW"))
    sd = {}
    for way in ("CW", "CCW"):
        alone = [test for test in space.tests if test.direction == way]
        assert bind_tests(LINEAR, space.pilot, alone, keep=False).setting.both_ways == ("XY",)
        sd[way] = space.forecast(alone).expected["C_XYX"].sd
        assert any("cannot show the hysteresis" in note for note in _limits(space, alone))
    assert sd["CW"] == pytest.approx(sd["CCW"], rel=1e-6)
    assert not any("cannot show the hysteresis" in note for note in _limits(space, space.tests))
    assert sd["CW"] > 1.5 * space.forecast(space.tests).expected["C_XYX"].sd
