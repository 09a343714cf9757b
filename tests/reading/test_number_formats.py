"""Units that only the number formats of a workbook's cells show, outside the table of readings."""

from __future__ import annotations

from pathlib import Path

import openpyxl
import pytest
from openpyxl.worksheet.worksheet import Worksheet

import ldbb_bayes as lb
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.errors import InputError

KILONEWTON = '#,##0.000 "kN"'
CENTIMETRE = '0.0" cm"'


def write_row(sheet: Worksheet, *cells: object) -> None:
    """Append a row; a pair in place of a cell is a number and its number format."""
    sheet.append([cell[0] if isinstance(cell, tuple) else cell for cell in cells])
    for column, cell in enumerate(cells, start=1):
        if isinstance(cell, tuple):
            sheet.cell(sheet.max_row, column).number_format = cell[1]


def imported(folder: Path, *rows_above: tuple[object, ...], n_circles: int = 1) -> Campaign:
    """Import a workbook of one sheet with these rows above its readings."""
    book = openpyxl.Workbook()
    sheet = book.worksheets[0]
    for cells in rows_above:
        write_row(sheet, *cells)
    for k in range(72):
        sheet.append([5.0 * k, *[0.1 * k + circle for circle in range(n_circles)]])
    book.save(folder / "runs.xlsx")
    return lb.import_campaign(folder / "runs.xlsx").campaign


@pytest.mark.parametrize("force_kN", [0.3, 0.1234, 1.234])
def test_force_and_radius_above_a_table(force_kN: float, tmp_path: Path) -> None:
    campaign = imported(
        tmp_path,
        ("Force", (force_kN, KILONEWTON)),
        ("Radius", (10.0, CENTIMETRE)),
        ("Angle [deg]", "Deviation [um]"),
    )
    assert campaign.tests[0].force_N == pytest.approx(1000.0 * force_kN)
    assert campaign.tests[0].radius_mm == 100.0


def test_force_and_radius_in_one_row(tmp_path: Path) -> None:
    campaign = imported(
        tmp_path,
        ("Force", (0.3, KILONEWTON), "Radius", (10.0, CENTIMETRE)),
        ("Angle [deg]", "Deviation [um]"),
    )
    assert (campaign.tests[0].force_N, campaign.tests[0].radius_mm) == (300.0, 100.0)


@pytest.mark.parametrize("is_header", [True, False])
def test_forces_of_columns(is_header: bool, tmp_path: Path) -> None:
    forces = ((0.1, KILONEWTON), (0.3, KILONEWTON))
    rows: list[tuple[object, ...]] = [("Angle [deg]", *forces)]
    if not is_header:
        rows = [("Force", *forces), ("Angle [deg]", "Dev. [um]", "Dev. [um]")]
    tests = imported(tmp_path, *rows, n_circles=2).tests
    assert [test.force_N for test in tests] == [100.0, 300.0]
    assert [test.reading_um[0] for test in tests] == [0.0, 1.0]


def test_forces_in_a_list_of_sheets(tmp_path: Path) -> None:
    book = openpyxl.Workbook()
    overview = book.worksheets[0]
    overview.append(["Sheet", "Force", "Radius"])
    for name, force_kN in (("A", 0.1), ("B", 0.3)):
        write_row(overview, name, (force_kN, KILONEWTON), (10.0, CENTIMETRE))
        sheet = book.create_sheet(name)
        sheet.append(["Angle [deg]", "Deviation [um]"])
        for k in range(72):
            sheet.append([5.0 * k, 0.1 * k])
    book.save(tmp_path / "runs.xlsx")
    campaign = lb.import_campaign(tmp_path / "runs.xlsx").campaign
    assert [test.force_N for test in campaign.tests] == [100.0, 300.0]
    assert campaign.tests[0].radius_mm == 100.0


def test_a_constant_column_of_radii(tmp_path: Path) -> None:
    book = openpyxl.Workbook()
    sheet = book.worksheets[0]
    sheet.title = "36 N"
    sheet.append(["Radius", "Angle [deg]", "Deviation [um]"])
    for k in range(72):
        write_row(sheet, (10.0, CENTIMETRE), 5.0 * k, 0.1 * k)
    book.save(tmp_path / "runs.xlsx")
    assert lb.import_campaign(tmp_path / "runs.xlsx").campaign.tests[0].radius_mm == 100.0


@pytest.mark.parametrize(
    ("number_format", "shown"),
    [
        ("0%", "in percent"),
        ("0.00%", "in percent"),
        ("0.000 %", "in percent"),
        ("0.000,", "in thousands"),
        ('0.000," µm"', "in thousands"),
    ],
)
def test_readings_shown_as_another_number_are_asked_about(
    number_format: str, shown: str, tmp_path: Path
) -> None:
    book = openpyxl.Workbook()
    sheet = book.worksheets[0]
    sheet.append(["Angle [deg]", "Deviation [um]"])
    for k in range(72):
        write_row(sheet, 5.0 * k, (0.1 * k, number_format))
    book.save(tmp_path / "300 N.xlsx")
    with pytest.raises(InputError, match=f"line 2: column 'Deviation.*got a cell .*{shown}"):
        lb.import_campaign(tmp_path / "300 N.xlsx")


def test_thousands_separated_in_a_format_stay_readings(tmp_path: Path) -> None:
    book = openpyxl.Workbook()
    sheet = book.worksheets[0]
    sheet.append(["Angle [deg]", "Deviation [nm]"])
    for k in range(72):
        write_row(sheet, 5.0 * k, (1000.0 * k, "#,##0.00"))
    book.save(tmp_path / "300 N.xlsx")
    assert lb.import_campaign(tmp_path / "300 N.xlsx").campaign.tests[0].reading_um[71] == 71.0
