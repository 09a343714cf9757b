"""README, docs and notebook are true: their commands and links exist, the picture of the house is
the house."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from typer.main import get_command
from typer.testing import CliRunner

import ldbb_bayes
from ldbb_bayes.cli import app
from ldbb_bayes.reading.layout import Layout, TestLayout


def pages(root: Path) -> list[Path]:
    """In the order in which they are read."""
    folders = ["tutorials", "how-to", "", "explanation", "reference", "reference/api"]
    paths = [root / "README.md", root / "CONTRIBUTING.md"]
    for folder in folders:
        paths += sorted((root / "docs" / folder).glob("*.md"))
    return paths


def text(root: Path) -> str:
    return "\n".join(path.read_text(encoding="utf-8") for path in pages(root))


def toml_blocks(root: Path, words: str) -> list[str]:
    """Return the blocks of TOML that hold some words."""
    blocks = re.findall(r"```toml\n(.*?)```", text(root), re.S)
    return [block for block in blocks if words in block]


def test_truths_run(root: Path, tmp_path: Path) -> None:
    (block,) = toml_blocks(root, "[hyper_um]")
    (tmp_path / "truths.toml").write_text(block)
    ended = CliRunner().invoke(
        app, ["simulate", str(tmp_path / "truths.toml"), "--out", str(tmp_path / "c")]
    )
    assert ended.exit_code == 0, ended.output
    assert ldbb_bayes.read_campaign(tmp_path / "c").readings == 3 * 360


def test_the_tidy_example_is_understood(root: Path, tmp_path: Path) -> None:
    """The lines printed, continued to whole circles."""
    (block,) = re.findall(r"```\n(test;.*?)```", text(root), re.S)
    lines = block.strip().splitlines()
    for angle in range(1, 360, 9):
        lines += [f"first;36;{angle},25;1,5", f"second;742;{angle},25;1,5"]
    (tmp_path / "readings.csv").write_text("\n".join(lines))
    campaign = ldbb_bayes.read_campaign(tmp_path / "readings.csv")
    assert campaign.forces_N.tolist() == [36.0, 742.0]
    assert campaign.tests[0].reading_um[:2].tolist() == [-12.31, -12.30]


def test_the_layout_reads_a_file(root: Path, tmp_path: Path) -> None:
    (block,) = toml_blocks(root, "[columns]")
    (tmp_path / "layout.toml").write_text(block, encoding="utf-8")
    rows = [f"{5 * k};{0.001 * (k % 7):.3f}" for k in range(144)]
    (tmp_path / "Versuch 1.csv").write_text(
        "\n".join(["Winkel [°];Messwert", *rows]), encoding="utf-8"
    )
    imported = ldbb_bayes.import_campaign(
        tmp_path / "Versuch 1.csv", layout=ldbb_bayes.reading.read_layout(tmp_path / "layout.toml")
    )
    assert (imported.campaign.tests[0].force_N, imported.campaign.readings) == (36.0, 72)
    for name in ({*Layout.model_fields} | {*TestLayout.__dataclass_fields__}) - {
        "schema_",
        "columns",
        "test",
    }:
        assert name in block, name


def test_options_exist(root: Path) -> None:
    documented = re.sub(r"\bpip .*|--nthreads", "", text(root))
    named = set(re.findall(r"(?<![\w-])--[a-z][\w-]+", documented))
    existing = {"--help", "--version"}
    for command in get_command(app).commands.values():  # type: ignore[attr-defined]
        for parameter in command.params:
            existing.update(parameter.opts)
    assert named <= existing


def test_the_readme_is_short(root: Path) -> None:
    assert len((root / "README.md").read_text(encoding="utf-8").splitlines()) <= 150


@pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")
@pytest.mark.parametrize(
    ("refuse", "advice"),
    [
        ("import venv", "apt install python3-venv python3-pip"),
        ("version_info", "Python 3.11 or newer is needed"),
    ],
)
def test_make_says_which_package_is_missing(
    root: Path, tmp_path: Path, refuse: str, advice: str
) -> None:
    script = tmp_path / "python"
    script.write_text(
        f'#!/bin/sh\ncase "$*" in *"{refuse}"*) exit 1;; esac\nexec {sys.executable} "$@"\n'
    )
    script.chmod(0o755)
    command = ["make", "demo", f"PYTHON={script}", f"VENV={tmp_path / 'venv'}"]
    ended = subprocess.run(command, cwd=root, capture_output=True, text=True, check=False)
    assert ended.returncode != 0
    assert advice in ended.stdout
    assert not (tmp_path / "venv").exists()


def test_the_house_as_drawn(root: Path) -> None:
    page = (root / "docs" / "explanation" / "architecture.md").read_text(encoding="utf-8")
    package = Path(ldbb_bayes.__file__).parent
    heads = re.findall(r"^    ([\w/]+)/ .*\n((?:        .*\n)+)", page, re.M)
    rooms = {}
    for room, modules in heads:
        rooms[room] = set(re.findall(r"\w+", re.sub(r"\([^)]*\)", "", modules)))
    modules_by_room: dict[str, set[str]] = {}
    for path in package.rglob("*.py"):
        if not path.name.startswith("__"):
            room = path.parent.relative_to(package.parent).as_posix()
            modules_by_room.setdefault(room, set()).add(path.stem)
    assert rooms == modules_by_room


def test_digest_of_the_shipped_campaign(root: Path, recovered: ldbb_bayes.Campaign) -> None:
    assert recovered.sha256 in (root / "data" / "recovered_experiment" / "README.md").read_text()


def test_names_no_place_of_a_machine_or_registry(root: Path) -> None:
    listed = subprocess.run(
        ["git", "ls-files"], cwd=root, capture_output=True, text=True, check=False
    ).stdout.split()
    for name in listed:
        file = root / name
        if file.suffix in {".png", ".svg", ".csv", ".xlsx"} or not file.is_file():
            continue
        content = file.read_text(encoding="utf-8")
        for address in ("/wo" + "rk/", "py" + "pi.org", "python" + "hosted", "registry" + ".npm"):
            assert address not in content, name


@pytest.mark.slow
def test_the_example_notebook_runs(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    notebook = json.loads((root / "studies" / "00_first_hour" / "first_hour.ipynb").read_text())
    monkeypatch.chdir(root / "studies" / "00_first_hour")
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert all(cell["outputs"] for cell in cells)
    kinds: list[str] = []
    for cell in cells:
        for output in cell["outputs"]:
            kinds += output.get("data", {})
    assert kinds.count("image/png") == 2
    space: dict[str, object] = {}
    for cell in cells:
        lines = [line for line in "".join(cell["source"]).splitlines() if not line.startswith("%")]
        exec(compile("\n".join(lines), "first_hour.ipynb", "exec"), space)
