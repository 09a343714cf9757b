"""What files do not state is told, and so are texts that nothing was taken from."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import ldbb_bayes as lb


def notes_of(folder: Path, lines: list[str], **layout: Any) -> dict[str, str]:
    """Write a circle of 100 N with lines around its table; return value and reason of each note."""
    rows = [f"{5 * k},{k % 7}.25" for k in range(72)]
    path = folder / "100 N.csv"
    path.write_text("\n".join([*lines, "angle [deg],dR [um]", *rows, ""]), encoding="utf-8")
    return notes_on(path, **layout)


def notes_on(path: Path, **layout: Any) -> dict[str, str]:
    imported = lb.import_campaign(path, layout=lb.reading.Layout.model_validate(layout))
    return {note.what: f"{note.value} ({note.because})" for note in imported.assumptions}


@pytest.mark.parametrize(
    ("subject", "note"),
    [
        ("sign of the reading", "1: a longer bar is positive (nothing says otherwise)"),
        ("reading", "of the radius, not of the diameter (nothing says otherwise)"),
        ("angle", "from the plane's first axis, CCW (nothing says otherwise)"),
        ("direction", "not stated (nothing says otherwise)"),
    ],
)
def test_a_convention_that_nothing_states_is_told(tmp_path: Path, subject: str, note: str) -> None:
    assert notes_of(tmp_path, [])[subject] == note


@pytest.mark.parametrize(
    ("subject", "stated"),
    [
        ("sign of the reading", {"sign": 1}),
        ("reading", {"measured": "radius"}),
        ("angle", {"angle_sense": "CCW"}),
        ("angle", {"angle_sign": 1}),
        ("direction", {"direction": "CCW"}),
    ],
)
def test_a_convention_that_the_user_states_is_not(
    tmp_path: Path, subject: str, stated: dict[str, Any]
) -> None:
    assert "nothing says otherwise" not in notes_of(tmp_path, [], **stated).get(subject, "")


@pytest.mark.parametrize(
    "line",
    [
        "# e = L0 - L",
        "# tare 20 N not subtracted",
        "# scale: 1 digit = 0.5 um",
        "# run 3 invalid: air hose blocked",
    ],
)
def test_a_line_that_is_not_used_is_told(tmp_path: Path, line: str) -> None:
    assert notes_of(tmp_path, [line])["texts not used"] == f"{line!r} (line 1)"


def test_a_line_that_is_used_is_not_told(tmp_path: Path) -> None:
    notes = notes_of(tmp_path, ["Positive reading: bar shorter", "Operator: Meier"])
    assert notes["sign of the reading"] == "-1: a longer bar is negative (line 1)"
    assert "texts not used" not in notes


def test_lines_below_the_table_are_told(tmp_path: Path) -> None:
    rows = "\n".join(f"{5 * k},{k % 7}.25" for k in range(72))
    text = f"angle [deg],dR [um]\n{rows}\n\nPositive reading: bar shorter\n"
    path = tmp_path / "100 N.csv"
    path.write_text(text, encoding="utf-8")
    assert "Positive reading: bar shorter" in notes_on(path)["texts not used"]


def test_cells_beside_the_table_are_told(tmp_path: Path) -> None:
    rows = [f"{5 * k},{k % 7}.25,," for k in range(72)]
    rows[0] = "0,0.25,,Positive reading: bar shorter"
    path = tmp_path / "100 N.csv"
    path.write_text("\n".join(["angle [deg],dR [um],,", *rows, ""]), encoding="utf-8")
    assert "'Positive reading: bar shorter'" in notes_on(path)["texts not used"]


def test_texts_beyond_six_are_counted(tmp_path: Path) -> None:
    notes = notes_of(tmp_path, [f"# remark {word}" for word in "abcdefgh"])
    assert notes["texts not used"] == "2 (further lines)"


def test_radius_or_diameter_is_told_beside_a_stated_sign(tmp_path: Path) -> None:
    notes = notes_of(tmp_path, ["Positive reading: bar shorter"])
    assert notes["reading"] == "of the radius, not of the diameter (nothing says otherwise)"


def test_a_note_on_one_file_does_not_hide_a_line_of_another(tmp_path: Path) -> None:
    """Line 1 of the first file states the sign; line 1 of the second file is not understood."""
    rows = "\n".join(f"{5 * k},{k % 7}.25" for k in range(72))
    texts = {"100 N.csv": "Positive reading: bar shorter", "200 N.csv": "# tare not subtracted"}
    for name, line in texts.items():
        path = tmp_path / name
        path.write_text(f"{line}\nangle [deg],dR [um]\n{rows}\n", encoding="utf-8")
    imported = lb.import_campaign([tmp_path / name for name in texts])
    values = [note.value for note in imported.assumptions if note.what == "texts not used"]
    assert values == ["'# tare not subtracted'"]


def test_lines_below_several_columns_of_readings_are_told(tmp_path: Path) -> None:
    rows = "\n".join(f"{5 * k},{k % 7}.25,{k % 5}.5" for k in range(72))
    text = f"angle [deg],100 N [um],200 N [um]\n{rows}\n\nPositive reading: bar shorter,,\n"
    path = tmp_path / "all.csv"
    path.write_text(text, encoding="utf-8")
    assert "Positive reading: bar shorter" in notes_on(path)["texts not used"]
