"""Nothing is decided by reading a sentence: every function of report/wording.py reworded, all
decisions and numbers stay."""

from __future__ import annotations

import hashlib
import json
import re
import sys
import tomllib
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from campaigns import plan, simulated
from fleets import drawn_rows
from reports import undrawn
from typer.testing import CliRunner

import ldbb_bayes as lb
from ldbb_bayes.analysis.aliases import StandingKind
from ldbb_bayes.analysis.comparison import Sign
from ldbb_bayes.analysis.cures import Cure
from ldbb_bayes.campaign.preview import RemarkKind
from ldbb_bayes.cli import app
from ldbb_bayes.fleet.campaign_row import Job, Settings, fit_row
from ldbb_bayes.fleet.selection import CaveatKind, choose
from ldbb_bayes.inference.fit import ConcernKind
from ldbb_bayes.model.specification import model_to_toml
from ldbb_bayes.report import wording
from ldbb_bayes.report.findings import find
from ldbb_bayes.report.page import compose
from ldbb_bayes.report.pictures import Picture
from ldbb_bayes.report.sections import Details
from ldbb_bayes.results import Table, json_text

MODEL = lb.HybridModel.first(1)
QUICK = lb.StoppingRule(ess=100.0)
FORCES_N = (36.0, 400.0, 742.0)
TEMPLATES = Path(wording.__file__).parent / "templates"


def hashed(value: Any) -> Any:
    """Every text of what a function returns, unreadable."""
    if isinstance(value, str):
        return f"#{hashlib.sha256(value.encode()).hexdigest()[:12]}" if value else value
    if value is None or isinstance(value, dict | int | float):
        return value
    hashed_items = [hashed(item) for item in value]
    if isinstance(value, tuple | list):
        return type(value)(hashed_items)
    return iter(hashed_items)


def reworded(function: Callable[..., Any]) -> Callable[..., Any]:
    @wraps(function)
    def answer(*arguments: Any, **options: Any) -> Any:
        return hashed(function(*arguments, **options))

    return answer


def reword(monkeypatch: pytest.MonkeyPatch) -> int:
    """Put it in the place of every public function of the module, wherever it was imported to."""
    changed = 0
    originals = {
        getattr(wording, name)
        for name in wording.__all__
        if callable(getattr(wording, name)) and name != "with_words"
    }
    for name, module in list(sys.modules.items()):
        if name.startswith("ldbb_bayes"):
            for key, value in list(vars(module).items()):
                if callable(value) and type(value).__name__ == "function" and value in originals:
                    monkeypatch.setattr(module, key, reworded(value))
                    changed += 1
    return changed


def same(plain: Any, other: Any, where: str = "") -> int:
    """Whether two records differ in sentences alone; how many do."""
    if isinstance(plain, str) and isinstance(other, str):
        assert plain == other or "#" in other, (where, plain, other)
        return int(plain != other)
    assert type(plain) is type(other), (where, plain, other)
    if isinstance(plain, dict):
        assert list(plain) == list(other), where
        return sum(same(plain[key], other[key], f"{where}.{key}") for key in plain)
    if isinstance(plain, list | tuple):
        assert len(plain) == len(other), (where, plain, other)
        pairs = enumerate(zip(plain, other, strict=True))
        return sum(same(one, two, f"{where}[{index}]") for index, (one, two) in pairs)
    assert plain == other, (where, plain, other)
    return 0


@pytest.fixture(scope="module")
def campaigns() -> dict[str, lb.Campaign]:
    """Readings that the model expects, and readings that no compliance explains."""
    good = simulated(plan((40,) * 3, forces_N=FORCES_N))
    tests = []
    for test in good.tests:
        tests.append(test.with_reading_um(-0.14 * np.asarray(test.reading_um)))
    return {"good": good, "turned": lb.Campaign(tuple(tests), name="turned")}


@pytest.fixture(scope="module")
def turned(campaigns: dict[str, lb.Campaign]) -> xr.DataTree:
    return lb.sample(
        lb.HybridModel.first(0), campaigns["turned"], seed=1, sampler="independent", rule=QUICK
    )


@pytest.fixture(scope="module")
def folders(
    campaigns: dict[str, lb.Campaign], tmp_path_factory: pytest.TempPathFactory
) -> dict[str, Path]:
    return {
        name: lb.write_campaign(campaign, tmp_path_factory.mktemp("campaigns") / name)
        for name, campaign in campaigns.items()
    }


def plain_json(record: Any) -> Any:
    return json.loads(json_text({"record": record}))


def part_of(block: Any) -> Any:
    if isinstance(block, Table):
        return [block.caption, list(block.heads), [list(row) for row in block.shown()]]
    if isinstance(block, Picture):
        return [block.key, block.caption]
    if isinstance(block, Details):
        return [block.summary, [part_of(item) for item in block.content]]
    return block


def page_of(posterior: xr.DataTree) -> Any:
    """Alerts, sections and what stands in them."""
    document = compose(
        find(posterior, comparison="left out in this test", recommended="left out in this test")
    )
    sections = []
    for section in document.sections:
        content = [part_of(block) for block in section.content]
        sections.append([section.key, section.title, content])
    return [list(document.alerts), sections]


def analyses_of(campaign: lb.Campaign) -> Any:
    models = {"constant": MODEL.with_degree(0), "linear": MODEL}
    results = [
        lb.preview(campaign),
        lb.identify(MODEL, campaign),
        lb.compare(models, campaign, evidence_only=True),
    ]
    results.append(lb.design(MODEL, pilot=campaign, tests=2, forces_N=FORCES_N))
    return plain_json([wording.with_words(result) for result in results])


def rows_of(folders: dict[str, Path]) -> Any:
    """Rows of a batch, and which of its campaigns are relied on."""
    settings = Settings(model_to_toml(lb.HybridModel.first(0)), ess=100.0)
    rows = [
        fit_row(settings, Job(k, str(folder), str(folder)))
        for k, folder in enumerate(folders.values())
    ]
    relied, caveats = choose(pd.DataFrame(rows))
    assert list(relied["campaign"]) == [str(folders["good"])]
    kinds_and_names = [[str(caveat.kind), caveat.names] for caveat in caveats]
    return plain_json([rows, list(relied["campaign"]), kinds_and_names])


def population_of() -> Any:
    """Of eight campaigns, two of one machine; one campaign that the model does not expect, one not
    converged."""
    rows = drawn_rows(8, np.random.default_rng(6)).assign(
        machine_id=[f"M{m}" for m in range(7)] + ["M6"]
    )
    doubtful = rows.assign(
        kinds=[[], ["truncation"], ["noise"], *[[]] * 5], converged=[True] * 7 + [False]
    )
    pooled = lb.population(doubtful)
    assert "M1" not in pooled.machine
    return plain_json({**wording.with_words(pooled), "sha256": None})


def fits_of(folder: Path) -> Any:
    """What the command prints and its exit code: a target missed, one reached, bad input."""
    model = ("--degree", "0", "--without", "discrepancy,setup-shift")
    fit = ["fit", str(folder), *model, "--sampler", "independent", "--json", "--quiet"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("ldbb_bayes.inference.mcmc.Assessment.meets", lambda *_, **__: False)
        runs = [CliRunner().invoke(app, [*fit, "--max-steps", "400"])]
    runs += [
        CliRunner().invoke(app, [*fit, *options]) for options in (["--ess", "600"], ["--ci", "2"])
    ]
    codes = [run.exit_code for run in runs]
    assert codes == [1, 0, 2]
    records = [json.loads(run.stdout) | {"provenance": None} for run in runs[:2]]
    for record in records:
        record["sampler"]["seconds"] = None
    return [codes, records]


@pytest.mark.parametrize(
    "analysis",
    [pytest.param("analyses", marks=pytest.mark.slow), "page", "rows", "population", "fits"],
)
def test_words_decide_nothing(
    analysis: str,
    campaigns: dict[str, lb.Campaign],
    folders: dict[str, Path],
    monkeypatch: pytest.MonkeyPatch,
    request: pytest.FixtureRequest,
) -> None:
    """Decisions, numbers, exit codes and campaigns left out; of a campaign that the model expects
    and one that it does not."""
    undrawn(monkeypatch)
    work: dict[str, Callable[[], Any]] = {
        "analyses": lambda: analyses_of(campaigns["good"]),
        "page": lambda: page_of(request.getfixturevalue("turned")),
        "rows": lambda: rows_of(folders),
        "population": population_of,
        "fits": lambda: fits_of(folders["good"]),
    }
    plain = work[analysis]()
    assert reword(monkeypatch) > 30
    assert same(plain, work[analysis]()) >= 5


@pytest.mark.parametrize(
    ("words", "kinds"),
    [
        (wording._SENTENCES["cures"], set(Cure) - {Cure.CALIBRATION}),
        (wording._SENTENCES["standing"], StandingKind),
        (wording._SENTENCES["concerns"], {*ConcernKind, "one-force"}),
        (wording._SENTENCES["remarks"] | wording._SENTENCES["choices"], RemarkKind),
        (wording._SENTENCES["signs"], Sign),
        (wording._SENTENCES["caveats"], CaveatKind),
    ],
)
def test_every_kind_has_its_words(words: dict[str, Any], kinds: Any) -> None:
    """Looked up by value, so that words need not import the analyses."""
    assert set(words) == set(map(str, kinds))


PRIVATE = (
    r"told (from|apart)|tells? \w* ?apart|lopsided|unasked|in company|Idle here|foret(ell|old)|set"
    r" aside|for granted|tion aside"
)


def test_words_are_those_of_the_field(root: Path) -> None:
    """Terms of art in the order of the alphabet; words of this project alone are nowhere."""
    glossary = tomllib.loads((TEMPLATES / "glossary.toml").read_text(encoding="utf-8"))
    assert list(glossary) == sorted(glossary, key=str.casefold)
    pages = [
        *TEMPLATES.parents[1].rglob("*.py"),
        *TEMPLATES.iterdir(),
        *(root / "docs").rglob("*.md"),
        root / "README.md",
    ]
    for page in pages:
        match = re.search(PRIVATE, page.read_text(encoding="utf-8"))
        assert match is None, f"{page.name}: {match}"


def test_a_decision_by_words_would_be_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    def count(campaign: lb.Campaign) -> list[str]:
        return [
            text
            for text in wording.preview_sentences(lb.preview(campaign))
            if text.startswith("Note: One")
        ]

    one_way = simulated(plan((30,) * 3, forces_N=FORCES_N))
    plain = count(one_way)
    assert plain
    reword(monkeypatch)
    with pytest.raises(AssertionError):
        same(plain, count(one_way))
