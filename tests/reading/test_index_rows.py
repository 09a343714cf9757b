"""Headers of several levels, with the name of the index in a row below them."""

from __future__ import annotations

from pathlib import Path

import pytest

import ldbb_bayes as lb
from ldbb_bayes.campaign.text_table import Row
from ldbb_bayes.reading.index_rows import with_index_names
from ldbb_bayes.reading.sheet import Sheet


def header_of(*rows: list[str], below: tuple[str, ...] = ("0", "1", "2")) -> list[str]:
    """Return the header of a table with some rows above two rows of numbers."""
    numbers = [list(below), list(below)]
    lines = [Row(line, cells) for line, cells in enumerate([*rows, *numbers], start=1)]
    sheet = with_index_names(Sheet(Path("a.csv"), "", lines, "utf-8", ","))
    return sheet.rows[len(sheet.rows) - 3].cells


def test_merged_names_belong_to_all_columns_below() -> None:
    header = header_of(["", "100 N", ""], ["", "CW", "CCW"], ["angle_deg", "", ""])
    assert header == ["angle_deg", "100 N CW", "100 N CCW"]


def test_merged_numbers_of_forces_belong_to_all_columns_below() -> None:
    header = header_of(
        ["force_N", "100", "", "300", ""],
        ["direction", "CW", "CCW", "CW", "CCW"],
        ["angle_deg", "", "", "", ""],
        below=("0", "1", "2", "3", "4"),
    )
    assert header == ["angle_deg", "100 N CW", "100 N CCW", "300 N CW", "300 N CCW"]


def test_names_of_the_levels_are_no_names_of_columns() -> None:
    header = header_of(["force", "1 N", "2 N"], ["what", "dev", "dev"], ["angle_deg", "", ""])
    assert header == ["angle_deg", "1 N dev", "2 N dev"]


def test_a_unit_below_the_header_is_no_name_of_an_index() -> None:
    assert header_of(["Angle", "A", "B"], ["deg", "", ""]) == ["deg", "", ""]


def test_equal_directions_become_part_of_the_header() -> None:
    header = header_of(
        ["", "100 N", ""], ["", "dev", "way"], ["angle_deg", "", ""], below=("0", "1", "CW")
    )
    assert header == ["angle_deg", "CW 100 N dev"]


def test_names_above_empty_cells_hold_for_them(tmp_path: Path) -> None:
    rows = ["test,angle_deg,reading_um"]
    for name in ("36 N", "390 N"):
        rows += [f"{name if k == 0 else ''},{10 * k},{0.1 * k:.2f}" for k in range(36)]
    path = tmp_path / "a.csv"
    path.write_text("\n".join([*rows, ""]))
    tests = lb.import_campaign(path).campaign.tests
    assert [(test.name, len(test.angle_deg)) for test in tests] == [("36 N", 36), ("390 N", 36)]


def test_a_name_that_is_missing_between_others_is_refused(tmp_path: Path) -> None:
    rows = ["test,angle_deg,reading_um"]
    rows += [f"{'' if k == 7 else '36 N'},{10 * k},{0.1 * k:.2f}" for k in range(36)]
    path = tmp_path / "a.csv"
    path.write_text("\n".join([*rows, ""]))
    with pytest.raises(lb.InputError, match="line 9: rows must name their test"):
        lb.import_campaign(path)
