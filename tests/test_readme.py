"""README, docs and notebook are true: their Python runs, their commands exist, the picture of the house is the house."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from campaigns import HYPER_UM, TRUTH, plan
from typer.main import get_command
from typer.testing import CliRunner

import ldbb_bayes
from ldbb_bayes.campaign.layout import Layout, TestLayout
from ldbb_bayes.cli import app


def pages(root: Path) -> list[Path]:
    """In the order in which they are read."""
    folders = ["tutorials", "how-to", "", "explanation", "reference", "reference/api"]
    return [root / "README.md", *(page for folder in folders for page in sorted((root / "docs" / folder).glob("*.md")))]


def text(root: Path) -> str:
    return "\n".join(path.read_text(encoding="utf-8") for path in pages(root))


def shop_floor(place: Path) -> None:
    """The campaigns that the README's batch is of: three machines, two months; and that of a new machine."""
    model = ldbb_bayes.HybridModel.first(degree=1)
    for seed in range(7):
        made = model.simulate(plan((60,) * 4), seed=seed, parameters=TRUTH, hyper_um=HYPER_UM).campaign
        named = replace(made, machine_id=f"VMC {7 + seed % 3:02d}", date=f"2026-0{1 + seed // 3}-05")
        ldbb_bayes.write_campaign(named, place / (f"campaigns/{seed}" if seed < 6 else "new_machine"))


# Runs a page's blocks in order: commands as typed, all its Python in one process.
PAGE = """
import pathlib, re, shlex, subprocess, sys
__import__("os").environ["MPLBACKEND"] = "Agg"
text, space = pathlib.Path(sys.argv[1]).read_text(encoding="utf-8"), {}
for block in re.finditer(r"^```(python|sh)\\n(.*?)^```", text, re.S | re.M):
    line = text[: block.start()].count("\\n") + 1
    print(f"line {line}", flush=True)
    if block[1] == "python":
        exec(compile("\\n" * line + block[2], sys.argv[1], "exec"), space)
        continue
    for command in re.findall(r"^ldbb-bayes .*$", block[2].replace("\\\\\\n", " "), re.M):
        words = shlex.split(command, comments=True)[1:]
        subprocess.run([sys.executable, "-W", "error", "-m", "ldbb_bayes", *words], check=True)
"""


@pytest.mark.slow
def test_every_block_runs(root: Path, tmp_path: Path) -> None:
    (tmp_path / "data").symlink_to(root / "data")
    shop_floor(tmp_path)
    failed = {}
    for page in pages(root):
        arguments = [sys.executable, "-W", "error", "-c", PAGE, str(page)]
        done = subprocess.run(arguments, capture_output=True, text=True, cwd=tmp_path, check=False)
        if done.returncode:
            failed[page.name] = f"{done.stdout[-500:]}\n{done.stderr}"
    assert not failed, "\n".join(f"{page}: {text}" for page, text in failed.items())


def test_truths_run(root: Path, tmp_path: Path) -> None:
    (block,) = [own for own in re.findall(r"```toml\n(.*?)```", text(root), re.S) if "[hyper_um]" in own]
    (tmp_path / "truths.toml").write_text(block)
    done = CliRunner().invoke(app, ["simulate", str(tmp_path / "truths.toml"), "--out", str(tmp_path / "c")])
    assert done.exit_code == 0, done.output
    assert ldbb_bayes.read_campaign(tmp_path / "c").readings == 3 * 360


def test_the_tidy_example_is_understood(root: Path, tmp_path: Path) -> None:
    """The lines printed, continued to whole circles."""
    (block,) = re.findall(r"```\n(test;.*?)```", text(root), re.S)
    lines = block.strip().splitlines()
    lines += [f"{test};{force};{a},25;1,5" for test, force in (("first", 36), ("second", 742)) for a in range(1, 360, 9)]
    (tmp_path / "readings.csv").write_text("\n".join(lines))
    campaign = ldbb_bayes.read_campaign(tmp_path / "readings.csv")
    assert campaign.forces_N.tolist() == [36.0, 742.0]
    assert campaign.tests[0].reading_um[:2].tolist() == [-12.31, -12.30]


def test_the_layout_reads_a_file(root: Path, tmp_path: Path) -> None:
    (block,) = [own for own in re.findall(r"```toml\n(.*?)```", text(root), re.S) if "[columns]" in own]
    (tmp_path / "layout.toml").write_text(block, encoding="utf-8")
    rows = [f"{5 * k};{0.001 * (k % 7):.3f}" for k in range(144)]
    (tmp_path / "Versuch 1.csv").write_text("\n".join(["Winkel [°];Messwert", *rows]), encoding="utf-8")
    found = ldbb_bayes.import_campaign(tmp_path / "Versuch 1.csv", layout=ldbb_bayes.read_layout(tmp_path / "layout.toml"))
    assert (found.campaign.tests[0].force_N, found.campaign.readings) == (36.0, 72)
    for name in ({*Layout.model_fields} | {*TestLayout.__dataclass_fields__}) - {"schema_", "columns", "test"}:
        assert name in block, name


def test_options_exist(root: Path) -> None:
    named = set(re.findall(r"(?<![\w-])--[a-z][\w-]+", re.sub(r"\bpip .*|--nthreads", "", text(root))))
    commands = get_command(app).commands.values()  # type: ignore[attr-defined]
    assert named <= {option for command in commands for own in command.params for option in own.opts} | {"--help", "--version"}


def test_links_and_pictures_exist(root: Path) -> None:
    assert len((root / "README.md").read_text(encoding="utf-8").splitlines()) <= 150
    for page in pages(root):
        links = [link for link in re.findall(r"\]\(([^)#]+)\)", page.read_text(encoding="utf-8")) if "://" not in link]
        assert all((page.parent / link).exists() for link in links), page


@pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")
@pytest.mark.parametrize(
    ("refuse", "advice"),
    [("import venv", "apt install python3-venv python3-pip"), ("version_info", "Python 3.11 or newer is needed")],
)
def test_make_says_which_package_is_missing(root: Path, tmp_path: Path, refuse: str, advice: str) -> None:
    script = tmp_path / "python"
    script.write_text(f'#!/bin/sh\ncase "$*" in *"{refuse}"*) exit 1;; esac\nexec {sys.executable} "$@"\n')
    script.chmod(0o755)
    command = ["make", "demo", f"PYTHON={script}", f"VENV={tmp_path / 'venv'}"]
    done = subprocess.run(command, cwd=root, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert advice in done.stdout
    assert not (tmp_path / "venv").exists()


def test_the_house_as_drawn(root: Path) -> None:
    drawn = (root / "docs" / "explanation" / "architecture.md").read_text(encoding="utf-8")
    package = Path(ldbb_bayes.__file__).parent
    heads = re.findall(r"^    ([\w/]+)/ .*\n((?:        .*\n)+)", drawn, re.M)
    rooms = {room: set(re.findall(r"\w+", re.sub(r"\([^)]*\)", "", modules))) for room, modules in heads}
    found: dict[str, set[str]] = {}
    for path in package.rglob("*.py"):
        if not path.name.startswith("__"):
            found.setdefault("/".join(("ldbb_bayes", *path.relative_to(package).parts[:-1])), set()).add(path.stem)
    assert rooms == found


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


@pytest.mark.slow
def test_the_example_notebook_runs(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    notebook = json.loads((root / "studies" / "00_first_hour" / "first_hour.ipynb").read_text())
    monkeypatch.chdir(root / "studies" / "00_first_hour")
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert all(cell["outputs"] for cell in cells)
    assert sum("image/png" in output.get("data", {}) for cell in cells for output in cell["outputs"]) == 2
    space: dict[str, object] = {}
    for cell in cells:
        lines = [line for line in "".join(cell["source"]).splitlines() if not line.startswith("%")]
        exec(compile("\n".join(lines), "first_hour.ipynb", "exec"), space)
