"""Lists of tests with times and radii, columns of directions, and columns of the same name."""

from __future__ import annotations

from datetime import time
from pathlib import Path

import openpyxl
import pytest
from campaigns import refuses

import ldbb_bayes as lb
from ldbb_bayes.reading.layout import Layout
from ldbb_bayes.reading.timestamps import stamps_in

ENGLISH = ("Sheet", "Pressure (MPa)", "Direction", "Start time", "Radius (mm)")
FRENCH = ("Essai", "Pression (MPa)", "Sens", "Heure de début", "Rayon (mm)")


def workbook(folder: Path, header: tuple[str, ...], directions: tuple[str, str]) -> Path:
    """Write two circles, and a list of them with pressure, direction, time and radius."""
    book = openpyxl.Workbook()
    overview = book.worksheets[0]
    overview.title = "Index"
    overview.append(list(header))
    for number, direction in enumerate(directions, start=1):
        name = f"Essai {number}"
        overview.append([name, 0.1 * number, direction, time(14, 7 * number), 250])
        sheet = book.create_sheet(name)
        sheet.append(["angle [deg]", "reading [um]"])
        for k in range(72):
            sheet.append([5 * k, k % 7 + 0.25])
    path = folder / "all.xlsx"
    book.save(path)
    return path


def table(folder: Path, words: tuple[str, str]) -> Path:
    """Write one table of two circles, with a column of directions in these words."""
    lines = ["Versuch;Zeitstempel;Last_N;Richtung;Winkel_deg;Anzeige_um"]
    for number, word in enumerate(words, start=1):
        stamp = f"20.11.2026 08:{10 * number}:00"
        for k in range(72):
            angle = (5 * k, 355 - 5 * k)[word in ("RL", "R", "cw", "hin")]
            lines.append(f"V{number};{stamp};{100 * number};{word};{angle};{k % 7}.25")
    path = folder / "all.csv"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return path


def reasons(path: Path, subject: str, **options: object) -> list[str]:
    """Return the reasons of the notes on a subject."""
    assumptions = lb.import_campaign(path, layout=Layout(**options)).assumptions
    return [note.because for note in assumptions if note.what == subject]


@pytest.mark.parametrize("first", ["Sheet", "Test"])
def test_a_list_with_times_and_radii_is_no_log(tmp_path: Path, first: str) -> None:
    path = workbook(tmp_path, (first, *ENGLISH[1:]), ("CW", "CCW"))
    tests = lb.import_campaign(path).campaign.tests
    assert [test.radius_mm for test in tests] == [250.0, 250.0]


def test_a_french_list_states_directions(tmp_path: Path) -> None:
    path = workbook(tmp_path, FRENCH, ("horaire", "antihoraire"))
    tests = lb.import_campaign(path).campaign.tests
    assert [test.direction for test in tests] == ["CW", "CCW"]


def test_a_french_list_states_start_times(tmp_path: Path) -> None:
    path = workbook(tmp_path, FRENCH, ("horaire", "antihoraire"))
    tests = lb.import_campaign(path).campaign.tests
    assert [test.time_s for test in tests] == [0.0, 420.0]


def test_a_french_end_is_no_start_time() -> None:
    assert stamps_in("Heure de fin: 14:05:00") == []


def test_a_direction_of_a_list_is_told_as_such(tmp_path: Path) -> None:
    path = workbook(tmp_path, ENGLISH, ("CW", "CCW"))
    assert "the list of tests on another sheet" in reasons(path, "direction")


def test_a_long_list_of_sources_is_not_cut_within_a_word(tmp_path: Path) -> None:
    folder = tmp_path / ("folder " * 12).strip()
    folder.mkdir()
    path = workbook(folder, ENGLISH, ("CW", "CCW"))
    assert reasons(path, "time_s")[0].endswith("sheet 'Index', …")


@pytest.mark.parametrize("words", [("RL", "LL"), ("R", "L")])
def test_letters_in_a_column_of_directions_are_read(tmp_path: Path, words: tuple[str, str]) -> None:
    tests = lb.import_campaign(table(tmp_path, words)).campaign.tests
    assert [test.direction for test in tests] == ["CW", "CCW"]


def test_r_alone_is_no_direction(tmp_path: Path) -> None:
    refuses("Write CW or CCW into the column", lb.import_campaign, table(tmp_path, ("R", "R")))


def test_a_word_that_is_no_direction_is_told_as_not_understood(tmp_path: Path) -> None:
    path = table(tmp_path, ("hin", "hin"))
    assert "the file says 'hin', not understood" in reasons(path, "direction", direction="CW")


def test_a_column_of_start_times_is_not_told_as_unused(tmp_path: Path) -> None:
    path = table(tmp_path, ("cw", "ccw"))
    assert reasons(path, "columns not used") == []


def pairs(folder: Path, rule: str) -> Path:
    """Write one circle in three pairs of columns of the same names, with a rule below them."""
    lines = [" Winkel Abw." * 3, " Grad um" * 3, rule]
    for k in range(24):
        lines.append(" ".join(f"{120 * part + 5 * k} {k % 7}.25" for part in range(3)))
    path = folder / "100N.txt"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return path


def test_parts_of_a_circle_above_a_rule_are_put_below_each_other(tmp_path: Path) -> None:
    refuses("Put all pairs below each other", lb.import_campaign, pairs(tmp_path, "-" * 40))


def test_columns_of_one_name_are_asked_for_by_number(tmp_path: Path) -> None:
    path = pairs(tmp_path, "")
    layout = Layout(columns={"angle": "Winkel", "reading": 2})
    message = "one of 1, 3, 5: --angle-column 1"
    refuses(message, lb.import_campaign, path, layout=layout)
