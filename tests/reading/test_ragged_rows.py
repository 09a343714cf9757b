"""Rows of printed tables with more cells than names, and other tables that were stuck."""

from __future__ import annotations

from pathlib import Path

import pytest
from openpyxl import Workbook

import ldbb_bayes as lb
from ldbb_bayes.reading.layout import Layout
from ldbb_bayes.reading.statistics_rows import statistics_among


def imported(path: Path, *lines: str, forces_N: tuple[float, ...] = ()) -> lb.reading.Imported:
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return lb.import_campaign(path, layout=Layout(forces_N=list(forces_N)))


def test_units_behind_the_numbers_of_all_rows_need_no_name(tmp_path: Path) -> None:
    rows = [f"{(15 * k) // 2}°{30 * (k % 2):02d}'   {k % 7},25 µm" for k in range(48)]
    test = imported(tmp_path / "36 N.txt", "Angle     Écart", *rows).campaign.tests[0]
    assert test.angle_deg[1] == pytest.approx(7.5)
    assert test.reading_um[1] == pytest.approx(1.25)


def test_remarks_in_some_rows_are_told(tmp_path: Path) -> None:
    rows = [f"{5 * k}   {k % 7}.25" for k in range(72)]
    rows[9] += "   small bump"
    result = imported(tmp_path / "36 N.txt", "Angle   Deviation   Remark", *rows)
    assert result.campaign.readings == 72
    assert "'small bump'" in [note.value for note in result.assumptions]


def test_groups_of_r_are_runs(tmp_path: Path) -> None:
    lines = []
    for group, force in enumerate((36, 122)):
        lines += [f"$`{force}`", "       phi      dr"]
        lines += [f"{72 * group + k + 1}  {5 * k}.5  {k % 7}.25" for k in range(72)]
        lines.append("")
    tests = imported(tmp_path / "sink.txt", *lines, forces_N=(36.0, 122.0)).campaign.tests
    assert [(test.force_N, len(test.angle_deg)) for test in tests] == [(36.0, 72), (122.0, 72)]


def test_a_web_page_named_as_a_workbook_is_told(tmp_path: Path) -> None:
    with pytest.raises(lb.InputError, match=r"got a page in HTML\. .* save it as XLSX"):
        imported(tmp_path / "36 N.xls", "<html><table>", "<tr><td>0</td></tr>", "</table></html>")


def save_sheet(path: Path, rows: list[list[object]]) -> None:
    book = Workbook()
    for row in rows:
        book.active.append(row)
    book.save(path)


def test_a_column_of_remarks_beside_all_pairs_belongs_to_each(tmp_path: Path) -> None:
    header = ["Angle [deg]", "36 N [um]", None, "Angle [deg]", "122 N [um]", None, "Remarks"]
    rows: list[list[object]] = [header]
    for k in range(72):
        rows.append([5 * k, k % 7 + 0.5, None, (5 * k + 30) % 360, k % 5 + 0.5, None, None])
    rows[3][6] = "positive = bar shorter"
    save_sheet(tmp_path / "m.xlsx", rows)
    result = lb.import_campaign(tmp_path / "m.xlsx")
    assert [test.force_N for test in result.campaign.tests] == [36.0, 122.0]
    signs = [note for note in result.assumptions if note.what == "sign of the reading"]
    assert [note.value for note in signs] == ["-1: a longer bar is negative"]


def test_angles_in_a_row_before_a_remark_are_named(tmp_path: Path) -> None:
    rows: list[list[object]] = [["Run", "Force / N", *range(0, 360, 10), "Remark"]]
    rows += [[f"M{k}", force, *[0.1 * k] * 36, None] for k, force in enumerate((36, 122, 238))]
    save_sheet(tmp_path / "m.xlsx", rows)
    with pytest.raises(lb.InputError, match=r"got 0 to 350 in one row\. Transpose the table"):
        lb.import_campaign(tmp_path / "m.xlsx")


def test_less_certain_words_count_next_to_a_mean() -> None:
    assert statistics_among(["0", "5", "Min", "Max", "Mittelwert"]) == [2, 3, 4]
    assert statistics_among(["0", "Max", "5", "Mittelwert"]) == [3]


def test_vectors_of_two_circles_are_not_paired(tmp_path: Path) -> None:
    numbers = " ".join(f"{k}.5" for k in range(36))
    lines = ["% dl in um", "phi = 0:10:350;", *(f"B({k}).dl = [{numbers}];" for k in (1, 2))]
    with pytest.raises(
        lb.InputError, match=r"writematrix\(\[phi\(:\) B\(1\)\.dl\(:\)\]"
    ) as refused:
        imported(tmp_path / "bar.m", *lines)
    assert "Copy the lines that begin with %" in str(refused.value)
