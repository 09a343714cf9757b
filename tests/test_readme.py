"""The README is true: its Python runs, its commands exist, its picture of the house is the house."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

import ldbb_bayes


def text(root: Path) -> str:
    return (root / "README.md").read_text(encoding="utf-8")


def test_python_runs(root: Path) -> None:
    blocks = re.findall(r"```python\n(.*?)```", text(root), re.S)
    assert blocks
    for block in blocks:
        done = subprocess.run([sys.executable, "-W", "error", "-c", block], capture_output=True, text=True, cwd=root, check=False)
        assert done.returncode == 0, done.stderr
        assert "C_XXX" in done.stdout


def test_commands_and_options_exist(root: Path) -> None:
    section = text(root).split("## Commands")[1].split("## ")[0]
    commands = set(re.findall(r"ldbb-bayes (\w+)", section))
    help_text = subprocess.run([sys.executable, "-m", "ldbb_bayes", "--help"], capture_output=True, text=True, check=True).stdout
    assert commands
    for command in commands:
        assert command in help_text
        shown = subprocess.run(
            [sys.executable, "-m", "ldbb_bayes", command, "--help"], capture_output=True, text=True, check=True
        )
        usage = section.split(f"ldbb-bayes {command} ")[1].split("ldbb-bayes")[0].split("\n\n")[0]
        for option in re.findall(r"\[(--[\w-]+)", usage):
            assert option in shown.stdout, f"{command} {option}"


@pytest.mark.parametrize("target", ["demo", "test", "lint", "test-slow"])
def test_make_targets_exist(root: Path, target: str) -> None:
    assert re.search(rf"^{target}:", (root / "Makefile").read_text(), re.M)


def test_the_house_as_drawn(root: Path) -> None:
    drawn = text(root).split("## The house")[1].split("Imports flow")[0]
    package = Path(ldbb_bayes.__file__).parent
    rooms = re.findall(r"^      (\w+)/ ", drawn, re.M)
    assert set(rooms) == {p.name for p in package.iterdir() if (p / "__init__.py").exists()}
    for room in rooms:
        line = next(line for line in drawn.splitlines() if line.startswith(f"      {room}/"))
        for name in re.findall(r"\w+", line.rsplit("  ", 1)[1]) if room != "cli" else []:
            assert (package / room / f"{name}.py").exists() or (package / room / name).is_dir(), f"{room}/{name}"


def test_digest_of_the_shipped_campaign(root: Path, recovered: ldbb_bayes.Campaign) -> None:
    assert recovered.sha256 in (root / "data" / "recovered_experiment" / "README.md").read_text()


def test_names_no_place_of_a_machine_or_registry(root: Path) -> None:
    listed = subprocess.run(["git", "ls-files"], cwd=root, capture_output=True, text=True, check=False).stdout.split()
    for name in listed:
        file = root / name
        if file.suffix in {".png", ".svg", ".csv"} or not file.is_file():
            continue
        content = file.read_text(encoding="utf-8")
        for address in ("/wo" + "rk/", "py" + "pi.org", "python" + "hosted", "registry" + ".npm"):
            assert address not in content, name
