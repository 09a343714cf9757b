"""Angles that lines above state by start and step, where the table numbers its points."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ldbb_bayes as lb

BACK = "Start angle: 360 deg; end angle: 5 deg; angle step: 5 deg"


def imported(
    folder: Path, line: str, header: str = "Point;Deviation [um]", n: int = 72
) -> np.ndarray:
    """Return the angles of a table of points below a line."""
    rows = [f"{k + 1};{0.1 * k:.2f}" for k in range(n)]
    path = folder / "100N.csv"
    path.write_text("\n".join([line, header, *rows, ""]))
    return np.asarray(lb.import_campaign(path).campaign.tests[0].angle_deg)


@pytest.mark.parametrize("header", ["Point;Deviation [um]", "Angle;Deviation [um]"])
def test_angles_follow_from_start_and_step(header: str, tmp_path: Path) -> None:
    angle_deg = imported(tmp_path, "Startwinkel: 90°, Winkelschritt: 5°", header)
    np.testing.assert_allclose(angle_deg, 90.0 + 5.0 * np.arange(72))


def test_the_end_gives_the_sense_of_the_step(tmp_path: Path) -> None:
    np.testing.assert_allclose(imported(tmp_path, BACK), 360.0 - 5.0 * np.arange(72))


def test_too_few_readings_for_the_end_are_refused(tmp_path: Path) -> None:
    with pytest.raises(lb.InputError, match="got 70 that do not fit"):
        imported(tmp_path, BACK, n=70)


def test_a_step_without_a_start_is_refused_with_the_line_to_write(tmp_path: Path) -> None:
    with pytest.raises(lb.InputError, match="Write a line 'Start angle: 0 deg' above the table"):
        imported(tmp_path, "Angle step: 5 deg")


def test_angles_in_a_column_are_kept_beside_a_line_of_their_range(tmp_path: Path) -> None:
    line = "Start angle: 1 deg; end angle: 360 deg"
    angle_deg = imported(tmp_path, line, "Angle;Deviation [um]", n=360)
    np.testing.assert_allclose(angle_deg, 1.0 + np.arange(360))


def test_a_column_with_a_unit_holds_angles(tmp_path: Path) -> None:
    line = "Start angle: 90 deg; angle step: 1 deg"
    angle_deg = imported(tmp_path, line, "Angle [deg];Deviation [um]", n=360)
    np.testing.assert_allclose(angle_deg, 1.0 + np.arange(360))


@pytest.mark.parametrize("step", ["Schritt: 5", "Schrittweite 5", "Increment: 5"])
def test_a_step_beside_an_end_angle_needs_no_unit(step: str, tmp_path: Path) -> None:
    angle_deg = imported(tmp_path, f"Startwinkel 0\nEndwinkel 360\n{step}")
    np.testing.assert_allclose(angle_deg, 5.0 * np.arange(72))


def test_an_end_without_a_start_is_refused_with_the_line_to_write(tmp_path: Path) -> None:
    step = "Write a line 'Start angle: 0 deg; angle step: 5 deg' above the table"
    with pytest.raises(lb.InputError, match=step):
        imported(tmp_path, "End angle: 360")


@pytest.mark.parametrize("n", [72, 73])
def test_a_range_without_a_step_is_refused_with_the_round_step(n: int, tmp_path: Path) -> None:
    with pytest.raises(lb.InputError, match="Write a line 'Angle step: 5 deg'"):
        imported(tmp_path, "Start angle: 0; end angle: 360", n=n)


def test_lines_of_stepped_angles_are_used(tmp_path: Path) -> None:
    path = tmp_path / "100N.csv"
    rows = [f"{k + 1};{0.1 * k:.2f}" for k in range(72)]
    line = "Startwinkel 0 Grad; Endwinkel 360 Grad; Winkelschritt 5 Grad"
    path.write_text("\n".join([line, "Punkt;Abweichung [um]", *rows, ""]))
    notes = lb.import_campaign(path).assumptions
    assert [note.value for note in notes if "Endwinkel" in note.value + note.because] == []
