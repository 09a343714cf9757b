"""Centres of circles that lines state: used if they are clear, and told in any case."""

from __future__ import annotations

from pathlib import Path

import pytest

import ldbb_bayes as lb
from ldbb_bayes.reading.layout import TestLayout

TABLE = "\n".join(f"{angle},{angle % 7}" for angle in range(0, 360, 5))


def imported_test(folder: Path, line: str) -> lb.CircularTest:
    file = folder / "36N.csv"
    file.write_text(f"{line}\nAngle [deg],Reading [um]\n{TABLE}\n")
    return lb.import_campaign(file).campaign.tests[0]


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
        ("Circle centre (G54): X 10 Y 20", "centre (G54): X 10 Y 20"),
        ("Centre X 10 in, Y 7 in", "Centre X 10 in,Y 7 in"),
        ("Centre X1,250 Y300", "Centre X1,250 Y300"),
        ("Centre: 300; -120; radius 150 mm", "Centre: 300; -120"),
    ],
)
def test_a_centre_that_may_be_elsewhere_is_told(line: str, shown: str, tmp_path: Path) -> None:
    reason = f"line 1 says {shown!r}, perhaps not in machine coordinates"
    assert notes_on_centre(tmp_path, line) == [reason]


@pytest.mark.parametrize(
    ("line", "centre_mm"),
    [
        ("centre X 250 Y 180 mm", (250.0, 180.0, 0.0)),
        ("Kreismittelpunkt X 250,5 Y -180,0 Z 40", (250.5, -180.0, 40.0)),
        ("Centro X: 250 mm; Y: 180 mm", (250.0, 180.0, 0.0)),
        ("Radius 150 mm, centre X=250 Y=180 mm, feed 1000 mm/min", (250.0, 180.0, 0.0)),
    ],
)
def test_a_clear_centre_is_used(
    line: str, centre_mm: tuple[float, float, float], tmp_path: Path
) -> None:
    test = imported_test(tmp_path, line)
    assert (test.centre_x_mm, test.centre_y_mm, test.centre_z_mm) == centre_mm


def test_a_used_centre_is_told(tmp_path: Path) -> None:
    reason = "line 1 says 'centre X 250 Y 180 mm', taken as machine coordinates"
    assert notes_on_centre(tmp_path, "centre X 250 Y 180 mm") == [reason]


def test_a_centre_is_no_radius(tmp_path: Path) -> None:
    reasons = notes_on("radius_mm", tmp_path, "centre X 250 Y 180 mm")
    assert reasons == ["nothing says otherwise"]


def test_two_centres_are_not_used(tmp_path: Path) -> None:
    test = imported_test(tmp_path, "centre X 250 Y 180 mm\ncentre X 250 Y 190 mm")
    assert test.centre_x_mm == 0.0


@pytest.mark.parametrize("line", ["; centre X300 Y-120  radius 150", "centre X=300, Y=-120 mm"])
def test_a_centre_is_not_told_twice(line: str, tmp_path: Path) -> None:
    assert notes_on("texts not used", tmp_path, line) == []


def test_a_centre_that_the_user_states_is_not_told(tmp_path: Path) -> None:
    entry = TestLayout(file="36N.csv", centre_x_mm=300.0, centre_y_mm=-120.0)
    assert notes_on_centre(tmp_path, "; centre X300 Y-120 radius 150", test=[entry]) == []


def test_a_machining_centre_is_no_centre_of_a_circle(tmp_path: Path) -> None:
    assert notes_on_centre(tmp_path, "Machining centre DMU 50, 3 axes") == []
