"""A log over time whose first readings are missing is refused; the step that is named reads it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ldbb_bayes as lb

STEP_S = 0.25
SPEED_DEG_PER_S = np.rad2deg(1500.0 / 60.0 / 150.0)


def log(folder: Path, missing: int) -> Path:
    """Write a log of one turn whose first readings are missing; the first angle is 0°."""
    times = np.arange(0.0, 360.0 / SPEED_DEG_PER_S, STEP_S)
    lines = ["Force: 300 N", "Feed: 1500 mm/min", "Direction: CCW", "time [s],dR [um]"]
    for k, time in enumerate(times):
        reading = "" if k < missing else f"{10.0 * np.cos(np.deg2rad(SPEED_DEG_PER_S * time)):.4f}"
        lines.append(f"{time:.2f},{reading}")
    path = folder / "log.csv"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return path


def test_missing_first_readings_are_refused(tmp_path: Path) -> None:
    with pytest.raises(lb.InputError, match=r"none in line 5, .* to line 8, and give --start-deg"):
        lb.import_campaign(log(tmp_path, 4))


def test_the_step_reads_the_log(tmp_path: Path) -> None:
    path = log(tmp_path, 4)
    lines = path.read_text(encoding="utf-8").split("\n")
    path.write_text("\n".join([*lines[:4], *lines[8:]]), encoding="utf-8")
    start_deg = 4 * STEP_S * SPEED_DEG_PER_S
    layout = lb.reading.Layout.model_validate({"start_deg": start_deg})
    (test,) = lb.import_campaign(path, layout=layout).campaign.tests
    expected_um = 10.0 * np.cos(np.deg2rad(test.angle_deg))
    np.testing.assert_allclose(test.reading_um, expected_um, atol=1e-3)


def test_missing_readings_further_on_are_left_out(tmp_path: Path) -> None:
    path = log(tmp_path, 0)
    lines = path.read_text(encoding="utf-8").split("\n")
    lines[20] = lines[20].split(",")[0] + ","
    path.write_text("\n".join(lines), encoding="utf-8")
    (test,) = lb.import_campaign(path).campaign.tests
    assert len(test.angle_deg) == len(lines) - 6


def with_start(folder: Path, line: str) -> Path:
    """Write a log of one turn with a line on its start."""
    path = log(folder, 0)
    path.write_text(f"{line}\n{path.read_text(encoding='utf-8')}", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    "line", ["Start at 6 o'clock", "Start in 6-Uhr-Position", "Start: north", "Start oben"]
)
def test_a_start_that_is_no_axis_is_asked_for(line: str, tmp_path: Path) -> None:
    with pytest.raises(lb.InputError, match=r"where its circle starts, .* Give --start-deg"):
        lb.import_campaign(with_start(tmp_path, line))


@pytest.mark.parametrize("line", ["Start: 1772706000", "Start 20260305102000", "Start: 1405"])
def test_a_number_beyond_a_turn_is_no_angle_of_the_start(line: str, tmp_path: Path) -> None:
    (test,) = lb.import_campaign(with_start(tmp_path, line)).campaign.tests
    assert test.angle_deg[0] == pytest.approx(0.0)
