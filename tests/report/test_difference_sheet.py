"""The sheet for signing that compares two campaigns, in both languages."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from datetime import datetime

import pytest
from campaigns import plan, simulated
from reports import NOT_COMPARED, fitted, undrawn

import ldbb_bayes as lb
from ldbb_bayes.analysis.common_effects import Shared
from ldbb_bayes.inference.posterior import campaign_of
from ldbb_bayes.inference.summary import result_json
from ldbb_bayes.report.blocks import Banner, Fields, Items, ReportSheet
from ldbb_bayes.report.difference_sheet import difference_sheets
from ldbb_bayes.report.findings import Findings, FurtherCampaign, findings_of_fit
from ldbb_bayes.report.pdf import fit_to_pages, pdf_of
from ldbb_bayes.report.sheets import sheets
from ldbb_bayes.report.translation import words_of
from ldbb_bayes.results import Table

MODEL = lb.HybridModel.first(0)
SAME_INSTRUMENT = Shared(instrument=True)


@pytest.fixture(scope="module", autouse=True)
def without_figures() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        undrawn(patch)
        yield


@pytest.fixture(scope="module")
def before() -> Findings:
    campaign = replace(simulated(plan()), name="before", serial_number="4711", date="2026-10-01")
    return findings_of_fit(
        fitted(MODEL, campaign), comparison=NOT_COMPARED, recommended=NOT_COMPARED
    )


@pytest.fixture(scope="module")
def after(before: Findings) -> FurtherCampaign:
    """The machine has become softer in X by 40 nm/N, and the work ball is another one."""
    softer = MODEL.simulate(plan(), seed=2, parameters={"C_XXX": 90e-6}).campaign
    posterior = fitted(MODEL, replace(softer, name="after"))
    table = lb.analysis.compare_posteriors(before.posterior, posterior, same_instrument=True)
    return FurtherCampaign("after", campaign_of(posterior), result_json(posterior), table)


def sheet_of(before: Findings, after: FurtherCampaign, language: str = "en") -> ReportSheet:
    (sheet,) = difference_sheets(before, [after], SAME_INSTRUMENT, words_of(language))
    return sheet


def test_the_sheet_holds_what_is_signed(before: Findings, after: FurtherCampaign) -> None:
    sheet = sheet_of(before, after)
    assert (sheet.title, sheet.line) == (
        "Difference between two campaigns",
        "Sheet 3 of 3: before, after",
    )
    campaigns, signatures = (block for block in sheet.blocks if isinstance(block, Fields))
    assert campaigns.entries == (
        ("First campaign", "before, 4711, 2026-10-01"),
        ("Second campaign", "after"),
    )
    assert signatures.tall
    (changes,) = (block for block in sheet.blocks if isinstance(block, Items))
    assert "after differs from before (± U, k = 2) in: C_XXX " in changes.items[0]
    (table,) = (block for block in sheet.blocks if isinstance(block, Table))
    rows = {str(row[0]): row for row in table.rows}
    shown = after.differences.loc["C_XXX", "difference"] * 1e6
    assert float(str(rows["C_XXX"][3])) == pytest.approx(shown, abs=0.06)
    assert any("The instrument was the same" in str(block) for block in sheet.blocks)


def test_doubts_stand_first(before: Findings, after: FurtherCampaign) -> None:
    table = after.differences.copy()
    table.attrs["conflict"] = ("length 150 mm", 1e-6)
    (banner,) = (
        block
        for block in sheet_of(before, replace(after, differences=table)).blocks
        if isinstance(block, Banner)
    )
    assert banner.kind == "unusable"
    assert banner.sentence.startswith("Not one instrument: before and after disagree")


def test_no_banner_without_doubts(before: Findings, after: FurtherCampaign) -> None:
    table = after.differences.copy()
    table.attrs["conflict"] = None
    blocks = sheet_of(before, replace(after, differences=table)).blocks
    assert not [block for block in blocks if isinstance(block, Banner)]


def test_the_sheet_in_german(before: Findings, after: FurtherCampaign) -> None:
    sheet = sheet_of(before, after, "de")
    assert sheet.line == "Blatt 3 von 3: before, after"
    texts = " ".join(str(block) for block in sheet.blocks)
    assert "after unterscheidet sich von before" in texts
    assert "Vergleiche (Verfahren von Holm)" in texts
    for english in ("differs", "allowing", "instrument was", "campaign"):
        assert english not in texts


def test_each_sheet_is_a_page_of_the_pdf(before: Findings, after: FurtherCampaign) -> None:
    further = difference_sheets(before, [after, after], SAME_INSTRUMENT, words_of("en"))
    fitted_sheets = fit_to_pages((*sheets(before, further=2), *further))
    assert [sheet.line[:12] for sheet in fitted_sheets] == [
        f"Sheet {number} of 4" for number in (1, 2, 3, 4)
    ]
    started = before.result["provenance"]["started"]
    pdf = pdf_of(fitted_sheets, "title", "en", datetime.fromisoformat(started))
    assert pdf.count(b"/Type /Page\n") == 4
