"""Cells in place of numbers: formulas without values, numbers in brackets, and durations."""

from __future__ import annotations

from datetime import timedelta
from pathlib import Path

import numpy as np
import pytest
from openpyxl import Workbook

import ldbb_bayes as lb

READINGS = [(7 * k) % 11 - 4.75 for k in range(36)]


def workbook(folder: Path, header: str, angles: list[object], number_format: str) -> Path:
    book = Workbook()
    sheet = book.active
    sheet.append([header, "Deviation [um]"])
    for angle, reading in zip(angles, READINGS, strict=True):
        sheet.append([angle, reading])
    for row in range(2, 38):
        sheet.cell(row, 1).number_format = number_format
    path = folder / "300N.xlsx"
    book.save(path)
    return path


def test_formulas_of_angles_without_values_are_named(tmp_path: Path) -> None:
    formulas: list[object] = [0.0, *(f"=A{row}+10" for row in range(2, 37))]
    path = workbook(tmp_path, "Angle [deg]", formulas, "0.0")
    with pytest.raises(lb.InputError, match=r"line 3: cells must hold values.*save it once"):
        lb.import_campaign(path)


def test_a_sheet_of_formulas_that_is_no_table_of_readings_is_left_out(tmp_path: Path) -> None:
    path = workbook(tmp_path, "Angle [deg]", list(np.arange(0.0, 360.0, 10.0)), "0.0")
    summary = Workbook()
    sheet = summary.active
    sheet.append(["Name", "Value"])
    for row in range(20):
        sheet.append([f"v{row}", "=1+1"])
    summary.save(tmp_path / "summary.xlsx")
    imported = lb.import_campaign(str(tmp_path / "*.xlsx"))
    assert [test.name for test in imported.campaign.tests] == [path.stem]


def test_readings_in_brackets_are_named_and_the_advice_helps(tmp_path: Path) -> None:
    path = tmp_path / "300N.csv"
    rows = []
    for k, reading in enumerate(READINGS):
        shown = f"({-reading:.2f})" if reading < 0.0 else f"{reading:.2f}"
        rows.append(f"{10 * k};{shown}")
    path.write_text("\n".join(["Angle [deg];Deviation [um]", *rows]))
    with pytest.raises(lb.InputError, match=r"line 2: .* got '\(4\.75\)'.*minus sign"):
        lb.import_campaign(path)
    path.write_text(path.read_text().replace("(", "-").replace(")", "").replace("-deg", "deg"))
    path.write_text(path.read_text().replace("[deg]", "(deg)"))
    (test,) = lb.import_campaign(path).campaign.tests
    np.testing.assert_allclose(test.reading_um, READINGS)


def test_durations_of_more_than_a_day_are_shown_as_a_spreadsheet_shows_them(
    tmp_path: Path,
) -> None:
    durations: list[object] = [timedelta(hours=10 * k, minutes=30) for k in range(36)]
    path = workbook(tmp_path, "Angle [deg]", durations, "[h]:mm:ss")
    with pytest.raises(lb.InputError, match=r"got '0:30:00'.*put \(D-M-S\) behind its name"):
        lb.import_campaign(path)
    path = workbook(tmp_path, "Angle (D-M-S)", durations, "[h]:mm:ss")
    (test,) = lb.import_campaign(path).campaign.tests
    np.testing.assert_allclose(test.angle_deg, 10.0 * np.arange(36) + 0.5)
