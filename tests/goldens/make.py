"""What the package answers today, kept as JSON, so that a change of its inside can be held against
it.

python tests/goldens/make.py [NAME...]           # writes the goldens
python tests/goldens/make.py --check [NAME...]   # lists what differs by more than rounding; exit
code 1 where there is

Only public names and the command line are used; every golden is one function below.
"""

from __future__ import annotations

import argparse
import dataclasses
import html
import json
import os
import re
import shutil
import sys
import tempfile
import tomllib
from collections.abc import Callable, Mapping
from contextlib import chdir
from functools import cache, cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any
from unittest.mock import patch

import numpy as np
import pandas as pd
from differences import Difference, Rule, compact, condensed, differences
from threadpoolctl import threadpool_limits

import ldbb_bayes as lb

if TYPE_CHECKING:
    from command_line import Ended

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
sys.path.append(str(ROOT / "studies" / "10_files"))  # the files that are imported
RECOVERED = ROOT / "data" / "recovered_experiment"
CAMPAIGNS = ("arcs", "clocked", "two_radii", "both_ways", "three_planes")
DEGREES = {"clocked": 2, "two_radii": 0}
# Depend on the code, the machine or the clock, not on the answer.
LEFT_OUT = {
    "seconds",
    "started",
    "versions",
    "platform",
    "provenance",
    "resumed",
    "toml",
    "stamp",
    "sha256",
    "model_sha256",
}
_TABLES = tomllib.loads((HERE / "rules.toml").read_text(encoding="utf-8"))
RULES = tuple(Rule(**table) for table in _TABLES["rule"])
# Answers are kept of the model's first edition, but where its name says otherwise.
_WITH_MODEL = {"batch", "compare", "design", "fit", "identify", "simulate", "validate"}
_FEW_NUISANCES = ("--without", "discrepancy,hysteresis,setup-shift")


class Work:
    """A folder with the campaigns, and what several goldens need, made when it is first asked
    for."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.campaign = cache(self._campaign)
        self.fitted = cache(self._fitted)

    def _campaign(self, name: str) -> Path:
        """Folder of one of the five campaigns, of the plan, of the smallest of the shop, or of the
        recovered experiment."""
        if name == "recovered":
            return RECOVERED
        if name == "small":
            return self.shop[0]
        path = self.folder / name
        return Path(shutil.copytree(HERE / "campaigns" / name, path))

    def read(self, name: str) -> lb.Campaign:
        return lb.read_campaign(self.campaign(name))

    def command(self, *arguments: object) -> Ended:
        """Exit code and what is printed; in the folder, its paths relative: how long they are must
        not break lines elsewhere."""
        from command_line import run_command

        terminal = {"COLUMNS": "120", "TERM": "dumb", "NO_COLOR": "1"}
        with chdir(self.folder), patch.dict(os.environ, terminal):
            words = [str(pattern).removeprefix(f"{self.folder}/") for pattern in arguments]
            if words[0] in _WITH_MODEL and "--preset" not in words:
                words += ["--preset", "first"]
            return run_command(words)

    def run(self, *arguments: object) -> dict[str, Any]:
        """Exit code, and the text or the JSON that a command prints, without the place and the time
        of this run."""
        ended = self.command(*arguments)
        if "--json" in arguments and ended.stdout:
            return {"code": ended.exit_code} | self.cleaned(json.loads(ended.stdout))
        printed = {"stdout": self.text(ended.stdout), "stderr": self.text(ended.stderr)}
        return {"code": ended.exit_code} | {key: lines for key, lines in printed.items() if lines}

    def written(self, out: Path, *arguments: object) -> Path:
        """The folder that a command writes."""
        ended = self.command(*arguments, "--out", out, "--quiet")
        if not out.is_dir():
            raise RuntimeError(f"{arguments[0]} ended with code {ended.exit_code}: {ended.stderr}")
        return out

    def _fitted(self, name: str) -> Path:
        """A result of independent draws."""
        # With 400 draws R-hat of two_radii is 1.0100, on either side of 1.01 after the last bit of
        # a sum.
        ess = 400
        if name == "two_radii":
            ess = 500
        options: tuple[object, ...] = (
            "--degree",
            DEGREES.get(name, 1),
            "--sampler",
            "independent",
            "--ess",
            ess,
            "--seed",
            1,
        )
        if name == "small":
            options += _FEW_NUISANCES
        return self.written(self.folder / f"fit_{name}", "fit", self.campaign(name), *options)

    @cached_property
    def shop(self) -> list[Path]:
        """Small campaigns of several machines."""
        return sorted(
            Path(shutil.copytree(HERE / "campaigns" / "shop", self.folder / "shop")).iterdir()
        )

    @cached_property
    def compared(self) -> Path:
        """What `compare` writes of the recovered experiment."""
        return self.written(self.folder / "compare_recovered", "compare", RECOVERED)

    @cached_property
    def batch(self) -> tuple[Path, dict[str, Any]]:
        """A batch of ten small campaigns, one of them not there, and what the command printed."""
        out = self.folder / "batch"
        model = ("--degree", 1, "--without", "hysteresis,discrepancy,setup-shift")
        options = (
            "--sampler",
            "independent",
            "--ess",
            400,
            "--workers",
            1,
            "--seed",
            1,
            "--quiet",
            "--json",
        )
        return out, self.run(
            "batch", *self.shop, self.folder / "shop" / "missing", *model, *options, "--out", out
        )

    def text(self, text: str) -> list[str]:
        """Lines without the places, times and versions of this run."""
        for place, name in ((self.folder, "<work>"), (ROOT, "<project>")):
            text = text.replace(f"{place}/", f"{name}/").replace(str(place), name)
        text = re.sub(r"\b[\d.]+ s\b(?=[.:]?$|: )", "# s", text, flags=re.M)
        for pattern in (
            r"(?<=ted )\d{4}-[\d-]+",
            r"(?<=with ldbb_bayes )\S+",
            r"(?<=versions \| )[^|]+\b",
            r"\bPython \d[^|]+\b",
        ):
            text = re.sub(pattern, "#", text)
        text = re.sub(r"\d{4}-\d\d-\d\dT(?!00:00:00)[\d:.]+(\+[\d:]+|Z)?", "<time>", text)
        return [" ".join(line.split()) for line in text.splitlines() if line.strip()]

    def cleaned(self, value: Any) -> Any:
        """Plain and condensed: what depends on the answer."""
        return condensed(self.plain(value))

    def plain(self, value: Any) -> Any:
        """What depends on the answer, as JSON has it."""
        if isinstance(value, pd.DataFrame):
            value = _records(value)
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            names = [field.name for field in dataclasses.fields(value)]
            value = {name: getattr(value, name) for name in names}
        if isinstance(value, np.ndarray | np.generic):
            value = value.tolist()
        if isinstance(value, Mapping):
            items = {key: item for key, item in value.items() if key not in LEFT_OUT}
            return {str(key): self.plain(item) for key, item in items.items()}
        if isinstance(value, list | tuple):
            return [self.plain(item) for item in value]
        if isinstance(value, str):
            return "\n".join(self.text(value))
        if value is None or value is pd.NaT:
            return None
        if isinstance(value, bool | int | float):
            return value
        return str(value)


def _records(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Rows of a table, each with its name."""
    records = []
    for name, row in zip(table.index, table.to_dict("records"), strict=True):
        if isinstance(name, tuple):
            name = "/".join(map(str, name))
        records.append({"row": str(name)} | row)
    return records


@dataclasses.dataclass(frozen=True)
class Golden:
    """One file: what makes it, whether it is left out of the fast tests, and the largest relative
    difference that is rounding."""

    answer: Callable[[Work], Any]
    slow: bool = False
    relative: float = 1e-10


# Where the mode of the hyper-parameters was found by Newton steps, and quantiles by bisection.
FOUND = 2e-8
GOLDENS: dict[str, Golden] = {}


def golden(
    *names: str, fast: tuple[str, ...] = (), slow: bool = False, relative: float = FOUND
) -> Callable[[Any], Any]:
    """Register a function as the golden of its name; with names as one for each, handed to it, slow
    but for those ``fast``."""

    def register(function: Callable[..., Any]) -> Callable[..., Any]:
        stem = function.__name__.lstrip("_")
        for name in names:
            GOLDENS[f"{stem}_{name}"] = Golden(
                partial(function, name=name), name not in fast, relative
            )
        if not names:
            GOLDENS[stem] = Golden(function, slow, relative)
        return function

    return register


@golden(relative=1e-10)
def _check(work: Work) -> Any:
    names = (*CAMPAIGNS, "plan", "recovered")
    records = {name: work.run("check", work.campaign(name), "--json") for name in names}
    for record in records.values():
        record["tests"] = record["tests"][::2]
    return {
        "json": records,
        "digests": {name: work.read(name).sha256 for name in names},
        "text": {name: work.run("check", work.campaign(name)) for name in ("both_ways", "plan")},
    }


@golden(relative=1e-10)
def _import_awkward(work: Work) -> Any:
    """Of every accepted file: digest of the campaign, what its layout says, and what was taken for
    granted."""
    import awkward

    records: dict[str, Any] = {}
    for name, case in awkward.CASES.items():
        folder = work.folder / "awkward" / name
        folder.mkdir(parents=True)
        for file, content in case.files.items():
            (folder / file).write_bytes(content)
        files = [folder / file for file in case.files]
        records[name] = work.run(
            "import", *files, "--out", folder / "campaign", *case.options, "--json"
        )
        records[name]["digest"] = lb.read_campaign(folder / "campaign").sha256
    return records


@golden(relative=1e-10)
def _import_malformed(work: Work) -> Any:
    """Of every refused file: the message."""
    import malformed

    records = {}
    for name, case in malformed.CASES.items():
        folder = work.folder / "malformed" / re.sub(r"\W", "_", name)
        folder.mkdir(parents=True)
        (folder / case.file).write_bytes(case.content)
        ended = work.command(
            "import", folder / case.file, "--out", folder / "campaign", *case.options
        )
        message = " ".join((ended.stdout + ended.stderr).split())
        message = message.replace(f"{folder.relative_to(work.folder)}/", "")
        records[name] = {
            "code": ended.exit_code,
            "message": message,
            "written": sorted({p.name for p in folder.iterdir()} - {case.file}),
        }
    return records


@golden(relative=1e-10)
def _machine(work: Work) -> Any:
    asked = {
        "one plane": ("wCAFYXZSt",),
        "three planes": ("wCAFYXZSt", "--plane", "XY,YZ,ZX"),
        "frames": ("wCAFYXZSt", "--frame", "Y=0,-200,350", "--centre", "100,0,0"),
        "other chain": ("wXYFZt", "--plane", "XY,ZX"),
        "table": ("wYXFZt", "--plane", "YZ"),
    }
    records = {name: work.run("machine", *arguments, "--json") for name, arguments in asked.items()}
    return records | {"text": work.run("machine", *asked["frames"])}


@golden(relative=1e-10)
def _simulate(work: Work) -> Any:
    truth = work.folder / "truth.toml"
    truth.write_text(
        "schema = 1\n[parameters]\nC_XXX = 6e-5\nC_YYY = 4.5e-5\n[hyper_um]\nsigma = 0.12\n",
        encoding="utf-8",
    )
    asked = {
        "plan": ("plan", "--seed", 3),
        "truth": ("plan", "--truth", truth, "--degree", 0),
        "planes": ("three_planes", "--degree", 1),
        "both ways": ("both_ways", "--degree", 2, "--without", "discrepancy"),
    }
    records = {}
    for name, (campaign, *options) in asked.items():
        out = work.folder / f"simulated_{name.replace(' ', '_')}"
        records[name] = work.run(
            "simulate", work.campaign(campaign), *options, "--out", out, "--json"
        )
        tests = {
            test.name: {"angle_deg": test.angle_deg, "reading_um": test.reading_um}
            for test in lb.read_campaign(out).tests
        }
        records[name] |= {"tests": work.cleaned(tests)}
    return records


@golden(*CAMPAIGNS, fast=("two_radii",))
def _fit(work: Work, name: str) -> Any:
    """Independent draws: summary.json and model.toml, and what `summarize` prints."""
    out = work.fitted(name)
    record = work.cleaned(json.loads((out / "summary.json").read_text(encoding="utf-8")))
    if name not in ("two_radii", "both_ways"):
        record["fit"].pop("sensitivity", None)
        record.pop("nuisances", None)
    record["model"] = (out / "model.toml").read_text(encoding="utf-8").splitlines()
    if name == "both_ways":
        record["text"] = work.run("summarize", out, "--ci", 0.9)
    return record


@golden(*CAMPAIGNS)
def _marginals(work: Work, name: str) -> Any:
    """Where many compliances are truncated the processor chooses their order, and so the points of
    the sequence."""
    model = lb.HybridModel.first(int(name == "clocked"))
    if name in ("clocked", "three_planes"):
        model = model.without("truncation")
    return work.cleaned(lb.inference.marginalize(model, work.read(name), tolerance=0.02))


# The forecast of a plan is a median over possible machines whose scales are found by iteration: it
# differs by some 1e-7 between kernels.
@golden(*CAMPAIGNS, "plan", fast=("both_ways",))
def _identify(work: Work, name: str) -> Any:
    arguments = ("identify", work.campaign(name), "--degree", DEGREES.get(name, 1))
    record = work.run(*arguments, "--json")
    for entry in record["parameters"].values():
        if name != "arcs":
            entry.pop("shares")
        if name not in ("arcs", "both_ways"):
            entry.pop("confounding")
    if name in ("arcs", "plan"):
        record["text"] = work.run(*arguments)
    return record


@golden(slow=True)
def _compare_small(work: Work) -> Any:
    """Three circles and few nuisances: what is printed; the numbers are those of the next one."""
    out = work.folder / "compare_small"
    printed = work.run("compare", work.campaign("small"), *_FEW_NUISANCES, "--out", out, "--quiet")
    return printed | {"files": sorted(path.name for path in out.iterdir())}


@golden(slow=True)
def _compare_recovered(work: Work) -> Any:
    """comparison.json whole: the tests of pages and figures read it from here (fixture
    ``compared``)."""
    return work.plain(json.loads((work.compared / "comparison.json").read_text(encoding="utf-8")))


@golden(slow=True)
def _design(work: Work) -> Any:
    forces = ("--forces", "36:742:353", "--quiet")
    asked = {
        "tests": ("arcs", "--tests", 4, *forces),
        "clocked plan": (
            "plan",
            "--tests",
            3,
            *forces,
            "--clockings",
            "0/0,60/60",
            "--criterion",
            "a",
        ),
        "augmented": (
            "two_radii",
            "--tests",
            2,
            *forces,
            "--augment",
            "--criterion",
            "c",
            "--parameters",
            "C_XYX",
        ),
    }
    records = {}
    for name, (campaign, *options) in asked.items():
        answer = work.run("design", work.campaign(campaign), *options, "--json")
        if name != "tests":
            for key in ("baseline", "compared", "expected"):
                answer.pop(key, None)
        records[name] = answer
    return records | {"text": work.run("design", work.campaign("arcs"), *asked["tests"][1:])}


@golden()
def _validate(work: Work) -> Any:
    options = (
        "--degree",
        0,
        "--replicates",
        10,
        "--draws",
        19,
        "--sampler",
        "independent",
        "--workers",
        1,
        "--quiet",
        "--json",
    )
    return work.run("validate", work.campaign("plan"), *options)


@golden(slow=True)
def _meaning(work: Work) -> Any:
    """What the page of the recovered experiment does not hold: two directions, and how two results
    differ."""
    one, two, both_ways = (lb.load(work.fitted(name)) for name in ("arcs", "clocked", "both_ways"))
    results = {
        "circularity": lb.analysis.predict_circularity(both_ways, [0.0, 500.0]),
        "measured_circularity": lb.analysis.measure_circularity(both_ways),
        "differences": lb.analysis.compare_posteriors(one, two),
        "of one instrument": lb.analysis.compare_posteriors(
            both_ways, one, same_instrument=True
        ).iloc[::2],
    }
    return work.cleaned(results)


@golden("small", "recovered")
def _report(work: Work, name: str) -> Any:
    """The page as text, every number in it kept; rows, columns and means of the tables beside
    it."""
    result = work.fitted(name)
    out = work.folder / f"report_{name}"
    compared: tuple[object, ...] = ()
    if name == "recovered":
        compared = ("--comparison", work.compared)
    printed = work.run("report", result, "--out", out, "--quiet", *compared)
    tables = {}
    for path in sorted((out / "tables").iterdir()):
        table = pd.read_csv(path)
        sizes = table.select_dtypes("number").abs()
        tables[path.name] = {
            "rows": len(table),
            "columns": list(table.columns),
            "mean sizes": {column: float(sizes[column].mean()) for column in sizes},
        }
    return printed | {
        "page": work.text(_words((out / "report.html").read_text(encoding="utf-8"))),
        "tables": tables,
    }


def _words(page: str) -> str:
    """What a reader of the page sees, the drawings' paths left out."""
    page = re.sub(r"<(style|script|svg)\b.*?</\1>", "", page, flags=re.S)
    page = re.sub(
        r"<(?=/?(?:p|div|tr|li|h\d|table|section|figure|figcaption|summary|details|ul|ol)\b)",
        "\n<",
        page,
    )
    page = re.sub(r"</(?:td|th)>", " | ", page)
    return html.unescape(re.sub(r"<[^>]*>", "", page))


@golden(slow=True)
def _batch(work: Work) -> Any:
    out, printed = work.batch
    rows = lb.fleet.read_batch(out)
    columns = [
        name
        for name in rows.columns
        if "seconds" not in name and "sha256" not in name and name not in LEFT_OUT
    ]
    short = [
        name
        for name in columns
        if name.endswith((".mean", ".sd")) or name in ("name", "status", "reason", "converged")
    ]
    first = work.cleaned(rows[columns].iloc[:1])
    by_campaign = work.cleaned(rows[short])
    return {"said": printed, "columns": condensed(columns), "first": first, "rows": by_campaign}


@golden(slow=True)
def _trend(work: Work) -> Any:
    options = (
        work.batch[0],
        "--machine",
        "M1",
        "--parameters",
        "C_XXX,C_YYY",
        "--include-misfits",
        "--quiet",
    )
    return work.run("trend", *options, "--json") | {"text": work.run("trend", *options)}


@golden(slow=True)
def _population(work: Work) -> Any:
    options = (work.batch[0], "--parameters", "C_XXX,C_YYY,C_XYX", "--include-misfits", "--quiet")
    return work.run("population", *options, "--json") | {"text": work.run("population", *options)}


def make(name: str, work: Work) -> Any:
    """What the package answers now, as JSON reads it back."""
    with threadpool_limits(1, user_api="blas"):
        return json.loads(json.dumps(GOLDENS[name].answer(work), ensure_ascii=False))


def check(name: str, answer: Any) -> list[Difference]:
    """Differences from the file."""
    old = json.loads((HERE / f"{name}.json").read_text(encoding="utf-8"))
    return differences(old, answer, relative=GOLDENS[name].relative, rules=RULES)


def main() -> int:
    """Write or check; 1 where anything differs."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "names", nargs="*", metavar="NAME", help=f"of {', '.join(GOLDENS)}; default: all"
    )
    parser.add_argument(
        "--check", action="store_true", help="compare with the files instead of writing them"
    )
    options = parser.parse_args()
    failed = False
    with tempfile.TemporaryDirectory() as folder:
        work = Work(Path(folder).resolve())
        for name in options.names or GOLDENS:
            answer = make(name, work)
            print(name)
            if not options.check:
                (HERE / f"{name}.json").write_text(compact(answer) + "\n", encoding="utf-8")
                continue
            for path, old, new, relative in check(name, answer):
                print(f"    {path}: {old!r} -> {new!r} ({relative:.2g})")
                failed = True
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
