"""Files and sheets without a table: told as left out, as a list of tests, or as missing."""

from __future__ import annotations

from pathlib import Path

import pytest
from openpyxl import Workbook, load_workbook

import ldbb_bayes as lb

ROWS = [["Angle [deg]", "Reading [um]"], *[[angle, angle % 7] for angle in range(0, 360, 5)]]


def workbook_with(folder: Path, first_sheet: list[list[object]]) -> Path:
    book = Workbook()
    book.active.title = "runs"
    for name, rows in {"runs": first_sheet, "A": ROWS, "B": ROWS}.items():
        sheet = book["runs"] if name == "runs" else book.create_sheet(name)
        for row in rows:
            sheet.append(row)
    path = folder / "m.xlsx"
    book.save(path)
    return path


def subjects(path: Path, **layout: object) -> set[str]:
    imported = lb.import_campaign(path, layout=lb.reading.Layout(**layout))
    return {note.what for note in imported.assumptions if "'runs'" in note.place}


def test_a_list_whose_rows_are_used_is_not_told_as_left_out(tmp_path: Path) -> None:
    path = workbook_with(tmp_path, [["Test", "Force [N]"], ["A", 36], ["B", 490]])
    assert subjects(path) == {"list of tests"}


def test_a_sheet_that_names_no_test_is_left_out(tmp_path: Path) -> None:
    path = workbook_with(tmp_path, [["Remark"], ["warm day"]])
    assert subjects(path, forces_N=[36.0, 490.0]) == {"left out"}


def test_a_file_that_does_not_exist_is_not_advised_to_be_left_out(tmp_path: Path) -> None:
    path = workbook_with(tmp_path, [["Test", "Force [N]"], ["A", 36], ["B", 490]])
    with pytest.raises(lb.InputError, match=r"must be a file, found none\. Check the path\.$"):
        lb.import_campaign([path, tmp_path / "nothing.csv"])


def test_all_sheets_that_are_left_out_are_named(tmp_path: Path) -> None:
    """A number of places would not tell which circle is lost."""
    path = workbook_with(tmp_path, [["Remark"], ["warm day"]])
    book = load_workbook(path)
    book.create_sheet("C").append(["Angle [deg]", "Reading [um]"])
    book.save(path)
    imported = lb.import_campaign(path, layout=lb.reading.Layout(forces_N=[36.0, 490.0]))
    (note,) = [note for note in imported.assumptions if note.what == "left out"]
    assert "'runs'" in note.place
    assert "'C'" in note.place


def test_the_number_of_sheets_is_stated_where_not_all_are_named(tmp_path: Path) -> None:
    path = workbook_with(tmp_path, [["Remark"], ["warm day"]])
    book = load_workbook(path)
    for number in range(25):
        book.create_sheet(f"Circle number {number}").append(["Angle [deg]", "Reading [um]"])
    book.save(path)
    imported = lb.import_campaign(path, layout=lb.reading.Layout(forces_N=[36.0, 490.0]))
    (note,) = [note for note in imported.assumptions if note.what == "left out"]
    assert note.place.startswith("26 places: ")
    assert note.place.endswith(", …")
