"""Numbers that a workbook stores as numbers have a certain decimal mark; texts have not."""

from __future__ import annotations

from pathlib import Path

import pytest
from openpyxl import Workbook

import ldbb_bayes as lb
from ldbb_bayes.reading.layout import Layout


def written(folder: Path, first: object, others: object = 100) -> Path:
    """Write a workbook with a column of readings: ``first`` in every second row."""
    book = Workbook()
    sheet = book.active
    sheet.append(["Angle [deg]", "Reading [um]", "Force [N]"])
    for k in range(72):
        sheet.append([5 * k, others if k % 2 else first, 36])
    path = folder / "a.xlsx"
    book.save(path)
    return path


@pytest.mark.parametrize("layout", [Layout(), Layout(decimal=",")])
def test_a_stored_number_has_a_decimal_point(layout: Layout, tmp_path: Path) -> None:
    test = lb.import_campaign(written(tmp_path, 102.222), layout=layout).campaign.tests[0]
    assert list(test.reading_um[:2]) == [102.222, 100.0]


def test_a_number_in_a_text_is_asked(tmp_path: Path) -> None:
    with pytest.raises(lb.InputError, match="Say which mark is decimal"):
        lb.import_campaign(written(tmp_path, "102,222"))
