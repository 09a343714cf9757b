"""Angles counted from an unnamed start, and signals called inverted, are asked about."""

from __future__ import annotations

from pathlib import Path

import pytest

import ldbb_bayes as lb
from ldbb_bayes.reading.open_question import OpenQuestionError


def table(folder: Path, line: str, header: str) -> Path:
    lines = [line, f"{header},Reading [um]"]
    for k in range(72):
        lines.append(f"{5 * k},{0.1 * k:.1f}")
    path = folder / "300N.csv"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    "header", ["Relative angle [deg]", "Δ angle [deg]", "Delta theta [deg]", "Relativwinkel [°]"]
)
def test_axis_of_relative_angles_is_asked_for(header: str, tmp_path: Path) -> None:
    with pytest.raises(OpenQuestionError) as caught:
        lb.import_campaign(table(tmp_path, "Start angle: 180 deg", header))
    assert caught.value.field == "angle_zero"


@pytest.mark.parametrize("line", ["Signal inverted", "Inverted signal", "Output signal: inverted"])
def test_sign_of_an_inverted_signal_is_asked_for(line: str, tmp_path: Path) -> None:
    with pytest.raises(OpenQuestionError) as caught:
        lb.import_campaign(table(tmp_path, line, "Angle [deg]"))
    assert caught.value.field == "sign"


@pytest.mark.parametrize("line", ["Signal not inverted", "Signal inverted: no", "Signal: ok"])
def test_signal_that_is_not_inverted_keeps_its_sign(line: str, tmp_path: Path) -> None:
    test = lb.import_campaign(table(tmp_path, line, "Angle [deg]")).campaign.tests[0]
    assert test.reading_um[70] == 7.0


def test_an_offset_of_angles_asks_for_the_angle_of_the_axis(tmp_path: Path) -> None:
    path = tmp_path / "100N.csv"
    lines = [f"{10 * k};{k % 7 + 3}" for k in range(36)]
    path.write_text("\n".join(["Angle offset: 30 deg", "Angle [deg];Reading [um]", *lines, ""]))
    with pytest.raises(lb.InputError, match=r"got 'Angle offset: 30 deg' .* --angle-offset-deg"):
        lb.import_campaign(path)


def test_a_falling_rotary_axis_needs_its_sense(tmp_path: Path) -> None:
    path = tmp_path / "100N.csv"
    lines = [f"{-10 * k};{k % 7 + 3}" for k in range(36)]
    path.write_text("\n".join(["C axis [deg];Reading [um]", *lines, ""]))
    with pytest.raises(lb.InputError, match=r"'C axis \[deg\]' must have a known sense"):
        lb.import_campaign(path)
    test = lb.import_campaign(path, layout=lb.reading.Layout(direction="CW")).campaign.tests[0]
    assert test.angle_deg[1] == pytest.approx(-10.0)
    test = lb.import_campaign(path, layout=lb.reading.Layout(angle_sense="CW")).campaign.tests[0]
    assert test.angle_deg[1] == pytest.approx(10.0)


def test_a_falling_path_angle_is_not_to_be_called_travelled(tmp_path: Path) -> None:
    """An angle travelled from the start rises: the cure names the sense in which it is counted."""
    path = tmp_path / "100N.csv"
    lines = [f"{360 - 10 * k};{k % 7 + 3}" for k in range(36)]
    path.write_text("\n".join(["Direction: CCW", "Path angle [deg];Reading [um]", *lines, ""]))
    with pytest.raises(lb.InputError, match="If it is counted clockwise, give --angle-sense CW"):
        lb.import_campaign(path)
    test = lb.import_campaign(path, layout=lb.reading.Layout(angle_sense="CW")).campaign.tests[0]
    assert test.angle_deg[1] - test.angle_deg[0] == pytest.approx(10.0)


def table_with_quadrants(folder: Path, header: str, *, is_within: bool) -> Path:
    lines = [f"{header},Angle [deg],Reading [um]"]
    for k in range(72):
        angle_deg = 5 * k % 90 if is_within else 5 * k
        lines.append(f"{5 * k // 90 + 1},{angle_deg},{0.1 * k:.1f}")
    path = folder / "300N.csv"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return path


@pytest.mark.parametrize("header", ["Quadrant", "Quadrant no.", "cuadrante", "象限"])
def test_angles_within_quadrants_are_refused_with_the_column_named(
    header: str, tmp_path: Path
) -> None:
    words = f"got '{header}' in line 1 and angles within a quadrant"
    with pytest.raises(lb.InputError, match=words):
        lb.import_campaign(table_with_quadrants(tmp_path, header, is_within=True))


def test_a_column_of_quadrants_beside_angles_around_the_circle_is_left_out(tmp_path: Path) -> None:
    path = table_with_quadrants(tmp_path, "Quadrant", is_within=False)
    assert lb.import_campaign(path).campaign.tests[0].angle_deg[71] == pytest.approx(355.0)
