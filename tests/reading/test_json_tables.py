"""Files in JSON: lists of records and of numbers are tables, everything else speaks for them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ldbb_bayes as lb

ANGLES = [5.0 * k for k in range(72)]
READINGS = [round(float(np.cos(np.deg2rad(2.0 * angle))), 3) for angle in ANGLES]
CIRCLE = {"angle_deg": ANGLES, "reading_um": READINGS}


def imported(folder: Path, content: Any) -> lb.reading.Imported:
    path = folder / "run.json"
    path.write_text(json.dumps(content))
    return lb.import_campaign(path)


def test_columns_of_numbers_are_a_table(tmp_path: Path) -> None:
    test = imported(tmp_path, {"force_N": 36, **CIRCLE}).campaign.tests[0]
    np.testing.assert_allclose(test.reading_um, READINGS)


def test_a_statement_beside_the_columns_is_used(tmp_path: Path) -> None:
    result = imported(tmp_path, {"force_N": 36, "radius": {"value": 0.1, "unit": "m"}, **CIRCLE})
    assert result.campaign.tests[0].radius_mm == 100.0


def test_a_table_is_named_after_its_place(tmp_path: Path) -> None:
    result = imported(tmp_path, {"36 N": CIRCLE, "490 N": CIRCLE})
    assert [test.force_N for test in result.campaign.tests] == [36.0, 490.0]


def test_a_statement_holds_only_for_the_tables_beside_it(tmp_path: Path) -> None:
    tests = [{"force_N": 36, "direction": "CW", **CIRCLE}]
    tests.append({"force_N": 490, "direction": "CCW", **CIRCLE})
    result = imported(tmp_path, {"plane": "YZ", "tests": tests})
    assert [test.direction for test in result.campaign.tests] == ["CW", "CCW"]


def test_a_missing_reading_is_left_out(tmp_path: Path) -> None:
    readings = [None, *READINGS[1:]]
    result = imported(tmp_path, {"force_N": 36, "angle_deg": ANGLES, "reading_um": readings})
    assert result.campaign.readings == len(READINGS) - 1


def test_a_key_that_stands_twice_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.json"
    path.write_text(json.dumps({"force_N": 36, **CIRCLE})[:-1] + ', "force_N": 490}')
    with pytest.raises(lb.InputError, match="keys in JSON must differ, got 'force_N' twice"):
        lb.import_campaign(path)


def test_invalid_json_is_refused_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "run.json"
    path.write_text('{"force_N": 36,\n "angle_deg": [0, 5,,]}')
    with pytest.raises(lb.InputError, match="line 2: JSON must be valid"):
        lb.import_campaign(path)


def test_json_without_a_table_is_refused_with_the_step(tmp_path: Path) -> None:
    step = "got JSON without lists of angles and readings of the same length. Save the readings as"
    with pytest.raises(lb.InputError, match=step):
        imported(tmp_path, {"force_N": 36, "angle_deg": ANGLES, "reading_um": READINGS[1:]})


ATTRIBUTES = {
    "force_N": 36,
    "angle": "bar angle in deg, zero on the -X axis, counterclockwise",
    "deviation": "radial deviation in um, positive when the bar is extended",
}
SPLIT = {
    "attrs": ATTRIBUTES,
    "columns": ["theta", "dev"],
    "data": [list(pair) for pair in zip(ANGLES, READINGS, strict=True)],
}


def test_a_list_of_names_of_columns_is_no_text_about_angles(tmp_path: Path) -> None:
    result = imported(tmp_path, SPLIT)
    because = [note.because for note in result.assumptions if note.what == "angle"]
    assert because == ["line 2"]
    assert not any("columns: theta" in note.value for note in result.assumptions)


def test_a_bar_that_is_extended_is_longer(tmp_path: Path) -> None:
    notes = imported(tmp_path, SPLIT).assumptions
    (sign,) = [note for note in notes if note.what == "sign of the reading"]
    assert (sign.value, sign.because) == ("1: a longer bar is positive", "line 3")


def test_an_open_sign_is_quoted_with_its_words(tmp_path: Path) -> None:
    text = "radial deviation as shown by the usual display of the bar is positive shorter longer"
    content = {"force_N": 36, "deviation": text, **CIRCLE}
    with pytest.raises(lb.InputError, match="positive shorter longer' in line 2"):
        imported(tmp_path, content)
