"""Designs over planes, directions and centres: what is foreseen, what each adds, and what the plan says."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from campaigns import plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.analysis.design import design as designing
from ldbb_bayes.analysis.design import planning
from ldbb_bayes.analysis.design.candidates import bind_tests, foreseen_by, running_order, templates
from ldbb_bayes.analysis.design.design import _limits
from ldbb_bayes.analysis.design.planning import DesignSpace
from ldbb_bayes.report.wording import design_sentences

LINEAR = lb.HybridModel.default(1)
LEVELS = (36.0, 389.0, 742.0)


@pytest.fixture(autouse=True, scope="module")
def few_states() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(planning, "_REPORTED", 16)
        patch.setattr(designing, "_ALONE", 4)
        yield


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


def test_a_second_radius_against_one(pilot: lb.Campaign) -> None:
    two = lb.design(LINEAR, pilot, tests=6, forces_N=LEVELS, radii_mm=(150.0, 100.0), parameters=["E_C0YX"])
    one = lb.design(LINEAR, pilot, tests=6, forces_N=LEVELS, parameters=["E_C0YX"])
    assert {test.radius_mm for test in two.tests} == {150.0, 100.0}
    assert two.expected["E_C0YX"].sd < 0.8 * one.expected["E_C0YX"].sd
    # More circles of one radius would not help, more of two would.
    assert one.expected["E_C0YX"].floor_sd > 0.9 * one.expected["E_C0YX"].sd
    assert two.expected["E_C0YX"].floor_sd < 0.01 * two.expected["E_C0YX"].sd


def test_another_plane_is_planned(pilot: lb.Campaign) -> None:
    found = lb.design(LINEAR, pilot, tests=6, forces_N=LEVELS, planes=("XY", "YZ"), seed=3)
    table = found.table
    assert set(table["plane"]) == {"XY", "YZ"}
    assert set(table["setup"]) == {1, 2}
    assert {"C_ZZZ", "E_ZZ1"} < set(found.expected)
    planned = found.plan(seed=1)
    assert [test.plane for test in planned.tests] in (["XY"] * 3 + ["YZ"] * 3, ["YZ"] * 3 + ["XY"] * 3)
    bound = found.model.bind(planned)
    assert set(bound.names) == set(found.expected)
    for name, entry in found.expected.items():
        assert bound.prior_sd[bound.names.index(name)] == pytest.approx(entry.prior_sd)
    assert any("plane YZ" in sentence for sentence in design_sentences(found))
    assert found.as_dict()["tests"][0]["plane"] in ("XY", "YZ")


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


def test_overrides_and_fixed_parameters_of_other_planes(pilot: lb.Campaign) -> None:
    prior = replace(LINEAR.prior, overrides={"C_XXX": 1e-5, "C_ZZZ": 2e-5})
    model = replace(LINEAR, prior=prior, fixed=("C_CCY_1",))
    found = lb.design(model, pilot, tests=4, forces_N=(200.0, 300.0, 400.0), planes=("YZ",))
    bound = found.model.bind(found.plan())
    assert bound.prior_sd[bound.names.index("C_ZZZ")] == 2e-5
    assert "C_XXX" not in bound.names
    assert {"E_Yt0_2", "E_Zt0_2"} < set(bound.names) <= set(found.expected)


def test_a_design_of_one_direction_says_what_it_does_not_see(pilot: lb.Campaign) -> None:
    """Whichever direction it happens to be: hysteresis counts for circles all CW as for circles all CCW."""
    space = DesignSpace(LINEAR, pilot, LEVELS, directions=("CW", "CCW"))
    sd = {}
    for way in ("CW", "CCW"):
        alone = [test for test in space.tests if test.direction == way]
        assert bind_tests(LINEAR, space.pilot, alone, keep=False).setting.both_ways == ("XY",)
        sd[way] = space.forecast(alone).expected["C_XYX"].sd
        assert _limits(space, alone, space.forecast(alone)).one_way == {"XY": way}
    assert sd["CW"] == pytest.approx(sd["CCW"], rel=1e-6)
    assert not _limits(space, space.tests, space.forecast(space.tests)).one_way
    assert sd["CW"] > 1.5 * space.forecast(space.tests).expected["C_XYX"].sd
