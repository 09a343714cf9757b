"""Units below aligned names belong to the columns that they stand below."""

from __future__ import annotations

from pathlib import Path

import pytest

import ldbb_bayes as lb

NAMES = " No   Angle     Deviation    Spread"


def imported(folder: Path, *header: str) -> lb.reading.Imported:
    """Return a printout with a reading of 0.1 at an angle of 5, below some lines."""
    rows = [f"{k + 1:3d}   {5 * k:5d}    {0.1 * k:10.3f}    {0.5:6.1f}" for k in range(72)]
    path = folder / "100N.txt"
    path.write_text("\n".join([*header, *rows, ""]))
    return lb.import_campaign(path)


def reading_of(result: lb.reading.Imported) -> float:
    return float(result.campaign.tests[0].reading_um[1])


@pytest.mark.parametrize(
    "units", ["        deg          mm", "        deg          mm        um", "\tdeg\t     mm"]
)
def test_units_belong_to_the_columns_above_them(units: str, tmp_path: Path) -> None:
    assert reading_of(imported(tmp_path, NAMES, units)) == pytest.approx(100.0)


def test_a_factor_belongs_to_the_unit_behind_it(tmp_path: Path) -> None:
    result = imported(tmp_path, NAMES, "       deg        0.1 um")
    assert reading_of(result) == pytest.approx(0.01)


def test_a_comment_sign_is_no_unit(tmp_path: Path) -> None:
    result = imported(tmp_path, f"#{NAMES[1:]}", "#       deg          mm")
    assert reading_of(result) == pytest.approx(100.0)


def test_units_may_stand_below_a_rule(tmp_path: Path) -> None:
    result = imported(
        tmp_path, NAMES, "---  -----    ----------    ------", "        deg          mm"
    )
    assert result.layout.columns == {"angle": "Angle", "reading": "Deviation"}


def test_units_that_share_a_column_are_refused(tmp_path: Path) -> None:
    with pytest.raises(lb.InputError, match="line 2: units must be one for each column, got 'deg"):
        imported(tmp_path, NAMES, "deg mm um")


def test_a_sign_stands_for_a_missing_unit(tmp_path: Path) -> None:
    assert reading_of(imported(tmp_path, NAMES, "- deg mm um")) == pytest.approx(100.0)


def test_a_wrong_unit_is_refused_with_its_line(tmp_path: Path) -> None:
    with pytest.raises(lb.InputError, match="got 'mm' in line 2"):
        imported(tmp_path, NAMES, "         mm          mm")


@pytest.mark.parametrize("names", ["Angle;Deviation;Remark", "Angle;Deviation;Temp;Remark"])
def test_units_that_fit_the_first_names_belong_to_them(names: str, tmp_path: Path) -> None:
    rest = ";ok" * (names.count(";") - 1)
    rows = [f"{5 * k};{0.1 * k:.3f}{rest}" for k in range(72)]
    path = tmp_path / "100N.csv"
    path.write_text("\n".join([names, "deg;mm", *rows, ""]))
    assert reading_of(lb.import_campaign(path)) == pytest.approx(100.0)


def test_a_dash_is_no_unit(tmp_path: Path) -> None:
    result = imported(tmp_path, NAMES, "        deg            -")
    assert result.layout.columns == {"angle": "Angle", "reading": "Deviation"}
