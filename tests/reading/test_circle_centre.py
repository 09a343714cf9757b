"""Centres of circles that lines state: told, whatever else the line states."""

from __future__ import annotations

from pathlib import Path

import pytest

import ldbb_bayes as lb
from ldbb_bayes.reading.layout import TestLayout

TABLE = "\n".join(f"{angle},{angle % 7}" for angle in range(0, 360, 5))


def notes_on(subject: str, folder: Path, line: str, **layout: object) -> list[str]:
    file = folder / "36N.csv"
    file.write_text(f"{line}\nAngle [deg],Reading [um]\n{TABLE}\n")
    imported = lb.import_campaign(file, layout=lb.reading.Layout(**layout))
    return [note.because for note in imported.assumptions if note.what == subject]


def notes_on_centre(folder: Path, line: str, **layout: object) -> list[str]:
    return notes_on("centre", folder, line, **layout)


@pytest.mark.parametrize(
    ("line", "shown"),
    [
        ("; centre X300 Y-120 radius 150", "centre X300 Y-120"),
        ("; centre X300 Y-120  radius 150", "centre X300 Y-120"),
        ("centre X300 Y-120", "centre X300 Y-120"),
        ("Centre: 300; -120; radius 150 mm", "Centre: 300; -120"),
    ],
)
def test_a_centre_is_told(line: str, shown: str, tmp_path: Path) -> None:
    reason = f"line 1 says {shown!r}, perhaps not in machine coordinates"
    assert notes_on_centre(tmp_path, line) == [reason]


def test_a_centre_is_not_told_twice(tmp_path: Path) -> None:
    line = "; centre X300 Y-120  radius 150"
    assert notes_on("texts not used", tmp_path, line) == []


def test_a_centre_that_the_user_states_is_not_told(tmp_path: Path) -> None:
    entry = TestLayout(file="36N.csv", centre_x_mm=300.0, centre_y_mm=-120.0)
    assert notes_on_centre(tmp_path, "; centre X300 Y-120 radius 150", test=[entry]) == []


def test_a_machining_centre_is_no_centre_of_a_circle(tmp_path: Path) -> None:
    assert notes_on_centre(tmp_path, "Machining centre DMU 50, 3 axes") == []
