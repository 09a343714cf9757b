"""What holds for every study: the page is written from the numbers, by the public interface, and
the numbers are reproduced."""

from __future__ import annotations

import ast
import json
import re
import runpy
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path

import pandas as pd
import pytest
import study

STUDIES = Path(__file__).parents[2] / "studies"
FOLDERS = sorted(path.parent for path in STUDIES.glob("[0-9][0-9]_*/run.py"))
IDS = [folder.name for folder in FOLDERS]
# Time the machinery itself against other packages, feed every reader with what is broken, and
# simulate by the exact chain. Study 14 makes plans without a search; study 15 fits too many
# campaigns for whole posteriors.
BEHIND_THE_SCENES = {
    "06_validation",
    "90_speed",
    "10_files",
    "11_many_campaigns",
    "12_real_machines",
    "14_promises",
    "15_stopping",
    "91_fleet",
    "92_peers",
    "93_guides",
}
PARTS = ("**Question.**", "**Method.**", "**Answer.**", "**Limits.**")
BY_HAND = re.compile(
    r"\{\{.*?\}\}|\{%.*?%\}|\{#.*?#\}|`[^`]*`|\]\([^)]*\)|^# \d\d|^    .*$"
    r"|\b(?:Tables?|Figs?\.|Figures?|Eqs?\.|Sections?|ISO|[Oo]rders?|degree|Python|schema)"
    r" (?:[\d()]+(?:, | and | to |–|-)?)+"
    r"|[A-Za-z_(]+\d[\w)]*|(?:cos|sin) ?\dθ|\b95 %|²|³|χ²|√3",
    re.DOTALL | re.MULTILINE,
)


def numbers_by_hand(template: str) -> list[str]:
    """Digits of a template that do not come from results.json, and are no name."""
    lines = BY_HAND.sub(" ", template).splitlines()
    return [line.strip() for line in lines if re.search(r"\d", line)]


@pytest.mark.parametrize("folder", FOLDERS, ids=IDS)
def test_the_page_is_written_from_the_numbers(folder: Path) -> None:
    assert "README.md" in study.pages(folder)
    for name in study.pages(folder):
        assert (folder / name).read_text(encoding="utf-8") == study.page(folder, name)
    for template in folder.glob("*.j2"):
        assert numbers_by_hand(template.read_text(encoding="utf-8")) == []
    (line,) = numbers_by_hand("Of {{ r.count }} campaigns 17 % fail, as in Table 4 and `f036`.")
    assert re.findall(r"\d+", line) == ["17"]
    text = (folder / "README.md").read_text(encoding="utf-8")
    assert text.startswith(f"# {folder.name[:2]} ")
    assert [section for section in PARTS if section not in text] == []
    assert f"python studies/{folder.name}/run.py" in text
    for name in re.findall(r"\]\(([^)]+\.png)\)", text):
        assert (folder / name).is_file(), name


@pytest.mark.parametrize(
    "folder", [f for f in FOLDERS if f.name not in BEHIND_THE_SCENES], ids=lambda f: f.name
)
def test_studies_use_the_public_interface_only(folder: Path) -> None:
    for path in folder.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom):
                assert not (node.module or "").startswith("ldbb_bayes"), (
                    f"{path.name}: {node.module}"
                )
            if isinstance(node, ast.Import):
                assert all(
                    alias.name.split(".")[0] != "ldbb_bayes" or alias.name == "ldbb_bayes"
                    for alias in node.names
                )
            if (
                isinstance(node, ast.Attribute)
                and isinstance(node.value, ast.Name)
                and node.value.id == "lb"
            ):
                assert not node.attr.startswith("_"), f"{path.name}: lb.{node.attr}"


def test_differences_are_seen() -> None:
    example = study.Study(
        Path(), lambda effort: {}, tolerance=0.01, absolute={"share/*": 0.02}, once=("seconds/*",)
    )
    stated = {
        "a": 1.0,
        "share": {"x": 0.0},
        "seconds": {"s": 1.0},
        "word": "yes",
        "list": [1.0, 2.0],
    }

    def wrong(**new: object) -> list[str]:
        return study.differences(json.loads(json.dumps(stated | new)), stated, example)

    assert wrong(a=1.009, share={"x": 0.019}, seconds={"s": 9.0}) == []
    assert wrong(a=1.02) == ["a: 1.02, stated 1"]
    assert wrong(a=float("nan")) == ["a: nan, stated 1"]
    assert wrong(share={"x": 0.03}) == ["share/x: 0.03, stated 0"]
    assert wrong(word="no") == ["word: 'no', stated 'yes'"]
    assert wrong(list=[1.0, 2.1]) == ["list/1: 2.1, stated 2"]
    assert wrong(list=[1.0]) == ["list: [1.0], stated [1.0, 2.0]"]
    assert wrong(more=1.0) == ["more: measured, not stated"]
    both = {"a": 1.0, "b": 2.0}
    assert study.differences({"a": 1.0}, both, example) == ["b: stated, not measured"]


def test_simulated_campaigns_that_differ_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    stored = pd.DataFrame({"kind": ["a", "a"], "seed": [0, 1], "x": [1.0, 2.0]})
    study._compare(stored.assign(x=[1.0, 2.01]), stored, "here", 0.01)
    for other in (
        stored.assign(x=[1.0, 2.03]),
        stored.assign(x=[1.0, float("nan")]),
        stored.assign(y=1.0),
    ):
        with pytest.raises(SystemExit, match="here"):
            study._compare(other, stored, "here", 0.01)
    study._compare(stored.assign(x=[1.0, 2.5]), stored, "here", 0.01, astray=0.5)
    assert "1 of 2 rows of random draws" in capsys.readouterr().out
    with pytest.raises(SystemExit, match="2 of 2 rows differ"):
        study._compare(stored.assign(x=[1.5, 2.5]), stored, "here", 0.01, astray=0.5)
    study._compare(stored.assign(x=[1.0, 2.1]), stored, "here", 0.01, astray=0.5, of_draws=0.1)
    with pytest.raises(SystemExit, match=r"seed 1: x is 2.5, kept 2; 1 of 2 rows differ"):
        study._compare(stored.assign(x=[1.0, 2.5]), stored, "here", 0.01, astray=0.5, of_draws=0.1)


def test_the_papers_tables_and_figures_are_found_by_number() -> None:
    text = (STUDIES / "README.md").read_text(encoding="utf-8")
    tables, figures = text.split("## The paper's tables")[1].split("## The paper's figures")
    for section, count in ((tables, 9), (figures, 16)):
        assert [int(n) for n in re.findall(r"^\| (\d+) \|", section, re.MULTILINE)] == list(
            range(1, count + 1)
        )
    for target in re.findall(r"\]\(([^)#]+)", text):
        assert (STUDIES / target).is_file(), target
    for folder in STUDIES.glob("[0-9][0-9]_*/"):
        assert f"[`{folder.name}`]" in text


# The one in the docstring of study.py, and what stands above it.
ABOVE = """
import sys
from pathlib import Path
from typing import Any
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
import ldbb_bayes as lb
from study import DATA, Effort, Study, run
"""
SMALLEST = ABOVE + textwrap.dedent(
    str(study.__doc__).partition("The smallest study:\n")[2].partition("\nand in")[0]
)


@pytest.fixture
def smallest(tmp_path: Path) -> Path:
    """The smallest study, stated, on data of its own; it may be damaged."""
    folder = tmp_path / "studies" / "00_smallest"
    folder.mkdir(parents=True)
    for name in ("study.py", "__main__.py"):
        shutil.copy(STUDIES / name, tmp_path / "studies")
    shutil.copytree(STUDIES.parent / "data", tmp_path / "data")
    (folder / "run.py").write_text(SMALLEST, encoding="utf-8")
    (folder / "README.md.j2").write_text("{{ r.rmse_um | to('.2f') }} µm\n", encoding="utf-8")
    assert failure_of(folder, "--write") == ""
    return folder


def failure_of(folder: Path, *options: str) -> str:
    """What a study says when it fails, run here; empty where all is reproduced."""
    path = list(sys.path)
    arguments = sys.argv
    study_module = sys.modules.pop("study", None)
    sys.argv = ["run.py", *options]
    try:
        runpy.run_path(str(folder / "run.py"), run_name="__main__")
    except SystemExit as left:
        return str(left.code)
    finally:
        sys.path[:] = path
        sys.argv = arguments
        sys.modules.pop("study", None)
        if study_module is not None:
            sys.modules["study"] = study_module
    return ""


def command(folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    """``python studies`` in a process of its own."""
    return subprocess.run(
        [sys.executable, str(folder), *options],
        capture_output=True,
        text=True,
        check=False,
        timeout=900,
    )


@pytest.mark.slow
def test_one_command_runs_them(smallest: Path) -> None:
    """And fails when a number has drifted."""
    stated = smallest / "results.json"
    stated.write_text(
        json.dumps({"rmse_um": 1.02 * json.loads(stated.read_text())["rmse_um"]}), encoding="utf-8"
    )
    ended = command(smallest.parent, "0", "--quick")
    assert (
        ended.returncode,
        "rmse_um" in ended.stderr,
        "Not reproduced: 00_smallest" in ended.stderr,
    ) == (1, True, True)


def test_files_that_are_missing_or_damaged(smallest: Path) -> None:
    """One line that names the file and the cure."""
    assert failure_of(smallest) == ""
    for name, damage, message in (
        ("results.json", None, "git checkout"),
        ("README.md.j2", None, "git checkout"),
        ("results.json", '{"rmse_um": {', "damaged"),
        ("results.json", "{}", "rmse_um"),
        ("README.md.j2", "{{ r.nothing }}", "a template asks for"),
    ):
        content = (smallest / name).read_bytes()
        (
            (smallest / name).unlink()
            if damage is None
            else (smallest / name).write_text(damage, encoding="utf-8")
        )
        assert message in failure_of(smallest)
        (smallest / name).write_bytes(content)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["90_speed", "91_fleet"])
def test_what_is_run_by_hand_still_runs(name: str, tmp_path: Path) -> None:
    """Small: without peers; every executor gives the same dataset and reports what is broken."""
    if name == "91_fleet":
        pytest.importorskip("pyarrow")
        pytest.importorskip("distributed")
    ended = command(STUDIES / name / "run.py", "--quick", "--out", str(tmp_path))
    assert ended.returncode == 0, ended.stderr
    results = json.loads((tmp_path / "results.json").read_text())
    if name == "90_speed":
        assert all(
            row["worst_mean_z"] < 5.0 and row["worst_sd_error"] < 0.15
            for row in results["race"].values()
        )
    else:
        assert len(results["runs"]) == 6
        assert all(results["same_dataset"].values())


def test_a_kept_campaign_that_was_changed_is_seen(tmp_path: Path) -> None:
    """Beyond the rows that are made again, too; and a tolerance by a name that nothing has."""
    (tmp_path / "README.md.j2").write_text("", encoding="utf-8")
    (tmp_path / "rows.csv").write_text("kind,seed,x\na,0,1\na,1,2\n", encoding="utf-8")
    example = study.Study(tmp_path, lambda effort: {"count": 2.0}, once=("seconds",))
    study._state(example, "write")
    assert study._compare_with_stated(example, "usual") == [
        "seconds: the study names it, but nothing it measures is called so"
    ]
    (tmp_path / "rows.csv").write_text("kind,seed,x\na,0,1\na,1,3\n", encoding="utf-8")
    assert any("kept/rows.csv" in text for text in study._compare_with_stated(example, "usual"))
