"""Logs over time whose speed is stated in degrees per second, or in a row of units."""

from __future__ import annotations

from pathlib import Path

import pytest

import ldbb_bayes as lb

ABOVE = "Direction: CCW\nStart angle: 0°\n"


def log(folder: Path, above: str, header: str = "Time [s];Dev [um]", between: str = "") -> Path:
    """Write a full turn in 60 s, in steps of 0.6 s, which are 3.6 degrees."""
    rows = "".join(f"{0.6 * k:.1f};{between}{(7 * k) % 11}.25\n" for k in range(101))
    path = folder / "300N.csv"
    path.write_text(f"{ABOVE}{above}{header}\n{rows}", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    "line",
    [
        "Angular speed: 6 deg/s",
        "Angular velocity [deg/s]: 6",
        "Winkelgeschwindigkeit: 6,0 °/s",
        "Angular speed: 0.10471976 rad/s",
        "Angular speed: 1 rpm",
        "Angular feed; 360; deg/min",
    ],
)
@pytest.mark.parametrize("radius_mm", [100.0, 150.0])
def test_a_stated_angular_speed_gives_the_angles(
    line: str, radius_mm: float, tmp_path: Path
) -> None:
    imported = lb.import_campaign(log(tmp_path, line + "\n"), radius_mm=radius_mm)
    (test,) = imported.campaign.tests
    assert test.angle_deg[25] == pytest.approx(90.0, abs=1e-3)
    assert "feed" in [note.what for note in imported.assumptions]


@pytest.mark.parametrize(
    "lines",
    ["Speed: 1 rpm\n", "Angular speed: 6\n", "Angular speed: 6 deg/s\nAngular speed: 1 deg/s\n"],
)
def test_other_speeds_are_asked_for(lines: str, tmp_path: Path) -> None:
    with pytest.raises(lb.InputError, match="Give --feed-mm-per-min"):
        lb.import_campaign(log(tmp_path, lines))


def test_the_feed_of_a_column_may_have_its_unit_in_a_row_of_units(tmp_path: Path) -> None:
    # On a radius of 150 mm, 0.9424778 m/min are a turn in a minute.
    path = log(tmp_path, "", "Time;Feed;Deviation\ns;m/min;um", between="0.9424778;")
    (test,) = lb.import_campaign(path).campaign.tests
    assert test.angle_deg[25] == pytest.approx(90.0, abs=1e-3)
