"""The command line: exit codes, JSON on stdout and nothing else, one message for bad input, nothing half-written."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from campaigns import plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.cli.main import app


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-W", "error", "-m", "ldbb_bayes", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return lb.write_campaign(simulated(plan()), tmp_path_factory.mktemp("campaign") / "c")


@pytest.fixture(scope="module")
def fitted(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, subprocess.CompletedProcess[str]]:
    out = tmp_path_factory.mktemp("out") / "r"
    return out, run("fit", folder, "--degree", 0, "--sampler", "quadrature", "--out", out, "--json", "--seed", 5)


def test_fit_json(fitted: tuple[Path, subprocess.CompletedProcess[str]]) -> None:
    out, done = fitted
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    result = json.loads(done.stdout)
    assert result["model"]["degree"] == 0
    assert result["provenance"]["seed"] == 5
    assert json.loads((out / "summary.json").read_text()) == result
    assert sorted(p.name for p in out.iterdir()) == ["model.toml", "posterior.nc", "summary.json"]
    assert lb.read_model(out / "model.toml") == lb.HybridModel.default(0)


def test_summarize(fitted: tuple[Path, subprocess.CompletedProcess[str]]) -> None:
    out, done = fitted
    assert json.loads(run("summarize", out, "--json").stdout) == json.loads(done.stdout)
    narrow = json.loads(run("summarize", out / "posterior.nc", "--json", "--ci", 0.5).stdout)["parameters"]["C_XXX"]["ci50"]
    wide = json.loads(done.stdout)["parameters"]["C_XXX"]["ci95"]
    assert wide[0] < narrow[0] < narrow[1] < wide[1]
    table = run("summarize", out)
    assert "C_XXX" in table.stdout
    assert "µm/N" in table.stdout
    assert "E_C(0Y)X" in table.stdout
    assert "looks exactly like" in table.stdout


def test_without_out_nothing_is_written(folder: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "ldbb_bayes", "fit", str(folder), "--degree", "0", "--ess", "1e5", "--max-steps", "200"]
    assert subprocess.run(command, capture_output=True, cwd=tmp_path, timeout=120, check=False).returncode == 1
    assert list(tmp_path.iterdir()) == []


def test_a_missed_target_is_exit_code_1(folder: Path, tmp_path: Path) -> None:
    done = run("fit", folder, "--ess", "1e6", "--max-steps", 200, "--degree", 0, "--out", tmp_path / "r")
    assert done.returncode == 1
    assert "NOT CONVERGED" in done.stdout
    assert not json.loads((tmp_path / "r" / "summary.json").read_text())["sampler"]["converged"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["fit", "nowhere"], "does not exist"),
        (["fit", "CAMPAIGN", "--resume"], "--resume must come with --out"),
        (["fit", "CAMPAIGN", "--without", "balls"], "Did you mean 'ball-form'"),
        (["fit", "CAMPAIGN", "--preset", "papers"], "Did you mean 'paper'"),
        (["fit", "CAMPAIGN", "--degree", "5"], "degree"),
        (["fit", "CAMPAIGN", "--sampler", "nuts"], "sampler must be one of"),
        (["fit", "CAMPAIGN", "--model", "none.toml"], "readable TOML file"),
        (["fit", "CAMPAIGN", "--ci", "95"], "ci_prob must lie between 0 and 1"),
        (["fit", "CAMPAIGN", "--radius-mm", "100"], "--radius-mm must come with a tidy CSV"),
        (["fit", "CAMPAIGN", "--nonsense"], "No such option"),
        (["fit", "CAMPAIGN", "--out", "EXISTING"], "must not exist"),
        (["fit", "CAMPAIGN", "--out", "/proc/nothing/r"], "must be writable"),
        (["summarize", "nowhere"], "result must be a folder with posterior.nc"),
        (["fit"], "Missing argument"),
    ],
)
def test_bad_input(folder: Path, tmp_path: Path, arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    places = {"CAMPAIGN": str(folder), "EXISTING": str(tmp_path)}
    with pytest.raises(SystemExit) as left:
        app([places.get(argument, argument) for argument in arguments])
    shown = capsys.readouterr()
    assert left.value.code == 2
    assert shown.out == ""
    assert message in " ".join(shown.err.replace("│", " ").split())
    assert list(tmp_path.iterdir()) == []


def test_bad_campaign_names_file_and_line(folder: Path, tmp_path: Path) -> None:
    broken = tmp_path / "c"
    lb.write_campaign(lb.read_campaign(folder), broken)
    lines = (broken / "f300.csv").read_text().splitlines()
    lines[6] = "54,abc"
    (broken / "f300.csv").write_text("\n".join(lines))
    done = run("fit", broken, "--out", tmp_path / "r")
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert f"{broken / 'f300.csv'}, line 7: reading_um must be a finite number, got 'abc'" in done.stderr
    assert not (tmp_path / "r").exists()


@contextmanager
def fitting(folder: Path, out: Path | None, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-m", "ldbb_bayes", "fit", str(folder), "--json", *arguments]
    command += [] if out is None else ["--out", str(out)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def wait_for(condition: Callable[[], bool]) -> None:
    patience = time.monotonic() + 90.0
    while not condition():
        assert time.monotonic() < patience
        time.sleep(0.02)


LONG = ("--ess", "1e7", "--max-steps", "1000000")


def test_interruption_without_out_writes_nothing(folder: Path, tmp_path: Path) -> None:
    """A real Ctrl-C: nothing on stdout, one line on stderr."""
    with fitting(folder, None, *LONG) as process:
        time.sleep(5.0)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
    assert (process.returncode, out, err) == (130, "", "ldbb-bayes: interrupted; nothing was written.\n")
    assert list(tmp_path.iterdir()) == []


def numbers(text: str) -> dict:
    """A result without what depends on the clock."""
    result = json.loads(text)
    del result["provenance"], result["sampler"]["seconds"]
    return result


@pytest.mark.slow
def test_killed_interrupted_and_resumed_is_uninterrupted(folder: Path, tmp_path: Path) -> None:
    """kill -9, then Ctrl-C, then to the end: the result of a run that nothing stopped."""
    target = ("--degree", "0", "--ess", "80000", "--seed", "3")
    whole = run("fit", folder, *target, "--json", "--out", tmp_path / "whole")
    out, kept = tmp_path / "r", tmp_path / "r.checkpoint"
    with fitting(folder, out, *target) as process:
        wait_for(lambda: (kept / "block-00000.npz").exists())
        process.kill()
    assert not out.exists()
    assert run("fit", folder, *target, "--out", out).stderr.startswith(f"ldbb-bayes: {kept} must not hold an unfinished run")
    with fitting(folder, out, *target, "--resume") as process:
        wait_for(lambda: (kept / "block-00001.npz").exists())
        process.send_signal(signal.SIGINT)
        stdout, stderr = process.communicate(timeout=60)
    assert (process.returncode, stdout) == (130, "")
    assert stderr == f"ldbb-bayes: interrupted; {kept} keeps the run. The same command with --resume goes on with it.\n"
    resumed = run("fit", folder, *target, "--json", "--out", out, "--resume")
    assert resumed.returncode == 0, resumed.stderr
    assert numbers(resumed.stdout) == numbers(whole.stdout)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["r", "whole"]


def test_nearly_equal_forces_with_flat_priors(tmp_path: Path) -> None:
    """A millinewton apart: answered, with an uncertainty that says the number is worth nothing. Closer: refused."""
    campaign = simulated(plan((40, 40), forces_N=(100.0, 100.001)))
    options = ["--preset", "paper", "--degree", 0, "--sampler", "quadrature"]
    done = run("fit", lb.write_campaign(campaign, tmp_path / "c"), *options, "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["parameters"]["C_XXX"]["sd"] > 1e-2
    close = lb.Campaign(tuple(replace(t, force_N=100.0 + 1e-7 * i) for i, t in enumerate(campaign.tests)))
    done = run("fit", lb.write_campaign(close, tmp_path / "d"), "--preset", "paper", "--degree", 0)
    assert done.returncode == 2
    assert "flat priors must have at least two force levels" in done.stderr


def test_dead_circles_give_valid_json(tmp_path: Path) -> None:
    campaign = simulated(plan())
    dead = lb.Campaign((campaign.tests[0].with_reading_um(np.zeros(40)), *campaign.tests[1:]))
    done = run("fit", lb.write_campaign(dead, tmp_path / "c"), "--degree", 0, "--sampler", "quadrature", "--out", tmp_path / "r")
    assert done.returncode == 0, done.stderr

    def refuse(name: str) -> None:
        raise AssertionError(name)

    result = json.loads((tmp_path / "r" / "summary.json").read_text(), parse_constant=refuse)
    assert result["fit"]["fitness_percent"]["f036"] is None


def test_help_and_version() -> None:
    assert run("--version").stdout == f"ldbb-bayes {lb.__version__}\n"
    for command in ([], ["fit"], ["summarize"]):
        done = run(*command, "--help")
        assert done.returncode == 0
        assert "Usage" in done.stdout


def test_force_replaces_results_and_nothing_else(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Somebody's readings, a campaign, and the folder one stands in are never deleted."""
    precious, campaign = tmp_path / "stuff", tmp_path / "c"
    precious.mkdir()
    (precious / "my_readings.csv").write_text("mine")
    lb.write_campaign(lb.read_campaign(folder), campaign)
    (tmp_path / "result").mkdir()
    (tmp_path / "result" / "posterior.nc").write_text("old")
    cases = [
        (["fit", str(folder), "--out", str(precious)], "got 'my_readings.csv'. Move it away"),
        (["fit", str(campaign), "--out", str(campaign)], "nothing but earlier results to be replaced"),
        (["demo", "--out", str(precious)], "got 'my_readings.csv'"),
        (["simulate", str(folder), "--out", str(tmp_path / "result")], "got 'posterior.nc'"),
        (["fit", str(folder), "--out", "."], "must not be the folder you stand in"),
    ]
    for arguments, message in cases:
        with pytest.raises(SystemExit) as left:
            app([*arguments, "--force"])
        assert left.value.code == 2
        assert message in capsys.readouterr().err
    assert (precious / "my_readings.csv").read_text() == "mine"
    assert lb.read_campaign(campaign).sha256 == lb.read_campaign(folder).sha256
    with pytest.raises(SystemExit) as left:
        app(["simulate", str(folder), "--out", str(campaign), "--force"])
    assert left.value.code in (0, None)


@pytest.mark.parametrize("encoding", ["cp1252", "latin-1", "ascii"])
def test_terminals_that_cannot_show_every_sign(folder: Path, encoding: str) -> None:
    environment = {**os.environ, "PYTHONIOENCODING": encoding, "PYTHONUTF8": "0"}
    for arguments in (["check", str(folder)], ["fit", "--help"]):
        command = [sys.executable, "-m", "ldbb_bayes", *arguments]
        done = subprocess.run(command, capture_output=True, env=environment, check=False)
        assert done.returncode == 0, done.stderr
        assert b"Traceback" not in done.stderr


def test_a_reader_that_leaves_early_is_no_error(folder: Path) -> None:
    for arguments in ("check", "check --json"):
        command = f"{sys.executable} -m ldbb_bayes {arguments.split()[0]} {folder} {' '.join(arguments.split()[1:])} | true"
        done = subprocess.run(["bash", "-o", "pipefail", "-c", command], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        assert done.stderr == ""


def test_what_differs_from_the_preset_is_said(folder: Path, tmp_path: Path) -> None:
    without = run("fit", folder, "--degree", 0, "--without", "ball-form,truncation", "--sampler", "quadrature")
    assert "preset default without BallForm, truncation, reference" in " ".join(without.stdout.split())
    paper = run("fit", folder, "--degree", 0, "--preset", "paper", "--sampler", "quadrature")
    assert "the intervals cover white noise alone" in " ".join(paper.stdout.split())
    (tmp_path / "model.toml").write_text("schema = 1\ndegree = 0\n[prior]\ntau_um = 20.0\n")
    edited = run("fit", folder, "--model", tmp_path / "model.toml", "--sampler", "quadrature")
    assert "preset default with edited priors" in " ".join(edited.stdout.split())
