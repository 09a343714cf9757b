"""What an import says of the set-up of several planes, and of forces that it converts."""

from __future__ import annotations

from pathlib import Path

import pytest

import ldbb_bayes as lb
from ldbb_bayes.report.message_translation import in_language

SETUP = "1 in all planes and centres: the bar stays mounted"


def table(folder: Path, load: str, tests: list[str], further: str = "") -> Path:
    """Circles of 72 readings; every item of ``tests`` holds the cells of one test."""
    lines = [f"test,{load},{further}angle_deg,reading_um"]
    for number, cells in enumerate(tests):
        lines += [f"c{number},{cells},{5 * k},{k % 7}.25" for k in range(72)]
    file = folder / "all.csv"
    file.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return file


def noted(file: Path, subject: str, **campaign: str) -> list[tuple[str, str]]:
    assumptions = lb.import_campaign(file, **campaign).assumptions
    return [(entry.value, entry.because) for entry in assumptions if entry.what == subject]


def test_one_setup_in_several_planes_is_told(tmp_path: Path) -> None:
    file = table(tmp_path, "force_N", ["36,XY", "742,XY", "36,YZ", "742,YZ"], "plane,")
    assert noted(file, "setup") == [(SETUP, "none stated")]


def test_stated_setups_are_not_told(tmp_path: Path) -> None:
    file = table(tmp_path, "force_N", ["36,XY,1", "742,XY,1", "36,YZ,2"], "plane,setup,")
    assert noted(file, "setup") == []


def test_one_setup_of_one_plane_is_not_told(tmp_path: Path) -> None:
    assert noted(table(tmp_path, "force_N", ["36", "742"]), "setup") == []


@pytest.mark.parametrize(
    ("header", "loads", "note"),
    [
        ("Force [lbf]", ["8.1", "167"], ("lbf", "8.1 lbf are 36.0306 N")),
        ("Force [kN]", ["0.036", "0.742"], ("kN", "0.036 kN are 36 N")),
    ],
)
def test_the_unit_of_converted_forces_is_told_once(
    header: str, loads: list[str], note: tuple[str, str], tmp_path: Path
) -> None:
    file = table(tmp_path, header, loads)
    assert noted(file, "unit of the force") == [note]


def test_forces_in_newtons_are_not_told(tmp_path: Path) -> None:
    assert noted(table(tmp_path, "Force [N]", ["36", "742"]), "unit of the force") == []


def test_both_notes_have_german_words() -> None:
    assert "Messgerät bleibt eingesetzt" in str(in_language(SETUP, "de"))
    assert in_language("8.1 lbf are 36.0306 N", "de") == "8,1 lbf sind 36,0306 N"
