"""Lists of tests on a sheet without a table: loads are read, and unread columns are told."""

from __future__ import annotations

from pathlib import Path

import openpyxl
import pytest

import ldbb_bayes as lb

FORCES_N = {"100N": 98.7, "600N": 604.9}


def workbook(folder: Path, header: str, size: float, further_header: str = "Remark") -> Path:
    """Write two circles, and a list of them with their calibrated forces in a unit of this size."""
    book = openpyxl.Workbook()
    overview = book.worksheets[0]
    overview.title = "Index"
    overview.append(["Sheet", "Setup", header, "Work ball [°]", further_header])
    for name, force_N in FORCES_N.items():
        overview.append([name, 1, force_N / size, 45, "ok"])
        sheet = book.create_sheet(name)
        sheet.append(["angle [deg]", "reading [um]"])
        for k in range(72):
            sheet.append([5 * k, k % 7 + 0.25])
    path = folder / "all.xlsx"
    book.save(path)
    return path


@pytest.mark.parametrize(
    ("header", "size"),
    [("F cal. [kN]", 1e3), ("Force [N]", 1.0), ("F_ist (daN)", 10.0), ("Kraft [N]", 1.0)],
)
def test_the_force_of_a_list_is_read(tmp_path: Path, header: str, size: float) -> None:
    tests = lb.import_campaign(workbook(tmp_path, header, size)).campaign.tests
    assert [test.force_N for test in tests] == pytest.approx(list(FORCES_N.values()))


def test_the_largest_force_of_a_list_is_not_its_force(tmp_path: Path) -> None:
    tests = lb.import_campaign(workbook(tmp_path, "F max. [kN]", 1e3)).campaign.tests
    assert [test.force_N for test in tests] == [100.0, 600.0]


def unread(path: Path) -> list[str]:
    """Return the lists of columns that were not used, with the reason of a list of tests."""
    assumptions = lb.import_campaign(path).assumptions
    return [note.value for note in assumptions if "list of tests" in note.because]


def test_columns_of_a_list_that_are_not_read_are_told(tmp_path: Path) -> None:
    path = workbook(tmp_path, "F cal. [kN]", 1e3)
    assert unread(path) == ["Setup, Work ball [°], Remark"]


def test_an_unread_force_of_a_list_is_told(tmp_path: Path) -> None:
    path = workbook(tmp_path, "F max. [kN]", 1e3)
    assert unread(path) == ["Setup, F max. [kN], Work ball [°], Remark"]


def with_two_forces(folder: Path) -> Path:
    """Write a list of tests in which a second force contradicts the calibrated one."""
    path = workbook(folder, "F cal. [kN]", 1e3, further_header="Force [N]")
    book = openpyxl.load_workbook(path)
    for row in (2, 3):
        book["Index"].cell(row, 5).value = 300.0
    book.save(path)
    return path


def test_two_forces_of_a_list_are_asked(tmp_path: Path) -> None:
    with pytest.raises(lb.InputError, match=r"force_N must be said once.*--forces-N"):
        lb.import_campaign(with_two_forces(tmp_path))


def test_two_forces_of_a_list_give_way_to_those_of_the_user(tmp_path: Path) -> None:
    layout = lb.reading.Layout(forces_N=[98.7, 604.9])
    tests = lb.import_campaign(with_two_forces(tmp_path), layout=layout).campaign.tests
    assert [test.force_N for test in tests] == [98.7, 604.9]
