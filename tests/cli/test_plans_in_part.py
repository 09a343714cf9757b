"""Plans of which some circles have been run, and the model that lies beside a plan."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from campaigns import Invoke, plan, simulated
from reports import plan_of_three_planes

import ldbb_bayes as lb
from ldbb_bayes.model.specification import model_to_toml

NOT_RUN = "1 more test has no readings yet and is left out, at 742 N. The 3 tests with readings"
MODEL = replace(lb.HybridModel.first(1), reference_force_N=500.0)


@pytest.fixture
def in_part(tmp_path: Path) -> Path:
    """A plan with its model, of which three of four circles have been run."""
    folder = lb.write_campaign(simulated(plan()), tmp_path / "plan")
    toml = folder / "campaign.toml"
    text = toml.read_text(encoding="utf-8")
    last = lb.read_campaign(folder).tests[-1].name
    toml.write_text(text.replace(f'file = "{last}.csv"\n', ""), encoding="utf-8")
    (folder / "model.toml").write_text(model_to_toml(MODEL), encoding="utf-8")
    return folder


@pytest.mark.parametrize("command", ["check", "identify", "fit", "next", "design"])
def test_circles_not_run_yet_are_left_out_and_it_is_said(
    command: str, in_part: Path, invoke: Invoke
) -> None:
    options = {
        "fit": ("--sampler", "independent"),
        "next": ("--goal", "C_XXX=0.1mm/N"),
        "design": ("--tests", 2, "--forces", "36,742"),
    }
    code, stdout, stderr = invoke(command, in_part, *options.get(command, ()))
    assert code == 0, stderr
    assert NOT_RUN in " ".join(stdout.split())


def test_a_fit_uses_the_model_beside_the_plan(
    in_part: Path, tmp_path: Path, invoke: Invoke
) -> None:
    result = tmp_path / "result"
    _, _, stderr = invoke("fit", in_part, "--sampler", "independent", "--out", result)
    assert f"The model is that of {in_part}/model.toml" in stderr
    assert lb.read_model(result / "model.toml") == MODEL


@pytest.mark.slow
def test_options_win_over_the_model_beside_the_plan(in_part: Path, invoke: Invoke) -> None:
    options = ("identify", in_part, "--json")
    by_file_of_plan = json.loads(invoke(*options)[1])
    by_option = json.loads(invoke(*options, "--model", in_part / "model.toml")[1])
    assert by_file_of_plan == by_option
    code, stdout, stderr = invoke(*options, "--preset", "first")
    assert (code, stderr) == (0, "")
    assert json.loads(stdout)["parameters"] != by_file_of_plan["parameters"]
    constant = json.loads(invoke(*options, "--degree", 0)[1])
    assert constant["degree"] == 0


def test_check_states_the_reference_force_of_the_model(in_part: Path, invoke: Invoke) -> None:
    stdout = " ".join(invoke("check", in_part)[1].split())
    assert "F0 = 500 N and the priors are those of model.toml" in stdout
    assert "the middle of the tested range" not in stdout


def test_a_rehearsal_has_the_model_of_the_plan(
    in_part: Path, tmp_path: Path, invoke: Invoke
) -> None:
    rehearsal = tmp_path / "rehearsal"
    for _ in range(2):
        code, _, stderr = invoke("simulate", in_part, "--out", rehearsal, "--force")
        assert code == 0, stderr
    assert lb.read_model(rehearsal / "model.toml") == MODEL


def test_a_model_beside_other_files_is_not_used(
    in_part: Path, tmp_path: Path, invoke: Invoke
) -> None:
    """Only one campaign folder, or its campaign.toml, is taken for a plan."""
    assert "model.toml" in invoke("identify", in_part / "campaign.toml")[2]
    tables = sorted(in_part.glob("*.csv"))
    assert (
        "The model is that of" not in invoke("identify", *tables, "--forces", "36,300,520,742")[2]
    )


@pytest.mark.slow
def test_a_batch_uses_the_model_that_every_campaign_has(
    in_part: Path, folder: Path, tmp_path: Path, invoke: Invoke
) -> None:
    shared = (in_part / "model.toml").read_bytes()
    other = shutil.copytree(folder, tmp_path / "other")
    options = ("--ess", 100, "--no-compare", "--force", "--out", tmp_path / "fitted")
    stderr = invoke("batch", in_part, other, *options)[2]
    assert f"1 of 2 have a model.toml beside them, such as {in_part}/model.toml" in stderr
    (other / "model.toml").write_bytes(shared)
    stderr = invoke("batch", in_part, other, *options)[2]
    assert f"The model is that of {in_part}/model.toml" in stderr
    rows = lb.fleet.read_batch(tmp_path / "fitted")
    assert set(rows["reference_force_N"]) == {500.0}
    assert "model.toml" not in invoke("batch", in_part, other, "--preset", "first", *options)[2]


@pytest.mark.parametrize("command", ["fit", "compare", "next"])
def test_a_plan_without_readings_is_named(command: str, planned: Path, invoke: Invoke) -> None:
    code, stdout, stderr = invoke(command, planned)
    assert (code, stdout) == (2, "")
    assert f"{planned} must have readings, got a plan" in stderr


@pytest.mark.parametrize("flag", ["--ci", "--probability"])
def test_a_probability_in_per_cent_is_refused(flag: str, in_part: Path, invoke: Invoke) -> None:
    command = ("fit",) if flag == "--ci" else ("design", "--goal", "C_XXX=5%")
    code, _, stderr = invoke(*command, in_part, flag, 95)
    assert code == 2
    assert f"{flag} must be a number between 0 and 1, got 95.0. For 95 % give 0.95." in stderr


def test_a_design_to_judge_that_does_not_exist_is_named(in_part: Path, invoke: Invoke) -> None:
    code, _, stderr = invoke("design", in_part, "--against", "old=nowhere")
    assert code == 2
    assert "--against old: " in stderr


def test_goals_out_of_reach_exit_with_1(folder: Path, invoke: Invoke) -> None:
    options = ("next", folder, "--preset", "first", "--goal")
    assert invoke(*options, "E_C0YX=0.1urad")[0] == 1
    assert invoke(*options, "C_XXX=0.1mm/N")[0] == 0


def test_check_states_what_the_model_beside_the_plan_assumes(in_part: Path, invoke: Invoke) -> None:
    model = lb.HybridModel.default(1).with_term(lb.terms.Mount(relative_sd=0.02, curvature_um=0.0))
    (in_part / "model.toml").write_text(model_to_toml(model), encoding="utf-8")
    record = json.loads(invoke("check", in_part, "--json")[1])
    mount = {entry["name"]: entry for entry in record["uncertainties"]}
    assert mount["mount"]["sd"] == pytest.approx(0.02 * 2.33e-3)
    assert "mount_curvature" not in mount


def test_check_follows_the_terms_of_the_model_beside_the_plan(
    tmp_path: Path, invoke: Invoke
) -> None:
    """What the model leaves out is named and not called a term of it."""
    tests = plan().tests
    both_ways = [
        replace(test, direction=("CW", "CCW")[index % 2]) for index, test in enumerate(tests)
    ]
    folder = lb.write_campaign(replace(plan(), tests=tuple(both_ways)), tmp_path / "plan")
    hysteresis = "hysteresis is a term of the model"
    assert hysteresis in invoke("check", folder)[1]
    (folder / "model.toml").write_text("schema = 1\n", encoding="utf-8")
    words = " ".join(invoke("check", folder)[1].split())
    assert hysteresis in words
    assert "Not modelled" not in words
    (folder / "model.toml").write_text("schema = 1\n[terms.BarLength]\n", encoding="utf-8")
    words = " ".join(invoke("check", folder)[1].split())
    assert hysteresis not in words
    assert "Drift of bar and centre follows" not in words
    left_out = [term.words for term in lb.HybridModel.default().without("bar-length").nuisances]
    assert f"Not modelled: {', '.join(left_out)}. The default model has these effects" in words


def test_no_stiffness_is_stated_of_a_plane_that_has_not_been_run(tmp_path: Path) -> None:
    """A plan of two planes of which one has been run has the parameters of both."""
    planned = plan_of_three_planes()
    run = planned.select([test.name for test in planned.tests if test.plane == "XY"])
    tests_in_yz = tuple(test for test in planned.tests if test.plane == "YZ")
    campaign = replace(simulated(run), foreseen=tests_in_yz)
    rule = lb.inference.StoppingRule(ess=300.0)
    posterior = lb.sample(MODEL, campaign, sampler="independent", rule=rule)
    assert "C_ZZZ" in posterior["posterior"]
    assert {plane.plane for plane in lb.stiffness(posterior).planes} == {"XY"}
    wide = {"C_ZZZ": "1 mm/N", "stiffness_Z": "1 N/mm", "C_XXX": "1 mm/N"}
    decisions = lb.assess_conformity(posterior, wide)
    decided = {name: decision.decision.value for name, decision in decisions.items()}
    assert decided == {"C_ZZZ": "not decided", "stiffness_Z": "not decided", "C_XXX": "conforms"}
    table = lb.analysis.predict_circularity(posterior, [300.0], draws=100)
    assert set(table["plane"]) == {"XY"}


def test_check_is_content_with_the_first_circle_of_a_plan(in_part: Path, invoke: Invoke) -> None:
    toml = in_part / "campaign.toml"
    text = toml.read_text(encoding="utf-8")
    for test in lb.read_campaign(in_part).tests[1:]:
        text = text.replace(f'file = "{test.name}.csv"\n', "")
    toml.write_text(text, encoding="utf-8")
    code, stdout, stderr = invoke("check", in_part)
    assert code == 0, stderr
    assert "F0 = 500 N" in stdout
