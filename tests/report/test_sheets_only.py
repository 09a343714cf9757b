"""The report without its annex: the same two sheets, and nothing worked out that is not on them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
import xarray as xr
from campaigns import Invoke, plan, refuses, simulated
from reports import NOT_COMPARED, fitted, undrawn

import ldbb_bayes as lb
from ldbb_bayes.cli import file_reports
from ldbb_bayes.inference.posterior import campaign_of
from ldbb_bayes.report import findings as findings_module
from ldbb_bayes.report.blocks import ReportSheet
from ldbb_bayes.report.findings import Findings, findings_of_fit
from ldbb_bayes.report.page import Document, html_page
from ldbb_bayes.report.sheets import sheets

TABLES = {
    "results",
    "covariance",
    "correlation",
    "budget",
    "gum_validation",
    "change_with_force",
    "stiffness",
}


def never(*_: object, **__: object) -> None:
    raise AssertionError("only the annex needs this")


@pytest.fixture(scope="module")
def posterior() -> xr.DataTree:
    return fitted(lb.HybridModel.first(1), simulated(plan()))


@pytest.fixture(scope="module")
def folder(posterior: xr.DataTree, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A report without annex."""
    folder = tmp_path_factory.mktemp("sheets")
    with pytest.MonkeyPatch.context() as patch:
        for name in ("compare", "design", "predict_circularity"):
            patch.setattr(findings_module, name, never)
        lb.write_report(posterior, folder, sheets_only=True)
    return folder


@pytest.fixture(scope="module")
def without_annex(posterior: xr.DataTree) -> Findings:
    return findings_of_fit(posterior, sheets_only=True)


@pytest.fixture(scope="module")
def two_sheets(without_annex: Findings) -> tuple[ReportSheet, ...]:
    """The sheets of a report without annex; their figures are empty."""
    with pytest.MonkeyPatch.context() as patch:
        undrawn(patch)
        return sheets(without_annex)


@pytest.fixture(scope="module")
def complete(posterior: xr.DataTree) -> tuple[ReportSheet, ...]:
    """The sheets of a report with annex; their figures are empty."""
    with pytest.MonkeyPatch.context() as patch:
        undrawn(patch)
        return sheets(findings_of_fit(posterior, comparison=NOT_COMPARED))


def texts(sheet: ReportSheet) -> list[str]:
    return [block for block in sheet.blocks if isinstance(block, str)]


def test_files_of_a_report_without_annex(folder: Path) -> None:
    names = {path.name for path in folder.iterdir()}
    assert names == {"report.html", "report.pdf", "report.json", "dcc.xml", "tables"}
    assert {path.stem for path in (folder / "tables").iterdir()} == TABLES


def test_the_record_says_what_was_left_out(folder: Path) -> None:
    record = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    left_out = {"missing": "left out with the annex (--sheets-only)"}
    assert record["comparison"] == left_out
    assert record["design"] == left_out


def test_the_page_has_two_sheets_and_no_annex(folder: Path) -> None:
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert page.count('<section class="sheet"') == 2
    assert 'class="annex"' not in page
    assert 'href="#annex"' not in page


def test_sheet_1_differs_by_one_note(
    complete: tuple[ReportSheet, ...], two_sheets: tuple[ReportSheet, ...]
) -> None:
    assert len(two_sheets[0].blocks) == len(complete[0].blocks) + 1
    note = (
        "These two sheets were made without the annex, which tries what other assumptions would"
        " change."
    )
    assert set(texts(two_sheets[0])) - set(texts(complete[0])) == {note}


def test_sheet_2_is_the_same(
    complete: tuple[ReportSheet, ...], two_sheets: tuple[ReportSheet, ...]
) -> None:
    assert texts(two_sheets[1]) == texts(complete[1])
    assert two_sheets[1].blocks[0] == complete[1].blocks[0]


def test_the_note_has_a_german_text(without_annex: Findings) -> None:
    first, _ = sheets(without_annex, language="de")
    assert any(
        text.startswith("Diese zwei Blätter entstanden ohne den Anhang") for text in texts(first)
    )


def test_a_comparison_that_is_known_counts(
    posterior: xr.DataTree, compared: lb.analysis.Comparison
) -> None:
    record = replace(compared.campaign, sha256=campaign_of(posterior).sha256)
    comparison = replace(compared, campaign=record)
    findings = findings_of_fit(posterior, comparison=comparison, sheets_only=True)
    assert findings.comparison is comparison


def test_an_annex_cannot_be_printed_and_left_out(posterior: xr.DataTree, tmp_path: Path) -> None:
    refuses(
        "must not go with sheets_only",
        lb.write_report,
        posterior,
        tmp_path,
        annex=True,
        sheets_only=True,
    )


def test_only_the_annex_compares_campaigns(posterior: xr.DataTree, tmp_path: Path) -> None:
    refuses(
        "must go with one fit, got 1 beside it",
        lb.write_report,
        posterior,
        tmp_path,
        beside_it={"other": posterior},
        sheets_only=True,
    )


def test_a_page_without_annex_is_well_formed(two_sheets: tuple[ReportSheet, ...]) -> None:
    document = Document("A title", (), (), (), two_sheets)
    assert html_page(document).rstrip().endswith("</main>\n</body>\n</html>")


@pytest.mark.slow
def test_command_from_files(
    tmp_path: Path, invoke: Invoke, monkeypatch: pytest.MonkeyPatch
) -> None:
    campaign = lb.write_campaign(simulated(plan()), tmp_path / "campaign")
    monkeypatch.setattr(lb, "design", never)
    monkeypatch.setattr(file_reports, "begin_comparison", never)
    asked = ("--preset", "first", "--sheets-only", "--yes")
    code, stdout, stderr = invoke("report", campaign, "--out", tmp_path / "out", *asked)
    assert (code, stderr) == (0, "")
    assert "Averaged over constant and linear compliance" in stdout
    assert "ln B" not in stdout
    assert "Run next" not in stdout
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "averaged.nc",
        "campaign",
        "dcc.xml",
        "model.toml",
        "posterior.nc",
        "report.html",
        "report.json",
        "report.pdf",
        "summary.json",
        "tables",
    }


def test_no_circles_are_recommended_without_annex(tmp_path: Path, invoke: Invoke) -> None:
    campaign = lb.write_campaign(simulated(plan()), tmp_path / "campaign")
    asked = ("--sheets-only", "--tests", 4)
    code, _, stderr = invoke("report", campaign, "--out", tmp_path / "out", *asked)
    assert code == 2
    assert "--tests must go with the annex" in stderr
    assert not (tmp_path / "out").exists()
