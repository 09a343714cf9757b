"""What holds for every study: the page is written from the numbers, by the public interface, and the numbers are reproduced."""

from __future__ import annotations

import ast
import json
import re
import runpy
import shutil
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from pathlib import Path
from types import ModuleType

import numpy as np
import pandas as pd
import pytest

import ldbb_bayes as lb
from ldbb_bayes.jobs import Lost

STUDIES = Path(__file__).parents[2] / "studies"
FOLDERS = sorted(path.parent for path in STUDIES.glob("[0-9][0-9]_*/run.py"))
IDS = [folder.name for folder in FOLDERS]
# Time the machinery itself against other packages, and feed every reader with what is broken.
BEHIND_THE_SCENES = {"90_speed", "10_files", "11_many_campaigns", "91_fleet"}
PARTS = ("**Question.**", "**Method.**", "**Answer.**", "**Limits.**")
BY_HAND = re.compile(
    r"\{\{.*?\}\}|\{%.*?%\}|\{#.*?#\}|`[^`]*`|\]\([^)]*\)|^# \d\d|^    .*$"
    r"|\b(?:Tables?|Figs?\.|Figures?|Eqs?\.|Sections?|ISO|[Oo]rders?|degree|Python|schema) (?:[\d()]+(?:, | and | to |–|-)?)+"
    r"|[A-Za-z_(]+\d[\w)]*|(?:cos|sin) ?\dθ|\b95 %|²|³|χ²|√3",
    re.DOTALL | re.MULTILINE,
)


@pytest.fixture(scope="module")
def study() -> ModuleType:
    sys.path.insert(0, str(STUDIES))
    import study

    return study


def numbers_by_hand(template: str) -> list[str]:
    """Digits of a template that do not come from results.json, and are no name."""
    return [line.strip() for line in BY_HAND.sub(" ", template).splitlines() if re.search(r"\d", line)]


@pytest.mark.parametrize("folder", FOLDERS, ids=IDS)
def test_the_page_is_written_from_the_numbers(folder: Path, study: ModuleType) -> None:
    assert "README.md" in study.pages(folder)
    for name in study.pages(folder):
        assert (folder / name).read_text(encoding="utf-8") == study.page(folder, name)
    for template in folder.glob("*.j2"):
        assert numbers_by_hand(template.read_text(encoding="utf-8")) == []


def test_a_number_by_hand_is_seen() -> None:
    (line,) = numbers_by_hand("Of {{ r.count }} campaigns 17 % fail, as in Table 4 and `f036`.")
    assert re.findall(r"\d+", line) == ["17"]
    assert numbers_by_hand("E_XX1 and cos 4θ in Tables 5 to 8 of ISO 230") == []


@pytest.mark.parametrize("folder", FOLDERS, ids=IDS)
def test_the_form_of_a_page(folder: Path) -> None:
    text = (folder / "README.md").read_text(encoding="utf-8")
    assert text.startswith(f"# {folder.name[:2]} ")
    assert [part for part in PARTS if part not in text] == []
    assert f"python studies/{folder.name}/run.py" in text
    for name in re.findall(r"\]\(([^)]+\.png)\)", text):
        assert (folder / name).is_file(), name


@pytest.mark.parametrize("folder", [f for f in FOLDERS if f.name not in BEHIND_THE_SCENES], ids=lambda f: f.name)
def test_studies_use_the_public_interface_only(folder: Path) -> None:
    for path in folder.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom):
                assert not (node.module or "").startswith("ldbb_bayes"), f"{path.name}: {node.module}"
            if isinstance(node, ast.Import):
                assert all(alias.name.split(".")[0] != "ldbb_bayes" or alias.name == "ldbb_bayes" for alias in node.names)
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "lb":
                assert not node.attr.startswith("_"), f"{path.name}: lb.{node.attr}"


def test_differences_are_seen(study: ModuleType) -> None:
    made = study.Study(Path(), lambda effort: {}, tolerance=0.01, absolute={"share/*": 0.02}, once=("seconds/*",))
    stated = {"a": 1.0, "share": {"x": 0.0}, "seconds": {"s": 1.0}, "word": "yes", "list": [1.0, 2.0]}

    def wrong(**new: object) -> list[str]:
        return study.differences(json.loads(json.dumps(stated | new)), stated, made)

    assert wrong(a=1.009, share={"x": 0.019}, seconds={"s": 9.0}) == []
    assert wrong(a=1.02) == ["a: 1.02, stated 1"]
    assert wrong(a=float("nan")) == ["a: nan, stated 1"]
    assert wrong(share={"x": 0.03}) == ["share/x: 0.03, stated 0"]
    assert wrong(word="no") == ["word: 'no', stated 'yes'"]
    assert wrong(list=[1.0, 2.1]) == ["list/1: 2.1, stated 2"]
    assert wrong(list=[1.0]) == ["list: [1.0], stated [1.0, 2.0]"]
    assert wrong(more=1.0) == ["more: measured, not stated"]
    assert study.differences({"a": 1.0}, {"a": 1.0, "b": 2.0}, made) == ["b: stated, not measured"]


def test_simulated_campaigns_that_differ_are_refused(study: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    kept = pd.DataFrame({"kind": ["a", "a"], "seed": [0, 1], "x": [1.0, 2.0]})
    study._compare(kept.assign(x=[1.0, 2.01]), kept, "here", 0.01)
    for other in (kept.assign(x=[1.0, 2.03]), kept.assign(x=[1.0, float("nan")]), kept.assign(y=1.0)):
        with pytest.raises(SystemExit, match="here"):
            study._compare(other, kept, "here", 0.01)
    study._compare(kept.assign(x=[1.0, 2.5]), kept, "here", 0.01, astray=0.5)
    assert "1 of 2 rows of random draws" in capsys.readouterr().out
    with pytest.raises(SystemExit, match="2 of 2 rows differ"):
        study._compare(kept.assign(x=[1.5, 2.5]), kept, "here", 0.01, astray=0.5)


def slower_first(kind: str, seed: int) -> dict[str, float]:
    time.sleep(0.02 * (5 - seed))
    return {"x": seed + len(kind)}


def test_rows_come_in_the_order_of_the_jobs(study: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    jobs = [("ab", seed) for seed in range(5)]
    expected = [{"kind": "ab", "seed": seed, "x": seed + 2.0} for seed in range(5)]
    monkeypatch.setattr(study, "executor", lambda: ThreadPoolExecutor(5))
    assert study._on_all_cores(slower_first, jobs) == expected
    monkeypatch.setattr(study, "executor", nullcontext)
    assert study._on_all_cores(slower_first, jobs) == expected


def test_a_simulated_campaign_that_is_lost_is_said(study: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study, "executor", nullcontext)
    monkeypatch.setattr(study, "done", lambda *_: iter([(0, Lost("its worker died"))]))
    with pytest.raises(lb.InputError, match="every simulated campaign must give a row, a, seed 7 gave none: its worker died"):
        study._on_all_cores(slower_first, [("a", 7)])


def test_significant_digits(study: ModuleType) -> None:
    for value, digits, expected in (
        (0.0996, 2, "0.10"),
        (198.09, 2, "200"),
        (-5.46, 2, "−5.5"),
        (0.0, 2, "0"),
        (0.996, 2, "1.0"),
    ):
        assert study._sig(value, digits) == expected
    for mean, sd, expected in (
        (-129.7, 0.395, "−129.70 ± 0.40"),
        (1.056, 14.46, "1 ± 14"),
        (434.0, 133.6, "430 ± 130"),
        (0.0, 0.996, "0.0 ± 1.0"),
    ):
        assert study._plus_minus(mean, sd) == expected


def test_the_papers_tables_and_figures_are_found_by_number() -> None:
    text = (STUDIES / "README.md").read_text(encoding="utf-8")
    tables, figures = text.split("## The paper's tables")[1].split("## The paper's figures")
    for part, count in ((tables, 9), (figures, 16)):
        assert [int(n) for n in re.findall(r"^\| (\d+) \|", part, re.MULTILINE)] == list(range(1, count + 1))
    headings = {path: path.read_text(encoding="utf-8") for path in STUDIES.glob("*/*.md")}
    for target in re.findall(r"\]\(([^)]+)\)", text):
        name, _, anchor = target.partition("#")
        path = (STUDIES / name).resolve()
        assert path.is_file(), target
        if anchor:
            slugs = [
                re.sub(r"[^\w -]", "", h).strip().lower().replace(" ", "-")
                for h in re.findall(r"^#+ (.*)$", headings[path], re.M)
            ]
            assert anchor in slugs, target
    for folder in STUDIES.glob("[0-9][0-9]_*/"):
        assert f"[`{folder.name}`]" in text


def test_the_table_of_priors_is_that_of_the_default_model() -> None:
    """Read back from the page, in the units it names."""
    text = (STUDIES / "README.md").read_text(encoding="utf-8").split("## What is assumed beforehand")[1].split("\n## ")[0]
    stated = {line.split(" | ")[0].strip("| "): line.split(" | ")[1] for line in text.splitlines() if line.startswith("| ")}
    prior = lb.Prior.default()
    sizes = {
        "C_XXX, C_YYY": f"{prior.direct_mm_per_N:.0e} mm/N",
        "C_XYX": f"{prior.cross_mm_per_N:.0e} mm/N",
        "C_CXY, C_CYY": f"{prior.rotation_for_force_rad_per_N:.0e} rad/N",
        "C_CCY": f"{prior.rotation_for_moment_rad_per_N_mm:.0e} rad/(N mm)",
        "E_XX1, E_YY1": f"{prior.gain:.0e}",
        "E_C(0Y)X": f"{prior.squareness_rad:.0e} rad",
        "E_YX2, E_XY2": f"{prior.straightness_per_mm:.0e} 1/mm",
    }
    assert {name: stated[name] for name in sizes} == {name: text.replace("e-0", "e-") for name, text in sizes.items()}
    assert stated["their slopes"].startswith(f"{prior.slope_scale:g} sd(C)")
    assert stated["E_Xt0, E_Yt0"] == f"{prior.offset_mm:g} mm"
    hypers = ("form of the balls", prior.tau_um), ("zero and centre", prior.delta_um), ("what else", prior.kappa_um)
    for start, size in (*hypers, ("white noise", prior.sigma_um)):
        (entry,) = [value for name, value in stated.items() if name.startswith(start)]
        assert f"half-normal of {size:g} µm" in entry
    terms = {type(term).__name__: term for term in lb.HybridModel.default().nuisances}
    assert stated["length of the bar"] == f"{terms['BarLength'].sd_um:g} µm"
    assert stated["mount of the work ball"].startswith(f"{100 * terms['Mount'].relative_sd:g} %")
    force = terms["ForceError"]
    assert stated["force: gain; each test"] == f"{100 * force.gain_sd:g} %; {force.random_sd_N:g} N"


# The one in the docstring of study.py, whole.
SMALLEST = """
import sys
from pathlib import Path
HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
import ldbb_bayes as lb
from study import DATA, Study, run

def measure(effort):
    return {"rmse_um": lb.least_squares(lb.read_campaign(DATA / "recovered_experiment")).quality.rmse_um}

run(Study(HERE, measure))
"""


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
    assert ended(folder, "--write") == ""
    return folder


def ended(folder: Path, *options: str) -> str:
    """What a study says when it fails, run here; empty where all is reproduced."""
    path, arguments, own = list(sys.path), sys.argv, sys.modules.pop("study", None)
    sys.argv = ["run.py", *options]
    try:
        runpy.run_path(str(folder / "run.py"), run_name="__main__")
    except SystemExit as left:
        return str(left.code)
    finally:
        sys.path[:], sys.argv = path, arguments
        sys.modules.pop("study", None)
        if own is not None:
            sys.modules["study"] = own
    return ""


def command(folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    """``python studies`` in a process of its own."""
    return subprocess.run([sys.executable, str(folder), *options], capture_output=True, text=True, check=False, timeout=900)


def test_one_command_runs_them(smallest: Path) -> None:
    done = command(smallest.parent)
    assert (done.returncode, "00_smallest: reproduced" in done.stdout) == (0, True), done.stderr
    stated = smallest / "results.json"
    stated.write_text(json.dumps({"rmse_um": 1.02 * json.loads(stated.read_text())["rmse_um"]}), encoding="utf-8")
    done = command(smallest.parent, "0", "--quick")
    assert (done.returncode, "rmse_um" in done.stderr, "Not reproduced: 00_smallest" in done.stderr) == (1, True, True)
    for options, message in ((("99",), "unknown study 99"), (("90", "--quick"), "90_speed is run by hand")):
        done = command(STUDIES, *options)
        assert (done.returncode, message in done.stderr) == (2, True)


def test_side_by_side_says_the_same() -> None:
    """Each study in one piece, and both that failed in the end, for what they cannot run on."""
    at_once, none = (command(STUDIES, "06", "08", "--scheduler", "tcp://a:1", "--at-once", n) for n in ("2", "0"))
    assert (at_once.returncode, none.returncode) == (1, 2)
    for name in ("06_validation", "08_other_campaigns"):
        assert f"== {name}\n{name}: --scheduler must go with --executor dask" in at_once.stdout
    assert "Not reproduced: 06_validation, 08_other_campaigns" in at_once.stderr
    assert "--at-once must be at least 1, got 0" in none.stderr


def test_files_that_are_missing_or_damaged(smallest: Path) -> None:
    """One line that names the file and the cure."""
    assert ended(smallest) == ""
    for name in ("results.json", "README.md", "README.md.j2"):
        content = (smallest / name).read_bytes()
        (smallest / name).unlink()
        assert name in (text := ended(smallest))
        assert "git checkout" in text
        (smallest / name).write_bytes(content)
    stated = (smallest / "results.json").read_bytes()
    for damage, message in (('{"rmse_um": {', "damaged"), ("[]", "must hold numbers by name"), ("{}", "rmse_um")):
        (smallest / "results.json").write_text(damage, encoding="utf-8")
        assert message in ended(smallest)
    (smallest / "results.json").write_bytes(stated)
    template = smallest / "README.md.j2"
    template.write_text(template.read_text(encoding="utf-8") + "{{ r.nothing }}", encoding="utf-8")
    assert "'nothing'" in (text := ended(smallest))
    assert "a template asks for" in text
    shutil.rmtree(smallest.parents[1] / "data" / "recovered_experiment")
    assert "recovered_experiment" in ended(smallest)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["90_speed", "91_fleet"])
def test_what_is_run_by_hand_still_runs(name: str, tmp_path: Path) -> None:
    """Small: without peers; every executor gives the same dataset and reports what is broken."""
    if name == "91_fleet":
        pytest.importorskip("pyarrow")
        pytest.importorskip("distributed")
    done = command(STUDIES / name / "run.py", "--quick", "--out", str(tmp_path))
    assert done.returncode == 0, done.stderr
    results = json.loads((tmp_path / "results.json").read_text())
    if name == "90_speed":
        assert set(results["race"]) == {"joint", "independent"}
        assert all(max(row["worst_mean_z"]) < 5.0 and max(row["worst_sd_error"]) < 0.15 for row in results["race"].values())
        assert "| joint |" in (tmp_path / "table.md").read_text()
        return
    runs = {f"{pool} {workers} {count}" for pool in ("process", "dask") for workers, count in ((1, 4), (2, 4), (2, 8))}
    assert set(results["runs"]) == runs
    assert all(run["reported"] and run["worker_MB"] > 50.0 for run in results["runs"].values())
    assert all(results["same_dataset"].values())
    assert [pool["machines"] for pool in results["population"]] == [20]
    assert "**A million campaigns.**" in (tmp_path / "README.md").read_text()


def test_kept_campaigns_that_are_damaged(tmp_path: Path, study: ModuleType) -> None:
    kept = tmp_path / "rows.csv"
    made = pd.DataFrame({"kind": ["a"], "seed": [0], "x": [1.0]})
    kept.write_text("", encoding="utf-8")
    with pytest.raises(pd.errors.EmptyDataError) as caught:
        study.kept(kept, made, {"a": 1}, "usual")
    assert "damaged" in study._said(caught.value)
    kept.write_text("a,b\n1,2\n", encoding="utf-8")
    with pytest.raises(SystemExit, match="must have columns kind and seed"):
        study.kept(kept, made, {"a": 1}, "usual")
    kept.write_text("kind,seed,x\nb,0,1\n", encoding="utf-8")
    with pytest.raises(SystemExit, match="git checkout"):
        study.kept(kept, made, {"a": 1}, "usual")


def test_a_figure_or_template_that_is_gone(tmp_path: Path, study: ModuleType) -> None:
    copied = tmp_path / "03_confounding"
    shutil.copytree(STUDIES / "03_confounding", copied)
    assert study._pages_that_differ(copied) == []
    (copied / "confounding.png").unlink()
    (wrong,) = study._pages_that_differ(copied)
    assert "shows confounding.png" in wrong
    (copied / "more.md").write_text("by hand", encoding="utf-8")
    assert "more.md.j2 must exist" in study._pages_that_differ(copied)[0]


def test_nothing_is_written_before_all_is_made(tmp_path: Path, study: ModuleType) -> None:
    """A template that asks for what is not measured leaves the old results; NumPy's numbers are written as numbers."""
    (tmp_path / "README.md.j2").write_text("{{ r.count }}", encoding="utf-8")
    made = study.Study(tmp_path, lambda effort: {"count": np.int64(3), "share": np.float64(0.5)})
    assert study._state(made, "write") == []
    assert json.loads((tmp_path / "results.json").read_text()) == {"count": 3, "share": 0.5}
    (tmp_path / "README.md.j2").write_text("{{ r.other }}", encoding="utf-8")
    with pytest.raises(study.TemplateError):
        study._state(study.Study(tmp_path, lambda effort: {"count": 4}), "write")
    assert json.loads((tmp_path / "results.json").read_text())["count"] == 3


def test_a_kept_campaign_that_was_changed_is_seen(tmp_path: Path, study: ModuleType) -> None:
    """Beyond the rows that are made again, too; and a tolerance by a name that nothing has."""
    (tmp_path / "README.md.j2").write_text("", encoding="utf-8")
    (tmp_path / "rows.csv").write_text("kind,seed,x\na,0,1\na,1,2\n", encoding="utf-8")
    made = study.Study(tmp_path, lambda effort: {"count": 2.0}, once=("seconds",))
    study._state(made, "write")
    assert study._compare_with_stated(made, "usual") == ["seconds: the study names it, but nothing it measures is called so"]
    (tmp_path / "rows.csv").write_text("kind,seed,x\na,0,1\na,1,3\n", encoding="utf-8")
    assert any("kept/rows.csv" in text for text in study._compare_with_stated(made, "usual"))
