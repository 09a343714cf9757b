"""Columns ``Soll`` and ``Ist``: the reading is the actual length beside the nominal one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ldbb_bayes as lb

READINGS_UM = np.array([(7 * k) % 11 - 4.75 for k in range(36)])


def table(folder: Path, header: str, nominal_mm: float) -> Path:
    lines = [header]
    for k, reading in enumerate(READINGS_UM):
        lines.append(f"{10 * k};{nominal_mm:.4f};{nominal_mm + 1e-3 * reading:.6f}")
    path = folder / "300N.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    "header",
    ["Winkel [°];Soll [mm];Ist [mm]", "Angle [deg];Nominal [mm];Actual [mm]"],
)
@pytest.mark.parametrize("nominal_mm", [0.0, 150.0])
def test_the_actual_length_is_the_reading(header: str, nominal_mm: float, tmp_path: Path) -> None:
    (test,) = lb.import_campaign(table(tmp_path, header, nominal_mm)).campaign.tests
    np.testing.assert_allclose(test.reading_um, READINGS_UM, atol=1e-3)


def test_another_nominal_length_is_asked_for_until_the_radius_is_given(tmp_path: Path) -> None:
    path = table(tmp_path, "Winkel [°];Soll [mm];Ist [mm]", 100.0)
    with pytest.raises(lb.InputError, match="Give --radius-mm"):
        lb.import_campaign(path)
    (test,) = lb.import_campaign(path, radius_mm=100.0).campaign.tests
    np.testing.assert_allclose(test.reading_um, READINGS_UM, atol=1e-3)


def test_a_column_of_deviations_beside_both_is_the_reading(tmp_path: Path) -> None:
    path = tmp_path / "300N.csv"
    lines = ["Angle [deg];Nominal [mm];Actual [mm];Deviation [um]"]
    lines += [f"{10 * k};150;150.1;{value}" for k, value in enumerate(READINGS_UM)]
    path.write_text("\n".join(lines))
    (test,) = lb.import_campaign(path).campaign.tests
    np.testing.assert_allclose(test.reading_um, READINGS_UM)
