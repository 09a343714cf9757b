"""Words which change what a line states: a view from below, an angle that is added, an exception.

A line with such words is not used as if they were missing; the message names the option that
settles it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from campaigns import refuses

import ldbb_bayes as lb

ANGLES_DEG = np.arange(0.0, 360.0, 5.0)
TABLE = "\n".join(f"{angle:g},{k % 7}" for k, angle in enumerate(ANGLES_DEG))
HEADER = "Angle [deg],Deviation [um]"
VIEWS = [
    "Angle counted from +X, counter-clockwise as seen from below (from -Z)",
    "Angle: counter-clockwise from +X as seen from the -Z side",
    "Angle from +X, counter-clockwise looking up at the table from underneath",
    "Angle from +X counter-clockwise; seen from behind",
    "Winkel ab +X gegen den Uhrzeigersinn, von unten gesehen",
    "Angle depuis +X, sens antihoraire, vu de dessous",
    "Ángulo desde +X en sentido antihorario, vista desde abajo de la mesa",
    "Угол отсчитывается от +X против часовой стрелки, вид снизу",
    "角度：+X軸から反時計回り（主軸と反対側から見て）",
]
USUAL_VIEWS = [
    "Angle counted from +X, clockwise as seen from above (from +Z)",
    "Angle from +X, clockwise, viewed from the top",
    "Winkel ab +X im Uhrzeigersinn, von oben gesehen",
    "Angle depuis +X, sens horaire, vu de dessus",
    "Угол отсчитывается от +X по часовой стрелке, вид сверху",
    "角度：+X軸から時計回り（上から見て）",
]
SHIFTS = [
    "Add 30 deg to the angles to get the angle from +X",
    "Encoder zero lies 30 deg counter-clockwise from +X; encoder counts counter-clockwise",
    "Zero mark of the encoder is 30 deg away from +X (counter-clockwise)",
    "Offset angle of table: 30 deg (angle from +X = table angle + offset)",
    "Angle from +X less 30, counter-clockwise",
    "К углам прибавить 30°, чтобы получить угол от +X",
]
SHIFTED_HEADERS = ["Angle from X less 30 [deg]", "Angle - 30 [deg]", "Angle + 15.5 [deg]"]
NO_SHIFTS = [
    "Angle from +X, clockwise, step 5 deg",
    "Angle from +X, clockwise, in steps of 5 deg",
    "Angle from +X, clockwise, 0 to 355 deg",
    "Angle from +X, clockwise (0...360°)",
    "Angle 0° = +X, clockwise",
    "Angle: 0° = +X, -90° = +Y, clockwise",
    "Angle from +X, clockwise, 20.5 °C",
    "Angle from +X, clockwise, no offset",
    "Angle from +X, clockwise; readings less 3 um",
    "Angle from +X, clockwise, mount not measured",
]
EXCEPTIONS = [
    "Angle from +X clockwise, except circle 2: counter-clockwise",
    "Angle from +X clockwise, but not in test 3",
    "Winkel ab +X im Uhrzeigersinn, außer Kreis 2",
]
DIRECTIONS = ["Direction: CW (seen from below)", "Direction: CW, except test 2"]
SENSES = {
    "Angle from +X towards +Y": "CCW",
    "Angle from +X, positive from X towards -Y": "CW",
    "Winkel von +X nach -Y": "CW",
    "Angle measured from +X, as the hands of a clock": "CW",
    "Angle measured from +X, against the hands of a clock": "CCW",
}
COMPUTED = [
    "Radial force: 26 N + 10 N (preload of the mount)",
    "Radial force: 26 N plus 10 N",
    "Radial force (N): 32.73 (display, multiply by 1.1)",
]
SIGNS = [
    "Отклонение: плюс при сближении шаров",
    "Desviación: positiva cuando las esferas se acercan",
    "偏差：两球靠近为正",
    "偏差：バーが縮むと正",
    "極性：ボール間距離の縮みを＋とする",
    "편차: 볼바가 줄어들면 양수",
    "İşaret: çubuk kısalınca pozitif",
]


def written(folder: Path, line: str, header: str = HEADER) -> Path:
    file = folder / "300N.csv"
    file.write_text(f"{line}\n{header}\n{TABLE}\n", encoding="utf-8")
    return file


def noted(file: Path, what: str, **layout: Any) -> list[str]:
    """Return the values of all notes on a subject, such as the angle."""
    imported = lb.import_campaign(file, layout=lb.reading.Layout(**layout))
    return [note.value for note in imported.assumptions if note.what == what]


@pytest.mark.parametrize("line", VIEWS)
def test_a_sense_seen_from_elsewhere_is_asked_for(line: str, tmp_path: Path) -> None:
    refuses("as seen from above, got .* --angle-sense", lb.import_campaign, written(tmp_path, line))


@pytest.mark.parametrize("line", USUAL_VIEWS)
def test_the_view_from_above_changes_nothing(line: str, tmp_path: Path) -> None:
    assert noted(written(tmp_path, line), "angle") == ["from +X, CW"]


@pytest.mark.parametrize("line", SHIFTS)
def test_an_angle_that_is_added_is_asked_for(line: str, tmp_path: Path) -> None:
    refuses(
        "begin at an axis, got .* with .* --angle-offset-deg",
        lb.import_campaign,
        written(tmp_path, line),
    )


@pytest.mark.parametrize("header", SHIFTED_HEADERS)
def test_a_number_added_in_the_header_of_angles_is_asked_for(header: str, tmp_path: Path) -> None:
    file = written(tmp_path, "Run 1", f"{header},Deviation [um]")
    refuses("begin at an axis, got .* with .* --angle-offset-deg", lb.import_campaign, file)


def test_the_offset_settles_an_angle_that_is_added(tmp_path: Path) -> None:
    layout = lb.reading.Layout(angle_offset_deg=-30.0)
    campaign = lb.import_campaign(written(tmp_path, SHIFTS[0]), layout=layout).campaign
    np.testing.assert_allclose(campaign.tests[0].angle_deg, ANGLES_DEG + 30.0)


@pytest.mark.parametrize("line", NO_SHIFTS)
def test_steps_ranges_and_other_quantities_move_no_zero(line: str, tmp_path: Path) -> None:
    assert noted(written(tmp_path, line), "angle") == ["from +X, CW"]


@pytest.mark.parametrize("line", EXCEPTIONS)
def test_an_exception_is_asked_for(line: str, tmp_path: Path) -> None:
    refuses(
        "once for all tests, got .* with .* --angle-zero",
        lb.import_campaign,
        written(tmp_path, line),
    )


def test_axis_and_sense_settle_an_exception(tmp_path: Path) -> None:
    file = written(tmp_path, EXCEPTIONS[0])
    assert noted(file, "angle", angle_zero="+X", angle_sense="CW")[:1] == ["from +X, CW"]


def test_two_axes_in_one_line_are_asked_for(tmp_path: Path) -> None:
    line = "Angles were converted from (from +Y, clockwise) to from +X, counter-clockwise"
    refuses("begin at an axis, got .* Say at", lb.import_campaign, written(tmp_path, line))


@pytest.mark.parametrize("line", SENSES)
def test_the_way_to_an_axis_and_the_hands_of_a_clock_are_senses(line: str, tmp_path: Path) -> None:
    assert noted(written(tmp_path, line), "angle") == [f"from +X, {SENSES[line]}"]


@pytest.mark.parametrize("line", DIRECTIONS)
def test_a_direction_with_a_condition_is_told_as_not_taken(line: str, tmp_path: Path) -> None:
    assert noted(written(tmp_path, line), "direction") == ["not taken from there"]


@pytest.mark.parametrize("line", COMPUTED)
def test_a_force_of_two_numbers_is_asked_for(line: str, tmp_path: Path) -> None:
    refuses("got several numbers in line 1", lb.import_campaign, written(tmp_path, line))


def test_a_force_with_a_tolerance_is_one_number(tmp_path: Path) -> None:
    campaign = lb.import_campaign(written(tmp_path, "Radial force: 300 N +/- 2 N")).campaign
    assert campaign.tests[0].force_N == 300.0


@pytest.mark.parametrize("line", SIGNS)
def test_a_shorter_bar_is_positive_in_many_languages(line: str, tmp_path: Path) -> None:
    assert noted(written(tmp_path, line), "sign of the reading") == ["-1: a longer bar is negative"]


def test_a_sign_of_readings_in_other_words_is_told(tmp_path: Path) -> None:
    file = written(tmp_path, "Deviation: + = material left on a contour (radius too small)")
    (note,) = (
        note for note in lb.import_campaign(file).assumptions if note.what == "sign of the reading"
    )
    assert "not understood" in note.because
