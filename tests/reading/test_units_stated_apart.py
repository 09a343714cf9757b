"""Units that stand apart from their numbers: in a key of JSON, and in a column behind a radius."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import ldbb_bayes as lb

ROWS = [[10.0 * k, float((7 * k) % 11) - 4.75] for k in range(36)]


def test_a_unit_of_force_for_all_runs_is_taken(tmp_path: Path) -> None:
    runs = [{"force": force, "data": ROWS} for force in (0.1, 0.3)]
    path = tmp_path / "a.json"
    path.write_text(json.dumps({"unit": "um", "force_unit": "kN", "runs": runs}))
    tests = lb.import_campaign(path).campaign.tests
    assert [test.force_N for test in tests] == pytest.approx([100.0, 300.0])


@pytest.mark.parametrize("line", ["Force unit: kN", "Krafteinheit: kN\nForce unit: kN"])
def test_a_line_with_the_unit_of_force_is_taken(line: str, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    rows = "".join(f"{angle};{reading}\n" for angle, reading in ROWS)
    path.write_text(f"{line}\nForce: 0.3\nAngle [deg];Deviation [um]\n{rows}")
    (test,) = lb.import_campaign(path).campaign.tests
    assert test.force_N == pytest.approx(300.0)


@pytest.mark.parametrize(("unit", "number"), [("cm", 10), ("mm", 100), ("m", 0.1)])
def test_a_unit_behind_the_radius_is_that_of_the_radius(
    unit: str, number: float, tmp_path: Path
) -> None:
    path = tmp_path / "300N.csv"
    rows = "".join(f"{number};{unit};{angle};{reading}\n" for angle, reading in ROWS)
    path.write_text(f"Radius;Unit;Angle;Deviation [um]\n{rows}")
    (test,) = lb.import_campaign(path).campaign.tests
    assert test.radius_mm == pytest.approx(100.0)
    assert test.angle_deg[1] == 10.0


def test_units_of_angle_behind_a_radius_belong_to_the_angle(tmp_path: Path) -> None:
    path = tmp_path / "300N.csv"
    rows = "".join(f"100;gon;{angle / 0.9};{reading}\n" for angle, reading in ROWS)
    path.write_text(f"Radius;Unit;Angle;Deviation [um]\n{rows}")
    (test,) = lb.import_campaign(path).campaign.tests
    assert test.angle_deg[1] == pytest.approx(10.0)


def test_signs_of_units_that_were_encoded_twice_are_read(tmp_path: Path) -> None:
    path = tmp_path / "300N.csv"
    rows = "".join(f"{angle};{reading}\n" for angle, reading in ROWS)
    path.write_text(f"Winkel [Â°];Abweichung [Âµm]\n{rows}", encoding="utf-8")
    (test,) = lb.import_campaign(path).campaign.tests
    assert test.reading_um[0] == ROWS[0][1]


@pytest.mark.parametrize(
    ("lines", "force"),
    [("Force (mean): 300 N\nForce (std): 1.2 N", 300.0), ("Kraft (Soll): 0,3 kN", 300.0)],
)
def test_a_word_in_brackets_may_follow_the_force(lines: str, force: float, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    rows = "".join(f"{angle};{reading}\n" for angle, reading in ROWS)
    path.write_text(f"{lines}\nAngle [deg];Deviation [um]\n{rows}")
    (test,) = lb.import_campaign(path).campaign.tests
    assert test.force_N == pytest.approx(force)


def test_a_preload_is_shown_in_the_question_on_the_load(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    rows = "".join(f"{angle};{reading}\n" for angle, reading in ROWS)
    path.write_text(f"Preload: -100 N\nAngle [deg];Deviation [um]\n{rows}")
    with pytest.raises(lb.InputError, match="is 'Preload: -100 N' in line 1 the load"):
        lb.import_campaign(path)


@pytest.mark.parametrize(
    "line", ["Force;100;kg", "Kraft;0.3;kips", "Load|100000|mN", "Force\t10\tkg", "Druck;2;at"]
)
def test_a_load_is_not_taken_in_newtons_if_another_unit_has_a_cell_of_its_own(
    line: str, tmp_path: Path
) -> None:
    path = tmp_path / "a.csv"
    rows = "".join(f"{angle};{reading}\n" for angle, reading in ROWS)
    path.write_text(f"{line}\nAngle [deg];Deviation [um]\n{rows}")
    with pytest.raises(lb.InputError, match="force or pressure must be known"):
        lb.import_campaign(path)


@pytest.mark.parametrize("line", ["Force;100;Operator", "Force;100;N", "Force;100;CCW;good"])
def test_a_load_before_other_cells_is_taken(line: str, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    rows = "".join(f"{angle};{reading}\n" for angle, reading in ROWS)
    path.write_text(f"{line}\nAngle [deg];Deviation [um]\n{rows}")
    (test,) = lb.import_campaign(path).campaign.tests
    assert test.force_N == 100.0


def test_a_unit_of_the_radius_under_a_key_of_its_own_is_taken(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    run = {"force": 300, "force_unit": "N", "data": ROWS}
    path.write_text(json.dumps({"radius": 10, "radius_unit": "cm", "unit": "um", "runs": [run]}))
    (test,) = lb.import_campaign(path).campaign.tests
    assert test.radius_mm == pytest.approx(100.0)
    assert test.force_N == 300.0


def test_units_behind_radius_and_feed_belong_to_them(tmp_path: Path) -> None:
    path = tmp_path / "300N.csv"
    rows = "".join(f"10;cm;1;m/min;{angle};{reading}\n" for angle, reading in ROWS)
    path.write_text(f"Radius;Unit;Feed;Unit;Angle;Deviation [um]\n{rows}")
    campaign = lb.import_campaign(path).campaign
    assert campaign.tests[0].radius_mm == pytest.approx(100.0)
    assert campaign.feed_mm_per_min == pytest.approx(1000.0)


@pytest.mark.parametrize("line", ["Radius;0.5;ft", "Radius: 1 dm"])
def test_a_radius_in_a_unit_that_is_not_read_is_asked_for(line: str, tmp_path: Path) -> None:
    path = tmp_path / "300N.csv"
    rows = "".join(f"{angle};{reading}\n" for angle, reading in ROWS)
    path.write_text(f"{line}\nAngle [deg];Deviation [um]\n{rows}")
    layout = lb.reading.Layout(measured="radius")
    with pytest.raises(lb.InputError, match="the radius must be in mm, cm, m or inch"):
        lb.import_campaign(path, layout=layout)
    (test,) = lb.import_campaign(path, layout=layout, radius_mm=152.4).campaign.tests
    assert test.angle_deg[1] == 10.0
