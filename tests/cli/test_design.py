"""``ldbb-bayes design``: what it prints, what it writes, what it refuses."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from campaigns import plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.analysis import design as designing
from ldbb_bayes.cli.design import DESIGN_FILES
from ldbb_bayes.cli.main import app


def invoke(*arguments: object) -> int:
    with pytest.raises(SystemExit) as left:
        app([str(argument) for argument in arguments])
    return int(left.value.code or 0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return lb.write_campaign(simulated(plan(), seed=2), tmp_path_factory.mktemp("campaign") / "c")


def test_a_plan_that_others_read(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The written folder is a plan: identify asks it, simulate runs it, design judges it; an existing one is kept."""
    out = tmp_path / "next"
    arguments = ("design", folder, "--tests", 5, "--forces", "36:742:100", "--clockings", "0/0,45/90", "--robust")
    assert invoke(*arguments, "--against", f"own={folder}", "--json", "--out", out) == 0
    record = json.loads(capsys.readouterr().out)
    assert record == json.loads((out / "design.json").read_text())
    assert {path.name for path in out.iterdir()} == set(DESIGN_FILES)
    planned = lb.read_campaign(out)
    assert planned.is_plan
    listed = [(t["force_N"], t["work_ball_deg"], t["tool_ball_deg"]) for t in record["tests"] for _ in range(t["count"])]
    assert sorted(listed) == sorted((t.force_N, t.work_ball_deg, t.tool_ball_deg) for t in planned.tests)
    assert len(listed) == 5
    assert {force for force, *_ in listed} <= {*np.arange(36.0, 742.0, 100.0), 742.0}
    assert [entry["name"] for entry in record["compared"]] == ["equal steps", "own"]
    assert len(pd.read_csv(out / "expected.csv")) == 19
    assert len(pd.read_csv(out / "sensitivity.csv")) == 18
    assert set(pd.read_csv(out / "trade_off.csv")) >= {"tests", "cost", "efficiency", "efficiency_equal_steps", "sd_C_XXX"}
    assert "worst" in set(pd.read_csv(out / "robustness.csv"))
    assert invoke("identify", out, "--model", out / "model.toml", "--json") == 0
    assert json.loads(capsys.readouterr().out)["measured"] is False
    assert invoke("simulate", out, "--out", tmp_path / "run") == 0
    assert not lb.read_campaign(tmp_path / "run").is_plan
    capsys.readouterr()
    assert invoke("design", folder, "--tests", 5, "--against", f"plan={out}", "--json") == 0
    assert json.loads(capsys.readouterr().out)["compared"][1]["name"] == "plan"
    assert invoke(*arguments, "--out", out) == 2
    assert "must not exist" in capsys.readouterr().err


def test_what_it_says(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert invoke("design", folder, "--forces", "36,400,742", "--target", "C_XYX=1e-6", "--cost-circle", 10) == 0
    shown = " ".join(capsys.readouterr().out.split())
    for words in (
        "circles",
        "expected u",
        "recommended",
        "no less than",
        "Run ",
        "fewest found that reach u(C_XYX) ≤ 0.001 µm/N",
    ):
        assert words in shown
    assert invoke("design", folder, "--budget", 40, "--cost-circle", 10, "--forces", "36:742:353", "--criterion", "d") == 0
    assert "Run 4 circles" in " ".join(capsys.readouterr().out.split())
    assert invoke("design", folder, "--power", 0.5, "--slope-size", 3, "--parameters", "C_XXX_1", "--forces", "36:742:353") == 0
    assert "decisive evidence" in " ".join(capsys.readouterr().out.split())


def test_a_plan_of_a_table(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A tidy table as pilot, with its options; the paper's preset; added to what was run."""
    campaign = lb.read_campaign(folder)
    rows = [
        pd.DataFrame({"test": t.name, "force_N": t.force_N, "angle_deg": t.angle_deg, "reading_um": t.reading_um})
        for t in campaign.tests
    ]
    table = tmp_path / "tidy.csv"
    pd.concat(rows).to_csv(table, index=False)
    options = ("--radius-mm", 100, "--preset", "paper", "--augment", "--tests", 2, "--json")
    assert invoke("design", table, *options) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["criterion"] == "d"
    assert record["expected"]["C_XXX"]["prior_sd"] is None
    assert record["tests"][0]["radius_mm"] == 100.0


def test_exit_code_of_a_target_out_of_reach(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert invoke("design", folder, "--target", "E_C0YX=1e-9", "--forces", "36:742:353", "--json") == 1
    record = json.loads(capsys.readouterr().out)
    assert record["reached"] is False
    assert any("No number of these circles" in note for note in record["notes"])


def test_exit_code_without_certificate(folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    found = designing.design(lb.HybridModel.default(1), lb.read_campaign(folder), tests=3, forces_N=(36.0, 400.0, 742.0))
    broken = replace(found, certificate=replace(found.certificate, max_sensitivity=2.0 * found.certificate.bound))
    monkeypatch.setattr(designing, "design", lambda *_, **__: broken)
    assert invoke("design", folder) == 1
    assert "The certificate does NOT hold" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--tests", 0], "tests must be between 1 and 300, got 0"),
        (["--tests", 4, "--budget", 9], "must have one goal, got tests and budget"),
        (["--forces", "742:36:1"], "--forces must be LO:HI:STEP with LO ≤ HI and STEP > 0, or a list, got '742:36:1'"),
        (["--forces", "36:742"], "--forces must be LO:HI:STEP"),
        (["--forces", "36:742:1e-6"], "--forces must give at most 5000 values"),
        (["--forces", "36,x"], "--forces must be made of numbers, got 'x'"),
        (["--forces", "-5,100"], "forces must be > 0 N, got -5"),
        (["--clockings", "0/45/90"], "--clockings must be all angles of the work ball, or all WORK/TOOL, got '0/45/90'"),
        (["--clockings", "0,45/90"], "--clockings must be all angles of the work ball, or all WORK/TOOL, got '0,45/90'"),
        (["--target", "C_XYX=1e-6", "--target", "C_XYX=1e-7"], "--target must give each name once, got 'C_XYX' again"),
        (["--radii", "nan"], "--radii must be made of numbers, got 'nan'"),
        (["--criterion", "best"], "criterion must be one of eig, d, a, c, i, e, discriminate, got 'best'"),
        (["--parameters", "C_XYZ"], "parameter must be one of"),
        (["--target", "C_XYX"], "--target must be NAME=SD, got 'C_XYX'"),
        (["--target", "C_XYX=small"], "--target must be made of numbers, got 'small'"),
        (["--against", "nowhere"], "--against must be NAME=PATH, got 'nowhere'"),
        (["--against", "it=nowhere"], "nowhere, which does not exist"),
        (["--cost-circle", 0], "cost of circle must be a number ≥ 0, that of a circle > 0, got 0"),
        (["--power", 1.5], "power must lie between 0 and 1, got 1.5"),
        (["--threshold", -1], "threshold must be a positive number, got -1"),
        (["--degree", 0, "--criterion", "discriminate"], "criterion discriminate must be about slopes"),
    ],
)
def test_wrong_input(
    folder: Path, arguments: list[object], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert invoke("design", folder, *arguments, "--out", tmp_path / "out") == 2
    said = capsys.readouterr().err
    assert message in said
    assert said.count("\n") == 1
    assert not (tmp_path / "out").exists()
