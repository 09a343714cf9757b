"""The commands ``identify`` and ``design`` read the files that ``report`` reads."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import awkward
import pytest
from campaigns import Invoke, written

import ldbb_bayes as lb

# A small model: how files are read does not hang on it.
SMALL = ("--preset", "first", "--degree", 0)
FIT = "ldbb-bayes fit"


@pytest.fixture(scope="module")
def tables(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Tables with semicolons and decimal commas, one a test."""
    return written(tmp_path_factory.mktemp("tables"), awkward.CASES["02_semicolon"].files)


@pytest.fixture(scope="module")
def imported(tables: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The campaign folder that an import of the tables writes."""
    folder = tmp_path_factory.mktemp("imported") / "c"
    return lb.write_campaign(lb.import_campaign(tables).campaign, folder)


def _identified(invoke: Invoke, *arguments: Any) -> dict[str, Any]:
    record: dict[str, Any] = json.loads(invoke("identify", *arguments, *SMALL, "--json")[1])
    return record["parameters"]


def test_identify_reads_tables_as_report_does(
    tables: list[Path], imported: Path, invoke: Invoke
) -> None:
    assert _identified(invoke, *tables) == _identified(invoke, imported)


def test_identify_prints_what_the_import_assumed(tables: list[Path], invoke: Invoke) -> None:
    stdout = invoke("identify", *tables, *SMALL)[1]
    assert "Assumed (change it with the option named)" in stdout


def test_an_option_of_tables_states_what_was_assumed(tables: list[Path], invoke: Invoke) -> None:
    stdout = invoke("identify", *tables, *SMALL, "--radius-mm", 140)[1]
    assert "radius_mm: 150 mm" not in stdout


def test_a_pattern_names_several_tables(tables: list[Path], invoke: Invoke) -> None:
    pattern = tables[0].parent / f"*{tables[0].suffix}"
    assert _identified(invoke, pattern) == _identified(invoke, *sorted(tables))


@pytest.mark.usefixtures("few_states")
def test_design_reads_tables(tables: list[Path], imported: Path, invoke: Invoke) -> None:
    options = ("--tests", 2, "--forces", "100,300,600", *SMALL, "--json")
    from_tables = json.loads(invoke("design", *tables, *options)[1])
    from_campaign = json.loads(invoke("design", imported, *options)[1])
    assert from_tables["tests"] == from_campaign["tests"]


@pytest.mark.slow
def test_identify_reads_the_campaign_of_a_fit(
    imported: Path, tmp_path: Path, invoke: Invoke
) -> None:
    out = tmp_path / "fit"
    invoke("fit", imported, "--sampler", "independent", *SMALL, "--out", out)
    assert _identified(invoke, out) == _identified(invoke, imported)


def test_two_campaigns_at_once_are_refused(imported: Path, invoke: Invoke) -> None:
    code, _, stderr = invoke("identify", imported, imported)
    assert code == 2
    words = " ".join(stderr.split())
    assert "one campaign must be given, got 2 files" in words
    commands = f"{FIT} {imported} --out fit_1; {FIT} {imported} --out fit_2"
    assert f"To compare them: {commands}; ldbb-bayes report fit_1 fit_2" in words


def test_tables_beside_a_campaign_are_refused_without_commands(
    imported: Path, tmp_path: Path, invoke: Invoke
) -> None:
    (tmp_path / "a.csv").write_text("angle,reading", encoding="utf-8")
    code, _, stderr = invoke("identify", imported, tmp_path / "a.csv")
    assert code == 2
    assert "report sets several fits side by side." in " ".join(stderr.split())


def test_a_path_that_does_not_exist_is_refused(tmp_path: Path, invoke: Invoke) -> None:
    code, _, stderr = invoke("design", tmp_path / "none.xlsx")
    assert code == 2
    assert "none.xlsx must be a table" in " ".join(stderr.split())
