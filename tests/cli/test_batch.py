"""The command batch: one table, exit codes, JSON alone on stdout, one message for bad input, an interruption resumed."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from batches import dataset_bytes, write_campaigns
from typer.testing import CliRunner

import ldbb_bayes as lb
from ldbb_bayes.cli.main import app
from ldbb_bayes.fleet.row import Job, Settings, fit_row

pytest.importorskip("pyarrow")
MODEL = ("--degree", "0", "--without", "hysteresis,discrepancy,setup-shift", "--ess", "600", "--quiet")


@pytest.fixture(scope="module")
def shop(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("shop")
    write_campaigns(folder, 2)
    return folder


def invoke(*arguments: object) -> tuple[int, str, str]:
    done = CliRunner().invoke(app, ["batch", *map(str, arguments)], env={"COLUMNS": "200"})
    return done.exit_code, done.stdout, done.stderr


@pytest.fixture(scope="module")
def finished(shop: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, tuple[int, str, str]]:
    out = tmp_path_factory.mktemp("out") / "b"
    listed = out.parent / "list.txt"
    listed.write_text(f"{shop}  # both\n{shop}/c1/campaign.toml\n{shop}/c7\n")
    return out, invoke(f"@{listed}", "--out", out, "--workers", 1, *MODEL)


def test_counts_failures_and_where_it_is(finished: tuple[Path, tuple[int, str, str]], shop: Path) -> None:
    out, (code, stdout, stderr) = finished
    assert code == 0, stderr
    assert stderr == f"{shop}/c1/campaign.toml was given more than once: kept once.\n"
    assert f"  {shop}/c7: campaign must be a folder with campaign.toml" in stdout
    for part in ("fitted", "failed", "in all", "which does not exist", "--resume --retry", "3 campaigns in", "a second"):
        assert part in stdout
    assert f"Written: {out}/campaigns.parquet" in stdout.replace("\n", "")
    rows = lb.read_batch(out)
    assert rows["status"].tolist() == ["done", "done", "failed"]
    assert sorted(path.name for path in out.iterdir()) == ["batch.sqlite", "campaigns.parquet", "campaigns.txt"]


def test_resume_prints_that_nothing_is_left(finished: tuple[Path, tuple[int, str, str]]) -> None:
    out, _ = finished
    listed = out.parent / "list.txt"
    code, stdout, _ = invoke(listed, "--out", out, "--resume", "--workers", 1, *MODEL)
    assert code == 0
    assert "Nothing was left to do." in stdout
    code, stdout, stderr = invoke(listed, "--out", out, "--resume", "--seed", 4, "--workers", 1, *MODEL)
    assert (code, stdout) == (2, "")
    assert "must be of this batch, got seed 1 where this run has 4" in stderr
    code, _, stderr = invoke(listed, "--out", out, "--workers", 1, *MODEL)
    assert code == 2
    assert "must not hold a batch, got a finished one" in stderr


def test_json_on_processes(finished: tuple[Path, tuple[int, str, str]], shop: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-W", "error", "-m", "ldbb_bayes", "batch", str(finished[0].parent / "list.txt")]
    command += ["--out", str(tmp_path / "b"), "--workers", "2", "--json", *MODEL]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert (found["schema"], found["campaigns"], found["done"], found["failures"]) == (1, 3, 2, 1)
    assert [own["campaign"] for own in found["failed"]] == [f"{shop}/c7"]
    assert found["dataset"] == f"{tmp_path}/b/campaigns.parquet"
    assert dataset_bytes(tmp_path / "b") == dataset_bytes(finished[0])


def test_only_the_first_of_many_repeats(shop: Path, tmp_path: Path) -> None:
    given = [shop / "c0", *[f"{shop}/c1/../c0"] * 13, "--out", tmp_path / "b", "--workers", 1, *MODEL]
    code, _, stderr = invoke(*given)
    assert code == 0
    assert stderr.count("kept once") == 10
    assert stderr.endswith("\n… and 3 more.\n")


def test_a_missed_target_is_exit_code_1(shop: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ldbb_bayes.inference.mcmc.Assessment.meets", lambda *_, **__: False)
    code, stdout, _ = invoke(shop / "c0", "--out", tmp_path / "b", "--workers", 1, *MODEL)
    assert code == 1
    assert "not converged: do not use their numbers" in stdout
    assert not lb.read_batch(tmp_path / "b")["converged"][0]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nowhere"], "a batch must have campaigns that exist, got none among 1 (nowhere)"),
        (["@nowhere"], "nowhere must be a list of campaigns, one path a line, got nothing"),
        (["SHOP", "--sampler", "x"], "sampler must be one of joint, independent, got 'x'"),
        (["SHOP", "--executor", "x"], "--executor must be one of process, dask, got 'x'"),
        (["SHOP", "--scheduler", "tcp://x"], "--scheduler must"),
        (["SHOP", "--ci", "2"], "ci_prob must lie between 0 and 1"),
        (["SHOP", "--retry"], "must come with resume (--resume)"),
        (["SHOP", "--preset", "x"], "preset must be one of default, paper"),
        (["SHOP", "--seed", str(2**63)], "Invalid value for '--seed'"),
        (["SHOP", "--radius-mm", "0"], "--radius-mm must be above zero"),
    ],
)
def test_bad_input(arguments: list[str], message: str, shop: Path, tmp_path: Path) -> None:
    given = [str(shop) if own == "SHOP" else own for own in arguments]
    code, stdout, stderr = invoke(*given, "--out", tmp_path / "b", "--workers", 1)
    assert (code, stdout) == (2, "")
    assert message in " ".join(stderr.split())
    assert not (tmp_path / "b").exists()


def test_nothing_to_resume_begins_anew(shop: Path, tmp_path: Path) -> None:
    code, _, stderr = invoke(shop / "c0", "--out", tmp_path / "b", "--workers", 1, "--resume", *MODEL)
    assert code == 0
    assert stderr == f"{tmp_path}/b holds no unfinished batch: this one begins anew.\n"


def test_interrupted_and_resumed(
    tmp_path: Path, finished: tuple[Path, tuple[int, str, str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl-C after the first row: 130, one message; with --resume the same table."""
    out, listed = tmp_path / "b", finished[0].parent / "list.txt"

    def interrupted(settings: Settings, job: Job) -> dict[str, Any]:
        if job.index == 1:
            raise KeyboardInterrupt
        return fit_row(settings, job)

    with monkeypatch.context() as patch:
        patch.setattr("ldbb_bayes.fleet.batch.fit_row", interrupted)
        code, stdout, stderr = invoke(listed, "--out", out, "--workers", 1, *MODEL)
    assert (code, stdout) == (130, "")
    assert f"interrupted; {out} keeps what is done. The same command with --resume goes on with it." in stderr
    code, stdout, _ = invoke(listed, "--out", out, "--workers", 1, "--resume", *MODEL)
    assert code == 0
    assert dataset_bytes(out) == dataset_bytes(finished[0])
