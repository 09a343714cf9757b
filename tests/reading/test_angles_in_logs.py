"""Logs over time that hold angles or positions: the angles are used, the positions are named."""

from __future__ import annotations

from pathlib import Path

import pytest

import ldbb_bayes as lb
from ldbb_bayes.report.message_translation import in_language

ANGLES = range(0, 360, 5)


def log(folder: Path, header: str, between: str) -> Path:
    file = folder / "36N.csv"
    rows = [f"{0.1 * k:.1f},{between.format(angle=a)},{a % 7}" for k, a in enumerate(ANGLES)]
    file.write_text("\n".join([header, *rows, ""]), encoding="utf-8")
    return file


@pytest.mark.parametrize("name", ["Encoder [deg]", "C axis (°)"])
def test_angles_of_another_name_come_before_the_clock(name: str, tmp_path: Path) -> None:
    file = log(tmp_path, f"Time [s],{name},Reading [um]", "{angle}")
    assert list(lb.import_campaign(file).campaign.tests[0].angle_deg) == list(ANGLES)


def test_the_clock_is_used_where_the_user_names_its_column(tmp_path: Path) -> None:
    file = log(tmp_path, "Time [s],Encoder [deg],Reading [um]", "{angle}")
    layout = lb.reading.Layout(columns={"time": "Time"})
    with pytest.raises(lb.InputError, match="must come with its feed"):
        lb.import_campaign(file, layout=layout)


def test_a_tilt_is_no_angle_of_the_bar(tmp_path: Path) -> None:
    file = log(tmp_path, "Time [s],Tilt [deg],Reading [um]", "0.1")
    with pytest.raises(lb.InputError, match="must come with its feed"):
        lb.import_campaign(file)


def test_positions_beside_times_are_named(tmp_path: Path) -> None:
    file = log(tmp_path, "t [ms],X_act [mm],Y_act [mm],Reading [um]", "150,{angle}")
    with pytest.raises(lb.InputError, match=r"got none, and positions 'X_act \[mm\]', 'Y_act"):
        lb.import_campaign(file)


@pytest.mark.parametrize(
    ("axes", "angle"),
    [
        ("XY", "arctan2(Y, X)"),
        ("ZX", "arctan2(X, Z)"),
        ("XZ", "arctan2(X, Z)"),
        ("YZ", "arctan2(Z, Y)"),
    ],
)
def test_the_advice_on_positions_is_of_their_plane(axes: str, angle: str, tmp_path: Path) -> None:
    """Angles count from the first axis of the plane: from +Z towards +X in ZX."""
    first, second = axes
    file = tmp_path / "36N.csv"
    rows = [f"{a},{2 * a}" for a in ANGLES]
    file.write_text("\n".join([f"{first} [mm],{second} [mm]", *rows, ""]), encoding="utf-8")
    with pytest.raises(lb.InputError) as refusal:
        lb.import_campaign(file)
    message = str(refusal.value)
    assert angle in message
    assert angle in str(in_language(message, "de"))
