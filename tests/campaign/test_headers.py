"""What headers, lines above a table and names of files say: sign, unit and kind must be right, or they are left alone."""

from __future__ import annotations

import math
import re

import pytest

from ldbb_bayes.campaign.headers import directions_said, load_in_name, said_above, unit_of


def cases(text: str) -> list[list[str]]:
    """Cases, a line or a bar apart, of cells that two blanks or more set apart."""
    return [[cell.strip() for cell in case.strip().split("  ") if cell.strip()] for case in re.split(r"\n|  \|  ", text.strip())]


def said(line: str) -> dict[str, float]:
    return {key: own[0].value for key, own in said_above([(1, line)]).items()}


@pytest.mark.parametrize(
    ("header", "name", "unit"),
    cases("""
    Angle [°]  Angle  deg  |  reading_um  reading  um  |  Radial deviation (µm)  Radial deviation  um
    Radial deviation (μm)  Radial deviation  um  |  P/bar  P  bar  |  Kraft in kN  Kraft  kN  |  rho, mm  rho  mm
    t (ms)  t  ms  |  angle  angle  none  |  serial number  serial number  none  |  test  test  none
    reading 2 µm  reading 2  um  |  Pressure [MPa (gauge)]  Pressure  MPa
    reading / 0.1 µm  reading / 0.1  (0.1) um  |  Reading [10 um]  Reading  10 um
    Force (kN)*  Force  kN  |  Reading [µm] (CW)  Reading  um  |  Angle (0-360°)  Angle  deg
    Reading [mm] (inch)  Reading  mm and inch  |  Pressure (barg)  Pressure  bar
    """),
)
def test_unit_of_a_header(header: str, name: str, unit: str) -> None:
    assert unit_of(header) == (name, "" if unit == "none" else unit)


@pytest.mark.parametrize(
    ("line", "key", "value"),
    cases("""
    Force: 36 N  force_N  36  |  Force;36;N  force_N  36  |  Force [kN]: 0.742  force_N  742
    Force in kN: 0.742  force_N  742  |  Radial force = .742 kN  force_N  742  |  Force F = 742 N  force_N  742
    force_N = 742  force_N  742  |  Kraft: 80 kgf  force_N  784.532  |  load 7.42e2 N  force_N  742
    Force: -36 N  force_N  -36  |  Pressure: 3,5 bar  pressure_bar  3.5  |  Pressure [psi]: 50  pressure_bar  3.44738
    Druck: 350 mbar  pressure_bar  0.35  |  Pressure,0.35,MPa  pressure_bar  3.5  |  Radius [m]: 0.15  radius_mm  150
    Radius: 15 cm  radius_mm  150  |  Radius: 5.9055 inches  radius_mm  149.9997
    Feed 2000 mm/min  feed_mm_per_min  2000  |  Feed rate: 2 m/min  feed_mm_per_min  2000
    feed 80 ipm  feed_mm_per_min  2032  |  Feed = 33.3 mm/sec  feed_mm_per_min  1998
    Start angle: -90 deg  start_deg  -90  |  Startwinkel: -90°  start_deg  -90  |  Start;-90;deg  start_deg  -90
    Start angle: 1.5708 rad  start_deg  90.0002  |  Start at 90  start_deg  90  |  Overshoot angle: 45  overshoot_deg  45
    Starting angle: 90 deg  start_deg  90  |  Prüfkraft: 50 N  force_N  50  |  Messkraft;50;N  force_N  50
    Last: 50 N  force_N  50  |  Regeldruck: 2 bar  pressure_bar  2  |  Force setpoint: 36 N  force_N  36
    Test No 3, Force 36 N  force_N  36  |  Min. force: 10 N; force: 36 N  force_N  36
    Radius: 150.000 mm  radius_mm  150  |  Force: 238.000 N  force_N  238  |  Pressure: 3,500 bar  pressure_bar  3.5
    """),
)
def test_said(line: str, key: str, value: str) -> None:
    assert said(line) == {key: pytest.approx(float(value), rel=1e-5)}


def test_two_values_in_one_line() -> None:
    assert said("Radius;100;Force;36") == {"radius_mm": 100.0, "force_N": 36.0}
    assert said("Feed 2000 mm/min, force 36 N") == {"feed_mm_per_min": 2000.0, "force_N": 36.0}


@pytest.mark.parametrize(
    ("one", "other"),
    cases("""
    Start: 10:15:00  Start 2026-03-04  |  Start 04.03.2026  Ambient pressure: 1013 hPa
    Max force: 1000 N  Maximum load 500 N  |  Preload 5 N  Load: 3 of 5  |  Load case 3  Force: 1,200,000 N
    Force: 1 200 N  Force sensor no. 12  |  Pressure: 5 m/s  workforce 12  |  Luftdruck: 1013 mbar  Vorspannkraft: 5 N
    Force: 1'000 N  Clamping force: 5 N  |  Ball radius: 6.35 mm  Air pressure: 6 bar
    """),
)
def test_left_alone(one: str, other: str) -> None:
    assert said(one) == said(other) == {}


@pytest.mark.parametrize("line", ["Force: 1,000 N", "Force: 1.000 N", "Feed: 2.000 mm/min"])
def test_a_mark_that_may_be_of_thousands_is_no_number(line: str) -> None:
    (value,) = said(line).values()
    assert math.isnan(value)


@pytest.mark.parametrize(
    ("name", "bar", "newton"),
    cases("""
    middle 3.5 bar  3.5  -  |  238N  -  238  |  run_0.238kN  -  238  |  36 Newton  -  36  |  2.5Bar  2.5  -
    200kPa  2  -  |  ballbar-36N  -  36  |  f036  -  36  |  F2000_36N  -  36  |  G03_F1000_R150_36N  -  36
    f36_238N  -  238  |  test_1_238N  -  238  |  238.5N  -  238.5  |  36N 742N  -  -  |  3_5bar  -  -  |  2p5 bar  -  -
    R150  -  -  |  test 12  -  -  |  No 5 North  -  -  |  R150_F2000_a  -  -  |  1_5kN  -  -  |  0_036kN  -  -
    0_5 N  -  -  |  238_5N  -  -  |  1 238 N  -  -  |  3.5bar 238N  -  -  |  1,000N  -  -
    """),
)
def test_a_load_in_a_name(name: str, bar: str, newton: str) -> None:
    expected = {"pressure_bar": bar, "force_N": newton}
    found = load_in_name([name])
    assert {key: value for key, value, _ in ([found] if found else [])} == {
        key: pytest.approx(float(value)) for key, value in expected.items() if value != "-"
    }
    assert load_in_name(["3.5bar 238N"], "force_N") == ("force_N", 238.0, "3.5bar 238N")
    assert load_in_name(["3.5bar 238N"], "pressure_bar") == ("pressure_bar", 3.5, "3.5bar 238N")


@pytest.mark.parametrize(
    ("line", "names", "found"),
    cases("""
    Direction: CW  -  CW  |  Richtung;CCW  -  CCW  |  direction = counter-clockwise  -  CCW
    Direction: clockwise  36N CW  CW  |  -  36N_ccw  CCW  |  -  cwalk 36N, scw  none  |  Direction: CW  36N CCW  CCW CW
    clockwise clock  -  none  |  Direction: counter clockwise  36N anti-clockwise  CCW  |  -  36N counter_clockwise  CCW
    Drehrichtung: CCW  -  CCW  |  Direction of travel: CW  -  CW  |  Direction (CW/CCW): CCW  -  CCW
    Direction CW/CCW = CW  -  CW  |  Direction: counter–clockwise  -  CCW  |  Direction: contra-clockwise  -  CCW
    Drehrichtung;im Uhrzeigersinn  -  CW  |  Drehrichtung: gegen den Uhrzeigersinn  -  CCW  |  -  36 N CW, cw and ccw  CW
    Direction: CW then CCW  -  CCW CW
    """),
)
def test_direction(line: str, names: str, found: str) -> None:
    assert sorted(directions_said([(1, line)], names.split(", "))) == found.replace("none", "").split()
