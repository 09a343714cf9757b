"""Lines which say that readings still have to be corrected."""

from __future__ import annotations

from pathlib import Path

import pytest

import ldbb_bayes as lb


def written(folder: Path, line: str) -> Path:
    lines = [line, "Angle [deg];Reading [um]"]
    lines += [f"{5 * k};{k % 7}.25" for k in range(72)]
    path = folder / "100N.csv"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    "line",
    [
        "Calibration factor (not applied): 1.02",
        "Scale factor not yet applied = 1.02",
        "Zero offset (not subtracted): 2.5 um",
        "Kalibrierfaktor nicht angewendet: 1.02",
        "Nullpunktversatz (nicht abgezogen): 2.5 um",
    ],
)
def test_a_correction_that_is_not_made_is_refused(line: str, tmp_path: Path) -> None:
    with pytest.raises(lb.InputError, match=r"readings must be corrected, got .* in line 1"):
        lb.import_campaign(written(tmp_path, line))


@pytest.mark.parametrize(
    "line",
    [
        "Calibration factor (applied): 1.02",
        "Zero offset (not subtracted): 0.0 um",
        "Temperature correction factor not applied: 1.02",
    ],
)
def test_other_corrections_change_nothing(line: str, tmp_path: Path) -> None:
    campaign = lb.import_campaign(written(tmp_path, line)).campaign
    assert campaign.tests[0].reading_um[:3].tolist() == [0.25, 1.25, 2.25]
