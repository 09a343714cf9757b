"""Which column of a table is the reading and which is the load, by their headers and units."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ldbb_bayes as lb


@pytest.mark.parametrize("header", ["Radial force", "radial load", "Force radiale"])
def test_a_load_without_a_unit_is_no_reading(header: str, tmp_path: Path) -> None:
    file = tmp_path / "log.csv"
    rows = [f"{10 * k},{k % 7},300" for k in range(36)]
    file.write_text("\n".join([f"Angle [deg],Reading [um],{header}", *rows, ""]))
    (test,) = lb.import_campaign(file).campaign.tests
    assert test.force_N == 300.0
    assert test.reading_um.max() == 6.0


def test_a_load_without_readings_is_no_reading(tmp_path: Path) -> None:
    file = tmp_path / "36N.csv"
    rows = [f"{10 * k},300" for k in range(36)]
    file.write_text("\n".join(["Angle [deg],Radial force", *rows, ""]))
    with pytest.raises(lb.InputError, match=r"36N.csv: a column must hold the reading, got"):
        lb.import_campaign(file)


@pytest.mark.parametrize(
    ("header", "factor"),
    [("Radial force (N)", 1.0), ("Radial load [daN]", 0.1), ("Force reading [N]", 1.0)],
)
def test_a_radial_force_is_no_reading(header: str, factor: float, tmp_path: Path) -> None:
    """It was asked for as a second column of readings, because of the word "radial"."""
    lines = [f"Run,{header},Angle [deg],Deviation [um]"]
    for k, force_N in enumerate([50.0, 600.0], start=1):
        for angle_deg in range(0, 360, 5):
            reading_um = 0.02 * force_N * np.cos(np.deg2rad(angle_deg)) ** 2
            lines.append(f"{k},{factor * force_N:g},{angle_deg},{reading_um:.2f}")
    path = tmp_path / "export.csv"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    campaign = lb.import_campaign(path).campaign
    assert [test.force_N for test in campaign.tests] == [50.0, 600.0]
    assert [test.reading_um[0] for test in campaign.tests] == [1.0, 12.0]
