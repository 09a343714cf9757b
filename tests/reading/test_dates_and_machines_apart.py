"""Tests whose names or dates show that they are of several machines, or lie days apart."""

from __future__ import annotations

from pathlib import Path

import pytest
from openpyxl import Workbook

import ldbb_bayes as lb


def workbook(folder: Path, *titles: str) -> Path:
    book = Workbook()
    book.remove(book.active)
    for n_sheet, title in enumerate(titles):
        sheet = book.create_sheet(title)
        sheet.append(["Angle [deg]", "Deviation [um]"])
        for k in range(36):
            sheet.append([10 * k, (7 * k + n_sheet) % 11 + 0.25])
    path = folder / "m.xlsx"
    book.save(path)
    return path


def notes_on_days(imported: lb.reading.Imported) -> list[str]:
    return [note.because for note in imported.assumptions if note.value == "more than a day apart"]


@pytest.mark.parametrize(
    ("titles", "message"),
    [
        (("VMC 07 100N", "VMC 08 100N"), "'VMC 08' in its name and 'VMC 07' in 'VMC 07 100N'"),
        (("100 N Maschine 1", "100 N Maschine 2"), "--sheets with those of one.*--machine-type"),
    ],
)
def test_names_with_the_numbers_of_two_machines_are_asked_for(
    titles: tuple[str, ...], message: str, tmp_path: Path
) -> None:
    path = workbook(tmp_path, *titles)
    with pytest.raises(lb.InputError, match=message):
        lb.import_campaign(path)
    assert len(lb.import_campaign(path, machine_type="VMC").campaign.tests) == 2
    one = lb.reading.Layout(sheets=(titles[0],))
    assert len(lb.import_campaign(path, layout=one).campaign.tests) == 1


@pytest.mark.parametrize(
    "titles",
    [("VMC 07 100N", "VMC 7 300N"), ("machine 100 N", "machine 300 N"), ("lap1 100N", "lap2 90N")],
)
def test_one_machine_is_not_asked_for(titles: tuple[str, ...], tmp_path: Path) -> None:
    assert len(lb.import_campaign(workbook(tmp_path, *titles)).campaign.tests) == 2


@pytest.mark.parametrize(
    ("days", "n_days"),
    [(("2025-03-01", "2026-03-01"), 365), (("01.03.2026", "04.03.2026"), 3)],
)
def test_names_with_dates_that_lie_apart_are_noted(
    days: tuple[str, str], n_days: int, tmp_path: Path
) -> None:
    path = workbook(tmp_path, *(f"{day} 100N" for day in days))
    (note,) = notes_on_days(lb.import_campaign(path))
    assert note.startswith(f"{n_days} days from the first test to the last")


def test_dates_of_one_day_are_not_noted(tmp_path: Path) -> None:
    path = workbook(tmp_path, "2026-03-01 100N", "2026-03-01 300N")
    assert notes_on_days(lb.import_campaign(path)) == []


def test_dates_above_tables_that_lie_apart_are_noted(tmp_path: Path) -> None:
    rows = "".join(f"{10 * k};{(7 * k) % 11}.25\n" for k in range(36))
    paths = []
    for year, force in ((2025, 100), (2026, 300)):
        path = tmp_path / f"{force}N.csv"
        path.write_text(f"Date: {year}-03-01\nAngle [deg];Reading [um]\n{rows}")
        paths.append(path)
    (note,) = notes_on_days(lb.import_campaign(paths))
    assert note.startswith("365 days from the first test to the last")
