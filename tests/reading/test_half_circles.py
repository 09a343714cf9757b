"""Circles in two half tables each: both halves are one test, and the tests differ in name."""

from __future__ import annotations

from pathlib import Path

import ldbb_bayes as lb


def halves(force_N: int) -> list[str]:
    """Return the lines of two half circles, each below its own lines and header."""
    lines = []
    for start in (0, 180):
        lines += [f"Force {force_N} N, half {start}-{start + 180}", "Angle [deg];Reading [um]"]
        lines += [f"{angle};{0.01 * angle:.2f}" for angle in range(start, start + 181, 5)]
    return lines


def test_halves_of_two_circles_in_one_file_have_two_names(tmp_path: Path) -> None:
    path = tmp_path / "p2.csv"
    path.write_text("\n".join([*halves(100), *halves(300), ""]))
    tests = lb.import_campaign(path).campaign.tests
    assert [(test.name, test.force_N) for test in tests] == [
        ("p2 table 1", 100.0),
        ("p2 table 3", 300.0),
    ]


def test_halves_of_one_circle_in_one_file_have_their_common_name(tmp_path: Path) -> None:
    path = tmp_path / "p2.csv"
    path.write_text("\n".join([*halves(100), ""]))
    assert [test.name for test in lb.import_campaign(path).campaign.tests] == ["p2 table"]
