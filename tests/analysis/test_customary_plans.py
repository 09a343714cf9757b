"""Campaigns as they are run today, of one plane and of several."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

import ldbb_bayes as lb
from ldbb_bayes.analysis.design.candidates import templates
from ldbb_bayes.analysis.design.customary_plans import equal_steps, published_forces
from ldbb_bayes.report.passage_translation import untranslated_texts
from ldbb_bayes.results import parts_of, text_of

ANGLE = np.arange(0.0, 360.0, 15.0)
GOALS = {"E_C0XY": "45 µrad", "E_A0YZ": "45 µrad"}


def pilot_of(*planes: str) -> lb.Campaign:
    tests = []
    for setup, plane in enumerate(planes, start=1):
        for force_N in (100.0, 600.0):
            test = lb.CircularTest(force_N, ANGLE, direction="CCW", plane=plane, setup=setup)
            tests.append(replace(test, tool_ball_deg=90.0))
    return lb.Campaign(tuple(tests), topology="wXFYZSt")


def forces_in(tests: tuple[lb.CircularTest, ...], plane: str) -> list[float]:
    return [float(test.force_N or 0.0) for test in tests if test.plane == plane]


def test_equal_steps_are_shared_over_the_planes() -> None:
    in_planes = templates(pilot_of("XY", "YZ"), ("CW", "CCW"))
    tests = equal_steps(in_planes, 100.0, 600.0, 7)
    assert forces_in(tests, "XY") == pytest.approx([100.0, 100.0 + 500.0 / 3.0, 1300.0 / 3.0, 600])
    assert forces_in(tests, "YZ") == [100.0, 350.0, 600.0]
    assert [test.direction for test in tests] == ["CW", "CCW", "CW", "CCW", "CW", "CCW", "CW"]
    assert {(test.plane, test.setup) for test in tests} == {("XY", 1), ("YZ", 2)}
    assert {test.tool_ball_deg for test in tests} == {0.0}


def test_a_plane_of_several_has_two_circles_at_least() -> None:
    in_planes = templates(pilot_of("XY", "YZ", "ZX"), ("CCW",))
    tests = equal_steps(in_planes, 100.0, 600.0, 4)
    assert Counter(test.plane for test in tests) == {"XY": 2, "YZ": 2, "ZX": 2}
    in_one_plane = equal_steps(in_planes[:1], 100.0, 600.0, 1)
    assert [test.force_N for test in in_one_plane] == [100.0]


def test_the_published_forces_are_run_in_every_plane() -> None:
    tests = published_forces(templates(pilot_of("XY", "YZ"), ("CW", "CCW")), 36.0, 742.0)
    for plane in ("XY", "YZ"):
        assert forces_in(tests, plane) == [36.0, 112.0, 238.0, 364.0, 490.0, 616.0, 742.0]


@pytest.mark.slow
@pytest.mark.usefixtures("few_states")
def test_what_is_done_today_is_run_in_the_planes_of_the_cheapest_campaign() -> None:
    """A third plane, which no goal needs, has no circles; U of neither goal is the prior's."""
    design = lb.design(
        lb.HybridModel.default(1),
        pilot_of("XY", "YZ", "ZX"),
        goals=GOALS,
        forces_N=(100.0, 600.0),
        directions=("CW", "CCW"),
    )
    assert {test.plane for test in design.plan().tests} == {"XY", "YZ"}
    for compared in design.customary:
        customary = compared.customary
        assert {test.plane for test in customary.plan().tests} == {"XY", "YZ"}
        assert customary.circles == compared.ours.circles
        for name in GOALS:
            assert customary.goals[name].U < 0.9 * design.goals[name].U
    assert design.customary[1].customary.circles == 14
    assert "each plane of the cheapest campaign (XY, YZ): equal steps" in " ".join(
        text_of(design).split()
    )
    assert untranslated_texts(parts_of(design), "de", [design.pilot]) == set()
