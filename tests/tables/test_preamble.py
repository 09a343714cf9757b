"""What lines above a table and names of files say: the sign, the unit and the kind must be right, or the line is left alone."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

import ldbb_bayes as lb
from ldbb_bayes.tables.preamble import direction_not_understood, directions_said, load_in_name, said_above


def said(line: str) -> dict[str, float]:
    return {key: own[0].value for key, own in said_above([(1, line)]).items()}


@pytest.mark.parametrize(
    ("line", "key", "value"),
    [
        ("Force: 36 N", "force_N", 36.0),
        ("Force;36;N", "force_N", 36.0),
        ("Force [kN]: 0.742", "force_N", 742.0),
        ("Force in kN: 0.742", "force_N", 742.0),
        ("Radial force = .742 kN", "force_N", 742.0),
        ("Force F = 742 N", "force_N", 742.0),
        ("force_N = 742", "force_N", 742.0),
        ("Kraft: 80 kgf", "force_N", 784.532),
        ("load 7.42e2 N", "force_N", 742.0),
        ("Force: -36 N", "force_N", -36.0),
        ("Pressure: 3,5 bar", "pressure_bar", 3.5),
        ("Pressure [psi]: 50", "pressure_bar", 3.44738),
        ("Druck: 350 mbar", "pressure_bar", 0.35),
        ("Pressure,0.35,MPa", "pressure_bar", 3.5),
        ("Radius [m]: 0.15", "radius_mm", 150.0),
        ("Radius: 15 cm", "radius_mm", 150.0),
        ("Radius: 5.9055 inches", "radius_mm", 149.9997),
        ("Feed 2000 mm/min", "feed_mm_per_min", 2000.0),
        ("Feed rate: 2 m/min", "feed_mm_per_min", 2000.0),
        ("feed 80 ipm", "feed_mm_per_min", 2032.0),
        ("Feed = 33.3 mm/sec", "feed_mm_per_min", 1998.0),
        ("Start angle: -90 deg", "start_deg", -90.0),
        ("Startwinkel: -90°", "start_deg", -90.0),
        ("Start;-90;deg", "start_deg", -90.0),
        ("Start angle: 1.5708 rad", "start_deg", 90.0002),
        ("Start at 90", "start_deg", 90.0),
        ("Overshoot angle: 45", "overshoot_deg", 45.0),
        ("Starting angle: 90 deg", "start_deg", 90.0),
        ("Prüfkraft: 50 N", "force_N", 50.0),
        ("Messkraft;50;N", "force_N", 50.0),
        ("Last: 50 N", "force_N", 50.0),
        ("Regeldruck: 2 bar", "pressure_bar", 2.0),
        ("Force setpoint: 36 N", "force_N", 36.0),
        ("Test No 3, Force 36 N", "force_N", 36.0),
        ("Min. force: 10 N; force: 36 N", "force_N", 36.0),
        ("Radius: 150.000 mm", "radius_mm", 150.0),
        ("Force: 238.000 N", "force_N", 238.0),
        ("Pressure: 3,500 bar", "pressure_bar", 3.5),
    ],
)
def test_said(line: str, key: str, value: float) -> None:
    assert said(line) == {key: pytest.approx(value, rel=1e-5)}


@pytest.mark.parametrize(
    "line",
    [
        "Start: 10:15:00",
        "Start 2026-03-04",
        "Start 04.03.2026",
        "Ambient pressure: 1013 hPa",
        "Max force: 1000 N",
        "Maximum load 500 N",
        "Preload 5 N",
        "Load: 3 of 5",
        "Load case 3",
        "Force: 1,200,000 N",
        "Force: 1 200 N",
        "Force sensor no. 12",
        "Pressure: 5 m/s",
        "workforce 12",
        "Luftdruck: 1013 mbar",
        "Vorspannkraft: 5 N",
        "Force: 1'000 N",
        "Clamping force: 5 N",
        "Ball radius: 6.35 mm",
        "Air pressure: 6 bar",
    ],
)
def test_left_alone(line: str) -> None:
    assert said(line) == {}


@pytest.mark.parametrize(
    ("name", "found"),
    [
        ("middle 3.5 bar", ("pressure_bar", 3.5)),
        ("238N", ("force_N", 238.0)),
        ("run_0.238kN", ("force_N", 238.0)),
        ("36 Newton", ("force_N", 36.0)),
        ("2.5Bar", ("pressure_bar", 2.5)),
        ("200kPa", ("pressure_bar", 2.0)),
        ("ballbar-36N", ("force_N", 36.0)),
        ("f036", ("force_N", 36.0)),
        ("F2000_36N", ("force_N", 36.0)),
        ("G03_F1000_R150_36N", ("force_N", 36.0)),
        ("f36_238N", ("force_N", 238.0)),
        ("36N 742N", None),
        ("3_5bar", None),
        ("2p5 bar", None),
        ("R150", None),
        ("test 12", None),
        ("No 5 North", None),
        ("R150_F2000_a", None),
        ("1_5kN", None),
        ("0_036kN", None),
        ("0_5 N", None),
        ("238_5N", None),
        ("1 238 N", None),
        ("3.5bar 238N", None),
        ("1,000N", None),
        ("test_1_238N", ("force_N", 238.0)),
        ("238.5N", ("force_N", 238.5)),
    ],
)
def test_in_a_name(name: str, found: tuple[str, float] | None) -> None:
    said = load_in_name([name])
    assert (said[:2] if said else None) == (None if found is None else (found[0], pytest.approx(found[1])))


@pytest.mark.parametrize(
    ("line", "names", "found"),
    [
        ("Direction: CW", [], {"CW"}),
        ("Richtung;CCW", [], {"CCW"}),
        ("direction = counter-clockwise", [], {"CCW"}),
        ("Direction: clockwise", ["36N CW"], {"CW"}),
        ("", ["36N_ccw"], {"CCW"}),
        ("", ["cwalk 36N", "scw"], set()),
        ("Direction: CW", ["36N CCW"], {"CW", "CCW"}),
        ("clockwise clock", [], set()),
        ("Direction: counter clockwise", ["36N anti-clockwise"], {"CCW"}),
        ("", ["36N counter_clockwise"], {"CCW"}),
        ("Drehrichtung: CCW", [], {"CCW"}),
        ("Direction of travel: CW", [], {"CW"}),
        ("Direction (CW/CCW): CCW", [], {"CCW"}),
        ("Direction CW/CCW = CW", [], {"CW"}),
        ("Direction: counter–clockwise", [], {"CCW"}),
        ("Direction: contra-clockwise", [], {"CCW"}),
        ("Drehrichtung;im Uhrzeigersinn", [], {"CW"}),
        ("Drehrichtung: gegen den Uhrzeigersinn", [], {"CCW"}),
        ("", ["36 N CW", "cw and ccw"], {"CW"}),
        ("Direction: CW then CCW", [], {"CW", "CCW"}),
    ],
)
def test_direction(line: str, names: list[str], found: set[str]) -> None:
    assert directions_said([(1, line)], names) == found


def test_two_values_in_one_line() -> None:
    assert said("Radius;100;Force;36") == {"radius_mm": 100.0, "force_N": 36.0}
    assert said("Force;36;Pressure;2") == {"force_N": 36.0, "pressure_bar": 2.0}
    assert said("Feed 2000 mm/min, force 36 N") == {"feed_mm_per_min": 2000.0, "force_N": 36.0}


@pytest.mark.parametrize("line", ["Force: 1,000 N", "Force: 1.000 N", "Feed: 2.000 mm/min"])
def test_a_mark_that_may_be_of_thousands_is_no_number(line: str) -> None:
    (value,) = said(line).values()
    assert math.isnan(value)


def test_such_a_line_is_refused_where_it_counts(tmp_path: Path) -> None:
    rows = [f"{5 * k},{k % 7}" for k in range(72)]
    (tmp_path / "a.csv").write_text("\n".join(["Force: 1,000 N", "angle_deg,reading_um", *rows]), encoding="utf-8")
    with pytest.raises(lb.InputError, match="a mark in line 1 that may stand between thousands"):
        lb.import_campaign(tmp_path / "a.csv")
    given = lb.Layout.model_validate({"forces_N": [1000.0]})
    assert lb.import_campaign(tmp_path / "a.csv", layout=given).campaign.tests[0].force_N == 1000.0


def test_loads_that_are_not_understood_are_quoted(tmp_path: Path) -> None:
    rows = [f"{5 * k},{k % 7}" for k in range(72)]
    (tmp_path / "a.csv").write_text("\n".join(["Zug am Balken: 50 N", "angle_deg,reading_um", *rows]), encoding="utf-8")
    with pytest.raises(lb.InputError, match="Line 1 reads 'Zug am Balken: 50 N'; it was not taken for either"):
        lb.import_campaign(tmp_path / "a.csv")


def test_one_of_each_kind_in_a_name() -> None:
    assert load_in_name(["3.5bar 238N"], "force_N") == ("force_N", 238.0, "3.5bar 238N")
    assert load_in_name(["3.5bar 238N"], "pressure_bar") == ("pressure_bar", 3.5, "3.5bar 238N")


def test_a_direction_that_is_not_understood() -> None:
    assert direction_not_understood([(1, "Machine: 7"), (2, "Direction: widdershins")]) == 2
    assert direction_not_understood([(1, "Direction: CW"), (2, "Direction:")]) is None
