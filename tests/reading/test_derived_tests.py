"""Sheets and files of means, fits and filtered readings beside those of the circles themselves."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import openpyxl
import pytest

import ldbb_bayes as lb
from ldbb_bayes.reading.layout import Layout, TestLayout


def files(folder: Path, *names: str) -> Sequence[Path]:
    """Write one circle with each of the names."""
    paths = []
    for n, name in enumerate(names):
        lines = ["Angle [deg];Reading [um]"]
        for angle_deg in range(0, 360, 10):
            lines.append(f"{angle_deg};{n + 5.0 * np.sin(np.deg2rad(angle_deg)):.3f}")
        path = folder / f"{name}.csv"
        path.write_text("\n".join([*lines, ""]), encoding="utf-8")
        paths.append(path)
    return paths


@pytest.mark.parametrize(
    "names",
    [
        ("36N", "Mean 36 N"),
        ("36N", "36 N fit"),
        ("36 N raw", "36 N filtered"),
        ("36N", "36N_raw"),
        ("36N", "36N_s"),
        ("36N", "490N", "490N_gemittelt"),
        ("36N run 1", "36N run 2", "36N Durchschnitt"),
        ("36N run 1", "36N", "36N raw"),
        ("36N", "36N - Kopie"),
        ("36N", "Kopie von 36N"),
        ("36N", "36N_old"),
        ("36N", "36N_ref"),
        ("36N", "Summary 36N"),
        ("36N", "36N offset"),
        ("36N", "Chart data 36N"),
    ],
)
def test_a_file_computed_from_another_is_refused(names: Sequence[str], tmp_path: Path) -> None:
    with pytest.raises(lb.InputError, match="each test must be a circle of its own, got '"):
        lb.import_campaign(files(tmp_path, *names))


@pytest.mark.parametrize(
    "names",
    [
        ("36N_raw", "490N_raw"),
        ("36N", "490N_raw"),
        ("mean bar 36N", "mean bar 490N"),
        ("36N", "36N run 2 raw"),
        ("36N_U", "36N_V"),
        ("36N_1_MW", "36N_2_GP"),
        ("36N_restart", "36N"),
        ("36N different bar", "36N"),
        ("36N", "36N filter off"),
        ("36N", "36N_mean_load"),
        ("36N_CW_raw", "36N_CCW_raw"),
        ("36N_new_bar", "36N_2"),
        ("36N new bearing", "490N new bearing"),
    ],
)
def test_files_of_circles_are_read(names: Sequence[str], tmp_path: Path) -> None:
    imported = lb.import_campaign(files(tmp_path, *names))
    assert len(imported.campaign.tests) == len(names)


def test_a_circle_with_a_name_in_the_layout_is_read(tmp_path: Path) -> None:
    entry = TestLayout(file="36N_fit", name="after the fit of the bar")
    layout = Layout(test=[entry])
    imported = lb.import_campaign(files(tmp_path, "36N", "36N_fit"), layout=layout)
    assert len(imported.campaign.tests) == 2


def test_a_sheet_of_means_in_columns_is_refused(tmp_path: Path) -> None:
    workbook = openpyxl.Workbook()
    del workbook["Sheet"]
    for name in ("Runs", "Mean"):
        sheet = workbook.create_sheet(name)
        sheet.append(["Angle [deg]", "36 N [um]", "490 N [um]"])
        for angle_deg in range(0, 360, 10):
            sheet.append([angle_deg, angle_deg % 70, angle_deg % 110])
    workbook.save(tmp_path / "book.xlsx")
    message = "sheet 'Mean', test '36 N': each test must be a circle of its own, got '36 N' beside"
    with pytest.raises(lb.InputError, match=f"{message} 'Runs, 36 N'"):
        lb.import_campaign(tmp_path / "book.xlsx")
    layout = Layout(sheets=["Runs"])
    imported = lb.import_campaign(tmp_path / "book.xlsx", layout=layout)
    assert len(imported.campaign.tests) == 2


def test_a_test_of_means_in_a_column_of_tests_is_refused(tmp_path: Path) -> None:
    lines = ["test;Force [N];Angle [deg];Reading [um]"]
    for name in ("run 1", "run 2", "mean"):
        lines += [f"{name};36;{angle_deg};{angle_deg % 70}" for angle_deg in range(0, 360, 10)]
    path = tmp_path / "all.csv"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    with pytest.raises(lb.InputError, match="test 'mean': each test must be a circle of its own"):
        lb.import_campaign(path)


def test_the_copy_of_a_workbook_is_called_a_copy(tmp_path: Path) -> None:
    book = openpyxl.Workbook()
    sheet = book.active
    assert sheet is not None
    sheet.title = "100 N"
    sheet.append(["Angle [deg]", "Reading [um]"])
    for angle_deg in range(0, 360, 10):
        sheet.append([angle_deg, 5.0 * np.sin(np.deg2rad(angle_deg)) + angle_deg / 700])
    paths = [tmp_path / "practice.xlsx", tmp_path / "practice copy.xlsx"]
    for path in paths:
        book.save(path)
    with pytest.raises(
        lb.InputError, match=r"got the readings of practice\.xlsx again\. Leave one"
    ):
        lb.import_campaign(paths)
