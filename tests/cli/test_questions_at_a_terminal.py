"""What files leave open is asked at a terminal, and refused without one."""

from __future__ import annotations

import os
import pty
import subprocess
import sys
from pathlib import Path

import field_files
import pytest
from terminals import read_to_the_end

import ldbb_bayes as lb

COMMAND = [sys.executable, "-m", "ldbb_bayes"]


def written(folder: Path, name: str) -> list[str]:
    """Return the paths of the files of a case, written into a folder."""
    paths = []
    for file, content in field_files.CASES[name].files.items():
        (folder / file).write_bytes(content)
        paths.append(str(folder / file))
    return paths


def at_a_terminal(arguments: list[str], typed: str) -> tuple[int, str]:
    """Return the exit code of a command at a pseudo terminal, and what it shows there."""
    terminal, process_end = pty.openpty()
    with subprocess.Popen(
        [*COMMAND, *arguments], stdin=process_end, stdout=subprocess.DEVNULL, stderr=process_end
    ) as process:
        os.close(process_end)
        os.write(terminal, typed.encode())
        screen = read_to_the_end(terminal)
    os.close(terminal)
    return process.returncode, " ".join(screen.decode().split())


QUESTIONS = {
    "guess_open": ("mm", "or 2 µm/N in mm"),
    "guess_angle_gon": ("gon", "which may be deg or gon"),
    "zero_without_sense": ("CW", "must run clockwise or counter-clockwise"),
    "sign_unclear": ("-1", "one sign of the readings must mean a longer bar"),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", QUESTIONS)
def test_import_asks_what_files_leave_open(name: str, tmp_path: Path) -> None:
    answer, question = QUESTIONS[name]
    files = written(tmp_path, name)
    out = tmp_path / "campaign"
    code, screen = at_a_terminal(["import", *files, "--out", str(out)], f"{answer}\n")
    assert (code, question in screen) == (0, True), screen
    case = field_files.CASES[name]
    off = field_files.differences(lb.read_campaign(out), case.circles)
    assert field_files.agrees(off), off


@pytest.mark.slow
@pytest.mark.parametrize("command", ["import", "identify", "next", "design"])
def test_with_yes_nothing_is_asked(command: str, tmp_path: Path) -> None:
    answer, question = QUESTIONS["sign_unclear"]
    files = written(tmp_path, "sign_unclear")
    out = ["--out", str(tmp_path / "out")]
    code, screen = at_a_terminal([command, *files, "--yes", *out], f"{answer}\n")
    assert (code, question in screen) == (2, True), screen


@pytest.mark.slow
def test_two_questions_are_asked_one_after_the_other(tmp_path: Path) -> None:
    files = written(tmp_path, "zero_oclock")
    out = tmp_path / "campaign"
    code, screen = at_a_terminal(["import", *files, "--out", str(out)], "+Y\nCW\n")
    assert (code, "must begin at an axis" in screen, "must run" in screen) == (0, True, True), (
        screen
    )


@pytest.mark.slow
def test_a_wrong_answer_is_asked_again(tmp_path: Path) -> None:
    files = written(tmp_path, "guess_open")
    out = tmp_path / "campaign"
    code, screen = at_a_terminal(["import", *files, "--out", str(out)], "furlong\nmm\n")
    assert (code, "it should be one of um, mm" in screen) == (0, True), screen


@pytest.mark.slow
def test_the_answer_is_kept_in_import_toml(tmp_path: Path) -> None:
    files = written(tmp_path, "guess_open")
    out = tmp_path / "campaign"
    at_a_terminal(["import", *files, "--out", str(out)], "mm\n")
    assert 'reading_unit = "mm"' in (out / "import.toml").read_text("utf-8")


@pytest.mark.slow
def test_report_that_may_ask_nothing_refuses_at_a_terminal(tmp_path: Path) -> None:
    files = written(tmp_path, "guess_open")
    out = tmp_path / "report"
    code, screen = at_a_terminal(["report", *files, "--yes", "--out", str(out)], "")
    assert (code, "Say which: --unit." in screen, out.exists()) == (2, True, False), screen


def test_import_without_a_terminal_refuses(tmp_path: Path) -> None:
    files = written(tmp_path, "guess_open")
    out = tmp_path / "campaign"
    ended = subprocess.run(
        [*COMMAND, "import", *files, "--out", str(out)],
        input="mm\n",
        capture_output=True,
        text=True,
        check=False,
    )
    assert (ended.returncode, "Say which: --unit." in " ".join(ended.stderr.split())) == (2, True)
    assert not out.exists()


@pytest.mark.slow
def test_identify_asks_what_files_leave_open(tmp_path: Path) -> None:
    files = written(tmp_path, "guess_open")
    code, screen = at_a_terminal(["identify", *files], "mm\n")
    assert (code, "or 2 µm/N in mm" in screen) == (0, True), screen
