"""Loads in lines above one table: read where they have one meaning, else named in the refusal."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import ldbb_bayes as lb

TABLE = "\n".join(f"{angle},{angle % 7}" for angle in range(0, 360, 5))
READ = {
    "Forza: 490 N": 490.0,
    "荷重:490 N": 490.0,
    "荷重,４９０Ｎ": 490.0,
    "Fuerza 490 N": 490.0,
    "Kraft von 490 N": 490.0,
    "At a load of 0.49 kN, clockwise": 490.0,
    "Run 1: 490 N": 490.0,
    "Run 1: 53.50 lb": 53.5 * 4.4482216152605,
    "Test at 490 N, clockwise": 490.0,
    "490 N": 490.0,
    "490 N push CW run 2": 490.0,
    "490 N, plane XY, CCW, R150": 490.0,
    "490 N, positive = longer bar": 490.0,
    "Belastung 490 N im Uhrzeigersinn": 490.0,
    "Plane: XY, 490 N": 490.0,
}
STATED_BESIDE = {
    "Load 490 N CCW": "CCW",
    "490 N push CW run 2": "CW",
    "Test at 490 N, clockwise": "CW",
    "Messung bei 490 N rechts herum": "CW",
    "490 N G3": "CCW",
}
PLANES_BESIDE = ["490 N YZ CW", "YZ 490 N", "Load 490 N, YZ"]
UNCLEAR = [
    "Weight of the table 490 N",
    "Weight of the table, 490 N",
    "490 N pull CW",
    "490 N / 742 N",
    "Operator 490 N",
]


def file_with(folder: Path, line: str, name: str = "run.csv") -> Path:
    file = folder / name
    file.write_text(f"{line}\nAngle [deg],Reading [um]\n{TABLE}\n", encoding="utf-8")
    return file


@pytest.mark.parametrize("line", READ)
def test_a_load_with_one_meaning_is_read(line: str, tmp_path: Path) -> None:
    campaign = lb.import_campaign(file_with(tmp_path, line)).campaign
    assert campaign.tests[0].force_N == pytest.approx(READ[line])


@pytest.mark.parametrize("line", UNCLEAR)
def test_a_load_of_unclear_meaning_is_named_in_the_refusal(line: str, tmp_path: Path) -> None:
    message = re.escape(f"(is {line!r} in line 1 the load?). Give --forces-N")
    with pytest.raises(lb.InputError, match=message):
        lb.import_campaign(file_with(tmp_path, line))


def test_a_load_of_another_quantity_is_not_read(tmp_path: Path) -> None:
    with pytest.raises(lb.InputError, match=r"or the name\. Give --forces-N"):
        lb.import_campaign(file_with(tmp_path, "Machine max 490 N"))


def test_a_preload_is_asked_for_by_its_line(tmp_path: Path) -> None:
    with pytest.raises(lb.InputError, match=r"is 'Preload 490 N' in line 1 the load\?"):
        lb.import_campaign(file_with(tmp_path, "Preload 490 N"))


def test_a_load_in_the_name_comes_first(tmp_path: Path) -> None:
    campaign = lb.import_campaign(file_with(tmp_path, "Run 1: 490 N", "36N.csv")).campaign
    assert campaign.tests[0].force_N == 36.0


def test_one_line_is_no_load_of_several_columns(tmp_path: Path) -> None:
    file = tmp_path / "wide.csv"
    rows = "\n".join(f"{angle},{angle % 7},{angle % 5}" for angle in range(0, 360, 5))
    file.write_text(f"Run 1: 490 N\nAngle [deg],Run A [um],Run B [um]\n{rows}\n")
    layout = lb.reading.Layout(columns={"reading": [2, 3]})
    with pytest.raises(lb.InputError, match="is 'Run 1: 490 N' in line 1 the load"):
        lb.import_campaign(file, layout=layout)


@pytest.mark.parametrize("line", STATED_BESIDE)
def test_a_direction_beside_a_load_is_read(line: str, tmp_path: Path) -> None:
    campaign = lb.import_campaign(file_with(tmp_path, line)).campaign
    assert campaign.tests[0].direction == STATED_BESIDE[line]


def test_two_directions_beside_a_load_are_not_read(tmp_path: Path) -> None:
    campaign = lb.import_campaign(file_with(tmp_path, "490 N CW/CCW")).campaign
    assert campaign.tests[0].direction is None


@pytest.mark.parametrize("line", PLANES_BESIDE)
def test_a_plane_beside_a_load_is_read(line: str, tmp_path: Path) -> None:
    assert lb.import_campaign(file_with(tmp_path, line)).campaign.plane == "YZ"


def test_a_used_load_is_not_told_as_unused(tmp_path: Path) -> None:
    imported = lb.import_campaign(file_with(tmp_path, "Test at 490 N, clockwise"))
    assert [note for note in imported.assumptions if note.what == "texts not used"] == []
