"""Numbers struck through in a workbook: an operator has marked them as bad."""

from __future__ import annotations

from pathlib import Path

import openpyxl
import pytest
from openpyxl.styles import Font
from openpyxl.worksheet.worksheet import Worksheet

import ldbb_bayes as lb
from ldbb_bayes.report.message_translation import in_language

STRUCK = Font(strike=True)
N_READINGS = 36


def sheet_of_readings(book: openpyxl.Workbook) -> Worksheet:
    """Return a sheet with a header and 36 readings, which stand in lines 2 to 37."""
    sheet = book.worksheets[0]
    sheet.append(["Angle [deg]", "Deviation [um]", "Remark"])
    for k in range(N_READINGS):
        sheet.append([10.0 * k, float(k % 7), "checked"])
    return sheet


def test_struck_readings_are_refused(tmp_path: Path) -> None:
    book = openpyxl.Workbook()
    sheet = sheet_of_readings(book)
    for cell in ("B5", "B9"):
        sheet[cell].font = STRUCK
    book.save(tmp_path / "300N.xlsx")
    with pytest.raises(
        lb.InputError,
        match=r"300N.xlsx, .*line 5: .* struck through .*'Deviation \[um\]'.* lines 5, 9\.",
    ) as refusal:
        lb.import_campaign(tmp_path / "300N.xlsx")
    german = in_language(str(refusal.value), "de")
    assert german is not None
    assert "durchgestrichene Zahlen" in german
    assert "Empty" not in german


@pytest.mark.parametrize("cell", ["A1", "B1", "C5"])
def test_struck_texts_are_no_readings(cell: str, tmp_path: Path) -> None:
    book = openpyxl.Workbook()
    sheet = sheet_of_readings(book)
    sheet[cell].font = STRUCK
    book.save(tmp_path / "300N.xlsx")
    (test,) = lb.import_campaign(tmp_path / "300N.xlsx").campaign.tests
    assert len(test.reading_um) == N_READINGS


def test_the_cure_reads_the_workbook(tmp_path: Path) -> None:
    book = openpyxl.Workbook()
    sheet = sheet_of_readings(book)
    sheet["B5"].font = STRUCK
    sheet["B5"].value = None
    book.save(tmp_path / "300N.xlsx")
    (test,) = lb.import_campaign(tmp_path / "300N.xlsx").campaign.tests
    assert len(test.reading_um) == N_READINGS - 1


def test_a_struck_reading_beside_another_table_is_refused(tmp_path: Path) -> None:
    """Two tables stand side by side; the struck number is in the second one."""
    book = openpyxl.Workbook()
    sheet = book.worksheets[0]
    sheet.append(["Angle [deg]", "100 N [um]", "Angle [deg]", "300 N [um]"])
    for k in range(N_READINGS):
        sheet.append([10.0 * k, float(k % 7), 10.0 * k, float(k % 5)])
    sheet["D6"].font = STRUCK
    book.save(tmp_path / "runs.xlsx")
    with pytest.raises(lb.InputError, match=r"line 6: .*struck through in column '300 N \[um\]'"):
        lb.import_campaign(tmp_path / "runs.xlsx")
