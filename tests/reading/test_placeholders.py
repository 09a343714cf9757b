"""Placeholders of missing numbers, such as -999: their rows are left out, and told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ldbb_bayes as lb
from ldbb_bayes.reading.placeholders import placeholders_in

ANGLES_DEG = np.arange(0, 360, 5)
LOST_ROWS = (20, 50)


def reading_um(angle_deg: float) -> float:
    return round(float(-4.0 + 3.0 * np.cos(np.deg2rad(2.0 * angle_deg))), 3)


def written(folder: Path, placeholder: str, size: float = 1.0, unit: str = "um") -> Path:
    """Write a circle with two placeholders among its readings."""
    lines = [f"angle_deg,reading_{unit}"]
    for k, angle_deg in enumerate(ANGLES_DEG):
        cell = f"{size * reading_um(angle_deg):.6f}"
        if k in LOST_ROWS:
            cell = placeholder
        lines.append(f"{angle_deg},{cell}")
    path = folder / "300N.csv"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return path


PLACEHOLDERS = ["-999", "-9999", "99.99", "-999.9", "32767", "-2147483.648", "1e30", "9.9e37"]


@pytest.mark.parametrize("placeholder", PLACEHOLDERS)
def test_rows_with_placeholders_are_left_out(tmp_path: Path, placeholder: str) -> None:
    (test,) = lb.import_campaign(written(tmp_path, placeholder)).campaign.tests
    kept_deg = np.delete(ANGLES_DEG, LOST_ROWS)
    np.testing.assert_allclose(test.angle_deg, kept_deg)
    np.testing.assert_allclose(test.reading_um, [reading_um(angle) for angle in kept_deg])


def test_placeholders_are_told_with_their_line(tmp_path: Path) -> None:
    imported = lb.import_campaign(written(tmp_path, "-999"))
    (note,) = [entry for entry in imported.assumptions if entry.what == "missing readings"]
    assert (note.value, note.because) == (
        "2 rows left out",
        "-999 from line 22 on, far from all other numbers of the column",
    )


@pytest.mark.parametrize(("placeholder", "size"), [("-9.999", 1e-3), ("-999", 1e-3)])
def test_placeholders_decide_no_unit(tmp_path: Path, placeholder: str, size: float) -> None:
    path = written(tmp_path, placeholder, size, unit="x").rename(tmp_path / "290N.csv")
    path.write_text(path.read_text(encoding="utf-8").replace("_x", ""), encoding="utf-8")
    (test,) = lb.import_campaign(path).campaign.tests
    assert np.ptp(test.reading_um) == pytest.approx(6.0, abs=0.01)


def test_a_placeholder_among_the_angles_leaves_out_its_row(tmp_path: Path) -> None:
    path = written(tmp_path, "-1.5")
    path.write_text(path.read_text(encoding="utf-8").replace("\n45,", "\n-999,"), encoding="utf-8")
    (test,) = lb.import_campaign(path).campaign.tests
    np.testing.assert_allclose(test.angle_deg, ANGLES_DEG[ANGLES_DEG != 45])


def test_each_column_of_readings_has_placeholders_of_its_own(tmp_path: Path) -> None:
    lines = ["angle [deg],36 N [um],400 N [um]"]
    for k, angle_deg in enumerate(ANGLES_DEG):
        light, heavy = ["-999" if k in rows else reading_um(angle_deg) for rows in ([3], [7, 9])]
        lines.append(f"{angle_deg},{light},{heavy}")
    path = tmp_path / "all.csv"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    tests = lb.import_campaign(path).campaign.tests
    assert [len(test.angle_deg) for test in tests] == [71, 70]


def test_a_test_of_placeholders_alone_is_refused(tmp_path: Path) -> None:
    lines = ["angle_deg,reading_um", "0,1.5", "5,1.7", "10,1.6", "15,1.2"]
    lines += [f"{angle_deg},-999" for angle_deg in ANGLES_DEG[4:]]
    path = tmp_path / "300N.csv"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    with pytest.raises(lb.InputError, match="readings"):
        lb.import_campaign(path)


@pytest.mark.parametrize("cell", ["9.9", "99", "-888", "1000"])
def test_other_numbers_are_no_placeholders(cell: str) -> None:
    cells = [*[f"{k % 7}.5" for k in range(30)], cell]
    assert not placeholders_in(cells, np.array([float(text) for text in cells])).any()


def test_nines_near_other_numbers_are_no_placeholders() -> None:
    cells = [f"{k}" for k in range(950, 1050)]
    assert not placeholders_in(cells, np.array([float(text) for text in cells])).any()
