"""Goals for uncertainties: texts with units, percentages, and messages for nonsense."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

import ldbb_bayes as lb
from ldbb_bayes.analysis.design import Goal, goals_in
from ldbb_bayes.errors import InputError

ANGLES = np.arange(0.0, 360.0, 10.0)
PLAN = lb.Plan([lb.CircularTest(force, ANGLES) for force in (36.0, 389.0, 742.0)])
BOUND = lb.HybridModel.default(1).bind(PLAN)


@pytest.mark.parametrize(
    ("name", "text", "absolute"),
    [
        ("C_XXX", "2nm/N", 2e-6),
        ("C_XXX", "2 µm/kN", 2e-6),
        ("C_XXX", "± 2 nm/N", 2e-6),
        ("C_XXX", "≤ 2 nm/N", 2e-6),
        ("E_C0YX", "10urad", 10e-6),
        ("E_XX1", "20 ppm", 20e-6),
        ("C_XXX_1", "3 nm/N per kN", 3e-9),
    ],
)
def test_a_text_with_a_unit_is_an_absolute_goal(name, text, absolute):
    goal = goals_in(BOUND, {name: text})[name]
    assert goal.absolute == pytest.approx(absolute, rel=1e-12)
    assert not goal.is_relative


@pytest.mark.parametrize("text", ["5%", "5 %", " 5.0 % ", "± 5 %", "50e-1%"])
def test_a_percentage_is_relative_to_the_value(text):
    goal = goals_in(BOUND, {"C_XXX": text})["C_XXX"]
    assert goal.share == 0.05
    np.testing.assert_allclose(goal.limit_U([6e-5, -4e-5]), [3e-6, 2e-6], rtol=1e-12)


def test_the_limit_of_u_is_half_of_that_of_the_expanded_uncertainty():
    goal = Goal("C_XXX", "mm/N", absolute=2e-6)
    np.testing.assert_array_equal(goal.limit_u([1e-5, 1e-4]), [1e-6, 1e-6])


def test_a_goal_in_percent_is_met_with_the_share_of_values_that_are_large_enough():
    """U = 4 nm/N is 10 % of 40 nm/N: of a normal N(40, 4²) one half lies above."""
    goal = Goal("C_XXX", "mm/N", share=0.1)
    draws = norm.ppf((np.arange(1000) + 0.5) / 1000, 40e-6, 4e-6)
    assert goal.probability_met(draws, 2e-6) == 0.5
    assert goal.probability_met(draws, 1.5e-6) == pytest.approx(norm.cdf(2.5), abs=1e-3)


def test_a_goal_is_met_at_its_limit_and_not_above():
    goal = Goal("C_XXX", "mm/N", absolute=2e-6)
    assert goal.is_met([6e-5, 6e-5], [1e-6, 1.001e-6]).tolist() == [True, False]


def test_the_printed_name_of_a_parameter_is_understood():
    assert list(goals_in(BOUND, {"E_C(0Y)X": "10 µrad"})) == ["E_C0YX"]


def test_a_number_is_in_internal_units():
    assert goals_in(BOUND, {"C_XXX": 2e-6})["C_XXX"].absolute == 2e-6


def test_a_goal_is_kept():
    goal = Goal("C_XXX", "mm/N", share=0.05)
    assert goals_in(BOUND, {"C_XXX": goal})["C_XXX"] is goal


def test_goals_keep_their_order():
    assert list(goals_in(BOUND, {"E_C0YX": "10 µrad", "C_XXX": "5%"})) == ["E_C0YX", "C_XXX"]


def test_a_goal_survives_json():
    goal = Goal("C_XXX", "mm/N", share=0.05)
    assert Goal.from_dict(goal.as_dict()) == goal


@pytest.mark.parametrize(
    ("goals", "message"),
    [
        ({"C_XXY": "5%"}, "goal must be one of .* Did you mean"),
        ({"squareness": "5 µrad"}, r"got 'squareness'\. Errors of squareness are E_C0YX\.$"),
        ({"Offset": "5 µm"}, r"got 'Offset'\. Errors of offset are E_Xt0, E_Yt0\.$"),
        ({"stiffness_X": "1 N/µm"}, r"goal must be one of .*, got 'stiffness_X'\.$"),
        ({"C_XXX": "10 µrad"}, "goal of C_XXX must be a number with its unit.*in nm/N"),
        (
            {"C_XXX": "5"},
            "got '5'. Write it in nm/N, .*Or write a percentage of the value, like 5 %.",
        ),
        ({"E_C0YX": "5"}, r"got '5'\. Write it in µrad, like 0\.5 µrad\.$"),
        ({"C_XXX": ""}, "goal of C_XXX must be a number with its unit"),
        ({"C_XXX": "-5 %"}, "goal of C_XXX must be an uncertainty above 0, got -5 %"),
        ({"C_XXX": "−2 nm/N"}, "goal of C_XXX must be an uncertainty above 0"),
        ({"C_XXX": "0 nm/N"}, "goal of C_XXX must be an uncertainty above 0"),
        ({"C_XXX": float("nan")}, "goal of C_XXX must be an uncertainty above 0"),
        ({"C_XXX": float("inf")}, "goal of C_XXX must be an uncertainty above 0"),
        ({"C_XXX": 13}, "goal of C_XXX must be smaller than U without any reading, got 13 mm/N"),
        (
            {"C_XXX": "1e99 nm/N"},
            "goal of C_XXX must be at most 1000 times U without any reading, got 1e99 nm/N.",
        ),
        ({"ΔC_XXX": "2 nm/N"}, "got the change ΔC_XXX. State it of the slope C_XXX_1"),
        ({"C_XXX": "120 %"}, "goal of C_XXX must be below 100 %"),
        ({"E_C0YX": "5 %"}, "E_C0YX may well be zero"),
        ({"C_XXX_1": "5 %"}, "C_XXX_1 may well be zero"),
        ({"C_XXX": True}, "goal of C_XXX must be a text with a unit"),
        ({"C_XXX": None}, "goal of C_XXX must be a text with a unit"),
        ({"E_C0YX": "10 µrad", "E_C(0Y)X": "20 µrad"}, "got two of E_C0YX"),
        ({"C_XXX": Goal("C_YYY", "mm/N", share=0.1)}, "got one of C_YYY"),
        ({}, "goals must be uncertainties U by name"),
        (["C_XXX=5%"], "goals must be uncertainties U by name"),
    ],
)
def test_a_goal_that_makes_no_sense_is_refused(goals, message):
    with pytest.raises(InputError, match=message):
        goals_in(BOUND, goals)
