"""Shared fixtures. One seed for all tests, with an override: LDBB_TEST_SEED=7 make test."""

from __future__ import annotations

import gc
import json
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pytest
import typer
from campaigns import Invoke
from hypothesis import HealthCheck, settings
from reports import fitted, undrawn

from ldbb_bayes.analysis.comparison import Comparison
from ldbb_bayes.analysis.design import simulated_analyses, space
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.campaign.folder import read_campaign
from ldbb_bayes.cli import app
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.report.findings import findings_of_fit
from ldbb_bayes.report.page import Document, compose, html_page

# The command line, read once: Typer reads all commands and options anew for every call of an app.
COMMAND_LINE = typer.main.get_command(app)
ROOT = Path(__file__).resolve().parents[1]

settings.register_profile(
    "house", deadline=None, max_examples=25, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("house")


def pytest_collection_finish() -> None:
    """Keep what collection has made, which stays to the end, from the garbage collector."""
    gc.freeze()


@pytest.fixture(scope="module")
def without_figures() -> Iterator[None]:
    """Reports of a module without their figures, which take time to draw."""
    with pytest.MonkeyPatch.context() as patch:
        undrawn(patch)
        yield


@pytest.fixture(scope="session")
def root() -> Path:
    return ROOT


@pytest.fixture(scope="session")
def recovered() -> Campaign:
    return read_campaign(ROOT / "data" / "recovered_experiment")


@contextmanager
def designs_of_few_states() -> Iterator[None]:
    """Designs average over few values of the hyper-parameters: how they are chosen does not hang on
    it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(simulated_analyses, "_STATES", 16)
        patch.setattr(space, "_SEARCH_NODES", 4)
        yield


@pytest.fixture
def few_states() -> Iterator[None]:
    """In one test."""
    with designs_of_few_states():
        yield


@pytest.fixture(scope="module")
def few_states_of_module() -> Iterator[None]:
    """In all tests of a module, and in what they share."""
    with designs_of_few_states():
        yield


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(int(os.environ.get("LDBB_TEST_SEED", "1")))


@pytest.fixture(scope="session")
def compared(recovered: Campaign) -> Comparison:
    """Constant and linear compliance on the recovered experiment, from its golden, which the slow
    tests hold to the code."""
    record = json.loads(
        (ROOT / "tests" / "goldens" / "compare_recovered.json").read_text(encoding="utf-8")
    )
    record["campaign"]["sha256"] = recovered.sha256
    return Comparison.from_dict(record)


@pytest.fixture(scope="session")
def published(recovered: Campaign, compared: Comparison) -> tuple[Document, str]:
    """The page of the recovered experiment."""
    document = compose(
        findings_of_fit(fitted(HybridModel.first(1), recovered), comparison=compared)
    )
    return document, html_page(document)


@pytest.fixture(scope="session")
def place_of_demonstration(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the demonstration is kept for all processes of this run."""
    base = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        base = base.parent
    return base / "demonstration"


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Debian's Chromium, which asks nobody for anything; skipped where it or playwright is
    missing."""
    playwright = pytest.importorskip(
        "playwright.sync_api", reason="playwright is not installed (pip install '.[browser]')"
    )
    path = next(
        (
            program
            for program in map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))
            if program
        ),
        None,
    )
    if path is None:
        pytest.skip("no Chromium is installed")
    options = [
        "--no-sandbox",
        "--disable-gpu",
        "--disable-quic",
        "--no-first-run",
        "--disable-background-networking",
    ]
    with playwright.sync_playwright() as driver:
        running = driver.chromium.launch(executable_path=path, args=options)
        yield running
        running.close()


@pytest.fixture
def invoke(capsys: pytest.CaptureFixture[str]) -> Invoke:
    """A command's exit code, what it printed, and what it said on stderr."""

    def run(*arguments: object) -> tuple[int, str, str]:
        with pytest.raises(SystemExit) as ended:
            COMMAND_LINE([str(argument) for argument in arguments])
        printed = capsys.readouterr()
        return int(ended.value.code or 0), printed.out, printed.err

    return run
