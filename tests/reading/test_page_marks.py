"""Printouts of several pages: numbers and titles of pages between rows are passed over."""

from __future__ import annotations

from pathlib import Path

import pytest

import ldbb_bayes as lb

COLUMNS = "Angle   Deviation   Temp"
UNITS = "deg     um          C"


def imported(folder: Path, *heads: str, separator: str = "   ") -> lb.reading.Imported:
    """Return a printout of 24 rows below each of some texts, which are the heads of its pages."""
    lines = []
    for page, head in enumerate(heads):
        lines.append(head)
        for k in range(24 * page, 24 * page + 24):
            lines.append(separator.join([f"{5 * k}", f"{0.1 * k:.3f}", "24.1"]))
    path = folder / "100N.txt"
    path.write_text("\n".join([*lines, ""]))
    return lb.import_campaign(path)


@pytest.mark.parametrize(
    "head",
    [
        "Page {p} of 3  Angle [deg]  Deviation [um]  Temp [C]",
        f"Page {{p}} of 3\n{COLUMNS}\n{UNITS}",
        f"\fLab 7   Page {{p}} of 3   Machine 12\n{COLUMNS}\n{UNITS}",
        f"- Seite {{p}} -\n{COLUMNS}\n{UNITS}",
    ],
)
def test_a_head_of_each_page_is_passed_over(head: str, tmp_path: Path) -> None:
    result = imported(tmp_path, *[head.format(p=page) for page in (1, 2, 3)])
    assert [len(test.angle_deg) for test in result.campaign.tests] == [72]


@pytest.mark.parametrize(
    "line",
    ["Page {p} / 3 printed 2026-01-02 12:0{p} by Meier", "Ballbar Lab\nPage {p} of 3"],
)
def test_heads_of_further_pages_are_passed_over(line: str, tmp_path: Path) -> None:
    first = f"Ballbar Lab\n{COLUMNS}\n{UNITS}"
    result = imported(tmp_path, first, *[line.format(p=page) for page in (2, 3)])
    assert [len(test.angle_deg) for test in result.campaign.tests] == [72]


def test_passed_over_heads_are_told(tmp_path: Path) -> None:
    result = imported(tmp_path, f"{COLUMNS}\n{UNITS}", "Page 2 of 3", "Page 3 of 3")
    (note,) = [note for note in result.assumptions if note.what == "repeated headers"]
    assert note.value == "2 passed over, the table is read whole"


def test_a_page_between_semicolons_is_passed_over(tmp_path: Path) -> None:
    head = "Angle [deg];Deviation [um];Temp"
    result = imported(tmp_path, head, "Page 2 of 3;;", "Page 3 of 3;;", separator=";")
    assert [len(test.angle_deg) for test in result.campaign.tests] == [72]


def test_a_load_beside_the_number_of_a_page_is_kept(tmp_path: Path) -> None:
    rows = "\n".join(f"{5 * k}   {0.1 * k:.3f}   24.1" for k in range(72))
    heads = [f"Page {p} of 2   Load {100 * p} N\n{COLUMNS}\n{UNITS}" for p in (1, 2)]
    path = tmp_path / "pages.txt"
    path.write_text("\n".join([heads[0], rows, heads[1], rows, ""]))
    tests = lb.import_campaign(path).campaign.tests
    assert [test.force_N for test in tests] == [100.0, 200.0]
