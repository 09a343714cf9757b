"""``batch``, ``trend``, ``population`` on simulated campaigns: files, exit codes, an interruption
resumed, what is refused.

What they answer is held by the goldens of their names.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from batches import CONSTANT, made_row
from campaigns import TRUTH, Invoke, plan, refuses
from fleets import drawn_rows
from typer.testing import CliRunner

import ldbb_bayes as lb
from ldbb_bayes.cli import app
from ldbb_bayes.cli.fleets import _batch_parts
from ldbb_bayes.fleet.campaign_row import Job, Settings
from ldbb_bayes.fleet.population_prior import digest_of

pytest.importorskip("pyarrow")
MODEL = (
    "--degree",
    0,
    "--without",
    "hysteresis,discrepancy,setup-shift",
    "--ess",
    1500,
    "--no-compare",
    "--quiet",
)
MEAN = 5e-5
SPREAD = 4e-6
STIFF = 1.2e-4


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Any]:
    """Six machines, the first of another kind and the last measured twice; one campaign names no
    machine, one is not there."""
    folder = tmp_path_factory.mktemp("shop")
    rng = np.random.default_rng(1)
    truths = [STIFF, *(MEAN + SPREAD * rng.standard_normal(5))]
    for k in range(7):
        machine = min(k, 5)
        planned = plan((60,) * 3, forces_N=(36.0, 400.0, 742.0))
        truth = {**TRUTH, "C_XXX": truths[machine]}
        campaign = CONSTANT.simulate(
            planned, seed=k + 1, parameters=truth, hyper_um={"sigma": 0.3, "tau": 2.0}
        ).campaign
        lb.write_campaign(
            replace(campaign, machine_id=None if k == 4 else f"M{machine}"),
            folder / "all" / f"c{k}",
        )
    (folder / "list.txt").write_text(
        f"# all seven\n{folder}/all\n{folder}/all/c1/campaign.toml\n{folder}/c9\n"
    )
    arguments = ["batch", f"@{folder}/list.txt", "--out", folder / "b", "--workers", 1, *MODEL]
    return folder / "b", CliRunner().invoke(app, list(map(str, arguments)), env={"COLUMNS": "200"})


@pytest.fixture(scope="module")
def rows(finished: tuple[Path, Any]) -> Path:
    return finished[0]


@pytest.fixture
def anew(rows: Path, tmp_path: Path, invoke: Invoke) -> Any:
    """The command batch on campaigns of the shop into a folder of its own."""

    def run(*arguments: object, out: Path = tmp_path / "b") -> tuple[int, str, str]:
        return invoke("batch", *arguments, "--out", out, "--workers", 1, *MODEL)

    return run


def test_counts_failures_and_where_it_is(finished: tuple[Path, Any]) -> None:
    out, ended = finished
    shop = out.parent
    assert ended.exit_code == 0, ended.stderr
    assert ended.stderr == ""
    assert f"  {shop}/c9: campaign must be a folder with campaign.toml" in ended.stdout
    for words in (
        "fitted",
        "failed",
        "in all",
        "which does not exist",
        "--resume --retry",
        "8 campaigns in",
        "a second",
    ):
        assert words in " ".join(ended.stdout.split())
    written = f"Written: {out}/campaigns.parquet, {out}/campaigns.csv"
    assert written.replace(" ", "") in "".join(ended.stdout.split())
    assert lb.fleet.read_batch(out)["status"].tolist() == ["done"] * 7 + ["failed"]
    assert sorted(path.name for path in out.iterdir()) == [
        "batch.sqlite",
        "campaigns.csv",
        "campaigns.parquet",
        "campaigns.txt",
    ]


def test_what_a_batch_passes_over_is_named_with_a_cure() -> None:
    paths = tuple(f"shop/{k}.xlsx" for k in range(7))
    result = lb.fleet.Batch(
        Path("out"),
        Path("out"),
        Path("out"),
        *(1, 1, 0, 0, 0, (), (), 1, 2.0),
        resumed=False,
        passed_over=paths,
    )
    expected = (
        "Passed over, for no campaign.toml is in them (7): shop/0.xlsx, shop/1.xlsx, shop/2.xlsx,"
        " shop/3.xlsx, shop/4.xlsx and 2 more. Make campaigns of tables with ldbb-bayes import"
    )
    assert expected in "\n".join(map(str, _batch_parts(result)))


@pytest.mark.parametrize(("fitted", "text"), [(1, "1 campaign in 2.0 s"), (3, "3 campaigns in")])
def test_one_campaign_is_singular(fitted: int, text: str) -> None:
    counts = (fitted, fitted, 0, 0, 0, (), (), fitted, 2.0)
    result = lb.fleet.Batch(Path("out"), Path("out"), Path("out"), *counts, resumed=False)
    assert text in "\n".join(map(str, _batch_parts(result)))


@pytest.mark.slow
def test_json_on_processes(rows: Path, tmp_path: Path, invoke: Invoke) -> None:
    folders = (
        rows.parent / "all" / "c0",
        rows.parent / "all" / "c1",
        f"{rows.parent}/all/c1/../c0",
        rows.parent / "c9",
    )
    code, stdout, stderr = invoke(
        "batch", *folders, "--out", tmp_path / "b", "--workers", 2, "--json", *MODEL
    )
    record = json.loads(stdout)
    assert (code, stderr) == (0, "")
    assert [record[key] for key in ("schema", "campaigns", "done", "failures")] == [1, 3, 2, 1]
    assert [failure["campaign"] for failure in record["failed"]] == [f"{rows.parent}/c9"]
    assert record["dataset"] == f"{tmp_path}/b/campaigns.parquet"
    first = lb.fleet.read_batch(rows).iloc[:2]
    rows_here = lb.fleet.read_batch(tmp_path / "b").iloc[:2]
    assert rows_here["C_XXX.mean"].tolist() == first["C_XXX.mean"].tolist()


@pytest.mark.slow
def test_a_missed_target_is_exit_code_1(
    rows: Path, tmp_path: Path, anew: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And nothing to resume begins anew."""
    monkeypatch.setattr("ldbb_bayes.inference.mcmc.Assessment.meets", lambda *_, **__: False)
    code, stdout, stderr = anew(rows.parent / "all" / "c0", "--resume")
    assert code == 1
    assert stderr == f"{tmp_path}/b holds no unfinished batch: this one begins anew.\n"
    assert "not converged: do not use their numbers" in stdout
    assert not lb.fleet.read_batch(tmp_path / "b")["converged"][0]


def test_interrupted_and_resumed(
    rows: Path, tmp_path: Path, anew: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl-C before the second row: 130, one message; --resume goes on there."""
    jobs: list[int] = []

    def interrupted(settings: Settings, job: Job) -> dict[str, Any]:
        jobs.append(job.number)
        if jobs == [0, 1]:
            raise KeyboardInterrupt
        return made_row(settings, job)

    monkeypatch.setattr("ldbb_bayes.fleet.batch.fit_row", interrupted)
    listed = rows.parent / "list.txt"
    code, stdout, stderr = anew(listed)
    assert (code, stdout) == (130, "")
    assert (
        f"interrupted; {tmp_path}/b keeps what is done. The same command with --resume goes on"
        " with it." in stderr
    )
    assert anew(listed, "--resume")[0] == 0
    assert jobs == [0, 1, *range(1, 8)]


def test_from_campaigns_to_a_population(rows: Path, tmp_path: Path, invoke: Invoke) -> None:
    out = tmp_path / "p"
    code, stdout, stderr = invoke(
        "population", rows, "--out", out, "--parameters", "C_XXX,C_YYY,E_XX1", "--json"
    )
    assert code == 0, stderr
    record = json.loads(stdout)
    assert sorted(path.name for path in out.iterdir()) == ["machines.csv", "population.json"]
    assert json.loads((out / "population.json").read_text()) == record
    assert record["sha256"] == digest_of(record)
    assert list(record["next"]) == ["C_XXX", "C_YYY"]
    assert (record["machine"]["M5"]["campaigns"], record["not_belonging"]) == (2, ["M0"])
    stiff = record["machine"]["M0"]
    assert max(stiff["z"], key=lambda name: abs(stiff["z"][name])) == "C_XXX"
    assert abs(stiff["estimate"]["C_XXX"]["mean"] - STIFF) < 4.0 * stiff["estimate"]["C_XXX"]["sd"]
    doubts = " ".join(record["doubts"])
    assert "Left out, because the fit failed: " in doubts
    assert "Without a machine's name, each counted as a machine of its own: " in doubts
    assert (
        "Where the population gives the prior of a campaign with the same bar they are counted"
        " again." in doubts
    )
    for column, key in (("sha256", "readings_sha256"), ("circles_sha256", "circles_sha256")):
        assert record[key] == lb.fleet.read_batch(rows)[column].dropna().tolist()
    table = pd.read_csv(out / "machines.csv", index_col="machine")
    assert table.loc["M0", "flag"]
    assert table.loc["M5", "C_XXX.mean"] == pytest.approx(
        record["machine"]["M5"]["estimate"]["C_XXX"]["mean"]
    )
    again = lb.fleet.read_population_prior(out)
    third = lb.read_campaign(rows.parent / "all" / "c3")
    refuses("must not be in the population that gives its prior", again.doubts, third)
    tests = [test.with_reading_um(2.0 * np.asarray(test.reading_um)) for test in third.tests]
    doubts = again.doubts(replace(third, tests=tests))
    assert any("has campaigns of this machine (M3)" in doubt for doubt in doubts)
    assert {f"The population says: {doubt}" for doubt in record["doubts"]} <= set(doubts)
    assert "must not exist" in invoke("population", rows, "--out", out)[2]


def test_a_trend_and_its_files(
    tmp_path: Path, invoke: Invoke, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a machine that has loosened; its options are those of the answer."""
    rows = drawn_rows(6, np.random.default_rng(4), step_at=4)
    monkeypatch.setattr("ldbb_bayes.cli.fleets.read_fleet", lambda *_: rows)
    out = tmp_path / "out"
    options = ("--out", out, "--parameters", "C_XXX, C_YYY", "--threshold", "0.9", "--ci", 0.9)
    record = json.loads(invoke("trend", tmp_path, *options, "--json")[1])
    assert [record[name] for name in ("schema", "machine", "changed")] == [1, "M1", True]
    assert list(record["parameters"]) == ["C_XXX", "C_YYY"]
    assert [record["assumptions"][name] for name in ("threshold", "ci")] == [0.9, 0.9]
    assert sorted(path.name for path in out.iterdir()) == [
        "control_chart.png",
        "control_chart.svg",
        "trend.csv",
        "trend.json",
    ]
    assert json.loads((out / "trend.json").read_text()) == record
    assert len(pd.read_csv(out / "trend.csv")) == 12
    assert "must not exist" in invoke("trend", tmp_path, *options)[2]
    code, stdout, _ = invoke("trend", tmp_path, *options, "--force", "--own-instruments")
    assert (code, f"Written: {out}" in stdout, "a change is found" in stdout) == (0, True, True)
