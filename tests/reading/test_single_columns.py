"""Texts with a single column of readings, with and without lines that state the angles."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ldbb_bayes as lb
from ldbb_bayes.reading.single_columns import is_single_column, with_points_numbered

READINGS = [f"{0.25 * k - 9:.2f}" for k in range(72)]
STEPS = {
    "spanish": "Ángulo inicial: 90°\nIncremento angular: -5° (sentido horario)",
    "french": "Angle initial : 90°\nPas angulaire : -5°",
    "italian": "Angolo iniziale: 90°; passo angolare: -5°",
    "english": "Initial angle: 90 deg\nAngle step: -5 deg",
}


def written(folder: Path, above: str, mark: str, header: str = "Deviation [µm]") -> Path:
    """Write a single column of readings below lines, and return its path."""
    readings = [reading.replace(".", mark) for reading in READINGS]
    path = folder / "36N.dat"
    path.write_text("\n".join([above, header, *readings, ""]), encoding="utf-8")
    return path


@pytest.mark.parametrize("mark", [",", "."])
@pytest.mark.parametrize("above", STEPS.values(), ids=STEPS.keys())
def test_angles_of_a_single_column_follow_from_start_and_step(
    above: str, mark: str, tmp_path: Path
) -> None:
    (test,) = lb.import_campaign(written(tmp_path, above, mark)).campaign.tests
    np.testing.assert_allclose(test.angle_deg, 90.0 - 5.0 * np.arange(72))
    np.testing.assert_allclose(test.reading_um, [float(reading) for reading in READINGS])


@pytest.mark.parametrize("mark", [",", "."])
def test_a_single_column_without_a_step_is_refused_with_what_is_missing(
    mark: str, tmp_path: Path
) -> None:
    with pytest.raises(lb.InputError, match="column of angles, got one column of numbers"):
        lb.import_campaign(written(tmp_path, "Radius: 150 mm", mark))


def test_the_line_that_the_refusal_names_lets_the_file_be_read(tmp_path: Path) -> None:
    line = "Start angle: 0 deg; angle step: 5 deg"
    (test,) = lb.import_campaign(written(tmp_path, line, ",")).campaign.tests
    np.testing.assert_allclose(test.angle_deg, 5.0 * np.arange(72))


@pytest.mark.parametrize("header", ["Angle, reading", "Angle [deg]", "Run 1"])
def test_pairs_of_whole_numbers_are_no_single_column(header: str) -> None:
    pairs = [f"{5 * k},{k}" for k in range(72)]
    lines = ["Angle step: 5 deg", header, *pairs]
    assert not is_single_column(lines)
    assert with_points_numbered("\n".join(lines)) == "\n".join(lines)
