"""Angles whose degrees, minutes and seconds stand in three columns."""

from __future__ import annotations

from pathlib import Path

import pytest

import ldbb_bayes as lb

ANGLES_DEG = [0.5 + 5 * k for k in range(72)]


@pytest.mark.parametrize(
    "names", ["Deg;Min;Sec", "Winkel [°];Minuten;Sekunden", "Angle [deg];';''"]
)
def test_they_are_refused_and_the_cure_works(names: str, tmp_path: Path) -> None:
    path = tmp_path / "36 N.csv"
    rows = [f"{int(angle)};30;0;{angle / 100}" for angle in ANGLES_DEG]
    path.write_text("\n".join([f"{names};Dev [um]", *rows]))
    with pytest.raises(lb.errors.InputError, match="line 1: the angle must stand in one column"):
        lb.import_campaign(path)
    rows = [f"{int(angle)}°30'0\";{angle / 100}" for angle in ANGLES_DEG]
    path.write_text("\n".join([f"{names.split(';')[0]};Dev [um]", *rows]))
    assert list(lb.import_campaign(path).campaign.tests[0].angle_deg) == ANGLES_DEG


def test_minimum_and_maximum_are_no_minutes(tmp_path: Path) -> None:
    path = tmp_path / "36 N.csv"
    rows = [f"{angle};0;9;{angle / 100}" for angle in ANGLES_DEG]
    path.write_text("\n".join(["Angle [deg];Min;Max;Dev [um]", *rows]))
    assert len(lb.import_campaign(path).campaign.tests[0].angle_deg) == 72
