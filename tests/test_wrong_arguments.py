"""What Python is given in the wrong place is refused by name, with what belongs there."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import xarray as xr
from campaigns import refuses

import ldbb_bayes as lb
from ldbb_bayes.errors import suggestion

MODEL = lb.HybridModel.first(0)


@pytest.fixture(scope="module")
def posterior(recovered: lb.Campaign) -> xr.DataTree:
    return lb.sample(MODEL, recovered, sampler="independent", seed=1)


@pytest.mark.parametrize(
    "function",
    [
        lb.summarize,
        lb.to_units,
        lb.assess_conformity,
        lb.analysis.budget_uncertainty,
        lb.analysis.judge_posterior,
        lb.analysis.validate_gum,
        lb.figures.traces,
        lambda posterior: lb.write_report(posterior, "report"),
    ],
)
def test_a_campaign_is_no_posterior(function: Callable[[Any], Any], recovered: lb.Campaign) -> None:
    refuses("posterior must be a DataTree, got Campaign. Pass what lb.sample", function, recovered)


@pytest.mark.parametrize("function", [lb.compare, lb.average, lb.find_outlying_tests])
def test_models_have_names(function: Callable[..., Any], recovered: lb.Campaign) -> None:
    refuses("models must be HybridModels by name, .*got list", function, [MODEL], recovered)
    refuses("models must be given, got none", function, {}, recovered)


def test_a_bar_does_not_push(posterior: xr.DataTree) -> None:
    refuses("must not be negative, got -5", lb.analysis.predict_circularity, posterior, [-5.0])
    refuses("must not be negative, got -3", lb.analysis.decompose_deviation, posterior, -3.0)


@pytest.mark.parametrize("forces_N", ["300", None, [None], [[300.0]], [[3.0], [1.0, 2.0]]])
def test_forces_are_numbers(posterior: xr.DataTree, forces_N: Any) -> None:
    """The text 300 would be read as 3, 0 and 0 N."""
    for function in (lb.analysis.predict_circularity, lb.stiffness):
        refuses("forces_N must be a list of numbers", function, posterior, forces_N)


@pytest.mark.parametrize("function", [lb.analysis.predict_circularity, lb.stiffness])
def test_one_force_may_be_a_number(
    function: Callable[[xr.DataTree, Any], Any], posterior: xr.DataTree
) -> None:
    assert str(function(posterior, 300)) == str(function(posterior, [300.0]))


@pytest.mark.parametrize(
    "function",
    [lb.analysis.predict_circularity, lb.analysis.decompose_deviation, lb.stiffness],
)
def test_a_force_far_above_the_tested_ones_is_refused(
    function: Callable[[xr.DataTree, float], Any], posterior: xr.DataTree
) -> None:
    refuses("must be a force from .* to 1113 N, for .*, got 5000", function, posterior, 5000.0)


def test_a_circle_far_from_the_tested_forces_is_not_predicted(posterior: xr.DataTree) -> None:
    circle = lb.CircularTest(5000.0, range(0, 360, 30), direction="CW")
    message = "force_N of test 'f5000' must be a force from 3.6 to 1113 N, for .*, got 5000"
    refuses(message, lb.predict, posterior, lb.Plan((circle,)))


def test_at_a_small_force_stiffness_is_refused_and_a_path_is_not(posterior: xr.DataTree) -> None:
    refuses("must be a force from 3.6 to 1113 N", lb.stiffness, posterior, [1.0])
    assert len(lb.analysis.predict_circularity(posterior, [1.0]))


def test_a_plan_has_no_circularity(recovered: lb.Campaign) -> None:
    refuses("must have readings", lb.analysis.measure_circularity, recovered.plan())


@pytest.mark.parametrize(
    "function",
    [
        lb.identify,
        lb.log_evidence,
        lb.log_density,
        lb.sample,
        lb.design,
        lb.local_fits,
        lb.inference.marginalize,
        lb.calibrate,
    ],
)
def test_the_model_comes_first(function: Callable[..., Any], recovered: lb.Campaign) -> None:
    refuses("model must be a HybridModel, got Campaign.*comes first", function, recovered, MODEL)


@pytest.mark.parametrize("prob", ["95%", 95, float("nan"), None])
def test_a_probability_is_a_number_between_0_and_1(posterior: xr.DataTree, prob: Any) -> None:
    refuses("prob must be a number between 0 and 1, got", lb.summarize, posterior, prob=prob)


@pytest.mark.parametrize("tests", ["six", 2.5])
def test_tests_are_counted_in_whole_numbers(recovered: lb.Campaign, tests: Any) -> None:
    refuses("tests must be a whole number, got", lb.design, MODEL, recovered, tests=tests)


@pytest.mark.parametrize("seed", ["a", -1, 1.5])
def test_a_seed_is_a_whole_number(recovered: lb.Campaign, seed: Any) -> None:
    refuses("seed must be a whole number", lb.sample, MODEL, recovered, seed=seed)
    refuses("seed must be a whole number", lb.design, MODEL, recovered, seed=seed)
    refuses("seed must be a whole number", MODEL.simulate, recovered, seed=seed)


def test_emcee_is_in_the_joint_sampler(recovered: lb.Campaign) -> None:
    refuses("emcee draws in sampler='joint'", lb.sample, MODEL, recovered, sampler="emcee", seed=1)


def test_tolerances_are_texts_with_a_unit_by_name(posterior: xr.DataTree) -> None:
    refuses("tolerances must be texts or Tolerances by name", lb.assess_conformity, posterior, "5")
    refuses("must be a text with a unit", lb.assess_conformity, posterior, {"C_XXX": 3})


@pytest.mark.parametrize("read", [lb.read_campaign, lb.load])
def test_a_path_is_a_text(read: Callable[[Any], Any]) -> None:
    refuses("path must be the name of a f.*, got 3", read, 3)


@pytest.mark.parametrize("tests", ["folder", 3, None])
def test_a_campaign_is_made_of_a_list_of_tests(tests: Any) -> None:
    message = rf"campaign: tests must be a list, got {tests!r}\..* lb\.read_campaign\("
    refuses(message, lb.Campaign, tests)


def test_an_existing_folder_is_replaced_by_an_argument(
    tmp_path: Path, recovered: lb.Campaign
) -> None:
    refuses(r"replace it: force=True \(--force\)", lb.write_campaign, recovered, tmp_path)


def test_readings_are_numbers() -> None:
    refuses("must have reading_um made of numbers", lb.CircularTest, 100.0, reading_um=["a"])


def test_force_levels_are_numbers(recovered: lb.Campaign) -> None:
    refuses("forces_N must be a list of numbers", lb.design, MODEL, recovered, forces_N="abc")


@pytest.mark.parametrize(
    ("name", "answer"),
    [
        ("C_QQQ", ""),
        ("E_Q", ""),
        ("C_XXXX", " Did you mean 'C_XXX'?"),
        ("C_XCC", " Did you mean 'C_CCY'?"),
        ("cxxx", " Did you mean 'C_XXX'?"),
    ],
)
def test_nothing_is_suggested_where_only_the_kind_is_the_same(name: str, answer: str) -> None:
    """All compliances begin with C_, and all geometric errors with E_."""
    assert suggestion(name, ["C_XXX", "C_CCY", "E_XX1", "E_C0YX"]) == answer


def test_a_misspelt_name_gets_the_nearest() -> None:
    with pytest.raises(AttributeError, match="Did you mean 'read_campaign'"):
        lb.read_campaing  # noqa: B018
    with pytest.raises(AttributeError, match="has no attribute 'xyz'"):
        lb.xyz  # noqa: B018


def test_the_nearest_name_is_asked_for_once() -> None:
    """Python adds a question of its own where it prints an error on an attribute of a module."""
    command = [sys.executable, "-c", "import ldbb_bayes as lb; lb.read_campaing"]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.stderr.count("Did you mean") == 1
    assert ended.stderr.endswith("Did you mean 'read_campaign'?\n")


@pytest.mark.parametrize(
    ("name", "answer"),
    [
        ("PitchError", ""),
        ("ForcError", " Did you mean 'ForceError'?"),
        ("forceerror", " Did you mean 'ForceError'?"),
        ("ForceErrors", " Did you mean 'ForceError'?"),
        ("BallForms", " Did you mean 'BallForm'?"),
        ("Mont", " Did you mean 'Mount'?"),
    ],
)
def test_a_shared_last_word_alone_suggests_nothing(name: str, answer: str) -> None:
    assert suggestion(name, ["BallForm", "Mount", "ForceError", "Drift"]) == answer
