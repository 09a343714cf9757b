"""Units of radii that stand in the row of units below the header."""

from __future__ import annotations

from pathlib import Path

import pytest

import ldbb_bayes as lb


@pytest.mark.parametrize(
    ("names", "units", "radius", "radius_mm"),
    [
        ("Radius;Angle;Deviation", "cm;deg;um", "15", 150.0),
        ("Radius;Angle;Deviation", "in;deg;um", "12", 304.8),
        ("R;Angle;Deviation", "[mm];[deg];[um]", "100", 100.0),
        ("Diameter;Angle;Deviation", "cm;deg;um", "20", 100.0),
    ],
)
def test_the_unit_below_is_that_of_the_radius(
    names: str, units: str, radius: str, radius_mm: float, tmp_path: Path
) -> None:
    rows = [f"{radius};{5 * k};{0.1 * k:.2f}" for k in range(72)]
    path = tmp_path / "36 N.csv"
    path.write_text("\n".join([names, units, *rows]))
    campaign = lb.import_campaign(path).campaign
    assert campaign.tests[0].radius_mm == radius_mm
    assert campaign.tests[0].reading_um[1] == 0.1


@pytest.mark.parametrize(("unit", "radii"), [("mm", (100, 150)), ("cm", (10, 15))])
def test_radii_that_tell_circles_apart_have_the_unit_below(
    unit: str, radii: tuple[int, int], tmp_path: Path
) -> None:
    rows = []
    for radius in radii:
        for force in (36, 490):
            rows += [f"{radius};{force};{5 * k};{0.1 * k:.2f}" for k in range(72)]
    path = tmp_path / "all.csv"
    path.write_text("\n".join(["R;F;Angle;Dev", f"{unit};N;deg;um", *rows]))
    tests = lb.import_campaign(path).campaign.tests
    stated = [(test.radius_mm, test.force_N) for test in tests]
    assert stated == [(100.0, 36.0), (100.0, 490.0), (150.0, 36.0), (150.0, 490.0)]
