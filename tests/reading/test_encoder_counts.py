"""Angles in counts of an encoder."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ldbb_bayes as lb
from ldbb_bayes.reading.layout import Layout
from ldbb_bayes.reading.unit_lines import units_stated


@pytest.mark.parametrize(
    "line",
    [
        "encoder: 36000 counts per revolution, zero at +Y",
        "36000 counts/rev",
        "Geber: 36000 Impulse pro Umdrehung",
        "Encoder: 36000 impulsos por vuelta",
    ],
)
def test_counts_in_a_turn_are_the_size_of_one_count(line: str) -> None:
    assert units_stated(line)["angle_scale"] == "0.01 deg"


def file(folder: Path, header: str, size_deg: float, above: str = "Force: 36 N") -> Path:
    """Write a circle whose angles are in counts of ``size_deg`` degrees, and return its path."""
    lines = [above, header]
    for angle_deg in range(0, 360, 5):
        reading_um = 2.0 * np.cos(np.deg2rad(2.0 * angle_deg))
        lines.append(f"{angle_deg / size_deg:.0f},{reading_um:.3f}")
    path = folder / "36N.csv"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return path


@pytest.mark.parametrize("size_deg", [0.01, 0.001])
def test_angles_in_counts_are_refused_with_the_unit_that_reads_them(
    size_deg: float, tmp_path: Path
) -> None:
    path = file(tmp_path, "Angle,Reading [um]", size_deg)
    with pytest.raises(lb.InputError, match=f"--angle-unit, such as '{size_deg:g} deg' for counts"):
        lb.import_campaign(path)
    layout = Layout(angle_unit=f"{size_deg:g} deg")
    (test,) = lb.import_campaign(path, layout=layout).campaign.tests
    np.testing.assert_allclose(test.angle_deg, np.arange(0, 360, 5))


def test_a_column_of_counts_is_read_by_the_counts_in_a_turn(tmp_path: Path) -> None:
    line = "Encoder: 36000 counts per revolution, force 36 N"
    path = file(tmp_path, "Angle counts,Reading [um]", 0.01, line)
    (test,) = lb.import_campaign(path).campaign.tests
    np.testing.assert_allclose(test.angle_deg, np.arange(0, 360, 5))


def test_counts_in_a_turn_are_no_unit_of_angles_in_degrees(tmp_path: Path) -> None:
    line = "Encoder: 36000 counts per revolution, force 36 N"
    path = file(tmp_path, "Angle,Reading [um]", 1.0, line)
    (test,) = lb.import_campaign(path).campaign.tests
    np.testing.assert_allclose(test.angle_deg, np.arange(0, 360, 5))
