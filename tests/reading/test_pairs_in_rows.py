"""Rows above a header that hold several names, each with its value behind it."""

from __future__ import annotations

from pathlib import Path

import pytest

import ldbb_bayes as lb


def imported(folder: Path, *rows_above: str) -> tuple[float | None, float | None]:
    """Return force [N] and radius [mm] of a table of two columns in a file of four."""
    rows = [f"{5 * k};{0.1 * k:.2f};;" for k in range(72)]
    path = folder / "run.csv"
    path.write_text("\n".join([*rows_above, "Angle [deg];Deviation [um];;", *rows]))
    campaign = lb.import_campaign(path).campaign
    assert campaign.tests[0].reading_um[1] == 0.1
    return campaign.tests[0].force_N, campaign.tests[0].radius_mm


@pytest.mark.parametrize(
    "rows_above",
    [
        ["Force;300 N;Radius;100 mm"],
        ["Radius;100 mm;Kraft;300 N"],
        ["Kraft;300 N;Radius;100 mm", "Datum;2026-01-01;Prüfer;Meier"],
        ["Force [N];300;Radius [mm];100"],
        ["Kraft [kN];0.3;Radius [cm];10", "Temperatur;20.5;Prüfer;Meier"],
    ],
)
def test_all_pairs_of_a_row_count(rows_above: list[str], tmp_path: Path) -> None:
    assert imported(tmp_path, *rows_above) == (300.0, 100.0)


def test_a_row_of_numbers_above_the_header_is_refused(tmp_path: Path) -> None:
    with pytest.raises(lb.errors.InputError, match="got numbers in line 1"):
        imported(tmp_path, "0.5;1.5;2.5;3.5")


@pytest.mark.parametrize("number", ["1.100 kN", "1,100 kN"])
def test_a_force_in_kilonewton_has_no_thousands(number: str, tmp_path: Path) -> None:
    rows = "\n".join(f"{5 * k}\t{k}" for k in range(72))
    in_line = tmp_path / "run.csv"
    in_line.write_text(f"Force: {number}\nAngle [deg]\tDeviation [um]\n{rows}")
    in_name = tmp_path / f"{number}.csv"
    in_name.write_text(f"Angle [deg]\tDeviation [um]\n{rows}")
    for path in (in_line, in_name):
        assert lb.import_campaign(path).campaign.tests[0].force_N == 1100.0
