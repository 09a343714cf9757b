"""Further tests that would separate degeneracies, found by trying them."""

from __future__ import annotations

from dataclasses import replace

import pytest
from campaigns import clocked, plan

import ldbb_bayes as lb
from ldbb_bayes.analysis.aliases import degeneracies
from ldbb_bayes.analysis.cures import at_other_radius, cures
from ldbb_bayes.report.wording import cure_words


def cures_by_name(campaign: lb.Campaign, degree: int) -> dict[str, str]:
    """Return cures in words by nuisance, or by parameters where there is none."""
    bound = lb.HybridModel.first(degree).bind(campaign)
    combinations = degeneracies(bound)
    sentences = {}
    for degeneracy, helpful in zip(combinations, cures(bound, combinations), strict=True):
        name = "+".join(degeneracy.parameters)
        if degeneracy.term:
            name = degeneracy.nuisances[0]
        sentences[name] = cure_words(degeneracy, helpful)
    return sentences


def test_one_set_up_of_both_balls() -> None:
    sentences = cures_by_name(clocked(((0.0, 0.0),)), 1)
    assert (
        sentences["form_cos2"]
        == "Clocking both balls (0/45/90°), a second radius or a calibration of the balls' form."
    )
    assert sentences["bar_length"] == "A calibration of the bar's length."
    assert sentences["mount"] == "A measurement of the mount's deflection."


def test_a_ball_that_was_never_turned_is_to_be_clocked() -> None:
    sentences = cures_by_name(clocked(((0.0, 0.0), (45.0, 0.0), (90.0, 0.0))), 1)
    assert sentences["tool_form_cos2"].startswith("Clocking the tool ball (0/45/90°)")


def test_one_force_needs_other_levels() -> None:
    sentences = cures_by_name(plan((40,), forces_N=(300.0,)), 0)
    assert sentences["form_cos4"].startswith("Other force levels")
    assert "force levels" not in sentences["form_cos2"]


def test_forces_that_hardly_differ_need_other_levels() -> None:
    sentences = cures_by_name(plan((40, 40), forces_N=(390.0, 390.1)), 0)
    assert "Other force levels" in sentences["C_XXX+E_XX1"]


@pytest.mark.parametrize(
    ("radii_mm", "other_mm"),
    [((150.0, 150.0), 100.0), ((150.0, 100.0), 200.0 / 3.0), ((100.0, 150.0), 200.0 / 3.0)],
)
def test_another_radius_is_one_that_the_plan_does_not_have(
    radii_mm: tuple[float, ...], other_mm: float
) -> None:
    one_radius = plan((40, 40), forces_N=(100.0, 300.0))
    tests = []
    for test, radius in zip(one_radius.tests, radii_mm, strict=True):
        tests.append(replace(test, radius_mm=radius))
    further = at_other_radius(replace(one_radius, tests=tuple(tests)))
    assert [test.radius_mm for test in further] == pytest.approx([other_mm, other_mm])
