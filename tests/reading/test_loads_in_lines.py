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
}
UNCLEAR = ["Weight of the table 490 N", "490 N / 742 N", "Operator 490 N"]


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


@pytest.mark.parametrize("line", ["Machine max 490 N", "Preload 490 N"])
def test_a_load_of_another_quantity_is_not_read(line: str, tmp_path: Path) -> None:
    with pytest.raises(lb.InputError, match=r"or the name\. Give --forces-N"):
        lb.import_campaign(file_with(tmp_path, line))


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
