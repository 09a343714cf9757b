"""``ldbb-bayes compare``: what it prints, what it writes, what it refuses."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest
from campaigns import plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.analysis import comparison
from ldbb_bayes.analysis.compared import Comparison
from ldbb_bayes.cli.compare import COMPARE_FILES
from ldbb_bayes.cli.main import app
from ldbb_bayes.model.spec import model_to_toml


def invoke(*arguments: object) -> int:
    with pytest.raises(SystemExit) as left:
        app([str(argument) for argument in arguments])
    return int(left.value.code or 0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    campaign = simulated(plan((30, 30, 30), forces_N=(36.0, 400.0, 742.0)), seed=1)
    return lb.write_campaign(campaign, tmp_path_factory.mktemp("campaign") / "c")


def test_json_and_files(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Another model beside, everything written, and an existing result kept."""
    out, other = tmp_path / "out", tmp_path / "own.toml"
    slopes = (f"{name}_1" for name in ("C_XXX", "C_YYY", "C_CXY", "C_CYY", "C_CCY"))
    other.write_text(model_to_toml(lb.HybridModel.default(1).fixing(*slopes)))
    assert invoke("compare", folder, "--also", f"one slope={other}", "--json", "--out", out, "--seed", 2) == 0
    record = json.loads(capsys.readouterr().out)
    assert set(record["models"]) == {"constant", "linear", "one slope"}
    assert set(record["log_bayes_factor"]) == {"linear/constant", "one slope/constant"}
    assert set(record["savage_dickey"]) == {"linear/constant", "one slope/constant"}
    for ratio, second in record["savage_dickey"].items():
        assert second["log_bayes_factor"] == pytest.approx(record["log_bayes_factor"][ratio], abs=0.05)
    assert (record["seed"], record["sensitivity_of"]) == (2, "linear/constant")
    assert sorted(path.name for path in out.iterdir()) == sorted(COMPARE_FILES)
    assert json.loads((out / "comparison.json").read_text()) == record
    tests = pd.read_csv(out / "tests.csv")
    assert set(tests["model"]) == set(record["models"])
    local = pd.read_csv(out / "local_fits.csv")
    assert len(local) == 2 * 13
    assert len(pd.read_csv(out / "slope_subsets.csv")) == 64
    assert invoke("compare", folder, "--out", out) == 2
    assert "must not exist" in capsys.readouterr().err


def test_a_table_and_what_it_does_not_say(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A tidy table takes options for what campaign.toml would say, and its results follow them."""
    campaign = lb.read_campaign(folder)
    rows = [
        pd.DataFrame({"test": t.name, "force_N": t.force_N, "angle_deg": t.angle_deg, "reading_um": t.reading_um})
        for t in campaign.tests
    ]
    table = tmp_path / "tidy.csv"
    pd.concat(rows).to_csv(table, index=False)
    found = []
    for radius in (150.0, 100.0):
        assert invoke("compare", table, "--radius-mm", radius, "--json", "--tolerance", 0.1, "--without", "truncation") == 0
        found.append(json.loads(capsys.readouterr().out)["log_bayes_factor"]["linear/constant"])
    assert abs(found[0] - found[1]) > 0.05
    assert invoke("compare", folder, "--radius-mm", 100) == 2
    assert "--radius-mm must come with a tidy CSV" in capsys.readouterr().err


def test_what_it_says(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert invoke("compare", folder, "--without", "truncation,force-error", "--tolerance", 0.05) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "ln B(linear/constant) =" in shown
    assert "with truncation" in shown
    assert "with force error" in shown
    assert "White noise alone" in shown
    assert "Slopes one by one" in shown


def test_exit_code_of_a_missed_tolerance(
    folder: Path, compared: Comparison, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(comparison, "compare", lambda *_, **__: replace(compared, largest_error=1.0))
    assert invoke("compare", folder, "--json") == 1
    assert json.loads(capsys.readouterr().out)["largest_error"] == 1.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--degree", 0], "compare must have a degree of at least 1, got 0"),
        (["--preset", "paper"], "must have a proper prior to have an evidence"),
        (["--leave-out", "reading"], "not independent facts"),
        (["--leave-out", "circle"], "leave_out must be 'test', got 'circle': every test is left out in turn"),
        (["--tolerance", "inf"], "tolerance must lie between"),
        (["--tolerance", -1], "tolerance must lie between 0.0001 and 1 nats"),
        (["--ci", 2], "ci_prob must lie between 0 and 1"),
        (["--also", "nothing"], "--also must be NAME=FILE.toml, got 'nothing'"),
        (["--also", "mine=nowhere.toml"], "nowhere.toml must be a readable TOML file"),
        (["--also", "linear=x.toml"], "--also must give a new name, got 'linear' again"),
        (["--without", "balls"], "must be one of"),
    ],
)
def test_wrong_input(folder: Path, arguments: list[object], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert invoke("compare", folder, *arguments) == 2
    assert message in capsys.readouterr().err


def test_plans_and_single_forces_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    planned = lb.write_campaign(plan(), tmp_path / "plan")
    assert invoke("compare", planned) == 2
    assert "got a plan" in capsys.readouterr().err
    single = lb.write_campaign(simulated(plan()).select(["f300"]), tmp_path / "single")
    assert invoke("compare", single) == 2
    assert "at least two force levels" in capsys.readouterr().err
