"""Circles beside each other whose directions stand above them, and whose force names the sheet."""

from __future__ import annotations

from pathlib import Path

import openpyxl
import pytest

import ldbb_bayes as lb


@pytest.mark.parametrize("force_N", [100.0, 300.0])
def test_direction_above_each_table_and_force_in_the_sheet_name(
    force_N: float, tmp_path: Path
) -> None:
    book = openpyxl.Workbook()
    sheet = book.worksheets[0]
    sheet.title = f"{force_N:g} N"
    sheet.append([None, "CCW", None, "CW"])
    sheet.append(["Angle [deg]", "um", "Angle [deg]", "um"])
    for k in range(72):
        sheet.append([5.0 * k, 0.1 * k, 355.0 - 5.0 * k, 3.0 + 0.1 * k])
    book.save(tmp_path / "m.xlsx")
    tests = lb.import_campaign(tmp_path / "m.xlsx").campaign.tests
    assert [test.force_N for test in tests] == [force_N, force_N]
    means = {test.direction: test.reading_um.mean() for test in tests}
    assert means == pytest.approx({"CCW": 3.55, "CW": 6.55})
