"""Units of loads that stand below, beside or above them: in lists of tests and in sentences."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from openpyxl import Workbook

import ldbb_bayes as lb
from ldbb_bayes.reading.layout import Layout

ANGLES_DEG = range(0, 360, 10)
FORCES_N = (100.0, 300.0, 600.0)


def circle(force_N: float) -> list[tuple[float, float]]:
    """Return angle and reading of each row of a circle."""
    return [(float(a), round(0.02 * force_N + np.cos(np.deg2rad(a)), 3)) for a in ANGLES_DEG]


def book(folder: Path, rows: Sequence[Sequence[object]]) -> Path:
    """Write a workbook with a list of tests and a sheet for each of the circles M1, M2 and M3."""
    workbook = Workbook()
    del workbook["Sheet"]
    sheet = workbook.create_sheet("Liste")
    for cells in rows:
        sheet.append(list(cells))
    for number, force_N in enumerate(FORCES_N, start=1):
        table = workbook.create_sheet(f"M{number}")
        table.append(["Angle [deg]", "Reading [um]"])
        for row in circle(force_N):
            table.append(row)
    path = folder / "book.xlsx"
    workbook.save(path)
    return path


def forces_of(path: Path) -> list[float | None]:
    return [test.force_N for test in lb.import_campaign(path).campaign.tests]


@pytest.mark.parametrize(
    "rows",
    [
        [["Test", "Load"], ["", "kN"], ["M1", 0.1], ["M2", 0.3], ["M3", 0.6]],
        [["Messung", "Kraft", "Notiz"], ["", "[daN]", ""], ["M1", 10], ["M2", 30], ["M3", 60]],
        [["Test", "Load", "Unit"], ["M1", 0.1, "kN"], ["M2", 300, "N"], ["M3", 60, "daN"]],
        [["Test", "Load"], ["M1", "0.1 kN"], ["M2", "0.3 kN"], ["M3", "0.6 kN"]],
    ],
)
def test_units_in_a_list_of_tests_are_used(
    rows: Sequence[Sequence[object]], tmp_path: Path
) -> None:
    assert forces_of(book(tmp_path, rows)) == pytest.approx(FORCES_N)


def test_a_row_of_numbers_between_units_is_no_row_of_units(tmp_path: Path) -> None:
    rows: list[list[object]] = [["Sheet", "Load", "Unit", "Radius", "Unit"]]
    for number, force_N in enumerate(FORCES_N, start=1):
        rows.append([f"M{number}", force_N / 1000.0, "kN", 10, "cm"])
    tests = lb.import_campaign(book(tmp_path, rows)).campaign.tests
    assert [test.force_N for test in tests] == pytest.approx(FORCES_N)
    assert [test.radius_mm for test in tests] == [100.0, 100.0, 100.0]


@pytest.mark.parametrize(
    ("rows", "line"),
    [
        ([["Loads in kN"], ["Test", "Load"], ["M1", 0.1], ["M2", 0.3], ["M3", 0.6]], "Loads in kN"),
        (
            [["Test", "Load"], ["M1", 10], ["M2", 30], ["M3", 60], ["all loads in daN"]],
            "loads in daN",
        ),
    ],
)
def test_a_sentence_on_the_unit_of_a_list_is_not_passed_over(
    rows: Sequence[Sequence[object]], line: str, tmp_path: Path
) -> None:
    with pytest.raises(lb.InputError, match=f"must have its unit beside it.*{line}"):
        lb.import_campaign(book(tmp_path, rows))


def text(folder: Path, above: Sequence[str], force: str = "") -> Path:
    """Write a circle below lines; ``force`` is the cell of a column of forces without a unit."""
    header = "Angle [deg],Reading [um]"
    rows = [f"{angle_deg:g},{reading_um}" for angle_deg, reading_um in circle(100.0)]
    if force:
        header += ",Force"
        rows = [f"{row},{force}" for row in rows]
    path = folder / "circle.csv"
    path.write_text("\n".join([*above, header, *rows, ""]))
    return path


def test_a_sentence_on_the_unit_of_a_force_in_a_line_is_not_passed_over(tmp_path: Path) -> None:
    path = text(tmp_path, ["all forces in kN", "Force: 0.1"])
    with pytest.raises(lb.InputError, match="got none in line 2, and 'all forces in kN' in line 1"):
        lb.import_campaign(path)
    campaign = lb.import_campaign(path, layout=Layout(forces_N=[100.0])).campaign
    assert [test.force_N for test in campaign.tests] == [100.0]


def test_a_sentence_on_the_unit_of_a_column_of_forces_is_not_passed_over(tmp_path: Path) -> None:
    path = text(tmp_path, ["all forces in daN"], force="10")
    with pytest.raises(lb.InputError, match="got none in its column"):
        lb.import_campaign(path)
    campaign = lb.import_campaign(path, layout=Layout(force_unit="daN")).campaign
    assert [test.force_N for test in campaign.tests] == [100.0]


@pytest.mark.parametrize("line", ["all forces in N", "max. load in kN: see manual"])
def test_the_usual_unit_in_a_sentence_changes_nothing(line: str, tmp_path: Path) -> None:
    assert forces_of(text(tmp_path, [line, "Force: 100"])) == [100.0]


def files_with_lines(folder: Path) -> list[Path]:
    """Write a file for each circle whose force stands in kN above its table, without the unit."""
    paths = []
    for force_N in FORCES_N:
        lines = [f"Force: {force_N / 1000.0}", "Angle [deg];Reading [um]"]
        lines += [f"{angle};{reading}" for angle, reading in circle(force_N)]
        paths.append(folder / f"run{force_N / 100.0:.0f}.csv")
        paths[-1].write_text("\n".join(lines))
    return paths


def list_without_unit(folder: Path) -> list[Path]:
    """Write a workbook whose list of tests states forces in kN, without the unit."""
    rows: list[Sequence[object]] = [("Name", "Kraft")]
    rows += [(f"M{number}", force_N / 1000.0) for number, force_N in enumerate(FORCES_N, start=1)]
    return [book(folder, rows)]


@pytest.mark.parametrize("write", [files_with_lines, list_without_unit])
def test_small_forces_without_a_unit_are_asked(
    write: Callable[[Path], list[Path]], tmp_path: Path
) -> None:
    paths = write(tmp_path)
    with pytest.raises(lb.errors.InputError, match=r"up to 0\.6, .* Say which: --force-unit"):
        lb.import_campaign(paths)
    tests = lb.import_campaign(paths, layout=Layout(force_unit="kN")).campaign.tests
    assert [test.force_N for test in tests] == list(FORCES_N)
