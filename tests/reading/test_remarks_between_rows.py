"""Remarks between rows of numbers, footers, and labelled numbers behind some rows."""

from __future__ import annotations

from pathlib import Path
from time import process_time

import numpy as np
import pytest

import ldbb_bayes as lb
from ldbb_bayes.campaign.text_table import Row
from ldbb_bayes.reading.heading import find_heading
from ldbb_bayes.reading.layout import Layout
from ldbb_bayes.reading.sheet import Sheet
from ldbb_bayes.reading.table_rows import remarks_between

READINGS_UM = np.array([(7 * k) % 11 - 4.75 for k in range(36)])


def rows() -> list[str]:
    return [f"{10 * k};{reading}" for k, reading in enumerate(READINGS_UM)]


def written(folder: Path, lines: list[str]) -> Path:
    path = folder / "300N.csv"
    path.write_text("\n".join(["Angle [deg];Deviation [um]", *lines]), encoding="utf-8")
    return path


@pytest.mark.parametrize("remark", ["# operator sneezed", "// pause", "% Kühlung an"])
def test_a_remark_where_the_angles_run_on_is_left_out_and_told(remark: str, tmp_path: Path) -> None:
    lines = rows()
    lines.insert(20, remark)
    imported = lb.import_campaign(written(tmp_path, lines))
    np.testing.assert_allclose(imported.campaign.tests[0].reading_um, READINGS_UM)
    notes = [note.because for note in imported.assumptions if note.what == "left out"]
    assert notes == [f"{remark!r} in line 22"]


def test_many_remarks_in_a_long_log_are_found_in_seconds() -> None:
    lines = [["Angle [deg]", "Deviation [um]"]]
    for k in range(40_000):
        lines.append([f"{0.009 * k:.3f}", f"{k % 7}"])
        if k % 10 == 5:
            lines.append(["# pause"])
    rows = [Row(k, cells) for k, cells in enumerate(lines, start=1)]
    sheet = Sheet(Path("log.csv"), "", rows, "utf-8", ";")
    heading = find_heading(sheet, Layout())
    start = process_time()
    remarks = remarks_between(sheet, heading)
    assert process_time() - start < 5.0
    assert len(remarks) == 4_000


def test_marks_of_start_and_end_are_left_out(tmp_path: Path) -> None:
    path = written(tmp_path, ["--- START ---", *rows(), "--- END ---"])
    (test,) = lb.import_campaign(path).campaign.tests
    np.testing.assert_allclose(test.reading_um, READINGS_UM)


@pytest.mark.parametrize(
    "remark", ["# clockwise from here", "# force raised", "# 0.2 mm offset", "pause"]
)
def test_a_remark_that_may_state_something_is_refused(remark: str, tmp_path: Path) -> None:
    lines = rows()
    lines.insert(20, remark)
    with pytest.raises(lb.InputError, match="line 22"):
        lb.import_campaign(written(tmp_path, lines))


@pytest.mark.parametrize("second", [rows(), rows()[::-1]])
def test_a_remark_between_two_circles_does_not_join_them(second: list[str], tmp_path: Path) -> None:
    with pytest.raises(lb.InputError, match="line 38"):
        lb.import_campaign(written(tmp_path, [*rows(), "# once more", *second]))


@pytest.mark.parametrize(
    "footer", [["Centre x;1.3", "Centre y;2.0"], ["Limit;50"], ["Exzentrizität;2,4"]]
)
def test_results_below_the_table_are_left_out(footer: list[str], tmp_path: Path) -> None:
    path = written(tmp_path, [*rows(), *footer])
    (test,) = lb.import_campaign(path).campaign.tests
    np.testing.assert_allclose(test.reading_um, READINGS_UM)


@pytest.mark.parametrize("footer", ["x;1.3", "Offset;12.5", "Radius;100"])
def test_other_words_below_the_table_are_refused(footer: str, tmp_path: Path) -> None:
    with pytest.raises(lb.InputError, match="line 38"):
        lb.import_campaign(written(tmp_path, [*rows(), footer]))


def test_labelled_numbers_behind_some_rows_are_left_out(tmp_path: Path) -> None:
    lines = rows()
    lines[0] += ";;Mean;1.2"
    lines[1] += ";;Max;5.25"
    (test,) = lb.import_campaign(written(tmp_path, lines)).campaign.tests
    np.testing.assert_allclose(test.reading_um, READINGS_UM)


@pytest.mark.parametrize("behind", [";7.5", ";;7.5", ";Mean;7.5"])
def test_other_cells_behind_a_row_are_refused(behind: str, tmp_path: Path) -> None:
    lines = rows()
    lines[1] += behind
    with pytest.raises(lb.InputError, match="line 3: rows must have 2 cells"):
        lb.import_campaign(written(tmp_path, lines))
