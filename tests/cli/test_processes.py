"""The command line as a process: start, Ctrl-C, encodings, pipes, the demo."""

from __future__ import annotations

import json
import os
import pty
import re
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest
from demonstrations import demonstration_in
from terminals import read_to_the_end

import ldbb_bayes as lb
from ldbb_bayes.report.figures import FIGURES

# A run in the background ignores Ctrl-C, and hands that on.
HEED = partial(signal.signal, signal.SIGINT, signal.default_int_handler)
COMMAND = [sys.executable, "-W", "error", "-m", "ldbb_bayes"]


def run(*arguments: object, **options: object) -> subprocess.CompletedProcess[str]:
    command = [*COMMAND, *map(str, arguments)]
    return subprocess.run(
        command, capture_output=True, text=True, timeout=300, check=False, **options
    )  # type: ignore[call-overload]


def test_the_version_is_that_of_the_package() -> None:
    assert run("--version").stdout == f"ldbb-bayes {lb.__version__}\n"


@pytest.mark.parametrize("arguments", [["--help"], ["fit", "--help"]])
def test_help_shows_the_usage(arguments: list[str]) -> None:
    assert "Usage" in run(*arguments).stdout


@pytest.mark.parametrize("module", ["typer", "ldbb_bayes.errors", "numpy.linalg"])
def test_interruption_while_modules_are_loaded(module: str, folder: Path) -> None:
    """A real Ctrl-C once a module is imported, which Python says: one line, exit code 130."""
    start = [sys.executable, "-X", "importtime", "-c", "from ldbb_bayes.__main__ import run; run()"]
    with subprocess.Popen(
        [*start, "check", folder], stderr=subprocess.PIPE, text=True, preexec_fn=HEED
    ) as process:
        assert process.stderr is not None
        next(line for line in process.stderr if line.split("|")[-1].strip() == module)
        process.send_signal(signal.SIGINT)
        messages = [line for line in process.stderr if not line.startswith("import time:")]
    assert (messages, process.returncode) == (
        ["ldbb-bayes: interrupted; nothing is half-written.\n"],
        130,
    )


@pytest.mark.slow
def test_interruption_writes_nothing(folder: Path, tmp_path: Path) -> None:
    """A real Ctrl-C, sent once the progress bar says that sampling has begun: one line, exit code
    130."""
    terminal, process_end = pty.openpty()
    fit = [
        "fit",
        str(folder),
        "--json",
        "--ess",
        "1e7",
        "--max-steps",
        "1000000",
        "--out",
        str(tmp_path / "r"),
    ]

    with subprocess.Popen(
        [*COMMAND, *fit], stdout=subprocess.PIPE, stderr=process_end, text=True, preexec_fn=HEED
    ) as process:
        os.close(process_end)
        output = b""
        while b"steps" not in output:
            output += os.read(terminal, 4096)
        process.send_signal(signal.SIGINT)
        output += read_to_the_end(terminal)
        assert process.stdout is not None
        assert process.stdout.read() == ""
    os.close(terminal)
    assert process.returncode == 130
    assert output.decode().rstrip().endswith("ldbb-bayes: interrupted; nothing is half-written.")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_terminal_that_cannot_show_every_sign(folder: Path) -> None:
    environment = {**os.environ, "PYTHONIOENCODING": "ascii", "PYTHONUTF8": "0"}
    ended = subprocess.run(
        [*COMMAND, "check", str(folder)], capture_output=True, env=environment, check=False
    )
    assert ended.returncode == 0, ended.stderr
    assert ended.stderr == b""
    assert b"?" not in ended.stdout


@pytest.mark.slow
def test_a_reader_that_leaves_early_is_no_error(folder: Path) -> None:
    command = f"{sys.executable} -m ldbb_bayes check {folder} --json | true"
    ended = subprocess.run(
        ["bash", "-o", "pipefail", "-c", command], capture_output=True, text=True, check=False
    )
    assert (ended.returncode, ended.stderr) == (0, "")


@pytest.mark.slow
def test_the_demonstration_prints_its_results(place_of_demonstration: Path) -> None:
    ended = demonstration_in(place_of_demonstration)
    assert (ended.exit_code, ended.stderr) == (0, "")
    words = " ".join(ended.stdout.split())
    for expected in (
        "Constant compliance",
        "Linear compliance",
        "(k = 2)",
        "N/µm",
        "confounded with ball form",
        "prior-limited",
    ):
        assert expected in words
    assert re.search(
        r"averaged over joint load.*?, ln B\(linear/constant\) = −?\d+\.\d+ \(error 0\.\d+\)", words
    )
    assert (
        "THE RESULTS CAN BE USED WITH THIS RESERVATION. Not determined by the readings (5 of 11"
        " quantities): E_XX1, E_YX2, E_XY2, E_YY1 and E_C(0Y)X." in words
    )
    out = ended.folder / "ldbb_demo"
    assert [path.name for path in ended.folder.iterdir()] == ["ldbb_demo"]
    names = {path.name for path in (out / "figures").iterdir()}
    assert names == {f"{name}.png" for name in FIGURES} | {f"{name}.svg" for name in FIGURES}
    assert "<svg" in (out / "linear" / "report.html").read_text(encoding="utf-8")
    linear = json.loads((out / "linear" / "summary.json").read_text())
    assert linear["sampler"]["converged"]
    assert linear["campaign"]["sha256"] == lb.read_campaign(out / "campaign").sha256
    again = run("demo", cwd=ended.folder)
    assert (again.returncode, "--force" in again.stderr) == (2, True)
