"""Pressures counted from vacuum are not those of the bar, and are asked about."""

from __future__ import annotations

from pathlib import Path

import pytest

import ldbb_bayes as lb
from ldbb_bayes.errors import InputError

LINES = [
    "Pressure: 1.92 bar abs",
    "Pressure: 1.92 bar(a)",
    "Pressure: 1.92 bar (absolute)",
    "Absolute pressure: 1.92 bar",
    "Pressure: 27.8 psi a",
]


def table(folder: Path, name: str, *above: str, header: str = "", cell: str = "") -> Path:
    lines = [*above, f"{header}Angle [deg],Reading [um]"]
    for k in range(72):
        lines.append(f"{cell}{5 * k},{0.1 * k:.1f}")
    path = folder / name
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return path


@pytest.mark.parametrize("line", LINES)
def test_absolute_pressure_above_a_table_is_asked_about(line: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="in line 1 the load"):
        lb.import_campaign(table(tmp_path, "a.csv", line))


@pytest.mark.parametrize("header", ["p abs [bar]", "Absolute pressure [bar]", "p_abs [bar]"])
def test_column_of_absolute_pressures_is_asked_about(header: str, tmp_path: Path) -> None:
    path = table(tmp_path, "a.csv", header=f"{header},", cell="1.92,")
    with pytest.raises(InputError, match="force or pressure must be known"):
        lb.import_campaign(path)


def test_absolute_pressure_in_a_name_is_asked_about(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="force or pressure must be known"):
        lb.import_campaign(table(tmp_path, "1.92 bar abs.csv"))


@pytest.mark.parametrize("unit", ["bar", "bar g", "bar (gauge)", "bar, absorbed"])
def test_pressure_above_that_of_the_air_is_taken(unit: str, tmp_path: Path) -> None:
    imported = lb.import_campaign(table(tmp_path, "a.csv", f"Pressure: 1.92 {unit}"))
    assert imported.campaign.tests[0].pressure_bar == 1.92
