"""What the package answers today, kept as JSON, so that a rebuilding of its inside can be held against it.

python tests/goldens/make.py [NAME...]                   # writes the goldens
python tests/goldens/make.py --check [NAME...]           # lists what differs by more than rounding; exit code 1 where there is
python tests/goldens/make.py --check --exact [NAME...]   # … bit for bit
python tests/goldens/make.py --check --monte-carlo       # … where random numbers are drawn in another order

Only public names and the command line are used. Where these change on purpose, change `command_line`, INDEPENDENT and the goldens
themselves; every golden is one function below.
"""

from __future__ import annotations

import os

for _threads in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ[_threads] = "1"

import argparse  # noqa: E402
import dataclasses  # noqa: E402
import hashlib  # noqa: E402
import html  # noqa: E402
import io  # noqa: E402
import json  # noqa: E402
import math  # noqa: E402
import re  # noqa: E402
import resource  # noqa: E402
import sys  # noqa: E402
import tempfile  # noqa: E402
from collections.abc import Callable, Mapping, Sequence  # noqa: E402
from contextlib import chdir, redirect_stderr, redirect_stdout  # noqa: E402
from dataclasses import dataclass  # noqa: E402
from functools import cached_property  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import Any  # noqa: E402

import numpy as np  # noqa: E402
import pandas as pd  # noqa: E402
from threadpoolctl import threadpool_limits  # noqa: E402

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
STUDY = ROOT / "studies" / "10_files"
RECOVERED = ROOT / "data" / "recovered_experiment"
for _place in (HERE, STUDY):
    if str(_place) not in sys.path:
        sys.path.insert(0, str(_place))

import circles  # noqa: E402
from differences import Difference, Rule, compact, condensed, differences  # noqa: E402

import ldbb_bayes as lb  # noqa: E402

__all__ = ["GOLDENS", "Golden", "Work", "check", "make"]

INDEPENDENT = "independent"  # the sampler of independent exact draws, by the name it has
DEGREES = {"arcs": 1, "clocked": 2, "two_radii": 0, "both_ways": 1, "three_planes": 1}
# Depend on the code, the machine or the clock, not on the answer.
LEFT_OUT = {"seconds", "started", "versions", "platform", "provenance", "resumed", "toml", "stamp"}
MONTE_CARLO = 0.35
# What does not hold to 1e-10 on other processors (OPENBLAS_CORETYPE), and how far it does.
RULES = (
    # A choice between equals: to be mended by choosing with a tolerance.
    Rule(r"-lobe form .* with (minus )?as much .* looks exactly like", tie=True),
    Rule(r"^Expected intervals against equal steps: ", tie=True),
    Rule(r"against equal steps the interval of \S+ is then", tie=True),
    # Means and probabilities over draws times eigenvectors, whose signs are the processor's choice.
    Rule(r"/discrimination/", 5e-3, 1.0),
    Rule(r"misleading evidence as strong", 0.2),
    # Errors of numerical integrals, ranks of draws, derivatives by small differences.
    Rule(r"error(_um)?(/[\w/]+)?$|/pareto_k$", 1e-5),
    Rule(r"rhat", 1e-3),
    Rule(r"/sensitivity/", 1e-6, 1e-2),
    # Shares of a whole; loadings of unit vectors.
    Rule(r"/(confounding|shapley|\w*shares?|loadings|gain)(/|$)", 1e-9, 1.0),
    # Standard uncertainties of a truncated normal distribution, from points of a sequence.
    Rule(r"/(expected|baseline)/\w+/(floor_)?sd$", 1e-3),
    # Lengths shown in µm: less than 1e-9 µm is rounding, whatever stands around it.
    Rule(r"_um(/[\w/]+)?$", 1e-10, 10.0),
)
_WIDTH = "150"
_WORD_FOR_WORD = 3


def command_line(*arguments: object) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of ``ldbb-bayes``, run here: the one place that knows how to start it."""
    from ldbb_bayes.__main__ import run

    out, error, code = io.StringIO(), io.StringIO(), 0
    before = dict(os.environ), sys.argv
    os.environ.update(COLUMNS=_WIDTH, TERM="dumb", NO_COLOR="1")
    sys.argv = ["ldbb-bayes", *map(str, arguments)]
    try:
        with redirect_stdout(out), redirect_stderr(error):
            run()
    except SystemExit as left:
        code = left.code if isinstance(left.code, int) else int(left.code is not None)
    finally:
        sys.argv = before[1]
        os.environ.clear()
        os.environ.update(before[0])
    return code, out.getvalue(), error.getvalue()


class Work:
    """A folder with the campaigns, and what several goldens need, made when it is first asked for."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._fits: dict[str, Path] = {}

    def campaign(self, name: str) -> Path:
        """Folder of one of the five campaigns, of the plan, or of the recovered experiment."""
        if name == "recovered":
            return RECOVERED
        if name == "small":
            return self.small
        path = self.folder / name
        if not path.exists():
            circles.plan(path) if name == "plan" else circles.write_campaign(path, circles.CAMPAIGNS[name]())
        return path

    def model(self, name: str) -> lb.HybridModel:
        return lb.HybridModel.default(DEGREES.get(name, 1))

    def command(self, *arguments: object) -> tuple[int, str, str]:
        """As `command_line`, in the folder, its paths relative: how long they are must not break lines elsewhere."""
        inside = [own.relative_to(self.folder) if _is_in(own, self.folder) else own for own in arguments]
        with chdir(self.folder):
            return command_line(*inside)

    def run(self, *arguments: object) -> dict[str, Any]:
        """Exit code, and the text or the JSON that a command prints, without the place and the time of this run."""
        code, out, error = self.command(*arguments)
        if "--json" in arguments and out:
            return {"code": code} | self.cleaned(json.loads(out))
        said = {"stdout": self.text(out), "stderr": self.text(error)}
        return {"code": code} | {key: lines for key, lines in said.items() if lines}

    def fitted(self, name: str) -> Path:
        """A result of independent draws."""
        if name not in self._fits:
            out = self.folder / f"fit_{name}"
            ess = (
                500 if name == "two_radii" else 400
            )  # with 400 its R-hat is 1.0100, on either side of 1.01 after the last bit of a sum
            options = ["--degree", DEGREES.get(name, 1), "--sampler", INDEPENDENT, "--ess", ess, "--seed", 1, "--quiet"]
            options += ["--without", "discrepancy,hysteresis,setup-shift"] if name == "small" else []
            code, _, error = self.command("fit", self.campaign(name), *options, "--out", out)
            if not out.is_dir():
                raise RuntimeError(f"fit of {name} left with code {code}: {error}")
            self._fits[name] = out
        return self._fits[name]

    @cached_property
    def shop(self) -> list[Path]:
        """Small campaigns of several machines."""
        return circles.fleet(self.folder / "shop")

    @cached_property
    def small(self) -> Path:
        """The first of them."""
        return self.shop[0]

    @cached_property
    def compared(self) -> Path:
        """What `compare` writes of the recovered experiment."""
        out = self.folder / "compare_recovered"
        code, _, error = self.command("compare", RECOVERED, "--out", out, "--quiet")
        if not out.is_dir():
            raise RuntimeError(f"compare left with code {code}: {error}")
        return out

    @cached_property
    def batch(self) -> tuple[Path, dict[str, Any]]:
        """A batch of ten small campaigns, one of them not there, and what the command said."""
        paths, out = self.shop, self.folder / "batch"
        model = ("--degree", 1, "--without", "hysteresis,discrepancy,setup-shift")
        options = ("--sampler", INDEPENDENT, "--ess", 400, "--workers", 1, "--seed", 1, "--quiet", "--json")
        said = self.run("batch", *paths, self.folder / "shop" / "missing", *model, *options, "--out", out)
        return out, said

    def text(self, text: str) -> list[str]:
        """Lines without the places, times and versions of this run."""
        for place, name in ((self.folder, "<work>"), (ROOT, "<project>")):
            text = text.replace(f"{place}/", f"{name}/").replace(str(place), name)
        text = re.sub(r"\b[\d.]+ s\b(?=[.:]?$|: )", "# s", text, flags=re.M)
        text = re.sub(r"python -m \S*ldbb-bayes", "ldbb-bayes", text)
        text = re.sub(r"with ldbb_bayes \S+", "with ldbb_bayes #", text)
        text = re.sub(r"\d{4}-\d\d-\d\dT(?!00:00:00)[\d:.]+(\+[\d:]+|Z)?", "<time>", text)
        return [" ".join(line.split()) for line in text.splitlines() if line.strip()]

    def cleaned(self, value: Any) -> Any:
        """Plain and condensed: what depends on the answer."""
        return condensed(self.plain(value))

    def plain(self, value: Any) -> Any:
        """What depends on the answer, as JSON has it."""
        if isinstance(value, Mapping):
            return {str(key): self.plain(own) for key, own in value.items() if key not in LEFT_OUT and not _is_code(str(key))}
        if isinstance(value, (list, tuple)):
            return [self.plain(own) for own in value]
        if isinstance(value, np.ndarray):
            return self.plain(value.tolist())
        if isinstance(value, (pd.DataFrame, pd.Series)):
            frame = value.to_frame() if isinstance(value, pd.Series) else value
            rows = frame.to_dict(orient="split")
            cells = [dict(zip(map(str, rows["columns"]), row, strict=True)) for row in rows["data"]]
            names = ["/".join(map(str, name)) if isinstance(name, tuple) else str(name) for name in rows["index"]]
            return self.plain([{"row": name} | row for name, row in zip(names, cells, strict=True)])
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            return self.plain({own.name: getattr(value, own.name) for own in dataclasses.fields(value)})
        if isinstance(value, np.generic):
            return self.plain(value.item())
        if isinstance(value, str):
            return "\n".join(self.text(value))
        if value is None or isinstance(value, (bool, int, float)):
            return None if value is pd.NaT else value
        return str(value)


def _is_in(path: object, folder: Path) -> bool:
    return isinstance(path, Path) and path.is_relative_to(folder)


def _is_code(key: str) -> bool:
    """Digests of models and of results change with their form."""
    return key in {"sha256", "model_sha256"}


def densities(posterior: Any) -> dict[str, Any]:
    """Names and number of all draws; mean and sd of the densities beside them (what summary.json does not hold)."""
    found: dict[str, Any] = {"names": {group: list(map(str, posterior[group].data_vars)) for group in ("posterior", "prior")}}
    found["shape"] = list(next(iter(posterior["posterior"].data_vars.values())).shape)
    for group in ("log_prior", "log_likelihood", "sample_stats"):
        for name, values in posterior[group].data_vars.items():
            array = np.asarray(values, dtype=float)
            parts = array.reshape(-1, array.shape[-1]).T if group == "log_likelihood" else array.reshape(1, -1)
            found[f"{group}/{name}"] = [{"mean": float(own.mean()), "sd": float(own.std())} for own in parts]
    return found


@dataclass(frozen=True)
class Golden:
    """One file: what makes it, whether it is quick, and how closely it can be held.

    Attributes
    ----------
    slow : bool
        Not in the fast tests.
    drawn : bool
        Rests on random draws: ``--monte-carlo`` holds it only to their error.
    chaotic : bool
        A Markov chain, which takes another way after the last bit of a sum: always held to Monte-Carlo error but for --exact.
    relative : float
        Largest relative difference that is rounding.
    """

    answer: Callable[[Work], Any]
    slow: bool = False
    drawn: bool = False
    chaotic: bool = False
    relative: float = 1e-10


# Where the mode of the hyper-parameters was found by Newton steps, and quantiles by bisection.
FOUND = 2e-8

GOLDENS: dict[str, Golden] = {}


def golden(name: str, *given: object, **kept: Any) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Register a function as the golden of that name; further arguments are handed to it."""

    def register(function: Callable[..., Any]) -> Callable[..., Any]:
        GOLDENS[name] = Golden(lambda work: function(work, *given), **kept)
        return function

    return register


def of_each(
    stem: str, names: Sequence[str], fast: Sequence[str] = (), **kept: Any
) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """One golden for each campaign; slow but for those named."""

    def register(function: Callable[..., Any]) -> Callable[..., Any]:
        for name in names:
            golden(f"{stem}_{name}", name, slow=name not in fast, **kept)(function)
        return function

    return register


# What was measured.


@golden("check")
def _check(work: Work) -> Any:
    names = (*circles.CAMPAIGNS, "plan", "recovered")
    said = {name: work.run("check", work.campaign(name), "--json") for name in names}
    for own in said.values():
        own["tests"] = own["tests"][::2]
    return {
        "json": said,
        "digests": {name: lb.read_campaign(work.campaign(name)).sha256 for name in names},
        "text": {name: work.run("check", work.campaign(name), "--no-sketch") for name in ("both_ways", "plan")},
    }


@golden("prepare")
def _prepare(work: Work) -> Any:
    test = lb.read_campaign(work.campaign("arcs")).tests[2]
    raw = dataclasses.replace(
        lb.read_campaign(work.campaign("arcs")), mount=lb.MountCompensation(deflection_um_per_bar=2.0, compensated=False)
    )
    return {
        "mask_angles": _trace(lb.mask_angles(test, [(20.0, 50.0), (350.0, 10.0)])),
        "mask_reversals": _trace(lb.mask_reversals(test, 7.5)),
        "trim_overshoot": _trace(lb.trim_overshoot(test, arc_deg=200.0)),
        "trim_from": _trace(lb.trim_overshoot(test, start_deg=70.0, arc_deg=190.0)),
        "compensate_mount": [_trace(own) for own in lb.compensate_mount(raw).tests],
        "force_law": [lb.ForceLaw().force_N(1.5), lb.ForceLaw().pressure_bar(400.0)],
    }


def _trace(test: lb.CircularTest) -> Any:
    return condensed({"angle_deg": np.asarray(test.angle_deg).tolist(), "reading_um": np.asarray(test.reading_um).tolist()})


@golden("import_awkward")
def _import_awkward(work: Work) -> Any:
    """Of every accepted file: digest of the campaign, what its layout says, and what was taken for granted."""
    import awkward

    found = {}
    for name, case in awkward.CASES.items():
        folder = work.folder / "awkward" / name
        folder.mkdir(parents=True, exist_ok=True)
        for file, content in case.files.items():
            (folder / file).write_bytes(content)
        files = [folder / file for file in case.files]
        said = work.run("import", *files, "--out", folder / "campaign", *case.options, "--json", "--force")
        read = lb.read_campaign(folder / "campaign")
        text = " ".join(json.dumps(said.pop("assumptions", None), ensure_ascii=False).split())
        traces = {test.name: _summary(test) for test in read.tests}
        found[name] = said | {"assumptions": hashlib.sha256(text.encode()).hexdigest()[:16], "tests": traces}
        if len(found) <= _WORD_FOR_WORD:
            found[name]["assumed"] = text
    return found


def _summary(test: lb.CircularTest) -> list[Any]:
    angle, reading = np.round(test.angle_deg, 9), np.round(np.asarray(test.reading_um), 9)
    digest = hashlib.sha256(np.concatenate([angle, reading]).astype("<f8").tobytes()).hexdigest()[:16]
    return [test.force_N, test.pressure_bar, test.direction, len(angle), float(angle[0]), float(reading.sum()), digest]


@golden("import_malformed")
def _import_malformed(work: Work) -> Any:
    """Of every refused file: the message."""
    import malformed

    found = {}
    for name, case in malformed.CASES.items():
        folder = work.folder / "malformed" / re.sub(r"\W", "_", name)
        folder.mkdir(parents=True, exist_ok=True)
        (folder / case.file).write_bytes(case.content)
        code, out, error = work.command("import", folder / case.file, "--out", folder / "campaign", *case.options)
        said = " ".join((out + error).split()).replace(f"{folder.relative_to(work.folder)}/", "")
        found[name] = {"code": code, "message": said, "written": sorted({own.name for own in folder.iterdir()} - {case.file})}
    return found


@golden("refusals")
def _refusals(work: Work) -> Any:
    """What the command line refuses, and how."""
    arcs, plan, missing = work.campaign("arcs"), work.campaign("plan"), work.folder / "nothing"
    asked = {
        "no such campaign": ("fit", missing),
        "a plan": ("fit", plan),
        "a plan compared": ("compare", plan),
        "degree": ("fit", arcs, "--degree", 3),
        "degree 0 compared": ("compare", arcs, "--degree", 0),
        "preset": ("fit", arcs, "--preset", "papr"),
        "sampler": ("fit", arcs, "--sampler", "gibbs"),
        "interval": ("fit", arcs, "--ci", 95),
        "leave out": ("compare", arcs, "--leave-out", "reading"),
        "criterion": ("design", arcs, "--criterion", "x"),
        "forces": ("design", arcs, "--forces", "700:100:1"),
        "parameter": ("design", arcs, "--tests", 3, "--parameters", "C_XXZ"),
        "topology": ("machine", "wXYZ"),
        "plane": ("machine", "wCAFYXZSt", "--plane", "XW"),
        "options of a table": ("check", arcs, "--radius-mm", 100),
        "replicates": ("validate", plan, "--replicates", 2),
        "no batch": ("trend", arcs),
        "no result": ("summarize", arcs),
        "model": ("fit", arcs, "--model", arcs / "campaign.toml"),
    }
    return {name: work.run(*arguments) for name, arguments in asked.items()}


# What the machine is.


@golden("machine")
def _machine(work: Work) -> Any:
    asked = {
        "one plane": ("wCAFYXZSt",),
        "three planes": ("wCAFYXZSt", "--plane", "XY,YZ,ZX"),
        "frames": ("wCAFYXZSt", "--frame", "Y=0,-200,350", "--centre", "100,0,0"),
        "other chain": ("wXYFZt", "--plane", "XY,ZX"),
        "table": ("wYXFZt", "--plane", "YZ"),
    }
    found = {name: work.run("machine", *arguments, "--json") for name, arguments in asked.items()}
    return found | {"text": work.run("machine", *asked["frames"])}


@golden("formulas")
def _formulas(work: Work) -> Any:
    """Exact model, Jacobian and patterns of four machines and planes."""
    angle = np.deg2rad(np.arange(0.0, 360.0, 15.0) + 1.0)
    found = {}
    for topology, plane, radius in (
        ("wCAFYXZSt", "XY", 150.0),
        ("wCAFYXZSt", "ZX", 100.0),
        ("wXYFZt", "YZ", 150.0),
        ("wZYFXt", "XY", 80.0),
    ):
        machine, circle = lb.Machine(topology), lb.Circle(plane=plane, radius_mm=radius)
        jacobian = lb.hybrid_jacobian(machine, circle, angle, 500.0, degree=2, reference_force_N=389.0)
        names = {kind: [own for own in jacobian.columns if own.startswith(kind) and own.count("_") < 3] for kind in "CE"}
        compliances = {own: 1e-8 * (k + 1) for k, own in enumerate(names["C"]) if not own[-1].isdigit()}
        errors = {own: 1e-7 * (k + 1) for k, own in enumerate(names["E"])}
        exact = lb.exact_reading_mm(machine, circle, angle, force_N=500.0, compliances=compliances, geometric_errors=errors)
        found[f"{topology} {plane}"] = {
            "jacobian": _columns(jacobian),
            "patterns": _columns(lb.patterns(machine, circle, angle).iloc[:, ::2]),
            "exact_reading_mm": condensed(np.asarray(exact).tolist()),
        }
    return found


def _columns(frame: pd.DataFrame) -> dict[str, Any]:
    return {str(name): condensed([float(value) for value in frame[name]]) for name in frame.columns}


@golden("simulate", drawn=True)
def _simulate(work: Work) -> Any:
    truth = work.folder / "truth.toml"
    truth.write_text("schema = 1\n[parameters]\nC_XXX = 6e-5\nC_YYY = 4.5e-5\n[hyper_um]\nsigma = 0.12\n", encoding="utf-8")
    asked = {
        "plan": (work.campaign("plan"), "--seed", 3),
        "truth": (work.campaign("plan"), "--truth", truth, "--degree", 0),
        "planes": (work.campaign("three_planes"), "--degree", 1),
        "both ways": (work.campaign("both_ways"), "--degree", 2, "--without", "discrepancy"),
    }
    found = {}
    for name, arguments in asked.items():
        out = work.folder / f"simulated_{name.replace(' ', '_')}"
        said = work.run("simulate", *arguments, "--out", out, "--force", "--json")
        found[name] = said | {"tests": {own.name: _trace(own) for own in lb.read_campaign(out).tests}}
    return found


# What follows.


@of_each("fit", list(circles.CAMPAIGNS), fast=("two_radii",), drawn=True, relative=FOUND)
def _fit(work: Work, name: str) -> Any:
    """Independent draws: summary.json, moments of the draws, and what `summarize` prints."""
    out = work.fitted(name)
    said = work.cleaned(json.loads((out / "summary.json").read_text(encoding="utf-8")))
    if name not in ("two_radii", "both_ways"):
        said["fit"].pop("sensitivity", None)
        said.pop("nuisances", None)
    said |= {"densities": densities(lb.load(out)), "model": (out / "model.toml").read_text(encoding="utf-8").splitlines()}
    return said | ({"text": work.run("summarize", out, "--ci", 0.9)} if name == "both_ways" else {})


@of_each("joint", ["arcs", "clocked"], drawn=True, chaotic=True)
def _joint(work: Work, name: str) -> Any:
    """emcee, with few steps."""
    out = work.folder / f"joint_{name}"
    options = ("--degree", 0, "--ess", 400, "--max-steps", 1200, "--seed", 1, "--quiet", "--force", "--out", out, "--json")
    return work.run("fit", work.campaign(name), *options) | {"densities": densities(lb.load(out))}


@golden("evidence", slow=True, relative=FOUND)
def _evidence(work: Work) -> Any:
    """By quadrature: no draws."""
    found = {}
    for name in circles.CAMPAIGNS:
        campaign = lb.read_campaign(work.campaign(name))
        models = {"constant": lb.HybridModel.default(0), "linear": lb.HybridModel.default(1).without("truncation")}
        found[name] = {key: lb.log_evidence(model, campaign, tolerance=0.02) for key, model in models.items()}
    return work.cleaned(found)


@golden("least_squares")
def _least_squares(work: Work) -> Any:
    found = {}
    for name, degree in (("arcs", 0), ("clocked", 1), ("two_radii", 0), ("recovered", 1)):
        squares = lb.least_squares(lb.read_campaign(work.campaign(name)), degree=degree)
        found[name] = {"table": squares.table, "quality": squares.quality, "predicted_um": squares.predicted_um}
    return work.cleaned(found)


@of_each("marginals", list(circles.CAMPAIGNS), relative=FOUND)
def _marginals(work: Work, name: str) -> Any:
    """By quadrature: no draws."""
    model = lb.HybridModel.default(1).without("truncation") if name == "clocked" else lb.HybridModel.default(0)
    return work.cleaned(lb.marginals(model, lb.read_campaign(work.campaign(name)), tolerance=0.02))


# What it means.


@of_each("identify", [*circles.CAMPAIGNS, "plan"], fast=("arcs", "both_ways", "plan"), relative=FOUND)
def _identify(work: Work, name: str) -> Any:
    arguments = ("identify", work.campaign(name), "--degree", DEGREES.get(name, 1))
    found = work.run(*arguments, "--json")
    for own in found["parameters"].values():
        own.pop("sensitivity", None)
        own.pop("correlations", None)
        if name != "arcs":
            for key in ("shapley", *(["confounding", "overlap"] if name != "both_ways" else [])):
                own.pop(key, None)
    for own in found["directions"][4 if name == "arcs" else 0 :]:
        own.pop("loadings", None)  # arbitrary where directions are worth the same
    return found | ({"text": work.run(*arguments)} if name in ("arcs", "plan") else {})


@golden("compare_small", slow=True, drawn=True, relative=FOUND)
def _compare_small(work: Work) -> Any:
    """Three circles and few nuisances: what is printed, and what is written."""
    out = work.folder / "compare_small"
    without = ("--without", "discrepancy,hysteresis,setup-shift")
    said = work.run("compare", work.small, *without, "--out", out, "--force", "--quiet")
    return said | {"json": _comparison(work, out), "files": sorted(own.name for own in out.iterdir())}


@golden("compare_recovered", slow=True, drawn=True, relative=FOUND)
def _compare_recovered(work: Work) -> Any:
    """comparison.json whole: the tests of pages and figures read it from here (fixture ``compared``)."""
    return work.plain(json.loads((work.compared / "comparison.json").read_text(encoding="utf-8")))


def _comparison(work: Work, out: Path) -> Any:
    """comparison.json without what is long and stands in other goldens."""
    record = json.loads((out / "comparison.json").read_text(encoding="utf-8"))
    found = work.cleaned(record)
    for own in found["tests"].values():
        own.pop("without_it", None)
    for own in found["models"].values():
        own.pop("compliance_against_force", None)
    found.pop("local_fits", None)
    found.pop("slope_subsets", None)
    for own in record["slope_subsets"][:12]:
        slopes = "+".join(name for name, power in own["powers"].items() if power)
        best = {"slopes": slopes, "log_evidence": own["log_evidence"], "probability": own["probability"]}
        found.setdefault("best_slope_subsets", []).append(best)
    return found


@golden("design", slow=True, drawn=True, relative=FOUND)
def _design(work: Work) -> Any:
    forces = ("--forces", "36:742:353", "--quiet")
    asked = {
        "tests": ("arcs", "--tests", 4, *forces),
        "clocked plan": ("plan", "--tests", 3, *forces, "--clockings", "0/0,60/60", "--criterion", "a"),
        "budget": ("arcs", "--budget", 5, *forces, "--cost-circle", 1, "--cost-work-ball", 0.5, "--clockings", "0,90"),
        "augmented": ("two_radii", "--tests", 2, *forces, "--augment", "--criterion", "c", "--parameters", "C_XYX"),
    }
    found = {}
    for name, (campaign, *options) in asked.items():
        found[name] = work.run("design", work.campaign(campaign), *options, "--json")
        if name != "tests":
            for key in ("baseline", "compared", *(["expected"] if name in ("augmented", "clocked plan") else [])):
                found[name].pop(key, None)
    text = work.run("design", work.campaign("arcs"), *asked["tests"][1:])
    return found | {"text": text}


@golden("validate", drawn=True, relative=FOUND)
def _validate(work: Work) -> Any:
    options = ("--degree", 0, "--replicates", 10, "--draws", 19, "--sampler", INDEPENDENT, "--workers", 1, "--quiet", "--json")
    return work.run("validate", work.campaign("plan"), *options)


@golden("meaning", slow=True, drawn=True, relative=FOUND)
def _meaning(work: Work) -> Any:
    """Budgets, circularity, contributions, nuisances and verdicts of fits, and how two differ."""
    one, two = lb.load(work.fitted("arcs")), lb.load(work.fitted("clocked"))
    ways = lb.load(work.fitted("both_ways"))
    found = {
        "budgets": {name: own.as_dict() for name, own in list(lb.budgets(one).items())[::8]},
        "circularity": lb.circularity(ways, [0.0, 500.0]),
        "measured_circularity": lb.measured_circularity(ways),
        "contributions": lb.contributions(one).iloc[::2],
        "nuisances": lb.nuisances(one).iloc[::2],
        "verdicts": {
            name: {"verdict": str(own.verdict), "with": own.partners, "sd": own.sd, "contraction": own.contraction}
            for name, own in lb.verdicts(two).items()
        },
        "summary": str(lb.fit_in_words(ways)["verdict"]),
        "differences": lb.differences(one, two),
        "of one instrument": lb.differences(ways, lb.load(work.fitted("arcs")), same_instrument=True).iloc[::2],
    }
    return work.cleaned(found)


@golden("local_fits", slow=True, relative=FOUND)
def _local_fits(work: Work) -> Any:
    found = lb.local_fits(work.model("arcs"), lb.read_campaign(work.campaign("arcs")))
    return {"rows": len(found), "every third": work.cleaned(found.iloc[::3])}


# What one shows.


@golden("report_small", slow=True, drawn=True, relative=FOUND)
def _report_small(work: Work) -> Any:
    """Three circles and few nuisances; the comparison left to the report."""
    return _page(work, work.fitted("small"))


@golden("report_recovered", slow=True, drawn=True, relative=FOUND)
def _report_recovered(work: Work) -> Any:
    return _page(work, work.fitted("recovered"), "--comparison", work.compared)


def _page(work: Work, result: Path, *options: object) -> Any:
    """The page as text, every number in it kept; rows, columns and means of the tables beside it."""
    out = result.with_name(result.name.replace("fit", "report"))
    said = work.run("report", result, "--out", out, "--force", "--quiet", *options)
    tables = {}
    for path in sorted((out / "tables").iterdir()):
        table = pd.read_csv(path)
        means = {name: float(np.abs(own).mean()) for name, own in table.select_dtypes("number").items()}
        tables[path.name] = {"rows": len(table), "columns": list(table.columns), "mean sizes": means}
    return said | {"page": work.text(_words((out / "report.html").read_text(encoding="utf-8"))), "tables": tables}


def _words(page: str) -> str:
    """What a reader of the page sees, the drawings' paths left out."""
    page = re.sub(r"<(style|script)\b.*?</\1>", "", page, flags=re.S)
    page = re.sub(r"<svg\b.*?</svg>", "", page, flags=re.S)
    page = re.sub(r"<(?=/?(?:p|div|tr|li|h\d|table|section|figure|figcaption|summary|details|ul|ol)\b)", "\n<", page)
    page = re.sub(r"</(?:td|th)>", " | ", page)
    return html.unescape(re.sub(r"<[^>]*>", "", page))


# Many of them.


@golden("batch", drawn=True, relative=FOUND)
def _batch(work: Work) -> Any:
    out, said = work.batch
    rows = lb.read_batch(out)
    columns = [name for name in rows.columns if "seconds" not in name and "sha256" not in name and name not in LEFT_OUT]
    short = [name for name in columns if name.endswith((".mean", ".sd")) or name in ("name", "status", "reason", "converged")]
    return {
        "said": said,
        "columns": condensed(columns),
        "first": work.cleaned(rows[columns].iloc[:1]),
        "rows": work.cleaned(rows[short]),
    }


@golden("trend", drawn=True, relative=FOUND)
def _trend(work: Work) -> Any:
    out, _ = work.batch
    options = ("--machine", "M1", "--parameters", "C_XXX,C_YYY", "--include-misfits", "--quiet")
    return work.run("trend", out, *options, "--json") | {"text": work.run("trend", out, *options)}


@golden("population", drawn=True, relative=FOUND)
def _population(work: Work) -> Any:
    out, _ = work.batch
    options = ("--parameters", "C_XXX,C_YYY,C_XYX", "--include-misfits", "--quiet")
    return work.run("population", out, *options, "--json") | {"text": work.run("population", out, *options)}


def make(name: str, work: Work) -> Any:
    """What the package answers now, as JSON reads it back."""
    with threadpool_limits(1, user_api="blas"):
        return json.loads(json.dumps(GOLDENS[name].answer(work), ensure_ascii=False))


def check(name: str, answer: Any, *, exact: bool = False, monte_carlo: bool = False) -> list[Difference]:
    """Differences from the file."""
    own = GOLDENS[name]
    old = json.loads(file_of(name).read_text(encoding="utf-8"))
    if exact:
        return differences(old, answer, relative=0.0)
    loose = own.chaotic or (monte_carlo and own.drawn)
    return differences(old, answer, relative=own.relative, monte_carlo=MONTE_CARLO if loose else 0.0, rules=RULES)


def file_of(name: str) -> Path:
    return HERE / f"{name}.json"


def main() -> int:
    """Write or check; 1 where anything differs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(GOLDENS)}; default: all")
    parser.add_argument("--check", action="store_true", help="compare with the files instead of writing them")
    parser.add_argument("--exact", action="store_true", help="bit for bit")
    parser.add_argument("--monte-carlo", action="store_true", help="hold what is drawn at random to its Monte-Carlo error only")
    parser.add_argument("--into", type=Path, metavar="DIR", help="write into another folder, which is there")
    parser.add_argument("--fast", action="store_true", help="without the slow ones")
    parser.add_argument("--most", type=int, default=20, help="differences listed of each (default 20)")
    given = parser.parse_args()
    if unknown := set(given.names) - set(GOLDENS):
        parser.error(f"no golden of the name {', '.join(sorted(unknown))}")
    names = given.names or [name for name, own in GOLDENS.items() if not (given.fast and own.slow)]
    failed, spent = [], 0.0
    with tempfile.TemporaryDirectory() as folder:
        work = Work(Path(folder).resolve())
        for name in names:
            before = _cpu_seconds()
            try:
                answer = make(name, work)
            except Exception as error:  # noqa: BLE001 - what breaks one golden must not hide the others
                failed.append(name)
                _say(f"{name:24} BROKEN {type(error).__name__}: {error}")
                continue
            seconds = _cpu_seconds() - before
            spent += seconds
            if not given.check:
                path = (given.into or HERE) / f"{name}.json"
                path.write_text(compact(answer) + "\n", encoding="utf-8")
                _say(f"{name:24} {seconds:6.1f} s  {path.stat().st_size / 1e3:6.1f} kB")
                continue
            found = check(name, answer, exact=given.exact, monte_carlo=given.monte_carlo)
            largest = max((own.relative for own in found), default=0.0)
            _say(f"{name:24} {seconds:6.1f} s  {f'{len(found)} differences, largest {largest:.2g}' if found else 'the same'}")
            for own in found[: given.most]:
                _say(
                    f"    {own.path}: {own.old!r} -> {own.new!r}"
                    + (f" ({own.relative:.2g})" if math.isfinite(own.relative) else "")
                )
            if found:
                failed.append(name)
    size = sum(own.stat().st_size for own in HERE.glob("*.json"))
    _say(f"{len(names)} goldens, {spent:.0f} CPU s, all files {size / 1e3:.0f} kB; different: {', '.join(failed) or 'none'}")
    return int(bool(failed))


def _cpu_seconds() -> float:
    own, others = resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN)
    return own.ru_utime + own.ru_stime + others.ru_utime + others.ru_stime


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
