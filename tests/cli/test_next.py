"""The command ``next``: which circle to run next, and whether to stop."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest
from campaigns import Invoke, plan, simulated

import ldbb_bayes as lb

GOAL = ("--goal", "C_XXX=40%")


def test_a_goal_that_is_met_stops_the_campaign(folder: Path, invoke: Invoke) -> None:
    stdout = invoke("next", folder, "--preset", "first", "--goal", "C_XXX=0.1mm/N")[1]
    assert stdout.startswith("Stop: after 4 circles every aim is reached")


def test_a_plan_after_the_last_circle_says_that_it_is_not_needed(
    folder: Path, tmp_path: Path, invoke: Invoke
) -> None:
    options = ("--preset", "first", "--goal", "C_XXX=0.1mm/N", "--out", tmp_path / "next")
    stdout = invoke("next", folder, *options)[1]
    assert "a plan of one more circle, if it is run all the same; sheet.html is" in stdout
    sheet = (tmp_path / "next" / "sheet.html").read_text(encoding="utf-8")
    assert "If one more circle is run all the same" in sheet
    invoke("next", folder, *options, "--force", "--language", "de")
    sheet = (tmp_path / "next" / "sheet.html").read_text(encoding="utf-8")
    assert "Wird trotzdem ein weiterer Kreis gefahren" in sheet


def test_the_next_circle_can_be_rehearsed(folder: Path, tmp_path: Path, invoke: Invoke) -> None:
    plan = tmp_path / "next"
    invoke("next", folder, "--preset", "first", *GOAL, "--out", plan)
    out = tmp_path / "rehearsal"
    code, stdout, stderr = invoke("simulate", plan, "--preset", "first", "--out", out)
    assert (code, stderr) == (0, "")
    assert "(1 test," in stdout
    assert not lb.read_campaign(out).is_plan


def test_goals_out_of_reach_are_named(folder: Path, invoke: Invoke) -> None:
    goals = ("--goal", "C_XXX=0.1mm/N", "--goal", "E_C0YX=0.1urad")
    # Where lines are broken depends on the numbers in them.
    text = " ".join(invoke("next", folder, "--preset", "first", *goals)[1].split())
    remaining = r"E_C\(0Y\)X is out of reach, however many are run: U of [\d.]+ µrad would remain"
    assert re.search(remaining + r", 0\.10 µrad is wanted\.", text)
    assert "C_XXX is out of reach" not in text


def test_a_goal_just_below_what_remains_reads_as_less_than_it(folder: Path, invoke: Invoke) -> None:
    options = ("next", folder, "--preset", "first", "--goal")
    record = json.loads(invoke(*options, "E_C0YX=0.1urad", "--json")[1])
    goal_urad = 0.98e6 * record["goals"]["E_C0YX"]["U_floor"]
    text = " ".join(invoke(*options, f"E_C0YX={goal_urad} urad")[1].split())
    pattern = r"U of ([\d.]+) µrad would remain, ([\d.]+) µrad is wanted"
    (numbers,) = re.findall(pattern, text)
    floor, wanted = map(float, numbers)
    assert floor > wanted
    just_below = json.loads(invoke(*options, f"E_C0YX={goal_urad} urad", "--json")[1])
    probability = just_below["goals"]["E_C0YX"]["probability_next"]
    assert probability > 0.05
    assert f"the next circle meets the goal with probability {probability:.2f}." in text


def test_the_aims_are_named(folder: Path, invoke: Invoke) -> None:
    of_model = "Aim, with probability 95 % or more: whether compliance is constant or linear"
    assert of_model in " ".join(invoke("next", folder, "--preset", "first")[1].split())
    options = ("--goal", "C_XXX=1%", "--goal", "E_C0YX=0.1urad", "--tolerance", "C_YYY=60 nm/N")
    stdout = invoke("next", folder, "--preset", "first", *options)[1]
    names = "U of C_XXX; U of E_C(0Y)X; conformity of C_YYY."
    assert f"Aims, with probability 95 % or more: {names}" in " ".join(stdout.split())


def test_a_goal_that_is_not_met_names_the_next_circle(folder: Path, invoke: Invoke) -> None:
    stdout = invoke("next", folder, "--preset", "first", "--goal", "C_XXX=11%")[1]
    assert stdout.startswith("Run next: ")


def test_a_goal_out_of_reach_is_said_first_and_the_best_circle_last(
    folder: Path, invoke: Invoke
) -> None:
    stdout = invoke("next", folder, "--preset", "first", "--goal", "E_C0YX=0.1urad")[1]
    assert stdout.startswith("Out of reach: U of E_C(0Y)X. Up to 40 more circles")
    assert "The circle that helps most: " in stdout
    assert "Run next" not in stdout


def test_of_several_aims_only_those_out_of_reach_are_named_first(
    folder: Path, invoke: Invoke
) -> None:
    goals = ("--goal", "C_XXX=90%", "--goal", "E_C0YX=0.1urad", "--tolerance", "C_XXX=1 µm/N")
    stdout = invoke("next", folder, "--preset", "first", *goals)[1]
    assert stdout.startswith("Out of reach: U of E_C(0Y)X. Up to 40 more circles")
    record = json.loads(invoke("next", folder, "--preset", "first", *goals, "--json")[1])
    assert record["unreached_goals"] == ["E_C0YX"]
    assert record["unreached_tolerances"] == []
    assert not record["model_is_unreached"]


def test_json_states_the_probability_that_a_goal_is_met(folder: Path, invoke: Invoke) -> None:
    record = json.loads(invoke("next", folder, "--preset", "first", *GOAL, "--json")[1])
    assert 0.0 <= record["goals"]["C_XXX"]["probability"] <= 1.0


def test_json_states_that_constant_or_linear_stands(folder: Path, invoke: Invoke) -> None:
    record = json.loads(invoke("next", folder, "--preset", "first", *GOAL, "--json")[1])
    assert 0.0 <= record["model"]["probability_linear"] <= 1.0


def test_json_states_a_decision_on_a_tolerance(folder: Path, invoke: Invoke) -> None:
    tolerance = ("--tolerance", "C_XXX=1 µm/N")
    record = json.loads(invoke("next", folder, "--preset", "first", *tolerance, "--json")[1])
    assert record["tolerances"]["C_XXX"]["now"]["decision"] == "conforms"


def test_the_numbers_are_those_of_python(folder: Path, invoke: Invoke) -> None:
    record = json.loads(invoke("next", folder, *GOAL, "--json")[1])
    step = lb.analysis.next_circle(
        lb.HybridModel.default(1), lb.read_campaign(folder), goals={"C_XXX": "40 %"}
    )
    assert record["goals"] == step.as_dict()["goals"]


def test_the_next_circle_is_written_as_a_plan(folder: Path, tmp_path: Path, invoke: Invoke) -> None:
    out = tmp_path / "next"
    invoke("next", folder, "--preset", "first", "--goal", "E_C0YX=0.1urad", "--out", out)
    plan = lb.read_campaign(out)
    assert len(plan.tests) == 1
    assert plan.adds_to_pilot


def test_the_operators_sheet_has_the_force_and_the_pressure(
    folder: Path, tmp_path: Path, invoke: Invoke
) -> None:
    out = tmp_path / "next"
    invoke("next", folder, "--preset", "first", "--goal", "E_C0YX=0.1urad", "--out", out)
    sheet = (out / "sheet.html").read_text(encoding="utf-8")
    test = lb.read_campaign(out).tests[0]
    assert f"<dd>{test.force_N:.4g} N</dd>" in sheet
    assert " bar</dd>" in sheet


@pytest.fixture(scope="module")
def clockwise(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign of two circles, which says that they ran clockwise."""
    campaign = simulated(plan((40, 40), forces_N=(36.0, 742.0)))
    tests = tuple(replace(test, direction="CW") for test in campaign.tests)
    folder = tmp_path_factory.mktemp("clockwise") / "c"
    return lb.write_campaign(replace(campaign, tests=tests), folder)


@pytest.mark.slow
def test_both_directions_are_candidates_and_are_named(
    clockwise: Path, tmp_path: Path, invoke: Invoke
) -> None:
    """As for design: the word both, hysteresis in the model, and the direction on the sheet."""
    options = (clockwise, "--goal", "C_XXX=1%", "--forces", "36,742", "--directions")
    stdout = invoke("next", *options, "both", "--out", tmp_path / "next")[1]
    lines = stdout.splitlines()
    direction = lb.read_campaign(tmp_path / "next").tests[0].direction
    assert f"(tool), {direction}." in " ".join(stdout.split())
    assert {"CW", "CCW"} <= {word for line in lines[-6:] for word in line.split()}
    sheet = (tmp_path / "next" / "sheet.html").read_text(encoding="utf-8")
    assert f"<dt>Direction</dt><dd>{direction}</dd>" in sheet
    record = json.loads(invoke("next", *options, "CCW,CW", "--json")[1])
    written = json.loads((tmp_path / "next" / "next.json").read_text(encoding="utf-8"))
    assert record["goals"] == written["goals"]
    step = lb.analysis.next_circle(
        lb.HybridModel.default(1),
        lb.read_campaign(clockwise),
        goals={"C_XXX": "1 %"},
        forces_N=(36.0, 742.0),
        directions=("CW", "CCW"),
    )
    assert record["goals"] == step.as_dict()["goals"]
    assert "eta" in step.chosen.space.bound.hyper_prior.names  # of hysteresis, if run both ways


def test_a_direction_that_was_not_run_yet_is_named(clockwise: Path, invoke: Invoke) -> None:
    options = ("--preset", "first", "--goal", "C_XXX=1%", "--forces", "742")
    stdout = invoke("next", clockwise, *options, "--directions", "ccw")[1]
    assert "(tool), CCW." in " ".join(stdout.split())


def test_the_direction_of_all_circles_is_named_too(clockwise: Path, invoke: Invoke) -> None:
    options = ("--preset", "first", "--goal", "C_XXX=1%", "--forces", "742")
    assert "(tool), CW." in " ".join(invoke("next", clockwise, *options)[1].split())


def test_both_directions_need_the_direction_of_the_circles_run(
    folder: Path, invoke: Invoke
) -> None:
    code, _, stderr = invoke("next", folder, *GOAL, "--directions", "both")
    assert code == 2
    assert "must state its direction, CW or CCW" in stderr


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--goal", "C_XXX"), "--goal must be NAME=U"),
        (("--goal", "C_XXX=5"), "goal of C_XXX must be a number with its unit"),
        (("--goal", "E_C0YX=5%"), "must be an uncertainty with its unit"),
        (("--language", "fr"), "language must be one of de, en, got 'fr'. Leave it out"),
        (("--degree", "0"), "must come with a goal or a tolerance, got neither"),
        (("--degree", "0", "--decide", *GOAL), "in the model for a decision, got constant ones"),
        (("--confidence", "1"), "confidence must lie between 0.5 and 1"),
        (("--forces", "0"), "forces must be finite and > 0"),
        (
            ("--clockings", "0/400"),
            "--clockings must hold angles between -360 and 360 degrees, got 400.",
        ),
        (
            ("--clockings=-361",),
            "--clockings must hold angles between -360 and 360 degrees, got -361.",
        ),
        (("--directions", "up"), "--directions must be one of CW, CCW, both, got 'up'."),
        (("--directions", ","), "--directions must name CW, CCW or both, got ','."),
    ],
)
def test_bad_options_are_refused(
    options: tuple[str, ...], message: str, folder: Path, invoke: Invoke
) -> None:
    code, stdout, stderr = invoke("next", folder, "--preset", "first", *options)
    assert code == 2
    assert message in stderr
    assert stdout == ""


def test_a_plan_is_refused(planned: Path, invoke: Invoke) -> None:
    code, _, stderr = invoke("next", planned)
    assert code == 2
    assert "must have readings, got a plan" in stderr


@pytest.mark.usefixtures("few_states")
@pytest.mark.parametrize(
    "options",
    [
        ("next", "--goal", "E_C0YX=0.1urad"),
        ("design", "--tests", 2, "--forces", "36,742"),
    ],
)
def test_force_replaces_a_plan_with_its_pilot(
    options: tuple[object, ...], folder: Path, tmp_path: Path, invoke: Invoke
) -> None:
    name, *more = options
    command = (name, folder, "--preset", "first", *more, "--out", tmp_path / "plan")
    first = invoke(*command)[0]
    assert (tmp_path / "plan" / "pilot").is_dir()
    again, _, stderr = invoke(*command, "--force")
    assert again == first, stderr


def test_force_keeps_a_folder_of_another_kind_called_pilot(
    folder: Path, tmp_path: Path, invoke: Invoke
) -> None:
    pilot_folder = tmp_path / "plan" / "pilot"
    pilot_folder.mkdir(parents=True)
    code, _, stderr = invoke("next", folder, *GOAL, "--out", tmp_path / "plan", "--force")
    assert code == 2, stderr
    assert pilot_folder.is_dir()
